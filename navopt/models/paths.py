"""Where a vehicle really went, turns and changes of speed included, and what an INS makes of it.

A `Path` is sampled evenly and finely enough for the nonlinear error model (18) of paper 003. It comes from a
list of positions, such as a recorded ship track, or from legs of constant heading and speed. For a straight
voyage `navopt.models.cruise.CruiseScenario` and a strapdown run are the better tools.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.cruise import InsErrors, InsTrack, check_times
from navopt.models.earth import principal_radii
from navopt.models.sins_error import TrueMotion, propagate_ins_errors

__all__ = ["Path", "simulate_ins_along"]

Array = NDArray[np.float64]

#: Below this speed a ship drifts and its course over ground is not its heading, m/s.
STEERAGE = 0.5


@dataclass(frozen=True, kw_only=True)
class Path:
    """Motion of a level vehicle on the ellipsoid, evenly sampled. The arrays are read-only.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds since departure, from zero in equal steps.
    latitude, longitude : ndarray, shape (n,)
        Position, rad; the longitude without a jump.
    velocity : ndarray, shape (n, 2)
        North and east, m/s.
    heading : ndarray, shape (n,)
        Of the forward axis, clockwise from north, rad, without a jump.
    """

    time: Array
    latitude: Array
    longitude: Array
    velocity: Array
    heading: Array

    def __post_init__(self) -> None:
        for item in fields(self):
            getattr(self, item.name).setflags(write=False)

    @property
    def duration(self) -> float:
        """Length of the voyage, s."""
        return float(self.time[-1])

    def at(self, times: ArrayLike) -> tuple[Array, Array, Array]:
        """Return latitude, longitude (rad) and velocity (m/s) at times since departure, shape (N,) each."""
        t = check_times(times, self.duration)
        latitude, longitude, *velocity = (
            np.interp(t, self.time, column) for column in (self.latitude, self.longitude, *self.velocity.T)
        )
        return latitude, longitude, np.stack(velocity, axis=-1)

    def motion(self) -> TrueMotion:
        """Return what the error model (18) needs."""
        return TrueMotion(
            time=self.time, latitude=self.latitude, velocity=self.velocity, heading=self.heading
        )

    @classmethod
    def through(
        cls,
        time: ArrayLike,
        latitude: ArrayLike,
        longitude: ArrayLike,
        *,
        step: float = 10.0,
        smoothing: float = 90.0,
    ) -> Path:
        """Lead a path along recorded positions.

        Parameters
        ----------
        time : array_like, shape (N,)
            Seconds, increasing; the first is the departure.
        latitude, longitude : array_like, shape (N,)
            Recorded positions, rad.
        step : float, keyword-only
            Sampling interval, s.
        smoothing : float, keyword-only
            Standard deviation, s, of the Gaussian weights over which the positions are averaged, so that
            their noise does not become acceleration. Corners are cut by a few times ten metres.

        Returns
        -------
        Path
            The forward axis along the course over ground; held where the vehicle hardly moves.

        Raises
        ------
        InvalidInput
            If the arrays do not fit, times do not increase, or the vehicle never moves.
        """
        from scipy.ndimage import gaussian_filter1d

        t, lat, lon = (np.array(values, dtype=np.float64) for values in (time, latitude, longitude))
        if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all() or (np.diff(t) <= 0.0).any():
            raise InvalidInput("time", t, "give two or more increasing times in seconds")
        for name, values in (("latitude", lat), ("longitude", lon)):
            if values.shape != t.shape or not np.isfinite(values).all():
                raise InvalidInput(name, values, f"give {len(t)} finite angles in radians")
        if not (np.isfinite(step) and 0.0 < step <= t[-1] - t[0]):
            raise InvalidInput("step", step, "give a positive number of seconds, shorter than the track")
        even = step * np.arange(int(np.floor((t[-1] - t[0]) / step)) + 1, dtype=np.float64)
        columns = np.stack([np.interp(even, t - t[0], values) for values in (lat, np.unwrap(lon))])
        if smoothing > 0.0:
            # reflected through the end points, so that the vehicle neither stops nor turns there
            width = min(len(even) - 1, int(np.ceil(4.0 * smoothing / step)))
            padded = np.pad(columns, ((0, 0), (width, width)), mode="reflect", reflect_type="odd")
            columns = gaussian_filter1d(padded, smoothing / step, axis=1)[:, width : width + len(even)]
        meridian, prime_vertical = principal_radii(columns[0])
        velocity = np.gradient(columns, step, axis=1) * [meridian, prime_vertical * np.cos(columns[0])]
        moving = np.hypot(*velocity) > STEERAGE
        if not moving.any():
            raise InvalidInput("latitude, longitude", "positions that hardly change", "give a moving vehicle")
        course = np.unwrap(np.arctan2(velocity[1, moving], velocity[0, moving]))
        return cls(
            time=even,
            latitude=columns[0],
            longitude=columns[1],
            velocity=np.ascontiguousarray(velocity.T),
            heading=np.interp(even, even[moving], course),
        )

    @classmethod
    def of_legs(
        cls,
        latitude: float,
        longitude: float,
        legs: ArrayLike,
        *,
        step: float = 2.0,
        turn_rate: float = float(np.radians(1.0)),
        acceleration: float = 0.05,
    ) -> Path:
        """Follow legs of constant heading and speed, with turns and changes of speed that take time.

        Parameters
        ----------
        latitude, longitude : float
            Departure, rad.
        legs : array_like, shape (K, 3)
            Duration (s), heading (rad, clockwise from north) and speed (m/s) of each leg. The manoeuvre that
            begins a leg is part of it.
        step : float, keyword-only
            Sampling interval, s.
        turn_rate : float, keyword-only
            Rate of turns, rad/s; the short way round.
        acceleration : float, keyword-only
            Of changes of speed, m/s².

        Returns
        -------
        Path

        Raises
        ------
        InvalidInput
            If a duration is not positive, a speed negative, or a value is not finite.
        """
        plan = np.array(legs, dtype=np.float64)
        if plan.ndim != 2 or plan.shape[1] != 3 or not len(plan) or not np.isfinite(plan).all():
            raise InvalidInput("legs", legs, "give rows of duration, heading and speed")
        if (plan[:, 0] <= 0.0).any() or (plan[:, 2] < 0.0).any():
            raise InvalidInput("legs", plan.tolist(), "durations must be positive, speeds not negative")
        for name, value in (("step", step), ("turn_rate", turn_rate), ("acceleration", acceleration)):
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidInput(name, value, "give a positive number")
        ends = np.cumsum(plan[:, 0])
        time = step * np.arange(int(np.floor(ends[-1] / step * (1.0 + 1e-12))) + 1, dtype=np.float64)
        leg = np.minimum(np.searchsorted(ends, time, side="right"), len(plan) - 1)
        since = time - np.concatenate([[0.0], ends])[leg]
        # the headings turn the short way round from one leg to the next
        heading = _ramps(np.unwrap(plan[:, 1]), plan[:, 0], turn_rate, leg, since)
        speed = _ramps(plan[:, 2], plan[:, 0], acceleration, leg, since)
        velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading)], axis=-1)
        place = _integrated(latitude, longitude, velocity, step)
        return cls(time=time, latitude=place[0], longitude=place[1], velocity=velocity, heading=heading)


def _ramps(targets: Array, durations: Array, rate: float, leg: NDArray[np.int64], since: Array) -> Array:
    """Move from target to target at a constant rate, from where the leg before has come to."""
    begins = np.empty(len(targets))
    reached = targets[0]
    for k, (target, duration) in enumerate(zip(targets, durations, strict=True)):
        begins[k] = reached
        reached = reached + np.clip(target - reached, -rate * duration, rate * duration)
    change = targets - begins
    return np.asarray(begins[leg] + np.clip(change[leg], -rate * since, rate * since))


def _integrated(latitude: float, longitude: float, velocity: Array, step: float) -> tuple[Array, Array]:
    """Positions by the trapezoidal rule; the radii depend on the latitude, so it is repeated."""

    def sums(rate: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum(0.5 * step * (rate[1:] + rate[:-1]))])

    lat = np.full(len(velocity), latitude)
    for _ in range(4):  # each repetition gains three digits
        lat = latitude + sums(velocity[:, 0] / principal_radii(lat)[0])
    if np.abs(lat).max() > np.radians(89.0):
        raise InvalidInput("legs", np.degrees(np.abs(lat).max()), "stay more than 1° from the poles")
    return lat, longitude + sums(velocity[:, 1] / (principal_radii(lat)[1] * np.cos(lat)))


def simulate_ins_along(
    path: Path,
    errors: InsErrors,
    *,
    times: ArrayLike,
    rng: np.random.Generator | int | None = None,
) -> InsTrack:
    """Simulate what an INS shows along a path.

    Parameters
    ----------
    path : Path
        The true motion.
    errors : InsErrors
        Biases, initial errors and noise of this INS.
    times : array_like, shape (N,)
        Output times, s since departure.
    rng : numpy.random.Generator or int, optional
        Source of the white noise, or its seed; needed only if there is noise.

    Returns
    -------
    InsTrack
        True and INS-indicated positions and velocities.

    Raises
    ------
    InvalidInput
        If the times are not increasing or leave the path, or noise is asked for without `rng`.
    NumericalFault
        If the errors leave the model.

    Notes
    -----
    The nonlinear errors of eq. (18) of paper 003 are added to the truth. On the paper's straight voyage they
    are those of a strapdown run to 0.1 %.
    """
    wanted = check_times(times, path.duration)
    history = propagate_ins_errors(path.motion(), errors, times=wanted, rng=rng)
    latitude, longitude, velocity = path.at(wanted)
    return InsTrack(
        time=wanted,
        latitude=latitude + history.latitude_error,
        longitude=longitude + history.longitude_error,
        velocity=velocity + history.velocity_error,
        true_latitude=latitude,
        true_longitude=longitude,
        true_velocity=velocity,
        errors=errors,
        # a platform turned by +α_z shows a heading that is α_z too small
        heading=np.interp(wanted, path.time, path.heading) - history.platform_angles[:, 2],
    )
