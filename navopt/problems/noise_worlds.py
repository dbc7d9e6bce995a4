"""Simulated records of linear-Gaussian systems."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.problem import stream

__all__ = ["check_scenario", "moving_vehicle", "simulate_states"]


def check_scenario(**values: tuple[Any, float, float]) -> None:
    """Refuse numbers of a scenario outside ``(value, lowest, highest)``.

    Raises
    ------
    InvalidInput
    """
    for name, (value, lowest, highest) in values.items():
        try:
            good = bool(np.isfinite(value)) and lowest <= value <= highest
        except TypeError:
            good = False
        if isinstance(value, bool) or not good:
            raise InvalidInput(name, value, f"give a number from {lowest:g} to {highest:g}")


def simulate_states(
    F: np.ndarray, G: np.ndarray, drive: np.ndarray, x0: np.ndarray, noise: np.ndarray
) -> np.ndarray:
    """States of ``x[k+1] = F x[k] + drive[k] + G noise[k]``.

    Parameters
    ----------
    F, G : ndarray, shapes (n, n) and (n, g)
        Constant matrices.
    drive, noise : ndarray, shapes (T, n) and (T, g)
        What is added at each step; the last rows are not used.
    x0 : ndarray, shape (n,)
        First state.

    Returns
    -------
    ndarray, shape (T, n)
    """
    states = np.empty((len(drive), len(x0)))
    states[0] = x0
    added = drive + noise @ G.T
    for k in range(len(drive) - 1):
        states[k + 1] = F @ states[k] + added[k]
    return states


def moving_vehicle(
    cls: Any,
    seed: int,
    noise_seed: int | None,
    *,
    steps: int,
    interval_s: float,
    axes: int,
    process_variance: float,
    measurement_variance: float,
    spread_decades: float,
    initial_sigma: tuple[float, float],
    missing_fraction: float,
    measurement_step: float,
    covariance: str,
    **options: Any,
) -> Any:
    """Build a world of `navopt.problems.noise_tuning.NoiseTuning.simulate`; arguments as there."""
    check_scenario(
        steps=(steps, 5, 1e7),
        interval_s=(interval_s, 1e-6, 1e6),
        axes=(axes, 1, 20),
        process_variance=(process_variance, 1e-30, 1e30),
        measurement_variance=(measurement_variance, 1e-30, 1e30),
        spread_decades=(spread_decades, 0.0, 10.0),
        missing_fraction=(missing_fraction, 0.0, 0.95),
        measurement_step=(measurement_step, 1e-6, 1e6),
    )
    world = stream("world:noise-tuning", seed)
    each = 1 if covariance == "scalar" else axes
    powers = world.uniform(-spread_decades, spread_decades, (2, each))
    q = np.broadcast_to(process_variance * 10.0 ** powers[0], axes)
    r = np.broadcast_to(measurement_variance * 10.0 ** powers[1], axes)
    # the noise has a stream of its own, so that a twin differs in nothing else
    noise = stream("world:noise-tuning:noise", seed, 0 if noise_seed is None else noise_seed + 1)
    h = interval_s
    one = np.eye(axes)
    F = np.kron(one, [[1.0, h], [0.0, 1.0]])
    G = np.kron(one, [[0.5 * h**2], [h]])
    H = np.kron(one, [[1.0, 0.0]])
    sigma = np.tile(np.asarray(initial_sigma, dtype=float), axes)
    Q, R = np.diag(q), np.diag(r)
    if measurement_step != 1.0:
        later = np.where(np.arange(steps) < steps // 2, 1.0, measurement_step)
        R = later[:, None, None] * R
    x0 = sigma * noise.standard_normal(2 * axes)
    states = simulate_states(
        F, G, np.zeros((steps, 2 * axes)), x0, noise.standard_normal((steps, axes)) * np.sqrt(q)
    )
    root = np.sqrt(np.diagonal(R, axis1=-2, axis2=-1))
    y = states @ H.T + noise.standard_normal((steps, axes)) * root
    if missing_fraction:
        y[noise.random(y.shape) < missing_fraction] = np.nan
    from navopt.problems.noise_estimate import NoiseTruth

    return cls(
        F, H, y, G=G, P0=np.diag(sigma**2), covariance=covariance, truth=NoiseTruth(states, Q, R), **options
    )
