"""A strapdown system that is told that it rests: its position is held, its velocity and attitude run freely.

python-ins moves the position with the computed velocity, which is right for a vehicle and wrong for an
alignment of many minutes with a low-cost unit: uncorrected, 0.01 deg/s of gyro bias lets a system that
stands still compute a kilometre per second. Here the latitude stays, and the transport rate, which belongs to
a velocity that is known to be false, is left out unless it is asked for. The steps are otherwise those of
python-ins, with the same corrections for coning and sculling, and the tests compare the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.azimuth_error import azimuth_constants
from navopt.models.readings import checked_readings
from navopt.models.static_alignment import StaticSite

__all__ = ["RestingRun", "resting_strapdown"]

Array = NDArray[np.float64]

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@dataclass(frozen=True)
class RestingRun:
    """What a system that is told that it rests computes.

    Attributes
    ----------
    velocity : ndarray, shape (T + 1, 2)
        East and north, m/s, at the start and after each step.
    attitude : ndarray, shape (T + 1, 3, 3)
        C_b^n' at the same times.
    constants : ndarray, shape (T, 22)
        Inputs of each step for `navopt.models.azimuth_error.advance`.
    """

    velocity: Array
    attitude: Array
    constants: Array


@_compiled
def _turn(x, y, z, m, out):
    """Write ``exp([v x]) m`` into `out`."""
    square = x * x + y * y + z * z
    if square > 1e-6:
        angle = math.sqrt(square)
        a, b, c = math.cos(angle), math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    else:
        a = 1.0 - square / 2.0 + square * square / 24.0
        b = 1.0 - square / 6.0 + square * square / 120.0
        c = 0.5 - square / 24.0 + square * square / 720.0
    for k in range(3):
        p, q, r = m[0, k], m[1, k], m[2, k]
        along = c * (x * p + y * q + z * r)
        out[0, k] = a * p + b * (y * r - z * q) + along * x
        out[1, k] = a * q + b * (z * p - x * r) + along * y
        out[2, k] = a * r + b * (x * q - y * p) + along * z


@_compiled
def _integrate(gyro, force, dt, earth, every, velocity, attitude, middle, push, rate):
    """Fill the arrays of a run; `earth` is the first four of the inputs of the error model."""
    rn, ru, curvature, tangent = earth[0], earth[1], earth[2], earth[3]
    # the transpose of the attitude is turned, so that both frames turn columns
    m, h = attitude[0].copy(), np.empty((3, 3))
    t, u = np.empty((3, 3)), np.empty((3, 3))
    ve, vn = velocity[0, 0], velocity[0, 1]
    for block in range(len(push)):
        for k in range(3):
            push[block, k] = rate[block, k] = 0.0
        for j in range(every):
            i = block * every + j
            before = i - 1 if i > 0 else 0
            w0, w1, w2 = gyro[i, 0] * dt, gyro[i, 1] * dt, gyro[i, 2] * dt
            f0, f1, f2 = force[i, 0] * dt, force[i, 1] * dt, force[i, 2] * dt
            a0, a1, a2 = gyro[before, 0] * dt, gyro[before, 1] * dt, gyro[before, 2] * dt
            b0, b1, b2 = force[before, 0] * dt, force[before, 1] * dt, force[before, 2] * dt
            # rotation vector with coning, velocity with sculling and the turn since the start of the step
            x = w0 + (a1 * w2 - a2 * w1) / 12.0
            y = w1 + (a2 * w0 - a0 * w2) / 12.0
            z = w2 + (a0 * w1 - a1 * w0) / 12.0
            d0 = f0 + (a1 * f2 - a2 * f1 + b1 * w2 - b2 * w1) / 12.0 + 0.5 * (w1 * f2 - w2 * f1)
            d1 = f1 + (a2 * f0 - a0 * f2 + b2 * w0 - b0 * w2) / 12.0 + 0.5 * (w2 * f0 - w0 * f2)
            d2 = f2 + (a0 * f1 - a1 * f0 + b0 * w1 - b1 * w0) / 12.0 + 0.5 * (w0 * f1 - w1 * f0)
            e = m[0, 0] * d0 + m[0, 1] * d1 + m[0, 2] * d2
            n = m[1, 0] * d0 + m[1, 1] * d1 + m[1, 2] * d2
            up = m[2, 0] * d0 + m[2, 1] * d1 + m[2, 2] * d2
            s0, s1, s2 = -curvature * vn, rn + curvature * ve, ru + curvature * tangent * ve
            e, n, up = (
                e - 0.5 * dt * (s1 * up - s2 * n),
                n - 0.5 * dt * (s2 * e - s0 * up),
                up - 0.5 * dt * (s0 * n - s1 * e),
            )
            push[block, 0] += e
            push[block, 1] += n
            push[block, 2] += up
            coriolis = 2.0 * ru + curvature * tangent * ve
            later_e, later_n = ve + e + coriolis * vn * dt, vn + n - coriolis * ve * dt
            me, mn = 0.5 * (ve + later_e), 0.5 * (vn + later_n)
            ve, vn = later_e, later_n
            s0, s1, s2 = (
                -curvature * mn * dt,
                (rn + curvature * me) * dt,
                (ru + curvature * tangent * me) * dt,
            )
            # exp(-s) C exp(theta): columns of the transpose are turned by -theta
            for p in range(3):
                for q in range(3):
                    t[p, q] = m[q, p]
            _turn(-0.5 * x, -0.5 * y, -0.5 * z, t, u)
            for p in range(3):
                for q in range(3):
                    t[p, q] = u[q, p]
            if 2 * j == every:
                middle[block] = m
            _turn(-0.5 * s0, -0.5 * s1, -0.5 * s2, t, h)
            if 2 * j + 1 == every:
                middle[block] = h
            for k in range(3):
                rate[block, k] += h[k, 0] * x + h[k, 1] * y + h[k, 2] * z
            for p in range(3):
                for q in range(3):
                    t[p, q] = u[p, q]
            _turn(-0.5 * x, -0.5 * y, -0.5 * z, t, u)
            for p in range(3):
                for q in range(3):
                    t[p, q] = u[q, p]
            _turn(-s0, -s1, -s2, t, m)
        for k in range(3):
            push[block, k] /= every * dt
            rate[block, k] /= every * dt
        velocity[block + 1, 0], velocity[block + 1, 1] = ve, vn
        attitude[block + 1] = m


def resting_strapdown(
    gyro: ArrayLike,
    accelerometer: ArrayLike,
    step: float,
    site: StaticSite,
    attitude: ArrayLike,
    *,
    every: int = 1,
    transport: bool = False,
    small_levels: bool = False,
) -> RestingRun:
    """Integrate readings with the position held.

    Parameters
    ----------
    gyro, accelerometer : array_like, shape (N, 3)
        Angular rate and specific force in axes right, forward, up, means over each step, rad/s and m/s^2.
    step : float
        Time between two readings, s.
    site : StaticSite
        Where the system stands.
    attitude : array_like, shape (3, 3)
        C_b^n' at the start.
    every : int
        How many readings make a step of the result. Integration is at the full rate; the inputs of
        the error model are means over the longer steps.
    transport : bool
        Whether the transport rate of the computed velocity is added to that of the frame.
    small_levels : bool
        Form of the error model in the inputs, see `navopt.models.azimuth_error.azimuth_constants`.

    Returns
    -------
    RestingRun
        Of ``T = N // every`` steps.

    Raises
    ------
    InvalidInput
        If the readings are no finite arrays of one shape (N, 3), or the step is not positive.
    """
    w, f = checked_readings(gyro, accelerometer, step)
    if isinstance(every, bool) or not isinstance(every, int | np.integer) or not 1 <= every <= len(w):
        raise InvalidInput("every", every, f"give an integer from 1 to the {len(w)} readings")
    count = len(w) // int(every)
    start = np.ascontiguousarray(attitude, dtype=np.float64)
    earth = azimuth_constants(site, start, transport=transport)[:4].copy()
    velocity, attitudes = np.zeros((count + 1, 2)), np.empty((count + 1, 3, 3))
    attitudes[0] = start
    middle, push, rate = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3))
    _integrate(w, f, float(step), earth, int(every), velocity, attitudes, middle, push, rate)
    # a nose that points up has no heading, and the error model no inputs
    constants = azimuth_constants(
        site, middle, force=push, rate=rate, transport=transport, small_levels=small_levels
    )
    return RestingRun(velocity, attitudes, constants)
