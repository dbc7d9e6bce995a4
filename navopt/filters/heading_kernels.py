"""Filters of heading-aided alignment over a whole record: the steps of the general filters, compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from navopt.filters.measurement_steps import correct, fade
from navopt.filters.unscented_kernels import linearise, spread_points, wrap
from navopt.filters.unscented_steps import (
    NO_ROOT,
    SOUND,
    Memory,
    Options,
    make_root,
    predict_linear,
    predict_moments,
)
from navopt.models.azimuth_error import advance_into, heading_measurement

__all__ = ["EXTENDED", "ONE", "THREE", "filter_record"]

#: How a slope is found: sigma points once, again after fading, or central differences.
ONE, THREE, EXTENDED = 0, 1, 2

_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def _draw(memory, scale, points):
    """Sigma points of the present estimate; the code of a failure, or 0."""
    if make_root(memory) != SOUND:
        return NO_ROOT
    spread_points(memory.x, memory.root, scale, points)
    for i in range(points.shape[0]):
        for j in range(points.shape[1]):
            if not math.isfinite(points[i, j]):
                return NO_ROOT
    return SOUND


@_compiled
def _around(memory, step, points, steps):
    """As `ExtendedFilter` takes its central differences: states before and behind, and twice the steps."""
    n = len(memory.x)
    points[0] = memory.x
    for j in range(n):
        size = step * max(abs(memory.x[j]), math.sqrt(max(memory.P[j, j], 0.0)))
        if size == 0.0:
            size = step
        points[1 + j] = memory.x
        points[1 + n + j] = memory.x
        points[1 + j, j] += size
        points[1 + n + j, j] -= size
        steps[j] = points[1 + j, j] - points[1 + n + j, j]


@_compiled
def _predict(kind, options, memory, spread, points, images, steps, dt, constants, with_heading, Q, Q_root):
    if kind == EXTENDED:
        if options.root and make_root(memory) != SOUND:
            return NO_ROOT
        _around(memory, spread[0], points, steps)
    else:
        code = _draw(memory, spread[0], points)
        if code != SOUND:
            return code
    for i in range(len(points)):
        advance_into(points[i], dt, constants, with_heading, images[i])
    if kind != EXTENDED:
        return predict_moments(options, memory, images, spread[1], spread[2], Q, Q_root)
    n = len(memory.x)
    F = np.empty((n, n))
    for j in range(n):
        for i in range(n):
            F[i, j] = (images[1 + j, i] - images[1 + n + j, i]) / steps[j]
    return predict_linear(options, memory, images[0].copy(), F, Q, Q_root)


@_compiled
def _slope(kind, memory, spread, points, steps, constants, direct, H0, wrapped, predicted, H, extra):
    """Linearised measurement; `direct` if the heading is a function of the angles and was measured."""
    m, n = H0.shape
    extra[:, :] = 0.0
    if kind != THREE and not direct:
        H[:, :] = H0
        predicted[:] = np.dot(H0, memory.x)
        return SOUND
    if kind == EXTENDED:
        _around(memory, spread[0], points, steps)
    else:
        code = _draw(memory, spread[0], points)
        if code != SOUND:
            return code
    seen = np.empty((len(points), m))
    for k in range(len(points)):
        for a in range(m):
            if a == 2 and direct:
                seen[k, a] = heading_measurement(points[k], constants)
            else:
                value = 0.0
                for i in range(n):
                    value += H0[a, i] * points[k, i]
                seen[k, a] = value
    if kind != EXTENDED:
        linearise(seen, wrapped, memory.root, spread[0], spread[1], spread[2], predicted, H, extra)
        return SOUND
    predicted[:] = seen[0]
    for a in range(m):
        for j in range(n):
            change = seen[1 + j, a] - seen[1 + n + j, a]
            H[a, j] = (wrap(change) if wrapped[a] else change) / steps[j]
    return SOUND


@_compiled
def filter_record(
    kind: int,
    options: Options,
    memory: Memory,
    spread: tuple[float, float, float],
    direct: bool,
    model: tuple,
    noise: tuple,
    data: tuple,
    thin: int,
    results: tuple,
) -> tuple[int, int, float]:
    """Filter one record with one setting.

    Parameters
    ----------
    kind : int
        `ONE`, `THREE` or `EXTENDED`.
    options, memory
        Filter that has not begun.
    spread : tuple of float
        Results of `weights`; for `EXTENDED` the relative step of central differences first.
    direct : bool
        Whether channel 2 is `heading_measurement` and not a row of H.
    model : tuple
        Lengths of the steps (T - 1 or 1), constants of steps and of measurements ((T, 22) or (1, 22)), H (m,
        n), channels that are angles (m), `StrongTracking.faded_states` (m).
    noise : tuple
        Q and its root ((T - 1, n, n) or (1, n, n)), R (m, m).
    data : tuple
        Measurements (T, m), NaN where missing.
    thin : int
        Every how many steps estimates are kept.
    results : tuple
        Where is written: estimates (K, n), covariances (K, n, n) or none (0, n, n), standard deviations (K,
        n), innovations (T, m), their variances (T, m), NIS (T), fading factors (T, m), variances of the
        measurement noise (T, m).

    Returns
    -------
    tuple
        Code of a failure or 0, its step or T, log-likelihood.
    """
    lengths, constants, at_measurement, H0, wrapped, states = model
    Q, Q_root, R = noise
    z = data[0]
    estimates, covariances, deviations, innovations, variances, nis, factors, used = results
    T, m = z.shape
    n = len(memory.x)
    with_heading = n == 11
    points, images, steps = np.empty((2 * n + 1, n)), np.empty((2 * n + 1, n)), np.empty(n)
    predicted, H, extra = np.empty(m), np.empty((m, n)), np.empty((m, m))
    innovation, S = np.empty(m), np.empty((m, m))
    total = 0.0
    for k in range(T):
        if k > 0:
            q = k - 1 if len(Q) > 1 else 0
            dt = lengths[k - 1] if len(lengths) > 1 else lengths[0]
            c = constants[k - 1 if len(constants) > 1 else 0]
            code = _predict(
                kind, options, memory, spread, points, images, steps, dt, c, with_heading, Q[q], Q_root[q]
            )
            if code != SOUND:
                return code, k, -np.inf
        some = False
        for j in range(m):
            some = some or not math.isnan(z[k, j])
        used[k] = memory.variances
        nis[k] = 0.0
        if some:
            c = at_measurement[k if len(at_measurement) > 1 else 0]
            now = direct and not math.isnan(z[k, 2])
            code = _slope(kind, memory, spread, points, steps, c, now, H0, wrapped, predicted, H, extra)
            if code == SOUND:
                code = fade(options, memory, R, H, extra, predicted, z[k], wrapped, states)
            if code == SOUND and kind == THREE:
                code = _slope(kind, memory, spread, points, steps, c, now, H0, wrapped, predicted, H, extra)
            if code != SOUND:
                return code, k, -np.inf
            code, value, likelihood = correct(
                options, memory, R, H, extra, predicted, z[k], wrapped, innovation, S
            )
            if code != SOUND:
                return code, k, -np.inf
            nis[k] = value
            total += likelihood
            innovations[k] = innovation
            factors[k] = memory.factors
            for j in range(m):
                variances[k, j] = S[j, j]
        if k % thin == 0:
            row = k // thin
            estimates[row] = memory.x
            if len(covariances) > 0:
                covariances[row] = memory.P
            for i in range(n):
                deviations[row, i] = math.sqrt(memory.P[i, i])
    return SOUND, T, total
