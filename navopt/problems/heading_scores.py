"""Scores of an alignment with a heading: when it converged, what it ended with, and whether it knew."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from navopt.errors import InvalidInput
from navopt.filters.consistency import normalised_squares

__all__ = ["SCORES", "convergence_time", "score_run", "state_errors"]

#: Keys of the scores, in order.
SCORES = (
    "horizontal_convergence_s",
    "azimuth_convergence_s",
    "final_horizontal_error_rad",
    "final_azimuth_error_rad",
    "horizontal_rms_rad",
    "azimuth_rms_rad",
    "azimuth_mean_rad",
    "azimuth_sigma_rad",
    "nees_1",
    "angle_nees_1",
    "nis_1",
    "fading_1",
    "failed_1",
)
ANGLES = slice(2, 5)


def convergence_time(time: ArrayLike, error: ArrayLike, within: float) -> float:
    """Return the first time after which an error stays within a bound until the end.

    Parameters
    ----------
    time : array_like, shape (K,)
        In s, from the start of the alignment.
    error : array_like, shape (K,)
        Its size counts.
    within : float
        The bound.

    Returns
    -------
    float
        ``time[k]`` of the first k such that ``|error[j]| <= within`` for all ``j >= k``; infinite if the last
        error is outside, or any is NaN after which none is known.

    Notes
    -----
    Paper 002 reads its convergence times off figures. An error that leaves the bound once, at the very end,
    has not converged by this definition; it cannot be met by accident on the way through zero.
    """
    t, e = np.asarray(time, dtype=float), np.asarray(error, dtype=float)
    if t.ndim != 1 or t.shape != e.shape or not len(t):
        raise InvalidInput("error", f"shapes {t.shape} and {e.shape}", "give one error for each time")
    outside = ~(np.abs(e) <= within)
    if outside[-1]:
        return float("inf")
    last = np.flatnonzero(outside)
    return float(t[last[-1] + 1] - t[0]) if len(last) else 0.0


def state_errors(estimates: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return estimated minus true states without the heading error, azimuths brought into [-pi, pi).

    Parameters
    ----------
    estimates : ndarray, shape (K, 11) or (K, 10)
        With or without the heading error.
    states : ndarray, shape (K, 11)
        True ones.

    Returns
    -------
    ndarray, shape (K, 10)
    """
    mine = np.delete(estimates, 5, axis=1) if estimates.shape[1] == 11 else estimates
    errors = mine - np.delete(states, 5, axis=1)
    errors[:, 4] = (errors[:, 4] + np.pi) % (2.0 * np.pi) - np.pi
    return np.asarray(errors)


def score_run(
    run: Any, states: np.ndarray, *, azimuth_within: float, horizontal_within: float
) -> dict[str, float]:
    """Return the scores of a run of a filter.

    Parameters
    ----------
    run : navopt.filters.HeadingRun
        With its covariances.
    states : ndarray, shape (K, 11)
        True states at its times.
    azimuth_within, horizontal_within : float
        Bounds of `convergence_time`, rad.

    Returns
    -------
    dict of str to float
        Convergence times from the start; final errors; roots of the mean squares, mean and standard
        deviation over the last third; ``nees_1`` and ``angle_nees_1``, normalised squared errors of the ten
        states and of the three angles per degree of freedom over the last third, ``nis_1``, the same of all
        innovations, and ``fading_1``, the mean fading factor. The horizontal error is the larger of the two
        levels'. A filter that failed has ``failed_1`` 1 and everything else infinite.
    """
    if run.failed is not None:
        return dict.fromkeys(SCORES, float("inf")) | {"failed_1": 1.0}
    errors = state_errors(run.estimates, states)
    time = run.times
    azimuth, level = errors[:, 4], np.abs(errors[:, 2:4]).max(axis=1)
    late = slice(-max(1, len(errors) // 3), None)
    keep = [k for k in range(run.estimates.shape[1]) if run.estimates.shape[1] == 10 or k != 5]
    P = run.covariances[late][:, keep][:, :, keep]
    measured = np.isfinite(run.innovations).sum()
    factors = run.fading_factors[np.isfinite(run.fading_factors)]
    return {
        "horizontal_convergence_s": convergence_time(time, level, horizontal_within),
        "azimuth_convergence_s": convergence_time(time, azimuth, azimuth_within),
        "final_horizontal_error_rad": float(level[-1]),
        "final_azimuth_error_rad": float(abs(azimuth[-1])),
        "horizontal_rms_rad": float(np.sqrt(np.mean(errors[late, 2:4] ** 2))),
        "azimuth_rms_rad": float(np.sqrt(np.mean(azimuth[late] ** 2))),
        "azimuth_mean_rad": float(azimuth[late].mean()),
        "azimuth_sigma_rad": float(azimuth[late].std()),
        "nees_1": _mean_square(errors[late], P),
        "angle_nees_1": _mean_square(errors[late, ANGLES], P[:, ANGLES, ANGLES]),
        "nis_1": float(run.nis.sum() / measured) if measured else float("nan"),
        "fading_1": float(factors.mean()) if len(factors) else 1.0,
        "failed_1": 0.0,
    }


def _mean_square(errors: np.ndarray, covariances: np.ndarray) -> float:
    """Mean normalised square per degree of freedom; infinite where rounding has spoilt a covariance."""
    try:
        return float(normalised_squares(errors, covariances).mean() / errors.shape[1])
    except InvalidInput:
        # variances that differ by more than the digits of a number: such a filter knows nothing
        return float("inf")
