"""Steps of the compiled filter, each for eight candidates: products, measurements, predictions, settling.

All work on rows of a workspace given by its address, see `navopt.filters.lanes`. The argument names are those
of `navopt.filters.batch_kalman_kernels.filter_lanes`; n states, m channels.
"""

from __future__ import annotations

import math

from numba import njit

from navopt.filters.lanes import (
    LANES,
    add,
    choose,
    div,
    exponent,
    if_close,
    load,
    mantissa,
    mul,
    muladd,
    mulsub,
    peek,
    peek_index,
    poke,
    splat,
    store,
    sub,
)

__all__ = [
    "correct",
    "dot",
    "dots",
    "gather",
    "hold",
    "innovate",
    "innovation",
    "joseph",
    "keep_innovations",
    "keep_rows",
    "measure",
    "move",
    "multiply",
    "orthogonalise",
    "predict",
    "process_noise",
    "reduce",
    "renew",
    "watch",
]

#: A covariance that changes by less than this part of itself over a few steps has settled.
SETTLED = 1e-14

# helpers are never called from Python, and their wrappers would take as long to compile as they do
_helper = njit(cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


@_helper
def dot(total, ws, first, stride, columns, values, row, count):
    """Total plus the sum of ``values[row, c]`` times workspace rows ``first + columns[row, c] * stride``."""
    for c in range(count):
        k = row + c
        total = muladd(splat(peek(values, k)), load(ws, first + peek_index(columns, k) * stride), total)
    return total


@_helper
def dots(ws, to, step, start, start_step, first, first_step, stride, columns, values, row, count, number):
    """As many `_dot` as `number`, four at a time; each begins at ``start`` and goes ``to``."""
    for _ in range(number // 4):
        a, b = load(ws, start), load(ws, start + start_step)
        c, d = load(ws, start + 2 * start_step), load(ws, start + 3 * start_step)
        for i in range(row, row + count):
            factor, k = splat(peek(values, i)), first + peek_index(columns, i) * stride
            a = muladd(factor, load(ws, k), a)
            b = muladd(factor, load(ws, k + first_step), b)
            c = muladd(factor, load(ws, k + 2 * first_step), c)
            d = muladd(factor, load(ws, k + 3 * first_step), d)
        store(ws, to, a)
        store(ws, to + step, b)
        store(ws, to + 2 * step, c)
        store(ws, to + 3 * step, d)
        to, start, first = to + 4 * step, start + 4 * start_step, first + 4 * first_step
    if number & 2:
        a, b = load(ws, start), load(ws, start + start_step)
        for i in range(row, row + count):
            factor, k = splat(peek(values, i)), first + peek_index(columns, i) * stride
            a = muladd(factor, load(ws, k), a)
            b = muladd(factor, load(ws, k + first_step), b)
        store(ws, to, a)
        store(ws, to + step, b)
        to, start, first = to + 2 * step, start + 2 * start_step, first + 2 * first_step
    if number & 1:
        store(ws, to, dot(load(ws, start), ws, first, stride, columns, values, row, count))


@_helper
def correct(ws, n, x, w, variance, innovation):
    """One scalar measurement: ``x += w e / s``, w in rows from `w` on; returns ``e² / s``."""
    scaled = mul(innovation, div(splat(1.0), variance))
    for i in range(n):
        store(ws, x + i, muladd(load(ws, w + i), scaled, load(ws, x + i)))
    return mul(innovation, scaled)


@_helper
def reduce(ws, n, P, w, variance):
    """The same for the covariance: ``P -= w wᵀ / s``."""
    inverse = div(splat(1.0), variance)
    for i in range(n):
        gain = mul(load(ws, w + i), inverse)
        for j in range(i + 1):
            value = mulsub(gain, load(ws, w + j), load(ws, P + i * n + j))
            store(ws, P + i * n + j, value)
            store(ws, P + j * n + i, value)


@_helper
def gather(matrix, rows, n, columns, counts, values):
    """Non-zero entries of a matrix with n columns into the front of each row of `values`."""
    for i in range(rows):
        for c in range(peek_index(counts, i)):
            poke(values, i * n + c, peek(matrix, i * n + peek_index(columns, i * n + c)))


@_helper
def process_noise(ws, n, g, G, Q, first, W, GQ):
    """``W = G Q Gᵀ``, Q in rows of the memory at `Q` from `first` on."""
    for i in range(n):
        for k in range(g):
            total = splat(0.0)
            for j in range(g):
                total = muladd(splat(peek(G, i * g + j)), load(Q, first + j * g + k), total)
            store(ws, GQ + i * g + k, total)
    for i in range(n):
        for j in range(i + 1):
            total = splat(0.0)
            for k in range(g):
                total = muladd(splat(peek(G, j * g + k)), load(ws, GQ + i * g + k), total)
            store(ws, W + i * n + j, total)
            store(ws, W + j * n + i, total)


@_helper
def innovate(ws, n, m, count, rows, y, t, R, first, P, x, w, S, e, columns, values, counts, zero):
    """Innovations e, their covariance S (lower triangle) and ``w = P Hᵀ`` of the channels measured."""
    for k in range(count):
        j = peek_index(rows, k)
        row, number = j * n, peek_index(counts, j)
        dots(ws, w + k * n, 1, zero, 0, P, 1, n, columns, values, row, number, n)
        store(
            ws,
            e + k,
            sub(splat(peek(y, t * m + j)), dot(load(ws, zero), ws, x, 1, columns, values, row, number)),
        )
        for i in range(k + 1):
            noise = load(R, first + j * m + peek_index(rows, i))
            store(ws, S + k * m + i, dot(noise, ws, w + i * n, 1, columns, values, row, number))


@_helper
def orthogonalise(ws, n, m, count, w, S, L, e):
    """``S = L D Lᵀ``, D left on the diagonal of S; innovations and w become those of independent channels."""
    for j in range(count):
        last = load(ws, S + j * m + j)
        for k in range(j):
            product = load(ws, S + j * m + k)
            for i in range(k):
                product = mulsub(load(ws, L + k * m + i), load(ws, S + j * m + i), product)
            factor = div(product, load(ws, S + k * m + k))
            store(ws, S + j * m + k, product)
            store(ws, L + j * m + k, factor)
            last = mulsub(factor, product, last)
            store(ws, e + j, mulsub(factor, load(ws, e + k), load(ws, e + j)))
            for i in range(n):
                value = mulsub(factor, load(ws, w + k * n + i), load(ws, w + j * n + i))
                store(ws, w + j * n + i, value)
        store(ws, S + j * m + j, last)


@_helper
def multiply(ws, variance, product, power):
    """Multiply into a product of variances that is kept as a number between 1 and 2 and a power of two.

    A logarithm at each step would cost more than all the rest of a small filter.
    """
    total = mul(load(ws, product), variance)
    store(ws, product, mantissa(total))
    store(ws, power, add(load(ws, power), exponent(total)))


@_helper
def joseph(ws, n, m, count, rows, H, R, first, P, Pw, gains, factors, A, T):
    """``P = (I - K H) Pw (I - K H)ᵀ + K R Kᵀ`` from the orthogonal gains w/d and the factors L.

    `Pw` holds the prior covariance, rows of R begin at `first`; n × n blocks for rent begin at A and T.
    """
    for back in range(count):
        j = count - 1 - back
        for k in range(j + 1, count):
            factor = load(ws, factors + k * m + j)
            for i in range(n):
                value = mulsub(factor, load(ws, gains + k * n + i), load(ws, gains + j * n + i))
                store(ws, gains + j * n + i, value)
    for i in range(n):
        for c in range(n):
            total = splat(1.0 if i == c else 0.0)
            for j in range(count):
                total = mulsub(
                    load(ws, gains + j * n + i), splat(peek(H, peek_index(rows, j) * n + c)), total
                )
            store(ws, A + i * n + c, total)
    for i in range(n):
        for c in range(n):
            total = splat(0.0)
            for k in range(n):
                total = muladd(load(ws, A + i * n + k), load(ws, Pw + k * n + c), total)
            store(ws, T + i * n + c, total)
    for i in range(n):
        for c in range(i + 1):
            total = splat(0.0)
            for k in range(n):
                total = muladd(load(ws, T + i * n + k), load(ws, A + c * n + k), total)
            for j in range(count):
                for k in range(count):
                    noise = mul(
                        load(ws, gains + j * n + i),
                        load(R, first + peek_index(rows, j) * m + peek_index(rows, k)),
                    )
                    total = muladd(noise, load(ws, gains + k * n + c), total)
            store(ws, P + i * n + c, total)
            store(ws, P + c * n + i, total)


@_helper
def hold(ws, n, P, held, settled):
    """Put the covariance of settled lanes back to what it was when it settled."""
    for i in range(n * n):
        store(ws, P + i, choose(load(ws, settled), load(ws, held + i), load(ws, P + i)))


@_helper
def watch(ws, n, P, held, settled, compare):
    """See which lanes have not changed since the last time, if there was one, and remember all."""
    if compare:
        mask = splat(1.0)
        for i in range(n):
            for j in range(i + 1):
                size = mul(load(ws, P + i * n + i), load(ws, P + j * n + j))
                change = sub(load(ws, P + i * n + j), load(ws, held + i * n + j))
                mask = if_close(mask, change, mul(size, splat(SETTLED * SETTLED)))
        store(ws, settled, mask)
    for i in range(n * n):
        store(ws, held + i, load(ws, P + i))


@_helper
def move(ws, n, x, moved, drive, columns, values, counts):
    """``x = F x + drive``."""
    for i in range(n):
        row, number = i * n, peek_index(counts, i)
        store(ws, moved + i, dot(splat(peek(drive, i)), ws, x, 1, columns, values, row, number))
    for i in range(n):
        store(ws, x + i, load(ws, moved + i))


@_helper
def keep_rows(ws, row, count, out, T, lane, used, t):
    """Copy workspace rows into ``out[lane + l, t, :]`` of an array (K, T, count)."""
    for l in range(used):
        at = ((lane + l) * T + t) * count
        for k in range(count):
            poke(out, at + k, peek(ws, (row + k) * LANES + l))


@_helper
def keep_innovations(ws, m, count, rows, e, S, innovations, covariances, T, lane, used, t):
    """Copy innovations and their covariance, NaN for channels without a measurement."""
    for l in range(used):
        at = (lane + l) * T + t
        for j in range(m):
            poke(innovations, at * m + j, math.nan)
            for k in range(m):
                poke(covariances, (at * m + j) * m + k, math.nan)
        for j in range(count):
            a = peek_index(rows, j)
            poke(innovations, at * m + a, peek(ws, (e + j) * LANES + l))
            for k in range(j + 1):
                b, value = peek_index(rows, k), peek(ws, (S + j * m + k) * LANES + l)
                poke(covariances, (at * m + a) * m + b, value)
                poke(covariances, (at * m + b) * m + a, value)


@_helper
def measure(ws, n, m, j, R, first, P, w, variance, columns, values, counts, zero):
    """``w = P h`` and the variance of the innovation of channel j alone."""
    row, number = j * n, peek_index(counts, j)
    dots(ws, w, 1, zero, 0, P, 1, n, columns, values, row, number, n)
    noise = load(R, first + j * m + j)
    store(ws, variance, dot(noise, ws, w, 1, columns, values, row, number))


@_helper
def innovation(ws, n, j, at, y, x, columns, values, counts, zero):
    """Innovation of channel j."""
    seen = dot(load(ws, zero), ws, x, 1, columns, values, j * n, peek_index(counts, j))
    return sub(splat(peek(y, at + j)), seen)


@_helper
def renew(ws, n, m, y, t, x, L, e, columns, values, counts, zero):
    """Innovations of all channels, made independent with the factors L of an earlier step."""
    for j in range(m):
        store(ws, e + j, innovation(ws, n, j, t * m, y, x, columns, values, counts, zero))
        for k in range(j):
            store(ws, e + j, mulsub(load(ws, L + j * m + k), load(ws, e + k), load(ws, e + j)))


@_helper
def predict(ws, n, P, A, W, x, moved, drive, columns, values, counts, zero):
    """``x = F x + drive`` and ``P = F P Fᵀ + W``."""
    move(ws, n, x, moved, drive, columns, values, counts)
    for i in range(n):
        row, number = i * n, peek_index(counts, i)
        dots(ws, A + row, 1, zero, 0, P, 1, n, columns, values, row, number, n)
    for j in range(n):
        row, number, corner = j * n, peek_index(counts, j), j * n + j
        dots(ws, P + corner, n, W + corner, n, A + row, n, 1, columns, values, row, number, n - j)
        for i in range(j + 1, n):
            store(ws, P + row + i, load(ws, P + i * n + j))
