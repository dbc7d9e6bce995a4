"""Reading and writing gridded maps: CF and GMT NetCDF files, and the files of this package.

Everything a map file may do differently is settled here (names, order, longitudes, packing, units,
registration), so that :class:`navopt.models.field_map.FieldMap` sees ascending uniform axes and
finite values only, or the user one error that names the remedy.
"""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navopt.data.gravity_units import UNITS, plain_unit
from navopt.errors import InvalidInput

if TYPE_CHECKING:
    import xarray

__all__ = ["EMBEDDED_DEGREES", "embedded_path", "finished_grid", "grid_of", "read_grid", "write_grid"]

#: Degrees of the gravity maps in this folder.
EMBEDDED_DEGREES = (720, 2190)

_LATITUDES = ("lat", "latitude", "y", "nav_lat")
_LONGITUDES = ("lon", "longitude", "x", "nav_lon")
Grid = tuple[np.ndarray, np.ndarray, np.ndarray, str]


def embedded_path(degree: int) -> Path:
    """Path of an embedded gravity map, its checksum verified once in a process.

    Parameters
    ----------
    degree : {720, 2190}
        Maximum degree of the map.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    InvalidInput
        Another degree, a missing file, or one that does not match ``SHA256SUMS``.
    """
    if degree not in EMBEDDED_DEGREES:
        raise InvalidInput(
            "degree",
            degree,
            f"embedded are {EMBEDDED_DEGREES}; navopt.data.egm2008.free_air_anomaly computes any other",
        )
    return _verified(int(degree))


@functools.cache
def _verified(degree: int) -> Path:
    path = Path(__file__).parent / f"free_air_egm2008_d{degree}.nc"
    remedy = "reinstall navopt, or rebuild the file with `python -m navopt.data.egm2008`"
    lines = (path.parent / "SHA256SUMS").read_text(encoding="ascii").split("\n")
    expected = {line.split()[1]: line.split()[0] for line in lines if line}
    if not path.is_file():
        raise InvalidInput("embedded map", f"no file {path.name}", remedy)
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if found != expected.get(path.name):
        raise InvalidInput("embedded map", f"{path.name} with checksum {found[:12]}...", remedy)
    return path


def read_grid(path: str | os.PathLike[str], variable: str | None = None, *, unit: str | None = None) -> Grid:
    """Read a map from a NetCDF file.

    NetCDF-4 is read through h5netcdf, classic NetCDF through scipy. Understood are CF files and the
    grids of GMT, new (``x``/``y``/``z`` or ``lon``/``lat``) and old (one-dimensional ``z``). In a
    pixel-registered grid (GMT's ``node_offset = 1``) the values belong to cell centres, and so do the
    axes returned.

    Parameters
    ----------
    path : path-like
        The file.
    variable : str, optional
        The variable to read; needed only when there are several.
    unit : str, optional, keyword-only
        What the numbers are in, where the file is silent or wrong.

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
        Whatever cannot be settled; the message names the remedy.
    """
    import xarray

    path = Path(path)
    if not path.is_file():
        raise InvalidInput("path", str(path), "no such file")
    with path.open("rb") as file:
        magic = file.read(4)
    if magic[:3] == b"CDF":
        engine = "scipy"
    elif magic == b"\x89HDF":
        engine = "h5netcdf"
    else:
        raise InvalidInput(
            "path", path.name, "not NetCDF; convert it, or use FieldMap.from_degrees on arrays"
        )
    with xarray.open_dataset(path, engine=engine, mask_and_scale=False, decode_times=False) as data:
        return grid_of(data.load(), variable, unit=unit)


def grid_of(dataset: xarray.Dataset, variable: str | None = None, *, unit: str | None = None) -> Grid:
    """Take a map out of an open dataset, by the rules and with the results of :func:`read_grid`.

    Parameters
    ----------
    dataset : xarray.Dataset
        Decoded or not: packing attributes that are still on the variable are applied.
    variable : str, optional
        The variable to read; needed only when there are several.
    unit : str, optional, keyword-only
        What the numbers are in, where the dataset is silent or wrong.

    Returns
    -------
    latitude_deg, longitude_deg, values, unit
        As for :func:`read_grid`.
    """
    if {"x_range", "y_range", "dimension", "z"} <= set(dataset.variables):
        lat, lon, field = _old_gmt(dataset)
        attributes = dataset["z"].attrs
    else:
        lat, lon, array = _find(dataset, variable)
        attributes = array.attrs
        field = array.values
        _check_registration(dataset, lat, lon)
    return finished_grid(lat, lon, _unpack(field, attributes), attributes.get("units"), unit)


def finished_grid(
    lat: np.ndarray, lon: np.ndarray, values: np.ndarray, found_unit: Any, unit: str | None
) -> Grid:
    """Settle order, turn, seam, gaps and unit of a grid as it stands in a file.

    Parameters
    ----------
    lat, lon : ndarray
        Axes in degrees, in any order and turn.
    values : ndarray, shape (n_latitude, n_longitude)
        The field, NaN where there is none.
    found_unit : object
        Unit that the file states, or None.
    unit : str, optional
        What it is instead.

    Returns
    -------
    latitude_deg, longitude_deg, values, unit
        As for :func:`read_grid`.

    Raises
    ------
    InvalidInput
        As for :func:`read_grid`.
    """
    latitude = _uniform("latitude", lat)
    longitude = _uniform("longitude", _unwrap(lon))
    if latitude[0] > latitude[-1]:
        latitude, values = latitude[::-1], values[::-1]
    if longitude[0] > longitude[-1]:
        longitude, values = longitude[::-1], values[:, ::-1]
    from navopt.models.field_map_checks import refuse_gaps

    factor, label = _unit(found_unit, unit)
    refuse_gaps(values, latitude, longitude)
    # A map around the Earth without its first meridian repeated has a seam nobody asked for: close it.
    step = (longitude[-1] - longitude[0]) / (longitude.size - 1)
    if abs(longitude.size * step - 360.0) < 1e-6:
        longitude = np.append(longitude, longitude[0] + 360.0)
        values = np.concatenate([values, values[:, :1]], axis=1)
    if abs(longitude[0]) > 360.0 or abs(longitude[-1]) > 720.0:
        longitude = longitude - 360.0 * np.floor(longitude[0] / 360.0)
    return latitude, longitude, np.ascontiguousarray(values * factor), label


def write_grid(
    path: str | os.PathLike[str],
    latitude_deg: np.ndarray,
    longitude_deg: np.ndarray,
    values: np.ndarray,
    *,
    unit: str,
    name: str = "",
) -> None:
    """Write a map as CF NetCDF-4 (float64, compressed, gridline registration), readable by GMT too.

    Parameters
    ----------
    path : path-like
        The file; an existing one is replaced.
    latitude_deg, longitude_deg : ndarray
        Ascending axes.
    values : ndarray, shape (n_latitude, n_longitude)
        The field, stored as ``z``.
    unit, name : str
        Unit and long name of the field.
    """
    import xarray

    lat = {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"}
    lon = {"standard_name": "longitude", "units": "degrees_east", "axis": "X"}
    data = xarray.Dataset(
        {"z": (("lat", "lon"), values, {"long_name": name or "field", "units": unit})},
        coords={"lat": ("lat", latitude_deg, lat), "lon": ("lon", longitude_deg, lon)},
        attrs={"Conventions": "CF-1.8", "title": name, "node_offset": 0},
    )
    plain = {"_FillValue": None}
    packed = {"zlib": True, "shuffle": True, "complevel": 6, "_FillValue": np.nan}
    data.to_netcdf(path, engine="h5netcdf", encoding={"z": packed, "lat": plain, "lon": plain})


def _find(dataset: xarray.Dataset, variable: str | None) -> tuple[np.ndarray, np.ndarray, Any]:
    """Pick axes and variable; the variable comes back with its dimensions in order (lat, lon)."""

    def axis(names: tuple[str, ...], standard: str) -> str:
        for key in dataset.variables:
            one = dataset[key]
            if one.ndim == 1 and (str(key).lower() in names or one.attrs.get("standard_name") == standard):
                return str(key)
        have = ", ".join(map(str, dataset.variables))
        raise InvalidInput("path", f"variables {have}", f"rename the {standard} axis to {names[0]!r}")

    rows, columns = axis(_LATITUDES, "latitude"), axis(_LONGITUDES, "longitude")
    dims = {dataset[rows].dims[0], dataset[columns].dims[0]}
    fields = [str(key) for key, one in dataset.data_vars.items() if dims <= set(one.dims)]
    if variable is None:
        fields = ["z"] if "z" in fields else fields
        if len(fields) != 1:
            raise InvalidInput(
                "variable", None, f"name one of: {', '.join(fields) or '(no gridded variable)'}"
            )
        variable = fields[0]
    elif variable not in fields:
        raise InvalidInput("variable", variable, f"the gridded variables are: {', '.join(fields)}")
    array = dataset[variable]
    alone = [key for key in array.dims if key not in dims and array.sizes[key] == 1]
    array = array.squeeze(alone, drop=True)
    if array.ndim != 2:
        raise InvalidInput("variable", f"{variable} with dimensions {array.dims}", "select one map first")
    array = array.transpose(dataset[rows].dims[0], dataset[columns].dims[0])
    return dataset[rows].values, dataset[columns].values, array


def _old_gmt(dataset: xarray.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Decode GMT's grid format before version 4: one row of numbers from the north-west corner."""
    columns, rows = (int(n) for n in dataset["dimension"].values)
    west, east = dataset["x_range"].values.astype(float)
    south, north = dataset["y_range"].values.astype(float)
    if int(dataset["z"].attrs.get("node_offset", dataset.attrs.get("node_offset", 0))) == 1:
        # The ranges are the outer edges of the pixels, the values belong to their centres.
        half_x, half_y = (east - west) / columns / 2, (north - south) / rows / 2
        west, east, south, north = west + half_x, east - half_x, south + half_y, north - half_y
    field = dataset["z"].values.reshape(rows, columns)
    return np.linspace(north, south, rows), np.linspace(west, east, columns), field


def _check_registration(dataset: xarray.Dataset, lat: np.ndarray, lon: np.ndarray) -> None:
    """Refuse a pixel-registered file whose axes hold outer edges instead of cell centres."""
    if int(dataset.attrs.get("node_offset", 0)) != 1:
        return
    for axis in (lat, lon):
        names = [
            one for one in dataset.variables.values() if one.ndim == 1 and np.array_equal(one.values, axis)
        ]
        edges = np.ravel(names[0].attrs.get("actual_range", ())) if names else np.empty(0)
        ends = np.sort([float(axis[0]), float(axis[-1])])
        half = (ends[1] - ends[0]) / max(axis.size - 1, 1) / 2
        if edges.size == 2 and np.abs(np.sort(edges) - ends).max() < 0.1 * half:
            raise InvalidInput(
                "path",
                f"node_offset = 1 (pixels) but axes that end on the edges {ends[0]:g} and {ends[1]:g}",
                "its axes should hold cell centres; rewrite it with `gmt grdconvert`, or delete node_offset",
            )


def _unpack(field: np.ndarray, attributes: Any) -> np.ndarray:
    """Apply fill value, scale and offset in float64, whichever version of xarray is installed."""
    values = field.astype(np.float64)
    for key in ("_FillValue", "missing_value"):
        if key in attributes:
            values[np.isin(field, attributes[key])] = np.nan
    scale, offset = float(attributes.get("scale_factor", 1.0)), float(attributes.get("add_offset", 0.0))
    return values if (scale, offset) == (1.0, 0.0) else values * scale + offset


def _unwrap(lon: np.ndarray) -> np.ndarray:
    """Make longitudes that jump at the date line (179, -179) continuous."""
    lon = np.asarray(lon)
    jumps = np.abs(np.diff(lon.astype(float))) > 180.0
    return np.unwrap(lon.astype(float), period=360.0).astype(lon.dtype) if jumps.any() else lon


def _uniform(name: str, given: np.ndarray) -> np.ndarray:
    """Exactly uniform axis, ascending or descending, close to the one in the file."""
    axis = np.asarray(given)
    if axis.size < 2:
        raise InvalidInput(name, f"{axis.size} grid line", "a map needs at least two in each direction")
    # Axes in float32 cannot be uniform to better than their own rounding.
    single = axis.dtype.kind == "f" and axis.dtype.itemsize < 8
    axis = axis.astype(np.float64)
    spacing = np.diff(axis)
    uniform = np.linspace(axis[0], axis[-1], axis.size)
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    allowed = 1e-4 * abs(step) + (4 * np.spacing(np.float32(np.abs(axis).max())) if single else 0.0)
    if not np.isfinite(axis).all() or step == 0 or not (spacing * np.sign(step) > 0).all():
        raise InvalidInput(name, "an axis that is not monotonic", "sort the map along it first")
    if np.abs(axis - uniform).max() > allowed:
        raise InvalidInput(
            name,
            f"steps from {np.abs(spacing).min():.9g}° to {np.abs(spacing).max():.9g}°",
            "resample the map to uniform spacing (`gmt grdsample`, `xarray.Dataset.interp`)",
        )
    return uniform


def _unit(found: Any, override: str | None) -> tuple[float, str]:
    """Factor to mGal and resulting label."""
    text = found if override is None else override
    plain = "" if text is None else plain_unit(str(text))
    if plain in UNITS:
        return UNITS[plain], "mGal"
    if override is not None:
        return 1.0, override
    raise InvalidInput(
        "units",
        "none in the file" if text is None else repr(text),
        "say what the numbers are: unit='mGal' (or 'm/s2', 'um/s2', ...; another unit such as 'm' is kept)",
    )
