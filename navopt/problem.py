"""What an estimation problem is: parameters in a box, a loss, and what can be said about the truth."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, is_dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from pymoo.core.problem import Problem

from navopt.errors import InvalidInput, NoBound, NoTruth, NumericalFault, UnsuitableProblem

if TYPE_CHECKING:
    from navopt.identifiability import Identifiability

__all__ = ["EstimationProblem", "Parameter", "stream"]


def stream(label: str, *seeds: int) -> np.random.Generator:
    """Random generator of one purpose, apart from every other purpose and from the solvers' own.

    With one stream for worlds and solvers alike, a swarm's first individual can *be* the truth, so
    the label takes part in the seed.

    Parameters
    ----------
    label : str
        Purpose and name, for instance ``"world:gravity-matching"``.
    *seeds : int
        Non-negative seeds of the draw.

    Returns
    -------
    numpy.random.Generator

    Raises
    ------
    InvalidInput
        If a seed is not a non-negative integer.
    """
    for seed in seeds:
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
            raise InvalidInput("seed", seed, "give a non-negative integer, so that the draw can be repeated")
    entropy = [zlib.crc32(label.encode()), *(int(seed) for seed in seeds)]
    return np.random.default_rng(np.random.SeedSequence(entropy))


@dataclass(frozen=True)
class Parameter:
    """One unknown of a problem.

    Attributes
    ----------
    name : str
        Field's standard term, one word or joined by underscores.
    unit : str
        SI unit, ``"1"`` for a pure number.
    lower, upper : float
        The box; ``lower < upper``.
    nominal : float
        Value assumed before anything is estimated, inside the box.
    """

    name: str
    unit: str
    lower: float
    upper: float
    nominal: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.lower) and np.isfinite(self.upper) and self.lower < self.upper):
            raise InvalidInput(
                f"bounds of {self.name}", (self.lower, self.upper), "give finite numbers, lower < upper"
            )
        if not self.lower <= self.nominal <= self.upper:
            raise InvalidInput(f"nominal of {self.name}", self.nominal, "give a value inside the box")


def _protect(values: dict[str, Any], depth: int) -> None:
    for value in values.values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        elif depth and is_dataclass(value) and not isinstance(value, type):
            _protect(vars(value), depth - 1)


class EstimationProblem(Problem):
    """Base of all problems: box-bounded, single-objective, vectorised, immutable.

    A subclass implements `_loss` and calls ``super().__init__`` with its parameters; what else it
    offers (`residuals`, `prior`, `truth`, …) it declares in `provides`. It is a
    `pymoo.core.problem.Problem`, so any pymoo algorithm takes it, and `loss` works without pymoo.

    Parameters
    ----------
    parameters : sequence of Parameter
        The unknowns, in the order of the decision vector.

    Attributes
    ----------
    parameters : tuple of Parameter
        The unknowns.
    truth : object or None
        What the world was; None for recorded data without a reference.
    true_x : ndarray, shape (n_var,), or None
        Decision vector that made the data, only where one did.
    provides : frozenset of str
        Capabilities solvers may ask for: ``residuals``, ``prior``, ``bound``, and problem-specific ones.
    """

    provides: ClassVar[frozenset[str]] = frozenset()
    truth: Any = None
    true_x: np.ndarray | None = None
    #: Keywords of `simulate` that made a world which can be drawn again with other noise (`noise_seed`).
    _world: dict[str, Any] | None = None
    _sealed = False

    def __init__(self, parameters: tuple[Parameter, ...] | list[Parameter]) -> None:
        parameters = tuple(parameters)
        if not parameters:
            raise InvalidInput("parameters", parameters, "give at least one Parameter")
        lower = np.array([p.lower for p in parameters], dtype=float)
        upper = np.array([p.upper for p in parameters], dtype=float)
        super().__init__(n_var=len(parameters), n_obj=1, xl=lower, xu=upper)
        self.parameters = parameters
        self.xl.setflags(write=False)
        self.xu.setflags(write=False)

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "__init__" in cls.__dict__:
            original = cls.__init__

            def __init__(self: EstimationProblem, *args: Any, **kw: Any) -> None:
                original(self, *args, **kw)
                if type(self) is cls:
                    object.__setattr__(self, "_sealed", True)

            __init__.__doc__ = original.__doc__
            __init__.__wrapped__ = original  # type: ignore[attr-defined]
            cls.__init__ = __init__  # type: ignore[method-assign]

    def __setattr__(self, name: str, value: Any) -> None:
        # pymoo keeps its own caches on the problem; everything else is fixed once built
        if self._sealed and name not in ("cache", "callback"):
            raise InvalidInput(name, value, f"{type(self).__name__} is immutable; build a new one")
        super().__setattr__(name, value)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def __copy__(self) -> Self:
        return self

    def __setstate__(self, state: dict[str, Any]) -> None:
        # a pickle does not carry the write protection of arrays
        self.__dict__.update(state)
        _protect(state, depth=3)

    # -- the box ---------------------------------------------------------------------------------
    @property
    def nominal(self) -> np.ndarray:
        """Decision vector assumed before anything is estimated, shape (n_var,)."""
        return np.array([p.nominal for p in self.parameters])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters in the order of the decision vector."""
        return tuple(p.name for p in self.parameters)

    def clip(self, x: np.ndarray) -> np.ndarray:
        """Nearest point of the box, shape as `x`."""
        return np.clip(x, self.xl, self.xu)

    # -- the objective ---------------------------------------------------------------------------
    def loss(self, X: np.ndarray) -> np.ndarray:
        """Objective to be minimised.

        Parameters
        ----------
        X : array_like, shape (..., n_var)
            Decision vectors.

        Returns
        -------
        ndarray, shape (...)
            Loss of each; ``+inf`` where the model cannot evaluate the candidate. The value of a
            candidate is the same to the last bit alone or in any batch.

        Raises
        ------
        InvalidInput
            If the last axis is not ``n_var`` long or a candidate holds NaN.
        NumericalFault
            If the model returns NaN.
        """
        flat, shape = self._rows(X)
        losses = np.asarray(self._loss(flat), dtype=float)
        fault = np.isnan(losses)
        if fault.any():
            k = int(np.flatnonzero(fault)[0])
            raise NumericalFault(
                f"{type(self).__name__}.loss returned NaN for candidate {k} of {len(flat)}: "
                f"{dict(zip(self.parameter_names, flat[k].tolist(), strict=True))}; "
                "a candidate that cannot be evaluated must have loss +inf"
            )
        return losses.reshape(shape)

    def _rows(self, X: Any) -> tuple[np.ndarray, tuple[int, ...]]:
        x = np.asarray(X, dtype=float)
        if x.ndim == 0 or x.shape[-1] != self.n_var:
            raise InvalidInput("X", x.shape, f"the last axis must hold the {self.n_var} parameters")
        flat = np.ascontiguousarray(x.reshape(-1, self.n_var))
        if np.isnan(flat).any():
            k = int(np.flatnonzero(np.isnan(flat).any(axis=1))[0])
            raise InvalidInput(f"candidate {k}", flat[k].tolist(), "decision vectors must not hold NaN")
        return flat, x.shape[:-1]

    def _loss(self, X: np.ndarray) -> np.ndarray:
        """Losses of C-contiguous float64 rows, shape (n, n_var) -> (n,)."""
        raise NotImplementedError

    def _evaluate(self, x: np.ndarray, out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
        out["F"] = self.loss(x)[..., None]

    def invalid_reasons(self, X: np.ndarray) -> list[str]:
        """Why the candidates `X`, shape (n, n_var), have an infinite loss: one sentence each."""
        return ["the model could not evaluate the candidate"] * len(X)

    # -- from decision vectors to physics and back ------------------------------------------------
    def estimate(self, x: np.ndarray) -> Any:
        """Physical answer that a decision vector stands for, a frozen dataclass; else the vector itself."""
        return np.array(x, dtype=float)

    def project(self, estimate: Any) -> np.ndarray:
        """Nearest decision vector inside the box, shape (n_var,)."""
        return self.clip(estimate)

    def score(self, estimate: Any) -> dict[str, float]:
        """Errors of an estimate against the truth; every key names its unit.

        Raises
        ------
        NoTruth
            If the problem carries no truth.
        """
        if self.truth is None:
            raise NoTruth(
                f"{type(self).__name__} carries no truth (recorded data): nothing can be scored against it"
            )
        return self._score(estimate)

    def _score(self, estimate: Any) -> dict[str, float]:
        raise NotImplementedError

    # -- what the data say -------------------------------------------------------------------------
    def residuals(self, X: np.ndarray) -> np.ndarray:
        """Whitened residuals, shape (..., n_var) -> (..., m): unit variance at the truth."""
        flat, shape = self._rows(X)
        self._require("residuals")
        out = self._residuals(flat)
        return out.reshape(*shape, out.shape[-1])

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def jacobian(self, X: np.ndarray) -> np.ndarray:
        """Derivative of `residuals`, shape (..., n_var) -> (..., m, n_var)."""
        flat, shape = self._rows(X)
        self._require("residuals")
        out = self._jacobian(flat)
        return out.reshape(*shape, *out.shape[1:])

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        # central differences over a millionth of the box: enough for problems without a closed form
        step = 1e-6 * (self.xu - self.xl)
        columns = [
            (self._residuals(X + step * unit) - self._residuals(X - step * unit)) / (2 * step[k])
            for k, unit in enumerate(np.eye(self.n_var))
        ]
        return np.stack(columns, axis=-1)

    def sensitivity(self, x: np.ndarray) -> np.ndarray:
        """Matrix whose Gram matrix is the information about the parameters, shape (m, n_var).

        The Jacobian of the residuals; a problem without residuals may know another one.

        Parameters
        ----------
        x : array_like, shape (n_var,)
            Where.
        """
        return self.jacobian(x)

    def prior(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Mean, shape (n_var,), and covariance, shape (n_var, n_var), known beforehand; or None."""
        return None

    def error_bound(self, x: np.ndarray | None = None) -> np.ndarray:
        """Cramér–Rao bound on the covariance of the parameters, with the prior where there is one.

        Parameters
        ----------
        x : array_like, shape (n_var,), optional
            Where to evaluate it; the truth (or its projection) if not given.

        Returns
        -------
        ndarray, shape (n_var, n_var)

        Raises
        ------
        NoBound
            If the problem has no residuals, no point is known, or the information is singular.
        """
        if "residuals" not in self.provides:
            raise NoBound(f"{type(self).__name__} has no residuals, so no bound has been derived")
        if x is None:
            x = self.true_x if self.true_x is not None else None
            if x is None:
                if self.truth is None:
                    raise NoBound("error_bound needs x where the problem carries no truth")
                x = self.project(self.truth)
        jacobian = self.jacobian(np.asarray(x, dtype=float))
        information = jacobian.T @ jacobian
        known = self.prior()
        if known is not None:
            information = information + np.linalg.inv(known[1])
        # scale by the box first: parameters in metres and in radians have no common condition number
        width = self.xu - self.xl
        scaled = information * np.outer(width, width)
        if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > 1e14:
            raise NoBound("the information matrix is singular here: not every parameter is identifiable")
        return np.linalg.inv(scaled) * np.outer(width, width)

    def identifiability(self, x: np.ndarray | None = None) -> Identifiability:
        """What the data can tell of the parameters at a point, see `navopt.identifiability`.

        Parameters
        ----------
        x : array_like, shape (n_var,), optional
            Where; the truth (or its projection) if not given, the nominal point where there is none.

        Returns
        -------
        Identifiability

        Raises
        ------
        UnsuitableProblem
            If the problem has neither residuals nor a `sensitivity` of its own.
        """
        from navopt.identifiability import identifiability

        return identifiability(self, x)

    def describe_direction(self, coefficients: dict[str, float]) -> str:
        """Say in the field's words what a combination of parameters is; empty if there is no word.

        Parameters
        ----------
        coefficients : dict of str to float
            Weight of each parameter, in units of half the box width or of the prior's sigma.
        """
        return ""

    def redraw(self, seed: int) -> EstimationProblem:
        """Return the held-out twin: same scenario and truth, new noise drawn from `seed`.

        Raises
        ------
        UnsuitableProblem
            If the data are not simulated.
        """
        if self._world is None:
            raise UnsuitableProblem(f"{type(self).__name__} cannot be redrawn: it holds recorded data")
        return type(self).simulate(noise_seed=seed, **self._world)

    @classmethod
    def simulate(cls, seed: int = 0, **scenario: Any) -> EstimationProblem:
        """Draw one world: truth, sensor errors and noise, all from `seed`."""
        raise NotImplementedError

    @classmethod
    def data_checksum(cls, **scenario: Any) -> str:
        """Checksum of the recorded or embedded data that `simulate` uses for a scenario; empty if none."""
        return ""

    def illustration(self) -> dict[str, np.ndarray]:
        """Arrays from which a report draws this world; empty if there is no picture."""
        return {}

    def _require(self, capability: str) -> None:
        if capability not in self.provides:
            raise UnsuitableProblem(f"{type(self).__name__} does not provide {capability!r}")
