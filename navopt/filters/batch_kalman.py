"""A linear Kalman filter for a whole population of noise covariances at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.filters.batch_kalman_program import JOSEPH, MATRIX, SEQUENTIAL
from navopt.filters.candidates import as_candidates, judge
from navopt.filters.lane_filter import LaneFilter
from navopt.filters.lanes import HUGE, TINY
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


@dataclass(frozen=True)
class _Candidates:
    """Candidates of which each matrix is (K or 1, steps, k, k).

    Attributes
    ----------
    given : list of ndarray
        Q, R and P0.
    reasons : list of (str or None)
        What is wrong with each.
    groups : list of tuple
        Updates, and the candidates that take it (None if all).
    """

    given: list[np.ndarray]
    reasons: list[str | None]
    groups: list[tuple[int, np.ndarray | None]]


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
        How measurements are used: one channel after the other, which needs diagonal R; the same after
        correlated channels were made independent by ``S = L D Lᵀ``; or all at once with Joseph's form of
        the covariance, ``(I - K H) P (I - K H)ᵀ + K R Kᵀ``, which costs more and stays symmetric and
        positive in hopeless cases. Auto takes the first for each candidate with diagonal R, the second for
        the others.

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
        self._y = data
        self._lanes = LaneFilter(model, data)
        self._P0 = np.array(model.P0, order="C")[None, None]

    # -- what is asked for -----------------------------------------------------------------------------
    def log_likelihood(self, Q: Any, R: Any, P0: Any = None) -> np.ndarray:
        """Log-likelihood of the measurements, by their innovations (Schweppe 1965).

        Returns
        -------
        ndarray, shape (K,) or (K, N)
            ``-inf`` for a candidate that failed; `reasons` says why.
        """
        return self._evaluate(self._prepare(Q, R, P0))[0]

    def reasons(self, Q: Any, R: Any, P0: Any = None) -> tuple[str | None, ...]:
        """Why each candidate failed, None if it did not."""
        return self._evaluate(self._prepare(Q, R, P0))[1]

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
        candidates = self._prepare(Q, R, P0)
        squares = np.full((len(candidates.reasons), *shape[::2]), np.inf)
        self._evaluate(candidates, truth=truth, squares=squares)
        return squares[:, 0] if self._single else squares

    def run(self, Q: Any, R: Any, P0: Any = None) -> BatchRun:
        """Filter and keep everything. Memory grows with K T n²; `log_likelihood` needs none of it."""
        return self._run(self._prepare(Q, R, P0))

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
    def _prepare(self, Q: Any, R: Any, P0: Any) -> _Candidates:
        """Check candidates."""
        model = self.model
        given = [
            as_candidates("Q", Q, model.n_noises, model.n_steps),
            as_candidates("R", R, model.n_measurements, model.n_steps),
            # that of the model was checked, and made symmetric, with it
            self._P0 if P0 is None else as_candidates("P0", P0, model.n_states, 1),
        ]
        count = max(map(len, given))
        for name, a in zip(("Q", "R", "P0"), given, strict=True):
            if len(a) not in (1, count):
                raise InvalidInput(name, f"{len(a)} candidates", f"give 1 or {count}, as of the others")
        judged = [judge("Q", given[0], definite=False), judge("R", given[1], definite=True)]
        if P0 is not None:
            judged.append(judge("P0", given[2], definite=False))
        reasons: list[str | None] = [None] * count
        for i, (each, full) in enumerate(judged):
            if full is not None:
                given[i] = 0.5 * (given[i] + np.swapaxes(given[i], -1, -2))
            if each is not None:
                each = each * count if len(each) == 1 else each
                reasons = [first or then for first, then in zip(reasons, each, strict=True)]
        correlated = judged[1][1]
        if self.update == "sequential" and correlated is not None:
            k = int(np.argmax(correlated))
            raise InvalidInput(f"R of candidate {k}", "not diagonal", 'use update="matrix" or "auto"')
        sound = np.array([reason is None for reason in reasons]) if any(reasons) else None
        if self.update != "auto":
            groups = [(UPDATES[self.update], sound)]
        elif correlated is None:
            groups = [(SEQUENTIAL, sound)]
        else:
            correlated = np.broadcast_to(correlated, count)
            groups = [
                (kind, chosen if sound is None else chosen & sound)
                for kind, chosen in ((SEQUENTIAL, ~correlated), (MATRIX, correlated))
            ]
        return _Candidates(given, reasons, groups)

    def _evaluate(
        self,
        candidates: _Candidates,
        *,
        truth: np.ndarray | None = None,
        squares: np.ndarray | None = None,
        kept: list[np.ndarray] | None = None,
    ) -> tuple[np.ndarray, tuple[str | None, ...]]:
        """Log-likelihoods (K[, N]) and reasons of checked candidates.

        With true states `squares` (K, N, n) is filled with mean squares; `kept` with what `run` keeps.
        """
        reasons, T = candidates.reasons, self.model.n_steps
        logs = np.full((len(reasons), len(self._y)), -np.inf)
        for update, chosen in candidates.groups:
            which: Any = slice(None)
            given = candidates.given
            if chosen is not None:
                which = np.flatnonzero(chosen)
                given = [a if len(a) == 1 else a[which] for a in given]
            count = len(logs[which])
            for sample in range(len(self._y) if count else 0):
                parts = None if kept is None else [np.empty((count, *a.shape[2:])) for a in kept]
                logs[which, sample], failed, sums = self._lanes(given, count, update, sample, truth, parts)
                if squares is not None:
                    squares[which, sample] = sums / T
                for whole, part in zip(kept or (), parts or (), strict=True):
                    whole[sample, which] = part
                if failed is not None:
                    numbers = np.arange(len(reasons))[which]
                    for k, step in zip(numbers.tolist(), failed.tolist(), strict=True):
                        if step < T or not np.isfinite(logs[k, sample]):
                            reasons[k] = reasons[k] or _divergence(int(step), T)
        if any(reasons):
            bad = [reason is not None for reason in reasons]
            logs[bad] = -np.inf
            if squares is not None:
                squares[bad] = np.inf
        return logs[:, 0] if self._single else logs, tuple(reasons)

    def _run(self, candidates: _Candidates) -> BatchRun:
        """Filter checked candidates and keep everything."""
        model, count, number = self.model, len(candidates.reasons), len(self._y)
        n, T = model.n_states, model.n_steps
        shapes = ((n,), (n, n), (n,), (n, n), ())
        kept = [np.full((number, count, T, *shape), np.nan) for shape in shapes]
        logs, failed = self._evaluate(candidates, kept=kept)
        for k, reason in enumerate(failed):
            if reason is not None:
                for array in kept:
                    array[:, k] = np.nan
        predicted, P_predicted, filtered, P_filtered, nis = (np.swapaxes(a, 0, 1) for a in kept)
        H, R = model.H, np.broadcast_to(candidates.given[1], (count, *candidates.given[1].shape[1:]))
        innovations = self._y - (H @ predicted[..., None])[..., 0]
        S = H @ P_predicted @ np.swapaxes(H, -1, -2) + R[:, None]
        missing = np.isnan(self._y)
        S[:, missing[..., :, None] | missing[..., None, :]] = np.nan
        if self._single:
            predicted, P_predicted, filtered, P_filtered, innovations, S, nis = (
                a[:, 0] for a in (predicted, P_predicted, filtered, P_filtered, innovations, S, nis)
            )
        return BatchRun(predicted, P_predicted, filtered, P_filtered, innovations, S, nis, logs, failed)

    def _backward(
        self, Q: Any, R: Any, P0: Any
    ) -> tuple[BatchRun, list[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
        candidates = self._prepare(Q, R, P0)
        run, model, given = self._run(candidates), self.model, candidates.given
        n, m, g, T = model.n_states, model.n_measurements, model.n_noises, model.n_steps
        count, number = len(run.failed), len(self._y)
        F, H, G = (a if a.ndim == 3 else a[None] for a in (model.F, model.H, model.G))
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
                backward(F, H, G, *arrays, *outputs, *part)
                for i, one in enumerate(part):
                    by[i][k] += one
        return run, states, by


def _divergence(step: int, steps: int) -> str:
    if step >= steps:
        return "the filter diverges: the innovations are not finite"
    return (
        f"the filter diverges: at step {step} a variance of the innovations is not between {TINY:g} "
        f"and {HUGE:g}"
    )
