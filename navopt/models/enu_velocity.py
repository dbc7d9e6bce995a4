"""Velocity and position in east, north, up: eqs (12)-(20) and (30) of paper 000 with their signs corrected.

Printed, the Earth's rate is ``(0, w cos L, -w sin L)`` and so is the sign of the third component of the
transport rate; in a frame whose third axis points up both are positive. With them the third row of (19) is
``f_U + v_E (2 w + l') cos L + v_N L' - g``, the first and the second have ``-v_U (2 w + l') cos L`` and
``-v_U L'``, and the brackets of (20) change likewise. The printed gravity ``+g`` belongs to a third axis
pointing down.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.models.earth import EARTH_RATE, normal_gravity, principal_radii

__all__ = [
    "earth_rate_enu",
    "position_error_rate",
    "transport_rate_enu",
    "velocity_rate",
    "velocity_rate_rows",
]

Array = NDArray[np.float64]


def earth_rate_enu(latitude: ArrayLike) -> Array:
    """Return the Earth's rate ``(0, w cos L, w sin L)``, rad/s, shape (..., 3), at latitudes in rad."""
    lat = np.asarray(latitude, dtype=np.float64)
    return EARTH_RATE * np.stack([np.zeros_like(lat), np.cos(lat), np.sin(lat)], axis=-1)


def transport_rate_enu(
    velocity: ArrayLike, latitude: ArrayLike, height: ArrayLike = 0.0, *, radius: float | None = None
) -> Array:
    """Return the rate at which the frame turns on the Earth: ``(-L', l' cos L, l' sin L)``.

    Parameters
    ----------
    velocity : array_like, shape (..., 3)
        East, north, up, m/s.
    latitude, height : array_like, shape (...)
        In rad, and in m above the ellipsoid.
    radius : float, optional
        Radius of a spherical Earth, m, as in paper 000; the ellipsoid's two radii if not given.

    Returns
    -------
    ndarray, shape (..., 3)
        In rad/s.
    """
    v, lat = np.asarray(velocity, dtype=np.float64), np.asarray(latitude, dtype=np.float64)
    meridian, prime_vertical = _radii(lat, height, radius)
    east, north = v[..., 0], v[..., 1]
    return np.stack(
        np.broadcast_arrays(-north / meridian, east / prime_vertical, east * np.tan(lat) / prime_vertical),
        axis=-1,
    )


def velocity_rate(
    force: ArrayLike,
    velocity: ArrayLike,
    latitude: ArrayLike,
    height: ArrayLike = 0.0,
    *,
    gravity: ArrayLike | None = None,
    radius: float | None = None,
) -> Array:
    """Return how the velocity changes, eq. (18): ``v' = f - (2 w_ie + w_en) x v + g``.

    Parameters
    ----------
    force : array_like, shape (..., 3)
        Specific force in east, north, up (``C_b^n f^b``), m/s^2.
    velocity : array_like, shape (..., 3)
        East, north, up, m/s.
    latitude, height : array_like, shape (...)
        In rad, and in m above the ellipsoid.
    gravity : array_like, shape (...), optional
        Magnitude, m/s^2; normal gravity on the ellipsoid if not given.
    radius : float, optional
        As for `transport_rate_enu`.

    Returns
    -------
    ndarray, shape (..., 3)
        In m/s^2.
    """
    f, v = np.asarray(force, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
    turning = 2.0 * earth_rate_enu(latitude) + transport_rate_enu(v, latitude, height, radius=radius)
    rate = f - np.cross(turning, v)
    rate[..., 2] -= normal_gravity(latitude) if gravity is None else np.asarray(gravity, dtype=np.float64)
    return rate


def velocity_rate_rows(
    force: ArrayLike,
    velocity: ArrayLike,
    latitude: ArrayLike,
    height: ArrayLike = 0.0,
    *,
    gravity: ArrayLike,
    radius: float,
) -> Array:
    """Return the same on a sphere, row by row: eq. (20) with its corrected signs.

    Parameters
    ----------
    force, velocity, latitude, height, gravity, radius
        As for `velocity_rate`.

    Returns
    -------
    ndarray, shape (..., 3)
        In m/s^2.
    """
    f, v = np.asarray(force, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
    lat = np.asarray(latitude, dtype=np.float64)
    east, north, up = np.moveaxis(v, -1, 0)
    sine, cosine, tangent = np.sin(lat), np.cos(lat), np.tan(lat)
    r = radius + np.asarray(height, dtype=np.float64)
    g = np.asarray(gravity, dtype=np.float64)
    twice = 2.0 * EARTH_RATE
    return np.stack(
        [
            f[..., 0] + twice * (north * sine - up * cosine) + east * (north * tangent - up) / r,
            f[..., 1] - twice * east * sine - (up * north + east * east * tangent) / r,
            f[..., 2] + twice * east * cosine + (east * east + north * north) / r - g,
        ],
        axis=-1,
    )


def position_error_rate(
    velocity_error: ArrayLike,
    latitude_error: ArrayLike,
    velocity: ArrayLike,
    latitude: ArrayLike,
    height: ArrayLike = 0.0,
) -> tuple[Array, Array]:
    """Return how small position errors grow, eq. (30).

    The paper's text calls L the longitude and l the latitude; the equation needs it the other way round.

    Parameters
    ----------
    velocity_error : array_like, shape (..., 2) or (..., 3)
        Error of the velocity east, north (and up, which plays no part), m/s.
    latitude_error : array_like, shape (...)
        In rad.
    velocity : array_like, shape (..., 2) or (..., 3)
        East, north (and up), m/s.
    latitude, height : array_like, shape (...)
        In rad, and in m above the ellipsoid.

    Returns
    -------
    latitude_rate, longitude_rate : ndarray, shape (...)
        In rad/s.

    Notes
    -----
    As in the paper, the radii are taken to be known: their own change with latitude and height is left out,
    1e-3 and less of the terms that are here.
    """
    dv, v = np.asarray(velocity_error, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
    lat = np.asarray(latitude, dtype=np.float64)
    meridian, prime_vertical = _radii(lat, height, None)
    secant = 1.0 / np.cos(lat)
    # the second term is the same velocity on a smaller circle of latitude
    longitude = (dv[..., 0] + v[..., 0] * np.tan(lat) * np.asarray(latitude_error)) * secant / prime_vertical
    return dv[..., 1] / meridian, longitude


def _radii(latitude: Array, height: ArrayLike, radius: float | None) -> tuple[Array, Array]:
    if radius is None:
        return principal_radii(latitude, -np.asarray(height, dtype=np.float64))
    same = radius + np.asarray(height, dtype=np.float64)
    return same, same
