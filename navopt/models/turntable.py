"""Least squares on a turntable record: all twelve parameters, sensor by sensor, in one linear step."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.triad import GyroTriad

__all__ = ["fit_turntable", "triad_from_rows"]

Array = NDArray[np.float64]

_OTHERS = ((1, 2), (0, 2), (0, 1))


def fit_turntable(counts: ArrayLike, rates: ArrayLike, sigma: float) -> tuple[GyroTriad, Array]:
    """Fit ``counts_i = θ1 ω_x + θ2 ω_y + θ3 ω_z + θ4`` to each sensor (the 24-position method).

    Parameters
    ----------
    counts : array_like, shape (m, 3)
        Averaged output.
    rates : array_like, shape (m, 3)
        Known rates in body axes, rad/s.
    sigma : float
        Noise of an averaged channel, in the unit of the rates.

    Returns
    -------
    triad : GyroTriad
        Scale factor, the two misalignments and bias of each sensor: θ_i, θ_k/θ_i, θ4/θ_i.
    covariance : ndarray, shape (12, 12)
        Of `SensorTriad.vector`, to first order.

    Raises
    ------
    InvalidInput
        If the rates do not tell the four unknowns of a sensor apart; the message says which do not vary.

    Notes
    -----
    On `navopt.models.twenty_four_positions`, σ(bias) = σ/√24 and σ(scale)/scale = σ(E_ik) = σ/(Ω √8), up to
    the size of the other parameters: the design's columns are orthogonal.
    """
    y, w = np.asarray(counts, dtype=np.float64), np.asarray(rates, dtype=np.float64)
    if y.ndim != 2 or y.shape[1:] != (3,) or w.shape != y.shape:
        raise InvalidInput("counts and rates", (y.shape, w.shape), "give both with shape (positions, 3)")
    if not (np.isfinite(y).all() and np.isfinite(w).all()):
        raise InvalidInput("counts and rates", "NaN or infinite values", "leave out positions that have gaps")
    size = float(np.sqrt(np.mean(w**2))) or 1.0
    design = np.concatenate([w / size, np.ones((len(w), 1))], axis=1)
    u, s, v = np.linalg.svd(design, full_matrices=False)
    if len(w) < 4 or s[-1] < 1e-8 * s[0]:
        raise InvalidInput("rates", f"{len(w)} positions", _missing(v, s, len(w)))
    pseudo = (v.T / s) @ u.T
    theta = (pseudo @ y).T / np.array([size, size, size, 1.0])
    unit = pseudo @ pseudo.T / np.outer(*(2 * [np.array([size, size, size, 1.0])]))
    return triad_from_rows(theta, unit, sigma)


def triad_from_rows(theta: Array, unit: Array, sigma: float) -> tuple[GyroTriad, Array]:
    """Turn linear fits of the three sensors into a triad with its covariance.

    Parameters
    ----------
    theta : ndarray, shape (3, 4)
        Counts per rate about x, y and z, and at rest, of each sensor.
    unit : ndarray, shape (4, 4)
        Their covariance for noise of one count; it is the same for each sensor.
    sigma : float
        Noise of a channel, rad/s.

    Returns
    -------
    triad : GyroTriad
    covariance : ndarray, shape (12, 12)
        Of `SensorTriad.vector`, to first order; the sensors err independently.
    """
    triad = GyroTriad.from_matrix(theta[:, :3], theta[:, 3])
    covariance = np.zeros((12, 12))
    for i, others in enumerate(_OTHERS):
        scale = theta[i, i]
        places = [i, 3 + i, 6 + 2 * i, 7 + 2 * i]
        change = np.zeros((4, 4))
        change[0, i] = 1.0
        for row, column in ((1, 3), (2, others[0]), (3, others[1])):
            change[row, column] = 1.0 / scale
            change[row, i] -= theta[i, column] / scale**2
        covariance[np.ix_(places, places)] = (scale * sigma) ** 2 * change @ unit @ change.T
    return triad, covariance


def _missing(directions: Array, sizes: Array, positions: int) -> str:
    if positions < 4:
        return "at least four positions are needed, six to tell every axis; 24 are usual"
    names = ("rate about x", "rate about y", "rate about z", "offset")
    weak = directions[-1] if len(directions) == 4 else np.zeros(4)
    terms = [
        f"{weight:+.2g} x {name}" for weight, name in zip(weak, names, strict=True) if abs(weight) > 0.05
    ]
    return (
        f"the same combination of rates at every position ({' '.join(terms)} is constant): "
        "turn the block so that each axis points up and down, or add rates about the missing axis"
    )
