"""Doing nothing: the value assumed before anything is estimated."""

from __future__ import annotations

import numpy as np

from baselines.base import Baseline
from navopt.registry import solver

__all__ = ["Nominal"]


@solver(
    "nominal",
    summary="no estimation at all (for a matching problem: the INS alone)",
    stochastic=False,
    spends_all=False,
    comparison_based=True,
    reasons={"spends_all": "there is one candidate to evaluate"},
)
class Nominal(Baseline):
    """Evaluate the problem's nominal values: the row every comparison needs to be read against."""

    def propose(self) -> np.ndarray:
        """Return the nominal decision vector."""
        return self.problem.nominal
