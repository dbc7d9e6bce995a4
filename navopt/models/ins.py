"""An inertial track by strapdown simulation, and its errors by linearity.

`simulate_ins` makes the error-free readings of a voyage once per process (the slow part), spoils a copy with
biases and noise and lets python-ins's strapdown algorithm integrate them with the vertical channel held, as a
depth gauge would. That is a *world*: about 0.2 s for sixteen hours at 1 Hz.

Over such a voyage the errors are very nearly linear in their sources, so `error_basis` runs the strapdown
once per source and gives the error per unit of each. From it follow a track at no cost
(`linear_ins_track`) and the joint covariance of the errors at many times (`position_error_covariance`), which
is the prior of anyone who matches the track against a map.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput, NumericalFault, UnknownName
from navopt.models.cruise import (
    ALIGNMENT_SOURCES,
    SOURCES,
    CruiseScenario,
    InsErrors,
    InsTrack,
    check_times,
)
from navopt.models.earth import ARC_MINUTE, principal_radii

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "ErrorBasis",
    "error_basis",
    "linear_ins_track",
    "position_error_covariance",
    "simulate_ins",
    "velocity_error_covariance",
]

Array = NDArray[np.float64]


@lru_cache(maxsize=4)
def _perfect_readings(scenario: CruiseScenario) -> tuple[pd.Series, pd.DataFrame]:
    """Make the initial state and the error-free increments of a voyage, in python-ins's tables (degrees)."""
    from pyins import sim

    time = scenario.time_step * np.arange(scenario.steps + 1)
    latitude, longitude = scenario.position(time)
    lla = np.column_stack([np.degrees(latitude), np.degrees(longitude), np.zeros_like(time)])
    rph = np.zeros((len(time), 3))
    rph[:, 2] = np.degrees(scenario.azimuth)
    velocity = np.tile([*scenario.velocity, 0.0], (len(time), 1))
    trajectory, imu = sim.generate_imu(time, lla, rph, velocity, "increment")
    return trajectory.iloc[0], imu


def _strapdown(scenario: CruiseScenario, errors: InsErrors, rng: np.random.Generator | int | None) -> Array:
    """Run the strapdown: latitude, longitude (rad), v_N, v_E at every sample, shape (steps + 1, 4)."""
    from pyins import strapdown

    start, perfect = _perfect_readings(scenario)
    step = scenario.time_step
    readings = perfect.to_numpy(copy=True)
    readings += step * np.array([*errors.gyro_bias, *errors.accelerometer_bias])
    if errors.gyro_noise or errors.accelerometer_noise:
        if rng is None:
            raise InvalidInput("rng", rng, "give a seed or a numpy Generator: these errors contain noise")
        noise = np.random.default_rng(rng).standard_normal(readings.shape) * np.sqrt(step)
        readings += noise * np.repeat([errors.gyro_noise, errors.accelerometer_noise], 3)
    table = type(perfect)(readings, index=perfect.index, columns=perfect.columns)
    increments = strapdown.compute_increments_from_imu(table, "increment")
    initial = start.copy()
    initial[["lat", "lon"]] += np.degrees([errors.latitude_error, errors.longitude_error])
    initial[["VN", "VE"]] += np.array(errors.velocity_error)
    initial[["roll", "pitch", "heading"]] += np.degrees(errors.attitude_error)
    table = strapdown.Integrator(initial, with_altitude=False).integrate(increments)
    result = table[["lat", "lon", "VN", "VE"]].to_numpy(copy=True)
    if not np.all(np.isfinite(result)):
        raise NumericalFault(f"the strapdown run diverged for {errors!r}")
    result[:, :2] *= np.pi / 180.0
    return result


def _sample(scenario: CruiseScenario, states: Array, times: Array) -> Array:
    """States at the times wanted: taken at a sample, or linear between two (0.2 mm off at 1 Hz)."""
    grid = scenario.time_step * np.arange(scenario.steps + 1)
    return np.stack([np.interp(times, grid, column) for column in states.T], axis=-1)


def _track(scenario: CruiseScenario, errors: InsErrors, times: Array, states: Array) -> InsTrack:
    latitude, longitude = scenario.position(times)
    return InsTrack(
        time=times,
        latitude=states[:, 0],
        longitude=states[:, 1],
        velocity=states[:, 2:],
        true_latitude=latitude,
        true_longitude=longitude,
        true_velocity=np.tile(scenario.velocity, (len(times), 1)),
        errors=errors,
    )


def simulate_ins(
    scenario: CruiseScenario,
    errors: InsErrors,
    *,
    times: ArrayLike | None = None,
    rng: np.random.Generator | int | None = None,
) -> InsTrack:
    """Simulate what an INS shows on a voyage.

    Parameters
    ----------
    scenario : CruiseScenario
        The true voyage.
    errors : InsErrors
        Biases, initial errors and noise of this INS.
    times : array_like, shape (N,), optional
        Output times, s since departure; every 60 s by default.
    rng : numpy.random.Generator or int, optional
        Source of the white noise, or its seed; needed only if there is noise.

    Returns
    -------
    InsTrack
        True and INS-indicated positions and velocities.

    Raises
    ------
    InvalidInput
        If the times are not increasing or leave the voyage, or noise is asked for without `rng`.
    NumericalFault
        If the integration diverges.

    Notes
    -----
    Strapdown of python-ins (Savage's coning and sculling). Vertical channel held: eq (18) of paper 003 as
    printed integrates δv_D freely, which grows by e^100 within 16 h; a submarine has a depth gauge. An
    error-free run is within 5 m of the truth at 16 h, which is the scheme's own error.

    Examples
    --------
    >>> track = simulate_ins(CruiseScenario(), InsErrors.published(noise=False), times=[10800.0])
    >>> float(np.hypot(*track.position_error[0]).round(-1))
    8660.0
    """
    wanted = check_times(scenario.times() if times is None else times, scenario.duration)
    states = _strapdown(scenario, errors, rng)
    return _track(scenario, errors, wanted, _sample(scenario, states, wanted))


# How far each source is turned up to measure its response: Table 1's magnitudes, or of their kind. A
# hundredth of them, or differences to both sides, change the superposition error by 6 m of 84 only.
_STEPS: dict[str, float] = dict(zip(SOURCES, InsErrors.published(noise=False).vector, strict=True)) | {
    "velocity_error_north": 0.1,
    "velocity_error_east": 0.1,
    "roll_error": 0.1 * ARC_MINUTE,
    "pitch_error": 0.1 * ARC_MINUTE,
    "heading_error": 1.0 * ARC_MINUTE,
}


def _single(source: str, value: float) -> InsErrors:
    vector, alignment = np.zeros(8), np.zeros(5)
    if source in SOURCES:
        vector[SOURCES.index(source)] = value
    else:
        alignment[ALIGNMENT_SOURCES.index(source)] = value
    return InsErrors.from_vector(vector, velocity_error=alignment[:2], attitude_error=alignment[2:])


@lru_cache(maxsize=4)
def _reference_run(scenario: CruiseScenario) -> Array:
    return _strapdown(scenario, InsErrors(), None)


@lru_cache(maxsize=4 * 13)
def _response(scenario: CruiseScenario, source: str) -> Array:
    """Change of (latitude, longitude, v_N, v_E) per unit of one source at every sample."""
    step = _STEPS[source]
    return (_strapdown(scenario, _single(source, step), None) - _reference_run(scenario)) / step


def _metres(latitude: Array) -> Array:
    """Metres per radian of latitude and of longitude, shape (N, 2)."""
    meridian, prime_vertical = principal_radii(latitude)
    return np.stack([meridian, prime_vertical * np.cos(latitude)], axis=-1)


@dataclass(frozen=True, kw_only=True)
class ErrorBasis:
    """Errors of an INS per unit of each of S sources, at N times. The arrays are read-only.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Seconds since departure.
    sources : tuple of str
        From `SOURCES` and `ALIGNMENT_SOURCES`; their units are SI and radians.
    angle : ndarray, shape (N, 2, S)
        Error of (latitude, longitude), rad per unit.
    velocity : ndarray, shape (N, 2, S)
        Error of the velocity (north, east), m/s per unit.
    latitude, longitude : ndarray, shape (N,)
        True position, rad.
    """

    time: Array
    sources: tuple[str, ...]
    angle: Array
    velocity: Array
    latitude: Array
    longitude: Array

    def __post_init__(self) -> None:
        for array in (self.time, self.angle, self.velocity, self.latitude, self.longitude):
            array.setflags(write=False)

    @property
    def position(self) -> Array:
        """Position error (north, east), m per unit, with the scales of the true latitude; shape (N, 2, S)."""
        return _metres(self.latitude)[..., None] * self.angle


def error_basis(
    scenario: CruiseScenario, times: ArrayLike | None = None, *, sources: tuple[str, ...] = SOURCES
) -> ErrorBasis:
    """Return the INS error per unit of each source, one strapdown run per source.

    The runs are kept for the last four voyages of the process, so that a second call costs nothing.

    Parameters
    ----------
    scenario : CruiseScenario
        The voyage.
    times : array_like, shape (N,), optional
        Times, s since departure; every 60 s by default.
    sources : tuple of str
        The paper's eight by default, see `ALIGNMENT_SOURCES` for five more.

    Returns
    -------
    ErrorBasis
        Position and velocity errors per unit.

    Raises
    ------
    InvalidInput
        If the times are not increasing or leave the voyage, or a source is not known.

    Notes
    -----
    On the paper's voyage the sum over the sources of Table 1 differs from a strapdown run with all of them
    at once by 5 m at 3 h, 26 m at 7 h and 84 m at 16 h (of 35 km). For draws from N(0, Table 1) at 16 h the
    median is 18 m, nine in ten stay below 125 m and the largest of 80 was 340 m: the error is quadratic. The
    accelerometer that points down has no first-order effect, as the vertical channel is held.
    """
    wanted = check_times(scenario.times() if times is None else times, scenario.duration)
    for source in sources:
        if source not in _STEPS:
            raise UnknownName("sources", source, _STEPS)
    latitude, longitude = scenario.position(wanted)
    response = np.stack([_sample(scenario, _response(scenario, s), wanted) for s in sources], axis=-1)
    return ErrorBasis(
        time=wanted,
        sources=tuple(sources),
        angle=response[:, :2],
        velocity=response[:, 2:],
        latitude=latitude,
        longitude=longitude,
    )


def _active(errors: InsErrors) -> tuple[tuple[str, ...], Array]:
    """List the sources that matter and their values: the five of alignment only if one is not zero."""
    if np.any(errors.alignment):
        return SOURCES + ALIGNMENT_SOURCES, np.concatenate([errors.vector, errors.alignment])
    return SOURCES, errors.vector


def linear_ins_track(
    scenario: CruiseScenario,
    errors: InsErrors,
    *,
    times: ArrayLike | None = None,
    rng: np.random.Generator | int | None = None,
) -> InsTrack:
    """Return what an INS shows, by superposition of the error basis: a world in a millisecond.

    Parameters
    ----------
    scenario : CruiseScenario
        The true voyage.
    errors : InsErrors
        Biases, initial errors and noise of this INS.
    times : array_like, shape (N,), optional
        Output times, s since departure; every 60 s by default.
    rng : numpy.random.Generator or int, optional
        Source of the white noise, or its seed; needed only if there is noise. The same seed gives another
        realisation than in `simulate_ins`, with the same covariance.

    Returns
    -------
    InsTrack
        True and INS-indicated positions and velocities, without the scheme's own error of `simulate_ins`.

    Raises
    ------
    InvalidInput
        As for `simulate_ins`.
    """
    wanted = check_times(scenario.times() if times is None else times, scenario.duration)
    sources, values = _active(errors)
    basis = error_basis(scenario, wanted, sources=sources)
    states = np.concatenate([basis.angle @ values, basis.velocity @ values], axis=-1)
    if errors.gyro_noise or errors.accelerometer_noise:
        if rng is None:
            raise InvalidInput("rng", rng, "give a seed or a numpy Generator: these errors contain noise")
        from navopt.models.sins_linear import draw_noise_errors

        states += draw_noise_errors(scenario, wanted, errors, np.random.default_rng(rng))[:, :4]
    states[:, 0] += basis.latitude
    states[:, 1] += basis.longitude
    states[:, 2:] += scenario.velocity
    return _track(scenario, errors, wanted, states)


def _covariance(scenario: CruiseScenario, times: ArrayLike, sigmas: InsErrors, quantity: str) -> Array:
    wanted = check_times(times, scenario.duration)
    sources, values = _active(sigmas)
    basis = error_basis(scenario, wanted, sources=sources)
    n = len(wanted)
    response = getattr(basis, quantity).reshape(2 * n, -1) * values
    covariance = response @ response.T
    if sigmas.gyro_noise or sigmas.accelerometer_noise:
        from navopt.models.sins_linear import noise_covariance

        block = slice(0, 2) if quantity == "position" else slice(2, 4)
        joint = noise_covariance(scenario, wanted, sigmas)[:, block, :, block]
        scale = _metres(basis.latitude) if quantity == "position" else np.ones((n, 2))
        covariance += (scale[:, :, None, None] * joint * scale).reshape(2 * n, 2 * n)
    return 0.5 * (covariance + covariance.T)


def position_error_covariance(scenario: CruiseScenario, times: ArrayLike, sigmas: InsErrors) -> Array:
    """Return the joint covariance of the INS position errors at several times.

    Parameters
    ----------
    scenario : CruiseScenario
        The voyage.
    times : array_like, shape (N,)
        Times, s since departure.
    sigmas : InsErrors
        1σ of each independent, zero-mean source, and the levels of white noise.

    Returns
    -------
    ndarray, shape (2 N, 2 N)
        Covariance of (n_1, e_1, n_2, e_2, …), m², as ``track.position_error.ravel()``. Three sigma per axis
        and time, the half-width of the paper's search scope, is ``3 * np.sqrt(np.diag(C)).reshape(-1, 2)``.

    Raises
    ------
    InvalidInput
        If the times are not increasing or leave the voyage.

    Notes
    -----
    Constant sources through `error_basis`; without noise the rank is at most their number. White noise
    through the linear form of eq (18), `navopt.models.sins_linear`.
    """
    return _covariance(scenario, times, sigmas, "position")


def velocity_error_covariance(scenario: CruiseScenario, times: ArrayLike, sigmas: InsErrors) -> Array:
    """Return the joint covariance of the INS velocity errors at several times.

    It bounds how much the INS stretches (3σ/V) and turns (3σ/V rad) a piece of track.

    Parameters
    ----------
    scenario, times, sigmas
        As for `position_error_covariance`.

    Returns
    -------
    ndarray, shape (2 N, 2 N)
        Covariance of (v_N, v_E) at the first time, the second, …, (m/s)².

    """
    return _covariance(scenario, times, sigmas, "velocity")
