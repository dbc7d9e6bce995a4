"""Uniform random search, the floor every method must beat."""

from __future__ import annotations

from typing import Any

from pymoo.core.population import Population

from navopt.algorithms.options import at_least
from navopt.algorithms.swarm import ContractedAlgorithm
from navopt.registry import solver

__all__ = ["RandomSearch"]


@solver("random-search", summary="independent uniform draws in the box", comparison_based=True)
class RandomSearch(ContractedAlgorithm):
    """Independent uniform draws in the box.

    Parameters
    ----------
    pop_size : int, default 100
        Candidates per batch.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.
    """

    def __init__(self, *, pop_size: int = 100, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.pop_size = at_least("pop_size", pop_size, 1)

    def _initialize_infill(self) -> Population:
        return self._infill()

    def _infill(self) -> Population:
        lower, upper = self.problem.bounds()
        return Population.new(X=self.random_state.uniform(lower, upper, (self.pop_size, self.problem.n_var)))

    def _advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        self.pop = infills
