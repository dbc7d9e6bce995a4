"""The studies of Dai et al. (2019): their printed values, curves over a scenario's number, and the bounds."""

from __future__ import annotations

import dataclasses
import functools
import json
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from study_tools import small_study, write_toml

import navopt
from comparisons.curve_figure import curve_picture
from comparisons.curves import curve_table, places_of_long_curves, study_curves
from comparisons.information import SHOWN, information_along, information_picture
from comparisons.printed import printed_table
from comparisons.provenance import study_toml
from comparisons.report import write_report
from comparisons.runner import run_study
from comparisons.store import ResultsStore
from comparisons.study import Printed, SolverEntry, Study, Success
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, NoBound, UnknownName
from navopt.models.field_map import FieldMap
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gravity_window import track_error_bound, window_error_bound

CLAIMS = Path(__file__).resolve().parents[2] / "shared" / "reference" / "claims.yaml"
PAPER = ("gravity-paper", "gravity-paper-fair", "gravity-paper-once", "gravity-paper-hours")
ALL = (*PAPER, "gravity-swarms", "gravity-properties", "gravity-harder")
NAUTICAL_MILE = 1852.0
#: What the paper calls our solvers.
METHODS = {
    "INS alone": None,
    "single-point-abc": "Basic ABC",
    "improved-abc": "Improved-ABC",
    "iccp": "ICCP",
    "affine-abc": "Affine ABC",
    "affine-abc, published": "Affine ABC",
}
QUANTITIES = {"mean": "mean error", "sd": "standard deviation", "share": "matching probability"}


@functools.cache
def named(name):
    return Study.named(name)


# -- the studies -------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ALL)
def test_studies_load_and_survive_every_form(name):
    study = named(name)
    assert Study.from_dict(json.loads(json.dumps(study.to_dict()))) == study
    assert Study.from_dict(tomllib.loads(study_toml(study))) == study
    assert any(entry.name == "nominal" for entry in study.solvers), "every table has a row of the INS alone"


@functools.cache
def claims():
    import yaml

    everything = yaml.load(CLAIMS.read_text(encoding="utf-8"), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    return [claim for claim in everything["claims"] if claim["paper"] == "003"]


def claimed(value):
    """Claims of the reference for a printed value: number and its unit."""
    source, table = value.source.split(", ")
    assert source == "Dai et al. (2019)"
    found = [c for c in claims() if c["table"] == table]
    if value.solver == "INS alone":
        found = [c for c in found if c["quantity"].startswith("initial")]
    else:
        found = [
            c
            for c in found
            if c["method"] == METHODS[value.solver] and c["quantity"] == QUANTITIES[value.statistic]
        ]
    if table == "Table 6":
        found = [c for c in found if c["conditions"].startswith(value.scenario.replace("–", "-"))]
    assert found, value
    assert len({(c["value"], c["unit"]) for c in found}) == 1
    return found[0]["value"], found[0]["unit"]


@pytest.mark.skipif(not CLAIMS.exists(), reason="the list of printed numbers is not here")
@pytest.mark.parametrize("name", PAPER)
def test_printed_values_are_those_of_the_paper(name):
    pytest.importorskip("yaml")
    study = named(name)
    assert study.printed
    for value in study.printed:
        number, unit = claimed(value)
        factor, digits = {"arcmin": (1 / NAUTICAL_MILE, 2), "km": (1e-3, 2), "%": (100.0, 0)}[unit]
        assert round(value.value * factor, digits) == number, value
        if value.statistic == "share":
            radius = 5 if "Table 6" in value.source else 2
            assert value.below == radius * NAUTICAL_MILE


def test_every_five_minutes_has_a_window():
    study = named("gravity-paper-hours")
    (curve,) = study_curves(study)
    # one window of twelve samples ends at each sample from the thirteenth: the first hour is complete then
    np.testing.assert_allclose(curve.values, np.arange(12, 193) / 12, atol=5e-5)
    assert [len(labels) for labels in study.groups.values()] == [48, 60, 73]
    assert sorted(sum(study.groups.values(), ())) == sorted(study.scenarios)
    assert {round(study.scenarios[label]["hours"] * 3600.0) // 300 for label in study.scenarios} == {
        k - (round(round(k / 12, 4) * 3600) < 300 * k) for k in range(12, 193)
    }


@pytest.mark.parametrize("hours", [3, 7])
def test_half_the_scope_holds_the_truth_of_the_one_run(hours):
    scenario = named("gravity-paper").scenarios[f"{hours} h, half the scope"]
    whole = named("gravity-paper").scenarios[f"{hours} h"]
    half, full = (navopt.simulate("gravity-matching", seed=0, **words) for words in (scenario, whole))
    x = full.project(full.truth)
    np.testing.assert_allclose(half.project(half.truth), x, rtol=1e-12)
    assert (half.xl < x).all()
    assert (x < half.xu).all()
    np.testing.assert_allclose(half.xu[:2], full.xu[:2] / 2, rtol=6e-3)
    np.testing.assert_allclose(half.xu[2:], full.xu[2:], rtol=1e-3)


def test_a_little_of_the_study_runs(tmp_path):
    study = named("gravity-paper")
    labels = ("INS alone", "iccp", "single-point-abc", "affine-abc", "window-map")
    little = dataclasses.replace(
        study.replaced(worlds=2, budget=200),
        scenarios={"3 h": study.scenarios["3 h"]},
        solvers=tuple(entry for entry in study.solvers if entry.label in labels),
        printed=tuple(v for v in study.printed if v.scenario == "3 h" and v.solver in labels),
    )
    summary = run_study(little, tmp_path, workers=1)
    assert (summary.executed, summary.failed) == (10, 0)
    with ResultsStore(tmp_path) as store:
        table = printed_table(store)
        page = write_report(store).read_text(encoding="utf-8")
    assert "Printed and measured" in page
    assert "Curves" not in page
    ins = table[table["solver"] == "INS alone"].iloc[0]
    # one inertial run in all worlds, 3.5 % below the paper's initial error
    assert ins["minimum"] == ins["maximum"]
    assert 0.95 < ins["ours"] / ins["printed"] < 1.0


# -- curves ------------------------------------------------------------------------------------------
PLACES = {f"n{n}": {"n_var": n} for n in (2, 3, 5)}


def made(study, losses):
    """Runs with given losses by scenario and solver, a world each."""
    rows = [
        {"scenario": scenario, "solver": solver, "world": world, "seed": 1, "loss": loss, "cost": 9.0,
         "n_eval": 9.0, "elapsed_s": 0.1, "status": "budget", "key": f"{scenario} {solver} {world}"}
        for scenario, solvers in losses.items()
        for solver, values in solvers.items()
        for world, loss in enumerate(values)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def curve_study(**changes):
    values = {"scenarios": PLACES, "curve": ("n_var",), "rank_by": "loss", "worlds": tuple(range(6))}
    return small_study(**{**values, **changes})


def test_scenarios_that_differ_in_one_number_make_a_curve():
    study = curve_study(
        scenarios={
            "b": {"n_var": 4}, "a": {"n_var": 2.0}, "c": {"n_var": 3, "shift": True}, "d": {"shift": True},
            "e": {"n_var": 9, "shift": True}, "f": {"n_var": 9, "shift": False},
        }
    )  # fmt: skip
    first, second = study_curves(study)
    assert (first.values, first.scenarios, first.label) == ((2.0, 4.0), ("a", "b"), "")
    assert (second.values, second.scenarios, second.label) == ((3.0, 9.0), ("c", "e"), "shift = True")
    assert study_curves(small_study()) == []


def test_a_scenario_may_lie_on_several_curves():
    study = named("gravity-properties")
    curves = study_curves(study)
    assert [curve.key for curve in curves[::2]] == list(study.curve)
    common = set.intersection(*(set(curve.scenarios) for curve in curves[::2]))
    assert common == {"moved, 3 h, 3000"}
    assert [curve.axis for curve in curves[::2]] == [
        (1e-3, "initial error (km)"), (1.0, "heading error (°)"), (1.0, "scale error")
    ]  # fmt: skip


@pytest.mark.parametrize(
    "curve", [("n_vars",), ("shift",), ("n_var", "n_var")], ids=["unknown", "not a number", "twice"]
)
def test_what_is_no_curve_is_refused(curve):
    scenarios = {"a": {"n_var": 2, "shift": True}, "b": {"n_var": 3, "shift": False}, "c": {"n_var": 4}}
    with pytest.raises(InvalidInput, match="curve"):
        curve_study(scenarios=scenarios, curve=curve)


def test_a_list_of_numbers_stands_for_scenarios(tmp_path):
    more = '[groups]\nboth = ["plane"]\n[[printed]]\nsource = "Nobody"\nscenario = "both"\nsolver = "bees"\n'
    more += 'value = 3.0\nstatistic = "mean"\n'
    head = 'rank_by = "distance_1"\ncurve = "n_var"\n'
    path = write_toml(
        tmp_path, ('rank_by = "distance_1"\n', head), ("n_var = 2", "n_var = [2, 4, 5]"), more=more
    )
    study = Study.from_toml(path)
    assert list(study.scenarios) == ["plane, 2", "plane, 4", "plane, 5", "space"]
    assert study.groups == {"both": ("plane, 2", "plane, 4", "plane, 5")}
    assert study_curves(study)[0].values == (2.0, 3.0, 4.0, 5.0)
    assert Study.from_dict(study.to_dict()) == study
    assert study.printed[0].scenario == "both"


@pytest.mark.parametrize("values", ["[]", '["2"]', "[2, 2]", "[true]"])
def test_lists_that_name_no_scenarios_are_refused(tmp_path, values):
    head = 'rank_by = "distance_1"\ncurve = "n_var"\n'
    changes = ('rank_by = "distance_1"\n', head), ("n_var = 2", f"n_var = {values}")
    with pytest.raises(InvalidInput, match="n_var"):
        Study.from_toml(write_toml(tmp_path, *changes))


def test_curve_table_and_picture_show_medians_and_shares():
    study = curve_study(success=(Success("loss", (2.5,)),))
    losses = {
        f"n{n}": {"bees": n * np.arange(1.0, 7.0), "random-search": np.full(6, 10.0 * n)} for n in (5, 2, 3)
    }
    runs = made(study, losses)
    from comparisons.statistics import ranked_table

    table = curve_table(ranked_table(runs, study), study)
    bees = table[table["solver"] == "bees"]
    assert list(bees["value"]) == [2.0, 3.0, 5.0]
    np.testing.assert_allclose(bees["median"], [7.0, 10.5, 17.5])  # 3.5 times n
    np.testing.assert_allclose(bees["p[< 2.5]"], [1 / 6, 0.0, 0.0])
    figure = curve_picture(table, study)
    score, share = figure.axes
    drawn = {line.get_label(): line.get_xydata() for line in score.get_lines()}
    np.testing.assert_allclose(drawn["bees"], [[2, 7.0], [3, 10.5], [5, 17.5]])
    np.testing.assert_allclose(drawn["random-search"], [[2, 20.0], [3, 30.0], [5, 50.0]])
    np.testing.assert_allclose(share.get_lines()[1].get_ydata(), [100 / 6, 0.0, 0.0])
    with pytest.raises(UnknownName, match="curve"):
        curve_picture(table, study, curve=1)
    with pytest.raises(InvalidInput, match="study"):
        curve_table(table)


def test_few_worlds_have_no_shares_and_failures_break_the_line():
    study = curve_study(worlds=(0, 1), success=(Success("loss", (2.5,)),))
    runs = made(study, {f"n{n}": {"bees": [n, np.inf if n == 3 else n]} for n in (2, 3, 5)})
    from comparisons.statistics import ranked_table

    (score,) = curve_picture(curve_table(ranked_table(runs, study), study), study).axes
    (line,) = score.get_lines()
    np.testing.assert_array_equal(np.isfinite(line.get_ydata()), [True, False, True])


def test_report_has_the_curve_and_leaves_out_its_places_pictures(tmp_path):
    study = curve_study(worlds=(0, 1), rank_by="distance_1")
    run_study(study, tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        page = write_report(store).read_text(encoding="utf-8")
    assert "<h2>Curves</h2>" in page
    assert page.count("<figure>") == 1  # the places have tables, but no box plots of their own
    assert page.count("<h3>") == 3
    assert "curves.csv" not in page
    written = pd.read_csv(tmp_path / "curves.csv")
    assert list(written["value"].unique()) == [2.0, 3.0, 5.0]


def test_places_of_a_long_curve_have_no_tables(tmp_path, capsys):
    study = small_study(
        scenarios={f"{k:02d}": {"n_var": 2, "lower": -5.0 - k, "upper": 6.0} for k in range(30)},
        curve=("lower",), worlds=(0,), budget=20,
        solvers=(SolverEntry("random-search", settings={"pop_size": 20}),),
    )  # fmt: skip
    assert places_of_long_curves(study) == set(study.scenarios)
    assert places_of_long_curves(curve_study()) == set()
    run_study(study, tmp_path, workers=1)
    from comparisons.statistics import print_ranked

    with ResultsStore(tmp_path) as store:
        page = write_report(store).read_text(encoding="utf-8")
        print_ranked(store)
    assert "The numbers of 30 scenarios on these curves are in curves.csv" in page
    assert page.count("<h3>") == 0
    assert "curves are in the report" in capsys.readouterr().out


def test_a_printed_value_may_be_of_a_group():
    value = Printed("Nobody", "all", "bees", 4.0, statistic="mean")
    study = curve_study(groups={"all": ("n2", "n5")}, printed=(value,))
    runs = made(study, {"n2": {"bees": [1.0, 2.0]}, "n3": {"bees": [99.0]}, "n5": {"bees": [3.0, 10.0]}})
    row = printed_table(runs, study).iloc[0]
    assert (row["ours"], row["runs"], row["verdict"]) == (
        4.0, 4, "inside our range, 75 % of our runs are lower; equals our mean"
    )  # fmt: skip
    with pytest.raises(UnknownName, match="scenario of a printed value"):
        curve_study(groups={"all": ("n2", "n5")}, printed=(dataclasses.replace(value, scenario="al"),))


# -- bounds along a voyage ---------------------------------------------------------------------------
@pytest.fixture(scope="module")
def voyage():
    return navopt.simulate("gravity-matching", seed=0, hours=2.0, degree=720)


@pytest.fixture(scope="module")
def bounds(voyage):
    return information_along(voyage)


def test_bounds_at_the_last_sample_are_those_of_the_problem(voyage, bounds):
    last = bounds.iloc[-1]
    assert last["hours"] == 2.0
    assert len(bounds) == 25
    whole = np.sqrt(np.trace(track_error_bound(voyage)[-1]))
    assert last["track_m"] == pytest.approx(whole, rel=1e-9)
    # the voyage's own window has its prior from strapdown runs instead of the linear model
    window = np.sqrt(np.trace(window_error_bound(voyage)[-1]))
    assert last["window_m"] == pytest.approx(window, rel=0.02)
    assert bounds["window_m"].isna().sum() == 11


def test_measurements_only_add_to_what_is_known(bounds):
    assert (bounds["track_m"] <= bounds["ins_m"] * (1 + 1e-9)).all()
    known = bounds.dropna()
    assert (known["track_m"] <= known["window_m"] * 1.001).all()
    assert bounds["ins_m"].is_monotonic_increasing


def test_a_constant_field_tells_nothing(voyage):
    area = voyage.field_map
    track = voyage.track
    flat = GravityMatching(
        FieldMap(area.latitude, area.longitude, np.zeros(area.shape), unit="mGal"),
        MeasuredTrack(
            time=track.time, latitude=track.latitude, longitude=track.longitude,
            measured=np.zeros(len(track)), true_latitude=track.true_latitude,
            true_longitude=track.true_longitude,
        ),
        position_covariance=voyage.position_covariance, ins_errors=voyage.ins_errors,
    )  # fmt: skip
    table = information_along(flat)
    np.testing.assert_allclose(table["track_m"], table["ins_m"], rtol=1e-9)
    known = table.dropna()
    # directions that move no sample by 5 m are left out of a window's prior
    np.testing.assert_allclose(known["window_m"], known["ins_m"], rtol=1e-3)


def test_without_truth_there_is_no_bound(voyage):
    track = voyage.track
    blind = GravityMatching(
        voyage.field_map,
        MeasuredTrack(
            time=track.time, latitude=track.latitude, longitude=track.longitude, measured=track.measured
        ),
        position_covariance=voyage.position_covariance,
        ins_errors=voyage.ins_errors,
    )
    with pytest.raises(NoBound, match="truth"):
        information_along(blind)


def test_picture_of_the_bounds_draws_them(voyage, bounds):
    figure = information_picture(voyage, bounds)
    panel = figure.axes[-1] if figure.axes[-1].get_lines() else figure.axes[-2]
    drawn = [line.get_ydata() for line in panel.get_lines()]
    for values, column in zip(drawn, SHOWN, strict=True):
        np.testing.assert_allclose(values, bounds[column] / 1e3)
