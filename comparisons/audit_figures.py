"""Figures of an audit: the gaps in each family, and the log ratios of each bias."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from comparisons.audit_measures import DECADES, FLOOR
from comparisons.audit_suite import BIASES, FAMILIES, Case
from comparisons.drawing import Style, solver_styles, styled
from comparisons.measures import quantile
from navopt.errors import UnknownName

if TYPE_CHECKING:
    from comparisons.audit import AuditResult

__all__ = ["bias_figure", "family_figure"]

WIDTH = 8.4
#: Largest gap that has a place on the axis; what is beyond, failures too, is drawn at the edge.
LARGEST = 1e9


@styled
def family_figure(result: AuditResult, family: str) -> Figure:
    """Gaps of all solvers on all functions with the minimum in one place.

    Markers are medians over the seeds, lines reach from the lower to the upper quartile. What does not
    reach `comparisons.audit_measures.FLOOR` apart is drawn there.

    Parameters
    ----------
    result : AuditResult
        The audit.
    family : str
        Key of `comparisons.audit_suite.FAMILIES`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    UnknownName
        If the audit has not run this family.
    """
    if family not in result.audit.families:
        raise UnknownName("family", family, result.audit.families)
    figure, axes, styles = _frame(result)
    axes.set_xscale("log")
    axes.set_xlim(FLOOR / 3.0, LARGEST * 3.0)
    gaps = result.gaps
    for label, style, case, y in _places(result, styles):
        served = case.family(family)
        here = (gaps["solver"] == label) & (gaps["function"] == case.function)
        here &= (gaps["dimension"] == case.dimension) & (gaps["family"] == served)
        values = np.clip(gaps.loc[here, "gap"].to_numpy(dtype=float), FLOOR, LARGEST)
        if values.size:
            low, middle, high = (float(quantile(values, q)) for q in (0.25, 0.5, 0.75))
            _mark(axes, y, middle, low, high, style)
    axes.set_xlabel(f"gap to the minimum: median and quartiles of {len(result.audit.seeds)} seeds")
    axes.set_title(f"{family}: {FAMILIES[family]}", pad=_legend(axes, styles))
    return figure


@styled
def bias_figure(result: AuditResult, bias: str) -> Figure:
    """Log ratios of one bias: medians with their 95 % intervals, for every solver and function.

    The grey band is one power of ten to either side: an interval wholly outside it favours that side.

    Parameters
    ----------
    result : AuditResult
        The audit.
    bias : str
        Key of `comparisons.audit_suite.BIASES`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    UnknownName
        If the audit has not measured this bias.
    """
    if bias not in result.audit.biases:
        raise UnknownName("bias", bias, result.audit.biases)
    figure, axes, styles = _frame(result)
    axes.axvspan(-DECADES, DECADES, color="#e8e8e8", zorder=0)
    axes.axvline(0.0, color="#444444", linewidth=0.8, zorder=1)
    table = result.bias()
    table = table[table["bias"] == bias].set_index(["solver", "function", "dimension"])
    for label, style, case, y in _places(result, styles):
        if (label, case.function, case.dimension) not in table.index:
            continue
        row: Any = table.loc[(label, case.function, case.dimension)]
        _mark(axes, y, row["median"], row["low"], row["high"], style)
    reach = np.nanmax(np.abs(table[["median", "low", "high"]].to_numpy(dtype=float)), initial=2.0)
    axes.set_xlim(-1.05 * min(reach, 20.0), 1.05 * min(reach, 20.0))
    spec = BIASES[bias]
    sides = list(spec.sides) + ["the other"] * (2 - len(spec.sides))
    axes.set_xlabel(
        f"← favours {sides[1]}     log10 (gap {spec.other} / gap {spec.favoured})     favours {sides[0]} →"
    )
    axes.set_title(f"{bias}: {spec.other} against {spec.favoured}", pad=_legend(axes, styles))
    return figure


def _frame(result: AuditResult) -> tuple[Figure, Axes, dict[str, Style]]:
    styles = solver_styles(result.audit.study())
    cases = result.audit.cases
    each = max(0.3, 0.085 * len(styles))
    figure = Figure(figsize=(WIDTH, 1.6 + each * len(cases)), layout="constrained")
    axes = figure.add_subplot()
    axes.set_yticks(range(len(cases)), [case.label for case in cases])
    axes.set_ylim(len(cases) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    for y in range(0, len(cases), 2):  # stripes lead the eye from a marker to its function
        axes.axhspan(y - 0.5, y + 0.5, color="#f7f7f7", zorder=-1)
    return figure, axes, styles


def _places(result: AuditResult, styles: dict[str, Style]) -> list[tuple[str, Style, Case, float]]:
    """Every solver and function with its height, solvers of a function beside each other."""
    heights = np.linspace(-0.34, 0.34, len(styles)) if len(styles) > 1 else np.zeros(1)
    return [
        (label, style, case, row + float(height))
        for row, case in enumerate(result.audit.cases)
        for height, (label, style) in zip(heights, styles.items(), strict=True)
    ]


def _mark(axes: Axes, y: float, middle: float, low: float, high: float, style: Style) -> None:
    if not pd.isna(low):
        axes.plot([low, high], [y, y], color=style.colour, linewidth=1.4, solid_capstyle="butt", zorder=3)
    axes.plot(
        [middle], [y], marker=style.marker, color=style.colour, markersize=4.2, linestyle="none", zorder=4
    )


def _legend(axes: Axes, styles: dict[str, Style]) -> float:
    """Name the solvers above the axes; return the room that takes, in points."""
    for label, style in styles.items():
        axes.plot([], [], marker=style.marker, color=style.colour, linewidth=1.4, label=label)
    columns = 3 if max(map(len, styles)) > 16 else 5
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, fontsize=8.5, borderaxespad=0.2,
        handlelength=1.6, columnspacing=1.4,
    )  # fmt: skip
    return 8.0 + 14.0 * -(-len(styles) // columns)
