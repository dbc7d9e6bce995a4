"""IPOPT on the innovation likelihood, every filter run counted before it is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.likelihood_objective import InnovationObjective

__all__ = ["Descent", "Spend", "descend"]

Array = NDArray[np.float64]
Spend = Callable[[int], bool]

#: Ends of an IPOPT run that are an optimum.
SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


@dataclass(frozen=True)
class Descent:
    """End of one descent.

    Attributes
    ----------
    theta : ndarray, shape (d,)
        Best parameters seen.
    value : float
        Objective there, per measurement and with the prior.
    likelihood : float
        Negative log-likelihood there.
    converged : bool
        Whether IPOPT found an optimum.
    """

    theta: Array
    value: float
    likelihood: float
    converged: bool


class _Ledger:
    """Evaluates the objective for IPOPT: every point once, the best remembered, the budget asked."""

    def __init__(self, objective: InnovationObjective, spend: Spend | None) -> None:
        self.objective, self.spend = objective, spend
        self.known: tuple[bytes, float, Array, Array] | None = None
        self.best: tuple[float, Array] | None = None

    def at(self, theta: Array) -> tuple[float, Array, Array]:
        d = len(theta)
        key = theta.tobytes()
        if self.known is not None and self.known[0] == key:
            return self.known[1:]
        if self.spend is not None and not self.spend(1 + d):
            return np.nan, np.full(d, np.nan), np.full((d, d), np.nan)
        value, gradient, information = self.objective(theta)
        self.known = key, value, gradient, information
        if np.isfinite(value) and (self.best is None or value < self.best[0]):
            self.best = value, theta.copy()
        return value, gradient, information


def descend(
    objective: InnovationObjective,
    theta: Array,
    *,
    max_iterations: int,
    tolerance: float = 1e-8,
    spend: Spend | None = None,
) -> Descent | None:
    """Minimise an objective with IPOPT from one start.

    Parameters
    ----------
    objective : InnovationObjective
        What to minimise.
    theta : ndarray, shape (d,)
        Where to begin.
    max_iterations : int
        Cap on iterations.
    tolerance : float, default 1e-8
        IPOPT's tolerance, for the gradient of the objective per measurement.
    spend : callable, optional
        Asked with the price 1 + d of every filter run with derivatives before it is made.

    Returns
    -------
    Descent or None
        The best point seen; None if the budget did not allow a single evaluation.
    """
    import casadi as ca

    ledger = _Ledger(objective, spend)
    d = len(theta)
    value, gradient, hessian = (make(d, ledger) for make in _callbacks())
    x, p = ca.MX.sym("x", d), ca.MX.sym("p", 0)
    limits = objective.structure.limits
    options = {
        "grad_f": gradient,
        "hess_lag": hessian,
        "print_time": False,
        "show_eval_warnings": False,
        "error_on_fail": False,
        "calc_lam_p": False,
        "no_nlp_grad": True,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "max_iter": max_iterations,
            "tol": tolerance,
            "mu_init": 1e-6,
            "honor_original_bounds": "yes",
        },
    }
    solver = ca.nlpsol("fit", "ipopt", {"x": x, "p": p, "f": value(x)}, options)
    solver(x0=np.clip(theta, -limits + 1e-2, limits - 1e-2), lbx=-limits, ubx=limits)
    if ledger.best is None:
        return None
    best, at = ledger.best
    away = at - objective.prior_mean
    prior = 0.5 * float(objective.prior_weight @ away**2)
    done = solver.stats()["return_status"] in SOLVED
    return Descent(at, best, best * objective.n_seen - prior, done)


@lru_cache(maxsize=1)
def _callbacks() -> tuple[Any, Any, Any]:
    """The casadi functions that ask a ledger; classes made on first use, so that casadi loads then."""
    import casadi as ca

    class Asked(ca.Callback):
        shapes_in: tuple[Callable[[int], int], ...] = ()

        def __init__(self, d: int, ledger: _Ledger) -> None:
            super().__init__()
            self.d, self.ledger = d, ledger
            self.construct(type(self).__name__.lower(), {})

        def get_sparsity_in(self, i: int) -> Any:
            return ca.Sparsity.dense(self.shapes_in[i](self.d), 1)

    class Value(Asked):
        shapes_in = (lambda d: d,)

        def eval(self, given: Any) -> Any:
            return [self.ledger.at(np.array(given[0]).ravel())[0]]

    class Gradient(Asked):
        shapes_in = (lambda d: d, lambda d: 0)

        def get_n_in(self) -> int:
            return 2

        def get_n_out(self) -> int:
            return 2

        def get_sparsity_out(self, i: int) -> Any:
            return ca.Sparsity.dense(1 if i == 0 else self.d, 1)

        def eval(self, given: Any) -> Any:
            value, gradient, _ = self.ledger.at(np.array(given[0]).ravel())
            return [value, gradient]

    class Hessian(Asked):
        shapes_in = (lambda d: d, lambda d: 0, lambda d: 1, lambda d: 0)

        def get_n_in(self) -> int:
            return 4

        def get_sparsity_out(self, i: int) -> Any:
            return ca.Sparsity.upper(self.d)

        def eval(self, given: Any) -> Any:
            _, _, information = self.ledger.at(np.array(given[0]).ravel())
            return [ca.triu(ca.DM(information)) * given[2]]

    return Value, Gradient, Hessian
