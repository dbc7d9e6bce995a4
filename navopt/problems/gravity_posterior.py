"""Posterior of the INS errors along a track, given the field measured on it and a map.

A :class:`TrackPosterior` puts together what a deployable method may know: the inertial track, the
measurements, the map, the shapes that INS errors can give to the track, and how large all errors are
declared to be. It is linear in its coefficients but for the map.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE, MILLIGAL, principal_radii, separation
from navopt.models.field_map import FieldMap
from navopt.problems import gravity_posterior_kernels as kernels
from navopt.problems.gravity_sensing import MeasurementErrors

__all__ = ["TrackPosterior"]

Array = NDArray[np.float64]
DAY = 86400.0


class TrackPosterior:
    """Coefficients of error shapes with standard normal priors, and the measurements that tell of them.

    Parameters
    ----------
    field_map : FieldMap
        The map.
    time : array_like, shape (N,)
        Seconds, increasing.
    latitude, longitude : array_like, shape (N,)
        INS positions, rad.
    measured : array_like, shape (N,)
        Field measured, in the map's unit.
    angle : array_like, shape (N, 2, S)
        INS error (latitude, longitude), rad per standard deviation of each source.
    velocity : array_like, shape (N, 2, S), optional
        INS velocity error, m/s per standard deviation; needed for the Eötvös effect.
    errors : MeasurementErrors
        Declared errors of measurement and map.
    method : {"bilinear", "bicubic"}, optional
        Interpolation; the map's own if not given.
    huber : float, optional
        Whitened residuals larger than this count linearly; all quadratically if not given.

    Attributes
    ----------
    names : tuple of str
        ``source_1`` … for the S sources, then ``bias`` and ``drift`` where these are declared.
    n_coefficients : int
        Their number, r.
    """

    def __init__(
        self,
        field_map: FieldMap,
        time: ArrayLike,
        latitude: ArrayLike,
        longitude: ArrayLike,
        measured: ArrayLike,
        *,
        angle: ArrayLike,
        errors: MeasurementErrors,
        velocity: ArrayLike | None = None,
        method: str | None = None,
        huber: float | None = None,
    ) -> None:
        self.field_map, self.errors = field_map, errors
        self.time, self.latitude, self.measured = (
            np.array(values, dtype=np.float64) for values in (time, latitude, measured)
        )
        self.longitude = np.unwrap(np.array(longitude, dtype=np.float64))
        self._shape(angle, velocity)
        self.huber = np.inf if huber is None else float(huber)
        bicubic = (method or field_map.method) == "bicubic"
        nodes, *grid = field_map.spline_grid if bicubic else field_map.grid
        values = field_map.values
        spread = max(float(values.var()), errors.noise**2)
        self._field = (nodes, tuple(grid), field_map.shape, bicubic, float(values.mean()), spread)
        n = len(self.time)
        run = np.zeros(n)
        run[1:] = np.hypot(
            *separation(self.latitude[1:], self.longitude[1:], self.latitude[:-1], self.longitude[:-1])
        )
        self._noise = (
            np.full(n, errors.noise**2),
            np.exp(-run / errors.map_error_length),
            errors.map_error**2,
        )

    def _shape(self, angle: ArrayLike, velocity: ArrayLike | None) -> None:
        shapes, errors = np.asarray(angle, dtype=np.float64), self.errors
        n, sources = len(self.time), shapes.shape[-1]
        if shapes.shape != (n, 2, sources):
            raise InvalidInput("angle", shapes.shape, f"give an array of shape ({n}, 2, S)")
        self.offset = np.ascontiguousarray(self._measurement_columns(velocity, sources))
        extra = self.offset.shape[1] - sources
        self.angle = np.ascontiguousarray(np.concatenate([shapes, np.zeros((n, 2, extra))], axis=2))
        names = [f"source_{k + 1}" for k in range(sources)]
        names += [name for name, size in (("bias", errors.bias), ("drift", errors.drift_per_day)) if size]
        self.names, self.n_coefficients = tuple(names), len(names)
        self._samples = (self.latitude, self.longitude, self.angle, self.offset, self.measured)

    def shaped(self, angle: ArrayLike, velocity: ArrayLike | None = None) -> TrackPosterior:
        """Return the same posterior with other shapes of the INS errors, as after a new linearisation."""
        other = copy.copy(self)
        other._shape(angle, velocity)
        return other

    def _measurement_columns(self, velocity: ArrayLike | None, sources: int) -> Array:
        """What a unit of each coefficient adds to a measured value, shape (N, r)."""
        errors, n = self.errors, len(self.time)
        columns = np.zeros((n, sources))
        if errors.eotvos:
            if velocity is None:
                raise InvalidInput("velocity", None, "the Eötvös effect needs the velocity errors")
            east = np.asarray(velocity, dtype=np.float64)[:, 1]
            columns += (2.0 * EARTH_RATE / MILLIGAL) * np.cos(self.latitude)[:, None] * east
        added = []
        if errors.bias:
            added.append(np.full(n, errors.bias))
        if errors.drift_per_day:
            added.append(errors.drift_per_day / DAY * (self.time - self.time[0]))
        return np.column_stack([columns, *added]) if added else columns

    def __len__(self) -> int:
        return len(self.time)

    # -- where the coefficients put the track ---------------------------------------------------------
    def positions(self, a: ArrayLike) -> tuple[Array, Array]:
        """Latitudes and longitudes (rad) of all samples for coefficients `a`, shape (r,): each (N,)."""
        shift = self.angle @ np.asarray(a, dtype=np.float64)
        return self.latitude - shift[:, 0], self.longitude - shift[:, 1]

    def metres(self, k: int | slice = slice(None)) -> Array:
        """INS position error (north, east) in metres per coefficient at sample(s) `k`, shape (..., 2, r)."""
        meridian, prime_vertical = principal_radii(self.latitude[k])
        scale = np.stack([meridian, prime_vertical * np.cos(self.latitude[k])], axis=-1)
        return scale[..., None] * self.angle[k]

    # -- what the measurements say -----------------------------------------------------------------------
    def linearise(
        self, a: ArrayLike, *, start: int = 0, stop: int | None = None
    ) -> tuple[float, Array, Array]:
        """Whitened residuals and their derivatives at coefficients.

        Parameters
        ----------
        a : array_like, shape (r,)
            Coefficients.
        start, stop : int
            Samples used.

        Returns
        -------
        cost : float
            Minus log posterior, without its constant.
        residual : ndarray, shape (n,)
        jacobian : ndarray, shape (n, r)
        """
        point = np.ascontiguousarray(a, dtype=np.float64)
        end = len(self) if stop is None else stop
        residual, rows = np.zeros(len(self)), np.zeros((len(self), self.n_coefficients))
        cost = kernels.weigh(
            point, start, end, self._samples, self._noise, self._field, self.huber, residual, rows
        )
        return cost + 0.5 * float(point @ point), residual[start:end], rows[start:end]

    def costs(self, points: ArrayLike, *, start: int = 0, stop: int | None = None) -> Array:
        """Minus log posterior, without its constant, of many coefficient vectors; (m, r) -> (m,)."""
        rows = np.ascontiguousarray(points, dtype=np.float64)
        end, out = len(self) if stop is None else stop, np.empty(len(rows))
        kernels.costs(rows, start, end, self._samples, self._noise, self._field, self.huber, out)
        return out

    def information(self, a: ArrayLike, *, start: int = 0, stop: int | None = None) -> Array:
        """Information on the coefficients from samples start … stop at `a`, and the prior; shape (r, r)."""
        _, _, rows = self.linearise(a, start=start, stop=stop)
        return rows.T @ rows + np.eye(self.n_coefficients)

    def fit(
        self, a: Array, *, start: int = 0, stop: int | None = None, steps: int = 40, tolerance: float = 1e-4
    ) -> tuple[Array, float, Array, int]:
        """Descend to the nearest mode.

        Parameters
        ----------
        a : ndarray, shape (r,)
            Start.
        start, stop : int
            Samples used.
        steps : int
            Largest number of steps.
        tolerance : float
            End when a step promises to lower minus the log posterior by less.

        Returns
        -------
        a : ndarray, shape (r,)
        cost : float
            Minus log posterior there, without its constant.
        information : ndarray, shape (r, r)
            Inverse covariance of the coefficients in the mode.
        evaluations : int
            Number of times the field and its slopes were taken at the samples.
        """
        end = len(self) if stop is None else stop
        return kernels.fit(
            a, start, end, self._samples, self._noise, self._field, self.huber, steps, tolerance
        )

    def covariances(self, information: Array) -> Array:
        """Covariance of the position (north, east) at every sample, m², shape (N, 2, 2)."""
        root = np.linalg.cholesky(information)
        half: Any = np.linalg.solve(root, self.metres().reshape(-1, self.n_coefficients).T)
        half = half.T.reshape(len(self), 2, -1)
        return half @ half.transpose(0, 2, 1)
