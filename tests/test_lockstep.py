"""Runs together are runs alone, bit for bit, whoever does them and however they end."""

from __future__ import annotations

import os
import signal

import numpy as np
import pandas as pd
import pytest
from study_tools import small_study

from comparisons import lockstep, runner
from comparisons.audit import Audit
from comparisons.entries import RunGroup
from comparisons.lockstep import execute_together, groups
from comparisons.pool import WorkerPool, _WorldQueue
from comparisons.runner import run_study
from comparisons.store import ResultsStore
from comparisons.study import SolverEntry, Study
from comparisons.wording import notes
from comparisons.worker import World, execute
from navopt.errors import InvalidInput
from navopt.problems.analytic import Sphere

SWARMS = (
    SolverEntry("foa", "flies", {"pop_size": 8}),
    SolverEntry("afsa", "fish", {"pop_size": 6}),
    SolverEntry("random-search", settings={"pop_size": 20}),
)


def swarms(**changes):
    """A study of two swarms that go together and a solver that does not."""
    return small_study(**{"solvers": SWARMS, "seeds": (1, 2), "lockstep": True, **changes})


def rows(folder):
    with ResultsStore(folder) as store:
        runs = store.runs()
        return runs, store.traces(), {key: store.estimate(key) for key in runs["key"]}


@pytest.mark.parametrize("name", ["foa:published", "ifoa-2020", "abc", "nafsa"])
@pytest.mark.parametrize("budget", [160, 173])
def test_runs_together_equal_runs_alone_bit_for_bit(name, budget):
    audit = Audit(name, references=(), functions=("ackley",), dimensions=(3,), seeds=6, budget=budget,
                  biases=("corner",))  # fmt: skip
    together, others = groups(audit.runs())
    assert not others
    assert len(together) == 3
    alone = World()
    for spec, record in zip(together[1].runs, execute_together(together[1]), strict=True):
        single = execute(spec, alone)
        for field in ("key", "world_key", "status", "settings", "loss", "counts", "scores", "message"):
            assert getattr(record, field) == getattr(single, field), field
        np.testing.assert_array_equal(record.x, single.x)
        for column in ("cost", "loss"):
            np.testing.assert_array_equal(record.trace[column], single.trace[column])


def test_what_cannot_run_together_runs_alone():
    audit = Audit(
        ["abc:update=sequential", "random-search", "foa:pop_size=50"], references=(), functions=("ackley",),
        dimensions=(2,), seeds=6, budget=40, biases=("corner",),
    )  # fmt: skip
    together, others = groups(audit.runs())
    assert {spec.solver for spec in others} == {"abc", "random-search"}
    assert execute_together(together[0]) is None  # the budget ends within the first batch
    alone, others = groups(swarms(worlds=(0,), seeds=(1,)).runs())
    assert not alone  # nobody to go with
    assert len(others) == 2 * 3


def test_large_groups_are_divided(monkeypatch):
    monkeypatch.setattr(lockstep, "LARGEST_GROUP", 3)
    together, others = groups(swarms(scenarios={"plane": {"n_var": 2}}).runs())
    assert [len(group.runs) for group in together] == [3, 3]  # four of each: one is left over
    assert [spec.solver for spec in others].count("foa") == 1
    runs = swarms(scenarios={"plane": {"n_var": 2}}).runs()
    assert {s.key for g in together for s in g} | {s.key for s in others} == {s.key for s in runs}


@pytest.mark.parametrize("workers", [1, 2])
def test_the_store_is_that_of_single_runs(tmp_path, workers, monkeypatch):
    monkeypatch.setattr(Sphere, "illustration", lambda self: {"centre": self.true_x})
    done = []
    monkeypatch.setattr(
        runner, "execute_together", lambda *a, **k: done.append(a) or execute_together(*a, **k)
    )
    run_study(swarms(lockstep=False, held_out=1), tmp_path / "alone", workers=1)
    assert not done
    summary = run_study(swarms(held_out=1), tmp_path / "together", workers=workers)
    assert (summary.executed, summary.failed) == (24, 0)
    assert len(done) == (4 if workers == 1 else 0)
    (alone, one, some), (together, other, more) = rows(tmp_path / "alone"), rows(tmp_path / "together")
    left_out = ["elapsed_s", "finished", "x"]
    pd.testing.assert_frame_equal(alone.drop(columns=left_out), together.drop(columns=left_out))
    for key, trace in one.items():
        np.testing.assert_array_equal(trace[["cost", "loss"]], other[key][["cost", "loss"]])
        np.testing.assert_equal(some[key], more[key])
    if workers == 1:  # the pool's workers are other processes, with the class as it is
        with ResultsStore(tmp_path / "together") as store:
            assert store.illustration("plane", 0)["centre"].shape == (2,)
            assert store.illustration("plane", 1) == {}


def test_time_is_a_share_of_the_group_and_the_report_says_so(tmp_path):
    records = execute_together(groups(swarms().runs())[0][0])
    assert len({record.elapsed_s for record in records}) == 1
    assert all(record.trace["elapsed_s"][-1] <= record.elapsed_s for record in records)
    table = pd.DataFrame({"runs": [1], "expected": [1], "pairs": [0], "scenario": ["a"]})
    said = " ".join(notes(table, swarms()))
    assert "equal share" in said
    assert "equal share" not in " ".join(notes(table, swarms(lockstep=False)))


def test_a_finished_study_is_found_whichever_way_it_was_run(tmp_path):
    run_study(swarms(), tmp_path, workers=1)
    assert run_study(swarms(lockstep=False), tmp_path, workers=1).executed == 0


def test_a_group_that_raises_is_done_one_by_one(tmp_path, monkeypatch):
    simulate = vars(Sphere)["simulate"].__func__

    def fragile(cls, seed=0, *, n_var=3, lower=-10.0, upper=10.0, offset=0.0):
        if seed == 1:
            raise ValueError("no such world")
        return simulate(cls, seed, n_var=n_var, lower=lower, upper=upper, offset=offset)

    monkeypatch.setattr(Sphere, "simulate", classmethod(fragile))
    run_study(swarms(), tmp_path, workers=1)
    runs, _, _ = rows(tmp_path)
    assert len(runs) == 24
    assert set(runs.loc[runs["world"] == 1, "status"]) == {"failed"}
    assert set(runs.loc[runs["world"] == 0, "status"]) == {"budget"}


def test_ctrl_c_keeps_the_groups_that_are_finished(tmp_path, monkeypatch):
    calls = []

    def interrupted(group, **more):
        calls.append(group)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return execute_together(group, **more)

    monkeypatch.setattr(runner, "execute_together", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_study(swarms(), tmp_path, workers=1)
    assert len(rows(tmp_path)[0]) == len(calls[0].runs) == 4
    monkeypatch.undo()
    assert run_study(swarms(), tmp_path, workers=1).executed == 20


def test_a_killed_worker_loses_its_group_only_which_then_comes_apart(tmp_path, monkeypatch):
    hand_out, killed = WorkerPool._hand_out, []

    def deadly(self, worker, queue):
        hand_out(self, worker, queue)
        if isinstance(worker.spec, RunGroup) and not killed:
            killed.append(worker.spec)
            os.kill(worker.process.pid, signal.SIGKILL)

    monkeypatch.setattr(WorkerPool, "_hand_out", deadly)
    assert run_study(swarms(), tmp_path, workers=2).failed == 0
    assert len(killed) == 1
    runs, _, _ = rows(tmp_path)
    assert (runs["status"] == "budget").all()
    assert (runs["attempts"] == 1).all()


def test_a_group_that_is_put_back_comes_apart():
    (group, *_), _ = groups(swarms().runs())
    queue = _WorldQueue([group])
    assert queue.take("") is group
    queue.put_back(group)
    assert len(queue) == len(group.runs)
    assert {queue.take("").key for _ in group.runs} == {spec.key for spec in group.runs}
    assert queue.take("") is None


# -- a seed for each world --------------------------------------------------------------------------
def test_each_world_has_a_seed_of_its_own():
    study = small_study(seed_per_world=True, worlds=(0, 7))
    assert {(spec.world, spec.seed) for spec in study.runs()} == {(0, 1), (7, 8)}
    assert Study.from_dict(study.to_dict()) == study
    with pytest.raises(InvalidInput, match="leave out seeds"):
        small_study(seed_per_world=True, seeds=(1, 2))
    # the key is that of the same run asked for in the other way
    asked = {spec.key for spec in small_study(worlds=(7,), seeds=(8,)).runs()}
    assert asked <= {spec.key for spec in study.runs()}
