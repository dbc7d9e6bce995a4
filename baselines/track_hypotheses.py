"""Modes of a track's posterior, followed while the horizon grows from the departure to the last sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.track_model import TrackModel
from navopt.problems.gravity_posterior import TrackPosterior

__all__ = ["Mode", "Search", "descend", "follow", "horizons", "merge", "origin", "seeds", "weights"]

Array = NDArray[np.float64]

#: Where a mode looks for others: standard deviations along the principal axes of the predicted position.
PATTERN = np.array([[1.5, 0.0], [-1.5, 0.0], [0.0, 1.5], [0.0, -1.5]])
#: Two fits closer than this many standard deviations (squared) are the same mode.
SAME = 1.0


@dataclass(frozen=True)
class Mode:
    """One mode of the posterior.

    Attributes
    ----------
    a : ndarray, shape (r,)
        Coefficients.
    cost : float
        Minus log posterior, without its constant.
    information : ndarray, shape (r, r)
        Inverse covariance.
    evidence : float
        Minus log of the probability mass of the mode (Laplace), without the constant.
    """

    a: Array
    cost: float
    information: Array
    evidence: float


def _any_number(samples: int) -> float:
    """Allow everything: a search outside any budget."""
    return np.inf


def _unbooked(evaluations: int, samples: int) -> None:
    """Book nothing."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """How modes are looked for and kept.

    Attributes
    ----------
    keep : int
        Largest number kept.
    prune : float
        Leave out what has less than exp(−prune) of the probability of the best.
    wide : float
        Other starts are tried where the position is not known better than this, m (1σ).
    explore : int
        Number of modes around which these are tried, the most probable first.
    renew : float
        The error shapes are linearised anew whenever the horizon has grown by this factor.
    steps : int
        Largest number of steps of a descent.
    allow : callable
        ``allow(samples)`` says how many evaluations of so many samples may still be made.
    spend : callable
        ``spend(evaluations, samples)`` books them.
    """

    keep: int
    prune: float
    wide: float
    renew: float
    explore: int = 3
    steps: int = 30
    allow: Callable[[int], float] = _any_number
    spend: Callable[[int, int], None] = _unbooked


def origin(posterior: TrackPosterior) -> Mode:
    """Mode of the prior: the INS as it stands."""
    r = posterior.n_coefficients
    return Mode(np.zeros(r), 0.0, np.eye(r), 0.0)


def horizons(n: int, first: int, step: int) -> list[int]:
    """Numbers of samples used one after another: `first`, then `step` more each time, at last all `n`."""
    return [*range(min(first, n), n, step), n]


def weights(modes: list[Mode]) -> Array:
    """Probability of each mode among those listed."""
    evidence = np.array([mode.evidence for mode in modes])
    share = np.exp(evidence.min() - evidence)
    return share / share.sum()


def descend(
    posterior: TrackPosterior, starts: list[Array], search: Search, *, start: int = 0, stop: int | None = None
) -> list[Mode] | None:
    """Descend from every start; None if the budget does not allow it."""
    samples = (len(posterior) if stop is None else stop) - start
    fits = []
    for begin in starts:
        steps = min(search.steps, search.allow(samples) - 1)
        if steps < 0:
            return None
        a, cost, information, evaluations = posterior.fit(begin, start=start, stop=stop, steps=int(steps))
        search.spend(evaluations, samples)
        volume = float(np.log(np.diag(np.linalg.cholesky(information))).sum())
        fits.append(Mode(a, cost, information, cost + volume))
    return fits


def merge(fits: list[Mode], search: Search) -> list[Mode]:
    """Leave out repeated and hopeless fits; the most probable first."""
    fits = sorted(fits, key=lambda mode: mode.evidence)
    best = fits[0].evidence
    modes: list[Mode] = []
    for mode in fits:
        if mode.evidence - best > search.prune or len(modes) == search.keep:
            break
        gaps = [(mode.a - other.a, other.information) for other in modes]
        if all(gap @ information @ gap >= SAME for gap, information in gaps):
            modes.append(mode)
    return modes


def seeds(posterior: TrackPosterior, mode: Mode, at: int, wide: float) -> list[Array]:
    """Other starts near a mode: its coefficients moved so that sample `at` shifts along the pattern."""
    reach = posterior.metres(at)
    spread = np.linalg.solve(mode.information, reach.T)
    covariance = reach @ spread
    values, axes = np.linalg.eigh(covariance)
    if values[-1] <= wide**2:
        return []
    # the likeliest coefficients that put the sample there
    pull = spread @ np.linalg.inv(covariance)
    shifts = (PATTERN * np.sqrt(values)) @ axes.T
    long = np.abs(PATTERN) @ np.sqrt(values) > wide
    return [mode.a + pull @ shift for shift in shifts[long]]


def follow(model: TrackModel, stages: list[int], search: Search) -> tuple[list[Mode], int]:
    """Follow the modes from stage to stage.

    Parameters
    ----------
    model : TrackModel
        Linearised anew on the way.
    stages : list of int
        Numbers of samples used.
    search : Search
        How modes are looked for.

    Returns
    -------
    modes : list of Mode
        Most probable first.
    reached : int
        Number of samples they account for; fewer than the last stage if the budget ended the search.
    """
    modes = [origin(model.posterior)]
    reached, renewed = 0, stages[0]
    for stage in stages:
        if stage >= search.renew * renewed:
            ahead = min(len(model.posterior), int(search.renew * stage) + 1)
            model.linearise(modes[0].a, modes[0].information, stop=ahead)
            renewed = stage
        posterior = model.posterior
        starts = [mode.a for mode in modes]
        for mode in modes[: search.explore]:
            starts += seeds(posterior, mode, stage - 1, search.wide)
        fits = descend(posterior, starts, search, stop=stage)
        if fits is None:
            return modes, reached
        modes, reached = merge(fits, search), stage
    # the end is where it matters: once more about the answer
    model.linearise(modes[0].a, modes[0].information)
    fits = descend(model.posterior, [mode.a for mode in modes], search)
    return (modes if fits is None else merge(fits, search)), reached
