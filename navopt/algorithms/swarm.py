"""The small state machine that every swarm algorithm here is.

A pymoo iteration is one *batch*: a phase of the cycle, or with ``update="sequential"`` one individual
of it. Three functions make an algorithm, and only the first sees a generator:

``draw(rng, n, d)``
    all random numbers of one cycle, a fixed block whatever the cycle will need of it;
``move(state, draws, phase)``
    the candidates of a phase and the mask of those to be evaluated, a pure function;
``select(state, draws, phase, candidates, losses, mask)``
    the state after the phase, a pure function.

State and draws are dicts of plain arrays with any leading axes before ``(n, d)``, so many runs advance
in one call, bit for bit as each alone, and a pickled half-run resumes exactly.
"""

from __future__ import annotations

import inspect
from typing import Any, ClassVar

import numpy as np
from pymoo.core.algorithm import Algorithm
from pymoo.core.population import Population
from pymoo.util.display.single import SingleObjectiveOutput

from navopt.algorithms.options import at_least, one_of
from navopt.checks import check_problem
from navopt.errors import UnknownName
from navopt.evaluation import CountingEvaluator

__all__ = ["SETUP_KEYS", "ContractedAlgorithm", "SwarmAlgorithm"]

Arrays = dict[str, np.ndarray]

#: Keywords of pymoo's ``setup``; `pymoo.optimize.minimize` passes its own through unchecked.
SETUP_KEYS = (
    "archive",
    "callback",
    "display",
    "evaluator",
    "output",
    "progress",
    "return_least_infeasible",
    "save_history",
    "seed",
    "termination",
    "verbose",
)


class ContractedAlgorithm(Algorithm):
    """A pymoo algorithm that keeps the promises pymoo leaves open.

    Unknown keywords of ``setup`` (and so of `pymoo.optimize.minimize`) are refused, the settings can
    be read back, and the optimum never gets worse.
    """

    def __init__(self, **kwargs: Any) -> None:
        for key in kwargs:
            if key not in SETUP_KEYS:
                raise UnknownName(f"argument of {type(self).__name__}", key, SETUP_KEYS)
        kwargs.setdefault("output", SingleObjectiveOutput())
        kwargs.setdefault("evaluator", CountingEvaluator())
        super().__init__(**kwargs)

    opt: Population | None

    def setup(self, problem: Any, **kwargs: Any) -> Algorithm:
        """Prepare for a problem; keywords as pymoo's, others are refused."""
        for key in kwargs:
            if key not in SETUP_KEYS:
                raise UnknownName(f"argument of {type(self).__name__}.setup", key, SETUP_KEYS)
        check_problem(problem)
        if hasattr(self, "solver_info") and hasattr(problem, "provides"):
            self.solver_info.check(problem)
        return super().setup(problem, **kwargs)

    @property
    def settings(self) -> dict[str, Any]:
        """Constructor arguments of this algorithm, as they were given or defaulted."""
        names = [
            name
            for name, parameter in inspect.signature(type(self)).parameters.items()
            if parameter.kind is not parameter.VAR_KEYWORD
        ]
        return {name: getattr(self, name) for name in names}

    def _set_optimum(self) -> None:
        batch = self.off if self.off is not None and len(self.off) else self.pop
        if batch is None or not len(batch):
            return
        losses = [individual.F[0] for individual in batch]
        k = int(np.argmin(losses))
        if self.opt is None or losses[k] < self.opt[0].F[0]:
            self.opt = Population.create(batch[k])


class SwarmAlgorithm(ContractedAlgorithm):
    """Base of the swarm algorithms.

    Parameters
    ----------
    pop_size : int
        Number of individuals.
    update : {"synchronous", "sequential"}
        Whether a phase moves all individuals on the positions at its start, or one after another as
        most papers' loops do (then a batch is one evaluation).
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Attributes
    ----------
    cycle : int
        Completed cycles, the papers' iterations.
    state : dict of ndarray
        The swarm: ``X`` (n, d), ``F`` (n,), the box ``lower`` and ``upper`` (d,), and what a subclass adds.
    """

    #: Phases of one cycle, in order; ``"initial"`` precedes the first cycle.
    phases: ClassVar[tuple[str, ...]] = ()
    #: Phases that are one batch even when ``update="sequential"``.
    together: ClassVar[frozenset[str]] = frozenset()

    def __init__(self, *, pop_size: int, update: str = "synchronous", **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.pop_size = at_least("pop_size", pop_size, 2)
        self.update = one_of("update", update, ("synchronous", "sequential"))
        self.cycle = 0
        self.state: Arrays = {}
        self.draws: Arrays = {}
        self.stage = 0
        self.planned = False
        self.mask = np.ones(0, dtype=bool)

    # -- what a subclass defines -----------------------------------------------------------------
    def constants(self, problem: Any) -> Arrays:
        """Arrays of the problem that `move` needs; the box by default."""
        return {"lower": np.array(problem.xl), "upper": np.array(problem.xu)}

    def draw_initial(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of the first population."""
        return {"position": rng.random((n, d))}

    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of one cycle."""
        raise NotImplementedError

    def initialize(self, constants: Arrays, draws: Arrays) -> np.ndarray:
        """First positions, shape (..., n, d): uniform in the box by default."""
        lower, upper = constants["lower"], constants["upper"]
        return lower + draws["position"] * (upper - lower)

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first population has been evaluated."""
        return {**constants, "X": candidates, "F": losses}

    def move(self, state: Arrays, draws: Arrays, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Candidates of a phase, shape (..., n, d), and which to evaluate, shape (..., n)."""
        raise NotImplementedError

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """State after the masked candidates of a phase have been evaluated."""
        raise NotImplementedError

    # -- pymoo's side ----------------------------------------------------------------------------
    @property
    def pop(self) -> Population:
        """The swarm as a pymoo population, built when asked for: bookkeeping per individual is slow."""
        if not self.__dict__.get("state"):
            return self.__dict__.get("_pop")
        state = self.state
        population = Population.new(X=state["X"], F=state["F"][:, None])
        population.apply(lambda individual: individual.evaluated.update(("F", "G", "H")))
        return population

    @pop.setter
    def pop(self, value: Population | None) -> None:
        self.__dict__["_pop"] = value

    def _initialize_infill(self) -> Population:
        draws = self.draw_initial(self.random_state, self.pop_size, self.problem.n_var)
        self._start = self.constants(self.problem)
        return Population.new(X=self.initialize(self._start, draws))

    def _initialize_advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        self.state = self.found(self._start, infills.get("X"), infills.get("F")[:, 0])  # type: ignore[union-attr]

    @property
    def batches(self) -> list[tuple[str, int | None]]:
        """Phases of a cycle in order, with the one individual that moves where they move in turn."""
        steps: list[tuple[str, int | None]] = []
        for phase in self.phases:
            alone = self.update == "sequential" and phase not in self.together
            steps += [(phase, k) for k in range(self.pop_size)] if alone else [(phase, None)]
        return steps

    def _infill(self) -> Population:
        while not self.planned:
            self.draws = self.draw(self.random_state, self.pop_size, self.problem.n_var)
            self._plan()
        return Population.new(X=self.candidates[self.mask])

    def _plan(self) -> None:
        """Go to the next step in which anybody moves, or to the end of the cycle."""
        while True:
            phase, only = self.batches[self.stage]
            self.candidates, self.mask = self.move(self.state, self.draws, phase)
            if only is not None:
                self.mask = self.mask & (np.arange(self.pop_size) == only)
            self.planned = bool(self.mask.any())
            if self.planned:
                return
            # nobody moves in this phase (most cycles need no scout): spend no iteration on it
            self._next_stage()
            if self.stage == 0:
                return

    def _next_stage(self) -> None:
        self.stage += 1
        if self.stage == len(self.batches):
            self.stage = 0
            self.cycle += 1

    def _advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        losses = np.full(self.mask.shape, np.inf)
        losses[self.mask] = infills.get("F")[:, 0]  # type: ignore[union-attr]
        # what was evaluated is what comes back, should a user have changed it between ask and tell
        self.candidates[self.mask] = infills.get("X")  # type: ignore[union-attr]
        phase = self.batches[self.stage][0]
        self.state = self.select(self.state, self.draws, phase, self.candidates, losses, self.mask)
        self.planned = False
        self._next_stage()
        if self.stage:
            self._plan()
