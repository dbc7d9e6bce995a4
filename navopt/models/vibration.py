"""A machine that stands and shakes: what its inertial sensors read, without approximation worth the name.

The axes turn to and fro about one fixed axis of the body, and the sensors move to and fro along one line. The
means of the readings over each sample follow from the motion itself: the turn is a difference of angles, and
the specific force an integral by Gauss's formula of four points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.models.enu_velocity import earth_rate_enu
from navopt.models.static_alignment import StaticSite

__all__ = ["Vibration"]

Array = NDArray[np.float64]

#: The cutting system's motion at size one: frequencies (Hz), accelerations (m/s^2) and angles (deg). The
#: paper prints none: slow rocking by the picks, and two harmonics of the motor as they pass the machine's
#: mounts.
FREQUENCIES = (0.8, 13.0, 24.0)
ACCELERATIONS = (0.02, 0.3, 0.8)
ANGLES_DEG = (0.02, 0.005, 0.003)
#: Axis of the rocking in the body, mostly nose up and down, and line of the shaking in east, north, up.
AXIS = np.array([0.9, 0.4, 0.17])
LINE = np.array([0.5, 0.6, 0.6])


@dataclass(frozen=True)
class Vibration:
    """Sums of sinusoids of an angle about one axis and of an acceleration along one line.

    Attributes
    ----------
    frequencies : ndarray, shape (K,)
        In rad/s.
    angles, angle_phases : ndarray, shape (K,)
        Amplitudes and phases of the angle, rad.
    accelerations, phases : ndarray, shape (K,)
        Amplitudes (m/s^2) and phases (rad) of the acceleration.
    """

    frequencies: Array
    angles: Array
    angle_phases: Array
    accelerations: Array
    phases: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator, size: float) -> Vibration:
        """Draw the phases of the cutting system's shaking, `size` times as strong as the module's numbers."""
        phases = rng.uniform(0.0, 2.0 * np.pi, (2, len(FREQUENCIES)))
        return cls(
            2.0 * np.pi * np.array(FREQUENCIES),
            size * np.radians(ANGLES_DEG),
            phases[0],
            size * np.array(ACCELERATIONS),
            phases[1],
        )

    @property
    def still(self) -> bool:
        """Whether nothing moves."""
        return not (self.angles.any() or self.accelerations.any())

    def angle(self, time: ArrayLike) -> Array:
        """Return the angle about the axis, rad, at times in s."""
        t = np.asarray(time, dtype=np.float64)[..., None]
        return (self.angles * np.sin(self.frequencies * t + self.angle_phases)).sum(axis=-1)

    def attitude(self, resting: Array, time: ArrayLike) -> Array:
        """Return the true C_b^n at times in s, shape (..., 3, 3), of a machine that rests with `resting`."""
        axis = AXIS / np.linalg.norm(AXIS)
        angle = self.angle(time)[..., None, None]
        across = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
        return resting @ (np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * (across @ across))

    def velocity(self, time: ArrayLike) -> Array:
        """Return the velocity east and north at times in s, m/s, shape (..., 2)."""
        t = np.asarray(time, dtype=np.float64)[..., None]
        speed = (self.accelerations / self.frequencies * np.sin(self.frequencies * t + self.phases)).sum(
            axis=-1
        )
        return speed[..., None] * (LINE / np.linalg.norm(LINE))[:2]

    def readings(self, resting: Array, site: StaticSite, edges: Array) -> tuple[Array, Array]:
        """Return what sensors without errors read, as means over the samples between `edges`.

        Parameters
        ----------
        resting : ndarray, shape (3, 3)
            C_b^n at rest.
        site : StaticSite
            Where the machine stands.
        edges : ndarray, shape (N + 1,)
            Times between the samples, s.

        Returns
        -------
        gyro, accelerometer : ndarray, shape (N, 3)
            Axes right, forward, up, rad/s and m/s^2.
        """
        earth, gravity = earth_rate_enu(site.latitude), np.array([0.0, 0.0, site.g])
        count = len(edges) - 1
        if self.still:
            return np.tile(earth @ resting, (count, 1)), np.tile(gravity @ resting, (count, 1))
        steps = np.diff(edges)
        axis, line = AXIS / np.linalg.norm(AXIS), LINE / np.linalg.norm(LINE)
        gyro = (np.diff(self.angle(edges)) / steps)[:, None] * axis
        force = np.zeros((count, 3))
        nodes, weights = np.polynomial.legendre.leggauss(4)
        for node, weight in zip(nodes, weights, strict=True):
            t = edges[:-1] + 0.5 * (1.0 + node) * steps
            back = self.attitude(resting, t)
            shake = (self.accelerations * np.cos(self.frequencies * t[:, None] + self.phases)).sum(axis=1)
            gyro += 0.5 * weight * (earth @ back)
            force += 0.5 * weight * np.einsum("ki,kij->kj", gravity + shake[:, None] * line, back)
        return gyro, force
