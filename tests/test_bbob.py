"""The BBOB functions, the benchmark over them, and what it reports."""

from __future__ import annotations

import base64
import importlib.util
import os
import pickle
import re
import sys
import warnings
from importlib.metadata import PackageNotFoundError

import numpy as np
import pandas as pd
import pytest
from arena import Altered
from typer.testing import CliRunner

import navopt
from comparisons import bbob_functions, cli
from comparisons.bbob import Benchmark, run_benchmark
from comparisons.bbob_figures import runtime_figure
from comparisons.bbob_functions import FUNCTIONS, GROUPS, BbobFunction
from comparisons.bbob_measures import (
    TARGETS,
    ecdf,
    expected_running_times,
    first_hits,
    share_interval,
    share_table,
)
from comparisons.bbob_report import share_cells
from comparisons.store import ResultsStore
from navopt.errors import InvalidInput, MissingExtra, UnknownName, UnsuitableProblem
from navopt.evaluation import TRACE_DTYPE

needs_ioh = pytest.mark.skipif(
    importlib.util.find_spec("ioh") is None, reason="ioh, of the extra 'bench', is not installed"
)
each_function = pytest.mark.parametrize("function", FUNCTIONS)
NAMES = {"bbob.html", "ecdf-2.png", "ecdf-2.svg", "running-times.csv", "shares.csv"}
SMALL = {"dimensions": (2,), "functions": (1, 8), "instances": 2, "budget_factor": 30, "workers": 1}


def trace(*rows: tuple[int, float]) -> np.ndarray:
    return np.array([(cost, loss, 0.0) for cost, loss in rows], dtype=TRACE_DTYPE)


# -- the functions ----------------------------------------------------------------------------------
@needs_ioh
@each_function
def test_minimum_is_at_the_named_point_and_nothing_lies_below(function: int) -> None:
    rng = np.random.default_rng(function)
    for instance in (1, 4):
        for d in (2, 5):
            problem = navopt.simulate("bbob", instance, function=function, n_var=d)
            assert float(problem.loss(problem.true_x)) == problem.minimum
            assert (problem.xl <= problem.true_x).all()
            assert (problem.true_x <= problem.xu).all()
            assert problem.score(problem.estimate(problem.true_x)) == {"gap_1": 0.0}
            near = problem.clip(problem.true_x + rng.normal(0.0, 0.01, (50, d)))
            X = np.vstack([rng.uniform(problem.xl, problem.xu, (200, d)), near])
            assert problem.loss(X).min() >= problem.minimum


@needs_ioh
@each_function
def test_values_are_those_of_the_suites_first_implementation(function: int) -> None:
    # the 2009 Python code of the suite's authors, which the package cma carries
    from cma import bbobbenchmarks

    rng = np.random.default_rng(function)
    for instance in (1, 3):
        for d in (2, 5):
            problem = navopt.simulate("bbob", instance, function=function, n_var=d)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                other = bbobbenchmarks.instantiate(function, instance)[0]
                X = rng.uniform(-5.0, 5.0, (20, d))
                expected = np.array([other(x) for x in X])
            assert other.getfopt() == problem.minimum
            assert problem.loss(X) - problem.minimum == pytest.approx(
                expected - problem.minimum, rel=1e-7, abs=1e-7
            )


@needs_ioh
def test_a_loss_does_not_depend_on_its_batch() -> None:
    rng = np.random.default_rng(3)
    for function in FUNCTIONS:
        problem = navopt.simulate("bbob", 2, function=function, n_var=5)
        X = rng.uniform(-5.0, 5.0, (17, 5))
        together = problem.loss(X)
        assert (together == [float(problem.loss(x)) for x in X]).all()
        assert (problem.loss(X[::-1]) == together[::-1]).all()
        assert (problem.loss(np.asfortranarray(X)) == together).all()
        assert (pickle.loads(pickle.dumps(problem)).loss(X) == together).all()


@needs_ioh
def test_instances_differ_and_are_the_same_again() -> None:
    first, second = (navopt.simulate("bbob", k, function=15, n_var=3) for k in (1, 2))
    assert first.minimum != second.minimum
    assert (first.true_x != second.true_x).any()
    assert first.redraw(5) is first
    again = navopt.simulate("bbob", 1, function=15, n_var=3)
    assert (again.true_x == first.true_x).all()
    assert (first.project(first.estimate(np.full(3, 9.0))) == 5.0).all()
    with pytest.raises(InvalidInput, match="immutable"):
        first.minimum = 0.0


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((25, 2, 1), UnknownName, "function: got '25'"),
        ((0, 2, 1), UnknownName, "function: got '0'"),
        ((1, 1, 1), InvalidInput, "n_var: got 1; give a whole number, at least 2"),
        ((1, 2.5, 1), InvalidInput, "n_var: got 2.5"),
        ((1, True, 1), InvalidInput, "n_var: got True"),
        ((1, 2, -1), InvalidInput, "instance: got -1"),
    ],
)
def test_unusable_numbers_are_refused(arguments, error, message) -> None:
    with pytest.raises(error, match=message):
        BbobFunction(*arguments)


def test_without_ioh_the_message_says_what_to_install(monkeypatch, tmp_path) -> None:
    def absent(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setitem(sys.modules, "ioh", None)
    monkeypatch.setattr(bbob_functions, "version", absent)
    bbob_functions._function.cache_clear()
    message = r"needs the extra 'bench': pip install 'navopt\[bench\]'"
    with pytest.raises(MissingExtra, match=message):
        navopt.simulate("bbob", 1, function=1, n_var=2)
    with pytest.raises(MissingExtra, match=message):
        BbobFunction.data_checksum(function=1)
    with pytest.raises(MissingExtra, match=message):
        run_benchmark("abc", out=tmp_path / "none", **SMALL)
    assert not (tmp_path / "none").exists()


def test_the_groups_hold_every_function_once() -> None:
    assert [number for numbers in GROUPS.values() for number in numbers] == list(FUNCTIONS)


# -- what is measured -------------------------------------------------------------------------------
def test_targets_are_five_to_the_decade() -> None:
    assert len(TARGETS) == 51
    assert TARGETS[[0, 5, 50]] == pytest.approx([100.0, 10.0, 1e-8], rel=1e-12)
    assert np.diff(np.log10(TARGETS)) == pytest.approx(-0.2)


def test_first_hits_by_hand() -> None:
    hits = first_hits(trace((1, 12.0), (4, 7.5), (9, 7.0), (20, 7.0)), 7.0, [10.0, 5.0, 0.6, 0.5, 0.1, 0.0])
    assert hits.tolist() == [1.0, 1.0, 4.0, 4.0, 9.0, 9.0]
    assert first_hits(trace((1, 12.0), (30, 12.0)), 7.0, [5.0, 4.9]).tolist() == [1.0, np.inf]
    assert first_hits(trace(), 0.0, [1.0, 2.0]).tolist() == [np.inf, np.inf]
    assert first_hits(trace((1, np.inf), (3, 2.0)), 1.0, [100.0, 1.0]).tolist() == [3.0, 3.0]


def test_ecdf_is_the_share_at_or_below() -> None:
    hits = [[1.0, 2.0, np.inf], [2.0, 8.0, np.inf]]
    assert ecdf(hits, [0.5, 1.0, 2.0, 7.9, 8.0, 1e9]).tolist() == [0.0, 1 / 6, 3 / 6, 3 / 6, 4 / 6, 4 / 6]
    with pytest.raises(InvalidInput, match="hits: got no pairs"):
        ecdf([], [1.0])


def test_ecdf_against_counting() -> None:
    rng = np.random.default_rng(8)
    hits = np.where(rng.random((7, 5)) < 0.3, np.inf, rng.integers(1, 60, (7, 5)))
    at = rng.uniform(0.0, 80.0, 40)
    assert ecdf(hits, at) == pytest.approx([np.mean([h <= a for h in hits.ravel()]) for a in at])


def sample() -> tuple[pd.DataFrame, np.ndarray]:
    """Two solvers on two functions and two instances; four targets."""
    rows, hits = [], []
    for solver, reached in (("slow", [1, 0, 0, 2]), ("quick", [4, 3, 1, 2])):
        for k, (function, instance) in enumerate([(1, 1), (1, 2), (8, 1), (8, 2)]):
            rows.append((solver, function, 2, instance, 100.0))
            hits.append([10.0 * (j + 1) if j < reached[k] else np.inf for j in range(4)])
    columns = ["solver", "function", "dimension", "instance", "cost"]
    return pd.DataFrame(rows, columns=columns), np.array(hits)


def test_share_table_by_hand() -> None:
    table = share_table(*sample()).set_index("solver")
    assert list(table.index) == ["quick", "slow"]
    assert table.loc["slow", "all"] == pytest.approx(3 / 16)
    assert table.loc["slow", "separable"] == pytest.approx(1 / 8)
    assert table.loc["quick", "separable"] == pytest.approx(7 / 8)
    assert table.loc["quick", "moderate conditioning"] == pytest.approx(3 / 8)
    assert np.isnan(table.loc["quick", "multimodal, weak structure"])
    assert table.loc["quick", "low"] < table.loc["quick", "all"] < table.loc["quick", "high"]
    headings, rows = share_cells(table.reset_index(), 2)
    assert headings == ["solver", "all functions", "separable", "moderate conditioning"]
    assert rows[1][0] == "slow"
    assert rows[1][1].startswith("18.8 [")


def test_an_incomplete_square_has_no_interval() -> None:
    runs, hits = sample()
    table = share_table(runs.iloc[:-1], hits[:-1]).set_index("solver")
    assert np.isnan(table.loc["quick", "low"])
    assert table.loc["slow", "low"] >= 0.0


def test_interval_of_a_share() -> None:
    rng = np.random.default_rng(5)
    shares = rng.uniform(0.2, 0.6, (24, 15))
    low, high = share_interval(shares)
    # the variance of a mean of means over independent rows
    sd = np.sqrt(shares.var(axis=1).sum() / 15) / 24
    assert low == pytest.approx(shares.mean() - 1.96 * sd, abs=0.25 * sd)
    assert high == pytest.approx(shares.mean() + 1.96 * sd, abs=0.25 * sd)
    assert share_interval(np.full((3, 4), 0.25)) == (0.25, 0.25)
    assert np.isnan(share_interval(shares[:, :1])).all()
    assert share_interval(shares) == (low, high)


def test_expected_running_time_by_hand() -> None:
    runs, hits = sample()
    table = expected_running_times(runs, hits, [4.0, 3.0, 2.0, 1.0])
    table = table.set_index(["solver", "function", "target"])
    # one run arrives after 10, the other spends its 100 in vain
    assert table.loc[("slow", 1, 4.0), "expected_cost"] == 110.0
    assert table.loc[("slow", 1, 3.0), "expected_cost"] == np.inf
    assert table.loc[("quick", 1, 2.0), "expected_cost"] == 30.0
    assert table.loc[("quick", 1, 1.0), ["expected_cost", "successes", "runs"]].tolist() == [140.0, 1, 2]


# -- the benchmark ----------------------------------------------------------------------------------
@needs_ioh
def test_benchmark_runs_resumes_and_takes_in_another_solver(tmp_path) -> None:
    first = run_benchmark(["abc", "random-search"], out=tmp_path, **SMALL)
    assert len(first.runs) == 8
    with ResultsStore(tmp_path) as store:
        finished = dict(zip(store.runs()["key"], store.runs()["finished"], strict=True))
    more = run_benchmark(["abc", "random-search", "cmaes:sigma=0.2"], out=tmp_path, **SMALL)
    with ResultsStore(tmp_path) as store:
        after = dict(zip(store.runs()["key"], store.runs()["finished"], strict=True))
    assert len(after) == 12
    assert {key: after[key] for key in finished} == finished
    old = more.runs["solver"] != "cmaes:sigma=0.2"
    assert (more.hits[old.to_numpy()] == first.hits).all()
    # each run is that of `solve` with its own seed, and within its budget
    for row, hits in zip(more.runs.to_dict("records"), more.hits, strict=True):
        problem = navopt.simulate("bbob", row["instance"], function=row["function"], n_var=2)
        name, settings = row["solver"].partition(":")[0], {}
        if ":" in row["solver"]:
            settings = {"sigma": 0.2}
        solver = navopt.make_solver(name, **settings)
        seed = 1000 * row["function"] + row["instance"]
        alone = navopt.solve(problem, solver, budget=60, seed=seed)
        assert row["cost"] == alone.counts.cost == 60
        assert row["gap"] == alone.loss - problem.minimum
        assert (hits == first_hits(alone.trace, problem.minimum, TARGETS)).all()


@needs_ioh
def test_runtimes_are_those_that_iohs_own_counter_shows() -> None:
    import ioh

    problem = navopt.simulate("bbob", 3, function=3, n_var=2)
    seen: list[np.ndarray] = []
    watched = Altered(problem, lambda losses, X: (seen.append(X.copy()), losses)[1])
    solution = navopt.solve(watched, "abc", budget=300, seed=4)
    fresh = ioh.get_problem(3, instance=3, dimension=2, problem_class=ioh.ProblemClass.BBOB)
    reached = np.full(len(TARGETS), np.inf)
    for x in np.vstack(seen):
        fresh(x)
        gap = fresh.state.current_best.y - fresh.optimum.y
        reached[(gap <= TARGETS) & ~np.isfinite(reached)] = fresh.state.evaluations
    assert np.isfinite(reached).sum() > 5
    assert (first_hits(solution.trace, problem.minimum, TARGETS) == reached).all()


@needs_ioh
def test_a_run_that_fails_reaches_nothing_and_is_done_again_on_request(tmp_path, monkeypatch) -> None:
    original = BbobFunction._loss

    def broken(self: BbobFunction, X: np.ndarray) -> np.ndarray:
        return np.full(len(X), np.nan) if self.function == 8 else original(self, X)

    with monkeypatch.context() as patch:
        patch.setattr(BbobFunction, "_loss", broken)
        failed = run_benchmark(["random-search"], out=tmp_path, **SMALL)
    bad = (failed.runs["function"] == 8).to_numpy()
    assert (failed.runs.loc[bad, "status"] == "failed").all()
    assert np.isinf(failed.hits[bad]).all()
    assert (failed.runs.loc[bad, "cost"] == 60).all()
    assert np.isfinite(failed.hits[~bad]).any()
    assert failed.runs.loc[bad, "error"].str.contains("returned NaN").all()
    assert (run_benchmark(["random-search"], out=tmp_path, **SMALL).runs["status"] == "failed").sum() == 2
    again = run_benchmark(["random-search"], out=tmp_path, retry_failed=True, **SMALL)
    assert (again.runs["status"] != "failed").all()


@needs_ioh
@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"solvers": ()}, InvalidInput, "solvers: got .*; give at least one"),
        ({"solvers": "abcd"}, UnknownName, "did you mean 'abc'"),
        ({"solvers": ("abc", "abc")}, InvalidInput, "labels of solvers: got abc"),
        ({"solvers": ("tercom",)}, UnsuitableProblem, "tercom cannot solve BbobFunction"),
        ({"functions": (1, 25)}, UnknownName, "functions: got '25'"),
        ({"functions": (1, 1)}, InvalidInput, "functions: got .*; give each once only"),
        ({"dimensions": (1,)}, InvalidInput, "dimensions: got 1; give whole numbers from 2 on"),
        ({"dimensions": 2}, InvalidInput, "dimensions: got 2; give a list"),
        ({"instances": 0}, InvalidInput, "instances"),
        ({"instances": (-1,)}, InvalidInput, "instances: got -1"),
        ({"budget_factor": 0}, InvalidInput, "budget_factor: got 0"),
    ],
)
def test_what_cannot_be_run_is_refused(changes, error, message) -> None:
    with pytest.raises(error, match=message):
        Benchmark(**{"solvers": ("abc",), **changes}).runs()


# -- figure, page, command --------------------------------------------------------------------------
@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bbob")
    result = run_benchmark(["abc", "random-search"], out=folder, **SMALL)
    result.write(folder)
    return result, folder


@needs_ioh
def test_the_figure_shows_the_distribution(small) -> None:
    result, _ = small
    figure = runtime_figure(result, 2)
    panels = [panel for panel in figure.axes if panel.get_visible()]
    assert [panel.get_title(loc="left") for panel in panels] == [
        "all functions", "separable", "moderate conditioning",
    ]  # fmt: skip
    assert {panel.get_xscale() for panel in panels} == {"log"}
    for panel, functions in zip(panels, [(1, 8), (1,), (8,)], strict=True):
        drawn = {line.get_label(): line for line in panel.lines}
        assert set(drawn) == {"abc", "random-search"}
        for solver, line in drawn.items():
            mine = (result.runs["solver"] == solver) & result.runs["function"].isin(functions)
            hits = result.hits[mine.to_numpy()].ravel() / 2
            expected = [np.mean(hits <= x) for x in line.get_xdata()]
            assert line.get_ydata() == pytest.approx(expected)
            assert line.get_xdata()[-1] == pytest.approx(30.0)
    with pytest.raises(UnknownName, match="dimension: got '3'"):
        runtime_figure(result, 3)


@needs_ioh
def test_page_pictures_and_tables(small) -> None:
    result, folder = small
    assert {path.name for path in folder.iterdir()} >= NAMES
    assert (folder / "ecdf-2.png").read_bytes().startswith(b"\x89PNG")
    text = (folder / "bbob.html").read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="(?!data:)', text)
    (picture,) = re.findall(r"data:image/svg\+xml;base64,([^\"]+)", text)
    assert base64.b64decode(picture) == (folder / "ecdf-2.svg").read_bytes()
    assert "navopt bbob abc random-search --dimensions 2 --functions 1,8 --instances 2" in text
    assert len(pd.read_csv(folder / "running-times.csv")) == 2 * 2 * len(TARGETS)
    assert list(pd.read_csv(folder / "shares.csv")["solver"]) == list(result.shares["solver"])


@pytest.fixture
def command(monkeypatch):
    # the command limits threads for its own process; here that process is the tests'
    monkeypatch.setattr(os, "environ", os.environ.copy())

    def invoke(*arguments: object, code: int = 0):
        result = CliRunner().invoke(cli.app, ["bbob", *map(str, arguments)])
        assert result.exit_code == code, (result.output, result.exception)
        return result

    return invoke


@needs_ioh
def test_the_command_prints_the_table_and_ends_with_the_page(command, small) -> None:
    # all its runs are in the folder already
    result, folder = small
    before = {name: (folder / name).read_bytes() for name in NAMES}
    shown = command(
        *("abc", "random-search", "--dimensions", 2, "--functions", "1,8", "--instances", 2),
        *("--budget-factor", 30, "--workers", 1, "--out", folder),
    )
    assert "8 of 8 runs are in the store already" in shown.stderr
    for cell in ("BBOB, 2 variables", "moderate conditioning", share_cells(result.shares, 2)[1][0][1]):
        assert cell in shown.stdout
    assert shown.stdout.splitlines()[-1] == str(folder / "bbob.html")
    assert {name: (folder / name).read_bytes() for name in NAMES} == before


@needs_ioh
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("abc", "--functions", "1-"), "--functions: got 1-; give whole numbers"),
        (("abc", "--dimensions", "two"), "--dimensions: got two"),
        (("abc", "--functions", "24-25"), "functions: got '25'"),
        (("abd",), "did you mean 'abc'"),
        (("tercom",), "it needs an inertial track"),
    ],
)
def test_the_command_refuses_in_one_line(command, tmp_path, arguments, message) -> None:
    shown = command(*arguments, "--out", tmp_path / "none", code=2)
    assert shown.stderr.startswith("navopt: error: ")
    assert message in shown.stderr
    assert not (tmp_path / "none").exists()
