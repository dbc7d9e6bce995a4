"""What a cycle of each swarm costs beside the loss: time against pymoo's particle swarm, memory of the fish.

A cycle is the papers' iteration; it takes as many pymoo iterations as it has batches (phases with anybody
to evaluate). Solvers that need a track over a map are measured on gravity matching, the others on a sphere
of ten variables, each beside pymoo's particle swarm on the same problem in the same run.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymoo.core.termination import NoTermination

import navopt
from comparisons.speed import clocked, interleaved
from navopt.algorithms.point_matching import PointMatcher
from navopt.algorithms.swarm import SwarmAlgorithm
from navopt.problem import EstimationProblem
from navopt.registry import solver_factory, solver_info

__all__ = ["CycleCost", "FishCost", "fish_costs", "one_cycle", "swarm_costs", "swarm_names", "whole_search"]

PEER = "pso"
FISH = ("afsa", "oafsa", "nafsa")
POP_SIZE, DIMENSION = 20, 10
#: Cycles before a measurement: first calls import and compile.
WARM_UP = 3


@dataclass(frozen=True)
class CycleCost:
    """Cost of one cycle of a solver.

    Attributes
    ----------
    solver : str
        Registered name.
    problem : str
        Registered problem it was measured on.
    evaluations, batches : float
        Losses evaluated and pymoo iterations per cycle, on average.
    seconds : float
        Time per cycle beyond evaluating the loss; for a solver that searches in a kernel of its own,
        all of it.
    peer_seconds : float
        The same of pymoo's particle swarm, whose cycle is one iteration.
    """

    solver: str
    problem: str
    evaluations: float
    batches: float
    seconds: float
    peer_seconds: float


@dataclass(frozen=True)
class FishCost:
    """Cost of one cycle of a fish swarm.

    Attributes
    ----------
    solver : str
        Registered name.
    pop_size, try_number : int
        Fish, and attempts of each preying.
    evaluations : float
        Losses evaluated per cycle, on average.
    seconds : float
        Time per cycle beyond evaluating the loss.
    peak_bytes : float
        Largest memory allocated at once during a cycle, beyond what was held before it; median of cycles.
    state_bytes, draw_bytes : int
        Arrays of the state and of the random numbers of a cycle.
    """

    solver: str
    pop_size: int
    try_number: int
    evaluations: float
    seconds: float
    peak_bytes: float
    state_bytes: int
    draw_bytes: int


def swarm_names() -> list[str]:
    """Registered swarms, our own and pymoo's particle swarm; those that need a track come last."""
    swarms = [name for name in navopt.list_solvers() if _is_swarm(name)]
    return sorted(swarms, key=lambda name: (bool(solver_info(name).needs), name))


def _is_swarm(name: str) -> bool:
    return name == PEER or isinstance(navopt.make_solver(name), SwarmAlgorithm | PointMatcher)


def _begun(make: Callable[[], Any], world: EstimationProblem) -> Any:
    algorithm = make()
    algorithm.setup(world, seed=1, termination=NoTermination())
    algorithm.next()
    _advance(algorithm, WARM_UP)
    return algorithm


def _advance(algorithm: Any, cycles: int) -> int:
    """Complete a number of cycles; return the iterations they took."""
    iterations = 0
    if not hasattr(algorithm, "cycle"):  # pymoo's own: an iteration is a cycle
        for _ in range(cycles):
            algorithm.next()
        return cycles
    end = algorithm.cycle + cycles
    while algorithm.cycle < end:
        algorithm.next()
        iterations += 1
    return iterations


def one_cycle(make: Callable[[], Any], world: EstimationProblem, *, cycles: int = 30) -> Callable[[], float]:
    """Task that reports the seconds of one cycle beyond evaluating its losses, averaged over `cycles`.

    Parameters
    ----------
    make : callable
        Builds the solver.
    world : EstimationProblem
        What it solves.
    cycles : int
        How many follow one another.
    """

    def task() -> float:
        algorithm = _begun(make, world)
        before = algorithm.evaluator.n_eval
        counted: list[int] = []
        total = clocked(lambda: counted.append(_advance(algorithm, cycles)), 1)()
        batch = max(1, round((algorithm.evaluator.n_eval - before) / counted[0]))
        candidates = np.tile(world.nominal, (batch, 1))
        loss = clocked(lambda: world.loss(candidates), 50)()
        return (total - counted[0] * loss) / cycles

    return task


def whole_search(name: str, world: EstimationProblem, *, cycles: int = 30) -> Callable[[], float]:
    """Task for a solver whose run is one batch: seconds of one of its cycles, map look-ups included.

    Parameters
    ----------
    name : str
        Registered solver with the settings ``pop_size`` and ``cycles``.
    world : EstimationProblem
        What it solves.
    cycles : int
        Difference of the lengths of the two runs that are compared, so that begin and end do not count.
    """

    def run(length: int) -> Callable[[], float]:
        def once() -> None:
            algorithm = navopt.make_solver(name, pop_size=POP_SIZE, cycles=length)
            algorithm.setup(world, seed=1, termination=NoTermination())
            algorithm.next()

        return clocked(once, 1)

    def task() -> float:
        return (run(2 * cycles)() - run(cycles)()) / cycles

    return task


def _counts(make: Callable[[], Any], world: EstimationProblem, cycles: int) -> tuple[float, float]:
    """Evaluations and iterations of one cycle, on average."""
    algorithm = _begun(make, world)
    before = algorithm.evaluator.n_eval
    iterations = _advance(algorithm, cycles)
    return (algorithm.evaluator.n_eval - before) / cycles, iterations / cycles


def swarm_costs(*, repeats: int = 7, cycles: int = 40, names: list[str] | None = None) -> list[CycleCost]:
    """Measure every swarm with 20 individuals beside pymoo's particle swarm.

    Parameters
    ----------
    repeats : int
        Interleaved repetitions of each.
    cycles : int
        Cycles of one repetition.
    names : list of str, optional
        Some of `swarm_names`; all if not given.
    """
    names = swarm_names() if names is None else names
    costs = []
    for place, scenario in (("sphere", {"n_var": DIMENSION}), ("gravity-matching", {})):
        here = [name for name in names if bool(solver_info(name).needs) == (place == "gravity-matching")]
        if not here:
            continue
        world = navopt.simulate(place, 0, **scenario)
        tasks, counts = {}, {}
        for name in dict.fromkeys((PEER, *here)):
            if isinstance(navopt.make_solver(name), PointMatcher):
                tasks[name], counts[name] = whole_search(name, world, cycles=cycles), (0.0, 0.0)
            else:
                tasks[name] = one_cycle(_maker(name), world, cycles=cycles)
                counts[name] = _counts(_maker(name), world, cycles)
        seconds = interleaved(tasks, repeats=repeats)
        costs += [CycleCost(name, place, *counts[name], seconds[name], seconds[PEER]) for name in here]
    return costs


def _maker(name: str, **settings: Any) -> Callable[[], Any]:
    return lambda: navopt.make_solver(name, **{"pop_size": POP_SIZE, **settings})


def fish_costs(*, repeats: int = 7, cycles: int = 40) -> list[FishCost]:
    """Measure the fish swarms on a sphere of ten variables: 20 fish by default, then as published, 50.

    Parameters
    ----------
    repeats : int
        Interleaved repetitions of each.
    cycles : int
        Cycles of one repetition.
    """
    world = navopt.simulate("sphere", 0, n_var=DIMENSION)
    costs = []
    for make in (_maker, lambda name: solver_factory(name).published):
        makers = {name: make(name) for name in FISH}
        seconds = interleaved(
            {name: one_cycle(build, world, cycles=cycles) for name, build in makers.items()}, repeats=repeats
        )
        for name, build in makers.items():
            peak, algorithm = _peak(build, world, cycles)
            costs.append(
                FishCost(
                    solver=name,
                    pop_size=algorithm.pop_size,
                    try_number=algorithm.try_number,
                    evaluations=_counts(build, world, cycles)[0],
                    seconds=seconds[name],
                    peak_bytes=peak,
                    state_bytes=_bytes(algorithm.state),
                    draw_bytes=_bytes(algorithm.draws),
                )
            )
    return costs


def _bytes(arrays: dict[str, np.ndarray]) -> int:
    return sum(np.asarray(array).nbytes for array in arrays.values())


def _peak(make: Callable[[], Any], world: EstimationProblem, cycles: int) -> tuple[float, Any]:
    """Median over cycles of the largest memory allocated during one, and the solver afterwards."""
    algorithm = _begun(make, world)
    peaks = []
    tracemalloc.start()
    try:
        for _ in range(cycles):
            tracemalloc.reset_peak()
            before, _ = tracemalloc.get_traced_memory()
            _advance(algorithm, 1)
            peaks.append(tracemalloc.get_traced_memory()[1] - before)
    finally:
        tracemalloc.stop()
    return float(np.median(peaks)), algorithm
