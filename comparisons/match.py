"""Matching one recorded track to one map: from files or arrays to a matched track with its sigma."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.audit_solvers import parse_solver
from comparisons.match_problem import CAREFUL, matching_problem
from navopt import registry
from navopt.data.map_files import read_map
from navopt.data.recorded import RecordedTrack, read_track
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, NavoptError
from navopt.models.cruise import InsErrors
from navopt.models.earth import distance, separation
from navopt.models.field_map import FieldMap
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.solution import Solution
from navopt.solving import solve

__all__ = ["Match", "match_track"]

#: Solvers that use all measurements since departure, and take a datum offset into account.
WHOLE_TRACK = ("track-map", "particle-matching", "point-mass")
#: Solvers to which a datum offset looks like another place.
BLIND = ("iccp",)
#: A track varies so many times more (or less) than the map below it: the units may differ.
SUSPICIOUS = 5.0


@dataclass(frozen=True, kw_only=True)
class Match:
    """A matched track and everything needed to judge it.

    Attributes
    ----------
    recorded : RecordedTrack
        What was matched: times, INS positions, measurements and, if known, the truth.
    field_map : FieldMap
        The map.
    first : int
        First matched sample; all later ones are matched too.
    latitude, longitude : ndarray, shape (M,)
        Matched positions of the last M samples, rad.
    covariance : ndarray, shape (M, 2, 2)
        Covariance of each matched position (north, east), m2, as the solver states it; NaN where it states
        none.
    known : bool or None
        False where the solver says that it does not know the position; None where it says nothing of it.
    remark : str
        What it says about that.
    offset : ndarray, shape (N,), or None
        Offset of all measurements (datum, gravimeter bias and drift) that the solver has found, mGal.
    solution : navopt.Solution
        The solver's answer.
    problem : GravityMatching
        What was solved. It holds no truth.
    ins_errors : InsErrors
        1 sigma of the INS's error sources that were declared.
    measurement_errors : MeasurementErrors
        Declared errors of measurement and map.
    prior_sigma : ndarray, shape (2,)
        1 sigma of the last INS position to the north and east that follows from `ins_errors`, m.
    notes : tuple of str
        What was left out, assumed or looks odd, in sentences.
    """

    recorded: RecordedTrack
    field_map: FieldMap
    first: int
    latitude: np.ndarray
    longitude: np.ndarray
    covariance: np.ndarray
    known: bool | None
    remark: str
    offset: np.ndarray | None
    solution: Solution
    problem: GravityMatching
    ins_errors: InsErrors
    measurement_errors: MeasurementErrors
    prior_sigma: np.ndarray
    notes: tuple[str, ...] = ()

    @property
    def correction(self) -> tuple[float, float]:
        """Matched minus INS position of the last sample (north, east), m."""
        track = self.recorded.track
        north, east = separation(
            self.latitude[-1], self.longitude[-1], track.latitude[-1], track.longitude[-1]
        )
        return float(north), float(east)

    @property
    def sigma(self) -> np.ndarray:
        """1 sigma of each matched position to the north and east, m, shape (M, 2); NaN where not stated."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def residuals(self) -> tuple[np.ndarray, np.ndarray]:
        """Measured minus mapped field of the matched samples, along the INS and the matched track, mGal."""
        track = self.recorded.track
        part = slice(self.first, None)
        value, method = self.field_map.value, self.problem.method
        measured = track.measured[part]
        inertial = value(track.latitude[part], track.longitude[part], method)
        return measured - inertial, measured - value(self.latitude, self.longitude, method)

    def scores(self) -> dict[str, float]:
        """Errors against the truth, m; empty where the track has none."""
        track = self.recorded.track
        if track.true_latitude is None or track.true_longitude is None:
            return {}
        part = slice(self.first, None)
        truth = track.true_latitude[part], track.true_longitude[part]
        inertial = distance(track.latitude[part], track.longitude[part], *truth)
        errors = distance(self.latitude, self.longitude, *truth)
        found = {
            "position_error_m": float(errors[-1]),
            "mean_position_error_m": float(errors.mean()),
            "ins_position_error_m": float(inertial[-1]),
            "mean_ins_position_error_m": float(inertial.mean()),
        }
        if np.isfinite(self.covariance[-1]).all():
            apart = np.array(
                separation(self.latitude[-1], self.longitude[-1], truth[0][-1], truth[1][-1]), dtype=float
            )
            found["normalised_error_squared_1"] = float(apart @ np.linalg.solve(self.covariance[-1], apart))
        return found

    def write(self, folder: str | Path, *, inputs: dict[str, Path] | None = None) -> list[Path]:
        """Write the matched track, pictures and summary; see `comparisons.match_output.write_match`."""
        from comparisons.match_output import write_match

        return write_match(self, folder, inputs=inputs)


def match_track(
    track: RecordedTrack | MeasuredTrack | str | Path,
    field_map: FieldMap | str | Path,
    *,
    solver: str | Any = "track-map",
    ins_errors: InsErrors | None = None,
    measurement_errors: MeasurementErrors | None = None,
    window: int = 12,
    budget: int | None = None,
    seed: int = 1,
    max_gap_s: float = 3600.0,
    trusted_units: bool = False,
) -> Match:
    """Match a recorded track to a gravity map.

    Parameters
    ----------
    track : RecordedTrack, MeasuredTrack or path
        INS positions and measured anomalies in mGal; a path is read by `navopt.data.read_track`. A truth in
        it is used for scores only: the solver gets a problem without one.
    field_map : FieldMap or path
        The map; a path is read by `navopt.data.read_map`.
    solver : str or pymoo.core.algorithm.Algorithm
        Registered solver, with settings if need be (``"tercom:remove_mean=true"``), or an algorithm.
    ins_errors : InsErrors, optional
        1 sigma of the INS's error sources at the first sample, and its noise; those of Dai et al. (2019),
        Table 1, if not given. Where the track states the sigma of its positions, all sources are scaled
        together so that both agree in the mean square.
    measurement_errors : MeasurementErrors, optional
        Declared errors of measurement and map; `CAREFUL` if not given.
    window : int
        Number of last samples that the problem's loss looks at. Solvers that use the whole track
        do not mind it.
    budget : int, optional
        Largest cost; the solver's own rule if not given.
    seed : int
        Seed of a stochastic solver.
    max_gap_s : float
        Longest gap between measurements that is accepted, s.
    trusted_units : bool
        Whether numbers that cannot be anomalies in mGal by their size are accepted all the same.

    Returns
    -------
    Match

    Raises
    ------
    InvalidInput
        If the input cannot be used; see the page "Your own track". A field without information is such a
        case: no position is given.
    UnknownName, UnsuitableProblem
        If the solver does not exist or cannot solve such a problem.
    """
    recorded = _recorded(track)
    field = field_map if isinstance(field_map, FieldMap) else read_map(field_map)
    sensing = CAREFUL if measurement_errors is None else measurement_errors
    name = parse_solver(solver).name if isinstance(solver, str) else _name(solver)
    problem, errors, prior_sigma, notes = matching_problem(
        recorded,
        field,
        ins_errors=ins_errors,
        measurement_errors=sensing,
        window=window,
        whole_track=name in WHOLE_TRACK,
        max_gap_s=max_gap_s,
        trusted_units=trusted_units,
    )
    solution = solve(problem, _algorithm(solver, errors, sensing), budget=budget, seed=seed)
    if solution.status == "invalid":
        raise InvalidInput(
            "map",
            "no candidate lies on it wholly",
            "give a larger map: the searched tracks all leave this one",
        )
    latitude, longitude, covariance = _positions(solution.estimate)
    known, remark = _verdict(solution.estimate)
    found = Match(
        recorded=recorded,
        field_map=field,
        first=len(recorded.track) - len(latitude),
        latitude=latitude,
        longitude=longitude,
        covariance=covariance,
        known=known,
        remark=remark,
        offset=_offset(solution.estimate, sensing, recorded.track.time),
        solution=solution,
        problem=problem,
        ins_errors=errors,
        measurement_errors=sensing,
        prior_sigma=prior_sigma,
        notes=tuple(notes),
    )
    return replace(found, notes=(*found.notes, *_oddities(found, name)))


def _recorded(track: Any) -> RecordedTrack:
    if isinstance(track, str | Path):
        return read_track(track)
    if isinstance(track, MeasuredTrack):
        return RecordedTrack(track=replace(track, longitude=np.unwrap(track.longitude)))
    if isinstance(track, RecordedTrack):
        return track
    raise InvalidInput("track", type(track).__name__, "give a path, a RecordedTrack or a MeasuredTrack")


def _name(algorithm: Any) -> str:
    return str(getattr(getattr(algorithm, "solver_info", None), "name", type(algorithm).__name__))


def _algorithm(solver: Any, errors: InsErrors, sensing: MeasurementErrors) -> Any:
    """Solver with what is declared, as far as it asks for it and the user has not said otherwise."""
    if not isinstance(solver, str):
        return solver
    entry = parse_solver(solver)
    accepted = inspect.signature(registry.solver_factory(entry.name)).parameters
    offered = {"sigmas": errors, "bias": sensing.bias, "remove_mean": sensing.bias > 0.0}
    settings = {key: value for key, value in offered.items() if key in accepted} | entry.settings
    try:
        return registry.make_solver(entry.name, **settings)
    except (TypeError, ValueError) as error:
        if isinstance(error, NavoptError):
            raise
        # a value of another kind than the setting has
        raise InvalidInput("solver", solver, f"give settings that {entry.name} takes ({error})") from None


def _positions(estimate: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matched positions, of the whole track where the solver has them, and covariances, NaN if not stated."""
    whole = getattr(estimate, "track_latitude", None) is not None
    names = ("track_latitude", "track_longitude", "track_covariance")
    if not whole:
        names = ("latitude", "longitude", "covariance")
    latitude, longitude = (np.array(getattr(estimate, name)) for name in names[:2])
    covariance = np.full((len(latitude), 2, 2), np.nan)
    stated = getattr(estimate, names[2], None)
    if stated is not None:
        # a filter may state that of the last position only
        found = np.asarray(stated, dtype=float).reshape(-1, 2, 2)
        covariance[len(latitude) - len(found) :] = found
    return latitude, longitude, covariance


def _verdict(estimate: Any) -> tuple[bool | None, str]:
    """Whether the solver stands by its answer, and what it says."""
    if hasattr(estimate, "knows"):
        said = (
            f"1 sigma {estimate.sigma_m:.0f} m in all, {estimate.gain:.1f} nats learnt, "
            f"probability of this mode {100 * estimate.probability:.0f} %"
        )
        if np.isfinite(estimate.next_cost):
            said += (
                f"; the next-best one is {estimate.next_distance_m / 1e3:.1f} km away and "
                f"{estimate.next_cost:.1f} worse in minus log posterior"
            )
        return bool(estimate.knows), said
    if hasattr(estimate, "accepted"):
        return bool(estimate.accepted), str(getattr(estimate, "message", ""))
    return None, ""


def _offset(estimate: Any, sensing: MeasurementErrors, time: np.ndarray) -> np.ndarray | None:
    """Datum offset and drift of the measurements that the solver has found, mGal at every sample."""
    names = list(getattr(estimate, "names", ()))
    found = dict(zip(names, np.asarray(getattr(estimate, "coefficients", ())), strict=False))
    if not {"bias", "drift"} & set(found):
        return None
    days = (time - time[0]) / 86400.0
    return np.asarray(
        sensing.bias * found.get("bias", 0.0) + sensing.drift_per_day * found.get("drift", 0.0) * days
    )


def _oddities(found: Match, name: str) -> list[str]:
    """What looks odd about an answer."""
    notes = []
    track = found.recorded.track
    _, matched = found.residuals()
    below = found.field_map.value(track.latitude, track.longitude)
    ratio = float(np.std(track.measured) / max(np.std(below), found.measurement_errors.noise))
    if ratio > SUSPICIOUS or (ratio < 1 / SUSPICIOUS):
        notes.append(
            f"the measurements vary {ratio:.2g} times as much as the map below the INS track: other units?"
        )
    offset = float(np.mean(matched)) if np.isfinite(matched).all() else 0.0
    if name in BLIND and abs(offset) > 2.0 * found.problem.noise:
        notes.append(
            f"{name} does not estimate a datum offset, and measured minus map is {offset:+.1f} mGal on "
            "average: the position may be wrong by it"
        )
    reach = 3.0 * found.prior_sigma
    if np.any(np.abs(found.correction) > reach):
        notes.append("the correction is beyond 3 sigma of the declared INS errors")
    return notes
