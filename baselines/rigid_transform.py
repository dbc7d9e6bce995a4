"""Least-squares transforms of the plane in closed form: rigid, similarity and regularised affine.

Points are (north, east), so that a positive rotation is clockwise, as everywhere in navopt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from navopt.errors import InvalidInput

__all__ = [
    "AFFINE",
    "RIGID",
    "SIMILARITY",
    "PlaneTransform",
    "fit",
    "fit_affine",
    "fit_rigid",
    "fit_similarity",
]

RIGID, SIMILARITY, AFFINE = 0, 1, 2

_compiled: Any = njit(cache=True, nogil=True, error_model="numpy")


@dataclass(frozen=True)
class PlaneTransform:
    """The map ``y = A x + t`` of points of a plane.

    Attributes
    ----------
    matrix : ndarray, shape (2, 2)
        A.
    shift : ndarray, shape (2,)
        t, in the unit of the points.
    """

    matrix: np.ndarray
    shift: np.ndarray

    def __call__(self, points: ArrayLike) -> np.ndarray:
        """Transform points, shape (..., 2)."""
        return np.asarray(points, dtype=float) @ self.matrix.T + self.shift

    @property
    def rotation(self) -> float:
        """Angle of the rotation nearest to A, rad, from the first axis to the second."""
        (a, b), (c, d) = self.matrix
        return float(np.arctan2(c - b, a + d))

    @property
    def stretches(self) -> np.ndarray:
        """Singular values of A, the larger first, shape (2,)."""
        return np.linalg.svd(self.matrix, compute_uv=False)


def fit_rigid(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> PlaneTransform:
    """Rotation and translation that minimise ``sum_k w_k |y_k - R x_k - t|^2``.

    With centred points and W = sum w x y^T the rotation is atan2(W12 - W21, W11 + W22), which is the
    solution by singular values (Arun, Huang and Blostein 1987) with the reflection already excluded.

    Parameters
    ----------
    source, target : array_like, shape (n, 2)
        Pairs of points x and y.
    weights : array_like, shape (n,), optional
        Non-negative weights, equal by default.

    Returns
    -------
    PlaneTransform

    Raises
    ------
    InvalidInput
        If shapes do not fit, fewer than two points count, or all points that count are one.
    """
    return _fitted(source, target, weights, RIGID, 1.0, 1.0, 0.0)


def fit_similarity(
    source: ArrayLike,
    target: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    scale_limits: tuple[float, float] = (0.0, np.inf),
) -> PlaneTransform:
    """As `fit_rigid` with a scale s: ``s = sum w y.(R x) / sum w |x|^2`` over centred points.

    The rotation does not depend on the scale and the cost is quadratic in it, so that cutting s to its
    limits gives the constrained minimum.

    Parameters
    ----------
    source, target, weights
        As for `fit_rigid`.
    scale_limits : tuple of float
        Least and largest scale.

    Returns
    -------
    PlaneTransform

    Raises
    ------
    InvalidInput
        As for `fit_rigid`.
    """
    return _fitted(source, target, weights, SIMILARITY, *_limits(scale_limits), 0.0)


def fit_affine(
    source: ArrayLike,
    target: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    ridge: float = 0.1,
    scale_limits: tuple[float, float] = (0.0, np.inf),
) -> PlaneTransform:
    """Affine transform by least squares, drawn towards the best similarity.

    Minimises ``sum w |y - A x|^2 + mu |A - s R|^2`` over centred points, with mu = `ridge` times half
    of ``sum w |x|^2``. The points of a nearly straight track say nothing about the column of A across it;
    there the similarity s R, itself the least-squares one, is what remains.

    Parameters
    ----------
    source, target, weights
        As for `fit_rigid`.
    ridge : float
        Strength of the regularisation; 0 for plain least squares, which needs points off a line.
    scale_limits : tuple of float
        Least and largest stretch: s and the singular values of A are cut to them. For A this is the
        nearest matrix that keeps the limits, not the constrained minimum.

    Returns
    -------
    PlaneTransform

    Raises
    ------
    InvalidInput
        As for `fit_rigid`, or if `ridge` is negative.
    """
    if not (np.isfinite(ridge) and ridge >= 0.0):
        raise InvalidInput("ridge", ridge, "give a number that is not negative")
    return _fitted(source, target, weights, AFFINE, *_limits(scale_limits), float(ridge))


def _limits(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = (float(limit) for limit in limits)
    if not 0.0 <= low <= high:
        raise InvalidInput("scale_limits", limits, "give two numbers that are not negative, in order")
    return low, high


def _fitted(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None, kind: int, *settings: float
) -> PlaneTransform:
    x, y = (np.ascontiguousarray(points, dtype=float) for points in (source, target))
    if x.ndim != 2 or x.shape[1] != 2 or x.shape != y.shape:
        raise InvalidInput("source, target", f"{x.shape}, {y.shape}", "give two arrays of shape (n, 2)")
    w = np.ones(len(x)) if weights is None else np.ascontiguousarray(weights, dtype=float)
    if w.shape != (len(x),) or not (np.isfinite(w).all() and (w >= 0.0).all()):
        raise InvalidInput("weights", w.tolist(), f"give {len(x)} finite weights that are not negative")
    out = np.empty((3, 2))
    if not fit(x, y, w, kind, *settings, out):
        raise InvalidInput("source", x.tolist(), "give at least two different points of positive weight")
    return PlaneTransform(out[:2].copy(), out[2].copy())


@_compiled
def fit(x, y, w, kind, low, high, ridge, out):
    """Fill `out` with the fitted transform, for kernels; the functions above check and call it.

    Parameters
    ----------
    x, y : ndarray, shape (n, 2)
        Source and target; rows of weight 0 are not looked at.
    w : ndarray, shape (n,)
        Weights.
    kind : int
        `RIGID`, `SIMILARITY` or `AFFINE`.
    low, high : float
        Limits of the scale.
    ridge : float
        As for `fit_affine`.
    out : ndarray, shape (3, 2)
        The matrix, and the shift as last row.

    Returns
    -------
    bool
        False where the points do not determine a transform; `out` is then not changed.
    """
    n = x.shape[0]
    total = 0.0
    x0 = x1 = y0 = y1 = 0.0
    for k in range(n):
        if w[k] > 0.0:
            total += w[k]
            x0 += w[k] * x[k, 0]
            x1 += w[k] * x[k, 1]
            y0 += w[k] * y[k, 0]
            y1 += w[k] * y[k, 1]
    if not total > 0.0:
        return False
    x0, x1, y0, y1 = x0 / total, x1 / total, y0 / total, y1 / total
    c00 = c01 = c10 = c11 = s00 = s01 = s11 = 0.0
    for k in range(n):
        if w[k] > 0.0:
            u, v = x[k, 0] - x0, x[k, 1] - x1
            p, q = y[k, 0] - y0, y[k, 1] - y1
            c00 += w[k] * u * p
            c01 += w[k] * u * q
            c10 += w[k] * v * p
            c11 += w[k] * v * q
            s00 += w[k] * u * u
            s01 += w[k] * u * v
            s11 += w[k] * v * v
    spread = s00 + s11
    if not spread > 1e-24 * total * (x0 * x0 + x1 * x1 + 1e-300):
        return False
    angle = math.atan2(c01 - c10, c00 + c11)
    scale = 1.0
    if kind != RIGID:
        scale = min(max(math.hypot(c01 - c10, c00 + c11) / spread, low), high)
    a = scale * math.cos(angle)
    c = scale * math.sin(angle)
    b, d = -c, a
    if kind == AFFINE:
        mu = ridge * 0.5 * spread
        g00, g01, g11 = s00 + mu, s01, s11 + mu
        determinant = g00 * g11 - g01 * g01
        if not determinant > 1e-12 * (g00 + g11) * (g00 + g11):
            return False
        # C^T + mu s R, times the inverse of the damped spread
        m00, m01 = c00 + mu * a, c10 + mu * b
        m10, m11 = c01 + mu * c, c11 + mu * d
        a = (m00 * g11 - m01 * g01) / determinant
        b = (m01 * g00 - m00 * g01) / determinant
        c = (m10 * g11 - m11 * g01) / determinant
        d = (m11 * g00 - m10 * g01) / determinant
        a, b, c, d = _cut_stretches(a, b, c, d, low, high)
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = a, b, c, d
    out[2, 0] = y0 - (a * x0 + b * x1)
    out[2, 1] = y1 - (c * x0 + d * x1)
    return True


@_compiled
def _cut_stretches(a, b, c, d, low, high):
    """Cut the singular values of [[a, b], [c, d]] to an interval; a reflection becomes a thin rotation.

    A = Rot(f) diag(p + r, p - r) Rot(t), in closed form from the sums and differences of its elements.
    """
    e, f, g, h = 0.5 * (a + d), 0.5 * (a - d), 0.5 * (c + b), 0.5 * (c - b)
    p, r = math.hypot(e, h), math.hypot(f, g)
    if p + r <= high and p - r >= low:
        return a, b, c, d
    one, two = math.atan2(g, f), math.atan2(h, e)
    left, right = 0.5 * (two + one), 0.5 * (two - one)
    large, small = min(max(p + r, low), high), min(max(p - r, low), high)
    cl, sl, cr, sr = math.cos(left), math.sin(left), math.cos(right), math.sin(right)
    return (
        cl * large * cr - sl * small * sr,
        -cl * large * sr - sl * small * cr,
        sl * large * cr + cl * small * sr,
        -sl * large * sr + cl * small * cr,
    )
