"""What the two objectives of filter tuning can tell: their landscapes over the logarithms of q and r.

The mean square error against true states depends on Q, R and P0 through the gain only, which stays the same
if all are multiplied by one number: its landscape is a valley along ``q/r = const``. The likelihood of the
innovations sees their size as well and closes the valley.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from comparisons.drawing import COLOURS, styled
from navopt.errors import NoTruth, UnsuitableProblem
from navopt.problems.noise_tuning import NoiseTuning

__all__ = ["TuningLandscape", "landscape_picture", "tuning_landscape"]

#: Ratios to the least error, and differences of the log-likelihood, between which the pictures change shade.
ERROR_LEVELS = (1.0, 1.002, 1.01, 1.03, 1.1, 1.3, 2.0, 4.0)
LIKELIHOOD_LEVELS = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
#: From the least values, white, to the largest.
SHADES = ("#ffffff", "#f0f0ec", "#e2e2dc", "#d3d3cb", "#c4c4ba", "#b5b5a9", "#a5a598", "#969687")


@dataclass(frozen=True)
class TuningLandscape:
    """Both objectives on a grid of two parameters.

    Attributes
    ----------
    log10_q, log10_r : ndarray, shapes (a,) and (b,)
        The grid.
    error : ndarray, shape (a, b)
        Mean square error of the scored states over its least value on the grid.
    deviance : ndarray, shape (a, b)
        How far the log-likelihood is below its largest value on the grid.
    true_x : ndarray, shape (2,), or None
        Where the data came from.
    level_decades, ratio_decades : float
        Over how many decades of the common level of q and r (up and down together), and of their ratio, the
        error stays within 1 % of its least: the first is as wide as the search, the second is not.
    likelihood_level_decades, likelihood_ratio_decades : float
        Over how many the log-likelihood stays within 1.92 of its largest (95 % confidence).
    """

    log10_q: np.ndarray
    log10_r: np.ndarray
    error: np.ndarray
    deviance: np.ndarray
    true_x: np.ndarray | None
    level_decades: float
    ratio_decades: float
    likelihood_level_decades: float
    likelihood_ratio_decades: float


def tuning_landscape(problem: NoiseTuning, *, decades: float = 3.0, points: int = 61) -> TuningLandscape:
    """Compute both objectives about the point that made the data.

    Parameters
    ----------
    problem : NoiseTuning
        A world with two parameters, log10 q and log10 r, and its true states; its objective does not matter.
    decades : float
        How far the grid reaches to either side.
    points : int
        Nodes on each axis.

    Returns
    -------
    TuningLandscape

    Raises
    ------
    NoTruth
        If the problem carries no true states.
    UnsuitableProblem
        If it has not these two parameters.
    """
    if problem.truth is None:
        raise NoTruth("the landscape of the error needs true states: simulate, or give a NoiseTruth")
    if problem.parameter_names != ("log10_q", "log10_r"):
        raise UnsuitableProblem(
            f"the landscape needs the parameters log10_q and log10_r, not {problem.parameter_names}"
        )
    centre = problem.true_x if problem.true_x is not None else problem.project(problem.truth)
    steps = np.linspace(-decades, decades, points)
    q, r = centre[0] + steps, centre[1] + steps
    X = np.stack(np.meshgrid(q, r, indexing="ij"), axis=-1).reshape(-1, 2)
    Q, R = problem.covariances(X)
    # the prior is part of the level: with it the invariance is exact
    P0 = problem.model.P0 * 10.0 ** (X[:, 1] - centre[1])[:, None, None]
    squares = problem.filter.mean_square_error(Q, R, problem.truth.states, P0)
    states = list(problem.scored_states)
    error = (squares[:, states] / problem.state_scale[states] ** 2).sum(axis=1).reshape(points, points)
    logs = problem.filter.log_likelihood(Q, R).reshape(points, points)
    best = [X[np.argmin(values.ravel())] for values in (error, -logs)]

    def errors_at(x: np.ndarray) -> np.ndarray:
        prior = problem.model.P0 * 10.0 ** (x[:, 1] - centre[1])[:, None, None]
        found = problem.filter.mean_square_error(*problem.covariances(x), problem.truth.states, prior)
        total: np.ndarray = (found[:, states] / problem.state_scale[states] ** 2).sum(axis=1)
        return total / error.min()

    def deviance_at(x: np.ndarray) -> np.ndarray:
        return logs.max() - problem.filter.log_likelihood(*problem.covariances(x))

    return TuningLandscape(
        q, r, error / error.min(), logs.max() - logs, problem.true_x,
        *_extents(errors_at, best[0], 1.01, decades), *_extents(deviance_at, best[1], 1.92, decades),
    )  # fmt: skip


def _extents(
    values_at: Callable[[np.ndarray], np.ndarray], best: np.ndarray, limit: float, decades: float
) -> tuple[float, float]:
    """Decades of level and of ratio about a point over which values stay within a limit."""
    steps = np.linspace(-decades, decades, 801)
    out = []
    # the level moves both, the ratio each by half in opposite directions
    for direction in (np.array([1.0, 1.0]), np.array([0.5, -0.5])):
        beyond = np.flatnonzero(values_at(best + steps[:, None] * direction) > limit)
        low = beyond[beyond < 400].max(initial=-1)
        high = beyond[beyond > 400].min(initial=801)
        out.append(float((high - low - 2) * (steps[1] - steps[0])))
    return out[0], out[1]


@styled
def landscape_picture(problem: NoiseTuning, landscape: TuningLandscape | None = None) -> Figure:
    """Draw both landscapes side by side.

    Parameters
    ----------
    problem : NoiseTuning
        As for `tuning_landscape`.
    landscape : TuningLandscape, optional
        If at hand.

    Returns
    -------
    matplotlib.figure.Figure
    """
    landscape = tuning_landscape(problem) if landscape is None else landscape
    figure = Figure(figsize=(8.4, 4.0), layout="constrained")
    panels: Any = figure.subplots(1, 2, sharex=True, sharey=True)
    for panel, values, levels, title, label in (
        (panels[0], landscape.error, ERROR_LEVELS, "Error against the truth", "mean square error, least = 1"),
        (
            panels[1],
            landscape.deviance,
            LIKELIHOOD_LEVELS,
            "Likelihood of the innovations",
            "log-likelihood below its largest",
        ),
    ):
        shown = np.where(np.isfinite(values), values, levels[-1] * 10.0).T
        edges = [*levels, 1e300]
        grid = (landscape.log10_q, landscape.log10_r)
        drawn = panel.contourf(*grid, shown, levels=edges, colors=SHADES)
        panel.contour(*grid, shown, levels=levels[1:], colors="#777777", linewidths=0.5)
        best = np.unravel_index(np.argmin(values), values.shape)
        panel.plot(grid[0][best[0]], grid[1][best[1]], "o", color=COLOURS[1], label="least on the grid")
        if landscape.true_x is not None:
            panel.plot(*landscape.true_x, "+", color="black", markersize=13, label="truth")
        panel.set_title(title, fontsize=10)
        panel.set_xlabel("$\\log_{10} q$")
        panel.grid(False)
        panel.set_aspect("equal")
        bar = figure.colorbar(drawn, ax=panel, location="bottom", shrink=0.9, label=label)
        bar.set_ticks(list(levels), labels=[f"{level:g}" for level in levels])
    panels[0].set_ylabel("$\\log_{10} r$")
    panels[0].legend(loc="upper left", fontsize=8)
    return figure
