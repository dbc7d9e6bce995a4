"""Error model with any azimuth error: against exact kinematics, the linear model, and two strapdown runs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from navopt.errors import InvalidInput
from navopt.models.azimuth_error import (
    CONSTANTS,
    STATES,
    STATES_WITH_HEADING,
    advance,
    alignment_process,
    alignment_rate,
    azimuth_constants,
    error_angles,
    error_rotation,
    heading_measurement,
    heading_slope,
    noise_input,
)
from navopt.models.enu_attitude import attitude_angles, attitude_enu
from navopt.models.enu_velocity import earth_rate_enu, transport_rate_enu, velocity_rate
from navopt.models.resting_strapdown import resting_strapdown
from navopt.models.static_alignment import StaticSite, error_dynamics
from navopt.models.static_strapdown import free_inertial

SITE = StaticSite(latitude=np.radians(45.0))
TRUE = attitude_enu(0.12, -0.07, 0.6)
#: phi_E, phi_N, phi_U in degrees: small, the paper's, tilted, beyond a quarter turn, nearly half a turn.
ANGLES = [(0.01, -0.02, 0.03), (1.0, 1.0, 15.0), (9.0, -14.0, 60.0), (-20.0, 5.0, 120.0), (3.0, 2.0, -179.0)]
GYRO_BIAS, FORCE_BIAS = np.radians([0.01, -0.02, 0.015]), np.array([9e-3, -7e-3, 0.0])


def skew(v: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def computed_rates(
    attitude: np.ndarray, velocity: np.ndarray, transport: bool, true: np.ndarray = TRUE
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rates of what a strapdown system at rest computes, from its kinematics alone."""
    earth = earth_rate_enu(SITE.latitude)
    gyro = earth @ true + GYRO_BIAS
    force = np.array([0.0, 0.0, SITE.g]) @ true + FORCE_BIAS
    v = np.append(velocity, 0.0)
    turn = transport_rate_enu(v, SITE.latitude, radius=SITE.radius) if transport else np.zeros(3)
    moving = attitude @ skew(gyro) - skew(earth + turn) @ attitude
    pulled = attitude @ force
    if transport:
        rate = velocity_rate(pulled, v, SITE.latitude, gravity=SITE.g, radius=SITE.radius)
    else:
        rate = pulled - np.cross(2.0 * earth, v)
    return moving, rate[:2], pulled, attitude @ gyro


def heading(attitude: np.ndarray) -> float:
    return float(attitude_angles(attitude)[2])


def difference(a: float, b: float) -> float:
    return (a - b + np.pi) % (2.0 * np.pi) - np.pi


# -- the equations ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("transport", [False, True])
@pytest.mark.parametrize("with_heading", [False, True])
def test_rates_are_those_of_exact_kinematics(
    degrees: tuple[float, float, float], transport: bool, with_heading: bool
) -> None:
    phi, velocity = np.radians(degrees), np.array([3.0, -8.0])
    attitude = error_rotation(phi) @ TRUE
    moving, v_rate, pulled, turned = computed_rates(attitude, velocity, transport)
    # the true attitude rests, the computed one moves: central differences of the angles between the two
    h = 1e-2

    def at(t: float) -> np.ndarray:
        step = Rotation.from_matrix(attitude).as_matrix() + t * moving
        u, _, vt = np.linalg.svd(step)
        return u @ vt

    ahead, behind = at(h), at(-h)
    gap = error_angles(ahead, TRUE) - error_angles(behind, TRUE)
    phi_rate = ((gap + np.pi) % (2.0 * np.pi) - np.pi) / (2.0 * h)
    heading_rate = difference(heading(ahead), heading(behind)) / (2.0 * h)
    constants = azimuth_constants(SITE, attitude, force=pulled, rate=turned, transport=transport)
    state = np.concatenate([velocity, phi, [0.0] * with_heading, FORCE_BIAS[:2], GYRO_BIAS])
    rate = alignment_rate(state, constants)
    np.testing.assert_allclose(rate[:2], v_rate, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(rate[2:5], phi_rate, rtol=0.0, atol=2e-11)
    if with_heading:
        np.testing.assert_allclose(rate[5], heading_rate, rtol=0.0, atol=2e-11)
    assert (rate[-5:] == 0.0).all()


@pytest.mark.parametrize("attitude", [np.eye(3), attitude_enu(0.3, -0.4, -1.0)])
def test_small_angles_give_the_ten_state_model(attitude: np.ndarray) -> None:
    F = error_dynamics(SITE, attitude)
    for small in (False, True):
        c = azimuth_constants(SITE, attitude, transport=True, small_levels=small)
        assert (alignment_rate(np.zeros(10), c) == 0.0).all()
        h = 1e-6 * np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
        columns = (alignment_rate(np.diag(h), c) - alignment_rate(np.diag(-h), c)) / (2.0 * h[:, None])
        np.testing.assert_allclose(columns.T, F, rtol=1e-6, atol=1e-11)


def test_small_levels_leave_out_their_squares() -> None:
    # at any azimuth the force is right but for squares of the levels, or better; the rates, with C_w = I, but
    # for the levels
    gaps = []
    for size in (0.02, 0.01):
        x = np.array([0.0, 0.0, size, -0.7 * size, 1.1, 0.0, 0.0, 0.0, 0.0, 0.0])
        attitude = error_rotation(x[2:5]) @ TRUE
        pulled = attitude @ (np.array([0.0, 0.0, SITE.g]) @ TRUE)
        exact, small = (
            alignment_rate(x, azimuth_constants(SITE, attitude, force=pulled, small_levels=s))
            for s in (False, True)
        )
        gaps.append(np.abs(exact - small)[:5])
    velocity, angles = (np.linalg.norm(np.array(gaps)[:, part], axis=1) for part in (slice(2), slice(2, 5)))
    assert velocity[0] / velocity[1] > 3.5
    assert velocity[1] > 0.0
    assert 1.8 < angles[0] / angles[1] < 2.2
    assert angles[0] < 0.05 * SITE.rate_north


# -- the heading error -------------------------------------------------------------------------------------
@pytest.mark.parametrize("degrees", ANGLES)
def test_heading_measurement_is_the_difference_of_headings(degrees: tuple[float, float, float]) -> None:
    phi = np.radians(degrees)
    attitude = error_rotation(phi) @ TRUE
    x = np.zeros(10)
    x[2:5] = phi
    got = heading_measurement(x, azimuth_constants(SITE, attitude))
    assert abs(difference(got, difference(heading(attitude), heading(TRUE)))) < 1e-12
    # goes on smoothly beyond half a turn
    assert abs(got - phi[2]) < np.radians(10.0)
    x[4] += 2.0 * np.pi
    assert abs(heading_measurement(x, azimuth_constants(SITE, attitude)) - got - 2.0 * np.pi) < 1e-12


def test_first_order_of_the_heading_error_is_equation_10_for_any_azimuth() -> None:
    pitch, yaw = 0.3, 0.6
    true, gaps = attitude_enu(pitch, -0.1, yaw), []
    for size in (1e-3, 5e-4):
        phi = np.array([size, -0.8 * size, 2.0])
        attitude = error_rotation(phi) @ true
        theta, _, psi = (float(a) for a in attitude_angles(attitude))
        printed = phi[2] - np.tan(theta) * (phi[1] * np.cos(psi) + phi[0] * np.sin(psi))
        x = np.zeros(10)
        x[2:5] = phi
        small = heading_measurement(x, azimuth_constants(SITE, attitude, small_levels=True))
        assert abs(small - printed) < 1e-15
        gaps.append(abs(small - heading_measurement(x, azimuth_constants(SITE, attitude))))
    assert gaps[0] < 1e-6
    assert 3.5 < gaps[0] / gaps[1] < 4.5


def test_slope_and_noise_input_are_derivatives() -> None:
    phi = np.radians([4.0, -6.0, 70.0])
    attitude = error_rotation(phi) @ TRUE
    c = azimuth_constants(SITE, attitude)
    x = np.concatenate([[0.0, 0.0], phi, [0.0], FORCE_BIAS[:2], GYRO_BIAS])
    # noise of a gyro is a bias for a moment, and an accelerometer's as well
    G = noise_input(x, c)
    for k, column in ((6, 0), (7, 1), (8, 3), (9, 4), (10, 5)):
        step = 1e-6 * np.eye(11)[k]
        slope = (alignment_rate(x + step, c) - alignment_rate(x - step, c)) / 2e-6
        np.testing.assert_allclose(G[:5, column], slope[:5], atol=1e-8)
        # the measured rate of the heading error: the true heading turns by what the gyro did not see
        np.testing.assert_allclose(G[5, column], slope[5], atol=1e-8)
    level = heading_slope(np.zeros(3), azimuth_constants(SITE, TRUE))
    pitch, _, psi = (float(a) for a in attitude_angles(TRUE))
    expected = [-np.tan(pitch) * np.sin(psi), -np.tan(pitch) * np.cos(psi), 1.0]
    np.testing.assert_allclose(level, expected, atol=1e-9)


# -- steps -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("transport", [False, True])
def test_a_step_follows_the_differential_equation(transport: bool) -> None:
    phi = np.radians([5.0, -8.0, 75.0])
    c = azimuth_constants(SITE, error_rotation(phi) @ TRUE, force=[1.0, 0.4, 9.6], transport=transport)
    x = np.concatenate([[20.0, -9.0], phi, [1.2], FORCE_BIAS[:2], GYRO_BIAS])
    exact = solve_ivp(lambda _, s: alignment_rate(s, c), (0.0, 0.1), x, rtol=1e-12, atol=1e-13).y[:, -1]
    got = advance(x, 0.1, c, True)
    np.testing.assert_allclose(got[:2], exact[:2], atol=2e-8)
    np.testing.assert_allclose(got[2:6], exact[2:6], atol=5e-10)
    np.testing.assert_array_equal(alignment_process(np.stack([x, 2.0 * x]), c, 0.1)[0], got)


def rest(count: int, noise: np.random.Generator | None = None) -> tuple[np.ndarray, np.ndarray]:
    w = np.tile(earth_rate_enu(SITE.latitude) @ TRUE + GYRO_BIAS, (count, 1))
    f = np.tile(np.array([0.0, 0.0, SITE.g]) @ TRUE + FORCE_BIAS, (count, 1))
    if noise is not None:
        w = w + np.radians(0.05) * noise.standard_normal((count, 3))
        f = f + 5e-3 * noise.standard_normal((count, 3))
    return w, f


@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("transport", [False, True])
def test_model_follows_a_strapdown_run_from_a_start_that_is_far_off(every: int, transport: bool) -> None:
    phi = np.radians([1.0, -1.5, 60.0])
    run = resting_strapdown(
        *rest(6000), 0.01, SITE, error_rotation(phi) @ TRUE, every=every, transport=transport
    )
    for n in (10, 11):
        x = np.zeros(n)
        x[2:5], x[-5:-3], x[-3:] = phi, FORCE_BIAS[:2], GYRO_BIAS
        if n == 11:
            x[5] = heading_measurement(x, azimuth_constants(SITE, run.attitude[0]))
        for c in run.constants:
            x = advance(x, 0.01 * every, c, n == 11)
        np.testing.assert_allclose(x[:2], run.velocity[-1], atol=1e-4)
        np.testing.assert_allclose(x[2:5], error_angles(run.attitude[-1], TRUE), atol=3e-7)
        if n == 11:
            now = azimuth_constants(SITE, run.attitude[-1])
            assert abs(x[5] - heading_measurement(x, now)) < 3e-7


def test_resting_strapdown_is_that_of_python_ins_while_it_has_not_moved() -> None:
    w, f = rest(3000, np.random.default_rng(4))
    start = error_rotation(np.radians([0.5, -0.4, 50.0])) @ TRUE
    velocity, attitude = free_inertial(w, f, 0.01, SITE, start)
    ours = resting_strapdown(w, f, 0.01, SITE, start, transport=True)
    # its Earth is an ellipsoid, whose radii differ by half a per cent, and its latitude follows the run
    np.testing.assert_allclose(ours.velocity, velocity, atol=1e-5)
    np.testing.assert_allclose(ours.attitude, attitude, atol=5e-8)
    thin = resting_strapdown(w, f, 0.01, SITE, start, transport=True, every=10)
    np.testing.assert_array_equal(thin.velocity, ours.velocity[::10])
    np.testing.assert_allclose(
        thin.constants[:, 13:16], ours.constants[:, 13:16].reshape(-1, 10, 3).mean(1), rtol=1e-12
    )


# -- angles and inputs -------------------------------------------------------------------------------------
@pytest.mark.parametrize("degrees", ANGLES)
def test_rotation_is_that_of_three_turns(degrees: tuple[float, float, float]) -> None:
    east, north, up = np.radians(degrees)
    # passive: coordinates in the turned frame, about up, then east, then north
    turns = Rotation.from_euler("ZXY", [up, east, north]).as_matrix().T
    np.testing.assert_allclose(error_rotation([east, north, up]), turns, atol=1e-15)
    np.testing.assert_allclose(error_angles(turns @ TRUE, TRUE), [east, north, up], atol=1e-12)


def test_names_and_inputs() -> None:
    assert STATES_WITH_HEADING[5] == "dpsi"
    assert tuple(s for s in STATES_WITH_HEADING if s != "dpsi") == STATES
    assert max(CONSTANTS.values()) == azimuth_constants(SITE, TRUE).shape[0] - 1
    many = azimuth_constants(SITE, np.stack([TRUE, np.eye(3)]))
    np.testing.assert_array_equal(many[1], azimuth_constants(SITE, np.eye(3)))
    with pytest.raises(InvalidInput, match="11 states"):
        alignment_rate(np.zeros(9), azimuth_constants(SITE, TRUE))
    with pytest.raises(InvalidInput, match="22 inputs"):
        alignment_rate(np.zeros(10), np.zeros(3))
    with pytest.raises(InvalidInput, match="nose is up"):
        azimuth_constants(SITE, attitude_enu(np.pi / 2.0, 0.0, 0.0))
    with pytest.raises(InvalidInput, match="finite readings"):
        azimuth_constants(SITE, TRUE, force=[0.0, np.nan, 9.8])
    w, f = rest(100)
    with pytest.raises(InvalidInput, match="both sensors"):
        resting_strapdown(w, f[:50], 0.01, SITE, TRUE)
    with pytest.raises(InvalidInput, match="positive number of seconds"):
        resting_strapdown(w, f, 0.0, SITE, TRUE)
    with pytest.raises(InvalidInput, match="integer from 1"):
        resting_strapdown(w, f, 0.01, SITE, TRUE, every=101)
    w[3, 1] = np.nan
    with pytest.raises(InvalidInput, match="leave no gaps"):
        resting_strapdown(w, f, 0.01, SITE, TRUE)
