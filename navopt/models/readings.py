"""Checks of recorded inertial readings."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import InvalidInput

__all__ = ["checked_readings"]


def checked_readings(gyro: Any, accelerometer: Any, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Readings of both sensors as contiguous arrays.

    Parameters
    ----------
    gyro, accelerometer : array_like, shape (N, 3)
    step : float
        Seconds between readings.

    Raises
    ------
    InvalidInput
        If the readings are no finite arrays of one shape (N, 3), or the step is not positive.
    """
    w, f = (np.ascontiguousarray(v, dtype=np.float64) for v in (gyro, accelerometer))
    if w.ndim != 2 or w.shape[1:] != (3,) or w.shape != f.shape or not len(w):
        raise InvalidInput("gyro", f"shape {w.shape}", "give readings of both sensors, shape (N, 3)")
    if not (np.isfinite(w).all() and np.isfinite(f).all()):
        raise InvalidInput("gyro, accelerometer", "readings that are not finite", "leave no gaps")
    if not np.isfinite(step) or not step > 0.0:
        raise InvalidInput("step", step, "give a positive number of seconds")
    return w, f
