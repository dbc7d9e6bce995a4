"""Noise covariances by autocovariance least squares: a semidefinite programme through cvxpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.als_matrices import (
    ErrorDynamics,
    als_matrices,
    autocovariance,
    fixed_gain_innovations,
    uniqueness,
)
from baselines.constant_model import require_constant, steady_gain, transient
from baselines.noise_structure import NoisePart, NoiseStructure
from navopt.algorithms.options import at_least, one_of
from navopt.errors import InvalidInput, NumericalFault
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["SOLVERS", "AlsFit", "fit_autocovariances"]

Array = NDArray[np.float64]

#: Conic solvers of cvxpy that are tried by name.
SOLVERS = ("CLARABEL", "SCS")


@dataclass(frozen=True)
class AlsFit:
    """Covariances of the noises from the autocovariances of innovations.

    Attributes
    ----------
    Q, R : ndarray, shape (g, g) and (m, m)
        Covariances of process and measurement noise, positive semidefinite.
    misfit : float
        Weighted sum of squares that is left, per autocovariance entry; near one if the model is right.
    rank, unknowns : int
        How many combinations of the unknowns of Q the data determine, and how many there are.
    solver : str
        Conic solver that found it.
    passes : int
        Filter runs over the data.
    """

    Q: Array
    R: Array
    misfit: float
    rank: int
    unknowns: int
    solver: str
    passes: int

    @property
    def unique(self) -> bool:
        """Whether the data determine Q; with `trace_weight` > 0 it need not be."""
        return self.rank == self.unknowns


def fit_autocovariances(
    model: LinearGaussianModel,
    structure: NoiseStructure,
    *,
    lags: int = 15,
    passes: int = 2,
    burn_in: int | None = None,
    weighting: str = "white",
    trace_weight: float = 0.0,
    solver: str = "CLARABEL",
    spend: Callable[[int], bool] | None = None,
) -> AlsFit:
    """Fit Q and R to the autocovariances of a fixed-gain filter's innovations.

    Minimises ‖M_Q vec Q + M_R vec R − vec R̂(N)‖² in a weighted norm plus ``trace_weight · tr Q``, subject
    to Q ⪰ 0 and R ⪰ 0 (Odelson, Rajamani and Rawlings 2006; Rajamani and Rawlings 2009). Measurements and
    noises are made dimensionless first.

    Parameters
    ----------
    model : LinearGaussianModel
        A constant model, no measurement missing.
    structure : NoiseStructure
        What is looked for; its references are the covariances that the first gain belongs to.
    lags : int, default 15
        Number of autocovariances N, lag zero among them.
    passes : int, default 2
        How often the filter is run, each time with the gain of the estimates so far. The second innovations
        are nearly white, which is what the weights suppose.
    burn_in : int, optional
        Innovations left out at the beginning; 100, or a fifth of them if they are fewer than 500.
    weighting : {"white", "identity"}
        ``white``: inverse covariance that the autocovariances of white innovations have; ``identity``: none.
    trace_weight : float, default 0.0
        Weight of the trace of Q, by which the solution of lowest rank is found where Q is not unique.
    solver : {"CLARABEL", "SCS"}
        Conic solver.
    spend : callable, optional
        Asked with the price 1 of a pass before it is made; False ends the search.

    Returns
    -------
    AlsFit

    Raises
    ------
    UnsuitableProblem
        If the model varies, or a measurement is missing.
    InvalidInput
        If Q is not determined by the data and `trace_weight` is zero, or there are too few measurements.
    """
    require_constant(model, "als")
    one_of("weighting", weighting, ("white", "identity"))
    one_of("solver", solver, SOLVERS)
    burn_in = transient(model) if burn_in is None else at_least("burn_in", burn_in, 0)
    at_least("lags", lags, 2)
    if model.n_steps <= burn_in + 2 * lags:
        raise InvalidInput(
            "y", f"{model.n_steps} steps", f"give more than burn_in + 2 lags = {burn_in + 2 * lags} steps"
        )
    Q, R = structure.covariances(np.zeros(structure.n_parameters))
    found, misfit, rank, count, made = (Q, R), np.nan, 0, structure.process.n_parameters, 0
    for _ in range(at_least("passes", passes, 1)):
        if spend is not None and not spend(1):
            break
        made += 1
        dynamics = ErrorDynamics(model.F, model.H, model.G, steady_gain(model, Q, R))
        unknowns = _columns(structure.process)
        rank, count = uniqueness(dynamics, unknowns)
        if rank < count and trace_weight <= 0.0:
            raise InvalidInput(
                "Q",
                f"{count} unknowns of which the innovations determine {rank}",
                "ask for fewer (covariance='scalar' or 'diagonal') or give trace_weight > 0",
            )
        innovations = fixed_gain_innovations(dynamics, model.y, model.drive, model.x0)[burn_in:]
        Q, R, misfit = _solve(
            dynamics, structure, autocovariance(innovations, lags), len(innovations),
            weighting=weighting, trace_weight=trace_weight, solver=solver,
        )  # fmt: skip
        # the next gain needs covariances that are not singular
        found, (Q, R) = (Q, R), structure.covariances(structure.nearest(Q, R))
    return AlsFit(*found, misfit, rank, count, solver, made)


def _columns(part: NoisePart) -> Array:
    """What the unknowns of a part mean for its column-major vec, shape (size², k)."""
    directions = part.directions
    return np.swapaxes(directions, 1, 2).reshape(len(directions), part.size**2).T


def _solve(
    dynamics: ErrorDynamics,
    structure: NoiseStructure,
    covariances: Array,
    steps: int,
    *,
    weighting: str,
    trace_weight: float,
    solver: str,
) -> tuple[Array, Array, float]:
    """One semidefinite programme, in units in which innovations and reference are about one."""
    import cvxpy as cp

    lags, m, _ = covariances.shape
    M_Q, M_R = als_matrices(dynamics, lags)
    b = covariances.reshape(lags * m, m).ravel(order="F")
    # rows: every entry of an autocovariance over the standard deviations of its two channels
    sigma = np.sqrt(np.diag(covariances[0]))
    rows = 1.0 / np.stack([np.outer(sigma, sigma)] * lags).reshape(lags * m, m).ravel(order="F")
    whiten = np.diag(rows)
    if weighting == "white":
        whiten = _white_weights(covariances[0] / np.outer(sigma, sigma), lags, steps) * rows
    known = M_Q @ structure.process.fixed.ravel(order="F") + M_R @ structure.measurement.fixed.ravel(
        order="F"
    )
    target = whiten @ (b - known)
    terms: list[Any] = []
    variables: dict[int, tuple[Any, Array]] = {}
    parts = structure.process, structure.measurement
    for k, (part, M) in enumerate(zip(parts, (M_Q, M_R), strict=True)):
        if not part.n_parameters:
            continue
        design = whiten @ M @ _columns(part)
        # columns to about one: covariances of 1e-12 and of 1e+3 meet in one programme
        size = np.linalg.norm(design, axis=0) if part.basis is not None else _one_size(design)
        size = np.where(size > 0.0, size, 1.0)
        if part.basis is None:
            X: Any = cp.Variable((part.size, part.size), PSD=True)
            unknown: Any = cp.hstack(
                [X[int(i), int(j)] for i, j in zip(*np.tril_indices(part.size), strict=True)]
            )
        else:
            X = cp.Variable(part.n_parameters, nonneg=True)
            unknown = X
        terms.append((design / size) @ unknown)
        variables[k] = X, size
    scale = max(float(np.linalg.norm(target)), 1e-300) / np.sqrt(len(target))
    objective = cp.sum_squares((sum(terms) - target) / scale)
    if trace_weight > 0.0 and 0 in variables:
        X, size = variables[0]
        # in units of the reference: its trace over its size counts one
        trace = (
            cp.trace(X) / size[0] if structure.process.basis is None else cp.sum(cp.multiply(1.0 / size, X))
        )
        objective = objective + trace_weight / scale**2 * trace
    programme = cp.Problem(cp.Minimize(objective))
    try:
        programme.solve(solver=solver)
    except cp.error.SolverError as error:
        raise NumericalFault(f"{solver} failed on the autocovariances: {error}") from None
    if programme.status not in ("optimal", "optimal_inaccurate"):
        raise NumericalFault(f"{solver} ended with status {programme.status} on the autocovariances")
    found = [part.fixed for part in parts]
    for k, (X, size) in variables.items():
        found[k] = _matrix(parts[k], np.asarray(X.value), size)
    left = whiten @ (M_Q @ found[0].ravel(order="F") + M_R @ found[1].ravel(order="F") - b)
    return found[0], found[1], float(left @ left) / len(left)


def _one_size(design: Array) -> Array:
    """One scale for a whole matrix: its entries may not be scaled apart, or it loses its definiteness."""
    return np.full(design.shape[1], max(float(np.linalg.norm(design, axis=0).max()), 1e-300))


def _matrix(part: NoisePart, value: Array, size: Array) -> Array:
    if part.basis is not None:
        return part.fixed + np.tensordot(np.maximum(value, 0.0) / size, part.basis, axes=1)
    full = value / size[0] * np.outer(part.scale, part.scale)
    values, vectors = np.linalg.eigh(0.5 * (full + full.T))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def _white_weights(C0: Array, lags: int, steps: int) -> Array:
    """Inverse root of the covariance of the sample autocovariances of white innovations.

    Bartlett's formula with C_j = 0 for j > 0: an entry (a, b) at lag j > 0 covaries with (c, d) of the same
    lag by C0[a, c] C0[b, d] / T, at lag zero by that plus C0[a, d] C0[b, c] / T, and with nothing else. Lag
    zero is symmetric, so its covariance is singular, and the pseudo-inverse counts every entry once.
    """
    m = len(C0)
    later = np.einsum("ac,bd->abcd", C0, C0).reshape(m * m, m * m) / steps
    zero = later + np.einsum("ad,bc->abcd", C0, C0).reshape(m * m, m * m) / steps
    # position of entry (j, a, b) in the column-major vec of the stacked blocks
    place = np.arange(lags * m * m).reshape(m, lags * m).T.reshape(lags, m, m)
    out = np.zeros((lags * m * m, lags * m * m))
    for j in range(lags):
        values, vectors = np.linalg.eigh(zero if j == 0 else later)
        root = np.where(values > 1e-10 * values[-1], 1.0 / np.sqrt(np.maximum(values, 1e-300)), 0.0)
        index = place[j].ravel()
        out[np.ix_(index, index)] = (vectors * root) @ vectors.T
    return out
