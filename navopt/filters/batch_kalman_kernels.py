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
from navopt.filters.batch_kalman_program import CHECK, CLOSE, FIELDS, SUMS, Layout
from navopt.filters.batch_kalman_steps import (
    FRESH,
    MOVING,
    RESTING,
    add_drive,
    add_errors,
    begin_block,
    coast,
    fetch,
    finish,
    gather_settled,
    hand_over,
    helper,
    hold,
    keep,
    leave_out,
    share,
    watch,
)
from navopt.filters.lane_sums import add_sums
from navopt.filters.lanes import (
    LANES,
    call,
    keep_small,
    load,
    peek,
    peek_index,
    poke_index,
    store,
    sub,
)

__all__ = ["advance_address", "filter_lanes"]

ROW = 8 * LANES
#: Steps between two looks at whether the covariance still changes.
WATCH = 8
#: Most blocks in one instruction, and most bytes of their workspaces: they are to stay in the nearest cache.
GROUP, NEAR = 4, 32768
CHI, STEP_CHI, SETTLED, PADDING = Layout.CHI, Layout.STEP_CHI, Layout.SETTLED, Layout.PADDING


def _advance(task):
    """Carry out whole steps of some blocks, as `BASES` to `END` of the task say."""
    keep_small()
    n, m, T = peek_index(task, at.N), peek_index(task, at.M), peek_index(task, at.T)
    bases, number, order = peek_index(task, at.BASES), peek_index(task, at.NUMBER), peek_index(task, at.ORDER)
    workspace, size = peek_index(task, at.WORKSPACE), peek_index(task, at.ROWS) * ROW
    parts = task + 8 * at.KEPT
    # flags are read where they are needed: for each value of one that it knows not to change the compiler
    # would make a copy of the loop
    for t in range(peek_index(task, at.BEGIN), peek_index(task, at.END)):
        y, seen = peek_index(task, at.Y) + 8 * t * m, peek_index(peek_index(task, at.MEASURED), t)
        drive = peek_index(task, at.DRIVE) + t * peek_index(task, at.NEXT_DRIVE)
        share(task, t)
        for b in range(number):
            base = peek_index(bases, b)
            fetch(task, order + 8 * LANES * ((base - workspace) // size), base, t)
            if peek_index(task, at.KEEPS):
                store(base, STEP_CHI, load(base, CHI))
                keep(task, parts, parts + 16 * at.PART, base, t)
        for stage in range(at.UPDATE, at.PREDICT + 1):
            if stage == at.NOISE:
                for b in range(number):
                    base = peek_index(bases, b)
                    if peek_index(task, at.KEEPS):
                        store(base, STEP_CHI, sub(load(base, CHI), load(base, STEP_CHI)))
                        keep(task, parts + 16 * at.PART, parts + 40 * at.PART, base, t)
                    if peek_index(task, at.TRUTH):
                        add_errors(task, base, peek_index(task, at.TRUTH) + 8 * t * n)
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
                if code == SUMS:
                    add_sums(operation, bases, number, peek_index(task, at.SHARED))
                elif code == CHECK:
                    if math.isnan(peek(y, k)):
                        for b in range(number):
                            leave_out(task, peek_index(bases, b), k, w)
                        operation += peek_index(operation, 3)
                        continue
                else:
                    for b in range(number):
                        if code == CLOSE:
                            finish(task, peek_index(bases, b), k, w, peek(y, k), float(t))
                        else:
                            add_drive(task, peek_index(bases, b), drive)
                operation += 8 * FIELDS
        for b in range(number):
            hold(task, peek_index(bases, b))


@lru_cache
def advance_address() -> int:
    """Where the compiled `_advance` is: called by its address, it is not compiled into its caller again."""
    options: dict[str, Any] = {"cache": True, "error_model": "numpy"}
    address: int = cfunc("void(int64)", **options)(_advance).address
    return address


@helper
def _advance_all(task, bases, number, begin, end):
    """Carry out whole steps of blocks, as many at a time as the nearest cache holds."""
    keep_small()
    size = peek_index(task, at.ROWS) * ROW
    near = GROUP if GROUP * size <= NEAR else NEAR // size
    near = near if near > 0 else 1
    for first in range(0, number, near):
        poke_index(task, at.BASES, bases + 8 * first)
        poke_index(task, at.NUMBER, number - first if number - first < near else near)
        poke_index(task, at.BEGIN, begin)
        poke_index(task, at.END, end)
        call(peek_index(task, at.ADVANCE), task)


@njit(cache=True, nogil=True, error_model="numpy")
def filter_lanes(task):
    """Filter all candidates.

    Parameters
    ----------
    task : int
        Address of the integers that `navopt.filters.batch_kalman_task` lists. Nothing is checked.
    """
    keep_small()
    m, T, measured = peek_index(task, at.M), peek_index(task, at.T), peek_index(task, at.MEASURED)
    workspace, size = peek_index(task, at.WORKSPACE), peek_index(task, at.ROWS) * ROW
    moving = task + 8 * at.LISTS
    fresh, resting = moving + 8 * at.POOL, moving + 16 * at.POOL
    states, order = moving + 24 * at.POOL, moving + 32 * at.POOL
    poke_index(task, at.ORDER, order)
    blocks = (peek_index(task, at.K) + LANES - 1) // LANES
    for start in range(0, blocks, at.POOL):
        count = blocks - start if blocks - start < at.POOL else at.POOL
        for b in range(count):
            for l in range(peek_index(task, at.LANES_USED)):
                poke_index(order, b * LANES + l, (start + b) * LANES + l)
            begin_block(task, workspace + b * size, order + 8 * b * LANES)
        # not literals, for which numba would compile what is called with them once more
        watched, begin = 0 * m, 0 * m
        while begin < T:
            # as far as the next look, or a missing measurement, after which nothing is settled
            end = begin + 1
            while end < T and end % WATCH != 0 and peek_index(measured, end) == m:
                end += 1
            if begin == 0 or peek_index(measured, begin) < m:
                watched = 0 * m
                for b in range(count):
                    base = workspace + b * size
                    store(base, SETTLED, load(base, PADDING))
                    poke_index(states, b, MOVING)
            number_moving, number_fresh, number_resting = 0 * m, 0 * m, 0 * m
            for b in range(count):
                if peek_index(states, b) == MOVING:
                    poke_index(moving, number_moving, workspace + b * size)
                    number_moving += 1
                elif peek_index(states, b) == FRESH:
                    poke_index(fresh, number_fresh, workspace + b * size)
                    number_fresh += 1
                else:
                    poke_index(resting, number_resting, workspace + b * size)
                    number_resting += 1
            _advance_all(task, moving, number_moving, begin, end)
            # what has just settled takes one more whole step, which fills the workspace with what the settled
            # covariance gives, and then rests with the others
            _advance_all(task, fresh, number_fresh, begin, begin + 1)
            for t in range(begin, end):
                y = peek_index(task, at.Y) + 8 * t * m
                drive = peek_index(task, at.DRIVE) + t * peek_index(task, at.NEXT_DRIVE)
                for b in range(number_resting):
                    coast(task, peek_index(resting, b), y, drive, t)
                if t == begin:
                    for b in range(number_fresh):
                        base = peek_index(fresh, b)
                        poke_index(states, (base - workspace) // size, RESTING)
                        poke_index(resting, number_resting, base)
                        number_resting += 1
            if end % WATCH == 0 and peek_index(task, at.STEADY):
                for b in range(number_moving):
                    watch(task, peek_index(moving, b), watched)
                watched = m
                if not peek_index(task, at.KEEPS):
                    gather_settled(task, moving, number_moving, states, order)
            begin = end
        for b in range(count):
            hand_over(task, workspace + b * size, order + 8 * b * LANES)
