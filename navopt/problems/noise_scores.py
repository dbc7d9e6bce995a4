"""Scores of noise covariances: how well the filter that uses them filters, and whether it knows."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.filters.batch_kalman import BatchRun
from navopt.filters.consistency import normalised_squares

__all__ = ["score_covariances"]


def score_covariances(problem: Any, estimate: Any) -> dict[str, float]:
    """Scores of an estimate of Q and R on the data of a problem that carries a truth.

    Parameters
    ----------
    problem : NoiseTuning
        Model, data and truth.
    estimate : NoiseEstimate or NoiseTruth
        Covariances, constant or per step.

    Returns
    -------
    dict of str to float
        ``state_rmse_1``: root of the mean square error of the scored states in their scale.
        ``nees_1`` and ``nis_1``: normalised squared errors and innovations per degree of freedom, 1 expected.
        Where the true covariances are known: ``state_rmse_ratio_1``, error relative to the filter that knows
        them; ``log10_q_error_1`` and ``log10_r_error_1``, mean size of the error of the logarithms of the
        variances; ``log10_ratio_error_1``, error of the logarithm of q over r, which is all that the gain
        depends on. Infinite where the filter fails.
    """
    truth = problem.truth
    error, nees, nis = _performance(problem, estimate.Q, estimate.R)
    scores = {"state_rmse_1": error, "nees_1": nees, "nis_1": nis}
    if truth.Q is not None:
        best = _performance(problem, truth.Q, truth.R)[0]
        q, r = _log_errors(estimate.Q, truth.Q), _log_errors(estimate.R, truth.R)
        scores["state_rmse_ratio_1"] = error / best if best > 0.0 else np.inf
        scores["log10_q_error_1"] = float(np.abs(q).mean())
        scores["log10_r_error_1"] = float(np.abs(r).mean())
        scores["log10_ratio_error_1"] = float(np.abs(q.mean() - r.mean()))
    return scores


def _log_errors(estimate: Any, truth: Any) -> np.ndarray:
    """Errors of the logarithms of the variances that are not zero, over time if either varies."""
    here, there = (np.diagonal(np.asarray(a), axis1=-2, axis2=-1) for a in (estimate, truth))
    here, there = np.broadcast_arrays(here, there)
    known = there > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.log10(here[known]) - np.log10(there[known])
    return np.where(np.isfinite(errors), errors, np.inf) if errors.size else np.zeros(1)


def _performance(problem: Any, Q: Any, R: Any) -> tuple[float, float, float]:
    """Scaled error of the scored states, NEES and NIS per degree of freedom; infinite if the filter fails."""
    Q, R = (np.asarray(a, dtype=float)[None] for a in (Q, R))
    run: BatchRun = problem.filter.run(Q, R)
    if run.failed[0] is not None:
        return np.inf, np.inf, np.inf
    states = list(problem.scored_states)
    errors = run.estimates[0] - problem.truth.states
    scaled = errors[:, states] / problem.state_scale[states]
    covariances = run.covariances[0]
    # only the scored states: others may be known exactly and have singular covariances
    squares = normalised_squares(errors[:, states], covariances[:, states][:, :, states])
    count = int(np.isfinite(run.innovations).sum())
    return (
        float(np.sqrt(np.mean(scaled**2))),
        float(squares.mean() / len(states)),
        float(run.nis[0].sum() / count),
    )
