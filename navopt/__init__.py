"""navopt: swarm algorithms of navigation papers and their deterministic rivals behind one problem API.

The names below are loaded on first use, so that ``import navopt`` is quick and pulls in no numba,
plotting or solver library.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from navopt import algorithms, data, errors, models, problems
    from navopt.evaluation import Counts
    from navopt.problem import EstimationProblem, Parameter
    from navopt.registry import (
        ProblemInfo,
        SolverInfo,
        list_problems,
        list_solvers,
        make_solver,
        problem_info,
        simulate,
        solver_info,
    )
    from navopt.solution import Solution
    from navopt.solving import Progress, solve

__version__ = "0.1.0"

_HOMES = {
    "Counts": "navopt.evaluation",
    "EstimationProblem": "navopt.problem",
    "Parameter": "navopt.problem",
    "ProblemInfo": "navopt.registry",
    "SolverInfo": "navopt.registry",
    "list_problems": "navopt.registry",
    "list_solvers": "navopt.registry",
    "make_solver": "navopt.registry",
    "problem_info": "navopt.registry",
    "simulate": "navopt.registry",
    "solver_info": "navopt.registry",
    "Solution": "navopt.solution",
    "Progress": "navopt.solving",
    "solve": "navopt.solving",
}
_MODULES = ("algorithms", "data", "errors", "models", "problems")

__all__ = [
    "Counts",
    "EstimationProblem",
    "Parameter",
    "ProblemInfo",
    "Progress",
    "Solution",
    "SolverInfo",
    "algorithms",
    "data",
    "errors",
    "list_problems",
    "list_solvers",
    "make_solver",
    "models",
    "problem_info",
    "problems",
    "simulate",
    "solve",
    "solver_info",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(importlib.import_module(_HOMES[name]), name)
        globals()[name] = value
        return value
    if name in _MODULES:
        return importlib.import_module(f"navopt.{name}")
    raise AttributeError(f"module 'navopt' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
