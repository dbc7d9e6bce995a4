"""Linear-Gaussian state-space models with their measurements: what a Kalman filter is tuned on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from navopt.errors import InvalidInput

__all__ = ["LinearGaussianModel", "check_covariance", "check_finite"]

#: Largest relative asymmetry taken for rounding.
ASYMMETRY = 1e-9
#: Relative differences of time steps taken for rounding of the clock.
JITTER = 1e-3
#: How far beyond the largest states that the measurements suggest a prior reaches that nobody gave.
VAGUE = 10.0


def check_finite(name: str, value: np.ndarray) -> None:
    """Refuse an array with NaN or infinite entries, naming the first.

    Raises
    ------
    InvalidInput
    """
    wrong = ~np.isfinite(value)
    if wrong.any():
        where = tuple(int(k) for k in np.argwhere(wrong)[0])
        raise InvalidInput(f"{name}{list(where)}", float(value[where]), "give finite entries")


def check_covariance(name: str, value: Any, size: int, *, definite: bool = False) -> np.ndarray:
    """Refuse what is no covariance matrix, naming matrix and entry.

    Parameters
    ----------
    name : str
        What the matrix is called in messages.
    value : array_like, shape (..., size, size)
        One or many matrices.
    size : int
        Number of rows and columns.
    definite : bool, default False
        Whether a singular matrix is refused too.

    Returns
    -------
    ndarray, shape (..., size, size)
        The matrices, exactly symmetric.

    Raises
    ------
    InvalidInput
        If the shape is wrong, an entry is not finite, or a matrix is not symmetric or not positive
        (semi-)definite.
    """
    matrix = _numbers(name, value)
    if matrix.ndim < 2 or matrix.shape[-2:] != (size, size):
        raise InvalidInput(name, f"shape {matrix.shape}", f"give a matrix of shape ({size}, {size})")
    check_finite(name, matrix)
    turned = np.swapaxes(matrix, -1, -2)
    gap = np.abs(matrix - turned)
    scale = np.abs(matrix).max(axis=(-2, -1), keepdims=True)
    if (gap > ASYMMETRY * scale).any():
        where = tuple(int(k) for k in np.unravel_index(np.argmax(gap - ASYMMETRY * scale), gap.shape))
        mirror = (*where[:-2], where[-1], where[-2])
        raise InvalidInput(
            f"{name}{list(where)}",
            f"{matrix[where]:g}, but {name}{list(mirror)} = {matrix[mirror]:g}",
            "give a symmetric matrix",
        )
    matrix = 0.5 * (matrix + turned)
    variances = np.diagonal(matrix, axis1=-2, axis2=-1)
    low = variances <= 0.0 if definite else variances < 0.0
    if low.any():
        where = tuple(int(k) for k in np.argwhere(low)[0])
        remedy = "a variance must be positive" if definite else "a variance must not be negative"
        raise InvalidInput(f"{name}{[*where, where[-1]]}", float(variances[where]), remedy)
    # eigenvalues of the correlations: units of the states must not decide what counts as zero
    sigma = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    values = np.linalg.eigvalsh(matrix / (sigma[..., :, None] * sigma[..., None, :]))
    limit = 1e-14 * size if definite else -1e-10 * size
    if (values[..., 0] < limit).any():
        kind = "definite" if definite else "semi-definite"
        raise InvalidInput(
            name,
            f"a matrix whose correlations have the eigenvalue {values[..., 0].min():.3g}",
            f"give a positive {kind} matrix",
        )
    return matrix


@dataclass(frozen=True)
class LinearGaussianModel:
    """A linear model with Gaussian noise, and what was measured.

    ``x[k+1] = F[k] x[k] + B[k] u[k] + G[k] w[k]`` and ``y[k] = H[k] x[k] + v[k]`` with white noise w of
    covariance Q and v of covariance R, which are what is to be found. `x0` and `P0` are mean and
    covariance of the state *at the first measurement, before it is used*.

    Attributes
    ----------
    F : ndarray, shape (n, n) or (T, n, n)
        Transition from measurement k to k + 1; of T matrices the last is not used.
    H : ndarray, shape (m, n) or (T, m, n)
        Measurement matrix.
    y : ndarray, shape (T, m)
        Measurements; NaN where one is missing.
    G : ndarray, shape (n, g) or (T, n, g)
        Where the process noise enters; the identity if not given.
    B : ndarray, shape (n, p) or (T, n, p), or None
        Where the known input enters.
    u : ndarray, shape (T, p), or None
        Known input, acting from measurement k to k + 1; the last row is not used.
    x0 : ndarray, shape (n,)
        Mean of the first state; zero if not given.
    P0 : ndarray, shape (n, n)
        Its covariance. If not given it is diagonal and wide: `VAGUE` times the largest state that
        measurements of the size of `y` could come from, for each state, so that it hardly matters.
    time : ndarray, shape (T,), or None
        When was measured, s; only to be checked against F.

    Raises
    ------
    InvalidInput
        If a shape does not fit, an entry is not finite, `P0` is no covariance, a channel holds no
        measurement at all, there are fewer measurements than states, time steps vary while F is constant,
        an unstable state can never be seen in the measurements, or `P0` is needed for such a state.
    """

    F: np.ndarray
    H: np.ndarray
    y: np.ndarray
    G: np.ndarray = None  # type: ignore[assignment]
    B: np.ndarray | None = None
    u: np.ndarray | None = None
    x0: np.ndarray = None  # type: ignore[assignment]
    P0: np.ndarray = None  # type: ignore[assignment]
    time: np.ndarray | None = None

    def __post_init__(self) -> None:
        y = _numbers("y", self.y)
        y = y[:, None] if y.ndim == 1 else y
        if y.ndim != 2 or not y.size:
            raise InvalidInput("y", f"shape {y.shape}", "give measurements, shape (T, m)")
        steps, m = y.shape
        if np.isinf(y).any():
            k, channel = (int(i) for i in np.argwhere(np.isinf(y))[0])
            raise InvalidInput(f"y[{k}, {channel}]", float(y[k, channel]), "give NaN where one is missing")
        F = _numbers("F", self.F)
        n = F.shape[-1] if F.ndim else 0
        F = _matrices("F", F, (n, n), steps)
        H = _matrices("H", self.H, (m, n), steps)
        G = _numbers("G", np.eye(n) if self.G is None else self.G)
        G = _matrices("G", G, (n, G.shape[-1] if G.ndim else 0), steps)
        B, u = self._checked_input(n, steps)
        x0 = _numbers("x0", np.zeros(n) if self.x0 is None else self.x0)
        if x0.shape != (n,):
            raise InvalidInput("x0", f"shape {x0.shape}", f"give one value for each of the {n} states")
        check_finite("x0", x0)
        empty = np.flatnonzero(np.isnan(y).all(axis=0))
        if len(empty):
            raise InvalidInput(
                f"y[:, {empty[0]}]", "no measurement at all", "leave the channel out, of H and R as well"
            )
        if steps * m <= n or np.isfinite(y).any(axis=1).sum() < 2:
            raise InvalidInput(
                "y", f"{steps} steps of {m} channels", f"give more than {n} measurements at two or more times"
            )
        seen = _observability(F, H)
        _refuse_unseen(F, seen, constant=F.ndim == H.ndim == 2)
        P0 = _vague_prior(seen, y) if self.P0 is None else check_covariance("P0", self.P0, n)
        if P0.ndim != 2:
            raise InvalidInput("P0", f"shape {P0.shape}", f"give a matrix of shape ({n}, {n})")
        time = self._checked_time(steps, constant=F.ndim == 2)
        checked = {"F": F, "H": H, "y": y, "G": G, "B": B, "u": u, "x0": x0, "P0": P0, "time": time}
        for name, value in checked.items():
            if value is not None:
                value = np.array(value, dtype=float, order="C")
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    def _checked_input(self, n: int, steps: int) -> tuple[np.ndarray | None, np.ndarray | None]:
        if (self.B is None) != (self.u is None):
            missing = "B" if self.B is None else "u"
            raise InvalidInput(missing, None, "B and u belong together: give both or neither")
        if self.B is None:
            return None, None
        u = _numbers("u", self.u)
        u = u[:, None] if u.ndim == 1 else u
        if u.ndim != 2 or len(u) != steps:
            raise InvalidInput("u", f"shape {u.shape}", f"give one row for each of the {steps} measurements")
        check_finite("u", u)
        B = _numbers("B", self.B)
        B = B[:, None] if B.ndim == 1 else B
        return _matrices("B", B, (n, u.shape[1]), steps), u

    def _checked_time(self, steps: int, *, constant: bool) -> np.ndarray | None:
        if self.time is None:
            return None
        time = _numbers("time", self.time)
        if time.shape != (steps,):
            raise InvalidInput("time", f"shape {time.shape}", f"give {steps} times, one per measurement")
        check_finite("time", time)
        gaps = np.diff(time)
        if not (gaps > 0.0).all():
            k = int(np.argmin(gaps > 0.0))
            raise InvalidInput(f"time[{k + 1}]", float(time[k + 1]), "times must increase")
        wrong = np.abs(gaps - np.median(gaps)) > JITTER * np.median(gaps)
        if constant and wrong.any():
            k = int(np.argmax(wrong))
            raise InvalidInput(
                f"time[{k + 1}] - time[{k}]",
                float(gaps[k]),
                f"the usual step is {np.median(gaps):g}: give F of shape (T, n, n), one per step",
            )
        return time

    # -- sizes ---------------------------------------------------------------------------------------
    @property
    def n_states(self) -> int:
        """Number of states n."""
        return self.F.shape[-1]

    @property
    def n_measurements(self) -> int:
        """Number of channels m."""
        return self.H.shape[-2]

    @property
    def n_noises(self) -> int:
        """Number of process noises g."""
        return self.G.shape[-1]

    @property
    def n_steps(self) -> int:
        """Number of times T."""
        return len(self.y)

    @property
    def constant(self) -> bool:
        """Whether F, H and G are the same at all times."""
        return self.F.ndim == self.H.ndim == self.G.ndim == 2

    @property
    def drive(self) -> np.ndarray:
        """What the known input adds to the state, ``B u``, shape (T, n)."""
        if self.B is None or self.u is None:
            return np.zeros((self.n_steps, self.n_states))
        return np.einsum("tij,tj->ti", np.broadcast_to(self.B, (self.n_steps, *self.B.shape[-2:])), self.u)

    def replaced(self, **changes: Any) -> LinearGaussianModel:
        """Return the same model with some attributes changed, for instance other measurements."""
        return replace(self, **changes)

    # -- other people's filters ------------------------------------------------------------------------
    @classmethod
    def from_filterpy(
        cls, kalman: Any, y: Any, *, us: Any = None, G: Any = None, predict_first: bool = True
    ) -> LinearGaussianModel:
        """Take matrices and initial state from a `filterpy.kalman.KalmanFilter`.

        Parameters
        ----------
        kalman : filterpy.kalman.KalmanFilter
            A filter that has not yet seen the measurements. It is not changed.
        y : array_like, shape (T, m)
            Measurements; NaN where filterpy takes None.
        us : array_like, shape (T, p), optional
            What is given to ``predict`` before each measurement (filterpy's ``us`` of ``batch_filter``).
        G : array_like, shape (n, g), optional
            Where the process noise enters; the identity, as in filterpy, if not given.
        predict_first : bool, default True
            Whether ``predict`` comes before the first ``update``, as in ``batch_filter``. `P0` then holds
            the filter's own Q once.

        Returns
        -------
        LinearGaussianModel

        Raises
        ------
        InvalidInput
            If the object is no such filter, or its matrices do not fit the measurements.
        """
        try:
            F, H, x, P, Q = (
                np.array(getattr(kalman, name), dtype=float) for name in ("F", "H", "x", "P", "Q")
            )
        except (AttributeError, TypeError, ValueError):
            raise InvalidInput(
                "kalman", type(kalman).__name__, "give a filterpy KalmanFilter with F, H, x, P and Q"
            ) from None
        x = x.reshape(-1)
        B = None
        if us is not None:
            if getattr(kalman, "B", None) is None:
                raise InvalidInput("kalman.B", None, "us needs a control matrix")
            us = _numbers("us", us)
            us = us[:, None] if us.ndim == 1 else us
            B = np.array(kalman.B, dtype=float).reshape(len(x), -1)
        if predict_first:
            x, P = F @ x, F @ P @ F.T + Q
            if us is not None and B is not None:
                x = x + B @ us[0]
        # filterpy's input k leads to measurement k, ours away from it
        u = None if us is None else np.concatenate([us[1:], np.zeros_like(us[:1])])
        return cls(F=F, H=H, y=y, G=G, B=B, u=u, x0=x, P0=0.5 * (P + P.T))


def _numbers(name: str, value: Any) -> np.ndarray:
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(name, value, "give an array of numbers") from None


def _matrices(name: str, value: Any, shape: tuple[int, int], steps: int) -> np.ndarray:
    """Check one matrix or one per time for its shape and for entries that are not finite."""
    matrix = _numbers(name, value)
    if 0 in shape or matrix.shape not in (shape, (steps, *shape)):
        raise InvalidInput(
            name, f"shape {matrix.shape}", f"give a matrix of shape {shape}, or {steps} of them, one per time"
        )
    check_finite(name, matrix)
    return matrix


def _observability(F: np.ndarray, H: np.ndarray) -> np.ndarray:
    """Observability matrix of the constant model, or of the first steps of a varying one, (k m, n)."""
    n = F.shape[-1]
    steps = n if F.ndim == H.ndim == 2 else min(max(len(a) for a in (F, H) if a.ndim == 3), 4 * n)
    rows, power = [], np.eye(n)
    for k in range(steps):
        rows.append((H if H.ndim == 2 else H[k]) @ power)
        power = (F if F.ndim == 2 else F[k]) @ power
    return np.concatenate(rows)


def _unseen(seen: np.ndarray) -> np.ndarray:
    """Orthonormal directions of the state that no measurement depends on, shape (n, q)."""
    size = np.linalg.norm(seen, axis=1, keepdims=True)
    _, values, directions = np.linalg.svd(seen / np.where(size > 0.0, size, 1.0))
    rank = int((values > 1e-10 * max(values.max(initial=0.0), 1e-300)).sum())
    return directions[rank:].T


def _refuse_unseen(F: np.ndarray, seen: np.ndarray, *, constant: bool) -> None:
    """Refuse a constant model with a growing state that no measurement depends on."""
    hidden = _unseen(seen)
    if not constant or not hidden.shape[1]:
        return
    growth = np.abs(np.linalg.eigvals(hidden.T @ F @ hidden)).max()
    # a constant state, such as a bias nobody sees, stays bounded without noise and is allowed
    if growth > 1.0 + 1e-6:
        state = int(np.argmax(np.abs(hidden).max(axis=1)))
        raise InvalidInput(
            "F, H",
            f"state {state} grows by a factor {growth:.6g} each step and no measurement depends on it",
            "measure it, or leave it out",
        )


def _vague_prior(seen: np.ndarray, y: np.ndarray) -> np.ndarray:
    if _unseen(seen).shape[1]:
        state = int(np.argmax(np.abs(_unseen(seen)).max(axis=1)))
        raise InvalidInput("P0", None, f"state {state} cannot be seen in the measurements: give x0 and P0")
    largest = float(np.nanmax(np.abs(y))) or 1.0
    reach = np.abs(np.linalg.pinv(seen)).sum(axis=1) * largest
    return np.diag((VAGUE * reach) ** 2)
