"""A linear Kalman filter for a whole population of noise covariances at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.filters.batch_kalman_kernels import JOSEPH, MATRIX, SEQUENTIAL, filter_lanes, workspace_rows
from navopt.filters.candidates import as_candidates, fault, is_diagonal, pack
from navopt.filters.lanes import HUGE, LANES, TINY
from navopt.filters.smoother_kernels import backward
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["BatchKalman", "BatchRun", "BatchSmoothed", "Gradient"]

UPDATES = {"sequential": SEQUENTIAL, "matrix": MATRIX, "joseph": JOSEPH}


@dataclass(frozen=True)
class BatchRun:
    """What the filter of each candidate did. With N data realisations, an axis N follows the axis K.

    Attributes
    ----------
    predicted, predicted_covariances : ndarray, shapes (K, T, n) and (K, T, n, n)
        State before the measurement is used.
    estimates, covariances : ndarray, shapes (K, T, n) and (K, T, n, n)
        State after it.
    innovations, innovation_covariances : ndarray, shapes (K, T, m) and (K, T, m, m)
        Measured minus predicted, and its covariance; NaN where a measurement is missing.
    nis : ndarray, shape (K, T)
        Normalised innovation squared; 0 where all are missing.
    log_likelihood : ndarray, shape (K,)
        ``-inf`` for a candidate that failed.
    failed : tuple of (str or None), length K
        Why a candidate failed; the arrays hold NaN for it, so leave it out of every mean.
    """

    predicted: np.ndarray
    predicted_covariances: np.ndarray
    estimates: np.ndarray
    covariances: np.ndarray
    innovations: np.ndarray
    innovation_covariances: np.ndarray
    nis: np.ndarray
    log_likelihood: np.ndarray
    failed: tuple[str | None, ...]


@dataclass(frozen=True)
class BatchSmoothed:
    """States given all measurements. With N data realisations, an axis N follows the axis K.

    Attributes
    ----------
    estimates, covariances : ndarray, shapes (K, T, n) and (K, T, n, n)
        Smoothed states.
    lagged_covariances : ndarray, shape (K, T - 1, n, n)
        Covariance of the state at step k + 1 with that at step k.
    log_likelihood : ndarray, shape (K,)
        Of the filter.
    failed : tuple of (str or None), length K
        As in `BatchRun`.
    """

    estimates: np.ndarray
    covariances: np.ndarray
    lagged_covariances: np.ndarray
    log_likelihood: np.ndarray
    failed: tuple[str | None, ...]


@dataclass(frozen=True)
class Gradient:
    """Exact derivatives of the log-likelihood, summed over data realisations.

    Attributes
    ----------
    log_likelihood : ndarray, shape (K,)
        The value.
    by_Q, by_R, by_P0 : ndarray, shapes (K, g, g), (K, m, m) and (K, n, n)
        Symmetric M with ``d log L = tr(M dQ)`` for any symmetric change dQ; NaN if the candidate failed. Of
        shape (K, T, g, g) where a Q per step was given, and so for R.
    failed : tuple of (str or None), length K
        As in `BatchRun`.
    """

    log_likelihood: np.ndarray
    by_Q: np.ndarray
    by_R: np.ndarray
    by_P0: np.ndarray
    failed: tuple[str | None, ...]


class BatchKalman:
    """Kalman filter of one model and its data for many candidates (Q, R, P0).

    Parameters
    ----------
    model : LinearGaussianModel
        Matrices, initial state and measurements.
    measurements : array_like, shape (N, T, m), optional
        Data realisations to be filtered instead of the model's own; results then have an axis N after the
        axis of the candidates (`Gradient` is their sum).
    update : {"auto", "sequential", "matrix", "joseph"}
        How measurements are used: one channel after the other, which needs diagonal R; all at once; or all
        at once with Joseph's form of the covariance, ``(I - K H) P (I - K H)ᵀ + K R Kᵀ``, which costs more
        and stays symmetric and positive in hopeless cases. Auto takes the first for each candidate with
        diagonal R, the second for the others.

    Notes
    -----
    Candidates are single matrices, (K, g, g), or one per step, (K, T, g, g); the R of a step belongs to its
    measurement, its Q leads to the next. Q and P0 may be singular, R must be positive definite. A single
    matrix counts as K = 1, and K = 1 of one goes with K of the others. The result of a candidate is the
    same to the last bit in any batch.
    """

    def __init__(self, model: LinearGaussianModel, *, measurements: Any = None, update: str = "auto") -> None:
        if update != "auto" and update not in UPDATES:
            raise UnknownName("update", update, ("auto", *UPDATES))
        self.model, self.update = model, update
        self._single = measurements is None
        data = model.y[None] if measurements is None else np.array(measurements, dtype=float)
        if data.ndim != 3 or data.shape[1:] != model.y.shape or not len(data):
            raise InvalidInput(
                "measurements", f"shape {data.shape}", f"give (N, {model.n_steps}, {model.n_measurements})"
            )
        if np.isinf(data).any():
            raise InvalidInput("measurements", "infinite entries", "give NaN where one is missing")
        self._y = np.ascontiguousarray(data)
        self._F, self._H, self._G = (
            np.ascontiguousarray(a if a.ndim == 3 else a[None]) for a in (model.F, model.H, model.G)
        )
        self._drive = np.ascontiguousarray(
            model.drive if model.B is not None else np.zeros((1, model.n_states))
        )
        self._x0 = np.ascontiguousarray(model.x0)
        self._P0 = np.ascontiguousarray(model.P0[None, None])
        self._P0_lanes = pack(self._P0)
        self._addresses: tuple[int, ...] | None = None
        self._entries = (*_entries(self._F), *_entries(self._H))

    def __getstate__(self) -> dict[str, Any]:
        # an address means nothing in another process, nor to a copy
        return {**self.__dict__, "_addresses": None}

    # -- what is asked for -----------------------------------------------------------------------------
    def log_likelihood(self, Q: Any, R: Any, P0: Any = None) -> np.ndarray:
        """Log-likelihood of the measurements, by their innovations (Schweppe 1965).

        Returns
        -------
        ndarray, shape (K,) or (K, N)
            ``-inf`` for a candidate that failed; `reasons` says why.
        """
        return self._evaluate(Q, R, P0)[0]

    def reasons(self, Q: Any, R: Any, P0: Any = None) -> tuple[str | None, ...]:
        """Why each candidate failed, None if it did not."""
        return self._evaluate(Q, R, P0)[2]

    def mean_square_error(self, Q: Any, R: Any, truth: Any, P0: Any = None) -> np.ndarray:
        """Mean square error of the filtered states against true ones.

        Parameters
        ----------
        Q, R, P0 : array_like
            Candidates.
        truth : array_like, shape (T, n) or (N, T, n)
            True states.

        Returns
        -------
        ndarray, shape (K, n) or (K, N, n)
            ``+inf`` for a candidate that failed.
        """
        truth = np.ascontiguousarray(np.array(truth, dtype=float))
        truth = truth[None] if truth.ndim == 2 else truth
        shape = (len(self._y), self.model.n_steps, self.model.n_states)
        if truth.shape != shape or not np.isfinite(truth).all():
            raise InvalidInput("truth", f"shape {truth.shape}", f"give finite states, shape {shape}")
        return self._evaluate(Q, R, P0, truth=truth)[1]

    def run(self, Q: Any, R: Any, P0: Any = None) -> BatchRun:
        """Filter and keep everything. Memory grows with K T n²; `log_likelihood` needs none of it."""
        kept = self._make_kept(self._prepare(Q, R, P0)[0][0].shape[0])
        logs, _, failed = self._evaluate(Q, R, P0, kept=kept)
        model = self.model
        n, m = model.n_states, model.n_measurements
        shapes = ((n,), (n, n), (n,), (n, n), (m,), (m, m), ())
        arrays = [
            np.moveaxis(a, 0, 1).reshape(a.shape[1], a.shape[0], model.n_steps, *shape)
            for a, shape in zip(kept, shapes, strict=True)
        ]
        for k, reason in enumerate(failed):
            if reason is not None:
                for array in arrays:
                    array[k] = np.nan
        if self._single:
            arrays = [array[:, 0] for array in arrays]
        predicted, P_predicted, filtered, P_filtered, innovations, S, nis = arrays
        return BatchRun(predicted, P_predicted, filtered, P_filtered, innovations, S, nis, logs, failed)

    def smooth(self, Q: Any, R: Any, P0: Any = None) -> BatchSmoothed:
        """States given all measurements, before and after (fixed interval)."""
        run, smoothed, _ = self._backward(Q, R, P0)
        if self._single:
            smoothed = [array[:, 0] for array in smoothed]
        states, covariances, lagged = smoothed
        return BatchSmoothed(states, covariances, lagged, run.log_likelihood, run.failed)

    def gradient(self, Q: Any, R: Any, P0: Any = None) -> Gradient:
        """Exact derivatives of the log-likelihood, for a few times the cost of the likelihood itself."""
        run, _, derivatives = self._backward(Q, R, P0)
        logs = run.log_likelihood if self._single else run.log_likelihood.sum(axis=1)
        by_Q, by_R = (a[:, 0] if a.shape[1] == 1 else a for a in derivatives[:2])
        return Gradient(logs, by_Q, by_R, derivatives[2], run.failed)

    # -- how -------------------------------------------------------------------------------------------
    def _prepare(self, Q: Any, R: Any, P0: Any) -> tuple[list[np.ndarray], list[str | None]]:
        """Candidates, all of the same number, and what is wrong with each."""
        model = self.model
        given = [
            as_candidates("Q", Q, model.n_noises, model.n_steps),
            as_candidates("R", R, model.n_measurements, model.n_steps),
        ]
        faults = [fault("Q", given[0], definite=False), fault("R", given[1], definite=True)]
        if P0 is None:
            # checked with the model
            given.append(self._P0)
        else:
            given.append(as_candidates("P0", P0, model.n_states, 1))
            faults.append(fault("P0", given[2], definite=False))
        count = max(len(a) for a in given)
        reasons: list[str | None] = [None] * count
        for name, a in zip(("Q", "R", "P0"), given, strict=True):
            if len(a) not in (1, count):
                raise InvalidInput(name, f"{len(a)} candidates", f"give 1 or {count}, as of the others")
        for each in faults:
            if any(each):
                each = each * count if len(each) == 1 else each
                reasons = [first or then for first, then in zip(reasons, each, strict=True)]
        return [a if len(a) == count else np.repeat(a, count, axis=0) for a in given], reasons

    def _make_kept(self, count: int) -> list[np.ndarray]:
        model = self.model
        n, m, lead = model.n_states, model.n_measurements, (len(self._y), count, model.n_steps)
        widths = (n, n * n, n, n * n, m, m * m, 1)
        return [np.full((*lead, width), np.nan) for width in widths]

    def _evaluate(
        self,
        Q: Any,
        R: Any,
        P0: Any,
        *,
        truth: np.ndarray | None = None,
        kept: list[np.ndarray] | None = None,
    ) -> tuple[np.ndarray, np.ndarray, tuple[str | None, ...]]:
        """Log-likelihoods (K[, N]), mean squares (K[, N], n) and reasons."""
        given, reasons = self._prepare(Q, R, P0)
        model, count, number = self.model, len(given[0]), len(self._y)
        diagonal = is_diagonal(given[1])
        if self.update == "sequential" and not diagonal.all():
            k = int(np.argmin(diagonal))
            raise InvalidInput(f"R of candidate {k}", "not diagonal", 'use update="matrix" or "auto"')
        logs = np.full((count, number), -np.inf)
        squares = np.full((count, number, model.n_states), np.inf)
        sound = np.array([reason is None for reason in reasons])
        if self.update == "auto":
            groups = ((SEQUENTIAL, sound & diagonal), (MATRIX, sound & ~diagonal))
        else:
            groups = ((UPDATES[self.update], sound),)  # type: ignore[assignment]
        for update, chosen in groups:
            which = np.flatnonzero(chosen)
            if not len(which):
                continue
            packed = [pack(a if len(which) == count else a[which]) for a in given[: 2 if P0 is None else 3]]
            if P0 is None:
                packed.append(np.repeat(self._P0_lanes, len(packed[0]), axis=0))
            for sample in range(number):
                likelihood, failed, sums = self._filter(packed, which, update, sample, truth, kept)
                logs[which, sample], squares[which, sample] = likelihood, sums / model.n_steps
                bad = (failed < model.n_steps) | ~np.isfinite(likelihood)
                for k in np.flatnonzero(bad).tolist() if bad.any() else ():
                    reasons[which[k]] = reasons[which[k]] or _divergence(int(failed[k]), model.n_steps)
                    sound[which[k]] = False
        logs[~sound], squares[~sound] = -np.inf, np.inf
        if self._single:
            return logs[:, 0], squares[:, 0], tuple(reasons)
        return logs, squares, tuple(reasons)

    def _filter(
        self,
        packed: list[np.ndarray],
        which: np.ndarray,
        update: int,
        sample: int,
        truth: np.ndarray | None,
        kept: list[np.ndarray] | None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Run the kernel on packed candidates and one data realisation."""
        model, count = self.model, len(which)
        n, m, g, T = model.n_states, model.n_measurements, model.n_noises, model.n_steps
        # one block of memory: asking numpy for an address takes as long as ten steps of a small filter
        rows = workspace_rows(n, m, g)
        memory = _aligned(rows + count * (2 + n) // LANES + 1)
        here, flat = _address(memory), memory[rows:].reshape(-1)
        there = here + 8 * LANES * rows
        parts = [np.empty((count, *a.shape[2:])) for a in kept] if kept is not None else []
        varying = (len(a) > 1 for a in (self._F, self._H, self._G, self._drive))
        wanted = (truth is not None, kept is not None, update, packed[0].shape[1], packed[1].shape[1])
        flags = np.array([*varying, *wanted], dtype=np.int64)
        if self._addresses is None:
            matrices = (self._F, self._H, self._G, self._drive, self._y, self._x0, *self._entries)
            self._addresses = tuple(map(_address, matrices))
        fixed = self._addresses
        filter_lanes(
            (n, m, g, T, count),
            _address(flags),
            (
                *fixed[:4], fixed[4] + 8 * sample * T * m, fixed[5],
                0 if truth is None else _address(truth[sample]), *fixed[6:],
            ),
            tuple(map(_address, packed)),
            (there, there + 8 * count, there + 16 * count),
            tuple(map(_address, parts)) if parts else (0,) * 7,
            here,
        )  # fmt: skip
        for whole, part in zip(kept or [], parts, strict=True):
            whole[sample, which] = part
        squares = flat[2 * count : (2 + n) * count].reshape(count, n)
        return flat[:count], flat[count : 2 * count], squares

    def _backward(
        self, Q: Any, R: Any, P0: Any
    ) -> tuple[BatchRun, list[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
        run = self.run(Q, R, P0)
        model, given = self.model, self._prepare(Q, R, P0)[0]
        n, m, g, T = model.n_states, model.n_measurements, model.n_noises, model.n_steps
        count, number = len(given[0]), len(self._y)
        states = [
            np.full((count, number, T, n), np.nan),
            np.full((count, number, T, n, n), np.nan),
            np.full((count, number, T - 1, n, n), np.nan),
        ]
        by = (
            np.zeros((count, given[0].shape[1], g, g)),
            np.zeros((count, given[1].shape[1], m, m)),
            np.zeros((count, n, n)),
        )
        inputs = [run.predicted, run.predicted_covariances, run.innovations, run.innovation_covariances]
        if self._single:
            inputs = [a[:, None] for a in inputs]
        part = tuple(np.empty(a.shape[1:]) for a in by)
        for k in range(count):
            if run.failed[k] is not None:
                for one in by:
                    one[k] = np.nan
                continue
            for sample in range(number):
                arrays = [np.ascontiguousarray(a[k, sample]) for a in inputs]
                outputs = [a[k, sample] for a in states]
                backward(self._F, self._H, self._G, *arrays, *outputs, *part)
                for i, one in enumerate(part):
                    by[i][k] += one
        return run, states, by


def _address(array: np.ndarray) -> int:
    """Where a contiguous array begins in memory."""
    return array.ctypes.data


def _divergence(step: int, steps: int) -> str:
    if step >= steps:
        return "the filter diverges: the innovations are not finite"
    return (
        f"the filter diverges: at step {step} a variance of the innovations is not between {TINY:g} "
        f"and {HUGE:g}"
    )


def _entries(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns of the entries of each row that are not zero at all times, and how many there are."""
    there = (matrix != 0.0).any(axis=0)
    columns = np.zeros(there.shape, dtype=np.int64)
    for i, row in enumerate(there):
        columns[i, : row.sum()] = np.flatnonzero(row)
    return columns, there.sum(axis=1).astype(np.int64)


def _aligned(rows: int) -> np.ndarray:
    """Workspace whose rows do not straddle cache lines: straddling halves the speed."""
    raw = np.zeros(rows * LANES + LANES)
    start = (-_address(raw) % 64) // 8
    return raw[start : start + rows * LANES].reshape(rows, LANES)
