"""Fish swarms against plain loops of the published descriptions, closed forms and random search."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from pymoo.core.problem import ElementwiseProblem
from scipy import stats

from navopt import EstimationProblem, Parameter, solve
from navopt.algorithms.fish_moves import centre_of, in_sight, leader_of, total, toward
from navopt.algorithms.fish_swarm import FishSwarm
from navopt.algorithms.novel_fish_swarm import PUBLISHED_VISUAL, NovelFishSwarm
from navopt.algorithms.optimal_fish_swarm import OptimalFishSwarm
from navopt.errors import InvalidInput, UnknownName, UnsuitableProblem
from navopt.problems.analytic import Sphere
from navopt.problems.analytic_base import Point

#: Comparisons with random search in this file; each gets its share of a false alarm in a thousand.
LEVEL = 0.001 / 6

SWARMS = [FishSwarm, OptimalFishSwarm, NovelFishSwarm]
every_swarm = pytest.mark.parametrize("swarm", SWARMS)


class Function(EstimationProblem):
    """A loss given as a vectorised function of rows."""

    def __init__(self, function, lower, upper):
        super().__init__(
            [
                Parameter(f"x{k}", "1", a, b, (2 * a + b) / 3)
                for k, (a, b) in enumerate(zip(lower, upper, strict=True))
            ]
        )
        self.function = function

    def _loss(self, X):
        return self.function(X)

    def estimate(self, x):
        return Point(np.array(x))


def rosenbrock(X):
    return np.sum(100.0 * (X[:, 1:] - X[:, :-1] ** 2) ** 2 + (1.0 - X[:, :-1]) ** 2, axis=1)


def rastrigin(X):
    return np.sum((X - 0.7) ** 2 - 10.0 * np.cos(2 * np.pi * (X - 0.7)) + 10.0, axis=1)


def constant(X):
    return np.zeros(len(X))


WAVY = Function(rastrigin, [-2.0, -1.0, -3.0], [2.0, 3.0, 1.0])
UNEVEN = Function(rastrigin, [-2.0, -1.0, -3.0], [2.0, 1.0, 5.0])
FLAT = Function(constant, [-2.0, -1.0, -3.0], [2.0, 3.0, 1.0])


def drive(algorithm, problem, seed, cycles):
    """Run whole cycles; returns (phase, points, losses) of every batch after the first population."""
    algorithm.setup(problem, seed=seed)
    algorithm.next()
    batches = []
    while algorithm.cycle < cycles:
        pop = algorithm.ask()
        phase = algorithm.batches[algorithm.stage][0]
        algorithm.evaluator.eval(problem, pop)
        batches.append((phase, pop.get("X").copy(), pop.get("F")[:, 0].copy()))
        algorithm.tell(infills=pop)
    return batches


def stack(blocks):
    return {key: np.stack([block[key] for block in blocks]) for key in blocks[0]}


def lockstep(algorithm, problem, seeds, cycles):
    """Advance many runs together; yields the state after every cycle."""
    n, d = algorithm.pop_size, problem.n_var
    generators = [np.random.default_rng(seed) for seed in seeds]
    constants = algorithm.constants(problem)
    X = algorithm.initialize(constants, stack([algorithm.draw_initial(g, n, d) for g in generators]))
    state = algorithm.found(constants, X, problem.loss(X))
    for _ in range(cycles):
        draws = stack([algorithm.draw(g, n, d) for g in generators])
        for phase in algorithm.phases:
            candidates, mask = algorithm.move(state, draws, phase)
            losses = np.where(mask, problem.loss(candidates), np.inf)
            state = algorithm.select(state, draws, phase, candidates, losses, mask)
        yield state


def begin(algorithm, X, problem, *, seed=1):
    """State with fish at X and the draws of a first cycle."""
    X = np.array(X, dtype=float)
    state = algorithm.found(algorithm.constants(problem), X, problem.loss(X))
    return state, algorithm.draw(np.random.default_rng(seed), *X.shape)


# -- geometry ------------------------------------------------------------------------------------------


def test_fish_in_sight_are_nearer_than_visual_and_not_at_the_same_place():
    X = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 0.0], [0.0, 4.9]])
    assert in_sight(X, np.array([5.0, 5.0])).tolist() == [
        [False, False, False, True],
        [False, False, False, True],
        [False, False, False, True],
        [True, True, True, False],
    ]
    # an ellipsoid: 3/10 and 4/4.5 are within, 4.9/4.5 is not
    assert in_sight(X, np.array([10.0, 4.5]))[0].tolist() == [False, True, False, False]
    with np.errstate(all="raise"):
        assert not in_sight(X, np.zeros(2)).any()


def test_centre_and_leader_of_a_group():
    X = np.array([[0.0, 2.0], [4.0, 4.0], [8.0, -3.0]])
    members = np.array([[False, True, True], [False, False, False]])
    np.testing.assert_array_equal(centre_of(X, members), [[6.0, 0.5], [0.0, 0.0]])
    position, loss = leader_of(X, np.array([1.0, 9.0, 3.0]), members)
    np.testing.assert_array_equal(position[0], X[2])
    np.testing.assert_array_equal(loss, [3.0, np.inf])


def test_a_step_is_a_length_along_the_straight_line_in_scaled_coordinates():
    X, target, scale = np.zeros((1, 2)), np.array([[3e6, 4e-2]]), np.array([1e6, 1e-2])
    np.testing.assert_allclose(toward(X, target, scale, np.array([[10.0]])), [[6e6, 8e-2]])  # beyond it
    np.testing.assert_allclose(toward(X, target, scale, np.array([[5.0, 1.0]])), [[3e6, 0.8e-2]])
    np.testing.assert_array_equal(toward(X, X, scale, np.array([[5.0]])), X)


def test_a_sum_does_not_depend_on_the_memory_layout():
    values = np.random.default_rng(1).random((50, 17, 12))
    for axis in (-2, -1):
        alone = np.array([total(run.copy(), axis) for run in values])
        np.testing.assert_array_equal(total(values, axis), alone)
        np.testing.assert_array_equal(total(np.asfortranarray(values), axis), alone)


# -- lockstep ------------------------------------------------------------------------------------------

LOCKSTEP = [
    (50, FishSwarm, {}),
    (12, FishSwarm, {"free_move": False, "crowding": 0.3, "visual": (0.3, 0.5, 0.2, 0.4)}),
    (12, FishSwarm, {"keep_worse": False, "follow": False, "units": "problem", "visual": 1.5}),
    (50, OptimalFishSwarm, {"horizon": 4, "rises": 1, "patience": 2}),
    (12, OptimalFishSwarm, {"rises": 1, "patience": 2, "recursive": True, "restart_schedule": False}),
    (50, NovelFishSwarm, {}),
    (12, NovelFishSwarm, {"visual": (0.3, 0.1, 0.2, 0.4), "visual_reading": "rotated", "initial": "nominal"}),
    (12, NovelFishSwarm, {"keep_trying": False, "random_move": False, "contraction_per": "parameter"}),
    (12, NovelFishSwarm, {"group": False}),
]


@pytest.mark.parametrize(("runs", "swarm", "options"), LOCKSTEP)
def test_many_runs_in_lockstep_equal_single_runs_bit_for_bit(runs, swarm, options):
    settings = {"pop_size": 9, "try_number": 2, **options}
    problem = Function(rosenbrock, [-2.0, -2.0, -1.0, -2.0], [2.0, 3.0, 2.0, 2.0])
    *_, state = lockstep(swarm(**settings), problem, range(runs), 5)
    for k in range(runs):
        single = swarm(**settings)
        drive(single, problem, k, 5)
        for key in ("X", "F", "best", "best_loss", "visual", "age"):
            mine = state[key][k] if state[key].shape[:1] == (runs,) else state[key]
            np.testing.assert_array_equal(mine, single.state[key], err_msg=key)
    if swarm is OptimalFishSwarm:
        assert (state["level"] < 0.5).any()  # some had restarted


@every_swarm
def test_masks_in_lockstep_equal_those_of_single_runs(swarm):
    algorithm, problem = swarm(pop_size=9, try_number=2), WAVY
    rngs = [np.random.default_rng(seed) for seed in range(20)]
    X = np.stack([-1.0 + 1.5 * rng.random((9, 3)) for rng in rngs])
    draws = [algorithm.draw(rng, 9, 3) for rng in rngs]
    constants = algorithm.constants(problem)
    state = algorithm.found(constants, X, problem.loss(X))
    alone = [algorithm.found(constants, x, problem.loss(x)) for x in X]
    for phase in algorithm.phases:
        candidates, mask = algorithm.move(state, stack(draws), phase)
        losses = np.where(mask, problem.loss(candidates), np.inf)
        state = algorithm.select(state, stack(draws), phase, candidates, losses, mask)
        for k in range(20):
            one, its_mask = algorithm.move(alone[k], draws[k], phase)
            np.testing.assert_array_equal(mask[k], its_mask)
            np.testing.assert_array_equal(candidates[k], one)
            # a run in which nobody moves in this phase may skip it
            if its_mask.any():
                alone[k] = algorithm.select(alone[k], draws[k], phase, one, losses[k], its_mask)


# -- the published loops, in plain Python ---------------------------------------------------------------


class Loop:
    """Shared by the loops below: evaluates and records, draws the same numbers, clips to the box."""

    def __init__(self, algorithm, problem, seed):
        self.problem, self.algorithm = problem, algorithm
        self.n, self.d = algorithm.pop_size, problem.n_var
        self.width = problem.xu - problem.xl
        self.rng = np.random.default_rng(seed)
        self.X = [problem.xl + u * self.width for u in self.rng.random((self.n, self.d))]
        self.seen = []
        self.bulletin = (None, np.inf)
        self.F = [self.f(x) for x in self.X]
        self.seen.clear()

    def f(self, x):
        loss = float(self.problem.loss(x))
        self.seen.append(np.array(x))
        if loss < self.bulletin[1]:
            self.bulletin = (np.array(x), loss)
        return loss

    def clip(self, x):
        return np.minimum(np.maximum(x, self.problem.xl), self.problem.xu)

    def distance(self, a, b):
        return float(np.linalg.norm((a - b) / self.width))

    def draws(self):
        return self.algorithm.draw(self.rng, self.n, self.d)


class LiFish(Loop):
    """Li, Shao and Qian's swarm, minimising; lengths in box widths."""

    def prey(self, i, u, branch, visual, step):
        x, fx = self.X[i], self.F[i]
        for t in range(self.algorithm.try_number):
            xj = self.clip(x + self.width * visual * (2 * u[f"{branch} try"][t, i] - 1))
            if self.f(xj) < fx:
                return self.go(i, xj, u[f"{branch} length"][i], step)
        y = self.clip(x + self.width * step * (2 * u[f"{branch} free"][i] - 1))
        return y, self.f(y)

    def go(self, i, target, u, step):
        gap = (target - self.X[i]) / self.width
        y = self.clip(self.X[i] + self.width * gap / np.linalg.norm(gap) * step * u)
        return y, self.f(y)

    def behave(self, i, u, visual, step):
        x = self.X[i]
        V = [j for j in range(self.n) if 0 < self.distance(x, self.X[j]) < visual]
        uncrowded = V and len(V) / self.n < self.algorithm.crowding
        centre = sum(self.X[j] for j in V) / len(V) if V else None
        if uncrowded and self.f(centre) < self.F[i]:
            swarmed = self.go(i, centre, u["swarm length"][i], step)
        else:
            swarmed = self.prey(i, u, "swarm", visual, step)
        best = min(V, key=lambda j: self.F[j]) if V else None
        if uncrowded and self.F[best] < self.F[i]:
            followed = self.go(i, self.X[best], u["follow length"][i], step)
        else:
            followed = self.prey(i, u, "follow", visual, step)
        return followed if followed[1] < swarmed[1] else swarmed

    def cycle(self, u, visual, step):
        results = []
        for i in range(self.n):
            result = self.behave(i, u, visual, step)
            if self.algorithm.update == "sequential":
                self.X[i], self.F[i] = result
            results.append(result)
        self.X, self.F = [list(values) for values in zip(*results, strict=True)]


class GaoFish(LiFish):
    """The optimal fish swarm: schedules of eqs. (1)-(3) and secondary initialisation."""

    def run(self, cycles):
        a = self.algorithm
        first, G, restarts = 1.0, 0, 0
        history, rises, since = [min(self.F)], 0, 0
        visual = step = None
        for _ in range(cycles):
            u = self.draws()
            if rises == a.rises or since == a.patience:
                restarts, first, G = restarts + 1, first * a.shrink, 0
                self.X = [
                    self.clip(self.bulletin[0] + self.width * first * a.visual * (2 * r - 1))
                    for r in u["restart"]
                ]
                self.F = [self.f(x) for x in self.X]
                history, rises, since = [], 0, 0
            if a.recursive:
                if G == 0:
                    visual, step = first * a.visual, first * a.step
                elif a.horizon >= G:
                    decay = np.exp(-3 * G / a.horizon)
                    visual = visual * decay + first * a.visual * a.floor
                    step = step * decay + first * a.step * a.floor
            else:
                decay = np.exp(-3 * min(G, a.horizon) / a.horizon)
                visual = first * a.visual * decay + first * a.visual * a.floor
                step = first * a.step * decay + first * a.step * a.floor
            self.cycle(u, visual, step)
            G += 1
            now = min(self.F)
            rises = rises + 1 if history and now > history[-1] else 0
            since = since + 1 if history and now >= min(history) else 0
            history.append(now)
        return restarts


class YazdaniFish(Loop):
    """The novel fish swarm, all inequalities for minimisation."""

    def step_towards(self, i, target, reach):
        distance = self.distance(self.X[i], target)
        if distance == 0:
            return
        gap = (target - self.X[i]) / self.width
        self.X[i] = self.clip(self.X[i] + self.width * reach * gap / distance)
        self.F[i] = self.f(self.X[i])

    def run(self, cycles):
        a = self.algorithm
        visual = np.full(self.d, a.visual)
        for _ in range(cycles):
            u = self.draws()
            failed = []
            for i in range(self.n):
                improved = False
                for t in range(a.try_number):
                    xj = self.clip(self.X[i] + self.width * visual * (2 * u["try"][t, i] - 1))
                    fj = self.f(xj)
                    if fj < self.F[i]:
                        self.X[i], self.F[i], improved = xj, fj, True
                if not improved:
                    failed.append(i)
            best = int(np.argmin(self.F))
            for i in failed:
                # moving one after another, an earlier fish may have become the best
                if a.update == "sequential":
                    best = int(np.argmin(self.F))
                if i != best:
                    self.X[i] = self.clip(self.X[i] + self.width * visual * (2 * u["random"][i] - 1))
                    self.F[i] = self.f(self.X[i])
            centre = sum(self.X) / self.n
            f_centre = self.f(centre)
            best = int(np.argmin(self.F))
            if f_centre < self.F[best]:
                self.X[best], self.F[best] = centre, f_centre
            leader = self.X[best]
            for i in range(self.n):
                if a.update == "sequential":
                    leader = self.X[int(np.argmin(self.F))]
                target = centre if f_centre < self.F[i] else leader
                self.step_towards(i, target, visual * u["length"][i])
            low, high = a.contraction
            visual = visual * (low + (high - low) * u["contraction"][0])


def assert_same_swarm(algorithm, loop, batches, *, same_order):
    np.testing.assert_allclose(algorithm.state["X"], loop.X, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(algorithm.state["F"], loop.F, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(algorithm.state["best"], loop.bulletin[0], rtol=1e-9)
    points = np.concatenate([points for _, points, _ in batches])
    assert len(points) == len(loop.seen)
    if same_order:
        np.testing.assert_allclose(points, loop.seen, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("update", ["synchronous", "sequential"])
@pytest.mark.parametrize("crowding", [0.3, 1.0])
def test_fish_swarm_is_the_published_loop(update, crowding):
    algorithm = FishSwarm(pop_size=8, try_number=2, crowding=crowding, update=update)
    batches = drive(algorithm, UNEVEN, 5, 7)
    loop = LiFish(algorithm, UNEVEN, 5)
    for _ in range(7):
        loop.cycle(loop.draws(), algorithm.visual, algorithm.step)
    assert_same_swarm(algorithm, loop, batches, same_order=update == "sequential")


@pytest.mark.parametrize("update", ["synchronous", "sequential"])
@pytest.mark.parametrize("recursive", [False, True])
def test_optimal_fish_swarm_is_the_published_loop(update, recursive):
    settings = {"horizon": 5, "floor": 0.2, "rises": 1, "patience": 3, "recursive": recursive}
    algorithm = OptimalFishSwarm(pop_size=8, try_number=2, update=update, **settings)
    batches = drive(algorithm, UNEVEN, 5, 14)
    loop = GaoFish(algorithm, UNEVEN, 5)
    restarts = loop.run(14)
    assert restarts >= 1
    assert restarts == sum(phase == "restart" for phase, _, _ in batches)
    assert_same_swarm(algorithm, loop, batches, same_order=update == "sequential")


@pytest.mark.parametrize("update", ["synchronous", "sequential"])
@pytest.mark.parametrize("function", [rastrigin, rosenbrock])
def test_novel_fish_swarm_is_the_published_loop(update, function):
    problem = Function(function, UNEVEN.xl, UNEVEN.xu)
    algorithm = NovelFishSwarm(pop_size=8, update=update)
    batches = drive(algorithm, problem, 6, 8)
    loop = YazdaniFish(algorithm, problem, 6)
    loop.run(8)
    assert_same_swarm(algorithm, loop, batches, same_order=False)


# -- what a cycle costs --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "per_fish"),
    [
        ({}, 2 * 4 + 2),
        ({"free_move": False}, 2 * 4),
        ({"swarm": False}, 4 + 1),
        ({"follow": False}, 4 + 1),
        ({"swarm": False, "follow": False}, 4 + 1),
        # everybody in sight of everybody: the centre is evaluated too, unless it is crowded
        ({"visual": 9.0, "crowding": 1.0}, 2 * 4 + 3),
        ({"visual": 9.0}, 2 * 4 + 2),
    ],
)
@pytest.mark.parametrize("swarm", [FishSwarm, OptimalFishSwarm])
def test_cost_of_a_cycle_in_which_nothing_is_better(swarm, options, per_fish):
    algorithm = swarm(**{"pop_size": 6, "try_number": 4, "visual": 1e-9, **options})
    batches = drive(algorithm, FLAT, 1, 3) if options.get("free_move", True) else None
    if batches is None:
        # the last phase is empty, so the third cycle ends when the fourth begins
        algorithm.setup(FLAT, seed=1)
        while algorithm.evaluator.n_eval < 6 + 3 * 6 * per_fish:
            algorithm.next()
        assert algorithm.evaluator.n_eval == 6 + 3 * 6 * per_fish
        algorithm.ask()
        assert algorithm.cycle == 3
    assert algorithm.evaluator.n_eval == 6 + 3 * 6 * per_fish


@pytest.mark.parametrize("seed", range(5))
def test_cost_of_a_fish_swarm_cycle_is_within_its_bounds(seed):
    algorithm = FishSwarm(pop_size=10, try_number=3)
    batches = drive(algorithm, WAVY, seed, 10)
    assert 3 * 10 * 10 <= sum(len(points) for _, points, _ in batches) <= 10 * 10 * (2 * 3 + 3)


@pytest.mark.parametrize(
    ("options", "cost"),
    [
        ({}, 6 * (4 + 2) - 1),
        ({"keep_trying": False}, 6 * (4 + 2) - 1),
        ({"random_move": False}, 6 * (4 + 1)),
        ({"group": False}, 6 * (4 + 1) - 1),
        ({"group": False, "random_move": False}, 6 * 4),
    ],
)
def test_cost_of_a_novel_cycle_in_which_nothing_is_better(options, cost):
    algorithm = NovelFishSwarm(pop_size=6, try_number=4, **options)
    drive(algorithm, FLAT, 1, 3)
    assert algorithm.evaluator.n_eval == 6 + 3 * cost


def test_cost_of_a_novel_cycle_by_its_successes():
    batches = drive(NovelFishSwarm(pop_size=10), WAVY, 3, 12)
    sizes = [(phase, len(points)) for phase, points, _ in batches]
    assert {size for phase, size in sizes if phase.startswith("try")} == {10}
    assert {size for phase, size in sizes if phase == "centre"} == {1}
    assert {size for phase, size in sizes if phase == "group"} == {9}  # all but the best
    assert max(size for phase, size in sizes if phase == "random") < 9
    first = drive(NovelFishSwarm(pop_size=10, keep_trying=False), WAVY, 3, 12)
    tries = [len(points) for phase, points, _ in first if phase.startswith("try")]
    assert sum(tries) < 10 * 3 * 12


# -- lengths -------------------------------------------------------------------------------------------


@every_swarm
def test_any_box_is_searched_as_the_unit_box_is(swarm):
    lower, width = np.array([-5e5, -2e-2, -900.0]), np.array([1e6, 1e-2, 300.0])
    plain = Function(lambda U: rastrigin(6 * U - 2), np.zeros(3), np.ones(3))
    mixed = Function(lambda X: rastrigin(6 * (X - lower) / width - 2), lower, lower + width)
    first, second = swarm(visual=(0.2, 0.3, 0.4)), swarm(visual=(0.2, 0.3, 0.4))
    drive(first, plain, 4, 5)
    drive(second, mixed, 4, 5)
    np.testing.assert_allclose((second.state["X"] - lower) / width, first.state["X"], atol=1e-9)


@every_swarm
def test_absolute_lengths_are_fractions_of_the_box_times_its_width(swarm):
    options = {} if swarm is NovelFishSwarm else {"step": (0.1, 0.2, 0.1)}
    absolute = {} if swarm is NovelFishSwarm else {"step": (0.4, 0.8, 0.4)}
    box, problem = swarm(visual=0.3, **options), swarm(visual=1.2, units="problem", **absolute)
    drive(box, WAVY, 4, 5)  # all three parameters of WAVY are 4 wide
    drive(problem, WAVY, 4, 5)
    np.testing.assert_allclose(problem.state["X"], box.state["X"], atol=1e-9)


@pytest.mark.parametrize("swarm", [FishSwarm, NovelFishSwarm])
@pytest.mark.parametrize("units", ["box", "problem"])
def test_tries_are_uniform_within_the_vision(swarm, units):
    problem = Sphere([0.0, 0.0], lower=[-50.0, -1.0], upper=[50.0, 1.0])
    reach = np.array([10.0, 0.4]) if units == "box" else np.array([0.1, 0.2])
    algorithm = swarm(pop_size=4000, visual=(0.1, 0.2), units=units, try_number=1)
    state, draws = begin(algorithm, np.zeros((4000, 2)), problem)
    phase = next(phase for phase in algorithm.phases if "try" in phase)
    relative = algorithm.move(state, draws, phase)[0] / reach
    assert (np.abs(relative) <= 1).all()
    np.testing.assert_allclose(np.abs(relative).mean(axis=0), 0.5, atol=4 * 0.289 / np.sqrt(4000))
    assert (np.abs(relative.mean(axis=0)) < 4 * 0.577 / np.sqrt(4000)).all()


@every_swarm
def test_fish_may_start_around_the_nominal_values(swarm):
    algorithm = swarm(visual=(0.1, 0.2, 0.01), initial="nominal", pop_size=50)
    algorithm.setup(WAVY, seed=1)
    gap = np.abs(algorithm.ask().get("X") - WAVY.nominal) / (WAVY.xu - WAVY.xl)
    assert (gap <= [0.1, 0.2, 0.01]).all()
    assert (gap.max(axis=0) > [0.08, 0.16, 0.008]).all()


# -- options of the fish swarm --------------------------------------------------------------------------


def test_a_crowded_place_attracts_nobody():
    problem = Sphere([0.9, 0.9], lower=-1.0, upper=1.0)
    X = np.random.default_rng(1).uniform(-0.1, 0.1, (10, 2))
    for crowding, expected in ((0.9, 0), (0.95, 10)):
        algorithm = FishSwarm(pop_size=10, visual=0.5, crowding=crowding)
        state, draws = begin(algorithm, X, problem)
        assert algorithm.move(state, draws, "centre")[1].sum() == expected
        follows = ~algorithm.move(state, draws, "follow try 1")[1]
        assert follows.sum() == (9 if expected else 0)  # nobody leads the best


def test_a_fish_swarms_follows_preys_or_roams():
    problem = Sphere([0.9, 0.0], lower=-1.0, upper=1.0)
    X = np.array([[0.0, 0.0], [0.2, 0.2], [0.2, -0.2], [-0.9, 0.0]])
    algorithm = FishSwarm(pop_size=4, visual=0.2, step=0.05, crowding=1.0, try_number=1)  # sees 0.4 far
    state, draws = begin(algorithm, X, problem)
    candidates, mask = algorithm.move(state, draws, "centre")
    # the first sees two, whose centre is better; these see it, and it is worse; the last sees nobody
    assert mask.tolist() == [True, True, True, False]
    np.testing.assert_allclose(candidates[:3], [[0.2, 0.0], X[0], X[0]])
    losses = np.where(mask, problem.loss(candidates), np.inf)
    state = algorithm.select(state, draws, "centre", candidates, losses, mask)
    candidates, mask = algorithm.move(state, draws, "swarm try 1")
    assert mask.tolist() == [False, True, True, True]
    # as if the second had found something, in the direction of its attempt, and the others had not
    losses = np.array([np.inf, 0.0, 9.0, 9.0])
    attempt = candidates.copy()
    state = algorithm.select(state, draws, "swarm try 1", candidates, losses, mask)
    candidates, mask = algorithm.move(state, draws, "swarm move")
    assert mask.all()
    step = 0.05 * 2.0
    length = step * draws["swarm length"]
    np.testing.assert_allclose(candidates[0], [length[0], 0.0], atol=1e-15)
    gap = attempt[1] - X[1]
    np.testing.assert_allclose(candidates[1], X[1] + length[1] * gap / np.linalg.norm(gap))
    np.testing.assert_allclose(candidates[2:], X[2:] + step * (2 * draws["swarm free"][2:] - 1))
    # following: the first goes to one of its equally good neighbours
    state = algorithm.select(state, draws, "swarm move", candidates, np.full(4, 50.0), mask)
    assert algorithm.move(state, draws, "follow try 1")[1].tolist() == [False, True, True, True]
    np.testing.assert_array_equal(state["X"], X)  # nobody has moved yet


def test_of_two_equally_good_places_the_first_is_taken():
    algorithm = FishSwarm(pop_size=6)
    batches = drive(algorithm, FLAT, 1, 1)
    places = {phase: points for phase, points, _ in batches}
    np.testing.assert_array_equal(algorithm.state["X"], places["swarm move"])
    assert (places["swarm move"] != places["follow move"]).any(axis=1).all()


def test_keeping_only_what_is_better():
    for keep_worse in (True, False):
        algorithm = FishSwarm(pop_size=8, keep_worse=keep_worse)
        states = list(lockstep(algorithm, WAVY, range(5), 8))
        changes = np.concatenate([(b["F"] - a["F"]).ravel() for a, b in pairwise(states)])
        assert (changes > 0).any() == keep_worse
        assert (changes < 0).any()


@pytest.mark.parametrize("keep_worse", [True, False])
def test_without_a_free_move_fish_that_find_nothing_stay(keep_worse):
    algorithm = FishSwarm(pop_size=8, free_move=False, keep_worse=keep_worse)
    algorithm.setup(FLAT, seed=3)
    algorithm.next()
    first = algorithm.state["X"].copy()
    for _ in range(30):
        algorithm.next()
    assert algorithm.cycle >= 4
    np.testing.assert_array_equal(algorithm.state["X"], first)


def test_without_a_free_move_a_first_success_is_not_lost():
    """Fish 0 finds something when it swarms and nothing when it follows; then nobody has a last phase."""
    algorithm = FishSwarm(pop_size=2, free_move=False, visual=0.01, try_number=1)
    problem = Sphere([0.0], lower=-1.0, upper=1.0)
    state, draws = begin(algorithm, [[0.5], [-0.5]], problem)
    for phase, losses in (
        ("swarm try 1", [0.0, 9.0]),
        ("swarm move", [0.01, np.inf]),
        ("follow try 1", [9.0, 9.0]),
        ("follow move", None),
    ):
        candidates, mask = algorithm.move(state, draws, phase)
        if losses is None:
            assert not mask.any()
            break
        if phase == "swarm move":
            assert mask.tolist() == [True, False]
            place = candidates[0].copy()
        state = algorithm.select(state, draws, phase, candidates, np.where(mask, losses, np.inf), mask)
    later = algorithm.current(state, algorithm.draw(np.random.default_rng(9), 2, 1))
    np.testing.assert_array_equal(later["X"], [place, [-0.5]])
    assert later["F"].tolist() == [0.01, state["F"][1]]


@pytest.mark.parametrize(
    ("options", "phases"),
    [
        ({}, ["centre", "swarm try 1", "swarm move", "follow try 1", "follow move"]),
        ({"swarm": False}, ["follow try 1", "follow move"]),
        ({"follow": False}, ["centre", "swarm try 1", "swarm move"]),
        ({"swarm": False, "follow": False}, ["prey try 1", "prey move"]),
    ],
)
def test_behaviours_can_be_switched_off(options, phases):
    assert list(FishSwarm(try_number=1, **options).phases) == phases
    assert list(OptimalFishSwarm(try_number=1, **options).phases) == ["restart", *phases]
    assert solve(WAVY, FishSwarm(pop_size=5, **options), budget=300).counts.loss == 300


# -- schedules and secondary initialisation -------------------------------------------------------------


def visions(algorithm, cycles):
    """Field of vision and step of a run in each cycle, relative to the first values."""
    state, _ = begin(algorithm, np.random.default_rng(1).random((5, 3)), FLAT)
    rng = np.random.default_rng(2)
    for _ in range(cycles):
        state = algorithm.current(state, algorithm.draw(rng, 5, 3))
        yield state["visual"] / algorithm.visual, state["step"] / algorithm.step


def test_vision_and_step_follow_the_closed_form_and_hold_beyond_the_horizon():
    algorithm = OptimalFishSwarm(pop_size=5, horizon=6, floor=0.02, secondary=False)
    expected = np.exp(-3 * np.minimum(np.arange(10), 6) / 6) + 0.02
    for (visual, step), value in zip(visions(algorithm, 10), expected, strict=True):
        np.testing.assert_allclose(visual, value, rtol=1e-14)
        np.testing.assert_allclose(step, value, rtol=1e-14)


def test_the_literal_recursion_collapses_to_the_product_of_the_factors():
    algorithm = OptimalFishSwarm(pop_size=5, horizon=30, floor=0.0, recursive=True, secondary=False)
    G = np.minimum(np.arange(40), 30)
    expected = np.exp(-3 / 30 * np.cumsum(np.where(np.arange(40) <= 30, G, 0)))
    relative = np.array([visual[0] for visual, _ in visions(algorithm, 40)])
    np.testing.assert_allclose(relative, expected, rtol=1e-12)
    # Σ G/G_max = (G_max + 1) / 2; after G cycles G (G + 1) / (2 G_max)
    np.testing.assert_allclose(np.log(relative[12]), -1.5 * 12 * 13 / 30, rtol=1e-12)
    np.testing.assert_allclose(np.log(relative[-1]), -1.5 * 31, rtol=1e-12)
    # with a floor it ends a little above it; λ at the end is e⁻³
    floored = OptimalFishSwarm(pop_size=5, horizon=30, floor=0.01, recursive=True, secondary=False)
    last = [visual[0] for visual, _ in visions(floored, 40)][-1]
    np.testing.assert_allclose(last, 0.01 / (1 - np.exp(-3)), rtol=0.01)


def restarts(lowest_losses, **options):
    """In which cycles an `OptimalFishSwarm` restarts whose swarm ends cycles with these lowest losses."""
    algorithm = OptimalFishSwarm(pop_size=5, **options)
    state, _ = begin(algorithm, np.random.default_rng(1).random((5, 3)), WAVY)
    rng = np.random.default_rng(2)
    first = lowest_losses[0]
    state = {**state, "F": np.full(5, first), "indicator": np.array(first), "lowest": np.array(first)}
    found = []
    for cycle, loss in enumerate(lowest_losses[1:]):
        state = algorithm.current(state, algorithm.draw(rng, 5, 3))
        if state["restart"]:
            found.append(cycle)
        state = {**state, "F": loss + np.arange(5.0)}
    return found, state


@pytest.mark.parametrize(
    ("losses", "expected"),
    [
        ([5, 6, 7, 8, 8], [3]),  # three rises in cycles 0 to 2
        ([5, 6, 7, 7, 8, 9, 8, 8], []),  # a standstill interrupts them
        ([5, 6, 7, 6, 7, 8, 9, 9], [6]),
        ([5, 4, 3, 2, 1, 0, -1, -2, -3, -4, -5, -6, -7], []),
        ([5] * 13, [10]),  # ten cycles without improvement
        ([5, 4] + [4] * 12, [11]),
        ([5] * 10 + [4.9, 5, 4.9], []),
        ([5, 4] + [4.5, 4.2] * 6, [11]),  # no new minimum, though it falls every second time
        # the cycle after a restart has nothing to be compared with, then three rises again
        ([5, 6, 7, 8, 9, 10, 11, 12, 12], [3, 7]),
        # nor are its losses held against the past: they are worse than before, but fall
        ([5, 6, 7, 8, *range(30, 15, -1)], [3]),
    ],
)
def test_secondary_initialisation_happens_exactly_when_the_rule_says(losses, expected):
    losses = [float(loss) for loss in losses]
    assert restarts(losses)[0] == expected
    assert restarts(losses, secondary=False)[0] == []


def test_the_constants_of_secondary_initialisation_are_options():
    rising = [5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 10.0]
    assert restarts(rising, rises=2)[0] == [2, 5]
    assert restarts(rising, rises=9, patience=4)[0] == [4]
    for shrink in (0.1, 0.5):
        for restart_schedule, clock in ((True, 2), (False, 5)):
            options = {"shrink": shrink, "restart_schedule": restart_schedule, "horizon": 10, "floor": 0.0}
            state = restarts(rising, **options)[1]
            assert state["clock"] == clock
            assert state["level"] == shrink
            np.testing.assert_allclose(state["visual"], 0.5 * shrink * np.exp(-0.3 * clock))


def test_restarted_fish_surround_the_best_point_ever_seen():
    algorithm = OptimalFishSwarm(pop_size=400, rises=1, patience=1, shrink=0.2)
    state, draws = begin(algorithm, np.zeros((400, 3)), FLAT)
    best = np.array([0.5, 1.0, -1.0])
    state = {**state, "best": best, "best_loss": np.array(-3.0), "age": np.array(0)}
    candidates, mask = algorithm.move(state, draws, "restart")
    assert mask.all()
    gap = np.abs(candidates - best) / 4.0
    assert gap.max() <= 0.5 * 0.2
    assert gap.max() > 0.49 * 0.2
    after = algorithm.select(state, draws, "restart", candidates, np.full(400, 7.0), mask)
    np.testing.assert_array_equal(after["X"], candidates)
    assert (after["F"] == 7.0).all()
    np.testing.assert_array_equal(after["best"], best)  # the bulletin is kept


def test_no_restart_around_a_point_that_could_not_be_evaluated():
    nothing = Function(lambda X: np.full(len(X), np.inf), [0.0, 0.0], [1.0, 1.0])
    algorithm = OptimalFishSwarm(pop_size=4, patience=1, rises=1)
    batches = drive(algorithm, nothing, 1, 6)
    assert "restart" not in {phase for phase, _, _ in batches}


# -- options of the novel fish swarm --------------------------------------------------------------------


def contractions(**options):
    algorithm = NovelFishSwarm(pop_size=2, try_number=1, **options)
    return np.array([s["visual"] for s in lockstep(algorithm, FLAT, range(400), 21)]) / algorithm.visual


def test_vision_shrinks_e_fold_per_cycle_with_the_published_contraction():
    visual = contractions(contraction=(1e-6, 0.999999))
    assert (visual[0] == 1).all()  # the first cycle has the whole vision
    logarithm = np.log(visual[-1, :, 0]) / 20
    # ln U has mean -1 and variance 1; 400 runs of 20 cycles, four standard errors
    assert abs(logarithm.mean() + 1) < 4 / np.sqrt(400 * 20)
    factor = visual[1:, :, 0] / visual[:-1, :, 0]
    assert factor.min() > 0
    assert abs(factor.mean() - 0.5) < 4 * 0.289 / np.sqrt(400 * 20)
    assert (visual == visual[..., :1]).all()  # one factor for all parameters


def test_contraction_range_per_parameter_and_none_at_all():
    visual = contractions(contraction=(0.7, 0.9), contraction_per="parameter")
    factor = visual[1:] / visual[:-1]
    assert 0.7 <= factor.min() < 0.701
    assert 0.899 < factor.max() < 0.9
    assert abs(np.corrcoef(factor[..., 0].ravel(), factor[..., 1].ravel())[0, 1]) < 4 / np.sqrt(8000)
    assert (contractions(contraction=(1, 1)) == 1).all()


def test_three_readings_of_a_vector_of_visions():
    vector, n = (0.3, 0.03, 0.003), 3000
    reach = {}
    for reading in ("literal", "rotated", "uniform"):
        algorithm = NovelFishSwarm(pop_size=n, visual=vector, visual_reading=reading)
        state, draws = begin(algorithm, np.zeros((n, 3)), FLAT)
        reach[reading] = np.abs(algorithm.move(state, draws, "try 1")[0]) / 4.0
    assert (reach["literal"] <= vector).all()
    np.testing.assert_allclose(reach["literal"].max(axis=0), vector, rtol=0.01)
    np.testing.assert_allclose(reach["uniform"].max(axis=0), 0.3 * np.ones(3), rtol=0.01)
    # each fish has each vision once, and each parameter each of them equally often
    order = np.argsort(algorithm.draw(np.random.default_rng(1), n, 3)["order"], axis=-1)
    visions = np.array(vector)[order]
    assert (reach["rotated"] <= visions).all()
    assert (reach["rotated"].max(axis=0) > 0.29).all()
    share = (visions == 0.3).mean(axis=0)
    assert (np.abs(share - 1 / 3) < 4 * np.sqrt(2 / 9 / n)).all()


def test_a_rotated_vision_sets_the_length_of_all_moves():
    vector, X = np.array([0.2, 0.02, 0.002]), np.array([[0.0, 0.0, 0.0], [1.0, 1.5, -1.0], [-1.0, 1.6, -2.0]])
    problem = Sphere([0.1, 0.1, 0.1], lower=[-2.0, -1.0, -3.0], upper=[2.0, 3.0, 1.0])
    algorithm = NovelFishSwarm(pop_size=3, visual=tuple(vector), visual_reading="rotated")
    state, draws = begin(algorithm, X, problem)
    draws["order"] = np.array([[0.1, 0.2, 0.3], [0.9, 0.5, 0.1], [0.5, 0.9, 0.1]])
    visions = vector[[[0, 1, 2], [2, 1, 0], [2, 0, 1]]]
    for phase, factor in (("try 2", 2 * draws["try"][1] - 1), ("random", 2 * draws["random"] - 1)):
        candidates, _ = algorithm.move(state, draws, phase)
        np.testing.assert_allclose(candidates, X + 4.0 * visions * factor)
    candidates, mask = algorithm.move(state, draws, "group")  # the centre is unknown, so all go to the best
    assert mask.tolist() == [False, True, True]
    direction = (X[0] - X[1:]) / np.linalg.norm(X[1:], axis=1, keepdims=True)
    np.testing.assert_allclose(
        candidates[1:], X[1:] + 4.0 * visions[1:] * draws["length"][1:, None] * direction
    )


def test_the_best_fish_never_makes_the_random_move_and_is_never_lost():
    algorithm = NovelFishSwarm(pop_size=6)
    state, draws = begin(algorithm, np.random.default_rng(3).random((6, 3)), WAVY)
    mask = algorithm.move(state, draws, "random")[1]
    assert np.flatnonzero(~mask).tolist() == [np.argmin(state["F"])]
    lowest = np.array([s["F"].min(axis=-1) for s in lockstep(algorithm, WAVY, range(30), 15)])
    assert (np.diff(lowest, axis=0) <= 0).all()
    # without eq. (10) the best fish steps towards a better centre and may be lost
    free = NovelFishSwarm(pop_size=6, centre_replaces_best=False)
    states = list(lockstep(free, WAVY, range(30), 15))
    assert (np.diff([s["F"].min(axis=-1) for s in states], axis=0) > 0).any()
    assert (np.diff([s["best_loss"] for s in states], axis=0) <= 0).all()  # but it is remembered


@pytest.mark.parametrize("replaces", [True, False])
def test_a_better_centre_attracts_all_and_may_replace_the_best(replaces):
    problem = Sphere([0.0, 0.0], lower=-2.0, upper=2.0)
    X = np.array([[1.0, 0.0], [-1.0, 0.1], [0.0, 1.0], [0.1, -1.0]])
    algorithm = NovelFishSwarm(pop_size=4, visual=0.1, centre_replaces_best=replaces)
    state, draws = begin(algorithm, X, problem)
    candidates, mask = algorithm.move(state, draws, "centre")
    assert mask.sum() == 1
    centre = X.mean(axis=0)
    np.testing.assert_allclose(candidates[0], centre)
    losses = np.where(mask, problem.loss(candidates), np.inf)
    state = algorithm.select(state, draws, "centre", candidates, losses, mask)
    assert state["X"].tolist() == [X[0].tolist() if not replaces else candidates[0].tolist(), *X[1:].tolist()]
    candidates, mask = algorithm.move(state, draws, "group")
    assert mask.tolist() == [not replaces, True, True, True]
    gap = centre - X
    direction = gap / np.linalg.norm(gap, axis=1, keepdims=True)
    expected = X + 0.4 * draws["length"][:, None] * direction
    np.testing.assert_allclose(candidates[mask], expected[mask])


def test_fish_better_than_the_centre_go_to_the_best():
    problem = Sphere([1.0, 1.0], lower=-2.0, upper=2.0)
    X = np.array([[1.0, 0.9], [0.9, 0.8], [-2.0, -2.0]])
    algorithm = NovelFishSwarm(pop_size=3, visual=0.01)
    state, draws = begin(algorithm, X, problem)
    candidates, mask = algorithm.move(state, draws, "centre")
    losses = np.where(mask, problem.loss(candidates), np.inf)
    state = algorithm.select(state, draws, "centre", candidates, losses, mask)
    np.testing.assert_array_equal(state["X"], X)
    candidates, mask = algorithm.move(state, draws, "group")
    assert mask.tolist() == [False, True, True]
    for i, target in ((1, X[0]), (2, X.mean(axis=0))):
        moved = candidates[i] - X[i]
        np.testing.assert_allclose(np.linalg.norm(moved), 0.04 * draws["length"][i])
        gap = target - X[i]
        np.testing.assert_allclose(moved[0] * gap[1], moved[1] * gap[0])
        assert moved @ gap > 0


def test_attempts_start_from_the_last_success_or_end_with_it():
    problem = Sphere([1.9], lower=-2.0, upper=2.0)
    for keep_trying in (True, False):
        algorithm = NovelFishSwarm(pop_size=50, keep_trying=keep_trying)
        state, draws = begin(algorithm, np.zeros((50, 1)), problem)
        candidates, mask = algorithm.move(state, draws, "try 1")
        assert mask.all()
        state = algorithm.select(state, draws, "try 1", candidates, problem.loss(candidates), mask)
        better = candidates[:, 0] > 0
        np.testing.assert_array_equal(state["improved"], better)
        np.testing.assert_array_equal(state["X"][better], candidates[better])
        assert (state["X"][~better] == 0).all()
        mask = algorithm.move(state, draws, "try 2")[1]
        assert mask.all() if keep_trying else (mask == ~better).all()


# -- how good they are ----------------------------------------------------------------------------------


@cache
def chance(problem, seed):
    return solve(problem, "random-search", budget=1000, seed=seed).loss


@pytest.mark.parametrize("name", ["afsa", "oafsa", "nafsa"])
@pytest.mark.parametrize(
    "problem",
    [
        Sphere([-2.7, 3.1, 0.4, 1.9], lower=-4.0, upper=5.0, offset=-1.0),
        Function(rosenbrock, [-4.0] * 4, [5.0] * 4),
    ],
)
def test_better_than_random_search_at_equal_cost(name, problem):
    fish = [solve(problem, name, budget=1000, seed=seed).loss for seed in range(20)]
    random = [chance(problem, seed) for seed in range(20)]
    assert stats.mannwhitneyu(fish, random, alternative="less").pvalue < LEVEL


def test_the_published_contraction_converges_prematurely():
    """After twenty cycles nothing moves any more, wherever the swarm is; with the default it goes on."""
    problem = Sphere([-2.7, 3.1, 0.4, 1.9], lower=-4.0, upper=5.0)
    best = {}
    for label, contraction in (("published", (1e-6, 0.999999)), ("default", (0.7, 1.0))):
        algorithm = NovelFishSwarm(contraction=contraction)
        states = list(lockstep(algorithm, problem, range(40), 60))
        best[label] = np.array([s["best_loss"] for s in states])
        spread = np.array([(s["X"].max(axis=-2) - s["X"].min(axis=-2)).max(axis=-1) for s in states])
        if label == "published":
            # it stands still without having gathered, far from the minimum
            still = np.abs(states[-1]["X"] - states[29]["X"]).max(axis=(-2, -1))
            assert np.median(still) < 1e-6
            assert np.median(spread[-1]) > 0.1
    gain = {label: np.median(loss[24] / loss[59]) for label, loss in best.items()}
    assert gain["published"] < 1.001
    assert gain["default"] > 1e3
    assert np.median(best["default"][-1]) < 1e-3 * np.median(best["published"][-1])


@every_swarm
def test_a_world_without_any_finite_loss_is_survived(swarm):
    nothing = Function(lambda X: np.full(len(X), np.inf), [0.0, 0.0], [1.0, 1.0])
    answer = solve(nothing, swarm(pop_size=5), budget=300)
    assert answer.status == "invalid"
    assert answer.counts.loss == 300


# -- settings -------------------------------------------------------------------------------------------


def test_published_settings():
    assert FishSwarm.published().settings["pop_size"] == 50
    optimal = OptimalFishSwarm.published().settings
    assert (optimal["pop_size"], optimal["horizon"], optimal["recursive"]) == (50, 60, True)
    novel = NovelFishSwarm.published(
        visual=PUBLISHED_VISUAL["scale_factors_bit_h_per_deg"], units="problem"
    ).settings
    assert novel == {
        "pop_size": 50,
        "visual": (5.0, 2.0, 0.1),
        "try_number": 3,
        "contraction": (1e-6, 0.999999),
        "contraction_per": "cycle",
        "visual_reading": "literal",
        "keep_trying": True,
        "random_move": True,
        "group": True,
        "centre_replaces_best": True,
        "units": "problem",
        "initial": "nominal",
        "update": "synchronous",
    }
    assert FishSwarm(step=0.2).settings["step"] == 0.2
    assert OptimalFishSwarm(step=[0.2, 0.1]).settings["step"] == (0.2, 0.1)


@pytest.mark.parametrize(
    ("swarm", "settings"),
    [
        *((swarm, settings) for swarm in SWARMS for settings in (
            {"pop_size": 1},
            {"visual": 0.0},
            {"visual": -0.1},
            {"visual": (0.1, 0.0)},
            {"visual": np.inf},
            {"visual": "wide"},
            {"visual": ()},
            {"try_number": 0},
            {"units": "metres"},
            {"initial": "best"},
            {"update": "parallel"},
        )),
        (FishSwarm, {"step": 0}),
        (FishSwarm, {"crowding": 0.0}),
        (FishSwarm, {"crowding": 1.1}),
        (FishSwarm, {"horizon": 60}),
        (FishSwarm, {"contraction": (0.5, 1.0)}),
        (OptimalFishSwarm, {"horizon": 0}),
        (OptimalFishSwarm, {"floor": -1e-3}),
        (OptimalFishSwarm, {"shrink": 0.0}),
        (OptimalFishSwarm, {"shrink": 2.0}),
        (OptimalFishSwarm, {"rises": 0}),
        (OptimalFishSwarm, {"patience": 0}),
        (NovelFishSwarm, {"step": 0.1}),
        (NovelFishSwarm, {"crowding": 0.5}),
        (NovelFishSwarm, {"horizon": 60}),
        (NovelFishSwarm, {"contraction": (0.0, 1.0)}),
        (NovelFishSwarm, {"contraction": (0.9, 0.8)}),
        (NovelFishSwarm, {"contraction": (0.9, 1.1)}),
        (NovelFishSwarm, {"contraction": 0.9}),
        (NovelFishSwarm, {"contraction_per": "fish"}),
        (NovelFishSwarm, {"visual_reading": "shuffled"}),
    ],
)  # fmt: skip
def test_unusable_settings_are_refused(swarm, settings):
    with pytest.raises((InvalidInput, UnknownName)) as error:
        swarm(**settings)
    assert next(iter(settings)) in str(error.value)


@every_swarm
def test_a_vector_of_another_length_than_the_problem_is_refused(swarm):
    with pytest.raises(InvalidInput, match=r"visual.*3: one for each parameter"):
        solve(WAVY, swarm(visual=(0.1, 0.2)), budget=50)
    if swarm is not NovelFishSwarm:
        with pytest.raises(InvalidInput, match=r"step.*3: one for each parameter"):
            solve(WAVY, swarm(step=(0.1, 0.2)), budget=50)


@every_swarm
def test_a_problem_without_nominal_values_cannot_be_started_there(swarm):
    bare = ElementwiseProblem(n_var=2, n_obj=1, xl=0.0, xu=1.0)
    with pytest.raises(UnsuitableProblem, match='use initial="box"'):
        swarm(initial="nominal").setup(bare, seed=1).ask()
