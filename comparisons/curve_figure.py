"""Picture of a curve: scores and shares against one number of the scenario."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from comparisons.curves import study_curves
from comparisons.drawing import WIDTH, plain_ticks, solver_styles, styled, wants_log
from comparisons.statistics import success_columns
from comparisons.wording import Display
from navopt.errors import UnknownName

__all__ = ["curve_picture"]

#: With fewer worlds at a place a share is hardly more than 0 or 1, and is not drawn.
FEWEST_WORLDS = 5
#: More places than this have a line without markers.
MOST_MARKERS = 30


@styled
def curve_picture(table: pd.DataFrame, study: Any, *, curve: int = 0) -> Figure:
    """Median of the ranking score with its quartiles along a curve, and the shares below the thresholds.

    Parameters
    ----------
    table : pandas.DataFrame
        From `curve_table`.
    study : Study
        What was compared.
    curve : int, default 0
        Which of `study_curves`.

    Returns
    -------
    matplotlib.figure.Figure
        Beside the score, one panel per threshold of the study, with Wilson intervals; none where places
        have fewer than five worlds.

    Raises
    ------
    UnknownName
        If the study has no such curve.
    """
    known = study_curves(study)
    if not 0 <= curve < len(known):
        raise UnknownName("curve", str(curve), [str(k) for k in range(len(known))])
    one, styles, display = known[curve], solver_styles(study), Display.of(study)
    factor, title = one.axis
    here = table[(table["curve"] == curve) & (table["runs"] > 0)]
    enough = len(here) > 0 and int(here["worlds"].min()) >= FEWEST_WORLDS
    thresholds = [label for label, _, _ in success_columns(study)] if enough else []
    figure = Figure(figsize=(WIDTH, 4.0 if thresholds else 4.4), layout="constrained")
    panels = figure.subplots(1, 1 + len(thresholds), squeeze=False)[0]
    marked = len(one.values) <= MOST_MARKERS
    for entry in study.solvers:
        own = here[here["solver"] == entry.label].sort_values("value")
        if not len(own):
            continue
        style, x = styles[entry.label], own["value"].to_numpy() * factor
        line = {
            "color": style.colour,
            "linestyle": style.line,
            "marker": style.marker if marked else "",
            "markersize": 4.5,
            "markeredgecolor": "white",
            "markeredgewidth": 0.5,
            "linewidth": 1.6 if marked else 1.1,
        }
        low, middle, high = (
            _finite(own[name].to_numpy() * display.scale) for name in ("q25", "median", "q75")
        )
        if enough:
            panels[0].fill_between(x, low, high, color=style.colour, alpha=0.13, linewidth=0)
        panels[0].plot(x, middle, label=entry.label, **line)
        for panel, label in zip(panels[1:], thresholds, strict=True):
            ends = 100 * own[f"p_low[{label}]"], 100 * own[f"p_high[{label}]"]
            panel.fill_between(x, *ends, color=style.colour, alpha=0.08, linewidth=0)
            panel.plot(x, 100 * own[f"p[{label}]"], **line)
    _score_axis(panels[0], here["median"].to_numpy() * display.scale)
    panels[0].set_ylabel(display.title)
    for panel, label in zip(panels[1:], thresholds, strict=True):
        panel.set_ylim(-3, 103)
        panel.set_ylabel(f"share {label} (%)")
    for panel in panels:
        panel.set_xlabel(title)
    if one.label:
        panels[0].set_title(one.label)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _finite(values: np.ndarray) -> np.ndarray:
    """A failure has no place on the axis: the line is broken there."""
    return np.where(np.isfinite(values), values, np.nan)


def _score_axis(axes: Axes, medians: np.ndarray) -> None:
    drawn = medians[np.isfinite(medians)]
    if wants_log(drawn):
        low, high = float(drawn.min()) / 1.3, float(drawn.max()) * 1.3
        axes.set_yscale("log")
        axes.set_ylim(low, high)
        plain_ticks(axes.yaxis, low, high)
    elif drawn.size and drawn.min() >= 0:
        axes.set_ylim(bottom=0)
