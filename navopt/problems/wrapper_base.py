"""What every wrapper does: hand to another problem what it does not change itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from navopt.errors import InvalidInput
from navopt.problem import EstimationProblem, Parameter
from navopt.registry import ProblemInfo

__all__ = ["Wrapper", "in_order", "locate", "registered_name"]

#: What still holds after a change of variables; anything else speaks of the inner decision vector.
COVARIANT = frozenset({"residuals", "prior", "bound"})


def registered_name(problem: EstimationProblem) -> str:
    """Registry name of a problem, or the name of its class."""
    info = getattr(problem, "problem_info", None)
    return info.name if info is not None else type(problem).__name__


def locate(problem: EstimationProblem, estimate: Any) -> np.ndarray:
    """Decision vector of an estimate, also outside the box if the problem can tell.

    `EstimationProblem.project` clips to the box, which a wrapper must do once, on the outside.
    """
    find = getattr(problem, "locate", problem.project)
    return np.asarray(find(estimate), dtype=float)


class Wrapper(EstimationProblem):
    """Base of the wrappers: hands everything it does not change to the inner problem.

    A subclass overrides `inward` and `outward`, or `_loss`, and `over`.

    Parameters
    ----------
    problem : EstimationProblem
        The inner problem.
    parameters : sequence of Parameter, optional
        Unknowns of the wrapped problem, the inner problem's if not given.

    Attributes
    ----------
    problem : EstimationProblem
        The inner problem.
    minimum : float or None
        Global minimum (without noise), where the inner problem knows it.
    minimizers : ndarray, shape (k, n_var), or None
        All global minimisers, inside the box or not, as decision vectors of the wrapped problem.
    start : ndarray, shape (n_var,), or None
        Customary start of the inner problem, mapped along; perhaps outside the box. `nominal` is not
        mapped: what is assumed beforehand must not know where the minimum went.

    Raises
    ------
    InvalidInput
        If the inner problem has a known minimiser and none is inside the box any more.
    """

    def __init__(self, problem: EstimationProblem, parameters: Sequence[Parameter] | None = None) -> None:
        super().__init__(problem.parameters if parameters is None else tuple(parameters))
        self.problem = problem
        kind = type(self).__name__.lower()
        summary = getattr(getattr(problem, "problem_info", None), "summary", type(problem).__name__)
        self.problem_info = ProblemInfo(f"{kind}({registered_name(problem)})", f"{kind}: {summary}")
        self.provides = problem.provides & COVARIANT  # type: ignore[misc]
        self.truth = problem.truth
        self.minimum: float | None = getattr(problem, "minimum", None)
        self.minimizers = self._carried(getattr(problem, "minimizers", None))
        self.start = self._carried(getattr(problem, "start", None))
        self._carry_truth()

    def _carried(self, points: np.ndarray | None) -> np.ndarray | None:
        if points is None:
            return None
        moved = np.array(self.outward(points))
        moved.setflags(write=False)
        return moved

    def _carry_truth(self) -> None:
        first = self._carried(self.problem.true_x)
        if first is None:
            return
        others = self.minimizers if self.minimizers is not None else first[None]
        known = np.vstack([first[None], others])
        inside = ((self.xl <= known) & (known <= self.xu)).all(axis=1)
        if not inside.any():
            raise InvalidInput(
                f"minimiser of the {self.problem_info.name} problem",
                first.tolist(),
                "it left the box; shift it less, turn about it, or give the inner problem a larger box",
            )
        k = int(np.flatnonzero(inside)[0])
        self.true_x = known[k]
        self.true_x.setflags(write=False)
        if k > 0:
            self.truth = self.problem.estimate(self.inward(self.true_x))

    # -- the map: subclasses override ----------------------------------------------------------------
    def inward(self, X: np.ndarray) -> np.ndarray:
        """Decision vectors of the inner problem for those of this one, shape (..., n_var), unclipped."""
        return np.asarray(X, dtype=float)

    def outward(self, Y: np.ndarray) -> np.ndarray:
        """Inverse of `inward`."""
        return np.asarray(Y, dtype=float)

    def slope(self) -> np.ndarray:
        """Derivative of `inward`, shape (n_var, n_var)."""
        return np.eye(self.n_var)

    def over(self, problem: EstimationProblem) -> Self:
        """Return the same wrapper over another inner problem."""
        raise NotImplementedError

    # -- what follows from it -------------------------------------------------------------------------
    def _inner(self, X: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(self.inward(X))

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return self.problem._loss(self._inner(X))

    def invalid_reasons(self, X: np.ndarray) -> list[str]:
        """Why the inner problem could not evaluate the candidates."""
        return self.problem.invalid_reasons(self._inner(X))

    def estimate(self, x: np.ndarray) -> Any:
        """Physical answer of the inner problem."""
        return self.problem.estimate(self.inward(x))

    def locate(self, estimate: Any) -> np.ndarray:
        """Decision vector of an estimate, also outside the box, shape (n_var,)."""
        return self.outward(locate(self.problem, estimate))

    def project(self, estimate: Any) -> np.ndarray:
        """Nearest point of the box, axis by axis, to the decision vector of an estimate."""
        return self.clip(self.locate(estimate))

    def _score(self, estimate: Any) -> dict[str, float]:
        return self.problem._score(estimate)

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        return self.problem._residuals(self._inner(X))

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        return in_order(self.problem._jacobian(self._inner(X)), self.slope())

    def prior(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Mean and covariance known beforehand, in the decision vector of the wrapped problem."""
        known = self.problem.prior()
        if known is None:
            return None
        back = np.linalg.inv(self.slope())
        return self.outward(known[0]), back @ known[1] @ back.T

    def redraw(self, seed: int) -> EstimationProblem:
        """Return the same wrapper over the redrawn inner problem."""
        return self.over(self.problem.redraw(seed))

    def illustration(self) -> dict[str, np.ndarray]:
        """Arrays of the inner problem's picture."""
        return self.problem.illustration()


def in_order(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """``rows @ matrix`` in one fixed order of operations, shapes (..., k) and (k, m) -> (..., m).

    BLAS rounds as the number of rows suits it, and a loss must not depend on its batch.
    """
    total = rows[..., :1] * matrix[0]
    for k in range(1, len(matrix)):
        total = total + rows[..., k : k + 1] * matrix[k]
    return total
