"""`navopt match`: a user's own track and map, from files to a matched track that can be judged."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import os

import numpy as np
import pytest
from typer.testing import CliRunner

import navopt
from baselines.base import Baseline
from comparisons import cli, match_track
from comparisons.match_figures import match_picture
from comparisons.match_output import FILES, match_csv, match_geojson, summary_lines
from comparisons.match_problem import carried_errors, matching_problem
from navopt.data import MeasuredTrack, RecordedTrack, read_track
from navopt.errors import InvalidInput
from navopt.models import FieldMap, InsErrors
from navopt.models.earth import SEMI_MAJOR_AXIS, to_geodetic
from navopt.models.track_errors import track_error_basis
from navopt.problems import GravityMatching
from navopt.problems.gravity_matching import MatchedTrack
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.registry import solver

PLAIN = MeasurementErrors(noise=0.5)
#: Options of the command that declare the same.
DECLARED = ("--sigma", "0.5", "--map-error", "0", "--bias", "0")


@pytest.fixture(autouse=True)
def _threads(monkeypatch):
    """The command limits threads for its own process; here that process is the tests'."""
    monkeypatch.setattr(os, "environ", os.environ.copy())


def invoke(*arguments, code=0):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in ("match", *arguments)])
    assert result.exit_code == code, (result.output, result.exception)
    return result


def refused(folder, *arguments):
    """Message of a command that must be refused: one message, exit code 2, nothing written."""
    out = folder / "refused"
    result = invoke(*arguments, "--out", out, code=2)
    assert result.stdout == ""
    assert result.stderr.startswith("navopt: error: ")
    assert result.stderr.count("\n") == 1
    assert "Traceback" not in result.stderr
    assert not out.exists()
    return result.stderr


def hills(latitude, longitude):
    """A rough field in mGal that depends on the longitude only through its distance from 114 degrees."""
    x, y = longitude - 114.0, latitude - 10.0
    return (
        30 * np.sin(2 * np.pi * (2.3 * x + 0.7 * y))
        + 25 * np.cos(2 * np.pi * (3.1 * y - 0.9 * x))
        + 15 * np.sin(2 * np.pi * (4.0 * x + 3.7 * y) + 1.0)
    )


def area(turn=0.0, values=hills):
    """Map of the hills with nodes every minute, moved east by `turn` degrees."""
    lat, lon = 9.0 + np.arange(151) / 60, 113.5 + np.arange(181) / 60
    field = values(lat[:, None], lon[None, :]) + np.zeros((lat.size, lon.size))
    return FieldMap.from_degrees(lat, lon + turn, field, name="hills")


def voyage(*, n=24, turn=0.0, north=1900.0, east=-1300.0, offset=0.0, noise=0.2):
    """A track over the hills whose INS is off by a constant; everything is known."""
    k = np.arange(n)
    true = np.radians(10.0 + 0.012 * k), np.radians(114.2 + 0.017 * k)
    latitude, longitude = to_geodetic(north, east, *true)
    measured = hills(np.degrees(true[0]), np.degrees(true[1])) + offset
    measured = measured + noise * np.random.default_rng(5).standard_normal(n)
    return MeasuredTrack(
        time=300.0 * k,
        latitude=latitude,
        longitude=longitude + np.radians(turn),
        measured=measured,
        true_latitude=true[0],
        true_longitude=true[1] + np.radians(turn),
    )


def write_csv(path, track, *, truth=True, factor=1.0, header=None, extra=None, wrap=False, rows=slice(None)):
    """Write a track with every bit of its numbers."""

    def degrees(longitude):
        found = np.degrees(longitude)
        return (found + 180.0) % 360.0 - 180.0 if wrap else found

    columns = {
        "time": track.time,
        "latitude": np.degrees(track.latitude),
        "longitude": degrees(track.longitude),
        "gravity": track.measured * factor,
    }
    if truth:
        columns["true_latitude"] = np.degrees(track.true_latitude)
        columns["true_longitude"] = degrees(track.true_longitude)
    columns |= extra or {}
    names = header or ",".join(columns)
    lines = [",".join(repr(float(values[k])) for values in columns.values()) for k in range(len(track))]
    path.write_text("\n".join([names, *lines[rows]]) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The map and the track as files."""
    folder = tmp_path_factory.mktemp("match")
    area().to_netcdf(folder / "map.nc")
    write_csv(folder / "track.csv", voyage())
    return folder


@pytest.fixture(scope="module")
def done(files):
    """A finished match by the command, with all its files."""
    out = files / "out"
    result = CliRunner().invoke(
        cli.app,
        ["match", "--map", str(files / "map.nc"), "--track", str(files / "track.csv"), "--out", str(out),
         "--solver", "tercom", *DECLARED],
    )  # fmt: skip
    assert result.exit_code == 0, (result.output, result.exception)
    return out, result.stdout


@dataclasses.dataclass(frozen=True)
class Sure(MatchedTrack):
    covariance: np.ndarray
    accepted: bool
    message: str


@solver(
    "sure",
    summary="states whatever it is told",
    stochastic=False,
    spends_all=False,
    comparison_based=True,
    needs=("track",),
    reasons={"spends_all": "one candidate"},
)
class Stating(Baseline):
    """The INS track as it is, with a covariance of its own making."""

    def __init__(self, covariance, accepted=True, message="", **kwargs):
        super().__init__(**kwargs)
        self.stated = covariance, accepted, message

    def propose(self):
        track, last = self.problem.track, slice(-self.problem.window, None)
        self.estimate = Sure(track.latitude[last].copy(), track.longitude[last].copy(), *self.stated)
        return self.problem.project(self.estimate)


# -- the command does what the library does ----------------------------------------------------------
@pytest.mark.parametrize(("name", "budget"), [("tercom", None), ("affine-abc", 400)])
def test_the_command_gives_the_answer_of_the_library(files, tmp_path, monkeypatch, name, budget):
    """A simulated world through a CSV and a NetCDF file, against a problem made by hand."""
    world = navopt.simulate("gravity-matching", 3, hours=3.0)
    world.field_map.to_netcdf(tmp_path / "map.nc")
    write_csv(tmp_path / "track.csv", world.track)
    sigmas = InsErrors.published()
    track = dataclasses.replace(world.track, true_latitude=None, true_longitude=None)
    covariance = track_error_basis(track.time, track.latitude, track.longitude, sigmas).covariance()
    problem = GravityMatching(
        world.field_map, track, position_covariance=covariance[-24:, -24:], noise=1.0, ins_errors=sigmas
    )
    expected = navopt.solve(problem, name, budget=budget, seed=4)
    # pictures have tests of their own
    monkeypatch.setattr("comparisons.drawing.render", lambda figure, **_: b"")
    limit = [] if budget is None else ["--budget", budget]
    invoke(
        "--map", tmp_path / "map.nc", "--track", tmp_path / "track.csv", "--out", tmp_path / "out",
        "--solver", name, "--seed", 4, *limit, "--sigma", 1, "--map-error", 0, "--bias", 0,
        "--initial-position", 0.1 / 60 * math.radians(1) * SEMI_MAJOR_AXIS,
    )  # fmt: skip
    summary = json.loads((tmp_path / "out" / "match.json").read_text())
    rows = list(csv.DictReader((tmp_path / "out" / "matched.csv").open()))
    assert summary["result"]["cost"] == expected.counts.cost
    assert summary["result"]["loss"] == pytest.approx(expected.loss, rel=1e-9)
    np.testing.assert_allclose(
        [float(row["latitude"]) for row in rows], np.degrees(expected.estimate.latitude), atol=1e-7
    )
    np.testing.assert_allclose(
        [float(row["longitude"]) for row in rows], np.degrees(expected.estimate.longitude), atol=1e-7
    )
    truth = world.score(expected.estimate)
    assert summary["scores"]["position_error_m"] == pytest.approx(truth["position_error_m"], abs=1e-2)


def test_a_known_shift_is_undone(done):
    """The INS is off by 1900 m north and -1300 m east: the correction is its negative."""
    out, said = done
    result = json.loads((out / "match.json").read_text())["result"]
    # within half a step of TERCOM's grid
    assert result["correction_north_m"] == pytest.approx(-1900, abs=278)
    assert result["correction_east_m"] == pytest.approx(1300, abs=278)
    towards = math.degrees(math.atan2(result["correction_east_m"], result["correction_north_m"])) % 360
    size = math.hypot(result["correction_north_m"], result["correction_east_m"])
    assert f"position correction: {size:.0f} m towards {towards:.0f} degrees" in said
    assert "1 sigma: the solver states none" in said
    assert said.splitlines()[-1] == str(out)
    scores = json.loads((out / "match.json").read_text())["scores"]
    assert scores["ins_position_error_m"] == pytest.approx(math.hypot(1900, 1300), rel=1e-3)
    assert scores["position_error_m"] < 400


def test_the_truth_is_for_scoring_only():
    """The same bits without a truth, and with a wrong one; the solver's problem never has any."""
    track, field = voyage(), area()
    without = dataclasses.replace(track, true_latitude=None, true_longitude=None)
    wrong = dataclasses.replace(track, true_latitude=track.latitude, true_longitude=track.longitude)
    found = [match_track(one, field, solver="affine-abc", budget=300) for one in (track, without, wrong)]
    for one in found:
        assert one.problem.truth is None
        assert one.problem.track.true_latitude is None
        np.testing.assert_array_equal(one.solution.x, found[0].solution.x)
    assert found[1].scores() == {}
    assert found[2].scores()["ins_position_error_m"] == 0.0


def test_residuals_are_measured_minus_map():
    track, field = voyage(noise=0.0), area()
    found = match_track(track, field, solver="tercom", measurement_errors=PLAIN)
    inertial, _ = found.residuals()
    there = field.value(track.latitude[-12:], track.longitude[-12:])
    np.testing.assert_allclose(inertial, track.measured[-12:] - there, rtol=1e-12)
    assert found.first == 12


def test_settings_reach_the_solver_and_a_bias_is_taken_out():
    track, field = voyage(offset=40.0), area()
    found = match_track(track, field, solver="tercom:rotations=3,step_m=400")
    options = found.solution.settings["options"]
    assert (options["rotations"], options["step_m"], options["remove_mean"]) == (3, 400, True)
    north, east = found.correction
    assert (north, east) == (pytest.approx(-1900, abs=278), pytest.approx(1300, abs=278))
    assert np.mean(found.residuals()[1]) == pytest.approx(40.0, abs=2.0)
    plain = match_track(track, field, solver="tercom", measurement_errors=PLAIN)
    assert plain.solution.settings["options"]["remove_mean"] is False
    with pytest.raises(InvalidInput, match=r"known: .*tercom"):
        match_track(track, field, solver="tercomm")


def test_an_unknown_default_solver_would_be_named(files, tmp_path):
    message = refused(
        tmp_path, "--map", files / "map.nc", "--track", files / "track.csv", "--solver", "trackmap"
    )
    assert "solver: got 'trackmap'" in message
    message = refused(
        tmp_path, "--map", files / "map.nc", "--track", files / "track.csv", "--solver", "tercom:step=1"
    )
    assert "step_m" in message
    message = refused(
        tmp_path, "--map", files / "map.nc", "--track", files / "track.csv", "--solver", "tercom:step_m=wide"
    )
    assert "settings that tercom takes" in message


@pytest.fixture(scope="module")
def five_hours():
    """A simulated voyage whose gravimeter reads 12 mGal too high."""
    world = navopt.simulate("gravity-matching", 11, hours=5.0)
    return world.field_map, dataclasses.replace(world.track, measured=world.track.measured + 12.0)


def test_the_default_solver_matches_the_whole_track(five_hours):
    field, track = five_hours
    sensing = MeasurementErrors(noise=1.0, bias=30.0)
    found = match_track(track, field, measurement_errors=sensing)
    assert found.solution.settings["solver"] == "track-map"
    assert (found.first, len(found.latitude)) == (0, len(track))
    np.testing.assert_array_equal(found.latitude[-12:], found.solution.estimate.latitude)
    assert np.isfinite(found.sigma).all()
    scores = found.scores()
    # 2 degrees of freedom: above 18.4 once in ten thousand
    assert scores["normalised_error_squared_1"] < 18.4
    assert scores["position_error_m"] < 0.2 * scores["ins_position_error_m"]
    # what the solver calls the offset is what the residuals have in common
    estimate = found.solution.estimate
    assert found.offset[0] == pytest.approx(30.0 * estimate.coefficients[estimate.names.index("bias")])
    assert found.offset[-1] == pytest.approx(np.mean(found.residuals()[1]), abs=0.5)
    assert found.known is True
    said = "\n".join(summary_lines(found))
    assert "the solver vouches for the position: 1 sigma" in said
    assert f"offset of the measurements found: {found.offset[-1]:+.2f} mGal" in said


def test_the_default_solver_says_when_it_does_not_know(five_hours):
    """A bad map and a bad gravimeter: the position is hardly better known than before."""
    field, track = five_hours
    poor = MeasurementErrors(noise=30.0, map_error=30.0, bias=30.0)
    found = match_track(track, field, measurement_errors=poor)
    assert found.known is False
    assert "the solver does not know the position well enough" in "\n".join(summary_lines(found))


def test_a_ship_survey_with_an_ins_beside_it(tmp_path, files, done, monkeypatch):
    """The same world as an MGD77T file and an INS file gives the files of the CSV track."""
    monkeypatch.setattr("comparisons.drawing.render", lambda figure, **_: b"")
    track = voyage()
    names = "SURVEY_ID\tTIMEZONE\tDATE\tTIME\tLAT\tLON\tFREEAIR"
    rows, ins = [names], ["time,latitude,longitude"]
    for k, second in enumerate(track.time):
        minutes = round(second / 60)
        clock = f"{minutes // 60:02d}{minutes % 60:02d}"
        true = f"{math.degrees(track.true_latitude[k])!r}\t{math.degrees(track.true_longitude[k])!r}"
        rows.append(f"XX0101\t0\t20240301\t{clock}\t{true}\t{float(track.measured[k])!r}")
        place = f"{math.degrees(track.latitude[k])!r},{math.degrees(track.longitude[k])!r}"
        ins.append(f"2024-03-01T{clock[:2]}:{clock[2:]}:00Z,{place}")
    (tmp_path / "xx0101.m77t").write_text("\n".join(rows) + "\n")
    (tmp_path / "ins.csv").write_text("\n".join(ins) + "\n")
    said = invoke(
        "--map", files / "map.nc", "--track", tmp_path / "xx0101.m77t", "--ins", tmp_path / "ins.csv",
        "--out", tmp_path / "out", "--solver", "tercom", *DECLARED,
    ).stdout  # fmt: skip
    assert "position at 2024-03-01T01:55:00Z" in said
    assert "those of xx0101.m77t are the reference" in said
    ours, theirs = (json.loads((folder / "match.json").read_text()) for folder in (tmp_path / "out", done[0]))
    for key in ("correction_north_m", "correction_east_m", "loss"):
        assert ours["result"][key] == pytest.approx(theirs["result"][key], abs=0.11)
    assert ours["scores"] == pytest.approx(theirs["scores"], abs=0.1)
    assert set(ours["files"]) == {"map", "track", "ins"}
    # without the INS the ship's own positions are taken for it: hardly a correction, and no score
    invoke(
        "--map", files / "map.nc", "--track", tmp_path / "xx0101.m77t", "--out", tmp_path / "own",
        "--solver", "tercom", *DECLARED,
    )  # fmt: skip
    own = json.loads((tmp_path / "own" / "match.json").read_text())
    assert own["scores"] == {}
    assert math.hypot(own["result"]["correction_north_m"], own["result"]["correction_east_m"]) < 400


# -- what is written ---------------------------------------------------------------------------------
def check_geojson(document):
    """RFC 7946: what a reader may rely on."""
    assert document["type"] == "FeatureCollection"
    assert "crs" not in document

    def position(place):
        assert len(place) == 2
        assert all(isinstance(value, float) and math.isfinite(value) for value in place)
        assert -180 <= place[0] <= 180
        assert -90 <= place[1] <= 90

    for feature in document["features"]:
        assert set(feature) == {"type", "geometry", "properties"}
        assert feature["type"] == "Feature"
        kind, coordinates = feature["geometry"]["type"], feature["geometry"]["coordinates"]
        lines = {"Point": [[coordinates] * 2], "LineString": [coordinates]}.get(kind, coordinates)
        assert kind in ("Point", "LineString", "MultiLineString")
        for line in lines:
            assert len(line) >= 2
            for place in line:
                position(place)
            # no line may run around the back of the Earth
            assert np.abs(np.diff([place[0] for place in line])).max() < 180
    return document["features"]


def test_all_files_are_there_and_readable(done):
    out, _ = done
    assert sorted(path.name for path in out.iterdir()) == sorted(FILES)
    for name in ("map.png", "residuals.png"):
        data = (out / name).read_bytes()
        assert data.startswith(b"\x89PNG")
        assert len(data) > 20_000
    # NaN is no JSON
    text = (out / "match.json").read_text()
    summary = json.loads(text, parse_constant=lambda name: pytest.fail(name))
    assert summary["solver"]["solver"] == "tercom"
    assert summary["result"]["covariance_north_east_m2"] == [[None, None], [None, None]]
    assert summary["versions"]["navopt"] == navopt.__version__
    assert len(summary["files"]["track"]["sha256"]) == 64
    assert str(out.parent) not in text  # names of files, not places of a machine
    table = list(csv.DictReader((out / "matched.csv").open()))
    assert len(table) == 12
    assert table[0]["sigma_north_m"] == ""
    assert float(table[-1]["error_m"]) == pytest.approx(summary["scores"]["position_error_m"], abs=0.06)
    features = check_geojson(json.loads((out / "matched.geojson").read_text()))
    assert [one["properties"]["track"] for one in features[:3]] == ["ins", "matched", "truth"]
    assert [one["geometry"]["type"] for one in features[3:]] == ["Point"] * 12
    assert features[-1]["properties"]["time"] == 6900.0
    assert features[-1]["properties"]["sigma_north_m"] is None


def test_a_second_match_replaces_its_own_files_only(done, files):
    out, _ = done
    (out / "mine.txt").write_text("mine")
    before = {name: (out / name).read_bytes() for name in FILES}
    again = ("--map", files / "map.nc", "--track", files / "track.csv", "--out", out, "--solver", "tercom")
    invoke(*again, *DECLARED)
    assert (out / "mine.txt").read_text() == "mine"
    (out / "mine.txt").unlink()
    for name in ("matched.csv", "matched.geojson", "map.png", "residuals.png"):
        assert (out / name).read_bytes() == before[name], name


def test_nothing_is_left_behind_where_writing_fails(tmp_path, monkeypatch):
    from pathlib import Path

    found = match_track(voyage(), area(), solver="tercom", measurement_errors=PLAIN)
    monkeypatch.setattr("comparisons.drawing.render", lambda figure, **_: b"")
    (tmp_path / "file").write_text("x")
    with pytest.raises(InvalidInput, match=r"--out.*folder"):
        found.write(tmp_path / "file")
    with pytest.raises(InvalidInput, match=r"--out.*written"):
        found.write(tmp_path / "file" / "below")
    real, calls = Path.write_bytes, []

    def full_disk(self, data):
        calls.append(self)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")
        return real(self, data)

    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with pytest.raises(InvalidInput, match="No space left"):
        found.write(tmp_path / "new" / "deep")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_a_stated_sigma_is_passed_on(tmp_path):
    n = 12
    covariance = np.tile([[90_000.0, 0.0], [0.0, 40_000.0]], (n, 1, 1))
    covariance[-1] = [[62_500.0, 10_000.0], [10_000.0, 40_000.0]]
    found = match_track(voyage(), area(), solver=Stating(covariance, False, "two places fit"))
    assert len(found.latitude) == n
    rows = list(csv.DictReader(match_csv(found).splitlines()))
    assert (rows[0]["sigma_north_m"], rows[0]["sigma_east_m"]) == ("300.0", "200.0")
    points = check_geojson(match_geojson(found))[-n:]
    assert points[-1]["properties"]["sigma_north_m"] == 250.0
    said = "\n".join(summary_lines(found))
    assert "1 sigma: 250 m north, 200 m east" in said
    assert "does not know the position well enough: two places fit" in said
    # normalised error squared in closed form: the error is (1900, -1300) m
    error = np.array([1900.0, -1300.0])
    expected = error @ np.linalg.inv(covariance[-1]) @ error
    assert found.scores()["normalised_error_squared_1"] == pytest.approx(expected, rel=2e-3)
    last = match_track(voyage(), area(), solver=Stating(covariance[-1]))
    assert np.isfinite(last.sigma).sum() == 2
    written = found.write(tmp_path / "out")
    assert [path.name for path in written] == list(FILES)


# -- the date line -----------------------------------------------------------------------------------
@pytest.mark.parametrize("turn", [65.6, -294.4])
def test_a_track_may_cross_the_date_line(tmp_path, turn):
    """The same world moved round the Earth gives the same answer, moved."""
    here = match_track(voyage(), area(), solver="tercom", measurement_errors=PLAIN)
    moved = area(65.6)
    lon = (np.degrees(moved.longitude) + 180.0) % 360.0 - 180.0
    import xarray as xr

    data = xr.Dataset(
        {"faa": (("lat", "lon"), moved.values[::-1], {"units": "mGal"})},
        coords={"lat": np.degrees(moved.latitude)[::-1], "lon": lon},
    )
    data.to_netcdf(tmp_path / "map.nc", engine="h5netcdf")
    track = write_csv(tmp_path / "track.csv", voyage(turn=turn), wrap=True)
    read = read_track(track)
    assert np.abs(np.diff(read.track.longitude)).max() < 0.01
    there = match_track(read, tmp_path / "map.nc", solver="tercom", measurement_errors=PLAIN)
    assert there.correction == pytest.approx(here.correction, abs=0.5)
    assert there.scores() == pytest.approx(here.scores(), abs=0.5)
    west, east = match_picture(there).axes[0].get_xlim()
    assert west < 180 < east < west + 3
    features = check_geojson(match_geojson(there))
    line = features[0]["geometry"]
    assert line["type"] == "MultiLineString"
    before, after = line["coordinates"]
    assert (before[-1][0], after[0][0]) == (180.0, -180.0)
    assert before[-1][1] == after[0][1]
    assert sum(map(len, line["coordinates"])) == 24 + 2


# -- units, sigmas, gaps -----------------------------------------------------------------------------
@pytest.mark.parametrize(("unit", "factor"), [("uGal", 1e3), ("m/s2", 1e-5)])
def test_other_units_are_noticed_and_understood(files, tmp_path, unit, factor):
    wrong = write_csv(tmp_path / "track.csv", voyage(), factor=factor)
    arguments = ("--map", files / "map.nc", "--track", wrong, "--solver", "tercom", *DECLARED)
    assert f"--gravity-unit {unit}" in refused(tmp_path, *arguments)
    found = read_track(wrong, gravity_unit=unit)
    np.testing.assert_allclose(found.track.measured, voyage().measured, rtol=1e-12)


def test_gravity_itself_is_no_anomaly(files, tmp_path):
    wrong = write_csv(tmp_path / "track.csv", voyage(offset=978_100.0))
    message = refused(tmp_path, "--map", files / "map.nc", "--track", wrong)
    assert "gravity itself in mGal" in message


def test_another_scale_than_the_maps_is_remarked_on():
    track = voyage()
    tens = dataclasses.replace(track, measured=track.measured * 10)
    notes = match_track(tens, area(), solver="tercom").notes
    assert any("other units" in note for note in notes)
    assert not any("units" in note for note in match_track(track, area(), solver="tercom").notes)


def test_a_stated_sigma_of_the_ins_scales_its_errors():
    track, field = voyage(), area()
    sigmas = InsErrors.published()
    basis = track_error_basis(track.time, track.latitude, track.longitude, sigmas)
    variance = np.diag(basis.covariance()).reshape(-1, 2).mean(axis=1)
    stated = RecordedTrack(track=track, position_sigma=2.0 * np.sqrt(variance))
    _, errors, sigma, notes = matching_problem(stated, field)
    np.testing.assert_allclose(errors.vector, 2.0 * sigmas.vector, rtol=1e-9)
    assert errors.gyro_noise == pytest.approx(2.0 * sigmas.gyro_noise)
    np.testing.assert_allclose(sigma, 2.0 * np.sqrt(np.diag(basis.covariance())[-2:]), rtol=1e-3)
    assert "scaled by 2 " in notes[-1]


def test_errors_carried_over_a_gap_are_those_predicted_there():
    track = voyage()
    sigmas = InsErrors.published()
    carried = carried_errors(RecordedTrack(track=track), sigmas, 20)
    basis = track_error_basis(track.time, track.latitude, track.longitude, sigmas)
    predicted = np.sqrt(np.diag(basis.covariance())[40:42])
    later = track_error_basis(track.time[20:], track.latitude[20:], track.longitude[20:], carried)
    np.testing.assert_allclose(np.sqrt(np.diag(later.covariance())[:2]), predicted, rtol=1e-9)
    assert carried.gyro_bias == sigmas.gyro_bias
    assert carried.velocity_error[0] > 0.05


def test_gaps_are_told_refused_or_split(files, tmp_path, monkeypatch):
    monkeypatch.setattr("comparisons.drawing.render", lambda figure, **_: b"")
    track = voyage(n=30)
    times = track.time + 7200.0 * (np.arange(30) >= 15)
    late = dataclasses.replace(track, time=times)
    gap = write_csv(tmp_path / "gap.csv", late)
    arguments = ("--map", files / "map.nc", "--track", gap, "--solver", "tercom", *DECLARED)
    message = refused(tmp_path, *arguments)
    assert "1 gap above 60 min, the longest of 125 min after 4200 s" in message
    assert "--split" in message
    said = invoke(*arguments, "--out", tmp_path / "allowed", "--max-gap", 180).stdout
    assert "note: 1 gap in the measurements, the longest of 125.0 min after 4200 s" in said
    said = invoke(*arguments, "--out", tmp_path / "part", "--split").stdout
    assert "note: 15 samples before the last gap above 60 min are left out" in said
    summary = json.loads((tmp_path / "part" / "match.json").read_text())
    assert summary["track"]["samples"] == 15
    declared = InsErrors.published()
    whole = track_error_basis(late.time, late.latitude, late.longitude, declared)
    grown = math.sqrt(whole.covariance()[30, 30]) / SEMI_MAJOR_AXIS
    assert summary["declared"]["ins"]["latitude_error"] == pytest.approx(grown, rel=0.01)


# -- what cannot be matched --------------------------------------------------------------------------
BAD_TRACKS = {
    "wholly outside": (
        lambda t: dataclasses.replace(t, latitude=t.latitude + 0.1),
        "all 24 points outside the map",
    ),
    "partly outside": (
        lambda t: dataclasses.replace(t, latitude=t.latitude + np.radians(1.3)),
        "8 of 24 points (numbers 17 to 24) outside",
    ),
    "pole": (lambda t: dataclasses.replace(t, latitude=t.latitude + 1.35), "nearer to a pole than 85"),
    "too fast": (
        lambda t: dataclasses.replace(t, longitude=t.longitude + 0.01 * (np.arange(24) > 7)),
        "no vehicle is so fast",
    ),
    "stuck": (lambda t: dataclasses.replace(t, measured=np.full(24, 3.0)), "stuck"),
}


@pytest.mark.parametrize("case", BAD_TRACKS)
def test_a_track_that_cannot_be_matched_is_refused(files, tmp_path, case):
    change, expected = BAD_TRACKS[case]
    plain = dataclasses.replace(voyage(), true_latitude=None, true_longitude=None)
    wrong = write_csv(tmp_path / "track.csv", change(plain), truth=False)
    arguments = ("--map", files / "map.nc", "--track", wrong, "--solver", "tercom", *DECLARED)
    assert expected in refused(tmp_path, *arguments)


def test_outside_names_a_map_that_would_do(files, tmp_path):
    plain = dataclasses.replace(voyage(turn=-200.0), true_latitude=None, true_longitude=None)
    wrong = write_csv(tmp_path / "track.csv", plain, truth=False)
    message = refused(tmp_path, "--map", files / "map.nc", "--track", wrong, "--solver", "tercom")
    assert "the first at (10.0172, -85.8119) at 0 s" in message
    assert "gravity-map --region=-87/-84/9/12" in message


def test_too_few_points(files, tmp_path):
    few = write_csv(tmp_path / "few.csv", voyage(), rows=slice(0, 9))
    arguments = ("--map", files / "map.nc", "--track", few, "--solver", "tercom", *DECLARED)
    assert "9 points; too few: 12 are needed, or fewer with --window" in refused(tmp_path, *arguments)
    two = write_csv(tmp_path / "two.csv", voyage(), rows=slice(0, 2))
    arguments = ("--map", files / "map.nc", "--track", two, "--solver", "tercom", "--window", 3)
    assert "too few: 3 are needed" in refused(tmp_path, *arguments)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--sigma", "0"), "--sigma"),
        (("--sigma", "-1"), "--sigma"),
        (("--sigma", "nan"), "--sigma"),
        (("--sigma", "0.0001"), "--sigma: got 0.0001 mGal"),
        (("--sigma", "1e6"), "--sigma"),
        (("--map-error", "500"), "--map-error"),
        (("--bias", "-3"), "--bias"),
        (("--gyro-bias", "-1"), "--gyro-bias"),
        (("--initial-position", "inf"), "--initial-position"),
        (("--window", "2"), "--window"),
        (("--seed", "-1"), "seed"),
        (("--budget", "0"), "budget"),
        (("--max-gap", "0"), "--max-gap"),
        (("--average", "0"), "--average"),
        (("--from", "20000"), "no sample lies there"),
        (("--from", "2020-01-01"), "counts seconds"),
        (("--columns", "gravity"), "--columns"),
        (("--columns", "gravity=grvity"), "did you mean 'gravity'"),
        (("--columns", "gravty=gravity"), "did you mean 'gravity'"),
        (("--gravity-unit", "furlong"), "gravity_unit"),
        (("--map-unit", "m"), "--map-unit"),
        (("--map-variable", "depth"), "--map-variable"),
        (("--ins", "none.csv"), "has INS and true positions already"),
    ],
)
def test_options_that_cannot_be_meant_are_refused(files, tmp_path, options, expected):
    arguments = ("--map", files / "map.nc", "--track", files / "track.csv", "--solver", "tercom", *DECLARED)
    assert expected in refused(tmp_path, *arguments, *options)


@pytest.mark.parametrize(("value", "noise"), [(lambda a, b: 12.5, 0.5), (lambda a, b: 0.1 * b, 0.5)])
def test_a_field_without_information_gives_no_position(value, noise):
    with pytest.raises(InvalidInput, match=r"no information.*no position is given"):
        match_track(
            voyage(), area(values=value), solver="tercom", measurement_errors=MeasurementErrors(noise=noise)
        )


def test_maps_that_cannot_be_used(files, tmp_path):
    import xarray as xr

    track = ("--track", files / "track.csv", "--solver", "tercom", *DECLARED)
    assert "existing file" in refused(tmp_path, "--map", tmp_path / "none.nc", *track)
    assert "not a map" in refused(tmp_path, "--map", files / "track.csv", *track)
    broken = tmp_path / "broken.nc"
    broken.write_bytes((files / "map.nc").read_bytes()[:2000])
    assert "NetCDF file that can be read" in refused(tmp_path, "--map", broken, *track)
    with xr.open_dataset(files / "map.nc", engine="h5netcdf") as opened:
        data = opened.load()
    holes = data.copy(deep=True)
    holes["z"][5, 7] = np.nan
    holes.to_netcdf(tmp_path / "holes.nc", engine="h5netcdf")
    assert "1 cells without a value" in refused(tmp_path, "--map", tmp_path / "holes.nc", *track)
    silent = data.copy(deep=True)
    del silent["z"].attrs["units"]
    silent.to_netcdf(tmp_path / "silent.nc", engine="h5netcdf")
    assert "--map-unit" in refused(tmp_path, "--map", tmp_path / "silent.nc", *track)
    depths = data.copy(deep=True)
    depths["z"].attrs["units"] = "m"
    depths.to_netcdf(tmp_path / "depths.nc", engine="h5netcdf")
    assert "unit of depths.nc: got 'm'" in refused(tmp_path, "--map", tmp_path / "depths.nc", *track)
    tiny = data.copy(deep=True)
    tiny["z"] = (tiny["z"].dims, data["z"].values * 1e-5, {"units": "mGal"})
    tiny.to_netcdf(tmp_path / "tiny.nc", engine="h5netcdf")
    assert "--map-unit m/s2" in refused(tmp_path, "--map", tmp_path / "tiny.nc", *track)


def test_a_map_too_small_for_the_search_is_remarked_on():
    west, east, south, _ = area().bounds_deg
    small = area().crop((west, east, south, 10.31))
    found = match_track(voyage(), small, solver="tercom", measurement_errors=PLAIN)
    assert any("beyond the map" in note for note in found.notes)


def test_a_track_object_of_another_kind_is_refused():
    with pytest.raises(InvalidInput, match="RecordedTrack"):
        match_track([1, 2, 3], area(), solver="tercom")
