"""A problem of some of the parameters, the others being held: what a phase of a search sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.problem import EstimationProblem
from navopt.problems.wrapper_base import Wrapper

__all__ = ["Restricted"]


class Restricted(Wrapper):
    """Another problem with all but some of its parameters held at given values.

    The loss at x is the inner loss at the vector that has x in the free places and the held values in the
    others, bit for bit. Estimates, truth and scores are the inner problem's, at that vector.

    Parameters
    ----------
    problem : EstimationProblem
        The inner problem.
    names : sequence of str
        Names of the free parameters; they keep the order they have in the inner problem.
    fixed : mapping of str to float, or array_like, shape (inner n_var,), optional
        Where the others are held: by name, the nominal values for those not named; or a whole decision
        vector of the inner problem, whose free entries become the nominal values of this one. The nominal
        values if not given.

    Attributes
    ----------
    free : ndarray of int, shape (n_var,)
        Places of the free parameters in the inner decision vector.
    base : ndarray, shape (inner n_var,)
        Inner decision vector at the nominal values.
    parameter_groups : dict of str to tuple of str
        The inner problem's, without the held parameters; only where it has some.

    Raises
    ------
    InvalidInput
        If no name is given, one twice, or a held value is not finite or belongs to a free parameter.
    UnknownName
        If a name is none of the inner problem's parameters.

    Notes
    -----
    `prior` is the inner prior given the held values, the conditional normal distribution, so that half the
    squared residuals plus the prior's term differ from the inner problem's by a constant only. `true_x` and
    the minimisers are known only where the held values agree with the inner problem's: with another
    parameter held at a wrong value, no vector of the free ones made the data.
    """

    def __init__(self, problem: EstimationProblem, names: Sequence[str], fixed: Any = None) -> None:
        known = list(problem.parameter_names)
        wanted = [names] if isinstance(names, str) else list(names)
        if not wanted or len(set(wanted)) < len(wanted):
            raise InvalidInput("names", names, "give at least one parameter, and each once")
        for name in wanted:
            if name not in known:
                raise UnknownName("names", str(name), known)
        places = [k for k, name in enumerate(known) if name in wanted]
        base = _held(problem, fixed, wanted)
        self.free = np.array(places)
        self.base = base
        for array in (self.free, self.base):
            array.setflags(write=False)
        self._selection = np.eye(problem.n_var)[:, places]
        self._selection.setflags(write=False)
        parameters = [replace(problem.parameters[k], nominal=float(base[k])) for k in places]
        super().__init__(problem, parameters)
        # a triad of which some parameters are held is still one; a similarity without a shift is none
        self.provides |= problem.provides & {"triad"}  # type: ignore[misc]
        minimizers = getattr(problem, "minimizers", None)
        agreeing = [] if minimizers is None else [y for y in minimizers if self._agrees(y)]
        self.minimizers = self._carried(np.array(agreeing)) if agreeing else None
        if not agreeing:
            self.minimum = None
        groups = getattr(problem, "parameter_groups", None)
        if groups:
            kept = {label: tuple(n for n in members if n in wanted) for label, members in groups.items()}
            self.parameter_groups = {label: members for label, members in kept.items() if members}

    def _agrees(self, y: np.ndarray) -> bool:
        held = np.setdiff1d(np.arange(len(self.base)), self.free)
        return bool((np.asarray(y)[held] == self.base[held]).all())

    def _carry_truth(self) -> None:
        # unlike a change of variables, a restriction can lose the truth: then it is not known, no error
        true_x = self.problem.true_x
        if true_x is not None and self._agrees(true_x):
            self.true_x = np.array(true_x[self.free])
            self.true_x.setflags(write=False)

    def inward(self, X: np.ndarray) -> np.ndarray:
        """Decision vectors of the inner problem for those of this one, shape (..., inner n_var)."""
        X = np.asarray(X, dtype=float)
        full = np.empty((*X.shape[:-1], len(self.base)))
        full[...] = self.base
        full[..., self.free] = X
        return full

    def outward(self, Y: np.ndarray) -> np.ndarray:
        """Free entries of inner decision vectors, shape (..., n_var)."""
        return np.asarray(Y, dtype=float)[..., self.free]

    def slope(self) -> np.ndarray:
        """Derivative of `inward`, shape (inner n_var, n_var): columns of the unit matrix."""
        return self._selection

    def prior(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Mean and covariance of the free parameters given the held ones, or None."""
        known = self.problem.prior()
        if known is None:
            return None
        mean, covariance = known
        held = np.setdiff1d(np.arange(len(mean)), self.free)
        if not len(held):
            return mean[self.free], covariance[np.ix_(self.free, self.free)]
        across = covariance[np.ix_(self.free, held)]
        gain = np.linalg.solve(covariance[np.ix_(held, held)], across.T).T
        spread = covariance[np.ix_(self.free, self.free)] - gain @ across.T
        return mean[self.free] + gain @ (self.base[held] - mean[held]), (spread + spread.T) / 2.0

    def describe_direction(self, coefficients: dict[str, float]) -> str:
        """Say what the inner problem says of a combination of parameters."""
        return self.problem.describe_direction(coefficients)

    def over(self, problem: EstimationProblem) -> Restricted:
        """Return the same restriction of another inner problem."""
        return Restricted(problem, self.parameter_names, self.base)


def _held(problem: EstimationProblem, fixed: Any, free: list[str]) -> np.ndarray:
    """Inner decision vector that holds the fixed values, nominal ones elsewhere."""
    base = np.array(problem.nominal)
    if isinstance(fixed, Mapping):
        known = list(problem.parameter_names)
        for name, value in fixed.items():
            if name not in known:
                raise UnknownName("fixed", str(name), known)
            if name in free:
                raise InvalidInput("fixed", name, "a parameter is either free or fixed: leave out one")
            base[known.index(name)] = value
    elif fixed is not None:
        base = np.array(fixed, dtype=float)
        if base.shape != (problem.n_var,):
            raise InvalidInput(
                "fixed", base.shape, f"give values by name, or a vector of all {problem.n_var}"
            )
    if not np.isfinite(base).all():
        raise InvalidInput("fixed", base.tolist(), "give finite values")
    return base
