"""Printed values beside ours, ranks over scenarios, and the studies of functions that use both."""

from __future__ import annotations

import dataclasses
import functools
import json
import os
import tomllib

import numpy as np
import pandas as pd
import pytest
import scipy.stats
from rich.console import Console
from study_tools import small_study, write_toml
from typer.testing import CliRunner

from comparisons import cli
from comparisons.convergence import GAP_FLOOR, convergence, convergence_bands, known_minimum
from comparisons.entries import Printed
from comparisons.overall import (
    critical_difference,
    overall_cells,
    overall_frame,
    overall_ranks,
    overall_words,
)
from comparisons.overall_figure import rank_picture
from comparisons.printed import print_printed, printed_cells, printed_table
from comparisons.provenance import study_toml
from comparisons.report import write_report
from comparisons.runner import run_study
from comparisons.statistics import ranked_table
from comparisons.store import ResultsStore
from comparisons.study import SolverEntry, Study, Success
from navopt.algorithms import FruitFly, GaussianFruitFly, StudentFruitFly
from navopt.errors import InvalidInput, UnknownName

SOURCE = "Nobody (2020), Table 1"


def printed(value, **changes):
    return Printed(SOURCE, "plane", "bees", value, **changes)


def study_of(*values, **changes):
    return small_study(printed=values, rank_by="loss", **changes)


def made(study, scores, *, failed=()):
    """Runs with the given losses, one world each, by scenario and solver."""
    rows = [
        {"scenario": scenario, "solver": solver, "world": world, "seed": 1, "loss": loss, "cost": 9.0,
         "n_eval": 9.0, "elapsed_s": 0.1, "status": "failed" if (solver, world) in failed else "budget",
         "key": f"{scenario} {solver} {world}"}
        for scenario, solvers in scores.items()
        for solver, losses in solvers.items()
        for world, loss in enumerate(losses)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def row_of(value, losses, **more):
    study = study_of(value, **more)
    return printed_table(made(study, {"plane": {"bees": losses}}), study).iloc[0]


# -- the values ------------------------------------------------------------------------------------
def test_values_survive_every_form_of_a_study():
    study = small_study(
        printed=(
            printed(7.11e-15, score="loss", note='said "so"'),
            printed(0.96, statistic="share", below=0.5),
            printed(2.0, statistic="mean"),
        ),
        groups={"both": ("plane", "space")},
        lockstep=True,
        seed_per_world=True,
    )
    assert Study.from_dict(json.loads(json.dumps(study.to_dict()))) == study
    assert Study.from_dict(tomllib.loads(study_toml(study))) == study
    assert [value.score for value in study.printed] == ["loss", "distance_1", "distance_1"]  # rank_by


def test_one_table_may_hold_the_values_of_many_solvers(tmp_path):
    more = f'[[printed]]\nsource = "{SOURCE}"\nscenario = "space"\nscore = "loss"\n'
    path = write_toml(tmp_path, more=more + 'values = { bees = 1, "random-search" = 2.5 }\n')
    assert [(v.solver, v.value, v.score) for v in Study.from_toml(path).printed] == [
        ("bees", 1.0, "loss"),
        ("random-search", 2.5, "loss"),
    ]
    with pytest.raises(InvalidInput, match=r"printed\[0\]: solver.*beside values"):
        Study.from_toml(write_toml(tmp_path, more=more + 'solver = "bees"\nvalues = { bees = 1 }\n'))


@pytest.mark.parametrize(
    ("lines", "error", "words"),
    [
        ('scenario = "plain"\nsolver = "bees"\nvalue = 1', UnknownName, "did you mean 'plane'"),
        ('scenario = "plane"\nsolver = "bee"\nvalue = 1', UnknownName, "did you mean 'bees'"),
        ('scenario = "plane"\nsolver = "bees"\nvalue = 1\nstatistic = "medan"', UnknownName, "median"),
        ('scenario = "plane"\nsolver = "bees"\nvalu = 1', UnknownName, "did you mean 'value'"),
        ('scenario = "plane"\nsolver = "bees"', InvalidInput, "required"),
        ('scenario = "plane"\nsolver = "bees"\nvalue = "1"', InvalidInput, "a number"),
        ('scenario = "plane"\nsolver = "bees"\nvalue = nan', InvalidInput, "the printed number"),
        ('scenario = "plane"\nsolver = "bees"\nvalue = 1\nbelow = 2', InvalidInput, "share"),
        ('scenario = "plane"\nsolver = "bees"\nvalue = 96\nstatistic = "share"\nbelow = 2', InvalidInput,
         "not per cent"),
        ('scenario = "plane"\nvalues = { bees = true }', InvalidInput, "a number"),
        ('scenario = "plane"\nvalues = {}', InvalidInput, "at least one"),
    ],
)  # fmt: skip
def test_unusable_values_are_refused_naming_the_file(tmp_path, lines, error, words):
    path = write_toml(tmp_path, more=f'[[printed]]\nsource = "x"\n{lines}\n')
    with pytest.raises(error, match=r"small\.toml") as caught:
        Study.from_toml(path)
    assert words in str(caught.value)


def test_values_without_a_source_or_twice_are_refused():
    with pytest.raises(InvalidInput, match="source"):
        Printed(" ", "plane", "bees", 1.0)
    with pytest.raises(InvalidInput, match="once only"):
        study_of(printed(1.0), printed(2.0))
    study_of(printed(1.0), printed(2.0, statistic="mean"))


def test_values_are_no_part_of_a_run(tmp_path):
    plain = small_study()
    run_study(plain, tmp_path, workers=1)
    more = small_study(printed=(printed(1.0),), groups={"one": ("plane",)}, lockstep=True)
    assert [spec.key for spec in more.runs()] == [spec.key for spec in plain.runs()]
    assert run_study(more, tmp_path, workers=1).executed == 0
    with ResultsStore(tmp_path) as store:
        assert store.study == more
        assert store.meta["study"]["printed"][0]["source"] == SOURCE


def test_a_score_that_runs_do_not_have_is_refused(tmp_path):
    with pytest.raises(UnknownName, match="score of a printed value"):
        run_study(small_study(printed=(printed(1.0, score="gap"),)), tmp_path, workers=1)


@pytest.mark.parametrize(
    ("value", "digits", "half_unit"),
    [(7.11e-15, 3, 5e-18), (-10.872299, 8, 5e-7), (0.5, 1, 0.05), (120.0, 2, 0.05), (0.0, 1, 0.05)],
)
def test_a_number_stands_for_what_rounds_to_it(value, digits, half_unit):
    assert printed(value).digits == digits
    assert printed(value).half_unit == pytest.approx(half_unit, rel=1e-12)


# -- the comparison --------------------------------------------------------------------------------
TENS = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0]


@pytest.mark.parametrize(
    ("value", "place", "lower", "words"),
    [
        (3.5, "inside", 0.3, "inside our range, 30 % of our runs are lower; 0.64 times our median"),
        (4.0, "inside", 0.35, "35 % of our runs are lower"),
        (5.5, "inside", 0.5, "equals our median"),
        (5.6, "inside", 0.5, "1.8 % above our median"),
        (0.96, "below", 0.0, "lower than all our runs; 0.17 times our median"),
        (0.05, "below", 0.0, "lower than all our runs; 2 orders of magnitude below our median"),
        (99.0, "above", 1.0, "higher than all our runs; 1 order of magnitude above our median"),
        (-1.5, "below", 0.0, "lower than all our runs; 7.00 below our median"),
    ],
)
def test_where_a_value_lies_among_single_runs(value, place, lower, words):
    row = row_of(printed(value), TENS)
    assert (row["place"], row["lower"]) == (place, pytest.approx(lower))
    assert (row["median"], row["minimum"], row["maximum"], row["runs"]) == (5.5, 1.0, 10.0, 10)
    assert words in row["verdict"]


def test_rounding_is_allowed_for():
    assert row_of(printed(0.333), [1 / 3] * 3)["verdict"] == (
        "inside our range, 0 % of our runs are lower; rounds to our median"
    )
    assert row_of(printed(0.332), [1 / 3] * 3)["place"] == "below"
    assert row_of(printed(-10.872299), [-10.87230010562] * 3)["place"] == "above"  # as printed, no rounding


def test_other_statistics_are_compared_with_their_own_kind():
    table = {
        name: row_of(printed(5.0, statistic=name), TENS) for name in ("mean", "sd", "minimum", "maximum")
    }
    assert table["mean"]["ours"] == np.mean(TENS)
    assert table["sd"]["ours"] == pytest.approx(np.std(TENS, ddof=1), rel=1e-15)
    assert table["sd"]["place"] == ""
    assert table["sd"]["verdict"] == "1.7 times our SD"
    assert (table["minimum"]["ours"], table["maximum"]["ours"]) == (1.0, 10.0)
    assert "0.50 times our highest" in table["maximum"]["verdict"]
    assert "0.91 times our mean" in table["mean"]["verdict"]


@pytest.mark.parametrize(("share", "place"), [(0.5, "inside"), (0.05, "below"), (0.95, "above")])
def test_shares_are_compared_with_the_interval_of_ours(share, place):
    row = row_of(printed(share, statistic="share", below=4.5), TENS)
    assert (row["ours"], row["place"]) == (0.4, place)
    assert row["verdict"] == f"{place} the interval of our share"


def test_failures_are_the_worst_and_missing_runs_are_said():
    study = study_of(printed(3.0), printed(3.0, statistic="mean"), printed(1.0, statistic="maximum"))
    runs = made(study, {"plane": {"bees": [1.0, 2.0, 9.0]}}, failed={("bees", 0), ("bees", 1)})
    table = printed_table(runs, study)
    assert "our median is a failure" in table["verdict"][0]
    assert table["ours"][1] == 9.0  # over the runs that succeeded
    assert "our highest is a failure" in table["verdict"][2]
    nothing = printed_table(runs.iloc[:0], study)
    assert set(nothing["verdict"]) == {"no runs yet"}
    assert set(nothing["place"]) == {""}
    assert "–" in printed_cells(nothing, study).to_numpy()
    with pytest.raises(InvalidInput, match="give the Study"):
        printed_table(runs)


def test_cells_have_the_unit_of_the_study_and_the_printed_digits():
    study = small_study(
        printed=(
            printed(-10.872299, score="loss"),
            printed(1500.0),
            printed(0.9, statistic="share", below=2000.0),
        ),
        display={"scale": 0.001, "unit": "km", "label": "error"},
    )
    runs = made(study, {"plane": {"bees": [-10.8723001, -10.87]}})
    cells = printed_cells(printed_table(runs.assign(**{"score.distance_1": [1000.0, 4000.0]}), study), study)
    assert list(cells["printed"]) == ["−10.872299", "1.5", "0.9"]
    assert list(cells["of"]) == ["loss, one run", "error (km), one run", "share of error < 2.00 km"]
    assert list(cells["lowest"]) == ["−10.8723", "1.00", "1.00"]
    assert list(cells["our median"]) == ["−10.8712", "2.50", "2.50"]
    assert list(cells["ours"]) == ["−10.8712", "2.50", "0.500"]
    assert "ours" not in printed_cells(printed_table(runs, study_of(printed(1.0))), study_of(printed(1.0)))


# -- ranks over scenarios --------------------------------------------------------------------------
LABELS = [f"s{k}" for k in range(6)]


def ranked_study(n=8, k=6, **changes):
    return small_study(
        rank_by="loss", scenarios={f"f{j}": {"n_var": 2 + j} for j in range(n)},
        solvers=tuple(SolverEntry("abc", LABELS[i], {"pop_size": 6 + i}) for i in range(k)), **changes,
    )  # fmt: skip


def drawn(study, rng, *, planted=0.0, ties=False):
    values = rng.normal(size=(len(study.scenarios), len(study.solvers))) + planted * np.arange(
        len(study.solvers)
    )
    values = np.round(values) if ties else values
    return values, made(
        study,
        {
            scenario: {entry.label: [value] * 2 for entry, value in zip(study.solvers, line, strict=True)}
            for scenario, line in zip(study.scenarios, values, strict=True)
        },
    )


@pytest.mark.parametrize("ties", [False, True])
def test_ranks_and_tests_are_those_of_scipy(ties):
    study = ranked_study()
    values, runs = drawn(study, np.random.default_rng(4), planted=0.4, ties=ties)
    (over,) = overall_ranks(runs, study)
    ranks = scipy.stats.rankdata(values, axis=1)
    assert over.group == "all scenarios"
    assert over.mean.to_dict() == pytest.approx(dict(zip(LABELS, ranks.mean(axis=0), strict=True)), abs=1e-12)
    assert list(over.mean) == sorted(over.mean)
    expected = scipy.stats.friedmanchisquare(*values.T)
    assert (over.chi2, over.p_friedman) == pytest.approx(tuple(expected), rel=1e-12)
    if not ties:  # Iman and Davenport's F is that of a two-way analysis of variance of the ranks
        n, k = values.shape
        between = n * np.sum((ranks.mean(axis=0) - ranks.mean()) ** 2) / (k - 1)
        rest = np.sum((ranks - ranks.mean(axis=0)) ** 2) / ((n - 1) * (k - 1))
        assert over.p_iman == pytest.approx(
            scipy.stats.f.sf(between / rest, k - 1, (k - 1) * (n - 1)), rel=1e-9
        )


@pytest.mark.parametrize("ties", [False, True])
def test_nemenyi_is_that_of_scikit_posthocs(ties):
    posthocs = pytest.importorskip("scikit_posthocs")
    study = ranked_study()
    values, runs = drawn(study, np.random.default_rng(7), planted=0.6, ties=ties)
    (over,) = overall_ranks(runs, study)
    frame = pd.DataFrame(values, columns=LABELS)
    expected = posthocs.posthoc_nemenyi_friedman(frame)
    order = list(over.mean.index)
    np.testing.assert_allclose(over.p_nemenyi.to_numpy(), expected.loc[order, order].to_numpy(), atol=1e-9)
    gaps = np.abs(over.mean.to_numpy()[:, None] - over.mean.to_numpy())
    np.testing.assert_array_equal(over.p_nemenyi < 0.05, gaps >= over.critical_difference)


@pytest.mark.parametrize(
    ("k", "q"),
    [(3, 2.343), (4, 2.569), (5, 2.728), (6, 2.850), (7, 2.949), (8, 3.031), (9, 3.102), (10, 3.164)],
)
def test_the_critical_difference_is_that_of_demsars_table(k, q):
    assert critical_difference(k, 11) / np.sqrt(k * (k + 1) / 66) == pytest.approx(q, abs=1e-3)


def test_groups_are_ranked_apart_and_say_who_leads(tmp_path):
    groups = {"first": ("f0", "f1", "f2", "f3"), "second": ("f4", "f5", "f6"), "few": ("f6", "f7")}
    study = ranked_study(groups=groups)
    _, runs = drawn(study, np.random.default_rng(1), planted=3.0)
    runs = runs[~((runs["solver"] == "s5") & (runs["scenario"] == "f4"))]
    first, second = overall_ranks(runs, study)
    assert (first.group, second.group) == ("first", "second")  # two scenarios are too few
    assert list(first.ranks.columns) == ["f0", "f1", "f2", "f3"]
    assert second.left_out == ("s5",)
    assert "left out: s5" in overall_words(second)
    words = overall_words(first)
    assert words.startswith("first: s0 has the lowest mean rank over 4 scenarios")
    assert "Not told apart from the first: s1" in words
    assert "s5" not in first.not_told_apart
    frame = overall_frame([first, second])
    assert len(frame) == 11
    assert frame.loc[0, "p_best"] == pytest.approx(1.0)
    assert overall_cells(first)["solver"][1] == "s1 ≈"
    picture = rank_picture(first, study)
    assert [t.get_text().split()[0] for t in picture.axes[0].get_yticklabels()] == list(first.mean.index)
    bars = [
        line for line in picture.axes[0].lines if len(line.get_xdata()) == 2 and line.get_marker() == "None"
    ]
    for bar, mean in zip(bars, first.mean, strict=True):
        assert np.ptp(bar.get_xdata()) == pytest.approx(first.critical_difference)
        assert np.mean(bar.get_xdata()) == pytest.approx(mean)


def test_ties_everywhere_are_no_order():
    study = ranked_study()
    runs = made(study, {f: {label: [1.0] for label in LABELS} for f in study.scenarios})
    (over,) = overall_ranks(runs, study)
    assert (over.p_friedman, over.p_iman) == (1.0, 1.0)
    assert set(over.mean) == {3.5}
    assert "may be chance" in overall_words(over)
    assert not overall_ranks(runs.iloc[:0], study)


def test_groups_of_unknown_scenarios_are_refused(tmp_path):
    with pytest.raises(UnknownName, match="did you mean 'plane'"):
        small_study(groups={"a": ("plan",)})
    with pytest.raises(InvalidInput, match="at least one"):
        small_study(groups={"a": ()})
    with pytest.raises(InvalidInput, match="list of scenario labels"):
        Study.from_toml(write_toml(tmp_path, more='[groups]\na = "plane"\n'))


# -- convergence above a known minimum -------------------------------------------------------------
def test_the_minimum_is_known_from_the_gaps():
    runs = pd.DataFrame({"loss": [0.5, -0.25, 2.0], "score.gap_1": [1.25, 0.5, 2.75]})
    assert known_minimum(runs) == -0.75
    assert known_minimum(runs.assign(loss=[0.5, -0.25, 2.1])) is None  # another minimum in every world
    assert known_minimum(runs[["loss"]]) is None
    assert known_minimum(runs.iloc[:0]) is None


def test_convergence_shows_the_distance_from_the_minimum_on_a_logarithmic_axis(tmp_path):
    study = Study(
        name="zettl", problem="zettl", scenarios={"plain": {}, "shifted": {"shift": True}}, worlds=(0, 1, 2),
        seed_per_world=True, budget=600, solvers=(SolverEntry("foa"), SolverEntry("random-search")),
        rank_by="gap_1", lockstep=True,
    )  # fmt: skip
    run_study(study, tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        _, bands, ends, above = convergence_bands(store, scenario="plain", grid=np.array([100, 600]))
        runs, traces = store.runs(), store.traces()
        figure = convergence(store, scenario="shifted")
    assert above
    assert ends == {"foa": 600, "random-search": 600}
    assert set(bands) == {"foa", "random-search"}
    for label, band in bands.items():
        own = runs[(runs["solver"] == label) & (runs["scenario"] == "plain")]
        gaps = np.maximum(own["loss"] + 0.0037912371501199, GAP_FLOOR)
        np.testing.assert_allclose(band[:, -1], np.quantile(gaps, [0.25, 0.5, 0.75]), rtol=1e-6, atol=1e-15)
        early = [traces[k]["loss"][traces[k]["cost"] <= 100].min() for k in own["key"]]
        np.testing.assert_allclose(band[1, 0], np.median(early) + 0.0037912371501199, rtol=1e-6)
    axes = figure.axes[0]
    assert axes.get_yscale() == "log"
    assert axes.get_ylabel() == "best loss so far, above the minimum"
    assert len(axes.collections) == 2  # a band for each


# -- the studies -----------------------------------------------------------------------------------
named = functools.cache(Study.named)  # planning thirteen thousand runs takes seconds


def part(study, *labels):
    """A study of some of the functions, plain and shifted."""
    kept = {*labels, *(f"{label}, shifted" for label in labels)}
    return dataclasses.replace(
        study,
        scenarios={label: place for label, place in study.scenarios.items() if label in kept},
        groups={name: [label for label in group if label in kept] for name, group in study.groups.items()},
        printed=[value for value in study.printed if value.scenario in kept],
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("functions")
    study = part(named("functions-000").replaced(worlds=2, budget=60), "Ackley", "Zettl", "Wood")
    run_study(study, folder, workers=1)
    return folder


def test_table_1_is_compared_on_the_page_and_the_console(folder, monkeypatch):
    # drawing is tested elsewhere, and of fourteen pictures takes ten seconds
    monkeypatch.setattr("comparisons.pages.render", lambda figure, **options: b"")
    for name in ("convergence", "error_boxes"):
        monkeypatch.setattr(f"comparisons.report.{name}", lambda *a, **k: None)
    with ResultsStore(folder) as store:
        study, table = store.study, printed_table(store)
        text = write_report(store, folder).read_text(encoding="utf-8")
        console = Console(width=200, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
        print_printed(store, console)
        said = console.export_text()
    assert len(table) == 3 * 4
    assert set(table["solver"]) == {f"{name}, published" for name in ("PSO", "FOA", "GFOA", "IFOA")}
    assert not table["scenario"].str.contains("shifted").any()
    # against the numbers of the paper's table, typed in once more
    wide = table.pivot(index="scenario", columns="solver", values="printed")
    assert wide.loc["Ackley"].tolist() == [0.049512, 0.017546, 7.11e-15, 0.440788]
    assert wide.loc["Zettl"].tolist() == [0.002592, 0.001333, 3.07e-11, 0.013575]
    assert wide.loc["Wood"].tolist() == [0.852053, 1.414687, 0.000161, 1.777238]
    for words in ("Printed and measured", "Wan et al. (2020), Table 1", "Ranks over all scenarios",
                  "positive candidates cannot go below 0", "7.11e−15", "equal share"):  # fmt: skip
        assert words in text, words
    assert "7.11e−15" in said
    assert len(pd.read_csv(folder / "printed.csv")) == 12
    assert set(pd.read_csv(folder / "ranks.csv")["group"]) == {"plain", "shifted"}
    assert text.count("<img") == 6 * 2 + 2
    assert study.replaced(worlds=1).printed == study.printed


def test_the_command_prints_both(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("comparisons.report.write_report", lambda store, path: path)
    monkeypatch.setattr(os, "environ", {**os.environ, "COLUMNS": "150"})
    with ResultsStore(folder) as store:
        (tmp_path / "part.toml").write_text(study_toml(store.study), encoding="utf-8")
    arguments = ["run", str(tmp_path / "part.toml"), "--workers", "1", "--out", str(folder)]
    result = CliRunner().invoke(cli.app, arguments)
    assert result.exit_code == 0, result.output
    assert "Printed and measured: Wan et al. (2020), Table 1" in result.stdout
    assert "Ranks over plain" in result.stdout
    assert "Ranks over shifted" in result.stdout


def test_the_published_readings_are_those_of_the_classes():
    entries = {entry.label: entry for entry in named("functions-000").solvers}
    for label, cls in (("FOA", FruitFly), ("GFOA", GaussianFruitFly), ("IFOA", StudentFruitFly)):
        assert cls(**entries[f"{label}, published"].settings).settings == cls.published().settings
        boxed = cls(**entries[f"{label}, box"].settings).settings
        assert boxed == cls.published(encoding="box").settings
        assert entries[f"{label}, direct"].settings == {}


@pytest.mark.parametrize("name", ["functions-000", "functions-2020", "functions-20000"])
def test_plain_and_shifted_are_the_same_functions(name):
    study = named(name)
    assert set(study.groups) == {"plain", "shifted"}
    assert study.groups["shifted"] == tuple(f"{label}, shifted" for label in study.groups["plain"])
    assert set(study.scenarios) == {*study.groups["plain"], *study.groups["shifted"]}
    for label in study.groups["plain"]:
        problem, keywords = study.place(label)
        assert study.place(f"{label}, shifted") == (problem, {**keywords, "shift": True})
    assert len({spec.key for spec in study.replaced(worlds=1).runs()}) == len(study.scenarios) * len(
        study.solvers
    )


def test_all_swarms_run(tmp_path):
    study = part(named("functions-2020"), "Zettl", "Test tube holder", "Rastrigin 10")
    summary = run_study(study.replaced(worlds=1, budget=45), tmp_path, workers=1)
    assert (summary.executed, summary.failed) == (6 * 18, 0)
    with ResultsStore(tmp_path) as store:
        assert [len(over.mean) for over in overall_ranks(store)] == [18, 18]
        assert (store.runs()["score.gap_1"] >= 0).all()


def test_success_thresholds_still_stand_beside_printed_values(tmp_path):
    study = small_study(success=(Success("distance_1", (1.0,)),), printed=(printed(0.5),))
    run_study(study, tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        assert list(printed_table(store)["runs"]) == [2]
        assert len(ranked_table(store)) == 4
