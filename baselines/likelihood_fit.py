"""Noise covariances by maximum likelihood of the innovations: IPOPT on casadi's exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from baselines.likelihood_descent import Spend, descend
from baselines.likelihood_objective import InnovationObjective, observed_information
from baselines.noise_structure import NoiseStructure
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["LikelihoodFit", "fit_innovation_likelihood"]

Array = NDArray[np.float64]

#: Within this much of the best log-likelihood, two starts have found the same optimum.
SAME = 1e-3


@dataclass(frozen=True)
class LikelihoodFit:
    """Maximum-likelihood covariances of the noises.

    Attributes
    ----------
    Q, R : ndarray, shape (g, g) and (m, m)
        Covariances of process and measurement noise.
    theta : ndarray, shape (d,)
        Parameters of the structure.
    theta_covariance : ndarray, shape (d, d)
        Inverse of the observed information; NaN where it is singular, that is, where the data do not
        determine a parameter.
    log_likelihood : float
        Natural logarithm of the likelihood at the optimum, prior apart.
    starts_agreeing : int
        How many starts ended at this optimum.
    passes : int
        Filter runs with derivatives, of all starts.
    converged : bool
        Whether IPOPT found an optimum; False where a budget or the cap on iterations ended it.
    at_limit : bool
        Whether a parameter ended at the end of its range: the data want it to be zero, or huge.
    """

    Q: Array
    R: Array
    theta: Array
    theta_covariance: Array
    log_likelihood: float
    starts_agreeing: int
    passes: int
    converged: bool
    at_limit: bool

    @property
    def sigma_log10(self) -> Array:
        """Standard errors of the parameters in decades, shape (d,): of log10 q for a variance q."""
        return np.sqrt(np.diag(self.theta_covariance)) / np.log(10.0)


def fit_innovation_likelihood(
    model: LinearGaussianModel,
    structure: NoiseStructure,
    *,
    starts: int = 5,
    spread: float = 4.0,
    prior_sigma: float | None = None,
    max_iterations: int = 60,
    spend: Spend | None = None,
) -> LikelihoodFit:
    """Fit Q and R by the prediction-error decomposition of Schweppe (1965).

    Minimises −log L(θ) = ½ Σ [m ln 2π + ln det S_k + e_kᵀ S_k⁻¹ e_k] over the innovations e_k of the
    Kalman filter with covariances S_k, from several starts.

    Parameters
    ----------
    model : LinearGaussianModel
        The model with its measurements; NaN where one is missing.
    structure : NoiseStructure
        What is looked for, in units of its references.
    starts : int, default 5
        Number of starts; the first is the reference, the others a Sobol sequence around it.
    spread : float, default 4.0
        How far from the reference the others are, as a logarithm of a variance.
    prior_sigma : float, optional
        Standard deviation of a Gaussian prior on every parameter, centred on the reference (2 is wide).
    max_iterations : int, default 60
        Cap on IPOPT's iterations from one start.
    spend : callable, optional
        Asked with the price of every filter run before it is made; False ends the search.

    Returns
    -------
    LikelihoodFit

    Raises
    ------
    InvalidInput
        If structure and model do not fit.
    """
    d = structure.n_parameters
    sigma = None if prior_sigma is None else np.full(d, prior_sigma)
    objective = InnovationObjective(model, structure, prior_sigma=sigma)
    ends = []
    for begin in _beginnings(structure, starts, spread):
        if spend is not None and not spend(1 + d):
            break
        end = descend(objective, objective.rescaled(begin), max_iterations=max_iterations, spend=spend)
        if end is not None:
            ends.append(end)
    if not ends:
        return _nothing(structure, objective)
    best = min(ends, key=lambda end: end.value)
    theta = best.theta
    affordable = spend is None or spend(2 * d * (1 + d))
    information = observed_information(objective, theta) if affordable else np.full((d, d), np.nan)
    Q, R = structure.covariances(theta)
    same = SAME / objective.n_seen
    return LikelihoodFit(
        Q=Q,
        R=R,
        theta=theta,
        theta_covariance=_inverse(information),
        log_likelihood=-best.likelihood,
        starts_agreeing=sum(end.value <= best.value + same for end in ends),
        passes=objective.passes,
        converged=best.converged,
        at_limit=bool((np.abs(theta) > structure.limits - 1e-3).any()),
    )


def _beginnings(structure: NoiseStructure, starts: int, spread: float) -> list[Array]:
    d = structure.n_parameters
    out = [np.zeros(d)]
    if starts > 1:
        points = qmc.Sobol(d, scramble=False).random_base2(int(np.ceil(np.log2(starts))))[1:starts]
        # factors off the diagonal start near zero: an invertible matrix near the reference
        reach = np.where(structure.logarithmic, spread, 0.3)
        out += list(reach * (2.0 * points - 1.0))
    return out


def _nothing(structure: NoiseStructure, objective: InnovationObjective) -> LikelihoodFit:
    """The reference, where a budget did not allow a single evaluation."""
    d = structure.n_parameters
    Q, R = structure.covariances(np.zeros(d))
    return LikelihoodFit(
        Q, R, np.zeros(d), np.full((d, d), np.nan), np.nan, 0, objective.passes, False, False
    )


def _inverse(information: Array) -> Array:
    d = len(information)
    if not np.isfinite(information).all():
        return np.full((d, d), np.nan)
    values = np.linalg.eigvalsh(information)
    if values[0] <= 1e-10 * max(values[-1], 1e-300):
        return np.full((d, d), np.nan)
    return np.asarray(np.linalg.inv(information))
