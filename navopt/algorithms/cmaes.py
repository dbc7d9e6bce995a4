"""CMA-ES from the `cma` package, with its own generator, picklable, restarted until the budget is used."""

from __future__ import annotations

from typing import Any

import numpy as np
from pymoo.core.population import Population

from navopt.algorithms.options import at_least
from navopt.algorithms.swarm import ContractedAlgorithm
from navopt.errors import InvalidInput
from navopt.registry import solver

__all__ = ["CMAES"]


class _Normal:
    """Standard normal draws with the call signature of ``numpy.random.randn``, picklable with its state.

    `cma` otherwise seeds and uses numpy's global generator.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def __call__(self, *shape: int) -> np.ndarray:
        return self.rng.standard_normal(shape)


@solver(
    "cmaes",
    summary="covariance matrix adaptation, restarted with twice the population when it has converged",
    source="Hansen and Ostermeier 2001, Evol. Comput. 9:159; Auger and Hansen 2005 (IPOP); package cma",
    reasons={"comparison_based": "the decision to restart looks at the spread of the losses"},
)
class CMAES(ContractedAlgorithm):
    """Covariance matrix adaptation evolution strategy with increasing-population restarts.

    Works in the unit box; every start is drawn uniformly in it.

    Parameters
    ----------
    pop_size : int, optional
        Candidates per batch of the first run; ``4 + floor(3 ln n_var)`` if not given.
    sigma : float, default 0.3
        First step size as a fraction of the box.
    growth : int, default 2
        Factor on the population at each restart.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.
    """

    def __init__(
        self, *, pop_size: int | None = None, sigma: float = 0.3, growth: int = 2, **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self.pop_size = None if pop_size is None else at_least("pop_size", pop_size, 4)
        if not 0 < sigma <= 1:
            raise InvalidInput("sigma", sigma, "give a fraction of the box in (0, 1]")
        self.sigma = sigma
        self.growth = at_least("growth", growth, 1)
        self.restarts = -1
        self.converged = 0
        self._strategy: Any = None

    def _initialize_infill(self) -> Population:
        return self._infill()

    def _start(self) -> None:
        import cma

        self.restarts += 1
        d = self.problem.n_var
        size = (self.pop_size or 4 + int(3 * np.log(d))) * self.growth**self.converged
        self._strategy = cma.CMAEvolutionStrategy(
            self.random_state.random(d),
            self.sigma,
            {
                "bounds": [0, 1],
                "popsize": size,
                "randn": _Normal(self.random_state),
                "seed": np.nan,  # cma's word for "leave numpy's global generator alone"
                "verbose": -9,
                "verb_log": 0,
                "verb_disp": 0,
                # in one dimension cma 4.5 fails when it wants to limit the standard deviation
                **({"maxstd": np.inf} if d == 1 else {}),
            },
        )

    def _infill(self) -> Population:
        if self._strategy is None:
            self._start()
        self._asked = self._strategy.ask()
        lower, upper = self.problem.bounds()
        return Population.new(X=np.clip(lower + np.array(self._asked) * (upper - lower), lower, upper))

    def _initialize_advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        self._advance(infills)

    def _advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        losses = infills.get("F")[:, 0]  # type: ignore[union-attr]
        finite = np.isfinite(losses)
        if not finite.any():
            # nothing to learn from a batch that could not be evaluated: look elsewhere
            self._strategy = None
            return
        # only the order matters to the update, but infinities would spoil the stopping statistics
        self._strategy.tell(self._asked, np.where(finite, losses, losses[finite].max() + 1.0).tolist())
        if self._strategy.stop():
            self.converged += 1
            self._strategy = None
