"""Convergence: the best loss so far against cost, over the worlds and seeds of a scenario."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from comparisons.drawing import WIDTH, plain_ticks, solver_styles, styled, wants_log
from comparisons.measures import quantile
from comparisons.statistics import FAILURES, opened
from comparisons.wording import format_number

__all__ = ["GAP_FLOOR", "best_so_far", "convergence", "convergence_bands", "known_minimum"]

#: Ratio of largest to smallest loss from which its axis is logarithmic: the last improvements matter.
LOGARITHMIC_LOSS = 8.0
#: Losses nearer to a known minimum than this are drawn here: double precision has no more to say.
GAP_FLOOR = 1e-16
GRID_POINTS = 240


def best_so_far(trace: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Best loss reached at each cost: a step function, held after the last row.

    Parameters
    ----------
    trace : structured ndarray (cost, loss, elapsed_s)
        Trace of a run.
    grid : ndarray, shape (n,)
        Costs.

    Returns
    -------
    ndarray, shape (n,)
        Losses; ``+inf`` before the first evaluation, so that a baseline begins at its own cost.
    """
    if not len(trace):
        return np.full(len(grid), np.inf)
    order = np.argsort(trace["cost"], kind="stable")
    best = np.minimum.accumulate(np.where(np.isnan(trace["loss"]), np.inf, trace["loss"])[order])
    position = np.searchsorted(trace["cost"][order], grid, side="right") - 1
    return np.where(position >= 0, best[np.maximum(position, 0)], np.inf)


def known_minimum(runs: pd.DataFrame) -> float | None:
    """Smallest possible loss in the runs of one scenario, from runs that score ``gap_1`` above it.

    Parameters
    ----------
    runs : pandas.DataFrame
        Runs of a scenario.

    Returns
    -------
    float or None
        None where it is not known, or not the same in all worlds.
    """
    if not len(runs) or "score.gap_1" not in runs:
        return None
    gaps = runs["score.gap_1"].to_numpy(dtype=float)
    minima = runs["loss"].to_numpy(dtype=float) - gaps
    if not len(gaps) or not np.isfinite(minima).all() or np.ptp(minima) > 1e-9 * (1 + np.abs(gaps).max()):
        return None
    return float(minima[np.argmin(np.abs(gaps))])  # the smallest gap has the smallest rounding error


def convergence_bands(
    store: Any,
    *,
    scenario: str,
    grid: np.ndarray | None = None,
    runs: pd.DataFrame | None = None,
    traces: dict[str, np.ndarray] | None = None,
) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, float], bool]:
    """Quartiles of the best loss so far over worlds and solver seeds, for every solver.

    Parameters
    ----------
    store : ResultsStore
        Results of the study.
    scenario : str
        Label of the scenario.
    grid : ndarray, shape (n,), optional
        Costs; spaced evenly on a logarithmic axis if not given.
    runs, traces : optional
        ``store.runs()`` and ``store.traces()``, if at hand.

    Returns
    -------
    grid : ndarray, shape (n,)
        Costs.
    bands : dict of str to ndarray, shape (3, n)
        Lower quartile, median and upper quartile of the loss; of its distance from the minimum, at least
        `GAP_FLOOR`, where that is known. A run that failed counts as having reached nothing.
    ends : dict of str to float
        Cost at which the median run stops spending.
    above_minimum : bool
        Whether the minimum is known.

    Raises
    ------
    UnknownName
        If the study has no such scenario.
    """
    runs, study = opened(store if runs is None else runs, store.study, scenario)
    traces = store.traces() if traces is None else traces
    here = runs[runs["scenario"] == scenario] if len(runs) else runs
    usable = here[~here["status"].isin(FAILURES)] if len(here) else here
    if grid is None:
        last = max(
            [study.budget, *(int(traces[k]["cost"].max()) for k in usable.get("key", []) if k in traces)]
        )
        grid = np.unique(np.round(np.geomspace(1, max(last, 2), GRID_POINTS)))
    minimum = known_minimum(usable)
    bands: dict[str, np.ndarray] = {}
    ends: dict[str, float] = {}
    empty = np.zeros(0, dtype=[("cost", float), ("loss", float)])
    good = set(usable["key"]) if len(usable) else set()
    for label in (entry.label for entry in study.solvers):
        own = here[here["solver"] == label] if len(here) else here
        if not len(own):
            continue
        kept = [traces.get(key, empty) if key in good else empty for key in own["key"]]
        curves = np.array([best_so_far(trace, grid) for trace in kept])
        if minimum is not None:
            curves = np.maximum(curves - minimum, GAP_FLOOR)
        bands[label] = np.array([quantile(curves, q) for q in (0.25, 0.5, 0.75)])
        ends[label] = quantile([trace["cost"].max() if len(trace) else np.inf for trace in kept], 0.5)
    return grid, bands, ends, minimum is not None


@styled
def convergence(
    store: Any,
    *,
    scenario: str,
    runs: pd.DataFrame | None = None,
    traces: dict[str, np.ndarray] | None = None,
) -> Figure:
    """Best loss so far against cost: median line and quartile band over worlds and solver seeds.

    Where the minimum is known the distance from it is shown, on a logarithmic axis. A run that failed
    counts as having reached nothing. The last marker of a line is where the median run stops spending;
    from there it goes on thin as the value held.

    Parameters
    ----------
    store : ResultsStore
        Results of the study.
    scenario : str
        Label of the scenario.
    runs, traces : optional
        ``store.runs()`` and ``store.traces()``, if at hand.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    UnknownName
        If the study has no such scenario.
    """
    grid, bands, ends, above_minimum = convergence_bands(store, scenario=scenario, runs=runs, traces=traces)
    styles, last = solver_styles(store.study), grid[-1]
    figure = Figure(figsize=(WIDTH, max(4.4, 0.9 + 0.21 * len(styles))), layout="constrained")
    axes = figure.add_subplot()
    # the axis follows the medians: the bands of the first few evaluations would squeeze all the rest
    drawn = np.concatenate([band[:2][np.isfinite(band[:2])] for band in bands.values()] or [np.zeros(0)])
    ceiling = drawn.max() if drawn.size else 1.0
    for place, (label, (lower, median, upper)) in enumerate(bands.items()):
        style = styles[label]
        shown = np.isfinite(median)
        if not shown.any():
            axes.plot(
                [], [], color=style.colour, marker=style.marker, linestyle="none", label=f"{label} (failed)"
            )
            continue
        upper = np.where(np.isfinite(upper), upper, 10 * abs(ceiling) + 1)
        axes.fill_between(
            grid[shown], lower[shown], upper[shown], step="post", color=style.colour, alpha=0.1, linewidth=0
        )
        spending = shown & (grid <= max(ends[label], grid[shown][0]))
        last_spent = int(spending.sum()) - 1
        # markers out of step with one another, and always one at the end
        spaced = range(int(GRID_POINTS / 5 * (place + 1) / (len(bands) + 1)), last_spent, GRID_POINTS // 5)
        axes.plot(
            grid[spending], median[spending], drawstyle="steps-post", color=style.colour,
            linestyle=style.line, linewidth=1.7, label=label, zorder=4, marker=style.marker,
            markevery=[*spaced, last_spent], markersize=6, markeredgecolor="white",
        )  # fmt: skip
        held = shown & (grid >= grid[spending][-1])
        axes.plot(
            grid[held], median[held], drawstyle="steps-post", color=style.colour, linewidth=0.9, linestyle=":"
        )
    axes.set_xscale("log")
    axes.set_xlim(1, max(last, 2) * 1.15)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: format_number(value, digits=1)))
    logarithmic = wants_log(drawn, LOGARITHMIC_LOSS)
    if drawn.size:
        margin = 1.25 if logarithmic else 0.06 * float(np.ptp(drawn)) or 1.0
        low, high = float(drawn.min()), float(drawn.max())
        axes.set_ylim((low / margin, high * margin) if logarithmic else (low - margin, high + margin))
    if logarithmic:
        axes.set_yscale("log")
        plain_ticks(axes.yaxis, low, high)
    axes.set_xlabel("cost (model evaluations)")
    axes.set_ylabel("best loss so far, above the minimum" if above_minimum else "best loss so far")
    axes.set_title(scenario)
    if bands:
        figure.legend(loc="outside right upper")
    return figure
