"""The filter that adapts to a window of its innovations, as a solver."""

from __future__ import annotations

from typing import Any

from baselines.adaptive_filters import ADAPTED, innovation_adaptive
from baselines.noise_baseline import EstimatedNoise, NoiseBaseline
from baselines.noise_structure import NoiseStructure
from navopt.algorithms.options import at_least, number, one_of
from navopt.models.linear_gaussian import LinearGaussianModel
from navopt.registry import solver

__all__ = ["InnovationAdaptive"]


@solver(
    "innovation-adaptive",
    summary="adaptive filter that learns R (or Q) from a window of innovations or residuals",
    source="Mohamed, Schwarz 1999",
    needs=("linear-gaussian",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it is one run of a filter",
        "comparison_based": "it uses the innovations, not the order of losses",
    },
)
class InnovationAdaptive(NoiseBaseline):
    """Learn R(t), or Q(t), in one run over the data, from the nominal covariances.

    Parameters
    ----------
    covariance : {"scalar", "diagonal", "full", "fixed"}, pair of them, or None
        What is looked for in Q and R; what the problem looks for if None.
    adapt : {"R", "Q", "both"}
        What is learnt; the other stays nominal. Both at once is not stable in general.
    window : int
        Number of measurements looked back at.
    form : {"innovation", "residual"}
        What R is learnt from; residuals give one that is positive by itself.
    low, high : float
        Least and largest factor to the nominal covariances.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.
    """

    def __init__(
        self,
        *,
        covariance: str | tuple[str, str] | None = None,
        adapt: str = "R",
        window: int = 150,
        form: str = "innovation",
        low: float = 1e-4,
        high: float = 1e4,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._declare(covariance)
        self.adapt = one_of("adapt", adapt, ADAPTED)
        self.window = at_least("window", window, 2)
        self.form = one_of("form", form, ("innovation", "residual"))
        self.low = number("low", low, above=0.0, most=1.0)
        self.high = number("high", high, above=self.low)

    def _fit(self, model: LinearGaussianModel, structure: NoiseStructure) -> EstimatedNoise:
        if not self.spend(1):
            return self._nominal(model, structure)
        run = innovation_adaptive(
            model, structure, adapt=self.adapt, window=self.window, form=self.form, low=self.low,
            high=self.high,
        )  # fmt: skip
        return EstimatedNoise(Q=run.Q, R=run.R, method="innovation-adaptive")
