"""Ablations: variants and labels, effects against closed forms, and the way through runner and report."""

from __future__ import annotations

import itertools
import tomllib

import numpy as np
import pandas as pd
import pytest
import scipy.stats
from typer.testing import CliRunner

from comparisons import Ablation, ResultsStore, Study, effect_table, run_study, write_report
from comparisons.ablation_design import Design
from comparisons.cli import app
from comparisons.effects import POOLED, effect_size, vargha_delaney
from comparisons.effects_page import CONTRASTS, effect_cells, effect_groups, effect_notes, forest
from comparisons.measures import wilcoxon_p
from comparisons.provenance import study_toml
from comparisons.study import SolverEntry, list_studies
from comparisons.wording import Display
from navopt.errors import InvalidInput, UnknownName

READY = ("ablation-000", "ablation-001", "ablation-003", "ablation-004")
SPHERES = {"plane": ("sphere", {"n_var": 2}), "Ackley": ("ackley", {"n_var": 2, "shift": True})}


def small(**changes):
    """Bees with two switches, on two problems."""
    values = {
        "vary": {"dimensions": ["one", "all"], "pop_size": [4, 12]},
        "problems": SPHERES,
        "budget": 60,
        "worlds": 3,
        "name": "bees",
        "rank_by": "gap_1",
    }
    return Ablation(("abc", {"pop_size": 8}), **{**values, **changes})


def frame(scores, *, study, seeds=(1,)):
    """Runs of a study from ``scores[scenario][label]`` of shape (worlds, seeds)."""
    rows = [
        {
            "scenario": scenario, "world": world, "solver": label, "seed": seed, "status": "budget",
            "loss": values[w, s], "x": np.array([values[w, s]]),
            "settings": {"options": {"dimensions": "one"}},
        }
        for scenario, own in scores.items()
        for label, values in own.items()
        for w, world in enumerate(study.worlds)
        for s, seed in enumerate(seeds)
    ]  # fmt: skip
    return pd.DataFrame(rows)


# -- variants --------------------------------------------------------------------------------------
def test_one_at_a_time_leaves_out_what_the_base_has_anyway():
    study = small().study()
    assert [entry.label for entry in study.solvers] == ["base", "dimensions=all", "pop_size=4", "pop_size=12"]
    assert [entry.settings for entry in study.solvers] == [
        {"pop_size": 8},
        {"pop_size": 8, "dimensions": "all"},
        {"pop_size": 4},
        {"pop_size": 12},
    ]
    assert study.problem == "sphere"
    assert study.place("Ackley") == ("ackley", {"n_var": 2, "shift": True})
    assert {spec.problem for spec in study.runs()} == {"sphere", "ackley"}
    assert len(study.runs()) == 4 * 2 * 3


def test_factorial_has_every_combination_once():
    ablation = small(design="factorial", vary={"dimensions": "all", "pop_size": [4, 12], "scouts": "all"})
    study = ablation.study()
    assert len(study.solvers) == 2 * 3 * 2
    found = {tuple(sorted(entry.settings.items())) for entry in study.solvers}
    assert len(found) == 12
    assert study.solvers[0].label == "base"
    assert "dimensions=all, pop_size=12, scouts=all" in {entry.label for entry in study.solvers}
    design = Design.from_table(study.ablation)
    for level in design.levels():
        pairs = design.pairs(level)
        assert len(pairs) == 12 // (3 if level.ingredient == "pop_size" else 2)
        assert all(level.label in other and level.label not in base for base, other in pairs)


def test_levels_of_several_options_and_of_another_solver():
    vary = {"trials": {"wild": {"dimensions": "all", "scouts": "all"}, "none": {"solver": "random-search"}}}
    study = small(vary=vary).study()
    assert study.solvers[1] == SolverEntry(
        "abc", "trials=wild", {"pop_size": 8, "dimensions": "all", "scouts": "all"}
    )
    assert study.solvers[2] == SolverEntry("random-search", "trials=none", {})
    with pytest.raises(InvalidInput, match="one-at-a-time"):
        small(vary=vary, design="factorial")
    with pytest.raises(InvalidInput, match="one ingredient"):
        small(vary={"dimensions": "all", "both": {"x": {"dimensions": "all"}}}, design="factorial")


def test_scenarios_are_named_by_what_they_are():
    study = small(problems=["ackley", ("sphere", {"n_var": 2})]).study()
    assert list(study.scenarios) == ["ackley", "sphere: n_var=2"]
    alone = small(problems=[("sphere", {"n_var": 2})]).study()
    assert alone.scenarios == {"sphere: n_var=2": {"n_var": 2}}
    with pytest.raises(InvalidInput, match="once only"):
        small(problems=["ackley", "ackley"])


def test_a_scenario_of_another_problem_has_the_keys_of_that_problem():
    one = Study(
        name="x", problem="ackley", scenarios={"a": {"n_var": 2}}, solvers=(SolverEntry("abc"),),
        worlds=(0,), budget=9,
    )  # fmt: skip
    several = Study(
        name="x", problem="sphere", scenarios={"a": {"problem": "ackley", "n_var": 2}, "b": {}},
        solvers=(SolverEntry("abc"),), worlds=(0,), budget=9,
    )  # fmt: skip
    assert several.runs()[0].key == one.runs()[0].key
    wrong = {"a": {"problem": "akley"}}
    with pytest.raises(UnknownName, match="did you mean 'ackley'"):
        Study(
            name="x", problem="sphere", scenarios=wrong, solvers=several.solvers, worlds=(0,), budget=9
        ).check()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vary": {"dimension": "all"}}, "did you mean 'dimensions'"),
        ({"vary": {"dimensions": "some"}}, "known: all, one"),
        ({"vary": {"dimensions": "one"}}, "base does not have"),
        ({"vary": {}}, "at least one option"),
        ({"vary": {"dimensions": []}}, "at least one value"),
        ({"vary": {"limit": [None]}}, "None has no form"),
        ({"vary": {"dimensions": ["all", "all"]}}, "once only"),
        ({"vary": {"trials": {"wild": 3}}}, "table of settings"),
        ({"design": "factorials"}, "did you mean 'factorial'"),
        ({"problems": {}}, "list of problems"),
        ({"contrasts": {"size": ("plane", "spce")}}, "known: Ackley, plane"),
        ({"contrasts": {"size": ("plane", "plane")}}, "two scenarios"),
        ({"contrasts": {"size": ("plane", "Ackley")}, "rank_by": "loss"}, "losses of two scenarios"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_with_a_remedy(changes, message):
    with pytest.raises(InvalidInput, match=message):
        small(**changes).study().check()
    with pytest.raises(UnknownName, match="did you mean 'abc'"):
        Ablation("abcd", vary={"limit": 3}, problems=["sphere"])


# -- file ------------------------------------------------------------------------------------------
def test_toml_round_trip(tmp_path):
    ablation = small(
        contrasts={"place": ["plane", "Ackley"]},
        others=[SolverEntry("random-search")],
        vary={"pop_size": 4, "trials": {"wild": {"dimensions": "all"}}},
    )
    study = ablation.study()
    text = study_toml(study)
    assert Study.from_dict(tomllib.loads(text)) == study
    path = tmp_path / "bees.toml"
    path.write_text(text, encoding="utf-8")
    assert Study.from_toml(path) == study
    assert Ablation.from_toml(path).study() == study
    assert Study.from_dict(study.to_dict()) == study
    assert study.replaced(worlds=5).solvers == study.solvers
    path.write_text(text.replace("dimensions", "dimension"), encoding="utf-8")
    with pytest.raises(UnknownName, match=r"bees\.toml.*did you mean 'dimensions'"):
        Study.from_toml(path)
    path.write_text(text.replace("[ablation]", "[ablation]\nbas = 1"), encoding="utf-8")
    with pytest.raises(UnknownName, match=r"bees\.toml.*did you mean 'base'"):
        Study.from_toml(path)
    with pytest.raises(InvalidInput, match="ablation"):
        Ablation.from_study(Study(**{**vars(study), "ablation": {}}))


def test_values_of_the_base_in_a_file_are_left_out(tmp_path):
    path = tmp_path / "bees.toml"
    path.write_text(
        'name = "bees"\nproblem = "sphere"\nworlds = 1\nbudget = 20\n'
        '[ablation]\nbase = "abc"\n[ablation.vary]\ndimensions = ["one", "all"]\n',
        encoding="utf-8",
    )
    assert [entry.label for entry in Study.from_toml(path).solvers] == ["base", "dimensions=all"]


@pytest.mark.parametrize("name", READY)
def test_ready_ablations_are_well_formed(name):
    assert name in list_studies()
    study = Study.named(name)
    study.check()
    assert study.ablation["base"] in {"ifoa-2020", "ifoa-2016", "affine-abc", "nafsa"}
    again = Ablation.from_study(study).study()
    assert (again.solvers, again.ablation) == (study.solvers, study.ablation)
    # every variant is another one
    assert len({spec.key for spec in study.runs()}) == len(study.runs())


# -- effect sizes ----------------------------------------------------------------------------------
def test_a12_is_what_counting_gives():
    rng = np.random.default_rng(5)
    for n, m in [(1, 1), (7, 11), (40, 23)]:
        a, b = rng.integers(0, 9, n).astype(float), rng.integers(0, 9, m).astype(float)
        a[0] = b[0] = np.inf
        counted = np.mean([1.0 if x < y else 0.5 if x == y else 0.0 for x, y in itertools.product(a, b)])
        assert vargha_delaney(a, b) == pytest.approx(counted, abs=1e-15)
        # scipy's U counts pairs whose first is larger
        u = scipy.stats.mannwhitneyu(-np.minimum(a, 99), -np.minimum(b, 99)).statistic
        assert vargha_delaney(a, b) == pytest.approx(u / (n * m), abs=1e-15)
        k = min(n, m)
        by_pairs = np.mean(
            [1.0 if x < y else 0.5 if x == y else 0.0 for x, y in zip(a[:k], b[:k], strict=True)]
        )
        assert vargha_delaney(a[:k], b[:k], paired=True) == pytest.approx(by_pairs, abs=1e-15)
    assert vargha_delaney([1, 2], [3, 4]) == 1.0
    assert np.isnan(vargha_delaney([], [1.0]))
    with pytest.raises(InvalidInput, match="per score"):
        vargha_delaney([1.0], [1.0, 2.0], paired=True)
    with pytest.raises(InvalidInput, match="failed"):
        vargha_delaney([np.nan], [1.0])


def test_words_for_effect_sizes():
    words = {
        0.5: "negligible",
        0.55: "negligible",
        0.56: "small",
        0.36: "medium",
        0.71: "large",
        0.0: "large",
    }
    assert {a12: effect_size(a12) for a12 in words} == words
    assert effect_size(np.nan) == ""


def made(*, worlds=40, seeds=(1, 2), planted=0.0, rng=1, **changes):
    """An ablation on made scores: the switch "dimensions" multiplies them, "pop_size" does nothing."""
    study = small(worlds=worlds, seeds=seeds, rank_by="loss", **changes).study()
    random = np.random.default_rng(rng)
    scores = {}
    for scale, scenario in enumerate(study.scenarios):
        world = random.lognormal(0, 1, (worlds, 1)) * 1000.0**scale
        scores[scenario] = {
            entry.label: world
            * random.lognormal(0, 0.3, (worlds, len(seeds)))
            * np.exp(planted * ("dimensions=all" in entry.label))
            for entry in study.solvers
        }
    return study, scores, frame(scores, study=study, seeds=seeds)


def test_a_planted_effect_is_found_and_nothing_else():
    study, scores, runs = made(planted=0.4)
    table = effect_table(runs, study)
    assert list(table["scenario"].unique()) == [POOLED, "plane", "Ackley"]
    planted = table[table["ingredient"] == "dimensions"]
    assert (planted["a12_low"] > 0.6).all()
    assert (planted["p_holm"] < 1e-3).all()
    np.testing.assert_allclose(planted["ratio"], np.exp(0.4), rtol=0.15)
    # 80 pairs on 40 worlds; the band is that of 0.001 / 6 for each of six rows
    null = table[table["ingredient"] == "pop_size"]
    assert (abs(null["a12"] - 0.5) < scipy.stats.norm.ppf(1 - 0.001 / 12) * 0.5 / np.sqrt(80)).all()
    assert (null["p_holm"] > 0.001).all()
    one = planted[planted["scenario"] == "plane"].iloc[0]
    base, other = (scores["plane"][label] for label in ("base", "dimensions=all"))
    assert one["a12"] == vargha_delaney(base, other, paired=True)
    assert one["a12_unpaired"] == vargha_delaney(base, other)
    assert one["difference"] == np.median(other - base)
    assert one["p_value"] == wilcoxon_p(np.median(other - base, axis=1), np.zeros(40))
    assert (one["pairs"], one["expected"], one["units"], one["unit"]) == (80, 80, 40, "world")
    assert (one["base"], one["other"]) == ("one", "all")
    assert null["base"].eq("8").all()


def test_intervals_cover_and_count_worlds_not_runs():
    covered, widths = [], []
    for k in range(100):
        study, _, runs = made(
            worlds=20, seeds=(1,), rng=100 + k, problems=[("sphere", {})], vary={"limit": 7}
        )
        row = effect_table(runs, study).iloc[0]
        covered.append(row["a12_low"] <= 0.5 <= row["a12_high"])
    # two-sided band of 0.001 about 95 %, a little below it as of a bootstrap of twenty shares
    assert np.mean(covered) > 0.94 - 3.3 * np.sqrt(0.06 * 0.94 / 100)
    for seeds in ((1,), (1, 2, 3, 4)):
        study = small(worlds=20, seeds=seeds, rank_by="loss", problems=["sphere"], vary={"limit": 7}).study()
        base = np.ones((20, len(seeds)))
        other = np.where(np.arange(20) < 13, 2.0, 0.5)[:, None] * base
        runs = frame({"sphere": {"base": base, "limit=7": other}}, study=study, seeds=seeds)
        # runs that differ by their worlds only: the answers must not be taken for one world
        runs["x"] = [np.array([k]) for k in runs["world"]]
        row = effect_table(runs, study).iloc[0]
        widths.append((row["a12"], row["a12_low"], row["a12_high"], row["p_value"]))
    assert widths[0] == widths[1]


def test_worlds_that_all_agree_have_an_honest_interval():
    study = small(worlds=8, rank_by="loss", problems=["sphere"], vary={"limit": 7}).study()
    base = np.arange(1.0, 9.0)[:, None]
    row = effect_table(frame({"sphere": {"base": base, "limit=7": 2 * base}}, study=study), study).iloc[0]
    assert (row["a12"], row["a12_high"]) == (1.0, 1.0)
    assert 0.6 < row["a12_low"] < 0.8
    tie = effect_table(frame({"sphere": {"base": base, "limit=7": base}}, study=study), study).iloc[0]
    assert (tie["a12"], tie["a12_low"], tie["a12_high"], tie["p_value"]) == (0.5, 0.5, 0.5, 1.0)
    few = small(worlds=3, rank_by="loss", problems=["sphere"], vary={"limit": 7}).study()
    assert np.isnan(
        effect_table(frame({"sphere": {"base": base, "limit=7": base}}, study=few), few)["a12_low"]
    ).all()


def test_failures_are_the_worst_and_missing_runs_are_no_pairs():
    study = small(worlds=10, rank_by="loss", problems=["sphere"], vary={"limit": 7}).study()
    base, other = np.arange(1.0, 11.0)[:, None], np.arange(2.0, 12.0)[:, None]
    runs = frame({"sphere": {"base": base, "limit=7": other}}, study=study)
    failed = (runs["solver"] == "limit=7") | ((runs["solver"] == "base") & (runs["world"] == 9))
    runs.loc[failed, "status"] = "failed"
    runs = runs[~((runs["solver"] == "limit=7") & (runs["world"] == 0))]
    row = effect_table(runs, study).iloc[0]
    assert (row["pairs"], row["expected"]) == (9, 10)
    assert row["a12"] == (8 + 0.5) / 9
    assert np.isinf(row["difference"])
    assert "9/10" in effect_cells(effect_table(runs, study), Display()).to_numpy()
    none = effect_table(runs.iloc[:0], study).iloc[0]
    assert (none["pairs"], none["expected"]) == (0, 10)
    assert np.isnan([none["a12"], none["p_holm"], none["difference"]]).all()


def test_the_same_world_again_counts_once():
    study, _, runs = made(worlds=12, seeds=(1, 2, 3, 4, 5, 6, 7))
    first = runs[(runs["scenario"] == "plane") & (runs["world"] == 0)]
    again = pd.concat([first.assign(world=world) for world in study.worlds])
    mixed = pd.concat([again, runs[runs["scenario"] == "Ackley"]], ignore_index=True)
    table = effect_table(mixed, study)
    plane = table[table["scenario"] == "plane"]
    assert plane["unit"].eq("seed").all()
    assert plane[["pairs", "expected", "units"]].eq(7).all(axis=None)
    ackley = table[table["scenario"] == "Ackley"]
    assert ackley["unit"].eq("world").all()
    assert ackley["units"].eq(12).all()
    assert table.loc[table["scenario"] == POOLED, "pairs"].eq(7 + 7 * 12).all()
    assert any("plane" in note and "same" in note for note in effect_notes(table, study))


def test_main_effects_of_a_factorial_average_over_the_other_switches():
    study, scores, runs = made(planted=0.5, design="factorial", problems=[("sphere", {})])
    (scenario,) = study.scenarios
    own = scores[scenario]
    row = effect_table(runs, study).set_index("label").loc["dimensions=all"]
    base = np.stack([own["base"], own["pop_size=4"], own["pop_size=12"]])
    other = np.stack([own[f"dimensions=all{more}"] for more in ("", ", pop_size=4", ", pop_size=12")])
    assert row["a12"] == pytest.approx(vargha_delaney(base, other, paired=True), abs=1e-15)
    assert (row["pairs"], row["expected"], row["units"]) == (240, 240, 40)
    assert row["difference"] == np.median(other - base)
    middles = np.median((other - base).transpose(1, 0, 2).reshape(40, -1), axis=1)
    assert row["p_value"] == wilcoxon_p(middles, np.zeros(40))
    assert any("main effect" in note for note in effect_notes(effect_table(runs, study), study))


def test_a_contrast_compares_the_base_world_by_world():
    study = small(
        worlds=8, vary={"limit": 7}, contrasts={"place": ("plane", "Ackley")},
        problems={**SPHERES, "space": ("sphere", {"n_var": 3})},
    ).study()  # fmt: skip
    values = np.arange(1.0, 9.0)[:, None]
    scores = {s: {"base": k * values, "limit=7": values} for k, s in enumerate(study.scenarios, start=1)}
    runs = frame(scores, study=study).rename(columns={"loss": "score.gap_1"})
    table = effect_table(runs, study)
    row = table[table["kind"] == "contrast"].iloc[0]
    assert (row["scenario"], row["other"], row["a12"], row["ratio"]) == ("plane", "Ackley", 1.0, 2.0)
    # the scenario that is only there for the contrast is not pooled
    assert table.loc[table["scenario"] == POOLED, "expected"].eq(16).all()
    assert [heading for heading, _ in effect_groups(table)][-1] == CONTRASTS


def test_only_an_ablation_has_effects():
    study = Study(
        name="x", problem="sphere", scenarios={"a": {}}, solvers=(SolverEntry("abc"),), worlds=(0,), budget=9
    )
    with pytest.raises(InvalidInput, match="results of an ablation"):
        effect_table(pd.DataFrame(), study)
    with pytest.raises(InvalidInput, match="give the Study"):
        effect_table(pd.DataFrame())


# -- through the machinery -------------------------------------------------------------------------
@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ablation")
    run_study(small(worlds=7).study(), folder, workers=1)
    return folder


def test_it_resumes_as_any_study(folder):
    study = small(worlds=7).study()
    again = run_study(study, folder, workers=1)
    assert (again.planned, again.executed, again.failed) == (4 * 2 * 7, 0, 0)
    more = small(worlds=7, vary={"dimensions": "all", "pop_size": [4, 12], "scouts": "all"})
    added = run_study(more.study(), folder, workers=1)
    assert added.executed == 2 * 7
    with ResultsStore(folder) as store:
        assert store.study == more.study()
        assert set(effect_table(store)["ingredient"]) == {"dimensions", "pop_size", "scouts"}
    run_study(study, folder, workers=1)


def test_a_score_that_one_problem_lacks_is_refused_before_its_runs(tmp_path, monkeypatch):
    from navopt.problems.analytic import Ackley

    monkeypatch.setattr(Ackley, "_score", lambda self, estimate: {"distance_1": 0.0})
    study = small(worlds=5, budget=20).study()
    with pytest.raises(UnknownName, match="gap_1"):
        run_study(study, tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        assert len(store.statuses()) == 4 * 5 + 1


def test_effects_of_real_runs_and_the_page(folder, tmp_path):
    with ResultsStore(folder) as store:
        study, table = store.study, effect_table(store)
        assert table["pairs"].eq(table["expected"]).all()
        assert table["base"].isin(["one", "8"]).all()
        runs = store.runs()
        wide = runs[runs["scenario"] == "plane"].pivot(index="world", columns="solver", values="score.gap_1")
        own = table[table["scenario"] == "plane"].set_index("label")
        assert own.loc["pop_size=4", "a12"] == vargha_delaney(wide["base"], wide["pop_size=4"], paired=True)
        by_loss = effect_table(store, score="loss")
        assert set(by_loss["scenario"]) == {POOLED, "plane", "Ackley"}
        page = write_report(store, tmp_path)
    text = page.read_text(encoding="utf-8")
    assert "<h2>Effect of each ingredient</h2>" in text
    assert text.count("<img") == 1 + 2 * 2
    for words in ("dimensions", "one → all", "A12", "Holm", "[ablation.vary]", "all scenarios", "ackley: "):
        assert words in text
    effects = pd.read_csv(tmp_path / "effects.csv")
    assert list(effects["label"]) == list(table["label"])
    picture = forest(table, study)
    names = [label.get_text() for label in picture.axes[0].get_yticklabels()]
    assert names == ["dimensions: one → all", "pop_size: 8 → 4", "pop_size: 8 → 12"]
    diamonds = next(line for line in picture.axes[0].lines if line.get_label() == POOLED)
    np.testing.assert_array_equal(diamonds.get_xdata(), table.loc[table["scenario"] == POOLED, "a12"])


def test_the_command_prints_the_effects(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("comparisons.report.write_report", lambda store, path: path)
    path = tmp_path / "bees.toml"
    path.write_text(study_toml(small(worlds=7).study()), encoding="utf-8")
    result = CliRunner().invoke(app, ["run", str(path), "--out", str(folder), "--workers", "1"])
    assert result.exit_code == 0, result.output
    assert "effect of each ingredient, all scenarios" in result.stdout
    assert "one → all" in result.stdout
    assert "Each scenario by itself is in the report" in result.stdout
    assert result.stdout.splitlines()[-1] == str(folder / "report.html")
    listed = " ".join(CliRunner().invoke(app, ["list", "studies"]).stdout.split())
    assert all(name in listed for name in READY)
