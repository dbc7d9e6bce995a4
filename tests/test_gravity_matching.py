"""Gravity matching against plain numpy and scipy, and its statistics against many worlds."""

import copy
import pickle

import numpy as np
import pytest
from pyins import transform
from scipy import ndimage, stats
from scipy.interpolate import RegularGridInterpolator

from navopt import make_solver, simulate, solve
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, NavoptError, NoTruth, UnknownName, UnsuitableProblem
from navopt.models.field_map import FieldMap
from navopt.problems.gravity_matching import GravityMatching, MatchedTrack

LEVEL = 0.001 / 6  # six statistical checks in this file
A, E2 = 6378137.0, 6.6943799901413e-3  # WGS-84


def metres_per_radian(latitude):
    """Meridian radius and radius of the parallel, from the definition of the ellipsoid."""
    w = 1.0 - E2 * np.sin(latitude) ** 2
    return A * (1 - E2) / w**1.5, A / np.sqrt(w) * np.cos(latitude)


@pytest.fixture(scope="module")
def world():
    return simulate("gravity-matching", 0, hours=2.0)


def rebuilt(world, *, track=None, field_map=None, **options):
    settings = {"prior_covariance": world.prior()[1], "window": world.window} | options
    if settings["prior_covariance"] is None:
        del settings["prior_covariance"]
    return GravityMatching(field_map or world.field_map, track or world.track, **settings)


def with_track(world, **changes):
    arrays = {name: getattr(world.track, name) for name in world.track.__dataclass_fields__}
    return MeasuredTrack(**(arrays | changes))


def positions(world, X):
    """Latitudes and longitudes of candidates: the definition, in numpy, from the raw track."""
    latitude, longitude = world.track.latitude[-world.window :], world.track.longitude[-world.window :]
    lat0, lon0 = latitude.mean(), longitude.mean()
    per_lat, per_lon = metres_per_radian(lat0)
    q = np.stack([(latitude - lat0) * per_lat, (longitude - lon0) * per_lon], axis=1)
    north, east, angle, scale = np.moveaxis(X, -1, 0)[..., None]
    n = north + scale * (np.cos(angle) * q[:, 0] - np.sin(angle) * q[:, 1])
    e = east + scale * (np.sin(angle) * q[:, 0] + np.cos(angle) * q[:, 1])
    return lat0 + n / per_lat, lon0 + e / per_lon


def looked_up(field, latitude, longitude, method="bilinear"):
    if method == "bilinear":
        axes = np.degrees(field.latitude), np.degrees(field.longitude)
        interpolate = RegularGridInterpolator(axes, field.values, bounds_error=False)
        return interpolate(np.degrees(np.stack([latitude, longitude], axis=-1)))
    rows = (latitude - field.latitude[0]) / np.diff(field.latitude).mean()
    columns = (longitude - field.longitude[0]) / np.diff(field.longitude).mean()
    values = ndimage.map_coordinates(field.values, [rows, columns], order=3, mode="mirror")
    outside = (rows < 0) | (rows > field.shape[0] - 1) | (columns < 0) | (columns > field.shape[1] - 1)
    return np.where(outside, np.nan, values)


def candidates(world, count, seed=1, spread=1.0):
    centre, half = 0.5 * (world.xl + world.xu), 0.5 * (world.xu - world.xl)
    return centre + spread * np.random.default_rng(seed).uniform(-1, 1, (count, 4)) * half


def ecef_distance(latitude, longitude, latitude0, longitude0):
    """Chord through the Earth, by python-ins; of the arc it lacks 3e-6 at 50 km."""
    lla = [
        np.stack([np.degrees(a), np.degrees(b), 0 * a], -1)
        for a, b in ((latitude, longitude), (latitude0, longitude0))
    ]
    return np.linalg.norm(transform.lla_to_ecef(lla[0]) - transform.lla_to_ecef(lla[1]), axis=-1)


# -- loss, residuals, Jacobian ---------------------------------------------------------------------------


@pytest.mark.parametrize("criterion", ["mad", "mean-square"])
@pytest.mark.parametrize("method", ["bilinear", "bicubic"])
def test_the_loss_is_the_difference_to_the_map(world, criterion, method):
    problem = rebuilt(world, criterion=criterion, method=method)
    X = candidates(problem, 300, spread=3.0)
    X[:20, 0] += 600e3  # off the map
    latitude, longitude = positions(problem, X)
    difference = world.track.measured[-12:] - looked_up(world.field_map, latitude, longitude, method)
    expected = np.mean(np.abs(difference) if criterion == "mad" else difference**2, axis=1)
    expected = np.where(np.isnan(expected), np.inf, expected)
    assert 20 <= np.isinf(expected).sum() < 150
    np.testing.assert_allclose(problem.loss(X), expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("method", ["bilinear", "bicubic"])
def test_residuals_are_whitened_differences(world, method):
    problem = rebuilt(world, method=method, noise=2.5)
    X = candidates(problem, 100)
    difference = world.track.measured[-12:] - looked_up(world.field_map, *positions(problem, X), method)
    np.testing.assert_allclose(problem.residuals(X), difference / 2.5, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(np.abs(problem.residuals(X)).mean(axis=1) * 2.5, problem.loss(X), rtol=1e-12)
    assert problem.residuals(X.reshape(4, 25, 4)).shape == (4, 25, 12)


@pytest.mark.parametrize("method", ["bilinear", "bicubic"])
def test_the_jacobian_is_the_derivative_of_the_residuals(world, method):
    problem = rebuilt(world, method=method, noise=1.7)
    X = candidates(problem, 60, seed=3)
    step = np.array([1.0, 1.0, 1e-4, 1e-4])  # about a metre at the ends of the track
    numeric = np.stack(
        [
            (problem.residuals(X + step * u) - problem.residuals(X - step * u)) / (2 * step @ u)
            for u in np.eye(4)
        ],
        -1,
    )
    latitude, longitude = positions(problem, X)
    field = world.field_map
    rows = (latitude - field.latitude[0]) / np.diff(field.latitude).mean()
    columns = (longitude - field.longitude[0]) / np.diff(field.longitude).mean()
    # a bilinear slope jumps at a cell's border: 0.01 of a cell is 18 m
    border = np.minimum(np.abs(rows - np.rint(rows)), np.abs(columns - np.rint(columns)))
    smooth = border > 0.01 if method == "bilinear" else border > -1
    assert smooth.mean() > 0.9
    analytic = problem.jacobian(X)
    scale = np.abs(numeric[smooth]).mean(axis=0)
    np.testing.assert_allclose(
        analytic[smooth] / scale, numeric[smooth] / scale, atol=2e-5 if method == "bilinear" else 1e-4
    )


def test_a_loss_has_the_same_bits_alone_and_in_a_batch(world):
    for method in ("bilinear", "bicubic"):
        problem = rebuilt(world, method=method)
        X = candidates(problem, 257, spread=1.3)
        whole, residuals = problem.loss(X), problem.residuals(X)
        jacobian = problem.jacobian(X)
        for k in range(0, 257, 16):
            assert problem.loss(X[k]) == whole[k]
            np.testing.assert_array_equal(problem.residuals(X[k]), residuals[k])
            np.testing.assert_array_equal(problem.jacobian(X[k : k + 1])[0], jacobian[k])
        order = np.random.default_rng(1).permutation(257)
        np.testing.assert_array_equal(problem.loss(X[order]), whole[order])
        np.testing.assert_array_equal(problem.loss(np.asfortranarray(X)), whole)


@pytest.mark.parametrize("turn", [-1, 1])
def test_longitudes_may_be_counted_another_turn(world, turn):
    turned = with_track(world, longitude=world.track.longitude - np.pi + turn * np.pi)
    problem = rebuilt(world, track=turned)
    X = candidates(world, 50)
    np.testing.assert_allclose(problem.loss(X), world.loss(X), rtol=1e-6)
    score = problem.score(problem.estimate(X[0]))
    assert score["position_error_m"] == pytest.approx(
        world.score(world.estimate(X[0]))["position_error_m"], abs=1e-3
    )


def date_line_world(wrapped):
    """A track over the date line, with longitudes within ±180° or running on."""
    rng = np.random.default_rng(2)
    field = FieldMap.from_degrees(
        np.linspace(10, 12, 121),
        np.linspace(179, 181, 121),
        ndimage.gaussian_filter(rng.normal(size=(121, 121)), 3) * 300,
    )
    longitude = np.radians(np.linspace(179.85, 180.15, 14))
    latitude = np.radians(np.linspace(11.0, 11.1, 14))
    shown = np.where(longitude > np.pi, longitude - 2 * np.pi, longitude) if wrapped else longitude
    track = MeasuredTrack(
        time=300.0 * np.arange(14),
        latitude=latitude,
        longitude=shown,
        measured=field.value(latitude, longitude),
        true_latitude=latitude,
        true_longitude=shown,
    )
    return GravityMatching(field, track, prior_covariance=np.diag([1e6, 1e6, 1e-3, 1e-3]))


def test_a_track_may_cross_the_date_line():
    plain, wrapped = date_line_world(False), date_line_world(True)
    X = candidates(plain, 50)
    assert plain.loss(plain.nominal) < 1e-9
    np.testing.assert_allclose(wrapped.loss(X), plain.loss(X), rtol=1e-6)
    np.testing.assert_allclose(wrapped.project(wrapped.truth), plain.project(plain.truth), atol=1e-6)
    assert wrapped.score(wrapped.estimate(X[0])) == pytest.approx(
        plain.score(plain.estimate(X[0])), abs=1e-3, nan_ok=True
    )


# -- estimates and scores --------------------------------------------------------------------------------


def test_an_estimate_is_the_transformed_track(world):
    X = candidates(world, 20)
    for x in X:
        answer = world.estimate(x)
        latitude, longitude = positions(world, x)
        np.testing.assert_allclose(answer.latitude, latitude, rtol=1e-13)
        np.testing.assert_allclose(answer.longitude, longitude, rtol=1e-13)
    still = world.estimate(world.nominal)
    np.testing.assert_allclose(still.latitude, world.track.latitude[-12:], rtol=1e-14)
    np.testing.assert_allclose(still.longitude, world.track.longitude[-12:], rtol=1e-14)


def test_a_positive_rotation_is_clockwise_and_north_is_north(world):
    latitude, longitude = world.track.latitude[-12:], world.track.longitude[-12:]
    heading = np.arctan2((longitude[-1] - longitude[0]) * np.cos(latitude.mean()), latitude[-1] - latitude[0])
    turned = world.estimate(np.array([0.0, 0.0, 0.1, 1.0]))
    after = np.arctan2(
        (turned.longitude[-1] - turned.longitude[0]) * np.cos(latitude.mean()),
        turned.latitude[-1] - turned.latitude[0],
    )
    assert after - heading == pytest.approx(0.1, abs=1e-3)
    north = world.estimate(np.array([1852.0, 0.0, 0.0, 1.0]))
    assert np.degrees(north.latitude - latitude).mean() * 60 == pytest.approx(1.0, rel=0.01)
    east = world.estimate(np.array([0.0, 1000.0, 0.0, 1.0]))
    assert (east.longitude > longitude).all()


def test_projection_undoes_the_estimate(world):
    for x in candidates(world, 50):
        np.testing.assert_allclose(world.project(world.estimate(x)), x, rtol=1e-9, atol=1e-6)
    far = world.estimate(world.xu + np.array([1e4, 1e4, 0.2, 0.5]))
    np.testing.assert_allclose(world.project(far), world.xu)


def test_projection_is_the_least_squares_similarity(world):
    """Against a linear least-squares solution for (t, s cos β, s sin β)."""
    truth = world.truth
    per_lat, per_lon = metres_per_radian(world.track.latitude[-12:].mean())
    q = np.stack(positions(world, np.array([0.0, 0.0, 0.0, 1.0])), axis=1)
    centre = q.mean(axis=0)
    q = (q - centre) * [per_lat, per_lon]
    y = (np.stack([truth.latitude, truth.longitude], axis=1) - centre) * [per_lat, per_lon]
    design = np.zeros((24, 4))
    design[0::2, 0] = design[1::2, 1] = 1
    design[0::2, 2], design[0::2, 3] = q[:, 0], -q[:, 1]
    design[1::2, 2], design[1::2, 3] = q[:, 1], q[:, 0]
    n, e, c, s = np.linalg.lstsq(design, y.ravel(), rcond=None)[0]
    np.testing.assert_allclose(
        world.project(truth), [n, e, np.arctan2(s, c), np.hypot(c, s)], rtol=1e-6, atol=1e-3
    )


def test_scores_are_distances_on_the_ellipsoid(world):
    for x in candidates(world, 20, spread=3.0):
        answer = world.estimate(x)
        chord = ecef_distance(answer.latitude, answer.longitude, world.truth.latitude, world.truth.longitude)
        score = world.score(answer)
        assert score["position_error_m"] == pytest.approx(chord[-1], rel=3e-5)
        assert score["mean_position_error_m"] == pytest.approx(chord.mean(), rel=3e-5)
        assert score["matched_within_2nmi"] == float(chord[-1] <= 2 * 1852)
        assert score["matched_within_5nmi"] == float(chord[-1] <= 5 * 1852)
    assert world.score(world.truth)["position_error_m"] == 0.0


@pytest.mark.parametrize("radius", [2, 5])
def test_a_match_is_judged_at_the_last_point_within_the_radius(world, radius):
    for metres, expected in ((radius * 1852 - 5, 1.0), (radius * 1852 + 5, 0.0)):
        latitude = world.truth.latitude.copy()
        latitude[-1] += metres / metres_per_radian(latitude[-1])[0]
        score = world.score(MatchedTrack(latitude, world.truth.longitude))
        assert score[f"matched_within_{radius}nmi"] == expected
        assert score["mean_position_error_m"] == pytest.approx(metres / 12, rel=1e-4)


def test_without_a_truth_nothing_is_scored(world):
    problem = rebuilt(world, track=with_track(world, true_latitude=None, true_longitude=None))
    assert problem.truth is None
    with pytest.raises(NoTruth):
        problem.score(problem.estimate(problem.nominal))
    assert solve(problem, "random-search", budget=100).scores == {}
    with pytest.raises(UnsuitableProblem):
        problem.redraw(1)


# -- prior, box and bound --------------------------------------------------------------------------------


def test_prior_and_box_do_not_know_the_truth(world):
    rng = np.random.default_rng(1)
    moved = with_track(
        world,
        true_latitude=world.track.true_latitude + rng.normal(0, 1e-2, len(world.track)),
        true_longitude=world.track.true_longitude - 0.02,
    )
    covariance = np.diag(rng.uniform(1e6, 4e6, 24))
    for options in ({}, {"box": "paper", "scale_limit": 1.2}):
        plain = rebuilt(world, prior_covariance=None, position_covariance=covariance, **options)
        other = rebuilt(world, track=moved, prior_covariance=None, position_covariance=covariance, **options)
        np.testing.assert_array_equal(plain.xl, other.xl)
        np.testing.assert_array_equal(plain.xu, other.xu)
        np.testing.assert_array_equal(plain.prior()[1], other.prior()[1])
        X = candidates(plain, 20)
        np.testing.assert_array_equal(plain.loss(X), other.loss(X))
    blind = rebuilt(world, track=with_track(world, true_latitude=None, true_longitude=None))
    np.testing.assert_array_equal(blind.loss(X), world.loss(X))


def test_the_prior_is_the_propagated_covariance_of_the_inertial_errors(world):
    """Displace the track by drawn errors and project what was before: a Monte-Carlo covariance."""
    rng = np.random.default_rng(3)
    n = 12
    slope = np.linspace(-1, 1, n)
    factor = np.zeros((2 * n, 4))
    factor[0::2, 0], factor[1::2, 1], factor[0::2, 2], factor[1::2, 3] = (
        900.0,
        700.0,
        300 * slope,
        200 * slope,
    )
    covariance = factor @ factor.T + np.eye(2 * n) * 50.0**2
    problem = rebuilt(world, prior_covariance=None, position_covariance=covariance)
    mean, prior = problem.prior()
    np.testing.assert_array_equal(mean, [0, 0, 0, 1])
    per_lat, per_lon = metres_per_radian(problem.track.latitude[-n:].mean())
    errors = (factor @ rng.standard_normal((4, 2000))).T + rng.normal(0, 50.0, (2000, 2 * n))
    samples = np.array(
        [
            problem.project(
                MatchedTrack(
                    problem.track.latitude[-n:] - error[0::2] / per_lat,
                    problem.track.longitude[-n:] - error[1::2] / per_lon,
                )
            )
            for error in errors
        ]
    )
    inside = ((samples > problem.xl) & (samples < problem.xu)).all(axis=1)
    assert inside.mean() > 0.98
    sigma = np.sqrt(np.diag(prior))
    normalised = np.cov(samples.T) / np.outer(sigma, sigma)
    # clipping at three sigma takes about one per cent of the variance; the sampling error is three
    np.testing.assert_allclose(normalised, prior / np.outer(sigma, sigma), atol=0.1)
    np.testing.assert_allclose(problem.xu - mean, 3 * sigma, rtol=1e-12)
    np.testing.assert_allclose(mean - problem.xl, 3 * sigma, rtol=1e-12)


def test_over_many_worlds_the_truth_is_distributed_as_the_prior_says():
    squares, inside = [], 0
    worlds = [simulate("gravity-matching", seed, hours=2.0) for seed in range(100)]
    for world in worlds:
        mean, covariance = world.prior()
        reach = np.array([1e6, 1e6, 3.0, 0.9])
        x = rebuilt(world, box=np.stack([mean - reach, mean + reach], axis=1)).project(world.truth)
        inside += bool(((x > world.xl) & (x < world.xu)).all())
        squares.append((x - mean) @ np.linalg.solve(covariance, x - mean))
    assert stats.kstest(squares, stats.chi2(4).cdf).pvalue > LEVEL
    # at three sigma in each of four correlated directions at most 1.1 % of worlds fall out
    assert stats.binomtest(len(worlds) - inside, len(worlds), 0.0108, alternative="greater").pvalue > LEVEL


def test_the_papers_box(world):
    sigma = np.sqrt(np.diag(world.prior()[1]))
    for limit, interval in ((1.25, (1.0, 1.25)), (0.8, (0.8, 1.0))):
        problem = rebuilt(world, box="paper", scale_limit=limit)
        np.testing.assert_allclose(problem.xu[:2], 3 * sigma[:2])
        np.testing.assert_allclose(problem.xl[:2], -3 * sigma[:2])
        np.testing.assert_allclose([problem.xl[2], problem.xu[2]], np.radians([-15, 15]))
        assert (problem.xl[3], problem.xu[3]) == interval
        np.testing.assert_array_equal(problem.nominal, [0, 0, 0, 1])
    simulated = simulate("gravity-matching", 1, hours=2.0, box="paper")
    assert 1.0 in (simulated.xl[3], simulated.xu[3])
    for limit in (None, 1.0, -0.5, np.nan):
        with pytest.raises(InvalidInput, match="scale_limit"):
            rebuilt(world, box="paper", scale_limit=limit)


def test_a_box_of_ones_own(world):
    limits = [[-100.0, 5000.0], [-3.0, -1.0], [-0.1, 0.2], [0.9, 0.95]]
    problem = rebuilt(world, box=limits)
    np.testing.assert_array_equal(np.stack([problem.xl, problem.xu], axis=1), limits)
    np.testing.assert_array_equal(problem.nominal, [0.0, -1.0, 0.0, 0.95])
    for broken in (np.zeros((2, 4)), [[1, 0]] * 4, "mine", [[-1, 1], [-1, 1], [-1, 1], [-1.0, 1.0]]):
        with pytest.raises(NavoptError):
            rebuilt(world, box=broken)


def linear_world(seed=0, slope=(400.0, -250.0)):
    """A plane field, on which bilinear look-up is exact and the residuals are linear in the shift."""
    latitude, longitude = np.linspace(19, 23, 41), np.linspace(150, 156, 61)
    values = slope[0] * (latitude[:, None] - 21) + slope[1] * (longitude - 153)
    field = FieldMap.from_degrees(latitude, longitude, values)
    t = np.linspace(0, 1, 12)
    lat, lon = np.radians(20.9 + 0.2 * t + 0.05 * t**2), np.radians(153.2 - 0.15 * t)
    return field, lat, lon


def test_the_error_bound_is_the_closed_form_in_a_linear_field_and_map_estimates_attain_it():
    field, lat, lon = linear_world()
    per_lat, per_lon = metres_per_radian(lat.mean())
    gradient = np.array([400.0 / np.radians(1) / per_lat, -250.0 / np.radians(1) / per_lon])  # per metre
    noise, prior = 2.0, np.diag([400.0, 500.0, 0.01, 0.008]) ** 2
    prior[0, 2] = prior[2, 0] = 0.6 * 400.0 * 0.01
    q = np.stack([(lat - lat.mean()) * per_lat, (lon - lon.mean()) * per_lon], axis=1)
    turned = np.stack([-q[:, 1], q[:, 0]], axis=1)
    J = -np.column_stack([np.tile(gradient, (12, 1)), turned @ gradient, q @ gradient]) / noise
    closed = np.linalg.inv(J.T @ J + np.linalg.inv(prior))

    def make(measured):
        track = MeasuredTrack(time=300.0 * np.arange(12), latitude=lat, longitude=lon, measured=measured)
        return GravityMatching(field, track, prior_covariance=prior, noise=noise)

    nominal = make(np.zeros(12))
    np.testing.assert_allclose(nominal.jacobian(nominal.nominal), J, rtol=1e-6)
    sigma = np.sqrt(np.diag(closed))
    np.testing.assert_allclose(
        nominal.error_bound(nominal.nominal) / np.outer(sigma, sigma),
        closed / np.outer(sigma, sigma),
        atol=1e-6,
    )
    # the data say something: the bound is smaller than the prior in the direction they see
    assert np.linalg.eigvalsh(np.linalg.solve(prior, closed)).min() < 0.2
    rng = np.random.default_rng(7)
    factor = np.linalg.cholesky(prior)
    squares, errors = [], []
    for _ in range(300):
        true = np.array([0, 0, 0, 1.0]) + factor @ rng.standard_normal(4)
        answer = nominal.estimate(true)
        problem = make(field.value(answer.latitude, answer.longitude) + noise * rng.standard_normal(12))
        mean, covariance = problem.prior()
        x = mean.copy()
        for _ in range(4):  # Gauss-Newton
            r, j = problem.residuals(x), problem.jacobian(x)
            weight = np.linalg.inv(covariance)
            x = x - np.linalg.solve(j.T @ j + weight, j.T @ r + weight @ (x - mean))
        errors.append(x - true)
        squares.append((x - true) @ np.linalg.solve(problem.error_bound(true), x - true))
    assert stats.kstest(squares, stats.chi2(4).cdf).pvalue > LEVEL
    np.testing.assert_allclose(np.std(errors, axis=0) / sigma, 1.0, atol=0.15)


def test_the_bound_uses_the_truth_by_default_and_needs_a_point_without_it(world):
    np.testing.assert_array_equal(world.error_bound(), world.error_bound(world.project(world.truth)))
    blind = rebuilt(world, track=with_track(world, true_latitude=None, true_longitude=None))
    with pytest.raises(NavoptError, match="needs x"):
        blind.error_bound()
    assert (np.diag(blind.error_bound(blind.nominal)) <= np.diag(blind.prior()[1]) * (1 + 1e-9)).all()


# -- worlds ----------------------------------------------------------------------------------------------


def test_a_seed_is_a_world(world):
    again = simulate("gravity-matching", 0, hours=2.0)
    other = simulate("gravity-matching", 1, hours=2.0)
    for name in ("latitude", "longitude", "measured"):
        np.testing.assert_array_equal(getattr(world.track, name), getattr(again.track, name))
        assert (getattr(world.track, name)[1:] != getattr(other.track, name)[1:]).all()
    np.testing.assert_array_equal(world.track.true_latitude, other.track.true_latitude)  # one voyage
    assert world.track.time[-1] == 7200.0
    assert len(world.track) == 25


def test_redraw_is_the_same_world_with_other_noise(world):
    twin = world.redraw(4)
    for name in ("time", "latitude", "longitude", "true_latitude", "true_longitude"):
        np.testing.assert_array_equal(getattr(world.track, name), getattr(twin.track, name))
    np.testing.assert_array_equal(world.xl, twin.xl)
    assert (world.track.measured != twin.track.measured).all()
    np.testing.assert_array_equal(twin.track.measured, world.redraw(4).track.measured)
    np.testing.assert_array_equal(twin.redraw(4).track.measured, twin.track.measured)
    # noise seed 0 is not the noise of the world itself
    assert (world.redraw(0).track.measured != world.track.measured).all()


@pytest.mark.parametrize("sigma", [0.2])
def test_the_noise_has_the_declared_size_and_is_white(sigma):
    world = simulate("gravity-matching", 5, hours=1.0, noise_mgal=sigma)
    clean = world.field_map.value(world.track.true_latitude, world.track.true_longitude)
    noise = np.array([world.redraw(seed).track.measured - clean for seed in range(60)]) / sigma
    assert stats.kstest(noise.ravel(), stats.norm.cdf).pvalue > LEVEL
    correlation = np.corrcoef(noise.T)[np.triu_indices(noise.shape[1], 1)]
    assert np.abs(correlation).max() < 6 / np.sqrt(60)
    assert world.noise == sigma


def residuals_at_truth(worlds):
    out = []
    for world in worlds:
        track = world.track
        out.append(
            (track.measured - world.field_map.value(track.true_latitude, track.true_longitude)) / world.noise
        )
    return np.array(out)


def test_a_random_map_error_has_the_declared_size():
    worlds = [simulate("gravity-matching", seed, hours=3.0, map_error=3.0) for seed in range(16)]
    assert worlds[0].noise == pytest.approx(np.hypot(1.0, 3.0))
    # five to eight independent patches of 10 km on each track
    assert 0.85 < np.sqrt(np.mean(residuals_at_truth(worlds) ** 2)) < 1.15
    difference = worlds[0].field_map.values - FieldMap.embedded().values
    assert difference.std() == pytest.approx(3.0)
    # correlation exp(-(d/L)²) with L = 10 km: 0.368 there, along a meridian and along a parallel
    for axis, cells in ((0, 10e3 / 1845.0), (1, 10e3 / 1855.0 / np.cos(np.radians(21.75)))):
        low, share = int(cells), cells - int(cells)
        at = [
            np.mean(np.roll(difference, -k, axis=axis)[30:-30, 30:-30] * difference[30:-30, 30:-30]) / 9.0
            for k in (low, low + 1)
        ]
        assert at[0] * (1 - share) + at[1] * share == pytest.approx(np.exp(-1), abs=0.08)
    assert (worlds[0].field_map.values != worlds[1].field_map.values).all()
    np.testing.assert_array_equal(worlds[0].redraw(3).field_map.values, worlds[0].field_map.values)


def test_a_coarse_map_has_the_declared_error_along_the_voyage():
    """One fixed, uneven field (seamounts): the rms over the whole voyage is of the declared size, no more."""
    coarse = simulate("gravity-matching", 0, hours=13.0, map_error="degree-720")
    assert 0.5 < np.sqrt(np.mean(residuals_at_truth([coarse]) ** 2)) < 2.0
    np.testing.assert_array_equal(coarse.field_map.values, FieldMap.embedded(720).values)


def test_published_worlds_share_one_inertial_error():
    a, b = (simulate("gravity-matching", seed, hours=2.0, ins="published") for seed in (0, 1))
    np.testing.assert_array_equal(a.track.latitude, b.track.latitude)
    assert (a.track.measured != b.track.measured).all()
    error = ecef_distance(
        a.track.latitude[-1:], a.track.longitude[-1:], a.track.true_latitude[-1:], a.track.true_longitude[-1:]
    )
    assert 1000 < error[0] < 20000


@pytest.mark.parametrize(
    "solver", ["abc", "affine-abc", "pso", "de", "cmaes", "nelder-mead", "random-search"]
)
def test_a_first_population_does_not_contain_the_truth(solver):
    """With one random stream for worlds and solvers the first individual can be the truth."""
    nearest = []
    for seed in range(12):
        world = simulate("gravity-matching", seed, hours=1.0)
        algorithm = make_solver(solver)
        algorithm.setup(world, seed=seed)
        X = algorithm.ask().get("X")
        unit = np.abs(X - world.project(world.truth)) / (world.xu - world.xl)
        nearest.append(unit.max(axis=1).min())
    # a hundred uniform draws come within 0.01 of a point of four dimensions once in 60,000
    assert min(nearest) > 0.01


@pytest.mark.parametrize(
    "scenario",
    [
        {"hours": 0.0},
        {"hours": 17.0},
        {"hours": 0.5},
        {"noise_mgal": 0.0},
        {"noise_mgal": -1.0},
        {"interval_s": np.nan},
        {"ins": "perfect"},
        {"map_error": "degree-360"},
        {"map_error": -1.0},
        {"degree": 360},
        {"criterion": "mse"},
        {"box": "large"},
        {"method": "nearest"},
        {"window": 2},
        {"window": 12.0},
        {"seed": -1},
    ],
)
def test_unusable_scenarios_are_refused(scenario):
    name = next(iter(scenario))
    with pytest.raises(NavoptError, match=name):
        simulate("gravity-matching", **{"hours": 2.0, **scenario})


def test_an_unknown_scenario_key_is_refused_with_a_suggestion():
    with pytest.raises(UnknownName, match="hours"):
        simulate("gravity-matching", 0, hour=2.0)


# -- off the map, broken input ------------------------------------------------------------------------------


def edge_world(world):
    """The world on a map cut so close that large shifts leave it."""
    track = world.track
    west, east = np.degrees(track.longitude[-12:].min()), np.degrees(track.longitude[-12:].max())
    south, north = np.degrees(track.latitude[-12:].min()), np.degrees(track.latitude[-12:].max())
    return rebuilt(
        world, field_map=world.field_map.crop((west - 0.05, east + 0.05, south - 0.05, north + 0.05))
    )


def test_a_point_off_the_map_is_infinitely_bad_and_counted(world):
    problem = edge_world(world)
    X = candidates(problem, 500, spread=1.0)
    latitude, longitude = positions(problem, X)
    outside = np.isnan(looked_up(problem.field_map, latitude, longitude)).any(axis=1)
    assert 20 < outside.sum() < 480
    np.testing.assert_array_equal(np.isinf(problem.loss(X)), outside)
    answer = solve(problem, "random-search", budget=300, seed=1)
    assert list(answer.invalid) == ["a point of the track lies outside the map"]
    tried = np.random.default_rng(1).uniform(problem.xl, problem.xu, (300, 4))
    assert answer.invalid["a point of the track lies outside the map"] == np.isinf(problem.loss(tried)).sum()
    assert np.isfinite(answer.loss)


def test_infinite_candidates_are_off_the_map_and_nan_is_refused(world):
    assert world.loss([np.inf, 0.0, 0.0, 1.0]) == np.inf
    with pytest.raises(InvalidInput, match="NaN"):
        world.loss([[0.0, 0.0, 0.0, 1.0], [0.0, np.nan, 0.0, 1.0]])
    with pytest.raises(InvalidInput, match="4 parameters"):
        world.loss([0.0, 0.0, 0.0])


def test_a_map_that_does_not_cover_the_track_is_refused(world):
    small = world.field_map.crop((150.0, 151.0, 20.0, 21.0))
    with pytest.raises(InvalidInput, match="outside the map") as error:
        rebuilt(world, field_map=small)
    assert "150° to 151°E" in str(error.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"latitude": "degrees"}, "radians"),
        ({"measured": "nan"}, "not finite"),
        ({"time": "backwards"}, "increase"),
        ({"true_longitude": None}, "both or none"),
        ({"measured": "short"}, "one value per time"),
    ],
)
def test_broken_tracks_are_refused(world, change, message):
    name, how = next(iter(change.items()))
    values = getattr(world.track, name).copy()
    if how == "degrees":
        values = np.degrees(values)
    elif how == "nan":
        values[3] = np.nan
    elif how == "backwards":
        values[[3, 4]] = values[[4, 3]]
    elif how == "short":
        values = values[:-1]
    with pytest.raises(InvalidInput, match=message) as error:
        with_track(world, **{name: None if how is None else values})
    assert name in str(error.value)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"prior_covariance": None}, "position_covariance"),
        ({"position_covariance": np.eye(24)}, "position_covariance"),
        ({"prior_covariance": np.eye(3)}, "prior_covariance"),
        ({"prior_covariance": np.diag([1.0, 1.0, 0.0, 1.0])}, "prior_covariance"),
        ({"prior_covariance": np.diag([1.0, 1.0, np.nan, 1.0])}, "prior_covariance"),
        (
            {"prior_covariance": np.array([[1, 2, 0, 0], [2, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])},
            "prior_covariance",
        ),
        ({"noise": 0.0}, "noise"),
        ({"noise": np.nan}, "noise"),
        ({"window": 1}, "window"),
        ({"window": 1000}, "window"),
        ({"method": "nearest"}, "method"),
        ({"criterion": "mse"}, "criterion"),
    ],
)
def test_broken_arguments_are_refused(world, options, name):
    with pytest.raises(NavoptError, match=name):
        rebuilt(world, **options)


# -- the object -------------------------------------------------------------------------------------------


def test_a_pickled_world_is_the_same_and_as_immutable(world):
    revived = pickle.loads(pickle.dumps(world))
    X = candidates(world, 20)
    np.testing.assert_array_equal(revived.loss(X), world.loss(X))
    np.testing.assert_array_equal(revived.redraw(2).track.measured, world.redraw(2).track.measured)
    assert copy.deepcopy(world) is world
    for problem in (world, revived):
        with pytest.raises(InvalidInput, match="immutable"):
            problem.noise = 3.0
        arrays = {
            "sequence": problem.sequence,
            "measured": problem.measured,
            "prior": problem.prior()[1],
            "lower": problem.xl,
            "upper": problem.xu,
            "track": problem.track.latitude,
            "truth": problem.truth.latitude,
        }
        writeable = [name for name, array in arrays.items() if array.flags.writeable]
        assert writeable == [], f"can be written to: {writeable}"


@pytest.mark.parametrize("turn", [0.0, -2 * np.pi])
def test_the_picture_of_a_world_covers_its_tracks(world, turn):
    track = with_track(world, longitude=world.track.longitude + turn, true_latitude=None, true_longitude=None)
    for problem in (world, rebuilt(world, track=track)):
        picture = problem.illustration()
        rows, columns = picture["map_values"].shape
        assert rows == len(picture["map_latitude"]) > 20
        assert columns == len(picture["map_longitude"]) > 20
        assert picture["map_latitude"].min() <= picture["ins_latitude"].min()
        assert picture["map_latitude"].max() >= picture["ins_latitude"].max()
        around = np.array([picture["map_longitude"][[0, -1]], picture["ins_longitude"][[-1, 0]]])
        assert (np.sin(around[1] - around[0]) * [1, -1] > 0).all()
