"""Errors of a strapdown system at rest whose azimuth may be wrong by any angle: eqs (4)-(13) of paper 002.

The angles ``phi_E, phi_N, phi_U`` turn the true frame n (east, north, up) into the computed frame n': first
about up, then about east, then about north, ``C_n^n' = Cy(phi_N) Cx(phi_E) Cz(phi_U)``. With C' the computed
attitude, f' and w' the measured specific force and angular rate in n', e and a the biases in body axes, w_in
the rate of the true frame and dw what the computed frame turns beside it because of a wrong velocity::

    dv'  = (I - C_n'^n) f' + C_n'^n C' a - (2 w_ie + w_en) x dv                       eq (4)
    phi' = C_w^-1 [ (I - C_n^n') w_in + dw - C' e ]                                   eq (5)
    a' = e' = 0                                                                       eqs (6), (7)
    dpsi = psi' - psi = phi_U - tan(theta) (phi_N cos psi' + phi_E sin psi')          eq (10), small levels

``dpsi`` is the heading that the system computes minus the true one, both clockwise from north. The equations
are missing from the copies of the paper that a machine can read; these are of its source (Yan, 2008), with
exact rotations. ``small_levels=True`` gives the form for small phi_E and phi_N, with ``C_w = I``.

A system that is not corrected drifts by its gyro biases, 0.01 deg/s times 1500 s are 15 degrees: small levels
are small for a minute only, so the exact form is the default. There the heading error moves by the rates of
the two headings, computed and true, of which eq (11) keeps the first order.

Everything is compiled. The inputs of a step are one vector, see `CONSTANTS`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.errors import InvalidInput
from navopt.models.azimuth_error_kernels import (
    advance,
    advance_into,
    heading_measurement,
    rate_into,
    rates,
    steps,
)
from navopt.models.static_alignment import StaticSite

__all__ = [
    "CONSTANTS",
    "STATES",
    "STATES_WITH_HEADING",
    "advance",
    "advance_into",
    "alignment_process",
    "alignment_rate",
    "azimuth_constants",
    "error_angles",
    "error_rotation",
    "heading_measurement",
    "heading_slope",
    "noise_input",
    "rate_into",
]

Array = NDArray[np.float64]

#: Names of the states without and with the heading error.
STATES = ("dv_e", "dv_n", "phi_e", "phi_n", "phi_u", "accel_x", "accel_y", "gyro_x", "gyro_y", "gyro_z")
STATES_WITH_HEADING = (*STATES[:5], "dpsi", *STATES[5:])
#: What the vector of inputs of one step holds, and from which index: Earth rate north and up (rad/s);
#: curvature 1/R (1/m; zero where the system knows that it rests and leaves the transport rate out); tangent
#: of the latitude; C_b^n' by rows; measured force (m/s^2) and rate (rad/s) in n'; pitch and heading of C_b^n'
#: (rad); and 1 for the form of small levels.
CONSTANTS = {
    "rate_north": 0, "rate_up": 1, "curvature": 2, "tangent": 3, "attitude": 4, "force": 13, "rate": 16,
    "pitch": 19, "heading": 20, "small_levels": 21,
}  # fmt: skip
#: Length of that vector.
SIZE = 22


def alignment_rate(state: ArrayLike, constants: ArrayLike) -> Array:
    """Return how the errors move, eqs (4)-(7) and (11).

    Parameters
    ----------
    state : array_like, shape (..., 11) or (..., 10)
        With or without the heading error, see `STATES_WITH_HEADING`: m/s, rad, m/s^2, rad/s.
    constants : array_like, shape (22,)
        Inputs, see `azimuth_constants`.

    Returns
    -------
    ndarray, shape of `state`
        Per second.

    Raises
    ------
    InvalidInput
        If a shape does not fit.
    """
    flat, c, shape = _checked(state, constants)
    out = np.empty_like(flat)
    rates(flat, c, shape[-1] == 11, out)
    return out.reshape(shape)


def alignment_process(states: ArrayLike, constants: ArrayLike, dt: float) -> Array:
    """Return states a step later, each as `advance` has it: a process function for any unscented filter.

    Parameters
    ----------
    states : array_like, shape (..., 11) or (..., 10)
        With or without the heading error.
    constants : array_like, shape (22,)
        Inputs in the middle of the step.
    dt : float
        In s.

    Returns
    -------
    ndarray, shape of `states`
    """
    flat, c, shape = _checked(states, constants)
    out = np.empty_like(flat)
    steps(flat, c, float(dt), shape[-1] == 11, out)
    return out.reshape(shape)


def azimuth_constants(
    site: StaticSite,
    attitude: ArrayLike,
    *,
    force: ArrayLike | None = None,
    rate: ArrayLike | None = None,
    transport: bool = False,
    small_levels: bool = False,
) -> Array:
    """Return the inputs of `advance` and `heading_measurement`.

    Parameters
    ----------
    site : StaticSite
        Where the system stands.
    attitude : array_like, shape (..., 3, 3)
        C_b^n' as the system computes it, axes right, forward, up to east, north, up: in the middle of a step,
        or at a measurement.
    force, rate : array_like, shape (..., 3), optional
        Measured specific force (m/s^2) and angular rate (rad/s) in the computed frame n', ``C_b^n' f``, means
        over the step. If not given, gravity and the Earth's rate as a system sees them whose computed
        attitude is right.
    transport : bool
        Whether the system adds the transport rate of its velocity to the rate of its frame. One that is told
        that it stands still has no reason to.
    small_levels : bool
        The form for small phi_E and phi_N.

    Returns
    -------
    ndarray, shape (..., 22)
        See `CONSTANTS`.

    Raises
    ------
    InvalidInput
        If the attitude is not a rotation or readings do not fit it.
    """
    from navopt.models.enu_attitude import attitude_angles

    c = np.asarray(attitude, dtype=np.float64)
    pitch, _, heading = attitude_angles(c)
    lead = c.shape[:-2]
    if (np.abs(pitch) > np.radians(89.9)).any():
        raise InvalidInput("attitude", "a pitch of 90 degrees", "heading means nothing when the nose is up")
    out = np.empty((*lead, SIZE))
    out[..., 0], out[..., 1] = site.rate_north, site.rate_up
    out[..., 2] = 1.0 / (site.radius + site.height) if transport else 0.0
    out[..., 3] = np.tan(site.latitude)
    out[..., 4:13] = c.reshape(*lead, 9)
    known = {"force": np.array([0.0, 0.0, site.g]), "rate": np.array([0.0, site.rate_north, site.rate_up])}
    for name, given in (("force", force), ("rate", rate)):
        values = known[name] if given is None else np.asarray(given, dtype=np.float64)
        if values.shape[-1:] != (3,) or not np.isfinite(values).all():
            raise InvalidInput(name, f"shape {values.shape}", "give finite readings, shape (..., 3)")
        out[..., CONSTANTS[name] : CONSTANTS[name] + 3] = values
    out[..., 19], out[..., 20] = pitch, heading
    out[..., 21] = float(bool(small_levels))
    return out


def error_rotation(angles: ArrayLike) -> Array:
    """Return ``C_n^n'`` of the angles phi_E, phi_N, phi_U (rad), shape (..., 3) to (..., 3, 3)."""
    phi = np.asarray(angles, dtype=np.float64)
    entries = np.stack(np.broadcast_arrays(*_rotation_arrays(phi[..., 0], phi[..., 1], phi[..., 2])), axis=-1)
    return entries.reshape(*phi.shape[:-1], 3, 3)


def _rotation_arrays(east: Array, north: Array, up: Array) -> tuple[Array, ...]:
    se, ce, sn, cn = np.sin(east), np.cos(east), np.sin(north), np.cos(north)
    su, cu = np.sin(up), np.cos(up)
    return (
        cn * cu - sn * se * su, cn * su + sn * se * cu, -sn * ce,
        -ce * su, ce * cu, se,
        sn * cu + cn * se * su, sn * su - cn * se * cu, cn * ce,
    )  # fmt: skip


def error_angles(computed: ArrayLike, true: ArrayLike) -> Array:
    """Return phi_E, phi_N, phi_U between a computed and a true attitude, the inverse of `error_rotation`.

    Parameters
    ----------
    computed, true : array_like, shape (..., 3, 3)
        C_b^n' and C_b^n.

    Returns
    -------
    ndarray, shape (..., 3)
        In rad, ``computed = error_rotation(angles) @ true``; phi_U in (-pi, pi].
    """
    r = np.asarray(computed, dtype=np.float64) @ np.swapaxes(np.asarray(true, dtype=np.float64), -1, -2)
    east = np.arcsin(np.clip(r[..., 1, 2], -1.0, 1.0))
    return np.stack(
        [east, np.arctan2(-r[..., 0, 2], r[..., 2, 2]), np.arctan2(-r[..., 1, 0], r[..., 1, 1])], axis=-1
    )


def heading_slope(angles: ArrayLike, constants: ArrayLike) -> Array:
    """Return the derivative of `heading_measurement` by phi_E, phi_N, phi_U, shape (3,).

    Parameters
    ----------
    angles : array_like, shape (3,)
        In rad.
    constants : array_like, shape (22,)
        Inputs.

    Returns
    -------
    ndarray, shape (3,)
        About ``(-tan(theta) sin psi', -tan(theta) cos psi', 1)``.
    """
    phi, c = np.asarray(angles, dtype=np.float64), np.ascontiguousarray(constants, dtype=np.float64)
    step, out, state = 1e-5, np.empty(3), np.zeros(10)
    for k in range(3):
        state[2:5] = phi
        state[2 + k] += step
        ahead = heading_measurement(state, c)
        state[2 + k] -= 2.0 * step
        out[k] = (ahead - heading_measurement(state, c)) / (2.0 * step)
    return out


def noise_input(state: ArrayLike, constants: ArrayLike) -> Array:
    """Return G of ``x' = f(x) + G w``: how the noise of the sensors enters the state.

    Parameters
    ----------
    state : array_like, shape (11,) or (10,)
        With or without the heading error.
    constants : array_like, shape (22,)
        Inputs.

    Returns
    -------
    ndarray, shape (11, 6) or (10, 6)
        By the noise of the accelerometers right, forward, up and of the three gyros. The row of the heading
        error is that of the angles times `heading_slope`, so that both stay as correlated as they are: with
        independent noise on each the measured heading says less and less about phi_U.
    """
    flat, c, shape = _checked(state, constants)
    x, with_heading = flat[0], shape[-1] == 11
    phi, attitude = x[2:5], c[4:13].reshape(3, 3)
    out = np.zeros((shape[-1], 6))
    back = error_rotation(phi).T
    out[:2, :3] = (back @ attitude)[:2]
    if c[21] != 0.0:
        out[2:5, 3:] = -attitude
    else:
        se, ce, sn, cn = np.sin(phi[0]), np.cos(phi[0]), np.sin(phi[1]), np.cos(phi[1])
        turning = np.array([[cn, 0.0, -sn * ce], [0.0, 1.0, se], [sn, 0.0, cn * ce]])
        out[2:5, 3:] = -np.linalg.solve(turning, attitude)
    if with_heading:
        out[5] = heading_slope(phi, c) @ out[2:5]
    return out


def _checked(state: ArrayLike, constants: ArrayLike) -> tuple[Array, Array, tuple[int, ...]]:
    x = np.ascontiguousarray(state, dtype=np.float64)
    c = np.ascontiguousarray(constants, dtype=np.float64)
    if x.shape[-1:] not in ((10,), (11,)):
        raise InvalidInput("state", f"shape {x.shape}", "give 11 states, or 10 without the heading error")
    if c.shape != (SIZE,):
        raise InvalidInput("constants", f"shape {c.shape}", f"give {SIZE} inputs, see azimuth_constants")
    return x.reshape(-1, x.shape[-1]), c, x.shape
