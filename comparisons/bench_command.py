"""The command ``navopt bench``; everything heavy is imported when it runs."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from comparisons.console import console

__all__ = ["bench"]

WHAT = ("filters",)


def bench(
    what: Annotated[str, typer.Argument(help="What to time: filters.")] = "filters",
    repeats: Annotated[int, typer.Option(help="Interleaved repetitions; medians count.")] = 9,
    compilation: Annotated[
        bool, typer.Option("--compilation/--no-compilation", help="Time compiling as well.")
    ] = True,
) -> None:
    """Time the batched Kalman filter beside filterpy and statsmodels, one thread each.

    Needs the extra `bench`.
    """
    from comparisons.threads import THREAD_LIMITS

    # before numpy is imported, as in `navopt run`
    os.environ.update(THREAD_LIMITS)
    from comparisons.filter_speed import compile_seconds, filter_costs, speed_table
    from navopt.errors import InvalidInput, UnknownName

    if what not in WHAT:
        raise UnknownName("what", what, WHAT)
    if repeats < 1:
        raise InvalidInput("--repeats", repeats, "give at least 1")
    screen = console()
    screen.print(speed_table(filter_costs(repeats=repeats)))
    if compilation:
        first, again = compile_seconds()
        screen.print(f"compiled in {first:.1f} s; in another process, from the cache, {again:.2f} s")
