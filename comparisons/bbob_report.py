"""What a BBOB benchmark leaves behind: one HTML page, the figures as files, and two CSV tables."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from comparisons.bbob_figures import runtime_figure
from comparisons.bbob_functions import FUNCTIONS, GROUPS, BbobFunction
from comparisons.bbob_measures import TARGETS
from comparisons.drawing import render, solver_styles
from comparisons.pages import data_source, environment, style, write_text
from comparisons.planning import full_settings
from comparisons.run_key import versions
from comparisons.wording import format_number
from navopt.errors import StoreError

if TYPE_CHECKING:
    from rich.table import Table

    from comparisons.bbob import BenchmarkResult

__all__ = ["share_cells", "share_listing", "write_benchmark"]

#: Targets whose expected running times the page shows; the CSV file has all.
SHOWN = (1e1, 1e-1, 1e-3, 1e-8)
#: Dots per inch of the figures written as PNG.
DPI = 100


def write_benchmark(result: BenchmarkResult, folder: str | Path) -> Path:
    """Write ``bbob.html``, ``ecdf-<dimension>.svg`` and ``.png``, ``shares.csv`` and ``running-times.csv``.

    The page holds its figures and style itself; the same results give the same bytes.

    Parameters
    ----------
    result : BenchmarkResult
        The benchmark.
    folder : path-like
        Where to; created if need be.

    Returns
    -------
    pathlib.Path
        The HTML file.

    Raises
    ------
    StoreError
        If a file cannot be written there.
    """
    target = Path(folder)
    templates = environment()
    pictures = []
    for dimension in result.benchmark.dimensions if len(result.runs) else ():
        drawn = _write_figure(target / f"ecdf-{dimension}", runtime_figure(result, dimension))
        pictures.append(
            {
                "source": data_source(drawn),
                "alt": f"Share of targets reached against evaluations, {dimension} variables",
                "caption": "Share of all pairs of a run and a target reached, by evaluations per variable.",
            }
        )
    times = result.expected_running_times()
    page = templates.get_template("bbob.html.j2").render(
        _context(result, times, pictures), style=style(templates)
    )
    write_text(target / "bbob.html", page)
    for name, frame in (
        ("shares.csv", result.shares),
        ("running-times.csv", times),
    ):
        write_text(target / name, frame.to_csv(index=False, lineterminator="\n"))
    return target / "bbob.html"


def _write_figure(path: Path, figure: Any) -> bytes:
    """Write a figure in both formats and return the SVG; drawing takes seconds, so it is done once each."""
    drawn = {kind: render(figure, format=kind, dpi=DPI) for kind in ("svg", "png")}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for kind, data in drawn.items():
            path.with_suffix(f".{kind}").write_bytes(data)
    except OSError as error:
        raise StoreError(
            f"out: cannot write {path} ({error.strerror}); give a folder you may write to"
        ) from error
    return drawn["svg"]


def share_cells(shares: pd.DataFrame, dimension: int) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table of shares of one dimension, in per cent.

    Parameters
    ----------
    shares : pandas.DataFrame
        From `comparisons.bbob_measures.share_table`.
    dimension : int
        Number of variables.
    """
    table = shares[shares["dimension"] == dimension]
    shown = [name for name in GROUPS if table[name].notna().any()]
    rows = []
    for row in table.to_dict("records"):
        interval = "" if np.isnan(row["low"]) else f" [{100 * row['low']:.1f}, {100 * row['high']:.1f}]"
        cells = [_percent(row["all"]) + interval, *(_percent(row[name]) for name in shown)]
        rows.append([str(row["solver"]), *cells])
    return ["solver", "all functions", *shown], rows


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:.1f}"


def share_listing(result: BenchmarkResult, dimension: int) -> Table:
    """Table of shares of one dimension for the terminal.

    Parameters
    ----------
    result : BenchmarkResult
        The benchmark.
    dimension : int
        Number of variables.
    """
    from rich import box
    from rich.table import Table as RichTable

    headings, rows = share_cells(result.shares, dimension)
    benchmark = result.benchmark
    table = RichTable(
        title=f"BBOB, {dimension} variables: % of {len(TARGETS)} targets reached within "
        f"{benchmark.budget_factor * dimension} evaluations (95 % interval over instances)",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
        title_justify="left",
    )
    for k, heading in enumerate(headings):
        table.add_column(heading, justify="right" if k else "left", no_wrap=k < 2)
    for row in rows:
        table.add_row(*row)
    return table


def _context(result: BenchmarkResult, times: pd.DataFrame, pictures: list[dict[str, str]]) -> dict[str, Any]:
    benchmark = result.benchmark
    study = benchmark.study()
    planned = len(study.scenarios) * len(benchmark.instances) * len(benchmark.solvers)
    failed = result.runs[result.runs["status"] == "failed"] if len(result.runs) else result.runs
    tables = []
    if len(result.runs):
        for dimension, picture in zip(benchmark.dimensions, pictures, strict=True):
            headings, rows = share_cells(result.shares, dimension)
            tables.append(
                {
                    "dimension": dimension,
                    "picture": picture,
                    "headings": headings,
                    "rows": rows,
                    "times": _times(result, times, dimension),
                }
            )
    return {
        "planned": planned,
        "missing": planned - len(result.runs),
        "failed": [
            f"{solver}: {count} × {cause}"
            for (solver, cause), count in failed.groupby(["solver", "error"], sort=False).size().items()
        ]
        if len(failed)
        else [],
        "dimensions": tables,
        "labels": [entry.label for entry in benchmark.solvers],
        "targets": [f"{target:g}" for target in SHOWN],
        "colours": {label: style.colour for label, style in solver_styles(study).items()},
        "facts": [
            ("Functions", ", ".join(f"f{number}" for number in benchmark.functions)),
            ("Instances", ", ".join(map(str, benchmark.instances))),
            ("Dimensions", ", ".join(map(str, benchmark.dimensions))),
            ("Budget per run", f"{benchmark.budget_factor} evaluations per variable, one run, no restarts"),
            ("Targets", f"{len(TARGETS)} gaps to the minimum, from {TARGETS[0]:g} to {TARGETS[-1]:g}"),
            ("Runs", f"{len(result.runs)} of {planned}"),
            (
                "Versions",
                ", ".join(
                    [
                        BbobFunction.data_checksum(),
                        *(f"{name} {number}" for name, number in versions().items()),
                    ]
                ),
            ),
        ],
        "solvers": [
            {
                "label": entry.label,
                "name": entry.name,
                "given": ", ".join(f"{key} = {value}" for key, value in entry.settings.items()),
                "default": ", ".join(
                    f"{key} = {value}"
                    for key, value in full_settings(entry.name, entry.settings).items()
                    if key not in entry.settings
                ),
            }
            for entry in benchmark.solvers
        ],
        "command": _command(result),
    }


def _times(result: BenchmarkResult, times: pd.DataFrame, dimension: int) -> list[dict[str, Any]]:
    """Expected running times per variable, a row per function, cells per solver of the shown targets."""
    table = times[times["dimension"] == dimension]
    shown = [int(np.argmin(np.abs(np.log10(TARGETS) - np.log10(target)))) for target in SHOWN]
    rows = []
    for function in result.benchmark.functions:
        cells = []
        for entry in result.benchmark.solvers:
            own = table[(table["function"] == function) & (table["solver"] == entry.label)]
            values = own["expected_cost"].to_numpy()[shown] / dimension if len(own) else [np.nan] * len(shown)
            cells.append(" · ".join(format_number(float(value), digits=2) for value in values))
        rows.append({"label": f"f{function} {FUNCTIONS[function]}", "cells": cells})
    return rows


def _command(result: BenchmarkResult) -> str:
    benchmark = result.benchmark
    names = " ".join(f"'{entry.label}'" if "," in entry.label else entry.label for entry in benchmark.solvers)
    some = "" if benchmark.functions == tuple(FUNCTIONS) else f" --functions {_list(benchmark.functions)}"
    instances = benchmark.instances
    count = len(instances) if instances == tuple(range(1, len(instances) + 1)) else _list(instances)
    return (
        f"navopt bbob {names} --dimensions {_list(benchmark.dimensions)}{some} --instances {count} "
        f"--budget-factor {benchmark.budget_factor}"
    )


def _list(values: tuple[int, ...]) -> str:
    return ",".join(map(str, values))
