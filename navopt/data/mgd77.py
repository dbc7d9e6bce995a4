"""Marine trackline geophysics in the exchange format MGD77T: tab-separated text, one line per sample.

The successor (2010) of the punch-card layout MGD77, in which the archive of NOAA gives out the gravity,
magnetics and depths of research ships. The data file ends in ``.m77t`` and begins with a line of 26 names.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from navopt.data.recorded import RecordedTrack, recorded_from
from navopt.data.track_columns import Table, numbers, read_table
from navopt.errors import InvalidInput, UnknownName

__all__ = ["read_mgd77"]

#: Quality codes of navigation and gravity that rule a sample out: bad, or suspected so.
_BAD = (4, 5, 6)
#: No gravimeter has been at sea before.
_FIRST_DAY = 19230101
_NEEDED = ("DATE", "TIME", "LAT", "LON")


def read_mgd77(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    gravity_unit: str | None = None,
) -> RecordedTrack:
    """Read free-air anomalies and positions from an MGD77T file.

    Parameters
    ----------
    path : path-like
        The file.
    columns : mapping of str to str, optional
        ``{"gravity": ...}`` takes another column than ``FREEAIR``; no other role can be changed.
    gravity_unit : str, optional
        Unit of that column; the format says mGal.

    Returns
    -------
    RecordedTrack
        Positions are the ship's own. ``DATE`` (YYYYMMDD), ``TIME`` (hours and decimal minutes, 2359.6667)
        and ``TIMEZONE`` (hours that make it UTC when added; empty means 0) give the time. Samples without
        an anomaly, or whose quality code ``NAV_QUALCO`` or ``GRA_QUALCO`` is 4 to 6, are left out.

    Raises
    ------
    InvalidInput
        If the file cannot be read or its content cannot be used; the line is named.
    UnknownName
        If a column does not exist.
    """
    table = read_table(path, separator="\t")
    asked = dict(columns or {})
    for role in asked:
        if role != "gravity":
            raise UnknownName("columns of an MGD77T file", role, ["gravity"])
    gravity = asked.get("gravity", "FREEAIR")
    for name in (*_NEEDED, gravity):
        if table.column(name) is None:
            raise UnknownName(f"column of {table.name}", name, table.columns)
    table = _without_bad(table)
    measured = np.isfinite(numbers(table, str(table.column(gravity)), missing=True))
    roles = {"latitude": "LAT", "longitude": "LON", "gravity": gravity}
    found = {role: str(table.column(name)) for role, name in roles.items()}
    return recorded_from(table, found, gravity_unit=gravity_unit, time=_times(table, measured))


def _without_bad(table: Table) -> Table:
    """Leave out samples that the archive calls bad."""
    bad = np.zeros(len(table), dtype=bool)
    for name in ("NAV_QUALCO", "GRA_QUALCO"):
        column = table.column(name)
        if column is not None:
            bad |= np.isin(numbers(table, column, missing=True), _BAD)
    if bad.all():
        raise InvalidInput("track", table.name, "every sample is marked as bad (quality codes 4 to 6)")
    kept = table.kept(~bad)
    if not bad.any():
        return kept
    said = f"{int(bad.sum())} rows are marked as bad (quality codes 4 to 6) and left out"
    return Table(kept.frame, kept.line, kept.name, (*kept.notes, said))


def _times(table: Table, measured: np.ndarray) -> tuple[np.ndarray, str, tuple[str, ...]]:
    """Seconds of all rows since the first that is measured, and its date."""
    if not measured.any():
        return np.full(len(table), np.nan), "1970-01-01T00:00:00", ()
    here = table.kept(measured)
    date, clock = numbers(here, str(table.column("DATE"))), numbers(here, str(table.column("TIME")))
    zone = np.zeros(len(here))
    column = table.column("TIMEZONE")
    if column is not None:
        zone = np.nan_to_num(numbers(here, column, missing=True))
    hour = np.floor(clock / 100.0)
    minute = clock - 100.0 * hour
    days = np.array([_day(here, k, value) for k, value in enumerate(date)], dtype="datetime64[D]")
    wrong = np.flatnonzero((hour < 0) | (hour > 24) | (minute >= 60.0) | (np.abs(zone) > 15.0))
    if wrong.size:
        k = int(wrong[0])
        raise InvalidInput(
            f"TIME in {table.name}",
            f"{clock[k]:g} with TIMEZONE {zone[k]:g} in line {here.line[k]}",
            "give hours and decimal minutes (11:59:40 pm is 2359.6667) and a zone in hours",
        )
    since = (days - days[0]).astype(float) * 86400.0
    exact = since + 3600.0 * (hour + zone) + 60.0 * minute
    # the format has four decimals of a minute, 6 ms
    second = np.full(len(table), np.nan)
    second[measured] = np.round(exact, 2)
    return second, str(days[0].astype("datetime64[ms]")), ()


def _day(table: Table, k: int, value: float) -> np.datetime64:
    text = f"{value:08.0f}"
    try:
        if value != round(value) or len(text) != 8 or value < _FIRST_DAY:
            raise ValueError
        return np.datetime64(f"{text[:4]}-{text[4:6]}-{text[6:]}")
    except ValueError:
        raise InvalidInput(
            f"DATE in {table.name}", f"{value:g} in line {table.line[k]}", "give YYYYMMDD, such as 19720530"
        ) from None
