"""The grid filter against Kalman's closed form and plain quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from baselines import PointMass
from baselines.particle_matching_filter import FieldSensor
from baselines.particle_matching_process import ErrorProcess, metres_per_radian, random_walk_process
from baselines.point_mass_filter import PointMassFilter
from navopt import simulate, solve
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, UnsuitableProblem
from navopt.models.field_map import FieldMap
from navopt.problems.analytic import Sphere
from navopt.problems.gravity_matching import GravityMatching

AXIS = np.linspace(-0.6, 0.6, 73)


def problem_on(values, *, noise=1.0, samples=20, seed=0, method="bilinear"):
    field_map = FieldMap.from_degrees(10.0 + AXIS, 20.0 + AXIS, values, method=method)
    lat = np.radians(10.0 + np.linspace(-0.15, 0.15, samples))
    lon = np.radians(20.0 + 0.1 * np.sin(np.linspace(0.0, 5.0, samples)))
    error = np.cumsum(np.random.default_rng(seed).normal(size=(samples, 2)) * 250.0, axis=0)
    true = np.stack([lat, lon], axis=1) - error / metres_per_radian(lat)
    measured = field_map.value(*true.T) + noise * np.random.default_rng(seed + 1000).normal(size=samples)
    track = MeasuredTrack(
        time=300.0 * np.arange(samples),
        latitude=lat,
        longitude=lon,
        measured=measured,
        true_latitude=true[:, 0],
        true_longitude=true[:, 1],
    )
    return GravityMatching(field_map, track, noise=noise, prior_covariance=np.diag([1e6, 1e6, 1e-2, 1e-2]))


def walk(samples, start=((9e4, 2e4), (2e4, 16e4)), step=((6e4, -2e4), (-2e4, 5e4))):
    return random_walk_process(300.0 * np.arange(samples), start, np.tile(np.array(step), (samples, 1, 1)))


def kalman(problem, process, measured):
    """Means, covariances and log evidence on a map that is linear, by the textbook."""
    track = problem.track
    slopes = np.stack(problem.field_map.gradient(track.latitude, track.longitude), axis=1)
    slopes = slopes / metres_per_radian(track.latitude)
    expected = problem.field_map.value(track.latitude, track.longitude)
    mean, cov = np.zeros(2), process.response[0] @ process.response[0].T
    evidence = 0.0
    for k, z in enumerate(measured):
        if k:
            cov = cov + process.walk_root[k] @ process.walk_root[k].T
        h = -slopes[k]
        s = h @ cov @ h + problem.noise**2
        innovation = z - expected[k] - h @ mean
        evidence -= 0.5 * (innovation**2 / s + np.log(2.0 * np.pi * s))
        gain = cov @ h / s
        mean, cov = mean + gain * innovation, cov - np.outer(gain, h @ cov)
        yield mean, cov, evidence


@pytest.mark.parametrize("slope", [(40.0, 25.0), (400.0, -300.0)])
@pytest.mark.parametrize("method", ["bilinear", "bicubic"])
def test_on_a_linear_field_it_is_the_kalman_filter(slope, method):
    values = slope[0] * AXIS[:, None] + slope[1] * AXIS
    problem, process = problem_on(values, method=method), walk(20)
    grid = PointMass(nodes=120).begin(problem, process=process)
    for z, (mean, cov, evidence) in zip(
        problem.track.measured, kalman(problem, process, problem.track.measured), strict=True
    ):
        grid.update(z)
        sigma = np.sqrt(np.diag(cov))
        # the least width of a grid is added to the first covariance: a metre in 300
        np.testing.assert_allclose((grid.mean() - mean) / sigma, 0.0, atol=2e-4)
        np.testing.assert_allclose(
            grid.covariance() / np.outer(sigma, sigma), cov / np.outer(sigma, sigma), atol=2e-4
        )
        assert grid.log_evidence == pytest.approx(evidence, abs=2e-3)
    latitude, longitude = grid.position()
    shift = mean / metres_per_radian(problem.track.latitude[-1:])[0]
    assert latitude == pytest.approx(problem.track.latitude[-1] - shift[0], abs=1e-9)
    assert longitude == pytest.approx(problem.track.longitude[-1] - shift[1], abs=1e-9)


def rough(seed):
    return 250.0 * gaussian_filter(np.random.default_rng(seed).normal(size=(73, 73)), 3.0)


@pytest.mark.parametrize("seed", range(3))
def test_on_a_rough_field_it_is_plain_quadrature(seed):
    """One fixed fine grid and the convolution as a matrix product."""
    problem = problem_on(rough(seed), seed=seed, samples=12)
    process = walk(12, start=np.diag([9e4, 16e4]), step=np.diag([6e4, 5e4]))
    line = np.linspace(-6000.0, 6000.0, 401)
    step = line[1] - line[0]

    def bell(variance, x=line):
        return np.exp(-0.5 * x**2 / variance) / np.sqrt(2.0 * np.pi * variance)

    density = np.outer(bell(9e4 + 1.0), bell(16e4 + 1.0))
    across = [step * bell(variance, line[:, None] - line) for variance in (6e4, 5e4)]
    metres = metres_per_radian(problem.track.latitude)
    grid = PointMass(nodes=150).begin(problem, process=process)
    evidence = 0.0
    for k, z in enumerate(problem.track.measured):
        if k:
            density = across[0] @ density @ across[1].T
        mapped = problem.field_map.value(
            problem.track.latitude[k] - line[:, None] / metres[k, 0],
            problem.track.longitude[k] - line / metres[k, 1],
        )
        density = density * bell(1.0, z - mapped)
        total = density.sum() * step**2
        density, evidence = density / total, evidence + np.log(total)
        mean = step**2 * np.array([density.sum(axis=1) @ line, density.sum(axis=0) @ line])
        grid.update(z)
        np.testing.assert_allclose(grid.mean(), mean, atol=2.0)
        variance = step**2 * (density.sum(axis=1) @ (line - mean[0]) ** 2)
        assert grid.covariance()[0, 0] == pytest.approx(variance, rel=5e-3)
        assert grid.log_evidence == pytest.approx(evidence, abs=5e-3)
    assert grid.grids >= 2


def test_finer_grids_agree():
    problem = simulate("gravity-matching", 3, hours=3.0)
    errors = []
    for nodes in (120, 240):
        grid = PointMass(nodes=nodes).begin(problem)
        for z in problem.track.measured:
            grid.update(z)
        errors.append(grid.mean())
    np.testing.assert_allclose(*errors, atol=2.0)


def test_a_skipped_measurement_only_widens_the_density():
    problem, process = problem_on(rough(1)), walk(20)
    grid = PointMass(nodes=80).begin(problem, process=process)
    for _ in range(20):
        grid.skip()
    total = process.covariance()[-2:, -2:]
    np.testing.assert_allclose(grid.covariance(), total, rtol=2e-4)
    np.testing.assert_allclose(grid.mean(), 0.0, atol=0.05)
    assert grid.log_evidence == 0.0
    with pytest.raises(InvalidInput, match="begin again"):
        grid.skip()


def test_one_by_one_is_the_same_as_at_once():
    problem = simulate("gravity-matching", 1, hours=2.0)
    grid = PointMass(nodes=60).begin(problem)
    for z in problem.track.measured:
        grid.update(z)
    answer = solve(problem, PointMass(nodes=60))
    assert grid.position() == (answer.estimate.latitude[-1], answer.estimate.longitude[-1])
    np.testing.assert_array_equal(answer.estimate.covariance, grid.covariance())
    assert answer.counts.internal == -(-grid.looked_up // problem.window)
    assert answer.estimate.bimodality == pytest.approx(grid.bimodality())
    assert 1.0 < answer.estimate.effective_sample_size < 3600.0


@pytest.mark.parametrize("budget", [35, 60, 140, 400, 2000, 3335, 20000])
def test_budgets_buy_nodes_and_then_measurements(budget):
    problem = simulate("gravity-matching", 1, hours=2.0)  # 25 samples
    answer = solve(problem, "point-mass", budget=budget)
    assert answer.counts.cost <= budget
    nodes = round(np.sqrt(answer.estimate.particles))
    assert nodes == {35: 20, 60: 26, 140: 40, 400: 40, 2000: 40, 3335: 40, 20000: 97}[budget]
    used = answer.counts.internal * problem.window / nodes**2
    assert used == pytest.approx(
        {35: 1, 60: 1, 140: 1, 400: 2, 2000: 13, 3335: 25, 20000: 25}[budget], abs=0.05
    )
    with pytest.raises(InvalidInput, match="at least 35"):
        solve(problem, "point-mass", budget=34)


def test_off_the_map_a_measurement_says_nothing():
    problem, process = problem_on(rough(1)), walk(20, start=np.diag([1e4, 1e4]))
    sensor = FieldSensor.of(problem)
    away = FieldSensor(sensor.latitude + 0.2, sensor.longitude, sensor.field, sensor.noise)
    grid = PointMassFilter(process, away, nodes=30)
    before = grid.density
    grid.update(3.0)
    np.testing.assert_array_equal(grid.density, before)


def test_what_it_cannot_take_is_refused():
    problem = problem_on(rough(1))
    response = np.random.default_rng(0).normal(size=(20, 2, 3))
    with pytest.raises(InvalidInput, match="random_walk_process"):
        PointMass().begin(problem, process=ErrorProcess(problem.track.time, response))
    sensor = FieldSensor.of(problem, bias=1.0)
    with pytest.raises(InvalidInput, match="bias"):
        PointMassFilter(walk(20), sensor, nodes=20)
    grid = PointMass(nodes=20).begin(problem, process=walk(20))
    with pytest.raises(InvalidInput, match="finite"):
        grid.update(np.nan)
    with pytest.raises(InvalidInput, match="sigmas"):
        PointMass(sigmas=1.0)
    with pytest.raises(InvalidInput, match="nodes"):
        PointMass(nodes=10)
    with pytest.raises(UnsuitableProblem, match="track"):
        solve(Sphere([1.0, 2.0]), "point-mass")


def test_walks_that_are_none_are_refused():
    with pytest.raises(InvalidInput, match="initial_covariance"):
        random_walk_process([0.0, 1.0], np.eye(3), np.zeros((2, 2, 2)))
    with pytest.raises(InvalidInput, match="walk_covariance"):
        random_walk_process([0.0, 1.0], np.eye(2), np.zeros((3, 2, 2)))
    with pytest.raises(InvalidInput, match="walk_covariance"):
        random_walk_process([0.0, 1.0], np.eye(2), np.tile(np.diag([1.0, -1.0]), (2, 1, 1)))
    with pytest.raises(InvalidInput, match="initial_covariance"):
        random_walk_process([0.0, 1.0], [[1.0, 0.5], [0.0, 1.0]], np.zeros((2, 2, 2)))
