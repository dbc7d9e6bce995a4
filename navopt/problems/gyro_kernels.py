"""Compiled losses, residuals and Jacobians of sensor triads, one candidate at a time.

A candidate is the full vector of twelve parameters (gyros) or of twenty-four (gyros, then
accelerometers), in the order of `navopt.models.triad.PARAMETER_NAMES`. Records are transposed, (3, m), so
that positions lie contiguous in memory. Nothing crosses the candidates, so a candidate has the same bits
alone and in any batch.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = [
    "invariant_losses",
    "invariant_residuals",
    "invariant_slopes",
    "norm_losses",
    "norm_residuals",
    "norm_slopes",
    "turntable_losses",
    "turntable_residuals",
    "turntable_slopes",
]

_compiled = njit(cache=True, nogil=True, error_model="numpy")

#: Determinant of the misalignment matrix (one if perfect) below which the sensors lie in a plane.
_FLAT = 1e-9


@_compiled
def _invert(v, first, matrix, offset):
    """Fill ``x = matrix counts + offset``, the inverse of the triad at v[first:]; False if there is none."""
    a, b, c = v[first + 6], v[first + 7], v[first + 8]
    d, e, f = v[first + 9], v[first + 10], v[first + 11]
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = 1.0 - d * f, b * f - a, a * d - b
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = d * e - c, 1.0 - b * e, b * c - d
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = c * f - e, a * e - f, 1.0 - a * c
    determinant = matrix[0, 0] + a * matrix[1, 0] + b * matrix[2, 0]
    if not abs(determinant) > _FLAT or v[first] == 0.0 or v[first + 1] == 0.0 or v[first + 2] == 0.0:
        return False
    for i in range(3):
        offset[i] = 0.0
        for k in range(3):
            matrix[i, k] /= determinant
            offset[i] -= matrix[i, k] * v[first + 3 + k]
        for k in range(3):
            matrix[i, k] /= v[first + k]
    return True


@_compiled
def _excess(matrix, offset, counts, j, square):
    """Squared norm of what position j measures, minus `square`."""
    x = matrix[0, 0] * counts[0, j] + matrix[0, 1] * counts[1, j] + matrix[0, 2] * counts[2, j] + offset[0]
    y = matrix[1, 0] * counts[0, j] + matrix[1, 1] * counts[1, j] + matrix[1, 2] * counts[2, j] + offset[1]
    z = matrix[2, 0] * counts[0, j] + matrix[2, 1] * counts[1, j] + matrix[2, 2] * counts[2, j] + offset[2]
    return x * x + y * y + z * z - square


@_compiled
def _squared_excesses(matrix, offset, x, y, z, square, out):
    """Squares of the excesses of all positions; without a sum, so that several go at once."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 0], matrix[1, 1], matrix[1, 2]
    g, h, i = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    o, p, q = offset[0], offset[1], offset[2]
    for j in range(x.shape[0]):
        u = a * x[j] + b * y[j] + c * z[j] + o
        v = d * x[j] + e * y[j] + f * z[j] + p
        w = g * x[j] + h * y[j] + i * z[j] + q
        excess = u * u + v * v + w * w - square
        out[j] = excess * excess


@_compiled
def norm_losses(X, counts, square, unit, out):
    """Equation (14): root of the sum of squared excesses over m - 1, divided by `unit`; X (n, p) -> out (n,).

    +inf where a candidate has no inverse.
    """
    matrix, offset = np.empty((3, 3)), np.empty(3)
    m = counts.shape[1]
    squares = np.empty(m)
    for c in range(X.shape[0]):
        if not _invert(X[c], 0, matrix, offset):
            out[c] = np.inf
            continue
        _squared_excesses(matrix, offset, counts[0], counts[1], counts[2], square, squares)
        # four sums side by side, in an order of their own: the processor need not wait for each addition
        one, two, three, four = 0.0, 0.0, 0.0, 0.0
        whole = m - m % 4
        for j in range(0, whole, 4):
            one += squares[j]
            two += squares[j + 1]
            three += squares[j + 2]
            four += squares[j + 3]
        for j in range(whole, m):
            one += squares[j]
        value = math.sqrt(((one + two) + (three + four)) / (m - 1)) / unit
        out[c] = np.inf if math.isnan(value) else value


@_compiled
def norm_residuals(X, counts, square, sigma, out):
    """Excesses over sigma; X (n, p) -> out (n, m); +inf where a candidate has no inverse."""
    matrix, offset = np.empty((3, 3)), np.empty(3)
    for c in range(X.shape[0]):
        if not _invert(X[c], 0, matrix, offset):
            out[c] = np.inf
            continue
        for j in range(counts.shape[1]):
            out[c, j] = _excess(matrix, offset, counts, j, square) / sigma


@_compiled
def _value(matrix, offset, counts, j, x):
    for i in range(3):
        x[i] = (
            matrix[i, 0] * counts[0, j]
            + matrix[i, 1] * counts[1, j]
            + matrix[i, 2] * counts[2, j]
            + offset[i]
        )


@_compiled
def _slope(v, first, matrix, counts, j, x, toward, factor, out):
    """Add ``factor * toward . dx/dparameter`` to out[first:first + 12]; x is what position j measures.

    With W the inverse of E: dx/dscale_i = -W e_i counts_i / scale_i^2, dx/dbias_i = -W e_i and
    dx/dE_ik = -W e_i x_k.
    """
    for i in range(3):
        # toward . W e_i; the columns of `matrix` are those of W over the scale factors
        g = (
            factor
            * v[first + i]
            * (toward[0] * matrix[0, i] + toward[1] * matrix[1, i] + toward[2] * matrix[2, i])
        )
        out[first + i] -= g * counts[i, j] / v[first + i] ** 2
        out[first + 3 + i] -= g
        # the two other axes, in the order xy xz yx yz zx zy
        out[first + 6 + 2 * i] -= g * x[0 if i else 1]
        out[first + 7 + 2 * i] -= g * x[1 if i == 2 else 2]


@_compiled
def norm_slopes(X, counts, sigma, out):
    """Derivatives of `norm_residuals`; X (n, p) -> out (n, m, p); NaN where there is no inverse."""
    matrix, offset, x = np.empty((3, 3)), np.empty(3), np.empty(3)
    for c in range(X.shape[0]):
        if not _invert(X[c], 0, matrix, offset):
            out[c] = np.nan
            continue
        out[c] = 0.0
        for j in range(counts.shape[1]):
            _value(matrix, offset, counts, j, x)
            _slope(X[c], 0, matrix, counts, j, x, x, 2.0 / sigma, out[c, j])


@_compiled
def _three(first, one, second, two, counts, forces, j, squares, whitening, x, y, out):
    """Whitened excesses of the rate norm, the force norm and the product of rate and force at position j."""
    _value(first, one, counts, j, x)
    _value(second, two, forces, j, y)
    rate = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] - squares[0]
    force = y[0] * y[0] + y[1] * y[1] + y[2] * y[2] - squares[1]
    product = x[0] * y[0] + x[1] * y[1] + x[2] * y[2] - squares[2]
    for i in range(3):
        out[i] = whitening[i, 0] * rate + whitening[i, 1] * force + whitening[i, 2] * product


@_compiled
def invariant_losses(X, counts, forces, squares, whitening, out):
    """Root mean square of the whitened invariants; X (n, 24) -> out (n,); +inf without inverse."""
    first, one, second, two = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    x, y, three = np.empty(3), np.empty(3), np.empty(3)
    for c in range(X.shape[0]):
        if not (_invert(X[c], 0, first, one) and _invert(X[c], 12, second, two)):
            out[c] = np.inf
            continue
        total = 0.0
        for j in range(counts.shape[1]):
            _three(first, one, second, two, counts, forces, j, squares, whitening, x, y, three)
            total += three[0] ** 2 + three[1] ** 2 + three[2] ** 2
        value = math.sqrt(total / (3 * counts.shape[1]))
        out[c] = np.inf if math.isnan(value) else value


@_compiled
def invariant_residuals(X, counts, forces, squares, whitening, out):
    """Whitened invariants, position by position; X (n, 24) -> out (n, 3 m); +inf without inverse."""
    first, one, second, two = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    x, y = np.empty(3), np.empty(3)
    for c in range(X.shape[0]):
        if not (_invert(X[c], 0, first, one) and _invert(X[c], 12, second, two)):
            out[c] = np.inf
            continue
        for j in range(counts.shape[1]):
            _three(
                first,
                one,
                second,
                two,
                counts,
                forces,
                j,
                squares,
                whitening,
                x,
                y,
                out[c, 3 * j : 3 * j + 3],
            )


@_compiled
def invariant_slopes(X, counts, forces, whitening, out):
    """Derivatives of `invariant_residuals`; X (n, 24) -> out (n, 3 m, 24); NaN without inverse."""
    first, one, second, two = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    x, y = np.empty(3), np.empty(3)
    for c in range(X.shape[0]):
        if not (_invert(X[c], 0, first, one) and _invert(X[c], 12, second, two)):
            out[c] = np.nan
            continue
        out[c] = 0.0
        for j in range(counts.shape[1]):
            _value(first, one, counts, j, x)
            _value(second, two, forces, j, y)
            for i in range(3):
                row = out[c, 3 * j + i]
                _slope(X[c], 0, first, counts, j, x, x, 2.0 * whitening[i, 0], row)
                _slope(X[c], 0, first, counts, j, x, y, whitening[i, 2], row)
                _slope(X[c], 12, second, forces, j, y, y, 2.0 * whitening[i, 1], row)
                _slope(X[c], 12, second, forces, j, y, x, whitening[i, 2], row)


@_compiled
def _model(v, i, rates, j):
    """Rate that the sensor i shows at position j, bias included."""
    k, l = 1 if i == 0 else 0, 1 if i == 2 else 2
    return rates[i, j] + v[6 + 2 * i] * rates[k, j] + v[7 + 2 * i] * rates[l, j] + v[3 + i]


@_compiled
def turntable_losses(X, counts, rates, scale, unit, out):
    """Root mean square of measured minus modelled counts over `scale` (3,), divided by `unit`."""
    m = counts.shape[1]
    for c in range(X.shape[0]):
        total = 0.0
        for i in range(3):
            for j in range(m):
                total += ((counts[i, j] - X[c, i] * _model(X[c], i, rates, j)) / scale[i]) ** 2
        value = math.sqrt(total / (3 * m)) / unit
        out[c] = np.inf if math.isnan(value) else value


@_compiled
def turntable_residuals(X, counts, rates, scale, sigma, out):
    """Measured minus modelled counts over scale and sigma, position by position; out (n, 3 m)."""
    for c in range(X.shape[0]):
        for j in range(counts.shape[1]):
            for i in range(3):
                difference = counts[i, j] - X[c, i] * _model(X[c], i, rates, j)
                out[c, 3 * j + i] = difference / (scale[i] * sigma)


@_compiled
def turntable_slopes(X, rates, scale, sigma, out):
    """Derivatives of `turntable_residuals`; X (n, p) -> out (n, 3 m, p)."""
    for c in range(X.shape[0]):
        out[c] = 0.0
        for j in range(rates.shape[1]):
            for i in range(3):
                row, unit = out[c, 3 * j + i], scale[i] * sigma
                row[i] = -_model(X[c], i, rates, j) / unit
                row[3 + i] = -X[c, i] / unit
                row[6 + 2 * i] = -X[c, i] * rates[1 if i == 0 else 0, j] / unit
                row[7 + 2 * i] = -X[c, i] * rates[1 if i == 2 else 2, j] / unit
