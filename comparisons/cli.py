"""The command ``navopt``: list what there is, run a study, make its report, compute a gravity map.

Everything heavy is imported inside the commands, so that ``navopt --help`` answers at once.
"""

from __future__ import annotations

import os
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from comparisons.audit_command import audit
from comparisons.bbob_command import bbob
from comparisons.bench_command import bench
from comparisons.calibrate_command import calibrate
from comparisons.console import console, resumable
from comparisons.match_command import match
from comparisons.tune_command import tune

if TYPE_CHECKING:
    from rich.console import Console

    from comparisons.runner import Summary
    from comparisons.study import Study

__all__ = ["app", "main"]

KINDS = ("problems", "solvers", "studies")


class _Commands(TyperGroup):
    """Turns what navopt raises on purpose into one message and exit code 2."""

    def invoke(self, ctx: Any) -> Any:
        from navopt.errors import NavoptError

        try:
            return super().invoke(ctx)
        except NavoptError as error:
            typer.echo(f"navopt: error: {error}", err=True)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            typer.echo("navopt: interrupted", err=True)
            raise typer.Exit(130) from None


app = typer.Typer(
    name="navopt",
    cls=_Commands,
    help="Compare solvers on navigation problems at equal cost.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Run the command line."""
    app()


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"navopt {version('navopt')}")
        raise typer.Exit


@app.callback()
def _options(
    show_version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and end."),
    ] = False,
) -> None:
    pass


@app.command("list")
def list_(
    kind: Annotated[str, typer.Argument(help="problems, solvers or studies; all if not given.")] = "",
) -> None:
    """List the registered problems and solvers and the studies that come with navopt."""
    from comparisons.listing import listing
    from navopt.errors import UnknownName

    if kind and kind not in KINDS:
        raise UnknownName("kind", kind, KINDS)
    for chosen in [kind] if kind else KINDS:
        console().print(listing(chosen))


@app.command()
def run(
    study: Annotated[str, typer.Argument(help="Name of a study (see `navopt list studies`) or a TOML file.")],
    out: Annotated[Path | None, typer.Option(help="Results folder; results/<study> if not given.")] = None,
    worlds: Annotated[int | None, typer.Option(help="Number of worlds instead of the study's.")] = None,
    budget: Annotated[int | None, typer.Option(help="Budget of each run instead of the study's.")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Number of processes; all available processors if not given.")
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Do failed runs again.")] = False,
) -> None:
    """Run a study, or continue it where it was, and write its report.

    Finished runs are in the results folder already and are never repeated.
    """
    from comparisons.threads import THREAD_LIMITS

    # before numpy is imported: --workers 1 then computes with one thread too, as the workers do
    os.environ.update(THREAD_LIMITS)
    from comparisons.runner import run_study

    chosen = _open_study(study).replaced(worlds=worlds, budget=budget)
    folder = out if out is not None else Path("results") / chosen.name
    with resumable(folder):
        summary = run_study(
            chosen, folder, workers=workers, retry_failed=retry_failed, console=console(stderr=True)
        )
    _conclude(folder, summary)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Results folder of a study.")],
) -> None:
    """Write the report of a study, finished or not, from its results folder."""
    from comparisons.store import ResultsStore

    with ResultsStore(folder) as store:
        _write_report(store, folder)


@app.command("gravity-map")
def gravity_map(
    region: Annotated[str, typer.Option(help="West/east/south/north in degrees, such as 112/118/10/15.")],
    out: Annotated[Path, typer.Option(help="NetCDF file to write.")],
    degree: Annotated[int, typer.Option(help="Highest degree of the expansion, 2 to 2190.")] = 2190,
    step: Annotated[float, typer.Option(help="Spacing of the nodes in minutes of arc.")] = 1.0,
) -> None:
    """Compute a map of free-air gravity anomalies from EGM2008."""
    from navopt.data.egm2008 import free_air_anomaly
    from navopt.errors import InvalidInput

    corners = _region(region)
    if not out.absolute().parent.is_dir():
        raise InvalidInput("--out", str(out), "create its folder first")
    dataset = free_air_anomaly(corners, degree=degree, step_arcmin=step)
    try:
        dataset.to_netcdf(out, engine="h5netcdf")
    except OSError as error:
        raise InvalidInput("--out", str(out), f"give a file that can be written ({error})") from None
    typer.echo(out)


app.command("audit")(audit)
app.command("bbob")(bbob)
app.command("calibrate")(calibrate)
app.command("bench")(bench)
app.command("match")(match)
app.command("tune")(tune)


def _region(text: str) -> tuple[float, float, float, float]:
    from navopt.errors import InvalidInput

    try:
        west, east, south, north = (float(part) for part in text.split("/"))
    except ValueError:
        raise InvalidInput(
            "--region", text, "give west/east/south/north in degrees, such as 112/118/10/15"
        ) from None
    return west, east, south, north


def _open_study(text: str) -> Study:
    from comparisons.study import Study, list_studies
    from navopt.errors import UnknownName

    if text in list_studies():
        return Study.named(text)
    if text.endswith(".toml") or os.sep in text or Path(text).is_file():
        return Study.from_toml(text)
    raise UnknownName("study", text, list_studies())


def _conclude(folder: Path, summary: Summary) -> None:
    """Ranked table, failures, report; the path of the report comes last."""
    from comparisons.statistics import print_ranked
    from comparisons.store import ResultsStore

    out = console()
    with ResultsStore(folder) as store:
        all_failed = summary.failed == summary.planned
        if not all_failed:
            print_ranked(store, out)
            _print_comparisons(store, out)
            if store.study.ablation:
                from comparisons.effects import effect_table
                from comparisons.effects_page import print_effects

                print_effects(effect_table(store), store.study, out)
        if summary.failed:
            _tell_failures(store, summary)
        if not all_failed:
            _write_report(store, folder)
    if all_failed:
        raise typer.Exit(1)


def _print_comparisons(store: Any, out: Console) -> None:
    """Print printed values beside ours, and ranks over all scenarios, where there are any."""
    from comparisons.overall import overall_ranks, print_overall
    from comparisons.printed import print_printed

    print_printed(store, out)
    print_overall(overall_ranks(store), out)


def _tell_failures(store: Any, summary: Summary) -> None:
    frame = store.runs()
    causes = frame[frame["status"] == "failed"].groupby(["solver", "error"], sort=False).size()
    typer.echo(
        f"navopt: {summary.failed} of {summary.planned} runs failed (--retry-failed does them again):",
        err=True,
    )
    for (solver, cause), count in causes.sort_values(ascending=False).head(5).items():
        typer.echo(f"  {solver}: {count} × {cause}", err=True)


def _write_report(store: Any, folder: Path) -> None:
    from comparisons.report import write_report

    typer.echo(write_report(store, (folder if folder.is_dir() else folder.parent) / "report.html"))
