"""The compiled filter of one model and its data: what it needs in memory, and the call."""

from __future__ import annotations

import math
from ctypes import addressof, c_char
from typing import Any

import numpy as np

from navopt.filters import batch_kalman_task as at
from navopt.filters.batch_kalman_kernels import advance_address, filter_lanes
from navopt.filters.batch_kalman_program import JOSEPH, MATRICES, Layout, entries, programs
from navopt.filters.lanes import LANES
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["LaneFilter"]

_TRUTH = at.SOURCES + 3 * MATRICES.index("truth")
#: What is new in every call.
_CALL = np.array([
    at.K, at.WORKSPACE, at.SHARED, at.KEEPS, at.NOISE_VARIES, at.STEADY,
    *(first + at.PART * k + i for first in (at.CANDIDATES, at.RESULTS) for k in range(3) for i in range(3)),
])  # fmt: skip
#: Most blocks in one instruction, and most bytes of their workspaces: they are to stay in the nearest cache.
GROUP, NEAR = 4, 32768
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
        n = model.n_states
        drive = model.drive[..., None] if model.B is not None else np.zeros((1, n, 1))
        split = [
            *map(entries, (F, H, G, drive)),
            # the true states are new in every call
            (((0,),) * n, np.zeros((1, n))),
            ((tuple(range(H.shape[1])),) * H.shape[2], transposed),
        ]
        self._columns = tuple(columns for columns, _ in split)
        self._layout = Layout(model.n_noises, self._columns)
        there = np.isfinite(data)
        arrays = {
            "y": data, "measured": there.sum(axis=2, dtype=np.int64), "start": self._start(),
            **{name: values for name, (_, values) in zip(MATRICES, split, strict=True)},
        }  # fmt: skip
        self._arrays = {name: np.ascontiguousarray(a) for name, a in arrays.items()}
        self._constants = (-0.5 * _LN_TWO_PI * there.sum(axis=(1, 2))).tolist()
        self._shared = LANES * sum(values.shape[1] for _, values in split)
        self._settles = model.constant
        self._tasks: dict[tuple[int, bool], tuple[np.ndarray, tuple[np.ndarray, ...]]] = {}

    def _start(self) -> np.ndarray:
        """What is in the workspace of a block at first, the same in all lanes: zero where nothing else is.

        Also what a missing channel would leave must be, since not a number times zero is none.
        """
        layout, n = self._layout, self._layout.n
        start = np.zeros(layout.rows)
        start[[Layout.PRODUCT, Layout.ONE, Layout.MINUS]] = 1.0, 1.0, -1.0
        start[Layout.FAIL] = self.model.n_steps
        start[layout.at("P", n) :][:n] = self.model.x0
        start[layout.at("P", 0, n) : layout.at("P", n, n) : layout.wide] = self.model.x0
        return start

    def __getstate__(self) -> dict[str, Any]:
        # an address means nothing in another process, nor to a copy
        return {**self.__dict__, "_tasks": {}}

    def _task(self, update: int, compares: bool) -> np.ndarray:
        """What is the same for all candidates; what is behind its addresses is kept with it."""
        if (update, compares) not in self._tasks:
            behind = programs(self._layout.g, self._columns, update, compares)
            self._tasks[update, compares] = (self._make_task(update, list(map(_address, behind))), behind)
        return self._tasks[update, compares][0].copy()

    def _make_task(self, update: int, addresses: list[int]) -> np.ndarray:
        layout, arrays = self._layout, self._arrays
        n, m, g, wide = layout.n, layout.m, layout.g, layout.wide
        where = {name: _address(a) for name, a in arrays.items()}
        known = {
            at.N: n, at.M: m, at.T: self.model.n_steps, at.LANES_USED: LANES, at.LISTS_USED: 2,
            # only Joseph's form takes the last one, Hᵀ
            at.MATRICES_USED: len(MATRICES) - (update != JOSEPH),
            at.SHARED_VARIES: any(len(arrays[name]) > 1 for name in MATRICES),
            at.ROWS: layout.rows, at.START: where["start"],
            at.GROUP: max(1, min(GROUP, NEAR // (8 * LANES * layout.rows))), at.P: layout.at("P"),
            at.HELD: layout.at("held"), at.GAIN: layout.at("gain"), at.VARIANCE: layout.at("s"),
            at.INVERSE: layout.at("inverse"), at.Y: where["y"], at.MEASURED: where["measured"],
            at.ADVANCE: advance_address(),
        }  # fmt: skip
        task = np.zeros(at.SIZE, dtype=np.int64)
        task[list(known)] = list(known.values())
        task[at.UPDATE : at.MOVE + 1] = addresses
        sources = [(where[name], arrays[name].shape[1], _step(arrays[name])) for name in MATRICES]
        task[at.SOURCES : at.CANDIDATES] = np.ravel(sources)
        # addresses are new in every call
        last = self.model.n_steps - 1
        state, covariance = (1, n, layout.at("P", n), wide, True, 0), (n, n, layout.at("P"), wide, True, 0)
        parts = [
            (g, g, layout.at("Q"), g, False, 0), (m, m, layout.at("R"), m, False, 0),
            (n, n, layout.at("P"), wide, False, 0),
            state, covariance, state, covariance, (1, 1, Layout.STEP_CHI, 1, True, 0),
            (1, 1, Layout.CHI, 1, True, last), (1, 1, Layout.FAIL, 1, True, last),
            (1, n, layout.at("squares"), n, True, last),
        ]  # fmt: skip
        task[at.CANDIDATES : at.LISTS] = np.ravel([(0, 0, 0, *part) for part in parts])
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
            Log-likelihood, NaN where the filter failed; first step with an impossible innovation variance (T
            if none; None if the filter of no candidate failed); sums of squares.
        """
        task, n = self._task(update, truth is not None), self._layout.n
        _, T, m = self._arrays["y"].shape
        workspace = LANES * self._layout.rows * min(-(-count // LANES), at.POOL)
        varies = given[0].shape[1] > 1
        # one block of memory: asking for an address takes as long as some steps of a small filter
        first = workspace + self._shared
        memory, here = _aligned(first + (2 + n) * count)
        there = here + 8 * first
        task[_CALL] = (
            count, here, here + 8 * workspace, kept is not None, varies or self.model.G.ndim == 3,
            self._settles and update != JOSEPH and not varies and given[1].shape[1] == 1, *_places(given),
            there, 8, 0, there + 8 * count, 8, 0, there + 16 * count, 8 * n, 0,
        )  # fmt: skip
        if truth is not None:
            task[at.SHARED_VARIES] = True
            task[_TRUTH], task[_TRUTH + 2] = _address(truth[sample]), _step(truth[sample])
        if kept is not None:
            for i in range(3):
                task[at.PREDICTED + i : at.RESULTS : at.PART] = _places(kept)[i::3]
        if sample:
            task[at.Y] += 8 * sample * T * m
            task[at.MEASURED] += 8 * sample * T
        filter_lanes(_address(task))
        results = memory[first:]
        logs = results[:count] + self._constants[sample]
        # one that is not a number or infinite makes the sum so
        failed = None if math.isfinite(np.add.reduce(logs)) else results[count : 2 * count]
        return logs, failed, results[2 * count :].reshape(count, n)


def _address(array: np.ndarray) -> int:
    """Where a contiguous array begins in memory."""
    if array.size and array.flags.writeable:
        # a quarter of the time the other takes
        buffer: Any = array
        return addressof(c_char.from_buffer(buffer))
    return array.ctypes.data


def _places(arrays: list[np.ndarray]) -> list[int]:
    """Of contiguous arrays (K or 1, T or 1, ...) the address and the bytes to the next candidate and time."""
    places = []
    for array in arrays:
        K, T = array.shape[:2]
        between, step = array.strides[:2]
        places += [_address(array), between if K > 1 else 0, step if T > 1 else 0]
    return places


def _step(array: np.ndarray) -> int:
    """Bytes to the next time, none if there is but one."""
    return array[0].nbytes if len(array) > 1 else 0


def _aligned(size: int) -> tuple[np.ndarray, int]:
    """So many numbers on a cache line, since rows that straddle two halve the speed, and their address."""
    raw = np.empty(size + LANES)
    address = _address(raw)
    start = (-address % 64) // 8
    return raw[start : start + size], address + 8 * start
