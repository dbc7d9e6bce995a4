"""Recalibrating gyros in the field, judged by where they then lead a navigator (paper 004, section 5)."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import InvalidInput, NoTruth
from navopt.models.imu_calibration import ImuCalibration
from navopt.models.navigation import CalibrationResidual, NavigationError, navigation_error
from navopt.models.navigation_noise import RunErrors
from navopt.models.navigation_scenarios import NavigationScenario
from navopt.models.triad import GyroTriad
from navopt.problems.gyro_calibration import GyroCalibration
from navopt.registry import problem

__all__ = ["GyroNavigation"]


@problem(
    "gyro-navigation",
    summary="recalibrate three gyros in the field and navigate with them, at rest or on a lake",
    example={"navigation": "lake", "recalibration": "positions"},
)
class GyroNavigation(GyroCalibration):
    """`GyroCalibration` whose estimates are also scored by the navigation that follows.

    The presets are what a turntable said of the gyros some time ago; since then they have aged. A
    recalibration finds them anew from the norm of the Earth's rate, and the system aligns itself and
    navigates with the result.

    Parameters
    ----------
    counts : array_like, shape (m, 3)
        Averaged output of the gyros for the recalibration.
    attitudes : array_like, shape (m, 3, 3), optional
        As for `GyroCalibration`.
    scenario : NavigationScenario
        The journey that scores an estimate.
    run_errors : RunErrors
        What the sensors do wrong on that journey, of one run; `truth` does not contain it.
    **calibration
        Keywords of `GyroCalibration`. ``loss="invariants"`` is refused.

    Raises
    ------
    InvalidInput
        As for `GyroCalibration`; also if `run_errors` does not fit the scenario.

    Notes
    -----
    Scores are those of `GyroCalibration` and, against the truth, ``position_error_max_nmi``,
    ``position_error_rms_nmi`` and ``position_error_end_nmi`` (nautical miles of 1852 m) with
    ``position_error_max_m`` and ``position_error_end_m``; against the reference of the scenario, as a test at
    sea would see it, ``north_error_end_m`` and ``east_error_end_m``, without sign. An estimate that cannot
    find north has infinite errors.

    Where ``estimated="frame"``, the estimate is turned back into the axes nearest to those of the preset: the
    norm cannot see this rotation, and a navigator needs the gyros in the axes of its accelerometers.
    """

    def __init__(
        self,
        counts: Any,
        attitudes: Any = None,
        *,
        scenario: NavigationScenario,
        run_errors: RunErrors,
        **calibration: Any,
    ) -> None:
        if calibration.get("loss") == "invariants":
            raise InvalidInput("loss", "invariants", "recalibrate gyros alone here, or use GyroCalibration")
        if run_errors.white.shape != (1, scenario.steps, 6):
            raise InvalidInput(
                "run_errors", run_errors.white.shape, f"give those of one run of {scenario.steps} steps"
            )
        self.scenario, self.run_errors = scenario, run_errors
        self.turntable_answer = calibration.get("fixed")
        super().__init__(counts, attitudes, **calibration)

    def estimate(self, x: np.ndarray) -> GyroTriad | ImuCalibration:
        """Triad of a decision vector, in the axes of the preset."""
        found = super().estimate(x)
        if self.in_convention and self.turntable_answer is not None and isinstance(found, GyroTriad):
            return _turned_to(found, self.turntable_answer)
        return found

    def navigation(self, estimate: GyroTriad, *, method: str = "linear") -> NavigationError:
        """Navigate the run of this world with an estimate.

        Parameters
        ----------
        estimate : GyroTriad
            The calibration in use.
        method : {"linear", "strapdown"}, keyword-only
            As for `navopt.models.navigation.navigation_error`.

        Returns
        -------
        NavigationError
            Of one run.

        Raises
        ------
        NoTruth
            If the problem carries no truth.
        InvalidInput
            If the gyros so calibrated cannot find north.
        """
        if self.truth is None:
            raise NoTruth("without the true gyros there is nothing to navigate with")
        residual = CalibrationResidual(true=self.truth, estimated=estimate)
        return navigation_error(residual, self.scenario, method=method, run_errors=self.run_errors)

    def _score(self, estimate: GyroTriad | ImuCalibration) -> dict[str, float]:
        gyro = estimate.gyro if isinstance(estimate, ImuCalibration) else estimate
        scores = super()._score(gyro)
        try:
            run = self.navigation(gyro)
        except InvalidInput:  # lost before departure
            return scores | dict.fromkeys(_SCORES, np.inf)
        seen = run.against_reference
        values = (
            run.max_nmi, run.rms_nmi, run.end_nmi, run.max_m, run.end_m,
            abs(seen.north_m[-1]), abs(seen.east_m[-1]),
        )  # fmt: skip
        return scores | {key: float(value) for key, value in zip(_SCORES, values, strict=True)}

    # -- worlds --------------------------------------------------------------------------------------
    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        navigation: str = "static",
        recalibration: str = "record",
        positions: Any = 24,
        placement: str = "table",
        hours: float = 24.0,
        duration_s: float = 900.0,
        heading_deg: float | None = None,
        alignment: str = "levelled",
        noise: Any = None,
        averaging_time_s: float = 300.0,
        turntable_rates_deg_s: Any = (10.0,),
        aged_bias_deg_h: float = 0.005,
        aged_scale_ppm: float = 10.0,
        aged_misalignment: float = 1e-5,
        estimated: Any = "all",
        loss: str = "indicator",
        prior: bool = True,
        reach_scale_ppm: float = 1000.0,
        reach_bias_deg_h: float = 0.1,
        reach_misalignment: float = 2e-3,
        noise_seed: int | None = None,
    ) -> GyroNavigation:
        """Draw one world: a turntable, ageing, a recalibration and a journey.

        Parameters
        ----------
        seed : int
            Seed of everything.
        navigation : {"static", "lake"}
            At rest in Harbin, or on Qiandao Lake.
        recalibration : {"record", "positions"}
            ``"record"``, as in the paper: the very record that is then navigated, in one position. At rest it
            is the whole record in 24 parts; on the lake, where turns drown the Earth's rate, the ten minutes
            at the mooring in ten parts. ``"positions"``: a recalibration before, in many positions.
        positions, placement
            Of the latter, as for `GyroCalibration.simulate`.
        hours : float
            Length of the static run, h.
        duration_s : float
            Length of the boat trip, s.
        heading_deg : float, optional
            Of the system, or of the boat at its mooring, deg; drawn for each world if not given. The tour of
            the boat turns with it.
        alignment : {"levelled", "svd", "perfect"}
            As for `navopt.models.navigation_scenarios.NavigationScenario`; with the gyros as calibrated.
        noise : GyroNoise or mapping, optional
            Of the gyros; Table 4 if not given.
        averaging_time_s : float
            Time averaged in each position, on the turntable and in the field.
        turntable_rates_deg_s : sequence of float
            Rates of the turntable about each axis, in both directions, beside its 24 positions. Positions
            alone leave misalignments of 1e-4 rad, and a turning boat then hundreds of metres.
        aged_bias_deg_h, aged_scale_ppm, aged_misalignment : float
            Standard deviation of what has changed since the turntable, on each axis (deg/h, ppm, rad).
        estimated, loss, reach_scale_ppm, reach_bias_deg_h, reach_misalignment
            As for `GyroCalibration`.
        prior : bool
            Whether the uncertainty of the presets (turntable, ageing, switch-on) is declared as a prior. The
            loss is the same with it; solvers that use residuals may use it.
        noise_seed : int, optional
            Another draw of the noise for the same gyros and presets.

        Returns
        -------
        GyroNavigation

        Notes
        -----
        From one switch-on to the next, bias and scale factor differ by the
        instability of Table 4. A recalibration from the record sees the run's own values, and even its random
        walk; one in positions comes before the switch-on of the run, and does not.
        """
        scenario = {name: v for name, v in locals().items() if name not in ("cls", "seed", "noise_seed")}
        from navopt.problems.gyro_navigation_worlds import build_navigation_world

        world = build_navigation_world(cls, seed, noise_seed, **scenario)
        object.__setattr__(world, "_world", {"seed": seed, **scenario})
        return world


_SCORES = (
    "position_error_max_nmi",
    "position_error_rms_nmi",
    "position_error_end_nmi",
    "position_error_max_m",
    "position_error_end_m",
    "north_error_end_m",
    "east_error_end_m",
)


def _turned_to(triad: GyroTriad, preset: GyroTriad) -> GyroTriad:
    """The same sensors, described in the axes in which they look most like the preset."""
    # sensors weigh alike, whatever their scale factors
    rows, wanted = triad.misalignment, preset.misalignment
    u, _, vt = np.linalg.svd(rows.T @ wanted)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return GyroTriad.from_matrix(triad.matrix @ turn, triad.scale * triad.bias)
