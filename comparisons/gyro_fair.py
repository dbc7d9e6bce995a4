"""How much of what the data tell a calibration gets, and at which cost: tables for the study gyro-fair.

``python -m comparisons.gyro_fair results/gyro-fair`` prints the efficiency of each solver against the
Cramér-Rao bound; ``--effort`` measures evaluations and time until the loss of least squares is reached.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import navopt
from comparisons.store import ResultsStore
from navopt import registry
from navopt.algorithms.options import number

__all__ = ["EFFORT_SOLVERS", "efficiency_table", "effort_table", "main"]

#: Whom `effort_table` compares: label, registry name, settings.
EFFORT_SOLVERS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("least squares", "norm-ls", {}),
    ("NAFSA, joint", "nafsa", {}),
    ("OAFSA, joint", "oafsa", {"horizon": 300}),
    ("SAFSA, joint", "afsa", {}),
    ("NAFSA, phased", "phased", {"inner": "nafsa", "runs_per_phase": 2, "cycles": 40}),
    ("pso", "pso", {}),
    ("de", "de", {}),
    ("cmaes", "cmaes", {}),
)


def efficiency_table(store: ResultsStore) -> pd.DataFrame:
    """Errors of the parameters against the Cramér-Rao bound, for a study with a known decision vector.

    Parameters
    ----------
    store : ResultsStore
        Of a study whose problem has ``true_x`` and residuals, as gyro-fair.

    Returns
    -------
    pandas.DataFrame
        By scenario and solver, in the study's order: ``worlds``; ``efficiency``, one over the mean of the
        squared errors in units of the bound, ``(x - true)ᵀ C⁻¹ (x - true) / n``, so 1 for an estimator that
        reaches the bound; ``low, high``, its 95 % interval from the worlds (normal, of the mean);
        ``ratio``, root mean square error over the bound's standard deviation, root mean square over the
        parameters.
    """
    study, runs = store.study, store.runs()
    rows: list[dict[str, Any]] = []
    for scenario in study.scenarios:
        problem, keywords = study.place(scenario)
        here = runs[(runs["scenario"] == scenario) & (runs["status"] != "failed")]
        worlds = {}
        for world in sorted(here["world"].unique()):
            one = registry.simulate(problem, int(world), **keywords)
            bound = one.error_bound(one.true_x)
            worlds[world] = (one.true_x, np.sqrt(np.diag(bound)), bound)
        for entry in study.solvers:
            own = here[here["solver"] == entry.label]
            if own.empty:
                continue
            squares, errors = [], []
            for x, world in zip(own["x"], own["world"], strict=True):
                true, sd, bound = worlds[world]
                scaled = (np.asarray(x, dtype=float) - true) / sd
                # correlations first: parameters of different units have no common condition number
                squares.append(scaled @ np.linalg.solve(bound / np.outer(sd, sd), scaled) / len(scaled))
                errors.append(scaled**2)
            mean = float(np.mean(squares))
            half = (
                1.96 * float(np.std(squares, ddof=1)) / np.sqrt(len(squares)) if len(squares) > 1 else np.nan
            )
            rows.append(
                {
                    "scenario": scenario,
                    "solver": entry.label,
                    "worlds": len(squares),
                    "efficiency": 1.0 / mean,
                    "low": 1.0 / (mean + half),
                    "high": 1.0 / (mean - half) if mean > half else np.inf,
                    "ratio": float(np.sqrt(np.mean(errors))),
                }
            )
    return pd.DataFrame(rows)


def effort_table(
    *,
    worlds: Sequence[int] = range(5),
    budget: int = 100_000,
    excess: float = 1e-3,
    solvers: Sequence[tuple[str, str, dict[str, Any]]] = EFFORT_SOLVERS,
    **scenario: Any,
) -> pd.DataFrame:
    """Evaluations and seconds until a solver comes as low as least squares.

    Parameters
    ----------
    worlds : sequence of int
        Seeds of the worlds.
    budget : int
        Largest cost of a run.
    excess : float
        How far above the loss of least squares counts as the same, as a share of it.
    solvers : sequence of (label, name, settings)
        Whom to compare.
    **scenario
        Keywords of `navopt.problems.GyroCalibration.simulate`.

    Returns
    -------
    pandas.DataFrame
        By solver: ``reached``, in how many of the ``worlds``; median ``cost`` and ``seconds`` of those runs;
        ``cost per evaluation`` is one, a Jacobian one per parameter. A run of least squares costs what
        it needs to converge, not only to come so near.
    """
    number("excess", excess, above=0.0)
    found: dict[str, list[tuple[bool, int, float]]] = {label: [] for label, _, _ in solvers}
    for world in worlds:
        problem = navopt.simulate("gyro-calibration", int(world), **{"estimated": "frame", **scenario})
        navopt.solve(problem, "norm-ls")  # compiles
        target = navopt.solve(problem, "norm-ls").loss * (1.0 + excess)
        for label, name, settings in solvers:
            solver = navopt.make_solver(name, **settings)
            solution = navopt.solve(problem, solver, budget=budget, target=target, seed=int(world) + 1)
            trace = solution.trace
            there = np.flatnonzero(trace["loss"] <= target)
            reached = len(there) > 0
            found[label].append(
                (
                    reached,
                    int(solution.counts.cost if name == "norm-ls" else trace["cost"][there[0]])
                    if reached
                    else -1,
                    solution.elapsed_s,
                )
            )
    rows = []
    for label, results in found.items():
        hits = [result for result in results if result[0]]
        rows.append(
            {
                "solver": label,
                "worlds": len(results),
                "reached": len(hits),
                "cost": float(np.median([hit[1] for hit in hits])) if hits else np.nan,
                "seconds": float(np.median([hit[2] for hit in hits])) if hits else np.nan,
            }
        )
    return pd.DataFrame(rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line of this module."""
    from rich.console import Console

    parser = argparse.ArgumentParser(prog="python -m comparisons.gyro_fair", description=__doc__)
    parser.add_argument("results", nargs="?", type=Path, help="results folder of the study gyro-fair")
    parser.add_argument("--effort", action="store_true", help="measure evaluations and time to the same loss")
    parser.add_argument("--worlds", type=int, default=5, help="how many worlds for --effort")
    parser.add_argument("--budget", type=int, default=100_000, help="largest cost of a run for --effort")
    given = parser.parse_args(arguments)
    console = Console(width=160)
    if given.results is not None:
        with ResultsStore(given.results) as store:
            table = efficiency_table(store)
        console.print(table.to_string(index=False), markup=False, highlight=False)
    if given.effort:
        table = effort_table(worlds=range(given.worlds), budget=given.budget)
        console.print(table.to_string(index=False), markup=False, highlight=False)


if __name__ == "__main__":
    main()
