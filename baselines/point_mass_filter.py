"""A grid filter for the two-dimensional position error of an inertial track."""

from __future__ import annotations

import numpy as np

from baselines.particle_matching_filter import FieldSensor, bimodality
from baselines.particle_matching_process import ErrorProcess, metres_per_radian
from navopt.errors import InvalidInput
from navopt.models.field_map_kernels import bilinear_many, bspline_many

__all__ = ["PointMassFilter"]

#: Density, relative to the greatest, below which a node is not worth its place: 5.7 sigma of a normal.
NEGLIGIBLE = 1e-7
#: Half width of the first grid and of the room for a step of the walk, in sigmas.
REACH = 6.0
#: Least standard deviation of the first position error, m: a grid needs some width.
LEAST_SIGMA = 1.0


class PointMassFilter:
    """Density of the position error (north, east) on a grid that follows it.

    A step of the random walk multiplies the density's spectrum by that of the step's, which is exact
    however short the step; a measurement multiplies the density by its likelihood. The grid is laid anew,
    with as many nodes, when the density needs more room or uses less than half of it.

    Parameters
    ----------
    process : ErrorProcess
        A random walk: its response must be the same at all samples.
    sensor : FieldSensor
        What the measurements mean; a constant offset is not supported.
    nodes : int
        Nodes per axis.

    Attributes
    ----------
    density : ndarray, shape (nodes, nodes)
        Per square metre; it sums to one over the cells.
    north, east : ndarray, shape (nodes,)
        Position errors of the nodes, m.
    samples, grids, looked_up : int
        Measurements used, grids laid, and look-ups on the map.
    log_evidence : float
        Logarithm of the density of the measurements so far.

    Raises
    ------
    InvalidInput
        If the process is no random walk, or the sensor has an unknown offset.
    """

    def __init__(self, process: ErrorProcess, sensor: FieldSensor, *, nodes: int) -> None:
        response = process.response
        if np.ptp(response, axis=0).max() > 1e-9 * np.abs(response).max():
            raise InvalidInput(
                "process", "an error whose mean response changes", "give a random_walk_process"
            )
        if sensor.bias > 0.0:
            raise InvalidInput("bias", sensor.bias, "give 0: a grid over the position holds no offset")
        self.process, self.sensor, self.nodes = process, sensor, nodes
        self._metres = metres_per_radian(sensor.latitude)
        self.samples = self.grids = self.looked_up = 0
        self.log_evidence = 0.0
        covariance = response[0] @ response[0].T + LEAST_SIGMA**2 * np.eye(2)
        reach = REACH * np.sqrt(np.diag(covariance))
        self._lay(-reach, reach)
        grid = np.stack(np.meshgrid(self.north, self.east, indexing="ij"), axis=-1)
        self.density = np.exp(-0.5 * np.einsum("...i,ij,...j->...", grid, np.linalg.inv(covariance), grid))
        self._normalise()

    def update(self, measurement: float) -> None:
        """Use the measurement at the next sample of the track.

        Where no node is on the map the measurement is passed over: it says nothing.

        Raises
        ------
        InvalidInput
            If it is not finite, or the track has no further sample.
        """
        if not np.isfinite(measurement):
            raise InvalidInput("measurement", measurement, "give a finite value")
        self.skip()
        k = self.samples - 1
        residual = (measurement - self._mapped(k)) / self.sensor.noise
        exponent = np.where(np.isnan(residual), -np.inf, -0.5 * residual**2)
        # against underflow where all nodes fit badly
        top = np.max(exponent, where=self.density > 0.0, initial=-np.inf)
        if not np.isfinite(top):
            return
        self.density = self.density * np.exp(exponent - top)
        total = self._normalise()
        self.log_evidence += top + np.log(total / (np.sqrt(2.0 * np.pi) * self.sensor.noise))

    def skip(self) -> None:
        """Go to the next sample of the track without a measurement.

        Raises
        ------
        InvalidInput
            If the track has no further sample.
        """
        k = self.samples
        if k == len(self._metres):
            raise InvalidInput("samples", k, "all samples of the track have been used; begin again")
        if k and self.process.walk_root is not None:
            self._walk(self.process.walk_root[k] @ self.process.walk_root[k].T)
        self.samples = k + 1

    def _mapped(self, k: int) -> np.ndarray:
        """Field at sample `k` for the position error of each node."""
        nodes, axes, _, bicubic = self.sensor.field
        latitude = self.sensor.latitude[k] - self.north / self._metres[k, 0]
        longitude = self.sensor.longitude[k] - self.east / self._metres[k, 1]
        out = np.empty(self.density.size)
        look_up = bspline_many if bicubic else bilinear_many
        look_up(
            nodes, *axes, np.repeat(latitude, self.nodes), np.tile(longitude, self.nodes), out
        )  # fmt: skip
        self.looked_up += out.size
        return out.reshape(self.density.shape)

    # -- the grid --------------------------------------------------------------------------------------
    def _lay(self, lower: np.ndarray, upper: np.ndarray) -> None:
        self.north, self.east = (np.linspace(a, b, self.nodes) for a, b in zip(lower, upper, strict=True))
        self.grids += 1

    @property
    def _steps(self) -> tuple[float, float]:
        return float(self.north[1] - self.north[0]), float(self.east[1] - self.east[0])

    def _normalise(self) -> float:
        total = float(self.density.sum() * self._steps[0] * self._steps[1])
        self.density = self.density / total
        return total

    def _walk(self, covariance: np.ndarray) -> None:
        """Make room for a step of the random walk and take it."""
        room = REACH * np.sqrt(np.diag(covariance))
        limits = []
        for axis, line, extra in ((1, self.north, room[0]), (0, self.east, room[1])):
            used = np.flatnonzero(self.density.max(axis=axis) > NEGLIGIBLE * self.density.max())
            step = line[1] - line[0]
            limits.append((line[used[0]] - extra - step, line[used[-1]] + extra + step))
        lower, upper = np.array(limits).T
        now = np.array([[self.north[0], self.north[-1]], [self.east[0], self.east[-1]]])
        if (
            (lower < now[:, 0]).any()
            or (upper > now[:, 1]).any()
            or (upper - lower < 0.5 * np.ptp(now, axis=1)).any()
        ):
            # a quarter more, so that the next step does not ask again
            margin = 0.125 * (upper - lower)
            self._move(lower - margin, upper + margin)
        steps = self._steps
        waves = np.meshgrid(
            2.0 * np.pi * np.fft.fftfreq(self.nodes, steps[0]),
            2.0 * np.pi * np.fft.rfftfreq(self.nodes, steps[1]),
            indexing="ij",
        )
        damping = (
            covariance[0, 0] * waves[0] ** 2
            + 2.0 * covariance[0, 1] * waves[0] * waves[1]
            + covariance[1, 1] * waves[1] ** 2
        )
        spectrum = np.fft.rfft2(self.density) * np.exp(-0.5 * damping)
        # rounding leaves a little below zero
        self.density = np.maximum(np.fft.irfft2(spectrum, s=self.density.shape), 0.0)
        self._normalise()

    def _move(self, lower: np.ndarray, upper: np.ndarray) -> None:
        """Lay the grid over other limits; the density between nodes by a cubic spline."""
        from scipy.interpolate import RectBivariateSpline

        old = self.north, self.east
        spline = RectBivariateSpline(*old, self.density)
        self._lay(lower, upper)
        density = np.maximum(spline(self.north, self.east), 0.0)
        # outside the old grid there was nothing, whatever the spline says
        density[(self.north < old[0][0]) | (self.north > old[0][-1])] = 0.0
        density[:, (self.east < old[1][0]) | (self.east > old[1][-1])] = 0.0
        self.density = density
        self._normalise()

    # -- what is known -----------------------------------------------------------------------------------
    @property
    def _masses(self) -> np.ndarray:
        return self.density * (self._steps[0] * self._steps[1])

    def mean(self) -> np.ndarray:
        """Mean position error (north, east) at the last sample used, m, shape (2,)."""
        masses = self._masses
        return np.array([masses.sum(axis=1) @ self.north, masses.sum(axis=0) @ self.east])

    def covariance(self) -> np.ndarray:
        """Covariance of the position error (north, east), m^2, shape (2, 2)."""
        masses, mean = self._masses, self.mean()
        north, east = self.north - mean[0], self.east - mean[1]
        mixed = north @ masses @ east
        return np.array([[masses.sum(axis=1) @ north**2, mixed], [mixed, masses.sum(axis=0) @ east**2]])

    def position(self) -> tuple[float, float]:
        """Estimated latitude and longitude, rad, at the last sample used."""
        k = max(self.samples - 1, 0)
        north, east = self.mean() / self._metres[k]
        return float(self.sensor.latitude[k] - north), float(self.sensor.longitude[k] - east)

    @property
    def effective_sample_size(self) -> float:
        """``1 / sum of squared masses``: equal nodes that would hold as much."""
        return float(1.0 / np.sum(self._masses**2))

    def bimodality(self) -> float:
        """As `baselines.particle_matching_filter.bimodality`."""
        grid = np.stack(np.meshgrid(self.north, self.east, indexing="ij"), axis=-1)
        return bimodality(grid.reshape(-1, 2), self._masses.ravel())
