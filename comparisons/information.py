"""How well a position can be known along a voyage: the bounds of matching, in numbers and as a picture."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from comparisons.drawing import COLOURS, LINES, UNAIDED, plain_ticks, styled
from comparisons.map_figure import PALE
from navopt.data.tracks import MeasuredTrack
from navopt.errors import NoBound
from navopt.models.track_errors import track_error_basis
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gravity_window import track_error_bound, window_error_bound

__all__ = ["information_along", "information_picture"]

#: Columns of the table that are drawn, and what they are called.
SHOWN = {
    "ins_m": "INS alone",
    "window_m": "window of the last samples",
    "track_m": "all samples since departure",
}
#: Limits of the colours, km.
LEAST, MOST = 0.2, 10.0
#: Bands of the field.
LEVELS = 10


def information_along(problem: Any) -> pd.DataFrame:
    """Posterior Cramér–Rao bounds at every sample of a voyage, if it were matched there and then.

    Parameters
    ----------
    problem : GravityMatching
        A voyage with its truth, and declared errors of INS and measurements. Of its window only the
        length matters.

    Returns
    -------
    pandas.DataFrame
        One row per sample: ``hours`` since the first, ``latitude, longitude`` (true, rad), and 1σ of the
        position in m, the root of the trace: ``ins_m`` (prior), ``window_m`` (from the last samples and the
        prior; NaN until there are enough), ``track_m`` (from all samples until then).

    Raises
    ------
    NoBound
        If the problem carries no truth or no 1σ of the INS's errors.
    """
    track, sigmas, window = problem.track, problem.ins_errors, problem.window
    if track.true_latitude is None or sigmas is None:
        raise NoBound("the bounds along a voyage need its truth and ins_errors")
    whole = track_error_bound(problem, causal=True)
    covariance = track_error_basis(
        track.time, track.true_latitude, track.true_longitude, sigmas, heading=track.heading
    ).covariance()
    last = np.full(len(track), np.nan)
    for end in range(window, len(track) + 1):
        part = slice(2 * (end - window), 2 * end)
        here = GravityMatching(
            problem.field_map,
            _shortened(track, end),
            position_covariance=covariance[part, part],
            measurement_errors=problem.measurement_errors,
            window=window,
            method=problem.method,
        )
        last[end - 1] = np.sqrt(np.trace(window_error_bound(here)[-1]))
    return pd.DataFrame(
        {
            "hours": (track.time - track.time[0]) / 3600.0,
            "latitude": track.true_latitude,
            "longitude": track.true_longitude,
            "ins_m": np.sqrt(np.diag(covariance).reshape(-1, 2).sum(axis=1)),
            "window_m": last,
            "track_m": np.sqrt(np.trace(whole, axis1=1, axis2=2)),
        }
    )


def _shortened(track: MeasuredTrack, end: int) -> MeasuredTrack:
    """First samples of a track, where its positions are the true ones: the bound's map slopes are there."""
    assert track.true_latitude is not None
    assert track.true_longitude is not None
    return MeasuredTrack(
        time=track.time[:end],
        latitude=track.true_latitude[:end],
        longitude=track.true_longitude[:end],
        measured=track.measured[:end],
        true_latitude=track.true_latitude[:end],
        true_longitude=track.true_longitude[:end],
        heading=None if track.heading is None else track.heading[:end],
    )


@styled
def information_picture(problem: Any, table: pd.DataFrame | None = None) -> Figure:
    """Draw the bounds along a voyage: on the map, for window and whole track, and against time.

    Parameters
    ----------
    problem : GravityMatching
        The voyage.
    table : pandas.DataFrame, optional
        From `information_along`, if at hand.

    Returns
    -------
    matplotlib.figure.Figure
    """
    table = information_along(problem) if table is None else table
    figure = Figure(figsize=(10.0, 6.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 0.95))
    maps = [figure.add_subplot(grid[0, k]) for k in range(2)]
    drawn: Any = None
    for axes, column in zip(maps, ("window_m", "track_m"), strict=True):
        drawn = _on_map(axes, problem, table, column)
        axes.set_title(SHOWN[column], fontsize=9.5, fontweight="normal")
        axes.set_xlabel("longitude (°)")
    maps[0].set_ylabel("latitude (°)")
    bar = figure.colorbar(drawn, ax=maps, location="right", shrink=0.9, label="1σ of the position (km)")
    plain_ticks(bar.ax.yaxis, LEAST, MOST)
    axes = figure.add_subplot(grid[1, :])
    for k, (column, label) in enumerate(SHOWN.items()):
        colour, line = (UNAIDED.colour, UNAIDED.line) if k == 0 else (COLOURS[k - 1], LINES[k - 1])
        axes.plot(table["hours"], table[column] / 1e3, color=colour, linestyle=line, label=label)
    axes.set_yscale("log")
    positive = table[list(SHOWN)].to_numpy()
    positive = positive[positive > 0.0] / 1e3
    low, high = positive.min() / 1.3, positive.max() * 2.2
    axes.set_ylim(low, high)
    plain_ticks(axes.yaxis, low, high)
    axes.set_xlim(0.0, float(table["hours"].max()))
    axes.set_xlabel("hours since departure")
    axes.set_ylabel("1σ of the position (km)")
    axes.legend(loc="upper left", ncols=3)
    return figure


def _on_map(axes: Axes, problem: Any, table: pd.DataFrame, column: str) -> Any:
    """Field in pale colours and contours, the true track in the colour of its bound."""
    picture = problem.illustration()
    latitude, longitude = np.degrees(picture["map_latitude"]), np.degrees(picture["map_longitude"])
    values = np.asarray(picture["map_values"], dtype=float)
    low, high = np.percentile(values[np.isfinite(values)], [1, 99])
    # bands instead of shades: the colours of the track are what is to be read
    levels = np.linspace(low, high, LEVELS)
    axes.contourf(longitude, latitude, values, levels=levels, cmap=PALE, extend="both")
    places = table.dropna(subset=[column])
    shown = axes.scatter(
        np.degrees(places["longitude"]), np.degrees(places["latitude"]), c=places[column] / 1e3, s=26,
        cmap="inferno", norm=LogNorm(LEAST, MOST), edgecolors="white", linewidths=0.3, zorder=5,
    )  # fmt: skip
    for k in range(0, len(table), max(1, round(len(table) / 8))):
        row = table.iloc[k]
        place = float(np.degrees(row["longitude"])), float(np.degrees(row["latitude"]))
        axes.annotate(
            f"{row['hours']:.0f} h",
            place,
            (0, 8),
            textcoords="offset points",
            ha="center",
            fontsize=7.5,
            zorder=6,
        )
    axes.set_aspect(1.0 / np.cos(np.radians(latitude.mean())))
    axes.locator_params(nbins=5)
    axes.grid(False)
    return shown
