"""Fading factors: how much of the past a strong-tracking filter forgets at a measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from navopt.algorithms.options import number, one_of, switch
from navopt.errors import InvalidInput

__all__ = ["FADED", "StrongTracking", "fade_states", "fading_factors", "renew_residuals"]

#: Which covariance is multiplied.
FADED = ("whole", "process")
FACTORS = ("single", "multiple")

_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")


@dataclass(frozen=True, kw_only=True)
class StrongTracking:
    """How fading factors are found and where they act (Zhou and Frank 1996).

    The innovations γ of a filter with the right gain are orthogonal at different times. Where their
    covariance, ``V ← (ρ V + γ γᵀ) / (1 + ρ)``, is larger than the filter thinks, the predicted covariance is
    multiplied by ``λ = max(1, tr N / tr M)``, which gives recent measurements more weight.

    Parameters
    ----------
    forgetting : float, default 0.95
        ρ, in (0, 1]. The newest innovation has the weight ``1 / (1 + ρ)``, more than one half, so the memory
        is of about two measurements whatever ρ.
    weakening : float, default 1
        b, at least 1: larger values make the factor smaller.
    fades : {"whole", "process"}
        Whether λ multiplies the whole predicted covariance, ``N = V − b R``, ``M = H P⁻ Hᵀ``; or only what
        comes from the last state, ``Φ P Φᵀ = P⁻ − Q``, with ``N = V − H Q Hᵀ − b R``, ``M = H (P⁻ − Q) Hᵀ``.
        Q is that of the last prediction; at a second measurement of the same time nothing was added and both
        are alike.
    normalise : bool, default True
        Whether channels are divided by their variances in R before traces are taken. Otherwise metres and
        radians are added up, and the channel with the largest numbers decides alone.
    factors : {"multiple", "single"}
        One factor for each channel that acts on the state it measures, ``λ_j = N_jj / M_jj``,
        ``P⁻ → D P⁻ D``, ``D = diag √λ``: states that no channel measures are left alone. Or one factor for
        all, as printed: then the variances of states that the measurements hardly determine are multiplied
        too, every time, and grow without limit, under any cap.
    states : sequence of int, optional
        For several factors, the state that each channel measures, −1 for none. By default the largest entry
        of each row of H; to be given where the measurement is a function.
    cap : float or None, default 1.05
        Largest factor, at least 1.

    Raises
    ------
    InvalidInput
        If a number is out of its range.

    Notes
    -----
    A channel that is missing neither changes V nor counts in the traces; entries of V begin with the first
    product they see.
    """

    forgetting: float = 0.95
    weakening: float = 1.0
    fades: str = "whole"
    normalise: bool = True
    factors: str = "multiple"
    states: tuple[int, ...] | None = None
    cap: float | None = 1.05

    def __post_init__(self) -> None:
        number("forgetting", self.forgetting, above=0.0, most=1.0)
        if not number("weakening", self.weakening) >= 1.0:
            raise InvalidInput("weakening", self.weakening, "give a number not below 1")
        one_of("fades", self.fades, FADED)
        switch("normalise", self.normalise)
        one_of("factors", self.factors, FACTORS)
        if self.cap is not None and not number("cap", self.cap) >= 1.0:
            raise InvalidInput("cap", self.cap, "give a number not below 1, or None for no cap")

    @classmethod
    def published(cls) -> StrongTracking:
        """Strong tracking as printed (paper 002, section 4): one factor from plain traces, without a cap."""
        return cls(normalise=False, factors="single", cap=None)

    def faded_states(self, H: np.ndarray | None, n: int, m: int) -> np.ndarray:
        """State on which the factor of each channel acts.

        Parameters
        ----------
        H : ndarray, shape (m, n), or None
            Matrix of the measurement, if it has one.
        n, m : int
            Numbers of states and channels.

        Returns
        -------
        ndarray of int, shape (m,)

        Raises
        ------
        InvalidInput
            If several factors are asked for and it is not known which state a channel measures.
        """
        if self.factors == "single":
            return np.full(m, -1)
        if self.states is None:
            if H is None:
                raise InvalidInput(
                    "states", "None", "name the state that each channel measures, or use factors='single'"
                )
            return np.argmax(np.abs(H), axis=1)
        states = np.array(self.states)
        if states.shape != (m,) or states.dtype.kind != "i" or states.min() < -1 or states.max() >= n:
            raise InvalidInput("states", self.states, f"give {m} numbers of states, from 0 to {n - 1}, or -1")
        return states


@_compiled
def renew_residuals(
    V: np.ndarray, innovation: np.ndarray, rows: np.ndarray, count: int, forgetting: float
) -> None:
    """``V ← (ρ V + γ γᵀ) / (1 + ρ)`` for the channels measured; an entry that is NaN becomes ``γ γᵀ``.

    Parameters
    ----------
    V : ndarray, shape (m, m)
        Covariance of the innovations, changed in place; NaN at the beginning.
    innovation : ndarray, shape (m,)
        Innovations of the first `count` rows.
    rows : ndarray of int, shape (m,)
        Channels measured.
    count : int
        How many.
    forgetting : float
        ρ.
    """
    for a in range(count):
        for b in range(count):
            i, j = rows[a], rows[b]
            product = innovation[a] * innovation[b]
            if np.isnan(V[i, j]):
                V[i, j] = product
            else:
                V[i, j] = (forgetting * V[i, j] + product) / (1.0 + forgetting)


@_compiled
def fading_factors(
    V: np.ndarray,
    R: np.ndarray,
    extra: np.ndarray,
    spread: np.ndarray,
    process: np.ndarray,
    rows: np.ndarray,
    count: int,
    weakening: float,
    normalise: bool,
    multiple: bool,
    cap: float,
    factors: np.ndarray,
) -> None:
    """Factor of each channel, NaN for those that are missing; one for all unless `multiple`.

    Parameters
    ----------
    V : ndarray, shape (m, m)
        Covariance of the innovations by `renew_residuals`.
    R, extra, spread, process : ndarray, shape (m, m)
        For the channels measured (first `count` rows): covariance of the noise, Ω of the linearisation,
        ``H P⁻ Hᵀ``, and ``H Q Hᵀ`` where only the process part fades, otherwise zeros.
    rows, count
        As in `renew_residuals`.
    weakening, normalise, multiple, cap
        As in `StrongTracking`.
    factors : ndarray, shape (m,)
        Where the factors are written.
    """
    factors[:] = np.nan
    excess, part = 0.0, 0.0
    for a in range(count):
        j = rows[a]
        unit = 1.0 / R[a, a] if normalise else 1.0
        N = unit * (V[j, j] - process[a, a] - extra[a, a] - weakening * R[a, a])
        M = unit * (spread[a, a] - process[a, a])
        excess += N
        part += M
        if multiple:
            factors[j] = min(max(N / M, 1.0), cap) if M > 0.0 else 1.0
    if not multiple:
        factor = min(max(excess / part, 1.0), cap) if part > 0.0 else 1.0
        for a in range(count):
            factors[rows[a]] = factor


@_compiled
def fade_states(
    factors: np.ndarray,
    rows: np.ndarray,
    count: int,
    multiple: bool,
    states: np.ndarray,
    scales: np.ndarray,
) -> bool:
    """Square root of the factor of each state, and whether any is above 1.

    Parameters
    ----------
    factors, rows, count, multiple
        As in `fading_factors`; channels that share a state give it their largest factor.
    states : ndarray of int, shape (m,)
        `StrongTracking.faded_states`.
    scales : ndarray, shape (n,)
        Where the roots are written.

    Returns
    -------
    bool
    """
    scales[:] = 1.0
    some = False
    if count == 0:
        return False
    if not multiple:
        scales[:] = np.sqrt(factors[rows[0]])
        return bool(factors[rows[0]] > 1.0)
    for a in range(count):
        j = rows[a]
        if states[j] >= 0:
            scales[states[j]] = max(scales[states[j]], np.sqrt(factors[j]))
            some = some or factors[j] > 1.0
    return some
