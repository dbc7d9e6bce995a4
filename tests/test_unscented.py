"""Unscented and extended filters against filterpy, Kalman filters, symmetry and the law of their errors."""

from __future__ import annotations

import numpy as np
import pytest
from filter_tools import DT, P0, X0, Q, R, bob, bob_jacobian, pendulum, pendulum_jacobian, record
from scipy.stats import chi2

from navopt.errors import InvalidInput, NumericalFault, UnknownName
from navopt.filters import (
    BatchKalman,
    ExtendedFilter,
    StrongTracking,
    UnscentedFilter,
    align_measurements,
    normalised_squares,
)
from navopt.models.linear_gaussian import LinearGaussianModel


def linear_model(missing: float) -> tuple[LinearGaussianModel, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    F = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.1], [-0.1, 0.0, 0.9]])
    H = rng.normal(size=(2, 3))
    y = np.cumsum(rng.normal(size=(80, 2)), axis=0)
    y[rng.random(y.shape) < missing] = np.nan
    return LinearGaussianModel(F=F, H=H, y=y, P0=P0, x0=X0), Q + 0.01 * np.eye(3), R


# -- the same numbers as others --------------------------------------------------------------------------


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(0.5, 2.0, 0.0), (1.0, 2.0, 0.0), (0.9, 0.0, 1.0)])
@pytest.mark.parametrize("square_root", [False, True])
def test_unscented_filter_is_that_of_filterpy(alpha, beta, kappa, square_root) -> None:
    filterpy = pytest.importorskip("filterpy.kalman")
    points = filterpy.MerweScaledSigmaPoints(3, alpha, beta, kappa)
    other = filterpy.UnscentedKalmanFilter(
        3, 2, DT, lambda x: bob(x[None])[0], lambda x, dt: pendulum(x[None], None, dt)[0], points
    )
    other.x, other.P, other.Q, other.R = X0.copy(), P0.copy(), Q, R
    ours = UnscentedFilter(
        pendulum, bob, Q=Q, R=R, P0=P0, x0=X0, alpha=alpha, beta=beta, kappa=kappa, square_root=square_root
    )
    _, _, z = record(150)
    for k in range(150):
        other.predict()
        ours.predict(DT)
        assert np.allclose(ours.P, other.P, rtol=0.0, atol=1e-10)
        if k % 3 == 0:
            other.update(z[k])
            ours.update(z[k])
            assert np.allclose(ours.innovation, other.y, rtol=0.0, atol=1e-10)
            assert np.allclose(ours.innovation_covariance, other.S, rtol=0.0, atol=1e-10)
        assert np.allclose(ours.x, other.x, rtol=0.0, atol=1e-10)
        assert np.allclose(ours.P, other.P, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("missing", [0.0, 0.4])
@pytest.mark.parametrize("update", ["joseph", "faded"])
def test_every_variant_is_the_kalman_filter_where_all_is_linear(missing: float, update: str) -> None:
    model, process_noise, R = linear_model(missing)
    exact = BatchKalman(model).run(process_noise, R)
    H = model.H

    def process(states, u, dt):
        return states @ model.F.T

    noises = {"Q": process_noise, "R": R, "P0": model.P0, "x0": model.x0, "covariance_update": update}
    # a cap of 1 leaves nothing of strong tracking
    nothing = StrongTracking(cap=1, factors="single")
    filters = [
        UnscentedFilter(
            process, measure, variant=variant, alpha=alpha, square_root=square, strong=strong, **noises
        )
        for measure in (H, lambda states: states @ H.T)
        for alpha in (1e-3, 1.0)
        for square in (False, True)
        for variant, strong in (("ukf", None), ("sst-ukf", nothing), ("st-ukf", nothing))
    ]
    filters += [
        ExtendedFilter(process, measure, square_root=square, **noises)
        for measure in (H, lambda states: states @ H.T)
        for square in (False, True)
    ]
    exact_jacobians = {"process_jacobian": lambda x, u, dt: model.F, "measure_jacobian": lambda x: H}
    filters.append(ExtendedFilter(process, lambda states: states @ H.T, **exact_jacobians, **noises))
    for one in filters:
        run = one.run(np.arange(80.0), model.y)
        assert run.failed is None
        assert np.allclose(run.estimates, exact.estimates[0], rtol=1e-8, atol=1e-8)
        assert np.allclose(run.covariances, exact.covariances[0], rtol=1e-8, atol=1e-8)
        assert np.allclose(run.innovations, exact.innovations[0], rtol=1e-8, atol=1e-8, equal_nan=True)
        assert np.allclose(run.nis, exact.nis[0], rtol=1e-8, atol=1e-8)
        assert run.log_likelihood == pytest.approx(exact.log_likelihood[0], rel=1e-9)


@pytest.mark.parametrize(
    "strong",
    [
        None,
        StrongTracking(cap=3.0, factors="single"),
        StrongTracking(cap=3.0, factors="single", fades="process"),
    ],
)
def test_the_root_carries_the_same_covariance(strong) -> None:
    t, _, z = record(200)
    z[::7, 0] = np.nan
    variant = "ukf" if strong is None else "sst-ukf"
    for update in ("joseph", "faded"):
        plain, root = (
            UnscentedFilter(
                pendulum, bob, Q=Q, R=R, P0=P0, x0=X0, variant=variant, strong=strong, square_root=square,
                covariance_update=update, alpha=1.0,
            ).run(t, z)
            for square in (False, True)
        )  # fmt: skip
        assert plain.failed is root.failed is None
        assert np.allclose(plain.estimates, root.estimates, rtol=0.0, atol=1e-9)
        assert np.allclose(plain.covariances, root.covariances, rtol=0.0, atol=1e-9)
    named = UnscentedFilter(pendulum, bob, Q=Q, R=R, P0=P0, x0=X0, variant="srukf", alpha=1.0).run(t, z)
    if strong is None:
        assert np.allclose(plain.covariances, named.covariances, rtol=0.0, atol=1e-9)


def test_the_root_survives_where_a_covariance_cannot() -> None:
    # two states measured 10⁹ times better than they were known: P has a condition of 10¹⁸
    noises = {"Q": np.zeros((2, 2)), "R": 1e-18 * np.eye(1), "P0": np.eye(2)}

    def still(states, u, dt):
        return states

    exact = 0.5  # of (x0 - x1)² / 2 after x0 + x1 was measured
    run = UnscentedFilter(still, np.array([[1.0, 1.0]]), variant="srukf", **noises)
    for _ in range(3):
        run.update([0.0])
        run.predict(1.0)
    direction = np.array([1.0, -1.0])
    assert direction @ run.P @ direction / 4.0 == pytest.approx(exact, rel=1e-9)
    # the variance of the sum is R / 3, nine digits below what P can hold beside 0.5
    along = run._memory.root.T @ np.array([1.0, 1.0])
    assert along @ along == pytest.approx(1e-18 / 3.0, rel=1e-4)


def test_extended_filter_needs_no_jacobians() -> None:
    t, _, z = record(100)
    noises = {"Q": Q, "R": R, "P0": P0, "x0": X0}
    exact = ExtendedFilter(
        pendulum, bob, process_jacobian=pendulum_jacobian, measure_jacobian=bob_jacobian, **noises
    )
    a, b = exact.run(t, z), ExtendedFilter(pendulum, bob, **noises).run(t, z)
    assert np.abs(a.estimates - b.estimates).max() < 1e-7
    # and is another filter than the unscented one
    assert np.abs(a.estimates - UnscentedFilter(pendulum, bob, **noises).run(t, z).estimates).max() > 1e-3


def test_extended_filter_is_that_of_filterpy() -> None:
    filterpy = pytest.importorskip("filterpy.kalman")
    other = filterpy.ExtendedKalmanFilter(3, 2)
    other.x, other.P, other.R = X0[:, None].copy(), P0.copy(), R
    ours = ExtendedFilter(
        pendulum, bob, Q=Q, R=R, P0=P0, x0=X0,
        process_jacobian=pendulum_jacobian, measure_jacobian=bob_jacobian,
    )  # fmt: skip
    _, _, z = record(60)
    for k in range(60):
        F = pendulum_jacobian(other.x[:, 0], None, DT)
        other.x, other.P = pendulum(other.x.T, None, DT).T, F @ other.P @ F.T + Q
        other.update(z[k][:, None], lambda x: bob_jacobian(x[:, 0]), lambda x: bob(x.T).T)
        ours.predict(DT)
        ours.update(z[k])
        assert np.allclose(ours.x, other.x[:, 0], rtol=0.0, atol=1e-10)
        assert np.allclose(ours.P, other.P, rtol=0.0, atol=1e-10)


# -- laws ------------------------------------------------------------------------------------------------


def test_errors_of_a_nonlinear_problem_follow_their_covariance() -> None:
    worlds, looks = 100, [0, 5, 20, 40]
    noises = {"Q": Q, "R": R, "P0": 0.1 * P0, "x0": X0}
    filters = {
        "ukf": UnscentedFilter(pendulum, bob, **noises),
        "srukf": UnscentedFilter(pendulum, bob, variant="srukf", alpha=1.0, **noises),
        "told a third of R": UnscentedFilter(pendulum, bob, **{**noises, "R": R / 3.0}),
    }
    nees = {name: np.empty((worlds, len(looks))) for name in filters}
    for world in range(worlds):
        t, truth, z = record(41, seed=100 + world, spread=0.1 * P0)
        for name, one in filters.items():
            run = one.run(t, z)
            assert run.failed is None
            nees[name][world] = normalised_squares(
                run.estimates[looks] - truth[looks], run.covariances[looks]
            )
    tail = 0.5 * 0.001 / (2 * len(looks))
    low, high = chi2.ppf([tail, 1.0 - tail], 3 * worlds) / worlds
    for name, values in nees.items():
        means = values.mean(axis=0)
        inside = (means > low) & (means < high)
        assert inside.all() if "told" not in name else not inside[1:].any(), (name, means, low, high)


def test_bearings_may_cross_the_seam() -> None:
    # the same scene turned by 3 rad: where one filter wraps, the other does not
    rng = np.random.default_rng(1)
    T = 60
    t = np.arange(T) * 0.1
    course = np.stack([3.0 * np.cos(0.1 * t), 3.0 * np.sin(0.1 * t) - 0.2], axis=1)
    noise = 0.02 * rng.normal(size=T)
    results = []
    for turn in (0.0, 3.0):
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, -s], [s, c]])

        def bearing(states):
            return np.arctan2(states[:, 1], states[:, 0])[:, None]

        truth = course @ rotation.T
        z = np.arctan2(truth[:, 1], truth[:, 0]) + noise
        z = (z + np.pi) % (2.0 * np.pi) - np.pi
        start = rotation @ np.array([3.0, -0.3])
        runs = [
            UnscentedFilter(
                lambda states, u, dt: states, bearing, Q=1e-3 * np.eye(2), R=[[4e-4]], P0=0.1 * np.eye(2),
                x0=start, angles=(0,), variant=variant, alpha=0.5,
                strong=StrongTracking(factors="single") if variant != "ukf" else None,
            ).run(t, z[:, None])
            for variant in ("ukf", "sst-ukf", "st-ukf")
        ]  # fmt: skip
        extended = ExtendedFilter(
            lambda states, u, dt: states, bearing, Q=1e-3 * np.eye(2), R=[[4e-4]], P0=0.1 * np.eye(2),
            x0=start, angles=(0,),
        ).run(t, z[:, None])  # fmt: skip
        results.append([run.estimates @ rotation for run in (*runs, extended)])
        crossed = np.abs(np.diff(z)).max() > 5.0
        assert crossed == (turn == 3.0)
    for here, there in zip(*results, strict=True):
        # the root of a turned covariance is another one: sigma points differ a little
        assert np.allclose(here, there, rtol=0.0, atol=2e-3)


def test_steps_and_records_are_the_same() -> None:
    t, _, z = record(30)
    z[::2] = np.nan
    one = UnscentedFilter(pendulum, bob, Q=lambda dt: Q * dt / DT, R=R, P0=P0, x0=X0)
    t = t + np.where(np.arange(30) % 3 == 1, 0.01, 0.0)
    run = one.run(t, z)
    one.reset()
    for k in range(30):
        if k:
            one.predict(t[k] - t[k - 1])
        if np.isfinite(z[k]).any():
            one.update(z[k])
        assert np.array_equal(one.x, run.estimates[k])
        assert np.array_equal(one.P, run.covariances[k])
    assert one.log_likelihood == run.log_likelihood


def test_sensors_with_their_own_rates() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    slow, fast = np.arange(0.0, 1.0, 0.1) + 1e-4, np.arange(0.25, 0.75, 0.01)
    rows = align_measurements(t, [(slow, np.arange(10.0)), (fast, np.ones((50, 2)))])
    assert rows.shape == (100, 3)
    assert np.flatnonzero(np.isfinite(rows[:, 0])).tolist() == list(range(0, 100, 10))
    assert np.flatnonzero(np.isfinite(rows[:, 1])).tolist() == list(range(25, 75))
    with pytest.raises(InvalidInput, match="measurement rate is above the prediction rate"):
        align_measurements(t, [(np.arange(0.0, 0.9, 0.004), np.zeros(225))])
    with pytest.raises(InvalidInput, match=r"sensor 0.*leave out"):
        align_measurements(t, [([1.3], [0.0])])
    with pytest.raises(InvalidInput, match="increase"):
        align_measurements(t, [([0.2, 0.1], [0.0, 0.0])])
    with pytest.raises(InvalidInput, match="values of sensor 0"):
        align_measurements(t, [([0.2, 0.3], [0.0])])


# -- what goes wrong -------------------------------------------------------------------------------------


def test_a_failure_names_step_and_cause() -> None:
    def breaks(states, u, dt):
        return states * (np.nan if u == 7 else 1.0)

    one = UnscentedFilter(breaks, np.eye(2), Q=np.eye(2), R=np.eye(2), P0=np.eye(2))
    run = one.run(np.arange(12.0), np.zeros((12, 2)), list(range(12)))
    assert run.failed_step == 8
    assert str(run.failed).startswith("at step 8 (8 s): the process gives states that are not finite")
    assert run.log_likelihood == -np.inf
    assert np.isfinite(run.estimates[:8]).all()
    assert np.isnan(run.estimates[8:]).all()
    one.reset()
    with pytest.raises(NumericalFault, match="step 0: the process"):
        one.predict(1.0, 7)
    unseen = UnscentedFilter(
        lambda states, u, dt: states,
        lambda states: np.log(states - 5.0),
        Q=np.eye(1),
        R=np.eye(1),
        P0=np.eye(1),
    )
    with np.errstate(invalid="ignore"):
        assert "predicted measurement is not finite" in str(unseen.run([0.0], [[0.0]]).failed)


GOOD = {"Q": Q, "R": R, "P0": P0}


@pytest.mark.parametrize(
    ("kind", "changed", "message"),
    [
        (UnscentedFilter, {"R": np.diag([0.0, 1.0])}, "variance must be positive"),
        (UnscentedFilter, {"R": np.diag([-1.0, 1.0])}, "variance must be positive"),
        (UnscentedFilter, {"Q": np.diag([-1.0, 1.0, 1.0])}, "must not be negative"),
        (UnscentedFilter, {"P0": np.diag([-1.0, 1.0, 1.0])}, "must not be negative"),
        (UnscentedFilter, {"P0": np.ones((3, 2))}, "square"),
        (UnscentedFilter, {"Q": np.eye(2)}, "Q"),
        (UnscentedFilter, {"x0": [1.0]}, "x0.*give 3 states"),
        (UnscentedFilter, {"alpha": 0.0}, "alpha"),
        (UnscentedFilter, {"beta": -1.0}, "beta"),
        (UnscentedFilter, {"kappa": -3.0}, "kappa.*more than -3"),
        (UnscentedFilter, {"angles": (2,)}, "angles.*0 to 1"),
        (UnscentedFilter, {"strong": StrongTracking()}, "sst-ukf"),
        (UnscentedFilter, {"variant": "sstukf"}, "did you mean 'sst-ukf'"),
        (UnscentedFilter, {"covariance_update": "josef"}, "did you mean 'joseph'"),
        (ExtendedFilter, {"process_jacobian": np.eye(3)}, "process_jacobian"),
    ],
)
def test_bad_settings_are_one_clear_error(kind, changed, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        kind(pendulum, bob, **{**GOOD, **changed})


def test_bad_records_are_one_clear_error() -> None:
    one = UnscentedFilter(pendulum, bob, **GOOD)
    with pytest.raises(InvalidInput, match=r"times\[2\].*increase"):
        one.run([0.0, 0.1, 0.1], np.zeros((3, 2)))
    with pytest.raises(InvalidInput, match=r"measurements.*give \(3, 2\)"):
        one.run([0.0, 0.1, 0.2], np.zeros((3, 3)))
    with pytest.raises(InvalidInput, match="infinite"):
        one.run([0.0], [[np.inf, 0.0]])
    with pytest.raises(InvalidInput, match=r"inputs.*length 1"):
        one.run([0.0, 0.1], np.zeros((2, 2)), [0])
    with pytest.raises(InvalidInput, match=r"dt.*positive"):
        one.predict(0.0)
    with pytest.raises(InvalidInput, match=r"z.*2 channels"):
        one.update([0.0])
    with pytest.raises(InvalidInput, match=r"process.*result of shape"):
        UnscentedFilter(lambda s, u, dt: s[:, :2], bob, **GOOD).predict(0.1)
    with pytest.raises(InvalidInput, match=r"measure.*result of shape"):
        UnscentedFilter(pendulum, lambda s: s[:, 0], **GOOD).update([0.0, 0.0])
    with pytest.raises(UnknownName, match="variant"):
        UnscentedFilter(pendulum, bob, variant="ekf", **GOOD)
    with pytest.raises(InvalidInput, match=r"measure.*give a matrix \(2, 3\)"):
        UnscentedFilter(pendulum, np.eye(3), **GOOD)
