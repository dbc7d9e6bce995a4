"""What the filters of heading-aided alignment share as solvers: settings that are an answer, no search."""

from __future__ import annotations

from typing import Any

import numpy as np

from baselines.base import Baseline
from navopt.problems.heading_settings import HeadingSettings

__all__ = ["HeadingBaseline"]


class HeadingBaseline(Baseline):
    """A filter with settings that do not depend on the data.

    It attaches the settings as its estimate and proposes their projection, one loss. A subclass implements
    `settings_for`.
    """

    estimate: HeadingSettings | None = None
    fitted: HeadingSettings | None = None

    def settings_for(self, problem: Any) -> HeadingSettings:
        """Settings of the filter for a problem, whose truth is not looked at."""
        raise NotImplementedError

    def propose(self) -> np.ndarray:
        """Projection of the settings, shape (1, n_var)."""
        self.estimate = self.fitted = self.settings_for(self.problem)
        return np.asarray(self.problem.project(self.estimate))[None]
