"""Gyros calibrated from the rotations between static poses, for units whose noise hides the Earth rate.

Between two poses the gyros are integrated; the attitude they give turns the direction of gravity of the
first pose into that of the second, as the calibrated accelerometers see it. Each rotation gives two
equations, and a dozen rotations about different axes the nine elements of the matrix that turns counts into
rates *in the axes of the accelerometers*, alignment included (Tedaldi, Pretto and Menegatti, 2014).

Done otherwise than there:

- The bias is estimated together with the matrix; its static averages are a prior with their covariance.
- MEMS gyros have a bias that depends on the specific force. Where the static averages show it (an F test), a
  matrix of nine such sensitivities is fitted to them and taken off along the rotation.
- The integration is that of a rate that is linear between samples, of fourth order (a Magnus series), and the
  Jacobian follows in the same pass: a change dT of the matrix turns the end by the integral of C dT n.
- The start is a search over one scale factor for all axes. It is bounded by a fact that needs no model: the
  path of a rotation is at least as long as the angle by which gravity turned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navopt.data.imu_recording import gap_samples
from navopt.errors import InvalidInput
from navopt.models.gyro_bias import GyroBias, static_gyro_bias
from navopt.models.pose_averages import PoseAverages
from navopt.models.triad import PARAMETER_NAMES, AccelerometerTriad, GyroTriad
from navopt.models.triad_fit import PoseFit, birge, sandwich_sigma, undetermined

__all__ = ["calibrate_gyro_rotation", "integrate_rotations"]

#: Rotations by less than this say little, rad.
SMALLEST = np.radians(5.0)
#: A start that leaves more than this (rms) means axes that do not belong together, rad.
HOPELESS = np.radians(25.0)
#: Rotations that a fit needs: nine elements, two equations each, and some to spare.
FEWEST = 6


def integrate_rotations(
    rates: np.ndarray, step: np.ndarray, counts: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate several sampled rates at once.

    Parameters
    ----------
    rates : ndarray, shape (R, L, 3)
        Rates in body axes, rad/s, linear between samples.
    step : ndarray, shape (R, L - 1)
        Time between samples, s; zero beyond the end of a shorter rotation.
    counts : ndarray, shape (R, L, 3), optional
        What the rates are linear in: ``rates = counts @ T.T``.

    Returns
    -------
    attitude : ndarray, shape (R, 3, 3)
        From body axes at the end to those at the begin.
    moments : ndarray, shape (R, 3, 3, 4)
        Integrals of C_ia n_b, with C from body axes to those of the begin and n_3 = 1: a change dT turns the
        end by ``einsum("iab,ab", moments[..., :3], dT)`` about axes of the begin. Zero without `counts`.
    """
    number, length, _ = rates.shape
    mean = 0.5 * (rates[:, 1:] + rates[:, :-1]) * step[..., None]
    twist = np.cross(rates[:, :-1], rates[:, 1:]) * (step[..., None] ** 2 / 12.0)
    turns = _rotations((mean + twist).reshape(-1, 3)).reshape(number, length - 1, 3, 3)
    if counts is None:
        # products of neighbours, of neighbouring products, and so on
        while turns.shape[1] > 1:
            last = turns[:, -1:] if turns.shape[1] % 2 else turns[:, :0]
            turns = np.concatenate([turns[:, 0:-1:2] @ turns[:, 1::2], last], axis=1)
        return turns[:, 0], np.zeros((number, 3, 3, 4))
    # products of all turns so far, by doubling
    reach = 1
    while reach < length - 1:
        turns = np.concatenate([turns[:, :reach], turns[:, :-reach] @ turns[:, reach:]], axis=1)
        reach *= 2
    begin = np.broadcast_to(np.eye(3), (number, 1, 3, 3))
    middle = 0.5 * (turns + np.concatenate([begin, turns[:, :-1]], axis=1))
    weight = np.ones((number, length - 1, 4))
    weight[..., :3] = 0.5 * (counts[:, :-1] + counts[:, 1:])
    moments = np.einsum("rkia,rkb->riab", middle, weight * step[..., None], optimize=True)
    return turns[:, -1], moments


def calibrate_gyro_rotation(
    time: np.ndarray,
    gyro: np.ndarray,
    accelerometer: np.ndarray,
    averages: PoseAverages,
    calibrated: AccelerometerTriad,
    *,
    bias: GyroBias | None = None,
    force_dependent: bool | None = None,
) -> tuple[PoseFit, GyroBias]:
    """Calibrate gyros from the rotations between static poses.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Seconds.
    gyro, accelerometer : ndarray, shape (N, 3)
        Samples.
    averages : PoseAverages
        The poses.
    calibrated : AccelerometerTriad
        Parameters of the accelerometers.
    bias : GyroBias, optional
        Output at rest; from the averages if not given.
    force_dependent : bool, optional
        As `depends` of `static_gyro_bias`.

    Returns
    -------
    fit : PoseFit
        All twelve parameters, in the axes of the accelerometers. Residuals are the two components of the
        angle between the predicted and the measured vertical of every rotation, in turn, rad.
    bias : GyroBias
        What was used.

    Raises
    ------
    InvalidInput
        If there are too few rotations, they do not determine the parameters, or nothing fits.
    """
    from scipy.optimize import least_squares

    force = calibrated.inverse(averages.accelerometer)
    rest = static_gyro_bias(averages, force, depends=force_dependent) if bias is None else bias
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    turns = _Turns.of(time, gyro, accelerometer, averages, calibrated, rest, up)
    tilt = (
        averages.accelerometer_sigma / np.abs(calibrated.scale) / np.linalg.norm(force, axis=1, keepdims=True)
    )
    scale, left = turns.search()
    whitening = turns.stated(averages.noise.white[:3] / scale, tilt)
    if left > HOPELESS:
        raise InvalidInput(
            "gyro",
            f"rotations that differ from those of gravity by {np.degrees(left):.0f} degrees (rms)",
            "the gyros' axes are not those of the accelerometers (order, signs), or the times do not agree",
        )
    prior = np.linalg.cholesky(np.linalg.inv(rest.covariance + 1e-12 * np.eye(3))).T
    size = np.concatenate([np.full(9, 1.0 / scale), np.full(3, 1.0)])

    def residual(values: np.ndarray) -> np.ndarray:
        found, _ = turns.residual(values * size, jacobian=False)
        return np.concatenate([found.ravel() / whitening, prior @ (values[9:] * size[9:])])

    def jacobian(values: np.ndarray) -> np.ndarray:
        _, change = turns.residual(values * size, jacobian=True)
        return (
            np.vstack([change.reshape(-1, 12) / whitening[:, None], np.hstack([np.zeros((3, 9)), prior])])
            * size
        )

    start = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    found = least_squares(residual, start, jac=jacobian, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12)
    values = found.x * size
    triad, transform = _triad(values, rest.offset)
    whitened = jacobian(found.x) / size
    inverse = np.linalg.pinv(transform)
    missing, covariance = undetermined(whitened @ inverse, PARAMETER_NAMES, triad.scale, _typical(turns))
    if missing:
        raise InvalidInput(
            "rotations",
            f"{len(turns)} rotations that are too much alike",
            f"they do not determine {', '.join(missing)}: "
            "turn the unit about each of its axes, both ways, by 60 degrees or more between poses",
        )
    after, _ = turns.residual(values, jacobian=False)
    nominal, _ = turns.residual(start * size, jacobian=False)
    # the three residuals of the prior are matched by the three biases
    chi_square, degrees = float((found.fun[:-3] ** 2).sum()), 2 * len(turns) - 9
    normal = whitened @ inverse
    return (
        PoseFit(
            triad=triad,
            names=PARAMETER_NAMES,
            covariance=covariance * birge(chi_square, degrees) ** 2,
            sandwich=_sandwich(normal, found.fun, covariance),
            before=nominal.ravel(),
            after=after.ravel(),
            stated=whitening,
            unit="rad",
            chi_square=chi_square,
            degrees_of_freedom=degrees,
            method="gravity turned by the integrated gyros between poses",
        ),
        rest,
    )


def _sandwich(normal: np.ndarray, residual: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """1 sigma from the residuals of whole rotations, the prior's added as stated."""
    rotations = sandwich_sigma(normal[:-3], residual[:-3], covariance, group=2)
    stated = normal[-3:] @ covariance
    return np.sqrt(rotations**2 + (stated**2).sum(axis=0))


def _typical(turns: _Turns) -> float:
    """Mean rate of the rotations, to which biases are compared, rad/s."""
    return float(np.median(turns.turned / turns.duration))


def _triad(values: np.ndarray, offset: np.ndarray) -> tuple[GyroTriad, np.ndarray]:
    """Triad of a matrix from counts to rates and an offset, and its derivative by those twelve numbers."""

    def vector(v: np.ndarray) -> np.ndarray:
        matrix = np.linalg.inv(v[:9].reshape(3, 3))
        return GyroTriad.from_matrix(matrix, offset + v[9:]).vector

    size = np.concatenate([np.full(9, np.abs(values[:9]).max()), np.ones(3)])
    columns = []
    for k in range(12):
        change = np.zeros(12)
        change[k] = 1e-5 * size[k]
        columns.append((vector(values + change) - vector(values - change)) / (2.0 * change[k]))
    return GyroTriad.from_vector(vector(values)), np.stack(columns, axis=1)


@dataclass(frozen=True, kw_only=True)
class _Turns:
    """Samples of all rotations between neighbouring poses, padded to one length."""

    counts: np.ndarray
    step: np.ndarray
    up: np.ndarray
    after: np.ndarray
    basis: np.ndarray
    first: np.ndarray
    turned: np.ndarray
    duration: np.ndarray

    def __len__(self) -> int:
        return len(self.counts)

    @classmethod
    def of(
        cls,
        time: np.ndarray,
        gyro: np.ndarray,
        accelerometer: np.ndarray,
        averages: PoseAverages,
        calibrated: AccelerometerTriad,
        rest: GyroBias,
        up: np.ndarray,
    ) -> _Turns:
        gaps = gap_samples(time)
        angle = np.arccos(np.clip((up[:-1] * up[1:]).sum(axis=1), -1.0, 1.0))
        kept = [
            k
            for k in range(len(averages) - 1)
            if angle[k] > SMALLEST
            and not np.any((gaps >= averages.stop[k] - 1) & (gaps < averages.start[k + 1]))
        ]
        if len(kept) < FEWEST:
            raise InvalidInput(
                "rotations",
                f"{len(kept)} usable rotations between static poses",
                f"turn the unit by 60 degrees or more between poses, at least {FEWEST} times, better 24",
            )
        edges = [(averages.stop[k] - 1, averages.start[k + 1] + 1) for k in kept]
        length = max(end - first for first, end in edges)
        counts, step = np.zeros((len(kept), length, 3)), np.zeros((len(kept), length - 1))
        for row, (first, end) in enumerate(edges):
            force = calibrated.inverse(accelerometer[first:end])
            counts[row, : end - first] = gyro[first:end] - rest.offset - force @ rest.force_sensitivity.T
            step[row, : end - first - 1] = np.diff(time[first:end])
        target = up[np.array(kept) + 1]
        # two directions at right angles to each measured vertical
        helper = np.eye(3)[np.argmin(np.abs(target), axis=1)]
        one = np.cross(target, helper)
        one /= np.linalg.norm(one, axis=1, keepdims=True)
        return cls(
            counts=counts,
            step=step,
            up=up[kept],
            after=target,
            basis=np.stack([one, np.cross(target, one)], axis=1),
            first=np.array(kept),
            turned=angle[kept],
            duration=step.sum(axis=1),
        )

    def residual(self, values: np.ndarray, *, jacobian: bool) -> tuple[np.ndarray, np.ndarray]:
        """Two components of the angle from the measured to the predicted vertical, and their derivative."""
        matrix = values[:9].reshape(3, 3)
        counts = self.counts - values[9:]
        attitude, moments = integrate_rotations(counts @ matrix.T, self.step, counts if jacobian else None)
        predicted = np.einsum("rji,rj->ri", attitude, self.up)
        found = np.einsum("rci,ri->rc", self.basis, predicted - self.after)
        if not jacobian:
            return found, np.zeros(0)
        # C' = (1 + [phi x]) C, so that the prediction C'^T u changes by C^T (u x phi)
        turned = np.concatenate(
            [
                moments[..., :3].reshape(len(self), 3, 9),
                -np.einsum("ria,ab->rib", moments[..., 3], matrix),
            ],
            axis=2,
        )
        change = np.cross(self.up[:, :, None], turned, axisa=1, axisb=1, axisc=1)
        change = np.einsum("rji,rjk->rik", attitude, change)
        return found, np.einsum("rci,rik->rck", self.basis, change)

    def search(self) -> tuple[float, float]:
        """Counts per rad/s, the same for all axes, that fit best, and the rms angle left."""
        path = (np.linalg.norm(self.counts[:, :-1], axis=2) * self.step).sum(axis=1)
        most = float(np.min(path / self.turned))
        best = (most, np.inf)
        for scale in most * np.geomspace(0.3, 1.1, 40):
            matrix = np.eye(3).ravel() / scale
            found, _ = self.residual(np.concatenate([matrix, np.zeros(3)]), jacobian=False)
            left = float(np.sqrt(np.mean((found**2).sum(axis=1))))
            if left < best[1]:
                best = scale, left
        return best

    def stated(self, walk: np.ndarray, tilt: np.ndarray) -> np.ndarray:
        """1 sigma of each component from the gyros' white noise and the two measured verticals, rad."""
        gyros = np.mean(walk**2) * self.duration
        verticals = (tilt**2).mean(axis=1)
        return np.repeat(np.sqrt(gyros + verticals[self.first] + verticals[self.first + 1]), 2)


def _rotations(vectors: np.ndarray) -> np.ndarray:
    """Matrices of rotation vectors (Rodrigues)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vectors).as_matrix())
