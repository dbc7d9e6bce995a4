"""The adaptive filter of Sage and Husa, as a solver."""

from __future__ import annotations

from typing import Any

from baselines.adaptive_filters import ADAPTED, sage_husa
from baselines.noise_baseline import EstimatedNoise, NoiseBaseline
from baselines.noise_structure import NoiseStructure
from navopt.algorithms.options import at_least, number, one_of
from navopt.models.linear_gaussian import LinearGaussianModel
from navopt.registry import solver

__all__ = ["SageHusa"]


@solver(
    "sage-husa",
    summary="adaptive filter that learns R (or Q) with forgetting",
    source="Sage, Husa 1969",
    needs=("linear-gaussian",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it is one run of a filter",
        "comparison_based": "it uses the innovations, not the order of losses",
    },
)
class SageHusa(NoiseBaseline):
    """Learn R(t), or Q(t), in one run over the data, from the nominal covariances.

    Parameters
    ----------
    covariance : {"scalar", "diagonal", "full", "fixed"}, pair of them, or None
        What is looked for in Q and R; what the problem looks for if None.
    adapt : {"R", "Q", "both"}
        What is learnt; the other stays nominal. Both at once is not stable in general.
    forgetting : float
        Forgetting factor b; the memory is 1/(1 − b) measurements.
    burn_in : int
        Measurements before learning begins.
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
        forgetting: float = 0.99,
        burn_in: int = 20,
        low: float = 1e-4,
        high: float = 1e4,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._declare(covariance)
        self.adapt = one_of("adapt", adapt, ADAPTED)
        self.forgetting = number("forgetting", forgetting, above=0.0, most=1.0 - 1e-9)
        self.burn_in = at_least("burn_in", burn_in, 0)
        self.low = number("low", low, above=0.0, most=1.0)
        self.high = number("high", high, above=self.low)

    def _fit(self, model: LinearGaussianModel, structure: NoiseStructure) -> EstimatedNoise:
        if not self.spend(1):
            return self._nominal(model, structure)
        run = sage_husa(
            model, structure, adapt=self.adapt, forgetting=self.forgetting, burn_in=self.burn_in,
            low=self.low, high=self.high,
        )  # fmt: skip
        return EstimatedNoise(Q=run.Q, R=run.R, method="sage-husa")
