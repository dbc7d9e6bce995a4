"""Pictures of alignments with a measured heading: errors over time, formulations, and the spot test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from comparisons.drawing import COLOURS, LINES, styled
from navopt.models.laser_spot import SpotTest

__all__ = ["azimuth_figure", "course_figure", "formulation_figure", "spot_figure"]

NAMES = (r"$\varphi_E$", r"$\varphi_N$", r"$\varphi_U$")
#: A line on a logarithmic axis ends here, degrees.
LEAST = 1e-4
#: Points of a curve that a picture can show.
POINTS = 1500


@styled
def course_figure(courses: Mapping[str, Any]) -> Figure:
    """Draw the errors of the three angles over time: Figures 7, 8 and 11 of paper 002.

    Parameters
    ----------
    courses : mapping of str to Course
        From `comparisons.heading_paper.courses`, by what the legend says.

    Returns
    -------
    matplotlib.figure.Figure
        Shaded is what each filter itself thinks of the azimuth, one standard deviation either way.
    """
    figure = Figure(figsize=(8.4, 6.4), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    for k, (label, run) in enumerate(courses.items()):
        thin = slice(None, None, max(1, len(run.time) // POINTS))
        for j, axes in enumerate(panels):
            time, error, sigma = run.time[thin], run.errors[thin, j], run.sigmas[thin, j]
            axes.plot(time, error, color=COLOURS[k], linestyle=LINES[k], linewidth=1.1, label=label)
            if j == 2:
                axes.fill_between(
                    time, error - sigma, error + sigma, color=COLOURS[k], alpha=0.13, linewidth=0
                )
    for name, axes in zip(NAMES, panels, strict=True):
        axes.axhline(0.0, color="#333333", linewidth=0.8)
        axes.set_ylabel(f"error of {name} (°)")
    for axes in panels[:2]:
        axes.set_ylim(-0.5, 0.5)
    panels[-1].set_xlabel("time (s)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


@styled
def azimuth_figure(courses: Mapping[str, Any]) -> Figure:
    """Draw the azimuth's error over time in several scenarios: Figure 9 of paper 002.

    Parameters
    ----------
    courses : mapping of str to Course
        By what the legend says.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = Figure(figsize=(8.4, 3.8), layout="constrained")
    axes = figure.subplots()
    for k, (label, run) in enumerate(courses.items()):
        thin = slice(None, None, max(1, len(run.time) // POINTS))
        axes.plot(run.time[thin], run.errors[thin, 2], color=COLOURS[k], linestyle=LINES[k], label=label)
    axes.axhline(0.0, color="#333333", linewidth=0.8)
    axes.set_xlabel("time (s)")
    axes.set_ylabel(f"error of {NAMES[2]} (°)")
    figure.legend(loc="outside upper center", ncols=1)
    return figure


@styled
def formulation_figure(
    errors: Mapping[str, np.ndarray],
    time: np.ndarray,
    *,
    early: float = 60.0,
    printed: Sequence[tuple[float, float, str]] = (),
) -> Figure:
    """Draw how large the azimuth's error is over time, for ways of using the heading, over many worlds.

    Parameters
    ----------
    errors : mapping of str to ndarray, shape (W, K)
        Errors in degrees, a row for each world.
    time : ndarray, shape (K,)
        In s.
    early : float, default 60
        End of the left panel, s; the right one shows everything.
    printed : sequence of (float, float, str)
        Points that a paper prints: time (s), error (degrees), and what it is.

    Returns
    -------
    matplotlib.figure.Figure
        Medians of the sizes over the worlds, and their quartiles.
    """
    figure = Figure(figsize=(8.8, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(2, 3))
    for axes, end in ((left, early), (right, float(time[-1]))):
        shown = np.flatnonzero(time <= end)
        shown = shown[:: max(1, len(shown) // 400)]
        for k, (label, own) in enumerate(errors.items()):
            size = np.maximum(np.abs(own[:, shown]), LEAST)
            low, middle, high = np.nanquantile(size, [0.25, 0.5, 0.75], axis=0)
            axes.fill_between(time[shown], low, high, color=COLOURS[k], alpha=0.18, linewidth=0)
            axes.plot(time[shown], middle, color=COLOURS[k], linestyle=LINES[k], label=label)
        axes.set_yscale("log")
        axes.set_xlim(0.0, end)
        axes.set_xlabel("time (s)")
    for at, size, text in printed:
        right.plot([at], [size], color="#000000", marker="*", markersize=10, linestyle="none")
        right.annotate(text, (at, size), xytext=(6, 5), textcoords="offset points", fontsize=8)
    left.set_ylabel("size of the azimuth error (°)")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


@styled
def spot_figure(test: SpotTest) -> Figure:
    """Draw a spot test and its ground check: Figure 6 of paper 002.

    Parameters
    ----------
    test : SpotTest
        From `navopt.models.laser_spot.simulate_spot_test`.

    Returns
    -------
    matplotlib.figure.Figure
        Angles at each position by laser and by marks, and their difference.
    """
    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    angle, gap = figure.subplots(1, 2)
    position = np.arange(1, len(test.truth) + 1)
    angle.plot(position, np.degrees(test.ground), "s", color=COLOURS[0], label="marks on the ground")
    angle.plot(position, np.degrees(test.laser), "x", color=COLOURS[1], label="laser spots")
    angle.set_ylabel("angle to the roadway (°)")
    angle.legend()
    gap.plot(position, np.degrees(test.laser - test.ground), "D", color=COLOURS[2])
    mean, sigma = np.degrees([test.mean, test.sigma])
    gap.axhspan(mean - sigma, mean + sigma, color=COLOURS[2], alpha=0.15, linewidth=0)
    gap.axhline(mean, color=COLOURS[2], linewidth=1.0)
    gap.axhline(0.0, color="#333333", linewidth=0.8)
    gap.set_ylabel("laser minus ground (°)")
    for axes in (angle, gap):
        axes.set_xlabel("position")
    return figure
