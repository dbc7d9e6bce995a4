"""Noise tuning as a problem: parameters, objectives, scores, bound, twins and a filter of one's own."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

import navopt
from navopt.errors import InvalidInput, NoBound, NoTruth, UnknownName, UnsuitableProblem
from navopt.problems import NoiseEstimate, NoiseTruth, NoiseTuning
from navopt.problems.noise_parameters import CovarianceForm

F = np.array([[1.0, 0.1], [0.0, 1.0]])
H = np.array([[1.0, 0.0]])
Y = np.random.default_rng(0).normal(size=50)


@given(st.integers(1, 5), st.integers(0, 10**6))
@settings(max_examples=50, deadline=None, derandomize=True, database=None)
def test_every_point_of_the_box_is_a_covariance_and_comes_back(size, seed) -> None:
    rng = np.random.default_rng(seed)
    form = CovarianceForm("Q", "full", np.diag(rng.uniform(0.1, 10.0, size)))
    parameters = form.parameters(-3.0, 3.0, 0.0)
    x = np.array([rng.uniform(p.lower, p.upper) for p in parameters])
    matrix = form.matrices(x[None])[0]
    assert np.array_equal(matrix, matrix.T)
    sigma = np.sqrt(np.diag(matrix))
    assert np.linalg.eigvalsh(matrix / np.outer(sigma, sigma)).min() > 0.0
    assert np.allclose(form.matrices(form.vector(matrix)[None])[0], matrix, rtol=1e-6)


def test_forms_of_the_covariances() -> None:
    def problem(**options):
        return NoiseTuning(F, H, Y, G=np.eye(2), P0=np.eye(2), **options)

    assert problem().parameter_names == ("log10_q", "log10_r")
    diagonal = problem(covariance="diagonal", Q_reference=np.diag([2.0, 3.0]))
    assert diagonal.parameter_names == ("log10_q_0", "log10_q_1", "log10_r")
    Q, R = diagonal.covariances([[0.0, 1.0, -1.0]])
    assert np.allclose(Q[0], np.diag([2.0, 30.0]))
    assert R[0, 0, 0] == pytest.approx(0.1)
    full = problem(covariance="full")
    assert full.parameter_names == ("log10_q_0", "log10_q_1", "correlation_q_10", "log10_r")
    Q, _ = full.covariances([[0.0, 2.0, 0.5, 0.0]])
    assert Q[0] == pytest.approx(np.array([[1.0, 5.0], [5.0, 100.0]]))
    fixed = problem(measurement_covariance="fixed", R_reference=[[0.7]])
    assert fixed.parameter_names == ("log10_q",)
    assert fixed.covariances([[0.0]])[1][0, 0, 0] == 0.7
    reference = np.array([[2.0, 1.0], [1.0, 2.0]])
    assert np.allclose(problem(Q_reference=reference).covariances([[1.0, 0.0]])[0][0], 10.0 * reference)


def test_loss_is_the_likelihood_per_measurement() -> None:
    world = navopt.simulate("noise-tuning", 4, steps=80, missing_fraction=0.3)
    x = np.array([[0.1, -0.5], [0.3, -0.2]])
    count = np.isfinite(world.model.y).sum()
    assert np.array_equal(world.loss(x), -world.filter.log_likelihood(*world.covariances(x)) / count)


@pytest.mark.parametrize("covariance", ["scalar", "diagonal", "full"])
@pytest.mark.parametrize("encoding", ["log10", "raw"])
def test_gradient_equals_finite_differences(covariance, encoding) -> None:
    if (covariance, encoding) == ("full", "raw"):
        pytest.skip("a full covariance has no raw form")
    world = navopt.simulate("noise-tuning", 1, steps=60, axes=2, covariance=covariance, encoding=encoding)
    x = world.true_x + 0.1
    steps = 1e-6 * np.eye(world.n_var)
    slopes = (world.loss(x + steps) - world.loss(x - steps)) / 2e-6
    assert world.gradient(x) == pytest.approx(slopes, rel=1e-5, abs=1e-7)


def test_the_oracle_sees_only_the_ratio_and_the_likelihood_both() -> None:
    oracle = navopt.simulate("noise-tuning", 2, steps=1000, objective="oracle")
    likely = navopt.simulate("noise-tuning", 2, steps=1000)
    level = np.linspace(-2.0, 2.0, 9)[:, None] * np.ones(2)
    errors, logs = oracle.loss(oracle.true_x + level), likely.loss(likely.true_x + level)
    # along q and r together nothing but the weight of the prior changes
    assert np.ptp(errors) < 0.12 * errors.min()
    across = oracle.loss(oracle.true_x + np.array([[2.0, -2.0], [-2.0, 2.0]]))
    assert across.min() > 1.5 * errors.max()
    assert np.argmin(logs) == 4
    assert np.ptp(logs) > 0.5


def test_scores_of_truth_and_of_others() -> None:
    world = navopt.simulate("noise-tuning", 5, steps=2000)
    right = world.score(world.truth)
    assert right["state_rmse_ratio_1"] == 1.0
    assert right["log10_q_error_1"] == right["log10_r_error_1"] == right["log10_ratio_error_1"] == 0.0
    assert right["nis_1"] == pytest.approx(1.0, abs=0.15)
    assert right["nees_1"] == pytest.approx(1.0, abs=0.3)
    run = world.filter.run(world.truth.Q, world.truth.R)
    errors = run.estimates[0] - world.truth.states
    assert right["state_rmse_1"] == pytest.approx(np.sqrt(np.mean(errors**2)))
    high = world.score(NoiseEstimate(100.0 * world.truth.Q, world.truth.R))
    assert high["log10_q_error_1"] == pytest.approx(2.0)
    assert high["log10_ratio_error_1"] == pytest.approx(2.0)
    assert high["state_rmse_ratio_1"] > 1.1
    failed = world.score(NoiseEstimate(-world.truth.Q, world.truth.R))
    assert failed["state_rmse_ratio_1"] == np.inf


def test_covariances_that_vary_are_scored_as_they_are() -> None:
    world = navopt.simulate("noise-tuning", 6, steps=600, measurement_step=9.0)
    assert world.truth.R.shape == (600, 1, 1)
    assert world.true_x is None
    assert world.score(world.truth)["state_rmse_ratio_1"] == 1.0
    constant = world.score(NoiseEstimate(world.truth.Q, world.truth.R[0]))
    assert constant["state_rmse_ratio_1"] > 1.0
    assert constant["log10_r_error_1"] == pytest.approx(0.5 * np.log10(9.0))
    assert world.project(world.truth)[1] == pytest.approx(np.log10(0.25) + 0.5 * np.log10(9.0))


def test_twins_differ_in_noise_only() -> None:
    world = navopt.simulate("noise-tuning", 7, steps=60, spread_decades=1.0)
    twin = world.redraw(1)
    assert np.array_equal(twin.truth.Q, world.truth.Q)
    assert np.array_equal(twin.true_x, world.true_x)
    assert not np.isclose(twin.model.y, world.model.y).any()
    assert np.array_equal(world.redraw(1).model.y, twin.model.y)
    other = navopt.simulate("noise-tuning", 8, steps=60, spread_decades=1.0)
    assert other.true_x[0] != world.true_x[0]
    with pytest.raises(UnsuitableProblem, match="recorded data"):
        NoiseTuning(F, H, Y).redraw(1)


def test_bound_is_met_by_the_likelihood() -> None:
    # 60 worlds; variances of 60 draws lie within a factor 2.1 of the true one but for 0.001 / 2
    errors = []
    for seed in range(60):
        world = navopt.simulate("noise-tuning", seed, steps=250)
        found = minimize(
            world.loss, world.nominal, jac=world.gradient, bounds=np.stack([world.xl, world.xu], 1)
        )
        errors.append(found.x - world.true_x)
    bound = np.diag(world.error_bound())
    assert (np.var(errors, axis=0) / bound < 2.1).all()
    assert (np.var(errors, axis=0) / bound > 1.0 / 2.1).all()
    with pytest.raises(NoBound, match="needs x"):
        NoiseTuning(F, H, Y).error_bound()


def test_invalid_candidates_have_reasons() -> None:
    world = navopt.simulate("noise-tuning", 0, steps=30, encoding="raw")
    X = np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, 0.0]])
    assert np.array_equal(np.isinf(world.loss(X)), [False, True, True])
    assert world.invalid_reasons(X[1:]) == ["Q[0, 0] is negative", "R[0, 0] is not positive"]
    solution = navopt.solve(world, "random-search", budget=200)
    assert 100 < sum(solution.invalid.values()) < 200
    assert set(solution.invalid) == {"Q[0, 0] is negative", "R[0, 0] is not positive"}


def test_impossible_magnitudes_fail_with_a_reason() -> None:
    world = navopt.simulate("noise-tuning", 0, steps=30, box=(-400.0, 400.0))
    X = np.array([[399.0, 0.0], [200.0, 0.0], [0.0, -350.0], [0.0, 0.0]])
    assert np.isinf(world.loss(X)).tolist() == [True, True, True, False]
    reasons = world.invalid_reasons(X[:3])
    assert reasons[0] == "Q[0, 0] is not finite"
    assert "diverges" in reasons[1]


def test_a_filter_of_ones_own() -> None:
    filterpy = pytest.importorskip("filterpy.kalman")
    world = navopt.simulate("noise-tuning", 3, steps=400)
    kalman = filterpy.KalmanFilter(dim_x=2, dim_z=1)
    kalman.F, kalman.H, kalman.P = world.model.F, world.model.H, 10.0 * np.eye(2)
    mine = NoiseTuning.from_filterpy(kalman, world.model.y, G=world.model.G)
    solution = navopt.solve(mine, "nelder-mead", budget=150)
    bound = np.sqrt(np.diag(world.error_bound()))
    assert (np.abs(solution.x - world.true_x) < 4.0 * bound).all()
    assert solution.scores == {}
    with pytest.raises(NoTruth):
        mine.score(solution.estimate)
    with pytest.raises(InvalidInput, match='objective="oracle" needs the true states'):
        NoiseTuning(F, H, Y, objective="oracle")
    known = NoiseTuning(F, H, Y, objective="oracle", truth=NoiseTruth(np.zeros((50, 2))))
    assert set(known.score(known.estimate(known.nominal))) == {"state_rmse_1", "nees_1", "nis_1"}
    assert known.loss(known.nominal) == pytest.approx(
        2.0 * known.score(known.estimate(known.nominal))["state_rmse_1"] ** 2
    )


def test_a_pickled_problem_gives_the_same_losses() -> None:
    world = navopt.simulate("noise-tuning", 3, steps=50)
    again = pickle.loads(pickle.dumps(world))
    assert again.loss(world.true_x) == world.loss(world.true_x)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"covariance": "banded"}, "covariance of Q: .*'banded'"),
        ({"objective": "mse"}, "objective: .*'mse'"),
        ({"encoding": "ln"}, "encoding: .*'ln'"),
        ({"box": (1.0, 2.0, 3.0)}, "box: got"),
        ({"box": (1.0, -1.0)}, "bounds of log10_q"),
        ({"covariance": "fixed"}, "covariance: got fixed"),
        ({"Q_reference": np.eye(3)}, r"Q_reference: got \(3, 3\); give \(2, 2\)"),
        ({"R_reference": [[0.0]]}, r"reference of R\[0, 0\]"),
        ({"covariance": "full", "encoding": "raw"}, 'a full covariance needs encoding="log10"'),
        ({"covariance": "diagonal", "Q_reference": np.ones((2, 2))}, "reference of Q: got not diagonal"),
        ({"scored_states": [2]}, "scored_states"),
        ({"state_scale": [1.0, 0.0]}, "state_scale"),
        ({"truth": NoiseTruth(np.zeros((3, 2)))}, "truth.states"),
        ({"truth": NoiseTruth(np.zeros((50, 2)), np.eye(2))}, "truth: got only one of Q and R"),
        ({"update": "fast"}, "update: .*'fast'"),
    ],
)
def test_options_are_checked(options, message) -> None:
    with pytest.raises(InvalidInput, match=message):
        NoiseTuning(F, H, Y, **options)


@pytest.mark.parametrize("option", [{"steps": 2}, {"missing_fraction": 1.0}, {"process_variance": -1.0}])
def test_scenarios_are_checked(option) -> None:
    (name,) = option
    with pytest.raises(InvalidInput, match=f"{name}: got"):
        navopt.simulate("noise-tuning", **option)
    with pytest.raises(UnknownName, match="step"):
        navopt.simulate("noise-tuning", step=3)
