"""Noise covariances by Mehra's correlation method, as a solver."""

from __future__ import annotations

from typing import Any

from baselines.mehra_equations import fit_mehra
from baselines.noise_baseline import EstimatedNoise, NoiseBaseline
from baselines.noise_structure import NoiseStructure
from navopt.algorithms.options import at_least
from navopt.models.linear_gaussian import LinearGaussianModel
from navopt.registry import solver

__all__ = ["Mehra"]


@solver(
    "mehra",
    summary="correlation method: gain and covariances from the innovations of a wrong filter",
    source="Mehra 1970",
    needs=("linear-gaussian",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it runs the filter once a pass",
        "comparison_based": "it uses the autocovariances of innovations, not the order of losses",
    },
)
class Mehra(NoiseBaseline):
    """Find the optimal gain, then R and Q, from the autocovariances of a fixed filter's innovations.

    It needs a constant model, all measurements, and not more unknowns in Q than n m. ``estimate.white``
    says whether the innovations of the filter with the gain found are white.

    Parameters
    ----------
    covariance : {"scalar", "diagonal", "full", "fixed"}, pair of them, or None
        What is looked for in Q and R; what the problem looks for if None.
    passes : int
        How often the filter is run, each time with the gain of the pass before; once more for the test.
    lags : int, optional
        Number of autocovariances beyond lag zero; the larger of 20 and 2 n if not given.
    burn_in : int, optional
        Innovations left out at the beginning; 100, or a fifth of them if they are fewer than 500.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.
    """

    def __init__(
        self,
        *,
        covariance: str | tuple[str, str] | None = None,
        passes: int = 3,
        lags: int | None = None,
        burn_in: int | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._declare(covariance)
        self.passes = at_least("passes", passes, 1)
        self.lags = None if lags is None else at_least("lags", lags, 1)
        self.burn_in = None if burn_in is None else at_least("burn_in", burn_in, 0)

    def _fit(self, model: LinearGaussianModel, structure: NoiseStructure) -> EstimatedNoise:
        fit = fit_mehra(
            model, structure, passes=self.passes, lags=self.lags, burn_in=self.burn_in, spend=self.spend
        )
        return EstimatedNoise(
            Q=fit.Q, R=fit.R, method="mehra", converged=fit.passes == self.passes + 1,
            determined=fit.rank == fit.unknowns, white=fit.after.white,
        )  # fmt: skip
