"""Worlds and independent references for the tests of noise estimators."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from navopt.models.linear_gaussian import LinearGaussianModel

#: Pushing along a line: period, and variances of acceleration and of measured position.
DT, TRUE_Q, TRUE_R = 0.1, 1.0, 0.25


def pushing(
    seed: int, steps: int = 1000, *, jump: int | None = None, q: float = TRUE_Q, r: float = TRUE_R
) -> tuple[LinearGaussianModel, np.ndarray]:
    """Position and velocity driven by a known and a random acceleration, and the true states.

    From step `jump` the variance of the measurements is nine times as large.
    """
    rng = np.random.default_rng(np.random.SeedSequence([417, seed]))
    F = np.array([[1.0, DT], [0.0, 1.0]])
    G = np.array([[DT**2 / 2], [DT]])
    u = 9.81 * np.sin(np.arange(steps) / 5.0)
    w, v = np.sqrt(q) * rng.standard_normal(steps), np.sqrt(r) * rng.standard_normal(steps)
    if jump is not None:
        v[jump:] *= 3.0
    x = np.zeros((steps, 2))
    x[0] = rng.standard_normal(2)
    for k in range(steps - 1):
        x[k + 1] = F @ x[k] + G[:, 0] * (u[k] + w[k])
    y = x[:, 0] + v
    return LinearGaussianModel(F=F, H=[[1.0, 0.0]], y=y, G=G, B=G, u=u, x0=np.zeros(2), P0=np.eye(2)), x


def pushing_information(steps: int, q: float = TRUE_Q, r: float = TRUE_R) -> np.ndarray:
    """Fisher information about (ln q, ln r), by Whittle's integral over a spectrum.

    The second difference of the measured position is a moving average with spectrum
    ``q (Δt²/2)² |1 + z|² + r |1 − z|⁴``, z on the unit circle.
    """

    def parts(w: float) -> tuple[float, float]:
        z = np.exp(1j * w)
        return q * (DT**2 / 2) ** 2 * abs(1 + z) ** 2, r * abs(1 - z) ** 4

    out = np.zeros((2, 2))
    for i in range(2):
        for j in range(2):

            def integrand(w: float, i: int = i, j: int = j) -> float:
                both = parts(w)
                return both[i] * both[j] / sum(both) ** 2

            out[i, j] = steps / (2 * np.pi) * quad(integrand, 0.0, np.pi, limit=400, points=[0.05, 0.2])[0]
    return out


def random_model(seed: int, *, n: int = 3, m: int = 2, g: int = 2, steps: int = 12) -> LinearGaussianModel:
    """Everything varies, some measurements are missing."""
    rng = np.random.default_rng(np.random.SeedSequence([418, seed]))
    y = rng.standard_normal((steps, m))
    y[3, m - 1] = np.nan
    y[5] = np.nan
    return LinearGaussianModel(
        F=0.6 * rng.standard_normal((steps, n, n)),
        H=rng.standard_normal((steps, m, n)),
        y=y,
        G=rng.standard_normal((steps, n, g)),
        B=rng.standard_normal((n, 1)),
        u=rng.standard_normal((steps, 1)),
        x0=rng.standard_normal(n),
        P0=np.eye(n) + 0.5,
    )


def covariance(seed: int, size: int) -> np.ndarray:
    """A well-conditioned covariance with correlations."""
    root = np.random.default_rng(np.random.SeedSequence([419, seed])).standard_normal((size, size))
    return root @ root.T / size + 0.3 * np.eye(size)


def joint_log_likelihood(model: LinearGaussianModel, Q: np.ndarray, R: np.ndarray) -> float:
    """Log-density of all measurements at once, from their joint normal distribution: no filter."""
    steps, n, m = model.n_steps, model.n_states, model.n_measurements
    F, H, G = (np.broadcast_to(M, (steps, *M.shape[-2:])) for M in (model.F, model.H, model.G))
    mean, C = [model.x0], np.zeros((steps * n, steps * n))
    C[:n, :n] = model.P0
    for k in range(steps - 1):
        mean.append(F[k] @ mean[k] + model.drive[k])
        here, there = slice(k * n, k * n + n), slice(k * n + n, k * n + 2 * n)
        C[there, : k * n + n] = F[k] @ C[here, : k * n + n]
        C[: k * n + n, there] = C[there, : k * n + n].T
        C[there, there] = F[k] @ C[here, here] @ F[k].T + G[k] @ Q @ G[k].T
    big = np.zeros((steps * m, steps * n))
    for k in range(steps):
        big[k * m : k * m + m, k * n : k * n + n] = H[k]
    S = big @ C @ big.T + np.kron(np.eye(steps), R)
    seen = np.isfinite(model.y.ravel())
    law = multivariate_normal((big @ np.concatenate(mean))[seen], S[np.ix_(seen, seen)])
    return float(law.logpdf(model.y.ravel()[seen]))


def state_rmse(model: LinearGaussianModel, states: np.ndarray, Q: float, R: float) -> float:
    """Root mean square error of position and velocity of a filter with constant variances.

    Written for this model alone, with scalars, so that it shares no code with the library.
    """
    (p, v), a, b, c = model.x0, model.P0[0, 0], model.P0[0, 1], model.P0[1, 1]
    drive, y = model.drive, model.y[:, 0]
    total = 0.0
    for k in range(len(y)):
        s = a + R
        e, k0, k1 = y[k] - p, a / s, b / s
        p, v = p + k0 * e, v + k1 * e
        a, b, c = a - k0 * a, b - k0 * b, c - k1 * b
        total += (p - states[k, 0]) ** 2 + (v - states[k, 1]) ** 2
        p, v = p + DT * v + drive[k, 0], v + drive[k, 1]
        a, b, c = (
            a + 2 * DT * b + DT**2 * c + Q * DT**4 / 4,
            b + DT * c + Q * DT**3 / 2,
            c + Q * DT**2,
        )
    return float(np.sqrt(total / len(y)))
