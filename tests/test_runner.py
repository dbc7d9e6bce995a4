from __future__ import annotations

import io
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from study_tools import small_study

from comparisons.pool import WorkerPool, _cause, _WorldQueue, available_cpus
from comparisons.progress import _duration
from comparisons.runner import run_study
from comparisons.store import ResultsStore
from comparisons.study import SolverEntry, Success
from comparisons.worker import World, execute
from navopt.errors import InvalidInput, NavoptError, UnknownName
from navopt.problems.analytic import Sphere


def rows(folder):
    with ResultsStore(folder) as store:
        return store.runs()


def finished(folder):
    """Key and time of every finished run; none yet is none."""
    try:
        with ResultsStore(folder) as store:
            frame = store.runs()
    except NavoptError:
        return {}
    return dict(zip(frame["key"], frame["finished"], strict=True))


def test_results_do_not_depend_on_the_number_of_workers(tmp_path):
    study = small_study(seeds=(1, 2), held_out=1)
    summaries = [run_study(study, tmp_path / str(n), workers=n) for n in (1, 2)]
    assert all((s.planned, s.found, s.executed, s.failed) == (16, 0, 16, 0) for s in summaries)
    alone, together = rows(tmp_path / "1"), rows(tmp_path / "2")
    assert list(alone["key"]) == list(together["key"])
    assert alone["loss"].tolist() == together["loss"].tolist()
    for column in ("x", "scores", "held_out", "counts", "status", "settings"):
        for a, b in zip(alone[column], together[column], strict=True):
            np.testing.assert_equal(a, b)
    assert set(alone["status"]) == {"budget"}
    assert (alone["cost"] == 60).all()
    assert alone["held_out.distance_1"].tolist() == alone["score.distance_1"].tolist()  # no noise to redraw
    with ResultsStore(tmp_path / "2") as store:
        key = together["key"][0]
        np.testing.assert_array_equal(store.estimate(key)["position"], together["x"][0])
        assert store.traces()[key]["cost"][-1] == 60
        assert store.meta["last_run"]["workers"] == 2


def test_the_same_call_again_runs_nothing(tmp_path):
    run_study(small_study(), tmp_path, workers=1)
    before = finished(tmp_path)
    summary = run_study(small_study(), tmp_path, workers=2)
    assert (summary.found, summary.executed) == (8, 0)
    assert finished(tmp_path) == before
    more = run_study(small_study(worlds=(0, 1, 2)), tmp_path, workers=1)
    assert (more.found, more.executed) == (8, 4)
    other = run_study(small_study(budget=61), tmp_path, workers=1)
    assert (other.found, other.executed) == (0, 8)


REFUSED = SolverEntry("affine-abc", "refused")


def test_a_failing_solver_is_a_row_and_the_rest_go_on(tmp_path):
    solvers = (*small_study().solvers, REFUSED)
    study = small_study(solvers=solvers)
    summary = run_study(study, tmp_path, workers=1)
    assert (summary.executed, summary.failed) == (12, 4)
    frame = rows(tmp_path)
    failed = frame[frame["status"] == "failed"]
    assert set(failed["solver"]) == {"refused"}
    error = failed["error"].iloc[0]
    assert error.startswith("UnsuitableProblem: affine-abc cannot solve Sphere")
    assert re.search(r" \[\w+\.py:\d+ in \w+: .*\]$", error)  # where, without anyone's folders
    assert "\n" not in error
    assert failed["settings"].iloc[0]["solver"] == "affine-abc"
    assert failed["loss"].isna().all()
    assert (frame.loc[frame["status"] != "failed", "loss"].notna()).all()
    # failures are kept, and done again only when asked
    assert run_study(study, tmp_path, workers=1).executed == 0
    again = run_study(study, tmp_path, workers=1, retry_failed=True)
    assert (again.found, again.executed, again.failed) == (8, 4, 4)
    assert set(rows(tmp_path).query("status == 'failed'")["attempts"]) == {2}


def test_a_budget_too_small_is_a_row(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "comparisons.worker.solve", lambda *a, **k: (_ for _ in ()).throw(InvalidInput("budget", 1, "more"))
    )
    run_study(small_study(worlds=(0,)), tmp_path, workers=1)
    assert rows(tmp_path)["error"].str.startswith("InvalidInput: budget: got 1; more [").all()


def test_a_world_that_cannot_be_simulated_fails_its_runs_only(tmp_path, monkeypatch):
    simulate = vars(Sphere)["simulate"].__func__
    calls = []

    def fragile(cls, seed=0, *, n_var=3, lower=-10.0, upper=10.0, offset=0.0):
        calls.append(seed)
        if seed == 1:
            raise ValueError("no such world")
        return simulate(cls, seed, n_var=n_var, lower=lower, upper=upper, offset=offset)

    monkeypatch.setattr(Sphere, "simulate", classmethod(fragile))
    run_study(small_study(), tmp_path, workers=1)
    frame = rows(tmp_path)
    assert set(frame.loc[frame["world"] == 1, "status"]) == {"failed"}
    assert set(frame.loc[frame["world"] == 0, "status"]) == {"budget"}
    assert frame.loc[frame["world"] == 1, "error"].str.contains("no such world").all()
    assert calls == [0, 1, 0, 1]  # each world once per scenario, whatever the number of solvers


def test_illustrations_of_the_first_worlds_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(Sphere, "illustration", lambda self: {"centre": self.true_x})
    run_study(small_study(worlds=(5, 3)), tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        centre = store.illustration("plane", 5)["centre"]
        np.testing.assert_array_equal(centre, Sphere.simulate(5, n_var=2).true_x)
        assert store.illustration("plane", 3) == {}
        assert set(store.illustration("space", 5)) == {"centre"}


def test_held_out_twins_have_noise_of_their_own(monkeypatch):
    seeds: list[int] = []

    def redraw(self, seed):
        seeds.append(seed)
        return self

    monkeypatch.setattr(Sphere, "redraw", redraw)
    world = World()
    for spec in small_study(held_out=2, scenarios={"plane": {"n_var": 2}}).runs():
        execute(spec, world)
    assert len(seeds) == len(set(seeds)) == 4  # two twins on each of two worlds, kept for all its solvers
    assert min(seeds) > 1_000_000


@pytest.mark.parametrize(
    "changes", [{"rank_by": "distance_m"}, {"rank_by": "loss", "success": (Success("distnce_1", (1.0,)),)}]
)
def test_an_unknown_score_ends_the_study_after_its_first_run(tmp_path, changes):
    for executed in (1, 1):  # the second time it is known before anything runs
        with pytest.raises(UnknownName, match="did you mean 'distance_1'"):
            run_study(small_study(**changes), tmp_path, workers=1)
        assert len(rows(tmp_path)) == executed


@pytest.mark.parametrize("workers", [0, -1, True, 1.5])
def test_unusable_workers(tmp_path, workers):
    with pytest.raises(InvalidInput, match="workers"):
        run_study(small_study(), tmp_path, workers=workers)


def test_unknown_names_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(UnknownName, match="did you mean 'abc'"):
        run_study(small_study(solvers=(SolverEntry("abd"),)), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_ctrl_c_in_this_process_keeps_what_is_finished(tmp_path, monkeypatch):
    from comparisons import worker

    solve = worker.solve
    calls = []

    def interrupted(problem, algorithm, **options):
        calls.extend([1] * ("seed" in options))  # without a seed it is a solver's untimed first run
        if "seed" in options and len(calls) == 4:  # solve returns the best so far when the user interrupts it
            options["callback"] = lambda progress: signal.raise_signal(signal.SIGINT)
        return solve(problem, algorithm, **options)

    monkeypatch.setattr(worker, "solve", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_study(small_study(), tmp_path, workers=1)
    assert len(rows(tmp_path)) == 3  # half a run does not pass for a whole one
    assert run_study(small_study(), tmp_path, workers=1).executed == 5


# -- workers that die ------------------------------------------------------------------------------
def kill_on(monkeypatch, victim, times):
    """Kill the worker that was handed the run `victim`, the first `times` times."""
    original = WorkerPool._hand_out
    killed: list[int] = []

    def hand_out(self, worker, queue):
        original(self, worker, queue)
        if worker.spec is not None and worker.spec.key == victim and len(killed) < times:
            killed.append(worker.process.pid)
            os.kill(worker.process.pid, signal.SIGKILL)

    monkeypatch.setattr(WorkerPool, "_hand_out", hand_out)
    return killed


@pytest.mark.parametrize(("times", "status"), [(1, "budget"), (2, "failed")])
def test_a_killed_worker_costs_one_retry_and_then_its_run(tmp_path, monkeypatch, times, status):
    # a long run, so that the worker is still on it when the signal arrives
    study = small_study(budget=3000)
    victim = study.runs()[5]
    killed = kill_on(monkeypatch, victim.key, times)
    summary = run_study(study, tmp_path, workers=2)
    assert len(killed) == times
    assert summary.failed == (status == "failed")
    frame = rows(tmp_path).set_index("key")
    assert len(frame) == 8
    assert frame["status"].drop(victim.key).eq("budget").all()
    assert frame["status"][victim.key] == status
    if status == "failed":
        assert "WorkerKilled: the worker process was killed by SIGKILL" in frame["error"][victim.key]
        assert "memory" in frame["error"][victim.key]


def test_workers_that_cannot_start_are_one_clear_error(tmp_path, monkeypatch):
    monkeypatch.setattr("comparisons.pool.serve", sys.exit)  # ends before it says that it is ready
    with pytest.raises(NavoptError, match=r"cannot be started \(exit code.*__main__.*workers=1"):
        run_study(small_study(), tmp_path, workers=2)


def test_the_cause_of_a_death_in_words():
    assert "SIGKILL (the system does so when memory runs out)" in _cause(-9)
    assert _cause(-11).endswith("SIGSEGV")
    assert _cause(3).endswith("exit code 3")


def test_runs_are_handed_out_world_by_world():
    runs = small_study(scenarios={"plane": {"n_var": 2}}).runs()  # two worlds, two solvers each
    queue = _WorldQueue(runs)
    taken, world = [], ""
    for _ in range(3):
        spec = queue.take(world)
        assert spec is not None
        taken.append(spec)
        world = spec.world_key
    assert [spec.world for spec in taken] == [0, 0, 1]
    helped = queue.take(taken[0].world_key)  # nothing left there, no new world: help with the other one
    assert helped is not None
    assert helped.world == 1
    assert queue.take("") is None
    queue.put_back(helped)
    assert len(queue) == 1
    assert queue.take("") is helped


def test_available_cpus_is_at_least_one():
    assert 1 <= available_cpus() <= (os.cpu_count() or 1)


# -- kill -9 and Ctrl-C of the whole study ---------------------------------------------------------
LONG = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from rich.console import Console
from study_tools import small_study
from comparisons.runner import run_study
if __name__ == "__main__":
    run_study(small_study(budget=3000, worlds=tuple(range(4))), Path({out!r}), workers={workers})
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_kill_9_loses_nothing_that_was_finished(tmp_path, workers):
    out = tmp_path / "out"
    script = tmp_path / "script.py"
    tests = str(Path(__file__).parent)
    script.write_text(LONG.format(tests=tests, out=str(out), workers=workers), encoding="utf-8")
    process = subprocess.Popen([sys.executable, str(script)], start_new_session=True)
    deadline = time.monotonic() + 40
    while len(finished(out)) < 4 and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.02)
    children = _children(process.pid)
    process.kill()
    process.wait()
    before = finished(out)
    assert 4 <= len(before) < 16, "killed too late to test anything: make the runs longer"
    assert len(children) >= (workers if workers > 1 else 0)
    summary = run_study(small_study(budget=3000, worlds=tuple(range(4))), out, workers=1)
    assert (summary.found, summary.executed, summary.failed) == (len(before), 16 - len(before), 0)
    after = finished(out)
    assert len(after) == 16
    assert {key: after[key] for key in before} == before
    assert set(rows(out)["attempts"]) == {1}
    _wait_until_gone(children)


def _children(pid):
    try:
        return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def _wait_until_gone(pids):
    """The workers of a killed parent end by themselves, even in the middle of a run."""
    deadline = time.monotonic() + 10
    while alive := [pid for pid in pids if Path(f"/proc/{pid}").exists() and not _is_zombie(pid)]:
        assert time.monotonic() < deadline, f"workers {alive} outlived their parent"
        time.sleep(0.02)


def _is_zombie(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


# -- progress --------------------------------------------------------------------------------------
def test_progress_in_plain_lines(tmp_path):
    text = io.StringIO()
    study = small_study(solvers=(*small_study().solvers, REFUSED))
    run_study(study, tmp_path, workers=1, console=Console(file=text, width=150))
    lines = text.getvalue().splitlines()
    assert lines[0] == "small: 12 of 12 runs to do on 1 process"
    assert lines[-1] == "small: 12 of 12 done, 0 left, 4 failed"
    text = io.StringIO()
    run_study(study, tmp_path, workers=1, console=Console(file=text, width=150))
    assert text.getvalue() == "small: 12 of 12 runs are in the store already\n"


def test_progress_on_a_terminal(tmp_path):
    text = io.StringIO()
    console = Console(file=text, width=150, force_terminal=True)
    run_study(small_study(), tmp_path, workers=1, console=console)
    assert "8 of 8 done, 0 left, 0 failed" in text.getvalue()


def test_durations_in_words():
    assert [_duration(s) for s in (0.2, 59, 61, 3725)] == ["1 s", "59 s", "1 min 01 s", "1 h 02 min"]
