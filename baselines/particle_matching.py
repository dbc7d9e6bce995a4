"""Particle filter over a whole inertial track: the measurements since departure, one after another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from baselines.base import Baseline
from baselines.particle_matching_filter import FieldSensor, ParticleFilter
from baselines.particle_matching_process import (
    ErrorProcess,
    declared,
    inertial_process,
    random_walk_process,
    random_walk_steps,
)
from navopt.algorithms.options import at_least, number, one_of, switch
from navopt.errors import InvalidInput
from navopt.models.cruise import InsErrors
from navopt.problems.gravity_matching import MatchedTrack
from navopt.registry import solver

__all__ = ["FilteredTrack", "ParticleMatching"]

#: Particles below which nothing can be said.
FEWEST = 16


@dataclass(frozen=True)
class FilteredTrack(MatchedTrack):
    """Matched positions of the window and how well they are known.

    Attributes
    ----------
    latitude, longitude : ndarray, shape (window,)
        Estimated positions, rad, given all measurements; the last is the navigation fix.
    covariance : ndarray, shape (2, 2)
        Of the last position (north, east), m^2.
    effective_sample_size : float
        Of the particles at the end (for a grid filter, of its nodes).
    bimodality : float
        Of the last position, see `baselines.particle_matching_filter.bimodality`.
    log_evidence : float
        Logarithm of the probability density of all measurements.
    particles : int
        Particles (or nodes of the last grid).
    resampled : int
        Resamplings (or grids).
    acceptance : float
        Accepted part of the moves; NaN if there were none.
    """

    covariance: np.ndarray
    effective_sample_size: float
    bimodality: float
    log_evidence: float
    particles: int
    resampled: int = 0
    acceptance: float = np.nan


@solver(
    "particle-matching",
    summary="particle filter over all measurements since departure, by the linear model of INS errors",
    source="Gordon, Salmond and Smith 1993; moves after Gilks and Berzuini 2001, J. R. Stat. Soc. B 63:127",
    needs=("track",),
    spends_all=False,
    comparison_based=True,
    minimum_cost=36,
    reasons={"spends_all": "particles times samples is rarely the budget, and moves depend on the weights"},
)
class ParticleMatching(Baseline):
    """Particle filter over the whole track.

    A particle is a set of INS error sources (gyro and accelerometer biases, initial errors, slow shapes of
    the sensor noise), drawn from the prior; by the linear error model it is a whole track. Each measurement
    weighs the particles. When the effective sample size falls below `threshold` times their number, they
    are resampled (systematic) and moved apart.

    Parameters
    ----------
    model : {"inertial", "random-walk"}
        The linear error model of the INS along its track, or independent steps of the position error, as
        in `PointMass`.
    particles : int, default 1000
        Number of particles; fewer if the budget does not allow as many.
    sigmas : InsErrors, optional
        1 sigma of the error sources; what the problem declares if not given
        (`baselines.track_model.declared_errors`).
    walk : float, default 0.5
        Random walk added to the inertial model, m per root second, for what that model lacks: with 0.5 the
        shapes of sensor noise that are left out because each moves no point by more than 50 m.
    rejuvenation : {"moves", "kernel", "none"}
        After resampling: Metropolis moves that leave the posterior unchanged, at the price of looking up the
        whole track again; shrinkage towards the mean and a normal kernel (Liu and West 2001), which costs
        nothing, keeps mean and covariance, and blurs the shape; or nothing, which ends with copies of one
        particle unless there is a random walk.
    moves : int, default 4
        Moves of each particle after a resampling, as far as the budget allows; then the kernel. Turn and turn
        about a random walk and a step towards the normal distribution of the particles.
    bandwidth : float, default 0.1
        Of the kernel, in standard deviations of the particles.
    threshold : float, default 0.5
        See above.
    relinearise : bool, default True
        Linearise the inertial model anew after each resampling, midway between the INS's track and the one
        the particles believe in; else only about the INS's own. Costs as much as a move.
    passes : int, default 1
        Runs over the track, each linearised from the beginning about what the one before has found. The
        random walk needs no second.
    bias : float, optional
        1 sigma of an unknown constant offset of the measurements, in the map's unit; what the problem
        declares if not given. It enters the measurements linearly, so that it is integrated out in closed
        form (Rao-Blackwell).
    answer : {"mean", "best"}
        Estimate: the weighted mean of the tracks, or the particle of the greatest posterior density.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    The sources are constant, so that this is a sequential sampler of static parameters. With moves it is
    exact for the linearised model as the number of particles grows. A filter with positions as particles
    and a Kalman filter for the rest (Schon et al. 2005) gains nothing here: the inertial model has so
    little noise that a path of positions fixes the velocity errors anyway. What is linear in the measurement
    is the constant offset, and it is marginalised.

    A map error that is correlated along the track is taken as white, so that the covariance is too small
    there.

    A look-up of one sample costs 1/window of a unit of the budget (``counts.internal``). The answer is
    attached as a `FilteredTrack`; ``solution.x`` is its projection into the box, which the filter does not
    use.

    The recursive form is `begin`; then ``update(measurement)`` and ``position()`` of what it returns.
    """

    def __init__(
        self,
        *,
        model: str = "inertial",
        particles: int = 1000,
        sigmas: InsErrors | None = None,
        walk: float = 0.5,
        rejuvenation: str = "moves",
        moves: int = 4,
        bandwidth: float = 0.1,
        threshold: float = 0.5,
        relinearise: bool = True,
        passes: int = 1,
        bias: float | None = None,
        answer: str = "mean",
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.model = one_of("model", model, ("inertial", "random-walk"))
        self.particles = at_least("particles", particles, FEWEST)
        if sigmas is not None and not isinstance(sigmas, InsErrors):
            raise InvalidInput("sigmas", sigmas, "give a navopt.models.InsErrors or None")
        self.sigmas = sigmas
        self.walk = number("walk", walk, above=-1e-300)
        self.rejuvenation = one_of("rejuvenation", rejuvenation, ("moves", "kernel", "none"))
        self.moves = at_least("moves", moves, 1)
        self.bandwidth = number("bandwidth", bandwidth, above=0.0, most=1.0)
        self.threshold = number("threshold", threshold, above=0.0, most=1.0)
        self.relinearise = switch("relinearise", relinearise)
        self.passes = at_least("passes", passes, 1)
        self.bias = None if bias is None else number("bias", bias, above=-1e-300)
        self.answer = one_of("answer", answer, ("mean", "best"))
        self.estimate: FilteredTrack | None = None

    def begin(self, problem: Any, *, seed: int = 1, process: ErrorProcess | None = None) -> ParticleFilter:
        """Start a filter that takes one measurement at a time.

        Parameters
        ----------
        problem : GravityMatching
            Map, noise and INS positions; its measurements are not looked at.
        seed : int
            Seed of the particles.
        process : ErrorProcess, optional
            Another prior of the position error than the one of `model`.

        Returns
        -------
        ParticleFilter
            ``update(measurement)`` takes the next one, ``position()`` gives the fix at that sample.
        """
        return self._filter(problem, process or self.process(problem), self.particles, seed, np.inf)

    def process(self, problem: Any) -> ErrorProcess:
        """Prior of the position error along a problem's track."""
        errors, sensing = declared(problem)
        sigmas, heading = self.sigmas or errors, getattr(problem, "heading", None)
        if self.model == "random-walk":
            steps = random_walk_steps(problem.track, sigmas, heading=heading)
            return random_walk_process(problem.track.time, *steps)
        return inertial_process(problem.track, sigmas, sensing=sensing, heading=heading, walk=self.walk)

    def _filter(
        self, problem: Any, process: ErrorProcess, particles: int, seed: Any, allowance: float
    ) -> ParticleFilter:
        return ParticleFilter(
            process,
            FieldSensor.of(problem, bias=declared(problem)[1].bias if self.bias is None else self.bias),
            particles=particles,
            rng=np.random.default_rng(seed),
            threshold=self.threshold,
            rejuvenation=self.rejuvenation,
            moves=self.moves,
            bandwidth=self.bandwidth,
            allowance=allowance,
            relinearise=self.relinearise,
        )

    def propose(self) -> np.ndarray:
        """Projection of the filtered track into the box, shape (1, 4)."""
        problem = self.problem
        passes = 1 if self.model == "random-walk" else self.passes
        particles, spare = self._afford(passes)
        process = self.process(problem)
        looked_up = charged = 0
        for left in range(passes, 0, -1):
            # each pass may use as much of what is left for moves as the later ones
            particle_filter = self._filter(problem, process, particles, self.random_state, spare / left)
            given = particle_filter.allowance
            for measurement in problem.track.measured:
                particle_filter.update(measurement)
            if np.isfinite(spare):
                spare -= given - particle_filter.allowance
            whole = self._estimate(particle_filter)
            looked_up += particle_filter.looked_up
            due = -(-looked_up // problem.window)
            self.evaluator.charge(due - charged)
            charged = due
            about = particle_filter.process.about
            if left > 1 and about is not None:
                process = about(particle_filter.weights @ particle_filter.sources)
        self.estimate = replace(
            whole,
            latitude=whole.latitude[-problem.window :].copy(),
            longitude=whole.longitude[-problem.window :].copy(),
        )
        return problem.project(self.estimate)[None]

    def _afford(self, passes: int) -> tuple[int, float]:
        """Particles, and look-ups left for moves."""
        problem = self.problem
        budget = (self.evaluator.remaining - 1) * problem.window
        if np.isinf(budget):
            return self.particles, np.inf
        # the densities of the best particle are one more look-up of everything
        samples = len(problem.track) * (passes + (self.answer == "best"))
        share = 0.5 if self.rejuvenation == "moves" else 1.0
        particles = min(self.particles, max(int(share * budget // samples), FEWEST))
        if particles * samples > budget:
            least = -(-FEWEST * samples // problem.window) + 1
            raise InvalidInput(
                "budget",
                self.evaluator.budget,
                f"{FEWEST} particles over {samples} samples (all passes) need at least {least}",
            )
        return particles, budget - particles * samples

    def _estimate(self, particle_filter: ParticleFilter) -> FilteredTrack:
        """Every sample of the track, and what is known about the last."""
        samples = range(len(self.problem.track))
        if self.answer == "best":
            chosen = particle_filter.best()
            weights = np.zeros(len(particle_filter.weights))
            weights[chosen] = 1.0
        else:
            weights = particle_filter.weights
        errors = np.array([weights @ particle_filter.errors(k) for k in samples])
        latitude, longitude = particle_filter.shifted(errors)
        return FilteredTrack(
            latitude,
            longitude,
            covariance=particle_filter.covariance(),
            effective_sample_size=particle_filter.effective_sample_size,
            bimodality=particle_filter.bimodality(),
            log_evidence=particle_filter.log_evidence,
            particles=len(particle_filter.weights),
            resampled=particle_filter.resampled,
            acceptance=particle_filter.accepted / particle_filter.proposed
            if particle_filter.proposed
            else np.nan,
        )

    @classmethod
    def bootstrap(cls, **kwargs: Any) -> Self:
        """Build the plain bootstrap filter: random walk of the position error, no rejuvenation, one pass."""
        return cls(**{"model": "random-walk", "rejuvenation": "none", "passes": 1, **kwargs})
