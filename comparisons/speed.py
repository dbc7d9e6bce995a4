"""Speed, always as a ratio to a named peer measured in the same run: ``python -m comparisons.speed``.

Every figure is the median of interleaved repetitions, so that a busy machine slows both sides alike.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from pymoo.core.termination import NoTermination
from rich.console import Console
from rich.table import Table
from scipy.ndimage import map_coordinates

import navopt
from baselines.tercom import Tercom
from navopt.problems.gravity_matching import GravityMatching

__all__ = ["clocked", "interleaved", "iteration", "main", "measure"]


def interleaved(tasks: dict[str, Callable[[], float]], *, repeats: int = 9) -> dict[str, float]:
    """Median result of each task, run in turn `repeats` times; a task returns its own seconds."""
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(repeats):
        for name, task in tasks.items():
            seconds[name].append(task())
    return {name: float(np.median(values)) for name, values in seconds.items()}


def clocked(work: Callable[[], object], times: int) -> Callable[[], float]:
    """Task that reports the seconds one call of `work` takes, averaged over `times` calls."""

    def task() -> float:
        started = time.perf_counter()
        for _ in range(times):
            work()
        return (time.perf_counter() - started) / times

    return task


def iteration(name: str, world: GravityMatching, *, pop_size: int, batches: int = 100) -> Callable[[], float]:
    """Task that reports the seconds of one pymoo iteration of a solver beyond evaluating its batch."""

    def task() -> float:
        algorithm = navopt.make_solver(name, pop_size=pop_size)
        algorithm.setup(world, seed=1, termination=NoTermination())
        algorithm.next()
        started = time.perf_counter()
        for _ in range(batches):
            algorithm.next()
        total = time.perf_counter() - started
        candidates = np.tile(world.nominal, (pop_size, 1))
        return total / batches - clocked(lambda: world.loss(candidates), 50)()

    return task


def measure(*, repeats: int = 9) -> list[tuple[str, str, float, str, float]]:
    """Run all measurements.

    Parameters
    ----------
    repeats : int
        Interleaved repetitions of each.

    Returns
    -------
    list of (what, ours, seconds, peer, seconds of the peer)
    """
    world = navopt.simulate("gravity-matching", 0)
    assert isinstance(world, GravityMatching)
    rows = []
    cost = interleaved(
        {name: iteration(name, world, pop_size=10) for name in ("abc", "affine-abc", "pso")}, repeats=repeats
    )
    for name in ("abc", "affine-abc"):
        rows.append(
            ("iteration beyond the loss, population 10", name, cost[name], "pso (pymoo)", cost["pso"])
        )
    rows.append(
        ("cycle (two iterations) beyond the loss", "abc", 2 * cost["abc"], "pso iteration", cost["pso"])
    )

    tercom = Tercom()
    tercom.setup(world)
    shifts = np.linspace(-30e3, 30e3, 121)
    values, lat0, lon0, dlat, dlon = world.field_map.grid
    inertial = world.estimate(world.nominal)
    rows_of, columns_of = (inertial.latitude - lat0) / dlat, (inertial.longitude - lon0) / dlon
    meridian, parallel = world.metres_per_radian

    def brute_force() -> np.ndarray:
        row = rows_of[:, None, None] + (shifts / (meridian * dlat))[:, None]
        column = columns_of[:, None, None] + shifts / (parallel * dlon)
        at = np.broadcast_arrays(row, column)
        mapped = map_coordinates(values, at, order=1, mode="constant", cval=np.nan)
        return np.abs(world.measured[:, None, None] - mapped).mean(axis=0)

    assert np.allclose(tercom.surface(shifts, shifts), np.nan_to_num(brute_force(), nan=np.inf))
    grid = interleaved(
        {
            "ours": clocked(lambda: tercom.surface(shifts, shifts), 20),
            "scipy": clocked(brute_force, 3),
        },
        repeats=repeats,
    )
    rows.append(
        ("TERCOM, 121 × 121 shifts × 12 points", "tercom", grid["ours"], "map_coordinates", grid["scipy"])
    )

    candidates = np.random.default_rng(0).uniform(world.xl, world.xu, (10_000, 4))
    points = [world.estimate(x) for x in candidates[:1000]]
    latitude = np.array([p.latitude for p in points])
    longitude = np.array([p.longitude for p in points])

    def scipy_losses() -> np.ndarray:
        at = ((latitude - lat0) / dlat, (longitude - lon0) / dlon)
        return np.abs(world.measured - map_coordinates(values, at, order=1)).mean(axis=1)

    loss = interleaved(
        {"ours": clocked(lambda: world.loss(candidates), 3), "scipy": clocked(scipy_losses, 3)},
        repeats=repeats,
    )
    rows.append(
        (
            "one match evaluated, in a large batch",
            "GravityMatching.loss",
            loss["ours"] / 10_000,
            "map_coordinates, placed points",
            loss["scipy"] / 1000,
        )
    )
    return rows


def main() -> None:
    """Print the tables of measurements: kernels, swarms, and the fish's cycles."""
    from comparisons.speed_swarms import fish_costs, swarm_costs

    console = Console(width=135)
    table = Table("what", "ours", "ms", "peer", "ms", "ours / peer", title="Speed (medians, interleaved)")
    for what, ours, seconds, peer, peer_seconds in measure():
        table.add_row(
            what,
            ours,
            f"{1e3 * seconds:.4g}",
            peer,
            f"{1e3 * peer_seconds:.4g}",
            f"{seconds / peer_seconds:.2f}",
        )
    console.print(table)

    swarms = Table(
        *("swarm, 20 individuals", "problem", "evaluations", "batches", "ms / batch", "ms / cycle"),
        *("pso ms", "batch / pso", "cycle / pso"),
        title="A cycle beyond the loss, beside an iteration of pymoo's particle swarm",
    )
    for cost in swarm_costs():
        cycle = (1e3 * cost.seconds, 1e3 * cost.peer_seconds)
        batch = cost.seconds / cost.batches if cost.batches else None
        swarms.add_row(
            cost.solver,
            cost.problem,
            # a search in a kernel of its own has no batches
            *(f"{value:.1f}" if batch else "own kernel" for value in (cost.evaluations, cost.batches)),
            f"{1e3 * batch:.3g}" if batch else "–",
            *(f"{value:.3g}" for value in cycle),
            f"{batch / cost.peer_seconds:.2f}" if batch else "–",
            f"{cost.seconds / cost.peer_seconds:.2f}",
        )
    console.print(swarms)

    fish = Table(
        *("fish swarm", "fish", "attempts", "evaluations", "ms / cycle", "µs / evaluation"),
        *("peak kB", "state kB", "random kB"),
        title="A cycle of the fish swarms on a sphere of ten variables",
    )
    for each in fish_costs():
        fish.add_row(
            *(each.solver, str(each.pop_size), str(each.try_number), f"{each.evaluations:.0f}"),
            *(f"{1e3 * each.seconds:.3g}", f"{1e6 * each.seconds / each.evaluations:.3g}"),
            *(f"{value / 1e3:.3g}" for value in (each.peak_bytes, each.state_bytes, each.draw_bytes)),
        )
    console.print(fish)


if __name__ == "__main__":
    main()
