"""Nelder–Mead simplex search as a resumable state machine, restarted until the budget is used."""

from __future__ import annotations

from typing import Any

import numpy as np
from pymoo.core.population import Population

from navopt.algorithms.swarm import ContractedAlgorithm
from navopt.errors import InvalidInput
from navopt.registry import solver

__all__ = ["NelderMead"]


@solver(
    "nelder-mead",
    summary="simplex search from uniform starts, a new one when the simplex has collapsed",
    source="Nelder and Mead 1965, Comput. J. 7:308; steps and order as scipy.optimize",
    comparison_based=True,
)
class NelderMead(ContractedAlgorithm):
    """Nelder–Mead simplex search in a box, multi-start.

    Steps, acceptance tests and their order are those of ``scipy.optimize.minimize`` (reflection 1,
    expansion 2, contraction and shrinkage ½, candidates clipped to the box); unlike scipy's it
    can be paused, pickled and resumed between any two evaluations, and it starts again from a uniform
    draw when the simplex has collapsed.

    Parameters
    ----------
    start : array_like, shape (n_var,), optional
        First vertex of the first simplex; uniform in the box if not given.
    size : float, default 0.1
        Edge of a new simplex as a fraction of the box.
    tolerance : float, default 1e-8
        The simplex has collapsed when no vertex is farther than this fraction of the box from the best.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.
    """

    def __init__(
        self, *, start: Any = None, size: float = 0.1, tolerance: float = 1e-8, **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        if not 0 < size <= 0.5:
            raise InvalidInput("size", size, "give a fraction of the box in (0, 0.5]")
        if not 0 < tolerance < size:
            raise InvalidInput("tolerance", tolerance, "give a positive fraction smaller than size")
        self.start, self.size, self.tolerance = start, size, tolerance
        self.restarts = -1
        self._stage = "begin"

    def _initialize_infill(self) -> Population:
        return self._infill()

    def _initialize_advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        self._advance(infills)

    def _begin(self) -> np.ndarray:
        """Vertices of a new simplex, shape (n_var + 1, n_var)."""
        lower, upper = self.problem.bounds()
        self.restarts += 1
        origin = self.random_state.uniform(lower, upper)
        if self.start is not None and self.restarts == 0:
            given = np.asarray(self.start, dtype=float)
            if given.shape != lower.shape or np.isnan(given).any():
                raise InvalidInput("start", self.start, f"give {len(lower)} coordinates")
            origin = np.clip(given, lower, upper)
        edges = self.size * (upper - lower)
        # grow towards the far side of the box, so that clipping never flattens the simplex
        edges = np.where(origin + edges > upper, -edges, edges)
        return np.vstack([origin, origin + np.diag(edges)])

    def _infill(self) -> Population:
        lower, upper = self.problem.bounds()
        if self._stage == "begin":
            return Population.new(X=self._begin())
        worst = self._simplex[-1]
        centre = np.add.reduce(self._simplex[:-1], 0) / len(worst)
        if self._stage == "shrink":
            trial = self._simplex[0] + 0.5 * (self._simplex[1:] - self._simplex[0])
        else:
            factor = {"reflect": 1.0, "expand": 2.0, "outside": 0.5, "inside": -0.5}[self._stage]
            trial = ((1 + factor) * centre - factor * worst)[None]
        return Population.new(X=np.clip(trial, lower, upper))

    def _advance(self, infills: Population | None = None, **kwargs: Any) -> None:
        X, F = infills.get("X"), infills.get("F")[:, 0]  # type: ignore[union-attr]
        self._stage = getattr(self, f"_after_{self._stage}")(X, F)

    def _after_begin(self, X: np.ndarray, F: np.ndarray) -> str:
        return self._order(X, F)

    def _after_reflect(self, X: np.ndarray, F: np.ndarray) -> str:
        self._reflected = X[0], F[0]
        if F[0] < self._losses[0]:
            return "expand"
        if F[0] < self._losses[-2]:
            return self._replace(X[0], F[0])
        return "outside" if F[0] < self._losses[-1] else "inside"

    def _after_expand(self, X: np.ndarray, F: np.ndarray) -> str:
        return self._replace(X[0], F[0]) if F[0] < self._reflected[1] else self._replace(*self._reflected)

    def _after_outside(self, X: np.ndarray, F: np.ndarray) -> str:
        return self._replace(X[0], F[0]) if F[0] <= self._reflected[1] else "shrink"

    def _after_inside(self, X: np.ndarray, F: np.ndarray) -> str:
        return self._replace(X[0], F[0]) if F[0] < self._losses[-1] else "shrink"

    def _after_shrink(self, X: np.ndarray, F: np.ndarray) -> str:
        return self._order(np.vstack([self._simplex[:1], X]), np.concatenate([self._losses[:1], F]))

    def _replace(self, x: np.ndarray, loss: float) -> str:
        return self._order(np.vstack([self._simplex[:-1], x]), np.append(self._losses[:-1], loss))

    def _order(self, simplex: np.ndarray, losses: np.ndarray) -> str:
        rank = np.argsort(losses, kind="stable")
        self._simplex, self._losses = simplex[rank], losses[rank]
        reach = np.abs(self._simplex[1:] - self._simplex[0]).max(axis=0)
        width = self.problem.xu - self.problem.xl
        collapsed = bool((reach <= self.tolerance * width).all())
        return "begin" if collapsed else "reflect"
