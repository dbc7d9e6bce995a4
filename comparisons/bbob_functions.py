"""The 24 noiseless BBOB functions as a problem, from the package ``ioh`` (extra ``bench``)."""

from __future__ import annotations

import functools
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, MissingExtra, UnknownName
from navopt.problem import EstimationProblem, Parameter
from navopt.problems.analytic_base import Point
from navopt.registry import problem

__all__ = ["FUNCTIONS", "GROUPS", "BbobFunction"]

#: Numbers of the functions, the words of the suite's own documentation.
FUNCTIONS = {
    1: "sphere",
    2: "separable ellipsoid",
    3: "separable Rastrigin",
    4: "Büche-Rastrigin",
    5: "linear slope",
    6: "attractive sector",
    7: "step ellipsoid",
    8: "Rosenbrock",
    9: "rotated Rosenbrock",
    10: "ellipsoid",
    11: "discus",
    12: "bent cigar",
    13: "sharp ridge",
    14: "sum of different powers",
    15: "Rastrigin",
    16: "Weierstrass",
    17: "Schaffer F7",
    18: "Schaffer F7, ill-conditioned",
    19: "Griewank-Rosenbrock F8F2",
    20: "Schwefel",
    21: "Gallagher's 101 peaks",
    22: "Gallagher's 21 peaks",
    23: "Katsuura",
    24: "Lunacek bi-Rastrigin",
}
#: The suite's five groups, in its order.
GROUPS = {
    "separable": range(1, 6),
    "moderate conditioning": range(6, 10),
    "high conditioning, unimodal": range(10, 15),
    "multimodal, adequate structure": range(15, 20),
    "multimodal, weak structure": range(20, 25),
}
#: Where the suite's functions are searched, in every coordinate.
BOX = (-5.0, 5.0)
#: What needs the extra, for the message without it.
PURPOSE = "the BBOB functions (package ioh: wheels for Python 3.11 and 3.12)"


@functools.lru_cache(maxsize=512)
def _function(function: int, instance: int, n_var: int) -> Any:
    """One function object of ioh; kept outside the problem, because it cannot be pickled."""
    try:
        import ioh
    except ImportError:
        raise MissingExtra("bench", PURPOSE) from None
    return ioh.get_problem(function, instance=instance, dimension=n_var, problem_class=ioh.ProblemClass.BBOB)


@problem(
    "bbob",
    summary="the 24 noiseless BBOB functions, a world being an instance (extra bench)",
    example={"function": 8, "n_var": 3},
)
class BbobFunction(EstimationProblem):
    """One instance of a BBOB function: transformed at random, its minimum known.

    Parameters
    ----------
    function : int
        Number, 1 to 24, see `FUNCTIONS`.
    n_var : int
        Number of variables, at least 2.
    instance : int
        Number of the instance, from 0 on; the suite's own are counted from 1.

    Attributes
    ----------
    function, instance : int
        As given.
    minimum : float
        The suite's f_opt, a random offset.
    true_x, truth
        The minimiser that the suite names. Functions 7, 16 and 23 have others as low, so that only the gap in
        the loss is scored.

    Raises
    ------
    InvalidInput
        If a number is none of these.
    UnknownName
        If there is no such function.
    MissingExtra
        If ``ioh`` is not installed.

    Notes
    -----
    The box is [-5, 5] in every coordinate and `nominal` its centre.

    References
    ----------
    N. Hansen, S. Finck, R. Ros, A. Auger, "Real-parameter black-box optimization benchmarking 2009: noiseless
    functions definitions", INRIA RR-6829; J. de Nobel et al., "IOHexperimenter", Evol. Comput. 32 (2024).
    """

    def __init__(self, function: int, n_var: int, instance: int) -> None:
        for argument, value, least in (("n_var", n_var, 2), ("instance", instance, 0)):
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
                raise InvalidInput(argument, value, f"give a whole number, at least {least}")
        if function not in FUNCTIONS:
            raise UnknownName("function", str(function), map(str, FUNCTIONS))
        super().__init__([Parameter(f"x{k}", "1", *BOX, sum(BOX) / 2.0) for k in range(n_var)])
        self.function, self.instance = int(function), int(instance)
        optimum = _function(self.function, self.instance, self.n_var).optimum
        self.minimum = float(optimum.y)
        self.true_x = np.array(optimum.x, dtype=float)
        self.true_x.setflags(write=False)
        self.truth = Point(self.true_x)

    @classmethod
    def simulate(  # type: ignore[override]
        cls, seed: int = 0, *, function: int = 1, n_var: int = 2
    ) -> BbobFunction:
        """Return an instance of a function; the seed is the number of the instance."""
        return cls(function, n_var, seed)

    @classmethod
    def data_checksum(cls, **scenario: Any) -> str:
        """Version of ``ioh``: another one may compute other functions.

        Raises
        ------
        MissingExtra
            If it is not installed.
        """
        try:
            return f"ioh {version('ioh')}"
        except PackageNotFoundError:
            raise MissingExtra("bench", PURPOSE) from None

    def _loss(self, X: np.ndarray) -> np.ndarray:
        # ioh computes row by row, so a candidate has the same loss in every batch
        return np.array(_function(self.function, self.instance, self.n_var)(X), dtype=float)

    def redraw(self, seed: int) -> BbobFunction:
        """Return the same problem: it has no noise to draw again."""
        return self

    def estimate(self, x: np.ndarray) -> Point:
        """Point that the decision vector is."""
        return Point(np.array(x, dtype=float))

    def project(self, estimate: Point) -> np.ndarray:
        """Nearest point of the box."""
        return self.clip(estimate.position)

    def _score(self, estimate: Point) -> dict[str, float]:
        return {"gap_1": float(self.loss(estimate.position)) - self.minimum}
