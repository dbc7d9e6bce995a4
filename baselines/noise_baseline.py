"""What the estimators of noise covariances share: structure, budget, attached estimate, re-run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.base import Baseline
from baselines.noise_structure import KINDS, NoisePart, NoiseStructure
from navopt.algorithms.options import one_of
from navopt.errors import UnknownName, UnsuitableProblem
from navopt.problems.noise_tuning import NoiseEstimate
from navopt.registry import make_solver

__all__ = ["AdaptiveFitted", "EstimatedNoise", "FittedCovariances", "NoiseBaseline", "structure_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class EstimatedNoise(NoiseEstimate):
    """Covariances of the noises, and what the estimator says of them.

    Attributes
    ----------
    Q : ndarray, shape (g, g) or (T, g, g)
        Covariance of the process noise.
    R : ndarray, shape (m, m) or (T, m, m)
        Covariance of the measurement noise.
    method : str
        Registry name of the estimator.
    converged : bool
        Whether it came to its own end, not that of a budget or of a cap.
    determined : bool
        Whether the data determine every unknown, as far as the estimator can tell.
    log_likelihood : float
        Of the data, where the estimator knows it; NaN otherwise.
    sigma_log10 : ndarray or None
        Standard errors of the parameters in decades, where the estimator knows them.
    white : bool or None
        Result of a test of whiteness, where one was made.
    """

    method: str = ""
    converged: bool = True
    determined: bool = True
    log_likelihood: float = math.nan
    sigma_log10: NDArray[np.float64] | None = None
    white: bool | None = None


@dataclass(frozen=True)
class FittedCovariances:
    """Covariances that were learnt once, for use on other data.

    Attributes
    ----------
    Q : ndarray, shape (g, g)
        Covariance of the process noise.
    R : ndarray, shape (m, m)
        Covariance of the measurement noise.
    method : str
        Registry name of the estimator.
    """

    Q: NDArray[np.float64]
    R: NDArray[np.float64]
    method: str

    def apply(self, problem: Any) -> EstimatedNoise:
        """Return the covariances as the estimate of another problem; its data are not looked at."""
        return EstimatedNoise(Q=self.Q, R=self.R, method=self.method)


@dataclass(frozen=True)
class AdaptiveFitted:
    """An adaptive estimator with its settings, to be run on other data.

    Attributes
    ----------
    solver : str
        Registry name.
    settings : dict
        Its settings, plain values.
    """

    solver: str
    settings: dict[str, Any]

    def apply(self, problem: Any) -> EstimatedNoise:
        """Run on the data of another problem, from its nominal covariances."""
        algorithm: Any = make_solver(self.solver, **self.settings)
        estimate: EstimatedNoise = algorithm.fit(problem)
        return estimate


class NoiseBaseline(Baseline):
    """An estimator of Q and R that attaches an `EstimatedNoise` and proposes its projection.

    A subclass implements `_fit`, which asks `spend` before it runs a filter over the data: one run is one
    unit of the budget, as one loss is. A budget that is too small leaves the nominal covariances.
    """

    estimate: EstimatedNoise | None = None
    fitted: FittedCovariances | AdaptiveFitted | None = None
    covariance: str | tuple[str, str] | None = None
    _metered = False
    _owed = 0.0
    _charged = 0

    def _declare(self, covariance: str | tuple[str, str] | None) -> None:
        """Check and keep the option that all of them have."""
        if covariance is not None:
            for kind in (covariance,) if isinstance(covariance, str) else tuple(covariance):
                one_of("covariance", kind, KINDS)
            if not isinstance(covariance, str) and len(covariance) != 2:
                raise UnknownName("covariance", str(covariance), KINDS)
        self.covariance = covariance

    def fit(self, problem: Any) -> EstimatedNoise:
        """Estimate the covariances of a problem's noises; its truth is not looked at.

        Parameters
        ----------
        problem : NoiseTuning
            Or any problem with a `LinearGaussianModel` as ``model`` and with ``covariances``.

        Returns
        -------
        EstimatedNoise
        """
        return self._fit(problem.model, structure_of(problem, self.covariance))

    def _fit(self, model: Any, structure: NoiseStructure) -> EstimatedNoise:
        raise NotImplementedError

    def _nominal(self, model: Any, structure: NoiseStructure) -> EstimatedNoise:
        """Nominal covariances at all times, where a budget has no room for a run."""
        Q, R = structure.covariances(np.zeros(structure.n_parameters))
        return EstimatedNoise(
            Q=np.tile(Q, (model.n_steps, 1, 1)),
            R=np.tile(R, (model.n_steps, 1, 1)),
            method=self.solver_info.name,
            converged=False,
        )

    def propose(self) -> np.ndarray:
        """Projection of the estimate, shape (1, n_var)."""
        self._metered, self._owed, self._charged = True, 0.0, 0
        try:
            self.estimate = self.fit(self.problem)
        finally:
            self._metered = False
        if self.estimate.Q.ndim == self.estimate.R.ndim == 2:
            self.fitted = FittedCovariances(self.estimate.Q, self.estimate.R, self.solver_info.name)
        else:
            self.fitted = AdaptiveFitted(self.solver_info.name, dict(self.settings))
        return np.asarray(self.problem.project(self.estimate))[None]

    def spend(self, units: float) -> bool:
        """Book filter runs, parts of a run included, if the budget has room; say whether it has."""
        if not self._metered:
            return True
        due = math.ceil(self._owed + units - 1e-9) - self._charged
        # one unit is left for the loss of the answer
        if due > self.evaluator.remaining - 1:
            return False
        self.evaluator.charge(due)
        self._owed += units
        self._charged += due
        return True


def structure_of(problem: Any, covariance: str | tuple[str, str] | None = None) -> NoiseStructure:
    """What a problem looks for, found out from how its covariances depend on the decision vector.

    Parameters
    ----------
    problem : NoiseTuning
        Its nominal covariances become the references.
    covariance : str or pair of str, optional
        Look for something else: a kind of `NoiseStructure.of`, or one for Q and one for R.

    Returns
    -------
    NoiseStructure

    Raises
    ------
    UnsuitableProblem
        If the covariances are neither sums of matrices with weights 10^x nor of a named kind.
    """
    nominal = problem.nominal
    Q, R = (np.asarray(part)[0] for part in problem.covariances(nominal[None]))
    if covariance is not None:
        return NoiseStructure.of(covariance, Q, R)
    found = _weighted_sums(problem, nominal, Q, R)
    if found is not None:
        return found
    kinds = tuple(getattr(getattr(problem, form, None), "kind", None) for form in ("Q_form", "R_form"))
    if all(kind in KINDS for kind in kinds):
        return NoiseStructure.of(kinds, Q, R)  # type: ignore[arg-type]
    raise UnsuitableProblem(
        f"{type(problem).__name__} has covariances that are no sums of matrices with weights 10^x: "
        "say what to look for by covariance='scalar', 'diagonal' or 'full'"
    )


def _weighted_sums(problem: Any, nominal: Array, Q: Array, R: Array) -> NoiseStructure | None:
    """The structure if every parameter is the decimal logarithm of the weight of a matrix, else None."""
    d = len(nominal)
    step = 0.25
    one_by_one = nominal + np.vstack([step * np.eye(d), 0.3 * np.cos(np.arange(1.0, d + 1.0))])
    Qs, Rs = (np.asarray(part) for part in problem.covariances(one_by_one))
    parts = []
    for name, centre, moved in (("Q", Q, Qs), ("R", R, Rs)):
        basis = (moved[:d] - centre) / (10.0**step - 1.0)
        predicted = centre + np.tensordot(10.0 ** (one_by_one[d] - nominal) - 1.0, basis, axes=1)
        size = max(float(np.abs(centre).max()), 1e-300)
        if not np.allclose(predicted, moved[d], rtol=0.0, atol=1e-9 * size):
            return None
        used = np.abs(basis).max(axis=(1, 2)) > 1e-12 * size
        fixed = centre - basis[used].sum(axis=0)
        fixed[np.abs(fixed) < 1e-10 * size] = 0.0
        variances = np.diag(centre)
        scale = np.sqrt(np.where(variances > 0.0, variances, 1.0))
        parts.append((name, NoisePart(len(centre), np.ascontiguousarray(basis[used]), fixed, scale), used))
    # a parameter of both would be counted twice
    if (parts[0][2] & parts[1][2]).any() or not (parts[0][2] | parts[1][2]).all():
        return None
    return NoiseStructure(parts[0][1], parts[1][1])
