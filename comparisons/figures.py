"""Figures of a study: errors as box plots, convergence, and the map picture of a match.

Every function returns a `matplotlib.figure.Figure` built without pyplot; `render` makes bytes of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from comparisons.convergence import best_so_far, convergence
from comparisons.drawing import WIDTH, Style, plain_ticks, render, solver_styles, styled, wants_log
from comparisons.map_figure import match_map
from comparisons.measures import quantile
from comparisons.statistics import (
    FAILURES,
    REFERENCES,
    opened,
    ranked_table,
    run_scores,
    success_columns,
)
from comparisons.wording import Display

__all__ = ["best_so_far", "convergence", "error_boxes", "map_picture", "match_map", "render", "solver_styles"]


@styled
def error_boxes(
    store_or_runs: Any, study: Any = None, *, scenario: str, table: pd.DataFrame | None = None
) -> Figure:
    """Box plots of the ranking score in one scenario, best solver on top.

    The box holds the quartiles over all runs and the median line; whiskers reach the furthest run
    within 1.5 interquartile ranges; each dot is a world (median over its solver seeds). Failures have no
    place on the axis: they are counted in words beside it, and a quartile among them ends at the edge.

    Parameters
    ----------
    store_or_runs : ResultsStore or pandas.DataFrame
        Results, or their runs.
    study : Study, optional
        What was compared; the store's own if not given.
    scenario : str
        Label of the scenario.
    table : pandas.DataFrame, optional
        The ranked table, if at hand.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    UnknownName
        If the study has no such scenario.
    """
    runs, study = opened(store_or_runs, study, scenario)
    display, styles = Display.of(study), solver_styles(study)
    table = ranked_table(runs, study) if table is None else table
    table = table[table["scenario"] == scenario]
    here = runs[runs["scenario"] == scenario] if len(runs) else runs
    scores = run_scores(here, study.rank_by) * display.scale if len(here) else pd.Series(dtype=float)
    figure = Figure(figsize=(WIDTH, 1.5 + 0.42 * len(table)), layout="constrained")
    axes = figure.add_subplot()
    finite = scores[np.isfinite(scores)].to_numpy()
    logarithmic = wants_log(finite)
    if logarithmic:
        axes.set_xscale("log")
    low, high = _limits(finite, logarithmic)
    axes.set_xlim(low, high)
    for y, row in enumerate(table.itertuples(index=False)):
        own = scores[here["solver"] == row.solver] if len(here) else scores
        _box(axes, y, own.to_numpy(), styles[row.solver], low, high)
        worlds = (
            own.groupby(here.loc[own.index, "world"]).agg(lambda v: quantile(v, 0.5)) if len(own) else own
        )
        _dots(axes, y, worlds.to_numpy(), styles[row.solver])
        if row.failures:
            axes.text(
                1.01,
                y,
                f"{row.failures} of {row.runs} failed",
                transform=axes.get_yaxis_transform(),
                va="center",
            )
        elif not row.runs:
            axes.text(1.01, y, "no runs", transform=axes.get_yaxis_transform(), va="center")
    labels = [
        r.solver if pd.isna(r.rank) else f"{r.solver}  {r.rank}"
        for r in table[["solver", "rank"]].itertuples(index=False)
    ]
    axes.set_yticks(range(len(table)), labels)
    axes.set_ylim(len(table) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(display.title)
    if logarithmic:
        plain_ticks(axes.xaxis, low, high)
    levels = _thresholds(axes, study, display, low, high, logarithmic)
    axes.set_title(scenario, pad=6 + 13 * levels)
    return figure


def _limits(values: np.ndarray, logarithmic: bool) -> tuple[float, float]:
    if not values.size:
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    if logarithmic:
        margin = (high / low) ** 0.04
        return low / margin, high * margin
    if low >= 0:  # an error is read from zero
        return 0.0, 1.05 * high if high > 0 else 1.0
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin


def _box(axes: Axes, y: float, values: np.ndarray, style: Style, low: float, high: float) -> None:
    if not values.size or not np.isfinite(values).any():
        return
    q25, median, q75 = (quantile(values, q) for q in (0.25, 0.5, 0.75))
    left, right = min(q25, high), min(q75, high)
    axes.barh(y, right - left, 0.56, left, facecolor=style.colour, alpha=0.22, edgecolor="none", label="_box")
    axes.barh(y, right - left, 0.56, left, facecolor="none", edgecolor=style.colour, linewidth=1.2)
    if np.isfinite(median):
        axes.plot([median, median], [y - 0.28, y + 0.28], color=style.colour, linewidth=2.6, zorder=4)
    reach = 1.5 * (q75 - q25) if np.isfinite(q75) else np.inf
    inside = values[np.isfinite(values) & (values >= q25 - reach) & (values <= q75 + reach)]
    if inside.size:
        for start, end in ((inside.min(), left), (right, inside.max())):
            if end > start:
                axes.plot([start, end], [y, y], color=style.colour, linewidth=1.2, zorder=2)


def _dots(axes: Axes, y: float, values: np.ndarray, style: Style) -> None:
    values = np.sort(values[np.isfinite(values)])
    # a fixed zigzag keeps equal values apart without a random number
    offset = np.resize([0.0, 0.14, -0.14, 0.07, -0.07], values.size)
    axes.plot(
        values, y + offset, linestyle="none", marker="o", markersize=3.4, color=style.colour,
        markeredgecolor="white", markeredgewidth=0.4, zorder=3,
    )  # fmt: skip


def _thresholds(axes: Axes, study: Any, display: Display, low: float, high: float, logarithmic: bool) -> int:
    """Draw the thresholds of the ranking score, named above the axes; return the rows of names."""
    along = np.log if logarithmic else np.asarray
    ends: list[float] = []  # of the last name in each row, as a share of the axis
    for label, key, below in sorted(success_columns(study), key=lambda item: item[2]):
        x = below * display.scale
        if key != study.rank_by or not low < x < high:
            continue
        place = float((along(x) - along(low)) / (along(high) - along(low)))
        half = 0.0055 * len(label) + 0.01
        row = next((k for k, end in enumerate(ends) if place - half > end), len(ends))
        ends[row : row + 1] = [place + half]
        axes.axvline(x, color="#333333", linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)
        axes.annotate(
            label, (x, 1.0), (0, 3 + 13 * row), xycoords=axes.get_xaxis_transform(),
            textcoords="offset points", ha="center", va="bottom", fontsize=8.5, color="#333333",
        )  # fmt: skip
    return len(ends)


def map_picture(store: Any, *, scenario: str, world: int) -> Figure | None:
    """Map of one illustrated world with the true, inertial and matched tracks.

    Parameters
    ----------
    store : ResultsStore
        Results of the study.
    scenario : str
        Label of the scenario.
    world : int
        Seed of the world.

    Returns
    -------
    matplotlib.figure.Figure or None
        None if the world has no illustration, or one that is not a map with tracks. Each solver shows its
        first seed.
    """
    runs, study = opened(store, None, scenario)
    picture = store.illustration(scenario, world)
    if not {"map_values", "map_latitude", "map_longitude", "ins_latitude", "ins_longitude"} <= set(picture):
        return None
    tracks: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    if len(runs):
        here = runs[
            (runs["scenario"] == scenario) & (runs["world"] == world) & ~runs["status"].isin(FAILURES)
        ]
        # the nominal answer is the inertial track, which is drawn anyway
        for label in (entry.label for entry in study.solvers if entry.name not in REFERENCES):
            own = here[here["solver"] == label].sort_values("seed")
            estimate = store.estimate(own["key"].iloc[0]) if len(own) else {}
            if {"latitude", "longitude"} <= set(estimate):
                tracks[label] = estimate["latitude"], estimate["longitude"]
    return match_map(picture, tracks, styles=solver_styles(study), title=f"{scenario}, world {world}")
