"""Simulated worlds of `GravityMatching`: voyages over the embedded field, and what goes wrong on them.

Every purpose has its own random stream, so that a voyage meets the same INS and the same gravimeter noise
whether or not something else goes wrong as well.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from navopt.data.tracks import MeasuredTrack
from navopt.models.cruise import CruiseScenario, InsErrors, InsTrack
from navopt.models.earth import local_tangent_plane, principal_radii, to_geodetic
from navopt.models.field_map import FieldMap
from navopt.models.ins import error_basis, position_error_covariance, simulate_ins
from navopt.models.paths import simulate_ins_along
from navopt.models.random_field import random_field
from navopt.models.sins_error import segment_scale
from navopt.problem import stream
from navopt.problems.gravity_errors import eotvos_error
from navopt.problems.gravity_scenario import WorldScenario

if TYPE_CHECKING:
    from navopt.problems.gravity_matching import GravityMatching

__all__ = ["build_world"]

NAME = "gravity-matching"


def build_world(
    cls: type[GravityMatching],
    seed: int,
    noise_seed: int | None,
    *,
    box: str,
    method: str,
    loss: dict[str, Any],
    **keywords: Any,
) -> GravityMatching:
    """Build what `GravityMatching.simulate` promises.

    Parameters
    ----------
    cls : type
        `GravityMatching`.
    seed, noise_seed : int
        Of the world, and of another draw of its noise.
    box, method : str
        As for the class.
    loss : dict
        Keywords of the class that choose its loss.
    **keywords
        Fields of `WorldScenario`.

    Returns
    -------
    GravityMatching
    """
    scenario = WorldScenario(**keywords)
    window = scenario.window
    field, mapped, map_sigma, map_length = _field_and_map(scenario, seed, method)
    known: dict[str, Any] = {}
    if scenario.ins == "placed":
        track, known["prior_covariance"], true_x = _placed(scenario, seed)
    else:
        track, true_x = _inertial(scenario, seed), None
        known["position_covariance"] = _position_covariance(scenario, track)
        known["ins_errors"] = scenario.ins_sigmas
    gravimeter = scenario.gravimeter
    draw = 0 if noise_seed is None else noise_seed + 1
    measured = field.value(track.true_latitude, track.true_longitude) + gravimeter.draw_noise(
        len(track.time), stream("noise:" + NAME, seed, draw), stream("outliers:" + NAME, seed, draw)
    )
    if gravimeter.bias or gravimeter.drift_per_hour:
        measured = measured + gravimeter.draw_offset(track.time, stream("gravimeter:" + NAME, seed))
    if scenario.eotvos:
        measured = measured + eotvos_error(track.true_latitude, track.true_velocity, track.velocity_error)
    paper = box == "paper" and scenario.ins != "placed"
    world = cls(
        mapped,
        MeasuredTrack(
            time=track.time,
            latitude=track.latitude,
            longitude=track.longitude,
            measured=measured,
            true_latitude=track.true_latitude,
            true_longitude=track.true_longitude,
            heading=_indicated_heading(scenario, track),
        ),
        **known,
        measurement_errors=scenario.declare(map_sigma, map_length),
        window=window,
        box=box,
        scale_limit=_scale_limit(scenario, track) if paper else None,
        method=method,
        **loss,
    )
    if true_x is not None:
        true_x.setflags(write=False)
        object.__setattr__(world, "true_x", true_x)
    return world


def _inertial(scenario: WorldScenario, seed: int) -> InsTrack:
    """Voyage and INS; if published, one realisation for all worlds, as the paper's tables imply."""
    sigmas, times = scenario.ins_sigmas, scenario.times
    drawn = scenario.ins == "drawn"
    rng = stream("world:" + NAME, seed if drawn else 0)
    errors = sigmas.draw(rng) if drawn else sigmas
    if scenario.voyage == "straight":
        return simulate_ins(scenario.course, errors, times=times, rng=rng)
    path = scenario.path(stream("voyage:" + NAME, seed))
    return simulate_ins_along(path, errors, times=times, rng=rng)


def _indicated_heading(scenario: WorldScenario, track: InsTrack) -> np.ndarray | None:
    """Heading that the INS shows at the samples, rad; on a straight voyage its error to first order."""
    if scenario.ins == "placed":
        return None
    if track.heading is not None:
        return track.heading % (2.0 * np.pi)
    from navopt.models.track_errors import heading_error

    heading = np.full(len(track.time), scenario.course.azimuth)
    return heading + heading_error(
        track.time, track.true_latitude, track.true_longitude, heading, track.errors
    )


def _position_covariance(scenario: WorldScenario, track: InsTrack) -> np.ndarray:
    if scenario.voyage == "straight":
        times = tuple(track.time[-scenario.window :])
        return _straight_covariance(scenario.course, times, scenario.ins_sigmas)
    from navopt.models.track_errors import track_error_basis

    # what is on board: the errors about the track that the INS shows
    basis = track_error_basis(
        track.time, track.latitude, track.longitude, scenario.ins_sigmas, heading=track.heading
    )
    return basis.covariance()[-2 * scenario.window :, -2 * scenario.window :]


@lru_cache(maxsize=8)
def _straight_covariance(voyage: CruiseScenario, times: tuple[float, ...], sigmas: InsErrors) -> np.ndarray:
    """Covariance of the INS errors in the window, the same for all worlds of a scenario."""
    return position_error_covariance(_lengthened(voyage), times, sigmas)


def _lengthened(voyage: CruiseScenario) -> CruiseScenario:
    """Return the voyage to the end of its watch of four hours: windows of one watch share strapdown runs."""
    watch = 4 * 3600.0
    return replace(voyage, duration=watch * np.ceil(voyage.duration / watch))


def _scale_limit(scenario: WorldScenario, track: InsTrack) -> float:
    """S of eq. (24) with the velocity error of an INS whose sources are all at plus three sigma.

    The paper takes the true velocity error, which no vehicle has; this is the same formula with a
    figure known beforehand.
    """
    last = slice(-scenario.window, None)
    sigmas = scenario.ins_sigmas
    if scenario.voyage == "straight":
        velocity = error_basis(_lengthened(scenario.course), track.time[last]).velocity @ sigmas.vector
    else:
        from navopt.models.track_errors import track_error_basis

        alone = InsErrors.from_vector(sigmas.vector)
        basis = track_error_basis(track.time, track.latitude, track.longitude, alone, heading=track.heading)
        velocity = basis.velocity[last].sum(axis=-1)
    return float(segment_scale(track.velocity[last], 3.0 * velocity))


def _placed(scenario: WorldScenario, seed: int) -> tuple[InsTrack, np.ndarray, np.ndarray]:
    """Track that is the truth moved, turned and scaled; its prior, and the decision vector that undoes it."""
    times, last = scenario.times, slice(-scenario.window, None)
    if scenario.voyage == "straight":
        latitude, longitude = scenario.course.position(times)
        velocity = np.tile(scenario.course.velocity, (len(times), 1))
    else:
        latitude, longitude, velocity = scenario.path(stream("voyage:" + NAME, seed)).at(times)
    sigmas = scenario.placed_sigmas
    rng = stream("placed:" + NAME, seed)
    bearing, shift = rng.uniform(0.0, 2.0 * np.pi), sigmas[0] * rng.standard_normal(2)
    turn, scale = sigmas[1] * rng.standard_normal(), 1.0 + sigmas[2] * rng.standard_normal()
    if scenario.initial_error_m is not None:
        shift = scenario.initial_error_m * np.array([np.cos(bearing), np.sin(bearing)])
    if scenario.heading_error_deg is not None:
        turn = np.radians(scenario.heading_error_deg)
    if scenario.scale_error is not None:
        scale = scenario.scale_error
    # on the plane of the problem, which touches the ellipsoid where the inertial window has its centre
    centre = to_geodetic(shift[0], shift[1], latitude[last].mean(), longitude[last].mean())
    north, east = local_tangent_plane(latitude, longitude, *centre)
    back = np.array([north[last].mean(), east[last].mean()])
    north, east = (north - back[0]) / scale, (east - back[1]) / scale
    cosine, sine = np.cos(turn), np.sin(turn)
    shown = to_geodetic(cosine * north - sine * east, sine * north + cosine * east, *centre)
    track = InsTrack(
        time=times, latitude=shown[0], longitude=shown[1], velocity=velocity,
        true_latitude=latitude, true_longitude=longitude, true_velocity=velocity,
    )  # fmt: skip
    prior = np.diag(np.array([sigmas[0], sigmas[0], sigmas[1], sigmas[2]]) ** 2)
    return track, prior, np.array([*back, -turn, scale])


def _field_and_map(
    scenario: WorldScenario, seed: int, method: str
) -> tuple[FieldMap, FieldMap, float, float]:
    """True field, map to match, standard deviation (mGal) and correlation length (m) of the difference."""
    embedded = FieldMap.embedded(scenario.degree, method=method)
    error, length = scenario.map_error, float(scenario.map_error_length_m)
    if error is None:
        return embedded, embedded, 0.0, length
    if error == "degree-720":
        coarse = FieldMap.embedded(720, method=method)
        lacking = float(np.std(embedded.values - coarse.values))
        return embedded, coarse, lacking, _coarse_length(scenario.degree)
    drawn = random_field(
        embedded.shape, _steps(embedded), length, stream("map:" + NAME, seed), shape=scenario.map_error_shape
    )
    # a field of a few hundred patches: its standard deviation is made what was asked for
    drawn *= float(error) / drawn.std()
    erred = FieldMap(
        embedded.latitude,
        embedded.longitude,
        embedded.values + drawn,
        unit=embedded.unit,
        name=f"{embedded.name} with {error:g} mGal error",
        method=method,
    )
    pair = (erred, embedded) if scenario.map_error_in == "field" else (embedded, erred)
    return *pair, float(error), length


def _steps(field_map: FieldMap) -> tuple[float, float]:
    """Metres between the rows and between the columns, at the middle of the map."""
    middle = float(field_map.latitude.mean())
    meridian, prime_vertical = principal_radii(middle)
    _, _, _, rows, columns = field_map.grid
    return float(meridian * rows), float(prime_vertical * np.cos(middle) * columns)


@lru_cache(maxsize=2)
def _coarse_length(degree: int) -> float:
    """Distance (m) at which the correlation of what degree 720 lacks has fallen to 1/e."""
    finer = FieldMap.embedded(degree)
    lacking = finer.values - FieldMap.embedded(720).values
    if not lacking.any():
        return 10e3
    reach = 60
    lags = [
        np.mean(lacking[: -k or None] * lacking[k:]) + np.mean(lacking[:, : -k or None] * lacking[:, k:])
        for k in range(reach)
    ]
    fallen = np.array(lags) / lags[0] - np.exp(-1.0)
    first = int(np.argmax(fallen < 0.0))
    share = fallen[first - 1] / (fallen[first - 1] - fallen[first])
    return float(np.mean(_steps(finer)) * (first - 1 + share))
