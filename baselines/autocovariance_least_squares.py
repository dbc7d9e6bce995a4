"""Noise covariances by autocovariance least squares, as a solver."""

from __future__ import annotations

from typing import Any

from baselines.als_fit import SOLVERS, fit_autocovariances
from baselines.noise_baseline import EstimatedNoise, NoiseBaseline
from baselines.noise_structure import NoiseStructure
from navopt.algorithms.options import at_least, number, one_of
from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import LinearGaussianModel
from navopt.registry import solver

__all__ = ["AutocovarianceLeastSquares"]


@solver(
    "als",
    summary="autocovariance least squares: a semidefinite programme, by cvxpy",
    source="Odelson, Rajamani, Rawlings 2006; Rajamani, Rawlings 2009",
    needs=("linear-gaussian",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it runs the filter once a pass",
        "comparison_based": "it uses the autocovariances of innovations, not the order of losses",
    },
)
class AutocovarianceLeastSquares(NoiseBaseline):
    """Fit Q and R to the autocovariances of the innovations of a filter with a fixed gain.

    It needs a constant model and all measurements.

    Parameters
    ----------
    covariance : {"scalar", "diagonal", "full", "fixed"}, pair of them, or None
        What is looked for in Q and R; what the problem looks for if None.
    lags : int
        Number of autocovariances, lag zero among them.
    passes : int
        How often the filter is run, each time with the gain of the estimates so far.
    burn_in : int, optional
        Innovations left out at the beginning; 100, or a fifth of them if they are fewer than 500.
    weighting : {"white", "identity"}
        Weights of the autocovariances.
    trace_weight : float
        Weight of the trace of Q, in the unit of its reference; needed where Q is not unique.
    conic_solver : {"CLARABEL", "SCS"}
        What cvxpy calls.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.
    """

    def __init__(
        self,
        *,
        covariance: str | tuple[str, str] | None = None,
        lags: int = 15,
        passes: int = 2,
        burn_in: int | None = None,
        weighting: str = "white",
        trace_weight: float = 0.0,
        conic_solver: str = "CLARABEL",
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._declare(covariance)
        self.lags, self.passes = at_least("lags", lags, 2), at_least("passes", passes, 1)
        self.burn_in = None if burn_in is None else at_least("burn_in", burn_in, 0)
        self.weighting = one_of("weighting", weighting, ("white", "identity"))
        self.trace_weight = number("trace_weight", trace_weight)
        if self.trace_weight < 0.0:
            raise InvalidInput("trace_weight", trace_weight, "give a number that is not negative")
        self.conic_solver = one_of("conic_solver", conic_solver, SOLVERS)

    def _fit(self, model: LinearGaussianModel, structure: NoiseStructure) -> EstimatedNoise:
        fit = fit_autocovariances(
            model, structure, lags=self.lags, passes=self.passes, burn_in=self.burn_in,
            weighting=self.weighting, trace_weight=self.trace_weight, solver=self.conic_solver,
            spend=self.spend,
        )  # fmt: skip
        return EstimatedNoise(
            Q=fit.Q, R=fit.R, method="als", converged=fit.passes == self.passes, determined=fit.unique
        )
