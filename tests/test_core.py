"""solve, Solution, EstimationProblem and the registry."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from arena import Altered

import navopt
from navopt import errors
from navopt.problem import EstimationProblem, Parameter, stream
from navopt.problems.analytic import Sphere


@pytest.fixture
def sphere() -> Sphere:
    return Sphere([1.0, -2.0, 3.0], lower=-5.0, upper=5.0)


# -- solve ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("offset", [0.0, -7.0])
def test_target_is_absolute_also_below_zero(offset: float) -> None:
    problem = Sphere([1.0, -2.0], lower=-5.0, upper=5.0, offset=offset)
    solution = navopt.solve(problem, "random-search", budget=100_000, target=offset + 0.05)
    assert solution.status == "target"
    assert solution.loss <= offset + 0.05
    assert solution.counts.cost < 100_000


def test_target_in_the_batch_that_the_budget_cuts(sphere: Sphere) -> None:
    reference = navopt.solve(sphere, "random-search", budget=50)
    solution = navopt.solve(sphere, "random-search", budget=50, target=reference.loss)
    assert solution.status == "target"


def test_without_budget_the_solver_ends_by_its_own_rule(sphere: Sphere) -> None:
    solution = navopt.solve(sphere, "de")
    assert solution.status == "converged"
    assert solution.settings["budget"] is None
    assert solution.settings["termination"] == "DefaultSingleObjectiveTermination"


def test_callback_sees_progress_and_can_stop(sphere: Sphere) -> None:
    seen: list[tuple[int, float]] = []

    def stop_after_five(progress: navopt.Progress) -> bool:
        assert float(sphere.loss(progress.x)) == progress.loss
        seen.append((progress.cost, progress.loss))
        return len(seen) == 5

    solution = navopt.solve(sphere, "abc", budget=10_000, callback=stop_after_five)
    assert solution.status == "stopped"
    assert solution.counts.cost == seen[-1][0]
    assert len(seen) == 5


def test_keyboard_interrupt_returns_the_best_so_far(sphere: Sphere) -> None:
    calls = []

    def interrupt(losses: np.ndarray, X: np.ndarray) -> np.ndarray:
        calls.append(len(X))
        if len(calls) == 4:
            raise KeyboardInterrupt
        return losses

    solution = navopt.solve(Altered(sphere, interrupt), "abc", budget=1000)
    assert solution.status == "interrupted"
    assert solution.counts.loss == sum(calls[:3])


def test_an_interrupt_before_any_evaluation_is_the_users(sphere: Sphere) -> None:
    def interrupt(losses: np.ndarray, X: np.ndarray) -> np.ndarray:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        navopt.solve(Altered(sphere, interrupt), "abc", budget=1000)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"budget": 0}, "budget: got 0; give a whole number"),
        ({"budget": 2.5}, "budget: got 2.5"),
        ({"budget": True}, "budget: got True"),
        ({"seed": -1}, "seed: got -1"),
        ({"seed": None}, "seed: got None"),
        ({"target": float("nan")}, "target: got nan"),
    ],
)
def test_bad_arguments_name_themselves(sphere: Sphere, arguments: dict, message: str) -> None:
    with pytest.raises(errors.InvalidInput, match=message):
        navopt.solve(sphere, "abc", **arguments)


def test_unknown_solver_suggests_the_nearest(sphere: Sphere) -> None:
    with pytest.raises(errors.UnknownName, match="did you mean 'affine-abc'"):
        navopt.solve(sphere, "afine-abc")
    with pytest.raises(errors.UnknownName, match="did you mean 'pop_size'"):
        navopt.make_solver("abc", popsize=3)
    with pytest.raises(errors.UnknownName, match="did you mean 'gravity-matching'"):
        navopt.simulate("gravity_matching")
    with pytest.raises(errors.InvalidInput, match="give a registered name or a pymoo Algorithm"):
        navopt.solve(sphere, 3)  # type: ignore[arg-type]
    with pytest.raises(errors.InvalidInput, match=r"navopt\.EstimationProblem"):
        navopt.solve("sphere", "abc")  # type: ignore[arg-type]


def test_a_half_run_refuses_another_problem(sphere: Sphere) -> None:
    algorithm = navopt.make_solver("abc")
    algorithm.setup(sphere, seed=1)
    algorithm.next()
    with pytest.raises(errors.InvalidInput, match="paused on another problem"):
        navopt.solve(Sphere([0.0]), algorithm)


def test_every_improvement_is_in_the_trace(sphere: Sphere) -> None:
    order: list[float] = []
    watched = Altered(sphere, lambda losses, X: (order.extend(losses.tolist()), losses)[1])
    trace = navopt.solve(watched, "pso", budget=333).trace
    best = np.minimum.accumulate(order)
    improvements = np.flatnonzero(np.r_[True, np.diff(best) < 0])
    assert trace["cost"].tolist() == sorted({*(improvements + 1).tolist(), 333})
    assert (trace["loss"] == best[trace["cost"] - 1]).all()


# -- Solution ---------------------------------------------------------------------------------------
def test_solution_survives_disk(sphere: Sphere, tmp_path) -> None:
    solution = navopt.solve(sphere, "abc", budget=200, seed=9)
    files = solution.save(tmp_path / "deep" / "best.run")
    assert [f.suffix for f in files] == [".json", ".npz"]
    back = navopt.Solution.load(tmp_path / "deep" / "best.run")
    assert (back.x == solution.x).all()
    assert back.loss == solution.loss
    assert back.counts == solution.counts
    assert back.scores == solution.scores
    assert (back.trace == solution.trace).all()
    assert back.settings == solution.settings
    assert (back.estimate.position == solution.estimate.position).all()
    assert back.apply(sphere) == solution.scores


def test_loading_never_imports_what_a_file_names(sphere: Sphere, tmp_path) -> None:
    json_file, _ = navopt.solve(sphere, "abc", budget=50).save(tmp_path / "run")
    document = json.loads(json_file.read_text())
    document["estimate"]["class"] = "antigravity:Point"
    json_file.write_text(json.dumps(document))
    assert navopt.Solution.load(tmp_path / "run").estimate is None
    document["format"] = 99
    json_file.write_text(json.dumps(document))
    with pytest.raises(errors.InvalidInput, match="format 99"):
        navopt.Solution.load(tmp_path / "run")
    with pytest.raises(errors.InvalidInput, match="without suffix"):
        navopt.Solution.load(tmp_path / "nowhere")


# -- EstimationProblem ------------------------------------------------------------------------------
def test_loss_broadcasts_and_is_the_same_alone(sphere: Sphere) -> None:
    X = np.random.default_rng(0).uniform(-5, 5, (4, 6, 3))
    losses = sphere.loss(X)
    assert losses.shape == (4, 6)
    assert all(sphere.loss(X[i, j]) == losses[i, j] for i in range(4) for j in range(6))
    assert (sphere.loss(np.asfortranarray(X)) == losses).all()
    assert sphere.evaluate(X[0]).shape == (6, 1)


def test_bad_candidates_are_named(sphere: Sphere) -> None:
    with pytest.raises(errors.InvalidInput, match="last axis must hold the 3 parameters"):
        sphere.loss(np.zeros(2))
    with pytest.raises(errors.InvalidInput, match="candidate 1: got"):
        sphere.loss([[0, 0, 0], [0, np.nan, 0]])


def test_error_bound_is_the_inverse_information(sphere: Sphere) -> None:
    assert np.allclose(sphere.error_bound(), np.eye(3))

    class Blind(Sphere):
        def __init__(self) -> None:
            super().__init__([0.0, 0.0])

        def _residuals(self, X: np.ndarray) -> np.ndarray:
            return X[:, :1] + X[:, 1:]

        def _jacobian(self, X: np.ndarray) -> np.ndarray:
            return EstimationProblem._jacobian(self, X)

    with pytest.raises(errors.NoBound, match="singular"):
        Blind().error_bound()


def test_numerical_jacobian_agrees_with_the_closed_form(sphere: Sphere) -> None:
    x = np.array([[0.3, -1.0, 2.0]])
    assert np.allclose(EstimationProblem._jacobian(sphere, x), sphere.jacobian(x), atol=1e-8)


def test_problems_without_capabilities_say_so() -> None:
    class Bare(EstimationProblem):
        def __init__(self) -> None:
            super().__init__([Parameter("x", "m", 0.0, 1.0, 0.5)])

        def _loss(self, X: np.ndarray) -> np.ndarray:
            return X[:, 0]

    bare = Bare()
    with pytest.raises(errors.NoTruth, match="Bare carries no truth"):
        bare.score(None)
    with pytest.raises(errors.NoBound, match="no residuals"):
        bare.error_bound()
    with pytest.raises(errors.UnsuitableProblem, match="does not provide 'residuals'"):
        bare.residuals([0.5])
    with pytest.raises(errors.UnsuitableProblem, match="recorded data"):
        bare.redraw(1)
    assert bare.prior() is None
    assert pickle.loads(pickle.dumps(navopt.simulate("sphere", 1))).loss([0, 0, 0]) == navopt.simulate(
        "sphere", 1
    ).loss([0, 0, 0])


@pytest.mark.parametrize(("lower", "upper", "nominal"), [(1, 1, 1), (2, 1, 1), (0, np.inf, 1), (0, 1, 2)])
def test_parameters_check_their_box(lower: float, upper: float, nominal: float) -> None:
    with pytest.raises(errors.InvalidInput):
        Parameter("x", "m", lower, upper, nominal)


def test_streams_are_apart() -> None:
    draws = {label: stream(label, 1).random(3).tolist() for label in ("world:a", "world:b", "noise:a")}
    assert len({tuple(d) for d in draws.values()}) == 3
    assert stream("world:a", 1).random() != np.random.default_rng(1).random()
    assert stream("world:a", 1, 2).random() != stream("world:a", 1, 3).random()
    with pytest.raises(errors.InvalidInput, match="seed: got -1"):
        stream("world:a", -1)


def test_errors_share_one_root_and_pickle() -> None:
    for name in errors.__all__:
        assert issubclass(getattr(errors, name), errors.NavoptError)
    for error in (
        errors.InvalidInput("budget", 0, "give more"),
        errors.UnknownName("solver", "abd", ["abc", "pso"]),
        errors.MissingExtra("gravity", "gravity-map"),
    ):
        assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert "navopt[gravity]" in str(errors.MissingExtra("gravity", "gravity-map"))
    assert len(str(errors.InvalidInput("x", list(range(1000)), "less"))) < 200
