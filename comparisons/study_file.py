"""Reading the tables of a study file: which keys there are, and what kind of value each takes."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from navopt.errors import InvalidInput, UnknownName

__all__ = ["parse", "read_toml"]

_NUMBER = (int, float)
_STUDY = {
    "name": str,
    "title": str,
    "description": str,
    "problem": str,
    "worlds": (int, list, tuple),
    "first_world": int,
    "seeds": (int, list, tuple),
    "budget": int,
    "held_out": int,
    "illustrate": int,
    "rank_by": str,
    "display": Mapping,
    "success": (list, tuple),
    "bound": (list, tuple),
    "scenarios": Mapping,
    "solvers": (list, tuple),
    "seed_per_world": bool,
    "lockstep": bool,
    "groups": Mapping,
    "printed": (list, tuple),
    "curve": (str, list, tuple),
    "ablation": Mapping,
}
_REQUIRED = ("name", "problem", "worlds", "budget")
_SOLVER = {"name": str, "label": str, "settings": Mapping}
_SUCCESS = {"score": str, "below": (*_NUMBER, list, tuple), "labels": (str, list, tuple)}
_BOUND = {"over": str, "score": str, "label": str}
_DISPLAY = {"scale": _NUMBER, "unit": str, "label": str}
_PRINTED = {
    "source": str,
    "scenario": str,
    "solver": str,
    "value": _NUMBER,
    "values": Mapping,
    "score": str,
    "statistic": str,
    "below": (*_NUMBER, type(None)),
    "note": str,
}
_WORDS = {
    str: "a text",
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    list: "a list",
    Mapping: "a table",
}


def read_toml(path: Path) -> dict[str, Any]:
    """Tables of a TOML file.

    Raises
    ------
    InvalidInput
        If there is no such file or it is not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput("study", str(path), f"give a readable TOML file ({error})") from None
    except tomllib.TOMLDecodeError as error:
        raise InvalidInput("study", str(path), f"correct the TOML: {error}") from None


def parse(document: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Keyword arguments of a study, every key known and every value of its kind.

    Parameters
    ----------
    document : mapping
        Tables of the TOML form.
    source : str
        Where they come from, for error messages.

    Returns
    -------
    dict
        Fields of `comparisons.study.Study`, with solvers, success, bounds and printed values still as
        dicts.

    Raises
    ------
    UnknownName
        If a key is unknown; the nearest is suggested.
    InvalidInput
        If a key is missing or its value is of another kind.
    """
    # an ablation makes its solvers itself
    required = _REQUIRED if document.get("ablation") else (*_REQUIRED, "solvers")
    values = _table(document, _STUDY, source, required=required)
    values["worlds"] = _worlds(values, source)
    seeds = values.get("seeds", (1,))
    values["seeds"] = (seeds,) if isinstance(seeds, int) else tuple(seeds)
    values["display"] = _table(values.get("display", {}), _DISPLAY, f"{source}: display")
    values["scenarios"] = {
        label: _table(scenario, None, f"{source}: scenarios.{label!r}")
        for label, scenario in values.get("scenarios", {"default": {}}).items()
    }
    curve = values.get("curve", ())
    values["curve"] = _labels((curve,) if isinstance(curve, str) else curve, f"{source}: curve")
    values["scenarios"], spread = _spread(values["scenarios"], values["curve"], source)
    values["solvers"] = [
        _table(entry, _SOLVER, f"{source}: solvers[{k}]", required=("name",))
        for k, entry in enumerate(values.get("solvers", ()))
    ]
    values["success"] = [
        _success(_table(entry, _SUCCESS, f"{source}: success[{k}]", required=("score", "below")))
        for k, entry in enumerate(values.get("success", ()))
    ]
    values["bound"] = [
        _table(entry, _BOUND, f"{source}: bound[{k}]", required=("over",))
        for k, entry in enumerate(values.get("bound", ()))
    ]
    values["groups"] = {
        name: tuple(
            one
            for label in _labels(labels, f"{source}: groups.{name}")
            for one in spread.get(label, (label,))
        )
        for name, labels in values.get("groups", {}).items()
    }
    values["printed"] = [
        one
        for k, entry in enumerate(values.get("printed", ()))
        for one in _printed(entry, f"{source}: printed[{k}]")
    ]
    return values


def _labels(value: Any, where: str) -> tuple[str, ...]:
    if not isinstance(value, list | tuple) or not all(isinstance(label, str) for label in value):
        raise InvalidInput(where, value, "give a list of scenario labels")
    return tuple(value)


def _spread(
    scenarios: dict[str, dict[str, Any]], curve: tuple[str, ...], source: str
) -> tuple[dict[str, dict[str, Any]], dict[str, tuple[str, ...]]]:
    """One scenario per number where a keyword of a curve has a list of them, and what each label became."""
    single: dict[str, dict[str, Any]] = {}
    spread: dict[str, tuple[str, ...]] = {}
    for label, scenario in scenarios.items():
        lists = [key for key in curve if isinstance(scenario.get(key), list | tuple)]
        if not lists:
            single[label] = scenario
            continue
        key, where = lists[0], f"{source}: scenarios.{label!r}: {lists[0]}"
        numbers = scenario[key]
        if len(lists) > 1:
            raise InvalidInput(where, numbers, f"only one of {', '.join(lists)} may have a list")
        if not numbers or not all(isinstance(v, _NUMBER) and not isinstance(v, bool) for v in numbers):
            raise InvalidInput(where, numbers, "give a list of numbers")
        spread[label] = tuple(f"{label}, {number:g}" for number in numbers)
        for name, number in zip(spread[label], numbers, strict=True):
            if name in single or name in scenarios:
                raise InvalidInput(where, number, "each may occur once only")
            single[name] = {**scenario, key: number}
    return single, spread


def _printed(entry: Any, where: str) -> list[dict[str, Any]]:
    """Printed values of one table: one, or one per solver under ``values``."""
    shared = _table(entry, _PRINTED, where, required=("source", "scenario"))
    many = shared.pop("values", None)
    if many is None:
        return [_table(shared, _PRINTED, where, required=("solver", "value"))]
    for key in ("solver", "value"):
        if key in shared:
            raise InvalidInput(f"{where}: {key}", shared[key], "leave it out beside values")
    if not many:
        raise InvalidInput(f"{where}: values", many, "give at least one solver with its value")
    each = [{**shared, "solver": solver, "value": value} for solver, value in many.items()]
    return [_table(one, _PRINTED, f"{where}.values") for one in each]


def _table(
    value: Any, kinds: dict[str, Any] | None, where: str, *, required: tuple[str, ...] = ()
) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise InvalidInput(where, value, "give a table of keys and values")
    table = dict(value)
    if kinds is None:
        return table
    for key, item in table.items():
        if key not in kinds:
            raise UnknownName(f"key of {where}", key, kinds)
        accepted = kinds[key] if isinstance(kinds[key], tuple) else (kinds[key],)
        if (isinstance(item, bool) and bool not in accepted) or not isinstance(item, accepted):
            words = " or ".join(_WORDS[kind] for kind in accepted if kind in _WORDS)
            raise InvalidInput(f"{where}: {key}", item, f"give {words}")
    for key in required:
        if key not in table:
            raise InvalidInput(f"{where}: {key}", "nothing", "this key is required")
    return table


def _worlds(values: dict[str, Any], source: str) -> tuple[int, ...]:
    first = values.pop("first_world", None)
    worlds = values["worlds"]
    if isinstance(worlds, int):
        if worlds < 1:
            raise InvalidInput(f"{source}: worlds", worlds, "give at least 1, or a list of seeds")
        return tuple(range(first or 0, (first or 0) + worlds))
    if first is not None:
        raise InvalidInput(f"{source}: first_world", first, "leave it out where worlds is a list of seeds")
    return tuple(worlds)


def _success(entry: dict[str, Any]) -> dict[str, Any]:
    below, labels = entry["below"], entry.get("labels", ())
    entry["below"] = (below,) if isinstance(below, int | float) else tuple(below)
    entry["labels"] = (labels,) if isinstance(labels, str) else tuple(labels)
    return entry
