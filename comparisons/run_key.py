"""The key of a run: a digest of everything its result depends on.

Two runs share a key only if they would give the same result; whatever else changes is a new run and
never mixes silently with stored ones.
"""

from __future__ import annotations

import dataclasses
import enum
import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from navopt.errors import InvalidInput

__all__ = ["canonical_json", "digest", "versions"]

#: Distributions whose version takes part in every key: another one may give other numbers.
VERSIONED = ("navopt", "pymoo", "numpy")


def versions() -> dict[str, str]:
    """Installed versions that take part in every run key."""
    return {name: version(name) for name in VERSIONED}


def canonical_json(value: Any, *, argument: str = "value") -> str:
    """One text for equal values: sorted keys, no spaces, floats to the last bit.

    Parameters
    ----------
    value : object
        Numbers, texts, None, arrays, dataclasses, enumerations, classes and functions, and mappings
        and sequences of these.
    argument : str, keyword-only
        What the value is, for the error message.

    Returns
    -------
    str

    Raises
    ------
    InvalidInput
        If the value holds something without a stable text, such as an object known only by its
        address.
    """
    return json.dumps(_plain(value, argument), sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def digest(**parts: Any) -> str:
    """SHA-256, in hexadecimal, of the canonical JSON of the named parts."""
    return hashlib.sha256(canonical_json(parts).encode()).hexdigest()


def _plain(value: Any, argument: str) -> Any:
    if value is None or (isinstance(value, bool | int | float | str) and not isinstance(value, enum.Enum)):
        return value
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            raise InvalidInput(argument, value, "use texts as keys")
        return {key: _plain(item, f"{argument}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, argument) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item(), argument)
    if isinstance(value, np.ndarray) and value.dtype != object:
        return value.tolist()
    if isinstance(value, enum.Enum):
        return f"{_dotted(type(value))}.{value.name}"
    if isinstance(value, Path):
        return value.as_posix()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}
        return {"class": _dotted(type(value)), **_plain(fields, argument)}
    if isinstance(value, type) or (callable(value) and hasattr(value, "__qualname__")):
        name = _dotted(value)
        if "<" not in name:  # a lambda or a local function has no name of its own
            return name
    raise InvalidInput(
        argument,
        value,
        "give numbers, texts, lists or dataclasses: a run key needs a value with a stable text",
    )


def _dotted(thing: Any) -> str:
    return f"{thing.__module__}.{thing.__qualname__}"
