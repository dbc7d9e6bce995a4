"""Matching an inertial track to a map of gravity anomalies (paper 003)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import NAUTICAL_MILE, distance, local_tangent_plane, principal_radii, to_geodetic
from navopt.models.field_map import FieldMap
from navopt.models.field_map_checks import check_method
from navopt.problem import EstimationProblem, Parameter
from navopt.problems import gravity_kernels as kernels
from navopt.registry import problem

__all__ = ["GravityMatching", "MatchedTrack"]

CRITERIA = {"mad": kernels.MAD, "mean-square": kernels.MEAN_SQUARE}
#: The decision vector that leaves the inertial track as it is.
NO_CHANGE = np.array([0.0, 0.0, 0.0, 1.0])
#: Radii, in nautical miles (′ of latitude), within which paper 003 calls a match successful.
MATCH_RADII = (2, 5)


@dataclass(frozen=True)
class MatchedTrack:
    """Positions of the matched samples.

    Attributes
    ----------
    latitude, longitude : ndarray, shape (window,)
        Estimated positions, rad, in the order of the samples; the last is the navigation fix.
    """

    latitude: np.ndarray
    longitude: np.ndarray


@problem(
    "gravity-matching",
    summary="find the translation, rotation and scale that lay an inertial track on a gravity map",
    example={"hours": 3.0},
)
class GravityMatching(EstimationProblem):
    """Match the last samples of an inertial track to a map of the field measured along it.

    The decision vector is ``(north, east, rotation, scale)``: the inertial sequence q of the window is
    scaled and turned (clockwise) about its centroid and shifted, ``x = t + s R(β) q``, on the plane
    that touches the ellipsoid at the centroid. Paper 003, eqs. (25)-(34); the paper acts on degrees
    about the origin of latitude and longitude, which no track survives.

    Parameters
    ----------
    field_map : FieldMap
        The map matched against.
    track : MeasuredTrack
        Inertial positions and measured field since departure, and the truth where it is known.
    position_covariance : array_like, shape (2 window, 2 window), optional
        Covariance of the inertial position errors (n_1, e_1, n_2, …) of the window, m², for instance
        `navopt.models.ins.position_error_covariance`. It makes the prior and the box.
    prior_covariance : array_like, shape (4, 4), optional
        Instead of it, the covariance of the decision vector itself.
    noise : float, default 1.0
        Standard deviation of measured minus mapped field (gravimeter and map together), in the map's
        unit.
    window : int, default 12
        Number of last samples matched.
    criterion : {"mad", "mean-square"}
        Loss: mean absolute difference (25), or mean square difference.
    box : {"covariance", "paper"} or array_like, shape (4, 2)
        Search box: three prior sigmas about no change; the paper's (three sigmas of position, ±15°,
        scale between 1 and `scale_limit`); or lower and upper limits.
    scale_limit : float, optional
        S of eq. (24), for ``box="paper"``.
    method : {"bilinear", "bicubic"}, optional
        Interpolation; the map's own if not given.

    Raises
    ------
    InvalidInput
        If the map does not cover the window's inertial positions, or an argument cannot be used.

    Notes
    -----
    The loss looks at the window only; `track` holds everything since departure for methods that use
    more. A candidate of which any point leaves the map has loss ``+inf``.
    """

    provides = frozenset({"residuals", "prior", "bound", "track", "similarity"})

    def __init__(
        self,
        field_map: FieldMap,
        track: MeasuredTrack,
        *,
        position_covariance: Any = None,
        prior_covariance: Any = None,
        noise: float = 1.0,
        window: int = 12,
        criterion: str = "mad",
        box: Any = "covariance",
        scale_limit: float | None = None,
        method: str | None = None,
    ) -> None:
        if criterion not in CRITERIA:
            raise UnknownName("criterion", criterion, CRITERIA)
        if (
            isinstance(window, bool)
            or not isinstance(window, int | np.integer)
            or not 3 <= window <= len(track)
        ):
            raise InvalidInput("window", window, f"give 3 to {len(track)} samples, as many as the track has")
        if not (np.isfinite(noise) and noise > 0):
            raise InvalidInput("noise", noise, f"give a positive standard deviation in {field_map.unit}")
        self.field_map, self.track, self.noise = field_map, track, float(noise)
        self.window, self.criterion = int(window), criterion
        self.method = check_method(method or field_map.method)
        last = slice(len(track) - self.window, None)
        # a track may be written across the date line: its mean must not be on the far side of the Earth
        latitude, longitude = track.latitude[last], np.unwrap(track.longitude[last])
        _check_coverage(field_map, latitude, longitude)
        # on the tangent plane at the mean position the sequence's centroid is the origin exactly
        self.origin = float(latitude.mean()), float(longitude.mean())
        meridian, prime_vertical = principal_radii(self.origin[0])
        self._plane = (*self.origin, float(meridian), float(prime_vertical * np.cos(self.origin[0])))
        north, east = local_tangent_plane(latitude, longitude, *self.origin)
        self.sequence = np.ascontiguousarray(np.stack([north - north.mean(), east - east.mean()], axis=1))
        self.measured = np.ascontiguousarray(track.measured[last])
        self._prior_covariance = self._make_prior(position_covariance, prior_covariance)
        super().__init__(self._make_parameters(box, scale_limit))
        for array in (self.sequence, self.measured, self._prior_covariance):
            array.setflags(write=False)
        if track.true_latitude is not None and track.true_longitude is not None:
            self.truth = MatchedTrack(track.true_latitude[last], track.true_longitude[last])
        self._world: dict[str, Any] | None = None

    # -- prior and box -----------------------------------------------------------------------------
    def _make_prior(self, positions: Any, parameters: Any) -> np.ndarray:
        if (positions is None) == (parameters is None):
            raise InvalidInput(
                "position_covariance, prior_covariance",
                "both" if positions is not None else "none",
                "give exactly one: how large the inertial errors may be decides where to search",
            )
        name, given = (
            ("prior_covariance", parameters) if positions is None else ("position_covariance", positions)
        )
        size = 4 if positions is None else 2 * self.window
        covariance = np.array(given, dtype=float)
        if covariance.shape != (size, size) or not np.allclose(covariance, covariance.T):
            raise InvalidInput(name, covariance.shape, f"give a symmetric matrix of shape ({size}, {size})")
        if positions is not None:
            projection = _similarity_of_displacements(self.sequence)
            covariance = projection @ covariance @ projection.T
        variances = np.diag(covariance)
        if not (np.isfinite(variances).all() and (variances > 0).all()):
            raise InvalidInput(name, variances.tolist(), "every parameter needs a positive finite variance")
        sigma = np.sqrt(variances)
        if np.linalg.eigvalsh(covariance / np.outer(sigma, sigma))[0] <= 0:
            raise InvalidInput(name, covariance.tolist(), "a covariance must be positive definite")
        return covariance

    def _make_parameters(self, box: Any, scale_limit: float | None) -> list[Parameter]:
        reach = 3.0 * np.sqrt(np.diag(self._prior_covariance))
        limits = np.stack([NO_CHANGE - reach, NO_CHANGE + reach], axis=1)
        if isinstance(box, str):
            if box == "paper":
                if scale_limit is None or not scale_limit > 0 or scale_limit == 1.0:
                    raise InvalidInput("scale_limit", scale_limit, 'box="paper" needs S of eq. (24), not 1')
                limits[2] = np.radians([-15.0, 15.0])
                limits[3] = sorted((1.0, float(scale_limit)))
            elif box != "covariance":
                raise UnknownName("box", box, ("covariance", "paper"))
            # a track cannot shrink to a point or turn over, however large the errors
            limits[2] = np.clip(limits[2], -np.pi, np.pi)
            limits[3] = np.maximum(limits[3], 0.1)
        else:
            limits = np.array(box, dtype=float)
            if limits.shape != (4, 2):
                raise InvalidInput("box", limits.shape, "give lower and upper limits, shape (4, 2)")
            if not limits[3, 0] > 0:
                raise InvalidInput("box", limits[3].tolist(), "scales must be positive")
        names = (("north", "m"), ("east", "m"), ("rotation", "rad"), ("scale", "1"))
        return [
            Parameter(name, unit, float(low), float(high), float(np.clip(value, low, high)))
            for (name, unit), (low, high), value in zip(names, limits, NO_CHANGE, strict=True)
        ]

    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """No change on average, and the covariance of the similarity that best undoes the INS errors."""
        return NO_CHANGE.copy(), self._prior_covariance

    # -- the objective -------------------------------------------------------------------------------
    def _kernel_arguments(self) -> tuple[Any, ...]:
        bicubic = self.method == "bicubic"
        nodes, *grid = self.field_map.spline_grid if bicubic else self.field_map.grid
        return self._plane, nodes, tuple(grid), self.field_map.shape, bicubic

    @property
    def metres_per_radian(self) -> tuple[float, float]:
        """Scales of the tangent plane: metres per radian of latitude and of longitude."""
        return self._plane[2:]

    def _loss(self, X: np.ndarray) -> np.ndarray:
        out = np.empty(len(X))
        kernels.losses(
            X, self.sequence, self.measured, *self._kernel_arguments(), CRITERIA[self.criterion], out
        )
        return out

    def invalid_reasons(self, X: np.ndarray) -> list[str]:
        """Say that a point left the map: the only way a candidate can fail."""
        return ["a point of the track lies outside the map"] * len(X)

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        out = np.empty((len(X), self.window))
        kernels.residuals(X, self.sequence, self.measured, *self._kernel_arguments(), self.noise, out)
        return out

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        out = np.empty((len(X), self.window, 4))
        kernels.slopes(X, self.sequence, *self._kernel_arguments(), self.noise, out)
        return out

    # -- physics -------------------------------------------------------------------------------------
    def estimate(self, x: np.ndarray) -> MatchedTrack:
        """Matched positions of the window."""
        north, east, angle, scale = np.asarray(x, dtype=float)
        cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
        q = self.sequence
        latitude, longitude = to_geodetic(
            north + cosine * q[:, 0] - sine * q[:, 1], east + sine * q[:, 0] + cosine * q[:, 1], *self.origin
        )
        return MatchedTrack(latitude, longitude)

    def project(self, estimate: MatchedTrack) -> np.ndarray:
        """Least-squares similarity from the inertial window to the estimate, clipped to the box."""
        q = self.sequence
        y = np.stack(local_tangent_plane(estimate.latitude, estimate.longitude, *self.origin), axis=1)
        shift = y.mean(axis=0)
        y = y - shift
        along, across = np.sum(q * y), np.sum(q[:, 0] * y[:, 1] - q[:, 1] * y[:, 0])
        return self.clip(
            np.array([*shift, np.arctan2(across, along), np.hypot(along, across) / np.sum(q * q)])
        )

    def _score(self, estimate: MatchedTrack) -> dict[str, float]:
        errors = distance(estimate.latitude, estimate.longitude, self.truth.latitude, self.truth.longitude)
        last = float(errors[-1])
        scores = {"position_error_m": last, "mean_position_error_m": float(errors.mean())}
        for radius in MATCH_RADII:
            scores[f"matched_within_{radius}nmi"] = float(last <= radius * NAUTICAL_MILE)
        return scores

    # -- worlds --------------------------------------------------------------------------------------
    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        hours: float = 3.0,
        degree: int = 2190,
        map_error: float | str | None = None,
        ins: str = "drawn",
        noise_mgal: float = 1.0,
        interval_s: float = 300.0,
        window: int = 12,
        criterion: str = "mad",
        box: str = "covariance",
        method: str = "bilinear",
        noise_seed: int | None = None,
    ) -> GravityMatching:
        """Draw one world: the voyage of paper 003 over real gravity, with its own INS and noise.

        Parameters
        ----------
        seed : int
            Seed of the INS biases, its initial position error, its noise and the gravimeter's noise.
        hours : float
            Time since departure at which the track is matched; at most 16.
        degree : {720, 2190}
            Degree of the embedded EGM2008 anomalies that are the truth.
        map_error : float or "degree-720", optional
            Error of the map matched against: a random field of this standard deviation (mGal) with a
            correlation length of 10 km, drawn afresh per world; or the map to degree 720 against a
            degree-2190 truth. Its standard deviation over the whole map enters the declared noise as if
            it were independent from sample to sample; it is not, so `error_bound` is optimistic then.
        ins : {"drawn", "published"}
            INS errors drawn from N(0, Table 1) for each world, or one fixed realisation with every
            source at plus one sigma, as the paper used.
        noise_mgal : float
            Standard deviation of the gravimeter noise.
        interval_s : float
            Sampling interval.
        window, criterion, box, method
            As for the class. ``box="paper"`` takes S from eq. (24) with the velocity error of an INS
            whose sources are all at plus three sigma.
        noise_seed : int, optional
            Another draw of the gravimeter noise for the same world.

        Returns
        -------
        GravityMatching
        """
        from navopt.problems.gravity_worlds import build_world

        scenario: dict[str, Any] = {
            "hours": hours,
            "degree": degree,
            "map_error": map_error,
            "ins": ins,
            "noise_mgal": noise_mgal,
            "interval_s": interval_s,
            "window": window,
            "criterion": criterion,
            "box": box,
            "method": method,
        }
        world = build_world(cls, seed, noise_seed, **scenario)
        object.__setattr__(world, "_world", {"seed": seed, **scenario})
        return world

    def redraw(self, seed: int) -> EstimationProblem:
        """Return the same voyage and INS with other gravimeter noise."""
        if self._world is None:
            return super().redraw(seed)
        return type(self).simulate(noise_seed=seed, **self._world)

    @classmethod
    def data_checksum(cls, *, degree: int = 2190, **scenario: Any) -> str:
        """Checksums of the embedded maps a scenario uses."""
        degrees = {degree, 720} if scenario.get("map_error") == "degree-720" else {degree}
        return "+".join(FieldMap.embedded(d).sha256 for d in sorted(degrees))

    def illustration(self) -> dict[str, np.ndarray]:
        """Map about the voyage, inertial and true track, for the report's picture."""
        track = self.track
        tracks = {"ins_latitude": track.latitude, "ins_longitude": track.longitude}
        if track.true_latitude is not None and track.true_longitude is not None:
            tracks |= {"true_latitude": track.true_latitude, "true_longitude": track.true_longitude}
        margin = np.radians(0.4)
        area = self.field_map
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
            "window": np.array([self.window]),
        }


def _span(axis: np.ndarray, tracks: list[np.ndarray], margin: float) -> slice:
    low = min(float(t.min()) for t in tracks) - margin
    high = max(float(t.max()) for t in tracks) + margin
    return slice(int(np.searchsorted(axis, low)), int(np.searchsorted(axis, high)) + 1)


def _similarity_of_displacements(sequence: np.ndarray) -> np.ndarray:
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


def _check_coverage(field_map: FieldMap, latitude: np.ndarray, longitude: np.ndarray) -> None:
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
