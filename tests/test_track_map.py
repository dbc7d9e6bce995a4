"""The match of a whole track: error shapes, posterior, modes, covariance, bound, and its recursive form."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy import linalg, stats

from baselines import TrackEstimate, TrackMAP
from baselines.track_hypotheses import Mode, weights
from baselines.track_model import TrackModel, declared_errors
from navopt import Solution, simulate, solve
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, NoBound, UnknownName
from navopt.models import CruiseScenario, InsErrors, error_basis, simulate_ins
from navopt.models.earth import local_tangent_plane, principal_radii, separation
from navopt.models.field_map import FieldMap
from navopt.models.sins_linear import noise_covariance
from navopt.models.track_errors import heading_error, track_error_basis
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gravity_posterior import TrackPosterior
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.problems.gravity_window import track_error_bound

LEVEL = 0.001 / 3  # three statistical checks in this file
VOYAGE = CruiseScenario(duration=8 * 3600.0)
TIMES = VOYAGE.times(300.0)
PLACES = VOYAGE.position(TIMES)
SIGMAS = InsErrors.published()
QUIET = InsErrors.published(noise=False)


def metres(latitude):
    meridian, prime_vertical = principal_radii(latitude)
    return np.stack([meridian, prime_vertical * np.cos(latitude)], axis=-1)


def last_error(estimate, problem):
    truth = problem.truth
    return np.array(
        separation(estimate.latitude[-1], estimate.longitude[-1], truth.latitude[-1], truth.longitude[-1])
    )


def normalised(error, covariance):
    return float(error @ np.linalg.solve(covariance, error))


# -- the shapes that INS errors give to a track -----------------------------------------------------------


def test_every_source_moves_the_track_as_a_strapdown_run_says():
    basis = track_error_basis(TIMES, *PLACES, QUIET)
    strapdown = error_basis(VOYAGE, TIMES, sources=basis.sources)
    for k, name in enumerate(basis.sources):
        expected = strapdown.position[..., k] * basis.scale[k]
        off = np.linalg.norm(basis.position[..., k] - expected, axis=1)
        # the strapdown response is a finite difference and holds second-order errors of its own
        assert off.max() < 0.003 * np.abs(expected).max() + 0.5, name
        speed = strapdown.velocity[..., k] * basis.scale[k]
        assert np.abs(basis.velocity[..., k] - speed).max() < 0.005 * np.abs(speed).max() + 1e-4, name


def test_midway_between_ins_and_truth_superposition_is_exact_to_ten_metres():
    for seed in (3, 4, 6):
        errors = QUIET.draw(np.random.default_rng(seed))
        ins = simulate_ins(VOYAGE, errors, times=TIMES)
        heading = VOYAGE.azimuth + heading_error(TIMES, *PLACES, np.full(len(TIMES), VOYAGE.azimuth), errors)
        basis = track_error_basis(TIMES, ins.latitude, ins.longitude, QUIET, heading=heading)
        values = np.delete(errors.vector / QUIET.vector, 5)
        scale = metres(PLACES[0])

        def gap(shapes, values=values, ins=ins, scale=scale):
            shown = np.stack([ins.latitude - PLACES[0], ins.longitude - PLACES[1]], axis=-1)
            return np.linalg.norm(scale * (shapes.angle @ values - shown), axis=1).max()

        midway = basis
        for _ in range(2):  # the shapes about the INS are a start, good enough to know where midway is
            midway = midway.midway(ins.latitude, ins.longitude, values, heading=heading)
        assert np.linalg.norm(ins.position_error[-1]) > 5e3
        assert gap(midway) < 10.0 < min(gap(basis), gap(basis.about(*PLACES, heading)))


def test_noise_shapes_have_the_covariance_of_the_linear_model():
    basis = track_error_basis(TIMES, *PLACES, SIGMAS)
    shapes = basis.position[..., basis.n_named :].reshape(2 * len(TIMES), -1)
    joint = noise_covariance(VOYAGE, TIMES, SIGMAS)[:, :2, :, :2]
    scale = metres(PLACES[0])
    expected = (scale[:, :, None, None] * joint * scale).reshape(2 * len(TIMES), -1)
    assert np.linalg.norm(shapes @ shapes.T - expected) < 0.1 * np.linalg.norm(expected)
    # the error at the end, which matters, is closer
    ends = np.diag(shapes @ shapes.T)[-2:], np.diag(expected)[-2:]
    np.testing.assert_allclose(*ends, rtol=0.05)


def test_a_track_that_begins_after_the_departure_continues_the_one_from_it():
    whole = track_error_basis(TIMES, *PLACES, QUIET)
    late = track_error_basis(TIMES[1:], PLACES[0][1:], PLACES[1][1:], QUIET, departure=0.0)
    np.testing.assert_allclose(late.position, whole.position[1:], atol=3.0)


def test_unusable_tracks_are_refused():
    t, (lat, lon) = TIMES[:4], (PLACES[0][:4], PLACES[1][:4])
    with pytest.raises(InvalidInput, match="time"):
        track_error_basis(t[::-1], lat, lon, SIGMAS)
    with pytest.raises(InvalidInput, match="latitude"):
        track_error_basis(t, np.full(4, 1.57), lon, SIGMAS)
    with pytest.raises(InvalidInput, match="heading"):
        track_error_basis(t, lat, lon, SIGMAS, heading=[0.0])
    with pytest.raises(InvalidInput, match="sigmas"):
        track_error_basis(t, lat, lon, InsErrors())
    with pytest.raises(InvalidInput, match="departure"):
        track_error_basis(t, lat, lon, SIGMAS, departure=10.0)


# -- the posterior -----------------------------------------------------------------------------------------


def posterior(*, method="bicubic", errors=None, hours=5.0, samples=40, **options):
    world = simulate("gravity-matching", 2, hours=hours, method=method)
    part, track = slice(0, samples), world.track
    errors = errors or MeasurementErrors(
        noise=1.0, map_error=2.0, map_error_length=6e3, bias=5.0, drift_per_day=3.0, eotvos=True
    )
    basis = track_error_basis(
        track.time[part], track.latitude[part], track.longitude[part], SIGMAS, heading=track.heading[part]
    )
    return TrackPosterior(
        world.field_map, track.time[part], track.latitude[part], track.longitude[part], track.measured[part],
        angle=basis.angle, velocity=basis.velocity, errors=errors, method=method, **options,
    )  # fmt: skip


def test_residuals_are_whitened_as_by_the_cholesky_factor():
    p, errors = posterior(), posterior().errors
    a = 0.3 * np.random.default_rng(0).standard_normal(p.n_coefficients)
    cost, residual, rows = p.linearise(a)
    lat, lon = p.positions(a)
    raw = p.measured - p.field_map.value(lat, lon, "bicubic") - p.offset @ a
    steps = separation(p.latitude[1:], p.longitude[1:], p.latitude[:-1], p.longitude[:-1])
    run = np.concatenate([[0.0], np.cumsum(np.hypot(*steps))])
    apart = np.abs(run[:, None] - run)
    covariance = errors.map_error**2 * np.exp(-apart / errors.map_error_length) + np.eye(len(p))
    factor = np.linalg.cholesky(covariance)
    np.testing.assert_allclose(
        residual, linalg.solve_triangular(factor, raw, lower=True), rtol=1e-9, atol=1e-9
    )
    expected = -stats.multivariate_normal(cov=covariance).logpdf(raw) - 0.5 * len(p) * np.log(2 * np.pi)
    assert cost == pytest.approx(expected + 0.5 * a @ a, rel=1e-10)
    assert p.costs(a[None])[0] == pytest.approx(cost, rel=1e-12)
    information = rows.T @ rows + np.eye(len(a))
    np.testing.assert_allclose(p.information(a), information)


def test_derivatives_agree_with_finite_differences():
    p = posterior()
    a = 0.3 * np.random.default_rng(1).standard_normal(p.n_coefficients)
    rows = p.linearise(a)[2]
    for c in range(p.n_coefficients):
        step = 1e-5 * np.eye(p.n_coefficients)[c]
        difference = (p.linearise(a + step)[1] - p.linearise(a - step)[1]) / 2e-5
        np.testing.assert_allclose(rows[:, c], difference, rtol=1e-5, atol=1e-5 * np.abs(rows).max())


def test_eotvos_bias_and_drift_enter_the_measurements_in_their_units():
    p = posterior()
    basis = track_error_basis(p.time, p.latitude, p.longitude, SIGMAS)
    n = p.n_coefficients - 2
    # 14.58 cos φ mGal for 1 m/s to the east; the heading only turns the axes of the biases
    gyro = p.offset[:, 2], basis.velocity[:, 1, 2]
    np.testing.assert_allclose(gyro[0], 14.584 * np.cos(p.latitude) * gyro[1], rtol=0.03, atol=0.05)
    np.testing.assert_array_equal(p.offset[:, n], 5.0)
    np.testing.assert_allclose(p.offset[:, n + 1], 3.0 * (p.time - p.time[0]) / 86400.0)
    assert p.names[n:] == ("bias", "drift")


def test_a_robust_loss_caps_the_pull_of_an_outlier():
    p = posterior(huber=2.0, errors=MeasurementErrors(noise=1.0))
    a = np.zeros(p.n_coefficients)
    _, residual, _ = p.linearise(a)
    plain = posterior(errors=MeasurementErrors(noise=1.0)).linearise(a)[1]
    np.testing.assert_allclose(
        residual, np.sign(plain) * np.minimum(np.abs(plain), np.sqrt(2 * np.abs(plain)))
    )


def test_samples_off_the_map_teach_nothing_and_cost_their_surprise():
    p = posterior(errors=MeasurementErrors(noise=1.0), method="bilinear")
    west, east, south, north = p.field_map.bounds_deg
    small = p.field_map.crop((np.degrees(p.longitude[20]), east - 0.1, south + 0.1, north - 0.1))
    cut = TrackPosterior(
        small, p.time, p.latitude, p.longitude, p.measured,
        angle=p.angle[:, :, : p.n_coefficients], errors=p.errors,
    )  # fmt: skip
    a = np.zeros(p.n_coefficients)
    cost, _, rows = cut.linearise(a)
    off = ~small.contains(p.latitude, p.longitude)
    assert 5 < off.sum() < 35
    np.testing.assert_array_equal(rows[off], 0.0)
    np.testing.assert_allclose(rows[~off], p.linearise(a)[2][~off], rtol=1e-9)
    spread = small.values.var() + 1.0
    expected = np.sum(0.5 * p.linearise(a)[1][~off] ** 2)
    expected += np.sum(0.5 * (p.measured[off] - small.values.mean()) ** 2 / spread + 0.5 * np.log(spread))
    assert cost == pytest.approx(expected, rel=1e-9)
    assert west < east


# -- a plane field: everything is known in closed form ---------------------------------------------------


@lru_cache(maxsize=2)
def plane(hours):
    """Inertial track over a plane field, and its error shapes."""
    world = simulate("gravity-matching", 0, hours=hours)
    track = world.track
    rows, columns = np.meshgrid(world.field_map.latitude, world.field_map.longitude, indexing="ij")
    north, east = local_tangent_plane(rows, columns, *world.origin)
    field = FieldMap(rows[:, 0], columns[0], 2e-3 * north - 1e-3 * east)
    return (
        field,
        track,
        track_error_basis(track.time, track.latitude, track.longitude, SIGMAS, heading=track.heading),
    )


def plane_world(seed, *, hours=4.0):
    """A world over a plane field with errors that are linear in their sources, and what they are."""
    field, track, basis = plane(hours)
    rng = np.random.default_rng(seed)
    a = rng.standard_normal(len(basis.sources))
    shift = basis.angle @ a
    truth = track.latitude - shift[:, 0], track.longitude - shift[:, 1]
    measured = field.value(*truth) + rng.standard_normal(len(track))
    return field, replace(track, measured=measured, true_latitude=truth[0], true_longitude=truth[1]), basis, a


def test_over_a_plane_field_the_mode_and_its_covariance_are_the_linear_ones():
    field, track, _, _ = plane_world(4)
    model = TrackModel(field, track, SIGMAS, MeasurementErrors(noise=1.0))
    found, _, information, _ = model.posterior.fit(np.zeros(model.posterior.n_coefficients))
    per_lat, per_lon = (np.asarray(g) for g in field.gradient(track.latitude, track.longitude))
    design = -(per_lat[:, None] * model.basis.angle[:, 0] + per_lon[:, None] * model.basis.angle[:, 1])
    surprise = track.measured - field.value(track.latitude, track.longitude)
    # z = h(p) − ∇h B a + n, so that a = Bᵀ(B Bᵀ + R)⁻¹ of it, by the formula that does not invert J'J
    gain = design.T @ np.linalg.inv(design @ design.T + np.eye(len(track)))
    np.testing.assert_allclose(found, gain @ surprise, atol=1e-6)
    covariance = np.eye(len(found)) - gain @ design
    np.testing.assert_allclose(np.linalg.inv(information), covariance, atol=1e-7)
    reach = metres(track.latitude[-1])[:, None] * model.basis.angle[-1]
    last = model.posterior.covariances(information)[-1]
    np.testing.assert_allclose(last, reach @ covariance @ reach.T, rtol=1e-6)


def test_errors_over_a_plane_field_follow_the_bound():
    total, count = 0.0, 150
    for seed in range(count):
        field, track, basis, a = plane_world(seed, hours=2.0)
        p = TrackPosterior(
            field, track.time, track.latitude, track.longitude, track.measured,
            angle=basis.angle, errors=MeasurementErrors(noise=1.0),
        )  # fmt: skip
        found = p.fit(np.zeros(len(a)))[0]
        if seed == 0:
            bound = p.covariances(p.information(found))[-1]
        error = metres(track.latitude[-1]) * (basis.angle[-1] @ (found - a))
        total += normalised(error, bound)
    low, high = stats.chi2.ppf([LEVEL / 2, 1 - LEVEL / 2], 2 * count)
    assert low < total < high


def test_the_bound_is_the_inverse_of_the_information_along_the_truth():
    field, track, basis, _ = plane_world(0, hours=2.0)
    world = simulate("gravity-matching", 0, hours=2.0)
    problem = GravityMatching(field, track, prior_covariance=world.prior()[1], ins_errors=SIGMAS, noise=1.0)
    bound = track_error_bound(problem)
    about = track_error_basis(
        track.time, track.true_latitude, track.true_longitude, SIGMAS, heading=track.heading
    )
    per_lat, per_lon = (np.asarray(g) for g in field.gradient(track.true_latitude, track.true_longitude))
    design = per_lat[:, None] * about.angle[:, 0] + per_lon[:, None] * about.angle[:, 1]
    fisher = design.T @ design + np.eye(design.shape[1])
    expected = about.position @ np.linalg.inv(fisher) @ about.position.transpose(0, 2, 1)
    np.testing.assert_allclose(bound, expected, rtol=1e-6, atol=1e-3)
    causal = track_error_bound(problem, causal=True)
    np.testing.assert_allclose(causal[-1], bound[-1], rtol=1e-6)
    assert (np.trace(causal, axis1=1, axis2=2) >= np.trace(bound, axis1=1, axis2=2) * (1 - 1e-9)).all()
    unknown = GravityMatching(field, track, prior_covariance=world.prior()[1])
    with pytest.raises(NoBound, match="ins_errors"):
        track_error_bound(unknown)
    blind = GravityMatching(
        field, replace(track, true_latitude=None, true_longitude=None),
        prior_covariance=world.prior()[1], ins_errors=SIGMAS,
    )  # fmt: skip
    with pytest.raises(NoBound, match="truth"):
        track_error_bound(blind)
    np.testing.assert_array_equal(
        track_error_bound(blind, at=(track.true_latitude, track.true_longitude)), bound
    )
    assert basis.n_named == 7


# -- the solver ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def world():
    return simulate("gravity-matching", 1, hours=5.0)


def test_reported_errors_are_consistent_over_worlds():
    worlds = [simulate("gravity-matching", seed, hours=4.0) for seed in range(25)]
    total = 0.0
    for problem in worlds:
        estimate = TrackMAP().match(problem)
        total += normalised(last_error(estimate, problem), estimate.covariance[-1])
    low, high = stats.chi2.ppf([LEVEL / 2, 1 - LEVEL / 2], 2 * len(worlds))
    assert low < total < high


@pytest.mark.slow
@pytest.mark.parametrize("degree", [720, 2190])
@pytest.mark.parametrize(
    ("hours", "mean_m"), [(3, 1400), (5, 800), (7, 800), (10, 900), (14, 400), (16, 400)]
)
def test_fifty_worlds_reach_the_bound(hours, mean_m, degree):
    errors, bounds, total = [], [], 0.0
    for seed in range(50):
        problem = simulate("gravity-matching", seed, hours=float(hours), degree=degree)
        estimate = TrackMAP().match(problem)
        error = last_error(estimate, problem)
        errors.append(np.hypot(*error))
        bounds.append(np.trace(track_error_bound(problem)[-1]))
        total += normalised(error, estimate.covariance[-1])
    assert np.sqrt(np.mean(np.square(errors))) <= 1.3 * np.sqrt(np.mean(bounds))
    assert np.mean(errors) <= mean_m
    assert (np.array(errors) > 3704.0).sum() <= (1 if hours == 3 else 0)
    low, high = stats.chi2.ppf([0.001 / 24, 1 - 0.001 / 24], 100)
    assert low < total < high


def test_the_estimate_is_attached_and_x_is_its_projection(world):
    solution = solve(world, "track-map")
    estimate = solution.estimate
    assert isinstance(estimate, TrackEstimate)
    np.testing.assert_array_equal(solution.x, world.project(estimate))
    assert solution.loss == float(world.loss(solution.x))
    assert solution.scores["position_error_m"] == pytest.approx(np.hypot(*last_error(estimate, world)))
    np.testing.assert_array_equal(estimate.track_latitude[-world.window :], estimate.latitude)
    assert estimate.used == len(world.track) == len(estimate.track_covariance)
    assert estimate.knows
    assert estimate.sigma_m == pytest.approx(np.sqrt(np.trace(estimate.covariance[-1])))
    assert len(estimate.names) == len(estimate.coefficients)


def test_the_estimate_is_not_clipped_to_the_box(world):
    narrow = GravityMatching(
        world.field_map, world.track, prior_covariance=world.prior()[1], ins_errors=SIGMAS,
        box=np.array([[-10.0, 10.0], [-10.0, 10.0], [-1e-3, 1e-3], [0.999, 1.001]]),
    )  # fmt: skip
    solution = solve(narrow, "track-map")
    wide = TrackMAP().match(world)
    np.testing.assert_allclose(solution.estimate.latitude, wide.latitude, atol=1e-9)
    assert (solution.x >= narrow.xl).all()
    assert (solution.x <= narrow.xu).all()


def test_the_truth_is_not_looked_at(world):
    track = replace(world.track, true_latitude=None, true_longitude=None)
    blind = GravityMatching(
        world.field_map, track, position_covariance=world.position_covariance, ins_errors=world.ins_errors
    )
    np.testing.assert_array_equal(TrackMAP().match(blind).latitude, TrackMAP().match(world).latitude)


def test_it_can_be_applied_to_the_held_out_twin_pickled_and_stored(world, tmp_path):
    solution = solve(world, "track-map")
    twin = world.redraw(5)
    again = pickle.loads(pickle.dumps(solution.fitted)).apply(twin)
    np.testing.assert_array_equal(again.latitude, TrackMAP().match(twin).latitude)
    assert solution.apply(twin)["position_error_m"] < 3000.0
    solution.save(tmp_path / "run")
    loaded = Solution.load(tmp_path / "run")
    np.testing.assert_array_equal(loaded.estimate.covariance, solution.estimate.covariance)
    np.testing.assert_array_equal(loaded.fitted.apply(twin).latitude, again.latitude)


@pytest.mark.parametrize("budget", [1, 40, 400, 1500])
def test_a_small_budget_ends_the_search_early_and_says_so(world, budget):
    solution = solve(world, "track-map", budget=budget)
    assert solution.counts.cost <= budget
    assert solution.estimate.used < len(world.track)
    error = last_error(solution.estimate, world)
    # predicted from what was used, with the covariance of a prediction
    assert normalised(error, solution.estimate.covariance[-1]) < stats.chi2.ppf(1 - 1e-4, 2)


def test_over_a_constant_field_it_says_that_it_does_not_know(world):
    flat = FieldMap(world.field_map.latitude, world.field_map.longitude, np.full(world.field_map.shape, 7.0))
    problem = GravityMatching(
        flat, world.track, position_covariance=world.position_covariance, ins_errors=SIGMAS
    )
    estimate = TrackMAP().match(problem)
    assert not estimate.knows
    assert estimate.gain == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(estimate.track_latitude, world.track.latitude, atol=1e-12)
    # even where the INS alone would be good enough
    assert not TrackMAP(gate_sigma_m=1e6).match(problem).knows


def test_without_the_heading_the_course_of_the_corrected_track_stands_in(world):
    blind = GravityMatching(
        world.field_map, replace(world.track, heading=None),
        position_covariance=world.position_covariance, ins_errors=SIGMAS,
    )  # fmt: skip
    estimate, whole = TrackMAP().match(blind), TrackMAP().match(world)
    away = separation(estimate.latitude[-1], estimate.longitude[-1], whole.latitude[-1], whole.longitude[-1])
    assert np.hypot(*away) < 2.0 * estimate.sigma_m


def test_outliers_do_little_harm_to_the_robust_form(world):
    measured = world.track.measured.copy()
    measured[7::9] += 40.0
    spoilt = GravityMatching(
        world.field_map, replace(world.track, measured=measured),
        position_covariance=world.position_covariance, ins_errors=SIGMAS,
    )  # fmt: skip
    robust = np.hypot(*last_error(TrackMAP(huber=2.0).match(spoilt), world))
    plain = np.hypot(*last_error(TrackMAP().match(spoilt), world))
    assert robust < 2000.0
    assert plain > 2.0 * robust


def test_the_recursive_form_ends_where_the_whole_track_does(world):
    follower = TrackMAP().begin(world)
    track, inside = world.track, 0
    for k in range(len(track)):
        estimate = follower.add(
            track.time[k], track.latitude[k], track.longitude[k], track.measured[k], track.heading[k]
        )
        if k < 1:
            assert estimate is None
            continue
        truth = track.true_latitude[k], track.true_longitude[k]
        error = np.array(separation(estimate.latitude[-1], estimate.longitude[-1], *truth))
        inside += normalised(error, estimate.covariance[-1]) < stats.chi2.ppf(0.999, 2)
    whole = TrackMAP().match(world)
    away = separation(estimate.latitude[-1], estimate.longitude[-1], whole.latitude[-1], whole.longitude[-1])
    assert np.hypot(*away) < 0.3 * whole.sigma_m
    assert inside >= len(track) - 3
    with pytest.raises(InvalidInput, match="time"):
        follower.add(track.time[-1], 0.3, 2.6, 1.0, 1.0)
    with pytest.raises(InvalidInput, match="heading"):
        follower.add(track.time[-1] + 1.0, 0.3, 2.6, 1.0)
    with pytest.raises(InvalidInput, match="sample"):
        follower.add(track.time[-1] + 1.0, 0.3, 2.6, np.nan, 1.0)


def test_modes_are_weighed_by_their_mass():
    wide, narrow = np.diag([1.0, 1.0]), np.diag([16.0, 1.0])
    modes = [
        Mode(np.zeros(2), 0.0, information, float(np.log(np.linalg.det(information))) / 2)
        for information in (wide, narrow)
    ]
    np.testing.assert_allclose(weights(modes), [0.8, 0.2])


def test_a_problem_without_declared_errors_is_given_an_ins_as_bad_as_its_prior(world):
    plain = GravityMatching(world.field_map, world.track, prior_covariance=4.0 * world.prior()[1], noise=1.5)
    ins, sensing = declared_errors(plain)
    assert sensing == MeasurementErrors(noise=1.5)
    factor = np.array(ins.gyro_bias) / np.array(SIGMAS.gyro_bias)
    np.testing.assert_allclose(factor, factor[0])
    assert 1.8 < factor[0] < 2.2
    assert declared_errors(world)[0] == world.ins_errors


def test_options_are_checked(world):
    with pytest.raises(UnknownName, match="noises"):
        TrackMAP(measurement_errors={"noises": 1.0})
    with pytest.raises(InvalidInput, match="ins_errors"):
        TrackMAP(ins_errors=3.0)
    with pytest.raises(UnknownName, match="answer"):
        TrackMAP(answer="median")
    with pytest.raises(InvalidInput, match="keep"):
        TrackMAP(keep=0)
    given = TrackMAP(measurement_errors={"noise": 3.0, "bias": 10.0})
    assert given.errors_of(world)[1] == MeasurementErrors(noise=3.0, bias=10.0)
    assert given.errors_of(world)[0] == world.ins_errors
    for name, value in (("noise", 0.0), ("bias", -1.0), ("map_error", np.nan), ("eotvos", 1)):
        with pytest.raises(InvalidInput, match=name):
            MeasurementErrors(**{name: value})


def test_a_track_across_the_date_line_is_matched_as_elsewhere(world):
    turn = np.radians(24.5)  # puts the track at the end of the voyage on both sides of 180°
    shifted = {
        name: (getattr(world.track, name) + turn + np.pi) % (2 * np.pi) - np.pi
        for name in ("longitude", "true_longitude")
    }
    field = FieldMap(world.field_map.latitude, world.field_map.longitude + turn, world.field_map.values)
    assert np.ptp(shifted["longitude"]) > 6.0
    moved = GravityMatching(
        field, replace(world.track, **shifted), position_covariance=world.position_covariance,
        ins_errors=SIGMAS,
    )  # fmt: skip
    here, there = TrackMAP().match(world), TrackMAP().match(moved)
    np.testing.assert_allclose(there.latitude, here.latitude, atol=1e-7)
    np.testing.assert_allclose(
        np.angle(np.exp(1j * (there.longitude - here.longitude - turn))), 0.0, atol=1e-7
    )


def test_two_samples_are_a_track():
    track = MeasuredTrack(
        time=[0.0, 300.0], latitude=[0.35, 0.3502], longitude=[2.7, 2.7], measured=[1.0, 2.0]
    )
    model = TrackModel(FieldMap.embedded(720), track, SIGMAS, MeasurementErrors())
    assert np.isfinite(model.posterior.fit(np.zeros(model.posterior.n_coefficients))[1])
