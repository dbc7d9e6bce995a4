"""Coarse alignment: the attitude of a system at rest from its mean readings, eqs (23)-(25) of paper 000.

At rest an inertial system measures two vectors, gravity and the Earth's rate, and these fix its attitude.
Whatever is wrong with the sensors is wrong with the attitude, and a gyro that errs by as much as the Earth
turns says nothing about north: such readings are refused with the reason, and `level` with a heading from
elsewhere is what remains.

Axes are body right, forward, up and navigation east, north, up, see `navopt.models.enu_attitude`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import EARTH_RATE, normal_gravity
from navopt.models.enu_attitude import attitude_angles, attitude_enu
from navopt.models.enu_velocity import earth_rate_enu

__all__ = ["CoarseAlignment", "analytic_alignment", "coarse_alignment", "level"]

Array = NDArray[np.float64]

#: Part of the horizontal Earth rate that the gyros may be wrong by; the azimuth is then good to 30 degrees.
TOLERANCE = 0.5
#: Relative difference between measured and normal gravity from which the system is not at rest.
GRAVITY_TOLERANCE = 0.05
#: Number of blocks whose means tell how far the mean of a record can be trusted.
BLOCKS = 10
_PER_HOUR = np.degrees(1.0) * 3600.0


@dataclass(frozen=True)
class CoarseAlignment:
    """An attitude from mean readings, and how much they are to be trusted.

    Attributes
    ----------
    attitude : ndarray, shape (3, 3)
        C_b^n, a rotation.
    pitch, roll, yaw : float
        Its angles, rad; yaw is the heading clockwise from north.
    method : str
        ``"analytic"`` (eq. 25) or ``"levelled"``.
    rate_error : float
        What the gyros are seen to be wrong by, rad/s; see `coarse_alignment`.
    angle_sigma : ndarray, shape (3,)
        1 sigma about east, north, up of what the scatter of the readings causes, rad. Constant errors of the
        sensors are not in it.
    """

    attitude: Array
    pitch: float
    roll: float
    yaw: float
    method: str
    rate_error: float
    angle_sigma: Array


def analytic_alignment(
    rate: ArrayLike, force: ArrayLike, latitude: float, *, orthonormal: str = "svd"
) -> Array:
    """Return the attitude from mean readings, eq. (25) made orthonormal.

    ``C = [g; w; g x w]_n^-1 [g; w; g x w]_b`` is a rotation only if the measured vectors are as long and as
    far apart as the true ones.

    Parameters
    ----------
    rate : array_like, shape (..., 3)
        Mean angular rate in body axes right, forward, up, rad/s.
    force : array_like, shape (..., 3)
        Mean specific force in the same axes, m/s^2: +g on the up axis of a level system.
    latitude : float
        In rad.
    orthonormal : {"svd", "gravity"}
        The nearest rotation, ``U V^T`` of its singular value decomposition, which shares the disagreement of
        the two vectors between all three angles; or up along the measured gravity and east across both
        vectors, which leaves gravity what it knows better: a gyro error of 0.01 deg/h is 3e-4 of the
        Earth's rate and spoils the level of the nearest rotation by as many radians, a minute of arc.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        C_b^n. The rows of eq. (25) are first divided by the length of the true vectors, which cancels but
        for the conditioning.

    Raises
    ------
    InvalidInput
        If a reading is not finite, the latitude is that of a pole, or the two vectors are parallel.
    """
    if orthonormal not in ("svd", "gravity"):
        raise UnknownName("orthonormal", orthonormal, ("svd", "gravity"))
    w, f = _readings("rate", rate), _readings("force", force)
    lat = _latitude(latitude)
    gravity = np.array([0.0, 0.0, -float(normal_gravity(lat))])
    turning = earth_rate_enu(lat)
    known = np.stack([gravity, turning, np.cross(gravity, turning)])
    measured = np.stack(np.broadcast_arrays(-f, w, np.cross(-f, w)), axis=-2)
    size = np.linalg.norm(known, axis=-1, keepdims=True)
    across = np.linalg.norm(measured[..., 2, :], axis=-1) / size[2, 0]
    if (across < 1e-3).any():
        raise InvalidInput(
            "rate",
            f"a horizontal rate of {across.min() * size[2, 0] / size[0, 0] * _PER_HOUR:.3g} deg/h",
            "north cannot be found without a horizontal part of the Earth's rate: give a heading to level()",
        )
    if orthonormal == "gravity":
        up = measured[..., 0, :] / -np.linalg.norm(measured[..., 0, :], axis=-1, keepdims=True)
        east = measured[..., 2, :] / np.linalg.norm(measured[..., 2, :], axis=-1, keepdims=True)
        return np.stack([east, np.cross(up, east), up], axis=-2)
    u, _, vt = np.linalg.svd(np.linalg.solve(known / size, measured / size))
    # a mirrored answer would need measured vectors of the other handedness, which g x w never has
    return u @ vt


def level(force: ArrayLike, heading: ArrayLike) -> Array:
    """Return the attitude from mean specific force and a heading known from elsewhere.

    ``pitch = asin(f_y / |f|)``, ``roll = atan2(-f_x, f_z)``.

    Parameters
    ----------
    force : array_like, shape (..., 3)
        Mean specific force in body axes right, forward, up, m/s^2.
    heading : array_like, shape (...)
        Of the forward axis, clockwise from north, rad.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        C_b^n.

    Raises
    ------
    InvalidInput
        If a reading or heading is not finite, or no gravity is felt.
    """
    f = _readings("force", force)
    size = np.linalg.norm(f, axis=-1)
    if (size < 1.0).any():
        raise InvalidInput("force", float(size.min()), "give specific force at rest, about 9.8 m/s^2")
    if not np.isfinite(heading).all():
        raise InvalidInput("heading", heading, "give the heading in rad, clockwise from north")
    pitch = np.arcsin(np.clip(f[..., 1] / size, -1.0, 1.0))
    return attitude_enu(pitch, np.arctan2(-f[..., 0], f[..., 2]), heading)


def coarse_alignment(
    gyro: ArrayLike,
    accelerometer: ArrayLike,
    latitude: float,
    *,
    heading: float | None = None,
    gyro_error: float = 0.0,
    gravity: float | None = None,
    orthonormal: str = "gravity",
) -> CoarseAlignment:
    """Align a system at rest from its samples, or say why it cannot be done.

    Parameters
    ----------
    gyro : array_like, shape (N, 3)
        Angular rate in body axes right, forward, up, rad/s, evenly sampled, 20 samples or more.
    accelerometer : array_like, shape (N, 3)
        Specific force in the same axes, m/s^2.
    latitude : float
        In rad.
    heading : float, optional
        Heading from elsewhere (clockwise from north, rad). The gyros are then not asked for it.
    gyro_error : float
        1 sigma of the gyros' constant error, rad/s, from their data sheet; what it hides, no check of the
        readings can find.
    gravity : float, optional
        At the site, m/s^2; normal gravity if not given.
    orthonormal : {"gravity", "svd"}
        As for `analytic_alignment`.

    Returns
    -------
    CoarseAlignment

    Raises
    ------
    InvalidInput
        If the samples cannot be used, the specific force is not that of rest, or, without a heading, the
        gyros are wrong by more than half of the horizontal Earth rate. They are seen to be wrong by the
        largest of four: `gyro_error`; the standard error of their mean, from the scatter of the means of ten
        blocks; and what the measured rate about the vertical is off ``w sin L`` and the size of
        its horizontal part off ``w cos L``, which need no north.
    """
    w, f = _samples("gyro", gyro), _samples("accelerometer", accelerometer)
    if len(w) != len(f):
        raise InvalidInput(
            "gyro", f"{len(w)} samples", f"give as many as of the accelerometer, which has {len(f)}"
        )
    lat = _latitude(latitude)
    expected = float(normal_gravity(lat)) if gravity is None else float(gravity)
    rate, force = w.mean(axis=0), f.mean(axis=0)
    weight = float(np.linalg.norm(force))
    if not abs(weight - expected) < GRAVITY_TOLERANCE * expected:
        raise InvalidInput(
            "accelerometer",
            f"a mean specific force of {weight:.4g} m/s^2",
            f"it is {expected:.4g} at rest: give readings at rest, in m/s^2, axes right, forward, up",
        )
    if force[2] < 0.0:
        raise InvalidInput(
            "accelerometer",
            f"a mean of {force[2]:.4g} m/s^2 on the up axis",
            "it is about +9.8 at rest: give specific force in axes right, forward, up",
        )
    horizontal, vertical = EARTH_RATE * np.cos(lat), EARTH_RATE * np.sin(lat)
    rate_sigma, force_sigma = _standard_error(w), _standard_error(f)
    upward = float(rate @ force) / weight
    across = float(np.sqrt(max(float(rate @ rate) - upward**2, 0.0)))
    causes = {
        "as declared": float(gyro_error),
        "standard error of the mean": float(rate_sigma.max()),
        "rate about the vertical": abs(upward - vertical),
        "rate about the horizontal": abs(across - horizontal),
    }
    error = max(causes.values())
    if heading is not None:
        attitude, method, yaw_sigma = level(force, heading), "levelled", np.nan
    elif not error < TOLERANCE * horizontal:
        raise InvalidInput("gyro", _reason(causes, horizontal), _REMEDY)
    else:
        attitude, method = analytic_alignment(rate, force, lat, orthonormal=orthonormal), "analytic"
        yaw_sigma = float(np.hypot(rate_sigma.max() / horizontal, np.tan(lat) * force_sigma.max() / weight))
    pitch, roll, yaw = (float(angle) for angle in attitude_angles(attitude))
    tilt = float(force_sigma.max()) / weight
    return CoarseAlignment(
        attitude, pitch, roll, yaw, method, error, angle_sigma=np.array([tilt, tilt, yaw_sigma])
    )


_REMEDY = "take the heading from elsewhere: heading="


def _reason(causes: dict[str, float], horizontal: float) -> str:
    worst = max(causes, key=lambda name: causes[name])
    return (
        f"gyros wrong by {causes[worst] * _PER_HOUR:.3g} deg/h ({worst}) "
        f"where the Earth turns by {horizontal * _PER_HOUR:.3g} about north"
    )


def _standard_error(samples: Array) -> Array:
    """Standard error of the mean of each column, from blocks: noise that is correlated counts as such."""
    length = len(samples) // BLOCKS
    means = samples[: length * BLOCKS].reshape(BLOCKS, length, -1).mean(axis=1)
    return means.std(axis=0, ddof=1) / np.sqrt(BLOCKS)


def _samples(name: str, value: ArrayLike) -> Array:
    samples = np.asarray(value, dtype=np.float64)
    if samples.ndim != 2 or samples.shape[1] != 3 or len(samples) < 2 * BLOCKS:
        raise InvalidInput(
            name, f"shape {samples.shape}", f"give at least {2 * BLOCKS} samples, shape (N, 3)"
        )
    return _readings(name, samples)


def _readings(name: str, value: ArrayLike) -> Array:
    readings = np.asarray(value, dtype=np.float64)
    if readings.shape[-1:] != (3,):
        raise InvalidInput(name, f"shape {readings.shape}", "give readings of shape (..., 3)")
    if not np.isfinite(readings).all():
        where = tuple(int(k) for k in np.argwhere(~np.isfinite(readings))[0])
        raise InvalidInput(f"{name}{list(where)}", float(readings[where]), "give finite readings")
    return readings


def _latitude(value: float) -> float:
    if not np.isfinite(value) or not abs(value) < np.pi / 2.0 - 1e-6:
        raise InvalidInput("latitude", value, "give a latitude in rad, away from the poles")
    return float(value)
