"""Filters of heading-aided alignment as they come: at the declared noises, nothing tuned."""

from __future__ import annotations

from typing import Any

from baselines.heading_baseline import HeadingBaseline
from navopt.problems.heading_settings import HeadingSettings
from navopt.registry import solver

__all__ = ["FixedTuning"]


@solver(
    "fixed-tuning",
    summary="one filter at the declared noises: EKF, UKF, strong-tracking UKF or SST-UKF",
    source="Math. Probl. Eng. 2020, 3101203",
    needs=("heading-filter",),
    stochastic=False,
    spends_all=False,
    comparison_based=True,
    reasons={"spends_all": "there is one candidate to evaluate"},
)
class FixedTuning(HeadingBaseline):
    """Answer with one filter whose settings nobody tuned.

    Parameters
    ----------
    variant : {"ekf", "ukf", "srukf", "st-ukf", "sst-ukf"}
        Which filter.
    formulation : {"direct", "correlated", "paper", "none"}
        How the heading is used; ``"none"`` is the filter without it.
    forgetting, weakening, cap, fades, normalise, factors
        Of strong tracking, see `navopt.filters.StrongTracking`.
    spread : float
        alpha of the sigma points.
    covariance_update : {"joseph", "faded", "printed"}
        See `navopt.filters.UnscentedFilter`.
    velocities : {"clock", "all"}
        When the velocities are used.
    heading_state_sigma : float, optional
        See `navopt.problems.heading_settings.HeadingSettings`.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    `x` and the loss are those of the projection onto what the problem tunes with its own filter; the scores
    are those of the attached settings.
    """

    def __init__(
        self,
        *,
        variant: str = "ukf",
        formulation: str = "direct",
        forgetting: float = 0.95,
        weakening: float = 1.0,
        cap: float | None = 1.05,
        fades: str = "whole",
        normalise: bool = True,
        factors: str = "multiple",
        spread: float = 1e-3,
        covariance_update: str = "joseph",
        velocities: str = "clock",
        heading_state_sigma: float | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.variant, self.formulation = variant, formulation
        self.forgetting, self.weakening, self.cap = forgetting, weakening, cap
        self.fades, self.normalise, self.factors = fades, normalise, factors
        self.spread, self.covariance_update, self.velocities = spread, covariance_update, velocities
        self.heading_state_sigma = heading_state_sigma
        # names of the options are those of the settings
        self.filter_settings = HeadingSettings(**self.settings)

    def settings_for(self, problem: Any) -> HeadingSettings:
        """Return the settings, whatever the problem."""
        return self.filter_settings
