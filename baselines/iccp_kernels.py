"""Compiled closest contour points on a grid, and the iteration that fits a track to them.

The contour of a bilinear cell is a piece of a hyperbola. Here it is the chord between the points where
the contour cuts the sides of the cell, as in marching squares; which sides belong together where all
four are cut is decided by the value at the saddle, as the hyperbola has it. On a chord the mapped value
is off by no more than a quarter of the cell's twist, ``|sw + ne - se - nw| / 4``.

Everything is in metres on a plane, whose grid lines are ``north = n0 + dn * row``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from baselines.rigid_transform import AFFINE, fit
from navopt.models.field_map_kernels import bilinear_at

__all__ = ["CONVERGED", "CUT", "ITERATIONS", "NO_CONTOUR", "closest_on_contour", "match", "mean_difference"]

CONVERGED, ITERATIONS, NO_CONTOUR, CUT = 0, 1, 2, 3

_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def _nearest_on_chord(pn, pe, an, ae, bn, be, region):
    """Nearest point of a chord inside a rectangle (south, north, west, east), and its squared distance.

    The distance is infinite where the chord misses the rectangle.
    """
    un, ue = bn - an, be - ae
    low, high = 0.0, 1.0
    # Liang and Barsky: each side of the rectangle cuts the interval of the chord's parameter
    for side in range(4):
        if side == 0:
            slope, room = -un, an - region[0]
        elif side == 1:
            slope, room = un, region[1] - an
        elif side == 2:
            slope, room = -ue, ae - region[2]
        else:
            slope, room = ue, region[3] - ae
        if slope == 0.0:
            if room < 0.0:
                return np.inf, 0.0, 0.0
        elif slope < 0.0:
            low = max(low, room / slope)
        else:
            high = min(high, room / slope)
    if low > high:
        return np.inf, 0.0, 0.0
    length = un * un + ue * ue
    t = 0.0 if length == 0.0 else ((pn - an) * un + (pe - ae) * ue) / length
    t = min(max(t, low), high)
    qn, qe = an + t * un, ae + t * ue
    return (qn - pn) ** 2 + (qe - pe) ** 2, qn, qe


@_compiled
def _in_cell(values, i, j, level, grid, pn, pe, region, cuts):
    """Nearest contour point of one cell: squared distance (inf if there is none), north, east."""
    sw, se = values[i, j] - level, values[i, j + 1] - level
    nw, ne = values[i + 1, j] - level, values[i + 1, j + 1] - level
    if (sw > 0.0 and se > 0.0 and nw > 0.0 and ne > 0.0) or (sw < 0.0 and se < 0.0 and nw < 0.0 and ne < 0.0):
        return np.inf, 0.0, 0.0
    # where the sides are cut, in order south, east, north, west; a corner on the level counts as above
    count = 0
    for side in range(4):
        a = sw if side == 0 or side == 3 else (se if side == 1 else nw)
        b = se if side == 0 else (nw if side == 3 else ne)
        if (a >= 0.0) != (b >= 0.0):
            t = a / (a - b)
            row = 0.0 if side == 0 else (1.0 if side == 2 else t)
            column = 0.0 if side == 3 else (1.0 if side == 1 else t)
            cuts[count, 0] = grid[0] + grid[2] * (i + row)
            cuts[count, 1] = grid[1] + grid[3] * (j + column)
            count += 1
    if count == 0:
        # no corner is below: the level is met in corners only
        best, bn, be = np.inf, 0.0, 0.0
        for corner in range(4):
            value = sw if corner == 0 else (se if corner == 1 else (nw if corner == 2 else ne))
            if value == 0.0:
                n, e = grid[0] + grid[2] * (i + corner // 2), grid[1] + grid[3] * (j + corner % 2)
                d, n, e = _nearest_on_chord(pn, pe, n, e, n, e, region)
                if d < best:
                    best, bn, be = d, n, e
        return best, bn, be
    if count == 2:
        return _nearest_on_chord(pn, pe, cuts[0, 0], cuts[0, 1], cuts[1, 0], cuts[1, 1], region)
    # all four: south-west and north-east are joined if the saddle has their sign, and the chords then cut
    # off the other two corners
    saddle = (sw * ne - se * nw) / (sw + ne - se - nw)
    first = 1 if (saddle >= 0.0) == (sw >= 0.0) else 3
    a = _nearest_on_chord(pn, pe, cuts[0, 0], cuts[0, 1], cuts[first, 0], cuts[first, 1], region)
    b = _nearest_on_chord(pn, pe, cuts[2, 0], cuts[2, 1], cuts[4 - first, 0], cuts[4 - first, 1], region)
    return a if a[0] <= b[0] else b


@_compiled
def closest_on_contour(values, grid, level, pn, pe, region, allowed, cuts):
    """Nearest point on a contour within a rectangle.

    Cells are visited in rings about the point until no farther cell can hold a nearer one.

    Parameters
    ----------
    values : ndarray, shape (n_rows, n_columns)
        The field at the nodes.
    grid : tuple of float
        North and east of node (0, 0), and the steps, m.
    level : float
        The value of the contour.
    pn, pe : float
        The point (north, east), m.
    region : ndarray, shape (4,)
        South, north, west and east limit of what is searched, m.
    allowed : int
        Cells that may be looked at.
    cuts : ndarray, shape (4, 2)
        Workspace.

    Returns
    -------
    distance_squared, north, east : float
        The distance is infinite where the contour does not pass through the rectangle.
    cells : int
        Cells looked at, or -1 if more would have been needed than allowed.
    """
    n_rows, n_columns = values.shape
    # the rectangle's part of the map, in cells
    south = max(math.floor((region[0] - grid[0]) / grid[2]), 0)
    north = min(math.floor((region[1] - grid[0]) / grid[2]), n_rows - 2)
    west = max(math.floor((region[2] - grid[1]) / grid[3]), 0)
    east = min(math.floor((region[3] - grid[1]) / grid[3]), n_columns - 2)
    best, bn, be, cells = np.inf, 0.0, 0.0, 0
    if south > north or west > east:
        return best, bn, be, cells
    # rings are about the nearest point of the rectangle: from outside it, all of it is at least as far
    # as that point, and a cell at the distance d from that point at least hypot(outside, d)
    cn, ce = min(max(pn, region[0]), region[1]), min(max(pe, region[2]), region[3])
    outside = (pn - cn) ** 2 + (pe - ce) ** 2
    row, column = (cn - grid[0]) / grid[2], (ce - grid[1]) / grid[3]
    i0 = min(max(math.floor(row), south), north)
    j0 = min(max(math.floor(column), west), east)
    v, u = row - i0, column - j0
    last = max(max(i0 - south, north - i0), max(j0 - west, east - j0))
    for ring in range(last + 1):
        if ring > 0:
            # a side of the ring that lies off the rectangle bounds nothing
            reach = np.inf
            if i0 - ring >= south:
                reach = min(reach, (v + ring - 1.0) * grid[2])
            if i0 + ring <= north:
                reach = min(reach, (ring - v) * grid[2])
            if j0 - ring >= west:
                reach = min(reach, (u + ring - 1.0) * grid[3])
            if j0 + ring <= east:
                reach = min(reach, (ring - u) * grid[3])
            if best <= outside + max(reach, 0.0) ** 2:
                break
        for i in range(max(i0 - ring, south), min(i0 + ring, north) + 1):
            border = i == i0 - ring or i == i0 + ring
            stride = 1 if border or ring == 0 else 2 * ring
            for j in range(j0 - ring, j0 + ring + 1, stride):
                if j < west or j > east:
                    continue
                if cells == allowed:
                    return np.inf, 0.0, 0.0, -1
                cells += 1
                d, n, e = _in_cell(values, i, j, level, grid, pn, pe, region, cuts)
                if d < best:
                    best, bn, be = d, n, e
    return best, bn, be, cells


@_compiled
def mean_difference(values, grid, points, measured):
    """Mean absolute difference between measured and mapped values at points (n, 2); inf off the map."""
    total = 0.0
    for k in range(points.shape[0]):
        row, column = (points[k, 0] - grid[0]) / grid[2], (points[k, 1] - grid[1]) / grid[3]
        total += abs(measured[k] - bilinear_at(values, row, column))
    return np.inf if math.isnan(total) else total / points.shape[0]


@_compiled
def _apply(transform, points, out):
    for k in range(points.shape[0]):
        n, e = points[k, 0], points[k, 1]
        out[k, 0] = transform[0, 0] * n + transform[0, 1] * e + transform[2, 0]
        out[k, 1] = transform[1, 0] * n + transform[1, 1] * e + transform[2, 1]


@_compiled
def _weigh(distances, huber, weights):
    """Weights 1, or those of Huber with a scale from the median distance; 0 where there is no contour."""
    n = distances.shape[0]
    found = np.empty(n)
    count = 0
    for k in range(n):
        weights[k] = 0.0 if math.isinf(distances[k]) else 1.0
        if weights[k] > 0.0:
            found[count] = distances[k]
            count += 1
    if huber and count > 0:
        # distances along one direction: their median is 0.6745 sigma
        limit = 1.345 * math.sqrt(np.median(found[:count])) / 0.6745
        for k in range(n):
            if weights[k] > 0.0 and math.sqrt(distances[k]) > limit:
                weights[k] = limit / math.sqrt(distances[k])
    return count


@_compiled
def match(
    values,
    grid,
    track,
    measured,
    regions,
    kind,
    low,
    high,
    ridge,
    huber,
    iterations,
    tolerance,
    allowed,
    transform,
):
    """Iterate closest contour points and transforms from a start.

    Parameters
    ----------
    values, grid
        As for `closest_on_contour`.
    track : ndarray, shape (n, 2)
        The inertial track, m.
    measured : ndarray, shape (n,)
        Levels of the contours.
    regions : ndarray, shape (n, 4)
        What is searched for each point.
    kind, low, high, ridge
        As for `baselines.rigid_transform.fit`.
    huber : bool
        Robust weights.
    iterations : int
        Largest number of iterations.
    tolerance : float
        Mean move of the points that ends the iteration, m.
    allowed : int
        Cells that may be looked at; an iteration that needs more is not used.
    transform : ndarray, shape (3, 2)
        Matrix and shift to start from; the result.

    Returns
    -------
    reason : int
        `CONVERGED`, `ITERATIONS`, `NO_CONTOUR` or `CUT` (by `allowed`).
    done : int
        Iterations used.
    cells : int
        Cells looked at, at most `allowed`.
    cost : float
        Root mean square distance from the points to their contours at the last search, m.
    """
    n = track.shape[0]
    at, after, target = np.empty((n, 2)), np.empty((n, 2)), np.zeros((n, 2))
    distances, weights, cuts = np.empty(n), np.empty(n), np.empty((4, 2))
    least = 3 if kind == AFFINE else 2
    _apply(transform, track, at)
    cells, before = 0, np.inf
    cost = np.nan
    for done in range(iterations):
        for k in range(n):
            if done > 0 and math.isinf(distances[k]):
                continue  # where there was no contour there is none now
            distances[k], target[k, 0], target[k, 1], used = closest_on_contour(
                values, grid, measured[k], at[k, 0], at[k, 1], regions[k], allowed - cells, cuts
            )
            if used < 0:
                return CUT, done, allowed, cost
            cells += used
        if _weigh(distances, huber, weights) < least:
            return NO_CONTOUR, done, cells, cost
        if not fit(track, target, weights, kind, low, high, ridge, transform):
            return NO_CONTOUR, done, cells, cost
        _apply(transform, track, after)
        moved, squares, total = 0.0, 0.0, 0.0
        for k in range(n):
            moved += math.hypot(after[k, 0] - at[k, 0], after[k, 1] - at[k, 1]) / n
            if weights[k] > 0.0:
                squares += weights[k] * distances[k]
                total += weights[k]
        at[:] = after
        squares /= total
        cost = math.sqrt(squares)
        if moved < tolerance or abs(before - squares) < 1e-6 * squares:
            return CONVERGED, done + 1, cells, cost
        before = squares
    return ITERATIONS, iterations, cells, cost
