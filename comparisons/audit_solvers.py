"""Solvers of an audit as one writes them: ``foa``, ``foa:encoding=reciprocal`` or a TOML table."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from comparisons.study import SolverEntry
from comparisons.study_file import read_toml
from navopt import registry
from navopt.errors import InvalidInput, UnknownName

__all__ = ["audit_file", "parse_solver", "solver_entries"]

#: Word for the settings of a paper, a class method of the solvers that have one.
PUBLISHED = "published"
_KEYS: dict[str, Any] = {
    "solvers": list,
    "references": list,
    "dimensions": list,
    "functions": list,
    "biases": list,
    "seeds": (int, list),
    "first_seed": int,
    "budget": int,
}
_COMMA = re.compile(r",(?![^\[({]*[\])}])(?=\s*[A-Za-z_]\w*\s*(?:=|,|$))")


def parse_solver(text: str) -> SolverEntry:
    """Read a solver with its settings.

    Parameters
    ----------
    text : str
        ``name`` or ``name:key=value,key=value``; values as in TOML, texts also without quotes. The word
        ``published`` takes the solver's published settings, before which others may stand or after.

    Returns
    -------
    SolverEntry
        Labelled with `text`.

    Raises
    ------
    UnknownName
        If no solver has this name.
    InvalidInput
        If a setting has no value, or the solver has no published settings.
    """
    name, _, rest = text.strip().partition(":")
    settings: dict[str, Any] = {}
    published = False
    for part in _COMMA.split(rest) if rest.strip() else ():
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if key == PUBLISHED and not equals:
            published = True
        elif not equals or not key or not value:
            raise InvalidInput("solver", text, "write settings as name:key=value,key=value")
        else:
            settings[key] = _value(value)
    if published:
        settings = _published(name, text, settings)
    return SolverEntry(name, text.strip(), settings)


def _value(text: str) -> Any:
    if text in ("None", "none"):
        return None
    if text in ("True", "False"):
        return text == "True"
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _published(name: str, text: str, settings: dict[str, Any]) -> dict[str, Any]:
    make = getattr(_factory(name), PUBLISHED, None)
    if make is None:
        raise InvalidInput("solver", text, f"{name} has no published settings; name its settings one by one")
    return dict(make(**settings).settings)


def _factory(name: str) -> Any:
    if name not in registry.list_solvers():
        raise UnknownName("solver", name, registry.list_solvers())
    return registry.solver_factory(name)


def solver_entries(solvers: Any) -> tuple[SolverEntry, ...]:
    """Solvers given as texts, tables (``name``, ``label``, ``settings``) or `SolverEntry`, one or many.

    Raises
    ------
    UnknownName
        If a solver is not registered, or a table has an unknown key.
    InvalidInput
        If one is of another kind.
    """
    many: Iterable[Any] = [solvers] if isinstance(solvers, str | Mapping | SolverEntry) else solvers
    entries = tuple(_entry(one) for one in many)
    for entry in entries:
        _factory(entry.name)
    return entries


def _entry(one: Any) -> SolverEntry:
    if isinstance(one, SolverEntry):
        return one
    if isinstance(one, str):
        return parse_solver(one)
    if not isinstance(one, Mapping) or "name" not in one:
        raise InvalidInput("solver", one, "give a name, a table with a name, or a SolverEntry")
    for key in one:
        if key not in ("name", "label", "settings"):
            raise UnknownName("key of a solver", key, ("name", "label", "settings"))
    plain = parse_solver(one["name"])
    return SolverEntry(
        plain.name, one.get("label", plain.label), {**plain.settings, **one.get("settings", {})}
    )


def audit_file(path: str | Path) -> dict[str, Any]:
    """Keywords of `comparisons.audit.Audit` from a TOML file.

    Parameters
    ----------
    path : path-like
        With ``[[solvers]]`` tables and any of ``references``, ``dimensions``, ``functions``, ``biases``,
        ``seeds`` (a number or a list), ``first_seed`` and ``budget``.

    Raises
    ------
    UnknownName
        If a key is unknown.
    InvalidInput
        If the file cannot be read, a value is of another kind, or there are no solvers.
    """
    document = read_toml(Path(path))
    for key, value in document.items():
        if key not in _KEYS:
            raise UnknownName(f"key of {path}", key, _KEYS)
        if isinstance(value, bool) or not isinstance(value, _KEYS[key]):
            raise InvalidInput(f"{path}: {key}", value, "give a whole number or a list")
    if "solvers" not in document:
        raise InvalidInput(f"{path}: solvers", "nothing", "this key is required")
    return document
