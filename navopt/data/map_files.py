"""One reader for every kind of map file that this package knows."""

from __future__ import annotations

import os
from pathlib import Path

from navopt.data.icgem import END_OF_HEAD, icgem_header, read_icgem
from navopt.errors import InvalidInput, NavoptError
from navopt.models.field_map import FieldMap

__all__ = ["read_map"]

#: A header of text is looked for in so many bytes.
_LOOK = 65536


def read_map(
    path: str | os.PathLike[str],
    variable: str | None = None,
    *,
    unit: str | None = None,
    method: str = "bilinear",
) -> FieldMap:
    """Read a map from a NetCDF file (CF or GMT) or from an ICGEM grid; the content decides which it is.

    Parameters
    ----------
    path : path-like
        The file.
    variable : str, optional
        Variable of a NetCDF file, where there are several.
    unit : str, optional, keyword-only
        What the numbers are in, where the file is silent or wrong. Gravity is converted to mGal.
    method : {"bilinear", "bicubic"}, keyword-only
        Interpolation of the map.

    Returns
    -------
    FieldMap
        Named after the file.

    Raises
    ------
    InvalidInput
        Whatever cannot be read or settled; the message names the remedy.
    """
    file = Path(path)
    if not file.is_file():
        raise InvalidInput("map", str(path), "give an existing file: NetCDF, or an ICGEM grid (.gdf)")
    try:
        with file.open("rb") as stream:
            start = stream.read(_LOOK)
    except OSError as error:
        raise InvalidInput("map", str(path), f"give a file that can be read ({error})") from None
    if start[:3] == b"CDF" or start[:4] == b"\x89HDF":
        try:
            return FieldMap.from_netcdf(file, variable, unit=unit, method=method)
        except NavoptError:
            raise
        except (OSError, ValueError, KeyError, TypeError) as error:
            # a damaged file fails in as many ways as the libraries below have layers
            raise InvalidInput("map", file.name, f"a NetCDF file that can be read ({error})") from None
    if END_OF_HEAD.encode() in start:
        if variable is not None:
            raise InvalidInput(
                "variable", variable, f"{file.name} is an ICGEM grid, which has one field only"
            )
        latitude, longitude, values, label = read_icgem(file, unit=unit)
        functional = icgem_header(file).get("functional", "").split(" ")[0]
        name = f"{file.name} ({functional})" if functional else file.name
        return FieldMap.from_degrees(latitude, longitude, values, unit=label, name=name, method=method)
    raise InvalidInput(
        "map", file.name, "not a map: give NetCDF (as `navopt gravity-map` writes) or an ICGEM grid (.gdf)"
    )
