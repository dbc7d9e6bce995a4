"""Candidates of a batched filter: their shapes, and what is wrong with them."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import InvalidInput

__all__ = ["as_candidates", "judge"]

#: Largest relative asymmetry taken for rounding.
ASYMMETRY = 1e-9


def as_candidates(name: str, value: Any, size: int, steps: int) -> np.ndarray:
    """Candidates as an array of shape (K, 1 or steps, size, size).

    Parameters
    ----------
    name : str
        What the matrix is called in messages.
    value : array_like, shape (size, size), (K, size, size) or (K, steps, size, size)
        One or many matrices, or one per candidate and step.
    size, steps : int
        Expected sizes.

    Raises
    ------
    InvalidInput
        If it has another shape.
    """
    try:
        matrix = np.ascontiguousarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(name, value, "give an array of numbers") from None
    if matrix.ndim == 2:
        matrix = matrix[None]
    if matrix.ndim == 3:
        matrix = matrix[:, None]
    if matrix.ndim != 4 or matrix.shape[1] not in (1, steps) or matrix.shape[2:] != (size, size):
        raise InvalidInput(
            name,
            f"shape {np.shape(value)}",
            f"give ({size}, {size}), (K, {size}, {size}) or (K, {steps}, {size}, {size})",
        )
    return matrix


def judge(
    name: str, matrix: np.ndarray, *, definite: bool
) -> tuple[list[str | None] | None, np.ndarray | None]:
    """Find out what is wrong with each candidate's matrices, and which are not diagonal.

    The judgement on a candidate does not depend on the others.

    Parameters
    ----------
    name : str
        What the matrix is called in messages.
    matrix : ndarray, shape (K, steps, k, k)
    definite : bool
        Whether they must be positive definite, or semi-definite.

    Returns
    -------
    tuple of (list of (str or None) or None) and (ndarray, shape (K,), or None)
        Reasons, None if there is none at all; whether a matrix of the candidate is not diagonal, None if all
        are.
    """
    size = matrix.shape[-1]
    variances = matrix.reshape(*matrix.shape[:2], size * size)[..., :: size + 1]
    full = None
    if size == 1 or np.count_nonzero(matrix) == np.count_nonzero(variances):
        # all diagonal: the common case, and a swarm asks it thousands of times
        least, largest = np.minimum.reduce(variances, None), np.maximum.reduce(variances, None)
        # NaN fails every comparison
        if (least > 0.0 or (least == 0.0 and not definite)) and largest < np.inf:
            return None, None
    else:
        full = (matrix[..., ~np.eye(size, dtype=bool)] != 0.0).any(axis=(1, 2))
    reasons: list[str | None] = [None] * len(matrix)
    finite = np.isfinite(matrix).all(axis=(1, 2, 3))
    low = (variances <= 0.0 if definite else variances < 0.0).any(axis=(1, 2))
    for k in np.flatnonzero(~finite | low):
        wrong = ~np.isfinite(matrix[k]) if not finite[k] else None
        if wrong is not None:
            _, i, j = (int(v) for v in np.argwhere(wrong)[0])
            reasons[k] = f"{name}[{i}, {j}] is not finite"
        else:
            bad = variances[k] <= 0.0 if definite else variances[k] < 0.0
            i = int(np.argwhere(bad)[0, 1])
            reasons[k] = f"{name}[{i}, {i}] is {'not positive' if definite else 'negative'}"
    if full is not None:
        numbers = np.flatnonzero(finite & ~low & full)
        chosen = matrix[numbers]
        turned = np.swapaxes(chosen, -1, -2)
        scale = np.abs(chosen).max(axis=(-2, -1), keepdims=True)
        skew = (np.abs(chosen - turned) > ASYMMETRY * scale).any(axis=(1, 2, 3))
        sigma = np.sqrt(np.where(variances[numbers] > 0.0, variances[numbers], 1.0))
        # eigenvalues of correlations, whatever the units
        least = np.linalg.eigvalsh(chosen / (sigma[..., :, None] * sigma[..., None, :]))[..., 0].min(axis=1)
        limit = 1e-14 if definite else -1e-10
        for k, crooked, value in zip(numbers, skew, least, strict=True):
            if crooked:
                reasons[k] = f"{name} is not symmetric"
            elif value < limit * size:
                reasons[k] = f"{name} is not positive {'definite' if definite else 'semi-definite'}"
    return reasons, full
