"""What the colonies that match single points to a map share: search, counting, and one proposal."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pymoo.core.population import Population

from navopt.algorithms.guided_bee_colony import GuidedBeeColony
from navopt.algorithms.options import at_least, number
from navopt.algorithms.swarm import Arrays, ContractedAlgorithm
from navopt.models.earth import to_geodetic

__all__ = ["PointMatcher"]

#: Cycles of a run that has neither a number of them nor a budget.
OWN_CYCLES = 30


class PointMatcher(ContractedAlgorithm):
    """One colony per sample in lockstep, a single proposal at the end.

    The colonies search the shift (north, east) of their own sample only, in the problem's box of the
    translation. A look-up of one sample on the map costs 1/window of a loss; ``counts.internal`` is the
    number of look-ups divided by the window, rounded up.

    Parameters
    ----------
    colony : dict
        Settings of the colonies, `GuidedBeeColony`'s.
    radius_m : float or None
        Half width of the search box around the inertial position, m, within the problem's box.
    cycles : int or None
        Cycles of a run; None for as many as the budget allows.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.
    """

    #: Settings of the colonies, by the names they have there.
    colony: ClassVar[tuple[str, ...]] = ("pop_size", "limit", "scouts", "selection", "guidance", "update")

    def __init__(
        self, *, colony: dict[str, Any], radius_m: float | None, cycles: int | None, **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        bees = GuidedBeeColony(**colony)
        for name in self.colony:
            setattr(self, name, getattr(bees, name))
        self.radius_m = None if radius_m is None else number("radius_m", radius_m, above=0.0)
        self.cycles = None if cycles is None else at_least("cycles", cycles, 1)
        self.state: Arrays = {}
        self.looked_up = 0

    def propose(self) -> np.ndarray:
        """Decision vector of the answer, shape (4,); a subclass finds it."""
        raise NotImplementedError

    # -- the colonies --------------------------------------------------------------------------------
    def search(self, samples: np.ndarray) -> None:
        """Run a colony for each of the samples until the cycles are done or the budget is used."""
        bees = GuidedBeeColony(**{name: getattr(self, name) for name in self.colony})
        n, rng = self.pop_size, self.random_state
        nominal = self.problem.nominal[:2]
        reach = np.inf if self.radius_m is None else self.radius_m
        box = {
            "lower": np.maximum(self.problem.xl[:2], nominal - reach),
            "upper": np.minimum(self.problem.xu[:2], nominal + reach),
        }
        self._places = self.shape()[samples, None]
        self._measured = self.problem.measured[samples, None]
        remaining = self.evaluator.remaining
        # everything but the one loss of the proposal may go into look-ups
        self._left = np.inf if np.isinf(remaining) else (int(remaining) - 1) * self.problem.window
        last = (OWN_CYCLES if np.isinf(remaining) else np.inf) if self.cycles is None else self.cycles
        positions = bees.initialize(box, {"position": rng.random((len(samples), n, 2))})
        losses, _ = self._look_up(positions, np.ones(positions.shape[:-1], dtype=bool))
        self.state = bees.found(box, positions, losses)
        cycle = 0
        while self._left > 0 and cycle < last:
            draws = bees.split(rng.random((len(samples), bees.block(n, 2))), n, 2)
            for phase in bees.phases:
                alone = self.update == "sequential" and phase not in bees.together
                for only in range(n) if alone else [None]:
                    positions, mask = bees.move(self.state, draws, phase)
                    if only is not None:
                        mask = mask & (np.arange(n) == only)
                    losses, mask = self._look_up(positions, mask)
                    self.state = bees.select(self.state, draws, phase, positions, losses, mask)
            cycle += 1

    def _look_up(self, shifts: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Losses |measured - map| of the shifts, shape (samples, n), and which could be afforded."""
        count = int(mask.sum())
        if count > self._left:
            # the last phase is cut bee by bee, so that all samples have had as many look-ups
            count = int(self._left)
            turns = np.flatnonzero(mask.T)[:count]
            mask = np.isin(np.arange(mask.size), turns).reshape(mask.T.shape).T
        losses = np.full(mask.shape, np.inf)
        if not count:
            return losses, mask
        problem, already = self.problem, self.looked_up
        self.looked_up += count
        self._left -= count
        self.evaluator.charge(-(-self.looked_up // problem.window) - -(-already // problem.window))
        points = (self._places + shifts)[mask]
        field = problem.field_map.value(
            *to_geodetic(points[:, 0], points[:, 1], *problem.origin), problem.method
        )
        residual = np.abs(np.broadcast_to(self._measured, mask.shape)[mask] - field)
        losses[mask] = np.where(np.isnan(residual), np.inf, residual)
        return losses, mask

    def shape(self) -> np.ndarray:
        """Inertial sequence about its centroid as the problem's nominal values have it, shape (window, 2)."""
        _, _, angle, scale = self.problem.nominal
        cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
        north, east = self.problem.sequence.T
        return np.stack([cosine * north - sine * east, sine * north + cosine * east], axis=1)

    # -- pymoo's side --------------------------------------------------------------------------------
    def _initialize_infill(self) -> Population:
        return Population.new(X=self.propose()[None])

    def _initialize_advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        # a budget used to the last unit has ended the run already, and says so
        if self.evaluator.remaining > 0:
            self.termination.terminate()

    def _infill(self) -> Population:
        # pymoo asks again only if a user goes on after the end: the answer has not changed
        return Population.new(X=self.opt.get("X"))  # type: ignore[union-attr]

    def _advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        self.termination.terminate()
