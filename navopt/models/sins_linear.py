"""The linear form of paper 003's error model: how small errors move, and what white noise adds to them."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.models.cruise import CruiseScenario, InsErrors, check_times
from navopt.models.sins_error import TrueMotion, _rate

__all__ = ["draw_noise_errors", "noise_covariance", "noise_transitions"]

Array = NDArray[np.float64]


@numba.njit(cache=True)
def _linearise(lat, velocity, force, heading, depth, scale):  # pragma: no cover
    """Jacobian of `_rate` at zero error, by central differences; shape (K, 7, 7)."""
    jacobian = np.empty((len(lat), 7, 7))
    zero = np.zeros(3)
    plus, minus = np.empty(7), np.empty(7)
    for k in range(len(lat)):
        for i in range(7):
            x = np.zeros(7)
            x[i] = scale[i]
            _rate(x, lat[k], velocity[k, 0], velocity[k, 1], force[k], heading[k], depth, zero, zero, plus)
            _rate(-x, lat[k], velocity[k, 0], velocity[k, 1], force[k], heading[k], depth, zero, zero, minus)
            jacobian[k, :, i] = (plus - minus) / (2.0 * scale[i])
    return jacobian


def noise_transitions(
    scenario: CruiseScenario, times: ArrayLike, errors: InsErrors, *, longest_step: float = 60.0
) -> tuple[Array, Array]:
    """Return how small INS errors move from each time to the next, and what white noise adds on the way.

    Eq (18) linearised at zero error: x = (δL, δλ, δv_N, δv_E, α), x_k = Φ_k x_{k−1} + w_k, cov w_k = Q_k.

    Parameters
    ----------
    scenario : CruiseScenario
        The voyage.
    times : array_like, shape (N,)
        Times, s since departure; the first transition starts at departure.
    errors : InsErrors
        Only the noise levels are used.
    longest_step : float
        Longer intervals are divided, s.

    Returns
    -------
    transition : ndarray, shape (N, 7, 7)
        Φ; the identity if the first time is zero.
    covariance : ndarray, shape (N, 7, 7)
        Q.

    Raises
    ------
    InvalidInput
        If the times are not increasing or leave the voyage.
    """
    t = check_times(times, scenario.duration)
    intervals = np.diff(t, prepend=0.0)
    pieces = np.maximum(1, np.ceil(intervals / longest_step)).astype(int)
    step = np.repeat(intervals / pieces, pieces)
    middle = np.cumsum(step) - 0.5 * step
    true = TrueMotion.of(scenario, np.linspace(0.0, scenario.duration, 65))  # the force changes slowly
    force = np.stack([np.interp(middle, true.time, column) for column in true.specific_force().T], axis=-1)
    k = len(middle)
    f = _linearise(
        scenario.position(middle)[0], np.tile(scenario.velocity, (k, 1)), force,
        np.full(k, scenario.azimuth), 0.0, np.array([1e-6, 1e-6, 1e-2, 1e-2, 1e-6, 1e-6, 1e-6]),
    )  # fmt: skip
    # The same noise on each body axis is the same on each axis of n, whatever the attitude.
    density = np.diag(np.array([0.0, 0.0, *[errors.accelerometer_noise**2] * 2, *[errors.gyro_noise**2] * 3]))
    half, whole = _exponential(0.5 * step[:, None, None] * f), _exponential(step[:, None, None] * f)
    # Simpson's rule for ∫ Φ Q Φᵀ: exact for the t³/3 by which accelerometer noise reaches the position
    added = (step / 6.0)[:, None, None] * (
        density + 4.0 * half @ density @ half.transpose(0, 2, 1) + whole @ density @ whole.transpose(0, 2, 1)
    )
    transition, covariance = np.empty((len(t), 7, 7)), np.empty((len(t), 7, 7))
    ends = np.cumsum(pieces)
    for j, end in enumerate(ends):
        phi, q = np.eye(7), np.zeros((7, 7))
        for i in range(end - pieces[j], end):
            phi, q = whole[i] @ phi, whole[i] @ q @ whole[i].T + added[i]
        transition[j], covariance[j] = phi, 0.5 * (q + q.T)
    return transition, covariance


def _exponential(matrices: Array) -> Array:
    """Sum the series of the matrix exponential: errors turn by 0.07 rad in a minute, so six terms suffice."""
    result = term = np.broadcast_to(np.eye(7), matrices.shape)
    for order in range(1, 7):
        term = term @ matrices / order
        result = result + term
    return result


def noise_covariance(scenario: CruiseScenario, times: ArrayLike, errors: InsErrors) -> Array:
    """Return the joint covariance of the errors that white noise alone has caused by some times.

    Parameters
    ----------
    scenario, times, errors
        As for `noise_transitions`; N times.

    Returns
    -------
    ndarray, shape (N, 7, N, 7)
        Covariance of x at one time with x at another; x as for `noise_transitions`.

    Raises
    ------
    InvalidInput
        If the times are not increasing or leave the voyage.
    """
    transition, added = noise_transitions(scenario, times, errors)
    n = len(transition)
    joint = np.zeros((n, 7, n, 7))
    p = np.zeros((7, 7))
    for k in range(n):
        p = transition[k] @ p @ transition[k].T + added[k]
        if k:  # earlier errors reach this time through the last transition
            row = np.einsum("ij,jlm->ilm", transition[k], joint[k - 1, :, :k])
            joint[k, :, :k] = row
            joint[:k, :, k] = row.transpose(1, 2, 0)
        joint[k, :, k] = p
    return joint


def draw_noise_errors(
    scenario: CruiseScenario, times: ArrayLike, errors: InsErrors, rng: np.random.Generator
) -> Array:
    """Draw the errors that white noise alone causes, consistent over time.

    Parameters
    ----------
    scenario, times, errors
        As for `noise_transitions`; N times.
    rng : numpy.random.Generator
        7 N normal numbers are taken from it.

    Returns
    -------
    ndarray, shape (N, 7)
        x at the times.

    Raises
    ------
    InvalidInput
        If the times are not increasing or leave the voyage.
    """
    transition, added = noise_transitions(scenario, times, errors)
    # The units differ by ten orders, so the root is taken of the correlations. They are singular over a short
    # step (position follows velocity), which a Cholesky factor would not survive.
    sigma = np.sqrt(np.einsum("kii->ki", added))
    scale = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(added / (scale[:, :, None] * scale[:, None, :]))
    root = scale[:, :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    kicks = np.einsum("kij,kj->ki", root, rng.standard_normal((len(transition), 7)))
    states = np.empty_like(kicks)
    x = np.zeros(7)
    for k, kick in enumerate(kicks):
        x = transition[k] @ x + kick
        states[k] = x
    return states
