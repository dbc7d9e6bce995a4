"""Shifted, rotated, scaled and noisy problems: the same world seen through other decision vectors.

Statistical tests have fixed seeds and share a false-alarm rate of 0.001 over their family.
"""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import navopt
from navopt.errors import InvalidInput, NoTruth, UnsuitableProblem
from navopt.problem import EstimationProblem, Parameter
from navopt.problems import (
    Ackley,
    Griewank,
    HelicalValley,
    Noisy,
    Point,
    Rastrigin,
    Rosenbrock,
    Rotated,
    Scaled,
    Shifted,
    Sphere,
    TestTubeHolder,
    Wood,
    Zettl,
)
from navopt.problems.noisy import hashed_normal
from navopt.problems.wrappers import haar_orthogonal

PLAIN = (
    Ackley(3),
    Griewank(),
    Rosenbrock(5),
    Rastrigin(4),
    Zettl(),
    TestTubeHolder(),
    HelicalValley(),
    Wood(),
)
#: p-values below this fail; the family has fewer than 25 tests.
ALARM = 0.001 / 25
examples = settings(max_examples=60, deadline=None, derandomize=True)
problems = st.sampled_from(PLAIN)
seeds = st.integers(0, 2**32 - 1)


def points(problem: EstimationProblem, n: int = 50, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(problem.xl, problem.xu, (n, problem.n_var))


class Measured(Sphere):
    """A sphere with a prior, in a box of unequal widths."""

    def __init__(self) -> None:
        super().__init__([1.0, -2.0, 30.0], lower=[-5.0, -4.0, 0.0], upper=[5.0, 4.0, 100.0])

    provides = frozenset({"residuals", "bound", "prior"})

    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.5, -1.0, 20.0]), np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.2], [0.0, 0.2, 50.0]])


class Recorded(EstimationProblem):
    """A problem whose minimum nobody knows."""

    def __init__(self) -> None:
        super().__init__([Parameter("x", "m", 0.0, 1.0, 0.5), Parameter("y", "s", -1.0, 1.0, 0.5)])

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return np.where(X[:, 0] > 0.9, np.inf, X[:, 0] * X[:, 1])

    def invalid_reasons(self, X: np.ndarray) -> list[str]:
        return [f"x is {x:.1f}" for x in X[:, 0]]

    def estimate(self, x: np.ndarray) -> Point:
        return Point(np.asarray(x, dtype=float))

    def project(self, estimate: Point) -> np.ndarray:
        return self.clip(estimate.position)


def wrapped_in_everything(problem: EstimationProblem, seed: int = 0) -> list[EstimationProblem]:
    factors = 10.0 ** np.random.default_rng(seed).uniform(-3, 3, problem.n_var)
    turned = Rotated.draw(problem, seed)
    return [
        Shifted.draw(problem, seed),
        turned,
        Scaled(problem, factors),
        Noisy(problem, 0.3, seed),
        Noisy(Scaled(Shifted.draw(turned, seed), factors), 0.1, seed),
    ]


# -- the loss ----------------------------------------------------------------------------------------
@examples
@given(problem=problems, seed=seeds)
def test_the_loss_at_a_mapped_point_is_the_inner_loss(problem: EstimationProblem, seed: int) -> None:
    X = points(problem, 20, seed)
    shifted, turned, scaled, noisy, _ = wrapped_in_everything(problem, seed)
    assert (shifted.loss(X) == problem.loss(X - shifted.shift)).all()
    assert (scaled.loss(X * scaled.factors) == problem.loss(X * scaled.factors / scaled.factors)).all()
    for wrapper in (shifted, turned, scaled):
        assert (wrapper.loss(X) == problem.loss(wrapper.inward(X))).all()
        np.testing.assert_allclose(wrapper.outward(wrapper.inward(X)), X, rtol=1e-12, atol=1e-12 * np.ptp(X))
        np.testing.assert_allclose(wrapper.inward(wrapper.outward(X)), X, rtol=1e-12, atol=1e-12 * np.ptp(X))
    assert (noisy.inward(X) == X).all()
    centred = (X - turned.centre) / (problem.xu - problem.xl) @ turned.rotation.T * (problem.xu - problem.xl)
    np.testing.assert_allclose(turned.inward(X), turned.centre + centred, rtol=1e-12, atol=1e-12 * np.ptp(X))


@examples
@given(problem=problems, seed=seeds)
def test_minimum_truth_and_scores_move_together(problem: EstimationProblem, seed: int) -> None:
    for wrapper in wrapped_in_everything(problem, seed):
        assert wrapper.minimum == problem.minimum
        assert (wrapper.xl <= wrapper.true_x).all()
        assert (wrapper.true_x <= wrapper.xu).all()
        spread = 6 * wrapper.sigma if isinstance(wrapper, Noisy) else 1e-8
        assert wrapper.loss(wrapper.true_x) == pytest.approx(problem.minimum, abs=spread)
        found = wrapper.estimate(wrapper.true_x)
        assert wrapper.score(found) == pytest.approx({"distance_1": 0.0, "gap_1": 0.0}, abs=1e-8)
        np.testing.assert_allclose(wrapper.minimizers[0], wrapper.project(problem.truth), rtol=1e-12)
        for x in points(wrapper, 5, seed):
            np.testing.assert_allclose(
                wrapper.project(wrapper.estimate(x)), x, rtol=1e-9, atol=1e-12 * np.ptp(x)
            )
            assert (wrapper.xl <= wrapper.project(wrapper.estimate(x * 3.0))).all()
            scores = wrapper.score(wrapper.estimate(x))
            assert scores["gap_1"] == problem.loss(wrapper.estimate(x).position) - problem.minimum


def test_shifts_and_turns_keep_distances() -> None:
    problem = Rastrigin(4)
    x = np.array([1.0, -2.0, 0.5, 3.0])
    for wrapper in (
        Shifted.draw(problem, 1),
        Rotated.draw(problem, 1),
        Shifted.draw(Rotated.draw(problem, 2), 3),
    ):
        expected = np.linalg.norm(x - wrapper.true_x)
        assert wrapper.score(wrapper.estimate(x))["distance_1"] == pytest.approx(expected)


@pytest.mark.parametrize(
    "problem", [*PLAIN, Ackley(33), Measured()], ids=lambda p: f"{type(p).__name__}{p.n_var}"
)
def test_losses_do_not_depend_on_the_batch(problem: EstimationProblem) -> None:
    for wrapper in wrapped_in_everything(problem, 5):
        X = points(wrapper, 67)
        whole = wrapper.loss(X)
        assert (np.array([wrapper.loss(x) for x in X]) == whole).all()
        assert (wrapper.loss(np.asfortranarray(X)) == whole).all()
        assert (wrapper.loss(X[::-1])[::-1] == whole).all()
        assert (wrapper.loss(X[3:20]) == whole[3:20]).all()
        assert (wrapper.loss(np.vstack([X] * 40))[-67:] == whole).all()


def test_the_outer_wrapper_acts_last() -> None:
    problem, shift = Rosenbrock(), np.array([1.0, -2.0])
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    X = points(problem)
    turned_then_shifted = Shifted(Rotated(problem, turn, centre=[0.0, 0.0]), shift)
    expected = problem.loss((X - shift) @ turn.T)
    np.testing.assert_allclose(turned_then_shifted.loss(X), expected, rtol=1e-12)
    shifted_then_turned = Rotated(Shifted(problem, shift), turn, centre=[0.0, 0.0])
    np.testing.assert_allclose(shifted_then_turned.loss(X), problem.loss(X @ turn.T - shift), rtol=1e-12)
    assert (np.abs(turned_then_shifted.loss(X) - shifted_then_turned.loss(X)) > 1.0).any()
    # about the minimiser, which moves along, the order of the two does not matter
    a, b = Shifted(Rotated(problem, turn), shift), Rotated(Shifted(problem, shift), turn)
    np.testing.assert_allclose(a.loss(X), b.loss(X), rtol=1e-10)


def test_nothing_is_clipped_outside_the_inner_box() -> None:
    problem = Rastrigin()
    assert (
        Shifted(problem, 2.0).loss([-5.0, 0.0]) == problem.loss([-7.0, -2.0]) != problem.loss([-5.12, -2.0])
    )


@pytest.mark.parametrize("name", ["random-search", "abc", "pso", "de"])
def test_scaling_by_powers_of_two_changes_no_bit(name: str) -> None:
    problem = Sphere([1.0, -2.0, 3.0])
    factors = np.array([0.25, 1.0, 1024.0])
    plain, scaled = (navopt.solve(p, name, budget=300, seed=4) for p in (problem, Scaled(problem, factors)))
    assert (plain.x * factors == scaled.x).all()
    assert plain.loss == scaled.loss


# -- where the minimum goes ---------------------------------------------------------------------------
@examples
@given(
    seed=seeds,
    place=st.lists(st.floats(0, 1), min_size=3, max_size=3),
    low=st.floats(0, 0.45),
    span=st.floats(0, 0.45),
)
def test_a_drawn_shift_keeps_its_size_and_the_minimum_in_the_box(
    seed: int, place: list[float], low: float, span: float
) -> None:
    lower, upper = np.array([-7.0, 1e3, -2e-3]), np.array([-2.0, 5e3, 1e-3])
    problem = Sphere(
        np.clip(lower + np.array(place) * (upper - lower), lower, upper), lower=lower, upper=upper
    )
    high = min(low + span, 0.45)
    shifted = Shifted.draw(problem, seed, fraction=(low, high))
    moved = np.abs(shifted.shift) / (upper - lower)
    assert (moved >= low - 1e-12).all()
    assert (moved <= high + 1e-12).all()
    assert (lower < shifted.true_x).all() or low < 0.01
    assert (shifted.true_x < upper).all() or low < 0.01
    assert shifted.true_x == pytest.approx(problem.true_x + shifted.shift)


def test_shifts_have_either_sign_and_an_even_spread() -> None:
    problem = Rastrigin(30)
    shifts = np.concatenate([Shifted.draw(problem, seed).shift for seed in range(60)]) / 10.24
    assert stats.binomtest(int((shifts > 0).sum()), shifts.size).pvalue > ALARM
    assert stats.kstest(np.abs(shifts), stats.uniform(0.1, 0.3).cdf).pvalue > ALARM
    # off the centre the fractions are cut where the box ends, but both signs remain
    off = np.array([Shifted.draw(Zettl(), seed).shift[0] for seed in range(200)])
    assert stats.binomtest(int((off > 0).sum()), off.size).pvalue > ALARM
    assert off.min() >= -5.0
    assert off.max() > 5.5


def test_problems_are_shifted_independently_of_each_other() -> None:
    draws = [
        Shifted.draw(problem, 3).shift / (problem.xu - problem.xl)
        for problem in (Ackley(), Griewank(), Rastrigin())
    ]
    assert len({tuple(np.sign(draw)) + tuple(draw.round(6)) for draw in draws}) == 3
    twice = Shifted.draw(Shifted.draw(Ackley(), 3), 3)
    assert (twice.shift != twice.problem.shift).all()


@examples
@given(problem=problems, fraction=st.floats(0, 1))
def test_the_minimum_can_be_sent_to_a_place(problem: EstimationProblem, fraction: float) -> None:
    shifted = Shifted.to_fraction(problem, fraction)
    place = (shifted.true_x - shifted.xl) / (shifted.xu - shifted.xl)
    np.testing.assert_allclose(place, fraction, atol=1e-12)
    assert (shifted.true_x >= shifted.xl).all()
    assert (shifted.true_x <= shifted.xu).all()


def test_places_may_differ_by_axis() -> None:
    shifted = Shifted.to_fraction(Griewank(3), [0.1, 0.5, 1.0])
    assert shifted.true_x.tolist() == pytest.approx([-480.0, 0.0, 600.0])
    with pytest.raises(InvalidInput, match="numbers between 0 and 1"):
        Shifted.to_fraction(Griewank(), 1.1)


def test_the_first_population_never_contains_the_disguised_minimum() -> None:
    for seed in range(60):
        problem = navopt.simulate("rastrigin", seed, n_var=2, shift=True, rotate=True)
        algorithm = navopt.make_solver("random-search")
        algorithm.setup(problem, seed=seed)
        gap = np.abs(algorithm.ask().get("X") - problem.true_x) / (problem.xu - problem.xl)
        assert gap.max(axis=1).min() > 1e-9


def test_of_several_minimisers_one_stays_inside() -> None:
    problem = TestTubeHolder(lower=-3.0, upper=3.0)
    shifted = Shifted(problem, [2.0, 0.0])  # the positive one leaves
    assert shifted.true_x == pytest.approx([0.4293973858, 0.0])
    assert (shifted.truth.position == problem.minimizers[1]).all()
    assert shifted.minimizers[0] == pytest.approx([3.5706026142, 0.0])
    assert (Shifted(problem, [-2.0, 0.0]).truth.position == problem.minimizers[0]).all()


def test_a_lost_minimum_is_refused() -> None:
    with pytest.raises(InvalidInput, match=r"minimiser of the shifted\(wood\) problem: .* it left the box"):
        Shifted(Wood(), 9.5)
    with pytest.raises(InvalidInput, match="it left the box"):
        Rotated(Sphere([9.0, 9.0]), haar_orthogonal(2, np.random.default_rng(5)), centre=[0.0, 0.0])
    assert Rotated(Sphere([9.0, 9.0]), haar_orthogonal(2, np.random.default_rng(5))).true_x.tolist() == [
        9.0,
        9.0,
    ]


# -- rotations ----------------------------------------------------------------------------------------
@examples
@given(n=st.integers(1, 12), seed=seeds)
def test_rotations_are_orthogonal(n: int, seed: int) -> None:
    turn = Rotated.draw(Rastrigin(n), seed).rotation
    assert np.abs(turn @ turn.T - np.eye(n)).max() < 1e-13
    assert abs(abs(np.linalg.det(turn)) - 1.0) < 1e-12


def test_rotations_follow_the_haar_measure() -> None:
    count = 3000
    rng = np.random.default_rng(8)
    turns = np.array([haar_orthogonal(3, rng) for _ in range(count)])
    assert stats.binomtest(int((np.linalg.det(turns) > 0).sum()), count).pvalue > ALARM
    # Archimedes: a coordinate of an even direction in space is uniform; and no fixed turn changes the law
    even = stats.uniform(-1, 2).cdf
    fixed = haar_orthogonal(3, rng)
    for sample in (turns, fixed @ turns, turns @ fixed):
        for i, j in ((0, 0), (1, 2), (2, 1)):
            assert stats.kstest(sample[:, i, j], even).pvalue > ALARM
    # Diaconis and Shahshahani: the trace has moments 0, 1 and 3, those of a normal number
    traces = np.trace(turns, axis1=1, axis2=2)
    for power, moment, spread in ((1, 0.0, 1.0), (2, 1.0, 3.0**0.5), (4, 3.0, 9.0)):
        assert abs(np.mean(traces**power) - moment) < 4.5 * spread / count**0.5
    # the test can tell: a factorisation left as LAPACK makes it is not even
    raw = np.array([np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(count)])
    assert stats.kstest(raw[:, 0, 0], even).pvalue < 1e-12


def test_a_rotation_leaves_its_centre_and_acts_in_units_of_the_box() -> None:
    box = {"lower": [-1.0, -1000.0], "upper": [1.0, 1000.0]}
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    turned = Rotated(Sphere([0.0, 0.0], **box), quarter)
    assert turned.inward([0.5, 0.0]).tolist() == [0.0, 500.0]
    assert turned.outward([0.0, 500.0]).tolist() == [0.5, 0.0]
    assert turned.true_x.tolist() == [0.0, 0.0]
    assert Rotated(Recorded(), quarter).centre.tolist() == [0.5, 0.0]
    for wrong in (np.eye(3), 2 * np.eye(2), [[1.0, 1.0], [0.0, 1.0]], np.full((2, 2), np.nan)):
        with pytest.raises(InvalidInput, match="give an orthogonal matrix"):
            Rotated(Ackley(), wrong)


# -- capabilities --------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "problem", [Rosenbrock(4), HelicalValley(), Wood(), Measured()], ids=lambda p: type(p).__name__
)
def test_residuals_follow_the_chain_rule(problem: EstimationProblem) -> None:
    shifted, turned, scaled, noisy, _ = wrapped_in_everything(problem, 3)
    for wrapper in (shifted, turned, scaled, Scaled(Shifted.draw(turned, 1), 3.0)):
        assert wrapper.provides == problem.provides
        X = points(wrapper, 20)
        np.testing.assert_allclose(
            0.5 * np.sum(wrapper.residuals(X) ** 2, axis=1), wrapper.loss(X), rtol=1e-9
        )
        numerical = EstimationProblem._jacobian(wrapper, X)
        scale = np.abs(numerical).max(axis=(0, 1))
        np.testing.assert_allclose(wrapper.jacobian(X) / scale, numerical / scale, rtol=1e-5, atol=1e-6)
        assert (wrapper.jacobian(X)[7] == wrapper.jacobian(X[7])).all()
    assert noisy.provides == frozenset()
    with pytest.raises(UnsuitableProblem, match="Noisy does not provide 'residuals'"):
        noisy.residuals(noisy.nominal)


def test_prior_and_bound_are_carried_along() -> None:
    problem = Measured()
    X = points(problem, 10)
    assert Noisy(problem, 1.0).prior() is None
    for wrapper in (Shifted.draw(problem, 1), Rotated.draw(problem, 1), Scaled(problem, [2.0, 0.1, 1e3])):
        mean, covariance = wrapper.prior()
        inner_mean, inner_covariance = problem.prior()
        a, b = X @ np.eye(3) - inner_mean, wrapper.outward(X) - mean
        expected = np.sum(a * np.linalg.solve(inner_covariance, a.T).T, axis=1)
        np.testing.assert_allclose(
            np.sum(b * np.linalg.solve(covariance, b.T).T, axis=1), expected, rtol=1e-9
        )
        back = np.linalg.inv(wrapper.slope())
        np.testing.assert_allclose(wrapper.error_bound(), back @ problem.error_bound() @ back.T, rtol=1e-9)
    np.testing.assert_allclose(Scaled(Sphere([0.0, 0.0]), [2.0, 3.0]).error_bound(), np.diag([4.0, 9.0]))
    assert [p.unit for p in Scaled(Recorded(), [1.0, 1000.0]).parameters] == ["m", "s/1000"]


def test_what_speaks_of_the_inner_vector_is_not_provided() -> None:
    world = navopt.simulate("gravity-matching", 1, hours=2.0)
    wrappers = Rotated.draw(world, 1), Shifted.draw(world, 1), Scaled(world, [1e-3, 1e-3, 57.0, 1.0])
    for wrapper in wrappers:
        assert wrapper.provides == {"residuals", "prior", "bound"}
        with pytest.raises(UnsuitableProblem, match="an inertial track"):
            navopt.solve(wrapper, "tercom")
        x = wrapper.project(wrapper.truth)
        estimate = wrapper.estimate(x)
        np.testing.assert_allclose(
            wrapper.project(estimate), x, rtol=1e-6, atol=1e-6 * (wrapper.xu - wrapper.xl).min()
        )
        assert wrapper.score(estimate) == world.score(world.estimate(wrapper.inward(x)))
        assert wrapper.illustration().keys() == world.illustration().keys()
    twin = wrappers[0].redraw(9)
    assert (twin.problem.measured != world.measured).all()
    assert (twin.truth.latitude == world.truth.latitude).all()
    assert (twin.rotation == wrappers[0].rotation).all()
    moved = Scaled(world, 2.0)
    assert moved.loss(moved.nominal) == world.loss(world.nominal)


def test_a_problem_without_a_known_minimum() -> None:
    inner = Recorded()
    shifted = Shifted(inner, [0.5, 0.0])
    assert shifted.true_x is None
    assert shifted.minimum is None
    assert shifted.minimizers is None
    assert shifted.loss([1.0, 0.5]) == 0.25
    assert shifted.invalid_reasons(np.array([[1.4, 0.0]])) == ["x is 0.9"]
    assert Noisy(inner, 1.0).loss([1.0, 0.5]) == np.inf
    with pytest.raises(NoTruth):
        shifted.score(None)
    with pytest.raises(UnsuitableProblem, match="Recorded does not say where its minimum is"):
        Shifted.draw(inner, 1)
    with pytest.raises(UnsuitableProblem, match="recorded data"):
        shifted.redraw(1)


# -- noise ---------------------------------------------------------------------------------------------
def noise(X: np.ndarray, seed: int = 0) -> np.ndarray:
    class Flat(EstimationProblem):
        def __init__(self) -> None:
            super().__init__([Parameter(f"x{k}", "1", -1.0, 1.0, 0.0) for k in range(X.shape[1])])

        def _loss(self, X: np.ndarray) -> np.ndarray:
            return np.zeros(len(X))

    return Noisy(Flat(), 1.0, seed).loss(X)


@examples
@given(problem=problems, seed=st.integers(0, 2**63), sigma=st.floats(0, 1e3))
def test_noise_is_a_pure_function(problem: EstimationProblem, seed: int, sigma: float) -> None:
    noisy, again = Noisy(problem, sigma, seed), Noisy(problem, sigma, seed)
    X = points(problem, 9)
    values = noisy.loss(X)
    assert (values == again.loss(X)).all()
    assert (values == pickle.loads(pickle.dumps(noisy)).loss(X)).all()
    assert (values[4:5] == noisy.loss(X[4])).all()
    assert (values == noisy.loss(X)).all()
    assert (Noisy(problem, 0.0, seed).loss(X) == problem.loss(X)).all()


def test_noise_is_normal_and_white() -> None:
    rng = np.random.default_rng(2)
    lattice = np.stack(np.meshgrid(np.arange(150.0), np.arange(150.0)), axis=-1).reshape(-1, 2)
    line = np.linspace(-1.0, 1.0, 20_000)[:, None]
    neighbours = (1.0 + np.arange(20_000) * 2.0**-52)[:, None]
    samples = {
        "random": noise(rng.random((20_000, 5))),
        "lattice": noise(lattice),
        "line": noise(line),
        "neighbours": noise(neighbours),
        "seeds": np.array([noise(np.array([[0.25, 0.5]]), seed)[0] for seed in range(3000)]),
    }
    for sample in samples.values():
        assert stats.kstest(sample, stats.norm.cdf).pvalue > ALARM
        successive = np.corrcoef(sample[:-1], sample[1:])[0, 1]
        assert abs(successive) < 4.5 / sample.size**0.5
        assert np.unique(sample).size == sample.size
    # rows of the lattice, and the axes exchanged
    rows = samples["lattice"].reshape(150, 150)
    for other in (rows[1:].ravel(), np.roll(rows, 1, axis=1)[1:].ravel(), rows.T[:-1].ravel()):
        assert abs(np.corrcoef(rows[:-1].ravel(), other)[0, 1]) < 4.5 / other.size**0.5


def test_every_bit_of_a_coordinate_and_of_the_seed_matters() -> None:
    X = np.random.default_rng(3).random((2000, 2))
    base = noise(X)
    for bit in range(0, 63, 3):
        flipped = X.copy()
        flipped[:, 1] = (flipped[:, 1].view(np.uint64) ^ np.uint64(1 << bit)).view(float)
        sound = np.isfinite(flipped[:, 1])
        other = noise(flipped[sound])
        assert abs(np.corrcoef(base[sound], other)[0, 1]) < 0.1
    for seed in (1, 2, 2**40, 2**63):
        assert abs(np.corrcoef(base, noise(X, seed))[0, 1]) < 0.1
    assert abs(np.corrcoef(base, noise(X[:, ::-1]))[0, 1]) < 0.1
    # the same bytes under another problem's name
    a, b = Noisy(Ackley(), 1.0), Noisy(Rastrigin(), 1.0)
    assert (np.abs(a.loss(X) - a.problem.loss(X) - b.loss(X) + b.problem.loss(X)) > 1e-9).all()


def test_zero_has_one_sign() -> None:
    assert noise(np.array([[-0.0, 0.0]])) == noise(np.array([[0.0, -0.0]]))


def test_the_tails_are_finite() -> None:
    keys = np.array([1, 2], dtype=np.uint64)
    values = hashed_normal(np.random.default_rng(0).random((1_000_000, 1)), keys)
    assert 4.4 < np.abs(values).max() < 8.2
    assert stats.norm.sf(4.0) * 2e6 == pytest.approx((np.abs(values) > 4.0).sum(), rel=0.6)


def test_a_twin_has_other_noise_and_the_same_truth() -> None:
    noisy = Noisy(Shifted.draw(Ackley(), 1), 0.5, seed=1)
    twin = noisy.redraw(2)
    X = points(noisy, 2000)
    assert np.std(twin.loss(X) - noisy.loss(X)) == pytest.approx(0.5 * 2**0.5, rel=0.1)
    assert (twin.true_x == noisy.true_x).all()
    assert twin.score(twin.estimate(X[0])) == noisy.score(noisy.estimate(X[0]))
    assert (noisy.over(Ackley()).sigma, noisy.over(Ackley()).seed) == (0.5, 1)


# -- promises of a problem -----------------------------------------------------------------------------
@pytest.mark.parametrize("problem", wrapped_in_everything(Zettl()), ids=lambda p: p.problem_info.name)
def test_wrappers_are_values(problem: EstimationProblem) -> None:
    X = points(problem)
    twin = pickle.loads(pickle.dumps(problem))
    assert (twin.loss(X) == problem.loss(X)).all()
    assert (twin.true_x == problem.true_x).all()
    assert copy.deepcopy(problem) is problem
    for name in ("shift", "rotation", "factors", "sigma", "true_x", "problem"):
        with pytest.raises(InvalidInput, match="immutable"):
            setattr(problem, name, 0.0)
    with pytest.raises(ValueError, match="read-only"):
        problem.minimizers[0] = 0.0
    solution = navopt.solve(problem, "de", budget=120)
    assert float(problem.loss(solution.x)) == solution.loss
    assert solution.settings["problem"] == problem.problem_info.name
    assert solution.apply(problem) == solution.scores
    redrawn = problem.redraw(5)
    assert (redrawn.true_x == problem.true_x).all()


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Shifted(Ackley(), [1.0, 2.0, 3.0]), "shift: got"),
        (lambda: Shifted(Ackley(), np.nan), "shift: got nan; give one finite number"),
        (lambda: Scaled(Ackley(), 0.0), "factors: got .*; give positive numbers"),
        (lambda: Scaled(Ackley(), [1.0, -1.0]), "factors: got .*; give positive numbers"),
        (lambda: Noisy(Ackley(), -1.0), "sigma: got -1.0"),
        (lambda: Noisy(Ackley(), np.inf), "sigma: got inf"),
        (lambda: Noisy(Ackley(), 1.0, seed=-1), "seed: got -1"),
        (lambda: Noisy(Ackley(), 1.0, seed=True), "seed: got True"),
        (lambda: Rotated.draw(Ackley(), -1), "seed: got -1"),
        (lambda: Shifted.draw(Ackley(), 1, fraction=(0.4, 0.1)), "fraction: got"),
        (lambda: Shifted.draw(Ackley(), 1, fraction=(0.1, 0.6)), "fraction: got"),
    ],
)
def test_bad_arguments_name_themselves(build, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        build()
