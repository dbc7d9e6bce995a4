"""Pushing distance: the model of Zhang et al. 2016, both cases, and the encodings of the paper."""

from __future__ import annotations

import numpy as np
import pytest

import navopt
from navopt.algorithms import FruitFly
from navopt.errors import InvalidInput, UnknownName
from navopt.problems import NoiseEstimate, PushingDistance, integrate_twice
from navopt.problems.pushing_worlds import stroke_acceleration


def test_model_is_the_papers() -> None:
    world = navopt.simulate("pushing-distance", 1)
    model, h = world.model, 0.1
    assert np.array_equal(model.F, [[1.0, h], [0.0, 1.0]])
    assert np.allclose(model.B, [[0.5 * h * h], [h]])
    assert np.array_equal(model.G, model.B)
    assert np.array_equal(model.H, [[1.0, 0.0]])
    assert model.u[:, 0] == pytest.approx(9.81 * np.sin(np.arange(1000) / 5.0))
    # the true states follow eq. (12) with an acceleration noise of the declared variance
    states = world.truth.states
    w = (states[1:] - states[:-1] @ model.F.T)[:, 1] / h - model.u[:-1, 0]
    assert np.var(w) == pytest.approx(1.0, rel=0.2)
    assert np.var(model.y[:, 0] - states[:, 0]) == pytest.approx(0.25, rel=0.2)


def test_paper_filter_step_by_step() -> None:
    # equations (1) to (6), written out with the printed matrices
    world = navopt.simulate("pushing-distance", 2, steps=50, noise_input="states")
    model, Q, R = world.model, 0.3, 0.7
    x, P = model.x0, model.P0
    run = world.filter.run(Q * np.eye(2), [[R]])
    for k in range(50):
        if k:
            x = model.F @ x + model.B[:, 0] * model.u[k - 1, 0]
            P = model.F @ P @ model.F.T + Q * np.eye(2)
        gain = P @ model.H.T / (model.H @ P @ model.H.T + R)
        x = x + gain[:, 0] * (model.y[k, 0] - x[0])
        P = (np.eye(2) - gain @ model.H) @ P
        assert run.estimates[0, k] == pytest.approx(x, rel=1e-9, abs=1e-9)


def test_oracle_is_the_error_of_the_position() -> None:
    world = navopt.simulate("pushing-distance", 3, objective="oracle")
    assert world.scored_states == (0,)
    x = np.array([0.2, -0.4])
    scores = world.score(world.estimate(x))
    assert float(world.loss(x)) == pytest.approx(scores["position_rmse_m"] ** 2)
    run = world.filter.run(*world.covariances(x))
    assert scores["final_position_error_m"] == pytest.approx(
        abs(run.estimates[0, -1, 0] - world.truth.states[-1, 0])
    )


def test_likelihood_finds_the_level_that_the_oracle_cannot() -> None:
    likely = navopt.simulate("pushing-distance", 4)
    solution = navopt.solve(likely, "nelder-mead", budget=150)
    bound = np.sqrt(np.diag(likely.error_bound()))
    assert (np.abs(solution.x - likely.true_x) < 4.0 * bound).all()
    assert solution.apply(likely.redraw(0))["state_rmse_ratio_1"] < 1.02
    oracle = navopt.simulate("pushing-distance", 4, objective="oracle")
    level = np.array([[0.0, 0.0], [2.0, 2.0]])
    losses = oracle.loss(oracle.true_x + level)
    assert losses[1] == pytest.approx(losses[0], rel=0.05)


def test_the_raw_encoding_takes_the_papers_flies() -> None:
    world = navopt.simulate(
        "pushing-distance", 5, steps=200, objective="oracle", encoding="raw", box=(-5.0, 5.0)
    )
    assert world.parameter_names == ("q", "r")
    assert np.isinf(world.loss(np.array([[-0.1, 1.0], [1.0, -0.1]]))).all()
    flies = navopt.solve(world, FruitFly.published(), budget=420, seed=1)
    # their candidates are reciprocal distances: never negative, so none is lost
    assert flies.invalid == {}
    assert np.isfinite(flies.loss)
    particles = navopt.solve(world, "pso-001", budget=420, seed=1)
    assert sum(particles.invalid.values()) > 0


def test_stroke_goes_where_it_should() -> None:
    a = stroke_acceleration(1000, 0.01, stroke=0.5, ramp=1.0, rest=1.0)
    v = np.r_[0.0, np.cumsum(a)[:-1] * 0.01]
    p = np.r_[0.0, np.cumsum(v * 0.01 + 0.5 * a * 1e-4)[:-1]]
    assert p[-1] == pytest.approx(0.5, rel=1e-12)
    assert v[-1] == pytest.approx(0.0, abs=1e-15)
    assert (v >= -1e-15).all()
    assert not a[:100].any()
    with pytest.raises(InvalidInput, match=r"must fit into 9\.99 s"):
        stroke_acceleration(1000, 0.01, stroke=0.5, ramp=4.0, rest=1.0)


def test_stroke_needs_more_than_integration() -> None:
    # figures 9B and 10A: the integrated acceleration leaves for metres, the tuned filter stays
    world = navopt.simulate("pushing-distance", 6, case="stroke")
    true = world.truth.states
    assert true[-1, 0] == pytest.approx(0.5, abs=0.05)
    integrated = integrate_twice(world)
    assert abs(integrated[-1, 0] - true[-1, 0]) > 1.0
    tuned = navopt.solve(world, "nelder-mead", budget=150)
    scores = tuned.apply(world.redraw(0))
    assert scores["position_rmse_m"] < 0.5 * np.std(world.model.y[:, 0] - true[:, 0])
    assert scores["nis_1"] == pytest.approx(1.0, abs=0.2)
    # the variance of the noise alone does not cover the bias
    assert world.score(world.truth)["nees_1"] > 10.0
    assert set(world.illustration()) == {"measured_m", "integrated_m", "true_m"}
    without = navopt.simulate("pushing-distance", 6, case="stroke", accelerometer_bias=0.0)
    assert without.score(without.truth)["nis_1"] == pytest.approx(1.0, abs=0.2)


def test_a_twin_is_the_same_push() -> None:
    world = navopt.simulate("pushing-distance", 7, case="stroke", steps=500)
    twin = world.redraw(2)
    assert type(twin) is PushingDistance
    assert not np.isclose(twin.model.y, world.model.y).any()
    # the course is the same, but for where it begins
    assert np.allclose(np.diff(twin.truth.states[:, 1]), np.diff(world.truth.states[:, 1]))


def test_scores_of_a_filter_that_fails() -> None:
    world = navopt.simulate("pushing-distance", 0, steps=30)
    scores = world.score(NoiseEstimate(-np.eye(1), np.eye(1)))
    assert scores["position_rmse_m"] == scores["final_position_error_m"] == np.inf


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        ({"case": "pull"}, "case: .*'pull'"),
        ({"noise_input": "position"}, "noise_input: .*'position'"),
        ({"case": "stroke", "noise_input": "states"}, "the stroke has"),
        ({"interval_s": 0.0}, "interval_s: got 0.0"),
        ({"amplitude": np.nan}, "amplitude: got nan"),
    ],
)
def test_scenarios_are_checked(scenario, message) -> None:
    with pytest.raises(InvalidInput, match=message):
        navopt.simulate("pushing-distance", **scenario)
    with pytest.raises(UnknownName, match="known"):
        navopt.simulate("pushing-distance", covariance="none")
