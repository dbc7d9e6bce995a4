"""The match of a window: its posterior in closed form, its modes, its covariance, and its rivals."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy import stats

from baselines import TrackEstimate, WindowMAP
from navopt import simulate, solve
from navopt.errors import InvalidInput, NoBound, UnknownName
from navopt.models.earth import local_tangent_plane, separation
from navopt.models.field_map import FieldMap
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.problems.gravity_window import window_error_bound, window_posterior

LEVEL = 0.001  # one statistical check in this file


@pytest.fixture(scope="module")
def world():
    return simulate("gravity-matching", 0, hours=3.0)


def on(field, world, **options):
    if not {"position_covariance", "prior_covariance"} & set(options):
        options["position_covariance"] = world.position_covariance
    return GravityMatching(field, world.track, window=world.window, **options)


def surface(world, function):
    rows, columns = np.meshgrid(world.field_map.latitude, world.field_map.longitude, indexing="ij")
    north, east = local_tangent_plane(rows, columns, *world.origin)
    return FieldMap(rows[:, 0], columns[0], function(north, east))


def plane(world):
    return surface(world, lambda north, east: 3e-3 * north - 1e-3 * east)


def displacement(estimate, problem):
    """Moved samples minus inertial ones on the problem's plane, m, flat (n_1, e_1, …)."""
    moved = local_tangent_plane(estimate.latitude, estimate.longitude, *problem.origin)
    return (np.stack(moved, axis=-1) - problem.sequence).ravel()


def design(window, gradient):
    return np.kron(np.eye(window), np.asarray(gradient))


def test_over_a_plane_field_it_is_the_linear_estimate_with_the_whole_covariance(world):
    problem = on(plane(world), world, noise=0.5)
    estimate = WindowMAP().match(problem)
    prior, h = world.position_covariance, design(world.window, [3e-3, -1e-3])
    surprise = problem.measured - problem.field_map.value(*(v[-12:] for v in places(world)))
    # true position = inertial + d with d ~ N(0, prior); measured = h(inertial) + H d + noise
    gain = prior @ h.T @ np.linalg.inv(h @ prior @ h.T + 0.25 * np.eye(world.window))
    np.testing.assert_allclose(displacement(estimate, problem), gain @ surprise, atol=15.0)
    covariance = prior - gain @ h @ prior
    for k in range(world.window):
        block = covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
        np.testing.assert_allclose(estimate.covariance[k], block, rtol=5e-3, atol=200.0)


def places(world):
    return world.track.latitude, world.track.longitude


def test_with_a_prior_of_four_parameters_it_is_the_linear_estimate_of_these(world):
    prior = np.diag([2e3, 1e3, 0.01, 0.01]) ** 2
    box = np.array([[-5e4, 5e4], [-5e4, 5e4], [-1.0, 1.0], [0.2, 3.0]])
    problem = on(plane(world), world, prior_covariance=prior, noise=2.0, box=box)
    estimate = WindowMAP().match(problem)
    q = problem.sequence
    moves = np.zeros((2 * world.window, 4))
    moves[0::2, 0] = moves[1::2, 1] = 1.0
    moves[0::2, 2], moves[1::2, 2] = -q[:, 1], q[:, 0]
    moves[:, 3] = q.ravel()
    h = design(world.window, [3e-3, -1e-3]) @ moves
    surprise = problem.measured - problem.field_map.value(*(v[-12:] for v in places(world)))
    gain = prior @ h.T @ np.linalg.inv(h @ prior @ h.T + 4.0 * np.eye(world.window))
    np.testing.assert_allclose(displacement(estimate, problem), moves @ gain @ surprise, atol=15.0)
    # and the answer in the problem's own parameters
    change = solve(problem, "window-map").x - [0.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(change[:2], (gain @ surprise)[:2], atol=15.0)


def test_an_unknown_offset_is_estimated_along(world):
    raised = GravityMatching(
        plane(world), world.track, position_covariance=world.position_covariance,
        measurement_errors=MeasurementErrors(noise=0.5, bias=30.0),
    )  # fmt: skip
    p = window_posterior(raised)
    found = p.fit(np.zeros(p.n_coefficients))[0]
    prior, h = world.position_covariance, design(world.window, [3e-3, -1e-3])
    surprise = raised.measured - raised.field_map.value(*(v[-12:] for v in places(world)))
    total = h @ prior @ h.T + 0.25 * np.eye(world.window) + 900.0
    assert p.names[-1] == "bias"
    assert 30.0 * found[-1] == pytest.approx(900.0 * np.linalg.solve(total, surprise).sum(), abs=0.05)


def test_two_places_that_look_alike_are_both_found(world):
    """A field that is symmetric about the inertial track: the truth may be on either side."""
    q = world.sequence
    along = q[-1] - q[0]
    across = np.array([-along[1], along[0]]) / np.hypot(*along)
    field = surface(world, lambda north, east: 20.0 * np.cos((across[0] * north + across[1] * east) / 6e3))
    measured = world.track.measured.copy()
    measured[-world.window :] = 20.0 * np.cos(1.0)
    track = world.track
    track = type(track)(
        time=track.time, latitude=track.latitude, longitude=track.longitude, measured=measured
    )
    prior = np.diag([6e3, 6e3, 0.01, 0.01]) ** 2
    problem = GravityMatching(field, track, prior_covariance=prior, noise=1.0, method="bicubic")
    estimate = WindowMAP().match(problem)
    assert not estimate.knows
    assert 0.35 < estimate.probability < 0.65
    assert 10e3 < estimate.next_distance_m < 14e3
    assert abs(estimate.next_cost) < 0.5
    # the covariance of the answer covers the other place
    spread = across @ estimate.covariance[-1] @ across
    assert spread > 0.3 * estimate.next_distance_m**2
    middle = WindowMAP(answer="mean").match(problem)
    away = np.stack(separation(middle.latitude[-1], middle.longitude[-1], *(v[-1] for v in places(world))))
    assert abs(away @ across) < 2500.0


def test_over_a_constant_field_it_says_that_it_does_not_know(world):
    problem = on(surface(world, lambda north, east: 0.0 * north + 5.0), world)
    estimate = WindowMAP(gate_sigma_m=1e6).match(problem)
    assert not estimate.knows
    assert estimate.gain == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(displacement(estimate, problem), 0.0, atol=1e-6)


def test_reported_errors_are_consistent_over_worlds():
    total, count = 0.0, 40
    for seed in range(count):
        problem = simulate("gravity-matching", seed, hours=3.0)
        estimate = WindowMAP().match(problem)
        truth = problem.truth
        error = np.array(
            separation(estimate.latitude[-1], estimate.longitude[-1], truth.latitude[-1], truth.longitude[-1])
        )
        total += float(error @ np.linalg.solve(estimate.covariance[-1], error))
    low, high = stats.chi2.ppf([LEVEL / 2, 1 - LEVEL / 2], 2 * count)
    assert low < total < high


@lru_cache(maxsize=1)
def errors_of_both():
    ours, swarm, cost = [], [], []
    for seed in range(6):
        problem = simulate("gravity-matching", seed, hours=3.0)
        solution = solve(problem, "window-map")
        ours.append(solution.scores["position_error_m"])
        cost.append(solution.counts.cost)
        swarm.append(solve(problem, "affine-abc", budget=5000, seed=seed).scores["position_error_m"])
    return np.array(ours), np.array(swarm), np.array(cost)


def test_it_beats_the_swarm_with_fewer_look_ups():
    ours, swarm, cost = errors_of_both()
    assert ours.mean() < swarm.mean()
    assert cost.max() < 5000


def test_the_estimate_is_attached_and_counted(world):
    solution = solve(world, "window-map")
    assert isinstance(solution.estimate, TrackEstimate)
    np.testing.assert_array_equal(solution.x, world.project(solution.estimate))
    assert solution.counts.loss == 1
    assert solution.counts.internal > 2048
    assert solution.estimate.used == world.window
    np.testing.assert_array_equal(solution.estimate.track_latitude, solution.estimate.latitude)
    assert solution.fitted.apply(world).sigma_m == solution.estimate.sigma_m


@pytest.mark.parametrize("budget", [1, 5, 60, 700])
def test_a_budget_is_kept(world, budget):
    solution = solve(world, "window-map", budget=budget)
    assert solution.counts.cost <= budget
    assert np.isfinite(solution.loss)
    if budget == 1:
        assert solution.estimate.used == 0
        np.testing.assert_allclose(solution.estimate.latitude, world.track.latitude[-12:], atol=1e-15)


def test_the_bound_is_the_inverse_of_the_information(world):
    problem = on(plane(world), world, noise=0.5)
    bound = window_error_bound(problem)
    h = design(world.window, [3e-3, -1e-3])
    prior = world.position_covariance
    covariance = prior - prior @ h.T @ np.linalg.inv(h @ prior @ h.T + 0.25 * np.eye(12)) @ h @ prior
    for k in range(world.window):
        block = covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
        np.testing.assert_allclose(bound[k], block, rtol=5e-3, atol=200.0)
    track = world.track
    recorded = type(track)(
        time=track.time, latitude=track.latitude, longitude=track.longitude, measured=track.measured
    )
    blind = GravityMatching(plane(world), recorded, position_covariance=prior, noise=0.5)
    with pytest.raises(NoBound, match="truth"):
        window_error_bound(blind)
    there = track.true_latitude, track.true_longitude
    np.testing.assert_array_equal(window_error_bound(blind, at=there), bound)


def test_options_are_checked():
    with pytest.raises(InvalidInput, match="points"):
        WindowMAP(points=0)
    with pytest.raises(UnknownName, match="answer"):
        WindowMAP(answer="best")
    with pytest.raises(UnknownName, match="sigma"):
        WindowMAP(measurement_errors={"sigma": 1.0})
    with pytest.raises(InvalidInput, match="huber"):
        WindowMAP(huber=-1.0)
