"""Novel artificial fish swarm (Yazdani et al. 2013, Int. J. Artif. Intell. 11:1; paper 004, 2.3)."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np

from navopt.algorithms.fish_moves import heading, roam, total
from navopt.algorithms.fish_school import FishSchool, Lengths
from navopt.algorithms.options import one_of
from navopt.algorithms.swarm import Arrays
from navopt.errors import InvalidInput
from navopt.registry import solver

__all__ = ["PUBLISHED_VISUAL", "NovelFishSwarm"]

#: Paper 004's Table 1, in the paper's units; for ``visual=``, with ``units="problem"`` after conversion.
PUBLISHED_VISUAL = {
    "scale_factors_bit_h_per_deg": (5.0, 2.0, 0.1),
    "biases_deg_per_h": (0.005, 0.002, 0.0001),
    "misalignments_1": (5e-4, 2e-4, 1e-5, 5e-6, 2e-6, 1e-6),
}


@solver(
    "nafsa",
    summary="fish swarm without step and crowding: individual and group behaviour, contracting vision",
    source="Yazdani et al. 2013, Int. J. Artif. Intell. 11:1; Gao et al. 2015, Sensors 15:10547 (eqs. 4-10)",
    comparison_based=True,
)
class NovelFishSwarm(FishSchool):
    """Fish swarm of individual and group behaviour with a contracting field of vision.

    Individual behaviour: a fish tries `try_number` random points within its vision and moves to each that is
    better (eq. 6); if none was, it moves at random within its vision (eq. 7), unless it is the best fish.
    Group behaviour: if the centre of the swarm is better than the best fish, it replaces it (eq. 10); then a
    fish worse than the centre steps towards the centre (eq. 8), any other towards the best fish (eq. 9). The
    step is a fraction, uniform in [0, 1), of the vision along the straight line and may lead beyond. After
    every cycle the vision is multiplied by a contraction factor, uniform in `contraction` (eqs. 4-5).

    Parameters
    ----------
    pop_size : int, default 20
        Number of fish, at least 2.
    visual : float or sequence of float, default 0.25
        First field of vision, for all parameters or for each.
    try_number : int, default 3
        Attempts of the individual behaviour; not printed in paper 004.
    contraction : pair of float, default (0.7, 1.0)
        Least and largest contraction factor, ``0 < CF_min <= CF_max <= 1``. ``(1, 1)`` switches it off.
    contraction_per : {"cycle", "parameter"}
        One factor per cycle, or one for each parameter.
    visual_reading : {"literal", "rotated", "uniform"}
        What a vector `visual` means: the vision of each parameter; in every cycle a random permutation of
        the vector for each fish, so that every parameter is searched on every scale; its maximum for all.
    keep_trying : bool, default True
        Whether all attempts are made, each from the last success; otherwise the first success ends them.
    random_move : bool, default True
        Whether fish that found nothing move at random (eq. 7); otherwise they stay, at no cost.
    group : bool, default True
        Whether there is group behaviour.
    centre_replaces_best : bool, default True
        Whether a better centre takes the place of the best fish (eq. 10).
    units : {"box", "problem"}
        Whether `visual` is a fraction of the box, and distances measured in it, or absolute values in the
        parameters' own units, as the paper's Table 1 (`PUBLISHED_VISUAL`) gives them.
    initial : {"box", "nominal"}
        Whether the first fish are uniform in the box, or within `visual` of the nominal values.
    update : {"synchronous", "sequential"}
        Whether all fish make a random or group move on the same positions, or one after another.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    A batch is one phase of all fish that take part: ``try 1`` …, ``random``, ``centre``, ``group``. A cycle
    costs at most ``pop_size (try_number + 2) - 1`` evaluations: all attempts, a random or no move, one
    centre, and a group move of all but the best fish; a fish that succeeded saves its random move.

    Deviations from the paper, whose inequalities contradict one another: all are read for minimisation, (6)
    and (8) with strict inequality. A fish at its target makes no group move (0/0 in the paper). The
    paper has no bulletin; ``state["best"]`` remembers everything evaluated for reporting and attracts
    nobody. The paper's contraction in (10⁻⁶, 0.999999) has E ln CF = -1: vision shrinks e-fold per cycle, so
    only the first ten or so search. The default, E ln CF = -0.17, gives the 60 cycles of the paper to a
    decrease by e¹⁰.
    """

    together: ClassVar[frozenset[str]] = frozenset({"centre"})

    def __init__(
        self,
        *,
        pop_size: int = 20,
        visual: Lengths = 0.25,
        try_number: int = 3,
        contraction: tuple[float, float] = (0.7, 1.0),
        contraction_per: str = "cycle",
        visual_reading: str = "literal",
        keep_trying: bool = True,
        random_move: bool = True,
        group: bool = True,
        centre_replaces_best: bool = True,
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
        self.contraction = _as_range(contraction)
        self.contraction_per = one_of("contraction_per", contraction_per, ("cycle", "parameter"))
        self.visual_reading = one_of("visual_reading", visual_reading, ("literal", "rotated", "uniform"))
        self.keep_trying, self.random_move = bool(keep_trying), bool(random_move)
        self.group, self.centre_replaces_best = bool(group), bool(centre_replaces_best)
        self.phases = (  # type: ignore[misc]
            *(f"try {t + 1}" for t in range(self.try_number)),
            *(("random",) if self.random_move else ()),
            *(("centre", "group") if self.group else ()),
        )

    @classmethod
    def published(cls, **kwargs: Any) -> Self:
        """Build with paper 004's Table 1: 50 fish, contraction in (10⁻⁶, 0.999999), start at nominal values.

        Its field of vision belongs to gyro parameters: pass one of `PUBLISHED_VISUAL`, converted, with
        ``units="problem"``. The paper runs 60 cycles.
        """
        return cls(**{"pop_size": 50, "contraction": (1e-6, 0.999999), "initial": "nominal", **kwargs})

    def constants(self, problem: Any) -> Arrays:
        """Box, unit of length and visual of each parameter."""
        constants = super().constants(problem)
        if self.visual_reading == "uniform":
            visual = constants["visual"]
            constants["visual"] = np.full_like(visual, visual.max())
        return constants

    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of one cycle, uniform in [0, 1); all attempts and moves are reserved."""
        return {
            "key": np.asarray(rng.random()),
            "contraction": rng.random(d),
            "order": rng.random((n, d)),
            "try": rng.random((self.try_number, n, d)),
            "random": rng.random((n, d)),
            "length": rng.random(n),
        }

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first population: full vision, and nobody has improved."""
        state = super().found(constants, candidates, losses)
        per_run = (*losses.shape[:-1], candidates.shape[-1])
        return {
            **state,
            "visual": np.broadcast_to(constants["visual"], per_run),
            "factor": np.ones(per_run),  # with which the cycle under way will end
            "improved": np.zeros(losses.shape, dtype=bool),
            "centre": np.zeros(per_run),
            "centre_loss": np.full(losses.shape[:-1], np.inf),
        }

    def turn(self, state: Arrays, draws: Arrays) -> Arrays:
        """Begin a cycle: contract the vision by the factor of the last one."""
        low, high = self.contraction
        factor = low + (high - low) * draws["contraction"]
        if self.contraction_per == "cycle":
            factor = np.broadcast_to(factor[..., :1], factor.shape)
        return {
            "visual": state["visual"] * state["factor"],
            "factor": factor,
            "improved": np.zeros_like(state["improved"]),
        }

    def _visual(self, state: Arrays, draws: Arrays) -> np.ndarray:
        """Vision of each fish in units of the scale, broadcastable to (..., n, d)."""
        visual = state["visual"][..., None, :]
        if self.visual_reading != "rotated":
            return visual
        order = np.argsort(draws["order"], axis=-1, kind="stable")
        return np.take_along_axis(np.broadcast_to(visual, order.shape), order, axis=-1)

    @staticmethod
    def _is_best(F: np.ndarray) -> np.ndarray:
        """Which fish is the best, the first of equals: a mask of shape (..., n)."""
        return np.arange(F.shape[-1]) == np.argmin(F, axis=-1)[..., None]

    def move(self, state: Arrays, draws: Arrays, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Candidates of a phase, shape (..., n, d), and the fish that need them evaluated."""
        state = self.current(state, draws)
        X, F, scale = state["X"], state["F"], state["scale"]
        if phase == "centre":
            centre = total(X, -2) / X.shape[-2]
            # one evaluation for all, on the account of the first fish
            mask = np.broadcast_to(np.arange(X.shape[-2]) == 0, F.shape)
            return self.inside(state, np.broadcast_to(centre[..., None, :], X.shape)), mask
        visual = self._visual(state, draws)
        if phase == "group":
            best = np.take_along_axis(X, np.argmin(F, axis=-1)[..., None, None], axis=-2)
            to_centre = (state["centre_loss"][..., None] < F)[..., None]
            target = np.where(to_centre, state["centre"][..., None, :], best)
            direction, distance = heading(X, target, scale)
            length = visual * draws["length"][..., None]
            return self.inside(state, X + scale * length * direction), distance > 0
        if phase == "random":
            return self.inside(state, roam(X, scale * visual, draws["random"])), (
                ~state["improved"] & ~self._is_best(F)
            )
        attempt = draws["try"][..., int(phase.split()[1]) - 1, :, :]
        mask = np.ones_like(state["improved"]) if self.keep_trying else ~state["improved"]
        return self.inside(state, roam(X, scale * visual, attempt)), mask

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """Move what is better in an attempt, whatever comes in a random or group move."""
        state = self.current(state, draws)
        state = {**state, **self.remembered(state, candidates, losses, mask)}
        X, F = state["X"], state["F"]
        if phase == "centre":
            centre, centre_loss = candidates[..., 0, :], losses[..., 0]
            goes = self._is_best(F) & (centre_loss[..., None] < F) & self.centre_replaces_best
            candidates, losses = centre[..., None, :], centre_loss[..., None]
            state = {**state, "centre": centre, "centre_loss": centre_loss}
        elif phase in ("random", "group"):
            goes = mask
        else:
            goes = mask & (losses < F)
            state = {**state, "improved": state["improved"] | goes}
        return {
            **state,
            "X": np.where(goes[..., None], candidates, X),
            "F": np.where(goes, losses, F),
        }


def _as_range(contraction: Any) -> tuple[float, float]:
    """`contraction` as a pair in (0, 1]; otherwise an error."""
    try:
        low, high = (float(value) for value in contraction)
    except (TypeError, ValueError):
        low, high = np.nan, np.nan
    if not 0 < low <= high <= 1:
        raise InvalidInput("contraction", contraction, "give (least, largest) with 0 < least <= largest <= 1")
    return low, high
