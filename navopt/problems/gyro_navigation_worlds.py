"""Simulated worlds of `GyroNavigation`: what a turntable said, what became of it, and the journey after."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.navigation_alignment import attitude_matrix
from navopt.models.navigation_linear import SWAP, error_steps
from navopt.models.navigation_noise import RunErrors, draw_run_errors
from navopt.models.navigation_scenarios import LakeScenario, NavigationScenario, StaticScenario
from navopt.models.positions import (
    earth_rate,
    positions_of,
    rate_positions,
    scattered_positions,
    twenty_four_positions,
)
from navopt.models.sensor_noise import GyroNoise
from navopt.models.triad import DEGREE_PER_HOUR, GyroTriad
from navopt.models.turntable import fit_turntable
from navopt.problem import stream
from navopt.problems.gyro_parameters import chosen
from navopt.problems.gyro_worlds import PAPER_NOISE, PAPER_PRESET, built, measured

if TYPE_CHECKING:
    from navopt.problems.gyro_navigation import GyroNavigation

__all__ = ["build_navigation_world"]

NAME = "gyro-navigation"
#: Parts of the record from which the paper's way recalibrates.
STATIC_PARTS, MOORED_PARTS = 24, 10


def build_navigation_world(
    cls: type[GyroNavigation],
    seed: int,
    noise_seed: int | None,
    *,
    navigation: str,
    recalibration: str,
    positions: Any,
    placement: str,
    hours: float,
    duration_s: float,
    heading_deg: float | None,
    alignment: str,
    noise: Any,
    averaging_time_s: float,
    turntable_rates_deg_s: Any,
    aged_bias_deg_h: float,
    aged_scale_ppm: float,
    aged_misalignment: float,
    estimated: Any,
    prior: bool,
    **others: Any,
) -> GyroNavigation:
    """Build what `GyroNavigation.simulate` promises; arguments as there.

    Returns
    -------
    GyroNavigation
    """
    for argument, value, accepted in (
        ("navigation", navigation, ("static", "lake")),
        ("recalibration", recalibration, ("record", "positions")),
        ("placement", placement, ("table", "scattered")),
    ):
        if value not in accepted:
            raise UnknownName(argument, value, accepted)
    aged = np.repeat(
        [aged_scale_ppm * 1e-6, aged_bias_deg_h * DEGREE_PER_HOUR, aged_misalignment, aged_misalignment], 3
    )
    if not (np.isfinite(aged).all() and (aged >= 0.0).all()):
        raise InvalidInput("aged_*", aged.tolist(), "give standard deviations, zero or more")
    gyro_noise = built("noise", noise, GyroNoise, PAPER_NOISE)
    heading = stream("heading:" + NAME, seed).uniform(0.0, 360.0) if heading_deg is None else heading_deg
    # what changes from one switch-on to the next is drawn below, apart from the noise within a run
    within = replace(gyro_noise, bias_instability=0.0, scale_stability=0.0)
    journey = _journey(navigation, hours, duration_s, heading, alignment, within)

    # the turntable, with the gyros as the paper's Table 2 has them
    table = earth_rate(twenty_four_positions(), journey.latitude)
    if len(np.atleast_1d(turntable_rates_deg_s)):
        turning = rate_positions(np.radians(turntable_rates_deg_s), journey.latitude)
        table = np.concatenate([table, turning])
    sigma = gyro_noise.averaged_sigma(averaging_time_s)

    def table_counts(which: int) -> np.ndarray:
        rng = stream("turntable-noise:" + NAME, seed, which)
        return measured(PAPER_PRESET, table, gyro_noise, rng, averaging_time_s)

    preset, covariance = fit_turntable(table_counts(0), table, sigma)
    gyro = _changed(PAPER_PRESET, aged, stream("ageing:" + NAME, seed))
    run = np.concatenate([np.full(3, gyro_noise.scale_stability), np.full(3, gyro_noise.bias_instability)])
    today = _changed(gyro, np.concatenate([run, np.zeros(6)]), stream("switch-on:" + NAME, seed))

    draw = 0 if noise_seed is None else noise_seed + 1
    own = draw_run_errors(journey, 1, int(stream("run:" + NAME, seed, draw).integers(2**31)))
    if recalibration == "record":
        rng = stream("mooring:" + NAME, seed, draw)
        counts, attitudes, time, own = _record(navigation, journey, today, within, own, rng)
        truth, known_noise, spread = today, within, np.hypot(aged, np.concatenate([run, np.zeros(6)]))
    else:
        scattered = isinstance(positions, int | np.integer) and placement == "scattered"
        attitudes = scattered_positions(positions, seed) if scattered else positions_of(positions, seed)
        rates, time = earth_rate(attitudes, journey.latitude), averaging_time_s
        counts = measured(gyro, rates, gyro_noise, stream("noise:" + NAME, seed, draw), time)
        truth, known_noise, spread = gyro, gyro_noise, aged
        own = _with_switch_on(own, gyro, today)
    known, names, in_convention = chosen(estimated, accelerometers=False)
    if prior and not in_convention:
        size = np.array([*PAPER_PRESET.scale, *np.ones(9)]) * spread
        whole = covariance + np.diag(size**2)
        columns = [known.index(name) for name in names]
        others["prior"] = whole[np.ix_(columns, columns)]
    return cls(
        counts,
        attitudes,
        scenario=journey,
        run_errors=own,
        latitude=journey.latitude,
        noise=known_noise,
        averaging_time_s=time,
        fixed=preset,
        estimated=estimated,
        turntable_counts=table_counts(draw),
        turntable_rates=table,
        turntable_averaging_s=averaging_time_s,
        truth=truth,
        **others,
    )


def _journey(
    navigation: str, hours: float, duration_s: float, heading: float, alignment: str, noise: GyroNoise
) -> NavigationScenario:
    if navigation == "static":
        return StaticScenario(hours=hours, heading_deg=heading, alignment=alignment, gyro_noise=noise)
    tour = LakeScenario(duration_s=duration_s)
    turn = heading - tour.legs[0][1]
    legs = tuple((duration, course + turn, speed) for duration, course, speed in tour.legs)
    return LakeScenario(duration_s=duration_s, legs=legs, alignment=alignment, gyro_noise=noise)


def _changed(triad: GyroTriad, size: np.ndarray, rng: np.random.Generator) -> GyroTriad:
    """The triad with normal changes: relative of the scale factors, absolute of the rest."""
    unit = np.array([*triad.scale, *np.ones(9)])
    return GyroTriad.from_vector(triad.vector + unit * size * rng.standard_normal(12))


def _record(
    navigation: str,
    journey: NavigationScenario,
    today: GyroTriad,
    noise: GyroNoise,
    own: RunErrors,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, float, RunErrors]:
    """Counts of the record that is navigated, its attitude, the time of each part, and the run's errors."""
    steps = error_steps(journey)
    to_body = SWAP @ attitude_matrix(steps.heading).T @ SWAP
    if navigation == "static":
        parts = STATIC_PARTS
        white = own.white[0, :, :3]
        means = np.stack([part.mean(axis=0) for part in np.array_split(white, parts)])
        time = journey.duration / parts
    else:
        parts = MOORED_PARTS
        time = journey.alignment_s / parts
        means = noise.white / np.sqrt(time) * rng.standard_normal((parts, 3))
        # the alignment uses the same minutes
        alignment = own.alignment.copy()
        alignment[0, :3] = means.mean(axis=0)
        own = replace(own, alignment=alignment)
    # `means` are errors of the rate; the sensors' axes differ from the body's by milliradians only
    counts = today.forward(steps.start[:3] + means)
    return counts, np.repeat(to_body[None], parts, axis=0), time, own


def _with_switch_on(own: RunErrors, gyro: GyroTriad, today: GyroTriad) -> RunErrors:
    """The run's errors with what has changed since the recalibration, which does not know of it."""
    bias, scale = own.bias.copy(), own.scale.copy()
    bias[0, :3] += today.bias - gyro.bias
    scale[0] += today.scale / gyro.scale - 1.0
    return replace(own, bias=bias, scale=scale)
