"""Accelerometers and turntable of a calibration record, checked, and how invariants of noisy vectors err."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE, GRAVITY
from navopt.models.sensor_noise import AccelerometerNoise
from navopt.models.triad import AccelerometerTriad, GyroTriad, SensorTriad
from navopt.problems.gyro_checks import check_norms, check_record

__all__ = ["invariant_whitening", "noise_gain", "norm_sigma", "read_accelerometers", "read_turntable"]

Array = NDArray[np.float64]


def read_accelerometers(
    counts: Any, preset: AccelerometerTriad, noise: Any, positions: int, gravity: float, time: float
) -> tuple[Array, float]:
    """Check the output of accelerometers at rest.

    Parameters
    ----------
    counts : array_like, shape (positions, 3)
        Averaged output.
    preset : AccelerometerTriad
        What is assumed of them.
    noise : AccelerometerNoise
        Their noise.
    positions : int
        Number of positions of the gyros.
    gravity : float
        m/s^2.
    time : float
        Averaging time, s.

    Returns
    -------
    counts : ndarray, shape (positions, 3)
    sigma : float
        Noise of an averaged channel, m/s^2.

    Raises
    ------
    InvalidInput
        If the noise is missing, the record is broken, or its norm is nowhere near gravity.
    """
    if not isinstance(noise, AccelerometerNoise):
        raise InvalidInput(
            "accelerometer_noise", noise, "give a navopt.models.AccelerometerNoise with their counts"
        )
    sigma = noise.averaged_sigma(time)
    if not sigma > 0.0:
        raise InvalidInput("accelerometer_noise", noise, "declare a positive random walk or instability")
    record = check_record("accelerometer_counts", counts, preset, noise.range)
    if len(record) != positions:
        raise InvalidInput(
            "accelerometer_counts", record.shape, f"give one row for each of the {positions} positions"
        )
    norm = float(np.median(np.linalg.norm(preset.inverse(record), axis=1)))
    if not 0.5 < norm / gravity < 2.0:
        if 0.5 < norm < 2.0:
            remedy = f"are they multiples of g? Then multiply them by {GRAVITY}"
        else:
            remedy = "check the scale factors of `fixed_accelerometer`, and that the sensors were at rest"
        raise InvalidInput("accelerometer_counts", f"a median norm of {norm:.4g} m/s^2", remedy)
    return record, sigma


def read_turntable(
    counts: Any, rates: Any, preset: GyroTriad, limit: float
) -> tuple[Array | None, Array | None]:
    """Check a turntable record.

    Parameters
    ----------
    counts, rates : array_like, shape (k, 3), or None
        Averaged output and known rates, rad/s.
    preset : GyroTriad
        What is assumed of the gyros.
    limit : float
        Their range, rad/s.

    Returns
    -------
    counts, rates : ndarray, shape (k, 3), or None
        Both, or neither.

    Raises
    ------
    InvalidInput
        If one of the two is missing, the record is broken, or rates and counts do not go together.
    """
    if counts is None and rates is None:
        return None, None
    if counts is None or rates is None:
        raise InvalidInput("turntable_counts and turntable_rates", "one of them", "give both, or neither")
    record = check_record("turntable_counts", counts, preset, limit)
    reference = np.array(rates, dtype=float)
    if reference.shape != record.shape or not np.isfinite(reference).all():
        raise InvalidInput(
            "turntable_rates",
            f"shape {reference.shape}",
            f"give finite rates for each of the {len(record)} rows of turntable_counts",
        )
    # the table's rates against what the preset makes of the counts: only a wrong unit is so far off
    expected = float(np.median(np.linalg.norm(reference, axis=1)))
    if not expected > 0.0:
        raise InvalidInput("turntable_rates", "zero", "even a table at rest turns with the Earth")
    check_norms("turntable_counts against turntable_rates", preset.inverse(record), expected=expected)
    return record, reference


def noise_gain(triad: SensorTriad) -> float:
    """Trace of the covariance after E^-1 of three equal channels of unit variance: 3 if E is perfect."""
    return float(np.sum(np.linalg.inv(triad.misalignment) ** 2))


def norm_sigma(norm: float, sigma: float) -> float:
    """Standard deviation of the squared norm of a vector with noise `sigma` on each component."""
    return float(np.sqrt(4.0 * norm**2 * sigma**2 + 6.0 * sigma**4))


def invariant_whitening(gravity: float, product: float, rate: float, force: float) -> Array:
    """Return the matrix that whitens the three invariants of a position.

    Parameters
    ----------
    gravity : float
        Norm of the specific force, m/s^2.
    product : float
        Product of Earth rate and specific force, Omega g sin L.
    rate, force : float
        Noise of an averaged channel of each triad.

    Returns
    -------
    ndarray, shape (3, 3)
        Lower triangular; of (rate norm squared, force norm squared, product), whose errors are correlated:
        both norms and the product hang on the same noise.
    """
    a, b = rate**2, force**2
    covariance = np.array(
        [
            [norm_sigma(EARTH_RATE, rate) ** 2, 0.0, 2.0 * a * product],
            [0.0, norm_sigma(gravity, force) ** 2, 2.0 * b * product],
            [2.0 * a * product, 2.0 * b * product, gravity**2 * a + EARTH_RATE**2 * b + 3.0 * a * b],
        ]
    )
    # scale first: squares of rates and of forces are fifteen orders of magnitude apart
    size = np.sqrt(np.diag(covariance))
    root = np.linalg.cholesky(covariance / np.outer(size, size))
    return np.ascontiguousarray(np.linalg.inv(root) / size)
