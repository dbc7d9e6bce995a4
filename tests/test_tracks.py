"""Recorded tracks: reading a CSV file, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from navopt.data.recorded import read_track, with_ins
from navopt.data.track_parts import after_last_gap, averaged, between, gaps
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


# -- tracks with what a file says besides: read_track, MGD77T, parts and means -------------------------
HEAD = "time,latitude,longitude,gravity"
ROWS = [
    ("2017-09-11T14:49:00Z", 20.0, 179.9, 3.5),
    ("2017-09-11T14:50:00Z", 20.1, -179.9, -4.0),
    ("2017-09-11T14:52:30Z", 20.2, -179.7, 0.25),
]
MGD77T = [
    "SURVEY_ID", "TIMEZONE", "DATE", "TIME", "LAT", "LON", "POS_TYPE", "NAV_QUALCO", "BAT_TTIME",
    "CORR_DEPTH", "BAT_CPCO", "BAT_TYPCO", "BAT_QUALCO", "MAG_TOT", "MAG_TOT2", "MAG_RES", "MAG_RESSEN",
    "MAG_DICORR", "MAG_SDEPTH", "MAG_QUALCO", "GRA_OBS", "EOTVOS", "FREEAIR", "GRA_QUALCO", "LINEID",
    "POINTID",
]  # fmt: skip


def mgd77(path, *samples):
    """A data file with its line of names; empty cells where a sample says nothing."""
    lines = ["\t".join(str(sample.get(name, "")) for name in MGD77T) for sample in samples]
    path.write_text("\n".join(["\t".join(MGD77T), *lines]) + "\n", encoding="ascii")
    return path


def sample(date, time, freeair, *, lat=10.0, lon=114.0, zone=0, **others):
    return {
        "SURVEY_ID": "XX0101", "TIMEZONE": zone, "DATE": date, "TIME": time, "LAT": lat, "LON": lon,
        "GRA_OBS": 978_321.5, "EOTVOS": 12.1, "FREEAIR": freeair, **others,
    }  # fmt: skip


def test_a_track_keeps_its_dates_and_crosses_the_date_line(tmp_path):
    track = read_track(write(tmp_path / "t.csv", HEAD, ROWS))
    assert track.start == "2017-09-11T14:49:00.000"
    np.testing.assert_array_equal(track.track.time, [0.0, 60.0, 210.0])
    np.testing.assert_allclose(np.degrees(track.track.longitude), [179.9, 180.1, 180.3])
    assert track.moment(210.0) == "2017-09-11T14:52:30Z"
    assert track.moment(210.25) == "2017-09-11T14:52:30.250Z"
    assert track.notes == ()
    seconds = read_track(write(tmp_path / "s.csv", HEAD, [(5, 20, 10, 1), (65, 20, 10, 2)]))
    assert seconds.start is None
    np.testing.assert_array_equal(seconds.track.time, [5.0, 65.0])
    assert seconds.moment(65.0) == "65 s"


def test_what_was_left_out_or_assumed_is_noted(tmp_path):
    rows = [(stamp.replace("Z", ""), *rest) for stamp, *rest in ROWS]
    rows.insert(1, ("2017-09-11T14:49:30", 20.05, 179.95, ""))
    track = read_track(write(tmp_path / "t.csv", HEAD, rows))
    assert track.notes == (
        "1 of 4 rows have no gravity value and are left out",
        "times without a zone are taken as UTC",
    )
    mixed = [ROWS[0], (ROWS[1][0].replace("Z", ""), *ROWS[1][1:])]
    with pytest.raises(InvalidInput, match="zone and without, the first other one in line 3"):
        read_track(write(tmp_path / "m.csv", HEAD, mixed))


def test_optional_columns_and_other_names(tmp_path):
    file = write(
        tmp_path / "t.csv",
        "T,LATITUDE,Longitude,faa,sigma_m,true_latitude,true_longitude",
        [(0, 20.0, 179.9, 1.0, 100, 20.5, -179.9), (1, 20.0, 180.0, 2.0, 200, 20.5, -179.8)],
    )
    track = read_track(file, columns={"time": "T", "gravity": "faa"})
    np.testing.assert_array_equal(track.position_sigma, [100.0, 200.0])
    # the reference is on the same turn as the INS
    np.testing.assert_allclose(np.degrees(track.track.true_longitude), [180.1, 180.2])
    np.testing.assert_allclose(np.degrees(track.track.longitude), [179.9, 180.0])
    with pytest.raises(UnknownName, match=r"column for sigma.*'sigma_m'"):
        read_track(file, columns={"time": "T", "gravity": "faa", "sigma": "sigma"})
    with pytest.raises(UnknownName, match="did you mean 'gravity'"):
        read_track(file, columns={"gravty": "faa"})


@pytest.mark.parametrize(
    ("header", "rows", "expected"),
    [
        (HEAD, [ROWS[0], ROWS[2], ROWS[1]], "in line 4 a time 150 s before line 3.*1 reversed"),
        (HEAD, [ROWS[0], ROWS[0], ROWS[1]], "in line 3 the time of line 2 again .1 repeated and 0 reversed"),
        (HEAD, ROWS[::-1], "reverse order"),
        (HEAD, [("yesterday", 20, 150, 1)], "'yesterday' in line 2"),
        (HEAD, [(0, "20N", 150, 1)], "column latitude of t.csv: got '20N' in line 2"),
        (HEAD, [(0, 20, 150, 1), (1, "", 150, 1)], "an empty cell in line 3"),
        (HEAD, [(0, 20, 150, "much")], "column gravity of t.csv: got 'much'"),
        (HEAD, [(0, 20, 150, "inf")], "column gravity"),
        (HEAD, [(0, 95, 150, 1)], "latitude.*95 in line 2"),
        (HEAD, [(0, 20, 361, 1)], "longitude.*361 in line 2"),
        (HEAD, [(0, 20, 150, "")], "at least one measured value"),
        (HEAD, [], "no row below"),
        (HEAD, [(0, 20, 150, 1, 7, 8)], "more cells than the header"),
        ("time;latitude;longitude;gravity", [], "no row below"),
        (HEAD + ",true_latitude", [(0, 20, 150, 1, 20)], "both true columns or none"),
        (HEAD + ",sigma_m", [(0, 20, 150, 1, 0)], "sigma_m of t.csv: got 0 in line 2"),
        (HEAD, [(0, 20, 150, 98_000.0), (1, 20, 150, 97_000.0)], "--gravity-unit uGal"),
        (HEAD, [(0, 20, 150, 2e-4), (1, 20, 150, -1e-4)], "--gravity-unit m/s2"),
        (HEAD, [(0, 20, 150, 9.7801), (1, 20, 150, 9.7803)], "gravity itself in m/s2"),
        (HEAD, [(0, 20, 150, 978.01), (1, 20, 150, 978.03)], "gravity itself in Gal"),
    ],
)
def test_a_wrong_track_names_line_and_remedy(tmp_path, header, rows, expected):
    with pytest.raises(InvalidInput, match=expected):
        read_track(write(tmp_path / "t.csv", header, rows))


def test_files_that_are_no_tables(tmp_path):
    with pytest.raises(InvalidInput, match="existing file"):
        read_track(tmp_path / "none.csv")
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(InvalidInput, match="empty"):
        read_track(tmp_path / "empty.csv")
    (tmp_path / "binary.csv").write_bytes(bytes(range(128, 256)) * 9)
    with pytest.raises(InvalidInput, match="table of text"):
        read_track(tmp_path / "binary.csv")


def test_units_of_gravity(tmp_path):
    for unit, factor in (("uGal", 1e3), ("µGal", 1e3), ("m/s^2", 1e-5), ("um/s2", 10.0), ("mGal", 1.0)):
        rows = [(k, 20.0, 150.0, repr(v * factor)) for k, v in enumerate((12.5, -40.0))]
        track = read_track(write(tmp_path / "t.csv", HEAD, rows), gravity_unit=unit)
        np.testing.assert_allclose(track.track.measured, [12.5, -40.0], rtol=1e-12)
    with pytest.raises(UnknownName, match="did you mean 'mgal'"):
        read_track(tmp_path / "t.csv", gravity_unit="mgl")


def test_mgd77t_times_positions_and_anomalies(tmp_path):
    """The format's own example of a time: 11:59:40 pm is 2359.6667."""
    file = mgd77(
        tmp_path / "xx0101.m77t",
        sample(19720530, "2359.6667", 3.5, lon=179.99),
        sample(19720531, "0001", 4.5, lon=-179.99),
        sample(19720531, "3", -2.0, lon=-179.98),
        sample(19720531, "0004", "", lon=-179.97),
        sample(19720531, "0105.5", 0.0, lat=-10.5, lon=-179.9),
    )
    track = read_track(file)
    assert track.start == "1972-05-30T23:59:40.000"
    np.testing.assert_allclose(track.track.time, [0.0, 80.0, 200.0, 3950.0], atol=0.01)
    np.testing.assert_allclose(np.degrees(track.track.longitude), [179.99, 180.01, 180.02, 180.1])
    np.testing.assert_array_equal(track.track.measured, [3.5, 4.5, -2.0, 0.0])
    assert np.degrees(track.track.latitude[-1]) == pytest.approx(-10.5)
    assert track.notes == ("1 of 5 rows have no gravity value and are left out",)
    assert track.track.true_latitude is None


def test_mgd77t_zones_make_utc_when_added(tmp_path):
    file = mgd77(
        tmp_path / "a.m77t",
        sample(20010101, "0130", 1.0, zone=-9),  # Tokyo: 9 h earlier in UTC
        sample(20010101, "0131", 2.0, zone=-9),
        sample(20001231, "1632", 3.0, zone=""),  # already UTC
    )
    track = read_track(file)
    assert track.start == "2000-12-31T16:30:00.000"
    np.testing.assert_allclose(track.track.time, [0.0, 60.0, 120.0], atol=0.01)


def test_mgd77t_leaves_out_what_is_marked_as_bad(tmp_path):
    codes = [{"GRA_QUALCO": 4}, {"NAV_QUALCO": 6}, {"GRA_QUALCO": 2}, {}]
    rows = [sample(20010101, f"{k:04d}", float(k), **code) for k, code in enumerate(codes)]
    track = read_track(mgd77(tmp_path / "a.m77t", *rows))
    np.testing.assert_array_equal(track.track.measured, [2.0, 3.0])
    assert track.notes == ("2 rows are marked as bad (quality codes 4 to 6) and left out",)
    with pytest.raises(InvalidInput, match="every sample is marked as bad"):
        read_track(mgd77(tmp_path / "b.m77t", *rows[:2]))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"DATE": 20011301}, "DATE in a.m77t: got 2.00113e.07 in line 3"),
        ({"DATE": 10101}, "DATE in a.m77t: got 10101 in line 3"),
        ({"DATE": ""}, "column DATE of a.m77t: got an empty cell in line 3"),
        ({"TIME": "0075"}, "TIME in a.m77t: got 75 with TIMEZONE 0 in line 3"),
        ({"TIME": "2530"}, "TIME"),
        ({"TIMEZONE": 99}, "TIMEZONE 99"),
        ({"LAT": ""}, "column LAT of a.m77t: got an empty cell"),
        ({"TIME": "0000"}, "in line 3 the time of line 2 again"),
        ({"DATE": 20001231}, "before line 2"),
    ],
)
def test_mgd77t_wrong_cells_are_named(tmp_path, changes, expected):
    rows = [sample(20010101, "0000", 1.0), {**sample(20010101, "0001", 2.0), **changes}]
    rows.append(sample(20010101, "0002", 3.0))
    with pytest.raises(InvalidInput, match=expected):
        read_track(mgd77(tmp_path / "a.m77t", *rows))


def test_mgd77t_columns(tmp_path):
    file = mgd77(tmp_path / "a.m77t", sample(20010101, "0000", 1.0), sample(20010101, "0001", 2.0))
    with pytest.raises(InvalidInput, match="gravity itself in mGal"):
        read_track(file, columns={"gravity": "GRA_OBS"})
    with pytest.raises(UnknownName, match="known: gravity"):
        read_track(file, columns={"time": "TIME"})
    file.write_text(file.read_text().replace("FREEAIR", "FAA"))
    with pytest.raises(UnknownName, match="FREEAIR"):
        read_track(file)
    assert len(read_track(file, columns={"gravity": "FAA"})) == 2


def test_ins_positions_from_a_file_of_their_own(tmp_path):
    """The ship's positions become the reference; the INS's are interpolated."""
    ship = mgd77(tmp_path / "a.m77t", *(sample(20010101, f"{k:04d}", k, lon=-179.99) for k in range(4)))
    ins = write(
        tmp_path / "ins.csv",
        "time,latitude,longitude,sigma_m",
        [("2000-12-31T23:59:00Z", 9.0, 179.0, 50), ("2001-01-01T00:04:00Z", 14.0, -176.0, 100)],
    )
    track = with_ins(read_track(ship), ins)
    np.testing.assert_allclose(np.degrees(track.track.latitude), [10.0, 11.0, 12.0, 13.0])
    np.testing.assert_allclose(
        np.degrees(track.track.longitude), [180.0, 181.0, 182.0, 183.0] - np.float64(360)
    )
    np.testing.assert_allclose(np.degrees(track.track.true_longitude), -179.99)
    np.testing.assert_allclose(track.position_sigma, [60.0, 70.0, 80.0, 90.0])
    with pytest.raises(InvalidInput, match="INS and true positions already"):
        with_ins(track, ins)
    short = write(tmp_path / "short.csv", "time,latitude,longitude", [("2001-01-01T00:00:00Z", 9, 9)] * 1)
    with pytest.raises(InvalidInput, match="3 measurements lie outside, the first at 2001-01-01T00:01:00Z"):
        with_ins(read_track(ship), short)
    counted = write(tmp_path / "s.csv", "time,latitude,longitude", [(0, 9, 9), (9, 9, 9)])
    with pytest.raises(InvalidInput, match="dates and times in both"):
        with_ins(read_track(ship), counted)
    rare = [("2000-12-31T23:00:00Z", 9, 9), ("2001-01-01T01:00:00Z", 9, 9)]
    with pytest.raises(InvalidInput, match="no position for 7200 s"):
        with_ins(read_track(ship), write(tmp_path / "r.csv", "time,latitude,longitude", rare))


def test_means_over_blocks_are_those_of_numpy(tmp_path):
    rng = np.random.default_rng(3)
    rows = [
        (10 * k, 20 + k / 100, 150 + k / 50, rng.normal(), 100 + k) for k in range(13) if k not in (4, 5, 6)
    ]
    track = read_track(write(tmp_path / "t.csv", HEAD + ",sigma_m", rows))
    means = averaged(track, 30.0)
    blocks = [(0, 1, 2), (3,), (7, 8), (9, 10, 11), (12,)]
    table = {row[0] // 10: row for row in rows}
    expected = np.array([np.mean([table[k] for k in block], axis=0) for block in blocks])
    np.testing.assert_allclose(means.track.time, expected[:, 0])
    np.testing.assert_allclose(np.degrees(means.track.latitude), expected[:, 1])
    np.testing.assert_allclose(np.degrees(means.track.longitude), expected[:, 2])
    np.testing.assert_allclose(means.track.measured, expected[:, 3])
    np.testing.assert_allclose(means.position_sigma, expected[:, 4])
    assert means.notes[-1] == "10 samples averaged over 30 s to 5"


def test_the_heading_is_kept_and_averaged_as_an_angle(tmp_path):
    rows = [(0, 20, 150, 1, 350), (10, 20, 150, 2, 20), (60, 20, 150, 3, -90), (70, 20, 150, 4, 270)]
    track = read_track(write(tmp_path / "t.csv", HEAD + ",heading", rows))
    np.testing.assert_allclose(np.degrees(track.track.heading), [350, 20, 270, 270])
    np.testing.assert_allclose(np.degrees(averaged(track, 60.0).track.heading), [5.0, 270.0])
    np.testing.assert_allclose(np.degrees(between(track, start="60").track.heading), [270, 270])
    ins = write(
        tmp_path / "i.csv", "time,latitude,longitude,heading", [(0, 20, 150, 350), (100, 20, 150, 10)]
    )
    other = with_ins(read_track(write(tmp_path / "o.csv", HEAD, [(50, 20, 150, 1), (75, 20, 150, 2)])), ins)
    np.testing.assert_allclose(np.degrees(other.track.heading), [0.0, 5.0], atol=1e-9)
    assert read_track(write(tmp_path / "n.csv", HEAD, ROWS)).track.heading is None


def test_spans_and_gaps(tmp_path):
    track = read_track(write(tmp_path / "t.csv", HEAD, ROWS))
    assert len(between(track, start="2017-09-11T16:50:00+02:00")) == 2
    assert len(between(track, stop="60")) == 2
    assert between(track) is track
    with pytest.raises(InvalidInput, match="no sample lies there"):
        between(track, start="2018-01-01")
    with pytest.raises(InvalidInput, match="--until"):
        between(track, stop="noon")
    times = [0, 60, 120, 1000, 1060, 9000, 9060, 9120]
    long = read_track(write(tmp_path / "g.csv", HEAD, [(t, 20, 150, t / 100) for t in times]))
    assert [(gap.sample, gap.seconds) for gap in gaps(long)] == [(2, 880.0), (4, 7940.0)]
    part, first = after_last_gap(long, 900.0)
    assert (first, len(part)) == (5, 3)
    assert after_last_gap(long, 8000.0) == (long, 0)
