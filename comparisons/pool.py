"""Worker processes that hand out the runs of a study, world by world, and outlive the death of any of them.

Each worker has a channel of its own, so it is always known which run a killed worker was on, and a
worker whose parent is gone sees its channel close and ends. (`concurrent.futures` offers neither: one
killed process breaks its whole pool, and the workers of a killed parent wait for ever.)
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from typing import Any

from comparisons.entries import RunGroup, RunSpec
from comparisons.store import RunRecord
from comparisons.threads import THREAD_LIMITS
from comparisons.worker import REFUSED, failed_record, serve
from navopt.errors import InvalidInput, NavoptError

__all__ = ["WorkerPool", "available_cpus", "worker_count"]

#: Times a run may lose its worker before it is recorded as failed.
ATTEMPTS = 2
#: Workers in a row that may be killed before they have started.
START_ATTEMPTS = 5


def available_cpus() -> int:
    """Processors this process may use, which can be fewer than the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def worker_count(workers: int | None) -> int:
    """Number of processes for what was asked: all available processors for None.

    Raises
    ------
    InvalidInput
        If it is not a whole number from 1 on.
    """
    if workers is None:
        return available_cpus()
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise InvalidInput("workers", workers, "give a whole number, at least 1, or None for all processors")
    return workers


class _WorldQueue:
    """Runs still to be handed out, kept together by world so that each is simulated as seldom as possible."""

    def __init__(self, runs: Sequence[RunSpec | RunGroup]) -> None:
        self._worlds: dict[str, deque[RunSpec | RunGroup]] = {}
        for spec in runs:
            self._worlds.setdefault(spec.world_key, deque()).append(spec)
        self._untouched = deque(self._worlds)

    def __len__(self) -> int:
        return sum(map(len, self._worlds.values()))

    def take(self, world_key: str) -> RunSpec | RunGroup | None:
        """Next run on the worker's world; else of a new world; else of the one with most runs left."""
        if not self._worlds.get(world_key):
            while self._untouched and not self._worlds.get(self._untouched[0]):
                self._untouched.popleft()
            if self._untouched:
                world_key = self._untouched.popleft()
            else:
                world_key = max(self._worlds, key=lambda key: len(self._worlds[key]), default="")
        waiting = self._worlds.get(world_key)
        return waiting.popleft() if waiting else None

    def put_back(self, work: RunSpec | RunGroup) -> None:
        """Return what was taken; a group comes apart, so that one run's fault is not that of the others."""
        for spec in work.runs if isinstance(work, RunGroup) else (work,):
            self._worlds.setdefault(spec.world_key, deque()).appendleft(spec)


@dataclass
class _Worker:
    process: BaseProcess
    channel: connection.Connection
    ready: bool = False
    world_key: str = ""
    spec: RunSpec | RunGroup | None = None


class WorkerPool:
    """A number of worker processes for the runs of one study.

    Parameters
    ----------
    workers : int
        Number of processes.
    illustrate : callable
        Asked with each `RunSpec` when it is handed out: whether to attach the world's illustration.
    """

    def __init__(self, workers: int, illustrate: Callable[[RunSpec], bool]) -> None:
        self._size = workers
        self._illustrate = illustrate
        self._context = multiprocessing.get_context("spawn")
        self._workers: list[_Worker] = []
        self._deaths: dict[str, int] = {}
        self._failed_starts = 0

    def records(self, runs: Sequence[RunSpec | RunGroup]) -> Generator[RunRecord, None, None]:
        """Execute runs and groups of runs and yield each record as it is finished, in no fixed order.

        Closing the iterator ends the workers at once; runs in flight are then lost, not recorded.

        Raises
        ------
        NavoptError
            If workers cannot be started at all.
        """
        queue = _WorldQueue(runs)
        try:
            while len(queue) or any(worker.spec for worker in self._workers):
                busy = sum(worker.spec is not None for worker in self._workers)
                while len(self._workers) < min(self._size, len(queue) + busy):
                    self._workers.append(self._start())
                for worker in self._workers:
                    # idle since the queue was empty; a killed worker's run may be back in it
                    if worker.ready and worker.spec is None:
                        self._hand_out(worker, queue)
                for worker in self._waiting():
                    yield from self._hear(worker, queue)
        finally:
            self._end()

    def _waiting(self) -> list[_Worker]:
        """Workers with something to hear: a message, or their end."""
        signs: dict[Any, _Worker] = {}
        for worker in self._workers:
            signs[worker.channel] = signs[worker.process.sentinel] = worker
        heard = {id(signs[sign]): signs[sign] for sign in connection.wait(list(signs))}
        return list(heard.values())

    def _hear(self, worker: _Worker, queue: _WorldQueue) -> Iterator[RunRecord]:
        try:
            message = worker.channel.recv() if worker.channel.poll() else None
        except (EOFError, OSError):
            message = None
        if message is None:
            yield from self._bury(worker, queue)
            return
        done, worker.ready, worker.spec = worker.spec, True, None
        self._failed_starts = 0
        if message == REFUSED and done is not None:
            queue.put_back(done)
        # the next run goes out before this record is stored, so that the worker need not wait for the disk
        self._hand_out(worker, queue)
        if isinstance(message, RunRecord):
            yield message
        elif isinstance(message, list):
            yield from message

    def _hand_out(self, worker: _Worker, queue: _WorldQueue) -> None:
        spec = queue.take(worker.world_key)
        if spec is None:
            return
        worker.spec, worker.world_key = spec, spec.world_key
        try:
            worker.channel.send((spec, self._pictures(spec)))
        except OSError:
            return  # it has just died; its end will be heard next

    def _pictures(self, work: RunSpec | RunGroup) -> bool | frozenset[str]:
        """Whether to attach the world's illustration; of a group, the keys of the worlds to illustrate."""
        if isinstance(work, RunGroup):
            return frozenset(spec.world_key for spec in work.runs if self._illustrate(spec))
        return self._illustrate(work)

    def _bury(self, worker: _Worker, queue: _WorldQueue) -> Iterator[RunRecord]:
        self._workers.remove(worker)
        worker.channel.close()
        worker.process.join(5.0)
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()
        code = worker.process.exitcode or 0
        if not worker.ready:
            self._failed_starts += 1
            # a signal may be chance (memory short for a moment), an exit code will come again
            if code < 0 and self._failed_starts < START_ATTEMPTS:
                return
            raise NavoptError(
                f"worker processes cannot be started (exit code {code}): in a script, call run_study under "
                "`if __name__ == '__main__':`, or use workers=1"
            )
        if worker.spec is None:
            return
        if isinstance(worker.spec, RunGroup):
            queue.put_back(worker.spec)
            return
        deaths = self._deaths[worker.spec.key] = self._deaths.get(worker.spec.key, 0) + 1
        if deaths < ATTEMPTS:
            queue.put_back(worker.spec)
        else:
            yield failed_record(worker.spec, f"WorkerKilled: {_cause(code)}, {deaths} times in this run")

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=serve, args=(theirs,), daemon=True, name="navopt-worker")
        with _environment(THREAD_LIMITS), _deaf_to_interrupts():
            process.start()
        theirs.close()
        return _Worker(process, ours)

    def _end(self) -> None:
        for worker in self._workers:
            worker.channel.close()  # an idle worker ends by itself
            if worker.spec is not None:
                worker.process.terminate()
        for worker in self._workers:
            worker.process.join(2.0)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
        self._workers.clear()


def _cause(code: int) -> str:
    if code >= 0:
        return f"the worker process ended by itself with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    hint = " (the system does so when memory runs out)" if name == "SIGKILL" else ""
    return f"the worker process was killed by {name}{hint}"


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    before = {key: os.environ.get(key) for key in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for key, value in before.items():
            if value is None:
                del os.environ[key]
            else:
                os.environ[key] = value


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Let a child inherit that Ctrl-C is ignored, from its first instruction on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
