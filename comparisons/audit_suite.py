"""The functions of an audit and the places where it puts their minima.

Pairs of places are mirror images wherever a bias to one *side* is asked for: the high corner is the low
corner reflected in the centre of the box, landscape and all, and so is the positive orthant of the
negative one. A search that treats both sides alike then has the same distribution of results on both, and
what differs is the search. (Moving the minimum alone would also move which part of a curved valley lies
in the box.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.problem import EstimationProblem, stream
from navopt.problems.analytic import Sphere
from navopt.problems.analytic_base import AnalyticFunction, ScalableFunction
from navopt.problems.wrapper_base import Wrapper
from navopt.problems.wrappers import Rotated, Shifted
from navopt.registry import problem, problem_class

__all__ = ["BIASES", "FAMILIES", "FUNCTIONS", "AuditFunction", "Bias", "Case", "cases"]

#: Functions of an audit: those of any number of variables first, then those of a fixed one.
FUNCTIONS = (
    *("sphere", "rosenbrock", "rastrigin", "ackley", "griewank"),
    *("zettl", "test-tube-holder", "helical-valley", "wood"),
)
#: What the minimum's place is called, in the order of the report.
FAMILIES = {
    "plain": "as published",
    "origin": "minimum moved to the zero vector (where it is not there already)",
    "shifted": "minimum moved by 10 % to 40 % of every axis of the box, either sign",
    "rotated": "shifted by the same vector and turned about the minimum",
    "positive": "minimum in the positive orthant, the mirror image of the next",
    "negative": "minimum outside the positive orthant, at 20 % to 80 % of the way to every lower limit",
    "low": "minimum at 0.1 of every axis of the box",
    "high": "minimum at 0.9 of every axis of the box, the mirror image of the last",
}
#: Place of the minimum along every axis in the family "low"; "high" is its reflection.
CORNER = 0.1
#: Part of the way from zero to the lower limits in the family "negative".
OUTSIDE = (0.2, 0.8)
#: Boxes that differ from the customary ones. The test tube holder is lower than its minimum further than
#: 25 from the origin, where a shift within its own box would lead.
BOXES = {"test-tube-holder": (-8.0, 8.0)}


@dataclass(frozen=True)
class Bias:
    """Two families whose gaps are compared, seed by seed.

    Attributes
    ----------
    name : str
        What it is called.
    favoured, other : str
        Families; a positive log ratio means that the gap in `other` is the larger one.
    sides : tuple of str
        What a positive ratio favours, and what a negative one does; one only if the other has no meaning.
    fault : bool
        Whether it is a bias; otherwise it is shown and judged in the same way, and is no fault.
    """

    name: str
    favoured: str
    other: str
    sides: tuple[str, ...]
    fault: bool = True


#: What an audit measures.
BIASES = {
    bias.name: bias
    for bias in (
        Bias("origin", "origin", "shifted", ("the origin",)),
        Bias("corner", "low", "high", ("the lower corner", "the upper corner")),
        Bias("orthant", "positive", "negative", ("the positive orthant", "the negative orthant")),
        Bias("rotation", "shifted", "rotated", ("the axes",), fault=False),
    )
}


@dataclass(frozen=True)
class Case:
    """A function at one number of variables, what a verdict counts.

    Attributes
    ----------
    function : str
        Registered name.
    dimension : int
        Number of variables.
    """

    function: str
    dimension: int

    @property
    def label(self) -> str:
        """Name and number of variables, for tables and axes."""
        return f"{self.function} {self.dimension}"

    @property
    def fixed(self) -> bool:
        """Whether the function has this number of variables and no other."""
        return not _scalable(self.function)

    def scenario(self, family: str) -> dict[str, Any]:
        """Keywords of `AuditFunction.simulate` for one family."""
        return {"function": self.function, "n_var": self.dimension, "family": family}

    def family(self, family: str) -> str:
        """Family whose runs serve for `family`: "plain" for "origin" if the minimum is there anyway."""
        at_origin = family == "origin" and not _base(self.function, self.dimension).true_x.any()  # type: ignore[union-attr]
        return "plain" if at_origin else family


def cases(dimensions: Sequence[int], functions: Sequence[str] = FUNCTIONS) -> tuple[Case, ...]:
    """Every function at every dimension that it has.

    Parameters
    ----------
    dimensions : sequence of int
        Numbers of variables of those that take any; the others take part at their own.
    functions : sequence of str
        Names among `FUNCTIONS`.

    Raises
    ------
    UnknownName
        If a function is not among them.
    InvalidInput
        If a dimension is not a whole number from 2 on, or there is none.
    """
    for name in functions:
        if name not in FUNCTIONS:
            raise UnknownName("functions", name, FUNCTIONS)
    for n in dimensions:
        if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 2:
            raise InvalidInput("dimensions", n, "give whole numbers from 2 on")
    for argument, values in (("functions", functions), ("dimensions", dimensions)):
        if not values or len(set(values)) != len(values):
            raise InvalidInput(argument, list(values), "give at least one, and each once only")
    own = {name: None if _scalable(name) else _base(name, None).n_var for name in functions}
    scaled = [Case(name, int(n)) for n in dimensions for name in functions if own[name] is None]
    fixed = [Case(name, n) for name, n in own.items() if n is not None]
    # the fixed ones have few variables: they follow those of two
    return tuple(sorted(scaled + fixed, key=lambda case: case.dimension if case.dimension > 4 else 0))


def _scalable(function: str) -> bool:
    cls = problem_class(function)
    return cls is Sphere or issubclass(cls, ScalableFunction)


def _base(function: str, n_var: int | None) -> AnalyticFunction:
    cls: Any = problem_class(function)
    if cls is Sphere:
        return Sphere(np.zeros(2 if n_var is None else n_var))
    box = dict(zip(("lower", "upper"), BOXES.get(function, (None, None)), strict=True))
    base: AnalyticFunction = cls(**box) if n_var is None or not _scalable(function) else cls(n_var, **box)
    if n_var is not None and base.n_var != n_var:
        raise InvalidInput("n_var", n_var, f"{function} has {base.n_var} variables")
    return base


@problem(
    "audit-function",
    summary="an analytic test function with its minimum where an audit puts it",
    example={"function": "ackley", "n_var": 3, "family": "high"},
)
class AuditFunction(Wrapper):
    """An analytic test function with its minimum at a place that a biased search favours, or does not.

    Parameters
    ----------
    problem : EstimationProblem
        The function in its place; it is passed through unchanged.
    family : str
        Which place that is, a key of `FAMILIES`.

    Attributes
    ----------
    family : str
        As given.
    """

    def __init__(self, problem: EstimationProblem, family: str) -> None:
        super().__init__(problem)
        self.family = family

    @classmethod
    def simulate(  # type: ignore[override]
        cls, seed: int = 0, *, function: str = "sphere", n_var: int | None = None, family: str = "plain"
    ) -> AuditFunction:
        """Put the minimum of a function in its place.

        Parameters
        ----------
        seed : int
            Seed of random places and rotations; "plain", "origin", "low" and "high" have none.
        function : str
            Name among `FUNCTIONS`.
        n_var : int, optional
            Number of variables; 2, or the function's own, if not given.
        family : str
            Name among `FAMILIES`.

        Returns
        -------
        AuditFunction
            The box is the same in every family.
        """
        for argument, value, known in (("function", function, FUNCTIONS), ("family", family, FAMILIES)):
            if value not in known:
                raise UnknownName(argument, value, known)
        return cls(_placed(_base(function, n_var), function, family, seed), family)

    def over(self, problem: EstimationProblem) -> AuditFunction:
        """Return the same family over another function already in its place."""
        return AuditFunction(problem, self.family)


def _placed(base: AnalyticFunction, function: str, family: str, seed: int) -> EstimationProblem:
    minimizer: Any = base.true_x
    if family == "origin":
        return Shifted(base, -minimizer)
    if family == "shifted":
        return Shifted.draw(base, seed)
    if family == "rotated":
        return Shifted(Rotated.draw(base, seed), Shifted.draw(base, seed).shift)
    if family in ("positive", "negative"):
        # the boxes reach at least as far above zero as below, so the reflection has no negative coordinate
        part = stream(f"wrapper:audit:{function}", seed).uniform(*OUTSIDE, base.n_var)
        world = Shifted(base, part * base.xl - minimizer)
        return _reflected(world) if family == "positive" else world
    if family in ("low", "high"):
        world = Shifted.to_fraction(base, CORNER)
        return _reflected(world) if family == "high" else world
    return base


def _reflected(world: EstimationProblem) -> EstimationProblem:
    """Mirror image in the centre of the box."""
    return Rotated(world, -np.eye(world.n_var), centre=(world.xl + world.xu) / 2.0)
