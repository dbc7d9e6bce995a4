"""Noise covariances by maximum likelihood of the innovations, once for all data or in a sliding window."""

from __future__ import annotations

from typing import Any

from baselines.likelihood_fit import fit_innovation_likelihood
from baselines.likelihood_window import fit_windows
from baselines.noise_baseline import EstimatedNoise, NoiseBaseline
from baselines.noise_structure import NoiseStructure
from navopt.algorithms.options import at_least, number
from navopt.models.linear_gaussian import LinearGaussianModel
from navopt.registry import solver

__all__ = ["InnovationLikelihood"]


@solver(
    "innovation-likelihood",
    summary="maximum likelihood of the filter's innovations, by casadi and IPOPT",
    source="Schweppe 1965; Fisher scoring with exact derivatives",
    needs=("linear-gaussian",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it ends when its descents have converged",
        "comparison_based": "it uses the innovations and their derivatives, not the order of losses",
    },
)
class InnovationLikelihood(NoiseBaseline):
    """Estimate Q and R from innovations alone, with standard errors; the level as well as the ratio.

    Parameters
    ----------
    covariance : {"scalar", "diagonal", "full", "fixed"}, pair of them, or None
        What is looked for in Q and R; what the problem looks for if None.
    starts : int
        Number of starts: the problem's nominal covariances and a Sobol sequence around them.
    spread : float
        How far from the nominal ones the others are, as a logarithm of a variance.
    prior_sigma : float, optional
        Standard deviation of a Gaussian prior on every parameter, as a logarithm of a variance; 2 is wide.
    max_iterations : int
        Cap on IPOPT's iterations from one start.
    window : int, optional
        Solve again and again over so many last measurements, with an arrival prior, for Q(t) and R(t); over
        all measurements at once if not given.
    stride : int
        Steps between two solves of a window.
    walk : float
        Standard deviation of the prior that ties a window's parameters to those before.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    A run of the filter with the derivatives for d parameters costs 1 + d units of the budget; over a
    window, that part of it that the window is of the data.
    """

    def __init__(
        self,
        *,
        covariance: str | tuple[str, str] | None = None,
        starts: int = 5,
        spread: float = 4.0,
        prior_sigma: float | None = None,
        max_iterations: int = 60,
        window: int | None = None,
        stride: int = 10,
        walk: float = 1.0,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._declare(covariance)
        self.starts = at_least("starts", starts, 1)
        self.spread = number("spread", spread, above=0.0)
        self.prior_sigma = None if prior_sigma is None else number("prior_sigma", prior_sigma, above=0.0)
        self.max_iterations = at_least("max_iterations", max_iterations, 1)
        self.stride = at_least("stride", stride, 1)
        self.window = None if window is None else at_least("window", window, self.stride + 1)
        self.walk = number("walk", walk, above=0.0)

    def _fit(self, model: LinearGaussianModel, structure: NoiseStructure) -> EstimatedNoise:
        if self.window is not None:
            tracked = fit_windows(
                model, structure, window=self.window, stride=self.stride, walk=self.walk,
                max_iterations=self.max_iterations, spend=self.spend,
            )  # fmt: skip
            wanted = (model.n_steps - 1) // self.stride
            return EstimatedNoise(
                Q=tracked.Q, R=tracked.R, method="innovation-likelihood",
                converged=len(tracked.solved_at) == wanted,
            )  # fmt: skip
        fit = fit_innovation_likelihood(
            model, structure, starts=self.starts, spread=self.spread, prior_sigma=self.prior_sigma,
            max_iterations=self.max_iterations, spend=self.spend,
        )  # fmt: skip
        return EstimatedNoise(
            Q=fit.Q,
            R=fit.R,
            method="innovation-likelihood",
            converged=fit.converged,
            determined=bool((fit.sigma_log10 >= 0.0).all()) and not fit.at_limit,
            log_likelihood=fit.log_likelihood,
            sigma_log10=fit.sigma_log10,
        )
