"""ICCP against contours found by others, fields with a known answer, and its promises about the budget."""

from __future__ import annotations

import contourpy
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from baselines import Iccp
from baselines.iccp_grid import plane_grid
from baselines.iccp_kernels import closest_on_contour
from navopt import Solution, simulate, solve
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import local_tangent_plane, to_geodetic
from navopt.models.field_map import FieldMap
from navopt.problems.gravity_matching import GravityMatching

GRID = (-40.0, 70.0, 3.0, 5.0)  # north and east of the first node, and the steps
EVERYWHERE = np.array([-1e9, 1e9, -1e9, 1e9])
PRIOR = np.diag([4e6, 4e6, 0.01, 0.01])


def closest(values, level, point, region=EVERYWHERE, allowed=10**9):
    return closest_on_contour(values, GRID, level, *point, region, allowed, np.empty((4, 2)))


def field(seed, shape=(30, 40), smooth=3.0):
    return gaussian_filter(np.random.default_rng(seed).normal(size=shape), smooth) * 100.0


def segments(values, level):
    """Pieces of the contour as contourpy draws it, (n, 2, 2), north and east."""
    north = GRID[0] + GRID[2] * np.arange(values.shape[0])
    east = GRID[1] + GRID[3] * np.arange(values.shape[1])
    lines = contourpy.contour_generator(east, north, values, name="serial").lines(level)
    pieces = [np.stack([line[:-1, ::-1], line[1:, ::-1]], axis=1) for line in lines]
    return np.concatenate(pieces) if pieces else np.empty((0, 2, 2))


def to_segments(pieces, point):
    """Least distance of a point to line segments."""
    a, u = pieces[:, 0], pieces[:, 1] - pieces[:, 0]
    length = (u**2).sum(axis=1)
    t = np.clip(((point - a) * u).sum(axis=1) / np.where(length, length, 1.0), 0.0, 1.0)
    return np.sqrt((((a + t[:, None] * u) - point) ** 2).sum(axis=1).min(initial=np.inf))


# -- the nearest point -----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_the_nearest_contour_point_is_that_of_contourpy(seed):
    values, rng = field(seed), np.random.default_rng(seed)
    found = 0
    for level in rng.uniform(values.min() * 1.1, values.max() * 1.1, 25):
        pieces = segments(values, level)
        for point in rng.uniform([-60.0, 40.0], [70.0, 300.0], (8, 2)):  # also beside the map
            squared, north, east, _ = closest(values, level, point)
            assert np.sqrt(squared) == pytest.approx(to_segments(pieces, point), abs=1e-9)
            if np.isfinite(squared):
                found += 1
                assert np.hypot(north - point[0], east - point[1]) == pytest.approx(np.sqrt(squared))
    assert found > 100


@pytest.mark.parametrize("seed", range(4))
def test_inside_a_region_it_is_the_nearest_of_densely_sampled_points(seed):
    values, rng = field(seed), np.random.default_rng(100 + seed)
    seen = 0
    for level in rng.uniform(values.min(), values.max(), 25):
        pieces = segments(values, level)
        t = np.linspace(0.0, 1.0, 200)[:, None, None]
        dense = (pieces[:, 0] * (1 - t) + pieces[:, 1] * t).reshape(-1, 2)
        for _ in range(4):
            point, centre = rng.uniform([-60.0, 40.0], [70.0, 300.0], (2, 2))
            half = rng.uniform(2.0, 40.0, 2)
            region = np.array(
                [centre[0] - half[0], centre[0] + half[0], centre[1] - half[1], centre[1] + half[1]]
            )
            within = (np.abs(dense - centre) <= half).all(axis=1)
            squared, north, east, _ = closest(values, level, point, region)
            if not within.any():
                # a piece shorter than the sampling may still cross a corner
                assert np.isinf(squared) or (np.abs([north - centre[0], east - centre[1]]) > half - 0.1).any()
                continue
            seen += 1
            best = np.sqrt(((dense[within] - point) ** 2).sum(axis=1).min())
            assert best - 0.05 <= np.sqrt(squared) <= best + 1e-9
            assert (np.abs([north - centre[0], east - centre[1]]) <= half + 1e-9).all()
    assert seen > 10


@pytest.mark.parametrize("seed", range(20))
def test_the_four_cuts_of_a_saddle_are_joined_as_the_hyperbola_has_it(seed):
    """Of the two ways to join them, the one nearer to the bilinear surface itself, finely sampled."""
    rng = np.random.default_rng(seed)
    saddle = 0.0
    while abs(saddle) < 0.2:  # where it is on the level, neither way is the nearer one
        high, low = rng.uniform(0.2, 3.0, 2), -rng.uniform(0.2, 3.0, 2)
        values = np.array([[high[0], low[0]], [low[1], high[1]]]) * rng.choice([-1.0, 1.0])
        saddle = np.linalg.det(values) / (np.trace(values) - low.sum() * np.sign(values[0, 0]))
    t = np.linspace(0.0, 1.0, 2001)

    def zeros(cell):
        """On lines of constant east fraction the surface is linear: its zeros exactly, (n, 2)."""
        south, north = cell[0, 0] * (1 - t) + cell[0, 1] * t, cell[1, 0] * (1 - t) + cell[1, 1] * t
        with np.errstate(divide="ignore", invalid="ignore"):
            v = south / (south - north)
        keep = (v >= 0.0) & (v <= 1.0)
        return np.stack([v[keep], t[keep]], axis=1)

    def place(cuts):
        return np.asarray(cuts) * [GRID[2], GRID[3]] + [GRID[0], GRID[1]]

    curve = place(np.concatenate([zeros(values), zeros(values.T)[:, ::-1]]))
    (a, b), (c, d) = values
    south, east, north, west = place([(0, a / (a - b)), (b / (b - d), 1), (1, c / (c - d)), (a / (a - c), 0)])
    ways = [np.array([[south, east], [north, west]]), np.array([[south, west], [north, east]])]
    points = place(rng.uniform(0.0, 1.0, (200, 2)))
    exact = np.sqrt(((points[:, None] - curve) ** 2).sum(axis=2).min(axis=1))
    drawn = np.array([[to_segments(way, point) for point in points] for way in ways])
    best = drawn[np.argmin(np.abs(drawn - exact).max(axis=1))]
    mine = np.sqrt([closest(values, 0.0, point)[0] for point in points])
    np.testing.assert_allclose(mine, best, atol=1e-9)
    assert np.abs(drawn[0] - drawn[1]).max() > 0.1


def test_on_a_chord_the_map_is_off_by_a_quarter_of_the_twist_at_most():
    values, rng = field(7), np.random.default_rng(7)
    twist = np.abs(values[:-1, :-1] + values[1:, 1:] - values[:-1, 1:] - values[1:, :-1])
    checked, worst = 0, 0.0
    for level in rng.uniform(values.min(), values.max(), 200):
        squared, north, east, _ = closest(values, level, rng.uniform([-40.0, 70.0], [47.0, 265.0]))
        if np.isinf(squared):
            continue
        row, column = (north - GRID[0]) / GRID[2], (east - GRID[1]) / GRID[3]
        i, j = min(int(row), 28), min(int(column), 38)
        cell = values[i : i + 2, j : j + 2]
        v, u = row - i, column - j
        mapped = np.array([1 - v, v]) @ cell @ np.array([1 - u, u])
        assert abs(mapped - level) <= twist[i, j] / 4.0 + 1e-9
        worst = max(worst, abs(mapped - level) / (twist[i, j] / 4.0))
        checked += 1
    assert checked > 150
    assert worst > 0.5  # the bound is not idle


def test_contours_through_nodes_are_found():
    values = np.zeros((5, 6))
    values[2, 3] = 1.0
    point = (GRID[0] + 2 * GRID[2], GRID[1] + 3 * GRID[3] + 1.0)
    assert closest(values, 1.0, point)[:3] == pytest.approx((1.0, point[0], point[1] - 1.0))
    assert np.isinf(closest(values, 1.5, point)[0])
    assert closest(values, 0.5, (point[0], point[1] - 1.0))[0] == pytest.approx(
        (1.5 * 2.5) ** 2 / (1.5**2 + 2.5**2)
    )


def test_no_more_cells_are_looked_at_than_allowed():
    values = field(3)
    level, point = float(values.max() - 0.1), (-40.0, 70.0)
    *_, needed = closest(values, level, point)
    assert closest(values, level, point, allowed=needed)[3] == needed
    assert closest(values, level, point, allowed=needed - 1) == (np.inf, 0.0, 0.0, -1)
    assert needed < 29 * 39 + 1


# -- fields with a known answer --------------------------------------------------------------------------


def smooth_map(function, half_deg=1.0, step_deg=1.0 / 120.0):
    """A map of a function of (north, east) in kilometres about 10 N, 20 E."""
    axis = np.arange(-half_deg, half_deg + 1e-9, step_deg)
    north, east = local_tangent_plane(
        np.radians(10.0 + axis)[:, None], np.radians(20.0 + axis), np.radians(10.0), np.radians(20.0)
    )
    north, east = np.broadcast_arrays(north, east)
    return FieldMap.from_degrees(10.0 + axis, 20.0 + axis, function(north / 1e3, east / 1e3))


def planted(field_map, true, matrix, shift, **options):
    """A problem whose inertial track is the true one (n, 2), in metres, transformed about its centroid."""
    centre = true.mean(axis=0)
    shown = (true - centre) @ np.asarray(matrix).T + centre + shift
    real, indicated = (to_geodetic(*p.T, np.radians(10.0), np.radians(20.0)) for p in (true, shown))
    track = MeasuredTrack(
        time=300.0 * np.arange(len(true)),
        latitude=indicated[0],
        longitude=indicated[1],
        measured=field_map.value(*real),
        true_latitude=real[0],
        true_longitude=real[1],
    )
    return GravityMatching(field_map, track, **{"prior_covariance": PRIOR, **options})


def turn(degrees, scale=1.0):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return scale * np.array([[c, -s], [s, c]])


BENT = np.stack([np.linspace(-1e4, 1e4, 12), 6e3 * np.sin(np.linspace(0.0, 5.0, 12))], axis=1)


def hills(n, e):
    return 30.0 * np.sin(n / 9.0 + 0.4) * np.cos(e / 7.0) + 1.1 * n - 0.8 * e


@pytest.mark.parametrize("transform", ["rigid", "similarity"])
def test_on_a_linear_field_only_the_part_along_the_gradient_is_corrected(transform):
    gradient = np.array([3.0, -1.5])
    shift = np.array([700.0, 900.0])
    problem = planted(smooth_map(lambda n, e: 3.0 * n - 1.5 * e), BENT, np.eye(2), shift)
    found = solve(problem, Iccp(transform=transform)).estimate
    moved = np.stack(
        local_tangent_plane(found.latitude, found.longitude, np.radians(10.0), np.radians(20.0)), axis=1
    ) - (BENT + shift)
    along = gradient / np.hypot(*gradient)
    np.testing.assert_allclose(moved, np.tile(-(shift @ along) * along, (12, 1)), atol=0.05)
    assert found.outcome == "converged"
    assert found.difference < 1e-3
    assert found.iterations <= 3


@pytest.mark.parametrize(
    ("transform", "matrix", "tolerance"),
    [
        ("rigid", turn(0.0), 15.0),
        ("rigid", turn(4.0), 15.0),
        ("similarity", turn(-3.0, 1.05), 20.0),
        ("affine", turn(2.0, 0.97), 60.0),
        ("affine", turn(1.0) @ np.diag([1.04, 0.97]), 60.0),
    ],
)
def test_small_errors_on_a_hilly_field_are_corrected(transform, matrix, tolerance):
    """Noise-free: what remains are the chords through the cells."""
    problem = planted(smooth_map(hills), BENT, matrix, np.array([500.0, -400.0]))
    solver = Iccp(transform=transform, iterations=20000, tolerance_m=1e-6, ridge=1e-3)
    answer = solve(problem, solver)
    before = solve(problem, "nominal").scores["mean_position_error_m"]
    assert before > 500.0
    assert answer.scores["mean_position_error_m"] < tolerance
    assert answer.estimate.outcome == "converged"
    assert answer.estimate.accepted


def test_rotation_and_shift_of_the_answer_are_those_planted():
    problem = planted(smooth_map(hills), BENT, turn(4.0), np.array([500.0, -400.0]))
    x = solve(problem, Iccp(iterations=20000, tolerance_m=1e-6)).x
    np.testing.assert_allclose(x[:2], [-500.0, 400.0], atol=15.0)
    np.testing.assert_allclose(x[2:], [np.radians(-4.0), 1.0], atol=2e-3)


def test_a_scale_stays_within_the_box():
    box = [[-5e3, 5e3], [-5e3, 5e3], [-0.5, 0.5], [0.98, 1.02]]
    problem = planted(smooth_map(hills), BENT, turn(0.0, 1.1), np.zeros(2), box=box)
    found = solve(problem, Iccp(transform="similarity", iterations=2000)).estimate
    placed = np.stack(local_tangent_plane(found.latitude, found.longitude, *problem.origin), axis=1)
    spread = np.linalg.norm(placed - placed.mean(axis=0)) / np.linalg.norm(problem.sequence)
    assert spread == pytest.approx(0.98, rel=1e-6)  # 1/1.1 would be right


def rough(seed=1):
    values = 400.0 * gaussian_filter(np.random.default_rng(seed).normal(size=(161, 161)), 4.0)
    axis = np.linspace(-1.0, 1.0, 161)
    return FieldMap.from_degrees(10.0 + axis, 20.0 + axis, values)


@pytest.mark.parametrize("start_from", ["sobol", "tercom"])
def test_many_starts_find_what_one_start_does_not(start_from):
    """Errors of several contour spacings, no noise."""
    wide = {"prior_covariance": np.diag([16e6, 16e6, 4e-4, 1e-4])}
    failed = 0
    for seed in range(4):
        shift = 9e3 * turn(90.0 * seed + 20.0)[0]
        problem = planted(rough(seed), BENT, turn(1.0), shift, **wide)
        one = solve(problem, Iccp())
        many = solve(problem, Iccp(starts=200, start_from=start_from, iterations=300))
        failed += one.scores["position_error_m"] > 2e3
        assert many.scores["position_error_m"] < 100.0
        assert many.estimate.difference <= one.estimate.difference
        assert 1 < many.estimate.starts <= 200
    assert failed >= 2


def test_huber_weights_resist_an_outlier():
    field_map = smooth_map(hills)
    clean = planted(field_map, BENT, turn(1.0), np.array([300.0, -200.0]))
    measured = clean.track.measured.copy()
    measured[6] += 15.0
    spoilt = GravityMatching(
        field_map,
        MeasuredTrack(**{**{k: getattr(clean.track, k) for k in (
            "time", "latitude", "longitude", "true_latitude", "true_longitude")}, "measured": measured}),
        prior_covariance=PRIOR,
    )  # fmt: skip
    error = {
        weights: solve(spoilt, Iccp(weights=weights, iterations=5000)).scores["mean_position_error_m"]
        for weights in ("equal", "huber")
    }
    assert error["huber"] < 0.5 * error["equal"]


# -- how it ends -----------------------------------------------------------------------------------------


def test_values_that_occur_nowhere_are_said():
    problem = planted(smooth_map(hills), BENT, np.eye(2), np.zeros(2))
    track = MeasuredTrack(
        time=problem.track.time, latitude=problem.track.latitude, longitude=problem.track.longitude,
        measured=np.full(12, 1e4),
    )  # fmt: skip
    answer = solve(GravityMatching(problem.field_map, track, prior_covariance=PRIOR), "iccp")
    assert answer.estimate.outcome == "no-contour"
    assert not answer.estimate.accepted
    np.testing.assert_allclose(answer.x, [0.0, 0.0, 0.0, 1.0], atol=1e-6)


def test_a_single_iteration_and_a_track_that_gets_worse_are_said():
    problem = simulate("gravity-matching", 2, hours=3.0)
    first = solve(problem, Iccp(iterations=1)).estimate
    assert first.outcome == "iterations"
    assert first.iterations == 1
    assert not first.accepted
    # from the true track, with values of another place
    field_map = rough(5)
    good = planted(field_map, BENT, np.eye(2), np.zeros(2))
    ends = set()
    for seed in range(40):
        rng = np.random.default_rng(seed)
        track = MeasuredTrack(
            time=good.track.time, latitude=good.track.latitude, longitude=good.track.longitude,
            measured=good.track.measured + rng.normal(size=12) * 0.5 * field_map.values.std(),
        )  # fmt: skip
        small = GravityMatching(field_map, track, prior_covariance=np.diag([1e5, 1e5, 1e-4, 1e-4]))
        found = solve(small, Iccp()).estimate
        ends.add(found.outcome)
        if found.outcome == "diverged":
            start = np.abs(track.measured - field_map.value(track.latitude, track.longitude)).mean()
            assert found.difference > start
    assert {"diverged", "left-region"} <= ends


def test_the_answer_survives_its_files(tmp_path):
    answer = solve(simulate("gravity-matching", 0, hours=2.0), "iccp")
    answer.save(tmp_path / "answer")
    loaded = Solution.load(tmp_path / "answer").estimate
    assert loaded.outcome == answer.estimate.outcome
    np.testing.assert_array_equal(loaded.latitude, answer.estimate.latitude)


# -- the map's edges ---------------------------------------------------------------------------------------


def test_a_piece_of_the_map_is_where_the_map_says():
    problem = simulate("gravity-matching", 0, hours=2.0)
    limits = np.array([-30e3, 25e3, -18e3, 41e3])
    grid = plane_grid(problem, limits)
    rows, columns = np.array([0, 5, grid.values.shape[0] - 1]), np.array([3, 0, grid.values.shape[1] - 1])
    lat, lon = to_geodetic(
        grid.north + grid.north_step * rows, grid.east + grid.east_step * columns, *problem.origin
    )
    np.testing.assert_allclose(problem.field_map.value(lat, lon), grid.values[rows, columns], atol=1e-6)
    assert grid.north <= limits[0] < grid.north + grid.north_step
    assert grid.east <= limits[2] < grid.east + grid.east_step
    assert grid.north + grid.north_step * (grid.values.shape[0] - 1) >= limits[1]
    assert grid.east + grid.east_step * (grid.values.shape[1] - 1) >= limits[3]


@pytest.mark.parametrize("turns", [-360.0, 0.0, 360.0])
def test_map_and_track_may_count_longitudes_differently(turns):
    plain = planted(rough(), BENT, turn(1.0), np.array([300.0, 300.0]))
    axis = np.linspace(-1.0, 1.0, 161)
    moved = FieldMap.from_degrees(10.0 + axis, 20.0 + axis + turns / 2.0, rough().values)
    track = {k: getattr(plain.track, k) for k in ("time", "latitude", "measured")}
    longitude = plain.track.longitude - np.radians(turns / 2.0)
    if turns:
        other = MeasuredTrack(**track, longitude=longitude)
        # half a turn each way: the same places
        shifted = GravityMatching(moved, other, prior_covariance=PRIOR)
        found = solve(shifted, Iccp())
        np.testing.assert_allclose(found.x, solve(plain, Iccp()).x, rtol=1e-6, atol=1e-3)
        assert found.estimate.outcome == solve(plain, Iccp()).estimate.outcome


def test_a_map_around_the_earth_has_no_seam():
    rng = np.random.default_rng(3)
    values = 300.0 * gaussian_filter(rng.normal(size=(61, 3600)), 3, mode=("nearest", "wrap"))
    around = FieldMap.from_degrees(
        np.linspace(7.0, 13.0, 61), np.linspace(0.0, 360.0, 3601), np.column_stack([values, values[:, :1]])
    )
    # the same field from half-way round
    opened = FieldMap.from_degrees(
        np.linspace(7.0, 13.0, 61), np.linspace(-180.0, 179.9, 3600), np.roll(values, 1800, axis=1)
    )
    lat, lon = np.radians(np.linspace(9.8, 10.2, 12)), np.radians(np.linspace(-0.3, 0.3, 12))
    found = []
    for field_map, longitude in ((around, lon), (around, np.mod(lon, 2 * np.pi)), (opened, lon)):
        track = MeasuredTrack(
            time=300.0 * np.arange(12.0),
            latitude=lat,
            longitude=longitude,
            measured=opened.value(lat, lon) + 2.0,
        )
        found.append(solve(GravityMatching(field_map, track, prior_covariance=PRIOR), Iccp(starts=5)).x)
    np.testing.assert_allclose(found[0], found[2], rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(found[1], found[2], rtol=1e-6, atol=1e-3)
    assert np.abs(found[0][:2]).max() > 10.0


# -- budget and settings -----------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [{}, {"starts": 6}, {"starts": 6, "start_from": "tercom"}])
@pytest.mark.parametrize("budget", [1, 2, 3, 10, 77, 500])
def test_the_budget_is_never_exceeded(settings, budget):
    problem = simulate("gravity-matching", 1, hours=2.0)
    free = solve(problem, Iccp(**settings))
    cut = solve(problem, Iccp(**settings), budget=budget)
    assert cut.counts.cost <= budget
    assert cut.counts.loss == 1
    if budget == 1:
        assert cut.estimate.outcome == "budget"
        np.testing.assert_allclose(cut.x, [0.0, 0.0, 0.0, 1.0], atol=1e-6)
    if budget >= free.counts.cost and settings.get("start_from") != "tercom":
        np.testing.assert_array_equal(cut.x, free.x)
    exact = solve(problem, Iccp(**settings), budget=10 * free.counts.cost)
    assert exact.counts.cost <= 10 * free.counts.cost


def test_the_cost_of_one_start_is_exact():
    problem = simulate("gravity-matching", 1, hours=2.0)
    free = solve(problem, Iccp())
    enough = solve(problem, Iccp(), budget=free.counts.cost)
    assert enough.counts == free.counts
    np.testing.assert_array_equal(enough.x, free.x)
    less = solve(problem, Iccp(), budget=free.counts.cost // 2)
    assert less.estimate.outcome in ("budget", "diverged")
    assert less.estimate.iterations < free.estimate.iterations


def test_published_is_one_rigid_start():
    assert Iccp.published().settings == Iccp(transform="rigid", starts=1, weights="equal").settings
    assert Iccp.published(iterations=7).iterations == 7


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"transform": "projective"}, UnknownName),
        ({"starts": 0}, InvalidInput),
        ({"start_from": "random"}, UnknownName),
        ({"weights": "tukey"}, UnknownName),
        ({"ridge": -1.0}, InvalidInput),
        ({"iterations": 0}, InvalidInput),
        ({"tolerance_m": 0.0}, InvalidInput),
    ],
)
def test_unusable_settings_are_refused(settings, error):
    with pytest.raises(error, match=next(iter(settings))):
        Iccp(**settings)
