"""Recorded tracks with what a file says besides positions and values: dates, stated accuracy, remarks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from navopt.data.gravity_units import gravity_factor, refuse_magnitude
from navopt.data.track_columns import Table, numbers, read_table, seconds, unwrapped_deg
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, UnknownName

__all__ = ["COLUMNS", "REQUIRED", "RecordedTrack", "read_ins_csv", "read_track", "recorded_from", "with_ins"]

#: Columns of a CSV track by what they hold.
COLUMNS = {
    "time": "time",
    "latitude": "latitude",
    "longitude": "longitude",
    "gravity": "gravity",
    "sigma": "sigma_m",
    "heading": "heading",
    "true_latitude": "true_latitude",
    "true_longitude": "true_longitude",
}
#: Those that a track cannot do without.
REQUIRED = ("time", "latitude", "longitude", "gravity")
#: Between two INS positions farther apart in time no position is interpolated, s.
INS_INTERVAL = 600.0


@dataclass(frozen=True, kw_only=True)
class RecordedTrack:
    """A track as a file holds it.

    Attributes
    ----------
    track : MeasuredTrack
        Times, INS positions, anomalies in mGal, and the reference positions if there are any. Longitudes
        have no jump; the reference is on the same turn.
    start : str or None
        ISO date and time (UTC) of second zero of ``track.time``; None where the file counts seconds.
    position_sigma : ndarray, shape (N,), or None
        Stated 1 sigma of the INS position in each horizontal direction, m.
    source : str
        Name of the file.
    notes : tuple of str
        What was left out or assumed, in sentences.
    """

    track: MeasuredTrack
    start: str | None = None
    position_sigma: np.ndarray | None = None
    source: str = ""
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.track)

    def moment(self, second: float) -> str:
        """Return a time of the track as text: date and time (UTC) where dates are known, or seconds."""
        if self.start is None:
            return f"{second:g} s"
        stamp = np.datetime64(self.start) + np.timedelta64(round(second * 1e3), "ms")
        return str(stamp).removesuffix(".000") + "Z"

    def rows(self, chosen: Any) -> RecordedTrack:
        """Return the samples that an index, a mask or a slice chooses."""
        arrays = {item.name: getattr(self.track, item.name) for item in fields(self.track)}
        kept: dict[str, Any] = {
            name: None if values is None else values[chosen] for name, values in arrays.items()
        }
        sigma = None if self.position_sigma is None else self.position_sigma[chosen]
        return replace(self, track=MeasuredTrack(**kept), position_sigma=sigma)

    def noted(self, *sentences: str) -> RecordedTrack:
        """Return the same track with more notes."""
        return replace(self, notes=(*self.notes, *sentences))


def read_track(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    gravity_unit: str | None = None,
) -> RecordedTrack:
    """Read a track from a CSV file or an MGD77T file (``.m77t``).

    Parameters
    ----------
    path : path-like
        The file. One whose name ends in ``.m77t`` is MGD77T, see `navopt.data.mgd77.read_mgd77`.
    columns : mapping of str to str, optional
        Names of columns where they are not those of `COLUMNS`: ``{"gravity": "faa"}``.
    gravity_unit : str, optional
        Unit of the gravity column; mGal if not given, and then values that cannot be anomalies in mGal
        are refused.

    Returns
    -------
    RecordedTrack
        Rows without a gravity value are left out.

    Raises
    ------
    InvalidInput
        If the file cannot be read or its content cannot be used; the line is named.
    UnknownName
        If a column or the unit does not exist; the nearest is suggested.
    """
    if Path(path).suffix.lower() == ".m77t":
        from navopt.data.mgd77 import read_mgd77

        return read_mgd77(path, columns=columns, gravity_unit=gravity_unit)
    table = read_table(path)
    return recorded_from(table, _roles(table, columns), gravity_unit=gravity_unit)


def _roles(table: Table, columns: Mapping[str, str] | None) -> dict[str, str]:
    """Column of each role; the optional ones only where the file has them or they were asked for."""
    asked = dict(columns or {})
    for role in asked:
        if role not in COLUMNS:
            raise UnknownName("columns", role, COLUMNS)
    found = {}
    for role, usual in COLUMNS.items():
        name = asked.get(role, usual)
        match = table.column(name)
        if match is None:
            if role in REQUIRED or role in asked:
                raise UnknownName(f"column for {role} in {table.name}", name, table.columns)
            continue
        found[role] = match
    if ("true_latitude" in found) != ("true_longitude" in found):
        one = "true_latitude" if "true_latitude" in found else "true_longitude"
        raise InvalidInput(f"columns of {table.name}", f"only {found[one]}", "give both true columns or none")
    return found


def recorded_from(
    table: Table, roles: Mapping[str, str], *, gravity_unit: str | None, time: Any = None
) -> RecordedTrack:
    """Make a track of a table whose columns are known.

    Parameters
    ----------
    table : Table
        The file's content.
    roles : mapping of str to str
        Column of each role that is there.
    gravity_unit : str or None
        As for `read_track`.
    time : tuple of (ndarray, str or None, tuple of str), optional
        Seconds of all rows, start and notes, where no single column holds the time.

    Returns
    -------
    RecordedTrack

    Raises
    ------
    InvalidInput
        If the content cannot be used.
    """
    notes = list(table.notes)
    gravity = numbers(table, roles["gravity"], missing=True)
    kept = np.isfinite(gravity)
    if not kept.any():
        raise InvalidInput(
            f"column {roles['gravity']} of {table.name}", "no value", "give at least one measured value"
        )
    if not kept.all():
        notes.append(f"{int((~kept).sum())} of {kept.size} rows have no gravity value and are left out")
    seconds_, start, said = seconds(table, roles["time"], kept) if time is None else time
    notes += said
    table, gravity, second = table.kept(kept), gravity[kept], seconds_[kept]
    _check_order(table, second)
    # the first row that counts is second zero of a dated track
    if start is not None:
        start = str(np.datetime64(start) + np.timedelta64(round(float(second[0]) * 1e3), "ms"))
        second = second - second[0]
    if gravity_unit is None:
        refuse_magnitude(gravity, argument=f"gravity in {table.name}", option="--gravity-unit")
    else:
        gravity = gravity * gravity_factor(gravity_unit)
    position = {
        role: numbers(table, roles[role]) for role in roles if role.endswith(("latitude", "longitude"))
    }
    for role, values in position.items():
        _check_range(table, roles[role], values, 90.0 if role.endswith("latitude") else 360.0)
    longitude = unwrapped_deg(position["longitude"])
    arrays = {"latitude": position["latitude"], "longitude": longitude}
    if "true_latitude" in position:
        turn = np.round((position["true_longitude"] - longitude) / 360.0)
        arrays["true_latitude"] = position["true_latitude"]
        arrays["true_longitude"] = position["true_longitude"] - 360.0 * turn
    sigma = numbers(table, roles["sigma"]) if "sigma" in roles else None
    if sigma is not None and not (sigma > 0).all():
        k = int(np.flatnonzero(~(sigma > 0))[0])
        raise InvalidInput(
            f"column {roles['sigma']} of {table.name}",
            f"{sigma[k]:g} in line {table.line[k]}",
            "give the 1 sigma of the INS position in metres, positive",
        )
    if "heading" in roles:
        arrays["heading"] = numbers(table, roles["heading"]) % 360.0
    radians = {name: np.radians(values) for name, values in arrays.items()}
    return RecordedTrack(
        track=MeasuredTrack(time=second, measured=gravity, **radians),
        start=start,
        position_sigma=sigma,
        source=table.name,
        notes=tuple(notes),
    )


def _check_order(table: Table, second: np.ndarray) -> None:
    """Refuse times that repeat or go back, naming the line."""
    step = np.diff(second)
    wrong = np.flatnonzero(step <= 0)
    if not wrong.size:
        return
    if len(step) > 1 and (step < 0).all():
        raise InvalidInput(f"time in {table.name}", "rows in reverse order", "sort them by time")
    k = int(wrong[0])
    repeated = int((step == 0).sum())
    tally = f"{repeated} repeated and {wrong.size - repeated} reversed in all"
    line, before = table.line[k + 1], table.line[k]
    what = (
        f"the time of line {before} again" if step[k] == 0 else f"a time {-step[k]:g} s before line {before}"
    )
    raise InvalidInput(
        f"time in {table.name}",
        f"in line {line} {what} ({tally})",
        "sort the rows by time and drop repeated ones; where a clock was set back, cut the track there",
    )


def _check_range(table: Table, column: str, values: np.ndarray, limit: float) -> None:
    wrong = np.flatnonzero(np.abs(values) > limit)
    if wrong.size:
        raise InvalidInput(
            f"column {column} of {table.name}",
            f"{values[wrong[0]]:g} in line {table.line[wrong[0]]}",
            f"give decimal degrees from {-limit:g} to {limit:g}",
        )


def read_ins_csv(path: str | Path) -> RecordedTrack:
    """Read INS positions alone: ``time``, ``latitude``, ``longitude``; ``sigma_m`` and ``heading`` if there.

    Parameters
    ----------
    path : path-like
        CSV file.

    Returns
    -------
    RecordedTrack
        With zeros as measurements.

    Raises
    ------
    InvalidInput, UnknownName
        As `read_track`.
    """
    table = read_table(path)
    wanted = {role: COLUMNS[role] for role in ("time", "latitude", "longitude", "sigma", "heading")}
    roles = {role: found for role, name in wanted.items() if (found := table.column(name)) is not None}
    for role in REQUIRED[:3]:
        if role not in roles:
            raise UnknownName(f"column for {role} in {table.name}", wanted[role], table.columns)
    nothing = "a column that no file has"
    table = replace(table, frame=table.frame.assign(**{nothing: "0"}))
    return recorded_from(table, {**roles, "gravity": nothing}, gravity_unit="mGal")


def with_ins(recorded: RecordedTrack, path: str | Path) -> RecordedTrack:
    """Take the INS positions from another file; the track's own become the reference.

    Parameters
    ----------
    recorded : RecordedTrack
        Measurements with positions that are better than an INS, such as a ship's.
    path : path-like
        CSV file of INS positions, see `read_ins_csv`.

    Returns
    -------
    RecordedTrack
        INS positions at the times of the measurements, linear between those of the file.

    Raises
    ------
    InvalidInput
        If the track has a reference already, the two files count time in different ways, or the INS does
        not cover the measurements.
    """
    if recorded.track.true_latitude is not None:
        raise InvalidInput("ins", str(path), f"{recorded.source} has INS and true positions already")
    name, inertial = Path(path).name, read_ins_csv(path)
    second = inertial.track.time
    if (inertial.start is None) != (recorded.start is None):
        raise InvalidInput("ins", name, "give dates and times in both files, or seconds in both")
    if inertial.start is not None and recorded.start is not None:
        apart = np.datetime64(inertial.start) - np.datetime64(recorded.start)
        second = second + apart / np.timedelta64(1, "s")
    time = recorded.track.time
    outside = np.flatnonzero((time < second[0] - 1e-3) | (time > second[-1] + 1e-3))
    if outside.size:
        raise InvalidInput(
            "ins",
            f"{name} runs from {recorded.moment(second[0])} to {recorded.moment(second[-1])}",
            f"{outside.size} measurements lie outside, the first at {recorded.moment(time[outside[0]])}: "
            "choose a part with --from and --until",
        )
    after = np.clip(np.searchsorted(second, time), 1, max(len(second) - 1, 1))
    wide = second[after] - second[after - 1] if len(second) > 1 else np.zeros(len(time))
    if wide.max() > INS_INTERVAL:
        k = int(wide.argmax())
        raise InvalidInput(
            "ins",
            f"{name} has no position for {wide[k]:g} s around {recorded.moment(time[k])}",
            f"give one at least every {INS_INTERVAL:g} s",
        )
    own, sigma, heading = recorded.track, inertial.position_sigma, inertial.track.heading
    longitude = np.interp(time, second, inertial.track.longitude)
    shift = 2 * np.pi * np.round((own.longitude[0] - longitude[0]) / (2 * np.pi))
    if heading is not None:
        heading = np.interp(time, second, np.unwrap(heading)) % (2 * np.pi)
    return replace(
        recorded,
        track=MeasuredTrack(
            time=time,
            latitude=np.interp(time, second, inertial.track.latitude),
            longitude=longitude + shift,
            measured=own.measured,
            true_latitude=own.latitude,
            true_longitude=own.longitude,
            heading=heading,
        ),
        position_sigma=None if sigma is None else np.interp(time, second, sigma),
        notes=(*recorded.notes, f"INS positions from {name}; those of {recorded.source} are the reference"),
    )
