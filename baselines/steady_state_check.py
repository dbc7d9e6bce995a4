"""Does the filter of a model settle, and how soon? What the estimators with a fixed gain take for granted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.constant_model import require_constant, steady
from navopt.models.linear_gaussian import LinearGaussianModel, check_covariance

__all__ = ["SteadyStateCheck", "check_steady_state"]


@dataclass(frozen=True)
class SteadyStateCheck:
    """How a filter's gain goes to that of the Riccati equation.

    Attributes
    ----------
    settles : bool
        Whether the gain is within the tolerance at the last measurement.
    steps : int
        Number of measurements after which it stays within the tolerance; the number of all if it does not.
    last_gap : float
        Largest difference of the last gain to the steady one, in units of the steady one's largest entry.
    gain : ndarray, shape (n, m)
        Steady gain of the measurement update.
    """

    settles: bool
    steps: int
    last_gap: float
    gain: np.ndarray


def check_steady_state(
    model: LinearGaussianModel, Q: Any, R: Any, *, tolerance: float = 0.01
) -> SteadyStateCheck:
    """Compare the gains of a filter with the gain from the discrete Riccati equation.

    Parameters
    ----------
    model : LinearGaussianModel
        A constant model, no measurement missing.
    Q, R : array_like, shape (g, g) and (m, m)
        Covariances of the noises.
    tolerance : float, default 0.01
        Relative difference that counts as settled.

    Returns
    -------
    SteadyStateCheck

    Raises
    ------
    UnsuitableProblem
        If the model varies, or a measurement is missing.
    InvalidInput
        If there is no steady state.
    """
    require_constant(model, "check_steady_state")
    Q, R = check_covariance("Q", Q, model.n_noises), check_covariance("R", R, model.n_measurements)
    _, gain = steady(model, Q, R)
    F, H, W = model.F, model.H, model.G @ Q @ model.G.T
    P, eye, size = model.P0, np.eye(model.n_states), max(float(np.abs(gain).max()), 1e-300)
    gap, last_outside = np.inf, -1
    for k in range(model.n_steps):
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        gap = float(np.abs(K - gain).max()) / size
        last_outside = k if gap > tolerance else last_outside
        A = eye - K @ H
        P = F @ (A @ P @ A.T + K @ R @ K.T) @ F.T + W
    return SteadyStateCheck(last_outside < model.n_steps - 1, last_outside + 1, gap, gain)
