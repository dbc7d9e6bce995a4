"""Fading factors: the recursion by hand, one transform against three, what stays positive."""

from __future__ import annotations

import numpy as np
import pytest
from filter_tools import DT, P0, X0, Q, R, bob, pendulum, record

from baselines.adaptive_filters import innovation_adaptive, sage_husa
from baselines.noise_structure import NoiseStructure
from navopt.errors import InvalidInput
from navopt.filters import ExtendedFilter, NoiseAdaptation, StrongTracking, UnscentedFilter
from navopt.models.linear_gaussian import LinearGaussianModel

READINGS = [
    StrongTracking(cap=None, weakening=4.0, factors="single"),
    StrongTracking.published(),
    StrongTracking(fades="process", cap=5.0, factors="single"),
    StrongTracking(factors="multiple", cap=4.0, forgetting=0.7),
    StrongTracking(factors="multiple", fades="process", cap=4.0, weakening=2.0),
]
H = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.1]])
F = np.array([[1.0, 0.1, 0.0], [0.0, 0.95, 0.1], [0.0, 0.0, 0.9]])


def shift(states, u, dt):
    return states @ F.T


def wander(steps: int) -> np.ndarray:
    """Measurements that jump, so that factors have something to do."""
    rng = np.random.default_rng(5)
    z = 0.2 * rng.normal(size=(steps, 2))
    z[steps // 2 :] += 2.0
    z[::5, 0] = np.nan
    return z


def by_hand(z: np.ndarray, strong: StrongTracking) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Plain matrices, one step after the other."""
    x, P, V = X0.copy(), P0.copy(), np.full((2, 2), np.nan)
    estimates, covariances, factors = [], [], []
    for k, y in enumerate(z):
        noise = Q if k else np.zeros((3, 3))
        if k:
            x, P = F @ x, F @ P @ F.T + Q
        seen = np.flatnonzero(np.isfinite(y))
        factor = np.full(2, np.nan)
        if len(seen):
            Hs, Rs, e = H[seen], R[np.ix_(seen, seen)], y[seen] - H[seen] @ x
            for a, i in enumerate(seen):
                for b, j in enumerate(seen):
                    old = V[i, j]
                    V[i, j] = (
                        e[a] * e[b]
                        if np.isnan(old)
                        else (strong.forgetting * old + e[a] * e[b]) / (1.0 + strong.forgetting)
                    )
            N = V[np.ix_(seen, seen)] - strong.weakening * Rs
            M = Hs @ P @ Hs.T
            if strong.fades == "process":
                N, M = N - Hs @ noise @ Hs.T, M - Hs @ noise @ Hs.T
            W = np.diag(1.0 / np.diag(Rs)) if strong.normalise else np.eye(len(seen))
            cap = np.inf if strong.cap is None else strong.cap
            if strong.factors == "single":
                factor[seen] = np.clip(np.trace(W @ N) / np.trace(W @ M), 1.0, cap)
                D = np.sqrt(factor[seen[0]]) * np.eye(3)
            else:
                factor[seen] = np.clip(np.diag(N) / np.diag(M), 1.0, cap)
                D = np.eye(3)
                for i in seen:
                    D[i, i] = np.sqrt(factor[i])
            kept = noise if strong.fades == "process" else 0.0
            P = D @ (P - kept) @ D + kept
            S = Hs @ P @ Hs.T + Rs
            K = P @ Hs.T @ np.linalg.inv(S)
            x, P = x + K @ e, P - K @ S @ K.T
            # what is not symmetric would grow with every factor
            P = 0.5 * (P + P.T)
        estimates.append(x)
        covariances.append(P)
        factors.append(factor)
    return np.array(estimates), np.array(covariances), np.array(factors)


@pytest.mark.parametrize("strong", READINGS)
@pytest.mark.parametrize("square_root", [False, True])
def test_one_transform_three_transforms_and_matrices_by_hand_agree(strong, square_root) -> None:
    z = wander(60)
    x, P, factors = by_hand(z, strong)
    assert 0.1 < (factors > 1.01).sum() / np.isfinite(factors).sum() < 1.0
    noises = {"Q": Q, "R": R, "P0": P0, "x0": X0, "strong": strong, "square_root": square_root}
    filters = [
        UnscentedFilter(shift, H, variant="sst-ukf", **noises),
        UnscentedFilter(shift, H, variant="st-ukf", **noises),
        UnscentedFilter(shift, H, variant="sst-ukf", covariance_update="faded", alpha=1.0, **noises),
        ExtendedFilter(shift, H, **noises),
    ]
    for one in filters:
        run = one.run(np.arange(60.0), z)
        assert run.failed is None
        assert np.allclose(run.estimates, x, rtol=1e-7, atol=1e-8)
        assert np.allclose(run.covariances, P, rtol=1e-7, atol=1e-8)
        assert np.allclose(run.fading_factors, factors, rtol=1e-7, equal_nan=True)


def test_one_transform_is_one_and_differs_where_the_measurement_is_curved() -> None:
    counted = []

    def counting(states):
        counted.append(len(states))
        return states @ H.T

    noises = {"Q": Q, "R": R, "P0": 0.1 * P0, "x0": X0, "strong": StrongTracking(cap=1.2, factors="single")}
    t, _, z = record(80, spread=0.1 * P0)
    three = UnscentedFilter(pendulum, counting, variant="st-ukf", **noises)
    three.run(t[:10], z[:10])
    assert sum(counted) == 2 * 10 * 7
    assert (
        three.points_per_step,
        UnscentedFilter(pendulum, H, variant="sst-ukf", **noises).points_per_step,
    ) == (21, 7)
    runs = [
        UnscentedFilter(pendulum, bob, variant=variant, alpha=1.0, **noises).run(t, z)
        for variant in ("sst-ukf", "st-ukf")
    ]
    gap = np.abs(runs[0].estimates - runs[1].estimates)[1:].max()
    assert 1e-6 < gap < 0.1


def test_the_printed_covariance_loses_positive_definiteness() -> None:
    # P⁻ = 1, R = 0.1, λ = 3: P⁻ - K S K = 1 - 9 / 3.1, and with the faded covariance 3 - 9 / 3.1
    for square_root in (False, True):
        for variant in ("sst-ukf", "st-ukf"):
            noises = {
                "Q": [[0.0]], "R": [[0.1]], "P0": [[1.0]], "variant": variant, "square_root": square_root,
                "strong": StrongTracking(cap=3.0),
            }  # fmt: skip
            for update in ("joseph", "faded"):
                one = UnscentedFilter(shift1, [[1.0]], covariance_update=update, **noises)
                one.update([100.0])
                assert one.fading_factors.tolist() == [3.0]
                assert one.P[0, 0] == pytest.approx(3.0 - 9.0 / 3.1, rel=1e-12)
                assert round(one.P[0, 0], 3) == 0.097
            printed = UnscentedFilter(shift1, [[1.0]], covariance_update="printed", **noises)
            run = printed.run([0.0, 1.0], [[100.0], [0.0]])
            assert run.failed_step == 0
            assert (
                run.failed == "at step 0 (0 s): the covariance after the measurement is not positive definite"
            )
            if not square_root:
                assert printed.P[0, 0] == pytest.approx(1.0 - 9.0 / 3.1, rel=1e-12)
                assert round(printed.P[0, 0], 2) == -1.90


def shift1(states, u, dt):
    return states


@pytest.mark.parametrize(("factor", "sound"), [(1.09, True), (1.10, False)])
def test_where_the_printed_covariance_breaks(factor: float, sound: bool) -> None:
    # λ (λ - 1) > R / P⁻ = 0.1 just below λ = 1.0916
    one = UnscentedFilter(
        shift1, [[1.0]], Q=[[0.0]], R=[[0.1]], P0=[[1.0]], variant="sst-ukf", covariance_update="printed",
        strong=StrongTracking(cap=factor),
    )  # fmt: skip
    assert (one.run([0.0], [[100.0]]).failed is None) is sound


def test_a_single_factor_inflates_what_nobody_measures() -> None:
    # three states, of which the third is not seen by anything
    blind = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    rng = np.random.default_rng(0)
    z = 0.3 * rng.normal(size=(400, 2))
    t = np.arange(400.0)
    ends = {}
    for name, strong in {
        "free": StrongTracking(cap=None, factors="single"),
        "capped": StrongTracking(factors="single"),
        "multiple": StrongTracking(cap=None, factors="multiple"),
    }.items():
        run = UnscentedFilter(
            shift1,
            blind,
            Q=1e-3 * np.eye(3),
            R=0.01 * np.eye(2),
            P0=np.eye(3),
            variant="sst-ukf",
            strong=strong,
        ).run(t, z)
        ends[name] = run.covariances[-1, 2, 2] if run.failed is None else np.inf
    assert ends["free"] > 1e20
    assert ends["multiple"] == pytest.approx(1.0 + 399 * 1e-3, rel=1e-9)
    # a cap delays it: 1.05 to the power of nearly every step
    assert 1e6 < ends["capped"] < ends["free"]


def test_a_jump_is_followed_sooner() -> None:
    # a level that jumps and a filter that does not expect it: why one tracks strongly at all
    rng = np.random.default_rng(2)
    z = 0.1 * rng.normal(size=(300, 1))
    z[150:] += 3.0
    noises = {"Q": [[1e-6]], "R": [[0.01]], "P0": [[1.0]]}
    errors = [
        np.abs(run.estimates[155:170, 0] - 3.0).mean()
        for run in (
            UnscentedFilter(shift1, [[1.0]], **noises).run(np.arange(300.0), z),
            UnscentedFilter(
                shift1, [[1.0]], variant="sst-ukf", strong=StrongTracking(cap=None), **noises
            ).run(np.arange(300.0), z),
        )
    ]
    assert errors[0] > 2.0
    assert errors[1] < 0.3


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"forgetting": 0.0}, "forgetting.*larger than 0"),
        ({"forgetting": 1.01}, "forgetting.*at most 1"),
        ({"forgetting": np.nan}, "forgetting"),
        ({"weakening": 0.99}, "weakening.*not below 1"),
        ({"cap": 0.5}, "cap.*not below 1"),
        ({"fades": "all"}, "fades"),
        ({"factors": "many"}, "factors"),
        ({"normalise": 1}, "normalise"),
    ],
)
def test_bad_fading_is_one_clear_error(wrong, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        StrongTracking(**wrong)


def test_several_factors_need_to_know_their_states() -> None:
    noises = {"Q": Q, "R": R, "P0": P0, "variant": "sst-ukf"}
    with pytest.raises(InvalidInput, match=r"states.*name the state"):
        UnscentedFilter(pendulum, bob, **noises)
    with pytest.raises(InvalidInput, match=r"states.*name the state"):
        UnscentedFilter(pendulum, bob, strong=StrongTracking(factors="multiple"), **noises)
    with pytest.raises(InvalidInput, match=r"states.*0 to 2"):
        UnscentedFilter(pendulum, bob, strong=StrongTracking(factors="multiple", states=(0, 3)), **noises)
    one = UnscentedFilter(
        pendulum, bob, strong=StrongTracking(factors="multiple", cap=None, states=(-1, 1)), **noises
    )
    before = one.P
    one.update([50.0, 50.0])
    assert (one.fading_factors > 10.0).all()
    # the first channel has no state to fade: only the second row and column were multiplied
    assert one._memory.prior[1, 1] == before[1, 1]


# -- noise that is learnt --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["sage-husa", "innovation", "residual"])
def test_learnt_variances_are_those_of_the_linear_filters(kind: str) -> None:
    rng = np.random.default_rng(7)
    matrix = np.array([[1.0, DT], [0.0, 1.0]])
    y = np.cumsum(0.1 * rng.normal(size=(300, 1)), axis=0) + 0.5 * rng.normal(size=(300, 1))
    y[100:140:3] = np.nan
    model = LinearGaussianModel(F=matrix, H=[[1.0, 0.0]], y=y, P0=np.eye(2))
    noise, nominal = np.diag([0.01, 0.001]), np.array([[0.04]])
    structure = NoiseStructure.of(("fixed", "scalar"), noise, nominal)
    if kind == "sage-husa":
        theirs = sage_husa(model, structure, forgetting=0.97, burn_in=10)
        adaptation = NoiseAdaptation(forgetting=0.97, burn_in=10)
    else:
        theirs = innovation_adaptive(model, structure, window=31, form=kind)
        adaptation = NoiseAdaptation(kind="window", window=31, form=kind)
    for variant in ("ukf", "srukf"):
        ours = UnscentedFilter(
            lambda states, u, dt: states @ matrix.T, [[1.0, 0.0]], Q=noise, R=nominal, P0=np.eye(2),
            variant=variant, adaptation=adaptation,
        ).run(np.arange(300.0), y)  # fmt: skip
        assert np.allclose(ours.estimates, theirs.states, rtol=0.0, atol=1e-9)
        assert np.allclose(ours.measurement_variances[:, 0], theirs.R[:, 0, 0], rtol=1e-9)
    assert theirs.R[-1, 0, 0] > 3.0 * nominal[0, 0]


@pytest.mark.parametrize(
    "wrong",
    [{"kind": "mean"}, {"form": "x"}, {"forgetting": 1.0}, {"window": 1}, {"burn_in": -1}, {"low": 2.0}],
)
def test_bad_learning_is_one_clear_error(wrong) -> None:
    with pytest.raises(InvalidInput, match=next(iter(wrong))):
        NoiseAdaptation(**wrong)
