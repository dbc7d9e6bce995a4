"""Fisher information of noise covariances: what a record of this length can tell about them at best."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import LinearGaussianModel, check_covariance

__all__ = ["fisher_information"]


def fisher_information(
    model: LinearGaussianModel, Q: Any, R: Any, *, directions_Q: Any, directions_R: Any
) -> np.ndarray:
    """Expected information about parameters θ on which Q and R depend, at their true values.

    With the innovations e of covariance S and their derivatives by θ,
    ``I_ij = Σ ½ tr(S⁻¹ ∂_iS S⁻¹ ∂_jS) + E[∂_ieᵀ S⁻¹ ∂_je]``. At the true values the innovations are white, so
    the second term follows from a recursion for the covariance of ``∂x`` and no data are needed; only which
    measurements are missing matters (Cavanaugh & Shumway 1996, Stat. Probab. Lett. 26:347).

    Parameters
    ----------
    model : LinearGaussianModel
        Model and pattern of missing measurements.
    Q, R : array_like, shapes (g, g) and (m, m)
        True covariances.
    directions_Q, directions_R : array_like, shapes (d, g, g) and (d, m, m)
        Derivatives of Q and R by the d parameters.

    Returns
    -------
    ndarray, shape (d, d)
        Its inverse is the Cramér-Rao bound.

    Raises
    ------
    InvalidInput
        If a shape does not fit or Q or R is no covariance.
    """
    n, m, g, T = model.n_states, model.n_measurements, model.n_noises, model.n_steps
    Q, R = check_covariance("Q", Q, g), check_covariance("R", R, m, definite=True)
    dQ, dR = np.array(directions_Q, dtype=float), np.array(directions_R, dtype=float)
    d = len(dQ)
    if dQ.shape != (d, g, g) or dR.shape != (d, m, m):
        raise InvalidInput("directions", (dQ.shape, dR.shape), f"give shapes (d, {g}, {g}) and (d, {m}, {m})")
    P, dP, X = model.P0.copy(), np.zeros((d, n, n)), np.zeros((d, d, n, n))
    information, identity = np.zeros((d, d)), np.eye(n)
    observed = np.isfinite(model.y)
    for k in range(T):
        there = observed[k]
        if there.any():
            H = (model.H if model.H.ndim == 2 else model.H[k])[there]
            S = H @ P @ H.T + R[np.ix_(there, there)]
            inverse = np.linalg.inv(S)
            dS = H @ dP @ H.T + dR[:, there][:, :, there]
            gain = P @ H.T @ inverse
            d_gain = (dP @ H.T - gain @ dS) @ inverse
            scaled = inverse @ dS
            information += 0.5 * np.einsum("aij,bji->ab", scaled, scaled)
            information += np.einsum("ij,abji->ab", inverse, H @ X @ H.T)
            left = identity - gain @ H
            X = left @ X @ left.T
            X += np.einsum("aij,jk,blk->abil", d_gain, S, d_gain)
            # both follow from P⁺ = (I - K H) P
            dP = left @ dP - d_gain @ (H @ P)
            P = left @ P
            dP = 0.5 * (dP + np.swapaxes(dP, -1, -2))
            P = 0.5 * (P + P.T)
        if k < T - 1:
            F = model.F if model.F.ndim == 2 else model.F[k]
            G = model.G if model.G.ndim == 2 else model.G[k]
            P, dP, X = F @ P @ F.T + G @ Q @ G.T, F @ dP @ F.T + G @ dQ @ G.T, F @ X @ F.T
    return 0.5 * (information + information.T)
