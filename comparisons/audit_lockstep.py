"""Many seeds of one swarm algorithm at once: the same results as one by one, in a tenth of the time.

A swarm algorithm's `move` and `select` are pure functions on arrays that broadcast over leading axes, so
the runs of all seeds on one function advance together; only the drawing of random numbers and the
evaluation are done for each by itself. What a single run spends on pymoo's bookkeeping of individuals is
most of its time on functions as cheap as these.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from pymoo.core.termination import NoTermination

from comparisons.store import RunRecord
from comparisons.study import RunSpec
from comparisons.worker import _record
from navopt import registry
from navopt.algorithms.swarm import SwarmAlgorithm
from navopt.evaluation import BudgetSpent, CountingEvaluator
from navopt.solving import _conclude

__all__ = ["execute_together", "groups"]

Arrays = dict[str, np.ndarray]


def groups(runs: list[RunSpec]) -> tuple[list[list[RunSpec]], list[RunSpec]]:
    """Divide runs into groups that `execute_together` takes, and the others.

    Parameters
    ----------
    runs : list of RunSpec
        Runs of one study.

    Returns
    -------
    together : list of list of RunSpec
        Runs that differ in seeds only, of a swarm algorithm whose phases are whole batches.
    others : list of RunSpec
        The rest, in the order given.
    """
    suitable = {spec.solver_label: spec for spec in runs}
    suitable = {label: spec for label, spec in suitable.items() if _synchronous(spec)}
    grouped: dict[tuple[str, str], list[RunSpec]] = {}
    for spec in runs:
        if spec.solver_label in suitable:
            grouped.setdefault((spec.solver_label, spec.scenario_label), []).append(spec)
    return list(grouped.values()), [spec for spec in runs if spec.solver_label not in suitable]


def _synchronous(spec: RunSpec) -> bool:
    algorithm = registry.make_solver(spec.solver, **spec.settings)
    # a subclass with a loop of its own may do in it what no other function tells
    own = [getattr(type(algorithm), name, None) for name in ("_infill", "_advance", "_plan")]
    return (
        isinstance(algorithm, SwarmAlgorithm)
        and algorithm.update == "synchronous"
        and own == [SwarmAlgorithm._infill, SwarmAlgorithm._advance, SwarmAlgorithm._plan]
    )


def execute_together(specs: list[RunSpec]) -> list[RunRecord] | None:
    """Carry out runs that differ in their seeds only.

    Parameters
    ----------
    specs : list of RunSpec
        A group from `groups`.

    Returns
    -------
    list of RunRecord or None
        What `comparisons.worker.execute` gives for each, times apart; None where this way is not open: a
        run ends within its first batch, something is raised, or the boxes differ.
    """
    started = time.perf_counter()
    try:
        runs = [_begin(spec) for spec in specs]
        state = _stacked(runs)
        if state is None:
            return None
        _advance(runs, state)
        records = [
            _record(
                spec,
                _conclude(algorithm, problem, "budget", budget=spec.budget, seed=spec.seed, target=None),
                [],
                None,
            )
            for spec, (algorithm, problem) in zip(specs, runs, strict=True)
        ]
    except Exception:  # one run's fault must not be that of the others: each will show alone
        return None
    each = (time.perf_counter() - started) / len(specs)
    return [replace(record, elapsed_s=each) for record in records]


def _begin(spec: RunSpec) -> tuple[Any, Any]:
    """Algorithm and problem after the first batch, exactly as `navopt.solve` comes there."""
    problem = registry.simulate(spec.problem, spec.world, **spec.scenario)
    algorithm: Any = registry.make_solver(spec.solver, **spec.settings)
    algorithm.evaluator = CountingEvaluator(budget=spec.budget, n_var=problem.n_var)
    algorithm.setup(problem, seed=spec.seed, termination=NoTermination())
    first = algorithm._initialize_infill()
    algorithm.evaluator.eval(problem, first)
    if algorithm.evaluator.remaining == 0:
        raise BudgetSpent
    algorithm._initialize_advance(first)
    return algorithm, problem


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
