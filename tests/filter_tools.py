"""A pendulum and its record, for tests of nonlinear filters."""

from __future__ import annotations

import numpy as np

DT = 0.05
Q = np.diag([1e-5, 1e-3, 1e-4])
R = np.array([[0.01, 0.004], [0.004, 0.04]])
P0 = np.array([[0.3, 0.1, 0.0], [0.1, 0.5, 0.02], [0.0, 0.02, 0.2]])
X0 = np.array([1.0, 0.0, 1.0])


def pendulum(states, u, dt):
    """Angle, rate and a drag that is not known well."""
    angle, rate, drag = states.T
    change = np.stack([rate, -9.8 * np.sin(angle) - 0.1 * drag * rate * np.abs(rate), 0.0 * drag], axis=1)
    return states + dt * change


def bob(states):
    return np.stack([np.sin(states[:, 0]), states[:, 1] * (1.0 + 0.1 * states[:, 2])], axis=1)


def bob_jacobian(x):
    return np.array([[np.cos(x[0]), 0.0, 0.0], [0.0, 1.0 + 0.1 * x[2], 0.1 * x[1]]])


def pendulum_jacobian(x, u, dt):
    drag = -0.1 * np.array([2.0 * x[2] * np.abs(x[1]), x[1] * np.abs(x[1])])
    return np.eye(3) + dt * np.array([[0, 1, 0], [-9.8 * np.cos(x[0]), drag[0], drag[1]], [0, 0, 0]])


def record(steps: int, seed: int = 0, spread: np.ndarray = P0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.multivariate_normal(X0, spread)
    truth, z = np.empty((steps, 3)), np.empty((steps, 2))
    for k in range(steps):
        if k:
            x = pendulum(x[None], None, DT)[0] + rng.multivariate_normal(np.zeros(3), Q)
        truth[k], z[k] = x, bob(x[None])[0] + rng.multivariate_normal(np.zeros(2), R)
    return DT * np.arange(steps), truth, z
