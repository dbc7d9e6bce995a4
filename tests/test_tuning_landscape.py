"""The ridge of the error and the minimum of the likelihood; the timing command."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import navopt
from comparisons import cli, filter_speed
from comparisons.tuning_landscape import landscape_picture, tuning_landscape
from navopt.errors import NoTruth, UnsuitableProblem
from navopt.problems import NoiseTuning


def test_the_error_is_a_ridge_and_the_likelihood_is_not() -> None:
    world = navopt.simulate("pushing-distance", 0)
    land = tuning_landscape(world, points=21)
    # exactly: q, r and the prior times one number leave the gain
    for k in range(-15, 16, 5):
        along = np.diagonal(land.error, k)
        assert np.allclose(along, along[0], rtol=1e-9)
    assert land.level_decades == pytest.approx(6.0, abs=0.02)
    assert 0.1 < land.ratio_decades < 2.0
    assert 0.0 < land.likelihood_level_decades < 0.3
    assert 0.0 < land.likelihood_ratio_decades < 1.0
    best = np.unravel_index(np.argmin(land.deviance), land.deviance.shape)
    assert abs(land.log10_q[best[0]] - world.true_x[0]) <= 0.31
    assert abs(land.log10_r[best[1]] - world.true_x[1]) <= 0.31
    figure = landscape_picture(world, land)
    assert [axes.get_title(loc="left") for axes in figure.axes[:2]] == [
        "Error against the truth",
        "Likelihood of the innovations",
    ]


def test_what_has_no_landscape_is_refused() -> None:
    F, H = np.eye(2), np.array([[1.0, 0.0]])
    with pytest.raises(NoTruth, match="true states"):
        tuning_landscape(NoiseTuning(F, H, np.arange(9.0), P0=np.eye(2)))
    with pytest.raises(UnsuitableProblem, match="log10_q_0"):
        tuning_landscape(navopt.simulate("noise-tuning", 0, steps=20, axes=2, covariance="diagonal"))


def test_the_timing_agrees_with_its_peers_and_prints(monkeypatch) -> None:
    pytest.importorskip("filterpy")
    pytest.importorskip("statsmodels")
    small = [
        filter_speed.FilterCase("two", 2, 1, 60, 1000.0, 50.0),
        filter_speed.FilterCase("five", 5, 2, 60, 200.0, 15.0),
    ]
    monkeypatch.setattr(filter_speed, "CASES", small)
    costs = filter_speed.filter_costs(population=9, repeats=1)
    for cost in costs:
        # far below what is meant: a busy machine must not fail the tests
        assert cost.filterpy > 20.0 * cost.ours > 0.0
    result = CliRunner().invoke(cli.app, ["bench", "filters", "--repeats", "1", "--no-compilation"])
    assert result.exit_code == 0, result.output
    assert "two" in result.output
    assert "1,000" in result.output
    assert "s a start" in result.output
    assert CliRunner().invoke(cli.app, ["bench", "filter"]).exit_code == 2
    assert CliRunner().invoke(cli.app, ["bench", "--repeats", "0"]).exit_code == 2
