"""Navigation errors of many runs at once: the linear error model, forced by the errors of the sensors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np
from numpy.typing import NDArray

from navopt.models.earth import EARTH_RATE, normal_gravity, principal_radii
from navopt.models.navigation_alignment import attitude_matrix
from navopt.models.navigation_scenarios import NavigationScenario
from navopt.models.paths import Path
from navopt.models.sins_linear import _exponential, _linearise
from navopt.models.track_error_steps import _inputs

__all__ = ["SWAP", "ErrorSteps", "error_steps", "propagate"]

Array = NDArray[np.float64]

#: From right, forward, up (the axes of the triads) to forward, right, down (python-ins) and back.
SWAP: Array = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
SWAP.setflags(write=False)


@dataclass(frozen=True)
class ErrorSteps:
    """How errors move along a journey in K steps, and what the sensors should have read.

    Attributes
    ----------
    time : ndarray, shape (K + 1,)
        Seconds since departure.
    transition : ndarray, shape (K, 7, 7)
        Of latitude, longitude (rad), velocity north, east (m/s), platform angles (rad).
    forcing : ndarray, shape (K, 7, 6)
        What a unit of each sensor error (gyros, accelerometers; forward, right, down) adds in a step.
    readings : ndarray, shape (K, 6)
        True rates and specific forces in the axes of the triads, averaged over each step.
    start : ndarray, shape (6,)
        The same at rest, before departure.
    scale : ndarray, shape (K + 1, 2)
        Metres per radian of latitude and of longitude.
    heading : float
        At departure, rad.
    """

    time: Array
    transition: Array
    forcing: Array
    readings: Array
    start: Array
    scale: Array
    heading: float


def _moved(path: Path, count: int) -> tuple[Array, ...]:
    """Means over each of the steps: latitude, velocity, heading, acceleration, rate of turning."""
    fine = (len(path.time) - 1) // count
    step = float(path.time[fine] - path.time[0])

    def mean(values: Array) -> Array:
        # trapezoidal rule over the samples of a step, its ends included
        between = 0.5 * (values[1:] + values[:-1])
        return between.reshape(count, fine, *values.shape[1:]).mean(axis=1)

    coarse = slice(None, None, fine)
    acceleration = np.diff(path.velocity[coarse], axis=0) / step
    turning = np.diff(path.heading[coarse]) / step
    return mean(path.latitude), mean(path.velocity), mean(path.heading), acceleration, turning


def _specific_force(lat: Array, velocity: Array, acceleration: Array) -> Array:
    """Specific force v' + (2 ω_ie + ω_en) × v − g in north, east, down; the vertical velocity is zero."""
    meridian, prime_vertical = principal_radii(lat)
    north, east = velocity.T
    sine, cosine = np.sin(lat), np.cos(lat)
    w_north = 2.0 * EARTH_RATE * cosine + east / prime_vertical
    w_east = -north / meridian
    w_down = -2.0 * EARTH_RATE * sine - east * sine / cosine / prime_vertical
    return np.stack(
        [
            acceleration[:, 0] - w_down * east,
            acceleration[:, 1] + w_down * north,
            w_north * east - w_east * north - normal_gravity(lat),
        ],
        axis=-1,
    )


def _body_rate(lat: Array, velocity: Array, turning: Array, to_body: Array) -> Array:
    """Rate of the body against inertial space, in body axes forward, right, down."""
    meridian, prime_vertical = principal_radii(lat)
    north, east = velocity.T
    in_n = np.stack(
        [
            EARTH_RATE * np.cos(lat) + east / prime_vertical,
            -north / meridian,
            -EARTH_RATE * np.sin(lat) - east * np.tan(lat) / prime_vertical,
        ],
        axis=-1,
    )
    rate = np.einsum("kij,kj->ki", to_body, in_n)
    rate[:, 2] += turning
    return rate


@lru_cache(maxsize=8)
def error_steps(scenario: NavigationScenario) -> ErrorSteps:
    """Prepare a journey; the last few are kept.

    Parameters
    ----------
    scenario : NavigationScenario
        The journey.

    Returns
    -------
    ErrorSteps

    Raises
    ------
    InvalidInput
        If it turns faster than its gyros can measure.

    Notes
    -----
    Eq (18) of Dai et al. (2019) linearised about the true motion in the middle of each step, the vertical
    channel held; exponentials to the sixth order.
    """
    path, count = scenario.path(), scenario.steps
    lat, velocity, heading, acceleration, turning = _moved(path, count)
    to_body = np.swapaxes(attitude_matrix(heading), -1, -2)
    force = _specific_force(lat, velocity, acceleration)
    rate = _body_rate(lat, velocity, turning, to_body)
    readings = np.concatenate([rate @ SWAP, np.einsum("kij,kj->ki", to_body, force) @ SWAP], axis=-1)
    scenario.check_range(rate)
    still = path.latitude[:1], np.zeros((1, 2))
    facing = np.swapaxes(attitude_matrix(path.heading[:1]), -1, -2)
    start = np.concatenate(
        [
            _body_rate(*still, np.zeros(1), facing)[0] @ SWAP,
            facing[0] @ _specific_force(*still, np.zeros((1, 2)))[0] @ SWAP,
        ]
    )
    scales = np.array([1e-6, 1e-6, 1e-2, 1e-2, 1e-6, 1e-6, 1e-6])
    rates = _linearise(lat, velocity, force, heading, 0.0, scales)
    inputs = np.empty((count, 7, 6))
    _inputs(lat, velocity, force, heading, inputs)
    step = scenario.step_s
    transition, integral = _exponential(step * rates), _integral(step * rates)
    coarse = slice(None, None, scenario.substeps)
    at = path.latitude[coarse]
    meridian, prime_vertical = principal_radii(at)
    return ErrorSteps(
        time=path.time[coarse],
        transition=np.ascontiguousarray(transition),
        forcing=np.ascontiguousarray(step * integral @ inputs),
        readings=readings,
        start=start,
        scale=np.stack([meridian, prime_vertical * np.cos(at)], axis=-1),
        heading=float(path.heading[0]),
    )


def _integral(matrices: Array) -> Array:
    """Σ M^k / (k + 1)!: what a constant input has added at the end of a step, per unit and second."""
    result = term = np.broadcast_to(np.eye(7), matrices.shape)
    for order in range(1, 7):
        term = term @ matrices / (order + 1)
        result = result + term
    return result


@numba.njit(cache=True)
def _march(transition, forcing, errors, state, out):  # pragma: no cover
    """Carry the columns of `state` (7, W) through all steps; out (K + 1, 2, W) takes the position angles."""
    n_steps, n_worlds = len(transition), state.shape[1]
    moved = np.empty(7)
    out[0] = state[:2]
    for k in range(n_steps):
        for w in range(n_worlds):
            for i in range(7):
                total = 0.0
                for j in range(7):
                    total += transition[k, i, j] * state[j, w]
                for j in range(6):
                    total += forcing[k, i, j] * errors[k, j, w]
                moved[i] = total
            state[:, w] = moved
        out[k + 1] = state[:2]


def propagate(steps: ErrorSteps, errors: Array, angles: Array) -> Array:
    """Return the position errors of W runs.

    Parameters
    ----------
    steps : ErrorSteps
        The journey.
    errors : ndarray, shape (W, K, 6)
        Errors of the sensors in the axes of the triads, averaged over each step.
    angles : ndarray, shape (W, 3)
        Platform angles at departure, rad.

    Returns
    -------
    ndarray, shape (W, K + 1, 2)
        North and east, m.
    """
    turned = np.concatenate([errors[..., :3] @ SWAP, errors[..., 3:] @ SWAP], axis=-1)
    state = np.zeros((7, len(angles)))
    state[4:] = angles.T
    out = np.empty((len(steps.time), 2, len(angles)))
    _march(steps.transition, steps.forcing, np.ascontiguousarray(np.moveaxis(turned, 0, -1)), state, out)
    return np.moveaxis(out, -1, 0) * steps.scale
