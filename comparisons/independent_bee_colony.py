"""`BeeColony` against an independent one: ``python -m comparisons.independent_bee_colony``.

The other one is ``bee_colony`` of pygmo (extra ``bench``; C++ of the pagmo developers), read and then
probed as a black box. Both get the same functions, population, limit and number of evaluations, and what is
compared are distributions over runs. Where the two programs differ as algorithms, variants of ours take
over pygmo's reading one step at a time, so that a difference is explained and not guessed at:

========================  ========================================  ====================================
what                      ours                                      pygmo 2.20
========================  ========================================  ====================================
sources                   `pop_size`                                size of the population
trial                     one dimension, another source, clipped    the same
acceptance                lower loss                                the same
moves                     `update`                                  one after another
onlookers                 roulette, set up once per cycle           going round, each source accepted
                                                                    with its probability
abandoned after           more than `limit` failures                `limit` failures
scout                     ends the cycle                            instead of its employed bee
**loss of its source**    its own                                   **that of the abandoned one**
evaluations per cycle     ``2 pop_size``, one more with a scout     ``2 pop_size``
========================  ========================================  ====================================

The last but one is the only departure from the published algorithm: after a scout pygmo goes on comparing
with the loss of the source that was abandoned (``tests/test_independent_bee_colony.py`` shows it by a
scripted function), so the new source accepts nothing until a trial beats the old one.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy.stats

from comparisons.effects import vargha_delaney
from comparisons.measures import holm
from navopt.algorithms.bee_colony import BeeColony
from navopt.algorithms.swarm import Arrays
from navopt.errors import MissingExtra
from navopt.problem import EstimationProblem
from navopt.problems import Ackley, Griewank, Rosenbrock, Shifted, Wood

__all__ = [
    "FLOOR",
    "TARGET",
    "VARIANTS",
    "KeepingBeeColony",
    "Runs",
    "compare",
    "functions",
    "main",
    "ours",
    "pygmo_runs",
]

#: Errors below this count as this.
FLOOR = 1e-12
#: Error whose first evaluation is noted.
TARGET = 1e-3
POP_SIZE, LIMIT, BUDGET, SEEDS = 20, 100, 20_000, 100
#: Level of the family of tests.
SIGNIFICANCE = 0.01


class KeepingBeeColony(BeeColony):
    """`BeeColony` with pygmo's scout: the new source is compared by the loss of the abandoned one."""

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """As `BeeColony.select`, but a scout does not change the losses."""
        after = super().select(state, draws, phase, candidates, losses, mask)
        return {**after, "F": state["F"]} if phase == "scout" else after


#: Ours as asked, and the steps from there to pygmo, by label.
VARIANTS: dict[str, Callable[[], BeeColony]] = {
    "synchronous": lambda: BeeColony(pop_size=POP_SIZE, limit=LIMIT),
    "sequential": lambda: BeeColony(pop_size=POP_SIZE, limit=LIMIT, update="sequential"),
    "synchronous, at the limit": lambda: BeeColony(pop_size=POP_SIZE, limit=LIMIT - 1),
    "sequential, at the limit": lambda: BeeColony(pop_size=POP_SIZE, limit=LIMIT - 1, update="sequential"),
    "synchronous, at the limit, old loss": lambda: KeepingBeeColony(pop_size=POP_SIZE, limit=LIMIT - 1),
    "sequential, at the limit, old loss": lambda: KeepingBeeColony(
        pop_size=POP_SIZE, limit=LIMIT - 1, update="sequential"
    ),
}


def functions(seed: int = 0) -> dict[str, EstimationProblem]:
    """Ackley's, Griewank's and Rosenbrock's functions of ten variables and Wood's, each shifted once."""
    plain = {"Ackley": Ackley(10), "Griewank": Griewank(10), "Rosenbrock": Rosenbrock(10), "Wood": Wood()}
    return {name: Shifted.draw(base, seed) for name, base in plain.items()}


@dataclass(frozen=True)
class Runs:
    """What a number of runs ended with.

    Attributes
    ----------
    errors : ndarray, shape (runs,)
        Lowest loss minus the minimum.
    reached : ndarray, shape (runs,)
        Evaluations until the error was `TARGET` or less; ``inf`` if it never was.
    budget : int
        Evaluations of each run.
    """

    errors: np.ndarray
    reached: np.ndarray
    budget: int

    @property
    def logs(self) -> np.ndarray:
        """Decimal logarithms of the errors, not below that of `FLOOR`."""
        return np.log10(np.maximum(self.errors, FLOOR))


def ours(
    algorithm: BeeColony, problem: EstimationProblem, seeds: Sequence[int], budget: int = BUDGET
) -> Runs:
    """Run a colony with many seeds in lockstep: bit for bit the runs of `navopt.solve`.

    Parameters
    ----------
    algorithm : BeeColony
        With any `update`; not changed.
    problem : EstimationProblem
        With a ``minimum``.
    seeds : sequence of int
        Solver seeds.
    budget : int
        Evaluations of each run; the batch that would exceed it is cut.
    """
    rngs = [np.random.default_rng(seed) for seed in seeds]
    n, d = algorithm.pop_size, problem.n_var
    constants = algorithm.constants(problem)
    count = np.zeros(len(rngs), dtype=np.int64)
    best, reached = np.full(len(rngs), np.inf), np.full(len(rngs), np.inf)
    lowest = float(problem.minimum)

    def evaluate(candidates: np.ndarray, mask: np.ndarray) -> np.ndarray:
        losses = np.full(mask.shape, np.inf)
        losses[mask] = problem.loss(candidates[mask])
        at = count[:, None] + np.cumsum(mask, axis=1)
        counted = np.where(mask & (at <= budget), losses, np.inf)
        best[:] = np.minimum(best, counted.min(axis=1))
        reached[:] = np.minimum(reached, np.where(counted - lowest <= TARGET, at, np.inf).min(axis=1))
        count[:] += mask.sum(axis=1)
        return losses

    def drawn(draw: Callable[..., Arrays]) -> Arrays:
        draws = [draw(rng, n, d) for rng in rngs]
        return {key: np.stack([one[key] for one in draws]) for key in draws[0]}

    first = algorithm.initialize(constants, drawn(algorithm.draw_initial))
    state = algorithm.found(constants, first, evaluate(first, np.ones(first.shape[:-1], dtype=bool)))
    while count.min() < budget:
        draws = drawn(algorithm.draw)
        for phase, only in algorithm.batches:
            candidates, mask = algorithm.move(state, draws, phase)
            if only is not None:
                mask = mask & (np.arange(n) == only)
            if mask.any():
                losses = evaluate(candidates, mask)
                state = algorithm.select(state, draws, phase, candidates, losses, mask)
    return Runs(best - lowest, reached, budget)


class _Counted:
    """Problem of pygmo that evaluates one of ours and notes what happens within the budget."""

    def __init__(self, problem: EstimationProblem, budget: int) -> None:
        self.problem, self.budget = problem, budget
        self.lowest = float(problem.minimum)
        self.count, self.best, self.reached = 0, np.inf, np.inf

    def __deepcopy__(self, memo: dict[int, Any]) -> _Counted:
        return self  # pygmo copies its problems; the notes must stay in one place

    def fitness(self, x: np.ndarray) -> list[float]:
        loss = float(self.problem.loss(x))
        self.count += 1
        if self.count <= self.budget and loss < self.best:
            self.best = loss
            if self.reached == np.inf and loss - self.lowest <= TARGET:
                self.reached = float(self.count)
        return [loss]

    def get_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.problem.xl, self.problem.xu


def pygmo_runs(
    problem: EstimationProblem,
    seeds: Sequence[int],
    budget: int = BUDGET,
    *,
    pop_size: int = POP_SIZE,
    limit: int = LIMIT,
) -> Runs:
    """Run pygmo's ``bee_colony`` with many seeds, each for `budget` evaluations, counted by the problem.

    Parameters
    ----------
    problem : EstimationProblem
        With a ``minimum``.
    seeds : sequence of int
        Seed k draws the population with ``2 k`` and seeds the algorithm with ``2 k + 1``.
    budget : int
        Evaluations of each run that count, those of the first population included.
    pop_size, limit : int, keyword-only
        Sources, and failures after which one is abandoned.

    Raises
    ------
    MissingExtra
        If pygmo is not installed.
    """
    try:
        import pygmo
    except ImportError:
        raise MissingExtra("bench", "comparing with pygmo's bee colony (wheels for Linux)") from None
    errors, reached = [], []
    generations = -(-(budget - pop_size) // (2 * pop_size))
    for seed in seeds:
        notes = _Counted(problem, budget)
        population = pygmo.population(pygmo.problem(notes), pop_size, seed=2 * seed)
        colony = pygmo.bee_colony(gen=generations, limit=limit, seed=2 * seed + 1)
        pygmo.algorithm(colony).evolve(population)
        errors.append(notes.best - notes.lowest)
        reached.append(notes.reached)
    return Runs(np.array(errors), np.array(reached), budget)


def _log_rank(first: Runs, second: Runs) -> float:
    """p-value of the log-rank test on the evaluations to the target, runs without it censored at the end."""
    samples = []
    for runs in (first, second):
        hit = np.isfinite(runs.reached)
        samples.append(
            scipy.stats.CensoredData(
                uncensored=runs.reached[hit], right=np.full(int((~hit).sum()), float(runs.budget))
            )
        )
    if not np.isfinite(np.concatenate([first.reached, second.reached])).any():
        return 1.0  # nobody arrived: nothing tells them apart
    return float(scipy.stats.logrank(*samples).pvalue)


def compare(mine: dict[str, Runs], theirs: dict[str, Runs]) -> pd.DataFrame:
    """Compare two samples of runs on each function.

    Parameters
    ----------
    mine, theirs : dict of str to Runs
        Samples by function, the same functions in both.

    Returns
    -------
    pandas.DataFrame
        Per function: ``median, median_other`` (of the log errors), ``a12`` (probability that ours is the
        smaller), ``ks, mann_whitney`` (p-values, two-sided), ``share, share_other`` of runs that reached
        `TARGET`, ``log_rank``; ``error_holm`` and ``evaluations_holm``: the smallest p-value of the function
        adjusted by Holm's rule over all functions, over both tests for the errors.
    """
    rows = []
    for name, first in mine.items():
        second = theirs[name]
        rows.append(
            {
                "function": name,
                "median": float(np.median(first.logs)),
                "median_other": float(np.median(second.logs)),
                "a12": vargha_delaney(first.logs, second.logs),
                "ks": float(scipy.stats.ks_2samp(first.logs, second.logs).pvalue),
                "mann_whitney": float(scipy.stats.mannwhitneyu(first.logs, second.logs).pvalue),
                "share": float(np.isfinite(first.reached).mean()),
                "share_other": float(np.isfinite(second.reached).mean()),
                "log_rank": _log_rank(first, second),
            }
        )
    table = pd.DataFrame(rows)
    both = holm(table[["ks", "mann_whitney"]].to_numpy().ravel()).reshape(-1, 2)
    table["error_holm"] = both.min(axis=1)
    table["evaluations_holm"] = holm(table["log_rank"].to_numpy())
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the comparison; ``--runs`` and ``--budget`` make it smaller.

    Parameters
    ----------
    arguments : sequence of str, optional
        Arguments of the command line; those of the process if not given.
    """
    from rich.console import Console
    from rich.table import Table

    parser = argparse.ArgumentParser(description="BeeColony against pygmo's bee_colony")
    parser.add_argument("--runs", type=int, default=SEEDS, help="runs of each, with seeds from 0 on")
    parser.add_argument("--budget", type=int, default=BUDGET, help="evaluations of each run")
    parser.add_argument("--shift", type=int, default=0, help="seed of the shifts")
    parser.add_argument("--variants", nargs="*", default=list(VARIANTS), choices=list(VARIANTS))
    options = parser.parse_args(arguments)
    seeds, problems = range(options.runs), functions(options.shift)
    theirs = {name: pygmo_runs(problem, seeds, options.budget) for name, problem in problems.items()}
    console = Console(width=120)
    for label in options.variants:
        mine = {name: ours(VARIANTS[label](), p, seeds, options.budget) for name, p in problems.items()}
        table = Table(
            "function", "log10 error", "pygmo", "A12", "KS p", "MW p", "Holm", f"to {TARGET:g}", "pygmo",
            "log-rank p", "Holm", "verdict",
            title=f"BeeColony, {label}: {options.runs} runs of {options.budget} evaluations",
        )  # fmt: skip
        for row in compare(mine, theirs).to_dict("records"):
            agrees = min(row["error_holm"], row["evaluations_holm"]) >= SIGNIFICANCE
            table.add_row(
                row["function"],
                *(f"{row[key]:.2f}" for key in ("median", "median_other", "a12")),
                *(f"{row[key]:.2g}" for key in ("ks", "mann_whitney", "error_holm")),
                *(f"{100 * row[key]:.0f} %" for key in ("share", "share_other")),
                *(f"{row[key]:.2g}" for key in ("log_rank", "evaluations_holm")),
                "agrees" if agrees else "differs",
            )
        console.print(table)


if __name__ == "__main__":
    main()
