"""How far a study is: a live line on a terminal, plain lines now and then elsewhere."""

from __future__ import annotations

import math
import time
from collections import Counter, defaultdict
from collections.abc import Mapping
from typing import TYPE_CHECKING, Self

from comparisons.store import RunRecord
from comparisons.study import RunSpec, Study

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

__all__ = ["Reporter"]

#: Seconds between two plain lines.
INTERVAL_S = 10.0


class Reporter:
    """Shows runs done, left and failed, and the time left.

    The time left comes from the mean duration of each solver's runs so far, because solvers differ by
    far more than worlds do; the wall time per second of solving so far covers everything else.

    Parameters
    ----------
    study : Study
        The study.
    runs, todo : list of RunSpec
        All its runs, and those to be executed now.
    statuses : mapping of str to str
        Status by key of the runs in the store before.
    workers : int
        Number of processes.
    console : rich.console.Console or None
        Where to write; nowhere if None.
    """

    def __init__(
        self,
        study: Study,
        runs: list[RunSpec],
        todo: list[RunSpec],
        statuses: Mapping[str, str],
        workers: int,
        console: Console | None,
    ) -> None:
        again = {spec.key for spec in todo}
        self._name, self._workers, self._console = study.name, workers, console
        self._total = len(runs)
        self._done = len(runs) - len(todo)
        self._failed = sum(statuses.get(s.key) == "failed" and s.key not in again for s in runs)
        self._left = Counter(spec.solver_label for spec in todo)
        self._durations: dict[str, list[float]] = defaultdict(list)
        self._last_line = time.monotonic()
        self._first_result: float | None = None
        self._live: Progress | None = None

    def __enter__(self) -> Self:
        if self._console is None:
            return self
        if self._done:
            self._console.print(f"{self._name}: {self._done} of {self._total} runs are in the store already")
        if not self._left.total():
            return self
        if self._console.is_terminal:
            self._live = self._bar(self._console)
            self._live.start()
        else:
            noun = "process" if self._workers == 1 else "processes"
            self._console.print(
                f"{self._name}: {self._left.total()} of {self._total} runs to do on {self._workers} {noun}"
            )
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._live.stop()

    def _bar(self, console: Console) -> Progress:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        live = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TextColumn("{task.fields[text]}", markup=False),
            TimeElapsedColumn(),
            console=console,
        )
        live.add_task(self._name, total=self._total, completed=self._done, text=self._text())
        return live

    def finished(self, spec: RunSpec, record: RunRecord) -> None:
        """Count one run.

        Parameters
        ----------
        spec : RunSpec
            The run.
        record : RunRecord
            Its result.
        """
        self._done += 1
        self._failed += record.status == "failed"
        self._left[spec.solver_label] -= 1
        if math.isfinite(record.elapsed_s):
            self._durations[spec.solver_label].append(record.elapsed_s)
            if self._first_result is None:
                # what came before was starting and importing, which does not come again
                self._first_result = time.monotonic() - record.elapsed_s / self._workers
        if self._console is None:
            return
        if self._live is not None:
            task = self._live.task_ids[0]
            self._live.update(task, completed=self._done, text=self._text())
            return
        now = time.monotonic()
        if now - self._last_line >= INTERVAL_S or self._done == self._total:
            self._last_line = now
            self._console.print(f"{self._name}: {self._text()}")

    def _text(self) -> str:
        text = f"{self._done} of {self._total} done, {self._total - self._done} left, {self._failed} failed"
        left = self._time_left()
        return text if left is None else f"{text}, about {_duration(left)} to go"

    def _time_left(self) -> float | None:
        """Estimated seconds, or None before the first result and after the last."""
        spent = sum(map(sum, self._durations.values()))
        if not spent or self._first_result is None or not self._left.total():
            return None
        overall = spent / sum(map(len, self._durations.values()))
        mean = {label: sum(times) / len(times) for label, times in self._durations.items() if times}
        solving = sum(count * mean.get(label, overall) for label, count in self._left.items())
        return solving * (time.monotonic() - self._first_result) / spent


def _duration(seconds: float) -> str:
    whole = max(round(seconds), 1)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
