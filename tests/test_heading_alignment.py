"""HeadingAlignment: scores, worlds, consistency, what the heading is worth in each formulation, bad input."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy import stats
from test_heading_world import recording

import navopt
from baselines import AdaptiveUnscented, FixedTuning
from navopt.errors import InvalidInput, NoTruth, UnknownName, UnsuitableProblem
from navopt.filters.unscented import UnscentedFilter
from navopt.models.azimuth_error import alignment_process, heading_measurement
from navopt.models.enu_attitude import attitude_angles
from navopt.problems import HeadingAlignment, HeadingSettings
from navopt.problems.heading_linear import linearised, scales_from
from navopt.problems.heading_scores import SCORES, convergence_time
from navopt.problems.heading_settings import HeadingTruth, default_tuned

QUICK = {"duration_s": 30.0, "rate_hz": 10.0}


@pytest.fixture(scope="module")
def worlds() -> list[HeadingAlignment]:
    return [HeadingAlignment.simulate(seed, duration_s=60.0, rate_hz=10.0) for seed in range(20)]


# -- scores ----------------------------------------------------------------------------------------------
def test_convergence_time() -> None:
    time = 10.0 + np.arange(6.0)
    for error, expected in (
        ([9.0, 2.0, 0.5, 0.5, 0.2, 0.1], 2.0),
        # through zero on the way out does not count
        ([9.0, 0.0, 5.0, -5.0, 0.2, -0.1], 4.0),
        ([0.1] * 6, 0.0),
        ([0.1, 0.1, 0.1, 0.1, 0.1, 2.0], np.inf),
        ([9.0, np.nan, 0.5, 0.5, 0.5, 0.5], 2.0),
        ([9.0, 0.5, 0.5, 0.5, 0.5, np.nan], np.inf),
        ([1.0] * 6, 0.0),
    ):
        assert convergence_time(time, error, 1.0) == expected
    with pytest.raises(InvalidInput, match="one error for each time"):
        convergence_time(time, [1.0], 1.0)


def test_scores_are_those_of_the_run(worlds: list[HeadingAlignment]) -> None:
    problem = worlds[0]
    run, truth = problem.run(problem.settings), problem.truth.states
    scores = problem.score(problem.settings)
    assert tuple(scores) == SCORES
    azimuth = run.estimates[:, 4] - truth[:, 4]
    late = azimuth[-(len(azimuth) // 3) :]
    assert scores["final_azimuth_error_rad"] == abs(azimuth[-1])
    assert abs(scores["azimuth_rms_rad"] - np.sqrt(np.mean(late**2))) < 1e-15
    assert abs(scores["azimuth_mean_rad"] ** 2 + scores["azimuth_sigma_rad"] ** 2 - np.mean(late**2)) < 1e-15
    first = float(run.nis.sum() / np.isfinite(run.innovations).sum())
    assert scores["nis_1"] == first
    P = run.covariances[-1]
    e = run.estimates[-1] - np.delete(truth[-1], 5)
    assert abs(problem.align(problem.settings).covariance[2, 2] - P[4, 4]) < 1e-18
    assert np.isfinite(e @ np.linalg.solve(P, e))


def test_a_filter_that_fails_has_no_scores_but_a_count() -> None:
    problem = HeadingAlignment.simulate(2, **QUICK)
    broken = HeadingSettings.published()
    scores = problem.score(broken)
    assert scores["failed_1"] == 1.0
    assert all(np.isinf(v) for k, v in scores.items() if k != "failed_1")
    with pytest.raises(InvalidInput, match="not positive definite"):
        problem.align(broken)
    tuned = HeadingAlignment(problem.record, settings=broken)
    x = tuned.nominal
    assert tuned.loss(x) == np.inf
    assert "step" in tuned.invalid_reasons(x[None])[0]


# -- what the heading is worth ---------------------------------------------------------------------------
def test_used_as_what_it_is_the_heading_gives_the_azimuth_at_once(worlds: list[HeadingAlignment]) -> None:
    for formulation in ("direct", "correlated"):
        scores = [p.score(HeadingSettings(formulation=formulation)) for p in worlds]
        assert max(s["azimuth_convergence_s"] for s in scores) < 20.0
        assert max(s["azimuth_rms_rad"] for s in scores) < np.radians(0.05)
        # level to what the accelerometers' bias of 1 mg hides
        bound = np.sqrt(np.mean([s["horizontal_rms_rad"] ** 2 for s in scores]))
        assert bound < 1.6e-3
        # ten states in twenty worlds, once each; 1 in 1000
        nees = np.mean([s["nees_1"] for s in scores])
        low, high = stats.chi2.ppf([5e-4, 1.0 - 5e-4], 200) / 200.0
        assert low < nees < high


def test_as_an_independent_state_the_heading_says_nothing_of_the_first_azimuth(
    worlds: list[HeadingAlignment],
) -> None:
    paper, none = (
        np.array([p.score(HeadingSettings(formulation=f))["final_azimuth_error_rad"] for p in worlds])
        for f in ("paper", "none")
    )
    assert np.median(paper) > np.radians(5.0)
    # what it does say is not worth a tenth
    assert abs(np.median(paper) / np.median(none) - 1.0) < 0.1


@pytest.mark.parametrize("azimuth", [60.0, 120.0, -180.0])
def test_any_azimuth_converges(azimuth: float) -> None:
    for variant in ("ekf", "ukf", "srukf"):
        problem = HeadingAlignment.simulate(1, **QUICK, angles_deg=(1.0, -1.0, azimuth), heading_deg=170.0)
        scores = problem.score(HeadingSettings(variant=variant))
        assert scores["azimuth_convergence_s"] < 5.0
        assert scores["azimuth_rms_rad"] < np.radians(0.05)
        found = problem.align(HeadingSettings(variant=variant))
        assert abs((np.degrees(found.yaw) - 170.0 + 180.0) % 360.0 - 180.0) < 0.1


def test_level_machine_that_shakes_and_a_coarse_start() -> None:
    problem = HeadingAlignment.simulate(3, duration_s=30.0, setting="onboard", start="coarse")
    scores = problem.score(problem.settings)
    # the bias of the headings, 0.05 degrees, is believed
    assert abs(np.degrees(scores["azimuth_mean_rad"]) + 0.05) < 0.02
    assert scores["horizontal_rms_rad"] < 3e-3


# -- the filter ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("formulation", ["direct", "correlated"])
def test_run_is_that_of_the_general_filter(formulation: str) -> None:
    problem = HeadingAlignment.simulate(5, duration_s=6.0, rate_hz=50.0, heading_rate_hz=5.0)
    settings = HeadingSettings(formulation=formulation, gyro_scale=3.0, heading_scale=2.0)
    record, chosen = problem.record, problem.filter(settings)
    z, measured = record.measurements(), record.measured_constants
    n = 11 if settings.has_heading_state else 10
    now = {"c": measured[0]}

    def measure(states: np.ndarray) -> np.ndarray:
        third = [s[5] if n == 11 else heading_measurement(s, now["c"]) for s in states]
        return np.column_stack([states[:, 0], states[:, 1], third])

    general = UnscentedFilter(
        lambda s, u, dt: alignment_process(s, u, dt), measure, Q=chosen.Q, R=chosen.R, P0=chosen.P0,
        x0=chosen.x0, angles=(2,),
    )  # fmt: skip
    for k, c in enumerate(record.constants):
        general.predict(record.step, c)
        if np.isfinite(z[k + 1]).any():
            now["c"] = measured[k + 1]
            general.update(z[k + 1])
    run = problem.run(settings)
    size = np.sqrt(np.diag(general.P))
    np.testing.assert_allclose(run.estimates[-1] / size, general.x / size, atol=1e-5)


def test_loss_is_the_likelihood_per_number_and_the_oracle_the_error() -> None:
    problem = HeadingAlignment.simulate(4, **QUICK)
    run = problem.run(problem.settings)
    assert float(problem.loss(problem.nominal)) == -run.log_likelihood / (3 * 300)
    oracle = HeadingAlignment.simulate(4, **QUICK, objective="oracle")
    gap = (run.estimates - np.delete(oracle.truth.states, 5, axis=1))[1:, 2:5] / np.radians([1.0, 1.0, 30.0])
    assert abs(float(oracle.loss(oracle.nominal)) - np.mean(np.sum(gap**2, axis=1))) < 1e-12


def test_noise_that_nobody_declared_is_found_by_the_likelihood() -> None:
    problem = HeadingAlignment.simulate(
        7, duration_s=60.0, rate_hz=10.0, heading_noise_factor=3.0, velocity_noise_factor=0.5,
        tuned=("log10_r_velocity", "log10_r_heading"),
    )  # fmt: skip
    found = navopt.solve(problem, "nelder-mead", budget=80, seed=1)
    assert found.loss <= float(problem.loss(problem.true_x))
    # 1200 and 600 numbers: standard errors of 0.018 and 0.025 decades
    np.testing.assert_allclose(found.x, problem.true_x, atol=0.08)
    twin = problem.redraw(1)
    assert float(twin.loss(found.x)) < float(twin.loss(twin.nominal))
    assert abs(twin.score(found.estimate)["nis_1"] - 1.0) < 0.15


def test_losses_do_not_depend_on_company_and_worlds_repeat() -> None:
    problem = HeadingAlignment.simulate(6, **QUICK, variant="sst-ukf")
    assert problem.parameter_names[-3:] == ("forgetting", "weakening", "cap")
    X = problem.nominal + 0.05 * np.random.default_rng(0).uniform(-1.0, 0.0, (4, problem.n_var))
    X = np.clip(X, problem.xl, problem.xu)
    together = problem.loss(X)
    assert [float(problem.loss(x)) for x in X] == together.tolist()
    again = pickle.loads(pickle.dumps(problem))
    assert again.loss(X).tolist() == together.tolist()
    assert HeadingAlignment.simulate(6, **QUICK, variant="sst-ukf").loss(X).tolist() == together.tolist()
    twin = problem.redraw(3)
    np.testing.assert_array_equal(twin.truth.states[0], problem.truth.states[0])
    assert twin.loss(X).tolist() != together.tolist()


def test_twins_have_other_noise_or_are_other_worlds() -> None:
    problem = HeadingAlignment.simulate(6, **QUICK, redraws="world")
    twin = problem.redraw(3)
    biases = slice(-5, None)
    assert (twin.truth.states[0, biases] != problem.truth.states[0, biases]).all()
    alone = HeadingAlignment.simulate(3, **QUICK)
    assert twin.loss(twin.nominal) == alone.loss(alone.nominal)
    with pytest.raises(UnknownName, match="redraws"):
        HeadingAlignment.simulate(6, redraws="sensors")


# -- settings and vectors --------------------------------------------------------------------------------
def test_vectors_and_settings_go_back_and_forth() -> None:
    problem = HeadingAlignment.simulate(
        1, **QUICK, variant="sst-ukf", tuned=("log10_q_gyro", "cap", "log10_spread"),
        settings=HeadingSettings(fades="process", accel_scale=2.0),
    )  # fmt: skip
    x = np.array([1.5, 1.3, -1.0])
    settings = problem.estimate(x)
    assert settings.accel_scale == 2.0
    assert settings.fades == "process"
    assert settings.strong.cap == 1.3
    np.testing.assert_allclose(problem.project(settings), x)
    np.testing.assert_allclose(problem.nominal, [0.0, 1.05, -3.0])
    truth = HeadingTruth(problem.truth.states, gyro_scale=100.0)
    np.testing.assert_allclose(problem.project(truth), [2.0, 1.05, -3.0])
    assert problem.true_x is None
    plain = HeadingAlignment.simulate(1, **QUICK, imu_noise_factor=10.0**0.5)
    np.testing.assert_allclose(plain.true_x, [1.0, 1.0, 0.0, 0.0])
    assert default_tuned(HeadingSettings(formulation="none")) == (
        "log10_q_accel", "log10_q_gyro", "log10_r_velocity",
    )  # fmt: skip


def test_simulate_names_its_keywords() -> None:
    assert navopt.simulate is not None
    with pytest.raises(UnknownName, match="did you mean 'duration_s'"):
        HeadingAlignment.simulate(0, durations=3.0)


# -- estimators of covariances ---------------------------------------------------------------------------
def test_linear_model_has_the_likelihood_of_the_filter() -> None:
    problem = HeadingAlignment.simulate(2, duration_s=60.0, rate_hz=10.0)
    linear = linearised(problem)
    assert abs(float(linear.loss(linear.nominal)) - float(problem.loss(problem.nominal))) < 1e-5
    Q, R = problem.covariances(problem.nominal)
    assert Q.shape == (1, 5, 5)
    found = scales_from(problem, type("E", (), {"Q": 4.0 * Q[0], "R": R}))
    np.testing.assert_allclose([found.accel_scale, found.gyro_scale, found.heading_scale], [4.0, 4.0, 1.0])
    blind = linearised(problem, HeadingSettings(formulation="none"))
    assert blind.model.n_measurements == 2
    with pytest.raises(InvalidInput, match="direct"):
        linearised(problem, HeadingSettings(formulation="paper"))


@pytest.mark.parametrize(
    ("solver", "options"),
    [("em", {"covariance": "diagonal"}), ("sage-husa", {}), ("innovation-adaptive", {})],
)
def test_estimators_of_covariances_apply(solver: str, options: dict[str, str]) -> None:
    problem = HeadingAlignment.simulate(2, duration_s=60.0, rate_hz=10.0, heading_noise_factor=3.0)
    solution = navopt.solve(problem, navopt.make_solver(solver, **options), budget=60)
    assert solution.loss < float(problem.loss(problem.nominal))
    # the variance of the headings is 0.95 decades above the declared; adaptive ones begin at the declared
    assert (0.9 if solver == "em" else 0.2) < solution.x[3] < 1.0
    assert np.isfinite(solution.scores["nis_1"])
    with pytest.raises(UnsuitableProblem):
        navopt.solve(HeadingAlignment(problem.record, formulation="paper"), solver, budget=60)


@pytest.mark.parametrize("solver", ["als", "mehra"])
def test_estimators_that_need_a_steady_state_say_so(solver: str) -> None:
    with pytest.raises(UnsuitableProblem, match="constant model"):
        navopt.solve(HeadingAlignment.simulate(2, **QUICK), solver, budget=60)


# -- fixed and adaptive filters --------------------------------------------------------------------------
@pytest.mark.parametrize("variant", ["ekf", "ukf", "srukf", "st-ukf", "sst-ukf"])
def test_fixed_tuning(variant: str) -> None:
    problem = HeadingAlignment.simulate(2, **QUICK)
    solution = navopt.solve(problem, FixedTuning(variant=variant, factors="multiple", cap=None))
    assert solution.estimate.variant == variant
    assert solution.counts.cost == 1
    assert solution.scores == problem.score(solution.estimate)
    assert solution.apply(problem.redraw(1)) == problem.redraw(1).score(solution.estimate)
    assert solution.scores["failed_1"] == 0.0


def test_fixed_tuning_without_the_heading_does_not_find_the_azimuth() -> None:
    problem = HeadingAlignment.simulate(2, **QUICK)
    solution = navopt.solve(problem, FixedTuning(formulation="none"))
    assert solution.scores["final_azimuth_error_rad"] > np.radians(1.0)


@pytest.mark.parametrize("kind", ["sage-husa", "window"])
def test_adaptive_filters_keep_their_consistency(kind: str) -> None:
    worlds = [
        HeadingAlignment.simulate(
            s, duration_s=60.0, rate_hz=10.0, heading_noise_factor=10.0**0.5, velocity_noise_factor=10.0**0.5
        )
        for s in range(5)
    ]
    fixed, learnt = (
        np.mean([navopt.solve(p, make).scores["nis_1"] for p in worlds])
        for make in (FixedTuning(), AdaptiveUnscented(kind=kind))
    )
    # variances ten times as large; the first readings, before anything is learnt, weigh in
    assert fixed > 7.0
    assert learnt < 3.0


def test_solutions_are_saved(tmp_path) -> None:
    problem = HeadingAlignment.simulate(2, **QUICK)
    solution = navopt.solve(problem, AdaptiveUnscented(kind="window", window=20))
    solution.save(tmp_path / "one")
    loaded = navopt.Solution.load(tmp_path / "one")
    assert loaded.estimate == solution.estimate
    assert loaded.apply(problem) == solution.apply(problem)


# -- recordings, bad input -------------------------------------------------------------------------------
def test_from_arrays() -> None:
    data = recording(60.0)
    problem = HeadingAlignment.from_arrays(**data, every=10, formulation="direct")  # type: ignore[arg-type]
    found = problem.align(problem.settings)
    assert abs(np.degrees(found.yaw + 3.1)) < 0.1
    assert abs(np.degrees(found.pitch - 0.02)) < 0.1
    assert 1e-5 < np.sqrt(found.covariance[2, 2]) < 1e-3
    assert np.isfinite(problem.loss(problem.nominal))
    np.testing.assert_allclose([found.pitch, found.roll, found.yaw], attitude_angles(found.attitude))
    with pytest.raises(NoTruth):
        problem.score(problem.settings)
    with pytest.raises(InvalidInput, match="no true states"):
        HeadingAlignment(problem.record, objective="oracle")
    with pytest.raises(InvalidInput, match="degrees"):
        HeadingAlignment.from_arrays(**recording(60.0, heading=np.full(599, -177.6)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"variant": "kf"}, "variant"),
        ({"formulation": "both"}, "formulation"),
        ({"forgetting": 0.0}, "forgetting"),
        ({"forgetting": 1.5}, "forgetting"),
        ({"weakening": 0.9}, "weakening"),
        ({"cap": 0.5}, "cap"),
        ({"gyro_scale": 0.0}, "gyro_scale"),
        ({"heading_scale": -1.0}, "heading_scale"),
        ({"spread": 0.0}, "spread"),
        ({"adaptation": "magic"}, "adaptation"),
        ({"adaptation": "window", "adaptation_window": 1}, "window"),
        ({"velocities": "never"}, "velocities"),
        ({"heading_state_sigma": 0.0}, "heading_state_sigma"),
        ({"covariance_update": "none"}, "covariance_update"),
    ],
)
def test_bad_settings(changes: dict[str, object], word: str) -> None:
    with pytest.raises(InvalidInput, match=word):
        HeadingSettings(**changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"tuned": ("cap",)}, "ukf has none"),
        ({"tuned": ("log10_spread",), "variant": "ekf"}, "no sigma points"),
        ({"tuned": ("log10_r_heading",), "formulation": "none"}, "no heading"),
        ({"tuned": ()}, "one or more"),
        ({"tuned": ("log10_q_gyro", "log10_q_gyro")}, "different names"),
        ({"tuned": ("gyro",)}, "tuned"),
        ({"tuned": ("log10_q_gyro",), "box": {"cap": (1.0, 2.0)}}, "what is tuned"),
        ({"objective": "hope"}, "objective"),
        ({"azimuth_within_deg": 0.0}, "azimuth_within_deg"),
        ({"heading_rate_hz": 20.0}, "at most rate_hz"),
    ],
)
def test_bad_problems(changes: dict[str, object], word: str) -> None:
    with pytest.raises(InvalidInput, match=word):
        HeadingAlignment.simulate(0, **{**QUICK, **changes})
    with pytest.raises(InvalidInput, match="HeadingRecord"):
        HeadingAlignment(np.zeros(3))  # type: ignore[arg-type]
