"""Solvers and problems by name, found through entry points, with what they declare about themselves.

A package of anyone's joins by naming its factories in the entry-point groups ``navopt.solvers`` and
``navopt.problems``; a factory is decorated with `solver` or `problem`.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any

from pymoo.core.algorithm import Algorithm

from navopt.errors import InvalidInput, NavoptError, UnknownName, UnsuitableProblem
from navopt.problem import EstimationProblem

__all__ = [
    "ProblemInfo",
    "SolverInfo",
    "list_problems",
    "list_solvers",
    "make_solver",
    "problem",
    "problem_class",
    "problem_info",
    "simulate",
    "solver",
    "solver_factory",
    "solver_info",
]

#: What a solver may need, in words, for the message that refuses an unsuitable problem.
CAPABILITIES = {
    "residuals": "whitened residuals and their Jacobian",
    "prior": "a prior mean and covariance",
    "bound": "a Cramér–Rao bound",
    "triad": "sensor triads at rest in several positions (GyroCalibration)",
    "track": "an inertial track measured over a field map (GravityMatching)",
    "similarity": "a translation, rotation and scale of a track (GravityMatching)",
    "linear-gaussian": "a linear-Gaussian model with its measurements (NoiseTuning)",
    "heading-filter": "a filter that aligns with a measured heading (HeadingAlignment)",
}
_REASONED = ("spends_all", "comparison_based", "resumable")


@dataclass(frozen=True)
class SolverInfo:
    """What a solver declares; the contract tests hold it to every word.

    Attributes
    ----------
    name : str
        Registry name, the field's acronym.
    summary : str
        One line for listings.
    source : str
        Publication or library it comes from.
    needs : tuple of str
        Capabilities a problem must provide.
    stochastic : bool
        Whether the seed matters.
    spends_all : bool
        Whether a given budget is used to the last unit; otherwise it may stop earlier as ``converged``.
    comparison_based : bool
        Whether only the order of losses matters, never their values.
    resumable : bool
        Whether a pickled half-run continues to the same answer.
    minimum_cost : int
        Least budget it accepts.
    reasons : mapping of str to str
        Why a capability is missing, in writing; required for each that is False.
    """

    name: str
    summary: str
    source: str = ""
    needs: tuple[str, ...] = ()
    stochastic: bool = True
    spends_all: bool = True
    comparison_based: bool = False
    resumable: bool = True
    minimum_cost: int = 1
    reasons: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for capability in _REASONED:
            if not getattr(self, capability) and not self.reasons.get(capability):
                raise InvalidInput(
                    f"reasons of solver {self.name!r}",
                    dict(self.reasons),
                    f"say in writing why {capability!r} is missing",
                )
        for need in self.needs:
            if need not in CAPABILITIES:
                raise UnknownName(f"needs of solver {self.name!r}", need, CAPABILITIES)
        object.__setattr__(self, "reasons", MappingProxyType(dict(self.reasons)))

    def __reduce__(self) -> tuple[Any, ...]:
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return _rebuild, (type(self), {**values, "reasons": dict(self.reasons)})

    def check(self, target: EstimationProblem) -> None:
        """Refuse a problem that does not provide what the solver needs.

        Raises
        ------
        UnsuitableProblem
            Naming what is missing.
        """
        missing = [CAPABILITIES[need] for need in self.needs if need not in target.provides]
        if missing:
            raise UnsuitableProblem(
                f"{self.name} cannot solve {type(target).__name__}: it needs {' and '.join(missing)}"
            )


@dataclass(frozen=True)
class ProblemInfo:
    """What a problem declares.

    Attributes
    ----------
    name : str
        Registry name.
    summary : str
        One line for listings.
    example : mapping
        Scenario of a small, quick world, for tests and examples.
    """

    name: str
    summary: str
    example: Mapping[str, Any] = field(default_factory=dict)


def _rebuild(cls: type, values: dict[str, Any]) -> Any:
    return cls(**values)


def solver(name: str, **declared: Any) -> Callable[[Any], Any]:
    """Decorate a solver's class or factory with its `SolverInfo`; keywords are the fields of it."""
    info = SolverInfo(name, **declared)

    def attach(factory: Any) -> Any:
        if isinstance(factory, type):
            factory.solver_info = info  # type: ignore[attr-defined]
            return factory

        @functools.wraps(factory)
        def make(**settings: Any) -> Algorithm:
            algorithm = factory(**settings)
            bound = inspect.signature(factory).bind(**settings)
            bound.apply_defaults()
            algorithm.solver_info, algorithm.settings = info, dict(bound.arguments)
            return algorithm

        make.solver_info = info  # type: ignore[attr-defined]
        return make

    return attach


def problem(name: str, *, summary: str, example: Mapping[str, Any] | None = None) -> Callable[[type], type]:
    """Decorate a problem class with its `ProblemInfo`."""

    def attach(cls: type) -> type:
        cls.problem_info = ProblemInfo(name, summary, dict(example or {}))  # type: ignore[attr-defined]
        return cls

    return attach


@functools.cache
def _entries(group: str) -> dict[str, Any]:
    return {entry.name: entry for entry in entry_points(group=group)}


@functools.cache
def _load(group: str, kind: str, name: str) -> Any:
    entries = _entries(group)
    if name not in entries:
        raise UnknownName(kind, name, entries)
    factory = entries[name].load()
    if getattr(factory, f"{kind}_info", None) is None:
        raise NavoptError(
            f"the entry point {name!r} of group {group!r} has no {kind}_info: "
            f"decorate it with navopt.registry.{kind}"
        )
    return factory


def list_solvers() -> list[str]:
    """Names of all registered solvers, sorted."""
    return sorted(_entries("navopt.solvers"))


def list_problems() -> list[str]:
    """Names of all registered problems, sorted."""
    return sorted(_entries("navopt.problems"))


def solver_factory(name: str) -> Any:
    """Class or function registered as `name`, for its signature and documentation."""
    return _load("navopt.solvers", "solver", name)


def problem_class(name: str) -> type[EstimationProblem]:
    """Class registered as `name`."""
    cls: type[EstimationProblem] = _load("navopt.problems", "problem", name)
    return cls


def solver_info(name: str) -> SolverInfo:
    """Return what the solver registered as `name` declares."""
    info: SolverInfo = solver_factory(name).solver_info
    return info


def problem_info(name: str) -> ProblemInfo:
    """Return what the problem registered as `name` declares."""
    info: ProblemInfo = problem_class(name).problem_info
    return info


def make_solver(name: str, **settings: Any) -> Algorithm:
    """Build a registered solver.

    Parameters
    ----------
    name : str
        Registry name, see `list_solvers`.
    **settings
        Keywords of its factory.

    Returns
    -------
    pymoo.core.algorithm.Algorithm

    Raises
    ------
    UnknownName
        If no solver has this name, or it has no setting of one of these names.
    """
    factory = solver_factory(name)
    accepted = [p.name for p in inspect.signature(factory).parameters.values() if p.kind is not p.VAR_KEYWORD]
    for key in settings:
        if key not in accepted:
            raise UnknownName(f"setting of solver {name!r}", key, accepted)
    algorithm: Algorithm = factory(**settings)
    return algorithm


def simulate(name: str, seed: int = 0, **scenario: Any) -> EstimationProblem:
    """Draw one world of the problem registered as `name`; keywords as its ``simulate``."""
    cls = problem_class(name)
    accepted = [p for p in inspect.signature(cls.simulate).parameters if p != "seed"]
    for key in scenario:
        if key not in accepted:
            raise UnknownName(f"scenario key of problem {name!r}", key, accepted)
    world: EstimationProblem = cls.simulate(seed, **scenario)
    return world
