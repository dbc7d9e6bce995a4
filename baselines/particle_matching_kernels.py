"""Compiled inner loops of the particle filter: mapped values along the tracks of many particles."""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from navopt.models.field_map_kernels import bilinear_at, bspline_at, fractional_index

__all__ = ["accumulate", "systematic"]

_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def accumulate(sources, walk, response, offset, places, measured, start, stop, field, sums):
    """Add the residuals of samples start ... stop to the sums of each particle.

    Parameters
    ----------
    sources : ndarray, shape (P, S)
        Coefficients of each particle.
    walk : ndarray, shape (P, N, 2) or (0, 0, 2)
        Random walk of each particle, m; empty if there is none.
    response : ndarray, shape (N, 2, S)
        Position error (north, east) per coefficient, m.
    offset : ndarray, shape (N, S) or (0, S)
        What a coefficient adds to the measured value; empty if nothing.
    places : ndarray, shape (N, 4)
        INS latitude and longitude, rad, and the reciprocals of the metres per radian of each.
    measured : ndarray, shape (N,)
        Measured field.
    start, stop : int
        Samples.
    field : tuple
        Nodes (or spline coefficients), ``(lat0, lon0, dlat, dlon)``, ``(n_rows, n_columns)``, and whether
        the nodes are coefficients.
    sums : ndarray, shape (P, 2)
        Sum of the residuals measured minus mapped, and of their squares; NaN where a point is off the map.
    """
    nodes, axes, shape, bicubic = field
    n_sources = sources.shape[1]
    walking, shifted = walk.shape[0] > 0, offset.shape[0] > 0
    for p in range(sources.shape[0]):
        first, second = 0.0, 0.0
        for k in range(start, stop):
            north, east = 0.0, 0.0
            for s in range(n_sources):
                north += response[k, 0, s] * sources[p, s]
                east += response[k, 1, s] * sources[p, s]
            if walking:
                north += walk[p, k, 0]
                east += walk[p, k, 1]
            row, column = fractional_index(
                places[k, 0] - north * places[k, 2],
                places[k, 1] - east * places[k, 3],
                axes[0],
                axes[1],
                axes[2],
                axes[3],
                shape[0],
                shape[1],
            )
            mapped = bspline_at(nodes, row, column) if bicubic else bilinear_at(nodes, row, column)
            residual = measured[k] - mapped
            if shifted:
                for s in range(n_sources):
                    residual -= offset[k, s] * sources[p, s]
            first += residual
            second += residual * residual
            if math.isnan(residual):
                break
        sums[p, 0] += first
        sums[p, 1] += second


@_compiled
def systematic(weights, shift, out):
    """Systematic resampling: indices of the particles that go on.

    Parameters
    ----------
    weights : ndarray, shape (P,)
        Normalised weights.
    shift : float
        In [0, 1): the common offset of the evenly spaced pointers.
    out : ndarray, shape (P,)
        Indices; particle i appears floor or ceil of P w_i times.
    """
    n = weights.shape[0]
    cumulated, i = weights[0], 0
    for j in range(n):
        pointer = (j + shift) / n
        while cumulated <= pointer and i < n - 1:
            i += 1
            cumulated += weights[i]
        out[j] = i
