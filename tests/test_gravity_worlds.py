"""Harder worlds of gravity matching: each trouble has its declared size and leaves all else as it was."""

import inspect

import numpy as np
import pytest
from scipy import stats

from navopt import simulate
from navopt.errors import InvalidInput, NavoptError
from navopt.models.cruise import CruiseScenario
from navopt.models.earth import separation
from navopt.models.field_map import FieldMap
from navopt.problems.gravity_errors import GravimeterErrors, eotvos_correction, eotvos_error
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gravity_scenario import AREAS, WorldScenario
from navopt.problems.gravity_sensing import MeasurementErrors

LEVEL = 0.001 / 12  # twelve statistical checks in this file


def world(seed=0, **scenario):
    return simulate("gravity-matching", seed, **scenario)


def errors_of(problem):
    """Measured minus mapped value at the true positions."""
    track = problem.track
    return track.measured - problem.field_map.value(track.true_latitude, track.true_longitude)


def position_error(track):
    return np.stack(
        separation(track.latitude, track.longitude, track.true_latitude, track.true_longitude), axis=-1
    )


# -- what was there before -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "numbers"),
    [
        (
            {"seed": 0, "hours": 2.0},
            [0.3541031625009861, 2.7161509805241213, -40.47108284779233, -20.23424299644918,
             -9988.483004081012, 2.1040097070231916],
        ),
        (
            {"seed": 3, "hours": 3.0, "degree": 720, "ins": "published", "box": "paper"},
            [0.35550338052357, 2.712108522538593, -31.376421333647425, -29.224545139502794,
             -17139.18045052177, 6.288385050969468],
        ),
        (
            {"seed": 5, "hours": 2.0, "map_error": "degree-720", "noise_seed": 4},
            [0.3539390854411791, 2.7145575731135576, -42.918680185301774, -19.210708784212645,
             -9988.483004081012, 4.510986336350519],
        ),
    ],
)  # fmt: skip
def test_worlds_without_trouble_are_those_of_the_first_release(scenario, numbers):
    """Numbers printed before any of the harder worlds existed."""
    problem = world(**scenario)
    track = problem.track
    found = [
        track.latitude[-1], track.longitude[-1], track.measured[-1], track.measured[0],
        problem.xl[0], problem.loss(problem.nominal),
    ]  # fmt: skip
    np.testing.assert_allclose(found, numbers, rtol=1e-9)


def test_every_keyword_at_its_default_changes_no_bit():
    defaults = {
        name: p.default
        for name, p in inspect.signature(GravityMatching.simulate).parameters.items()
        if name != "seed"
    }
    a, b = world(4), world(4, **defaults)
    for name in ("latitude", "longitude", "measured"):
        np.testing.assert_array_equal(getattr(a.track, name), getattr(b.track, name))
    np.testing.assert_array_equal(a.prior()[1], b.prior()[1])
    assert a.measurement_errors == b.measurement_errors == MeasurementErrors(map_error_length=10e3)


@pytest.mark.parametrize(
    "trouble",
    [
        {"bias_mgal": 5.0},
        {"drift_mgal_h": 1.0},
        {"outlier_fraction": 0.3},
        {"eotvos": True},
        {"map_error": 2.0},
        {"criterion": "huber"},
        {"declared": {"noise": 4.0}},
    ],
    ids=lambda trouble: next(iter(trouble)),
)
def test_a_trouble_meets_the_same_voyage_ins_and_noise(trouble):
    plain, hard = world(2, hours=2.0), world(2, hours=2.0, **trouble)
    for name in ("latitude", "longitude", "true_latitude", "true_longitude"):
        np.testing.assert_array_equal(getattr(plain.track, name), getattr(hard.track, name))
    name = next(iter(trouble))
    added = hard.track.measured - plain.track.measured
    assert added.any() == (name in ("bias_mgal", "drift_mgal_h", "outlier_fraction", "eotvos"))
    if name == "outlier_fraction":
        assert 0 < np.sum(added != 0.0) < 16  # about 0.3 of 25
    if name == "bias_mgal":
        np.testing.assert_allclose(added, added[0])
    if name == "drift_mgal_h":
        np.testing.assert_allclose(added, added[-1] * plain.track.time / 7200.0, atol=1e-12)


# -- gravimeter ----------------------------------------------------------------------------------------


def drawn_noise(errors, count=40000):
    return errors.draw_noise(count, np.random.default_rng(1), np.random.default_rng(2))


def test_noise_with_heavy_tails_is_students_with_the_declared_standard_deviation():
    noise = drawn_noise(GravimeterErrors(noise=2.0, freedom=5.0))
    scale = 2.0 * np.sqrt(3.0 / 5.0)
    assert stats.kstest(noise / scale, stats.t(5).cdf).pvalue > LEVEL
    # fourth moment of t(5): 9, so the variance of n samples has a standard error of sqrt(8/n)
    assert abs(noise.var() / 4.0 - 1.0) < stats.norm.isf(LEVEL) * np.sqrt(8.0 / len(noise))
    assert stats.kstest(noise / 2.0, stats.norm.cdf).pvalue < 1e-6


def test_outliers_strike_the_declared_share_by_the_declared_size():
    errors = {"noise": 1.5, "outlier": 12.0}
    clean = drawn_noise(GravimeterErrors(**errors))
    struck = drawn_noise(GravimeterErrors(**errors, outlier_fraction=0.05)) - clean
    hit = struck != 0.0
    assert stats.binomtest(int(hit.sum()), len(hit), 0.05).pvalue > LEVEL
    assert stats.kstest(struck[hit] / 12.0, stats.norm.cdf).pvalue > LEVEL


def test_bias_and_drift_differ_from_world_to_world_as_declared():
    errors = GravimeterErrors(bias=5.0, drift_per_hour=0.5)
    time = np.array([0.0, 3600.0, 36000.0])
    drawn = np.array([errors.draw_offset(time, np.random.default_rng(seed)) for seed in range(600)])
    z = np.stack([drawn[:, 0] / 5.0, (drawn[:, 1] - drawn[:, 0]) / 0.5])
    assert stats.kstest(z.ravel(), stats.norm.cdf).pvalue > LEVEL
    np.testing.assert_allclose(drawn[:, 2] - drawn[:, 0], 10.0 * (drawn[:, 1] - drawn[:, 0]))
    hard = world(0, hours=1.0, bias_mgal=5.0, drift_mgal_h=0.5)
    assert hard.measurement_errors.bias == 5.0
    assert hard.measurement_errors.drift_per_day == 12.0
    # the instrument stays the same when its noise is drawn again
    plain = world(0, hours=1.0)
    offset = hard.track.measured - plain.track.measured
    np.testing.assert_allclose(hard.redraw(3).track.measured - plain.redraw(3).track.measured, offset)


def test_the_eotvos_effect_is_what_a_turning_sphere_gives():
    """On a sphere the outward acceleration is (Ω R cos φ + v_E)²/R + v_N²/R; less what it is at rest."""
    radius, rate = 6371e3, 7.292115e-5
    lat = np.radians([0.0, 20.0, -48.0, 65.0])
    velocity = np.array([[3.0, 7.0], [-4.0, 6.0], [0.0, -5.0], [8.0, 1.0]])
    rotating = ((rate * radius * np.cos(lat) + velocity[:, 1]) ** 2 + velocity[:, 0] ** 2) / radius
    sphere = 1e5 * (rotating - (rate * radius * np.cos(lat)) ** 2 / radius)
    # 1 % of v²/R: the ellipsoid is not a sphere
    np.testing.assert_allclose(eotvos_correction(lat, velocity), sphere, atol=0.02)
    one = eotvos_error(lat, np.zeros((4, 2)), np.tile([0.0, 1.0], (4, 1)))
    np.testing.assert_allclose(one, 14.58 * np.cos(lat) + 0.016, atol=0.01)
    assert np.abs(eotvos_error(lat, velocity, np.zeros((4, 2)))).max() == 0.0


def test_measurements_are_reduced_with_the_velocity_the_ins_shows():
    plain, hard = (world(1, hours=4.0, interval_s=60.0, eotvos=e) for e in (False, True))
    track = hard.track
    added = track.measured - plain.track.measured
    # velocity error by the differences of the position error, which the world does not use
    east = np.gradient(position_error(track)[:, 1], track.time)
    inside = slice(1, -1)
    expected = 14.58 * np.cos(track.true_latitude) * east
    # the rest is 2 v·δv/R: a few tenths of a mGal
    assert np.abs(added - expected)[inside].max() < 0.6
    assert np.ptp(added) > 5.0
    assert hard.measurement_errors.eotvos
    assert not plain.measurement_errors.eotvos


# -- map -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("shape", "length"), [("gaussian", 20e3), ("exponential", 6e3)])
def test_the_map_has_an_error_of_the_given_size_and_length(shape, length):
    made = world(3, map_error=2.5, map_error_length_m=length, map_error_shape=shape)
    error = made.field_map.values - FieldMap.embedded().values
    assert error.std() == pytest.approx(2.5)
    cell = np.radians(1 / 60) * 6371e3
    for axis, metres in ((0, cell), (1, cell * np.cos(np.radians(21.75)))):
        k = round(length / metres)
        ratio = k * metres / length
        expected = np.exp(-(ratio**2) if shape == "gaussian" else -ratio)
        a, b = (error[:-k], error[k:]) if axis == 0 else (error[:, :-k], error[:, k:])
        assert np.mean(a * b) / 2.5**2 == pytest.approx(expected, abs=0.07)
    assert made.measurement_errors == MeasurementErrors(map_error=2.5, map_error_length=length)
    assert made.noise == pytest.approx(np.hypot(1.0, 2.5))


def test_what_the_map_lacks_is_in_the_measurements_instead():
    told = {"map_error": 2.5, "map_error_length_m": 8e3}
    clean, noisy, smooth = world(3), world(3, **told), world(3, map_error_in="field", **told)
    np.testing.assert_array_equal(smooth.field_map.values, clean.field_map.values)
    np.testing.assert_array_equal(noisy.track.measured, clean.track.measured)
    error = FieldMap(
        clean.field_map.latitude,
        clean.field_map.longitude,
        noisy.field_map.values - clean.field_map.values,
        unit="mGal",
        name="error",
    )
    np.testing.assert_allclose(
        smooth.track.measured - clean.track.measured,
        error.value(clean.track.true_latitude, clean.track.true_longitude),
        atol=1e-9,
    )
    assert smooth.measurement_errors == noisy.measurement_errors
    with pytest.raises(InvalidInput, match="map_error_in"):
        world(3, map_error_in="truth")


def test_what_degree_720_lacks_is_declared_with_its_size_and_length():
    declared = world(0, map_error="degree-720").measurement_errors
    lacking = FieldMap.embedded(2190).values - FieldMap.embedded(720).values
    assert declared.map_error == pytest.approx(lacking.std())
    # its spectrum begins at 40000 km / 720 = 55 km: a wave of that length is 1/e correlated after 10.5 km
    assert 8e3 < declared.map_error_length < 13e3
    cells = declared.map_error_length / (np.radians(1 / 60) * 6371e3)
    low = int(cells)
    pair = [
        np.mean([np.mean(lacking[:-k] * lacking[k:]), np.mean(lacking[:, :-k] * lacking[:, k:])])
        for k in (low, low + 1, low + 2)
    ]
    assert pair[2] / lacking.var() < np.exp(-1) < pair[0] / lacking.var()


# -- declared errors ------------------------------------------------------------------------------------


def test_residuals_at_the_truth_are_white_under_everything_that_is_declared():
    """A placed track can be undone exactly, so that its residuals at the truth are the errors themselves."""
    common = {"ins": "placed", "hours": 3.0, "noise_mgal": 1.5}
    hard = {
        "bias_mgal": 8.0, "drift_mgal_h": 1.0, "map_error": 3.0,
        "map_error_length_m": 9e3, "map_error_shape": "exponential",
    }  # fmt: skip
    r = np.array([(w := world(seed, **common, **hard)).residuals(w.true_x) for seed in range(40)])
    assert stats.kstest(np.sum(r**2, axis=1), stats.chi2(12).cdf).pvalue > LEVEL
    assert stats.kstest(r.ravel(), stats.norm.cdf).pvalue > LEVEL
    told_nothing = dict.fromkeys(("bias", "drift_per_day", "map_error"), 0.0)
    careless = world(0, **common, **hard, declared=told_nothing)
    assert careless.measurement_errors == MeasurementErrors(noise=1.5, map_error_length=9e3)
    # which shows in its residuals
    squares = []
    for seed in range(8):
        told = world(seed, **common, **hard, declared=told_nothing)
        squares.append(np.mean(told.residuals(told.true_x) ** 2))
    assert np.mean(squares) > 4.0


def test_slopes_are_whitened_like_the_residuals():
    hard = world(0, hours=2.0, bias_mgal=5.0, map_error=2.0, drift_mgal_h=2.0, method="bicubic")
    x, width = hard.project(hard.truth), hard.xu - hard.xl
    J = hard.jacobian(x)
    for k in range(4):
        step = np.zeros(4)
        step[k] = 1e-6 * width[k]
        slope = (hard.residuals(x + step) - hard.residuals(x - step)) / (2 * step[k])
        np.testing.assert_allclose(J[:, k], slope, rtol=1e-4, atol=1e-6 * np.abs(J[:, k]).max())
    # knowing less about the measurements, one knows less about the position
    told = world(0, hours=2.0, method="bicubic")
    assert np.trace(hard.error_bound(x)[:2, :2]) > np.trace(told.error_bound(x)[:2, :2])
    outside = np.array([[1e7, 0.0, 0.0, 1.0], x])
    assert np.isinf(hard.residuals(outside)[0]).all()
    np.testing.assert_array_equal(hard.residuals(outside)[1], hard.residuals(x))


def test_outliers_and_the_shape_of_the_noise_are_not_declared():
    declared = world(0, noise_freedom=3.0, outlier_fraction=0.2).measurement_errors
    assert declared == world(0).measurement_errors


# -- losses --------------------------------------------------------------------------------------------


def plain_losses(problem, X):
    """Losses by their definitions, in numpy, from the estimates."""
    out = []
    for x in X:
        at = problem.estimate(x)
        d = problem.measured - problem.field_map.value(at.latitude, at.longitude, problem.method)
        if problem.offset == "free":
            d = d - (np.mean(d) if problem.criterion == "mean-square" else np.median(d))
        if problem.criterion == "mad":
            out.append(np.mean(np.abs(d)))
        elif problem.criterion == "mean-square":
            out.append(np.mean(d**2))
        else:
            t = problem.huber * problem.noise
            out.append(np.mean(np.where(np.abs(d) <= t, d**2, 2 * t * np.abs(d) - t**2)))
    return np.where(np.isnan(out), np.inf, out)


@pytest.mark.parametrize("window", [12, 7])
@pytest.mark.parametrize("offset", ["known", "free"])
@pytest.mark.parametrize("criterion", ["mad", "mean-square", "huber"])
def test_losses_are_their_definitions(criterion, offset, window):
    problem = world(0, hours=2.0, criterion=criterion, offset=offset, window=window)
    X = np.random.default_rng(0).uniform(problem.xl, problem.xu, (60, 4))
    X[0] = 1e7
    losses = problem.loss(X)
    assert losses[0] == np.inf
    np.testing.assert_allclose(losses, plain_losses(problem, X), rtol=1e-9)
    assert [float(problem.loss(x)) for x in X] == losses.tolist()
    if offset == "free":
        track = {name: getattr(problem.track, name) for name in ("time", "latitude", "longitude", "measured")}
        from navopt.data.tracks import MeasuredTrack

        moved = MeasuredTrack(**(track | {"measured": track["measured"] + 40.0}))
        other = GravityMatching(
            problem.field_map, moved, prior_covariance=problem.prior()[1],
            criterion=criterion, offset=offset, window=window,
        )  # fmt: skip
        np.testing.assert_allclose(other.loss(X[1:]), losses[1:], rtol=1e-9)


def test_hubers_loss_is_the_mean_square_as_long_as_nothing_is_large():
    a, b = (world(0, hours=2.0, criterion=c, huber=50.0) for c in ("huber", "mean-square"))
    X = np.random.default_rng(0).uniform(a.xl, a.xu, (20, 4))
    near = np.abs(a.residuals(X)).max(axis=1) < 50.0
    assert near.sum() > 5
    np.testing.assert_allclose(a.loss(X[near]), b.loss(X[near]))


def test_an_offset_is_free_where_a_bias_is_declared():
    assert world(0).offset == "known"
    assert world(0, bias_mgal=3.0).offset == "free"
    assert world(0, bias_mgal=3.0, offset="known").offset == "known"
    assert world(0, bias_mgal=3.0, declared={"bias": 0.0}).offset == "known"


# -- placed tracks ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "heading", "scale"), [(0.0, 0.0, 1.0), (30e3, 15.0, 1.3), (7e3, -9.0, 0.85)]
)
def test_a_placed_track_is_off_by_exactly_what_was_asked(error, heading, scale):
    problem = world(
        5, hours=4.0, ins="placed", initial_error_m=error, heading_error_deg=heading, scale_error=scale
    )
    track, last = problem.track, slice(-12, None)
    lat, lon = track.true_latitude[last], track.true_longitude[last]
    off = separation(track.latitude[last].mean(), track.longitude[last].mean(), lat.mean(), lon.mean())
    assert np.hypot(*off) == pytest.approx(error, rel=2e-3, abs=0.01)
    ends = [
        separation(a[-1], o[-1], a[-12], o[-12]) for a, o in ((track.latitude, track.longitude), (lat, lon))
    ]
    shown, true = (complex(*end) for end in ends)
    assert np.degrees(np.angle(shown / true)) == pytest.approx(heading, abs=0.15)
    assert abs(true) / abs(shown) == pytest.approx(scale, rel=2e-3)
    answer = problem.estimate(problem.true_x)
    assert problem.score(answer)["mean_position_error_m"] < 1e-6
    np.testing.assert_allclose(problem.true_x[2:], [np.radians(-heading), scale])


def test_a_placed_track_is_drawn_from_the_prior_that_it_declares():
    drawn = {"ins": "placed", "hours": 2.0, "initial_sigma_m": 4e3, "heading_sigma_deg": 2.0}
    worlds = [world(seed, **drawn) for seed in range(150)]
    mean, covariance = worlds[0].prior()
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(sigma, [4e3, 4e3, np.radians(2.0), 0.1])
    z = (np.array([w.true_x for w in worlds]) - mean) / sigma
    assert stats.kstest(z.ravel(), stats.norm.cdf).pvalue > LEVEL


# -- voyages and INS --------------------------------------------------------------------------------------


def test_a_voyage_with_turns_has_them_and_stays_near_its_course():
    for seed in range(4):
        scenario = WorldScenario(hours=16.0, voyage="turns")
        path = scenario.path(np.random.default_rng(seed))
        speed = np.hypot(*path.velocity.T) / CruiseScenario().speed
        assert 0.59 < speed.min() < 0.9
        assert 0.8 < speed.max() < 1.11
        turned = np.degrees(path.heading) - 300.0
        assert turned.max() > 15.0
        assert turned.min() < -15.0
        assert np.abs(turned).max() < 46.0
        aside = np.cumsum(np.hypot(*path.velocity.T) * np.sin(np.radians(turned))) * 2.0
        assert 5e3 < np.abs(aside).max() < 44e3


def test_the_declared_covariance_covers_the_ins_on_voyages_with_turns():
    """Normalised squares of the last position error, whose two components are normal to first order."""
    squares = []
    for seed in range(40):
        problem = world(seed, voyage="turns", hours=4.0)
        error = position_error(problem.track)[-1]
        squares.append(error @ np.linalg.solve(problem.position_covariance[-2:, -2:], error))
    assert stats.kstest(squares, stats.chi2(2).cdf).pvalue > LEVEL
    assert problem.track.heading is not None
    assert np.ptp(problem.track.heading) > np.radians(20.0)


def test_an_initial_position_error_has_the_declared_size():
    worlds = [world(seed, hours=1.0, interval_s=300.0, initial_sigma_m=20e3) for seed in range(60)]
    z = np.array([position_error(w.track)[0] for w in worlds]) / 20e3
    assert stats.kstest(z.ravel(), stats.norm.cdf).pvalue > LEVEL
    shift = np.sqrt(np.diag(worlds[0].prior()[1])[:2])
    np.testing.assert_allclose(shift, 20e3, rtol=0.05)
    assert worlds[0].ins_errors.latitude_error * 6.35e6 == pytest.approx(20e3, rel=0.01)


def test_an_initial_heading_error_widens_the_prior():
    plain, turned = world(0, hours=2.0), world(0, hours=2.0, heading_sigma_deg=2.0)
    assert turned.prior()[1][2, 2] > plain.prior()[1][2, 2] + 0.5 * np.radians(2.0) ** 2
    assert turned.ins_errors.attitude_error[2] == pytest.approx(np.radians(2.0))


def slope_rms(voyage, field, times):
    """Horizontal slope along a voyage by central differences over 100 m, mGal/km."""
    lat, lon = voyage.position(times)
    north = 100.0 / 6.36e6
    east = 100.0 / (6.378e6 * np.cos(lat))
    a = field.value(lat + north, lon, "bicubic") - field.value(lat - north, lon, "bicubic")
    b = field.value(lat, lon + east, "bicubic") - field.value(lat, lon - east, "bicubic")
    return float(np.sqrt(np.mean((a**2 + b**2) / 0.2**2)))


def test_the_areas_differ_in_the_slope_of_the_field():
    field, times = FieldMap.embedded(2190), np.arange(0.0, 16 * 3600.0 + 1.0, 600.0)
    values = {area: slope_rms(WorldScenario(area=area, hours=16.0).course, field, times) for area in AREAS}
    assert values["smooth"] == pytest.approx(0.42, abs=0.04)
    assert values["typical"] == pytest.approx(1.9, abs=0.2)
    assert values["rough"] == pytest.approx(5.5, abs=0.5)
    for area in AREAS:
        assert world(0, area=area, hours=16.0, ins="placed").truth is not None


@pytest.mark.slow
def test_the_areas_are_the_smoothest_and_roughest_there_are():
    field, times = FieldMap.embedded(2190), np.arange(0.0, 16 * 3600.0 + 1.0, 600.0)
    # clear of the border by 30 km at departure and by 90 km, as far as the INS may drift, after 16 h
    margin = np.radians((30 + 60 * times / 57600) / 111.0)
    west, east, south, north = np.radians(field.bounds_deg)
    found = []
    for lat0 in np.arange(19.75, 24.0, 0.25):
        for lon0 in np.arange(147.75, 156.6, 0.25):
            for azimuth in range(0, 360, 15):
                at = (float(lat0), float(lon0), float(azimuth))
                start = dict(zip(("latitude", "longitude", "azimuth"), np.radians(at), strict=True))
                voyage = CruiseScenario(**start)
                lat, lon = voyage.position(times)
                across = margin / np.cos(lat)
                if (lat - margin < south).any() or (lat + margin > north).any():
                    continue
                if (lon - across < west).any() or (lon + across > east).any():
                    continue
                found.append((slope_rms(voyage, field, times), at))
    found.sort()
    assert len(found) == 1341
    assert found[0][1] == AREAS["smooth"]
    assert found[-1][1] == AREAS["rough"]


def test_a_minutes_sampling_has_five_times_the_samples():
    dense = world(0, hours=1.0, interval_s=60.0)
    assert len(dense.track) == 61
    np.testing.assert_allclose(np.diff(dense.track.time), 60.0)


# -- refusals -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "scenario",
    [
        {"area": "flat"},
        {"voyage": "circles"},
        {"map_error_length_m": 0.0, "map_error": 1.0},
        {"map_error_shape": "square", "map_error": 1.0},
        {"noise_freedom": 2.0},
        {"outlier_fraction": 1.0},
        {"outlier_mgal": -1.0},
        {"bias_mgal": np.nan},
        {"drift_mgal_h": -0.1},
        {"eotvos": 1},
        {"eotvos": True, "ins": "placed"},
        {"declared": {"sigma": 1.0}},
        {"declared": {"noise": 0.0}},
        {"declared": 3.0},
        {"initial_sigma_m": 0.0},
        {"heading_sigma_deg": -1.0},
        {"initial_error_m": 5e3},
        {"heading_error_deg": 5.0},
        {"scale_error": 1.1},
        {"scale_error": 0.0, "ins": "placed"},
        {"heading_error_deg": 200.0, "ins": "placed"},
        {"huber": 0.0},
        {"offset": "maybe"},
        {"bias_mgal": True},
    ],
    ids=str,
)
def test_unusable_scenarios_are_refused(scenario):
    with pytest.raises(NavoptError) as error:
        world(0, hours=2.0, **scenario)
    name = next(iter(scenario))
    assert name in str(error.value) or "noise" in str(error.value)


def test_noise_is_given_once():
    made = world(0, hours=2.0)
    with pytest.raises(NavoptError, match="leave it out"):
        GravityMatching(
            made.field_map, made.track, prior_covariance=made.prior()[1],
            noise=1.0, measurement_errors=MeasurementErrors(),
        )  # fmt: skip
