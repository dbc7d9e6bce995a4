"""The nouns of an inertial voyage: where the vehicle went, what its sensors did, what the INS showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import ARC_MINUTE, GRAVITY, rhumb_line, separation

__all__ = ["ALIGNMENT_SOURCES", "SOURCES", "CruiseScenario", "InsErrors", "InsTrack", "check_times"]

Array = NDArray[np.float64]

SOURCES: tuple[str, ...] = (
    "gyro_bias_forward",
    "gyro_bias_right",
    "gyro_bias_down",
    "accelerometer_bias_forward",
    "accelerometer_bias_right",
    "accelerometer_bias_down",
    "latitude_error",
    "longitude_error",
)
"""The eight constant sources of paper 003's Table 1, in the order of `InsErrors.vector`."""

ALIGNMENT_SOURCES: tuple[str, ...] = (
    "velocity_error_north",
    "velocity_error_east",
    "roll_error",
    "pitch_error",
    "heading_error",
)
"""Five more initial errors, zero in the paper: an INS that did not start aligned and at the right speed."""

_DEG_PER_HOUR = float(np.pi / 180.0 / 3600.0)
_TABLE_1_GYRO = 0.02 * _DEG_PER_HOUR
_TABLE_1_ACCELEROMETER = 100e-6 * GRAVITY


def check_times(times: ArrayLike, last: float) -> Array:
    """Return times as an array, or refuse them.

    Parameters
    ----------
    times : array_like, shape (N,)
        Seconds since departure.
    last : float
        The end of the voyage, s.

    Returns
    -------
    ndarray, shape (N,)
        A copy of the times as float64.

    Raises
    ------
    InvalidInput
        If they are not a non-empty, strictly increasing list within the voyage.
    """
    t = np.array(times, dtype=np.float64)  # a copy: results are frozen, the caller's array is not
    if t.ndim != 1 or t.size == 0 or not np.all(np.isfinite(t)):
        raise InvalidInput("times", times, "give a one-dimensional list of finite seconds")
    if np.any(np.diff(t) <= 0.0):
        raise InvalidInput("times", times, "sort the times and remove repeated ones")
    if t[0] < 0.0 or t[-1] > last:
        raise InvalidInput("times", times, f"stay within 0 and {last:g} s or lengthen the voyage")
    return t


def _number(name: str, value: Any) -> float:
    """One finite Python float: hashable, so that equal scenarios share what is cached for them."""
    array = np.asarray(value)
    if array.ndim or array.dtype.kind not in "fiu" or not np.isfinite(array):
        raise InvalidInput(name, value, "give one finite number")
    return float(array)


@dataclass(frozen=True, kw_only=True)
class CruiseScenario:
    """A vehicle that holds its heading and speed on the surface of WGS-84.

    The defaults are paper 003, Table 1, with the azimuth resolved to 300° (clockwise from north): the printed
    60° leaves the paper's own map after 2.6 h, while −60° stays on it and gives the paper's initial errors.

    Parameters
    ----------
    latitude, longitude : float
        Departure, rad.
    azimuth : float
        Heading, clockwise from north, rad. The track is a rhumb line.
    speed : float
        Speed over ground, m/s.
    duration : float
        Length of the voyage, s.
    time_step : float
        Interval of the inertial samples, s; `duration` is a whole number of them.

    Raises
    ------
    InvalidInput
        If a value is not finite, a length of time is not positive, or the steps do not fill the voyage.

    Examples
    --------
    >>> voyage = CruiseScenario(duration=3600.0)
    >>> latitude, longitude = voyage.position([0.0, 3600.0])
    >>> float(np.degrees(latitude[1]).round(4)), float(np.degrees(longitude[1]).round(4))
    (20.1254, 155.7702)
    """

    latitude: float = float(np.radians(20.0))
    longitude: float = float(np.radians(156.0))
    azimuth: float = float(np.radians(300.0))
    speed: float = 7.71
    duration: float = 16 * 3600.0
    time_step: float = 1.0

    def __post_init__(self) -> None:
        for item in fields(self):
            object.__setattr__(self, item.name, _number(item.name, getattr(self, item.name)))
        if self.time_step <= 0.0 or self.duration < 3 * self.time_step:
            raise InvalidInput("duration", self.duration, "make it three positive time steps or more")
        if abs(self.steps * self.time_step - self.duration) > 1e-9 * self.duration:
            raise InvalidInput("time_step", self.time_step, "choose one that divides the duration")
        if self.speed < 0.0:
            raise InvalidInput("speed", self.speed, "give a positive speed and turn the azimuth")

    @property
    def steps(self) -> int:
        """Number of inertial samples."""
        return round(self.duration / self.time_step)

    @property
    def velocity(self) -> tuple[float, float]:
        """True velocity (north, east), m/s: constant on a rhumb line."""
        return self.speed * float(np.cos(self.azimuth)), self.speed * float(np.sin(self.azimuth))

    def times(self, interval: float = 60.0) -> Array:
        """Return the times 0, interval, 2 interval … up to the end of the voyage, s."""
        if not interval > 0.0:
            raise InvalidInput("interval", interval, "give a positive number of seconds")
        count = int(np.floor(self.duration / interval * (1.0 + 1e-12))) + 1
        return interval * np.arange(count, dtype=np.float64)

    def position(self, times: ArrayLike) -> tuple[Array, Array]:
        """Return the true latitude and longitude (rad) at some times since departure (s, any shape)."""
        travelled = self.speed * np.asarray(times, dtype=np.float64)
        return rhumb_line(self.latitude, self.longitude, self.azimuth, travelled)


def _tuple(name: str, value: ArrayLike, length: int, remedy: str) -> tuple[float, ...]:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (length,) or not np.all(np.isfinite(array)):
        raise InvalidInput(name, value, remedy)
    return tuple(float(v) for v in array)


@dataclass(frozen=True, kw_only=True)
class InsErrors:
    """What is wrong with an INS: sensor biases, initial errors and white noise.

    The same class states one INS (its errors) and a family of them (the 1σ of each error, see `draw`). Body
    axes are forward, right and down. All default to zero.

    Parameters
    ----------
    gyro_bias : array_like, shape (3,)
        Constant drift, rad/s; measured = true + bias.
    accelerometer_bias : array_like, shape (3,)
        Constant bias, m/s².
    latitude_error, longitude_error : float
        Initial position error, INS minus truth, rad.
    velocity_error : array_like, shape (2,)
        Initial velocity error (north, east), m/s.
    attitude_error : array_like, shape (3,)
        Initial error of roll, pitch and heading, rad.
    gyro_noise : float
        White noise, 1σ of the rate averaged over one second, rad/s, the same on each axis; for a time step Δt
        the samples have 1σ/√Δt, so that the drift of the angle does not depend on the step.
    accelerometer_noise : float
        White noise in the same way, m/s².

    Raises
    ------
    InvalidInput
        If a shape is wrong, a value is not finite or a noise level is negative.

    Notes
    -----
    Paper 003, Table 1. The table gives no bandwidth for the noise; "per 1 Hz sample" is our reading.
    """

    gyro_bias: Sequence[float] | Array = (0.0, 0.0, 0.0)
    accelerometer_bias: Sequence[float] | Array = (0.0, 0.0, 0.0)
    latitude_error: float = 0.0
    longitude_error: float = 0.0
    velocity_error: Sequence[float] | Array = (0.0, 0.0)
    attitude_error: Sequence[float] | Array = (0.0, 0.0, 0.0)
    gyro_noise: float = 0.0
    accelerometer_noise: float = 0.0

    def __post_init__(self) -> None:
        body = "give three finite numbers: forward, right, down"
        lengths = {
            "gyro_bias": (3, body),
            "accelerometer_bias": (3, body),
            "velocity_error": (2, "give two finite numbers: north, east"),
            "attitude_error": (3, "give three finite numbers: roll, pitch, heading"),
        }
        for name, (length, remedy) in lengths.items():
            object.__setattr__(self, name, _tuple(name, getattr(self, name), length, remedy))
        for name in ("latitude_error", "longitude_error", "gyro_noise", "accelerometer_noise"):
            value = _number(name, getattr(self, name))
            if name.endswith("noise") and value < 0.0:
                raise InvalidInput(name, value, "give a standard deviation that is not negative")
            object.__setattr__(self, name, value)

    @classmethod
    def published(cls, *, noise: bool = True) -> InsErrors:
        """Return paper 003's Table 1: 0.02 °/h, 100 µg on each axis, 0.1′ in latitude and longitude.

        Parameters
        ----------
        noise : bool
            Whether to add the table's random drift, 0.02 °/h and 100 µg, 1σ per second.

        Returns
        -------
        InsErrors
            The errors of that INS, or the 1σ of a family of such INSs (both uses are ours: the table prints
            one value for each).
        """
        return cls(
            gyro_bias=(_TABLE_1_GYRO,) * 3,
            accelerometer_bias=(_TABLE_1_ACCELEROMETER,) * 3,
            latitude_error=0.1 * ARC_MINUTE,
            longitude_error=0.1 * ARC_MINUTE,
            gyro_noise=_TABLE_1_GYRO if noise else 0.0,
            accelerometer_noise=_TABLE_1_ACCELEROMETER if noise else 0.0,
        )

    @classmethod
    def from_vector(cls, vector: ArrayLike, **others: Any) -> InsErrors:
        """Invert `vector`: eight numbers in the order of `SOURCES`; `others` sets the remaining fields."""
        v = _tuple("vector", vector, 8, f"give eight finite numbers: {', '.join(SOURCES)}")
        return cls(
            gyro_bias=v[:3], accelerometer_bias=v[3:6], latitude_error=v[6], longitude_error=v[7], **others
        )

    @property
    def vector(self) -> Array:
        """The eight constant sources in the order of `SOURCES`, rad/s, m/s² and rad."""
        position = (self.latitude_error, self.longitude_error)
        return np.array([*self.gyro_bias, *self.accelerometer_bias, *position])

    @property
    def alignment(self) -> Array:
        """The five initial errors in the order of `ALIGNMENT_SOURCES`, m/s and rad."""
        return np.array([*self.velocity_error, *self.attitude_error])

    def draw(self, rng: np.random.Generator) -> InsErrors:
        """Draw one INS from the family whose 1σ these are; the noise levels are carried over.

        Parameters
        ----------
        rng : numpy.random.Generator
            Thirteen normal numbers are taken from it, always.

        Returns
        -------
        InsErrors
            Errors of one INS.
        """
        z = rng.standard_normal(13)
        v, a = z[:8] * self.vector, z[8:] * self.alignment
        return replace(
            self,
            gyro_bias=v[:3],
            accelerometer_bias=v[3:6],
            latitude_error=v[6],
            longitude_error=v[7],
            velocity_error=a[:2],
            attitude_error=a[2:],
        )


@dataclass(frozen=True, kw_only=True)
class InsTrack:
    """Where the vehicle was and where its INS said it was. The arrays are read-only.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Seconds since departure.
    latitude, longitude : ndarray, shape (N,)
        INS position, rad.
    velocity : ndarray, shape (N, 2)
        INS velocity (north, east), m/s.
    true_latitude, true_longitude : ndarray, shape (N,)
        True position, rad.
    true_velocity : ndarray, shape (N, 2)
        True velocity (north, east), m/s.
    errors : InsErrors
        What the INS suffered from.
    heading : ndarray, shape (N,), optional
        INS heading of the forward axis, clockwise from north, rad; None on a voyage that holds its azimuth.
    """

    time: Array
    latitude: Array
    longitude: Array
    velocity: Array
    true_latitude: Array
    true_longitude: Array
    true_velocity: Array
    errors: InsErrors = field(default_factory=InsErrors)
    heading: Array | None = None

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value = value.copy()
                value.setflags(write=False)
                object.__setattr__(self, item.name, value)

    @property
    def position_error(self) -> Array:
        """INS minus truth (north, east), m, shape (N, 2)."""
        return np.stack(
            separation(self.latitude, self.longitude, self.true_latitude, self.true_longitude), axis=-1
        )

    @property
    def velocity_error(self) -> Array:
        """INS minus truth (north, east), m/s, shape (N, 2)."""
        return self.velocity - self.true_velocity
