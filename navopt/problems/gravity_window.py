"""Posterior of the position errors of a matching problem's window, and the bounds of window and track."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.errors import NoBound
from navopt.models.track_errors import track_error_basis
from navopt.problems.gravity_posterior import TrackPosterior
from navopt.problems.gravity_sensing import MeasurementErrors

__all__ = ["parameter_covariance", "track_error_bound", "window_error_bound", "window_posterior"]

Array = NDArray[np.float64]

#: Directions of the window's prior that move no sample by more than this are left out, m (1σ).
NEGLIGIBLE = 5.0


def _declared(problem: Any) -> MeasurementErrors:
    return getattr(problem, "measurement_errors", None) or MeasurementErrors(noise=problem.noise)


def parameter_covariance(problem: Any) -> Array:
    """Prior covariance of (north, east, rotation, scale), shape (4, 4).

    The problem's own; where it has none, its box is taken to reach three standard deviations.
    """
    known = problem.prior()
    if known is not None:
        return known[1]
    return np.diag(((problem.xu - problem.xl) / 6.0) ** 2)


def _shapes(problem: Any) -> Array:
    """INS errors of the window (north, east), m per standard deviation, widest first; (window, 2, S)."""
    n = problem.window
    covariance = getattr(problem, "position_covariance", None)
    if covariance is None:
        # first-order displacement by the four parameters; the INS error is what they undo
        q = problem.sequence
        columns = np.zeros((n, 2, 4))
        columns[:, 0, 0] = columns[:, 1, 1] = -1.0
        columns[:, 0, 2], columns[:, 1, 2] = q[:, 1], -q[:, 0]
        columns[:, :, 3] = -q
        flat = columns.reshape(2 * n, 4) @ np.linalg.cholesky(parameter_covariance(problem))
        left, sizes, _ = np.linalg.svd(flat, full_matrices=False)
        shapes = left * sizes
    else:
        values, vectors = np.linalg.eigh(covariance)
        shapes = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, ::-1]
    keep = np.abs(shapes).max(axis=0) > NEGLIGIBLE
    keep[0] = True
    return np.ascontiguousarray(shapes[:, keep]).reshape(n, 2, -1)


def window_posterior(
    problem: Any,
    *,
    errors: MeasurementErrors | None = None,
    huber: float | None = None,
    about: tuple[Array, Array] | None = None,
) -> TrackPosterior:
    """Posterior of the position errors of the window, in the eigenbasis of their prior covariance.

    Parameters
    ----------
    problem : GravityMatching
        Its window, map, prior and declared errors.
    errors : MeasurementErrors, optional
        Instead of what the problem declares.
    huber : float, optional
        As for `TrackPosterior`.
    about : tuple of ndarray, optional
        Latitudes and longitudes (rad) of the window that take the place of the INS's.

    Returns
    -------
    TrackPosterior

    Notes
    -----
    An Eötvös effect is not modelled here: a window knows nothing of the velocity. It mostly shows as an
    offset; give a bias in `errors`.
    """
    declared = errors or _declared(problem)
    if declared.eotvos:
        declared = replace(declared, eotvos=False)
    track, last = problem.track, slice(len(problem.track) - problem.window, None)
    latitude, longitude = about or (track.latitude[last], track.longitude[last])
    scale = np.array(problem.metres_per_radian)[:, None]
    return TrackPosterior(
        problem.field_map,
        track.time[last],
        latitude,
        longitude,
        track.measured[last],
        angle=_shapes(problem) / scale,
        errors=declared,
        method=problem.method,
        huber=huber,
    )


def _truth(problem: Any, at: tuple[Any, Any] | None) -> tuple[Array, Array]:
    if at is not None:
        return np.asarray(at[0], dtype=np.float64), np.asarray(at[1], dtype=np.float64)
    track = problem.track
    if track.true_latitude is None:
        raise NoBound("the problem carries no truth: give the positions at which to evaluate the bound")
    return track.true_latitude, track.true_longitude


def window_error_bound(problem: Any, at: tuple[Any, Any] | None = None) -> Array:
    """Posterior Cramér–Rao bound on the positions of the window, from its measurements and the prior.

    Parameters
    ----------
    problem : GravityMatching
        The problem.
    at : tuple of array_like, optional
        Latitudes and longitudes (rad) of the window at which the slopes of the map are taken; the truth if
        not given. For recorded data without a truth, the estimate.

    Returns
    -------
    ndarray, shape (window, 2, 2)
        Bound on the covariance of (north, east) of every sample, m².

    Raises
    ------
    NoBound
        If there is neither a truth nor `at`.

    Notes
    -----
    The information of one world. The bound proper on the mean square error over worlds is not smaller than
    the inverse of its mean; the mean of its inverse, which is what a method that knows its errors can
    attain, is larger.
    """
    n = problem.window
    latitude, longitude = (values[-n:] for values in _truth(problem, at))
    posterior = window_posterior(problem, about=(latitude, longitude))
    return posterior.covariances(posterior.information(np.zeros(posterior.n_coefficients)))


def track_error_bound(
    problem: Any, at: tuple[Any, Any] | None = None, *, ins_errors: Any = None, causal: bool = False
) -> Array:
    """Posterior Cramér–Rao bound on the positions of the whole track, from all its measurements.

    Parameters
    ----------
    problem : GravityMatching
        The problem.
    at : tuple of array_like, optional
        Latitudes and longitudes (rad) of all samples at which the slopes of the map are taken; the truth if
        not given. For recorded data without a truth, the estimate.
    ins_errors : InsErrors, optional
        1σ of the INS's errors; what the problem declares if not given.
    causal : bool
        Bound each position by the measurements until then (what a recursive method can attain) rather than
        by all of them.

    Returns
    -------
    ndarray, shape (N, 2, 2)
        Bound on the covariance of (north, east) of every sample, m². Its trace along the track shows where
        the map tells little.

    Raises
    ------
    NoBound
        If there is neither a truth nor `at`, or no 1σ of the INS's errors.
    """
    sigmas = ins_errors or getattr(problem, "ins_errors", None)
    if sigmas is None:
        raise NoBound("the bound of the track needs ins_errors, the 1σ of the INS's error sources")
    latitude, longitude = _truth(problem, at)
    track = problem.track
    if len(latitude) != len(track):
        raise NoBound(f"give the positions of all {len(track)} samples, not of {len(latitude)}")
    # the heading the INS shows is the vehicle's to a fraction of a degree
    basis = track_error_basis(track.time, latitude, longitude, sigmas, heading=track.heading)
    posterior = TrackPosterior(
        problem.field_map,
        track.time,
        latitude,
        longitude,
        track.measured,
        angle=basis.angle,
        velocity=basis.velocity,
        errors=_declared(problem),
        method=problem.method,
    )
    none = np.zeros(posterior.n_coefficients)
    if not causal:
        return posterior.covariances(posterior.information(none))
    _, _, rows = posterior.linearise(none)
    information = np.eye(posterior.n_coefficients)
    bound = np.empty((len(posterior), 2, 2))
    for k in range(len(posterior)):
        information += np.outer(rows[k], rows[k])
        reach = posterior.metres(k)
        bound[k] = reach @ np.linalg.solve(information, reach.T)
    return bound
