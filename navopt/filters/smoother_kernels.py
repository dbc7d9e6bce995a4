"""The backward pass: smoothed states and the exact gradient of the likelihood, one candidate at a time.

De Jong's form needs no inverse of a state covariance: with r and N that gather what later measurements
say, the smoothed state is ``x⁻ + P⁻ r`` and its covariance ``P⁻ - P⁻ N P⁻`` (de Jong 1989, J. Am. Stat.
Assoc. 84:1085), and the derivative of the log-likelihood by a noise covariance is half of
``Σ (r rᵀ - N)`` at that noise (Koopman & Shephard 1992, Biometrika 79:823).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["backward"]

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def _invert(S, channels, count, inverse, work):
    """Inverse of the observed part of a positive definite matrix by its Cholesky factor."""
    for i in range(count):
        for j in range(i + 1):
            total = S[channels[i], channels[j]]
            for k in range(j):
                total -= work[i, k] * work[j, k]
            work[i, j] = math.sqrt(total) if i == j else total / work[j, j]
    for c in range(count):
        for i in range(count):
            total = 1.0 if i == c else 0.0
            for k in range(i):
                total -= work[i, k] * inverse[k, c]
            inverse[i, c] = total / work[i, i]
        for back in range(count):
            i = count - 1 - back
            total = inverse[i, c]
            for k in range(i + 1, count):
                total -= work[k, i] * inverse[k, c]
            inverse[i, c] = total / work[i, i]


@_compiled
def _times(a, b, rows, inner, columns, out):
    """``out = a b``."""
    for i in range(rows):
        for j in range(columns):
            total = 0.0
            for k in range(inner):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@_compiled
def _around(a, b, rows, columns, work, out):
    """``out = aᵀ b a`` for a symmetric b (rows, rows), a (rows, columns); exactly symmetric."""
    _times(b, a, rows, rows, columns, work)
    for i in range(columns):
        for j in range(i + 1):
            total = 0.0
            for k in range(rows):
                total += a[k, i] * work[k, j]
            out[i, j] = total
            out[j, i] = total


@_compiled
def backward(
    F, H, G, predicted, P_predicted, innovations, S, smoothed, P_smoothed, lagged, by_Q, by_R, by_P0
):
    """Smooth one candidate and differentiate its log-likelihood.

    Parameters
    ----------
    F, H, G : ndarray, shape (T or 1, ...)
        Matrices of the model.
    predicted, P_predicted, innovations, S : ndarray, shapes (T, n), (T, n, n), (T, m), (T, m, m)
        From the filter; innovations are NaN where a measurement is missing.
    smoothed, P_smoothed, lagged : ndarray, shapes (T, n), (T, n, n), (T - 1, n, n)
        Results: states given all measurements, their covariances, and those between step t + 1 and t.
    by_Q, by_R, by_P0 : ndarray, shapes (T or 1, g, g), (T or 1, m, m), (n, n)
        Results: derivatives M of the log-likelihood, ``d log L = tr(M dQ)``; per step, or summed.
    """
    T, n, m, g = predicted.shape[0], F.shape[1], H.shape[1], G.shape[2]
    r, N = np.zeros(n), np.zeros((n, n))
    older_r, older_N = np.zeros(n), np.zeros((n, n))
    channels = np.empty(m, np.int64)
    inverse, work = np.zeros((m, m)), np.zeros((m, m))
    h, PH, gain = np.zeros((m, n)), np.zeros((n, m)), np.zeros((n, m))
    K, L, spare, other = np.zeros((n, m)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    wide, D, se, u = np.zeros((n, max(m, g))), np.zeros((m, m)), np.zeros(m), np.zeros(m)
    noise = np.zeros((g, g))
    by_Q[:] = 0.0
    by_R[:] = 0.0
    for back in range(T):
        t = T - 1 - back
        f, P = F[t if F.shape[0] > 1 else 0], P_predicted[t]
        count = 0
        for j in range(m):
            if not math.isnan(innovations[t, j]):
                channels[count] = j
                h[count] = H[t if H.shape[0] > 1 else 0, j]
                count += 1
        _invert(S[t], channels, count, inverse, work)
        for i in range(n):
            for j in range(count):
                total = 0.0
                for k in range(n):
                    total += P[i, k] * h[j, k]
                PH[i, j] = total
        _times(PH, inverse, n, count, count, gain)
        if t == T - 1:
            # nothing follows: the transition does not matter
            K[:] = 0.0
            L[:] = 0.0
        else:
            _times(f, gain, n, n, count, K)
            for i in range(n):
                for c in range(n):
                    total = f[i, c]
                    for j in range(count):
                        total -= K[i, j] * h[j, c]
                    L[i, c] = total
            G_t = G[t if G.shape[0] > 1 else 0]
            _around(G_t, N, n, g, wide, noise)
            q = by_Q[t if by_Q.shape[0] > 1 else 0]
            for i in range(g):
                for j in range(g):
                    a, b = 0.0, 0.0
                    for k in range(n):
                        a += G_t[k, i] * r[k]
                        b += G_t[k, j] * r[k]
                    q[i, j] += 0.5 * (a * b - noise[i, j])
            # Cov(x[t+1], x[t]) = (I - P[t+1] N) L P[t]
            _times(L, P, n, n, n, spare)
            _times(N, spare, n, n, n, other)
            for i in range(n):
                for c in range(n):
                    total = spare[i, c]
                    for k in range(n):
                        total -= P_predicted[t + 1, i, k] * other[k, c]
                    lagged[t, i, c] = total
        for i in range(count):
            total = 0.0
            for j in range(count):
                total += inverse[i, j] * innovations[t, channels[j]]
            se[i] = total
            for k in range(n):
                total -= K[k, i] * r[k]
            u[i] = total
        _around(K, N, n, count, wide, D)
        by = by_R[t if by_R.shape[0] > 1 else 0]
        for i in range(count):
            for j in range(count):
                by[channels[i], channels[j]] += 0.5 * (u[i] * u[j] - D[i, j] - inverse[i, j])
        _around(L, N, n, n, spare, older_N)
        for i in range(n):
            total = 0.0
            for k in range(n):
                total += L[k, i] * r[k]
            for j in range(count):
                total += h[j, i] * se[j]
            older_r[i] = total
            for c in range(n):
                for j in range(count):
                    for k in range(count):
                        older_N[i, c] += h[j, i] * inverse[j, k] * h[k, c]
        r[:] = older_r
        for i in range(n):
            for c in range(n):
                N[i, c] = 0.5 * (older_N[i, c] + older_N[c, i])
        for i in range(n):
            total = predicted[t, i]
            for k in range(n):
                total += P[i, k] * r[k]
            smoothed[t, i] = total
        _around(P, N, n, n, spare, other)
        for i in range(n):
            for c in range(n):
                P_smoothed[t, i, c] = P[i, c] - other[i, c]
    for i in range(n):
        for c in range(n):
            by_P0[i, c] = 0.5 * (r[i] * r[c] - N[i, c])
