"""The filter in the long run: Riccati equation, alpha-beta filter, and the batched filter itself."""

from __future__ import annotations

import numpy as np
import pytest

import navopt
from navopt.errors import InvalidInput
from navopt.filters.information import fisher_information
from navopt.filters.steady_state import alpha_beta, steady_state


@pytest.mark.parametrize(("q", "r", "h"), [(1.0, 0.25, 0.1), (1e-9, 4.0, 0.01), (1e6, 1e-4, 2.0)])
def test_alpha_beta_is_the_steady_gain(q, r, h) -> None:
    F, G, H = np.array([[1.0, h], [0.0, 1.0]]), np.array([[0.5 * h * h], [h]]), np.array([[1.0, 0.0]])
    settled = steady_state(F, H, [[q]], [[r]], G=G)
    alpha, beta = alpha_beta(q, r, h)
    assert settled.gain[:, 0] == pytest.approx([alpha, beta / h], rel=1e-6)
    # of the closed form itself: Kalata's relation
    assert (h * h * np.sqrt(q / r)) ** 2 == pytest.approx(beta**2 / (1.0 - alpha), rel=1e-5)
    assert settled.covariance[0, 0] == pytest.approx(alpha * r, rel=1e-6)


def test_the_batched_filter_settles_there() -> None:
    world = navopt.simulate("pushing-distance", 0)
    model, Q, R = world.model, world.truth.Q, world.truth.R
    settled = steady_state(model.F, model.H, Q, R, G=model.G)
    run = world.filter.run(Q, R)
    assert np.allclose(run.predicted_covariances[0, -1], settled.predicted_covariance, rtol=1e-9)
    assert np.allclose(run.covariances[0, -1], settled.covariance, rtol=1e-9)
    assert np.allclose(run.innovation_covariances[0, -1], settled.innovation_covariance, rtol=1e-9)
    alpha, beta = alpha_beta(float(Q[0, 0]), float(R[0, 0]), 0.1)
    gain = run.covariances[0, -1] @ model.H.T / R[0, 0]
    assert gain[:, 0] == pytest.approx([alpha, beta / 0.1], rel=1e-9)


def test_information_of_a_long_record_is_whittles() -> None:
    # a random walk seen through noise: differences of y are a moving average with spectrum q + r |1 - e^iw|²
    q, r, steps = 0.3, 0.8, 4000
    model = navopt.models.LinearGaussianModel(F=np.eye(1), H=np.eye(1), y=np.zeros(steps), P0=np.eye(1))
    one, none = np.ones((1, 1)), np.zeros((1, 1))
    ours = fisher_information(model, [[q]], [[r]], directions_Q=[one, none], directions_R=[none, one])
    w = 2.0 * np.pi * (np.arange(20000) + 0.5) / 20000
    gain = np.abs(1.0 - np.exp(1j * w)) ** 2
    slopes = np.stack([np.ones_like(w), gain]) / (q + r * gain)
    expected = 0.5 * steps * slopes @ slopes.T / len(w)
    assert np.allclose(ours, expected, rtol=3e-3)


def test_information_is_the_mean_curvature_of_the_likelihood() -> None:
    # 400 records; standard errors of the means make the band
    scores = []
    for seed in range(400):
        world = navopt.simulate("noise-tuning", seed, steps=60, missing_fraction=0.2)
        scores.append(-world.gradient(world.true_x) * np.isfinite(world.model.y).sum())
    scores = np.array(scores)
    # the missing samples differ from record to record, the information hardly
    expected = np.linalg.inv(world.error_bound())
    assert np.abs(scores.mean(axis=0) / scores.std(axis=0) * 20.0).max() < 4.0
    assert np.allclose(scores.T @ scores / 400, expected, rtol=0.35, atol=0.05 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"F": np.ones((2, 3))}, "F: got shape"),
        ({"F": np.ones((4, 2, 2))}, "F: .*must be constant"),
        ({"H": np.ones((1, 3))}, "H: got shape"),
        ({"F": np.array([[1.0, np.nan], [0.0, 1.0]])}, r"F\[0, 1\]"),
        ({"G": np.ones((3, 1))}, "G: got shape"),
        ({"Q": np.diag([1.0, -1.0])}, r"Q\[1, 1\]"),
        ({"R": np.zeros((1, 1))}, r"R\[0, 0\]"),
        ({"F": np.diag([1.0, 2.0])}, "no stabilising solution"),
    ],
)
def test_what_cannot_be_used_is_named(change, message) -> None:
    given = {"F": np.eye(2), "H": np.array([[1.0, 0.0]]), "Q": np.eye(2), "R": np.eye(1), **change}
    with pytest.raises(InvalidInput, match=message):
        steady_state(given["F"], given["H"], given["Q"], given["R"], G=given.get("G"))
    with pytest.raises(InvalidInput, match=r"interval: got 0\.0"):
        alpha_beta(1.0, 1.0, 0.0)
