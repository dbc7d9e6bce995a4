"""Stationary positions and what sensors feel there."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from navopt.errors import InvalidInput
from navopt.models import (
    attitude_from_euler,
    earth_rate,
    rate_positions,
    scattered_positions,
    six_positions,
    specific_force,
    twenty_four_positions,
)
from navopt.models.earth import EARTH_RATE, normal_gravity
from navopt.models.positions import check_attitudes, positions_of

LATITUDE = np.radians(45.75)
LEVEL = 0.001 / 2  # two statistical checks in this file


@pytest.mark.parametrize(
    "attitudes",
    [six_positions(), six_positions(0.3), twenty_four_positions(), twenty_four_positions(1.1)],
)
def test_table_positions_are_distinct_rotations(attitudes):
    np.testing.assert_allclose(
        attitudes @ np.swapaxes(attitudes, 1, 2), np.tile(np.eye(3), (len(attitudes), 1, 1)), atol=1e-15
    )
    np.testing.assert_allclose(np.linalg.det(attitudes), 1.0)
    assert len(np.unique(np.round(attitudes.reshape(-1, 9), 6), axis=0)) == len(attitudes)
    # an axis is vertical in each, as often up as down
    up = attitudes[:, :, 2]
    np.testing.assert_allclose(
        np.sort(np.abs(up), axis=1), np.tile([0.0, 0.0, 1.0], (len(up), 1)), atol=1e-15
    )
    np.testing.assert_allclose(up.sum(axis=0), 0.0, atol=1e-15)


def test_the_24_positions_make_a_design_with_orthogonal_columns():
    """Closed form: 8 Omega^2 for each axis, 24 for the offset, nothing between them."""
    design = np.c_[earth_rate(twenty_four_positions(), LATITUDE) / EARTH_RATE, np.ones(24)]
    np.testing.assert_allclose(design.T @ design, np.diag([8.0, 8.0, 8.0, 24.0]), atol=1e-12)


def test_a_pair_of_the_six_differs_along_the_vertical_axis_only():
    rates = earth_rate(six_positions(), LATITUDE)
    np.testing.assert_allclose(
        rates[::2] - rates[1::2], 2 * EARTH_RATE * np.sin(LATITUDE) * np.eye(3), atol=1e-18
    )


def test_euler_angles_agree_with_scipy():
    rng = np.random.default_rng(0)
    heading, pitch, roll = rng.uniform(-3, 3, (3, 50))
    # heading is clockwise seen from above: a negative turn about up; then pitch about x, roll about y
    body_to_nav = Rotation.from_euler("ZXY", np.stack([-heading, pitch, roll], axis=1))
    expected = np.swapaxes(body_to_nav.as_matrix(), 1, 2)
    np.testing.assert_allclose(attitude_from_euler(heading, pitch, roll), expected, atol=1e-12)


def test_signs_of_euler_angles():
    right, forward, up = attitude_from_euler(np.radians(90.0), 0.0, 0.0)
    np.testing.assert_allclose([forward, right, up], [[1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-15)
    assert attitude_from_euler(0.0, 0.1, 0.0)[1, 2] == pytest.approx(np.sin(0.1))  # nose up
    assert attitude_from_euler(0.0, 0.0, 0.1)[0, 2] == pytest.approx(-np.sin(0.1))  # right side down


def test_what_sensors_feel():
    attitudes = scattered_positions(40, 3)
    rates, forces = earth_rate(attitudes, LATITUDE), specific_force(attitudes, LATITUDE)
    gravity = float(normal_gravity(LATITUDE))
    np.testing.assert_allclose(np.linalg.norm(rates, axis=1), EARTH_RATE)
    np.testing.assert_allclose(np.linalg.norm(forces, axis=1), gravity)
    np.testing.assert_allclose(np.sum(rates * forces, axis=1), EARTH_RATE * gravity * np.sin(LATITUDE))
    level = attitude_from_euler(0.0, 0.0, 0.0)
    np.testing.assert_allclose(specific_force(level, 0.0), [0, 0, normal_gravity(0.0)])
    np.testing.assert_allclose(earth_rate(level, 0.0), [0, EARTH_RATE, 0], atol=1e-20)
    np.testing.assert_allclose(earth_rate(level, np.pi / 2), [0, 0, EARTH_RATE], atol=1e-19)


def test_scattered_positions_are_uniform_rotations():
    attitudes = scattered_positions(4000, 1)
    check_attitudes(attitudes)
    # an axis of a uniform rotation has uniform coordinates; its angle has density (1 - cos a)/pi
    assert stats.kstest(attitudes[:, 0, 2], stats.uniform(-1, 2).cdf).pvalue > LEVEL
    angle = np.arccos(np.clip((np.trace(attitudes, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert stats.kstest(angle, lambda a: (a - np.sin(a)) / np.pi).pvalue > LEVEL
    np.testing.assert_array_equal(attitudes[:5], scattered_positions(4000, 1)[:5])
    assert not np.array_equal(scattered_positions(5, 1), scattered_positions(5, 2))


def test_turntable_rates():
    rates = rate_positions([0.1, 1.0], LATITUDE)
    vertical = EARTH_RATE * np.sin(LATITUDE)
    assert rates.shape == (12, 3)
    np.testing.assert_allclose(rates[:4, 0], np.array([0.1, -0.1, 1.0, -1.0]) + vertical)
    assert (rates[:4, 1:] == 0).all()
    np.testing.assert_array_equal(rate_positions(0.5)[:, 0][:2], [0.5, -0.5])


def test_numbers_and_attitudes_are_taken_alike():
    np.testing.assert_array_equal(positions_of(24), twenty_four_positions())
    np.testing.assert_array_equal(positions_of(6), six_positions())
    np.testing.assert_array_equal(positions_of(7, 2), scattered_positions(7, 2))
    np.testing.assert_array_equal(positions_of(six_positions()), six_positions())


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: scattered_positions(0), "at least 1"),
        (lambda: earth_rate(2 * np.eye(3), 0.5), "no rotation"),
        (lambda: earth_rate(-np.eye(3), 0.5), "no rotation"),
        (lambda: earth_rate(np.ones(3), 0.5), "rotation matrices"),
        (lambda: earth_rate(np.eye(3), 45.75), "radians between"),
        (lambda: earth_rate(np.full((3, 3), np.nan), 0.5), "no rotation"),
        (lambda: rate_positions([-1.0]), "positive rates"),
    ],
)
def test_impossible_positions_are_refused(call, message):
    with pytest.raises(InvalidInput, match=message):
        call()
