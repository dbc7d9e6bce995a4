"""The effects of an ablation for a reader: cells of a table, a forest plot, what the console prints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from comparisons.ablation_design import Design
from comparisons.drawing import COLOURS, MARKERS, styled
from comparisons.effects import POOLED, SIZES
from comparisons.wording import Display, format_number

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["WORDS", "effect_cells", "effect_groups", "effect_notes", "forest", "print_effects"]

#: Heading of the rows that compare two scenarios instead of two variants.
CONTRASTS = "between scenarios (base solver)"
#: Corrected p-value below which an effect is named.
SIGNIFICANCE = 0.05
#: Columns of words, the others are numbers.
WORDS = ("ingredient", "base → other", "effect")
WIDTH = 8.4
PRINT_WIDTH = 110
#: Pooled marker and interval.
DARK = "#222222"


def effect_groups(table: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """Rows of an effect table by scenario, the contrasts last, each with its heading."""
    found = [
        (str(scenario), part)
        for scenario, part in table[table["kind"] == "ingredient"].groupby("scenario", sort=False)
    ]
    contrasts = table[table["kind"] == "contrast"]
    return found + ([(CONTRASTS, contrasts)] if len(contrasts) else [])


def effect_cells(table: pd.DataFrame, display: Display) -> pd.DataFrame:
    """Turn rows of `comparisons.effect_table` into text, one column per column shown.

    Parameters
    ----------
    table : pandas.DataFrame
        Rows, usually of one group of `effect_groups`.
    display : Display
        Unit of the score.
    """
    unit = f" {display.unit}" if display.unit else ""
    columns: dict[str, list[str]] = {
        "ingredient": list(map(str, table["ingredient"])),
        "base → other": [
            f"{base} → {other}" for base, other in zip(table["base"], table["other"], strict=True)
        ],
        "pairs": [
            f"{n}" if n == planned else f"{n}/{planned}"
            for n, planned in zip(table["pairs"], table["expected"], strict=True)
        ],
        "A12 [95 %]": [
            _with_interval(*ends) for ends in table[["a12", "a12_low", "a12_high"]].itertuples(index=False)
        ],
        "effect": [_in_words(*row) for row in table[["a12", "size", "p_holm"]].itertuples(index=False)],
    }
    if table["difference"].notna().any():
        columns[f"difference{unit}"] = [display.text(value) for value in table["difference"]]
    if table["ratio"].notna().any():
        columns["ratio"] = [format_number(value) for value in table["ratio"]]
    columns["p (Holm)"] = [
        "–" if np.isnan(p) else "<0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"
        for p in table["p_holm"]
    ]
    return pd.DataFrame(columns, index=table.index)


def _with_interval(a12: float, low: float, high: float) -> str:
    if np.isnan(a12):
        return "–"
    return f"{a12:.2f}" if np.isnan(low) else f"{a12:.2f} [{low:.2f}–{high:.2f}]"


def _in_words(a12: float, size: str, p_holm: float) -> str:
    """Size and direction; neither is claimed of an effect that could be chance."""
    if not size:
        return "–"
    if not p_holm < SIGNIFICANCE:
        return "not told apart"
    return size if size == "negligible" else f"{size}: {'base' if a12 > 0.5 else 'other'} better"


def effect_notes(table: pd.DataFrame, study: Any) -> list[str]:
    """Sentences that say how to read the effects."""
    design = Design.from_table(study.ablation)
    said = [
        "A12 is the share of pairs (same world, same seed) in which the base's value has the lower "
        f"{Display.of(study).label}, ties half: above 0.5 the ingredient helps as the base has it, below "
        "0.5 the other value is better. Its interval is a 95 % bootstrap interval over whole worlds; fewer "
        "than six worlds give none. From "
        + ", ".join(f"{0.5 + least:.2f} ({word})" for least, word in reversed(SIZES))
        + " an effect that could not be chance has a name.",
        "Difference (other minus base) and ratio (other over base) are medians over the pairs; p is of the "
        "Wilcoxon signed-rank test over worlds, Holm-corrected for the rows of a block; from "
        f"{SIGNIFICANCE:g} on base and other are not told apart.",
    ]
    if design.design == "factorial":
        said.append(
            "All combinations were run: an effect is the main effect of its ingredient, over all pairs that "
            "differ in nothing else. Interactions are in the ranked tables."
        )
    else:
        said.append(
            "Each variant differs from the base in one ingredient, so the effects hold beside the base's "
            "other values only."
        )
    if (table["scenario"] == POOLED).any():
        said.append(
            "All scenarios together are compared by order and ratio only, since their scores have different "
            "sizes; a world counts once however many scenarios it has."
        )
    alike = sorted(set(table.loc[table["unit"] == "seed", "scenario"]))
    if alike:
        said.append(
            f"In {', '.join(alike)} every world is the same, so each run counts once and the solver seed is "
            "the independent unit."
        )
    return said


@styled
def forest(table: pd.DataFrame, study: Any) -> Figure:
    """Forest plot of an effect table: A12 of each ingredient with its interval.

    A diamond is all scenarios together (or the only one), a coloured mark one scenario. Right of the line
    the base's value is better.

    Parameters
    ----------
    table : pandas.DataFrame
        From `comparisons.effect_table`.
    study : Study
        The ablation's study.

    Returns
    -------
    matplotlib.figure.Figure
    """
    main = table[table["kind"] == "ingredient"]
    scenarios = [label for label in dict.fromkeys(main["scenario"]) if label != POOLED]
    contrasts = table[table["kind"] == "contrast"]
    lines = [(row.label, f"{row.ingredient}: {row.base} → {row.other}") for row in main.itertuples()]
    lines += [(row.label, f"{row.ingredient}: {row.base} → {row.other}") for row in contrasts.itertuples()]
    place = {label: k for k, label in enumerate(dict.fromkeys(label for label, _ in lines))}
    several = len(scenarios) > 1
    step = 0.8 / (len(scenarios) + 2) if several else 0.0
    figure = Figure(
        figsize=(WIDTH, 1.5 + len(place) * (0.3 + (0.11 * len(scenarios) if several else 0.1))),
        layout="constrained",
    )
    axes = figure.add_subplot()
    for least, _ in SIZES:
        axes.axvspan(0.5 - least, 0.5 + least, color="#888888", alpha=0.07, linewidth=0)
    axes.axvline(0.5, color="#333333", linewidth=1.0)
    for k, scenario in enumerate(scenarios):
        own = main[main["scenario"] == scenario]
        style = {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)]}
        if not several:
            style = {"color": DARK, "marker": "D"}
        heights = [place[label] + (k + 1) * step - 0.3 * several for label in own["label"]]
        _marks(axes, own, heights, scenario, size=4.5 if several else 6.5, **style)
    own = main[main["scenario"] == POOLED]
    if len(own):
        heights = [place[label] - 0.3 for label in own["label"]]
        _marks(axes, own, heights, POOLED, color=DARK, marker="D", size=7.5)
    if len(contrasts):
        heights = [float(place[label]) for label in contrasts["label"]]
        _marks(axes, contrasts, heights, CONTRASTS, color=DARK, marker="o", size=6.5)
    axes.set_yticks(list(place.values()), [dict(reversed(lines))[label] for label in place])
    axes.set_ylim(len(place) - 0.4, -0.6)
    axes.set_xlim(-0.03, 1.03)
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("A12: share of pairs in which the base is better")
    axes.set_title("← the other value is better  |  the base is better →", loc="center", fontsize=9.5)
    if several or len(contrasts):
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def _marks(
    axes: Any, own: pd.DataFrame, heights: list[float], label: str, *, color: str, marker: str, size: float
) -> None:
    y = np.array(heights)
    for height, low, high in zip(y, own["a12_low"], own["a12_high"], strict=True):
        if np.isfinite(low):
            axes.plot([low, high], [height, height], color=color, linewidth=size / 4, zorder=3)
    axes.plot(
        own["a12"], y, linestyle="none", color=color, marker=marker, markersize=size,
        markeredgecolor="white", markeredgewidth=0.5, label=label, zorder=4,
    )  # fmt: skip


def print_effects(table: pd.DataFrame, study: Any, console: Console | None = None) -> None:
    """Print the effects of an ablation: all scenarios together, or the only one, and the contrasts.

    Parameters
    ----------
    table : pandas.DataFrame
        From `comparisons.effect_table`.
    study : Study
        The ablation's study.
    console : rich.console.Console, optional
        Where to print; the standard output if not given.
    """
    from rich import box
    from rich.console import Console as RichConsole
    from rich.table import Table
    from rich.text import Text

    console = console if console is not None else RichConsole()
    width = min(console.width, PRINT_WIDTH)
    groups = effect_groups(table)
    shown = [groups[0], *(group for group in groups[1:] if group[0] == CONTRASTS)]
    for heading, part in shown:
        title = Text(f"{study.title}: effect of each ingredient, {heading}", style="bold")
        printed = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        cells = effect_cells(part, Display.of(study))
        for column in cells.columns:
            name = column in WORDS
            justify: Literal["left", "right"] = "left" if name else "right"
            printed.add_column(Text(str(column)), justify=justify, no_wrap=column == WORDS[0] or not name)
        for values in cells.to_numpy():
            printed.add_row(*map(Text, values))
        console.print(printed, width=width)
    for note in effect_notes(table, study):
        console.print(Text(note), style="dim", width=width)
    if len(groups) > len(shown):
        console.print(Text("Each scenario by itself is in the report."), style="dim", width=width)
