"""Curves: what becomes of a score as one number of the scenario changes."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import pandas as pd

from navopt.errors import InvalidInput

__all__ = ["Curve", "curve_table", "places_of_long_curves", "study_curves"]

#: Units that stand at the end of a keyword.
UNITS = {"m": "m", "s": "s", "deg": "°", "mgal": "mGal", "mgal_h": "mGal/h"}


#: Scenarios of a curve with more places than this have no table or picture of their own.
MOST_TABLES = 24


@dataclass(frozen=True)
class Curve:
    """Scenarios of a study that differ in one number only.

    Attributes
    ----------
    key : str
        Keyword of the scenarios that differs.
    label : str
        What tells this curve from the others over the same keyword, in words; empty if it is the only one.
    values : tuple of float
        Values of the keyword, increasing.
    scenarios : tuple of str
        Labels of the scenarios, in the order of `values`.
    """

    key: str
    label: str
    values: tuple[float, ...]
    scenarios: tuple[str, ...]

    @property
    def axis(self) -> tuple[float, str]:
        """Factor on the values, and the title of their axis."""
        for ending in sorted(UNITS, key=len, reverse=True):
            if self.key.endswith(f"_{ending}"):
                words = self.key.removesuffix(f"_{ending}").replace("_", " ")
                if ending == "m" and self.values[-1] >= 5000.0:
                    return 1e-3, f"{words} (km)"
                return 1.0, f"{words} ({UNITS[ending]})"
        return 1.0, self.key.replace("_", " ")


def study_curves(study: Any) -> list[Curve]:
    """Curves that a study asks for.

    Parameters
    ----------
    study : Study
        Its ``curve`` names the keywords; scenarios that agree in everything else belong together.

    Returns
    -------
    list of Curve
        In the order of the keywords and scenarios. A scenario may lie on several.

    Raises
    ------
    InvalidInput
        If no two scenarios differ in nothing but the number of such a keyword.
    """
    found = []
    for key in study.curve:
        families: dict[str, dict[float, str]] = {}
        others: dict[str, dict[str, Any]] = {}
        for label, scenario in study.scenarios.items():
            value = scenario.get(key)
            if isinstance(value, bool) or not isinstance(value, int | float):
                continue
            rest = {name: item for name, item in scenario.items() if name != key}
            family = json.dumps(rest, sort_keys=True, default=str)
            families.setdefault(family, {})[float(value)] = label
            others[family] = rest
        families = {family: places for family, places in families.items() if len(places) > 1}
        if not families:
            raise InvalidInput("curve", key, "name a keyword in which alone scenarios differ, by a number")
        shared = [set(map(_pair, others[family].items())) for family in families]
        common = set.intersection(*shared)
        for family, places in families.items():
            told = [f"{n} = {v}" for n, v in others[family].items() if _pair((n, v)) not in common]
            values = tuple(sorted(places))
            found.append(Curve(key, ", ".join(told), values, tuple(places[value] for value in values)))
    return found


def places_of_long_curves(study: Any) -> set[str]:
    """Scenarios that are places of a curve with so many that only the curve is worth looking at."""
    return {
        label for curve in study_curves(study) if len(curve.values) > MOST_TABLES for label in curve.scenarios
    }


def _pair(item: tuple[str, Any]) -> str:
    return json.dumps(item, sort_keys=True, default=str)


def curve_table(store_or_table: Any, study: Any = None) -> pd.DataFrame:
    """Ranked tables of all places of a study's curves, with where they are.

    Parameters
    ----------
    store_or_table : ResultsStore or pandas.DataFrame
        Results, or what `comparisons.statistics.ranked_table` made of them.
    study : Study, optional
        What was compared; the store's own if not given.

    Returns
    -------
    pandas.DataFrame
        ``curve`` (its place in `study_curves`), ``key, label, value``, and the columns of the ranked table.

    Raises
    ------
    InvalidInput
        If a table is given without its study.
    """
    study = study if study is not None else getattr(store_or_table, "study", None)
    if study is None:
        raise InvalidInput("study", study, "give the Study the table belongs to")
    if isinstance(store_or_table, pd.DataFrame):
        table = store_or_table
    else:
        from comparisons.statistics import ranked_table

        table = ranked_table(store_or_table, study)
    places = [
        {"curve": k, "key": curve.key, "label": curve.label, "value": value, "scenario": scenario}
        for k, curve in enumerate(study_curves(study))
        for value, scenario in zip(curve.values, curve.scenarios, strict=True)
    ]
    columns = ["curve", "key", "label", "value", "scenario"]
    return pd.DataFrame(places, columns=columns).merge(table, on="scenario", how="inner")
