"""Problems moved, turned or measured in other units: what a search must not depend on.

A wrapper changes the decision vector and leaves the world alone. The loss of a wrapped problem at x is
the inner problem's loss at y = c + A (x - o), an affine map; estimates, truth and scores are the inner
problem's, at y. Wrappers nest: in ``Shifted(Rotated(f), o)`` the turned function is shifted.

The map leads outside the inner problem's box, and nothing is clipped there: clipping would make plateaus
that the inner problem has not. Analytic problems are defined everywhere; a problem with data answers
``+inf`` where its model ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnsuitableProblem
from navopt.problem import EstimationProblem, Parameter, stream
from navopt.problems.wrapper_base import Wrapper, in_order, registered_name

__all__ = ["Rotated", "Scaled", "Shifted", "haar_orthogonal"]


class Shifted(Wrapper):
    """Another problem moved in its box: its loss at x is the inner loss at ``x - shift``.

    Parameters
    ----------
    problem : EstimationProblem
        The inner problem; the box stays where it is.
    shift : array_like, shape (n_var,), or float
        Where to move it, in the units of the parameters.

    Raises
    ------
    InvalidInput
        If the minimiser, where it is known, would leave the box.
    """

    def __init__(self, problem: EstimationProblem, shift: Any) -> None:
        self.shift = _vector("shift", shift, problem.n_var)
        super().__init__(problem)

    @classmethod
    def draw(
        cls, problem: EstimationProblem, seed: int, *, fraction: Sequence[float] = (0.1, 0.4)
    ) -> Shifted:
        """Draw a shift of either sign that leaves the minimiser inside the box.

        Parameters
        ----------
        problem : EstimationProblem
            The inner problem, with a known minimiser or truth.
        seed : int
            Seed of the draw.
        fraction : pair of float
            Least and greatest shift of a coordinate, as fractions of the box's width; at most 0.45.
            Where the box ends sooner, so does the range, one hundredth of the width before the wall.

        Notes
        -----
        The sign of each coordinate is drawn first, among those that leave room for the least shift.
        """
        low, high = (float(value) for value in fraction)
        if not 0.0 <= low <= high <= 0.45:
            raise InvalidInput(
                "fraction", tuple(fraction), "give least and greatest, 0 <= low <= high <= 0.45"
            )
        rng = stream(f"wrapper:shift:{registered_name(problem)}", seed)
        signs, sizes = rng.random(problem.n_var), rng.random(problem.n_var)
        width = problem.xu - problem.xl
        # room towards either wall, in widths; what a coordinate near one wall lacks, the other side has
        up = np.minimum(high, (problem.xu - _minimizer(problem)) / width - 0.01)
        down = np.minimum(high, (_minimizer(problem) - problem.xl) / width - 0.01)
        upward = np.where(up < low, False, np.where(down < low, True, signs < 0.5))
        size = low + (np.where(upward, up, down) - low) * sizes
        return cls(problem, np.where(upward, size, -size) * width)

    @classmethod
    def to_fraction(cls, problem: EstimationProblem, fraction: Any) -> Shifted:
        """Move the minimiser to a given place in the box.

        Parameters
        ----------
        problem : EstimationProblem
            The inner problem, with a known minimiser or truth.
        fraction : array_like, shape (n_var,), or float
            Place along each axis, 0 at the lower and 1 at the upper limit.
        """
        place = _vector("fraction", fraction, problem.n_var)
        if not ((place >= 0.0) & (place <= 1.0)).all():
            raise InvalidInput("fraction", place.tolist(), "give numbers between 0 and 1")
        old = _minimizer(problem)
        target = problem.xl + place * (problem.xu - problem.xl)
        # old + (target - old) may round to just outside
        target = np.where(place < 1.0, target, problem.xu)
        shift = target - old
        for _ in range(2):
            shift = np.where(old + shift > problem.xu, np.nextafter(shift, -np.inf), shift)
            shift = np.where(old + shift < problem.xl, np.nextafter(shift, np.inf), shift)
        return cls(problem, shift)

    def inward(self, X: np.ndarray) -> np.ndarray:
        """Decision vectors of the inner problem, shape (..., n_var), unclipped."""
        return np.asarray(X, dtype=float) - self.shift

    def outward(self, Y: np.ndarray) -> np.ndarray:
        """Inverse of `inward`."""
        return np.asarray(Y, dtype=float) + self.shift

    def over(self, problem: EstimationProblem) -> Shifted:
        """Return another inner problem with the same shift."""
        return Shifted(problem, self.shift)


class Rotated(Wrapper):
    """Another problem turned in its box: its loss at x is the inner loss at ``c + W R W⁻¹ (x - c)``.

    W holds the widths of the box, so that coordinates of different units mix in equal parts; in a cube
    the map is the rotation R itself.

    Parameters
    ----------
    problem : EstimationProblem
        The inner problem; the box stays as it is.
    rotation : array_like, shape (n_var, n_var)
        Orthogonal matrix R, of either determinant.
    centre : array_like, shape (n_var,), optional
        Fixed point c. The minimiser if it is known, which thereby stays inside any box, and otherwise the
        centre of the box. Of several minimisers, the others may leave the box.

    Raises
    ------
    InvalidInput
        If the matrix is not orthogonal, or the minimiser would leave the box.
    """

    def __init__(self, problem: EstimationProblem, rotation: Any, *, centre: Any = None) -> None:
        n = problem.n_var
        turn = np.array(rotation, dtype=float)
        if turn.shape != (n, n) or not np.allclose(turn @ turn.T, np.eye(n), rtol=0.0, atol=1e-10):
            raise InvalidInput("rotation", turn.shape, f"give an orthogonal matrix of shape ({n}, {n})")
        if centre is None:
            middle = (problem.xl + problem.xu) / 2.0
            centre = middle if problem.true_x is None else problem.true_x
        self.rotation, self.centre = turn, _vector("centre", centre, n)
        width = problem.xu - problem.xl
        ratio = width[:, None] / width
        self._slope, self._back = turn * ratio, turn.T * ratio
        for array in (self.rotation, self._slope, self._back):
            array.setflags(write=False)
        super().__init__(problem)

    @classmethod
    def draw(cls, problem: EstimationProblem, seed: int) -> Rotated:
        """Draw the rotation evenly from all orthogonal matrices (Haar measure)."""
        rng = stream(f"wrapper:rotate:{registered_name(problem)}", seed)
        return cls(problem, haar_orthogonal(problem.n_var, rng))

    def inward(self, X: np.ndarray) -> np.ndarray:
        """Decision vectors of the inner problem, shape (..., n_var), unclipped."""
        return self.centre + in_order(np.asarray(X, dtype=float) - self.centre, self._slope.T)

    def outward(self, Y: np.ndarray) -> np.ndarray:
        """Inverse of `inward`."""
        return self.centre + in_order(np.asarray(Y, dtype=float) - self.centre, self._back.T)

    def slope(self) -> np.ndarray:
        """Derivative of `inward`, shape (n_var, n_var)."""
        return self._slope

    def over(self, problem: EstimationProblem) -> Rotated:
        """Return another inner problem, turned about the same centre."""
        return Rotated(problem, self.rotation, centre=self.centre)


class Scaled(Wrapper):
    """Another problem in other units: its loss at x is the inner loss at ``x / factors``.

    The box is multiplied by the factors too: a search that minds the box solves both alike, to the last
    bit where the factors are powers of two.

    Parameters
    ----------
    problem : EstimationProblem
        The inner problem.
    factors : array_like, shape (n_var,), or float
        Positive number by which each parameter is multiplied.
    """

    def __init__(self, problem: EstimationProblem, factors: Any) -> None:
        self.factors = _vector("factors", factors, problem.n_var)
        if not (self.factors > 0.0).all():
            raise InvalidInput("factors", self.factors.tolist(), "give positive numbers")
        super().__init__(
            problem,
            [
                Parameter(
                    p.name, p.unit if f == 1.0 else f"{p.unit}/{f:g}", p.lower * f, p.upper * f, p.nominal * f
                )
                for p, f in zip(problem.parameters, self.factors.tolist(), strict=True)
            ],
        )

    def inward(self, X: np.ndarray) -> np.ndarray:
        """Decision vectors of the inner problem, shape (..., n_var), unclipped."""
        return np.asarray(X, dtype=float) / self.factors

    def outward(self, Y: np.ndarray) -> np.ndarray:
        """Inverse of `inward`."""
        return np.asarray(Y, dtype=float) * self.factors

    def slope(self) -> np.ndarray:
        """Derivative of `inward`, shape (n_var, n_var)."""
        return np.diag(1.0 / self.factors)

    def over(self, problem: EstimationProblem) -> Scaled:
        """Return another inner problem in the same units."""
        return Scaled(problem, self.factors)


def haar_orthogonal(n: int, rng: np.random.Generator) -> np.ndarray:
    """Orthogonal matrix drawn from the Haar measure, shape (n, n).

    The QR factorisation of a normal matrix, made unique by a positive diagonal of R: without it the
    result is not uniform (Mezzadri, Notices of the AMS 54, 2007).
    """
    q, r = np.linalg.qr(rng.standard_normal((n, n)))
    return q * np.where(np.diag(r) < 0.0, -1.0, 1.0)


def _vector(argument: str, value: Any, n_var: int) -> np.ndarray:
    vector = np.array(value, dtype=float)
    if vector.shape not in ((), (n_var,)) or not np.isfinite(vector).all():
        raise InvalidInput(argument, value, f"give one finite number, or one for each of {n_var} parameters")
    vector = np.broadcast_to(vector, (n_var,)).copy()
    vector.setflags(write=False)
    return vector


def _minimizer(problem: EstimationProblem) -> np.ndarray:
    if problem.true_x is not None:
        return problem.true_x
    if problem.truth is not None:
        return problem.project(problem.truth)
    raise UnsuitableProblem(
        f"{type(problem).__name__} does not say where its minimum is; give Shifted the shift itself"
    )
