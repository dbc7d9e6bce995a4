"""How results are worded: numbers with their units, the cells of a table, the notes below it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

__all__ = ["Display", "cells", "format_number", "notes", "reference_cells", "smallest_p"]

THIN_SPACE = "\u2009"
TIE_MARK = "≈"


def format_number(value: float, *, digits: int = 3) -> str:
    """Format a number to `digits` significant digits as a reader wants it.

    Parameters
    ----------
    value : float
        Any number; ``inf`` reads ``∞`` (a failure) and NaN ``–`` (unknown).
    digits : int, default 3
        Significant digits; whole numbers below ten million are written in full.
    """
    if value is None or value is pd.NA or np.isnan(value):
        return "–"
    if np.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    size = abs(float(f"{value:.{digits - 1}e}"))
    if size >= 1e7 or size < 1e-3:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        text = f"{mantissa}e{int(exponent)}"
    elif size >= 1000:
        text = f"{value:,.0f}".replace(",", THIN_SPACE)
    else:
        text = f"{value:.{max(0, digits - 1 - int(np.floor(np.log10(size))))}f}"
    return text.replace("-", "−")


@dataclass(frozen=True)
class Display:
    """Unit in which a study shows its ranking score.

    Attributes
    ----------
    scale : float
        Factor from the score's own unit to the shown one.
    unit : str
        The shown unit; empty if the score's name says it.
    label : str
        What the score is, in words.
    """

    scale: float = 1.0
    unit: str = ""
    label: str = ""

    @classmethod
    def of(cls, study: Any) -> Display:
        """Display of a study, by default the plain score under its own name."""
        asked = dict(getattr(study, "display", None) or {})
        return cls(
            float(asked.get("scale", 1.0)), str(asked.get("unit", "")), str(asked.get("label", study.rank_by))
        )

    @property
    def title(self) -> str:
        """Label with its unit, for an axis or a column."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def text(self, value: float, *, digits: int = 3) -> str:
        """`value` of the score in the shown unit, without the unit's name."""
        return format_number(value * self.scale, digits=digits)


def _middle(display: Display, median: float, q25: float, q75: float) -> str:
    """Median with the quartiles in brackets; a dash between them unless it would be read as a sign."""
    if np.isinf(q25):
        return display.text(median)
    low, high = display.text(q25), display.text(q75)
    return f"{display.text(median)} [{low}{' to ' if '−' in low + high else '–'}{high}]"


def _percent(value: float) -> str:
    return "–" if np.isnan(value) else f"{100 * value:.0f}"


def _p_value(value: float) -> str:
    if np.isnan(value):
        return ""
    return "<0.001" if value < 0.001 else f"{value:.3f}" if value < 0.1 else f"{value:.2f}"


def cells(table: pd.DataFrame, labels: list[str], display: Display) -> pd.DataFrame:
    """Turn rows of a ranked table into text, one column per column shown.

    Parameters
    ----------
    table : pandas.DataFrame
        Rows of `comparisons.statistics.ranked_table`, usually of one scenario.
    labels : list of str
        Labels of the thresholds.
    display : Display
        Unit of the score.

    Returns
    -------
    pandas.DataFrame
        Strings, in the order of `table`. Columns that say nothing (failures where none failed,
        held-out scores where none were taken) are left out.
    """
    unit = f" {display.unit}" if display.unit else ""
    text = display.text
    columns: dict[str, list[str]] = {
        "#": [
            ("–" if pd.isna(rank) else str(rank)) + (TIE_MARK if tie else "")
            for rank, tie in zip(table["rank"], table["tie"], strict=True)
        ],
        "solver": [str(s) for s in table["solver"]],
        "runs": [
            f"{n}" if n == expected else f"{n}/{expected}"
            for n, expected in zip(table["runs"], table["expected"], strict=True)
        ],
    }
    if (table["failures"] > 0).any():
        columns["failed"] = [str(n) for n in table["failures"]]
    columns[f"median [quartiles]{unit}"] = [
        _middle(display, r.median, r.q25, r.q75) if r.runs else "–"
        for r in table[["median", "q25", "q75", "runs"]].itertuples(index=False)
    ]
    columns[f"mean ± SD{unit}"] = [
        f"{text(r.mean)} ± {display.text(r.sd, digits=2)}" if not np.isnan(r.mean) else "–"
        for r in table[["mean", "sd"]].itertuples(index=False)
    ]
    if "held_out" in table and table["held_out"].notna().any():
        columns[f"held out{unit}"] = [text(v) for v in table["held_out"]]
    for label in labels:
        keys = [f"p[{label}]", f"p_low[{label}]", f"p_high[{label}]"]
        columns[f"{label} %"] = [
            "–" if np.isnan(p) else f"{_percent(p)} [{_percent(low)}–{_percent(high)}]"
            for p, low, high in table[keys].itertuples(index=False)
        ]
    for name in table.columns:
        if str(name).startswith("over["):
            label = str(name).removeprefix("over[").removesuffix("]")
            columns[f"rms / {label}"] = [
                format_number(ratio) + (f" ({counted} runs)" if 0 < counted < runs - failures else "")
                for ratio, counted, runs, failures in table[
                    [name, f"bounded[{label}]", "runs", "failures"]
                ].itertuples(index=False)
            ]
    columns["p (Holm)"] = [
        "best" if best else _p_value(p) for best, p in zip(table["best"], table["p_holm"], strict=True)
    ]
    columns["cost"] = [f"{v:.0f}" if v < 1000 and v == round(v) else format_number(v) for v in table["cost"]]
    columns["time s"] = ["<0.001" if v < 1e-3 else format_number(v, digits=2) for v in table["time_s"]]
    return pd.DataFrame(columns, index=table.index)


def smallest_p(table: pd.DataFrame) -> float:
    """Smallest corrected p-value that the scenario with the fewest worlds could give, 0 without tests.

    All n differences of one sign have the two-sided p-value 2^(1 − n), which Holm's rule multiplies by
    the number of comparisons.
    """
    tested = table[table["pairs"] > 0].groupby("scenario")["pairs"].agg(["min", "size"])
    return min(1.0, float((tested["size"] * 2.0 ** (1 - tested["min"])).max())) if len(tested) else 0.0


def notes(table: pd.DataFrame, study: Any, *, significance: float = 0.05, brief: bool = False) -> list[str]:
    """Sentences that say how to read a ranked table.

    Parameters
    ----------
    table : pandas.DataFrame
        The ranked table.
    study : Study
        What was compared.
    significance : float
        Level of the tie marks.
    brief : bool
        Only what a printed table needs, leaving out the definitions.

    Returns
    -------
    list of str
        Plain sentences without markup.
    """
    said = [
        "Ranked by the median over all runs; a failed or invalid run counts as the worst score (∞), so it "
        "moves the median and the quartiles; mean and SD are over the runs that succeeded.",
        f"{TIE_MARK} marks a solver not told apart from the best: p ≥ {significance:g} in a two-sided "
        "Wilcoxon signed-rank test, paired by world on the medians over solver seeds (zeros split), "
        "Holm-corrected for the number of solvers.",
    ]
    if study.success:
        said.append(
            "Shares below a threshold count failures as misses; in brackets the 95 % Wilson interval at the "
            "number of worlds, since runs on one world are not independent."
        )
    if study.bound:
        said.append(
            "rms / bound is the root mean square error over the root mean square of its bound, the least "
            "that any method can have on average if errors are normal and as declared; with few worlds it "
            "may be below 1 by chance. A dash: no bound is known, or the runs are from a version without it."
        )
    if (table["runs"] < table["expected"]).any():
        said.append("Some runs are still missing: the ranking is provisional.")
    smallest = smallest_p(table)
    if smallest >= significance:
        said.append(
            "With so few worlds for so many solvers the corrected p cannot fall below "
            f"{format_number(smallest, digits=2)}, so nothing can be told apart."
        )
    if study.rank_by == "loss":
        said.append(
            "The loss ranks: only solvers whose answer is a decision vector can be compared by it, not those "
            "that attach an estimate of their own."
        )
    if study.lockstep:
        said.append(
            "Runs of a swarm that differ only in their seeds advanced together where they could: the results "
            "are those of single runs, but the time of each is an equal share of its group's, which is far "
            "less than a run alone takes. Times of such solvers and of the others do not compare."
        )
    if brief:
        return said
    said += [
        "The median's interval, here and in the CSV file, is a 95 % bootstrap interval over worlds "
        "(bias-corrected and accelerated, 2000 resamples, fixed seed); fewer than six worlds give none.",
        "The best solver is chosen by the same data it is tested on, which favours it slightly: read the "
        "p-values as a screen, not as a confirmation.",
        "Cost is the number of model evaluations that the budget limits: loss and residual evaluations, "
        "Jacobians times the number of parameters, and model runs inside a solver's own kernel. Time is the "
        "mean wall time of a run.",
    ]
    return said


def reference_cells(reference: dict[str, Any], study: Any, columns: list[str], display: Display) -> list[str]:
    """Cells of the row that shows what is had without any solver, in the columns of `cells`.

    Parameters
    ----------
    reference : dict
        What `comparisons.statistics.reference_errors` returned.
    study : Study
        What was compared.
    columns : list of str
        Columns of the table.
    display : Display
        Unit of the score.
    """
    texts = {
        "#": "–",
        "solver": f"{reference['label']} ({reference['n']} of {len(study.worlds)} worlds)",
        "median [": _middle(display, reference["median"], reference["q25"], reference["q75"]),
        "mean ±": f"{display.text(reference['mean'])} ± {display.text(reference['sd'], digits=2)}",
    }
    shares = {f"{label} %": f"{_percent(share)}" for label, share in reference["shares"].items()}
    return [
        next((text for start, text in {**texts, **shares}.items() if column.startswith(start)), "")
        for column in columns
    ]
