"""Calibrating one recorded inertial unit: from a file or arrays to parameters with their sigmas."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.calibrate_gyros import GYRO_METHODS, calibrate_gyros
from navopt.data.imu_files import read_imu
from navopt.data.imu_recording import ImuRecording, check_recording
from navopt.data.imu_units import ACCELEROMETER_UNITS, GYRO_UNITS
from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import normal_gravity
from navopt.models.gyro_bias import GyroBias, static_gyro_bias
from navopt.models.multi_position import calibrate_accelerometer
from navopt.models.one_position import OnePosition, one_position
from navopt.models.pose_averages import PoseAverages, average_poses
from navopt.models.static_detector import StaticPoses, detect_static
from navopt.models.triad import AccelerometerTriad
from navopt.models.triad_fit import PoseFit

__all__ = ["Calibration", "calibrate_recording", "compare_one_position"]

#: Gravity on the Earth's surface, m/s2, with room.
GRAVITY_RANGE = (9.7, 9.9)
#: Residuals so many times the stated noise are remarked on.
EXCESS = 3.0
#: A sigma from the residuals alone so many times the other is remarked on.
SANDWICH = 2.0


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """A calibrated unit and everything needed to judge it.

    Attributes
    ----------
    recording : ImuRecording
        What was calibrated.
    poses : StaticPoses
        The detector's decision.
    averages : PoseAverages
        Means of the poses that were used.
    accelerometer : PoseFit
        Parameters of the accelerometers.
    gyro : PoseFit or None
        Parameters of the gyros; None where the recording does not determine them.
    gyro_bias : GyroBias
        Output of the gyros at rest, and how it depends on the specific force.
    gravity : float
        m/s2, as declared.
    latitude : float or None
        rad, if declared.
    settings : dict
        What was asked for.
    notes : tuple of str
        What was assumed, left out or looks odd, in sentences.
    """

    recording: ImuRecording
    poses: StaticPoses
    averages: PoseAverages
    accelerometer: PoseFit
    gyro: PoseFit | None
    gyro_bias: GyroBias
    gravity: float
    latitude: float | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def specific_force(self, samples: np.ndarray) -> np.ndarray:
        """Return calibrated specific forces, m/s2, of samples like those of the recording, shape (..., 3)."""
        return self.accelerometer.triad.inverse(samples)

    def rate(self, samples: np.ndarray, force: np.ndarray | None = None) -> np.ndarray:
        """Return calibrated rates.

        Parameters
        ----------
        samples : ndarray, shape (..., 3)
            Gyro samples like those of the recording.
        force : ndarray, shape (..., 3), optional
            Calibrated specific forces, m/s2; without them the bias that depends on them stays in.

        Returns
        -------
        ndarray, shape (..., 3)
            rad/s.

        Raises
        ------
        InvalidInput
            If the gyros were not calibrated.
        """
        if self.gyro is None:
            raise InvalidInput("gyro", "no calibration of the gyros", "see the notes for the reason")
        if force is not None:
            samples = samples - np.asarray(force) @ self.gyro_bias.force_sensitivity.T
        return self.gyro.triad.inverse(samples)

    def write(self, folder: str | Path, *, inputs: dict[str, Path] | None = None) -> list[Path]:
        """Write parameters, report and pictures; see `comparisons.calibrate_output.write_calibration`."""
        from comparisons.calibrate_output import write_calibration

        return write_calibration(self, folder, inputs=inputs)


def calibrate_recording(
    recording: ImuRecording | str | Path,
    *,
    gravity: float | None = None,
    latitude: float | None = None,
    initial_static_s: float | None = None,
    threshold: float | None = None,
    window_s: float = 1.0,
    shortest_pose_s: float = 2.0,
    accelerometer_parameters: str = "frame",
    gyro: str = "auto",
    force_dependent: bool | None = None,
) -> Calibration:
    """Calibrate an inertial unit from a recording in many static poses.

    Parameters
    ----------
    recording : ImuRecording or path
        The samples; a path is read by `navopt.data.imu_files.read_imu`.
    gravity : float, optional
        Gravity where it was recorded, m/s2. If not given, that of the file, else normal gravity at the
        latitude.
    latitude : float, optional
        Latitude, rad; that of the file if not given.
    initial_static_s : float, optional
        Time at the begin in which the unit certainly lay still, s; found if not given.
    threshold, window_s, shortest_pose_s
        As for `navopt.models.static_detector.detect_static`.
    accelerometer_parameters : str
        ``"frame"`` (nine), ``"scale-bias"`` (six) or ``"bias"`` (three).
    gyro : str
        One of `GYRO_METHODS`. ``"auto"`` uses the Earth rate if the noise lets it be seen, else rotations
        between poses, and only remarks on it if there are too few of them.
    force_dependent : bool, optional
        Whether the gyros' bias may depend on the specific force; found by a test if not given.

    Returns
    -------
    Calibration

    Raises
    ------
    InvalidInput
        If the recording cannot be used; see the page "Calibrate your IMU".
    """
    samples = recording if isinstance(recording, ImuRecording) else read_imu(recording)
    if gyro not in GYRO_METHODS:
        raise UnknownName("--gyro-method", gyro, GYRO_METHODS)
    latitude = samples.latitude if latitude is None else latitude
    value = _gravity(samples, gravity, latitude)
    notes = [*samples.notes, *check_recording(samples)]
    poses = detect_static(
        samples.time,
        samples.gyro,
        samples.accelerometer,
        initial_static_s=initial_static_s,
        window_s=window_s,
        threshold=threshold,
        shortest_pose_s=shortest_pose_s,
    )
    averages = average_poses(samples.time, samples.gyro, samples.accelerometer, poses)
    notes += _detector_notes(poses, averages)
    if _alike(averages):
        raise InvalidInput(
            "static poses",
            f"only one attitude in {len(averages)} of them",
            "turn the unit to 24 different poses; --one-position says what a single one tells",
        )
    accelerometer = calibrate_accelerometer(
        averages.accelerometer,
        value,
        averages.accelerometer_sigma,
        estimated=accelerometer_parameters,
        nominal=_unity(samples.accelerometer_unit),
    )
    _check_scale("accelerometer", samples.accelerometer_unit, accelerometer, ACCELEROMETER_UNITS)
    forces = accelerometer.triad.inverse(averages.accelerometer)
    rest = static_gyro_bias(averages, forces, depends=force_dependent)
    fit, rest, more = calibrate_gyros(samples, averages, accelerometer, rest, latitude, gyro)
    if fit is not None:
        _check_scale("gyro", samples.gyro_unit, fit, GYRO_UNITS)
    found = Calibration(
        recording=samples,
        poses=poses,
        averages=averages,
        accelerometer=accelerometer,
        gyro=fit,
        gyro_bias=rest,
        gravity=value,
        latitude=latitude,
        settings={
            "initial_static_s": initial_static_s,
            "threshold": threshold,
            "window_s": window_s,
            "shortest_pose_s": shortest_pose_s,
            "accelerometer_parameters": accelerometer_parameters,
            "gyro": gyro,
            "force_dependent": force_dependent,
        },
        notes=(*notes, *more, *_fit_notes(accelerometer, "accelerometers"), *_fit_notes(fit, "gyros")),
    )
    return found


def compare_one_position(
    recording: ImuRecording, *, latitude: float | None = None, gravity: float | None = None
) -> OnePosition:
    """Say what a recording in one position tells; see `navopt.models.one_position`.

    Parameters
    ----------
    recording : ImuRecording
        Samples in rad/s and m/s2.
    latitude : float, optional
        rad; that of the file if not given.
    gravity : float, optional
        m/s2; that of the file, else normal gravity, if not given.

    Returns
    -------
    OnePosition

    Raises
    ------
    InvalidInput
        If the samples are counts or the latitude is not known.
    """
    if "counts" in (recording.gyro_unit, recording.accelerometer_unit):
        raise InvalidInput(
            "--one-position",
            "counts",
            "one position cannot tell what a count is: give samples in rates and forces",
        )
    check_recording(recording)
    where = recording.latitude if latitude is None else latitude
    if where is None:
        raise InvalidInput("--latitude", "none", "say where it was recorded, in degrees")
    return one_position(
        recording.gyro,
        recording.accelerometer,
        recording.interval,
        where,
        gravity=recording.gravity if gravity is None else gravity,
    )


def _gravity(recording: ImuRecording, gravity: float | None, latitude: float | None) -> float:
    if latitude is not None and not abs(latitude) <= 0.5 * np.pi:
        raise InvalidInput("--latitude", float(np.degrees(latitude)), "give degrees from -90 to 90")
    if gravity is None:
        gravity = recording.gravity
    if gravity is None and latitude is not None:
        gravity = float(normal_gravity(latitude))
    if gravity is None:
        raise InvalidInput(
            "--gravity", "none", "give gravity in m/s2, such as 9.81, or the latitude (--latitude)"
        )
    low, high = GRAVITY_RANGE
    if not low < gravity < high:
        raise InvalidInput("--gravity", gravity, f"give m/s2, between {low} and {high}")
    return float(gravity)


def _unity(unit: str) -> AccelerometerTriad | None:
    return AccelerometerTriad(np.ones(3), np.eye(3), np.zeros(3)) if unit != "counts" else None


def _alike(averages: PoseAverages) -> bool:
    """Whether all poses have one attitude: the means differ by less than 2 % of their size and spread."""
    means = averages.accelerometer
    spread = np.linalg.norm(means - means.mean(axis=0), axis=1).max()
    return bool(len(averages) < 3 or spread < 0.02 * np.linalg.norm(means.mean(axis=0)))


def _detector_notes(poses: StaticPoses, averages: PoseAverages) -> list[str]:
    notes = []
    if averages.left_out:
        notes.append(f"left out, as they drifted: {averages.left_out} of the static poses")
    counts = (poses.half_threshold, len(poses), poses.double_threshold)
    if max(counts) - min(counts) > 0.2 * len(poses):
        notes.append(
            f"the number of poses hangs on the threshold: {counts[0]} at half of it, {counts[1]}, "
            f"{counts[2]} at twice: look at static.png, and set --threshold or --initial-static"
        )
    return notes


def _check_scale(sensor: str, unit: str, fit: PoseFit, known: dict[str, float]) -> None:
    """Refuse samples whose declared unit is not the one they have."""
    scale = float(np.median(np.abs(fit.triad.scale)))
    if unit == "counts" or 0.5 < scale < 2.0:
        return
    # samples were multiplied by the factor of the declared unit: what is left is a ratio of two units
    ratios = {
        f"{right} and not {wrong}": known[wrong] / known[right]
        for right in known
        for wrong in known
        if right != wrong
    }
    near = min(ratios, key=lambda name: abs(np.log(ratios[name] / scale)))
    hint = f"; the unit seems to be {near}" if 0.7 < ratios[near] / scale < 1.4 else ""
    raise InvalidInput(
        f"--{sensor}-unit",
        f"samples that are {scale:.3g} times what they should be{hint}",
        "state the right unit",
    )


def _fit_notes(fit: PoseFit | None, name: str) -> list[str]:
    if fit is None:
        return []
    notes = []
    if fit.excess > EXCESS:
        notes.append(
            f"{name}: residuals are {fit.excess:.1f} times what the noise explains; the sigmas are enlarged "
            "by it"
        )
    if fit.degrees_of_freedom < 5:
        notes.append(
            f"{name}: only {fit.degrees_of_freedom} more equations than parameters: "
            "the residuals are no check"
        )
    else:
        doubtful = [
            parameter
            for parameter, one, other in zip(fit.names, fit.sigma.values(), fit.sandwich, strict=True)
            if other > SANDWICH * one
        ]
        if doubtful:
            notes.append(
                f"{name}: {', '.join(doubtful)} hang on few poses "
                "(sigma from the residuals above twice the stated)"
            )
    return notes
