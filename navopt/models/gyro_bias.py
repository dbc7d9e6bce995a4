"""Output of gyros at rest: a bias, and for many MEMS gyros one that depends on the specific force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navopt.models.pose_averages import PoseAverages

__all__ = ["GyroBias", "static_gyro_bias"]

#: Probability of a false finding that the bias depends on the specific force.
FALSE_ALARM = 1e-3


@dataclass(frozen=True, kw_only=True)
class GyroBias:
    """Output of the gyros at rest, from the means of static poses.

    Attributes
    ----------
    offset : ndarray, shape (3,)
        Counts without specific force.
    covariance : ndarray, shape (3, 3)
        Of the offset, from the scatter of the means.
    force_sensitivity : ndarray, shape (3, 3)
        Counts per m/s2: row i of gyro i, column j along axis j of the specific force. Zero where the means
        do not show any.
    force_sensitivity_sigma : ndarray, shape (3, 3)
        1 sigma.
    probability : float
        Of such a dependence by chance (F test); NaN where there were too few poses to tell.
    scatter : ndarray, shape (3,)
        Standard deviation of the means that is left, counts.
    """

    offset: np.ndarray
    covariance: np.ndarray
    force_sensitivity: np.ndarray
    force_sensitivity_sigma: np.ndarray
    probability: float
    scatter: np.ndarray

    @property
    def force_dependent(self) -> bool:
        """Whether the dependence is used."""
        return bool(np.any(self.force_sensitivity))


def static_gyro_bias(averages: PoseAverages, force: np.ndarray, *, depends: bool | None = None) -> GyroBias:
    """Find the output of the gyros at rest, and whether it depends on the specific force.

    Parameters
    ----------
    averages : PoseAverages
        Means of the poses.
    force : ndarray, shape (P, 3)
        Calibrated specific force in each, m/s2.
    depends : bool, optional
        Whether to use such a dependence; by an F test at 0.001 if not given.

    Returns
    -------
    GyroBias
        The Earth's rotation (15 deg/h at most) is part of the scatter.
    """
    from scipy.stats import f as f_law

    means, count = averages.gyro, len(averages)
    weight = 1.0 / np.maximum(averages.gyro_sigma, 1e-12)
    residual, designs = [], []
    for design in (np.ones((count, 1)), np.hstack([np.ones((count, 1)), force])):
        coefficients = np.stack(
            [
                np.linalg.lstsq(design * weight[:, [k]], means[:, k] * weight[:, k], rcond=None)[0]
                for k in range(3)
            ],
            axis=1,
        )
        designs.append((design, coefficients))
        residual.append(float((((means - design @ coefficients) * weight) ** 2).sum()))
    probability = np.nan
    enough = count >= 8 and np.linalg.matrix_rank(designs[1][0] / [1.0, 10.0, 10.0, 10.0], tol=0.3) == 4
    if enough:
        spare = 3 * count - 12
        ratio = (residual[0] - residual[1]) / 9.0 / (residual[1] / spare)
        probability = float(f_law.sf(ratio, 9, spare))
    used = enough and (probability < FALSE_ALARM if depends is None else depends)
    design, coefficients = designs[1 if used else 0]
    left = means - design @ coefficients
    spare_each = max(count - design.shape[1], 1)
    variances = np.zeros((3, design.shape[1]))
    for k in range(3):
        whitened = design * weight[:, [k]]
        excess = max(float(((left[:, k] * weight[:, k]) ** 2).sum()) / spare_each, 1.0)
        variances[k] = excess * np.diag(np.linalg.inv(whitened.T @ whitened))
    return GyroBias(
        offset=coefficients[0],
        covariance=np.diag(variances[:, 0]),
        force_sensitivity=coefficients[1:].T if used else np.zeros((3, 3)),
        force_sensitivity_sigma=np.sqrt(variances[:, 1:]) if used else np.zeros((3, 3)),
        probability=probability,
        scatter=left.std(axis=0),
    )
