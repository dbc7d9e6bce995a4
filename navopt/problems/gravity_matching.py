"""Matching an inertial track to a map of gravity anomalies (paper 003)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, UnknownName
from navopt.models.cruise import InsErrors
from navopt.models.earth import local_tangent_plane, principal_radii, to_geodetic
from navopt.models.field_map import FieldMap
from navopt.models.field_map_checks import check_method
from navopt.problem import EstimationProblem, Parameter
from navopt.problems import gravity_kernels as kernels
from navopt.problems.gravity_errors import check_number
from navopt.problems.gravity_geometry import check_coverage, checked_prior, picture, window_covariance
from navopt.problems.gravity_scores import last_position_bounds, match_scores
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.registry import problem

__all__ = ["GravityMatching", "MatchedTrack"]

CRITERIA = {"mad": kernels.MAD, "mean-square": kernels.MEAN_SQUARE, "huber": kernels.HUBER}
#: The decision vector that leaves the inertial track as it is.
NO_CHANGE = np.array([0.0, 0.0, 0.0, 1.0])


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
        unit, if samples err independently.
    measurement_errors : MeasurementErrors, optional
        Instead of `noise`, all that is known about the errors of measurement and map.
    ins_errors : InsErrors, optional
        1σ of the errors of the INS, for methods that use the whole track.
    window : int, default 12
        Number of last samples matched.
    criterion : {"mad", "mean-square", "huber"}
        Loss: mean absolute difference (25), mean square difference, or Huber's mean, of
        the squares of small differences and of a multiple of the size of large ones.
    huber : float, default 1.345
        Where large begins, in standard deviations of measurement and map together (95 % efficiency if
        the errors are normal; Huber 1964).
    offset : {"known", "free"}, optional
        Whether a constant between measurements and map is taken out of each candidate's differences (their
        median; their mean for ``"mean-square"``). Free if a bias is declared and nothing is given.
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
        noise: float | None = None,
        measurement_errors: MeasurementErrors | None = None,
        ins_errors: InsErrors | None = None,
        window: int = 12,
        criterion: str = "mad",
        huber: float = 1.345,
        offset: str | None = None,
        box: Any = "covariance",
        scale_limit: float | None = None,
        method: str | None = None,
    ) -> None:
        if criterion not in CRITERIA:
            raise UnknownName("criterion", criterion, CRITERIA)
        self.huber = check_number("huber", huber, lambda value: value > 0.0, "give a positive number")
        if offset not in (None, "known", "free"):
            raise UnknownName("offset", offset, ("known", "free"))
        if (
            isinstance(window, bool)
            or not isinstance(window, int | np.integer)
            or not 3 <= window <= len(track)
        ):
            raise InvalidInput("window", window, f"give 3 to {len(track)} samples, as many as the track has")
        if measurement_errors is None:
            remedy = f"give a positive standard deviation in {field_map.unit}"
            sigma = check_number("noise", 1.0 if noise is None else noise, lambda value: value > 0.0, remedy)
            measurement_errors = MeasurementErrors(noise=sigma)
        elif noise is not None:
            raise InvalidInput("noise", noise, "leave it out where measurement_errors are given")
        self.field_map, self.track = field_map, track
        self.measurement_errors, self.ins_errors = measurement_errors, ins_errors
        self.noise = float(np.hypot(measurement_errors.noise, measurement_errors.map_error))
        self.window, self.criterion = int(window), criterion
        self.offset = offset or (
            "free" if measurement_errors.bias or measurement_errors.drift_per_day else "known"
        )
        self.method = check_method(method or field_map.method)
        last = slice(len(track) - self.window, None)
        # a track may be written across the date line: its mean must not be on the far side of the Earth
        latitude, longitude = track.latitude[last], np.unwrap(track.longitude[last])
        check_coverage(field_map, latitude, longitude)
        # on the tangent plane at the mean position the sequence's centroid is the origin exactly
        self.origin = float(latitude.mean()), float(longitude.mean())
        meridian, prime_vertical = principal_radii(self.origin[0])
        self._plane = (*self.origin, float(meridian), float(prime_vertical * np.cos(self.origin[0])))
        north, east = local_tangent_plane(latitude, longitude, *self.origin)
        self.sequence = np.ascontiguousarray(np.stack([north - north.mean(), east - east.mean()], axis=1))
        self.measured = np.ascontiguousarray(track.measured[last])
        self._prior_covariance = checked_prior(self.sequence, position_covariance, prior_covariance)
        self.position_covariance = (
            None if position_covariance is None else np.array(position_covariance, dtype=float)
        )
        covariance = window_covariance(track, self.window, measurement_errors)
        self._root = None if covariance is None else np.linalg.cholesky(covariance)
        super().__init__(self._make_parameters(box, scale_limit))
        for array in (
            self.sequence, self.measured, self._prior_covariance, self._root, self.position_covariance
        ):  # fmt: skip
            if array is not None:
                array.setflags(write=False)
        if track.true_latitude is not None and track.true_longitude is not None:
            self.truth = MatchedTrack(track.true_latitude[last], track.true_longitude[last])

    # -- prior and box -----------------------------------------------------------------------------
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
        arguments = (X, self.sequence, self.measured, *self._kernel_arguments(), CRITERIA[self.criterion])
        if self.offset == "known" and self.criterion != "huber":
            kernels.losses(*arguments, out)
        else:
            kernels.robust_losses(*arguments, self.huber * self.noise, self.offset == "free", out)
        return out

    def invalid_reasons(self, X: np.ndarray) -> list[str]:
        """Say that a point left the map: the only way a candidate can fail."""
        return ["a point of the track lies outside the map"] * len(X)

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        out = np.empty((len(X), self.window))
        sigma = self.noise if self._root is None else 1.0
        kernels.residuals(X, self.sequence, self.measured, *self._kernel_arguments(), sigma, out)
        if self._root is not None:
            kernels.whiten(self._root, out[:, :, None])
        return out

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        out = np.empty((len(X), self.window, 4))
        sigma = self.noise if self._root is None else 1.0
        kernels.slopes(X, self.sequence, *self._kernel_arguments(), sigma, out)
        if self._root is not None:
            kernels.whiten(self._root, out)
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
        return match_scores(self, estimate)

    @cached_property
    def position_bounds(self) -> tuple[float, float]:
        """Bounds on the last position from window and track (root of the trace, m), for scores alone."""
        return last_position_bounds(self)

    # -- worlds --------------------------------------------------------------------------------------
    @classmethod
    def simulate(  # type: ignore[override]
        cls,
        seed: int = 0,
        *,
        hours: float = 3.0,
        degree: int = 2190,
        area: str = "typical",
        voyage: str = "straight",
        ins: str = "drawn",
        initial_sigma_m: float | None = None,
        heading_sigma_deg: float | None = None,
        initial_error_m: float | None = None,
        heading_error_deg: float | None = None,
        scale_error: float | None = None,
        map_error: float | str | None = None,
        map_error_length_m: float = 10e3,
        map_error_shape: str = "gaussian",
        map_error_in: str = "map",
        noise_mgal: float = 1.0,
        noise_freedom: float | None = None,
        outlier_fraction: float = 0.0,
        outlier_mgal: float = 20.0,
        bias_mgal: float = 0.0,
        drift_mgal_h: float = 0.0,
        eotvos: bool = False,
        declared: dict[str, Any] | None = None,
        interval_s: float = 300.0,
        window: int = 12,
        criterion: str = "mad",
        huber: float = 1.345,
        offset: str | None = None,
        box: str = "covariance",
        method: str = "bilinear",
        noise_seed: int | None = None,
    ) -> GravityMatching:
        """Draw one world: the voyage of paper 003 over real gravity, with its own INS and noise.

        Parameters
        ----------
        seed : int
            Seed of the INS errors and of all that is drawn below.
        hours : float
            Time since departure at which the track is matched; at most 16.
        degree : {720, 2190}
            Degree of the embedded EGM2008 anomalies that are the truth.
        area : {"typical", "smooth", "rough"}
            The paper's voyage, or one over the smoothest or the roughest field of the map.
        voyage : {"straight", "turns"}
            Constant heading and speed, or drawn legs of 40 min to 2 h, 15 to 45° to either side of the mean
            course, at 0.6 to 1.1 times the speed. With turns the errors of the INS follow eq. (18).
        ins : {"drawn", "published", "placed"}
            INS errors drawn from N(0, Table 1) for each world; one fixed realisation with every source at
            plus one sigma, as the paper used; or no INS but the truth shifted, turned and scaled.
        initial_sigma_m, heading_sigma_deg : float, optional
            1σ of the initial position error per axis (0.1′ if not given), and of the initial heading error
            (none). For a placed track, of its errors: 10 km and 5° if not given.
        initial_error_m, heading_error_deg, scale_error : float, optional
            For a placed track: its distance from the truth at the middle of the window (the
            direction is drawn), how far it is turned clockwise, and the true length over its own; drawn if
            not given, the scale with 1σ of 0.1.
        map_error : float or "degree-720", optional
            Error of the map matched against: a random field of this standard deviation (mGal), drawn afresh
            per world; or the map to degree 720 against a degree-2190 truth.
        map_error_length_m : float
            Distance at which the correlation of the random field is 1/e.
        map_error_shape : {"gaussian", "exponential"}
            Its correlation, see `navopt.models.random_field`.
        map_error_in : {"map", "field"}
            Whether the map has structure that the field lacks, as noise of a survey, or the field has
            structure that the map lacks, as after smoothing. Structure in the map gives it false slopes.
        noise_mgal : float
            Standard deviation of the gravimeter noise.
        noise_freedom : float, optional
            Heavy-tailed noise: Student's t with so many degrees of freedom and the same standard deviation.
        outlier_fraction, outlier_mgal : float
            Share of samples with an additional normal error, and its 1σ. Never declared.
        bias_mgal, drift_mgal_h : float
            1σ of the gravimeter's bias, and of its drift per hour.
        eotvos : bool
            Reduce the measurements with the velocity of the INS.
        declared : dict, optional
            Fields of `MeasurementErrors` that the problem declares instead of the facts.
        interval_s : float
            Sampling interval.
        window, criterion, huber, offset, box, method
            As for the class. ``box="paper"`` takes S from eq. (24) with the velocity error of an INS
            whose sources are all at plus three sigma; a placed track has no such box.
        noise_seed : int, optional
            Another draw of the gravimeter noise for the same world.

        Returns
        -------
        GravityMatching
        """
        scenario = {name: v for name, v in locals().items() if name not in ("cls", "seed", "noise_seed")}
        from navopt.problems.gravity_worlds import build_world

        loss = {name: scenario.pop(name) for name in ("criterion", "huber", "offset")}
        world = build_world(cls, seed, noise_seed, loss=loss, **scenario)
        object.__setattr__(world, "_world", {"seed": seed, **scenario, **loss})
        return world

    @classmethod
    def data_checksum(cls, *, degree: int = 2190, **scenario: Any) -> str:
        """Checksums of the embedded maps a scenario uses."""
        degrees = {degree, 720} if scenario.get("map_error") == "degree-720" else {degree}
        return "+".join(FieldMap.embedded(d).sha256 for d in sorted(degrees))

    def illustration(self) -> dict[str, np.ndarray]:
        """Map about the voyage, inertial and true track, for the report's picture."""
        return picture(self)
