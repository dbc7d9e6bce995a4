"""The audit: planted biases are found, honest solvers are cleared, and the fruit flies are exposed."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.stats
from pymoo.core.population import Population
from typer.testing import CliRunner

import navopt
from comparisons import cli
from comparisons.audit import REFERENCES, Audit, AuditResult, run_audit
from comparisons.audit_figures import bias_figure, family_figure
from comparisons.audit_measures import (
    BOOTSTRAP_RESAMPLES,
    BOOTSTRAP_SEED,
    FLOOR,
    Verdict,
    bias_table,
    judge,
    log_ratio,
    median_interval,
)
from comparisons.audit_solvers import parse_solver, solver_entries
from comparisons.audit_suite import BIASES, FAMILIES, FUNCTIONS, Case, cases
from comparisons.audit_wording import sentence
from comparisons.store import ResultsStore
from comparisons.study import SolverEntry
from comparisons.worker import execute
from navopt import registry
from navopt.algorithms.random_search import RandomSearch
from navopt.errors import InvalidInput, StoreError, UnknownName, UnsuitableProblem

PLACES = ("origin", "corner")
QUICK = {"dimensions": (2,), "seeds": 6, "budget": 40, "references": (), "workers": 1}


# -- planted algorithms -----------------------------------------------------------------------------
class Planted(RandomSearch):
    """Samples one part of the box, given as fractions of its axes, and nothing else."""

    part = (0.5, 0.5)

    def _infill(self) -> Population:
        lower, upper = self.problem.bounds()
        fraction = self.random_state.uniform(*self.part, (self.pop_size, self.problem.n_var))
        return Population.new(X=lower + fraction * (upper - lower))


def planted(name, part):
    return registry.solver(name, summary="planted", comparison_based=True)(
        type(name, (Planted,), {"part": part, "__doc__": name})
    )


class Entry:
    def __init__(self, factory):
        self.load = lambda: factory


PLANTS = {
    "centre-sampler": planted("centre-sampler", (0.5, 0.5)),
    "low-sampler": planted("low-sampler", (0.05, 0.4)),
    "high-sampler": planted("high-sampler", (0.6, 0.95)),
}


@pytest.fixture
def plants(monkeypatch):
    entries = registry._entries
    monkeypatch.setattr(
        registry,
        "_entries",
        lambda group: (
            entries(group) | {name: Entry(factory) for name, factory in PLANTS.items()}
            if group == "navopt.solvers"
            else entries(group)
        ),
    )


@pytest.mark.usefixtures("plants")
def test_planted_samplers_are_flagged_and_random_search_is_cleared():
    some = ("sphere", "rosenbrock", "ackley", "griewank", "zettl", "wood")
    result = run_audit(["random-search", *PLANTS], functions=some, biases=PLACES, **QUICK)
    assert result.biased("centre-sampler", "origin")
    assert not result.biased("centre-sampler", "corner")
    sides = {(v.solver, v.bias.name): v.side for v in result.verdicts()}
    assert sides["low-sampler", "corner"] == "the lower corner"
    assert sides["high-sampler", "corner"] == "the upper corner"
    assert not any(result.biased("random-search", bias) for bias in PLACES)
    # where the box is not symmetric, its centre is not the origin, and the sampler does not get it
    table = result.bias().query("solver == 'centre-sampler' and bias == 'origin'").set_index("function")
    assert (table.loc[["sphere", "ackley", "griewank", "wood"], "side"] == 1).all()
    assert (table.loc[["rosenbrock", "zettl"], "side"] == 0).all()
    text = result.text()
    assert "centre-sampler: biased towards the origin." in text
    assert "origin bias: yes, towards the origin on 4 of 6 functions with d = 2 to 4 (half makes it" in text
    assert "The results vanish under a shift." in text
    assert "random-search: no bias found." in text
    assert "corner bias: no. None of 6 functions favours the lower corner or the upper corner." in text


# -- honest solvers ---------------------------------------------------------------------------------
def test_de_and_cmaes_are_cleared():
    result = run_audit(
        ["de", "cmaes"],
        functions=("sphere", "ackley", "wood"),
        biases=PLACES,
        **{**QUICK, "budget": 150},
    )
    assert [v.biased for v in result.verdicts()] == [False] * 4


@pytest.mark.slow
def test_de_and_cmaes_are_cleared_on_twenty_seed_sets():
    alarms = {}
    for k in range(20):
        result = run_audit(
            ["de", "cmaes"], dimensions=(2,), biases=PLACES, seeds=range(10 * k, 10 * k + 10), budget=300,
            references=(),
        )  # fmt: skip
        for verdict in result.verdicts():
            alarms.setdefault((verdict.solver, verdict.bias.name), []).append(verdict.biased)
    # at most 5 % of the sets, for each solver and bias
    assert {key: sum(flags) for key, flags in alarms.items() if sum(flags) > 1} == {}


# -- the fruit flies --------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def flies():
    """Two published fruit flies and the default one on functions of two variables."""
    return run_audit(
        ["ifoa-2020:published", "foa:published", "foa"], functions=("ackley", "griewank", "zettl", "sphere"),
        dimensions=(2,), seeds=8, biases=("origin",), references=("random-search",), workers=1,
    )  # fmt: skip


def test_the_reciprocal_encoding_reaches_zettls_zero_and_never_its_minimum(flies):
    plain = flies.gaps.query("function == 'zettl' and family == 'plain'").groupby("solver")["loss"]
    assert (plain.min()[["foa:published", "ifoa-2020:published"]] >= 0.0).all()
    assert plain.median()["ifoa-2020:published"] < 1e-6
    assert plain.median()["foa:published"] < 0.01
    assert plain.max()["foa"] == pytest.approx(-0.00379124, abs=1e-8)
    improved, published, default = flies.text().split("\n\n")
    for text in (improved, published):
        assert "none goes below 0, the infimum over positive coordinates" in text
    assert "Zettl" not in default


def test_the_reciprocal_encoding_loses_ackley_and_griewank_to_a_shift(flies):
    table = flies.bias().set_index(["solver", "function"])
    assert (table.loc["ifoa-2020:published"].loc[["ackley", "griewank"], "low"] > 4.0).all()
    assert table.loc[("foa:published", "griewank"), "low"] > 4.0
    assert table.loc[("foa:published", "ackley"), "low"] > 0.5
    assert [v.biased for v in flies.verdicts()] == [True, True, False, False]
    text = flies.text().split("\n\n")[0]
    assert text.startswith("ifoa-2020:published: biased towards the origin")
    assert "ackley in 2 variables" in text
    assert "griewank in 2 variables" in text
    assert "no better than random search" in text


def test_the_corners_of_the_box_encoding_are_flagged():
    result = run_audit(
        ["foa:published,encoding=box", "foa:encoding=box"], functions=("sphere", "griewank", "zettl", "wood"),
        biases=("corner",), **{**QUICK, "budget": 2020},
    )  # fmt: skip
    assert [verdict.side for verdict in result.verdicts()] == ["the lower corner", "the upper corner"]


# -- statistics -------------------------------------------------------------------------------------
def test_the_interval_is_scipys():
    for seed in range(3):
        values = np.random.default_rng(seed).normal(1.0, 2.0, 20)
        with np.errstate(all="ignore"):
            expected = scipy.stats.bootstrap(
                (values,), np.median, n_resamples=BOOTSTRAP_RESAMPLES, method="BCa",
                random_state=np.random.default_rng(BOOTSTRAP_SEED),
            ).confidence_interval  # fmt: skip
        assert median_interval(values) == (np.median(values), expected.low, expected.high)
    assert median_interval(np.full(20, 3.0)) == (3.0, 3.0, 3.0)
    assert np.isnan(median_interval(np.arange(5.0))[1:]).all()
    low, high = median_interval([0.0] * 19 + [7.0])[1:]
    assert np.isfinite([low, high]).all()
    with pytest.raises(InvalidInput):
        median_interval([1.0, np.inf] * 5)


def test_log_ratios_stand_solved_and_failed_runs():
    assert log_ratio([1e-3, 1e-12, 0.0, -1e-15], [1e-5, 1e-10, FLOOR, 1e-9]).tolist() == [2.0, 0.0, 0.0, 0.0]
    assert log_ratio([np.inf], [np.inf]).tolist() == [0.0]
    assert np.isfinite(log_ratio([np.inf], [1.0])).all()


def made_gaps(ratios, functions=("ackley", "griewank"), seeds=20):
    """Gaps whose log ratio between "high" and "low" is as given for each function, without scatter."""
    rows = [
        ("made", function, 2, family, seed, gap)
        for function, ratio in zip(functions, ratios, strict=True)
        for seed in range(seeds)
        for family, gap in (("low", 1.0 + seed), ("high", (1.0 + seed) * 10.0**ratio))
    ]
    return pd.DataFrame(rows, columns=["solver", "function", "dimension", "family", "seed", "gap"])


@pytest.mark.parametrize(
    ("ratios", "biased", "side"),
    [
        ((1.5, 0.0), True, "the lower corner"),
        ((0.9, 0.9), False, ""),
        ((-1.5, 0.3), True, "the upper corner"),
        ((-0.5, 0.9), False, ""),
    ],
)
def test_the_rule_counts_functions_on_one_side(ratios, biased, side):
    functions = tuple(Case(name, 2) for name in ("ackley", "griewank"))
    table = bias_table(made_gaps(ratios), functions, ["corner"])
    assert table["median"].to_numpy() == pytest.approx(ratios)
    (verdict,) = judge(table)
    assert (verdict.biased, verdict.side, verdict.functions) == (biased, side, (2,))
    favoured = "None of 2 functions" if max(map(abs, ratios)) < 1.0 else "1 of 2 functions with d = 2"
    assert favoured in sentence(verdict)
    assert side in sentence(verdict)
    # the origin has one side only: a negative ratio is no bias towards it
    renamed = made_gaps(ratios).replace({"low": "origin", "high": "shifted"})
    functions = tuple(Case(name, 2) for name in ("rosenbrock", "zettl"))
    renamed["function"] = renamed["function"].map({"ackley": "rosenbrock", "griewank": "zettl"})
    (verdict,) = judge(bias_table(renamed, functions, ["origin"]))
    assert verdict.biased == (ratios[0] > 1.0)


def test_each_number_of_variables_is_counted_for_itself():
    functions = cases((2, 10), ("ackley", "sphere", "wood"))
    few = made_gaps((0.0, 0.0, 0.0), ("ackley", "sphere", "wood"))
    few["dimension"] = few["function"].map({"ackley": 2, "sphere": 2, "wood": 4})
    many = made_gaps((2.0, 0.0), ("ackley", "sphere")).assign(dimension=10)
    (verdict,) = judge(bias_table(pd.concat([few, many]), functions, ["corner"]))
    assert (verdict.biased, verdict.functions, verdict.levels) == (True, (3, 2), ("d = 2 to 4", "d = 10"))
    assert verdict.counts == {"the lower corner": (0, 1), "the upper corner": (0, 0)}
    assert "towards the lower corner on 1 of 2 functions with d = 10 (half makes it one)" in sentence(verdict)
    assert verdict.median == pytest.approx(2.0)


def test_too_few_runs_give_no_verdict():
    functions = tuple(Case(name, 2) for name in ("ackley", "griewank", "sphere"))
    (verdict,) = judge(bias_table(made_gaps((2.0, 2.0), seeds=5), functions, ["corner"]))
    assert verdict.biased is None
    assert "not judged" in sentence(verdict)


def test_a_property_is_worded_as_none_of_the_faults():
    counts = {"the axes": (5,)}
    verdict = Verdict("made", BIASES["rotation"], True, ("the axes",), counts, (9,), ("d = 2",), 1.2)
    assert sentence(verdict).startswith("dependence on the axes: yes.")
    assert sentence(verdict).endswith("turned on 5 of 9 functions with d = 2; no bias to a place.")


# -- the suite --------------------------------------------------------------------------------------
def world(case, family, seed=0):
    return navopt.simulate("audit-function", seed, **case.scenario(family))


@pytest.mark.parametrize("case", cases((2, 10)), ids=lambda case: case.label)
def test_minima_are_where_the_family_says(case):
    plain = world(case, "plain")
    for family in FAMILIES:
        for seed in range(2):
            moved = world(case, family, seed)
            np.testing.assert_array_equal([moved.xl, moved.xu], [plain.xl, plain.xu])
            assert moved.loss(moved.true_x) == pytest.approx(moved.minimum, abs=1e-12)
            place = (moved.true_x - moved.xl) / (moved.xu - moved.xl)
            if family == "origin":
                assert np.abs(moved.true_x).max() < 1e-15
            if family in ("low", "high"):
                assert place == pytest.approx({"low": 0.1, "high": 0.9}[family])
            if family == "negative":
                assert (moved.true_x < 0.0).all()
            if family == "positive":
                assert (moved.true_x > 0.0).all()
            if family in ("shifted", "rotated"):
                away = np.abs(moved.true_x - plain.true_x) / (plain.xu - plain.xl)
                assert (away >= 0.1 - 1e-12).all()
                assert (away <= 0.4 + 1e-12).all()
            # nowhere in the box is it lower than at the minimum
            X = np.random.default_rng(seed).uniform(moved.xl, moved.xu, (4000, case.dimension))
            assert moved.loss(X).min() >= moved.minimum


@pytest.mark.parametrize(("family", "mirrored"), [("low", "high"), ("negative", "positive")])
def test_the_sides_are_mirror_images(family, mirrored):
    for case in cases((3,)):
        one, other = world(case, family, 4), world(case, mirrored, 4)
        X = np.random.default_rng(1).uniform(one.xl, one.xu, (50, case.dimension))
        losses = other.loss(one.xl + one.xu - X)
        np.testing.assert_allclose(losses, one.loss(X), rtol=1e-9, atol=1e-9)


def test_the_suite_and_its_refusals():
    listed = cases((2, 10, 30))
    assert len(listed) == 5 * 3 + 4
    assert {case.function for case in listed} == set(FUNCTIONS)
    assert [case.family("origin") for case in cases((2,), ("ackley", "wood"))] == ["plain", "origin"]
    with pytest.raises(UnknownName, match="did you mean 'ackley'"):
        cases((2,), ("ackly",))
    for dimensions in ((0,), (1,), (2.0,), (True,), (), (2, 2)):
        with pytest.raises(InvalidInput, match="dimensions"):
            cases(dimensions)
    with pytest.raises(UnknownName, match="did you mean 'shifted'"):
        navopt.simulate("audit-function", 0, family="shift")
    with pytest.raises(InvalidInput, match="wood has 4 variables"):
        navopt.simulate("audit-function", 0, function="wood", n_var=3)


# -- runs -------------------------------------------------------------------------------------------
def test_an_audit_continues_and_shares_the_references(tmp_path, monkeypatch):
    small = {**QUICK, "functions": ("ackley", "zettl"), "biases": ("origin",), "out": tmp_path}
    small["references"] = ("random-search",)
    ran = []
    monkeypatch.setattr(
        "comparisons.runner.execute", lambda spec, *a, **k: ran.append(spec) or execute(spec, *a, **k)
    )
    monkeypatch.setattr("comparisons.runner.groups", lambda runs: ([], list(runs)))
    first = run_audit("foa", **small)
    # ackley: plain and shifted; zettl: plain, origin and shifted
    assert len(ran) == 2 * 6 * 5
    again = run_audit("foa", **small)
    assert len(ran) == 2 * 6 * 5
    pd.testing.assert_frame_equal(first.gaps, again.gaps)
    run_audit("gfoa", **small)
    assert {spec.solver for spec in ran[2 * 6 * 5 :]} == {"gfoa"}
    with ResultsStore(tmp_path) as store:
        assert store.study.name == "audit"
        assert set(store.runs()["seed"] - store.runs()["world"]) == {1}
    (tmp_path / "other").mkdir()
    from study_tools import small_study

    ResultsStore.open_for_study(tmp_path / "other", small_study()).close()
    with pytest.raises(StoreError, match="belongs to the study 'small'"):
        run_audit("foa", **{**small, "out": tmp_path / "other"})


def test_an_audit_takes_runs_together_where_it_can(monkeypatch):
    alone = []
    monkeypatch.setattr(
        "comparisons.runner.execute", lambda spec, *a, **k: alone.append(spec) or execute(spec, *a, **k)
    )
    audit = Audit(
        ["abc", "abc:update=sequential", "random-search", "foa:pop_size=50"], references=(),
        functions=("ackley",), dimensions=(2,), seeds=6, budget=40, biases=("corner",),
    )  # fmt: skip
    gaps = run_audit(audit, workers=1).gaps
    assert len(gaps) == 4 * 3 * 6
    assert (gaps["cost"] == 40).all()
    # the budget of foa ends within its first batch
    assert {spec.solver_label for spec in alone} == {entry.label for entry in audit.solvers} - {"abc"}


@pytest.mark.usefixtures("plants")
def test_failed_runs_count_as_the_worst(monkeypatch):
    def fail(self):
        if self.problem.family == "shifted":
            raise RuntimeError("planted fault")
        return Planted._infill(self)

    monkeypatch.setattr(PLANTS["low-sampler"], "_infill", fail)
    result = run_audit("low-sampler", functions=("ackley", "sphere"), biases=("origin",), **QUICK)
    failed = result.gaps.query("family == 'shifted'")
    assert np.isinf(failed["gap"]).all()
    assert (failed["status"] == "failed").all()
    assert result.biased("low-sampler", "origin")
    assert "12 of 24 runs failed" in result.text()
    assert "planted fault" in result.text()


# -- solvers as text --------------------------------------------------------------------------------
def test_solvers_are_read_with_their_settings():
    assert parse_solver("foa") == SolverEntry("foa")
    text = "foa:encoding=reciprocal,pop_size=30, location_range=[-2.0, 1],one_sided=true,clip=none"
    assert parse_solver(text).settings == {
        "encoding": "reciprocal", "pop_size": 30, "location_range": [-2.0, 1], "one_sided": True,
        "clip": None,
    }  # fmt: skip
    published = parse_solver("foa:published,pop_size=10")
    assert published.settings["encoding"] == "reciprocal"
    assert published.settings["pop_size"] == 10
    assert published.label == "foa:published,pop_size=10"
    table = {"name": "foa", "label": "mine", "settings": {"pop_size": 9}}
    assert solver_entries([table, "de"]) == (SolverEntry("foa", "mine", {"pop_size": 9}), SolverEntry("de"))


@pytest.mark.parametrize(
    ("solvers", "changes", "message"),
    [
        ("foaa", {}, "did you mean 'foa'"),
        ("foa:encodin=box", {}, "did you mean 'encoding'"),
        ("foa:encoding", {}, "name:key=value"),
        ("foa:encoding=boxx", {}, "did you mean 'box'"),
        ("random-search:published", {}, "no published settings"),
        ([], {}, "solvers"),
        ([3], {}, "SolverEntry"),
        ([{"name": "foa", "setting": {}}], {}, "did you mean 'settings'"),
        ("foa", {"dimensions": (0,)}, "whole numbers from 2"),
        ("foa", {"dimensions": 2}, "give a list"),
        ("foa", {"seeds": 5}, "at least 6"),
        ("foa", {"seeds": (1, 1, 2, 3, 4, 5)}, "once only"),
        ("foa", {"budget": 0}, "budget"),
        ("foa", {"functions": ("acley",)}, "did you mean 'ackley'"),
        ("foa", {"biases": ("centre",)}, "biases"),
        ("foa", {"biases": ()}, "at least one"),
        ("foa", {"references": ("cma-es",)}, "did you mean 'cmaes'"),
        ("foa", {"workers": 0}, "workers"),
        (["foa", "foa:pop_size=20"], {}, "same solver"),
    ],
)
def test_bad_input_is_refused_before_anything_runs(solvers, changes, message):
    with pytest.raises(InvalidInput, match=message):
        run_audit(solvers, **{**QUICK, **changes})


def test_a_solver_that_needs_more_than_a_loss_is_refused():
    with pytest.raises(UnsuitableProblem, match="affine-abc cannot solve"):
        run_audit("affine-abc", **QUICK)


def test_a_reference_that_is_audited_is_not_run_twice():
    audit = Audit(["de", "de:pop_size=20"], seeds=6)
    assert [entry.label for entry in audit.references] == [name for name in REFERENCES if name != "de"]
    assert audit.families == tuple(FAMILIES)
    assert Audit("de", biases=("corner",)).families == ("plain", "low", "high")


# -- figures, page and command ----------------------------------------------------------------------
def test_figures_hold_every_function_and_solver(flies):
    figure = family_figure(flies, "shifted")
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == [
        c.label for c in flies.audit.cases
    ]
    assert len(figure.axes[0].get_legend().get_texts()) == 4
    assert "log10" in bias_figure(flies, "origin").axes[0].get_xlabel()
    with pytest.raises(UnknownName, match="family"):
        family_figure(flies, "rotated")
    with pytest.raises(UnknownName, match="bias"):
        bias_figure(flies, "rotation")


def test_the_page_stands_alone_and_repeats_itself(flies, tmp_path):
    page = flies.write(tmp_path)
    assert page.name == "audit.html"
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"https?://|<script|src=\"(?!data:)|@import|url\(", text)
    assert "ifoa-2020:published: biased towards the origin" in text
    assert "provisional" not in text
    for family in flies.audit.families:
        assert FAMILIES[family] in text
    assert text.count("<img") == len(flies.audit.families) + len(flies.audit.biases)
    first = page.read_bytes()
    assert flies.write(tmp_path).read_bytes() == first
    bias = pd.read_csv(tmp_path / "bias.csv")
    pd.testing.assert_frame_equal(bias, flies.bias())
    assert len(pd.read_csv(tmp_path / "gaps.csv")) == len(flies.gaps)


def test_an_unfinished_audit_says_so(flies, tmp_path, monkeypatch):
    picture = {"source": "data:", "alt": "", "caption": ""}
    monkeypatch.setattr("comparisons.audit_report.inline_picture", lambda *arguments: picture)
    part = AuditResult(flies.audit, flies.gaps.query("seed < 5"))
    assert all(verdict.biased is None for verdict in part.verdicts())
    assert "not judged" in part.text()
    assert "provisional" in part.write(tmp_path / "part.html").read_text(encoding="utf-8")


@pytest.fixture
def command(monkeypatch, tmp_path):
    """Run the command in a folder and an environment of its own."""
    monkeypatch.setattr(os, "environ", os.environ.copy())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("comparisons.audit_report.write_audit", lambda result, path: Path(path))

    def invoke(*arguments, code=0):
        done = CliRunner().invoke(cli.app, ["audit", *map(str, arguments)])
        assert done.exit_code == code, (done.output, done.exception)
        return done

    return invoke


def test_the_command(command, tmp_path):
    options = (
        "--functions ackley,zettl --biases origin --references none --seeds 6 --first-seed 3 --budget 200"
    )
    done = command("foa", "foa:published", "--dimensions", "2", "--workers", 1, *options.split())
    assert done.stdout.splitlines()[-1] == str(Path("results") / "audit" / "audit.html")
    assert "foa:published: biased towards the origin" in done.stdout
    assert "60 of 60 done" in done.stderr
    assert "foa: no bias found" in done.stdout
    (tmp_path / "mine.toml").write_text(
        'references = []\nseeds = 6\nbudget = 40\ndimensions = [2]\nfunctions = ["ackley"]\n'
        'biases = ["corner"]\n[[solvers]]\nname = "random-search"\nlabel = "floor"\n'
    )
    assert "floor: no bias found" in command("mine.toml", "--workers", 1, "--out", "other").stdout
    assert Audit.from_toml(tmp_path / "mine.toml").seeds == tuple(range(6))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fooa",), "did you mean 'foa'"),
        (("foa", "--dimensions", "0"), "dimensions: got 0"),
        (("foa", "--dimensions", "two"), "dimensions: got two"),
        (("foa", "--seeds", "2"), "at least 6"),
        (("none.toml",), "readable TOML"),
        (("foa", "none.toml"), "not both"),
        (("wrong.toml",), "did you mean 'dimensions'"),
        (("empty.toml",), "this key is required"),
    ],
)
def test_the_command_refuses_in_one_message(command, tmp_path, arguments, message):
    (tmp_path / "wrong.toml").write_text('dimension = [2]\n[[solvers]]\nname = "foa"\n')
    (tmp_path / "empty.toml").write_text("budget = 7\n")
    done = command(*arguments, code=2)
    assert done.stdout == ""
    assert done.stderr.startswith("navopt: error: ")
    assert message in done.stderr
