"""Columns of a table of text: numbers, times and longitudes, with the line named where one is wrong."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from navopt.errors import InvalidInput

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Table", "numbers", "read_table", "seconds", "unwrapped_deg"]

_ZONE = re.compile(r"([zZ]|[+-]\d\d:?(\d\d)?)$")


@dataclass(frozen=True)
class Table:
    """A file of columns, every cell as text.

    Attributes
    ----------
    frame : pandas.DataFrame
        The cells; an empty one is NaN.
    line : ndarray of int
        Line of the file in which each row stands.
    name : str
        Name of the file.
    notes : tuple of str
        Remarks of the reader.
    """

    frame: pd.DataFrame
    line: np.ndarray
    name: str
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return [str(name) for name in self.frame.columns]

    def column(self, name: str) -> str | None:
        """Return the column of this name, upper or lower case if no other fits; None if there is none."""
        if name in self.columns:
            return name
        near = [column for column in self.columns if column.lower() == name.lower()]
        return near[0] if len(near) == 1 else None

    def kept(self, mask: np.ndarray) -> Table:
        """Return the rows of a mask."""
        return replace(self, frame=self.frame[mask], line=self.line[mask])


def read_table(path: str | Path, *, separator: str = ",") -> Table:
    """Read a file of columns with a header line.

    Parameters
    ----------
    path : path-like
        The file, in UTF-8.
    separator : str, keyword-only
        What stands between the cells.

    Returns
    -------
    Table
        Empty lines are left out.

    Raises
    ------
    InvalidInput
        If it does not exist, is no text, is empty or has lines of different lengths.
    """
    import pandas as pd

    file = Path(path)
    if not file.is_file():
        raise InvalidInput("track", str(path), "give an existing file: CSV, or MGD77T (.m77t)")
    try:
        frame = pd.read_csv(
            file,
            sep=separator,
            dtype=str,
            skip_blank_lines=False,
            skipinitialspace=True,
            encoding="utf-8-sig",
        )
    except pd.errors.EmptyDataError:
        raise InvalidInput("track", file.name, "the file is empty") from None
    except (pd.errors.ParserError, UnicodeDecodeError, OSError) as error:
        reason = " ".join(str(error).split())
        raise InvalidInput(
            "track", file.name, f"give a table of text with one header line ({reason})"
        ) from None
    if not isinstance(frame.index, pd.RangeIndex):
        # pandas would take the first cells for names of rows, and every value for its neighbour's
        raise InvalidInput("track", file.name, "its lines have more cells than the header line has names")
    frame.columns = [str(name).strip() for name in frame.columns]
    line = np.arange(2, len(frame) + 2)
    filled = frame.notna().any(axis=1).to_numpy()
    if not filled.any():
        raise InvalidInput("track", file.name, "there is no row below the header line")
    return Table(frame[filled], line[filled], file.name)


def numbers(table: Table, column: str, *, missing: bool = False) -> np.ndarray:
    """Return a column as numbers.

    Parameters
    ----------
    table : Table
        The file.
    column : str
        Name of the column.
    missing : bool, keyword-only
        Whether empty cells are allowed; they become NaN.

    Returns
    -------
    ndarray, shape (N,)

    Raises
    ------
    InvalidInput
        If a cell is no number, or empty where it must not be; the line is named.
    """
    import pandas as pd

    cells = table.frame[column]
    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float)
    empty = cells.isna().to_numpy() | cells.astype(str).str.strip().str.lower().isin(["", "nan"]).to_numpy()
    wrong = np.flatnonzero(~np.isfinite(values) & (~empty if missing else True))
    if wrong.size:
        k = int(wrong[0])
        shown = "an empty cell" if empty[k] else repr(str(cells.iloc[k]))
        more = f" and {wrong.size - 1} more" if wrong.size > 1 else ""
        raise InvalidInput(
            f"column {column} of {table.name}", f"{shown} in line {table.line[k]}{more}", "give numbers there"
        )
    return values


def seconds(table: Table, column: str, kept: np.ndarray) -> tuple[np.ndarray, str | None, tuple[str, ...]]:
    """Return a column of times as seconds.

    Parameters
    ----------
    table : Table
        The file.
    column : str
        Name of the column: numbers are seconds, everything else ISO 8601 dates and times.
    kept : ndarray of bool, shape (N,)
        Rows that count; the others may lack a time.

    Returns
    -------
    second : ndarray, shape (N,)
        As in the file, or since `start`; NaN in rows that do not count.
    start : str or None
        ISO date and time (UTC) of the first row that counts, where there are dates.
    notes : tuple of str
        What was assumed.

    Raises
    ------
    InvalidInput
        If a time cannot be read, or some have a zone and others have none.
    """
    import pandas as pd

    cells = table.frame[column][kept].astype(str).str.strip()
    line = table.line[kept]
    out = np.full(len(table), np.nan)
    plain = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float)
    if np.isfinite(plain).all():
        out[kept] = plain
        return out, None, ()
    stamps = pd.to_datetime(cells, utc=True, format="ISO8601", errors="coerce")
    wrong = np.flatnonzero(stamps.isna().to_numpy())
    if wrong.size:
        k = int(wrong[0])
        raise InvalidInput(
            f"column {column} of {table.name}",
            f"{cells.iloc[k]!r} in line {line[k]}",
            "give seconds, or ISO 8601 dates and times with a zone, such as 2017-09-11T14:49:00Z",
        )
    zoned = np.array([bool(_ZONE.search(text[10:])) for text in cells])
    if zoned.any() and not zoned.all():
        k = int(np.flatnonzero(zoned != zoned[0])[0])
        raise InvalidInput(
            f"column {column} of {table.name}",
            f"times with a zone and without, the first other one in line {line[k]}",
            "give the zone everywhere (Z for UTC)",
        )
    first = stamps.iloc[0]
    out[kept] = (stamps - first).dt.total_seconds().to_numpy()
    notes = () if zoned.all() else ("times without a zone are taken as UTC",)
    return out, first.tz_localize(None).isoformat(timespec="milliseconds"), notes


def unwrapped_deg(longitude: np.ndarray) -> np.ndarray:
    """Return longitudes without a jump at the date line, the first from -180 up to 180 degrees."""
    continuous = np.unwrap(longitude, period=360.0)
    return continuous - 360.0 * np.floor((continuous[0] + 180.0) / 360.0)
