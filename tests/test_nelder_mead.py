"""Nelder-Mead, evaluation by evaluation, against scipy."""

import copy
import pickle
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import Bounds, minimize

from navopt import EstimationProblem, Parameter, solve
from navopt.algorithms.nelder_mead import NelderMead
from navopt.errors import InvalidInput
from navopt.problems.analytic import Sphere
from navopt.problems.analytic_base import Point


class Function(EstimationProblem):
    """A loss given as a function of one point."""

    def __init__(self, function, lower, upper):
        super().__init__(
            [Parameter(f"x{k}", "1", a, b, a) for k, (a, b) in enumerate(zip(lower, upper, strict=True))]
        )
        self.function = function

    def _loss(self, X):
        return np.array([self.function(x) for x in X])

    def estimate(self, x):
        return Point(np.array(x))


def rosenbrock(x):
    return float(np.sum(100.0 * (x[1:] - x[:-1] ** 2) ** 2 + (1.0 - x[:-1]) ** 2))


def outside_corner(x):
    """Smallest beyond two sides of the box, so that vertices stick to its corner."""
    return float(np.sum((x - np.arange(1.0, len(x) + 1)) ** 2) + 0.5 * x[0] * x[1])


def plateau(x):
    return float(np.floor(4.0 * np.sum(x**2)))


def evaluations(problem, count, seed, **settings):
    """The first points a run evaluates, in order, with their losses."""
    algorithm = NelderMead(**settings)
    algorithm.setup(problem, seed=seed)
    X, F = [], []
    while len(X) < count:
        pop = algorithm.ask()
        algorithm.evaluator.eval(problem, pop)
        X += list(pop.get("X"))
        F += list(pop.get("F")[:, 0])
        algorithm.tell(infills=pop)
    return np.array(X[:count]), np.array(F[:count]), algorithm


def scipy_run(problem, simplex, **options):
    X, F = [], []

    def function(x):
        X.append(np.array(x))
        F.append(float(problem.loss(x)))
        return F[-1]

    result = minimize(
        function,
        simplex[0],
        method="Nelder-Mead",
        bounds=Bounds(problem.xl, problem.xu),
        options={
            "initial_simplex": simplex,
            "xatol": 1e-6,
            "fatol": 1e-10,
            "maxiter": 10**6,
            "maxfev": 10**6,
            **options,
        },
    )
    return np.array(X), np.array(F), result


CASES = {
    "rosenbrock 2": Function(rosenbrock, [-3.0, -3.0], [3.0, 3.0]),
    "rosenbrock 4": Function(rosenbrock, [-3.0] * 4, [3.0] * 4),
    "sphere 3": Sphere([1.0, -2.0, 0.3]),
    "sphere 1": Sphere([0.3]),
    "corner": Function(outside_corner, [-2.0, -2.0, -2.0], [0.5, 1.5, 4.0]),
    "narrow box": Function(rosenbrock, [-0.2, -5.0, 0.0], [0.8, 0.3, 1e-3]),
    "optimum on the wall": Sphere([10.0, -10.0, 0.0]),
    "plateau": Function(plateau, [-1.0, -1.0, -1.0], [1.5, 1.5, 1.5]),
}


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", CASES)
def test_every_evaluation_is_scipys(name, seed):
    problem = CASES[name]
    n = problem.n_var
    simplex, _, _ = evaluations(problem, n + 1, seed)
    assert np.linalg.matrix_rank(simplex[1:] - simplex[0]) == n
    X, F, result = scipy_run(problem, simplex)
    assert result.success
    assert len(X) > 20
    ours, losses, _ = evaluations(problem, len(X), seed, tolerance=1e-12)
    different = np.flatnonzero((ours != X).any(axis=1))
    assert different.size == 0, f"evaluation {different[0]} of {len(X)} differs"
    np.testing.assert_array_equal(losses, F)


@pytest.mark.parametrize("seed", range(4))
def test_infinite_losses_are_handled_as_scipy_does(seed):
    problem = Function(
        lambda x: np.inf if x[0] < 0.1 or x[1] > 0.9 else rosenbrock(x), [-0.5, -0.5], [1.5, 1.5]
    )
    simplex, _, _ = evaluations(problem, 3, seed, size=0.4)
    X, F, _ = scipy_run(problem, simplex, maxfev=150)
    assert np.isinf(F).any()
    ours, _, _ = evaluations(problem, len(X), seed, size=0.4, tolerance=1e-12)
    np.testing.assert_array_equal(ours, X)


def test_a_start_is_the_first_vertex_and_the_edges_are_a_tenth_of_the_box():
    problem = Function(rosenbrock, [-3.0, 0.0], [3.0, 1.0])
    X, _, _ = evaluations(problem, 3, 1, start=[0.5, 0.25])
    np.testing.assert_allclose(X, [[0.5, 0.25], [1.1, 0.25], [0.5, 0.35]])
    # towards the far side where the near one would leave the box
    X, _, _ = evaluations(problem, 3, 1, start=[2.9, 0.95])
    np.testing.assert_allclose(X, [[2.9, 0.95], [2.3, 0.95], [2.9, 0.85]])
    # a start outside the box begins at its wall
    X, _, _ = evaluations(problem, 3, 1, start=[9.0, -7.0])
    np.testing.assert_allclose(X, [[3.0, 0.0], [2.4, 0.0], [3.0, 0.1]])


def test_starts_are_uniform_draws_of_the_seed():
    problem = Function(rosenbrock, [-3.0, 0.0], [3.0, 1.0])
    expected = np.random.default_rng(7).uniform([-3.0, 0.0], [3.0, 1.0])
    X, _, _ = evaluations(problem, 1, 7)
    np.testing.assert_array_equal(X[0], expected)


def test_a_collapsed_simplex_starts_again_elsewhere():
    problem = Sphere([1.0, -2.0])
    X, F, algorithm = evaluations(problem, 700, 4, tolerance=1e-6)
    assert algorithm.restarts >= 2
    # a start is the first of n + 1 points of a fresh simplex, of edge 0.1 of the box
    jumps = [
        k
        for k in range(len(X) - 2)
        if np.allclose(np.abs(X[k + 1 : k + 3] - X[k]), np.diag([2.0, 2.0]), atol=1e-12)
    ]
    assert len(jumps) == algorithm.restarts + 1
    for k, end in pairwise(jumps):
        # every descent had converged, to the tolerance, before it was given up
        assert F[k:end].min() < 1e-9
        last = X[k:end][np.argsort(F[k:end])][:3]
        assert np.abs(last - last[0]).max() < 1e-4
    assert len({tuple(X[k]) for k in jumps}) == len(jumps)


def test_restarts_find_the_better_of_two_valleys():
    def two_valleys(x):
        return float(min(np.sum((x - 2.0) ** 2), 0.5 + 3.0 * np.sum((x + 2.0) ** 2)) + 1.0)

    problem = Function(two_valleys, [-3.0, -3.0], [3.0, 3.0])
    for seed in range(3):
        assert solve(problem, "nelder-mead", budget=1500, seed=seed).loss == pytest.approx(1.0, abs=1e-6)


def test_only_the_first_start_is_the_given_one():
    problem = Sphere([1.0, -2.0])
    X, _, algorithm = evaluations(problem, 500, 4, start=[5.0, 5.0])
    assert algorithm.restarts >= 1
    assert (X == [5.0, 5.0]).all(axis=1).sum() == 1


def test_nothing_finite_does_not_hang():
    problem = Function(lambda x: np.inf, [0.0, 0.0], [1.0, 1.0])
    answer = solve(problem, "nelder-mead", budget=500)
    assert answer.status == "invalid"
    assert answer.counts.loss == 500


@pytest.mark.parametrize("batches", [1, 2, 5, 17, 60, 200])
def test_a_pickled_or_copied_half_run_goes_on_identically(batches):
    problem = Function(rosenbrock, [-3.0] * 3, [3.0] * 3)
    whole = solve(problem, NelderMead(), budget=700, seed=9)
    half = NelderMead()
    half.setup(problem, seed=9)
    for _ in range(batches):
        half.next()
    for revived in (pickle.loads(pickle.dumps(half)), copy.deepcopy(half)):
        resumed = solve(problem, revived, budget=700)
        np.testing.assert_array_equal(resumed.x, whole.x)
        assert resumed.loss == whole.loss
        assert resumed.counts.loss == 700


def test_unusable_settings_are_refused():
    for settings in ({"size": 0.0}, {"size": 0.7}, {"tolerance": 0.0}, {"tolerance": 0.2}):
        with pytest.raises(InvalidInput, match=next(iter(settings))):
            NelderMead(**settings)
    with pytest.raises(InvalidInput, match="start"):
        solve(Sphere([1.0, 2.0]), NelderMead(start=[1.0, 2.0, 3.0]), budget=50)
    with pytest.raises(InvalidInput, match="start"):
        solve(Sphere([1.0, 2.0]), NelderMead(start=[np.nan, 2.0]), budget=50)
