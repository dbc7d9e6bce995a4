"""The innovation likelihood and its first derivatives as one casadi graph, built once per shape."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["LikelihoodGraph", "lower_index"]

Array = NDArray[np.float64]


def lower_index(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the lower triangle of a square matrix, row by row."""
    return np.tril_indices(size)


class LikelihoodGraph:
    """Negative log-likelihood of a filter's innovations, with its gradient and Fisher information.

    One step of the filter, its derivatives by casadi's algorithmic differentiation included, is built as an
    expression and repeated over the data. Neither data nor parameters are part of the expression: the
    columns of `fixed` hold the matrices, measurements and masks of each step, those of `moving` the
    covariances and their derivatives. What is part of it is the pattern of zeros, which is where the speed
    for large models comes from.

    Parameters
    ----------
    steps : int
        Number of steps T.
    directions : int
        Number of parameters d that the covariances depend on.
    F_pattern : ndarray of bool, shape (n, n)
        Where the transition matrix is not zero at some step.
    H_pattern : ndarray of bool, shape (m, n)
        The same of the measurement matrix.
    W_pattern : ndarray of bool, shape (n, n)
        The same of the covariance of the process noise on the states.
    diagonal : bool
        Whether the covariance of the measurement noise is diagonal: measurements are then taken one after
        another, otherwise all at once through a Cholesky factor.

    Notes
    -----
    The filter is written with the Joseph form of the update, F.2 of Schweppe 1965; a missing measurement
    has weight zero. With S the variance of an innovation e, each adds ½(ln 2πS + e²/S) to the value and
    ½ ∂S_i ∂S_j / S² + ∂e_i ∂e_j / S to the Fisher information, whose expectation at the truth is that of
    the Hessian.
    """

    def __init__(
        self,
        *,
        steps: int,
        directions: int,
        F_pattern: NDArray[np.bool_],
        H_pattern: NDArray[np.bool_],
        W_pattern: NDArray[np.bool_],
        diagonal: bool,
    ) -> None:
        self.steps, self.directions, self.diagonal = steps, directions, diagonal
        self.F_pattern, self.H_pattern = F_pattern, H_pattern
        self.m, self.n = H_pattern.shape
        self.W_rows, self.W_columns = np.nonzero(np.tril(W_pattern | W_pattern.T))
        self.P_rows, self.P_columns = lower_index(self.n)
        self.R_rows, self.R_columns = (np.arange(self.m),) * 2 if diagonal else lower_index(self.m)
        self._function = _repeated(
            steps, directions, _key(F_pattern), _key(H_pattern), _key(W_pattern | W_pattern.T), diagonal
        )

    def fixed(self, F: Array, H: Array, control: Array, y: Array) -> Array:
        """Columns that do not depend on the parameters, shape (T, …).

        Parameters
        ----------
        F : ndarray, shape (T, n, n)
            Transition matrices.
        H : ndarray, shape (T, m, n)
            Measurement matrices.
        control : ndarray, shape (T, n)
            What the control adds to the prediction.
        y : ndarray, shape (T, m)
            Measurements; NaN where missing.
        """
        # casadi lists the entries of a sparse matrix column by column
        f_columns, f_rows = np.nonzero(self.F_pattern.T)
        h_columns, h_rows = np.nonzero(self.H_pattern.T)
        seen = np.isfinite(y)
        parts = [F[:, f_rows, f_columns], H[:, h_rows, h_columns], control, np.where(seen, y, 0.0), seen]
        return np.concatenate([np.asarray(part, dtype=float) for part in parts], axis=1)

    def moving(self, W: Array, R: Array, dW: Array, dR: Array) -> Array:
        """Columns that depend on the parameters, shape (T, …).

        Parameters
        ----------
        W : ndarray, shape (T, n, n) or (1, n, n)
            Covariance that the process noise adds to the states.
        R : ndarray, shape (T, m, m) or (1, m, m)
            Covariance of the measurement noise.
        dW : ndarray, shape (d, T, n, n) or (d, 1, n, n)
            Derivatives of W.
        dR : ndarray, shape (d, T, m, m) or (d, 1, m, m)
            Derivatives of R.
        """
        parts = [W[:, self.W_rows, self.W_columns], R[:, self.R_rows, self.R_columns]]
        for w, r in zip(dW, dR, strict=True):
            parts += [w[:, self.W_rows, self.W_columns], r[:, self.R_rows, self.R_columns]]
        rows = max(len(part) for part in parts)
        out = np.concatenate([np.broadcast_to(part, (rows, part.shape[1])) for part in parts], axis=1)
        return np.ascontiguousarray(np.broadcast_to(out, (self.steps, out.shape[1])))

    def evaluate(self, fixed: Array, moving: Array, x0: Array, P0: Array) -> tuple[float, Array, Array]:
        """Value, gradient and Fisher information.

        Parameters
        ----------
        fixed, moving : ndarray
            From the methods of these names.
        x0 : ndarray, shape (n,)
            State expected at the first measurement, before it.
        P0 : ndarray, shape (n, n)
            Its covariance.

        Returns
        -------
        value : float
            Negative log-likelihood.
        gradient : ndarray, shape (d,)
        information : ndarray, shape (d, d)
        """
        d, width = self.directions, self.n + len(self.P_rows)
        start = np.zeros(width * (1 + d) + 1 + d + d * (d + 1) // 2)
        start[:width] = np.concatenate([x0, P0[self.P_rows, self.P_columns]])
        # the C interface: no copies, and a T by 20 array goes through in microseconds
        out = np.empty((self._columns_out, len(start)))
        buffer, run = self._function.buffer()
        for k, part in enumerate((start, fixed, moving)):
            buffer.set_arg(k, part.data)
        buffer.set_res(0, out.data)
        run()
        last = out[-1]
        sums = last[width * (1 + d) :]
        information = np.zeros((d, d))
        rows, columns = lower_index(d)
        information[rows, columns] = information[columns, rows] = sums[1 + d :]
        return float(sums[0]), sums[1 : 1 + d].copy(), information

    @property
    def _columns_out(self) -> int:
        return int(self._function.size2_out(0))


def _key(pattern: NDArray[np.bool_]) -> tuple[tuple[int, ...], bytes]:
    return pattern.shape, np.ascontiguousarray(pattern, dtype=bool).tobytes()


@lru_cache(maxsize=64)
def _repeated(steps: int, directions: int, *key: Any) -> Any:
    return _step(directions, *key).mapaccum(steps)


@lru_cache(maxsize=32)
def _step(directions: int, F_key: Any, H_key: Any, W_key: Any, diagonal: bool) -> Any:
    """One step with its derivatives: (state, fixed column, moving column) -> state."""
    import casadi as ca

    F_pattern, H_pattern, W_pattern = (
        np.frombuffer(data, dtype=bool).reshape(shape) for shape, data in (F_key, H_key, W_key)
    )
    m, n = H_pattern.shape
    rows, columns = lower_index(n)
    W_rows, W_columns = np.nonzero(np.tril(W_pattern))
    R_rows, R_columns = (np.arange(m), np.arange(m)) if diagonal else lower_index(m)
    F, H = (ca.SX.sym("M", _sparsity(pattern)) for pattern in (F_pattern, H_pattern))
    c, y, seen = ca.SX.sym("c", n), ca.SX.sym("y", m), ca.SX.sym("seen", m)
    base = ca.SX.sym("base", n + len(rows))
    noise = ca.SX.sym("noise", len(W_rows) + len(R_rows))
    x, P = base[:n], _symmetric(n, rows, columns, base[n:])
    W = _symmetric(n, W_rows, W_columns, noise[: len(W_rows)])
    R = _symmetric(m, R_rows, R_columns, noise[len(W_rows) :])
    update = _one_by_one if diagonal else _all_at_once
    x, P, whitened, variances = update(x, P, H, R, y, seen)
    x, P = F @ x + c, F @ P @ F.T + W
    after = ca.vertcat(x, *[P[int(i), int(j)] for i, j in zip(rows, columns, strict=True)])
    # innovations e and log-variances l, already decorrelated: cost = ½ (l + e² exp(−l) + ln 2π)
    value = 0.5 * ca.sum1(ca.log(variances) + whitened**2 / variances + np.log(2 * np.pi) * seen)
    inner = ca.vertcat(base, noise)
    outputs = ca.vertcat(after, value, whitened, variances)
    # derivatives of the state so far, and of the covariances, along each parameter
    slopes = ca.SX.sym("slopes", base.numel(), directions)
    seeds = ca.SX.sym("seeds", noise.numel(), directions)
    tangent = ca.jtimes(outputs, inner, ca.vertcat(slopes, seeds))
    size = after.numel()
    d_after, d_value = tangent[:size, :], tangent[size, :]
    d_whitened, d_variances = tangent[size + 1 : size + 1 + m, :], tangent[size + 1 + m :, :]
    fisher = [
        ca.sum1(
            0.5 * d_variances[:, i] * d_variances[:, j] / variances**2
            + d_whitened[:, i] * d_whitened[:, j] / variances
        )
        for i, j in zip(*lower_index(directions), strict=True)
        for i, j in [(int(i), int(j))]
    ]
    totals = ca.SX.sym("totals", 1 + directions + len(fisher))
    state = ca.vertcat(base, ca.vec(slopes), totals)
    fresh = ca.vertcat(value, ca.vec(d_value), *fisher)
    fixed = ca.vertcat(*[_entries(M) for M in (F, H)], c, y, seen)
    moving = ca.vertcat(noise, ca.vec(seeds))
    result = ca.vertcat(after, ca.vec(d_after), totals + fresh)
    return ca.Function("step", [state, fixed, moving], [ca.densify(result)], {"cse": True})


def _one_by_one(x: Any, P: Any, H: Any, R: Any, y: Any, seen: Any) -> tuple[Any, Any, Any, Any]:
    """Scalar measurements in turn; a missing one has innovation 0 and variance 1."""
    import casadi as ca

    innovations, variances = [], []
    for j in range(int(H.size1())):
        h = H[j, :]
        Ph = P @ h.T
        s = h @ Ph + R[j, j]
        e = seen[j] * (y[j] - h @ x)
        gain = seen[j] * Ph / s
        x = x + gain * e
        A = ca.SX.eye(x.numel()) - gain @ h
        P = A @ P @ A.T + gain @ gain.T * R[j, j]
        innovations.append(e)
        variances.append(seen[j] * s + (1 - seen[j]))
    return x, P, ca.vertcat(*innovations), ca.vertcat(*variances)


def _all_at_once(x: Any, P: Any, H: Any, R: Any, y: Any, seen: Any) -> tuple[Any, Any, Any, Any]:
    """All measurements together; rows and columns of the missing ones are those of the identity."""
    import casadi as ca

    M = ca.diag(seen)
    Hm, Rm = M @ H, M @ R @ M + ca.diag(1 - seen)
    e = M @ (y - H @ x)
    S = Hm @ P @ Hm.T + Rm
    upper = ca.chol(S)
    z = _forward(upper.T, e)
    gain_t = _backward(upper, _forward(upper.T, Hm @ P))
    x = x + gain_t.T @ e
    A = ca.SX.eye(x.numel()) - gain_t.T @ Hm
    P = A @ P @ A.T + gain_t.T @ Rm @ gain_t
    pivots = ca.diag(upper)
    # z is white; times the pivot it is the innovation of each measurement given those before it
    return x, P, z * pivots, pivots**2


def _forward(lower: Any, b: Any) -> Any:
    import casadi as ca

    rows: list[Any] = []
    for i in range(int(lower.size1())):
        left = b[i, :]
        for j in range(i):
            left = left - lower[i, j] * rows[j]
        rows.append(left / lower[i, i])
    return ca.vertcat(*rows)


def _backward(upper: Any, b: Any) -> Any:
    import casadi as ca

    rows: list[Any] = []
    size = int(upper.size1())
    for i in reversed(range(size)):
        left = b[i, :]
        for j, row in zip(range(size - 1, i, -1), rows, strict=True):
            left = left - upper[i, j] * row
        rows.append(left / upper[i, i])
    return ca.vertcat(*rows[::-1])


def _sparsity(pattern: NDArray[np.bool_]) -> Any:
    import casadi as ca

    columns, rows = np.nonzero(pattern.T)
    return ca.Sparsity.triplet(len(pattern), pattern.shape[1], rows.tolist(), columns.tolist())


def _entries(M: Any) -> Any:
    import casadi as ca

    return ca.vertcat(*M.nonzeros())


def _symmetric(size: int, rows: Any, columns: Any, values: Any) -> Any:
    import casadi as ca

    M = ca.SX(size, size)
    for k, (i, j) in enumerate(zip(rows, columns, strict=True)):
        M[int(i), int(j)] = values[k]
        M[int(j), int(i)] = values[k]
    return M
