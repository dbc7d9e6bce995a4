"""Worlds of paper 002: a low-cost system at rest, a laser that tells its heading, and all that can be wrong.

The truth is not the filter's model. Readings are made for a machine that stands (and shakes), a strapdown
algorithm at the full rate integrates them from a start that is wrong, and the errors are the difference of
what it computes and what is; see `navopt.models.resting_strapdown` for why its position is held.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.errors import InvalidInput, UnknownName
from navopt.models.alignment_sensors import ImuGrade
from navopt.models.azimuth_error import error_angles, error_rotation
from navopt.models.earth import GRAVITY
from navopt.models.enu_attitude import attitude_angles, attitude_enu
from navopt.models.heading_record import HeadingRecord, prescribed_covariance
from navopt.models.heading_start import heading_alignment_start, heading_start_covariance
from navopt.models.resting_strapdown import resting_strapdown
from navopt.models.static_alignment import StaticSite
from navopt.models.vibration import Vibration
from navopt.problem import stream

__all__ = ["SETTINGS", "HeadingScenario", "simulate_heading_record"]

Array = NDArray[np.float64]

NAME = "heading-alignment"
#: What keywords that are not given are in the simulations of paper 002 (section 5.1) and in its experiment on
#: a machine (section 6). The start of the first two simulations is lost; of the experiment, everything but
#: the place, the heading, the length and the shaking: the sensors are taken to be those of the simulation,
#: and the heading to be as wrong as the paper measured.
SETTINGS: dict[str, dict[str, Any]] = {
    "simulation": {"latitude_deg": 45.0, "heading_deg": 0.0, "vibration": 0.0, "heading_bias_deg": 0.0},
    "onboard": {"latitude_deg": 38.87, "heading_deg": 15.0, "vibration": 1.0, "heading_bias_deg": 0.05},
}
STARTS = ("prescribed", "coarse")
BIASES = ("drawn", "published")
_MILLI_G = 1e-3 * GRAVITY


@dataclass(frozen=True, kw_only=True)
class HeadingScenario:
    """Everything about a world but its seed.

    Attributes
    ----------
    setting : {"simulation", "onboard"}
        Which keywords that are None come from section 5.1 or from section 6 of paper 002, see `SETTINGS`.
    duration_s : float
        Length of the run, s.
    imu_rate_hz, rate_hz, heading_rate_hz : float
        Of the sensors and their integration; of the filter's prediction; of the headings, and of the
        velocities where these keep the same clock. Each a whole multiple of the next.
    latitude_deg, pitch_deg, roll_deg, heading_deg : float
        Where the machine stands and how. The bias of the third accelerometer, which the paper leaves out of
        the state, pulls a tilted machine sideways: by its sine.
    start : {"prescribed", "coarse"}
        Computed attitude off by `angles_deg`, with `prior_deg` declared; or from `coarse_s` seconds of
        levelling and measured headings.
    angles_deg : (float, float, float)
        phi_E, phi_N, phi_U at a prescribed start, up to 180 degrees in phi_U.
    prior_deg : (float, float, float)
        1 sigma of them that the filter is told.
    coarse_s : float
        Length of a coarse start, s.
    biases : {"drawn", "published"}
        Normal with the declared sigma, or all at plus one sigma as the paper has it.
    gyro_bias_dps, gyro_noise_dps : float
        1 sigma of the gyros' bias and of a reading's noise, deg/s.
    accel_bias_mg, accel_noise_mg : float
        The same of the accelerometers, thousandths of g.
    velocity_sigma : float
        1 sigma of the disturbance of the velocities, m/s.
    heading_sigma_deg : float
        1 sigma of a heading. The paper calls its 0.028 degrees a variance.
    imu_noise_factor, velocity_noise_factor, heading_noise_factor : float
        By what the true noise exceeds the declared. A variance ten times as large is the factor
        ``sqrt(10)``.
    bursts : (float, float, float), optional
        Every so many seconds, for so many, the noise of the sensors and the headings is so many times
        larger.
    outages : sequence of (float, float)
        From and until when no heading is measured, s.
    outlier_rate, outlier_deg : float
        Part of the headings that are off by a number drawn evenly up to this size.
    heading_bias_deg : float
        What is added to all headings.
    vibration : float
        Size of the shaking by the cutting system, see `navopt.models.vibration.Vibration`; zero for none.
    transport : bool
        See `navopt.models.resting_strapdown.resting_strapdown`.
    small_levels : bool
        Form of the error model that the record asks of the filter.

    Raises
    ------
    InvalidInput
        If a value cannot be used.
    UnknownName
        If a choice is not known.
    """

    setting: str = "simulation"
    duration_s: float = 1500.0
    imu_rate_hz: float = 100.0
    rate_hz: float = 100.0
    heading_rate_hz: float = 10.0
    latitude_deg: float | None = None
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    heading_deg: float | None = None
    start: str = "prescribed"
    angles_deg: tuple[float, float, float] = (1.0, 1.0, 15.0)
    prior_deg: tuple[float, float, float] = (1.0, 1.0, 30.0)
    coarse_s: float = 10.0
    biases: str = "drawn"
    gyro_bias_dps: float = 0.01
    gyro_noise_dps: float = 0.05
    accel_bias_mg: float = 1.0
    accel_noise_mg: float = 0.5
    velocity_sigma: float = 0.1
    heading_sigma_deg: float = 0.028
    imu_noise_factor: float = 1.0
    velocity_noise_factor: float = 1.0
    heading_noise_factor: float = 1.0
    bursts: tuple[float, float, float] | None = None
    outages: tuple[tuple[float, float], ...] = ()
    outlier_rate: float = 0.0
    outlier_deg: float = 5.0
    heading_bias_deg: float | None = None
    vibration: float | None = None
    transport: bool = False
    small_levels: bool = False

    def __post_init__(self) -> None:
        for name, known in (("setting", SETTINGS), ("start", STARTS), ("biases", BIASES)):
            if getattr(self, name) not in known:
                raise UnknownName(name, getattr(self, name), known)
        for name, value in SETTINGS[self.setting].items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        positive = (
            "duration_s", "imu_rate_hz", "rate_hz", "heading_rate_hz", "coarse_s", "velocity_sigma",
            "heading_sigma_deg", "gyro_noise_dps", "accel_noise_mg", "gyro_bias_dps", "accel_bias_mg",
        )  # fmt: skip
        for name in positive:
            if not _is_number(getattr(self, name)) or not getattr(self, name) > 0.0:
                raise InvalidInput(name, getattr(self, name), "give a number above zero")
        factors = ("imu_noise_factor", "velocity_noise_factor", "heading_noise_factor", "vibration")
        for name in (*factors, "outlier_deg"):
            if not _is_number(getattr(self, name)) or getattr(self, name) < 0.0:
                raise InvalidInput(name, getattr(self, name), "give zero or more")
        for name in ("pitch_deg", "roll_deg", "heading_deg", "heading_bias_deg", "latitude_deg"):
            if not _is_number(getattr(self, name)):
                raise InvalidInput(name, getattr(self, name), "give an angle in degrees")
        if not _is_number(self.outlier_rate) or not 0.0 <= self.outlier_rate <= 1.0:
            raise InvalidInput("outlier_rate", self.outlier_rate, "give a part of all headings, from 0 to 1")
        self._check_rates()
        self._check_angles()
        self._check_times()
        self.site  # noqa: B018 - check the latitude

    def _check_rates(self) -> None:
        for above, name in (("imu_rate_hz", "rate_hz"), ("rate_hz", "heading_rate_hz")):
            fast, slow = getattr(self, above), getattr(self, name)
            if slow > fast * (1.0 + 1e-9):
                raise InvalidInput(name, slow, f"give at most {above}, which is {fast:g}")
            if abs(fast / slow - round(fast / slow)) > 1e-6:
                raise InvalidInput(name, slow, f"give a whole part of {above}, {fast:g}")
        if self.steps < 10 * self.clock:
            raise InvalidInput("duration_s", self.duration_s, "give time for ten headings or more")

    def _check_angles(self) -> None:
        for name, least in (("angles_deg", None), ("prior_deg", 0.0)):
            angles = np.asarray(getattr(self, name), dtype=float)
            if angles.shape != (3,) or not np.isfinite(angles).all():
                raise InvalidInput(name, getattr(self, name), "give three angles in degrees")
            if least is not None and not (angles > least).all():
                raise InvalidInput(name, getattr(self, name), "give standard deviations above zero")
        if max(abs(a) for a in self.angles_deg[:2]) > 60.0 or abs(self.angles_deg[2]) > 180.0:
            raise InvalidInput(
                "angles_deg", self.angles_deg, "give levels within 60 and an azimuth within 180 degrees"
            )
        if max(abs(self.pitch_deg), abs(self.roll_deg)) > 60.0:
            raise InvalidInput(
                "pitch_deg, roll_deg", (self.pitch_deg, self.roll_deg), "give 60 degrees at most"
            )

    def _check_times(self) -> None:
        if self.bursts is not None:
            burst = np.asarray(self.bursts, dtype=float)
            if burst.shape != (3,) or not (burst > 0.0).all() or not burst[1] <= burst[0]:
                raise InvalidInput("bursts", self.bursts, "give (period s, length s, factor)")
        for outage in self.outages:
            if len(outage) != 2 or not outage[0] < outage[1]:
                raise InvalidInput("outages", self.outages, "give pairs (from s, until s)")

    @property
    def steps(self) -> int:
        """Number of steps of the filter."""
        return round(self.duration_s * self.rate_hz)

    @property
    def every(self) -> int:
        """Readings of the sensors per step of the filter."""
        return round(self.imu_rate_hz / self.rate_hz)

    @property
    def clock(self) -> int:
        """Steps of the filter between two headings."""
        return round(self.rate_hz / self.heading_rate_hz)

    @property
    def site(self) -> StaticSite:
        """Where the machine stands."""
        return StaticSite(latitude=float(np.radians(self.latitude_deg)))  # type: ignore[arg-type]

    @property
    def attitude(self) -> Array:
        """The true C_b^n at rest."""
        return attitude_enu(*np.radians([self.pitch_deg, self.roll_deg, self.heading_deg]))  # type: ignore[arg-type]

    @property
    def grade(self) -> ImuGrade:
        """1 sigma of the errors of the sensors, as declared."""
        root = np.sqrt(1.0 / self.imu_rate_hz)
        return ImuGrade(
            gyro_bias=float(np.radians(self.gyro_bias_dps)),
            gyro_noise=float(np.radians(self.gyro_noise_dps) * root),
            accelerometer_bias=self.accel_bias_mg * _MILLI_G,
            accelerometer_noise=float(self.accel_noise_mg * _MILLI_G * root),
        )


def simulate_heading_record(scenario: HeadingScenario, seed: int, draw: int | None = None) -> HeadingRecord:
    """Draw one world.

    Parameters
    ----------
    scenario : HeadingScenario
        All but the seed.
    seed : int
        Of what is constant: the biases, and the phases of the shaking.
    draw : int, optional
        Another draw of all noise.

    Returns
    -------
    HeadingRecord
        With the true states.
    """
    world = stream(f"world:{NAME}", seed)
    noise = stream(f"noise:{NAME}", *([seed] if draw is None else [seed, draw]))
    kicks = world.standard_normal(6)
    if scenario.biases == "published":
        kicks = np.ones(6)
    site, grade, true = scenario.site, scenario.grade, scenario.attitude
    gyro_bias, force_bias = grade.gyro_bias * kicks[:3], grade.accelerometer_bias * kicks[3:]
    shaking = Vibration.drawn(world, float(scenario.vibration or 0.0))
    step = 1.0 / scenario.imu_rate_hz
    early = round(scenario.coarse_s * scenario.imu_rate_hz) if scenario.start == "coarse" else 0
    count = early + scenario.steps * scenario.every
    # readings end at these times; a coarse start lies before zero
    edges: Array = step * np.arange(-early, count + 1 - early, dtype=np.float64)
    w, f = shaking.readings(true, site, edges)
    louder = _burst_factor(scenario, edges[1:])
    per_sample = scenario.imu_noise_factor / np.sqrt(step)
    random = noise.standard_normal((count, 6)) * louder[:, None]
    w = w + gyro_bias + grade.gyro_noise * per_sample * random[:, :3]
    f = f + force_bias + grade.accelerometer_noise * per_sample * random[:, 3:]
    stride = scenario.every * scenario.clock
    heading_edges = np.arange(early % stride, count + 1, stride)
    readings = _headings(scenario, edges[heading_edges], true, shaking, noise)
    start, P0 = _start(scenario, w[:early], f[:early], readings[heading_edges < early])
    run = resting_strapdown(
        w[early:], f[early:], step, site, start, every=scenario.every, transport=scenario.transport,
        small_levels=scenario.small_levels,
    )  # fmt: skip
    time = edges[early :: scenario.every]
    heading = np.full(len(time), np.nan)
    later = heading_edges >= early
    heading[(heading_edges[later] - early) // scenario.every] = readings[later]
    states = _true_states(run.velocity, run.attitude, true, shaking, time, force_bias, gyro_bias)
    sway = scenario.velocity_sigma * scenario.velocity_noise_factor * noise.standard_normal((len(time), 2))
    return HeadingRecord(
        site=site, grade=grade, velocity_sigma=scenario.velocity_sigma,
        heading_sigma=float(np.radians(scenario.heading_sigma_deg)), time=time,
        velocity=run.velocity + sway, attitude=run.attitude, heading=heading, clock=scenario.clock,
        constants=run.constants, x0=np.zeros(10), P0=P0, states=states,
    )  # fmt: skip


def _start(scenario: HeadingScenario, w: Array, f: Array, readings: Array) -> tuple[Array, Array]:
    """Computed attitude at the start, and the covariance that is declared for it."""
    grade, site = scenario.grade, scenario.site
    if scenario.start == "prescribed":
        start = error_rotation(np.radians(scenario.angles_deg)) @ scenario.attitude
        return start, prescribed_covariance(grade, np.radians(scenario.prior_deg), scenario.velocity_sigma)
    start = heading_alignment_start(w, f, readings, site, gyro_error=grade.gyro_bias).attitude
    sigma = np.radians(scenario.heading_sigma_deg) / np.sqrt(np.isfinite(readings).sum())
    P0 = heading_start_covariance(
        site, start, grade, duration=scenario.coarse_s, heading_sigma=float(sigma),
        velocity_sigma=scenario.velocity_sigma,
    )  # fmt: skip
    return start, P0


def _burst_factor(scenario: HeadingScenario, time: Array) -> Array:
    if scenario.bursts is None:
        return np.ones(len(time))
    period, length, factor = scenario.bursts
    # the first burst ends the first period, so that every run starts quietly
    return np.where(time % period >= period - length, factor, 1.0)


def _headings(
    scenario: HeadingScenario, time: Array, true: Array, shaking: Vibration, rng: np.random.Generator
) -> Array:
    """Measured headings, NaN where there is none, in (-pi, pi]."""
    actual = attitude_angles(shaking.attitude(true, time))[2]
    size = np.radians(scenario.heading_sigma_deg) * scenario.heading_noise_factor
    noise = size * _burst_factor(scenario, time) * rng.standard_normal(len(time))
    wild = rng.uniform(size=len(time)) < scenario.outlier_rate
    noise = noise + wild * np.radians(scenario.outlier_deg) * rng.uniform(-1.0, 1.0, len(time))
    read = actual + np.radians(scenario.heading_bias_deg or 0.0) + noise
    for begin, end in scenario.outages:
        read[(time >= begin) & (time < end)] = np.nan
    return np.arctan2(np.sin(read), np.cos(read))


def _true_states(
    velocity: Array,
    attitude: Array,
    true: Array,
    shaking: Vibration,
    time: Array,
    force_bias: Array,
    gyro_bias: Array,
) -> Array:
    actual = shaking.attitude(true, time)
    phi = error_angles(attitude, actual)
    phi[:, 2] = np.unwrap(phi[:, 2])
    gap = attitude_angles(attitude)[2] - attitude_angles(actual)[2] - phi[:, 2]
    heading_error = phi[:, 2] + (gap + np.pi) % (2.0 * np.pi) - np.pi
    moving = velocity - shaking.velocity(time)
    constant = np.tile(np.concatenate([force_bias[:2], gyro_bias]), (len(time), 1))
    return np.column_stack([moving, phi, heading_error, constant])


def _is_number(value: Any) -> bool:
    return (
        not isinstance(value, bool)
        and isinstance(value, int | float | np.integer | np.floating)
        and bool(np.isfinite(value))
    )
