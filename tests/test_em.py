"""Expectation maximisation: moments against joint conditioning, monotone, and where it ends."""

from __future__ import annotations

import numpy as np
import pytest
from noise_tools import covariance, joint_log_likelihood, pushing, random_model

import navopt
from baselines.em_steps import expected_noises, fit_em
from baselines.likelihood_fit import fit_innovation_likelihood
from baselines.noise_structure import NoisePart, NoiseStructure
from navopt.errors import UnsuitableProblem
from navopt.models.linear_gaussian import LinearGaussianModel

PUSHING = NoiseStructure.of("scalar", [[4.0]], [[0.5]])


def conditioned(model: LinearGaussianModel, Q: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean moments of the noises by conditioning one big normal vector (x0, w, v) on the measurements."""
    steps, n, m, g = model.n_steps, model.n_states, model.n_measurements, model.n_noises
    F, H, G = (np.broadcast_to(M, (steps, *M.shape[-2:])) for M in (model.F, model.H, model.G))
    size = n + steps * (g + m)
    prior = np.zeros((size, size))
    prior[:n, :n] = model.P0
    w_at = [slice(n + k * g, n + (k + 1) * g) for k in range(steps)]
    v_at = [slice(n + steps * g + k * m, n + steps * g + (k + 1) * m) for k in range(steps)]
    for k in range(steps):
        prior[w_at[k], w_at[k]], prior[v_at[k], v_at[k]] = Q, R
    state, mean = np.eye(n, size), model.x0
    rows, means = [], []
    for k in range(steps):
        row = H[k] @ state
        row[:, v_at[k]] += np.eye(m)
        rows.append(row)
        means.append(H[k] @ mean)
        state = F[k] @ state
        state[:, w_at[k]] += G[k]
        mean = F[k] @ mean + model.drive[k]
    seen = np.isfinite(model.y.ravel())
    M, gap = np.concatenate(rows)[seen], (model.y.ravel() - np.concatenate(means))[seen]
    gain = prior @ M.T @ np.linalg.inv(M @ prior @ M.T)
    after, C = gain @ gap, prior - gain @ M @ prior
    second = np.outer(after, after) + C
    any_seen = np.flatnonzero(np.isfinite(model.y).any(axis=1))
    return (
        np.mean([second[w_at[k], w_at[k]] for k in range(steps - 1)], axis=0),
        np.mean([second[v_at[k], v_at[k]] for k in any_seen], axis=0),
    )


@pytest.mark.parametrize("seed", range(4))
def test_moments_are_those_of_joint_conditioning(seed: int) -> None:
    model, Q, R = random_model(seed), covariance(seed, 2), covariance(seed + 9, 2)
    value, process, measurement = expected_noises(model, Q, R)
    assert value == pytest.approx(joint_log_likelihood(model, Q, R), rel=1e-11)
    expected = conditioned(model, Q, R)
    np.testing.assert_allclose(process, expected[0], atol=1e-10)
    np.testing.assert_allclose(measurement, expected[1], atol=1e-10)


@pytest.mark.parametrize("kind", ["scalar", "diagonal", "full"])
def test_the_likelihood_rises_at_every_pass(kind: str) -> None:
    rng = np.random.default_rng(3)
    A, x, y = np.array([[0.9, 0.2], [0.0, 0.7]]), np.zeros(2), []
    for _ in range(300):
        y.append(x + 0.7 * rng.standard_normal(2))
        x = A @ x + [1.0, 0.3] * rng.standard_normal(2)
    y = np.array(y)
    y[40:60, 0] = np.nan
    y[100:110] = np.nan
    model = LinearGaussianModel(F=A, H=np.eye(2), y=y, P0=np.eye(2))
    fit = fit_em(model, NoiseStructure.of(kind, np.eye(2), np.eye(2)), max_passes=60)
    assert (np.diff(fit.log_likelihood) > -1e-9).all()
    assert fit.log_likelihood[-1] > fit.log_likelihood[0] + 1.0
    assert fit.passes == len(fit.log_likelihood)


@pytest.mark.parametrize("seed", [0, 1])
def test_it_ends_at_the_maximum_of_the_likelihood(seed: int) -> None:
    model, _ = pushing(seed, 400)
    em = fit_em(model, PUSHING, max_passes=3000, tolerance=1e-7)
    fit = fit_innovation_likelihood(model, PUSHING, starts=1)
    assert em.converged
    assert em.Q[0, 0] == pytest.approx(fit.Q[0, 0], rel=1e-3)
    assert em.R[0, 0] == pytest.approx(fit.R[0, 0], rel=1e-4)
    assert em.log_likelihood[-1] == pytest.approx(fit.log_likelihood, abs=1e-5)


def test_each_pass_costs_two_and_the_budget_holds() -> None:
    model, _ = pushing(2, 200)
    asked: list[int] = []

    def spend(cost: int) -> bool:
        asked.append(cost)
        return sum(asked) <= 11

    fit = fit_em(model, PUSHING, spend=spend)
    assert fit.passes == 5
    assert not fit.converged
    assert set(asked) == {2}


def test_structures_without_a_closed_maximisation_are_refused() -> None:
    model, _ = pushing(3, 100)
    wide = model.replaced(G=np.eye(2))
    overlapping = NoisePart(2, np.stack([np.eye(2), np.ones((2, 2))]), np.zeros((2, 2)), np.ones(2))
    with pytest.raises(UnsuitableProblem, match=r"em cannot fit Q: .*overlap"):
        fit_em(wide, NoiseStructure(overlapping, PUSHING.measurement))
    known = NoisePart(1, np.ones((1, 1, 1)), np.ones((1, 1)), np.ones(1))
    with pytest.raises(UnsuitableProblem, match=r"em cannot fit R: a part of it is known"):
        fit_em(model, NoiseStructure(PUSHING.process, known))


def test_the_solver_counts_two_runs_a_pass_and_ends_at_the_loss_of_the_likelihood_solver() -> None:
    problem = navopt.simulate("noise-tuning", 2, steps=300)
    em = navopt.solve(problem, navopt.make_solver("em", max_passes=2000, tolerance=1e-7))
    assert em.estimate.converged
    assert em.counts.internal % 2 == 0
    assert em.loss == pytest.approx(navopt.solve(problem, "innovation-likelihood").loss, abs=1e-7)
    cut = navopt.solve(problem, "em", budget=20)
    assert cut.counts.cost == 19
    assert not cut.estimate.converged
