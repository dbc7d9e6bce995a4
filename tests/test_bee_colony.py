"""Bee colony against closed forms, a plain loop of Karaboga's description, and random search."""

import numpy as np
import pytest
from scipy import stats

from navopt import EstimationProblem, Parameter, solve
from navopt.algorithms.bee_colony import BeeColony
from navopt.errors import InvalidInput, UnknownName
from navopt.problems.analytic import Sphere
from navopt.problems.analytic_base import Point

#: Statistical checks in this file; each gets its share of a false alarm in a thousand.
CHECKS = 5
LEVEL = 0.001 / CHECKS


class Function(EstimationProblem):
    """A loss given as a vectorised function of rows."""

    def __init__(self, function, lower, upper):
        super().__init__(
            [Parameter(f"x{k}", "1", a, b, a) for k, (a, b) in enumerate(zip(lower, upper, strict=True))]
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


def make_state(X, F, *, lower=-1e6, upper=1e6, trials=0, lead=()):
    """State of a colony whose sources are at X, the same in every run of the leading axis."""
    X, F = np.broadcast_to(X, (*lead, *X.shape)).copy(), np.broadcast_to(F, (*lead, *F.shape)).astype(float)
    d = X.shape[-1]
    box = {"lower": np.full(d, float(lower)), "upper": np.full(d, float(upper))}
    state = BeeColony(pop_size=X.shape[-2]).found(box, X, F)
    return {**state, "trials": np.broadcast_to(trials, F.shape).astype(np.int64)}


def stacked_draws(algorithm, seed, lead, n, d):
    rng = np.random.default_rng(seed)
    blocks = [algorithm.draw(rng, n, d) for _ in range(lead)]
    return {key: np.stack([block[key] for block in blocks]) for key in blocks[0]}


# -- a trial -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("phase", ["employed", "onlooker"])
def test_a_trial_changes_exactly_one_dimension_and_every_dimension_equally_often(phase):
    algorithm, n, d, lead = BeeColony(pop_size=7), 7, 6, 1500
    X = np.random.default_rng(1).normal(size=(n, d))
    state = make_state(X, np.zeros(n), lead=(lead,))
    draws = stacked_draws(algorithm, 2, lead, n, d)
    candidates, mask = algorithm.move(state, draws, phase)
    assert mask.all()
    # the source a bee started from is the one it shares all coordinates but one with
    same = candidates[:, :, None, :] == X
    shared = same.sum(axis=-1)
    assert (shared.max(axis=-1) == d - 1).all()
    source = shared.argmax(axis=-1)
    if phase == "employed":
        assert (source == np.arange(n)).all()
    changed = np.argmin(np.take_along_axis(same, source[..., None, None], axis=2)[:, :, 0], axis=-1)
    assert stats.chisquare(np.bincount(changed.ravel(), minlength=d)).pvalue > LEVEL


def test_all_dimensions_change_only_when_asked():
    algorithm, n, d = BeeColony(pop_size=5, dimensions="all"), 5, 4
    X = np.random.default_rng(1).normal(size=(n, d))
    draws = algorithm.draw(np.random.default_rng(2), n, d)
    candidates, _ = algorithm.move(make_state(X, np.zeros(n)), draws, "employed")
    assert (candidates != X).all()


def test_the_step_is_uniform_and_scaled_by_the_distance_to_the_partner():
    algorithm, n, d, lead = BeeColony(pop_size=2, dimensions="all"), 2, 3, 2000
    # of two sources each is the other's partner, so the factor follows from the candidate
    X = np.array([[0.0, 1.0, 2.0], [4.0, -2.0, 7.0]])
    state = make_state(X, np.zeros(n), lead=(lead,))
    candidates, _ = algorithm.move(state, stacked_draws(algorithm, 3, lead, n, d), "employed")
    phi = (candidates - X) / (X - X[::-1])
    assert phi.min() >= -1.0
    assert phi.max() < 1.0
    assert stats.kstest(phi.ravel(), stats.uniform(-1, 2).cdf).pvalue > LEVEL


@pytest.mark.parametrize("phase", ["employed", "onlooker"])
def test_the_partner_is_never_the_source_and_uniform_over_the_others(phase):
    algorithm, n, lead = BeeColony(pop_size=6), 6, 3000
    X = np.random.default_rng(1).normal(size=(n, 1))  # the difference of two of them names both
    state = make_state(X, np.zeros(n), lead=(lead,))
    draws = stacked_draws(algorithm, 4, lead, n, 1)
    draws["employed"][..., 2:] = draws["onlooker"][..., 2:] = 0.75  # a factor of one half
    candidates, _ = algorithm.move(state, draws, phase)
    pairs = np.array([[a + 0.5 * (a - b) for b in X[:, 0]] for a in X[:, 0]])
    counts = np.array([[np.sum(candidates == value) for value in row] for row in pairs])
    assert counts.sum() == lead * n
    assert (np.diag(counts) == 0).all()
    off_diagonal = counts[~np.eye(n, dtype=bool)].reshape(n, n - 1)
    expected = np.repeat(off_diagonal.sum(axis=1, keepdims=True) / (n - 1), n - 1, axis=1)
    statistic = np.sum((off_diagonal - expected) ** 2 / expected)
    assert stats.chi2(n * (n - 2)).sf(statistic) > LEVEL


def test_candidates_are_clipped_to_the_box():
    algorithm, n, d = BeeColony(pop_size=4), 4, 2
    X = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    state = make_state(X, np.zeros(n), lower=0.0, upper=1.0, lead=(200,))
    candidates, _ = algorithm.move(state, stacked_draws(algorithm, 5, 200, n, d), "employed")
    assert candidates.min() == 0.0
    assert candidates.max() == 1.0


# -- onlookers -----------------------------------------------------------------------------------------


def choices(F, *, selection="roulette", lead=3000, seed=6):
    """Sources that onlookers chose: with a factor of zero the candidate is the source."""
    n = len(F)
    algorithm = BeeColony(pop_size=n, selection=selection)
    state = make_state(np.arange(float(n))[:, None], np.asarray(F, dtype=float), lead=(lead,))
    draws = stacked_draws(algorithm, seed, lead, n, 1)
    draws["onlooker"][..., 2:] = 0.5
    return algorithm.move(state, draws, "onlooker")[0].astype(int).ravel()


@pytest.mark.parametrize("selection", ["roulette", "relative"])
def test_onlookers_choose_with_the_closed_form_probabilities(selection):
    F = np.array([0.0, 0.5, 3.0, -2.0, 9.0, 40.0, -0.25])
    fitness = np.array([1.0, 1 / 1.5, 1 / 4, 3.0, 1 / 10, 1 / 41, 1.25])
    weights = fitness if selection == "roulette" else 0.9 * fitness / 3.0 + 0.1
    chosen = choices(F, selection=selection)
    expected = len(chosen) * weights / weights.sum()
    assert stats.chisquare(np.bincount(chosen, minlength=7), expected).pvalue > LEVEL


def test_a_source_of_infinite_loss_is_never_chosen_unless_all_are():
    assert set(choices([np.inf, 1.0, np.inf, 2.0, np.inf], lead=300)) == {1, 3}
    everybody = np.bincount(choices([np.inf] * 5), minlength=5)
    assert stats.chisquare(everybody).pvalue > LEVEL


def test_ends_of_the_roulette():
    algorithm = BeeColony(pop_size=4)
    state = make_state(np.arange(4.0)[:, None], np.array([np.inf, 0.0, 1.0, np.inf]))
    draws = algorithm.draw(np.random.default_rng(1), 4, 1)
    draws["onlooker"][:, 2:] = 0.5
    draws["spin"] = np.array([0.0, np.nextafter(2 / 3, 0), 2 / 3, np.nextafter(1.0, 0)])
    np.testing.assert_array_equal(algorithm.move(state, draws, "onlooker")[0][:, 0], [1, 1, 2, 2])


def test_a_failure_counts_for_the_source_the_onlooker_chose():
    algorithm, n = BeeColony(pop_size=5), 5
    X = np.arange(5.0)[:, None]
    F = np.array([np.inf, np.inf, np.inf, 0.0, 1.0])
    state = make_state(X, F, trials=[7, 7, 7, 7, 7])
    draws = algorithm.draw(np.random.default_rng(1), n, 1)
    draws["spin"] = np.array([0.1, 0.1, 0.1, 0.9, 0.1])  # four visits to source 3, one to source 4
    candidates, mask = algorithm.move(state, draws, "onlooker")
    after = algorithm.select(state, draws, "onlooker", candidates, np.full(n, 50.0), mask)
    np.testing.assert_array_equal(after["trials"], [7, 7, 7, 11, 8])
    np.testing.assert_array_equal(after["X"], X)
    np.testing.assert_array_equal(after["F"], F)
    # the second and fifth bee of source 3 succeed: the better one replaces it and clears its counter only
    losses = np.array([50.0, -1.0, 50.0, 1.0, -3.0])
    after = algorithm.select(state, draws, "onlooker", candidates, losses, mask)
    np.testing.assert_array_equal(after["trials"], [7, 7, 7, 0, 8])
    np.testing.assert_array_equal(after["F"], [np.inf, np.inf, np.inf, -3.0, 1.0])
    assert after["X"][3] == candidates[4]
    np.testing.assert_array_equal(np.delete(after["X"], 3, axis=0), np.delete(X, 3, axis=0))
    np.testing.assert_array_equal(state["trials"], 7)  # what came in was not written to


def test_an_equal_loss_is_not_an_improvement():
    algorithm, n = BeeColony(pop_size=3), 3
    state = make_state(np.arange(3.0)[:, None], np.ones(3))
    draws = algorithm.draw(np.random.default_rng(1), n, 1)
    candidates, mask = algorithm.move(state, draws, "employed")
    after = algorithm.select(state, draws, "employed", candidates, np.ones(3), mask)
    np.testing.assert_array_equal(after["X"], state["X"])
    np.testing.assert_array_equal(after["trials"], 1)


# -- scouts --------------------------------------------------------------------------------------------


def test_at_most_one_scout_and_only_beyond_the_limit():
    algorithm = BeeColony(pop_size=5, limit=4)
    X = np.random.default_rng(1).random((5, 2))
    draws = algorithm.draw(np.random.default_rng(2), 5, 2)
    for trials, expected in (([4, 4, 4, 4, 4], []), ([5, 9, 9, 0, 6], [1]), ([0, 0, 0, 0, 5], [4])):
        state = make_state(X, np.arange(5.0), lower=-3.0, upper=2.0, trials=trials)
        candidates, mask = algorithm.move(state, draws, "scout")
        assert np.flatnonzero(mask).tolist() == expected
        np.testing.assert_array_equal(candidates, -3.0 + draws["scout"] * 5.0)
        after = algorithm.select(state, draws, "scout", candidates, np.full(5, 77.0), mask)
        np.testing.assert_array_equal(after["trials"], np.where(mask, 0, trials))
        np.testing.assert_array_equal(after["X"], np.where(mask[:, None], candidates, X))
        np.testing.assert_array_equal(after["F"], np.where(mask, 77.0, np.arange(5.0)))


def test_all_scouts_fly_but_the_best_source_stays():
    algorithm = BeeColony(pop_size=5, limit=4, scouts="all")
    state = make_state(np.zeros((5, 2)), np.array([3.0, 1.0, 2.0, 9.0, 9.0]), trials=[5, 8, 4, 5, 9])
    mask = algorithm.move(state, algorithm.draw(np.random.default_rng(2), 5, 2), "scout")[1]
    np.testing.assert_array_equal(mask, [True, False, False, True, True])


def test_the_default_limit_is_sources_times_dimensions():
    algorithm = BeeColony(pop_size=3)
    draws = algorithm.draw(np.random.default_rng(2), 3, 4)
    for trials, flies in ((12, False), (13, True)):
        state = make_state(np.zeros((3, 4)), np.arange(3.0), trials=[0, trials, 0])
        assert algorithm.move(state, draws, "scout")[1].any() == flies


# -- whole runs ----------------------------------------------------------------------------------------


def phase_of(algorithm):
    if not algorithm.state:
        return "initial"
    if algorithm.update == "synchronous":
        return algorithm.phases[algorithm.stage]
    return algorithm.phases[algorithm.stage // algorithm.pop_size]


def drive(algorithm, problem, seed, cycles):
    """Ask and tell; returns (phase, candidates, losses) of every batch of whole cycles."""
    algorithm.setup(problem, seed=seed)
    batches = []
    while True:
        pop = algorithm.ask()
        if algorithm.cycle == cycles:
            return batches
        phase = phase_of(algorithm)
        algorithm.evaluator.eval(problem, pop)
        batches.append((phase, pop.get("X").copy(), pop.get("F")[:, 0].copy()))
        algorithm.tell(infills=pop)


@pytest.mark.parametrize("update", ["synchronous", "sequential"])
def test_a_cycle_costs_two_evaluations_per_source_and_one_per_scout(update):
    algorithm = BeeColony(pop_size=6, limit=3, update=update)
    problem = Sphere([1.0, -2.0, 0.5])
    batches = drive(algorithm, problem, 3, 40)
    cost = {
        phase: sum(len(X) for p, X, _ in batches if p == phase)
        for phase in ("initial", "employed", "onlooker", "scout")
    }
    assert cost["initial"] == 6
    assert cost["employed"] == cost["onlooker"] == 6 * 40
    assert 5 < cost["scout"] <= 40
    assert max(len(X) for p, X, _ in batches if p == "scout") == 1
    # a scout costs its own evaluation: the trials of the next cycle are not fewer for it
    assert algorithm.evaluator.n_eval == sum(cost.values())


@pytest.mark.parametrize("scouts", ["one", "all"])
def test_the_best_is_never_lost(scouts):
    algorithm = BeeColony(pop_size=4, limit=1, scouts=scouts)
    problem = Function(rastrigin, [-4.0] * 3, [5.0] * 3)
    algorithm.setup(problem, seed=1)
    seen = np.inf
    abandoned = False
    for _ in range(300):
        pop = algorithm.ask()
        algorithm.evaluator.eval(problem, pop)
        seen = min(seen, pop.get("F").min())
        algorithm.tell(infills=pop)
        assert algorithm.opt[0].F[0] == seen
        abandoned |= algorithm.state["F"].min() > seen
        if scouts == "all":
            assert algorithm.state["F"].min() == seen
    assert algorithm.evaluator.best_loss == seen
    assert abandoned == (scouts == "one")  # the memory was needed where the best source is not protected


@pytest.mark.parametrize("scouts", ["one", "all"])
@pytest.mark.parametrize("selection", ["roulette", "relative"])
def test_many_runs_in_lockstep_equal_single_runs_bit_for_bit(scouts, selection):
    settings = {"pop_size": 6, "limit": 3, "scouts": scouts, "selection": selection}
    problem = Function(rosenbrock, [-2.0, -2.0, -1.0, -2.0], [2.0, 3.0, 2.0, 2.0])
    seeds, cycles, n, d = range(50), 8, 6, 4
    singles = []
    for seed in seeds:
        single = BeeColony(**settings)
        drive(single, problem, seed, cycles)
        singles.append(single)
    together = BeeColony(**settings)
    generators = [np.random.default_rng(seed) for seed in seeds]

    def stack(blocks):
        return {key: np.stack([block[key] for block in blocks]) for key in blocks[0]}

    constants = together.constants(problem)
    X = together.initialize(constants, stack([together.draw_initial(g, n, d) for g in generators]))
    state = together.found(constants, X, problem.loss(X))
    scouted = 0
    for _ in range(cycles):
        draws = stack([together.draw(g, n, d) for g in generators])
        for phase in together.phases:
            candidates, mask = together.move(state, draws, phase)
            losses = np.where(mask, problem.loss(candidates), np.inf)
            state = together.select(state, draws, phase, candidates, losses, mask)
            scouted += mask.sum() if phase == "scout" else 0
    assert scouted > 50
    for k, single in enumerate(singles):
        for key in ("X", "F", "trials"):
            np.testing.assert_array_equal(state[key][k], single.state[key])


def karaboga(function, lower, upper, n, limit, cycles, seed):
    """Artificial bee colony in plain loops, as described by Karaboga and Basturk (2007).

    Per cycle: every employed bee tries; *then* the probabilities of the onlookers are calculated; every
    onlooker picks a source by roulette and tries; one exhausted source is abandoned. Random numbers are
    consumed in the order of that description, all those of a cycle in one block.
    """
    rng = np.random.default_rng(seed)
    d = len(lower)
    X = [lower + rng.random(d) * (upper - lower) for _ in range(n)]
    F = [function(x) for x in X]
    trials = [0] * n
    evaluated = [(x.copy(), f) for x, f in zip(X, F, strict=True)]

    def attempt(i, numbers):
        k = int(numbers[0] * (n - 1))
        if k >= i:
            k += 1
        j = int(numbers[1] * d)
        v = X[i].copy()
        v[j] = X[i][j] + (2.0 * numbers[2 + j] - 1.0) * (X[i][j] - X[k][j])
        v[j] = min(max(v[j], lower[j]), upper[j])
        f = function(v)
        evaluated.append((v, f))
        if f < F[i]:
            X[i], F[i], trials[i] = v, f, 0
        else:
            trials[i] += 1

    for _ in range(cycles):
        employed = rng.random((n, d + 2))
        onlooker = rng.random((n, d + 2))
        spin = rng.random(n)
        scout = rng.random((n, d))
        for i in range(n):
            attempt(i, employed[i])
        fitness = [1.0 / (1.0 + f) if f >= 0 else 1.0 + abs(f) for f in F]
        total = 0.0
        for value in fitness:
            total += value
        for t in range(n):
            reached, i = fitness[0], 0
            while reached <= spin[t] * total:
                i += 1
                reached += fitness[i]
            attempt(i, onlooker[t])
        worst = trials.index(max(trials))
        if trials[worst] > limit:
            X[worst] = lower + scout[worst] * (upper - lower)
            F[worst] = function(X[worst])
            trials[worst] = 0
            evaluated.append((X[worst].copy(), F[worst]))
    return evaluated, trials


@pytest.mark.parametrize("offset", [0.0, -30.0])
def test_sequential_update_is_the_published_loop(offset):
    lower, upper = np.array([-2.0, -1.0, -3.0]), np.array([2.0, 3.0, 1.0])
    problem = Function(lambda X: rastrigin(X) + offset, lower, upper)
    algorithm = BeeColony(pop_size=6, limit=4, update="sequential")
    batches = drive(algorithm, problem, 11, 60)
    expected, trials = karaboga(lambda x: float(problem.loss(x)), lower, upper, 6, 4, 60, 11)
    assert len(expected) > 6 + 12 * 60 + 10  # scouts flew
    X = np.concatenate([batch[1] for batch in batches])
    F = np.concatenate([batch[2] for batch in batches])
    assert len(X) == len(expected)
    wanted = np.array([x for x, _ in expected])
    different = np.flatnonzero((wanted != X).any(axis=1))
    assert different.size == 0, f"first different candidate: evaluation {different[0]} of {len(X)}"
    np.testing.assert_array_equal(F, [f for _, f in expected])
    np.testing.assert_array_equal(algorithm.state["trials"], trials)


@pytest.mark.parametrize("update", ["synchronous", "sequential"])
def test_the_cycle_counts_completed_cycles_as_soon_as_they_are_complete(update):
    """With a limit that is never reached a cycle is exactly two evaluations per source."""
    algorithm = BeeColony(pop_size=5, limit=10**6, update=update)
    algorithm.setup(Sphere([1.0, 2.0]), seed=1)
    batch = 5 if update == "synchronous" else 1
    algorithm.next()
    for done in range(batch, 10 * 7 + 1, batch):
        algorithm.next()
        assert algorithm.evaluator.n_eval == 5 + done
        assert algorithm.cycle == done // 10


def test_published_settings():
    assert BeeColony.published().settings == {
        "pop_size": 10,
        "limit": 20,
        "dimensions": "one",
        "selection": "roulette",
        "scouts": "all",
        "update": BeeColony.published().update,
    }
    assert BeeColony.published(limit=5).limit == 5


def test_a_world_without_any_finite_loss_is_survived():
    problem = Function(lambda X: np.full(len(X), np.inf), [0.0, 0.0], [1.0, 1.0])
    answer = solve(problem, BeeColony(pop_size=5, limit=2), budget=300)
    assert answer.status == "invalid"
    assert answer.counts.loss == 300


@pytest.mark.parametrize(("function", "n_var"), [(rastrigin, 5), (rosenbrock, 4)])
def test_better_than_random_search_on_known_functions(function, n_var):
    problem = Function(function, [-4.0] * n_var, [5.0] * n_var)
    wins = 0
    for seed in range(20):
        colony = solve(problem, "abc", budget=1500, seed=seed).loss
        wins += colony < solve(problem, "random-search", budget=1500, seed=seed).loss
    # twenty of twenty by chance: one in a million; sixteen already one in 170
    assert wins >= 19


@pytest.mark.parametrize(
    "settings",
    [
        {"pop_size": 1},
        {"pop_size": 2.5},
        {"limit": 0},
        {"dimensions": "two"},
        {"scouts": "none"},
        {"selection": "rank"},
    ],
)
def test_unusable_settings_are_refused(settings):
    with pytest.raises((InvalidInput, UnknownName)) as error:
        BeeColony(**settings)
    assert next(iter(settings)) in str(error.value)


def test_unknown_keywords_are_refused():
    with pytest.raises(UnknownName, match="limits"):
        BeeColony(limits=3)
