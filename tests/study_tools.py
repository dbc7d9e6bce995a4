"""Small sphere studies for the tests of `comparisons`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from comparisons.study import SolverEntry, Study

TOML = """
name = "small"
problem = "sphere"
worlds = 2
budget = 60
rank_by = "distance_1"

[scenarios.plane]
n_var = 2

[scenarios.space]
n_var = 3

[[solvers]]
name = "random-search"
settings = { pop_size = 20 }

[[solvers]]
name = "abc"
label = "bees"
settings = { pop_size = 6 }
"""


def small_study(**changes: Any) -> Study:
    """Eight quick runs on the sphere, changed as asked."""
    values: dict[str, Any] = {
        "name": "small",
        "problem": "sphere",
        "scenarios": {"plane": {"n_var": 2}, "space": {"n_var": 3}},
        "solvers": (
            SolverEntry("random-search", settings={"pop_size": 20}),
            SolverEntry("abc", "bees", {"pop_size": 6}),
        ),
        "worlds": (0, 1),
        "budget": 60,
        "rank_by": "distance_1",
    }
    return Study(**{**values, **changes})


def write_toml(folder: Path, *replacements: tuple[str, str], more: str = "") -> Path:
    """The small study as a file, with parts of its text replaced."""
    text = TOML
    for old, new in replacements:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = folder / "small.toml"
    path.write_text(text + more, encoding="utf-8")
    return path
