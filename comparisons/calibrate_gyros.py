"""The gyros of a recorded unit: by the Earth rate if it can be seen, else by rotations between poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from navopt.data.imu_recording import ImuRecording
from navopt.errors import InvalidInput
from navopt.models.earth import EARTH_RATE
from navopt.models.gyro_bias import GyroBias
from navopt.models.multi_position import calibrate_gyro_earth_rate, sphere_start
from navopt.models.pose_averages import PoseAverages
from navopt.models.pose_rotation import calibrate_gyro_rotation
from navopt.models.triad import AccelerometerTriad, GyroTriad
from navopt.models.triad_fit import PoseFit

__all__ = ["GYRO_METHODS", "calibrate_gyros"]

#: Ways to calibrate the gyros.
GYRO_METHODS = ("auto", "rotation", "earth-rate", "none")
#: Rate noise of a pose's mean over the Earth rate below which the Earth rate is used.
VISIBLE = 0.1


def calibrate_gyros(
    samples: ImuRecording,
    averages: PoseAverages,
    accelerometer: PoseFit,
    rest: GyroBias,
    latitude: float | None,
    method: str,
) -> tuple[PoseFit | None, GyroBias, list[str]]:
    """Calibrate the gyros by what is asked for, or by what is possible.

    Parameters
    ----------
    samples : ImuRecording
        The recording.
    averages : PoseAverages
        Means of its static poses.
    accelerometer : PoseFit
        Calibrated accelerometers.
    rest : GyroBias
        Output of the gyros at rest.
    latitude : float or None
        rad.
    method : str
        One of `GYRO_METHODS`.

    Returns
    -------
    fit : PoseFit or None
        None where the recording does not determine the gyros.
    rest : GyroBias
        Output at rest that belongs to it.
    notes : list of str
        Remarks.

    Raises
    ------
    InvalidInput
        If what is asked for is not possible.
    """
    if method == "none":
        return None, rest, []
    triad = accelerometer.triad
    assert isinstance(triad, AccelerometerTriad)
    force = triad.inverse(averages.accelerometer)
    turned: tuple[PoseFit, GyroBias] | None = None
    missing: InvalidInput | None = None
    counts = samples.gyro_unit == "counts"
    # the size of a count comes from the rotations only; rates in rad/s can do without them
    if method != "earth-rate" or counts:
        try:
            turned = calibrate_gyro_rotation(
                samples.time, samples.gyro, samples.accelerometer, averages, triad, bias=rest
            )
        except InvalidInput as error:
            if method == "rotation" or error.argument != "rotations":
                raise
            missing = error
    if method != "rotation":
        nominal = _nominal_gyro(averages, turned, counts)
        noise = np.median(np.linalg.norm(averages.gyro_sigma / np.abs(nominal.scale), axis=1))
        known = turned is not None or not counts
        if method == "earth-rate" or (known and noise < VISIBLE * EARTH_RATE and len(averages) >= 9):
            return _earth_rate(averages, nominal, force, latitude, rest)
    if turned is None:
        assert missing is not None
        return None, rest, [f"the gyros are not calibrated: {missing.value}; {missing.remedy}"]
    return turned[0], turned[1], []


def _nominal_gyro(averages: PoseAverages, turned: tuple[PoseFit, GyroBias] | None, counts: bool) -> GyroTriad:
    if turned is not None:
        found = turned[0].triad
        return GyroTriad(found.scale, found.misalignment, found.bias)
    if not counts:
        return GyroTriad(np.ones(3), np.eye(3), np.zeros(3))
    # the Earth rate itself is the radius of the sphere on which the means lie, if it can be seen at all
    start = sphere_start(averages.gyro, EARTH_RATE)
    return GyroTriad(start.scale, start.misalignment, start.bias)


def _earth_rate(
    averages: PoseAverages,
    nominal: GyroTriad,
    force: np.ndarray,
    latitude: float | None,
    rest: GyroBias,
) -> tuple[PoseFit, GyroBias, list[str]]:
    fit = calibrate_gyro_earth_rate(
        averages.gyro, averages.gyro_sigma, nominal, force=force, latitude=latitude
    )
    notes = []
    if latitude is None:
        notes.append(
            "without a latitude the Earth rate leaves the rotation of the gyros' axes against the "
            "accelerometers' open: x is along the first gyro, y in the plane of the first two"
        )
    # the scatter of the means is the Earth rate here, and no bias
    return fit, _without_force(rest), notes


def _without_force(rest: GyroBias) -> GyroBias:
    return replace(rest, force_sensitivity=np.zeros((3, 3)), force_sensitivity_sigma=np.zeros((3, 3)))
