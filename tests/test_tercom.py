"""TERCOM against brute force in numpy, and its promises about the budget."""

import re

import numpy as np
import pytest
from scipy import ndimage
from scipy.interpolate import RegularGridInterpolator

from baselines import Tercom
from navopt import simulate, solve
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, NavoptError, UnknownName, UnsuitableProblem
from navopt.models.field_map import FieldMap
from navopt.problems.analytic import Sphere
from navopt.problems.gravity_matching import GravityMatching

A, E2 = 6378137.0, 6.6943799901413e-3  # WGS-84


@pytest.fixture(scope="module")
def world():
    return simulate("gravity-matching", 0, hours=2.0)


def prepared(problem, **options):
    algorithm = Tercom(**options)
    algorithm.setup(problem, seed=1)
    return algorithm


def rebuilt(world, *, measured=None, longitude=None, field_map=None, box=None, **options):
    track = world.track
    values = track.measured.copy()
    if measured is not None:
        values[-world.window :] = measured
    track = MeasuredTrack(
        time=track.time,
        latitude=track.latitude,
        longitude=track.longitude if longitude is None else longitude,
        measured=values,
    )
    box = np.stack([world.xl, world.xu], axis=1) if box is None else box
    return GravityMatching(
        field_map or world.field_map, track, prior_covariance=world.prior()[1], box=box, **options
    )


def mapped(problem, north, east, angle=0.0, scale=1.0):
    """Field along the moved track, from the definition of the ellipsoid and scipy; NaN off the map."""
    latitude, longitude = (
        getattr(problem.track, name)[-problem.window :] for name in ("latitude", "longitude")
    )
    lat0, lon0 = latitude.mean(), np.unwrap(longitude).mean()
    w = 1.0 - E2 * np.sin(lat0) ** 2
    per_lat, per_lon = A * (1 - E2) / w**1.5, A / np.sqrt(w) * np.cos(lat0)
    n, e = (latitude - lat0) * per_lat, (np.unwrap(longitude) - lon0) * per_lon
    moved_n = north + scale * (np.cos(angle) * n - np.sin(angle) * e)
    moved_e = east + scale * (np.sin(angle) * n + np.cos(angle) * e)
    field = problem.field_map
    lat, lon = np.degrees(lat0 + moved_n / per_lat), np.degrees(lon0 + moved_e / per_lon)
    west = np.degrees(field.longitude[0])
    axes = np.degrees(field.latitude), np.degrees(field.longitude)
    look = RegularGridInterpolator(axes, field.values, bounds_error=False)
    return look(np.stack([lat, west + (lon - west) % 360.0], axis=-1))


def brute_force(problem, north, east, angle, scale, criterion, remove_mean):
    z = problem.track.measured[-problem.window :]
    out = np.empty((len(north), len(east)))
    for a, b in np.ndindex(out.shape):
        h = mapped(problem, north[a], east[b], angle, scale)
        difference = z - h
        if remove_mean:
            difference = difference - difference.mean()
        if criterion == "correlation":
            value = -np.corrcoef(z, h)[0, 1]
        else:
            value = np.mean(np.abs(difference) if criterion == "mad" else difference**2)
        out[a, b] = np.inf if np.isnan(h).any() else value
    return out


SHIFTS = np.linspace(-9000, 9000, 9), np.linspace(-8000, 11000, 8)


@pytest.mark.parametrize("criterion", ["mad", "msd", "correlation"])
@pytest.mark.parametrize("remove_mean", [False, True])
@pytest.mark.parametrize("pose", [(0.0, 1.0), (0.2, 1.15)])
def test_the_surface_is_brute_forces(world, criterion, remove_mean, pose):
    surface = prepared(world, criterion=criterion, remove_mean=remove_mean).surface(*SHIFTS, *pose)
    expected = brute_force(world, *SHIFTS, *pose, criterion, remove_mean)
    np.testing.assert_allclose(surface, expected, rtol=1e-7, atol=1e-7)


def test_shifts_off_the_map_are_infinite_in_the_surface(world):
    track = world.track
    ends = [np.degrees(f(v[-12:])) for v in (track.longitude, track.latitude) for f in (np.min, np.max)]
    small = world.field_map.crop((ends[0] - 0.03, ends[1] + 0.04, ends[2] - 0.05, ends[3] + 0.02))
    problem = rebuilt(world, field_map=small)
    surface = prepared(problem).surface(*SHIFTS)
    expected = brute_force(problem, *SHIFTS, 0.0, 1.0, "mad", False)
    assert 10 < np.isinf(expected).sum() < expected.size - 4
    np.testing.assert_allclose(surface, expected, rtol=1e-7)


def test_the_mad_surface_is_the_problems_loss(world):
    surface = prepared(world).surface(*SHIFTS, 0.1, 0.95)
    north, east = np.meshgrid(*SHIFTS, indexing="ij")
    X = np.stack([north, east, np.full_like(north, 0.1), np.full_like(north, 0.95)], axis=-1)
    np.testing.assert_allclose(surface, world.loss(X), rtol=1e-9)


def test_a_value_does_not_depend_on_how_the_grid_is_cut(world):
    for criterion in ("mad", "msd", "correlation"):
        algorithm = prepared(world, criterion=criterion)
        whole = algorithm.surface(*SHIFTS)
        np.testing.assert_array_equal(algorithm.surface(SHIFTS[0][2:5], SHIFTS[1][3:]), whole[2:5, 3:])


def test_in_a_plane_field_the_surface_is_known():
    """With the field g_N n + g_E e every shift changes every difference by the same amount."""
    latitude, longitude = np.linspace(19, 23, 41), np.linspace(150, 156, 61)
    field = FieldMap.from_degrees(
        latitude, longitude, 40.0 * (latitude[:, None] - 21) - 25.0 * (longitude - 153)
    )
    t = np.linspace(0, 1, 12)
    lat, lon = np.radians(20.9 + 0.2 * t), np.radians(153.2 - 0.15 * t**2)
    track = MeasuredTrack(
        time=300 * np.arange(12.0), latitude=lat, longitude=lon, measured=field.value(lat, lon) + 3.0
    )
    problem = GravityMatching(field, track, prior_covariance=np.diag([1e7, 1e7, 0.01, 0.01]))
    w = 1.0 - E2 * np.sin(lat.mean()) ** 2
    per_lat, per_lon = A * (1 - E2) / w**1.5, A / np.sqrt(w) * np.cos(lat.mean())
    change = 40.0 * np.degrees(SHIFTS[0] / per_lat)[:, None] - 25.0 * np.degrees(SHIFTS[1] / per_lon)
    np.testing.assert_allclose(prepared(problem).surface(*SHIFTS), np.abs(3.0 - change), atol=1e-9)
    np.testing.assert_allclose(
        prepared(problem, criterion="msd").surface(*SHIFTS), (3.0 - change) ** 2, atol=1e-8
    )
    # without the mean nothing is left to compare, and the correlation is perfect everywhere
    for criterion in ("mad", "msd"):
        flat = prepared(problem, criterion=criterion, remove_mean=True).surface(*SHIFTS)
        np.testing.assert_allclose(flat, 0.0, atol=1e-9)
    np.testing.assert_allclose(prepared(problem, criterion="correlation").surface(*SHIFTS), -1.0, atol=1e-9)


def test_a_datum_offset_is_invisible_to_correlation_and_without_the_mean(world):
    z = world.track.measured[-12:]
    offset = rebuilt(world, measured=z + 30.0)
    for options in (
        {"criterion": "correlation"},
        {"remove_mean": True},
        {"criterion": "msd", "remove_mean": True},
    ):
        np.testing.assert_allclose(
            prepared(offset, **options).surface(*SHIFTS),
            prepared(world, **options).surface(*SHIFTS),
            rtol=1e-9,
            atol=1e-9,
        )
    assert not np.allclose(prepared(offset).surface(*SHIFTS), prepared(world).surface(*SHIFTS))
    scaled = rebuilt(world, measured=2.5 * z - 7.0)
    np.testing.assert_allclose(
        prepared(scaled, criterion="correlation").surface(*SHIFTS),
        prepared(world, criterion="correlation").surface(*SHIFTS),
        atol=1e-12,
    )


def test_a_flat_measurement_has_no_correlation(world):
    flat = rebuilt(world, measured=np.full(12, 4.0))
    np.testing.assert_array_equal(prepared(flat, criterion="correlation").surface(*SHIFTS), 1.0)


# -- longitudes ------------------------------------------------------------------------------------------


def rough_map(longitude_deg, seed=4):
    rng = np.random.default_rng(seed)
    latitude = np.linspace(10, 12, 121)
    values = 300 * ndimage.gaussian_filter(rng.normal(size=(121, len(longitude_deg))), 3, mode="wrap")
    if np.isclose(longitude_deg[-1] - longitude_deg[0], 360.0):
        values[:, -1] = values[:, 0]
    return FieldMap.from_degrees(latitude, longitude_deg, values)


def on_map(field, longitude_deg):
    lat, lon = np.radians(np.linspace(10.9, 11.1, 12)), np.radians(longitude_deg)
    lon = np.where(lon > 2 * np.pi, lon - 2 * np.pi, lon)  # as a receiver counts from 0 to 360
    track = MeasuredTrack(
        time=300 * np.arange(12.0), latitude=lat, longitude=lon, measured=field.value(lat, lon) + 1.0
    )
    return GravityMatching(field, track, prior_covariance=np.diag([9e6, 9e6, 1e-3, 1e-3]))


@pytest.mark.parametrize(
    ("map_from", "track_from"),
    [(200.0, -159.4), (-160.0, 200.6), (179.0, 179.85), (-181.0, 179.85), (-0.6, 359.9)],
)
def test_map_and_track_may_count_longitudes_differently(map_from, track_from):
    problem = on_map(rough_map(map_from + np.arange(121) / 60), track_from + np.linspace(0, 0.3, 12))
    surface = prepared(problem).surface(*SHIFTS)
    assert np.isfinite(surface).all()
    np.testing.assert_allclose(
        surface, brute_force(problem, *SHIFTS, 0.0, 1.0, "mad", False), rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("track_from", [-0.15, 359.85])
def test_a_track_may_cross_the_seam_of_a_map_around_the_earth(track_from):
    problem = on_map(rough_map(np.linspace(0, 360, 360 * 30 + 1)), track_from + np.linspace(0, 0.3, 12))
    assert np.isfinite(problem.loss(problem.nominal))
    surface = prepared(problem).surface(*SHIFTS)
    np.testing.assert_allclose(
        surface, brute_force(problem, *SHIFTS, 0.0, 1.0, "mad", False), rtol=1e-6, atol=1e-6
    )


# -- refinement ------------------------------------------------------------------------------------------


def quadratic(minimum, hessian):
    """A Tercom whose surface is a quadratic of the shift with a known minimum."""

    class Quadratic(Tercom):
        def surface(self, north, east, angle=0.0, scale=1.0):
            d = np.stack(np.meshgrid(north - minimum[0], east - minimum[1], indexing="ij"), axis=-1)
            return 5.0 + np.einsum("...a,ab,...b->...", d, np.asarray(hessian), d)

    return Quadratic


@pytest.mark.parametrize("minimum", [(0.0, 0.0), (130.0, -210.0), (-1111.0, 777.7)])
@pytest.mark.parametrize(
    "hessian",
    [[[1e-6, 0.0], [0.0, 4e-6]], pytest.param([[1e-6, 8e-7], [8e-7, 2e-6]], id="oblique")],
)
def test_the_refinement_is_exact_on_a_quadratic_surface(world, minimum, hessian):
    algorithm = quadratic(minimum, hessian)(step_m=500.0)
    algorithm.setup(world, seed=1)
    node, refined = algorithm.propose()
    np.testing.assert_allclose(node[:2] % 500.0, 0.0, atol=1e-9)
    np.testing.assert_allclose(refined[:2], minimum, atol=1e-6)
    np.testing.assert_array_equal(refined[2:], [0.0, 1.0])


def test_the_refinement_stays_within_half_a_step_and_the_box(world):
    edge = quadratic((world.xu[0] + 5000.0, 100.0), [[1e-6, 0.0], [0.0, 4e-6]])(step_m=500.0)
    edge.setup(world, seed=1)
    node, refined = edge.propose()
    assert refined[0] == node[0]  # at the border of the grid there is no parabola
    assert refined[1] == pytest.approx(100.0, abs=1e-6)
    flat = quadratic((0.0, 0.0), np.zeros((2, 2)))(step_m=500.0)
    flat.setup(world, seed=1)
    node, refined = flat.propose()
    np.testing.assert_array_equal(node, refined)


def test_without_refinement_the_node_is_the_answer(world):
    plain = solve(world, Tercom(refine=False, step_m=600.0), seed=1)
    north, east = (np.arange(-k, k + 1) * 600.0 for k in (world.xu[:2] // 600.0).astype(int))
    surface = brute_force(world, north, east, 0.0, 1.0, "mad", False)
    a, b = np.unravel_index(surface.argmin(), surface.shape)
    np.testing.assert_allclose(plain.x, [north[a], east[b], 0.0, 1.0])
    assert plain.loss == pytest.approx(surface.min())
    assert plain.counts.loss == 1
    assert plain.counts.internal == surface.size
    refined = solve(world, Tercom(step_m=600.0), seed=1)
    assert refined.counts.loss == 2
    assert refined.loss <= plain.loss
    assert np.abs(refined.x - plain.x)[:2].max() <= 300.0


# -- rotation and scale ----------------------------------------------------------------------------------


@pytest.mark.parametrize("criterion", ["mad", "msd", "correlation"])
def test_a_planted_similarity_on_the_grid_is_found_exactly(world, criterion):
    box = [[-6000.0, 6000.0], [-6000.0, 6000.0], [-0.2, 0.2], [0.8, 1.2]]
    planted = np.array([1800.0, -2400.0, 0.1, 0.9])
    problem = rebuilt(world, measured=mapped(world, *planted), box=box)
    found = solve(problem, Tercom(criterion=criterion, step_m=600.0, rotations=5, scales=5, refine=False))
    np.testing.assert_allclose(found.x, planted, atol=1e-9)
    assert found.loss < 1e-6
    assert found.counts.internal == 21 * 21 * 25
    # without the search for them the track is laid elsewhere
    assert solve(problem, Tercom(step_m=600.0, refine=False)).loss > 0.05


def test_no_change_is_always_among_the_poses(world):
    box = [[-3000.0, 3000.0], [-3000.0, 3000.0], [-0.05, 0.3], [0.7, 1.1]]
    planted = np.array([600.0, -600.0, 0.0, 1.0])
    problem = rebuilt(world, measured=mapped(world, *planted), box=box)
    found = solve(problem, Tercom(step_m=600.0, rotations=3, scales=7, refine=False))
    np.testing.assert_allclose(found.x, planted, atol=1e-9)


def test_where_no_change_is_outside_the_box_the_nearest_is_taken(world):
    box = [[-3000.0, 3000.0], [-3000.0, 3000.0], [0.05, 0.3], [0.7, 0.9]]
    found = solve(rebuilt(world, box=box), Tercom(step_m=600.0, refine=False))
    np.testing.assert_array_equal(found.x[2:], [0.05, 0.9])


# -- budget ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("budget", [11, 12, 20, 26, 27, 99, 100, 451, 1000, 3333])
def test_the_budget_is_never_exceeded_and_mostly_used(world, budget):
    answer = solve(world, "tercom", budget=budget)
    assert answer.counts.cost <= budget
    assert answer.counts.cost == answer.counts.internal + answer.counts.loss
    assert answer.counts.loss == 2
    assert np.isfinite(answer.loss)
    # an odd number of lines per axis, and no finer than the default step
    assert answer.counts.internal >= min(0.75 * (budget - 2) - 8, solve(world, "tercom").counts.internal)
    assert float(world.loss(answer.x)) == answer.loss


def test_a_larger_budget_searches_more_finely_down_to_the_default_step(world):
    internal = [solve(world, "tercom", budget=budget).counts.internal for budget in (100, 400, 1600, 10**6)]
    assert internal == sorted(internal)
    assert len(set(internal)) >= 3
    without = solve(world, "tercom")
    assert without.counts.internal == internal[-1]
    n = 2 * np.floor(world.xu[:2] / 555.6) + 1
    assert without.counts.internal == n.prod()


def test_less_than_its_minimum_is_refused(world):
    with pytest.raises(InvalidInput, match="at least 11"):
        solve(world, "tercom", budget=10)


@pytest.mark.parametrize(
    "settings", [{"step_m": 100.0}, {"rotations": 5, "scales": 5}, {"step_m": 555.6, "rotations": 3}]
)
def test_a_search_too_expensive_for_the_budget_is_refused_with_its_price(world, settings):
    """Neither an empty result nor a message that only says "more"."""
    with pytest.raises(NavoptError, match="budget") as error:
        solve(world, Tercom(**settings), budget=150)
    prices = [int(number) for number in re.findall(r"\d+", str(error.value)) if int(number) > 150]
    assert prices, f"no price in: {error.value}"
    assert solve(world, Tercom(**settings), budget=max(prices)).counts.cost <= max(prices)


def test_the_whole_search_and_a_proposal_fit_or_it_is_refused(world):
    price = solve(world, Tercom(step_m=1500.0)).counts
    enough = solve(world, Tercom(step_m=1500.0), budget=price.cost)
    assert enough.counts == price
    one_less = solve(world, Tercom(step_m=1500.0), budget=price.cost - 1)
    assert (one_less.counts.internal, one_less.counts.loss) == (price.internal, 1)
    with pytest.raises(NavoptError, match=str(price.cost)):
        solve(world, Tercom(step_m=1500.0), budget=price.cost - 2)


def test_minimum_cost_includes_the_poses(world):
    answer = solve(world, Tercom(rotations=5, scales=3), budget=9 * 15 + 2)
    assert answer.counts.internal == 9 * 15
    assert answer.counts.loss == 2


def test_a_huge_step_still_compares_three_lines_per_axis_inside_the_box(world):
    answer = solve(world, Tercom(step_m=1e7, refine=False))
    assert answer.counts.internal == 9
    assert set(np.abs(answer.x[:2] / world.xu[:2]).round(12)) <= {0.0, 1.0}


def test_it_is_deterministic(world):
    a, b = solve(world, "tercom", seed=1), solve(world, "tercom", seed=2)
    np.testing.assert_array_equal(a.x, b.x)
    assert a.status == "converged"


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"criterion": "mse"}, UnknownName),
        ({"step_m": 0.0}, InvalidInput),
        ({"step_m": np.nan}, InvalidInput),
        ({"rotations": 2}, InvalidInput),
        ({"scales": 0}, InvalidInput),
        ({"step": 100.0}, UnknownName),
    ],
)
def test_unusable_settings_are_refused(settings, error):
    with pytest.raises(error, match=next(iter(settings))):
        Tercom(**settings)


def test_problems_without_a_track_are_refused():
    with pytest.raises(UnsuitableProblem, match="track"):
        solve(Sphere([1.0, 2.0, 3.0, 1.0]), "tercom")


def test_it_is_better_than_the_inertial_system_alone():
    """Twenty worlds at three hours: the fix lies nearer to the truth in most of them."""
    nearer = 0
    for seed in range(20):
        world = simulate("gravity-matching", seed, hours=3.0)
        error = {name: solve(world, name).scores["position_error_m"] for name in ("tercom", "nominal")}
        nearer += error["tercom"] < error["nominal"]
    assert nearer >= 17  # seventeen of twenty by chance: 0.13 %
