"""Noise from data-sheet figures."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from navopt.errors import InvalidInput
from navopt.models import AccelerometerNoise, GyroNoise
from navopt.models.triad import DEGREE_PER_HOUR

LEVEL = 0.001 / 2  # two statistical checks in this file
FOG = GyroNoise.from_datasheet(deg_sqrt_h=0.0005, deg_h=0.005, ppm=10.0, deg_s=800.0)


def test_units_of_data_sheets():
    # 1 deg/sqrt(h) leaves 1 deg after an hour of integrating the rate
    walk = GyroNoise.from_datasheet(deg_sqrt_h=1.0)
    assert np.degrees(walk.angle_random_walk * np.sqrt(3600.0)) == pytest.approx(1.0)
    assert pytest.approx(0.005) == FOG.bias_instability / DEGREE_PER_HOUR
    assert (FOG.scale_stability, FOG.range) == pytest.approx((1e-5, np.radians(800.0)))
    force = AccelerometerNoise.from_datasheet(ug_sqrt_hz=100.0, ug=50.0, g=2.0)
    assert force.velocity_random_walk == pytest.approx(100 * 9.80665e-6)
    assert (force.bias_instability, force.range) == pytest.approx((50 * 9.80665e-6, 2 * 9.80665))


def test_averaging_brings_white_noise_down_to_the_instability():
    """Five minutes of 0.0005 deg/sqrt(h) are 1.73e-3 deg/h; the floor stays."""
    white = GyroNoise.from_datasheet(deg_sqrt_h=0.0005)
    assert white.averaged_sigma(300.0) / DEGREE_PER_HOUR == pytest.approx(0.0005 * np.sqrt(12.0))
    assert FOG.averaged_sigma(300.0) == pytest.approx(
        np.hypot(white.averaged_sigma(300.0), 0.005 * DEGREE_PER_HOUR)
    )
    assert FOG.averaged_sigma(1e12) == pytest.approx(FOG.bias_instability)


def test_draws_have_the_declared_size():
    drawn = FOG.draw(np.random.default_rng(1), 3000, 300.0) / FOG.averaged_sigma(300.0)
    assert drawn.shape == (3000, 3)
    low, high = stats.chi2.ppf([LEVEL / 2, 1 - LEVEL / 2], drawn.size)
    assert low < np.sum(drawn**2) < high
    assert stats.kstest(drawn[:, 1], "norm").pvalue > LEVEL
    np.testing.assert_array_equal(
        FOG.draw(np.random.default_rng(1), 3000, 300.0)[:2] * 1.0,
        FOG.averaged_sigma(300.0) * drawn[:2],
    )


def test_quantisation_rounds_counts():
    coarse = GyroNoise(angle_random_walk=1e-6, quantisation=0.5)
    np.testing.assert_array_equal(coarse.quantise([0.3, 0.2, -1.1]), [0.5, 0.0, -1.0])
    np.testing.assert_array_equal(FOG.quantise([0.3]), [0.3])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: GyroNoise(angle_random_walk=-1.0), "angle_random_walk"),
        (lambda: GyroNoise(angle_random_walk=np.nan), "angle_random_walk"),
        (lambda: AccelerometerNoise(velocity_random_walk=1.0, range=0.0), "range"),
        (lambda: GyroNoise(bias_instability="x"), "bias_instability"),
        (lambda: FOG.averaged_sigma(0.0), "averaging_time_s"),
    ],
)
def test_impossible_figures_are_refused(call, message):
    with pytest.raises(InvalidInput, match=message):
        call()
