"""`BeeColony` against pygmo's, which nobody here wrote, and what the two do differently."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest
import scipy.stats

import navopt
from comparisons import independent_bee_colony as independent
from comparisons.independent_bee_colony import VARIANTS, KeepingBeeColony, Runs, compare, functions, ours
from navopt.algorithms.bee_colony import BeeColony
from navopt.errors import MissingExtra
from navopt.problems import Sphere

needs_pygmo = pytest.mark.skipif(
    importlib.util.find_spec("pygmo") is None, reason="pygmo, of the extra 'bench', is not installed"
)


@pytest.mark.parametrize("update", ["synchronous", "sequential"])
@pytest.mark.parametrize("kind", [BeeColony, KeepingBeeColony])
def test_lockstep_is_the_single_run_bit_for_bit(kind: type[BeeColony], update: str) -> None:
    # a small limit, so that there are scouts, and a budget that cuts a batch
    algorithm = kind(pop_size=6, limit=4, update=update)
    wood = functions()["Wood"]
    runs = ours(algorithm, wood, range(2), 303)
    for seed in range(2):
        alone = navopt.solve(wood, algorithm, budget=303, seed=seed)
        assert runs.errors[seed] == alone.loss - wood.minimum
    easy = Sphere([0.3, -0.2], lower=-1.0, upper=1.0)
    runs = ours(algorithm, easy, range(2), 250)
    assert np.isfinite(runs.reached).all()
    for seed in range(2):
        trace = navopt.solve(easy, algorithm, budget=250, seed=seed).trace
        assert runs.reached[seed] == trace["cost"][np.argmax(trace["loss"] <= independent.TARGET)]


@needs_pygmo
def test_functions_are_pygmos_own_shifted() -> None:
    import pygmo

    rng = np.random.default_rng(1)
    builtin = {"Ackley": pygmo.ackley(10), "Griewank": pygmo.griewank(10), "Rosenbrock": pygmo.rosenbrock(10)}
    for name, other in builtin.items():
        shifted = functions()[name]
        X = rng.uniform(shifted.xl, shifted.xu, (50, 10))
        expected = [pygmo.problem(other).fitness(x - shifted.shift)[0] for x in X]
        assert shifted.loss(X) == pytest.approx(expected, rel=1e-12, abs=1e-12)
        assert (np.abs(shifted.shift) > 0.05 * (shifted.xu - shifted.xl)).all()


class Scripted:
    """Two coordinates; every trial fails until a scout came, whose place scores 50 and later trials 20."""

    def __init__(self) -> None:
        self.known: list[np.ndarray] = []
        self.kinds: list[str] = []

    def __deepcopy__(self, memo: dict) -> Scripted:
        return self

    def fitness(self, x: np.ndarray) -> list[float]:
        if len(self.known) < 2:
            self.known.append(np.array(x))
            return [10.0]
        # a trial keeps one coordinate of a source, a scout none
        new = all((x != one).all() for one in self.known)
        self.kinds.append("scout" if new else "trial")
        if new:
            self.known.append(np.array(x))
            return [50.0]
        return [20.0 if "scout" in self.kinds else 100.0]

    def get_bounds(self) -> tuple[list[float], list[float]]:
        return [-1.0, -1.0], [1.0, 1.0]


@needs_pygmo
def test_pygmo_goes_on_comparing_with_the_abandoned_source() -> None:
    import pygmo

    for seed in range(5):
        script = Scripted()
        population = pygmo.population(pygmo.problem(script), 2, seed=seed)
        population = pygmo.algorithm(pygmo.bee_colony(gen=12, limit=3, seed=seed)).evolve(population)
        first = script.kinds.index("scout")
        assert "trial" in script.kinds[first:]
        # those trials score 20: better than the 50 of the new sources, worse than the old 10; none is taken
        assert 20.0 not in population.get_f()
        assert 50.0 in population.get_f()
        # a cycle costs two evaluations per source, a scout included
        assert len(script.kinds) == 12 * 4


def test_ours_compares_with_the_new_source() -> None:
    for kind, kept in ((BeeColony, False), (KeepingBeeColony, True)):
        algorithm = kind(pop_size=2, limit=3)
        X, F = np.array([[0.1, 0.2], [0.3, 0.4]]), np.array([10.0, 10.0])
        state = algorithm.found({"lower": np.zeros(2), "upper": np.ones(2)}, X, F)
        state = {**state, "trials": np.array([9, 0])}
        new, mask = np.full((2, 2), 0.7), np.array([True, False])
        after = algorithm.select(state, {}, "scout", new, np.array([50.0, np.inf]), mask)
        assert after["X"].tolist() == [[0.7, 0.7], [0.3, 0.4]]
        assert after["F"].tolist() == [10.0 if kept else 50.0, 10.0]
        assert after["trials"].tolist() == [0, 0]


@needs_pygmo
def test_pygmos_evaluations_are_counted_within_the_budget() -> None:
    problem = functions()["Wood"]
    small, large = (independent.pygmo_runs(problem, range(3), budget) for budget in (300, 900))
    assert (large.errors < small.errors).any()
    assert (large.errors <= small.errors).all()
    assert small.budget == 300
    again = independent.pygmo_runs(problem, range(3), 300)
    assert (again.errors == small.errors).all()
    easy = Sphere([0.3, -0.2], lower=-1.0, upper=1.0)
    reached = independent.pygmo_runs(easy, range(5), 400).reached
    assert (reached <= 400).all()
    assert (reached >= 1).all()


def test_without_pygmo_the_message_says_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pygmo", None)
    with pytest.raises(MissingExtra, match=r"pip install 'navopt\[bench\]'"):
        independent.pygmo_runs(functions()["Wood"], [0], 100)


def drawn(rng: np.random.Generator, location: float, share: float, n: int = 60) -> Runs:
    reached = np.where(rng.random(n) < share, rng.integers(100, 1000, n).astype(float), np.inf)
    return Runs(10.0 ** rng.normal(location, 1.0, n), reached, 1000)


def test_the_comparison_tells_samples_apart_and_leaves_equal_ones_alone() -> None:
    rng = np.random.default_rng(11)
    mine = {name: drawn(rng, -4.0, 0.6) for name in "abcd"}
    theirs = {
        "a": drawn(rng, -4.0, 0.6),
        "b": drawn(rng, -2.5, 0.6),
        "c": drawn(rng, -4.0, 0.05),
        "d": mine["d"],
    }
    table = compare(mine, theirs).set_index("function")
    assert (table["error_holm"] < 0.01).to_dict() == {"a": False, "b": True, "c": False, "d": False}
    assert (table["evaluations_holm"] < 0.01).to_dict() == {"a": False, "b": False, "c": True, "d": False}
    assert table.loc["b", "a12"] > 0.7
    assert table.loc["d", ["a12", "ks", "mann_whitney", "log_rank"]].tolist() == [0.5, 1.0, 1.0, 1.0]


def test_log_rank_without_censoring_is_the_textbook_statistic() -> None:
    # Mantel's statistic, summed over the times by hand
    rng = np.random.default_rng(2)
    times = [rng.permutation(200)[:30] + 1.0 for _ in range(2)]
    first, second = (Runs(np.ones(30), t, 1000) for t in times)
    observed = expected = variance = 0.0
    for t in np.unique(np.concatenate(times)):
        at_risk = [int((sample >= t).sum()) for sample in times]
        died = [int((sample == t).sum()) for sample in times]
        n, d = sum(at_risk), sum(died)
        observed, expected = observed + died[0], expected + d * at_risk[0] / n
        if n > 1:
            variance += d * (at_risk[0] / n) * (at_risk[1] / n) * (n - d) / (n - 1)
    p = 2.0 * scipy.stats.norm.sf(abs(observed - expected) / np.sqrt(variance))
    assert independent._log_rank(first, second) == pytest.approx(p, rel=1e-6)
    nobody = Runs(np.ones(30), np.full(30, np.inf), 1000)
    assert independent._log_rank(nobody, nobody) == 1.0


@needs_pygmo
def test_sequential_colonies_agree_before_the_first_scout() -> None:
    # 1000 evaluations are 25 cycles and 50 trials for each source: none is abandoned yet
    problems = functions()
    mine = {name: ours(VARIANTS["sequential"](), p, range(24), 1000) for name, p in problems.items()}
    theirs = {name: independent.pygmo_runs(p, range(24), 1000) for name, p in problems.items()}
    table = compare(mine, theirs)
    # two families of tests, Holm within each
    assert (table["error_holm"] > 0.0005).all()
    assert (table["evaluations_holm"] > 0.0005).all()
    # and the comparison has teeth: a colony that changes all dimensions is another algorithm
    other = {
        name: ours(BeeColony(pop_size=20, limit=100, dimensions="all"), p, range(24), 1000)
        for name, p in problems.items()
    }
    assert (compare(other, theirs)["error_holm"] < 0.0005).any()


@pytest.mark.slow
@needs_pygmo
def test_sequential_colonies_agree_in_full() -> None:
    problems, seeds = functions(), range(independent.SEEDS)
    theirs = {name: independent.pygmo_runs(p, seeds) for name, p in problems.items()}
    for label in ("sequential", "sequential, at the limit, old loss"):
        mine = {name: ours(VARIANTS[label](), p, seeds) for name, p in problems.items()}
        table = compare(mine, theirs)
        assert (table["error_holm"] >= independent.SIGNIFICANCE).all(), (label, table)
        assert (table["evaluations_holm"] >= independent.SIGNIFICANCE).all(), (label, table)


@needs_pygmo
def test_the_command_prints_a_table_for_each_variant(capsys) -> None:
    independent.main(["--runs", "3", "--budget", "300", "--variants", "synchronous", "sequential"])
    text = capsys.readouterr().out
    for label in ("synchronous", "sequential"):
        assert f"BeeColony, {label}: 3 runs of 300 evaluations" in text
    assert text.count("Wood") == 2
    assert text.count("agrees") + text.count("differs") == 8
