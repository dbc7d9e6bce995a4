"""Many seeds of one swarm algorithm at once: the same results as one by one, in a fraction of the time.

A swarm algorithm's `move` and `select` are pure functions on arrays that broadcast over leading axes, so
the runs of all seeds on one function advance together; only the drawing of random numbers and the
evaluation are done for each by itself. What a single run spends on pymoo's bookkeeping of individuals is
most of its time on functions as cheap as these.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
from pymoo.core.termination import NoTermination

from comparisons.entries import RunGroup, RunSpec
from comparisons.store import RunRecord
from comparisons.worker import World, record_of
from navopt import registry
from navopt.algorithms.swarm import SwarmAlgorithm
from navopt.evaluation import BudgetSpent, CountingEvaluator
from navopt.solving import _conclude

__all__ = ["execute_together", "groups"]

Arrays = dict[str, np.ndarray]

#: More runs at once hardly save more time, and a killed process loses them all.
LARGEST_GROUP = 100


def groups(runs: list[RunSpec]) -> tuple[list[RunGroup], list[RunSpec]]:
    """Divide runs into groups that `execute_together` takes, and the others.

    Parameters
    ----------
    runs : list of RunSpec
        Runs of one study.

    Returns
    -------
    together : list of RunGroup
        Runs of one scenario that differ in their seeds only, of a swarm algorithm whose phases are whole
        batches; at most `LARGEST_GROUP` in each.
    others : list of RunSpec
        The rest, in the order given.
    """
    suitable = {spec.solver_label: spec for spec in runs}
    suitable = {label: spec for label, spec in suitable.items() if _synchronous(spec)}
    grouped: dict[tuple[str, str], list[RunSpec]] = {}
    for spec in runs:
        if spec.solver_label in suitable:
            grouped.setdefault((spec.solver_label, spec.scenario_label), []).append(spec)
    together = [
        RunGroup(tuple(group[k : k + LARGEST_GROUP]))
        for group in grouped.values()
        for k in range(0, len(group), LARGEST_GROUP)
    ]
    together = [group for group in together if len(group.runs) > 1]
    taken = {spec.key for group in together for spec in group.runs}
    return together, [spec for spec in runs if spec.key not in taken]


def _synchronous(spec: RunSpec) -> bool:
    algorithm = registry.make_solver(spec.solver, **spec.settings)
    # a subclass with a loop of its own may do in it what no other function tells
    own = [getattr(type(algorithm), name, None) for name in ("_infill", "_advance", "_plan")]
    return (
        isinstance(algorithm, SwarmAlgorithm)
        and algorithm.update == "synchronous"
        and own == [SwarmAlgorithm._infill, SwarmAlgorithm._advance, SwarmAlgorithm._plan]
    )


def execute_together(group: RunGroup, *, illustrate: Collection[str] = ()) -> list[RunRecord] | None:
    """Carry out the runs of a group, which differ in their seeds only.

    Parameters
    ----------
    group : RunGroup
        One from `groups`.
    illustrate : collection of str, keyword-only
        World keys whose illustration is attached to the first run on them.

    Returns
    -------
    list of RunRecord or None
        What `comparisons.worker.execute` gives for each, times apart: each run has an equal share of the
        time of the group. None where this way is not open: a run ends within its first batch, something
        is raised, or the boxes differ.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C; half a group must not pass for a whole one.
    """
    started = time.perf_counter()
    wanted, world, runs, extras = set(illustrate), World(), [], []
    try:
        for spec in group.runs:
            problem, twins = world.enter(spec)
            runs.append((_begin(spec, problem), problem))
            picture = None
            if spec.world_key in wanted:
                wanted.remove(spec.world_key)
                picture = {name: np.asarray(array) for name, array in problem.illustration().items()}
            extras.append((twins, picture))
        state = _stacked(runs)
        if state is None:
            return None
        _advance(runs, state)
        each = (time.perf_counter() - started) / len(runs)  # what a run alone takes has no scoring either
        records = []
        for spec, (algorithm, problem), (twins, picture) in zip(group.runs, runs, extras, strict=True):
            solution = _conclude(
                algorithm, problem, "budget", budget=spec.budget, seed=spec.seed, target=None
            )
            records.append(record_of(spec, solution, [solution.apply(twin) for twin in twins], picture))
    except Exception:  # one run's fault must not be that of the others: each will show alone
        return None
    return [_timed(record, each, len(records)) for record in records]


def _timed(record: RunRecord, elapsed_s: float, runs: int) -> RunRecord:
    trace = record.trace.copy()
    trace["elapsed_s"] /= runs
    return replace(record, elapsed_s=elapsed_s, trace=trace)


def _begin(spec: RunSpec, problem: Any) -> Any:
    """Algorithm after the first batch, exactly as `navopt.solve` comes there."""
    algorithm: Any = registry.make_solver(spec.solver, **spec.settings)
    algorithm.evaluator = CountingEvaluator(budget=spec.budget, n_var=problem.n_var)
    algorithm.setup(problem, seed=spec.seed, termination=NoTermination())
    first = algorithm._initialize_infill()
    algorithm.evaluator.eval(problem, first)
    if algorithm.evaluator.remaining == 0:
        raise BudgetSpent
    algorithm._initialize_advance(first)
    return algorithm


def _stacked(runs: list[tuple[Any, Any]]) -> Arrays | None:
    """States of all runs with a leading axis; what belongs to the problem is shared."""
    shared = [algorithm.constants(problem) for algorithm, problem in runs]
    if not all(np.array_equal(one[key], shared[0][key]) for one in shared for key in shared[0]):
        return None
    states = [algorithm.state for algorithm, _ in runs]
    return {
        key: states[0][key] if key in shared[0] else np.stack([state[key] for state in states])
        for key in states[0]
    }


def _advance(runs: list[tuple[Any, Any]], state: Arrays) -> None:
    leader, problem = runs[0]
    fixed = set(leader.constants(problem))
    going = np.ones(len(runs), dtype=bool)
    while going.any():
        drawn = [leader.draw(algorithm.random_state, leader.pop_size, problem.n_var) for algorithm, _ in runs]
        draws = {key: np.stack([one[key] for one in drawn]) for key in drawn[0]}
        for phase in leader.phases:
            candidates, mask = leader.move(state, draws, phase)
            mask = mask & going[:, None]
            losses = np.full(mask.shape, np.inf)
            for k in np.flatnonzero(mask.any(axis=1)):
                losses[k, mask[k]], going[k] = _evaluate(*runs[k], candidates[k][mask[k]])
            if not going.any():
                return
            after = leader.select(state, draws, phase, candidates, losses, mask)
            state = _unless(~mask.any(axis=1), state, after, fixed)


def _evaluate(algorithm: Any, problem: Any, X: np.ndarray) -> tuple[np.ndarray, bool]:
    """Losses, ``+inf`` for those beyond the budget, and whether the run goes on."""
    evaluator = algorithm.evaluator
    affordable = X[: int(evaluator.remaining)]
    losses = np.full(len(X), np.inf)
    losses[: len(affordable)] = problem.loss(affordable)
    evaluator._record(problem, affordable, losses[: len(affordable)])
    return losses, evaluator.remaining > 0


def _unless(idle: np.ndarray, before: Arrays, after: Arrays, fixed: set[str]) -> Arrays:
    """`after`, but `before` for the runs in which nobody moved: alone they skip the phase."""
    if not idle.any():
        return after
    kept = dict(after)
    for key in set(after) - fixed:
        kept[key] = np.array(after[key])
        kept[key][idle] = before[key][idle]
    return kept
