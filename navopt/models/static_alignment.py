"""The ten-state error model of a strapdown system at rest: eqs (26)-(35) of paper 000, signs corrected.

States are errors, computed minus true: velocity east and north (m/s); the angles phi_E, phi_N, phi_U by which
the computed frame is turned from the true one (rad); the biases of the right and the forward accelerometer
(m/s^2) and of the three gyros (rad/s), in body axes. With C the attitude, g gravity, w_N and w_U the
Earth's rate towards north and up and R the radius of the Earth::

    dv_E'  =  2 w_U dv_N - g phi_N + (C a)_E        phi_E' = -dv_N / R + w_U phi_N - w_N phi_U - (C e)_E
    dv_N'  = -2 w_U dv_E + g phi_E + (C a)_N        phi_N' =  dv_E / R - w_U phi_E            - (C e)_N
                                                    phi_U' =  dv_E tan L / R + w_N phi_E      - (C e)_U

The printed (26)-(28) and (31)-(33) leave the sign of the Coriolis terms and the frame of the sensors' errors
open; these are the signs of the linearised eq. (18) and of the kinematics of the attitude, and the errors are
those of the body's axes.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE, normal_gravity
from navopt.models.van_loan import discretise

__all__ = [
    "STATES",
    "AlignmentModel",
    "StaticSite",
    "alignment_limits",
    "error_dynamics",
    "observability_rank",
    "unobservable_directions",
]

Array = NDArray[np.float64]

#: Names of the states.
STATES = ("dv_e", "dv_n", "phi_e", "phi_n", "phi_u", "accel_x", "accel_y", "gyro_x", "gyro_y", "gyro_z")
#: The first five are driven by noise.
DRIVEN = 5
#: Mean radius of the Earth in paper 000, m.
MEAN_RADIUS = 6371393.0


@dataclass(frozen=True, kw_only=True)
class StaticSite:
    """Where a system stands.

    Attributes
    ----------
    latitude : float
        In rad, away from the poles.
    height : float
        Above the ellipsoid, m.
    gravity : float or None
        In m/s^2; normal gravity at the latitude if not given. Paper 000 uses 9.7803267714, which is that
        of the equator.
    radius : float
        Of a spherical Earth, m.

    Raises
    ------
    InvalidInput
        If a value cannot be used.
    """

    latitude: float
    height: float = 0.0
    gravity: float | None = None
    radius: float = MEAN_RADIUS

    def __post_init__(self) -> None:
        if not np.isfinite(self.latitude) or not abs(self.latitude) < np.radians(89.0):
            raise InvalidInput("latitude", self.latitude, "give a latitude in rad, within 89 degrees")
        if not np.isfinite(self.height) or not abs(self.height) < 1e5:
            raise InvalidInput("height", self.height, "give metres above the ellipsoid")
        if self.gravity is not None and not 9.0 < self.gravity < 11.0:
            raise InvalidInput("gravity", self.gravity, "give m/s^2, about 9.8")
        if not 6.3e6 < self.radius < 6.5e6:
            raise InvalidInput("radius", self.radius, "give the radius of the Earth, about 6.37e6 m")

    @classmethod
    def published(cls, **changes: float) -> StaticSite:
        """Table 2 of paper 000: 40 degrees north, 40 m high, the printed radius and (equatorial) gravity."""
        return cls(**{"latitude": np.radians(40.0), "height": 40.0, "gravity": 9.7803267714, **changes})

    @property
    def g(self) -> float:
        """Gravity, m/s^2."""
        return float(normal_gravity(self.latitude)) if self.gravity is None else self.gravity

    @property
    def rate_north(self) -> float:
        """Earth rate about north, rad/s."""
        return EARTH_RATE * float(np.cos(self.latitude))

    @property
    def rate_up(self) -> float:
        """Earth rate about the vertical, rad/s."""
        return EARTH_RATE * float(np.sin(self.latitude))


def error_dynamics(site: StaticSite, attitude: ArrayLike | None = None) -> Array:
    """Return F of ``x' = F x``, shape (10, 10).

    Parameters
    ----------
    site : StaticSite
        Where the system stands.
    attitude : array_like, shape (3, 3), optional
        C_b^n from axes right, forward, up to east, north, up; level and heading north if not given.

    Returns
    -------
    ndarray, shape (10, 10)
        In 1/s and the units of the states.
    """
    c = np.eye(3) if attitude is None else np.asarray(attitude, dtype=np.float64)
    if c.shape != (3, 3) or not np.allclose(c @ c.T, np.eye(3), atol=1e-6):
        raise InvalidInput("attitude", attitude, "give a rotation matrix, shape (3, 3)")
    radius = site.radius + site.height
    north, up, tangent = site.rate_north, site.rate_up, float(np.tan(site.latitude))
    F = np.zeros((10, 10))
    F[0, 1], F[0, 3] = 2.0 * up, -site.g
    F[1, 0], F[1, 2] = -2.0 * up, site.g
    F[2, 1], F[2, 3], F[2, 4] = -1.0 / radius, up, -north
    F[3, 0], F[3, 2] = 1.0 / radius, -up
    F[4, 0], F[4, 2] = tangent / radius, north
    F[0:2, 5:7] = c[0:2, 0:2]
    F[2:5, 7:10] = -c
    return F


def _natural_units(site: StaticSite) -> tuple[Array, float]:
    """Sizes of the states, and the time, in which all entries of F are numbers without a unit near one."""
    time = 1.0 / EARTH_RATE
    return np.array([site.g * time] * 2 + [1.0] * 3 + [site.g] * 2 + [EARTH_RATE] * 3), time


def _observability(site: StaticSite, attitude: ArrayLike | None) -> Array:
    size, time = _natural_units(site)
    F = time * error_dynamics(site, attitude) * size / size[:, None]
    rows, power = [], np.eye(10)
    for _ in range(10):
        rows.append(power[:2] / np.linalg.norm(power[:2], axis=1, keepdims=True))
        power = power @ F
    return np.concatenate(rows)


def observability_rank(site: StaticSite, attitude: ArrayLike | None = None) -> int:
    """Return how many combinations of the ten states the two velocities tell: seven, at every attitude.

    Parameters
    ----------
    site, attitude
        As for `error_dynamics`.

    Returns
    -------
    int
    """
    return int(np.linalg.matrix_rank(_observability(site, attitude), tol=1e-9))


def unobservable_directions(site: StaticSite, attitude: ArrayLike | None = None) -> Array:
    """Return the changes of the state that no velocity shows.

    Parameters
    ----------
    site, attitude
        As for `error_dynamics`.

    Returns
    -------
    ndarray, shape (10, 3)
        In the units of the states: an error of either horizontal accelerometer, and one of the gyros
        towards east, each with the angles it hides behind. F makes nothing of them, so along them nothing
        ever moves.
    """
    size, _ = _natural_units(site)
    seen = _observability(site, attitude)
    _, _, directions = np.linalg.svd(seen)
    return size[:, None] * directions[np.linalg.matrix_rank(seen, tol=1e-9) :].T


def alignment_limits(
    gyro_error: ArrayLike, accelerometer_error: ArrayLike, site: StaticSite, attitude: ArrayLike | None = None
) -> Array:
    """Return the angles in which every self-alignment at rest ends, to first order.

    ``phi_E = -a_N / g``, ``phi_N = a_E / g``, ``phi_U = tan L phi_N - e_E / w_N``: gravity cannot tell a
    tilt from an accelerometer's error, nor the Earth's rate an azimuth from a drift about east.

    Parameters
    ----------
    gyro_error, accelerometer_error : array_like, shape (..., 3)
        Measured minus true in body axes, rad/s and m/s^2.
    site, attitude
        As for `error_dynamics`.

    Returns
    -------
    ndarray, shape (..., 3)
        phi about east, north, up, rad.
    """
    c = np.eye(3) if attitude is None else np.asarray(attitude, dtype=np.float64)
    e = np.asarray(gyro_error, dtype=np.float64) @ c.T
    a = np.asarray(accelerometer_error, dtype=np.float64) @ c.T
    east, north = -a[..., 1] / site.g, a[..., 0] / site.g
    up = np.tan(site.latitude) * north - e[..., 0] / site.rate_north
    return np.stack([east, north, up], axis=-1)


@dataclass(frozen=True)
class AlignmentModel:
    """The model in steps of a clock, eq. (35), with the covariance that each noise source adds per step.

    Attributes
    ----------
    transition : ndarray, shape (10, 10)
        Phi.
    sources : ndarray, shape (5, 5, 5)
        ``sources[i]`` is the covariance of the first five states that white noise on state i of unit
        density adds in a step (eq. 33's W); the biases receive none.
    step : float
        In s.
    """

    transition: Array
    sources: Array
    step: float

    @classmethod
    def of(cls, site: StaticSite, step: float, attitude: ArrayLike | None = None) -> AlignmentModel:
        """Discretise the error model by `navopt.models.van_loan.discretise`, one noise source at a time."""
        c = np.eye(3) if attitude is None else np.asarray(attitude, dtype=np.float64)
        # worlds of one scenario have the same matrices, whose exponentials take longer than all the rest
        transition, sources = _discrete(site, float(step), c.tobytes(), c.shape)
        return cls(transition, sources, float(step))

    @property
    def noise_input(self) -> Array:
        """G of the discrete model, shape (10, 5): noise enters the first five states."""
        return np.eye(10, DRIVEN)

    @property
    def measurement(self) -> Array:
        """H, shape (2, 10): both velocities are measured, and are zero at rest, eq. (34)."""
        return np.eye(2, 10)

    def process_covariance(self, velocity_noise: float, angle_noise: float) -> Array:
        """Return Q of one step.

        Parameters
        ----------
        velocity_noise : float
            Root density of the accelerometers' noise, m/s^2/sqrt(Hz).
        angle_noise : float
            Root density of the gyros' noise, rad/s/sqrt(Hz).

        Returns
        -------
        ndarray, shape (5, 5)
        """
        # equal noise on three axes is equal noise on any other three
        variances = np.array([velocity_noise**2] * 2 + [angle_noise**2] * 3)
        return np.einsum("k,kij->ij", variances, self.sources)


@functools.lru_cache(maxsize=64)
def _discrete(site: StaticSite, step: float, attitude: bytes, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Transition and sources of `AlignmentModel.of`, read-only."""
    F = error_dynamics(site, np.frombuffer(attitude).reshape(shape))
    densities = np.zeros((DRIVEN, 10, 10))
    for k in range(DRIVEN):
        densities[k, k, k] = 1.0
    transition, covariance = discretise(F, densities, step)
    arrays = transition[0].copy(), np.ascontiguousarray(covariance[:, :DRIVEN, :DRIVEN])
    for array in arrays:
        array.setflags(write=False)
    return arrays
