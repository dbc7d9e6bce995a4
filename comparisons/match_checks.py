"""What a track and a map must be like before one is matched to the other, and one clear error for each."""

from __future__ import annotations

import numpy as np

from navopt.data.gravity_units import refuse_magnitude
from navopt.data.recorded import RecordedTrack
from navopt.data.track_parts import gaps
from navopt.errors import InvalidInput
from navopt.models.earth import distance, principal_radii
from navopt.models.field_map import FieldMap
from navopt.problems.gravity_sensing import MeasurementErrors

__all__ = [
    "check_coverage",
    "check_gaps",
    "check_information",
    "check_map",
    "check_sensing",
    "check_track",
    "search_area",
]

#: Nearer to a pole than this nothing is matched: meridians run together, degrees.
LATITUDE_LIMIT_DEG = 85.0
#: Faster than this is no vehicle with a gravimeter but a wrong time or position, m/s.
FASTEST = 150.0
#: A jump shorter than this may be the rounding of positions, m.
JUMP = 1000.0
#: 1 sigma of a measured anomaly that a moving gravimeter may have, mGal.
SIGMAS_MGAL = (0.01, 100.0)
#: Memory that the error shapes of a track may take, bytes.
LARGEST_BASIS = 1e9


def check_map(field_map: FieldMap, *, stated: bool) -> None:
    """Refuse a map that is not one of gravity anomalies in mGal.

    Parameters
    ----------
    field_map : FieldMap
        The map.
    stated : bool, keyword-only
        Whether the user has named the unit, so that the numbers need not look like it.
    """
    if field_map.unit != "mGal":
        raise InvalidInput(
            "map", f"unit {field_map.unit}", "give gravity anomalies; --map-unit mGal if they are"
        )
    if not stated:
        refuse_magnitude(field_map.values, argument="values of the map", option="--map-unit")


def check_sensing(errors: MeasurementErrors) -> None:
    """Refuse a standard deviation of the measurements that no gravimeter can have."""
    low, high = SIGMAS_MGAL
    if not low <= errors.noise <= high:
        raise InvalidInput(
            "--sigma",
            f"{errors.noise:g} mGal",
            f"give the 1 sigma of a measured anomaly in mGal, {low:g} to {high:g}; at sea it is about 1",
        )
    if errors.map_error > high:
        raise InvalidInput(
            "--map-error", f"{errors.map_error:g} mGal", f"give at most {high:g}; usual is 2 to 5"
        )


def check_track(recorded: RecordedTrack, window: int) -> None:
    """Refuse too few points, places near a pole, impossible speeds, and a gravimeter that stands still.

    Parameters
    ----------
    recorded : RecordedTrack
        The part of the track that is to be matched.
    window : int
        Samples matched at least.
    """
    track = recorded.track
    if len(track) < max(window, 3):
        raise InvalidInput(
            "track",
            f"{len(track)} points",
            f"too few: {max(window, 3)} are needed"
            + (f", or fewer with --window (at least 3, now {window})" if window > 3 else ""),
        )
    highest = np.degrees(np.abs(track.latitude).max())
    if highest > LATITUDE_LIMIT_DEG:
        raise InvalidInput(
            "track",
            f"latitude {highest:.2f} degrees",
            f"it comes nearer to a pole than {LATITUDE_LIMIT_DEG:g} degrees, which is not supported",
        )
    if np.ptp(track.measured) == 0.0:
        raise InvalidInput(
            "gravity",
            f"{track.measured[0]:g} mGal at all {len(track)} points",
            "the gravimeter seems to be stuck",
        )
    run = distance(track.latitude[1:], track.longitude[1:], track.latitude[:-1], track.longitude[:-1])
    step = np.diff(track.time)
    wrong = np.flatnonzero((run > FASTEST * step) & (run > JUMP))
    if wrong.size:
        k = int(wrong[0])
        raise InvalidInput(
            "track",
            f"{run[k] / 1e3:.1f} km in {step[k]:g} s from {recorded.moment(track.time[k])}"
            + (f", and {wrong.size - 1} more such jumps" if wrong.size > 1 else ""),
            "no vehicle is so fast: correct the times or positions there, or cut with --from and --until",
        )
    blocks = (track.time[-1] - track.time[0]) / 900.0
    if len(track) * 7 * 8 * (13 + 5 * blocks) > LARGEST_BASIS:
        raise InvalidInput(
            "track",
            f"{len(track)} points over {(track.time[-1] - track.time[0]) / 3600:.0f} h",
            "too many at once: give a part with --from and --until, or fewer with --average",
        )


def check_gaps(recorded: RecordedTrack, longest: float) -> list[str]:
    """Refuse gaps longer than `longest` seconds; return sentences about the shorter ones."""
    found = gaps(recorded)
    time = recorded.track.time
    long = [gap for gap in found if gap.seconds > longest]
    if long:
        gap = max(long, key=lambda one: one.seconds)
        raise InvalidInput(
            "track",
            f"{len(long)} {'gaps' if len(long) > 1 else 'gap'} above {longest / 60:g} min, the longest of "
            f"{gap.seconds / 60:.0f} min after {recorded.moment(time[gap.sample])}",
            "--split takes the part after the last of them, --max-gap (minutes) allows them",
        )
    if not found:
        return []
    gap = max(found, key=lambda one: one.seconds)
    where = recorded.moment(time[gap.sample])
    count = f"{len(found)} gaps" if len(found) > 1 else "1 gap"
    return [f"{count} in the measurements, the longest of {gap.seconds / 60:.1f} min after {where}"]


def check_coverage(field_map: FieldMap, recorded: RecordedTrack) -> None:
    """Refuse a track of which the INS positions do not all lie on the map, naming which."""
    track = recorded.track
    inside = field_map.contains(track.latitude, track.longitude)
    if inside.all():
        return
    outside = np.flatnonzero(~inside)
    west, east, south, north = field_map.bounds_deg
    lat, lon = np.degrees(track.latitude), np.degrees(track.longitude)
    k, last = int(outside[0]), int(outside[-1])
    where = f"({lat[k]:.4f}, {lon[k]:.4f}) at {recorded.moment(track.time[k])}"
    amount = f"all {len(track)} points"
    if inside.any():
        amount = f"{outside.size} of {len(track)} points (numbers {k + 1} to {last + 1})"
    edges = [np.floor(lon.min() - 1), np.ceil(lon.max() + 1), np.floor(lat.min() - 1), np.ceil(lat.max() + 1)]
    edges[2:] = np.clip(edges[2:], -90, 90)
    raise InvalidInput(
        "track",
        f"{amount} outside the map, the first at {where}",
        f"the map covers {south:g} to {north:g} N and {west:g} to {east:g} E; "
        f"`navopt gravity-map --region={'/'.join(f'{edge:g}' for edge in edges)}` would do",
    )


def search_area(
    field_map: FieldMap, latitude: np.ndarray, longitude: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Values of the map within three sigmas of INS positions, and whether the map covers all of that.

    Parameters
    ----------
    field_map : FieldMap
        The map.
    latitude, longitude : ndarray, shape (N,)
        INS positions, rad.
    sigma : ndarray, shape (N, 2)
        1 sigma of their errors to the north and east, m.

    Returns
    -------
    values : ndarray
        Interpolated values at the positions and on nine points across the area of each; NaN beyond the map.
    covered : bool
        Whether none is beyond it.
    """
    meridian, prime_vertical = principal_radii(latitude)
    reach = 3.0 * sigma / np.stack([meridian, prime_vertical * np.cos(latitude)], axis=1)
    steps = np.linspace(-1.0, 1.0, 9)
    north, east = np.meshgrid(steps, steps, indexing="ij")
    lat = latitude[:, None] + reach[:, :1] * north.ravel()
    lon = longitude[:, None] + reach[:, 1:] * east.ravel()
    values = field_map.value(np.clip(lat, -np.pi / 2, np.pi / 2), lon)
    return values, bool(np.isfinite(values).all())


def check_information(values: np.ndarray, errors: MeasurementErrors) -> None:
    """Refuse to match where the map says nothing: it varies by less than one standard deviation.

    Parameters
    ----------
    values : ndarray
        Values of the map where the vehicle may have been, from `search_area`.
    errors : MeasurementErrors
        Declared errors.
    """
    spread = float(np.nanmax(values) - np.nanmin(values))
    if spread == 0.0 or spread < errors.noise:
        what = "a constant field" if spread == 0.0 else f"a field that varies by {spread:.2g} mGal"
        raise InvalidInput(
            "map",
            f"{what} wherever the vehicle may have been",
            f"it holds no information on the position (1 sigma of a measurement is {errors.noise:g} mGal): "
            "no position is given",
        )
