"""How the position error of an inertial track moves: the prior of the filters that follow it over a map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from baselines.track_model import declared_errors
from navopt.errors import InvalidInput
from navopt.models.cruise import InsErrors
from navopt.models.earth import EARTH_RATE, MILLIGAL, principal_radii
from navopt.models.track_errors import TrackErrorBasis, track_error_basis
from navopt.problems.gravity_sensing import MeasurementErrors

__all__ = [
    "ErrorProcess",
    "declared",
    "inertial_process",
    "metres_per_radian",
    "random_walk_process",
    "random_walk_steps",
]

DAY = 86400.0


@dataclass(frozen=True)
class ErrorProcess:
    """Position error (north, east) of an INS at N samples: ``B_k a + w_k``, INS minus truth, m.

    ``a`` is standard normal and constant; ``w`` is a random walk that begins at zero.

    Attributes
    ----------
    time : ndarray, shape (N,)
        Seconds.
    response : ndarray, shape (N, 2, S)
        B_k, m.
    walk_root : ndarray, shape (N, 2, 2), or None
        A root of the covariance of the step of the walk to each sample, m; zero for the first. None where
        there is no walk.
    offset : ndarray, shape (N, S), or None
        What a coefficient adds to a measured value, in the unit of the field.
    about : callable, optional
        Takes coefficients a, shape (S,), and returns the process linearised about the error they stand for;
        the coefficients keep their meaning. None where the process is linear.
    """

    time: np.ndarray
    response: np.ndarray
    walk_root: np.ndarray | None = None
    offset: np.ndarray | None = None
    about: Callable[[np.ndarray], ErrorProcess] | None = None

    def covariance(self) -> np.ndarray:
        """Covariance of (n_1, e_1, n_2, ...), m^2, shape (2 N, 2 N)."""
        n = len(self.time)
        columns = self.response.reshape(2 * n, -1)
        total = columns @ columns.T
        if self.walk_root is not None:
            sums = np.cumsum(self.walk_root @ self.walk_root.transpose(0, 2, 1), axis=0)
            first = np.minimum.outer(np.arange(n), np.arange(n))
            total += sums[first].transpose(0, 2, 1, 3).reshape(2 * n, 2 * n)
        return total


def inertial_process(
    track: Any,
    sigmas: InsErrors,
    *,
    sensing: MeasurementErrors | None = None,
    heading: np.ndarray | None = None,
    negligible: float = 50.0,
    walk: float = 0.0,
) -> ErrorProcess:
    """Errors of an INS by the linear error model along its own track.

    Parameters
    ----------
    track : MeasuredTrack
        Times and INS positions.
    sigmas : InsErrors
        1 sigma of each source of error, and the levels of white noise.
    sensing : MeasurementErrors, optional
        A drift of the sensor, and whether velocity errors enter by the Eotvos effect; nothing else of it is
        used here.
    heading : ndarray, shape (N,), optional
        Heading that the INS shows, rad; the course over ground if not given.
    negligible : float
        Shapes of the sensor noise that move no point by more than this are left out, m (1 sigma).
    walk : float
        Random walk added for what the model lacks, m per root second.

    Returns
    -------
    ErrorProcess
        Linearised about the INS's track; its ``about`` linearises midway between that and a corrected one.

    Raises
    ------
    InvalidInput
        As `navopt.models.track_errors.track_error_basis`.
    """
    # metres by the scales of the INS's own latitude, by which the filters turn them back into angles
    metres = metres_per_radian(track.latitude)[..., None]
    longitude = np.unwrap(track.longitude)
    basis = track_error_basis(track.time, track.latitude, longitude, sigmas, heading=heading)
    named = np.array([not name.startswith("noise_") for name in basis.sources])
    keep = named | (np.abs(metres * basis.angle).max(axis=(0, 1)) > negligible)
    eotvos = sensing is not None and sensing.eotvos
    drift = 0.0 if sensing is None else sensing.drift_per_day / DAY
    extra = int(drift > 0.0)
    root = None
    if walk > 0.0:
        steps = np.sqrt(np.diff(track.time, prepend=track.time[0]))
        root = walk * steps[:, None, None] * np.eye(2)

    def linear(shapes: TrackErrorBasis) -> ErrorProcess:
        def about(coefficients: np.ndarray) -> ErrorProcess:
            whole = np.zeros(len(keep))
            whole[keep] = coefficients[: keep.sum()]
            return linear(shapes.midway(track.latitude, longitude, whole))

        response = np.pad((metres * shapes.angle)[..., keep], ((0, 0), (0, 0), (0, extra)))
        offset = np.zeros((len(response), response.shape[-1]))
        if eotvos:
            east = shapes.velocity[:, 1, keep]
            offset[:, : east.shape[1]] = 2.0 * EARTH_RATE / MILLIGAL * np.cos(track.latitude)[:, None] * east
        if extra:
            offset[:, -1] = drift * (track.time - track.time[0])
        some = eotvos or bool(extra)
        return ErrorProcess(track.time, np.ascontiguousarray(response), root, offset if some else None, about)

    return linear(basis)


def random_walk_process(
    time: ArrayLike, initial_covariance: ArrayLike, walk_covariance: ArrayLike
) -> ErrorProcess:
    """Position error that begins with a covariance and then takes independent normal steps.

    Parameters
    ----------
    time : array_like, shape (N,)
        Seconds.
    initial_covariance : array_like, shape (2, 2)
        At the first sample, m^2.
    walk_covariance : array_like, shape (N, 2, 2)
        Of the step to each sample, m^2; that of the first is not used.

    Returns
    -------
    ErrorProcess

    Raises
    ------
    InvalidInput
        If a shape is wrong or a covariance is not symmetric and non-negative.
    """
    times = np.array(time, dtype=float)
    steps = np.array(walk_covariance, dtype=float)
    start = np.array(initial_covariance, dtype=float)
    if start.shape != (2, 2):
        raise InvalidInput("initial_covariance", start.shape, "give a matrix of shape (2, 2)")
    if steps.shape != (len(times), 2, 2):
        raise InvalidInput("walk_covariance", steps.shape, f"give an array of shape ({len(times)}, 2, 2)")
    steps[0] = 0.0
    response = np.broadcast_to(_root("initial_covariance", start), (len(times), 2, 2))
    return ErrorProcess(times, np.ascontiguousarray(response), _root("walk_covariance", steps))


def random_walk_steps(
    track: Any, sigmas: InsErrors, *, heading: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Covariances for `random_walk_process` that an INS of a given quality suggests.

    The error of an INS is no random walk: its velocity error lasts for hours. Given here are the
    covariance of its position error at the first sample and that of each change, as if the changes were
    independent of one another. The walk is therefore nearer to its start after a long time than the INS is,
    unless measurements lead it on.

    Parameters
    ----------
    track, sigmas, heading
        As for `inertial_process`.

    Returns
    -------
    initial_covariance : ndarray, shape (2, 2)
    walk_covariance : ndarray, shape (N, 2, 2)
    """
    response = inertial_process(track, sigmas, heading=heading, negligible=0.0).response
    change = np.diff(response, axis=0, prepend=response[:1])
    return response[0] @ response[0].T, change @ change.transpose(0, 2, 1)


def declared(problem: Any) -> tuple[InsErrors, MeasurementErrors]:
    """What a problem declares about its INS and its measurements, see `baselines.track_model`.

    One that declares no INS and has no prior either is taken to carry that of Dai et al. (2019), Table 1.
    """
    if getattr(problem, "ins_errors", None) is None and problem.prior() is None:
        sensing = getattr(problem, "measurement_errors", None)
        return InsErrors.published(), sensing or MeasurementErrors(noise=problem.noise)
    return declared_errors(problem)


def metres_per_radian(latitude: np.ndarray) -> np.ndarray:
    """Metres per radian of latitude and of longitude, shape (N, 2)."""
    meridian, prime_vertical = principal_radii(latitude)
    return np.stack([meridian, prime_vertical * np.cos(latitude)], axis=-1)


def _root(name: str, covariance: np.ndarray) -> np.ndarray:
    """Symmetric root of covariances, which may be singular, shape (..., 2, 2)."""
    if not np.allclose(covariance, np.swapaxes(covariance, -1, -2)):
        raise InvalidInput(name, covariance.tolist(), "give symmetric matrices")
    values, vectors = np.linalg.eigh(covariance)
    if not (values >= -1e-9 * np.abs(values).max(initial=0.0)).all():
        raise InvalidInput(name, values.min(), "give covariances without negative eigenvalues")
    return vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
