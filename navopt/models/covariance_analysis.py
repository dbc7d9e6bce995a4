"""What a Kalman filter believes about its errors, and how large they are, without any data.

The gains of a linear filter do not depend on the measurements. So the covariance of its errors can be worked
out for any tuning, right or wrong, and no draw of noise stands between a tuning and what it is worth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import check_covariance

__all__ = ["FilterCovariances", "analyse_filter"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FilterCovariances:
    """Covariances after each of some measurements has been used.

    Attributes
    ----------
    steps : ndarray of int, shape (S,)
        Number of measurements used.
    believed : ndarray, shape (S, K, n, n)
        What the filter calculates.
    actual : ndarray, shape (S, K, n, n)
        The mean square errors (mean of e e^T) over all worlds that the declared covariances describe.
    """

    steps: NDArray[np.int64]
    believed: Array
    actual: Array


def analyse_filter(
    transition: ArrayLike,
    noise_input: ArrayLike,
    measurement: ArrayLike,
    *,
    P0: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    assumed_Q: ArrayLike | None = None,
    assumed_R: ArrayLike | None = None,
    assumed_P0: ArrayLike | None = None,
    steps: int | ArrayLike,
) -> FilterCovariances:
    """Return believed and actual covariances of filters with constant matrices.

    Parameters
    ----------
    transition : array_like, shape (n, n)
        F of ``x[k+1] = F x[k] + G w[k]``.
    noise_input : array_like, shape (n, g)
        G.
    measurement : array_like, shape (m, n)
        H of ``y[k] = H x[k] + v[k]``.
    P0, Q, R : array_like, shapes (n, n), (g, g), (m, m)
        What is true of the worlds: covariances of the state at the first measurement (the filter
        begins at its mean), of w and of v.
    assumed_Q, assumed_R, assumed_P0 : array_like, shapes (K, g, g), (K, m, m), (K, n, n), optional
        What the filters are told instead; one matrix serves all. The truth if not given.
    steps : int or array_like of int
        After how many measurements; several in increasing order.

    Returns
    -------
    FilterCovariances

    Raises
    ------
    InvalidInput
        If a matrix is no covariance, a shape does not fit, or `steps` do not increase.

    Notes
    -----
    Both are linear recursions of the filter's gain K: believed P as in every filter (in Joseph's form),
    actual ``M <- (I - K H) M (I - K H)^T + K R K^T`` and ``M <- F M F^T + G Q G^T``. With nothing assumed
    both are one, and by the optimality of the Kalman filter no other tuning makes M smaller.
    """
    F, G, H = (np.asarray(v, dtype=np.float64) for v in (transition, noise_input, measurement))
    n = F.shape[-1] if F.ndim else 0
    for name, value, shape in (("transition", F, (n, n)), ("noise_input", G, (n, -1))):
        if value.ndim != 2 or value.shape[0] != n or (shape[1] >= 0 and value.shape[1] != shape[1]):
            raise InvalidInput(name, f"shape {value.shape}", "give constant matrices that fit one another")
    if H.ndim != 2 or H.shape[1] != n:
        raise InvalidInput("measurement", f"shape {H.shape}", f"give a matrix of shape (m, {n})")
    g, m = G.shape[1], H.shape[0]
    at = np.atleast_1d(np.asarray(steps))
    if at.ndim != 1 or at.dtype.kind not in "iu" or at[0] < 1 or (np.diff(at) <= 0).any():
        raise InvalidInput("steps", steps, "give whole numbers from 1 on, in increasing order")
    true = {
        "P0": check_covariance("P0", P0, n),
        "Q": check_covariance("Q", Q, g),
        "R": check_covariance("R", R, m, definite=True),
    }
    told = {
        "P0": _stack("assumed_P0", assumed_P0, true["P0"], n),
        "Q": _stack("assumed_Q", assumed_Q, true["Q"], g),
        "R": _stack("assumed_R", assumed_R, true["R"], m, definite=True),
    }
    count = max(len(value) for value in told.values())
    for name, value in told.items():
        if len(value) not in (1, count):
            raise InvalidInput(f"assumed_{name}", f"{len(value)} matrices", f"give one or {count}")
    P = np.broadcast_to(told["P0"], (count, n, n))
    M = np.broadcast_to(true["P0"], (count, n, n))
    added, told_added = G @ true["Q"] @ G.T, G @ told["Q"] @ G.T
    believed, actual = [], []
    wanted = set(at.tolist())
    for k in range(1, int(at[-1]) + 1):
        S = H @ P @ H.T + told["R"]
        gain = np.swapaxes(np.linalg.solve(S, H @ P), -1, -2)
        left = np.eye(n) - gain @ H
        right = np.swapaxes(left, -1, -2)
        turned = np.swapaxes(gain, -1, -2)
        P = left @ P @ right + gain @ told["R"] @ turned
        M = left @ M @ right + gain @ true["R"] @ turned
        if k in wanted:
            believed.append(P)
            actual.append(M)
        P = F @ P @ F.T + told_added
        M = F @ M @ F.T + added
        P, M = 0.5 * (P + np.swapaxes(P, -1, -2)), 0.5 * (M + np.swapaxes(M, -1, -2))
    return FilterCovariances(at.astype(np.int64), np.array(believed), np.array(actual))


def _stack(name: str, value: ArrayLike | None, default: Array, size: int, *, definite: bool = False) -> Array:
    matrix = default if value is None else check_covariance(name, value, size, definite=definite)
    return matrix.reshape(-1, size, size)
