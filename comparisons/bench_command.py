"""The command ``navopt bench``; everything heavy is imported when it runs."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from comparisons.console import console

__all__ = ["bench"]

WHAT = ("filters", "unscented")


def bench(
    what: Annotated[str, typer.Argument(help="What to time: filters or unscented.")] = "filters",
    repeats: Annotated[int, typer.Option(help="Interleaved repetitions; medians count.")] = 9,
    compilation: Annotated[
        bool, typer.Option("--compilation/--no-compilation", help="Time compiling as well.")
    ] = True,
) -> None:
    """Time filters beside their peers, one thread each.

    `filters`: the batched Kalman filter beside filterpy and statsmodels, and one start of the innovation
    likelihood. `unscented`: the filters of heading-aided alignment over a record of 1,500 s at 100 Hz, beside
    filterpy's unscented filter on a short stretch of it. Needs the extra `bench`.
    """
    from comparisons.threads import THREAD_LIMITS

    # before numpy is imported, as in `navopt run`
    os.environ.update(THREAD_LIMITS)
    from comparisons.filter_speed import compile_seconds, filter_costs, speed_table, start_seconds
    from navopt.errors import InvalidInput, UnknownName

    if what not in WHAT:
        raise UnknownName("what", what, WHAT)
    if repeats < 1:
        raise InvalidInput("--repeats", repeats, "give at least 1")
    screen = console()
    if what == "unscented":
        from comparisons.unscented_speed import unscented_costs, unscented_table

        screen.print(unscented_table(unscented_costs(repeats=repeats)))
        return
    screen.print(speed_table(filter_costs(repeats=repeats)))
    screen.print(f"innovation likelihood, 1,000 steps: {start_seconds():.3f} s a start; 0.15 meant")
    if compilation:
        first, again = compile_seconds()
        screen.print(f"compiled in {first:.1f} s; in another process, from the cache, {again:.2f} s")
