"""Pictures of a tuned filter at work: its estimates and their errors over time, in one world of a study.

Worlds are drawn again, and the covariances that the store kept filter them once more. They stand for
Figures 5 and 7 of Wan et al. (2020) and for Figures 7 to 11 of Zhang et al. (2016).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import navopt
from comparisons.drawing import UNAIDED, Style, solver_styles, styled
from comparisons.statistics import FAILURES, REFERENCES, opened
from navopt.problems.noise_estimate import NoiseEstimate
from navopt.problems.noise_tuning import NoiseTuning
from navopt.problems.pushing_distance import integrate_twice

__all__ = ["alignment_course", "course_pictures", "pushing_course", "stroke_data", "tuned_states"]

#: More lines than these cannot be told apart: the first of the study are drawn.
MOST_SOLVERS = 6
#: What the filter that knows the true covariances is called.
TRUE = "true Q and R"
ANGLES = (("pitch", 2), ("roll", 3), ("yaw", 4))
#: Share of the record that the panel of details shows, from its end.
DETAIL = 0.12
_TRUE_STYLE = Style("#000000", "o", "-")


def tuned_states(store: Any, scenario: str, world: int) -> tuple[NoiseTuning, dict[str, np.ndarray]]:
    """States that the filters of one world estimate.

    Parameters
    ----------
    store : ResultsStore
        Results of a study of a tuning problem.
    scenario : str
        Label of the scenario.
    world : int
        Seed of the world.

    Returns
    -------
    NoiseTuning
        The world.
    dict of str to ndarray, shape (T, n)
        Estimates by the label of the solver, first seeds; at most six solvers and the reference. The
        filter with the true covariances comes last.

    Raises
    ------
    UnknownName
        If the study has no such scenario.
    """
    runs, study = opened(store, None, scenario)
    name, keywords = study.place(scenario)
    problem = navopt.simulate(name, seed=world, **keywords)
    found: dict[str, np.ndarray] = {}
    drawn = [entry for entry in study.solvers if entry.name not in REFERENCES][:MOST_SOLVERS]
    for entry in (*drawn, *(e for e in study.solvers if e.name in REFERENCES)):
        if not len(runs):
            continue
        own = runs[
            (runs["scenario"] == scenario) & (runs["world"] == world) & (runs["solver"] == entry.label)
        ]
        own = own[~own["status"].isin(FAILURES)].sort_values("seed")
        kept = store.estimate(own["key"].iloc[0]) if len(own) else {}
        if {"Q", "R"} <= set(kept):
            states = _filtered(problem, NoiseEstimate(kept["Q"], kept["R"]))
            if states is not None:
                found[entry.label] = states
    if problem.truth.Q is not None:
        states = _filtered(problem, problem.truth)
        if states is not None:
            found[TRUE] = states
    return problem, found


def _filtered(problem: NoiseTuning, estimate: Any) -> np.ndarray | None:
    run = problem.filter.run(np.asarray(estimate.Q)[None], np.asarray(estimate.R)[None])
    return None if run.failed[0] is not None else run.estimates[0]


def course_pictures(store: Any, *, scenario: str, world: int) -> list[tuple[Figure, str, str]]:
    """Pictures of one world that a report shows.

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
    list of (matplotlib.figure.Figure, str, str)
        Each with a text for those who cannot see it, and a caption; empty for other problems.
    """
    _, study = opened(store, None, scenario)
    name, keywords = study.place(scenario)
    where = f"scenario {scenario}, world {world}"
    few = f"At most the first {MOST_SOLVERS} solvers of the study are drawn."
    if name == "static-alignment":
        problem, states = tuned_states(store, scenario, world)
        return [
            (
                alignment_course(problem, states, styles=_styles(study), errors=errors),
                f"{what} of pitch, roll and yaw over time in {where}",
                f"{what} of the three angles during the alignment of one world. {few}",
            )
            for errors, what in ((True, "Errors"), (False, "Estimates"))
        ]
    if name == "pushing-distance":
        problem, states = tuned_states(store, scenario, world)
        pictures = [
            (
                pushing_course(problem, states, styles=_styles(study), errors=errors),
                f"{what} over time in {where}",
                f"{what} in one world; on the right the end of it. {few}",
            )
            for errors, what in ((False, "Pushing distance"), (True, "Errors of the pushing distance"))
        ]
        if keywords.get("case") == "stroke":
            caption = "What is true and what is measured: position, velocity, acceleration."
            pictures.insert(0, (stroke_data(problem), f"True and measured motion in {where}", caption))
        return pictures
    return []


def _styles(study: Any) -> dict[str, Style]:
    return {**solver_styles(study), TRUE: _TRUE_STYLE}


@styled
def alignment_course(
    problem: NoiseTuning,
    states: Mapping[str, np.ndarray],
    *,
    styles: Mapping[str, Style],
    errors: bool,
) -> Figure:
    """Draw the angles of an alignment over time: Figures 5 and 7 of Wan et al. (2020).

    Parameters
    ----------
    problem : StaticAlignment
        The world; level and heading north, so that phi about east, north and up are pitch, roll and yaw.
    states : mapping of str to ndarray, shape (T, 10)
        From `tuned_states`.
    styles : mapping of str to Style
        How each is drawn.
    errors : bool
        Sizes of the errors on a logarithmic axis, with the error before any estimate; or the estimates.

    Returns
    -------
    matplotlib.figure.Figure
    """
    truth = np.degrees(problem.truth.states)
    time = np.arange(len(truth)) * problem.run.steps.step
    figure = Figure(figsize=(8.4, 6.6), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    for axes, (name, k) in zip(panels, ANGLES, strict=True):
        for label, found in states.items():
            values = np.degrees(found[:, k])
            shown = np.maximum(np.abs(values - truth[:, k]), 1e-9) if errors else values
            _line(axes, time, shown, label, styles.get(label, UNAIDED))
        before = np.abs(truth[:, k]) if errors else truth[:, k]
        label = "no estimate" if errors else "truth"
        axes.plot(time, before, color="#888888", linewidth=2.4, alpha=0.55, label=label, zorder=1)
        axes.set_ylabel(f"{'error of ' if errors else ''}{name} (°)")
        if errors:
            axes.set_yscale("log")
            axes.set_ylim(bottom=1e-5)
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_xlim(time[0], time[-1])
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


@styled
def pushing_course(
    problem: NoiseTuning,
    states: Mapping[str, np.ndarray],
    *,
    styles: Mapping[str, Style],
    errors: bool,
) -> Figure:
    """Draw positions over time, or their errors: Figures 7, 8, 10 and 11 of Zhang et al. (2016).

    Parameters
    ----------
    problem : PushingDistance
        The world.
    states : mapping of str to ndarray, shape (T, 2)
        From `tuned_states`.
    styles : mapping of str to Style
        How each is drawn.
    errors : bool
        Errors, of the measured position too; or positions, with the acceleration integrated twice.

    Returns
    -------
    matplotlib.figure.Figure
        The whole record, and its end.
    """
    true, measured = problem.truth.states[:, 0], problem.model.y[:, 0]
    time, unit, factor = _time(problem), *_unit(true)
    integrated = integrate_twice(problem)[:, 0]
    figure = Figure(figsize=(8.4, 3.9), layout="constrained")
    whole, detail = figure.subplots(1, 2, width_ratios=(3, 2))
    for axes in (whole, detail):
        zero = true if errors else np.zeros_like(true)
        dots = {"color": "#bbbbbb", "linestyle": "none", "marker": ".", "markersize": 3, "zorder": 0}
        axes.plot(time, factor * (measured - zero), label="measured", **dots)
        if not errors:
            axes.plot(time, factor * integrated, color="#1f4fbf", linewidth=1.2, linestyle=":",
                      label="integrated twice")  # fmt: skip
            axes.plot(
                time, factor * true, color="#888888", linewidth=2.6, alpha=0.55, label="truth", zorder=1
            )
        for label, found in states.items():
            _line(axes, time, factor * (found[:, 0] - zero), label, styles.get(label, UNAIDED))
        axes.set_xlabel("time (s)")
    whole.set_xlim(time[0], time[-1])
    start = time[-1] - DETAIL * (time[-1] - time[0])
    detail.set_xlim(start, time[-1])
    late = time >= start
    good = [found for found in states.values() if len(found)]
    zero = true if errors else np.zeros_like(true)
    near = np.concatenate([(true - zero)[late], *((found[:, 0] - zero)[late] for found in good)]) * factor
    margin = 0.1 * (np.ptp(near) or 1.0)
    detail.set_ylim(near.min() - margin, near.max() + margin)
    if not errors:
        # the integral runs away: what is measured sets the axis
        low, high = (
            factor * min(true.min(), np.nanmin(measured)),
            factor * max(true.max(), np.nanmax(measured)),
        )
        whole.set_ylim(low - 0.15 * (high - low), high + 0.35 * (high - low))
    whole.set_ylabel(f"{'error of the ' if errors else ''}position ({unit})")
    handles, labels = whole.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


@styled
def stroke_data(problem: NoiseTuning) -> Figure:
    """Draw the true and the measured motion of a push: Figure 9B of Zhang et al. (2016).

    Parameters
    ----------
    problem : PushingDistance
        The world.

    Returns
    -------
    matplotlib.figure.Figure
        Position, velocity (measured: differences of the measured position over 0.2 s) and acceleration.
    """
    true, measured, time = problem.truth.states, problem.model.y[:, 0], _time(problem)
    interval = time[1] - time[0]
    unit, factor = _unit(true[:, 0])
    span = max(round(0.2 / interval), 1)
    speed = (measured[span:] - measured[:-span]) / (span * interval)
    rows = (
        (f"position ({unit})", factor, true[:, 0], time, measured, time),
        (f"velocity ({unit}/s)", factor, true[:, 1], time, speed, time[span:] - 0.5 * span * interval),
        (
            "acceleration (m/s²)",
            1.0,
            np.diff(true[:, 1]) / interval,
            time[:-1],
            np.asarray(problem.model.u)[:, 0],
            time,
        ),
    )
    figure = Figure(figsize=(8.4, 5.6), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    for axes, (label, scale, right, when, seen, seen_when) in zip(panels, rows, strict=True):
        axes.plot(seen_when[: len(seen)], scale * seen[: len(seen_when)], color="#56B4E9", linewidth=0.7,
                  label="measured")  # fmt: skip
        axes.plot(when, scale * right, color="black", linewidth=1.5, label="true")
        axes.set_ylabel(label)
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_xlim(time[0], time[-1])
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def _line(axes: Axes, x: np.ndarray, y: np.ndarray, label: str, style: Style) -> None:
    axes.plot(x, y, color=style.colour, linestyle=style.line, linewidth=1.2, label=label)


def _time(problem: NoiseTuning) -> np.ndarray:
    return np.arange(problem.model.n_steps) * float(problem.model.F[0, 1])


def _unit(position: np.ndarray) -> tuple[str, float]:
    return ("mm", 1e3) if np.ptp(position) < 5.0 else ("m", 1.0)
