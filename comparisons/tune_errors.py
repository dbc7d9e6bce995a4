"""Standard errors of tuned covariances, from the curvature of the likelihood where it is largest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.problems.noise_tuning import NoiseEstimate, NoiseTuning

__all__ = ["NoiseErrors", "standard_errors"]

#: Nats by which the likelihood may still be below its maximum for the curvature to mean anything.
CLOSE = 0.05
#: Step of the differences, in the parameters: decades, and partial correlations.
STEP = 1e-3
#: Ratio of curvatures below which the smaller one is nothing but rounding.
SINGULAR = 1e-10
#: A parameter with a larger 1σ (decades, or a correlation) is not determined.
UNKNOWN = 3.0


@dataclass(frozen=True, kw_only=True)
class NoiseErrors:
    """How well the data determine Q and R.

    Attributes
    ----------
    Q, R : ndarray, shapes (g, g) and (m, m), or None
        1 sigma of each entry; None where there is no standard error.
    parameters : dict of str to float
        1 sigma of the decision vector (decades of a variance; partial correlations), empty likewise.
    why_not : str
        Why there is none; empty where there is one.
    """

    Q: np.ndarray | None = None
    R: np.ndarray | None = None
    parameters: dict[str, float]
    why_not: str = ""


def standard_errors(problem: NoiseTuning, estimate: NoiseEstimate) -> NoiseErrors:
    """Standard errors of an estimate that maximises the likelihood, whoever found it.

    The observed information is the curvature of the negative log-likelihood, by central differences of its
    exact gradient; its inverse is the covariance of the parameters, and the entries of Q and R follow to
    first order. An estimate that is not the maximum has no standard error from it.

    Parameters
    ----------
    problem : NoiseTuning
        What was solved.
    estimate : NoiseEstimate
        Covariances, constant in time.

    Returns
    -------
    NoiseErrors
    """
    if np.ndim(estimate.Q) == 3 or np.ndim(estimate.R) == 3:
        return _none("the covariances vary with time")
    x = problem.project(estimate)
    Q, R = (a[0] for a in problem.covariances(x[None]))
    if not (_alike(Q, estimate.Q) and _alike(R, estimate.R)):
        return _none("the estimate is outside the bounds")
    if problem.objective != "innovations":
        return _none("the objective is not the likelihood")
    count = int(np.isfinite(problem.model.y).sum())
    room = np.minimum(problem.xu - x, x - problem.xl)
    if (room < 2.0 * STEP).any():
        names = [p.name for p, r in zip(problem.parameters, room, strict=True) if r < 2.0 * STEP]
        return _none(f"{', '.join(names)} ended at a bound")
    d = len(x)
    moves = STEP * np.eye(d)
    slopes = count * problem.gradient(np.vstack([x + moves, x - moves, x[None]]))
    information = (slopes[:d] - slopes[d : 2 * d]) / (2.0 * STEP)
    information = 0.5 * (information + information.T)
    slope = slopes[2 * d]
    if not np.isfinite(information).all():
        return _none("the filter fails beside the estimate")
    values = np.linalg.eigvalsh(information)
    covariance = np.linalg.pinv(information, hermitian=True)
    if values[0] <= SINGULAR * max(values[-1], 1e-300) or (np.diag(covariance) > UNKNOWN**2).any():
        return _none("the data do not determine every parameter: some change leaves the likelihood as it is")
    short = 0.5 * float(slope @ covariance @ slope)
    if short > CLOSE:
        return _none("it is not where the likelihood is largest")
    dQ, dR = ((a[:d] - a[d:]) / (2.0 * STEP) for a in problem.covariances(np.vstack([x + moves, x - moves])))
    sigma = np.sqrt(np.diag(covariance))
    return NoiseErrors(
        Q=np.sqrt(np.einsum("aij,ab,bij->ij", dQ, covariance, dQ).clip(min=0.0)),
        R=np.sqrt(np.einsum("aij,ab,bij->ij", dR, covariance, dR).clip(min=0.0)),
        parameters={p.name: float(s) for p, s in zip(problem.parameters, sigma, strict=True)},
    )


def _none(why: str) -> NoiseErrors:
    return NoiseErrors(parameters={}, why_not=why)


def _alike(one: Any, other: Any) -> bool:
    scale = np.sqrt(np.outer(np.diag(one), np.diag(one)))
    return bool((np.abs(one - other) <= 1e-6 * np.where(scale > 0.0, scale, 1.0)).all())
