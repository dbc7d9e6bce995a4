"""The gyro calibration of Gao et al. (2015) done again: Table 3 and Figures 1 to 4, printed beside ours.

``python -m comparisons.gyro_paper --out results/gyro-paper-figures`` writes the tables and pictures; it needs
some minutes for the paper's hundred runs per phase, less with ``--runs``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import navopt
from comparisons.gyro_table import misprints, standard_errors, table_3, verdicts
from navopt.algorithms.gyro_phases import published_phases
from navopt.algorithms.inner_runs import InnerRuns, SwarmRuns, inner_runs
from navopt.algorithms.phased import Phased
from navopt.algorithms.phased_fit import PhasedFit
from navopt.errors import InvalidInput, UnknownName
from navopt.evaluation import CountingEvaluator
from navopt.problem import EstimationProblem
from navopt.problems.restricted import Restricted

__all__ = [
    "READINGS",
    "convergence",
    "identify",
    "main",
    "paper_problem",
    "write_all",
]

#: What "100 times Monte Carlo" may mean: other random numbers of the swarm, or other noise as well.
READINGS = ("seeds", "noise")
#: Plateau of the standard fish swarm in Figure 4, (°/h)².
PRINTED_PLATEAU = 0.002584
#: Worlds of Figure 4: with the noise of Table 4, nothing can be seen but its floor.
FIGURE_4_NOISE = {
    "noise of Table 4": None,
    "hardly any noise": {"deg_sqrt_h": 1e-7, "deg_h": 1e-6, "ppm": 0.0, "deg_s": 800.0},
}
#: Half width of the box, ppm: the printed field of vision for K_gx alone is 7770 ppm.
REACH_SCALE_PPM = 20000.0


def paper_problem(seed: int = 0, **scenario: Any) -> EstimationProblem:
    """One world of the paper's protocol: gyros as its Table 2, presets from a simulated turntable.

    Parameters
    ----------
    seed : int
        Seed of the noise, on the table and in the field.
    **scenario
        Keywords of `navopt.problems.GyroCalibration.simulate` to be set otherwise.

    Returns
    -------
    GyroCalibration
        All twelve parameters free, 24 positions, noise of Table 4; its nominal values are the presets.
    """
    return navopt.simulate(
        "gyro-calibration",
        seed,
        **{
            "estimated": "all",
            "protocol": "paper",
            "scale_spread_ppm": 0.0,
            "bias_spread_deg_h": 0.0,
            "misalignment_spread": 0.0,
            "reach_scale_ppm": REACH_SCALE_PPM,
            **scenario,
        },
    )


# -- Table 3 and Figures 1 to 3 ----------------------------------------------------------------------------
def identify(
    problem: EstimationProblem,
    *,
    inner: str = "nafsa",
    runs: int = 100,
    reading: str = "seeds",
    seed: int = 1,
    cycles: int = 60,
    options: Mapping[str, Any] | None = None,
) -> PhasedFit:
    """Identify the parameters as the paper does: phase by phase, the mean of many runs passed on.

    Parameters
    ----------
    problem : EstimationProblem
        From `paper_problem`.
    inner : {"nafsa", "oafsa", "afsa"}, default "nafsa"
        The fish swarm.
    runs : int, default 100
        Runs in each phase.
    reading : {"seeds", "noise"}
        Whether runs differ in the random numbers of the swarm only, on the same record, or each has a record
        of its own with other noise. The paper says that "the random factors are introduced" a hundred times.
    seed : int, default 1
        Seed of the swarms.
    cycles : int, default 60
        Iterations of each run.
    options : mapping, optional
        Keywords of the fish swarm to be set otherwise, such as ``visual_reading="rotated"``.

    Returns
    -------
    PhasedFit
    """
    settings = {**published_phases(inner), "runs_per_phase": runs, "cycles": cycles}
    settings["options"] = {**settings["options"], **(options or {})}
    if reading not in READINGS:
        raise UnknownName("reading", reading, READINGS)
    if reading == "seeds":
        return navopt.solve(problem, Phased(inner=inner, **settings), seed=seed).fitted
    return _over_noise(problem, inner, settings, seed)


def _over_noise(problem: EstimationProblem, inner: str, settings: dict[str, Any], seed: int) -> PhasedFit:
    """The same chain of phases, each run on a record of its own."""
    runs, cycles, rng = settings["runs_per_phase"], settings["cycles"], np.random.default_rng(seed)
    twins = [problem.redraw(k) for k in range(runs)]
    held, names = np.array(problem.nominal), problem.parameter_names
    columns: dict[str, list[Any]] = {key: [] for key in ("member", "runs", "run_loss", "mean", "sd")}
    indicator = []
    for label, members in problem.parameter_groups.items():
        options = {**settings["options"], **settings["group_options"][label]}
        own = np.isin(names, members)
        best, losses = np.tile(held, (runs, 1)), np.empty(runs)
        for k, twin in enumerate(twins):
            restricted = Restricted(twin, members, held)
            one = _begin(restricted, inner, options, [int(rng.integers(2**32))], cycles)
            _advance(one, restricted)
            best[k], losses[k] = restricted.inward(one.best[0]), one.best_loss[0]
        mean, sd = held.copy(), np.full(len(held), np.nan)
        mean[own], sd[own] = best[:, own].mean(axis=0), best[:, own].std(axis=0, ddof=1)
        held = mean
        for key, value in zip(columns, (own, best, losses, mean, sd), strict=True):
            columns[key].append(value)
        indicator.append(float(problem.loss(mean)))
    return PhasedFit(
        parameters=names,
        units=tuple(p.unit for p in problem.parameters),
        presets=np.array(problem.nominal),
        labels=tuple(problem.parameter_groups),
        repetition=np.zeros(len(indicator), dtype=int),
        indicator=np.array(indicator),
        x=held,
        **{key: np.array(values) for key, values in columns.items()},
    )


def _begin(
    problem: EstimationProblem, inner: str, options: dict[str, Any], seeds: Sequence[int], cycles: int
) -> InnerRuns:
    return inner_runs(inner, options, problem, seeds, evaluator=CountingEvaluator(), cycles=cycles)


def _advance(
    runs: InnerRuns, problem: EstimationProblem, seen: Callable[[InnerRuns, int], None] | None = None
) -> None:
    """Take runs to their end without pymoo's bookkeeping; `seen` is told after each batch, with its size."""
    while len(candidates := runs.ask()):
        runs.tell(candidates, problem.loss(candidates))
        if seen is not None:
            seen(runs, len(candidates))


# -- Figure 4 -----------------------------------------------------------------------------------------------
def convergence(
    problem: EstimationProblem, *, runs: int = 100, seed: int = 1, cycles: int = 60
) -> pd.DataFrame:
    """Indicator of each fish swarm against iterations, for the scale factors: Figure 4.

    Parameters
    ----------
    problem : EstimationProblem
        From `paper_problem`.
    runs, seed, cycles : int
        As for `identify`.

    Returns
    -------
    pandas.DataFrame
        ``swarm, cycle, evaluations``; ``current``, median over the runs of the lowest loss in the swarm
        after the cycle, with quartiles ``current_25`` and ``current_75``; ``first``, that of the first run;
        ``best``, median of the lowest loss ever evaluated. ``oafsa`` reads eqs. (1)-(2) as meant, a decay of
        the first values; ``oafsa, literal`` to the letter.
    """
    members = problem.parameter_groups["scale"]
    restricted = Restricted(problem, members)
    rows: list[dict[str, Any]] = []
    for name, inner, more in (
        ("afsa", "afsa", {}),
        ("oafsa", "oafsa", {"recursive": False}),
        ("oafsa, literal", "oafsa", {}),
        ("nafsa", "nafsa", {}),
    ):
        settings = published_phases(inner)
        options = {**settings["options"], **settings["group_options"]["scale"], **more}
        seeds = np.random.default_rng(seed).integers(2**32, size=runs)
        swarm = _begin(restricted, inner, options, [int(s) for s in seeds], cycles)
        if not isinstance(swarm, SwarmRuns):
            raise InvalidInput("inner", inner, "give a synchronous swarm")
        _record(name, swarm, restricted, rows)
    return pd.DataFrame(rows)


def _record(name: str, swarm: SwarmRuns, problem: EstimationProblem, rows: list[dict[str, Any]]) -> None:
    spent, noted = 0, -1

    def note(runs: InnerRuns, size: int) -> None:
        nonlocal spent, noted
        spent += size
        if isinstance(runs, SwarmRuns) and runs.cycle > noted:
            noted = runs.cycle
            current = runs.state["F"].min(axis=1)
            rows.append(
                {
                    "swarm": name,
                    "cycle": noted,
                    "evaluations": spent / len(current),
                    "current": float(np.median(current)),
                    "current_25": float(np.quantile(current, 0.25)),
                    "current_75": float(np.quantile(current, 0.75)),
                    "first": float(current[0]),
                    "best": float(np.median(runs.best_loss)),
                }
            )

    _advance(swarm, problem, note)


# -- the command --------------------------------------------------------------------------------------------
def write_all(
    out: Path, *, runs: int = 100, seed: int = 0, cycles: int = 60, vision: str = "literal"
) -> dict[str, pd.DataFrame]:
    """Write all tables (CSV) and pictures (PNG) of the reproduction.

    Parameters
    ----------
    out : pathlib.Path
        Folder, made if need be.
    runs, cycles : int
        Runs in each phase, and iterations of each.
    seed : int
        World.
    vision : {"literal", "rotated", "uniform"}
        Reading of the fields of vision of Table 1, see `navopt.algorithms.NovelFishSwarm`.

    Returns
    -------
    dict of str to pandas.DataFrame
        ``table-3, verdicts, misprints, convergence``, as written.
    """
    from comparisons.drawing import render
    from comparisons.gyro_figures import convergence_figure, identification_figure

    out.mkdir(parents=True, exist_ok=True)
    problem = paper_problem(seed)
    fits = {
        reading: identify(
            problem, runs=runs, reading=reading, cycles=cycles, options={"visual_reading": vision}
        )
        for reading in READINGS
    }
    curves = {
        label: convergence(paper_problem(seed, noise=noise), runs=runs, cycles=cycles)
        for label, noise in FIGURE_4_NOISE.items()
    }
    tables = {
        "table-3": table_3(fits, standard_errors(problem)),
        "verdicts": verdicts(fits),
        "misprints": misprints(),
        "convergence": pd.concat(curves, names=["noise"]).reset_index(level=0),
    }
    for name, table in tables.items():
        table.to_csv(out / f"{name}.csv", index=False)
    pictures = {
        f"figure-{k}": identification_figure(fits["seeds"], group)
        for k, group in enumerate(problem.parameter_groups, start=1)
    }
    pictures["figure-4"] = convergence_figure(curves, plateau=PRINTED_PLATEAU)
    for name, figure in pictures.items():
        (out / f"{name}.png").write_bytes(render(figure, format="png", dpi=100))
    return tables


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line of this module."""
    from rich.console import Console

    parser = argparse.ArgumentParser(prog="python -m comparisons.gyro_paper", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/gyro-paper-figures"))
    parser.add_argument("--runs", type=int, default=100, help="runs in each phase; the paper's are 100")
    parser.add_argument("--cycles", type=int, default=60, help="iterations of each run")
    parser.add_argument("--seed", type=int, default=0, help="world: noise in the field and on the table")
    parser.add_argument("--vision", default="literal", choices=["literal", "rotated", "uniform"],
                        help="how to read the fields of vision of Table 1")  # fmt: skip
    given = parser.parse_args(arguments)
    tables = write_all(given.out, runs=given.runs, seed=given.seed, cycles=given.cycles, vision=given.vision)
    console = Console(width=200)
    for name in ("table-3", "verdicts", "misprints"):
        console.print(f"\n{name}", style="bold")
        console.print(
            tables[name].to_string(index=False, float_format=_brief),
            markup=False,
            highlight=False,
            soft_wrap=True,
        )
    console.print(f"\ntables and pictures: {given.out}")


def _brief(value: float) -> str:
    return f"{value:.9g}"


if __name__ == "__main__":
    main()
