"""What a recording in one position tells, and what it cannot.

A unit that never changes its attitude measures one rate vector and one force vector. Their lengths and the
angle between them are known (Earth rate, gravity, latitude), which makes three equations for the 24
parameters of two triads. Whether they hold is a check of the unit; no parameter follows from them alone.
With the parameters known, the same two vectors give the attitude: level from gravity, heading from the
Earth rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE, normal_gravity
from navopt.models.triad import PARAMETER_NAMES, AccelerometerTriad, GyroTriad
from navopt.models.triad_fit import triad_jacobian

__all__ = ["OnePosition", "one_position"]

_DEG_H = float(np.radians(1.0) / 3600.0)
#: Batches whose means show the error of the mean.
BATCHES = 12


@dataclass(frozen=True, kw_only=True)
class OnePosition:
    """The three invariants of one position, measured and expected.

    Attributes
    ----------
    rate : ndarray, shape (3,)
        Mean rate, rad/s.
    rate_sigma : ndarray, shape (3,)
        Its standard error, from the means of twelve batches.
    force : ndarray, shape (3,)
        Mean specific force, m/s2.
    force_sigma : ndarray, shape (3,)
        Its standard error.
    rate_norm, rate_norm_sigma, vertical_rate, vertical_rate_sigma : float
        Length of the mean rate and its part along the specific force, rad/s.
    force_norm, force_norm_sigma : float
        Length of the mean specific force, m/s2.
    latitude : float
        rad.
    gravity : float
        Expected gravity, m/s2.
    duration : float
        s.
    gyro_rank, accelerometer_rank, joint_rank : int
        Number of combinations of the 12 parameters of the gyros (norm only), of the 12 of the accelerometers
        (norm only), and of the 24 of both (both norms and the angle) that this position determines.
    rotation : float
        Angle by which the unit turned about itself from the first to the last batch according to the
        accelerometers, rad: what its attitude did not hold still.
    """

    rate: np.ndarray
    rate_sigma: np.ndarray
    force: np.ndarray
    force_sigma: np.ndarray
    rate_norm: float
    rate_norm_sigma: float
    vertical_rate: float
    vertical_rate_sigma: float
    force_norm: float
    force_norm_sigma: float
    latitude: float
    gravity: float
    duration: float
    gyro_rank: int
    accelerometer_rank: int
    joint_rank: int
    rotation: float

    @property
    def expected_vertical_rate(self) -> float:
        """Earth rate times the sine of the latitude, rad/s."""
        return EARTH_RATE * float(np.sin(self.latitude))

    def lines(self) -> list[str]:
        """Return the findings in a few lines of text."""
        expected = self.expected_vertical_rate / _DEG_H
        return [
            f"one position, {self.duration:.0f} s: it determines {self.gyro_rank} of the 12 parameters of "
            f"the gyros, {self.accelerometer_rank} of the 12 of the accelerometers, {self.joint_rank} of all "
            "24 together",
            f"rate: {self.rate_norm / _DEG_H:.2f} deg/h, 1 sigma {self.rate_norm_sigma / _DEG_H:.2f}; the "
            f"Earth's is {EARTH_RATE / _DEG_H:.2f}",
            f"rate along the vertical: {self.vertical_rate / _DEG_H:.2f} deg/h, 1 sigma "
            f"{self.vertical_rate_sigma / _DEG_H:.2f}; at {np.degrees(self.latitude):.3f} degrees of "
            f"latitude it is {expected:.2f}",
            f"specific force: {self.force_norm:.5f} m/s2, 1 sigma {self.force_norm_sigma:.5f}; gravity "
            f"is {self.gravity:.5f}",
            "not to be told apart here: the biases, scale factors and misalignments that change the same "
            "length; hold the unit in 24 positions to calibrate it",
        ]


def one_position(
    gyro: np.ndarray,
    accelerometer: np.ndarray,
    interval: float,
    latitude: float,
    *,
    gravity: float | None = None,
) -> OnePosition:
    """Compare a recording in one position with what the Earth is known to do.

    Parameters
    ----------
    gyro, accelerometer : ndarray, shape (N, 3)
        Samples in rad/s and m/s2.
    interval : float
        Time between samples, s.
    latitude : float
        rad.
    gravity : float, optional
        Gravity there, m/s2; normal gravity on the ellipsoid if not given.

    Returns
    -------
    OnePosition

    Raises
    ------
    InvalidInput
        If there are fewer than 120 samples, or the latitude is none.
    """
    if len(gyro) < 10 * BATCHES:
        raise InvalidInput("recording", f"{len(gyro)} samples", f"give at least {10 * BATCHES}")
    if not abs(latitude) <= 0.5 * np.pi:
        raise InvalidInput("latitude", latitude, "give radians: numpy.radians(degrees)")
    size = len(gyro) // BATCHES
    samples = np.hstack([gyro, accelerometer])[: size * BATCHES]
    means = samples.reshape(BATCHES, size, 6).mean(axis=1)
    mean, sigma = means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(BATCHES)
    rate, force = mean[:3], mean[3:]
    up = force / np.linalg.norm(force)
    first, last = (row[3:] / np.linalg.norm(row[3:]) for row in (means[0], means[-1]))
    along = rate / np.linalg.norm(rate)
    # one row of each Jacobian, for a perfect unit: the ranks are those of any
    one, none = np.ones(3), np.zeros(3)
    gyros = triad_jacobian(GyroTriad(one, np.eye(3), none), rate[None], PARAMETER_NAMES)[0]
    forces = triad_jacobian(AccelerometerTriad(one, np.eye(3), none), force[None], PARAMETER_NAMES)[0]
    norm_gyro, norm_force = along @ gyros, up @ forces
    joint = np.zeros((3, 24))
    joint[0, :12], joint[1, 12:] = norm_gyro, norm_force
    joint[2, :12] = up @ gyros
    joint[2, 12:] = (rate - up * (rate @ up)) / np.linalg.norm(force) @ forces
    scaled = joint / np.linalg.norm(joint, axis=1, keepdims=True)
    return OnePosition(
        rate=rate,
        rate_sigma=sigma[:3],
        force=force,
        force_sigma=sigma[3:],
        rate_norm=float(np.linalg.norm(rate)),
        rate_norm_sigma=float(np.linalg.norm(along * sigma[:3])),
        vertical_rate=float(rate @ up),
        vertical_rate_sigma=float((means[:, :3] @ up).std(ddof=1) / np.sqrt(BATCHES)),
        force_norm=float(np.linalg.norm(force)),
        force_norm_sigma=float(np.linalg.norm(up * sigma[3:])),
        latitude=float(latitude),
        gravity=float(normal_gravity(latitude)) if gravity is None else float(gravity),
        duration=len(gyro) * interval,
        gyro_rank=int(np.linalg.matrix_rank(norm_gyro[None])),
        accelerometer_rank=int(np.linalg.matrix_rank(norm_force[None])),
        joint_rank=int(np.linalg.matrix_rank(scaled)),
        rotation=float(np.arccos(np.clip(first @ last, -1.0, 1.0))),
    )
