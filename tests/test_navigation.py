"""What calibration errors do to a position: against python-ins, closed forms and the limits of alignment."""

import itertools

import numpy as np
import pytest
from scipy import optimize, stats

from navopt.errors import InvalidInput, NavoptError, UnknownName
from navopt.models.earth import EARTH_RATE, GRAVITY, NAUTICAL_MILE, SCHULER_PERIOD, principal_radii
from navopt.models.navigation import CalibrationResidual, navigation_error
from navopt.models.navigation_alignment import align, alignment_limits, attitude_matrix, platform_angles
from navopt.models.navigation_linear import error_steps
from navopt.models.navigation_noise import draw_run_errors
from navopt.models.navigation_scenarios import LakeScenario, StaticScenario
from navopt.models.sensor_noise import AccelerometerNoise, GyroNoise
from navopt.models.triad import DEGREE_PER_HOUR, AccelerometerTriad, GyroTriad, residual_error

LEVEL = 0.001 / 3  # three statistical checks in this file
FREE = StaticScenario(alignment="perfect", heading_deg=0.0)
DRIFTS = {"east": (1.0, 0.0, 0.0), "north": (0.0, 1.0, 0.0), "up": (0.0, 0.0, 1.0)}


def drift(bias_deg_h):
    return CalibrationResidual.of_errors(bias=np.array(bias_deg_h) * DEGREE_PER_HOUR)


def spoilt(rng, *, accelerometers=True):
    """A calibration that is wrong in every parameter, as badly as a good system's may be after years."""

    def pair(kind, unit, bias, per_mille):
        true = kind(
            unit * (1.0 + 0.01 * rng.standard_normal(3)),
            np.eye(3) + 1e-3 * rng.standard_normal((3, 3)) * (1.0 - np.eye(3)),
            3.0 * bias * rng.standard_normal(3),
        )
        wrong = kind(
            true.scale * (1.0 + per_mille * rng.standard_normal(3)),
            true.misalignment + per_mille * rng.standard_normal((3, 3)) * (1.0 - np.eye(3)),
            true.bias + bias * rng.standard_normal(3),
        )
        return true, wrong

    true, estimated = pair(GyroTriad, 1.3e8, 0.003 * DEGREE_PER_HOUR, 5e-5)
    if not accelerometers:
        return CalibrationResidual(true=true, estimated=estimated)
    force, believed = pair(AccelerometerTriad, 1e5, 2e-5 * GRAVITY, 2e-6)
    return CalibrationResidual(
        true=true, estimated=estimated, accelerometer_true=force, accelerometer_estimated=believed
    )


# -- the journey of an error -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axis", "end", "peak"), [("north", 0.70, 0.70), ("east", 0.008, 0.34), ("up", 0.72, 0.72)]
)
def test_a_thousandth_of_a_degree_per_hour_for_a_day(axis, end, peak):
    error = navigation_error(drift(0.001 * np.array(DRIFTS[axis])), FREE)
    assert error.end_nmi == pytest.approx(end, abs=0.008)
    assert error.max_nmi == pytest.approx(peak, abs=0.008)


@pytest.mark.parametrize("axis", DRIFTS)
def test_the_linear_model_is_the_strapdown_run_of_python_ins(axis):
    wrong = drift(0.005 * np.array(DRIFTS[axis]))
    linear, exact = (navigation_error(wrong, FREE, method=method) for method in ("linear", "strapdown"))
    off = np.hypot(linear.north_m - exact.north_m, linear.east_m - exact.east_m)
    assert off.max() < 1e-3 * exact.max_m


def test_what_moves_a_day_of_rest_far_off_is_the_drift_about_the_axis_of_the_earth():
    # the sky turns about that axis: drift about it is longitude, all other drift swings back within the day
    latitude = FREE.latitude
    axis = np.array([0.0, np.cos(latitude), np.sin(latitude)])
    reach = principal_radii(latitude)[1] * np.cos(latitude) * 86400.0
    for seed in range(6):
        wanted = np.random.default_rng(seed).normal(size=3) * 0.003 * DEGREE_PER_HOUR
        along = axis @ wanted
        ends = [
            navigation_error(CalibrationResidual.of_errors(bias=b), FREE)
            for b in (along * axis, wanted - along * axis)
        ]
        assert ends[0].end_m == pytest.approx(abs(along) * reach, rel=0.01)
        assert ends[1].end_m < 0.03 * ends[1].max_m


def test_errors_swing_with_schuler_and_with_the_earth():
    transition = error_steps(FREE).transition[0]
    frequency = np.unique(np.round(np.abs(np.log(np.linalg.eigvals(transition)).imag) / FREE.step_s, 12))
    meridian, prime_vertical = principal_radii(FREE.latitude)
    schuler = np.sqrt(9.8067 / np.sqrt(meridian * prime_vertical))
    # Foucault's split of the Schuler period by the Earth's turning
    split = EARTH_RATE * np.sin(FREE.latitude)
    for expected in (0.0, EARTH_RATE, schuler - split, schuler + split):
        assert np.abs(frequency - expected).min() < 2e-3 * schuler
    assert 2 * np.pi / schuler / 60 == pytest.approx(84.4, abs=0.1)


def test_python_ins_swings_with_the_schuler_period():
    # a wrong accelerometer, not hidden by alignment: x = ∇/ω² (1 − cos ωt), turned by Foucault
    triad = AccelerometerTriad(np.ones(3), np.eye(3), np.zeros(3))
    wrong = CalibrationResidual(
        true=drift((0, 0, 0)).true,
        estimated=drift((0, 0, 0)).true,
        accelerometer_true=triad.replace(bias_y=1e-5 * GRAVITY),
        accelerometer_estimated=triad,
    )
    scenario = StaticScenario(hours=3.0, alignment="perfect", heading_deg=0.0)
    run = navigation_error(wrong, scenario, method="strapdown")
    turn = EARTH_RATE * np.sin(scenario.latitude)

    def model(t, size, omega):
        return size * (1.0 - np.cos(omega * t) * np.cos(turn * t))

    fit, _ = optimize.curve_fit(model, run.time_s, run.north_m, p0=[60.0, 1.2e-3])
    assert 2 * np.pi / fit[1] == pytest.approx(SCHULER_PERIOD, rel=2e-3)
    assert fit[0] == pytest.approx(1e-5 * SCHULER_PERIOD**2 / (2 * np.pi) ** 2 * GRAVITY, rel=0.01)


def test_a_bias_instability_on_all_axes_gives_the_order_of_the_papers_day():
    # 0.005 deg/h on east, north and up: where the drifts about north and up cancel about the Earth's axis, a
    # day ends where it began and reaches 3.3 to 3.8 nautical miles between; where they add up it ends 7 off
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    opposed = signs[:, 1] != signs[:, 2]
    for alignment, peak in (("levelled", 3.28), ("perfect", 3.79)):
        scenario = StaticScenario(alignment=alignment, heading_deg=0.0)
        error = navigation_error([drift(0.005 * sign) for sign in signs], scenario)
        np.testing.assert_allclose(error.max_nmi[opposed], peak, atol=0.02)
        assert error.end_nmi[opposed].max() < 0.15
        np.testing.assert_allclose(error.end_nmi[~opposed], 7.1, atol=0.1)


# -- alignment -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.9])
def test_alignment_ends_at_its_limits(heading):
    rng = np.random.default_rng(3)
    latitude = np.radians(45.75)
    attitude = attitude_matrix(heading)
    scenario = StaticScenario(heading_deg=np.degrees(heading))
    steps = error_steps(scenario)
    from navopt.models.navigation_linear import SWAP

    gyro, force = SWAP @ steps.start[:3], SWAP @ steps.start[3:]
    for method in ("levelled", "svd"):
        assert np.abs(platform_angles(align(gyro, force, latitude, method=method), attitude)).max() < 1e-12
    drifts = 0.005 * DEGREE_PER_HOUR * rng.standard_normal((50, 3))
    forces = 5e-5 * GRAVITY * rng.standard_normal((50, 3))
    found = align(gyro + drifts @ attitude, force + forces @ attitude, latitude)
    limits = alignment_limits(drifts, forces, latitude)
    angles = platform_angles(found, attitude)
    assert np.abs(angles - limits).max() < 2e-3 * np.abs(limits).max()
    # 0.01 deg/h to the east at 40 deg is 3.0', 100 ug is 20.6"
    east = alignment_limits([0.0, 0.01 * DEGREE_PER_HOUR, 0.0], [1e-4 * GRAVITY, 0.0, 0.0], np.radians(40.0))
    assert np.degrees(east[2]) * 60.0 == pytest.approx(3.0, abs=0.02)
    assert np.degrees(-east[1]) * 3600.0 == pytest.approx(20.6, abs=0.05)


def test_the_analytic_alignment_is_a_rotation_that_shares_the_disagreement():
    latitude = 0.8
    steps = error_steps(StaticScenario(latitude_deg=np.degrees(latitude), heading_deg=20.0))
    from navopt.models.navigation_linear import SWAP

    attitude = attitude_matrix(np.radians(20.0))
    gyro, force = SWAP @ steps.start[:3], SWAP @ steps.start[3:]
    # rates too fast about north and too slow about up: gravity and rate no longer meet at the right angle
    wrong = gyro + attitude.T @ (0.05 * DEGREE_PER_HOUR * np.array([1.0, 0.0, 1.0]))
    found = align(wrong, force, latitude, method="svd")
    assert np.linalg.det(found) == pytest.approx(1.0)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
    angles = platform_angles(found, attitude)
    assert np.abs(platform_angles(align(wrong, force, latitude), attitude)).max() < 1e-12
    assert abs(angles[1]) > 1e-4  # it tilts, where levelling does not


def test_alignment_hides_the_drift_of_the_east_gyro():
    east = drift((0.005, 0.0, 0.0))
    hidden = navigation_error(east, StaticScenario(heading_deg=0.0), method="strapdown")
    assert navigation_error(east, FREE).max_nmi == pytest.approx(5 * 0.34, abs=0.02)
    assert hidden.max_nmi < 0.005


def test_gyros_that_cannot_find_north_are_refused():
    steps = error_steps(StaticScenario(heading_deg=0.0))
    blind = CalibrationResidual.of_errors(bias=-np.array([*steps.start[:2], 0.0]))
    with pytest.raises(InvalidInput, match="horizontal rate"):
        navigation_error(blind, StaticScenario(heading_deg=0.0))


# -- everything at once ----------------------------------------------------------------------------------


NOISE = {
    "gyro_noise": GyroNoise.from_datasheet(0.0005, 0.005, 10.0, 800.0),
    "accelerometer_noise": AccelerometerNoise(velocity_random_walk=5e-5, bias_instability=1e-5),
}


def test_a_noisy_run_with_everything_wrong_is_that_of_python_ins_at_rest():
    scenario = StaticScenario(hours=24.0, substeps=20, **NOISE)
    wrong = spoilt(np.random.default_rng(1))
    linear, exact = (navigation_error(wrong, scenario, seed=5, method=m) for m in ("linear", "strapdown"))
    off = np.hypot(linear.north_m - exact.north_m, linear.east_m - exact.east_m)
    assert exact.max_m > 1000.0
    assert off.max() < 0.01 * exact.max_m


@pytest.mark.parametrize("duration", [900.0, 3600.0])
def test_a_noisy_run_with_everything_wrong_is_that_of_python_ins_on_the_lake(duration):
    scenario = LakeScenario(duration_s=duration, **NOISE)
    wrong = spoilt(np.random.default_rng(2))
    linear, exact = (navigation_error(wrong, scenario, seed=5, method=m) for m in ("linear", "strapdown"))
    off = np.hypot(linear.north_m - exact.north_m, linear.east_m - exact.east_m)
    assert exact.max_m > 15.0
    assert off.max() < 0.01 * exact.max_m


def test_without_errors_neither_model_goes_anywhere():
    for scenario in (StaticScenario(), LakeScenario(duration_s=1800.0, reference_sigma_m=0.0)):
        assert navigation_error(drift((0, 0, 0)), scenario).max_m < 1e-6
        assert navigation_error(drift((0, 0, 0)), scenario, method="strapdown").max_m < 0.1


def test_turns_show_a_scale_factor_that_rest_does_not():
    # the up gyro's scale factor sees every turn of the boat, and the turns do not cancel
    true = drift((0, 0, 0)).true
    wrong = CalibrationResidual(true=true.replace(scale_z=1.0 + 1e-3), estimated=true)
    legs = ((60.0, 40.0, 5.0), (540.0, 130.0, 5.0))
    turning = LakeScenario(duration_s=600.0, reference_sigma_m=0.0, alignment="perfect", legs=legs)
    straight = LakeScenario(duration_s=600.0, reference_sigma_m=0.0, alignment="perfect", legs=legs[:1])
    assert navigation_error(wrong, straight).end_m < 0.2
    # 90 deg times 1e-3 of azimuth, in the middle of the turn at 95 s; the Earth then turns about an axis that
    # is off by as much, and the platform tilts: R w (t - sin(w_s t) / w_s)
    since, schuler = 505.0, 2.0 * np.pi / SCHULER_PERIOD
    rate = np.radians(90.0) * 1e-3 * EARTH_RATE * np.cos(turning.latitude)
    reach = principal_radii(turning.latitude)[0] * rate * (since - np.sin(schuler * since) / schuler)
    for method in ("linear", "strapdown"):
        assert -navigation_error(wrong, turning, method=method).north_m[-1] == pytest.approx(reach, rel=0.03)


def test_random_walk_moves_a_day_by_what_its_step_responses_say():
    walk = 0.0005 / 60.0 * np.pi / 180.0
    worlds = 400
    scenario = StaticScenario(
        heading_deg=0.0, alignment="perfect", gyro_noise=GyroNoise(angle_random_walk=walk), step_s=300.0
    )
    found = navigation_error([drift((0, 0, 0))] * worlds, scenario, seed=11)
    variance = np.zeros(2)
    for axis in DRIFTS.values():
        # the answer to an impulse is the derivative of that to a step
        step = navigation_error(drift(axis), FREE, method="strapdown")
        impulse = np.gradient(np.stack([step.north_m, step.east_m]), step.time_s, axis=1) / DEGREE_PER_HOUR
        variance += walk**2 * np.trapezoid(impulse**2, step.time_s, axis=1)
    for k, ends in enumerate((found.north_m[:, -1], found.east_m[:, -1])):
        statistic = np.sum(ends**2) / variance[k]
        assert stats.chi2.ppf(LEVEL / 4, worlds) < statistic < stats.chi2.isf(LEVEL / 4, worlds)
    assert 0.1 < np.sqrt(variance.sum()) / NAUTICAL_MILE < 0.3


# -- results, noise and journeys -------------------------------------------------------------------------


def test_the_residual_is_that_of_the_triads():
    wrong = spoilt(np.random.default_rng(4))
    x = np.random.default_rng(5).standard_normal((20, 3))
    matrix, constant = wrong.gyro
    np.testing.assert_allclose(
        x @ matrix.T + constant, residual_error(wrong.estimated, wrong.true, x), atol=1e-14
    )
    matrix, constant = wrong.accelerometer
    expected = residual_error(wrong.accelerometer_estimated, wrong.accelerometer_true, x)
    np.testing.assert_allclose(x @ matrix.T + constant, expected, atol=1e-14)
    assert not spoilt(np.random.default_rng(4), accelerometers=False).accelerometer[0].any()
    with pytest.raises(InvalidInput, match="both accelerometer"):
        CalibrationResidual(
            true=wrong.true, estimated=wrong.estimated, accelerometer_true=wrong.accelerometer_true
        )


def test_many_runs_are_each_of_them_alone():
    scenario = LakeScenario(duration_s=300.0, **NOISE)
    residuals = [spoilt(np.random.default_rng(k)) for k in range(4)]
    together = navigation_error(residuals, scenario, seed=3)
    assert together.north_m.shape == (4, 301)
    # a run's errors depend on the seed and its number only
    first = navigation_error(residuals[:2], scenario, seed=3)
    np.testing.assert_array_equal(together.north_m[:2], first.north_m)
    np.testing.assert_array_equal(navigation_error(residuals[0], scenario, seed=3).east_m, first.east_m[0])
    given = navigation_error(residuals, scenario, run_errors=draw_run_errors(scenario, 4, 3))
    np.testing.assert_array_equal(given.east_m, together.east_m)
    assert (navigation_error(residuals, scenario, seed=4).end_m != together.end_m).all()


def test_summaries_of_a_run():
    error = navigation_error(drift((0.003, -0.002, 0.004)), StaticScenario(hours=5.0))
    size = np.hypot(error.north_m, error.east_m)
    assert error.rms_m == pytest.approx(np.sqrt(np.mean(size**2)))
    assert (error.max_m, error.end_m) == (size.max(), size[-1])
    assert error.end_nmi * 1852.0 == pytest.approx(error.end_m)
    np.testing.assert_array_equal(error.hours, np.arange(6))
    np.testing.assert_array_equal(error.per_hour, size[::60])
    with pytest.raises(ValueError, match="read-only"):
        error.north_m[0] = 1.0


def test_a_test_on_the_lake_sees_the_reference_too():
    scenario = LakeScenario(duration_s=600.0, reference_sigma_m=1.5)
    error = navigation_error([drift((0, 0, 0))] * 30, scenario, seed=2)
    seen = error.against_reference
    assert error.max_m.max() < 1e-6
    values = np.ravel([seen.north_m, seen.east_m]) / 1.5
    assert stats.kstest(values, stats.norm.cdf).pvalue > LEVEL
    np.testing.assert_array_equal(seen.against_reference.north_m, seen.north_m)


def test_the_sensors_own_errors_have_the_sizes_of_the_data_sheet():
    scenario = StaticScenario(hours=2.0, **NOISE)
    own = draw_run_errors(scenario, 300, 9)
    noise = NOISE["gyro_noise"]
    parts = [
        own.bias[:, :3] / (0.005 * DEGREE_PER_HOUR),
        own.scale / 1e-5,
        own.white[..., :3] / (noise.angle_random_walk / np.sqrt(60.0)),
        own.alignment[:, 3:] / (5e-5 / np.sqrt(600.0)),
    ]
    for part in parts:
        assert stats.kstest(part.ravel(), stats.norm.cdf).pvalue > LEVEL / 4
    with pytest.raises(InvalidInput, match="give a seed"):
        navigation_error(drift((0, 0, 0)), scenario)


def test_the_boat_leaves_its_mooring_and_manoeuvres():
    scenario = LakeScenario(duration_s=900.0)
    path = scenario.path()
    assert path.duration == pytest.approx(900.0)
    speed = np.hypot(*path.velocity.T)
    assert speed[:150].max() == 0.0
    assert np.degrees(np.ptp(path.heading)) > 180.0
    assert speed.max() == pytest.approx(7.0)
    course = np.arctan2(path.velocity[:, 1], path.velocity[:, 0])
    moving = speed > 0.5
    turned = np.angle(np.exp(1j * (course - path.heading)))[moving]
    assert np.abs(turned).max() < 1e-9
    assert LakeScenario(duration_s=3600.0).path().duration == pytest.approx(3600.0)


@pytest.mark.parametrize(
    ("kind", "change", "words"),
    [
        (StaticScenario, {"latitude_deg": 89.0}, "poles"),
        (StaticScenario, {"alignment": "guessed"}, "levelled"),
        (StaticScenario, {"hours": 0.0}, "positive"),
        (StaticScenario, {"heading_deg": np.nan}, "finite"),
        (StaticScenario, {"longitude_deg": np.inf}, "finite"),
        (StaticScenario, {"substeps": 0}, "whole number"),
        (LakeScenario, {"duration_s": -5.0}, "positive"),
        (LakeScenario, {"reference_sigma_m": -1.0}, "not negative"),
        (LakeScenario, {"legs": ()}, "rows"),
        (LakeScenario, {"legs": ((0.0, 1.0, 2.0),)}, "rows"),
    ],
)
def test_scenarios_refuse_nonsense(kind, change, words):
    with pytest.raises(NavoptError, match=words):
        kind(**change)


def test_navigation_refuses_nonsense():
    scenario = LakeScenario(duration_s=60.0, reference_sigma_m=0.0)
    with pytest.raises(UnknownName, match="strapdown"):
        navigation_error(drift((0, 0, 0)), scenario, method="strap-down")
    with pytest.raises(InvalidInput, match="at least one"):
        navigation_error([], scenario)
    with pytest.raises(InvalidInput, match="errors of 2 runs"):
        navigation_error([drift((0, 0, 0))] * 2, scenario, run_errors=draw_run_errors(scenario, 3, None))
    slow = GyroNoise(range=np.radians(1.0), angle_random_walk=0.0)
    with pytest.raises(InvalidInput, match="turn more slowly"):
        navigation_error(drift((0, 0, 0)), LakeScenario(duration_s=600.0, gyro_noise=slow), seed=1)
    with pytest.raises(InvalidInput, match="levelled"):
        align([0.0, 0.0, 1e-4], [0.0, 0.1, -9.8], 0.7, method="wahba")
    with pytest.raises(InvalidInput, match="at rest"):
        align([1e-5, 0.0, 1e-4], [0.0, 0.0, 0.0], 0.7)
    with pytest.raises(InvalidInput, match="finite"):
        align([np.nan, 0.0, 1e-4], [0.0, 0.0, -9.8], 0.7)
