"""The phased solver against closed forms and its inner solver alone; problems with held parameters.

Swarms are compared with exact minima to tolerances that their contraction explains; nothing here is a
statistical test.
"""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from pymoo.core.population import Population
from pymoo.core.termination import NoTermination
from pymoo.optimize import minimize
from pymoo.problems import get_problem
from scipy.stats import multivariate_normal

import navopt
from navopt.algorithms import OptimalFishSwarm, Phased, PhasedFit
from navopt.errors import InvalidInput, UnknownName, UnsuitableProblem
from navopt.evaluation import BudgetSpent, CountingEvaluator
from navopt.problem import EstimationProblem, Parameter
from navopt.problems import Point, Restricted, Rosenbrock, Sphere

NAMES = ("a", "b", "c", "d")
#: Small enough that a whole search takes milliseconds; never meant to find anything.
TINY: dict[str, Any] = {
    "groups": [["a", "b"], ["c"], ["d"]],
    "runs_per_phase": 3,
    "cycles": 2,
    "repetitions": 2,
    "options": {"pop_size": 4},
}


class Quadratic(EstimationProblem):
    """½ (x - m)ᵀ A (x - m), its minimum known within any group of parameters."""

    provides = frozenset({"residuals"})
    parameter_groups = {"first": ("a", "b"), "second": ("c", "d")}

    def __init__(
        self, matrix: Any = None, centre: Any = (1.0, -0.5, 2.0, 0.25), nominal: float = 0.0
    ) -> None:
        self.matrix = np.eye(4) if matrix is None else np.array(matrix, dtype=float)
        self.centre = np.array(centre, dtype=float)
        self.seen: list[np.ndarray] = []
        super().__init__([Parameter(name, "1", -5.0, 5.0, nominal) for name in NAMES])
        self.true_x = self.centre
        self.truth = Point(self.centre)

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        root = np.linalg.cholesky(self.matrix)
        gap = X - self.centre
        return np.stack([(gap * root[:, k]).sum(axis=1) for k in range(4)], axis=1)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        self.seen.append(X.copy())
        return 0.5 * (self._residuals(X) ** 2).sum(axis=1)

    def _score(self, estimate: np.ndarray) -> dict[str, float]:
        return {"gap_1": float(np.abs(estimate - self.centre).max())}

    def best_of(self, places: list[int], held: np.ndarray) -> np.ndarray:
        """Where the loss is least along some coordinates, the others held: the normal equations."""
        rest = [k for k in range(4) if k not in places]
        A = self.matrix
        push = A[np.ix_(places, rest)] @ (held[rest] - self.centre[rest])
        answer = held.copy()
        answer[places] = self.centre[places] - np.linalg.solve(A[np.ix_(places, places)], push)
        return answer


COUPLED = [[2.0, 0.3, 0.5, 0.2], [0.3, 1.0, 0.1, -0.4], [0.5, 0.1, 1.5, 0.3], [0.2, -0.4, 0.3, 1.2]]


# -- against closed forms ---------------------------------------------------------------------------------
def test_groups_that_do_not_interact_are_found_one_after_another() -> None:
    problem = Quadratic()
    solution = navopt.solve(problem, Phased(runs_per_phase=4, repetitions=1, answer="mean"), seed=2)
    np.testing.assert_allclose(solution.x, problem.centre, atol=2e-4)
    assert solution.status == "converged"
    assert solution.fitted.labels == ("first", "second")
    np.testing.assert_allclose(solution.fitted.mean[0], [1.0, -0.5, 0.0, 0.0], atol=2e-4)


@pytest.mark.parametrize("chain", ["means", "presets"])
def test_every_phase_ends_at_the_minimum_along_its_group(chain: str) -> None:
    problem = Quadratic(COUPLED, nominal=0.5)
    search = Phased(runs_per_phase=3, repetitions=3, chain=chain, answer="mean", options={"pop_size": 10})
    fitted = navopt.solve(problem, search, seed=1).fitted
    held = identified = problem.nominal
    for phase in range(6):
        places = [0, 1] if phase % 2 == 0 else [2, 3]
        # block Gauss-Seidel with means, block Jacobi from the presets otherwise
        exact = problem.best_of(places, held if chain == "means" else problem.nominal)
        np.testing.assert_allclose(fitted.mean[phase], exact, atol=5e-4)
        held = exact
        identified = identified.copy()
        identified[places] = exact[places]
        assert fitted.indicator[phase] == pytest.approx(float(problem.loss(identified)), abs=1e-3)
    if chain == "means":
        assert abs(fitted.mean[-1] - problem.centre).max() < abs(fitted.mean[1] - problem.centre).max() / 3
    else:
        np.testing.assert_allclose(fitted.mean[4], fitted.mean[0], atol=1e-3)


# -- the inner runs ----------------------------------------------------------------------------------------
INNER = {
    "nafsa": {"pop_size": 5, "initial": "nominal", "visual": [0.2, 0.1]},
    "oafsa": {"pop_size": 6, "horizon": 8, "rises": 1, "patience": 2, "initial": "nominal"},
    "afsa": {"pop_size": 5},
    "abc": {"pop_size": 5, "limit": 2},
    "ifoa-2020": {"pop_size": 5},
    "cmaes": {},
    "de": {"pop_size": 8},
    "nelder-mead": {},
}


def alone(problem: EstimationProblem, name: str, seed: int, cycles: int) -> navopt.Solution:
    """The inner solver by itself, stopped after so many cycles."""

    def enough(progress: navopt.Progress) -> bool:
        algorithm = progress.algorithm
        # the callback comes before pymoo counts the next iteration
        return getattr(algorithm, "cycle", algorithm.n_iter - 2) >= cycles

    solver = navopt.make_solver(name, **INNER[name])
    return navopt.solve(problem, solver, seed=seed, budget=10**6, callback=enough)


@pytest.mark.parametrize("name", INNER)
def test_each_run_is_the_inner_solver_alone_bit_for_bit(name: str) -> None:
    problem = Rosenbrock(4)
    names, cycles = problem.parameter_names, 7
    groups = [names[1:3], names[3:]]
    search = Phased(
        inner=name, groups=groups, runs_per_phase=4, cycles=cycles, repetitions=1, chain="presets",
        options={**INNER[name], **({"visual": 0.2} if name == "nafsa" else {})},
        group_options={"1": {"visual": [0.2, 0.1]}} if name == "nafsa" else None,
    )  # fmt: skip
    fitted = navopt.solve(problem, search, seed=9).fitted
    seeds = np.random.default_rng(9).integers(2**32, size=4)
    restricted = Restricted(problem, groups[0])
    for run, seed in enumerate(seeds):
        single = alone(restricted, name, int(seed), cycles)
        assert fitted.run_loss[0, run] == single.loss
        assert (fitted.runs[0, run] == restricted.inward(single.x)).all()
    assert len({float(loss) for loss in fitted.run_loss[0]}) == 4


def test_the_second_initialisation_happens_inside_the_phases() -> None:
    problem = Quadratic()
    options = {**INNER["oafsa"], "patience": 1}
    search = Phased(inner="oafsa", runs_per_phase=5, cycles=12, repetitions=1, options=options)
    search.setup(problem, seed=3, termination=NoTermination())
    levels = []
    while search.phase == 0 and search.runs is not None and search.has_next():
        search.next()
        if search.runs is not None and search.runs.state:
            levels.append(search.runs.state["level"].copy())
    assert (levels[-1] < 1.0).any()
    assert issubclass(type(search.runs.leader), OptimalFishSwarm)


# -- the contract, across the ends of phases ---------------------------------------------------------------
def equal(one: navopt.Solution, other: navopt.Solution) -> bool:
    same = (one.x == other.x).all() and one.loss == other.loss and one.counts == other.counts
    if one.fitted is not None:
        same = same and (one.fitted.runs == other.fitted.runs).all()
    return bool(same)


@pytest.mark.parametrize("inner", ["nafsa", "de"])
def test_a_pickled_half_run_goes_on_from_every_batch(inner: str) -> None:
    problem = Quadratic(COUPLED)
    search = Phased(**{**TINY, "inner": inner, "cycles": 1, "options": {"pop_size": 6}})
    whole = navopt.solve(problem, search, seed=4)
    half = search
    half.setup(problem, seed=4, termination=NoTermination())
    batches = 0
    while half.has_next():
        half.next()
        batches += 1
        if half.has_next():
            assert equal(navopt.solve(problem, pickle.loads(pickle.dumps(half))), whole), batches
    assert batches >= 2 * 3 * 3
    assert whole.fitted.repetition.tolist() == [0, 0, 0, 1, 1, 1]


def test_solve_minimize_and_ask_tell_agree() -> None:
    problem = Quadratic(COUPLED)
    solved = navopt.solve(problem, Phased(**TINY), seed=6)
    minimized = minimize(problem, Phased(**TINY), seed=6)
    assert (solved.x == minimized.X).all()
    assert minimized.algorithm.evaluator.n_eval == solved.counts.cost
    asked = Phased(**TINY)
    asked.setup(problem, seed=6)
    while asked.has_next():
        batch = asked.ask()
        again = asked.ask()  # asking twice changes nothing
        assert (batch.get("X") == again.get("X")).all()
        asked.evaluator.eval(problem, batch)
        asked.tell(infills=batch)
    assert (solved.x == asked.opt[0].X).all()
    np.testing.assert_array_equal(asked.fitted.mean, solved.fitted.mean)


@pytest.mark.parametrize("answer", ["best", "mean"])
def test_the_budget_is_used_to_the_last_unit_until_the_end(answer: str) -> None:
    full = navopt.solve(Quadratic(), Phased(**TINY), seed=8).counts.cost
    for budget in (*range(1, full, 29), full, full + 50):
        problem = Quadratic()
        solution = navopt.solve(problem, Phased(**TINY, answer=answer), budget=budget, seed=8)
        tried = np.vstack(problem.seen)
        assert solution.counts.cost == min(budget, full)
        assert solution.status == ("budget" if budget < full else "converged")
        assert solution.loss == float(problem.loss(solution.x))
        if answer == "best":
            assert len(tried) == min(budget, full)
            assert solution.loss == problem.loss(tried).min()


def test_candidates_outside_the_group_are_exactly_as_held() -> None:
    problem = Quadratic(nominal=0.125)
    solution = navopt.solve(problem, Phased(**TINY), seed=1)
    tried, fitted = np.vstack(problem.seen), solution.fitted
    first = tried[: 3 * 4]
    assert (first[:, 2:] == 0.125).all()
    # the identified values are themselves evaluated, once for each phase
    for mean in fitted.mean:
        assert (tried == mean).all(axis=1).any()


# -- stopping ---------------------------------------------------------------------------------------------
def test_a_threshold_ends_runs_and_search() -> None:
    search = Phased(runs_per_phase=3, repetitions=50, threshold=0.5, answer="mean")
    solution = navopt.solve(Quadratic(), search, seed=1)
    fitted = solution.fitted
    assert solution.loss <= 0.5
    assert (fitted.indicator[:-1] > 0.5).all()
    assert len(fitted.labels) == 2
    assert (fitted.run_loss[1] <= 0.5).all()
    # the first group alone cannot come so low, so its runs were full; those of the second ended at once
    plain = navopt.solve(Quadratic(), Phased(runs_per_phase=3, repetitions=1), seed=1)
    assert solution.counts.cost < 0.6 * plain.counts.cost


def test_a_small_change_between_repetitions_ends_the_search() -> None:
    settings = {
        "runs_per_phase": 2, "repetitions": 30, "answer": "mean", "cycles": 30, "options": {"pop_size": 10}
    }  # fmt: skip
    fitted = navopt.solve(Quadratic(COUPLED), Phased(**settings, tolerance=0.02), seed=1).fitted
    at_ends = fitted.indicator[1::2]
    change = np.abs(np.diff(at_ends))
    assert 2 <= len(at_ends) < 30
    assert change[-1] <= 0.02
    assert (change[:-1] > 0.02).all()


def test_a_small_change_between_cycles_ends_a_run() -> None:
    cost = {
        tolerance: navopt.solve(
            Quadratic(), Phased(runs_per_phase=3, repetitions=1, inner_tolerance=tolerance), seed=1
        ).counts.cost
        for tolerance in (None, 1e-6, 0.1)
    }
    assert cost[0.1] < cost[1e-6] < cost[None]


def test_repetitions_are_counted() -> None:
    for repetitions in (1, 3):
        solution = navopt.solve(Quadratic(), Phased(**{**TINY, "repetitions": repetitions}))
        assert len(solution.fitted.labels) == 3 * repetitions
        assert solution.status == "converged"


# -- what it reports ----------------------------------------------------------------------------------------
def test_means_and_deviations_are_those_of_the_runs(tmp_path) -> None:
    solution = navopt.solve(Quadratic(COUPLED), Phased(**TINY, answer="mean"), seed=3)
    fitted = solution.fitted
    for phase in range(6):
        own = fitted.member[phase]
        np.testing.assert_allclose(fitted.mean[phase, own], fitted.runs[phase][:, own].mean(axis=0))
        np.testing.assert_allclose(fitted.sd[phase, own], np.std(fitted.runs[phase][:, own], axis=0, ddof=1))
        assert np.isnan(fitted.sd[phase, ~own]).all()
        assert (fitted.runs[phase][:, ~own] == fitted.mean[phase, ~own]).all()
    assert (solution.x == fitted.mean[-1]).all()
    assert (fitted.x == solution.x).all()
    rows = {row["parameter"]: row for row in fitted.rows()}
    assert list(rows) == list(NAMES)
    assert rows["c"] == {
        "parameter": "c", "unit": "1", "group": "2", "preset": 0.0, "mean": fitted.mean[4, 2],
        "sd": fitted.sd[4, 2], "runs": 3,
    }  # fmt: skip
    assert {row["parameter"]: row for row in fitted.rows(repetition=0)}["c"]["mean"] == fitted.mean[1, 2]
    assert solution.apply(Quadratic(COUPLED, centre=[0.0] * 4))["gap_1"] == abs(solution.x).max()

    solution.save(tmp_path / "run")
    loaded = navopt.Solution.load(tmp_path / "run").fitted
    assert isinstance(loaded, PhasedFit)
    np.testing.assert_array_equal(loaded.runs, fitted.runs)
    assert loaded.rows() == fitted.rows()
    with pytest.raises(InvalidInput, match="no phase has identified it"):
        fitted.phase_of("e")


def test_half_a_phase_reports_the_mean_so_far() -> None:
    problem = Quadratic()
    search = Phased(runs_per_phase=6, cycles=50, answer="mean")
    solution = navopt.solve(problem, search, budget=2500, seed=1)
    assert solution.fitted is None
    assert (solution.x[:2] != 0.0).all()
    assert (solution.x[2:] == 0.0).all()
    assert solution.loss < float(problem.loss(problem.nominal))


class Walled(Quadratic):
    """A quadratic that cannot be evaluated where b is above a wall."""

    wall = -0.4

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return np.where(X[:, 1] > self.wall, np.inf, super()._loss(X))


def test_phases_that_find_nothing_leave_their_parameters_where_they_were() -> None:
    # at the presets nothing can be evaluated until the second group has moved b below the wall
    search = Phased(**{**TINY, "groups": [["c", "d"], ["a", "b"]], "cycles": 20, "repetitions": 1})
    solution = navopt.solve(Walled(), search, seed=1)
    assert np.isnan(solution.fitted.runs[0]).all()
    assert (solution.fitted.mean[0] == 0.0).all()
    assert solution.fitted.indicator[0] == np.inf
    assert solution.x[1] <= -0.4
    assert np.isfinite(solution.fitted.indicator[1])


# -- groups and errors ------------------------------------------------------------------------------------
def test_parameters_in_no_group_stay_at_their_presets() -> None:
    solution = navopt.solve(Quadratic(), Phased(**{**TINY, "groups": {"only": ["d"]}}))
    assert (solution.x[:3] == 0.0).all()
    assert solution.fitted.identified == ("d",)


def test_one_group_of_all_where_a_problem_has_none() -> None:
    search = Phased(runs_per_phase=2, cycles=1, repetitions=1)
    assert navopt.solve(Sphere([1.0, 2.0]), search).fitted.labels == ("all",)


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"inner": "phased"}, InvalidInput, "phases do not nest"),
        ({"inner": "nafsaa"}, UnknownName, "did you mean 'nafsa'"),
        ({"groups": [["a"], ["a", "b"]]}, InvalidInput, "no parameter in two"),
        ({"groups": [["a"], []]}, InvalidInput, "none empty"),
        ({"groups": "abcd"}, InvalidInput, "give lists of parameter names"),
        ({"groups": [["a"], ["e"]]}, UnknownName, "known: a, b, c, d"),
        ({"runs_per_phase": 0}, InvalidInput, "at least 1"),
        ({"tolerance": -1.0}, InvalidInput, "at least 0"),
        ({"threshold": float("nan")}, InvalidInput, "threshold"),
        ({"chain": "mean"}, UnknownName, "did you mean 'means'"),
        ({"answer": "median"}, UnknownName, "answer"),
        ({"options": 3}, InvalidInput, "give keywords"),
        ({"options": {"pop_sise": 3}}, UnknownName, "did you mean 'pop_size'"),
        ({"group_options": {"third": {}}}, UnknownName, "first, second"),
        ({"options": {"visual": [0.1, 0.1, 0.1]}}, InvalidInput, "one for each parameter"),
    ],
)
def test_mistakes_are_named(settings: dict, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        navopt.solve(Quadratic(), Phased(**settings), budget=10)


def test_a_problem_without_names_is_refused() -> None:
    with pytest.raises(UnsuitableProblem, match="by their names"):
        minimize(get_problem("ackley"), Phased(), ("n_eval", 10))


# -- held parameters ----------------------------------------------------------------------------------------
class Known(Quadratic):
    """A quadratic with a prior."""

    provides = frozenset({"residuals", "prior"})

    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.1, 0.2, -0.3, 0.4]), np.linalg.inv(np.array(COUPLED)) * 2.0


def test_a_restricted_problem_is_the_inner_one_with_the_rest_held() -> None:
    inner = Quadratic(COUPLED, nominal=0.5)
    problem = Restricted(inner, ["d", "b"], {"a": 1.25})
    assert problem.parameter_names == ("b", "d")  # the inner order
    X = np.random.default_rng(1).uniform(-5, 5, (9, 2))
    full = np.array([[1.25, b, 0.5, d] for b, d in X])
    assert (problem.loss(X) == inner.loss(full)).all()
    assert (problem.residuals(X) == inner.residuals(full)).all()
    np.testing.assert_allclose(problem.jacobian(X), inner.jacobian(full)[..., [1, 3]], rtol=1e-12, atol=1e-12)
    assert (problem.inward(X) == full).all()
    assert (problem.outward(full) == X).all()
    assert (problem.estimate(X[0]) == full[0]).all()
    assert problem.parameter_groups == {"first": ("b",), "second": ("d",)}
    assert pickle.loads(pickle.dumps(problem)).loss(X[0]) == problem.loss(X[0])


def test_a_whole_vector_holds_and_gives_the_nominal_values() -> None:
    problem = Restricted(Quadratic(), ["a", "c"], [0.1, 0.2, 0.3, 0.4])
    assert problem.nominal.tolist() == [0.1, 0.3]
    assert problem.base.tolist() == [0.1, 0.2, 0.3, 0.4]
    with pytest.raises(InvalidInput, match="nominal of a"):
        Restricted(Quadratic(), ["a"], [9.0, 0.0, 0.0, 0.0])


def test_the_truth_is_known_only_where_the_held_values_are_true() -> None:
    inner = Quadratic()
    right = Restricted(inner, ["a", "b"], {"c": 2.0, "d": 0.25})
    assert right.true_x.tolist() == [1.0, -0.5]
    assert right.score(right.estimate(right.true_x)) == {"gap_1": 0.0}
    wrong = Restricted(inner, ["a", "b"])
    assert wrong.true_x is None
    assert wrong.truth is inner.truth  # scores still are against it
    assert Restricted(Sphere([1.0, 2.0]), ["x0"], {"x1": 2.0}).minimizers.tolist() == [[1.0]]
    assert Restricted(Sphere([1.0, 2.0]), ["x0"], {"x1": 0.0}).minimizers is None


def test_the_prior_is_conditional_on_the_held_values() -> None:
    inner = Known()
    problem = Restricted(inner, ["a", "c"], {"b": 0.9, "d": -1.0})
    mean, covariance = problem.prior()
    X = np.random.default_rng(2).uniform(-2, 2, (5, 2))
    conditional = multivariate_normal(mean, covariance).logpdf(X)
    joint = multivariate_normal(*inner.prior()).logpdf(problem.inward(X))
    np.testing.assert_allclose(conditional - joint, (conditional - joint)[0], atol=1e-12)
    everything = Restricted(inner, NAMES)
    np.testing.assert_array_equal(everything.prior()[1], inner.prior()[1])


def test_restricting_mistakes_are_named() -> None:
    inner = Quadratic()
    for names, fixed, words in [
        ([], None, "at least one parameter"),
        (["a", "a"], None, "each once"),
        (["e"], None, "known: a, b, c, d"),
        (["a"], {"e": 1.0}, "known: a, b, c, d"),
        (["a"], {"a": 1.0}, "either free or fixed"),
        (["a"], [1.0], "a vector of all 4"),
        (["a"], {"b": np.nan}, "finite"),
    ]:
        with pytest.raises(InvalidInput, match=words):
            Restricted(inner, names, fixed)


def test_a_restricted_world_can_be_solved_and_redrawn() -> None:
    world = navopt.simulate("gravity-matching", 0, hours=2.0)
    problem = Restricted(world, world.parameter_names[:2])
    solution = navopt.solve(problem, "random-search", budget=50)
    assert (problem.inward(solution.x)[2:] == world.nominal[2:]).all()
    twin = problem.redraw(5)
    assert twin.parameter_names == problem.parameter_names
    assert twin.loss(solution.x) == world.redraw(5).loss(problem.inward(solution.x))


def test_arrays_are_counted_cut_and_remembered_as_individuals_are() -> None:
    problem = Quadratic()
    X = np.random.default_rng(4).uniform(-5.0, 5.0, (9, 4))
    plain, known = CountingEvaluator(budget=7), CountingEvaluator(budget=7)
    with pytest.raises(BudgetSpent):
        plain.losses(problem, X)
    with pytest.raises(BudgetSpent):
        known.eval(problem, Population.new(X=X))
    assert plain.cost == known.cost == 7
    assert plain.best_loss == known.best_loss == problem.loss(X[:7]).min()
    np.testing.assert_array_equal(plain.best_x, known.best_x)
    assert [row[:2] for row in plain.rows] == [row[:2] for row in known.rows]
    np.testing.assert_array_equal(CountingEvaluator().losses(problem, X), problem.loss(X))
