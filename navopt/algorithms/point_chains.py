"""Chains of single matched points: distinct candidates, the cheapest chain through them, its shape.

Pure functions of plain arrays; leading axes (many runs at once) broadcast, bit for bit as alone.
"""

from __future__ import annotations

import numpy as np

__all__ = ["cheapest_chains", "distinct_candidates", "modified_hausdorff_distance"]


def modified_hausdorff_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Modified Hausdorff distance of two sets of points (Dubuisson and Jain 1994).

    The larger of the two mean distances from a point of one set to the nearest point of the other. It
    does not know which points belong together.

    Parameters
    ----------
    a, b : ndarray, shape (..., n, 2) and (..., m, 2)
        Points in a plane, in any unit of length.

    Returns
    -------
    ndarray, shape (...)
        Distance in that unit.
    """
    difference = a[..., :, None, :] - b[..., None, :, :]
    distance = np.hypot(difference[..., 0], difference[..., 1])
    return np.maximum(distance.min(axis=-1).mean(axis=-1), distance.min(axis=-2).mean(axis=-1))


def distinct_candidates(
    points: np.ndarray, losses: np.ndarray, count: int, separation: float
) -> tuple[np.ndarray, np.ndarray]:
    """Best points of which no two are closer than a separation, taken greedily by their losses.

    Parameters
    ----------
    points : ndarray, shape (..., n, 2)
        Points in a plane.
    losses : ndarray, shape (..., n)
        Lower is better; a point of infinite loss is never a candidate.
    count : int
        Largest number of candidates, at most n.
    separation : float
        Least distance between two of them.

    Returns
    -------
    chosen : ndarray of int, shape (..., count)
        Indices, best first; meaningless where `valid` is False.
    valid : ndarray of bool, shape (..., count)
        False from where no distinct point was left.
    """
    left = np.isfinite(losses)
    chosen = np.zeros((*losses.shape[:-1], count), dtype=np.int64)
    valid = np.zeros(chosen.shape, dtype=bool)
    for c in range(count):
        k = np.argmin(np.where(left, losses, np.inf), axis=-1)
        valid[..., c] = left.any(axis=-1)
        chosen[..., c] = k
        difference = points - np.take_along_axis(points, k[..., None, None], axis=-2)
        near = np.hypot(difference[..., 0], difference[..., 1]) < separation
        left &= ~near & (np.arange(losses.shape[-1]) != k[..., None])
    return chosen, valid


def cheapest_chains(
    points: np.ndarray, costs: np.ndarray, steps: np.ndarray, *, mu: float, heading_weight: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Cheapest chain of candidates that ends in each candidate of the last sample (Viterbi).

    A chain costs the sum of its candidates' costs and, for each pair of successive points,
    ``mu (|‖Δx‖ - ℓ| + heading_weight ℓ |Δψ|)``: how much the distance between them differs from the
    distance ℓ run in the meantime, and their direction from the course steered.

    Parameters
    ----------
    points : ndarray, shape (..., n, k, 2)
        k candidates (north, east) for each of n samples, m.
    costs : ndarray, shape (..., n, k)
        Their costs; ``inf`` for a place that holds no candidate, at least one finite in every sample.
    steps : ndarray, shape (..., n - 1, 2)
        Displacements (north, east) between samples according to speed and heading, m.
    mu : float
        Cost per metre of disagreement.
    heading_weight : float
        Weight of a lateral against a longitudinal disagreement; 0 links by speed alone.

    Returns
    -------
    chains : ndarray of int, shape (..., k, n)
        Chosen candidate of each sample, cheapest chain first.
    totals : ndarray, shape (..., k)
        Costs of the chains, ascending; ``inf`` for an end that holds no candidate.
    """
    n = costs.shape[-2]
    total = costs[..., 0, :]
    origins = []
    for j in range(1, n):
        # (..., from, to)
        delta = points[..., j, None, :, :] - points[..., j - 1, :, None, :]
        step = steps[..., j - 1, None, None, :]
        length = np.hypot(step[..., 0], step[..., 1])
        along = step[..., 0] * delta[..., 0] + step[..., 1] * delta[..., 1]
        across = step[..., 0] * delta[..., 1] - step[..., 1] * delta[..., 0]
        speed = np.abs(np.hypot(delta[..., 0], delta[..., 1]) - length)
        link = mu * (speed + heading_weight * length * np.abs(np.arctan2(across, along)))
        reached = total[..., :, None] + link
        origins.append(np.argmin(reached, axis=-2))
        total = np.min(reached, axis=-2) + costs[..., j, :]
    order = np.argsort(total, axis=-1, kind="stable")
    place, chain = order, [order]
    for origin in reversed(origins):
        place = np.take_along_axis(origin, place, axis=-1)
        chain.append(place)
    return np.stack(chain[::-1], axis=-1), np.take_along_axis(total, order, axis=-1)
