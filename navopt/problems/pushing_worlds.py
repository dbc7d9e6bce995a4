"""Simulated pushes of a roof support: the artificial signal, and a stroke with an imperfect accelerometer."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.problem import stream
from navopt.problems.noise_estimate import NoiseTruth
from navopt.problems.noise_worlds import check_scenario, simulate_states

__all__ = ["CASES", "build_world", "stroke_acceleration"]

NOISE_INPUTS = ("acceleration", "states")
#: What differs between the cases if the user says nothing. The stroke is a reconstruction: the paper names
#: the sensors and the length, and prints one error of the built-in sensor, 14.7467, without a unit.
CASES: dict[str, dict[str, Any]] = {
    "sine": {
        "steps": 1000,
        "interval_s": 0.1,
        "process_variance": 1.0,
        "measurement_variance": 0.25,
        "initial_sigma": (0.5, 0.5),
        "accelerometer_bias": 0.0,
    },
    "stroke": {
        "steps": 1000,
        "interval_s": 0.01,
        "process_variance": 0.02**2,
        "measurement_variance": 0.0147467**2,
        "initial_sigma": (1e-3, 1e-3),
        "accelerometer_bias": 0.05,
    },
}


def stroke_acceleration(
    steps: int, interval: float, *, stroke: float, ramp: float, rest: float
) -> np.ndarray:
    """Acceleration of a push with a trapezoidal velocity, m/s², shape (steps,).

    Held constant over each step, it moves the support by `stroke` exactly and leaves it at rest.

    Parameters
    ----------
    steps : int
        Number of steps.
    interval : float
        Length of one, s.
    stroke : float
        Distance, m.
    ramp, rest : float
        How long the velocity rises and falls, and how long it is zero before and after, s.

    Raises
    ------
    InvalidInput
        If rests and ramps take longer than the record.
    """
    still, rise = max(round(rest / interval), 0), max(round(ramp / interval), 1)
    even = steps - 1 - 2 * still - 2 * rise
    if even < 0:
        raise InvalidInput(
            "ramp_s, rest_s", (ramp, rest), f"two of each must fit into {(steps - 1) * interval:g} s"
        )
    # the velocity is constant for `even` steps and on average half of it for twice `rise`
    speed = stroke / ((even + rise) * interval)
    acceleration = np.zeros(steps)
    acceleration[still : still + rise] = speed / (rise * interval)
    acceleration[still + rise + even : still + 2 * rise + even] = -speed / (rise * interval)
    return acceleration


def build_world(
    cls: Any,
    seed: int,
    noise_seed: int | None,
    *,
    case: str,
    amplitude: float,
    phase_step: float,
    initial_position_m: float,
    initial_velocity: float,
    stroke_m: float,
    ramp_s: float,
    rest_s: float,
    sensor_bias_m: float,
    missing_fraction: float,
    noise_input: str,
    covariance: str,
    **rest: Any,
) -> Any:
    """Build a world of `navopt.problems.pushing_distance.PushingDistance.simulate`; arguments as there."""
    chosen = {name: CASES[case][name] if rest[name] is None else rest[name] for name in CASES[case]}
    options = {name: value for name, value in rest.items() if name not in chosen}
    if noise_input not in NOISE_INPUTS:
        raise UnknownName("noise_input", noise_input, NOISE_INPUTS)
    check_scenario(
        steps=(chosen["steps"], 5, 1e7),
        interval_s=(chosen["interval_s"], 1e-6, 1e6),
        process_variance=(chosen["process_variance"], 1e-30, 1e30),
        measurement_variance=(chosen["measurement_variance"], 1e-30, 1e30),
        accelerometer_bias=(chosen["accelerometer_bias"], -1e3, 1e3),
        sensor_bias_m=(sensor_bias_m, -1e3, 1e3),
        missing_fraction=(missing_fraction, 0.0, 0.95),
        amplitude=(amplitude, -1e6, 1e6),
        phase_step=(phase_step, -1e6, 1e6),
        initial_position_m=(initial_position_m, -1e6, 1e6),
        initial_velocity=(initial_velocity, -1e6, 1e6),
        stroke_m=(stroke_m, 1e-6, 1e6),
        ramp_s=(ramp_s, 0.0, 1e6),
        rest_s=(rest_s, 0.0, 1e6),
    )
    steps, h = int(chosen["steps"]), float(chosen["interval_s"])
    F, B, H = np.array([[1.0, h], [0.0, 1.0]]), np.array([[0.5 * h**2], [h]]), np.array([[1.0, 0.0]])
    G = B if noise_input == "acceleration" else np.eye(2)
    noise = stream("world:pushing-distance:noise", seed, 0 if noise_seed is None else noise_seed + 1)
    if case == "sine":
        true_input = amplitude * np.sin(phase_step * np.arange(steps))
    else:
        true_input = stroke_acceleration(steps, h, stroke=stroke_m, ramp=ramp_s, rest=rest_s)
    sigma = np.asarray(chosen["initial_sigma"], dtype=float)
    x0 = np.array([initial_position_m, initial_velocity])
    first = x0 + sigma * noise.standard_normal(2)
    w = noise.standard_normal((steps, G.shape[1])) * np.sqrt(chosen["process_variance"])
    if case == "sine":
        # as in the paper the noise moves the plant; the filter is told the clean input
        told = true_input + chosen["accelerometer_bias"]
        states = simulate_states(F, G, true_input[:, None] @ B.T, first, w)
    elif noise_input == "acceleration":
        # the support follows its course, and it is the accelerometer that errs
        told = true_input + w[:, 0] + chosen["accelerometer_bias"]
        states = simulate_states(F, G, true_input[:, None] @ B.T, first, np.zeros_like(w))
    else:
        raise InvalidInput("noise_input", noise_input, 'the stroke has noise_input="acceleration" only')
    y = states[:, :1] + sensor_bias_m
    y = y + noise.standard_normal(y.shape) * np.sqrt(chosen["measurement_variance"])
    if missing_fraction:
        y[noise.random(y.shape) < missing_fraction] = np.nan
    truth = NoiseTruth(
        states,
        np.eye(G.shape[1]) * chosen["process_variance"],
        np.eye(1) * chosen["measurement_variance"],
    )
    return cls(
        F, H, y, G=G, B=B, u=told, x0=x0, P0=np.diag(sigma**2), covariance=covariance,
        measurement_covariance="scalar", truth=truth, scored_states=(0,), **options,
    )  # fmt: skip
