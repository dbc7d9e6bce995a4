"""Real-coded genetic algorithm with the operators of MATLAB's ``ga`` that paper 001 compares with."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np
from pymoo.core.population import Population

from navopt.algorithms.options import at_least, number, one_of
from navopt.algorithms.swarm import Arrays, SwarmAlgorithm
from navopt.errors import InvalidInput
from navopt.registry import solver

__all__ = ["GeneticAlgorithm", "rank_expectation", "stochastic_uniform"]

#: Table 3 of paper 001 and the toolbox's defaults of release 2016b (elite of 5 %, rank scaling).
PAPERS: dict[str, dict[str, Any]] = {
    "001": {
        "pop_size": 20,
        "elite_count": 1,
        "crossover_fraction": 0.8,
        "crossover": "arithmetic",
        "mutation_scale": 1.0,
        "shrink": 1.0,
        "horizon": 100,
        "initial": "partial",
        "initial_point": 2.0,
    }
}


@solver(
    "ga",
    summary="genetic algorithm: rank scaling, stochastic uniform selection, elite, shrinking mutation",
    source="Goldberg 1989; Baker 1987 (selection); operators of MATLAB's ga, release 2016b",
    comparison_based=True,
)
class GeneticAlgorithm(SwarmAlgorithm):
    """Generational genetic algorithm on a box.

    The next generation is the elite, unchanged, then children of crossover, then mutants. Parents are
    selected with expectations proportional to ``1/√rank``.

    Parameters
    ----------
    pop_size : int, default 40
        Number of individuals, at least 2.
    elite_count : int, optional
        Best individuals that survive unchanged (and are not evaluated again); ``ceil(0.05 pop_size)`` if
        not given.
    crossover_fraction : float, default 0.8
        Share of crossover children among those that are not elite, rounded to a whole number.
    selection : {"stochastic-uniform", "roulette"}
        One spin of a wheel with equidistant pointers (Baker 1987), or a spin per parent.
    crossover : {"arithmetic", "scattered"}
        ``a p1 + (1 - a) p2`` with one a uniform in [0, 1) per child, or each variable from either parent.
    mutation_scale : float, default 0.25
        Standard deviation of the mutation before it shrinks, as a fraction of the width of the box.
    shrink : float, default 0.99
        Share of it that is gone after `horizon` cycles: ``σ = mutation_scale (1 - shrink g/horizon)``.
    horizon : int, default 100
        Cycles over which it shrinks; it holds afterwards. It does not end the run.
    initial : {"uniform", "partial", "degenerate", "range"}
        First population: uniform in the box; the same with `initial_point` as first individual; all
        individuals there; or uniform between ``-|initial_point|`` and ``|initial_point|``.
    initial_point : float or sequence of float, optional
        What the last three need, moved into the box.
    stall_limit : int, optional
        End the run (``converged``) after as many cycles without a better individual; never if not given.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    A cycle costs ``pop_size - elite_count`` evaluations. The mutation adds a normal number to *every*
    variable; it replaces MATLAB's adaptive feasible mutation, whose random directions and step sizes
    are not published in reproducible form. Candidates are clipped to the box. MATLAB's rule compares the
    average relative change over the stall generations with a tolerance; here a better individual, by
    however little, ends a stall.
    """

    phases: ClassVar[tuple[str, ...]] = ("generation",)

    def __init__(
        self,
        *,
        pop_size: int = 40,
        elite_count: int | None = None,
        crossover_fraction: float = 0.8,
        selection: str = "stochastic-uniform",
        crossover: str = "arithmetic",
        mutation_scale: float = 0.25,
        shrink: float = 0.99,
        horizon: int = 100,
        initial: str = "uniform",
        initial_point: Any = None,
        stall_limit: int | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(pop_size=pop_size, **kwargs)
        self.elite_count = None if elite_count is None else at_least("elite_count", elite_count, 0)
        if self._elite(self.pop_size) >= self.pop_size:
            raise InvalidInput("elite_count", elite_count, f"give fewer than the {pop_size} individuals")
        for name, value in (("crossover_fraction", crossover_fraction), ("shrink", shrink)):
            if not 0 <= number(name, value) <= 1:
                raise InvalidInput(name, value, "give a fraction from 0 to 1")
        if number("mutation_scale", mutation_scale) < 0:
            raise InvalidInput("mutation_scale", mutation_scale, "give a fraction of the box, at least 0")
        self.crossover_fraction, self.mutation_scale, self.shrink = crossover_fraction, mutation_scale, shrink
        self.selection = one_of("selection", selection, ("stochastic-uniform", "roulette"))
        self.crossover = one_of("crossover", crossover, ("arithmetic", "scattered"))
        self.horizon = at_least("horizon", horizon, 1)
        self.initial = one_of("initial", initial, ("uniform", "partial", "degenerate", "range"))
        if (initial_point is None) != (initial == "uniform"):
            raise InvalidInput("initial_point", initial_point, 'give it exactly if initial is not "uniform"')
        for coordinate in () if initial_point is None else np.ravel(initial_point):
            number("initial_point", coordinate)
        self.initial_point = initial_point
        self.stall_limit = None if stall_limit is None else at_least("stall_limit", stall_limit, 1)

    @classmethod
    def published(cls, paper: str = "001", **kwargs: Any) -> Self:
        """Build with the settings of paper ``"001"`` (Table 3), 100 generations of MATLAB's ``ga``.

        Its "Initial Population [2, 2]" is read as one given individual, the rest made by the toolbox
        (``initial="partial"``); the other readings are ``"degenerate"`` and ``"range"``. Its migration
        fraction is idle with a single population. MATLAB's rule of 50 stall generations is left off, so
        that the budget is used; ``stall_limit=50`` switches it on.
        """
        return cls(**{**PAPERS[one_of("paper", paper, tuple(PAPERS))], **kwargs})

    def _elite(self, n: int) -> int:
        return int(np.ceil(0.05 * n)) if self.elite_count is None else self.elite_count

    def _shares(self, n: int) -> tuple[int, int, int]:
        """Numbers of elite, crossover children and mutants."""
        elite = self._elite(n)
        crossed = round(self.crossover_fraction * (n - elite))
        return elite, crossed, n - elite - crossed

    # -- drawing -------------------------------------------------------------------------------------
    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of one generation; a block of the same size for every choice of operators."""
        _, crossed, mutants = self._shares(n)
        parents = 2 * crossed + mutants
        return {
            "spin": rng.random(parents),
            "order": rng.random(parents),
            "blend": rng.random((crossed, d)),
            "mutation": rng.standard_normal((mutants, d)),
        }

    # -- moving --------------------------------------------------------------------------------------
    def constants(self, problem: Any) -> Arrays:
        """Box, and the initial point if there is one."""
        box = super().constants(problem)
        if self.initial_point is None:
            return box
        point = np.asarray(self.initial_point, dtype=float)
        if point.shape not in ((), box["lower"].shape):
            raise InvalidInput("initial_point", self.initial_point, f"give one or {problem.n_var} numbers")
        return {**box, "point": np.broadcast_to(point, box["lower"].shape).copy()}

    def initialize(self, constants: Arrays, draws: Arrays) -> np.ndarray:
        """First positions, shape (..., n, d)."""
        lower, upper = constants["lower"], constants["upper"]
        uniform = super().initialize(constants, draws)
        if self.initial == "uniform":
            return uniform
        point = np.clip(constants["point"], lower, upper)
        if self.initial == "range":
            reach = np.abs(constants["point"])
            low, high = np.clip(-reach, lower, upper), np.clip(reach, lower, upper)
            return low + draws["position"] * (high - low)
        if self.initial == "degenerate":
            return np.broadcast_to(point, uniform.shape).copy()
        return np.concatenate(
            [np.broadcast_to(point, uniform[..., :1, :].shape), uniform[..., 1:, :]], axis=-2
        )

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first population."""
        runs = losses.shape[:-1]
        state = super().found(constants, candidates, losses)
        return {**state, "cycle": np.zeros(runs, dtype=np.int64), "stall": np.zeros(runs, dtype=np.int64)}

    def move(self, state: Arrays, draws: Arrays, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Next generation, the elite first; everybody else is evaluated."""
        X = state["X"]
        n = X.shape[-2]
        elite, crossed, _ = self._shares(n)
        ranked = np.argsort(state["F"], axis=-1, kind="stable")
        parents = np.take_along_axis(X, self._parents(ranked, draws)[..., None], axis=-2)
        first, second = parents[..., 0 : 2 * crossed : 2, :], parents[..., 1 : 2 * crossed : 2, :]
        if self.crossover == "arithmetic":
            share = draws["blend"][..., :1]
            children = share * first + (1.0 - share) * second
        else:
            children = np.where(draws["blend"] < 0.5, first, second)
        passed = (np.minimum(state["cycle"] + 1, self.horizon) / self.horizon)[..., None, None]
        sigma = self.mutation_scale * (1.0 - self.shrink * passed) * (state["upper"] - state["lower"])
        mutants = parents[..., 2 * crossed :, :] + sigma * draws["mutation"]
        kept = np.take_along_axis(X, ranked[..., :elite, None], axis=-2)
        candidates = np.clip(
            np.concatenate([kept, children, mutants], axis=-2), state["lower"], state["upper"]
        )
        return candidates, np.broadcast_to(np.arange(n) >= elite, state["F"].shape).copy()

    def _parents(self, ranked: np.ndarray, draws: Arrays) -> np.ndarray:
        """Indices of the parents in random order, shape (..., parents); `ranked` is best first."""
        spin, n = draws["spin"], ranked.shape[-1]
        count = spin.shape[-1]
        if self.selection == "roulette":
            wheel = np.cumsum(rank_expectation(n, 1))
            places = np.sum(wheel[:-1] <= spin[..., None], axis=-1)
        else:
            places = stochastic_uniform(rank_expectation(n, count), spin[..., :1], count)
        chosen = np.take_along_axis(ranked, places, axis=-1)
        # equidistant pointers come sorted by rank: shuffled, so that anybody may meet anybody
        return np.take_along_axis(chosen, np.argsort(draws["order"], axis=-1, kind="stable"), axis=-1)

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """Replace everybody; the elite keeps its losses."""
        F = np.where(mask, losses, np.sort(state["F"], axis=-1))
        better = losses.min(axis=-1, initial=np.inf, where=mask) < state["F"].min(axis=-1)
        return {
            **state,
            "X": candidates,
            "F": F,
            "cycle": np.asarray(state["cycle"] + 1),
            "stall": np.where(better, 0, state["stall"] + 1),
        }

    def _advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        super()._advance(infills, **kwargs)
        if self.stall_limit is not None and self.state["stall"] >= self.stall_limit:
            self.termination.terminate()


def rank_expectation(n: int, parents: int) -> np.ndarray:
    """Expected number of times that each rank is a parent, ``∝ 1/√rank``, best first, shape (n,)."""
    scores = 1.0 / np.sqrt(np.arange(1.0, n + 1.0))
    return parents * scores / scores.sum()


def stochastic_uniform(expectation: np.ndarray, start: np.ndarray, parents: int) -> np.ndarray:
    """Select with one spin of a wheel that has equidistant pointers (Baker 1987).

    Parameters
    ----------
    expectation : ndarray, shape (n,)
        Expected number of selections of each individual; its sum is `parents`.
    start : ndarray, shape (..., 1)
        Position of the first pointer, uniform in [0, 1).
    parents : int
        Number of selections, one pointer each.

    Returns
    -------
    ndarray of int, shape (..., parents)
        Ascending: individual k is there floor or ceil of ``expectation[k]`` times.
    """
    wheel = np.cumsum(expectation)
    pointers = start + np.arange(parents)
    # the last slot takes what rounding leaves above the end of the wheel
    return np.sum(wheel[:-1] <= pointers[..., None], axis=-1)
