"""Running a study: whatever its store does not hold yet, on local processes, each run committed by itself."""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from comparisons.planning import check_names, plan
from comparisons.pool import WorkerPool, available_cpus
from comparisons.progress import Reporter
from comparisons.store import ResultsStore, RunRecord
from comparisons.study import RunSpec, Study
from comparisons.worker import World, execute
from navopt.errors import InvalidInput, UnknownName

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["Summary", "check_score_names", "run_study"]


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
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise InvalidInput("workers", workers, "give a whole number, at least 1, or None for all processors")
    started = time.monotonic()
    check_names(study, "study")
    runs = plan(study, "study")
    with ResultsStore.open_for_study(out, study, runs) as store:
        statuses = store.statuses()
        todo = [
            spec
            for spec in runs
            if spec.key not in statuses or (retry_failed and statuses[spec.key] == "failed")
        ]
        known_scores = store.score_names()
        checked: set[str] = set()
        if known_scores is not None:
            check_score_names(study, known_scores)
        n_workers = workers if workers is not None else available_cpus()
        missing = _illustrations(study, runs) - store.illustrated()
        by_key = {spec.key: spec for spec in todo}
        with (
            Reporter(study, runs, todo, statuses, n_workers, console) as reporter,
            closing(_records(todo, n_workers, missing)) as records,
        ):
            for record in records:
                store.add(record)
                if record.illustration is not None:
                    missing.discard(record.world_key)
                reporter.finished(by_key[record.key], record)
                problem = by_key[record.key].problem
                if problem not in checked and record.status != "failed":
                    # the first result knows the names of the scores: better now than after the last run
                    checked.add(problem)
                    check_score_names(study, set(record.scores))
        elapsed = time.monotonic() - started
        if todo:
            store.note(last_run={"elapsed_s": elapsed, "workers": n_workers, "executed": len(todo)})
        after = store.statuses()
    failed = sum(after.get(spec.key) == "failed" for spec in runs)
    return Summary(len(runs), len(runs) - len(todo), len(todo), failed, elapsed)


def check_score_names(study: Study, scores: set[str]) -> None:
    """Refuse a study that ranks or counts matches by a score that its runs do not have.

    Raises
    ------
    UnknownName
        Naming the scores there are.
    """
    known = {*scores, "loss"}
    wanted = [("rank_by", study.rank_by), *(("score of success", s.score) for s in study.success)]
    for argument, score in wanted:
        if score not in known:
            raise UnknownName(argument, score, known)


def _illustrations(study: Study, runs: list[RunSpec]) -> set[str]:
    """World keys whose illustration the study wants kept."""
    kept = set(study.worlds[: study.illustrate])
    return {spec.world_key for spec in runs if spec.world in kept}


def _records(todo: list[RunSpec], n_workers: int, missing: set[str]) -> Generator[RunRecord, None, None]:
    """Yield records as they come; `missing` shrinks as illustrations arrive."""
    if n_workers == 1:
        return _here(todo, missing)
    return WorkerPool(n_workers, lambda spec: spec.world_key in missing).records(todo)


def _here(todo: list[RunSpec], missing: set[str]) -> Generator[RunRecord, None, None]:
    world = World()
    for spec in todo:
        yield execute(spec, world, illustrate=spec.world_key in missing)
