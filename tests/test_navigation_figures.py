"""Studies of navigation: they are what they say, and their pictures and intervals come from their runs."""

import numpy as np
import pytest

import navopt
from comparisons import ResultsStore, Study, list_studies, run_study
from comparisons.drawing import render
from comparisons.navigation_figures import (
    PERFECT,
    error_picture,
    navigation_curves,
    paired_table,
    track_picture,
)
from navopt.errors import InvalidInput, UnknownName

SCORE = "position_error_max_m"


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    study = Study.from_dict(
        {
            "name": "small",
            "problem": "gyro-navigation",
            "worlds": 5,
            "budget": 500,
            "rank_by": SCORE,
            "scenarios": {
                "lake": {"navigation": "lake", "duration_s": 240.0, "recalibration": "positions"},
                "rest": {"navigation": "static", "hours": 3.0},
            },
            "solvers": [{"name": "nominal", "label": "turntable"}, {"name": "norm-ls"}],
        }
    )
    folder = tmp_path_factory.mktemp("small")
    assert run_study(study, folder, workers=1).failed == 0
    with ResultsStore(folder) as opened:
        yield opened


def test_curves_end_at_the_scores_of_the_runs(store):
    runs = store.runs()
    for scenario, samples in (("lake", 241), ("rest", 181)):
        curves = navigation_curves(store, scenario)
        assert list(curves.error_m) == ["turntable", "norm-ls", PERFECT]
        own = runs[runs["scenario"] == scenario]
        for label in ("turntable", "norm-ls"):
            mine = own[own["solver"] == label].sort_values("world")
            assert curves.error_m[label].shape == (5, samples)
            for column, found in (
                ("score.position_error_end_m", curves.error_m[label][:, -1]),
                ("score.position_error_max_m", curves.error_m[label].max(axis=1)),
            ):
                np.testing.assert_allclose(found, mine[column], rtol=1e-9)
    table = navigation_curves(store, "rest").per_hour()
    assert list(table.index) == [0, 1, 2, 3]
    np.testing.assert_allclose(table.loc[3], [np.median(v[:, -1]) / 1852.0 for v in curves.error_m.values()])


def test_pairs_are_taken_world_by_world(store):
    table = paired_table(store, SCORE, against="turntable").set_index(["scenario", "solver"])
    runs = store.runs()
    for scenario in ("lake", "rest"):
        wide = runs[runs["scenario"] == scenario].pivot(
            index="world", columns="solver", values="score." + SCORE
        )
        row = table.loc[scenario, "norm-ls"]
        difference = wide["norm-ls"] - wide["turntable"]
        assert row["median"] == pytest.approx(np.median(wide["norm-ls"]))
        assert row["difference"] == pytest.approx(np.median(difference))
        assert row["better"] == pytest.approx(np.mean(difference < 0))
        assert row["low"] <= row["median"] <= row["high"]
        assert row["worlds"] == 5
        same = table.loc[scenario, "turntable"]
        assert same["difference"] == same["difference_low"] == same["difference_high"] == 0.0
    with pytest.raises(UnknownName, match="norm-ls"):
        paired_table(store, SCORE, against="norm-l")


def test_pictures_show_every_solver(store):
    curves = navigation_curves(store, "rest")
    figure = error_picture(curves, store.study, printed={"turntable": 1.0})
    (axes,) = figure.axes
    assert [text.get_text() for text in axes.get_legend().get_texts()] == list(curves.error_m)
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    np.testing.assert_allclose(lines["norm-ls"], np.median(curves.error_m["norm-ls"], axis=0) / 1852.0)
    tracks = track_picture(store, "lake", 2)
    left, right = tracks.axes
    labels = [line.get_label() for line in left.lines]
    assert labels == ["reference", "turntable", "norm-ls"]
    problem = navopt.simulate(
        "gyro-navigation", seed=2, navigation="lake", duration_s=240.0, recalibration="positions"
    )
    error = problem.navigation(problem.turntable_answer)
    np.testing.assert_allclose(right.lines[0].get_xdata(), error.east_m)
    for picture in (figure, tracks):
        assert render(picture, format="png", dpi=40)[:4] == b"\x89PNG"


def test_what_is_not_there_is_refused(store):
    for call in (navigation_curves, lambda s, name: track_picture(s, name, 0)):
        with pytest.raises(UnknownName, match="lake"):
            call(store, "lakes")
    with pytest.raises(InvalidInput, match="no runs"):
        track_picture(store, "lake", 99)


@pytest.mark.parametrize("name", ["gyro-navigation-static", "gyro-navigation-lake"])
def test_the_studies_that_come_with_the_package_can_run(name):
    assert name in list_studies()
    study = Study.named(name)
    study.check()
    assert len(study.worlds) == 50
    assert study.rank_by in navopt.simulate(
        study.problem, seed=0, **study.place(next(iter(study.scenarios)))[1]
    ).score(
        navopt.simulate(study.problem, seed=0, **study.place(next(iter(study.scenarios)))[1]).turntable_answer
    )
    printed = {(value.scenario, value.solver, value.score): value.value for value in study.printed}
    if name.endswith("static"):
        assert printed["its own record", "NAFSA", "position_error_end_nmi"] == 4.2550
    else:
        assert printed["its own mooring, 15 min", "NAFSA", "east_error_end_m"] == 8.1689
