"""What deterministic baselines share: one batch of proposals, then the end."""

from __future__ import annotations

from typing import Any

import numpy as np
from pymoo.core.population import Population

from navopt.algorithms.swarm import ContractedAlgorithm

__all__ = ["Baseline"]


class Baseline(ContractedAlgorithm):
    """A solver that works in a kernel of its own and proposes its winners once.

    A subclass implements `propose`. It counts its own model runs with ``self.evaluator.charge``
    before making them and may ask ``self.evaluator.remaining`` what it may still spend.
    """

    def propose(self) -> np.ndarray:
        """Decision vectors to be evaluated by the problem's loss, shape (n, n_var)."""
        raise NotImplementedError

    def _initialize_infill(self) -> Population:
        return Population.new(X=np.atleast_2d(self.problem.clip(self.propose())))

    def _initialize_advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        self.termination.terminate()

    def _infill(self) -> Population:
        # pymoo asks again only if a user goes on after the end: the answer has not changed
        return Population.new(X=self.opt.get("X"))  # type: ignore[union-attr]
