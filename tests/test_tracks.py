"""Recorded tracks: reading a CSV file, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from navopt.data.tracks import MeasuredTrack, read_track_csv
from navopt.errors import InvalidInput, UnknownName

SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"


def write(path, header, rows):
    path.write_text(
        "\n".join([header, *(",".join(str(v) for v in row) for row in rows)]) + "\n", encoding="utf-8"
    )
    return path


@pytest.fixture
def plain(tmp_path):
    rows = [(0, 20.0, 150.0, 3.5), (60, 20.1, 150.2, -4.0), (120.5, 20.3, -179.9, 0.25)]
    return write(tmp_path / "track.csv", "time,latitude,longitude,gravity", rows)


def test_degrees_become_radians_and_seconds_stay(plain):
    track = read_track_csv(plain, measured="gravity")
    assert len(track) == 3
    np.testing.assert_array_equal(track.time, [0.0, 60.0, 120.5])
    np.testing.assert_array_equal(track.latitude, np.radians([20.0, 20.1, 20.3]))
    np.testing.assert_array_equal(track.longitude, np.radians([150.0, 150.2, -179.9]))
    np.testing.assert_array_equal(track.measured, [3.5, -4.0, 0.25])
    assert track.true_latitude is None
    assert track.true_longitude is None
    for name in ("time", "latitude", "longitude", "measured"):
        assert not getattr(track, name).flags.writeable
    assert isinstance(read_track_csv(str(plain), measured="gravity"), MeasuredTrack)


def test_a_reference_may_be_named(tmp_path):
    file = write(
        tmp_path / "t.csv",
        "t,ins_lat,ins_lon,lat,lon,faa",
        [(0, 20.0, 150.0, 20.5, 150.5, 1), (1, 20.1, 150.1, 20.6, 150.6, 2)],
    )
    names = {"time": "t", "latitude": "ins_lat", "longitude": "ins_lon", "measured": "faa"}
    track = read_track_csv(file, **names, true_latitude="lat", true_longitude="lon")
    np.testing.assert_array_equal(track.true_latitude, np.radians([20.5, 20.6]))
    np.testing.assert_array_equal(track.true_longitude, np.radians([150.5, 150.6]))
    assert track.measured.dtype == float
    with pytest.raises(InvalidInput, match="both or none"):
        read_track_csv(file, **names, true_latitude="lat")


@pytest.mark.parametrize(
    "stamps",
    [
        ["2017-09-11 14:49:00", "2017-09-11 14:50:00", "2017-09-12 14:50:00"],
        ["2017-09-11 14:49:00+00:00", "2017-09-11 14:50:00+00:00", "2017-09-12 14:50:00+00:00"],
        ["2017-09-11T14:49:00Z", "2017-09-11T14:50:00Z", "2017-09-12T14:50:00Z"],
        # one minute, but the clock was set to another zone in between
        ["2017-09-11 14:49:00+05:00", "2017-09-11 09:50:00+00:00", "2017-09-12 09:50:00+00:00"],
        # fractions of seconds are written only where there are any
        ["2017-09-11 14:49:00", "2017-09-11 14:50:00.0", "2017-09-12 14:50:00"],
    ],
)
def test_dates_become_seconds_since_the_first_row(tmp_path, stamps):
    rows = [(stamp, 20.0 + k, 150.0, k) for k, stamp in enumerate(stamps)]
    track = read_track_csv(write(tmp_path / "t.csv", "time,latitude,longitude,g", rows), measured="g")
    np.testing.assert_array_equal(track.time, [0.0, 60.0, 86460.0])


def test_rows_without_a_measured_value_are_left_out(tmp_path):
    rows = [
        ("2017-09-11 14:49:00", 20.0, 150.0, ""),
        ("2017-09-11 14:50:00", 20.1, 150.1, 4.0),
        ("2017-09-11 14:51:00", 20.2, 150.2, "NaN"),
        ("2017-09-11 14:52:00", 20.3, 150.3, 6.0),
    ]
    track = read_track_csv(write(tmp_path / "t.csv", "time,latitude,longitude,g", rows), measured="g")
    np.testing.assert_array_equal(track.measured, [4.0, 6.0])
    np.testing.assert_array_equal(np.diff(track.time), [120.0])
    np.testing.assert_array_equal(track.latitude, np.radians([20.1, 20.3]))


def test_a_missing_position_or_time_is_an_error_that_names_it(tmp_path):
    rows = [(0, 20.0, 150.0, 1.0), (1, "", 150.1, 2.0), (2, 20.2, 150.2, 3.0)]
    file = write(tmp_path / "t.csv", "time,latitude,longitude,g", rows)
    with pytest.raises(InvalidInput, match=r"latitude.*not finite.*sample 1"):
        read_track_csv(file, measured="g")
    rows = [("2017-09-11", 20.0, 150.0, 1.0), ("", 20.1, 150.1, 2.0)]
    with pytest.raises(InvalidInput, match="time"):
        read_track_csv(write(tmp_path / "u.csv", "time,latitude,longitude,g", rows), measured="g")


def test_a_wrong_column_is_answered_with_the_nearest(plain):
    with pytest.raises(UnknownName, match="did you mean 'gravity'") as error:
        read_track_csv(plain, measured="gravty")
    assert "track.csv" in str(error.value)
    assert "latitude" in str(error.value)  # what there is
    with pytest.raises(UnknownName, match=r"column for latitude.*'LATITUDE'"):
        read_track_csv(plain, measured="gravity", latitude="LATITUDE")
    with pytest.raises(UnknownName, match="column for true_latitude"):
        read_track_csv(plain, measured="gravity", true_latitude="x", true_longitude="longitude")


@pytest.mark.parametrize("times", [(0, 120, 60), (0, 60, 60), (5, 4, 3)])
def test_times_that_do_not_increase_are_refused(tmp_path, times):
    rows = [(t, 20.0, 150.0 + k, k) for k, t in enumerate(times)]
    with pytest.raises(InvalidInput, match="increase: sort"):
        read_track_csv(write(tmp_path / "t.csv", "time,latitude,longitude,g", rows), measured="g")


@pytest.mark.parametrize(
    ("header", "row", "name"),
    [
        ("time,latitude,longitude,g", ("yesterday", 20.0, 150.0, 1.0), "time"),
        ("time,latitude,longitude,g", (0, "20N", 150.0, 1.0), "latitude"),
        ("time,latitude,longitude,g", (0, 20.0, 150.0, "much"), "g"),
        ("time,latitude,longitude,g", (0, 120.0, 150.0, 1.0), "latitude"),
        ("time,latitude,longitude,g", (0, 20.0, 400.0, 1.0), "longitude"),
    ],
)
def test_unusable_columns_are_refused_by_name(tmp_path, header, row, name):
    with pytest.raises(InvalidInput, match=name):
        read_track_csv(write(tmp_path / "t.csv", header, [row]), measured="g")


@pytest.mark.parametrize("stamp", ["2017-09-11", "0"])
def test_a_file_without_any_measured_value_is_refused(tmp_path, stamp):
    file = write(tmp_path / "t.csv", "time,latitude,longitude,g", [(stamp, 20.0, 150.0, "")])
    with pytest.raises(InvalidInput, match="g"):
        read_track_csv(file, measured="g")
    with pytest.raises(InvalidInput):
        read_track_csv(write(tmp_path / "u.csv", "time,latitude,longitude,g", []), measured="g")


def test_a_file_that_is_not_there_or_empty_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="existing CSV"):
        read_track_csv(tmp_path / "none.csv", measured="g")
    empty = tmp_path / "empty.csv"
    empty.write_text("")
    with pytest.raises(InvalidInput, match="empty"):
        read_track_csv(empty, measured="g")


def test_tracks_do_not_share_memory_with_what_they_were_made_of():
    latitude = np.array([0.1, 0.2])
    track = MeasuredTrack(time=[0, 1], latitude=latitude, longitude=[0.1, 0.2], measured=[1, 2])
    latitude[0] = 9.0
    assert track.latitude[0] == 0.1
    with pytest.raises(ValueError, match="read-only"):
        track.latitude[0] = 9.0
    with pytest.raises(AttributeError):
        track.latitude = latitude
    with pytest.raises(TypeError):
        MeasuredTrack([0], [0], [0], [0])


def test_angles_that_look_like_degrees_are_refused():
    arrays = {"time": [0, 1], "latitude": [0.1, 0.2], "longitude": [2.0, 2.1], "measured": [1, 2]}
    MeasuredTrack(**arrays)
    for name, values in (("latitude", [20.0, 20.1]), ("longitude", [150.0, 150.1])):
        with pytest.raises(InvalidInput, match=f"{name}.*radians"):
            MeasuredTrack(**(arrays | {name: values}))
        reference = {"true_latitude": [0.1, 0.2], "true_longitude": [2.0, 2.1], f"true_{name}": values}
        with pytest.raises(InvalidInput, match=f"true_{name}.*radians"):
            MeasuredTrack(**arrays, **reference)


@pytest.mark.skipif(
    not (SHARED / "index17.csv").is_file(), reason="the recorded ship tracks are not beside the project"
)
def test_a_recorded_ship_track_can_be_read():
    """A stretch of a marine trackline as its archive delivers it: a date column without a name."""
    track = read_track_csv(
        SHARED / "index17.csv", time="Unnamed: 0", latitude="LAT", longitude="LON", measured="FREEAIR"
    )
    assert 7000 < len(track) <= 7873
    assert track.time[0] == 0.0
    assert 55.0 <= np.median(np.diff(track.time)) <= 65.0
    assert -40 < np.degrees(track.latitude).min() < np.degrees(track.latitude).max() < 0
    assert 50 < np.degrees(track.longitude).min() < np.degrees(track.longitude).max() < 120
    assert 5 < track.measured.std() < 100
    # the speed of a ship, from the positions and times that were read
    metres = 6371e3 * np.hypot(np.diff(track.latitude), np.diff(track.longitude) * np.cos(track.latitude[1:]))
    assert 1.0 < np.median(metres / np.diff(track.time)) < 9.0
