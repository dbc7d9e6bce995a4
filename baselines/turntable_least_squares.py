"""The conventional calibration: known rates on a turntable, linear least squares."""

from __future__ import annotations

from typing import Any

import numpy as np

from baselines.base import Baseline
from baselines.calibration_fit import Calibrated, TriadFit, turntable_record
from navopt.algorithms.options import one_of
from navopt.models.earth import EARTH_RATE
from navopt.models.triad import PARAMETER_NAMES
from navopt.models.turntable import fit_turntable
from navopt.registry import solver

__all__ = ["TurntableLeastSquares"]


@solver(
    "turntable-ls",
    summary="24-position method: linear least squares on a turntable record, all twelve parameters",
    source="24-position calibration, as in Fu et al. 2011, Chin. J. Aeronaut. 24:210",
    needs=("triad",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it is one linear step",
        "comparison_based": "it fits the turntable record, whatever the loss is",
    },
)
class TurntableLeastSquares(Baseline):
    """Calibrate gyros by least squares on a turntable record.

    Each sensor's counts are a linear function of the known rates; four numbers of each are fitted, see
    `navopt.models.fit_turntable`. The field positions are not looked at.

    Parameters
    ----------
    rows : {"all", "positions"}
        Use the whole record, or only where the table stood still.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    The answer is attached as a `baselines.TriadFit` with its covariance, all twelve parameters whatever the
    problem estimates; ``solution.x`` is its projection. It costs one unit for the pass through the record
    (``counts.internal``) and one for the loss.
    """

    def __init__(self, *, rows: str = "all", **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.rows = one_of("rows", rows, ("all", "positions"))
        self.estimate: TriadFit | None = None
        self.fitted: Calibrated | None = None

    def propose(self) -> np.ndarray:
        """Projection of the fit into the box, shape (1, n_var)."""
        counts, rates, sigma = turntable_record(self.problem, self.solver_info.name)
        if self.rows == "positions":
            # a table that turns, turns ten times faster than the Earth at least
            still = np.linalg.norm(rates, axis=1) < 2.0 * EARTH_RATE
            counts, rates = counts[still], rates[still]
        if self.evaluator.remaining < 2:
            return self.problem.nominal[None]
        self.evaluator.charge(1)
        triad, covariance = fit_turntable(counts, rates, sigma)
        residuals = (counts - triad.forward(rates)) / (triad.scale * sigma)
        freedom = residuals.size - 12
        misfit = float(np.sqrt(np.sum(residuals**2) / freedom)) if freedom > 0 else float("nan")
        self.estimate = TriadFit(
            triad.scale, triad.misalignment, triad.bias, PARAMETER_NAMES, covariance, misfit
        )
        self.fitted = Calibrated.of(triad)
        return self.problem.project(self.estimate)[None]
