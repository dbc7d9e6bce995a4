"""Studies of heading-aided alignment and what their page is made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comparisons import ResultsStore, Study, run_study
from comparisons.drawing import render
from comparisons.heading_figures import azimuth_figure, course_figure, formulation_figure, spot_figure
from comparisons.heading_paper import (
    FIGURES,
    angle_statistics,
    courses,
    ground_check,
    settings_of,
    summary,
    write_all,
)
from navopt.errors import UnknownName
from navopt.filters.heading_filter import HeadingRun
from navopt.models.laser_spot import simulate_spot_test
from navopt.problems.heading_scores import score_run
from navopt.problems.heading_settings import HeadingSettings

STUDIES = ("heading-paper", "robust-alignment", "heading-tuning")


def tiny(name, *, duration=5.0, scenarios=None, worlds=2, **changes):
    """A study of a few seconds on few worlds."""
    study = Study.named(name)
    kept = list(study.scenarios) if scenarios is None else scenarios
    short = {label: {**study.scenarios[label], "duration_s": duration} for label in kept}
    groups = {name: tuple(x for x in labels if x in kept) for name, labels in study.groups.items()}
    return replace(
        study,
        scenarios=short,
        worlds=study.worlds[:worlds],
        groups={name: labels for name, labels in groups.items() if labels},
        printed=tuple(p for p in study.printed if p.scenario in kept),
        **changes,
    )


@pytest.mark.parametrize("name", STUDIES)
def test_studies_parse_and_plan(name):
    study = Study.named(name)
    few = study.replaced(worlds=1)
    assert len(few.runs()) == len(study.scenarios) * len(study.solvers)
    if name != "heading-tuning":
        assert len(study.worlds) == 50


def test_figures_name_what_the_study_has():
    study = Study.named("heading-paper")
    for wanted in FIGURES.values():
        for scenario, solver in wanted:
            assert scenario in study.scenarios
            assert isinstance(settings_of(study, solver), HeadingSettings)
    with pytest.raises(UnknownName):
        settings_of(study, "nobody")


def test_the_printed_reading_is_the_one_of_the_filters():
    printed = settings_of(Study.named("heading-paper"), "SST-UKF, printed")
    # a study file cannot say "no cap": a cap that is never reached stands for it
    assert replace(printed, cap=None) == HeadingSettings.published()


@pytest.mark.parametrize(
    ("name", "changes"),
    [("heading-paper", {}), ("robust-alignment", {}), ("heading-tuning", {"budget": 12, "held_out": 1})],
)
def test_studies_run(tmp_path, name, changes):
    first = list(Study.named(name).scenarios)[:2]
    study = tiny(name, scenarios=first, worlds=1, **changes)
    run = run_study(study, tmp_path / name, workers=1)
    with ResultsStore(tmp_path / name) as store:
        runs = store.runs()
    assert run.failed == 0, runs["error"].dropna().tolist()
    assert len(runs) == len(study.runs())
    assert {"score.azimuth_rms_rad", "score.nees_1", "score.failed_1"} <= set(runs.columns)


def test_direct_and_correlated_agree_and_the_printed_state_does_not_help():
    # the finding, on one world of half a minute: what the azimuth is known to
    study = tiny("heading-paper", duration=30.0, scenarios=["Simulation 1"])
    labels = [f"UKF, {x}" for x in ("direct", "correlated state", "heading state", "no heading")]
    found = courses(study, [("Simulation 1", label) for label in labels])
    direct, correlated, state, without = (found["Simulation 1", label] for label in labels)
    assert abs(direct.errors[-1, 2]) < 5.0 * direct.sigmas[-1, 2] < 0.1
    assert abs(direct.errors[-1, 2] - correlated.errors[-1, 2]) < direct.sigmas[-1, 2]
    assert state.sigmas[-1, 2] > 5.0
    assert state.sigmas[-1, 2] == pytest.approx(without.sigmas[-1, 2], rel=0.05)


def test_statistics_are_those_of_the_last_third():
    study = tiny("heading-paper", duration=6.0, scenarios=["Simulation 1"])
    table = angle_statistics(study, worlds=[0, 1], solvers=["UKF, direct", "SST-UKF, printed"])
    run = courses(study, [("Simulation 1", "UKF, direct")], world=1)["Simulation 1", "UKF, direct"]
    late = run.errors[-(len(run.errors) // 3) :]
    own = table[(table["world"] == 1) & (table["solver"] == "UKF, direct")].set_index("angle")
    assert own.loc["up", "mean_deg"] == pytest.approx(late[:, 2].mean(), rel=1e-12)
    assert own.loc["east", "variance_deg2"] == pytest.approx(late[:, 0].var(), rel=1e-12)
    middle = summary(table).set_index("solver")
    assert middle.loc["UKF, direct", "failed"] == 0
    two = table[(table["angle"] == "up") & (table["solver"] == "UKF, direct")]["mean_deg"].abs()
    assert middle.loc["UKF, direct", "mean_U"] == pytest.approx(two.mean())


def test_printed_filter_fails_with_a_cause():
    study = tiny("heading-paper", duration=30.0, scenarios=["Simulation 1"])
    run = courses(study, [("Simulation 1", "SST-UKF, printed")])["Simulation 1", "SST-UKF, printed"]
    assert run.failed is not None
    assert "step" in run.failed
    assert np.isnan(run.errors[-1]).all()


def test_ground_check_finds_what_was_put_in():
    table = ground_check(repeats=200).set_index("marks_m")
    # 0.05 degrees of bias; 200 medians of nine readings of 0.028 and a tape of 1 mm over 5 m
    assert table.loc[5.0, "mean_deg"] == pytest.approx(0.05, abs=0.005)
    expected = np.hypot(np.degrees(np.sqrt(2.0) * 1.2e-3 / np.sqrt(12.0)), table.loc[5.0, "tape_deg"])
    assert table.loc[5.0, "sigma_deg"] == pytest.approx(expected, rel=0.1)
    assert (table["sigma_deg"].diff().dropna() < 0.0).all()  # longer marks are better


def test_pictures(tmp_path):
    study = tiny("heading-paper", duration=4.0)
    found = courses(study, FIGURES["figure-7"])
    drawn = {pair[1]: run for pair, run in found.items()}
    pictures = [course_figure(drawn), azimuth_figure(drawn)]
    pictures.append(spot_figure(simulate_spot_test(np.random.default_rng(0))))
    time = np.arange(100) / 10.0
    errors = {"a": np.random.default_rng(0).normal(size=(5, 100)), "b": np.full((5, 100), np.nan)}
    errors["b"][:, :50] = 1.0
    pictures.append(formulation_figure({"a": errors["a"]}, time, early=3.0, printed=[(5.0, 0.9, "x")]))
    for figure in pictures:
        data = render(figure, format="png", dpi=50)
        assert data.startswith(b"\x89PNG")
        assert data == render(figure, format="png", dpi=50)
    small = tiny("heading-paper", duration=4.0, scenarios=["Simulation 1"])
    wanted = {"figure-7": FIGURES["figure-7"]}
    tables = write_all(tmp_path, worlds=1, study=small, figures=wanted)
    assert sorted(p.name for p in tmp_path.glob("*.png")) == ["figure-6.png", "figure-7.png"]
    assert sorted(p.stem for p in tmp_path.glob("*.csv")) == ["angles", "ground-check", "summary"]
    assert len(tables["summary"]) == len(small.solvers)


def test_a_covariance_spoilt_by_rounding_is_scored_as_knowing_nothing():
    K = 6
    sick = np.diag([1.0] * 9 + [-1e-9])
    nothing = np.full((K, 3), np.nan)
    run = HeadingRun(
        times=np.arange(float(K)),
        estimates=np.zeros((K, 10)),
        deviations=np.ones((K, 10)),
        covariances=np.tile(sick, (K, 1, 1)),
        innovations=nothing,
        innovation_variances=nothing,
        nis=np.zeros(K),
        fading_factors=nothing,
        measurement_variances=nothing,
        log_likelihood=0.0,
        failed=None,
        failed_step=None,
    )
    scores = score_run(run, np.zeros((K, 11)), azimuth_within=1.0, horizontal_within=1.0)
    assert np.isinf(scores["nees_1"])
    assert scores["angle_nees_1"] == 0.0
    assert scores["azimuth_rms_rad"] == 0.0
