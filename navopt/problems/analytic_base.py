"""What the analytic test problems have in common: known minimisers, a start point, disguises."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from navopt.errors import InvalidInput
from navopt.problem import EstimationProblem, Parameter
from navopt.problems.noisy import Noisy
from navopt.problems.wrappers import Rotated, Shifted

__all__ = ["AnalyticFunction", "Point", "ScalableFunction"]

#: Where in the box the start lies if the literature names none: off the centre, where many of these
#: functions have their minimum, and at no round fraction, where a study may move the minimum to.
GOLDEN_SECTION = (5.0**0.5 - 1.0) / 2.0


@dataclass(frozen=True)
class Point:
    """Estimate of an analytic problem: the point itself.

    Attributes
    ----------
    position : ndarray, shape (n_var,)
        The decision vector.
    """

    position: np.ndarray


class AnalyticFunction(EstimationProblem):
    """Base of the analytic problems: a loss in closed form whose global minimisers are known.

    Parameters
    ----------
    minimizers : array_like, shape (k, n_var)
        All global minimisers.
    minimum : float
        Loss there.
    box : tuple of float
        Customary lower and upper limits, the same for every coordinate.
    lower, upper : array_like, shape (n_var,), or float, optional
        Other limits.
    start : array_like, shape (n_var,), optional
        Customary start of a local method.

    Attributes
    ----------
    minimizers : ndarray, shape (k, n_var)
        All global minimisers of the function, inside the box or not.
    minimum : float
        Its global minimum, whatever the box.
    start : ndarray, shape (n_var,)
        Customary start of local methods; where the literature has none, the point at the golden section
        of the box. `nominal` is the same point, clipped to the box.
    true_x, truth
        The first minimiser inside the box; None if the box holds none, and then nothing is scored.

    Notes
    -----
    The functions are defined everywhere; the box only says where to search.
    """

    #: Distance from the origin within which the minimum has been established.
    proven_radius: ClassVar[float] = np.inf

    minimizers: np.ndarray
    minimum: float
    start: np.ndarray

    def __init__(
        self,
        minimizers: Any,
        minimum: float,
        box: tuple[float, float],
        *,
        lower: Any = None,
        upper: Any = None,
        start: Any = None,
    ) -> None:
        points = np.array(minimizers, dtype=float, ndmin=2)
        low = _limits("lower", box[0] if lower is None else lower, points.shape[1])
        high = _limits("upper", box[1] if upper is None else upper, points.shape[1])
        origin = low + GOLDEN_SECTION * (high - low) if start is None else np.array(start, dtype=float)
        nominal = np.clip(origin, low, high)
        super().__init__(
            [
                Parameter(f"x{k}", "1", *(float(value) for value in limits))
                for k, limits in enumerate(zip(low, high, nominal, strict=True))
            ]
        )
        self.minimizers, self.minimum, self.start = points, float(minimum), origin
        inside = points[((low <= points) & (points <= high)).all(axis=1)]
        if len(inside) and np.hypot.reduce(np.maximum(np.abs(low), np.abs(high))) <= self.proven_radius:
            inside.setflags(write=False)
            self.true_x, self.truth = inside[0], Point(inside[0])
        for array in (self.minimizers, self.start):
            array.setflags(write=False)

    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        lower: Any = None,
        upper: Any = None,
        shift: bool | Sequence[float] = False,
        rotate: bool = False,
        noise: float = 0.0,
    ) -> EstimationProblem:
        """Return the function, the same for every seed unless it is disguised.

        Parameters
        ----------
        seed : int
            Seed of the disguises.
        lower, upper : array_like, shape (n_var,), or float, optional
            The box.
        shift : bool or pair of float
            Move the minimum by 10 % to 40 % of the box along each axis, or by other fractions; see
            `navopt.problems.Shifted.draw`.
        rotate : bool
            Turn the function about its minimum, see `navopt.problems.Rotated.draw`.
        noise : float
            Standard deviation of the noise in the loss, see `navopt.problems.Noisy`.

        Returns
        -------
        EstimationProblem
        """
        return cls._disguised(seed, shift, rotate, noise, lower=lower, upper=upper)

    @classmethod
    def _disguised(
        cls, seed: int, shift: bool | Sequence[float], rotate: bool, noise: float, **arguments: Any
    ) -> EstimationProblem:
        world: EstimationProblem = cls(**arguments)
        if rotate:
            world = Rotated.draw(world, seed)
        if shift is not False:
            world = Shifted.draw(world, seed) if shift is True else Shifted.draw(world, seed, fraction=shift)
        return Noisy(world, noise, seed) if noise else world

    def redraw(self, seed: int) -> EstimationProblem:
        """Return the same problem: it has no noise to draw again."""
        return self

    def estimate(self, x: np.ndarray) -> Point:
        """Point that the decision vector is."""
        return Point(np.array(x, dtype=float))

    def locate(self, estimate: Point) -> np.ndarray:
        """Decision vector of a point, also outside the box, shape (n_var,)."""
        return np.array(estimate.position, dtype=float)

    def project(self, estimate: Point) -> np.ndarray:
        """Nearest point of the box."""
        return self.clip(estimate.position)

    def _score(self, estimate: Point) -> dict[str, float]:
        gaps = self.minimizers - estimate.position
        return {
            "distance_1": float(np.sqrt(np.sum(gaps**2, axis=1)).min()),
            "gap_1": float(self.loss(estimate.position)) - self.minimum,
        }


class ScalableFunction(AnalyticFunction):
    """Base of the analytic problems of any number of variables."""

    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        n_var: int = 2,
        lower: Any = None,
        upper: Any = None,
        shift: bool | Sequence[float] = False,
        rotate: bool = False,
        noise: float = 0.0,
    ) -> EstimationProblem:
        """Return the function of `n_var` variables; the rest as for `AnalyticFunction.simulate`."""
        return cls._disguised(seed, shift, rotate, noise, n_var=n_var, lower=lower, upper=upper)


def _limits(argument: str, value: Any, n_var: int) -> np.ndarray:
    limits = np.array(value, dtype=float)
    if limits.shape not in ((), (1,), (n_var,)):
        raise InvalidInput(argument, limits.shape, f"give one number, or one for each of {n_var} coordinates")
    return np.broadcast_to(limits, (n_var,))
