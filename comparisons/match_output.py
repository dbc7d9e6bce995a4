"""Files of a match: CSV, GeoJSON, pictures and a summary, all or none of them."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.result_folder import checksums_of, write_files
from comparisons.run_key import versions

if TYPE_CHECKING:
    from comparisons.match import Match

__all__ = ["COLUMNS", "FILES", "match_csv", "match_geojson", "match_summary", "summary_lines", "write_match"]

#: What is written, and what each file is.
FILES = {
    "matched.csv": "matched track, one row per sample",
    "matched.geojson": "INS, matched and true track as lines, matched positions as points",
    "map.png": "map with the tracks",
    "residuals.png": "measured minus mapped gravity along the INS and the matched track",
    "match.json": "settings, result, versions and checksums",
}
#: Columns of ``matched.csv``.
COLUMNS = (
    "time", "latitude", "longitude", "sigma_north_m", "sigma_east_m", "ins_latitude", "ins_longitude",
    "gravity", "map_at_ins", "map_at_matched",
)  # fmt: skip
#: Version of the layout of ``match.json``.
FORMAT = 1
#: Decimals of a degree: 1 cm.
_DECIMALS = 7


def write_match(match: Match, folder: str | Path, *, inputs: Mapping[str, Path] | None = None) -> list[Path]:
    """Write all files of a match; if one cannot be made, none is left behind.

    Parameters
    ----------
    match : Match
        The result.
    folder : path-like
        Where to; made if need be. Files of an earlier match in it are replaced, others are not touched.
    inputs : mapping of str to pathlib.Path, optional
        The files that were read (``map``, ``track``, ``ins``), for their checksums.

    Returns
    -------
    list of pathlib.Path
        The files, in the order of `FILES`.

    Raises
    ------
    InvalidInput
        If the folder cannot be made or written.
    """
    from comparisons.drawing import render
    from comparisons.match_figures import match_picture, residual_picture

    contents: dict[str, bytes] = {
        "matched.csv": match_csv(match).encode(),
        "matched.geojson": _json(match_geojson(match)),
        "map.png": render(match_picture(match), format="png"),
        "residuals.png": render(residual_picture(match), format="png"),
        "match.json": _json(match_summary(match, inputs=inputs)),
    }
    return write_files(folder, {name: contents[name] for name in FILES})


def match_csv(match: Match) -> str:
    """Return the matched samples as CSV with the columns `COLUMNS`, and ``error_m`` where the truth is known.

    Degrees and mGal; a cell is empty where nothing is stated. The time is written as the track's file does
    it: dates and times in UTC, or seconds.
    """
    recorded, track = match.recorded, match.recorded.track
    part = slice(match.first, None)
    inertial, matched = match.residuals()
    measured = track.measured[part]
    truth = _errors(match)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS if truth is None else (*COLUMNS, "error_m"))
    ins = np.degrees(track.latitude[part]), _turned(track.longitude[part])
    found = np.degrees(match.latitude), _turned(match.longitude)
    for k, second in enumerate(track.time[part]):
        row = [
            recorded.moment(second) if recorded.start is not None else f"{second:.10g}",
            *(_cell(values[k], _DECIMALS) for values in found),
            *(_cell(value, 1) for value in match.sigma[k]),
            *(_cell(values[k], _DECIMALS) for values in ins),
            _cell(measured[k], 3),
            _cell(measured[k] - inertial[k], 3),
            _cell(measured[k] - matched[k], 3),
        ]
        table.writerow(row if truth is None else [*row, _cell(truth[k], 1)])
    return text.getvalue()


def match_geojson(match: Match) -> dict[str, Any]:
    """Return the tracks as a GeoJSON FeatureCollection (RFC 7946).

    A line for the INS, the matched and, where known, the true track, cut at the antimeridian as section 3.1.9
    asks; a point for each matched sample with its time and 1 sigma. Positions are longitude, latitude on
    WGS 84, longitudes from -180 to 180.
    """
    recorded, track = match.recorded, match.recorded.track
    lines = [("ins", "INS", track.latitude, track.longitude)]
    lines.append(("matched", "matched", match.latitude, match.longitude))
    if track.true_latitude is not None and track.true_longitude is not None:
        lines.append(("truth", "reference", track.true_latitude, track.true_longitude))
    features: list[dict[str, Any]] = [
        {
            "type": "Feature",
            "geometry": _line(np.degrees(latitude), np.degrees(longitude)),
            "properties": {"track": kind, "name": name, "samples": len(latitude)},
        }
        for kind, name, latitude, longitude in lines
    ]
    places = zip(np.degrees(match.latitude), _turned(match.longitude), strict=True)
    for k, (latitude, longitude) in enumerate(places):
        second = float(track.time[match.first + k])
        north, east = (_number(value, 1) for value in match.sigma[k])
        features.append(
            {
                "type": "Feature",
                "geometry": {"type": "Point", "coordinates": [round(longitude, 7), round(latitude, 7)]},
                "properties": {
                    "track": "matched",
                    "time": recorded.moment(second) if recorded.start is not None else second,
                    "sigma_north_m": north,
                    "sigma_east_m": east,
                },
            }
        )
    return {"type": "FeatureCollection", "features": features}


def match_summary(match: Match, *, inputs: Mapping[str, Path] | None = None) -> dict[str, Any]:
    """Return settings, result, versions and checksums of a match, ready for JSON.

    Parameters
    ----------
    match : Match
        The result.
    inputs : mapping of str to pathlib.Path, optional
        The files that were read.

    Returns
    -------
    dict
    """
    recorded, track, solution = match.recorded, match.recorded.track, match.solution
    north, east = match.correction
    inertial, matched = match.residuals()
    west, east_edge, south, north_edge = match.field_map.bounds_deg
    settings = dict(solution.settings)
    summary = {
        "format": FORMAT,
        "result": {
            "time": recorded.moment(float(track.time[-1])),
            "latitude_deg": round(float(np.degrees(match.latitude[-1])), _DECIMALS),
            "longitude_deg": round(float(_turned(match.longitude[-1:])[0]), _DECIMALS),
            "covariance_north_east_m2": [[_number(v, 3) for v in row] for row in match.covariance[-1]],
            "correction_north_m": round(north, 1),
            "correction_east_m": round(east, 1),
            "offset_mgal": None if match.offset is None else round(float(match.offset[-1]), 3),
            "known": match.known,
            "remark": match.remark,
            "status": solution.status,
            "message": solution.message,
            "loss": float(solution.loss),
            "cost": int(solution.counts.cost),
            "elapsed_s": round(float(solution.elapsed_s), 3),
        },
        "residuals_mgal": {"ins": _moments(inertial), "matched": _moments(matched)},
        "scores": {key: round(value, 3) for key, value in match.scores().items()},
        "solver": {
            key: settings.get(key) for key in ("solver", "options", "seed", "budget") if key in settings
        },
        "declared": {
            "ins": dataclasses.asdict(match.ins_errors),
            "measurement": dataclasses.asdict(match.measurement_errors),
            "ins_position_sigma_m": [round(float(value), 1) for value in match.prior_sigma],
            "window": match.problem.window,
        },
        "track": {
            "name": recorded.source,
            "samples": len(track),
            "matched_samples": len(match.latitude),
            "first": recorded.moment(float(track.time[0])),
            "last": recorded.moment(float(track.time[-1])),
        },
        "map": {
            "name": match.field_map.name,
            "sha256_of_data": match.field_map.sha256,
            "west_east_south_north_deg": [west, east_edge, south, north_edge],
            "nodes": list(match.field_map.shape),
        },
        "files": checksums_of(inputs),
        "notes": list(match.notes),
        "versions": versions(),
    }
    return summary


def summary_lines(match: Match) -> list[str]:
    """Return the result in a few lines of text."""
    recorded, track = match.recorded, match.recorded.track
    north, east = match.correction
    inertial, matched = match.residuals()
    size, towards = math.hypot(north, east), math.degrees(math.atan2(east, north)) % 360.0
    sigma = match.sigma[-1]
    latitude, longitude = math.degrees(match.latitude[-1]), float(_turned(match.longitude[-1:])[0])
    lines = [
        f"position at {recorded.moment(float(track.time[-1]))}: {_degrees(latitude, 'N', 'S')}, "
        f"{_degrees(longitude, 'E', 'W')}",
        f"position correction: {size:.0f} m towards {towards:.0f} degrees "
        f"({north:+.0f} m north, {east:+.0f} m east)",
    ]
    if np.isfinite(sigma).all():
        lines.append(f"1 sigma: {sigma[0]:.0f} m north, {sigma[1]:.0f} m east")
    else:
        lines.append("1 sigma: the solver states none")
    before, after = _moments(inertial), _moments(matched)
    lines.append(
        f"measured minus map: rms {before['rms']:.2f} mGal along the INS track, {after['rms']:.2f} along the "
        f"matched one (mean {after['mean']:+.2f}, SD {after['sd']:.2f})"
    )
    if match.offset is not None:
        lines.append(f"offset of the measurements found: {match.offset[-1]:+.2f} mGal at the end")
    if match.known is not None:
        verdict = "vouches for the position" if match.known else "does not know the position well enough"
        lines.append(f"the solver {verdict}" + (f": {match.remark}" if match.remark else ""))
    scores = match.scores()
    if scores:
        lines.append(
            f"error against the reference (scoring only): {scores['position_error_m']:.0f} m, "
            f"INS {scores['ins_position_error_m']:.0f} m"
        )
    lines += [f"note: {note}" for note in match.notes]
    return lines


def _errors(match: Match) -> np.ndarray | None:
    """Distance of each matched sample from the truth, m."""
    from navopt.models.earth import distance

    track = match.recorded.track
    if track.true_latitude is None or track.true_longitude is None:
        return None
    part = slice(match.first, None)
    return np.asarray(
        distance(match.latitude, match.longitude, track.true_latitude[part], track.true_longitude[part])
    )


def _line(latitude: np.ndarray, longitude: np.ndarray) -> dict[str, Any]:
    """Geometry of a line, cut where it crosses the antimeridian; longitudes have no jump."""
    turn = np.floor((longitude + 180.0) / 360.0)
    pieces: list[list[list[float]]] = [[]]
    for k in range(len(latitude)):
        if k and turn[k] != turn[k - 1]:
            edge = 360.0 * max(turn[k], turn[k - 1]) - 180.0
            share = (edge - longitude[k - 1]) / (longitude[k] - longitude[k - 1])
            crossing = round(float(latitude[k - 1] + share * (latitude[k] - latitude[k - 1])), _DECIMALS)
            side = 180.0 if turn[k] > turn[k - 1] else -180.0
            pieces[-1].append([side, crossing])
            pieces.append([[-side, crossing]])
        place = [
            round(float(longitude[k] - 360.0 * turn[k]), _DECIMALS),
            round(float(latitude[k]), _DECIMALS),
        ]
        # a sample on the antimeridian itself is the crossing that was just written
        if not (k and turn[k] != turn[k - 1] and pieces[-1] == [place]):
            pieces[-1].append(place)
    # a piece that only touches the antimeridian is no line
    pieces = [piece for piece in pieces if len(piece) > 1]
    if len(pieces) == 1:
        return {"type": "LineString", "coordinates": pieces[0]}
    return {"type": "MultiLineString", "coordinates": pieces}


def _turned(longitude: np.ndarray) -> np.ndarray:
    """Longitudes in degrees from -180 up to 180."""
    degrees = np.degrees(longitude)
    return np.asarray(degrees - 360.0 * np.floor((degrees + 180.0) / 360.0))


def _moments(values: np.ndarray) -> dict[str, float]:
    return {
        "mean": round(float(np.mean(values)), 4),
        "sd": round(float(np.std(values)), 4),
        "rms": round(float(np.sqrt(np.mean(values**2))), 4),
    }


def _number(value: float, digits: int) -> float | None:
    """Value for JSON, which knows no NaN."""
    return round(float(value), digits) if np.isfinite(value) else None


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else ""


def _degrees(value: float, positive: str, negative: str) -> str:
    return f"{abs(value):.5f} {positive if value >= 0 else negative}"


def _json(document: dict[str, Any]) -> bytes:
    return (json.dumps(document, indent=1, allow_nan=False, default=_plain) + "\n").encode()


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    return repr(value)
