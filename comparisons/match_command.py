"""The command ``navopt match``; everything heavy is imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = ["match"]


def match(
    map_: Annotated[Path, typer.Option("--map", help="Map: NetCDF (CF or GMT) or ICGEM grid (.gdf).")],
    track: Annotated[Path, typer.Option(help="Track: CSV, or MGD77T (.m77t).")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the results.")],
    solver: Annotated[
        str, typer.Option(help="Solver, with settings if need be: tercom:remove_mean=true,rotations=5.")
    ] = "track-map",
    sigma: Annotated[float, typer.Option(help="1σ of the noise of a measured anomaly, mGal.")] = 1.0,
    map_error: Annotated[float, typer.Option(help="1σ of the map's error, mGal.")] = 3.0,
    map_error_length: Annotated[
        float, typer.Option(help="Distance over which the map's error stays alike, km.")
    ] = 4.0,
    bias: Annotated[
        float, typer.Option(help="1σ of an unknown constant offset of the anomalies, mGal.")
    ] = 30.0,
    drift: Annotated[float, typer.Option(help="1σ of an unknown constant drift, mGal per day.")] = 0.0,
    eotvos: Annotated[
        bool, typer.Option("--eotvos", help="The anomalies were reduced with the INS's own velocity.")
    ] = False,
    window: Annotated[
        int, typer.Option(help="Number of last samples matched, by solvers with a window.")
    ] = 12,
    budget: Annotated[
        int | None, typer.Option(help="Largest cost (model evaluations); the solver's own rule if not given.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of a stochastic solver.")] = 1,
    ins: Annotated[
        Path | None, typer.Option(help="CSV of INS positions; the track's own are then the reference.")
    ] = None,
    columns: Annotated[
        str, typer.Option(help="Other column names of the track: time=t,gravity=faa,latitude=ins_lat.")
    ] = "",
    gravity_unit: Annotated[
        str | None, typer.Option(help="Unit of the track's gravity: mGal, uGal, m/s2, um/s2.")
    ] = None,
    map_unit: Annotated[
        str | None, typer.Option(help="Unit of the map, where the file is silent or wrong.")
    ] = None,
    map_variable: Annotated[str | None, typer.Option(help="Variable of the map's file, if several.")] = None,
    start: Annotated[
        str | None, typer.Option("--from", help="First time used: date and time, or seconds.")
    ] = None,
    stop: Annotated[str | None, typer.Option("--until", help="Last time used.")] = None,
    average: Annotated[float | None, typer.Option(help="Average the samples over so many seconds.")] = None,
    max_gap: Annotated[float, typer.Option(help="Longest gap between measurements, minutes.")] = 60.0,
    split: Annotated[
        bool, typer.Option("--split", help="Take the part after the last longer gap instead of refusing.")
    ] = False,
    gyro_bias: Annotated[float, typer.Option(help="1σ of the gyro biases, degrees per hour.")] = 0.02,
    accelerometer_bias: Annotated[
        float, typer.Option(help="1σ of the accelerometer biases, micro-g.")
    ] = 100.0,
    initial_position: Annotated[
        float, typer.Option(help="1σ of the initial position to the north and east, m.")
    ] = 185.2,
    initial_velocity: Annotated[
        float, typer.Option(help="1σ of the initial velocity to the north and east, m/s.")
    ] = 0.0,
    initial_heading: Annotated[float, typer.Option(help="1σ of the initial heading, degrees.")] = 0.0,
    gyro_noise: Annotated[
        float, typer.Option(help="1σ of the gyro's white noise averaged over 1 s, degrees per hour.")
    ] = 0.02,
    accelerometer_noise: Annotated[
        float, typer.Option(help="1σ of the accelerometers' white noise averaged over 1 s, micro-g.")
    ] = 100.0,
) -> None:
    """Match your own track to a gravity map and write the matched track, pictures and a summary.

    The defaults of the INS are those of Dai et al. (2019), Table 1.
    """
    import os

    from comparisons.threads import THREAD_LIMITS

    # one track needs no more than one thread, and the same number gives the same last digits
    os.environ.update(THREAD_LIMITS)
    from comparisons.match import match_track
    from comparisons.match_output import summary_lines
    from comparisons.match_problem import carried_errors
    from navopt.data.map_files import read_map
    from navopt.data.recorded import read_track, with_ins
    from navopt.data.track_parts import after_last_gap, averaged, between
    from navopt.errors import InvalidInput
    from navopt.problems.gravity_sensing import MeasurementErrors

    if out.exists() and not out.is_dir():
        raise InvalidInput("--out", str(out), "give a folder, not a file")
    if not max_gap > 0:
        raise InvalidInput("--max-gap", max_gap, "give a positive number of minutes")
    sensing = MeasurementErrors(
        noise=_checked("--sigma", sigma, positive=True),
        map_error=_checked("--map-error", map_error),
        map_error_length=1e3 * _checked("--map-error-length", map_error_length, positive=True),
        bias=_checked("--bias", bias),
        drift_per_day=_checked("--drift", drift),
        eotvos=eotvos,
    )
    errors = _ins_errors(
        gyro_bias, accelerometer_bias, initial_position, initial_velocity, initial_heading, gyro_noise,
        accelerometer_noise,
    )  # fmt: skip
    recorded = read_track(track, columns=_pairs(columns), gravity_unit=gravity_unit)
    if ins is not None:
        recorded = with_ins(recorded, ins)
    recorded = between(recorded, start=start, stop=stop)
    if split:
        part, first = after_last_gap(recorded, 60.0 * max_gap)
        if first:
            errors = carried_errors(recorded, errors, first)
            recorded = part.noted(f"{first} samples before the last gap above {max_gap:g} min are left out")
    if average is not None:
        recorded = averaged(recorded, average)
    found = match_track(
        recorded,
        _map(read_map, map_, map_variable, map_unit),
        solver=solver,
        ins_errors=errors,
        measurement_errors=sensing,
        window=window,
        budget=budget,
        seed=seed,
        max_gap_s=60.0 * max_gap,
        trusted_units=map_unit is not None,
    )
    inputs = {"map": map_, "track": track} | ({} if ins is None else {"ins": ins})
    found.write(out, inputs=inputs)
    for line in summary_lines(found):
        typer.echo(line)
    typer.echo(out)


def _map(read_map: Any, path: Path, variable: str | None, unit: str | None) -> Any:
    """Read the map, with the names of the command's options in the errors."""
    from navopt.errors import InvalidInput

    try:
        return read_map(path, variable, unit=unit)
    except InvalidInput as error:
        if error.argument == "units":
            raise InvalidInput(
                f"unit of {path.name}", error.value, "say what the numbers are with --map-unit, such as mGal"
            ) from None
        if error.argument == "variable":
            raise InvalidInput("--map-variable", error.value, error.remedy) from None
        raise


def _checked(option: str, value: float, *, positive: bool = False) -> float:
    """Value of an option, or an error that names it."""
    import math

    from navopt.errors import InvalidInput

    if not math.isfinite(value) or value < 0 or (positive and value == 0):
        raise InvalidInput(option, value, f"give a {'positive' if positive else 'non-negative'} number")
    return float(value)


def _ins_errors(
    gyro_bias: float,
    accelerometer_bias: float,
    position: float,
    velocity: float,
    heading: float,
    gyro_noise: float,
    accelerometer_noise: float,
) -> Any:
    """1 sigma of the INS's error sources from the units of data sheets."""
    import math

    from navopt.errors import InvalidInput
    from navopt.models.cruise import InsErrors
    from navopt.models.earth import GRAVITY, SEMI_MAJOR_AXIS

    rate, micro = math.radians(1.0) / 3600.0, 1e-6 * GRAVITY
    checked = {
        "--gyro-bias": gyro_bias,
        "--accelerometer-bias": accelerometer_bias,
        "--initial-position": position,
        "--initial-velocity": velocity,
        "--initial-heading": heading,
        "--gyro-noise": gyro_noise,
        "--accelerometer-noise": accelerometer_noise,
    }
    for option, value in checked.items():
        _checked(option, value)
    if not any(checked.values()):
        raise InvalidInput(
            "--gyro-bias", gyro_bias, "an INS without any error needs no matching: give its sigmas"
        )
    angle = position / SEMI_MAJOR_AXIS
    return InsErrors(
        gyro_bias=(gyro_bias * rate,) * 3,
        accelerometer_bias=(accelerometer_bias * micro,) * 3,
        latitude_error=angle,
        longitude_error=angle,
        velocity_error=(velocity,) * 2,
        attitude_error=(0.0, 0.0, math.radians(heading)),
        gyro_noise=gyro_noise * rate,
        accelerometer_noise=accelerometer_noise * micro,
    )


def _pairs(text: str) -> dict[str, str]:
    """``role=column`` pairs with commas."""
    from navopt.errors import InvalidInput

    found = {}
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        role, mark, column = part.partition("=")
        if not mark or not column.strip():
            raise InvalidInput("--columns", text, "give pairs such as gravity=faa, with commas between")
        found[role.strip()] = column.strip()
    return found
