"""What the speed measurements count and subtract; the times themselves belong to the machine."""

from __future__ import annotations

import time

import numpy as np
import pytest
from arena import Altered

import navopt
from comparisons import speed, speed_swarms
from comparisons.speed import clocked, interleaved
from comparisons.speed_swarms import CycleCost, FishCost, fish_costs, one_cycle, swarm_costs, swarm_names


def test_interleaved_takes_turns_and_medians() -> None:
    order: list[str] = []
    values = {"a": iter([3.0, 1.0, 9.0]), "b": iter([5.0, 5.0, 6.0])}

    def task(name: str):
        def run() -> float:
            order.append(name)
            return next(values[name])

        return run

    assert interleaved({name: task(name) for name in values}, repeats=3) == {"a": 3.0, "b": 5.0}
    assert order == ["a", "b"] * 3


def test_clocked_is_the_mean_of_its_calls() -> None:
    assert clocked(lambda: time.sleep(0.004), 3)() > 0.004


def test_every_registered_swarm_is_measured() -> None:
    names = swarm_names()
    assert names[-3:] == ["affine-abc", "improved-abc", "single-point-abc"]
    swarms = {"abc", "afsa", "oafsa", "nafsa", "foa", "gfoa", "3d-foa", "ifoa-2016", "ifoa-2020", "pso"}
    assert swarms <= set(names)
    assert not {"de", "cmaes", "nelder-mead", "random-search", "nominal", "tercom"} & set(names)


def test_the_time_of_the_loss_does_not_count(monkeypatch) -> None:
    sphere, clock = navopt.simulate("sphere", 0, n_var=3), [0.0]
    # a clock that only the loss moves: what is left is exactly nothing
    monkeypatch.setattr(speed.time, "perf_counter", lambda: clock[0])

    def slow(losses: np.ndarray, X: np.ndarray) -> np.ndarray:
        clock[0] += 0.5
        return losses

    task = one_cycle(lambda: navopt.make_solver("abc", pop_size=6), Altered(sphere, slow), cycles=3)
    assert task() == 0.0
    assert clock[0] > 0.0


def test_cycles_are_counted_by_evaluations_and_batches() -> None:
    abc, nafsa, pso = swarm_costs(repeats=1, cycles=5, names=["abc", "nafsa", "pso"])
    assert [cost.solver for cost in (abc, nafsa, pso)] == ["abc", "nafsa", "pso"]
    assert {cost.problem for cost in (abc, nafsa, pso)} == {"sphere"}
    # two phases of 20; nobody is exhausted in so few cycles
    assert (abc.evaluations, abc.batches) == (40.0, 2.0)
    assert (pso.evaluations, pso.batches) == (20.0, 1.0)
    # three attempts of every fish, and the group's moves, but for the best fish
    assert 60 <= nafsa.evaluations <= 20 * 5 - 1
    assert nafsa.batches <= 6
    assert min(cost.seconds for cost in (abc, nafsa, pso)) > 0.0
    assert len({cost.peer_seconds for cost in (abc, nafsa, pso)}) == 1


def test_solvers_that_need_a_track_are_measured_on_one() -> None:
    affine, single = swarm_costs(repeats=1, cycles=5, names=["affine-abc", "single-point-abc"])
    assert (affine.problem, single.problem) == ("gravity-matching", "gravity-matching")
    assert affine.evaluations >= 40.0
    # the other searches in a kernel of its own and proposes one point
    assert single.batches == 0.0


def test_the_novel_fish_need_fewer_evaluations_and_less_memory() -> None:
    # what Gao et al. (2015) claim, at equal numbers of fish and attempts, and as published
    costs = {(cost.solver, cost.pop_size): cost for cost in fish_costs(repeats=1, cycles=8)}
    assert set(costs) == {(name, n) for name in ("afsa", "oafsa", "nafsa") for n in (20, 50)}
    assert {costs[name, 20].try_number for name in ("afsa", "oafsa", "nafsa")} == {3}
    for n in (20, 50):
        for other in ("afsa", "oafsa"):
            assert costs["nafsa", n].evaluations < costs[other, n].evaluations
            assert costs["nafsa", n].peak_bytes < 0.6 * costs[other, n].peak_bytes
            assert costs["nafsa", n].state_bytes < costs[other, n].state_bytes
    for cost in costs.values():
        n, d = cost.pop_size, 10
        assert cost.state_bytes >= 8 * n * (d + 1)
        # positions and losses of a cycle's candidates are made anew
        assert cost.peak_bytes > 8 * n * d


def test_the_command_prints_three_tables(monkeypatch, capsys) -> None:
    row = ("what is measured", "ours", 0.002, "peer", 0.004)
    monkeypatch.setattr(speed, "measure", lambda: [row])
    cycles = [
        CycleCost("abc", "sphere", 40.0, 2.0, 0.006, 0.003),
        CycleCost("improved-abc", "gravity-matching", 0.0, 0.0, 0.006, 0.003),
    ]
    monkeypatch.setattr(speed_swarms, "swarm_costs", lambda: cycles)
    fish = FishCost("nafsa", 20, 3, 80.0, 0.008, 36_000.0, 2400, 8200)
    monkeypatch.setattr(speed_swarms, "fish_costs", lambda: [fish])
    speed.main()
    lines = [line.split("│")[1:-1] for line in capsys.readouterr().out.splitlines() if "│" in line]
    shown = {cells[0].strip(): [cell.strip() for cell in cells] for cells in lines}
    assert shown["what is measured"][1:] == ["ours", "2", "peer", "4", "0.50"]
    assert shown["abc"][2:] == ["40.0", "2.0", "3", "6", "3", "1.00", "2.00"]
    assert shown["improved-abc"][2:4] == ["own kernel", "own kernel"]
    assert shown["improved-abc"][-1] == "2.00"
    assert shown["nafsa"][1:] == ["20", "3", "80", "8", "100", "36", "2.4", "8.2"]


@pytest.mark.slow
def test_all_measurements_run() -> None:
    assert all(seconds > 0 and peer > 0 for _, _, seconds, _, peer in speed.measure(repeats=1))
    assert [cost.solver for cost in swarm_costs(repeats=1, cycles=5)] == swarm_names()
