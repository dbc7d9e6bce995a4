"""Products and inverses of small matrices in plain loops, which compile fast and beat BLAS below ten rows."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["add", "inverse_and_log_determinant", "product", "product_right_turned", "times_left_turned"]

Array = NDArray[np.float64]


@njit(cache=True)
def add(A: Array, B: Array, factor: float) -> None:
    """A + factor B, into A."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            A[i, j] += factor * B[i, j]


@njit(cache=True)
def product(A: Array, B: Array) -> Array:
    """A B."""
    rows, inner = A.shape
    columns = B.shape[1]
    out = np.zeros((rows, columns))
    for i in range(rows):
        for k in range(inner):
            a = A[i, k]
            if a != 0.0:
                for j in range(columns):
                    out[i, j] += a * B[k, j]
    return out


@njit(cache=True)
def product_right_turned(A: Array, B: Array) -> Array:
    """A Bᵀ."""
    rows, inner = A.shape
    columns = B.shape[0]
    out = np.zeros((rows, columns))
    for i in range(rows):
        for j in range(columns):
            total = 0.0
            for k in range(inner):
                total += A[i, k] * B[j, k]
            out[i, j] = total
    return out


@njit(cache=True)
def times_left_turned(A: Array, B: Array) -> Array:
    """Aᵀ B."""
    inner, rows = A.shape
    columns = B.shape[1]
    out = np.zeros((rows, columns))
    for k in range(inner):
        for i in range(rows):
            a = A[k, i]
            if a != 0.0:
                for j in range(columns):
                    out[i, j] += a * B[k, j]
    return out


@njit(cache=True)
def inverse_and_log_determinant(S: Array) -> tuple[Array, float]:
    """Inverse and logarithm of the determinant of a positive definite matrix; NaN if it is not."""
    size = S.shape[0]
    L = np.zeros((size, size))
    log_determinant = 0.0
    for j in range(size):
        total = S[j, j]
        for k in range(j):
            total -= L[j, k] * L[j, k]
        if not total > 0.0:
            return np.full((size, size), np.nan), np.nan
        L[j, j] = np.sqrt(total)
        log_determinant += np.log(total)
        for i in range(j + 1, size):
            total = S[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total / L[j, j]
    half = np.zeros((size, size))
    for j in range(size):
        half[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, size):
            total = 0.0
            for k in range(j, i):
                total -= L[i, k] * half[k, j]
            half[i, j] = total / L[i, i]
    out = np.zeros((size, size))
    for i in range(size):
        for j in range(size):
            total = 0.0
            for k in range(max(i, j), size):
                total += half[k, i] * half[k, j]
            out[i, j] = total
    return out, log_determinant
