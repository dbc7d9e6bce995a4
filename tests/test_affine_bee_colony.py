"""Affine bee colony against the paper's explicit sequences of points (003, eqs. 27-50).

The algorithm keeps four numbers per source. Here whole sequences are built, and angles, lengths and centroids
are read back from them as the paper does.
"""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from navopt import simulate, solve
from navopt.algorithms.affine_bee_colony import AffineBeeColony
from navopt.errors import UnknownName, UnsuitableProblem
from navopt.problems.analytic import Sphere
from navopt.problems.gravity_matching import GravityMatching

LEVEL = 0.001 / 6  # six statistical checks in this file


@pytest.fixture(scope="module")
def problem():
    return simulate("gravity-matching", 0, hours=3.0, box="paper")


def points(q, x):
    """Sequences t + s R(β) q with R of eq. (31), by matrix products: (..., 4) -> (..., N, 2)."""
    x = np.asarray(x)
    R = np.stack(
        [
            np.stack([np.cos(x[..., 2]), -np.sin(x[..., 2])], -1),
            np.stack([np.sin(x[..., 2]), np.cos(x[..., 2])], -1),
        ],
        -2,
    )
    return x[..., None, :2] + x[..., 3, None, None] * np.einsum("...ab,kb->...ka", R, q)


def length(track):
    return np.sum(np.hypot(*np.diff(track, axis=-2).T), axis=0).T


def angle_between(a, b):
    """Rotation that lays sequence a on b: eq. (37) with the closed form tan τ = (Q12 - Q21)/(Q11 + Q22)."""
    Q = np.einsum("ka,kb->ab", a - a.mean(axis=0), b - b.mean(axis=0))
    return np.arctan2(Q[0, 1] - Q[1, 0], Q[0, 0] + Q[1, 1])


def draw_box(problem, rng, *shape):
    return rng.uniform(problem.xl, problem.xu, (*shape, 4))


def stack(blocks):
    return {key: np.stack([block[key] for block in blocks]) for key in blocks[0]}


def prepared(problem, lead, *, seed=1, n=6, **options):
    """An algorithm, a stacked state of random sources inside the box, and stacked draws."""
    algorithm = AffineBeeColony(pop_size=n, **options)
    rng = np.random.default_rng(seed)
    X = draw_box(problem, rng, lead, n)
    state = algorithm.found(algorithm.constants(problem), X, rng.random((lead, n)))
    return algorithm, state, stack([algorithm.draw(rng, n, 4) for _ in range(lead)])


def partners(draws):
    """The partner of each employed bee, from the first column of its draws, uniform over the others."""
    n = draws.shape[-2]
    k = (draws[..., 0] * (n - 1)).astype(int)
    return k + (k >= np.arange(n))


# -- similarity transforms of one sequence compose -------------------------------------------------------


def test_four_numbers_say_what_the_paper_reads_from_whole_sequences(problem):
    rng = np.random.default_rng(1)
    q = problem.sequence
    np.testing.assert_allclose(q.mean(axis=0), 0.0, atol=1e-9)
    for _ in range(200):
        i, j = draw_box(problem, rng, 2)
        a, b = points(q, i), points(q, j)
        assert angle_between(a, b) == pytest.approx(j[2] - i[2], abs=1e-12)
        assert length(b) / length(a) == pytest.approx(j[3] / i[3], rel=1e-12)
        np.testing.assert_allclose(b.mean(axis=0) - a.mean(axis=0), j[:2] - i[:2], atol=1e-7)
        # and from X_i back to the inertial sequence, eta of eq. (41), it is -β_i
        assert angle_between(a, q) == pytest.approx(-i[2], abs=1e-12)


def test_the_closed_form_angle_agrees_with_scipy(problem):
    rng = np.random.default_rng(2)
    for _ in range(50):
        i, j = draw_box(problem, rng, 2)
        a, b = points(problem.sequence, i), points(problem.sequence, j)
        flat = np.zeros((len(a), 1))
        rotation, _ = Rotation.align_vectors(
            np.hstack([b - b.mean(axis=0), flat]) * 1e-4, np.hstack([a - a.mean(axis=0), flat]) * 1e-4
        )
        vector = rotation.as_rotvec()
        assert vector[2] == pytest.approx(j[2] - i[2], abs=1e-6)


def test_the_printed_formula_has_the_wrong_sign(problem):
    """Eq. (39) gives tan(τ/2) with the opposite sign: why the closed form is used."""
    i, j = np.array([0.0, 0.0, 0.02, 1.0]), np.array([0.0, 0.0, 0.17, 1.0])
    a, b = points(problem.sequence, i), points(problem.sequence, j)
    Q = a.T @ b
    largest = np.hypot(Q[0, 0] + Q[1, 1], Q[1, 0] - Q[0, 1])
    printed = 2 * np.arctan((Q[0, 0] + Q[1, 1] - largest) / (Q[0, 1] - Q[1, 0]))
    assert printed == pytest.approx(-0.15, abs=1e-9)


# -- a trial ---------------------------------------------------------------------------------------------


def ends(algorithm, state, draws, column):
    """Candidates with the random number of one column at both ends of [0, 1)."""
    result = []
    for value in (0.0, np.nextafter(1.0, 0.0)):
        block = draws["employed"].copy()
        block[..., column] = value
        result.append(algorithm.move(state, {**draws, "employed": block}, "employed")[0])
    return result


@pytest.mark.parametrize("constrained", [True, False])
def test_rotations_come_from_interval_42(problem, constrained):
    algorithm, state, draws = prepared(
        problem, 60, box_rule=False, constrain_rotation=constrained, constrain_scale=constrained
    )
    low, high = ends(algorithm, state, draws, 2)
    k = partners(draws["employed"])
    reached = 0
    for r, i in np.ndindex(state["X"].shape[:2]):
        a, b = points(problem.sequence, state["X"][r, i]), points(problem.sequence, state["X"][r, k[r, i]])
        tau, eta = abs(angle_between(a, b)), angle_between(a, problem.sequence)
        limits = np.array([-tau, tau])
        if constrained:
            limits = np.array([max(-tau, problem.xl[2] + eta), min(tau, problem.xu[2] + eta)])
            assert limits[0] <= 0 <= limits[1]
            reached += np.any(np.abs(limits) < tau - 1e-12)
        got = np.array([low[r, i, 2], high[r, i, 2]])
        np.testing.assert_allclose(
            got, np.clip(state["X"][r, i, 2] + limits, problem.xl[2], problem.xu[2]), atol=1e-11
        )
    assert reached > 20 or not constrained


@pytest.mark.parametrize("constrained", [True, False])
def test_scales_come_from_interval_46_47(problem, constrained):
    algorithm, state, draws = prepared(problem, 60, box_rule=False, constrain_scale=constrained)
    low, high = ends(algorithm, state, draws, 3)
    k = partners(draws["employed"])
    q = problem.sequence
    reached = 0
    for r, i in np.ndindex(state["X"].shape[:2]):
        own, other = length(points(q, state["X"][r, i])), length(points(q, state["X"][r, k[r, i]]))
        limits = np.array([min(other / own, own / other), max(other / own, own / other)])
        if constrained:
            wide = limits
            limits = np.array(
                [
                    max(limits[0], problem.xl[3] * length(q) / own),
                    min(limits[1], problem.xu[3] * length(q) / own),
                ]
            )
            assert limits[0] <= 1 <= limits[1]
            reached += np.any(np.abs(limits - wide) > 1e-12)
        got = np.array([low[r, i, 3], high[r, i, 3]])
        np.testing.assert_allclose(
            got, np.clip(state["X"][r, i, 3] * limits, problem.xl[3], problem.xu[3]), rtol=1e-11
        )
    assert reached > 20 or not constrained


def test_within_their_intervals_the_three_parts_are_uniform(problem):
    algorithm, state, draws = prepared(problem, 400, box_rule=False, n=4)
    k = partners(draws["employed"])
    X = state["X"]
    partner = np.take_along_axis(X, k[..., None], axis=1)
    candidates = algorithm.move(state, draws, "employed")[0]
    for column in (2, 3):
        low, high = ends(algorithm, state, draws, column)
        fraction = (candidates[..., column] - low[..., column]) / (high[..., column] - low[..., column])
        assert stats.kstest(fraction.ravel(), stats.uniform.cdf).pvalue > LEVEL
    inside = ((candidates[..., :2] > problem.xl[:2]) & (candidates[..., :2] < problem.xu[:2])).all(axis=-1)
    factor = ((candidates - X) / (partner - X))[..., :2]
    # (49): one factor for both axes, uniform in (-1, 1); half of them move away from the partner
    np.testing.assert_allclose(factor[inside][:, 0], factor[inside][:, 1], atol=1e-9)
    centre = (np.abs(partner[..., :2] - X[..., :2]) < np.minimum(problem.xu - np.abs(X), 1e9)[..., :2]).all(
        axis=-1
    )
    free = factor[centre][:, 0]
    assert len(free) > 200
    assert stats.kstest(free, stats.uniform(-1, 2).cdf).pvalue > LEVEL


def test_per_axis_factors_differ(problem):
    algorithm, state, draws = prepared(problem, 20, box_rule=False, translation_factor="per_axis")
    X = state["X"]
    partner = np.take_along_axis(X, partners(draws["employed"])[..., None], axis=1)
    candidates = algorithm.move(state, draws, "employed")[0]
    factor = ((candidates - X) / (partner - X))[..., :2]
    assert np.abs(factor[..., 0] - factor[..., 1]).min() > 0
    one = prepared(problem, 20, box_rule=False)[0].move(state, draws, "employed")[0]
    np.testing.assert_array_equal(one[..., 2:], candidates[..., 2:])
    np.testing.assert_array_equal(
        one[..., 0], candidates[..., 0]
    )  # the scalar is the factor of the first axis


def test_a_trial_is_the_transformed_sequence_of_48_to_50(problem):
    """Rotate and scale the sequence about its centroid, shift it, and compare point by point."""
    algorithm, state, draws = prepared(problem, 30, box_rule=False)
    q = problem.sequence
    X = state["X"]
    candidates = algorithm.move(state, draws, "employed")[0]
    k = partners(draws["employed"])
    checked = 0
    for r, i in np.ndindex(X.shape[:2]):
        a, b = points(q, X[r, i]), points(q, X[r, k[r, i]])
        tau, eta = abs(angle_between(a, b)), angle_between(a, q)
        lowest, highest = max(-tau, problem.xl[2] + eta), min(tau, problem.xu[2] + eta)
        u = draws["employed"][r, i]
        beta = lowest + u[2] * (highest - lowest)
        ratio = length(b) / length(a)
        bounds = problem.xl[3] * length(q) / length(a), problem.xu[3] * length(q) / length(a)
        smallest, largest = max(min(ratio, 1 / ratio), bounds[0]), min(max(ratio, 1 / ratio), bounds[1])
        scale = smallest + u[3] * (largest - smallest)
        R = np.array([[np.cos(beta), -np.sin(beta)], [np.sin(beta), np.cos(beta)]])
        turned = a.mean(axis=0) + scale * (a - a.mean(axis=0)) @ R.T
        moved = turned + (b.mean(axis=0) - turned.mean(axis=0)) * (2 * u[4] - 1)
        centroid = moved.mean(axis=0)
        if ((centroid > problem.xl[:2]) & (centroid < problem.xu[:2])).all():
            np.testing.assert_allclose(points(q, candidates[r, i]), moved, atol=1e-6)
            checked += 1
    assert checked > 100


@pytest.mark.parametrize(("switch", "columns"), [("translate", [0, 1]), ("rotate", [2]), ("scale", [3])])
def test_each_operator_can_be_switched_off_alone(problem, switch, columns):
    full, state, draws = prepared(problem, 20, box_rule=False)
    reduced = prepared(problem, 20, box_rule=False, **{switch: False})[0]
    for phase in ("employed", "onlooker"):
        whole, _ = full.move(state, draws, phase)
        part, _ = reduced.move(state, draws, phase)
        others = [k for k in range(4) if k not in columns]
        np.testing.assert_array_equal(part[..., others], whole[..., others])
        assert (part[..., columns] != whole[..., columns]).mean() > 0.9
        if phase == "employed":
            np.testing.assert_array_equal(part[..., columns], state["X"][..., columns])


@pytest.mark.parametrize(
    "settings",
    [{"rotate": False}, {"scale": False}, {"constrain_rotation": False}, {"constrain_scale": False}],
)
def test_switches_of_the_shape_do_not_touch_the_shift(problem, settings):
    _, state, draws = prepared(problem, 20)
    whole = AffineBeeColony(pop_size=6, box_rule=False).move(state, draws, "employed")[0]
    part = AffineBeeColony(pop_size=6, box_rule=False, **settings).move(state, draws, "employed")[0]
    np.testing.assert_array_equal(part[..., :2], whole[..., :2])
    assert (part[..., 2:] != whole[..., 2:]).any()


# -- scope and initialisation ----------------------------------------------------------------------------


def scope(problem):
    """Extent of the inertial sequence, widened by the box of the translation: our reading of the scope."""
    q = problem.sequence
    return q.min(axis=0) + problem.xl[:2], q.max(axis=0) + problem.xu[:2]


def rule(track, low, high):
    """Eqs. (35)-(36), as printed, with maximum and minimum the right way round."""
    shift = np.zeros(2)
    for axis in range(2):
        least, most = track[:, axis].min(), track[:, axis].max()
        if least < low[axis]:
            shift[axis] = low[axis] - least
        elif most > high[axis]:
            shift[axis] = high[axis] - most
    return track + shift


def test_tracks_that_leave_the_scope_are_shifted_back(problem):
    algorithm, state, draws = prepared(problem, 200)
    with_rule = algorithm.move(state, draws, "employed")[0]
    # without rule and without clipping of the shift: a wider box for the same trial
    wide = {**state, "lower": state["lower"] - [1e6, 1e6, 0, 0], "upper": state["upper"] + [1e6, 1e6, 0, 0]}
    without = AffineBeeColony(pop_size=6, box_rule=False).move(wide, draws, "employed")[0]
    low, high = scope(problem)
    shifted = 0
    for place in np.ndindex(with_rule.shape[:2]):
        expected = rule(points(problem.sequence, without[place]), low, high).mean(axis=0)
        shifted += not np.allclose(expected, without[place][:2])
        np.testing.assert_allclose(
            with_rule[place][:2], np.clip(expected, problem.xl[:2], problem.xu[:2]), atol=1e-6
        )
        np.testing.assert_array_equal(with_rule[place][2:], without[place][2:])
    assert shifted > 50


def test_the_first_point_of_a_new_source_is_uniform_in_its_scope(problem):
    """Eqs. (27)-(34). Seen where the box does not bind, by making it wide for the shift."""
    algorithm = AffineBeeColony(pop_size=10, box_rule=False)
    constants = algorithm.constants(problem)
    rng = np.random.default_rng(5)
    position = rng.random((300, 10, 4))
    # ranges of the first point and of the shift are the same array: choose draws whose shift stays inside
    sources = algorithm.initialize(constants, {"position": position})
    first = points(problem.sequence, sources)[..., 0, :]
    low = problem.sequence[0] + problem.xl[:2]
    expected = low + position[..., :2] * (problem.xu - problem.xl)[:2]
    free = ((sources[..., :2] > problem.xl[:2]) & (sources[..., :2] < problem.xu[:2])).all(axis=-1)
    assert free.mean() > 0.6
    np.testing.assert_allclose(first[free], expected[free], atol=1e-6)
    np.testing.assert_allclose(
        sources[..., 2:], problem.xl[2:] + position[..., 2:] * (problem.xu - problem.xl)[2:]
    )
    # angle and scale are uniform in (29) and (30)
    for column in (2, 3):
        unit = (sources[..., column] - problem.xl[column]) / (problem.xu - problem.xl)[column]
        assert stats.kstest(unit.ravel(), stats.uniform.cdf).pvalue > LEVEL


def test_without_it_a_new_source_is_uniform_in_the_box(problem):
    algorithm = AffineBeeColony(pop_size=10, box_rule=False, affine_initialization=False)
    position = np.random.default_rng(5).random((10, 4))
    sources = algorithm.initialize(algorithm.constants(problem), {"position": position})
    np.testing.assert_allclose(sources, problem.xl + position * (problem.xu - problem.xl), rtol=1e-15)


def test_scouts_are_new_sources_of_the_same_kind(problem):
    for affine in (True, False):
        algorithm = AffineBeeColony(pop_size=6, affine_initialization=affine, limit=3)
        _, state, draws = prepared(problem, 4)
        state = {**state, "trials": np.full((4, 6), 4)}
        candidates, mask = algorithm.move(state, draws, "scout")
        expected = algorithm.initialize(algorithm.constants(problem), {"position": draws["scout"]})
        np.testing.assert_array_equal(candidates, expected)
        # all but the best of each colony
        np.testing.assert_array_equal(mask, np.arange(6) != state["F"].argmin(axis=-1)[:, None])


@pytest.mark.parametrize("box", ["covariance", "paper"])
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"box_rule": False},
        {"constrain_rotation": False, "constrain_scale": False},
        {"affine_initialization": False, "translation_factor": "per_axis"},
        {"update": "sequential"},
    ],
)
def test_every_candidate_is_inside_the_box(box, settings):
    world = simulate("gravity-matching", 3, hours=2.0, box=box)
    algorithm = AffineBeeColony(limit=3, **settings)
    algorithm.setup(world, seed=1)
    while algorithm.evaluator.n_eval < 600:
        pop = algorithm.ask()
        X = pop.get("X")
        np.testing.assert_array_equal(X, np.clip(X, world.xl, world.xu))
        algorithm.evaluator.eval(world, pop)
        algorithm.tell(infills=pop)


# -- whole runs ------------------------------------------------------------------------------------------


def test_many_runs_in_lockstep_equal_single_runs_bit_for_bit(problem):
    settings = {"pop_size": 6, "limit": 2}
    seeds, cycles, n = range(50), 8, 6
    singles = []
    for seed in seeds:
        single = AffineBeeColony(**settings)
        single.setup(problem, seed=seed)
        while True:
            pop = single.ask()
            if single.cycle == cycles:
                break
            single.evaluator.eval(problem, pop)
            single.tell(infills=pop)
        singles.append(single)
    together = AffineBeeColony(**settings)
    generators = [np.random.default_rng(seed) for seed in seeds]
    constants = together.constants(problem)
    X = together.initialize(constants, stack([together.draw_initial(g, n, 4) for g in generators]))
    state = together.found(constants, X, problem.loss(X))
    scouted = 0
    for _ in range(cycles):
        draws = stack([together.draw(g, n, 4) for g in generators])
        for phase in together.phases:
            candidates, mask = together.move(state, draws, phase)
            losses = np.where(mask, problem.loss(candidates), np.inf)
            state = together.select(state, draws, phase, candidates, losses, mask)
            scouted += mask.sum() if phase == "scout" else 0
    assert scouted > 50
    for k, single in enumerate(singles):
        for key in ("X", "F", "trials"):
            np.testing.assert_array_equal(state[key][k], single.state[key])


def test_published_settings_and_budget():
    algorithm = AffineBeeColony.published()
    settings = algorithm.settings
    assert (settings["pop_size"], settings["limit"], settings["scouts"]) == (10, 20, "all")
    assert settings["selection"] == "roulette"
    assert settings["update"] == "sequential"
    assert all(
        settings[name]
        for name in ("affine_initialization", "rotate", "scale", "translate", "constrain_rotation")
    )
    assert AffineBeeColony.published(limit=7).limit == 7


def test_it_finds_a_track_that_is_a_similarity_of_the_inertial_one(problem):
    """Noise-free, planted inside the paper's box: the loss goes to zero only at the planted transform."""
    planted = np.array([4000.0, -6000.0, np.radians(6.0), 0.5 * (problem.xl[3] + problem.xu[3])])
    answer = problem.estimate(planted)
    track = problem.track
    measured = track.measured.copy()
    measured[-problem.window :] = problem.field_map.value(answer.latitude, answer.longitude)
    clean = GravityMatching(
        problem.field_map,
        type(track)(time=track.time, latitude=track.latitude, longitude=track.longitude, measured=measured),
        prior_covariance=problem.prior()[1],
        box=np.stack([problem.xl, problem.xu], axis=1),
    )
    found = solve(clean, "affine-abc", budget=20000, seed=2)
    assert found.loss < 0.1
    assert np.hypot(*(found.x - planted)[:2]) < 200.0
    assert abs(found.x[2] - planted[2]) < np.radians(1.0)
    assert abs(found.x[3] - planted[3]) < 0.02


def test_problems_without_a_track_are_refused():
    with pytest.raises(UnsuitableProblem, match="translation, rotation and scale"):
        solve(Sphere([1.0, 2.0, 3.0, 0.5]), "affine-abc", budget=100)


def test_unknown_options_are_refused():
    with pytest.raises(UnknownName, match="translation_factor"):
        AffineBeeColony(translation_factor="both")
    with pytest.raises(UnknownName, match="rotates"):
        AffineBeeColony(rotates=False)
