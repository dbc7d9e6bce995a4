"""Statistics of studies: intervals, tests, and the ranked table."""

import io
import itertools

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from comparisons.statistics import (
    compare_with_best,
    holm,
    print_ranked,
    quantile,
    ranked_table,
    run_scores,
    success_columns,
    summarize,
    wilcoxon_p,
    wilson_interval,
)
from comparisons.study import SolverEntry, Study, Success
from navopt.errors import InvalidInput, UnknownName


def make_study(*labels, worlds=8, seeds=(1,), **changes):
    values = {
        "name": "made",
        "problem": "sphere",
        "scenarios": {"calm": {}},
        "solvers": tuple(SolverEntry("pso", label) for label in labels),
        "worlds": tuple(range(worlds)),
        "seeds": seeds,
        "budget": 100,
        "rank_by": "error_m",
        "display": {"scale": 0.001, "unit": "km", "label": "error"},
        "success": (Success("error_m", (1500.0,), ("within 1.5 km",)),),
    }
    return Study(**(values | changes))


def make_runs(errors, *, scenario="calm", seeds=(1,)):
    """Runs of {solver: errors by world (and seed)}; a negative error is a failed run, None no run."""
    rows = []
    for solver, values in errors.items():
        grid = np.array(values, dtype=object).reshape(-1, len(seeds))
        for (world, place), value in np.ndenumerate(grid):
            if value is None:
                continue
            failed = value < 0
            rows.append(
                {
                    "key": f"{scenario}-{solver}-{world}-{seeds[place]}",
                    "scenario": scenario,
                    "world": world,
                    "solver": solver,
                    "seed": seeds[place],
                    "status": "failed" if failed else "budget",
                    "loss": np.nan if failed else value / 10,
                    "elapsed_s": np.nan if failed else 0.5,
                    "cost": np.nan if failed else 100.0,
                    "n_eval": np.nan if failed else 90.0,
                    "score.error_m": np.nan if failed else float(value),
                }
            )
    return pd.DataFrame(rows)


# -- measures --------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("successes", "n", "low", "high"), [(48, 50, 86.5, 98.9), (14, 50, 17.5, 41.7), (0, 10, 0, 27.8)]
)
def test_wilson_known_values(successes, n, low, high):
    assert np.round(100 * np.array(wilson_interval(successes, n)), 1) == pytest.approx([low, high], abs=0.051)


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_wilson_ends_solve_the_score_equation(confidence):
    from scipy.stats import norm

    for n, successes in [(7, 3), (50, 48), (1000, 1)]:
        for end in wilson_interval(successes, n, confidence=confidence):
            z = abs(successes / n - end) / np.sqrt(end * (1 - end) / n)
            assert z == pytest.approx(norm.ppf(0.5 + confidence / 2), rel=1e-9)


def test_wilson_edges_and_refusals():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    assert wilson_interval(0, 5)[0] == 0.0
    assert wilson_interval(5, 5)[1] == 1.0
    with pytest.raises(InvalidInput, match="successes"):
        wilson_interval(6, 5)
    with pytest.raises(InvalidInput, match="confidence"):
        wilson_interval(1, 5, confidence=95)


def test_quantile_is_numpys_where_finite_and_infinite_where_a_failure_takes_part():
    rng = np.random.default_rng(3)
    for n in (1, 2, 5, 12):
        x = rng.normal(size=(n, 4))
        for q in (0, 0.25, 0.5, 0.8, 1):
            np.testing.assert_allclose(quantile(x, q), np.quantile(x, q, axis=0), rtol=1e-12)
    assert quantile([1, 2, np.inf, np.inf], 0.5) == np.inf
    assert quantile([1, 2, 3, np.inf], 0.5) == 2.5
    assert quantile([np.inf, np.inf], 0.3) == np.inf
    assert np.isnan(quantile([], 0.5))


def test_summary_of_a_plain_sample():
    sample = np.arange(1.0, 22.0)
    described = summarize(sample)
    assert described["median"] == 11
    assert (described["q25"], described["q75"], described["iqr"]) == (6, 16, 10)
    assert described["mean"] == pytest.approx(11)
    assert described["sd"] == pytest.approx(np.std(sample, ddof=1))
    assert 6 <= described["median_low"] < 11 < described["median_high"] <= 16
    assert summarize(sample) == described  # the bootstrap's seed is fixed


def test_summary_counts_failures_as_worst_and_keeps_mean_finite():
    described = summarize([1.0, 2.0, 3.0, 4.0, np.nan, np.inf, np.inf])
    assert (described["n"], described["failures"]) == (7, 3)
    assert described["median"] == 4
    assert described["q75"] == np.inf
    assert described["maximum"] == np.inf
    assert described["mean"] == 2.5
    assert described["median_high"] == np.inf
    none = summarize([np.inf, np.inf])
    assert none["median"] == np.inf
    assert np.isnan(none["mean"])
    assert np.isnan(none["iqr"])
    assert np.isnan(summarize([])["median"])


def test_bootstrap_draws_worlds_not_runs():
    rng = np.random.default_rng(4)
    centres = rng.normal(size=12)
    once = summarize(centres)
    # the same worlds seen five times over tell nothing new
    often = summarize(np.repeat(centres, 5), worlds=np.repeat(np.arange(12), 5))
    assert often["median_low"] == pytest.approx(once["median_low"], abs=0.2)
    naive = summarize(np.repeat(centres, 5))
    width = [s["median_high"] - s["median_low"] for s in (once, often, naive)]
    assert width[1] > 0.8 * width[0]
    assert width[2] < width[1]
    assert np.isnan(summarize(centres[:5])["median_low"])
    with pytest.raises(InvalidInput, match="worlds"):
        summarize(centres, worlds=[1, 2])


def test_bootstrap_covers_the_median():
    rng = np.random.default_rng(8)
    hits = 0
    for _ in range(60):
        described = summarize(rng.exponential(size=25))
        hits += described["median_low"] <= np.log(2) <= described["median_high"]
    assert hits >= 50  # 95 % of 60 is 57; fewer than 50 has a probability below 1e-3


def test_holm_worked_example():
    # four hypotheses with p = 0.01, 0.04, 0.03, 0.005: only the first and the last are rejected at 5 %
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == pytest.approx([1, 1])
    adjusted = holm([0.01, np.nan, 0.02])
    assert adjusted[[0, 2]] == pytest.approx([0.02, 0.02])
    assert np.isnan(adjusted[1])
    assert holm([]).size == 0


def test_wilcoxon_against_enumeration():
    a = np.array([1.1, 2.3, 0.7, 5.2, 3.0, 4.4, 2.6])
    b = a - np.array([0.1, 0.5, -0.2, 0.9, 0.4, 0.7, -0.3])
    ranks = np.array([1, 5, 2, 7, 4, 6, 3])
    signs = np.sign(a - b)
    total = ranks[signs > 0].sum()
    sums = [np.dot(ranks, picks) for picks in itertools.product([0, 1], repeat=7)]
    extreme = max(total, ranks.sum() - total)
    assert wilcoxon_p(a, b) == pytest.approx(2 * np.mean(np.array(sums) >= extreme))


def test_wilcoxon_of_failures_and_ties():
    finite = np.arange(1.0, 9.0)
    assert wilcoxon_p(finite, finite) == 1.0
    assert wilcoxon_p(np.full(8, np.inf), np.full(8, np.inf)) == 1.0
    assert wilcoxon_p(np.full(8, np.inf), finite) == pytest.approx(2 / 2**8)
    assert np.isnan(wilcoxon_p([], []))
    with pytest.raises(InvalidInput, match="second"):
        wilcoxon_p([1, 2], [1])


# -- ranked table ----------------------------------------------------------------------------------
def test_ranking_by_median_with_failures_as_worst():
    runs = make_runs({"a": [3e3] * 8, "b": [1e3] * 3 + [-1] * 5, "c": [2e3] * 7 + [-1]})
    table = ranked_table(runs, make_study("a", "b", "c")).set_index("solver")
    assert table["rank"].to_dict() == {"c": 1, "a": 2, "b": 3}
    assert table.loc["b", "median"] == np.inf
    assert table["failures"].to_dict() == {"c": 1, "a": 0, "b": 5}
    assert table.loc["b", "mean"] == 1e3  # over those that succeeded
    assert table.loc["b", "p[within 1.5 km]"] == 3 / 8  # failures are misses
    assert table.loc["b", "runs"] == 8
    assert (table["expected"] == 8).all()


def test_a_score_left_by_an_invalid_run_does_not_count():
    runs = make_runs({"a": [1e3] * 4})
    runs.loc[0, "status"] = "invalid"
    assert run_scores(runs, "error_m").tolist() == [np.inf, 1e3, 1e3, 1e3]
    with pytest.raises(UnknownName, match="error_m"):
        run_scores(runs, "error_mm")
    failed = runs.assign(status="failed").drop(columns="score.error_m")
    assert np.isinf(run_scores(failed, "error_m")).all()


def test_intervals_count_worlds_not_runs():
    errors = np.full((8, 5), 1e3)
    errors[:4] = 2e3
    runs = make_runs({"a": errors}, seeds=(1, 2, 3, 4, 5))
    table = ranked_table(runs, make_study("a", seeds=(1, 2, 3, 4, 5)))
    assert table.loc[0, "p[within 1.5 km]"] == 0.5
    assert (table.loc[0, "p_low[within 1.5 km]"], table.loc[0, "p_high[within 1.5 km]"]) == wilson_interval(
        4, 8
    )


def test_tie_marks_follow_the_corrected_test():
    rng = np.random.default_rng(5)
    base = rng.uniform(1e3, 2e3, 20)
    runs = make_runs(
        {"good": base, "same": base + np.resize([40, -41], 20) * np.linspace(0.5, 1, 20), "bad": base + 400}
    )
    table = ranked_table(runs, make_study("bad", "good", "same", worlds=20)).set_index("solver")
    best = table["best"].idxmax()
    assert best in ("good", "same")
    other = "same" if best == "good" else "good"
    assert table.loc[other, "tie"]
    assert not table.loc["bad", "tie"]
    assert not table.loc[best, "tie"]
    assert np.isnan(table.loc[best, "p_holm"])
    expected = holm([wilcoxon_p(base + 400, runs.loc[runs.solver == best, "score.error_m"])] * 2)[0]
    assert table.loc["bad", "p_holm"] == pytest.approx(expected)


def test_comparison_uses_medians_over_seeds_of_common_worlds():
    errors = {"a": [[1, 2, 3]] * 6, "b": [[2, 30, 900]] * 5 + [[None] * 3]}
    seeds = (1, 2, 3)
    runs = make_runs(errors, seeds=seeds)
    table = ranked_table(runs, make_study("a", "b", worlds=6, seeds=seeds)).set_index("solver")
    assert table.loc["b", "pairs"] == 5
    assert table.loc["b", "p_value"] == pytest.approx(2 / 2**5)
    medians = pd.DataFrame({"a": [2.0] * 6, "b": [30.0] * 5 + [np.nan]})
    assert compare_with_best(medians, "a").loc["b", "p_value"] == table.loc["b", "p_value"]


def test_equal_solvers_share_a_rank_in_the_order_of_the_study():
    table = ranked_table(make_runs({"z": [5.0] * 3, "a": [5.0] * 3}), make_study("z", "a", worlds=3))
    assert table["solver"].tolist() == ["z", "a"]
    assert table["rank"].tolist() == [1, 1]


def test_incomplete_and_empty_results():
    study = make_study("a", "b", worlds=3)
    table = ranked_table(make_runs({"b": [5.0, None, None]}), study)
    assert table["solver"].tolist() == ["b", "a"]
    assert table["rank"].isna().tolist() == [False, True]
    assert table.loc[1, "runs"] == 0
    columns = list(make_runs({"b": [1.0]}).columns)
    empty = ranked_table(pd.DataFrame(columns=columns), study)
    assert empty["rank"].isna().all()
    only_failed = ranked_table(make_runs({"a": [-1] * 3, "b": [-1] * 3}), study)
    assert only_failed["rank"].tolist() == [1, 1]
    assert not only_failed[["best", "tie"]].any().any()
    with pytest.raises(InvalidInput, match="study"):
        ranked_table(make_runs({"a": [1.0]}))


def test_rank_by_loss_and_held_out_scores():
    runs = make_runs({"a": [1.0, 2.0], "b": [3.0, 4.0]})
    runs["held_out.loss"] = [9.0, 11.0, np.nan, 1.0]
    table = ranked_table(runs, make_study("a", "b", worlds=2, rank_by="loss", success=())).set_index("solver")
    assert table.loc["a", "median"] == pytest.approx(0.15)
    assert table.loc["a", "held_out"] == 10
    assert table.loc["b", "held_out"] == np.inf


def test_labels_used_twice_are_told_apart():
    study = make_study(
        "a", success=(Success("error_m", (1,), ("near",)), Success("other_m", (2,), ("near",)))
    )
    assert [label for label, _, _ in success_columns(study)] == ["near (error_m)", "near (other_m)"]


class Results:
    def __init__(self, study, runs):
        self.study, self._runs = study, runs

    def runs(self):
        return self._runs

    def illustration(self, scenario, world):
        return {}


@pytest.mark.parametrize("width", [200, 110, 80])
def test_printed_table_fits_and_carries_units_marks_and_notes(width):
    labels = ("a solver with quite a long name, longer than most", "another", "third [red]x[/red]")
    errors = {labels[0]: [1e3] * 8, labels[1]: [1.1e3] * 7 + [-1], labels[2]: [0.9e3, 1.3e3] * 4}
    output = io.StringIO()
    print_ranked(Results(make_study(*labels), make_runs(errors)), Console(file=output, width=width))
    text = output.getvalue()
    assert max(map(len, text.splitlines())) <= min(width, 110)
    for expected in ("km", "1.00 [1.00–1.00]", "within 1.5", "≈", "failed", "Holm", "Wilson", "[red]"):
        assert expected in text
    assert ("mean" in text.split("Ranked by")[0]) == (width > 80)
