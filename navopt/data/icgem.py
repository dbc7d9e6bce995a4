"""Grids of the ICGEM calculation service: text files that end in ``.gdf``.

The International Centre for Global Earth Models computes grids of gravity functionals from any published
model. A file has a header of keys and values up to the line ``end_of_head``, then one line per node:
longitude, latitude, possibly a height, and the value. See Barthelmes and Koehler (2016), J. Geodesy 90:907,
and Ince et al. (2019), Earth Syst. Sci. Data 11:647.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from navopt.data.grid_files import Grid, finished_grid
from navopt.errors import InvalidInput

__all__ = ["END_OF_HEAD", "icgem_header", "read_icgem"]

#: What ends a header.
END_OF_HEAD = "end_of_head"
#: Where a value is within a line, by ``grid_format``.
_COLUMNS = {"long_lat_value": (0, 1, 2), "long_lat_h_value": (0, 1, 3)}
#: Coordinates nearer than this are the same grid line, degrees; files have 4 to 12 decimals.
_SAME_LINE = 1e-7


def icgem_header(path: str | os.PathLike[str]) -> dict[str, str]:
    """Read the header of an ICGEM grid.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    dict of str to str
        Keys and values as they stand, such as ``functional`` and ``unit``.

    Raises
    ------
    InvalidInput
        If the file does not exist or has no end of a header.
    """
    return _header(_text(path), Path(path).name)[0]


def read_icgem(path: str | os.PathLike[str], *, unit: str | None = None) -> Grid:
    """Read a map from an ICGEM grid.

    Parameters
    ----------
    path : path-like
        The file.
    unit : str, optional, keyword-only
        What the numbers are in, where the header is silent or wrong.

    Returns
    -------
    latitude_deg, longitude_deg : ndarray
        Uniform ascending axes.
    values : ndarray, shape (n_latitude, n_longitude)
        In mGal if the unit is one of gravity, as in the file otherwise.
    unit : str
        ``"mGal"``, or the override as given.

    Raises
    ------
    InvalidInput
        If the header or the numbers cannot be used; the message names the remedy.

    Notes
    -----
    The header's numbers of parallels and meridians must agree with the nodes; the nodes' own coordinates
    make the axes, since limits and step in headers are rounded.
    """
    text, name = _text(path), Path(path).name
    header, body = _header(text, name)
    layout = header.get("grid_format", "").split(" ")[0] or "long_lat_value"
    if layout not in _COLUMNS:
        raise InvalidInput("grid_format", layout, f"{name}: ask the service for one of {', '.join(_COLUMNS)}")
    table = _numbers(body, name)
    if table.shape[1] <= max(_COLUMNS[layout]):
        raise InvalidInput(
            "path", name, f"{table.shape[1]} numbers in a line are too few for grid_format {layout}"
        )
    lon, lat, values = (table[:, k] for k in _COLUMNS[layout])
    rows, row = _lines(lat)
    columns, column = _lines(lon)
    _check_counts(header, name, rows.size, columns.size, len(table))
    field = np.full((rows.size, columns.size), np.nan)
    field[row, column] = values
    gap = _number(header.get("gapvalue"))
    if gap is not None:
        field[field == gap] = np.nan
    stated = header.get("unit")
    return finished_grid(rows, columns, field, stated, unit)


def _text(path: str | os.PathLike[str]) -> str:
    file = Path(path)
    if not file.is_file():
        raise InvalidInput("path", str(path), "no such file")
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise InvalidInput("path", str(path), f"give a file that can be read ({error})") from None


def _header(text: str, name: str) -> tuple[dict[str, str], str]:
    """Keys and values, and what follows the header."""
    head, mark, rest = text.partition(END_OF_HEAD)
    if not mark:
        raise InvalidInput("path", name, f"not an ICGEM grid: there is no line {END_OF_HEAD!r}")
    found = {}
    for line in head.splitlines():
        key, _, value = line.strip().partition(" ")
        # the two lines that name the columns are no keys; they come last, after a blank line
        if value.strip() and key not in ("longitude", "latitude") and not key.startswith("["):
            found[key] = value.strip()
    return found, rest.partition("\n")[2]


def _numbers(body: str, name: str) -> np.ndarray:
    """The node lines as a table."""
    lines = [line for line in body.splitlines() if line.strip()]
    try:
        table = np.loadtxt(lines, ndmin=2) if lines else np.empty((0, 3))
    except ValueError as error:
        raise InvalidInput(
            "path", name, f"every line after the header needs the same numbers ({error})"
        ) from None
    if len(table) < 4:
        raise InvalidInput(
            "path", f"{name}: {len(table)} nodes", "a map needs two grid lines in each direction"
        )
    if not np.isfinite(table[:, :2]).all():
        raise InvalidInput("path", name, "longitudes and latitudes must be numbers")
    return table


def _lines(coordinate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grid lines in the order in which they first occur, and the line of every node."""
    _, first, place = np.unique(np.round(coordinate / _SAME_LINE), return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    return coordinate[first[order]], rank[place]


def _check_counts(header: dict[str, str], name: str, rows: int, columns: int, nodes: int) -> None:
    if rows * columns != nodes:
        raise InvalidInput(
            "path",
            f"{name}: {nodes} nodes on {rows} parallels and {columns} meridians",
            "the file is cut short or no full grid: fetch it again",
        )
    for key, found in (
        ("latitude_parallels", rows),
        ("longitude_parallels", columns),
        ("number_of_gridpoints", nodes),
    ):
        stated = _number(header.get(key))
        if stated is not None and stated != found:
            raise InvalidInput(
                "path",
                f"{name}: {found} where the header's {key} says {stated:g}",
                "the file is cut short or was edited: fetch it again",
            )


def _number(text: str | None) -> float | None:
    """First number of a value such as ``9999999.0000`` or ``3.5E+0 mgal``."""
    try:
        return float(text.split()[0]) if text else None
    except ValueError:
        return None
