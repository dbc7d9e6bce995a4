"""How the errors of an INS move along a track, step by step: the inside of `navopt.models.track_errors`."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from navopt.models.earth import principal_radii
from navopt.models.sins_error import TrueMotion, _rate
from navopt.models.sins_linear import _linearise

__all__ = ["ErrorGrid", "course_over_ground"]

Array = NDArray[np.float64]

#: Longest step of the integration, s: the Schuler phase turns by 0.19 rad in it.
LONGEST_STEP = 150.0


@numba.njit(cache=True)
def _inputs(lat, velocity, force, heading, out):  # pragma: no cover
    """Rate of the seven states per unit of the six sensor errors, which are linear in eq. (18); (K, 7, 6)."""
    zero, none, unit = np.zeros(7), np.zeros(3), np.zeros(3)
    base, rate = np.empty(7), np.empty(7)
    for k in range(len(lat)):
        _rate(zero, lat[k], velocity[k, 0], velocity[k, 1], force[k], heading[k], 0.0, none, none, base)
        for i in range(6):
            unit[i % 3] = 1.0
            gyro, accelerometer = (unit, none) if i < 3 else (none, unit)
            _rate(
                zero, lat[k], velocity[k, 0], velocity[k, 1], force[k], heading[k], 0.0,
                gyro, accelerometer, rate,
            )  # fmt: skip
            unit[i % 3] = 0.0
            for j in range(7):
                out[k, j, i] = rate[j] - base[j]


@numba.njit(cache=True)
def _propagate(transition, forcing, block, sample, state, constant, noise, out):  # pragma: no cover
    """Carry every column through the steps; `block` of each step, `sample` it ends at or -1.

    Columns of `state` (7, C): sensor biases (as `constant`, (C,): sensor of the column or -1), initial
    errors, then five channels of noise for each block, `noise` being the first of these.
    """
    n_columns = state.shape[1]
    moved = np.empty(7)
    for k in range(len(block)):
        # the noise of blocks to come has done nothing yet
        last = min(n_columns, noise + 5 * (block[k] + 1))
        for c in range(last):
            for i in range(7):
                total = 0.0
                for j in range(7):
                    total += transition[k, i, j] * state[j, c]
                moved[i] = total
            sensor = constant[c]
            if c >= noise and (c - noise) // 5 == block[k]:
                sensor = (c - noise) % 5
            for i in range(7):
                state[i, c] = moved[i] + (forcing[k, i, sensor] if sensor >= 0 else 0.0)
        if sample[k] >= 0:
            out[sample[k]] = state


def course_over_ground(
    time: Array, latitude: Array, longitude: Array, heading: Array | None = None
) -> tuple[Array, Array]:
    """Return velocity and course at the samples of a track, from the differences of its positions.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Seconds, increasing.
    latitude, longitude : ndarray, shape (N,)
        Positions, rad; longitudes without jumps.
    heading : ndarray, shape (N,), optional
        Returned, without jumps, instead of the course.

    Returns
    -------
    velocity : ndarray, shape (N, 2)
        North and east, m/s: between two samples the mean, at a sample interpolated.
    course : ndarray, shape (N,)
        Clockwise from north, rad, without jumps.
    """
    step, middle = np.diff(time), 0.5 * (time[1:] + time[:-1])
    between = 0.5 * (latitude[1:] + latitude[:-1])
    meridian, prime_vertical = principal_radii(between)
    velocity = np.stack(
        [meridian * np.diff(latitude), prime_vertical * np.cos(between) * np.diff(longitude)], axis=-1
    )
    velocity /= step[:, None]
    at = np.stack([np.interp(time, middle, column) for column in velocity.T], axis=-1)
    if heading is None:
        heading = np.unwrap(np.arctan2(at[:, 1], at[:, 0]))
    return at, np.unwrap(heading)


@dataclass(frozen=True)
class ErrorGrid:
    """Steps of the integration: which sample each ends at, and how the errors of an INS move in it.

    Attributes
    ----------
    time : ndarray, shape (N,)
        The samples, s.
    middle : ndarray, shape (K,)
        Middle of each step, s.
    sample : ndarray, shape (K,)
        Sample at which a step ends, or -1.
    transition : ndarray, shape (K, 7, 7)
        What becomes of δL, δλ, δv_N, δv_E, α in a step.
    forcing : ndarray, shape (K, 7, 6)
        What a unit of each sensor error (three gyros, three accelerometers) adds in a step.
    course : float
        Heading of the forward axis at the first sample, rad.
    departure : float
        Where the first step begins, s.
    """

    time: Array
    middle: Array
    sample: NDArray[np.int64]
    transition: Array
    forcing: Array
    course: float
    departure: float

    @classmethod
    def of(cls, t: Array, lat: Array, lon: Array, heading: Array | None, start: float) -> ErrorGrid:
        """Divide a track into steps; arrays as for `track_errors.track_error_basis`, departure at `start`."""
        velocity, course = course_over_ground(t, lat, lon, heading)
        ends = np.concatenate([[start], t]) if start < t[0] else t
        pieces = np.maximum(1, np.ceil(np.diff(ends) / LONGEST_STEP).astype(int))
        step = np.repeat(np.diff(ends) / pieces, pieces)
        middle = start + np.cumsum(step) - 0.5 * step
        sample = np.full(len(step), -1)
        sample[np.cumsum(pieces) - 1] = np.arange(len(ends) - 1) + (len(t) - len(ends) + 1)
        transition, forcing = _transitions(t, lat, velocity, course, step, middle)
        return cls(t, middle, sample, transition, forcing, float(course[0]), start)

    def respond(
        self, state: Array, sensors: NDArray[np.int64], block: NDArray[np.int64], noise: int
    ) -> Array:
        """Errors of (latitude, longitude, velocity north, east, heading) at the samples, (N, 5, columns)."""
        out = np.empty((len(self.time), 7, state.shape[1]))
        out[0] = state  # overwritten if the first sample comes after the departure
        _propagate(self.transition, self.forcing, block, self.sample, state, sensors, noise, out)
        # the platform turns against the heading it shows
        out[:, 6] *= -1.0
        return out[:, [0, 1, 2, 3, 6]]


def _transitions(
    t: Array, lat: Array, velocity: Array, course: Array, step: Array, middle: Array
) -> tuple[Array, Array]:
    """Exponential of the rate matrix over each step, and what a unit of each sensor error adds in it."""
    even = np.linspace(t[0], t[-1], max(2, int(np.ceil((t[-1] - t[0]) / LONGEST_STEP)) + 1))
    moving = TrueMotion(
        time=even,
        latitude=np.interp(even, t, lat),
        velocity=np.stack([np.interp(even, t, column) for column in velocity.T], axis=-1),
        heading=np.interp(even, t, course),
    )
    force = np.stack([np.interp(middle, even, column) for column in moving.specific_force().T], axis=-1)
    at = np.interp(middle, t, lat)
    speed = np.stack([np.interp(middle, t, column) for column in velocity.T], axis=-1)
    ahead = np.interp(middle, t, course)
    scale = np.array([1e-6, 1e-6, 1e-2, 1e-2, 1e-6, 1e-6, 1e-6])
    rates = _linearise(at, speed, force, ahead, 0.0, scale)
    inputs = np.empty((len(step), 7, 6))
    _inputs(at, speed, force, ahead, inputs)
    # Σ (F h)^k / k! and h Σ (F h)^k / (k + 1)!, to the sixth order as in the covariance model
    scaled = step[:, None, None] * rates
    transition = integral = term = np.broadcast_to(np.eye(7), rates.shape)
    for order in range(1, 7):
        term = term @ scaled / order
        transition = transition + term
        integral = integral + term / (order + 1)
    return np.ascontiguousarray(transition), np.ascontiguousarray(step[:, None, None] * integral @ inputs)
