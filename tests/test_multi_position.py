"""Triads from static poses and from the rotations between them: exact cases, honest sigmas, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import EARTH_RATE
from navopt.models.gyro_bias import static_gyro_bias
from navopt.models.multi_position import (
    PARAMETER_SETS,
    calibrate_accelerometer,
    calibrate_gyro_earth_rate,
    sphere_start,
)
from navopt.models.one_position import one_position
from navopt.models.pose_averages import average_poses
from navopt.models.pose_recording import simulate_recording
from navopt.models.pose_rotation import calibrate_gyro_rotation, integrate_rotations
from navopt.models.positions import earth_rate, scattered_positions, specific_force
from navopt.models.static_detector import detect_static
from navopt.models.triad import PARAMETER_NAMES, AccelerometerTriad, GyroTriad
from navopt.models.triad_fit import triad_jacobian, undetermined

G = 9.81


def band(count, checks):
    """Interval of a mean of squares of `count` standard normal numbers, false alarm 0.001 / checks."""
    half = 0.0005 / checks
    return chi2.ppf([half, 1.0 - half], count) / count


def directions(count, seed):
    return Rotation.random(count, random_state=np.random.default_rng(seed)).apply([0.0, 0.0, 1.0])


def accelerometers(seed):
    rng = np.random.default_rng(seed)
    return AccelerometerTriad(
        414 * (1 + 0.02 * rng.standard_normal(3)),
        np.eye(3) + np.tril(0.02 * rng.standard_normal((3, 3)), -1),
        0.5 * rng.standard_normal(3),
    )


def gyros(seed):
    rng = np.random.default_rng(seed + 1000)
    return GyroTriad(
        4770 * (1 + 0.02 * rng.standard_normal(3)),
        np.eye(3) + (1 - np.eye(3)) * 0.02 * rng.standard_normal((3, 3)),
        0.02 * rng.standard_normal(3),
    )


def test_jacobian_is_that_of_differences():
    triad = gyros(3)
    counts = np.random.default_rng(1).standard_normal((5, 3)) * 3000
    exact = triad_jacobian(triad, triad.inverse(counts), PARAMETER_NAMES)
    for k, name in enumerate(PARAMETER_NAMES):
        value = triad.vector[k]
        step = 1e-6 * max(abs(value), 1.0)
        change = [triad.replace(**{name: value + s * step}).inverse(counts) for s in (1, -1)]
        assert np.allclose(exact[:, :, k], (change[0] - change[1]) / (2 * step), rtol=1e-6, atol=1e-9), name


@pytest.mark.parametrize("seed", range(5))
def test_nine_parameters_without_noise(seed):
    true = accelerometers(seed)
    counts = true.forward(G * directions(12, seed))
    fit = calibrate_accelerometer(counts, G, np.full((12, 3), 1e-9))
    assert np.allclose(fit.triad.vector, true.vector, rtol=1e-9, atol=1e-10)
    assert np.abs(fit.after).max() < 1e-11
    assert np.abs(fit.before).max() > 0.01
    assert fit.names == PARAMETER_SETS["frame"]


def test_the_same_as_scipy_on_the_norm_itself():
    """Another parametrisation, another residual and scipy's own Jacobian find the same minimum."""
    rng = np.random.default_rng(5)
    counts = accelerometers(5).forward(G * directions(30, 5)) + rng.standard_normal((30, 3))

    def residual(p):
        lower = np.zeros((3, 3))
        lower[np.tril_indices(3)] = p[:6] * 1e-3
        return (np.linalg.norm((counts - 100 * p[6:]) @ lower.T, axis=1) - G) / 0.0024

    other = least_squares(residual, [2.4, 0, 2.4, 0, 0, 2.4, 0, 0, 0], method="lm", x_scale="jac", xtol=1e-14)
    lower = np.zeros((3, 3))
    lower[np.tril_indices(3)] = other.x[:6] * 1e-3
    expected = AccelerometerTriad.from_matrix(np.linalg.inv(lower), 100 * other.x[6:])
    fit = calibrate_accelerometer(counts, G, np.ones((30, 3)))
    # the weights differ by some per cent with the direction
    apart = np.abs(fit.triad.vector - expected.vector)[[PARAMETER_NAMES.index(n) for n in fit.names]]
    assert np.all(apart < 0.1 * np.array(list(fit.sigma.values())))


def test_errors_of_accelerometers_follow_their_sigmas():
    """200 worlds: squares of error over sigma of nine parameters, and the residuals' chi square."""
    worlds, poses = 200, 24
    ratios, squares, sandwich = [], [], []
    for seed in range(worlds):
        true = accelerometers(seed)
        noise = 0.4 * np.random.default_rng(seed + 7).standard_normal((poses, 3))
        counts = true.forward(G * directions(poses, seed)) + noise
        fit = calibrate_accelerometer(counts, G, np.full((poses, 3), 0.4))
        error = [
            fit.values[n] - v for n, v in zip(PARAMETER_NAMES, true.vector, strict=True) if n in fit.names
        ]
        # the stated covariance without the factor from the residuals is what has a law
        order = [PARAMETER_SETS["frame"].index(n) for n in PARAMETER_NAMES if n in fit.names]
        sigma = np.sqrt(np.diag(fit.covariance))[order] / fit.excess
        ratios.append((np.array(error) / sigma) ** 2)
        squares.append(fit.chi_square / fit.degrees_of_freedom)
        sandwich.append((fit.sandwich[order] / sigma) ** 2)
    low, high = band(worlds, 10)
    means = np.mean(ratios, axis=0)
    assert np.all((low < means) & (means < high)), means
    low, high = band(worlds * (poses - 9), 10)
    assert low < np.mean(squares) < high
    # HC3 errs on the large side when poses are few: 15 of 24 equations are left
    assert np.all((np.mean(sandwich, axis=0) > 0.8) & (np.median(sandwich, axis=0) < 2.5))


def test_fewer_parameters_need_fewer_poses():
    true = AccelerometerTriad([410.0, 414.0, 418.0], np.eye(3), [0.3, -0.2, 0.1])
    six = np.concatenate([np.eye(3), -np.eye(3)])
    sigma = np.full((6, 3), 0.01)
    fit = calibrate_accelerometer(true.forward(G * six), G, sigma, estimated="scale-bias")
    assert np.allclose(fit.triad.vector, true.vector, rtol=1e-9, atol=1e-9)
    shifted = AccelerometerTriad([410.0, 414.0, 418.0], np.eye(3), [0.0, 0.0, 0.0])
    four = calibrate_accelerometer(true.forward(G * six[:4]), G, sigma[:4], estimated="bias", nominal=shifted)
    assert np.allclose(four.triad.vector, true.vector, rtol=1e-9, atol=1e-9)
    with pytest.raises(InvalidInput, match=r"6 static poses for 9 parameters.*misalignment_zy"):
        calibrate_accelerometer(true.forward(G * six), G, sigma)
    with pytest.raises(UnknownName, match="scale-bias"):
        calibrate_accelerometer(true.forward(G * six), G, sigma, estimated="scales")


def test_coplanar_poses_name_what_they_leave_open():
    angle = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
    plane = np.stack([np.cos(angle), np.sin(angle), np.zeros(16)], axis=1)
    plane[:, 2] = 0.01 * np.random.default_rng(1).standard_normal(16)
    plane /= np.linalg.norm(plane, axis=1, keepdims=True)
    counts = accelerometers(2).forward(G * plane)
    with pytest.raises(InvalidInput, match=r"one plane.*scale_z.*with the z axis up") as error:
        calibrate_accelerometer(counts, G, np.full((16, 3), 0.5))
    # what turns about z do determine is not among them
    assert "scale_x" not in str(error.value)
    assert "misalignment_yx" not in str(error.value)


def test_undetermined_parameters_of_an_exactly_blind_direction():
    jacobian = np.array([[1e3, 0.0, 1e3], [0.0, 1e3, 0.0]])
    names = ("bias_x", "bias_y", "bias_z")
    missing, covariance = undetermined(jacobian, names, np.ones(3), 1.0)
    assert missing == ("bias_x", "bias_z")
    assert covariance[1, 1] == pytest.approx(1e-6)
    assert np.isinf(covariance[0, 0])


def test_bad_numbers_are_refused():
    counts = accelerometers(1).forward(G * directions(12, 1))
    sigma = np.ones((12, 3))
    for bad in (
        {"counts": np.where(np.eye(12, 3), np.nan, counts)},
        {"sigma": 0 * sigma},
        {"sigma": sigma[:5]},
        {"gravity": -1.0},
    ):
        with pytest.raises(InvalidInput):
            calibrate_accelerometer(**({"counts": counts, "gravity": G, "sigma": sigma} | bad))
    assert np.allclose(sphere_start(100 * directions(9, 2) + [30, 20, 10], 10.0).scale, 10.0)


def test_gyros_by_the_earth_rate_without_noise():
    latitude = np.radians(40.0)
    attitudes = scattered_positions(24, 3)
    true = GyroTriad(gyros(1).scale * 1e4, gyros(1).misalignment, [1e-6, -2e-6, 3e-6])
    counts = true.forward(earth_rate(attitudes, latitude))
    nominal = GyroTriad(np.full(3, 4.77e7), np.eye(3), np.zeros(3))
    sigma = np.full((24, 3), 1e-6)
    force = specific_force(attitudes, latitude)
    whole = calibrate_gyro_earth_rate(counts, sigma, nominal, force=force, latitude=latitude)
    assert np.allclose(whole.triad.vector, true.vector, rtol=1e-8, atol=1e-12)
    # the norm alone finds the same sensors in other axes
    norm = calibrate_gyro_earth_rate(counts, sigma, nominal)
    assert np.allclose(norm.triad.vector, true.in_frame("lower-triangular").vector, rtol=1e-8, atol=1e-12)
    with pytest.raises(InvalidInput, match="Earth rate"):
        calibrate_gyro_earth_rate(counts, np.full((24, 3), 4e3), nominal)


def test_gyros_by_the_earth_rate_follow_their_sigmas():
    worlds, poses, latitude = 80, 36, np.radians(40.0)
    ratios = []
    noise = 0.05 * EARTH_RATE
    for seed in range(worlds):
        attitudes = scattered_positions(poses, seed)
        rng = np.random.default_rng(seed)
        true = GyroTriad(
            1 + 0.01 * rng.standard_normal(3),
            np.eye(3) + (1 - np.eye(3)) * 0.01 * rng.standard_normal((3, 3)),
            0.02 * EARTH_RATE * rng.standard_normal(3),
        )
        counts = true.forward(earth_rate(attitudes, latitude)) + noise * rng.standard_normal((poses, 3))
        fit = calibrate_gyro_earth_rate(
            counts, np.full((poses, 3), noise), GyroTriad(np.ones(3), np.eye(3), np.zeros(3)),
            force=specific_force(attitudes, latitude), latitude=latitude,
        )  # fmt: skip
        sigma = np.array(list(fit.sigma.values())) / fit.excess
        ratios.append(((fit.triad.vector - true.vector) / sigma) ** 2)
    low, high = band(worlds, 12)
    means = np.mean(ratios, axis=0)
    assert np.all((low < means) & (means < high)), means


def test_integration_against_closed_form_and_an_ode_solver():
    step = np.full((2, 100), 0.01)
    constant = np.broadcast_to([0.4, -1.0, 2.0], (2, 101, 3))
    attitude, _ = integrate_rotations(constant, step)
    assert np.allclose(attitude[0], Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix(), atol=1e-14)

    def rate(t):
        return np.array([2.0 * np.sin(3 * t), 1.5 * np.cos(3 * t), 0.7 + t])

    def slope(t, c):
        x, y, z = rate(t)
        return (c.reshape(3, 3) @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])).ravel()

    exact = solve_ivp(slope, (0.0, 1.0), np.eye(3).ravel(), rtol=1e-12, atol=1e-13).y[:, -1].reshape(3, 3)
    errors = []
    for count in (50, 100):
        times = np.linspace(0, 1, count + 1)
        rates = np.array([rate(t) for t in times])[None]
        found, _ = integrate_rotations(rates, np.full((1, count), 1 / count))
        with_moments, _ = integrate_rotations(rates, np.full((1, count), 1 / count), rates)
        assert np.allclose(found, with_moments, atol=1e-14)
        errors.append(np.abs(found[0] - exact).max())
    # rates are sampled, so the linear rate between them is what is left: second order
    assert errors[1] < 2e-4
    assert 3.5 < errors[0] / errors[1] < 4.5


def test_moments_are_the_derivative_of_the_rotation():
    rng = np.random.default_rng(4)
    counts = rng.standard_normal((3, 81, 3)).cumsum(axis=1) * 100
    step = np.full((3, 80), 0.01)
    step[1, 60:] = 0.0
    matrix = np.eye(3) / 1000 + 2e-5 * rng.standard_normal((3, 3))
    change = 1e-8 * rng.standard_normal((3, 3))
    attitude, moments = integrate_rotations(counts @ matrix.T, step, counts)
    moved, _ = integrate_rotations(counts @ (matrix + change).T, step)
    turned = Rotation.from_matrix(moved @ np.swapaxes(attitude, 1, 2)).as_rotvec()
    assert np.allclose(np.einsum("riab,ab->ri", moments[..., :3], change), turned, rtol=2e-3, atol=1e-9)


def calibrated(seed, **options):
    settings = {"poses": 18, "pose_s": 4.0, "turn_s": 2.0, "rate_hz": 50.0, "gravity": G} | options
    world = simulate_recording(seed, gyro=gyros(seed), accelerometer=accelerometers(seed), **settings)
    r = world.recording
    averages = average_poses(r.time, r.gyro, r.accelerometer, detect_static(r.time, r.gyro, r.accelerometer))
    force = calibrate_accelerometer(averages.accelerometer, G, averages.accelerometer_sigma)
    fit, rest = calibrate_gyro_rotation(r.time, r.gyro, r.accelerometer, averages, force.triad)
    return world, force, fit, rest


def test_gyros_by_rotations_with_hardly_any_noise():
    world, force, fit, rest = calibrated(
        1, rate_hz=200.0, gyro_noise=1e-4, accelerometer_noise=1e-4, poses=14, turn_s=3.0
    )
    assert np.allclose(force.triad.vector, world.accelerometer.vector, rtol=1e-6, atol=1e-6)
    # what is left is the linear rate between samples
    assert np.allclose(fit.triad.vector, world.gyro.vector, rtol=2e-5, atol=2e-5)
    assert np.abs(fit.after).max() < 1e-4
    assert np.abs(fit.before).max() > 1e-2
    assert not rest.force_dependent


def check_recovery(worlds):
    forces, rates, alarms = [], [], 0
    for seed in range(worlds):
        world, force, fit, rest = calibrated(seed, gyro_noise=27.0, accelerometer_noise=3.3)
        true = dict(zip(PARAMETER_NAMES, world.accelerometer.vector, strict=True))
        forces.append([(force.values[n] - true[n]) / force.sigma[n] for n in force.names])
        rates.append((fit.triad.vector - world.gyro.vector) / np.array(list(fit.sigma.values())))
        alarms += rest.force_dependent
    # one in a thousand each: more than three in 300 have a probability of 0.0003
    assert alarms <= 3
    # sigmas enlarged by the residuals only make the ratios smaller, and the noise is estimated: 10 % and 30 %
    low, high = band(worlds, 12)
    means = np.mean(np.square(rates), axis=0)
    assert np.all((0.7 * low < means) & (means < 1.1 * high)), means
    means = np.mean(np.square(forces), axis=0)
    assert np.all((0.6 * low < means) & (means < 1.1 * high)), means
    # no bias: means of the ratios, normal with 1 / worlds, 0.001 / 21
    for values in (forces, rates):
        assert np.all(np.abs(np.mean(values, axis=0)) < 4.3 / np.sqrt(worlds))


def test_simulated_recordings_are_recovered_within_sigma():
    check_recovery(20)


@pytest.mark.slow
def test_simulated_recordings_are_recovered_within_sigma_over_many_seeds():
    check_recovery(300)


def test_a_bias_that_depends_on_the_specific_force_is_found():
    world = simulate_recording(
        5, gyro=gyros(5), accelerometer=accelerometers(5), gyro_noise=27.0, accelerometer_noise=3.3,
        rate_hz=50.0, poses=24, gravity=G,
    )  # fmt: skip
    r = world.recording
    sensitivity = np.array([[0.2, 0.6, -0.8], [-1.0, 0.1, 0.5], [0.4, -0.9, 0.3]])
    gyro = r.gyro + world.accelerometer.inverse(r.accelerometer) @ sensitivity.T
    averages = average_poses(r.time, gyro, r.accelerometer, detect_static(r.time, gyro, r.accelerometer))
    force = calibrate_accelerometer(averages.accelerometer, G, averages.accelerometer_sigma)
    fit, rest = calibrate_gyro_rotation(r.time, gyro, r.accelerometer, averages, force.triad)
    assert rest.force_dependent
    assert rest.probability < 1e-6
    assert np.all(np.abs(rest.force_sensitivity - sensitivity) < 4.5 * rest.force_sensitivity_sigma)
    assert np.all(np.abs(fit.triad.vector - world.gyro.vector) < 4.5 * np.array(list(fit.sigma.values())))
    without, _ = calibrate_gyro_rotation(
        r.time, gyro, r.accelerometer, averages, force.triad, force_dependent=False
    )
    assert without.excess > 1.5 * fit.excess


def test_the_force_test_is_not_alarmed_by_noise():
    """200 recordings without such a dependence: probabilities are uniform (Kolmogorov, 0.001)."""
    from dataclasses import replace

    from scipy.stats import kstest

    world, _, _, _ = calibrated(2, gyro_noise=27.0, accelerometer_noise=3.3)
    r = world.recording
    averages = average_poses(r.time, r.gyro, r.accelerometer, detect_static(r.time, r.gyro, r.accelerometer))
    force = world.accelerometer.inverse(averages.accelerometer)
    rng = np.random.default_rng(6)
    found = []
    for _ in range(200):
        means = averages.gyro_sigma * rng.standard_normal(averages.gyro.shape)
        found.append(static_gyro_bias(replace(averages, gyro=means), force).probability)
    assert kstest(found, "uniform").pvalue > 0.001


def test_rotations_about_one_axis_name_what_they_leave_open():
    turns = [
        Rotation.from_rotvec([0.0, a, 0.0]).as_matrix() for a in (0, 1, 2.5, 0.5, -1, 1.8, 3, -2, 0.3, -0.8)
    ]
    world = simulate_recording(
        1, gyro=gyros(1), accelerometer=accelerometers(1), poses=10, attitudes=np.array(turns), rate_hz=50.0,
        gyro_noise=27.0, accelerometer_noise=3.3, gravity=G,
    )  # fmt: skip
    r = world.recording
    averages = average_poses(r.time, r.gyro, r.accelerometer, detect_static(r.time, r.gyro, r.accelerometer))
    with pytest.raises(InvalidInput, match="scale_x") as error:
        calibrate_gyro_rotation(r.time, r.gyro, r.accelerometer, averages, world.accelerometer)
    assert "scale_y" not in str(error.value)
    few = r.between(0.0, 40.0)
    part = average_poses(
        few.time, few.gyro, few.accelerometer, detect_static(few.time, few.gyro, few.accelerometer)
    )
    with pytest.raises(InvalidInput, match="usable rotations"):
        calibrate_gyro_rotation(few.time, few.gyro, few.accelerometer, part, world.accelerometer)


def test_axes_that_do_not_belong_together_are_refused():
    world, force, _, _ = calibrated(3, gyro_noise=27.0, accelerometer_noise=3.3)
    r = world.recording
    for gyro in (r.gyro[:, [1, 0, 2]], r.gyro * [1, 1, -1]):
        averages = average_poses(r.time, gyro, r.accelerometer, detect_static(r.time, gyro, r.accelerometer))
        with pytest.raises(InvalidInput, match="axes are not those"):
            calibrate_gyro_rotation(r.time, gyro, r.accelerometer, averages, force.triad)


def test_one_position_tells_three_things():
    latitude = np.radians(34.0)
    rng = np.random.default_rng(2)
    attitude = scattered_positions(1, 5)
    rate, force = earth_rate(attitude, latitude)[0], specific_force(attitude, latitude)[0]
    n = 12000
    found = one_position(
        rate + 1e-5 * rng.standard_normal((n, 3)), force + 1e-3 * rng.standard_normal((n, 3)), 0.01, latitude
    )
    assert (found.gyro_rank, found.accelerometer_rank, found.joint_rank) == (1, 1, 3)
    assert abs(found.rate_norm - EARTH_RATE) < 4.5 * found.rate_norm_sigma
    assert abs(found.vertical_rate - found.expected_vertical_rate) < 4.5 * found.vertical_rate_sigma
    assert abs(found.force_norm - found.gravity) < 4.5 * found.force_norm_sigma
    # standard errors of white noise, from twelve batches: chi square with 11, band of 0.001 / 6
    expected = np.array([1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3]) / np.sqrt(n)
    ratio = (np.concatenate([found.rate_sigma, found.force_sigma]) / expected) ** 2
    low, high = chi2.ppf([0.0005 / 6, 1 - 0.0005 / 6], 11) / 11
    assert np.all((low < ratio) & (ratio < high))
    assert "3 of all" in found.lines()[0]
    with pytest.raises(InvalidInput):
        one_position(np.ones((50, 3)), np.ones((50, 3)), 0.01, latitude)
    with pytest.raises(InvalidInput, match="radians"):
        one_position(np.ones((500, 3)), np.ones((500, 3)), 0.01, 34.0)
