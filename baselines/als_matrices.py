"""How the autocovariances of a fixed filter's innovations depend on Q and R, and their estimates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navopt.errors import InvalidInput

__all__ = [
    "ErrorDynamics",
    "als_matrices",
    "autocovariance",
    "duplication",
    "fixed_gain_innovations",
    "uniqueness",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ErrorDynamics:
    """Error of a predictor with a fixed gain: ``ε[k+1] = Ā ε[k] + G w[k] − A L v[k]``, ``Ā = A (I − L C)``.

    Attributes
    ----------
    A : ndarray, shape (n, n)
        Transition matrix.
    C : ndarray, shape (m, n)
        Measurement matrix.
    G : ndarray, shape (n, g)
        Where the process noise enters.
    L : ndarray, shape (n, m)
        Gain of the measurement update.

    Raises
    ------
    InvalidInput
        If the error does not decay: the autocovariances then have no limit.
    """

    A: Array
    C: Array
    G: Array
    L: Array

    def __post_init__(self) -> None:
        radius = np.abs(np.linalg.eigvals(self.closed)).max()
        if not radius < 1.0 - 1e-9:
            raise InvalidInput(
                "L",
                f"a gain with which F (I - L H) has spectral radius {radius:.6g}",
                "give a gain that makes the filter stable, such as that of a steady filter",
            )

    @property
    def closed(self) -> Array:
        """Transition of the error Ā, shape (n, n)."""
        return self.A - self.A @ self.L @ self.C

    @property
    def feed(self) -> Array:
        """Where the measurement noise enters the error, A L, shape (n, m)."""
        return self.A @ self.L


def duplication(size: int) -> Array:
    """Matrix that makes column-major vec M of the lower triangle of a symmetric M, row by row."""
    rows, columns = np.tril_indices(size)
    D = np.zeros((size * size, len(rows)))
    D[rows + size * columns, np.arange(len(rows))] = 1.0
    D[columns + size * rows, np.arange(len(rows))] = 1.0
    return D


def als_matrices(dynamics: ErrorDynamics, lags: int) -> tuple[Array, Array]:
    """Matrices of the linear map from Q and R to the autocovariances (Odelson, Rajamani, Rawlings 2006).

    With the autocovariances ``C_j = E[e[k+j] e[k]ᵀ]`` stacked to one block column R(N), shape (N m, m),
    ``vec R(N) = M_Q vec Q + M_R vec R``, where vec is column-major.

    Parameters
    ----------
    dynamics : ErrorDynamics
        Model and gain.
    lags : int
        Number N of autocovariances, that at lag zero among them.

    Returns
    -------
    M_Q : ndarray, shape (N m², g²)
    M_R : ndarray, shape (N m², m²)
    """
    A_bar, C, AL = dynamics.closed, dynamics.C, dynamics.feed
    m, n = C.shape
    observed, through = [C], [np.eye(m)]
    for _ in range(1, lags):
        through.append(-observed[-1] @ AL)
        observed.append(observed[-1] @ A_bar)
    O, Gamma = np.concatenate(observed), np.concatenate(through)
    sums = np.kron(C, O) @ np.linalg.inv(np.eye(n * n) - np.kron(A_bar, A_bar))
    M_Q = sums @ np.kron(dynamics.G, dynamics.G)
    M_R = sums @ np.kron(AL, AL) + np.kron(np.eye(m), Gamma)
    return M_Q, M_R


def uniqueness(dynamics: ErrorDynamics, columns: Array | None = None) -> tuple[int, int]:
    """Rank of what the innovations can tell about Q, and the number of its unknowns.

    Q is determined if and only if the matrix ``(C ⊗ I)(I − Ā ⊗ Ā)⁻¹(G ⊗ G) D`` has full column rank
    (Rajamani and Rawlings 2009).

    Parameters
    ----------
    dynamics : ErrorDynamics
        Model and gain.
    columns : ndarray, shape (g², k), optional
        What the unknowns mean for vec Q; any symmetric Q, the duplication matrix D, if not given.

    Returns
    -------
    rank, unknowns : int
    """
    A_bar, C = dynamics.closed, dynamics.C
    n = len(A_bar)
    D = duplication(dynamics.G.shape[1]) if columns is None else columns
    image = np.kron(dynamics.G, dynamics.G) @ D
    M = np.kron(C, np.eye(n)) @ np.linalg.solve(np.eye(n * n) - np.kron(A_bar, A_bar), image)
    size = np.linalg.norm(M, axis=0)
    # columns to one length: units of the noises must not decide about the rank
    scaled = M / np.where(size > 0.0, size, 1.0)
    return int(np.linalg.matrix_rank(scaled, tol=1e-9)), int(D.shape[1])


def fixed_gain_innovations(dynamics: ErrorDynamics, y: Array, drive: Array, x0: Array) -> Array:
    """Innovations of the predictor with a fixed gain, shape (T, m).

    Parameters
    ----------
    dynamics : ErrorDynamics
        Model and gain.
    y : ndarray, shape (T, m)
        Measurements, none missing.
    drive : ndarray, shape (T, n)
        What a known input adds to the prediction.
    x0 : ndarray, shape (n,)
        First prediction.
    """
    parts = (dynamics.A, dynamics.C, dynamics.L, y, drive, x0)
    innovations: Array = _innovations(*(np.ascontiguousarray(part, dtype=float) for part in parts))
    return innovations


@njit(cache=True)
def _innovations(A: Array, C: Array, L: Array, y: Array, drive: Array, x0: Array) -> Array:
    steps, m = y.shape
    n = len(x0)
    x, updated = x0.copy(), np.empty(n)
    out = np.empty((steps, m))
    for k in range(steps):
        for i in range(m):
            e = y[k, i]
            for j in range(n):
                e -= C[i, j] * x[j]
            out[k, i] = e
        for j in range(n):
            updated[j] = x[j]
            for i in range(m):
                updated[j] += L[j, i] * out[k, i]
        for j in range(n):
            total = drive[k, j]
            for i in range(n):
                total += A[j, i] * updated[i]
            x[j] = total
    return out


def autocovariance(innovations: Array, lags: int) -> Array:
    """Sample autocovariances ``1/(T − j) Σ e[k+j] e[k]ᵀ``, shape (lags, m, m).

    The mean is known to be zero and not taken off; the estimates are unbiased.

    Parameters
    ----------
    innovations : ndarray, shape (T, m)
        Innovations, the transient left out.
    lags : int
        How many, lag zero among them.

    Raises
    ------
    InvalidInput
        If there are not more innovations than lags.
    """
    steps = len(innovations)
    if not 1 <= lags < steps:
        raise InvalidInput(
            "lags", lags, f"give a number from 1 to {steps - 1}: there are {steps} innovations"
        )
    return np.stack([innovations[j:].T @ innovations[: steps - j] / (steps - j) for j in range(lags)])
