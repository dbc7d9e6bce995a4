"""Pictures and tables of the page "Gravity matching compared", from the results of its studies.

``python docs/gravity_matching_compared.py voyage information results/gravity-paper`` writes the pictures of
each study into ``docs/images`` and prints its tables; the first two arguments stand for pictures that need no
study.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import navopt
from comparisons.curves import curve_table, study_curves
from comparisons.drawing import COLOURS, plain_ticks, render, solver_styles, styled
from comparisons.information import information_along, information_picture
from comparisons.map_figure import match_map
from comparisons.printed import printed_table
from comparisons.statistics import ranked_table, run_scores
from comparisons.store import ResultsStore
from comparisons.wording import format_number
from navopt.models.cruise import InsErrors
from navopt.models.earth import separation
from navopt.models.ins import simulate_ins
from navopt.models.sins_error import segment_heading_error
from navopt.problem import stream
from navopt.problems.gravity_scenario import WorldScenario

IMAGES = Path(__file__).resolve().parent / "images"
NAUTICAL_MILE = 1852.0
SCORE = "position_error_m"
#: Random stream of the one inertial run of all worlds.
WORLD = "world:gravity-matching"
#: Columns of the pictures of properties.
PROPERTIES = ("initial_error_m", "heading_error_deg", "scale_error")


def save(name: str, figure: Figure, dpi: int = 90) -> None:
    """Write a picture of the page."""
    IMAGES.mkdir(exist_ok=True)
    data = render(figure, format="png", dpi=dpi)
    (IMAGES / f"gravity-{name}.png").write_bytes(data)
    print(f"images/gravity-{name}.png: {len(data) / 1000:.0f} kB\n")


# -- Figures 1 and 3: the voyage and its inertial errors -------------------------------------------------
@styled
def voyage() -> Figure:
    """Position error and heading error of the segments of the paper's inertial run."""
    course = WorldScenario(hours=16.0).course
    track = simulate_ins(course, InsErrors.published(), times=course.times(300.0), rng=stream(WORLD, 0))
    hours, error = track.time / 3600.0, track.position_error / 1e3
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, name in enumerate(("north", "east")):
        left.plot(hours, error[:, k], color=COLOURS[k], label=name, linewidth=1.5)
    left.plot(hours, np.hypot(*error.T), color="#444444", label="distance", linewidth=1.2, linestyle=":")
    left.set_ylabel("position error (km)")
    left.legend(loc="upper left")
    turned = np.degrees(segment_heading_error(track.velocity, track.velocity - track.true_velocity))
    right.plot(hours[1:], turned, color=COLOURS[2], linewidth=1.5)
    for limit in (-15.0, 15.0):
        right.axhline(limit, color="#333333", linewidth=1.0, linestyle=(0, (4, 3)))
    right.set_ylabel("heading error of a segment (°)")
    for axes in (left, right):
        axes.set_xlabel("hours since departure")
        axes.set_xlim(0, 16)
    print(f"heading error of the segments: {turned.min():.1f} to {turned.max():.1f} degrees")
    at = {hour: float(np.hypot(*error[round(hour * 12)])) for hour in (3, 7, 16)}
    print(", ".join(f"{hour} h: {value:.2f} km" for hour, value in at.items()))
    return figure


# -- Tables 4 and 5 --------------------------------------------------------------------------------------
def tables_4_and_5(store: Any, runs: pd.DataFrame) -> str:
    """Mean and standard deviation, share within 2′, and whether the fit is better than the truth's."""
    study = store.study
    table = ranked_table(runs, study).set_index(["scenario", "solver"])
    printed = {
        (v["scenario"], v["solver"], v["statistic"]): v["printed"]
        for v in printed_table(runs, study).to_dict("records")
    }
    lines = []
    for scenario in study.scenarios:
        lines += [
            f"| {scenario} | printed, km | mean ± SD, km | median, km | within 2′ | fits better |",
            "|---|---|---|---|---|---|",
        ]
        fits = better_than_truth(study, runs, scenario)
        for entry in study.solvers:
            row = table.loc[scenario, entry.label]
            mean, sd = (printed.get((scenario, entry.label, name)) for name in ("mean", "sd"))
            text = "" if mean is None else f"{mean / 1e3:.2f}" + ("" if sd is None else f" ± {sd / 1e3:.2f}")
            share = printed.get((scenario, entry.label, "share"))
            within = f"{100 * row['p[within 2′]']:.0f} %" + (
                "" if share is None else f" (printed: {100 * share:.0f} %)"
            )
            numbers = f"{_km(row['mean'])} ± {_km(row['sd'])} | {_km(row['median'])}"
            lines.append(f"| `{entry.label}` | {text} | {numbers} | {within} | {fits[entry.label]} |")
        lines.append("")
    return "\n".join(lines)


def better_than_truth(study: Any, runs: pd.DataFrame, scenario: str) -> dict[str, str]:
    """Share of the runs whose loss is lower than that of the true track, the best similarity to it."""
    problem, keywords = study.place(scenario)
    found: dict[str, list[bool]] = {}
    for world in study.worlds:
        one = navopt.simulate(problem, seed=world, **keywords)
        limit = float(one.loss(one.project(one.truth)[None])[0])
        here = runs[(runs["scenario"] == scenario) & (runs["world"] == world)]
        for solver, loss in zip(here["solver"], here["loss"], strict=True):
            found.setdefault(solver, []).append(loss < limit)
    return {solver: f"{100 * np.mean(values):.0f} %" for solver, values in found.items()}


def _km(metres: float) -> str:
    return format_number(metres / 1e3, digits=2 if metres < 1e4 else 3)


# -- Figure 7: the error of each point of the window -----------------------------------------------------
@styled
def points(store: Any, runs: pd.DataFrame, scenarios: Sequence[str]) -> Figure:
    """Mean size of the error in latitude and longitude of every sample of the window."""
    study, styles = store.study, solver_styles(store.study)
    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    panels = figure.subplots(len(scenarios), 2, sharex=True, squeeze=False)
    for row, scenario in zip(panels, scenarios, strict=True):
        truths = {}
        for world in study.worlds:
            problem, keywords = study.place(scenario)
            truths[world] = navopt.simulate(problem, seed=world, **keywords).truth
        for entry in study.solvers:
            own = runs[(runs["scenario"] == scenario) & (runs["solver"] == entry.label)]
            errors = [_point_errors(store.estimate(run.key), truths[run.world]) for run in own.itertuples()]
            mean = np.mean(np.abs(errors), axis=0) / NAUTICAL_MILE
            style = styles[entry.label]
            for k, axes in enumerate(row):
                axes.plot(
                    range(1, len(mean) + 1), mean[:, k], color=style.colour, linestyle=style.line,
                    marker=style.marker, markersize=4, linewidth=1.3, label=entry.label,
                )  # fmt: skip
        for axes, name in zip(row, ("north", "east"), strict=True):
            axes.set_yscale("log")
            plain_ticks(axes.yaxis, *axes.get_ylim())
            axes.set_title(f"{scenario}, {name}", fontsize=9.5)
        row[0].set_ylabel("mean size of the error (′)")
    for axes in panels[-1]:
        axes.set_xlabel("sampling point of the window")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return figure


def _point_errors(estimate: dict[str, np.ndarray], truth: Any) -> np.ndarray:
    """Errors (north, east) in metres of the last samples, shape (window, 2)."""
    n = len(truth.latitude)
    return np.stack(
        separation(estimate["latitude"][-n:], estimate["longitude"][-n:], truth.latitude, truth.longitude),
        axis=1,
    )


# -- Table 6 and Figure 8 --------------------------------------------------------------------------------
def table_6(store: Any, runs: pd.DataFrame) -> str:
    """Mean error in minutes of arc, share within 5′ and time, by period."""
    study = store.study
    printed = {
        (v["scenario"], v["solver"], v["statistic"]): v["printed"]
        for v in printed_table(runs, study).to_dict("records")
    }
    lines = []
    for period, scenarios in study.groups.items():
        lines += [
            f"| {period}, {len(scenarios)} windows | printed | mean error | printed | within 5′ | time |",
            "|---|---|---|---|---|---|",
        ]
        for entry in study.solvers:
            own = runs[runs["scenario"].isin(scenarios) & (runs["solver"] == entry.label)]
            errors = run_scores(own, SCORE).to_numpy() / NAUTICAL_MILE
            mean, share = (printed.get((period, entry.label, name)) for name in ("mean", "share"))
            texts = [
                "" if mean is None else f"{mean / NAUTICAL_MILE:.2f}′",
                f"{errors.mean():.2f}′",
                "" if share is None else f"{100 * share:.0f} %",
                f"{100 * np.mean(errors < 5):.0f} %",
                f"{own['elapsed_s'].mean():.2g} s",
            ]
            lines.append(f"| `{entry.label}` | " + " | ".join(texts) + " |")
        lines.append("")
    return "\n".join(lines)


@styled
def hours(store: Any, runs: pd.DataFrame) -> Figure:
    """Error of the last point against the time at sea: the paper's methods above, ours below."""
    study, styles = store.study, solver_styles(store.study)
    table = curve_table(ranked_table(runs, study), study)
    first = ("INS alone", "improved-abc", "iccp", "affine-abc", "tercom")
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axes, labels in zip(panels, (first, ("INS alone", "window-map", "track-map")), strict=True):
        for label in labels:
            own = table[table["solver"] == label].sort_values("value")
            style = styles[label]
            axes.plot(
                own["value"], own["median"] / NAUTICAL_MILE, color=style.colour, linestyle=style.line,
                linewidth=1.2, label=label,
            )  # fmt: skip
        axes.axhline(5.0, color="#333333", linewidth=1.0, linestyle=(0, (4, 3)))
        axes.set_yscale("log")
        axes.set_ylim(0.02, 250)
        plain_ticks(axes.yaxis, 0.02, 250)
        axes.set_ylabel("error (′)")
        axes.legend(loc="upper left", ncols=5)
    panels[1].set_xlabel("hours since departure")
    panels[1].set_xlim(1, 16)
    return figure


# -- properties ------------------------------------------------------------------------------------------
@styled
def properties(store: Any, runs: pd.DataFrame, place: str) -> Figure:
    """Median error and share within 2′ against errors of position, heading and scale, at one place."""
    study, styles = store.study, solver_styles(store.study)
    curves, table = study_curves(study), curve_table(ranked_table(runs, study), study)
    figure = Figure(figsize=(10.0, 5.4), layout="constrained")
    panels = figure.subplots(2, len(PROPERTIES), sharex="col", sharey="row")
    for column, key in enumerate(PROPERTIES):
        k = next(k for k, curve in enumerate(curves) if (curve.key, curve.label) == (key, place))
        factor, title = curves[k].axis
        for entry in study.solvers:
            own = table[(table["curve"] == k) & (table["solver"] == entry.label)].sort_values("value")
            style, x = styles[entry.label], own["value"] * factor
            line = {"color": style.colour, "linestyle": style.line, "marker": style.marker, "markersize": 4.5}
            median = own["median"].to_numpy() / 1e3
            panels[0, column].plot(x, np.maximum(median, 0.05), label=entry.label, **line)
            panels[1, column].plot(x, 100 * own["p[within 2′]"], **line)
        panels[1, column].set_xlabel(title)
    _logarithmic(panels[0, 0])
    panels[0, 0].set_ylabel("median error (km)")
    panels[1, 0].set_ylabel("within 2′ (%)")
    panels[1, 0].set_ylim(-4, 104)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    return figure


def _logarithmic(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.set_ylim(0.1, 100)
    plain_ticks(axes.yaxis, 0.1, 100)


def property_table(store: Any, runs: pd.DataFrame) -> str:
    """Shares within 2′ along every curve."""
    study = store.study
    table = curve_table(ranked_table(runs, study), study)
    lines = []
    for k, curve in enumerate(study_curves(study)):
        factor, title = curve.axis
        here = table[table["curve"] == k]
        lines.append(
            f"| {title}, {curve.label} | " + " | ".join(f"{v * factor:g}" for v in curve.values) + " |"
        )
        lines.append("|---" * (len(curve.values) + 1) + "|")
        for entry in study.solvers:
            own = here[here["solver"] == entry.label].set_index("value")
            cells = [
                f"{_km(own.loc[v, 'median'])} km, {100 * own.loc[v, 'p[within 2′]']:.0f} %"
                for v in curve.values
            ]
            lines.append(f"| `{entry.label}` | " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


# -- swarms ----------------------------------------------------------------------------------------------
def swarms(store: Any, runs: pd.DataFrame) -> str:
    """One table: all solvers at all times, in the order of the first scenario's medians."""
    study = store.study
    table = ranked_table(runs, study)
    scenarios = list(study.scenarios)
    order = table[table["scenario"] == scenarios[0]]["solver"]
    cells = table.set_index(["scenario", "solver"])
    fits = {scenario: better_than_truth(study, runs, scenario) for scenario in scenarios}
    head = " | ".join(f"{s}: median, km | mean | within 2′ | fits better" for s in scenarios)
    lines = [f"| solver | {head} | cost |", "|---" * (4 * len(scenarios) + 2) + "|"]
    for label in order:
        texts = []
        for scenario in scenarios:
            row = cells.loc[scenario, label]
            texts += [
                _km(row["median"]),
                _km(row["mean"]),
                f"{100 * row['p[within 2′]']:.0f} %",
                fits[scenario][label],
            ]
        cost = format_number(np.mean([cells.loc[scenario, label]["cost"] for scenario in scenarios]))
        lines.append(f"| `{label}` | " + " | ".join(texts) + f" | {cost} |")
    return "\n".join(lines)


def over_bounds(store: Any, runs: pd.DataFrame) -> str:
    """One table: root mean square errors over those of the bounds, in the order of the last scenario."""
    study = store.study
    table = ranked_table(runs, study)
    cells, scenarios = table.set_index(["scenario", "solver"]), list(study.scenarios)
    head = [f"{scenario}: {bound.label}" for scenario in scenarios for bound in study.bound]
    lines = ["| rms error over rms bound | " + " | ".join(head) + " |", "|---" * (len(head) + 1) + "|"]
    least = [cells.loc[scenario].iloc[0] for scenario in scenarios]
    bounds = [_km(row[f"bound[{bound.label}]"]) for row in least for bound in study.bound]
    lines.append("| the bound itself, km | " + " | ".join(bounds) + " |")
    last = [cells.loc[(scenarios[-1], entry.label)] for entry in study.solvers]
    order = np.argsort([row[f"over[{study.bound[-1].label}]"] for row in last], kind="stable")
    for label in (study.solvers[k].label for k in order):
        ratios = [cells.loc[(s, label)][f"over[{bound.label}]"] for s in scenarios for bound in study.bound]
        lines.append(f"| `{label}` | " + " | ".join(f"{ratio:.2f}" for ratio in ratios) + " |")
    return "\n".join([*lines, ""])


def harder(store: Any, runs: pd.DataFrame) -> str:
    """One table: mean error and share within 2 minutes, a row per scenario."""
    study = store.study
    cells = ranked_table(runs, study).set_index(["scenario", "solver"])
    labels = [entry.label for entry in study.solvers]
    lines = ["| 7 h | " + " | ".join(f"`{label}`" for label in labels) + " |"]
    lines.append("|---" * (len(labels) + 1) + "|")
    for scenario in study.scenarios:
        rows = [cells.loc[scenario, label] for label in labels]
        texts = [f"{_km(row['mean'])} km, {100 * row['p[within 2′]']:.0f} %" for row in rows]
        lines.append(f"| {scenario} | " + " | ".join(texts) + " |")
    return "\n".join(lines)


def tracks(store: Any, runs: pd.DataFrame, scenario: str) -> Figure:
    """Figure 6: the tracks of some methods in the first world."""
    world = store.study.worlds[0]
    here = runs[(runs["scenario"] == scenario) & (runs["world"] == world)].set_index("solver")
    found = {}
    for label in ("iccp", "improved-abc", "affine-abc, published", "window-map", "track-map"):
        estimate = store.estimate(here.loc[label, "key"])
        found[label] = estimate["latitude"], estimate["longitude"]
    picture = store.illustration(scenario, world)
    return match_map(picture, found, styles=solver_styles(store.study), title=scenario)


def _paper(store: Any, runs: pd.DataFrame) -> None:
    print(tables_4_and_5(store, runs))
    if "7 h, half the scope" in store.study.scenarios:
        save("points", points(store, runs, ("7 h", "7 h, half the scope")), 80)
        for scenario, name in (("7 h", "match-7h"), ("7 h, half the scope", "match-7h-half")):
            save(name, tracks(store, runs, scenario), 68)


def _hours(store: Any, runs: pd.DataFrame) -> None:
    print(table_6(store, runs))
    save("hours", hours(store, runs), 72)


def _properties(store: Any, runs: pd.DataFrame) -> None:
    print(property_table(store, runs))
    for hour in (3, 7):
        save(f"properties-{hour}h", properties(store, runs, f"hours = {hour}.0"))


def _swarms(store: Any, runs: pd.DataFrame) -> None:
    print(swarms(store, runs), "\n")
    print(over_bounds(store, runs))


STUDIES: dict[str, Callable[[Any, pd.DataFrame], None]] = {
    "gravity-paper": _paper,
    "gravity-paper-fair": lambda store, runs: print(tables_4_and_5(store, runs)),
    "gravity-paper-once": lambda store, runs: print(tables_4_and_5(store, runs)),
    "gravity-paper-hours": _hours,
    "gravity-properties": _properties,
    "gravity-harder": lambda store, runs: print(harder(store, runs)),
    "gravity-swarms": _swarms,
}


def main(arguments: Sequence[str]) -> None:
    """Write the pictures and print the tables that are asked for."""
    for argument in arguments:
        print(f"## {argument}\n")
        if argument == "voyage":
            save("voyage", voyage(), 80)
        elif argument == "information":
            problem: Any = navopt.simulate("gravity-matching", seed=0, hours=16.0)
            table = information_along(problem)
            print(table.iloc[12::12].to_string(float_format="%.4g"), "\n")
            save("information", information_picture(problem, table), 80)
        else:
            with ResultsStore(argument) as store:
                STUDIES[store.study.name](store, store.runs())


if __name__ == "__main__":
    main(sys.argv[1:])
