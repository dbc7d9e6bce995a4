"""Picture of the ranks over all scenarios of a study."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from comparisons.drawing import WIDTH, solver_styles, styled
from comparisons.overall import OverallRanks

__all__ = ["rank_picture"]


@styled
def rank_picture(overall: OverallRanks, study: Any) -> Figure:
    """Mean ranks over a group of scenarios, best on top, each with half the critical difference either side.

    Two solvers whose bars do not overlap differ significantly by Nemenyi's test; the band is the reach of
    the best. Small dots are the ranks in each scenario.

    Parameters
    ----------
    overall : OverallRanks
        Ranks over a group of scenarios.
    study : Study
        What was compared.

    Returns
    -------
    matplotlib.figure.Figure
    """
    styles, half = solver_styles(study), overall.critical_difference / 2
    solvers = len(overall.mean)
    figure = Figure(figsize=(WIDTH, 1.5 + 0.3 * solvers), layout="constrained")
    axes = figure.add_subplot()
    best = float(overall.mean.iloc[0])
    axes.axvspan(best - half, best + half, color="#eeeeee", zorder=0)
    for y, (label, mean) in enumerate(overall.mean.items()):
        colour = styles[str(label)].colour
        axes.plot([mean - half, mean + half], [y, y], color=colour, linewidth=1.6, zorder=3)
        axes.plot(mean, y, "o", color=colour, markersize=7, markeredgecolor="white", zorder=4)
        ranks = np.sort(overall.ranks.loc[label].to_numpy())
        offset = np.resize([0.16, -0.16, 0.26, -0.26], ranks.size)
        axes.plot(
            ranks, y + offset, "o", color=colour, markersize=2.6, alpha=0.6, markeredgewidth=0, zorder=2
        )
    axes.set_yticks(range(solvers), [f"{label}  {mean:.1f}" for label, mean in overall.mean.items()])
    axes.set_ylim(solvers - 0.4, -0.6)
    axes.set_xlim(
        min(1 - 0.02 * solvers, best - half), max(solvers, float(overall.mean.iloc[-1]) + half) + 0.2
    )
    axes.set_xticks(range(1, solvers + 1, 1 if solvers < 13 else 2))  # a rank is never 0, a bar may be
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(f"mean rank over {overall.ranks.shape[1]} scenarios")
    axes.set_title(overall.group)
    return figure
