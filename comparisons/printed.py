"""Printed and measured: what publications say, beside the runs of a study."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from comparisons.entries import STATISTICS, Printed
from comparisons.measures import summarize, wilson_interval
from comparisons.statistics import run_scores
from comparisons.wording import Display, format_number
from navopt.errors import InvalidInput

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["NOTE", "print_printed", "printed_cells", "printed_sources", "printed_table"]

#: How the tables are to be read.
NOTE = (
    "A printed number stands for everything that rounds to it. The range is that of our runs, a failed run "
    "being the worst; a printed number of one run, or of an unsaid number of runs, is also compared with our "
    "median. A share is compared with the 95 % Wilson interval of ours at the number of worlds."
)
#: Ratios up to which a difference is said in per cent, and up to which as a factor.
PER_CENT, FACTOR = 1.1, 10.0
#: Relative difference below which more than three digits of ours are shown, and how many at most.
NEAR, MOST_DIGITS = 0.05, 6


def printed_table(store_or_runs: Any, study: Any = None) -> pd.DataFrame:
    """Compare every printed value of a study with its runs.

    Parameters
    ----------
    store_or_runs : ResultsStore or pandas.DataFrame
        The store, or what its ``runs()`` returned.
    study : Study, optional
        What was compared; the store's own if not given.

    Returns
    -------
    pandas.DataFrame
        One row per printed value, in their order and in the units of the scores: ``source, scenario,
        solver, score, statistic, below``; ``printed``; ``ours``, the same statistic of our runs (of
        ``"run"``, the median); ``runs, median, minimum, maximum`` over our runs; ``lower``, the share of our
        runs that are lower (ties count half); ``place``, where the printed value lies in our range (of a
        share, in its interval), ``"inside"``, ``"below"`` or ``"above"``, empty without runs; ``factor``,
        printed over ours where they have one sign; ``verdict`` in words; ``note``.

    Raises
    ------
    InvalidInput
        If runs are given without their study.
    UnknownName
        If runs succeeded, but none has such a score.
    """
    runs = store_or_runs if isinstance(store_or_runs, pd.DataFrame) else store_or_runs.runs()
    study = study if study is not None else getattr(store_or_runs, "study", None)
    if study is None:
        raise InvalidInput("study", study, "give the Study the runs belong to")
    return pd.DataFrame([_row(value, runs, study) for value in study.printed], columns=_COLUMNS)


_COLUMNS = [
    *("source", "scenario", "solver", "score", "statistic", "below", "printed", "ours", "runs", "median"),
    *("minimum", "maximum", "lower", "place", "factor", "verdict", "note"),
]


def _row(value: Printed, runs: pd.DataFrame, study: Any) -> dict[str, Any]:
    scenarios = (value.scenario,) if value.scenario in study.scenarios else study.groups[value.scenario]
    own = runs[runs["scenario"].isin(scenarios) & (runs["solver"] == value.solver)] if len(runs) else runs
    scores = run_scores(own, value.score).to_numpy() if len(own) else np.zeros(0)
    described = summarize(scores)
    ours = described.get("median" if value.statistic == "run" else value.statistic, np.nan)
    low, high = described["minimum"], described["maximum"]
    if value.below is not None:
        worlds = own["world"].nunique() if len(own) else 0
        ours = float(np.mean(scores < value.below)) if scores.size else np.nan
        low, high = wilson_interval(ours * worlds, worlds) if worlds else (np.nan, np.nan)
    place = ""
    if scores.size and value.statistic != "sd":
        nearest = value.value + value.half_unit < low, value.value - value.half_unit > high
        place = {(True, False): "below", (False, True): "above"}.get(nearest, "inside")
    row = {
        "source": value.source,
        "scenario": value.scenario,
        "solver": value.solver,
        "score": value.score,
        "statistic": value.statistic,
        "below": np.nan if value.below is None else value.below,
        "printed": value.value,
        "ours": ours,
        "runs": len(own),
        "median": described["median"],
        "minimum": described["minimum"],
        "maximum": described["maximum"],
        "lower": _lower(scores, value.value) if scores.size else np.nan,
        "place": place,
        "factor": value.value / ours if ours * value.value > 0 and np.isfinite(ours) else np.nan,
        "note": value.note,
    }
    unit = Display.of(study) if value.score == study.rank_by and value.below is None else Display()
    return {**row, "verdict": _verdict(value, row, unit) if len(own) else "no runs yet"}


def _lower(scores: np.ndarray, value: float) -> float:
    return float(np.mean(scores < value) + 0.5 * np.mean(scores == value))


def _verdict(value: Printed, row: dict[str, Any], unit: Display) -> str:
    if value.below is not None:
        where = {"inside": "inside", "below": "below", "above": "above"}[row["place"]]
        return f"{where} the interval of our share"
    near = _nearness(value, row["ours"], "median" if value.statistic == "run" else value.statistic, unit)
    if row["place"] == "inside":
        return f"inside our range, {100 * row['lower']:.0f} % of our runs are lower; {near}"
    side = {"below": "lower than all our runs; ", "above": "higher than all our runs; ", "": ""}
    return side[row["place"]] + near


def _nearness(value: Printed, ours: float, statistic: str, unit: Display) -> str:
    """How far a printed value is from the same statistic of ours, in the words of its distance."""
    name = {"sd": "SD", "minimum": "lowest", "maximum": "highest"}.get(statistic, statistic)
    if np.isnan(ours):
        return f"we have no {name}"
    if not np.isfinite(ours):
        return f"our {name} is a failure"
    difference = value.value - ours
    if abs(difference) <= value.half_unit:
        return f"rounds to our {name}" if difference else f"equals our {name}"
    side = "above" if difference > 0 else "below"
    factor = value.value / ours if ours else -1.0
    if 1 / PER_CENT < factor < PER_CENT:
        percent = 100 * abs(difference / ours)
        return f"{format_number(percent, digits=2)} % {side} our {name}"
    if 1 / FACTOR < factor < FACTOR:
        return f"{format_number(factor, digits=2)} times our {name}"
    if factor <= 0:
        return f"{unit.text(abs(difference))} {unit.unit}".strip() + f" {side} our {name}"
    decades = round(abs(np.log10(factor)))
    return f"{decades} order{'s' if decades > 1 else ''} of magnitude {side} our {name}"


def printed_sources(table: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """Rows of `printed_table` by source, in the order in which the study names them."""
    return [(str(source), part) for source, part in table.groupby("source", sort=False)]


def printed_cells(table: pd.DataFrame, study: Any) -> pd.DataFrame:
    """Turn rows of `printed_table` into text.

    Parameters
    ----------
    table : pandas.DataFrame
        Rows, usually of one source.
    study : Study
        What was compared: scores that rank are shown in its unit, the others in their own.

    Returns
    -------
    pandas.DataFrame
        Strings: scenario, solver, what is compared, printed and our values, verdict. Where all values are
        of single runs or medians our value is the median and has no column of its own.
    """
    shown = Display.of(study)
    rows = []
    for value, row in zip(_values(table, study), table.to_dict("records"), strict=True):
        unit = shown if value.score == study.rank_by else Display(label=value.score)
        what = f"{unit.title}, {STATISTICS[value.statistic]}"
        own = unit
        if value.below is not None:
            what, own = f"share of {unit.label} < {unit.text(value.below)} {unit.unit}".rstrip(), Display()
        # where printed and our values begin with the same digits, show those that differ
        near = abs(value.value - row["median"]) < NEAR * abs(row["median"])
        digits = min(max(3, value.digits), MOST_DIGITS) if near else 3
        rows.append(
            {
                "scenario": value.scenario,
                "solver": value.solver,
                "of": what,
                "printed": own.text(value.value, digits=value.digits),
                "ours": own.text(row["ours"], digits=digits),
                "our median": unit.text(row["median"], digits=digits),
                "lowest": unit.text(row["minimum"], digits=digits),
                "highest": unit.text(row["maximum"], digits=digits),
                "verdict": row["verdict"],
            }
        )
    cells = pd.DataFrame(rows, index=table.index)
    return cells.drop(columns="ours") if table["statistic"].isin(("run", "median")).all() else cells


def _values(table: pd.DataFrame, study: Any) -> list[Printed]:
    # the table keeps the index of the study's list, whichever rows of it are shown
    return [study.printed[k] for k in table.index]


def print_printed(store: Any, console: Console) -> None:
    """Print the comparison with each source, and how to read it; nothing if the study has no printed values.

    Parameters
    ----------
    store : ResultsStore
        Results of the study.
    console : rich.console.Console
        Where to print.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    study = store.study
    if not study.printed:
        return
    for source, part in printed_sources(printed_table(store)):
        cells = printed_cells(part, study)
        title = Text(f"Printed and measured: {source}", style="bold")
        shown = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        for column in cells.columns:
            words = column in ("scenario", "solver", "of", "verdict")
            shown.add_column(column, justify="left" if words else "right", overflow="fold", no_wrap=not words)
        for values in cells.to_numpy():
            shown.add_row(*[Text(value) for value in values])
        console.print(shown)
        for note in dict.fromkeys(part["note"]):
            if note:
                console.print(Text(note), style="dim")
    console.print(Text(NOTE), style="dim")
