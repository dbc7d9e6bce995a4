"""The unscented transform in compiled pieces: roots of covariances, sigma points, moments, linearisation.

Everything is written in deviations from the central point. With weights ``w = 1 / (2 (n + λ))`` of the outer
points and ``δ`` the mean deviation,

    mean = χ₀ + δ,   δ = w Σ dᵢ,   covariance = w Σ dᵢ dᵢᵀ + (β − α²) δ δᵀ,

which is the scaled transform (Julier 2002; van der Merwe 2004) exactly, because its weights add up to 1 for
the mean and to 2 − α² + β for the covariance. The large weights of opposite sign (10⁶ for α = 0.001) never
appear, angles can be wrapped point by point, and for β ≥ α² the covariance is positive by construction. What
stays is that points lie α standard deviations from the mean and are rounded as numbers of its size: relative
errors of the covariance are about ``1e-16 |x| / (α σ)``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

__all__ = [
    "downdate",
    "factorise",
    "linearise",
    "moments",
    "moments_root",
    "solve_lower",
    "spread_points",
    "triangularise",
    "weights",
    "wrap",
]

_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")

#: Part of a variance below which a pivot of a root counts as zero.
SEMIDEFINITE = 1e-15


@_compiled
def weights(n: int, alpha: float, beta: float, kappa: float) -> tuple[float, float, float]:
    """Scale of the sigma points, weight of each outer point, and weight of the square of the mean deviation.

    Parameters
    ----------
    n : int
        Number of states.
    alpha, beta, kappa : float
        Parameters of the scaled transform; ``λ = α² (n + κ) − n``.

    Returns
    -------
    tuple of float
        ``√(n + λ)``, ``1 / (2 (n + λ))`` and ``β − α²``.
    """
    square = alpha * alpha * (n + kappa)
    return math.sqrt(square), 0.5 / square, beta - alpha * alpha


@_compiled
def wrap(angle: float) -> float:
    """Angle in [−π, π), in radians; those inside are not touched."""
    if -math.pi <= angle < math.pi:
        return angle
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@_compiled
def factorise(matrix: np.ndarray, root: np.ndarray) -> int:
    """Lower root L with ``L Lᵀ = matrix``, also of a semi-definite one; the lower triangle is read.

    Parameters
    ----------
    matrix, root : ndarray, shape (n, n)
        Covariance, and where its root is written.

    Returns
    -------
    int
        −1, or the first row at which the matrix is not positive semi-definite.
    """
    n = len(matrix)
    for j in range(n):
        variance = matrix[j, j]
        rest = variance
        for k in range(j):
            rest -= root[j, k] * root[j, k]
        floor = SEMIDEFINITE * n * variance
        # written so that NaN fails
        if not (0.0 <= variance < np.inf and rest >= -floor):
            return j
        for i in range(j):
            root[i, j] = 0.0
        pivot = math.sqrt(rest) if rest > floor else 0.0
        root[j, j] = pivot
        for i in range(j + 1, n):
            value = matrix[i, j]
            for k in range(j):
                value -= root[i, k] * root[j, k]
            if pivot > 0.0:
                root[i, j] = value / pivot
            elif value * value > 100.0 * floor * abs(matrix[i, i]):
                return i
            else:
                root[i, j] = 0.0
    return -1


@_compiled
def triangularise(rows: np.ndarray, root: np.ndarray) -> None:
    """Lower root with ``L Lᵀ = rowsᵀ rows``, by Householder reflections; `rows` is overwritten.

    Parameters
    ----------
    rows : ndarray, shape (k, n)
        At least n rows.
    root : ndarray, shape (n, n)
        Where the root is written; its diagonal is not negative.
    """
    k, n = rows.shape
    moved = np.empty(n)
    for j in range(n):
        square = 0.0
        for i in range(j, k):
            square += rows[i, j] * rows[i, j]
        for i in range(j):
            root[i, j] = 0.0
        if square == 0.0:
            for i in range(j, n):
                root[i, j] = 0.0
            continue
        turned = -math.sqrt(square) if rows[j, j] > 0.0 else math.sqrt(square)
        rows[j, j] -= turned
        factor = 1.0 / (turned * rows[j, j])
        for c in range(j + 1, n):
            moved[c] = 0.0
        for i in range(j, k):
            value = rows[i, j]
            for c in range(j + 1, n):
                moved[c] += value * rows[i, c]
        for i in range(j, k):
            value = rows[i, j] * factor
            for c in range(j + 1, n):
                rows[i, c] += value * moved[c]
        sign = 1.0 if turned > 0.0 else -1.0
        root[j, j] = sign * turned
        for c in range(j + 1, n):
            root[c, j] = sign * rows[j, c]


@_compiled
def downdate(root: np.ndarray, vector: np.ndarray) -> int:
    """Root of ``L Lᵀ − v vᵀ``, in place; `vector` is overwritten.

    Returns
    -------
    int
        −1, or the row at which the difference is not positive.
    """
    n = len(root)
    for k in range(n):
        if vector[k] == 0.0:
            continue
        rest = root[k, k] * root[k, k] - vector[k] * vector[k]
        if not rest > 0.0:
            return k
        pivot = math.sqrt(rest)
        cosine, sine = pivot / root[k, k], vector[k] / root[k, k]
        root[k, k] = pivot
        for i in range(k + 1, n):
            root[i, k] = (root[i, k] - sine * vector[i]) / cosine
            vector[i] = cosine * vector[i] - sine * root[i, k]
    return -1


@_compiled
def solve_lower(root: np.ndarray, vector: np.ndarray) -> None:
    """``L⁻¹ v``, in place."""
    for i in range(len(vector)):
        value = vector[i]
        for j in range(i):
            value -= root[i, j] * vector[j]
        vector[i] = value / root[i, i]


@_compiled
def spread_points(x: np.ndarray, root: np.ndarray, scale: float, points: np.ndarray) -> None:
    """Sigma points: the mean, then the mean plus, then minus, each column of the scaled root.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Mean.
    root : ndarray, shape (n, n)
        Lower root of the covariance.
    scale : float
        ``√(n + λ)``.
    points : ndarray, shape (2n + 1, n)
        Where they are written.
    """
    n = len(x)
    for i in range(n):
        points[0, i] = x[i]
    for j in range(n):
        for i in range(n):
            step = scale * root[i, j]
            points[1 + j, i] = x[i] + step
            points[1 + n + j, i] = x[i] - step


@_compiled
def _deviate(points, each, mean):
    """Turn all but the first point into deviations from it; the mean and its own deviation."""
    count, n = points.shape
    shift = np.zeros(n)
    for k in range(1, count):
        for i in range(n):
            points[k, i] -= points[0, i]
            shift[i] += points[k, i]
    for i in range(n):
        shift[i] *= each
        mean[i] = points[0, i] + shift[i]
    return shift


@_compiled
def moments(
    points: np.ndarray,
    each: float,
    centre: float,
    noise: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
) -> None:
    """Mean and covariance of sigma points plus the covariance of additive noise.

    Parameters
    ----------
    points : ndarray, shape (2n + 1, n)
        Images of the sigma points; the outer ones come back as deviations from the first.
    each, centre : float
        Second and third result of `weights`.
    noise : ndarray, shape (n, n)
        Covariance that is added.
    mean, covariance : ndarray, shapes (n,) and (n, n)
        Where the moments are written.
    """
    n = points.shape[1]
    shift = _deviate(points, each, mean)
    covariance[:, :] = 0.0
    for k in range(1, len(points)):
        for i in range(n):
            value = points[k, i]
            for j in range(i + 1):
                covariance[i, j] += value * points[k, j]
    for i in range(n):
        for j in range(i + 1):
            value = each * covariance[i, j] + centre * shift[i] * shift[j] + noise[i, j]
            covariance[i, j] = value
            covariance[j, i] = value


@_compiled
def moments_root(
    points: np.ndarray,
    each: float,
    centre: float,
    noise_root: np.ndarray,
    mean: np.ndarray,
    transition: np.ndarray,
    root: np.ndarray,
) -> int:
    """As `moments`, for roots: no covariance is formed, so half the digits are enough.

    Parameters
    ----------
    points, each, centre, mean
        As in `moments`.
    noise_root : ndarray, shape (n, n)
        Lower root of the covariance that is added.
    transition, root : ndarray, shape (n, n)
        Where the roots of the covariance without and with the noise are written.

    Returns
    -------
    int
        −1, or the row at which the covariance is not positive, which only ``β < α²`` can do.
    """
    count, n = points.shape
    shift = _deviate(points, each, mean)
    rows = np.empty((count, n))
    weight, extra = math.sqrt(each), math.sqrt(max(centre, 0.0))
    for k in range(1, count):
        for i in range(n):
            rows[k, i] = weight * points[k, i]
    for i in range(n):
        rows[0, i] = extra * shift[i]
    triangularise(rows, transition)
    if centre < 0.0:
        for i in range(n):
            shift[i] *= math.sqrt(-centre)
        row = downdate(transition, shift)
        if row >= 0:
            return row
    both = np.empty((2 * n, n))
    for k in range(n):
        for i in range(n):
            both[k, i] = transition[i, k]
            both[n + k, i] = noise_root[i, k]
    triangularise(both, root)
    return -1


@_compiled
def linearise(
    images: np.ndarray,
    wrapped: np.ndarray,
    root: np.ndarray,
    scale: float,
    each: float,
    centre: float,
    predicted: np.ndarray,
    H: np.ndarray,
    extra: np.ndarray,
) -> None:
    """Statistical linearisation of a measurement: ``z ≈ ẑ + H (x − x̂) + e``, ``cov e = Ω``.

    With deviations ``d±`` of the images of the jth pair of points, ``H L`` has the columns ``(d₊ − d₋) / (2
    √(n + λ))`` and ``Ω = 2 w Σ e eᵀ + (β − α²) δ δᵀ``, ``e = (d₊ + d₋) / 2``. Then ``H P`` is the
    cross-covariance and ``H P Hᵀ + Ω`` the covariance of the unscented transform, exactly, and a linear
    measurement has Ω = 0.

    Parameters
    ----------
    images : ndarray, shape (2n + 1, m)
        Measurements of the sigma points; overwritten.
    wrapped : ndarray of bool, shape (m,)
        Channels that are angles in radians.
    root : ndarray, shape (n, n)
        Lower root L the points were spread with.
    scale, each, centre : float
        Results of `weights`.
    predicted, H, extra : ndarray, shapes (m,), (m, n) and (m, m)
        Where ẑ, H and Ω are written.
    """
    m, n = H.shape
    shift = np.zeros(m)
    extra[:, :] = 0.0
    even = np.empty(m)
    for j in range(n):
        for a in range(m):
            plus = images[1 + j, a] - images[0, a]
            minus = images[1 + n + j, a] - images[0, a]
            if wrapped[a]:
                plus, minus = wrap(plus), wrap(minus)
            H[a, j] = 0.5 * (plus - minus) / scale
            even[a] = 0.5 * (plus + minus)
            shift[a] += even[a]
        for a in range(m):
            for b in range(a + 1):
                extra[a, b] += even[a] * even[b]
    for a in range(m):
        shift[a] *= 2.0 * each
        predicted[a] = images[0, a] + shift[a]
    for a in range(m):
        for b in range(a + 1):
            value = 2.0 * each * extra[a, b] + centre * shift[a] * shift[b]
            extra[a, b] = value
            extra[b, a] = value
        # H from H L; along a column of zeros the state does not vary and H does not matter
        for j in range(n - 1, -1, -1):
            value = H[a, j]
            for i in range(j + 1, n):
                value -= H[a, i] * root[i, j]
            H[a, j] = value / root[j, j] if root[j, j] > 0.0 else 0.0
