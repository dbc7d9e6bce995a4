"""Memory and prediction of nonlinear filters, in compiled pieces shared by the general and the fast filters.

A step is: spread points (`make_root`, `spread_points`), move them, take their moments (`predict_moments`);
and where something was measured: linearise (a matrix, a Jacobian, or `unscented_kernels.linearise`), then
`measurement_steps.fade`, perhaps linearise again, and `measurement_steps.correct`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from navopt.filters.unscented_kernels import (
    factorise,
    moments,
    moments_root,
    triangularise,
)

__all__ = [
    "CAUSES",
    "Memory",
    "Options",
    "make_memory",
    "make_root",
    "predict_linear",
    "predict_moments",
    "square",
]

#: How the covariance is renewed at a measurement.
JOSEPH, FADED, PRINTED = 0, 1, 2
SOUND, NO_ROOT, NO_STATE, NO_MEASUREMENT, NO_INNOVATION, NO_UPDATE = 0, 1, 2, 3, 4, 5
CAUSES = {
    NO_ROOT: "the covariance is not positive definite, or not finite",
    NO_STATE: "the process gives states that are not finite or whose covariance is not positive definite",
    NO_MEASUREMENT: "the predicted measurement is not finite",
    NO_INNOVATION: "the covariance of the innovations is not positive definite",
    NO_UPDATE: "the covariance after the measurement is not positive definite",
}

_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")


class Options(NamedTuple):
    """Settings of a filter as compiled code takes them; see `StrongTracking` and `NoiseAdaptation`.

    Attributes
    ----------
    root : bool
        Whether the root of the covariance is carried.
    form : int
        `JOSEPH`, `FADED` or `PRINTED`.
    strong : bool
        Whether fading factors are used.
    forgetting, weakening, process_only, normalise, multiple, cap
        Of the fading.
    adapt, residual_form, learning, burn_in, low, high
        Of the learning; ``adapt = 0`` for none.
    """

    root: bool = False
    form: int = JOSEPH
    strong: bool = False
    forgetting: float = 0.95
    weakening: float = 1.0
    process_only: bool = False
    normalise: bool = True
    multiple: bool = False
    cap: float = math.inf
    adapt: int = 0
    residual_form: bool = False
    learning: float = 0.99
    burn_in: int = 0
    low: float = 1e-4
    high: float = 1e4


class Memory(NamedTuple):
    """What a filter carries from step to step; all changed in place.

    Attributes
    ----------
    x, P : ndarray, shapes (n,) and (n, n)
        Estimate and covariance.
    root : ndarray, shape (n, n)
        Lower root of P.
    fresh : ndarray of int, shape (1,)
        Whether `root` is that of the present P.
    noise, noise_root : ndarray, shape (n, n)
        Process noise added by the last prediction; zero after a measurement.
    transition : ndarray, shape (n, n)
        Root of P without that noise; only where roots are carried.
    prior : ndarray, shape (n, n)
        P, or its root where roots are carried, before it faded.
    V : ndarray, shape (m, m)
        Covariance of the innovations; NaN before the first.
    factors : ndarray, shape (m,)
        Fading factors of the last measurement; NaN for missing channels.
    variances, kept, seen : ndarray, shapes (m,), (window, m) and (m,)
        Learnt variances of the measurement noise and what they were learnt from.
    """

    x: np.ndarray
    P: np.ndarray
    root: np.ndarray
    fresh: np.ndarray
    noise: np.ndarray
    noise_root: np.ndarray
    transition: np.ndarray
    prior: np.ndarray
    V: np.ndarray
    factors: np.ndarray
    variances: np.ndarray
    kept: np.ndarray
    seen: np.ndarray


def make_memory(x0: np.ndarray, P0: np.ndarray, R: np.ndarray, window: int = 1) -> Memory:
    """Memory of a filter that has not begun.

    Parameters
    ----------
    x0, P0 : ndarray, shapes (n,) and (n, n)
        Mean and covariance before the first measurement.
    R : ndarray, shape (m, m)
        Covariance of the measurement noise.
    window : int
        Measurements kept for learning.
    """
    n, m = len(x0), len(R)
    square = (np.zeros((n, n)) for _ in range(5))
    root, noise, noise_root, transition, prior = square
    return Memory(
        x=np.array(x0, dtype=float),
        P=np.array(P0, dtype=float),
        root=root,
        fresh=np.zeros(1, dtype=np.int64),
        noise=noise,
        noise_root=noise_root,
        transition=transition,
        prior=prior,
        V=np.full((m, m), np.nan),
        factors=np.full(m, np.nan),
        variances=np.array(np.diagonal(R)),
        kept=np.zeros((window, m)),
        seen=np.zeros(m, dtype=np.int64),
    )


@_compiled
def make_root(memory: Memory) -> int:
    """See that `memory.root` is the root of P; the code of a failure, or 0."""
    if memory.fresh[0] == 0:
        if factorise(memory.P, memory.root) >= 0:
            return NO_ROOT
        memory.fresh[0] = 1
    return SOUND


@_compiled
def square(root: np.ndarray, P: np.ndarray) -> None:
    """``P = L Lᵀ``."""
    n = len(root)
    for i in range(n):
        for j in range(i + 1):
            value = 0.0
            for k in range(j + 1):
                value += root[i, k] * root[j, k]
            P[i, j] = value
            P[j, i] = value


@_compiled
def _is_finite(memory):
    finite = True
    for i in range(len(memory.x)):
        finite = finite and math.isfinite(memory.x[i]) and math.isfinite(memory.P[i, i])
    return finite


@_compiled
def predict_moments(
    options: Options,
    memory: Memory,
    points: np.ndarray,
    each: float,
    centre: float,
    noise: np.ndarray,
    noise_root: np.ndarray,
) -> int:
    """Prediction from the images of the sigma points; the code of a failure, or 0.

    Parameters
    ----------
    options, memory
        The filter.
    points, each, centre
        As in `unscented_kernels.moments`; overwritten.
    noise, noise_root : ndarray, shape (n, n)
        Covariance of the process noise and its root.
    """
    memory.noise[:, :] = noise
    if options.root:
        memory.noise_root[:, :] = noise_root
        row = moments_root(points, each, centre, noise_root, memory.x, memory.transition, memory.root)
        if row >= 0:
            return NO_STATE
        square(memory.root, memory.P)
        memory.fresh[0] = 1
    else:
        moments(points, each, centre, noise, memory.x, memory.P)
        memory.fresh[0] = 0
    return SOUND if _is_finite(memory) else NO_STATE


@_compiled
def predict_linear(
    options: Options,
    memory: Memory,
    moved: np.ndarray,
    F: np.ndarray,
    noise: np.ndarray,
    noise_root: np.ndarray,
) -> int:
    """Prediction of an extended filter, ``F P Fᵀ + Q``; the code of a failure, or 0.

    Parameters
    ----------
    options, memory
        The filter.
    moved : ndarray, shape (n,)
        Image of the estimate.
    F : ndarray, shape (n, n)
        Jacobian there.
    noise, noise_root
        As in `predict_moments`.
    """
    n = len(moved)
    memory.x[:] = moved
    memory.noise[:, :] = noise
    if options.root:
        memory.noise_root[:, :] = noise_root
        rows = np.empty((2 * n, n))
        rows[:n] = np.dot(F, memory.root).T
        triangularise(rows[:n].copy(), memory.transition)
        rows[n:] = noise_root.T
        triangularise(rows, memory.root)
        square(memory.root, memory.P)
        memory.fresh[0] = 1
    else:
        P = np.dot(np.dot(F, memory.P), F.T) + noise
        memory.P[:, :] = 0.5 * (P + P.T)
        memory.fresh[0] = 0
    return SOUND if _is_finite(memory) else NO_STATE
