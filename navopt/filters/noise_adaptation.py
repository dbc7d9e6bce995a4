"""Measurement noise learnt by a nonlinear filter as it runs: Sage-Husa, and windows of innovations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from navopt.algorithms.options import at_least, number, one_of

__all__ = ["SAGE_HUSA", "WINDOW", "NoiseAdaptation", "learn_variances"]

NONE, SAGE_HUSA, WINDOW = 0, 1, 2
KINDS = {"sage-husa": SAGE_HUSA, "window": WINDOW}
FORMS = ("innovation", "residual")

_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")


@dataclass(frozen=True, kw_only=True)
class NoiseAdaptation:
    """How the variances of the measurement noise are learnt.

    Each channel learns by itself, from its own measurements, and what it learns is used from its next one on.
    Correlations of the given R stay.

    Parameters
    ----------
    kind : {"sage-husa", "window"}
        ``r ← (1 − d) r + d s`` with ``d = (1 − b) / (1 − b^(k+1))`` (Sage and Husa 1969), or the mean of s
        over the last measurements (Mohamed and Schwarz 1999).
    form : {"innovation", "residual"}
        What shows the variance, s: ``γ² − (H P⁻ Hᵀ + Ω)``, or ``ε² + H P⁺ Hᵀ`` with the residual ε after the
        update, which is positive by itself.
    forgetting : float, default 0.99
        b, in (0, 1).
    window : int, default 50
        Measurements looked back at; the given variances hold until half a window is full.
    burn_in : int, default 20
        Measurements before Sage-Husa begins to learn.
    low, high : float
        Least and largest factor to the given variances.

    Raises
    ------
    InvalidInput
    """

    kind: str = "sage-husa"
    form: str = "innovation"
    forgetting: float = 0.99
    window: int = 50
    burn_in: int = 20
    low: float = 1e-4
    high: float = 1e4

    def __post_init__(self) -> None:
        one_of("kind", self.kind, tuple(KINDS))
        one_of("form", self.form, FORMS)
        number("forgetting", self.forgetting, above=0.0, most=1.0 - 1e-9)
        at_least("window", self.window, 2)
        at_least("burn_in", self.burn_in, 0)
        number("low", self.low, above=0.0, most=1.0)
        number("high", self.high, above=self.low)


@_compiled
def learn_variances(
    shown: np.ndarray,
    rows: np.ndarray,
    count: int,
    nominal: np.ndarray,
    kind: int,
    forgetting: float,
    burn_in: int,
    low: float,
    high: float,
    kept: np.ndarray,
    seen: np.ndarray,
    variances: np.ndarray,
) -> None:
    """Renew the variances of the channels measured, in place.

    Parameters
    ----------
    shown : ndarray, shape (m,)
        What this measurement shows of the variances, for its first `count` rows.
    rows : ndarray of int, shape (m,)
        Channels measured.
    count : int
        How many.
    nominal : ndarray, shape (m, m)
        Given R.
    kind, forgetting, burn_in, low, high
        As in `NoiseAdaptation`; `kind` is `SAGE_HUSA` or `WINDOW`.
    kept : ndarray, shape (window, m)
        The last values shown, in place.
    seen : ndarray of int, shape (m,)
        How many measurements each channel has had, in place.
    variances : ndarray, shape (m,)
        What is learnt.
    """
    window = len(kept)
    for a in range(count):
        j = rows[a]
        seen[j] += 1
        value = variances[j]
        if kind == SAGE_HUSA:
            learnt = seen[j] - burn_in
            if learnt <= 0:
                continue
            d = (1.0 - forgetting) / (1.0 - forgetting ** (learnt + 1))
            value = (1.0 - d) * value + d * shown[a]
        else:
            kept[(seen[j] - 1) % window, j] = shown[a]
            number_kept = min(seen[j], window)
            if 2 * number_kept < window:
                continue
            value = 0.0
            for k in range(number_kept):
                value += kept[k, j]
            value /= number_kept
        variances[j] = min(max(value, low * nominal[j, j]), high * nominal[j, j])
