"""The compiled Kalman filter: eight candidates of (Q, R, P0) at once, over all steps.

Every matrix of a candidate is a row of eight doubles per entry (`navopt.filters.lanes`) in one workspace.
Measurements are used one at a time with symmetric P: diagonal R needs no matrix inverted, and correlated
noise is taken apart by ``S = L D Lᵀ`` first, after which it is the same. Entries of F and H that are zero
at all times are left out.

Where the model is constant and nothing is missing, the covariance of each lane is held once it has settled,
and a block whose lanes have all settled only moves its states. A lane decides for itself, so that its bits
do not depend on its company.
"""

from __future__ import annotations

import math

from numba import njit

from navopt.filters.batch_kalman_steps import (
    correct,
    gather,
    hold,
    innovate,
    innovation,
    joseph,
    keep_innovations,
    keep_rows,
    measure,
    move,
    multiply,
    orthogonalise,
    predict,
    process_noise,
    reduce,
    renew,
    watch,
)
from navopt.filters.lanes import (
    LANES,
    add,
    count_set,
    div,
    first_bad,
    load,
    muladd,
    peek,
    peek_index,
    poke,
    poke_index,
    splat,
    store,
    sub,
)

__all__ = ["JOSEPH", "MATRIX", "SEQUENTIAL", "filter_lanes", "workspace_rows"]

SEQUENTIAL, MATRIX, JOSEPH = 0, 1, 2
LN_2 = math.log(2.0)
#: Steps between two looks at whether the covariance still changes.
WATCH = 8

_compiled = njit(cache=True, nogil=True, error_model="numpy")


def workspace_rows(n: int, m: int, g: int) -> int:
    """Rows of eight doubles that `filter_lanes` needs for n states, m channels and g process noises."""
    rows = 5 * n * n + n * g + 3 * n + m * n + 2 * m * m + m + 7
    return rows + (n * n + m * n + m) // LANES + 1


@_compiled
def filter_lanes(sizes, flags, model, candidates, results, kept, ws):
    """Filter all candidates, block by block. Matrices are contiguous doubles, given by their addresses.

    Parameters
    ----------
    sizes : tuple of int
        n, m, g, T, number of candidates K.
    flags : int
        Address of integers (int64): whether F, H, G and the drive vary with time, errors are to be summed,
        and `kept` is to be filled; update (`SEQUENTIAL`, which ignores all of R but its diagonal, `MATRIX`
        or `JOSEPH`); number of steps of Q and of R (T or 1).
    model : tuple of int
        F, H, G, drive (n per step), y (T, m; NaN is missing), x0 (n), true states (T, n), columns and counts
        of the entries of F and of H that are not zero at all times (int64, shaped as F or H and its rows).
    candidates : tuple of int
        Q (blocks, steps, g², 8), R (blocks, steps, m², 8), P0 (blocks, n², 8).
    results : tuple of int
        Log-likelihoods (K), first steps with an impossible innovation variance (K; T if none), sums of
        squared errors of the filtered states (K, n).
    kept : tuple of int
        Predicted states (K, T, n) and covariances (K, T, n²), the same filtered, innovations (K, T, m), their
        covariances (K, T, m²), normalised innovations squared (K, T).
    ws : int
        Workspace of `workspace_rows` rows, best on a cache line.
    """
    n, m, g, T, K = sizes
    F, H, G, drive, y, x0, truth, fc, fn, hc, hn = model
    Q, R, P0 = candidates
    log_likelihood, failed, squares = results
    predicted, P_predicted, filtered, P_filtered, innovations, S_innovations, nis = kept
    blocks, square = (K + LANES - 1) // LANES, n * n
    P, A, W, prior, spare = 0 * square, square, 2 * square, 3 * square, 4 * square
    GQ = 5 * square
    x, moved, sse = GQ + n * g, GQ + n * g + n, GQ + n * g + 2 * n
    w = sse + n
    S, L, e = w + m * n, w + m * n + m * m, w + m * n + 2 * m * m
    zero, product, power, chi, fail, step_chi = e + m, e + m + 1, e + m + 2, e + m + 3, e + m + 4, e + m + 5
    settled = step_chi + 1
    # the values of F and H and the channels measured are plain numbers behind the rows
    fv = ws + 8 * LANES * (settled + 1)
    hv, rows = fv + 8 * square, fv + 8 * (square + m * n)
    for block in range(blocks):
        lane = block * LANES
        used = min(LANES, K - lane)
        for i in range(zero, settled + 1):
            store(ws, i, splat(0.0))
        store(ws, product, splat(1.0))
        store(ws, fail, splat(float(T)))
        for i in range(n):
            store(ws, sse + i, splat(0.0))
            store(ws, x + i, splat(peek(x0, i)))
        for i in range(square):
            store(ws, P + i, load(P0, block * square + i))
        observed, watched, number_settled, resting = 0, False, 0, False
        for t in range(T):
            # read anew at every step: knowing them fixed, the compiler makes a copy of the loop for each case
            varying_F, varying_H, varying_G = peek_index(flags, 0), peek_index(flags, 1), peek_index(flags, 2)
            driven, wanted, keep, update = (
                peek_index(flags, 3), peek_index(flags, 4), peek_index(flags, 5), peek_index(flags, 6)
            )  # fmt: skip
            steps_Q, steps_R = peek_index(flags, 7), peek_index(flags, 8)
            steady = (
                varying_F + varying_H + varying_G == 0 and steps_Q == 1 and steps_R == 1 and update != JOSEPH
            )
            h = t * m * n if varying_H else 0
            if t == 0 or varying_H:
                gather(H + 8 * h, m, n, hc, hn, hv)
            first = (block * steps_R + (t if steps_R > 1 else 0)) * m * m
            # not a literal, for which numba would compile everything twice
            count = 0 * m
            for j in range(m):
                if not math.isnan(peek(y, t * m + j)):
                    poke_index(rows, count, j)
                    count += 1
            observed += count
            if count < m:
                # without a measurement nothing is settled
                store(ws, settled, splat(0.0))
                watched, number_settled, resting = False, 0, False
            if keep:
                keep_rows(ws, x, n, predicted, T, lane, used, t)
                keep_rows(ws, P, square, P_predicted, T, lane, used, t)
                store(ws, step_chi, load(ws, chi))
            rests = resting and not keep
            if rests:
                # variances, w and L in the workspace are those of every step to come
                if update != SEQUENTIAL:
                    renew(ws, n, m, y, t, x, L, e, hc, hv, hn, zero)
            elif keep or update != SEQUENTIAL:
                innovate(ws, n, m, count, rows, y, t, R, first, P, x, w, S, e, hc, hv, hn, zero)
            if keep:
                keep_innovations(ws, m, count, rows, e, S, innovations, S_innovations, T, lane, used, t)
            if update == JOSEPH:
                for i in range(square):
                    store(ws, prior + i, load(ws, P + i))
            if update != SEQUENTIAL and not rests:
                orthogonalise(ws, n, m, count, w, S, L, e)
            for k in range(count):
                at = w + k * n
                if update == SEQUENTIAL:
                    j = peek_index(rows, k)
                    if not rests:
                        measure(ws, n, m, j, R, first, P, at, S + k * m + k, hc, hv, hn, zero)
                    error = innovation(ws, n, j, t * m, y, x, hc, hv, hn, zero)
                else:
                    error = load(ws, e + k)
                variance = load(ws, S + k * m + k)
                store(ws, fail, first_bad(load(ws, fail), variance, float(t)))
                multiply(ws, variance, product, power)
                store(ws, chi, add(load(ws, chi), correct(ws, n, x, at, variance, error)))
                if not rests:
                    reduce(ws, n, P, at, variance)
            if update == JOSEPH and count:
                for k in range(count):
                    for i in range(w + k * n, w + (k + 1) * n):
                        store(ws, i, div(load(ws, i), load(ws, S + k * m + k)))
                joseph(ws, n, m, count, rows, H + 8 * h, R, first, P, prior, w, L, A, spare)
            if keep:
                keep_rows(ws, x, n, filtered, T, lane, used, t)
                keep_rows(ws, P, square, P_filtered, T, lane, used, t)
                store(ws, step_chi, sub(load(ws, chi), load(ws, step_chi)))
                keep_rows(ws, step_chi, 1, nis, T, lane, used, t)
            if wanted:
                for i in range(n):
                    error = sub(load(ws, x + i), splat(peek(truth, t * n + i)))
                    store(ws, sse + i, muladd(error, error, load(ws, sse + i)))
            if t == T - 1:
                break
            here = drive + (8 * t * n if driven else 0)
            if rests:
                move(ws, n, x, moved, here, fc, fv, fn)
                continue
            if t == 0 or varying_G or steps_Q > 1:
                number = (block * steps_Q + (t if steps_Q > 1 else 0)) * g * g
                process_noise(ws, n, g, G + (8 * t * n * g if varying_G else 0), Q, number, W, GQ)
            if t == 0 or varying_F:
                gather(F + (8 * t * square if varying_F else 0), n, n, fc, fn, fv)
            predict(ws, n, P, A, W, x, moved, here, fc, fv, fn, zero)
            if steady:
                if number_settled:
                    hold(ws, n, P, prior, settled)
                if t % WATCH == WATCH - 1:
                    watch(ws, n, P, prior, settled, watched)
                    watched = True
                # one more whole step fills the workspace with what the settled covariance gives
                resting = number_settled == LANES
                number_settled = count_set(load(ws, settled))
        for l in range(used):
            chi_square = peek(ws, chi * LANES + l)
            logarithm = math.log(peek(ws, product * LANES + l)) + LN_2 * peek(ws, power * LANES + l)
            poke(
                log_likelihood, lane + l, -0.5 * (observed * math.log(2.0 * math.pi) + logarithm + chi_square)
            )
            poke(failed, lane + l, peek(ws, fail * LANES + l))
            for i in range(n):
                poke(squares, (lane + l) * n + i, peek(ws, (sse + i) * LANES + l))
