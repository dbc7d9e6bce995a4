"""Pictures and tables of the page "Noise tuning compared", from the results of its studies.

``python docs/noise_tuning_compared.py results/noise-tuning results/pushing-paper`` writes the pictures of
each study into ``docs/images`` and prints its table; ``misprints`` as an argument needs no study. Worlds
that some solver has not finished yet are left out.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import navopt
from comparisons.alignment_bound import printed_alignment
from comparisons.drawing import render
from comparisons.statistics import run_scores
from comparisons.store import ResultsStore
from comparisons.tuning_pictures import course_pictures
from comparisons.wording import format_number

IMAGES = Path(__file__).resolve().parent / "images"
#: A tuning counts as found if its loss is within one per cent of the lowest of all solvers in its world,
#: or, by the likelihood, whose zero means nothing, within so many nats per measurement.
NEAR = 0.01
#: Pictures of the page: study, scenario, place among the pictures of a world, name.
PICTURES = (
    ("alignment-paper", "Table 3, five entries", 0, "alignment-errors"),
    ("alignment-paper", "Table 4, five entries", 1, "alignment-experiment"),
    ("pushing-paper", "artificial signal", 1, "pushing-errors"),
    ("pushing-paper", "stroke", 0, "pushing-data"),
    ("pushing-paper", "stroke", 1, "pushing-stroke"),
    ("pushing-paper", "stroke", 2, "pushing-stroke-errors"),
)


def save(name: str, figure: Figure, dpi: int = 80) -> None:
    """Write a picture of the page."""
    IMAGES.mkdir(exist_ok=True)
    data = render(figure, format="png", dpi=dpi)
    (IMAGES / f"tuning-{name}.png").write_bytes(data)
    print(f"images/tuning-{name}.png: {len(data) / 1000:.0f} kB\n")


# -- pieces of tables ----------------------------------------------------------------------------------
def complete(store: Any) -> pd.DataFrame:
    """Runs of the worlds that every solver has finished in every scenario."""
    runs, planned = store.runs(), len(store.study.scenarios) * len(store.study.solvers)
    finished = runs.groupby("world")["world"].transform("size")
    return runs[finished == planned]


def of(runs: pd.DataFrame, scenario: str, solver: str) -> pd.DataFrame:
    """Runs of one solver in one scenario."""
    return runs[(runs["scenario"] == scenario) & (runs["solver"] == solver)]


def median(runs: pd.DataFrame, scenario: str, solver: str, score: str) -> float:
    """Median of a score over the worlds, failed runs counting as infinite."""
    return float(run_scores(of(runs, scenario, solver), score).median())


def table(head: str, rows: Iterable[Sequence[str]]) -> str:
    """Lines of a table; the columns of the head are separated by bars."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([f"| {head} |", "|---" * (head.count("|") + 1) + "|", *lines])


def seconds(runs: pd.DataFrame, solver: str) -> str:
    """Mean time of a solver's runs."""
    value = runs[runs["solver"] == solver]["elapsed_s"].mean()
    return f"{value:.1f} s" if value >= 1.0 else f"{1e3 * value:.0f} ms"


def gaps(runs: pd.DataFrame, scenario: str, solver: str, *, relative: bool) -> np.ndarray:
    """Distance of the losses from the lowest known in their worlds, or its share of that."""
    own = of(runs, scenario, solver)
    least = own["world"].map(runs[runs["scenario"] == scenario].groupby("world")["loss"].min())
    gap = run_scores(own, "loss") - least
    return (gap / least if relative else gap).to_numpy(dtype=float)


def consistent(store: Any, runs: pd.DataFrame, solver: str) -> str:
    """Per cent of answers whose NIS on other records lies in the 95 % band of one record, by scenario."""
    shares = []
    for scenario in store.study.scenarios:
        name, keywords = store.study.place(scenario)
        world = navopt.simulate(name, seed=store.study.worlds[0], **keywords)
        measured = int(np.isfinite(world.model.y).sum())
        band = 1.96 * np.sqrt(2.0 / measured)  # of chi-square over its degrees of freedom
        nis = run_scores(of(runs, scenario, solver), "held_out.nis_1")
        shares.append(f"{100 * float((abs(nis - 1.0) < band).mean()):.0f}")
    return ", ".join(shares)


# -- tables of the page --------------------------------------------------------------------------------
def pushing_paper(store: Any, runs: pd.DataFrame) -> str:
    """Errors as Zhang et al. (2016) take them, printed ones in brackets, and what is found."""
    printed = {(v.scenario, v.solver, v.score): v.value for v in store.study.printed}
    columns = (
        ("artificial signal", "loss", 1.0, ".4f"),
        ("quieter", "loss", 1.0, ".4f"),
        ("quieter", "held_out.position_rmse_m", 1e3, ".1f"),
        ("quieter", "nis_1", 1.0, ".2f"),
        ("stroke", "position_rmse_m", 1e3, ".1f"),
        ("stroke", "final_position_error_m", 1e3, ".1f"),
    )
    rows = []
    for solver in (entry.label for entry in store.study.solvers):
        cells = [solver]
        for k, (scenario, score, unit, digits) in enumerate(columns):
            value = printed.get((scenario, solver, score)) if k else None  # as the next column has it
            said = "" if value is None else f" ({unit * value:.3g})"
            cells.append(f"{unit * median(runs, scenario, solver, score):{digits}}{said}")
        x = np.array([row for row in of(runs, "quieter", solver)["x"] if len(row)], dtype=float)
        ratio = np.quantile(x[:, 0] / x[:, 1], [0.25, 0.75])
        for low, high in ((x[:, 0].min(), x[:, 0].max()), ratio):
            cells.append(f"{low:.2g} to {high:.2g}")
        rows.append(cells)
    head = " | artificial signal, m² | quieter, m² | other records, mm | NIS | stroke, mm | at its end, mm "
    return table(f"{head}| quieter: Q | Q/R, quartiles", rows)


def alignment_paper(store: Any, runs: pd.DataFrame) -> str:
    """Final errors of the three angles beside those of Table 3 of Wan et al. (2020)."""
    printed = {(v.scenario, v.solver, v.score): v.value for v in store.study.printed}
    scenarios = ("Table 3, five entries", "Table 3, one number")
    angles = [f"{name}_error_rad" for name in ("pitch", "roll", "yaw")]
    rows = []
    for solver in (entry.label for entry in store.study.solvers):
        said = [printed.get((scenarios[0], solver, angle)) for angle in angles]
        rows.append(
            [solver]
            + [f"{median(runs, scenario, solver, a):.1e}" for scenario in scenarios for a in angles]
            + ["" if value is None else f"{value:.2e}" for value in said]
        )
    head = "rad, median | pitch | roll | yaw | pitch, one number | roll | yaw | printed: pitch | roll | yaw"
    return table(head, rows)


def pushing_fair(store: Any, runs: pd.DataFrame) -> str:
    """Errors on other records, who finds the minimum, and whose innovations are as expected."""
    scenarios, rows = list(store.study.scenarios), []
    for solver in (entry.label for entry in store.study.solvers):
        errors = [1e3 * median(runs, s, solver, "held_out.position_rmse_m") for s in scenarios]
        off = [gaps(runs, s, solver, relative=s.startswith("error")) for s in scenarios]
        near = ", ".join(f"{100 * float((gap < NEAR).mean()):.0f}" for gap in off)
        cells = [solver, f"{errors[0]:.1f}", f"{errors[1]:.1f}", f"{errors[2]:.2f}", near]
        cells += [f"{np.median(off[1]):.1g}", consistent(store, runs, solver), seconds(runs, solver)]
        rows.append((errors[1], cells))
    head = f"mm, median on other records | {' | '.join(scenarios)} | % of runs near the minimum "
    head += "| gap by the innovations, nats | % consistent | time"
    return table(head, (cells for _, cells in sorted(rows, key=lambda row: row[0])))


def alignment_fair(store: Any, runs: pd.DataFrame) -> str:
    """Errors with other noise, and the distance from the best likelihood after five minutes."""
    scenarios, rows = list(store.study.scenarios), []
    for solver in (entry.label for entry in store.study.solvers):
        errors = [median(runs, s, solver, "held_out.mean_angle_error_rad") for s in scenarios]
        gap = np.median(gaps(runs, scenarios[-1], solver, relative=False))
        degrees = [f"{value:.4f}" for value in np.degrees(errors)]
        rows.append([solver, *degrees, f"{gap:.1g}", seconds(runs, solver)])
    head = "degrees, median on other noise | 5 s, error | 5 s, innovations | 5 min, innovations "
    return table(f"{head}| gap of the loss there, nats | time", rows)


def noise_tuning(store: Any, runs: pd.DataFrame) -> str:
    """Median and 95th percentile of the error relative to the best filter's, consistency and cost."""
    study, rows = store.study, []
    for solver in (entry.label for entry in study.solvers):
        scores = [run_scores(of(runs, scenario, solver), study.rank_by) for scenario in study.scenarios]
        nees = [median(runs, scenario, solver, "held_out.nees_1") for scenario in study.scenarios]
        cells = [solver, *(f"{s.median():.3f}, {s.quantile(0.95):.3f}" for s in scores)]
        cells += [consistent(store, runs, solver), ", ".join(format_number(n, digits=2) for n in nees)]
        cells += [f"{runs[runs['solver'] == solver]['cost'].mean():.0f}", seconds(runs, solver)]
        rows.append((scores[0].median(), cells))
    head = f" | {' | '.join(study.scenarios)} | % consistent | NEES | filter runs | time"
    return table(head, (cells for _, cells in sorted(rows, key=lambda row: row[0])))


TABLES: dict[str, Callable[[Any, pd.DataFrame], str]] = {
    "pushing-paper": pushing_paper,
    "pushing-paper-fair": pushing_fair,
    "alignment-paper": alignment_paper,
    "alignment-paper-fair": alignment_fair,
    "noise-tuning": noise_tuning,
}


def study_output(folder: str) -> None:
    """Print the table of one study and write its pictures."""
    with ResultsStore(folder) as store:
        study, runs = store.study, complete(store)
        print(f"\n{study.name}, {runs['world'].nunique()} of {len(study.worlds)} worlds\n")
        print(TABLES[study.name](store, runs) + "\n")
        for name, scenario, k, picture in PICTURES:
            if name == study.name:
                save(picture, course_pictures(store, scenario=scenario, world=study.worlds[0])[k][0])


def main(arguments: Sequence[str]) -> None:
    """Make what is asked for, see the module."""
    for argument in arguments:
        if argument == "misprints":
            print(printed_alignment().to_string(index=False))
        else:
            study_output(argument)


if __name__ == "__main__":
    main(sys.argv[1:])
