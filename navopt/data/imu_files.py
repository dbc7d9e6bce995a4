"""Readers for recordings of an inertial unit: CSV, one text file per sensor, PSINS increments."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from navopt.data import imu_units
from navopt.data.imu_recording import CHANNELS, ImuRecording
from navopt.data.psins_files import read_psins_imu, read_text
from navopt.data.track_columns import Table, numbers, seconds
from navopt.errors import InvalidInput, UnknownName

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["FORMATS", "read_imu", "read_imu_csv", "read_sensor_files"]

#: Forms of files and their readers.
FORMATS = ("csv", "sensors", "psins")
#: Endings of column names that state the unit: ``gyro_x_deg_s``.
SUFFIXES = {
    "rad_s": "rad/s", "deg_s": "deg/s", "mdeg_s": "mdeg/s", "deg_h": "deg/h", "counts": "counts",
    "m_s2": "m/s2", "g": "g", "mg": "mg",
}  # fmt: skip
#: Longest usual step of time that can be of a recording for calibration, s.
LONGEST_STEP = 0.5


def read_imu(
    path: str | Path | None = None,
    *,
    gyro: str | Path | None = None,
    accelerometer: str | Path | None = None,
    form: str | None = None,
    columns: Mapping[str, str] | None = None,
    gyro_unit: str | None = None,
    accelerometer_unit: str | None = None,
    time_unit: str = "s",
    gyro_zero: float | None = None,
    accelerometer_zero: float | None = None,
) -> ImuRecording:
    """Read a recording, from one file or one per sensor.

    Parameters
    ----------
    path : path-like, optional
        One file with all channels: CSV, or PSINS (ending ``.imu``).
    gyro, accelerometer : path-like, optional
        Instead: two text files with the columns ``t x y z``.
    form : str, optional
        One of `FORMATS`; by the ending if not given.
    columns : mapping of str to str, optional
        Other names of the columns of a CSV file, ``{"gyro_x": "wx", ...}``.
    gyro_unit, accelerometer_unit : str, optional
        Units, or ``"counts"``; see `read_imu_csv`.
    time_unit : str
        ``"s"``, ``"ms"``, ``"us"`` or ``"ns"``.
    gyro_zero, accelerometer_zero : float, optional
        Count that stands for zero.

    Returns
    -------
    ImuRecording

    Raises
    ------
    InvalidInput
        If the files cannot be used.
    UnknownName
        If a form, a column or a unit does not exist.
    """
    if form is not None and form not in FORMATS:
        raise UnknownName("--format", form, FORMATS)
    units: dict[str, object] = {
        "gyro_unit": gyro_unit,
        "accelerometer_unit": accelerometer_unit,
        "time_unit": time_unit,
        "gyro_zero": gyro_zero,
        "accelerometer_zero": accelerometer_zero,
    }
    if (gyro is None) != (accelerometer is None) or (path is None) == (gyro is None):
        given = ", ".join(
            name
            for name, value in (("--imu", path), ("--gyro", gyro), ("--accelerometer", accelerometer))
            if value is not None
        )
        raise InvalidInput("input", given or "no file", "give --imu, or --gyro and --accelerometer together")
    if gyro is not None and accelerometer is not None:
        if form not in (None, "sensors"):
            raise InvalidInput("--format", form, "two files have the form sensors")
        return read_sensor_files(gyro, accelerometer, **units)  # type: ignore[arg-type]
    assert path is not None
    if form == "sensors":
        raise InvalidInput("--format", form, "give --gyro and --accelerometer instead of --imu")
    if form == "psins" or (form is None and Path(path).suffix.lower() == ".imu"):
        if gyro_unit or accelerometer_unit:
            raise InvalidInput(
                "--gyro-unit", str(gyro_unit or accelerometer_unit), "the file states its scales"
            )
        return read_psins_imu(path)
    return read_imu_csv(path, columns=columns, **units)  # type: ignore[arg-type]


def read_imu_csv(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    gyro_unit: str | None = None,
    accelerometer_unit: str | None = None,
    time_unit: str = "s",
    gyro_zero: float | None = None,
    accelerometer_zero: float | None = None,
) -> ImuRecording:
    """Read a CSV file with one header line and one row per sample.

    The columns are ``time``, ``gyro_x``, ``gyro_y``, ``gyro_z``, ``accelerometer_x``, ``accelerometer_y`` and
    ``accelerometer_z``; a name may end in its unit (``gyro_x_deg_s``, ``accelerometer_x_m_s2``,
    ``gyro_x_counts``). Times are seconds or ISO 8601. Further columns are ignored.

    Parameters
    ----------
    path : path-like
        The file, in UTF-8.
    columns : mapping of str to str, optional
        Other names of columns.
    gyro_unit : str, optional
        ``"rad/s"``, ``"deg/s"``, ``"mdeg/s"``, ``"deg/h"`` or ``"counts"``, where the names do not say.
    accelerometer_unit : str, optional
        ``"m/s2"``, ``"g"``, ``"mg"`` or ``"counts"``, where the names do not say.
    time_unit : str
        Unit of times that are numbers.
    gyro_zero, accelerometer_zero : float, optional
        Count that stands for zero; found by `navopt.data.imu_units.counts_zero` if not given.

    Returns
    -------
    ImuRecording
        SI units, or counts above zero.

    Raises
    ------
    InvalidInput
        If the file cannot be read, a cell is no number, or a unit is not stated; the message then says which
        one the numbers look like.
    UnknownName
        If a column or a unit does not exist.
    """
    table = _table(Path(path))
    names, stated = _columns(table, dict(columns or {}))
    kept = np.ones(len(table), dtype=bool)
    second, _, notes = seconds(table, names["time"], kept)
    if _is_number(table.frame[names["time"]]):
        second = second * _time_factor(time_unit)
    samples = np.stack([numbers(table, names[channel]) for channel in CHANNELS], axis=1)
    return _recording(
        second,
        samples[:, :3],
        samples[:, 3:],
        _agreed("--gyro-unit", gyro_unit, stated["gyro"]),
        _agreed("--accelerometer-unit", accelerometer_unit, stated["accelerometer"]),
        (gyro_zero, accelerometer_zero),
        table.name,
        notes,
    )


def read_sensor_files(
    gyro: str | Path,
    accelerometer: str | Path,
    *,
    gyro_unit: str | None = None,
    accelerometer_unit: str | None = None,
    time_unit: str = "s",
    gyro_zero: float | None = None,
    accelerometer_zero: float | None = None,
) -> ImuRecording:
    """Read one text file per sensor with the columns ``t x y z``, no header, white space between.

    This is the form of the example recordings of Tedaldi, Pretto and Menegatti (2014).

    Parameters
    ----------
    gyro, accelerometer : path-like
        The files; both must have the same times, to a tenth of a sample.
    gyro_unit, accelerometer_unit, time_unit, gyro_zero, accelerometer_zero
        As for `read_imu_csv`.

    Returns
    -------
    ImuRecording

    Raises
    ------
    InvalidInput
        If a file cannot be read or the times differ.
    """
    factor = _time_factor(time_unit)
    one, other = _plain(Path(gyro)), _plain(Path(accelerometer))
    if len(one) != len(other):
        raise InvalidInput(
            "--accelerometer", f"{len(other)} rows, and {len(one)} of the gyros", "both need the same samples"
        )
    apart = np.abs(one[:, 0] - other[:, 0]).max()
    if apart > 0.1 * np.median(np.diff(one[:, 0])):
        raise InvalidInput(
            "--accelerometer",
            f"times that differ from the gyros' by up to {apart * factor:.4g} s",
            "both need the same times: interpolate one to the other's",
        )
    return _recording(
        one[:, 0] * factor,
        one[:, 1:],
        other[:, 1:],
        gyro_unit,
        accelerometer_unit,
        (gyro_zero, accelerometer_zero),
        f"{Path(gyro).name}, {Path(accelerometer).name}",
        (),
    )


def _table(file: Path) -> Table:
    import io

    import pandas as pd

    text = read_text(file)
    if not text.strip():
        raise InvalidInput("--imu", file.name, "the file is empty")
    try:
        frame = pd.read_csv(io.StringIO(text), dtype=str, skip_blank_lines=False, skipinitialspace=True)
    except pd.errors.ParserError as error:
        raise InvalidInput("--imu", file.name, f"give CSV with one header line ({error})") from None
    if not isinstance(frame.index, pd.RangeIndex):
        raise InvalidInput("--imu", file.name, "its lines have more cells than the header line has names")
    frame.columns = [str(name).strip() for name in frame.columns]
    line = np.arange(2, len(frame) + 2)
    filled = frame.notna().any(axis=1).to_numpy()
    if not filled.any():
        raise InvalidInput("--imu", file.name, "there is no row below the header line")
    return Table(frame[filled], line[filled], file.name)


def _is_number(cells: pd.Series) -> bool:
    import pandas as pd

    return bool(pd.to_numeric(cells, errors="coerce").notna().all())


def _plain(file: Path) -> np.ndarray:
    """Rows of four numbers."""
    import io

    text = read_text(file)
    try:
        rows = np.loadtxt(io.StringIO(text), ndmin=2)
        if rows.shape[1] != 4 or len(rows) < 2:
            raise ValueError("each row needs the four numbers t x y z")
    except ValueError as error:
        raise InvalidInput("--gyro, --accelerometer", file.name, f"{' '.join(str(error).split())}") from None
    return rows


def _columns(table: Table, given: dict[str, str]) -> tuple[dict[str, str], dict[str, str | None]]:
    """Column of each channel and the units that the names state."""
    for role, column in given.items():
        if role not in ("time", *CHANNELS):
            raise UnknownName("--columns", role, ("time", *CHANNELS))
        if column not in table.columns:
            raise UnknownName(f"column for {role} in {table.name}", column, table.columns)
    names: dict[str, str] = {}
    stated: dict[str, str | None] = {"gyro": None, "accelerometer": None}
    for role in ("time", *CHANNELS):
        found = given.get(role) or table.column(role)
        if found is None:
            for ending, unit in SUFFIXES.items():
                found = table.column(f"{role}_{ending}")
                if found is not None:
                    sensor = role.split("_")[0]
                    if stated[sensor] not in (None, unit):
                        raise InvalidInput(
                            f"columns of {table.name}",
                            f"{sensor} in {stated[sensor]} and in {unit}",
                            "give one unit for the three axes",
                        )
                    stated[sensor] = unit
                    break
        if found is None:
            raise UnknownName(f"column for {role} in {table.name}", role, table.columns)
        names[role] = found
    return names, stated


def _agreed(option: str, given: str | None, stated: str | None) -> str | None:
    if given is not None and stated is not None and given != stated:
        raise InvalidInput(option, given, f"the columns' names say {stated}: leave the option out")
    return given if given is not None else stated


def _time_factor(unit: str) -> float:
    if unit not in imu_units.TIME_UNITS:
        raise UnknownName("--time-unit", unit, imu_units.TIME_UNITS)
    return imu_units.TIME_UNITS[unit]


def _recording(
    time: np.ndarray,
    gyro: np.ndarray,
    accelerometer: np.ndarray,
    gyro_unit: str | None,
    accelerometer_unit: str | None,
    zeros: tuple[float | None, float | None],
    source: str,
    notes: tuple[str, ...],
) -> ImuRecording:
    """Samples in SI units or in counts above zero."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if step > LONGEST_STEP:
        raise InvalidInput(
            "--time-unit",
            f"a step of {step:g} s between samples",
            "milliseconds or microseconds? say --time-unit ms",
        )
    found, remarks = [], list(notes)
    for sensor, samples, unit, zero in (
        ("gyro", gyro, gyro_unit, zeros[0]),
        ("accelerometer", accelerometer, accelerometer_unit, zeros[1]),
    ):
        look = imu_units.suspected_gyro_unit if sensor == "gyro" else imu_units.suspected_accelerometer_unit
        if unit is None:
            suspected, reason = look(samples[np.isfinite(samples).all(axis=1)])
            hint = (
                f"say --{sensor}-unit {suspected} if that is right" if suspected else f"say --{sensor}-unit"
            )
            raise InvalidInput(f"--{sensor}-unit", f"none, and {reason}", hint)
        factor = imu_units.gyro_factor(unit) if sensor == "gyro" else imu_units.accelerometer_factor(unit)
        if factor is not None:
            if zero is not None:
                raise InvalidInput(f"--{sensor}-zero", zero, "only counts have a zero of their own")
            found.append((samples * factor, 0.0))
            continue
        finite = samples[np.isfinite(samples).all(axis=1)]
        offset = imu_units.counts_zero(finite) if zero is None else float(zero)
        if offset and zero is None:
            remarks.append(f"{sensor} counts without sign: {offset:g} is taken as zero")
        found.append((samples - offset, offset))
    return ImuRecording(
        time=time,
        gyro=found[0][0],
        accelerometer=found[1][0],
        gyro_unit="counts" if gyro_unit == "counts" else "rad/s",
        accelerometer_unit="counts" if accelerometer_unit == "counts" else "m/s2",
        gyro_zero=found[0][1],
        accelerometer_zero=found[1][1],
        source=source,
        notes=tuple(remarks),
    )
