"""What is wrong with a calibration record: gaps, dead channels, the wrong unit, too much noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE
from navopt.models.triad import DEGREE_PER_HOUR, SensorTriad

__all__ = ["check_noise", "check_norms", "check_record", "rate_unit"]

Array = NDArray[np.float64]

_UNITS = {"rad/s": 1.0, "deg/s": float(np.pi / 180.0), "deg/h": DEGREE_PER_HOUR}
#: How far from the Earth rate a median norm may be: biases and scale factors are still unknown.
_NEAR = 2.0


def rate_unit(rates: ArrayLike) -> str | None:
    """Guess the unit of stationary rates: that in which their norm is the Earth rate.

    Parameters
    ----------
    rates : array_like, shape (n, 3)
        Rates of a gyro triad at rest, in an unknown unit.

    Returns
    -------
    {"rad/s", "deg/s", "deg/h"} or None
        The unit in which the median norm is within a factor of two of the Earth rate; None if there is none,
        as with gyros whose biases are larger than the Earth rate.

    Examples
    --------
    >>> rate_unit([[15.0, 0.0, 1.0], [0.0, -15.1, 0.0]])
    'deg/h'
    """
    norm = float(np.median(np.linalg.norm(np.asarray(rates, dtype=np.float64), axis=-1)))
    for unit, factor in _UNITS.items():
        if EARTH_RATE / _NEAR < norm * factor < EARTH_RATE * _NEAR:
            return unit
    return None


def check_record(name: str, counts: Any, triad: SensorTriad, limit: float) -> Array:
    """Return a record as an array of shape (m, 3), or refuse it.

    Parameters
    ----------
    name : str
        Argument, for messages.
    counts : array_like, shape (m, 3)
        Averaged output at each position.
    triad : SensorTriad
        What is assumed of the sensors, to tell saturation.
    limit : float
        Their range, in the unit of what is measured; infinite if unknown.

    Returns
    -------
    ndarray, shape (m, 3)

    Raises
    ------
    InvalidInput
        If the shape is wrong, there are fewer than two positions, a value is not finite, or a channel is
        stuck or beyond its range.
    """
    try:
        record = np.array(counts, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInput(name, counts, "give numbers of shape (positions, 3)") from None
    if record.ndim != 2 or record.shape[1] != 3:
        raise InvalidInput(name, f"shape {record.shape}", "give one row per position: shape (positions, 3)")
    if len(record) < 2:
        raise InvalidInput(
            name, f"{len(record)} position(s)", "give at least two; nine or more say something"
        )
    bad = np.argwhere(~np.isfinite(record))
    if len(bad):
        position, channel = bad[0]
        raise InvalidInput(
            name,
            f"{record[position, channel]} in channel {'xyz'[channel]} of position {position}",
            "leave positions out that have gaps; average over finite samples only",
        )
    still = np.ptp(record, axis=0) == 0.0
    if still.any() and not still.all():
        channel = int(np.flatnonzero(still)[0])
        raise InvalidInput(
            name,
            f"channel {'xyz'[channel]} reads {record[0, channel]:g} at each of {len(record)} positions",
            "it is stuck or saturated, for the other channels do change: repair it, or check the columns",
        )
    over = np.argwhere(np.abs(record / triad.scale) >= limit)
    if len(over):
        position, channel = over[0]
        raise InvalidInput(
            name,
            f"channel {'xyz'[channel]} of position {position} is at its range ({limit:g})",
            "it is saturated: leave the position out or use a slower rate",
        )
    return record


def check_norms(name: str, rates: Array, *, expected: float = EARTH_RATE) -> None:
    """Refuse stationary rates whose norm is nowhere near the Earth rate, and ask about the unit.

    Parameters
    ----------
    name : str
        Argument, for messages.
    rates : ndarray, shape (m, 3)
        Rates at the assumed parameters, rad/s.
    expected : float
        The norm they should have.

    Raises
    ------
    InvalidInput
        If the median norm is off by more than a factor of five; with the unit that would explain it.
    """
    ratio = float(np.median(np.linalg.norm(rates, axis=1))) / expected
    if 0.2 < ratio < 5.0:
        return
    shown = f"rates with a median norm of {ratio * expected / DEGREE_PER_HOUR:.4g} deg/h"
    for given, factor in _UNITS.items():
        for assumed, other in _UNITS.items():
            if given != assumed and 1.0 / _NEAR < ratio * factor / other < _NEAR:
                raise InvalidInput(
                    name,
                    f"{shown}, the Earth turns with 15.04",
                    f"are they in {given}? They were taken for {assumed}: multiply them by "
                    f"{factor / other:.6g}, or divide the scale factors of `fixed` by it",
                )
    raise InvalidInput(
        name,
        f"{shown}, the Earth turns with 15.04",
        "check the scale factors of `fixed` and that the sensors were at rest: in no usual unit of rate "
        "(rad/s, deg/s, deg/h) is this the Earth rate",
    )


def check_noise(sigma: float, white: float, floor: float) -> None:
    """Refuse noise in which the norm of the Earth rate drowns.

    Parameters
    ----------
    sigma : float
        Standard deviation of one averaged channel, rad/s.
    white : float
        Its random walk, rad/sqrt(s), to say how long to average.
    floor : float
        Its bias instability, rad/s, which no averaging takes away.

    Raises
    ------
    InvalidInput
        If the noise of three channels together is as large as the Earth rate.
    """
    if not sigma > 0.0:
        raise InvalidInput(
            "noise",
            f"sigma {sigma:g} rad/s",
            "declare a positive random walk or instability, however small: residuals are in units of it",
        )
    if np.sqrt(3.0) * sigma < EARTH_RATE:
        return
    shown = f"{sigma / DEGREE_PER_HOUR:.3g} deg/h per averaged channel, against an Earth rate of 15.04"
    if np.sqrt(3.0) * floor < 0.5 * EARTH_RATE:
        needed = 3.0 * white**2 / (0.01 * EARTH_RATE**2)
        remedy = f"average each position for {needed:.3g} s or so, or "
    else:
        remedy = "averaging longer does not help against the bias instability: "
    raise InvalidInput(
        "noise",
        shown,
        remedy
        + "use known rates (a turntable), or the rotation between poses, instead of the Earth-rate norm",
    )
