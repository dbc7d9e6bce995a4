"""Compiled losses, residuals and Jacobians of a transformed track on a map, one candidate at a time.

A candidate is ``(north, east, rotation, scale)``; its points are ``t + s R(rotation) q`` on the
tangent plane, turned into map rows and columns by constant factors. Nothing crosses the candidates,
so a candidate has the same bits alone and in any batch.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from navopt.models.field_map_kernels import (
    bilinear_at,
    bilinear_gradient_at,
    bspline_at,
    bspline_gradient_at,
    fractional_index,
)

__all__ = ["HUBER", "MAD", "MEAN_SQUARE", "losses", "residuals", "robust_losses", "slopes", "whiten"]

MAD, MEAN_SQUARE, HUBER = 0, 1, 2

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def _place(north, east, plane, origin, shape):
    """Row and column on the map of a point of the plane; NaN off the map."""
    latitude = plane[0] + north / plane[2]
    longitude = plane[1] + east / plane[3]
    return fractional_index(
        latitude, longitude, origin[0], origin[1], origin[2], origin[3], shape[0], shape[1]
    )


@_compiled
def _difference(x, cosine, sine, q, k, measured, plane, nodes, origin, shape, bicubic):
    """Measured minus mapped value at point k of candidate x; NaN off the map."""
    north = x[0] + (cosine * q[k, 0] - sine * q[k, 1])
    east = x[1] + (sine * q[k, 0] + cosine * q[k, 1])
    row, column = _place(north, east, plane, origin, shape)
    return measured[k] - (bspline_at(nodes, row, column) if bicubic else bilinear_at(nodes, row, column))


@_compiled
def losses(X, q, measured, plane, nodes, origin, shape, bicubic, criterion, out):
    """Mean absolute or mean square difference to the map, +inf off the map; X (n, 4) -> out (n,)."""
    for c in range(X.shape[0]):
        x = X[c]
        cosine, sine = x[3] * math.cos(x[2]), x[3] * math.sin(x[2])
        total = 0.0
        for k in range(q.shape[0]):
            difference = _difference(x, cosine, sine, q, k, measured, plane, nodes, origin, shape, bicubic)
            total += abs(difference) if criterion == MAD else difference * difference
        out[c] = np.inf if math.isnan(total) else total / q.shape[0]


@_compiled
def _middle(values, mean):
    """Mean of a few values, or their median; the values are put in order."""
    if mean:
        return values.sum() / values.shape[0]
    for k in range(1, values.shape[0]):
        value, j = values[k], k
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    half = values.shape[0] // 2
    return values[half] if values.shape[0] % 2 else 0.5 * (values[half - 1] + values[half])


@_compiled
def robust_losses(X, q, measured, plane, nodes, origin, shape, bicubic, criterion, threshold, free, out):
    """As `losses`, with Huber's loss too, and with the offset of each candidate's differences out if `free`.

    Huber: ``d²`` up to the threshold t (in the map's unit), ``2 t abs(d) − t²`` beyond. The offset is the
    mean for MEAN_SQUARE, the median otherwise. X (n, 4) -> out (n,).
    """
    differences, ordered = np.empty(q.shape[0]), np.empty(q.shape[0])
    for c in range(X.shape[0]):
        x = X[c]
        cosine, sine = x[3] * math.cos(x[2]), x[3] * math.sin(x[2])
        inside = True
        for k in range(q.shape[0]):
            differences[k] = _difference(
                x, cosine, sine, q, k, measured, plane, nodes, origin, shape, bicubic
            )
            inside = inside and not math.isnan(differences[k])
        if not inside:
            out[c] = np.inf
            continue
        if free:
            ordered[:] = differences
            differences -= _middle(ordered, criterion == MEAN_SQUARE)
        total = 0.0
        for k in range(q.shape[0]):
            size = abs(differences[k])
            if criterion == MAD:
                total += size
            elif criterion == MEAN_SQUARE or size <= threshold:
                total += size * size
            else:
                total += threshold * (2.0 * size - threshold)
        out[c] = total / q.shape[0]


@_compiled
def whiten(root, values):
    """Solve ``root y = values`` in place for the lower triangle `root` (m, m); values (n, m, k).

    Whitening mixes samples: a candidate with a point off the map is infinite (or NaN) throughout.
    """
    for c in range(values.shape[0]):
        for j in range(values.shape[2]):
            inside, fill = True, 0.0
            for k in range(values.shape[1]):
                if not math.isfinite(values[c, k, j]):
                    inside, fill = False, values[c, k, j]
            for k in range(values.shape[1]):
                if not inside:
                    values[c, k, j] = fill
                    continue
                total = values[c, k, j]
                for i in range(k):
                    total -= root[k, i] * values[c, i, j]
                values[c, k, j] = total / root[k, k]


@_compiled
def residuals(X, q, measured, plane, nodes, origin, shape, bicubic, sigma, out):
    """Whitened differences measured minus map; X (n, 4) -> out (n, m); +inf off the map."""
    for c in range(X.shape[0]):
        x = X[c]
        cosine, sine = x[3] * math.cos(x[2]), x[3] * math.sin(x[2])
        for k in range(q.shape[0]):
            difference = _difference(x, cosine, sine, q, k, measured, plane, nodes, origin, shape, bicubic)
            out[c, k] = np.inf if math.isnan(difference) else difference / sigma


@_compiled
def slopes(X, q, plane, nodes, origin, shape, bicubic, sigma, out):
    """Derivatives of the whitened residuals; X (n, 4) -> out (n, m, 4); NaN off the map."""
    for c in range(X.shape[0]):
        x = X[c]
        cosine, sine = math.cos(x[2]), math.sin(x[2])
        for k in range(q.shape[0]):
            # the turned, unscaled point: the derivative by the scale
            north = cosine * q[k, 0] - sine * q[k, 1]
            east = sine * q[k, 0] + cosine * q[k, 1]
            row, column = _place(x[0] + x[3] * north, x[1] + x[3] * east, plane, origin, shape)
            if bicubic:
                _, per_row, per_column = bspline_gradient_at(nodes, row, column)
            else:
                _, per_row, per_column = bilinear_gradient_at(nodes, row, column)
            per_north = -per_row / (origin[2] * plane[2] * sigma)
            per_east = -per_column / (origin[3] * plane[3] * sigma)
            out[c, k, 0] = per_north
            out[c, k, 1] = per_east
            out[c, k, 2] = x[3] * (per_east * north - per_north * east)
            out[c, k, 3] = per_north * north + per_east * east
