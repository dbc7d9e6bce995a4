"""Point-mass filter: the exact posterior of a two-dimensional position error, on a grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from baselines.base import Baseline
from baselines.particle_matching import FilteredTrack
from baselines.particle_matching_filter import FieldSensor
from baselines.particle_matching_process import ErrorProcess, declared, random_walk_process, random_walk_steps
from baselines.point_mass_filter import PointMassFilter
from navopt.algorithms.options import at_least, number
from navopt.errors import InvalidInput
from navopt.models.cruise import InsErrors
from navopt.registry import solver

__all__ = ["PointMass"]

#: Nodes per axis below which a grid is none.
FEWEST = 20
#: Nodes per axis below which measurements are left out rather than nodes.
FAIR = 40


@solver(
    "point-mass",
    summary="grid filter over the two-dimensional position error, a random walk; exact for that model",
    source="Bergman 1999, Recursive Bayesian Estimation (Linkoping dissertation 579)",
    needs=("track",),
    stochastic=False,
    spends_all=False,
    comparison_based=True,
    minimum_cost=35,
    reasons={"spends_all": "nodes squared times samples is rarely the budget"},
)
class PointMass(Baseline):
    """Point-mass filter over all measurements since departure.

    The position error is taken to begin with a normal distribution and then to take independent normal
    steps. For this model the filter is exact up to the spacing of its grid, which makes it the reference for
    `ParticleMatching` with ``model="random-walk"``. An INS is no random walk: the filter knows nothing of the
    velocity errors that last for hours.

    Parameters
    ----------
    nodes : int, default 200
        Nodes per axis; fewer if the budget does not allow as many. Below 40 a grid is too coarse for the
        density, so that then measurements are left out: only every second, third ... before the last is used.
    sigmas : InsErrors, optional
        1 sigma of the sources of INS error, from which start and steps follow
        (`baselines.particle_matching_process.random_walk_steps`); what the problem declares if not given
        (`baselines.track_model.declared_errors`).
    step_factor : float, default 1.0
        Factor on the steps of the walk.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    A node that is looked up costs 1/window of a unit of the budget (``counts.internal``). The answer is
    attached as a `baselines.particle_matching.FilteredTrack`: each position of the window given the
    measurements up to it.

    The recursive form is `begin`; then ``update(measurement)`` and ``position()`` of what it returns.
    """

    def __init__(
        self, *, nodes: int = 200, sigmas: InsErrors | None = None, step_factor: float = 1.0, **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self.nodes = at_least("nodes", nodes, FEWEST)
        if sigmas is not None and not isinstance(sigmas, InsErrors):
            raise InvalidInput("sigmas", sigmas, "give a navopt.models.InsErrors or None")
        self.sigmas = sigmas
        self.step_factor = number("step_factor", step_factor, above=0.0)
        self.estimate: FilteredTrack | None = None

    def process(self, problem: Any) -> ErrorProcess:
        """Random walk of the position error along a problem's track."""
        sigmas = self.sigmas or declared(problem)[0]
        start, steps = random_walk_steps(problem.track, sigmas, heading=getattr(problem, "heading", None))
        return random_walk_process(problem.track.time, start, self.step_factor**2 * steps)

    def begin(self, problem: Any, *, process: ErrorProcess | None = None) -> PointMassFilter:
        """Start a filter that takes one measurement at a time.

        Parameters
        ----------
        problem : GravityMatching
            Map, noise and INS positions; its measurements are not looked at.
        process : ErrorProcess, optional
            Another random walk.

        Returns
        -------
        PointMassFilter
            ``update(measurement)`` takes the next one, ``position()`` gives the fix at that sample.
        """
        return PointMassFilter(process or self.process(problem), FieldSensor.of(problem), nodes=self.nodes)

    def propose(self) -> np.ndarray:
        """Projection of the filtered window into the box, shape (1, 4)."""
        problem = self.problem
        samples = len(problem.track)
        nodes, stride = self._afford(samples)
        used = [k for k in range(samples) if (samples - 1 - k) % stride == 0]
        self.evaluator.charge(-(-len(used) * nodes**2 // problem.window))
        grid = PointMassFilter(self.process(problem), FieldSensor.of(problem), nodes=nodes)
        positions = []
        for k, measurement in enumerate(problem.track.measured):
            if (samples - 1 - k) % stride == 0:
                grid.update(measurement)
            else:
                grid.skip()
            positions.append(grid.position())
        latitude, longitude = np.array(positions[-problem.window :]).T
        self.estimate = FilteredTrack(
            latitude.copy(),
            longitude.copy(),
            covariance=grid.covariance(),
            effective_sample_size=grid.effective_sample_size,
            bimodality=grid.bimodality(),
            log_evidence=grid.log_evidence,
            particles=nodes**2,
            resampled=grid.grids,
        )
        return problem.project(self.estimate)[None]

    def _afford(self, samples: int) -> tuple[int, int]:
        """Nodes per axis, and which measurements to use: one in how many, counted from the last."""
        look_ups = (self.evaluator.remaining - 1) * self.problem.window
        if look_ups >= samples * self.nodes**2:
            return self.nodes, 1
        enough = min(FAIR, self.nodes)
        if look_ups >= samples * enough**2:
            return int(np.sqrt(look_ups // samples)), 1
        nodes = min(enough, int(np.sqrt(look_ups)))
        return nodes, -(-samples // int(look_ups // nodes**2))
