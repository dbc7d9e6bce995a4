"""Discretisation against closed forms, quadrature and scipy's own exponential."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.signal import cont2discrete

from navopt.errors import InvalidInput
from navopt.models.static_alignment import AlignmentModel, StaticSite, error_dynamics
from navopt.models.van_loan import discretise, discretise_first_order


@pytest.mark.parametrize("step", [1e-3, 0.7, 40.0])
def test_a_double_integrator_has_its_textbook_covariance(step: float) -> None:
    transition, covariance = discretise([[0, 1], [0, 0]], [[0, 0], [0, 2.5]], step)
    np.testing.assert_allclose(transition, [[1, step], [0, 1]], rtol=1e-14, atol=1e-15)
    expected = 2.5 * np.array([[step**3 / 3, step**2 / 2], [step**2 / 2, step]])
    np.testing.assert_allclose(covariance, expected, rtol=1e-12)


def test_a_decaying_state_has_its_closed_form_and_settles_at_the_lyapunov_solution() -> None:
    rate, density = 0.3, 1.7
    for step in (0.01, 2.0, 100.0):
        transition, covariance = discretise([[-rate]], [[density]], step)
        assert transition[0, 0] == pytest.approx(np.exp(-rate * step), rel=1e-12, abs=1e-300)
        expected = density * -np.expm1(-2 * rate * step) / (2 * rate)
        assert covariance[0, 0] == pytest.approx(expected, rel=1e-12)
    F = np.array([[-0.5, 0.2], [-0.1, -0.4]])
    W = np.array([[1.0, 0.3], [0.3, 2.0]])
    settled = solve_continuous_lyapunov(F, -W)
    np.testing.assert_allclose(discretise(F, W, 50.0)[1], settled, rtol=1e-9)


def test_random_systems_agree_with_quadrature_and_scipy() -> None:
    rng = np.random.default_rng(5)
    F = rng.normal(size=(4, 5, 5))
    root = rng.normal(size=(4, 5, 3))
    W = root @ root.transpose(0, 2, 1)
    transition, covariance = discretise(F, W, 0.4)
    for k in range(4):
        np.testing.assert_allclose(
            transition[k], cont2discrete((F[k], root[k], np.eye(5), 0), 0.4)[0], rtol=1e-11, atol=1e-13
        )
        expected, _ = quad_vec(
            lambda s, k=k: expm(F[k] * s) @ W[k] @ expm(F[k] * s).T, 0.0, 0.4, epsabs=1e-13, epsrel=1e-13
        )
        np.testing.assert_allclose(covariance[k], expected, rtol=1e-10, atol=1e-11)
        assert (covariance[k] == covariance[k].T).all()
    alone = discretise(F[2], W[2], 0.4)
    np.testing.assert_allclose(alone[1], covariance[2], rtol=1e-13)


def test_tiny_noise_is_not_lost_beside_a_fast_system() -> None:
    """Angle noise of 1e-15 rad^2/s reaches the velocity through gravity: g^2 q h^3 / 3."""
    g, q, step = 9.8, 1e-15, 0.01
    _, covariance = discretise([[0, g], [0, 0]], [[0, 0], [0, q]], step)
    expected = q * np.array([[g * g * step**3 / 3, g * step**2 / 2], [g * step**2 / 2, step]])
    np.testing.assert_allclose(covariance, expected, rtol=1e-12)


def test_steps_compose() -> None:
    site = StaticSite(latitude=0.7)
    F = error_dynamics(site)
    W = np.diag([1e-8] * 2 + [1e-13] * 3 + [0.0] * 5)
    one, small = discretise(F, W, 1.0)
    two, large = discretise(F, W, 2.0)
    np.testing.assert_allclose(two, one @ one, rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(large, one @ small @ one.T + small, rtol=1e-8, atol=1e-22)


def test_first_order_converges_but_for_the_double_integral() -> None:
    F = np.array([[-0.5, 0.2], [-0.1, -0.4]])
    W = np.array([[1.0, 0.3], [0.3, 2.0]])
    gaps = []
    for step in (0.1, 0.05):
        exact, rough = discretise(F, W, step), discretise_first_order(F, W, step)
        gaps.append([np.abs(a - b).max() for a, b in zip(exact, rough, strict=True)])
    # third order both: half the step, an eighth of the error
    np.testing.assert_allclose(np.array(gaps[0]) / gaps[1], 8.0, rtol=0.1)
    _, rough = discretise_first_order([[0, 1], [0, 0]], [[0, 0], [0, 1.0]], 2.0)
    assert rough[0, 0] == pytest.approx(1.5 * 8.0 / 3.0)


def test_the_sources_of_the_alignment_model_add_up() -> None:
    site = StaticSite(latitude=0.7, height=100.0)
    model = AlignmentModel.of(site, 0.5)
    W = np.diag([4e-8] * 2 + [9e-14] * 3 + [0.0] * 5)
    transition, covariance = discretise(error_dynamics(site), W, 0.5)
    np.testing.assert_allclose(model.transition, transition, rtol=1e-13)
    np.testing.assert_allclose(
        model.process_covariance(2e-4, 3e-7), covariance[:5, :5], rtol=1e-9, atol=1e-9 * 9e-14
    )
    assert not covariance[5:].any()


@pytest.mark.parametrize(
    ("F", "W", "step", "name"),
    [
        (np.zeros((2, 3)), np.eye(2), 1.0, "F"),
        (np.eye(2), np.eye(3), 1.0, "density"),
        (np.eye(2), [[1.0, np.nan], [0.0, 1.0]], 1.0, r"density\[0, 1\]"),
        (np.eye(2), np.eye(2), 0.0, "step"),
        (np.eye(2), np.eye(2), -1.0, "step"),
    ],
)
def test_bad_input_is_named(F, W, step, name) -> None:
    with pytest.raises(InvalidInput, match=name):
        discretise(F, W, step)
