"""Random fields, manoeuvring paths and the INS along them, against closed forms and a strapdown run."""

import numpy as np
import pytest
from scipy import stats

from navopt.errors import InvalidInput, NavoptError, UnknownName
from navopt.models.cruise import CruiseScenario, InsErrors
from navopt.models.earth import distance, rhumb_line
from navopt.models.ins import simulate_ins
from navopt.models.paths import Path, simulate_ins_along
from navopt.models.random_field import correlation, random_field

LEVEL = 0.001 / 3  # three statistical checks in this file


# -- random fields --------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ["gaussian", "exponential"])
def test_a_field_has_unit_variance_and_its_correlation_in_every_direction(shape):
    steps, length = (1500.0, 2000.0), 12e3
    lags = [(0, 0), (8, 0), (0, 6), (4, 3), (-4, 3), (16, 0), (0, 12)]
    draws = [
        random_field((90, 110), steps, length, np.random.default_rng(seed), shape=shape) for seed in range(60)
    ]
    for i, j in lags:
        d = np.hypot(i * steps[0], j * steps[1])
        expected = np.exp(-((d / length) ** 2)) if shape == "gaussian" else np.exp(-d / length)
        assert correlation(np.array(d), length, shape) == pytest.approx(expected)
        # the mean over a field is one number of a draw, so that sixty draws give their own error bar
        found = []
        for field in draws:
            a = field[max(0, -i) : 90 - max(0, i), : 110 - j]
            found.append(np.mean(a * field[max(0, i) : 90 - max(0, -i), j:]))
        spread = np.std(found, ddof=1) / np.sqrt(len(found))
        assert abs(np.mean(found) - expected) < stats.t.isf(LEVEL / 28, 59) * spread, (i, j)


def test_field_values_are_normal():
    values = [
        random_field((30, 30), (1e3, 1e3), 5e3, np.random.default_rng(seed))[[0, 29], [0, 29]]
        for seed in range(300)
    ]
    assert stats.kstest(np.ravel(values), stats.norm.cdf).pvalue > LEVEL


def test_a_field_repeats_with_its_seed_and_refuses_nonsense():
    arguments = ((20, 30), (1e3, 1e3), 4e3)
    first, again, other = (random_field(*arguments, np.random.default_rng(s)) for s in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()
    for broken in (((0, 3), (1.0, 1.0), 1.0), ((3, 3), (1.0, -1.0), 1.0), ((3, 3), (1.0, 1.0), 0.0)):
        with pytest.raises(InvalidInput):
            random_field(*broken, np.random.default_rng(0))
    with pytest.raises(UnknownName, match="gaussian"):
        random_field(*arguments, np.random.default_rng(0), shape="gausian")


# -- paths ---------------------------------------------------------------------------------------------


def test_one_leg_is_the_rhumb_line():
    path = Path.of_legs(0.35, 2.7, [[7200.0, 5.2, 7.7]])
    latitude, longitude = rhumb_line(0.35, 2.7, 5.2, 7.7 * path.time)
    assert distance(path.latitude, path.longitude, latitude, longitude).max() < 0.01
    assert path.duration == 7200.0


def test_legs_turn_and_speed_up_at_the_given_rates():
    rate, gain = np.radians(0.5), 0.02
    path = Path.of_legs(
        0.35, 2.7, [[1000.0, 6.2, 4.0], [2000.0, 0.1, 8.0]], step=1.0, turn_rate=rate, acceleration=gain
    )
    speed = np.hypot(*path.velocity.T)
    assert speed[999] == pytest.approx(4.0)
    assert speed[-1] == pytest.approx(8.0)
    assert np.diff(speed).max() == pytest.approx(gain)
    # from 355° to 6° by north, not the long way round
    turned = path.heading[-1] - path.heading[0]
    assert turned == pytest.approx(0.1 + 2 * np.pi - 6.2)
    assert np.abs(np.diff(path.heading)).max() == pytest.approx(rate)
    assert np.sum(np.diff(path.heading) > 0) == pytest.approx(turned / rate, abs=1.5)
    # the velocity is the derivative of the positions
    moved = distance(path.latitude[1:], path.longitude[1:], path.latitude[:-1], path.longitude[:-1])
    np.testing.assert_allclose(moved, 0.5 * (speed[1:] + speed[:-1]), atol=1e-3)


def test_a_path_through_positions_follows_them_and_their_noise_does_not_become_motion():
    rng = np.random.default_rng(3)
    true = Path.of_legs(0.4, 1.0, [[7200.0, 1.0, 5.0], [7200.0, 2.2, 5.0]])
    rows = np.arange(0.0, 14400.0, 60.0)
    latitude, longitude, _ = true.at(rows)
    noise = 5.0 / 6.4e6 * rng.standard_normal((2, len(rows)))
    path = Path.through(rows, latitude + noise[0], longitude + noise[1])
    lat, lon, velocity = true.at(path.time)
    assert distance(path.latitude, path.longitude, lat, lon).max() < 250.0  # at the corner
    straight = np.abs(path.time - 7200.0) > 600.0
    assert distance(path.latitude, path.longitude, lat, lon)[straight].max() < 15.0
    assert np.hypot(*(path.velocity - velocity)[straight].T).max() < 0.4
    assert np.hypot(*path.velocity[[0, -1]].T) == pytest.approx(5.0, abs=0.4)  # ends neither stop nor jump
    assert (
        np.degrees(np.abs(path.heading[straight] - np.where(path.time < 7200, 1.0, 2.2)[straight])).max() < 5
    )


def test_the_heading_is_held_where_the_ship_drifts():
    rows = np.arange(0.0, 10800.0, 60.0)
    north = np.cumsum(np.where((rows > 3600) & (rows < 7200), 0.0, 300.0)) / 6.4e6
    rng = np.random.default_rng(0)
    path = Path.through(rows, 0.4 + north, 1.0 + 2.0 / 6.4e6 * rng.standard_normal(len(rows)))
    assert np.degrees(np.abs(path.heading)).max() < 10.0


def test_the_ins_along_a_straight_path_is_that_of_the_strapdown_run():
    voyage = CruiseScenario(duration=4 * 3600.0)
    times = voyage.times(600.0)
    path = Path.of_legs(voyage.latitude, voyage.longitude, [[voyage.duration, voyage.azimuth, voyage.speed]])
    errors = InsErrors.published(noise=False)
    strapdown = simulate_ins(voyage, errors, times=times)
    along = simulate_ins_along(path, errors, times=times)
    np.testing.assert_allclose(along.position_error, strapdown.position_error, atol=10.0)
    np.testing.assert_allclose(along.velocity_error, strapdown.velocity_error, atol=0.01)
    assert np.hypot(*strapdown.position_error[-1]) > 8e3


def test_the_ins_shows_its_heading_with_its_own_error():
    path = Path.of_legs(0.35, 2.7, [[3600.0, 5.0, 7.0], [3600.0, 6.0, 5.0]])
    off = 0.01
    track = simulate_ins_along(path, InsErrors(attitude_error=(0.0, 0.0, off)), times=[0.0, 60.0])
    np.testing.assert_allclose(track.heading - np.interp(track.time, path.time, path.heading), off, rtol=0.02)
    # a gyro on the vertical axis turns the heading at its rate
    drift = 1e-6
    track = simulate_ins_along(path, InsErrors(gyro_bias=(0.0, 0.0, drift)), times=[0.0, 1800.0])
    shown = track.heading - np.interp(track.time, path.time, path.heading)
    np.testing.assert_allclose(shown, [0.0, 1800.0 * drift], atol=1e-5)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Path.of_legs(0.3, 0.0, []),
        lambda: Path.of_legs(0.3, 0.0, [[0.0, 1.0, 5.0]]),
        lambda: Path.of_legs(0.3, 0.0, [[60.0, 1.0, -5.0]]),
        lambda: Path.of_legs(0.3, 0.0, [[60.0, np.nan, 5.0]]),
        lambda: Path.of_legs(0.3, 0.0, [[60.0, 1.0, 5.0]], step=0.0),
        lambda: Path.of_legs(1.55, 0.0, [[36000.0, 0.0, 9.0]]),
        lambda: Path.through([0.0, 0.0], [0.1, 0.2], [0.0, 0.1]),
        lambda: Path.through([0.0, 60.0], [0.1, np.nan], [0.0, 0.1]),
        lambda: Path.through([0.0, 60.0, 600.0], [0.1] * 3, [0.2] * 3),
        lambda: Path.through([0.0, 60.0], [0.1, 0.2], [0.0, 0.1], step=100.0),
    ],
)
def test_unusable_paths_are_refused(make):
    with pytest.raises(NavoptError):
        make()
