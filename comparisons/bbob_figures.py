"""Figures of a BBOB benchmark: distributions of runtimes, of all functions and of each group."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from comparisons.bbob_functions import GROUPS
from comparisons.bbob_measures import TARGETS, ecdf
from comparisons.drawing import solver_styles, styled
from navopt.errors import UnknownName

if TYPE_CHECKING:
    from comparisons.bbob import BenchmarkResult

__all__ = ["runtime_figure"]

#: Points at which a curve is evaluated.
POINTS = 240
#: Markers along each curve; they tell lines apart where colours do not.
MARKED = 5


@styled
def runtime_figure(result: BenchmarkResult, dimension: int) -> Figure:
    """Share of all pairs of a run and a target reached, against evaluations per variable.

    The first panel holds all functions, the others one group each. Curves begin at one evaluation per
    variable and end at the budget; the axis of shares ends above the highest of them.

    Parameters
    ----------
    result : BenchmarkResult
        The benchmark.
    dimension : int
        Number of variables.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    UnknownName
        If the benchmark has not run this dimension.
    """
    benchmark = result.benchmark
    if dimension not in benchmark.dimensions:
        raise UnknownName("dimension", str(dimension), map(str, benchmark.dimensions))
    styles = solver_styles(benchmark.study())
    table = result.shares[result.shares["dimension"] == dimension]
    places = {"all functions": benchmark.functions}
    for name, numbers in GROUPS.items():
        found = tuple(number for number in numbers if number in benchmark.functions)
        # one group alone is the first panel already
        if found and found != benchmark.functions:
            places[name] = found
    columns = min(3, len(places))
    rows = -(-len(places) // columns)
    figure = Figure(figsize=(max(3.1 * columns, 6.2), 0.9 + 2.55 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    at = np.geomspace(min(1.0, benchmark.budget_factor / 10.0), benchmark.budget_factor, POINTS)
    top = 0.0
    for panel, (title, functions) in zip(panels, places.items(), strict=False):
        for k, solver in enumerate(table["solver"]):
            runtimes = result.runtimes(dimension, solver, functions)
            if not runtimes.size:
                continue
            style, shares = styles[solver], ecdf(runtimes, at)
            top = max(top, float(shares[-1]))
            first = k * (POINTS // MARKED) // len(table)
            panel.plot(
                at, shares, color=style.colour, linestyle=style.line, marker=style.marker,
                markevery=(first, POINTS // MARKED), markersize=3.6, linewidth=1.3, label=solver,
                clip_on=False,
            )  # fmt: skip
        _frame(panel, title, functions)
    panels[0].set_xlim(float(at[0]), benchmark.budget_factor)
    panels[0].set_ylim(0.0, min(1.0, np.ceil(10.0 * top + 0.2) / 10.0))
    for panel in panels[len(places) :]:
        panel.set_visible(False)
    for row in range(rows):
        panels[row * columns].set_ylabel("share of targets")
    figure.supxlabel("evaluations / number of variables", fontsize=9.5)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper left", ncols=2 * columns, fontsize=8.5, handlelength=2.4,
        columnspacing=1.4,
        title=f"{dimension} variables, {len(TARGETS)} targets from $10^{{2}}$ to $10^{{-8}}$; best first at "
        f"{benchmark.budget_factor} evaluations per variable",
        alignment="left",
    )  # fmt: skip
    return figure


def _frame(panel: Axes, title: str, functions: Sequence[int]) -> None:
    panel.set_xscale("log")
    panel.set_title(title, fontsize=8.5)
    ends = f"f{functions[0]}–f{functions[-1]}" if len(functions) > 1 else f"f{functions[0]}"
    panel.set_title(ends, fontsize=8.0, loc="right", fontweight="normal", color="#555555")
