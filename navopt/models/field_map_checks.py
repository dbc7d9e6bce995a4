"""What stands behind a field map: the checks of its axes and values, its spline, its checksum."""

from __future__ import annotations

import hashlib
import math

import numpy as np
from numpy.typing import ArrayLike

from navopt.errors import InvalidInput, UnknownName

__all__ = [
    "check_method",
    "checked_grid",
    "data_checksum",
    "flat_points",
    "refuse_gaps",
    "spline_coefficients",
]


METHODS = ("bilinear", "bicubic")


def check_method(method: str) -> str:
    """Return the name of an interpolation, or raise :class:`UnknownName`.

    Parameters
    ----------
    method : str
        One of ``METHODS``.

    Returns
    -------
    str
    """
    if method not in METHODS:
        raise UnknownName("method", method, METHODS)
    return method


def checked_grid(
    latitude: ArrayLike, longitude: ArrayLike, values: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return read-only copies of axes and values, or say what is wrong with them.

    Parameters
    ----------
    latitude, longitude : array_like
        Axes in radians.
    values : array_like, shape (n_latitude, n_longitude)
        The field at the nodes.

    Returns
    -------
    latitude, longitude, values : ndarray
        Read-only, C-contiguous float64, the axes exactly uniform.

    Raises
    ------
    InvalidInput
        As listed for :class:`navopt.models.field_map.FieldMap`.
    """
    rows, columns = _uniform("latitude", latitude), _uniform("longitude", longitude)
    if np.abs(rows).max() > math.pi / 2 + 1e-9:
        raise InvalidInput(
            "latitude",
            f"{rows[0]:.6g} to {rows[-1]:.6g}",
            "give radians in [-pi/2, pi/2], or use FieldMap.from_degrees",
        )
    if columns[-1] - columns[0] > 2 * math.pi + 1e-9 or np.abs(columns).max() > 4 * math.pi + 1e-9:
        raise InvalidInput(
            "longitude",
            f"{columns[0]:.6g} to {columns[-1]:.6g}",
            "give radians over at most one turn, or use FieldMap.from_degrees",
        )
    grid = np.array(values, dtype=float, order="C")
    if grid.shape != (rows.size, columns.size):
        raise InvalidInput(
            "values",
            f"shape {grid.shape}",
            f"give (latitude, longitude) = {(rows.size, columns.size)}; transpose it if need be",
        )
    refuse_gaps(grid, np.degrees(rows), np.degrees(columns))
    grid.flags.writeable = False
    return rows, columns, grid


def refuse_gaps(values: np.ndarray, latitude_deg: np.ndarray, longitude_deg: np.ndarray) -> None:
    """Raise if any cell is NaN or infinite, naming how many and where the first one is.

    Parameters
    ----------
    values : ndarray, shape (n_latitude, n_longitude)
        The field.
    latitude_deg, longitude_deg : ndarray
        Its axes in degrees.

    Raises
    ------
    InvalidInput
        If there is such a cell.
    """
    bad = ~np.isfinite(values)
    if bad.any():
        i, j = np.argwhere(bad)[0]
        raise InvalidInput(
            "values",
            f"{int(bad.sum())} cells without a value, the first at {latitude_deg[i]:.4f}°, "
            f"{longitude_deg[j]:.4f}°",
            "fill the gaps (`gmt grdfill`) or crop to a part without any: a track must not meet a hole",
        )


def flat_points(latitude: ArrayLike, longitude: ArrayLike) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
    """Broadcast points and lay them out flat and contiguous for the compiled loops.

    Parameters
    ----------
    latitude, longitude : array_like
        Points in radians.

    Returns
    -------
    latitude, longitude : ndarray, shape (n,)
        The points.
    shape : tuple of int
        Their broadcast shape.

    Raises
    ------
    InvalidInput
        If the shapes do not broadcast.
    """
    lat = np.asarray(latitude, dtype=np.float64)
    lon = np.asarray(longitude, dtype=np.float64)
    if lat.shape != lon.shape:
        shapes = f"shapes {lat.shape} and {lon.shape}"
        try:
            lat, lon = np.broadcast_arrays(lat, lon)
        except ValueError:
            raise InvalidInput("latitude, longitude", shapes, "give shapes that broadcast") from None
    shape = lat.shape
    return np.ascontiguousarray(lat).reshape(-1), np.ascontiguousarray(lon).reshape(-1), shape


def spline_coefficients(values: np.ndarray) -> np.ndarray:
    """Prefilter a grid for cubic B-splines, with one mirrored line added on each side.

    Parameters
    ----------
    values : ndarray, shape (n_rows, n_columns)
        The grid.

    Returns
    -------
    ndarray, shape (n_rows + 2, n_columns + 2)
        Read-only.
    """
    from scipy.ndimage import spline_filter

    inner = spline_filter(values, order=3, output=np.float64, mode="mirror")
    padded = np.ascontiguousarray(np.pad(inner, 1, mode="reflect"))
    padded.flags.writeable = False
    return padded


def data_checksum(axes_deg: tuple[float, ...], values: np.ndarray, unit: str) -> str:
    """Return the SHA-256 of a map's axes, values and unit, the same on every platform.

    Parameters
    ----------
    axes_deg : tuple of float
        Bounds and steps in degrees; they enter as text rounded to 0.1 mm, so that a round trip through
        degrees in a file keeps the sum.
    values : ndarray
        The field.
    unit : str
        Its unit.

    Returns
    -------
    str
    """
    ends = " ".join(f"{end:.9f}" for end in axes_deg)
    digest = hashlib.sha256(f"{values.shape} {ends} {unit}\n".encode())
    digest.update(values.astype("<f8", copy=False).tobytes())
    return digest.hexdigest()


def _uniform(name: str, given: ArrayLike) -> np.ndarray:
    """Return a uniform ascending read-only axis."""
    axis = np.array(given, dtype=float)
    if axis.ndim != 1 or axis.size < 2:
        raise InvalidInput(name, f"shape {axis.shape}", "give at least two grid lines, one-dimensional")
    if not np.isfinite(axis).all():
        raise InvalidInput(name, "NaN or infinite entries", "give finite grid lines in radians")
    if not (np.diff(axis) > 0).all():
        raise InvalidInput(
            name, f"{axis[0]:.9g} to {axis[-1]:.9g}", "give it ascending (flip the values too)"
        )
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    uniform = axis[0] + step * np.arange(axis.size)
    uniform[-1] = axis[-1]
    off = np.abs(axis - uniform)
    worst = int(off.argmax())
    # A millionth of a cell is rounding; more moves every look-up by a part of a cell without a word.
    if off[worst] > 1e-6 * step + 8 * np.spacing(np.abs(axis).max()):
        raise InvalidInput(
            name,
            f"line {worst} lies {off[worst] / step:.3g} steps from where a uniform axis has it",
            "resample the map to uniform spacing before loading it",
        )
    uniform.flags.writeable = False
    return uniform
