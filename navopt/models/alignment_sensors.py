"""Inertial sensors at rest: how wrong they are, what they read, and what an attitude from them is worth."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import GRAVITY
from navopt.models.enu_velocity import earth_rate_enu
from navopt.models.static_alignment import StaticSite

__all__ = ["ImuGrade", "coarse_covariance", "simulate_static_imu"]

Array = NDArray[np.float64]

_PER_HOUR = float(np.radians(1.0) / 3600.0)
_PER_ROOT_HOUR = float(np.radians(1.0) / 60.0)
_MICRO_G = 1e-6 * GRAVITY


@dataclass(frozen=True, kw_only=True)
class ImuGrade:
    """1 sigma of the errors of an inertial measurement unit, the same on each axis.

    Attributes
    ----------
    gyro_bias : float
        Constant error of a gyro, rad/s.
    gyro_noise : float
        Root density of its noise (angle random walk), rad/s/sqrt(Hz) = rad/sqrt(s).
    accelerometer_bias : float
        Constant error of an accelerometer, m/s^2.
    accelerometer_noise : float
        Root density of its noise (velocity random walk), m/s^2/sqrt(Hz).

    Raises
    ------
    InvalidInput
        If one is negative or not finite.
    """

    gyro_bias: float
    gyro_noise: float
    accelerometer_bias: float
    accelerometer_noise: float

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, bool) or not np.isfinite(value) or value < 0.0:
                raise InvalidInput(item.name, value, "give a standard deviation in SI units, zero or more")

    @classmethod
    def from_datasheet(
        cls, *, gyro_bias_dph: float, arw_deg_rth: float, accel_bias_ug: float, vrw_ug_rthz: float
    ) -> ImuGrade:
        """Make one from the units of data sheets: deg/h, deg/sqrt(h), micro-g and micro-g/sqrt(Hz)."""
        return cls(
            gyro_bias=gyro_bias_dph * _PER_HOUR,
            gyro_noise=arw_deg_rth * _PER_ROOT_HOUR,
            accelerometer_bias=accel_bias_ug * _MICRO_G,
            accelerometer_noise=vrw_ug_rthz * _MICRO_G,
        )

    @classmethod
    def navigation(cls) -> ImuGrade:
        """0.01 deg/h, 0.001 deg/sqrt(h), 100 micro-g, 10 micro-g/sqrt(Hz).

        Paper 000 prints no errors for its simulation; these are usual for a system that finds north by
        itself.
        """
        return cls.from_datasheet(
            gyro_bias_dph=0.01, arw_deg_rth=0.001, accel_bias_ug=100.0, vrw_ug_rthz=10.0
        )

    @classmethod
    def low_cost(cls) -> ImuGrade:
        """JY901 of paper 000's experiment: 0.05 deg/s of bias, 0.3 deg/sqrt(h), 10 mg and 0.1 mg/sqrt(Hz).

        The gyro noise is 0.05 deg/s (rms) in 100 readings per second. The paper prints no values; these
        are of the order that sellers of such modules state.
        """
        return cls.from_datasheet(
            gyro_bias_dph=180.0, arw_deg_rth=0.3, accel_bias_ug=10000.0, vrw_ug_rthz=100.0
        )


def simulate_static_imu(
    site: StaticSite,
    attitude: ArrayLike,
    grade: ImuGrade,
    *,
    steps: int,
    step: float,
    gyro_bias: ArrayLike,
    accelerometer_bias: ArrayLike,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Return what the sensors of a system at rest read, as means over each step.

    Parameters
    ----------
    site : StaticSite
        Where it stands.
    attitude : array_like, shape (3, 3)
        C_b^n, axes right, forward, up to east, north, up.
    grade : ImuGrade
        Only its noise is used.
    steps : int
        Number of readings.
    step : float
        Time between two, s.
    gyro_bias, accelerometer_bias : array_like, shape (3,)
        Constant errors in body axes, rad/s and m/s^2.
    rng : numpy.random.Generator
        6 `steps` normal numbers are taken from it.

    Returns
    -------
    gyro, accelerometer : ndarray, shape (steps, 3)
        In rad/s and m/s^2.
    """
    c = np.asarray(attitude, dtype=np.float64)
    noise = rng.standard_normal((steps, 6)) / np.sqrt(step)
    gyro = earth_rate_enu(site.latitude) @ c + np.asarray(gyro_bias) + grade.gyro_noise * noise[:, :3]
    force = np.array([0.0, 0.0, site.g]) @ c
    return gyro, force + np.asarray(accelerometer_bias) + grade.accelerometer_noise * noise[:, 3:]


def coarse_covariance(
    site: StaticSite,
    attitude: ArrayLike,
    grade: ImuGrade,
    *,
    duration: float,
    heading_sigma: float | None = None,
    velocity_sigma: float,
) -> Array:
    """Return the covariance of the ten states after a coarse alignment.

    A tilt that comes from an accelerometer's bias is correlated with that bias, and an azimuth from the gyros
    with theirs; a fine alignment that starts from independent errors instead believes that it can tell
    them apart.

    Parameters
    ----------
    site, attitude, grade
        As for `simulate_static_imu`; the biases are taken to have mean zero.
    duration : float
        How long was averaged, s.
    heading_sigma : float, optional
        1 sigma of a heading from elsewhere, rad; the azimuth is from the gyros if not given.
    velocity_sigma : float
        1 sigma of the velocity at the start, m/s.

    Returns
    -------
    ndarray, shape (10, 10)

    Notes
    -----
    To first order the angles are `alignment_limits` of the mean errors, bias plus noise over the
    root of the duration. Of the third accelerometer only what enters these angles is in it.
    """
    c = np.asarray(attitude, dtype=np.float64)
    # angles from mean errors of the sensors, accelerometers right, forward, up and gyros right, forward, up
    angles = np.zeros((3, 6))
    angles[0, :3], angles[1, :3] = -c[1] / site.g, c[0] / site.g
    if heading_sigma is None:
        angles[2, :3] = np.tan(site.latitude) * angles[1, :3]
        angles[2, 3:] = -c[0] / site.rate_north
    bias = np.array([grade.accelerometer_bias] * 3 + [grade.gyro_bias] * 3) ** 2
    noise = np.array([grade.accelerometer_noise] * 3 + [grade.gyro_noise] * 3) ** 2 / duration
    # the ten states from velocity and heading errors, biases, and mean noise
    reach = np.zeros((10, 15))
    reach[[0, 1, 4], [0, 1, 2]] = 1.0
    reach[2:5, 3:9] = angles
    reach[2:5, 9:15] = angles
    reach[[5, 6, 7, 8, 9], [3, 4, 6, 7, 8]] = 1.0
    heading = 0.0 if heading_sigma is None else heading_sigma**2
    return (reach * np.concatenate([[velocity_sigma**2] * 2, [heading], bias, noise])) @ reach.T
