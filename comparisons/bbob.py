"""The BBOB benchmark: how much of the suite's 24 functions a solver solves, and after how many evaluations.

Every run has one budget, in proportion to the number of variables, and is recorded in the store of a study;
from the traces follow the runtimes, the cost at which each target gap was first reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.audit_solvers import solver_entries
from comparisons.bbob_functions import FUNCTIONS
from comparisons.bbob_measures import TARGETS, expected_running_times, first_hits, share_table
from comparisons.entries import RunSpec, SolverEntry
from comparisons.planning import check_names, plan
from comparisons.pool import worker_count
from comparisons.runner import execute_missing
from comparisons.store import ResultsStore
from comparisons.study import Study
from navopt import registry
from navopt.errors import InvalidInput, UnknownName

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console


__all__ = ["Benchmark", "BenchmarkResult", "run_benchmark"]


@dataclass(frozen=True)
class Benchmark:
    """What a benchmark runs.

    Attributes
    ----------
    solvers : tuple of SolverEntry
        The solvers; also given as texts such as ``"abc:limit=50"`` or tables, one or many.
    dimensions : tuple of int, default (2, 5)
        Numbers of variables.
    functions : tuple of int
        Numbers among `comparisons.bbob_functions.FUNCTIONS`; all by default.
    instances : tuple of int
        Numbers of the instances; a number n means 1 to n. Each is run once, with a solver seed of its own.
    budget_factor : int, default 200
        Cost of each run per variable.

    Raises
    ------
    InvalidInput
        If a value cannot be used.
    UnknownName
        If a solver or function is unknown.
    """

    solvers: tuple[SolverEntry, ...]
    dimensions: tuple[int, ...] = (2, 5)
    functions: tuple[int, ...] = tuple(FUNCTIONS)
    instances: tuple[int, ...] = 5  # type: ignore[assignment]
    budget_factor: int = 200

    def __post_init__(self) -> None:
        instances: Any = self.instances
        if isinstance(instances, int) and not isinstance(instances, bool):
            instances = range(1, instances + 1)
        plain: dict[str, tuple[Any, ...]] = {
            "solvers": solver_entries(self.solvers),
            "dimensions": _numbers("dimensions", self.dimensions, 2),
            "functions": _numbers("functions", self.functions, 1),
            "instances": _numbers("instances", instances, 0),
        }
        for key, value in plain.items():
            object.__setattr__(self, key, value)
        if not self.solvers:
            raise InvalidInput("solvers", self.solvers, "give at least one")
        for number in self.functions:
            if number not in FUNCTIONS:
                raise UnknownName("functions", str(number), map(str, FUNCTIONS))
        _numbers("budget_factor", (self.budget_factor,), 1)
        self.study()

    def study(self) -> Study:
        """Form in which the results are stored; the budget in it is the largest."""
        return Study(
            name="bbob",
            title="BBOB",
            problem="bbob",
            scenarios={
                _label(function, d): {"function": function, "n_var": d}
                for d in self.dimensions
                for function in self.functions
            },
            solvers=self.solvers,
            worlds=self.instances,
            seeds=tuple(_seed(function, k) for function in self.functions for k in self.instances),
            budget=self.budget_factor * max(self.dimensions),
            rank_by="gap_1",
            illustrate=0,
        )

    def runs(self) -> list[RunSpec]:
        """Every run, ordered by dimension, function, instance and solver.

        Raises
        ------
        MissingExtra
            If ``ioh`` is not installed.
        UnknownName, InvalidInput
            If a setting of a solver is unknown or refused, or two solvers are the same.
        UnsuitableProblem
            If a solver needs what the functions do not provide.
        """
        study = self.study()
        world = registry.simulate("bbob", self.instances[0], function=self.functions[0], n_var=2)
        check_names(study, "bbob")
        for entry in study.solvers:
            registry.solver_info(entry.name).check(world)
        found = []
        for label, scenario in study.scenarios.items():
            for instance in self.instances:
                alone = replace(
                    study,
                    scenarios={label: scenario},
                    worlds=(instance,),
                    seeds=(_seed(scenario["function"], instance),),
                    budget=self.budget_factor * scenario["n_var"],
                )
                found += plan(alone, "bbob")
        return found


@dataclass(frozen=True)
class BenchmarkResult:
    """What a benchmark found.

    Attributes
    ----------
    benchmark : Benchmark
        What was run.
    runs : pandas.DataFrame
        One row per run: solver, function, dimension, instance, gap (``inf`` if the run failed), cost (the
        whole budget if it failed), status, error.
    hits : ndarray, shape (runs, targets)
        Cost at which each run first reached each of `comparisons.bbob_measures.TARGETS`; else ``inf``.
    """

    benchmark: Benchmark
    runs: pd.DataFrame
    hits: np.ndarray

    @cached_property
    def shares(self) -> pd.DataFrame:
        """Shares of the targets reached, see `comparisons.bbob_measures.share_table`."""
        return share_table(self.runs, self.hits)

    def expected_running_times(self) -> pd.DataFrame:
        """See `comparisons.bbob_measures.expected_running_times`."""
        return expected_running_times(self.runs, self.hits)

    def runtimes(self, dimension: int, solver: str, functions: Sequence[int] | None = None) -> np.ndarray:
        """Runtimes of a solver in evaluations per variable, shape (runs, targets).

        Parameters
        ----------
        dimension : int
            Number of variables.
        solver : str
            Label of the solver.
        functions : sequence of int, optional
            Some of the functions; all if not given.
        """
        mine = (self.runs["dimension"] == dimension) & (self.runs["solver"] == solver)
        if functions is not None:
            mine &= self.runs["function"].isin(list(functions))
        return self.hits[mine.to_numpy()] / dimension

    def write(self, folder: str | Path) -> Path:
        """Write the page, the figures and the tables, see `comparisons.bbob_report.write_benchmark`."""
        from comparisons.bbob_report import write_benchmark

        return write_benchmark(self, folder)


def run_benchmark(
    solvers: Any,
    *,
    dimensions: Sequence[int] = (2, 5),
    functions: Sequence[int] = tuple(FUNCTIONS),
    instances: int | Sequence[int] = 5,
    budget_factor: int = 200,
    out: str | Path,
    workers: int | None = None,
    retry_failed: bool = False,
    console: Console | None = None,
) -> BenchmarkResult:
    """Run solvers on the BBOB functions, or what of it the results folder does not hold yet.

    Parameters
    ----------
    solvers : Benchmark, or what its `solvers` may be
        A `Benchmark` brings its own values of the parameters down to `budget_factor`.
    dimensions, functions, instances, budget_factor
        See `Benchmark`.
    out : path-like
        Results folder: every finished run is kept there at once and not repeated.
    workers : int, optional
        Number of processes; all available processors if not given.
    retry_failed : bool, default False
        Whether failed runs found in the folder are done again.
    console : rich.console.Console, optional
        Where progress is shown; nowhere if not given.

    Returns
    -------
    BenchmarkResult

    Raises
    ------
    InvalidInput, UnknownName, UnsuitableProblem, MissingExtra
        As `Benchmark` and `Benchmark.runs`, before anything runs.
    StoreError
        If the folder cannot be used.
    """
    chosen = solvers
    if not isinstance(chosen, Benchmark):
        chosen = Benchmark(
            solvers,
            dimensions=tuple(dimensions),
            functions=tuple(functions),
            instances=instances,  # type: ignore[arg-type]
            budget_factor=budget_factor,
        )
    workers = worker_count(workers)
    study, runs = chosen.study(), chosen.runs()
    with ResultsStore.open_for_study(out, study, runs) as store:
        execute_missing(
            store, study, runs, workers=workers, retry_failed=retry_failed, console=console, lockstep=True
        )
        return _result(chosen, runs, store)


def _result(benchmark: Benchmark, specs: list[RunSpec], store: ResultsStore) -> BenchmarkResult:
    import pandas as pd

    frame, traces = store.runs().set_index("key"), store.traces()
    rows, hits = [], []
    for spec in specs:
        if spec.key not in frame.index:
            continue
        row: Any = frame.loc[spec.key]
        failed = row["status"] == "failed"
        function, d = spec.scenario["function"], spec.scenario["n_var"]
        world: Any = registry.simulate("bbob", spec.world, function=function, n_var=d)
        trace = traces[spec.key]
        hits.append(first_hits(trace, world.minimum, TARGETS))
        rows.append(
            {
                "solver": spec.solver_label,
                "function": function,
                "dimension": d,
                "instance": spec.world,
                "gap": np.inf if failed else row["loss"] - world.minimum,
                "cost": float(spec.budget if failed else row["cost"]),
                "status": row["status"],
                "error": row["error"],
            }
        )
    return BenchmarkResult(benchmark, pd.DataFrame(rows), np.array(hits).reshape(-1, len(TARGETS)))


def _label(function: int, dimension: int) -> str:
    return f"f{function} {dimension}"


def _seed(function: int, instance: int) -> int:
    # with one seed for all functions a solver would begin at the same points on each
    return 1000 * function + instance


def _numbers(argument: str, values: Any, least: int) -> tuple[int, ...]:
    if isinstance(values, str | bytes) or not isinstance(values, Sequence | np.ndarray) or not len(values):
        raise InvalidInput(argument, values, "give a list of whole numbers")
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise InvalidInput(argument, value, f"give whole numbers from {least} on")
    if len(set(values)) != len(values):
        raise InvalidInput(argument, list(values), "give each once only")
    return tuple(int(value) for value in values)
