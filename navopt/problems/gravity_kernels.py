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

__all__ = ["MAD", "MEAN_SQUARE", "losses", "residuals", "slopes"]

MAD, MEAN_SQUARE = 0, 1

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
