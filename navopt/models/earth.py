"""Geometry and gravity of the WGS-84 ellipsoid, in radians and metres.

Everything here is a plain function of arrays and broadcasts over any leading axes. Angles are in
radians and longitudes positive to the east; a difference of two longitudes is taken the short way
round, so tracks may cross the date line.

Two flat geometries serve two purposes. `local_tangent_plane` fixes its scales at one reference point, so
that straight lines, rotations and covariances mean the same everywhere on a map. `separation` takes its
scales at the latitude between the two points, which is the better *distance*.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput

__all__ = [
    "ARC_MINUTE",
    "EARTH_RATE",
    "ECCENTRICITY_SQUARED",
    "GRAVITY",
    "MILLIGAL",
    "NAUTICAL_MILE",
    "SCHULER_PERIOD",
    "SEMI_MAJOR_AXIS",
    "distance",
    "local_tangent_plane",
    "normal_gravity",
    "principal_radii",
    "rhumb_line",
    "separation",
    "to_geodetic",
]

SEMI_MAJOR_AXIS: float = 6378137.0
"""Equatorial radius of WGS-84, m."""
ECCENTRICITY_SQUARED: float = 6.6943799901413e-3
"""Squared first eccentricity of WGS-84 (the digits python-ins uses, so that both agree to rounding)."""
EARTH_RATE: float = 7.292115e-5
"""Rotation rate of the Earth, rad/s."""
GRAVITY: float = 9.80665
"""Standard gravity, m/s²: the unit "g" of accelerometer data sheets (1 µg = 1e-6 of it)."""
MILLIGAL: float = 1e-5
"""One milligal, m/s²."""
NAUTICAL_MILE: float = 1852.0
"""The international nautical mile, m."""
ARC_MINUTE: float = float(np.pi / 180.0 / 60.0)
"""One minute of arc, rad."""
SCHULER_PERIOD: float = float(2.0 * np.pi * np.sqrt(6371008.8 / GRAVITY))
"""Period of a pendulum as long as the mean Earth radius, s (84.4 min): the beat of every unaided INS."""

_EQUATORIAL_GRAVITY = 9.7803253359
_POLAR_GRAVITY = 9.8321849378
_SOMIGLIANA = np.sqrt(1.0 - ECCENTRICITY_SQUARED) * _POLAR_GRAVITY / _EQUATORIAL_GRAVITY - 1.0

Array = NDArray[np.float64]


def _array(value: ArrayLike) -> Array:
    return np.asarray(value, dtype=np.float64)


def principal_radii(latitude: ArrayLike, depth: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Return the radii of curvature of the ellipsoid, reduced to a depth.

    Parameters
    ----------
    latitude : array_like
        Geodetic latitude, rad.
    depth : array_like, optional
        Depth below the ellipsoid, m, positive downwards; broadcasts with `latitude`.

    Returns
    -------
    meridian : ndarray
        R_M − h, the radius for motion to the north, m.
    prime_vertical : ndarray
        R_N − h, the radius for motion to the east (before cos L), m.

    Examples
    --------
    >>> meridian, prime_vertical = principal_radii(0.0)
    >>> float(prime_vertical)
    6378137.0
    """
    x = 1.0 - ECCENTRICITY_SQUARED * np.sin(_array(latitude)) ** 2
    prime_vertical = SEMI_MAJOR_AXIS / np.sqrt(x)
    meridian = prime_vertical * (1.0 - ECCENTRICITY_SQUARED) / x
    return meridian - _array(depth), prime_vertical - _array(depth)


def normal_gravity(latitude: ArrayLike) -> Array:
    """Return normal gravity on the ellipsoid (Somigliana).

    Parameters
    ----------
    latitude : array_like
        Geodetic latitude, rad.

    Returns
    -------
    ndarray
        Magnitude of gravity, m/s², same shape as `latitude`.
    """
    s = np.sin(_array(latitude)) ** 2
    return _EQUATORIAL_GRAVITY * (1.0 + _SOMIGLIANA * s) / np.sqrt(1.0 - ECCENTRICITY_SQUARED * s)


def _longitude_difference(longitude: ArrayLike, longitude0: ArrayLike) -> Array:
    """Difference of longitudes the short way round; exact (no rounding) when nothing wraps."""
    difference = _array(longitude) - _array(longitude0)
    return difference - 2.0 * np.pi * np.round(difference / (2.0 * np.pi))


def local_tangent_plane(
    latitude: ArrayLike, longitude: ArrayLike, latitude0: ArrayLike, longitude0: ArrayLike
) -> tuple[Array, Array]:
    """Project points onto a plane whose scales are those of one reference point.

    n = R_M(L0) (L − L0), e = R_N(L0) cos L0 (λ − λ0). The map is linear in latitude and longitude, so lines
    of the map grid stay straight and the inverse `to_geodetic` is exact. Its scale to the east is off by the
    factor cos L / cos L0 away from the reference point (0.6 % at 1° of latitude from 20° N), which cancels
    where a track and a map are projected alike.

    Parameters
    ----------
    latitude, longitude : array_like
        Points, rad; any shape.
    latitude0, longitude0 : array_like
        Reference point, rad; broadcasts with the points.

    Returns
    -------
    north, east : ndarray
        Plane coordinates, m.
    """
    meridian, prime_vertical = principal_radii(latitude0)
    north = meridian * (_array(latitude) - _array(latitude0))
    east = prime_vertical * np.cos(_array(latitude0)) * _longitude_difference(longitude, longitude0)
    return north, east


def to_geodetic(
    north: ArrayLike, east: ArrayLike, latitude0: ArrayLike, longitude0: ArrayLike
) -> tuple[Array, Array]:
    """Invert `local_tangent_plane`.

    Parameters
    ----------
    north, east : array_like
        Plane coordinates, m; any shape.
    latitude0, longitude0 : array_like
        Reference point, rad; broadcasts with the coordinates.

    Returns
    -------
    latitude, longitude : ndarray
        Points, rad. The longitude continues that of the reference point and is not wrapped.
    """
    meridian, prime_vertical = principal_radii(latitude0)
    latitude = _array(latitude0) + _array(north) / meridian
    longitude = _array(longitude0) + _array(east) / (prime_vertical * np.cos(_array(latitude0)))
    return latitude, longitude


def separation(
    latitude: ArrayLike, longitude: ArrayLike, latitude0: ArrayLike, longitude0: ArrayLike
) -> tuple[Array, Array]:
    """Return how far a point lies north and east of another, with the scales of the latitude between them.

    Parameters
    ----------
    latitude, longitude : array_like
        Points, rad.
    latitude0, longitude0 : array_like
        Points they are compared with (the truth), rad; broadcast together.

    Returns
    -------
    north, east : ndarray
        Separation, m. Its length differs from the geodesic by less than 1e-5 of itself up to 50 km apart
        (below 60° of latitude).
    """
    middle = 0.5 * (_array(latitude) + _array(latitude0))
    meridian, prime_vertical = principal_radii(middle)
    north = meridian * (_array(latitude) - _array(latitude0))
    east = prime_vertical * np.cos(middle) * _longitude_difference(longitude, longitude0)
    return north, east


def distance(latitude: ArrayLike, longitude: ArrayLike, latitude0: ArrayLike, longitude0: ArrayLike) -> Array:
    """Return the distance between points of the ellipsoid, as the length of `separation`.

    Parameters
    ----------
    latitude, longitude, latitude0, longitude0 : array_like
        Two sets of points, rad; broadcast together.

    Returns
    -------
    ndarray
        Distance, m.
    """
    return np.hypot(*separation(latitude, longitude, latitude0, longitude0))


# Sixteen nodes integrate the smooth curvature of a voyage of a thousand kilometres to rounding.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS


def rhumb_line(
    latitude0: float, longitude0: float, azimuth: float, travelled: ArrayLike
) -> tuple[Array, Array]:
    """Follow a constant azimuth from a point: the track of a ship that holds its heading.

    With ⟨·⟩ the mean over the latitudes passed, Δφ ⟨R_M⟩ = s cos A fixes the latitude (Newton) and
    Δλ = s sin A ⟨R_M / (R_N cos φ)⟩ / ⟨R_M⟩ the longitude: no cancellation on any azimuth, due east included.

    Parameters
    ----------
    latitude0, longitude0 : float
        Start, rad.
    azimuth : float
        Clockwise from north, rad.
    travelled : array_like
        Distance travelled along the line, m; any shape.

    Returns
    -------
    latitude, longitude : ndarray
        Points, rad, same shape as `travelled`. Accurate to 1e-6 m for voyages of a thousand kilometres that
        stay below 80° of latitude.

    Raises
    ------
    InvalidInput
        If the line would come within about 1° of a pole, where it winds without end.

    Examples
    --------
    >>> latitude, longitude = rhumb_line(0.0, 0.0, np.pi / 2, 6378137.0)
    >>> float(latitude), round(float(longitude), 12)
    (0.0, 1.0)
    """
    s = _array(travelled)
    northward = s * np.cos(azimuth) if abs(np.cos(azimuth)) > 1e-15 else np.zeros_like(s)
    step = northward / principal_radii(latitude0)[0]
    for _ in range(4):  # quadratic from a start that is good to 1 %: rounding after three
        mean_meridian = principal_radii(latitude0 + step[..., None] * _NODES)[0] @ _WEIGHTS
        residual = step * mean_meridian - northward
        step = step - residual / principal_radii(latitude0 + step)[0]
    latitude = latitude0 + step
    if not np.all(np.abs(latitude) < 0.5 * np.pi - 0.0175):
        raise InvalidInput("travelled", s, "stay more than 1° of latitude from the poles")
    passed = latitude0 + step[..., None] * _NODES
    meridian, prime_vertical = principal_radii(passed)
    ratio = (meridian / (prime_vertical * np.cos(passed))) @ _WEIGHTS / (meridian @ _WEIGHTS)
    return latitude, longitude0 + s * np.sin(azimuth) * ratio
