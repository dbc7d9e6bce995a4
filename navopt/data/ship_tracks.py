"""Marine trackline geophysics as CSV: a ship's true positions and what its gravimeter read there.

The rows are those of a trackline archive (NOAA NCEI distributes such data in MGD77 formats): a time, latitude
and longitude in degrees, and the free-air anomaly in mGal, about one row a minute.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import distance

__all__ = ["ShipTrack", "read_ship_csv"]

Array = NDArray[np.float64]

#: A row that lies farther than this from where its neighbours place it has a wrong time, m.
MISPLACED = 500.0
#: Farther than this from where its corrected time places it, it is left out, m.
UNEXPLAINED = 1000.0
#: Neighbours farther apart in time place nothing, s.
NEIGHBOURS = 1800.0
#: No ship that surveys is faster, m/s.
FASTEST = 15.0


@dataclass(frozen=True, kw_only=True)
class ShipTrack:
    """Rows of a cruise, in the order of their times. The arrays are read-only.

    Attributes
    ----------
    time : ndarray, shape (N,)
        Seconds since the first row of the file.
    latitude, longitude : ndarray, shape (N,)
        True position, rad; the longitude without a jump.
    anomaly : ndarray, shape (N,)
        Free-air anomaly by the gravimeter, mGal.
    row : ndarray of int, shape (N,)
        Row of the file, the first after the header being 0.
    moved, dropped : int
        Number of rows whose time was corrected, and that were left out because no time explains them.
    """

    time: Array
    latitude: Array
    longitude: Array
    anomaly: Array
    row: NDArray[np.int64]
    moved: int = 0
    dropped: int = 0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def __len__(self) -> int:
        return len(self.time)

    def segment(self, row: int, hours: float) -> ShipTrack:
        """Cut out a stretch; its time begins with zero.

        Parameters
        ----------
        row : int
            Row of the file at which it begins.
        hours : float
            Its length. A cruise that ends before is an error.

        Returns
        -------
        ShipTrack

        Raises
        ------
        InvalidInput
            If there is no such row, the cruise does not last, or an hour or more is missing in between.
        """
        at = np.flatnonzero(self.row == row)
        if not at.size:
            raise InvalidInput("row", row, f"give one of {int(self.row.min())} to {int(self.row.max())}")
        begin = self.time[at[0]]
        inside = (self.time >= begin) & (self.time <= begin + 3600.0 * hours)
        time = self.time[inside] - begin
        # the last row may be ten minutes short: an archive leaves rows out
        if time[-1] < 3600.0 * hours - 1200.0 or np.diff(time).max() >= 3600.0:
            ends = time[np.argmax(np.diff(time, append=np.inf) >= 3600.0)] / 3600.0
            raise InvalidInput(
                "hours", hours, f"from row {row} on the record lasts {ends:.1f} h without a gap"
            )
        return ShipTrack(
            time=time,
            latitude=self.latitude[inside],
            longitude=self.longitude[inside],
            anomaly=self.anomaly[inside],
            row=self.row[inside],
        )

    def means(self, interval: float = 300.0, *, at_least: int = 3) -> ShipTrack:
        """Average over intervals, as a gravimeter's filter does.

        Parameters
        ----------
        interval : float
            Length of the intervals, s.
        at_least : int, keyword-only
            Intervals with fewer rows are left out.

        Returns
        -------
        ShipTrack
            Mean times, positions and anomalies; the row is the first of the interval.

        Raises
        ------
        InvalidInput
            If nothing is left.
        """
        if not (np.isfinite(interval) and interval > 0.0):
            raise InvalidInput("interval", interval, "give a positive number of seconds")
        _, first, which, count = np.unique(
            np.floor(self.time / interval), return_index=True, return_inverse=True, return_counts=True
        )
        full = count >= at_least
        if not full.any():
            raise InvalidInput("interval", interval, f"no interval holds {at_least} rows; give a longer one")

        def mean(values: Array) -> Array:
            return np.asarray(np.bincount(which, values) / count)[full]

        return ShipTrack(
            time=mean(self.time),
            latitude=mean(self.latitude),
            longitude=mean(self.longitude),
            anomaly=mean(self.anomaly),
            row=self.row[first][full],
        )


def read_ship_csv(
    path: str | Path,
    *,
    time: str | None = None,
    latitude: str = "LAT",
    longitude: str = "LON",
    anomaly: str = "FREEAIR",
) -> ShipTrack:
    """Read a cruise, and put rows with a wrong minute where they belong.

    Parameters
    ----------
    path : path-like
        The CSV file.
    time, latitude, longitude, anomaly : str, keyword-only
        Columns; the time is the first column if not given.

    Returns
    -------
    ShipTrack
        Rows without an anomaly are left out.

    Raises
    ------
    InvalidInput
        If the file does not exist, holds no usable row, or times do not increase once corrected.
    UnknownName
        If a column does not exist.

    Notes
    -----
    Some files have lost the leading zero of the minutes: 1 to 5 are written as 10 to 50 and sorted in there,
    6 to 9 are gone. A row of minute 10, 20 … 50 that lies more than 500 m from where its neighbours in time
    place it, and belongs to minute 1, 2 … 5 by the same rule, is moved there. A file that is right is
    read as it is.
    """
    return _read(str(path), time, latitude, longitude, anomaly, _stamp(Path(path)))


def _stamp(file: Path) -> int:
    if not file.is_file():
        raise InvalidInput("path", str(file), "give an existing CSV file")
    return file.stat().st_mtime_ns


@lru_cache(maxsize=4)
def _read(path: str, time: str | None, latitude: str, longitude: str, anomaly: str, _: int) -> ShipTrack:
    import pandas as pd

    try:
        table = pd.read_csv(path)
    except pd.errors.EmptyDataError:
        raise InvalidInput("path", path, "the file is empty") from None
    names = [str(name) for name in table.columns]
    stamp = names[0] if time is None else time
    for column in (stamp, latitude, longitude, anomaly):
        if column not in names:
            raise UnknownName(f"column of {Path(path).name}", column, names)
    stamps = pd.to_datetime(table[stamp], utc=True, format="ISO8601", errors="coerce")
    numbers = table[[latitude, longitude, anomaly]].apply(pd.to_numeric, errors="coerce")
    usable = (stamps.notna() & numbers.notna().all(axis=1)).to_numpy()
    if usable.sum() < 2:
        raise InvalidInput("path", path, "give a file with times, positions and anomalies")
    stamps, numbers = stamps[usable], numbers[usable]
    seconds = (stamps - stamps.iloc[0]).dt.total_seconds().to_numpy()
    lat = np.radians(numbers[latitude].to_numpy(dtype=float))
    lon = np.unwrap(np.radians(numbers[longitude].to_numpy(dtype=float)))
    minute = stamps.dt.minute.to_numpy()
    corrected, kept = _placed(seconds, lat, lon, minute)
    order = np.flatnonzero(kept)[np.argsort(corrected[kept], kind="stable")]
    order = order[np.diff(corrected[order], prepend=-np.inf) > 0.0]
    return ShipTrack(
        time=corrected[order],
        latitude=lat[order],
        longitude=lon[order],
        anomaly=numbers[anomaly].to_numpy(dtype=float)[order],
        row=np.flatnonzero(usable)[order],
        moved=int(np.sum(corrected[order] != seconds[order])),
        dropped=int(len(seconds) - len(order)),
    )


def _placed(time: Array, latitude: Array, longitude: Array, minute: Any) -> tuple[Array, NDArray[np.bool_]]:
    """Corrected times, and which rows any time explains."""
    suspect = np.isin(minute, (10, 20, 30, 40, 50))
    trusted = ~suspect
    corrected, kept = time.copy(), np.ones(len(time), dtype=bool)
    if not suspect.any() or trusted.sum() < 2:
        return corrected, kept
    known, lat, lon = time[trusted], latitude[trusted], longitude[trusted]

    def misfit(times: Array) -> Array:
        after = np.clip(np.searchsorted(known, times), 1, len(known) - 1)
        apart = distance(
            np.interp(times, known, lat),
            np.interp(times, known, lon),
            latitude[suspect],
            longitude[suspect],
        )
        placed = (known[after] - known[after - 1] <= NEIGHBOURS) & (times > known[0]) & (times < known[-1])
        return np.where(placed, apart, np.inf)

    tens = minute[suspect]
    as_written, without_zero = time[suspect], time[suspect] - 60.0 * (tens - tens // 10)
    here, there = misfit(as_written), misfit(without_zero)
    judged = np.isfinite(here) | np.isfinite(there)
    moved = (here > MISPLACED) & (there < np.minimum(here, UNEXPLAINED))
    corrected[suspect] = np.where(moved, without_zero, as_written)
    kept[suspect] = ~judged | moved | (here <= UNEXPLAINED)
    # what no neighbour can judge stays where it is, unless the ship would have had to fly there
    unsure = np.zeros(len(time), dtype=bool)
    unsure[suspect] = ~judged
    order = np.flatnonzero(kept)[np.argsort(corrected[kept], kind="stable")]
    lat, lon = latitude[order], longitude[order]
    step = np.maximum(np.diff(corrected[order]), 1.0)
    flown = distance(lat[1:], lon[1:], lat[:-1], lon[:-1]) / step > FASTEST
    either = np.append(flown, False) | np.append(False, flown)
    kept[order[either & unsure[order]]] = False
    return corrected, kept
