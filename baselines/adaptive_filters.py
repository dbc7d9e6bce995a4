"""Kalman filters that learn a noise covariance as they go: Sage–Husa and windows of innovations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.noise_structure import NoiseStructure
from navopt.algorithms.options import at_least, number, one_of
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["ADAPTED", "AdaptiveRun", "innovation_adaptive", "sage_husa"]

Array = NDArray[np.float64]

#: What an adaptive filter may learn.
ADAPTED = ("R", "Q", "both")


@dataclass(frozen=True)
class AdaptiveRun:
    """What an adaptive filter used and found at each step.

    Attributes
    ----------
    Q : ndarray, shape (T, g, g)
        Covariance of the process noise used from step k to k + 1; learnt from measurements up to k.
    R : ndarray, shape (T, m, m)
        Covariance of the measurement noise used at step k; learnt from measurements before it.
    states : ndarray, shape (T, n)
        Estimates after each measurement.
    innovations : ndarray, shape (T, m)
        Innovations; NaN where a measurement is missing.
    nis : ndarray, shape (T,)
        Normalised innovations squared, of the channels measured; NaN where none is.
    """

    Q: Array
    R: Array
    states: Array
    innovations: Array
    nis: Array


@dataclass(frozen=True)
class _Step:
    """What one update shows about the noises."""

    innovation: Array
    residual: Array
    spread_before: Array  # H P⁻ Hᵀ
    spread_after: Array  # H P⁺ Hᵀ
    process: Array | None  # K e eᵀ Kᵀ + P⁺ − F P⁺ Fᵀ seen through the inverse of G


class _SageHusa:
    def __init__(
        self, structure: NoiseStructure, adapt: str, forgetting: float, burn_in: int, low: float, high: float
    ) -> None:
        self.structure, self.adapt, self.forgetting = structure, adapt, forgetting
        self.burn_in, self.low, self.high = burn_in, low, high
        self.Q, self.R = structure.covariances(np.zeros(structure.n_parameters))
        self.learnt = -burn_in

    def learn(self, step: _Step) -> None:
        self.learnt += 1
        if self.learnt <= 0:
            return
        # counted from the reference, which weighs as much as one measurement
        d = (1.0 - self.forgetting) / (1.0 - self.forgetting ** (self.learnt + 1))
        if self.adapt != "Q":
            seen = np.outer(step.innovation, step.innovation) - step.spread_before
            mixed = (1.0 - d) * self.R + d * seen
            self.R = self.structure.measurement.clipped(mixed, self.low, self.high)
        if self.adapt != "R" and step.process is not None:
            mixed = (1.0 - d) * self.Q + d * step.process
            self.Q = self.structure.process.clipped(mixed, self.low, self.high)


class _Mean:
    """Mean of the last matrices, kept as a running sum."""

    def __init__(self, size: int, window: int) -> None:
        self.kept = np.zeros((window, size, size))
        self.sum, self.count = np.zeros((size, size)), 0

    def add(self, matrix: Array) -> None:
        place = self.count % len(self.kept)
        self.sum += matrix - self.kept[place]
        self.kept[place] = matrix
        self.count += 1
        if place == 0:
            # once a window anew, so that rounding cannot pile up
            self.sum = self.kept.sum(axis=0)

    @property
    def value(self) -> Array:
        return self.sum / min(self.count, len(self.kept))


class _Windows:
    def __init__(
        self,
        structure: NoiseStructure,
        adapt: str,
        window: int,
        form: str,
        minimum: int,
        low: float,
        high: float,
    ) -> None:
        self.structure, self.adapt, self.form = structure, adapt, form
        self.minimum, self.low, self.high = minimum, low, high
        self.Q, self.R = structure.covariances(np.zeros(structure.n_parameters))
        self.measurement = _Mean(structure.measurement.size, window)
        self.process = _Mean(structure.process.size, window)

    def learn(self, step: _Step) -> None:
        if self.form == "innovation":
            self.measurement.add(np.outer(step.innovation, step.innovation) - step.spread_before)
        else:
            self.measurement.add(np.outer(step.residual, step.residual) + step.spread_after)
        if step.process is not None:
            self.process.add(step.process)
        if self.adapt != "Q" and self.measurement.count >= self.minimum:
            self.R = self.structure.measurement.clipped(self.measurement.value, self.low, self.high)
        if self.adapt != "R" and self.process.count >= self.minimum:
            self.Q = self.structure.process.clipped(self.process.value, self.low, self.high)


def sage_husa(
    model: LinearGaussianModel,
    structure: NoiseStructure,
    *,
    adapt: str = "R",
    forgetting: float = 0.99,
    burn_in: int = 20,
    low: float = 1e-4,
    high: float = 1e4,
) -> AdaptiveRun:
    """Run the filter of Sage and Husa (1969), with forgetting.

    After each update, with ``d = (1 − b) / (1 − b^(k+1))`` and forgetting factor b,
    ``R ← (1 − d) R + d (e eᵀ − H P⁻ Hᵀ)`` and
    ``Q ← (1 − d) Q + d G⁺ (K e eᵀ Kᵀ + P⁺ − F P⁺ Fᵀ) G⁺ᵀ``. Unlike the original, a mean of the noises is
    not estimated, the terms that can make a covariance indefinite are followed by a projection, and what is
    learnt from a measurement is used from the next one on.

    Parameters
    ----------
    model : LinearGaussianModel
        The model with its measurements; nothing is learnt where a channel is missing.
    structure : NoiseStructure
        What may be learnt; begins at its references.
    adapt : {"R", "Q", "both"}
        What is learnt. Both at once is not stable in general.
    forgetting : float, default 0.99
        Factor b; the memory is 1/(1 − b) measurements.
    burn_in : int, default 20
        Measurements before learning begins.
    low, high : float
        Least and largest factor to the reference.

    Returns
    -------
    AdaptiveRun
    """
    one_of("adapt", adapt, ADAPTED)
    number("forgetting", forgetting, above=0.0, most=1.0 - 1e-9)
    at_least("burn_in", burn_in, 0)
    _check_factors(low, high)
    return _run(model, _SageHusa(structure, adapt, forgetting, burn_in, low, high))


def innovation_adaptive(
    model: LinearGaussianModel,
    structure: NoiseStructure,
    *,
    adapt: str = "R",
    window: int = 150,
    form: str = "innovation",
    low: float = 1e-4,
    high: float = 1e4,
) -> AdaptiveRun:
    """Run a filter that adapts to a window of its innovations (Mohamed and Schwarz 1999).

    Over the last `window` measurements, R is the mean of ``e eᵀ − H P⁻ Hᵀ`` (``innovation``), or of
    ``ε εᵀ + H P⁺ Hᵀ`` with the residuals ε after the update (``residual``), which is positive by
    itself; Q is the mean of ``G⁺ (K e eᵀ Kᵀ + P⁺ − F P⁺ Fᵀ) G⁺ᵀ``. What is not positive
    is projected.

    Parameters
    ----------
    model : LinearGaussianModel
        The model with its measurements; nothing is learnt where a channel is missing.
    structure : NoiseStructure
        What may be learnt; its references hold until half a window is full.
    adapt : {"R", "Q", "both"}
        What is learnt. Both at once is not stable in general.
    window : int, default 150
        Number of measurements looked back at.
    form : {"innovation", "residual"}
        What R is learnt from.
    low, high : float
        Least and largest factor to the reference.

    Returns
    -------
    AdaptiveRun
    """
    one_of("adapt", adapt, ADAPTED)
    one_of("form", form, ("innovation", "residual"))
    at_least("window", window, 2)
    _check_factors(low, high)
    return _run(model, _Windows(structure, adapt, window, form, (window + 1) // 2, low, high))


def _check_factors(low: float, high: float) -> None:
    number("low", low, above=0.0, most=1.0)
    number("high", high, above=low)


def _run(model: LinearGaussianModel, noise: _SageHusa | _Windows) -> AdaptiveRun:
    steps, m, n, g = model.n_steps, model.n_measurements, model.n_states, model.n_noises
    F, H, G = (np.broadcast_to(M, (steps, *M.shape[-2:])) for M in (model.F, model.H, model.G))
    inverse = np.linalg.pinv(model.G)
    inverse = np.broadcast_to(inverse, (steps, g, n))
    drive = model.drive
    Q, R = np.empty((steps, g, g)), np.empty((steps, m, m))
    states = np.empty((steps, n))
    innovations, nis = np.full((steps, m), np.nan), np.full(steps, np.nan)
    x, P = model.x0.copy(), model.P0.copy()
    last: Array | None = None
    for k in range(steps):
        R[k] = noise.R
        seen = np.isfinite(model.y[k])
        e = model.y[k, seen] - H[k][seen] @ x
        Hk, Rk = H[k][seen], noise.R[np.ix_(seen, seen)]
        if seen.any():
            PH = P @ Hk.T
            spread = Hk @ PH
            S = spread + Rk
            K = np.linalg.solve(S, PH.T).T
            innovations[k, seen], nis[k] = e, e @ np.linalg.solve(S, e)
            A = np.eye(n) - K @ Hk
            x, P = x + K @ e, A @ P @ A.T + K @ Rk @ K.T
            if seen.all():
                gained = None
                if last is not None and noise.adapt != "R":
                    Ke = K @ e
                    change = np.outer(Ke, Ke) + P - F[k - 1] @ last @ F[k - 1].T
                    gained = inverse[k - 1] @ change @ inverse[k - 1].T
                noise.learn(_Step(e, e - Hk @ (K @ e), spread, Hk @ P @ Hk.T, gained))
        states[k], last, Q[k] = x, P, noise.Q
        x = F[k] @ x + drive[k]
        P = F[k] @ P @ F[k].T + G[k] @ noise.Q @ G[k].T
        P = 0.5 * (P + P.T)
    return AdaptiveRun(Q, R, states, innovations, nis)
