"""Everything about an alignment's world but its seed: place, sensors, errors, clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.alignment_sensors import ImuGrade
from navopt.models.enu_attitude import attitude_enu
from navopt.models.static_alignment import StaticSite

__all__ = ["SETTINGS", "AlignmentScenario"]

#: What paper 000 prints of its simulation (Table 2) and of its experiment with a low-cost module (Table 4).
#: It prints neither the errors of the sensors nor those of the initial attitude: these are choices, 0.1, 0.1
#: and 0.5 degrees for the first, and what levelling with an accelerometer of 10 mg leaves for the second.
SETTINGS: dict[str, dict[str, Any]] = {
    "simulation": {
        "duration_s": 5.0, "latitude_deg": 40.0, "height_m": 40.0, "imu": "navigation",
        "angle_sigma_deg": (0.1, 0.1, 0.5),
    },
    "experiment": {
        "duration_s": 50.0, "latitude_deg": 39.84, "height_m": 36.0, "imu": "low-cost",
        "angle_sigma_deg": (0.6, 0.6, 2.0),
    },
}  # fmt: skip
#: Gravity of both tables, m/s^2: that of the equator.
PRINTED_GRAVITY = 9.7803267714
GRADES = {"navigation": ImuGrade.navigation, "low-cost": ImuGrade.low_cost}
#: Numbers of a data sheet that replace those of the grade.
SHEET = ("gyro_bias_dph", "arw_deg_rth", "accel_bias_ug", "vrw_ug_rthz")


@dataclass(frozen=True, kw_only=True)
class AlignmentScenario:
    """See `navopt.problems.StaticAlignment.simulate` for each keyword; None is taken from `SETTINGS`.

    Raises
    ------
    InvalidInput
        If a value cannot be used.
    UnknownName
        If a choice is not known.
    """

    setting: str = "simulation"
    duration_s: float | None = None
    step_s: float = 0.01
    latitude_deg: float | None = None
    height_m: float | None = None
    gravity: float | str | None = None
    imu: str | Mapping[str, float] | None = None
    angle_sigma_deg: tuple[float, float, float] | None = None
    errors: str = "drawn"
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    yaw_deg: float = 0.0
    velocity_sigma: float = 0.01
    data: str = "model"
    spread_decades: float = 0.5
    same_spread: bool = False

    def __post_init__(self) -> None:
        for name, known in (
            ("setting", SETTINGS),
            ("errors", ("drawn", "published")),
            ("data", ("model", "sensors")),
        ):
            if getattr(self, name) not in known:
                raise UnknownName(name, getattr(self, name), known)
        for name, value in SETTINGS[self.setting].items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        for name in ("duration_s", "step_s", "velocity_sigma"):
            value = getattr(self, name)
            if not _is_number(value) or not value > 0.0:
                raise InvalidInput(name, value, "give a positive number")
        if not _is_number(self.spread_decades) or not 0.0 <= self.spread_decades <= 6.0:
            raise InvalidInput("spread_decades", self.spread_decades, "give a number from 0 to 6")
        if self.steps < 10:
            raise InvalidInput("duration_s", self.duration_s, "give ten steps or more: lower step_s")
        angles = np.asarray(self.angle_sigma_deg, dtype=float)
        if angles.shape != (3,) or not ((angles > 0.0) & (angles <= 20.0)).all():
            raise InvalidInput(
                "angle_sigma_deg", self.angle_sigma_deg, "give 1 sigma about east, north, up, in (0, 20]"
            )
        for name in ("pitch_deg", "roll_deg", "yaw_deg"):
            if not _is_number(getattr(self, name)):
                raise InvalidInput(name, getattr(self, name), "give an angle in degrees")
        self.site, self.grade, self.attitude  # noqa: B018 - check what they are made of

    @property
    def steps(self) -> int:
        """Number of steps of the clock; there is one more measurement."""
        return round(float(self.duration_s or 0.0) / self.step_s)

    @property
    def site(self) -> StaticSite:
        """Where the system stands."""
        if not _is_number(self.latitude_deg):
            raise InvalidInput("latitude_deg", self.latitude_deg, "give a latitude in degrees")
        if isinstance(self.gravity, str) and self.gravity != "published":
            raise UnknownName("gravity", self.gravity, ("published",))
        gravity = PRINTED_GRAVITY if isinstance(self.gravity, str) else self.gravity
        return StaticSite(
            latitude=float(np.radians(float(self.latitude_deg or 0.0))),
            height=float(self.height_m or 0.0),
            gravity=gravity,
        )

    @property
    def grade(self) -> ImuGrade:
        """1 sigma of the errors of the sensors."""
        if isinstance(self.imu, Mapping):
            for name in self.imu:
                if name not in SHEET:
                    raise UnknownName("imu", name, SHEET)
            if len(self.imu) < len(SHEET):
                raise InvalidInput("imu", dict(self.imu), f"give all of {', '.join(SHEET)}")
            return ImuGrade.from_datasheet(**self.imu)
        if self.imu not in GRADES:
            raise UnknownName("imu", str(self.imu), GRADES)
        return GRADES[self.imu]()

    @property
    def attitude(self) -> np.ndarray:
        """The true C_b^n."""
        if not abs(self.pitch_deg) <= 60.0 or not abs(self.roll_deg) <= 60.0:
            raise InvalidInput(
                "pitch_deg, roll_deg", (self.pitch_deg, self.roll_deg), "give tilts of at most 60 degrees"
            )
        return attitude_enu(*np.radians([self.pitch_deg, self.roll_deg, self.yaw_deg]))

    @property
    def sigma(self) -> np.ndarray:
        """1 sigma of the ten states at the start, independent of each other, shape (10,)."""
        grade = self.grade
        return np.concatenate(
            [
                [self.velocity_sigma] * 2,
                np.radians(np.asarray(self.angle_sigma_deg, dtype=float)),
                [grade.accelerometer_bias] * 2,
                [grade.gyro_bias] * 3,
            ]
        )


def _is_number(value: Any) -> bool:
    return (
        not isinstance(value, bool)
        and isinstance(value, int | float | np.integer | np.floating)
        and bool(np.isfinite(value))
    )
