"""Calibrating gyros by the norm of the Earth rate, or on a turntable (paper 004)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import normal_gravity
from navopt.models.imu_calibration import ImuCalibration
from navopt.models.positions import check_attitudes
from navopt.models.sensor_noise import AccelerometerNoise, GyroNoise
from navopt.models.triad import DEGREE_PER_HOUR, AccelerometerTriad, GyroTriad
from navopt.problem import EstimationProblem, Parameter
from navopt.problems.gyro_checks import check_noise, check_norms, check_record
from navopt.problems.gyro_losses import InvariantMisfit, Misfit, NormMisfit, TurntableMisfit
from navopt.problems.gyro_parameters import ACCELEROMETER, UNITS, chosen, groups_of, make_box, make_prior
from navopt.problems.gyro_record import read_accelerometers, read_turntable
from navopt.problems.gyro_scores import direction_words, imu_scores, triad_scores
from navopt.registry import problem

__all__ = ["GyroCalibration"]

LOSSES = ("indicator", "corrected", "turntable", "invariants")
UNIT_GYROS = GyroTriad(np.ones(3), np.eye(3), np.zeros(3))
UNIT_ACCELEROMETERS = AccelerometerTriad(np.ones(3), np.eye(3), np.zeros(3))


@problem(
    "gyro-calibration",
    summary="find scale factors, misalignments and biases of three gyros from stationary positions",
    example={"estimated": "frame", "positions": 24},
)
class GyroCalibration(EstimationProblem):
    """Find what is wrong with three gyros from their output at rest in several positions.

    Paper 004: whatever the attitude, the norm of the true rate is the Earth rate; parameters are good that
    bring the norms of the calibrated rates to it, eq. (14). Attitudes need not be known. A turntable record,
    in which the rates are known, may come with it for methods that use one.

    Parameters
    ----------
    counts : array_like, shape (m, 3)
        Averaged output of the gyros at m positions in the field.
    attitudes : array_like, shape (m, 3, 3), optional
        Where they were, from (east, north, up) to body axes, if known; no loss uses it.
    latitude : float
        rad; with the angle between Earth rate and gravity the accelerometers' loss needs it.
    noise : GyroNoise
        Of the gyros.
    averaging_time_s : float
        Time averaged at each position.
    fixed : GyroTriad, optional
        The preset: values of the parameters that are not estimated, nominal values and centre of the box of
        the others. If not given, counts are taken for rad/s.
    estimated : str or sequence of str, optional
        What is sought: names of parameters, ``"scale"``, ``"bias"``, ``"misalignment"``, ``"all"``, or
        ``"frame"``, which is all but the upper triangle of the misalignment matrix: in body axes that lie
        along the sensors, see `navopt.models.SensorTriad.in_frame`. With ``loss="invariants"`` these words
        mean gyros and accelerometers (the frame being the accelerometers'), and ``"gyro"`` and
        ``"accelerometer"`` one of them. If not given, ``"frame"``, or ``"all"`` with ``loss="turntable"``: a
        table has axes of its own.
    loss : {"indicator", "corrected", "turntable", "invariants"}
        The paper's indicator, eq. (14); the same without the bias of noisy norms; the misfit of the turntable
        record; or norms of rate and force with the angle between them. See Notes.
    prior : mapping of str to float or array_like, shape (n_var, n_var), optional
        1σ of each estimated parameter about its preset, by name or by ``"scale"``, ``"bias"``,
        ``"misalignment"`` (in counts per rad/s, rad/s and rad); or the covariance.
    accelerometer_counts : array_like, shape (m, 3), optional
        Averaged output of the accelerometers at the same positions.
    accelerometer_noise : AccelerometerNoise, optional
        Of the accelerometers.
    fixed_accelerometer : AccelerometerTriad, optional
        Their preset; counts are taken for m/s² if not given.
    turntable_counts, turntable_rates : array_like, shape (k, 3), optional
        A record with known rates, rad/s in body axes.
    turntable_averaging_s : float, optional
        Time averaged at each of its positions; `averaging_time_s` if not given.
    reach_scale_ppm, reach_bias_deg_h, reach_misalignment : float
        Half widths of the box about the preset, for the gyros.
    reach_accelerometer_bias_ug : float
        For the accelerometers' biases; the others are those of the gyros.
    box : array_like, shape (n_var, 2), optional
        Lower and upper limits instead.
    truth : GyroTriad or ImuCalibration, optional
        What the sensors are, where known. Scores use it, no loss does.

    Raises
    ------
    InvalidInput
        If a record has gaps, dead or saturated channels, its rates are nowhere near the Earth rate (most
        often in another unit), or the noise drowns the Earth rate.

    Notes
    -----
    With ω̂ the rate that a candidate makes of the counts, Ω the Earth rate and σ the noise of an averaged
    channel, the indicator is sqrt(Σ(‖ω̂‖² − Ω²)²/(m − 1)), in (°/h)² as the paper prints it: a root mean
    square about zero, not the standard deviation it is called. Noise makes ‖ω̂‖² too large by tr Σ_n on
    average, Σ_n being its covariance after E⁻¹ of the preset; ``"corrected"`` takes that out. Residuals and
    bounds are always those of the corrected form: its terms over sqrt(4 Ω² σ² + 6 σ⁴). ``"turntable"`` is
    the root mean square misfit of the record in °/h. ``"invariants"`` is the root mean square of three
    whitened differences per position: ‖ω̂‖² − Ω², ‖f̂‖² − g², ω̂·f̂ − Ω g sin L, the first two corrected for
    noise.

    A candidate whose misalignment matrix has no inverse, or with a scale factor of zero, has loss ``+inf``.
    """

    provides = frozenset({"residuals", "bound", "triad"})

    def __init__(
        self,
        counts: Any,
        attitudes: Any = None,
        *,
        latitude: float,
        noise: GyroNoise,
        averaging_time_s: float = 300.0,
        fixed: GyroTriad | None = None,
        estimated: str | Iterable[str] | None = None,
        loss: str = "indicator",
        prior: Any = None,
        accelerometer_counts: Any = None,
        accelerometer_noise: AccelerometerNoise | None = None,
        fixed_accelerometer: AccelerometerTriad | None = None,
        turntable_counts: Any = None,
        turntable_rates: Any = None,
        turntable_averaging_s: float | None = None,
        reach_scale_ppm: float = 1000.0,
        reach_bias_deg_h: float = 0.1,
        reach_misalignment: float = 2e-3,
        reach_accelerometer_bias_ug: float = 1000.0,
        box: Any = None,
        truth: GyroTriad | ImuCalibration | None = None,
    ) -> None:
        if loss not in LOSSES:
            raise UnknownName("loss", loss, LOSSES)
        if not isinstance(noise, GyroNoise):
            raise InvalidInput("noise", noise, "give a navopt.models.GyroNoise")
        self.loss_name, self.noise = loss, noise
        self.averaging_time_s = float(averaging_time_s)
        self.turntable_averaging_s = float(turntable_averaging_s or averaging_time_s)
        self.sigma = noise.averaged_sigma(self.averaging_time_s)
        self.turntable_sigma = noise.averaged_sigma(self.turntable_averaging_s)
        self.latitude = float(latitude)
        gravity = float(normal_gravity(self.latitude))
        with_forces = loss == "invariants"
        known, names, self.in_convention = chosen(
            estimated, accelerometers=with_forces, table=loss == "turntable"
        )
        fixed = UNIT_GYROS if fixed is None else fixed
        self.accelerometer_noise = accelerometer_noise
        self.counts = check_record("counts", counts, fixed, noise.range)
        if loss != "turntable":
            check_norms("counts", fixed.inverse(self.counts))
            check_noise(self.sigma, noise.white / np.sqrt(self.averaging_time_s), noise.bias_instability)
        self.attitudes = None if attitudes is None else np.array(check_attitudes(attitudes))
        if self.attitudes is not None and self.attitudes.shape[:1] != self.counts.shape[:1]:
            raise InvalidInput("attitudes", self.attitudes.shape, f"give one for each of {len(self.counts)}")
        self.accelerometer_counts, self.accelerometer_sigma = None, 0.0
        self._accelerometer_preset = (
            UNIT_ACCELEROMETERS if fixed_accelerometer is None else fixed_accelerometer
        )
        if accelerometer_counts is not None:
            self.accelerometer_counts, self.accelerometer_sigma = read_accelerometers(
                accelerometer_counts,
                self._accelerometer_preset,
                accelerometer_noise,
                len(self.counts),
                gravity,
                self.averaging_time_s,
            )
        elif with_forces:
            raise InvalidInput("accelerometer_counts", "None", 'loss="invariants" needs accelerometers')
        self.turntable_counts, self.turntable_rates = read_turntable(
            turntable_counts, turntable_rates, fixed, noise.range
        )
        if loss == "turntable" and self.turntable_counts is None:
            raise InvalidInput("turntable_counts", "None", 'loss="turntable" needs a turntable record')

        preset: GyroTriad | ImuCalibration = fixed
        if with_forces:
            preset = ImuCalibration.of(fixed, self._accelerometer_preset)
        self.preset = preset.in_frame("lower-triangular") if self.in_convention else preset
        self._base = self.preset.vector
        self._columns = np.array([known.index(name) for name in names])
        reach = {
            "scale": reach_scale_ppm * 1e-6,
            "bias": reach_bias_deg_h * DEGREE_PER_HOUR,
            "misalignment": reach_misalignment,
            "accelerometer_bias": reach_accelerometer_bias_ug * 1e-6 * 9.80665,
        }
        super().__init__(self._make_parameters(names, reach, box))
        self.parameter_groups = groups_of(names)
        self._prior_covariance = make_prior(prior, names)
        if self._prior_covariance is not None:
            self.provides = self.provides | {"prior"}  # type: ignore[misc]
        self._misfit = self._make_misfit(gravity)
        records = (self.counts, self.accelerometer_counts, self.turntable_counts, self.turntable_rates)
        for array in (*records, self.attitudes, self._base, self._prior_covariance):
            if array is not None:
                array.setflags(write=False)
        if truth is not None:
            self._set_truth(truth)

    def _make_parameters(self, names: list[str], reach: dict[str, float], box: Any) -> list[Parameter]:
        values = self._base[self._columns]
        limits = make_box(names, values, reach, box)
        return [
            Parameter(name, UNITS[name], float(low), float(high), float(np.clip(value, low, high)))
            for name, value, (low, high) in zip(names, values, limits, strict=True)
        ]

    def _make_misfit(self, gravity: float) -> Misfit:
        gyro = _gyros(self.preset)
        if self.loss_name == "turntable":
            assert self.turntable_counts is not None
            assert self.turntable_rates is not None
            return TurntableMisfit(self.turntable_counts, self.turntable_rates, gyro, self.turntable_sigma)
        if self.loss_name == "invariants":
            assert self.accelerometer_counts is not None
            return InvariantMisfit(
                self.counts,
                self.accelerometer_counts,
                gyro,
                self._accelerometer_preset,
                sigma=self.sigma,
                force_sigma=self.accelerometer_sigma,
                gravity=gravity,
                latitude=self.latitude,
            )
        return NormMisfit(self.counts, gyro, self.sigma, corrected=self.loss_name == "corrected")

    def _set_truth(self, truth: GyroTriad | ImuCalibration) -> None:
        if isinstance(truth, ImuCalibration) and self.loss_name != "invariants":
            truth = truth.gyro
        wanted = ImuCalibration if self.loss_name == "invariants" else GyroTriad
        if not isinstance(truth, wanted):
            raise InvalidInput("truth", type(truth).__name__, f"give a {wanted.__name__}")
        self.truth = truth
        described = truth.in_frame("lower-triangular") if self.in_convention else truth
        rest = np.delete(described.vector - self._base, self._columns)
        # a decision vector made the data only where all that is not estimated is known rightly
        if (np.abs(rest) <= 1e-12 * np.abs(np.delete(self._base, self._columns)) + 1e-18).all():
            x = described.vector[self._columns]
            if ((x >= self.xl) & (x <= self.xu)).all():
                self.true_x = x

    # -- the objective -------------------------------------------------------------------------------
    def _full(self, X: np.ndarray) -> np.ndarray:
        full = np.repeat(self._base[None], len(X), axis=0)
        full[:, self._columns] = X
        return full

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return self._misfit.losses(self._full(X))

    def invalid_reasons(self, X: np.ndarray) -> list[str]:
        """Say that a candidate has no inverse: the only way one can fail."""
        return [
            "the sensors of the candidate have no inverse: two measure the same axis or one nothing"
        ] * len(X)

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        return self._misfit.residuals(self._full(X))

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(self._misfit.slopes(self._full(X))[:, :, self._columns])

    def prior(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Presets on average, and the covariance that was given; None if none was."""
        return None if self._prior_covariance is None else (self.nominal, self._prior_covariance)

    def describe_direction(self, coefficients: dict[str, float]) -> str:
        """Say whether a combination of parameters is a rotation of the body axes."""
        return direction_words(coefficients, ("", ACCELEROMETER) if self.loss_name == "invariants" else ("",))

    # -- physics -------------------------------------------------------------------------------------
    def estimate(self, x: np.ndarray) -> GyroTriad | ImuCalibration:
        """Triad of a decision vector, the rest as preset; with accelerometers an `ImuCalibration`."""
        full = self._base.copy()
        full[self._columns] = np.asarray(x, dtype=float)
        return (
            ImuCalibration(full[:12], full[12:])
            if self.loss_name == "invariants"
            else GyroTriad.from_vector(full)
        )

    def project(self, estimate: GyroTriad | ImuCalibration) -> np.ndarray:
        """Values of the estimated parameters, clipped to the box; in the problem's frame if it keeps one."""
        if self.loss_name == "invariants":
            if not isinstance(estimate, ImuCalibration):
                assert isinstance(self.preset, ImuCalibration)
                estimate = ImuCalibration.of(estimate, self.preset.accelerometer)
        else:
            estimate = _gyros(estimate)
        if self.in_convention:
            estimate = estimate.in_frame("lower-triangular")
        return self.clip(estimate.vector[self._columns])

    def _score(self, estimate: GyroTriad | ImuCalibration) -> dict[str, float]:
        if isinstance(self.truth, ImuCalibration) and isinstance(estimate, ImuCalibration):
            return imu_scores(estimate, self.truth)
        return triad_scores(_gyros(estimate), _gyros(self.truth))

    # -- worlds --------------------------------------------------------------------------------------
    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        positions: Any = 24,
        placement: str = "table",
        latitude_deg: float = 45.75,
        noise: Any = None,
        averaging_time_s: float = 300.0,
        protocol: str = "random",
        scale_spread_ppm: float = 500.0,
        bias_spread_deg_h: float = 0.05,
        misalignment_spread: float = 5e-4,
        turntable_positions: Any = 24,
        turntable_rates_deg_s: Any = (),
        turntable_averaging_s: float | None = None,
        accelerometer_noise: Any = None,
        estimated: Any = None,
        loss: str = "indicator",
        prior: bool = False,
        reach_scale_ppm: float = 1000.0,
        reach_bias_deg_h: float = 0.1,
        reach_misalignment: float = 2e-3,
        noise_seed: int | None = None,
    ) -> GyroCalibration:
        """Draw one world: gyros, a turntable record of them, and field positions with noise.

        Parameters
        ----------
        seed : int
            Seed of the true parameters, the positions and the noise.
        positions : int or array_like, shape (m, 3, 3)
            Field positions: 6 and 24 are those of a levelled table, any other number is scattered; or the
            attitudes themselves.
        placement : {"table", "scattered"}
            ``"scattered"`` scatters 6 and 24 positions as well.
        latitude_deg : float
            °; that of Harbin if not given.
        noise : GyroNoise or mapping, optional
            Of the gyros; a mapping holds the keywords of `GyroNoise.from_datasheet`. Table 4 if not given.
        averaging_time_s, turntable_averaging_s : float
            Time averaged at a position, in the field and on the table.
        protocol : {"random", "known", "paper"}
            ``"random"``: presets are the paper's Table 2, the true parameters differ from them by the
            spreads below. ``"known"``: only those estimated differ. ``"paper"``: the true parameters
            likewise, but presets are what least squares make of the turntable record, as in the paper.
        scale_spread_ppm, bias_spread_deg_h, misalignment_spread : float
            True parameters are uniform within so much of Table 2 (ppm, °/h, rad).
        turntable_positions : int or array_like
            As `positions`, on the table.
        turntable_rates_deg_s : sequence of float
            Rates of the table, in both directions about each axis, beside its positions.
        accelerometer_noise : AccelerometerNoise or mapping, optional
            Of accelerometers, which are there with ``loss="invariants"`` only; 10 µg/√Hz and 10 µg if not
            given.
        estimated, loss, reach_scale_ppm, reach_bias_deg_h, reach_misalignment
            As for the class.
        prior : bool
            Whether the spreads are declared as prior standard deviations.
        noise_seed : int, optional
            Another draw of the noise for the same world; presets stay.

        Returns
        -------
        GyroCalibration
            Its truth is the sensors as they are in the field, or on the table with ``loss="turntable"``: the
            scale factors differ between the two by the stability that the noise declares.
        """
        scenario = {name: v for name, v in locals().items() if name not in ("cls", "seed", "noise_seed")}
        from navopt.problems.gyro_worlds import build_world

        world = build_world(cls, seed, noise_seed, **scenario)
        object.__setattr__(world, "_world", {"seed": seed, **scenario})
        return world

    def illustration(self) -> dict[str, np.ndarray]:
        """Rates at the preset, and true ones where known: positions on the sphere of the Earth rate."""
        picture = {"preset_rates": _gyros(self.preset).inverse(self.counts)}
        if self.truth is not None:
            picture["true_rates"] = _gyros(self.truth).inverse(self.counts)
        return picture


def _gyros(sensors: GyroTriad | ImuCalibration) -> GyroTriad:
    return sensors.gyro if isinstance(sensors, ImuCalibration) else sensors
