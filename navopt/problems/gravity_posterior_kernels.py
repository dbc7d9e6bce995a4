"""Compiled posterior of a track on a map: how well INS error coefficients explain the measurements.

Coefficients ``a`` have independent standard normal priors. Sample k is at ``p_k − B_k a`` and should
read ``h(p_k − B_k a) + O_k a`` plus noise. The error of the map is correlated along the track; an
AR(1) recursion takes it out sample by sample, which whitens the residuals as the Cholesky factor of
their covariance would, in linear time, and the first n residuals do not depend on later samples.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from navopt.models.field_map_kernels import bilinear_gradient_at, bspline_gradient_at, fractional_index

__all__ = ["costs", "fit", "weigh"]

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def _field(latitude, longitude, nodes, grid, shape, bicubic):
    """Value and slopes per radian of latitude and longitude; NaN off the map."""
    row, column = fractional_index(
        latitude, longitude, grid[0], grid[1], grid[2], grid[3], shape[0], shape[1]
    )
    if bicubic:
        value, per_row, per_column = bspline_gradient_at(nodes, row, column)
    else:
        value, per_row, per_column = bilinear_gradient_at(nodes, row, column)
    return value, per_row / grid[2], per_column / grid[3]


@_compiled
def weigh(a, start, stop, samples, noise, field, huber, residual, rows):
    """Fill whitened residuals and their derivatives for samples start … stop; return the cost.

    Parameters
    ----------
    a : ndarray, shape (r,)
        Coefficients.
    start, stop : int
        Range of samples used.
    samples : tuple
        ``latitude`` (N,), ``longitude`` (N,), ``basis`` (N, 2, r) in rad, ``offset`` (N, r) and
        ``measured`` (N,) in the unit of the map.
    noise : tuple
        ``white`` (N,): variance of each sample; ``phi`` (N,): correlation of the map error with that of
        the sample before; ``variance``: of the map error.
    field : tuple
        ``nodes, grid, shape, bicubic, mean, spread``: the map, and the mean and the variance of the field
        where the map does not reach.
    huber : float
        Whitened residuals beyond it count linearly; ``inf`` for never.
    residual, rows : ndarray, shape (N,) and (N, r)
        Results, weighted by the root of the robust weight.

    Returns
    -------
    float
        Minus log likelihood without its constant.
    """
    latitude, longitude, basis, offset, measured = samples
    white, phi, variance = noise
    nodes, grid, shape, bicubic, mean, spread = field
    r = a.shape[0]
    carried = np.zeros(r)
    level, p = 0.0, variance
    total = 0.0
    for k in range(start, stop):
        lat, lon, drift = latitude[k], longitude[k], 0.0
        for c in range(r):
            lat -= basis[k, 0, c] * a[c]
            lon -= basis[k, 1, c] * a[c]
            drift += offset[k, c] * a[c]
        value, per_lat, per_lon = _field(lat, lon, nodes, grid, shape, bicubic)
        if k > start:
            f = phi[k]
            p = f * f * p + (1.0 - f * f) * variance
            level *= f
            for c in range(r):
                carried[c] *= f
        if math.isnan(value):
            # off the map the field is only known to be of the usual size, and teaches nothing
            e = measured[k] - mean - drift
            s = spread + white[k]
            total += 0.5 * (e * e / s + math.log(s))
            residual[k] = e / math.sqrt(s)
            for c in range(r):
                rows[k, c] = -offset[k, c] / math.sqrt(s)
            continue
        s = p + white[k]
        scale = 1.0 / math.sqrt(s)
        e = measured[k] - value - drift - level
        w = e * scale
        weight = 1.0
        size = abs(w)
        if size > huber:
            weight = huber / size
            total += huber * size - 0.5 * huber * huber
        else:
            total += 0.5 * w * w
        total += 0.5 * math.log(s)
        gain = p / s * weight
        root = math.sqrt(weight)
        residual[k] = root * w
        for c in range(r):
            slope = per_lat * basis[k, 0, c] + per_lon * basis[k, 1, c] - offset[k, c] - carried[c]
            rows[k, c] = root * scale * slope
            carried[c] += gain * slope
        level += gain * e
        p *= 1.0 - gain
    return total


@_compiled
def costs(points, start, stop, samples, noise, field, huber, out):
    """Fill minus log posterior of many coefficient vectors, as `weigh` and the prior, without slopes.

    Parameters
    ----------
    points : ndarray, shape (m, r)
        Coefficients.
    start, stop, samples, noise, field, huber
        As for `weigh`.
    out : ndarray, shape (m,)
        Result.
    """
    latitude, longitude, basis, offset, measured = samples
    white, phi, variance = noise
    nodes, grid, shape, bicubic, mean, spread = field
    r = points.shape[1]
    for i in range(points.shape[0]):
        level, p, total = 0.0, variance, 0.0
        for c in range(r):
            total += 0.5 * points[i, c] * points[i, c]
        for k in range(start, stop):
            lat, lon, drift = latitude[k], longitude[k], 0.0
            for c in range(r):
                lat -= basis[k, 0, c] * points[i, c]
                lon -= basis[k, 1, c] * points[i, c]
                drift += offset[k, c] * points[i, c]
            value, _, _ = _field(lat, lon, nodes, grid, shape, bicubic)
            if k > start:
                f = phi[k]
                p = f * f * p + (1.0 - f * f) * variance
                level *= f
            if math.isnan(value):
                e = measured[k] - mean - drift
                s = spread + white[k]
                total += 0.5 * (e * e / s + math.log(s))
                continue
            s = p + white[k]
            e = measured[k] - value - drift - level
            size = abs(e) / math.sqrt(s)
            weight = huber / size if size > huber else 1.0
            total += 0.5 * math.log(s)
            total += huber * size - 0.5 * huber * huber if size > huber else 0.5 * size * size
            gain = p / s * weight
            level += gain * e
            p *= 1.0 - gain
        out[i] = total


@_compiled
def fit(a, start, stop, samples, noise, field, huber, steps, tolerance):
    """Minimise minus the log posterior by Levenberg–Marquardt.

    Parameters
    ----------
    a : ndarray, shape (r,)
        Start.
    start, stop, samples, noise, field, huber
        As for `weigh`.
    steps : int
        Largest number of evaluations after the first.
    tolerance : float
        End when a Gauss–Newton step promises to lower the objective by less.

    Returns
    -------
    a : ndarray, shape (r,)
    cost : float
        Minus log posterior there.
    information : ndarray, shape (r, r)
        Gauss–Newton Hessian there, the prior included.
    evaluations : int
    """
    r = a.shape[0]
    n = samples[0].shape[0]
    residual, rows = np.zeros(n), np.zeros((n, r))
    here = a.copy()
    cost = weigh(here, start, stop, samples, noise, field, huber, residual, rows) + 0.5 * np.dot(here, here)
    part = rows[start:stop]
    information = np.dot(part.T, part) + np.eye(r)
    gradient = np.dot(part.T, residual[start:stop]) + here
    evaluations, damping = 1, 0.0
    for _ in range(steps):
        damped = information.copy()
        if damping > 0.0:
            for c in range(r):
                damped[c, c] += damping * damped[c, c]
        step = -np.linalg.solve(damped, gradient)
        promised = -0.5 * np.dot(gradient, step)
        if promised < tolerance:
            break
        there = here + step
        value = weigh(there, start, stop, samples, noise, field, huber, residual, rows)
        value += 0.5 * np.dot(there, there)
        evaluations += 1
        if value < cost:
            gained = cost - value
            here, cost = there, value
            part = rows[start:stop]
            information = np.dot(part.T, part) + np.eye(r)
            gradient = np.dot(part.T, residual[start:stop]) + here
            damping = damping * 0.2 if gained > 0.5 * promised else damping
            if damping < 1e-3:
                damping = 0.0
        else:
            damping = max(4.0 * damping, 0.05)
            if damping > 1e8:
                break
    return here, cost, information, evaluations
