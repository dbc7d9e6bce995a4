"""Pictures and tables of the page "Swarms compared", from the results of its studies.

``python docs/swarms_compared.py results/functions-000 results/functions-2020 ...`` writes the convergence
picture (of the study that has published readings) and a picture of the ranks of each other study into
``docs/images``, and prints the page's tables.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from comparisons.convergence import convergence_bands
from comparisons.drawing import COLOURS, LINES, render, solver_styles, styled
from comparisons.overall import OverallRanks, overall_ranks, overall_words
from comparisons.printed import printed_table
from comparisons.statistics import ranked_table
from comparisons.store import ResultsStore
from comparisons.wording import format_number
from navopt import registry

IMAGES = Path(__file__).resolve().parent / "images"
PAPER = {f"{name}, published": name for name in ("PSO", "FOA", "GFOA", "IFOA")}
READINGS = ("published", "direct", "box")
FLIES = 20


@styled
def curves(store: Any, runs: Any, traces: Any) -> tuple[Figure, dict[str, dict[str, np.ndarray]]]:
    """Figure 4 of Wan et al. (2020) with quartiles over the runs: above as published, below shifted."""
    study, grid = store.study, np.arange(FLIES, 2021, FLIES)
    columns = list(study.groups["plain"])
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    panels = figure.subplots(2, len(columns), sharex=True, squeeze=False)
    medians: dict[str, dict[str, np.ndarray]] = {}
    for row, group in enumerate(study.groups.values()):
        for column, scenario in enumerate(group):
            panel = panels[row, column]
            _, bands, _, _ = convergence_bands(store, scenario=scenario, grid=grid, runs=runs, traces=traces)
            medians[scenario] = {label: bands[label][1] for label in PAPER}
            for k, (label, name) in enumerate(PAPER.items()):
                low, middle, high = bands[label]
                generation = grid / FLIES - 1
                panel.fill_between(generation, low, high, color=COLOURS[k], alpha=0.15, linewidth=0)
                panel.plot(
                    generation, middle, color=COLOURS[k], linestyle=LINES[k], linewidth=1.5, label=name
                )
            panel.set_yscale("log")
            panel.tick_params(labelsize=7.5)
            if row == 0:
                panel.set_title(scenario, fontsize=9.5)
            else:
                panel.set_xlabel("generation", fontsize=8.5)
        panels[row, 0].set_ylabel(["as published", "shifted"][row] + "\nloss above the minimum", fontsize=8.5)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure, medians


@styled
def ranks(pair: Sequence[OverallRanks], study: Any) -> Figure:
    """Mean ranks over plain functions beside those over shifted ones, in the order of the latter."""
    before, after = pair
    styles = solver_styles(study)
    figure = Figure(figsize=(7.4, 1.1 + 0.24 * len(after.mean)), layout="constrained")
    axes = figure.add_subplot()
    best = after.mean.iloc[0]
    axes.axvspan(best, best + after.critical_difference, color="#eeeeee", zorder=0)
    for y, (label, mean) in enumerate(after.mean.items()):
        colour = styles[str(label)].colour
        axes.plot([before.mean[label], mean], [y, y], color=colour, linewidth=1.2, zorder=2)
        axes.plot(before.mean[label], y, "o", color=colour, markersize=6, markerfacecolor="white", zorder=3)
        axes.plot(mean, y, "o", color=colour, markersize=7, zorder=4)
    axes.plot([], [], "o", color="#444444", markerfacecolor="white", label="as published")
    axes.plot([], [], "o", color="#444444", label="shifted")
    axes.set_yticks(range(len(after.mean)), [str(label) for label in after.mean.index])
    axes.set_ylim(len(after.mean) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(f"mean rank over {after.ranks.shape[1]} functions, {study.budget} evaluations")
    axes.legend(loc="lower left")
    return figure


def table_1(store: Any, runs: Any) -> str:
    """Printed values beside the median, least and largest loss of the published readings."""
    rows = [
        "| function | algorithm | printed | median | lowest | highest | runs lower |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in printed_table(runs, store.study).to_dict("records"):
        numbers = [row["printed"], row["median"], row["minimum"], row["maximum"]]
        digits = 6 if abs(row["median"]) > 1 and row["printed"] < -1 else 3
        texts = " | ".join(format_number(v, digits=digits) for v in numbers)
        rows.append(f"| {row['scenario']} | {PAPER[row['solver']]} | {texts} | {100 * row['lower']:.0f} % |")
    return "\n".join(rows)


def readings(store: Any, runs: Any) -> str:
    """Median gaps of every reading, plain and shifted."""
    table = ranked_table(runs, store.study).set_index(["scenario", "solver"])["median"]
    labels = [entry.label for entry in store.study.solvers]
    rows = []
    for group, scenarios in store.study.groups.items():
        rows += [f"| {group} | " + " | ".join(label.removesuffix(", shifted") for label in scenarios) + " |"]
        rows += ["|---" * (len(scenarios) + 1) + "|"]
        for label in labels:
            texts = [format_number(table[scenario, label], digits=2) for scenario in scenarios]
            rows.append(f"| {label} | " + " | ".join(texts) + " |")
        rows.append("")
    return "\n".join(rows)


def speeds(medians: dict[str, dict[str, np.ndarray]]) -> str:
    """Which algorithm has the lowest median after some generations."""
    marks = (5, 20, 50, 100)
    rows = ["| function | " + " | ".join(f"after {g}" for g in marks) + " |", "|---" * (len(marks) + 1) + "|"]
    for scenario, own in medians.items():
        first = [PAPER[min(own, key=lambda label, g=g: own[label][g])] for g in marks]
        rows.append(f"| {scenario} | " + " | ".join(first) + " |")
    return "\n".join(rows)


def sides(store: Any, runs: Any) -> str:
    """Median gaps on the shifted functions where the minimum is positive in all variables, and not."""
    study, labels = store.study, [*PAPER, "random-search"]
    rows = ["| function | worlds | " + " | ".join(labels) + " |", "|---" * (len(labels) + 2) + "|"]
    for scenario in study.groups["shifted"]:
        problem, keywords = study.place(scenario)
        minimisers = {w: registry.simulate(problem, w, **keywords).true_x for w in study.worlds}
        positive = {world for world, x in minimisers.items() if x is not None and (x > 0).all()}
        for name, worlds in (("positive", positive), ("other", set(study.worlds) - positive)):
            own = runs[(runs["scenario"] == scenario) & runs["world"].isin(worlds)]
            medians = own.groupby("solver")["score.gap_1"].median()
            texts = " | ".join(format_number(medians[label], digits=2) for label in labels)
            rows.append(f"| {scenario.removesuffix(', shifted')} | {len(worlds)} {name} | {texts} |")
    return "\n".join(rows)


def rank_table(overall: Sequence[OverallRanks]) -> str:
    """Mean ranks over both groups, in the order of the second."""
    before, after = overall
    rows = ["| solver | as published | shifted |", "|---|---|---|"]
    rows += [f"| `{name}` | {before.mean[name]:.1f} | {mean:.1f} |" for name, mean in after.mean.items()]
    return "\n".join([*rows, "", *(overall_words(one) for one in overall)])


def main(folders: Sequence[str]) -> None:
    """Write pictures and print tables of the studies in these results folders."""
    IMAGES.mkdir(exist_ok=True)
    for folder in folders:
        with ResultsStore(folder) as store:
            runs = store.runs()
            print(f"## {store.study.name}\n")
            if set(PAPER) <= {entry.label for entry in store.study.solvers}:
                figure, medians = curves(store, runs, store.traces())
                (IMAGES / "swarms-convergence.png").write_bytes(render(figure, format="png", dpi=90))
                tables = table_1(store, runs), readings(store, runs), sides(store, runs), speeds(medians)
                print("\n\n".join(tables), "\n")
                continue
            overall = overall_ranks(runs, store.study)
            picture = render(ranks(overall, store.study), format="png", dpi=100)
            (IMAGES / f"swarms-ranks-{store.study.budget}.png").write_bytes(picture)
            print(rank_table(overall), "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
