"""Initial alignment of a strapdown system at rest by a Kalman filter whose Q is tuned (paper 000)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.alignment_sensors import ImuGrade
from navopt.models.enu_attitude import attitude_angles, corrected_attitude
from navopt.models.static_alignment import StaticSite
from navopt.problems.alignment_form import SourceForm
from navopt.problems.alignment_scenario import AlignmentScenario
from navopt.problems.alignment_worlds import AlignmentRun, recorded_run, simulated_run
from navopt.problems.noise_tuning import NoiseTruth, NoiseTuning
from navopt.registry import problem

__all__ = ["FORMS", "AlignedAttitude", "StaticAlignment"]

#: How a decision vector becomes Q.
FORMS = ("scale", "scales", "raw", "raw-scale")
#: Indices of phi_E, phi_N, phi_U among the states.
ANGLES = slice(2, 5)


@dataclass(frozen=True)
class AlignedAttitude:
    """What an alignment ends with.

    Attributes
    ----------
    misalignment : ndarray, shape (3,)
        Estimated phi about east, north, up, rad.
    covariance : ndarray, shape (3, 3)
        Its covariance, as the filter calculates it.
    attitude : ndarray, shape (3, 3)
        C_b^n, the computed one with the misalignment taken out.
    pitch, roll, yaw : float
        Its angles, rad; yaw is the heading clockwise from north.
    """

    misalignment: np.ndarray
    covariance: np.ndarray
    attitude: np.ndarray
    pitch: float
    roll: float
    yaw: float


@problem(
    "static-alignment",
    summary="find the process noise with which a Kalman filter aligns an inertial system at rest",
    example={"duration_s": 2.0, "step_s": 0.02},
)
class StaticAlignment(NoiseTuning):
    """Find Q of the ten-state filter that aligns a system at rest, eqs (26)-(39) of paper 000.

    The system navigates freely from its coarse alignment; the velocities that it computes are errors, and the
    filter estimates from them by which angles its frame is off (`navopt.models.static_alignment`). R, the
    covariance of the velocities, is known.

    Parameters
    ----------
    run : AlignmentRun
        What the alignment leaves to the filter.
    form : {"scales", "scale", "raw", "raw-scale"}
        ``"scales"``: common logarithms of five factors, one for the noise on each of the first five states,
        by which what it adds in a step differs from the data sheet. ``"scale"``: of one factor for all. As
        published, ``"raw"``: the five diagonal entries of Q themselves, in (m/s)^2 and rad^2, and
        ``"raw-scale"``: one number on the whole diagonal. A fly's ``S = 1 / Dist`` is such a number.
    objective : {"innovations", "oracle"}
        See `NoiseTuning`. The oracle is the trace of eq. (36) over the run, or its normalised variant.
    normalised : bool, default True
        Whether the oracle and the score `state_rmse_1` divide each error by its 1 sigma at the start, so that
        metres per second do not outweigh radians. False is eq. (36) as printed.
    box : (float, float) or array_like of shape (n_var, 2), optional
        Bounds; -4 to 4 for logarithms, and -5 to 5, as the paper's particles have it, for raw entries.
    nominal : float, optional
        Value of all parameters before anything is known: 0, the data sheet, or 1 if raw.
    update : str
        See `NoiseTuning`.

    Attributes
    ----------
    run : AlignmentRun
        As given.

    Raises
    ------
    InvalidInput
        If an argument cannot be used, or ``objective="oracle"`` and the run is a recording.

    Notes
    -----
    Raw entries of zero or less are candidates that cannot be evaluated. Paper 000's eq. (39) stores Dist
    where (9) and (37) use its reciprocal; what is evaluated is what is meant here.
    """

    def __init__(
        self,
        run: AlignmentRun,
        *,
        form: str = "scales",
        objective: str = "innovations",
        normalised: bool = True,
        box: Any = None,
        nominal: float | None = None,
        update: str = "auto",
    ) -> None:
        if not isinstance(run, AlignmentRun):
            raise InvalidInput(
                "run", type(run).__name__, "give an AlignmentRun, or use StaticAlignment.from_recording"
            )
        if form not in FORMS:
            raise UnknownName("form", form, FORMS)
        if not isinstance(normalised, bool | np.bool_):
            raise InvalidInput("normalised", normalised, "give True or False")
        raw = form.startswith("raw")
        self.run, self.form, self.normalised = run, form, bool(normalised)
        truth = None
        if run.states is not None:
            truth = NoiseTruth(run.states, run.true_Q, None if run.true_Q is None else run.R)
        if box is None:
            box = (-5.0, 5.0) if raw else (-4.0, 4.0)
        super().__init__(
            run.steps.transition,
            run.steps.measurement,
            run.velocity,
            G=run.steps.noise_input,
            x0=run.x0,
            P0=run.P0,
            covariance="diagonal" if form == "raw" else "scalar",
            measurement_covariance="fixed",
            Q_reference=np.eye(5) if raw else run.Q,
            R_reference=run.R,
            objective=objective,
            truth=truth,
            state_scale=np.sqrt(np.diag(run.P0)) if normalised else None,
            encoding="raw" if raw else "log10",
            box=box,
            nominal=nominal,
            update=update,
        )

    def _make_parameters(self, box: Any, nominal: float | None) -> list[Any]:
        if self.form == "scales":
            grade = self.run.grade
            variances = np.array([grade.accelerometer_noise**2] * 2 + [grade.gyro_noise**2] * 3)
            if not (variances > 0.0).all():
                raise InvalidInput("grade", grade, 'a noise of zero has no scale: form="scale" or "raw"')
            self.Q_form = SourceForm.of(variances[:, None, None] * self.run.steps.sources)
        return super()._make_parameters(box, nominal)

    def _true_vector(self) -> np.ndarray | None:
        """As the base has it, but each entry against its variances: entries that cancel are rounding."""
        x = self.project(self.truth)
        size = np.sqrt(np.diag(self.truth.Q))
        gap = np.abs(self.covariances(x[None])[0][0] - self.truth.Q) / np.outer(size, size)
        if not gap.max() < 1e-9:
            return None
        x.setflags(write=False)
        return x

    # -- the answer ----------------------------------------------------------------------------------------
    def align(self, estimate: Any) -> AlignedAttitude:
        """Run the filter with some covariances and correct the attitude by what it finds.

        Parameters
        ----------
        estimate : NoiseEstimate
            From `estimate`, or any object with Q and R, constant or per step.

        Returns
        -------
        AlignedAttitude
            At the last measurement.

        Raises
        ------
        InvalidInput
            If the filter fails with these covariances; says why.
        """
        Q, R = (np.asarray(part, dtype=float)[None] for part in (estimate.Q, estimate.R))
        run = self.filter.run(Q, R)
        if run.failed[0] is not None:
            raise InvalidInput("estimate", run.failed[0], "give covariances with which the filter works")
        phi = run.estimates[0, -1, ANGLES].copy()
        attitude = corrected_attitude(self.run.computed, phi)
        pitch, roll, yaw = (float(angle) for angle in attitude_angles(attitude))
        return AlignedAttitude(phi, run.covariances[0, -1, ANGLES, ANGLES].copy(), attitude, pitch, roll, yaw)

    def _score(self, estimate: Any) -> dict[str, float]:
        scores = super()._score(estimate)
        names = ("pitch", "roll", "yaw")
        keys = [
            *(f"{name}_error_rad" for name in names),
            "mean_angle_error_rad",
            "angle_nees_1",
            "yaw_nees_1",
        ]
        try:
            found = self.align(estimate)
        except InvalidInput:
            return scores | dict.fromkeys(keys, np.inf)
        true = attitude_angles(self.run.attitude)  # type: ignore[arg-type]
        gaps = np.array([getattr(found, name) for name in names]) - np.array(true)
        errors = np.abs((gaps + np.pi) % (2.0 * np.pi) - np.pi)
        off = found.misalignment - self.truth.states[-1, ANGLES]
        nees = float(off @ np.linalg.solve(found.covariance, off)) / 3.0
        values = [*errors.tolist(), float(errors.mean()), nees, float(off[2] ** 2 / found.covariance[2, 2])]
        return scores | dict(zip(keys, values, strict=True))

    # -- from recordings -------------------------------------------------------------------------------------
    @classmethod
    def from_recording(
        cls,
        gyro: Any,
        accelerometer: Any,
        step: float,
        site: StaticSite,
        grade: ImuGrade,
        *,
        coarse_s: float,
        clock_s: float = 1.0,
        velocity_sigma: float = 0.01,
        azimuth_sigma: float | None = None,
        heading: float | None = None,
        restarts: int = 2,
        **options: Any,
    ) -> StaticAlignment:
        """Make a problem from the readings of a system at rest.

        Parameters
        ----------
        gyro, accelerometer, step, site, grade, coarse_s, clock_s, velocity_sigma, azimuth_sigma, heading, \
restarts
            See `navopt.problems.alignment_worlds.recorded_run`.
        **options
            Other keywords of the class.

        Returns
        -------
        StaticAlignment
            Without a truth. ``problem.align(problem.estimate(x))`` is the attitude at the end.
        """
        run = recorded_run(
            gyro, accelerometer, step, site, grade, coarse_s=coarse_s, clock_s=clock_s,
            velocity_sigma=velocity_sigma, azimuth_sigma=azimuth_sigma, heading=heading, restarts=restarts,
        )  # fmt: skip
        return cls(run, **options)

    # -- worlds ------------------------------------------------------------------------------------------
    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        setting: str = "simulation",
        duration_s: float | None = None,
        step_s: float = 0.01,
        latitude_deg: float | None = None,
        height_m: float | None = None,
        gravity: float | str | None = None,
        imu: str | dict[str, float] | None = None,
        angle_sigma_deg: tuple[float, float, float] | None = None,
        errors: str = "drawn",
        pitch_deg: float = 0.0,
        roll_deg: float = 0.0,
        yaw_deg: float = 0.0,
        velocity_sigma: float = 0.01,
        spread_decades: float = 0.5,
        data: str = "model",
        form: str = "scales",
        objective: str = "innovations",
        normalised: bool = True,
        box: Any = None,
        update: str = "auto",
        noise_seed: int | None = None,
    ) -> StaticAlignment:
        """Draw one alignment.

        Parameters
        ----------
        seed : int
            Seed of everything drawn.
        setting : {"simulation", "experiment"}
            Which keywords that are not given come from Table 2 of paper 000 (5 s at 40 degrees, navigation
            grade), or from Table 4 (50 s at 39.84 degrees, a low-cost module).
        duration_s, step_s : float
            Length of the alignment, and time between two velocities.
        latitude_deg, height_m : float
            Where the system stands.
        gravity : float or "published", optional
            In m/s^2. Normal gravity at the latitude if not given; the paper uses that of the equator.
        imu : {"navigation", "low-cost"} or dict
            See `navopt.models.alignment_sensors.ImuGrade`; a dict holds its data sheet: ``gyro_bias_dph,
            arw_deg_rth, accel_bias_ug, vrw_ug_rthz``.
        angle_sigma_deg : (float, float, float)
            1 sigma of the initial errors of attitude about east, north, up.
        errors : {"drawn", "published"}
            Initial errors and biases drawn for each world; or every one at plus one sigma.
        pitch_deg, roll_deg, yaw_deg : float
            The true attitude.
        velocity_sigma : float
            1 sigma of the measured velocities, and of their errors at the start, m/s.
        spread_decades : float
            By how many powers of ten, at most, the variances of the noise of the accelerometers and of
            the gyros differ from the data sheet, drawn evenly; both by the same with ``form="scale"``.
        data : {"model", "sensors"}
            Errors drawn from the linear model; or readings of the sensors, integrated by the strapdown
            algorithm of python-ins, whose errors the model only approximates.
        form, objective, normalised, box, update
            As for the class.
        noise_seed : int, optional
            Another draw of all noise of the same world.

        Returns
        -------
        StaticAlignment
        """
        scenario = {name: v for name, v in locals().items() if name not in ("cls", "seed", "noise_seed")}
        again = {"seed": seed, **scenario}
        options = {name: scenario.pop(name) for name in ("form", "objective", "normalised", "box", "update")}
        same = form in ("scale", "raw-scale")
        world = cls(
            simulated_run(AlignmentScenario(**scenario, same_spread=same), seed, noise_seed), **options
        )
        object.__setattr__(world, "_world", again)
        return world
