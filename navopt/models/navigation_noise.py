"""What the sensors do wrong on a run, whatever their calibration: drawn once, for every model of the run."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from navopt.errors import InvalidInput
from navopt.models.navigation_scenarios import NavigationScenario

__all__ = ["RunErrors", "draw_run_errors"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RunErrors:
    """Errors of the sensors on W runs, in the axes of the triads (right, forward, up).

    Attributes
    ----------
    bias : ndarray, shape (W, 6)
        Constant during a run: gyros (rad/s), accelerometers (m/s^2).
    scale : ndarray, shape (W, 3)
        Relative errors of the gyros' scale factors, constant during a run.
    white : ndarray, shape (W, K, 6)
        White noise, averaged over each of the K steps of the scenario.
    alignment : ndarray, shape (W, 6)
        White noise, averaged over the alignment.
    reference : ndarray, shape (W, K + 1, 2)
        Errors of the reference positions (north, east), m.
    """

    bias: Array
    scale: Array
    white: Array
    alignment: Array
    reference: Array

    def __post_init__(self) -> None:
        for item in fields(self):
            getattr(self, item.name).setflags(write=False)


def draw_run_errors(scenario: NavigationScenario, worlds: int, seed: int | None) -> RunErrors:
    """Draw what the sensors do wrong on some runs.

    Parameters
    ----------
    scenario : NavigationScenario
        Holds the noise of the sensors.
    worlds : int
        Number W of runs. A run's errors depend on the seed and its own number only.
    seed : int or None
        Needed if the scenario has any noise.

    Returns
    -------
    RunErrors

    Raises
    ------
    InvalidInput
        If noise is asked for without a seed.

    Notes
    -----
    A data sheet's "bias instability" and "scale-factor stability" are taken as the standard deviations of
    what a run adds to the calibrated values, constant during the run: the reading on which a day of
    navigation depends most. White noise is constant within a step of the scenario.
    """
    gyro, accelerometer = scenario.gyro_noise, scenario.accelerometer_noise
    steps = scenario.steps
    noisy = gyro is not None or accelerometer is not None or scenario.reference_sigma_m > 0.0
    if noisy and seed is None:
        raise InvalidInput("seed", seed, "give a seed: this scenario contains noise")
    constant, density, stability = np.zeros(6), np.zeros(6), 0.0
    if gyro is not None:
        constant[:3], density[:3] = gyro.bias_instability, gyro.angle_random_walk
        stability = gyro.scale_stability
    if accelerometer is not None:
        constant[3:], density[3:] = accelerometer.bias_instability, accelerometer.velocity_random_walk
    if not noisy:
        return RunErrors(
            bias=np.zeros((worlds, 6)),
            scale=np.zeros((worlds, 3)),
            white=np.zeros((worlds, steps, 6)),
            alignment=np.zeros((worlds, 6)),
            reference=np.zeros((worlds, steps + 1, 2)),
        )
    drawn = []
    for world in range(worlds):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(world,)))
        drawn.append(
            (
                constant * rng.standard_normal(6),
                stability * rng.standard_normal(3),
                density / np.sqrt(scenario.step_s) * rng.standard_normal((steps, 6)),
                density / np.sqrt(scenario.alignment_s) * rng.standard_normal(6),
                scenario.reference_sigma_m * rng.standard_normal((steps + 1, 2)),
            )
        )
    names = ("bias", "scale", "white", "alignment", "reference")
    return RunErrors(
        **{name: np.stack(part) for name, part in zip(names, zip(*drawn, strict=True), strict=True)}
    )
