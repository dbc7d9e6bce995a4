"""The posterior of a matching problem's whole track, kept linear about what is believed at present."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.models.cruise import InsErrors
from navopt.models.field_map import FieldMap
from navopt.models.track_errors import TrackErrorBasis, track_error_basis
from navopt.problems.gravity_posterior import TrackPosterior
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.problems.gravity_window import parameter_covariance

__all__ = ["TrackModel", "declared_errors"]

Array = NDArray[np.float64]

#: Without the INS's heading the error shapes are renewed only where the velocity error is known to this
#: share of its prior standard deviation.
KNOWN_SPEED = 0.3


@lru_cache(maxsize=8)
def _kept(
    time: bytes, latitude: bytes, longitude: bytes, heading: bytes | None, sigmas: InsErrors
) -> TrackErrorBasis:
    t, lat, lon = (np.frombuffer(values) for values in (time, latitude, longitude))
    ahead = None if heading is None else np.frombuffer(heading)
    return track_error_basis(t, lat, lon, sigmas, heading=ahead)


def _basis(track: Any, sigmas: InsErrors, *, remember: bool = True) -> TrackErrorBasis:
    """Basis along an inertial track; kept, because several methods match the same track."""
    longitude = np.unwrap(track.longitude)
    heading = None if track.heading is None else np.unwrap(track.heading).tobytes()
    make = _kept if remember else _kept.__wrapped__
    return make(track.time.tobytes(), track.latitude.tobytes(), longitude.tobytes(), heading, sigmas)


def declared_errors(problem: Any) -> tuple[InsErrors, MeasurementErrors]:
    """What a problem declares about its INS and its measurements, or what follows from its prior.

    A problem that only has a prior for its window is taken to carry an INS of the make of paper 003's
    Table 1, with all sensor errors scaled so that the mean position error of the window is as large as
    the prior's.
    """
    sensing = getattr(problem, "measurement_errors", None) or MeasurementErrors(noise=problem.noise)
    if getattr(problem, "ins_errors", None) is not None:
        return problem.ins_errors, sensing
    track = problem.track
    table = InsErrors.published()
    basis = _basis(track, table)
    centre = basis.position[-problem.window :].mean(axis=0)
    factor = float(np.sqrt(np.trace(parameter_covariance(problem)[:2, :2]) / np.sum(centre**2)))
    return _scaled(table, factor), sensing


def _scaled(errors: InsErrors, factor: float) -> InsErrors:
    return InsErrors.from_vector(
        factor * errors.vector,
        gyro_noise=factor * errors.gyro_noise,
        accelerometer_noise=factor * errors.accelerometer_noise,
    )


class TrackModel:
    """Posterior of a whole track, linear about what is believed at present.

    Parameters
    ----------
    field_map : FieldMap
        The map.
    track : MeasuredTrack
        Inertial track and measurements; a truth in it is not looked at.
    ins_errors : InsErrors
        1σ of the INS's errors.
    measurement_errors : MeasurementErrors
        1σ of the errors of measurement and map.
    method : {"bilinear", "bicubic"}, optional
        Interpolation; the map's own if not given.
    huber : float, optional
        Whitened residuals larger than this count linearly.
    remember : bool
        Keep the error shapes for the next match of the same track.
    """

    def __init__(
        self,
        field_map: FieldMap,
        track: Any,
        ins_errors: InsErrors,
        measurement_errors: MeasurementErrors,
        *,
        method: str | None = None,
        huber: float | None = None,
        remember: bool = True,
    ) -> None:
        self.basis = _basis(track, ins_errors, remember=remember)
        self.heading = track.heading
        self.posterior = TrackPosterior(
            field_map,
            track.time,
            track.latitude,
            track.longitude,
            track.measured,
            angle=self.basis.angle,
            velocity=self.basis.velocity,
            errors=measurement_errors,
            method=method,
            huber=huber,
        )
        prior = np.sum(self.basis.velocity**2, axis=(1, 2))
        self._prior_speed = float(np.sqrt(np.median(prior)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients: the error sources of the INS, then those of the measurements."""
        return self.basis.sources + self.posterior.names[len(self.basis.sources) :]

    def carry(self, old: TrackModel, a: Array) -> Array:
        """Coefficients of this model that come nearest to those of a model of the first part of the track."""
        sources, before = len(self.basis.sources), len(old.basis.sources)
        named, n = self.basis.n_named, len(old.posterior)
        carried = np.zeros(self.posterior.n_coefficients)
        carried[:named], carried[sources:] = a[:named], a[before:]
        shapes = self.basis.position[:n, :, named:].reshape(2 * n, -1)
        if shapes.shape[1]:
            wanted = (old.basis.position[:, :, named:] @ a[named:before]).ravel()
            # tied to the prior so weakly that only shapes without effect on the old part are held
            normal = shapes.T @ shapes + np.eye(shapes.shape[1])
            carried[named:sources] = np.linalg.solve(normal, shapes.T @ wanted)
        return carried

    def linearise(self, a: Array, information: Array, *, stop: int | None = None) -> None:
        """Renew the error shapes midway between the INS and the track that `a` stands for.

        Where the INS's heading is not given, the course of the corrected track stands in for it; while the
        velocity is hardly better known than without measurements, the shapes are left as they are.

        Parameters
        ----------
        a : ndarray, shape (r,)
            Coefficients.
        information : ndarray, shape (r, r)
            Inverse of their covariance.
        stop : int, optional
            Renew the first samples only.
        """
        sources = len(self.basis.sources)
        if self.heading is None:
            speed = self.basis.velocity[:stop].reshape(-1, sources)
            padded = np.pad(speed, ((0, 0), (0, len(a) - sources)))
            half = np.linalg.solve(np.linalg.cholesky(information), padded.T)
            known = np.sqrt(np.median(np.sum(half**2, axis=0).reshape(-1, 2).sum(axis=1)))
            if known > KNOWN_SPEED * self._prior_speed:
                return
        posterior = self.posterior
        self.basis = self.basis.midway(
            posterior.latitude, posterior.longitude, a[:sources], heading=self.heading, stop=stop
        )
        self.posterior = posterior.shaped(self.basis.angle, self.basis.velocity)
