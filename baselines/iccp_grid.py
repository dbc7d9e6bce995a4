"""The piece of a map that a matching problem can reach, on its tangent plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["PlaneGrid", "plane_grid"]


@dataclass(frozen=True)
class PlaneGrid:
    """A map on a plane, whose nodes are at ``north = north0 + dn * row``, ``east = east0 + de * column``.

    Attributes
    ----------
    values : ndarray, shape (n_rows, n_columns)
        The field at the nodes.
    north, east : float
        The first node, m.
    north_step, east_step : float
        Steps, m.
    """

    values: np.ndarray
    north: float
    east: float
    north_step: float
    east_step: float

    @property
    def axes(self) -> tuple[float, float, float, float]:
        """``(north, east, north_step, east_step)``, for kernels."""
        return self.north, self.east, self.north_step, self.east_step


def plane_grid(problem: Any, limits: np.ndarray) -> PlaneGrid:
    """Cut the map of a matching problem to a rectangle of its tangent plane.

    Latitude and longitude are linear in the coordinates of that plane, so the cells of the map are
    rectangles on it and nothing is interpolated. A map around the Earth has no seam here.

    Parameters
    ----------
    problem : GravityMatching
        Has ``field_map``, ``origin`` and ``metres_per_radian``.
    limits : array_like, shape (4,)
        South, north, west and east limit, m; what lies outside the map is left out.

    Returns
    -------
    PlaneGrid
        At least two rows and two columns.
    """
    values, lat0, lon0, dlat, dlon = problem.field_map.grid
    n_rows, n_columns = values.shape
    (latitude, longitude), (meridian, parallel) = problem.origin, problem.metres_per_radian
    # the turn of longitude on which the track lies nearest to the middle of the map
    middle = lon0 + 0.5 * dlon * (n_columns - 1)
    longitude = longitude - 2.0 * np.pi * np.round((longitude - middle) / (2.0 * np.pi))
    steps = dlat * meridian, dlon * parallel
    north0, east0 = (lat0 - latitude) * meridian, (lon0 - longitude) * parallel
    south, north = (int(np.floor((limit - north0) / steps[0])) for limit in limits[:2])
    west, east = (int(np.floor((limit - east0) / steps[1])) for limit in limits[2:])
    rows = _inside(south, north + 1, n_rows)
    if abs(dlon * (n_columns - 1) - 2.0 * np.pi) < 0.5 * dlon:
        # the last column repeats the first
        columns = np.arange(west, min(east + 2, west + n_columns))
        return PlaneGrid(
            np.ascontiguousarray(values[rows][:, columns % (n_columns - 1)]),
            north0 + steps[0] * rows.start,
            east0 + steps[1] * west,
            *steps,
        )
    cut = _inside(west, east + 1, n_columns)
    return PlaneGrid(
        np.ascontiguousarray(values[rows, cut]),
        north0 + steps[0] * rows.start,
        east0 + steps[1] * cut.start,
        *steps,
    )


def _inside(first: int, last: int, count: int) -> slice:
    """Lines first to last as far as they exist, two at least."""
    low = min(max(first, 0), count - 2)
    return slice(low, max(min(last, count - 1), low + 1) + 1)
