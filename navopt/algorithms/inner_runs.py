"""Many runs of one solver on one problem, side by side: each batch holds the candidates of all of them.

A run here is the same, bit for bit, as the same solver alone with the same seed. Runs of a swarm advance in
lockstep, by its pure functions on stacked arrays; runs of any other solver are asked and told one after
another.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pymoo.core.algorithm import Algorithm
from pymoo.core.population import Population
from pymoo.core.termination import NoTermination

from navopt import registry
from navopt.algorithms.swarm import Arrays, SwarmAlgorithm
from navopt.evaluation import CountingEvaluator

__all__ = ["AskedRuns", "InnerRuns", "SwarmRuns", "inner_runs"]

#: What decides how a swarm is stepped; a subclass with a loop of its own is asked and told instead.
_LOOP = ("_initialize_infill", "_initialize_advance", "_infill", "_advance", "_plan", "_next_stage")


def inner_runs(
    solver: str,
    options: dict[str, Any],
    problem: Any,
    seeds: Sequence[int],
    *,
    evaluator: CountingEvaluator,
    cycles: int,
    threshold: float | None = None,
    tolerance: float | None = None,
) -> InnerRuns:
    """Begin a run of a registered solver for every seed.

    Parameters
    ----------
    solver : str
        Registry name.
    options : dict
        Keywords of its factory.
    problem : EstimationProblem
        What all runs solve.
    seeds : sequence of int
        One for each run.
    evaluator : CountingEvaluator
        Where a solver with a kernel of its own charges its model runs.
    cycles : int
        Cycles of a run: the solver's own where it counts them, its batches after the first otherwise.
    threshold : float, optional
        A run ends when its best loss is this or less.
    tolerance : float, optional
        A run ends when a cycle has lowered its best loss by this or less.

    Returns
    -------
    InnerRuns
    """

    def begin(seed: int) -> Algorithm:
        algorithm = registry.make_solver(solver, **options)
        algorithm.evaluator = evaluator
        return algorithm.setup(problem, seed=int(seed), termination=NoTermination())

    conditions = {"cycles": cycles, "threshold": threshold, "tolerance": tolerance}
    leader = begin(seeds[0])
    if _goes_in_lockstep(leader):
        return SwarmRuns(leader, problem, seeds, **conditions)
    return AskedRuns([leader, *(begin(seed) for seed in seeds[1:])], problem, **conditions)


def _goes_in_lockstep(algorithm: Algorithm) -> bool:
    if not isinstance(algorithm, SwarmAlgorithm) or algorithm.update != "synchronous":
        return False
    return all(getattr(type(algorithm), name) is getattr(SwarmAlgorithm, name) for name in _LOOP)


class InnerRuns:
    """Base: who is still going, and the best that each run has seen.

    Parameters
    ----------
    problem : EstimationProblem
        What they solve.
    runs : int
        How many.
    cycles, threshold, tolerance
        See `inner_runs`.

    Attributes
    ----------
    best : ndarray, shape (runs, n_var)
        Best point of each run; the problem's nominal values until one could be evaluated.
    best_loss : ndarray, shape (runs,)
        Its loss, ``inf`` until then.
    going : ndarray of bool, shape (runs,)
        Runs that have not ended.
    """

    def __init__(
        self, problem: Any, runs: int, *, cycles: int, threshold: float | None, tolerance: float | None
    ) -> None:
        self.problem = problem
        self.cycles, self.threshold, self.tolerance = cycles, threshold, tolerance
        self.best = np.tile(np.asarray(problem.nominal, dtype=float), (runs, 1))
        self.best_loss = np.full(runs, np.inf)
        self.last_loss = np.full(runs, np.inf)  # at the end of the last cycle
        self.going = np.ones(runs, dtype=bool)

    def ask(self) -> np.ndarray:
        """Candidates of the next batch, shape (m, n_var); none when all runs have ended."""
        raise NotImplementedError

    def tell(self, X: np.ndarray, losses: np.ndarray) -> None:
        """Go on with the losses, shape (m,), of the candidates asked for."""
        raise NotImplementedError

    def _close_cycle(self, runs: np.ndarray, last: np.ndarray) -> None:
        """End those of `runs`, a mask, that meet one of the conditions; `last`: whose cycles are used up."""
        ends = last.copy()
        if self.threshold is not None:
            ends |= self.best_loss <= self.threshold
        if self.tolerance is not None:
            known = np.isfinite(self.last_loss)
            change = np.where(known, self.last_loss, 0.0) - np.where(known, self.best_loss, 0.0)
            ends |= known & (change <= self.tolerance)
        self.last_loss = np.where(runs, self.best_loss, self.last_loss)
        self.going &= ~(ends & runs)


class SwarmRuns(InnerRuns):
    """Runs of a synchronous swarm, advanced together on arrays with a leading axis.

    Parameters
    ----------
    leader : SwarmAlgorithm
        The swarm, set up; its functions move all runs.
    problem : EstimationProblem
        What they solve.
    seeds : sequence of int
        One for each run.
    **conditions
        ``cycles, threshold, tolerance``; see `inner_runs`.

    Attributes
    ----------
    state : dict of ndarray
        Of all swarms, a leading axis before that of `SwarmAlgorithm`; empty before the first population.
    cycle : int
        Completed cycles.
    """

    def __init__(self, leader: SwarmAlgorithm, problem: Any, seeds: Sequence[int], **conditions: Any) -> None:
        super().__init__(problem, len(seeds), **conditions)
        self.leader = leader
        # as pymoo's setup makes them
        self.generators = [np.random.default_rng(int(seed)) for seed in seeds]
        self.constants = leader.constants(problem)
        self.state: Arrays = {}
        self.draws: Arrays = {}
        self.stage, self.cycle = -1, 0  # stage -1: the first population
        self.mask = np.ones((len(seeds), leader.pop_size), dtype=bool)
        self.candidates = np.zeros(0)

    def ask(self) -> np.ndarray:
        """Candidates of the next phase in which anybody moves, run by run."""
        if self.stage < 0:
            n, d = self.leader.pop_size, self.problem.n_var
            drawn = [self.leader.draw_initial(generator, n, d) for generator in self.generators]
            self.candidates = np.stack([self.leader.initialize(self.constants, one) for one in drawn])
            return self.candidates[self.mask]
        while self.going.any():
            if self.stage == 0:
                self._draw()
            phase = self.leader.phases[self.stage]
            self.candidates, mask = self.leader.move(self.state, self.draws, phase)
            self.mask = mask & self.going[:, None]
            if self.mask.any():
                return self.candidates[self.mask]
            self._next_stage()
        return np.zeros((0, self.problem.n_var))

    def tell(self, X: np.ndarray, losses: np.ndarray) -> None:
        """Select, as each run alone would: one in which nobody moved skips the phase."""
        full = np.full(self.mask.shape, np.inf)
        full[self.mask] = losses
        # what was evaluated is what comes back, should a user have changed it between ask and tell
        self.candidates = np.array(self.candidates)
        self.candidates[self.mask] = X
        every, k = np.arange(len(full)), np.argmin(full, axis=1)
        better = full[every, k] < self.best_loss
        self.best[better] = self.candidates[every, k][better]
        self.best_loss[better] = full[every, k][better]
        if self.stage < 0:
            self._found(full)
            return
        phase = self.leader.phases[self.stage]
        after = self.leader.select(self.state, self.draws, phase, self.candidates, full, self.mask)
        idle = ~self.mask.any(axis=1)
        for key in set(after) - set(self.constants) if idle.any() else ():
            after[key] = np.array(after[key])
            after[key][idle] = self.state[key][idle]
        self.state = after
        self._next_stage()

    def _found(self, losses: np.ndarray) -> None:
        states = [
            self.leader.found(self.constants, self.candidates[k], losses[k]) for k in range(len(losses))
        ]
        self.state = {
            key: value if key in self.constants else np.stack([state[key] for state in states])
            for key, value in states[0].items()
        }
        self.stage = 0
        self._close_cycle(self.going, np.zeros_like(self.going))

    def _draw(self) -> None:
        n, d = self.leader.pop_size, self.problem.n_var
        drawn = [self.leader.draw(generator, n, d) for generator in self.generators]
        self.draws = {key: np.stack([one[key] for one in drawn]) for key in drawn[0]}

    def _next_stage(self) -> None:
        self.stage += 1
        if self.stage == len(self.leader.phases):
            self.stage = 0
            self.cycle += 1
            self._close_cycle(self.going, np.full(len(self.going), self.cycle >= self.cycles))


class AskedRuns(InnerRuns):
    """Runs of any solver, asked and told one after another; a batch holds one batch of each.

    Parameters
    ----------
    algorithms : list of pymoo.core.algorithm.Algorithm
        One for each run, set up.
    problem : EstimationProblem
        What they solve.
    **conditions
        ``cycles, threshold, tolerance``; see `inner_runs`.

    Attributes
    ----------
    batches : ndarray of int, shape (runs,)
        Batches told to each run.
    """

    def __init__(self, algorithms: list[Any], problem: Any, **conditions: Any) -> None:
        super().__init__(problem, len(algorithms), **conditions)
        self.algorithms = algorithms
        self.batches = np.zeros(len(algorithms), dtype=np.int64)
        self.asked: list[tuple[int, Population, list[int]]] = []

    def ask(self) -> np.ndarray:
        """Candidates of the next batch of every run that is still going."""
        while self.going.any():
            self.asked = []
            for run in np.flatnonzero(self.going):
                batch = self.algorithms[run].ask()
                todo = [k for k, individual in enumerate(batch) if "F" not in individual.evaluated]
                self.asked.append((int(run), batch, todo))
            rows = [batch[todo].get("X") for _, batch, todo in self.asked if todo]
            if rows:
                return np.concatenate(rows).astype(float)
            self.tell(np.zeros((0, self.problem.n_var)), np.zeros(0))
        return np.zeros((0, self.problem.n_var))

    def tell(self, X: np.ndarray, losses: np.ndarray) -> None:
        """Hand every run its losses."""
        asked, self.asked, start = self.asked, [], 0
        ended = np.zeros_like(self.going)
        last, closed = np.zeros_like(self.going), np.zeros_like(self.going)
        for run, batch, todo in asked:
            own = slice(start, start + len(todo))
            start += len(todo)
            for k, x, loss in zip(todo, X[own], losses[own], strict=True):
                batch[k].X, batch[k].F = x, np.array([loss])
                batch[k].evaluated.update(("F", "G", "H"))
            if todo and losses[own].min() < self.best_loss[run]:
                k = start - len(todo) + int(np.argmin(losses[own]))
                self.best[run], self.best_loss[run] = X[k], losses[k]
            algorithm = self.algorithms[run]
            before = getattr(algorithm, "cycle", None)
            algorithm.tell(infills=batch)
            self.batches[run] += 1
            ended[run] = not algorithm.has_next()
            done = self.batches[run] - 1 if before is None else algorithm.cycle
            closed[run] = before is None or self.batches[run] == 1 or algorithm.cycle != before
            last[run] = self.batches[run] > 1 and done >= self.cycles
        self._close_cycle(closed | ended, last | ended)
