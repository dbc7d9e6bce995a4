"""What the objectives of noise tuning see of Q and R: closed forms, another filter, and the words for it."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from navopt import simulate
from navopt.errors import InvalidInput
from navopt.problems import NoiseTuning
from navopt.problems.noise_estimate import NoiseTruth


def test_white_measurements_tell_their_variance_as_a_chi_square_does():
    """A state that stands still and is known: T measurements of variance r hold T/2 about ln r."""
    rng = np.random.default_rng(1)
    steps = 40
    problem = NoiseTuning(
        [[1.0]],
        [[1.0]],
        rng.normal(size=(steps, 1)),
        x0=[0.0],
        P0=[[0.0]],
        covariance="fixed",
        Q_reference=[[0.0]],
        measurement_covariance="scalar",
    )
    found = problem.identifiability([0.3])
    expected = 1.0 / np.sqrt(0.5 * steps * np.log(10.0) ** 2)
    assert found.sigma["log10_r"] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("seed", [0, 5])
def test_the_likelihood_tells_both_and_as_well_as_the_bound(seed):
    problem = simulate("pushing-distance", seed, steps=300)
    found = problem.identifiability()
    assert found.complete
    bound = np.sqrt(np.diag(problem.error_bound()))
    np.testing.assert_allclose(list(found.sigma.values()), bound, rtol=1e-9)


def test_the_error_tells_the_ratio_only_and_says_so():
    found = simulate("pushing-distance", 1, steps=300, objective="oracle").identifiability()
    assert (found.rank, found.complete) == (1, False)
    (null,) = found.null_directions
    assert null.coefficients == pytest.approx({"log10_q": 1.0, "log10_r": 1.0}, rel=1e-6)
    assert null.words.endswith("the scale of Q and R together, only their ratio is told")
    assert np.isinf(null.sigma)
    assert "not told" in found.report()


def test_the_words_do_not_hang_on_the_prior_covariance():
    """The first steps of a filter with a fixed prior depend on the level: not the record's doing."""
    for sigma in ((1e-3, 1e-3), (30.0, 30.0)):
        world = simulate("pushing-distance", 2, steps=300, objective="oracle", initial_sigma=sigma)
        assert world.identifiability().rank == 1


def test_independent_axes_have_a_ratio_each():
    world = simulate("noise-tuning", 1, steps=400, axes=2, covariance="diagonal", objective="oracle")
    found = world.identifiability()
    assert found.rank == 2
    words = [direction.words for direction in found.null_directions]
    assert [set(d.coefficients) for d in found.null_directions] == [
        {"log10_q_0", "log10_r_0"},
        {"log10_q_1", "log10_r_1"},
    ]
    assert all("their common scale" in text for text in words)


def test_a_known_level_of_r_leaves_nothing_open():
    world = simulate("noise-tuning", 1, steps=400, objective="oracle")
    model = world.model
    fixed = NoiseTuning(
        model.F, model.H, model.y, G=model.G, P0=model.P0, measurement_covariance="fixed",
        R_reference=world.truth.R, objective="oracle", truth=world.truth,
    )  # fmt: skip
    assert fixed.identifiability().complete


def test_raw_scales_have_the_same_null_direction():
    found = simulate("pushing-distance", 1, steps=300, objective="oracle", encoding="raw").identifiability()
    assert found.rank == 1
    # along q : r = 1 : 0.25, the true variances
    assert found.null_directions[0].coefficients == pytest.approx({"q": 1.0, "r": 0.25}, rel=1e-5)


def filterpy_states(model, q, r):
    kalman = KalmanFilter(dim_x=2, dim_z=1)
    kalman.F, kalman.H = model.F, model.H
    kalman.Q, kalman.R = q * model.G @ model.G.T, np.array([[r]])
    kalman.x, kalman.P = model.x0[:, None].copy(), model.P0.copy()
    out = []
    for k, y in enumerate(model.y):
        if k:
            kalman.predict()
            kalman.x = kalman.x + model.drive[k - 1][:, None]
        kalman.update(y)
        out.append(kalman.x[:, 0].copy())
    return np.array(out), kalman.P


def test_the_slope_of_the_states_is_that_of_another_filter():
    world = simulate("pushing-distance", 3, steps=600, objective="oracle")
    slopes = world.sensitivity(world.true_x)
    q, r = 1.0, 0.25
    factor = 10.0**1e-3
    scaled = (factor, 1.0, 1.0 / factor)
    (more, _), (_, P), (less, _) = (filterpy_states(world.model, q * f, r) for f in scaled)
    expected = (more - less)[-len(slopes) :, 0] / 2e-3 / np.sqrt(P[0, 0])
    assert 300 < len(slopes) < 600
    np.testing.assert_allclose(slopes[:, 0], expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())


def test_five_seconds_of_alignment_tell_nothing_and_five_minutes_something():
    short = simulate("static-alignment", 0, duration_s=5.0, step_s=0.05).identifiability()
    long = simulate("static-alignment", 0, duration_s=300.0, step_s=1.0).identifiability()
    assert (short.rank, long.rank) == (0, 2)
    for found in (short, long):
        assert np.isinf(found.sigma["log10_q_phi_u"])


def test_a_record_without_truth_is_judged_by_its_innovations():
    world = simulate("noise-tuning", 4, steps=300)
    model = world.model
    own = NoiseTuning(model.F, model.H, model.y, G=model.G, P0=model.P0)
    assert own.truth is None
    assert own.identifiability().complete


def test_a_point_where_the_filter_fails_is_refused():
    world = simulate("pushing-distance", 1, steps=60, objective="oracle", encoding="raw")
    with pytest.raises(InvalidInput, match="give a point where the filter works"):
        world.sensitivity([-1.0, 1.0])


@pytest.mark.parametrize(
    ("Q", "R", "message"),
    [
        (np.eye(2), np.eye(1), r"truth\.Q: got shape \(2, 2\)"),
        (np.eye(1), np.eye(2), r"truth\.R: got shape \(2, 2\)"),
        (np.ones(1), np.eye(1), r"truth\.Q"),
        (np.ones((7, 1, 1)), np.eye(1), r"truth\.Q: got shape \(7, 1, 1\).*\(50, 1, 1\)"),
        (np.eye(1), -np.eye(1), r"truth\.R"),
        (np.full((1, 1), np.nan), np.eye(1), r"truth\.Q"),
        (np.eye(1), None, "only one of Q and R"),
    ],
)
def test_a_truth_that_does_not_fit_is_refused_by_name(Q, R, message):
    model = simulate("noise-tuning", 0, steps=50).model
    with pytest.raises(InvalidInput, match=message):
        NoiseTuning(model.F, model.H, model.y, G=model.G, truth=NoiseTruth(np.zeros((50, 2)), Q, R))
