"""The contract every registered solver keeps: new solvers are held to it without new test code."""

from __future__ import annotations

import copy
import hashlib
import inspect
import pickle
import random
import subprocess
import sys

import numpy as np
import pytest
from arena import SOLVERS, Altered, hostile_boxes, world
from pymoo.core.termination import NoTermination
from pymoo.optimize import minimize

import navopt
from navopt import registry
from navopt.errors import InvalidInput, NumericalFault, UnknownName, UnsuitableProblem

BUDGET = 400
each_solver = pytest.mark.parametrize("name", SOLVERS)
HOSTILE = ("all negative", "asymmetric", "far from zero")


def least(name: str, budget: int) -> int:
    return max(budget, navopt.solver_info(name).minimum_cost)


def same(a: navopt.Solution, b: navopt.Solution) -> bool:
    return bool((a.x == b.x).all()) and a.loss == b.loss


def half_run(name: str, problem: navopt.EstimationProblem, batches: int, seed: int = 5):
    """An algorithm after some batches, and what they cost; fewer if it ends by itself."""
    algorithm = navopt.make_solver(name)
    algorithm.setup(problem, seed=seed, termination=NoTermination())
    for _ in range(batches):
        if algorithm.has_next():
            algorithm.next()
    return algorithm


@each_solver
@pytest.mark.parametrize("box", HOSTILE)
def test_loss_belongs_to_x_inside_the_box_within_budget(name: str, box: str) -> None:
    problem = hostile_boxes(name)[box]
    seen: list[np.ndarray] = []
    watched = Altered(problem, lambda losses, X: (seen.append(X.copy()), losses)[1])
    solution = navopt.solve(watched, name, budget=BUDGET, seed=3)
    tried = np.vstack(seen)
    assert (tried >= problem.xl).all()
    assert (tried <= problem.xu).all()
    assert float(problem.loss(solution.x)) == solution.loss
    assert solution.counts.cost <= BUDGET
    assert solution.counts.loss == len(tried)
    if navopt.solver_info(name).spends_all:
        assert solution.counts.cost == BUDGET
        assert solution.status == "budget"
    assert solution.loss == problem.loss(tried).min()


@each_solver
@pytest.mark.parametrize("budget", [1, 7, 53, 211])
def test_budgets_that_cut_a_batch(name: str, budget: int) -> None:
    problem = world(name)
    if budget < navopt.solver_info(name).minimum_cost:
        with pytest.raises(InvalidInput, match="budget"):
            navopt.solve(problem, name, budget=budget)
        return
    solution = navopt.solve(problem, name, budget=budget)
    assert solution.counts.cost <= budget
    assert solution.counts.cost == budget or not navopt.solver_info(name).spends_all
    assert float(problem.loss(solution.x)) == solution.loss


@each_solver
def test_trace_is_monotone_and_ends_at_the_answer(name: str) -> None:
    solution = navopt.solve(world(name), name, budget=BUDGET)
    trace = solution.trace
    assert (np.diff(trace["cost"]) > 0).all()
    assert (np.diff(trace["loss"]) <= 0).all()
    assert (np.diff(trace["elapsed_s"]) >= 0).all()
    assert trace["loss"][-1] == solution.loss
    assert trace["cost"][-1] == solution.counts.cost


@each_solver
def test_same_seed_same_answer_other_seed_other_path(name: str) -> None:
    problem, budget = world(name), least(name, 150)
    first, again = (navopt.solve(problem, name, budget=budget, seed=11) for _ in range(2))
    other = navopt.solve(problem, name, budget=budget, seed=12)
    assert same(first, again)
    assert (first.trace[["cost", "loss"]] == again.trace[["cost", "loss"]]).all()
    assert same(first, other) != navopt.solver_info(name).stochastic


def digest(name: str) -> str:
    solution = navopt.solve(world(name), name, budget=BUDGET, seed=7)
    return hashlib.sha256(solution.x.tobytes() + np.float64(solution.loss).tobytes()).hexdigest()


def test_same_seed_same_answer_in_another_process() -> None:
    code = "from test_contracts import *\nfor name in SOLVERS: print(name, digest(name))"
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        capture_output=True,
        text=True,
        cwd=__file__.rpartition("/")[0],
        check=True,
    )
    assert dict(line.split() for line in run.stdout.splitlines()) == {name: digest(name) for name in SOLVERS}


@each_solver
def test_four_ways_agree_at_whole_batches(name: str) -> None:
    problem, batches = world(name), 9
    paused = half_run(name, problem, batches)
    budget, ended = paused.evaluator.n_eval, not paused.has_next()
    internal = getattr(paused.evaluator, "n_internal", 0)

    solved = navopt.solve(problem, name, budget=None if ended else budget, seed=5)

    minimized = minimize(problem, navopt.make_solver(name), ("n_eval", budget), seed=5)
    assert minimized.algorithm.evaluator.n_eval == budget
    assert (solved.x == minimized.X).all()
    assert minimized.F[0] == solved.loss

    asked = navopt.make_solver(name)
    asked.setup(problem, seed=5, termination=NoTermination())
    while asked.evaluator.n_eval < budget and asked.has_next():
        batch = asked.ask()
        asked.evaluator.eval(problem, batch)
        asked.tell(infills=batch)
    assert (solved.x == asked.opt[0].X).all()

    if not navopt.solver_info(name).resumable:
        assert navopt.solver_info(name).reasons["resumable"]
        return
    half = half_run(name, problem, batches // 2)
    resumed = navopt.solve(
        problem, pickle.loads(pickle.dumps(half)), budget=None if ended else budget + internal
    )
    assert same(resumed, solved)
    assert resumed.counts == solved.counts
    # the paused original is not touched by going on with its copy
    assert half.evaluator.n_eval <= budget


@each_solver
def test_an_algorithm_passed_in_is_not_changed(name: str) -> None:
    algorithm = navopt.make_solver(name)
    before = sorted(algorithm.__dict__)
    first, again = (navopt.solve(world(name), algorithm, budget=60, seed=4) for _ in range(2))
    assert same(first, again)
    assert sorted(algorithm.__dict__) == before
    assert algorithm.problem is None


@each_solver
def test_global_random_state_is_untouched(name: str) -> None:
    problem = world(name)
    np.random.seed(123)  # noqa: NPY002 - the global state is what this test watches
    random.seed(123)
    before = pickle.dumps((np.random.get_state(), random.getstate()))  # noqa: NPY002
    navopt.solve(problem, name, budget=BUDGET)
    assert pickle.dumps((np.random.get_state(), random.getstate())) == before  # noqa: NPY002


@each_solver
def test_inputs_are_not_mutated(name: str) -> None:
    problem = world(name)
    before = pickle.dumps(problem)
    navopt.solve(problem, name, budget=BUDGET)
    assert pickle.dumps(problem) == before
    assert copy.deepcopy(problem) is problem
    with pytest.raises(InvalidInput, match="immutable"):
        problem.truth = None


@each_solver
def test_first_population_never_contains_the_truth(name: str) -> None:
    for seed in range(100):
        problem = world(name, seed)
        truth = problem.true_x if problem.true_x is not None else problem.project(problem.truth)
        algorithm = navopt.make_solver(name)
        algorithm.setup(problem, seed=seed, termination=NoTermination())
        gap = np.abs(algorithm.ask().get("X") - truth) / (problem.xu - problem.xl)
        assert gap.max(axis=1).min() > 1e-9, f"seed {seed}"


def on_a_dyadic_grid(losses: np.ndarray) -> np.ndarray:
    return np.floor(losses * 1024.0) / 1024.0


@each_solver
def test_comparison_based_means_that_an_offset_changes_nothing(name: str) -> None:
    info = navopt.solver_info(name)
    if not info.comparison_based:
        assert info.reasons["comparison_based"]
        return
    problem = world(name)
    plain = navopt.solve(Altered(problem, lambda f, X: on_a_dyadic_grid(f)), name, budget=BUDGET)
    raised = navopt.solve(Altered(problem, lambda f, X: on_a_dyadic_grid(f) + 2.0**20), name, budget=BUDGET)
    assert (plain.x == raised.x).all()
    assert raised.loss == plain.loss + 2.0**20


@each_solver
def test_a_third_of_the_box_cannot_be_evaluated(name: str) -> None:
    problem = world(name)
    wall = problem.xl[0] + 0.7 * (problem.xu[0] - problem.xl[0])
    walled = Altered(problem, lambda losses, X: np.where(X[:, 0] > wall, np.inf, losses))
    solution = navopt.solve(walled, name, budget=BUDGET)
    assert np.isfinite(solution.loss)
    assert solution.x[0] <= wall
    assert solution.loss == float(problem.loss(solution.x))


@each_solver
def test_nothing_can_be_evaluated(name: str) -> None:
    problem = world(name)
    solution = navopt.solve(Altered(problem, lambda losses, X: np.full(len(X), np.inf)), name, budget=BUDGET)
    assert solution.status == "invalid"
    assert solution.loss == np.inf
    assert sum(solution.invalid.values()) == solution.counts.loss
    assert "could not evaluate" in solution.message


@each_solver
def test_nan_is_a_clear_error(name: str) -> None:
    broken = Altered(world(name), lambda losses, X: np.full(len(X), np.nan))
    with pytest.raises(NumericalFault, match=r"Altered\.loss returned NaN for candidate 0"):
        navopt.solve(broken, name, budget=BUDGET)


@each_solver
def test_unknown_keywords_are_refused(name: str) -> None:
    with pytest.raises(UnknownName, match="pop_sizes"):
        navopt.make_solver(name, pop_sizes=3)
    algorithm = navopt.make_solver(name)
    if type(algorithm).__module__.startswith(("navopt", "baselines")):
        with pytest.raises(UnknownName, match="budgets"):
            minimize(world(name), algorithm, ("n_eval", 50), seed=1, budgets=3)
        with pytest.raises(UnknownName, match="pop_sizes"):
            type(algorithm)(pop_sizes=3)


@each_solver
def test_an_unsuitable_problem_is_refused_with_what_is_needed(name: str) -> None:
    info = navopt.solver_info(name)
    sphere = navopt.simulate("sphere", 0)
    if info.needs:
        with pytest.raises(UnsuitableProblem, match=r"it needs .*\((Gravity|Gyro|Heading|Noise)[A-Z]\w+\)"):
            navopt.solve(sphere, name, budget=50)
        with pytest.raises(UnsuitableProblem, match="it needs"):
            minimize(sphere, navopt.make_solver(name), ("n_eval", 50), seed=1)
    else:
        assert navopt.solve(sphere, name, budget=least(name, 50)).counts.cost > 0


@each_solver
def test_declarations_are_complete(name: str) -> None:
    info = navopt.solver_info(name)
    assert info.name == name
    assert info.summary
    for capability in ("spends_all", "comparison_based", "resumable"):
        assert getattr(info, capability) or info.reasons[capability]
    algorithm = navopt.make_solver(name)
    settings = algorithm.settings
    assert navopt.make_solver(name, **settings).settings == settings
    assert navopt.solve(world(name), name, budget=60).settings["options"] == settings
    assert inspect.getdoc(registry.solver_factory(name))


def test_a_missing_capability_without_a_reason_is_refused() -> None:
    with pytest.raises(InvalidInput, match="say in writing why 'resumable' is missing"):
        navopt.SolverInfo("x", "summary", comparison_based=True, resumable=False)
