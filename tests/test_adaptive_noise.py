"""Adaptive filters: they follow a jump of the measurement noise, and a fixed filter does not."""

from __future__ import annotations

import numpy as np
import pytest
from noise_tools import TRUE_Q, TRUE_R, pushing, random_model
from scipy.stats import chi2, norm

import navopt
from baselines.adaptive_filters import innovation_adaptive, sage_husa
from baselines.likelihood_window import fit_windows
from baselines.noise_structure import NoiseStructure
from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import LinearGaussianModel

TRUE = NoiseStructure.of("scalar", [[TRUE_Q]], [[TRUE_R]])
JUMP, STEPS = 700, 1400


def nis_of(model: LinearGaussianModel, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Normalised innovations squared of the pushing model with variances Q(t) and R(t), by hand."""
    p, v = model.x0
    a, b, c = model.P0[0, 0], model.P0[0, 1], model.P0[1, 1]
    drive, y, dt, out = model.drive, model.y[:, 0], 0.1, []
    for k in range(len(y)):
        s = a + R[k, 0, 0]
        e, k0, k1 = y[k] - p, a / s, b / s
        out.append(e * e / s)
        p, v = p + k0 * e, v + k1 * e
        a, b, c = a - k0 * a, b - k0 * b, c - k1 * b
        p, v = p + dt * v + drive[k, 0], v + drive[k, 1]
        q = Q[k, 0, 0]
        a, b, c = a + 2 * dt * b + dt**2 * c + q * dt**4 / 4, b + dt * c + q * dt**3 / 2, c + q * dt**2
    return np.array(out)


FILTERS = {
    "sage-husa": lambda model: sage_husa(model, TRUE),
    "innovation": lambda model: innovation_adaptive(model, TRUE),
    "residual": lambda model: innovation_adaptive(model, TRUE, form="residual"),
    "likelihood window": lambda model: fit_windows(model, TRUE, stride=20),
}


@pytest.mark.parametrize("name", FILTERS)
def test_a_ninefold_jump_of_R_is_followed(name: str) -> None:
    worlds = 2 if name == "likelihood window" else 4
    late, fixed, after = [], [], []
    for seed in range(worlds):
        model, _ = pushing(seed, STEPS, jump=JUMP)
        run = FILTERS[name](model)
        R = run.R[:, 0, 0]
        # the first time within a factor 1.5
        reached = np.flatnonzero(np.abs(np.log(R[JUMP:] / (9 * TRUE_R))) < np.log(1.5))[0]
        assert reached < 300
        after.append(np.abs(np.log(R[JUMP + 300 :] / (9 * TRUE_R))) < np.log(1.5))
        assert R[JUMP - 1] == pytest.approx(TRUE_R, rel=0.6)
        late.append(nis_of(model, run.Q, run.R)[JUMP + 300 :])
        steady = np.full_like(run.R, TRUE_R)
        fixed.append(nis_of(model, np.full_like(run.Q, TRUE_Q), steady)[JUMP + 300 :])
    # and it stays there, but for the scatter of an estimate with a short memory
    assert np.mean(after) > 0.97
    count = worlds * (STEPS - JUMP - 300)
    # 10 % more than the band of white innovations: a variance learnt from 100 of them is itself uncertain
    low, high = chi2.ppf([0.0005, 0.9995], count) / count
    assert 0.95 * low < np.mean(late) < 1.1 * high
    assert np.mean(fixed) > 3.0 * high


@pytest.mark.parametrize("name", ["sage-husa", "innovation", "residual"])
def test_the_reported_nis_is_that_of_the_reported_covariances(name: str) -> None:
    model, _ = pushing(9, 500, jump=250)
    run = FILTERS[name](model)
    np.testing.assert_allclose(run.nis, nis_of(model, run.Q, run.R), rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("name", FILTERS)
def test_nothing_of_the_future_is_used(name: str) -> None:
    model, _ = pushing(10, 400)
    y = np.array(model.y)
    y[300:] += 50.0
    run, other = FILTERS[name](model), FILTERS[name](model.replaced(y=y))
    np.testing.assert_array_equal(run.R[:301], other.R[:301])
    np.testing.assert_array_equal(run.Q[:300], other.Q[:300])
    assert not np.array_equal(run.R[320:], other.R[320:])


@pytest.mark.parametrize("learner", [sage_husa, innovation_adaptive])
def test_Q_can_be_learnt_instead(learner) -> None:
    """Where the state moves more than the measurements scatter; else innovations tell little about Q."""
    which = NoiseStructure.of("scalar", [[0.4]], [[TRUE_R]])
    ends = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        walk = np.cumsum(2.0 * rng.standard_normal(1000))
        y = walk + np.sqrt(TRUE_R) * rng.standard_normal(1000)
        model = LinearGaussianModel(F=[[1.0]], H=[[1.0]], y=y, P0=[[4.0]])
        run = learner(model, which, adapt="Q")
        ends.append(run.Q[600:, 0, 0].mean())
        assert (run.R == TRUE_R).all()
    error = np.std(ends, ddof=1) / np.sqrt(len(ends))
    assert abs(np.mean(ends) - 4.0) < norm.isf(0.00025) * error + 0.1


def test_without_learning_it_is_a_plain_filter() -> None:
    model, _ = pushing(11, 300)
    run = sage_husa(model, TRUE, burn_in=10**6)
    assert (run.R == TRUE_R).all()
    count = 300
    low, high = chi2.ppf([0.0005, 0.9995], count) / count
    assert low < run.nis.mean() < high


@pytest.mark.parametrize("form", ["innovation", "residual"])
def test_covariances_stay_definite_and_within_their_factors(form: str) -> None:
    model = random_model(3, steps=60)
    which = NoiseStructure.of("full", np.eye(2), np.eye(2))
    for run in (
        innovation_adaptive(model, which, adapt="both", window=4, form=form, low=0.05, high=50.0),
        sage_husa(model, which, adapt="both", forgetting=0.5, burn_in=0, low=0.05, high=50.0),
    ):
        for matrices in (run.Q, run.R):
            values = np.linalg.eigvalsh(matrices)
            assert values.min() > 0.05 * (1 - 1e-9)
            assert values.max() < 50.0 * (1 + 1e-9)
        assert np.isnan(run.nis[5])
        assert np.isfinite(run.nis[3])


def test_the_mean_of_R_is_right_where_nothing_jumps() -> None:
    for learner in (sage_husa, innovation_adaptive):
        means = [
            learner(pushing(seed, 1000)[0], NoiseStructure.of("scalar", [[TRUE_Q]], [[1.0]])).R[600:].mean()
            for seed in range(6)
        ]
        error = np.std(means, ddof=1) / np.sqrt(len(means))
        assert abs(np.mean(means) - TRUE_R) < norm.isf(0.00025) * error + 0.01 * TRUE_R


@pytest.mark.parametrize("name", ["sage-husa", "innovation-adaptive"])
def test_the_solver_follows_a_jump_that_a_fixed_filter_does_not(name: str) -> None:
    problem = navopt.simulate("noise-tuning", 6, steps=1600, measurement_step=9.0)
    solution = navopt.solve(problem, name)
    assert solution.counts.internal == 1
    assert solution.estimate.R.shape == (1600, 1, 1)
    fixed = problem.score(problem.estimate(np.log10([TRUE_Q, TRUE_R])))
    for scores in (solution.scores, solution.apply(problem.redraw(4))):
        assert abs(scores["nis_1"] - 1.0) < 0.5 * abs(fixed["nis_1"] - 1.0)
        assert scores["state_rmse_1"] < 1.2 * fixed["state_rmse_1"]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: sage_husa(m, TRUE, adapt="P"), "adapt: .*both"),
        (lambda m: sage_husa(m, TRUE, forgetting=1.0), "forgetting: got 1.0"),
        (lambda m: sage_husa(m, TRUE, burn_in=-1), "burn_in: got -1"),
        (lambda m: sage_husa(m, TRUE, low=2.0), "low: got 2.0"),
        (lambda m: innovation_adaptive(m, TRUE, window=1), "window: got 1"),
        (lambda m: innovation_adaptive(m, TRUE, form="some"), "form: .*residual"),
        (lambda m: innovation_adaptive(m, TRUE, high=0.0), "high: got 0.0"),
    ],
)
def test_bad_options_are_one_clear_error(call, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        call(pushing(0, 60)[0])
