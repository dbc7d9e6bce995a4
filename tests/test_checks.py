"""Problems of pymoo that no solver here can take are refused, each with its own message."""

from __future__ import annotations

import numpy as np
import pytest
from pymoo.core.problem import ElementwiseProblem, Problem
from pymoo.core.variable import Choice, Integer, Real
from pymoo.problems import get_problem

import navopt
from navopt.checks import check_problem
from navopt.errors import InvalidInput, MissingData, NavoptError, UnsuitableProblem


class Plain(Problem):
    def __init__(self, **kwargs) -> None:
        super().__init__(**{"n_var": 3, "n_obj": 1, "xl": -1.0, "xu": [1.0, 2.0, 3.0], **kwargs})


@pytest.mark.parametrize(
    "problem",
    [
        Plain(),
        Plain(xl=np.array([-1, -2, -3]), xu=5),
        Plain(vtype=float),
        Plain(vtype=np.float64),
        ElementwiseProblem(n_var=1, n_obj=1, xl=0, xu=1),
        get_problem("ackley", n_var=4),
        get_problem("himmelblau"),
        navopt.simulate("sphere", 0),
    ],
    ids=lambda problem: type(problem).__name__,
)
def test_a_box_bounded_continuous_problem_passes(problem: Problem) -> None:
    assert check_problem(problem) is None


@pytest.mark.parametrize("name", navopt.list_problems())
def test_every_registered_problem_passes(name: str) -> None:
    try:
        problem = navopt.simulate(name, 0, **navopt.problem_info(name).example)
    except MissingData as absent:
        pytest.skip(str(absent))
    check_problem(problem)


CASES = {
    "several objectives": (get_problem("zdt1"), UnsuitableProblem, "ZDT1 has 2 objectives.*combine them"),
    "inequalities": (get_problem("g1"), UnsuitableProblem, r"G1 has 9 inequality and 0 equality.*\+inf"),
    "equalities": (get_problem("g3"), UnsuitableProblem, "G3 has 0 inequality and 1 equality constraints"),
    "old keyword": (Plain(n_constr=2), UnsuitableProblem, "Plain has 2 inequality"),
    "integers": (Plain(vtype=int), UnsuitableProblem, "Plain has variables of type int.*round inside"),
    "numpy integers": (Plain(vtype=np.int64), UnsuitableProblem, "variables of type int64"),
    "booleans": (Plain(vtype=bool), UnsuitableProblem, "variables of type bool"),
    "other variables": (Plain(vtype=Integer), UnsuitableProblem, "variables of type Integer"),
    "mixed variables": (
        Problem(
            vars={"a": Real(bounds=(0, 1)), "b": Integer(bounds=(0, 9)), "c": Choice(options=["u", "v"])}
        ),
        UnsuitableProblem,
        r"named variables \(Choice, Integer, Real\).*give n_var, xl and xu",
    ),
    "no bounds": (Plain(xl=None, xu=None), InvalidInput, "xl: got None; give finite lower bounds"),
    "no upper bound": (Plain(xu=None), InvalidInput, "xu: got None; give finite upper bounds"),
    "infinite": (Plain(xu=[1.0, np.inf, 1.0]), InvalidInput, "xu: got x1 = inf; give finite bounds"),
    "not a number": (Plain(xl=[np.nan, 0.0, 0.0]), InvalidInput, "xl: got x0 = nan; give finite bounds"),
    "equal": (Plain(xl=[0, 2, 0]), InvalidInput, r"bounds: got x1 = \[2.0, 2.0\]; .* leave out what cannot"),
    "swapped": (Plain(xl=[0, 0, 4]), InvalidInput, r"got x2 = \[4.0, 3.0\]; lower and upper are swapped"),
    "many": (
        Plain(n_var=6, xl=1.0, xu=0.0),
        InvalidInput,
        r"x0 = \[1.0, 0.0\], x1 = \[1.0, 0.0\], x2 = \[1.0, 0.0\] and 3 more; lower and upper are swapped",
    ),
    "no variables": (Plain(n_var=-1), InvalidInput, "n_var: got -1"),
    "another class": ("sphere", InvalidInput, "problem: got str; give a navopt.EstimationProblem"),
}


@pytest.mark.parametrize(("problem", "error", "message"), CASES.values(), ids=CASES)
def test_one_clear_message_for_each_fault(problem, error: type[NavoptError], message: str) -> None:
    with pytest.raises(error, match=message):
        check_problem(problem)


def test_wrong_number_of_bounds() -> None:
    problem = Plain()
    problem.xu = np.ones(2)
    with pytest.raises(InvalidInput, match=r"xu: got shape \(2,\); give 3 upper bounds"):
        check_problem(problem)
    problem.xu = ["a", "b", "c"]
    with pytest.raises(InvalidInput, match=r"xu: got .*; give finite upper bounds, one for each"):
        check_problem(problem)
