"""INS errors along a given track, per unit of every error source: what a matcher may shape a track with.

`navopt.models.ins.error_basis` does this by strapdown runs for a simulated voyage. Here the track is
any list of times and positions, for instance what an INS has indicated, turns and changes of speed
included, and the errors move by eq. (18) of paper 003 linearised about it. White noise of the sensors
is taken as a drift that is constant over a block of time, and the many blocks are reduced to the few
shapes that they can give to the track.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.cruise import ALIGNMENT_SOURCES, SOURCES, InsErrors
from navopt.models.earth import SCHULER_PERIOD, principal_radii
from navopt.models.sins_error import _platform_angles
from navopt.models.track_error_steps import ErrorGrid, course_over_ground

__all__ = ["TrackErrorBasis", "heading_error", "track_error_basis"]

Array = NDArray[np.float64]

#: Length of the blocks over which sensor noise is constant, s. Within a block the noise of Table 1 moves
#: the position by less than 20 m.
BLOCK = 900.0
#: Shapes of the noise that move no point of the track by more than this are left out, m (1σ).
NEGLIGIBLE = 15.0
#: Noise channels: three gyros, and the accelerometers forward and right (the third has no effect).
_CHANNELS = 5


@dataclass(frozen=True, kw_only=True)
class TrackErrorBasis:
    """Errors of an INS along a track, for one standard deviation of each of S independent sources.

    The arrays are read-only.

    Attributes
    ----------
    time : ndarray, shape (N,)
        Seconds, as given.
    sources : tuple of str
        Names: of `navopt.models.cruise.SOURCES` and `ALIGNMENT_SOURCES`, then ``noise_1`` …
    scale : ndarray, shape (S,)
        One standard deviation of each source in its own unit (rad/s, m/s², rad, m/s); 1 for noise.
    angle : ndarray, shape (N, 2, S)
        Error of (latitude, longitude), INS minus truth, rad per standard deviation.
    velocity : ndarray, shape (N, 2, S)
        Error of the velocity (north, east), m/s per standard deviation.
    heading : ndarray, shape (N, S)
        Error of the heading, INS minus truth, rad per standard deviation.
    latitude : ndarray, shape (N,)
        Latitude of the track about which the errors are linear, rad.
    sigmas : InsErrors
        What the sources' standard deviations were taken from.
    departure : float
        When the initial errors held, s.
    """

    time: Array
    sources: tuple[str, ...]
    scale: Array
    angle: Array
    velocity: Array
    heading: Array
    latitude: Array
    sigmas: InsErrors
    departure: float

    def __post_init__(self) -> None:
        for array in (self.time, self.scale, self.angle, self.velocity, self.heading, self.latitude):
            array.setflags(write=False)

    @property
    def n_named(self) -> int:
        """Number of the constant sources, which come before the shapes of noise."""
        return sum(not name.startswith("noise_") for name in self.sources)

    @property
    def position(self) -> Array:
        """Position error (north, east), m per standard deviation, shape (N, 2, S)."""
        meridian, prime_vertical = principal_radii(self.latitude)
        metres = np.stack([meridian, prime_vertical * np.cos(self.latitude)], axis=-1)
        return metres[..., None] * self.angle

    def covariance(self) -> Array:
        """Covariance of the position errors (n_1, e_1, n_2, …), m², shape (2 N, 2 N)."""
        columns = self.position.reshape(2 * len(self.time), -1)
        return columns @ columns.T

    def about(
        self,
        latitude: ArrayLike,
        longitude: ArrayLike,
        heading: ArrayLike | None = None,
    ) -> TrackErrorBasis:
        """Linearise the constant sources about another track; the shapes of noise stay as they are.

        Coefficients keep their meaning, so an estimate carries over.

        Parameters
        ----------
        latitude, longitude : array_like, shape (n,)
            Positions at the first n times of this basis, rad; from there on it stays as it is.
        heading : array_like, shape (n,), optional
            As for `track_error_basis`.

        Returns
        -------
        TrackErrorBasis
        """
        lat, lon = np.array(latitude, dtype=np.float64), np.array(longitude, dtype=np.float64)
        given = None if heading is None else np.array(heading, dtype=np.float64)
        size, n = len(lat), self.n_named
        _check(self.time[:size], lat, lon, given)
        grid = ErrorGrid.of(self.time[:size], lat, np.unwrap(lon), given, self.departure)
        whole = np.concatenate([self.angle, self.velocity, self.heading[:, None]], axis=1)
        whole[:size, :, :n] = _named_response(grid, self.sigmas)[2] * self.scale[:n]
        return replace(
            self,
            angle=_part(whole, 0, 2),
            velocity=_part(whole, 2, 4),
            heading=_part(whole, 4, 5)[:, 0],
            latitude=np.concatenate([lat, self.latitude[size:]]),
        )

    def midway(
        self,
        latitude: ArrayLike,
        longitude: ArrayLike,
        a: ArrayLike,
        *,
        heading: ArrayLike | None = None,
        stop: int | None = None,
    ) -> TrackErrorBasis:
        """Linearise midway between what the INS shows and where it is believed to be.

        The equations of motion are quadratic to a good approximation, and for these the difference of two
        motions is linear *exactly* with the coefficients of the motion midway. On the voyage of paper 003
        the superposition of the sources is then within 10 m of a strapdown run after 16 h and an error of
        20 to 60 km, where linearisation about the truth is off by up to 300 m.

        Parameters
        ----------
        latitude, longitude : array_like, shape (N,)
            Positions the INS shows, rad.
        a : array_like, shape (S,)
            Coefficients believed in, in standard deviations.
        heading : array_like, shape (N,), optional
            Heading the INS shows, rad. Without it the true heading is taken to be the course over ground
            of the corrected track, which needs good coefficients: a velocity in error by 1 m/s turns the
            course of a slow vehicle by 10°.
        stop : int, optional
            Renew the first samples only.

        Returns
        -------
        TrackErrorBasis
        """
        part = slice(stop)
        believed = np.asarray(a, dtype=np.float64)
        error = self.angle[part] @ believed
        lat, lon = np.asarray(latitude)[part], np.unwrap(np.asarray(longitude)[part])
        turn = 0.5 * (self.heading[part] @ believed)
        if heading is None:
            ahead = course_over_ground(self.time[part], lat - error[:, 0], lon - error[:, 1])[1] + turn
        else:
            ahead = np.asarray(heading, dtype=np.float64)[part] - turn
        return self.about(lat - 0.5 * error[:, 0], lon - 0.5 * error[:, 1], ahead)


def track_error_basis(
    time: ArrayLike,
    latitude: ArrayLike,
    longitude: ArrayLike,
    sigmas: InsErrors,
    *,
    heading: ArrayLike | None = None,
    departure: float | None = None,
) -> TrackErrorBasis:
    """Return the errors an INS of a given quality makes along a track, source by source.

    Parameters
    ----------
    time : array_like, shape (N,)
        Seconds, increasing; at least two samples.
    latitude, longitude : array_like, shape (N,)
        Positions about which the errors are linear, rad: the INS's own, or better a corrected track.
    sigmas : InsErrors
        1σ of each independent, zero-mean source, and the levels of white noise. A source of zero is left
        out.
    heading : array_like, shape (N,), optional
        Direction of the forward axis, clockwise from north, rad; the course over ground if not given.
    departure : float, optional
        Time at which the initial errors held, at most the first of `time`, which is the default. The
        vehicle is taken to have moved until then as it did between the first two samples.

    Returns
    -------
    TrackErrorBasis

    Raises
    ------
    InvalidInput
        If the arrays do not fit, the times do not increase, or all sources are zero.

    Notes
    -----
    States and rates of `navopt.models.sins_linear`, exponentials over steps of at most 150 s, noise in
    blocks of a quarter of an hour. The vehicle is level. A downward accelerometer bias has no effect to first
    order, so it is left out.
    """
    t, lat, lon = (np.array(values, dtype=np.float64) for values in (time, latitude, longitude))
    given = None if heading is None else np.array(heading, dtype=np.float64)
    _check(t, lat, lon, given)
    start = float(t[0]) if departure is None else float(departure)
    if not start <= t[0]:
        raise InvalidInput("departure", departure, f"give a time not after the first sample, {t[0]:g} s")
    grid = ErrorGrid.of(t, lat, np.unwrap(lon), given, start)
    names, scale, named = _named_response(grid, sigmas)
    noise = _noise_response(grid, sigmas, lat)
    if not named.shape[-1] + noise.shape[-1]:
        raise InvalidInput("sigmas", sigmas, "give at least one error source a positive standard deviation")
    whole = np.concatenate([named * scale, noise], axis=-1)
    return TrackErrorBasis(
        time=t,
        sources=(*names, *(f"noise_{k + 1}" for k in range(noise.shape[-1]))),
        scale=np.concatenate([scale, np.ones(noise.shape[-1])]),
        angle=_part(whole, 0, 2),
        velocity=_part(whole, 2, 4),
        heading=_part(whole, 4, 5)[:, 0],
        latitude=lat,
        sigmas=sigmas,
        departure=start,
    )


def heading_error(
    time: ArrayLike, latitude: ArrayLike, longitude: ArrayLike, heading: ArrayLike, errors: InsErrors
) -> Array:
    """Return how far off the heading of an INS is along a true track, to first order and without noise.

    Parameters
    ----------
    time, latitude, longitude, heading : array_like, shape (N,)
        Seconds and the true motion, rad; N of two or more.
    errors : InsErrors
        The biases and initial errors of the INS.

    Returns
    -------
    ndarray, shape (N,)
        INS minus truth, rad.

    Raises
    ------
    InvalidInput
        As for `track_error_basis`.
    """
    constant = np.concatenate([errors.vector, errors.alignment])
    constant[5] = 0.0  # the accelerometer that points down
    if not constant.any():
        return np.zeros(np.shape(time))
    size = np.abs(constant)
    sizes = InsErrors.from_vector(size[:8], velocity_error=size[8:10], attitude_error=size[10:])
    basis = track_error_basis(time, latitude, longitude, sizes, heading=heading)
    values = dict(zip(SOURCES + ALIGNMENT_SOURCES, np.sign(constant), strict=True))
    return basis.heading @ np.array([values[name] for name in basis.sources])


def _part(whole: Array, first: int, last: int) -> Array:
    return np.ascontiguousarray(whole[:, first:last])


def _named_response(grid: ErrorGrid, sigmas: InsErrors) -> tuple[tuple[str, ...], Array, Array]:
    """Names and 1σ of the constant sources, and the response to a unit of each."""
    names, scale, state, sensors = _columns(sigmas, grid.course)
    return names, scale, grid.respond(state, sensors, np.full(len(grid.sample), -1), len(names))


def _noise_response(grid: ErrorGrid, sigmas: InsErrors, lat: Array) -> Array:
    """Response to the sensors' white noise: the shapes that matter, one standard deviation of each."""
    duration = float(grid.time[-1] - grid.departure)
    blocks = _noise_blocks(sigmas, duration)
    if not len(blocks):
        return np.empty((len(grid.time), 5, 0))
    total = _CHANNELS * len(blocks)
    block = np.minimum((grid.middle - grid.departure) // BLOCK, len(blocks) - 1).astype(int)
    noise = grid.respond(np.zeros((7, total)), np.full(total, -1), block, 0)
    # constant over a block of T seconds, white noise of density q has the variance q²/T; a constant
    # excites the Schuler oscillation less than white noise does, which is made up for
    levels = np.array([sigmas.gyro_noise] * 3 + [sigmas.accelerometer_noise] * 2)
    levels = levels / np.sinc(BLOCK / SCHULER_PERIOD)
    meridian, prime_vertical = principal_radii(lat)
    metres = np.stack([meridian, prime_vertical * np.cos(lat)], axis=-1)
    return _reduced(noise * (levels / np.sqrt(blocks)[:, None]).ravel(), metres)


def _check(t: Array, lat: Array, lon: Array, heading: Array | None) -> None:
    if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all() or (np.diff(t) <= 0.0).any():
        raise InvalidInput("time", t, "give two or more increasing times in seconds")
    for name, values in (("latitude", lat), ("longitude", lon), ("heading", heading)):
        if values is not None and (values.shape != t.shape or not np.isfinite(values).all()):
            raise InvalidInput(name, values, f"give {len(t)} finite angles in radians")
    if np.abs(lat).max() > np.radians(89.0):
        raise InvalidInput("latitude", np.degrees(np.abs(lat).max()), "stay more than 1° from the poles")


def _columns(sigmas: InsErrors, heading: float) -> tuple[tuple[str, ...], Array, Array, NDArray[np.int64]]:
    """Names, 1σ, initial state per unit and sensor (or -1) of every constant source that is not zero."""
    initial: Array = np.zeros((7, 13))
    initial[[0, 1, 2, 3], [6, 7, 8, 9]] = 1.0
    tilt = 1e-6  # rad: the angles of the platform are linear in the attitude to rounding
    for k in range(3):
        initial[4:, 10 + k] = _platform_angles(tilt * np.eye(3)[k], heading) / tilt
    sensors = np.array([0, 1, 2, 3, 4, 5, *[-1] * 7])
    names, values = SOURCES + ALIGNMENT_SOURCES, np.concatenate([sigmas.vector, sigmas.alignment])
    if not (values >= 0.0).all():
        raise InvalidInput("sigmas", sigmas, "standard deviations are not negative")
    used = [k for k in range(13) if values[k] > 0.0 and k != 5]
    return tuple(names[k] for k in used), values[used], initial[:, used], sensors[used]


def _noise_blocks(sigmas: InsErrors, duration: float) -> Array:
    """Lengths of the blocks of sensor noise; none if there is no noise."""
    if not (sigmas.gyro_noise > 0.0 or sigmas.accelerometer_noise > 0.0):
        return np.empty(0)
    count = max(1, round(duration / BLOCK))
    lengths = np.full(count, BLOCK)
    lengths[-1] = duration - BLOCK * (count - 1)
    return lengths


def _reduced(noise: Array, metres: Array) -> Array:
    """Turn the columns so that a few carry all the motion of the positions; drop the rest."""
    position = (noise[:, :2] * metres[..., None]).reshape(2 * len(noise), -1)
    _, vectors = np.linalg.eigh(position.T @ position)
    shapes = position @ vectors
    keep = np.flatnonzero(np.abs(shapes).max(axis=0) > NEGLIGIBLE)[::-1]
    return noise @ vectors[:, keep]
