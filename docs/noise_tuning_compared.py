"""Pictures and tables of the page "Noise tuning compared", from the results of its studies.

``python docs/noise_tuning_compared.py results/noise-tuning results/pushing-paper`` writes the pictures of
each study into ``docs/images`` and prints its tables; ``misprints`` as an argument needs no study.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import navopt
from comparisons.alignment_bound import printed_alignment
from comparisons.drawing import render
from comparisons.printed import printed_table
from comparisons.statistics import ranked_table, run_scores
from comparisons.store import ResultsStore
from comparisons.tuning_pictures import course_pictures
from comparisons.wording import format_number

IMAGES = Path(__file__).resolve().parent / "images"
#: A tuning counts as found if its loss is within one per cent of the lowest of all solvers in its world.
NEAR = 0.01
#: The same for the likelihood, whose zero means nothing: nats per measurement.
NEAR_NATS = 0.01
#: Pictures of the page: study, scenario, place among the pictures of a world, name.
PICTURES = (
    ("alignment-paper", "Table 3, five entries", 0, "alignment-errors"),
    ("alignment-paper", "Table 4, five entries", 1, "alignment-experiment"),
    ("pushing-paper", "artificial signal", 1, "pushing-errors"),
    ("pushing-paper", "stroke", 0, "pushing-data"),
    ("pushing-paper", "stroke", 1, "pushing-stroke"),
    ("pushing-paper", "stroke", 2, "pushing-stroke-errors"),
)


def save(name: str, figure: Figure, dpi: int = 70) -> None:
    """Write a picture of the page."""
    IMAGES.mkdir(exist_ok=True)
    data = render(figure, format="png", dpi=dpi)
    (IMAGES / f"tuning-{name}.png").write_bytes(data)
    print(f"images/tuning-{name}.png: {len(data) / 1000:.0f} kB\n")


def of(runs: pd.DataFrame, scenario: str, solver: str) -> pd.DataFrame:
    """Runs of one solver in one scenario."""
    return runs[(runs["scenario"] == scenario) & (runs["solver"] == solver)]


# -- all solvers and estimators ------------------------------------------------------------------------
def ranking(store: Any, runs: pd.DataFrame, *, unit: float = 1.0, digits: int = 4) -> str:
    """Held-out ranking score with its 95th percentile, consistency, cost and time."""
    study, lines = store.study, []
    table = ranked_table(runs, study)
    for scenario in study.scenarios:
        name, keywords = study.place(scenario)
        world = navopt.simulate(name, seed=study.worlds[0], **keywords)
        measured = int(np.isfinite(world.model.y).sum())
        band = 1.96 * np.sqrt(2.0 / measured)  # of chi-square over its degrees of freedom
        lines += [
            f"| {scenario} | median | 95th percentile | NIS in {1 - band:.2f}–{1 + band:.2f} | NEES "
            "| evaluations | time |",
            "|---|---|---|---|---|---|---|",
        ]
        here = table[table["scenario"] == scenario]
        worlds = int(here["worlds"].max())
        for solver in here["solver"]:
            own = of(runs, scenario, solver)
            if not len(own):
                continue
            scores = run_scores(own, study.rank_by) * unit
            nis, nees = own["held_out.nis_1"], own["held_out.nees_1"]
            good = f"{100 * float((abs(nis - 1) < band).mean()):.0f} %"
            time = _seconds(own["elapsed_s"].mean())
            lines.append(
                f"| {solver} | {scores.median():.{digits}f} | {scores.quantile(0.95):.{digits}f} | {good} "
                f"| {format_number(nees.median(), digits=2)} | {own['cost'].mean():.0f} | {time} |"
            )
        lines += ["", f"({worlds} worlds)", ""]
    return "\n".join(lines)


def overview(store: Any, runs: pd.DataFrame) -> str:
    """Median and 95th percentile of the ranking score in all scenarios at once, and the mean time."""
    study = store.study
    lines = [f"| | {' | '.join(study.scenarios)} | time |", "|---" * (len(study.scenarios) + 2) + "|"]
    rows = []
    for entry in study.solvers:
        cells, first = [], np.inf
        for k, scenario in enumerate(study.scenarios):
            scores = run_scores(of(runs, scenario, entry.label), study.rank_by)
            cells.append(f"{scores.median():.3f}, {scores.quantile(0.95):.3f}")
            first = scores.median() if k == 0 else first
        time = _seconds(runs[runs["solver"] == entry.label]["elapsed_s"].mean())
        rows.append((first, f"| {entry.label} | {' | '.join(cells)} | {time} |"))
    return "\n".join([*lines, *(text for _, text in sorted(rows, key=lambda row: row[0]))])


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if value >= 1.0 else f"{1e3 * value:.0f} ms"


# -- who finds the minimum -------------------------------------------------------------------------------
def gaps(store: Any, runs: pd.DataFrame) -> str:
    """Distance from the lowest loss known in each world, by solver."""
    study, lines = store.study, []
    for scenario in study.scenarios:
        _, keywords = study.place(scenario)
        oracle = keywords.get("objective") == "oracle"
        here = runs[runs["scenario"] == scenario]
        lowest = here.groupby("world")["loss"].min()
        unit = "%" if oracle else "nats per measurement"
        head = f"median gap, {unit} | largest gap | runs within {'1 %' if oracle else NEAR_NATS} | time |"
        lines += [f"| {scenario} | {head}", "|---|---|---|---|---|"]
        for entry in study.solvers:
            own = of(runs, scenario, entry.label)
            if not len(own):
                continue
            least = own["world"].map(lowest).to_numpy()
            loss = own["loss"].to_numpy(dtype=float)
            gap = 100.0 * (loss / least - 1.0) if oracle else loss - least
            near = 100.0 * float((gap < (100.0 * NEAR if oracle else NEAR_NATS)).mean())
            middle, largest = (f"{f(gap):.2g}" for f in (np.nanmedian, np.nanmax))
            seconds = _seconds(own["elapsed_s"].mean())
            lines.append(f"| {entry.label} | {middle} | {largest} | {near:.0f} % | {seconds} |")
        lines += ["", f"({here['world'].nunique()} worlds)", ""]
    return "\n".join(lines)


# -- what the papers print ------------------------------------------------------------------------------
def printed(store: Any, runs: pd.DataFrame) -> str:
    """Printed values beside ours, with the place of the printed one."""
    lines = ["| scenario | solver | score | printed | ours, median | lowest | highest | printed / ours |"]
    lines += ["|---|---|---|---|---|---|---|---|"]
    for row in printed_table(runs, store.study).to_dict("records"):
        numbers = " | ".join(f"{row[key]:.3g}" for key in ("printed", "median", "minimum", "maximum"))
        times = row["printed"] / row["median"]
        lines.append(f"| {row['scenario']} | {row['solver']} | {row['score']} | {numbers} | {times:.2g} |")
    return "\n".join(lines)


def paper_ranking(store: Any, runs: pd.DataFrame, keys: Sequence[tuple[str, str, float]]) -> str:
    """Scores of a paper's own comparison on its record, and on others."""
    study, lines = store.study, []
    for scenario in study.scenarios:
        titles = " | ".join(title for title, _, _ in keys)
        lines += [f"| {scenario} | {titles} |", "|---" * (len(keys) + 1) + "|"]
        for entry in study.solvers:
            own = of(runs, scenario, entry.label)
            cells = [
                f"{scale * own[column].median():.4g}" if len(own) and column in own else ""
                for _, column, scale in keys
            ]
            lines.append(f"| {entry.label} | {' | '.join(cells)} |")
        lines += ["", f"({runs[runs['scenario'] == scenario]['world'].nunique()} worlds)", ""]
    return "\n".join(lines)


def found_covariances(store: Any, runs: pd.DataFrame) -> str:
    """Range of Q, R and their ratio that the flies of paper 001 report, of which Table 5 prints one."""
    lines = ["| scenario | solver | Q, lowest to highest | R | Q / R, quartiles |", "|---|---|---|---|---|"]
    for scenario in store.study.scenarios:
        for solver in ("FOA", "IFOA", "IFOA, clipped", "PSO"):
            own = of(runs, scenario, solver)
            if not len(own):
                continue
            x = np.array([np.asarray(row, dtype=float) for row in own["x"]])
            low, high = np.quantile(x[:, 0] / x[:, 1], [0.25, 0.75])
            spans = " | ".join(f"{v.min():.3g} to {v.max():.3g}" for v in x.T)
            lines.append(f"| {scenario} | {solver} | {spans} | {low:.3g} to {high:.3g} |")
    return "\n".join(lines)


KEYS = {
    "pushing-paper": (
        ("mean square error, m²", "loss", 1.0),
        ("RMS, mm", "score.position_rmse_m", 1e3),
        ("RMS, other records", "held_out.position_rmse_m", 1e3),
        ("error at the end, mm", "score.final_position_error_m", 1e3),
        ("NIS", "score.nis_1", 1.0),
        ("time, s", "elapsed_s", 1.0),
    ),
    "alignment-paper": (
        ("eq. (36)", "loss", 1.0),
        ("pitch, °", "score.pitch_error_rad", np.degrees(1.0)),
        ("roll, °", "score.roll_error_rad", np.degrees(1.0)),
        ("yaw, °", "score.yaw_error_rad", np.degrees(1.0)),
        ("mean, °", "score.mean_angle_error_rad", np.degrees(1.0)),
        ("mean, other noise", "held_out.mean_angle_error_rad", np.degrees(1.0)),
        ("NIS", "score.nis_1", 1.0),
        ("time, s", "elapsed_s", 1.0),
    ),
}


def study_output(folder: str) -> None:
    """Print the tables of one study and write its pictures."""
    with ResultsStore(folder) as store:
        name, runs = store.study.name, store.runs()
        print(f"\n## {name}\n")
        if name in KEYS:
            print(paper_ranking(store, runs, KEYS[name]))
            print(printed(store, runs))
        if name == "pushing-paper":
            print(found_covariances(store, runs))
        if name == "noise-tuning":
            print(ranking(store, runs))
            print(overview(store, runs))
        if name.endswith("-fair"):
            unit, digits = (1e3, 2) if name.startswith("pushing") else (float(np.degrees(1.0)), 4)
            print(ranking(store, runs, unit=unit, digits=digits))
            print(gaps(store, runs))
        for study, scenario, k, picture in PICTURES:
            if study == name:
                world = store.study.worlds[0]
                save(picture, course_pictures(store, scenario=scenario, world=world)[k][0])


def main(arguments: Sequence[str]) -> None:
    """Make what is asked for, see the module."""
    for argument in arguments:
        if argument == "misprints":
            print(printed_alignment().to_string(index=False))
        else:
            study_output(argument)


if __name__ == "__main__":
    main(sys.argv[1:])
