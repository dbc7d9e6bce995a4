"""What goes wrong between a field and its measurement: noise, outliers, bias, drift and the Eötvös effect.

This is what happens in a simulated world. What a method is *told* about it is a
`navopt.problems.gravity_sensing.MeasurementErrors`, and the two may differ on purpose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE, MILLIGAL, principal_radii

__all__ = ["GravimeterErrors", "check_number", "eotvos_correction", "eotvos_error"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class GravimeterErrors:
    """How large the errors of a gravimeter are in a world, mGal.

    Parameters
    ----------
    noise : float
        Standard deviation of the noise of a sample.
    freedom : float, optional
        Noise from Student's t distribution with so many degrees of freedom, scaled to the standard deviation
        `noise`; normal if not given.
    outlier_fraction : float
        Probability that a sample has an additional error.
    outlier : float
        Standard deviation of that additional error, which is normal.
    bias : float
        1σ of the constant offset.
    drift_per_hour : float
        1σ of the constant drift, from zero at departure.

    Raises
    ------
    InvalidInput
        If a value is not finite or out of its range.
    """

    noise: float = 1.0
    freedom: float | None = None
    outlier_fraction: float = 0.0
    outlier: float = 20.0
    bias: float = 0.0
    drift_per_hour: float = 0.0

    def __post_init__(self) -> None:
        check_number("noise_mgal", self.noise, lambda v: v > 0.0, "give a positive standard deviation")
        if self.freedom is not None:
            remedy = "give more than 2 degrees of freedom: with fewer there is no standard deviation"
            check_number("noise_freedom", self.freedom, lambda v: v > 2.0, remedy)
        check_number(
            "outlier_fraction", self.outlier_fraction, lambda v: 0.0 <= v < 1.0, "give a share in [0, 1)"
        )
        for name, value in (
            ("outlier_mgal", self.outlier),
            ("bias_mgal", self.bias),
            ("drift_mgal_h", self.drift_per_hour),
        ):
            check_number(name, value, lambda v: v >= 0.0, "give a standard deviation, zero or more")

    def draw_noise(self, count: int, rng: np.random.Generator, outliers: np.random.Generator) -> Array:
        """Draw the noise of `count` samples, outliers included, mGal.

        Parameters
        ----------
        count : int
            Number of samples.
        rng, outliers : numpy.random.Generator
            Source of the noise, and that of the outliers: the noise is the same with them and without.

        Returns
        -------
        ndarray, shape (count,)
        """
        if self.freedom is None:
            drawn = self.noise * rng.standard_normal(count)
        else:
            drawn = self.noise * np.sqrt(1.0 - 2.0 / self.freedom) * rng.standard_t(self.freedom, count)
        if self.outlier_fraction:
            struck = outliers.random(count) < self.outlier_fraction
            drawn = drawn + np.where(struck, self.outlier * outliers.standard_normal(count), 0.0)
        return np.asarray(drawn)

    def draw_offset(self, time: Array, rng: np.random.Generator) -> Array:
        """Draw bias and drift of one instrument at times since departure (s), mGal; shape of `time`.

        Two normal numbers are taken from `rng`, always.
        """
        bias, drift = rng.standard_normal(2) * [self.bias, self.drift_per_hour]
        return np.asarray(bias + drift * np.asarray(time) / 3600.0)


def check_number(name: str, value: Any, accepted: Callable[[float], bool], remedy: str) -> float:
    """Return a finite number that is accepted, as a float, or refuse it.

    Parameters
    ----------
    name : str
        Argument, for the error message.
    value : object
        What was given.
    accepted : callable
        Whether a float can be used.
    remedy : str
        What to give instead.

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If it is not a number, not finite or not accepted.
    """
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (number and np.isfinite(value) and accepted(float(value))):
        raise InvalidInput(name, value, remedy)
    return float(value)


def eotvos_correction(latitude: ArrayLike, velocity: ArrayLike) -> Array:
    """Return what the motion of a vehicle takes off the gravity that it measures.

    Parameters
    ----------
    latitude : array_like, shape (...)
        rad.
    velocity : array_like, shape (..., 2)
        North and east over ground, m/s.

    Returns
    -------
    ndarray, shape (...)
        2 ω cos φ v_E + v_N²/R_M + v_E²/R_N, mGal: 14.58 cos φ mGal per m/s to the east, and some tenths of a
        milligal at a ship's speed.
    """
    lat = np.asarray(latitude, dtype=np.float64)
    north, east = np.moveaxis(np.asarray(velocity, dtype=np.float64), -1, 0)
    meridian, prime_vertical = principal_radii(lat)
    turning = 2.0 * EARTH_RATE * np.cos(lat) * east
    return np.asarray((turning + north**2 / meridian + east**2 / prime_vertical) / MILLIGAL)


def eotvos_error(latitude: ArrayLike, true_velocity: ArrayLike, velocity_error: ArrayLike) -> Array:
    """Return the error of an anomaly that was reduced with the velocity of an INS.

    Parameters
    ----------
    latitude : array_like, shape (...)
        True latitude, rad.
    true_velocity : array_like, shape (..., 2)
        North and east, m/s.
    velocity_error : array_like, shape (..., 2)
        INS minus truth, m/s.

    Returns
    -------
    ndarray, shape (...)
        Correction applied minus correction due, mGal.
    """
    true = np.asarray(true_velocity, dtype=np.float64)
    shown = true + np.asarray(velocity_error, dtype=np.float64)
    return eotvos_correction(latitude, shown) - eotvos_correction(latitude, true)
