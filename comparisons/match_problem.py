"""The problem of one recorded track over one map, after every check that can be made beforehand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comparisons import match_checks as checks
from navopt.data.recorded import RecordedTrack
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput
from navopt.models.cruise import InsErrors
from navopt.models.field_map import FieldMap
from navopt.models.track_errors import TrackErrorBasis, track_error_basis
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gravity_sensing import MeasurementErrors

__all__ = ["CAREFUL", "carried_errors", "matching_problem"]

#: Errors of a good marine gravimeter against a map of the kind of EGM2008, with an unknown datum offset.
CAREFUL = MeasurementErrors(noise=1.0, map_error=3.0, map_error_length=4e3, bias=30.0)


def matching_problem(
    recorded: RecordedTrack,
    field_map: FieldMap,
    *,
    ins_errors: InsErrors | None = None,
    measurement_errors: MeasurementErrors = CAREFUL,
    window: int = 12,
    whole_track: bool = False,
    max_gap_s: float = 3600.0,
    trusted_units: bool = False,
) -> tuple[GravityMatching, InsErrors, np.ndarray, list[str]]:
    """Check a track against a map and make the problem that `match_track` solves.

    Parameters
    ----------
    recorded, field_map, ins_errors, measurement_errors, window, max_gap_s, trusted_units
        As for `match_track`.
    whole_track : bool
        Whether the solver uses the whole track, so that information anywhere on it will do.

    Returns
    -------
    problem : GravityMatching
        Without the truth.
    ins_errors : InsErrors
        Declared 1 sigma of the error sources, scaled where the track states its own sigma.
    prior_sigma : ndarray, shape (2,)
        1 sigma of the last INS position to the north and east, m.
    notes : list of str
        Remarks.

    Raises
    ------
    InvalidInput
        If the input cannot be used.
    """
    checks.check_sensing(measurement_errors)
    checks.check_map(field_map, stated=trusted_units)
    if isinstance(window, bool) or not isinstance(window, int | np.integer) or window < 3:
        raise InvalidInput("--window", window, "give a whole number of samples, at least 3")
    checks.check_track(recorded, window)
    notes = [*recorded.notes, *checks.check_gaps(recorded, max_gap_s)]
    checks.check_coverage(field_map, recorded)
    track = recorded.track
    errors = InsErrors.published() if ins_errors is None else ins_errors
    basis = _basis(track, errors)
    if recorded.position_sigma is not None:
        factor = _factor(basis, recorded.position_sigma)
        errors = _scaled(errors, factor)
        basis = _basis(track, errors)
        notes.append(f"INS errors scaled by {factor:.3g} to the stated sigma of the positions")
    position = basis.position
    sigma = np.sqrt((position**2).sum(axis=2))
    last = slice(-window, None)
    used = slice(None) if whole_track else last
    values, covered = checks.search_area(field_map, track.latitude[used], track.longitude[used], sigma[used])
    checks.check_information(values, measurement_errors)
    if not covered:
        notes.append("the vehicle may have been beyond the map (3 sigma): there it cannot be found")
    columns = position[last].reshape(2 * window, -1)
    problem = GravityMatching(
        field_map,
        replace(track, true_latitude=None, true_longitude=None),
        position_covariance=columns @ columns.T,
        measurement_errors=measurement_errors,
        ins_errors=errors,
        window=int(window),
    )
    return problem, errors, sigma[-1], notes


def carried_errors(recorded: RecordedTrack, errors: InsErrors, first: int) -> InsErrors:
    """Return the 1 sigma of an INS's errors at a later sample, as those of a track that begins there.

    Parameters
    ----------
    recorded : RecordedTrack
        The track from departure.
    errors : InsErrors
        1 sigma at its first sample.
    first : int
        Sample at which another track is to begin.

    Returns
    -------
    InsErrors
        Position and velocity errors have grown; biases and noise are the same. What is lost is how these
        errors depend on each other, so that the later track is told less than is known.
    """
    checks.check_track(recorded, 3)
    track = recorded.track
    basis = _basis(track, errors)
    angle = np.sqrt((basis.angle[first] ** 2).sum(axis=1))
    velocity = np.sqrt((basis.velocity[first] ** 2).sum(axis=1))
    return replace(
        errors, latitude_error=angle[0], longitude_error=angle[1], velocity_error=(velocity[0], velocity[1])
    )


def _basis(track: MeasuredTrack, errors: InsErrors) -> TrackErrorBasis:
    return track_error_basis(track.time, track.latitude, track.longitude, errors, heading=track.heading)


def _factor(basis: TrackErrorBasis, stated: np.ndarray) -> float:
    """What all sources are multiplied by, so that the mean variance over the track is the stated one."""
    computed = 0.5 * (basis.position**2).sum(axis=(1, 2))
    return float(np.sqrt(np.mean(stated**2) / np.mean(computed)))


def _scaled(errors: InsErrors, factor: float) -> InsErrors:
    return InsErrors.from_vector(
        factor * errors.vector,
        velocity_error=factor * np.array(errors.velocity_error),
        attitude_error=factor * np.array(errors.attitude_error),
        gyro_noise=factor * errors.gyro_noise,
        accelerometer_noise=factor * errors.accelerometer_noise,
    )
