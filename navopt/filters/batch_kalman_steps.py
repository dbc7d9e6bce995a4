"""Parts of the compiled filter, each for eight candidates: channels, settling, and what goes in and out.

All work on rows of a workspace given by its address, see `navopt.filters.lanes` and, for the rows,
`navopt.filters.batch_kalman_program.Layout`; n states, m channels.
"""

from __future__ import annotations

import math

from numba import njit

from navopt.filters import batch_kalman_task as at
from navopt.filters.batch_kalman_program import Layout
from navopt.filters.lanes import (
    LANES,
    add,
    choose,
    count_set,
    div,
    exponent,
    first_bad,
    if_close,
    keep_small,
    load,
    mantissa,
    mul,
    muladd,
    mulsub,
    peek,
    peek_index,
    poke,
    poke_index,
    splat,
    store,
    sub,
)

__all__ = [
    "FRESH",
    "MOVING",
    "RESTING",
    "add_drive",
    "add_errors",
    "begin_block",
    "coast",
    "fetch",
    "finish",
    "gather_settled",
    "hand_over",
    "helper",
    "hold",
    "keep",
    "leave_out",
    "share",
    "watch",
]

#: A covariance that changes by less than this part of itself over a few steps has settled.
SETTLED = 1e-14
#: A block whose covariances move; one that has just settled; one of which only the states move.
MOVING, FRESH, RESTING = range(3)
LN_2 = math.log(2.0)
PRODUCT, POWER, CHI, FAIL, SETTLED_LANES, PADDING, ONE = (
    Layout.PRODUCT, Layout.POWER, Layout.CHI, Layout.FAIL, Layout.SETTLED, Layout.PADDING, Layout.ONE
)  # fmt: skip

#: Compiles what is never called from Python: the wrappers would take as long as the function itself.
helper = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


@helper
def finish(task, base, k, w, y, step):
    """Use channel k, all of whose sums are there: its part of the likelihood and its gains.

    With a negative step the gains are known from before.
    """
    keep_small()
    n = peek_index(task, at.N)
    inverse = peek_index(task, at.INVERSE) + k
    error = sub(load(base, w + n), splat(y))
    store(base, w + n, error)
    variance = load(base, peek_index(task, at.VARIANCE) + k)
    if step >= 0.0:
        negative = div(splat(-1.0), variance)
        store(base, inverse, negative)
        store(base, FAIL, first_bad(load(base, FAIL), variance, step))
        gain = peek_index(task, at.GAIN) + k * n
        for i in range(n):
            store(base, gain + i, mul(load(base, w + i), negative))
    scaled = mul(error, load(base, inverse))
    store(base, CHI, mulsub(error, scaled, load(base, CHI)))
    # the product of variances as a number between 1 and 2 and a power of two: a logarithm at each step would
    # cost more than all the rest of a small filter
    product = mul(load(base, PRODUCT), variance)
    store(base, PRODUCT, mantissa(product))
    store(base, POWER, add(load(base, POWER), exponent(product)))


@helper
def leave_out(task, base, k, w):
    """Make the sums of later channels and of the covariance free of channel k, which is missing."""
    keep_small()
    n, m = peek_index(task, at.N), peek_index(task, at.M)
    store(base, w + n, splat(0.0))
    store(base, peek_index(task, at.INVERSE) + k, splat(0.0))
    for i in range(n):
        store(base, peek_index(task, at.GAIN) + k * n + i, splat(0.0))
    for i in range(m):
        store(base, peek_index(task, at.FACTOR) + k * m + i, splat(0.0))


@helper
def add_drive(task, base, drive):
    """The next state: what the transition made of it, at the end of A, and what the known input adds."""
    keep_small()
    n, P, A = peek_index(task, at.N), peek_index(task, at.P), peek_index(task, at.A)
    last = n * (n + 1)
    for i in range(n):
        value = add(load(base, A + last + i), splat(peek(drive, i)))
        store(base, P + last + i, value)
        store(base, P + i * (n + 1) + n, value)


@helper
def add_errors(task, base, truth):
    """Squares of the errors of the state."""
    keep_small()
    n, squares = peek_index(task, at.N), peek_index(task, at.SQUARES)
    x = peek_index(task, at.P) + n * (n + 1)
    for i in range(n):
        error = sub(load(base, x + i), splat(peek(truth, i)))
        store(base, squares + i, muladd(error, error, load(base, squares + i)))


@helper
def coast(task, base, y, drive, t):
    """Step t of a block whose covariance has settled: innovations, state and, if not the last, prediction."""
    keep_small()
    n, m, shared = peek_index(task, at.N), peek_index(task, at.M), peek_index(task, at.SHARED)
    x, A = peek_index(task, at.P) + n * (n + 1), peek_index(task, at.A) + n * (n + 1)
    columns, number = peek_index(task, at.H_COLUMNS), peek_index(task, at.SOURCES + 1)
    factor, gain, first = peek_index(task, at.FACTOR), peek_index(task, at.GAIN), peek_index(task, at.W)
    w = first
    for k in range(m):
        total = splat(0.0)
        for c in range(1, peek_index(columns, 0) + 1):
            total = muladd(load(shared, number), load(base, x + peek_index(columns, c)), total)
            number += 1
        columns += 8 * (peek_index(columns, 0) + 1)
        for i in range(k):
            total = muladd(load(base, factor + k * m + i), load(base, first + i * (n + 1) + n), total)
        store(base, w + n, total)
        finish(task, base, k, w, peek(y, k), -1.0)
        w += n + 1
    for i in range(n):
        total = load(base, x + i)
        for k in range(m):
            total = muladd(load(base, first + k * (n + 1) + n), load(base, gain + k * n + i), total)
        store(base, x + i, total)
    if peek_index(task, at.TRUTH):
        add_errors(task, base, peek_index(task, at.TRUTH) + 8 * t * n)
    if t == peek_index(task, at.T) - 1:
        return
    columns, number = peek_index(task, at.F_COLUMNS), 0
    for i in range(n):
        total = splat(0.0)
        for c in range(1, peek_index(columns, 0) + 1):
            total = muladd(load(shared, number), load(base, x + peek_index(columns, c)), total)
            number += 1
        columns += 8 * (peek_index(columns, 0) + 1)
        store(base, A + i, total)
    add_drive(task, base, drive)


@helper
def hold(task, base):
    """Put the covariance of settled lanes back to what it was when it settled."""
    keep_small()
    n, P, held = peek_index(task, at.N), peek_index(task, at.P), peek_index(task, at.HELD)
    settled = load(base, SETTLED_LANES)
    if count_set(settled) == count_set(load(base, PADDING)):
        return
    for i in range(n):
        for k in range(i * (n + 1), i * (n + 1) + n):
            store(base, P + k, choose(settled, load(base, held + k), load(base, P + k)))


@helper
def watch(task, base, compare):
    """See which lanes have not changed since the last time, if there was one, and remember all."""
    keep_small()
    n, P, held = peek_index(task, at.N), peek_index(task, at.P), peek_index(task, at.HELD)
    wide = n + 1
    if compare > 0:
        mask = splat(1.0)
        for i in range(n):
            for j in range(i + 1):
                size = mul(load(base, P + i * wide + i), load(base, P + j * wide + j))
                change = sub(load(base, P + i * wide + j), load(base, held + i * wide + j))
                mask = if_close(mask, change, mul(size, splat(SETTLED * SETTLED)))
        store(base, SETTLED_LANES, choose(load(base, PADDING), splat(1.0), mask))
    for i in range(n * wide):
        store(base, held + i, load(base, P + i))


@helper
def gather_settled(task, moving, number, states, order):
    """Put lanes that have settled together at the end, if that leaves a block that need not move any more."""
    keep_small()
    workspace, rows = peek_index(task, at.WORKSPACE), peek_index(task, at.ROWS)
    settled, unsettled, front, back = 8 * LANES * SETTLED_LANES, 0, 0, LANES * number - 1
    for b in range(number):
        unsettled += LANES - count_set(load(peek_index(moving, b), SETTLED_LANES))
    first = (unsettled + LANES - 1) // LANES
    while first < number:
        here = peek_index(moving, front // LANES) + 8 * (front % LANES)
        there = peek_index(moving, back // LANES) + 8 * (back % LANES)
        if front >= back:
            break
        if peek(here + settled, 0) == 0.0:
            front += 1
        elif peek(there + settled, 0) != 0.0:
            back -= 1
        else:
            for i in range(rows):
                value = peek(here, i * LANES)
                poke(here, i * LANES, peek(there, i * LANES))
                poke(there, i * LANES, value)
            # whose lanes they are
            one = (here - workspace) // (8 * LANES * rows) * LANES + front % LANES
            other = (there - workspace) // (8 * LANES * rows) * LANES + back % LANES
            candidate = peek_index(order, one)
            poke_index(order, one, peek_index(order, other))
            poke_index(order, other, candidate)
    for b in range(first, number):
        poke_index(states, (peek_index(moving, b) - workspace) // (8 * LANES * rows), FRESH)


@helper
def fetch(task, order, base, t):
    """Put the symmetric parts of a block's candidates into its lanes, as far as they are new."""
    keep_small()
    entry, last = task + 8 * at.CANDIDATES, peek_index(task, at.K) - 1
    for _ in range(peek_index(task, at.CANDIDATES_USED)):
        source, between, steps = peek_index(entry, 0), peek_index(entry, 1), peek_index(entry, 2)
        width, to, stride = peek_index(entry, 3), peek_index(entry, 4), peek_index(entry, 5)
        entry += 8 * at.CANDIDATE
        if t > 0 and steps == 1:
            continue
        for l in range(peek_index(task, at.LANES_USED)):
            k = peek_index(order, l)
            matrix = source + (k if k < last else last) * between + 8 * t * width * width
            for i in range(width):
                for j in range(width):
                    value = 0.5 * (peek(matrix, i * width + j) + peek(matrix, j * width + i))
                    poke(base, (to + i * stride + j) * LANES + l, value)


@helper
def share(task, t):
    """Put the entries of the matrices of the model into the rows that all blocks share."""
    keep_small()
    shared, source = peek_index(task, at.SHARED), task + 8 * at.SOURCES
    for _ in range(peek_index(task, at.MATRICES_USED)):
        first, number, step = peek_index(source, 0), peek_index(source, 1), peek_index(source, 2)
        if t == 0 or step > 0:
            for i in range(number):
                store(shared, i, splat(peek(first + t * step, i)))
        shared += 8 * LANES * number
        source += 24


@helper
def begin_block(task, base, order):
    """First state and covariance of a block; all else is zero."""
    keep_small()
    n, P, K = peek_index(task, at.N), peek_index(task, at.P), peek_index(task, at.K)
    wide = n + 1
    # also what a missing channel would leave: not a number times zero is none
    for i in range(peek_index(task, at.ROWS)):
        store(base, i, splat(0.0))
    store(base, PRODUCT, splat(1.0))
    store(base, ONE, splat(1.0))
    store(base, FAIL, splat(float(peek_index(task, at.T))))
    for i in range(n):
        value = splat(peek(peek_index(task, at.X0), i))
        store(base, P + i * wide + n, value)
        store(base, P + n * wide + i, value)
    for l in range(peek_index(task, at.LANES_USED)):
        if peek_index(order, l) >= K:
            poke(base, PADDING * LANES + l, 1.0)


@helper
def hand_over(task, base, order):
    """Results of a block's candidates."""
    keep_small()
    n, K, squares = peek_index(task, at.N), peek_index(task, at.K), peek_index(task, at.SQUARES)
    for l in range(peek_index(task, at.LANES_USED)):
        k, lane = peek_index(order, l), base + 8 * l
        if k >= K:
            continue
        logarithm = math.log(peek(lane, PRODUCT * LANES)) + LN_2 * peek(lane, POWER * LANES)
        total, fail = -0.5 * (logarithm + peek(lane, CHI * LANES)), peek(lane, FAIL * LANES)
        poke(peek_index(task, at.LOGS), k, total)
        poke(peek_index(task, at.FAILED), k, fail)
        if fail < peek_index(task, at.T) or not math.isfinite(total):
            poke_index(task, at.FAILURES, peek_index(task, at.FAILURES) + 1)
        for i in range(n):
            poke(peek_index(task, at.ERRORS), k * n + i, peek(lane, (squares + i) * LANES))


@helper
def keep(task, part, last, base, t):
    """Copy rows of a block to where the parts of the results from `part` to `last` are kept."""
    keep_small()
    block = (base - peek_index(task, at.WORKSPACE)) // (8 * LANES * peek_index(task, at.ROWS))
    first = peek_index(peek_index(task, at.ORDER), block * LANES)
    while part < last:
        row, rows, columns = peek_index(part, 0), peek_index(part, 1), peek_index(part, 2)
        stride, out = peek_index(part, 3), peek_index(part, 4)
        part += 8 * at.PART
        for k in range(first, first + LANES):
            if k < peek_index(task, at.K):
                to = (k * peek_index(task, at.T) + t) * rows * columns
                for i in range(rows):
                    for j in range(columns):
                        poke(out, to, peek(base, (row + i * stride + j) * LANES + k - first))
                        to += 1
