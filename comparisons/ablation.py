"""Ablations: which ingredient of a solver does the work.

An `Ablation` makes an ordinary `Study` whose solvers are variants of one solver, run, resumed and
reported as any other; `comparisons.effect_table` says what each ingredient is worth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from comparisons.ablation_design import DESIGNS, Design
from comparisons.study import SolverEntry, Study, Success
from navopt.errors import InvalidInput

__all__ = ["Ablation"]

Place = str | tuple[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Ablation:
    """A solver taken apart: its variants on the same worlds, with the same seeds and budget.

    Parameters
    ----------
    base : str or (str, mapping)
        Registered solver, with settings if not its defaults.
    vary : mapping
        Per ingredient its other values. Under the name of an option of the base: a value or a list of
        values; those that the base has anyway are left out. Under any name: a mapping of levels, each a
        mapping of settings, for an ingredient of several options. A level with the key ``"solver"`` is
        that solver with the level's settings alone. So ``{"rotate": False}``, ``{"limit": [10, 50]}``,
        ``{"constraints": {"none": {"constrain_rotation": False, "constrain_scale": False}}}``.
    problems : sequence or mapping
        Where: registered problems, or pairs of one and the keywords of its ``simulate``; in a mapping,
        by the label that the scenario shall have.
    design : {"one-at-a-time", "factorial"}
        Change one ingredient of the base in each variant, or make all combinations.
    contrasts : mapping of str to (str, str), optional
        Ingredients that are a property of the problem, as two labels of scenarios: where it is as in the
        base, and where it is not. They are compared world by world, so a seed must mean the same world in
        both but for that property; and by a score, since losses of two problems do not compare.
    budget : int, default 2000
        Largest cost of each run.
    worlds : int or sequence of int, default 20
        World seeds, or how many of them from 0.
    seeds : sequence of int, default (1,)
        Solver seeds on each world.
    name, title, description : str
        For the results folder and the report; `name` is ``ablation-<base>`` if not given.
    rank_by : str, default "loss"
        Score that is compared, or ``"loss"``.
    display : mapping
        See `Study`.
    success : sequence of Success
        See `Study`.
    held_out, illustrate : int
        See `Study`.
    others : sequence of SolverEntry
        Solvers to show beside the variants; they take no part in the effects.

    Raises
    ------
    UnknownName
        If the base, one of its options or `design` is unknown; the nearest is suggested.
    InvalidInput
        If a value cannot be used.

    Examples
    --------
    >>> from comparisons import Ablation
    >>> vary = {"dimensions": "all", "scouts": ["one", "all"]}
    >>> ablation = Ablation("abc", vary=vary, problems=[("ackley", {"n_var": 3, "shift": True})])
    >>> [entry.label for entry in ablation.study().solvers]
    ['base', 'dimensions=all', 'scouts=all']
    """

    base: Place
    vary: Mapping[str, Any] = field(kw_only=True)
    problems: Sequence[Place] | Mapping[str, Place] = field(kw_only=True)
    design: str = field(default=DESIGNS[0], kw_only=True)
    contrasts: Mapping[str, Sequence[str]] = field(default_factory=dict, kw_only=True)
    budget: int = field(default=2000, kw_only=True)
    worlds: int | Sequence[int] = field(default=20, kw_only=True)
    seeds: Sequence[int] = field(default=(1,), kw_only=True)
    name: str = field(default="", kw_only=True)
    title: str = field(default="", kw_only=True)
    description: str = field(default="", kw_only=True)
    rank_by: str = field(default="loss", kw_only=True)
    display: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    success: Sequence[Success] = field(default=(), kw_only=True)
    held_out: int = field(default=0, kw_only=True)
    illustrate: int = field(default=1, kw_only=True)
    others: Sequence[SolverEntry] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        # faults show where the ablation is written, not where it is run
        self.study()

    def study(self) -> Study:
        """Study of all variants, to be run by `comparisons.run_study`."""
        base, settings = _named("base", self.base)
        contrasts = {name: list(pair) for name, pair in self.contrasts.items()}
        design = Design(base, settings, dict(self.vary), self.design, contrasts).reduced()
        scenarios = self._scenarios()
        worlds = tuple(range(self.worlds)) if isinstance(self.worlds, int) else tuple(self.worlds)
        first = next(iter(scenarios.values()))["problem"]
        alike = {scenario["problem"] for scenario in scenarios.values()} == {first}
        return Study(
            name=self.name or f"ablation-{base}",
            problem=first,
            scenarios={
                label: {key: value for key, value in scenario.items() if not (alike and key == "problem")}
                for label, scenario in scenarios.items()
            },
            solvers=tuple(self.others),
            worlds=worlds,
            budget=self.budget,
            seeds=tuple(self.seeds),
            title=self.title,
            description=self.description,
            rank_by=self.rank_by,
            display=dict(self.display),
            success=tuple(self.success),
            held_out=self.held_out,
            illustrate=self.illustrate,
            ablation=design.to_table(),
        )

    def _scenarios(self) -> dict[str, dict[str, Any]]:
        given = self.problems
        if isinstance(given, str) or not given:
            raise InvalidInput("problems", given, "give a list of problems, or a mapping from labels to them")
        scenarios: dict[str, dict[str, Any]] = {}
        for label, place in given.items() if isinstance(given, Mapping) else (("", place) for place in given):
            problem, keywords = _named("problems", place)
            words = ", ".join(f"{key}={value}" for key, value in keywords.items())
            label = label or (f"{problem}: {words}" if words else problem)
            if label in scenarios:
                raise InvalidInput("problems", label, "each may occur once only")
            scenarios[label] = {"problem": problem, **keywords}
        return scenarios

    @classmethod
    def from_study(cls, study: Study) -> Ablation:
        """Return the ablation that a study is.

        Raises
        ------
        InvalidInput
            If it is none.
        """
        if not study.ablation:
            raise InvalidInput("study", study.name, "give a study with an [ablation] table")
        design = Design.from_table(study.ablation)
        return cls(
            (design.base, design.settings),
            vary=design.vary,
            problems={label: study.place(label) for label in study.scenarios},
            design=design.design,
            contrasts=design.contrasts,
            budget=study.budget,
            worlds=study.worlds,
            seeds=study.seeds,
            name=study.name,
            title=study.title,
            description=study.description,
            rank_by=study.rank_by,
            display=study.display,
            success=study.success,
            held_out=study.held_out,
            illustrate=study.illustrate,
            others=study.others,
        )

    @classmethod
    def from_toml(cls, path: str | Path) -> Ablation:
        """Read an ablation from a study file with an ``[ablation]`` table; see `Study.from_toml`.

        The table has the keys ``base``, ``settings``, ``design``, ``vary`` and ``contrasts``; the rest of
        the file is as in any study, and ``[[solvers]]`` are the `others`.
        """
        return cls.from_study(Study.from_toml(path))


def _named(argument: str, place: Any) -> tuple[str, dict[str, Any]]:
    """Registered name and its keywords."""
    if isinstance(place, str):
        return place, {}
    if isinstance(place, Sequence) and len(place) == 2:
        name, keywords = place
        if isinstance(name, str) and isinstance(keywords, Mapping):
            return name, dict(keywords)
    raise InvalidInput(argument, place, "give a registered name, or a pair of one and its keywords")
