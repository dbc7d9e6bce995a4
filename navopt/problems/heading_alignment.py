"""Alignment of a low-cost inertial system with a heading from a laser: which filter, with which settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from navopt.algorithms.options import number, one_of
from navopt.errors import InvalidInput
from navopt.models.azimuth_error import error_rotation
from navopt.models.enu_attitude import attitude_angles
from navopt.models.heading_record import HeadingRecord, record_from_imu
from navopt.problem import EstimationProblem
from navopt.problems.heading_filters import make_filter, prepare
from navopt.problems.heading_scores import score_run, state_errors
from navopt.problems.heading_settings import (
    HeadingSettings,
    HeadingTruth,
    default_tuned,
    make_parameters,
    settings_at,
    vector_of,
)
from navopt.problems.heading_worlds import name_keywords, simulated_world
from navopt.problems.static_alignment import AlignedAttitude
from navopt.registry import problem

__all__ = ["OBJECTIVES", "HeadingAlignment"]

OBJECTIVES = ("innovations", "oracle")
#: Beginnings of the names of parameters that are noises.
NOISES = ("log10_q", "log10_r")
ANGLES = slice(2, 5)


@problem(
    "heading-alignment",
    summary="find the filter settings with which a low-cost inertial system aligns with a measured heading",
    example={"duration_s": 10.0, "rate_hz": 10.0},
)
class HeadingAlignment(EstimationProblem):
    """Find the settings of a filter that aligns a system at rest with a measured heading (paper 002).

    The system runs freely from a start whose azimuth may be wrong by any angle. Its velocities are errors,
    and so is the difference of its heading from the measured one; a filter estimates from them the ten errors
    of `navopt.models.azimuth_error`. What is looked for are the noises that the filter is told, and for a
    strong tracking filter how it forgets.

    Parameters
    ----------
    record : HeadingRecord
        What was computed and measured.
    variant : {"ekf", "ukf", "srukf", "st-ukf", "sst-ukf"}, optional
    formulation : {"direct", "correlated", "paper", "none"}, optional
        See `navopt.problems.heading_settings.HeadingSettings`; replace those of `settings`.
    settings : HeadingSettings, optional
        Everything that is not tuned, and the nominal values of what is.
    tuned : sequence of str, optional
        Parameters, of ``log10_q_accel, log10_q_gyro, log10_r_velocity, log10_r_heading`` (decimal logarithms
        of the variances over the declared ones), ``forgetting, weakening, cap`` and ``log10_spread`` (alpha
        of the sigma points). The noises if not given, and the fading of a strong-tracking filter.
    objective : {"innovations", "oracle"}
        Negative log-likelihood of the innovations per measured number, which can be had everywhere; or the
        mean square error of the three angles, in units of their declared sigma at the start.
    box : mapping of str to (float, float), optional
        Bounds by name of parameter.
    azimuth_within_deg, horizontal_within_deg : float
        Errors below which the scores call an alignment converged.
    truth : HeadingTruth, optional
        Replaces that of the record's own states.

    Attributes
    ----------
    record : HeadingRecord
        As given.
    settings : HeadingSettings
        The nominal filter.

    Raises
    ------
    InvalidInput
        If an argument cannot be used, or ``objective="oracle"`` and there is no truth.

    Notes
    -----
    Where only noises are tuned and the filter has no heading state, the problem offers a linear-Gaussian
    model about what the nominal filter finds, so that estimators of covariances can be asked. What varies
    with time in their answers is replaced by its geometric mean in scores.

    The likelihood is that of the filter, whatever it is: of a strong-tracking filter it includes what fading
    does to the predicted variances. Filters that use different measurements (`formulation` or `velocities`)
    have likelihoods that cannot be compared.
    """

    provides = frozenset({"heading-filter"})

    def __init__(
        self,
        record: HeadingRecord,
        *,
        variant: str | None = None,
        formulation: str | None = None,
        settings: HeadingSettings | None = None,
        tuned: Sequence[str] | None = None,
        objective: str = "innovations",
        box: Mapping[str, tuple[float, float]] | None = None,
        azimuth_within_deg: float = 0.1,
        horizontal_within_deg: float = 0.2,
        truth: HeadingTruth | None = None,
    ) -> None:
        if not isinstance(record, HeadingRecord):
            raise InvalidInput(
                "record", type(record).__name__, "give a HeadingRecord, or use HeadingAlignment.from_arrays"
            )
        one_of("objective", objective, OBJECTIVES)
        base = HeadingSettings() if settings is None else settings
        self.settings = replace(
            base,
            variant=base.variant if variant is None else variant,
            formulation=base.formulation if formulation is None else formulation,
        )
        self.tuned = default_tuned(self.settings) if tuned is None else tuple(tuned)
        super().__init__(make_parameters(self.settings, self.tuned, box))
        self.record, self.objective = record, objective
        self.azimuth_within = np.radians(number("azimuth_within_deg", azimuth_within_deg, above=0.0))
        self.horizontal_within = np.radians(number("horizontal_within_deg", horizontal_within_deg, above=0.0))
        if truth is None and record.states is not None:
            truth = HeadingTruth(record.states[:: record.clock])
        if truth is not None:
            self.truth = truth
            self.true_x = self._true_vector(truth)
        elif objective == "oracle":
            raise InvalidInput("objective", objective, "a recording has no true states: use 'innovations'")
        if not self.settings.has_heading_state and all(n.startswith(NOISES) for n in self.tuned):
            self.provides = self.provides | {"linear-gaussian"}  # type: ignore[misc]
        self._prepared = prepare(record)
        self._inputs: dict[str, Any] = {}
        self._inputs = {self.settings.velocities: self.inputs(self.settings.velocities)}
        # the filters of a comparison all have the declared noises for a candidate: its loss is kept
        self._last: tuple[HeadingSettings, float] | None = None

    def _true_vector(self, truth: HeadingTruth) -> np.ndarray | None:
        """Decision vector of the true noises, if nothing else is tuned and the box holds it."""
        if not all(name.startswith(NOISES) for name in self.tuned):
            return None
        x = vector_of(truth, self.tuned, self.nominal)
        if not ((x >= self.xl) & (x <= self.xu)).all():
            return None
        x.setflags(write=False)
        return x

    # -- the filter ---------------------------------------------------------------------------------------
    def inputs(self, velocities: str = "clock") -> Any:
        """Return what a filter gets.

        Parameters
        ----------
        velocities : {"clock", "all"}
            At which times the velocities are used.

        Returns
        -------
        navopt.filters.HeadingInputs
        """
        ready = self._inputs.get(velocities)
        if ready is not None:
            return ready
        from navopt.filters.heading_filter import HeadingInputs

        record = self.record
        return HeadingInputs(
            record.time - record.time[0], record.measurements(velocities), self._prepared["steps"],
            self._prepared["measured"],
        )  # fmt: skip

    def filter(self, settings: HeadingSettings) -> Any:
        """Return the filter of some settings, ready to be run on the record of this problem.

        Parameters
        ----------
        settings : HeadingSettings
            Any, also of another variant or formulation than the problem's own.

        Returns
        -------
        navopt.filters.HeadingFilter
        """
        return make_filter(self.record, self._prepared, settings)

    def run(self, settings: HeadingSettings, *, covariances: bool = True) -> Any:
        """Run a filter over the record.

        Parameters
        ----------
        settings : HeadingSettings
            From `estimate`, or any.
        covariances : bool
            Whether covariances are kept.

        Returns
        -------
        navopt.filters.HeadingRun
            States at every tick of the measurements' clock.
        """
        from navopt.filters.heading_filter import filter_heading

        return filter_heading(
            self.inputs(settings.velocities), self.filter(settings), thin=self.record.clock,
            covariances=covariances,
        )  # fmt: skip

    def align(self, settings: HeadingSettings) -> AlignedAttitude:
        """Run a filter and correct the attitude by what it finds.

        Parameters
        ----------
        settings : HeadingSettings
            From `estimate`, or any.

        Returns
        -------
        AlignedAttitude
            At the last tick of the measurements' clock. Its misalignment is phi_E, phi_N, phi_U of
            `navopt.models.azimuth_error`, angles of three turns one after the other.

        Raises
        ------
        InvalidInput
            If the filter fails with these settings; says when and why.
        """
        run = self.run(settings)
        if run.failed is not None:
            raise InvalidInput("settings", run.failed, "give settings with which the filter works")
        phi = run.estimates[-1, ANGLES].copy()
        last = (len(run.estimates) - 1) * self.record.clock
        attitude = error_rotation(phi).T @ self.record.attitude[last]
        pitch, roll, yaw = (float(angle) for angle in attitude_angles(attitude))
        return AlignedAttitude(phi, run.covariances[-1, ANGLES, ANGLES].copy(), attitude, pitch, roll, yaw)

    # -- the objective ------------------------------------------------------------------------------------
    def estimate(self, x: np.ndarray) -> HeadingSettings:
        """Settings that a decision vector stands for."""
        return settings_at(self.settings, self.tuned, np.asarray(x, dtype=float))

    def project(self, estimate: Any) -> np.ndarray:
        """Nearest decision vector of settings, covariances or a truth, as far as these say what is tuned."""
        return self.clip(vector_of(self._settings_of(estimate), self.tuned, self.nominal))

    def _settings_of(self, estimate: Any) -> Any:
        """Settings of an estimate that holds Q and R of the linear model; anything else as it is."""
        if not hasattr(estimate, "Q"):
            return estimate
        from navopt.problems.heading_linear import scales_from

        return scales_from(self, estimate)

    # -- as a linear-Gaussian problem ------------------------------------------------------------------------
    @property
    def model(self) -> Any:
        """Linear-Gaussian model about what the nominal filter finds, see `navopt.problems.heading_linear`."""
        from navopt.problems.heading_linear import linearised

        return linearised(self).model

    def covariances(self, X: Any) -> tuple[np.ndarray, np.ndarray]:
        """Noise covariances of decision vectors for that model, shapes (K, 5, 5) and (K, m, m)."""
        X = np.atleast_2d(np.asarray(X, dtype=float))
        m = 2 if self.settings.formulation == "none" else 3
        Q, R = np.empty((len(X), 5, 5)), np.empty((len(X), m, m))
        for k, x in enumerate(X):
            filtered = self.filter(self.estimate(x))
            Q[k], R[k] = filtered.Q[:5, :5], filtered.R[:m, :m]
        return Q, R

    def _loss(self, X: np.ndarray) -> np.ndarray:
        losses = np.empty(len(X))
        for k, x in enumerate(X):
            settings = self.estimate(x)
            if self._last is None or self._last[0] != settings:
                object.__setattr__(self, "_last", (settings, self._loss_of(settings)))
            losses[k] = self._last[1]  # type: ignore[index]
        return losses

    def _loss_of(self, settings: HeadingSettings) -> float:
        run = self.run(settings, covariances=False)
        if run.failed is not None or not np.isfinite(run.log_likelihood):
            return float("inf")
        if self.objective == "innovations":
            count = int(np.isfinite(run.innovations).sum())
            return -run.log_likelihood / count if count else float("inf")
        errors = state_errors(run.estimates, self.truth.states)[1:, ANGLES]
        scaled = errors / np.sqrt(np.diag(self.record.P0)[ANGLES])
        value = float(np.mean(np.sum(scaled**2, axis=1)))
        return value if np.isfinite(value) else float("inf")

    def invalid_reasons(self, X: np.ndarray) -> list[str]:
        """Say at which step a filter failed, and of what."""
        reasons = [self.run(self.estimate(x), covariances=False).failed for x in np.atleast_2d(X)]
        return [reason or "the filter could not evaluate the candidate" for reason in reasons]

    def _score(self, estimate: Any) -> dict[str, float]:
        return score_run(
            self.run(self._settings_of(estimate)), self.truth.states,
            azimuth_within=float(self.azimuth_within), horizontal_within=float(self.horizontal_within),
        )  # fmt: skip

    # -- recordings ---------------------------------------------------------------------------------------
    @classmethod
    def from_arrays(
        cls,
        time: Any,
        gyro: Any,
        accelerometer: Any,
        heading_time: Any,
        heading: Any,
        site: Any,
        grade: Any,
        *,
        heading_sigma: float,
        coarse_s: float = 10.0,
        velocity_sigma: float = 0.1,
        heading_bias_sigma: float = 0.0,
        every: int = 1,
        attitude: Any = None,
        prior_sigma: Any = None,
        **options: Any,
    ) -> HeadingAlignment:
        """Make a problem from the readings of a system at rest and headings from elsewhere.

        Parameters
        ----------
        time, gyro, accelerometer, heading_time, heading, site, grade, heading_sigma, coarse_s,
        velocity_sigma, \
heading_bias_sigma, every, attitude, prior_sigma
            See `navopt.models.heading_record.record_from_imu`.
        **options
            Other keywords of the class.

        Returns
        -------
        HeadingAlignment
            Without a truth. ``problem.align(problem.settings)`` is the attitude at the end with the declared
            noises.
        """
        record = record_from_imu(
            time, gyro, accelerometer, heading_time, heading, site, grade, heading_sigma=heading_sigma,
            coarse_s=coarse_s, velocity_sigma=velocity_sigma, heading_bias_sigma=heading_bias_sigma,
            every=every, attitude=attitude, prior_sigma=prior_sigma,
        )  # fmt: skip
        return cls(record, **options)

    # -- worlds -------------------------------------------------------------------------------------------
    @classmethod
    def simulate(cls, seed: int = 0, **scenario: Any) -> HeadingAlignment:
        """Draw one world.

        Parameters
        ----------
        seed : int
            Seed of everything drawn.
        **scenario
            Fields of `navopt.models.heading_alignment.HeadingScenario`; `variant`, `formulation`, `settings`,
            `tuned`, `objective`, `box`, `azimuth_within_deg` and `horizontal_within_deg` of the class; and
            `noise_seed`, for another draw of all noise of the same world; and `redraws`, what `redraw` draws
            anew, ``"noise"`` or the whole ``"world"`` with its biases and start. A `rate_hz` below that of
            the sensors thins the filter's steps: integration is still at the full rate.

        Returns
        -------
        HeadingAlignment
        """
        return simulated_world(cls, seed, scenario)

    def redraw(self, seed: int) -> EstimationProblem:
        """Return the same system with the same biases and start and other noise, or another one.

        The keyword `redraws` of `simulate` says which.
        """
        if self._world is not None and self._world.get("redraws") == "world":
            return type(self).simulate(**{**self._world, "seed": seed})
        return super().redraw(seed)


name_keywords(HeadingAlignment)
