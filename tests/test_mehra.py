"""Mehra's correlation method: gain, covariances and the test of whiteness."""

from __future__ import annotations

import numpy as np
import pytest
from noise_tools import TRUE_Q, TRUE_R, pushing
from scipy.linalg import solve_discrete_lyapunov
from scipy.stats import binom, norm

import navopt
from baselines.als_matrices import ErrorDynamics
from baselines.constant_model import steady, steady_gain
from baselines.mehra_equations import _cross_covariance, fit_mehra, whiteness_test
from baselines.noise_structure import NoiseStructure
from baselines.steady_state_check import check_steady_state
from navopt.errors import InvalidInput, UnsuitableProblem
from navopt.models.linear_gaussian import LinearGaussianModel

PUSHING = NoiseStructure.of("scalar", [[10.0]], [[1.0]])
TRUE_GAIN = steady_gain(pushing(0, 100)[0], [[TRUE_Q]], [[TRUE_R]])


def test_steady_state_is_the_riccati_equation_and_the_alpha_beta_filter() -> None:
    model, _ = pushing(0, 100)
    P, gain = steady(model, [[TRUE_Q]], [[TRUE_R]])
    S = model.H @ P @ model.H.T + TRUE_R
    after = P - gain @ S @ gain.T
    np.testing.assert_allclose(
        model.F @ after @ model.F.T + TRUE_Q * model.G @ model.G.T, P, rtol=1e-9, atol=1e-12
    )
    # Kalata's closed form of the gains from the tracking index
    index = np.sqrt(TRUE_Q) * 0.1**2 / np.sqrt(TRUE_R)
    root = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - root**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha)
    np.testing.assert_allclose(gain[:, 0], [alpha, beta / 0.1], rtol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_exact_autocovariances_give_the_exact_gain(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((3, 3))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    C, L, R = rng.standard_normal((2, 3)), 0.1 * rng.standard_normal((3, 2)), np.diag([0.5, 0.8])
    one = ErrorDynamics(A, C, np.eye(3), L)
    P = solve_discrete_lyapunov(one.closed, np.eye(3) + one.feed @ R @ one.feed.T)
    lags, cross = [C @ P @ C.T + R], A @ (P @ C.T - L @ (C @ P @ C.T + R))
    for _ in range(6):
        lags.append(C @ cross)
        cross = one.closed @ cross
    PC, found = _cross_covariance(one, np.stack(lags))
    np.testing.assert_allclose(PC, P @ C.T, atol=1e-10)
    np.testing.assert_allclose(found, R, atol=1e-10)


def test_gain_against_the_riccati_gain() -> None:
    fits = [fit_mehra(pushing(k, 10_000)[0], PUSHING) for k in range(16)]
    gains = np.array([fit.gain[:, 0] for fit in fits])
    errors = gains.std(axis=0, ddof=1) / np.sqrt(len(gains))
    # two gains and two variances: a band of 0.001 over four; 1 % is for what least squares leave of bias
    limit = norm.isf(0.001 / 8) * errors + 0.01 * TRUE_GAIN[:, 0]
    assert (np.abs(gains.mean(axis=0) - TRUE_GAIN[:, 0]) < limit).all()
    assert (np.abs(gains / TRUE_GAIN[:, 0] - 1.0) < 0.2).all()
    for name, truth in (("Q", TRUE_Q), ("R", TRUE_R)):
        values = np.array([getattr(fit, name)[0, 0] for fit in fits])
        assert abs(values.mean() - truth) < norm.isf(0.001 / 8) * values.std(ddof=1) / 4 + 0.01 * truth
    assert np.mean([fit.after.outside for fit in fits]) < np.mean([fit.before.outside for fit in fits])
    assert not any(fit.before.white for fit in fits[:4])


def test_the_whiteness_test_accepts_white_noise_as_often_as_it_says() -> None:
    rng = np.random.default_rng(11)
    results = [whiteness_test(rng.standard_normal((2000, 1)), lags=30) for _ in range(400)]
    outside = np.mean([result.outside for result in results])
    assert outside == pytest.approx(0.05, abs=0.006)
    # of 30 lags at most one may be outside
    expected = binom.cdf(1, 30, 0.05)
    share = np.mean([result.white for result in results])
    assert abs(share - expected) < norm.isf(0.0005) * np.sqrt(expected * (1 - expected) / 400)


def test_the_whiteness_test_refuses_coloured_noise() -> None:
    rng = np.random.default_rng(12)
    e = rng.standard_normal(2001)
    assert not whiteness_test((e[1:] + 0.5 * e[:-1])[:, None], lags=10).white
    assert whiteness_test((e[1:] + 0.9 * e[:-1])[:, None], lags=10).outside > 0.05


def test_what_it_cannot_do_is_refused() -> None:
    model, _ = pushing(0, 400)
    y = np.array(model.y)
    y[9, 0] = np.nan
    with pytest.raises(UnsuitableProblem, match=r"mehra needs all measurements: y\[9, 0\]"):
        fit_mehra(model.replaced(y=y), PUSHING)
    with pytest.raises(UnsuitableProblem, match="mehra needs a constant model"):
        fit_mehra(model.replaced(H=np.stack([model.H] * 400)), PUSHING)
    with pytest.raises(InvalidInput, match="lags: got 1"):
        fit_mehra(model, PUSHING, lags=1)
    with pytest.raises(InvalidInput, match="y: got 140 steps"):
        fit_mehra(pushing(0, 140)[0], PUSHING, burn_in=100)
    chain = np.array([[0.9, 0.2, 0.0], [0.0, 0.8, 0.3], [0.0, 0.0, 0.7]])
    y = np.random.default_rng(3).standard_normal(500)
    many = LinearGaussianModel(F=chain, H=[[1.0, 0.0, 0.0]], y=y, P0=np.eye(3))
    with pytest.raises(InvalidInput, match="6 unknowns of which the innovations determine 3"):
        fit_mehra(many, NoiseStructure.of(("full", "diagonal"), np.eye(3), [[1.0]]))


def test_a_model_without_a_steady_filter_is_refused() -> None:
    y = np.random.default_rng(4).standard_normal(300)
    model = LinearGaussianModel(F=np.eye(2), H=[[1.0, 0.0]], y=y, P0=np.eye(2), G=np.eye(2))
    with pytest.raises(InvalidInput, match="no stabilising solution"):
        steady_gain(model, np.eye(2), [[1.0]])


def test_the_gain_of_the_filter_reaches_that_of_the_riccati_equation() -> None:
    model, _ = pushing(5, 400)
    check = check_steady_state(model, [[TRUE_Q]], [[TRUE_R]])
    assert check.settles
    # by hand: the covariance recursion from P0 = I
    P, gaps = np.eye(2), []
    for _ in range(400):
        gain = P @ model.H.T / (model.H @ P @ model.H.T + TRUE_R)
        gaps.append(np.abs(gain - TRUE_GAIN).max() / np.abs(TRUE_GAIN).max())
        P = model.F @ (P - gain @ model.H @ P) @ model.F.T + TRUE_Q * model.G @ model.G.T
    late = np.flatnonzero(np.array(gaps) > 0.01)
    assert check.steps == late[-1] + 1
    assert check.last_gap == pytest.approx(gaps[-1], abs=1e-9)
    assert not check_steady_state(pushing(5, 20)[0], [[TRUE_Q]], [[TRUE_R]]).settles


def test_the_solver_reports_whiteness_and_counts_its_runs() -> None:
    problem = navopt.simulate("noise-tuning", 2, steps=2000)
    solution = navopt.solve(problem, "mehra")
    assert solution.counts.internal == 4
    assert isinstance(solution.estimate.white, bool)
    assert solution.scores["log10_q_error_1"] < 0.5
    holes = navopt.simulate("noise-tuning", 2, steps=300, missing_fraction=0.1)
    with pytest.raises(UnsuitableProblem, match="mehra needs all measurements"):
        navopt.solve(holes, "mehra")
