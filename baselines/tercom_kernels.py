"""Compiled TERCOM: the criterion of every shift of a track on a map, row by row.

Along one row of hypotheses the latitudes of all points are fixed, so each point needs only two map
lines, blended once; its columns and their weights are the same for all rows. No hypothesis sees
another one, so the values do not depend on how the grid is cut.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["CORRELATION", "MAD", "MSD", "scan"]

MAD, MSD, CORRELATION = 0, 1, 2

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def scan(rows, columns, measured, north, east, values, criterion, remove_mean, out):
    """Fill `out` with the criterion (to be minimised) of every shift.

    Parameters
    ----------
    rows, columns : ndarray, shape (n,)
        Fractional map indices of the unshifted points.
    measured : ndarray, shape (n,)
        Measured field.
    north, east : ndarray
        Shifts in map rows and columns.
    values : ndarray, shape (n_rows, n_columns)
        The map.
    criterion : int
        `MAD`, `MSD` or `CORRELATION` (then minus the correlation coefficient).
    remove_mean : bool
        Whether to take the mean of measured minus map out first (a datum offset).
    out : ndarray, shape (len(north), len(east))
        Result; +inf where a point leaves the map.
    """
    n, n_east = rows.shape[0], east.shape[0]
    n_rows, n_columns = values.shape
    left = np.empty((n, n_east), np.int64)
    weight = np.empty((n, n_east))
    valid = np.ones(n_east, np.bool_)
    first, last = np.empty(n, np.int64), np.empty(n, np.int64)
    for k in range(n):
        first[k], last[k] = n_columns, -1
        for b in range(n_east):
            column = columns[k] + east[b]
            if not (column >= 0.0 and column <= n_columns - 1.0):
                valid[b] = False
                column = 0.0
            else:
                first[k] = min(first[k], min(np.int64(column), n_columns - 2))
                last[k] = max(last[k], min(np.int64(column), n_columns - 2) + 1)
            left[k, b] = min(np.int64(column), n_columns - 2)
            weight[k, b] = column - left[k, b]
    line = np.zeros(n_columns)
    mapped = np.empty((n, n_east))
    for a in range(north.shape[0]):
        inside = True
        for k in range(n):
            row = rows[k] + north[a]
            if not (row >= 0.0 and row <= n_rows - 1.0):
                inside = False
                break
            i = min(np.int64(row), n_rows - 2)
            v = row - i
            for j in range(first[k], last[k] + 1):
                line[j] = values[i, j] * (1.0 - v) + values[i + 1, j] * v
            for b in range(n_east):
                j, u = left[k, b], weight[k, b]
                mapped[k, b] = line[j] * (1.0 - u) + line[j + 1] * u
        if inside:
            _compare(measured, mapped, criterion, remove_mean, out[a])
            for b in range(n_east):
                if not valid[b]:
                    out[a, b] = np.inf
        else:
            out[a, :] = np.inf


@_compiled
def _compare(measured, mapped, criterion, remove_mean, out):
    """Fill one row of criteria from the mapped values, shape (n, n_east)."""
    n, n_east = mapped.shape
    offset = np.zeros(n_east)
    if remove_mean or criterion == CORRELATION:
        for k in range(n):
            for b in range(n_east):
                offset[b] += (measured[k] - mapped[k, b]) / n
    if criterion == CORRELATION:
        _correlate(measured, mapped, offset, out)
        return
    out[:] = 0.0
    for k in range(n):
        for b in range(n_east):
            difference = measured[k] - mapped[k, b] - offset[b]
            out[b] += abs(difference) if criterion == MAD else difference * difference
    for b in range(n_east):
        out[b] /= n


@_compiled
def _correlate(measured, mapped, offset, out):
    """Minus the correlation coefficient of each column; 1 where it is not defined."""
    n, n_east = mapped.shape
    mean = measured.mean()
    for b in range(n_east):
        cross = 0.0
        power_measured = 0.0
        power_mapped = 0.0
        for k in range(n):
            x = measured[k] - mean
            y = mapped[k, b] - (mean - offset[b])
            cross += x * y
            power_measured += x * x
            power_mapped += y * y
        power = math.sqrt(power_measured * power_mapped)
        out[b] = -cross / power if power > 0.0 else 1.0
