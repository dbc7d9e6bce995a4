"""One run of a study, and the process that executes runs one after another.

The parent sends one `RunSpec` at a time and receives one `RunRecord`, or a `RunGroup` and a list of them;
it alone writes to the store.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import threading
import traceback
from multiprocessing import connection, parent_process
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.entries import RunGroup, RunSpec
from comparisons.run_key import versions
from comparisons.store import RunRecord
from navopt import registry
from navopt.problem import EstimationProblem
from navopt.solution import Solution
from navopt.solving import solve

__all__ = ["READY", "REFUSED", "World", "describe", "execute", "failed_record", "record_of", "serve"]

#: First message of a worker: it has started and imported everything.
READY = "ready"
#: Answer to a group of runs that cannot advance together: they will come one by one.
REFUSED = "refused"
#: Budget of a solver's unrecorded first run on a process.
WARM_UP_COST = 50
#: Twins are drawn from seeds far from those of worlds, so that no twin repeats a world's own noise.
HELD_OUT_SEED = 1_000_000_000


class World:
    """The world a process is working on; simulated once and kept for the runs that follow on it."""

    def __init__(self) -> None:
        self.key = ""
        self.problem: EstimationProblem | None = None
        self.twins: list[EstimationProblem] = []
        self.fault: Exception | None = None
        self.warm: set[str] = set()

    def warm_up(self, spec: RunSpec, problem: EstimationProblem) -> None:
        """Let a solver import and compile before it is timed; what it finds here is thrown away."""
        if spec.solver_label in self.warm:
            return
        self.warm.add(spec.solver_label)
        least = max(registry.solver_info(spec.solver).minimum_cost, WARM_UP_COST)
        with contextlib.suppress(Exception):
            # a fault will show again, and be recorded, in the run itself
            first = solve(problem, registry.make_solver(spec.solver, **spec.settings), budget=least)
            if first.status == "interrupted":
                raise KeyboardInterrupt

    def enter(self, spec: RunSpec) -> tuple[EstimationProblem, list[EstimationProblem]]:
        """Return the world of a run and its redrawn twins; a fault of `simulate` is raised for every run."""
        if spec.world_key != self.key:
            self.key, self.problem, self.twins, self.fault = spec.world_key, None, [], None
            try:
                self.problem = registry.simulate(spec.problem, spec.world, **spec.scenario)
            except Exception as error:
                self.fault = error
        if self.problem is None:
            assert self.fault is not None
            raise self.fault
        for k in range(len(self.twins), spec.held_out):
            self.twins.append(self.problem.redraw(HELD_OUT_SEED + 1000 * spec.world + k))
        return self.problem, self.twins[: spec.held_out]


def execute(spec: RunSpec, world: World, *, illustrate: bool = False) -> RunRecord:
    """Carry out one run; whatever it raises becomes a record with status ``failed`` and the cause.

    Parameters
    ----------
    spec : RunSpec
        The run.
    world : World
        Kept between calls; entered for this run.
    illustrate : bool, keyword-only
        Whether to attach the world's illustration.

    Returns
    -------
    RunRecord
    """
    picture = None
    try:
        problem, twins = world.enter(spec)
        if illustrate:
            picture = {name: np.asarray(array) for name, array in problem.illustration().items()}
        world.warm_up(spec, problem)
        algorithm = registry.make_solver(spec.solver, **spec.settings)
        solution = solve(problem, algorithm, budget=spec.budget, seed=spec.seed)
        if solution.status == "interrupted":
            # half a run must not pass for a whole one
            raise KeyboardInterrupt
        held_out = [solution.apply(twin) for twin in twins]
        return record_of(spec, solution, held_out, picture)
    except Exception as error:
        return failed_record(spec, describe(error), illustration=picture)


def describe(error: BaseException) -> str:
    """Cause in one line: type, message, and the last place of the traceback."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" [{Path(frames[-1].filename).name}:{frames[-1].lineno} in {frames[-1].name}: {frames[-1].line}]"
    return f"{type(error).__name__}: {error}{where if frames else ''}"


def failed_record(
    spec: RunSpec, error: str, *, illustration: dict[str, np.ndarray] | None = None
) -> RunRecord:
    """Record of a run that ended without a solution because of `error`."""
    settings = {
        "problem": spec.problem,
        "solver": spec.solver,
        "options": _json(spec.settings),
        "budget": spec.budget,
        "seed": spec.seed,
        "versions": versions(),
    }
    return RunRecord(
        key=spec.key,
        world_key=spec.world_key,
        status="failed",
        settings=settings,
        message="the run failed",
        error=error,
        illustration=illustration,
    )


def record_of(
    spec: RunSpec,
    solution: Solution,
    held_out: list[dict[str, float]],
    illustration: dict[str, np.ndarray] | None,
) -> RunRecord:
    """Record of a finished run.

    Parameters
    ----------
    spec : RunSpec
        The run.
    solution : Solution
        What it found.
    held_out : list of dict
        Scores on each redrawn twin.
    illustration : dict of str to ndarray or None
        Picture of the world, where it was asked for.

    Returns
    -------
    RunRecord
    """
    counts = {name: int(value) for name, value in dataclasses.asdict(solution.counts).items()}
    return RunRecord(
        key=spec.key,
        world_key=spec.world_key,
        status=solution.status,
        settings=_json(solution.settings),
        loss=float(solution.loss),
        elapsed_s=float(solution.elapsed_s),
        counts={**counts, "cost": int(solution.counts.cost)},
        scores={name: float(value) for name, value in solution.scores.items()},
        invalid={str(reason): int(count) for reason, count in solution.invalid.items()},
        held_out={name: float(np.mean([s[name] for s in held_out])) for name in (held_out or [{}])[0]},
        message=solution.message,
        x=np.array(solution.x, dtype=float),
        trace=np.array(solution.trace),
        estimate=_arrays(solution.estimate),
        illustration=illustration,
    )


def _arrays(thing: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Array fields of a dataclass, those of nested dataclasses with dotted names."""
    found: dict[str, np.ndarray] = {}
    if dataclasses.is_dataclass(thing):
        for item in dataclasses.fields(thing):
            value = getattr(thing, item.name)
            if isinstance(value, np.ndarray) and value.dtype != object:
                found[prefix + item.name] = value
            elif dataclasses.is_dataclass(value):
                found.update(_arrays(value, f"{prefix}{item.name}."))
    return found


def _json(value: Any) -> Any:
    """JSON form of settings; what has none is kept by its repr, for the reader only."""
    if isinstance(value, dict):
        return {str(key): _json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json(item) for item in value]
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return value if value is None or isinstance(value, bool | int | float | str) else repr(value)


def serve(channel: connection.Connection) -> None:
    """Body of a worker process: execute what arrives on `channel` until it closes."""
    from comparisons.lockstep import execute_together

    # Ctrl-C reaches the whole group; the parent decides what it means
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    world = World()
    try:
        channel.send(READY)
        while True:
            work, illustrate = channel.recv()
            if isinstance(work, RunGroup):
                channel.send(execute_together(work, illustrate=illustrate) or REFUSED)
            else:
                channel.send(execute(work, world, illustrate=illustrate))
    except (EOFError, OSError):
        return  # the parent has closed the channel or is gone


def _end_with_parent() -> None:
    # a killed parent cannot end its workers, and one deep in a long run would go on for nobody
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
