"""What an alignment with a heading from elsewhere leaves to its filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput, UnknownName
from navopt.models.alignment_sensors import ImuGrade
from navopt.models.azimuth_error import azimuth_constants
from navopt.models.enu_attitude import attitude_angles
from navopt.models.heading_start import (
    alignment_process_noise,
    heading_alignment_start,
    heading_start_covariance,
)
from navopt.models.laser_spot import check_heading
from navopt.models.resting_strapdown import resting_strapdown
from navopt.models.static_alignment import StaticSite

__all__ = [
    "VELOCITIES",
    "HeadingRecord",
    "check_times",
    "prescribed_covariance",
    "readings_on_clock",
    "record_from_imu",
]

Array = NDArray[np.float64]

#: When the two velocities are used: with the clock of the heading (paper 002, section 6.1), or at every step.
VELOCITIES = ("clock", "all")


@dataclass(frozen=True, kw_only=True)
class HeadingRecord:
    """A free run of a system at rest, with headings measured now and then.

    Attributes
    ----------
    site : StaticSite
        Where the system stands.
    grade : ImuGrade
        1 sigma of the errors of its sensors, as declared.
    velocity_sigma, heading_sigma : float
        1 sigma of the disturbance of the velocities (m/s) and of a measured heading (rad), as declared.
    time : ndarray, shape (T + 1,)
        In s, evenly spaced.
    velocity : ndarray, shape (T + 1, 2)
        Computed minus known velocity, east and north, m/s. A system at rest knows zero.
    attitude : ndarray, shape (T + 1, 3, 3)
        C_b^n' as the system computes it.
    heading : ndarray, shape (T + 1,)
        Measured heading, clockwise from north, rad; NaN between readings.
    clock : int
        Steps between two ticks of the measurements' clock.
    constants : ndarray, shape (T, 22)
        Inputs of each step for `navopt.models.azimuth_error.advance`.
    x0, P0 : ndarray, shapes (10,) and (10, 10)
        Mean and covariance of the ten states (no heading error) at the start, as declared.
    states : ndarray, shape (T + 1, 11), or None
        The true errors, of a simulated run, in the order of `STATES_WITH_HEADING`.
    """

    site: StaticSite
    grade: ImuGrade
    velocity_sigma: float
    heading_sigma: float
    time: Array
    velocity: Array
    attitude: Array
    heading: Array
    clock: int
    constants: Array
    x0: Array
    P0: Array
    states: Array | None = None

    def __post_init__(self) -> None:
        for name in ("velocity_sigma", "heading_sigma"):
            value = getattr(self, name)
            if not np.isfinite(value) or not value > 0.0:
                raise InvalidInput(name, value, "give a standard deviation above zero")
        check_times("time", self.time)
        count = len(self.time)
        shapes = {
            "velocity": (count, 2), "attitude": (count, 3, 3), "heading": (count,),
            "constants": (count - 1, 22), "x0": (10,), "P0": (10, 10),
        }  # fmt: skip
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise InvalidInput(name, f"shape {getattr(self, name).shape}", f"give shape {shape}")
        check_heading("heading", self.heading, gaps=True)
        if not np.isfinite(self.velocity).all():
            raise InvalidInput("velocity", "values that are not finite", "leave no gaps")

    @property
    def step(self) -> float:
        """Length of a step, s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def computed_heading(self) -> Array:
        """Heading of the computed attitude, clockwise, rad, shape (T + 1,)."""
        return attitude_angles(self.attitude)[2]

    @property
    def measured_constants(self) -> Array:
        """Inputs of `navopt.models.azimuth_error.heading_measurement` at each time, shape (T + 1, 22)."""
        small = bool(self.constants[0, 21])
        return azimuth_constants(self.site, self.attitude, small_levels=small)

    def measurements(self, velocities: str = "clock") -> Array:
        """Return Z of eq (13): both velocities and the computed minus the measured heading.

        Parameters
        ----------
        velocities : {"clock", "all"}
            At which times the velocities are used.

        Returns
        -------
        ndarray, shape (T + 1, 3)
            In m/s and rad in [-pi, pi); NaN where nothing is measured, which includes the start.
        """
        if velocities not in VELOCITIES:
            raise UnknownName("velocities", velocities, VELOCITIES)
        z = np.full((len(self.time), 3), np.nan)
        ticks = slice(self.clock, None, self.clock) if velocities == "clock" else slice(1, None)
        z[ticks, :2] = self.velocity[ticks]
        gap = self.computed_heading - self.heading
        z[1:, 2] = ((gap + np.pi) % (2.0 * np.pi) - np.pi)[1:]
        return z

    @property
    def measurement_covariance(self) -> Array:
        """R of the three measurements as declared, shape (3, 3)."""
        return np.diag([self.velocity_sigma**2] * 2 + [self.heading_sigma**2])

    def process_covariance(self, *, with_heading: bool, correlated: bool = True) -> Array:
        """Q of one step as declared, shape (11, 11) or (10, 10); see `alignment_process_noise`."""
        return alignment_process_noise(
            self.site, self.grade, self.step, self.attitude[0], angles=self.x0[2:5],
            with_heading=with_heading, correlated=correlated,
        )  # fmt: skip


def check_times(name: str, time: ArrayLike) -> Array:
    """Return times in s if they rise evenly, or refuse them.

    Raises
    ------
    InvalidInput
        If they are not finite, do not rise, or leave gaps.
    """
    t = np.asarray(time, dtype=np.float64)
    if t.ndim != 1 or len(t) < 3 or not np.isfinite(t).all():
        raise InvalidInput(name, f"shape {t.shape}", "give three times or more, finite, in s")
    gaps = np.diff(t)
    if not (gaps > 0.0).all():
        k = int(np.flatnonzero(gaps <= 0.0)[0])
        raise InvalidInput(f"{name}[{k + 1}]", f"{t[k + 1]:g} after {t[k]:g}", "give times that rise")
    middle = float(np.median(gaps))
    if np.abs(gaps - middle).max() > 0.5 * middle:
        k = int(np.abs(gaps - middle).argmax())
        raise InvalidInput(
            f"{name}[{k + 1}]", f"{gaps[k]:g} s after the one before", f"sample evenly, every {middle:g} s"
        )
    return t


def readings_on_clock(time: ArrayLike, readings: ArrayLike, grid: Array) -> tuple[Array, int]:
    """Put headings with times of their own on the times of the steps.

    Parameters
    ----------
    time, readings : array_like, shape (M,)
        When each heading was measured, s, and the heading, rad; NaN where one failed.
    grid : ndarray, shape (T + 1,)
        Times of the steps.

    Returns
    -------
    heading : ndarray, shape (T + 1,)
        Each reading at the nearest time, NaN elsewhere.
    clock : int
        Steps between two readings, the median.

    Raises
    ------
    InvalidInput
        If the times do not rise, or two readings fall into one step.
    """
    t = np.asarray(time, dtype=np.float64)
    values = check_heading("heading", readings, gaps=True)
    if t.ndim != 1 or t.shape != values.shape or len(t) < 2 or not np.isfinite(t).all():
        raise InvalidInput("heading_time", f"shape {t.shape}", "give a finite time for each heading")
    if not (np.diff(t) > 0.0).all():
        k = int(np.flatnonzero(np.diff(t) <= 0.0)[0])
        raise InvalidInput(f"heading_time[{k + 1}]", f"{t[k + 1]:g} after {t[k]:g}", "give times that rise")
    step = float(grid[-1] - grid[0]) / (len(grid) - 1)
    every = float(np.median(np.diff(t)))
    places = np.rint((t - grid[0]) / step).astype(np.int64)
    inside = (places >= 0) & (places < len(grid))
    if every < step * (1.0 - 1e-6) or (np.diff(places[inside]) == 0).any():
        raise InvalidInput(
            "heading_time",
            f"headings every {every:g} s",
            f"the filter predicts every {step:g} s: raise its rate, or thin the headings",
        )
    out = np.full(len(grid), np.nan)
    out[places[inside]] = values[inside]
    return out, max(1, round(every / step))


def record_from_imu(
    time: ArrayLike,
    gyro: ArrayLike,
    accelerometer: ArrayLike,
    heading_time: ArrayLike,
    heading: ArrayLike,
    site: StaticSite,
    grade: ImuGrade,
    *,
    coarse_s: float = 10.0,
    velocity_sigma: float = 0.1,
    heading_sigma: float,
    heading_bias_sigma: float = 0.0,
    every: int = 1,
    attitude: ArrayLike | None = None,
    prior_sigma: ArrayLike | None = None,
) -> HeadingRecord:
    """Make a record from the readings of a system at rest and headings from elsewhere.

    Parameters
    ----------
    time : array_like, shape (N,)
        Of the inertial readings, s, even.
    gyro, accelerometer : array_like, shape (N, 3)
        Axes right, forward, up, means over the step that ends at each time, rad/s and m/s^2.
    heading_time, heading : array_like, shape (M,)
        When headings were measured (s, the same clock) and what they are: clockwise from north, rad, NaN
        where one failed.
    site, grade
        Where the system stood, and 1 sigma of its sensors.
    coarse_s : float
        Length of the coarse start, s; the run begins where it ends.
    velocity_sigma : float
        1 sigma of the velocity with which the machine sways, m/s.
    heading_sigma : float
        1 sigma of one heading, rad.
    heading_bias_sigma : float
        1 sigma of what is wrong with all headings alike, rad.
    every : int
        How many readings make a step of the filter.
    attitude : array_like, shape (3, 3), optional
        C_b^n' to start from, instead of the coarse start.
    prior_sigma : array_like, shape (3,), optional
        1 sigma of phi_E, phi_N, phi_U of that attitude, rad; required with it.

    Returns
    -------
    HeadingRecord
        Without a truth.

    Raises
    ------
    InvalidInput
        One for each thing that cannot be used: times that do not rise, headings in degrees or more often than
        the filter predicts, a variance that is not positive, an input that is not that of rest.
    """
    t = check_times("time", time)
    w, f = (np.ascontiguousarray(v, dtype=np.float64) for v in (gyro, accelerometer))
    if w.shape != (len(t), 3) or f.shape != (len(t), 3):
        raise InvalidInput("gyro", f"shapes {w.shape} and {f.shape}", f"give shape ({len(t)}, 3) each")
    readings = check_heading("heading", heading, gaps=True)
    when = np.asarray(heading_time, dtype=np.float64)
    if when.ndim != 1 or when.shape != readings.shape:
        raise InvalidInput("heading_time", f"shape {when.shape}", "give a finite time for each heading")
    step = float(t[-1] - t[0]) / (len(t) - 1)
    for name, value, least in (
        ("velocity_sigma", velocity_sigma, True), ("heading_sigma", heading_sigma, True),
        ("heading_bias_sigma", heading_bias_sigma, False),
    ):  # fmt: skip
        if not np.isfinite(value) or value < 0.0 or (least and not value > 0.0):
            raise InvalidInput(name, value, "give a standard deviation above zero")
    first = round(coarse_s / step)
    if len(t) < first + 10 * every:
        raise InvalidInput("time", f"{t[-1] - t[0]:g} s", f"give more than coarse_s, {coarse_s:g} s")
    if attitude is None:
        early = (when >= t[0] - step) & (when <= t[first - 1])
        if not early.any():
            raise InvalidInput("heading", "no reading in the coarse start", "lengthen coarse_s")
        start = heading_alignment_start(
            w[:first], f[:first], readings[early], site, gyro_error=grade.gyro_bias
        ).attitude
        count = int(np.isfinite(readings[early]).sum())
        P0 = heading_start_covariance(
            site, start, grade, duration=coarse_s, velocity_sigma=velocity_sigma,
            heading_sigma=float(np.hypot(heading_sigma / np.sqrt(count), heading_bias_sigma)),
        )  # fmt: skip
    else:
        start = np.asarray(attitude, dtype=np.float64)
        sigma = np.asarray(prior_sigma, dtype=np.float64)
        if sigma.shape != (3,) or not (np.isfinite(sigma) & (sigma > 0.0)).all():
            raise InvalidInput("prior_sigma", prior_sigma, "give three standard deviations, rad, above zero")
        P0 = prescribed_covariance(grade, sigma, velocity_sigma)
    run = resting_strapdown(w[first:], f[first:], step, site, start, every=every)
    grid = t[first - 1 if first else 0] + step * every * np.arange(len(run.velocity))
    measured, clock = readings_on_clock(when, readings, grid)
    return HeadingRecord(
        site=site, grade=grade, velocity_sigma=float(velocity_sigma), heading_sigma=float(heading_sigma),
        time=grid, velocity=run.velocity, attitude=run.attitude, heading=measured, clock=clock,
        constants=run.constants, x0=np.zeros(10), P0=P0,
    )  # fmt: skip


def prescribed_covariance(grade: ImuGrade, angle_sigma: ArrayLike, velocity_sigma: float) -> Array:
    """Return a diagonal covariance of the ten states: velocity, angles, and the sensors' biases."""
    sigma = np.concatenate(
        [
            [velocity_sigma] * 2,
            np.asarray(angle_sigma, dtype=np.float64),
            [grade.accelerometer_bias] * 2,
            [grade.gyro_bias] * 3,
        ]
    )
    return np.diag(sigma**2)
