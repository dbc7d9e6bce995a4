"""Expectation maximisation of noise covariances with a disturbance smoother."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.noise_structure import NoisePart, NoiseStructure
from baselines.small_matrices import (
    add,
    inverse_and_log_determinant,
    product,
    product_right_turned,
    times_left_turned,
)
from navopt.errors import UnsuitableProblem
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["EmFit", "expected_noises", "fit_em"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EmFit:
    """Covariances of the noises by expectation maximisation.

    Attributes
    ----------
    Q, R : ndarray, shape (g, g) and (m, m)
        Covariances of process and measurement noise.
    log_likelihood : ndarray, shape (passes,)
        Logarithm of the likelihood before each pass; it never falls.
    passes : int
        Passes of filter and smoother.
    converged : bool
        Whether the parameters had stopped moving.
    """

    Q: Array
    R: Array
    log_likelihood: Array
    passes: int
    converged: bool


def expected_noises(model: LinearGaussianModel, Q: Array, R: Array) -> tuple[float, Array, Array]:
    """Log-likelihood, and mean second moments of the noises given all measurements.

    Parameters
    ----------
    model : LinearGaussianModel
        The model with its measurements; NaN where one is missing.
    Q, R : ndarray, shape (g, g) and (m, m)
        Covariances assumed.

    Returns
    -------
    log_likelihood : float
    process : ndarray, shape (g, g)
        Mean of E[w wᵀ | y] over the steps between measurements.
    measurement : ndarray, shape (m, m)
        Mean of E[v vᵀ | y] over the times with any measurement.

    Notes
    -----
    The disturbance smoother (Koopman 1993) gives the moments that Shumway and Stoffer (1982) take from
    smoothed states and their lag-one covariances, without inverting a covariance of states, which is
    singular where there are fewer noises than states.
    """
    steps = model.n_steps
    Q, R = np.ascontiguousarray(Q, dtype=float), np.ascontiguousarray(R, dtype=float)
    seen = np.isfinite(model.y)
    QG = Q @ np.swapaxes(model.G, -1, -2)
    F, H, W, QG = (
        np.ascontiguousarray(np.broadcast_to(M, (steps, *M.shape[-2:])))
        for M in (model.F, model.H, model.G @ QG, QG)
    )
    # a channel that is missing measures nothing
    H = H * seen[:, :, None]
    y = np.where(seen, model.y, 0.0)
    x0, P0 = np.array(model.x0), np.array(model.P0)
    value, *kept = _filter(F, H, W, np.array(model.drive), y, seen, x0, P0, R)
    process, measurement, times = _smoother(F, H, QG, seen, *kept, R)
    return float(value), Q + process / (steps - 1), R + measurement / times


def fit_em(
    model: LinearGaussianModel,
    structure: NoiseStructure,
    *,
    max_passes: int = 500,
    tolerance: float = 1e-5,
    spend: Callable[[int], bool] | None = None,
) -> EmFit:
    """Fit Q and R by expectation maximisation (Shumway and Stoffer 1982).

    Parameters
    ----------
    model : LinearGaussianModel
        The model with its measurements; NaN where one is missing.
    structure : NoiseStructure
        What is looked for; begins at its references. A variance that begins at zero stays there.
    max_passes : int, default 500
        Cap on passes.
    tolerance : float, default 1e-5
        Ends when no parameter moves by more in a pass (as a logarithm of a variance).
    spend : callable, optional
        Asked with the price of a pass (2: filter and smoother) before it is made; False ends the search.

    Returns
    -------
    EmFit

    Raises
    ------
    UnsuitableProblem
        If the structure has no closed maximisation: known parts, or weights of matrices that overlap.
    """
    for name, part in (("Q", structure.process), ("R", structure.measurement)):
        _require_blocks(name, part)
    Q, R = structure.covariances(np.zeros(structure.n_parameters))
    likelihoods: list[float] = []
    converged = False
    while len(likelihoods) < max_passes and (spend is None or spend(2)):
        value, process, measurement = expected_noises(model, Q, R)
        likelihoods.append(value)
        before = Q, R
        Q, R = _maximise(structure.process, process), _maximise(structure.measurement, measurement)
        moved = max(
            float(np.abs(new - old).max() / max(np.abs(old).max(), 1e-300))
            for new, old in zip((Q, R), before, strict=True)
        )
        if moved < tolerance:
            converged = True
            break
    return EmFit(Q, R, np.array(likelihoods), len(likelihoods), converged)


def _require_blocks(name: str, part: NoisePart) -> None:
    if part.basis is None or not len(part.basis):
        return
    if part.fixed.any():
        raise UnsuitableProblem(f"em cannot fit {name}: a part of it is known; use innovation-likelihood")
    for k, first in enumerate(part.basis):
        for other in part.basis[k + 1 :]:
            if np.abs(np.linalg.pinv(first) @ other).max() > 1e-9:
                raise UnsuitableProblem(
                    f"em cannot fit {name}: it is a sum of matrices that overlap, whose weights have no "
                    "closed maximisation; use innovation-likelihood"
                )


def _maximise(part: NoisePart, moments: Array) -> Array:
    if part.basis is None:
        return 0.5 * (moments + moments.T)
    if not len(part.basis):
        return part.fixed
    weights = [
        np.trace(np.linalg.pinv(matrix) @ moments) / np.linalg.matrix_rank(matrix) for matrix in part.basis
    ]
    return np.tensordot(np.array(weights), part.basis, axes=1)


@njit(cache=True)
def _masked(R: Array, seen: NDArray[np.bool_]) -> Array:
    """R with rows and columns of the identity where nothing is measured: no weight, no determinant."""
    out = R.copy()
    for i in range(len(seen)):
        for j in range(len(seen)):
            if not (seen[i] and seen[j]):
                out[i, j] = 1.0 if i == j else 0.0
    return out


@njit(cache=True)
def _filter(
    F: Array,
    H: Array,
    W: Array,
    drive: Array,
    y: Array,
    seen: NDArray[np.bool_],
    x0: Array,
    P0: Array,
    R: Array,
) -> tuple[float, Array, Array, Array]:
    """Log-likelihood, weighted innovations S⁻¹e, S⁻¹ and predictor gains."""
    steps, m = y.shape
    n = len(x0)
    errors, inverses, gains = np.zeros((steps, m, 1)), np.zeros((steps, m, m)), np.zeros((steps, n, m))
    x, P, value = x0.copy().reshape(n, 1), P0.copy(), 0.0
    eye, e = np.eye(n), np.zeros((m, 1))
    for k in range(steps):
        Rk, count = _masked(R, seen[k]), 0
        Hx = product(H[k], x)
        for i in range(m):
            e[i, 0] = y[k, i] - Hx[i, 0] if seen[k, i] else 0.0
            count += seen[k, i]
        PH = product_right_turned(P, H[k])
        S = product(H[k], PH)
        add(S, Rk, 1.0)
        inverse, log_determinant = inverse_and_log_determinant(S)
        weighted = product(inverse, e)
        value -= 0.5 * (count * np.log(2.0 * np.pi) + log_determinant + times_left_turned(e, weighted)[0, 0])
        K = product(PH, inverse)
        add(x, product(K, e), 1.0)
        A = product(K, H[k])
        for i in range(n):
            for j in range(n):
                A[i, j] = eye[i, j] - A[i, j]
        P = product_right_turned(product(A, P), A)
        add(P, product_right_turned(product(K, Rk), K), 1.0)
        x = product(F[k], x)
        for i in range(n):
            x[i, 0] += drive[k, i]
        P = product_right_turned(product(F[k], P), F[k])
        add(P, W[k], 1.0)
        step_gain = product(F[k], K)
        for i in range(m):
            errors[k, i, 0] = weighted[i, 0]
            for j in range(m):
                inverses[k, i, j] = inverse[i, j] if seen[k, i] and seen[k, j] else 0.0
            for j in range(n):
                gains[k, j, i] = step_gain[j, i]
    return value, errors, inverses, gains


@njit(cache=True)
def _smoother(
    F: Array,
    H: Array,
    QG: Array,
    seen: NDArray[np.bool_],
    errors: Array,
    inverses: Array,
    gains: Array,
    R: Array,
) -> tuple[Array, Array, int]:
    """Sums of what the measurements say of the noises, beyond their covariances, backwards in time."""
    steps, m, n = H.shape
    g = QG.shape[1]
    r, N = np.zeros((n, 1)), np.zeros((n, n))
    process, measurement, times = np.zeros((g, g)), np.zeros((m, m)), 0
    for k in range(steps - 1, -1, -1):
        if k < steps - 1:
            w = product(QG[k], r)
            add(process, product_right_turned(w, w), 1.0)
            add(process, product_right_turned(product(QG[k], N), QG[k]), -1.0)
        K = gains[k]
        u = errors[k].copy()
        add(u, times_left_turned(K, r), -1.0)
        if seen[k].any():
            v = product(R, u)
            add(measurement, product_right_turned(v, v), 1.0)
            D = times_left_turned(K, product(N, K))
            add(D, inverses[k], 1.0)
            add(measurement, product(product(R, D), R), -1.0)
            times += 1
        closed = F[k].copy()
        add(closed, product(K, H[k]), -1.0)
        r = times_left_turned(F[k], r)
        add(r, times_left_turned(H[k], u), 1.0)
        N = times_left_turned(closed, product(N, closed))
        add(N, times_left_turned(H[k], product(inverses[k], H[k])), 1.0)
    return process, measurement, times
