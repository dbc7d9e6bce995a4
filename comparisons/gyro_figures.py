"""Pictures of a phased gyro calibration: the runs of each phase, and how the indicator falls."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from comparisons.drawing import COLOURS, LINES, styled
from comparisons.gyro_table import PRINTED_TABLE_3, paper_factor
from navopt.algorithms.phased_fit import PhasedFit

__all__ = ["convergence_figure", "identification_figure"]


@styled
def identification_figure(fit: PhasedFit, group: str) -> Figure:
    """Result of every run for each parameter of a group, with our preset and mean: Figures 1 to 3.

    Parameters
    ----------
    fit : PhasedFit
        From `comparisons.gyro_paper.identify`.
    group : str
        Label of the group: ``scale``, ``bias`` or ``misalignment``.

    Returns
    -------
    matplotlib.figure.Figure
        One panel per parameter, in the paper's order and units, as differences from the preset. The grey band
        is the printed standard deviation about the printed mean.
    """
    rows = [row for row in PRINTED_TABLE_3 if row.parameter.startswith(group)]
    columns = 1 if len(rows) <= 3 else 2
    height = 1.7 * ((len(rows) + columns - 1) // columns) + 0.4
    figure = Figure(figsize=(8.4, height), layout="constrained")
    panels = figure.subplots(-(-len(rows) // columns), columns, sharex=True, squeeze=False).ravel()
    for axes, row in zip(panels, rows, strict=True):
        angle = row.unit == "rad"
        shown = 1e6 if angle else 1.0  # microradians
        k, factor = fit.parameters.index(row.parameter), shown * paper_factor(row.parameter)
        phase, preset = fit.phase_of(row.parameter), fit.presets[k]
        found = factor * (fit.runs[phase, :, k] - preset)
        runs = np.arange(1, len(found) + 1)
        axes.axhspan(
            shown * (row.identified - row.preset - row.sd),
            shown * (row.identified - row.preset + row.sd),
            color="#bbbbbb",
            alpha=0.6,
            linewidth=0,
            label="printed mean ± SD",
        )
        axes.axhline(0.0, color="#333333", linewidth=1.0, linestyle=(0, (4, 3)), label="preset")
        axes.plot(runs, found, color=COLOURS[0], linewidth=0.9, label="runs")
        mean = factor * (fit.mean[phase, k] - preset)
        axes.axhline(mean, color=COLOURS[1], linewidth=1.4, label="mean")
        axes.set_ylabel(f"{_tex(row.symbol)} − preset\n({'µrad' if angle else row.unit})")
    for axes in panels[-columns:]:
        axes.set_xlabel("run")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


def _tex(symbol: str) -> str:
    head, _, tail = symbol.partition("_")
    letter = r"\omega" if head == "ω" else head
    return f"${letter}_{{{tail}}}$"


@styled
def convergence_figure(curves: Mapping[str, pd.DataFrame], *, plateau: float | None = None) -> Figure:
    """Indicator of each swarm against iterations and against evaluations: Figure 4 twice.

    Parameters
    ----------
    curves : mapping of str to pandas.DataFrame
        From `comparisons.gyro_paper.convergence`, by the title of a row of panels.
    plateau : float, optional
        Printed plateau of the standard swarm, (°/h)², as a line.

    Returns
    -------
    matplotlib.figure.Figure
        Median and quartiles over the runs of the best fish of the current swarm.
    """
    figure = Figure(figsize=(9.0, 3.2 * len(curves) + 0.4), layout="constrained")
    rows = figure.subplots(len(curves), 2, squeeze=False, sharex="col")
    for row, (title, table) in zip(rows, curves.items(), strict=True):
        for k, (name, own) in enumerate(table.groupby("swarm", sort=False)):
            for axes, column in zip(row, ("cycle", "evaluations"), strict=True):
                low, high = own["current_25"], own["current_75"]
                axes.fill_between(own[column], low, high, color=COLOURS[k], alpha=0.15, linewidth=0)
                axes.plot(own[column], own["current"], color=COLOURS[k], linestyle=LINES[k], label=str(name))
        for axes in row:
            axes.set_yscale("log")
            if plateau is not None:
                axes.axhline(plateau, color="#333333", linewidth=1.0, linestyle=(0, (1, 2)))
        row[0].set_title(title)
        row[0].set_ylabel("indicator, best fish (°/h)²")
        if plateau is not None:
            row[1].annotate(
                f"printed plateau of SAFSA, {plateau:g}", (0.98, plateau), xytext=(0, 4), ha="right",
                xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=8,
            )  # fmt: skip
    rows[-1][0].set_xlabel("iteration")
    rows[-1][1].set_xlabel("evaluations of one run")
    handles, labels = rows[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure
