"""Analytic test problems with exact minima: those of paper 000, and three that everyone knows.

Sums and products run over the short axis of C-contiguous rows, and everything that is not rounded
correctly by definition (``cos``, ``exp``, ``arctan2``) is applied to contiguous arrays: numpy's loops
for strided ones may differ in the last bit, and the loss of a candidate must not depend on its batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.problem import EstimationProblem, stream
from navopt.problems.analytic_base import AnalyticFunction, ScalableFunction
from navopt.registry import problem

__all__ = [
    "Ackley",
    "Griewank",
    "HelicalValley",
    "Rastrigin",
    "Rosenbrock",
    "Sphere",
    "TestTubeHolder",
    "Wood",
    "Zettl",
]

TURN = 2.0 * np.pi


def _dimension(n_var: int, least: int = 1) -> int:
    if isinstance(n_var, bool) or not isinstance(n_var, int | np.integer) or n_var < least:
        raise InvalidInput("n_var", n_var, f"give a whole number of variables, at least {least}")
    return int(n_var)


@problem("sphere", summary="squared distance to a hidden point of the box", example={"n_var": 3})
class Sphere(AnalyticFunction):
    """Half the squared distance to a minimiser: the simplest problem with everything known.

    Parameters
    ----------
    minimizer : array_like, shape (n_var,)
        Where the loss is lowest; inside the box.
    lower, upper : array_like, shape (n_var,) or float
        The box; the start is its centre.
    offset : float, default 0.0
        Added to the loss, so that the minimum can be negative.
    """

    provides = frozenset({"residuals", "bound"})

    def __init__(self, minimizer: Any, *, lower: Any = -10.0, upper: Any = 10.0, offset: float = 0.0) -> None:
        centre = np.array(minimizer, dtype=float)
        if centre.ndim != 1:
            raise InvalidInput("minimizer", centre.shape, "give one coordinate per parameter")
        middle = np.broadcast_to(np.add(lower, upper) / 2.0, centre.shape)
        super().__init__(centre, offset, (-10.0, 10.0), lower=lower, upper=upper, start=middle)
        if self.true_x is None:
            raise InvalidInput("minimizer", centre.tolist(), "give a point inside the box")
        self.offset = float(offset)
        self.centre = self.true_x

    @classmethod
    def simulate(  # type: ignore[override]
        cls, seed: int = 0, *, n_var: int = 3, lower: float = -10.0, upper: float = 10.0, offset: float = 0.0
    ) -> Sphere:
        """Draw the minimiser uniformly in the box."""
        rng = stream("world:sphere", seed)
        return cls(rng.uniform(lower, upper, n_var), lower=lower, upper=upper, offset=offset)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return 0.5 * np.sum((X - self.centre) ** 2, axis=1) + self.offset

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        return X - self.centre

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        return np.broadcast_to(np.eye(self.n_var), (len(X), self.n_var, self.n_var)).copy()


@problem("ackley", summary="Ackley's function: a funnel under ripples, minimum 0", example={"n_var": 2})
class Ackley(ScalableFunction):
    """Ackley's function, ``-20 exp(-0.2 √(Σx²/n)) - exp(Σcos 2πx / n) + 20 + e``.

    The minimum 0 lies at the origin, where the formula rounds to 4.4e-16 in double precision; it is
    evaluated as everyone does, so that published values such as 7.11e-15 mean the same here.

    Parameters
    ----------
    n_var : int, default 2
        Number of variables; paper 000 gives none, its values fit two.
    lower, upper : array_like, shape (n_var,), or float, optional
        The box; [-32.768, 32.768] in every coordinate if not given.

    References
    ----------
    D. H. Ackley, *A Connectionist Machine for Genetic Hillclimbing*, Kluwer 1987.
    """

    def __init__(self, n_var: int = 2, *, lower: Any = None, upper: Any = None) -> None:
        super().__init__(np.zeros(_dimension(n_var)), 0.0, (-32.768, 32.768), lower=lower, upper=upper)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        radius = np.sqrt(np.sum(X**2, axis=1) / self.n_var)
        ripple = np.sum(np.cos(TURN * X), axis=1) / self.n_var
        return -20.0 * np.exp(-0.2 * radius) - np.exp(ripple) + 20.0 + np.e


@problem("griewank", summary="Griewank's function: a bowl under a product of ripples", example={"n_var": 2})
class Griewank(ScalableFunction):
    """Griewank's function, ``1 + Σ x²/4000 - Π cos(x_i/√i)``; minimum 0 at the origin.

    Parameters
    ----------
    n_var : int, default 2
        Number of variables; paper 000 gives none, its values fit two.
    lower, upper : array_like, shape (n_var,), or float, optional
        The box; [-600, 600] in every coordinate if not given.

    References
    ----------
    A. O. Griewank, "Generalized descent for global optimization", J. Optim. Theory Appl. 34, 1981.
    """

    def __init__(self, n_var: int = 2, *, lower: Any = None, upper: Any = None) -> None:
        super().__init__(np.zeros(_dimension(n_var)), 0.0, (-600.0, 600.0), lower=lower, upper=upper)
        self._roots = np.sqrt(np.arange(1.0, self.n_var + 1.0))

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return 1.0 + np.sum(X**2, axis=1) / 4000.0 - np.prod(np.cos(X / self._roots), axis=1)


@problem("rastrigin", summary="Rastrigin's function: a bowl under even ripples", example={"n_var": 2})
class Rastrigin(ScalableFunction):
    """Rastrigin's function, ``10 n + Σ (x² - 10 cos 2πx)``; minimum 0 at the origin.

    Parameters
    ----------
    n_var : int, default 2
        Number of variables.
    lower, upper : array_like, shape (n_var,), or float, optional
        The box; [-5.12, 5.12] in every coordinate if not given.

    References
    ----------
    H. Mühlenbein, M. Schomisch, J. Born, "The parallel genetic algorithm as function optimizer",
    Parallel Computing 17, 1991, for any number of variables.
    """

    def __init__(self, n_var: int = 2, *, lower: Any = None, upper: Any = None) -> None:
        super().__init__(np.zeros(_dimension(n_var)), 0.0, (-5.12, 5.12), lower=lower, upper=upper)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return 10.0 * self.n_var + np.sum(X**2 - 10.0 * np.cos(TURN * X), axis=1)


@problem("rosenbrock", summary="Rosenbrock's curved valley, minimum 0 at (1, …, 1)", example={"n_var": 2})
class Rosenbrock(ScalableFunction):
    """Rosenbrock's valley as a chain, ``Σ 100 (x_{i+1} - x_i²)² + (1 - x_i)²``; minimum 0 at (1, …, 1).

    Parameters
    ----------
    n_var : int, default 2
        Number of variables, at least 2; from 4 on there is a local minimum near (-1, 1, …, 1).
    lower, upper : array_like, shape (n_var,), or float, optional
        The box; [-5, 10] in every coordinate if not given.

    Notes
    -----
    The start is (-1.2, 1, -1.2, 1, …). Residuals hold the factor √2 that makes the loss ½‖r‖².

    References
    ----------
    H. H. Rosenbrock, "An automatic method for finding the greatest or least value of a function",
    Comput. J. 3, 1960.
    """

    provides = frozenset({"residuals"})

    def __init__(self, n_var: int = 2, *, lower: Any = None, upper: Any = None) -> None:
        n = _dimension(n_var, least=2)
        start = np.where(np.arange(n) % 2 == 0, -1.2, 1.0)
        super().__init__(np.ones(n), 0.0, (-5.0, 10.0), lower=lower, upper=upper, start=start)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        here, following = X[:, :-1], X[:, 1:]
        return np.sum(100.0 * (following - here**2) ** 2 + (1.0 - here) ** 2, axis=1)

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        here, following = X[:, :-1], X[:, 1:]
        return np.sqrt(2.0) * np.concatenate([10.0 * (following - here**2), 1.0 - here], axis=1)

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        out = np.zeros((len(X), 2 * (self.n_var - 1), self.n_var))
        k = np.arange(self.n_var - 1)
        out[:, k, k] = -20.0 * X[:, :-1]
        out[:, k, k + 1] = 10.0
        out[:, k + self.n_var - 1, k] = -1.0
        return np.sqrt(2.0) * out


@problem("zettl", summary="Zettl's function of two variables, minimum -0.0037912")
class Zettl(AnalyticFunction):
    """Zettl's function, ``(x₁² + x₂² - 2 x₁)² + x₁/4``; minimum -0.00379123722 at (-0.029895985, 0).

    The minimiser has a negative coordinate, so no fruit fly that proposes 1/distance gets below 0.

    Parameters
    ----------
    lower, upper : array_like, shape (2,), or float, optional
        The box; [-5, 10] in both coordinates if not given.

    References
    ----------
    M. Jamil, X.-S. Yang, "A literature survey of benchmark functions for global optimisation
    problems", Int. J. Math. Model. Numer. Optim. 4, 2013, function 170 (with 0.0299 for -0.0299).
    """

    def __init__(self, *, lower: Any = None, upper: Any = None) -> None:
        # the root of 4x³ - 12x² + 8x + 1/4 next to the origin
        minimizer, minimum = (-0.029895985050660383, 0.0), -0.003791237220468899
        super().__init__(minimizer, minimum, (-5.0, 10.0), lower=lower, upper=upper)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        x, y = X[:, 0], X[:, 1]
        return (x * x + y * y - 2.0 * x) ** 2 + 0.25 * x


@problem("test-tube-holder", summary="test tube holder of two variables, minimum -10.8723")
class TestTubeHolder(AnalyticFunction):
    """Test tube holder, ``-4 |sin x₁ cos x₂ exp|cos((x₁² + x₂²)/200)||``; minimum -10.8723001056.

    Parameters
    ----------
    form : {"absolute", "signed"}
        With the outer absolute value (Mishra), with two minimisers (±1.5706026, 0); or without it
        (Jamil and Yang), where only the positive one remains and the other is a maximum.
    lower, upper : array_like, shape (2,), or float, optional
        The box; [-10, 10] in both coordinates if not given.

    Notes
    -----
    The often quoted -10.872299901558 is the value at (π/2, 0), not the minimum. Further than 25 from
    the origin the function comes nearer to its infimum -4e, so a box that reaches beyond has no truth.

    References
    ----------
    S. K. Mishra, "Some new test functions for global optimization", MPRA paper 2718, 2006; M. Jamil,
    X.-S. Yang, Int. J. Math. Model. Numer. Optim. 4, 2013.
    """

    proven_radius = 25.0
    __test__ = False  # the name begins as a test class of pytest does

    def __init__(self, form: str = "absolute", *, lower: Any = None, upper: Any = None) -> None:
        if form not in ("absolute", "signed"):
            raise UnknownName("form", form, ("absolute", "signed"))
        self.form = form
        # the root of cos x = x sin x sin(x²/200)/100 next to π/2
        minimizers = [[1.5706026141658022, 0.0], [-1.5706026141658022, 0.0]][: 2 if form == "absolute" else 1]
        super().__init__(minimizers, -10.872300105622745, (-10.0, 10.0), lower=lower, upper=upper)

    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        form: str = "absolute",
        lower: Any = None,
        upper: Any = None,
        shift: bool | Sequence[float] = False,
        rotate: bool = False,
        noise: float = 0.0,
    ) -> EstimationProblem:
        """Return the function in one of its forms; the rest as for `AnalyticFunction.simulate`."""
        return cls._disguised(seed, shift, rotate, noise, form=form, lower=lower, upper=upper)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        x, y = np.ascontiguousarray(X.T)
        value = np.sin(x) * np.cos(y) * np.exp(np.abs(np.cos((x * x + y * y) / 200.0)))
        return -4.0 * (np.abs(value) if self.form == "absolute" else value)


@problem("helical-valley", summary="Fletcher and Powell's helical valley, minimum 0 at (1, 0, 0)")
class HelicalValley(AnalyticFunction):
    """Helical valley, ``100 [(x₃ - 10 θ)² + (√(x₁² + x₂²) - 1)²] + x₃²``; minimum 0 at (1, 0, 0).

    θ is ``arctan(x₂/x₁) / 2π``, plus ½ for x₁ < 0: in [-¼, ¾), the branch of the source, which jumps
    where x₁ = 0 and x₂ < 0. With ``arctan2`` the loss differs where both coordinates are negative.

    Parameters
    ----------
    lower, upper : array_like, shape (3,), or float, optional
        The box; [-10, 10] in every coordinate if not given.

    Notes
    -----
    The start is (-1, 0, 0). Residuals hold the factor √2 that makes the loss ½‖r‖². On the axis
    x₁ = x₂ = 0, where θ means nothing, it is 0, and the Jacobian holds zeros for its derivatives.

    References
    ----------
    R. Fletcher, M. J. D. Powell, "A rapidly convergent descent method for minimization", Comput. J. 6,
    1963.
    """

    provides = frozenset({"residuals"})

    def __init__(self, *, lower: Any = None, upper: Any = None) -> None:
        start = (-1.0, 0.0, 0.0)
        super().__init__((1.0, 0.0, 0.0), 0.0, (-10.0, 10.0), lower=lower, upper=upper, start=start)

    @staticmethod
    def _terms(X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # adding zero turns -0 into +0, which arctan2 would tell apart
        x, y, z = np.ascontiguousarray(X.T) + 0.0
        angle = np.arctan2(y, x) / TURN
        angle = np.where((x < 0.0) & (angle < 0.0), angle + 1.0, angle)
        return 10.0 * (z - 10.0 * angle), 10.0 * (np.sqrt(x * x + y * y) - 1.0), z

    def _loss(self, X: np.ndarray) -> np.ndarray:
        height, radius, z = self._terms(X)
        return height**2 + radius**2 + z**2

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        return np.sqrt(2.0) * np.stack(self._terms(X), axis=1)

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        x, y = X[:, 0], X[:, 1]
        square = x * x + y * y
        # on the axis the numerators below are zero, whatever stands under them
        square = np.where(square > 0.0, square, 1.0)
        radius = np.sqrt(square)
        out = np.zeros((len(X), 3, 3))
        out[:, 0, 0] = (100.0 / TURN) * y / square
        out[:, 0, 1] = -(100.0 / TURN) * x / square
        out[:, 0, 2] = 10.0
        out[:, 1, 0] = 10.0 * x / radius
        out[:, 1, 1] = 10.0 * y / radius
        out[:, 2, 2] = 1.0
        return np.sqrt(2.0) * out


@problem("wood", summary="Wood's (Colville's) function of four variables, minimum 0 at (1, 1, 1, 1)")
class Wood(AnalyticFunction):
    """Wood's function, also Colville's; minimum 0 at (1, 1, 1, 1).

    ``100 (x₁² - x₂)² + (x₁ - 1)² + (x₃ - 1)² + 90 (x₃² - x₄)² + 10.1 [(x₂ - 1)² + (x₄ - 1)²]
    + 19.8 (x₂ - 1)(x₄ - 1)``.

    Parameters
    ----------
    lower, upper : array_like, shape (4,), or float, optional
        The box; [-10, 10] in every coordinate if not given.

    Notes
    -----
    The start is (-3, -1, -3, -1). The six residuals are those of Moré, Garbow and Hillstrom (ACM Trans.
    Math. Softw. 7, 1981, problem 14) times the √2 that makes the loss ½‖r‖².

    References
    ----------
    A. R. Colville, IBM New York Scientific Center report 320-2949, 1968.
    """

    provides = frozenset({"residuals"})

    def __init__(self, *, lower: Any = None, upper: Any = None) -> None:
        start = (-3.0, -1.0, -3.0, -1.0)
        super().__init__(np.ones(4), 0.0, (-10.0, 10.0), lower=lower, upper=upper, start=start)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        a, b, c, d = X.T
        valleys = 100.0 * (a * a - b) ** 2 + (a - 1.0) ** 2 + (c - 1.0) ** 2 + 90.0 * (c * c - d) ** 2
        return valleys + 10.1 * ((b - 1.0) ** 2 + (d - 1.0) ** 2) + 19.8 * (b - 1.0) * (d - 1.0)

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        a, b, c, d = X.T
        rows = [10.0 * (b - a * a), 1.0 - a, np.sqrt(90.0) * (d - c * c), 1.0 - c]
        rows += [np.sqrt(10.0) * (b + d - 2.0), (b - d) / np.sqrt(10.0)]
        return np.sqrt(2.0) * np.stack(rows, axis=1)

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        out = np.zeros((len(X), 6, 4))
        out[:, 0, 0], out[:, 0, 1] = -20.0 * X[:, 0], 10.0
        out[:, 1, 0] = out[:, 3, 2] = -1.0
        out[:, 2, 2], out[:, 2, 3] = -2.0 * np.sqrt(90.0) * X[:, 2], np.sqrt(90.0)
        out[:, 4, 1] = out[:, 4, 3] = np.sqrt(10.0)
        out[:, 5, 1], out[:, 5, 3] = 1.0 / np.sqrt(10.0), -1.0 / np.sqrt(10.0)
        return np.sqrt(2.0) * out
