"""What the objectives of noise tuning see of Q and R: the information behind `identifiability`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from navopt.errors import InvalidInput

if TYPE_CHECKING:
    from navopt.problems.noise_tuning import NoiseTuning

__all__ = ["error_sensitivity", "likelihood_sensitivity", "noise_words"]

#: Step of differences of the filtered states, in decades or as a share of a raw scale.
STEP = 1e-3
#: A covariance that is this near to its last value has settled; states then are as near as the root of it.
SETTLED = 1e-10
#: Coefficients that differ by less are called equal.
EQUAL = 0.05


def likelihood_sensitivity(problem: NoiseTuning, x: np.ndarray) -> np.ndarray:
    """Root of the expected information of the innovations (`navopt.filters.fisher_information`).

    Parameters
    ----------
    problem : NoiseTuning
        Model and parameters.
    x : ndarray, shape (n_var,)
        Where, taken for the truth.

    Returns
    -------
    ndarray, shape (n_var, n_var)

    Raises
    ------
    InvalidInput
        If the filter cannot run there.
    """
    from navopt.filters.information import fisher_information

    Q, R = problem.covariances(x)
    dQ, dR = problem.directions(x)
    information = fisher_information(problem.model, Q[0], R[0], directions_Q=dQ, directions_R=dR)
    width = problem.xu - problem.xl
    values, vectors = np.linalg.eigh(information * np.outer(width, width))
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T / width


def error_sensitivity(problem: NoiseTuning, x: np.ndarray) -> np.ndarray:
    """Derivative of the filtered states by the parameters, each state in units of its filtered sigma.

    The error against true states changes with Q and R only as the filtered states do. These depend on the
    gain, which stays the same if Q, R and P0 are multiplied by one number; so what little the first steps
    show of the level of Q and R comes of a prior covariance that does not follow it. It is left out: steps
    count from where the filter has settled, and where it does not, the prior covariance is taken to follow
    the scale of R.

    Parameters
    ----------
    problem : NoiseTuning
        Model, data and parameters.
    x : ndarray, shape (n_var,)
        Where.

    Returns
    -------
    ndarray, shape (steps * number of scored states, n_var)
        The rows count as independent, though errors of neighbouring steps are not: attainable deviations that
        follow from it are too small, by the root of the number of steps over which they are correlated. What
        cannot be told does not depend on that.

    Raises
    ------
    InvalidInput
        If the filter cannot run there.
    """
    step = STEP * np.abs(x) if problem.encoding == "raw" else np.full(problem.n_var, STEP)
    moves = np.diag(step)
    Q, R = problem.covariances(np.vstack([x, x + moves, x - moves]))
    sizes = np.exp(np.log(np.diagonal(R, axis1=1, axis2=2)).mean(axis=1))
    # the gain is the same for all multiples of (Q, R, P0): dividing Q and R is multiplying P0
    level = (sizes / sizes[0])[:, None, None]
    run = problem.filter.run(Q / level, R / level)
    for reason in run.failed:
        if reason is not None:
            raise InvalidInput("x", x.tolist(), f"give a point where the filter works: {reason}")
    states = list(problem.scored_states)
    later = slice(_settled(run.covariances[0]), None)
    estimates = run.estimates[:, later, states]
    variances = np.diagonal(run.covariances[0, later], axis1=1, axis2=2)[:, states]
    # a state that is known exactly moves for no Q and R
    sigma = np.sqrt(np.where(variances > 0.0, variances, np.inf))
    count = problem.n_var
    slopes = (estimates[1 : count + 1] - estimates[count + 1 :]) / (2.0 * step[:, None, None]) / sigma
    return slopes.reshape(count, -1).T


def _settled(covariances: np.ndarray) -> int:
    """First step from which the covariance stays as it is at the end; 0 if not in the first half."""
    sigma = np.sqrt(np.diagonal(covariances[-1]))
    unit = np.where(sigma > 0.0, sigma, 1.0)
    gap = np.abs(covariances - covariances[-1]) / np.outer(unit, unit)
    moving = np.flatnonzero(gap.max(axis=(1, 2)) > SETTLED)
    first = int(moving[-1]) + 1 if moving.size else 0
    return first if first < len(covariances) // 2 else 0


def noise_words(problem: NoiseTuning, coefficients: dict[str, float]) -> str:
    """Say what a combination of the parameters is.

    Parameters
    ----------
    problem : NoiseTuning
        Whose parameters they are.
    coefficients : dict of str to float
        Weight of each, in units of half the width of its box.

    Returns
    -------
    str
        For scales of Q and R in equal measure, that it is their common scale. Empty if there is no word.
    """
    half = dict(zip(problem.parameter_names, 0.5 * (problem.xu - problem.xl), strict=True))
    moved = {name: weight * half[name] for name, weight in coefficients.items()}
    cut = problem.Q_form.n_parameters
    scales_q = problem.parameter_names[: problem.Q_form.n_scales]
    scales_r = problem.parameter_names[cut : cut + problem.R_form.n_scales]
    if problem.encoding == "raw" or not set(moved) <= {*scales_q, *scales_r}:
        return ""
    values = list(moved.values())
    alike = max(values) - min(values) < EQUAL * max(map(abs, values))
    if not alike:
        return ""
    mixed = bool(set(moved) & set(scales_q)) and bool(set(moved) & set(scales_r))
    if mixed and len(moved) == len(scales_q) + len(scales_r):
        ratio = "ratio is" if len(moved) == 2 else "ratios are"
        return f"the scale of Q and R together, only their {ratio} told"
    if mixed:
        return "their common scale, only ratios are told"
    return "the scale of Q" if set(moved) == set(scales_q) else ""
