"""Worlds of heading-aided alignment: truth, noise as declared, disturbances, coarse start, and recordings."""

from __future__ import annotations

import numpy as np
import pytest

from navopt.errors import InvalidInput, UnknownName
from navopt.models.alignment_sensors import ImuGrade
from navopt.models.azimuth_error import advance, heading_measurement, heading_slope
from navopt.models.enu_attitude import attitude_angles, attitude_enu
from navopt.models.heading_alignment import HeadingScenario, simulate_heading_record
from navopt.models.heading_record import readings_on_clock, record_from_imu
from navopt.models.heading_start import (
    alignment_process_noise,
    heading_alignment_start,
    heading_start_covariance,
    mean_heading,
    with_heading_state,
)
from navopt.models.static_alignment import StaticSite
from navopt.models.vibration import Vibration

SHORT = {"duration_s": 20.0}


def quiet(**changes: object) -> HeadingScenario:
    """A world without random noise to speak of."""
    return HeadingScenario(
        **{**SHORT, "gyro_noise_dps": 1e-9, "accel_noise_mg": 1e-9, "velocity_sigma": 1e-9,
           "heading_sigma_deg": 1e-9, **changes}
    )  # fmt: skip


# -- truth -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "changes",
    [{}, {"heading_deg": 170.0, "pitch_deg": 10.0, "angles_deg": (2.0, -3.0, 179.0), "accel_bias_mg": 1e-9}],
)
def test_true_states_obey_the_model(changes: dict[str, object]) -> None:
    record = simulate_heading_record(quiet(**changes), 3)
    x = record.states[0]
    for c in record.constants:
        x = advance(x, record.step, c, True)
    np.testing.assert_allclose(x[:2], record.states[-1, :2], atol=1e-5)
    np.testing.assert_allclose(x[2:6], record.states[-1, 2:6], atol=1e-7)
    last = heading_measurement(record.states[-1], record.measured_constants[-1])
    assert abs(last - record.states[-1, 5]) < 1e-12
    np.testing.assert_allclose(
        np.degrees(record.states[0, 2:5]), changes.get("angles_deg", (1.0, 1.0, 15.0)), atol=1e-9
    )


def test_noise_is_as_declared() -> None:
    record = simulate_heading_record(HeadingScenario(duration_s=300.0), 1)
    z, x = record.measurements("all"), record.states
    assert np.isfinite(z[:, 2]).sum() == 3000
    assert np.isfinite(record.measurements()[:, 0]).sum() == 3000
    assert np.isnan(z[0]).all()
    for gap, sigma in ((z[1:, 0] - x[1:, 0], 0.1), (z[:, 2] - x[:, 5], np.radians(0.028))):
        gap = gap[np.isfinite(gap)] / sigma
        # mean and variance of normal numbers, 1 in 4000 each
        assert abs(gap.mean()) < 3.7 / np.sqrt(len(gap))
        assert abs(gap.var() - 1.0) < 3.7 * np.sqrt(2.0 / len(gap))
    # what the model leaves of each step is the noise of the sensors
    steps = np.array(
        [advance(a, record.step, c, True) for a, c in zip(x[:-1], record.constants, strict=True)]
    )
    left = (x[1:] - steps)[:, 2:6]
    Q = record.process_covariance(with_heading=True)
    np.testing.assert_allclose(left[:, :3].std(axis=0), np.sqrt(np.diag(Q)[2:5]), rtol=0.02)
    # and the heading error's is that of the azimuth
    assert np.corrcoef(left[:, 2], left[:, 3])[0, 1] > 0.99
    grade = record.grade
    assert abs(np.degrees(grade.gyro_noise) * 60.0 - 0.3) < 1e-12


def test_measured_headings_wrap() -> None:
    record = simulate_heading_record(quiet(heading_deg=179.99, angles_deg=(0.0, 0.0, 5.0)), 2)
    z = record.measurements()[:, 2]
    seen = np.isfinite(z)
    np.testing.assert_allclose(z[seen], record.states[seen, 5], atol=1e-9)
    noisy = simulate_heading_record(HeadingScenario(**SHORT, heading_deg=180.0), 2)
    assert noisy.heading[np.isfinite(noisy.heading)].min() < -3.0
    assert noisy.heading[np.isfinite(noisy.heading)].max() > 3.0
    gap = noisy.measurements()[:, 2] - noisy.states[:, 5]
    assert np.nanmax(np.abs(gap)) < np.radians(0.2)


def test_worlds_repeat_and_redraw_only_noise() -> None:
    scenario = HeadingScenario(**SHORT)
    a, b, other, twin = (
        simulate_heading_record(scenario, s, d) for s, d in ((5, None), (5, None), (6, None), (5, 1))
    )
    np.testing.assert_array_equal(a.velocity, b.velocity)
    assert not np.array_equal(a.states[0], other.states[0])
    np.testing.assert_array_equal(a.states[0], twin.states[0])
    assert not np.array_equal(a.velocity, twin.velocity)
    fixed = simulate_heading_record(HeadingScenario(**SHORT, biases="published"), 5)
    np.testing.assert_allclose(np.degrees(fixed.states[0, -3:]), 0.01)


# -- disturbances ------------------------------------------------------------------------------------------
def test_disturbances_do_what_they_say() -> None:
    base = {"duration_s": 60.0, "angles_deg": (0.0, 0.0, 0.0)}

    def gap(**changes: object) -> np.ndarray:
        r = simulate_heading_record(HeadingScenario(**base, **changes), 8)
        return np.degrees(r.measurements()[:, 2] - r.states[:, 5])[10::10]

    plain = gap()
    np.testing.assert_allclose(gap(heading_noise_factor=3.0), 3.0 * plain, atol=1e-9)
    np.testing.assert_allclose(gap(heading_bias_deg=0.05), plain - 0.05, atol=1e-9)
    dark = gap(outages=((20.0, 30.0),))
    assert np.isnan(dark).sum() == 100
    np.testing.assert_allclose(dark[~np.isnan(dark)], plain[~np.isnan(dark)], atol=1e-12)
    wild = np.abs(gap(outlier_rate=0.1) - plain) > 1e-9
    assert 0.05 < wild.mean() < 0.16
    loud = gap(bursts=(20.0, 5.0, 10.0)) / plain
    assert set(np.round(loud, 6)) == {1.0, 10.0}
    assert abs((loud > 5.0).mean() - 0.25) < 0.01


def test_shaking_machine() -> None:
    site, rng = StaticSite(latitude=0.7), np.random.default_rng(0)
    shaking, resting = Vibration.drawn(rng, 1.0), attitude_enu(0.05, 0.1, 0.4)
    edges = 0.01 * np.arange(301)
    gyro, force = shaking.readings(resting, site, edges)
    fine = np.linspace(0.0, 3.0, 300_001)
    rate = np.gradient(shaking.angle(fine), fine)
    middle = rate[:-1].reshape(300, 1000).mean(axis=1)
    axis = np.array([0.9, 0.4, 0.17]) / np.linalg.norm([0.9, 0.4, 0.17])
    earth = np.array([0.0, site.rate_north, site.rate_up]) @ resting
    np.testing.assert_allclose((gyro - earth) @ axis, middle, atol=2e-5)
    # brought back to the true axes, the force is gravity and the change of the velocity
    pulled = np.einsum("kij,kj->ki", shaking.attitude(resting, edges[:-1] + 0.005), force)
    change = np.diff(shaking.velocity(edges), axis=0) / 0.01
    np.testing.assert_allclose(pulled[:, :2], change, atol=2e-4)
    assert change.std() > 0.1
    record = simulate_heading_record(HeadingScenario(setting="onboard", duration_s=30.0), 4)
    calm = simulate_heading_record(HeadingScenario(setting="onboard", duration_s=30.0, vibration=0.0), 4)
    # the integrated run of a shaking machine ends where that of a still one does
    np.testing.assert_allclose(record.states[-1, 2:5], calm.states[-1, 2:5], atol=np.radians(0.05))


# -- coarse start --------------------------------------------------------------------------------------------
def test_budget_of_the_coarse_start_is_the_spread_of_drawn_starts() -> None:
    scenario = HeadingScenario(
        duration_s=2.0, start="coarse", coarse_s=2.0, pitch_deg=20.0, roll_deg=-10.0, heading_deg=50.0,
        accel_noise_mg=20.0, heading_sigma_deg=0.5,
    )  # fmt: skip
    records = [simulate_heading_record(scenario, seed) for seed in range(400)]
    starts = np.array([r.states[0, 2:5] for r in records])
    declared = records[0].P0[2:5, 2:5]
    whitened = np.linalg.solve(np.linalg.cholesky(declared), starts.T)
    # chi-square of 3 x 400 numbers: 1 in 1000
    assert abs((whitened**2).mean() - 1.0) < 3.3 * np.sqrt(2.0 / 1200)
    # a tilt is correlated with the bias that made it
    biases = np.array([r.states[0, 6:8] for r in records])
    got = np.corrcoef(starts[:, 1], biases[:, 0])[0, 1]
    P = records[0].P0
    assert abs(got - P[3, 5] / np.sqrt(P[3, 3] * P[5, 5])) < 0.1


def test_coarse_start_of_exact_readings_is_exact() -> None:
    site, true = StaticSite(latitude=0.6), attitude_enu(0.1, -0.2, 3.1)
    w = np.tile(np.array([0.0, site.rate_north, site.rate_up]) @ true, (50, 1))
    f = np.tile(np.array([0.0, 0.0, site.g]) @ true, (50, 1))
    # around half a turn
    found = heading_alignment_start(w, f, [3.1 + 0.1, 3.1 - 0.1, np.nan, 3.1 - 2.0 * np.pi], site)
    np.testing.assert_allclose(found.attitude, true, atol=1e-9)
    assert found.method == "levelled"
    with pytest.raises(InvalidInput, match="one heading or more"):
        mean_heading([np.nan])
    with pytest.raises(InvalidInput, match="agree"):
        mean_heading([0.0, np.pi])
    with pytest.raises(InvalidInput, match="degrees"):
        mean_heading([15.0])


def test_heading_state_is_a_function_of_the_angles() -> None:
    record = simulate_heading_record(HeadingScenario(**SHORT, pitch_deg=12.0, heading_deg=40.0), 1)
    c = record.measured_constants[0]
    slope = heading_slope(np.zeros(3), c)
    mean, P = with_heading_state(record.x0, record.P0, c)
    assert abs(P[5, 4] - slope @ record.P0[2:5, 4]) < 1e-18
    assert abs(P[5, 5] - slope @ record.P0[2:5, 2:5] @ slope) < 1e-15
    assert np.linalg.matrix_rank(P, tol=1e-14) == 10
    assert mean[5] == heading_measurement(record.x0, c)
    loose = with_heading_state(record.x0, record.P0, c, correlated=False, extra=1e-6)[1]
    assert (loose[5, :5] == 0.0).all()
    assert abs(loose[5, 5] - P[5, 5] - 1e-6) < 1e-15
    Q = alignment_process_noise(record.site, record.grade, 0.01, record.attitude[0], with_heading=True)
    assert abs(Q[5, 4] - slope @ Q[2:5, 4]) < 1e-6 * Q[4, 4]
    with pytest.raises(InvalidInput, match="ten states"):
        with_heading_state(np.zeros(11), np.eye(11), c)
    with pytest.raises(InvalidInput, match="variance"):
        with_heading_state(record.x0, record.P0, c, extra=-1.0)


# -- recordings ------------------------------------------------------------------------------------------
def recording(seconds: float = 30.0, **changes: object) -> dict[str, object]:
    grade = ImuGrade.low_cost()
    site, true, rng = StaticSite(latitude=0.68), attitude_enu(0.02, 0.01, -3.1), np.random.default_rng(3)
    count = round(seconds / 0.01)
    root = 10.0
    time = 0.01 * np.arange(1, count + 1)
    data: dict[str, object] = {
        "time": time,
        "gyro": np.array([0.0, site.rate_north, site.rate_up]) @ true
        + grade.gyro_noise * root * rng.standard_normal((count, 3)),
        "accelerometer": np.array([0.0, 0.0, site.g]) @ true
        + grade.accelerometer_noise * root * rng.standard_normal((count, 3)),
        "heading_time": np.arange(0.1, seconds, 0.1),
        "site": site,
        "grade": grade,
        "heading_sigma": np.radians(0.03),
    }
    data["heading"] = -3.1 + np.radians(0.03) * rng.standard_normal(len(data["heading_time"]))  # type: ignore[arg-type]
    return {**data, **changes}


def test_recording() -> None:
    record = record_from_imu(**recording())  # type: ignore[arg-type]
    assert record.states is None
    assert record.clock == 10
    assert abs(record.time[0] - 10.0) < 1e-9
    # readings on their own clock at the nearest step
    seen = np.flatnonzero(np.isfinite(record.heading))
    assert len(seen) == 199 or len(seen) == 200
    assert (np.diff(seen) == 10).all()
    assert abs(np.degrees(attitude_angles(record.attitude[0])[2] + 3.1)) < 0.05
    thin = record_from_imu(**recording(every=10))  # type: ignore[arg-type]
    assert thin.clock == 1
    np.testing.assert_array_equal(thin.velocity, record.velocity[::10])
    given = record_from_imu(**recording(attitude=np.eye(3), prior_sigma=[0.1, 0.1, 0.5], coarse_s=0.0))  # type: ignore[arg-type]
    np.testing.assert_array_equal(given.attitude[0], np.eye(3))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"heading": np.full(299, 15.0)}, "degrees"),
        ({"every": 50}, "the filter predicts every 0.5 s"),
        ({"time": np.r_[0.01 * np.arange(1, 3000), 0.02]}, "times that rise"),
        ({"time": np.r_[0.01 * np.arange(1, 3000), 31.0]}, "sample evenly"),
        ({"heading_time": np.arange(29.9, 0.0, -0.1)}, "times that rise"),
        ({"heading_time": np.arange(0.1, 20.0, 0.1)}, "time for each heading"),
        ({"heading_sigma": 0.0}, "heading_sigma"),
        ({"velocity_sigma": -0.1}, "velocity_sigma"),
        ({"heading_bias_sigma": -0.1}, "heading_bias_sigma"),
        ({"coarse_s": 40.0}, "coarse_s"),
        ({"heading_time": np.arange(15.1, 45.0, 0.1)}, "lengthen coarse_s"),
        ({"attitude": np.eye(3)}, "prior_sigma"),
        ({"gyro": np.zeros((10, 3))}, "shape"),
        ({"accelerometer": np.full((3000, 3), 1.0)}, "at rest"),
    ],
)
def test_bad_recordings(changes: dict[str, object], word: str) -> None:
    with pytest.raises(InvalidInput, match=word):
        record_from_imu(**recording(**changes))  # type: ignore[arg-type]


def test_readings_outside_the_run_are_left_out() -> None:
    grid = 1.0 + 0.1 * np.arange(11)
    heading, clock = readings_on_clock([0.2, 1.2, 1.7, 2.2], [0.1, 0.2, np.nan, 0.4], grid)
    assert clock == 5
    assert np.flatnonzero(np.isfinite(heading)).tolist() == [2]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"heading_rate_hz": 200.0}, "at most rate_hz"),
        ({"rate_hz": 200.0}, "at most imu_rate_hz"),
        ({"heading_rate_hz": 30.0}, "whole part"),
        ({"heading_sigma_deg": 0.0}, "above zero"),
        ({"velocity_sigma": -1.0}, "above zero"),
        ({"imu_noise_factor": -1.0}, "zero or more"),
        ({"outlier_rate": 2.0}, "from 0 to 1"),
        ({"bursts": (1.0, 2.0, 3.0)}, "period"),
        ({"outages": ((5.0, 2.0),)}, "pairs"),
        ({"angles_deg": (1.0, 1.0, 200.0)}, "within 180"),
        ({"angles_deg": (1.0, 1.0)}, "three angles"),
        ({"prior_deg": (1.0, 0.0, 1.0)}, "above zero"),
        ({"pitch_deg": 80.0}, "60 degrees"),
        ({"duration_s": 0.5}, "ten headings"),
        ({"latitude_deg": 95.0}, "latitude"),
        ({"setting": "cave"}, "setting"),
        ({"start": "cold"}, "start"),
    ],
)
def test_bad_scenarios(changes: dict[str, object], word: str) -> None:
    with pytest.raises(InvalidInput, match=word):
        HeadingScenario(**changes)
    with pytest.raises(UnknownName):
        simulate_heading_record(HeadingScenario(**SHORT), 0).measurements("never")


def test_start_covariance_adds_what_a_tilt_does_to_the_heading() -> None:
    site, true = StaticSite(latitude=0.6), attitude_enu(0.5, 0.0, 0.0)
    grade = ImuGrade.low_cost()
    P = heading_start_covariance(site, true, grade, duration=10.0, heading_sigma=1e-3, velocity_sigma=0.1)
    expected = 1e-6 + np.tan(0.5) ** 2 * P[3, 3]
    assert abs(P[4, 4] / expected - 1.0) < 1e-12
