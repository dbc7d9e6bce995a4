"""The particle filter against closed forms, the grid filter, and the covariance of INS errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.ndimage import gaussian_filter

from baselines import ParticleMatching, PointMass
from baselines.particle_matching_filter import FieldSensor, ParticleFilter, bimodality
from baselines.particle_matching_kernels import systematic
from baselines.particle_matching_process import (
    ErrorProcess,
    inertial_process,
    metres_per_radian,
    random_walk_process,
)
from navopt import Solution, simulate, solve
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, UnknownName, UnsuitableProblem
from navopt.models import CruiseScenario, InsErrors, position_error_covariance
from navopt.models.field_map import FieldMap
from navopt.problems.analytic import Sphere
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gravity_sensing import MeasurementErrors

AXIS = np.linspace(-0.6, 0.6, 73)
#: Chance of a false alarm of a family of checks.
ALARM = 1e-3


def problem_on(values, *, samples=15, seed=0, noise=1.0):
    field_map = FieldMap.from_degrees(10.0 + AXIS, 20.0 + AXIS, values)
    lat = np.radians(10.0 + np.linspace(-0.15, 0.15, samples))
    lon = np.radians(20.0 + 0.1 * np.sin(np.linspace(0.0, 5.0, samples)))
    error = np.cumsum(np.random.default_rng(seed).normal(size=(samples, 2)) * 250.0, axis=0)
    true = np.stack([lat, lon], axis=1) - error / metres_per_radian(lat)
    measured = field_map.value(*true.T) + noise * np.random.default_rng(seed + 1000).normal(size=samples)
    track = MeasuredTrack(time=300.0 * np.arange(samples), latitude=lat, longitude=lon, measured=measured)
    return GravityMatching(field_map, track, noise=noise, prior_covariance=np.diag([1e6, 1e6, 1e-2, 1e-2]))


def rough(seed):
    return 250.0 * gaussian_filter(np.random.default_rng(seed).normal(size=(73, 73)), 3.0)


# -- parts -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_systematic_resampling_keeps_each_share_to_the_next_whole_number(seed):
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.full(40, 0.3))
    out, shares = np.empty(40, dtype=np.int64), np.zeros(40)
    shifts = (np.arange(2000) + 0.5) / 2000
    for shift in shifts:
        systematic(weights, shift, out)
        counts = np.bincount(out, minlength=40)
        assert (np.abs(counts - 40 * weights) < 1.0 + 1e-9).all()
        shares += counts
    # over all shifts the shares are exact: a quadrature with 2000 nodes misses a step by one of them at most
    np.testing.assert_allclose(shares / 2000, 40 * weights, atol=2.0 / 2000 * 2)


def test_bimodality_of_known_shapes():
    rng = np.random.default_rng(2)
    even = np.full(200_000, 1.0 / 200_000)
    turned = np.array([[0.8, -0.6], [0.6, 0.8]]) @ np.diag([9.0, 2.0])
    # standard error of the statistic for 200,000 points: about 0.002
    assert bimodality(rng.normal(size=(200_000, 2)) @ turned.T, even) == pytest.approx(2.0 / np.pi, abs=0.01)
    flat = rng.uniform(-1.0, 1.0, (200_000, 2)) * [5.0, 1.0]
    assert bimodality(flat, even) == pytest.approx(0.75, abs=0.01)
    apart = rng.normal(size=(1000, 2)) + np.where(np.arange(1000) < 300, 100.0, 0.0)[:, None]
    assert bimodality(apart, np.full(1000, 1e-3)) > 0.99
    assert bimodality(np.ones((5, 2)), np.full(5, 0.2)) == 0.0
    # weights count: the far group without any leaves a normal
    weights = np.where(np.arange(1000) < 300, 0.0, 1.0 / 700)
    assert bimodality(apart, weights) == pytest.approx(2.0 / np.pi, abs=0.1)


@pytest.mark.parametrize("hours", [3.0, 10.0])
def test_the_inertial_process_has_the_covariance_of_ins_errors(hours):
    """Against strapdown runs with one source each, and the Lyapunov equation for the noise."""
    voyage = CruiseScenario(duration=hours * 3600.0)
    times = voyage.times(900.0)[1:]
    lat, lon = voyage.position(times)
    track = MeasuredTrack(time=times, latitude=lat, longitude=lon, measured=np.zeros(len(times)))
    expected = position_error_covariance(voyage, times, InsErrors.published())
    # the process begins at its first sample, a quarter of an hour after departure: one sample more
    whole = MeasuredTrack(
        time=np.append(0.0, times),
        latitude=np.append(voyage.latitude, lat),
        longitude=np.append(voyage.longitude, lon),
        measured=np.zeros(len(times) + 1),
    )
    process = inertial_process(whole, InsErrors.published(), negligible=0.0)
    found = process.covariance()[2:, 2:]
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=0.02)
    assert track.time[0] == 900.0


def test_the_random_walk_has_its_covariance():
    steps = np.random.default_rng(1).normal(size=(5, 2, 2))
    steps = steps @ steps.transpose(0, 2, 1)
    process = random_walk_process(np.arange(5.0), np.diag([4.0, 9.0]), steps)
    covariance = process.covariance()
    for j in range(5):
        for k in range(5):
            expected = np.diag([4.0, 9.0]) + steps[1 : min(j, k) + 1].sum(axis=0)
            np.testing.assert_allclose(covariance[2 * j : 2 * j + 2, 2 * k : 2 * k + 2], expected, atol=1e-12)


def test_linearisation_midway_fits_the_true_error_better():
    """What 7 hours of a drawn INS need in standard deviations to be told to a hundred metres."""
    world = simulate("gravity-matching", 2, hours=7.0)
    track = world.track
    scale = metres_per_radian(track.latitude)
    error = (
        np.stack([track.latitude - track.true_latitude, track.longitude - track.true_longitude], 1) * scale
    )

    def told(process):
        """Coefficients that tell the error to a hundred metres, and the rms of what they leave, m."""
        columns = process.response.reshape(error.size, -1)
        square = columns.T @ columns / 100.0**2 + np.eye(columns.shape[1])
        a = np.linalg.solve(square, columns.T @ error.ravel() / 100.0**2)
        return a, float(np.sqrt(2.0 * np.mean((error.ravel() - columns @ a) ** 2)))

    process = inertial_process(track, InsErrors.published())
    a, left = told(process)
    # linear about a track that is kilometres off, this INS looks like none of its make
    assert a @ a > stats.chi2.isf(ALARM, len(a))
    for _ in range(3):
        process = process.about(a)
        a, left = told(process)
    assert a @ a < stats.chi2.isf(ALARM, len(a))
    assert left < 100.0


# -- against closed forms ----------------------------------------------------------------------------------


def linear_model(samples=15):
    """A map that is linear, an error of five sources, and an offset that one of them adds."""
    rng = np.random.default_rng(8)
    values = 60.0 * AXIS[:, None] + 35.0 * AXIS
    problem = problem_on(values, samples=samples)
    growth = np.linspace(0.2, 1.0, samples)[:, None, None] ** np.array([0.0, 0.0, 1.0, 1.0, 2.0])
    process = ErrorProcess(
        problem.track.time,
        np.ascontiguousarray(400.0 * growth * rng.normal(size=(2, 5))),
        None,
        np.ascontiguousarray(np.outer(np.linspace(0.0, 1.0, samples), [0.0, 0.0, 0.0, 0.0, 1.5])),
    )
    return problem, process


def regression(problem, process, bias):
    """Posterior mean and covariance of the last position error, and the evidence, in closed form."""
    track = problem.track
    slopes = np.stack(problem.field_map.gradient(track.latitude, track.longitude), axis=1)
    slopes = slopes / metres_per_radian(track.latitude)
    design = process.offset - np.einsum("ki,kis->ks", slopes, process.response)
    residual = track.measured - problem.field_map.value(track.latitude, track.longitude)
    n = len(residual)
    noise = problem.noise**2 * np.eye(n) + bias**2 * np.ones((n, n))
    information = design.T @ np.linalg.solve(noise, design) + np.eye(design.shape[1])
    covariance = np.linalg.inv(information)
    mean = covariance @ design.T @ np.linalg.solve(noise, residual)
    last = process.response[-1]
    evidence = stats.multivariate_normal(np.zeros(n), noise + design @ design.T).logpdf(residual)
    return last @ mean, last @ covariance @ last.T, evidence


@pytest.mark.parametrize("bias", [0.0, 2.0])
@pytest.mark.parametrize("rejuvenation", ["moves", "kernel", "none"])
def test_on_a_linear_field_it_is_the_bayesian_regression(bias, rejuvenation):
    """Forty seeds: means without bias, spread as expected, and the evidence unbiased."""
    problem, process = linear_model()
    mean, covariance, evidence = regression(problem, process, bias)
    sensor = FieldSensor.of(problem, bias=bias)
    means, variances, evidences = [], [], []
    for seed in range(40):
        particles = ParticleFilter(
            process, sensor, particles=1000, rng=np.random.default_rng(seed), rejuvenation=rejuvenation
        )
        for z in problem.track.measured:
            particles.update(z)
        means.append(particles.weights @ particles.errors(14))
        variances.append(particles.covariance())
        evidences.append(particles.log_evidence)
    sigma = np.sqrt(np.diag(covariance))
    gap = (np.array(means) - mean) / sigma
    checks = 5
    limit = stats.t.isf(ALARM / checks / 2, 39)
    if rejuvenation == "kernel" and bias:
        # the sums of a particle are not renewed by the kernel, so the marginalised offset is approximate
        limit, gap, variances = np.inf, 0.5 * gap, [covariance]
    assert (np.abs(gap.mean(axis=0)) < limit * gap.std(axis=0, ddof=1) / np.sqrt(40) + 0.02).all()
    assert gap.std(axis=0).max() < 0.35
    np.testing.assert_allclose(np.mean(variances, axis=0)[0, 0] / covariance[0, 0], 1.0, atol=0.15)
    if rejuvenation != "kernel":
        ratio = np.exp(np.array(evidences) - evidence)
        assert abs(ratio.mean() - 1.0) < limit * ratio.std(ddof=1) / np.sqrt(40)


@pytest.mark.parametrize("rejuvenation", ["none", "moves"])
@pytest.mark.parametrize("seed", [0, 3])
def test_in_two_dimensions_it_is_the_grid_filter(rejuvenation, seed):
    """A rough field, a random walk: mean and variance of the last position over thirty seeds."""
    problem = problem_on(rough(seed), seed=seed)
    step = np.array([[6e4, -2e4], [-2e4, 5e4]])
    process = random_walk_process(problem.track.time, np.diag([9e4, 16e4]), np.tile(step, (15, 1, 1)))
    grid = PointMass(nodes=150).begin(problem, process=process)
    for z in problem.track.measured:
        grid.update(z)
    means, variances, evidences = [], [], []
    solver = ParticleMatching.bootstrap(particles=2000, rejuvenation=rejuvenation, moves=1)
    for run in range(30):
        particles = solver.begin(problem, seed=run, process=process)
        for z in problem.track.measured:
            particles.update(z)
        means.append(particles.weights @ particles.errors(14))
        variances.append(np.diag(particles.covariance()))
        evidences.append(particles.log_evidence)
    assert particles.resampled > 2
    sigma = np.sqrt(np.diag(grid.covariance()))
    limit = stats.t.isf(ALARM / 5 / 2, 29)
    gap = (np.array(means) - grid.mean()) / sigma
    assert (np.abs(gap.mean(axis=0)) < limit * gap.std(axis=0, ddof=1) / np.sqrt(30)).all()
    assert gap.std(axis=0).max() < 0.3
    # a variance from P particles with fewer distinct ones is a little small: one part in a hundred
    ratio = np.array(variances) / sigma**2
    assert (np.abs(ratio.mean(axis=0) - 1.0) < limit * ratio.std(axis=0, ddof=1) / np.sqrt(30) + 0.01).all()
    weight = np.exp(np.array(evidences) - grid.log_evidence)
    assert abs(weight.mean() - 1.0) < limit * weight.std(ddof=1) / np.sqrt(30)


# -- real worlds -------------------------------------------------------------------------------------------


def test_it_is_much_better_than_the_inertial_system_alone():
    better = 0
    for seed in range(8):
        world = simulate("gravity-matching", seed, hours=3.0)
        errors = [
            solve(world, solver).scores["position_error_m"]
            for solver in (ParticleMatching(particles=400), "nominal")
        ]
        better += errors[0] < 0.5 * errors[1]
    assert better >= 7  # seven of eight by chance: 3.5 % even if only half of the error were noise


@pytest.mark.slow
def test_its_covariance_is_consistent_at_three_hours():
    """Normalised errors squared of forty worlds, summed, against chi-square."""
    total = 0.0
    for seed in range(40):
        world = simulate("gravity-matching", 100 + seed, hours=3.0)
        found = solve(world, ParticleMatching()).estimate
        at = np.array(
            [found.latitude[-1] - world.truth.latitude[-1], found.longitude[-1] - world.truth.longitude[-1]]
        )
        error = at * metres_per_radian(found.latitude[-1:])[0]
        total += error @ np.linalg.solve(found.covariance, error)
    assert stats.chi2.ppf(ALARM / 2, 80) < total < stats.chi2.isf(ALARM / 2, 80)


def test_an_eotvos_effect_and_a_drift_are_part_of_the_measurement():
    world = simulate("gravity-matching", 1, hours=3.0)
    plain = inertial_process(world.track, InsErrors.published())
    sensing = MeasurementErrors(noise=1.0, drift_per_day=24.0, eotvos=True)
    process = inertial_process(world.track, InsErrors.published(), sensing=sensing)
    sources = plain.response.shape[-1]
    np.testing.assert_array_equal(process.response[..., :sources], plain.response)
    assert process.response.shape[-1] == sources + 1
    np.testing.assert_array_equal(process.response[..., -1], 0.0)
    np.testing.assert_allclose(process.offset[:, -1], (world.track.time - world.track.time[0]) / 3600.0)
    # 14.58 cos(latitude) mGal for each m/s of eastward velocity error, the rate of the position error
    rate = np.gradient(plain.response[:, 1], world.track.time, axis=0)
    expected = 14.584 * np.cos(world.track.latitude)[:, None] * rate
    # differences over ten minutes blur the slowest velocities a little
    np.testing.assert_allclose(
        process.offset[2:-2, :3], expected[2:-2, :3], atol=0.03 * np.abs(expected[:, :3]).max()
    )
    assert plain.offset is None


def test_one_by_one_is_the_same_as_at_once():
    world = simulate("gravity-matching", 4, hours=2.0)
    solver = ParticleMatching(particles=200)
    particles = solver.begin(world, seed=5)
    fixes = []
    for z in world.track.measured:
        particles.update(z)
        fixes.append(particles.position())
    answer = solve(world, solver, seed=5)
    np.testing.assert_allclose(
        fixes[-1], [answer.estimate.latitude[-1], answer.estimate.longitude[-1]], rtol=1e-14
    )
    np.testing.assert_array_equal(answer.estimate.covariance, particles.covariance())
    assert answer.counts.internal == -(-particles.looked_up // world.window)
    assert answer.estimate.log_evidence == particles.log_evidence
    assert len(answer.estimate.latitude) == world.window
    # the first fixes are the prior's: the INS itself, to a few hundred metres
    at = (np.array(fixes[0]) - [world.track.latitude[0], world.track.longitude[0]]) * 6.4e6
    assert np.abs(at).max() < 300.0
    with pytest.raises(InvalidInput, match="25 samples"):
        particles.update(0.0)


def test_the_best_particle_is_the_one_of_the_greatest_density():
    problem, process = linear_model()
    particles = ParticleFilter(
        process,
        FieldSensor.of(problem),
        particles=500,
        rng=np.random.default_rng(1),
        rejuvenation="none",
        threshold=1e-9,
    )
    for z in problem.track.measured:
        particles.update(z)
    places = [particles.errors(k) / metres_per_radian(problem.track.latitude[k : k + 1]) for k in range(15)]
    mapped = np.array([
        problem.field_map.value(problem.track.latitude[k] - p[:, 0], problem.track.longitude[k] - p[:, 1])
        for k, p in enumerate(places)
    ])  # fmt: skip
    residual = problem.track.measured[:, None] - mapped - process.offset @ particles.sources.T
    density = -0.5 * (residual**2).sum(axis=0) - 0.5 * (particles.sources**2).sum(axis=1)
    assert particles.best() == np.argmax(density)
    # and the weights are the likelihoods
    log = -0.5 * (residual**2).sum(axis=0)
    np.testing.assert_allclose(
        particles.weights, np.exp(log - log.max()) / np.exp(log - log.max()).sum(), rtol=1e-9
    )
    assert particles.effective_sample_size == pytest.approx(1.0 / np.sum(particles.weights**2))


def test_off_the_map_a_measurement_says_nothing():
    problem, process = linear_model()
    sensor = FieldSensor.of(problem)
    away = FieldSensor(sensor.latitude + 0.2, sensor.longitude, sensor.field, sensor.noise)
    particles = ParticleFilter(process, away, particles=50, rng=np.random.default_rng(1))
    particles.update(3.0)
    np.testing.assert_allclose(particles.weights, 1.0 / 50)
    assert particles.log_evidence == 0.0
    # some off the map: they are lost, the others go on
    edge = problem.field_map.latitude[-1] - problem.track.latitude[0]
    near = FieldSensor(sensor.latitude + edge, sensor.longitude, sensor.field, sensor.noise)
    particles = ParticleFilter(process, near, particles=200, rng=np.random.default_rng(1), threshold=1e-9)
    particles.update(float(problem.field_map.values[-1, 36]))
    gone = particles.errors(0)[:, 0] < -1.0
    assert 20 < gone.sum() < 180
    assert (particles.weights[gone] == 0.0).all()


@pytest.mark.parametrize(
    "settings", [{}, {"rejuvenation": "kernel"}, {"passes": 2}, {"answer": "best"}, {"model": "random-walk"}]
)
@pytest.mark.parametrize("budget", [120, 400, 3000])
def test_the_budget_is_never_exceeded(settings, budget):
    world = simulate("gravity-matching", 1, hours=2.0)
    answer = solve(world, ParticleMatching(**settings), budget=budget)
    assert answer.counts.cost <= budget
    assert answer.counts.loss == 1
    assert 16 <= answer.estimate.particles <= 1000
    assert np.isfinite(answer.estimate.covariance).all()


def test_too_small_a_budget_is_refused_with_its_price():
    world = simulate("gravity-matching", 1, hours=7.0)
    with pytest.raises(InvalidInput, match="at least") as error:
        solve(world, "particle-matching", budget=60)
    price = int(str(error.value).rsplit(maxsplit=1)[-1])
    assert solve(world, "particle-matching", budget=price).counts.cost <= price
    with pytest.raises(InvalidInput, match="at least"):
        solve(world, "particle-matching", budget=price - 1)


def test_the_answer_survives_its_files(tmp_path):
    answer = solve(simulate("gravity-matching", 0, hours=2.0), ParticleMatching(particles=50))
    answer.save(tmp_path / "answer")
    loaded = Solution.load(tmp_path / "answer").estimate
    np.testing.assert_array_equal(loaded.covariance, answer.estimate.covariance)
    assert loaded.bimodality == answer.estimate.bimodality


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"model": "constant"}, UnknownName),
        ({"particles": 3}, InvalidInput),
        ({"sigmas": 0.1}, InvalidInput),
        ({"walk": -1.0}, InvalidInput),
        ({"rejuvenation": "jitter"}, UnknownName),
        ({"moves": 0}, InvalidInput),
        ({"bandwidth": 1.5}, InvalidInput),
        ({"threshold": 0.0}, InvalidInput),
        ({"passes": 0}, InvalidInput),
        ({"relinearise": 1}, InvalidInput),
        ({"bias": -1.0}, InvalidInput),
        ({"answer": "median"}, UnknownName),
    ],
)
def test_unusable_settings_are_refused(settings, error):
    with pytest.raises(error, match=next(iter(settings))):
        ParticleMatching(**settings)


def test_problems_without_a_track_are_refused():
    with pytest.raises(UnsuitableProblem, match="track"):
        solve(Sphere([1.0, 2.0]), "particle-matching")
