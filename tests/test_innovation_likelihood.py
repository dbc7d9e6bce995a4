"""Maximum likelihood of the innovations: the function, its derivatives, and what the estimates are worth."""

from __future__ import annotations

import numpy as np
import pytest
from noise_tools import (
    TRUE_Q,
    TRUE_R,
    covariance,
    joint_log_likelihood,
    pushing,
    pushing_information,
    random_model,
    state_rmse,
)
from scipy.optimize import approx_fprime, minimize
from scipy.stats import norm

import navopt
from baselines.likelihood_fit import fit_innovation_likelihood
from baselines.likelihood_objective import InnovationObjective, observed_information
from baselines.likelihood_window import fit_windows
from baselines.noise_baseline import structure_of
from baselines.noise_structure import NoisePart, NoiseStructure
from navopt.errors import InvalidInput, UnsuitableProblem
from navopt.models.linear_gaussian import LinearGaussianModel
from navopt.problems.noise_tuning import NoiseTuning

PUSHING = NoiseStructure.of("scalar", [[10.0]], [[1.0]])
KINDS = ["scalar", "diagonal", "full", ("full", "diagonal"), ("diagonal", "full")]


def structure(kind: str | tuple[str, str], g: int = 2, m: int = 2) -> NoiseStructure:
    return NoiseStructure.of(kind, covariance(1, g), covariance(2, m))


def some_theta(which: NoiseStructure, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.7, 0.7, which.n_parameters)


# -- the structure --------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", KINDS)
def test_covariances_are_definite_and_their_slopes_are_right(kind) -> None:
    which = structure(kind)
    theta = some_theta(which)
    dQ, dR = which.slopes(theta)
    for k, unit in enumerate(np.eye(which.n_parameters)):
        step = 1e-6
        up, down = which.covariances(theta + step * unit), which.covariances(theta - step * unit)
        np.testing.assert_allclose(dQ[k], (up[0] - down[0]) / (2 * step), atol=1e-8)
        np.testing.assert_allclose(dR[k], (up[1] - down[1]) / (2 * step), atol=1e-8)
    for matrix in which.covariances(theta):
        assert np.linalg.eigvalsh(matrix)[0] > 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_nearest_parameters_give_a_covariance_back(kind) -> None:
    which = structure(kind)
    Q, R = which.covariances(some_theta(which, 3))
    again = which.covariances(which.nearest(Q, R))
    np.testing.assert_allclose(again[0], Q, rtol=1e-9)
    np.testing.assert_allclose(again[1], R, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_shift_multiplies_both_covariances(kind) -> None:
    which = structure(kind)
    theta = some_theta(which, 4)
    before, after = which.covariances(theta), which.covariances(which.shifted(theta, np.log(3.0)))
    for old, new in zip(before, after, strict=True):
        np.testing.assert_allclose(new, 3.0 * old, rtol=1e-12)


# -- the likelihood -------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [0, 1])
def test_likelihood_is_the_joint_normal_density(kind, seed: int) -> None:
    model, which = random_model(seed), structure(kind)
    theta = some_theta(which, seed)
    value = InnovationObjective(model, which).likelihood(theta)[0]
    assert value == pytest.approx(-joint_log_likelihood(model, *which.covariances(theta)), rel=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_gradient_is_that_of_the_joint_normal_density(kind) -> None:
    model, which = random_model(2), structure(kind)
    theta = some_theta(which, 5)

    def reference(at: np.ndarray) -> float:
        return -joint_log_likelihood(model, *which.covariances(at))

    step = 1e-5
    sides = [(reference(theta + step * e), reference(theta - step * e)) for e in np.eye(len(theta))]
    central = [(up - down) / (2 * step) for up, down in sides]
    np.testing.assert_allclose(InnovationObjective(model, which).likelihood(theta)[1], central, atol=1e-7)


def test_prior_enters_value_and_gradient() -> None:
    model, _ = pushing(0, 60)
    objective = InnovationObjective(model, PUSHING, prior_mean=[0.5, -1.0], prior_sigma=[2.0, 0.5])
    theta = np.array([-1.0, 0.3])
    plain, with_prior = InnovationObjective(model, PUSHING)(theta), objective(theta)
    extra = 0.5 * ((1.5 / 2.0) ** 2 + (1.3 / 0.5) ** 2) / 60
    assert with_prior[0] == pytest.approx(plain[0] + extra, rel=1e-12)
    numeric = approx_fprime(theta, lambda at: objective(at)[0], 1e-7)
    np.testing.assert_allclose(with_prior[1], numeric, atol=1e-5)


def test_missing_steps_at_the_end_do_not_count() -> None:
    model, _ = pushing(1, 80)
    theta = np.array([0.2, -0.4])
    padded = InnovationObjective(model, PUSHING, start=0, stop=50, length=80)
    short = InnovationObjective(model.replaced(y=model.y[:50], u=model.u[:50]), PUSHING)
    assert padded.likelihood(theta)[0] == pytest.approx(short.likelihood(theta)[0], rel=1e-13)
    assert padded.n_seen == 50


def test_expected_information_is_whittles_integral() -> None:
    # the average over worlds removes the part that depends on the realisation
    truth = np.log([TRUE_Q / 10.0, TRUE_R])
    mean = np.mean(
        [InnovationObjective(pushing(k)[0], PUSHING).likelihood(truth)[2] for k in range(20)], axis=0
    )
    np.testing.assert_allclose(mean, pushing_information(1000), rtol=0.04, atol=1.0)


# -- the fit --------------------------------------------------------------------------------------
def test_the_optimum_is_that_of_a_derivative_free_search() -> None:
    model, _ = pushing(2, 300)
    fit = fit_innovation_likelihood(model, PUSHING)
    objective = InnovationObjective(model, PUSHING)
    searched = minimize(
        lambda at: objective.likelihood(at)[0],
        [-2.0, -1.0],
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-9},
    )
    np.testing.assert_allclose(fit.theta, searched.x, atol=1e-5)
    assert fit.log_likelihood == pytest.approx(-searched.fun, abs=1e-8)
    assert fit.converged
    assert not fit.at_limit
    assert fit.starts_agreeing == 5
    curvature = np.linalg.inv(observed_information(objective, fit.theta))
    np.testing.assert_allclose(fit.theta_covariance, curvature, rtol=1e-6)


def test_a_full_fit_is_at_least_as_likely_as_a_diagonal_one() -> None:
    rng = np.random.default_rng(6)
    Q, R = np.array([[1.0, 0.6], [0.6, 0.8]]), np.array([[0.5, -0.3], [-0.3, 0.6]])
    w, v = (rng.multivariate_normal(np.zeros(2), M, size=600) for M in (Q, R))
    x = np.zeros((600, 2))
    for k in range(599):
        x[k + 1] = 0.8 * x[k] + w[k]
    y = x + v
    model = LinearGaussianModel(F=0.8 * np.eye(2), H=np.eye(2), y=y, P0=np.eye(2))
    fits = {
        kind: fit_innovation_likelihood(model, NoiseStructure.of(kind, np.eye(2), np.eye(2)), starts=2)
        for kind in ("scalar", "diagonal", "full")
    }
    levels = [fits[kind].log_likelihood for kind in ("scalar", "diagonal", "full")]
    assert levels[0] <= levels[1] + 1e-6
    assert levels[1] < levels[2]
    # four standard errors of a full 2 by 2 covariance from 600 steps, by the observed information
    np.testing.assert_allclose(fits["full"].Q, Q, atol=0.35)
    np.testing.assert_allclose(fits["full"].R, R, atol=0.35)
    assert np.isfinite(fits["full"].sigma_log10).all()


def test_references_wrong_by_six_decades_lead_to_the_same_estimate() -> None:
    model, _ = pushing(3, 400)
    good = fit_innovation_likelihood(model, PUSHING)
    far = fit_innovation_likelihood(model, NoiseStructure.of("scalar", [[1e6]], [[1e-6]]))
    assert far.Q[0, 0] == pytest.approx(good.Q[0, 0], rel=1e-4)
    assert far.R[0, 0] == pytest.approx(good.R[0, 0], rel=1e-4)


def test_a_variance_that_the_data_want_to_be_zero_is_said_to_be_at_its_limit() -> None:
    which, fits = NoiseStructure.of("scalar", [[1.0]], [[1.0]]), []
    for seed in range(6):
        y = np.random.default_rng(seed).standard_normal(200)
        model = LinearGaussianModel(F=[[1.0]], H=[[1.0]], y=y, P0=[[1.0]])
        fits.append(fit_innovation_likelihood(model, which, starts=1))
    # a random walk that does not walk: about half of the samples have their maximum at zero
    assert any(fit.at_limit for fit in fits)
    for fit in fits:
        assert fit.R[0, 0] == pytest.approx(1.0, abs=0.4)


def test_small_sample_of_worlds_is_unbiased_and_errors_are_as_large_as_said() -> None:
    fits = [fit_innovation_likelihood(pushing(k)[0], PUSHING, starts=1) for k in range(24)]
    errors = np.log10([[fit.Q[0, 0] / TRUE_Q, fit.R[0, 0] / TRUE_R] for fit in fits])
    sigma = np.sqrt(np.diag(np.linalg.inv(pushing_information(1000)))) / np.log(10.0)
    # band of 0.001 over two parameters
    limit = norm.isf(0.001 / 4) / np.sqrt(len(fits))
    assert (np.abs(errors.mean(axis=0)) < limit * sigma + 0.01).all()
    said = np.array([fit.sigma_log10 for fit in fits])
    np.testing.assert_allclose(np.median(said, axis=0), sigma, rtol=0.15)


def test_a_budget_is_asked_before_every_run() -> None:
    model, _ = pushing(4, 200)
    left, asked = 40, []

    def spend(cost: int) -> bool:
        nonlocal left
        asked.append(cost)
        if cost > left:
            return False
        left -= cost
        return True

    fit = fit_innovation_likelihood(model, PUSHING, spend=spend)
    assert left >= 0
    assert 3 * fit.passes <= 40
    assert np.isfinite(fit.theta).all()
    nothing = fit_innovation_likelihood(model, PUSHING, spend=lambda cost: False)
    assert nothing.passes == 0
    np.testing.assert_array_equal(nothing.Q, [[10.0]])


def test_a_second_fit_is_the_same_bit_for_bit() -> None:
    model, _ = pushing(5, 200)
    first, again = (fit_innovation_likelihood(model, PUSHING) for _ in range(2))
    assert first.theta.tobytes() == again.theta.tobytes()


# -- the sliding window ---------------------------------------------------------------------------
def test_windows_do_not_look_ahead() -> None:
    model, _ = pushing(6, 260)
    fit = fit_windows(model, PUSHING, window=80, stride=40)
    y = np.array(model.y)
    y[200:] += 100.0
    other = fit_windows(model.replaced(y=y), PUSHING, window=80, stride=40)
    np.testing.assert_array_equal(fit.R[:201], other.R[:201])
    assert fit.solved_at.tolist() == [40, 80, 120, 160, 200, 240]
    assert not np.array_equal(fit.R[240:], other.R[240:])


def test_one_window_over_everything_is_the_maximum_a_posteriori() -> None:
    model, _ = pushing(7, 201)
    fit = fit_windows(model, PUSHING, window=200, stride=199, walk=2.0)
    part = model.replaced(y=model.y[:199], u=model.u[:199])
    whole = fit_innovation_likelihood(part, PUSHING, prior_sigma=2.0, starts=1)
    np.testing.assert_allclose(fit.theta[0], whole.theta, atol=1e-4)


# -- the solver -----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("options", "sizes"),
    [
        ({"covariance": "scalar"}, (1, 1)),
        ({"covariance": "diagonal", "axes": 2}, (2, 2)),
        ({"covariance": "full", "axes": 2}, (3, 3)),
        ({"encoding": "raw"}, (1, 1)),
    ],
)
def test_a_problem_is_solved_in_its_own_parameters(options: dict, sizes: tuple[int, int]) -> None:
    problem = navopt.simulate("noise-tuning", 3, steps=200, **options)
    which = structure_of(problem)
    assert (which.process.n_parameters, which.measurement.n_parameters) == sizes
    solution = navopt.solve(problem, navopt.make_solver("innovation-likelihood", starts=2))
    # the problem's filter is another one, written by other hands
    seen = np.isfinite(problem.model.y).sum()
    assert solution.loss == pytest.approx(-solution.estimate.log_likelihood / seen, rel=1e-9)
    rng = np.random.default_rng(1)
    around = problem.clip(solution.x + 0.05 * rng.standard_normal((200, problem.n_var)))
    assert problem.loss(around).min() >= solution.loss - 1e-9
    assert solution.counts.internal % (1 + sum(sizes)) == 0
    assert solution.estimate.sigma_log10.shape == (sum(sizes),)
    assert solution.fitted.apply(problem).Q.tolist() == solution.estimate.Q.tolist()


def test_fixed_parts_and_other_structures_can_be_asked_for() -> None:
    problem = navopt.simulate("noise-tuning", 4, steps=300, axes=2)
    known = navopt.make_solver("innovation-likelihood", covariance=("scalar", "fixed"))
    estimate = known.fit(problem)
    np.testing.assert_array_equal(estimate.R, np.eye(2))
    full = navopt.make_solver("innovation-likelihood", covariance=("full", "diagonal")).fit(problem)
    assert full.Q[0, 1] != 0.0
    assert full.R[0, 1] == 0.0
    # the scalar level is that of the diagonal entries
    assert problem.project(full).shape == (2,)


def test_a_window_attaches_covariances_over_time_and_runs_again_on_held_out_data(tmp_path) -> None:
    problem = navopt.simulate("noise-tuning", 5, steps=160, measurement_step=9.0)
    solver = navopt.make_solver("innovation-likelihood", window=60, stride=20)
    solution = navopt.solve(problem, solver)
    assert solution.estimate.R.shape == (160, 1, 1)
    assert solution.counts.loss == 1
    assert set(solution.apply(problem.redraw(2))) == set(solution.scores)
    again = solution.fitted.apply(problem)
    np.testing.assert_array_equal(again.R, solution.estimate.R)
    solution.save(tmp_path / "run")
    loaded = navopt.Solution.load(tmp_path / "run")
    np.testing.assert_array_equal(loaded.estimate.R, solution.estimate.R)
    assert loaded.fitted.settings["window"] == 60


def test_covariances_of_no_known_form_are_refused() -> None:
    class Odd(NoiseTuning):
        Q_form = None

        def covariances(self, X):
            Q, R = NoiseTuning.simulate(0, steps=40).covariances(X)
            return Q + R, R

    odd = object.__new__(Odd)
    odd.__dict__.update(NoiseTuning.simulate(0, steps=40).__dict__)
    odd.__dict__.pop("Q_form")
    with pytest.raises(UnsuitableProblem, match="say what to look for"):
        structure_of(odd)
    with pytest.raises(UnsuitableProblem, match="linear-Gaussian model"):
        navopt.solve(navopt.simulate("sphere", 0), "innovation-likelihood")


# -- bad input ------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: NoiseStructure.of("scalar", [[1.0, 0.5], [0.2, 1.0]], [[1.0]]), r"Q\[\d, \d\]"),
        (lambda: NoiseStructure.of("scalar", [[1.0]], [[np.nan]]), r"R\[0, 0\]"),
        (lambda: NoiseStructure.of("diagonal", [[1.0, 0.0], [0.0, 0.0]], [[1.0]]), r"Q\[1, 1\]"),
        (lambda: NoiseStructure.of("scalar", [[0.0]], [[1.0]]), "Q: got a matrix of zeros"),
        (lambda: NoiseStructure.of("scalar", [[-1.0]], [[1.0]]), r"Q\[0, 0\]"),
        (lambda: NoiseStructure.of("scalar", [[1.0, 2.0], [2.0, 1.0]], [[1.0]]), "Q: .*eigenvalue"),
        (lambda: NoiseStructure.of("some", [[1.0]], [[1.0]]), "covariance: .*full"),
        (lambda: NoisePart.of("Q", "scalar", np.eye(2), 3), "Q: got shape"),
        (
            lambda: InnovationObjective(pushing(0, 50)[0], NoiseStructure.of("scalar", np.eye(2), [[1.0]])),
            "the model has 1 process noises",
        ),
        (lambda: navopt.make_solver("innovation-likelihood", starts=0), "starts: got 0"),
        (lambda: navopt.make_solver("innovation-likelihood", window=10, stride=10), "window: got 10"),
        (lambda: navopt.make_solver("innovation-likelihood", covariance="some"), r"covariance: .*full"),
        (lambda: NoiseStructure.of("fixed", [[1.0]], [[1.0]]), "leave something of Q or R"),
        (lambda: fit_windows(pushing(0, 50)[0], PUSHING, window=5, stride=5), "window: got 5"),
    ],
)
def test_bad_input_is_one_clear_error(make, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        make()


# -- the numbers promised -------------------------------------------------------------------------
@pytest.mark.slow
def test_two_hundred_worlds() -> None:
    worlds, ratios, errors = 200, [], []
    for k in range(worlds):
        fit = fit_innovation_likelihood(pushing(k)[0], PUSHING, starts=1)
        errors.append(np.log10([fit.Q[0, 0] / TRUE_Q, fit.R[0, 0] / TRUE_R]))
        held_out, states = pushing(100_000 + k)
        ours = state_rmse(held_out, states, fit.Q[0, 0], fit.R[0, 0])
        ratios.append(ours / state_rmse(held_out, states, TRUE_Q, TRUE_R))
    bound = np.diag(np.linalg.inv(pushing_information(1000))) / np.log(10.0) ** 2
    bias, variance = np.mean(errors, axis=0), np.var(errors, axis=0, ddof=1)
    print(f"bias of log10 q, r {bias}; variance over bound {variance / bound}")
    print(f"held-out RMSE ratio: median {np.median(ratios):.5f}, 95th {np.quantile(ratios, 0.95):.5f}")
    assert (np.abs(bias) < 0.03).all()
    np.testing.assert_allclose(variance, bound, rtol=0.30)
    assert abs(np.median(ratios) - 1.0) < 0.002
    assert np.quantile(ratios, 0.95) < 1.02
