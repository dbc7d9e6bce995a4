"""Gauss-Newton on the norm of the Earth rate: what the swarms minimise, solved in a few steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.base import Baseline
from baselines.calibration_fit import Calibrated, ImuFit, TriadFit
from navopt.algorithms.options import at_least, number, one_of
from navopt.errors import UnsuitableProblem
from navopt.identifiability import Identifiability, assess
from navopt.models.imu_calibration import ImuCalibration
from navopt.models.triad import PARAMETER_NAMES, GyroTriad
from navopt.problems.gyro_parameters import ACCELEROMETER, ALL_NAMES, UPPER
from navopt.registry import solver

__all__ = ["NormLeastSquares"]

Array = NDArray[np.float64]

FRAMES = (None, "preset", "lower-triangular", "symmetric")
#: A step that changes the whitened residuals by less than this is the last.
SETTLED = 1e-7
#: Or by less than this share of what they were at the start: with no noise to speak of, rounding comes first.
EXHAUSTED = 1e-12


@solver(
    "norm-ls",
    summary="Gauss-Newton on the norm of the Earth rate (and gravity), with covariance",
    source="Levenberg-Marquardt (this library)",
    needs=("residuals", "triad"),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it ends when its steps have become small against the noise",
        "comparison_based": "it uses residuals and their slopes, not the order of losses",
    },
)
class NormLeastSquares(Baseline):
    """Calibrate gyros, or gyros and accelerometers, by least squares on invariants.

    From the nominal values, Gauss–Newton steps on the problem's whitened residuals: norms of the Earth rate
    corrected for the noise, norms of gravity and the angle between the two where there are accelerometers,
    and the prior where there is one. Damping (Levenberg–Marquardt) comes in only if a step fails.

    Parameters
    ----------
    frame : {None, "preset", "lower-triangular", "symmetric"}
        What to do about body axes, which norms cannot tell. None: refuse a problem with parameters that the
        data do not tell, naming them. Otherwise the upper triangle of the misalignment matrix (the
        accelerometers' where there are some) is held at its preset; the answer is given in these axes, or in
        those of a convention, see `navopt.models.SensorTriad.in_frame`.
    steps : int
        Largest number of steps.
    threshold : float
        When a parameter counts as told, see `navopt.identifiability.identifiability`.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Raises
    ------
    UnsuitableProblem
        From the run: if the data do not tell the parameters and there is neither a prior nor, where that is
        all that is missing, a convention.

    Notes
    -----
    The answer is attached as a `baselines.TriadFit` or `baselines.ImuFit`, not held inside the box;
    ``solution.x`` is its projection. Each residual vector costs one unit, each Jacobian one per parameter.
    """

    def __init__(
        self, *, frame: str | None = None, steps: int = 30, threshold: float = 1.0, **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self.frame = one_of("frame", frame, FRAMES)
        self.steps = at_least("steps", steps, 1)
        self.threshold = number("threshold", threshold, above=0.0)
        self.estimate: TriadFit | ImuFit | None = None
        self.fitted: Calibrated | None = None

    def propose(self) -> np.ndarray:
        """Projection of the answer into the box, shape (1, n_var)."""
        problem = self.problem
        x = problem.nominal
        held = _held(problem.parameter_names) if self.frame is not None else []
        free = np.array([k for k, name in enumerate(problem.parameter_names) if name not in held])
        if not self._affords(1 + problem.n_var):
            return x[None]
        residuals, jacobian = self._residuals(x), self._jacobian(x)
        if not np.isfinite(jacobian).all():
            raise UnsuitableProblem(
                f"norm-ls cannot start: {problem.invalid_reasons(x[None])[0]} (the preset)"
            )
        if problem.prior() is None:
            seen = assess(problem, jacobian, columns=free, threshold=self.threshold)
            if not seen.complete:
                raise UnsuitableProblem(self._refusal(seen))
        x, residuals, jacobian = self._descend(x, residuals, jacobian, free)
        stacked, slopes = self._with_prior(x, residuals, jacobian)
        # scale by the diagonal first: scale factors and biases are sixteen orders of magnitude apart
        information = slopes[:, free].T @ slopes[:, free]
        size = 1.0 / np.sqrt(np.diag(information))
        covariance = np.linalg.inv(information * np.outer(size, size)) * np.outer(size, size)
        freedom = len(stacked) - len(free)
        misfit = float(np.sqrt(stacked @ stacked / freedom)) if freedom > 0 else float("nan")
        names = tuple(problem.parameter_names[k] for k in free)
        self.estimate = self._answer(x, free, names, covariance, misfit)
        self.fitted = Calibrated.of(self.estimate)
        return problem.project(self.estimate)[None]

    # -- the descent ---------------------------------------------------------------------------------
    def _descend(
        self, x: Array, residuals: Array, jacobian: Array, free: Array
    ) -> tuple[Array, Array, Array]:
        """Point, residuals and slopes where the steps settle, fail or run out of budget."""
        damping = 0.0
        settle = SETTLED + EXHAUSTED * float(np.linalg.norm(residuals))
        for _ in range(self.steps):
            r, j = self._with_prior(x, residuals, jacobian)
            j = j[:, free]
            size = 1.0 / np.sqrt(np.sum(j**2, axis=0))
            scaled = j * size
            stacked = np.concatenate([scaled, np.sqrt(damping) * np.eye(len(free))])
            target = np.concatenate([r, np.zeros(len(free))])
            step = np.linalg.lstsq(stacked, -target, rcond=None)[0]
            # one unit is left for the loss of the answer, and slopes are needed at a new point
            if not self._affords(1 + self.problem.n_var):
                break
            trial = x.copy()
            trial[free] += size * step
            candidate = self._residuals(trial)
            new = self._with_prior(trial, candidate, jacobian)[0]
            settled = float(np.linalg.norm(scaled @ step)) < settle
            if np.isfinite(new).all() and new @ new <= r @ r * (1.0 + 1e-12) + 1e-18:
                x, residuals, damping = trial, candidate, 0.1 * damping if damping > 1e-9 else 0.0
                if settled:
                    break
                jacobian = self._jacobian(x)
            elif settled or damping > 1e8:
                break
            else:
                damping = max(10.0 * damping, 1e-4)
        return x, residuals, jacobian

    def _with_prior(self, x: Array, residuals: Array, jacobian: Array) -> tuple[Array, Array]:
        """Residuals and slopes with the whitened differences to the prior below them."""
        known = self.problem.prior()
        if known is None:
            return residuals, jacobian
        size = np.sqrt(np.diag(known[1]))
        whitening = np.linalg.inv(np.linalg.cholesky(known[1] / np.outer(size, size))) / size
        return np.concatenate([residuals, whitening @ (x - known[0])]), np.concatenate([jacobian, whitening])

    def _affords(self, cost: int) -> bool:
        return bool(self.evaluator.remaining >= cost + 1)

    def _residuals(self, x: Array) -> Array:
        self.evaluator.charge(1, unit="residuals")
        return self.problem.residuals(x)

    def _jacobian(self, x: Array) -> Array:
        self.evaluator.charge(1, unit="jacobians")
        return self.problem.jacobian(x)

    # -- what to say ---------------------------------------------------------------------------------
    def _refusal(self, seen: Identifiability) -> str:
        missing = seen.n_parameters - seen.rank
        shown = "; ".join(direction.words for direction in seen.null_directions[:3])
        more = f"; and {missing - 3} more" if missing > 3 else ""
        turned = all("rotation of the" in direction.words for direction in seen.null_directions)
        if turned:
            remedy = (
                'estimate the parameters of estimated="frame" only, give a prior, or fix the frame by '
                'convention: NormLeastSquares(frame="lower-triangular"), "symmetric" or "preset"'
            )
        else:
            remedy = (
                "add positions in other attitudes, nine or more and not about one axis, average longer, "
                "estimate fewer parameters, or give a prior"
            )
        return (
            f"norm-ls cannot tell {missing} of {seen.n_parameters} parameters from these positions and this "
            f"noise: {shown}{more}. Remedy: {remedy}"
        )

    def _answer(
        self, x: Array, free: Array, names: tuple[str, ...], covariance: Array, misfit: float
    ) -> TriadFit | ImuFit:
        problem = self.problem
        found = problem.estimate(x)
        if self.frame in ("lower-triangular", "symmetric"):
            # parameters of the turned axes are functions of those estimated; differences are exact enough
            step = 0.01 * (problem.xu - problem.xl)[free]
            slopes = np.empty((len(found.vector), len(free)))
            for k, place in enumerate(free):
                shift = np.zeros(problem.n_var)
                shift[place] = step[k]
                ends = [
                    problem.estimate(x + sign * shift).in_frame(self.frame).vector for sign in (1.0, -1.0)
                ]
                slopes[:, k] = (ends[0] - ends[1]) / (2.0 * step[k])
            covariance = slopes @ covariance @ slopes.T
            names = ALL_NAMES if isinstance(found, ImuCalibration) else PARAMETER_NAMES
            found = found.in_frame(self.frame)
        return _with_covariance(found, names, covariance, misfit)


def _held(names: tuple[str, ...]) -> list[str]:
    """Elements that fix the frame, among the parameters of a problem."""
    forces = [ACCELEROMETER + name for name in UPPER if ACCELEROMETER + name in names]
    gyros = [name for name in UPPER if name in names]
    return forces or ([] if any(name.startswith(ACCELEROMETER) for name in names) else gyros)


def _with_covariance(
    found: GyroTriad | ImuCalibration, names: tuple[str, ...], covariance: Array, misfit: float
) -> TriadFit | ImuFit:
    if isinstance(found, ImuCalibration):
        return ImuFit(found.gyro_vector, found.accelerometer_vector, names, covariance, misfit)
    return TriadFit(found.scale, found.misalignment, found.bias, names, covariance, misfit)
