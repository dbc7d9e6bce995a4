"""What calibrating baselines attach: sensor triads with the covariance of what was estimated."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.errors import UnsuitableProblem
from navopt.models.imu_calibration import ImuCalibration
from navopt.models.triad import GyroTriad

__all__ = ["Calibrated", "ImuFit", "TriadFit", "turntable_record"]

Array = NDArray[np.float64]


def _none() -> Array:
    return np.zeros((0, 0))


@dataclass(frozen=True, eq=False)
class TriadFit(GyroTriad):
    """Gyros as estimated, with how well.

    Attributes
    ----------
    scale, misalignment, bias : ndarray
        As for `navopt.models.GyroTriad`.
    names : tuple of str
        Parameters that were estimated.
    covariance : ndarray, shape (len(names), len(names))
        Of these, from the declared noise.
    misfit : float
        Root mean square of the whitened residuals per degree of freedom: about one if the declared noise is
        the true one; NaN without degrees of freedom.
    """

    names: tuple[str, ...] = ()
    covariance: Array = field(default_factory=_none)
    misfit: float = float("nan")

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each estimated parameter."""
        return _sigma(self)


@dataclass(frozen=True, eq=False)
class ImuFit(ImuCalibration):
    """Gyros and accelerometers as estimated, with how well.

    Attributes
    ----------
    gyro_vector, accelerometer_vector : ndarray, shape (12,)
        As for `navopt.models.ImuCalibration`.
    names, covariance, misfit
        As for `TriadFit`.
    """

    names: tuple[str, ...] = ()
    covariance: Array = field(default_factory=_none)
    misfit: float = float("nan")

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each estimated parameter."""
        return _sigma(self)


def _sigma(fit: TriadFit | ImuFit) -> dict[str, float]:
    return dict(zip(fit.names, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibration to be used on other records of the same sensors.

    What was learnt are the parameters; `apply` returns them as they are, whatever the record says.

    Attributes
    ----------
    gyro_vector : ndarray, shape (12,)
        The gyros.
    accelerometer_vector : ndarray, shape (12,) or (0,)
        The accelerometers, if they were calibrated along.
    """

    gyro_vector: Array
    accelerometer_vector: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, estimate: GyroTriad | ImuCalibration) -> Calibrated:
        """Keep the parameters of an estimate."""
        if isinstance(estimate, ImuCalibration):
            return Calibrated(estimate.gyro_vector, estimate.accelerometer_vector)
        return Calibrated(estimate.vector)

    def apply(self, problem: Any) -> GyroTriad | ImuCalibration:
        """Return the calibration for another problem of the same sensors."""
        if len(self.accelerometer_vector):
            return ImuCalibration(self.gyro_vector, self.accelerometer_vector)
        return GyroTriad.from_vector(self.gyro_vector)


def turntable_record(problem: Any, name: str) -> tuple[Array, Array, float]:
    """Return counts, rates and noise of a problem's turntable record.

    Parameters
    ----------
    problem : GyroCalibration
    name : str
        Registry name of the solver that asks.

    Returns
    -------
    counts, rates : ndarray, shape (k, 3)
    sigma : float

    Raises
    ------
    UnsuitableProblem
        If there is none.
    """
    while not hasattr(problem, "turntable_counts") and hasattr(problem, "problem"):
        # a wrapper leaves the record with the problem inside
        problem = problem.problem
    if getattr(problem, "turntable_counts", None) is None:
        raise UnsuitableProblem(
            f"{name} cannot solve this {type(problem).__name__}: it needs turntable_counts "
            "and turntable_rates, a record with known rates"
        )
    return problem.turntable_counts, problem.turntable_rates, problem.turntable_sigma
