"""Sensors with rates of their own, brought to the steps of a filter."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.filters.nonlinear import check_times

__all__ = ["align_measurements"]


def align_measurements(times: Any, sensors: Any) -> np.ndarray:
    """Measurements of several sensors, one row for each step of the filter and NaN where there is none.

    Parameters
    ----------
    times : array_like, shape (T,)
        Steps of the filter, s, increasing.
    sensors : sequence of (times, values)
        Times of each sensor, shape (K,), increasing, and its values, shape (K,) or (K, c). Sensors begin and
        end when they like. A measurement belongs to the nearest step; at equal distance to the later one.

    Returns
    -------
    ndarray, shape (T, all channels)

    Raises
    ------
    InvalidInput
        If times do not increase, a shape does not fit, two measurements of a sensor fall on one step (it
        measures faster than the filter predicts), or one lies more than half a step outside the record.

    Examples
    --------
    >>> align_measurements([0.0, 0.1, 0.2, 0.3], [([0.0, 0.2], [5.0, 6.0]), ([0.1], [[7.0, 8.0]])])
    array([[ 5., nan, nan],
           [nan,  7.,  8.],
           [ 6., nan, nan],
           [nan, nan, nan]])
    """
    t = check_times(times)
    if len(t) < 2:
        raise InvalidInput("times", f"{len(t)} step", "give at least two")
    middles = np.concatenate([[1.5 * t[0] - 0.5 * t[1]], 0.5 * (t[1:] + t[:-1]), [1.5 * t[-1] - 0.5 * t[-2]]])
    # times are rounded: what is half a step away on paper must not fall either way
    slack = 1e-9 * np.diff(t).min()
    columns = []
    for k, (when, values) in enumerate(sensors):
        own = check_times(when, f"times of sensor {k}")
        value = np.array(values, dtype=float)
        value = value[:, None] if value.ndim == 1 else value
        if value.ndim != 2 or len(value) != len(own):
            raise InvalidInput(
                f"values of sensor {k}", f"shape {value.shape}", f"give ({len(own)}, channels)"
            )
        rows = np.searchsorted(middles, own + slack, side="right") - 1
        outside = (rows < 0) | (rows >= len(t))
        if outside.any():
            first = float(own[np.argmax(outside)])
            raise InvalidInput(
                f"times of sensor {k}",
                f"{first:g} s",
                f"leave out what is not between {t[0]:g} s and {t[-1]:g} s",
            )
        twice = np.flatnonzero(np.diff(rows) == 0)
        if len(twice):
            j = int(twice[0])
            raise InvalidInput(
                f"times of sensor {k}",
                f"{own[j]:g} s and {own[j + 1]:g} s in the step at {t[rows[j]]:g} s",
                "the measurement rate is above the prediction rate: predict more often, or average",
            )
        column = np.full((len(t), value.shape[1]), np.nan)
        column[rows] = value
        columns.append(column)
    if not columns:
        raise InvalidInput("sensors", "none", "give at least one pair of times and values")
    return np.concatenate(columns, axis=1)
