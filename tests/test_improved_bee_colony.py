"""Point-matching colonies against brute force, plain loops, an independent interpolator and the truth."""

import itertools
import math
import pickle
from functools import cache

import numpy as np
import pytest
from arena import Altered
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.distance import cdist, directed_hausdorff

from navopt import EstimationProblem, Parameter, make_solver, simulate, solve
from navopt.algorithms.bee_colony import BeeColony
from navopt.algorithms.guided_bee_colony import GuidedBeeColony
from navopt.algorithms.improved_bee_colony import ImprovedBeeColony, SinglePointBeeColony
from navopt.algorithms.point_chains import cheapest_chains, distinct_candidates, modified_hausdorff_distance
from navopt.errors import InvalidInput, UnknownName, UnsuitableProblem
from navopt.models.earth import distance, local_tangent_plane
from navopt.problems.analytic_base import Point
from navopt.problems.gravity_matching import GravityMatching

WORLDS = 20


@cache
def world(seed):
    return simulate("gravity-matching", seed, hours=3.0)


def run(problem, algorithm, *, budget=None, seed=1):
    """Solution and the algorithm as it was at the end."""
    last = []
    solution = solve(
        problem, algorithm, budget=budget, seed=seed, callback=lambda p: last.append(p.algorithm) and False
    )
    return solution, last[-1]


# -- modified Hausdorff distance -------------------------------------------------------------------------


def test_modified_hausdorff_distance_against_all_pairs():
    rng = np.random.default_rng(1)
    for n, m in ((1, 1), (1, 5), (7, 4), (12, 12)):
        a, b = rng.normal(size=(n, 2)), rng.normal(size=(m, 2)) + 0.5
        pairs = cdist(a, b)
        expected = max(np.mean([min(row) for row in pairs]), np.mean([min(column) for column in pairs.T]))
        assert modified_hausdorff_distance(a, b) == pytest.approx(expected, rel=1e-14)
        assert modified_hausdorff_distance(b, a) == modified_hausdorff_distance(a, b)
        # means are not larger than maxima
        farthest = max(directed_hausdorff(a, b)[0], directed_hausdorff(b, a)[0])
        assert modified_hausdorff_distance(a, b) <= farthest * (1 + 1e-14)
        assert modified_hausdorff_distance(a, a[::-1]) == 0.0


def test_modified_hausdorff_distance_at_a_worked_point():
    # each point of the first set is 1 from the second; one point of the second is 2 from the first
    a = np.array([[0.0, 0.0], [2.0, 0.0]])
    b = np.array([[0.0, 1.0], [2.0, 1.0], [2.0, -2.0]])
    assert modified_hausdorff_distance(a, b) == pytest.approx(4.0 / 3.0)


def test_modified_hausdorff_distance_of_many_pairs_at_once():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(3, 4, 6, 2)), rng.normal(size=(4, 5, 2))
    whole = modified_hausdorff_distance(a, b)
    assert whole.shape == (3, 4)
    for i, j in np.ndindex(3, 4):
        assert whole[i, j] == modified_hausdorff_distance(a[i, j], b[j])


# -- candidates ------------------------------------------------------------------------------------------


def greedy(points, losses, count, separation):
    kept = []
    for k in sorted(range(len(losses)), key=lambda k: (losses[k], k)):
        far = all(math.dist(points[k], points[j]) >= separation for j in kept)
        if math.isfinite(losses[k]) and far and len(kept) < count:
            kept.append(k)
    return kept


@pytest.mark.parametrize("separation", [0.0, 0.15, 0.6])
def test_distinct_candidates_are_the_greedy_choice(separation):
    rng = np.random.default_rng(3)
    points, losses = rng.random((40, 9, 2)), rng.integers(0, 5, (40, 9)).astype(float)
    losses[rng.random(losses.shape) < 0.2] = np.inf
    losses[7] = np.inf
    chosen, valid = distinct_candidates(points, losses, 5, separation)
    for r in range(40):
        assert chosen[r][valid[r]].tolist() == greedy(points[r], losses[r], 5, separation)
        alone = distinct_candidates(points[r], losses[r], 5, separation)
        assert (alone[0] == chosen[r]).all()
        assert (alone[1] == valid[r]).all()
    assert not valid[7].any()


# -- chains ----------------------------------------------------------------------------------------------


def chain_cost(points, costs, steps, chain, mu, heading_weight):
    total = sum(costs[j][c] for j, c in enumerate(chain))
    for j in range(1, len(chain)):
        (n0, e0), (n1, e1) = points[j - 1][chain[j - 1]], points[j][chain[j]]
        run_length = math.hypot(*steps[j - 1])
        turn = math.atan2(e1 - e0, n1 - n0) - math.atan2(steps[j - 1][1], steps[j - 1][0])
        turn = abs((turn + math.pi) % (2 * math.pi) - math.pi)
        speed = abs(math.hypot(n1 - n0, e1 - e0) - run_length)
        total += mu * (speed + heading_weight * run_length * turn)
    return total


@pytest.mark.parametrize(("mu", "heading_weight"), [(0.02, 1.0), (0.3, 0.0), (0.0, 1.0), (1e-4, 3.0)])
@pytest.mark.parametrize(("n", "k"), [(2, 4), (5, 3), (3, 1), (4, 5)])
def test_cheapest_chains_against_every_chain(n, k, mu, heading_weight):
    rng = np.random.default_rng(4)
    for trial in range(6):
        points = 1000.0 * rng.normal(size=(n, k, 2))
        costs = rng.random((n, k))
        if trial % 2 and k > 1:
            costs[rng.integers(n), rng.integers(k)] = np.inf
        steps = 900.0 * rng.normal(size=(n - 1, 2))
        chains, totals = cheapest_chains(points, costs, steps, mu=mu, heading_weight=heading_weight)
        best = {}
        for chain in itertools.product(range(k), repeat=n):
            cost = chain_cost(points, costs, steps, chain, mu, heading_weight)
            if cost < best.get(chain[-1], (math.inf, None))[0]:
                best[chain[-1]] = (cost, chain)
        ranked = sorted(best.values())
        assert np.isfinite(totals).sum() == len(ranked)
        np.testing.assert_allclose(totals[: len(ranked)], [cost for cost, _ in ranked], rtol=1e-12)
        for row, total in zip(chains[: len(ranked)], totals, strict=False):
            again = chain_cost(points, costs, steps, row, mu, heading_weight)
            assert again == pytest.approx(total, rel=1e-12)
        if mu > 0:
            assert tuple(chains[0]) == ranked[0][1]


def test_chains_of_many_runs_are_those_of_each():
    rng = np.random.default_rng(5)
    points, costs = rng.normal(size=(20, 6, 4, 2)), rng.random((20, 6, 4))
    steps = rng.normal(size=(20, 5, 2))
    chains, totals = cheapest_chains(points, costs, steps, mu=0.7)
    for r in range(20):
        alone = cheapest_chains(points[r], costs[r], steps[r], mu=0.7)
        assert (alone[0] == chains[r]).all()
        assert (alone[1] == totals[r]).all()


# -- the guided colony -----------------------------------------------------------------------------------


class Bowl(EstimationProblem):
    """A tilted bowl with ripples in a box without symmetry."""

    def __init__(self):
        limits = [(-2.0, 3.0), (-1.0, 1.5), (0.0, 4.0)]
        super().__init__([Parameter(f"x{k}", "1", a, b, a) for k, (a, b) in enumerate(limits)])

    def _loss(self, X):
        return np.sum((X - 0.7) ** 2 + 0.3 * np.sin(9 * X), axis=1) + 1.0

    def estimate(self, x):
        return Point(np.array(x))


def stack(blocks):
    return {key: np.stack([block[key] for block in blocks]) for key in blocks[0]}


def guided_loop(problem, n, limit, cycles, seed, guidance):
    """Guided colony in plain loops, one bee after another; returns the final sources and losses."""
    rng, d = np.random.default_rng(seed), problem.n_var
    lower, upper = problem.xl, problem.xu
    X = list(lower + rng.random((n, d)) * (upper - lower))
    F = [float(problem.loss(x)) for x in X]
    trials = [0] * n

    def attempt(i, u):
        k = int(u[0] * (n - 1))
        k += k >= i
        j = int(u[1] * d)
        best = X[int(np.argmin(F))]
        v = X[i].copy()
        v[j] += (2 * u[2 + j] - 1) * (X[i][j] - X[k][j]) + guidance * u[2 + d + j] * (best[j] - X[i][j])
        v = np.clip(v, lower, upper)
        f = float(problem.loss(v))
        if f < F[i]:
            X[i], F[i], trials[i] = v, f, 0
        else:
            trials[i] += 1

    for _ in range(cycles):
        employed, onlooker = rng.random((n, 2 * d + 2)), rng.random((n, 2 * d + 2))
        spin, scout = rng.random(n), rng.random((n, d))
        for i in range(n):
            attempt(i, employed[i])
        wheel = np.cumsum([1 / (1 + f) if f >= 0 else 1 + abs(f) for f in F])
        for t in range(n):
            attempt(int(np.sum(wheel <= spin[t] * wheel[-1])), onlooker[t])
        best = int(np.argmin(F))
        for i in range(n):
            if trials[i] > limit and i != best:
                X[i], trials[i] = lower + scout[i] * (upper - lower), 0
                F[i] = float(problem.loss(X[i]))
    return np.array(X), np.array(F)


@pytest.mark.parametrize("guidance", [0.0, 1.5])
def test_the_guided_colony_is_the_plain_loop(guidance):
    problem = Bowl()
    algorithm = GuidedBeeColony(
        guidance=guidance, pop_size=6, limit=4, scouts="all", update="sequential", seed=9
    )
    algorithm.setup(problem, seed=9)
    while algorithm.cycle < 25:
        algorithm.next()
    X, F = guided_loop(problem, 6, 4, 25, 9, guidance)
    np.testing.assert_array_equal(algorithm.state["X"], X)
    np.testing.assert_array_equal(algorithm.state["F"], F)


def test_without_guidance_a_trial_is_the_plain_colonys():
    problem, n, d = Bowl(), 7, 3
    rng = np.random.default_rng(11)
    plain, guided = BeeColony(pop_size=n), GuidedBeeColony(pop_size=n, guidance=0.0)
    X = plain.initialize(plain.constants(problem), {"position": rng.random((n, d))})
    state = plain.found(plain.constants(problem), X, problem.loss(X))
    draws = guided.draw(rng, n, d)
    short = {**draws, "employed": draws["employed"][:, : d + 2], "onlooker": draws["onlooker"][:, : d + 2]}
    for phase in ("employed", "onlooker"):
        np.testing.assert_array_equal(guided.move(state, draws, phase)[0], plain.move(state, short, phase)[0])


@pytest.mark.parametrize("scouts", ["one", "all"])
def test_guided_colonies_in_lockstep_equal_single_runs_bit_for_bit(scouts):
    problem, n, d, cycles = Bowl(), 5, 3, 8
    settings = {"pop_size": n, "limit": 2, "scouts": scouts}
    together = GuidedBeeColony(**settings)
    generators = [np.random.default_rng(seed) for seed in range(50)]
    constants = together.constants(problem)
    X = together.initialize(constants, stack([together.draw_initial(g, n, d) for g in generators]))
    state = together.found(constants, X, problem.loss(X))
    scouted, best = 0, state["F"].min(axis=-1)
    for _ in range(cycles):
        draws = stack([together.draw(g, n, d) for g in generators])
        for phase in together.phases:
            candidates, mask = together.move(state, draws, phase)
            losses = np.where(mask, problem.loss(candidates), np.inf)
            state = together.select(state, draws, phase, candidates, losses, mask)
            scouted += mask.sum() if phase == "scout" else 0
            best = np.minimum(best, losses.min(axis=-1))
    assert scouted > 50
    # the best source is protected with either rule, so it is the best ever seen
    np.testing.assert_array_equal(state["F"].min(axis=-1), best)
    for seed in range(50):
        single = GuidedBeeColony(**settings)
        single.setup(problem, seed=seed)
        while single.cycle < cycles:
            single.next()
        for key in ("X", "F", "trials"):
            np.testing.assert_array_equal(state[key][seed], single.state[key])


# -- a single point --------------------------------------------------------------------------------------


def interpolated(problem, estimate):
    """Bilinear look-up by another library, mGal."""
    field = problem.field_map
    look = RegularGridInterpolator((field.latitude, field.longitude), field.values)
    return look(np.stack([estimate.latitude, estimate.longitude], axis=1))


def test_a_single_point_finds_the_iso_anomaly_curve_and_not_the_position():
    """Paper 003, Table 4, "basic ABC": the residual says nothing about the position."""
    residuals, errors, inertial = [], [], []
    for seed in range(WORLDS):
        problem = world(seed)
        solution = solve(problem, SinglePointBeeColony(), budget=400, seed=seed)
        found = interpolated(problem, solution.estimate)[-1]
        residuals.append(abs(found - problem.measured[-1]))
        errors.append(solution.scores["position_error_m"])
        inertial.append(problem.score(problem.estimate(problem.nominal))["position_error_m"])
    # a thousandth of the noise on the measurement, in the median
    assert np.median(residuals) < 1e-3
    assert max(residuals) < 0.05
    # uniform along a curve through a box of three sigmas: no better than doing nothing
    assert np.mean(errors) > 0.9 * np.mean(inertial)
    assert np.mean(np.less(errors, 1852.0)) < 0.35


def test_within_one_sigma_the_error_stays_near_the_priors():
    errors, inertial = [], []
    for seed in range(WORLDS):
        problem = world(seed)
        radius = float(np.sqrt(np.trace(problem.prior()[1][:2, :2]) / 2))
        solution = solve(problem, SinglePointBeeColony(radius_m=radius), seed=seed)
        assert (np.abs(solution.x[:2]) <= radius).all()
        errors.append(solution.scores["position_error_m"])
        inertial.append(problem.score(problem.estimate(problem.nominal))["position_error_m"])
    assert 0.6 < np.mean(errors) / np.mean(inertial) < 1.5


def test_the_rest_of_the_track_is_shifted_along():
    problem = world(0)
    solution, algorithm = run(problem, SinglePointBeeColony(), budget=300)
    np.testing.assert_array_equal(solution.x[2:], [0.0, 1.0])
    best = np.argmin(algorithm.state["F"][0])
    np.testing.assert_array_equal(solution.x[:2], algorithm.state["X"][0, best])
    assert algorithm.state["X"].shape == (1, 20, 2)


# -- what a look-up costs --------------------------------------------------------------------------------


class CountedMap:
    """A field map that remembers where it was looked up."""

    def __init__(self, field):
        self.field, self.points = field, []

    def __getattr__(self, name):
        return getattr(self.field, name)

    def value(self, latitude, longitude, method=None):
        self.points.append(np.stack([latitude, longitude], axis=-1))
        return self.field.value(latitude, longitude, method)


class Counted(Altered):
    """A world whose map counts the look-ups of solvers; its own losses do not pass through it."""

    def __init__(self, inner):
        self.field_map = CountedMap(inner.field_map)
        super().__init__(inner, lambda losses, X: losses)


@pytest.mark.parametrize("budget", [1, 2, 3, 13, 47, 200, 333])
@pytest.mark.parametrize("make", [ImprovedBeeColony, lambda: SinglePointBeeColony(cycles=None)])
@pytest.mark.parametrize("window", [12, 5])
def test_every_look_up_is_paid_for_and_the_budget_used_exactly(make, budget, window):
    problem = Counted(simulate("gravity-matching", 3, hours=2.0, window=window))
    solution, algorithm = run(problem, make(), budget=budget)
    looked = sum(len(points) for points in problem.field_map.points)
    assert looked == algorithm.looked_up == (budget - 1) * window
    assert solution.counts.internal == math.ceil(looked / window) == budget - 1
    assert solution.counts.loss == 1
    assert solution.counts.cost == budget
    assert solution.status == "budget"


def test_a_cut_phase_serves_all_samples_alike():
    budget, window = 48, 12
    problem = Counted(simulate("gravity-matching", 3, hours=2.0))
    run(problem, ImprovedBeeColony(pop_size=30), budget=budget)
    q, origin = problem.sequence, problem.origin
    points = np.concatenate(problem.field_map.points)
    plane = np.stack(local_tangent_plane(points[:, 0], points[:, 1], *origin), axis=1)
    # 30 first sources per sample, then 17 of 30 trials: all samples have the same number
    first, rest = plane[: 30 * window], plane[30 * window :]
    low, high = problem.xl[:2] - 1e-6, problem.xu[:2] + 1e-6
    assert ((first - np.repeat(q, 30, axis=0) >= low) & (first - np.repeat(q, 30, axis=0) <= high)).all()
    assert len(rest) == 17 * window
    assert ((rest - np.repeat(q, 17, axis=0) >= low) & (rest - np.repeat(q, 17, axis=0) <= high)).all()


def test_cycles_end_a_run_early():
    problem = world(0)
    solution, algorithm = run(problem, ImprovedBeeColony(cycles=3, limit=10**6), budget=10_000)
    # the first sources and three cycles of two phases; no scout can fly
    assert algorithm.looked_up == 12 * 40 * (1 + 3 * 2)
    assert solution.counts.internal == 280
    assert solution.status == "converged"
    # without a budget a number of cycles of its own
    assert solve(problem, ImprovedBeeColony(limit=10**6)).counts.internal == 40 * (1 + 30 * 2)


# -- the chain -------------------------------------------------------------------------------------------


@cache
def errors_of(budget=1500, **settings):
    """Position errors (m) of the answer and of the chain, and whether it was accepted, over the worlds."""
    rows = []
    for seed in range(WORLDS):
        problem = world(seed)
        solution, algorithm = run(problem, ImprovedBeeColony(**settings), budget=budget, seed=seed)
        chain = problem.score(algorithm.chain)["position_error_m"]
        rows.append((solution.scores["position_error_m"], chain, algorithm.accepted))
    return np.array(rows, dtype=float).T


def test_linked_points_beat_the_ins_and_single_points():
    answer, chain, accepted = errors_of()
    inertial = np.array(
        [world(s).score(world(s).estimate(world(s).nominal))["position_error_m"] for s in range(WORLDS)]
    )
    assert accepted.mean() > 0.8
    assert answer.mean() < 0.55 * inertial.mean()
    assert chain.mean() < 0.55 * inertial.mean()
    # sign test: 18 of 20 have a probability of 0.0002 if both were as good
    assert np.sum(answer < inertial) >= 18


def test_the_heading_is_what_links_the_points():
    """The distance between points alone leaves a chain free to turn: that costs accuracy and shape."""
    _, with_heading, accepted = errors_of()
    _, speed_only, accepted_by_speed = errors_of(heading_weight=0.0)
    assert speed_only.mean() > 1.5 * with_heading.mean()
    assert accepted_by_speed.mean() < accepted.mean()


def test_the_chain_is_made_of_points_on_the_curves():
    problem = world(1)
    solution, algorithm = run(problem, ImprovedBeeColony(answer="chain"), budget=5000)
    # a scout's new source may be a candidate before it has been improved
    assert np.median(np.abs(interpolated(problem, algorithm.chain) - problem.measured)) < 0.05
    assert algorithm.accepted
    # attached as it is, while the decision vector is its projection
    assert solution.estimate is algorithm.chain
    np.testing.assert_array_equal(solution.x, problem.project(algorithm.chain))
    assert solution.loss == float(problem.loss(solution.x))
    gap = distance(
        algorithm.chain.latitude,
        algorithm.chain.longitude,
        problem.estimate(solution.x).latitude,
        problem.estimate(solution.x).longitude,
    )
    assert gap.max() > 10.0
    # the same run with the projection as answer differs in nothing but the estimate
    projected, _ = run(problem, ImprovedBeeColony(), budget=5000)
    np.testing.assert_array_equal(projected.x, solution.x)
    np.testing.assert_array_equal(projected.estimate.latitude, problem.estimate(solution.x).latitude)


def test_the_answer_is_the_cheapest_chain_that_passes_the_screening():
    problem = world(2)
    _, algorithm = run(problem, ImprovedBeeColony(pop_size=8), budget=800)
    shape = problem.sequence - problem.sequence.mean(axis=0)
    X, F = algorithm.state["X"], algorithm.state["F"]
    points = problem.sequence[:, None] + X
    kept = [greedy(points[k], F[k], 8, 200.0) for k in range(12)]
    ends = {}
    # dynamic programming written again, forwards over dictionaries of partial chains
    partial = {(c,): F[0][c] for c in kept[0]}
    for k in range(1, 12):
        step = problem.sequence[k] - problem.sequence[k - 1]
        grown = {}
        for c in kept[k]:
            options = []
            for chain, cost in partial.items():
                pair = [[points[k - 1][chain[-1]]], [points[k][c]]]
                link = chain_cost(pair, [[0.0], [0.0]], [step], (0, 0), 0.01, 1.0)
                options.append((cost + link + F[k][c], (*chain, c)))
            cost, chain = min(options)
            grown[chain] = cost
        partial = grown
    limit = 3 * np.sqrt(np.trace(problem.prior()[1][2:, 2:]))
    limit *= np.sqrt(np.mean(np.sum(problem.sequence**2, axis=1)))
    for chain, cost in sorted(partial.items(), key=lambda item: item[1]):
        track = np.array([points[k][c] for k, c in enumerate(chain)])
        pairs = cdist(track - track.mean(axis=0), shape)
        far = max(pairs.min(axis=0).mean(), pairs.min(axis=1).mean())
        ends[chain] = (cost, far, track)
    passing = [value for value in ends.values() if value[1] <= limit]
    assert algorithm.accepted == bool(passing)
    expected = passing[0] if passing else min(ends.values(), key=lambda value: value[1])
    assert algorithm.distance_m == pytest.approx(expected[1], rel=1e-9)
    found = np.stack(
        local_tangent_plane(algorithm.chain.latitude, algorithm.chain.longitude, *problem.origin), axis=1
    )
    np.testing.assert_allclose(found, expected[2], atol=1e-5)


def test_what_follows_a_rejection():
    problem = world(2)
    _, open_door = run(problem, ImprovedBeeColony(threshold_m=np.inf), budget=500)
    _, closed = run(problem, ImprovedBeeColony(threshold_m=0.0), budget=500)
    solution, inertial = run(problem, ImprovedBeeColony(threshold_m=0.0, rejected="inertial"), budget=500)
    assert open_door.accepted
    assert not closed.accepted
    assert not inertial.accepted
    assert 0.0 < closed.distance_m <= open_door.distance_m
    np.testing.assert_allclose(solution.x, [0.0, 0.0, 0.0, 1.0], atol=1e-6)


def test_points_off_the_map_are_no_candidates():
    """The search reaches beyond the map: sources there count as failures, the chain stays on the map."""
    base = world(0)
    field = base.field_map
    north = (field.latitude[-1] - base.origin[0]) * base.metres_per_radian[0]
    limits = np.array([[-1000.0, 3.0 * north], [-3e3, 3e3], [-0.2, 0.2], [0.8, 1.2]])
    problem = GravityMatching(field, base.track, prior_covariance=base.prior()[1], box=limits)
    _, algorithm = run(problem, ImprovedBeeColony(cycles=4))
    assert (~np.isfinite(algorithm.state["F"])).any()
    assert field.covers(algorithm.chain.latitude, algorithm.chain.longitude)
    # nothing at all can be looked up: the inertial track is what is left
    limits[0] = [2.0 * north, 3.0 * north]
    lost = GravityMatching(field, base.track, prior_covariance=base.prior()[1], box=limits)
    for make in (ImprovedBeeColony, SinglePointBeeColony):
        solution = solve(lost, make(cycles=2))
        assert solution.status == "invalid"
        np.testing.assert_allclose(solution.x, lost.nominal, atol=1e-6)


@pytest.mark.parametrize("make", [ImprovedBeeColony, SinglePointBeeColony])
def test_bees_one_after_another(make):
    problem = world(0)
    _, algorithm = run(problem, make(update="sequential", pop_size=6, cycles=4), budget=2000)
    assert algorithm.looked_up >= 6 * 9 * len(algorithm.state["X"])
    _, together = run(problem, make(pop_size=6, cycles=4), budget=2000)
    assert (algorithm.state["X"] != together.state["X"]).any()


def test_a_finished_run_survives_a_pickle_and_says_the_same():
    problem = world(0)
    algorithm = make_solver("improved-abc", answer="chain")
    algorithm.setup(problem, seed=4)
    algorithm.next()
    again = pickle.loads(pickle.dumps(algorithm))
    first, second = solve(problem, algorithm, seed=4), solve(problem, again, seed=4)
    np.testing.assert_array_equal(first.x, second.x)
    np.testing.assert_array_equal(first.estimate.latitude, second.estimate.latitude)
    # asked again, it has nothing new to say
    again.next()
    assert not again.has_next()
    np.testing.assert_array_equal(again.opt[0].X, first.x)


def test_the_nominal_shape_of_a_box_without_no_change():
    """Rotation and scale that the box imposes apply to the track whose points are matched."""
    base = world(0)
    limits = np.array([[-2e4, 2e4], [-2e4, 2e4], [0.3, 0.4], [1.1, 1.2]])
    problem = GravityMatching(base.field_map, base.track, prior_covariance=base.prior()[1], box=limits)
    solution = solve(problem, SinglePointBeeColony(cycles=60))
    np.testing.assert_array_equal(solution.x[2:], [0.3, 1.1])
    residual = interpolated(problem, problem.estimate(solution.x))[-1] - problem.measured[-1]
    assert abs(residual) < 0.01


# -- settings --------------------------------------------------------------------------------------------


def test_published_settings():
    single, improved = SinglePointBeeColony.published(), ImprovedBeeColony.published()
    for algorithm in (single, improved):
        assert (algorithm.pop_size, algorithm.limit, algorithm.cycles) == (10, 20, 500)
        assert algorithm.scouts == "all"
    assert single.guidance == 0.0
    assert (improved.guidance, improved.candidates, improved.answer) == (1.5, 5, "chain")
    assert ImprovedBeeColony.published(candidates=7).candidates == 7


@pytest.mark.parametrize(
    ("make", "settings"),
    [
        (SinglePointBeeColony, {"pop_size": 1}),
        (SinglePointBeeColony, {"radius_m": 0.0}),
        (SinglePointBeeColony, {"radius_m": np.inf}),
        (SinglePointBeeColony, {"cycles": 0}),
        (SinglePointBeeColony, {"guidance": -0.1}),
        (SinglePointBeeColony, {"guidance": "much"}),
        (SinglePointBeeColony, {"limit": 0}),
        (ImprovedBeeColony, {"candidates": 0}),
        (ImprovedBeeColony, {"candidates": 41}),
        (ImprovedBeeColony, {"mu": -1.0}),
        (ImprovedBeeColony, {"mu": np.nan}),
        (ImprovedBeeColony, {"separation_m": np.inf}),
        (ImprovedBeeColony, {"heading_weight": -1.0}),
        (ImprovedBeeColony, {"threshold_m": -1.0}),
        (ImprovedBeeColony, {"threshold_m": np.nan}),
        (ImprovedBeeColony, {"threshold_m": "far"}),
    ],
)
def test_unusable_settings_are_refused(make, settings):
    with pytest.raises(InvalidInput, match=next(iter(settings))):
        make(**settings)


@pytest.mark.parametrize(
    "settings", [{"rejected": "none"}, {"answer": "both"}, {"scouts": "some"}, {"update": "later"}]
)
def test_unknown_choices_are_refused(settings):
    with pytest.raises(UnknownName, match=next(iter(settings))):
        ImprovedBeeColony(**settings)


@pytest.mark.parametrize("name", ["improved-abc", "single-point-abc"])
def test_another_problem_is_refused(name):
    with pytest.raises(UnsuitableProblem, match="inertial track"):
        solve(simulate("sphere", 0), name, budget=100)
