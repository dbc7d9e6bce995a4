"""Compiled look-up in a uniform grid: bilinear and cubic B-spline, with gradients.

Every function works on one point, in *fractional indices* (row along latitude, column along
longitude, both counted from zero), so that another numba kernel can call it inside its own loop.
:func:`fractional_index` turns a latitude and a longitude into such indices. Outside the grid, and for
a NaN, the answer is NaN: nothing is ever extrapolated. No fast-math and no contraction, so a point
has the same bits alone and in any batch.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

__all__ = [
    "EDGE",
    "bilinear_at",
    "bilinear_gradient_at",
    "bilinear_gradient_many",
    "bilinear_many",
    "bspline_at",
    "bspline_gradient_at",
    "bspline_gradient_many",
    "bspline_many",
    "fractional_index",
    "inside_many",
]

#: How far outside the grid, in cells, still counts as on its last line: room for the rounding of a
#: degree-radian conversion (2 micrometres on a 1' grid), too little for anyone to extrapolate with.
EDGE = 1e-9

# numpy's error model: no exceptions inside, hence no status to check after each call.
_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")

_TURN = 2.0 * math.pi
_NAN = math.nan
_SIXTH = 1.0 / 6.0
_ONE, _TWO, _THREE = np.uint64(1), np.uint64(2), np.uint64(3)


@_compiled
def fractional_index(latitude, longitude, lat0, lon0, dlat, dlon, n_rows, n_columns):
    """Row and column of a point, or NaN for both when it lies outside the grid.

    Longitudes are taken modulo one turn, so that -170° and 190° are the same point.

    Parameters
    ----------
    latitude, longitude : float
        The point, in radians.
    lat0, lon0, dlat, dlon : float
        First grid lines and steps, in radians (see ``FieldMap.grid``).
    n_rows, n_columns : int
        Shape of the grid.

    Returns
    -------
    row, column : float
        In ``[0, n_rows - 1]`` and ``[0, n_columns - 1]``, or both NaN.
    """
    # By the reciprocals, which a loop around this call computes once.
    per_lat = 1.0 / dlat
    per_lon = 1.0 / dlon
    row = (latitude - lat0) * per_lat
    east = longitude - lon0
    column = east * per_lon
    last_row = n_rows - 1.0
    last_column = n_columns - 1.0
    # Written as "not inside" rather than "outside", so that NaN takes the branch too.
    if not (column >= -EDGE and column <= last_column + EDGE):
        east -= _TURN * math.floor(east / _TURN)
        column = east * per_lon
        if column > last_column + EDGE:
            column = (east - _TURN) * per_lon  # just west of the first line, by rounding
        if not (column >= -EDGE and column <= last_column + EDGE):
            return _NAN, _NAN
    if not (row >= -EDGE and row <= last_row + EDGE):
        return _NAN, _NAN
    return min(max(row, 0.0), last_row), min(max(column, 0.0), last_column)


@_compiled
def _cell(index, last):
    """Lower line of the cell and the part of it passed; `index` in ``[0, last]``.

    The line comes back unsigned: with a signed index every array access would pay for the test
    whether to count from the end.
    """
    lower = min(np.int64(index), last - 1)
    return np.uint64(lower), index - lower


@_compiled
def _outside(row, column, n_rows, n_columns):
    """Whether indices are off the grid; a NaN is."""
    return not (row >= 0.0 and row <= n_rows - 1.0 and column >= 0.0 and column <= n_columns - 1.0)


@_compiled
def bilinear_at(values, row, column):
    """Bilinear value at fractional indices.

    Parameters
    ----------
    values : ndarray, shape (n_rows, n_columns)
        The grid, C-contiguous float64.
    row, column : float
        Fractional indices.

    Returns
    -------
    float
        NaN outside the grid.
    """
    n_rows, n_columns = values.shape
    if _outside(row, column, n_rows, n_columns):
        return _NAN
    i, v = _cell(row, n_rows - 1)
    j, u = _cell(column, n_columns - 1)
    south = values[i, j] * (1.0 - u) + values[i, j + _ONE] * u
    north = values[i + _ONE, j] * (1.0 - u) + values[i + _ONE, j + _ONE] * u
    return south * (1.0 - v) + north * v


@_compiled
def bilinear_gradient_at(values, row, column):
    """Bilinear value and its derivatives per row and per column.

    On a line between cells the derivative jumps; the value of the cell to the north and east is
    returned there (to the south and west on the last line).

    Parameters
    ----------
    values : ndarray, shape (n_rows, n_columns)
        The grid, C-contiguous float64.
    row, column : float
        Fractional indices.

    Returns
    -------
    value, per_row, per_column : float
        NaN outside the grid.
    """
    n_rows, n_columns = values.shape
    if _outside(row, column, n_rows, n_columns):
        return _NAN, _NAN, _NAN
    i, v = _cell(row, n_rows - 1)
    j, u = _cell(column, n_columns - 1)
    sw = values[i, j]
    se = values[i, j + _ONE]
    nw = values[i + _ONE, j]
    ne = values[i + _ONE, j + _ONE]
    south = sw * (1.0 - u) + se * u
    north = nw * (1.0 - u) + ne * u
    return south * (1.0 - v) + north * v, north - south, (se - sw) * (1.0 - v) + (ne - nw) * v


@_compiled
def _weights(t):
    """Cubic B-spline weights of the four neighbours, ``0 <= t <= 1`` from the second."""
    s = 1.0 - t
    return (
        s * s * s * _SIXTH,
        2.0 / 3.0 - 0.5 * t * t * (2.0 - t),
        2.0 / 3.0 - 0.5 * s * s * (2.0 - s),
        t * t * t * _SIXTH,
    )


@_compiled
def _slopes(t):
    """Differentiate :func:`_weights` by ``t``."""
    s = 1.0 - t
    return (-0.5 * s * s, t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s), 0.5 * t * t)


@_compiled
def _row_sum(coefficients, i, j, w):
    """Weighted sum of four neighbours along one row."""
    return (
        coefficients[i, j] * w[0]
        + coefficients[i, j + _ONE] * w[1]
        + coefficients[i, j + _TWO] * w[2]
        + coefficients[i, j + _THREE] * w[3]
    )


@_compiled
def bspline_at(coefficients, row, column):
    """Cubic B-spline value at fractional indices of the *grid*.

    Parameters
    ----------
    coefficients : ndarray, shape (n_rows + 2, n_columns + 2)
        ``FieldMap.spline_grid[0]``: the prefiltered grid with one mirrored line on each side, which
        spares the kernel every border case.
    row, column : float
        Fractional indices in the grid (not in the padded array).

    Returns
    -------
    float
        NaN outside the grid.
    """
    n_rows = coefficients.shape[0] - 2
    n_columns = coefficients.shape[1] - 2
    if _outside(row, column, n_rows, n_columns):
        return _NAN
    i, v = _cell(row, n_rows - 1)
    j, u = _cell(column, n_columns - 1)
    w = _weights(u)
    p = _weights(v)
    return (
        _row_sum(coefficients, i, j, w) * p[0]
        + _row_sum(coefficients, i + _ONE, j, w) * p[1]
        + _row_sum(coefficients, i + _TWO, j, w) * p[2]
        + _row_sum(coefficients, i + _THREE, j, w) * p[3]
    )


@_compiled
def bspline_gradient_at(coefficients, row, column):
    """Cubic B-spline value and its derivatives per row and per column.

    Parameters
    ----------
    coefficients : ndarray, shape (n_rows + 2, n_columns + 2)
        As for :func:`bspline_at`.
    row, column : float
        Fractional indices in the grid.

    Returns
    -------
    value, per_row, per_column : float
        NaN outside the grid.
    """
    n_rows = coefficients.shape[0] - 2
    n_columns = coefficients.shape[1] - 2
    if _outside(row, column, n_rows, n_columns):
        return _NAN, _NAN, _NAN
    i, v = _cell(row, n_rows - 1)
    j, u = _cell(column, n_columns - 1)
    w = _weights(u)
    d = _slopes(u)
    p = _weights(v)
    q = _slopes(v)
    a0 = _row_sum(coefficients, i, j, w)
    a1 = _row_sum(coefficients, i + _ONE, j, w)
    a2 = _row_sum(coefficients, i + _TWO, j, w)
    a3 = _row_sum(coefficients, i + _THREE, j, w)
    per_column = (
        _row_sum(coefficients, i, j, d) * p[0]
        + _row_sum(coefficients, i + _ONE, j, d) * p[1]
        + _row_sum(coefficients, i + _TWO, j, d) * p[2]
        + _row_sum(coefficients, i + _THREE, j, d) * p[3]
    )
    return (
        a0 * p[0] + a1 * p[1] + a2 * p[2] + a3 * p[3],
        a0 * q[0] + a1 * q[1] + a2 * q[2] + a3 * q[3],
        per_column,
    )


@_compiled
def inside_many(n_rows, n_columns, lat0, lon0, dlat, dlon, latitude, longitude, out):
    """Fill ``out`` with whether each point lies on the grid."""
    for k in range(latitude.size):
        row, _ = fractional_index(latitude[k], longitude[k], lat0, lon0, dlat, dlon, n_rows, n_columns)
        out[k] = not np.isnan(row)


@_compiled
def bilinear_many(values, lat0, lon0, dlat, dlon, latitude, longitude, out):
    """Fill ``out`` with bilinear values at many points (radians)."""
    n_rows, n_columns = values.shape
    for k in range(latitude.size):
        row, column = fractional_index(latitude[k], longitude[k], lat0, lon0, dlat, dlon, n_rows, n_columns)
        out[k] = bilinear_at(values, row, column)


@_compiled
def bspline_many(coefficients, lat0, lon0, dlat, dlon, latitude, longitude, out):
    """Fill ``out`` with B-spline values at many points (radians)."""
    n_rows = coefficients.shape[0] - 2
    n_columns = coefficients.shape[1] - 2
    for k in range(latitude.size):
        row, column = fractional_index(latitude[k], longitude[k], lat0, lon0, dlat, dlon, n_rows, n_columns)
        out[k] = bspline_at(coefficients, row, column)


@_compiled
def bilinear_gradient_many(values, lat0, lon0, dlat, dlon, latitude, longitude, out_lat, out_lon):
    """Fill the derivatives of the bilinear map per radian of latitude and longitude."""
    n_rows, n_columns = values.shape
    for k in range(latitude.size):
        row, column = fractional_index(latitude[k], longitude[k], lat0, lon0, dlat, dlon, n_rows, n_columns)
        _, per_row, per_column = bilinear_gradient_at(values, row, column)
        out_lat[k] = per_row / dlat
        out_lon[k] = per_column / dlon


@_compiled
def bspline_gradient_many(coefficients, lat0, lon0, dlat, dlon, latitude, longitude, out_lat, out_lon):
    """Fill the derivatives of the B-spline map per radian of latitude and longitude."""
    n_rows = coefficients.shape[0] - 2
    n_columns = coefficients.shape[1] - 2
    for k in range(latitude.size):
        row, column = fractional_index(latitude[k], longitude[k], lat0, lon0, dlat, dlon, n_rows, n_columns)
        _, per_row, per_column = bspline_gradient_at(coefficients, row, column)
        out_lat[k] = per_row / dlat
        out_lon[k] = per_column / dlon
