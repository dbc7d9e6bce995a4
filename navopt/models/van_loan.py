"""From continuous noise to discrete noise: transition and covariance over one time step."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput

__all__ = ["discretise", "discretise_first_order"]

Array = NDArray[np.float64]


def discretise(F: ArrayLike, density: ArrayLike, step: float) -> tuple[Array, Array]:
    """Return transition and noise covariance of a linear system over one step, exactly (Van Loan, 1978).

    For ``x' = F x + w`` with white noise w of the two-sided density W, the matrix exponential of
    ``[[-F, W], [0, F^T]] step`` holds, in its lower right block, the transposed transition, and in its upper
    right one what gives the covariance ``integral of e^(Fs) W e^(Fs)^T ds`` from 0 to `step`.

    Parameters
    ----------
    F : array_like, shape (..., n, n)
        Dynamics, 1/s.
    density : array_like, shape (..., n, n)
        ``G Q_c G^T``, squared units of the state per second: (m/s^2)^2/Hz for noise on a velocity,
        (rad/s)^2/Hz for noise on an angle. Broadcasts with `F`.
    step : float
        Length of the step, s.

    Returns
    -------
    transition : ndarray, shape (..., n, n)
    covariance : ndarray, shape (..., n, n)
        Exactly symmetric.

    Raises
    ------
    InvalidInput
        If a shape does not fit, an entry is not finite, or the step is not positive.

    Notes
    -----
    The covariance is linear in the density, which is therefore brought to size one first: noise of 1e-13
    beside a dynamics of 10 would otherwise be lost in the rounding of the exponential. For the same reason
    the covariance of noises of very different sizes is best made as a sum, one source at a time.

    Examples
    --------
    Noise on a velocity reaches the position with the third power of the time:

    >>> transition, covariance = discretise([[0, 1], [0, 0]], [[0, 0], [0, 3.0]], 2.0)
    >>> transition.tolist()
    [[1.0, 2.0], [0.0, 1.0]]
    >>> covariance.round(12).tolist()
    [[8.0, 6.0], [6.0, 6.0]]
    """
    from scipy.linalg import expm

    dynamics, noise, h = _checked(F, density, step)
    n = dynamics.shape[-1]
    # in a long step of a stable system e^(-F h) overflows what e^(F h) takes back: double a short one
    reach = h * float(np.abs(dynamics).sum(axis=-1).max(initial=0.0))
    doublings = max(0, int(np.ceil(np.log2(reach)))) if reach > 1.0 else 0
    size = np.abs(noise).max(axis=(-2, -1), keepdims=True)
    size = np.where(size > 0.0, size, 1.0)
    block = np.zeros((*dynamics.shape[:-2], 2 * n, 2 * n))
    block[..., :n, :n] = -dynamics
    block[..., :n, n:] = noise / size
    block[..., n:, n:] = np.swapaxes(dynamics, -1, -2)
    whole = np.asarray(expm(block * (h / 2**doublings)))
    transition = np.ascontiguousarray(np.swapaxes(whole[..., n:, n:], -1, -2))
    covariance = size * (transition @ whole[..., :n, n:])
    for _ in range(doublings):
        covariance = covariance + transition @ covariance @ np.swapaxes(transition, -1, -2)
        transition = transition @ transition
    return transition, 0.5 * (covariance + np.swapaxes(covariance, -1, -2))


def discretise_first_order(F: ArrayLike, density: ArrayLike, step: float) -> tuple[Array, Array]:
    """Return what textbooks use in place of `discretise` for short steps.

    ``I + F h + (F h)^2 / 2`` and the trapezium ``(transition W transition^T + W) h / 2``: the error of the
    first falls with the third power of the step. Of the second not even the leading term is always right: a
    double integral comes out at 3/2 of its value.

    Parameters
    ----------
    F, density, step
        As for `discretise`.

    Returns
    -------
    transition, covariance : ndarray, shape (..., n, n)

    Raises
    ------
    InvalidInput
        As for `discretise`.
    """
    dynamics, noise, h = _checked(F, density, step)
    turned = dynamics * h
    transition = np.eye(dynamics.shape[-1]) + turned + 0.5 * turned @ turned
    covariance = 0.5 * h * (transition @ noise @ np.swapaxes(transition, -1, -2) + noise)
    return transition, 0.5 * (covariance + np.swapaxes(covariance, -1, -2))


def _checked(F: ArrayLike, density: ArrayLike, step: float) -> tuple[Array, Array, float]:
    dynamics, noise = np.asarray(F, dtype=np.float64), np.asarray(density, dtype=np.float64)
    if dynamics.ndim < 2 or dynamics.shape[-1] != dynamics.shape[-2]:
        raise InvalidInput("F", f"shape {dynamics.shape}", "give square matrices, shape (..., n, n)")
    if noise.ndim < 2 or noise.shape[-2:] != dynamics.shape[-2:]:
        n = dynamics.shape[-1]
        raise InvalidInput("density", f"shape {noise.shape}", f"give matrices of shape (..., {n}, {n})")
    for name, value in (("F", dynamics), ("density", noise)):
        if not np.isfinite(value).all():
            where = tuple(int(k) for k in np.argwhere(~np.isfinite(value))[0])
            raise InvalidInput(f"{name}{list(where)}", float(value[where]), "give finite entries")
    if isinstance(step, bool) or not np.isfinite(step) or not step > 0.0:
        raise InvalidInput("step", step, "give a positive number of seconds")
    dynamics, noise = np.broadcast_arrays(dynamics, noise)
    return np.array(dynamics), np.array(noise), float(step)
