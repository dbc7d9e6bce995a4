"""Recordings of inertial units: files in three forms, units, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from navopt.data.imu_files import read_imu, read_imu_csv, read_sensor_files
from navopt.data.imu_recording import CHANNELS, ImuRecording, check_recording, gap_samples
from navopt.data.imu_units import counts_zero, suspected_accelerometer_unit, suspected_gyro_unit
from navopt.data.psins_files import read_psins_imu
from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import GRAVITY, normal_gravity

DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"


def samples(n=400, seed=1):
    """Rates in rad/s and forces in m/s2 of a unit that is turned a little."""
    rng = np.random.default_rng(seed)
    rate = 1.2 * np.sin(np.linspace(0, 6, n))[:, None] * [1.0, 0.5, -0.7] + 0.01 * rng.standard_normal((n, 3))
    force = np.array([0.1, -0.2, 9.79]) + 0.02 * rng.standard_normal((n, 3))
    return 0.01 * np.arange(n), rate, force


def write_csv(path, time, rate, force, names=None, extra=""):
    names = names or ("time", *CHANNELS)
    rows = [
        ",".join([f"{t!r}", *(repr(float(v)) for v in (*a, *b))])
        for t, a, b in zip(time.tolist(), rate, force, strict=True)
    ]
    path.write_text("\n".join([",".join(names), *rows]) + "\n" + extra, encoding="utf-8")
    return path


def test_csv_in_si_units_comes_back_bit_for_bit(tmp_path):
    time, rate, force = samples()
    path = write_csv(tmp_path / "a.csv", time, rate, force)
    found = read_imu(path, gyro_unit="rad/s", accelerometer_unit="m/s2")
    assert np.array_equal(found.time, time)
    assert np.array_equal(found.gyro, rate)
    assert np.array_equal(found.accelerometer, force)
    assert (found.gyro_unit, found.accelerometer_unit) == ("rad/s", "m/s2")
    assert found.source == "a.csv"
    assert abs(found.interval - 0.01) < 1e-12


@pytest.mark.parametrize(
    ("gyro_unit", "factor"),
    [("deg/s", 180 / np.pi), ("deg/h", 3600 * 180 / np.pi), ("mdeg/s", 180e3 / np.pi)],
)
def test_units_of_the_file_become_si(tmp_path, gyro_unit, factor):
    time, rate, force = samples()
    path = write_csv(tmp_path / "a.csv", time, rate * factor, force / GRAVITY)
    found = read_imu_csv(path, gyro_unit=gyro_unit, accelerometer_unit="g")
    assert np.allclose(found.gyro, rate, rtol=1e-13, atol=0)
    assert np.allclose(found.accelerometer, force, rtol=1e-13, atol=0)


def test_names_of_columns_state_the_units_and_can_be_others(tmp_path):
    time, rate, force = samples()
    ending = [f"{name}_{'deg_s' if name[0] == 'g' else 'm_s2'}" for name in CHANNELS]
    path = write_csv(tmp_path / "a.csv", time, np.degrees(rate), force, ("Time", *ending))
    assert np.allclose(read_imu(path).gyro, rate)
    with pytest.raises(InvalidInput, match="names say deg/s"):
        read_imu(path, gyro_unit="rad/s")
    own = write_csv(tmp_path / "b.csv", 1e3 * time, rate, force, ("ms", *"abcdef"))
    columns = dict(zip(("time", *CHANNELS), ("ms", *"abcdef"), strict=True))
    found = read_imu(own, columns=columns, gyro_unit="rad/s", accelerometer_unit="m/s2", time_unit="ms")
    assert np.allclose(found.time, time)
    with pytest.raises(UnknownName, match="gyro_q"):
        read_imu(own, columns={"gyro_q": "a"}, gyro_unit="rad/s")
    with pytest.raises(UnknownName, match="wx"):
        read_imu(own, columns={"gyro_x": "wx"}, gyro_unit="rad/s")
    with pytest.raises(UnknownName, match="accelerometer_x"):
        read_imu(write_csv(tmp_path / "c.csv", time, rate, force, ("time", *CHANNELS[:3], *"abc")))


def test_the_unit_is_asked_for_and_the_likely_one_named(tmp_path):
    time, rate, force = samples()
    for factor, unit in ((1.0, "rad/s"), (180 / np.pi, "deg/s")):
        path = write_csv(tmp_path / "a.csv", time, rate * factor, force)
        with pytest.raises(InvalidInput, match=f"--gyro-unit {unit}"):
            read_imu(path)
    with pytest.raises(InvalidInput, match="--accelerometer-unit m/s2"):
        read_imu(path, gyro_unit="deg/s")
    with pytest.raises(UnknownName, match="deg/s"):
        read_imu(path, gyro_unit="dps")
    with pytest.raises(InvalidInput, match="--time-unit ms"):
        read_imu(write_csv(tmp_path / "d.csv", 1e3 * time, rate, force), gyro_unit="rad/s")


def test_a_unit_at_rest_is_known_by_the_earth_rate():
    rng = np.random.default_rng(2)
    still = np.array([10.0, 0.5, -11.0]) + 0.5 * rng.standard_normal((500, 3))
    for unit, factor in (("deg/h", 1.0), ("deg/s", 1 / 3600), ("rad/s", np.pi / 180 / 3600)):
        assert suspected_gyro_unit(still * factor)[0] == unit
    counts = np.round(30000 * np.sin(np.linspace(0, 9, 500))[:, None] * [1, 0.3, 0.2])
    assert suspected_gyro_unit(counts)[0] == "counts"
    assert suspected_accelerometer_unit(np.full((50, 3), 1000 / np.sqrt(3)))[0] == "mg"
    assert suspected_accelerometer_unit(np.full((50, 3), 4000.0))[0] == "counts"


def test_zero_of_counts():
    assert counts_zero(np.array([27465.0, 32000, 40115])) == 32768
    assert counts_zero(np.array([1500.0, 2100, 2600])) == 2048
    assert counts_zero(np.array([-200.0, 15000, 16000])) == 0
    assert counts_zero(np.array([3.0, 80, 90])) == 0


def test_two_files_of_counts(tmp_path):
    rng = np.random.default_rng(3)
    time = 0.01 * np.arange(300)
    counts = 32768 + np.round(500 * rng.standard_normal((300, 6)))
    for name, part in (("g.txt", counts[:, :3]), ("a.txt", counts[:, 3:])):
        np.savetxt(tmp_path / name, np.column_stack([time, part]))
    found = read_sensor_files(
        tmp_path / "g.txt",
        tmp_path / "a.txt",
        gyro_unit="counts",
        accelerometer_unit="counts",
        gyro_zero=32000,
    )
    assert np.array_equal(found.gyro, counts[:, :3] - 32000)
    assert np.array_equal(found.accelerometer, counts[:, 3:] - 32768)
    assert found.accelerometer_zero == 32768
    assert any("32768" in note for note in found.notes)
    assert not any("32000" in note for note in found.notes)
    np.savetxt(tmp_path / "late.txt", np.column_stack([time + 0.005, counts[:, 3:]]))
    np.savetxt(tmp_path / "short.txt", np.column_stack([time, counts[:, 3:]])[:-1])
    np.savetxt(tmp_path / "three.txt", counts[:, :3])
    for name, what in (("late.txt", "0.005"), ("short.txt", "299 rows"), ("three.txt", "t x y z")):
        with pytest.raises(InvalidInput, match=what):
            read_sensor_files(
                tmp_path / "g.txt", tmp_path / name, gyro_unit="counts", accelerometer_unit="counts"
            )


def psins(path, increments, scales="0.1 0.1 0.1 125 125 125", site="30.0 110.0 200.0 5.0 10.0 9.780327"):
    rows = "\n".join(" ".join(str(v) for v in row) for row in increments)
    path.write_text(f"% a log\n% more\n\n0 0 0 0 0 0\n{site}\n{scales}\n{rows}\n", encoding="utf-8")
    return path


def test_psins_increments_become_rates_and_forces(tmp_path):
    increments = np.random.default_rng(4).integers(-9, 9, (200, 6)) + np.array([0, 0, 0, 0, 0, 80])
    found = read_psins_imu(psins(tmp_path / "a.imu", increments))
    # one tenth of a second of arc in 10 ms, and 125e-6 g s in 10 ms
    assert np.allclose(found.gyro, increments[:, :3] * 0.1 / 206264.80624709636 / 0.01, rtol=1e-12)
    assert np.allclose(found.accelerometer, increments[:, 3:] * 125e-6 * 9.780327 / 0.01, rtol=1e-12)
    assert found.time[0] == pytest.approx(5.01)
    assert np.degrees(found.latitude) == pytest.approx(30.0)
    assert found.gravity == pytest.approx(float(normal_gravity(np.radians(30.0))) - 0.0006172)
    assert np.array_equal(read_imu(tmp_path / "a.imu").gyro, found.gyro)
    with pytest.raises(InvalidInput, match="three header rows"):
        read_psins_imu(psins(tmp_path / "b.imu", increments, scales="0.1 0.1"))
    with pytest.raises(InvalidInput, match="line 8"):
        read_psins_imu(psins(tmp_path / "c.imu", [[1] * 6, ["x"] * 6]))


def test_files_that_cannot_be_read(tmp_path):
    time, rate, force = samples()
    good = write_csv(tmp_path / "a.csv", time, rate, force)
    units = {"gyro_unit": "rad/s", "accelerometer_unit": "m/s2"}
    with pytest.raises(InvalidInput, match="existing file"):
        read_imu(tmp_path / "none.csv", **units)
    with pytest.raises(InvalidInput, match="--gyro and --accelerometer together"):
        read_imu(good, gyro=good, **units)
    with pytest.raises(InvalidInput, match="no file"):
        read_imu(**units)
    with pytest.raises(UnknownName, match="sensors"):
        read_imu(good, form="xsens", **units)
    (tmp_path / "empty.csv").write_text("", encoding="utf-8")
    with pytest.raises(InvalidInput, match="empty"):
        read_imu(tmp_path / "empty.csv", **units)
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01" * 50)
    with pytest.raises(InvalidInput, match="text"):
        read_imu(tmp_path / "binary.csv", **units)
    words = write_csv(tmp_path / "w.csv", time, rate, force, extra="4.0,1,2,x,4,5,6\n")
    with pytest.raises(InvalidInput, match="'x' in line 402"):
        read_imu(words, **units)
    gap = write_csv(tmp_path / "n.csv", time, rate, force, extra="4.0,1,2,,4,5,6\n")
    with pytest.raises(InvalidInput, match="empty cell in line 402"):
        read_imu(gap, **units)


def recording(**changes):
    time, rate, force = samples(4000)
    values = {"time": time, "gyro": rate, "accelerometer": force} | changes
    return ImuRecording(**values)


def test_samples_that_no_recording_has():
    time, rate, _ = samples(4000)
    bad = rate.copy()
    bad[17, 1] = np.nan
    with pytest.raises(InvalidInput, match=r"gyro_y.*sample 17"):
        recording(gyro=bad)
    back = time.copy()
    back[100] = back[98]
    with pytest.raises(InvalidInput, match="sample 100"):
        recording(time=back)
    with pytest.raises(InvalidInput, match="one row per time"):
        recording(gyro=rate[:-1])
    with pytest.raises(InvalidInput, match="rad/s"):
        recording(gyro_unit="deg/s")
    assert check_recording(recording()) == []


def test_stuck_and_saturated_channels_and_gaps():
    _, rate, force = samples(4000)
    dead = force.copy()
    dead[:, 2] = 9.8
    with pytest.raises(InvalidInput, match=r"accelerometer_z.*at all samples"):
        check_recording(recording(accelerometer=dead))
    held = force.copy()
    held[1000:1600, 0] = held[1000, 0]
    with pytest.raises(InvalidInput, match=r"accelerometer_x.*6.0 s from 10.0 s on"):
        check_recording(recording(accelerometer=held))
    with pytest.raises(InvalidInput, match=r"gyro_x.*limit 1\b.*saturated"):
        check_recording(recording(gyro=np.clip(rate, None, [1.0, 9.0, 9.0])))
    with pytest.raises(InvalidInput, match=r"gyro_z.*limit -0.5"):
        check_recording(recording(gyro=np.clip(rate, [-9, -9, -0.5], None)))
    time = 0.01 * np.arange(4000)
    time[2000:] += 3.0
    assert gap_samples(time).tolist() == [1999]
    assert "3.0 s" in check_recording(recording(time=time))[0]
    # coarse rounding is neither stuck nor saturated
    assert check_recording(recording(accelerometer=np.round(force, 1), gyro=np.round(rate, 2))) == []


def test_part_of_a_recording():
    part = recording().between(10.0, 20.0)
    assert (part.time[0], part.time[-1]) == (10.0, 20.0)
    assert len(part) == 1001
    with pytest.raises(InvalidInput, match=r"0 to 39\.99 s"):
        recording().between(50.0)


@pytest.mark.skipif(not (DATA / "lasergyro.imu").is_file(), reason="recorded data not at ../shared/data")
def test_recorded_files():
    laser = read_imu(DATA / "lasergyro.imu")
    assert len(laser) == 184718
    assert check_recording(laser) == []
    assert np.degrees(np.linalg.norm(laser.gyro.mean(axis=0))) * 3600 == pytest.approx(14.85, abs=0.01)
    xsens = read_imu(
        gyro=DATA / "xsens_gyro.mat", accelerometer=DATA / "xsens_acc.mat", gyro_unit="counts",
        accelerometer_unit="counts",
    )  # fmt: skip
    assert len(xsens) == 51175
    assert (xsens.gyro_zero, xsens.accelerometer_zero) == (32768, 32768)
    assert check_recording(xsens) == []
