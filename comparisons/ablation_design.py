"""What an ablation varies: a base solver, its ingredients with their other values, and the variants.

Plain data without the registries, so that a results store can say what it holds even where the solver
is not installed; only `Design.reduced` asks them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName

__all__ = ["BASE", "DESIGNS", "Design", "Level", "Variant"]

#: Label of the unchanged solver.
BASE = "base"
DESIGNS = ("one-at-a-time", "factorial")
KEYS = ("base", "settings", "design", "vary", "contrasts")


@dataclass(frozen=True)
class Level:
    """One value of an ingredient other than the base's.

    Attributes
    ----------
    ingredient, text : str
        What is varied, and its value in words.
    settings : dict
        What it changes in the settings of the base.
    solver : str
        Registered solver that takes the place of the base with these settings alone; the base if empty.
    """

    ingredient: str
    text: str
    settings: dict[str, Any]
    solver: str = ""

    @property
    def label(self) -> str:
        """``ingredient=value``."""
        return f"{self.ingredient}={self.text}"


@dataclass(frozen=True)
class Variant:
    """One solver of an ablation.

    Attributes
    ----------
    label : str
        ``"base"``, or what differs from it.
    solver : str
        Registered solver.
    settings : dict
        Its keywords.
    levels : tuple of str
        Labels of the levels that differ from the base.
    """

    label: str
    solver: str
    settings: dict[str, Any]
    levels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Design:
    """Base, ingredients and plan of an ablation; the ``[ablation]`` table of a study.

    Attributes
    ----------
    base : str
        Registered solver.
    settings : dict
        Keywords of the base; those not given keep the solver's defaults.
    vary : dict of str to list or dict
        Per ingredient: values of the option of this name, or a table of levels by name, each a table of
        settings. A level with the key ``solver`` replaces the base by that solver with these settings.
    design : {"one-at-a-time", "factorial"}
        One level differs from the base in each variant, or all combinations are made.
    contrasts : dict of str to list of two str
        Ingredients that are a property of the problem: the scenario where it is as in the base, and the
        one where it is not. The base solver is compared on the same worlds of both.

    Raises
    ------
    InvalidInput
        If a value cannot be used.
    UnknownName
        If `design` or a key is unknown.
    """

    base: str
    settings: dict[str, Any] = field(default_factory=dict)
    vary: dict[str, Any] = field(default_factory=dict)
    design: str = DESIGNS[0]
    contrasts: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.design not in DESIGNS:
            raise UnknownName("design", str(self.design), DESIGNS)
        if not isinstance(self.base, str) or not self.base:
            raise InvalidInput("base", self.base, "give the name of a registered solver")
        for argument in ("settings", "vary", "contrasts"):
            value = getattr(self, argument)
            if not isinstance(value, Mapping):
                raise InvalidInput(argument, value, "give a table of keys and values")
            object.__setattr__(self, argument, _plain(value, argument))
        object.__setattr__(self, "vary", {name: _values(name, v) for name, v in self.vary.items()})
        if not self.vary and not self.contrasts:
            raise InvalidInput("vary", self.vary, "give at least one option with another value")
        for name, pair in self.contrasts.items():
            if not (isinstance(pair, list) and len(pair) == 2 and pair[0] != pair[1]):
                raise InvalidInput(f"contrasts.{name}", pair, "give the labels of two scenarios")
        self._check_levels()

    def _check_levels(self) -> None:
        labels = [level.label for level in self.levels()]
        for label in labels:
            if labels.count(label) > 1:
                raise InvalidInput("vary", label, "each value may occur once only")
        if self.design == "one-at-a-time":
            return
        owner: dict[str, str] = {}
        for level in self.levels():
            if level.solver:
                raise InvalidInput(
                    f"vary.{level.ingredient}",
                    level.solver,
                    'another solver has no place in a factorial: use design="one-at-a-time"',
                )
            for key in level.settings:
                if owner.setdefault(key, level.ingredient) != level.ingredient:
                    remedy = f"{owner[key]!r} sets it too: in a factorial each option has one ingredient"
                    raise InvalidInput(f"vary.{level.ingredient}", key, remedy)

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Design:
        """Read the ``[ablation]`` table of a study."""
        for key in table:
            if key not in KEYS:
                raise UnknownName("key of ablation", key, KEYS)
        if "base" not in table:
            raise InvalidInput("ablation: base", "nothing", "this key is required")
        try:
            return cls(**table)
        except UnknownName as error:
            name = str(error.value).strip("'\"")
            raise UnknownName(f"ablation: {error.argument}", name, error.known) from None
        except InvalidInput as error:
            raise InvalidInput(f"ablation: {error.argument}", error.value, error.remedy) from None

    def to_table(self) -> dict[str, Any]:
        """Plain table from which `from_table` gives the same design back."""
        return {key: _plain(getattr(self, key), key) for key in KEYS}

    # -- what follows from it ----------------------------------------------------------------------
    def levels(self, ingredient: str | None = None) -> list[Level]:
        """All levels other than the base's, of one ingredient or of all, in the order given."""
        found = []
        for name, values in (
            self.vary.items() if ingredient is None else [(ingredient, self.vary[ingredient])]
        ):
            if isinstance(values, dict):
                for text, settings in values.items():
                    kept = {key: value for key, value in settings.items() if key != "solver"}
                    found.append(Level(name, text, kept, settings.get("solver", "")))
            else:
                found += [Level(name, _in_text(value), {name: value}) for value in values]
        return found

    def variants(self) -> list[Variant]:
        """All solvers of the ablation, the base first."""
        if self.design == "factorial":
            choices = [(None, *self.levels(name)) for name in self.vary]
            return [self._variant([level for level in row if level]) for row in itertools.product(*choices)]
        return [self._variant([]), *(self._variant([level]) for level in self.levels())]

    def _variant(self, levels: Sequence[Level]) -> Variant:
        settings, solver = dict(self.settings), self.base
        for level in levels:
            settings = {**({} if level.solver else settings), **level.settings}
            solver = level.solver or solver
        labels = tuple(level.label for level in levels)
        return Variant(", ".join(labels) or BASE, solver, settings, labels)

    def pairs(self, level: Level) -> list[tuple[str, str]]:
        """Labels of the variants that differ in this level only: with the base's value, and with it."""
        label = {frozenset(variant.levels): variant.label for variant in self.variants()}
        return [
            (label[levels - {level.label}], name) for levels, name in label.items() if level.label in levels
        ]

    def base_text(self, ingredient: str, options: Mapping[str, Any] | None = None) -> str:
        """Value of an ingredient in the base, as far as settings or the full `options` of a run tell."""
        known = {**(options or {}), **self.settings}
        named = isinstance(self.vary.get(ingredient), dict)
        return BASE if named or ingredient not in known else _in_text(known[ingredient])

    def reduced(self) -> Design:
        """Return the same design without the values that the base has anyway.

        Raises
        ------
        UnknownName
            If the base or one of its options is unknown.
        InvalidInput
            If the base refuses its settings, or an ingredient has no other value.
        """
        from comparisons.planning import full_settings

        own = full_settings(self.base, self.settings)
        vary: dict[str, Any] = {}
        for name, values in self.vary.items():
            vary[name] = values
            if isinstance(values, dict):
                continue
            if name not in own:
                raise UnknownName(f"option of solver {self.base!r}", name, own)
            mine = _comparable(own[name])
            vary[name] = [value for value in values if _comparable(value) != mine]
            if not vary[name]:
                raise InvalidInput(f"vary.{name}", values, "give a value that the base does not have")
        return Design(self.base, self.settings, vary, self.design, self.contrasts)


def _in_text(value: Any) -> str:
    """Value of an option as labels show it."""
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_in_text, value))})"
    return str(value)


def _values(name: str, values: Any) -> Any:
    """Values of an ingredient as a list, or its levels as a table of tables."""
    if isinstance(values, dict):
        for text, settings in values.items():
            if not isinstance(settings, dict) or not settings:
                raise InvalidInput(f"vary.{name}.{text}", settings, "give a table of settings")
            if not isinstance(settings.get("solver", ""), str):
                raise InvalidInput(f"vary.{name}.{text}.solver", settings["solver"], "give a solver's name")
        found: Any = values
    else:
        found = values if isinstance(values, list) else [values]
    if not found:
        raise InvalidInput(f"vary.{name}", values, "give at least one value")
    if None in found:
        remedy = "None has no form in a study file: let the base have it and vary from there"
        raise InvalidInput(f"vary.{name}", values, remedy)
    return found


def _plain(value: Any, argument: str) -> Any:
    """`value` as TOML and JSON have it: lists and dicts of numbers and texts."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item, f"{argument}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, argument) for item in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise InvalidInput(argument, value, "give numbers, texts or lists")


def _comparable(value: Any) -> Any:
    """Equal for equal settings: a tuple is a list and 1 is 1.0, but True is not 1."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return tuple(map(_comparable, value))
    return isinstance(value, bool), value
