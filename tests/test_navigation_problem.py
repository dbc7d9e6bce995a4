"""Gyros recalibrated and navigated: what the record of a run tells, and what it cannot."""

import numpy as np
import pytest

import navopt
from baselines import NormLeastSquares
from navopt.errors import InvalidInput, NoTruth, UnknownName
from navopt.models.earth import EARTH_RATE, NAUTICAL_MILE, principal_radii
from navopt.models.navigation_linear import error_steps
from navopt.models.triad import DEGREE_PER_HOUR, residual_error
from navopt.problems import GyroNavigation

SILENT = {"deg_sqrt_h": 1e-12}
KEYS = {
    "position_error_max_nmi",
    "position_error_rms_nmi",
    "position_error_end_nmi",
    "position_error_max_m",
    "position_error_end_m",
    "north_error_end_m",
    "east_error_end_m",
}


def world(seed=0, **scenario):
    return navopt.simulate("gyro-navigation", seed=seed, **scenario)


def about_the_axis(problem, triad):
    """Component along the Earth's axis of what a calibration makes of the rate at rest, less the Earth's."""
    start = error_steps(problem.scenario).start[:3]
    return residual_error(triad, problem.truth, start) @ start / EARTH_RATE


# -- what one position tells ---------------------------------------------------------------------------


@pytest.mark.parametrize("navigation", ["static", "lake"])
def test_the_record_of_a_run_tells_one_thing_of_twelve(navigation):
    problem = world(3, navigation=navigation, prior=False)
    assert len(problem.parameters) == 12
    assert problem.identifiability().rank == 1
    assert world(3, navigation=navigation, recalibration="positions", prior=False).identifiability().rank == 9


def test_the_record_is_that_of_the_run_that_is_navigated():
    problem = world(4)
    start = error_steps(problem.scenario).start[:3]
    noise = problem.run_errors.white[0, :, :3].reshape(24, 60, 3).mean(axis=1)
    np.testing.assert_allclose(
        problem.truth.inverse(problem.counts), start + noise, rtol=0, atol=1e-9 * EARTH_RATE
    )
    assert not problem.run_errors.bias.any()
    assert not problem.run_errors.scale.any()
    np.testing.assert_allclose(
        problem.attitudes @ [0.0, np.cos(0.7985), np.sin(0.7985)],
        np.tile(start, (24, 1)) / EARTH_RATE,
        atol=1e-4,
    )


def test_at_the_mooring_alignment_and_recalibration_use_the_same_minutes():
    problem = world(4, navigation="lake")
    start = error_steps(problem.scenario).start[:3]
    means = problem.truth.inverse(problem.counts) - start
    np.testing.assert_allclose(
        means.mean(axis=0), problem.run_errors.alignment[0, :3], atol=1e-9 * EARTH_RATE
    )
    assert problem.averaging_time_s == 60.0


def test_fitting_the_record_removes_the_end_of_the_day_and_not_the_day():
    # in one position the norm gives the drift about the Earth's axis, which alone is left after 24 h
    ends, peaks = [], []
    for seed in range(12):
        problem = world(seed)
        fitted = navopt.solve(problem, NormLeastSquares(), budget=2000)
        before = problem.score(problem.turntable_answer)
        reach = principal_radii(problem.latitude)[1] * np.cos(problem.latitude) * 86400.0
        along = about_the_axis(problem, problem.turntable_answer)
        noise = (
            problem.run_errors.white[0, :, :3].mean(axis=0)
            @ error_steps(problem.scenario).start[:3]
            / EARTH_RATE
        )
        expected = abs(along + noise) * reach / NAUTICAL_MILE
        assert before["position_error_end_nmi"] == pytest.approx(expected, abs=0.6)
        # the fit brings the mean of the very record to the Earth's rate, its random walk included
        assert abs(about_the_axis(problem, fitted.estimate) + noise) < 2e-5 * DEGREE_PER_HOUR * 15.0
        ends.append([before["position_error_end_nmi"], fitted.scores["position_error_end_nmi"]])
        peaks.append(fitted.scores["position_error_max_nmi"])
    ends = np.array(ends)
    assert ends[:, 1].max() < 0.6
    assert np.median(ends[:, 0]) > 3.0
    assert np.median(peaks) > 3.0 * np.median(ends[:, 1])


def test_a_recalibration_before_the_run_does_not_know_its_switch_on():
    problem = world(2, recalibration="positions")
    assert problem.run_errors.bias[0, :3].any()
    assert problem.run_errors.scale.any()
    # even the true gyros of yesterday are miles off today
    errors = [
        world(seed, recalibration="positions").score(world(seed, recalibration="positions").truth)[
            "position_error_max_nmi"
        ]
        for seed in range(12)
    ]
    assert np.median(errors) > 1.0
    same = world(2, recalibration="positions", noise={"deg_sqrt_h": 0.0005, "deg_h": 0.0, "ppm": 0.0})
    assert not same.run_errors.bias.any()
    assert same.score(same.truth)["position_error_max_nmi"] < 1.0


# -- scores ----------------------------------------------------------------------------------------------


def test_scores_are_those_of_the_navigation_and_of_the_calibration():
    problem = world(1, navigation="lake", recalibration="positions")
    scores = problem.score(problem.turntable_answer)
    assert set(scores) >= KEYS | {"bias_error_deg_h", "rate_error_deg_h"}
    run = problem.navigation(problem.turntable_answer)
    assert scores["position_error_max_nmi"] == pytest.approx(run.max_nmi)
    assert scores["position_error_end_m"] == pytest.approx(run.end_m)
    assert scores["position_error_rms_nmi"] == pytest.approx(run.rms_nmi)
    seen = run.against_reference
    assert scores["north_error_end_m"] == pytest.approx(abs(seen.north_m[-1]))
    assert scores["east_error_end_m"] == pytest.approx(abs(seen.east_m[-1]))


@pytest.mark.parametrize(("navigation", "hours"), [("static", 6.0), ("lake", 24.0)])
def test_scores_are_those_of_python_ins(navigation, hours):
    problem = world(5, navigation=navigation, hours=hours, recalibration="positions")
    linear, exact = (problem.navigation(problem.turntable_answer, method=m) for m in ("linear", "strapdown"))
    assert np.hypot(linear.north_m - exact.north_m, linear.east_m - exact.east_m).max() < 0.01 * exact.max_m


def test_gyros_that_cannot_find_north_are_infinitely_wrong():
    problem = world(0)
    start = error_steps(problem.scenario).start[:3]
    shift = problem.truth.misalignment @ [*start[:2], 0.0]
    blind = problem.truth.replace(bias=problem.truth.bias + shift)
    scores = problem.score(blind)
    assert all(scores[key] == np.inf for key in KEYS)
    assert np.isfinite(scores["bias_error_deg_h"])


def test_without_errors_there_is_no_error():
    problem = world(
        0, noise=SILENT, aged_bias_deg_h=0.0, aged_scale_ppm=0.0, aged_misalignment=0.0, prior=False
    )
    assert problem.score(problem.turntable_answer)["position_error_max_m"] < 0.1
    assert float(problem.loss(problem.nominal)) < 1e-6


def test_in_a_frame_of_its_own_the_answer_keeps_the_axes_of_the_preset():
    problem = world(6, recalibration="positions", estimated="frame", positions=48)
    assert problem.prior() is None
    found = problem.estimate(problem.project(problem.truth))
    # only a rotation has been put back, so that norms are those of the truth
    np.testing.assert_allclose(
        np.linalg.norm(found.inverse(problem.counts), axis=1),
        np.linalg.norm(problem.truth.inverse(problem.counts), axis=1),
        rtol=1e-12,
    )
    # the box's axes lie milliradians from the body's, those of the answer as near as the turntable's
    turned = problem.score(found)["frame_rotation_urad"]
    plain = problem.score(problem.truth.in_frame("lower-triangular"))["frame_rotation_urad"]
    assert plain > 100.0
    assert turned < 30.0
    fitted = navopt.solve(problem, "norm-ls", budget=2000)
    assert fitted.scores["rate_error_deg_h"] < 0.02


# -- worlds ----------------------------------------------------------------------------------------------


def test_a_redrawn_world_keeps_gyros_presets_and_journey():
    for recalibration in ("record", "positions"):
        problem = world(7, recalibration=recalibration, navigation="lake")
        twin = problem.redraw(3)
        np.testing.assert_array_equal(twin.truth.vector, problem.truth.vector)
        np.testing.assert_array_equal(twin.nominal, problem.nominal)
        assert twin.scenario == problem.scenario
        assert (twin.counts != problem.counts).all()
        again = world(7, recalibration=recalibration, navigation="lake")
        np.testing.assert_array_equal(again.counts, problem.counts)
        np.testing.assert_array_equal(again.run_errors.white, problem.run_errors.white)


def test_the_gyros_are_the_same_whatever_is_done_with_them():
    positions, table = (world(8, recalibration="positions", positions=n) for n in (48, 24))
    np.testing.assert_array_equal(positions.truth.vector, table.truth.vector)
    np.testing.assert_array_equal(positions.nominal, table.nominal)
    assert positions.counts.shape == (48, 3)
    # the gyros of the record are those after switching on
    changed = world(8).truth.bias - table.truth.bias
    assert 0.0 < np.abs(changed).max() < 0.03 * DEGREE_PER_HOUR


def test_ageing_and_switch_on_have_their_sizes():
    worlds = [world(seed, recalibration="positions", turntable_rates_deg_s=(10.0,)) for seed in range(60)]
    from navopt.problems.gyro_worlds import PAPER_PRESET

    bias = np.ravel([w.truth.bias - PAPER_PRESET.bias for w in worlds]) / (0.005 * DEGREE_PER_HOUR)
    scale = np.ravel([w.truth.scale / PAPER_PRESET.scale - 1.0 for w in worlds]) / 1e-5
    run = np.ravel([w.run_errors.bias[0, :3] for w in worlds]) / (0.005 * DEGREE_PER_HOUR)
    from scipy import stats

    for sample in (bias, scale, run):
        assert stats.kstest(sample, stats.norm.cdf).pvalue > 0.001 / 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"navigation": "air"}, "lake"),
        ({"recalibration": "records"}, "record"),
        ({"placement": "tabel"}, "table"),
        ({"alignment": "guess"}, "levelled"),
        ({"aged_bias_deg_h": -1.0}, "zero or more"),
        ({"loss": "invariants"}, "gyros alone"),
    ],
)
def test_worlds_refuse_nonsense(change, words):
    with pytest.raises((InvalidInput, UnknownName), match=words):
        world(0, **change)


def test_a_problem_of_ones_own_data_needs_a_fitting_run():
    made = world(0, navigation="lake")
    keywords = {"latitude": made.latitude, "noise": made.noise, "fixed": made.turntable_answer}
    own = GyroNavigation(made.counts, scenario=made.scenario, run_errors=made.run_errors, **keywords)
    with pytest.raises(NoTruth):
        own.navigation(made.turntable_answer)
    with pytest.raises(NoTruth):
        own.score(made.turntable_answer)
    other = world(0).run_errors
    with pytest.raises(InvalidInput, match="one run of 900 steps"):
        GyroNavigation(made.counts, scenario=made.scenario, run_errors=other, **keywords)
