"""Pictures of the swarms for the pages in ``docs/algorithms``: ``python docs/figures.py [name ...]``.

Each picture shows where the individuals are at the start and after 3, 10 and 30 cycles, on the contours of
the loss. One run, one seed: a picture of how a swarm moves, not of how well it does.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pymoo.core.termination import NoTermination

import navopt
from comparisons.drawing import COLOURS, render, styled
from navopt.problems import Ackley, Shifted
from navopt.registry import solver_factory

IMAGES = Path(__file__).resolve().parent / "images"
CYCLES = (0, 3, 10, 30)
SEED = 3
#: Light, so that the individuals stand out; the lowest losses are white.
SHADES = ("#ffffff", "#f3f3f0", "#e9e9e4", "#dfdfd9", "#d4d4cc", "#c9c9c0", "#bebeb4", "#b3b3a8")


def funnel() -> Any:
    """Ackley's funnel in [-4, 4]², its minimum moved to (-1.6, 0.8): off the centre, one side negative."""
    return Shifted.to_fraction(Ackley(lower=-4.0, upper=4.0), [0.3, 0.6])


def snapshots(solver: Any, problem: Any) -> list[tuple[np.ndarray, int]]:
    """Positions of all individuals at each of `CYCLES`, and the cost until then."""
    solver.setup(problem, seed=SEED, termination=NoTermination())
    solver.next()
    shots = []
    for cycle in CYCLES:
        while solver.cycle < cycle:
            solver.next()
        shots.append((np.array(solver.state["X"]), solver.evaluator.n_eval))
    return shots


@styled
def draw(rows: Mapping[str, Any], problem: Any) -> Figure:
    """Small multiples: a row per solver, given by the label of its row, and a column per cycle."""
    grid = [np.linspace(low, high, 161) for low, high in zip(problem.xl, problem.xu, strict=True)]
    loss = problem.loss(np.stack(np.meshgrid(*grid), axis=-1))
    levels = np.linspace(loss.min(), loss.max(), len(SHADES) + 1)

    figure = Figure(figsize=(7.4, 0.4 + 1.85 * len(rows)), layout="constrained")
    panels = figure.subplots(len(rows), len(CYCLES), sharex=True, sharey=True, squeeze=False)
    for row, (label, solver) in enumerate(rows.items()):
        for panel, cycle, (X, cost) in zip(panels[row], CYCLES, snapshots(solver, problem), strict=True):
            panel.contourf(*grid, loss, levels=levels, colors=SHADES)
            panel.plot(*problem.true_x, "+", color="black", markersize=15, markeredgewidth=0.8)
            panel.plot(*X.T, "o", color=COLOURS[row], markersize=4, mew=0.4, mec="white", clip_on=False)
            panel.set_aspect("equal")
            panel.grid(False)
            panel.tick_params(labelsize=7.5)
            panel.text(0.03, 0.03, f"{cost} evaluations", transform=panel.transAxes, fontsize=6.5)
            if row == 0:
                panel.set_title("start" if cycle == 0 else f"after {cycle} cycles", fontsize=9)
            if row == len(rows) - 1:
                panel.set_xlabel("$x_1$", fontsize=8.5)
        panels[row, 0].set_ylabel(f"{label}\n$x_2$", fontsize=8.5)
    return figure


def fruit_flies() -> Figure:
    """Positions themselves, the published reciprocal of a distance, and the two improved algorithms."""
    return draw(
        {
            "foa": navopt.make_solver("foa", horizon=30),
            "foa, published": solver_factory("foa").published(),
            "ifoa-2016": navopt.make_solver("ifoa-2016", horizon=30),
            "ifoa-2020": navopt.make_solver("ifoa-2020", horizon=30),
        },
        funnel(),
    )


def bees() -> Figure:
    """A colony that changes one dimension at a time, and one that changes all."""
    return draw(
        {
            "abc": navopt.make_solver("abc"),
            'abc, dimensions\n"all"': navopt.make_solver("abc", dimensions="all"),
        },
        funnel(),
    )


def fish() -> Figure:
    """The three fish swarms, and the third with the published contraction."""
    return draw(
        {
            "afsa": navopt.make_solver("afsa"),
            "oafsa": navopt.make_solver("oafsa", horizon=30),
            "nafsa": navopt.make_solver("nafsa"),
            "nafsa, published\ncontraction": navopt.make_solver("nafsa", contraction=(1e-6, 0.999999)),
        },
        funnel(),
    )


def particles_and_genes() -> Figure:
    """The plain particle swarm with the settings of paper 000, and the genetic algorithm."""
    return draw(
        {"pso-000": navopt.make_solver("pso-000"), "ga": navopt.make_solver("ga", pop_size=20, horizon=30)},
        funnel(),
    )


PICTURES: dict[str, Callable[[], Figure]] = {
    "fruit-flies": fruit_flies,
    "bees": bees,
    "fish": fish,
    "particles-and-genes": particles_and_genes,
}


def main(names: Sequence[str]) -> None:
    """Write the named pictures, or all of them."""
    IMAGES.mkdir(exist_ok=True)
    for name in names or PICTURES:
        (IMAGES / f"{name}.png").write_bytes(render(PICTURES[name](), format="png", dpi=110))


if __name__ == "__main__":
    main(sys.argv[1:])
