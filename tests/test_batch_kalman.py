"""The batched Kalman filter against filterpy, statsmodels and dense normal distributions."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from navopt.errors import InvalidInput, UnknownName
from navopt.filters import BatchKalman
from navopt.models.linear_gaussian import LinearGaussianModel

UPDATES = ("sequential", "matrix", "joseph")


def covariance(rng: np.random.Generator, size: int, spread: float = 1.0) -> np.ndarray:
    root = rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-spread, spread, size)[:, None]
    return root @ root.T + 1e-3 * np.diag(np.diag(root @ root.T))


def system(
    seed: int,
    *,
    n: int = 3,
    m: int = 2,
    g: int = 2,
    steps: int = 40,
    varying: bool = False,
    missing: float = 0.0,
    diagonal: bool = False,
    radius: float = 0.95,
) -> tuple[LinearGaussianModel, np.ndarray, np.ndarray]:
    """A random system with input and its measurements, simulated with the Q and R that are returned."""
    rng = np.random.default_rng(seed)
    lead = (steps,) if varying else ()
    F = rng.normal(size=(*lead, n, n))
    F *= radius / np.abs(np.linalg.eigvals(F)).max(axis=-1)[..., None, None]
    H, G = rng.normal(size=(*lead, m, n)), rng.normal(size=(*lead, n, g))
    Q, R, P0 = covariance(rng, g), covariance(rng, m), covariance(rng, n)
    if diagonal:
        R = np.diag(np.diag(R))
    B, u = rng.normal(size=(n, 1)), rng.normal(size=(steps, 1))
    x = rng.multivariate_normal(np.zeros(n), P0)
    y = np.empty((steps, m))
    for k in range(steps):
        y[k] = (H[k] if varying else H) @ x + rng.multivariate_normal(np.zeros(m), R)
        noise = rng.multivariate_normal(np.zeros(g), Q)
        x = (F[k] if varying else F) @ x + B @ u[k] + (G[k] if varying else G) @ noise
    y[rng.random(y.shape) < missing] = np.nan
    return LinearGaussianModel(F=F, H=H, y=y, G=G, B=B, u=u, P0=P0), Q, R


def filterpy_run(model: LinearGaussianModel, Q: np.ndarray, R: np.ndarray) -> dict[str, np.ndarray]:
    kalman = pytest.importorskip("filterpy.kalman").KalmanFilter(model.n_states, model.n_measurements)
    kalman.x, kalman.P, kalman.H, kalman.R = model.x0[:, None].copy(), model.P0.copy(), model.H, R
    out: dict[str, list] = {name: [] for name in ("estimates", "covariances", "innovations", "S", "nis")}
    for k, z in enumerate(model.y):
        if k:
            kalman.x = model.F @ kalman.x + (model.B @ model.u[k - 1])[:, None]
            kalman.P = model.F @ kalman.P @ model.F.T + model.G @ Q @ model.G.T
        kalman.update(z)
        out["estimates"].append(kalman.x[:, 0].copy())
        out["covariances"].append(kalman.P.copy())
        out["innovations"].append(kalman.y[:, 0].copy())
        out["S"].append(kalman.S.copy())
        out["nis"].append(float(kalman.y[:, 0] @ np.linalg.solve(kalman.S, kalman.y[:, 0])))
    return {name: np.array(values) for name, values in out.items()}


def gap(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference relative to the largest size over the run."""
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


@given(
    st.integers(0, 10**6),
    st.integers(1, 5),
    st.integers(1, 3),
    st.integers(1, 3),
    st.floats(0.1, 1.05),
    st.booleans(),
)
@settings(max_examples=30, deadline=None, derandomize=True, database=None)
def test_equal_to_filterpy_on_random_systems(seed, n, m, g, radius, diagonal) -> None:
    model, Q, R = system(seed, n=n, m=m, g=g, steps=200, radius=radius, diagonal=diagonal)
    runs = {u: BatchKalman(model, update=u).run(Q, R) for u in UPDATES[not diagonal :]}
    theirs = None
    for run in runs.values():
        conditioned = np.linalg.cond(run.innovation_covariances[0]).max() <= 1e6
        if not conditioned:
            turned = np.swapaxes(run.covariances, -1, -2)
            assert np.array_equal(run.covariances, turned)
            sigma = np.sqrt(np.diagonal(run.covariances, axis1=-2, axis2=-1))
            scaled = run.covariances / (sigma[..., :, None] * sigma[..., None, :])
            assert np.linalg.eigvalsh(scaled).min() > -1e-8
            continue
        theirs = theirs if theirs is not None else filterpy_run(model, Q, R)
        assert gap(run.estimates[0], theirs["estimates"]) < 1e-9
        assert gap(run.covariances[0], theirs["covariances"]) < 1e-9
        assert gap(run.innovations[0], theirs["innovations"]) < 1e-9
        assert gap(run.innovation_covariances[0], theirs["S"]) < 1e-9
        assert gap(run.nis[0], theirs["nis"]) < 1e-9


def dense(
    model: LinearGaussianModel, Q: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean and covariance of all states together, and the matrix that measures them."""
    T, n, m = model.n_steps, model.n_states, model.n_measurements
    at = lambda a, k: a if a.ndim == 2 else a[k]  # noqa: E731
    mean, joint = [model.x0], np.zeros((T * n, T * n))
    joint[:n, :n] = model.P0
    for k in range(T - 1):
        F, G, here, there = (
            at(model.F, k),
            at(model.G, k),
            slice(k * n, k * n + n),
            slice(k * n + n, k * n + 2 * n),
        )
        mean.append(F @ mean[-1] + model.drive[k])
        joint[there, : k * n + n] = F @ joint[here, : k * n + n]
        joint[: k * n + n, there] = joint[there, : k * n + n].T
        joint[there, there] = F @ joint[here, here] @ F.T + G @ Q @ G.T
    measure = np.zeros((T * m, T * n))
    for k in range(T):
        measure[k * m : k * m + m, k * n : k * n + n] = at(model.H, k)
    return np.concatenate(mean), joint, measure


@pytest.mark.parametrize("update", UPDATES)
@pytest.mark.parametrize("varying", [False, True])
def test_likelihood_and_smoother_equal_the_dense_normal_distribution(update, varying) -> None:
    model, Q, R = system(5, steps=15, varying=varying, missing=0.3, diagonal=update == "sequential")
    mean, joint, measure = dense(model, Q, R)
    there = np.isfinite(model.y.ravel())
    measure = measure[there]
    S = measure @ joint @ measure.T + np.kron(np.eye(model.n_steps), R)[np.ix_(there, there)]
    error = model.y.ravel()[there] - measure @ mean
    expected = multivariate_normal(np.zeros(len(S)), S).logpdf(error)
    kalman = BatchKalman(model, update=update)
    assert kalman.log_likelihood(Q, R)[0] == pytest.approx(expected, rel=1e-12)
    gain = np.linalg.solve(S, measure @ joint).T
    states, covariances = mean + gain @ error, joint - gain @ measure @ joint
    smoothed = kalman.smooth(Q, R)
    n = model.n_states
    scale = np.abs(covariances).max()
    assert gap(smoothed.estimates[0].ravel(), states) < 1e-10
    for k in range(model.n_steps):
        here = slice(k * n, k * n + n)
        assert np.abs(smoothed.covariances[0, k] - covariances[here, here]).max() < 1e-11 * scale
        if k < model.n_steps - 1:
            later = slice(k * n + n, k * n + 2 * n)
            assert np.abs(smoothed.lagged_covariances[0, k] - covariances[later, here]).max() < 1e-11 * scale


def test_smoother_equals_filterpys() -> None:
    model, Q, R = system(8, steps=60)
    theirs = filterpy_run(model, Q, R)
    kalman = pytest.importorskip("filterpy.kalman").KalmanFilter(3, 2)
    # its smoother knows no input: take the input's part out of the states first
    part = np.zeros((model.n_steps, 3))
    for k in range(model.n_steps - 1):
        part[k + 1] = model.F @ part[k] + model.drive[k]
    kalman.F, kalman.Q = model.F, model.G @ Q @ model.G.T
    states, covariances, *_ = kalman.rts_smoother(theirs["estimates"] - part, theirs["covariances"])
    ours = BatchKalman(model).smooth(Q, R)
    assert gap(ours.estimates[0], states + part) < 1e-9
    assert gap(ours.covariances[0], covariances) < 1e-9


@pytest.mark.parametrize("missing", [0.0, 0.2])
def test_likelihood_equals_statsmodels(missing) -> None:
    library = pytest.importorskip("statsmodels.tsa.statespace.kalman_filter")
    model, Q, R = system(11, n=4, m=2, g=2, steps=150, missing=missing)
    theirs = library.KalmanFilter(k_endog=2, k_states=4, k_posdef=2)
    theirs.bind(np.asfortranarray(model.y.T))
    theirs["design"], theirs["transition"], theirs["selection"] = model.H, model.F, model.G
    theirs["state_cov"], theirs["obs_cov"] = Q, R
    theirs["state_intercept"] = np.asfortranarray(model.drive.T)
    theirs.initialize_known(model.x0, model.P0)
    assert BatchKalman(model).log_likelihood(Q, R)[0] == pytest.approx(theirs.loglike(), rel=1e-10)


@pytest.mark.parametrize(("n", "m"), [(2, 1), (5, 3)])
def test_a_candidate_has_the_same_bits_in_any_company(n, m) -> None:
    model, _, _ = system(2, n=n, m=m, g=n, steps=50, missing=0.1)
    rng = np.random.default_rng(0)
    Q = np.stack([covariance(rng, n) for _ in range(21)])
    R = np.stack([covariance(rng, m) for _ in range(21)])
    # some diagonal, so that both updates take part
    R[::2] *= np.eye(m)
    truth = rng.normal(size=(50, n))
    kalman = BatchKalman(model)
    logs, squares = kalman.log_likelihood(Q, R), kalman.mean_square_error(Q, R, truth)
    order = rng.permutation(21)
    assert np.array_equal(kalman.log_likelihood(Q[order], R[order]), logs[order])
    assert np.array_equal(kalman.run(Q, R).log_likelihood, logs)
    for k in range(21):
        assert kalman.log_likelihood(Q[k], R[k])[0] == logs[k]
        assert np.array_equal(kalman.mean_square_error(Q[k], R[k], truth)[0], squares[k])


@pytest.mark.parametrize(("gaps", "driven"), [((), True), ((), False), ((150, 151, 330), True)])
@pytest.mark.parametrize(("n", "m"), [(2, 1), (6, 2)])
def test_a_candidate_whose_covariance_settles_has_the_same_bits_in_any_company(n, m, gaps, driven) -> None:
    # candidates settle at very different times, and missing data unsettle them
    model, Q, R = system(3, n=n, m=m, g=n, steps=600)
    y = model.y.copy()
    y[list(gaps), 0] = np.nan
    model, rng = model.replaced(y=y, **({} if driven else {"B": None, "u": None})), np.random.default_rng(1)
    Qs = 10.0 ** rng.uniform(-7.0, 1.0, (150, 1, 1)) * Q
    Rs = np.repeat(R[None], 150, axis=0)
    Rs[::2] *= np.eye(m)
    kalman, truth = BatchKalman(model), rng.normal(size=(600, n))
    logs, squares = kalman.log_likelihood(Qs, Rs), kalman.mean_square_error(Qs, Rs, truth)
    # what is kept is computed step by step, without waiting for anything to settle
    run = kalman.run(Qs, Rs)
    assert np.array_equal(run.log_likelihood, logs)
    assert np.allclose(np.mean((run.estimates - truth) ** 2, axis=1), squares, rtol=1e-12)
    order = rng.permutation(150)
    assert np.array_equal(kalman.log_likelihood(Qs[order], Rs[order]), logs[order])
    for k in range(0, 150, 11):
        assert kalman.log_likelihood(Qs[k], Rs[k])[0] == logs[k]
        assert np.array_equal(kalman.mean_square_error(Qs[k], Rs[k], truth)[0], squares[k])
    # a covariance of its own for every step is never held: the difference is what holding costs
    each = [np.repeat(a[:3, None], 600, axis=1) for a in (Qs, Rs)]
    assert np.allclose(kalman.log_likelihood(*each), logs[:3], rtol=1e-11)


def test_mean_square_error_is_that_of_the_estimates() -> None:
    model, Q, R = system(4, steps=30)
    truth = np.random.default_rng(1).normal(size=(30, 3))
    kalman = BatchKalman(model)
    expected = np.mean((kalman.run(Q, R).estimates[0] - truth) ** 2, axis=0)
    assert kalman.mean_square_error(Q, R, truth)[0] == pytest.approx(expected, rel=1e-12)


def test_many_realisations_are_each_their_own() -> None:
    model, Q, R = system(6, steps=25)
    data = np.stack([model.y, 2.0 * model.y, np.where(model.y > 0.0, model.y, np.nan)])
    both = BatchKalman(model, measurements=data)
    Qs, Rs = np.stack([Q, 2.0 * Q]), np.stack([R, 3.0 * R])
    logs, run, smoothed = both.log_likelihood(Qs, Rs), both.run(Qs, Rs), both.smooth(Qs, Rs)
    assert logs.shape == (2, 3)
    assert run.estimates.shape == (2, 3, 25, 3)
    total = both.gradient(Qs, Rs)
    sums = 0.0
    for k, y in enumerate(data):
        one = BatchKalman(model.replaced(y=y))
        assert np.array_equal(one.log_likelihood(Qs, Rs), logs[:, k])
        assert np.array_equal(one.run(Qs, Rs).estimates, run.estimates[:, k])
        assert np.array_equal(one.smooth(Qs, Rs).estimates, smoothed.estimates[:, k])
        sums = sums + one.gradient(Qs, Rs).by_Q
    assert np.allclose(total.by_Q, sums, rtol=1e-12)
    truths = np.random.default_rng(2).normal(size=(3, 25, 3))
    expected = np.mean((run.estimates - truths) ** 2, axis=2)
    assert np.allclose(both.mean_square_error(Qs, Rs, truths), expected, rtol=1e-12)


@pytest.mark.parametrize("varying", [False, True])
def test_gradient_equals_finite_differences(varying) -> None:
    model, Q, R = system(9, steps=30, varying=varying, missing=0.2)
    kalman, rng = BatchKalman(model), np.random.default_rng(7)
    gradient = kalman.gradient(Q, R)
    parts = {"Q": (Q, gradient.by_Q), "R": (R, gradient.by_R), "P0": (model.P0, gradient.by_P0)}
    for name, (matrix, by) in parts.items():
        for _ in range(3):
            # small against the matrix in every direction
            root, turn = np.linalg.cholesky(matrix), rng.normal(size=matrix.shape)
            change, step = root @ (turn + turn.T) @ root.T, 1e-5
            values = []
            for sign in (1.0, -1.0):
                given = {"Q": Q, "R": R, "P0": model.P0, name: matrix + sign * step * change}
                values.append(kalman.log_likelihood(**given)[0])
            slope = (values[0] - values[1]) / (2.0 * step)
            assert np.trace(by[0] @ change) == pytest.approx(slope, rel=1e-5, abs=1e-6)


def test_covariances_per_step() -> None:
    model, Q, R = system(12, steps=20)
    kalman = BatchKalman(model)
    Qs, Rs = np.repeat(Q[None, None], 20, 1), np.repeat(R[None, None], 20, 1)
    assert kalman.log_likelihood(Qs, Rs)[0] == kalman.log_likelihood(Q, R)[0]
    factors = np.linspace(1.0, 9.0, 20)[None, :, None, None]
    assert kalman.log_likelihood(Qs, factors * Rs)[0] != kalman.log_likelihood(Q, R)[0]
    each, whole = kalman.gradient(Qs, Rs), kalman.gradient(Q, R)
    assert np.allclose(each.by_R.sum(axis=1), whole.by_R, rtol=1e-9)
    # the Q of the last step leads to nothing
    assert not each.by_Q[0, -1].any()
    assert np.allclose(each.by_Q.sum(axis=1), whole.by_Q, rtol=1e-9)


def test_candidates_that_fail_say_why_and_spoil_nothing() -> None:
    model, Q, R = system(13, steps=30, g=2)
    bad = np.array([[1.0, 3.0], [3.0, 1.0]])
    skew = np.array([[1.0, 0.5], [0.2, 1.0]])
    nan = np.array([[np.nan, 0.0], [0.0, 1.0]])
    Qs = np.stack([Q, bad, Q, skew, -Q, nan, Q, 1e160 * Q, Q])
    Rs = np.stack([R, R, bad, R, R, R, 0.0 * R, R, R])
    kalman = BatchKalman(model)
    reasons = kalman.reasons(Qs, Rs)
    expected = (
        None, "Q is not positive semi-definite", "R is not positive definite", "Q is not symmetric",
        "Q[0, 0] is negative", "Q[0, 0] is not finite", "R[0, 0] is not positive", None, None,
    )  # fmt: skip
    assert reasons[:7] == expected[:7]
    assert reasons[7].startswith(
        "the filter diverges: at step 1 a variance of the innovations is not between"
    )
    assert reasons[8] is None
    logs = kalman.log_likelihood(Qs, Rs)
    sound = np.array([reason is None for reason in reasons])
    assert (logs[~sound] == -np.inf).all()
    assert (logs[sound] == kalman.log_likelihood(Q, R)[0]).all()
    squares = kalman.mean_square_error(Qs, Rs, np.zeros((30, 3)))
    assert (squares[~sound] == np.inf).all()
    assert np.isfinite(squares[sound]).all()
    run = kalman.run(Qs, Rs)
    assert np.isnan(run.estimates[~sound]).all()
    assert np.isfinite(run.estimates[sound]).all()
    assert np.isnan(kalman.gradient(Qs, Rs).by_Q[~sound]).all()
    # singular process noise and prior are sound
    assert kalman.reasons(0.0 * Q, R, P0=0.0 * model.P0) == (None,)


def test_an_unstable_filter_diverges_with_a_reason() -> None:
    n = 400
    model = LinearGaussianModel(
        F=np.diag([2.0]), H=np.array([[1.0]]), y=np.r_[0.0, np.full(n - 2, np.nan), 1.0], P0=np.eye(1)
    )
    (reason,) = BatchKalman(model).reasons(np.eye(1), np.eye(1))
    assert reason is not None
    assert f"at step {n - 1}" in reason


def exact_covariances(F, rows, q, r, prior, steps) -> list[np.ndarray]:
    """Filtered covariances in rational arithmetic, one scalar measurement after the other."""
    n = len(F)
    P = [[Fraction(prior) if i == j else Fraction(0) for j in range(n)] for i in range(n)]
    out = []
    for k in range(steps):
        if k:
            A = [[sum(F[i][c] * P[c][j] for c in range(n)) for j in range(n)] for i in range(n)]
            P = [
                [sum(A[i][c] * F[j][c] for c in range(n)) + (q if i == j else 0) for j in range(n)]
                for i in range(n)
            ]
        for h in rows:
            w = [sum(P[i][c] * h[c] for c in range(n)) for i in range(n)]
            s = sum(h[i] * w[i] for i in range(n)) + r
            P = [[P[i][j] - w[i] * w[j] / s for j in range(n)] for i in range(n)]
        out.append(np.array([[float(value) for value in row] for row in P]))
    return out


def test_joseph_keeps_digits_that_the_plain_update_loses() -> None:
    # two nearly equal, nearly perfect measurements of nearly unknown states
    F, rows = (
        [[Fraction(1), Fraction(1)], [Fraction(0), Fraction(1)]],
        [
            [Fraction(1), Fraction(0)],
            [Fraction(1), Fraction(1, 1024)],
        ],
    )
    q, r, prior, steps = Fraction(1, 2**20), Fraction(1, 2**13), 2**40, 6
    exact = exact_covariances(F, rows, q, r, prior, steps)
    model = LinearGaussianModel(
        F=np.array(F, dtype=float), H=np.array(rows, dtype=float), y=np.ones((steps, 2)), P0=prior * np.eye(2)
    )
    worst = {}
    for update in UPDATES:
        run = BatchKalman(model, update=update).run(float(q) * np.eye(2), float(r) * np.eye(2))
        worst[update] = max(gap(ours, true) for ours, true in zip(run.covariances[0], exact, strict=True))
    assert worst["joseph"] < 1e-4 * worst["sequential"]
    assert worst["joseph"] < 1e-4 * worst["matrix"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"Q": np.eye(3)}, r"Q: got shape \(3, 3\); give \(2, 2\)"),
        ({"R": np.ones((4, 7, 2, 2))}, "R: got shape"),
        ({"Q": "x"}, "Q: .*give an array of numbers"),
        ({"Q": np.ones((3, 2, 2)), "R": np.ones((2, 2, 2))}, "R: got 2 candidates; give 1 or 3"),
    ],
)
def test_wrong_shapes_are_named(arguments, message) -> None:
    model, Q, R = system(1, steps=20)
    with pytest.raises(InvalidInput, match=message):
        BatchKalman(model).log_likelihood(**{"Q": Q, "R": R, **arguments})


def test_options_are_checked() -> None:
    model, Q, R = system(1, steps=20)
    with pytest.raises(UnknownName, match=r"update: .*'matrix'"):
        BatchKalman(model, update="matrixx")
    with pytest.raises(InvalidInput, match="R of candidate 0: got not diagonal"):
        BatchKalman(model, update="sequential").log_likelihood(Q, R)
    with pytest.raises(InvalidInput, match="measurements: got shape"):
        BatchKalman(model, measurements=np.zeros((3, 5, 2)))
    with pytest.raises(InvalidInput, match="truth: got shape"):
        BatchKalman(model).mean_square_error(Q, R, np.zeros((3, 3)))


def test_candidates_need_not_be_writable_contiguous_or_exactly_symmetric() -> None:
    model, Q, R = system(5)
    Qs, Rs = np.stack([Q, 2.0 * Q, 3.0 * Q]), np.stack([R, 2.0 * R, 3.0 * R])
    kalman = BatchKalman(model)
    logs = kalman.log_likelihood(Qs, Rs)
    for a in (Qs, Rs):
        a.setflags(write=False)
    assert np.array_equal(kalman.log_likelihood(Qs, Rs), logs)
    assert np.array_equal(kalman.log_likelihood(np.asfortranarray(Qs), Rs[::-1][::-1]), logs)
    rounded = Rs.copy()
    rounded[:, 0, 1] *= 1.0 + 1e-12
    rounded[:, 1, 0] *= 1.0 - 1e-12
    assert np.allclose(kalman.log_likelihood(Qs, rounded), logs, rtol=1e-13)


def test_one_filter_in_two_threads_and_in_another_copy() -> None:
    model, Q, R = system(4, steps=300)
    kalman, factors = BatchKalman(model), np.linspace(0.1, 9.0, 40)[:, None, None]
    logs = kalman.log_likelihood(factors * Q, R)
    with ThreadPoolExecutor(2) as pool:
        for found in pool.map(lambda _: kalman.log_likelihood(factors * Q, R), range(40)):
            assert np.array_equal(found, logs)
    again = pickle.loads(pickle.dumps(kalman))
    assert np.array_equal(again.log_likelihood(factors * Q, R), logs)


def test_many_channels_and_blocks() -> None:
    model, Q, R = system(3, n=2, m=9, g=2, steps=12, missing=0.2, diagonal=True)
    factors = np.linspace(0.5, 2.0, 33)[:, None, None]
    logs = [BatchKalman(model, update=u).log_likelihood(factors * Q, R) for u in UPDATES]
    assert np.allclose(logs[0], logs[1], rtol=1e-11)
    assert np.allclose(logs[0], logs[2], rtol=1e-11)
