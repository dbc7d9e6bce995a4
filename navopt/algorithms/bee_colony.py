"""Artificial bee colony (Karaboga and Basturk 2007, J. Glob. Optim. 39:459)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from navopt.algorithms.options import at_least, one_of
from navopt.algorithms.swarm import Arrays, SwarmAlgorithm
from navopt.registry import solver

__all__ = ["BeeColony"]


@solver(
    "abc",
    summary="artificial bee colony: employed bees, onlookers by roulette, one scout per cycle",
    source="Karaboga and Basturk 2007, J. Glob. Optim. 39:459",
    reasons={"comparison_based": "onlookers choose by the fitness value 1/(1+f), not by rank"},
)
class BeeColony(SwarmAlgorithm):
    """Canonical artificial bee colony on a box.

    A trial changes one dimension of one source, ``v_j = x_ij + φ (x_ij - x_kj)`` with φ uniform in
    (-1, 1) and another source k; it replaces the source if its loss is lower. Onlookers choose sources
    with probability proportional to the fitness ``1/(1+f)`` (``1+|f|`` for negative losses). The source
    that has failed most often is abandoned once it has failed more than `limit` times, and a scout
    draws a new one.

    Parameters
    ----------
    pop_size : int, default 20
        Number of sources; as many employed bees and as many onlookers.
    limit : int, optional
        Failures after which a source may be abandoned; ``pop_size * n_var`` if not given.
    dimensions : {"one", "all"}
        How many dimensions a trial changes. The canonical colony changes one; ``"all"`` is the reading
        of a formula printed without an index.
    selection : {"roulette", "relative"}
        Onlookers' probabilities: fitness over its sum, or ``0.9 fit/max(fit) + 0.1`` normalised, as in
        the authors' released program.
    scouts : {"one", "all"}
        At most one scout in a cycle (canonical), or one for every exhausted source; the best source is
        then protected.
    update : {"synchronous", "sequential"}
        See `SwarmAlgorithm`. Synchronously, all onlookers of one source start from the same position;
        the best of them may replace it, and each that fails counts as a trial.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    A cycle costs ``2 pop_size`` evaluations plus one per scout. Trial counters belong to the source an
    onlooker chose; the best solution is remembered even when its source is abandoned.
    """

    phases: ClassVar[tuple[str, ...]] = ("employed", "onlooker", "scout")
    together: ClassVar[frozenset[str]] = frozenset({"scout"})

    def __init__(
        self,
        *,
        pop_size: int = 20,
        limit: int | None = None,
        dimensions: str = "one",
        selection: str = "roulette",
        scouts: str = "one",
        update: str = "synchronous",
        **kwargs: Any,
    ) -> None:
        super().__init__(pop_size=pop_size, update=update, **kwargs)
        self.limit = None if limit is None else at_least("limit", limit, 1)
        self.dimensions = one_of("dimensions", dimensions, ("one", "all"))
        self.selection = one_of("selection", selection, ("roulette", "relative"))
        self.scouts = one_of("scouts", scouts, ("one", "all"))

    @classmethod
    def published(cls, **kwargs: Any) -> BeeColony:
        """Build with the settings of paper 003: 10 sources, limit 20, a scout for every exhausted one."""
        return cls(**{"pop_size": 10, "limit": 20, "scouts": "all", **kwargs})

    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of one cycle, uniform in [0, 1): two phases of trials and a scout per source."""
        trial = d + 2
        block = rng.random(2 * n * trial + n + n * d)
        employed, onlooker, spin, scout = np.split(block, np.cumsum([n * trial, n * trial, n]))
        return {
            "employed": employed.reshape(n, trial),
            "onlooker": onlooker.reshape(n, trial),
            "spin": spin,
            "scout": scout.reshape(n, d),
        }

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first population: positions, losses, and no failures yet."""
        state = super().found(constants, candidates, losses)
        return {**state, "trials": np.zeros(losses.shape, dtype=np.int64), "visited": losses}

    def move(self, state: Arrays, draws: Arrays, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Candidates of a phase, one per bee, and the bees that fly."""
        if phase == "scout":
            return self.initialize(state, {"position": draws["scout"]}), self._exhausted(state)
        chosen = self._choose(state, draws, phase)
        return self._trial(state, draws[phase], chosen), np.ones(state["F"].shape, dtype=bool)

    def _trial(self, state: Arrays, draws: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """Neighbours of the chosen sources, shape (..., n, d), from draws of shape (..., n, d + 2)."""
        X = state["X"]
        source = np.take_along_axis(X, chosen[..., None], axis=-2)
        partner = np.take_along_axis(X, self._partner(draws, chosen)[..., None], axis=-2)
        d = X.shape[-1]
        step = (2.0 * draws[..., 2:] - 1.0) * (source - partner)
        if self.dimensions == "one":
            step = np.where(np.arange(d) == (draws[..., 1, None] * d).astype(np.int64), step, 0.0)
        return np.clip(source + step, state["lower"], state["upper"])

    @staticmethod
    def _partner(draws: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """Another source for each bee, uniform over the others."""
        others = chosen.shape[-1] - 1
        k = (draws[..., 0] * others).astype(np.int64)
        return k + (k >= chosen)

    def _choose(self, state: Arrays, draws: Arrays, phase: str) -> np.ndarray:
        """Source of each bee, shape (..., n): an employed bee's own, an onlooker's by roulette."""
        # the roulette is set up once, when the employed bees are back, also for update="sequential"
        F = state["visited"]
        if phase == "employed":
            return np.broadcast_to(np.arange(F.shape[-1]), F.shape)
        with np.errstate(invalid="ignore"):
            fitness = np.where(F >= 0, 1.0 / (1.0 + np.abs(F)), 1.0 + np.abs(F))
        if self.selection == "relative":
            fitness = 0.9 * fitness / np.maximum(fitness.max(axis=-1, keepdims=True), 1e-300) + 0.1
        wheel = np.cumsum(fitness, axis=-1)
        total = wheel[..., -1:]
        # nobody has any fitness (all losses infinite): every source is as good
        wheel = np.where(total > 0, wheel, np.arange(1.0, F.shape[-1] + 1))
        spin = draws["spin"] * wheel[..., -1:]
        return np.sum(wheel[..., None, :] <= spin[..., :, None], axis=-1).clip(max=F.shape[-1] - 1)

    def _exhausted(self, state: Arrays) -> np.ndarray:
        """Sources to be abandoned, a mask of shape (..., n)."""
        trials = state["trials"]
        n, d = state["X"].shape[-2:]
        over = trials > (n * d if self.limit is None else self.limit)
        positions = np.arange(n)
        if self.scouts == "one":
            return over & (positions == np.argmax(trials, axis=-1)[..., None])
        return over & (positions != np.argmin(state["F"], axis=-1)[..., None])

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """Replace what has been improved and count the failures."""
        if phase == "scout":
            return {
                **state,
                "X": np.where(mask[..., None], candidates, state["X"]),
                "F": np.where(mask, losses, state["F"]),
                "trials": np.where(mask, 0, state["trials"]),
            }
        # who visits whom: (..., source, bee); the best bee of a source may replace it
        chosen = self._choose(state, draws, phase)
        visits = (chosen[..., None, :] == np.arange(mask.shape[-1])[:, None]) & mask[..., None, :]
        offered = np.where(visits, losses[..., None, :], np.inf)
        best = np.argmin(offered, axis=-1)
        best_loss = np.take_along_axis(offered, best[..., None], axis=-1)[..., 0]
        better = best_loss < state["F"]
        winner = np.take_along_axis(candidates, best[..., None], axis=-2)
        F = np.where(better, best_loss, state["F"])
        return {
            **state,
            "X": np.where(better[..., None], winner, state["X"]),
            "F": F,
            "visited": F if phase == "employed" else state["visited"],
            "trials": np.where(better, 0, state["trials"] + visits.sum(axis=-1)),
        }
