"""Geometry of a matching problem: its prior, what its map must cover, and the arrays of its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.models.earth import separation
from navopt.models.field_map import FieldMap
from navopt.problems.gravity_sensing import MeasurementErrors

if TYPE_CHECKING:
    from navopt.data.tracks import MeasuredTrack
    from navopt.problems.gravity_matching import GravityMatching

__all__ = ["check_coverage", "checked_prior", "picture", "similarity_of_displacements", "window_covariance"]


def similarity_of_displacements(sequence: np.ndarray) -> np.ndarray:
    """Linear map from INS position errors (n_1, e_1, …) to the similarity that undoes them, (4, 2N).

    To first order the truth is ``q - δ = t + q + β J q + (s - 1) q`` in the least-squares sense.
    """
    n = len(sequence)
    spread = np.sum(sequence**2)
    turned = np.stack([-sequence[:, 1], sequence[:, 0]], axis=1)
    rows = np.zeros((4, 2 * n))
    rows[0, 0::2] = -1.0 / n
    rows[1, 1::2] = -1.0 / n
    rows[2] = -turned.ravel() / spread
    rows[3] = -sequence.ravel() / spread
    return rows


def checked_prior(sequence: np.ndarray, positions: Any, parameters: Any) -> np.ndarray:
    """Covariance of the decision vector, from that of the positions or as given; shape (4, 4).

    Parameters
    ----------
    sequence : ndarray, shape (N, 2)
        INS positions of the window about their mean, m.
    positions, parameters : array_like or None
        ``position_covariance`` and ``prior_covariance`` of `GravityMatching`: exactly one of them.

    Raises
    ------
    InvalidInput
        If both or none are given, or the one given is not a covariance of the right shape.
    """
    if (positions is None) == (parameters is None):
        raise InvalidInput(
            "position_covariance, prior_covariance",
            "both" if positions is not None else "none",
            "give exactly one: how large the inertial errors may be decides where to search",
        )
    name, given = (
        ("prior_covariance", parameters) if positions is None else ("position_covariance", positions)
    )
    size = 4 if positions is None else 2 * len(sequence)
    covariance = np.array(given, dtype=float)
    if covariance.shape != (size, size) or not np.allclose(covariance, covariance.T):
        raise InvalidInput(name, covariance.shape, f"give a symmetric matrix of shape ({size}, {size})")
    if positions is not None:
        projection = similarity_of_displacements(sequence)
        covariance = projection @ covariance @ projection.T
    variances = np.diag(covariance)
    if not (np.isfinite(variances).all() and (variances > 0).all()):
        raise InvalidInput(name, variances.tolist(), "every parameter needs a positive finite variance")
    sigma = np.sqrt(variances)
    if np.linalg.eigvalsh(covariance / np.outer(sigma, sigma))[0] <= 0:
        raise InvalidInput(name, covariance.tolist(), "a covariance must be positive definite")
    return covariance


def window_covariance(track: MeasuredTrack, window: int, errors: MeasurementErrors) -> np.ndarray | None:
    """Declared covariance of the last measurements; None where they are independent and alike.

    Parameters
    ----------
    track : MeasuredTrack
        The whole track: a drift begins with its first sample.
    window : int
        Number of last samples, N.
    errors : MeasurementErrors
        What is declared. The Eötvös effect plays no part: it is an error of the INS.

    Returns
    -------
    ndarray, shape (N, N), or None
        In the square of the map's unit.
    """
    if not (errors.map_error or errors.bias or errors.drift_per_day):
        return None
    last = slice(len(track) - window, None)
    latitude, longitude = track.latitude[last], track.longitude[last]
    legs = np.hypot(*separation(latitude[1:], longitude[1:], latitude[:-1], longitude[:-1]))
    run = np.concatenate([[0.0], np.cumsum(legs)])
    days = (track.time[last] - track.time[0]) / 86400.0
    return np.asarray(
        errors.noise**2 * np.eye(window)
        + errors.map_error**2 * np.exp(-np.abs(run[:, None] - run) / errors.map_error_length)
        + errors.bias**2
        + errors.drift_per_day**2 * np.outer(days, days)
    )


def check_coverage(field_map: FieldMap, latitude: np.ndarray, longitude: np.ndarray) -> None:
    """Refuse a map that does not hold all points of a window (rad)."""
    inside = field_map.contains(latitude, longitude)
    if not inside.all():
        k = int(np.flatnonzero(~inside)[0])
        west, east, south, north = field_map.bounds_deg
        raise InvalidInput(
            "track",
            f"{int((~inside).sum())} of the {len(latitude)} matched samples outside the map, the first at "
            f"({np.degrees(latitude[k]):.4f}°, {np.degrees(longitude[k]):.4f}°)",
            f"the map covers {south:g}° to {north:g}°N and {west:g}° to {east:g}°E: give a larger map",
        )


def picture(problem: GravityMatching) -> dict[str, np.ndarray]:
    """Arrays of `GravityMatching.illustration`."""
    track = problem.track
    tracks = {"ins_latitude": track.latitude, "ins_longitude": track.longitude}
    if track.true_latitude is not None and track.true_longitude is not None:
        tracks |= {"true_latitude": track.true_latitude, "true_longitude": track.true_longitude}
    margin = np.radians(0.4)
    area = problem.field_map
    rows = _span(area.latitude, [v for k, v in tracks.items() if k.endswith("latitude")], margin)
    # every longitude on the map's own turn
    middle = float(area.longitude.mean())
    for name in [k for k in tracks if k.endswith("longitude")]:
        tracks[name] = tracks[name] - 2 * np.pi * np.round((tracks[name] - middle) / (2 * np.pi))
    columns = _span(area.longitude, [v for k, v in tracks.items() if k.endswith("longitude")], margin)
    return {
        **tracks,
        "map_latitude": area.latitude[rows],
        "map_longitude": area.longitude[columns],
        "map_values": area.values[rows, columns].astype(np.float32),
        "window": np.array([problem.window]),
    }


def _span(axis: np.ndarray, tracks: list[np.ndarray], margin: float) -> slice:
    low = min(float(t.min()) for t in tracks) - margin
    high = max(float(t.max()) for t in tracks) + margin
    return slice(int(np.searchsorted(axis, low)), int(np.searchsorted(axis, high)) + 1)
