"""What the three fish swarms share: their lengths, their memory and how one cycle follows another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from navopt.algorithms.fish_moves import roam
from navopt.algorithms.options import at_least, one_of
from navopt.algorithms.swarm import Arrays, SwarmAlgorithm
from navopt.errors import InvalidInput, UnsuitableProblem

__all__ = ["FishSchool", "Lengths", "as_lengths", "as_vector"]

#: One length for all parameters, or one for each.
Lengths = float | Sequence[float]


def as_lengths(argument: str, value: Any) -> float | tuple[float, ...]:
    """`value` as a positive number or a tuple of them; otherwise an error that names the argument."""
    try:
        lengths = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        lengths = np.array(np.nan)
    if lengths.ndim > 1 or lengths.size == 0 or not (np.isfinite(lengths).all() and (lengths > 0).all()):
        raise InvalidInput(argument, value, "give a positive number, or one for each parameter")
    return float(lengths) if lengths.ndim == 0 else tuple(lengths.tolist())


def as_vector(argument: str, value: float | tuple[float, ...], d: int) -> np.ndarray:
    """Length of each of d parameters, shape (d,); an error if as many have not been given."""
    if isinstance(value, tuple) and len(value) != d:
        raise InvalidInput(argument, value, f"give one number, or {d}: one for each parameter")
    return np.array(np.broadcast_to(value, d), dtype=float)


class FishSchool(SwarmAlgorithm):
    """Base of the fish swarms.

    A new cycle is known by its random `key`: `current` closes the last cycle (`turn`) as soon as the
    draws of another one are seen. So the state needs no event at the end of a cycle, whose last
    phases may have nobody to evaluate, and `move` and `select` stay pure.

    Parameters
    ----------
    pop_size : int
        Number of fish.
    visual : float or sequence of float
        How far a fish sees and searches, for all parameters or for each.
    try_number : int
        Attempts of one preying (individual) behaviour.
    units : {"box", "problem"}
        Whether lengths are fractions of the box, and distances measured in it, or absolute.
    initial : {"box", "nominal"}
        Whether the first fish are uniform in the box, or within `visual` of the nominal values.
    update : {"synchronous", "sequential"}
        See `SwarmAlgorithm`.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Attributes
    ----------
    state : dict of ndarray
        Beside those of `SwarmAlgorithm`: ``best`` (d,) and ``best_loss`` of everything evaluated, the
        bulletin; ``age``, completed cycles; ``key`` of the cycle under way; ``scale`` (d,).
    """

    def __init__(
        self,
        *,
        pop_size: int,
        visual: Lengths,
        try_number: int,
        units: str,
        initial: str,
        update: str,
        **kwargs: Any,
    ) -> None:
        super().__init__(pop_size=pop_size, update=update, **kwargs)
        self.visual = as_lengths("visual", visual)
        self.try_number = at_least("try_number", try_number, 1)
        self.units = one_of("units", units, ("box", "problem"))
        self.initial = one_of("initial", initial, ("box", "nominal"))

    def constants(self, problem: Any) -> Arrays:
        """Box, unit of length and visual of each parameter, nominal values if fish start there."""
        box = super().constants(problem)
        width = box["upper"] - box["lower"]
        scale = width if self.units == "box" else np.ones_like(width)
        constants = {**box, "scale": scale, "visual": as_vector("visual", self.visual, len(width))}
        if self.initial == "nominal":
            if getattr(problem, "nominal", None) is None:
                raise UnsuitableProblem(
                    f'initial="nominal" needs nominal values, which {type(problem).__name__} has not; '
                    'use initial="box"'
                )
            constants["nominal"] = np.array(problem.nominal, dtype=float)
        return constants

    def initialize(self, constants: Arrays, draws: Arrays) -> np.ndarray:
        """First positions, shape (..., n, d)."""
        if self.initial == "box":
            return super().initialize(constants, draws)
        start = roam(constants["nominal"], constants["scale"] * constants["visual"], draws["position"])
        return np.clip(start, constants["lower"], constants["upper"])

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first population: no cycle has begun, the best fish is remembered."""
        state = super().found(constants, candidates, losses)
        lead = losses.shape[:-1]
        best = np.argmin(losses, axis=-1)[..., None]
        return {
            **state,
            "key": np.full(lead, np.nan),
            "age": np.full(lead, -1),
            "best": np.take_along_axis(candidates, best[..., None], axis=-2)[..., 0, :],
            "best_loss": np.take_along_axis(losses, best, axis=-1)[..., 0],
        }

    def turn(self, state: Arrays, draws: Arrays) -> Arrays:
        """What changes from one cycle to the next, its draws known; only the changed entries."""
        return {}

    def current(self, state: Arrays, draws: Arrays) -> Arrays:
        """State within the cycle of these draws; a state of that cycle is returned as it is."""
        new = np.asarray(state["key"] != draws["key"])
        if not new.any():
            return state
        changed = {"key": draws["key"], "age": state["age"] + 1, **self.turn(state, draws)}
        merged = {}
        for name, value in changed.items():
            mask = new.reshape(new.shape + (1,) * (np.ndim(value) - new.ndim))
            merged[name] = np.where(mask, value, state[name])
        return {**state, **merged}

    @staticmethod
    def remembered(state: Arrays, candidates: np.ndarray, losses: np.ndarray, mask: np.ndarray) -> Arrays:
        """Bulletin after the masked candidates have been evaluated."""
        offered = np.where(mask, losses, np.inf)
        k = np.argmin(offered, axis=-1)[..., None]
        loss = np.take_along_axis(offered, k, axis=-1)[..., 0]
        better = loss < state["best_loss"]
        position = np.take_along_axis(candidates, k[..., None], axis=-2)[..., 0, :]
        return {
            "best": np.where(better[..., None], position, state["best"]),
            "best_loss": np.where(better, loss, state["best_loss"]),
        }

    @staticmethod
    def inside(state: Arrays, candidates: np.ndarray) -> np.ndarray:
        """Candidates, clipped to the box."""
        return np.clip(candidates, state["lower"], state["upper"])
