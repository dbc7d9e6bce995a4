"""Heading from laser spots, its error budget, and the marks on the ground that check it."""

from __future__ import annotations

import numpy as np
import pytest

from navopt.errors import InvalidInput
from navopt.models.laser_spot import (
    LaserSpot,
    check_heading,
    ground_angle,
    ground_angle_sigma,
    simulate_spot_test,
)

DRAWS = 200_000
#: Band of a standard deviation from that many draws: 3.3 sigma of its own error, for one check in a thousand.
BAND = 3.3 / np.sqrt(2.0 * DRAWS)


def crossing(angle: float, offset: float, along: float) -> float:
    """Where the fan crosses a receiver `along` the axis of a machine turned by `angle`."""
    # the road is the line x = offset of a plane; the machine's axes in that plane
    forward, right = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    # along * forward + y * right must lie on x = offset
    return float((offset - along * forward[0]) / right[0])


@pytest.mark.parametrize("degrees", [-40.0, -3.0, 0.0, 0.05, 15.0, 60.0])
@pytest.mark.parametrize("offset", [0.0, 0.2])
def test_angle_is_that_of_the_geometry(degrees: float, offset: float) -> None:
    angle, device = np.radians(degrees), LaserSpot(spacing=1.6, road_heading=np.radians(170.0))
    rear, front = (crossing(angle, offset, y) for y in (-0.8, 0.8))
    assert abs(device.angle(rear, front) - angle) < 1e-14
    expected = (degrees + 170.0 + 180.0) % 360.0 - 180.0
    assert abs(np.degrees(device.heading(rear, front)) - expected) < 1e-12
    np.testing.assert_allclose(device.spots(angle, offset / np.cos(angle)), [rear, front], atol=1e-14)


def test_budget_is_the_spread_of_drawn_errors() -> None:
    device = LaserSpot(
        spacing=1.5, spot_sigma=4e-4, spacing_sigma=2e-3, mounting_sigma=2e-4, road_sigma=1e-4,
        road_heading=0.3,
    )  # fmt: skip
    angle, rng = np.radians(25.0), np.random.default_rng(1)
    rear, front = device.spots(angle)
    e = rng.standard_normal((4, DRAWS))
    readings = 5
    noise = device.spot_sigma * rng.standard_normal((2, readings, DRAWS))
    # the true distance between the receivers differs from the one that is used
    stretch = (device.spacing + device.spacing_sigma * e[0]) / device.spacing
    seen = device.angle(rear * stretch + noise[0], front * stretch + noise[1])
    single = seen[0] + device.mounting_sigma * e[1] + device.road_sigma * e[2]
    mean = seen.mean(axis=0) + device.mounting_sigma * e[1] + device.road_sigma * e[2]
    assert abs(single.std() / device.heading_sigma(angle) - 1.0) < BAND + 1e-3
    assert abs(mean.std() / device.heading_sigma(angle, readings) - 1.0) < BAND + 1e-3
    assert device.constant_sigma(angle) < device.heading_sigma(angle, 10**9) * (1.0 + 1e-6)


def test_defaults_make_the_papers_sigma() -> None:
    assert abs(np.degrees(LaserSpot().heading_sigma()) - 0.028) < 5e-4


def test_ground_angle_from_marks() -> None:
    # marks set out in a plane
    for degrees in (0.5, 12.0, 90.0, 150.0):
        a, b = 4.0, 5.0
        first, second = (
            np.array([a, 0.0]),
            b * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]),
        )
        angle = ground_angle(a, b, np.linalg.norm(first - second))
        assert abs(np.degrees(angle) - degrees) < 1e-9
    assert ground_angle(3.0, 3.0, 0.0) == 0.0


@pytest.mark.parametrize(("degrees", "b"), [(12.0, 5.0), (12.0, 4.0), (70.0, 3.0)])
def test_ground_budget_is_the_spread_of_drawn_errors(degrees: float, b: float) -> None:
    a, tape = 5.0, 5e-4
    c = np.sqrt(a * a + b * b - 2.0 * a * b * np.cos(np.radians(degrees)))
    e = tape * np.random.default_rng(2).standard_normal((3, DRAWS))
    drawn = ground_angle(a + e[0], b + e[1], c + e[2])
    assert abs(drawn.std() / ground_angle_sigma(a, b, c, tape) - 1.0) < BAND + 2e-3


def test_ground_budget_at_small_angles() -> None:
    small = ground_angle_sigma(5.0, 5.0, 2.0 * 5.0 * np.sin(0.5 * np.radians([0.0, 0.01])), 1e-3)
    np.testing.assert_allclose(small, 1e-3 / 5.0, rtol=1e-4)
    # unequal marks: a thousandth of a radian is hidden in the difference of the lengths
    assert ground_angle_sigma(5.0, 4.0, np.hypot(1.0, np.sqrt(20.0) * 1e-3), 1e-3) > 0.05


def test_experiment_of_the_paper() -> None:
    # one run of the paper has nine positions: over many, mean and sigma are what went in
    runs = [simulate_spot_test(np.random.default_rng(seed)) for seed in range(400)]
    assert all(len(r.truth) == 9 and (np.diff(np.sign(r.truth)) >= 0).all() for r in runs)
    means = np.degrees([r.mean for r in runs])
    sigma = np.hypot(LaserSpot().heading_sigma(), runs[0].ground_sigma)
    # of the mean of 400 means, and of the mean of 400 variances: 1 in 1000 together
    assert abs(means.mean() - 0.05) < 3.5 * np.degrees(sigma) / np.sqrt(9 * 400)
    variance = np.mean([r.sigma**2 for r in runs]) / sigma**2
    assert abs(variance - 1.0) < 3.5 * np.sqrt(2.0 / (8 * 400)) + 5e-3
    assert 0.02 < np.degrees(sigma) < 0.04
    quiet = simulate_spot_test(
        np.random.default_rng(1), receivers=LaserSpot(spot_sigma=0.0), tape_sigma=0.0, bias=np.radians(0.05)
    )
    assert abs(np.degrees(quiet.mean) - 0.05) < 1e-6
    assert quiet.sigma < 1e-7


def test_bad_input() -> None:
    with pytest.raises(InvalidInput, match="look like degrees"):
        check_heading("heading", [15.0, 16.0])
    with pytest.raises(InvalidInput, match="not finite"):
        check_heading("heading", [0.1, np.nan])
    assert np.isnan(check_heading("heading", [0.1, np.nan], gaps=True)[1])
    for changes, word in (({"spacing": 0.0}, "spacing"), ({"spot_sigma": -1e-3}, "spot_sigma"),
                          ({"road_heading": 15.0}, "degrees")):  # fmt: skip
        with pytest.raises(InvalidInput, match=word):
            LaserSpot(**changes)
    with pytest.raises(InvalidInput, match="one reading"):
        LaserSpot().heading_sigma(0.0, 0)
    with pytest.raises(InvalidInput, match="not finite"):
        LaserSpot().angle(np.nan, 0.0)
    with pytest.raises(InvalidInput, match="no triangle"):
        ground_angle(1.0, 1.0, 2.5)
    with pytest.raises(InvalidInput, match="positive"):
        ground_angle(0.0, 1.0, 1.0)
    with pytest.raises(InvalidInput, match="turns"):
        simulate_spot_test(np.random.default_rng(0), turns=0)
