"""The command ``navopt bbob``; everything heavy is imported when it runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from comparisons.console import console, resumable

__all__ = ["bbob"]


def bbob(
    solvers: Annotated[
        list[str],
        typer.Argument(metavar="SOLVER...", help="Solvers: abc, abc:limit=50 or nafsa:published."),
    ],
    dimensions: Annotated[str, typer.Option(help="Numbers of variables, with commas.")] = "2,5",
    functions: Annotated[
        str | None, typer.Option(help="Some of the functions, such as 1,8,15-19; all 24 if not given.")
    ] = None,
    instances: Annotated[
        str, typer.Option(help="How many instances, from the first on; with a comma or dash: which.")
    ] = "5",
    budget_factor: Annotated[int, typer.Option(help="Evaluations of each run per variable.")] = 200,
    out: Annotated[Path, typer.Option(help="Results folder; finished runs in it are not repeated.")] = Path(
        "results/bbob"
    ),
    workers: Annotated[
        int | None, typer.Option(help="Number of processes; all available processors if not given.")
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Do failed runs again.")] = False,
) -> None:
    """Run solvers on the 24 BBOB functions and show how many targets they reach how soon.

    Needs the extra `bench`. Every run is kept in the results folder, so another solver in the same folder
    only adds its own runs.
    """
    from comparisons.threads import THREAD_LIMITS

    # before numpy is imported, as in `navopt run`
    os.environ.update(THREAD_LIMITS)
    from comparisons.bbob import Benchmark, run_benchmark
    from comparisons.bbob_report import share_listing

    which = _numbers("--instances", instances)
    chosen = Benchmark(
        solvers,  # type: ignore[arg-type]
        dimensions=_numbers("--dimensions", dimensions),
        instances=which[0] if instances.strip().isdigit() else which,  # type: ignore[arg-type]
        budget_factor=budget_factor,
        **({} if functions is None else {"functions": _numbers("--functions", functions)}),
    )
    with resumable(out):
        result = run_benchmark(
            chosen, out=out, workers=workers, retry_failed=retry_failed, console=console(stderr=True)
        )
    screen = console()
    for dimension in chosen.dimensions:
        screen.print(share_listing(result, dimension))
    failed = int((result.runs["status"] == "failed").sum())
    if failed:
        typer.echo(f"navopt: {failed} of {len(result.runs)} runs failed; the page says why.", err=True)
    typer.echo(result.write(out if out.is_dir() else out.parent))
    if failed == len(result.runs):
        raise typer.Exit(1)


def _numbers(option: str, text: str) -> tuple[int, ...]:
    """Whole numbers with commas, and ranges such as 15-19."""
    from navopt.errors import InvalidInput

    numbers: list[int] = []
    for part in text.split(","):
        ends = [end.strip() for end in part.split("-")]
        if not all(end.isdigit() for end in ends) or len(ends) > 2:
            raise InvalidInput(option, text, "give whole numbers with commas, or ranges such as 15-19")
        numbers += range(int(ends[0]), int(ends[-1]) + 1)
    return tuple(numbers)
