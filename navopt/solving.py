"""One call for every solver: run it on a problem within a budget and say what it found."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
from pymoo.core.algorithm import Algorithm
from pymoo.core.termination import NoTermination

from navopt import registry
from navopt.errors import InvalidInput
from navopt.evaluation import TRACE_DTYPE, BudgetSpent, CountingEvaluator
from navopt.problem import EstimationProblem
from navopt.solution import Solution

__all__ = ["Progress", "solve"]

MESSAGES = {
    "budget": "the budget was used",
    "target": "the target loss was reached",
    "converged": "the solver stopped by its own rule",
    "stopped": "the callback asked to stop",
    "interrupted": "interrupted from the keyboard; this is the best so far",
    "invalid": "no candidate could be evaluated",
}


@dataclass(frozen=True)
class Progress:
    """What a callback is told after each batch.

    Attributes
    ----------
    cost : int
        Cost so far.
    x : ndarray, shape (n_var,)
        Best decision vector so far.
    loss : float
        Its loss.
    elapsed_s : float
        Seconds since the run began.
    algorithm : pymoo.core.algorithm.Algorithm
        The running algorithm, to look at.
    """

    cost: int
    x: np.ndarray
    loss: float
    elapsed_s: float
    algorithm: Algorithm


def solve(
    problem: EstimationProblem,
    solver: str | Algorithm,
    *,
    budget: int | None = None,
    seed: int = 1,
    target: float | None = None,
    callback: Callable[[Progress], bool | None] | None = None,
) -> Solution:
    """Solve an estimation problem.

    Parameters
    ----------
    problem : EstimationProblem
        What to solve.
    solver : str or pymoo.core.algorithm.Algorithm
        A registered name, or an algorithm; it is copied, never changed. One that was paused half-way
        (and perhaps pickled) goes on from there, its seed and earlier cost included.
    budget : int, optional
        Largest cost (see `navopt.Counts`), never exceeded; a batch that would exceed it is cut. None
        leaves the end to the solver's own rule.
    seed : int, default 1
        Seed of a stochastic solver.
    target : float, optional
        Stop as soon as a batch brings the loss to this value or below; it may be negative.
    callback : callable, optional
        Called after each batch with a `Progress`; a true return value stops the run.

    Returns
    -------
    Solution

    Raises
    ------
    InvalidInput
        If an argument has an unusable value.
    UnsuitableProblem
        If the solver needs what the problem does not provide.
    NumericalFault
        If the model returns NaN.
    """
    if not isinstance(problem, EstimationProblem):
        raise InvalidInput("problem", type(problem).__name__, "give a navopt.EstimationProblem")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InvalidInput("seed", seed, "give a non-negative integer, so that the run can be repeated")
    if target is not None and np.isnan(target):
        raise InvalidInput("target", target, "give a number or None")
    algorithm = _prepare(solver)
    info = getattr(algorithm, "solver_info", None)
    limit = _check_budget(budget, info)
    if info is not None:
        info.check(problem)
    if algorithm.problem is None:
        algorithm.evaluator = CountingEvaluator(budget=limit, n_var=problem.n_var)
        # with a budget, a solver's default stopping rule would cut the comparison short
        own_rule = algorithm.termination if budget is None and target is None else NoTermination()
        algorithm.setup(problem, seed=int(seed), termination=own_rule)
    else:
        _resume(algorithm, limit, problem)
    status = _run(algorithm, target, callback)
    return _conclude(algorithm, problem, status, budget=limit, seed=int(seed), target=target)


def _prepare(solver: str | Algorithm) -> Algorithm:
    if isinstance(solver, str):
        return registry.make_solver(solver)
    if not isinstance(solver, Algorithm):
        raise InvalidInput("solver", solver, "give a registered name or a pymoo Algorithm")
    return copy.deepcopy(solver)


def _check_budget(budget: int | None, info: registry.SolverInfo | None) -> int | None:
    if budget is None:
        return None
    if isinstance(budget, bool) or not isinstance(budget, int | np.integer) or budget < 1:
        raise InvalidInput("budget", budget, "give a whole number of evaluations, at least 1, or None")
    if info is not None and budget < info.minimum_cost:
        raise InvalidInput("budget", budget, f"{info.name} needs at least {info.minimum_cost}")
    return int(budget)


def _resume(algorithm: Algorithm, limit: int | None, problem: EstimationProblem) -> None:
    """Go on from a half-run: keep what it has spent and found, whoever counted until now."""
    if type(algorithm.problem) is not type(problem) or algorithm.problem.n_var != problem.n_var:
        raise InvalidInput("solver", "an algorithm paused on another problem", "pass the problem it was on")
    if isinstance(algorithm.evaluator, CountingEvaluator):
        algorithm.evaluator.budget = limit
    else:
        evaluator = CountingEvaluator(budget=limit, n_var=problem.n_var)
        if algorithm.opt is not None and len(algorithm.opt):
            best = algorithm.opt[0]
            evaluator.adopt(best.X, best.F[0], algorithm.evaluator.n_eval)
        algorithm.evaluator = evaluator
    if limit is not None and algorithm.has_next():
        algorithm.termination = NoTermination()


def _run(
    algorithm: Algorithm, target: float | None, callback: Callable[[Progress], bool | None] | None
) -> str:
    evaluator: CountingEvaluator = algorithm.evaluator
    if algorithm.is_initialized and not algorithm.has_next():
        return "converged"
    try:
        while evaluator.remaining > 0:
            algorithm.next()
            if target is not None and evaluator.best_loss <= target:
                return "target"
            if callback is not None and evaluator.best_x is not None:
                progress = Progress(
                    evaluator.cost, evaluator.best_x, evaluator.best_loss, evaluator.elapsed_s, algorithm
                )
                if callback(progress):
                    return "stopped"
            if not algorithm.has_next():
                return "converged"
    except BudgetSpent:
        if target is not None and evaluator.best_loss <= target:
            return "target"
    except KeyboardInterrupt:
        if evaluator.best_x is None:
            raise
        return "interrupted"
    return "budget"


def _conclude(algorithm: Algorithm, problem: EstimationProblem, status: str, **asked: Any) -> Solution:
    evaluator: CountingEvaluator = algorithm.evaluator
    elapsed = evaluator.elapsed_s
    estimate, fitted = getattr(algorithm, "estimate", None), getattr(algorithm, "fitted", None)
    if estimate is not None:
        x = problem.project(estimate)
        # a solver that proposed the projection has had it evaluated, and counted, already
        known = evaluator.best_x is not None and np.array_equal(x, evaluator.best_x)
        loss = evaluator.best_loss if known else float(problem.loss(x))
    elif evaluator.best_x is None:
        raise InvalidInput("budget", asked["budget"], "nothing was evaluated; allow a larger budget")
    else:
        x, loss = evaluator.best_x, evaluator.best_loss
        estimate = problem.estimate(x)
    if not np.isfinite(loss):
        status = "invalid"
    x = np.array(x)
    x.setflags(write=False)
    trace = evaluator.trace() if evaluator.rows else np.array([(evaluator.cost, loss, elapsed)], TRACE_DTYPE)
    message = MESSAGES[status]
    if evaluator.invalid:
        tally = "; ".join(f"{n} × {why}" for why, n in evaluator.invalid.most_common())
        message += f" ({tally})"
    return Solution(
        x=x,
        loss=loss,
        estimate=estimate,
        fitted=fitted,
        scores=problem.score(estimate) if problem.truth is not None else {},
        counts=evaluator.counts,
        trace=trace,
        elapsed_s=elapsed,
        status=status,
        message=message,
        invalid=dict(evaluator.invalid),
        settings=_settings(algorithm, problem, **asked),
    )


def _settings(algorithm: Algorithm, problem: EstimationProblem, **asked: Any) -> dict[str, Any]:
    info = getattr(algorithm, "solver_info", None)
    problem_info = getattr(problem, "problem_info", None)
    return {
        "problem": problem_info.name if problem_info is not None else type(problem).__name__,
        "solver": info.name if info is not None else type(algorithm).__name__,
        "options": dict(getattr(algorithm, "settings", {})),
        "termination": "budget" if asked["budget"] is not None else type(algorithm.termination).__name__,
        **asked,
        "seed": algorithm.seed if algorithm.seed is not None else asked["seed"],
        "versions": {name: _version(name) for name in ("navopt", "pymoo", "numpy")},
    }


@cache
def _version(name: str) -> str:
    """Installed version, read from disk once and not in every run."""
    return version(name)
