"""What a comparative study is: problem × scenarios × worlds × solvers × seeds at one budget.

A `Study` is a plain object. Its TOML form is read by `Study.from_toml`; studies that come with the
package are opened by name with `Study.named`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from comparisons.ablation_design import Design
from comparisons.entries import Bound, Printed, RunSpec, SolverEntry, Success
from comparisons.study_file import parse, read_toml
from navopt.errors import InvalidInput, UnknownName

__all__ = ["Bound", "Printed", "RunSpec", "SolverEntry", "Study", "Success", "list_studies", "study_title"]

#: Keys of `Study.display`: factor on the score, the unit it then has, and what the score is called.
DISPLAY_KEYS = ("label", "scale", "unit")


@dataclass(frozen=True)
class Study:
    """A comparison of solvers at equal cost over many worlds.

    Attributes
    ----------
    name : str
        Short name, also of the default results folder: letters, digits, ``-``, ``_`` and ``.``.
    problem : str
        Registered problem.
    scenarios : dict of str to dict
        Keywords of the problem's ``simulate`` by scenario label; at least one. The key ``problem`` names
        another registered problem for one scenario.
    solvers : tuple of SolverEntry
        The competitors, with labels that differ; the variants of `ablation` come first by themselves.
    worlds : tuple of int
        World seeds.
    budget : int
        Largest cost of each run.
    seeds : tuple of int, default (1,)
        Solver seeds on each world.
    seed_per_world : bool, default False
        Each world has one solver seed of its own, the world's plus one, in place of `seeds`: where all
        worlds are alike (a function that is not disguised), runs differ by nothing else.
    title, description : str
        For the report.
    rank_by : str, default "loss"
        Score key that ranks the solvers, or ``"loss"``; ``"held_out."`` and a score ranks by its mean over
        the redrawn twins.
    display : dict
        How to print `rank_by`: ``scale`` (factor), ``unit`` (after scaling), ``label``; all optional.
    success : tuple of Success
        What counts as a match.
    bound : tuple of Bound
        Bounds on errors, to show each method's root mean square error over that of its bound.
    held_out : int, default 0
        Number of redrawn twins that each solution is applied to.
    illustrate : int, default 1
        Number of worlds per scenario whose illustration is kept.
    lockstep : bool, default False
        Runs of a swarm that differ in their seeds only advance together: the same results in a fraction
        of the time, see `comparisons.lockstep`.
    groups : dict of str to tuple of str
        Scenarios, by their labels, over which solvers are ranked together; all of them if empty.
    printed : tuple of Printed
        Numbers of publications to stand beside those of the study.
    curve : tuple of str
        Keywords of the scenarios over which the report draws the scores, see `comparisons.curves`.
    ablation : dict
        What the study takes apart, as `comparisons.ablation_design.Design` has it; empty for a comparison.

    Raises
    ------
    InvalidInput
        If a value cannot be used.
    UnknownName
        If `display` has an unknown key, or a group or printed value names an unknown scenario or solver.
    """

    name: str
    problem: str
    scenarios: dict[str, dict[str, Any]]
    solvers: tuple[SolverEntry, ...]
    worlds: tuple[int, ...]
    budget: int
    seeds: tuple[int, ...] = (1,)
    title: str = ""
    description: str = ""
    rank_by: str = "loss"
    display: dict[str, Any] = field(default_factory=dict)
    success: tuple[Success, ...] = ()
    bound: tuple[Bound, ...] = ()
    held_out: int = 0
    illustrate: int = 1
    seed_per_world: bool = False
    lockstep: bool = False
    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)
    printed: tuple[Printed, ...] = ()
    curve: tuple[str, ...] = ()
    ablation: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.ablation:
            design = Design.from_table(self.ablation)
            object.__setattr__(self, "ablation", design.to_table())
            object.__setattr__(self, "solvers", (*_variants(design), *self.others))
        plain = {
            "scenarios": {label: dict(scenario) for label, scenario in self.scenarios.items()},
            "solvers": tuple(self.solvers),
            "worlds": tuple(self.worlds),
            "seeds": tuple(self.seeds),
            "display": dict(self.display),
            "success": tuple(self.success),
            "bound": tuple(one if one.score else replace(one, score=self.rank_by) for one in self.bound),
            "groups": {name: tuple(labels) for name, labels in self.groups.items()},
            "curve": tuple(self.curve),
            "printed": tuple(
                value if value.score else replace(value, score=self.rank_by) for value in self.printed
            ),
            "title": self.title or self.name,
        }
        for key, value in plain.items():
            object.__setattr__(self, key, value)
        if not isinstance(self.name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", self.name):
            raise InvalidInput("name", self.name, "use letters, digits, '-', '_' and '.': it names a folder")
        for argument in ("scenarios", "solvers"):
            if not getattr(self, argument):
                raise InvalidInput(argument, getattr(self, argument), "give at least one")
        _distinct("labels of solvers", tuple(entry.label for entry in self.solvers))
        _distinct("labels of bounds", tuple(one.label for one in self.bound))
        _seeds("worlds", self.worlds)
        _seeds("seeds", self.seeds)
        _whole("budget", self.budget, 1)
        _whole("held_out", self.held_out, 0)
        _whole("illustrate", self.illustrate, 0)
        if self.rank_by.startswith("held_out.") and not self.held_out:
            raise InvalidInput("rank_by", self.rank_by, "set held_out to the number of redrawn twins")
        if self.seed_per_world and (self.seeds != (1,) or self.ablation):
            raise InvalidInput(
                "seed_per_world", True, "leave out seeds; an ablation pairs its runs by their seeds"
            )
        for key in self.display:
            if key not in DISPLAY_KEYS:
                raise UnknownName("display", key, DISPLAY_KEYS)
        self._check_labels()
        _distinct("curve", self.curve)
        if self.curve:
            from comparisons.curves import study_curves

            study_curves(self)
        for name, pair in self.ablation.get("contrasts", {}).items():
            for label in pair:
                if label not in self.scenarios:
                    raise UnknownName(f"scenario of contrast {name!r}", label, self.scenarios)
            if self.rank_by == "loss":
                raise InvalidInput("rank_by", "loss", "losses of two scenarios do not compare: name a score")

    def _check_labels(self) -> None:
        """Refuse groups and printed values of scenarios or solvers that the study does not have."""
        for name, labels in self.groups.items():
            if not labels:
                raise InvalidInput(f"groups.{name}", [], "name at least one scenario")
            _distinct(f"groups.{name}", labels)
            for label in labels:
                if label not in self.scenarios:
                    raise UnknownName(f"scenario of groups.{name}", label, self.scenarios)
        solvers = [entry.label for entry in self.solvers]
        for value in self.printed:
            if value.scenario not in self.scenarios and value.scenario not in self.groups:
                known = [*self.scenarios, *self.groups]
                raise UnknownName("scenario of a printed value", value.scenario, known)
            if value.solver not in solvers:
                raise UnknownName("solver of a printed value", value.solver, solvers)
        same = [
            f"{v.source}: {v.solver!r} in {v.scenario!r}, {v.score} {v.statistic} {v.below or ''}".strip()
            for v in self.printed
        ]
        _distinct("printed", tuple(same))

    # -- where studies come from -----------------------------------------------------------------
    @classmethod
    def from_toml(cls, path: str | Path) -> Study:
        """Read a study file and check that everything it names exists.

        Parameters
        ----------
        path : path-like
            A TOML file; the keys are the attributes of this class, with ``[scenarios."label"]``,
            ``[[solvers]]``, ``[[success]]``, ``[[bound]]``, ``[[printed]]``, ``[groups]`` and ``[display]``
            tables. Where a keyword named by ``curve`` has a list of numbers, the scenario stands for one
            with each, their values after its label, and its label for all of them in ``[groups]``.
            ``worlds`` is a list of seeds, or a count together with ``first_world`` (0 by default). In a
            ``[[printed]]`` table, ``values`` may stand for ``solver`` and ``value``, a table from solvers
            to their values. An ``[ablation]`` table makes the solvers; values that its base has anyway are
            left out.

        Returns
        -------
        Study

        Raises
        ------
        InvalidInput
            If the file cannot be read or a value cannot be used.
        UnknownName
            If a key, problem, scenario key, solver or setting is unknown; the nearest is suggested.
        """
        study = cls.from_dict(read_toml(Path(path)), source=str(path))
        if study.ablation:
            from comparisons.planning import naming

            with naming(str(path)):
                design = Design.from_table(study.ablation).reduced()
                study = replace(study, ablation=design.to_table(), solvers=study.others)
        study.check(source=str(path))
        return study

    @classmethod
    def named(cls, name: str) -> Study:
        """Open a study that comes with the package, see `list_studies`; errors as `from_toml`."""
        return cls.from_toml(_embedded(name))

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], *, source: str = "study") -> Study:
        """Build a study from the tables of its TOML form; the registries are not asked.

        Parameters
        ----------
        document : mapping
            Keys and values as in the TOML form.
        source : str, keyword-only
            Where it comes from, for error messages.
        """
        values = parse(document, source)
        try:
            values["solvers"] = tuple(SolverEntry(**entry) for entry in values["solvers"])
            values["success"] = tuple(Success(**entry) for entry in values["success"])
            values["bound"] = tuple(Bound(**entry) for entry in values["bound"])
            values["printed"] = tuple(Printed(**entry) for entry in values["printed"])
            return cls(**values)
        except UnknownName as error:
            raise UnknownName(f"{source}: {error.argument}", error.value.strip("'\""), error.known) from None
        except InvalidInput as error:
            raise InvalidInput(f"{source}: {error.argument}", error.value, error.remedy) from None

    def to_dict(self) -> dict[str, Any]:
        """Tables of the TOML form; `from_dict` gives the same study back."""
        tables = asdict(self)
        if self.ablation:
            tables["solvers"] = [asdict(entry) for entry in self.others]
        else:
            del tables["ablation"]
        return tables

    def replaced(self, *, worlds: int | None = None, budget: int | None = None) -> Study:
        """Study with another number of worlds or another budget.

        Parameters
        ----------
        worlds : int, optional
            Number of worlds: the first ones of this study, and beyond them the seeds after its largest.
        budget : int, optional
            Largest cost of each run.
        """
        changes: dict[str, Any] = {}
        if worlds is not None:
            count = _whole("worlds", worlds, 1)
            beyond = max(self.worlds) + 1
            further = range(beyond, beyond + max(count - len(self.worlds), 0))
            changes["worlds"] = (*self.worlds[:count], *further)
        if budget is not None:
            changes["budget"] = budget
        return replace(self, **changes)

    # -- what it asks for ------------------------------------------------------------------------
    @property
    def others(self) -> tuple[SolverEntry, ...]:
        """Solvers that are not variants of `ablation`; all of them without one."""
        made = _variants(Design.from_table(self.ablation)) if self.ablation else ()
        return tuple(entry for entry in self.solvers if entry not in made)

    def seeds_of(self, world: int) -> tuple[int, ...]:
        """Solver seeds on a world."""
        return (world + 1,) if self.seed_per_world else self.seeds

    def place(self, scenario: str) -> tuple[str, dict[str, Any]]:
        """Registered problem of a scenario, by its label, and the keywords of its ``simulate``."""
        keywords = dict(self.scenarios[scenario])
        return keywords.pop("problem", self.problem), keywords

    def check(self, *, source: str = "study") -> None:
        """Refuse unknown problems, scenario keys, solvers and settings before anything runs.

        Parameters
        ----------
        source : str, keyword-only
            Where the study comes from, for error messages.

        Raises
        ------
        UnknownName
            If a name is not registered or accepted.
        InvalidInput
            If a setting has an unusable value, or two entries ask for the same run.
        """
        from comparisons.planning import check_names, plan

        check_names(self, source)
        plan(self, source)

    def runs(self) -> list[RunSpec]:
        """Every run of the study, ordered by scenario, world, solver and seed; errors as `check`."""
        from comparisons.planning import plan

        return plan(self, "study")


def list_studies() -> list[str]:
    """Names of the studies that come with the package, sorted."""
    found = (files("comparisons") / "studies").iterdir()
    return sorted(item.name.removesuffix(".toml") for item in found if item.name.endswith(".toml"))


def study_title(name: str) -> str:
    """Title of a study that comes with the package; the registries are not asked."""
    document = read_toml(_embedded(name))
    return str(document.get("title", name))


def _variants(design: Design) -> tuple[SolverEntry, ...]:
    return tuple(SolverEntry(v.solver, v.label, v.settings) for v in design.variants())


def _embedded(name: str) -> Path:
    known = list_studies()
    if name not in known:
        raise UnknownName("study", name, known)
    return Path(str(files("comparisons") / "studies" / f"{name}.toml"))


def _whole(argument: str, value: Any, lowest: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < lowest:
        raise InvalidInput(argument, value, f"give a whole number, at least {lowest}")
    return value


def _seeds(argument: str, values: tuple[int, ...]) -> None:
    if not values:
        raise InvalidInput(argument, values, "give at least one seed")
    for value in values:
        _whole(argument, value, 0)
    _distinct(argument, values)


def _distinct(argument: str, values: tuple[Any, ...]) -> None:
    twice = sorted({str(value) for value in values if values.count(value) > 1})
    if twice:
        raise InvalidInput(argument, ", ".join(twice), "each may occur once only")
