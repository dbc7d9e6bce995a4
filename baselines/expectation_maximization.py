"""Noise covariances by expectation maximisation, as a solver."""

from __future__ import annotations

from typing import Any

from baselines.em_steps import fit_em
from baselines.noise_baseline import EstimatedNoise, NoiseBaseline
from baselines.noise_structure import NoiseStructure
from navopt.algorithms.options import at_least, number
from navopt.models.linear_gaussian import LinearGaussianModel
from navopt.registry import solver

__all__ = ["ExpectationMaximization"]


@solver(
    "em",
    summary="expectation maximisation with a smoother",
    source="Shumway, Stoffer 1982; disturbance smoother of Koopman 1993",
    needs=("linear-gaussian",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it ends when the covariances have stopped moving",
        "comparison_based": "it uses smoothed noises, not the order of losses",
    },
)
class ExpectationMaximization(NoiseBaseline):
    """Raise the likelihood of the innovations at every pass of a filter and a smoother.

    Parameters
    ----------
    covariance : {"scalar", "diagonal", "full", "fixed"}, pair of them, or None
        What is looked for in Q and R; what the problem looks for if None.
    max_passes : int
        Cap on passes; a pass costs two units of the budget.
    tolerance : float
        Ends when no covariance moves by a larger part of itself in a pass.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.
    """

    def __init__(
        self,
        *,
        covariance: str | tuple[str, str] | None = None,
        max_passes: int = 500,
        tolerance: float = 1e-5,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._declare(covariance)
        self.max_passes = at_least("max_passes", max_passes, 1)
        self.tolerance = number("tolerance", tolerance, above=0.0)

    def _fit(self, model: LinearGaussianModel, structure: NoiseStructure) -> EstimatedNoise:
        fit = fit_em(model, structure, max_passes=self.max_passes, tolerance=self.tolerance, spend=self.spend)
        known = float(fit.log_likelihood[-1]) if fit.passes else float("nan")
        return EstimatedNoise(Q=fit.Q, R=fit.R, method="em", converged=fit.converged, log_likelihood=known)
