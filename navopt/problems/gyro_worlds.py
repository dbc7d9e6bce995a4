"""Simulated worlds of `GyroCalibration`: gyros, a turntable record of them, positions in the field.

Every purpose has its own random stream, so that the gyros of a seed are the same whatever is done with
them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.imu_calibration import ImuCalibration
from navopt.models.positions import (
    earth_rate,
    positions_of,
    rate_positions,
    scattered_positions,
    specific_force,
)
from navopt.models.sensor_noise import AccelerometerNoise, GyroNoise
from navopt.models.triad import DEGREE_PER_HOUR, PARAMETER_NAMES, AccelerometerTriad, GyroTriad, SensorTriad
from navopt.models.turntable import fit_turntable
from navopt.problem import stream
from navopt.problems.gyro_parameters import ACCELEROMETER, chosen

if TYPE_CHECKING:
    from navopt.problems.gyro_calibration import GyroCalibration

__all__ = ["ACCELEROMETER_PRESET", "PAPER_NOISE", "PAPER_PRESET", "build_world", "built", "measured"]

NAME = "gyro-calibration"

PAPER_PRESET = GyroTriad.from_paper_units(
    [643.50373651, 645.62852456, 645.17583651],
    [
        [1.0, 0.00099183, 0.00010717],
        [-0.00037044, 1.0, 0.00014048],
        [0.00010505, -0.00041586, 1.0],
    ],
    [0.01562779, 0.03213767, 0.02793626],
)
"""Table 2 of Gao et al. (2015): what their turntable said of their gyros."""

PAPER_NOISE = GyroNoise.from_datasheet(deg_sqrt_h=0.0005, deg_h=0.005, ppm=10.0, deg_s=800.0)
"""Table 4 of Gao et al. (2015)."""

ACCELEROMETER_PRESET = AccelerometerTriad(np.full(3, 50000.0), np.eye(3), np.zeros(3))
"""Accelerometers of no particular make: 50,000 counts per m/s²."""

_ACCELEROMETER_NOISE = {"ug_sqrt_hz": 10.0, "ug": 10.0}
_ACCELEROMETER_BIAS_SPREAD = 500e-6 * 9.80665
_Triad = TypeVar("_Triad", GyroTriad, AccelerometerTriad)

_PROTOCOLS = ("random", "known", "paper")


def build_world(
    cls: type[GyroCalibration],
    seed: int,
    noise_seed: int | None,
    *,
    positions: Any,
    placement: str,
    latitude_deg: float,
    noise: Any,
    averaging_time_s: float,
    protocol: str,
    scale_spread_ppm: float,
    bias_spread_deg_h: float,
    misalignment_spread: float,
    turntable_positions: Any,
    turntable_rates_deg_s: Any,
    turntable_averaging_s: float | None,
    accelerometer_noise: Any,
    estimated: Any,
    loss: str,
    prior: bool,
    **others: Any,
) -> GyroCalibration:
    """Build what `GyroCalibration.simulate` promises; arguments as there.

    Returns
    -------
    GyroCalibration
    """
    if protocol not in _PROTOCOLS:
        raise UnknownName("protocol", protocol, _PROTOCOLS)
    if placement not in ("table", "scattered"):
        raise UnknownName("placement", placement, ("table", "scattered"))
    spread = {
        "scale": 1e-6 * scale_spread_ppm,
        "bias": bias_spread_deg_h * DEGREE_PER_HOUR,
        "misalignment": misalignment_spread,
    }
    for kind, size in spread.items():
        if not (np.isfinite(size) and size >= 0.0):
            raise InvalidInput(f"spread of {kind}", size, "give a half width, zero or more")
    gyro_noise = built("noise", noise, GyroNoise, PAPER_NOISE)
    latitude = float(np.radians(latitude_deg))
    forces = loss == "invariants"
    _, names, in_convention = chosen(estimated, accelerometers=forces, table=loss == "turntable")
    free = None if in_convention or protocol != "known" else names
    gyro = _draw(PAPER_PRESET, spread, stream("world:" + NAME, seed), free, "")
    # from one switch-on to the next the scale factors change
    stability = gyro_noise.scale_stability * stream("switch-on:" + NAME, seed).standard_normal(3)
    on_table = gyro.replace(scale=gyro.scale * (1.0 + stability)) if loss != "turntable" else gyro

    draw = 0 if noise_seed is None else noise_seed + 1
    table_attitudes = positions_of(turntable_positions, seed)
    table_rates = earth_rate(table_attitudes, latitude)
    if len(np.atleast_1d(turntable_rates_deg_s)):
        turning = rate_positions(np.radians(turntable_rates_deg_s), latitude)
        table_rates = np.concatenate([table_rates, turning])
    table_time = turntable_averaging_s or averaging_time_s

    def table_counts(which: int) -> np.ndarray:
        rng = stream("turntable-noise:" + NAME, seed, which)
        return measured(on_table, table_rates, gyro_noise, rng, table_time)

    fixed = PAPER_PRESET
    if protocol == "paper":
        # presets belong to the world: another draw of the noise leaves them, and the box, as they are
        sigma = gyro_noise.averaged_sigma(table_time)
        fixed, _ = fit_turntable(table_counts(0), table_rates, sigma)
    scattered = isinstance(positions, int | np.integer) and placement == "scattered"
    attitudes = scattered_positions(positions, seed) if scattered else positions_of(positions, seed)
    rates = earth_rate(attitudes, latitude)
    known: dict[str, Any] = {}
    truth: GyroTriad | ImuCalibration = gyro
    if forces:
        force_noise = built(
            "accelerometer_noise",
            _ACCELEROMETER_NOISE if accelerometer_noise is None else accelerometer_noise,
            AccelerometerNoise,
        )
        force_spread = {**spread, "bias": _ACCELEROMETER_BIAS_SPREAD}
        accelerometer = _draw(
            ACCELEROMETER_PRESET, force_spread, stream("accelerometers:" + NAME, seed), free, ACCELEROMETER
        )
        rng = stream("accelerometer-noise:" + NAME, seed, draw)
        known["accelerometer_counts"] = measured(
            accelerometer, specific_force(attitudes, latitude), force_noise, rng, averaging_time_s
        )
        known |= {"accelerometer_noise": force_noise, "fixed_accelerometer": ACCELEROMETER_PRESET}
        truth = ImuCalibration.of(gyro, accelerometer)
    if prior:
        known["prior"] = _prior(names, spread)
    return cls(
        measured(gyro, rates, gyro_noise, stream("noise:" + NAME, seed, draw), averaging_time_s),
        attitudes,
        latitude=latitude,
        noise=gyro_noise,
        averaging_time_s=averaging_time_s,
        fixed=fixed,
        estimated=estimated,
        loss=loss,
        turntable_counts=table_counts(draw),
        turntable_rates=table_rates,
        turntable_averaging_s=table_time,
        truth=truth,
        **known,
        **others,
    )


def built(argument: str, value: Any, kind: Any, default: Any = None) -> Any:
    """Return a noise model as it is, from a mapping of data-sheet figures, or the default for None.

    Parameters
    ----------
    argument : str
        Name, for the message.
    value : object
        What was given.
    kind : type
        `GyroNoise` or `AccelerometerNoise`.
    default : object
        Instead of None.

    Raises
    ------
    InvalidInput
        If it is none of these.
    """
    if value is None:
        return default
    if isinstance(value, kind):
        return value
    if isinstance(value, Mapping):
        try:
            return kind.from_datasheet(**value)
        except TypeError:
            raise InvalidInput(
                argument, dict(value), f"give the keywords of {kind.__name__}.from_datasheet"
            ) from None
    raise InvalidInput(argument, value, f"give a {kind.__name__} or a mapping of data-sheet figures")


def measured(
    triad: SensorTriad,
    x: np.ndarray,
    noise: GyroNoise | AccelerometerNoise,
    rng: np.random.Generator,
    time: float,
) -> np.ndarray:
    """Return averaged counts with noise on each sensor's own axis.

    Parameters
    ----------
    triad : SensorTriad
        The sensors.
    x : ndarray, shape (m, 3)
        True rates or specific forces.
    noise : GyroNoise or AccelerometerNoise
        Their noise.
    rng : numpy.random.Generator
        Its source.
    time : float
        Averaging time, s.

    Returns
    -------
    ndarray, shape (m, 3)

    Raises
    ------
    InvalidInput
        If a value is beyond the range of the sensors.
    """
    clean = x @ triad.misalignment.T + triad.bias + noise.draw(rng, len(x), time)
    if (np.abs(clean) >= noise.range).any():
        raise InvalidInput(
            "turntable_rates_deg_s", f"{np.degrees(np.abs(clean).max()):.4g} deg/s", "stay within the range"
        )
    return noise.quantise(triad.scale * clean)


def _draw(
    preset: _Triad,
    spread: Mapping[str, float],
    rng: np.random.Generator,
    names: list[str] | None,
    prefix: str,
) -> _Triad:
    """Parameters uniform about a preset; all of them, or those in `names` only."""
    half = np.concatenate(
        [spread["scale"] * preset.scale, np.full(3, spread["bias"]), np.full(6, spread["misalignment"])]
    )
    shift = half * rng.uniform(-1.0, 1.0, 12)
    if names is not None:
        shift = np.where([prefix + name in names for name in PARAMETER_NAMES], shift, 0.0)
    return preset.from_vector(preset.vector + shift)


def _prior(names: list[str], spread: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations of the uniform distributions from which the truth was drawn."""
    sigma = {}
    for name in names:
        accelerometer = name.startswith(ACCELEROMETER)
        bare = name.removeprefix(ACCELEROMETER)
        kind = bare.split("_")[0]
        size = spread[kind]
        if kind == "scale":
            preset = ACCELEROMETER_PRESET if accelerometer else PAPER_PRESET
            size *= float(preset.scale["xyz".index(bare[-1])])
        elif kind == "bias" and accelerometer:
            size = _ACCELEROMETER_BIAS_SPREAD
        sigma[name] = size / np.sqrt(3.0)
    return sigma
