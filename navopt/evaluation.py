"""Counting what a solver spends, and remembering the best it has seen.

One object does both, because both must survive a pickled half-run and neither may be a second
opinion: the reported loss is the loss that was evaluated, together with the point it belongs to.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from pymoo.core.evaluator import Evaluator
from pymoo.core.population import Population

from navopt.errors import InvalidInput

if TYPE_CHECKING:
    from navopt.problem import EstimationProblem

__all__ = ["BudgetSpent", "CountingEvaluator", "Counts"]

TRACE_DTYPE = np.dtype([("cost", np.int64), ("loss", np.float64), ("elapsed_s", np.float64)])


class BudgetSpent(Exception):
    """Signal inside a run: the budget has been used, the batch was cut. Never reaches a user of `solve`."""


@dataclass(frozen=True)
class Counts:
    """What a run evaluated.

    Attributes
    ----------
    loss : int
        Evaluations of the loss (pymoo's ``n_eval``).
    residuals : int
        Evaluations of the residual vector.
    jacobians : int
        Evaluations of the Jacobian; each costs ``n_var`` in the budget.
    internal : int
        Model runs inside a solver's own kernel (TERCOM hypotheses, IPOPT function values, EM passes).
    n_var : int
        Number of parameters, the price of a Jacobian.
    """

    loss: int = 0
    residuals: int = 0
    jacobians: int = 0
    internal: int = 0
    n_var: int = 1

    @property
    def cost(self) -> int:
        """Cost that the budget limits: ``loss + residuals + n_var * jacobians + internal``."""
        return self.loss + self.residuals + self.n_var * self.jacobians + self.internal


class CountingEvaluator(Evaluator):
    """A pymoo evaluator that counts every kind of model run and keeps the best point seen.

    Parameters
    ----------
    budget : int or None
        Largest cost allowed. The batch that would exceed it is cut: its affordable part is evaluated
        and eligible as best, then `BudgetSpent` is raised.
    n_var : int
        Number of parameters, the price of a Jacobian.
    """

    def __init__(self, *, budget: int | None = None, n_var: int = 1) -> None:
        super().__init__()
        self.budget = budget
        self.n_residuals = 0
        self.n_jacobians = 0
        self.n_internal = 0
        self.n_var = n_var
        self.best_x: np.ndarray | None = None
        self.best_loss = np.inf
        self.rows: list[tuple[int, float, float]] = []
        self.invalid: Counter[str] = Counter()
        self.started: float | None = None

    def __getstate__(self) -> dict[str, Any]:
        # a clock reading means nothing in another process: keep the time already used instead
        return {**self.__dict__, "started": None, "elapsed": self.elapsed_s}

    def __setstate__(self, state: dict[str, Any]) -> None:
        elapsed = state.pop("elapsed")
        self.__dict__.update(state)
        self.started = None if elapsed == 0.0 else time.perf_counter() - elapsed

    @property
    def elapsed_s(self) -> float:
        """Seconds since the first evaluation was asked for, pauses in a pickle not counted."""
        return 0.0 if self.started is None else time.perf_counter() - self.started

    @property
    def counts(self) -> Counts:
        """What has been evaluated so far."""
        return Counts(self.n_eval, self.n_residuals, self.n_jacobians, self.n_internal, self.n_var)

    @property
    def cost(self) -> int:
        """Cost so far, in the unit of the budget."""
        return self.n_eval + self.n_residuals + self.n_var * self.n_jacobians + self.n_internal

    @property
    def remaining(self) -> float:
        """Cost that may still be spent; ``inf`` without a budget."""
        return np.inf if self.budget is None else self.budget - self.cost

    def charge(self, cost: int, *, unit: str = "internal") -> None:
        """Count `cost` model runs made in a solver's own kernel, before making them.

        Parameters
        ----------
        cost : int
            Number of runs, at least 0.
        unit : {"internal", "residuals", "jacobians"}
            What they are.

        Raises
        ------
        BudgetSpent
            If they would exceed the budget; nothing is counted then.
        """
        if self.started is None:
            self.started = time.perf_counter()
        price = cost * self.n_var if unit == "jacobians" else cost
        if price > self.remaining:
            raise BudgetSpent
        setattr(self, f"n_{unit}", getattr(self, f"n_{unit}") + cost)

    def eval(self, problem: EstimationProblem, pop: Population, **kwargs: Any) -> Population:
        """Evaluate those individuals of `pop` that have no loss yet, in order, within the budget."""
        if self.started is None:
            self.started = time.perf_counter()
        self.n_var = problem.n_var
        todo = [individual for individual in pop if "F" not in individual.evaluated]
        losses = self._affordable_losses(problem, [individual.X for individual in todo])
        for individual, loss in zip(todo, losses, strict=False):
            individual.F = np.array([loss])
            individual.evaluated.update(("F", "G", "H"))
        if len(losses) < len(todo):
            raise BudgetSpent
        return pop

    def losses(self, problem: EstimationProblem, X: np.ndarray) -> np.ndarray:
        """Evaluate candidates as `eval` does, without individuals, whose upkeep costs more than a fast loss.

        Parameters
        ----------
        problem : EstimationProblem
            Whose loss.
        X : ndarray, shape (m, n_var)
            Candidates.

        Returns
        -------
        ndarray, shape (m,)

        Raises
        ------
        BudgetSpent
            If they would exceed the budget; those within it have been evaluated, counted and remembered.
        """
        if self.started is None:
            self.started = time.perf_counter()
        self.n_var = problem.n_var
        losses = self._affordable_losses(problem, X)
        if len(losses) < len(X):
            raise BudgetSpent
        return losses

    def _affordable_losses(
        self, problem: EstimationProblem, X: Sequence[np.ndarray] | np.ndarray
    ) -> np.ndarray:
        """Losses of as many candidates, from the first on, as the budget allows."""
        affordable = X[: int(min(len(X), max(self.remaining, 0)))]
        if not len(affordable):
            return np.zeros(0)
        rows = np.array(affordable, dtype=float)
        losses = problem.loss(rows)
        self._record(problem, rows, losses)
        return losses

    def adopt(self, x: np.ndarray, loss: float, n_eval: int) -> None:
        """Take over a run that another evaluator began: its best point and its count."""
        self.n_eval, self.best_x, self.best_loss = n_eval, np.array(x, dtype=float), float(loss)
        self.rows.append((n_eval, self.best_loss, self.elapsed_s))

    def _record(self, problem: EstimationProblem, X: np.ndarray, losses: np.ndarray) -> None:
        before, elapsed = self.cost, self.elapsed_s
        self.n_eval += len(X)
        if self.best_x is None:
            self.best_x, self.best_loss = X[0].copy(), float(losses[0])
            self.rows.append((before + 1, self.best_loss, elapsed))
        for k in np.flatnonzero(losses < self.best_loss):
            if losses[k] < self.best_loss:
                self.best_x, self.best_loss = X[k].copy(), float(losses[k])
                self.rows.append((before + int(k) + 1, self.best_loss, elapsed))
        bad = ~np.isfinite(losses)
        if bad.any():
            self.invalid.update(str(reason) for reason in problem.invalid_reasons(X[bad]))

    def trace(self) -> np.ndarray:
        """Best loss against cost: one row per improvement, plus the first and the last evaluation."""
        if not self.rows:
            raise InvalidInput("trace", "no rows", "evaluate at least one candidate first")
        rows = list(self.rows)
        if rows[-1][0] < self.cost:
            rows.append((self.cost, self.best_loss, self.elapsed_s))
        return np.array(rows, dtype=TRACE_DTYPE)
