"""What a solver here can take: a finite box, continuous variables, one objective, no constraints."""

from __future__ import annotations

from typing import Any

import numpy as np
from pymoo.core.problem import Problem

from navopt.errors import InvalidInput, UnsuitableProblem

__all__ = ["check_problem"]

#: How many offending variables a message names.
SHOWN = 3


def check_problem(problem: Problem) -> None:
    """Refuse a problem that the solvers here cannot solve, before anything is evaluated.

    A `navopt.EstimationProblem` always passes; this is for the other problems of pymoo, which its own
    algorithms take and then answer with a wrong result or an error from deep inside.

    Parameters
    ----------
    problem : pymoo.core.problem.Problem
        What is about to be solved.

    Raises
    ------
    UnsuitableProblem
        If it has several objectives, constraints, or variables that are not continuous.
    InvalidInput
        If it is no pymoo problem, or its bounds are missing, not finite, equal or swapped.
    """
    if not isinstance(problem, Problem):
        raise InvalidInput(
            "problem", type(problem).__name__, "give a navopt.EstimationProblem or another pymoo Problem"
        )
    name = type(problem).__name__
    if problem.n_obj != 1:
        raise UnsuitableProblem(
            f"{name} has {problem.n_obj} objectives; the solvers here take one: "
            "combine them, or use a multi-objective algorithm of pymoo"
        )
    inequalities, equalities = problem.n_ieq_constr, problem.n_eq_constr
    if inequalities or equalities:
        raise UnsuitableProblem(
            f"{name} has {inequalities} inequality and {equalities} equality constraints; the solvers here "
            "know a box only: return a loss of +inf where a candidate is not allowed, or add a penalty"
        )
    _check_variables(problem, name)
    _check_bounds(problem)


def _check_variables(problem: Problem, name: str) -> None:
    explicit = getattr(problem, "vars", None)
    if explicit is not None:
        kinds = ", ".join(sorted({type(variable).__name__ for variable in explicit.values()}))
        raise UnsuitableProblem(
            f"{name} has named variables ({kinds}); the solvers here move continuous vectors: "
            "give n_var, xl and xu instead of vars, or use an algorithm of pymoo for mixed variables"
        )
    if (
        isinstance(problem.n_var, bool)
        or not isinstance(problem.n_var, int | np.integer)
        or problem.n_var < 1
    ):
        raise InvalidInput("n_var", problem.n_var, "give the number of variables, at least 1")
    if problem.vtype is not None and not _continuous(problem.vtype):
        kind = getattr(problem.vtype, "__name__", str(problem.vtype))
        raise UnsuitableProblem(
            f"{name} has variables of type {kind}; the solvers here move continuous variables: "
            "round inside the objective, or use an algorithm of pymoo with suitable operators"
        )


def _continuous(vtype: Any) -> bool:
    try:
        return np.issubdtype(np.dtype(vtype), np.floating)
    except TypeError:
        return False


def _check_bounds(problem: Problem) -> None:
    limits = []
    for bound, side in (("xl", "lower"), ("xu", "upper")):
        value = getattr(problem, bound)
        if value is None:
            raise InvalidInput(bound, "None", f"give finite {side} bounds: where to search cannot be guessed")
        try:
            limits.append(np.asarray(value, dtype=float))
        except (TypeError, ValueError):
            raise InvalidInput(bound, value, f"give finite {side} bounds, one for each variable") from None
        if limits[-1].shape != (problem.n_var,):
            raise InvalidInput(
                bound,
                f"shape {limits[-1].shape}",
                f"give {problem.n_var} {side} bounds, one for each variable",
            )
        _refuse(bound, ~np.isfinite(limits[-1]), "give finite bounds", limits[-1])
    lower, upper = limits
    pairs = np.stack([lower, upper], axis=1)
    _refuse("bounds", lower > upper, "lower and upper are swapped: give xl < xu", pairs)
    _refuse("bounds", lower == upper, "the box has no width here: leave out what cannot vary", pairs)


def _refuse(argument: str, wrong: np.ndarray, remedy: str, values: np.ndarray) -> None:
    if wrong.any():
        where = np.flatnonzero(wrong)
        shown = ", ".join(f"x{k} = {values[k].tolist()}" for k in where[:SHOWN])
        more = f" and {len(where) - SHOWN} more" if len(where) > SHOWN else ""
        raise InvalidInput(argument, shown + more, remedy)
