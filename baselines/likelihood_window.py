"""Noise covariances that change: the innovation likelihood solved again and again over a sliding window."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.likelihood_descent import descend
from baselines.likelihood_objective import InnovationObjective
from baselines.noise_structure import NoiseStructure
from navopt.algorithms.options import at_least, number
from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["WindowFit", "fit_windows"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WindowFit:
    """Covariances over time.

    Attributes
    ----------
    Q : ndarray, shape (T, g, g)
        Covariance of the process noise from step k to k + 1, from measurements before k.
    R : ndarray, shape (T, m, m)
        Covariance of the measurement noise at step k, from measurements before k.
    theta : ndarray, shape (solves, d)
        Parameters of each solve.
    solved_at : ndarray of int, shape (solves,)
        Number of measurements that each solve knew.
    cost : float
        Filter runs, in units of one run over all data.
    """

    Q: Array
    R: Array
    theta: Array
    solved_at: NDArray[np.int64]
    cost: float


def fit_windows(
    model: LinearGaussianModel,
    structure: NoiseStructure,
    *,
    window: int = 200,
    stride: int = 10,
    walk: float = 1.0,
    max_iterations: int = 30,
    spend: Callable[[float], bool] | None = None,
) -> WindowFit:
    """Fit Q(t) and R(t) by maximum a posteriori over a sliding window of measurements.

    Every `stride` steps the likelihood of the last `window` innovations is maximised again. The state enters
    the window with the mean and covariance that the filter of the solve before had there, and the
    parameters with a Gaussian prior about their values before: the arrival cost of moving-horizon
    estimation. Nothing of the future is used.

    Parameters
    ----------
    model : LinearGaussianModel
        The model with its measurements; NaN where one is missing.
    structure : NoiseStructure
        What is looked for; begins at its references.
    window : int, default 200
        Steps looked back at.
    stride : int, default 10
        Steps between two solves.
    walk : float, default 1.0
        Standard deviation of the prior on every parameter, as a logarithm of a variance.
    max_iterations : int, default 30
        Cap on IPOPT's iterations in one solve.
    spend : callable, optional
        Asked with the price of each filter run, in units of a run over all data, before it is made; once it
        says False the parameters stay as they are.

    Returns
    -------
    WindowFit

    Raises
    ------
    InvalidInput
        If the window is not longer than the stride.
    """
    at_least("stride", stride, 1)
    if at_least("window", window, 2) <= stride:
        raise InvalidInput("window", window, f"give more than the stride of {stride} steps")
    number("walk", walk, above=0.0)
    steps, d = model.n_steps, structure.n_parameters
    theta = np.zeros(d)
    Q, R = (np.empty((steps, *value.shape)) for value in structure.covariances(theta))
    found, times, cost = [], [], 0.0
    share = min(window, steps) / steps
    open_ = True

    def price(units: int) -> bool:
        nonlocal cost, open_
        if open_ and spend is not None:
            open_ = spend(units * share)
        cost += units * share if open_ else 0.0
        return open_

    begin, x, P = 0, model.x0, model.P0
    for now in range(0, steps, stride):
        if now and open_:
            # the state at the window's beginning, by the filter with the latest covariances
            first = max(0, now - window)
            x, P = _propagate(model, x, P, begin, first, *structure.covariances(theta))
            begin = first
            objective = InnovationObjective(
                model, structure, prior_mean=theta, prior_sigma=np.full(d, walk),
                start=first, stop=now, length=min(window, steps), x0=x, P0=P,
            )  # fmt: skip
            end = descend(objective, theta, max_iterations=max_iterations, tolerance=1e-6, spend=price)
            if end is not None:
                theta = end.theta
                found.append(theta)
                times.append(now)
        stop = min(now + stride, steps)
        Q[now:stop], R[now:stop] = structure.covariances(theta)
    return WindowFit(Q, R, np.array(found).reshape(-1, d), np.array(times, dtype=np.int64), cost)


def _propagate(
    model: LinearGaussianModel, x: Array, P: Array, start: int, stop: int, Q: Array, R: Array
) -> tuple[Array, Array]:
    """Predicted state and covariance at `stop` from those at `start`."""
    steps, n = model.n_steps, model.n_states
    F, H, G = (np.broadcast_to(M, (steps, *M.shape[-2:])) for M in (model.F, model.H, model.G))
    drive = model.drive
    for k in range(start, stop):
        seen = np.isfinite(model.y[k])
        if seen.any():
            Hk, Rk = H[k][seen], R[np.ix_(seen, seen)]
            K = np.linalg.solve(Hk @ P @ Hk.T + Rk, Hk @ P).T
            A = np.eye(n) - K @ Hk
            x, P = x + K @ (model.y[k, seen] - Hk @ x), A @ P @ A.T + K @ Rk @ K.T
        x = F[k] @ x + drive[k]
        P = F[k] @ P @ F[k].T + G[k] @ Q @ G[k].T
        P = 0.5 * (P + P.T)
    return x, P
