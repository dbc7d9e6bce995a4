"""The compiled filters of heading-aided alignment: the general filters' numbers, failures, time."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from typer.testing import CliRunner

from comparisons import cli, unscented_speed
from navopt.errors import InvalidInput
from navopt.filters import (
    ExtendedFilter,
    HeadingFilter,
    HeadingInputs,
    NoiseAdaptation,
    StrongTracking,
    UnscentedFilter,
    filter_heading,
    filter_headings,
)
from navopt.models.azimuth_error import advance, alignment_process, azimuth_constants, heading_measurement
from navopt.models.enu_attitude import attitude_enu
from navopt.models.static_alignment import StaticSite

DEGREE = np.pi / 180.0
SIGMA = np.array([0.1, 0.1, 0.028 * DEGREE])
R = np.diag(SIGMA**2)
CONSTANTS = azimuth_constants(
    StaticSite(latitude=45.0 * DEGREE), attitude_enu(5.0 * DEGREE, -3.0 * DEGREE, 40.0 * DEGREE)
)


def covariances(with_heading: bool) -> tuple[np.ndarray, np.ndarray]:
    heading = [30 * DEGREE] if with_heading else []
    spread = [1, 1, DEGREE, DEGREE, 30 * DEGREE, *heading, *[9.8e-3] * 2, *[0.01 * DEGREE] * 3]
    noise = [5e-5] * 2 + [5e-4 * DEGREE] * (4 if with_heading else 3) + [0.0] * 5
    return np.diag(np.square(spread)), np.diag(np.square(noise))


def world(steps: int, seed: int = 0, azimuth_deg: float = 15.0) -> tuple[HeadingInputs, np.ndarray]:
    """Truth of eleven states at 100 Hz, measured at 10 Hz; heading from a quarter of a second on."""
    rng = np.random.default_rng(seed)
    x = np.array([0, 0, DEGREE, -DEGREE, azimuth_deg * DEGREE, 0, 5e-3, -5e-3, 1e-4, -1e-4, 1e-4])
    truth, z = np.empty((steps, 11)), np.full((steps, 3), np.nan)
    for k in range(steps):
        x[5] = heading_measurement(x, CONSTANTS)
        truth[k] = x
        if k % 10 == 0:
            z[k] = np.array([x[0], x[1], x[5]]) + SIGMA * rng.normal(size=3)
            if k < 25:
                z[k, 2] = np.nan
        x = advance(x, 0.01, CONSTANTS, True)
    # a heading is known up to full turns
    z[:, 2] = (z[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return HeadingInputs(0.01 * np.arange(steps), z, CONSTANTS), truth


def general(record: HeadingInputs, settings: HeadingFilter):
    """The same filter, of functions of Python."""
    n = len(settings.P0)
    H = np.zeros((3, n))
    H[0, 0] = H[1, 1] = 1.0
    if settings.heading == "state":
        H[2, 5] = 1.0

    def process(states, u, dt):
        return alignment_process(states, CONSTANTS, dt)

    def measure(states):
        headings = [heading_measurement(np.ascontiguousarray(x), CONSTANTS) for x in states]
        return np.stack([states[:, 0], states[:, 1], headings], axis=1)

    measurement = measure if settings.heading == "direct" else H
    z = record.measurements.copy()
    if settings.heading == "none":
        z[:, 2] = np.nan
    kept = {
        "Q": settings.Q, "R": settings.R, "P0": settings.P0, "angles": (2,), "strong": settings.strong,
        "adaptation": settings.adaptation, "covariance_update": settings.covariance_update,
    }  # fmt: skip
    if settings.variant == "ekf":
        return ExtendedFilter(process, measurement, **kept).run(record.times, z)
    kept |= {"variant": settings.variant, "alpha": settings.alpha}
    return UnscentedFilter(process, measurement, **kept).run(record.times, z)


@pytest.mark.parametrize("variant", ["ekf", "ukf", "srukf", "st-ukf", "sst-ukf"])
@pytest.mark.parametrize(("n", "heading"), [(10, "direct"), (11, "direct"), (11, "state"), (10, "none")])
def test_compiled_filters_give_the_numbers_of_the_general_ones(variant: str, n: int, heading: str) -> None:
    record, _ = world(200)
    P0, Q = covariances(n == 11)
    strong, adaptation = None, None
    if variant == "sst-ukf":
        strong = StrongTracking(cap=1.1, factors="multiple", states=(0, 1, 4), weakening=1.5)
    if variant == "st-ukf":
        strong = StrongTracking(factors="single")
    if variant in ("ukf", "st-ukf"):
        adaptation = NoiseAdaptation(kind="window" if variant == "ukf" else "sage-husa", window=10, burn_in=3)
    # without a heading the compiled filter takes the matrix of the velocities, the general one its points
    alpha = 1.0 if heading == "direct" else 1e-3
    settings = HeadingFilter(
        Q=Q, R=R, P0=P0, variant=variant, heading=heading, strong=strong, adaptation=adaptation, alpha=alpha
    )
    other = general(record, settings)
    run = filter_heading(record, pickle.loads(pickle.dumps(settings)), covariances=True)
    sigma = np.sqrt(np.einsum("kii->ki", other.covariances))
    assert run.failed is other.failed is None
    assert np.abs((run.estimates - other.estimates) / sigma).max() < 1e-9
    assert np.abs(run.deviations / sigma - 1.0).max() < 1e-9
    unit = sigma[:, :, None] * sigma[:, None, :]
    assert np.abs((run.covariances - other.covariances) / unit).max() < 1e-9
    assert np.allclose(run.innovations, other.innovations, rtol=1e-9, atol=1e-12, equal_nan=True)
    assert np.allclose(run.nis, other.nis, rtol=1e-9)
    assert np.allclose(run.fading_factors, other.fading_factors, rtol=1e-9, equal_nan=True)
    assert np.allclose(run.measurement_variances, other.measurement_variances, rtol=1e-9)
    assert run.log_likelihood == pytest.approx(other.log_likelihood, rel=1e-9)


def test_a_measured_heading_finds_the_azimuth_whatever_it_was() -> None:
    P0, Q = covariances(False)
    P0[4, 4] = (120 * DEGREE) ** 2
    for azimuth in (15.0, -90.0, 170.0):
        record, truth = world(500, azimuth_deg=azimuth)
        for variant in ("ukf", "srukf", "sst-ukf"):
            run = filter_heading(record, HeadingFilter(Q=Q, R=R, P0=P0, variant=variant, heading="direct"))
            assert run.failed is None
            error = run.estimates[-1, 4] - truth[-1, 4]
            error = (error + np.pi) % (2.0 * np.pi) - np.pi
            assert abs(error) < 5.0 * SIGMA[2]


def test_records_and_settings_are_filtered_one_by_one() -> None:
    P0, Q = covariances(True)
    records = [world(100, seed)[0] for seed in (1, 2)]
    settings = [
        HeadingFilter(Q=factor * Q, R=R, P0=P0, variant="sst-ukf", heading="state") for factor in (1.0, 10.0)
    ]
    runs = filter_headings(records, settings, thin=10)
    assert [len(row) for row in runs] == [2, 2]
    whole = filter_heading(records[1], settings[0])
    assert np.array_equal(runs[1][0].estimates, whole.estimates[::10])
    assert np.array_equal(runs[1][0].times, whole.times[::10])
    assert runs[1][0].covariances.shape == (0, 11, 11)
    assert runs[1][0].log_likelihood == whole.log_likelihood
    steps = HeadingFilter(Q=np.repeat(Q[None], 99, axis=0), R=R, P0=P0, variant="sst-ukf", heading="state")
    assert np.array_equal(filter_heading(records[1], steps).estimates, whole.estimates)
    each = HeadingInputs(records[1].times, records[1].measurements, np.repeat(CONSTANTS[None], 100, axis=0))
    assert np.array_equal(filter_heading(each, settings[0]).estimates, whole.estimates)


def test_the_printed_covariance_fails_here_too_and_says_so() -> None:
    P0, Q = covariances(True)
    record, _ = world(200)
    settings = HeadingFilter(
        Q=Q, R=R, P0=P0, variant="sst-ukf", heading="state", covariance_update="printed",
        strong=StrongTracking.published(),
    )  # fmt: skip
    run = filter_heading(record, settings)
    assert run.failed_step is not None
    assert run.failed == general(record, settings).failed
    assert "the covariance after the measurement is not positive definite" in str(run.failed)
    assert run.log_likelihood == -np.inf
    assert np.isfinite(run.estimates[: run.failed_step]).all()
    assert np.isnan(run.estimates[run.failed_step :]).all()


def test_bad_input_is_one_clear_error() -> None:
    P0, Q = covariances(True)
    good = {"Q": Q, "R": R, "P0": P0}
    for changed, message in (
        ({"R": np.diag([1.0, 1.0, 0.0])}, "variance must be positive"),
        ({"Q": -Q}, "must not be negative"),
        ({"P0": np.eye(9)}, "11 states, or 10"),
        ({"P0": np.eye(10), "Q": np.eye(10), "heading": "state"}, "11 states"),
        ({"variant": "kf"}, "variant"),
        ({"heading": "yes"}, "heading"),
        ({"alpha": -1.0}, "alpha"),
        ({"strong": StrongTracking()}, "sst-ukf"),
        ({"x0": np.zeros(10)}, "x0"),
    ):
        with pytest.raises(InvalidInput, match=message):
            HeadingFilter(**{**good, **changed})
    record, _ = world(20)
    t, z = record.times, record.measurements
    for arguments, message in (
        ((t[::-1], z, CONSTANTS), r"times\[1\].*increase"),
        ((t, z[:, :2], CONSTANTS), r"measurements.*\(20, 3\)"),
        ((t, z, CONSTANTS[:5]), r"constants.*\(22,\)"),
        ((t, z, np.full(22, np.nan)), "constants.*finite"),
        ((t, z, CONSTANTS, CONSTANTS[:5]), "measurement_constants"),
    ):
        with pytest.raises(InvalidInput, match=message):
            HeadingInputs(*arguments)
    with pytest.raises(InvalidInput, match=r"Q.*19 for 20 times"):
        filter_heading(record, HeadingFilter(**{**good, "Q": np.repeat(Q[None], 5, axis=0)}))
    with pytest.raises(InvalidInput, match="thin"):
        filter_heading(record, HeadingFilter(**good), thin=0)


def test_the_timing_prints(monkeypatch) -> None:
    pytest.importorskip("filterpy")
    costs = unscented_speed.unscented_costs(repeats=1, seconds=3.0, filterpy_seconds=0.4)
    by = {(cost.name, cost.every): cost for cost in costs}
    # far below what is meant: a busy machine must not fail the tests
    assert by["filterpy, UKF", 10].step > 5.0 * by["sst-ukf", 10].step > 0.0
    assert by["sst-ukf", 10].record == pytest.approx(150_000 * by["sst-ukf", 10].step)
    with pytest.raises(InvalidInput, match="seconds"):
        unscented_speed.unscented_costs(seconds=0.0)
    monkeypatch.setattr(unscented_speed, "unscented_costs", lambda repeats: costs)
    result = CliRunner().invoke(cli.app, ["bench", "unscented", "--repeats", "1"])
    assert result.exit_code == 0, result.output
    assert "sst-ukf" in result.output
    assert "1,500 s" in result.output
