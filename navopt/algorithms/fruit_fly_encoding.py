"""How a fruit fly's coordinates become a candidate.

The published flies live in a plane and the candidate is the reciprocal of their distance from the
origin. That decides more of the search than any of the moves: the candidate is positive whatever the
sign of the optimum, its step is ``S² × the step of the distance``, so zero is found by walking outward
and anything beyond one needs a distance resolved to a fraction of the step. The encoding is therefore
an option, and the position itself is the default.
"""

from __future__ import annotations

import numpy as np

from navopt.algorithms.swarm import Arrays

__all__ = ["ENCODINGS", "FAR", "NEAR", "decode", "distance"]

ENCODINGS = ("direct", "reciprocal", "box")
#: Largest coordinate kept, so that the square of a distance stays finite when flies walk away for good.
FAR = 1e150
#: Least distance divided by: a fly at the origin would otherwise propose infinity.
NEAR = 1e-300


def distance(flies: np.ndarray) -> np.ndarray:
    """Distance of each variable's point from the origin, (..., n, c, d) -> (..., n, d); at least `NEAR`."""
    # summed one by one, so that a fly's distance does not depend on how many runs are stacked
    squares = flies[..., 0, :] * flies[..., 0, :]
    for k in range(1, flies.shape[-2]):
        squares = squares + flies[..., k, :] * flies[..., k, :]
    return np.maximum(np.sqrt(squares), NEAR)


def decode(
    encoding: str,
    flies: np.ndarray,
    box: Arrays,
    *,
    sign: np.ndarray | None = None,
    delta: np.ndarray | None = None,
) -> np.ndarray:
    """Candidates of the flies, all of them inside the box.

    Parameters
    ----------
    encoding : {"direct", "reciprocal", "box"}
        See `navopt.algorithms.FruitFly`.
    flies : ndarray, shape (..., n, c, d)
        Positions: c coordinates for each of d variables.
    box : dict of ndarray
        ``lower`` and ``upper``, each of shape (d,).
    sign : ndarray, shape (..., n, d), optional
        Uniform in [0, 1); the reciprocal is negated where it is below one half.
    delta : ndarray, shape (..., n, d), optional
        Uniform in [0, 1); ``Dist (0.5 - delta)`` is added to the reciprocal.

    Returns
    -------
    ndarray, shape (..., n, d)
        In the units of the problem.
    """
    lower, upper = box["lower"], box["upper"]
    if encoding == "direct":
        return np.clip(flies[..., 0, :], lower, upper)
    dist = distance(flies)
    smell = 1.0 / dist
    if sign is not None:
        smell = np.where(sign < 0.5, -smell, smell)
    if delta is not None:
        smell = smell + dist * (0.5 - delta)
    if encoding == "box":
        part = smell / (1.0 + np.abs(smell))
        if sign is None and delta is None:
            smell = lower + part * (upper - lower)
        else:
            # a signed S fills (-1, 1): its zero belongs in the middle of the box, not in a corner
            smell = 0.5 * (lower + upper) + part * (0.5 * (upper - lower))
    return np.clip(smell, lower, upper)
