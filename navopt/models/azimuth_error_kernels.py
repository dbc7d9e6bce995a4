"""The compiled steps of `navopt.models.azimuth_error`, which says what they calculate."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["advance", "advance_into", "heading_measurement", "rate_into", "rates", "steps"]

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def _rotation(east, north, up):
    """Nine entries of C_n^n'."""
    se, ce, sn, cn = math.sin(east), math.cos(east), math.sin(north), math.cos(north)
    su, cu = math.sin(up), math.cos(up)
    return (
        cn * cu - sn * se * su, cn * su + sn * se * cu, -sn * ce,
        -ce * su, ce * cu, se,
        sn * cu + cn * se * su, sn * su - cn * se * cu, cn * ce,
    )  # fmt: skip


@_compiled
def _small_rotation(east, north, up):
    """The same for small east and north, whose squares are left out."""
    s, c = math.sin(up), math.cos(up)
    return c, s, -north, -s, c, east, north * c + east * s, north * s - east * c, 1.0


@_compiled
def _heading_rate(x, y, z, wx, wy, wz):
    """Rate of the heading, clockwise from north, of an axis (x, y, z) that turns with the rate w."""
    moving_x, moving_y = wy * z - wz * y, wz * x - wx * z
    return (moving_x * y - x * moving_y) / (x * x + y * y)


@_compiled
def rate_into(x, c, with_heading, ahead, out):
    """Write the rate of the state, `ahead` seconds later, into `out`. Compiled, callable from compiled code.

    Parameters
    ----------
    x : ndarray, shape (11,) or (10,)
        State, see `advance`.
    c : ndarray, shape (22,)
        Inputs.
    with_heading : bool
        Whether the state holds the heading error.
    ahead : float
        Zero for the rate itself, see `alignment_rate`; half a step for that in the middle of a step. To first
        order in what is large: the turn of the force by the angles' own rate, and the changing velocity.
    out : ndarray, shape of `x`
        Another array than `x`.
    """
    rn, ru, curvature, tangent = c[0], c[1], c[2], c[3]
    ve, vn, pe, pn, pu = x[0], x[1], x[2], x[3], x[4]
    b = 6 if with_heading else 5
    ax, ay, ex, ey, ez = x[b], x[b + 1], x[b + 2], x[b + 3], x[b + 4]
    small = c[21] != 0.0
    r = _small_rotation(pe, pn, pu) if small else _rotation(pe, pn, pu)
    # the gyros' errors in the computed frame, and the rate of n' against n
    e0 = c[4] * ex + c[5] * ey + c[6] * ez
    e1 = c[7] * ex + c[8] * ey + c[9] * ez
    e2 = c[10] * ex + c[11] * ey + c[12] * ez
    w0 = -(r[1] * rn + r[2] * ru) - curvature * vn - e0
    w1 = rn - (r[4] * rn + r[5] * ru) + curvature * ve - e1
    w2 = ru - (r[7] * rn + r[8] * ru) + curvature * tangent * ve - e2
    # what the force should have been, turned on with the frame
    g0 = c[13] - c[4] * ax - c[5] * ay
    g1 = c[14] - c[7] * ax - c[8] * ay
    g2 = c[15] - c[10] * ax - c[11] * ay
    t0, t1, t2 = (
        g0 + ahead * (w1 * g2 - w2 * g1),
        g1 + ahead * (w2 * g0 - w0 * g2),
        g2 + ahead * (w0 * g1 - w1 * g0),
    )
    pull_e = c[13] - (r[0] * t0 + r[3] * t1 + r[6] * t2)
    pull_n = c[14] - (r[1] * t0 + r[4] * t1 + r[7] * t2)
    coriolis = 2.0 * ru + curvature * tangent * ve
    later_e, later_n = ahead * (pull_e + coriolis * vn), ahead * (pull_n - coriolis * ve)
    coriolis += curvature * tangent * later_e
    out[0] = pull_e + coriolis * (vn + later_n)
    out[1] = pull_n - coriolis * (ve + later_e)
    w0 -= curvature * later_n
    w1 += curvature * later_e
    w2 += curvature * tangent * later_e
    if small:
        out[2], out[3], out[4] = w0, w1, w2
    else:
        # -r[2] / cos(phi_E) is the sine of phi_N, and r[5] the sine of phi_E
        inverse = 1.0 / math.sqrt(1.0 - r[5] * r[5])
        sn, cn = -r[2] * inverse, r[8] * inverse
        up = (cn * w2 - sn * w0) * inverse
        out[2], out[3], out[4] = cn * w0 + sn * w2, w1 - r[5] * up, up
    if with_heading:
        if small:
            slope = math.tan(c[19])
            out[5] = out[4] - slope * (out[3] * math.cos(c[20]) + out[2] * math.sin(c[20]))
        else:
            # the forward axis and its rate as computed, and as the state has them
            y0, y1, y2 = c[5], c[8], c[11]
            ve, vn = ve + later_e, vn + later_n
            s0, s1, s2 = c[16] + curvature * vn, c[17] - rn - curvature * ve, c[18] - ru
            seen = _heading_rate(y0, y1, y2, s0, s1, s2 - curvature * tangent * ve)
            h0, h1, h2 = c[16] - e0, c[17] - e1, c[18] - e2
            true = _heading_rate(
                r[0] * y0 + r[3] * y1 + r[6] * y2,
                r[1] * y0 + r[4] * y1 + r[7] * y2,
                r[2] * y0 + r[5] * y1 + r[8] * y2,
                r[0] * h0 + r[3] * h1 + r[6] * h2,
                r[1] * h0 + r[4] * h1 + r[7] * h2 - rn,
                r[2] * h0 + r[5] * h1 + r[8] * h2 - ru,
            )
            out[5] = seen - true
    for k in range(b, b + 5):
        out[k] = 0.0


@_compiled
def advance_into(x, dt, constants, with_heading, out):
    """Write the state a step later into `out`, which is another array than `x`; see `advance`."""
    rate_into(x, constants, with_heading, 0.5 * dt, out)
    for i in range(len(x)):
        out[i] = x[i] + dt * out[i]


@_compiled
def advance(x, dt, constants, with_heading):
    """Return the state a step later. Compiled, and callable from compiled code.

    Parameters
    ----------
    x : ndarray, shape (11,) or (10,)
        State in the order of `STATES_WITH_HEADING`, or of `STATES`.
    dt : float
        Length of the step, s.
    constants : ndarray, shape (22,)
        Inputs, taken as constant over the step: those of its middle; see `azimuth_constants`.
    with_heading : bool
        Whether the state holds the heading error.

    Returns
    -------
    ndarray, shape of `x`

    Notes
    -----
    The rate in the middle of the step, from one evaluation. Angles move by the Earth's rate and the gyro
    biases, so slowly that their own second derivative (2e-8 rad/s^2) is left out: 1e-10 rad in 0.1 s. That
    of the velocities, gravity times the rate of the angles, is not.
    """
    out = np.empty(len(x))
    advance_into(x, dt, constants, with_heading, out)
    return out


@_compiled
def heading_measurement(x, constants):
    """Return the heading error that the angles of a state mean, eq (10). Callable from compiled code.

    Parameters
    ----------
    x : ndarray, shape (11,) or (10,)
        State; only the three angles are used.
    constants : ndarray, shape (22,)
        Inputs at the time of the measurement.

    Returns
    -------
    float
        Computed minus true heading, clockwise, rad. It goes on smoothly with phi_U beyond half a turn:
        means over sigma points need no care, only a measured difference has to be brought near it.

    Notes
    -----
    The heading of ``C_n'^n C'``, exact for any angles; with small levels the first order of eq (10).
    """
    east, north, up = x[2], x[3], x[4]
    if constants[21] != 0.0:
        psi = constants[20]
        return up - math.tan(constants[19]) * (north * math.cos(psi) + east * math.sin(psi))
    r = _rotation(east, north, up)
    y0, y1, y2 = constants[5], constants[8], constants[11]
    true = math.atan2(r[0] * y0 + r[3] * y1 + r[6] * y2, r[1] * y0 + r[4] * y1 + r[7] * y2)
    gap = constants[20] - true - up
    return up + gap - 2.0 * math.pi * math.floor(gap / (2.0 * math.pi) + 0.5)


@_compiled
def rates(states, constants, with_heading, out):
    """Write the rates of states, shape (P, n), into `out`."""
    for i in range(len(states)):
        rate_into(states[i], constants, with_heading, 0.0, out[i])


@_compiled
def steps(states, constants, dt, with_heading, out):
    """Write states a step later, shape (P, n), into `out`."""
    for i in range(len(states)):
        advance_into(states[i], dt, constants, with_heading, out[i])
