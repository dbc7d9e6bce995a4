"""Static poses found in simulated recordings, their averages, and what these are worth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from navopt.errors import InvalidInput
from navopt.models.pose_averages import MeanNoise, allan_variance, average_poses
from navopt.models.pose_recording import simulate_recording
from navopt.models.static_detector import detect_static, window_moments
from navopt.models.triad import AccelerometerTriad, GyroTriad

GYRO = GyroTriad([4770.0, 4760.0, 4780.0], np.eye(3), [0.01, -0.02, 0.0])
FORCE = AccelerometerTriad([414.0, 412.0, 415.0], np.eye(3), [0.5, -0.3, 0.2])


def simulated(seed, **options):
    settings = {
        "gyro": GYRO,
        "accelerometer": FORCE,
        "gyro_noise": 27.0,
        "accelerometer_noise": 3.3,
        "poses": 12,
    }
    return simulate_recording(seed, **(settings | options))


def found(recording, **options):
    return detect_static(recording.time, recording.gyro, recording.accelerometer, **options)


def test_moments_of_windows_are_those_of_numpy():
    x = 32768.0 + np.random.default_rng(1).standard_normal((60, 2)) * [3.0, 40.0]
    mean, variance = window_moments(x, 7)
    windows = np.lib.stride_tricks.sliding_window_view(x, 7, axis=0)
    assert np.allclose(mean, windows.mean(axis=2), rtol=1e-13)
    assert np.allclose(variance, windows.var(axis=2), rtol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_known_poses_are_found_and_nothing_else(seed):
    world = simulated(seed, pose_s=4.0, turn_s=1.5)
    poses = found(world.recording)
    assert len(poses) == 12
    assert poses.half_threshold == poses.double_threshold == 12
    half = poses.window // 2
    # all inside the true pose, and not more than a window shorter at either end
    assert np.all(poses.start >= world.starts)
    assert np.all(poses.stop <= world.stops)
    assert np.all(poses.start[1:] - world.starts[1:] <= half + 2)
    assert np.all(world.stops[:-1] - poses.stop[:-1] <= half + 2)
    assert world.stops[0] - 2 * poses.window <= poses.initial_stop <= world.stops[0]
    moving = np.ones(len(world.recording), dtype=bool)
    for first, end in zip(world.starts, world.stops, strict=True):
        moving[first:end] = False
    assert not np.any(poses.mask & moving)


def test_the_answer_does_not_depend_on_units():
    world = simulated(3).recording
    one = found(world)
    other = detect_static(world.time, world.gyro * 1e-4 + 5.0, world.accelerometer * 30.0)
    assert np.array_equal(one.start, other.start)
    assert np.array_equal(one.stop, other.stop)


def test_a_turn_about_the_vertical_is_seen_by_the_gyros():
    rng = np.random.default_rng(5)
    n = 6000
    gyro, force = 27.0 * rng.standard_normal((n, 3)), 3.3 * rng.standard_normal((n, 3)) + [0, 0, 4060]
    phase = np.linspace(0, 2 * np.pi, 300)
    gyro[3000:3300, 2] += 4770 * np.radians(20.0) * (1 - np.cos(phase))
    poses = detect_static(0.01 * np.arange(n), gyro, force)
    assert len(poses) == 2
    assert poses.stop[0] < 3020
    assert poses.start[1] > 3280


def test_poses_end_at_gaps_and_short_ones_are_left_out():
    world = simulated(6, pose_s=6.0).recording
    time = world.time.copy()
    middle = int(world.time.searchsorted(32.0))
    time[middle:] += 5.0
    poses = detect_static(time, world.gyro, world.accelerometer)
    assert not np.any((poses.start < middle) & (poses.stop > middle))
    assert len(found(world, shortest_pose_s=5.8)) == 1


def test_a_recording_that_begins_with_movement_is_refused():
    world = simulated(7, initial_s=20.0)
    with pytest.raises(InvalidInput, match="still for 20 s"):
        found(world.recording.between(16.5))
    with pytest.raises(InvalidInput, match="moved there"):
        found(world.recording.between(19.0))
    with pytest.raises(InvalidInput, match=r"--initial-static.*moved there"):
        found(world.recording, initial_static_s=30.0)
    # moving all the time at first, evenly: the later poses give it away
    shaking = world.recording.gyro.copy()
    shaking[:1900] += 400 * np.random.default_rng(1).standard_normal((1900, 3))
    with pytest.raises(InvalidInput, match="moved there"):
        detect_static(world.recording.time, shaking, world.recording.accelerometer, initial_static_s=18.0)
    for settings in ({"initial_static_s": 2.0}, {"threshold": 0.5}, {"window_s": 0.0}):
        with pytest.raises(InvalidInput):
            found(world.recording, **settings)
    with pytest.raises(InvalidInput, match="windows"):
        found(world.recording.between(0.0, 3.0))


def test_coarse_samples_do_not_stop_it():
    world = simulated(8).recording
    coarse = np.round(world.accelerometer / 64) * 64
    poses = detect_static(world.time, np.round(world.gyro / 256) * 256, coarse)
    assert len(poses) == 12


def test_allan_variance_is_that_of_its_definition():
    x = np.random.default_rng(9).standard_normal((50, 1)).cumsum(axis=0)
    size = 4
    total = 0.0
    for k in range(50 - 2 * size + 1):
        total += (x[k + size : k + 2 * size].mean() - x[k : k + size].mean()) ** 2
    assert allan_variance(x, size)[0] == pytest.approx(0.5 * total / (50 - 2 * size + 1), rel=1e-12)
    with pytest.raises(InvalidInput):
        allan_variance(x, 26)


def test_error_of_a_mean_of_white_and_of_slow_noise():
    """Means over 5 s of noise that is partly a slow Markov process: the stated error against what happens."""
    rng = np.random.default_rng(10)
    interval, per_mean, runs = 0.02, 250, 300
    spread, stated = {"white": [], "slow": []}, {"white": [], "slow": []}
    for kind in spread:
        for _ in range(runs):
            x = rng.standard_normal(2500 + per_mean)
            if kind == "slow":
                # correlated over 20 s, with a fifth of the white noise's size
                a = np.exp(-interval / 20.0)
                x = x + lfilter([0.2 * np.sqrt(1 - a**2)], [1.0, -a], rng.standard_normal(x.size))
            noise = MeanNoise.of(x[:2500, None], interval)
            stated[kind].append(noise.variance(per_mean * interval)[0])
            # what a mean differs by from its neighbour, over the root of two
            spread[kind].append(0.5 * (x[2500:].mean() - x[2500 - per_mean : 2500].mean()) ** 2)
    for kind in spread:
        ratio = np.mean(spread[kind]) / np.mean(stated[kind])
        # sum of 300 squares over 300, band of 0.001 / 2, and 25 % for the scatter of what is stated
        low, high = chi2.ppf([0.00025, 0.99975], runs) / runs
        assert 0.75 * low < ratio < 1.25 * high, (kind, ratio)
    # with noise taken for white, the slow one would be understated by far
    assert np.mean(spread["slow"]) > 1.5 / per_mean


def test_averages_and_their_errors():
    """Means of simulated poses against the noise-free ones: (error / sigma)^2, with a band of 0.001."""
    squares = []
    for seed in range(10):
        noisy, clean = simulated(seed), simulated(seed, gyro_noise=0.0, accelerometer_noise=0.0)
        poses = found(noisy.recording)
        one = average_poses(noisy.recording.time, noisy.recording.gyro, noisy.recording.accelerometer, poses)
        assert one.left_out == 0
        force = clean.recording.accelerometer[one.start]
        squares.append(((one.accelerometer - force) / one.accelerometer_sigma) ** 2)
        squares.append(((one.gyro - clean.recording.gyro[one.start]) / one.gyro_sigma) ** 2)
    values = np.concatenate(squares).ravel()
    low, high = chi2.ppf([0.0005, 0.9995], values.size) / values.size
    # the fit of the noise can only add to it: a fifth more is allowed for
    assert low / 1.4 < values.mean() < high
    assert len(one) == 12


def test_a_pose_that_drifts_is_left_out():
    world = simulated(11, pose_s=8.0)
    recording = world.recording
    force = recording.accelerometer.copy()
    part = slice(world.starts[4], world.stops[4])
    # 60 counts in 8 s, 0.15 m/s2: less than the noise in any window of a second
    force[part, 1] += np.linspace(0.0, 60.0, world.stops[4] - world.starts[4])
    poses = detect_static(recording.time, recording.gyro, force)
    assert len(poses) == 12
    averages = average_poses(recording.time, recording.gyro, force, poses)
    assert averages.left_out == 1
    assert len(averages) == 11
    assert world.starts[4] not in [int(s) - int(s) % 100 for s in averages.start]
