"""Running a study: whatever its store does not hold yet, on local processes, each run committed by itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Generator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from comparisons.lockstep import execute_together, groups
from comparisons.planning import check_names, plan
from comparisons.pool import WorkerPool, worker_count
from comparisons.progress import Reporter
from comparisons.store import ResultsStore, RunRecord
from comparisons.study import RunSpec, Study
from comparisons.worker import World, execute
from navopt.errors import UnknownName

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["Summary", "check_score_names", "execute_all", "execute_missing", "run_study"]


@dataclass(frozen=True)
class Summary:
    """What `run_study` did.

    Attributes
    ----------
    planned : int
        Runs that the study asks for.
    found : int
        Those already in the store, not repeated.
    executed : int
        Those executed now.
    failed : int
        Failed runs among all that the study asks for.
    elapsed_s : float
        Wall time in seconds.
    """

    planned: int
    found: int
    executed: int
    failed: int
    elapsed_s: float


def run_study(
    study: Study,
    out: str | Path,
    *,
    workers: int | None = None,
    retry_failed: bool = False,
    console: Console | None = None,
) -> Summary:
    """Execute all runs of a study that its store does not hold yet.

    Parameters
    ----------
    study : Study
        What to run.
    out : path-like
        Results folder; created, or continued where it was.
    workers : int, optional
        Number of processes; all available processors if not given. With 1 everything runs in this
        process, where a debugger can follow.
    retry_failed : bool, default False
        Whether failed runs are done again.
    console : rich.console.Console, optional
        Where progress is shown; nowhere if not given.

    Returns
    -------
    Summary

    Raises
    ------
    InvalidInput
        If an argument or a setting has an unusable value.
    UnknownName
        If the study names something unknown, or ranks by a score that its problem does not have.
    StoreError
        If the results folder cannot be used.
    KeyboardInterrupt
        After Ctrl-C; everything finished is in the store and the same call continues.

    Notes
    -----
    Results do not depend on the number of workers. Workers have one BLAS and one numba thread; with
    ``workers=1`` the libraries keep the threads that this process gave them.
    """
    started, workers = time.monotonic(), worker_count(workers)
    check_names(study, "study")
    runs = plan(study, "study")
    with ResultsStore.open_for_study(out, study, runs) as store:
        known_scores = store.score_names()
        checked: set[str] = set()
        if known_scores is not None:
            # runs of an earlier version may be without the bound: they show a dash
            check_score_names(study, known_scores, bounds=False)
        missing = _illustrations(study, runs) - store.illustrated()

        def finished(spec: RunSpec, record: RunRecord) -> None:
            if record.illustration is not None:
                missing.discard(record.world_key)
            if spec.problem not in checked and record.status != "failed":
                # the first result knows the names of the scores: better now than after the last run
                checked.add(spec.problem)
                check_score_names(study, set(record.scores))

        executed = execute_missing(
            store,
            study,
            runs,
            workers=workers,
            retry_failed=retry_failed,
            console=console,
            missing=missing,
            lockstep=study.lockstep,
            finished=finished,
        )
        after = store.statuses()
    failed = sum(after.get(spec.key) == "failed" for spec in runs)
    elapsed = time.monotonic() - started
    return Summary(len(runs), len(runs) - executed, executed, failed, elapsed)


def execute_missing(
    store: ResultsStore,
    study: Study,
    runs: list[RunSpec],
    *,
    workers: int,
    retry_failed: bool = False,
    console: Console | None = None,
    missing: Collection[str] = (),
    lockstep: bool = False,
    finished: Callable[[RunSpec, RunRecord], None] | None = None,
) -> int:
    """Execute the runs that a store does not hold and put each into it as it ends.

    Parameters
    ----------
    store : ResultsStore
        The store, open for `study`.
    study : Study
        Whose runs they are.
    runs : list of RunSpec
        All runs that the store shall hold.
    workers : int
        Number of processes.
    retry_failed, console
        As in `run_study`.
    missing, lockstep
        As in `execute_all`.
    finished : callable, optional
        Told of every run and its record, once that is stored.

    Returns
    -------
    int
        Number of runs that were executed.
    """
    started = time.monotonic()
    statuses = store.statuses()
    todo = [
        spec for spec in runs if spec.key not in statuses or (retry_failed and statuses[spec.key] == "failed")
    ]
    by_key = {spec.key: spec for spec in todo}
    with (
        Reporter(study, runs, todo, statuses, workers, console) as reporter,
        closing(execute_all(todo, workers, missing, lockstep=lockstep)) as records,
    ):
        for record in records:
            store.add(record)
            reporter.finished(by_key[record.key], record)
            if finished is not None:
                finished(by_key[record.key], record)
    if todo:
        elapsed = time.monotonic() - started
        store.note(last_run={"elapsed_s": elapsed, "workers": workers, "executed": len(todo)})
    return len(todo)


def check_score_names(study: Study, scores: set[str], *, bounds: bool = True) -> None:
    """Refuse a study that names a score which its runs do not have.

    Parameters
    ----------
    study : Study
        The study.
    scores : set of str
        Names of the scores of a run.
    bounds : bool
        Whether the run must have the bounds as well.

    Raises
    ------
    UnknownName
        Naming the scores there are.
    """
    twins = {f"held_out.{score}" for score in scores} if study.held_out else set()
    known = {*scores, *twins, "loss"}
    wanted = [
        ("rank_by", study.rank_by),
        *(("score of success", s.score) for s in study.success),
        *(("score of bound", one.score) for one in study.bound),
        *(("over of bound", one.over) for one in study.bound if bounds),
        *(("score of a printed value", value.score) for value in study.printed),
    ]
    for argument, score in wanted:
        if score not in known:
            raise UnknownName(argument, score, known)


def _illustrations(study: Study, runs: list[RunSpec]) -> set[str]:
    """World keys whose illustration the study wants kept."""
    kept = set(study.worlds[: study.illustrate])
    return {spec.world_key for spec in runs if spec.world in kept}


def execute_all(
    todo: list[RunSpec], workers: int, missing: Collection[str] = (), *, lockstep: bool = False
) -> Generator[RunRecord, None, None]:
    """Execute runs and yield their records as they come.

    Parameters
    ----------
    todo : list of RunSpec
        The runs.
    workers : int
        Number of processes; with 1 everything runs in this one.
    missing : collection of str
        World keys whose illustration is still wanted; asked before each run, so it may shrink meanwhile.
    lockstep : bool, keyword-only
        Whether runs that differ in their seeds only advance together where they can.

    Yields
    ------
    RunRecord
    """
    together, alone = groups(todo) if lockstep else ([], todo)
    if workers > 1:
        yield from WorkerPool(workers, lambda spec: spec.world_key in missing).records([*together, *alone])
        return
    for group in together:
        records = execute_together(group, illustrate=missing)
        if records is None:
            alone = [*alone, *group.runs]
        else:
            yield from records
    world = World()
    for spec in alone:
        yield execute(spec, world, illustrate=spec.world_key in missing)
