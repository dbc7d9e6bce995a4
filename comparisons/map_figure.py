"""The map picture of a match: the field, where the vehicle was, where it thought it was, where it was put."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from comparisons.drawing import UNAIDED, Style, styled
from comparisons.wording import format_number

__all__ = ["match_map"]

#: Mean radius of the Earth in km: good enough for a scale bar and a distance in a legend.
EARTH_KM = 6371.0
TRUE = Style("#000000", "*", "-")
#: Pale from blue to brown, so that lines of any colour are seen on it.
PALE = LinearSegmentedColormap.from_list(
    "navopt_pale", ["#9fbcd6", "#dfe9f1", "#f7f5f0", "#eadfca", "#cfb38c"]
)
HALO = [withStroke(linewidth=2.8, foreground="white")]
_Track = tuple[np.ndarray, np.ndarray]
_Extent = tuple[float, float, float, float]


@dataclass(frozen=True)
class _Drawn:
    """One track in degrees, with how and where it is drawn."""

    label: str
    latitude: np.ndarray
    longitude: np.ndarray
    style: Style
    order: int


@styled
def match_map(
    picture: Mapping[str, np.ndarray],
    tracks: Mapping[str, _Track],
    *,
    styles: Mapping[str, Style],
    title: str = "",
    unit: str = "mGal",
) -> Figure:
    """Draw the voyage on the map, the matched window closer, and the fix closer still.

    Parameters
    ----------
    picture : mapping of str to ndarray
        ``map_latitude``, ``map_longitude`` (rad), ``map_values``, shape (rows, columns),
        ``ins_latitude``, ``ins_longitude`` and, where known, ``true_latitude``, ``true_longitude``
        (rad, whole voyage), and ``window`` (number of last samples matched).
    tracks : mapping of str to (latitude, longitude)
        Matched window of each solver, rad.
    styles : mapping of str to Style
        How each solver is drawn.
    title : str
        Above the figure.
    unit : str, default "mGal"
        Unit of the field.

    Returns
    -------
    matplotlib.figure.Figure
    """
    count = int(np.asarray(picture.get("window", len(picture["ins_latitude"]))).ravel()[0])
    known = "true_latitude" in picture
    inertial = np.degrees(picture["ins_latitude"]), np.degrees(picture["ins_longitude"])
    truth = (np.degrees(picture["true_latitude"]), np.degrees(picture["true_longitude"])) if known else None
    reference = truth if truth is not None else inertial
    fix = reference[0][-1], reference[1][-1]
    matched = {label: (np.degrees(a), np.degrees(b)) for label, (a, b) in tracks.items()}
    away = {label: _kilometres(a[-1], b[-1], *fix) for label, (a, b) in matched.items()}
    named = {label: f"{label} ({format_number(away[label], digits=2)} km)" for label in matched}
    inertial_name = (
        f"INS alone ({format_number(_kilometres(inertial[0][-1], inertial[1][-1], *fix), digits=2)} km)"
    )
    lines = [_Drawn(inertial_name if known else "INS alone", *inertial, UNAIDED, 3)]
    if truth is not None:
        lines.append(_Drawn("true track", *truth, TRUE, 4))
    # the best is drawn last, on top
    for order, label in enumerate(sorted(matched, key=lambda k: -away[k])):
        lines.append(_Drawn(named[label] if known else label, *matched[label], styles[label], 5 + order))

    columns = min(4, len(lines))
    figure = Figure(figsize=(10.5, 5.0 + 0.2 * -(-len(lines) // columns)), layout="constrained")
    panels = figure.subplots(1, 3)
    norm = _range(picture["map_values"])
    window = [(line.latitude[-count:], line.longitude[-count:]) for line in lines]
    near = _near(window, away=[_kilometres(a[-1], b[-1], *fix) for a, b in window])
    last = _square([(np.array(fix[:1]), np.array(fix[1:])), *[(a[-1:], b[-1:]) for a, b in near]], pad=0.35)
    corners = np.array(last[:2]), np.array(last[2:])
    extents = [
        _clipped(_square([(line.latitude, line.longitude) for line in lines], pad=0.08), picture),
        _square([(reference[0][-count:], reference[1][-count:]), *near, corners], pad=0.1),
        last,
    ]
    names = (f"{title}\nwhole voyage".lstrip(), f"matched window, {count} samples", "last point")
    for k, (axes, extent, name) in enumerate(zip(panels, extents, names, strict=True)):
        mesh, interval = _field(axes, picture, extent, norm, contours=k > 0)
        for line in lines:
            _draw(axes, line, count, closer=k)
        _frame(axes, extent, name + (f"\ncontours every {interval:g} {unit}" if interval else ""))
        _scale_bar(axes, extent, lines)
    handles = _finish(figure, panels, extents, mesh, lines, unit)
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, handlelength=3.4,
        title="in brackets: distance of the last point from the truth" if known else None,
    )  # fmt: skip
    return figure


def _finish(
    figure: Figure, panels: Any, extents: list[_Extent], mesh: Any, lines: list[_Drawn], unit: str
) -> list[Line2D]:
    """Frame in each panel what the next one shows, label axes and colours; return the legend's lines."""
    for axes, (south, north, west, east) in ((panels[0], extents[1]), (panels[1], extents[2])):
        frame = Rectangle((west, south), east - west, north - south, fill=False, edgecolor="#222222")
        frame.set(linewidth=0.9, zorder=30)
        axes.add_patch(frame)
    panels[0].set_ylabel("latitude (°)")
    panels[1].set_xlabel("longitude (°)")
    figure.colorbar(
        mesh, ax=list(panels), location="bottom", shrink=0.5, aspect=40, extend="both",
        label=f"gravity anomaly ({unit})",
    )  # fmt: skip
    return [
        Line2D([], [], color=style.colour, linestyle=style.line, marker=style.marker, label=label)
        for label, style in ((line.label, line.style) for line in lines)
    ]


def _kilometres(latitude: float, longitude: float, latitude0: float, longitude0: float) -> float:
    north = np.radians(latitude - latitude0)
    east = np.radians(longitude - longitude0) * np.cos(np.radians((latitude + latitude0) / 2))
    return float(EARTH_KM * np.hypot(north, east))


def _near(window: list[_Track], *, away: list[float]) -> list[_Track]:
    """Tracks worth a closer look: one far astray must not shrink the others to a point."""
    if not away:
        return []
    limit = max(3 * sorted(away)[(len(away) - 1) // 2], 0.2)
    return [track for track, distance in zip(window, away, strict=True) if distance <= limit]


def _square(tracks: list[_Track], *, pad: float) -> _Extent:
    """South, north, west, east of a box that is square on the ground around the tracks, in degrees."""
    latitude = np.concatenate([np.asarray(t[0], dtype=float) for t in tracks])
    longitude = np.concatenate([np.asarray(t[1], dtype=float) for t in tracks])
    middle = (latitude.min() + latitude.max()) / 2, (longitude.min() + longitude.max()) / 2
    shrink = np.cos(np.radians(middle[0]))
    half = max(np.ptp(latitude), np.ptp(longitude) * shrink, 0.002) * (0.5 + pad)
    return middle[0] - half, middle[0] + half, middle[1] - half / shrink, middle[1] + half / shrink


def _range(values: np.ndarray) -> Normalize:
    finite = values[np.isfinite(values)]
    low, high = np.percentile(finite, [1, 99]) if finite.size else (0.0, 1.0)
    return Normalize(float(low), float(high) if high > low else float(low) + 1.0)


def _clipped(extent: _Extent, picture: Mapping[str, np.ndarray]) -> _Extent:
    """Cut a box to the map, so that no panel is partly empty."""
    latitude, longitude = np.degrees(picture["map_latitude"]), np.degrees(picture["map_longitude"])
    return (
        max(extent[0], float(latitude.min())),
        min(extent[1], float(latitude.max())),
        max(extent[2], float(longitude.min())),
        min(extent[3], float(longitude.max())),
    )


def _field(
    axes: Axes, picture: Mapping[str, np.ndarray], extent: _Extent, norm: Normalize, *, contours: bool
) -> tuple[Any, float]:
    """Draw the field; return the mesh and the interval of the contours, 0 without."""
    latitude, longitude = np.degrees(picture["map_latitude"]), np.degrees(picture["map_longitude"])
    rows = _inside(latitude, extent[0], extent[1])
    columns = _inside(longitude, extent[2], extent[3])
    values = np.asarray(picture["map_values"], dtype=float)[rows, columns]
    # Gouraud shading is linear between the nodes, as the map itself is read
    mesh = axes.pcolormesh(
        longitude[columns], latitude[rows], values, shading="gouraud", cmap=PALE, norm=norm,
        rasterized=True, zorder=0,
    )  # fmt: skip
    spread = float(np.ptp(values)) if np.isfinite(values).all() else 0.0
    if not contours or spread == 0:
        return mesh, 0.0
    interval = _round_number(spread / 5)
    levels = np.arange(np.ceil(values.min() / interval), np.floor(values.max() / interval) + 1) * interval
    axes.contour(
        longitude[columns], latitude[rows], values, levels=levels, colors="#7d8791", linewidths=0.6,
        linestyles="solid", zorder=1,
    )  # fmt: skip
    return mesh, interval


def _round_number(largest: float) -> float:
    """Largest of 1, 2 and 5 times a power of ten that is not above a number."""
    power = 10.0 ** np.floor(np.log10(largest))
    return float(max(step for step in (power, 2 * power, 5 * power) if step <= largest))


def _inside(axis: np.ndarray, low: float, high: float) -> slice:
    """Nodes of an axis that cover an interval, one beyond each end and two at least."""
    start = max(int(np.searchsorted(axis, low)) - 1, 0)
    stop = min(int(np.searchsorted(axis, high)) + 1, len(axis))
    start = min(start, max(len(axis) - 2, 0))
    return slice(start, max(stop, start + 2))


def _draw(axes: Axes, line: _Drawn, count: int, *, closer: int) -> None:
    part = slice(None) if closer == 0 else slice(-count, None)
    latitude, longitude, style = line.latitude[part], line.longitude[part], line.style
    axes.plot(
        longitude, latitude, color=style.colour, linestyle=style.line, linewidth=1.6 if closer else 1.2,
        path_effects=HALO, zorder=line.order, label=line.label,
    )  # fmt: skip
    # both ends of a window, the last point elsewhere: a marker at each sample would hide the tracks
    axes.plot(
        longitude, latitude, color=style.colour, linestyle="none", marker=style.marker,
        markevery=[0, -1] if closer == 1 else [-1], markersize=(4, 6, 8)[closer] + 3 * (style is TRUE),
        markeredgecolor="white", markeredgewidth=0.5, zorder=line.order + 15,
    )  # fmt: skip


def _frame(axes: Axes, extent: _Extent, name: str) -> None:
    south, north, west, east = extent
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    axes.set_aspect(1 / np.cos(np.radians((south + north) / 2)))
    axes.set_title(name, fontsize=9.5, fontweight="normal")
    axes.grid(False)
    axes.spines[["top", "right"]].set_visible(True)
    axes.locator_params(nbins=4)
    axes.ticklabel_format(useOffset=False)


def _scale_bar(axes: Axes, extent: _Extent, lines: list[_Drawn]) -> None:
    """Draw a bar of a round number of kilometres on a white plate, in the corner where fewest tracks are."""
    south, north, west, east = extent
    width = _kilometres(south, west, south, east)
    length = _round_number(0.35 * width)
    share = length / width
    plate = share + 0.06, 0.1
    corners = [(x, y) for y in (0.03, 0.87) for x in (0.03, 0.97 - plate[0])]

    def hidden(corner: tuple[float, float]) -> int:
        count = 0
        for line in lines:
            steps = np.linspace(0, len(line.latitude) - 1, 4000)
            places = np.arange(len(line.latitude))
            x = (np.interp(steps, places, line.longitude) - west) / (east - west) - corner[0]
            y = (np.interp(steps, places, line.latitude) - south) / (north - south) - corner[1]
            count += int(((x > 0) & (x < plate[0]) & (y > 0) & (y < plate[1])).sum())
        return count

    left, bottom = min(corners, key=hidden)
    axes.add_patch(
        Rectangle((left, bottom), *plate, transform=axes.transAxes, facecolor="white", alpha=0.85, zorder=31)
    )
    axes.plot(
        [left + 0.03, left + 0.03 + share], [bottom + 0.02, bottom + 0.02], color="black", linewidth=2.2,
        solid_capstyle="butt", transform=axes.transAxes, zorder=32,
    )  # fmt: skip
    axes.text(
        left + 0.03 + share / 2, bottom + 0.035, f"{length:g} km", transform=axes.transAxes,
        ha="center", va="bottom", fontsize=8, zorder=32,
    )  # fmt: skip
