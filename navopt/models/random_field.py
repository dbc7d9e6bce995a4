"""Random fields on a grid: Gaussian, stationary, isotropic, of a given correlation.

They stand for what is wrong with a map: an error that is the same whenever a vehicle comes by the same place,
and nearly the same a little farther on.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navopt.errors import InvalidInput, UnknownName

__all__ = ["CORRELATIONS", "correlation", "random_field"]

#: Shapes of the correlation over distance: smooth, and rough (that of a first-order Markov process).
CORRELATIONS = ("gaussian", "exponential")


def correlation(distance: NDArray[np.float64], length: float, shape: str = "gaussian") -> NDArray[np.float64]:
    """Correlation of a field at two points, by their distance.

    Parameters
    ----------
    distance : ndarray
        Metres.
    length : float
        Distance at which the correlation is 1/e, m.
    shape : {"gaussian", "exponential"}
        ``exp(−(d/L)²)`` or ``exp(−d/L)``.

    Returns
    -------
    ndarray
        Shape of `distance`.

    Raises
    ------
    InvalidInput
        If the length is not positive.
    UnknownName
        If the shape is not known.
    """
    if shape not in CORRELATIONS:
        raise UnknownName("shape", shape, CORRELATIONS)
    if not (np.isfinite(length) and length > 0.0):
        raise InvalidInput("length", length, "give a positive number of metres")
    ratio = np.asarray(distance, dtype=np.float64) / length
    return np.exp(-(ratio**2) if shape == "gaussian" else -ratio)


def random_field(
    nodes: tuple[int, int],
    steps: tuple[float, float],
    length: float,
    rng: np.random.Generator,
    *,
    shape: str = "gaussian",
) -> NDArray[np.float64]:
    """Draw a field of mean zero and variance one on a plane grid.

    Parameters
    ----------
    nodes : tuple of int
        Rows and columns.
    steps : tuple of float
        Distance between rows and between columns, m.
    length : float
        Distance at which the correlation is 1/e, m.
    rng : numpy.random.Generator
        Source of randomness.
    shape : {"gaussian", "exponential"}, keyword-only
        See `correlation`.

    Returns
    -------
    ndarray, shape (rows, columns)

    Raises
    ------
    InvalidInput
        If a size or length is not positive.
    UnknownName
        If the shape is not known.

    Notes
    -----
    Circulant embedding: the covariance of a torus that is larger than the grid by eight lengths or more is
    diagonal in the Fourier basis, so a draw is exact but for the wrapped tail of the correlation (3e-4 and
    less). Eigenvalues that come out negative by rounding are taken as zero.
    """
    from scipy import fft

    if min(nodes) < 1 or not (np.isfinite(steps).all() and min(steps) > 0.0):
        raise InvalidInput("nodes, steps", (nodes, steps), "give positive numbers of nodes and metres")
    correlation(np.zeros(1), length, shape)
    sizes = [
        fft.next_fast_len(count + math.ceil(8.0 * length / step))
        for count, step in zip(nodes, steps, strict=True)
    ]
    # distance on the torus, the short way round
    rows, columns = (
        step * np.minimum(np.arange(size), size - np.arange(size))
        for size, step in zip(sizes, steps, strict=True)
    )
    spectrum = fft.fft2(correlation(np.hypot(rows[:, None], columns), length, shape)).real
    white = fft.fft2(rng.standard_normal((sizes[0], sizes[1])))
    drawn = fft.ifft2(np.sqrt(np.maximum(spectrum, 0.0)) * white).real
    return np.ascontiguousarray(drawn[: nodes[0], : nodes[1]])
