"""Gyros and accelerometers of one unit, calibrated together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navopt.models.triad import AccelerometerTriad, GyroTriad

__all__ = ["ImuCalibration"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ImuCalibration:
    """Two triads on one block.

    Parameters
    ----------
    gyro_vector, accelerometer_vector : array_like, shape (12,)
        Parameters in the order of `navopt.models.triad.PARAMETER_NAMES`. `of` takes the triads themselves.

    Raises
    ------
    InvalidInput
        As for `navopt.models.SensorTriad`.
    """

    gyro_vector: Array
    accelerometer_vector: Array

    def __post_init__(self) -> None:
        for name, kind in (("gyro_vector", GyroTriad), ("accelerometer_vector", AccelerometerTriad)):
            vector = kind.from_vector(getattr(self, name)).vector
            vector.setflags(write=False)
            object.__setattr__(self, name, vector)

    @classmethod
    def of(cls, gyro: GyroTriad, accelerometer: AccelerometerTriad) -> ImuCalibration:
        """Put two triads together.

        Parameters
        ----------
        gyro : GyroTriad
        accelerometer : AccelerometerTriad
            In the same body axes.

        Returns
        -------
        ImuCalibration
        """
        return ImuCalibration(gyro.vector, accelerometer.vector)

    @property
    def gyro(self) -> GyroTriad:
        """The gyros."""
        return GyroTriad.from_vector(self.gyro_vector)

    @property
    def accelerometer(self) -> AccelerometerTriad:
        """The accelerometers."""
        return AccelerometerTriad.from_vector(self.accelerometer_vector)

    @property
    def vector(self) -> Array:
        """All parameters, gyros first, shape (24,)."""
        return np.concatenate([self.gyro_vector, self.accelerometer_vector])

    def in_frame(self, frame: str) -> ImuCalibration:
        """Return the same unit described in the axes in which its *accelerometers* keep a convention.

        Parameters
        ----------
        frame : {"lower-triangular", "symmetric"}
            As for `navopt.models.SensorTriad.in_frame`, applied to the accelerometers; the gyros are turned
            with them, so that angles between rates and forces stay.

        Returns
        -------
        ImuCalibration
        """
        gyro, old = self.gyro, self.accelerometer
        new = old.in_frame(frame)
        rotation = np.linalg.solve(old.matrix, new.matrix)
        return ImuCalibration.of(GyroTriad.from_matrix(gyro.matrix @ rotation, gyro.scale * gyro.bias), new)
