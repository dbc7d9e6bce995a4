"""The compiled Kalman filter: it carries out the programs of a model for all candidates at every time.

Every entry of a matrix of a candidate is a lane of a row of eight doubles (`navopt.filters.lanes`) in the
workspace of its block. Small filters work on a few blocks at a time, so that one computes while another
waits for its own last result.

Where the model is constant and nothing is missing, the covariance of each lane is held once it has settled.
Lanes that have are gathered in blocks of their own, which only move their states from then on. A lane decides
for itself, and both ways give it the same bits, which therefore do not depend on its company.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

from numba import cfunc, njit

from navopt.filters import batch_kalman_task as at
from navopt.filters.batch_kalman_program import CHECK, FIELDS, SUMS, Layout
from navopt.filters.batch_kalman_steps import (
    FRESH,
    MOVING,
    RESTING,
    carry,
    finish,
    gather_settled,
    hold,
    spread,
    watch,
)
from navopt.filters.lane_sums import add_sums
from navopt.filters.lanes import (
    LANES,
    add,
    call,
    choose,
    keep_small,
    load,
    log,
    mul,
    muladd,
    peek,
    peek_index,
    poke,
    poke_index,
    splat,
    store,
    sub,
)

__all__ = ["advance_address", "filter_lanes"]

ROW = 8 * LANES
#: Steps between two looks at whether the covariance still changes.
WATCH = 8
LN_2 = math.log(2.0)
PRODUCT, POWER, CHI, FAIL, STEP_CHI = Layout.PRODUCT, Layout.POWER, Layout.CHI, Layout.FAIL, Layout.STEP_CHI
SETTLED, PADDING, CANDIDATE, STATE = Layout.SETTLED, Layout.PADDING, Layout.CANDIDATE, Layout.STATE


def _advance(task):
    """Carry out whole steps of some blocks, as `BASES` to `RESTS` of the task say."""
    keep_small()
    m, T = peek_index(task, at.M), peek_index(task, at.T)
    bases, number = peek_index(task, at.BASES), peek_index(task, at.NUMBER)
    predicted, filtered, results = task + 8 * at.PREDICTED, task + 8 * at.FILTERED, task + 8 * at.RESULTS
    # flags are read where they are needed: for each value of one that it knows not to change the compiler
    # would make a copy of the loop
    for t in range(peek_index(task, at.BEGIN), peek_index(task, at.END)):
        y, seen = peek_index(task, at.Y) + 8 * t * m, peek_index(peek_index(task, at.MEASURED), t)
        rests, keeps = peek_index(task, at.RESTS), peek_index(task, at.KEEPS)
        shared, source = peek_index(task, at.SHARED), task + 8 * at.SOURCES
        new = t == 0 or peek_index(task, at.SHARED_VARIES)
        for _ in range(peek_index(task, at.MATRICES_USED) if new else 0):
            entries, step = peek_index(source, 1), peek_index(source, 2)
            if t == 0 or step > 0:
                spread(shared, peek_index(source, 0) + t * step, entries)
            shared += ROW * entries
            source += 24
        for b in range(0 if rests else number):
            base = peek_index(bases, b)
            if t == 0:
                start = peek_index(task, at.START) + 8 * PRODUCT
                spread(base + ROW * PRODUCT, start, peek_index(task, at.ROWS) - PRODUCT)
            carry(task, task + 8 * at.CANDIDATES, filtered if keeps else predicted, base, t)
            store(base, STEP_CHI, load(base, CHI))
        for stage in range(at.INNOVATE if rests else at.UPDATE, at.MOVE + 1 if rests else at.INNOVATE):
            if stage == at.NOISE or stage == at.MOVE:
                for b in range(number if t == T - 1 or peek_index(task, at.KEEPS) else 0):
                    base = peek_index(bases, b)
                    chi, last = load(base, CHI), results
                    store(base, STEP_CHI, sub(chi, load(base, STEP_CHI)))
                    if t == T - 1:
                        powers = muladd(splat(LN_2), load(base, POWER), log(load(base, PRODUCT)))
                        failed = sub(load(base, FAIL), splat(float(T)))
                        total = mul(splat(-0.5), add(powers, chi))
                        store(base, CHI, choose(failed, splat(math.nan), total))
                        last = task + 8 * at.LISTS
                    carry(task, filtered if peek_index(task, at.KEEPS) else results, last, base, t)
                if t == T - 1:
                    break
            # nothing to use, or known already
            if (stage == at.UPDATE and seen < m) or (stage == at.PARTIAL and (seen == m or seen == 0)):
                continue
            if stage == at.NOISE and t > 0 and not peek_index(task, at.NOISE_VARIES):
                continue
            program = peek_index(task, stage)
            operation = program + 8
            last = operation + 8 * FIELDS * peek_index(program, 0)
            while operation < last:
                code, k, w = peek_index(operation, 0), peek_index(operation, 1), peek_index(operation, 2)
                other = peek_index(operation, 3)
                if code == SUMS:
                    add_sums(operation, bases, number, peek_index(task, at.SHARED))
                elif code == CHECK:
                    if math.isnan(peek(y, k)):
                        operation += other
                        continue
                else:
                    for b in range(number):
                        finish(task, peek_index(bases, b), k, w, peek(y, k), -1.0 if other else float(t))
                operation += 8 * FIELDS
        for b in range(0 if rests else number):
            hold(task, peek_index(bases, b))


@lru_cache
def advance_address() -> int:
    """Where the compiled `_advance` is: called by its address, it is not compiled into its caller again."""
    options: dict[str, Any] = {"cache": True, "error_model": "numpy"}
    address: int = cfunc("void(int64)", **options)(_advance).address
    return address


@njit(cache=True, nogil=True, error_model="numpy")
def filter_lanes(task):
    """Filter all candidates.

    Parameters
    ----------
    task : int
        Address of the integers that `navopt.filters.batch_kalman_task` lists. Nothing is checked.
    """
    keep_small()
    m, T, K = peek_index(task, at.M), peek_index(task, at.T), peek_index(task, at.K)
    measured, workspace = peek_index(task, at.MEASURED), peek_index(task, at.WORKSPACE)
    size, group = peek_index(task, at.ROWS) * ROW, peek_index(task, at.GROUP)
    moving, resting = task + 8 * at.LISTS, task + 8 * at.LISTS + 8 * at.POOL
    for start in range(0, K, at.POOL * LANES):
        count = at.POOL if K - start > at.POOL * LANES else (K - start + LANES - 1) // LANES
        for b in range(count):
            base = workspace + b * size
            for l in range(peek_index(task, at.LANES_USED)):
                k = start + b * LANES + l
                poke(base, PADDING * LANES + l, 0.0 if k < K else 1.0)
                poke(base, CANDIDATE * LANES + l, float(k if k < K else K - 1))
        # not literals, for which numba would compile what is called with them once more
        zero = 0 * m
        watched, begin = zero, zero
        while begin < T:
            number_moving, number_resting, new = zero, zero, zero
            for b in range(count):
                base = workspace + b * size
                if begin == 0 or peek_index(measured, begin) < m:
                    watched = zero
                    store(base, SETTLED, load(base, PADDING))
                    store(base, STATE, splat(MOVING))
                if peek(base, STATE * LANES) == RESTING:
                    poke_index(resting, number_resting, base)
                    number_resting += 1
                    continue
                poke_index(moving, number_moving, base)
                number_moving += 1
                if peek(base, STATE * LANES) == FRESH:
                    # takes one more whole step, which fills the workspace with what the settled covariance
                    # gives, and then rests with the others
                    store(base, STATE, splat(RESTING))
                    new = m
            # as far as the next look, or a missing measurement, after which nothing is settled
            end = begin + 1
            while not new and end < T and end % WATCH != 0 and peek_index(measured, end) == m:
                end += 1
            poke_index(task, at.BEGIN, begin)
            poke_index(task, at.END, end)
            for which in range(peek_index(task, at.LISTS_USED)):
                poke_index(task, at.RESTS, which)
                number = number_resting if which else number_moving
                for first in range(0, number, group):
                    poke_index(task, at.BASES, moving + 8 * (which * at.POOL + first))
                    poke_index(task, at.NUMBER, number - first if number - first < group else group)
                    call(peek_index(task, at.ADVANCE), task)
            if end % WATCH == 0 and peek_index(task, at.STEADY):
                for b in range(number_moving):
                    watch(task, peek_index(moving, b), watched)
                watched = m
                if not peek_index(task, at.KEEPS):
                    gather_settled(task, moving, number_moving)
            begin = end
