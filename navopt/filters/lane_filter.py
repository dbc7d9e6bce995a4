"""The compiled filter of one model and its data: what it needs in memory, and the call."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from navopt.filters import batch_kalman_task as at
from navopt.filters.batch_kalman_kernels import advance_address, filter_lanes
from navopt.filters.batch_kalman_program import JOSEPH, MATRICES, Columns, Layout, entries, programs
from navopt.filters.lanes import LANES
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["LaneFilter"]

#: What is new in every call.
_CALL = [
    at.K, at.WORKSPACE, at.SHARED, at.TRUTH, at.LOGS, at.FAILED, at.ERRORS, at.KEEPS,
    *(at.CANDIDATES + at.CANDIDATE * k + i for k in range(3) for i in range(3)),
]  # fmt: skip
_LN_TWO_PI = math.log(2.0 * math.pi)


class LaneFilter:
    """Filter candidates of (Q, R, P0) that are known to be sound.

    Parameters
    ----------
    model : LinearGaussianModel
        Matrices and initial state.
    data : ndarray, shape (N, T, m)
        Data realisations, NaN where a measurement is missing.
    """

    def __init__(self, model: LinearGaussianModel, data: np.ndarray) -> None:
        self.model = model
        F, H, G = (a if a.ndim == 3 else a[None] for a in (model.F, model.H, model.G))
        # all of Hᵀ, without regard to zeros
        transposed = np.swapaxes(H, -1, -2).reshape(len(H), -1)
        split = [*map(entries, (F, H, G)), ((tuple(range(H.shape[1])),) * H.shape[2], transposed)]
        self._columns = tuple(columns for columns, _ in split)
        self._layout = Layout(model.n_noises, *self._columns)
        there = np.isfinite(data)
        arrays = {
            "y": data, "measured": there.sum(axis=2, dtype=np.int64), "x0": model.x0,
            "drive": model.drive if model.B is not None else np.zeros((1, model.n_states)),
            **{name: values for name, (_, values) in zip(MATRICES, split, strict=True)},
        }  # fmt: skip
        self._arrays = {name: np.ascontiguousarray(a) for name, a in arrays.items()}
        self._constants = (-0.5 * _LN_TWO_PI * there.sum(axis=(1, 2))).tolist()
        self._shared = LANES * sum(values.shape[1] for _, values in split)
        self._tasks: dict[int, tuple[np.ndarray, Any]] = {}

    def __getstate__(self) -> dict[str, Any]:
        # an address means nothing in another process, nor to a copy
        return {**self.__dict__, "_tasks": {}}

    def _task(self, update: int) -> np.ndarray:
        """What is the same for all candidates; what is behind its addresses is kept with it."""
        if update not in self._tasks:
            behind = (*programs(self._layout.g, *self._columns, update), *map(_pattern, self._columns[:2]))
            self._tasks[update] = (self._make_task(update, *map(_address, behind)), behind)
        return self._tasks[update][0].copy()

    def _make_task(self, update: int, *addresses: int) -> np.ndarray:
        layout, arrays = self._layout, self._arrays
        n, m, g, wide = layout.n, layout.m, layout.g, layout.wide
        where = {name: _address(a) for name, a in arrays.items()}
        known = {
            at.N: n, at.M: m, at.G: g, at.T: self.model.n_steps, at.LANES_USED: LANES,
            # only Joseph's form takes the last one, Hᵀ
            at.MATRICES_USED: len(MATRICES) - (update != JOSEPH), at.CANDIDATES_USED: 3,
            at.NOISE_VARIES: self.model.G.ndim == 3,
            at.STEADY: self.model.constant and update != JOSEPH, at.ROWS: layout.rows,
            at.SQUARES: layout.at("squares"), at.P: layout.at("P"), at.HELD: layout.at("held"),
            at.A: layout.at("A"), at.W: layout.at("w"), at.GAIN: layout.at("gain"),
            at.FACTOR: layout.at("factor"), at.VARIANCE: layout.at("s"), at.INVERSE: layout.at("inverse"),
            at.X0: where["x0"], at.Y: where["y"], at.MEASURED: where["measured"], at.DRIVE: where["drive"],
            at.NEXT_DRIVE: _step(arrays["drive"]), at.ADVANCE: advance_address(),
        }  # fmt: skip
        task = np.zeros(at.SIZE, dtype=np.int64)
        task[list(known)] = list(known.values())
        task[at.UPDATE : at.H_COLUMNS + 1] = addresses
        sources = [(where[name], arrays[name].shape[1], _step(arrays[name])) for name in MATRICES]
        task[at.SOURCES : at.CANDIDATES] = np.ravel(sources)
        # the first three are new in every call
        candidates = [(0, 0, 0, size, layout.at(name), stride) for name, size, stride in
                      (("Q", g, g), ("R", m, m), ("P", n, wide))]  # fmt: skip
        task[at.CANDIDATES : at.KEPT] = np.ravel(candidates)
        x, P = (layout.at("P", n), n, 1, 1, 0), (layout.at("P"), n, n, wide, 0)
        task[at.KEPT : at.LISTS] = *x, *P, *x, *P, Layout.STEP_CHI, 1, 1, 1, 0
        return task

    def __call__(
        self,
        given: list[np.ndarray],
        count: int,
        update: int,
        sample: int,
        truth: np.ndarray | None,
        kept: list[np.ndarray] | None,
    ) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        """Filter one data realisation.

        Parameters
        ----------
        given : list of ndarray, shapes (K or 1, steps, k, k)
            Q, R and P0.
        count : int
            K.
        update : {SEQUENTIAL, MATRIX, JOSEPH}
        sample : int
            Number of the realisation.
        truth : ndarray, shape (N, T, n), optional
            True states.
        kept : list of ndarray, shapes (K, T, ...), optional
            To be filled with states and covariances, predicted and filtered, and NIS.

        Returns
        -------
        tuple of ndarray, shapes (K,), (K,) or None, and (K, n)
            Log-likelihood, first step with an impossible innovation variance (T if none; None if the filter
            of no candidate failed), sums of squares.
        """
        task, n = self._task(update), self._layout.n
        _, T, m = self._arrays["y"].shape
        workspace = LANES * self._layout.rows * min(-(-count // LANES), at.POOL)
        # one block of memory: asking numpy for an address takes as long as ten steps of a small filter
        first = workspace + self._shared
        memory, here = _aligned(first + (2 + n) * count)
        there = here + 8 * first
        task[_CALL] = (
            count, here, here + 8 * workspace, 0 if truth is None else _address(truth[sample]), there,
            there + 8 * count, there + 16 * count, kept is not None,
            *(number for a in given for number in (_address(a), _step(a), a.shape[1])),
        )  # fmt: skip
        if given[0].shape[1] > 1:
            task[at.NOISE_VARIES] = 1
        if given[0].shape[1] + given[1].shape[1] > 2:
            task[at.STEADY] = 0
        if kept is not None:
            task[at.KEPT + at.PART - 1 : at.LISTS : at.PART] = [_address(a) for a in kept]
        task[at.Y] += 8 * sample * T * m
        task[at.MEASURED] += 8 * sample * T
        filter_lanes(_address(task))
        results = memory[first:]
        logs = results[:count] + self._constants[sample]
        failed = results[count : 2 * count] if task[at.FAILURES] else None
        return logs, failed, results[2 * count :].reshape(count, n)


def _address(array: np.ndarray) -> int:
    """Where a contiguous array begins in memory."""
    address: int = array.__array_interface__["data"][0]
    return address


def _step(array: np.ndarray) -> int:
    """Bytes to the next time or candidate, none if there is but one."""
    return array[0].nbytes if len(array) > 1 else 0


def _pattern(columns: Columns) -> np.ndarray:
    """Of each row how many entries it has, and their columns."""
    return np.array([number for row in columns for number in (len(row), *row)], dtype=np.int64)


def _aligned(size: int) -> tuple[np.ndarray, int]:
    """So many numbers on a cache line, since rows that straddle two halve the speed, and their address."""
    raw = np.empty(size + LANES)
    address = _address(raw)
    start = (-address % 64) // 8
    return raw[start : start + size], address + 8 * start
