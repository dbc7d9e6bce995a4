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
    "scenarios": Mapping,
    "solvers": (list, tuple),
    "ablation": Mapping,
}
_REQUIRED = ("name", "problem", "worlds", "budget")
_SOLVER = {"name": str, "label": str, "settings": Mapping}
_SUCCESS = {"score": str, "below": (*_NUMBER, list, tuple), "labels": (str, list, tuple)}
_DISPLAY = {"scale": _NUMBER, "unit": str, "label": str}
_WORDS = {str: "a text", int: "a whole number", float: "a number", list: "a list", Mapping: "a table"}


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
        Fields of `comparisons.study.Study`, with solvers and success still as dicts.

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
    values["solvers"] = [
        _table(entry, _SOLVER, f"{source}: solvers[{k}]", required=("name",))
        for k, entry in enumerate(values.get("solvers", ()))
    ]
    values["success"] = [
        _success(_table(entry, _SUCCESS, f"{source}: success[{k}]", required=("score", "below")))
        for k, entry in enumerate(values.get("success", ()))
    ]
    return values


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
        if isinstance(item, bool) or not isinstance(item, accepted):
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
