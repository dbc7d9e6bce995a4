"""Plain particle swarm (Kennedy and Eberhart 1995) with the inertia weight of Shi and Eberhart (1998)."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np
from pymoo.core.population import Population

from navopt.algorithms.options import number, one_of
from navopt.algorithms.swarm import Arrays, SwarmAlgorithm
from navopt.errors import InvalidInput

__all__ = ["ParticleSwarm"]

#: What papers 000 (section 4.1.1) and 001 (Table 3) print: 20 particles, positions in [-5, 5] and
#: velocities in [-1, 1], a tenth of the box, and their own weights.
PAPERS: dict[str, dict[str, Any]] = {
    "000": {"pop_size": 20, "w": 0.65, "c1": 1.49, "c2": 1.49, "max_velocity": 0.1},
    "001": {"pop_size": 20, "w": 0.729, "c1": 1.49445, "c2": 1.49445, "max_velocity": 0.1},
}


class ParticleSwarm(SwarmAlgorithm):
    """Particle swarm without adaptation: the algorithm that papers call PSO.

    ``v ← w v + c1 r1 (p - x) + c2 r2 (g - x)``, ``x ← x + v``, where p is the best point of the particle, g
    that of its neighbourhood, and r1, r2 are uniform in [0, 1), drawn for every dimension. The velocity is
    limited, the position is kept inside the box.

    Parameters
    ----------
    pop_size : int, default 20
        Number of particles.
    w : float, default 0.7298
        Inertia weight. The defaults of `w`, `c1` and `c2` are the constriction coefficients of Clerc and
        Kennedy (2002).
    c1, c2 : float, default 1.49618
        Acceleration towards the particle's own best point and towards its neighbourhood's.
    max_velocity : float or None, default 0.5
        Largest speed per cycle and dimension as a fraction of the width of the box; None for no limit.
    boundary : {"clip", "absorb"}
        A particle that would leave the box is put on its border; its velocity stays as it was, or
        (``"absorb"``) vanishes in the dimensions concerned.
    topology : {"global", "ring"}
        Neighbourhood: the whole swarm, or the particle and its neighbours in a ring.
    initial_velocity : {"random", "zero"}
        First velocities: uniform up to `max_velocity` (up to half the box if there is no limit), or zero.
    update : {"synchronous", "sequential"}
        See `SwarmAlgorithm`; sequentially, a particle already follows what those before it have found.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    A cycle costs `pop_size` evaluations. Unlike `pymoo.algorithms.soo.nonconvex.pso.PSO` (registered as
    ``pso``) nothing adapts, the best is not perturbed, a start is uniform instead of a Latin hypercube, and
    positions are clipped instead of drawn again.
    """

    phases: ClassVar[tuple[str, ...]] = ("flight",)

    def __init__(
        self,
        *,
        pop_size: int = 20,
        w: float = 0.7298,
        c1: float = 1.49618,
        c2: float = 1.49618,
        max_velocity: float | None = 0.5,
        boundary: str = "clip",
        topology: str = "global",
        initial_velocity: str = "random",
        update: str = "synchronous",
        **kwargs: Any,
    ) -> None:
        super().__init__(pop_size=pop_size, update=update, **kwargs)
        for name, value in (("w", w), ("c1", c1), ("c2", c2)):
            if number(name, value) < 0:
                raise InvalidInput(name, value, "give a finite weight, at least 0")
        self.w, self.c1, self.c2 = float(w), float(c1), float(c2)
        self.max_velocity = None if max_velocity is None else number("max_velocity", max_velocity, above=0.0)
        self.boundary = one_of("boundary", boundary, ("clip", "absorb"))
        self.topology = one_of("topology", topology, ("global", "ring"))
        self.initial_velocity = one_of("initial_velocity", initial_velocity, ("random", "zero"))

    @classmethod
    def published(cls, paper: str = "000", **kwargs: Any) -> Self:
        """Build with the settings of paper ``"000"`` or ``"001"``; both run 100 cycles.

        Both search [-5, 5] in every dimension with velocities in [-1, 1], which is ``max_velocity=0.1`` in
        any box. How the first velocities are drawn and what happens at the border is not printed: random,
        and clipped [REC].
        """
        return cls(**{**PAPERS[one_of("paper", paper, tuple(PAPERS))], **kwargs})

    # -- drawing -------------------------------------------------------------------------------------
    def draw_initial(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of the first positions and velocities, uniform in [0, 1)."""
        return {"position": rng.random((n, d)), "velocity": rng.random((n, d))}

    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """r1 and r2 of one cycle, each of shape (n, d)."""
        return {"own": rng.random((n, d)), "social": rng.random((n, d))}

    # -- moving --------------------------------------------------------------------------------------
    def place(self, constants: Arrays, draws: Arrays) -> Arrays:
        """`constants` with the first velocities ``V``, shape (..., n, d)."""
        # zero by multiplication: the draws are the same, whatever becomes of them
        length = (0.5 if self.max_velocity is None else self.max_velocity) * (
            self.initial_velocity == "random"
        )
        width = constants["upper"] - constants["lower"]
        return {**constants, "V": (2.0 * draws["velocity"] - 1.0) * (length * width)}

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first population: every particle is at its best point."""
        if "V" not in constants:
            raise InvalidInput("constants", sorted(constants), "give the arrays of place(constants, draws)")
        state = super().found(constants, candidates, losses)
        return {**state, "best_X": candidates, "best_F": losses}

    def _velocity(self, state: Arrays, draws: Arrays) -> np.ndarray:
        X = state["X"]
        own = self.c1 * draws["own"] * (state["best_X"] - X)
        V = self.w * state["V"] + own + self.c2 * draws["social"] * (self._leader(state) - X)
        if self.max_velocity is None:
            return V
        limit = self.max_velocity * (state["upper"] - state["lower"])
        return np.clip(V, -limit, limit)

    def _leader(self, state: Arrays) -> np.ndarray:
        """Best point of each particle's neighbourhood, shape (..., n, d) or broadcasting to it."""
        F = state["best_F"]
        if self.topology == "global":
            k = np.argmin(F, axis=-1)[..., None]
        else:
            # the particle itself first: a neighbour must be better to lead
            n = F.shape[-1]
            ring = (np.arange(n)[:, None] + np.array([0, -1, 1])) % n
            k = np.take_along_axis(
                np.broadcast_to(ring, (*F.shape, 3)), np.argmin(F[..., ring], axis=-1)[..., None], axis=-1
            )[..., 0]
        return np.take_along_axis(state["best_X"], k[..., None], axis=-2)

    def move(self, state: Arrays, draws: Arrays, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """New positions of all particles; all are evaluated."""
        moved = state["X"] + self._velocity(state, draws)
        return np.clip(moved, state["lower"], state["upper"]), np.ones(state["F"].shape, dtype=bool)

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """Take over positions and velocities, and remember what is better."""
        V = self._velocity(state, draws)
        if self.boundary == "absorb":
            moved = state["X"] + V
            V = np.where((moved < state["lower"]) | (moved > state["upper"]), 0.0, V)
        better = mask & (losses < state["best_F"])
        return {
            **state,
            "X": np.where(mask[..., None], candidates, state["X"]),
            "F": np.where(mask, losses, state["F"]),
            "V": np.where(mask[..., None], V, state["V"]),
            "best_X": np.where(better[..., None], candidates, state["best_X"]),
            "best_F": np.where(better, losses, state["best_F"]),
        }

    def _initialize_infill(self) -> Population:
        draws = self.draw_initial(self.random_state, self.pop_size, self.problem.n_var)
        self._start = self.place(self.constants(self.problem), draws)
        return Population.new(X=self.initialize(self._start, draws))
