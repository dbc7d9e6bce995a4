"""The anchors of every comparison: each against its own library, or against plain draws."""

import pickle
import random

import cma
import numpy as np
import pytest
from pymoo.algorithms.soo.nonconvex.de import DE
from pymoo.algorithms.soo.nonconvex.pso import PSO
from pymoo.operators.sampling.lhs import LHS
from pymoo.optimize import minimize
from scipy import stats

from navopt import EstimationProblem, Parameter, make_solver, solve
from navopt.algorithms.cmaes import CMAES
from navopt.errors import InvalidInput, NavoptError, UnknownName
from navopt.problems.analytic import Sphere
from navopt.problems.analytic_base import Point


class Function(EstimationProblem):
    """A loss given as a vectorised function of rows; what was asked for is written down."""

    def __init__(self, function, lower, upper):
        super().__init__(
            [Parameter(f"x{k}", "1", a, b, a) for k, (a, b) in enumerate(zip(lower, upper, strict=True))]
        )
        self.function = function
        self.asked = []

    def _loss(self, X):
        self.asked.append(X.copy())
        return self.function(X)

    def estimate(self, x):
        return Point(np.array(x))


def rosenbrock(X):
    return np.sum(100.0 * (X[:, 1:] - X[:, :-1] ** 2) ** 2 + (1.0 - X[:, :-1]) ** 2, axis=1)


def box(n, function=rosenbrock):
    return Function(function, [-2.0] * n, [3.0] * n)


def batches(algorithm, problem, seed, count, evaluations=10**9):
    """So many batches of ask and tell, or until so many evaluations."""
    algorithm.setup(problem, seed=seed)
    result = []
    while len(result) < count and algorithm.evaluator.n_eval < evaluations:
        pop = algorithm.ask()
        algorithm.evaluator.eval(problem, pop)
        result.append((pop.get("X").copy(), pop.get("F")[:, 0].copy()))
        algorithm.tell(infills=pop)
    return result


# -- random search -------------------------------------------------------------------------------------


def test_random_search_is_the_generators_uniform_draws():
    problem = Function(rosenbrock, [-2.0, 5.0, -1.0], [3.0, 6.0, 0.0])
    answer = solve(problem, "random-search", budget=250, seed=8)
    X = np.random.default_rng(8).uniform(problem.xl, problem.xu, (300, 3))[:250]
    np.testing.assert_array_equal(np.vstack(problem.asked[:3]), X)
    assert answer.loss == rosenbrock(X).min()
    np.testing.assert_array_equal(answer.x, X[rosenbrock(X).argmin()])
    for column in (X - problem.xl).T / (problem.xu - problem.xl)[:, None]:
        assert stats.kstest(column, stats.uniform.cdf).pvalue > 0.001 / 3


# -- pymoo's own ----------------------------------------------------------------------------------------


def pymoo_run(algorithm, problem, seed, n_eval):
    problem.asked.clear()
    result = minimize(problem, algorithm, ("n_eval", n_eval), seed=seed)
    return result, np.vstack(problem.asked)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"pop_size": 12, "w": 0.7, "c1": 1.5, "c2": 1.6, "adaptive": False, "pertube_best": False},
        {"initial_velocity": "zero", "max_velocity_rate": 0.5},
    ],
)
def test_pso_is_pymoos_pso(settings):
    problem = box(3)
    ours, asked = pymoo_run(make_solver("pso", **settings), problem, 3, 400)
    theirs, expected = pymoo_run(PSO(**{"sampling": LHS(), **settings}), problem, 3, 400)
    np.testing.assert_array_equal(asked, expected)
    np.testing.assert_array_equal(ours.X, theirs.X)
    assert ours.F == theirs.F


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"pop_size": 12, "F": 0.8, "CR": 0.2},
        {"variant": "DE/best/1/bin", "F": 0.3, "CR": 1.0},
        {"variant": "DE/rand/2/exp"},
    ],
)
def test_de_is_pymoos_de(settings):
    problem = box(3)
    ours = make_solver("de", **settings)
    full = {"pop_size": 50, "variant": "DE/rand/1/bin", "F": 0.5, "CR": 0.9, **settings}
    # whatever else the factory fixes for pymoo's variant is part of its settings
    others = {key: value for key, value in ours.settings.items() if key not in full}
    ours, asked = pymoo_run(ours, problem, 3, 400)
    theirs, expected = pymoo_run(DE(sampling=LHS(), **full, **others), problem, 3, 400)
    np.testing.assert_array_equal(asked, expected)
    np.testing.assert_array_equal(ours.X, theirs.X)
    assert ours.F == theirs.F


def trials_and_parents(F, CR, n=4, pop_size=8, seed=2, **settings):
    """First generation of DE: parents, trials."""
    algorithm = make_solver("de", pop_size=pop_size, F=F, CR=CR, **settings)
    wide = Function(rosenbrock, [-1.0] * n, [1.0] * n)
    (parents, _), (trials, _) = batches(algorithm, wide, seed, 2)
    return parents, trials


def is_difference(donor, parents, F):
    """Whether a donor is a + F (b - c) of three parents."""
    D = (parents[None, :, None, :] - parents[None, None, :, :]) * F + parents[:, None, None, :]
    return bool(np.isclose(D, donor, atol=1e-12).all(axis=-1).any())


@pytest.mark.parametrize("F", [0.02, 0.05])
def test_the_differential_weight_reaches_the_operator(F):
    hits = dict.fromkeys((0.02, 0.05, 0.5), 0)
    total = 0
    for seed in range(6):
        parents, trials = trials_and_parents(F, 1.0, seed=seed)
        moved = [trial for trial in trials if not (trial == parents).all(axis=1).any()]
        total += len(moved)
        for trial in moved:
            for factor in hits:
                hits[factor] += is_difference(trial, parents, factor)
    # some donors leave the box and are repaired
    assert total > 40
    assert hits[F] > 0.75 * total
    assert all(count == 0 for factor, count in hits.items() if factor != F)


@pytest.mark.parametrize("CR", [0.0, 0.3, 0.9, 1.0])
def test_the_crossover_rate_reaches_the_operator(CR):
    n, changed = 10, []
    for seed in range(12):
        parents, trials = trials_and_parents(0.2, CR, n=n, pop_size=30, seed=seed)
        changed += list((parents != trials).sum(axis=1))
    changed = np.array(changed)
    # binomial crossover with at least one coordinate from the donor
    expected = (np.arange(n + 1) * stats.binom(n, CR).pmf(np.arange(n + 1))).sum() + (1 - CR) ** n
    assert changed.min() >= 1
    # a mutation after it, if there is any, adds about one coordinate to one trial in ten
    error = 4 * np.sqrt(n * max(CR * (1 - CR), 0.01) / len(changed))
    assert expected - error < changed.mean() < expected + error + 0.13


def test_de_is_differential_evolution_and_nothing_else():
    """Every trial of DE/rand/1/bin with CR = 1 inside the box is a + F (b - c) (Storn and Price 1997)."""
    total, exact = 0, 0
    for seed in range(20):
        # so small a weight that hardly any donor leaves the box and is repaired
        parents, trials = trials_and_parents(0.005, 1.0, seed=seed)
        total += len(trials)
        exact += sum(is_difference(trial, parents, 0.005) for trial in trials)
    assert exact >= 0.97 * total, f"{total - exact} of {total} trials are something else"


@pytest.mark.parametrize(
    "settings", [{"CR": 1.5}, {"CR": -0.1}, {"F": -1.0}, {"F": 0.0}, {"variant": "DE/foo"}]
)
def test_de_refuses_settings_that_mean_nothing(settings):
    with pytest.raises(NavoptError, match=next(iter(settings))):
        make_solver("de", **settings)


@pytest.mark.parametrize(
    "settings",
    [{"initial_velocity": "fast"}, {"max_velocity_rate": 0.0}, {"pop_size": 1}],
)
def test_pso_refuses_settings_that_mean_nothing(settings):
    with pytest.raises(NavoptError, match=next(iter(settings))):
        make_solver("pso", **settings)


def test_two_solvers_do_not_share_operators():
    a, b = make_solver("de"), make_solver("de", F=0.9, CR=0.1)
    assert (a.mating.F.value, a.mating.CR.value) == (0.5, 0.9)
    assert (b.mating.F.value, b.mating.CR.value) == (0.9, 0.1)
    assert a.mating is not b.mating
    assert a.mating.mutation is not b.mating.mutation
    assert make_solver("pso").initialization.sampling is not make_solver("pso").initialization.sampling


# -- CMA-ES ---------------------------------------------------------------------------------------------


def test_cmaes_is_the_cma_package_with_our_generator():
    """The same random numbers through `cma` directly, batch by batch, over several restarts."""
    problem = Function(rosenbrock, [-2.0, -1.0, 0.0], [3.0, 4.0, 2.0])
    ours = batches(CMAES(sigma=0.2, pop_size=6), problem, 5, 1000, 6000)
    rng = np.random.default_rng(5)
    strategy, restarts = None, -1
    for X, F in ours:
        if strategy is None:
            restarts += 1
            start = rng.random(3)
            options = {
                "bounds": [0, 1],
                "popsize": 6 * 2**restarts,
                "randn": lambda *shape: rng.standard_normal(shape),
                "seed": np.nan,
                "verbose": -9,
                "verb_log": 0,
            }
            strategy = cma.CMAEvolutionStrategy(start, 0.2, options)
        asked = strategy.ask()
        expected = problem.xl + np.array(asked) * (problem.xu - problem.xl)
        np.testing.assert_allclose(X, np.clip(expected, problem.xl, problem.xu), rtol=0, atol=1e-15)
        np.testing.assert_array_equal(X, np.clip(expected, problem.xl, problem.xu))
        strategy.tell(asked, F.tolist())
        if strategy.stop():
            strategy = None
    assert restarts >= 2


def test_cmaes_default_population():
    for n, size in ((1, 4), (2, 6), (4, 8), (10, 10)):
        X, _ = batches(CMAES(), Sphere(np.full(n, 0.3)), 1, 1)[0]
        assert X.shape == (size, n)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_cmaes_leaves_the_global_generators_alone(n):
    np.random.seed(123)  # noqa: NPY002
    random.seed(123)
    before, plain = np.random.get_state(), random.getstate()  # noqa: NPY002
    first = solve(box(n, lambda X: np.sum((X - 0.7) ** 2, axis=1)), "cmaes", budget=900, seed=4)
    after = np.random.get_state()  # noqa: NPY002
    assert before[0] == after[0]
    np.testing.assert_array_equal(before[1], after[1])
    assert before[2:] == after[2:]
    assert random.getstate() == plain
    np.random.seed(99)  # noqa: NPY002
    again = solve(box(n, lambda X: np.sum((X - 0.7) ** 2, axis=1)), "cmaes", budget=900, seed=4)
    np.testing.assert_array_equal(first.x, again.x)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_cmaes_finds_known_optima(seed):
    assert solve(box(4), "cmaes", budget=8000, seed=seed).loss < 1e-8
    centre = np.array([1.0, -2.0, 0.3, 7.0])
    answer = solve(Sphere(centre), "cmaes", budget=2000, seed=seed)
    np.testing.assert_allclose(answer.x, centre, atol=1e-4)


def test_cmaes_finds_an_optimum_on_the_wall():
    answer = solve(Sphere([10.0, -10.0, 0.0]), "cmaes", budget=3000, seed=1)
    np.testing.assert_allclose(answer.x, [10.0, -10.0, 0.0], atol=1e-3)


def test_cmaes_restarts_with_a_larger_population_from_another_point():
    problem = Sphere([1.0, -2.0, 3.0])
    algorithm = CMAES(pop_size=5, growth=3)
    sizes, means = [], []
    for X, _ in batches(algorithm, problem, 2, 1000, 4000):
        if not sizes or len(X) != sizes[-1]:
            sizes.append(len(X))
            means.append(X.mean(axis=0))
    assert sizes[:2] == [5, 15]
    assert algorithm.restarts == len(sizes) - 1
    assert np.linalg.norm(means[1] - [1.0, -2.0, 3.0]) > 0.1  # not where the first run had converged


@pytest.mark.parametrize("stop", [1, 3, 40, 170])
def test_cmaes_goes_on_from_a_pickle(stop):
    problem = Sphere([1.0, -2.0, 0.5])  # converges and restarts within the budget
    whole = solve(problem, CMAES(), budget=1999, seed=6)
    half = CMAES()
    half.setup(problem, seed=6)
    for _ in range(stop):
        half.next()
    resumed = solve(problem, pickle.loads(pickle.dumps(half)), budget=1999)
    np.testing.assert_array_equal(resumed.x, whole.x)
    assert resumed.loss == whole.loss


def test_cmaes_survives_losses_that_are_partly_or_wholly_infinite():
    partly = box(2, lambda X: np.where(X[:, 0] > 1.5, np.inf, rosenbrock(X)))
    assert solve(partly, "cmaes", budget=3000, seed=1).loss < 1e-6
    wholly = box(2, lambda X: np.full(len(X), np.inf))
    answer = solve(wholly, "cmaes", budget=500, seed=1)
    assert answer.status == "invalid"
    assert answer.counts.loss == 500


def test_a_region_without_losses_does_not_make_the_population_explode():
    """Restarts because nothing could be evaluated are not the restarts of a converged search."""
    mostly = box(2, lambda X: np.where(np.hypot(*(X - 1.0).T) > 0.35, np.inf, rosenbrock(X)))
    sizes = [len(X) for X, _ in batches(CMAES(), mostly, 1, 12, 2000)]
    assert max(sizes) <= 4 * sizes[0]


def test_unusable_settings_are_refused():
    for settings in ({"sigma": 0.0}, {"sigma": 1.5}, {"pop_size": 3}, {"growth": 0}):
        with pytest.raises(InvalidInput, match=next(iter(settings))):
            CMAES(**settings)
    with pytest.raises(UnknownName, match="popsize"):
        make_solver("cmaes", popsize=10)
