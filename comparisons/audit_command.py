"""The command ``navopt audit``; everything heavy is imported when it runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from comparisons.console import console, resumable

if TYPE_CHECKING:
    from comparisons.audit import Audit

__all__ = ["audit"]

NONE = "none"


def audit(
    solvers: Annotated[
        list[str],
        typer.Argument(
            metavar="SOLVER...",
            help="Solvers: foa, foa:encoding=reciprocal or foa:published; or one TOML file.",
        ),
    ],
    dimensions: Annotated[
        str | None, typer.Option(help="Numbers of variables, with commas; 2,10,30 if not given.")
    ] = None,
    functions: Annotated[
        str | None, typer.Option(help="Some of the test functions, with commas; all if not given.")
    ] = None,
    biases: Annotated[
        str | None, typer.Option(help="Some of origin, corner, orthant and rotation; all if not given.")
    ] = None,
    seeds: Annotated[int | None, typer.Option(help="Number of seeds; 20 if not given.")] = None,
    first_seed: Annotated[int | None, typer.Option(help="First of the seeds; 0 if not given.")] = None,
    budget: Annotated[int | None, typer.Option(help="Evaluations of each run; 2020 if not given.")] = None,
    references: Annotated[
        str | None,
        typer.Option(
            help="Solvers beside the audited, with commas, or none; "
            "random-search,nelder-mead,de,cmaes if not given."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Results folder; finished runs in it are not repeated.")] = Path(
        "results/audit"
    ),
    workers: Annotated[
        int | None, typer.Option(help="Number of processes; all available processors if not given.")
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Do failed runs again.")] = False,
) -> None:
    """Audit solvers for a preference of the origin, of a corner or of one orthant.

    Every function is run with its minimum in several places of the same box, and the gaps are compared
    seed by seed. The references take most of the time, once: a further audit in the same folder finds
    them done.
    """
    from comparisons.threads import THREAD_LIMITS

    # before numpy is imported, as in `navopt run`
    os.environ.update(THREAD_LIMITS)
    from rich.text import Text

    from comparisons.audit import run_audit
    from comparisons.audit_wording import verdict_table

    chosen = _chosen(
        solvers,
        dimensions=_numbers(dimensions),
        functions=_words(functions),
        biases=_words(biases),
        seeds=seeds,
        first_seed=first_seed,
        budget=budget,
        references=_words(references),
    )
    with resumable(out):
        result = run_audit(
            chosen, out=out, workers=workers, retry_failed=retry_failed, console=console(stderr=True)
        )
    screen = console()
    screen.print(verdict_table(result))
    screen.print(Text(result.text()))
    typer.echo(result.write((out if out.is_dir() else out.parent) / "audit.html"))


def _chosen(solvers: list[str], **given: Any) -> Audit:
    from comparisons.audit import Audit
    from comparisons.audit_solvers import audit_file
    from navopt.errors import InvalidInput

    values: dict[str, Any] = {"solvers": solvers}
    files = [text for text in solvers if text.endswith(".toml")]
    if files and len(solvers) > 1:
        raise InvalidInput("SOLVER", " ".join(solvers), "give solvers or one TOML file, not both")
    if files:
        values = audit_file(files[0])
    values.update({key: value for key, value in given.items() if value is not None})
    first = values.pop("first_seed", 0)
    count = values.get("seeds", 20)
    if isinstance(count, int):
        values["seeds"] = range(first, first + count)
    return Audit(**values)


def _words(text: str | None) -> list[str] | None:
    if text is None:
        return None
    return [] if text.strip() == NONE else [part.strip() for part in text.split(",")]


def _numbers(text: str | None) -> list[Any] | None:
    words = _words(text)
    return None if words is None else [int(word) if word.lstrip("-").isdigit() else word for word in words]
