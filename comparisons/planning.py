"""From a study to its runs: check every name against the registries and give each run its key."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from comparisons.run_key import canonical_json, digest, versions
from navopt import registry
from navopt.errors import InvalidInput, MissingData, NavoptError, UnknownName

if TYPE_CHECKING:
    from comparisons.study import RunSpec, Study

__all__ = ["check_names", "full_settings", "naming", "plan"]


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Put the name of the study file before what was wrong in it."""
    try:
        yield
    except UnknownName as error:
        raise UnknownName(f"{source}: {error.argument}", error.value.strip("'\""), error.known) from None
    except MissingData as error:
        raise MissingData(f"{source}: {error.argument}", error.value, error.remedy) from None
    except InvalidInput as error:
        raise InvalidInput(f"{source}: {error.argument}", error.value, error.remedy) from None


def check_names(study: Study, source: str) -> None:
    """Refuse a problem, scenario key, solver or setting that is not known.

    Raises
    ------
    UnknownName
        Naming `source` and the nearest known name.
    InvalidInput
        If a solver refuses its settings.
    """
    with naming(source):
        known = registry.list_solvers()
        for entry in study.solvers:
            if entry.name not in known:
                raise UnknownName("solver", entry.name, known)
        for label in study.scenarios:
            problem, scenario = study.place(label)
            for name in (study.problem, problem):
                if name not in registry.list_problems():
                    raise UnknownName("problem", name, registry.list_problems())
            accepted = [name for name in _defaults(problem) if name != "seed"]
            for key in scenario:
                if key not in accepted:
                    raise UnknownName(f"key of scenario {label!r}", key, accepted)
        for entry in study.solvers:
            full_settings(entry.name, entry.settings)


def _defaults(problem: str) -> dict[str, Any]:
    parameters = inspect.signature(registry.problem_class(problem).simulate).parameters.values()
    return {p.name: p.default for p in parameters if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)}


def full_settings(solver: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the settings that a solver really has: those given, and its defaults for the others."""
    try:
        algorithm = registry.make_solver(solver, **settings)
    except NavoptError:
        raise
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"settings of solver {solver!r}", settings, str(error)) from None
    return dict(getattr(algorithm, "settings", settings))


def plan(study: Study, source: str) -> list[RunSpec]:
    """Every run of a study with its key, ordered by scenario, world, solver and seed.

    Raises
    ------
    InvalidInput
        If two solvers or two scenarios of the study are the same, or a setting has no stable text.
    """
    from comparisons.study import RunSpec

    installed = versions()
    solvers = [(entry, full_settings(entry.name, entry.settings)) for entry in study.solvers]
    with naming(source):
        for entry, settings in solvers:
            canonical_json(settings, argument=f"settings of solver {entry.label!r}")
        runs: dict[str, RunSpec] = {}
        for label in study.scenarios:
            problem, scenario = study.place(label)
            cls = registry.problem_class(problem)
            defaults = {
                name: value
                for name, value in _defaults(problem).items()
                if name != "seed" and value is not inspect.Parameter.empty
            }
            place = {
                "problem": f"{cls.__module__}.{cls.__qualname__}",
                "scenario": {**defaults, **scenario},
                "data": cls.data_checksum(**scenario),
                "versions": installed,
            }
            canonical_json(place["scenario"], argument=f"scenario {label!r}")
            for world in study.worlds:
                world_key = digest(**place, world=world)
                for entry, settings in solvers:
                    for seed in study.seeds_of(world):
                        key = digest(
                            **place,
                            world=world,
                            solver=entry.name,
                            settings=settings,
                            seed=seed,
                            budget=study.budget,
                            held_out=study.held_out,
                        )
                        spec = RunSpec(
                            key=key,
                            world_key=world_key,
                            scenario_label=label,
                            scenario=scenario,
                            world=world,
                            solver_label=entry.label,
                            solver=entry.name,
                            settings=entry.settings,
                            seed=seed,
                            problem=problem,
                            budget=study.budget,
                            held_out=study.held_out,
                        )
                        if key in runs:
                            _same(runs[key], spec)
                        runs[key] = spec
    return list(runs.values())


def _same(first: RunSpec, second: RunSpec) -> None:
    if first.solver_label != second.solver_label:
        raise InvalidInput(
            "solvers",
            f"{first.solver_label!r} and {second.solver_label!r}",
            "these are the same solver with the same settings; remove one",
        )
    raise InvalidInput(
        "scenarios",
        f"{first.scenario_label!r} and {second.scenario_label!r}",
        "these are the same scenario; remove one",
    )
