"""A particle filter for the errors of an inertial track, one measurement at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines import particle_matching_kernels as kernels
from baselines.particle_matching_process import ErrorProcess, metres_per_radian
from navopt.errors import InvalidInput

__all__ = ["FieldSensor", "ParticleFilter", "bimodality"]

#: Acceptance of the moves that the step is steered to.
ACCEPTANCE = 0.15, 0.4


@dataclass(frozen=True)
class FieldSensor:
    """What a measurement is compared with.

    Attributes
    ----------
    latitude, longitude : ndarray, shape (N,)
        INS positions, rad.
    field : tuple
        Nodes, axes, shape and whether bicubic, as `baselines.particle_matching_kernels.accumulate` takes it.
    noise : float
        Standard deviation of measured minus mapped field.
    bias : float
        Standard deviation of an unknown constant offset of the sensor; 0 for none.
    """

    latitude: np.ndarray
    longitude: np.ndarray
    field: tuple[Any, ...]
    noise: float
    bias: float = 0.0

    @classmethod
    def of(cls, problem: Any, *, bias: float = 0.0) -> FieldSensor:
        """Take map, track and noise from a matching problem."""
        field_map, track = problem.field_map, problem.track
        bicubic = problem.method == "bicubic"
        nodes, *axes = field_map.spline_grid if bicubic else field_map.grid
        return cls(
            track.latitude,
            track.longitude,
            (nodes, tuple(axes), field_map.shape, bicubic),
            problem.noise,
            float(bias),
        )


class ParticleFilter:
    """Particles that each carry one history of the INS error.

    A particle is a draw of the constant error sources, and of the random walk where the process has one:
    its whole track follows. Measurements weigh the particles; when the weights have become uneven, they
    are resampled and then moved apart again.

    Parameters
    ----------
    process : ErrorProcess
        Prior of the position error.
    sensor : FieldSensor
        What the measurements mean.
    particles : int
        Number of particles P.
    rng : numpy.random.Generator
        Source of all random numbers.
    threshold : float
        Resample when the effective sample size is below this part of P.
    rejuvenation : {"moves", "kernel", "none"}
        How the copies of a particle are moved apart, see `ParticleMatching`.
    moves : int
        Metropolis moves after each resampling.
    bandwidth : float
        Of the kernel, in standard deviations of the particles.
    allowance : float
        Look-ups that moves and linearisations may take; where it does not suffice, the kernel is used.
    relinearise : bool
        Linearise the process about the mean of the particles after each resampling, if it is not linear.

    Attributes
    ----------
    samples : int
        Measurements used so far.
    log_weights : ndarray, shape (P,)
        Logarithms of the normalised weights.
    log_evidence : float
        Logarithm of the density of the measurements so far, estimated.
    resampled, accepted, proposed : int
        Numbers of resamplings, and of accepted and proposed moves.
    looked_up : int
        Look-ups on the map.
    """

    def __init__(
        self,
        process: ErrorProcess,
        sensor: FieldSensor,
        *,
        particles: int,
        rng: np.random.Generator,
        threshold: float = 0.5,
        rejuvenation: str = "moves",
        moves: int = 2,
        bandwidth: float = 0.1,
        allowance: float = np.inf,
        relinearise: bool = True,
    ) -> None:
        self.relinearise = relinearise
        self.process, self.sensor, self.rng = process, sensor, rng
        self.threshold, self.rejuvenation, self.bandwidth = threshold, rejuvenation, bandwidth
        self.moves, self.allowance = moves, allowance
        n, _, sources = process.response.shape
        self.measured = np.zeros(n)
        self._places = np.column_stack(
            [sensor.latitude, sensor.longitude, 1.0 / metres_per_radian(sensor.latitude)]
        )
        self.sources = rng.standard_normal((particles, sources))
        self.walk = np.zeros((0, 0, 2) if process.walk_root is None else (particles, n, 2))
        self.log_weights = np.full(particles, -np.log(particles))
        self._sums = np.zeros((particles, 2))
        # of the two kinds of move: a walk, and a draw about the mean
        self._steps = np.array([min(2.38 / np.sqrt(sources), 1.0), 0.7])
        self.samples = self.resampled = self.accepted = self.proposed = self.looked_up = 0
        self.log_evidence = 0.0

    # -- one measurement ---------------------------------------------------------------------------------
    def update(self, measurement: float) -> None:
        """Use the measurement at the next sample of the track.

        Where no particle is left on the map the measurement is passed over: it says nothing.

        Raises
        ------
        InvalidInput
            If it is not finite, or the track has no further sample.
        """
        k = self.samples
        if k == len(self.measured):
            raise InvalidInput(
                "measurement", measurement, f"the track has {k} samples and all have been used"
            )
        if not np.isfinite(measurement):
            raise InvalidInput("measurement", measurement, "give a finite value")
        self.measured[k] = measurement
        if len(self.walk):
            step = self.rng.standard_normal((len(self.sources), 2)) @ self.process.walk_root[k].T  # type: ignore[index]
            self.walk[:, k] = (self.walk[:, k - 1] if k else 0.0) + step
        sums = self._sums.copy()
        self._accumulate(self.sources, self.walk, k, k + 1, sums)
        gain = self._log_likelihood(sums, k + 1) - self._log_likelihood(self._sums, k)
        weights = self.log_weights + np.where(np.isnan(gain), -np.inf, gain)
        top = weights.max()
        self.samples = k + 1
        if not np.isfinite(top):
            return
        total = top + np.log(np.exp(weights - top).sum())
        self.log_evidence += total
        # a particle that has left the map does not come back
        self._sums = np.where(np.isnan(sums), 0.0, sums)
        self.log_weights = weights - total
        if self.effective_sample_size < self.threshold * len(weights):
            self._resample()

    def _accumulate(
        self, sources: np.ndarray, walk: np.ndarray, start: int, stop: int, sums: np.ndarray
    ) -> None:
        self.looked_up += len(sources) * (stop - start)
        offset = self.process.offset
        kernels.accumulate(
            sources,
            walk,
            self.process.response,
            np.zeros((0, sources.shape[1])) if offset is None else offset,
            self._places,
            self.measured,
            start,
            stop,
            self.sensor.field,
            sums,
        )

    def _log_likelihood(self, sums: np.ndarray, n: int) -> np.ndarray:
        """Of n residuals given by their sum and sum of squares, the constant offset integrated out."""
        variance, offset = self.sensor.noise**2, self.sensor.bias**2
        shrink = offset / (variance + n * offset)
        return -0.5 * (
            (sums[:, 1] - shrink * sums[:, 0] ** 2) / variance
            + n * np.log(2.0 * np.pi * variance)
            + np.log1p(n * offset / variance)
        )

    # -- resampling ----------------------------------------------------------------------------------------
    def _resample(self) -> None:
        weights = self.weights
        mean = weights @ self.sources
        centred = self.sources - mean
        covariance = (weights[:, None] * centred).T @ centred
        chosen = np.empty(len(weights), dtype=np.int64)
        kernels.systematic(weights, self.rng.random(), chosen)
        self.sources, self._sums = self.sources[chosen], self._sums[chosen]
        if len(self.walk):
            self.walk[:, : self.samples] = self.walk[chosen, : self.samples]
        self.log_weights = np.full(len(weights), -np.log(len(weights)))
        self.resampled += 1
        if self.rejuvenation == "none":
            return
        # a floor keeps the root defined where all particles have become one
        values, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(values, 1e-12))
        price = len(weights) * self.samples
        if self.rejuvenation == "moves" and 2 * price <= self.allowance:
            if self.relinearise and self.process.about is not None:
                self.allowance -= price
                self._linearise(mean)
            for turn in range(self.moves):
                if price <= self.allowance:
                    self.allowance -= price
                    self._move(mean, root, turn % 2)
        else:
            keep = np.sqrt(1.0 - self.bandwidth**2)
            jitter = self.rng.standard_normal(self.sources.shape) @ root.T
            self.sources = mean + keep * (self.sources - mean) + self.bandwidth * jitter

    def _linearise(self, mean: np.ndarray) -> None:
        """Renew the process about the mean of the sources, and the sums of all particles with it."""
        assert self.process.about is not None
        self.process = self.process.about(mean)
        self._sums = np.zeros_like(self._sums)
        self._accumulate(self.sources, self.walk, 0, self.samples, self._sums)

    def _move(self, mean: np.ndarray, root: np.ndarray, kind: int) -> None:
        """One Metropolis step of every particle towards the posterior of its sources given its walk.

        Turn and turn about a random walk, which serves several modes, and a step of an autoregression
        whose stationary distribution is the normal one with the particles' mean and covariance: where the
        posterior is nearly that, it is accepted however many the sources.
        """
        step = self._steps[kind]
        kick = self.rng.standard_normal(self.sources.shape)
        proposal = self.sources + step * (kick @ root.T)
        if kind:
            whitened = np.linalg.solve(root, (self.sources - mean).T).T
            moved = np.sqrt(1.0 - step**2) * whitened + step * kick
            proposal = mean + moved @ root.T
        sums = np.zeros_like(self._sums)
        self._accumulate(proposal, self.walk, 0, self.samples, sums)
        gain = self._log_likelihood(sums, self.samples) - self._log_likelihood(self._sums, self.samples)
        gain += 0.5 * ((self.sources**2).sum(axis=1) - (proposal**2).sum(axis=1))
        if kind:
            gain += 0.5 * ((moved**2).sum(axis=1) - (whitened**2).sum(axis=1))
        # NaN, off the map, compares as False
        take = np.log1p(-self.rng.random(len(gain))) < gain
        self.sources[take], self._sums[take] = proposal[take], sums[take]
        rate = take.mean()
        self.accepted += int(take.sum())
        self.proposed += len(take)
        factor = 0.7 if rate < ACCEPTANCE[0] else 1.4 if rate > ACCEPTANCE[1] else 1.0
        self._steps[kind] = min(step * factor, 1.0)

    # -- what is known ---------------------------------------------------------------------------------------
    @property
    def weights(self) -> np.ndarray:
        """Normalised weights, shape (P,)."""
        weights = np.exp(self.log_weights)
        return weights / weights.sum()

    @property
    def effective_sample_size(self) -> float:
        """``1 / sum of squared weights``: equal particles that would be worth as much."""
        return float(1.0 / np.sum(self.weights**2))

    def errors(self, k: int) -> np.ndarray:
        """Position error (north, east) of every particle at sample `k`, m, shape (P, 2)."""
        errors = self.sources @ self.process.response[k].T
        return errors + self.walk[:, k] if len(self.walk) else errors

    def shifted(self, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Latitudes and longitudes (rad) of the INS track without position errors, m, shape (N, 2)."""
        shift = errors * self._places[:, 2:]
        return self._places[:, 0] - shift[:, 0], self._places[:, 1] - shift[:, 1]

    def position(self, k: int | None = None) -> tuple[float, float]:
        """Estimated latitude and longitude, rad, at the last sample used (or at sample `k`, smoothed)."""
        k = self._sample(k)
        north, east = self.weights @ self.errors(k) * self._places[k, 2:]
        return float(self._places[k, 0] - north), float(self._places[k, 1] - east)

    def covariance(self, k: int | None = None) -> np.ndarray:
        """Covariance of that position (north, east), m^2, shape (2, 2)."""
        errors, weights = self.errors(self._sample(k)), self.weights
        centred = errors - weights @ errors
        return (weights[:, None] * centred).T @ centred

    def bimodality(self) -> float:
        """`bimodality` of the position at the last sample used."""
        return bimodality(self.errors(self._sample(None)), self.weights)

    def best(self) -> int:
        """Index of the particle of the greatest posterior density among those on the map."""
        sums = np.zeros_like(self._sums)
        self._accumulate(self.sources, self.walk, 0, self.samples, sums)
        density = self._log_likelihood(sums, self.samples) - 0.5 * (self.sources**2).sum(axis=1)
        return int(np.argmax(np.where(np.isnan(density), -np.inf, density)))

    def _sample(self, k: int | None) -> int:
        return max(self.samples - 1, 0) if k is None else k


def bimodality(points: np.ndarray, weights: np.ndarray) -> float:
    """Part of the variance that is between two groups, at the best cut across the long axis (Otsu 1979).

    2/pi = 0.64 for a normal distribution, 0.75 for an even one, 1 for two separate places.

    Parameters
    ----------
    points : ndarray, shape (P, 2)
        Positions.
    weights : ndarray, shape (P,)
        Normalised weights.

    Returns
    -------
    float
        Between 0 and 1; 0 where all points are one.
    """
    centred = points - weights @ points
    covariance = (weights[:, None] * centred).T @ centred
    values, vectors = np.linalg.eigh(covariance)
    if not values[1] > 0.0:
        return 0.0
    along = centred @ vectors[:, 1]
    order = np.argsort(along, kind="stable")
    mass = np.cumsum(weights[order])[:-1]
    moment = np.cumsum((weights * along)[order])[:-1]
    # mass (1 - mass) times the squared distance of the two means, whose overall mean is zero
    inner = (mass > 0.0) & (mass < 1.0)
    between = moment[inner] ** 2 / (mass[inner] * (1.0 - mass[inner]))
    return float(between.max(initial=0.0) / values[1])
