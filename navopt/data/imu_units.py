"""Units of gyro and accelerometer samples: factors to SI, and which unit numbers without one may have."""

from __future__ import annotations

import numpy as np

from navopt.errors import UnknownName
from navopt.models.earth import EARTH_RATE, GRAVITY

__all__ = [
    "ACCELEROMETER_UNITS",
    "GYRO_UNITS",
    "TIME_UNITS",
    "accelerometer_factor",
    "counts_zero",
    "gyro_factor",
    "suspected_accelerometer_unit",
    "suspected_gyro_unit",
]

#: rad/s in one of each unit.
GYRO_UNITS = {
    "rad/s": 1.0,
    "deg/s": float(np.radians(1.0)),
    "mdeg/s": float(np.radians(1e-3)),
    "deg/h": float(np.radians(1.0) / 3600.0),
}
#: m/s2 in one of each unit.
ACCELEROMETER_UNITS = {"m/s2": 1.0, "g": GRAVITY, "mg": 1e-3 * GRAVITY}
#: Seconds in one of each unit.
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: Rates at which a hand turns a unit at its fastest, rad/s: from a slow turn to the range of MEMS gyros.
HAND_RATES = (0.3, 60.0)
#: A mean rate that differs from the Earth's by less than this factor may be the Earth's.
EARTH_FACTOR = 1.5


def gyro_factor(unit: str) -> float | None:
    """Return rad/s per unit, None for counts.

    Raises
    ------
    UnknownName
        If there is no such unit.
    """
    return _factor("--gyro-unit", unit, GYRO_UNITS)


def accelerometer_factor(unit: str) -> float | None:
    """Return m/s2 per unit, None for counts.

    Raises
    ------
    UnknownName
        If there is no such unit.
    """
    return _factor("--accelerometer-unit", unit, ACCELEROMETER_UNITS)


def _factor(option: str, unit: str, known: dict[str, float]) -> float | None:
    if unit == "counts":
        return None
    if unit not in known:
        raise UnknownName(option, unit, [*known, "counts"])
    return known[unit]


def suspected_gyro_unit(samples: np.ndarray) -> tuple[str, str]:
    """Return the unit that rates without one may have, and why.

    Two facts are used: a unit at rest measures the Earth's 15.04 deg/h (or a bias, so this only counts
    where the numbers are so small that a hand cannot have moved it), and a hand turns a unit at between
    17 deg/s and the range of its gyros at most.

    Parameters
    ----------
    samples : ndarray, shape (N, 3)
        Rates.

    Returns
    -------
    unit, reason : str
        The unit is empty where nothing fits.
    """
    if not len(samples):
        return "", "no sample is finite"
    mean = float(np.linalg.norm(np.mean(samples, axis=0)))
    peak = float(np.abs(samples - np.median(samples, axis=0)).max())
    whole = bool(np.all(samples == np.round(samples)))
    for unit, factor in GYRO_UNITS.items():
        earth = mean * factor / EARTH_RATE
        if 1.0 / EARTH_FACTOR < earth < EARTH_FACTOR and peak * factor < HAND_RATES[0]:
            return unit, f"the mean rate is {earth:.2f} times the Earth's if it is in {unit}"
    if whole and peak > 500.0:
        return "counts", f"all samples are whole numbers and reach {peak:.0f}"
    for unit, factor in GYRO_UNITS.items():
        if HAND_RATES[0] < peak * factor < HAND_RATES[1]:
            return (
                unit,
                f"the fastest turn is {np.degrees(peak * factor):.0f} degrees per second if it is in {unit}",
            )
    return "", f"the largest sample is {peak:g} from the median"


def suspected_accelerometer_unit(samples: np.ndarray) -> tuple[str, str]:
    """Return the unit that specific forces without one may have, and why.

    Parameters
    ----------
    samples : ndarray, shape (N, 3)
        Specific forces.

    Returns
    -------
    unit, reason : str
        The unit in which the median norm is within 20 % of gravity, ``"counts"`` for other whole numbers,
        empty where nothing fits.
    """
    if not len(samples):
        return "", "no sample is finite"
    norm = float(np.median(np.linalg.norm(samples, axis=1)))
    for unit, factor in ACCELEROMETER_UNITS.items():
        if 0.8 < norm * factor / GRAVITY < 1.2:
            return unit, f"the median norm is {norm:.4g}, which is gravity in {unit}"
    if np.all(samples == np.round(samples)):
        return "counts", "all samples are whole numbers"
    return "", f"the median norm is {norm:.4g}"


def counts_zero(samples: np.ndarray) -> float:
    """Return the count that stands for zero in samples without sign.

    Parameters
    ----------
    samples : ndarray
        Raw counts.

    Returns
    -------
    float
        0 where there are negative samples or the samples lie far from mid-range; else half the smallest
        power of two that exceeds them all.
    """
    if not samples.size:
        return 0.0
    top = float(samples.max())
    if samples.min() < 0 or top < 256:
        return 0.0
    half = 2.0 ** (np.floor(np.log2(top)))
    return float(half) if 0.5 * half < np.median(samples) < 1.5 * half else 0.0
