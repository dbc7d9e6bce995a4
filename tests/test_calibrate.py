"""`navopt calibrate`: a recording from file to parameters that can be judged, and what is refused."""

from __future__ import annotations

import csv
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from comparisons import calibrate_recording, cli
from comparisons.calibrate import compare_one_position
from comparisons.calibrate_figures import pose_picture, residual_picture, static_picture
from comparisons.calibrate_output import FILES, calibration_summary, summary_lines
from comparisons.calibrate_report import decimals, parameter_rows
from comparisons.drawing import render
from navopt.data.imu_files import read_imu
from navopt.data.imu_recording import CHANNELS
from navopt.errors import InvalidInput, UnknownName
from navopt.models.pose_recording import simulate_recording
from navopt.models.triad import PARAMETER_NAMES, AccelerometerTriad, GyroTriad

DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
recorded = pytest.mark.skipif(
    not (DATA / "xsens_acc.mat").is_file(), reason="recorded data not at ../shared/data"
)
UNITS = ("--gyro-unit", "counts", "--accelerometer-unit", "counts")
GYRO = GyroTriad(
    [4780, 4760, 4900], [[1, -0.01, 0.01], [0.003, 1, 0.02], [-0.02, 0.01, 1]], [0.01, -0.02, 0.005]
)
FORCE = AccelerometerTriad([415, 413, 402], [[1, 0, 0], [0.004, 1, 0], [0.01, 0.02, 1]], [0.9, -0.5, 0.2])


@pytest.fixture(autouse=True)
def _threads(monkeypatch):
    """The command limits threads for its own process; here that process is the tests'."""
    monkeypatch.setattr(os, "environ", os.environ.copy())


def simulated(seed=1, **options):
    settings = {
        "gyro": GYRO, "accelerometer": FORCE, "gyro_noise": 20.0, "accelerometer_noise": 3.0, "rate_hz": 50.0,
        "gravity": 9.81, "poses": 20, "pose_s": 4.0,
    }  # fmt: skip
    return simulate_recording(seed, **(settings | options))


@pytest.fixture(scope="module")
def world():
    return simulated()


@pytest.fixture(scope="module")
def calibration(world):
    return calibrate_recording(world.recording, gravity=9.81)


def write_csv(path, recording, factors=(1.0, 1.0)):
    table = [recording.time, *(factors[0] * recording.gyro).T, *(factors[1] * recording.accelerometer).T]
    np.savetxt(
        path,
        np.column_stack(table),
        delimiter=",",
        header=",".join(("time", *CHANNELS)),
        comments="",
        fmt="%.12g",
    )
    return path


@pytest.fixture(scope="module")
def file(world, tmp_path_factory):
    return write_csv(tmp_path_factory.mktemp("recording") / "unit.csv", world.recording)


def invoke(*arguments, code=0):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in ("calibrate", *arguments)])
    assert result.exit_code == code, (result.output, result.exception)
    return result


def refused(folder, *arguments):
    """Message of a command that must be refused: one message, exit code 2, nothing written."""
    out = folder / "refused"
    result = invoke(*arguments, "--out", out, code=2)
    assert result.stdout == ""
    assert result.stderr.startswith("navopt: error: ")
    assert result.stderr.count("\n") == 1
    assert not out.exists()
    return result.stderr


def test_parameters_come_back_within_their_sigmas(calibration):
    for fit, true in ((calibration.accelerometer, FORCE), (calibration.gyro, GYRO)):
        truth = dict(zip(PARAMETER_NAMES, true.vector, strict=True))
        worst = max(abs(fit.values[n] - truth[n]) / fit.sigma[n] for n in fit.names)
        # the largest of 21 normal numbers, 0.001
        assert worst < 4.1
        assert np.sqrt(np.mean(fit.after**2)) < 0.05 * np.sqrt(np.mean(fit.before**2))
    assert len(calibration.averages) == 20
    assert not [note for note in calibration.notes if "few poses" not in note]


def test_calibrated_samples_are_the_true_ones(world, calibration):
    force = calibration.specific_force(world.recording.accelerometer)
    assert np.allclose(force, FORCE.inverse(world.recording.accelerometer), atol=0.02)
    rate = calibration.rate(world.recording.gyro, force)
    assert np.allclose(rate, GYRO.inverse(world.recording.gyro), atol=0.01)


def test_command_writes_everything(file, tmp_path, calibration):
    out = tmp_path / "result"
    result = invoke("--imu", file, *UNITS, "--gravity", 9.81, "--out", out)
    assert result.stdout.splitlines()[-1] == str(out)
    assert "20 static poses (20 at half the threshold, 20 at twice)" in result.stdout
    assert {path.name for path in out.iterdir()} == set(FILES)
    for name in FILES:
        content = (out / name).read_bytes()
        assert len(content) > 500
        assert content.startswith(b"\x89PNG") == name.endswith(".png")
    document = json.loads((out / "calibration.json").read_text())
    assert document["files"]["imu"]["name"] == "unit.csv"
    assert document["detector"]["poses_used"] == 20
    for sensor, fit in (("accelerometer", calibration.accelerometer), ("gyro", calibration.gyro)):
        part = document[sensor]
        for name in PARAMETER_NAMES:
            assert part["parameters"][name]["value"] == pytest.approx(fit.values[name], rel=1e-6, abs=1e-6)
            assert part["parameters"][name]["estimated"] == (name in fit.names)
        # what the docs say about matrix and offset
        sample = np.array([100.0, -2000.0, 300.0])
        assert np.allclose(
            np.array(part["matrix"]) @ (sample - part["zero"] - part["offset"]),
            fit.triad.inverse(sample),
            atol=1e-4,
        )
    rows = list(csv.DictReader((out / "poses.csv").open()))
    assert len(rows) == 20
    norm = np.linalg.norm([[float(row[f"force_{k}_m_s2"]) for k in "xyz"] for row in rows], axis=1)
    assert np.allclose(norm, 9.81, atol=0.01)
    assert np.allclose(norm - 9.81, [float(row["residual_m_s2"]) for row in rows], atol=2e-4)
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 3
    assert "misalignment_zy" in page
    # the same result gives the same bytes
    assert render(pose_picture(calibration), format="png") == render(pose_picture(calibration), format="png")


def test_physical_units_and_zero_of_counts(world, calibration, tmp_path):
    """The same samples in deg/s and g, and as counts without sign, give the same sensors."""
    recording = world.recording
    path = write_csv(tmp_path / "a.csv", recording, (np.degrees(1.0) / 4800, 1 / 410 / 9.80665))
    found = calibrate_recording(read_imu(path, gyro_unit="deg/s", accelerometer_unit="g"), gravity=9.81)
    assert np.allclose(found.gyro.triad.scale * 4800, calibration.gyro.triad.scale, rtol=1e-5)
    assert np.allclose(
        found.accelerometer.triad.scale * 410, calibration.accelerometer.triad.scale, rtol=1e-6
    )
    assert np.allclose(found.gyro.triad.misalignment, calibration.gyro.triad.misalignment, atol=1e-5)
    shifted = replace(recording, gyro=recording.gyro + 32768, accelerometer=recording.accelerometer + 32768)
    unsigned = read_imu(
        write_csv(tmp_path / "b.csv", shifted), gyro_unit="counts", accelerometer_unit="counts"
    )
    again = calibrate_recording(unsigned, gravity=9.81)
    assert np.allclose(again.gyro.triad.vector, calibration.gyro.triad.vector, rtol=1e-6, atol=1e-7)
    assert calibration_summary(again)["gyro"]["zero"] == 32768


def test_a_wrong_unit_is_found_out(world, tmp_path):
    path = write_csv(tmp_path / "a.csv", world.recording, (1 / 4800, 1 / 410))
    message = refused(
        tmp_path, "--imu", path, "--gyro-unit", "deg/s", "--accelerometer-unit", "m/s2", "--gravity", 9.81
    )
    assert "--gyro-unit" in message
    assert "rad/s and not deg/s" in message
    assert "--gyro-unit rad/s" in refused(tmp_path, "--imu", path, "--gravity", 9.81)
    assert "m/s2 and not g" in refused(
        tmp_path, "--imu", path, "--gyro-unit", "rad/s", "--accelerometer-unit", "g", "--gravity", 9.81
    )


def test_bad_recordings_are_refused_with_a_remedy(world, file, tmp_path):
    recording = world.recording
    plain = ("--imu", file, *UNITS)
    assert "--latitude" in refused(tmp_path, *plain)
    assert "between 9.7 and 9.9" in refused(tmp_path, *plain, "--gravity", 981)
    assert "-90 to 90" in refused(tmp_path, *plain, "--latitude", 100)
    given = (*plain, "--gravity", 9.81)
    assert "6 static poses for 9" in refused(tmp_path, *given, "--until", 50)
    assert "--one-position" in refused(tmp_path, *given, "--until", 19)
    assert "moved there" in refused(tmp_path, *given, "--initial-static", 40)
    assert "Earth rate" in refused(tmp_path, *given, "--gyro-method", "earth-rate")
    assert "rotation" in refused(tmp_path, *given, "--gyro-method", "rotations")
    assert "frame" in refused(tmp_path, *given, "--accelerometer-parameters", "all")
    assert "existing file" in refused(tmp_path, "--imu", tmp_path / "none.csv", *UNITS)
    held = recording.gyro.copy()
    held[3000:3300, 1] = held[3000, 1]
    path = write_csv(tmp_path / "stuck.csv", replace(recording, gyro=held))
    assert "gyro_y" in refused(tmp_path, "--imu", path, *UNITS, "--gravity", 9.81)
    clipped = replace(recording, gyro=np.clip(recording.gyro, -4000, 4000))
    path = write_csv(tmp_path / "clipped.csv", clipped)
    assert "saturated" in refused(tmp_path, "--imu", path, *UNITS, "--gravity", 9.81)
    turned = replace(recording, gyro=recording.gyro[:, [1, 2, 0]])
    with pytest.raises(InvalidInput, match="axes are not those"):
        calibrate_recording(turned, gravity=9.81)
    assert "folder" in invoke(*given, "--out", file, code=2).stderr
    assert "--out" in invoke(*given, code=2).stderr


def test_few_turns_leave_the_gyros_alone():
    """Nine poses with gaps between most of them: the accelerometers only."""
    world = simulated(4, poses=12)
    time = world.recording.time.copy()
    for stop in world.stops[:-1]:
        time[stop + 40 :] += 5.0
    found = calibrate_recording(replace(world.recording, time=time), gravity=9.81)
    assert found.gyro is None
    assert any("gyros are not calibrated" in note for note in found.notes)
    assert any("gaps" in note for note in found.notes)
    assert "gyros: not calibrated" in summary_lines(found)
    assert calibration_summary(found)["gyro"] is None
    with pytest.raises(InvalidInput, match="no calibration of the gyros"):
        found.rate(np.zeros(3))
    assert calibrate_recording(world.recording, gravity=9.81, gyro="none").gyro is None
    with pytest.raises(UnknownName):
        calibrate_recording(world.recording, gravity=9.81, gyro="maybe")


def test_a_good_unit_is_calibrated_by_the_earth_rate():
    gyro = GyroTriad(
        [1.003, 0.998, 1.001], np.eye(3) + 1e-2 * np.triu(np.ones((3, 3)), 1), [2e-6, -1e-6, 1e-6]
    )
    force = AccelerometerTriad([1.002, 0.999, 1.003], np.eye(3), [1e-2, -2e-2, 1e-2])
    world = simulate_recording(
        3, gyro=gyro, accelerometer=force, poses=24, initial_s=60, pose_s=60, turn_s=5, rate_hz=10,
        gyro_noise=5e-6, accelerometer_noise=1e-3, latitude=np.radians(45.0), counts=False, gravity=9.81,
    )  # fmt: skip
    found = calibrate_recording(world.recording, gravity=9.81)
    assert "Earth rate" in found.gyro.method
    assert found.gyro.names == PARAMETER_NAMES
    error = (found.gyro.triad.vector - gyro.vector) / np.array(list(found.gyro.sigma.values()))
    assert np.abs(error).max() < 4.2
    assert found.gyro.excess < 1.6
    assert "deg/h before" in summary_lines(found)[3]
    residual_picture(found)
    norm = calibrate_recording(replace(world.recording, latitude=None), gravity=9.81)
    assert len(norm.gyro.names) == 9
    assert any("rotation of the gyros' axes" in note for note in norm.notes)
    single = world.recording.between(0.0, 59.0)
    told = compare_one_position(single)
    assert told.joint_rank == 3
    with pytest.raises(InvalidInput, match="--latitude"):
        compare_one_position(replace(single, latitude=None))
    with pytest.raises(InvalidInput, match="count"):
        compare_one_position(replace(single, gyro_unit="counts"))


def test_nothing_is_left_behind_where_the_folder_cannot_be_written(calibration, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("comparisons.drawing.render", lambda *_, **__: b"picture")
    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(InvalidInput, match="No space left"):
        calibration.write(tmp_path / "new" / "folder")
    assert not list((tmp_path).rglob("*.png"))
    assert not list((tmp_path).rglob(".calibrate-*"))


def test_sigmas_are_shown_with_two_digits(calibration):
    assert [decimals(s) for s in (0.0123, 1.5, 45.0, 0.0)] == [3, 1, 0, 6]
    rows = parameter_rows(calibration.accelerometer, "accelerometer", "counts")
    assert [row[0].split(" ")[0] for row in rows] == list(PARAMETER_NAMES)
    fixed = [row[0].split(" ")[0] for row in rows if row[2] == "fixed"]
    assert fixed == ["misalignment_xy", "misalignment_xz", "misalignment_yz"]


@recorded
def test_xsens_recording():
    """Against the manufacturer's certificate, as quoted in the scripts published by Tedaldi et al. (2014)."""
    recording = read_imu(
        gyro=DATA / "xsens_gyro.mat", accelerometer=DATA / "xsens_acc.mat", gyro_unit="counts",
        accelerometer_unit="counts",
    )  # fmt: skip
    found = calibrate_recording(recording, gravity=9.81744, initial_static_s=50.0)
    assert 36 <= len(found.averages) <= 38
    assert found.poses.half_threshold == found.poses.double_threshold
    # found without being told, too
    assert len(calibrate_recording(recording, gravity=9.81744, gyro="none").averages) == len(found.averages)
    force, gyro = found.accelerometer, found.gyro
    # whole counts there; a scale factor of a MEMS gyro may have moved by 0.2 %
    assert np.allclose(force.triad.scale, [415, 413, 415], atol=1.0)
    assert np.allclose(gyro.triad.scale, [4778, 4758, 4766], rtol=2e-3)
    zero = recording.accelerometer_zero + force.triad.scale * force.triad.bias
    assert np.allclose(zero, [33123, 33276, 32360], atol=6.0)
    # sums of opposite misalignments do not depend on the axes; the certificate has two decimals
    e, certified = force.triad.misalignment, np.array([[1, 0, -0.01], [0.01, 1, 0.01], [0.02, 0.01, 1]])
    assert np.allclose(e + e.T, certified + certified.T, atol=0.0101)
    # the start value of 6258 counts per rad/s is far off
    assert np.all(np.abs(gyro.triad.scale - 6258) > 1000)
    assert np.sqrt(np.mean(force.before**2)) > 0.5
    assert np.sqrt(np.mean(force.after**2)) < 0.0012
    assert np.degrees(np.sqrt(2 * np.mean(gyro.after**2))) < 0.16
    assert found.gyro_bias.force_dependent
    plain = calibrate_recording(recording, gravity=9.81744, initial_static_s=50.0, force_dependent=False)
    assert np.degrees(np.sqrt(2 * np.mean(plain.gyro.after**2))) > 0.4
    static_picture(found)


@recorded
def test_ring_laser_recording_tells_three_things():
    result = invoke("--imu", DATA / "lasergyro.imu", "--one-position")
    assert "3 of all 24" in result.stdout
    told = compare_one_position(read_imu(DATA / "lasergyro.imu"))
    hour = np.degrees(1.0) * 3600
    assert told.rate_norm * hour == pytest.approx(14.85, abs=0.01)
    assert abs(told.rate_norm * hour - 15.041) < 3 * told.rate_norm_sigma * hour
    assert abs(told.vertical_rate - told.expected_vertical_rate) < 3 * told.vertical_rate_sigma
    assert told.force_norm == pytest.approx(told.gravity, abs=2e-4)
