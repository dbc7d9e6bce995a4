"""Bee colony guided by its best source (Zhu and Kwong 2010, Appl. Math. Comput. 217:3166)."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.algorithms.bee_colony import BeeColony
from navopt.algorithms.options import number
from navopt.algorithms.swarm import Arrays
from navopt.errors import InvalidInput

__all__ = ["GuidedBeeColony"]


class GuidedBeeColony(BeeColony):
    """Bee colony whose trials are also drawn to the best source (Zhu and Kwong 2010).

    ``v_j = x_ij + φ (x_ij - x_kj) + ψ (best_j - x_ij)`` with ψ uniform in [0, `guidance`). The best source
    is never abandoned.

    Parameters
    ----------
    guidance : float, default 1.5
        Upper end of ψ; 0 for the plain colony.
    **kwargs
        Parameters of `BeeColony`.
    """

    def __init__(self, *, guidance: float = 1.5, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if number("guidance", guidance) < 0:
            raise InvalidInput("guidance", guidance, "give a finite factor, at least 0")
        self.guidance = guidance

    @staticmethod
    def block(n: int, d: int) -> int:
        """Count the random numbers of one cycle."""
        return 2 * n * (2 * d + 2) + n + n * d

    @staticmethod
    def split(numbers: np.ndarray, n: int, d: int) -> Arrays:
        """Draws of one cycle from uniform numbers of shape (..., block)."""
        trial, lead = n * (2 * d + 2), numbers.shape[:-1]
        employed, onlooker, spin, scout = np.split(numbers, [trial, 2 * trial, 2 * trial + n], axis=-1)
        return {
            "employed": employed.reshape(*lead, n, 2 * d + 2),
            "onlooker": onlooker.reshape(*lead, n, 2 * d + 2),
            "spin": spin,
            "scout": scout.reshape(*lead, n, d),
        }

    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of one cycle, uniform in [0, 1)."""
        return self.split(rng.random(self.block(n, d)), n, d)

    def _trial(self, state: Arrays, draws: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        X = state["X"]
        d = X.shape[-1]
        source = np.take_along_axis(X, chosen[..., None], axis=-2)
        partner = np.take_along_axis(X, self._partner(draws, chosen)[..., None], axis=-2)
        best = np.take_along_axis(X, np.argmin(state["F"], axis=-1)[..., None, None], axis=-2)
        step = (2.0 * draws[..., 2 : 2 + d] - 1.0) * (source - partner)
        step = step + self.guidance * draws[..., 2 + d :] * (best - source)
        if self.dimensions == "one":
            step = np.where(np.arange(d) == (draws[..., 1, None] * d).astype(np.int64), step, 0.0)
        return np.clip(source + step, state["lower"], state["upper"])

    def _exhausted(self, state: Arrays) -> np.ndarray:
        F = state["F"]
        return super()._exhausted(state) & (np.arange(F.shape[-1]) != np.argmin(F, axis=-1)[..., None])
