"""Tables of what can be compared: problems, solvers and studies."""

from __future__ import annotations

from typing import TYPE_CHECKING

from comparisons.study import list_studies, study_title
from navopt import registry

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["listing"]


def listing(kind: str) -> Table:
    """Table of everything of one kind.

    Parameters
    ----------
    kind : {"problems", "solvers", "studies"}
        What to list.

    Returns
    -------
    rich.table.Table
        One row each; what cannot be loaded keeps its row and says why.
    """
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=kind, title_justify="left")
    table.add_column("name", no_wrap=True)
    table.add_column("summary")
    if kind == "solvers":
        table.add_column("capabilities")
        table.add_column("needs")
    names, describe = {
        "problems": (registry.list_problems, _problem),
        "solvers": (registry.list_solvers, _solver),
        "studies": (list_studies, _study),
    }[kind]
    for name in names():
        try:
            table.add_row(name, *map(escape, describe(name)))
        except Exception as error:  # a plugin of anyone's may be broken: the others are still there
            table.add_row(name, escape(f"cannot be loaded: {type(error).__name__}: {error}"))
    return table


def _problem(name: str) -> list[str]:
    return [registry.problem_info(name).summary]


def _solver(name: str) -> list[str]:
    info = registry.solver_info(name)
    marks = {
        "stochastic": info.stochastic,
        "deterministic": not info.stochastic,
        "uses the whole budget": info.spends_all,
        "may stop early": not info.spends_all,
        "compares losses only": info.comparison_based,
        "not resumable": not info.resumable,
        f"at least {info.minimum_cost} evaluations": info.minimum_cost > 1,
    }
    needs = ", ".join(registry.CAPABILITIES[need] for need in info.needs)
    return [info.summary, ", ".join(mark for mark, holds in marks.items() if holds), needs or "any problem"]


def _study(name: str) -> list[str]:
    return [study_title(name)]
