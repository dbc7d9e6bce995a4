"""Pictures and intervals of the navigation after a calibration: errors over a day, tracks on a lake.

They are made from the results of a study of `gyro-navigation`: worlds are drawn again, and the estimates that
the store kept navigate once more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import navopt
from comparisons.drawing import UNAIDED, Style, solver_styles, styled
from comparisons.statistics import run_scores
from comparisons.store import ResultsStore
from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import NAUTICAL_MILE, local_tangent_plane
from navopt.models.triad import GyroTriad

__all__ = [
    "PERFECT",
    "NavigationCurves",
    "error_picture",
    "navigation_curves",
    "paired_table",
    "track_picture",
]

#: Row of gyros that are known without any error, where the run's own errors are all that is left.
PERFECT = "perfect calibration"

_PERFECT_STYLE = Style("#000000", "o", "-")


@dataclass(frozen=True)
class NavigationCurves:
    """Position errors over time of every solver in every world.

    Attributes
    ----------
    scenario : str
        Label of the study.
    time_s : ndarray, shape (N,)
        Seconds since departure.
    error_m : dict of str to ndarray, shape (W, N)
        By label of the solver, in the order of the study; `PERFECT` comes last.
    """

    scenario: str
    time_s: np.ndarray
    error_m: dict[str, np.ndarray]

    def per_hour(self) -> pd.DataFrame:
        """Median over the worlds at every whole hour, in nautical miles; one column per solver."""
        hours = np.arange(int(self.time_s[-1] // 3600.0) + 1)
        at = np.searchsorted(self.time_s, 3600.0 * hours - 1e-6)
        columns = {k: np.median(v[:, at], axis=0) / NAUTICAL_MILE for k, v in self.error_m.items()}
        return pd.DataFrame(columns, index=pd.Index(hours, name="hour"))


def navigation_curves(store: ResultsStore, scenario: str) -> NavigationCurves:
    """Navigate again with every estimate of a scenario.

    Parameters
    ----------
    store : ResultsStore
        Results of a study of `gyro-navigation`.
    scenario : str
        One of its labels.

    Returns
    -------
    NavigationCurves
        Of the worlds in which every solver has succeeded.

    Raises
    ------
    UnknownName
        If there is no such scenario.
    InvalidInput
        If no world is complete, or its problem does not navigate.
    """
    study, runs = store.study, store.runs()
    if scenario not in study.scenarios:
        raise UnknownName("scenario", scenario, study.scenarios)
    name, keywords = study.place(scenario)
    labels = [entry.label for entry in study.solvers]
    own = runs[(runs["scenario"] == scenario) & (runs["status"] != "failed")]
    found: dict[str, list[np.ndarray]] = {label: [] for label in (*labels, PERFECT)}
    time = np.zeros(0)
    for world, rows in own.groupby("world"):
        keys = dict(zip(rows["solver"], rows["key"], strict=True))
        if any(label not in keys for label in labels):
            continue
        problem: Any = navopt.simulate(name, seed=int(world), **keywords)
        if not hasattr(problem, "navigation"):
            raise InvalidInput("store", f"a study of {name}", "give one of gyro-navigation")
        for label in labels:
            arrays = store.estimate(keys[label])
            triad = GyroTriad(arrays["scale"], arrays["misalignment"], arrays["bias"])
            found[label].append(problem.navigation(triad).position_error_m)
        run = problem.navigation(problem.truth)
        time = run.time_s
        found[PERFECT].append(run.position_error_m)
    if not found[PERFECT]:
        raise InvalidInput("store", f"no complete world of {scenario!r}", "run the study first")
    return NavigationCurves(scenario, time, {label: np.stack(v) for label, v in found.items()})


@styled
def error_picture(curves: NavigationCurves, study: Any, *, printed: dict[str, float] | None = None) -> Figure:
    """Draw position errors over time, as Figure 6 of Gao et al. (2015): medians, and half of the worlds.

    Parameters
    ----------
    curves : NavigationCurves
        What to draw.
    study : Study
        For the colours.
    printed : dict of str to float, optional, keyword-only
        Printed errors at the end by label of the solver, nautical miles.

    Returns
    -------
    matplotlib.figure.Figure
    """
    styles = {**solver_styles(study), PERFECT: _PERFECT_STYLE}
    day = curves.time_s[-1] >= 2 * 3600.0
    time = curves.time_s / (3600.0 if day else 60.0)
    unit = NAUTICAL_MILE if day else 1.0
    figure = Figure(figsize=(8.4, 3.8), layout="constrained")
    axes = figure.add_subplot()
    for label, errors in curves.error_m.items():
        low, middle, high = np.quantile(errors / unit, [0.25, 0.5, 0.75], axis=0)
        style = styles[label]
        axes.fill_between(time, low, high, color=style.colour, alpha=0.13, linewidth=0)
        axes.plot(time, middle, color=style.colour, linestyle=style.line, linewidth=1.6, label=label)
        if printed and label in printed:
            axes.plot(time[-1], printed[label], style.marker, color=style.colour, markersize=7, clip_on=False)
    axes.set_xlim(0, time[-1])
    axes.set_ylim(bottom=0)
    axes.set_xlabel("hours since departure" if day else "minutes since departure")
    axes.set_ylabel(f"position error ({'nmi' if day else 'm'})")
    axes.set_title(
        f"{curves.scenario}: median and middle half of {len(next(iter(curves.error_m.values())))} worlds"
    )
    axes.legend(loc="upper left")
    return figure


@styled
def track_picture(store: ResultsStore, scenario: str, world: int) -> Figure:
    """Draw the tracks of one world, as Figure 7 of Gao et al. (2015).

    Parameters
    ----------
    store : ResultsStore
        Results of a study of `gyro-navigation` on the lake.
    scenario : str
        One of its labels.
    world : int
        Its seed.

    Returns
    -------
    matplotlib.figure.Figure
        The whole tour, where the tracks can hardly be told apart, and what each of them is off.

    Raises
    ------
    UnknownName
        If there is no such scenario.
    InvalidInput
        If the world has not been run.
    """
    study, runs = store.study, store.runs()
    if scenario not in study.scenarios:
        raise UnknownName("scenario", scenario, study.scenarios)
    own = runs[(runs["scenario"] == scenario) & (runs["world"] == world) & (runs["status"] != "failed")]
    if own.empty:
        raise InvalidInput("world", world, f"it has no runs of {scenario!r}")
    name, keywords = study.place(scenario)
    problem: Any = navopt.simulate(name, seed=world, **keywords)
    path, every = problem.scenario.path(), problem.scenario.substeps
    plane = local_tangent_plane(path.latitude, path.longitude, path.latitude[0], path.longitude[0])
    north, east = (values[::every] for values in plane)
    styles = solver_styles(study)
    figure = Figure(figsize=(8.4, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    run = problem.navigation(problem.truth)
    left.plot(
        (east + run.reference_east_m) / 1e3, (north + run.reference_north_m) / 1e3,
        color=UNAIDED.colour, linewidth=3.0, alpha=0.5, label="reference",
    )  # fmt: skip
    for label, key in zip(own["solver"], own["key"], strict=True):
        arrays = store.estimate(key)
        error = problem.navigation(GyroTriad(arrays["scale"], arrays["misalignment"], arrays["bias"]))
        style = styles[label]
        shown = {"color": style.colour, "linestyle": style.line, "linewidth": 1.4, "label": label}
        left.plot((east + error.east_m) / 1e3, (north + error.north_m) / 1e3, **shown)
        right.plot(error.east_m, error.north_m, **shown)
        right.plot(error.east_m[-1], error.north_m[-1], style.marker, color=style.colour, markersize=6)
    left.set(xlabel="east (km)", ylabel="north (km)", title="tracks")
    right.set(xlabel="east (m)", ylabel="north (m)", title="INS less truth; the mark is the end")
    for axes in (left, right):
        axes.set_aspect("equal", adjustable="datalim")
    left.legend(loc="best")
    return figure


def paired_table(store: ResultsStore, score: str, *, against: str) -> pd.DataFrame:
    """Compare every solver with one of them, world by world.

    Parameters
    ----------
    store : ResultsStore
        Results of a study.
    score : str
        Which score.
    against : str, keyword-only
        Label of the solver to compare with.

    Returns
    -------
    pandas.DataFrame
        One row per scenario and solver: ``scenario, solver, worlds``; ``median, low, high``: median of the
        score and its 95 % bootstrap interval (bias corrected and accelerated) over the worlds;
        ``difference, difference_low, difference_high``: the same of the solver's score less that of
        `against` in the same world; ``better``: share of the worlds in which it is lower.

    Raises
    ------
    UnknownName
        If no solver has that label.
    """
    study, runs = store.study, store.runs()
    labels = [entry.label for entry in study.solvers]
    if against not in labels:
        raise UnknownName("against", against, labels)
    rows = []
    for scenario in study.scenarios:
        own = runs[runs["scenario"] == scenario].copy()
        if own.empty:
            continue
        own["value"] = run_scores(own, score).to_numpy()
        wide = own.pivot_table(index="world", columns="solver", values="value").dropna()
        for label in labels:
            if label not in wide:
                continue
            values = wide[label].to_numpy()
            difference = values - wide[against].to_numpy()
            median, low, high = _interval(values)
            shift, shift_low, shift_high = _interval(difference)
            rows.append(
                {
                    "scenario": scenario, "solver": label, "worlds": len(values),
                    "median": median, "low": low, "high": high,
                    "difference": shift, "difference_low": shift_low, "difference_high": shift_high,
                    "better": float(np.mean(difference < 0.0)),
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def _interval(values: np.ndarray) -> tuple[float, float, float]:
    """Median with its 95 % interval; the same twice where there is nothing to resample."""
    from scipy import stats

    middle = float(np.median(values))
    if len(values) < 3 or np.ptp(values) == 0.0:
        return middle, middle, middle
    found = stats.bootstrap(
        (values,), np.median, n_resamples=4000, rng=np.random.default_rng(0), method="BCa"
    ).confidence_interval
    return middle, float(found.low), float(found.high)
