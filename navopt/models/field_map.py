"""A field known on a regular latitude-longitude grid, such as a gravity map, and how to look it up.

:class:`FieldMap` is what a map-matching problem carries: immutable, picklable, looked up millions of
times. The compiled functions of :mod:`navopt.models.field_map_kernels` are re-exported here for
kernels that want to look the map up inside their own loops.
"""

from __future__ import annotations

import functools
import math
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from navopt.errors import InvalidInput
from navopt.models import field_map_kernels as kernels
from navopt.models.field_map_checks import (
    check_method,
    checked_grid,
    data_checksum,
    flat_points,
    spline_coefficients,
)
from navopt.models.field_map_kernels import (
    bilinear_at,
    bilinear_gradient_at,
    bspline_at,
    bspline_gradient_at,
    fractional_index,
)

__all__ = [
    "FieldMap", "bilinear_at", "bilinear_gradient_at", "bspline_at", "bspline_gradient_at",
    "fractional_index",
]  # fmt: skip


class FieldMap:
    """A scalar field on a uniform latitude-longitude grid.

    The map is immutable: arrays are read-only, copies (also deep ones) are the map itself. A look-up
    outside the map gives NaN and never extrapolates; a point on the last grid line is inside.
    Longitudes are compared modulo one turn, so -170° and 190° are the same point. A point has the same
    bits alone and in any batch.

    Parameters
    ----------
    latitude : array_like, shape (n_rows,)
        Geodetic latitudes of the grid lines, in radians, uniform and ascending.
    longitude : array_like, shape (n_columns,)
        Longitudes of the grid lines, in radians, uniform and ascending (they may pass 180°), at most
        one turn. A map around the whole Earth repeats its first column as the last.
    values : array_like, shape (n_rows, n_columns)
        The field at the grid nodes, finite.
    unit, name : str, keyword-only
        Unit of the values, and a name for reports.
    method : {"bilinear", "bicubic"}, keyword-only
        Interpolation used when a look-up names none. ``"bicubic"`` is the cubic B-spline through the
        nodes with mirrored borders, as ``scipy.ndimage.map_coordinates(order=3, mode="mirror")``; its
        gradient is continuous, which Gauss-Newton wants.

    Raises
    ------
    InvalidInput
        Shapes that do not fit, axes that are not uniform and ascending, cells without a value.

    Examples
    --------
    >>> import numpy as np
    >>> field = FieldMap.from_degrees([20, 21, 22], [150, 151], [[0, 1], [2, 3], [4, 5]])
    >>> round(float(field.value(np.radians(20.5), np.radians(150.5))), 9)
    1.5
    """

    __slots__ = ("__weakref__", "_coefficients", "_degree", "_grid", "_latitude", "_longitude", "_sha256",
                 "method", "name", "unit")  # fmt: skip

    _coefficients: np.ndarray | None
    _degree: int | None
    _grid: tuple[np.ndarray, float, float, float, float]
    _latitude: np.ndarray
    _longitude: np.ndarray
    _sha256: str | None
    unit: str
    name: str
    method: str

    def __init__(
        self,
        latitude: ArrayLike,
        longitude: ArrayLike,
        values: ArrayLike,
        *,
        unit: str = "mGal",
        name: str = "",
        method: str = "bilinear",
    ) -> None:
        rows, columns, grid = checked_grid(latitude, longitude, values)
        dlat = float(rows[-1] - rows[0]) / (rows.size - 1)
        dlon = float(columns[-1] - columns[0]) / (columns.size - 1)
        state = {
            "_latitude": rows,
            "_longitude": columns,
            "_grid": (grid, float(rows[0]), float(columns[0]), dlat, dlon),
            "method": check_method(method),
            **dict.fromkeys(("_coefficients", "_sha256", "_degree")),
        }
        for attribute, value in (state | {"unit": str(unit), "name": str(name)}).items():
            object.__setattr__(self, attribute, value)

    @classmethod
    def from_degrees(
        cls, latitude_deg: ArrayLike, longitude_deg: ArrayLike, values: ArrayLike, **options: Any
    ) -> FieldMap:
        """Make a map from axes in degrees; everything else as for the constructor."""
        return cls(np.deg2rad(latitude_deg), np.deg2rad(longitude_deg), values, **options)

    @classmethod
    def embedded(cls, degree: int = 2190, *, method: str = "bilinear") -> FieldMap:
        """Load free-air gravity anomalies that come with the package, in mGal.

        EGM2008 over 147.6-156.6°E, 19.5-24°N at 1' (271 × 541 nodes), the window of paper 003; see
        ``navopt/data/PROVENANCE.md``. The checksum is verified once in a process and the map is shared,
        so it also travels between processes as a name rather than as a megabyte.

        Parameters
        ----------
        degree : {2190, 720}
            Maximum degree of the expansion; 720 resembles the satellite-only smoothness of the paper's
            map, 2190 is all that EGM2008 knows.
        method : {"bilinear", "bicubic"}, keyword-only
            Default interpolation of the map.

        Raises
        ------
        InvalidInput
            Another degree, or a data file that does not match its checksum.
        """
        return _embedded(degree, check_method(method))

    @classmethod
    def from_netcdf(
        cls,
        path: str | os.PathLike[str],
        variable: str | None = None,
        *,
        unit: str | None = None,
        name: str | None = None,
        method: str = "bilinear",
    ) -> FieldMap:
        """Read a CF or GMT grid, NetCDF-4 or classic NetCDF.

        Descending latitudes are flipped, longitudes may run 0-360 or cross the date line, a map around
        the whole Earth is closed, packed integers are unpacked, and gravity in m/s², µm/s², Gal and
        their kin is converted to mGal. See :func:`navopt.data.grid_files.read_grid`.

        Parameters
        ----------
        path : path-like
            The file.
        variable : str, optional
            The variable to read; needed only when the file has several candidates.
        unit : str, optional, keyword-only
            What the file's numbers are in, where the file is silent or wrong. A gravity unit is
            converted to mGal; any other (``"m"`` for a terrain map) is kept as it is.
        name, method : str, keyword-only
            As for the constructor; the name is the file's unless given.

        Raises
        ------
        InvalidInput
            A missing file, unknown units, cells without a value, uneven spacing; with the remedy.
        """
        from navopt.data.grid_files import read_grid

        lat, lon, values, label = read_grid(path, variable, unit=unit)
        shown = os.path.basename(os.fspath(path)) if name is None else name
        return cls.from_degrees(lat, lon, values, unit=label, name=shown, method=method)

    @classmethod
    def from_xarray(
        cls, dataset: Any, variable: str | None = None, *, unit: str | None = None, **options: Any
    ) -> FieldMap:
        """Make a map from an open :class:`xarray.Dataset`, by the rules of :meth:`from_netcdf`.

        The result of :func:`navopt.data.egm2008.free_air_anomaly` is such a dataset. The options are
        ``name`` and ``method``, as for the constructor.
        """
        from navopt.data.grid_files import grid_of

        lat, lon, values, label = grid_of(dataset, variable, unit=unit)
        return cls.from_degrees(lat, lon, values, unit=label, **options)

    def value(self, latitude: ArrayLike, longitude: ArrayLike, method: str | None = None) -> Any:
        """Look the field up at points.

        Parameters
        ----------
        latitude, longitude : array_like
            Points in radians, of any shapes that broadcast together.
        method : {"bilinear", "bicubic"}, optional
            Interpolation; the map's own by default.

        Returns
        -------
        ndarray or float64
            In the map's unit, of the broadcast shape; NaN outside the map and for NaN points.
        """
        lat, lon, shape = flat_points(latitude, longitude)
        out = np.empty(lat.size)
        if check_method(method or self.method) == "bilinear":
            kernels.bilinear_many(*self._grid, lat, lon, out)
        else:
            kernels.bspline_many(*self.spline_grid, lat, lon, out)
        return out.reshape(shape)[()]

    def gradient(
        self, latitude: ArrayLike, longitude: ArrayLike, method: str | None = None
    ) -> tuple[Any, Any]:
        """Differentiate the field per radian of latitude and per radian of longitude.

        Divide the first by the meridian radius of curvature plus height, and the second by the
        prime-vertical radius plus height times the cosine of the latitude, for derivatives per metre
        north and east; the map does not do so because it holds no ellipsoid.

        Parameters
        ----------
        latitude, longitude : array_like
            Points in radians, of any shapes that broadcast together.
        method : {"bilinear", "bicubic"}, optional
            Interpolation that is differentiated; the map's own by default. The bilinear one jumps from
            cell to cell (the northern and eastern cell counts on a shared line).

        Returns
        -------
        per_latitude, per_longitude : ndarray or float64
            In the map's unit per radian; NaN outside the map and for NaN points.
        """
        lat, lon, shape = flat_points(latitude, longitude)
        north, east = np.empty(lat.size), np.empty(lat.size)
        if check_method(method or self.method) == "bilinear":
            kernels.bilinear_gradient_many(*self._grid, lat, lon, north, east)
        else:
            kernels.bspline_gradient_many(*self.spline_grid, lat, lon, north, east)
        return north.reshape(shape)[()], east.reshape(shape)[()]

    def contains(self, latitude: ArrayLike, longitude: ArrayLike) -> Any:
        """Tell for each point (radians, broadcast) whether it lies on the map; False for NaN."""
        lat, lon, shape = flat_points(latitude, longitude)
        out = np.empty(lat.size, dtype=np.bool_)
        kernels.inside_many(*self.shape, *self._grid[1:], lat, lon, out)
        return out.reshape(shape)[()]

    def covers(self, latitude: ArrayLike, longitude: ArrayLike) -> bool:
        """Tell whether all points (radians, broadcast) lie on the map."""
        return bool(np.all(self.contains(latitude, longitude)))

    @property
    def latitude(self) -> np.ndarray:
        """Latitudes of the rows in radians, read-only."""
        return self._latitude

    @property
    def longitude(self) -> np.ndarray:
        """Longitudes of the columns in radians, read-only."""
        return self._longitude

    @property
    def values(self) -> np.ndarray:
        """The field at the nodes, read-only."""
        return self._grid[0]

    @property
    def grid(self) -> tuple[np.ndarray, float, float, float, float]:
        """``(values, lat0, lon0, dlat, dlon)``: the nodes, first lines and steps (radians), for kernels."""
        return self._grid

    @property
    def spline_grid(self) -> tuple[np.ndarray, float, float, float, float]:
        """As :attr:`grid`, with the B-spline coefficients that :func:`bspline_at` takes.

        The coefficients have one mirrored line more on each side; `lat0` and `lon0` still belong to
        the first grid line. They are computed on first use.
        """
        coefficients = self._coefficients
        if coefficients is None:
            coefficients = spline_coefficients(self.values)
            object.__setattr__(self, "_coefficients", coefficients)
        return (coefficients, *self._grid[1:])

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows (latitude) and columns (longitude)."""
        return self._latitude.size, self._longitude.size

    @property
    def bounds_deg(self) -> tuple[float, float, float, float]:
        """West, east, south and north grid lines in degrees."""
        ends = (self._longitude[0], self._longitude[-1], self._latitude[0], self._latitude[-1])
        return tuple(round(math.degrees(end), 10) + 0.0 for end in ends)  # type: ignore[return-value]

    @property
    def step_deg(self) -> tuple[float, float]:
        """Steps in latitude and longitude, in degrees."""
        return round(math.degrees(self._grid[3]), 12), round(math.degrees(self._grid[4]), 12)

    @property
    def sha256(self) -> str:
        """Checksum of the map's data (axes, values, unit), the same on every platform."""
        if self._sha256 is None:
            found = data_checksum((*self.bounds_deg, *self.step_deg), self.values, self.unit)
            object.__setattr__(self, "_sha256", found)
        return str(self._sha256)

    def statistics(self) -> dict[str, float]:
        """Minimum, maximum, mean and standard deviation of the nodes, unweighted, in the map's unit."""
        v = self.values
        return {"min": float(v.min()), "max": float(v.max()), "mean": float(v.mean()), "std": float(v.std())}

    def crop(self, region_deg: tuple[float, float, float, float]) -> FieldMap:
        """Cut out the smallest part of the grid that covers a region.

        Parameters
        ----------
        region_deg : tuple of float
            West, east, south and north, in degrees; all four corners must lie on the map.

        Returns
        -------
        FieldMap
            With the same nodes; bicubic values near the new borders differ a little (mirrored there).

        Raises
        ------
        InvalidInput
            A region that leaves the map or is empty.
        """
        west, east, south, north = np.radians(np.asarray(region_deg, dtype=float))
        _, lat0, lon0, dlat, dlon = self._grid
        r0, c0 = fractional_index(south, west, lat0, lon0, dlat, dlon, *self.shape)
        r1, c1 = fractional_index(north, east, lat0, lon0, dlat, dlon, *self.shape)
        if not (r1 > r0 and c1 > c0):
            raise InvalidInput(
                "region_deg",
                tuple(region_deg),
                f"give (west, east, south, north) inside the map's {self.bounds_deg}",
            )
        rows = slice(max(math.floor(r0 + 1e-6), 0), math.ceil(r1 - 1e-6) + 1)
        columns = slice(max(math.floor(c0 + 1e-6), 0), math.ceil(c1 - 1e-6) + 1)
        return FieldMap(
            self.latitude[rows], self.longitude[columns], self.values[rows, columns], **self._options
        )

    def to_netcdf(self, path: str | os.PathLike[str]) -> None:
        """Write the map as CF NetCDF-4: ``z``, ``lat`` and ``lon`` (degrees), lossless, replacing a file."""
        from navopt.data.grid_files import write_grid

        lat, lon = np.rad2deg(self.latitude), np.rad2deg(self.longitude)
        write_grid(path, lat, lon, self.values, unit=self.unit, name=self.name)

    def __setattr__(self, attribute: str, value: object) -> None:
        raise AttributeError(f"a FieldMap is immutable; make another one to change {attribute!r}")

    def __delattr__(self, attribute: str) -> None:
        self.__setattr__(attribute, None)

    def __copy__(self) -> FieldMap:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> FieldMap:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        if self._degree is not None:
            return _embedded, (self._degree, self.method)
        return _rebuild, ((self._latitude, self._longitude, self.values), self._options)

    @property
    def _options(self) -> dict[str, str]:
        return {"unit": self.unit, "name": self.name, "method": self.method}

    def __repr__(self) -> str:
        west, east, south, north = self.bounds_deg
        label = f"{self.name!r}, " if self.name else ""
        return (
            f"FieldMap({label}{self.shape[0]} x {self.shape[1]} nodes, {west:g} to {east:g} °E, "
            f"{south:g} to {north:g} °N, unit={self.unit!r}, method={self.method!r})"
        )


def _rebuild(axes_and_values: tuple[Any, Any, Any], options: dict[str, str]) -> FieldMap:
    return FieldMap(*axes_and_values, **options)


@functools.cache
def _embedded(degree: int, method: str) -> FieldMap:
    from navopt.data.grid_files import embedded_path, read_grid

    lat, lon, values, unit = read_grid(embedded_path(degree))
    made = FieldMap.from_degrees(lat, lon, values, unit=unit, name=f"EGM2008 d{degree}", method=method)
    object.__setattr__(made, "_degree", degree)
    return made
