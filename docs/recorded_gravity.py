"""Pictures and tables of `recorded-gravity.md`.

``python docs/recorded_gravity.py errors.csv`` matches all stretches of the study `gravity-recorded` with ten
INS draws each, unless the file is there already, and draws. It needs what the study needs: NAVOPT_DATA, and
the extra `gravity`. Half an hour on one core.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import navopt
from comparisons import Study
from comparisons.drawing import COLOURS, render, styled
from navopt.models.earth import separation

IMAGES = Path(__file__).resolve().parent / "images"
SOLVERS = ("window-map", "track-map")
#: The stretch of which a track is shown.
SHOWN = "index17, row 4348, 24 h"


def last_error(latitude: np.ndarray, longitude: np.ndarray, track: Any) -> np.ndarray:
    """Error (north, east) of the last position, m."""
    away = separation(latitude[-1:], longitude[-1:], track.true_latitude[-1:], track.true_longitude[-1:])
    return np.array([float(away[0][0]), float(away[1][0])])


def errors(study: Study) -> pd.DataFrame:
    """Errors of the INS and of both methods, their sigma, normalised square and confidence per world."""
    rows = []
    for scenario, settings in study.scenarios.items():
        for world in range(10):
            problem: Any = navopt.simulate(study.problem, world, **settings)
            track = problem.track
            row = {"scenario": scenario, "world": world}
            row["ins"] = float(np.hypot(*last_error(track.latitude, track.longitude, track)))
            for name in SOLVERS:
                found = navopt.solve(problem, name, budget=study.budget, seed=1).estimate
                error = last_error(found.latitude, found.longitude, track)
                row[name] = float(np.hypot(*error))
                row[f"{name} sigma"] = found.sigma_m
                row[f"{name} nees"] = float(error @ np.linalg.solve(found.covariance[-1], error))
                row[f"{name} knows"] = found.knows
            rows.append(row)
        print(scenario, flush=True)
    return pd.DataFrame(rows)


def with_groups(table: pd.DataFrame) -> pd.DataFrame:
    """Add the stretch, whether it is weak, and the hours (10, 16, or 24 for the end of the stretch)."""
    hours = table["scenario"].str.extract(r", ([\d.]+) h$")[0].astype(float)
    return table.assign(
        stretch=table["scenario"].str.replace(r", [\d.]+ h$", "", regex=True),
        weak=table["scenario"].str.contains("weak"),
        hours=np.where(hours > 20.0, 24, hours).astype(int),
    )


def summary(table: pd.DataFrame) -> str:
    """Tables of the page."""
    lines = [
        "| after | INS alone, mean | `window-map`, median | `track-map`: median | mean | 95 % | largest |",
        "|---|---|---|---|---|---|---|",
    ]
    for hours, here in table[~table["weak"]].groupby("hours"):
        own = here["track-map"] / 1e3
        lines.append(
            f"| {hours} h | {here['ins'].mean() / 1e3:.0f} km | {here['window-map'].median() / 1e3:.1f} km "
            f"| {own.median():.2f} km | {own.mean():.2f} km | {own.quantile(0.95):.1f} km "
            f"| {own.max():.1f} km |"
        )
    lines += [
        "",
        "| after | passes the gate | 90 % of these within | largest of these |",
        "|---|---|---|---|",
    ]
    for hours, here in table.groupby("hours"):
        sure = here[here["track-map knows"]]["track-map"] / 1e3
        lines.append(
            f"| {hours} h | {len(sure)} of {len(here)} | {sure.quantile(0.9):.1f} km | {sure.max():.1f} km |"
        )
    lines += ["", "| stretch | 10 h | 16 h | 24 h |", "|---|---|---|---|"]
    medians = table.groupby(["stretch", "hours"], sort=False)["track-map nees"].median().unstack()
    for stretch, row in medians.iterrows():
        lines.append(f"| {stretch} | " + " | ".join(f"{value:.1f}" for value in row) + " |")
    return "\n".join(lines)


@styled
def error_picture(table: pd.DataFrame) -> Figure:
    """Errors of INS, window and track for each stretch at its end, and the sigma that `track-map` reports."""
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    axes = figure.subplots()
    late = table[table["hours"] == 24]
    stretches = list(dict.fromkeys(late["stretch"]))
    shown = (("ins", "INS alone", "o"), ("window-map", "window-map", "s"), ("track-map", "track-map", "^"))
    for k, (column, label, marker) in enumerate(shown):
        place = late["stretch"].map(stretches.index) + 0.2 * (k - 1)
        axes.plot(place, late[column] / 1e3, marker, ms=4, alpha=0.7, color=COLOURS[k], label=label)
    sigma = late.groupby("stretch", sort=False)["track-map sigma"].median().reindex(stretches) / 1e3
    axes.plot(np.arange(len(stretches)) + 0.2, sigma, "_", ms=22, mew=2, color="black", label="its σ, median")
    axes.set_yscale("log")
    axes.set_ylabel("error after a day, km")
    axes.set_xticks(
        range(len(stretches)), [name.replace(", ", "\n").replace(" (", "\n(") for name in stretches]
    )
    axes.legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.12), frameon=False)
    return figure


@styled
def track_picture(study: Study) -> Figure:
    """True, inertial and matched track of one world on the map, and its errors against time."""
    problem: Any = navopt.simulate(study.problem, 0, **study.scenarios[SHOWN])
    found = navopt.solve(problem, "track-map", budget=study.budget, seed=1).estimate
    track, field = problem.track, problem.field_map
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    chart, errors_along = figure.subplots(2, 1, height_ratios=(2, 3))
    lines = (
        ("recorded", track.true_latitude, track.true_longitude, "black", "-"),
        ("INS", track.latitude, track.longitude, COLOURS[1], "--"),
        ("track-map", found.track_latitude, found.track_longitude, COLOURS[0], "-"),
    )
    latitudes, longitudes = (np.degrees(np.concatenate([line[k] for line in lines])) for k in (1, 2))
    rows = np.degrees(field.latitude)
    columns = np.degrees(field.longitude)
    keep = (
        (rows > latitudes.min() - 0.3) & (rows < latitudes.max() + 0.3),
        (columns > longitudes.min() - 0.3) & (columns < longitudes.max() + 0.3),
    )
    mesh = chart.pcolormesh(
        columns[keep[1]],
        rows[keep[0]],
        field.values[np.ix_(*keep)],
        cmap="RdBu_r",
        alpha=0.7,
        rasterized=True,
    )
    figure.colorbar(mesh, ax=chart, label="gravity anomaly, mGal")
    for label, latitude, longitude, colour, style in lines:
        chart.plot(np.degrees(longitude), np.degrees(latitude), style, color=colour, label=label)
    chart.set_aspect(1.0 / np.cos(np.radians(latitudes.mean())))
    chart.set_xlabel("longitude, °")
    chart.set_ylabel("latitude, °")
    chart.legend(loc="lower right", frameon=True)
    hours = track.time / 3600.0
    truth = track.true_latitude, track.true_longitude
    for label, latitude, longitude, colour, style in lines[1:]:
        error = np.hypot(*separation(latitude, longitude, *truth)) / 1e3
        errors_along.plot(hours, error, style, color=colour, label=label)
    sigma = np.sqrt(np.trace(found.track_covariance, axis1=1, axis2=2)) / 1e3
    errors_along.plot(hours, sigma, ":", color=COLOURS[0], label="σ of track-map")
    errors_along.set_yscale("log")
    errors_along.set_xlabel("hours since departure")
    errors_along.set_ylabel("position error, km")
    errors_along.legend(loc="best")
    return figure


def main(path: str) -> None:
    """Match what is not matched yet, print the tables and write the pictures."""
    study = Study.named("gravity-recorded")
    if not Path(path).exists():
        errors(study).to_csv(path, index=False)
    table = with_groups(pd.read_csv(path))
    print(summary(table))
    for name, figure in (("errors", error_picture(table)), ("track", track_picture(study))):
        (IMAGES / f"recorded-{name}.png").write_bytes(render(figure, format="png", dpi=80))


if __name__ == "__main__":
    main(sys.argv[1])
