"""Simulated worlds of `GravityMatching`: the voyage of paper 003 over the embedded gravity field."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import SEMI_MAJOR_AXIS
from navopt.models.field_map import FieldMap
from navopt.models.ins import (
    CruiseScenario,
    InsErrors,
    error_basis,
    position_error_covariance,
    simulate_ins,
)
from navopt.models.sins_error import segment_scale
from navopt.problem import stream

if TYPE_CHECKING:
    from navopt.problems.gravity_matching import GravityMatching

__all__ = ["build_world"]

NAME = "gravity-matching"
#: Correlation length of a simulated map error, m: wider than a cell, narrower than a track.
MAP_ERROR_LENGTH = 10e3


def build_world(
    cls: type[GravityMatching],
    seed: int,
    noise_seed: int | None,
    *,
    hours: float,
    degree: int,
    map_error: float | str | None,
    ins: str,
    noise_mgal: float,
    interval_s: float,
    window: int,
    criterion: str,
    box: str,
    method: str,
) -> GravityMatching:
    """Build what `GravityMatching.simulate` promises; arguments as there."""
    if not (np.isfinite(noise_mgal) and noise_mgal > 0):
        raise InvalidInput("noise_mgal", noise_mgal, "give a positive standard deviation")
    if not (np.isfinite(interval_s) and interval_s > 0):
        raise InvalidInput("interval_s", interval_s, "give a positive number of seconds")
    if not 0 < hours <= 16:
        raise InvalidInput("hours", hours, "give a time in (0, 16]: the map ends where the voyage does")
    if ins not in ("drawn", "published"):
        raise UnknownName("ins", ins, ("drawn", "published"))
    if isinstance(window, bool) or not isinstance(window, int | np.integer) or window < 3:
        raise InvalidInput("window", window, "give a whole number of samples, at least 3")
    voyage = CruiseScenario(duration=round(hours * 3600.0))
    times = voyage.times(interval_s)
    if len(times) < window:
        raise InvalidInput("hours", hours, f"{window} samples every {interval_s:g} s need a longer voyage")
    sigmas = InsErrors.published()
    if ins == "drawn":
        rng = stream("world:" + NAME, seed)
        track = simulate_ins(voyage, sigmas.draw(rng), times=times, rng=rng)
    else:
        # one realisation for all worlds, inertial noise included, as the paper's tables imply
        track = simulate_ins(voyage, sigmas, times=times, rng=stream("world:" + NAME, 0))
    true_map = FieldMap.embedded(degree, method=method)
    mapped, map_sigma = _map_with_error(true_map, map_error, seed, method)
    noise = stream("noise:" + NAME, seed, 0 if noise_seed is None else noise_seed + 1)
    measured = true_map.value(track.true_latitude, track.true_longitude)
    return cls(
        mapped,
        MeasuredTrack(
            time=times,
            latitude=track.latitude,
            longitude=track.longitude,
            measured=measured + noise_mgal * noise.standard_normal(len(times)),
            true_latitude=track.true_latitude,
            true_longitude=track.true_longitude,
        ),
        position_covariance=_window_covariance(voyage, tuple(times[-window:]), sigmas),
        noise=float(np.hypot(noise_mgal, map_sigma)),
        window=window,
        criterion=criterion,
        box=box,
        scale_limit=_scale_limit(voyage, times[-window:], track.velocity[-window:])
        if box == "paper"
        else None,
        method=method,
    )


@lru_cache(maxsize=8)
def _window_covariance(voyage: CruiseScenario, times: tuple[float, ...], sigmas: InsErrors) -> np.ndarray:
    """Covariance of the INS errors in the window, the same for all worlds of a scenario."""
    return position_error_covariance(voyage, times, sigmas)


def _scale_limit(voyage: CruiseScenario, times: np.ndarray, velocity: np.ndarray) -> float:
    """S of eq. (24) with the velocity error of an INS whose sources are all at plus three sigma.

    The paper takes the true velocity error, which no vehicle has; this is the same formula with a
    figure known beforehand.
    """
    basis = error_basis(voyage, times)
    return float(segment_scale(velocity, 3.0 * basis.velocity @ InsErrors.published().vector))


def _map_with_error(
    true_map: FieldMap, map_error: float | str | None, seed: int, method: str
) -> tuple[FieldMap, float]:
    """Map to match against, and the standard deviation of its error in mGal."""
    if map_error is None:
        return true_map, 0.0
    if map_error == "degree-720":
        coarse = FieldMap.embedded(720, method=method)
        return coarse, float(np.std(true_map.values - coarse.values))
    if isinstance(map_error, str) or not (np.isfinite(map_error) and map_error >= 0):
        raise InvalidInput("map_error", map_error, 'give a standard deviation in mGal, "degree-720" or None')
    from scipy.ndimage import gaussian_filter

    white = stream("map:" + NAME, seed).standard_normal(true_map.shape)
    metres = np.array(true_map.grid[3:]) * SEMI_MAJOR_AXIS
    # smoothing white noise with a kernel of sigma L/2 gives the correlation exp(-(d/L)²)
    field = gaussian_filter(white, MAP_ERROR_LENGTH / 2.0 / metres, mode="mirror")
    field *= map_error / field.std()
    erred = FieldMap(
        true_map.latitude,
        true_map.longitude,
        true_map.values + field,
        unit=true_map.unit,
        name=f"{true_map.name} with {map_error:g} mGal error",
        method=method,
    )
    return erred, float(map_error)
