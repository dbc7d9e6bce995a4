"""navopt: swarm algorithms of navigation papers and their deterministic rivals behind one problem API.

The names below are loaded on first use, so that ``import navopt`` is quick and pulls in no numba,
plotting or solver library.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt import algorithms as algorithms
    from navopt import data as data
    from navopt import errors as errors
    from navopt import filters as filters
    from navopt import models as models
    from navopt import problems as problems
    from navopt.evaluation import Counts as Counts
    from navopt.problem import EstimationProblem as EstimationProblem
    from navopt.problem import Parameter as Parameter
    from navopt.registry import ProblemInfo as ProblemInfo
    from navopt.registry import SolverInfo as SolverInfo
    from navopt.registry import list_problems as list_problems
    from navopt.registry import list_solvers as list_solvers
    from navopt.registry import make_solver as make_solver
    from navopt.registry import problem_info as problem_info
    from navopt.registry import simulate as simulate
    from navopt.registry import solver_info as solver_info
    from navopt.solution import Solution as Solution
    from navopt.solving import Progress as Progress
    from navopt.solving import solve as solve

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "Counts": "navopt.evaluation",
        "EstimationProblem": "navopt.problem",
        "Parameter": "navopt.problem",
        "ProblemInfo": "navopt.registry",
        "Progress": "navopt.solving",
        "Solution": "navopt.solution",
        "SolverInfo": "navopt.registry",
        "algorithms": "navopt.algorithms",
        "data": "navopt.data",
        "errors": "navopt.errors",
        "filters": "navopt.filters",
        "list_problems": "navopt.registry",
        "list_solvers": "navopt.registry",
        "make_solver": "navopt.registry",
        "models": "navopt.models",
        "problem_info": "navopt.registry",
        "problems": "navopt.problems",
        "simulate": "navopt.registry",
        "solve": "navopt.solving",
        "solver_info": "navopt.registry",
    },
)
