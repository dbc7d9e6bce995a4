"""Checks of constructor options: a usable value comes back, anything else is one clear error."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName

__all__ = ["at_least", "number", "one_of", "region", "switch"]


def one_of(argument: str, value: Any, choices: tuple[Any, ...]) -> Any:
    """`value` if it is among `choices`; otherwise an error that names them."""
    if value not in choices:
        raise UnknownName(argument, value, [str(choice) for choice in choices])
    return value


def at_least(argument: str, value: int, lowest: int) -> int:
    """`value` if it is a whole number not below `lowest`; otherwise an error."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < lowest:
        raise InvalidInput(argument, value, f"give a whole number, at least {lowest}")
    return int(value)


def switch(argument: str, value: Any) -> bool:
    """`value` if it is True or False; otherwise an error."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidInput(argument, value, "give True or False")
    return bool(value)


def number(argument: str, value: Any, *, above: float | None = None, most: float = np.inf) -> float:
    """`value` as a float if it is finite, larger than `above` and at most `most`; otherwise an error."""
    ok = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not ok or not np.isfinite(value) or (above is not None and value <= above) or value > most:
        bounds = "" if above is None else f" larger than {above:g}"
        bounds += "" if np.isinf(most) else f"{' and' if bounds else ''} at most {most:g}"
        raise InvalidInput(argument, value, f"give a finite number{bounds}")
    return float(value)


def region(argument: str, value: Any) -> tuple[float, float]:
    """`value` as (lower, upper) if it is a pair of finite numbers in order; otherwise an error."""
    try:
        low, high = (number(argument, bound) for bound in value)
    except (TypeError, ValueError):
        raise InvalidInput(argument, value, "give two finite numbers, the lower first") from None
    if not low < high:
        raise InvalidInput(argument, value, "give two finite numbers, the lower first")
    return low, high
