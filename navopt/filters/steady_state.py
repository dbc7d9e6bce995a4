"""What a filter of a constant model settles to: the discrete Riccati equation, and a case in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, solve_discrete_are

from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import check_covariance, check_finite

__all__ = ["SteadyState", "alpha_beta", "steady_state"]


@dataclass(frozen=True)
class SteadyState:
    """A Kalman filter in the long run.

    Attributes
    ----------
    predicted_covariance, covariance : ndarray, shape (n, n)
        Of the state before and after a measurement.
    gain : ndarray, shape (n, m)
        ``K`` in ``x⁺ = x⁻ + K e``.
    innovation_covariance : ndarray, shape (m, m)
        ``S``.
    """

    predicted_covariance: np.ndarray
    covariance: np.ndarray
    gain: np.ndarray
    innovation_covariance: np.ndarray


def steady_state(F: Any, H: Any, Q: Any, R: Any, *, G: Any = None) -> SteadyState:
    """Solve the discrete algebraic Riccati equation of a constant model.

    Parameters
    ----------
    F, H : array_like, shapes (n, n) and (m, n)
        Transition and measurement matrix.
    Q, R : array_like, shapes (g, g) and (m, m)
        Noise covariances.
    G : array_like, shape (n, g), optional
        Where the process noise enters; the identity if not given.

    Returns
    -------
    SteadyState

    Raises
    ------
    InvalidInput
        If a shape does not fit, Q or R is no covariance, or the filter settles to nothing: an unstable or
        constant state that is not seen, or that no noise reaches.
    """
    F, H = np.array(F, dtype=float), np.array(H, dtype=float)
    if F.ndim != 2 or F.shape[0] != F.shape[1]:
        raise InvalidInput("F", f"shape {F.shape}", "give one square matrix: the model must be constant")
    n = len(F)
    if H.ndim != 2 or H.shape[1] != n:
        raise InvalidInput("H", f"shape {H.shape}", f"give one matrix with {n} columns")
    G = np.eye(n) if G is None else np.array(G, dtype=float)
    if G.ndim != 2 or G.shape[0] != n:
        raise InvalidInput("G", f"shape {G.shape}", f"give one matrix with {n} rows")
    for name, matrix in (("F", F), ("H", H), ("G", G)):
        check_finite(name, matrix)
    Q = check_covariance("Q", Q, G.shape[1])
    R = check_covariance("R", R, len(H), definite=True)
    try:
        P = solve_discrete_are(F.T, H.T, G @ Q @ G.T, R)
    except (LinAlgError, ValueError) as error:
        raise InvalidInput(
            "F, H, G, Q",
            f"no stabilising solution ({error})",
            "every state that does not die out must be seen in the measurements and be reached by noise",
        ) from None
    S = H @ P @ H.T + R
    gain = np.linalg.solve(S, H @ P).T
    left = np.eye(n) - gain @ H
    return SteadyState(P, left @ P @ left.T + gain @ R @ gain.T, gain, S)


def alpha_beta(process_variance: float, measurement_variance: float, interval: float) -> tuple[float, float]:
    """Gains of the alpha-beta filter in closed form (Kalata 1984, IEEE Trans. Aerosp. Electron. Syst. 20).

    It is the steady state of position and velocity under random acceleration that is constant over a step.
    With the tracking index ``Λ = Δt² √q / √r``: ``α = 1 - ρ²`` and ``β = 2 (1 - ρ)²``,
    ``ρ = (4 + Λ - √(8 Λ + Λ²)) / 4``. The gain of the Kalman filter is ``(α, β / Δt)``.

    Parameters
    ----------
    process_variance : float
        Variance q of the acceleration, (m/s²)².
    measurement_variance : float
        Variance r of the measured position, m².
    interval : float
        Time step Δt, s.

    Returns
    -------
    tuple of float
        α and β.

    Raises
    ------
    InvalidInput
        If a value is not positive.
    """
    values = {
        "process_variance": process_variance,
        "measurement_variance": measurement_variance,
        "interval": interval,
    }
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InvalidInput(name, value, "give a positive number")
    index = interval**2 * np.sqrt(process_variance / measurement_variance)
    # 1 - ρ without the difference of nearly equal numbers
    step = (np.sqrt(8.0 * index + index**2) - index) / 4.0
    return float(step * (2.0 - step)), float(2.0 * step**2)
