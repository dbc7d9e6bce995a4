"""The start of an alignment with a heading from elsewhere: level from the accelerometers, azimuth from it.

What such a start is wrong by is known to first order: a tilt of the accelerometers' errors over gravity,
the very biases that the filter estimates, and an azimuth of the heading's error. A filter that is told less
(errors independent of the biases, or a heading error independent of the azimuth) believes that it can tell
apart what it cannot, or that it knows nothing of what it was just told.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.alignment_sensors import ImuGrade, coarse_covariance
from navopt.models.azimuth_error import azimuth_constants, heading_measurement, heading_slope
from navopt.models.coarse_alignment import CoarseAlignment, coarse_alignment
from navopt.models.enu_attitude import attitude_angles
from navopt.models.laser_spot import check_heading
from navopt.models.static_alignment import AlignmentModel, StaticSite

__all__ = [
    "alignment_process_noise",
    "heading_alignment_start",
    "heading_start_covariance",
    "mean_heading",
    "with_heading_state",
]

Array = NDArray[np.float64]


def mean_heading(headings: ArrayLike) -> float:
    """Return the mean of headings (rad, NaN where one is missing) on the circle, in (-pi, pi].

    Raises
    ------
    InvalidInput
        If there is none, one is in degrees, or they point everywhere.
    """
    values = check_heading("heading", headings, gaps=True)
    known = values[~np.isnan(values)]
    if not known.size:
        raise InvalidInput("heading", "no reading", "give one heading or more")
    sine, cosine = float(np.sin(known).mean()), float(np.cos(known).mean())
    if np.hypot(sine, cosine) < 0.5:
        raise InvalidInput("heading", "readings all around", "a mean heading needs readings that agree")
    return float(np.arctan2(sine, cosine))


def heading_alignment_start(
    gyro: ArrayLike,
    accelerometer: ArrayLike,
    headings: ArrayLike,
    site: StaticSite,
    *,
    gyro_error: float = 0.0,
) -> CoarseAlignment:
    """Align coarsely: level from the mean specific force, azimuth from the mean of measured headings.

    Parameters
    ----------
    gyro, accelerometer : array_like, shape (N, 3)
        Readings at rest, axes right, forward, up, rad/s and m/s^2. The gyros are only looked at.
    headings : array_like, shape (M,)
        Clockwise from north, rad; NaN where one is missing.
    site : StaticSite
        Where the system stands.
    gyro_error : float
        See `navopt.models.coarse_alignment.coarse_alignment`.

    Returns
    -------
    CoarseAlignment
        With method ``"levelled"``.
    """
    return coarse_alignment(
        gyro, accelerometer, site.latitude, heading=mean_heading(headings), gyro_error=gyro_error,
        gravity=site.g,
    )  # fmt: skip


def heading_start_covariance(
    site: StaticSite,
    attitude: ArrayLike,
    grade: ImuGrade,
    *,
    duration: float,
    heading_sigma: float,
    velocity_sigma: float,
) -> Array:
    """Return the covariance of the ten states after `heading_alignment_start`: its error budget.

    Parameters
    ----------
    site, attitude, grade
        See `navopt.models.alignment_sensors.coarse_covariance`.
    duration : float
        Of the coarse alignment, s.
    heading_sigma : float
        1 sigma of the mean heading, constant errors included, rad: `LaserSpot.heading_sigma`.
    velocity_sigma : float
        1 sigma of the velocity at the start, m/s.

    Returns
    -------
    ndarray, shape (10, 10)
        The roots of its diagonal are the budget. With the nose up or down, a tilt turns the heading for a
        given azimuth, so that the azimuth of a known heading takes part in the tilt: this is what
        `coarse_covariance` leaves out.
    """
    P = coarse_covariance(
        site, attitude, grade, duration=duration, heading_sigma=heading_sigma, velocity_sigma=velocity_sigma
    )
    pitch, _, heading = (float(angle) for angle in attitude_angles(attitude))
    turn = np.eye(10)
    turn[4, 2], turn[4, 3] = np.tan(pitch) * np.sin(heading), np.tan(pitch) * np.cos(heading)
    return turn @ P @ turn.T


def with_heading_state(
    mean: ArrayLike,
    covariance: ArrayLike,
    constants: ArrayLike,
    *,
    correlated: bool = True,
    extra: float = 0.0,
) -> tuple[Array, Array]:
    """Add the heading error, as the sixth state, to the mean and the covariance of ten.

    Parameters
    ----------
    mean, covariance : array_like, shapes (10,) and (10, 10)
        Of the states without it.
    constants : array_like, shape (22,)
        Inputs at that time, see `navopt.models.azimuth_error.azimuth_constants`.
    correlated : bool
        Whether the heading error varies with the angles, of which it is a function. False gives it the same
        variance and no correlation, as a diagonal P0 has it: the measured heading then says nothing about the
        azimuth that was wrong at the start, only about its changes.
    extra : float
        Variance that is added to that of the heading error, rad^2, so that the covariance has full rank.

    Returns
    -------
    mean : ndarray, shape (11,)
    covariance : ndarray, shape (11, 11)
    """
    x, P = np.asarray(mean, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    if x.shape != (10,) or P.shape != (10, 10):
        raise InvalidInput("mean, covariance", (x.shape, P.shape), "give ten states")
    if not np.isfinite(extra) or extra < 0.0:
        raise InvalidInput("extra", extra, "give a variance, zero or more")
    slope = heading_slope(x[2:5], constants)
    old = [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]
    reach = np.zeros((11, 10))
    reach[old, np.arange(10)] = 1.0
    reach[5, 2:5] = slope
    full = reach @ P @ reach.T
    full[5, 5] += extra
    if not correlated:
        full[5, :5] = full[5, 6:] = 0.0
        full[:5, 5] = full[6:, 5] = 0.0
    new = np.zeros(11)
    new[old] = x
    new[5] = heading_measurement(x, np.ascontiguousarray(constants, dtype=np.float64))
    return new, full


def alignment_process_noise(
    site: StaticSite,
    grade: ImuGrade,
    step: float,
    attitude: ArrayLike,
    *,
    angles: ArrayLike = (0.0, 0.0, 0.0),
    with_heading: bool,
    correlated: bool = True,
) -> Array:
    """Return the covariance that the noise of the sensors adds to the states in a step.

    Parameters
    ----------
    site, grade
        Place, and noise of the sensors.
    step : float
        In s.
    attitude : array_like, shape (3, 3)
        C_b^n' as computed. Noise that is equal on all axes does not depend on it; the heading error does,
        by the pitch.
    angles : array_like, shape (3,)
        phi where the heading error is linearised.
    with_heading : bool
        Eleven states, or ten.
    correlated : bool
        Whether the noise of the heading error is that of the angles, which make it, or independent of them.

    Returns
    -------
    ndarray, shape (11, 11) or (10, 10)
        Of the linear model over a step, whose terms of the step's third power couple velocities and angles.
    """
    small = AlignmentModel.of(site, step, attitude).process_covariance(
        grade.accelerometer_noise, grade.gyro_noise
    )
    Q = np.zeros((10, 10))
    Q[:5, :5] = small
    if not with_heading:
        return Q
    x = np.zeros(10)
    x[2:5] = angles
    return with_heading_state(x, Q, azimuth_constants(site, attitude), correlated=correlated)[1]
