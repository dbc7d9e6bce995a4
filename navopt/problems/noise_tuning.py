"""Tuning a Kalman filter: which Q and R make it the best filter for given data."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from navopt.errors import InvalidInput, NoBound, UnknownName
from navopt.models.linear_gaussian import LinearGaussianModel
from navopt.problem import EstimationProblem, Parameter
from navopt.problems.noise_estimate import NoiseEstimate, NoiseTruth, checked_truth
from navopt.problems.noise_parameters import CovarianceForm
from navopt.registry import problem

__all__ = ["ENCODINGS", "OBJECTIVES", "NoiseEstimate", "NoiseTruth", "NoiseTuning"]

OBJECTIVES = ("innovations", "oracle")
ENCODINGS = ("log10", "raw")
#: Box of the parameters if none is given: common logarithms of scales, or the scales themselves.
BOXES = {"log10": (-6.0, 4.0), "raw": (-5.0, 5.0)}


@problem(
    "noise-tuning",
    summary="find the noise covariances Q and R of a Kalman filter from its data",
    example={"steps": 120},
)
class NoiseTuning(EstimationProblem):
    """Find the noise covariances of a linear Kalman filter.

    The decision vector holds common logarithms of variances, relative to `Q_reference` and `R_reference`
    (identities if not given, so that they are variances). Two objectives can be minimised.
    ``"innovations"``: the negative log-likelihood of the measurements per scalar measurement, which can be
    had wherever a filter runs. ``"oracle"``: the mean square error of the filtered states against the true
    ones, as Wan et al. 2020 (eq. 36) and Zhang et al. 2016 (eq. 14) minimise; it needs the truth, and it
    tells Q and R only up to a common factor, since the gain depends on nothing else.

    Parameters
    ----------
    F, H : array_like, shapes (n, n) or (T, n, n), (m, n) or (T, m, n)
        Transition and measurement matrices.
    data : array_like, shape (T, m)
        Measurements; NaN where one is missing.
    G, B, u, x0, P0, time : array_like, optional
        See `navopt.models.linear_gaussian.LinearGaussianModel`.
    covariance : {"scalar", "diagonal", "full", "fixed"}
        Form of Q, see `navopt.problems.noise_parameters.CovarianceForm`.
    measurement_covariance : {"scalar", "diagonal", "full", "fixed"}, optional
        Form of R; that of Q if not given.
    Q_reference, R_reference : array_like, shapes (g, g) and (m, m), optional
        What the scales multiply.
    objective : {"innovations", "oracle"}
        See above.
    truth : NoiseTruth, optional
        True states, and covariances where they are known.
    scored_states : sequence of int, optional
        States whose errors count in scores and in the oracle objective; all if not given.
    state_scale : array_like, shape (n,), optional
        What errors of the states are divided by in the oracle objective, so that different units can be
        summed; ones if not given.
    encoding : {"log10", "raw"}
        Raw: the scales themselves are the parameters, as in the papers. A negative one, or an R of zero, is
        a candidate that cannot be evaluated.
    box : (float, float) or array_like of shape (n_var, 2), optional
        Bounds of all scales, or of all parameters; 1e-6 to 1e4, or -5 to 5 if raw.
    nominal : float, optional
        Value of all scales (as encoded) before anything is known; 1 if not given.
    update : {"auto", "sequential", "matrix", "joseph"}
        See `navopt.filters.BatchKalman`.

    Attributes
    ----------
    model : LinearGaussianModel
        Model with its measurements, for methods that do more than minimise.

    Raises
    ------
    InvalidInput
        If the model cannot be used or an argument does not fit it.
    """

    provides = frozenset({"linear-gaussian", "bound"})

    def __init__(
        self,
        F: Any,
        H: Any,
        data: Any,
        *,
        G: Any = None,
        B: Any = None,
        u: Any = None,
        x0: Any = None,
        P0: Any = None,
        time: Any = None,
        covariance: str = "scalar",
        measurement_covariance: str | None = None,
        Q_reference: Any = None,
        R_reference: Any = None,
        objective: str = "innovations",
        truth: NoiseTruth | None = None,
        scored_states: Any = None,
        state_scale: Any = None,
        encoding: str = "log10",
        box: Any = None,
        nominal: float | None = None,
        update: str = "auto",
    ) -> None:
        if objective not in OBJECTIVES:
            raise UnknownName("objective", objective, OBJECTIVES)
        if encoding not in ENCODINGS:
            raise UnknownName("encoding", encoding, ENCODINGS)
        self.model = LinearGaussianModel(F=F, H=H, y=data, G=G, B=B, u=u, x0=x0, P0=P0, time=time)
        model, raw = self.model, encoding == "raw"
        self.objective, self.encoding, self.update = objective, encoding, update
        self.Q_form = CovarianceForm(
            "Q", covariance, np.eye(model.n_noises) if Q_reference is None else Q_reference, raw
        )
        self.R_form = CovarianceForm(
            "R",
            measurement_covariance or covariance,
            np.eye(model.n_measurements) if R_reference is None else R_reference,
            raw,
        )
        for form, size in ((self.Q_form, model.n_noises), (self.R_form, model.n_measurements)):
            if form.size != size:
                raise InvalidInput(f"{form.name}_reference", form.reference.shape, f"give ({size}, {size})")
        super().__init__(self._make_parameters(box, nominal))
        self.scored_states = self._checked_states(scored_states)
        self.state_scale = self._checked_scale(state_scale)
        if truth is not None:
            self.truth = checked_truth(truth, self.model)
            if self.truth.Q is not None and self.truth.Q.ndim == self.truth.R.ndim == 2:
                self.true_x = self._true_vector()
        elif objective == "oracle":
            raise InvalidInput("truth", None, 'objective="oracle" needs the true states: give NoiseTruth')
        from navopt.filters.batch_kalman import BatchKalman

        self.filter = BatchKalman(model, update=update)
        self._measurements = int(np.isfinite(model.y).sum())

    @classmethod
    def from_filterpy(cls, kalman: Any, data: Any, *, us: Any = None, G: Any = None, **options: Any) -> Self:
        """Tune a `filterpy.kalman.KalmanFilter`: its matrices and initial state, and `data`.

        Parameters
        ----------
        kalman, data, us, G
            See `navopt.models.linear_gaussian.LinearGaussianModel.from_filterpy`.
        **options
            Other keywords of the class.

        Returns
        -------
        NoiseTuning
            `estimate` of its solution holds the Q and R to be set in the filter.
        """
        model = LinearGaussianModel.from_filterpy(kalman, data, us=us, G=G)
        return cls(
            model.F, model.H, model.y, G=model.G, B=model.B, u=model.u, x0=model.x0, P0=model.P0, **options
        )

    # -- checks ----------------------------------------------------------------------------------------
    def _make_parameters(self, box: Any, nominal: float | None) -> list[Parameter]:
        limits = np.array(BOXES[self.encoding] if box is None else box, dtype=float)
        number = self.Q_form.n_parameters + self.R_form.n_parameters
        if not number:
            raise InvalidInput("covariance", "fixed", "leave something of Q or R to be found")
        start = (0.0 if self.encoding == "log10" else 1.0) if nominal is None else float(nominal)
        if limits.shape not in ((2,), (number, 2)) or not np.isfinite(limits).all():
            raise InvalidInput("box", limits.tolist(), f"give finite (lower, upper), or {number} such pairs")
        low, high = (limits if limits.ndim == 1 else limits[0]).tolist()
        parameters = self.Q_form.parameters(low, high, start) + self.R_form.parameters(low, high, start)
        if limits.ndim == 1:
            return parameters
        return [
            Parameter(p.name, p.unit, low, high, float(np.clip(p.nominal, low, high)))
            for p, (low, high) in zip(parameters, limits.tolist(), strict=True)
        ]

    def _checked_states(self, states: Any) -> tuple[int, ...]:
        n = self.model.n_states
        chosen = tuple(range(n)) if states is None else tuple(int(k) for k in states)
        if not chosen or len(set(chosen)) < len(chosen) or not all(0 <= k < n for k in chosen):
            raise InvalidInput("scored_states", states, f"give different numbers from 0 to {n - 1}")
        return chosen

    def _checked_scale(self, scale: Any) -> np.ndarray:
        n = self.model.n_states
        values = np.ones(n) if scale is None else np.array(scale, dtype=float)
        if values.shape != (n,) or not (np.isfinite(values) & (values > 0.0)).all():
            raise InvalidInput("state_scale", values.tolist(), f"give {n} positive numbers")
        values.setflags(write=False)
        return values

    def _true_vector(self) -> np.ndarray | None:
        """Decision vector of the true covariances, if the parameters can express them inside the box."""
        x = self.project(self.truth)
        Q, R = self.covariances(x[None])
        close = np.allclose(Q[0], self.truth.Q, rtol=1e-9, atol=0.0)
        if not (close and np.allclose(R[0], self.truth.R, rtol=1e-9, atol=0.0)):
            return None
        x.setflags(write=False)
        return x

    # -- from decision vectors to covariances and back ----------------------------------------------------
    def covariances(self, X: Any) -> tuple[np.ndarray, np.ndarray]:
        """Noise covariances of decision vectors.

        Parameters
        ----------
        X : array_like, shape (K, n_var)
            Decision vectors.

        Returns
        -------
        tuple of ndarray, shapes (K, g, g) and (K, m, m)
        """
        X = np.atleast_2d(np.asarray(X, dtype=float))
        cut = self.Q_form.n_parameters
        return self.Q_form.matrices(X[:, :cut]), self.R_form.matrices(X[:, cut:])

    def estimate(self, x: np.ndarray) -> NoiseEstimate:
        """Covariances of one decision vector."""
        Q, R = self.covariances(x)
        return NoiseEstimate(Q[0], R[0])

    def project(self, estimate: Any) -> np.ndarray:
        """Nearest decision vector; of covariances per step, that of their geometric mean over time."""
        pieces = []
        for form, matrix in ((self.Q_form, estimate.Q), (self.R_form, estimate.R)):
            if matrix is None:
                raise InvalidInput("estimate", f"{form.name} is None", "give an estimate with Q and R")
            each = np.atleast_3d(matrix) if np.ndim(matrix) == 3 else np.asarray(matrix)[None]
            pieces.append(np.mean([form.vector(one) for one in each], axis=0))
        x = np.concatenate(pieces)
        return self.clip(np.where(np.isfinite(x), x, self.nominal))

    # -- the objective -----------------------------------------------------------------------------------
    def _loss(self, X: np.ndarray) -> np.ndarray:
        Q, R = self.covariances(X)
        if self.objective == "innovations":
            return -self.filter.log_likelihood(Q, R) / self._measurements
        squares = self.filter.mean_square_error(Q, R, self.truth.states)
        total = np.zeros(len(X))
        for k in self.scored_states:
            total = total + squares[:, k] / self.state_scale[k] ** 2
        return total

    def gradient(self, X: np.ndarray) -> np.ndarray:
        """Exact derivative of the innovations objective, shape (..., n_var) -> (..., n_var).

        Raises
        ------
        InvalidInput
            If the objective is another one.
        """
        if self.objective != "innovations":
            raise InvalidInput("objective", self.objective, "there is a gradient of 'innovations' only")
        flat, shape = self._rows(X)
        by = self.filter.gradient(*self.covariances(flat))
        out = np.empty_like(flat)
        for k, x in enumerate(flat):
            dQ, dR = self.directions(x)
            out[k] = np.einsum("aij,ij->a", dQ, by.by_Q[k]) + np.einsum("aij,ij->a", dR, by.by_R[k])
        return (-out / self._measurements).reshape(*shape, self.n_var)

    def directions(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of Q and R by the parameters at x, shapes (n_var, g, g) and (n_var, m, m)."""
        cut = self.Q_form.n_parameters
        g, m = self.Q_form.size, self.R_form.size
        dQ, dR = np.zeros((self.n_var, g, g)), np.zeros((self.n_var, m, m))
        dQ[:cut], dR[cut:] = self.Q_form.directions(x[:cut]), self.R_form.directions(x[cut:])
        return dQ, dR

    def invalid_reasons(self, X: np.ndarray) -> list[str]:
        """Say which covariance is impossible, or that the filter diverges, and where."""
        reasons = self.filter.reasons(*self.covariances(X))
        return [reason or "the filter could not evaluate the candidate" for reason in reasons]

    # -- what the data can tell ----------------------------------------------------------------------------
    def error_bound(self, x: np.ndarray | None = None) -> np.ndarray:
        """Cramér-Rao bound of the parameters, from the expected information of a record of this length."""
        if x is None:
            if self.true_x is None:
                raise NoBound("error_bound needs x where no decision vector made the data")
            x = self.true_x
        from navopt.filters.information import fisher_information

        x = np.asarray(x, dtype=float)
        Q, R = self.covariances(x)
        dQ, dR = self.directions(x)
        information = fisher_information(self.model, Q[0], R[0], directions_Q=dQ, directions_R=dR)
        width = self.xu - self.xl
        scaled = information * np.outer(width, width)
        if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > 1e14:
            raise NoBound("the information matrix is singular here: not every parameter is identifiable")
        return np.linalg.inv(scaled) * np.outer(width, width)

    def sensitivity(self, x: np.ndarray) -> np.ndarray:
        """What the objective sees of the parameters, see `navopt.problems.noise_sensitivity`.

        Parameters
        ----------
        x : array_like, shape (n_var,)

        Returns
        -------
        ndarray, shape (m, n_var)
            Its Gram matrix is the information: that of the innovations, or of errors against the truth.
        """
        from navopt.problems.noise_sensitivity import error_sensitivity, likelihood_sensitivity

        x = self._rows(x)[0][0]
        return (
            likelihood_sensitivity(self, x) if self.objective == "innovations" else error_sensitivity(self, x)
        )

    def describe_direction(self, coefficients: dict[str, float]) -> str:
        """Say whether a combination is the common scale of Q and R, or shifts noise between them."""
        from navopt.problems.noise_sensitivity import noise_words

        return noise_words(self, coefficients)

    def _score(self, estimate: Any) -> dict[str, float]:
        from navopt.problems.noise_scores import score_covariances

        return score_covariances(self, estimate)

    # -- worlds ------------------------------------------------------------------------------------------
    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        steps: int = 1000,
        interval_s: float = 0.1,
        axes: int = 1,
        process_variance: float = 1.0,
        measurement_variance: float = 0.25,
        spread_decades: float = 0.0,
        initial_sigma: tuple[float, float] = (0.5, 0.5),
        missing_fraction: float = 0.0,
        measurement_step: float = 1.0,
        covariance: str = "scalar",
        objective: str = "innovations",
        encoding: str = "log10",
        box: Any = None,
        update: str = "auto",
        noise_seed: int | None = None,
    ) -> NoiseTuning:
        """Draw one world: a vehicle moving along each axis under random accelerations, its position measured.

        Parameters
        ----------
        seed : int
            Seed of everything drawn.
        steps : int
            Number of measurements.
        interval_s : float
            Time step.
        axes : int
            Number of axes; each has a position and a velocity, independent of the others.
        process_variance : float
            Variance of the acceleration, constant over a step, (m/s²)².
        measurement_variance : float
            Variance of the measured position, m².
        spread_decades : float
            Both variances are multiplied by 10 to a power drawn evenly between plus and minus this, for
            each axis if the covariance is not scalar.
        initial_sigma : (float, float)
            1σ of the initial position and velocity, m and m/s; the filter knows it.
        missing_fraction : float
            Share of measurements that are missing, at random.
        measurement_step : float
            Factor by which R rises in the middle of the record.
        covariance, objective, encoding, box, update
            As for the class.
        noise_seed : int, optional
            Another draw of states and noise of the same world.

        Returns
        -------
        NoiseTuning
        """
        scenario = {name: v for name, v in locals().items() if name not in ("cls", "seed", "noise_seed")}
        from navopt.problems.noise_worlds import moving_vehicle

        world = moving_vehicle(cls, seed, noise_seed, **scenario)
        object.__setattr__(world, "_world", {"seed": seed, **scenario})
        return world
