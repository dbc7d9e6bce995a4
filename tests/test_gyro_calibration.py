"""GyroCalibration: losses against plain formulas, slopes, noise laws, worlds, scores, bad records."""

from __future__ import annotations

import pickle
from functools import lru_cache

import numpy as np
import pytest
from scipy import stats

import navopt
from navopt.errors import InvalidInput, NoBound, UnknownName
from navopt.models import (
    AccelerometerNoise,
    GyroNoise,
    GyroTriad,
    ImuCalibration,
    earth_rate,
    fit_turntable,
    residual_error,
    scattered_positions,
    specific_force,
    twenty_four_positions,
)
from navopt.models.earth import EARTH_RATE, normal_gravity
from navopt.models.triad import DEGREE_PER_HOUR, PARAMETER_NAMES, AccelerometerTriad
from navopt.problems import GyroCalibration
from navopt.problems.gyro_checks import rate_unit
from navopt.problems.gyro_worlds import PAPER_NOISE, PAPER_PRESET

LATITUDE = np.radians(45.75)
LEVEL = 0.001 / 8  # eight statistical checks in this file
LOSSES = ("indicator", "corrected", "turntable", "invariants")


@lru_cache
def world(loss, estimated="all", seed=0, **options):
    return navopt.simulate("gyro-calibration", seed, loss=loss, estimated=estimated, **options)


def candidates(problem, n, seed=0):
    return problem.xl + np.random.default_rng(seed).random((n, problem.n_var)) * (problem.xu - problem.xl)


def triads(problem, x):
    """Inverse of both triads by matrix algebra, from the names alone."""
    values = dict(zip(problem.parameter_names, x, strict=True))
    out = []
    for prefix in ("", "accelerometer_"):
        e, k, b = np.eye(3), np.ones(3), np.zeros(3)
        for name, value in values.items():
            if name.startswith("accelerometer_") != bool(prefix):
                continue
            kind, axes = name.removeprefix(prefix).split("_")
            if kind == "misalignment":
                e["xyz".index(axes[0]), "xyz".index(axes[1])] = value
            else:
                (k if kind == "scale" else b)["xyz".index(axes)] = value
        out.append((k, e, b))
    return out


def invert(triad, counts):
    scale, misalignment, bias = triad
    return np.linalg.solve(misalignment, (counts / scale - bias).T).T


# -- losses ----------------------------------------------------------------------------------------------


def test_the_indicator_is_equation_14():
    problem = world("indicator")
    for x in candidates(problem, 20):
        rates = invert(triads(problem, x)[0], problem.counts) / DEGREE_PER_HOUR
        excess = np.sum(rates**2, axis=1) - (EARTH_RATE / DEGREE_PER_HOUR) ** 2
        expected = np.sqrt(np.sum(excess**2) / (len(excess) - 1))
        assert problem.loss(x) == pytest.approx(expected, rel=1e-9)
    assert pytest.approx(15.0411, abs=1e-4) == EARTH_RATE / DEGREE_PER_HOUR


def test_the_corrected_form_takes_out_the_noise():
    problem, plain = world("corrected"), world("indicator")
    e = problem.preset.misalignment
    noise = problem.sigma**2 * np.trace(np.linalg.inv(e @ e.T))
    for x in candidates(problem, 10):
        excess = np.sum(invert(triads(problem, x)[0], problem.counts) ** 2, axis=1) - EARTH_RATE**2
        expected = np.sqrt(np.sum((excess - noise) ** 2) / 23) / DEGREE_PER_HOUR**2
        assert problem.loss(x) == pytest.approx(expected, rel=1e-9)
    np.testing.assert_array_equal(problem.residuals(x), plain.residuals(x))


def test_the_turntable_loss_is_the_misfit_of_equation_11():
    problem = world("turntable", turntable_rates_deg_s=(1.0,))
    assert len(problem.turntable_counts) == 30
    for x in candidates(problem, 10):
        scale, misalignment, bias = triads(problem, x)[0]
        modelled = scale * (problem.turntable_rates @ misalignment.T + bias)
        misfit = (problem.turntable_counts - modelled) / PAPER_PRESET.scale / DEGREE_PER_HOUR
        assert problem.loss(x) == pytest.approx(np.sqrt(np.mean(misfit**2)), rel=1e-9)


def test_invariants_are_norms_and_the_angle():
    problem = world("invariants")
    gravity = float(normal_gravity(LATITUDE))
    expected = [EARTH_RATE**2, gravity**2, EARTH_RATE * gravity * np.sin(LATITUDE)]
    noise = np.array([problem.sigma, problem.accelerometer_sigma]) ** 2
    e = problem.preset.gyro.misalignment
    shift = [noise[0] * np.trace(np.linalg.inv(e @ e.T)), 3 * noise[1], 0.0]
    for x in candidates(problem, 10):
        gyro, accelerometer = triads(problem, x)
        rates, forces = invert(gyro, problem.counts), invert(accelerometer, problem.accelerometer_counts)
        three = np.stack(
            [np.sum(a * b, axis=1) for a, b in ((rates, rates), (forces, forces), (rates, forces))]
        )
        plain = three - np.array(expected)[:, None] - np.array(shift)[:, None]
        whitened = (problem._misfit.whitening @ plain).T.ravel()
        np.testing.assert_allclose(problem.residuals(x), whitened, rtol=1e-6, atol=1e-6)
        assert problem.loss(x) == pytest.approx(np.sqrt(np.mean(whitened**2)), rel=1e-7)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("estimated", ["all", None, ["bias", "scale_y", "misalignment_zx"]])
def test_slopes_are_derivatives(loss, estimated):
    problem = navopt.simulate("gyro-calibration", 1, loss=loss, estimated=estimated)
    X = candidates(problem, 8, seed=2)
    step = 1e-4 * (problem.xu - problem.xl)
    numeric = np.stack(
        [
            (problem.residuals(X + step * u) - problem.residuals(X - step * u)) / (2 * step @ u)
            for u in np.eye(problem.n_var)
        ],
        axis=-1,
    )
    size = np.abs(numeric).max(axis=(0, 1))
    np.testing.assert_allclose(problem.jacobian(X) / size, numeric / size, atol=1e-6)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("positions", [23, 24])
def test_a_loss_has_the_same_bits_alone_and_in_a_batch(loss, positions):
    problem = navopt.simulate("gyro-calibration", 0, loss=loss, estimated="all", positions=positions)
    X = candidates(problem, 101)
    whole, residuals, jacobian = problem.loss(X), problem.residuals(X), problem.jacobian(X)
    for k in range(0, 101, 7):
        assert problem.loss(X[k]) == whole[k]
        np.testing.assert_array_equal(problem.residuals(X[k]), residuals[k])
        np.testing.assert_array_equal(problem.jacobian(X[k]), jacobian[k])
    order = np.random.default_rng(1).permutation(101)
    np.testing.assert_array_equal(problem.loss(X[order]), whole[order])
    np.testing.assert_array_equal(problem.loss(np.asfortranarray(X)), whole)


@pytest.mark.parametrize("loss", ["indicator", "corrected", "invariants"])
def test_a_candidate_without_inverse_is_infinite_with_a_reason(loss):
    problem = navopt.simulate("gyro-calibration", 0, loss=loss, estimated="all")
    flat, dead = problem.nominal, problem.nominal
    flat[[6, 8]] = 1.0  # x and y measure the same, whatever z does
    flat[[7, 9]] = flat[7]
    dead[1] = 0.0
    X = np.stack([flat, problem.nominal, dead])
    assert np.isfinite(problem.loss(X)).tolist() == [False, True, False]
    assert "no inverse" in problem.invalid_reasons(X[:1])[0]
    assert not np.isfinite(problem.residuals(flat)).any()
    accelerometers = problem.nominal
    if loss == "invariants":
        accelerometers[12] = 0.0
        assert problem.loss(accelerometers) == np.inf


def test_no_loss_sees_the_truth():
    for loss in LOSSES:
        problem = world(loss)
        options = {
            "latitude": problem.latitude,
            "noise": problem.noise,
            "averaging_time_s": problem.averaging_time_s,
            "fixed": PAPER_PRESET,
            "estimated": "all",
            "loss": loss,
            "turntable_counts": problem.turntable_counts,
            "turntable_rates": problem.turntable_rates,
        }
        if loss == "invariants":
            options["accelerometer_counts"] = problem.accelerometer_counts
            options["accelerometer_noise"] = problem.accelerometer_noise
            options["fixed_accelerometer"] = problem.preset.accelerometer
        blind = GyroCalibration(problem.counts, **options)
        assert blind.truth is None
        X = candidates(problem, 20)
        np.testing.assert_array_equal(blind.loss(X), problem.loss(X))
        with pytest.raises(navopt.errors.NoTruth):
            blind.score(blind.estimate(X[0]))


# -- noise -----------------------------------------------------------------------------------------------


def at_the_truth(loss, worlds, **options):
    problems = [
        navopt.simulate("gyro-calibration", s, loss=loss, estimated="all", **options) for s in range(worlds)
    ]
    return np.concatenate([p.residuals(p.true_x) for p in problems])


@pytest.mark.parametrize("loss", ["corrected", "turntable", "invariants"])
def test_residuals_at_the_truth_are_white(loss):
    residuals = at_the_truth(loss, 40)
    n = len(residuals)
    assert abs(residuals.mean()) * np.sqrt(n) < stats.norm.isf(LEVEL / 2)
    low, high = stats.chi2.ppf([LEVEL / 2, 1 - LEVEL / 2], n)
    assert low < np.sum(residuals**2) < high


def test_the_three_invariants_of_a_position_are_uncorrelated():
    three = at_the_truth("invariants", 60).reshape(-1, 3)
    correlation = np.corrcoef(three.T)[np.triu_indices(3, 1)]
    assert np.abs(correlation).max() * np.sqrt(len(three)) < stats.norm.isf(LEVEL / 6)


def test_noise_makes_uncorrected_norms_too_large():
    """By three variances: visible with noise of a third of the Earth rate."""
    loud = {"noise": {"deg_sqrt_h": 1.2}}
    residuals = at_the_truth("corrected", 40, **loud)
    assert abs(residuals.mean()) * np.sqrt(len(residuals)) < stats.norm.isf(LEVEL / 2)
    problem = navopt.simulate("gyro-calibration", 0, estimated="all", **loud)
    excess = 3.0 * problem.sigma**2 / np.sqrt(4 * EARTH_RATE**2 * problem.sigma**2 + 6 * problem.sigma**4)
    # without the correction the mean would be far outside the same band
    assert (residuals.mean() + excess) * np.sqrt(len(residuals)) > 2 * stats.norm.isf(LEVEL / 2)


def test_the_bound_of_the_turntable_is_the_closed_form():
    """Perfect gyros: sigma(bias) = sigma/sqrt(24), sigma(scale)/scale = sigma(E) = sigma/(Omega sqrt 8)."""
    perfect = PAPER_PRESET.replace(misalignment=np.eye(3), bias=np.zeros(3))
    rates = earth_rate(twenty_four_positions(), LATITUDE)
    problem = GyroCalibration(
        perfect.forward(rates), latitude=LATITUDE, noise=PAPER_NOISE, fixed=perfect, estimated="all",
        loss="turntable", turntable_counts=perfect.forward(rates), turntable_rates=rates, truth=perfect,
    )  # fmt: skip
    sigma = np.sqrt(np.diag(problem.error_bound()))
    noise = PAPER_NOISE.averaged_sigma(300.0)
    np.testing.assert_allclose(sigma[:3] / perfect.scale, noise / (EARTH_RATE * np.sqrt(8)), rtol=1e-6)
    np.testing.assert_allclose(sigma[3:6], noise / np.sqrt(24), rtol=1e-6)
    np.testing.assert_allclose(sigma[6:], noise / (EARTH_RATE * np.sqrt(8)), rtol=1e-6)
    # 124 ppm: what positions alone can give, whatever is printed
    assert 1e6 * sigma[0] / perfect.scale[0] == pytest.approx(124.4, abs=0.1)


def test_a_bound_needs_what_can_be_told():
    assert np.isfinite(world("indicator", "frame").error_bound()).all()
    with pytest.raises(NoBound, match="not every parameter"):
        world("indicator", "all").error_bound()
    prior = navopt.simulate("gyro-calibration", 0, estimated="all", prior=True)
    assert "prior" in prior.provides
    mean, covariance = prior.prior()
    np.testing.assert_array_equal(mean, prior.nominal)
    # about the rotations the data say nothing: the prior stays
    combination = np.zeros(12)
    combination[[6, 8]] = [1.0, -1.0]
    bound = prior.error_bound()
    assert combination @ bound @ combination == pytest.approx(
        combination @ covariance @ combination, rel=1e-3
    )
    assert bound[0, 0] < 0.9 * covariance[0, 0]


# -- worlds ----------------------------------------------------------------------------------------------


def test_a_seed_fixes_the_sensors_and_redrawing_keeps_them():
    one, again, other = (navopt.simulate("gyro-calibration", s, positions=48) for s in (3, 3, 4))
    np.testing.assert_array_equal(one.counts, again.counts)
    assert not np.array_equal(one.truth.vector, other.truth.vector)
    twin = one.redraw(9)
    np.testing.assert_array_equal(twin.truth.vector, one.truth.vector)
    np.testing.assert_array_equal(twin.attitudes, one.attitudes)
    np.testing.assert_array_equal(twin.nominal, one.nominal)
    assert not np.isclose(twin.counts, one.counts, rtol=1e-12).any()
    assert not np.isclose(twin.turntable_counts, one.turntable_counts, rtol=1e-12).any()
    with pytest.raises(navopt.errors.UnsuitableProblem, match="recorded"):
        pickle.loads(pickle.dumps(known_positions())).redraw(1)


def known_positions(**options):
    attitudes = twenty_four_positions()
    return GyroCalibration(
        PAPER_PRESET.forward(earth_rate(attitudes, LATITUDE)),
        **{"latitude": LATITUDE, "noise": PAPER_NOISE, "fixed": PAPER_PRESET, **options},
    )


def test_protocols():
    fair, paper, easy = (
        navopt.simulate("gyro-calibration", 5, estimated="scale", protocol=p)
        for p in ("random", "paper", "known")
    )
    np.testing.assert_array_equal(fair.nominal, PAPER_PRESET.scale)
    np.testing.assert_array_equal(paper.truth.vector, fair.truth.vector)
    fit, _ = fit_turntable(paper.turntable_counts, paper.turntable_rates, paper.turntable_sigma)
    np.testing.assert_allclose(paper.preset.vector, fit.vector)
    twin = paper.redraw(1)
    np.testing.assert_array_equal(twin.preset.vector, paper.preset.vector)
    # no vector of scale factors made the data unless the rest is known rightly
    assert fair.true_x is None
    np.testing.assert_array_equal(easy.truth.vector[3:], PAPER_PRESET.vector[3:])
    np.testing.assert_array_equal(easy.true_x, easy.truth.scale)


def test_the_truth_is_uniform_about_the_preset():
    drawn = np.array([navopt.simulate("gyro-calibration", s, positions=6).truth.vector for s in range(60)])
    off = drawn - PAPER_PRESET.vector
    half = np.concatenate([5e-4 * PAPER_PRESET.scale, np.full(3, 0.05 * DEGREE_PER_HOUR), np.full(6, 5e-4)])
    assert stats.kstest((off / half).ravel(), stats.uniform(-1, 2).cdf).pvalue > LEVEL


def test_scale_factors_change_from_table_to_field_by_their_stability():
    steady = {"noise": {"deg_sqrt_h": 1e-9, "ppm": 10.0}, "estimated": "all"}
    change = []
    for seed in range(60):
        problem = navopt.simulate("gyro-calibration", seed, **steady)
        fit, _ = fit_turntable(problem.turntable_counts, problem.turntable_rates, 1.0)
        change.append(1e6 * (fit.scale / problem.truth.scale - 1.0))
    low, high = stats.chi2.ppf([LEVEL / 2, 1 - LEVEL / 2], 180)
    assert low < np.sum(np.square(change)) / 100.0 < high
    table = navopt.simulate("gyro-calibration", 0, loss="turntable", **steady)
    fit, _ = fit_turntable(table.turntable_counts, table.turntable_rates, 1.0)
    np.testing.assert_allclose(fit.scale, table.truth.scale, rtol=1e-7)


def test_positions_and_noise_as_asked():
    problem = navopt.simulate("gyro-calibration", 0, positions=24, placement="scattered")
    np.testing.assert_array_equal(problem.attitudes, scattered_positions(24, 0))
    np.testing.assert_array_equal(
        navopt.simulate("gyro-calibration", 0, positions=24).attitudes, twenty_four_positions()
    )
    mine = navopt.simulate(
        "gyro-calibration", 0, noise=GyroNoise.from_datasheet(0.001), averaging_time_s=900.0
    )
    assert mine.sigma / DEGREE_PER_HOUR == pytest.approx(0.002)
    assert world("indicator").sigma == pytest.approx(PAPER_NOISE.averaged_sigma(300.0))


# -- estimates and scores --------------------------------------------------------------------------------


@pytest.mark.parametrize("loss", LOSSES)
def test_projection_undoes_the_estimate(loss):
    for estimated in ("all", None, ["scale", "misalignment_yx"]):
        problem = navopt.simulate("gyro-calibration", 0, loss=loss, estimated=estimated)
        for x in candidates(problem, 10):
            np.testing.assert_allclose(problem.project(problem.estimate(x)), x, rtol=1e-12, atol=1e-18)


def test_only_what_is_estimated_changes():
    problem = navopt.simulate("gyro-calibration", 0, estimated=["bias", "scale_x"])
    assert problem.parameter_names == ("scale_x", "bias_x", "bias_y", "bias_z")
    assert problem.parameter_groups == {"scale": ("scale_x",), "bias": ("bias_x", "bias_y", "bias_z")}
    x = problem.xu
    vector = problem.estimate(x).vector
    np.testing.assert_array_equal(vector[[0, 3, 4, 5]], x)
    np.testing.assert_array_equal(
        np.delete(vector, [0, 3, 4, 5]), np.delete(PAPER_PRESET.vector, [0, 3, 4, 5])
    )


def test_the_frame_problem_describes_the_same_sensors():
    problem, whole = world("indicator", "frame"), world("indicator", "all")
    assert problem.n_var == 9
    np.testing.assert_allclose(problem.loss(problem.true_x), whole.loss(whole.true_x), rtol=1e-9)
    np.testing.assert_allclose(problem.loss(problem.nominal), whole.loss(whole.nominal), rtol=1e-9)
    score = problem.score(problem.estimate(problem.true_x))
    assert score["own_frame_rate_error_deg_h"] < 1e-9
    assert score["frame_rotation_urad"] > 100.0
    forces = world("invariants", "frame")
    assert forces.n_var == 21
    found = forces.score(forces.estimate(forces.true_x))
    assert found["relative_rotation_urad"] < 1e-6
    assert found["frame_rotation_urad"] > 10.0


def test_scores_against_brute_force():
    """The rate error over all attitudes, and the part a rotation can take away."""
    problem = world("indicator", "all")
    estimate, truth = problem.estimate(candidates(problem, 1)[0]), problem.truth
    rates = earth_rate(scattered_positions(200_000, 5), LATITUDE)
    error = residual_error(estimate, truth, rates)
    score = problem.score(estimate)
    assert score["rate_error_deg_h"] == pytest.approx(
        np.sqrt(np.mean(np.sum(error**2, axis=1))) / DEGREE_PER_HOUR, rel=0.01
    )
    turned = estimate.in_frame("lower-triangular"), truth.in_frame("lower-triangular")
    other = problem.score(turned[0])
    assert other["own_frame_rate_error_deg_h"] == pytest.approx(score["own_frame_rate_error_deg_h"], rel=1e-6)
    assert score["own_frame_rate_error_deg_h"] <= score["rate_error_deg_h"]
    one = estimate.vector - truth.vector
    assert score["bias_error_deg_h"] == pytest.approx(np.sqrt(np.mean(one[3:6] ** 2)) / DEGREE_PER_HOUR)
    assert score["scale_error_ppm"] == pytest.approx(1e6 * np.sqrt(np.mean((one[:3] / truth.scale) ** 2)))
    assert score["misalignment_error_urad"] == pytest.approx(1e6 * np.sqrt(np.mean(one[6:] ** 2)))
    assert all(value < 1e-6 for value in problem.score(truth).values())


def test_a_small_rotation_is_seen_as_such():
    problem = world("indicator", "all")
    turn = np.array([[0, -3e-4, 2e-4], [3e-4, 0, -1e-4], [-2e-4, 1e-4, 0]])
    rotated = GyroTriad.from_matrix(
        problem.truth.matrix @ np.linalg.solve(np.eye(3) - turn / 2, np.eye(3) + turn / 2),
        problem.truth.scale * problem.truth.bias,
    )
    score = problem.score(rotated)
    assert score["frame_rotation_urad"] == pytest.approx(1e6 * np.sqrt(14e-8), rel=1e-4)
    assert score["own_frame_rate_error_deg_h"] < 1e-9
    assert score["rate_error_deg_h"] == pytest.approx(
        EARTH_RATE / DEGREE_PER_HOUR * np.sqrt(2 / 3 * 14e-8), rel=1e-4
    )


def test_pictures_and_pickles():
    problem = world("invariants")
    copy = pickle.loads(pickle.dumps(problem))
    X = candidates(problem, 5)
    np.testing.assert_array_equal(copy.loss(X), problem.loss(X))
    assert set(problem.illustration()) == {"preset_rates", "true_rates"}
    assert isinstance(problem.estimate(X[0]), ImuCalibration)
    with pytest.raises(ValueError, match="read-only"):
        problem.counts[0] = 0.0


# -- bad input -------------------------------------------------------------------------------------------


def spoilt(change):
    counts = PAPER_PRESET.forward(earth_rate(twenty_four_positions(), LATITUDE))
    return change(counts)


def put(place, value):
    def change(counts):
        counts[place] = value
        return counts

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (put((3, 1), np.nan), r"nan in channel y of position 3.*leave positions out"),
        (put((slice(None), 2), 1234.0), r"channel z reads 1234 at each of 24.*stuck or saturated"),
        (put((5, 0), 2e9), r"channel x of position 5 is at its range.*saturated"),
        (lambda counts: counts[:1], r"1 position.*at least two"),
        (lambda counts: counts[:, :2], r"shape \(24, 2\).*one row per position"),
        (lambda counts: [["a"] * 3] * 4, "numbers of shape"),
        (lambda counts: counts * 500.0, r"check the scale factors of `fixed`"),
    ],
)
def test_broken_records_are_refused_with_the_remedy(change, message):
    with pytest.raises(InvalidInput, match=message):
        GyroCalibration(spoilt(change), latitude=LATITUDE, noise=PAPER_NOISE, fixed=PAPER_PRESET)


@pytest.mark.parametrize(
    ("factor", "unit"), [(1.0, "rad/s"), (180 / np.pi, "deg/s"), (1 / DEGREE_PER_HOUR, "deg/h")]
)
def test_wrong_units_are_found_by_the_earth_rate(factor, unit):
    rates = earth_rate(twenty_four_positions(), LATITUDE) + 1e-6
    assert rate_unit(rates * factor) == unit
    make = {"latitude": LATITUDE, "noise": PAPER_NOISE}
    if unit == "rad/s":
        assert GyroCalibration(rates, **make).n_var == 9
        return
    with pytest.raises(InvalidInput, match=f"are they in {unit}.*taken for rad/s") as error:
        GyroCalibration(rates * factor, **make)
    # and the remedy works, as printed
    printed = float(str(error.value).partition("multiply them by ")[2].partition(",")[0])
    assert GyroCalibration(rates * factor * printed, **make).n_var == 9
    fixed = GyroTriad(np.full(3, 1 / printed), np.eye(3), np.zeros(3))
    assert GyroCalibration(rates * factor, fixed=fixed, **make).n_var == 9


def test_noise_above_the_earth_rate_is_refused():
    loud = GyroNoise.from_datasheet(deg_sqrt_h=1.0)
    for time, fine in ((300.0, True), (10.0, False)):
        if fine:
            known_positions(noise=loud, averaging_time_s=time)
            continue
        with pytest.raises(InvalidInput, match=r"against an Earth rate of 15\.04.*average each position for"):
            known_positions(noise=loud, averaging_time_s=time)
    unstable = GyroNoise.from_datasheet(deg_sqrt_h=0.1, deg_h=20.0)
    with pytest.raises(InvalidInput, match=r"averaging longer does not help.*turntable"):
        known_positions(noise=unstable)
    with pytest.raises(InvalidInput, match="positive random walk"):
        known_positions(noise=GyroNoise())


def accelerometers(**changes):
    attitudes = twenty_four_positions()
    forces = specific_force(attitudes, LATITUDE)
    return known_positions(
        **{
            "loss": "invariants",
            "accelerometer_counts": forces,
            "accelerometer_noise": AccelerometerNoise.from_datasheet(10.0),
            **changes,
        }
    )


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: known_positions(estimated="scales"), UnknownName, "scales"),
        (lambda: known_positions(estimated=["scale", "scale_x"]), InvalidInput, "none twice"),
        (lambda: known_positions(estimated=[]), InvalidInput, "at least one"),
        (lambda: known_positions(estimated=["frame", "bias"]), InvalidInput, "stands alone"),
        (lambda: known_positions(estimated="frame", loss="turntable"), InvalidInput, "axes of its own"),
        (lambda: known_positions(loss="norm"), UnknownName, "indicator"),
        (lambda: known_positions(loss="turntable"), InvalidInput, "turntable record"),
        (lambda: known_positions(loss="invariants"), InvalidInput, "needs accelerometers"),
        (lambda: known_positions(noise=0.1), InvalidInput, "GyroNoise"),
        (lambda: known_positions(box=np.zeros((3, 2))), InvalidInput, "box"),
        (lambda: known_positions(reach_misalignment=0.0), InvalidInput, "half width"),
        (lambda: known_positions(prior={"scale": 1.0}), InvalidInput, "prior of bias_x"),
        (lambda: known_positions(prior={"scala": 1.0}), UnknownName, "scala"),
        (lambda: known_positions(prior=-np.eye(9)), InvalidInput, "positive definite"),
        (lambda: known_positions(truth=3.0), InvalidInput, "GyroTriad"),
        (lambda: known_positions(attitudes=twenty_four_positions()[:3]), InvalidInput, "one for each of 24"),
        (lambda: known_positions(turntable_counts=np.ones((24, 3))), InvalidInput, "both, or neither"),
        (lambda: accelerometers(accelerometer_noise=None), InvalidInput, "AccelerometerNoise"),
        (
            lambda: accelerometers(accelerometer_counts=specific_force(twenty_four_positions(), 0.8) / 9.8),
            InvalidInput,
            "multiples of g",
        ),
        (lambda: navopt.simulate("gyro-calibration", 0, protocol="fair"), UnknownName, "random"),
        (lambda: navopt.simulate("gyro-calibration", 0, noise={"arw": 1}), InvalidInput, "from_datasheet"),
        (
            lambda: navopt.simulate("gyro-calibration", 0, turntable_rates_deg_s=(900.0,)),
            InvalidInput,
            "within the range",
        ),
    ],
)
def test_impossible_arguments_are_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_turntable_rates_in_another_unit_are_found():
    rates = earth_rate(twenty_four_positions(), LATITUDE)
    counts = PAPER_PRESET.forward(rates)
    with pytest.raises(InvalidInput, match=r"turntable_counts against turntable_rates.*are they in rad/s"):
        known_positions(turntable_counts=counts, turntable_rates=np.degrees(rates) * 3600)


def test_priors_by_name_kind_and_matrix():
    by_kind = known_positions(prior={"scale": 1e4, "bias": 1e-7, "misalignment": 1e-4, "bias_y": 2e-7})
    covariance = by_kind.prior()[1]
    assert by_kind.parameter_names[:6] == PARAMETER_NAMES[:6]
    np.testing.assert_allclose(np.sqrt(np.diag(covariance))[:6], [1e4, 1e4, 1e4, 1e-7, 2e-7, 1e-7])
    np.testing.assert_allclose(known_positions(prior=covariance).prior()[1], covariance)
    assert known_positions().prior() is None
    assert (
        accelerometers(fixed_accelerometer=AccelerometerTriad(np.ones(3), np.eye(3), np.zeros(3))).n_var == 21
    )
