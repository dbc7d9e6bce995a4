"""Stationary positions of a sensor block, the rates and forces it feels there, and turntable rates.

An attitude is the matrix C that takes a vector from navigation axes (east, north, up) to body axes; its
rows are the body axes, written in east, north and up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE, normal_gravity
from navopt.problem import stream

__all__ = [
    "attitude_from_euler",
    "check_attitudes",
    "earth_rate",
    "positions_of",
    "rate_positions",
    "scattered_positions",
    "six_positions",
    "specific_force",
    "twenty_four_positions",
]

Array = NDArray[np.float64]


def attitude_from_euler(heading: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> Array:
    """Return the attitude of a vehicle whose body axes are right, forward and up.

    Parameters
    ----------
    heading : array_like
        Clockwise from north, rad.
    pitch : array_like
        Nose up, rad.
    roll : array_like
        Right side down, rad. All three broadcast.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        From (east, north, up) to body. The vehicle turns by heading, then pitch, then roll.
    """
    psi, theta, phi = np.broadcast_arrays(
        *(np.asarray(angle, dtype=np.float64) for angle in (heading, pitch, roll))
    )
    one, zero = np.ones_like(psi), np.zeros_like(psi)
    turn = _matrix([[np.cos(psi), -np.sin(psi), zero], [np.sin(psi), np.cos(psi), zero], [zero, zero, one]])
    tilt = _matrix(
        [[one, zero, zero], [zero, np.cos(theta), np.sin(theta)], [zero, -np.sin(theta), np.cos(theta)]]
    )
    bank = _matrix([[np.cos(phi), zero, -np.sin(phi)], [zero, one, zero], [np.sin(phi), zero, np.cos(phi)]])
    return bank @ tilt @ turn


def _matrix(rows: list[list[Array]]) -> Array:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _faces() -> list[tuple[int, float]]:
    return [(axis, sign) for axis in range(3) for sign in (1.0, -1.0)]


def _face_up(axis: int, sign: float, azimuth: float) -> Array:
    """Attitude with a body axis up (sign +1) or down, its neighbour turned by `azimuth` from north."""
    attitude = np.empty((3, 3))
    attitude[axis] = [0.0, 0.0, sign]
    # the next axis lies where it does with the other face up, so that a pair differs along one axis only
    attitude[(axis + 1) % 3] = [np.sin(azimuth), np.cos(azimuth), 0.0]
    attitude[(axis + 2) % 3] = np.cross(attitude[axis], attitude[(axis + 1) % 3])
    return attitude


def six_positions(azimuth: float = 0.0) -> Array:
    """Return each body axis up and down once.

    Parameters
    ----------
    azimuth : float
        Direction of the horizontal axis that follows the vertical one (y after x), clockwise from north,
        rad. With zero it lies north in both positions of a pair, and the pair's Earth rates differ
        along the vertical axis only.

    Returns
    -------
    ndarray, shape (6, 3, 3)
        x up, x down, y up, y down, z up, z down.
    """
    return np.stack([_face_up(axis, sign, float(azimuth)) for axis, sign in _faces()])


def twenty_four_positions(azimuth: float = 0.0) -> Array:
    """Return the six faces up, each at four azimuths: the 24-position method of a levelled table.

    Parameters
    ----------
    azimuth : float
        The first of the four azimuths, rad.

    Returns
    -------
    ndarray, shape (24, 3, 3)
        Face by face as in `six_positions`, each with azimuths in steps of 90°.

    Notes
    -----
    With A the rows (ω_x, ω_y, ω_z, 1), AᵀA is diagonal with 8 Ω² for each axis and 24.
    """
    turns = float(azimuth) + np.radians([0.0, 90.0, 180.0, 270.0])
    return np.stack([_face_up(axis, sign, float(turn)) for axis, sign in _faces() for turn in turns])


def scattered_positions(n: int, seed: int = 0) -> Array:
    """Return attitudes drawn uniformly from all rotations, as a block put down anyhow.

    Parameters
    ----------
    n : int
        Number of positions, at least 1.
    seed : int
        Seed of the draw.

    Returns
    -------
    ndarray, shape (n, 3, 3)

    Raises
    ------
    InvalidInput
        If `n` or `seed` cannot be used.
    """
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 1:
        raise InvalidInput("n", n, "give the number of positions, at least 1")
    w, x, y, z = _unit(stream("positions", seed).standard_normal((int(n), 4))).T
    return _matrix(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _unit(quaternions: Array) -> Array:
    return quaternions / np.sqrt(np.sum(quaternions**2, axis=-1, keepdims=True))


def positions_of(positions: int | ArrayLike, seed: int = 0) -> Array:
    """Return attitudes from a number: the six or the 24 of a table, any other number scattered.

    Parameters
    ----------
    positions : int or array_like, shape (n, 3, 3)
        How many; or the attitudes themselves, which are checked.
    seed : int
        Seed for scattered ones.

    Returns
    -------
    ndarray, shape (n, 3, 3)
    """
    if isinstance(positions, int | np.integer) and not isinstance(positions, bool):
        if positions == 6:
            return six_positions()
        return twenty_four_positions() if positions == 24 else scattered_positions(int(positions), seed)
    return check_attitudes(positions)


def check_attitudes(attitudes: ArrayLike) -> Array:
    """Return attitudes as an array after checking that they are rotations.

    Parameters
    ----------
    attitudes : array_like, shape (..., 3, 3)
        From navigation (east, north, up) to body axes.

    Returns
    -------
    ndarray, shape (..., 3, 3)

    Raises
    ------
    InvalidInput
        If the shape is wrong, or a matrix is not orthonormal to 1e-6 or a mirror image.
    """
    try:
        c = np.asarray(attitudes, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInput("attitudes", attitudes, "give numbers of shape (n, 3, 3)") from None
    if c.ndim < 2 or c.shape[-2:] != (3, 3):
        raise InvalidInput("attitudes", c.shape, "give rotation matrices, shape (n, 3, 3)")
    wrong = ~(np.abs(c @ np.swapaxes(c, -1, -2) - np.eye(3)).max(axis=(-2, -1)) < 1e-6)
    wrong |= ~(np.linalg.det(np.where(np.isfinite(c), c, 0.0)) > 0.0)
    if wrong.any():
        raise InvalidInput(
            "attitudes",
            f"matrix {int(np.flatnonzero(wrong)[0])} is no rotation",
            "give orthonormal matrices of determinant +1, from (east, north, up) to body axes",
        )
    return c


def earth_rate(attitudes: ArrayLike, latitude: float) -> Array:
    """Return the rate of the Earth in body axes.

    Parameters
    ----------
    attitudes : array_like, shape (..., 3, 3)
        From (east, north, up) to body.
    latitude : float
        rad.

    Returns
    -------
    ndarray, shape (..., 3)
        rad/s; its norm is the Earth rate everywhere.
    """
    lat = _latitude(latitude)
    return check_attitudes(attitudes) @ (EARTH_RATE * np.array([0.0, np.cos(lat), np.sin(lat)]))


def specific_force(attitudes: ArrayLike, latitude: float) -> Array:
    """Return what ideal accelerometers at rest measure: gravity, upwards.

    Parameters
    ----------
    attitudes : array_like, shape (..., 3, 3)
        From (east, north, up) to body.
    latitude : float
        rad.

    Returns
    -------
    ndarray, shape (..., 3)
        m/s²; normal gravity on the ellipsoid.
    """
    gravity = float(normal_gravity(_latitude(latitude)))
    return check_attitudes(attitudes) @ np.array([0.0, 0.0, gravity])


def rate_positions(rates_rad_s: ArrayLike, latitude: float | None = None) -> Array:
    """Return the mean rates while a table turns each body axis, held vertical, at given rates.

    Over whole turns the horizontal part of the Earth rate averages to zero; the vertical part stays.

    Parameters
    ----------
    rates_rad_s : array_like, shape (k,) or float
        Rates of the table, rad/s; each is run in both directions.
    latitude : float, optional
        rad; without it the vertical part of the Earth rate is left out.

    Returns
    -------
    ndarray, shape (6 k, 3)
        Axis by axis, rate by rate, positive before negative.

    Raises
    ------
    InvalidInput
        If a rate is not positive and finite.
    """
    rates = np.atleast_1d(np.asarray(rates_rad_s, dtype=np.float64))
    if rates.ndim != 1 or not rates.size or not (np.isfinite(rates) & (rates > 0.0)).all():
        raise InvalidInput("rates_rad_s", rates.tolist(), "give positive rates; both directions are run")
    vertical = 0.0 if latitude is None else EARTH_RATE * np.sin(_latitude(latitude))
    return np.concatenate(
        [
            (sign * rate + vertical) * np.eye(3)[[axis]]
            for axis in range(3)
            for rate in rates
            for sign in (1, -1)
        ]
    )


def _latitude(latitude: float) -> float:
    number = isinstance(latitude, int | float | np.number) and not isinstance(latitude, bool)
    if not number or not np.isfinite(latitude) or abs(latitude) > 0.5 * np.pi + 1e-12:
        raise InvalidInput("latitude", latitude, "give radians between -pi/2 and pi/2")
    return float(latitude)
