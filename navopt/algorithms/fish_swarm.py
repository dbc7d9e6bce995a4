"""Artificial fish swarm (Li, Shao and Qian 2002, Syst. Eng. Theory Pract. 22(11):32)."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from navopt.algorithms.fish_moves import centre_of, in_sight, leader_of, roam, toward
from navopt.algorithms.fish_school import FishSchool, Lengths, as_lengths, as_vector
from navopt.algorithms.swarm import Arrays
from navopt.errors import InvalidInput
from navopt.registry import solver

__all__ = ["FishSwarm"]


@solver(
    "afsa",
    summary="artificial fish swarm: prey, swarm and follow within a field of vision",
    source="Li, Shao and Qian 2002, Syst. Eng. Theory Pract. 22(11):32",
    comparison_based=True,
)
class FishSwarm(FishSchool):
    """Artificial fish swarm on a box.

    In every cycle a fish tries two behaviours and goes to the better of their results. It *swarms*: one
    step towards the centre of the fish it sees, if that is better than its own place and not crowded. It
    *follows*: one step towards the best fish it sees, on the same conditions. A behaviour whose condition
    fails is replaced by *preying*: up to `try_number` random points in sight, a step towards the first that
    is better, and if there is none, a *free move* of at most one step in each parameter. A step is a
    fraction, uniform in [0, 1), of `step` along the straight line.

    Parameters
    ----------
    pop_size : int, default 20
        Number of fish N, at least 2.
    visual : float or sequence of float, default 0.3
        Field of vision. Fish see each other when nearer than this (Euclidean; a vector gives the
        half-axes of an ellipsoid), and prey in the box of this half-width.
    step : float or sequence of float, default 0.15
        Longest step.
    try_number : int, default 3
        Attempts of one preying behaviour.
    crowding : float, default 0.618
        Crowd factor δ in (0, 1]: a place with ``n_f`` fish in sight is crowded unless ``n_f / N < δ``. 1
        switches the condition off.
    swarm, follow : bool, default True
        The two social behaviours. Without one, its turn at preying goes too; without both, fish only prey.
    free_move : bool, default True
        Whether a fish that found nothing moves at random; otherwise it stays, at no cost.
    keep_worse : bool, default True
        Whether a fish goes to the better result even if that is worse than where it is. Otherwise it stays.
    units : {"box", "problem"}
        Whether `visual` and `step` are fractions of the box, and distances measured in it, or absolute
        values in the parameters' own units, as papers give them.
    initial : {"box", "nominal"}
        Whether the first fish are uniform in the box, or within `visual` of the nominal values.
    update : {"synchronous", "sequential"}
        Whether all fish see the positions at the start of the cycle, or move one after another.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    A batch is one phase of all fish that take part: ``centre``, ``swarm try 1`` …, ``swarm move``, ``follow
    try 1`` …, ``follow move``. A fish costs 3 to ``2 try_number + 3`` evaluations per cycle, attempts and
    the centre included (the best fish in sight is known). Deviations from Li et al., who maximise the food
    Y: the loss is minimised; a place is crowded by the share of the swarm there, because the printed
    condition ``Y_c / n_f > δ Y_i`` changes its meaning with the sign of Y; candidates are clipped to the
    box; the centre of a crowded place is not evaluated. The bulletin (``state["best"]``) remembers
    everything evaluated and attracts nobody.
    """

    def __init__(
        self,
        *,
        pop_size: int = 20,
        visual: Lengths = 0.3,
        step: Lengths = 0.15,
        try_number: int = 3,
        crowding: float = 0.618,
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
            try_number=try_number,
            units=units,
            initial=initial,
            update=update,
            **kwargs,
        )
        # `step` is the base's place in the cycle
        self.step = as_lengths("step", step)
        if not 0 < crowding <= 1:
            raise InvalidInput("crowding", crowding, "give a share of the swarm in (0, 1]; 1 switches it off")
        self.crowding = float(crowding)
        self.swarm, self.follow = bool(swarm), bool(follow)
        self.free_move, self.keep_worse = bool(free_move), bool(keep_worse)
        branches = [name for name in ("swarm", "follow") if getattr(self, name)] or ["prey"]
        # (branch, action, attempt) of every phase
        self.plan: dict[str, tuple[str, str, int]] = {"centre": ("swarm", "centre", 0)} if self.swarm else {}
        for branch in branches:
            for t in range(self.try_number):
                self.plan[f"{branch} try {t + 1}"] = (branch, "try", t)
            self.plan[f"{branch} move"] = (branch, "move", 0)
        self.phases = tuple(self.plan)  # type: ignore[misc]
        self._order: list[tuple[str, int | None]] | None = None  # asked for at every step, and long
        self._sight: tuple[tuple[np.ndarray, ...], tuple[np.ndarray, np.ndarray]] | None = None

    @classmethod
    def published(cls, **kwargs: Any) -> Self:
        """Build with 50 fish as paper 004, and 10 attempts and a crowd factor of 0.618 as is usual.

        Neither Li et al.'s text nor paper 004 gives a field of vision that would mean anything on another
        problem: pass `visual` and `step`, with ``units="problem"`` for absolute values.
        """
        return cls(**{"pop_size": 50, "try_number": 10, "crowding": 0.618, **kwargs})

    @property
    def batches(self) -> list[tuple[str, int | None]]:
        """One after another means here: all behaviours of a fish, then those of the next."""
        if self._order is None:
            together = [phase for phase in self.phases if phase in self.together]
            alone = [phase for phase in self.phases if phase not in self.together]
            fish = range(self.pop_size) if self.update == "sequential" else [None]
            self._order = [*((phase, None) for phase in together), *((p, k) for k in fish for p in alone)]
        return self._order

    def constants(self, problem: Any) -> Arrays:
        """Box, unit of length, visual and step of each parameter."""
        constants = super().constants(problem)
        return {**constants, "step": as_vector("step", self.step, len(constants["scale"]))}

    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of one cycle, uniform in [0, 1): two preying behaviours and steps are reserved."""
        draws = {"key": np.asarray(rng.random())}
        for branch in ("swarm", "follow"):
            draws[f"{branch} try"] = rng.random((self.try_number, n, d))
            draws[f"{branch} length"] = rng.random(n)
            draws[f"{branch} free"] = rng.random((n, d))
        return draws

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first population: nobody is under way."""
        state = super().found(constants, candidates, losses)
        nobody = np.zeros(losses.shape, dtype=bool)
        return {
            **state,
            "target": candidates,  # where a fish has decided to go in the behaviour under way
            "decided": nobody,
            "place": candidates,  # where its first behaviour led, and the loss there
            "place_loss": np.full(losses.shape, np.inf),
            "placed": nobody,
        }

    def turn(self, state: Arrays, draws: Arrays) -> Arrays:
        """Begin a cycle: fish that had nothing to evaluate in the last phase go where the first one led."""
        goes = state["placed"] & self._accepts(state, state["place_loss"])
        return {
            "X": np.where(goes[..., None], state["place"], state["X"]),
            "F": np.where(goes, state["place_loss"], state["F"]),
            "placed": np.zeros_like(state["placed"]),
            "decided": np.zeros_like(state["decided"]),
        }

    def _accepts(self, state: Arrays, losses: np.ndarray) -> np.ndarray:
        """Whether a fish goes to a place of these losses, shape (..., n)."""
        return np.ones(losses.shape, dtype=bool) if self.keep_worse else losses < state["F"]

    def _company(self, state: Arrays) -> tuple[np.ndarray, np.ndarray]:
        """Fish in sight of each, shape (..., n, n), and whether it has company that is not a crowd."""
        # most phases of a cycle ask again before any fish has moved; arrays of a state are never written to
        asked = (state["X"], state["visual"], state["scale"])
        if self._sight is None or any(a is not b for a, b in zip(self._sight[0], asked, strict=True)):
            seen = in_sight(state["X"], state["scale"] * state["visual"])
            count = seen.sum(axis=-1)
            self._sight = asked, (seen, (count > 0) & (count / state["F"].shape[-1] < self.crowding))
        return self._sight[1]

    def _target(self, state: Arrays, branch: str) -> tuple[np.ndarray, np.ndarray]:
        """Where each fish has decided to go in a behaviour, and whether it has."""
        if branch != "follow":
            return state["target"], state["decided"]
        seen, pleasant = self._company(state)
        leader, loss = leader_of(state["X"], state["F"], seen)
        follows = pleasant & (loss < state["F"])
        return np.where(follows[..., None], leader, state["target"]), follows | state["decided"]

    def move(self, state: Arrays, draws: Arrays, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Candidates of a phase, shape (..., n, d), and the fish that need them evaluated."""
        state = self.current(state, draws)
        branch, action, t = self.plan[phase]
        X, scale = state["X"], state["scale"]
        if action == "centre":
            seen, pleasant = self._company(state)
            return self.inside(state, centre_of(X, seen)), pleasant
        target, decided = self._target(state, branch)
        drawn = "swarm" if branch == "prey" else branch
        if action == "try":
            visual = (scale * state["visual"])[..., None, :]
            return self.inside(state, roam(X, visual, draws[f"{drawn} try"][..., t, :, :])), ~decided
        step = state["step"][..., None, :]
        directed = toward(X, target, scale, step * draws[f"{drawn} length"][..., None])
        free = roam(X, scale * step, draws[f"{drawn} free"])
        candidates = self.inside(state, np.where(decided[..., None], directed, free))
        return candidates, np.ones_like(decided) if self.free_move else decided

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """Decide where to go after an attempt; go to the better place after the last behaviour."""
        state = self.current(state, draws)
        state = {**state, **self.remembered(state, candidates, losses, mask)}
        if self.plan[phase][1] != "move":
            decides = mask & (losses < state["F"])
            return {
                **state,
                "target": np.where(decides[..., None], candidates, state["target"]),
                "decided": state["decided"] | decides,
            }
        rest = state["decided"] & ~mask
        if phase != self.phases[-1]:
            return {
                **state,
                "place": np.where(mask[..., None], candidates, state["place"]),
                "place_loss": np.where(mask, losses, state["place_loss"]),
                "placed": state["placed"] | mask,
                "decided": rest,
            }
        # of two equally good places the first stands
        earlier = state["placed"] & ~(losses < state["place_loss"])
        place = np.where(earlier[..., None], state["place"], candidates)
        loss = np.where(earlier, state["place_loss"], losses)
        goes = mask & self._accepts(state, loss)
        return {
            **state,
            "X": np.where(goes[..., None], place, state["X"]),
            "F": np.where(goes, loss, state["F"]),
            "placed": state["placed"] & ~mask,
            "decided": rest,
        }
