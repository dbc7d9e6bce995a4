"""The analytic functions against independent sources, their minima, and the promises of a problem."""

from __future__ import annotations

import copy
import itertools
import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest
from pymoo.problems import get_problem
from scipy.optimize import minimize

import navopt
from navopt.errors import InvalidInput, NoTruth, UnknownName
from navopt.problem import EstimationProblem
from navopt.problems import (
    Ackley,
    AnalyticFunction,
    Griewank,
    HelicalValley,
    Point,
    Rastrigin,
    Rosenbrock,
    Sphere,
    TestTubeHolder,
    Wood,
    Zettl,
)

FUNCTIONS: dict[str, AnalyticFunction] = {
    "ackley": Ackley(),
    "griewank": Griewank(),
    "rosenbrock": Rosenbrock(),
    "rastrigin": Rastrigin(),
    "zettl": Zettl(),
    "test-tube-holder": TestTubeHolder(),
    "helical-valley": HelicalValley(),
    "wood": Wood(),
}
SCALABLE = {"ackley": Ackley, "griewank": Griewank, "rosenbrock": Rosenbrock, "rastrigin": Rastrigin}
each_function = pytest.mark.parametrize("name", FUNCTIONS)
with_residuals = pytest.mark.parametrize(
    "function", [Rosenbrock(), Rosenbrock(7), HelicalValley(), Wood(), Sphere([1.0, -2.0, 0.5])], ids=str
)


def points(function: AnalyticFunction, n: int = 2000, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(function.xl, function.xu, (n, function.n_var))


# -- values ------------------------------------------------------------------------------------------
def helical(x: list[float]) -> float:
    angle = math.atan(x[1] / x[0]) / (2 * math.pi) + (0.5 if x[0] < 0 else 0.0)
    return 100 * ((x[2] - 10 * angle) ** 2 + (math.hypot(x[0], x[1]) - 1) ** 2) + x[2] ** 2


def wood(x: list[float]) -> float:
    terms = (10 * (x[1] - x[0] ** 2), 1 - x[0], math.sqrt(90) * (x[3] - x[2] ** 2), 1 - x[2])
    return math.fsum(t * t for t in (*terms, 10**0.5 * (x[1] + x[3] - 2), (x[1] - x[3]) / 10**0.5))


def tube(x: list[float]) -> float:
    return -4 * math.sin(x[0]) * math.cos(x[1]) * math.exp(abs(math.cos((x[0] ** 2 + x[1] ** 2) / 200)))


#: Scalar transcriptions of the sources with Python's own `math`, point by point.
SCALAR: dict[str, Callable[[list[float]], float]] = {
    "ackley": lambda x: (
        20 * (1 - math.exp(-0.2 * math.hypot(*x) / math.sqrt(len(x))))
        + math.e
        - math.exp(math.fsum(math.cos(2 * math.pi * v) for v in x) / len(x))
    ),
    "griewank": lambda x: (
        1 + math.hypot(*x) ** 2 / 4000 - math.prod(math.cos(v / math.sqrt(k)) for k, v in enumerate(x, 1))
    ),
    "rosenbrock": lambda x: math.fsum(100 * (b - a**2) ** 2 + (1 - a) ** 2 for a, b in itertools.pairwise(x)),
    "rastrigin": lambda x: math.fsum(10 + v * v - 10 * math.cos(2 * math.pi * v) for v in x),
    "zettl": lambda x: ((x[0] - 1) ** 2 + x[1] ** 2 - 1) ** 2 + x[0] / 4,
    "test-tube-holder": lambda x: -abs(tube(x)),
    "helical-valley": helical,
    "wood": wood,
}


@each_function
def test_values_agree_with_a_scalar_transcription(name: str) -> None:
    functions = [SCALABLE[name](n) for n in (2, 3, 10)] if name in SCALABLE else [FUNCTIONS[name]]
    for function in functions:
        X = points(function)
        expected = [SCALAR[name](x) for x in X.tolist()]
        np.testing.assert_allclose(function.loss(X), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", SCALABLE)
@pytest.mark.parametrize("n_var", [2, 5, 30])
def test_values_agree_with_pymoo(name: str, n_var: int) -> None:
    X = points(SCALABLE[name](n_var))
    theirs = get_problem(name, n_var=n_var).evaluate(X)[:, 0]
    np.testing.assert_allclose(SCALABLE[name](n_var).loss(X), theirs, rtol=1e-12, atol=1e-12)


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::DeprecationWarning")
@pytest.mark.parametrize(
    ("name", "theirs"),
    [("zettl", "Zettl"), ("test-tube-holder", "TestTubeHolder"), ("helical-valley", "HelicalValley")],
)
def test_values_agree_with_opfunu(name: str, theirs: str) -> None:
    opfunu = pytest.importorskip(
        "opfunu.name_based", reason="opfunu supports Python 3.11 only", exc_type=ImportError
    )
    function, reference = FUNCTIONS[name], getattr(opfunu, theirs)()
    X = points(function, 500)
    if name == "helical-valley":  # theirs is the arctan2 variant, another function where both are negative
        X = X[~((X[:, 0] < 0) & (X[:, 1] < 0))]
    expected = [reference.evaluate(x) for x in X]
    np.testing.assert_allclose(function.loss(X), expected, rtol=1e-12, atol=1e-12)


def test_the_helical_valley_is_continuous_but_for_one_half_plane() -> None:
    loss = HelicalValley().loss
    assert loss([-1.0, 0.0, 0.0]) == 2500.0  # the start: θ = ½
    assert loss([-1.0, 1e-9, 2.0]) == pytest.approx(loss([-1.0, -1e-9, 2.0]), rel=1e-6)
    assert loss([0.0, 1.0, 2.0]) == pytest.approx(loss([-1e-9, 1.0, 2.0]), rel=1e-6)
    below, left = loss([[0.0, -1.0, 0.0], [-1e-17, -1.0, 0.0]])
    assert (below, left) == pytest.approx((100 * 2.5**2, 100 * 7.5**2))
    assert loss([-0.0, -0.0, 3.0]) == loss([0.0, 0.0, 3.0]) == 100 * (9 + 1) + 9
    assert loss([-2.0, -0.0, 3.0]) == loss([-2.0, 0.0, 3.0])


def test_the_two_forms_of_the_test_tube_holder() -> None:
    absolute, signed = TestTubeHolder(), TestTubeHolder("signed")
    X = points(absolute)
    positive = np.sin(X[:, 0]) * np.cos(X[:, 1]) > 0
    assert (absolute.loss(X) == -np.abs(signed.loss(X))).all()
    assert (absolute.loss(X) == signed.loss(X))[positive].all()
    assert signed.loss([-np.pi / 2, 0.0]) == pytest.approx(10.8723, abs=1e-4)
    assert signed.minimizers.shape == (1, 2)
    assert navopt.simulate("test-tube-holder", form="signed").form == "signed"
    with pytest.raises(UnknownName, match="did you mean 'signed'"):
        TestTubeHolder("sign")


# -- minima ------------------------------------------------------------------------------------------
PUBLISHED = {
    "zettl": (-0.00379123722, [-0.02989598, 0]),
    "test-tube-holder": (-10.87230010562, [1.5706026, 0]),
}


@each_function
def test_the_minimum_is_where_it_is_said_to_be(name: str) -> None:
    function = FUNCTIONS[name]
    assert function.loss(function.minimizers) == pytest.approx(function.minimum, abs=1e-15)
    value, place = PUBLISHED.get(
        name, (0.0, np.full(function.n_var, 1.0 if name in ("rosenbrock", "wood") else 0))
    )
    if name == "helical-valley":
        place = [1.0, 0.0, 0.0]
    assert function.minimum == pytest.approx(value, abs=1e-11)
    assert function.minimizers[0] == pytest.approx(np.array(place), abs=2e-8)
    # nothing around a minimiser is lower, at any distance
    rng = np.random.default_rng(1)
    for minimizer in function.minimizers:
        directions = rng.standard_normal((4000, function.n_var))
        around = minimizer + directions * 10.0 ** rng.uniform(-9, 0, (4000, 1))
        assert function.loss(around).min() >= function.minimum - 1e-14


@each_function
def test_the_gradient_vanishes_at_every_minimiser(name: str) -> None:
    function = FUNCTIONS[name]
    if name == "ackley":  # a cone: the slope is -20·(-0.2)/√n in every direction of an axis
        slopes = function.loss(1e-7 * np.vstack([np.eye(2), -np.eye(2)])) / 1e-7
        assert slopes == pytest.approx(4.0 / np.sqrt(2.0), rel=1e-5)
        return
    for minimizer in function.minimizers:
        for step in np.eye(function.n_var) * 1e-6:
            slope = (function.loss(minimizer + step) - function.loss(minimizer - step)) / 2e-6
            assert abs(slope) < 1e-8


@each_function
def test_local_searches_from_everywhere_find_nothing_lower(name: str) -> None:
    function = FUNCTIONS[name]
    found = []
    # where there are very many minima, half of the starts are near the lowest
    starts = points(function, 24, seed=4)
    starts[::2] *= {"griewank": 0.01, "ackley": 0.02, "rastrigin": 0.1, "test-tube-holder": 0.2}.get(
        name, 1.0
    )
    for start in starts:
        end = minimize(lambda x: float(function.loss(x)), start, method="BFGS", jac="3-point")
        assert end.fun >= function.minimum - 1e-13
        if end.fun < function.minimum + 1e-7:
            found.append(end.x)
    assert found
    distances = np.linalg.norm(np.array(found)[:, None] - function.minimizers, axis=2)
    if name == "test-tube-holder":  # BFGS may step out of the box, where the function comes nearer to -4e
        distances = distances[np.abs(found).max(axis=1) <= 10.0]
    assert distances.min(axis=1).max() < 2e-3, "a minimiser is missing"
    assert distances.min(axis=0).max() < 1e-3, "a minimiser is not one"


@pytest.mark.parametrize(("name", "start", "calls"), [
    ("helical-valley", [-1, 0, 0], 140), ("wood", [-3, -1, -3, -1], 515), ("rosenbrock", [-1.2, 1], None),
])  # fmt: skip
def test_quasi_newton_from_the_customary_start(name: str, start: list, calls: int | None) -> None:
    function = FUNCTIONS[name]
    assert function.start.tolist() == function.nominal.tolist() == start
    end = minimize(lambda x: float(function.loss(x)), function.start, method="BFGS")
    assert end.fun < 1e-9
    if calls is not None:  # a note of how hard the functions are; other versions of BFGS take other paths
        assert end.nfev < 4 * calls


def test_rounding_at_the_minimum_is_the_textbook_one() -> None:
    assert Ackley().loss([0.0, 0.0]) == 2.0**-51
    assert Griewank().loss([0.0, 0.0]) == 0.0
    assert Rosenbrock(4).start.tolist() == [-1.2, 1.0, -1.2, 1.0]


def test_the_bound_of_the_test_tube_holder_is_needed() -> None:
    """Beyond the radius within which the minimum is proven there is a lower value."""
    valley = minimize(
        lambda x: float(TestTubeHolder().loss(x)), [2.5 * np.pi, 11 * np.pi], method="Nelder-Mead"
    )
    assert valley.fun < TestTubeHolder().minimum - 1e-5
    assert TestTubeHolder(lower=-17.0, upper=17.0).truth is not None
    assert TestTubeHolder(lower=-30.0, upper=30.0).truth is None
    grid = np.linspace(-24.9, 24.9, 1001)
    X = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    X = X[np.hypot(*X.T) <= 25.0]
    assert TestTubeHolder().loss(X).min() >= TestTubeHolder().minimum


# -- promises of a problem -----------------------------------------------------------------------------
@pytest.mark.parametrize("name", [*FUNCTIONS, "sphere"])
def test_losses_do_not_depend_on_the_batch(name: str) -> None:
    sizes: list = [1, 2, 3, 7, 8, 9, 16, 17, 40, 130] if name in SCALABLE else [None]
    for n_var in sizes:
        if name == "sphere":
            function: AnalyticFunction = Sphere(np.linspace(-1, 1, 33))
        elif name == "rosenbrock":
            function = Rosenbrock(n_var + 1)
        else:
            function = FUNCTIONS[name] if n_var is None else SCALABLE[name](n_var)
        X = points(function, 67)
        whole = function.loss(X)
        assert (np.array([function.loss(x) for x in X]) == whole).all()
        assert (function.loss(np.asfortranarray(X)) == whole).all()
        assert (function.loss(X[::-1])[::-1] == whole).all()
        for first, last in ((0, 2), (1, 4), (3, 20), (5, 67)):
            assert (function.loss(X[first:last]) == whole[first:last]).all()
        assert (function.loss(np.vstack([X] * 40))[-67:] == whole).all()
        assert (function.loss(X[:60].reshape(3, 4, 5, -1)).ravel() == whole[:60]).all()


@with_residuals
def test_the_loss_is_half_the_squared_residuals(function: AnalyticFunction) -> None:
    X = points(function, 200)
    residuals = function.residuals(X)
    np.testing.assert_allclose(0.5 * np.sum(residuals**2, axis=1), function.loss(X), rtol=1e-12)
    assert np.abs(function.residuals(function.true_x)).max() < 1e-15


@with_residuals
def test_jacobians_agree_with_differences(function: AnalyticFunction) -> None:
    X = points(function, 50)
    assert type(function)._jacobian is not EstimationProblem._jacobian
    numerical = EstimationProblem._jacobian(function, X)
    np.testing.assert_allclose(function.jacobian(X), numerical, rtol=1e-5, atol=2e-5)
    assert function.jacobian(X.reshape(5, 10, -1)).shape == (5, 10, *numerical.shape[1:])


def test_the_jacobian_of_the_helical_valley_on_its_axis_is_finite() -> None:
    assert np.isfinite(HelicalValley().jacobian([0.0, 0.0, 1.0])).all()


@each_function
def test_scores_tell_distance_and_gap(name: str) -> None:
    function = FUNCTIONS[name]
    for minimizer in function.minimizers:
        assert function.score(Point(minimizer)) == pytest.approx({"distance_1": 0.0, "gap_1": 0.0}, abs=1e-15)
        off = minimizer + np.eye(function.n_var)[-1] * 0.25
        scores = function.score(function.estimate(off))
        assert scores["distance_1"] == pytest.approx(0.25)
        assert scores["gap_1"] == float(function.loss(off)) - function.minimum > 0
    assert (function.truth.position == function.true_x).all()
    assert (function.project(Point(function.xu + 1.0)) == function.xu).all()
    assert (function.locate(Point(function.xu + 1.0)) == function.xu + 1.0).all()


@each_function
def test_any_box_will_do(name: str) -> None:
    cls, n = type(FUNCTIONS[name]), FUNCTIONS[name].n_var
    vector = cls(lower=-np.arange(2.0, n + 2), upper=np.arange(2.0, n + 2) * 1e3)
    assert vector.xl.tolist() == [-2.0 - k for k in range(n)]
    assert vector.xu.tolist() == [2e3 + 1e3 * k for k in range(n)]
    assert (vector.xl <= vector.nominal).all()
    assert (vector.nominal <= vector.xu).all()
    away = cls(lower=-9.0, upper=-8.0)
    assert away.truth is None
    assert away.true_x is None
    assert away.minimum == FUNCTIONS[name].minimum
    assert np.isfinite(away.loss(points(away, 10))).all()
    with pytest.raises(NoTruth):
        away.score(away.estimate(away.nominal))
    with pytest.raises(InvalidInput, match="lower: got"):
        cls(lower=[0.0] * (n + 1))
    with pytest.raises(InvalidInput, match="lower < upper"):
        cls(lower=1.0, upper=1.0)
    with pytest.raises(InvalidInput, match="lower < upper"):
        cls(upper=np.inf)


@each_function
def test_the_nominal_values_do_not_betray_the_minimum(name: str) -> None:
    function = FUNCTIONS[name]
    assert function.score(function.estimate(function.nominal))["distance_1"] > 0.1
    place = (function.nominal - function.xl) / (function.xu - function.xl)
    assert (np.abs(place - 0.5) > 0.01).any()


@each_function
def test_problems_are_values(name: str) -> None:
    function = FUNCTIONS[name]
    twin = pickle.loads(pickle.dumps(function))
    X = points(function, 20)
    assert (twin.loss(X) == function.loss(X)).all()
    assert copy.deepcopy(function) is function
    assert function.redraw(3) is function
    with pytest.raises(InvalidInput, match="immutable"):
        function.minimum = 0.0
    with pytest.raises(ValueError, match="read-only"):
        function.minimizers[0, 0] = 1.0


@each_function
def test_the_registered_function_needs_no_seed(name: str) -> None:
    X = points(FUNCTIONS[name], 20)
    for seed in (0, 5):
        world = navopt.simulate(name, seed)
        assert type(world) is type(FUNCTIONS[name])
        assert (world.loss(X) == FUNCTIONS[name].loss(X)).all()
    assert navopt.problem_info(name).name == name
    narrow = navopt.simulate(name, lower=-1.5, upper=2.5)
    assert (narrow.xl == -1.5).all()
    with pytest.raises(UnknownName, match="shifted"):
        navopt.simulate(name, shifted=True)


@each_function
def test_scenario_keywords_disguise_the_function(name: str) -> None:
    plain = FUNCTIONS[name]
    world = navopt.simulate(name, 3, shift=True, rotate=True)
    assert world.problem_info.name == f"shifted(rotated({name}))"
    assert world.loss(world.true_x) == pytest.approx(plain.minimum, abs=1e-9)
    assert (np.abs(world.true_x - plain.true_x) >= 0.0999 * (plain.xu - plain.xl)).all()
    again, other = (navopt.simulate(name, seed, shift=True, rotate=True) for seed in (3, 4))
    X = points(plain, 20)
    assert (world.loss(X) == again.loss(X)).all()
    assert (world.loss(X) != other.loss(X)).any()
    near = navopt.simulate(name, 3, shift=[0.01, 0.02])
    assert (np.abs(near.true_x - plain.true_x) <= 0.0201 * (plain.xu - plain.xl)).all()
    noisy = navopt.simulate(name, 3, noise=0.5)
    assert np.std(noisy.loss(points(plain)) - plain.loss(points(plain))) == pytest.approx(0.5, rel=0.1)


def test_scalable_functions_check_their_size() -> None:
    assert navopt.simulate("ackley", n_var=7).n_var == 7
    for cls, least in ((Ackley, 1), (Griewank, 1), (Rastrigin, 1), (Rosenbrock, 2)):
        assert cls(least).n_var == least
        for wrong in (least - 1, 2.0, True):
            with pytest.raises(InvalidInput, match=f"n_var: got {wrong}.*at least {least}"):
                cls(wrong)
    with pytest.raises(UnknownName, match="n_var"):
        navopt.simulate("wood", n_var=4)


def test_the_sphere_is_one_of_them() -> None:
    sphere = Sphere([1.0, 2.0], lower=[-3.0, 0.0], upper=[5.0, 8.0], offset=-7.0)
    assert sphere.minimum == sphere.loss([1.0, 2.0]) == -7.0
    assert sphere.nominal.tolist() == [1.0, 4.0]
    assert sphere.score(Point(np.array([1.0, 4.0]))) == {"distance_1": 2.0, "gap_1": 2.0}
    with pytest.raises(InvalidInput, match="give a point inside the box"):
        Sphere([11.0])
    with pytest.raises(InvalidInput, match="one coordinate per parameter"):
        Sphere(3.0)


def test_a_solver_finds_a_disguised_minimum() -> None:
    problem = navopt.simulate("rosenbrock", 2, shift=True, rotate=True)
    solution = navopt.solve(problem, "cmaes", budget=3000, seed=1)
    assert solution.scores["distance_1"] < 1e-4
    assert solution.x == pytest.approx(problem.true_x, abs=1e-3)
    assert solution.settings["problem"] == "shifted(rotated(rosenbrock))"
