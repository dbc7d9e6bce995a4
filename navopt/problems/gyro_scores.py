"""Errors of a calibration against the truth, with what the norm of a rate can see told apart."""

from __future__ import annotations

import numpy as np

from navopt.models.earth import EARTH_RATE, GRAVITY
from navopt.models.imu_calibration import ImuCalibration
from navopt.models.triad import DEGREE_PER_HOUR, SensorTriad

__all__ = ["direction_words", "imu_scores", "triad_scores"]

_PAIRS = (("xy", "yx", "z"), ("xz", "zx", "y"), ("yz", "zy", "x"))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _difference(estimated: SensorTriad, true: SensorTriad) -> tuple[np.ndarray, np.ndarray]:
    """D and d of ``estimated x = D true x + d``."""
    inverse = np.linalg.inv(estimated.matrix)
    return inverse @ true.matrix, inverse @ (true.scale * true.bias - estimated.scale * estimated.bias)


def _rotation(matrix: np.ndarray) -> np.ndarray:
    """Rotation nearest to a matrix."""
    u, _, v = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v


def _angle(rotation: np.ndarray) -> float:
    """Angle of a rotation, rad; exact for small ones."""
    axis = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    return float(np.arctan2(np.linalg.norm(axis), 0.5 * (np.trace(rotation) - 1.0)))


def triad_scores(estimated: SensorTriad, true: SensorTriad) -> dict[str, float]:
    """Errors of a gyro triad.

    Parameters
    ----------
    estimated, true : SensorTriad
        What was found, and what is.

    Returns
    -------
    dict of str to float
        ``rate_error_deg_h``: root mean square over all attitudes of the error that the calibration leaves in
        a measurement of the Earth rate, °/h, vector length. ``own_frame_rate_error_deg_h``: the same after
        the best rotation of the body axes, which is what the norm of the Earth rate can bring down.
        ``frame_rotation_urad``: that rotation. ``scale_error_ppm``, ``bias_error_deg_h``,
        ``misalignment_error_urad``: root mean square over the axes or elements, as printed in tables;
        ``symmetric_misalignment_error_urad``: of the three sums of opposite elements.
    """
    change, shift = _difference(estimated, true)
    spread = EARTH_RATE**2 / 3.0
    own = np.linalg.svd(change, compute_uv=False) - 1.0
    total = np.sqrt(spread * np.sum((change - np.eye(3)) ** 2) + shift @ shift)
    own_frame = np.sqrt(spread * own @ own + shift @ shift)
    error = estimated.misalignment - true.misalignment
    opposite = (error + error.T)[np.triu_indices(3, 1)]
    return {
        "rate_error_deg_h": float(total) / DEGREE_PER_HOUR,
        "own_frame_rate_error_deg_h": float(own_frame) / DEGREE_PER_HOUR,
        "frame_rotation_urad": 1e6 * _angle(_rotation(change)),
        "scale_error_ppm": 1e6 * _rms(estimated.scale / true.scale - 1.0),
        "bias_error_deg_h": _rms(estimated.bias - true.bias) / DEGREE_PER_HOUR,
        "misalignment_error_urad": 1e6 * _rms(estimated.vector[6:] - true.vector[6:]),
        "symmetric_misalignment_error_urad": 1e6 * _rms(opposite),
    }


def imu_scores(estimated: ImuCalibration, true: ImuCalibration) -> dict[str, float]:
    """Errors of gyros and accelerometers calibrated together.

    Parameters
    ----------
    estimated, true : ImuCalibration
        What was found, and what is.

    Returns
    -------
    dict of str to float
        Those of `triad_scores` for the gyros; ``accelerometer_scale_error_ppm``,
        ``accelerometer_bias_error_ug`` and ``accelerometer_misalignment_error_urad`` likewise; and
        ``relative_rotation_urad``: how far the gyros are turned against the accelerometers, which is what a
        navigator feels of the rotations, for it finds its attitude with both.
    """
    rate, _ = _difference(estimated.gyro, true.gyro)
    force, _ = _difference(estimated.accelerometer, true.accelerometer)
    a, b = estimated.accelerometer, true.accelerometer
    return {
        **triad_scores(estimated.gyro, true.gyro),
        "accelerometer_scale_error_ppm": 1e6 * _rms(a.scale / b.scale - 1.0),
        "accelerometer_bias_error_ug": 1e6 * _rms(a.bias - b.bias) / GRAVITY,
        "accelerometer_misalignment_error_urad": 1e6 * _rms(a.vector[6:] - b.vector[6:]),
        "relative_rotation_urad": 1e6 * _angle(_rotation(rate) @ _rotation(force).T),
    }


def direction_words(coefficients: dict[str, float], prefixes: tuple[str, ...]) -> str:
    """Say what a combination of misalignments is, in words, if it is a rotation of the body axes.

    Parameters
    ----------
    coefficients : dict of str to float
        Weight of each parameter, equal weights meaning equal angles.
    prefixes : tuple of str
        What stands before the names of each triad: ``("",)`` or ``("", "accelerometer_")``.

    Returns
    -------
    str
        For instance ``"rotation of the gyro frame about z"``; empty if it is something else.
    """
    turns = np.zeros((len(prefixes), 3))
    explained = 0.0
    for row, prefix in enumerate(prefixes):
        for upper, lower, axis in _PAIRS:
            one = coefficients.get(f"{prefix}misalignment_{upper}", 0.0)
            other = coefficients.get(f"{prefix}misalignment_{lower}", 0.0)
            # a right-handed rotation adds to xy, yz and zx and takes from the others
            turns[row, "xyz".index(axis)] = 0.5 * (one - other) * (-1.0 if upper == "xz" else 1.0)
            explained += 0.5 * (one - other) ** 2
    total = sum(value**2 for value in coefficients.values())
    if not total or explained < 0.99 * total:
        return ""
    moved = [row for row in range(len(prefixes)) if np.abs(turns[row]).max() > 0.05]
    if len(moved) == 2 and np.abs(turns[0] - turns[1]).max() > 0.05 * np.abs(turns).max():
        return ""
    size = np.abs(turns[moved[0]])
    axes = [axis for axis, value in zip("xyz", size, strict=True) if value > 0.05 * size.max()]
    frame = ("gyro frame", "accelerometer frame")[moved[0]] if len(moved) == 1 else "frame of the whole unit"
    return f"rotation of the {frame} about {' and '.join(axes)}"
