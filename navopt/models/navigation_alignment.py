"""Self-alignment: the attitude of a system at rest from its own mean readings, and the limits of that.

Axes are those of python-ins: body forward, right, down; navigation frame north, east, down. The two vectors
that a system at rest measures are gravity and the Earth's rate; whatever is wrong with the sensors is wrong
with the attitude. A system that aligns with a mis-calibrated gyro hides the gyro's error on the east axis in
its azimuth and the error then does no harm to its position: this is why alignment belongs to every navigation
test.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE, normal_gravity

__all__ = ["align", "alignment_limits", "attitude_matrix", "earth_rate_ned", "platform_angles"]

Array = NDArray[np.float64]

#: Below this part of the Earth's rate a measured horizontal rate cannot be told from nothing.
_LEAST = 1e-3


def earth_rate_ned(latitude: ArrayLike) -> Array:
    """Return the rate of the Earth in north, east, down, rad/s, shape (..., 3), at latitudes in rad."""
    lat = np.asarray(latitude, dtype=np.float64)
    return EARTH_RATE * np.stack([np.cos(lat), np.zeros_like(lat), -np.sin(lat)], axis=-1)


def attitude_matrix(heading: ArrayLike) -> Array:
    """Return C_b^n of a level vehicle, shape (..., 3, 3), from its heading in rad, clockwise from north."""
    angle = np.asarray(heading, dtype=np.float64)
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def align(gyro: ArrayLike, force: ArrayLike, latitude: float, *, method: str = "levelled") -> Array:
    """Find the attitude of a system at rest from its mean readings.

    Parameters
    ----------
    gyro : array_like, shape (..., 3)
        Mean angular rate in body axes forward, right, down, rad/s.
    force : array_like, shape (..., 3)
        Mean specific force in the same axes, m/s^2 (−g on the down axis of a level system).
    latitude : float
        Rad.
    method : {"levelled", "svd"}, keyword-only
        ``"levelled"``: down is along the measured gravity, east across it and the measured rate. This is
        where every self-alignment ends that has the time to settle. ``"svd"``: the analytic coarse alignment,
        eq (25) of Wan et al. (2020), C = [g; ω; g×ω]_n^-1 [g; ω; g×ω]_b made orthonormal by its singular
        vectors, which shares the disagreement of the two vectors between both.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        C_b^n, a rotation.

    Raises
    ------
    InvalidInput
        If a reading is not finite, gravity is not felt, or the measured rate has no horizontal part: a gyro
        whose error is larger than the Earth's rate cannot find north.
    """
    w, f = np.asarray(gyro, dtype=np.float64), np.asarray(force, dtype=np.float64)
    for name, value in (("gyro", w), ("force", f)):
        if value.shape[-1:] != (3,) or not np.isfinite(value).all():
            raise InvalidInput(name, value, "give finite readings of shape (..., 3)")
    weight = np.linalg.norm(f, axis=-1, keepdims=True)
    if (weight < 1.0).any():
        raise InvalidInput("force", float(weight.min()), "give specific force at rest, about 9.8 m/s^2")
    down = -f / weight
    east = np.cross(down, w)
    length = np.linalg.norm(east, axis=-1, keepdims=True)
    if (length < _LEAST * EARTH_RATE).any():
        raise InvalidInput(
            "gyro",
            f"a horizontal rate of {np.degrees(length.min()) * 3600.0:.3g} deg/h",
            "use gyros whose error is well below the Earth's rate, or take the heading from elsewhere",
        )
    if method == "levelled":
        east = east / length
        return np.stack([np.cross(east, down), east, down], axis=-2)
    if method != "svd":
        raise InvalidInput("method", method, 'give "levelled" or "svd"')
    rate = earth_rate_ned(latitude)
    gravity = np.array([0.0, 0.0, float(normal_gravity(latitude))])
    known = np.stack([gravity, rate, np.cross(gravity, rate)])
    measured = np.stack([-f, w, np.cross(-f, w)], axis=-2)
    # rows of one size, for conditioning; the factors cancel
    size = np.linalg.norm(known, axis=-1, keepdims=True)
    u, _, vt = np.linalg.svd(np.linalg.solve(known / size, measured / size))
    return u @ vt


def platform_angles(computed: ArrayLike, true: ArrayLike) -> Array:
    """Return by which angles the computed navigation frame is turned from the true one.

    Parameters
    ----------
    computed, true : array_like, shape (..., 3, 3)
        C_b^n as the system believes it and as it is.

    Returns
    -------
    ndarray, shape (..., 3)
        About north, east and down, rad: C_n^n' = C_x C_y C_z, for small angles I − [φ×].
    """
    c = np.asarray(computed) @ np.swapaxes(np.asarray(true), -1, -2)
    return np.stack(
        [
            np.arctan2(c[..., 1, 2], c[..., 2, 2]),
            -np.arcsin(np.clip(c[..., 0, 2], -1.0, 1.0)),
            np.arctan2(c[..., 0, 1], c[..., 0, 0]),
        ],
        axis=-1,
    )


def alignment_limits(gyro_error: ArrayLike, accelerometer_error: ArrayLike, latitude: float) -> Array:
    """Return the platform angles in which every self-alignment at rest must end, to first order.

    φ_E = −∇_N/g, φ_N = ∇_E/g, φ_U = tan L φ_N − ε_E/ω_N: gravity cannot tell a tilt from an accelerometer
    error, nor the Earth's rate an azimuth error from a drift to the east.

    Parameters
    ----------
    gyro_error, accelerometer_error : array_like, shape (..., 3)
        ε and ∇, measured minus true, in north, east, down; rad/s and m/s^2.
    latitude : float
        Rad.

    Returns
    -------
    ndarray, shape (..., 3)
        About north, east and down, rad (φ_D = −φ_U).
    """
    e, a = np.asarray(gyro_error, dtype=np.float64), np.asarray(accelerometer_error, dtype=np.float64)
    gravity = float(normal_gravity(latitude))
    north, east = a[..., 1] / gravity, -a[..., 0] / gravity
    up = np.tan(latitude) * north - e[..., 1] / (EARTH_RATE * np.cos(latitude))
    return np.stack([north, east, -up], axis=-1)
