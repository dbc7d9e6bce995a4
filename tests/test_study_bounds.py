"""Errors over their bounds: as scores of gravity matching, and as a column of every table of a study."""

from __future__ import annotations

import io
import json
import tomllib
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console
from study_tools import small_study, write_toml

import navopt
from comparisons.measures import over_bound
from comparisons.provenance import study_toml
from comparisons.report import write_report
from comparisons.runner import run_study
from comparisons.statistics import print_ranked, ranked_table
from comparisons.store import ResultsStore
from comparisons.study import Bound, SolverEntry, Study
from navopt.errors import InvalidInput, NoTruth, UnknownName
from navopt.models.earth import local_tangent_plane, separation
from navopt.models.field_map import FieldMap
from navopt.models.track_errors import track_error_basis
from navopt.problems import gravity_scores
from navopt.problems.analytic import Sphere
from navopt.problems.gravity_matching import GravityMatching

BOUNDS = ("window_bound_m", "track_bound_m")
RATIOS = ("error_over_window_bound", "error_over_track_bound")
SLOPES = (3e-3, -1e-3)  # mGal per metre to the north and east


@pytest.fixture(scope="module")
def world():
    return navopt.simulate("gravity-matching", 0, hours=2.0)


def on(field, world, **options):
    settings = {
        "position_covariance": world.position_covariance,
        "ins_errors": world.ins_errors,
        "noise": 0.5,
    }
    return GravityMatching(field, options.pop("track", world.track), **(settings | options))


def surface(world, slopes):
    rows, columns = np.meshgrid(world.field_map.latitude, world.field_map.longitude, indexing="ij")
    north, east = local_tangent_plane(rows, columns, *world.origin)
    return FieldMap(rows[:, 0], columns[0], slopes[0] * north + slopes[1] * east)


def remaining(prior, slopes, noise):
    """Covariance (north, east) of the last sample after measurements of a plane field, by the gain."""
    h = np.kron(np.eye(len(prior) // 2), slopes)
    gain = prior @ h.T @ np.linalg.inv(h @ prior @ h.T + noise**2 * np.eye(len(h)))
    return (prior - gain @ h @ prior)[-2:, -2:]


# -- the scores ----------------------------------------------------------------------------------------
@pytest.mark.parametrize("slopes", [SLOPES, (0.0, 0.0)])
def test_scores_have_the_bounds_that_a_plane_field_gives_in_closed_form(world, slopes):
    problem, track = on(surface(world, slopes), world), world.track
    basis = track_error_basis(
        track.time, track.true_latitude, track.true_longitude, world.ins_errors, heading=track.heading
    )
    expected = [
        np.sqrt(np.trace(remaining(prior, slopes, 0.5)))
        for prior in (world.position_covariance, basis.covariance())
    ]
    solution = navopt.solve(problem, "nominal")
    last = solution.estimate.latitude[-1], solution.estimate.longitude[-1]
    error = np.hypot(*separation(*last, track.true_latitude[-1], track.true_longitude[-1]))
    # the field of the map is bilinear between nodes, the tangent plane is not the ellipsoid
    assert [solution.scores[name] for name in BOUNDS] == pytest.approx(expected, rel=5e-3)
    assert [solution.scores[name] for name in RATIOS] == pytest.approx(error / expected, rel=5e-3)
    if not any(slopes):  # nothing measured: what was known of the INS beforehand
        prior = np.sqrt(np.trace(world.position_covariance[-2:, -2:]))
        assert solution.scores["window_bound_m"] == pytest.approx(prior, rel=1e-3)


def test_without_what_a_bound_needs_there_is_none(world):
    blind = on(world.field_map, world, ins_errors=None)
    scores = blind.score(blind.truth)
    assert [np.isfinite(scores[name]) for name in (*BOUNDS, *RATIOS)] == [True, False, True, False]
    assert scores == on(world.field_map, world, ins_errors=None).score(blind.truth)
    placed = navopt.simulate("gravity-matching", 0, hours=2.0, ins="placed")
    assert np.isnan(placed.score(placed.truth)["track_bound_m"])
    recorded = replace(world.track, true_latitude=None, true_longitude=None)
    nobody = on(world.field_map, world, track=recorded)
    assert np.isnan(nobody.position_bounds).all()
    with pytest.raises(NoTruth):
        nobody.score(world.truth)


def test_bounds_are_computed_once_and_by_nothing_but_a_score(world, monkeypatch):
    calls = []

    def counted(problem):
        calls.append(problem)
        return 2.0, 4.0

    monkeypatch.setattr("navopt.problems.gravity_matching.last_position_bounds", counted)
    problem = on(world.field_map, world)
    problem.loss(np.tile(problem.nominal, (50, 1)))
    problem.residuals(problem.nominal)
    problem.error_bound()
    assert calls == []
    one, two = problem.score(problem.truth), problem.score(problem.estimate(problem.nominal))
    assert calls == [problem]
    assert (one["error_over_window_bound"], one["track_bound_m"]) == (0.0, 4.0)
    assert two["error_over_track_bound"] == two["position_error_m"] / 4.0


def test_the_truth_stays_out_of_the_loss(world):
    """Bounds are at the truth, so a track with another truth has other bounds and the same loss."""
    moved = replace(world.track, true_latitude=world.track.true_latitude + 2e-3)
    one, other = on(world.field_map, world), on(world.field_map, world, track=moved)
    assert one.position_bounds != other.position_bounds
    X = np.random.default_rng(1).uniform(one.xl, one.xu, (20, 4))
    np.testing.assert_array_equal(one.loss(X), other.loss(X))


# -- the statistic ---------------------------------------------------------------------------------------
def test_root_mean_squares_are_over_pairs_of_finite_values():
    assert over_bound([3.0, 4.0], [1.0, 2.0]) == pytest.approx((np.sqrt(12.5 / 2.5), np.sqrt(2.5), 2))
    assert over_bound([3.0, np.inf, 9.0], [2.0, 2.0, np.nan]) == (1.5, 2.0, 1)
    assert over_bound([0.0, 0.0], [2.0, 2.0]) == (0.0, 2.0, 2)
    for errors, bounds in (([], []), ([np.inf], [1.0])):
        ratio, bound, pairs = over_bound(errors, bounds)
        assert (np.isnan(ratio), np.isnan(bound), pairs) == (True, True, 0)
    ratio, bound, pairs = over_bound([1.0], [0.0])
    assert (np.isnan(ratio), bound, pairs) == (True, 0.0, 1)


# -- the study -------------------------------------------------------------------------------------------
def bounded(self, estimate):
    """Scores of the sphere with a bound that differs from world to world."""
    scores = {"distance_1": float(np.linalg.norm(estimate.position - self.true_x))}
    return scores | {"least_1": 1.0 + abs(float(self.true_x[0]))}


LEAST = Bound("least_1", label="least distance")


def bounded_study(**changes):
    return small_study(**{"bound": (LEAST,), "worlds": (0, 1, 2), **changes})


def shown(store, width=110):
    output = io.StringIO()
    print_ranked(store, Console(file=output, width=width))
    return output.getvalue()


def test_bounds_survive_every_form_of_a_study(tmp_path):
    study = bounded_study(bound=(LEAST, Bound("other_1", "loss")))
    assert [(one.over, one.score, one.label) for one in study.bound] == [
        ("least_1", "distance_1", "least distance"),  # what ranks
        ("other_1", "loss", "other_1"),
    ]
    assert Study.from_dict(json.loads(json.dumps(study.to_dict()))) == study
    assert Study.from_dict(tomllib.loads(study_toml(study))) == study
    earlier = {key: value for key, value in study.to_dict().items() if key != "bound"}
    assert Study.from_dict(earlier).bound == ()
    keys = [[spec.key for spec in one.runs()] for one in (study, bounded_study(bound=()))]
    assert keys[0] == keys[1], "a bound repeats no run"
    path = write_toml(tmp_path, more='[[bound]]\nover = "least_1"\nlabel = "least distance"\n')
    assert Study.from_toml(path).bound == bounded_study().bound


@pytest.mark.parametrize(
    ("lines", "error", "words"),
    [
        ('ovr = "least_1"', UnknownName, "did you mean 'over'"),
        ('label = "a bound"', InvalidInput, "over.*required"),
        ("over = 3.0", InvalidInput, "a text"),
        ('over = "distance_1"\nscore = "distance_1"', InvalidInput, "bounds the error"),
        ('over = "a_1"\n[[bound]]\nover = "a_1"', InvalidInput, "labels of bounds"),
    ],
)
def test_unusable_bounds_are_refused_naming_the_file(tmp_path, lines, error, words):
    with pytest.raises(error, match=words) as caught:
        Study.from_toml(write_toml(tmp_path, more=f"[[bound]]\n{lines}\n"))
    assert "small.toml" in str(caught.value)


@pytest.mark.parametrize(
    "bound", [Bound("leest_1"), Bound("least_1", "distnce_1")], ids=["the bound", "the score"]
)
def test_an_unknown_bound_ends_the_study_after_its_first_run(tmp_path, monkeypatch, bound):
    monkeypatch.setattr(Sphere, "_score", bounded)
    with pytest.raises(UnknownName, match="did you mean"):
        run_study(bounded_study(bound=(bound,)), tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        assert len(store.runs()) == 1


def test_every_table_shows_the_error_over_its_bound(tmp_path, monkeypatch):
    monkeypatch.setattr(Sphere, "_score", bounded)
    run_study(bounded_study(seeds=(1, 2)), tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        runs, table, text, page = store.runs(), ranked_table(store), shown(store), write_report(store)
    written = pd.read_csv(tmp_path / "table.csv")
    for k, row in table.iterrows():
        own = runs[(runs["scenario"] == row["scenario"]) & (runs["solver"] == row["solver"])]
        truths = [
            navopt.simulate("sphere", w, n_var=2 if row["scenario"] == "plane" else 3) for w in range(3)
        ]
        least = np.array([1.0 + abs(truths[w].true_x[0]) for w in own["world"]])
        away = np.array(
            [np.linalg.norm(x - truths[w].true_x) for x, w in zip(own["x"], own["world"], strict=True)]
        )
        expected = np.sqrt((away @ away) / (least @ least))
        assert row["over[least distance]"] == pytest.approx(expected, rel=1e-12)
        assert row["bound[least distance]"] == pytest.approx(np.sqrt(np.mean(least**2)), rel=1e-12)
        assert row["bounded[least distance]"] == 6
        assert written.loc[k, "over[least distance]"] == pytest.approx(expected, rel=1e-12)
        for place in (text, page.read_text()):
            assert f"{expected:.3g}"[:4] in place
    assert "<th>rms / least distance</th>" in page.read_text()
    assert "rms / bound is the root mean square" in page.read_text()
    assert ("rms / least" in text, "rms / bound is" in text) == (True, True)


def test_runs_stored_before_there_was_a_bound_show_a_dash_and_are_not_repeated(tmp_path, monkeypatch):
    run_study(bounded_study(bound=()), tmp_path, workers=1)
    assert run_study(bounded_study(), tmp_path, workers=1).executed == 0
    with ResultsStore(tmp_path) as store:
        table, text, _ = ranked_table(store), shown(store), write_report(store)
    assert table["over[least distance]"].isna().all()
    assert (table["bounded[least distance]"] == 0).all()
    row = next(line for line in text.splitlines() if "bees" in line)
    assert "–" in row.split()
    assert pd.read_csv(tmp_path / "table.csv")["over[least distance]"].isna().all()
    # two more worlds by a version that has it: the ratio is over these, and says so
    monkeypatch.setattr(Sphere, "_score", bounded)
    assert run_study(bounded_study(worlds=range(5)), tmp_path, workers=1).executed == 8
    with ResultsStore(tmp_path) as store:
        table, text, runs = ranked_table(store), shown(store, 150), store.runs()
    assert (table["bounded[least distance]"] == 2).all()
    assert text.count("(2 runs)") == 4
    new = runs[(runs["scenario"] == "plane") & (runs["solver"] == "bees") & (runs["world"] > 2)]
    expected = np.sqrt(np.sum(new["score.distance_1"] ** 2) / np.sum(new["score.least_1"] ** 2))
    place = (table["scenario"] == "plane") & (table["solver"] == "bees")
    assert table.loc[place, "over[least distance]"].item() == pytest.approx(expected, rel=1e-12)


def test_a_failed_run_is_left_out_as_of_the_mean(tmp_path, monkeypatch):
    monkeypatch.setattr(Sphere, "_score", bounded)
    run_study(bounded_study(), tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        study, runs = store.study, store.runs()
    runs.loc[runs["world"] == 0, "status"] = "failed"
    table = ranked_table(runs, study)
    assert (table["bounded[least distance]"] == 2).all()
    assert table["over[least distance]"].notna().all()
    assert (table["failures"] == 1).all()


def test_a_gravity_study_has_errors_over_both_bounds(tmp_path):
    study = Study(
        name="tiny",
        problem="gravity-matching",
        scenarios={
            "2 h": {"hours": 2.0, "degree": 720},
            "placed": {"hours": 2.0, "degree": 720, "ins": "placed"},
        },
        solvers=(SolverEntry("nominal"), SolverEntry("window-map")),
        worlds=(0, 1),
        budget=3000,
        rank_by="position_error_m",
        illustrate=0,
        bound=(Bound("window_bound_m", label="window"), Bound("track_bound_m", label="track")),
    )
    run_study(study, tmp_path, workers=1)
    with ResultsStore(tmp_path) as store:
        table, runs = ranked_table(store).set_index(["scenario", "solver"]), store.runs()
    worlds = [navopt.simulate("gravity-matching", w, hours=2.0, degree=720) for w in (0, 1)]
    least = np.array([gravity_scores.last_position_bounds(one) for one in worlds])
    own = runs[(runs["scenario"] == "2 h") & (runs["solver"] == "window-map")].sort_values("world")
    error = own["score.position_error_m"].to_numpy()
    row = table.loc["2 h", "window-map"]
    for k, name in enumerate(("window", "track")):
        assert row[f"over[{name}]"] == pytest.approx(np.sqrt(error @ error) / np.linalg.norm(least[:, k]))
        np.testing.assert_allclose(own[f"score.error_over_{name}_bound"], error / least[:, k], rtol=1e-12)
    assert table.loc["2 h", "nominal"]["over[track]"] > row["over[track]"]
    assert np.isnan(table.loc["placed", "nominal"]["over[track]"])
    assert table.loc["placed", "nominal"]["bounded[window]"] == 2
