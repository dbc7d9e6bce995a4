"""Statistics of a study: what can be said about solvers compared on the same worlds.

The world is the unit that is really independent: runs of several solver seeds on one world share its
noise. Descriptive statistics are over all runs; tests and intervals of probabilities count worlds.
Failed and invalid runs are never dropped: their score is ``+inf``, the worst there is.
"""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from comparisons.measures import holm, over_bound, quantile, summarize, wilcoxon_p, wilson_interval
from comparisons.wording import Display, cells, notes, reference_cells
from navopt.errors import InvalidInput, UnknownName

if TYPE_CHECKING:
    from rich.console import Console

__all__ = [
    "compare_with_best",
    "holm",
    "opened",
    "print_ranked",
    "quantile",
    "ranked_table",
    "reference_errors",
    "run_scores",
    "success_columns",
    "summarize",
    "wilcoxon_p",
    "wilson_interval",
]

#: Registered solvers that estimate nothing: the row the others are read against.
REFERENCES = ("nominal",)
#: What the ranked table has of each bound.
BOUND_COLUMNS = ("over", "bound", "bounded")
#: What scores on redrawn twins begin with.
HELD_OUT = "held_out."
#: Columns that a narrow console does without, first to go first.
DISPENSABLE = ("mean", "time", "cost", "runs")
#: Width from which names of solvers are folded.
FOLDED = 12
#: Widest line of a printed table.
PRINT_WIDTH = 110
#: Statuses whose run counts as a failure, whatever it left behind.
FAILURES = ("failed", "invalid")


def opened(store_or_runs: Any, study: Any, scenario: str) -> tuple[pd.DataFrame, Any]:
    """Runs and study of a store or of given runs, the scenario being one of the study's.

    Raises
    ------
    UnknownName
        If it is none.
    """
    runs = store_or_runs if isinstance(store_or_runs, pd.DataFrame) else store_or_runs.runs()
    study = study if study is not None else store_or_runs.study
    if scenario not in study.scenarios:
        raise UnknownName("scenario", scenario, study.scenarios)
    return runs, study


def run_scores(runs: pd.DataFrame, key: str) -> pd.Series:
    """Score of each run, ``+inf`` for every run that failed, was invalid or has no such score.

    Parameters
    ----------
    runs : pandas.DataFrame
        `ResultsStore.runs`.
    key : str
        A score of the problem, ``"loss"``, or ``"held_out."`` and a score: the mean over the redrawn twins.

    Returns
    -------
    pandas.Series
        Aligned with `runs`.

    Raises
    ------
    UnknownName
        If runs succeeded but none has such a score.
    """
    column = key if key == "loss" or key.startswith(HELD_OUT) else f"score.{key}"
    usable = ~runs["status"].isin(FAILURES)
    if column not in runs:
        if usable.any():
            named = [str(c) for c in runs.columns]
            known = [c.removeprefix("score.") for c in named if c.startswith(("score.", HELD_OUT))]
            raise UnknownName("score", key, [*known, "loss"])
        return pd.Series(np.inf, index=runs.index, dtype=float)
    scores = pd.to_numeric(runs[column], errors="coerce").astype(float)
    return scores.where(usable & np.isfinite(scores), np.inf)


def success_columns(study: Any) -> list[tuple[str, str, float]]:
    """Thresholds of a study as ``(label, score, threshold)``, with labels that are told apart."""
    listed = [
        (label, success.score, float(below))
        for success in study.success
        for label, below in zip(success.labels, success.below, strict=True)
    ]
    labels = [label for label, _, _ in listed]
    return [
        (label if labels.count(label) == 1 else f"{label} ({score})", score, below)
        for label, score, below in listed
    ]


def compare_with_best(medians: pd.DataFrame, best: str) -> pd.DataFrame:
    """Test every solver against the best one.

    Parameters
    ----------
    medians : pandas.DataFrame
        Error per world (rows) and solver (columns); NaN where a world has not been run.
    best : str
        Column the others are compared with.

    Returns
    -------
    pandas.DataFrame
        Per solver ``pairs`` (worlds both have run), ``p_value`` (paired Wilcoxon signed-rank) and
        ``p_holm`` (adjusted for the number of solvers compared); NaN for the best itself.
    """
    rows = {}
    for solver in medians.columns:
        both = medians[[best, solver]].dropna() if solver != best else medians[[best]].iloc[:0]
        p = wilcoxon_p(both[solver], both[best]) if len(both) else float("nan")
        rows[solver] = {"pairs": len(both), "p_value": p}
    table = pd.DataFrame.from_dict(rows, orient="index")
    table["p_holm"] = holm(table["p_value"].to_numpy())
    return table


def ranked_table(store_or_runs: Any, study: Any = None, *, significance: float = 0.05) -> pd.DataFrame:
    """Rank the solvers of a study in each scenario by the median of its ranking score.

    Parameters
    ----------
    store_or_runs : ResultsStore or pandas.DataFrame
        The store, or what its ``runs()`` returned.
    study : Study, optional
        What was compared; the store's own if not given.
    significance : float, default 0.05
        Adjusted p-value from which a solver counts as tied with the best.

    Returns
    -------
    pandas.DataFrame
        One row per scenario and solver, in the order of rank, in the units of the score:

        - ``scenario, rank, solver, method`` (registered name), ``score`` (what ranks);
        - ``runs, expected, worlds, failures`` (failed or invalid, each counted as the worst score);
        - ``median, median_low, median_high, q25, q75, iqr, minimum, maximum`` over all runs,
          ``mean, sd`` over those that succeeded, as in `summarize`;
        - ``p[label], p_low[label], p_high[label]`` per threshold: share of the runs below it, failures
          being misses, with its Wilson interval at the number of worlds;
        - ``over[label], bound[label], bounded[label]`` per bound: root mean square of the error over that
          of its bound, the latter by itself, and the number of runs that both are over, see `over_bound`;
        - ``evaluations, cost, time_s``: means per run; ``held_out``: median on redrawn data, if any;
        - ``pairs, p_value, p_holm, best, tie``: the comparison with the best, see `compare_with_best`,
          on the median over the solver seeds of each world.

        A solver without any run has no rank (``<NA>``) and comes last.

    Raises
    ------
    UnknownName
        If the study ranks by a score that the runs do not have.
    InvalidInput
        If runs are given without their study.
    """
    runs = store_or_runs if isinstance(store_or_runs, pd.DataFrame) else store_or_runs.runs()
    if study is None:
        study = getattr(store_or_runs, "study", None)
    if study is None:
        raise InvalidInput("study", study, "give the Study the runs belong to")
    pieces = [_rank_scenario(runs, study, scenario, significance) for scenario in study.scenarios]
    table = pd.concat(pieces, ignore_index=True)
    table["rank"] = table["rank"].astype("Int64")
    return table


def _rank_scenario(runs: pd.DataFrame, study: Any, scenario: str, significance: float) -> pd.DataFrame:
    here = runs[runs["scenario"] == scenario] if len(runs) else runs
    scores = run_scores(here, study.rank_by) if len(here) else pd.Series(dtype=float)
    thresholds = [(label, below, score) for label, score, below in success_columns(study)]
    rows = []
    for entry in study.solvers:
        own = here[here["solver"] == entry.label] if len(here) else here
        row: dict[str, Any] = {
            "scenario": scenario,
            "rank": pd.NA,
            "solver": entry.label,
            "method": entry.name,
            "score": study.rank_by,
            "runs": len(own),
            "expected": len(study.worlds) * len(study.seeds),
            "worlds": own["world"].nunique() if len(own) else 0,
        }
        described = summarize(scores.loc[own.index], worlds=own["world"]) if len(own) else summarize([])
        described.pop("n")
        row.update(described)
        for label, below, score in thresholds:
            hits = (run_scores(own, score) < below).to_numpy() if len(own) else np.zeros(0, dtype=bool)
            share = float(hits.mean()) if hits.size else float("nan")
            row[f"p[{label}]"] = share
            # runs on one world are not independent, so the interval counts worlds
            low, high = wilson_interval(share * row["worlds"] if hits.size else 0.0, row["worlds"])
            row[f"p_low[{label}]"], row[f"p_high[{label}]"] = low, high
        for one in study.bound:
            known = f"score.{one.over}" in own  # not in runs of an earlier version
            found = over_bound(*(run_scores(own, key) if known else [] for key in (one.score, one.over)))
            row |= dict(zip((f"{name}[{one.label}]" for name in BOUND_COLUMNS), found, strict=True))
        for column, source in (("evaluations", "n_eval"), ("cost", "cost"), ("time_s", "elapsed_s")):
            row[column] = _mean(own, source)
        held_out = f"held_out.{study.rank_by}"
        if held_out in runs:
            values = pd.to_numeric(own[held_out], errors="coerce").fillna(np.inf) if len(own) else []
            row["held_out"] = quantile(values, 0.5)
        rows.append(row)
    table = pd.DataFrame(rows)
    # a stable sort keeps the study's order among equals; the mean decides between equal medians
    table = table.sort_values(["median", "failures", "mean"], kind="stable", na_position="last")
    ran = table["runs"] > 0
    table.loc[ran, "rank"] = table.loc[ran, "median"].rank(method="min").astype(int)
    return _mark_ties(table.reset_index(drop=True), here, scores, significance)


def _mark_ties(
    table: pd.DataFrame, here: pd.DataFrame, scores: pd.Series, significance: float
) -> pd.DataFrame:
    table["pairs"], table["p_value"], table["p_holm"] = 0, np.nan, np.nan
    table["best"], table["tie"] = False, False
    if not len(here) or not np.isfinite(table.loc[0, "median"]):
        return table
    per_world = here.assign(_score=scores).groupby(["world", "solver"])["_score"]
    medians = per_world.agg(lambda values: quantile(values, 0.5)).unstack("solver")
    best = table.loc[0, "solver"]
    tests = compare_with_best(medians, best).reindex(table["solver"])
    for column in ("p_value", "p_holm"):
        table[column] = tests[column].to_numpy()
    table["pairs"] = tests["pairs"].fillna(0).astype(int).to_numpy()
    table["best"] = table["solver"] == best
    table["tie"] = table["p_holm"] >= significance
    return table


def reference_errors(store: Any, study: Any, scenario: str) -> dict[str, Any] | None:
    """Errors of the inertial navigation alone, from the tracks of the illustrated worlds.

    Parameters
    ----------
    store : ResultsStore
        Results of the study.
    study : Study
        What was compared.
    scenario : str
        Label of the scenario.

    Returns
    -------
    dict or None
        `summarize` of the ranking score with ``label`` and ``shares`` (below each threshold); None where
        the study has a ``nominal`` solver that says the same of all worlds, no illustration holds both
        tracks, or the score is not one of theirs.
    """
    from navopt.models.earth import distance

    errors: dict[str, list[float]] = {"position_error_m": [], "mean_position_error_m": []}
    if study.rank_by not in errors or any(entry.name in REFERENCES for entry in study.solvers):
        return None
    for world in study.worlds:
        picture = store.illustration(scenario, world)
        if not {"true_latitude", "true_longitude", "ins_latitude", "ins_longitude", "window"} <= set(picture):
            continue
        last = slice(-int(picture["window"].ravel()[0]), None)
        names = ("ins_latitude", "ins_longitude", "true_latitude", "true_longitude")
        away = distance(*(picture[name][last] for name in names))
        errors["position_error_m"].append(float(away[-1]))
        errors["mean_position_error_m"].append(float(np.mean(away)))
    if not errors[study.rank_by]:
        return None
    shares = {
        label: float(np.mean(np.array(errors[score]) < below))
        for label, score, below in success_columns(study)
        if score in errors
    }
    return {"label": "INS alone", **summarize(errors[study.rank_by]), "shares": shares}


def print_ranked(store: Any, console: Console | None = None, *, significance: float = 0.05) -> None:
    """Print the ranked table of every scenario, with the notes needed to read it.

    Parameters
    ----------
    store : ResultsStore
        Results of the study.
    console : rich.console.Console, optional
        Where to print; the standard output if not given.
    significance : float, default 0.05
        As for `ranked_table`.
    """
    from rich import box
    from rich.console import Console as RichConsole
    from rich.table import Table
    from rich.text import Text

    console = console if console is not None else RichConsole()
    width = min(console.width, PRINT_WIDTH)
    study, display = store.study, Display.of(store.study)
    table = ranked_table(store, significance=significance)
    if study.curve:
        from comparisons.curves import places_of_long_curves

        table = table[~table["scenario"].isin(places_of_long_curves(study))].reset_index(drop=True)
        if table.empty:
            console.print("The scores along the curves are in the report.")
            return
    labels = [label for label, _, _ in success_columns(study)]
    printed = {
        scenario: cells(part, labels, display) for scenario, part in table.groupby("scenario", sort=False)
    }
    for scenario, rows in printed.items():
        reference = reference_errors(store, study, str(scenario))
        if reference is not None:
            rows.loc[len(table)] = reference_cells(reference, study, list(rows.columns), display)
    for name in DISPENSABLE:
        if max(_width(rows) for rows in printed.values()) <= width:
            break
        printed = {
            scenario: rows.drop(columns=[column for column in rows if column.startswith(name)])
            for scenario, rows in printed.items()
        }
    unaided = {*table.index[table["method"].isin(REFERENCES)], len(table)}
    for scenario, rows in printed.items():
        title = Text(f"{study.title}: {scenario}", style="bold")
        shown = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        for column in rows.columns:
            heading, fits = Text("\n".join(_lines(column))), column != "solver"
            shown.add_column(heading, justify="right" if fits else "left", no_wrap=fits, overflow="fold")
        for index, values in zip(rows.index, rows.to_numpy(), strict=True):
            shown.add_row(*[Text(value) for value in values], style="italic" if index in unaided else "")
        console.print(shown, width=width)
    for note in notes(table, study, significance=significance, brief=True):
        console.print(Text(note), style="dim", width=width)


def _lines(column: str) -> list[str]:
    """Heading of a column in lines about as wide as its cells."""
    return wrap(column, 15 if "[" in column else 7 if "(" in column else 12)


def _width(rows: pd.DataFrame) -> int:
    """Width that a printed table needs; names of solvers may be folded."""
    longest = {
        column: max(map(len, [*_lines(str(column)), *rows[column]])) for column in map(str, rows.columns)
    }
    longest["solver"] = min(longest["solver"], FOLDED)
    return sum(longest.values()) + 2 * len(longest)


def _mean(own: pd.DataFrame, column: str) -> float:
    if column not in own or not len(own):
        return float("nan")
    values = pd.to_numeric(own[column], errors="coerce").to_numpy(dtype=float)
    values = values[np.isfinite(values)]
    return float(values.mean()) if values.size else float("nan")
