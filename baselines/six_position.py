"""The six-position method: each axis up and down, or turned both ways."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.base import Baseline
from baselines.calibration_fit import Calibrated, TriadFit, turntable_record
from navopt.errors import InvalidInput
from navopt.models.triad import PARAMETER_NAMES, GyroTriad
from navopt.models.turntable import triad_from_rows
from navopt.registry import solver

__all__ = ["SixPosition", "six_position"]

Array = NDArray[np.float64]


@solver(
    "six-position",
    summary="six-position method: half the difference and half the sum of opposite turntable positions",
    source="textbook method, e.g. Titterton and Weston 2004",
    needs=("triad",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it is a handful of differences and sums",
        "comparison_based": "it reads six positions of the turntable record, whatever the loss is",
    },
)
class SixPosition(Baseline):
    """Calibrate gyros from three opposite pairs of a turntable record.

    In a pair one rate changes its value and the two others do not. The differences of all three sensors over
    that of the rate are a column of the matrix of scale factors and misalignments; what the sums leave after
    the known rates is the bias.

    Parameters
    ----------
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    Of several pairs about an axis the one with the largest difference counts: the fastest rates of a table
    where there are some, otherwise up and down at rest. `TurntableLeastSquares` uses all positions and is
    more accurate by the square root of their number.

    The answer is attached as a `baselines.TriadFit`; ``solution.x`` is its projection. The cost is one unit
    for the record (``counts.internal``) and one for the loss.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.estimate: TriadFit | None = None
        self.fitted: Calibrated | None = None

    def propose(self) -> np.ndarray:
        """Projection of the answer into the box, shape (1, n_var)."""
        counts, rates, sigma = turntable_record(self.problem, self.solver_info.name)
        if self.evaluator.remaining < 2:
            return self.problem.nominal[None]
        self.evaluator.charge(1)
        triad, covariance = six_position(counts, rates, sigma)
        self.estimate = TriadFit(triad.scale, triad.misalignment, triad.bias, PARAMETER_NAMES, covariance)
        self.fitted = Calibrated.of(triad)
        return self.problem.project(self.estimate)[None]


def six_position(counts: Array, rates: Array, sigma: float) -> tuple[GyroTriad, Array]:
    """Differences and sums of three opposite pairs.

    Parameters
    ----------
    counts, rates : ndarray, shape (k, 3)
        Turntable record, rates in rad/s.
    sigma : float
        Noise of an averaged channel, rad/s.

    Returns
    -------
    triad : GyroTriad
    covariance : ndarray, shape (12, 12)
        Of its vector.

    Raises
    ------
    InvalidInput
        If there is no pair for an axis.
    """
    pairs = [_pair(rates, axis) for axis in range(3)]
    weights = np.zeros((4, len(rates)))
    mean = np.zeros(3)
    for axis, (up, down) in enumerate(pairs):
        step = rates[up, axis] - rates[down, axis]
        weights[axis, up], weights[axis, down] = 1.0 / step, -1.0 / step
        for row in (up, down):
            weights[3, row] += 1.0 / 6.0
            mean += rates[row] / 6.0
    # what the known rates contribute to the mean of the six is not bias
    weights[3] -= mean @ weights[:3]
    return triad_from_rows((weights @ counts).T, weights @ weights.T, sigma)


def _pair(rates: Array, axis: int) -> tuple[int, int]:
    """Rows that differ in the rate about one axis only, by as much as can be."""
    difference = rates[:, None] - rates[None]
    others = np.abs(np.delete(difference, axis, axis=2)).max(axis=2)
    along = np.where(others < 1e-6 * np.abs(rates).max(), difference[:, :, axis], 0.0)
    up, down = (int(k) for k in np.unravel_index(int(np.argmax(along)), along.shape))
    if not along[up, down] > 1e-3 * np.abs(rates).max():
        raise InvalidInput(
            "turntable_rates",
            f"{len(rates)} positions",
            f"no two differ in the rate about {'xyz'[axis]} alone: point {'xyz'[axis]} up and down with the "
            "horizontal axes as they were, or use turntable-ls",
        )
    return up, down
