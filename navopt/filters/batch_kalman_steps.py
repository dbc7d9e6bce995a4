"""Parts of the compiled filter, each for eight candidates: channels, settling, and what goes in and out.

All work on rows of a workspace given by its address, see `navopt.filters.lanes` and, for the rows,
`navopt.filters.batch_kalman_program.Layout`; n states, m channels.
"""

from __future__ import annotations

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
    mulsub,
    peek,
    peek_index,
    poke,
    splat,
    store,
    sub,
)

__all__ = [
    "FRESH",
    "MOVING",
    "RESTING",
    "carry",
    "finish",
    "gather_settled",
    "helper",
    "hold",
    "spread",
    "watch",
]

#: A covariance that changes by less than this part of itself over a few steps has settled.
SETTLED = 1e-14
#: A block whose covariances move; one that has just settled; one of which only the states move.
MOVING, FRESH, RESTING = 0.0, 1.0, 2.0
PRODUCT, POWER, CHI, FAIL, SETTLED_LANES, PADDING, CANDIDATE, STATE = (
    Layout.PRODUCT, Layout.POWER, Layout.CHI, Layout.FAIL, Layout.SETTLED, Layout.PADDING, Layout.CANDIDATE,
    Layout.STATE,
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
def gather_settled(task, moving, number):
    """Put lanes that have settled together at the end, if that leaves a block that need not move any more."""
    keep_small()
    settled, unsettled, front, back = 8 * LANES * SETTLED_LANES, 0, 0, LANES * number - 1
    for b in range(number):
        unsettled += LANES - count_set(load(peek_index(moving, b), SETTLED_LANES))
    first = (unsettled + LANES - 1) // LANES
    while first < number and front < back:
        here = peek_index(moving, front // LANES) + 8 * (front % LANES)
        there = peek_index(moving, back // LANES) + 8 * (back % LANES)
        if peek(here + settled, 0) == 0.0:
            front += 1
        elif peek(there + settled, 0) != 0.0:
            back -= 1
        else:
            for i in range(peek_index(task, at.ROWS)):
                value = peek(here, i * LANES)
                poke(here, i * LANES, peek(there, i * LANES))
                poke(there, i * LANES, value)
    for b in range(first, number):
        store(peek_index(moving, b), STATE, splat(FRESH))


@helper
def spread(rows, first, number):
    """Put numbers into rows, the same for all lanes."""
    keep_small()
    for i in range(number):
        store(rows, i, splat(peek(first, i)))


@helper
def carry(task, part, last, base, t):
    """Copy matrices of time t between the lanes of a block and where those of all candidates are."""
    keep_small()
    while part < last:
        step, rows, columns = peek_index(part, 2), peek_index(part, 3), peek_index(part, 4)
        for l in range(peek_index(task, at.LANES_USED) if step > 0 or t == peek_index(part, 8) else 0):
            out, lane = peek_index(part, 7), base + 8 * l
            if out and peek(lane, PADDING * LANES) != 0.0:
                continue
            there = peek_index(part, 0) + int(peek(lane, CANDIDATE * LANES)) * peek_index(part, 1) + t * step
            for i in range(rows):
                here = lane + 8 * LANES * (peek_index(part, 5) + i * peek_index(part, 6))
                for j in range(columns):
                    if out:
                        poke(there, j, peek(here, j * LANES))
                    else:
                        poke(here, j * LANES, peek(there, j))
                there += 8 * columns
        part += 8 * at.PART
