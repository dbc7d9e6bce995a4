"""What a study was and how to run it again, in words, tables and TOML, from its store."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import pandas as pd

from comparisons.study import Study, list_studies
from navopt import registry
from navopt.errors import NavoptError

__all__ = ["checksums", "commands", "facts", "in_words", "solver_rows", "study_toml"]


def in_words(values: dict[str, Any]) -> str:
    """Keywords as ``key = value, …``; what stands for none of them otherwise."""
    return ", ".join(f"{key} = {value}" for key, value in values.items()) or "all defaults"


def _seeds(values: tuple[int, ...]) -> str:
    if len(values) == 1:
        return f"1 (seed {values[0]})"
    if list(values) == list(range(values[0], values[-1] + 1)):
        return f"{len(values)} (seeds {values[0]} to {values[-1]})"
    return f"{len(values)} (seeds {', '.join(map(str, values))})"


def facts(store: Any, study: Any, runs: pd.DataFrame) -> list[tuple[str, str]]:
    """Say what was run, as pairs of a name and a text."""
    names = dict.fromkeys(study.place(label)[0] for label in study.scenarios)
    found = [
        *(("Problem", _problem(name)) for name in names),
        ("Worlds per scenario", _seeds(study.worlds)),
        (
            "Solver seeds per world",
            "1 (the world's seed plus one)" if study.seed_per_world else _seeds(study.seeds),
        ),
        ("Budget per run", f"{study.budget} model evaluations"),
        ("Ranked by", study.rank_by),
    ]
    found += [("Bound", f"{one.label}: {one.over} on {one.score}") for one in study.bound]
    if study.held_out:
        found.append(
            ("Held-out data", f"each solution applied to {study.held_out} redrawn twins of its world")
        )
    versions = _versions(store, runs)
    if versions:
        found.append(("Versions", ", ".join(f"{name} {number}" for name, number in versions.items())))
    if len(runs) and "finished" in runs:
        first, last = (f"{str(end)[:16].replace('T', ' ')} UTC" for end in _ends(runs["finished"]))
        found.append(("Runs finished", first if first == last else f"{first} to {last}"))
    return found


def _problem(name: str) -> str:
    try:
        return f"{name}: {registry.problem_info(name).summary}"
    except NavoptError:  # a problem of a package that is not installed here
        return name


def _ends(values: pd.Series) -> tuple[Any, Any]:
    return values.min(), values.max()


def _versions(store: Any, runs: pd.DataFrame) -> dict[str, str]:
    for settings in runs["settings"] if len(runs) else ():
        if settings.get("versions"):
            return dict(settings["versions"])
    return dict(store.meta.get("versions") or {})


def checksums(study: Any, runs: pd.DataFrame) -> list[tuple[str, str]]:
    """Checksum of the data behind each scenario; only if it is sure to be that of the runs.

    The key of every run is a digest of, among others, the checksum of its data. Where the keys made today
    are those in the store, the checksum of today is the one that was used.
    """
    try:
        keys = {spec.key for spec in study.runs()}
        if not len(runs) or not set(runs["key"]) <= keys:
            return []
        found = []
        for label in study.scenarios:
            problem, words = study.place(label)
            found.append((label, str(registry.problem_class(problem).data_checksum(**words))))
    except NavoptError:
        return []
    found = [(label, text) for label, text in found if text and text != "None"]
    if len(found) == len(study.scenarios) and len({text for _, text in found}) == 1:
        return [("all scenarios", found[0][1])]
    return found


def solver_rows(study: Any, runs: pd.DataFrame) -> list[dict[str, Any]]:
    """Label, registered name, full settings and source of each solver."""
    rows = []
    for entry in study.solvers:
        own = runs[runs["solver"] == entry.label] if len(runs) else runs
        # a failed run may only know what it was given; another run of the solver knows all settings
        options = (
            max((s.get("options") or {} for s in own["settings"]), key=len, default={}) if len(own) else {}
        )
        try:
            info = registry.solver_info(entry.name)
            summary, source = info.summary, info.source
        except NavoptError:  # a solver of a package that is not installed here
            summary, source = "", ""
        given = [f"{key} = {value}" for key, value in entry.settings.items()]
        default = [f"{key} = {value}" for key, value in options.items() if key not in entry.settings]
        rows.append(
            {
                "label": entry.label,
                "name": entry.name,
                "summary": summary,
                "source": source,
                "given": ", ".join(given),
                "default": ", ".join(default),
            }
        )
    return rows


def commands(study: Any) -> list[str]:
    """Commands that run the study again and report it."""
    folder = f"results/{study.name}"
    asked = f"navopt run study.toml --out {folder}"
    if study.name in list_studies():
        try:
            shipped = Study.named(study.name)
            if shipped.to_dict() == study.to_dict():
                asked = f"navopt run {study.name} --out {folder}"
            elif shipped.replaced(worlds=len(study.worlds), budget=study.budget).to_dict() == study.to_dict():
                changes = f"--worlds {len(study.worlds)} --budget {study.budget}"
                asked = f"navopt run {study.name} {changes} --out {folder}"
        except (NavoptError, AttributeError):
            pass
    return [asked, f"navopt report {folder}"]


def study_toml(study: Any) -> str:
    """Return the definition of the study as the file that would run it."""
    lines = [f"{key} = {_toml(getattr(study, key))}" for key in ("name", "title", "description", "problem")]
    lines += [f"{key} = {_toml(list(getattr(study, key)))}" for key in ("worlds", "seeds")]
    lines += [
        f"{key} = {_toml(getattr(study, key))}" for key in ("budget", "held_out", "illustrate", "rank_by")
    ]
    lines += [f"{key} = true" for key in ("seed_per_world", "lockstep") if getattr(study, key)]
    if study.curve:
        lines.append(f"curve = {_toml(list(study.curve))}")
    if study.display:
        lines += ["", "[display]", *(f"{key} = {_toml(value)}" for key, value in study.display.items())]
    for success in study.success:
        lines += [
            "",
            "[[success]]",
            f"score = {_toml(success.score)}",
            f"below = {_toml(list(success.below))}",
        ]
        lines.append(f"labels = {_toml(list(success.labels))}")
    for one in study.bound:
        lines += ["", "[[bound]]", *(f"{key} = {_toml(item)}" for key, item in asdict(one).items())]
    if study.groups:
        lines += ["", "[groups]"]
        lines += [f"{_toml(name)} = {_toml(labels)}" for name, labels in study.groups.items()]
    for label, scenario in study.scenarios.items():
        lines += ["", f"[scenarios.{_toml(label)}]"]
        lines += [f"{key} = {_toml(value)}" for key, value in scenario.items() if value is not None]
    if study.ablation:
        table = {key: value for key, value in study.ablation.items() if value}
        inner = {key: table.pop(key) for key in ("vary", "contrasts") if key in table}
        lines += ["", "[ablation]", *(f"{key} = {_toml(value)}" for key, value in table.items())]
        for name, values in inner.items():
            lines += ["", f"[ablation.{name}]"]
            lines += [f"{_toml(key)} = {_toml(value)}" for key, value in values.items()]
    for entry in study.others:
        lines += ["", "[[solvers]]", f"name = {_toml(entry.name)}", f"label = {_toml(entry.label)}"]
        if entry.settings:
            lines.append(f"settings = {_toml(entry.settings)}")
    for value in study.printed:
        lines += ["", "[[printed]]"]
        lines += [f"{key} = {_toml(item)}" for key, item in asdict(value).items() if item not in (None, "")]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        inside = ", ".join(f"{_toml(str(k))} = {_toml(v)}" for k, v in value.items() if v is not None)
        return f"{{ {inside} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(item) for item in value)}]"
    if isinstance(value, int | float):
        return repr(value)
    # TOML's basic strings escape as JSON's do
    return json.dumps(str(value), ensure_ascii=False)
