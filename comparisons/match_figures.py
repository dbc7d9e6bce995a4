"""Pictures of one match: the tracks on the map with 1-sigma ellipses, and what remains unexplained."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from comparisons.drawing import UNAIDED, WIDTH, Style, styled
from comparisons.map_figure import (
    EARTH_KM,
    HALO,
    TRUE,
    _clipped,
    _draw,
    _Drawn,
    _field,
    _finish,
    _frame,
    _inside,
    _kilometres,
    _range,
    _scale_bar,
    _square,
)
from comparisons.wording import format_number
from navopt.models.earth import principal_radii

if TYPE_CHECKING:
    from comparisons.match import Match

__all__ = ["match_picture", "residual_picture"]

MATCHED = Style("#0072B2", "s", "-")
#: Ellipses drawn along the track, at most: more would hide it.
ELLIPSES = 8
#: Half a side of the closest panel, in sigmas of the last position, or at least so many km.
CLOSE_SIGMAS, CLOSE_KM = 3.2, 0.5


@styled
def match_picture(match: Match) -> Figure:
    """Draw the tracks on the map: the whole voyage, its end, and the last position.

    Parameters
    ----------
    match : Match
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        Ellipses are 1 sigma (39 % of a normal distribution in two dimensions) as the solver states it.
    """
    recorded, track = match.recorded, match.recorded.track
    # every longitude on the map's own turn
    turn = 2 * np.pi * np.round((track.longitude.mean() - match.field_map.longitude.mean()) / (2 * np.pi))

    def degrees(latitude: np.ndarray, longitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.degrees(latitude), np.degrees(longitude - turn)

    inertial = degrees(track.latitude, track.longitude)
    matched = degrees(match.latitude, match.longitude)
    lines = [_Drawn("INS", *inertial, UNAIDED, 3)]
    if track.true_latitude is not None and track.true_longitude is not None:
        truth = degrees(track.true_latitude, track.true_longitude)
        away = [
            format_number(_kilometres(one[0][-1], one[1][-1], truth[0][-1], truth[1][-1]), digits=2)
            for one in (inertial, matched)
        ]
        lines[0] = _Drawn(f"INS ({away[0]} km off at the end)", *inertial, UNAIDED, 3)
        lines.append(_Drawn("reference", *truth, TRUE, 4))
        name = f"matched ({away[1]} km off)"
    else:
        name = "matched"
    lines.append(_Drawn(name, *matched, MATCHED, 6))
    picture = _part(match.field_map, lines)
    count = min(match.problem.window, len(matched[0]))
    end = [(line.latitude[-count:], line.longitude[-count:]) for line in lines]
    ends = _clipped(_square(end, pad=0.12), picture)
    extents = [
        _clipped(_square([(line.latitude, line.longitude) for line in lines], pad=0.08), picture),
        ends,
        _clipped(
            _close(match, lines, matched, most=0.25 * _kilometres(ends[0], ends[2], ends[1], ends[2])),
            picture,
        ),
    ]
    figure = Figure(figsize=(10.5, 5.2), layout="constrained")
    panels = figure.subplots(1, 3)
    norm = _range(picture["map_values"])
    what = f"last {count} samples"
    names = ("whole track", what, "last position")
    for k, (axes, extent, title) in enumerate(zip(panels, extents, names, strict=True)):
        mesh, interval = _field(axes, picture, extent, norm, contours=k > 0)
        for line in lines:
            _draw(axes, line, count, closer=k)
        _ellipses(axes, match, matched, closer=k, count=count)
        _frame(axes, extent, title + (f"\ncontours every {interval:g} mGal" if interval else "\n"))
        _scale_bar(axes, extent, lines)
    handles = _finish(figure, panels, extents, mesh, lines, "mGal")
    if np.isfinite(match.covariance).any():
        handles.append(
            Line2D(
                [], [], color=MATCHED.colour, marker="o", fillstyle="none", linestyle="none", markersize=10,
                label="1σ of the matched position",
            )
        )  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), handlelength=3.4)
    doubt = "" if match.known is not False else ", position not known well enough"
    title = f"{recorded.source or 'track'}, {match.solution.settings.get('solver', '')}{doubt}"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    return figure


def _part(field_map: Any, lines: list[_Drawn]) -> dict[str, np.ndarray]:
    """Part of the map that a square around all tracks needs."""
    south, north, west, east = _square([(line.latitude, line.longitude) for line in lines], pad=0.1)
    rows = _inside(np.degrees(field_map.latitude), south, north)
    columns = _inside(np.degrees(field_map.longitude), west, east)
    return {
        "map_latitude": field_map.latitude[rows],
        "map_longitude": field_map.longitude[columns],
        "map_values": field_map.values[rows, columns],
    }


def _close(
    match: Match, lines: list[_Drawn], matched: tuple[np.ndarray, np.ndarray], *, most: float
) -> tuple[float, float, float, float]:
    """Extent of the closest panel: the last position with its ellipse, and the truth if it is near.

    `most` is half a side, in km, beyond which the panel before shows enough.
    """
    latitude, longitude = matched[0][-1], matched[1][-1]
    sigma = match.sigma[-1]
    half = max(CLOSE_SIGMAS * float(np.max(sigma)) / 1e3 if np.isfinite(sigma).all() else 0.0, CLOSE_KM)
    truth = next((line for line in lines if line.style is TRUE), None)
    if truth is not None:
        half = max(half, 1.4 * _kilometres(latitude, longitude, truth.latitude[-1], truth.longitude[-1]))
    elif not np.isfinite(sigma).all():
        # nothing says how close is close: the last two samples
        half = max(half, 1.2 * _kilometres(latitude, longitude, matched[0][-2], matched[1][-2]))
    half = min(half, max(most, CLOSE_KM))
    north = np.degrees(half / EARTH_KM)
    east = north / np.cos(np.radians(latitude))
    return latitude - north, latitude + north, longitude - east, longitude + east


def _ellipses(
    axes: Axes, match: Match, matched: tuple[np.ndarray, np.ndarray], *, closer: int, count: int
) -> None:
    """Draw 1-sigma ellipses of some matched positions, always of the last."""
    stated = np.flatnonzero(np.isfinite(match.covariance).all(axis=(1, 2)))
    if not stated.size:
        return
    if closer == 1:
        stated = stated[stated >= len(match.latitude) - count]
    chosen = (
        stated[-1:]
        if closer == 2
        else np.unique(stated[np.linspace(0, stated.size - 1, ELLIPSES).astype(int)])
    )
    for k in chosen:
        meridian, prime_vertical = principal_radii(match.latitude[k])
        scale = np.degrees([1.0 / float(meridian), 1.0 / float(prime_vertical * np.cos(match.latitude[k]))])
        # axes are east, north; the covariance is north, east
        values, vectors = np.linalg.eigh(match.covariance[k][::-1, ::-1])
        angle = np.linspace(0.0, 2 * np.pi, 73)
        ring = vectors @ (
            np.sqrt(np.maximum(values, 0.0))[:, None] * np.stack([np.cos(angle), np.sin(angle)])
        )
        axes.plot(
            matched[1][k] + ring[0] * scale[1], matched[0][k] + ring[1] * scale[0], color=MATCHED.colour,
            linewidth=1.5 if closer == 2 else 0.9, path_effects=HALO if closer == 2 else None, zorder=8,
        )  # fmt: skip


@styled
def residual_picture(match: Match) -> Figure:
    """Draw the measured field beside the map's along both tracks, and below it what is left of each.

    Parameters
    ----------
    match : Match
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        The band is the declared 1 sigma of measurement and map about the mean of the matched residuals.
    """
    track = match.recorded.track
    value, method = match.field_map.value, match.problem.method
    part = slice(match.first, None)
    hours = (track.time - track.time[0]) / 3600.0
    matched = match.residuals()[1]
    figure = Figure(figsize=(WIDTH, 5.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    dense = len(track) > 150
    upper.plot(
        hours, track.measured, color="#000000", marker="." if dense else "o", linestyle="none",
        markersize=2.5 if dense else 4, label="measured", zorder=3,
    )  # fmt: skip
    upper.plot(
        hours, value(track.latitude, track.longitude, method), color=UNAIDED.colour, linestyle=(0, (3, 2)),
        linewidth=1.4, label="map along the INS track", zorder=4,
    )  # fmt: skip
    upper.plot(
        hours[part], value(match.latitude, match.longitude, method), color=MATCHED.colour, linewidth=1.8,
        label="map along the matched track", zorder=5,
    )  # fmt: skip
    if match.offset is not None:
        upper.plot(
            hours[part], value(match.latitude, match.longitude, method) + match.offset[part],
            color=MATCHED.colour, linewidth=1.0, linestyle=(0, (1, 1)), label="with its offset", zorder=5,
        )  # fmt: skip
    upper.set_ylabel("gravity anomaly (mGal)")
    centre, sigma = float(np.mean(matched)), match.problem.noise
    lower.axhspan(
        centre - sigma, centre + sigma, color="#dbe7f1", zorder=0, linewidth=0, label=f"±1σ, {sigma:.2g} mGal"
    )
    lower.axhline(0.0, color="#888888", linewidth=0.8, zorder=1)
    along = track.measured - value(track.latitude, track.longitude, method)
    for x, values, style, name in (
        (hours, along, UNAIDED, "INS"),
        (hours[part], matched, MATCHED, "matched"),
    ):
        mean, spread = f"{np.round(np.mean(values), 1) + 0.0:+.1f}".replace("-", "−"), f"{np.std(values):.2g}"
        lower.plot(
            x, values, color=style.colour, marker="" if dense else style.marker, markersize=3.5,
            linestyle="-" if style is MATCHED else (0, (3, 2)), linewidth=1.3,
            label=f"{name} (mean {mean}, SD {spread} mGal)", zorder=4 + (style is MATCHED),
        )  # fmt: skip
    lower.set_ylabel("measured − map (mGal)")
    recorded = match.recorded
    since = "the first sample" if recorded.start is None else recorded.moment(float(track.time[0]))
    lower.set_xlabel(f"hours since {since}")
    for axes in (upper, lower):
        axes.legend(
            loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=4, borderaxespad=0.1, handlelength=2.0,
            columnspacing=1.2, fontsize=9,
        )  # fmt: skip
    return figure
