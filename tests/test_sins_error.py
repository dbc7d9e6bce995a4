"""The paper's error model (18) against the strapdown run, its linear form, and the scale (19)–(24)."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from navopt.errors import InvalidInput, NumericalFault
from navopt.models import ins, sins_error, sins_linear
from navopt.models.cruise import CruiseScenario, InsErrors
from navopt.models.earth import principal_radii, separation
from navopt.models.sins_error import TrueMotion, propagate_ins_errors

VOYAGE = CruiseScenario()
TABLE_1 = InsErrors.published(noise=False)
HOURS_3_7_16 = np.array([3.0, 7.0, 16.0]) * 3600.0
NOISE = InsErrors(
    gyro_noise=InsErrors.published().gyro_noise, accelerometer_noise=InsErrors.published().accelerometer_noise
)


def _gap(history, track):
    """Difference of two error histories over the length of the error."""
    return np.linalg.norm(history.position_error - track.position_error, axis=1) / np.linalg.norm(
        track.position_error, axis=1
    )


def test_reference_values():
    history = propagate_ins_errors(VOYAGE, TABLE_1, times=HOURS_3_7_16)
    error = np.linalg.norm(history.position_error, axis=1)
    np.testing.assert_allclose(error, [8660.0, 22440.0, 35030.0], rtol=0.01)


def test_agrees_with_the_strapdown_run():
    """Two routes that share no equation: 0.02, 0.01 and 0.09 % apart."""
    history = propagate_ins_errors(VOYAGE, TABLE_1, times=HOURS_3_7_16)
    track = ins.simulate_ins(VOYAGE, TABLE_1, times=HOURS_3_7_16)
    assert np.all(_gap(history, track) < 0.005)
    np.testing.assert_allclose(history.velocity_error, track.velocity_error, atol=0.01)


def test_agrees_for_a_family_of_errors():
    rng = np.random.default_rng(4)
    for _ in range(4):
        errors = TABLE_1.draw(rng)
        history = propagate_ins_errors(VOYAGE, errors, times=HOURS_3_7_16)
        track = ins.simulate_ins(VOYAGE, errors, times=HOURS_3_7_16)
        assert np.all(_gap(history, track) < 0.005)


@pytest.mark.parametrize("heading_error_deg", [2.0, 30.0, -90.0])
def test_angles_need_not_be_small(heading_error_deg):
    """What the Euler angles of (5)–(9) are for; also the test of the platform's starting angles.

    A quarter of an hour only: later the position is off by degrees and (18), which is of first order in δL,
    no longer applies.
    """
    short = CruiseScenario(duration=3600.0)
    errors = InsErrors(
        attitude_error=(1e-4, -2e-4, np.radians(heading_error_deg)), velocity_error=(0.3, -0.1)
    )
    times = [300.0, 600.0, 900.0]
    history = propagate_ins_errors(short, errors, times=times)
    track = ins.simulate_ins(short, errors, times=times)
    assert np.all(_gap(history, track) < 0.005)


def test_a_weaving_vehicle():
    """A motion that is no rhumb line, with the strapdown algorithm run on it directly."""
    from pyins import sim, strapdown

    time = np.arange(7201.0)
    heading = np.radians(120.0) + 1.0 * np.sin(2 * np.pi * time / 1800.0)
    speed = 6.0 + 2.0 * np.sin(2 * np.pi * time / 2500.0)
    velocity = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading), 0.0 * heading])
    rph = np.column_stack([0.0 * heading, 0.0 * heading, np.degrees(heading)])
    truth, imu = sim.generate_imu(time, [35.0, 20.0, 0.0], rph, velocity, "increment")
    errors = InsErrors(
        gyro_bias=(3e-7, -4e-7, 5e-7), accelerometer_bias=(1e-3, 2e-3, -1e-3), latitude_error=1e-5
    )
    imu.iloc[:] += [*errors.gyro_bias, *errors.accelerometer_bias]
    initial = truth.iloc[0].copy()
    initial["lat"] += np.degrees(errors.latitude_error)
    increments = strapdown.compute_increments_from_imu(imu, "increment")
    run = strapdown.Integrator(initial, with_altitude=False).integrate(increments)
    pair = [np.radians(table[name].to_numpy()) for table in (run, truth) for name in ("lat", "lon")]
    expected = np.column_stack(separation(*pair))

    motion = TrueMotion(
        time=time, latitude=np.radians(truth.lat.to_numpy()), velocity=velocity[:, :2], heading=heading
    )
    history = propagate_ins_errors(motion, errors)
    gap = np.linalg.norm(history.position_error - expected, axis=1)
    assert np.linalg.norm(expected[-1]) > 3000.0
    assert gap.max() < 0.005 * np.linalg.norm(expected, axis=1).max()


def test_the_erratum_of_equation_5():
    """C_ω (9) follows from C (6) as (7) asks with the corrected sign of C_αz, and does not as printed."""

    def c(angles, sign):
        (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
        z = np.array([[cz, sign * sz, 0], [-sign * sz, cz, 0], [0, 0, 1]])
        y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
        x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
        return x @ y @ z

    angles, rate, h = np.array([0.3, -0.4, 0.5]), np.array([0.2, 0.1, -0.7]), 1e-6
    (cx, cy, _), (sx, sy, _) = np.cos(angles), np.sin(angles)
    omega = np.array([[1, 0, -sy], [0, cx, sx * cy], [0, -sx, cx * cy]]) @ rate
    for sign, holds in ((1, True), (-1, False)):
        derivative = (c(angles + h * rate, sign) - c(angles - h * rate, sign)) / (2 * h)
        skew = -derivative @ c(angles, sign).T  # Ċ = −[ω×] C for a frame that turns by ω seen from itself
        assert np.allclose([skew[2, 1], skew[0, 2], skew[1, 0]], omega, atol=1e-8) == holds
    corrected = Rotation.from_euler("ZYX", angles[::-1]).inv().as_matrix()
    np.testing.assert_allclose(c(angles, 1), corrected, atol=1e-15)


def test_noise_is_reproducible_needs_a_seed_and_matters_little():
    first, again = (propagate_ins_errors(VOYAGE, InsErrors.published(), rng=1) for _ in range(2))
    assert np.array_equal(first.latitude_error, again.latitude_error)
    quiet = propagate_ins_errors(VOYAGE, TABLE_1)
    effect = np.linalg.norm(first.position_error - quiet.position_error, axis=1)
    assert 50.0 < effect.max() < 1000.0
    with pytest.raises(InvalidInput, match="rng"):
        propagate_ins_errors(VOYAGE, NOISE)


def test_segments_of_the_reference_run():
    """Segment heading error −14.1° to +12.5° (paper: ±15°, Fig 3), true over INS length .884 to 1.330.

    From 1-min to 5-min segments these extremes move by up to 0.2° and 0.004, because a long segment averages
    the peak: the tolerances.
    """
    for interval in (60.0, 300.0):
        history = propagate_ins_errors(VOYAGE, TABLE_1, times=VOYAGE.times(interval))
        shown = np.array(VOYAGE.velocity) + history.velocity_error
        turned = np.degrees(sins_error.segment_heading_error(shown, history.velocity_error))
        ratio = sins_error.segment_length_ratio(shown, history.velocity_error)
        np.testing.assert_allclose([turned.min(), turned.max()], [-14.1, 12.5], atol=0.25)
        np.testing.assert_allclose([ratio.min(), ratio.max()], [0.884, 1.330], atol=0.005)


def test_segments_from_velocities_are_those_of_the_positions():
    track = ins.simulate_ins(VOYAGE, TABLE_1, times=VOYAGE.times(60.0))

    def legs(latitude, longitude):
        return np.column_stack(separation(latitude[1:], longitude[1:], latitude[:-1], longitude[:-1]))

    shown, true = legs(track.latitude, track.longitude), legs(track.true_latitude, track.true_longitude)
    ratio = np.linalg.norm(true, axis=1) / np.linalg.norm(shown, axis=1)
    turned = np.arctan2(shown[:, 1], shown[:, 0]) - np.arctan2(true[:, 1], true[:, 0])
    np.testing.assert_allclose(
        sins_error.segment_length_ratio(track.velocity, track.velocity_error), ratio, atol=2e-3
    )
    np.testing.assert_allclose(
        sins_error.segment_heading_error(track.velocity, track.velocity_error), turned, atol=2e-3
    )


def test_scale_of_a_sequence():
    shown = np.array([[[3.0, 0.0], [3.0, 0.0], [3.0, 0.0]], [[0.0, 2.0], [0.0, 4.0], [0.0, 6.0]]])
    error = np.array([[[1.0, 0.0]] * 3, [[0.0, -1.0]] * 3])
    np.testing.assert_allclose(sins_error.segment_scale(shown, error), [2 / 3, (8 + 12) / (6 + 10)])
    np.testing.assert_allclose(sins_error.segment_length_ratio(shown, error)[1], [8 / 6, 12 / 10])
    assert np.all(sins_error.segment_heading_error(shown, error) == 0.0)
    # an INS that shows east for north is a quarter turn clockwise
    east, north = np.array([[0.0, 1.0]] * 2), np.array([[1.0, 0.0]] * 2)
    np.testing.assert_allclose(sins_error.segment_heading_error(east, east - north), np.pi / 2)
    with pytest.raises(InvalidInput, match="velocity_ins"):
        sins_error.segment_scale([[1.0, 2.0]], [[1.0, 2.0]])
    with pytest.raises(InvalidInput, match="velocity_error"):
        sins_error.segment_scale(shown, error[:, :2])


def test_linear_form_moves_small_errors_like_the_nonlinear_model():
    times = VOYAGE.times(1800.0)
    transition, added = sins_linear.noise_transitions(VOYAGE, times, InsErrors())
    assert np.array_equal(transition[0], np.eye(7))
    assert not np.any(added)
    start = InsErrors(
        latitude_error=1e-6,
        longitude_error=-2e-6,
        velocity_error=(0.01, -0.02),
        attitude_error=(1e-6, 2e-6, 3e-6),
    )
    history = propagate_ins_errors(VOYAGE, start, times=times)
    x = np.array([1e-6, -2e-6, 0.01, -0.02, *history.platform_angles[0]])
    meridian, prime_vertical = principal_radii(history.latitude)
    scale = np.column_stack([meridian, prime_vertical * np.cos(history.latitude)])
    for k in range(len(times)):
        x = transition[k] @ x
        np.testing.assert_allclose(x[:2] * scale[k], history.position_error[k], atol=0.3)
        np.testing.assert_allclose(x[2:4], history.velocity_error[k], atol=3e-4)


def test_noise_covariance_is_consistent():
    """At any pair of times, by any steps: joint blocks against a chain, and long against short steps."""
    noise = InsErrors.published()
    joint = sins_linear.noise_covariance(VOYAGE, [3600.0, 9000.0, 9060.0], noise)
    whole = sins_linear.noise_covariance(VOYAGE, [9060.0], noise)
    np.testing.assert_allclose(joint[2, :, 2], whole[0, :, 0], rtol=1e-2)
    transition, _ = sins_linear.noise_transitions(VOYAGE, [3600.0, 9000.0, 9060.0], noise)
    chain = transition[2] @ transition[1] @ joint[0, :, 0]
    np.testing.assert_allclose(joint[2, :, 0], chain, rtol=1e-12)
    np.testing.assert_allclose(joint[0, :, 2], chain.T, rtol=1e-12)
    fine = sins_linear.noise_transitions(VOYAGE, [3600.0], noise, longest_step=5.0)[1]
    np.testing.assert_allclose(np.sqrt(np.diag(fine[0])), np.sqrt(np.diag(joint[0, :, 0])), rtol=1e-3)


def test_noise_covariance_against_the_nonlinear_model():
    """Squared normalised state of independent noise runs is χ² with seven degrees of freedom."""
    short, worlds = CruiseScenario(duration=7200.0), 60
    covariance = sins_linear.noise_covariance(short, [7200.0], NOISE)[0, :, 0]
    rng, total = np.random.default_rng(11), 0.0
    for _ in range(worlds):
        h = propagate_ins_errors(short, NOISE, times=[7200.0], rng=rng)
        x = np.array([h.latitude_error[0], h.longitude_error[0], *h.velocity_error[0], *h.platform_angles[0]])
        total += x @ np.linalg.solve(covariance, x)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 7 * worlds)
    assert low < total < high


def test_wrong_motions_are_refused():
    good = {
        "time": np.arange(3.0),
        "latitude": np.zeros(3),
        "velocity": np.zeros((3, 2)),
        "heading": np.zeros(3),
    }
    for name, value in (
        ("time", [0.0, 1.0, 3.0]),
        ("time", [0.0]),
        ("latitude", np.zeros(4)),
        ("velocity", np.zeros((3, 3))),
        ("heading", [0.0, np.nan, 0.0]),
    ):
        with pytest.raises(InvalidInput, match=name):
            TrueMotion(**{**good, name: value})
    with pytest.raises(InvalidInput, match="times"):
        propagate_ins_errors(TrueMotion(**good), InsErrors(), times=[5.0])


def test_divergence_is_a_fault():
    with pytest.raises(NumericalFault, match="18"):
        propagate_ins_errors(CruiseScenario(duration=60.0), InsErrors(gyro_bias=(1e308, 0.0, 0.0)))
