"""Normalised squares, their bands and whiteness; a filter with the true covariances is consistent."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest, chi2

import navopt
from navopt.errors import InvalidInput
from navopt.filters import (
    BatchKalman,
    check_consistency,
    chi_square_band,
    ljung_box,
    normalised_squares,
    whitened,
)


def test_normalised_squares_are_the_quadratic_form() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(7, 3, 3))
    covariances, errors = root @ np.swapaxes(root, 1, 2), rng.normal(size=(7, 3))
    expected = [e @ np.linalg.inv(P) @ e for e, P in zip(errors, covariances, strict=True)]
    assert normalised_squares(errors, covariances) == pytest.approx(expected, rel=1e-9)
    # a missing entry leaves the form of the others
    errors[0, 1] = np.nan
    rest = np.ix_([0, 2], [0, 2])
    part = errors[0, [0, 2]]
    assert normalised_squares(errors, covariances)[0] == pytest.approx(
        part @ np.linalg.solve(covariances[0][rest], part)
    )
    assert np.isnan(whitened(errors, covariances)[0, 1])
    assert normalised_squares(np.full((1, 2), np.nan), np.full((1, 2, 2), np.nan)) == [0.0]


def test_bands_hold_their_probability() -> None:
    low, high = chi_square_band(2, 50, probability=0.9)
    mass = chi2.cdf(50 * high, 100) - chi2.cdf(50 * low, 100)
    assert mass == pytest.approx(0.9, rel=1e-9)
    assert low < 2.0 < high


@pytest.mark.parametrize("lags", [1, 10])
def test_ljung_box_equals_statsmodels(lags) -> None:
    diagnostic = pytest.importorskip("statsmodels.stats.diagnostic")
    rng = np.random.default_rng(2)
    series = np.convolve(rng.normal(size=205), [1.0, 0.2], "valid")
    theirs = diagnostic.acorr_ljungbox(series, lags=[lags])
    statistic, p = ljung_box(series, lags)
    assert statistic == pytest.approx(float(theirs["lb_stat"].iloc[0]), rel=1e-9)
    assert p == pytest.approx(float(theirs["lb_pvalue"].iloc[0]), rel=1e-9)


def test_nis_and_nees_of_the_true_covariances_follow_their_law() -> None:
    # 300 worlds; family of four checks, band of 0.001 / 4 for each
    number, outside, last = 300, {"nis": 0, "nees": 0}, []
    for seed in range(number):
        world = navopt.simulate("noise-tuning", seed, steps=40, missing_fraction=0.1)
        run = world.filter.run(world.truth.Q, world.truth.R)
        count = int(np.isfinite(run.innovations).sum())
        low, high = chi_square_band(1.0, count)
        outside["nis"] += not low <= run.nis[0].sum() / count <= high
        last.append(normalised_squares(run.estimates[0, -1] - world.truth.states[-1], run.covariances[0, -1]))
        low, high = chi_square_band(2.0)
        outside["nees"] += not low <= last[-1] <= high
    for name in outside:
        assert binomtest(outside[name], number, 0.05).pvalue > 0.001 / 4, (name, outside)
    low, high = chi_square_band(2.0, number, probability=1.0 - 0.001 / 4)
    assert low <= np.mean(last) <= high
    # wrong covariances are noticed
    wrong = world.filter.run(9.0 * world.truth.Q, 9.0 * world.truth.R)
    assert wrong.nis[0].sum() / count < chi_square_band(1.0, count)[0]


def test_consistency_of_a_run() -> None:
    world = navopt.simulate("noise-tuning", 3, steps=1000)
    Q, R = world.truth.Q, world.truth.R
    kalman = BatchKalman(world.model)
    right = kalman.run(Q, R)
    judged = check_consistency(right.innovations[0], right.innovation_covariances[0])
    assert judged.consistent
    assert judged.nis == pytest.approx(right.nis.sum() / 1000)
    # the same gain with covariances ten times too large: white but inconsistent
    large = kalman.run(10.0 * Q, 10.0 * R, P0=10.0 * world.model.P0)
    judged = check_consistency(large.innovations[0], large.innovation_covariances[0])
    assert not judged.consistent
    assert min(judged.whiteness) > 0.05
    assert judged.nis == pytest.approx(right.nis.sum() / 1e4)
    # a sluggish filter: not white
    slow = kalman.run(1e-4 * Q, R)
    assert max(check_consistency(slow.innovations[0], slow.innovation_covariances[0]).whiteness) < 1e-6


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: chi_square_band(0.0), "freedom: got 0.0"),
        (lambda: chi_square_band(1.0, 0), "count: got 0"),
        (lambda: chi_square_band(1.0, probability=1.0), "probability: got 1.0"),
        (lambda: ljung_box(np.ones(30)), "values: got constant"),
        (lambda: ljung_box(np.ones(5), 5), "values: got 5 values"),
        (lambda: whitened(np.ones(2), -np.eye(2)), "covariances: got not positive definite"),
        (lambda: whitened(np.ones(2), np.eye(3)), "covariances: got"),
        (lambda: check_consistency(np.full((2, 1), np.nan), np.ones((2, 1, 1))), "innovations: got all"),
    ],
)
def test_what_cannot_be_used_is_named(call, message) -> None:
    with pytest.raises(InvalidInput, match=message):
        call()
