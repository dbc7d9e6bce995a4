"""Optimal artificial fish swarm: decaying vision and step, secondary initialisation (paper 004, 2.2)."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np

from navopt.algorithms.fish_moves import roam
from navopt.algorithms.fish_school import Lengths
from navopt.algorithms.fish_swarm import FishSwarm
from navopt.algorithms.options import at_least
from navopt.algorithms.swarm import Arrays
from navopt.errors import InvalidInput
from navopt.registry import solver

__all__ = ["OptimalFishSwarm"]

#: Rate of the attenuation function, eq. (3).
DECAY = 3.0


@solver(
    "oafsa",
    summary="fish swarm whose vision and step decay, restarted around its best when it diverges",
    source="Gao, Guan and Wang 2014, Measurement 50:297; Gao et al. 2015, Sensors 15:10547 (eqs. 1-3)",
    comparison_based=True,
)
class OptimalFishSwarm(FishSwarm):
    """Fish swarm with decaying vision and step and with secondary initialisation.

    In cycle G (from 0) the field of vision is ``visual (λ + floor)`` and the longest step ``step (λ +
    floor)``, with ``λ = exp(-3 G / horizon)`` (eqs. 1-3). When the lowest loss of the current swarm has
    risen in `rises` successive cycles, or has not fallen below its minimum for `patience` cycles, the fish
    are spread again around the best point ever evaluated, and `visual` and `step` are multiplied by
    `shrink`: the secondary initialisation, which the paper's authors did by hand.

    Parameters
    ----------
    pop_size : int, default 20
        Number of fish, at least 2.
    visual, step : float or sequence of float, default 0.5 and 0.25
        First field of vision and longest step; see `FishSwarm`.
    try_number : int, default 3
        Attempts of one preying behaviour.
    crowding : float, default 0.618
        Crowd factor in (0, 1].
    horizon : int, default 60
        Cycles G_max over which vision and step decay; they hold afterwards. It does not end the run.
    floor : float, default 0.001
        Visual_min and Step_min as fractions of `visual` and `step`.
    recursive : bool, default False
        Read eqs. (1)-(2) literally, ``Visual ← Visual λ(G) + Visual_min`` from cycle to cycle. The product
        of the λ is exp(-1.5 G (G + 1) / horizon): with the paper's 60 below a thousandth from cycle 17 on.
    secondary : bool, default True
        Whether there is a secondary initialisation.
    rises : int, default 3
        Successive rises of the swarm's lowest loss that bring it about.
    patience : int, default 10
        Cycles without a new minimum of the swarm's lowest loss that bring it about.
    shrink : float, default 0.1
        Its factor, in (0, 1]; fish are drawn within ``shrink * visual`` of the best point.
    restart_schedule : bool, default True
        Whether it begins the decay again ("the process is executed again"), or lets it go on.
    swarm, follow, free_move, keep_worse, units, initial, update
        See `FishSwarm`.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    A cycle costs as much as one of `FishSwarm`, and `pop_size` more when it begins with a secondary
    initialisation (phase ``restart``). None happens before a candidate could be evaluated. To spend a
    budget on one whole decay, set `horizon` to the budget over the cost of a cycle. Beside `FishSwarm`'s
    deviations: eqs. (1)-(2) are read as acting on the first values, unless `recursive`; when to begin again
    is decided by the rule above, of which the paper says only that the indicator "presents divergence
    tendency", and all its constants are options.
    """

    together: ClassVar[frozenset[str]] = frozenset({"restart"})

    def __init__(
        self,
        *,
        pop_size: int = 20,
        visual: Lengths = 0.5,
        step: Lengths = 0.25,
        try_number: int = 3,
        crowding: float = 0.618,
        horizon: int = 60,
        floor: float = 1e-3,
        recursive: bool = False,
        secondary: bool = True,
        rises: int = 3,
        patience: int = 10,
        shrink: float = 0.1,
        restart_schedule: bool = True,
        swarm: bool = True,
        follow: bool = True,
        free_move: bool = True,
        keep_worse: bool = True,
        units: str = "box",
        initial: str = "box",
        update: str = "synchronous",
        **kwargs: Any,
    ) -> None:
        super().__init__(
            pop_size=pop_size,
            visual=visual,
            step=step,
            try_number=try_number,
            crowding=crowding,
            swarm=swarm,
            follow=follow,
            free_move=free_move,
            keep_worse=keep_worse,
            units=units,
            initial=initial,
            update=update,
            **kwargs,
        )
        self.horizon = at_least("horizon", horizon, 1)
        if not 0 <= floor <= 1:
            raise InvalidInput("floor", floor, "give a fraction of the first values, from 0 to 1")
        if not 0 < shrink <= 1:
            raise InvalidInput("shrink", shrink, "give a factor in (0, 1]")
        self.floor, self.shrink = float(floor), float(shrink)
        self.recursive, self.secondary = bool(recursive), bool(secondary)
        self.rises = at_least("rises", rises, 1)
        self.patience = at_least("patience", patience, 1)
        self.restart_schedule = bool(restart_schedule)
        self.plan = {"restart": ("", "restart", 0), **self.plan}
        self.phases = tuple(self.plan)  # type: ignore[misc]
        # a table, because the last bit of exp may differ between a number and an array of them
        self._decay = np.exp(-DECAY * np.arange(self.horizon + 1) / self.horizon)

    @classmethod
    def published(cls, **kwargs: Any) -> Self:
        """Build with what paper 004 prints: 50 fish, 60 iterations, eqs. (1)-(2) to the letter.

        Its first field of vision is not printed; pass `visual` and `step`. The fish start around the nominal
        values, as a recalibration does.
        """
        return cls(
            **{
                "pop_size": 50,
                "try_number": 10,
                "horizon": 60,
                "recursive": True,
                "initial": "nominal",
                **kwargs,
            }
        )

    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of one cycle; the secondary initialisation's are always reserved."""
        draws = super().draw(rng, n, d)
        return {**draws, "restart": rng.random((n, d))}

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first population: the schedule has not begun."""
        state = super().found(constants, candidates, losses)
        lead = losses.shape[:-1]
        return {
            **state,
            "first_visual": constants["visual"],
            "first_step": constants["step"],
            "clock": np.full(lead, -1),  # G
            "level": np.ones(lead),  # power of `shrink`
            "relative": np.ones(lead),  # vision over level * first vision
            "indicator": losses.min(axis=-1),
            "lowest": losses.min(axis=-1),
            "rising": np.zeros(lead, dtype=np.int64),
            "stale": np.zeros(lead, dtype=np.int64),
            "restart": np.zeros(lead, dtype=bool),
        }

    def turn(self, state: Arrays, draws: Arrays) -> Arrays:
        """Begin a cycle: look at the indicator, decide on a restart, set vision and step."""
        changed = super().turn(state, draws)
        indicator, completed = changed["F"].min(axis=-1), state["age"] >= 0
        rising = np.where(completed & (indicator > state["indicator"]), state["rising"] + 1, 0)
        stale = np.where(completed & ~(indicator < state["lowest"]), state["stale"] + 1, 0)
        # around what, if nothing could be evaluated yet?
        known = np.isfinite(state["best_loss"])
        restart = self.secondary & known & ((rising >= self.rises) | (stale >= self.patience))
        level = np.where(restart, state["level"] * self.shrink, state["level"])
        clock = np.where(restart & self.restart_schedule, 0, state["clock"] + 1)
        relative = self._relative(state["relative"], clock)
        length = (level * relative)[..., None]
        return {
            **changed,
            "clock": clock,
            "level": level,
            "relative": relative,
            "visual": state["first_visual"] * length,
            "step": state["first_step"] * length,
            # a restarted swarm has no past
            "indicator": np.where(restart, np.inf, indicator),
            "lowest": np.where(restart, np.inf, np.minimum(indicator, state["lowest"])),
            "rising": np.where(restart, 0, rising),
            "stale": np.where(restart, 0, stale),
            "restart": restart,
        }

    def _relative(self, last: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """Vision in units of its first value at this level, shape (...)."""
        decay = self._decay[np.minimum(clock, self.horizon)]
        if not self.recursive:
            return decay + self.floor
        return np.where(clock == 0, 1.0, np.where(clock > self.horizon, last, last * decay + self.floor))

    def move(self, state: Arrays, draws: Arrays, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Candidates of a phase, shape (..., n, d), and the fish that need them evaluated."""
        if phase != "restart":
            return super().move(state, draws, phase)
        state = self.current(state, draws)
        reach = state["scale"] * state["first_visual"] * state["level"][..., None]
        candidates = roam(state["best"][..., None, :], reach[..., None, :], draws["restart"])
        mask = np.broadcast_to(state["restart"][..., None], state["F"].shape)
        return self.inside(state, candidates), mask

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """Put the restarted fish in place; otherwise as `FishSwarm`."""
        if phase != "restart":
            return super().select(state, draws, phase, candidates, losses, mask)
        state = self.current(state, draws)
        return {
            **state,
            **self.remembered(state, candidates, losses, mask),
            "X": np.where(mask[..., None], candidates, state["X"]),
            "F": np.where(mask, losses, state["F"]),
        }
