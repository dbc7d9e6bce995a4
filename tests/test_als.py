"""Autocovariance least squares: the matrix identity, the weights, and what the estimates are worth."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
from noise_tools import TRUE_Q, TRUE_R, covariance, pushing
from scipy.linalg import solve_discrete_lyapunov
from scipy.stats import norm

import navopt
from baselines.als_fit import fit_autocovariances
from baselines.als_matrices import (
    ErrorDynamics,
    als_matrices,
    autocovariance,
    duplication,
    fixed_gain_innovations,
    uniqueness,
)
from baselines.constant_model import steady
from baselines.noise_structure import NoiseStructure
from navopt.errors import InvalidInput, UnsuitableProblem
from navopt.models.linear_gaussian import LinearGaussianModel

PUSHING = NoiseStructure.of("scalar", [[10.0]], [[1.0]])


def dynamics(seed: int, n: int = 3, m: int = 2, g: int = 2) -> ErrorDynamics:
    rng = np.random.default_rng(np.random.SeedSequence([431, seed]))
    A = rng.standard_normal((n, n))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    C, G, L = rng.standard_normal((m, n)), rng.standard_normal((n, g)), 0.3 * rng.standard_normal((n, m))
    while np.abs(np.linalg.eigvals(A - A @ L @ C)).max() > 0.98:
        L = 0.7 * L
    return ErrorDynamics(A, C, G, L)


# -- the identity ---------------------------------------------------------------------------------
@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 1, 1), (3, 2, 2), (4, 3, 4)])
@pytest.mark.parametrize("seed", range(5))
def test_matrix_identity(seed: int, shape: tuple[int, int, int]) -> None:
    one = dynamics(seed, *shape)
    Q, R = covariance(seed, shape[2]), covariance(seed + 50, shape[1])
    # covariances from the Lyapunov equation and the recursion over lags, not from the Kronecker form
    A_bar, AL = one.A @ (np.eye(shape[0]) - one.L @ one.C), one.A @ one.L
    S = solve_discrete_lyapunov(A_bar, one.G @ Q @ one.G.T + AL @ R @ AL.T)
    cross, lags = A_bar @ S @ one.C.T - AL @ R, [one.C @ S @ one.C.T + R]
    for _ in range(1, 8):
        lags.append(one.C @ cross)
        cross = A_bar @ cross
    M_Q, M_R = als_matrices(one, 8)
    ours = M_Q @ Q.ravel(order="F") + M_R @ R.ravel(order="F")
    theirs = np.concatenate(lags).ravel(order="F")
    np.testing.assert_allclose(ours, theirs, atol=1e-10 * np.abs(theirs).max())


def test_duplication_makes_a_vec_of_a_lower_triangle() -> None:
    M = covariance(3, 4)
    np.testing.assert_array_equal(duplication(4) @ M[np.tril_indices(4)], M.ravel(order="F"))


def test_innovations_are_those_of_a_loop() -> None:
    one = dynamics(4)
    rng = np.random.default_rng(1)
    y, drive, x = rng.standard_normal((20, 2)), rng.standard_normal((20, 3)), rng.standard_normal(3)
    ours = fixed_gain_innovations(one, y, drive, x)
    for k in range(20):
        e = y[k] - one.C @ x
        np.testing.assert_allclose(ours[k], e, atol=1e-12)
        x = one.A @ (x + one.L @ e) + drive[k]


def test_autocovariances_are_numpys() -> None:
    e = np.random.default_rng(2).standard_normal((50, 2))
    C = autocovariance(e, 4)
    for j in range(4):
        for a in range(2):
            for b in range(2):
                full = np.correlate(e[:, a], e[:, b], "full")[49 + j]
                assert C[j, a, b] == pytest.approx(full / (50 - j), rel=1e-12)


# -- uniqueness -----------------------------------------------------------------------------------
def test_uniqueness_of_known_cases() -> None:
    # one measurement of a chain: a full Q has more unknowns than the innovations have to say
    A = np.array([[0.9, 0.2, 0.0], [0.0, 0.8, 0.3], [0.0, 0.0, 0.7]])
    C, L = np.array([[1.0, 0.0, 0.0]]), np.full((3, 1), 0.1)
    assert uniqueness(ErrorDynamics(A, C, np.eye(3), L)) == (3, 6)
    assert uniqueness(ErrorDynamics(A, C, np.eye(3)[:, :1], L)) == (1, 1)
    assert uniqueness(ErrorDynamics(A, np.eye(3), np.eye(3), 0.1 * np.eye(3))) == (6, 6)


def test_an_undetermined_Q_is_refused_or_found_with_least_trace() -> None:
    rng = np.random.default_rng(5)
    A = np.array([[0.9, 0.2, 0.0], [0.0, 0.8, 0.3], [0.0, 0.0, 0.7]])
    x, y = np.zeros(3), []
    for _ in range(1500):
        y.append(x[0] + 0.5 * rng.standard_normal())
        x = A @ x + rng.standard_normal(3)
    model = LinearGaussianModel(F=A, H=[[1.0, 0.0, 0.0]], y=y, P0=np.eye(3))
    which = NoiseStructure.of(("full", "diagonal"), np.eye(3), [[1.0]])
    with pytest.raises(InvalidInput, match="Q: got 6 unknowns of which the innovations determine 3"):
        fit_autocovariances(model, which)
    fit = fit_autocovariances(model, which, trace_weight=1.0)
    assert not fit.unique
    assert np.linalg.eigvalsh(fit.Q)[0] > -1e-9
    # a larger weight can only make the trace smaller
    assert np.trace(fit_autocovariances(model, which, trace_weight=100.0, passes=1).Q) <= (
        np.trace(fit_autocovariances(model, which, trace_weight=1.0, passes=1).Q) + 1e-6
    )


# -- the fit --------------------------------------------------------------------------------------
def test_where_no_constraint_is_active_it_is_weighted_least_squares() -> None:
    model, _ = pushing(1, 3000)
    fit = fit_autocovariances(model, PUSHING, passes=1, weighting="identity")
    P, gain = steady(model, [[10.0]], [[1.0]])
    one = ErrorDynamics(model.F, model.H, model.G, gain)
    e = fixed_gain_innovations(one, model.y, model.drive, model.x0)[100:]
    M_Q, M_R = als_matrices(one, 15)
    answer = np.linalg.lstsq(np.hstack([M_Q, M_R]), autocovariance(e, 15).ravel(), rcond=None)[0]
    np.testing.assert_allclose([fit.Q[0, 0], fit.R[0, 0]], answer, rtol=1e-4)
    assert np.linalg.eigvals(one.closed).size == len(P)


@pytest.mark.parametrize("solver", ["CLARABEL", "SCS"])
def test_units_do_not_matter(solver: str) -> None:
    """Metres or nanometres: a Q of 1e-18 would be zero to a solver without scaling."""
    model, _ = pushing(2, 2000)
    small = 1e-9
    tiny = model.replaced(y=model.y * small, B=model.B * small, P0=model.P0 * small**2, G=model.G)
    plain = fit_autocovariances(model, PUSHING, solver=solver)
    scaled = fit_autocovariances(
        tiny, NoiseStructure.of("scalar", [[10.0 * small**2]], [[small**2]]), solver=solver
    )
    np.testing.assert_allclose(scaled.Q / small**2, plain.Q, rtol=1e-3)
    np.testing.assert_allclose(scaled.R / small**2, plain.R, rtol=1e-3)
    assert scaled.solver == solver
    assert solver in cp.installed_solvers()


def test_full_covariances_of_two_channels() -> None:
    rng = np.random.default_rng(7)
    Q, R = np.array([[1.0, 0.6], [0.6, 0.8]]), np.array([[0.5, -0.3], [-0.3, 0.6]])
    w, v = (rng.multivariate_normal(np.zeros(2), M, size=10_000) for M in (Q, R))
    A, x = np.array([[0.8, 0.1], [0.0, 0.7]]), np.zeros((10_000, 2))
    for k in range(9_999):
        x[k + 1] = A @ x[k] + w[k]
    model = LinearGaussianModel(F=A, H=np.eye(2), y=x + v, P0=np.eye(2))
    fit = fit_autocovariances(model, NoiseStructure.of("full", np.eye(2), np.eye(2)))
    assert fit.unique
    np.testing.assert_allclose(fit.Q, Q, atol=0.12)
    np.testing.assert_allclose(fit.R, R, atol=0.12)


def test_a_negative_estimate_is_not_possible() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        model = LinearGaussianModel(F=[[0.5]], H=[[1.0]], y=rng.standard_normal(400), P0=[[1.0]])
        fit = fit_autocovariances(model, NoiseStructure.of("scalar", [[1.0]], [[1.0]]))
        assert fit.Q[0, 0] >= 0.0
        assert fit.R[0, 0] >= 0.0


def als_package_example(seed: int) -> LinearGaussianModel:
    """The file ``motivating_example.m`` of the ALS package for Octave (Odelson, Rajamani, Rawlings).

    Q = 0.5 and R = 0.1 are behind 1000 measurements of one combination of three states; the filter begins
    with 0.4 Q and 4 R, 15 lags, 100 points left out. The file prints no numbers; it draws the estimates of
    200 runs around the true values.
    """
    rng = np.random.default_rng(np.random.SeedSequence([433, seed]))
    A = np.diag([0.1, 0.2, 0.3])
    A[0, 2] = 0.1
    G, C, x, y = np.array([1.0, 2.0, 3.0]), np.array([[0.1, 0.2, 0.0]]), np.full(3, 10.0), []
    for _ in range(1000):
        y.append(C @ x + np.sqrt(0.1) * rng.standard_normal())
        x = A @ x + G * np.sqrt(0.5) * rng.standard_normal()
    return LinearGaussianModel(F=A, H=C, y=y, G=G[:, None], x0=np.full(3, 10.0), P0=np.eye(3))


@pytest.mark.parametrize("weighting", ["white", "identity"])
def test_example_of_the_als_package(weighting: str) -> None:
    which = NoiseStructure.of("scalar", [[0.4 * 0.5]], [[4 * 0.1]])
    found = []
    for seed in range(20):
        fit = fit_autocovariances(als_package_example(seed), which, lags=15, passes=1, weighting=weighting)
        found.append([fit.Q[0, 0], fit.R[0, 0]])
    means, errors = np.mean(found, axis=0), np.std(found, axis=0, ddof=1) / np.sqrt(len(found))
    assert (np.abs(means - [0.5, 0.1]) < norm.isf(0.001 / 8) * errors).all()
    # the errors themselves are small enough for this to mean something
    assert (errors < [0.05, 0.0125]).all()


def test_small_sample_of_worlds_is_unbiased() -> None:
    fits = [fit_autocovariances(pushing(k, 2000)[0], PUSHING) for k in range(24)]
    for name, truth in (("Q", TRUE_Q), ("R", TRUE_R)):
        values = np.array([getattr(fit, name)[0, 0] for fit in fits])
        limit = norm.isf(0.001 / 4) * values.std(ddof=1) / np.sqrt(len(values))
        assert abs(values.mean() - truth) < limit, name
    # what is left is what sampling leaves
    assert np.median([fit.misfit for fit in fits]) == pytest.approx(1.0, abs=0.35)


def test_a_known_R_is_not_touched() -> None:
    model, _ = pushing(3, 3000)
    which = NoiseStructure.of(("scalar", "fixed"), [[10.0]], [[TRUE_R]])
    fit = fit_autocovariances(model, which)
    assert fit.R.tolist() == [[TRUE_R]]
    assert fit.Q[0, 0] == pytest.approx(TRUE_Q, rel=0.4)


def test_the_solver_counts_its_filter_runs_and_scores_on_held_out_data() -> None:
    problem = navopt.simulate("noise-tuning", 1, steps=600)
    solution = navopt.solve(problem, navopt.make_solver("als", passes=3))
    assert solution.counts.internal == 3
    assert solution.estimate.determined
    assert solution.apply(problem.redraw(3))["state_rmse_ratio_1"] < 1.2
    assert navopt.solve(problem, "als", budget=2).counts.cost == 2


# -- bad input ------------------------------------------------------------------------------------
def test_models_it_cannot_take_are_refused() -> None:
    model, _ = pushing(0, 400)
    y = np.array(model.y)
    y[7, 0] = np.nan
    with pytest.raises(UnsuitableProblem, match=r"als needs all measurements: y\[7, 0\] is missing"):
        fit_autocovariances(model.replaced(y=y), PUSHING)
    with pytest.raises(UnsuitableProblem, match="als needs a constant model: F has shape"):
        fit_autocovariances(model.replaced(F=np.stack([model.F] * 400)), PUSHING)
    with pytest.raises(InvalidInput, match=r"y: got 120 steps"):
        fit_autocovariances(pushing(0, 120)[0], PUSHING, burn_in=100)
    with pytest.raises(InvalidInput, match="spectral radius"):
        ErrorDynamics(model.F, model.H, model.G, np.zeros((2, 1)))
    with pytest.raises(InvalidInput, match=r"weighting: .*identity"):
        fit_autocovariances(model, PUSHING, weighting="some")
    with pytest.raises(InvalidInput, match=r"solver: .*CLARABEL"):
        fit_autocovariances(model, PUSHING, solver="MOSEK")
    with pytest.raises(InvalidInput, match="lags: got 60"):
        autocovariance(np.zeros((60, 1)), 60)


@pytest.mark.slow
def test_two_hundred_worlds_of_ten_thousand_steps() -> None:
    fits = [fit_autocovariances(pushing(k, 10_000)[0], PUSHING) for k in range(200)]
    for name, truth in (("Q", TRUE_Q), ("R", TRUE_R)):
        values = np.array([getattr(fit, name)[0, 0] for fit in fits])
        error = values.std(ddof=1) / np.sqrt(len(values))
        print(f"{name}: {values.mean():.5f} ± {error:.5f} for {truth}; sigma {values.std(ddof=1):.4f}")
        assert abs(values.mean() - truth) < norm.isf(0.001 / 4) * error
