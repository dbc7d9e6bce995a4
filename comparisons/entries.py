"""The parts of a study: competitors, what counts as a match, printed values, and the single runs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any

from navopt.errors import InvalidInput, UnknownName

__all__ = ["STATISTICS", "Bound", "Printed", "RunGroup", "RunSpec", "SolverEntry", "Success"]

#: What a printed value may be of our runs, and how that is called in a table.
STATISTICS = {
    "run": "one run",
    "median": "median",
    "mean": "mean",
    "sd": "SD",
    "minimum": "lowest",
    "maximum": "highest",
    "share": "share",
}


@dataclass(frozen=True)
class SolverEntry:
    """One competitor of a study.

    Attributes
    ----------
    name : str
        Registered solver.
    label : str
        What the study calls it; unique in the study, `name` by default.
    settings : dict
        Keywords of the solver; those not given keep its defaults.
    """

    name: str
    label: str = ""
    settings: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "label", self.label or self.name)
        object.__setattr__(self, "settings", dict(self.settings))


@dataclass(frozen=True)
class Success:
    """When a run counts as a match: its score below a threshold.

    Attributes
    ----------
    score : str
        Score key, or ``"loss"``.
    below : tuple of float
        Thresholds, in the unit of the score.
    labels : tuple of str
        What to call each threshold; ``< value`` by default.
    """

    score: str
    below: tuple[float, ...]
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "below", tuple(float(value) for value in self.below))
        object.__setattr__(self, "labels", tuple(self.labels) or tuple(f"< {v:g}" for v in self.below))
        if not self.below or len(self.labels) != len(self.below):
            raise InvalidInput("success", (self.below, self.labels), "give one label for each threshold")


@dataclass(frozen=True)
class Bound:
    """A score and the bound on it that the problem reports as another score, to be shown as their ratio.

    Attributes
    ----------
    over : str
        Score key of the bound: the least root mean square error that is possible in the world of a run.
    score : str
        Score key of the error that it bounds; what the study ranks by if not given.
    label : str
        What to call the bound; `over` by default.

    Raises
    ------
    InvalidInput
        If a score would be divided by itself.
    """

    over: str
    score: str = ""
    label: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "label", self.label or self.over)
        if not self.over or self.over == self.score:
            raise InvalidInput("over", self.over, "name the score that bounds the error")


@dataclass(frozen=True)
class Printed:
    """A number that a publication prints, to stand beside ours.

    Attributes
    ----------
    source : str
        Where it is printed, such as ``"Wan et al. (2020), Table 1"``.
    scenario, solver : str
        Labels of the study: whose runs it is compared with. A group of scenarios stands for all of them.
    value : float
        The number, in the unit of the score; a share between 0 and 1.
    score : str
        Score key, or ``"loss"``; what the study ranks by if not given.
    statistic : str, default "run"
        What the number is of the publication's runs, a key of `STATISTICS`: ``"run"`` for a single run, or
        for a number of which nobody says how many runs it stands for.
    below : float, optional
        For a share: the threshold, in the unit of the score.
    note : str
        A remark for the reader.

    Raises
    ------
    InvalidInput
        If a value cannot be used.
    UnknownName
        If the statistic is none of `STATISTICS`.
    """

    source: str
    scenario: str
    solver: str
    value: float
    score: str = ""
    statistic: str = "run"
    below: float | None = None
    note: str = ""

    def __post_init__(self) -> None:
        if not self.source.strip():
            raise InvalidInput("source", self.source, "say where the value is printed")
        if self.statistic not in STATISTICS:
            raise UnknownName("statistic", self.statistic, STATISTICS)
        object.__setattr__(self, "value", float(self.value))
        if not math.isfinite(self.value):
            raise InvalidInput("value", self.value, "give the printed number")
        if (self.statistic == "share") != (self.below is not None):
            raise InvalidInput("below", self.below, "give a threshold with statistic 'share', and only there")
        if self.below is not None:
            object.__setattr__(self, "below", float(self.below))
            if not 0 <= self.value <= 1:
                raise InvalidInput("value", self.value, "give a share between 0 and 1, not per cent")

    @property
    def digits(self) -> int:
        """Significant digits that were printed."""
        return max(len(Decimal(repr(self.value)).normalize().as_tuple().digits), 1)

    @property
    def half_unit(self) -> float:
        """Half a unit of the last digit: everything nearer was rounded to the printed value."""
        exponent = Decimal(repr(self.value)).as_tuple().exponent
        return 0.5 * 10.0 ** int(exponent)


@dataclass(frozen=True)
class RunSpec:
    """One run of a study: everything a worker needs to repeat it.

    Attributes
    ----------
    key : str
        SHA-256 of everything the result depends on.
    world_key : str
        The same for the world alone, shared by all runs on it.
    scenario_label : str
        What the study calls the scenario.
    scenario : dict
        Keywords of the problem's ``simulate``.
    world : int
        Seed of the world.
    solver_label : str
        What the study calls the solver.
    solver : str
        Registered solver.
    settings : dict
        Keywords of the solver as the study gives them.
    seed : int
        Seed of the solver.
    problem : str
        Registered problem.
    budget : int
        Largest cost.
    held_out : int
        Number of redrawn twins that the solution is applied to.
    """

    key: str
    world_key: str
    scenario_label: str
    scenario: dict[str, Any]
    world: int
    solver_label: str
    solver: str
    settings: dict[str, Any]
    seed: int
    problem: str
    budget: int
    held_out: int = 0


@dataclass(frozen=True)
class RunGroup:
    """Runs that differ in their seeds only and advance together, see `comparisons.lockstep`.

    Attributes
    ----------
    runs : tuple of RunSpec
        The runs, at least one.
    """

    runs: tuple[RunSpec, ...]

    def __iter__(self) -> Iterator[RunSpec]:
        return iter(self.runs)

    def __len__(self) -> int:
        return len(self.runs)

    @property
    def world_key(self) -> str:
        """What a queue keeps the group under: a key of its own, since it visits many worlds."""
        return f"group {self.runs[0].key}"
