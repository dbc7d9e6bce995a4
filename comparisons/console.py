"""What the commands share: the console they print on, and what Ctrl-C says."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["console", "resumable"]


def console(*, stderr: bool = False) -> Console:
    """Console as wide as the terminal, or wide enough for every table where there is none."""
    from rich.console import Console

    console = Console(stderr=stderr)
    # a file or a pipe has no width of its own, and rich's 80 columns break the ranked table's cells
    return console if console.is_terminal or "COLUMNS" in os.environ else Console(stderr=stderr, width=150)


@contextmanager
def resumable(folder: Path) -> Iterator[None]:
    """Let Ctrl-C end the command with code 130 and say where the finished runs are.

    Parameters
    ----------
    folder : pathlib.Path
        Results folder.
    """
    try:
        yield
    except KeyboardInterrupt:
        typer.echo(
            f"navopt: interrupted; every finished run is kept in {folder}. Give the same command to go on.",
            err=True,
        )
        raise typer.Exit(130) from None
