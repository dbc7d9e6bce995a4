"""The audit of a solver: whether it finds minima, or only those that lie where it looks anyway.

Algorithms have been published whose results come from the place of the optimum: a search that walks to
the origin of its own accord solves every function that has its minimum there, and one that samples the
centre needs no search at all (Kudela 2022, Nat. Mach. Intell. 4:1238). The audit runs the same functions
with the minimum in several places of the same box, beside solvers that are known to have no such
preference, and compares seed by seed.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.audit_solvers import audit_file, solver_entries
from comparisons.audit_suite import BIASES, FAMILIES, FUNCTIONS, Case, cases
from comparisons.planning import check_names, plan
from comparisons.pool import worker_count
from comparisons.runner import execute_missing
from comparisons.store import ResultsStore
from comparisons.study import RunSpec, SolverEntry, Study
from navopt import registry
from navopt.errors import InvalidInput, UnknownName

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from comparisons.audit_measures import Verdict

__all__ = ["REFERENCES", "Audit", "AuditResult", "run_audit"]

#: Solvers known to prefer no place, beside which the audited ones are shown and judged by the same rule.
REFERENCES = ("random-search", "nelder-mead", "de", "cmaes")
#: The budget of papers 000 and 001: 20 individuals, 100 generations and the initial ones.
BUDGET = 2020
#: With fewer pairs of runs no interval of a median is meaningful.
FEWEST_SEEDS = 6


@dataclass(frozen=True)
class Audit:
    """What an audit runs.

    Attributes
    ----------
    solvers : tuple of SolverEntry
        The audited solvers; also given as texts such as ``"foa:encoding=reciprocal"`` or tables.
    references : tuple of SolverEntry
        Shown and judged beside them; one that is audited itself is left out.
    dimensions : tuple of int, default (2, 10, 30)
        Numbers of variables of the functions that take any.
    functions : tuple of str
        Names among `comparisons.audit_suite.FUNCTIONS`; all by default.
    biases : tuple of str
        Keys of `comparisons.audit_suite.BIASES`; only the families these need are run, and the plain one.
    seeds : tuple of int
        Seeds, at least 6; a number n means 0 to n - 1. Seed k draws the places of the minima and is,
        plus one, the seed of every solver.
    budget : int, default 2020
        Cost of each run.

    Raises
    ------
    InvalidInput
        If a value cannot be used.
    UnknownName
        If a name is unknown; the nearest is suggested.
    """

    solvers: tuple[SolverEntry, ...]
    references: tuple[SolverEntry, ...] = REFERENCES  # type: ignore[assignment]
    dimensions: tuple[int, ...] = (2, 10, 30)
    functions: tuple[str, ...] = FUNCTIONS
    biases: tuple[str, ...] = tuple(BIASES)
    seeds: tuple[int, ...] = 20  # type: ignore[assignment]
    budget: int = BUDGET

    def __post_init__(self) -> None:
        solvers = solver_entries(self.solvers)
        if not solvers:
            raise InvalidInput("solvers", self.solvers, "give at least one")
        told = {(entry.name, tuple(sorted(entry.settings.items(), key=str))) for entry in solvers}
        references = tuple(
            entry
            for entry in solver_entries(self.references)
            if (entry.name, tuple(sorted(entry.settings.items(), key=str))) not in told
        )
        for name in self.biases:
            if name not in BIASES:
                raise UnknownName("biases", name, BIASES)
        if not self.biases:
            raise InvalidInput("biases", self.biases, f"give at least one of {', '.join(BIASES)}")
        plain = {
            "solvers": solvers,
            "references": references,
            "dimensions": _several("dimensions", self.dimensions),
            "functions": _several("functions", self.functions),
            "biases": tuple(name for name in BIASES if name in self.biases),
            "seeds": _seeds(self.seeds),
        }
        for key, value in plain.items():
            object.__setattr__(self, key, value)
        cases(self.dimensions, self.functions)
        self.study()

    @classmethod
    def from_toml(cls, path: str | Path) -> Audit:
        """Read an audit from a file, see `comparisons.audit_solvers.audit_file`."""
        values = audit_file(path)
        first = values.pop("first_seed", 0)
        if isinstance(values.get("seeds", 20), int):
            values["seeds"] = range(first, first + values.get("seeds", 20))
        return cls(**values)

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """The functions at their dimensions."""
        return cases(self.dimensions, self.functions)

    @property
    def families(self) -> tuple[str, ...]:
        """Families that are run."""
        wanted = {"plain", *(f for name in self.biases for f in (BIASES[name].favoured, BIASES[name].other))}
        return tuple(family for family in FAMILIES if family in wanted)

    def study(self) -> Study:
        """Form in which the results are stored; not every seed meets every world in it."""
        scenarios = {
            f"{case.label} {family}": case.scenario(family)
            for case in cases(self.dimensions, self.functions)
            for family in self.families
            if case.family(family) == family
        }
        return Study(
            name="audit",
            title="Audit",
            problem="audit-function",
            scenarios=scenarios,
            solvers=(*self.solvers, *self.references),
            worlds=self.seeds,
            seeds=tuple(seed + 1 for seed in self.seeds),
            budget=self.budget,
            rank_by="gap_1",
            illustrate=0,
        )

    def runs(self) -> list[RunSpec]:
        """Every run, seed by seed: each world with the one solver seed that belongs to it.

        Raises
        ------
        UnknownName
            If a solver or one of its settings is unknown.
        InvalidInput
            If a solver refuses a setting, or two are the same.
        UnsuitableProblem
            If a solver needs what the functions do not provide.
        """
        study = self.study()
        check_names(study, "audit")
        world = registry.simulate("audit-function", 0, **self.cases[0].scenario("plain"))
        for entry in study.solvers:
            registry.solver_info(entry.name).check(world)
        return [
            spec
            for seed in self.seeds
            for spec in plan(replace(study, worlds=(seed,), seeds=(seed + 1,)), "audit")
        ]


@dataclass(frozen=True)
class AuditResult:
    """What an audit found.

    Attributes
    ----------
    audit : Audit
        What was run.
    gaps : pandas.DataFrame
        One row per run: solver, function, dimension, family, seed, gap (loss minus minimum, ``+inf`` if the
        run failed), loss, status, error, cost, elapsed_s.
    """

    audit: Audit
    gaps: pd.DataFrame

    @cached_property
    def _bias(self) -> pd.DataFrame:
        from comparisons.audit_measures import bias_table

        return bias_table(self.gaps, self.audit.cases, self.audit.biases)

    def bias(self) -> pd.DataFrame:
        """Log ratios with intervals, see `comparisons.audit_measures.bias_table`."""
        return self._bias.copy()

    def verdicts(self) -> list[Verdict]:
        """Verdict on every solver and bias, the audited solvers first."""
        from comparisons.audit_measures import judge

        return judge(self._bias)

    def biased(self, solver: str, bias: str) -> bool | None:
        """Whether a solver is biased, by its label and a key of `comparisons.audit_suite.BIASES`."""
        known = {(verdict.solver, verdict.bias.name): verdict.biased for verdict in self.verdicts()}
        if (solver, bias) not in known:
            raise UnknownName("solver and bias", f"{solver} {bias}", [" ".join(key) for key in known])
        return known[solver, bias]

    def text(self) -> str:
        """Verdicts in words, one paragraph for each audited solver."""
        from comparisons.audit_wording import paragraphs

        return "\n\n".join(paragraphs(self).values())

    def write(self, path: str | Path) -> Path:
        """Write the page and its tables, see `comparisons.audit_report.write_audit`."""
        from comparisons.audit_report import write_audit

        return write_audit(self, path)


def run_audit(
    solvers: Any,
    *,
    references: Any = REFERENCES,
    dimensions: Sequence[int] = (2, 10, 30),
    functions: Sequence[str] = FUNCTIONS,
    biases: Sequence[str] = tuple(BIASES),
    seeds: int | Sequence[int] = 20,
    budget: int = BUDGET,
    out: str | Path | None = None,
    workers: int | None = None,
    retry_failed: bool = False,
    console: Console | None = None,
) -> AuditResult:
    """Audit solvers for biases to a place.

    Parameters
    ----------
    solvers : Audit, or what its `solvers` may be
        An `Audit` brings its own values of all parameters down to `budget`.
    references, dimensions, functions, biases, seeds, budget
        See `Audit`.
    out : path-like, optional
        Results folder: every finished run is kept there at once and not repeated, so an interrupted audit
        continues, and another one in the same folder finds the references done. Nothing is kept if not
        given.
    workers : int, optional
        Number of processes; all available processors if not given.
    retry_failed : bool, default False
        Whether failed runs found in the folder are done again.
    console : rich.console.Console, optional
        Where progress is shown; nowhere if not given.

    Returns
    -------
    AuditResult

    Raises
    ------
    InvalidInput, UnknownName, UnsuitableProblem
        As `Audit` and `Audit.runs`, before anything runs.
    StoreError
        If the folder cannot be used.
    """
    audit = solvers
    if not isinstance(audit, Audit):
        audit = Audit(
            solvers,
            references=references,
            dimensions=dimensions,  # type: ignore[arg-type]
            functions=functions,  # type: ignore[arg-type]
            biases=biases,  # type: ignore[arg-type]
            seeds=seeds,  # type: ignore[arg-type]
            budget=budget,
        )
    if out is not None:
        return _run(audit, out, workers, retry_failed, console)
    with tempfile.TemporaryDirectory(prefix="navopt-audit-") as folder:
        return _run(audit, folder, workers, retry_failed, console)


def _run(
    audit: Audit, out: str | Path, workers: int | None, retry_failed: bool, console: Console | None
) -> AuditResult:
    workers = worker_count(workers)
    study, runs = audit.study(), audit.runs()
    with ResultsStore.open_for_study(out, study, runs) as store:
        execute_missing(
            store, study, runs, workers=workers, retry_failed=retry_failed, console=console, lockstep=True
        )
        return AuditResult(audit, _gaps(audit, store.runs()))


def _gaps(audit: Audit, runs: pd.DataFrame) -> pd.DataFrame:
    import pandas as pd

    places = {
        f"{case.label} {family}": (case.function, case.dimension, family)
        for case in audit.cases
        for family in audit.families
    }
    where = pd.DataFrame(
        [places[label] for label in runs["scenario"]],
        columns=["function", "dimension", "family"],
        index=runs.index,
    )
    gap = runs["score.gap_1"] if "score.gap_1" in runs else pd.Series(np.inf, index=runs.index)
    gap = gap.where(runs["status"] != "failed", np.inf).fillna(np.inf)
    frame = pd.concat([runs[["solver"]], where], axis=1)
    frame = frame.assign(seed=runs["world"], gap=gap)
    return pd.concat([frame, runs[["loss", "status", "error", "cost", "elapsed_s"]]], axis=1)


def _several(argument: str, values: Any) -> tuple[Any, ...]:
    if isinstance(values, str | bytes) or not isinstance(values, Sequence | np.ndarray):
        raise InvalidInput(argument, values, "give a list")
    return tuple(values)


def _seeds(values: Any) -> tuple[int, ...]:
    if isinstance(values, int) and not isinstance(values, bool):
        values = range(values)
    seeds = tuple(int(v) if isinstance(v, np.integer) else v for v in _several("seeds", values))
    if len(seeds) < FEWEST_SEEDS:
        raise InvalidInput("seeds", len(seeds), f"give at least {FEWEST_SEEDS}: fewer give no interval")
    return seeds
