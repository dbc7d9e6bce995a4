"""What the data of a problem can tell of its parameters: rank, null directions, attainable accuracy."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.errors import InvalidInput
from navopt.problem import EstimationProblem

__all__ = ["Identifiability", "NullDirection", "assess", "identifiability"]

Array = NDArray[np.float64]

#: Singular values below this share of the largest are rounding, whatever the noise.
_ROUNDING = 1e-8
#: A parameter that the unseen directions move by less than this share of their length counts as seen.
_TOUCHED = 0.05


@dataclass(frozen=True)
class NullDirection:
    """A combination of parameters that the data do not tell.

    Attributes
    ----------
    coefficients : dict of str to float
        Weight of each parameter that takes part, the largest being one, in units of half the width of its box
        (of the prior's sigma where there is a prior).
    words : str
        The same to be read: ``"misalignment_xy - misalignment_yx: rotation of the gyro frame about z"``.
    sigma : float
        How well the data tell it after all, in those units; infinite if not at all.
    """

    coefficients: dict[str, float]
    words: str
    sigma: float = np.inf


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What the data of a problem can tell of its parameters at one point.

    Attributes
    ----------
    rank : int
        Number of independent combinations of parameters that the data tell.
    n_parameters : int
        Number of parameters.
    singular_values : ndarray, shape (n_parameters,)
        Of the whitened Jacobian with parameters in units of half the width of the box (or the prior's sigma),
        largest first: 1/s is the standard deviation of a combination in those units.
    null_directions : tuple of NullDirection
        A basis of what the data do not tell, ``n_parameters - rank`` of them.
    sigma : dict of str to float
        Cramér–Rao standard deviation of each parameter in its own unit, from the data alone; infinite where
        it cannot be told, finite for the others even then.
    units : dict of str to str
        Units of `sigma`.
    """

    rank: int
    n_parameters: int
    singular_values: Array
    null_directions: tuple[NullDirection, ...]
    sigma: dict[str, float]
    units: dict[str, str] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether every combination can be told."""
        return self.rank == self.n_parameters

    def report(self) -> str:
        """Return everything in lines of plain text."""
        lines = [f"{self.rank} of {self.n_parameters} parameters can be told"]
        if self.null_directions:
            lines.append("not told by the data:")
            lines += [f"  {direction.words}" for direction in self.null_directions]
        lines.append("attainable standard deviation:")
        width = max(len(name) for name in self.sigma)
        for name, value in self.sigma.items():
            shown = f"{value:.3g} {self.units.get(name, '')}".strip() if np.isfinite(value) else "not told"
            lines.append(f"  {name:{width}}  {shown}")
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.report()


def identifiability(problem: EstimationProblem, x: Any = None, *, threshold: float = 1.0) -> Identifiability:
    """Tell which combinations of its parameters the data of a problem can tell.

    Parameters
    ----------
    problem : EstimationProblem
        One with residuals, or with a `sensitivity` of its own.
    x : array_like, shape (n_var,), optional
        Where the residuals are linearised; the truth (or its projection) if not given, the nominal point of a
        problem without one.
    threshold : float, default 1.0
        A combination counts as told if the data fix it to better than this many half widths of the box (or
        standard deviations of the prior).

    Returns
    -------
    Identifiability

    Raises
    ------
    UnsuitableProblem
        If the problem has neither.
    InvalidInput
        If the model cannot be evaluated at `x`, or the threshold is not positive.

    Notes
    -----
    A rank needs a scale. "Told" here means: told better than it was known before, that is better than half
    the width of the box. So the answer depends on the noise and on the box, as it should: six misalignments
    alone leave a trace of their antisymmetric parts in the norm of the Earth rate, by terms of second order,
    but a trace a thousand times too weak for any gyro does not count. Combinations that leave none at all are
    below 1e-8 of the largest singular value and never count.

    A parameter is told if no untold combination moves it by more than a twentieth of its length. The prior
    sets the units, nothing else: the standard deviations are the data's alone.
    """
    if not (np.isfinite(threshold) and threshold > 0.0):
        raise InvalidInput("threshold", threshold, "give a positive number of half box widths")
    point = _point(problem, x)
    return assess(problem, problem.sensitivity(point), threshold=threshold)


def assess(
    problem: EstimationProblem, jacobian: Array, *, columns: Any = None, threshold: float = 1.0
) -> Identifiability:
    """Do what `identifiability` does with a Jacobian that is known already, for some parameters only.

    Parameters
    ----------
    problem : EstimationProblem
        Whose box, prior, names and words are used.
    jacobian : ndarray, shape (m, n_var)
        Of its residuals, or its `sensitivity`.
    columns : array_like of int, optional
        Places of the parameters that are sought, the others being known.
    threshold : float
        As for `identifiability`.

    Returns
    -------
    Identifiability

    Raises
    ------
    InvalidInput
        If the Jacobian is not finite.
    """
    if not np.isfinite(jacobian).all():
        raise InvalidInput("x", "a point without slopes", "the model cannot be evaluated there; give another")
    places = np.arange(problem.n_var) if columns is None else np.asarray(columns)
    known = problem.prior()
    size = (0.5 * (problem.xu - problem.xl) if known is None else np.sqrt(np.diag(known[1])))[places]
    names = [problem.parameter_names[k] for k in places]
    scaled = jacobian[:, places] * size
    _, values, directions = np.linalg.svd(scaled, full_matrices=True)
    values = np.concatenate([values, np.zeros(len(places) - len(values))])
    told = (values * threshold > 1.0) & (values > _ROUNDING * values[0])
    rank = int(told.sum())
    null = directions[rank:]
    spread = directions[:rank] / values[:rank, None]
    sigma = np.sqrt(np.sum(spread**2, axis=0)) * size
    sigma[np.sqrt(np.sum(null**2, axis=0)) > _TOUCHED] = np.inf
    floor = _ROUNDING * values[0]
    return Identifiability(
        rank=rank,
        n_parameters=len(places),
        singular_values=values,
        null_directions=tuple(_described(problem, names, vector, scaled, floor) for vector in _plain(null)),
        sigma=dict(zip(names, sigma.tolist(), strict=True)),
        units={p.name: "" if p.unit == "1" else p.unit for p in problem.parameters},
    )


def _point(problem: EstimationProblem, x: Any) -> Array:
    if x is not None:
        return np.asarray(x, dtype=float)
    if problem.true_x is not None:
        return np.asarray(problem.true_x, dtype=float)
    return problem.nominal if problem.truth is None else problem.project(problem.truth)


def _plain(null: Array) -> Array:
    """Basis of the same space in which each vector has a parameter to itself.

    Singular vectors of a space of several dimensions are any mixture; Gauss–Jordan elimination on the
    parameters that stand out most makes them readable.
    """
    if not len(null):
        return null
    rows = null.copy()
    pivots: list[int] = []
    for k in range(len(rows)):
        rest = np.abs(rows[k:])
        rest[:, pivots] = 0.0
        # ties are many, and must not hang on rounding: the first parameter within a thousandth of the largest
        column = int(np.flatnonzero(rest.max(axis=0) > 0.999 * rest.max())[0])
        row = k + int(np.argmax(rest[:, column]))
        rows[[k, row]] = rows[[row, k]]
        rows[k] /= rows[k, column]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, column] * rows[k]
        pivots.append(column)
    rows = rows[np.argsort(pivots)]
    return rows / np.abs(rows).max(axis=1, keepdims=True)


def _described(
    problem: EstimationProblem, names: list[str], vector: Array, scaled: Array, floor: float
) -> NullDirection:
    kept = np.abs(vector) > _TOUCHED
    lead = vector[kept][0]
    pairs = zip(np.array(names)[kept], vector[kept] * np.sign(lead), strict=True)
    coefficients = {str(name): float(weight) for name, weight in pairs}
    words = ""
    for name, weight in coefficients.items():
        sign = " - " if weight < 0 else " + "
        factor = "" if abs(abs(weight) - 1.0) < 0.02 else f"{abs(weight):.2g} "
        words += f"{sign}{factor}{name}"
    words = words.removeprefix(" + ").replace(" - ", "-", 1) if words.startswith(" - ") else words[3:]
    meaning = problem.describe_direction(coefficients)
    seen = float(np.linalg.norm(scaled @ (vector / np.linalg.norm(vector))))
    return NullDirection(
        coefficients=coefficients,
        words=f"{words}: {meaning}" if meaning else words,
        sigma=1.0 / seen if seen > floor else np.inf,
    )
