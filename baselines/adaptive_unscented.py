"""Filters of heading-aided alignment that learn the noise of their measurements as they run."""

from __future__ import annotations

from typing import Any

from baselines.heading_baseline import HeadingBaseline
from navopt.problems.heading_settings import HeadingSettings
from navopt.registry import solver

__all__ = ["AdaptiveUnscented"]


@solver(
    "adaptive-unscented",
    summary="unscented filter that learns the noise of velocities and headings as it runs",
    source="Sage, Husa 1969; Mohamed, Schwarz 1999",
    needs=("heading-filter",),
    stochastic=False,
    spends_all=False,
    comparison_based=True,
    reasons={"spends_all": "there is one candidate to evaluate"},
)
class AdaptiveUnscented(HeadingBaseline):
    """Answer with a filter that starts at the declared noises and learns R in the run.

    Parameters
    ----------
    kind : {"sage-husa", "window"}
        Forgetting, or a window of the last measurements.
    form : {"residual", "innovation"}
        What shows the variances; residuals give ones that are positive by themselves.
    forgetting : float
        b of Sage and Husa.
    window : int
        Measurements looked back at.
    variant : {"ukf", "srukf", "ekf", "st-ukf", "sst-ukf"}
        The filter.
    formulation : {"direct", "correlated", "paper", "none"}
        How the heading is used.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    Only the noise of the measurements is learnt: what a low-cost gyro adds between two headings is a
    twentieth of what a heading is wrong by, and hardly any innovation shows it.
    """

    def __init__(
        self,
        *,
        kind: str = "sage-husa",
        form: str = "residual",
        forgetting: float = 0.99,
        window: int = 50,
        variant: str = "ukf",
        formulation: str = "direct",
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.kind, self.form, self.forgetting, self.window = kind, form, forgetting, window
        self.variant, self.formulation = variant, formulation
        self.filter_settings = HeadingSettings(
            variant=variant, formulation=formulation, adaptation=kind, adaptation_form=form,
            adaptation_forgetting=forgetting, adaptation_window=window,
        )  # fmt: skip

    def settings_for(self, problem: Any) -> HeadingSettings:
        """Return the settings, whatever the problem."""
        return self.filter_settings
