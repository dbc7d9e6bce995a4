"""A roadheader's alignment (paper 002) done again: Figures 6 to 9 and 11, and the statistics of its tables.

``python -m comparisons.heading_paper --out results/heading-paper-figures`` writes tables and pictures.
Scenarios and filters are those of the study ``heading-paper``, whose tables have the scores over many worlds
and the printed numbers beside them; here stand the courses over time, and mean and variance of every angle.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

import navopt
from comparisons.study import Study
from navopt.errors import UnknownName
from navopt.models.laser_spot import simulate_spot_test
from navopt.problems.heading_alignment import HeadingAlignment
from navopt.problems.heading_scores import convergence_time, state_errors
from navopt.problems.heading_settings import HeadingSettings

__all__ = [
    "ANGLES",
    "FIGURES",
    "Course",
    "angle_statistics",
    "course",
    "courses",
    "ground_check",
    "main",
    "settings_of",
    "summary",
    "write_all",
]

ANGLES = ("east", "north", "up")
#: Figures of the paper: scenarios with the filters drawn in each.
FIGURES: dict[str, tuple[tuple[str, str], ...]] = {
    "figure-7": (
        ("Simulation 1", "SST-UKF, heading state"),
        ("Simulation 1", "SST-UKF, no heading"),
    ),
    "figure-8": (("Simulation 2", "SST-UKF, heading state"), ("Simulation 2", "UKF, heading state")),
    "figure-9": tuple((f"Simulation 3, {a}°", "SST-UKF, heading state") for a in (30, 45, 60)),
    "figure-11": (("onboard", "SST-UKF, heading state"), ("onboard", "UKF, heading state")),
}
#: What the paper finds in its own spot test, degrees: mean and what it calls the variance.
PRINTED_SPOTS = (0.05, 0.028)


@dataclass(frozen=True)
class Course:
    """Errors of one filter in one world over time.

    Attributes
    ----------
    time : ndarray, shape (K,)
        In s.
    errors, sigmas : ndarray, shape (K, 3)
        Estimated minus true phi_E, phi_N, phi_U and what the filter thinks of them, degrees; NaN from a
        failure on.
    failed : str or None
        Step and cause of a failure.
    """

    time: np.ndarray
    errors: np.ndarray
    sigmas: np.ndarray
    failed: str | None


def settings_of(study: Study, label: str) -> HeadingSettings:
    """Return the filter of a study by its label.

    Raises
    ------
    UnknownName
        If the study has no such solver.
    """
    for entry in study.solvers:
        if entry.label == label:
            return HeadingSettings(**entry.settings)
    raise UnknownName("solver", label, [entry.label for entry in study.solvers])


def course(problem: HeadingAlignment, settings: HeadingSettings) -> Course:
    """Run a filter in a world and keep the errors of its angles."""
    run = problem.run(settings, covariances=False)
    errors = state_errors(run.estimates, problem.truth.states)[:, 2:5]
    return Course(run.times, np.degrees(errors), np.degrees(run.deviations[:, 2:5]), run.failed)


def courses(
    study: Study, wanted: Sequence[tuple[str, str]], *, world: int = 0
) -> dict[tuple[str, str], Course]:
    """Run filters of a study in one world of its scenarios.

    Parameters
    ----------
    study : Study
        Of heading alignment.
    wanted : sequence of (str, str)
        Labels of scenario and solver.
    world : int, default 0
        Seed.

    Returns
    -------
    dict of (str, str) to Course
    """
    worlds = {}
    for scenario, _ in wanted:
        if scenario not in worlds:
            name, keywords = study.place(scenario)
            worlds[scenario] = navopt.simulate(name, seed=world, **keywords)
    return {pair: course(worlds[pair[0]], settings_of(study, pair[1])) for pair in wanted}


def angle_statistics(
    study: Study,
    *,
    worlds: Sequence[int],
    scenarios: Sequence[str] | None = None,
    solvers: Sequence[str] | None = None,
    settled_deg: float = 1.0,
) -> pd.DataFrame:
    """Mean and variance of every angle's error after convergence, and when each settled.

    Parameters
    ----------
    study : Study
        Of heading alignment.
    worlds : sequence of int
        Seeds.
    scenarios, solvers : sequence of str, optional
        Labels; all of the study if not given.
    settled_deg : float, default 1
        Half width, degrees, of the band about the mean of the last third in which an azimuth has settled.
        Convergence times that are read off a curve are such times: nothing in the curve says where the
        truth is.

    Returns
    -------
    pandas.DataFrame
        Columns ``scenario, solver, world, angle, mean_deg, variance_deg2, settled_s``; the first two
        moments over the last third of the run. A filter that failed has NaN, and ``failed`` its cause.
    """
    rows = []
    for scenario in study.scenarios if scenarios is None else scenarios:
        name, keywords = study.place(scenario)
        for world in worlds:
            problem = navopt.simulate(name, seed=world, **keywords)
            for label in [e.label for e in study.solvers] if solvers is None else solvers:
                run = course(problem, settings_of(study, label))
                late = run.errors[-max(1, len(run.errors) // 3) :]
                for k, angle in enumerate(ANGLES):
                    failed = run.failed is not None
                    mean = np.nan if failed else float(late[:, k].mean())
                    settled = convergence_time(run.time, run.errors[:, k] - mean, settled_deg)
                    rows.append(
                        {
                            "scenario": scenario,
                            "solver": label,
                            "world": world,
                            "angle": angle,
                            "mean_deg": mean,
                            "variance_deg2": np.nan if failed else float(late[:, k].var()),
                            "settled_s": np.nan if failed else settled,
                            "failed": run.failed or "",
                        }
                    )
    return pd.DataFrame(rows)


def summary(statistics: pd.DataFrame) -> pd.DataFrame:
    """Return medians over the worlds of a table of `angle_statistics`: one row per scenario and filter.

    Columns ``mean_E, mean_N, mean_U`` (sizes of the means, degrees), ``variance_E`` and so on (degrees
    squared), ``settled_s`` of the azimuth, ``worlds`` and ``failed``, in how many the filter failed.
    """
    rows = []
    for (scenario, solver), own in statistics.groupby(["scenario", "solver"], sort=False):
        row: dict[str, object] = {"scenario": scenario, "solver": solver}
        for angle in ANGLES:
            one = own[own["angle"] == angle]
            row[f"mean_{angle[0].upper()}"] = float(one["mean_deg"].abs().median())
            row[f"variance_{angle[0].upper()}"] = float(one["variance_deg2"].median())
        up = own[own["angle"] == "up"]
        row["settled_s"] = float(up["settled_s"].median())
        row["worlds"] = int(up["world"].nunique())
        row["failed"] = int((up["failed"] != "").sum())
        rows.append(row)
    return pd.DataFrame(rows)


def ground_check(*, repeats: int = 1000, seed: int = 0) -> pd.DataFrame:
    """Repeat the spot test of section 2.4 with its ground marks, for two lengths of the marks.

    Parameters
    ----------
    repeats : int, default 1000
        Experiments of nine positions each.
    seed : int, default 0
        Of everything drawn.

    Returns
    -------
    pandas.DataFrame
        Columns ``marks_m, mean_deg, mean_low, mean_high, sigma_deg, sigma_low, sigma_high, tape_deg``:
        medians of the mean and the standard deviation of laser minus ground with the middle 95 % of all
        experiments, and what the tape adds; then what the paper prints.
    """
    rows = []
    for marks in (2.0, 5.0, 10.0):
        rng = np.random.default_rng([seed, round(1000 * marks)])
        tests = [simulate_spot_test(rng, mark_distance=marks) for _ in range(repeats)]
        mean = np.degrees([test.mean for test in tests])
        sigma = np.degrees([test.sigma for test in tests])
        rows.append(
            {
                "marks_m": marks,
                "mean_deg": float(np.median(mean)),
                "mean_low": float(np.quantile(mean, 0.025)),
                "mean_high": float(np.quantile(mean, 0.975)),
                "sigma_deg": float(np.median(sigma)),
                "sigma_low": float(np.quantile(sigma, 0.025)),
                "sigma_high": float(np.quantile(sigma, 0.975)),
                "tape_deg": float(np.degrees(np.median([test.ground_sigma for test in tests]))),
                "printed_mean_deg": PRINTED_SPOTS[0],
                "printed_sigma_deg": PRINTED_SPOTS[1],
            }
        )
    return pd.DataFrame(rows)


def write_all(
    out: Path,
    *,
    worlds: int = 10,
    study: Study | None = None,
    figures: Mapping[str, Sequence[tuple[str, str]]] = FIGURES,
) -> dict[str, pd.DataFrame]:
    """Write all tables (CSV) and pictures (PNG) of the reproduction.

    Parameters
    ----------
    out : pathlib.Path
        Folder, made if need be.
    worlds : int, default 10
        Of the statistics; the pictures show the first.
    study : Study, optional
        ``heading-paper`` if not given.
    figures : mapping, optional
        Which courses each picture has.

    Returns
    -------
    dict of str to pandas.DataFrame
        ``angles, summary, ground-check``, as written.
    """
    from comparisons.drawing import render
    from comparisons.heading_figures import azimuth_figure, course_figure, spot_figure

    study = Study.named("heading-paper") if study is None else study
    out.mkdir(parents=True, exist_ok=True)
    angles = angle_statistics(study, worlds=study.worlds[:worlds])
    tables = {"angles": angles, "summary": summary(angles), "ground-check": ground_check()}
    for name, table in tables.items():
        table.to_csv(out / f"{name}.csv", index=False)
    pictures = {"figure-6": spot_figure(simulate_spot_test(np.random.default_rng(0)))}
    for name, wanted in figures.items():
        found = courses(study, wanted, world=study.worlds[0])
        several = len({scenario for scenario, _ in wanted}) > 1
        labels = {" – ".join(pair) if several else pair[1]: run for pair, run in found.items()}
        pictures[name] = azimuth_figure(labels) if several else course_figure(labels)
    for name, figure in pictures.items():
        (out / f"{name}.png").write_bytes(render(figure, format="png", dpi=100))
    return tables


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line of this module."""
    from rich.console import Console

    parser = argparse.ArgumentParser(prog="python -m comparisons.heading_paper", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/heading-paper-figures"))
    parser.add_argument("--worlds", type=int, default=10, help="worlds of the statistics")
    given = parser.parse_args(arguments)
    tables = write_all(given.out, worlds=given.worlds)
    console = Console(width=200)
    for name in ("summary", "ground-check"):
        console.print(f"\n{name}", style="bold")
        console.print(tables[name].to_string(index=False), markup=False, highlight=False)
    console.print(f"\ntables and pictures: {given.out}")


if __name__ == "__main__":
    main()
