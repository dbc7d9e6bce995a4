"""What the compiled filter is given: the places of an array of 64-bit integers, most of them addresses.

Numbers are contiguous doubles; K candidates, T steps, n states, m channels, g process noises.
"""

from __future__ import annotations

from navopt.filters.batch_kalman_program import MATRICES

#: Blocks in memory together.
POOL = 16

(
    # sizes; lanes of a block, and numbers of `MATRICES` and of lists of blocks, which the compiler must not
    # know, or it would write as many copies of every loop
    N, M, T, K, LANES_USED, MATRICES_USED, LISTS_USED,
    # whether the process noise varies, or what all share, whether settling may be looked for, and whether
    # everything is kept
    NOISE_VARIES, SHARED_VARIES, STEADY, KEEPS,
    # workspaces, one after the other, the rows of one, what is in them at first, rows that all share, and
    # how many blocks are taken at a time
    WORKSPACE, ROWS, START, SHARED, GROUP,
    # numbers of rows in a workspace
    P, HELD, GAIN, VARIANCE, INVERSE,
    # `STAGES`: programs of a whole step, and of one whose covariance rests, the first of which is INNOVATE
    UPDATE, PARTIAL, ERRORS, NOISE, PREDICT, INNOVATE, REST_ERRORS, MOVE,
    # measurements (T, m), and how many channels are measured at each time
    Y, MEASURED,
    # the compiled steps; the blocks and the times they are called for, and whether these rest
    ADVANCE, BASES, NUMBER, BEGIN, END, RESTS,
    # of each of `MATRICES` its entries, how many, and the bytes to the next time
    SOURCES,
) = range(38)  # fmt: skip
#: What is copied: Q, R and P0 of the candidates; if all is kept, states and covariances, predicted and
#: filtered, and the normalised innovations squared; of the results the log-likelihood without its constant,
#: NaN where the filter failed, the first step with an impossible innovation variance (T if none), and the
#: sums of squared errors. Each has an address, the bytes from there to the next candidate and to the next
#: time, rows and columns, the first row in a workspace and the rows from one of its rows to the next, whether
#: it goes out, and when it is copied if it is the same at all times.
CANDIDATES, PART = SOURCES + 3 * len(MATRICES), 9
PREDICTED = CANDIDATES + 3 * PART
FILTERED = PREDICTED + 2 * PART
RESULTS = FILTERED + 3 * PART
#: Where the kernel keeps its lists, and where they end.
LISTS = RESULTS + 3 * PART
SIZE = LISTS + 2 * POOL
