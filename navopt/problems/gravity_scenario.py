"""The scenario of a simulated gravity-matching world: where, how, with what errors; checked once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.cruise import CruiseScenario, InsErrors
from navopt.models.earth import principal_radii
from navopt.models.paths import Path
from navopt.models.random_field import CORRELATIONS
from navopt.problems.gravity_errors import GravimeterErrors, check_number
from navopt.problems.gravity_sensing import MeasurementErrors

__all__ = ["AREAS", "SCALE_SIGMA", "WorldScenario"]

#: Departure (latitude, longitude) and azimuth, degrees. Of the 1341 straight voyages of 16 h that start on
#: quarters of a degree, head for multiples of 15° and stay clear of the border of the embedded map,
#: "smooth" has the smallest and "rough" the largest rms slope of the anomaly to degree 2190 along the way:
#: 0.42 and 5.5 mGal/km; "typical", the voyage of paper 003, has 1.9, the median of all is 2.0.
AREAS = {
    "typical": (20.0, 156.0, 300.0),
    "smooth": (20.0, 155.5, 285.0),
    "rough": (20.25, 156.0, 315.0),
}
#: 1σ of the scale that is declared, and drawn, where the track is placed: three of them reach 0.7 and 1.3.
SCALE_SIGMA = 0.1
#: Legs of a manoeuvring voyage: shortest and longest duration (s), angle off the mean course (degrees), and
#: speed as a share of the straight voyage's.
LEG_SECONDS, LEG_ANGLE_DEG, LEG_SPEED = (2400.0, 7200.0), (15.0, 45.0), (0.6, 1.1)


def _positive(value: float) -> bool:
    return value > 0.0


def _not_negative(value: float) -> bool:
    return value >= 0.0


@dataclass(frozen=True, kw_only=True)
class WorldScenario:
    """Everything about a simulated world but its seed; see `GravityMatching.simulate` for each keyword.

    Raises
    ------
    InvalidInput
        If a value cannot be used, or does not go with another.
    UnknownName
        If a choice is not known.
    """

    hours: float = 3.0
    degree: int = 2190
    area: str = "typical"
    voyage: str = "straight"
    ins: str = "drawn"
    initial_sigma_m: float | None = None
    heading_sigma_deg: float | None = None
    initial_error_m: float | None = None
    heading_error_deg: float | None = None
    scale_error: float | None = None
    map_error: float | str | None = None
    map_error_length_m: float = 10e3
    map_error_shape: str = "gaussian"
    map_error_in: str = "map"
    noise_mgal: float = 1.0
    noise_freedom: float | None = None
    outlier_fraction: float = 0.0
    outlier_mgal: float = 20.0
    bias_mgal: float = 0.0
    drift_mgal_h: float = 0.0
    eotvos: bool = False
    declared: Mapping[str, Any] | None = None
    interval_s: float = 300.0
    window: int = 12

    def __post_init__(self) -> None:
        self.gravimeter  # noqa: B018 - checks the noise
        check_number("interval_s", self.interval_s, _positive, "give a positive number of seconds")
        remedy = "give a time in (0, 16]: the map ends where the voyage does"
        check_number("hours", self.hours, lambda hours: 0.0 < hours <= 16.0, remedy)
        for name, known in (
            ("ins", ("drawn", "published", "placed")),
            ("area", AREAS),
            ("voyage", ("straight", "turns")),
            ("map_error_shape", CORRELATIONS),
            ("map_error_in", ("map", "field")),
        ):
            if getattr(self, name) not in known:
                raise UnknownName(name, getattr(self, name), known)
        window = self.window
        if isinstance(window, bool) or not isinstance(window, int | np.integer) or window < 3:
            raise InvalidInput("window", window, "give a whole number of samples, at least 3")
        if len(self.times) < window:
            remedy = f"{window} samples every {self.interval_s:g} s need a longer voyage"
            raise InvalidInput("hours", self.hours, remedy)
        if not (self.map_error is None or self.map_error == "degree-720"):
            remedy = 'give a standard deviation in mGal, "degree-720" or None'
            check_number("map_error", self.map_error, _not_negative, remedy)
        length = self.map_error_length_m
        check_number("map_error_length_m", length, _positive, "give a positive number of metres")
        self._check_ins()
        if not isinstance(self.eotvos, bool | np.bool_):
            raise InvalidInput("eotvos", self.eotvos, "give True or False")
        if self.eotvos and self.ins == "placed":
            raise InvalidInput(
                "eotvos", True, 'a track that is only placed has no velocity error: ins="drawn"'
            )
        if self.declared is not None and not isinstance(self.declared, Mapping):
            raise InvalidInput("declared", self.declared, "give a mapping, fields of MeasurementErrors")
        for name in self.declared or ():
            if name not in MeasurementErrors.__dataclass_fields__:
                raise UnknownName("declared", name, MeasurementErrors.__dataclass_fields__)

    def _check_ins(self) -> None:
        accepted: dict[str, tuple[Callable[[float], bool], str]] = {
            "initial_sigma_m": (_positive, "give a positive standard deviation in metres"),
            "heading_sigma_deg": (_positive, "give a positive standard deviation in degrees"),
            "initial_error_m": (_not_negative, "give a distance in metres"),
            "heading_error_deg": (lambda v: abs(v) < 180.0, "give an angle in (-180, 180)"),
            "scale_error": (_positive, "give a positive ratio of lengths"),
        }
        for name, (check, remedy) in accepted.items():
            value = getattr(self, name)
            if value is None:
                continue
            check_number(name, value, check, remedy)
            if name in ("initial_error_m", "heading_error_deg", "scale_error") and self.ins != "placed":
                raise InvalidInput(name, value, 'only a placed track has such an error: ins="placed"')

    # -- what follows from the keywords ------------------------------------------------------------------
    @property
    def gravimeter(self) -> GravimeterErrors:
        """Errors of the gravimeter."""
        return GravimeterErrors(
            noise=self.noise_mgal,
            freedom=self.noise_freedom,
            outlier_fraction=self.outlier_fraction,
            outlier=self.outlier_mgal,
            bias=self.bias_mgal,
            drift_per_hour=self.drift_mgal_h,
        )

    @property
    def course(self) -> CruiseScenario:
        """The straight voyage, or the mean course of one with turns."""
        latitude, longitude, azimuth = np.radians(AREAS[self.area]).tolist()
        return CruiseScenario(
            latitude=latitude, longitude=longitude, azimuth=azimuth, duration=round(self.hours * 3600.0)
        )

    @property
    def times(self) -> np.ndarray:
        """Times of the samples, s since departure."""
        return self.course.times(self.interval_s)

    @property
    def ins_sigmas(self) -> InsErrors:
        """1σ of the errors of the INS."""
        sigmas = InsErrors.published()
        if self.initial_sigma_m is not None:
            latitude = self.course.latitude
            meridian, prime_vertical = principal_radii(latitude)
            sigmas = replace(
                sigmas,
                latitude_error=float(self.initial_sigma_m / meridian),
                longitude_error=float(self.initial_sigma_m / (prime_vertical * np.cos(latitude))),
            )
        if self.heading_sigma_deg is not None:
            sigmas = replace(sigmas, attitude_error=(0.0, 0.0, float(np.radians(self.heading_sigma_deg))))
        return sigmas

    @property
    def placed_sigmas(self) -> tuple[float, float, float]:
        """1σ of a placed track: position per axis (m), heading (rad) and scale."""
        position = 10e3 if self.initial_sigma_m is None else float(self.initial_sigma_m)
        heading = 5.0 if self.heading_sigma_deg is None else float(self.heading_sigma_deg)
        return position, float(np.radians(heading)), SCALE_SIGMA

    def path(self, rng: np.random.Generator) -> Path:
        """Draw a voyage with turns about the mean course, never more than 44 km to a side of it."""
        course = self.course
        legs, elapsed, aside = [], 0.0, 0.0
        while elapsed < course.duration:
            lasting = float(rng.uniform(*LEG_SECONDS))
            angle = float(np.radians(rng.uniform(*LEG_ANGLE_DEG)))
            speed = course.speed * float(rng.uniform(*LEG_SPEED))
            side = rng.choice([-1.0, 1.0])
            if aside:
                side = -np.sign(aside)
            aside += side * lasting * speed * np.sin(angle)
            legs.append((lasting, course.azimuth + side * angle, speed))
            elapsed += lasting
        return Path.of_legs(course.latitude, course.longitude, legs)

    def declare(self, map_sigma: float, map_length: float) -> MeasurementErrors:
        """Return what a method is told about the measurements, `declared` replacing the facts."""
        facts: dict[str, Any] = {
            "noise": self.noise_mgal,
            "map_error": map_sigma,
            "map_error_length": map_length,
            "bias": self.bias_mgal,
            "drift_per_day": 24.0 * self.drift_mgal_h,
            "eotvos": self.eotvos,
        }
        return MeasurementErrors(**(facts | dict(self.declared or {})))
