"""Studies of filter tuning: they are what they say, and their pictures come from their runs."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from comparisons import ResultsStore, Study, ranked_table, run_study, write_report
from comparisons.drawing import render
from comparisons.printed import printed_table
from comparisons.tuning_pictures import MOST_SOLVERS, TRUE, course_pictures, tuned_states
from navopt.algorithms import FruitFly3D, PerturbedFruitFly, StudentFruitFly
from navopt.errors import InvalidInput, UnknownName
from navopt.registry import make_solver

NAMES = ("alignment-paper", "alignment-paper-fair", "noise-tuning", "pushing-paper", "pushing-paper-fair")


@pytest.fixture(scope="module", params=NAMES)
def study(request):
    return Study.named(request.param)


def test_every_study_can_be_planned(study):
    runs = study.runs()
    assert len(runs) == len(study.scenarios) * len(study.worlds) * len(study.solvers)
    assert study.held_out >= 1
    assert study.budget == (500 if study.name == "noise-tuning" else 2020)


def test_published_flies_have_the_published_settings():
    pushing, alignment = Study.named("pushing-paper"), Study.named("alignment-paper")
    made = {
        (s.name, e.label): make_solver(e.name, **e.settings)
        for s in (pushing, alignment)
        for e in s.solvers
        if "FOA" in e.label
    }
    for key, paper in (
        (("pushing-paper", "IFOA"), PerturbedFruitFly.published()),
        (("pushing-paper", "3D-FOA"), FruitFly3D.published()),
        (("alignment-paper", "IFOA-KF"), StudentFruitFly.published()),
    ):
        for name in ("encoding", "flight_range", "step_law", "start", "location_range", "pop_size"):
            assert getattr(made[key], name) == getattr(paper, name), (key, name)
    assert made["pushing-paper", "IFOA"].perturbation == 3.1
    assert made["pushing-paper", "IFOA, clipped"].clip == 3.1


def test_deployable_studies_never_see_the_truth():
    for label, scenario in Study.named("noise-tuning").scenarios.items():
        assert scenario.get("objective", "innovations") == "innovations", label


def test_printed_averages_are_those_of_table_3_and_its_misprint():
    study = Study.named("alignment-paper")
    values = {(v.solver, v.score): v.value for v in study.printed if v.scenario == "Table 3, five entries"}
    for solver in ("PSO-KF", "FOA-KF", "GFOA-KF"):
        angles = [values[solver, f"{name}_error_rad"] for name in ("pitch", "roll", "yaw")]
        assert np.mean(angles) == pytest.approx(values[solver, "mean_angle_error_rad"], rel=2e-5)
    angles = [values["IFOA-KF", f"{name}_error_rad"] for name in ("pitch", "roll", "yaw")]
    assert np.mean(angles) == pytest.approx(2.9926e-5, rel=2e-5)
    assert values["IFOA-KF", "mean_angle_error_rad"] == 2.9257e-5


def small(name, **scenarios):
    """Two worlds of a study, short ones, with its first solvers and its reference."""
    whole = Study.named(name)
    changed = whole.to_dict()
    changed["scenarios"] = scenarios
    kept = [e for e in changed["solvers"] if e["name"] in ("pso-001", "pso-000", "foa", "nominal")]
    changed["solvers"] = kept
    labels = {e["label"] for e in kept}
    changed["printed"] = [
        v for v in changed["printed"] if v["scenario"] in scenarios and v["solver"] in labels
    ]
    changed.update(worlds=2, budget=60)
    return Study.from_dict(changed)


@pytest.fixture(scope="module")
def pushing(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pushing")
    oracle = {"objective": "oracle", "encoding": "raw", "steps": 120}
    study = small(
        "pushing-paper",
        **{
            "artificial signal": oracle,
            "quieter": {**oracle, "process_variance": 0.4, "measurement_variance": 0.1},
            "stroke": {**oracle, "case": "stroke", "interval_s": 0.08},
        },
    )
    assert run_study(study, folder, workers=1).failed == 0
    with ResultsStore(folder) as opened:
        yield opened


@pytest.fixture(scope="module")
def alignment(tmp_path_factory):
    folder = tmp_path_factory.mktemp("alignment")
    # with one number half of the particles can be evaluated, with five one in 32
    scenario = {"form": "raw-scale", "objective": "oracle", "normalised": False, "step_s": 0.05}
    study = small("alignment-paper", **{"Table 3, one number": scenario})
    assert run_study(study, folder, workers=1).failed == 0
    with ResultsStore(folder) as opened:
        yield opened


def test_states_of_a_picture_end_at_the_scores_of_the_runs(pushing):
    problem, states = tuned_states(pushing, "stroke", 1)
    assert list(states) == ["PSO", "FOA", "Q = R = 1", TRUE]
    runs = pushing.runs()
    for label in ("PSO", "FOA", "Q = R = 1"):
        row = runs[(runs.scenario == "stroke") & (runs.world == 1) & (runs.solver == label)].iloc[0]
        error = states[label][:, 0] - problem.truth.states[:, 0]
        assert np.sqrt(np.mean(error**2)) == pytest.approx(row["score.position_rmse_m"], rel=1e-9)
        assert abs(error[-1]) == pytest.approx(row["score.final_position_error_m"], rel=1e-9)


def test_angles_of_a_picture_end_at_the_scores_of_the_runs(alignment):
    problem, states = tuned_states(alignment, "Table 3, one number", 0)
    runs = alignment.runs()
    for label in ("PSO-KF", "FOA-KF"):
        row = runs[(runs.world == 0) & (runs.solver == label)].iloc[0]
        error = np.abs(states[label] - problem.truth.states)[-1, 2:5]
        # angles of the corrected matrix and small angles agree to second order
        expected = [row[f"score.{name}_error_rad"] for name in ("pitch", "roll", "yaw")]
        np.testing.assert_allclose(error, expected, rtol=0.02, atol=2e-4)


def test_pictures_are_drawn_and_say_what_they_are(pushing, alignment):
    for store, scenario, count in (
        (pushing, "artificial signal", 2),
        (pushing, "stroke", 3),
        (alignment, "Table 3, one number", 2),
    ):
        pictures = course_pictures(store, scenario=scenario, world=0)
        assert len(pictures) == count
        for _, words, caption in pictures:
            assert scenario in words
            assert caption.endswith(".")


def test_pictures_are_the_same_twice(pushing):
    once, again = (course_pictures(pushing, scenario="stroke", world=0)[0][0] for _ in range(2))
    assert render(once, format="png", dpi=40) == render(again, format="png", dpi=40)


def test_the_direct_integral_is_drawn_and_runs_away(pushing):
    (_, whole, _) = (figure for figure, _, _ in course_pictures(pushing, scenario="stroke", world=0))
    lines = {line.get_label(): line for line in whole.axes[0].get_lines()}
    assert {"measured", "integrated twice", "truth", "PSO", TRUE} <= set(lines)
    end = {name: lines[name].get_ydata()[-1] for name in ("integrated twice", "truth", "PSO")}
    assert abs(end["integrated twice"] - end["truth"]) > 10.0 * abs(end["PSO"] - end["truth"])


def test_the_report_has_the_pictures_and_the_printed_values(alignment):
    page = write_report(alignment).read_text(encoding="utf-8")
    assert "Errors of pitch, roll and yaw over time" in page
    assert "Wan et al. (2020), Table 3" in page
    assert not re.search(r'<img[^>]+src="http', page)
    table = printed_table(alignment)
    yaw = table[(table.score == "yaw_error_rad") & (table.solver == "FOA-KF")]
    assert (yaw["verdict"].str.len() > 0).all()


def test_no_more_lines_than_can_be_told_apart(pushing):
    _, states = tuned_states(pushing, "artificial signal", 0)
    assert len(states) <= MOST_SOLVERS + 2


def tiny(**changes):
    tables = {
        "name": "tiny",
        "problem": "noise-tuning",
        "worlds": 2,
        "budget": 40,
        "held_out": 2,
        "rank_by": "held_out.state_rmse_ratio_1",
        "scenarios": {"one": {"steps": 60}},
        "solvers": [{"name": "nominal"}, {"name": "sage-husa"}],
    }
    return Study.from_dict({**tables, **changes})


def test_ranking_by_the_twins_is_their_mean(tmp_path):
    study = tiny()
    assert run_study(study, tmp_path, workers=1).failed == 0
    with ResultsStore(tmp_path) as store:
        runs = store.runs()
        table = ranked_table(store).set_index("solver")
        assert write_report(store).exists()
    for solver in ("nominal", "sage-husa"):
        own = runs[runs.solver == solver]["held_out.state_rmse_ratio_1"]
        assert table.loc[solver, "median"] == pytest.approx(own.median(), rel=1e-12)
        assert own.median() != runs[runs.solver == solver]["score.state_rmse_ratio_1"].median()


def test_ranking_by_twins_needs_twins():
    with pytest.raises(InvalidInput, match="held_out"):
        tiny(held_out=0)


def test_a_twin_score_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(UnknownName, match="held_out"):
        run_study(tiny(rank_by="held_out.position_error_m"), tmp_path, workers=1)


@pytest.fixture(scope="module")
def page():
    """The script of the page, which is no module of a package."""
    path = Path(__file__).parents[1] / "docs" / "noise_tuning_compared.py"
    described = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(described)
    described.loader.exec_module(module)
    return module


def cells(table):
    """Cells of a table of the page by the first one of each row, and its head."""
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    assert len({len(line) for line in lines}) == 1
    return {line[0]: line[1:] for line in lines[2:]}, lines[0][1:]


def test_the_table_of_the_pushing_paper_has_medians_and_printed_values(page, pushing):
    runs = page.complete(pushing)
    rows, head = cells(page.pushing_paper(pushing, runs))
    assert list(rows) == [entry.label for entry in pushing.study.solvers]
    own = runs[(runs.scenario == "quieter") & (runs.solver == "FOA")]
    assert rows["FOA"][1] == f"{np.mean(own['loss']):.4f} (0.0229)"  # of two, the mean is the median
    assert rows["PSO"][1].endswith("(0.397)")
    own = runs[(runs.scenario == "stroke") & (runs.solver == "PSO")]
    assert rows["PSO"][5] == f"{1e3 * np.mean(own['score.final_position_error_m']):.1f}"
    assert rows["Q = R = 1"][-2:] == ["1 to 1", "1 to 1"]
    assert head[-1] == "Q/R, quartiles"


def test_a_world_that_is_not_finished_is_left_out(page, tmp_path):
    assert run_study(tiny(), tmp_path, workers=1).failed == 0
    with ResultsStore(tmp_path) as store:
        assert set(page.complete(store).world) == {0, 1}
        short = store.runs().query("not (world == 1 and solver == 'nominal')")

        class Unfinished:
            study = store.study

            @staticmethod
            def runs():
                return short

        assert set(page.complete(Unfinished).world) == {0}
        rows, _ = cells(page.noise_tuning(store, page.complete(store)))
        ratio = store.runs().query("solver == 'nominal'")["held_out.state_rmse_ratio_1"]
    high = min(ratio) + 0.95 * np.ptp(ratio)
    assert rows["nominal"][0] == f"{np.mean(ratio):.3f}, {high:.3f}"
    assert rows["nominal"][-2] == "1"  # one run of the filter


def test_gaps_are_from_the_best_of_each_world(page, pushing):
    runs = page.complete(pushing)
    found = [page.gaps(runs, "quieter", entry.label, relative=True) for entry in pushing.study.solvers]
    np.testing.assert_array_equal(np.min(found, axis=0), 0.0)
    nominal = runs[(runs.scenario == "quieter") & (runs.solver == "Q = R = 1")]["loss"].to_numpy()
    least = runs[runs.scenario == "quieter"].groupby("world")["loss"].min().to_numpy()
    np.testing.assert_allclose(found[-1], nominal / least - 1.0)
