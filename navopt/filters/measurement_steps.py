"""A measurement in a nonlinear filter, in compiled pieces shared by the general and the fast filters.

Whatever the filter, a measurement arrives here linearised: ``z ≈ ẑ + H (x − x̂) + e`` with ``cov e = Ω``,
from a matrix, a Jacobian (Ω = 0) or sigma points (`unscented_kernels.linearise`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from navopt.filters.fading import fade_states, fading_factors, renew_residuals
from navopt.filters.noise_adaptation import learn_variances
from navopt.filters.unscented_kernels import downdate, factorise, solve_lower, triangularise, wrap
from navopt.filters.unscented_steps import (
    JOSEPH,
    NO_INNOVATION,
    NO_MEASUREMENT,
    NO_UPDATE,
    PRINTED,
    SOUND,
    Memory,
    Options,
    make_root,
    square,
)

__all__ = ["correct", "fade"]

_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def _compress(memory, nominal, H, extra, predicted, z, wrapped):
    """Rows that were measured, their number, innovations, H, Ω and R of them, and whether all is finite."""
    m, n = H.shape
    rows = np.empty(m, dtype=np.int64)
    innovation, Hs, extras, R = np.empty(m), np.empty((m, n)), np.empty((m, m)), np.empty((m, m))
    count = 0
    finite = True
    for j in range(m):
        if not math.isnan(z[j]):
            value = z[j] - predicted[j]
            innovation[count] = wrap(value) if wrapped[j] else value
            finite = finite and math.isfinite(innovation[count])
            rows[count] = j
            count += 1
    for a in range(count):
        i = rows[a]
        Hs[a] = H[i]
        for b in range(count):
            j = rows[b]
            extras[a, b] = extra[i, j]
            R[a, b] = nominal[i, j]
            # variances that were learnt, with the given correlations
            ratio = memory.variances[i] / nominal[i, i] * (memory.variances[j] / nominal[j, j])
            if ratio != 1.0:
                R[a, b] *= math.sqrt(ratio)
    return rows, count, innovation, Hs, extras, R, finite


@_compiled
def _seen_through(P, Hs, count, PH, spread):
    """``P Hᵀ`` and ``H P Hᵀ``."""
    n = len(P)
    for a in range(count):
        for i in range(n):
            value = 0.0
            for j in range(n):
                value += P[i, j] * Hs[a, j]
            PH[i, a] = value
    for a in range(count):
        for b in range(a + 1):
            value = 0.0
            for i in range(n):
                value += Hs[a, i] * PH[i, b]
            spread[a, b] = value
            spread[b, a] = value


@_compiled
def fade(
    options: Options,
    memory: Memory,
    nominal: np.ndarray,
    H: np.ndarray,
    extra: np.ndarray,
    predicted: np.ndarray,
    z: np.ndarray,
    wrapped: np.ndarray,
    states: np.ndarray,
) -> int:
    """Find the fading factors of a measurement and multiply the predicted covariance by them.

    Parameters
    ----------
    options, memory
        The filter.
    nominal : ndarray, shape (m, m)
        Given R.
    H, extra, predicted : ndarray, shapes (m, n), (m, m) and (m,)
        Measurement linearised at the prediction: slope, Ω and predicted value.
    z : ndarray, shape (m,)
        Measurement; NaN where missing.
    wrapped : ndarray of bool, shape (m,)
        Channels that are angles.
    states : ndarray of int, shape (m,)
        `StrongTracking.faded_states`.

    Returns
    -------
    int
        Code of a failure, or 0.
    """
    n, m = len(memory.x), len(z)
    rows, count, innovation, Hs, extras, R, finite = _compress(
        memory, nominal, H, extra, predicted, z, wrapped
    )
    memory.factors[:] = np.nan
    if not finite:
        return NO_MEASUREMENT
    memory.prior[:, :] = memory.root if options.root else memory.P
    if not options.strong:
        for a in range(count):
            memory.factors[rows[a]] = 1.0
        return SOUND
    PH, spread, process = np.empty((n, m)), np.empty((m, m)), np.zeros((m, m))
    _seen_through(memory.P, Hs, count, PH, spread)
    if options.process_only:
        _seen_through(memory.noise, Hs, count, PH, process)
    renew_residuals(memory.V, innovation, rows, count, options.forgetting)
    fading_factors(
        memory.V, R, extras, spread, process, rows, count,
        options.weakening, options.normalise, options.multiple, options.cap, memory.factors,
    )  # fmt: skip
    scales = np.empty(n)
    if not fade_states(memory.factors, rows, count, options.multiple, states, scales):
        return SOUND
    if not options.root:
        memory.fresh[0] = 0
        for i in range(n):
            for j in range(n):
                kept = memory.noise[i, j] if options.process_only else 0.0
                memory.P[i, j] = scales[i] * scales[j] * (memory.P[i, j] - kept) + kept
        return SOUND
    if options.process_only:
        both = np.empty((2 * n, n))
        for i in range(n):
            both[:n, i] = scales[i] * memory.transition[i]
            both[n:, i] = memory.noise_root[i]
        triangularise(both, memory.root)
    else:
        for i in range(n):
            memory.root[i] *= scales[i]
    square(memory.root, memory.P)
    return SOUND


@_compiled
def _renew(options, memory, Hs, noise, K, S_root, count):
    """Covariance after the measurement; the code of a failure, or 0. `noise` is R + Ω."""
    n = len(memory.x)
    P, root = memory.P, memory.root
    if options.form != JOSEPH:
        KS = np.dot(K, S_root)
        if options.root:
            if options.form == PRINTED:
                root[:, :] = memory.prior
            for a in range(count):
                if downdate(root, KS[:, a].copy()) >= 0:
                    return NO_UPDATE
            square(root, P)
            return SOUND
        if options.form == PRINTED:
            P[:, :] = memory.prior
        for i in range(n):
            for j in range(i + 1):
                value = P[i, j]
                for a in range(count):
                    value -= KS[i, a] * KS[j, a]
                P[i, j] = value
                P[j, i] = value
    else:
        A = -np.dot(K, Hs)
        for i in range(n):
            A[i, i] += 1.0
        if options.root:
            noise_root = np.zeros((count, count))
            if factorise(noise, noise_root) >= 0:
                return NO_INNOVATION
            both = np.empty((n + count, n))
            both[:n] = np.dot(A, root).T
            both[n:] = np.dot(K, noise_root).T
            triangularise(both, root)
            square(root, P)
            return SOUND
        new = np.dot(np.dot(A, P), A.T) + np.dot(np.dot(K, noise), K.T)
        for i in range(n):
            for j in range(i + 1):
                value = 0.5 * (new[i, j] + new[j, i])
                P[i, j] = value
                P[j, i] = value
    memory.fresh[0] = 0
    return SOUND if make_root(memory) == SOUND else NO_UPDATE


@_compiled
def correct(
    options: Options,
    memory: Memory,
    nominal: np.ndarray,
    H: np.ndarray,
    extra: np.ndarray,
    predicted: np.ndarray,
    z: np.ndarray,
    wrapped: np.ndarray,
    innovations: np.ndarray,
    S: np.ndarray,
) -> tuple[int, float, float]:
    """Use a measurement.

    Parameters
    ----------
    options, memory, nominal, H, extra, predicted, z, wrapped
        As in `fade`.
    innovations, S : ndarray, shapes (m,) and (m, m)
        Where innovations and their covariance (after fading) are written; NaN where missing.

    Returns
    -------
    tuple
        Code of a failure or 0, normalised innovation squared, log-likelihood.
    """
    n, m = len(memory.x), len(z)
    rows, count, innovation, Hs, extras, R, finite = _compress(
        memory, nominal, H, extra, predicted, z, wrapped
    )
    innovations[:] = np.nan
    S[:, :] = np.nan
    if not finite:
        return NO_MEASUREMENT, np.nan, np.nan
    if count == 0:
        return SOUND, 0.0, 0.0
    PH, spread = np.empty((n, m)), np.empty((m, m))
    _seen_through(memory.P, Hs, count, PH, spread)
    whole, S_root = np.empty((count, count)), np.empty((count, count))
    for a in range(count):
        innovations[rows[a]] = innovation[a]
        for b in range(count):
            whole[a, b] = spread[a, b] + extras[a, b] + R[a, b]
            S[rows[a], rows[b]] = whole[a, b]
    if factorise(whole, S_root) >= 0:
        return NO_INNOVATION, np.nan, np.nan
    white = innovation[:count].copy()
    logarithm = 0.0
    for a in range(count):
        if not S_root[a, a] > 0.0:
            return NO_INNOVATION, np.nan, np.nan
        logarithm += 2.0 * math.log(S_root[a, a])
    solve_lower(S_root, white)
    nis = 0.0
    for a in range(count):
        nis += white[a] * white[a]
    K = np.empty((n, count))
    for i in range(n):
        gain = PH[i, :count].copy()
        solve_lower(S_root, gain)
        for a in range(count - 1, -1, -1):
            value = gain[a]
            for b in range(a + 1, count):
                value -= S_root[b, a] * gain[b]
            gain[a] = value / S_root[a, a]
        step = 0.0
        for a in range(count):
            K[i, a] = gain[a]
            step += gain[a] * innovation[a]
        memory.x[i] += step
    noise = np.ascontiguousarray(R[:count, :count] + extras[:count, :count])
    code = _renew(options, memory, np.ascontiguousarray(Hs[:count]), noise, K, S_root, count)
    if code != SOUND:
        return code, nis, np.nan
    memory.noise[:, :] = 0.0
    if options.root:
        memory.noise_root[:, :] = 0.0
        memory.transition[:, :] = memory.root
    if options.adapt > 0:
        shown = np.empty(m)
        after = np.empty((m, m))
        if options.residual_form:
            _seen_through(memory.P, Hs, count, PH, after)
        for a in range(count):
            if options.residual_form:
                residual = innovation[a]
                for i in range(n):
                    for b in range(count):
                        residual -= Hs[a, i] * K[i, b] * innovation[b]
                shown[a] = residual * residual + after[a, a]
            else:
                shown[a] = innovation[a] * innovation[a] - spread[a, a] - extras[a, a]
        learn_variances(
            shown, rows, count, nominal, options.adapt, options.learning, options.burn_in,
            options.low, options.high, memory.kept, memory.seen, memory.variances,
        )  # fmt: skip
    likelihood = -0.5 * (nis + logarithm + count * math.log(2.0 * math.pi))
    return SOUND, nis, likelihood
