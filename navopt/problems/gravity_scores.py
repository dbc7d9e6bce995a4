"""Scores of a matched track: its distance from the truth, in metres and as a multiple of what is possible."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from navopt.errors import NoBound
from navopt.models.earth import NAUTICAL_MILE, distance

__all__ = ["MATCH_RADII", "last_position_bounds", "match_scores"]

#: Radii, in nautical miles (′ of latitude), within which paper 003 calls a match successful.
MATCH_RADII = (2, 5)


def match_scores(problem: Any, estimate: Any) -> dict[str, float]:
    """Scores of an estimate on a problem that carries its truth.

    Parameters
    ----------
    problem : GravityMatching
        The problem; its ``position_bounds`` are computed once.
    estimate : MatchedTrack
        Positions of the window.

    Returns
    -------
    dict of str to float
        ``position_error_m`` of the last sample and ``mean_position_error_m`` over the window;
        ``matched_within_2nmi`` and ``matched_within_5nmi``, 1 or 0 at the last sample; ``window_bound_m``
        and ``track_bound_m``, see `last_position_bounds`; ``error_over_window_bound`` and
        ``error_over_track_bound``, the first of all divided by them. NaN where no bound is known.
    """
    truth = problem.truth
    errors = distance(estimate.latitude, estimate.longitude, truth.latitude, truth.longitude)
    last = float(errors[-1])
    scores = {"position_error_m": last, "mean_position_error_m": float(errors.mean())}
    for radius in MATCH_RADII:
        scores[f"matched_within_{radius}nmi"] = float(last <= radius * NAUTICAL_MILE)
    for name, bound in zip(("window", "track"), problem.position_bounds, strict=True):
        scores[f"{name}_bound_m"] = bound
        # the one NaN there is, so that scores without a bound equal each other as dictionaries
        scores[f"error_over_{name}_bound"] = last / bound if np.isfinite(bound) else np.nan
    return scores


def last_position_bounds(problem: Any) -> tuple[float, float]:
    """Posterior Cramér–Rao bounds on the position of the last sample, at the truth.

    Parameters
    ----------
    problem : GravityMatching
        The problem.

    Returns
    -------
    window, track : float
        Root of the trace of `navopt.problems.window_error_bound` and of
        `navopt.problems.track_error_bound`, m; NaN where the problem lacks what the bound needs (truth, 1σ
        of the INS's errors).

    Notes
    -----
    For normal errors of the declared sizes, and on the mean over worlds that are drawn from them: an error
    may be smaller than the bound in one world, the root mean square over many may not.
    """
    # the kernels of the posterior are no concern of who only wants the loss
    from navopt.problems.gravity_window import track_error_bound, window_error_bound

    return _last(window_error_bound, problem), _last(track_error_bound, problem)


def _last(bound: Callable[[Any], np.ndarray], problem: Any) -> float:
    try:
        return float(np.sqrt(np.trace(bound(problem)[-1])))
    except NoBound:
        return np.nan
