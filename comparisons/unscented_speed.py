"""Speed of the unscented filters of heading-aided alignment beside filterpy's, in one interleaved run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rich.table import Table

from comparisons.filter_speed import clocked
from comparisons.speed import interleaved
from navopt.errors import InvalidInput, MissingExtra
from navopt.filters.heading_filter import HeadingFilter, HeadingInputs, filter_heading
from navopt.filters.unscented import UnscentedFilter
from navopt.models.azimuth_error import advance, alignment_process, azimuth_constants, heading_measurement
from navopt.models.static_alignment import StaticSite

__all__ = ["UnscentedCost", "alignment_record", "unscented_costs", "unscented_table"]

RATE = 100.0
#: What a record of 1,500 s is meant to take at most with SST-UKF, s.
MEANT = 4.0
LONG = 1500.0
VARIANTS = ("ekf", "ukf", "srukf", "st-ukf", "sst-ukf")
DEGREE = np.pi / 180.0


@dataclass(frozen=True)
class UnscentedCost:
    """Processor time of one filter.

    Attributes
    ----------
    name : str
    every : int
        Measurements come at every so many predictions.
    step : float
        Seconds per prediction, with its share of measurements.
    """

    name: str
    every: int
    step: float

    @property
    def record(self) -> float:
        """Seconds for a record of 1,500 s at 100 Hz."""
        return LONG * RATE * self.step


def alignment_record(seconds: float, every: int) -> tuple[HeadingInputs, dict[str, Any]]:
    """Record at rest at 100 Hz with the sensors of paper 002, and what a filter of it needs.

    Parameters
    ----------
    seconds : float
        Length.
    every : int
        Velocities and heading are measured at every so many steps.

    Returns
    -------
    tuple
        The record, and keywords of `HeadingFilter`: eleven states, heading measured as one of them.
    """
    rng = np.random.default_rng(0)
    constants = azimuth_constants(StaticSite(latitude=45.0 * DEGREE), np.eye(3))
    T = max(2, round(seconds * RATE))
    sigma = np.array([0.1, 0.1, 0.028 * DEGREE])
    accelerometer, gyro = 1e-3 * 9.80665, 0.01 * DEGREE
    x = np.array([0, 0, DEGREE, DEGREE, 15 * DEGREE, 0, accelerometer, accelerometer, gyro, gyro, gyro])
    x[5] = heading_measurement(x, constants)
    z = np.full((T, 3), np.nan)
    noise = sigma * rng.normal(size=(T, 3))
    for k in range(T):
        if k % every == 0:
            z[k] = np.array([x[0], x[1], heading_measurement(x, constants)]) + noise[k]
        x = advance(x, 1.0 / RATE, constants, True)
    spread = np.array([1, 1, DEGREE, DEGREE, 30 * DEGREE, 30 * DEGREE, *[accelerometer] * 2, *[gyro] * 3])
    P0 = np.diag(spread**2)
    # the heading error is the azimuth error and a little more
    P0[4, 5] = P0[5, 4] = 0.9999 * P0[4, 4]
    Q = np.diag(np.array([5e-5] * 2 + [5e-4 * DEGREE] * 4 + [0.0] * 5) ** 2)
    return (
        HeadingInputs(np.arange(T) / RATE, z, constants),
        {"Q": Q, "R": np.diag(sigma**2), "P0": P0, "heading": "state"},
    )


def unscented_costs(
    *, repeats: int = 3, seconds: float = LONG, filterpy_seconds: float = 4.0
) -> list[UnscentedCost]:
    """Time every variant with measurements at every tenth and at every step, and two loops in Python.

    Parameters
    ----------
    repeats : int
        Interleaved repetitions; medians count.
    seconds : float
        Length of the records of the compiled filters; a tenth of it where every step has a measurement.
    filterpy_seconds : float
        Length of the stretch that filterpy and `UnscentedFilter` filter; only their time per step is used.

    Returns
    -------
    list of UnscentedCost

    Raises
    ------
    MissingExtra
        If filterpy is not installed.
    InvalidInput
        If a length is not positive.
    """
    for name, value in (("seconds", seconds), ("filterpy_seconds", filterpy_seconds)):
        if not value > 0.0:
            raise InvalidInput(name, value, "give a positive length")
    tasks: dict[str, Callable[[], float]] = {}
    steps: dict[str, tuple[str, int, int]] = {}

    def add(name: str, every: int, length: int, work: Callable[[], object]) -> None:
        work()
        key = f"{name} {every}"
        tasks[key], steps[key] = clocked(work, 1), (name, every, length)

    for every in (10, 1):
        record, settings = alignment_record(seconds * every / 10.0, every)
        for variant in VARIANTS:
            chosen = HeadingFilter(variant=variant, **settings)
            add(variant, every, len(record.times), partial(filter_heading, record, chosen, thin=100))
        record, settings = alignment_record(filterpy_seconds, every)
        loop = _filterpy_loop(record, settings)
        ours = _python_loop(record, settings)
        # the same numbers before their speed
        exact = filter_heading(record, HeadingFilter(variant="ukf", alpha=1.0, **settings)).estimates[-1]
        if not (
            np.allclose(loop(), exact, rtol=1e-6, atol=1e-9)
            and np.allclose(ours(), exact, rtol=1e-6, atol=1e-9)
        ):
            raise AssertionError("the compiled filter and filterpy disagree")
        add("filterpy, UKF", every, len(record.times), loop)
        add("UnscentedFilter, UKF", every, len(record.times), ours)
    each = interleaved(tasks, repeats=repeats)
    return [UnscentedCost(name, every, each[key] / length) for key, (name, every, length) in steps.items()]


def _filterpy_loop(record: HeadingInputs, settings: dict[str, Any]) -> Callable[[], np.ndarray]:
    try:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
    except ImportError:
        raise MissingExtra("bench", "timing filters") from None

    constants, dt = record.constants[0], 1.0 / RATE
    rows = [0, 1, 5]

    def loop() -> np.ndarray:
        kalman = UnscentedKalmanFilter(
            11, 3, dt, lambda x: x[rows], lambda x, dt: advance(x, dt, constants, True),
            MerweScaledSigmaPoints(11, 1.0, 2.0, 0.0),
        )  # fmt: skip
        kalman.P, kalman.Q, kalman.R = settings["P0"].copy(), settings["Q"], settings["R"]
        kalman.sigmas_f = kalman.points_fn.sigma_points(kalman.x, kalman.P)
        for k, z in enumerate(record.measurements):
            if k:
                kalman.predict()
            if not np.isnan(z[0]):
                kalman.update(z)
        return np.array(kalman.x)

    return loop


def _python_loop(record: HeadingInputs, settings: dict[str, Any]) -> Callable[[], np.ndarray]:
    constants = record.constants[0]
    H = np.zeros((3, 11))
    H[0, 0] = H[1, 1] = H[2, 5] = 1.0
    general = UnscentedFilter(
        lambda states, u, dt: alignment_process(states, constants, dt), H, Q=settings["Q"], R=settings["R"],
        P0=settings["P0"], alpha=1.0,
    )  # fmt: skip
    return lambda: general.run(record.times, record.measurements).estimates[-1]


def unscented_table(costs: list[UnscentedCost]) -> Table:
    """Table of the costs, with the ratios to filterpy and to the three-transform form."""
    table = Table(
        *("filter", "measured at", "µs per step", "1,500 s", "filterpy / this", "this / st-ukf"),
        title=f"Eleven states, 100 Hz, one core (SST-UKF, 10 Hz: at most {MEANT:g} s meant)",
    )
    by = {(cost.name, cost.every): cost.step for cost in costs}
    for cost in costs:
        table.add_row(
            cost.name,
            f"{RATE / cost.every:.0f} Hz",
            f"{1e6 * cost.step:.3g}",
            f"{cost.record:.3g} s",
            f"{by['filterpy, UKF', cost.every] / cost.step:.3g}",
            f"{cost.step / by['st-ukf', cost.every]:.2f}",
        )
    return table
