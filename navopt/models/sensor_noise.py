"""Noise of gyros and accelerometers from the figures of a data sheet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import GRAVITY
from navopt.models.triad import DEGREE_PER_HOUR

__all__ = ["AccelerometerNoise", "GyroNoise"]

Array = NDArray[np.float64]

_DEGREE_PER_ROOT_HOUR = float(np.pi / 180.0 / 60.0)


@dataclass(frozen=True, kw_only=True)
class _TriadNoise:
    """What both kinds of sensors share: white noise that averages down, and a floor that does not."""

    bias_instability: float = 0.0
    scale_stability: float = 0.0
    range: float = np.inf
    quantisation: float = 0.0

    _white = ""

    def __post_init__(self) -> None:
        for name in (self._white, "bias_instability", "scale_stability", "quantisation", "range"):
            value = getattr(self, name)
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not number or not value >= 0.0 or (name != "range" and not np.isfinite(value)):
                raise InvalidInput(name, value, "give a number, zero or more")
        if self.range == 0.0:
            raise InvalidInput("range", self.range, "give a positive range; leave it out if there is none")

    @property
    def white(self) -> float:
        """Coefficient of the white noise: standard deviation of the mean over one second."""
        return float(getattr(self, self._white))

    def averaged_sigma(self, averaging_time_s: float) -> float:
        """Return the standard deviation of one channel's mean over a stationary position.

        Parameters
        ----------
        averaging_time_s : float
            s.

        Returns
        -------
        float
            sqrt(random walk² / time + bias instability²), rad/s or m/s²: white noise averages down, the bias
            wanders from position to position by its instability however long one waits.
        """
        time = averaging_time_s
        number = isinstance(time, int | float | np.number) and not isinstance(time, bool)
        if not number or not np.isfinite(time) or time <= 0.0:
            raise InvalidInput("averaging_time_s", time, "give a positive time in seconds")
        return float(np.hypot(self.white / np.sqrt(time), self.bias_instability))

    def draw(self, rng: np.random.Generator, n: int, averaging_time_s: float) -> Array:
        """Draw the errors of n averaged positions.

        Parameters
        ----------
        rng : numpy.random.Generator
            Source of randomness; 3 n normal numbers are taken.
        n : int
            Number of positions.
        averaging_time_s : float
            Time averaged at each, s.

        Returns
        -------
        ndarray, shape (n, 3)
            rad/s or m/s²; independent, each of standard deviation `averaged_sigma`.
        """
        return self.averaged_sigma(averaging_time_s) * rng.standard_normal((n, 3))

    def quantise(self, counts: Any) -> Array:
        """Round counts to the quantisation step; as they are if it is zero."""
        values = np.asarray(counts, dtype=np.float64)
        return (
            self.quantisation * np.round(values / self.quantisation) if self.quantisation else values.copy()
        )


@dataclass(frozen=True, kw_only=True)
class GyroNoise(_TriadNoise):
    """Noise of a triad of gyros.

    Parameters
    ----------
    angle_random_walk : float
        rad/√s.
    bias_instability : float
        rad/s: what the bias does between positions, taken as independent normal steps.
    scale_stability : float
        Relative 1σ change of the scale factors from switch-on to switch-on.
    range : float
        Largest rate of either sign, rad/s.
    quantisation : float
        Step of the averaged output, counts.

    Raises
    ------
    InvalidInput
        If a value is negative or not a number.

    Notes
    -----
    Bias instability is the floor of the Allan deviation, a flicker noise. Here the means of two positions are
    taken to err independently, the usual reading when positions are minutes apart.

    Examples
    --------
    Table 4 of Gao et al. (2015), averaged for five minutes, in °/h:

    >>> noise = GyroNoise.from_datasheet(deg_sqrt_h=0.0005, deg_h=0.005)
    >>> round(noise.averaged_sigma(300.0) / DEGREE_PER_HOUR, 5)
    0.00529
    """

    angle_random_walk: float = 0.0

    _white = "angle_random_walk"

    @classmethod
    def from_datasheet(
        cls, deg_sqrt_h: float, deg_h: float = 0.0, ppm: float = 0.0, deg_s: float = np.inf, **others: float
    ) -> GyroNoise:
        """Build from the units of data sheets.

        Parameters
        ----------
        deg_sqrt_h : float
            Angle random walk, °/√h.
        deg_h : float
            Bias instability, °/h.
        ppm : float
            Scale-factor stability, parts per million.
        deg_s : float
            Range of either sign, °/s.
        **others
            Other fields.

        Returns
        -------
        GyroNoise
        """
        return cls(
            angle_random_walk=deg_sqrt_h * _DEGREE_PER_ROOT_HOUR,
            bias_instability=deg_h * DEGREE_PER_HOUR,
            scale_stability=ppm * 1e-6,
            range=float(np.radians(deg_s)),
            **others,
        )


@dataclass(frozen=True, kw_only=True)
class AccelerometerNoise(_TriadNoise):
    """Noise of a triad of accelerometers.

    Parameters
    ----------
    velocity_random_walk : float
        m/s/√s.
    bias_instability : float
        m/s²: what the bias does between positions, taken as independent normal steps.
    scale_stability : float
        Relative 1σ change of the scale factors from switch-on to switch-on.
    range : float
        Largest specific force of either sign, m/s².
    quantisation : float
        Step of the averaged output, counts.

    Raises
    ------
    InvalidInput
        If a value is negative or not a number.
    """

    velocity_random_walk: float = 0.0

    _white = "velocity_random_walk"

    @classmethod
    def from_datasheet(
        cls, ug_sqrt_hz: float, ug: float = 0.0, ppm: float = 0.0, g: float = np.inf, **others: float
    ) -> AccelerometerNoise:
        """Build from the units of data sheets.

        Parameters
        ----------
        ug_sqrt_hz : float
            Velocity random walk, µg/√Hz.
        ug : float
            Bias instability, µg.
        ppm : float
            Scale-factor stability, parts per million.
        g : float
            Range of either sign, multiples of standard gravity.
        **others
            Other fields.

        Returns
        -------
        AccelerometerNoise
        """
        return cls(
            velocity_random_walk=ug_sqrt_hz * 1e-6 * GRAVITY,
            bias_instability=ug * 1e-6 * GRAVITY,
            scale_stability=ppm * 1e-6,
            range=g * GRAVITY,
            **others,
        )
