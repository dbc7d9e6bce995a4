"""Geometry of a swarm of fish: who is in sight, where its centre is, one step towards something.

Pure functions of plain arrays with any leading axes before ``(n, d)``. Lengths are counted in units of
`scale`, shape (d,): the widths of the box, so that metres and radians are comparable, or ones for the
papers' absolute values. Sums are made one term after another, in the same order whatever the memory
layout; so many runs advance together bit for bit as each alone, however they were stacked.
"""

from __future__ import annotations

import numpy as np

__all__ = ["centre_of", "heading", "in_sight", "leader_of", "roam", "total", "toward"]


def total(values: np.ndarray, axis: int) -> np.ndarray:
    """Sum along an axis, in order.

    Parameters
    ----------
    values : ndarray, shape (..., k, ...)
        What to add; k at least 1.
    axis : int
        Axis of length k.

    Returns
    -------
    ndarray
        Without that axis. `numpy.sum` groups eight or more terms by their memory layout: in Fortran order
        its last bits differ.
    """
    terms = np.moveaxis(values, axis, 0)
    summed = np.array(terms[0])
    for term in terms[1:]:
        summed += term
    return summed


def heading(X: np.ndarray, target: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Direction and distance from fish to targets.

    Parameters
    ----------
    X, target : ndarray, shape (..., n, d)
        Positions, in the units of the problem.
    scale : ndarray, shape (d,)
        Unit of length of each parameter.

    Returns
    -------
    direction : ndarray, shape (..., n, d)
        Unit vector in scaled coordinates; zero for a fish that is at its target.
    distance : ndarray, shape (..., n)
        Euclidean, in scaled coordinates.
    """
    gap = (target - X) / scale
    distance = np.sqrt(total(gap * gap, -1))
    return gap / np.where(distance > 0, distance, 1.0)[..., None], distance


def toward(X: np.ndarray, target: np.ndarray, scale: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Positions one step of `length` nearer to `target`, or beyond it: the step is not shortened.

    Parameters
    ----------
    X, target : ndarray, shape (..., n, d)
        Positions, in the units of the problem.
    scale : ndarray, shape (d,)
        Unit of length of each parameter.
    length : ndarray, broadcastable to (..., n, d)
        Length of the step in that unit, per parameter if the papers' vectors are used.

    Returns
    -------
    ndarray, shape (..., n, d)
    """
    return X + scale * length * heading(X, target, scale)[0]


def roam(X: np.ndarray, reach: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Positions drawn uniformly in the boxes ``X ± reach``, from `uniform` numbers in [0, 1)."""
    return X + reach * (2.0 * uniform - 1.0)


def in_sight(X: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Who sees whom: ``0 < ‖(X_j - X_i) / reach‖ < 1``.

    Parameters
    ----------
    X : ndarray, shape (..., n, d)
        Positions.
    reach : ndarray, shape (..., d)
        How far a fish sees in each parameter. Equal components give the papers' sphere, a vector the
        ellipsoid with these half-axes.

    Returns
    -------
    ndarray of bool, shape (..., n, n)
        Whether fish i (first) sees fish j (second). Coincident fish do not see each other.
    """
    # a sight that has decayed to nothing divides zero by zero: not a number is not in sight
    squared = np.zeros((*X.shape[:-1], X.shape[-2]))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for k in range(X.shape[-1]):
            gap = (X[..., None, :, k] - X[..., :, None, k]) / reach[..., None, None, k]
            squared += gap * gap
    return (squared > 0) & (squared < 1)


def centre_of(X: np.ndarray, members: np.ndarray) -> np.ndarray:
    """Mean position of the members of each group.

    Parameters
    ----------
    X : ndarray, shape (..., n, d)
        Positions.
    members : ndarray of bool, shape (..., m, n)
        Which fish belong to each of m groups.

    Returns
    -------
    ndarray, shape (..., m, d)
        Zero for a group without members.
    """
    summed = total(np.where(members[..., None], X[..., None, :, :], 0.0), -2)
    return summed / np.maximum(members.sum(axis=-1), 1)[..., None]


def leader_of(X: np.ndarray, F: np.ndarray, members: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Member of lowest loss in each group: its position (..., m, d) and loss (..., m); inf without any."""
    losses = np.where(members, F[..., None, :], np.inf)
    best = np.argmin(losses, axis=-1)
    position = np.take_along_axis(X, best[..., None], axis=-2)
    return position, np.take_along_axis(losses, best[..., None], axis=-1)[..., 0]
