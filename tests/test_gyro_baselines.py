"""Calibrating baselines: exact without noise, at the Cramér-Rao bound with it, against scipy and numpy."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy import optimize, stats

import navopt
from baselines import Calibrated, ImuFit, NormLeastSquares, TriadFit
from navopt.errors import InvalidInput, UnknownName, UnsuitableProblem
from navopt.models import GyroTriad, ImuCalibration, earth_rate, fit_turntable, twenty_four_positions
from navopt.models.earth import EARTH_RATE
from navopt.models.triad import PARAMETER_NAMES
from navopt.problems import GyroCalibration
from navopt.problems.gyro_parameters import ALL_NAMES
from navopt.problems.gyro_worlds import PAPER_NOISE, PAPER_PRESET

LATITUDE = np.radians(45.75)
#: No noise in the data; what is declared is small, for it is the unit of the residuals.
CLEAN = {"noise": {"deg_sqrt_h": 1e-15}, "accelerometer_noise": {"ug_sqrt_hz": 1e-12}}


def world(seed=0, **options):
    return navopt.simulate("gyro-calibration", seed, **options)


def relative(found, true):
    """Largest error: of scale factors and biases relative to themselves, of misalignments in rad."""
    size = np.abs(true.copy())
    for start in range(0, len(size), 12):
        size[start + 6 : start + 12] = 1.0
    return np.abs((found - true) / size).max()


# -- without noise ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_the_turntable_recovers_all_twelve(seed):
    problem = world(seed, estimated="all", **CLEAN)
    solution = navopt.solve(problem, "turntable-ls")
    assert relative(solution.estimate.vector, problem.truth.vector) < 1e-9
    assert (solution.counts.internal, solution.counts.loss, solution.counts.cost) == (1, 1, 2)
    six = navopt.solve(problem, "six-position").estimate
    assert relative(six.vector, problem.truth.vector) < 1e-9


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("positions", [24, 48])
def test_norms_recover_their_nine(seed, positions):
    problem = world(seed, positions=positions, **CLEAN)
    solution = navopt.solve(problem, "norm-ls")
    assert relative(solution.estimate.vector, problem.truth.in_frame("lower-triangular").vector) < 1e-9
    # five or six residual vectors, where a swarm takes thousands
    assert solution.counts.residuals <= 8
    assert solution.counts.jacobians <= 8
    assert solution.counts.cost == 1 + solution.counts.residuals + 9 * solution.counts.jacobians


@pytest.mark.parametrize("frame", ["lower-triangular", "symmetric"])
def test_of_twelve_parameters_the_frame_is_fixed_by_convention(frame):
    problem = world(2, estimated="all", **CLEAN)
    found = navopt.solve(problem, NormLeastSquares(frame=frame)).estimate
    assert relative(found.vector, problem.truth.in_frame(frame).vector) < 1e-9


def test_held_at_the_preset_the_frame_is_the_presets():
    problem = world(2, estimated="all", **CLEAN)
    solution = navopt.solve(problem, NormLeastSquares(frame="preset"))
    found = solution.estimate
    upper = np.triu_indices(3, 1)
    np.testing.assert_array_equal(found.misalignment[upper], PAPER_PRESET.misalignment[upper])
    assert problem.score(found)["own_frame_rate_error_deg_h"] < 1e-8
    assert len(found.names) == 9
    assert solution.loss < 1e-7


@pytest.mark.parametrize("seed", range(3))
def test_with_accelerometers_21_of_24(seed):
    problem = world(seed, loss="invariants", **CLEAN)
    found = navopt.solve(problem, "norm-ls").estimate
    assert isinstance(found, ImuFit)
    assert len(found.names) == 21
    assert relative(found.vector, problem.truth.in_frame("lower-triangular").vector) < 1e-9
    whole = world(seed, loss="invariants", estimated="all", **CLEAN)
    turned = navopt.solve(whole, NormLeastSquares(frame="symmetric")).estimate
    assert relative(turned.vector, whole.truth.in_frame("symmetric").vector) < 1e-9
    assert problem.score(found)["relative_rotation_urad"] < 1e-3


# -- refusals --------------------------------------------------------------------------------------------


def test_what_cannot_be_told_is_refused_by_name():
    words = r"tell 3 of 12 parameters.*misalignment_xy - misalignment_yx: rotation of the gyro frame about z"
    with pytest.raises(UnsuitableProblem, match=words + r".*lower-triangular"):
        navopt.solve(world(estimated="all"), "norm-ls")
    with pytest.raises(UnsuitableProblem, match="cannot tell 3 of 6"):
        navopt.solve(world(estimated="misalignment"), "norm-ls")
    with pytest.raises(UnsuitableProblem, match="frame of the whole unit"):
        navopt.solve(world(estimated="all", loss="invariants"), "norm-ls")


def test_too_few_positions_are_refused_with_the_remedy():
    with pytest.raises(UnsuitableProblem, match=r"of 9 parameters.*add positions in other attitudes"):
        navopt.solve(world(positions=6), "norm-ls")
    still = np.repeat(twenty_four_positions()[:1], 30, axis=0)
    with pytest.raises(UnsuitableProblem, match=r"cannot tell 8 of 9.*add positions"):
        navopt.solve(world(positions=still), NormLeastSquares(frame="lower-triangular"))


def test_a_flat_turntable_record_is_refused_by_what_is_missing():
    rates = earth_rate(twenty_four_positions(), LATITUDE)
    flat = rates[np.abs(rates[:, 2]) < 0.1 * EARTH_RATE]
    with pytest.raises(InvalidInput, match=r"same combination of rates.*rate about z is constant"):
        fit_turntable(PAPER_PRESET.forward(flat), flat, 1.0)
    with pytest.raises(InvalidInput, match="at least four positions"):
        fit_turntable(PAPER_PRESET.forward(rates[:3]), rates[:3], 1.0)
    with pytest.raises(InvalidInput, match="gaps"):
        fit_turntable(np.full((24, 3), np.nan), rates, 1.0)
    scattered = world(turntable_positions=20)
    with pytest.raises(InvalidInput, match="no two differ in the rate about x alone"):
        navopt.solve(scattered, "six-position")
    # the same record serves least squares
    assert navopt.solve(scattered, "turntable-ls").scores["scale_error_ppm"] < 1000.0


def test_a_turntable_method_needs_a_record():
    bare = GyroCalibration(
        world().counts, latitude=LATITUDE, noise=PAPER_NOISE, fixed=PAPER_PRESET, estimated="all"
    )
    for name in ("turntable-ls", "six-position"):
        with pytest.raises(UnsuitableProblem, match="turntable_counts"):
            navopt.solve(bare, name)
    with pytest.raises(UnsuitableProblem, match="GyroCalibration"):
        navopt.solve(navopt.simulate("sphere", 0), "norm-ls")
    with pytest.raises(UnknownName, match="lower-triangular"):
        NormLeastSquares(frame="upper")


# -- against other people's least squares ----------------------------------------------------------------


@pytest.mark.parametrize("loss", ["indicator", "invariants"])
def test_norms_agree_with_scipy(loss):
    problem = world(4, loss=loss)
    size = problem.xu - problem.xl
    reference = optimize.least_squares(
        lambda u: problem.residuals(problem.nominal + size * u),
        np.zeros(problem.n_var),
        x_scale="jac", jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15,
    )  # fmt: skip
    found = navopt.solve(problem, "norm-ls")
    # a thousandth of the attainable accuracy
    sigma = np.sqrt(np.diag(problem.error_bound())) / size
    np.testing.assert_allclose((found.x - problem.nominal) / size, reference.x, atol=1e-3 * sigma.min())
    covariance = np.linalg.inv(reference.jac.T @ reference.jac) * np.outer(size, size)
    root = np.sqrt(np.diag(covariance))
    scaled = np.outer(root, root)
    np.testing.assert_allclose(found.estimate.covariance / scaled, covariance / scaled, atol=1e-4)
    assert found.estimate.misfit == pytest.approx(
        np.sqrt(2 * reference.cost / (len(reference.fun) - problem.n_var)), rel=1e-5
    )


def test_the_turntable_agrees_with_numpy_row_by_row():
    problem = world(4, turntable_rates_deg_s=(1.0, 10.0))
    design = np.c_[problem.turntable_rates, np.ones(len(problem.turntable_rates))]
    theta = np.linalg.lstsq(design, problem.turntable_counts, rcond=None)[0].T
    found = navopt.solve(problem, "turntable-ls").estimate
    np.testing.assert_allclose(found.matrix, theta[:, :3], rtol=1e-9, atol=1.0)
    np.testing.assert_allclose(found.scale * found.bias, theta[:, 3], rtol=1e-6)
    still = navopt.solve(problem, navopt.make_solver("turntable-ls", rows="positions")).estimate
    reference, _ = fit_turntable(
        problem.turntable_counts[:24], problem.turntable_rates[:24], problem.turntable_sigma
    )
    np.testing.assert_array_equal(still.vector, reference.vector)
    # fast rates bring the scale factors from 100 ppm to a hundredth of one
    assert found.sigma["scale_x"] < 1e-3 * still.sigma["scale_x"]


def test_the_turntable_covariance_is_that_of_the_problem():
    problem = world(4, estimated="all", loss="turntable")
    found = navopt.solve(problem, "turntable-ls")
    assert found.estimate.names == PARAMETER_NAMES
    bound = problem.error_bound(found.x)
    size = np.sqrt(np.diag(bound))
    # the problem whitens with the preset's scale factors, which are off by 5e-4
    np.testing.assert_allclose(
        found.estimate.covariance / np.outer(size, size), bound / np.outer(size, size), atol=5e-3
    )


def test_the_prior_takes_part():
    """Against the linear estimate at the solution of scipy with the prior's rows below."""
    problem = world(4, estimated="all", prior=True)
    found = navopt.solve(problem, "norm-ls")
    mean, covariance = problem.prior()
    root = np.sqrt(np.diag(covariance))
    reference = optimize.least_squares(
        lambda u: np.concatenate([problem.residuals(mean + root * u), u]),
        np.zeros(12), jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15,
    )  # fmt: skip
    np.testing.assert_allclose((found.estimate.vector - mean) / root, reference.x, atol=1e-6)
    # of a rotation the data say nothing: it stays where the preset has it, to second order
    turn = (found.estimate.vector - mean)[[6, 8]] @ [1.0, -1.0]
    assert abs(turn) < 0.02 * root[6]


# -- with noise ------------------------------------------------------------------------------------------


def errors_over_sigma(method, worlds):
    """Errors of each world over the attainable standard deviations, shape (worlds, parameters)."""
    rows = []
    for seed in range(worlds):
        if method == "turntable-ls":
            problem = world(seed, estimated="all", loss="turntable")
            true = problem.truth.vector
        else:
            problem = world(seed, loss="invariants" if method == "invariants" else "indicator")
            true = problem.truth.in_frame("lower-triangular").vector
        solution = navopt.solve(problem, "turntable-ls" if method == "turntable-ls" else "norm-ls")
        bound = np.sqrt(np.diag(problem.error_bound()))
        assert len(bound) == len(solution.estimate.names)
        places = [ALL_NAMES.index(name) for name in problem.parameter_names]
        rows.append((solution.estimate.vector - true)[places] / bound)
    return np.array(rows)


def check_efficiency(method, worlds, level, slack):
    normalised = errors_over_sigma(method, worlds)
    k = normalised.shape[1]
    mean = normalised.mean(axis=0) * np.sqrt(worlds)
    assert np.abs(mean).max() < stats.norm.isf(level / k / 2)
    variance = normalised.var(axis=0, ddof=1)
    low, high = stats.chi2.ppf([level / k / 2, 1 - level / k / 2], worlds - 1) / (worlds - 1)
    assert low < variance.min()
    assert variance.max() < high
    assert np.abs(variance - 1.0).max() < slack
    return mean, variance


@pytest.mark.parametrize("method", ["turntable-ls", "norm-ls", "invariants"])
def test_unbiased_and_at_the_cramer_rao_bound(method):
    """One band of 0.001 over three methods, two statistics and all parameters."""
    check_efficiency(method, 120, 0.001 / 6, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["turntable-ls", "norm-ls", "invariants"])
def test_unbiased_and_within_a_fifth_of_the_bound_over_a_thousand_worlds(method):
    mean, variance = check_efficiency(method, 1000, 0.001 / 6, 0.2)
    print(
        f"{method}: means within {np.abs(mean).max():.2f} sigma,",
        variance.min(),
        "<= variance <=",
        variance.max(),
    )


def test_the_six_positions_cost_accuracy():
    """Against the closed form: of the 24 only six are used, of each pair half the difference."""
    problem = world(0)
    solvers = ("six-position", "turntable-ls")
    six, all_of_them = (navopt.solve(problem, name).estimate.sigma for name in solvers)
    up = 2.0 * EARTH_RATE * np.sin(LATITUDE)
    expected = np.sqrt(2.0) * problem.turntable_sigma / up
    assert six["scale_x"] / problem.truth.scale[0] == pytest.approx(expected, rel=2e-3)
    assert six["bias_x"] > 1.9 * all_of_them["bias_x"]


def test_six_position_errors_have_their_covariance():
    rows = []
    for seed in range(200):
        problem = world(seed, noise={"deg_sqrt_h": 0.0005})
        found = navopt.solve(problem, "six-position").estimate
        rows.append((found.vector - problem.truth.vector) / list(found.sigma.values()))
    low, high = stats.chi2.ppf([0.001 / 24, 1 - 0.001 / 24], 200)
    squares = np.sum(np.square(rows), axis=0)
    assert low < squares.min()
    assert squares.max() < high


# -- what is attached ------------------------------------------------------------------------------------


def test_the_solution_carries_the_fit(tmp_path):
    problem = world(1, estimated="all")
    for solver in ("turntable-ls", "six-position", NormLeastSquares(frame="symmetric")):
        solution = navopt.solve(problem, solver)
        assert isinstance(solution.estimate, TriadFit)
        np.testing.assert_array_equal(solution.x, problem.project(solution.estimate))
        assert solution.loss == float(problem.loss(solution.x))
        assert isinstance(solution.fitted, Calibrated)
        twin = problem.redraw(5)
        applied = pickle.loads(pickle.dumps(solution.fitted)).apply(twin)
        assert isinstance(applied, GyroTriad)
        assert solution.apply(twin) == problem.score(solution.estimate)
        solution.save(tmp_path / "run")
        again = navopt.Solution.load(tmp_path / "run")
        np.testing.assert_array_equal(again.estimate.covariance, solution.estimate.covariance)
        assert again.estimate.sigma == solution.estimate.sigma
        assert again.apply(twin) == solution.apply(twin)
    unit = world(1, loss="invariants")
    solution = navopt.solve(unit, "norm-ls")
    solution.save(tmp_path / "unit")
    again = navopt.Solution.load(tmp_path / "unit")
    np.testing.assert_array_equal(again.estimate.vector, solution.estimate.vector)
    assert isinstance(again.fitted.apply(unit), ImuCalibration)
    # a table calibrates the gyros of such a unit
    assert "scale_error_ppm" in navopt.solve(unit, "turntable-ls").scores


def test_a_convention_turns_the_covariance_along():
    """Against the spread of the answers over worlds' noise, for the one sum that has no convention."""
    problem = world(1, estimated="all")
    plain, turned = (
        navopt.solve(problem, NormLeastSquares(frame=f)).estimate for f in ("preset", "symmetric")
    )
    assert (len(plain.names), len(turned.names)) == (9, 12)
    # the sum of opposite elements does not depend on the frame; the difference is fixed
    weights = np.zeros(12)
    weights[[6, 8]] = 1.0
    expected = plain.covariance[plain.names.index("misalignment_yx")][plain.names.index("misalignment_yx")]
    assert weights @ turned.covariance @ weights == pytest.approx(expected, rel=1e-2)
    weights[8] = -1.0
    assert weights @ turned.covariance @ weights < 1e-6 * expected


@pytest.mark.parametrize("budget", [1, 2, 10, 11, 12, 25])
def test_a_budget_is_kept_and_spent_exactly_as_counted(budget):
    problem = world(1)
    solution = navopt.solve(problem, "norm-ls", budget=budget)
    counts = solution.counts
    assert counts.cost <= budget
    assert counts.cost == counts.loss + counts.residuals + 9 * counts.jacobians
    if budget < 11:
        np.testing.assert_array_equal(solution.x, problem.nominal)
    assert np.isfinite(solution.loss)
