"""Figures and report: the right data in the pictures, and a page that stands alone."""

import re

import numpy as np
import pandas as pd
import pytest

from comparisons.drawing import UNAIDED
from comparisons.figures import (
    best_so_far,
    convergence,
    error_boxes,
    map_picture,
    render,
    solver_styles,
)
from comparisons.provenance import study_toml
from comparisons.report import write_report
from comparisons.statistics import reference_errors
from comparisons.study import SolverEntry, Study, Success
from navopt.errors import StoreError, UnknownName
from navopt.evaluation import TRACE_DTYPE

HOSTILE = "<script>alert('x')</script> & \"more\""


class MadeStore:
    """A results store without a file: whatever runs, traces and pictures a test wants."""

    def __init__(self, study, folder, *, fail=(), runs=True, pictures=False, worlds=None):
        self.study, self.path = study, folder / "results.sqlite"
        self.meta = {"versions": {"navopt": "9.8.7"}}
        self._pictures, self._traces, rows = pictures, {}, []
        rng = np.random.default_rng(1)
        for scenario in study.scenarios if runs else ():
            for world in study.worlds[:worlds]:
                for place, entry in enumerate(study.solvers):
                    for seed in study.seeds:
                        key = f"{scenario}/{world}/{entry.label}/{seed}"
                        failed = entry.label in fail
                        error = np.nan if failed else 500.0 * (place + 1) * rng.lognormal(0, 0.5)
                        if not failed:
                            self._traces[key] = np.array(
                                [(1, 9.0 + world, 0.1), (10 * (place + 1), 1.0, 0.2)], TRACE_DTYPE
                            )
                        rows.append(
                            {
                                "key": key, "scenario": scenario, "world": world, "solver": entry.label,
                                "seed": seed, "status": "failed" if failed else "budget",
                                "loss": np.nan if failed else 1.0, "elapsed_s": np.nan if failed else 0.25,
                                "cost": np.nan if failed else 100.0, "n_eval": np.nan if failed else 100.0,
                                "counts": {"loss": 100}, "scores": {"position_error_m": error},
                                "held_out": {}, "x": np.array([1.5, world]), "message": "said " + HOSTILE,
                                "invalid": {} if failed else {"left the map": 5},
                                "error": f"ValueError: {HOSTILE}" if failed else None,
                                "settings": {"options": {"pop_size": 7, **entry.settings}},
                                "score.position_error_m": error,
                            }
                        )  # fmt: skip
        columns = (
            "key scenario world solver seed status loss elapsed_s cost n_eval counts scores held_out x "
            "message invalid error settings"
        )
        self._runs = pd.DataFrame(rows, columns=None if rows else columns.split())

    def runs(self):
        return self._runs

    def traces(self):
        return self._traces

    def estimate(self, key):
        if not self._pictures or "fail" in key:
            return {}
        offset = 1e-4 * (1 + len(key.split("/")[2]))
        return {"latitude": TRACK[0][-5:] + offset, "longitude": TRACK[1][-5:]}

    def illustration(self, scenario, world):
        if not self._pictures or world not in self.study.worlds[: self.study.illustrate]:
            return {}
        latitude, longitude = np.linspace(0.3, 0.4, 60), np.linspace(2.6, 2.75, 70)
        return {
            "map_latitude": latitude,
            "map_longitude": longitude,
            "map_values": 50 * np.sin(60 * latitude)[:, None] * np.cos(70 * longitude),
            "true_latitude": TRACK[0],
            "true_longitude": TRACK[1],
            "ins_latitude": TRACK[0] + np.linspace(0, 2e-3, 40),
            "ins_longitude": TRACK[1],
            "window": np.array([5]),
        }


TRACK = np.linspace(0.33, 0.36, 40), np.linspace(2.65, 2.7, 40)


def make_study(**changes):
    values = {
        "name": "made",
        "title": "A made study",
        "description": "First.\n\nSecond.",
        "problem": "gravity-matching",
        "scenarios": {"3 h": {"hours": 3.0}, "10 h": {"hours": 10.0}},
        "solvers": (
            SolverEntry("pso"),
            SolverEntry("abc", "bees", {"pop_size": 12}),
            SolverEntry("nominal", "INS alone"),
        ),
        "worlds": (0, 1, 2, 3),
        "budget": 100,
        "rank_by": "position_error_m",
        "display": {"scale": 0.001, "unit": "km", "label": "position error"},
        "success": (Success("position_error_m", (1000.0, 5000.0), ("within 1 km", "within 5 km")),),
    }
    return Study(**(values | changes))


# -- figures ---------------------------------------------------------------------------------------
def test_boxes_show_the_worlds_in_display_units_sorted_by_rank(tmp_path):
    store = MadeStore(make_study(), tmp_path)
    figure = error_boxes(store, scenario="3 h")
    axes = figure.axes[0]
    runs = store.runs()
    medians = runs[runs.scenario == "3 h"].groupby("solver")["score.position_error_m"].median().sort_values()
    assert [t.get_text().split("  ")[0] for t in axes.get_yticklabels()] == list(medians.index)
    drawn = [set(np.round(line.get_xdata(), 9)) for line in axes.lines if line.get_marker() == "o"]
    for label, points in zip(medians.index, drawn, strict=True):
        own = runs[(runs.scenario == "3 h") & (runs.solver == label)]["score.position_error_m"]
        assert points == set(np.round(own / 1000, 9))
    assert axes.get_xlabel() == "position error (km)"
    names = [text.get_text() for text in axes.texts]
    assert "within 1 km" in names


def test_boxes_say_what_failed_and_choose_the_axis_by_the_spread(tmp_path):
    store = MadeStore(make_study(), tmp_path, fail=("bees",))
    assert "4 of 4 failed" in [t.get_text() for t in error_boxes(store, scenario="3 h").axes[0].texts]
    assert error_boxes(store, scenario="3 h").axes[0].get_xscale() == "linear"
    store._runs.loc[0, "score.position_error_m"] = 1e6
    assert error_boxes(store, scenario="3 h").axes[0].get_xscale() == "log"
    with pytest.raises(UnknownName, match="3 h"):
        error_boxes(store, scenario="3 hours")


def test_best_so_far_is_a_step_function_held_at_the_end():
    trace = np.array([(5, 4.0, 0), (8, 6.0, 0), (20, 1.0, 0)], TRACE_DTYPE)
    np.testing.assert_array_equal(
        best_so_far(trace, np.array([1, 4, 5, 19, 20, 1000])), [np.inf, np.inf, 4, 4, 1, 1]
    )
    assert np.isinf(best_so_far(trace[:0], np.array([1.0, 2.0]))).all()


def test_convergence_has_medians_over_runs_and_begins_at_the_cost_of_a_baseline(tmp_path):
    store = MadeStore(make_study(), tmp_path)
    for key, trace in store._traces.items():
        if "/bees/" in key:  # one evaluation after fifty internal ones
            store._traces[key] = trace[-1:].copy()
            store._traces[key]["cost"] = 51
    axes = convergence(store, scenario="3 h").axes[0]
    lines = {line.get_label(): line for line in axes.lines}
    np.testing.assert_allclose(lines["pso"].get_ydata()[0], 9 + 1.5)  # median of worlds 0 to 3
    assert lines["pso"].get_ydata()[-1] == 1.0
    assert lines["pso"].get_xdata()[-1] == 10
    assert 51 <= lines["bees"].get_xdata()[0] <= 54
    assert axes.get_xscale() == "log"
    held = [line for line in axes.lines if line.get_linestyle() == ":"]
    assert max(line.get_xdata().max() for line in held) == 100


def test_convergence_counts_failures_as_nothing_reached(tmp_path):
    store = MadeStore(make_study(), tmp_path, fail=("bees",))
    lines = {line.get_label(): line for line in convergence(store, scenario="3 h").axes[0].lines}
    assert "bees (failed)" in lines
    for key in [k for k in store._traces if "/pso/" in k and "3 h" in k][:3]:
        store._runs.loc[store._runs.key == key, "status"] = "failed"
    lines = {line.get_label() for line in convergence(store, scenario="3 h").axes[0].lines}
    assert "pso (failed)" in lines  # three of four


def test_styles_agree_and_differ():
    study = make_study(solvers=tuple(SolverEntry("pso", f"s{k}") for k in range(10)))
    styles = solver_styles(study)
    assert len({style.colour for style in styles.values()}) == 10
    assert len({style.marker for style in styles.values()}) == 10
    assert solver_styles(make_study())["INS alone"] == UNAIDED


def test_map_has_three_panels_with_every_track_once(tmp_path):
    store = MadeStore(make_study(), tmp_path, pictures=True)
    figure = map_picture(store, scenario="3 h", world=0)
    panels, colour_bar = figure.axes[:3], figure.axes[3]
    assert colour_bar.get_xlabel() == "gravity anomaly (mGal)"
    for axes in panels:
        labels = [line.get_label() for line in axes.lines if not line.get_label().startswith("_")]
        assert [label.split(" (")[0] for label in labels] == ["INS alone", "true track", "bees", "pso"]
        assert axes.get_aspect() == pytest.approx(1 / np.cos(0.345), rel=0.02)
    true = next(line for line in panels[0].lines if line.get_label() == "true track")
    np.testing.assert_allclose(true.get_ydata(), np.degrees(TRACK[0]))
    near = next(line for line in panels[1].lines if line.get_label() == "true track")
    assert len(near.get_xdata()) == 5
    assert {t.get_text().split()[1] for axes in panels for t in axes.texts} == {"km"}
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "INS alone (13 km)" in legend
    assert map_picture(store, scenario="3 h", world=3) is None


def test_rendering_is_repeatable_and_changes_no_global_state(tmp_path):
    import matplotlib

    store = MadeStore(make_study(), tmp_path, pictures=True)
    before = dict(matplotlib.rcParams)
    for make in (error_boxes, convergence):
        assert render(make(store, scenario="3 h")) == render(make(store, scenario="3 h"))
    first = render(map_picture(store, scenario="3 h", world=0), format="png", dpi=50)
    assert first.startswith(b"\x89PNG")
    assert dict(matplotlib.rcParams) == before
    with matplotlib.rc_context({"font.size": 30, "axes.grid": False}):
        assert render(map_picture(store, scenario="3 h", world=0), format="png", dpi=50) == first
    with pytest.raises(UnknownName, match="svg"):
        render(error_boxes(store, scenario="3 h"), format="svgz")


# -- report ----------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    scenarios = {"3 h": {"hours": 3.0}}
    study = make_study(title=f"Title {HOSTILE}", description=HOSTILE, scenarios=scenarios)
    store = MadeStore(study, folder, fail=("bees",), pictures=True)
    return store, write_report(store)


def test_page_is_deterministic_and_leaves_nothing_else(page):
    store, path = page
    before = {file.name: file.read_bytes() for file in path.parent.iterdir()}
    assert set(before) == {"report.html", "runs.csv", "table.csv"}
    assert write_report(store) == path
    assert {file.name: file.read_bytes() for file in path.parent.iterdir()} == before


def test_page_escapes_everything(page):
    text = page[1].read_text()
    assert "<script" not in text
    assert text.count("&lt;script&gt;") >= 3  # title, description, cause of the failures


def test_page_asks_nothing_of_any_network(page):
    text = page[1].read_text()
    assert all(source.startswith("data:image/") for source in re.findall(r'src="([^"]*)"', text))
    assert not re.search(r"<(link|script|iframe|object)|@import|href=|url\(|srcset", text)
    assert "default-src 'none'" in text


def test_page_says_what_was_run_and_what_came_of_it(page):
    text = page[1].read_text()
    for expected in (
        "9.8.7", "hours = 3.0", "4 (seeds 0 to 3)", "INS alone", "ValueError", "left the map",
        "pop_size = 12", "navopt run study.toml", "navopt report", "Wilcoxon", "Wilson",
        "median [quartiles] km", "[[solvers]]", "Share of the cost", "failed",
    ):  # fmt: skip
        assert expected in text, expected
    assert text.count("<img") == 3
    assert str(page[1].parent) not in text


def test_csv_files_hold_the_table_and_the_runs(page):
    store, path = page
    table = pd.read_csv(path.with_name("table.csv"))
    assert len(table) == 3
    assert {"rank", "median", "p_holm", "p_low[within 1 km]", "failures"} <= set(table.columns)
    assert np.isinf(table.loc[table.solver == "bees", "median"]).all()
    runs = pd.read_csv(path.with_name("runs.csv"))
    assert len(runs) == len(store.runs())
    assert runs.loc[0, "x"] == "1.5 0.0"


def test_reference_row_from_the_illustrations_where_no_solver_gives_one(tmp_path):
    study = make_study(solvers=(SolverEntry("pso"),), illustrate=2, scenarios={"3 h": {}})
    store = MadeStore(study, tmp_path, pictures=True)
    found = reference_errors(store, study, "3 h")
    assert found["n"] == 2
    assert found["median"] == pytest.approx(2e-3 * 6.36e6, rel=0.01)
    assert found["shares"] == {"within 1 km": 0.0, "within 5 km": 0.0}
    assert "INS alone (2 of 4 worlds)" in write_report(store).read_text()
    with_nominal = make_study()
    assert reference_errors(MadeStore(with_nominal, tmp_path, pictures=True), with_nominal, "3 h") is None


@pytest.mark.parametrize(
    ("options", "changes", "expected"),
    [
        ({"runs": False}, {}, "No run has finished yet"),
        (
            {"fail": ("pso", "bees", "INS alone"), "pictures": True},
            {"scenarios": {"3 h": {}}},
            "nothing can be ranked",
        ),
        ({"worlds": 2}, {}, "12 of 24 runs have finished"),
        ({}, {"worlds": (5,), "scenarios": {"only": {}}}, "1 (seed 5)"),
        ({}, {"solvers": (SolverEntry("cmaes"),), "success": ()}, "cmaes"),
        ({}, {"problem": "of-another-package", "rank_by": "loss", "display": {}}, "of-another-package"),
    ],
)
def test_unusual_stores_give_a_sensible_page(tmp_path, options, changes, expected):
    path = write_report(MadeStore(make_study(**changes), tmp_path, **options), tmp_path / "new" / "page.html")
    assert expected in path.read_text()
    assert "nan" not in re.sub(r"data:image[^\"]*|<style>.*?</style>", "", path.read_text(), flags=re.S)


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="file"):
        write_report(MadeStore(make_study(), tmp_path, runs=False), tmp_path / "file" / "report.html")


def test_the_study_in_the_page_is_the_study(tmp_path):
    import tomllib

    study = make_study(description='two "lines"\nand a \\ backslash', seeds=(1, 7))
    assert Study.from_dict(tomllib.loads(study_toml(study))) == study


def test_report_of_a_real_store(tmp_path):
    from comparisons.runner import run_study
    from comparisons.store import ResultsStore

    study = Study(
        name="spheres", problem="sphere", scenarios={"plane": {"n_var": 2}}, worlds=(0, 1), budget=40,
        solvers=(SolverEntry("random-search"), SolverEntry("nominal")), rank_by="distance_1", held_out=1,
    )  # fmt: skip
    run_study(study, tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        path = write_report(store)
        first = path.read_bytes()
        assert write_report(store, tmp_path).read_bytes() == first
    text = path.read_text()
    assert text.count("<img") == 2
    assert "random-search" in text
    assert "held out" in text
