"""Two journeys on which a calibration shows what it is worth: a day on a marble block, and a boat on a lake.

Gao et al. (2015) let their system stand still for 24 h (section 5.1) and took it for a trip on Qiandao Lake
(section 5.2). They print neither the latitudes nor the heading, route, speed or duration: those below are
ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.paths import Path
from navopt.models.sensor_noise import AccelerometerNoise, GyroNoise

__all__ = ["ALIGNMENTS", "LakeScenario", "NavigationScenario", "StaticScenario"]

ALIGNMENTS = ("levelled", "svd", "perfect")
"""How a scenario may align: see `navopt.models.navigation_alignment`; ``perfect`` begins with no error."""

#: Duration (s), heading (deg) and speed (m/s) of a tour in a bay: every leg turns, all but one change the
#: speed.
_TOUR = (
    (60.0, 40.0, 3.0),
    (90.0, 85.0, 5.0),
    (75.0, 150.0, 7.0),
    (60.0, 95.0, 4.0),
    (90.0, 20.0, 6.0),
    (75.0, -50.0, 6.0),
    (60.0, 30.0, 2.5),
    (120.0, 110.0, 7.0),
    (90.0, 200.0, 5.0),
    (75.0, 265.0, 6.0),
    (105.0, 330.0, 4.0),
)
#: The boat lies at its mooring for so long after the alignment, s.
_CAST_OFF = 20.0


@dataclass(frozen=True, kw_only=True)
class NavigationScenario:
    """What static and lake navigation have in common. Use `StaticScenario` or `LakeScenario`.

    Attributes
    ----------
    latitude_deg, longitude_deg : float
        Where the journey begins, deg.
    alignment : str
        How the initial attitude is found. ``"levelled"``: from the mean readings of the same sensors, gravity
        taken as exact, which reaches the limits of every self-alignment; ``"svd"``: the analytic coarse
        alignment, orthonormalised; ``"perfect"``: without error.
    alignment_s : float
        Duration over which the readings are averaged before departure, s.
    gyro_noise : GyroNoise or None
        The gyros' own errors on this run, which no calibration removes: white noise, a bias and a
        scale-factor error drawn once per run, and the range. None for none.
    accelerometer_noise : AccelerometerNoise or None
        Likewise: white noise, and a bias drawn once per run.
    step_s : float
        Interval of the results and of the linear model, s.
    substeps : int
        Strapdown steps in that interval.
    reference_sigma_m : float
        Standard deviation of the reference positions (DGPS) on each axis, m; independent from one to the
        next.
    """

    latitude_deg: float = 45.75
    longitude_deg: float = 126.68
    alignment: str = "levelled"
    alignment_s: float = 600.0
    gyro_noise: GyroNoise | None = None
    accelerometer_noise: AccelerometerNoise | None = None
    step_s: float = 60.0
    substeps: int = 60
    reference_sigma_m: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.latitude_deg) and abs(self.latitude_deg) < 85.0):
            raise InvalidInput(
                "latitude_deg",
                self.latitude_deg,
                "stay within 85 degrees of the equator: azimuth from the Earth's rate fails at the poles",
            )
        if not np.isfinite(self.longitude_deg):
            raise InvalidInput("longitude_deg", self.longitude_deg, "give a finite number of degrees")
        if self.alignment not in ALIGNMENTS:
            raise UnknownName("alignment", self.alignment, ALIGNMENTS)
        for name in ("alignment_s", "step_s", "duration"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidInput(name, value, "give a positive number of seconds")
        if self.substeps < 1 or self.substeps != int(self.substeps):
            raise InvalidInput("substeps", self.substeps, "give a whole number, at least 1")
        if not (np.isfinite(self.reference_sigma_m) and self.reference_sigma_m >= 0.0):
            raise InvalidInput("reference_sigma_m", self.reference_sigma_m, "give metres, not negative")

    @property
    def duration(self) -> float:
        """Length of the journey, s."""
        raise NotImplementedError

    @property
    def steps(self) -> int:
        """Number of intervals of the results."""
        return max(1, round(self.duration / self.step_s))

    @property
    def latitude(self) -> float:
        """Latitude at departure, rad."""
        return float(np.radians(self.latitude_deg))

    def path(self) -> Path:
        """True motion, sampled at the strapdown step: ``steps * substeps + 1`` samples."""
        raise NotImplementedError

    def check_range(self, body_rate: np.ndarray) -> None:
        """Refuse a journey that turns faster than the gyros can measure.

        Parameters
        ----------
        body_rate : ndarray, shape (..., 3)
            True rates, rad/s.

        Raises
        ------
        InvalidInput
            If a rate leaves the range of `gyro_noise`.
        """
        if self.gyro_noise is None:
            return
        fastest = float(np.abs(body_rate).max())
        if fastest > self.gyro_noise.range:
            raise InvalidInput(
                "gyro_noise.range",
                f"{np.degrees(self.gyro_noise.range):.4g} deg/s, turns of {np.degrees(fastest):.4g} deg/s",
                "turn more slowly or take a gyro of larger range: a saturated gyro is outside these models",
            )


@dataclass(frozen=True, kw_only=True)
class StaticScenario(NavigationScenario):
    """A system that stands still, level, and navigates (Gao et al. 2015, section 5.1).

    Attributes
    ----------
    hours : float
        Length, h.
    heading_deg : float
        Of the forward (y) axis, clockwise from north, deg. It decides which gyro sees how much of the Earth's
        rate. The paper does not print it.

    Notes
    -----
    Latitude and longitude are by default those of Harbin, where the authors work. Further attributes as for
    `NavigationScenario`. The strapdown step is one second.
    """

    hours: float = 24.0
    heading_deg: float = 30.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.isfinite(self.heading_deg):
            raise InvalidInput("heading_deg", self.heading_deg, "give a finite number of degrees")

    @property
    def duration(self) -> float:
        """Length, s."""
        return 3600.0 * self.hours

    def path(self) -> Path:
        """True motion: none."""
        count = self.steps * self.substeps + 1
        time = np.arange(count, dtype=np.float64) * (self.step_s / self.substeps)
        return Path(
            time=time,
            latitude=np.full(count, self.latitude),
            longitude=np.full(count, np.radians(self.longitude_deg)),
            velocity=np.zeros((count, 2)),
            heading=np.full(count, np.radians(self.heading_deg)),
        )


@dataclass(frozen=True, kw_only=True)
class LakeScenario(NavigationScenario):
    """A boat that leaves its mooring and changes speed and heading (Gao et al. 2015, section 5.2).

    Attributes
    ----------
    duration_s : float
        Length from the end of the alignment on, s.
    turn_rate_deg_s : float
        Rate of the turns, deg/s.
    acceleration : float
        Of changes of speed, m/s^2.
    legs : tuple of (float, float, float)
        Duration (s), heading (deg) and speed (m/s), repeated until the time is up. The first heading is also
        that at the mooring.

    Notes
    -----
    Latitude and longitude are by default those of Qiandao Lake. The boat is level and moves along its forward
    axis; at its mooring it lies still. Waves, leeway and the sway at the mooring, which a real alignment has
    to filter, are left out. Further attributes as for `NavigationScenario`; the strapdown step is 0.1 s.
    """

    latitude_deg: float = 29.6
    longitude_deg: float = 119.0
    step_s: float = 1.0
    substeps: int = 10
    reference_sigma_m: float = 0.5
    duration_s: float = 900.0
    turn_rate_deg_s: float = 3.0
    acceleration: float = 0.1
    legs: tuple[tuple[float, float, float], ...] = _TOUR

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.legs or any(len(leg) != 3 or leg[0] <= 0.0 for leg in self.legs):
            raise InvalidInput("legs", self.legs, "give rows of duration (s, positive), heading (deg), speed")

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.duration_s

    def path(self) -> Path:
        """True motion, from the mooring on."""
        plan = [(_CAST_OFF, np.radians(self.legs[0][1]), 0.0)]
        total = _CAST_OFF
        while total < self.duration_s:
            duration, heading, speed = self.legs[(len(plan) - 1) % len(self.legs)]
            plan.append((duration, np.radians(heading), speed))
            total += duration
        step = self.step_s / self.substeps
        whole = Path.of_legs(
            self.latitude,
            np.radians(self.longitude_deg),
            plan,
            step=step,
            turn_rate=float(np.radians(self.turn_rate_deg_s)),
            acceleration=self.acceleration,
        )
        count = self.steps * self.substeps + 1
        return Path(
            time=whole.time[:count].copy(),
            latitude=whole.latitude[:count].copy(),
            longitude=whole.longitude[:count].copy(),
            velocity=whole.velocity[:count].copy(),
            heading=whole.heading[:count].copy(),
        )
