"""Speed of the batched filter beside filterpy and statsmodels, on the same data in one interleaved run."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.table import Table

import navopt
from baselines.likelihood_fit import fit_innovation_likelihood
from baselines.noise_baseline import structure_of
from comparisons.speed import interleaved
from navopt.errors import MissingExtra
from navopt.filters.batch_kalman import BatchKalman
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = [
    "CASES",
    "FilterCase",
    "FilterCost",
    "clocked",
    "compile_seconds",
    "filter_costs",
    "speed_table",
    "start_seconds",
]

_COMPILE = """
import time
import numpy as np
from navopt.filters.batch_kalman import BatchKalman
from navopt.models.linear_gaussian import LinearGaussianModel
model = LinearGaussianModel(F=np.eye(2), H=np.eye(2)[:1], y=np.ones(9), P0=np.eye(2))
start = time.process_time()
BatchKalman(model).log_likelihood(np.eye(2), np.eye(1))
print(time.process_time() - start)
"""


@dataclass(frozen=True)
class FilterCase:
    """A system to be timed: random, stable and dense, or position and velocity.

    Attributes
    ----------
    name : str
    states, channels, steps : int
        Sizes.
    least_filterpy, least_statsmodels : float
        How many times faster the batched filter is meant to be.
    """

    name: str
    states: int
    channels: int
    steps: int
    least_filterpy: float
    least_statsmodels: float

    def build(self, population: int) -> tuple[LinearGaussianModel, np.ndarray, np.ndarray]:
        """Model with data, and candidates of Q and R."""
        rng = np.random.default_rng(0)
        n, m = self.states, self.channels
        if n == 2:
            F, H = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[1.0, 0.0]])
        else:
            F, H = rng.normal(size=(n, n)), rng.normal(size=(m, n))
            F *= 0.98 / np.abs(np.linalg.eigvals(F)).max()
        model = LinearGaussianModel(F=F, H=H, y=rng.normal(size=(self.steps, m)), P0=np.eye(n))
        factors = 10.0 ** rng.uniform(-1.0, 1.0, (2, population, 1, 1))
        return model, 0.01 * factors[0] * np.eye(n), factors[1] * np.eye(m)


CASES = (
    FilterCase("two states", 2, 1, 1000, 1000.0, 50.0),
    FilterCase("ten states, dense", 10, 2, 500, 200.0, 15.0),
)


@dataclass(frozen=True)
class FilterCost:
    """Processor time of the log-likelihood (filterpy: predict and update) per step and candidate.

    Attributes
    ----------
    case : FilterCase
    ours, filterpy, statsmodels : float
        Seconds per step and candidate.
    """

    case: FilterCase
    ours: float
    filterpy: float
    statsmodels: float


def filter_costs(*, population: int = 20, repeats: int = 9) -> list[FilterCost]:
    """Time the batched filter and both peers.

    Parameters
    ----------
    population : int
        Candidates.
    repeats : int
        Interleaved repetitions; the medians count.

    Returns
    -------
    list of FilterCost

    Raises
    ------
    MissingExtra
        If filterpy or statsmodels is not installed.
    """
    return [_cost(case, population, repeats) for case in CASES]


def _cost(case: FilterCase, population: int, repeats: int) -> FilterCost:
    model, Q, R = case.build(population)
    ours = BatchKalman(model)
    logs = ours.log_likelihood(Q, R)
    loop, compiled = _filterpy_loop(model, Q[0], R[0]), _statsmodels_loop(model, Q, R)
    # the same numbers before their speed
    if not np.allclose([compiled(k) for k in range(population)], logs, rtol=1e-6):
        raise AssertionError("the batched filter and statsmodels disagree")

    def all_compiled() -> None:
        for k in range(population):
            compiled(k)

    each = interleaved(
        {
            "ours": clocked(lambda: ours.log_likelihood(Q, R), 20),
            "filterpy": clocked(loop, 1),
            "statsmodels": clocked(all_compiled, 1),
        },
        repeats=repeats,
    )
    steps = case.steps
    return FilterCost(
        case,
        each["ours"] / (steps * population),
        each["filterpy"] / steps,
        each["statsmodels"] / (steps * population),
    )


def clocked(work: Callable[[], object], times: int) -> Callable[[], float]:
    """Task that reports the processor time of one call of `work`: other processes must not count."""

    def task() -> float:
        started = time.thread_time()
        for _ in range(times):
            work()
        return (time.thread_time() - started) / times

    return task


def _filterpy_loop(model: LinearGaussianModel, Q: np.ndarray, R: np.ndarray) -> Callable[[], None]:
    try:
        from filterpy.kalman import KalmanFilter
    except ImportError:
        raise MissingExtra("bench", "timing filters") from None

    kalman = KalmanFilter(model.n_states, model.n_measurements)
    kalman.F, kalman.H, kalman.Q, kalman.R = model.F, model.H, Q, R

    def loop() -> None:
        kalman.x, kalman.P = np.zeros((model.n_states, 1)), model.P0.copy()
        for z in model.y:
            kalman.predict()
            kalman.update(z)

    return loop


def _statsmodels_loop(model: LinearGaussianModel, Q: np.ndarray, R: np.ndarray) -> Callable[[int], float]:
    try:
        from statsmodels.tsa.statespace.kalman_filter import KalmanFilter
    except ImportError:
        raise MissingExtra("bench", "timing filters") from None

    n, m = model.n_states, model.n_measurements
    kalman: Any = KalmanFilter(k_endog=m, k_states=n, k_posdef=n)
    kalman.bind(np.asfortranarray(model.y.T))
    kalman["design"], kalman["transition"], kalman["selection"] = model.H, model.F, np.eye(n)
    kalman.initialize_known(model.x0, model.P0)

    def loop(k: int) -> float:
        kalman["state_cov"], kalman["obs_cov"] = Q[k], R[k]
        return float(kalman.loglike())

    return loop


def compile_seconds() -> tuple[float, float]:
    """Processor seconds of the first call in a new process, with an empty cache and with what it left."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
        times = [
            float(
                subprocess.run(
                    [sys.executable, "-c", _COMPILE],
                    env=environment,
                    capture_output=True,
                    text=True,
                    check=True,
                ).stdout
            )
            for _ in range(2)
        ]
    return times[0], times[1]


def start_seconds(*, worlds: int = 5, starts: int = 5) -> float:
    """Median over worlds of the processor seconds that one start of the innovation likelihood takes.

    Two states, 1,000 steps, two parameters; the graph was built before.
    """
    seconds = []
    for seed in range(worlds + 1):
        problem: Any = navopt.simulate("pushing-distance", seed)
        structure = structure_of(problem)
        begun = time.process_time()
        fit_innovation_likelihood(problem.model, structure, starts=starts)
        seconds.append((time.process_time() - begun) / starts)
    return float(np.median(seconds[1:]))


def speed_table(costs: list[FilterCost]) -> Table:
    """Table of the costs, with the ratios that are to be reached."""
    table = Table(
        *("filter", "ours ns", "filterpy ns", "ratio", "meant", "statsmodels ns", "ratio", "meant"),
        title="Log-likelihood of 20 candidates, per step and candidate",
    )
    for cost in costs:
        table.add_row(
            cost.case.name,
            f"{1e9 * cost.ours:.3g}",
            f"{1e9 * cost.filterpy:,.0f}",
            f"{cost.filterpy / cost.ours:,.0f}",
            f"{cost.case.least_filterpy:,.0f}",
            f"{1e9 * cost.statsmodels:,.0f}",
            f"{cost.statsmodels / cost.ours:,.0f}",
            f"{cost.case.least_statsmodels:,.0f}",
        )
    return table
