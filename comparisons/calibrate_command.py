"""The command ``navopt calibrate``; everything heavy is imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["calibrate"]


def calibrate(
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the results.")] = None,
    imu: Annotated[Path | None, typer.Option(help="Recording: CSV, or PSINS increments (.imu).")] = None,
    gyro: Annotated[
        Path | None, typer.Option(help="Instead: text file of the gyros with the columns t x y z.")
    ] = None,
    accelerometer: Annotated[Path | None, typer.Option(help="And of the accelerometers.")] = None,
    form: Annotated[
        str | None, typer.Option("--format", help="csv, sensors or psins; by the ending if not given.")
    ] = None,
    columns: Annotated[
        str, typer.Option(help="Other column names of a CSV file: time=t,gyro_x=wx,accelerometer_x=ax.")
    ] = "",
    gyro_unit: Annotated[str | None, typer.Option(help="counts, rad/s, deg/s, mdeg/s or deg/h.")] = None,
    accelerometer_unit: Annotated[str | None, typer.Option(help="counts, m/s2, g or mg.")] = None,
    time_unit: Annotated[str, typer.Option(help="s, ms, us or ns.")] = "s",
    gyro_zero: Annotated[float | None, typer.Option(help="Count of the gyros that stands for zero.")] = None,
    accelerometer_zero: Annotated[
        float | None, typer.Option(help="Count of the accelerometers that stands for zero.")
    ] = None,
    gravity: Annotated[
        float | None, typer.Option(help="Gravity there, m/s²; from the latitude if not given.")
    ] = None,
    latitude: Annotated[float | None, typer.Option(help="Latitude, degrees.")] = None,
    initial_static: Annotated[
        float | None, typer.Option(help="Seconds at the begin in which the unit certainly lay still.")
    ] = None,
    threshold: Annotated[
        float | None, typer.Option(help="Relative variance below which the unit is static.")
    ] = None,
    window: Annotated[float, typer.Option(help="Length of the detector's window, s.")] = 1.0,
    shortest_pose: Annotated[float, typer.Option(help="Shorter poses are left out, s.")] = 2.0,
    accelerometer_parameters: Annotated[
        str, typer.Option(help="frame (9 parameters), scale-bias (6) or bias (3).")
    ] = "frame",
    gyro_method: Annotated[str, typer.Option(help="auto, rotation, earth-rate or none.")] = "auto",
    start: Annotated[float | None, typer.Option("--from", help="First time used, s.")] = None,
    stop: Annotated[float | None, typer.Option("--until", help="Last time used, s.")] = None,
    single: Annotated[
        bool, typer.Option("--one-position", help="Say what a recording in one position tells, and end.")
    ] = False,
) -> None:
    """Calibrate your own inertial unit from a recording in many static poses."""
    import math
    import os

    from comparisons.threads import THREAD_LIMITS

    # small matrices: one thread is fastest, and the same number gives the same last digits
    os.environ.update(THREAD_LIMITS)
    from comparisons.calibrate import calibrate_recording, compare_one_position
    from comparisons.calibrate_output import summary_lines
    from comparisons.match_command import _pairs
    from navopt.data.imu_files import read_imu
    from navopt.errors import InvalidInput

    if out is None and not single:
        raise InvalidInput("--out", "none", "give a folder for the results")
    if out is not None and out.exists() and not out.is_dir():
        raise InvalidInput("--out", str(out), "give a folder, not a file")
    recording = read_imu(
        imu,
        gyro=gyro,
        accelerometer=accelerometer,
        form=form,
        columns=_pairs(columns),
        gyro_unit=gyro_unit,
        accelerometer_unit=accelerometer_unit,
        time_unit=time_unit,
        gyro_zero=gyro_zero,
        accelerometer_zero=accelerometer_zero,
    )
    if start is not None or stop is not None:
        recording = recording.between(start, stop)
    where = None if latitude is None else math.radians(latitude)
    if single:
        for line in compare_one_position(recording, latitude=where, gravity=gravity).lines():
            typer.echo(line)
        return
    assert out is not None
    found = calibrate_recording(
        recording,
        gravity=gravity,
        latitude=where,
        initial_static_s=initial_static,
        threshold=threshold,
        window_s=window,
        shortest_pose_s=shortest_pose,
        accelerometer_parameters=accelerometer_parameters,
        gyro=gyro_method,
    )
    given = {"imu": imu, "gyro": gyro, "accelerometer": accelerometer}
    found.write(out, inputs={name: path for name, path in given.items() if path is not None})
    for line in summary_lines(found):
        typer.echo(line)
    typer.echo(out)
