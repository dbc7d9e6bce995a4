"""What the compiled filter is given: the places of an array of 64-bit integers, most of them addresses.

Numbers are contiguous doubles; K candidates, T steps, n states, m channels, g process noises.
"""

from __future__ import annotations

from navopt.filters.batch_kalman_program import MATRICES
from navopt.filters.lanes import LANES

#: Blocks in memory together.
POOL = 16

(
    # sizes; lanes of a block and numbers of the lists below, which the compiler must not know, or it
    # would write as many copies of every loop
    N, M, G, T, K, LANES_USED, MATRICES_USED, CANDIDATES_USED,
    # whether the process noise varies, and whether settling may be looked for
    NOISE_VARIES, STEADY,
    # workspaces, one after the other, the rows of one, and rows that all share
    WORKSPACE, ROWS, SHARED,
    # numbers of rows in a workspace
    SQUARES, P, HELD, A, W, GAIN, FACTOR, VARIANCE, INVERSE,
    # programs, see `navopt.filters.batch_kalman_program`
    UPDATE, PARTIAL, NOISE, PREDICT,
    # of each row of F and of H how many entries are not zero at all times, and their columns
    F_COLUMNS, H_COLUMNS,
    # first state; measurements (T, m), and how many channels are measured at each time; what the known input
    # adds (n), and the bytes to the next time; true states (T, n) or 0
    X0, Y, MEASURED, DRIVE, NEXT_DRIVE, TRUTH,
    # results: log-likelihood without its constant (K), first step with an impossible innovation variance (K;
    # T if none), sums of squared errors (K, n), and how many candidates failed
    LOGS, FAILED, ERRORS, FAILURES,
    # whether everything is kept
    KEEPS,
    # the compiled steps; the blocks and the times they are called for; whose lanes those in memory are
    ADVANCE, BASES, NUMBER, BEGIN, END, ORDER,
    # of each of `MATRICES` its entries, how many, and the bytes to the next time
    SOURCES,
) = range(46)  # fmt: skip
#: Of Q, R and P0 the address of (K, steps, width, width), the bytes to the next candidate (0 if all have the
#: same), steps (T or 1), width, and the first row and the rows from one row to the next in a workspace.
CANDIDATES, CANDIDATE = SOURCES + 3 * len(MATRICES), 6
#: Of states and covariances, predicted and filtered, and of the normalised innovations squared the first row,
#: rows, columns, rows from one row to the next, and the address of an array (K, T, rows, columns).
KEPT, PART = CANDIDATES + 3 * CANDIDATE, 5
#: Where the kernel keeps its lists, and where they end.
LISTS = KEPT + 5 * PART
SIZE = LISTS + (4 + LANES) * POOL
