"""Recorded tracks: positions with a measured field value, from arrays or a CSV file."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from navopt.errors import InvalidInput, UnknownName

__all__ = ["MeasuredTrack", "read_track_csv"]


@dataclass(frozen=True, kw_only=True)
class MeasuredTrack:
    """Positions an INS indicated, what the field sensor measured there, and the truth if it is known.

    Attributes
    ----------
    time : ndarray, shape (N,)
        Seconds, increasing.
    latitude, longitude : ndarray, shape (N,)
        Indicated position, rad.
    measured : ndarray, shape (N,)
        Measured field value, in the map's unit (mGal for gravity).
    true_latitude, true_longitude : ndarray, shape (N,), or None
        Reference position, rad.
    heading : ndarray, shape (N,), or None
        Heading the INS indicates, clockwise from north, rad. It says how the sensors lay, so methods
        that model their errors want it.

    Raises
    ------
    InvalidInput
        If lengths differ, a value is not finite, times do not increase, or angles look like degrees.
    """

    time: np.ndarray
    latitude: np.ndarray
    longitude: np.ndarray
    measured: np.ndarray
    true_latitude: np.ndarray | None = None
    true_longitude: np.ndarray | None = None
    heading: np.ndarray | None = None

    def __post_init__(self) -> None:
        if (self.true_latitude is None) != (self.true_longitude is None):
            raise InvalidInput("true_latitude, true_longitude", "only one of them", "give both or none")
        length = np.size(self.time)
        for item in fields(self):
            given = getattr(self, item.name)
            if given is None:
                continue
            values = np.array(given, dtype=float)
            if values.shape != (length,):
                raise InvalidInput(item.name, values.shape, f"give one value per time, shape ({length},)")
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise InvalidInput(
                    item.name,
                    f"{bad.size} values that are not finite, the first at sample {bad[0]}",
                    "drop those samples",
                )
            values.setflags(write=False)
            object.__setattr__(self, item.name, values)
        backwards = np.flatnonzero(np.diff(self.time) <= 0)
        if backwards.size:
            k = int(backwards[0])
            raise InvalidInput(
                "time",
                f"{self.time[k]:g} then {self.time[k + 1]:g} at sample {k + 1}",
                "times must increase: sort the samples and drop repeated ones",
            )
        for name in ("latitude", "true_latitude"):
            values = getattr(self, name)
            if values is not None and np.abs(values).max(initial=0.0) > np.pi / 2:
                raise InvalidInput(name, float(np.abs(values).max()), "give radians: numpy.radians(degrees)")
        for name in ("longitude", "true_longitude", "heading"):
            values = getattr(self, name)
            if values is not None and np.abs(values).max(initial=0.0) > 2 * np.pi:
                raise InvalidInput(name, float(np.abs(values).max()), "give radians: numpy.radians(degrees)")

    def __len__(self) -> int:
        return len(self.time)


def read_track_csv(
    path: str | Path,
    *,
    measured: str,
    time: str = "time",
    latitude: str = "latitude",
    longitude: str = "longitude",
    true_latitude: str | None = None,
    true_longitude: str | None = None,
    heading: str | None = None,
) -> MeasuredTrack:
    """Read a track with positions in degrees from a CSV file with a header.

    Parameters
    ----------
    path : path-like
        The file.
    measured : str
        Column of the measured field, in the map's unit.
    time : str
        Column of the time: seconds, or dates and times (then seconds since the first row).
    latitude, longitude : str
        Columns of the indicated position, degrees.
    true_latitude, true_longitude : str, optional
        Columns of a reference position, degrees.
    heading : str, optional
        Column of the heading the INS indicated, clockwise from north, degrees.

    Returns
    -------
    MeasuredTrack
        Rows without a measured value are left out.

    Raises
    ------
    InvalidInput
        If the file does not exist or its content cannot be used.
    UnknownName
        If a column does not exist; the nearest is suggested.
    """
    import pandas as pd

    file = Path(path)
    if not file.is_file():
        raise InvalidInput("path", str(path), "give an existing CSV file")
    try:
        table = pd.read_csv(file)
    except pd.errors.EmptyDataError:
        raise InvalidInput("path", str(path), "the file is empty") from None
    wanted = {
        "time": time,
        "latitude": latitude,
        "longitude": longitude,
        "measured": measured,
        "true_latitude": true_latitude,
        "true_longitude": true_longitude,
        "heading": heading,
    }
    columns = {name: column for name, column in wanted.items() if column is not None}
    for name, column in columns.items():
        if column not in table.columns:
            raise UnknownName(f"column for {name} in {file.name}", column, map(str, table.columns))
    table = table[table[measured].notna()]
    if table.empty:
        raise InvalidInput(f"column {measured}", "no value", "give a column with at least one measured value")
    arrays: dict[str, ArrayLike] = {}
    for name, column in columns.items():
        series = table[column]
        if name == "time" and not pd.api.types.is_numeric_dtype(series):
            stamps = pd.to_datetime(series, utc=True, format="ISO8601", errors="coerce")
            if stamps.isna().any():
                raise InvalidInput(f"column {column}", "unreadable times", "give seconds or ISO dates")
            arrays[name] = (stamps - stamps.iloc[0]).dt.total_seconds().to_numpy()
        elif not pd.api.types.is_numeric_dtype(series):
            raise InvalidInput(f"column {column}", str(series.dtype), "give a column of numbers")
        else:
            values = series.to_numpy(dtype=float)
            arrays[name] = values if name in ("time", "measured") else np.radians(values)
    return MeasuredTrack(**arrays)  # type: ignore[arg-type]
