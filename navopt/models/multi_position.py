"""Triads calibrated from static poses by a norm: gravity for accelerometers, the Earth rate for gyros.

In every pose the calibrated vector has a known length, whatever the attitude. That gives one equation per
pose and determines nine of the twelve parameters of a triad; a common rotation of the three sensors changes
no length. It is fixed by convention: the misalignment matrix is lower triangular, so that x is along the
first sensor and y in the plane of the first two. Where the specific force is known in the same axes, the
angle between Earth rate and vertical, fixed by the latitude, determines the three others of the gyros.

Residuals are ``(x @ x - tr(S) - n**2) / (2 n)``, with S the covariance of the calibrated mean: without the
trace, noise would make every vector too long. Each is divided by its own sigma, so that the Jacobian gives
the covariance of the parameters.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE
from navopt.models.triad import PARAMETER_NAMES, AccelerometerTriad, GyroTriad, SensorTriad
from navopt.models.triad_fit import PoseFit, birge, sandwich_sigma, triad_jacobian, undetermined

__all__ = ["PARAMETER_SETS", "calibrate_accelerometer", "calibrate_gyro_earth_rate", "sphere_start"]

_DIAGONAL = ("scale_x", "scale_y", "scale_z", "bias_x", "bias_y", "bias_z")
#: Sets of parameters that may be estimated from a norm.
PARAMETER_SETS: dict[str, tuple[str, ...]] = {
    "frame": (*_DIAGONAL, "misalignment_yx", "misalignment_zx", "misalignment_zy"),
    "scale-bias": _DIAGONAL,
    "bias": _DIAGONAL[3:],
}


def calibrate_accelerometer(
    counts: np.ndarray,
    gravity: float,
    sigma: np.ndarray,
    *,
    estimated: str = "frame",
    nominal: AccelerometerTriad | None = None,
) -> PoseFit:
    """Calibrate accelerometers from the mean samples of static poses.

    Parameters
    ----------
    counts : ndarray, shape (M, 3)
        Means.
    gravity : float
        Its magnitude, m/s2.
    sigma : ndarray, shape (M, 3)
        Standard errors of the means.
    estimated : str
        A key of `PARAMETER_SETS`; what is not estimated keeps its nominal value.
    nominal : AccelerometerTriad, optional
        What is believed without calibration; if not given, no bias, no misalignment and the one scale factor
        for all axes that fits the means best.

    Returns
    -------
    PoseFit
        Residuals in m/s2.

    Raises
    ------
    InvalidInput
        If there are too few poses, or poses that do not determine the parameters; these are named.
    """
    counts, sigma = _checked(counts, sigma, gravity)
    start = sphere_start(counts, gravity) if nominal is None else nominal
    believed = AccelerometerTriad(_one_scale(counts, gravity), np.eye(3), np.zeros(3))
    return _fit(
        counts,
        sigma,
        gravity,
        start if estimated != "bias" else believed if nominal is None else nominal,
        believed if nominal is None else nominal,
        _set(estimated),
        "m/s2",
        "norm of gravity in static poses",
    )


def calibrate_gyro_earth_rate(
    counts: np.ndarray,
    sigma: np.ndarray,
    nominal: GyroTriad,
    *,
    force: np.ndarray | None = None,
    latitude: float | None = None,
) -> PoseFit:
    """Calibrate gyros from the Earth's rotation in static poses.

    Parameters
    ----------
    counts : ndarray, shape (M, 3)
        Means.
    sigma : ndarray, shape (M, 3)
        Standard errors of the means.
    nominal : GyroTriad
        Where the search begins; within some per cent.
    force : ndarray, shape (M, 3), optional
        Calibrated specific force in the same poses. With `latitude` it makes all twelve parameters
        estimated, in the axes of the accelerometers.
    latitude : float, optional
        rad.

    Returns
    -------
    PoseFit
        Residuals in rad/s: of the norm, then of the rate along the vertical, if that is used.

    Raises
    ------
    InvalidInput
        If the noise is not well below the Earth rate, or the poses do not determine the parameters.
    """
    counts, sigma = _checked(counts, sigma, EARTH_RATE)
    noise = np.linalg.norm(sigma / np.abs(nominal.scale), axis=1)
    if np.median(noise) > 0.1 * EARTH_RATE:
        raise InvalidInput(
            "noise",
            f"{np.degrees(np.median(noise)) * 3600:.1f} deg/h in the mean of a pose",
            "it must be well below the Earth rate of 15.04 deg/h: use the rotations between the poses, or "
            "stay longer in each",
        )
    if force is None or latitude is None:
        return _fit(
            counts,
            sigma,
            EARTH_RATE,
            nominal,
            nominal,
            PARAMETER_SETS["frame"],
            "rad/s",
            "norm of the Earth rate",
        )
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    return _fit(
        counts,
        sigma,
        EARTH_RATE,
        nominal,
        nominal,
        PARAMETER_NAMES,
        "rad/s",
        "norm of the Earth rate and its angle to gravity",
        up=up,
        vertical=EARTH_RATE * float(np.sin(latitude)),
    )


def sphere_start(counts: np.ndarray, norm: float) -> AccelerometerTriad:
    """Return scale and biases of the sphere through the means, the same scale for all axes.

    Parameters
    ----------
    counts : ndarray, shape (M, 3)
        Means of static poses.
    norm : float
        What the radius stands for.

    Returns
    -------
    AccelerometerTriad
        Where poses do not fix the centre, the one nearest to zero.
    """
    size = np.abs(counts).max()
    scaled = counts / size
    design = np.hstack([2.0 * scaled, np.ones((len(counts), 1))])
    solution = np.linalg.lstsq(design, (scaled**2).sum(axis=1), rcond=1e-6)[0]
    centre = solution[:3]
    radius = np.sqrt(max(solution[3] + centre @ centre, 0.0))
    if radius < 1e-3:
        return AccelerometerTriad(_one_scale(counts, norm), np.eye(3), np.zeros(3))
    scale = radius * size / norm
    return AccelerometerTriad(np.full(3, scale), np.eye(3), centre * size / scale)


def _checked(counts: np.ndarray, sigma: np.ndarray, norm: float) -> tuple[np.ndarray, np.ndarray]:
    counts, sigma = np.asarray(counts, dtype=float), np.asarray(sigma, dtype=float)
    if counts.ndim != 2 or counts.shape[1] != 3 or sigma.shape != counts.shape:
        raise InvalidInput(
            "counts", f"{counts.shape}, {sigma.shape}", "give means and sigmas of shape (M, 3)"
        )
    if not np.isfinite(counts).all() or not (np.isfinite(sigma).all() and (sigma > 0).all()):
        raise InvalidInput("sigma", "values that are not finite and positive", "give the error of each mean")
    if not norm > 0:
        raise InvalidInput("--gravity", norm, "give the magnitude of gravity in m/s2, such as 9.81")
    return counts, sigma


def _one_scale(counts: np.ndarray, norm: float) -> np.ndarray:
    return np.full(3, np.sqrt(np.mean((counts**2).sum(axis=1))) / norm)


def _set(estimated: str) -> tuple[str, ...]:
    from navopt.errors import UnknownName

    if estimated not in PARAMETER_SETS:
        raise UnknownName("estimated", estimated, PARAMETER_SETS)
    return PARAMETER_SETS[estimated]


def _fit(
    counts: np.ndarray,
    sigma: np.ndarray,
    norm: float,
    start: SensorTriad,
    nominal: SensorTriad,
    names: tuple[str, ...],
    unit: str,
    method: str,
    *,
    up: np.ndarray | None = None,
    vertical: float = 0.0,
) -> PoseFit:
    """Gauss-Newton with damping (MINPACK) on whitened residuals."""
    from scipy.optimize import least_squares

    rows = len(counts) * (1 if up is None else 2)
    if rows < len(names):
        raise InvalidInput(
            "poses",
            f"{len(counts)} static poses for {len(names)} parameters",
            f"hold at least {len(names)} different poses, better 24, or estimate fewer than "
            f"{', '.join(names)}",
        )
    residual, stated, jacobian = _equations(counts, sigma, norm, up, vertical)
    triad = start
    whitening = stated(triad)
    order = [PARAMETER_NAMES.index(name) for name in names]

    def put(values: np.ndarray) -> SensorTriad:
        return triad.replace(**dict(zip(names, values, strict=True)))

    # a second round with the sigmas of the first: they hardly depend on the parameters
    for _ in range(2):
        first = triad.vector[order]
        size = np.where([name.startswith("scale") for name in names], np.abs(first), 1.0)

        def equations(v: np.ndarray, size: np.ndarray = size, sigmas: np.ndarray = whitening) -> np.ndarray:
            return residual(put(v * size)) / sigmas

        def slopes(v: np.ndarray, size: np.ndarray = size, sigmas: np.ndarray = whitening) -> np.ndarray:
            return jacobian(put(v * size), names) * size / sigmas[:, None]

        found = least_squares(
            equations,
            first / size,
            jac=slopes,
            method="lm",
            x_scale="jac",
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
        )
        triad = put(found.x * size)
        whitening = stated(triad)
    whitened = jacobian(triad, names) / whitening[:, None]
    missing, covariance = undetermined(whitened, names, triad.scale, norm)
    if missing:
        _refuse(counts, missing, triad)
    after = residual(triad)
    chi_square = float(((after / whitening) ** 2).sum())
    degrees = rows - len(names)
    return PoseFit(
        triad=triad,
        names=names,
        covariance=covariance * birge(chi_square, degrees) ** 2,
        sandwich=sandwich_sigma(whitened, after / whitening, covariance),
        before=residual(nominal),
        after=after,
        stated=whitening,
        unit=unit,
        chi_square=chi_square,
        degrees_of_freedom=degrees,
        method=method,
    )


_Equations = tuple[
    Callable[[SensorTriad], np.ndarray],
    Callable[[SensorTriad], np.ndarray],
    Callable[[SensorTriad, tuple[str, ...]], np.ndarray],
]


def _equations(
    counts: np.ndarray, sigma: np.ndarray, norm: float, up: np.ndarray | None, vertical: float
) -> _Equations:
    """Residuals, their sigmas and their derivative as functions of a triad."""

    def residual(triad: SensorTriad) -> np.ndarray:
        x = triad.inverse(counts)
        inverse = np.linalg.inv(triad.matrix)
        trace = (sigma**2) @ (inverse**2).sum(axis=0)
        length = ((x**2).sum(axis=1) - trace - norm**2) / (2.0 * norm)
        return length if up is None else np.concatenate([length, (x * up).sum(axis=1) - vertical])

    def stated(triad: SensorTriad) -> np.ndarray:
        inverse = np.linalg.inv(triad.matrix)
        directions = [triad.inverse(counts) / norm] + ([] if up is None else [up])
        return np.concatenate(
            [np.sqrt((((direction @ inverse) * sigma) ** 2).sum(axis=1)) for direction in directions]
        )

    def jacobian(triad: SensorTriad, names: tuple[str, ...]) -> np.ndarray:
        x = triad.inverse(counts)
        change = triad_jacobian(triad, x, names)
        parts = [x / norm] + ([] if up is None else [up])
        return np.concatenate([np.einsum("mi,mik->mk", part, change) for part in parts])

    return residual, stated, jacobian


def _refuse(counts: np.ndarray, missing: tuple[str, ...], triad: SensorTriad) -> None:
    """Name what the poses leave open, and the poses that would help."""
    x = triad.inverse(counts) if np.isfinite(triad.vector).all() else counts
    direction = x / np.linalg.norm(x, axis=1, keepdims=True)
    spread = direction - direction.mean(axis=0)
    values, vectors = np.linalg.eigh(spread.T @ spread / len(counts))
    axis = "xyz"[int(np.argmax(np.abs(vectors[:, 0])))]
    shape = "lie near one plane" if values[0] < 0.02 else "are too much alike"
    raise InvalidInput(
        "poses",
        f"{len(counts)} static poses that {shape}",
        f"they do not determine {', '.join(missing)}: add poses with the {axis} axis up, down and "
        "slanted, or estimate fewer parameters",
    )
