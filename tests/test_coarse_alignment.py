"""Attitude, coarse alignment, and the velocity equation, against python-ins and scipy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from navopt.errors import InvalidInput
from navopt.models import enu_velocity
from navopt.models.alignment_sensors import ImuGrade, coarse_covariance, simulate_static_imu
from navopt.models.coarse_alignment import analytic_alignment, coarse_alignment, level
from navopt.models.earth import EARTH_RATE
from navopt.models.enu_attitude import (
    attitude_angles,
    attitude_enu,
    corrected_attitude,
    misalignment,
    tilted_attitude,
)
from navopt.models.static_alignment import StaticSite, alignment_limits

RECORDING = Path(__file__).resolve().parent.parent.parent / "shared" / "data" / "lasergyro.imu"
#: From east, north, up to north, east, down, and from right, forward, up to forward, right, down.
SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
DEG_PER_HOUR = np.radians(1.0) / 3600.0


def ideal(site: StaticSite, attitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rate = attitude.T @ enu_velocity.earth_rate_enu(site.latitude)
    return rate, attitude.T @ np.array([0.0, 0.0, site.g])


# -- attitude --------------------------------------------------------------------------------------------
def test_attitude_is_that_of_python_ins() -> None:
    from pyins import transform

    rng = np.random.default_rng(1)
    roll, yaw = rng.uniform(-np.pi, np.pi, (2, 50))
    pitch = rng.uniform(-1.5, 1.5, 50)
    theirs = transform.mat_from_rph(np.degrees(np.stack([roll, pitch, yaw], axis=1)))
    ours = attitude_enu(pitch, roll, yaw)
    np.testing.assert_allclose(ours, SWAP @ theirs @ SWAP, atol=1e-14)
    np.testing.assert_allclose(attitude_angles(ours), (pitch, roll, yaw), atol=1e-12)
    # an independent sequence of three turns: heading is clockwise, so about up it is negative
    turns = Rotation.from_euler("ZXY", np.stack([-yaw, pitch, roll], axis=1)).as_matrix()
    np.testing.assert_allclose(ours, turns, atol=1e-14)


def test_misalignment_undoes_what_tilts() -> None:
    rng = np.random.default_rng(2)
    true = Rotation.random(20, rng=rng).as_matrix()
    angles = rng.normal(scale=0.3, size=(20, 3))
    computed = tilted_attitude(true, angles)
    np.testing.assert_allclose(misalignment(computed, true), angles, atol=1e-13)
    np.testing.assert_allclose(corrected_attitude(computed, angles), true, atol=1e-13)
    # to first order eq. (29), printed as a matrix
    east, north, up = small = np.array([1e-5, -2e-5, 3e-5])
    printed = np.array([[1, up, -north], [-up, 1, east], [north, -east, 1]])
    np.testing.assert_allclose(tilted_attitude(np.eye(3), small), printed, atol=2e-9)


def test_attitudes_that_are_none_are_refused() -> None:
    with pytest.raises(InvalidInput, match="off a rotation"):
        attitude_angles(1.1 * np.eye(3))
    with pytest.raises(InvalidInput, match=r"\+1"):
        attitude_angles(np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(InvalidInput, match="angles"):
        tilted_attitude(np.eye(3), [0.0, np.nan, 0.0])


# -- coarse alignment ------------------------------------------------------------------------------------
@pytest.mark.parametrize("latitude_deg", [-60.0, -5.0, 34.0, 75.0])
def test_perfect_readings_give_the_attitude_exactly(latitude_deg: float) -> None:
    rng = np.random.default_rng(3)
    site = StaticSite(latitude=np.radians(latitude_deg))
    for true in Rotation.random(20, rng=rng).as_matrix():
        rate, force = ideal(site, true)
        for kind in ("svd", "gravity"):
            found = analytic_alignment(rate, force, site.latitude, orthonormal=kind)
            np.testing.assert_allclose(found, true, atol=1e-12)
        if true[2, 2] > 0:
            yaw = float(attitude_angles(true)[2])
            np.testing.assert_allclose(level(force, yaw), true, atol=1e-12)


def test_wrong_readings_give_the_nearest_rotation_to_eq_25() -> None:
    rng = np.random.default_rng(4)
    site = StaticSite(latitude=0.7)
    true = attitude_enu(0.05, -0.1, 2.0)
    rate, force = ideal(site, true)
    rate = rate + 0.05 * EARTH_RATE * rng.normal(size=3)
    force = force + 0.02 * rng.normal(size=3)
    ours = analytic_alignment(rate, force, site.latitude)
    g, w = np.array([0.0, 0.0, -site.g]), enu_velocity.earth_rate_enu(site.latitude)
    printed = np.linalg.inv(np.stack([g, w, np.cross(g, w)])) @ np.stack(
        [-force, rate, np.cross(-force, rate)]
    )
    assert np.abs(printed @ printed.T - np.eye(3)).max() > 1e-3
    np.testing.assert_allclose(ours, polar(printed)[0], atol=1e-10)
    assert np.linalg.det(ours) == pytest.approx(1.0, abs=1e-12)


def test_errors_of_the_sensors_end_where_the_limits_say() -> None:
    site = StaticSite(latitude=np.radians(40.0))
    true = attitude_enu(0.0, 0.0, 0.8)
    rate, force = ideal(site, true)
    gyro, accelerometer = 0.01 * DEG_PER_HOUR * np.array([1, -2, 1.5]), 1e-3 * np.array([1.0, 0.5, -1.0])
    limits = alignment_limits(gyro, accelerometer, site, true)
    found = analytic_alignment(rate + gyro, force + accelerometer, site.latitude, orthonormal="gravity")
    np.testing.assert_allclose(misalignment(found, true), limits, rtol=3e-3, atol=1e-7)
    levelled = misalignment(level(force + accelerometer, 0.8), true)
    np.testing.assert_allclose(levelled, [*limits[:2], 0.0], rtol=2e-3, atol=1e-6)
    # the nearest rotation lets the gyros spoil the level, which gravity alone knows better
    nearest = misalignment(analytic_alignment(rate + gyro, force, site.latitude), true)
    assert np.abs(nearest[:2]).max() > 3e-4
    # 0.01 deg/h at 40 degrees is three minutes of arc, 100 micro-g are 20.6 seconds
    east = alignment_limits([0.01 * DEG_PER_HOUR, 0, 0], np.zeros(3), site)
    assert np.degrees(abs(east[2])) * 60 == pytest.approx(3.0, abs=0.02)
    tilt = alignment_limits(np.zeros(3), [0, 9.80665e-4, 0], site)
    assert np.degrees(abs(tilt[0])) * 3600 == pytest.approx(20.63, abs=0.02)


def test_low_cost_gyros_are_refused_with_the_reason_and_a_heading_helps() -> None:
    site, grade = StaticSite(latitude=np.radians(39.84)), ImuGrade.low_cost()
    true = attitude_enu(0.02, -0.01, 1.2)
    rng = np.random.default_rng(6)
    common = {"steps": 5000, "step": 0.01, "rng": rng, "accelerometer_bias": np.zeros(3)}
    bias = np.array([0.03, -0.02, 0.05]) * np.pi / 180
    gyro, force = simulate_static_imu(site, true, grade, gyro_bias=bias, **common)
    with pytest.raises(InvalidInput, match=r"rate about the.*heading") as caught:
        coarse_alignment(gyro, force, site.latitude)
    assert "where the Earth turns by 11.5 about north" in str(caught.value)
    # an error towards the horizontal alone shows in its size
    flat = true.T @ np.array([0.05, 0.0, 0.0]) * np.pi / 180
    sly, force = simulate_static_imu(site, true, grade, gyro_bias=flat, **common)
    with pytest.raises(InvalidInput, match="rate about the horizontal"):
        coarse_alignment(sly, force, site.latitude)
    # without any bias the noise of five seconds alone is too much, and a data sheet that says so is believed
    brief = {**common, "steps": 500}
    quiet, force = simulate_static_imu(site, true, grade, gyro_bias=np.zeros(3), **brief)
    with pytest.raises(InvalidInput, match=r"standard error of the mean|rate about the"):
        coarse_alignment(quiet, force, site.latitude)
    good, force = simulate_static_imu(site, true, ImuGrade.navigation(), gyro_bias=np.zeros(3), **common)
    with pytest.raises(InvalidInput, match="as declared"):
        coarse_alignment(good, force, site.latitude, gyro_error=grade.gyro_bias)
    found = coarse_alignment(gyro, force, site.latitude, heading=1.2)
    assert found.method == "levelled"
    np.testing.assert_allclose(misalignment(found.attitude, true), 0.0, atol=1e-4)
    assert np.isnan(found.angle_sigma[2])


def test_error_over_sigma_of_repeated_alignments() -> None:
    """200 alignments: the scatter is what `angle_sigma` says, and `coarse_covariance` covers the biases."""
    site, grade = StaticSite(latitude=np.radians(40.0)), ImuGrade.navigation()
    true = attitude_enu(0.01, 0.02, -2.0)
    rng = np.random.default_rng(7)
    errors, pulls = [], []
    for _ in range(200):
        gyro_bias = grade.gyro_bias * rng.standard_normal(3)
        accelerometer_bias = grade.accelerometer_bias * rng.standard_normal(3)
        samples = simulate_static_imu(
            site, true, grade, steps=600, step=0.1, rng=rng,
            gyro_bias=gyro_bias, accelerometer_bias=accelerometer_bias,
        )  # fmt: skip
        found = coarse_alignment(*samples, site.latitude)
        phi = misalignment(found.attitude, true)
        errors.append(np.concatenate([phi, accelerometer_bias[:2], gyro_bias]))
        pulls.append(found.angle_sigma)
    P = coarse_covariance(site, true, grade, duration=60.0, velocity_sigma=0.0)[2:, 2:]
    # eight numbers from 200 alignments against their covariance; band 0.001
    nees = np.einsum("ki,ij,kj->", np.array(errors), np.linalg.inv(P), np.array(errors))
    assert chi2(1600).ppf(0.0005) < nees < chi2(1600).ppf(0.9995)
    # noise alone: azimuth from the gyros' 0.001 deg/sqrt(h) over a minute; the blocks' estimate is rough
    noise = np.radians(0.001 / 60) / np.sqrt(60) / (EARTH_RATE * np.cos(site.latitude))
    assert 0.8 * noise < np.median(np.array(pulls)[:, 2]) < 2.0 * noise


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force": [0.0, 0.0, 1.0]}, "mean specific force"),
        ({"force": [0.0, 0.0, -9.8]}, "up axis"),
        ({"count": 5}, "at least 20"),
        ({"latitude": np.pi / 2}, "latitude"),
        ({"nan": True}, r"gyro\[3, 1\]"),
        ({"heading": np.nan}, "heading"),
    ],
)
def test_unusable_samples_are_named(change: dict, message: str) -> None:
    count = change.get("count", 100)
    gyro = np.tile([0.0, 5.6e-5, 4.7e-5], (count, 1))
    force = np.tile(change.get("force", [0.0, 0.0, 9.8]), (count, 1))
    if change.get("nan"):
        gyro[3, 1] = np.nan
    with pytest.raises(InvalidInput, match=message):
        coarse_alignment(gyro, force, change.get("latitude", 0.7), heading=change.get("heading"))


def test_vectors_that_are_parallel_are_refused() -> None:
    with pytest.raises(InvalidInput, match="horizontal rate"):
        analytic_alignment([0.0, 0.0, 1e-4], [0.0, 0.0, 9.8], 0.7)


# -- the velocity equation -------------------------------------------------------------------------------
def test_velocity_equation_holds_on_a_flight_of_python_ins() -> None:
    """`generate_imu` makes readings for any motion: eq. (18) with them must give the motion back."""
    from pyins import earth, sim, transform

    time = np.arange(0.0, 60.0, 0.1)
    velocity = np.stack(
        [200 + 20 * np.sin(0.1 * time), -150 + 30 * np.cos(0.07 * time), 5 * np.sin(0.05 * time)], axis=1
    )
    rph = np.stack([5 * np.sin(0.1 * time), 3 * np.cos(0.08 * time), 100 + 0.5 * time], axis=1)
    trajectory, imu = sim.generate_imu(time, [55.0, 20.0, 5000.0], rph, velocity)
    attitude = SWAP @ transform.mat_from_rph(trajectory[["roll", "pitch", "heading"]]) @ SWAP
    force = np.einsum("kij,kj->ki", attitude, imu[["accel_x", "accel_y", "accel_z"]].to_numpy() @ SWAP)
    moved = trajectory[["VN", "VE", "VD"]].to_numpy() @ SWAP
    latitude, height = np.radians(trajectory["lat"].to_numpy()), trajectory["alt"].to_numpy()
    gravity = earth.gravity(trajectory["lat"], trajectory["alt"]).to_numpy()
    ours = enu_velocity.velocity_rate(force, moved, latitude, height, gravity=gravity)
    slopes = [2 * np.cos(0.1 * time), -2.1 * np.sin(0.07 * time), 0.25 * np.cos(0.05 * time)]
    theirs = np.stack(slopes, axis=1) @ SWAP
    inner = slice(5, -5)
    np.testing.assert_allclose(ours[inner], theirs[inner], atol=3e-5)
    # the terms of the second order are not small here: the printed signs miss by far
    coriolis = ours - force
    coriolis[:, 2] += gravity
    assert np.abs(coriolis[inner]).max(axis=0).min() > 4e-3
    printed = force - np.cross(2 * enu_velocity.earth_rate_enu(latitude) * [1, 1, -1], moved)
    assert np.abs(printed - theirs)[inner, :2].max() > 5e-3


def test_rows_of_eq_20_are_the_vector_equation_on_a_sphere() -> None:
    rng = np.random.default_rng(8)
    force, velocity = rng.normal(size=(2, 30, 3)) * 10
    latitude, height = rng.uniform(-1.4, 1.4, 30), rng.uniform(0, 1e4, 30)
    kind = {"gravity": 9.79, "radius": 6371393.0}
    np.testing.assert_allclose(
        enu_velocity.velocity_rate_rows(force, velocity, latitude, height, **kind),
        enu_velocity.velocity_rate(force, velocity, latitude, height, **kind),
        rtol=1e-12, atol=1e-13,
    )  # fmt: skip


def test_position_errors_grow_as_eq_30_says() -> None:
    """Two vehicles a little apart, one with another velocity: differences of their true rates."""
    latitude, height = 0.7, 300.0
    velocity, error, off = np.array([40.0, -25.0]), np.array([0.3, 0.2]), 1e-6

    def rates(v: np.ndarray, lat: float) -> np.ndarray:
        # with the radii of the first point, as the paper has it
        at = enu_velocity.transport_rate_enu([*v, 0.0], latitude, height)
        return np.array([-at[0], at[1] / np.cos(lat)])

    expected = rates(velocity + error, latitude + off) - rates(velocity, latitude)
    found = enu_velocity.position_error_rate(error, off, velocity, latitude, height)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


# -- a recording -----------------------------------------------------------------------------------------
@pytest.mark.skipif(
    not RECORDING.exists(), reason="the recorded file is not here: ../shared/data/lasergyro.imu"
)
def test_ring_laser_recording_is_levelled_and_finds_north() -> None:
    gyro, force, header = read_ring_laser()
    found = coarse_alignment(gyro, force, header["latitude"], gravity=9.7955)
    # the header gives 0, 0, and 90.6 degrees clockwise, and says that it may be inaccurate
    assert abs(found.pitch) < np.radians(1.5)
    assert abs(found.roll) < np.radians(1.5)
    gap = found.yaw - header["yaw"]
    # the vehicle is disturbed: what its scatter tells must cover the difference, and is not small
    assert abs(gap) < 3.3 * found.angle_sigma[2]
    assert np.radians(0.5) < found.angle_sigma[2] < np.radians(6.0)
    # one minute is not enough, and that is said
    with pytest.raises(InvalidInput, match="gyros wrong by"):
        coarse_alignment(gyro[:6000], force[:6000], header["latitude"])


def read_ring_laser() -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """Rates and specific force, right, forward, up, and what the header says."""
    lines = RECORDING.read_text(encoding="utf-8").splitlines()
    rows = [line.split() for line in lines if line.strip() and not line.startswith("%")]
    state, place, scale = (np.array(row, dtype=float) for row in rows[:3])
    counts, step = np.array(rows[3:], dtype=float), 1e-3 * place[4]
    header = {
        "pitch": np.radians(state[0]), "roll": np.radians(state[1]), "yaw": -np.radians(state[2]),
        "latitude": np.radians(place[0]), "height": place[2], "step": step,
    }  # fmt: skip
    rate = counts[:, :3] * scale[:3] * np.radians(1.0 / 3600.0) / step
    return rate, counts[:, 3:] * scale[3:] * 1e-6 * place[5] / step, header
