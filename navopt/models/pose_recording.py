"""Simulated recordings of a unit that is turned by hand from pose to pose, with known parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navopt.data.imu_recording import ImuRecording
from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE
from navopt.models.triad import AccelerometerTriad, GyroTriad

__all__ = ["SimulatedRecording", "simulate_recording"]


@dataclass(frozen=True)
class SimulatedRecording:
    """A recording and what it was made from.

    Attributes
    ----------
    recording : ImuRecording
        The samples.
    gyro : GyroTriad
        True parameters of the gyros.
    accelerometer : AccelerometerTriad
        True parameters of the accelerometers.
    starts, stops : ndarray of int, shape (P,)
        First sample of each pose and the one after its last.
    attitudes : ndarray, shape (P, 3, 3)
        From east, north, up to body axes, in each pose.
    """

    recording: ImuRecording
    gyro: GyroTriad
    accelerometer: AccelerometerTriad
    starts: np.ndarray
    stops: np.ndarray
    attitudes: np.ndarray


def simulate_recording(
    seed: int,
    *,
    gyro: GyroTriad,
    accelerometer: AccelerometerTriad,
    poses: int = 24,
    initial_s: float = 20.0,
    pose_s: float = 5.0,
    turn_s: float = 2.0,
    rate_hz: float = 100.0,
    gravity: float = 9.81,
    latitude: float | None = None,
    gyro_noise: float = 0.0,
    accelerometer_noise: float = 0.0,
    attitudes: np.ndarray | None = None,
    counts: bool = True,
    shake: float = 1.0,
) -> SimulatedRecording:
    """Simulate a unit that lies still, is turned to another pose, lies still, and so on.

    Each turn is about one axis with the smooth rate that begins and ends at zero; while it lasts, the unit is
    also shaken. The samples are taken at instants, without any filter.

    Parameters
    ----------
    seed : int
        Of the poses, the shaking and the noise.
    gyro, accelerometer : GyroTriad, AccelerometerTriad
        True parameters.
    poses : int
        Number of poses, the first included.
    initial_s, pose_s, turn_s : float
        Length of the first pose, of the others and of a turn, s.
    rate_hz : float
        Samples per second.
    gravity : float
        m/s2.
    latitude : float, optional
        If given, rad, the Earth turns.
    gyro_noise, accelerometer_noise : float
        Standard deviation of white noise of a sample, counts.
    attitudes : ndarray, shape (poses, 3, 3), optional
        From east, north, up to body axes; drawn at random, equally distributed, if not given.
    counts : bool
        Whether the samples are called counts, rather than rad/s and m/s2.
    shake : float
        Standard deviation of the acceleration of the hand in each axis, m/s2.

    Returns
    -------
    SimulatedRecording

    Raises
    ------
    InvalidInput
        If there is no pose.
    """
    from scipy.spatial.transform import Rotation

    if poses < 1:
        raise InvalidInput("poses", poses, "give at least one")
    rng = np.random.default_rng(seed)
    # body to navigation axes
    if attitudes is None:
        turned = Rotation.random(poses, random_state=rng)
    else:
        turned = Rotation.from_matrix(np.swapaxes(attitudes, 1, 2))
    step = 1.0 / rate_hz
    rates, attitude, shaken, starts, stops = [], [], [], [], []
    position = 0
    for k in range(poses):
        still = round((initial_s if k == 0 else pose_s) * rate_hz)
        starts.append(position)
        stops.append(position + still)
        rates.append(np.zeros((still, 3)))
        attitude.append(Rotation.concatenate([turned[k]] * still).as_matrix())
        shaken.append(np.zeros((still, 3)))
        position += still
        if k == poses - 1:
            break
        moving = round(turn_s * rate_hz)
        phase = np.arange(1, moving + 1) / (moving + 1)
        vector = (turned[k].inv() * turned[k + 1]).as_rotvec()
        # angle s - sin(2 pi s) / (2 pi) of a turn that takes (moving + 1) steps
        angle = phase - np.sin(2 * np.pi * phase) / (2 * np.pi)
        speed = (1.0 - np.cos(2 * np.pi * phase)) / ((moving + 1) * step)
        rates.append(speed[:, None] * vector)
        attitude.append((turned[k] * Rotation.from_rotvec(angle[:, None] * vector)).as_matrix())
        shaken.append(shake * np.sin(np.pi * phase)[:, None] * rng.standard_normal((moving, 3)))
        position += moving
    body = np.concatenate(attitude)
    rate = np.concatenate(rates)
    if latitude is not None:
        earth = EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
        rate = rate + np.einsum("nij,i->nj", body, earth)
    force = np.einsum("nij,i->nj", body, np.array([0.0, 0.0, gravity])) + np.concatenate(shaken)
    shape = (position, 3)
    recording = ImuRecording(
        time=step * np.arange(position),
        gyro=gyro.forward(rate) + gyro_noise * rng.standard_normal(shape),
        accelerometer=accelerometer.forward(force) + accelerometer_noise * rng.standard_normal(shape),
        gyro_unit="counts" if counts else "rad/s",
        accelerometer_unit="counts" if counts else "m/s2",
        latitude=latitude,
        source=f"simulated, seed {seed}",
    )
    return SimulatedRecording(
        recording,
        gyro,
        accelerometer,
        np.array(starts),
        np.array(stops),
        np.swapaxes(turned.as_matrix(), 1, 2),
    )
