"""Gravity matching on recorded cruises: real positions, real readings, a real map, and a simulated INS."""

from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from navopt.data.ship_tracks import ShipTrack, read_ship_csv
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, MissingData, UnknownName, UnsuitableProblem
from navopt.models.cruise import InsErrors
from navopt.models.field_map import FieldMap
from navopt.models.paths import Path as ShipPath
from navopt.models.paths import simulate_ins_along
from navopt.problem import EstimationProblem, stream
from navopt.problems.gravity_errors import eotvos_error
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.registry import problem

__all__ = ["DATA_VARIABLE", "DECLARED", "MAPS_VARIABLE", "ShipGravity"]

#: Environment variable with the folder of recorded files.
DATA_VARIABLE = "NAVOPT_DATA"
#: Environment variable with a folder in which computed maps are kept; optional.
MAPS_VARIABLE = "NAVOPT_MAPS"
#: Declared errors of five-minute means against EGM2008: R = 3² exp(−Δs/4 km) + 1² mGal², bias 30 mGal.
DECLARED = MeasurementErrors(noise=1.0, map_error=3.0, map_error_length=4e3, bias=30.0)
#: The map reaches as far beyond the cruise of a day as an INS may drift, degrees of latitude.
MARGIN_DEG = 2.0
#: The map is for a cruise of this many hours or more, so that one map serves a segment matched at any hour.
SEGMENT_HOURS = 24.0


@problem(
    "ship-gravity",
    summary="match an inertial track simulated along a recorded cruise, with the gravimeter's real readings",
    example={"hours": 6.0},
)
class ShipGravity(GravityMatching):
    """`GravityMatching` on a stretch of a recorded cruise.

    The ship's recorded position is the truth, the free-air anomalies of its gravimeter are the measurements,
    and EGM2008 is the map. Only the INS is simulated, along that very track. The constructor is that of
    `GravityMatching`; `simulate` reads the files.

    Notes
    -----
    Between two samples the heading of the INS turns evenly, also across a gap in the record.
    Nothing is known about the datum of the readings, their drift, and the error of the map but what is
    declared: the truth takes no part in it. The recorded files are not part of navopt.
    """

    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        file: str = "index17.csv",
        row: int = 9,
        hours: float = 24.0,
        degree: int = 2190,
        map_file: str | None = None,
        interval_s: float = 300.0,
        ins: str = "drawn",
        eotvos: bool = False,
        declared: dict[str, Any] | None = None,
        window: int = 12,
        criterion: str = "mad",
        huber: float = 1.345,
        offset: str | None = None,
        box: str = "covariance",
        method: str = "bilinear",
    ) -> ShipGravity:
        """Draw one INS for a stretch of a cruise.

        Parameters
        ----------
        seed : int
            Seed of the errors of the INS; each stretch has its own.
        file : str
            Cruise, see `navopt.data.ship_tracks.read_ship_csv`: a path, or a name in the folder that the
            environment variable ``NAVOPT_DATA`` names.
        row : int
            Row of the file at which the vehicle departs.
        hours : float
            Time since departure at which the track is matched.
        degree : int
            Degree to which EGM2008 is expanded, 2 to 2190.
        map_file : str, optional
            NetCDF map instead of a computed one, a path or a name as for `file`. Without it the extra
            ``gravity`` is needed; maps are kept in the folder that ``NAVOPT_MAPS`` names, if it is set.
        interval_s : float
            The readings are averaged over intervals of this length; those with fewer than three are left out.
        ins : {"drawn", "published"}
            INS errors drawn from N(0, Table 1 of paper 003), or every source at plus one sigma.
        eotvos : bool
            Spoil the readings, which were reduced with the ship's velocity, as the velocity of the INS would.
        declared : dict, optional
            Fields of `MeasurementErrors` to be declared instead of those of `DECLARED`.
        window, criterion, huber, offset, box, method
            As for `GravityMatching`; ``box="paper"`` is not available.

        Returns
        -------
        ShipGravity

        Raises
        ------
        MissingData
            If the cruise or the map is not there; says where it was looked for.
        MissingExtra
            If a map must be computed and the extra ``gravity`` is not installed.
        InvalidInput
            If a value cannot be used, or the record has a gap.
        """
        if ins not in ("drawn", "published"):
            raise UnknownName("ins", ins, ("drawn", "published"))
        if not (np.isfinite(hours) and hours > 0.0):
            raise InvalidInput("hours", hours, "give a positive number of hours")
        if not isinstance(eotvos, bool | np.bool_):
            raise InvalidInput("eotvos", eotvos, "give True or False")
        for name in declared or ():
            if name not in MeasurementErrors.__dataclass_fields__:
                raise UnknownName("declared", name, MeasurementErrors.__dataclass_fields__)
        cruise = read_ship_csv(_found(file, "file"))
        stretch = cruise.segment(row, hours)
        samples = stretch.means(interval_s)
        sigmas = InsErrors.published()
        label = f"world:ship-gravity:{Path(file).name}"
        rng = stream(label, seed if ins == "drawn" else 0, row)
        errors = sigmas.draw(rng) if ins == "drawn" else sigmas
        path = ShipPath.through(stretch.time, stretch.latitude, stretch.longitude)
        samples = _until(samples, path.duration)
        # Between samples the heading turns evenly, also where the record has a gap: an INS on board knows
        # its heading all the time, which a track of samples cannot hold.
        shown = np.interp(samples.time, path.time, path.heading)
        path = replace(path, heading=np.interp(path.time, samples.time, shown))
        track = simulate_ins_along(path, errors, times=samples.time, rng=rng)
        # the errors belong to the smoothed path, which leaves the ship's own positions as they are
        latitude = samples.latitude + (track.latitude - track.true_latitude)
        longitude = samples.longitude + (track.longitude - track.true_longitude)
        measured = samples.anomaly
        if eotvos:
            measured = measured + eotvos_error(samples.latitude, track.true_velocity, track.velocity_error)
        facts = {name: getattr(DECLARED, name) for name in DECLARED.__dataclass_fields__}
        from navopt.models.track_errors import track_error_basis

        shown = np.asarray(track.heading)
        basis = track_error_basis(samples.time, latitude, longitude, sigmas, heading=shown)
        return cls(
            _map(cruise, row, hours, degree, map_file, method),
            MeasuredTrack(
                time=samples.time,
                latitude=latitude,
                longitude=longitude,
                measured=measured,
                true_latitude=samples.latitude,
                true_longitude=samples.longitude,
                heading=shown % (2.0 * np.pi),
            ),
            position_covariance=basis.covariance()[-2 * window :, -2 * window :],
            measurement_errors=MeasurementErrors(**{**facts, "eotvos": eotvos, **(declared or {})}),
            ins_errors=sigmas,
            window=window,
            criterion=criterion,
            huber=huber,
            offset=offset,
            box=box,
            method=method,
        )

    def redraw(self, seed: int) -> EstimationProblem:
        """Refuse: the readings are recorded, there is no other draw of them."""
        raise UnsuitableProblem("ship-gravity holds recorded readings: there is no other draw of their noise")

    @classmethod
    def data_checksum(
        cls,
        *,
        file: str = "index17.csv",
        degree: int = 2190,
        map_file: str | None = None,
        **scenario: Any,
    ) -> str:
        """Checksums of the cruise and of the map, or the degree of a map that is computed."""
        cruise = hashlib.sha256(_found(file, "file").read_bytes()).hexdigest()
        if map_file is None:
            return f"{cruise}+egm2008-{degree}"
        return f"{cruise}+{hashlib.sha256(_found(map_file, 'map_file').read_bytes()).hexdigest()}"


def _until(samples: ShipTrack, last: float) -> ShipTrack:
    """Samples within a path, which ends at a whole number of its steps."""
    inside = samples.time <= last
    return ShipTrack(
        **{
            name: getattr(samples, name)[inside]
            for name in ("time", "latitude", "longitude", "anomaly", "row")
        }
    )


def _found(name: str, argument: str) -> Path:
    """Existing path of a recorded file."""
    given = Path(name)
    folder = os.environ.get(DATA_VARIABLE) or None
    tried = [given] if given.is_absolute() or folder is None else [given, Path(folder) / given]
    for candidate in tried:
        if candidate.is_file():
            return candidate
    raise MissingData(
        argument,
        " and ".join(str(candidate) for candidate in tried) + " (no such file)",
        f"recorded files do not come with navopt: give a path, or set {DATA_VARIABLE} to their folder",
    )


def _map(
    cruise: ShipTrack, row: int, hours: float, degree: int, map_file: str | None, method: str
) -> FieldMap:
    if map_file is not None:
        found = _found(map_file, "map_file")
        return _read_map(found, found.stat().st_mtime_ns, method)
    begin = cruise.time[np.flatnonzero(cruise.row == row)[0]]
    day = 3600.0 * max(hours, SEGMENT_HOURS)
    inside = (cruise.time >= begin) & (cruise.time <= begin + day)
    latitude, longitude = np.degrees(cruise.latitude[inside]), np.degrees(cruise.longitude[inside])
    across = MARGIN_DEG / np.cos(np.radians(np.abs(latitude).max()))
    region = (
        float(np.floor(longitude.min() - across)),
        float(np.ceil(longitude.max() + across)),
        float(np.floor(latitude.min() - MARGIN_DEG)),
        float(np.ceil(latitude.max() + MARGIN_DEG)),
    )
    return _computed(region, degree, method, os.environ.get(MAPS_VARIABLE) or None)


@lru_cache(maxsize=4)
def _read_map(path: Path, _: int, method: str) -> FieldMap:
    return FieldMap.from_netcdf(path, method=method)


@lru_cache(maxsize=4)
def _computed(
    region: tuple[float, float, float, float], degree: int, method: str, folder: str | None
) -> FieldMap:
    """EGM2008 over a region, from the folder of maps if it is there already."""
    west, east, south, north = (f"{bound:g}" for bound in region)
    name = f"egm2008-{degree}_{west}_{east}_{south}_{north}.nc"
    kept = None if folder is None else Path(folder) / name
    if kept is not None and kept.is_file():
        return FieldMap.from_netcdf(kept, method=method)
    from navopt.data.egm2008 import free_air_anomaly

    made = FieldMap.from_xarray(free_air_anomaly(region, degree=degree), name=name, method=method)
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        # written aside and renamed: other processes may be looking for it
        aside = kept.with_suffix(f".{os.getpid()}.part")
        made.to_netcdf(aside)
        aside.replace(kept)
    return made
