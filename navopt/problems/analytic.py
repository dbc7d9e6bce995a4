"""Analytic test problems with exact minima."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.problem import EstimationProblem, Parameter, stream
from navopt.registry import problem

__all__ = ["Point", "Sphere"]


@dataclass(frozen=True)
class Point:
    """Estimate of an analytic problem: the point itself.

    Attributes
    ----------
    position : ndarray, shape (n_var,)
        The decision vector.
    """

    position: np.ndarray


@problem("sphere", summary="squared distance to a hidden point of the box", example={"n_var": 3})
class Sphere(EstimationProblem):
    """Half the squared distance to a minimiser: the simplest problem with everything known.

    Parameters
    ----------
    minimizer : array_like, shape (n_var,)
        Where the loss is zero; inside the box.
    lower, upper : array_like, shape (n_var,) or float
        The box.
    offset : float, default 0.0
        Added to the loss, so that the minimum can be negative.
    """

    provides = frozenset({"residuals", "bound"})

    def __init__(self, minimizer: Any, *, lower: Any = -10.0, upper: Any = 10.0, offset: float = 0.0) -> None:
        centre = np.array(minimizer, dtype=float)
        if centre.ndim != 1:
            raise InvalidInput("minimizer", centre.shape, "give one coordinate per parameter")
        low, high = np.broadcast_to(lower, centre.shape), np.broadcast_to(upper, centre.shape)
        if not ((low <= centre) & (centre <= high)).all():
            raise InvalidInput("minimizer", centre.tolist(), "give a point inside the box")
        super().__init__(
            [
                Parameter(f"x{k}", "1", float(a), float(b), float(a + b) / 2)
                for k, (a, b) in enumerate(zip(low, high, strict=True))
            ]
        )
        centre.setflags(write=False)
        self.offset = float(offset)
        self.true_x = centre
        self.truth = Point(centre)

    @classmethod
    def simulate(  # type: ignore[override]
        cls, seed: int = 0, *, n_var: int = 3, lower: float = -10.0, upper: float = 10.0, offset: float = 0.0
    ) -> Sphere:
        """Draw the minimiser uniformly in the box."""
        rng = stream("world:sphere", seed)
        return cls(rng.uniform(lower, upper, n_var), lower=lower, upper=upper, offset=offset)

    def redraw(self, seed: int) -> Sphere:
        """Return the same problem: it has no noise to draw again."""
        return self

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return 0.5 * np.sum((X - self.true_x) ** 2, axis=1) + self.offset

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        return X - self.true_x

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        return np.broadcast_to(np.eye(self.n_var), (len(X), self.n_var, self.n_var)).copy()

    def estimate(self, x: np.ndarray) -> Point:
        """Point that the decision vector is."""
        return Point(np.array(x, dtype=float))

    def project(self, estimate: Point) -> np.ndarray:
        """Nearest point of the box."""
        return self.clip(estimate.position)

    def _score(self, estimate: Point) -> dict[str, float]:
        return {"distance_1": float(np.linalg.norm(estimate.position - self.true_x))}
