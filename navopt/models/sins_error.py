"""The INS error model of paper 003, eq (18), and the constraint on scale that follows from it, (19)–(24).

Frame n is north, east, down; α are the three Euler angles that turn n into the computed frame n′ (z first,
then y, then x, eqs 5–9), without any assumption that they are small. The vertical channel is held
(δh = δv_D = 0), which the paper does not say but must have done: with the printed δḣ = δv_D the height error
grows by e^100 in 16 h.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput, NumericalFault
from navopt.models.cruise import CruiseScenario, InsErrors, check_times
from navopt.models.earth import (
    EARTH_RATE,
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS,
    normal_gravity,
    principal_radii,
)

__all__ = [
    "InsErrorHistory",
    "TrueMotion",
    "propagate_ins_errors",
    "segment_heading_error",
    "segment_length_ratio",
    "segment_scale",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class TrueMotion:
    """What eq (18) needs to know about the true motion of a level vehicle, sampled evenly.

    Parameters
    ----------
    time : array_like, shape (n,)
        Seconds, evenly spaced.
    latitude : array_like, shape (n,)
        True latitude, rad.
    velocity : array_like, shape (n, 2)
        True velocity (north, east), m/s.
    heading : array_like, shape (n,)
        Heading of the forward axis, clockwise from north, rad.
    depth : float
        Depth below the ellipsoid, m.

    Raises
    ------
    InvalidInput
        If the shapes disagree or the times are not evenly spaced.
    """

    time: Array
    latitude: Array
    velocity: Array
    heading: Array
    depth: float = 0.0

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[int, ...]] = {"latitude": (), "velocity": (2,), "heading": ()}
        time = np.asarray(self.time, dtype=np.float64)
        if time.ndim != 1 or len(time) < 2:
            raise InvalidInput("time", self.time, "give at least two instants")
        step = np.diff(time)
        if step[0] <= 0.0 or np.ptp(step) > 1e-6 * step[0]:
            raise InvalidInput("time", self.time, "resample the motion to an even, increasing time grid")
        object.__setattr__(self, "time", time)
        for name, tail in shapes.items():
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if value.shape != (len(time), *tail) or not np.all(np.isfinite(value)):
                raise InvalidInput(
                    name, getattr(self, name), f"give finite numbers of shape {(len(time), *tail)}"
                )
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, scenario: CruiseScenario, times: ArrayLike | None = None) -> TrueMotion:
        """Sample a voyage at its inertial time step (or at other even times)."""
        time: Array = scenario.time_step * np.arange(scenario.steps + 1, dtype=np.float64)
        if times is not None:
            time = np.asarray(times, dtype=np.float64)
        return cls(
            time=time,
            latitude=scenario.position(time)[0],
            velocity=np.tile(scenario.velocity, (len(time), 1)),
            heading=np.full(len(time), scenario.azimuth),
        )

    def specific_force(self) -> Array:
        """Return f = v̇ + (2ω_ie + ω_en) × v − g in the frame n, m/s², shape (n, 3)."""
        meridian, prime_vertical = principal_radii(self.latitude, self.depth)
        north, east = self.velocity.T
        acceleration = np.gradient(self.velocity, self.time, axis=0)
        sine, cosine = np.sin(self.latitude), np.cos(self.latitude)
        # w = 2ω_ie + ω_en; v_D = 0
        w_north = 2.0 * EARTH_RATE * cosine + east / prime_vertical
        w_east = -north / meridian
        w_down = -2.0 * EARTH_RATE * sine - east * sine / cosine / prime_vertical
        return np.stack(
            [
                acceleration[:, 0] - w_down * east,
                acceleration[:, 1] + w_down * north,
                w_north * east - w_east * north - normal_gravity(self.latitude),
            ],
            axis=-1,
        )


@dataclass(frozen=True, kw_only=True)
class InsErrorHistory:
    """Errors of an INS over time, INS minus truth.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Seconds.
    latitude_error, longitude_error : ndarray, shape (N,)
        δL and δλ, rad.
    velocity_error : ndarray, shape (N, 2)
        δv_N and δv_E, m/s.
    platform_angles : ndarray, shape (N, 3)
        α_x, α_y, α_z, rad.
    latitude : ndarray, shape (N,)
        True latitude, rad.
    """

    time: Array
    latitude_error: Array
    longitude_error: Array
    velocity_error: Array
    platform_angles: Array
    latitude: Array

    @property
    def position_error(self) -> Array:
        """Position error (north, east), m, with the scales of the latitude between; shape (N, 2)."""
        middle = self.latitude + 0.5 * self.latitude_error
        meridian, prime_vertical = principal_radii(middle)
        return np.stack(
            [meridian * self.latitude_error, prime_vertical * np.cos(middle) * self.longitude_error], axis=-1
        )


@numba.njit(cache=True)
def _radii(latitude: float, depth: float) -> tuple[float, float]:  # pragma: no cover
    x = 1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
    prime_vertical = SEMI_MAJOR_AXIS / np.sqrt(x)
    return prime_vertical * (1.0 - ECCENTRICITY_SQUARED) / x - depth, prime_vertical - depth


@numba.njit(cache=True)
def _rate(x, lat, v_n, v_e, f, heading, depth, gyro, accelerometer, out):  # pragma: no cover
    """Right-hand side of eq (18); x = δL, δλ, δv_N, δv_E, α_x, α_y, α_z.

    `gyro` and `accelerometer` are the whole errors of the sensors in the body frame, bias plus noise. With
    a = f + C_b^n ∇, the first two terms of δv̇ are (I − Cᵀ) C a + Cᵀ C C_b^n ∇ = C a − f: the same, with less
    rounding.
    """
    d_lat, d_v_n, d_v_e = x[0], x[2], x[3]
    r_m, r_n = _radii(lat, depth)
    hat = lat + d_lat
    hat_m, hat_n = _radii(hat, depth)
    # eqs 10–13; eq 12 prints sin L without its hat beside cos L̂: both are taken at the same latitude here,
    # midway, which makes the difference exact to third order.
    middle = lat + 0.5 * d_lat
    d_ie_n = -EARTH_RATE * np.sin(middle) * d_lat
    d_ie_d = -EARTH_RATE * np.cos(middle) * d_lat
    d_en_n = d_v_e / hat_n
    d_en_e = -d_v_n / hat_m
    d_en_d = -(np.tan(hat) * d_v_e + (v_e + d_v_e) / np.cos(hat) ** 2 * d_lat) / hat_n
    # hats of ω_ie and ω_en
    ie_n = EARTH_RATE * np.cos(lat) + d_ie_n
    ie_d = -EARTH_RATE * np.sin(lat) + d_ie_d
    en_n = v_e / r_n + d_en_n
    en_e = -v_n / r_m + d_en_e
    en_d = -v_e * np.tan(lat) / r_n + d_en_d
    in_n, in_e, in_d = ie_n + en_n, en_e, ie_d + en_d

    cx, sx = np.cos(x[4]), np.sin(x[4])
    cy, sy = np.cos(x[5]), np.sin(x[5])
    cz, sz = np.cos(x[6]), np.sin(x[6])
    # C = C_αx C_αy C_αz (6). Erratum of (5): the printed C_αz turns the other way than its two fellows, and
    # (7) and (9) hold only with [c s 0; −s c 0; 0 0 1].
    c00, c01, c02 = cy * cz, cy * sz, -sy
    c10, c11, c12 = sx * sy * cz - cx * sz, sx * sy * sz + cx * cz, sx * cy
    c20, c21, c22 = cx * sy * cz + sx * sz, cx * sy * sz - sx * cz, cx * cy

    ch, sh = np.cos(heading), np.sin(heading)
    # (I − C) ω̂ + C δω − C C_b^n ε  =  ω̂ − C u,  u = ω̂ − δω + C_b^n ε
    u_n = in_n - d_ie_n - d_en_n + ch * gyro[0] - sh * gyro[1]
    u_e = in_e - d_en_e + sh * gyro[0] + ch * gyro[1]
    u_d = in_d - d_ie_d - d_en_d + gyro[2]
    w_x = in_n - (c00 * u_n + c01 * u_e + c02 * u_d)
    w_y = in_e - (c10 * u_n + c11 * u_e + c12 * u_d)
    w_z = in_d - (c20 * u_n + c21 * u_e + c22 * u_d)

    a_n = f[0] + ch * accelerometer[0] - sh * accelerometer[1]
    a_e = f[1] + sh * accelerometer[0] + ch * accelerometer[1]
    a_d = f[2] + accelerometer[2]

    tangent, secant = np.tan(lat), 1.0 / np.cos(lat)
    out[0] = d_v_n / r_m
    out[1] = d_v_e * secant / r_n + d_lat * v_e * tangent * secant / r_n
    # −(2δω_ie + δω_en) × v − (2ω̂_ie + ω̂_en) × δv with v_D = δv_D = 0: only the down component acts
    p = 2.0 * d_ie_d + d_en_d
    q = 2.0 * ie_d + en_d
    out[2] = c00 * a_n + c01 * a_e + c02 * a_d - f[0] + p * v_e + q * d_v_e
    out[3] = c10 * a_n + c11 * a_e + c12 * a_d - f[1] - p * v_n - q * d_v_n
    # α̇ = C_ω⁻¹ w (9)
    out[4] = w_x + (sx * w_y + cx * w_z) * sy / cy
    out[5] = cx * w_y - sx * w_z
    out[6] = (sx * w_y + cx * w_z) / cy


@numba.njit(cache=True)
def _integrate(x0, step, lat, velocity, force, heading, depth, sensors):  # pragma: no cover
    """Classical Runge–Kutta; the sensor errors are held over a step, the true motion is linear within it."""
    n = len(lat)
    states = np.empty((n, 7))
    states[0] = x0
    k1, k2, k3, k4 = np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    for i in range(n - 1):
        x = states[i]
        g, a = sensors[i, :3], sensors[i, 3:]
        lat_m = 0.5 * (lat[i] + lat[i + 1])
        n_m = 0.5 * (velocity[i, 0] + velocity[i + 1, 0])
        e_m = 0.5 * (velocity[i, 1] + velocity[i + 1, 1])
        f_m = 0.5 * (force[i] + force[i + 1])
        h_m = 0.5 * (heading[i] + heading[i + 1])
        _rate(x, lat[i], velocity[i, 0], velocity[i, 1], force[i], heading[i], depth, g, a, k1)
        _rate(x + 0.5 * step * k1, lat_m, n_m, e_m, f_m, h_m, depth, g, a, k2)
        _rate(x + 0.5 * step * k2, lat_m, n_m, e_m, f_m, h_m, depth, g, a, k3)
        j = i + 1
        _rate(x + step * k3, lat[j], velocity[j, 0], velocity[j, 1], force[j], heading[j], depth, g, a, k4)
        states[j] = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return states


def _platform_angles(attitude_error: Any, heading: float) -> Array:
    """α of an INS whose roll, pitch and heading are off: C = Ĉ_b^n (C_b^n)ᵀ, taken apart in the order (6)."""
    from scipy.spatial.transform import Rotation

    roll, pitch, yaw = attitude_error
    computed = Rotation.from_euler("xyz", [roll, pitch, heading + yaw])
    return (Rotation.from_euler("z", heading) * computed.inv()).as_euler("ZYX")[::-1]


def propagate_ins_errors(
    motion: CruiseScenario | TrueMotion,
    errors: InsErrors,
    *,
    times: ArrayLike | None = None,
    rng: np.random.Generator | int | None = None,
) -> InsErrorHistory:
    """Propagate INS errors by paper 003's nonlinear model, eq (18), with Runge–Kutta of fourth order.

    Parameters
    ----------
    motion : CruiseScenario or TrueMotion
        The true motion; the integration step is its sampling interval (1 s for the paper's voyage).
    errors : InsErrors
        Biases, initial errors and white noise, body axes forward-right-down.
    times : array_like, shape (N,), optional
        Output times, s since the start of the motion; every step by default. Between two steps the result
        is linear.
    rng : numpy.random.Generator or int, optional
        Source of the white noise, or its seed; needed only if there is noise.

    Returns
    -------
    InsErrorHistory
        δL, δλ, δv and α over time.

    Raises
    ------
    InvalidInput
        If the times leave the motion or noise is asked for without `rng`.
    NumericalFault
        If the errors leave the model (a platform angle near 90°).

    Notes
    -----
    Errata applied: sign of C_αz in (5); the vertical channel held; sin L beside cos L̂ in (12) both taken
    midway. Agrees with the strapdown run (`navopt.models.ins.simulate_ins`) of the paper's voyage to 0.1 %.
    """
    true = TrueMotion.of(motion) if isinstance(motion, CruiseScenario) else motion
    elapsed = true.time - true.time[0]
    wanted = elapsed if times is None else check_times(times, float(elapsed[-1]))
    step, n = float(elapsed[1]), len(elapsed)
    sensors = np.tile(np.array([*errors.gyro_bias, *errors.accelerometer_bias]), (n, 1))
    if errors.gyro_noise or errors.accelerometer_noise:
        if rng is None:
            raise InvalidInput("rng", rng, "give a seed or a numpy Generator: these errors contain noise")
        noise = np.random.default_rng(rng).standard_normal((n, 6)) / np.sqrt(step)
        sensors += noise * np.repeat([errors.gyro_noise, errors.accelerometer_noise], 3)
    angles = _platform_angles(errors.attitude_error, float(true.heading[0]))
    x0 = np.array([errors.latitude_error, errors.longitude_error, *errors.velocity_error, *angles])
    force, heading = true.specific_force(), np.unwrap(true.heading)
    states = _integrate(x0, step, true.latitude, true.velocity, force, heading, true.depth, sensors)
    if not np.all(np.isfinite(states)):
        raise NumericalFault(f"INS error model (18) diverged for {errors!r}")
    if times is not None:
        states = np.stack([np.interp(wanted, elapsed, column) for column in states.T], axis=-1)
    return InsErrorHistory(
        time=wanted,
        latitude_error=states[:, 0],
        longitude_error=states[:, 1],
        velocity_error=states[:, 2:4],
        platform_angles=states[:, 4:],
        latitude=np.interp(wanted, elapsed, true.latitude),
    )


def _segments(velocity_ins: ArrayLike, velocity_error: ArrayLike) -> tuple[Array, Array]:
    """Twice the mean velocity over each segment, INS and true (22), both of shape (..., N − 1, 2)."""
    v, d = np.asarray(velocity_ins, dtype=np.float64), np.asarray(velocity_error, dtype=np.float64)
    if v.ndim < 2 or v.shape[-1] != 2 or v.shape[-2] < 2:
        raise InvalidInput(
            "velocity_ins", v.shape, "give an array of shape (..., N, 2) with N of two or more"
        )
    if d.shape[-2:] != v.shape[-2:]:
        raise InvalidInput(
            "velocity_error", d.shape, f"give the same sampling points as velocity_ins, {v.shape}"
        )
    true = v - d
    return v[..., :-1, :] + v[..., 1:, :], true[..., :-1, :] + true[..., 1:, :]


def segment_length_ratio(velocity_ins: ArrayLike, velocity_error: ArrayLike) -> Array:
    """Return the true over the INS-indicated length of each segment of a track, eqs (21)–(23).

    Parameters
    ----------
    velocity_ins : array_like, shape (..., N, 2)
        INS velocity (north, east) at the N sampling points, m/s.
    velocity_error : array_like, shape (..., N, 2)
        Its error, INS minus truth, m/s; leading axes broadcast.

    Returns
    -------
    ndarray, shape (..., N - 1)
        d_real / d_INS.

    Raises
    ------
    InvalidInput
        If the shapes do not fit.
    """
    ins, true = _segments(velocity_ins, velocity_error)
    return np.hypot(true[..., 0], true[..., 1]) / np.hypot(ins[..., 0], ins[..., 1])


def segment_scale(velocity_ins: ArrayLike, velocity_error: ArrayLike) -> Array:
    """Return S, the true over the INS-indicated length of a whole sequence, eq (24).

    The paper bounds the scale of its affine transformation by 1 and S. It needs the velocity error, which an
    INS does not know: use simulated errors, or the 3σ of `navopt.models.ins.velocity_error_covariance`.

    Parameters
    ----------
    velocity_ins, velocity_error : array_like, shape (..., N, 2)
        As for `segment_length_ratio`, at equal intervals.

    Returns
    -------
    ndarray, shape (...)
        S.

    """
    ins, true = _segments(velocity_ins, velocity_error)
    return np.hypot(true[..., 0], true[..., 1]).sum(-1) / np.hypot(ins[..., 0], ins[..., 1]).sum(-1)


def segment_heading_error(velocity_ins: ArrayLike, velocity_error: ArrayLike) -> Array:
    """Return how far the INS turns each segment of a track clockwise (the paper's Fig 3).

    Parameters
    ----------
    velocity_ins, velocity_error : array_like, shape (..., N, 2)
        As for `segment_length_ratio`.

    Returns
    -------
    ndarray, shape (..., N - 1)
        Heading of the INS segment minus that of the true one, rad, within ±π.

    """
    ins, true = _segments(velocity_ins, velocity_error)
    cross = true[..., 0] * ins[..., 1] - true[..., 1] * ins[..., 0]
    return np.arctan2(cross, (true * ins).sum(-1))
