"""The command ``navopt tune``; everything heavy is imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["tune"]


def tune(
    model: Annotated[Path, typer.Argument(help="Filter: TOML with F, H, G, B, x0, P0, Q, R.")],
    data: Annotated[Path, typer.Option(help="Log: CSV of measurements and inputs.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the results.")],
    solver: Annotated[
        str,
        typer.Option(help="Solver, with settings if need be: em, cmaes, innovation-likelihood:window=200."),
    ] = "innovation-likelihood",
    budget: Annotated[
        int | None, typer.Option(help="Largest cost (filter runs); the solver's own rule if not given.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of a stochastic solver.")] = 1,
) -> None:
    """Tune the noise covariances Q and R of your own Kalman filter and write them with a report."""
    import os

    from comparisons.threads import THREAD_LIMITS

    # one filter needs no more than one thread, and the same number gives the same last digits
    os.environ.update(THREAD_LIMITS)
    from comparisons.tune import tune_files
    from comparisons.tune_output import summary_lines
    from navopt.errors import InvalidInput

    if out.exists() and not out.is_dir():
        raise InvalidInput("--out", str(out), "give a folder, not a file")
    found = tune_files(model, data, solver=solver, budget=budget, seed=seed)
    found.write(out, inputs={"model": model, "data": data})
    for line in summary_lines(found):
        typer.echo(line)
    typer.echo(out)
