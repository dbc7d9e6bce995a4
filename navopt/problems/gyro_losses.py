"""What a gyro calibration compares: norms, a turntable's rates, or invariants with accelerometers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.models.earth import EARTH_RATE
from navopt.models.triad import DEGREE_PER_HOUR, AccelerometerTriad, GyroTriad
from navopt.problems import gyro_kernels as kernels
from navopt.problems.gyro_record import invariant_whitening, noise_gain, norm_sigma

__all__ = ["InvariantMisfit", "Misfit", "NormMisfit", "TurntableMisfit"]

Array = NDArray[np.float64]


class Misfit:
    """Base: losses, residuals and slopes of whole parameter vectors on one record.

    Attributes
    ----------
    parameters : int
        Length of a parameter vector: 12 for the gyros, 24 with accelerometers.
    rows : int
        Residuals of a candidate.
    """

    parameters = 12
    rows: int

    def __init__(self, rows: int, **arrays: Any) -> None:
        self.rows = rows
        for name, array in arrays.items():
            fixed = np.ascontiguousarray(array)
            fixed.setflags(write=False)
            setattr(self, name, fixed)

    def losses(self, full: Array) -> Array:
        """Losses of parameter vectors, shape (n, parameters) to (n,)."""
        out = np.empty(len(full))
        self._losses(full, out)
        return out

    def residuals(self, full: Array) -> Array:
        """Whitened residuals, shape (n, rows)."""
        out = np.empty((len(full), self.rows))
        self._residuals(full, out)
        return out

    def slopes(self, full: Array) -> Array:
        """Derivatives of the residuals, shape (n, rows, parameters)."""
        out = np.empty((len(full), self.rows, self.parameters))
        self._slopes(full, out)
        return out

    def _losses(self, full: Array, out: Array) -> None:
        raise NotImplementedError

    def _residuals(self, full: Array, out: Array) -> None:
        raise NotImplementedError

    def _slopes(self, full: Array, out: Array) -> None:
        raise NotImplementedError


class NormMisfit(Misfit):
    """Squared norms of calibrated rates against that of the Earth rate: eq. (14) of Gao et al. (2015).

    Parameters
    ----------
    counts : ndarray, shape (m, 3)
        Output of the gyros.
    preset : GyroTriad
        What is assumed of them, for the part that noise has in a norm.
    sigma : float
        Noise of an averaged channel, rad/s.
    corrected : bool
        Whether the loss takes that part out. Residuals always do.
    """

    record: Array

    def __init__(self, counts: Array, preset: GyroTriad, sigma: float, *, corrected: bool) -> None:
        super().__init__(len(counts), record=counts.T)
        self.expected = EARTH_RATE**2 + sigma**2 * noise_gain(preset)
        self.square = self.expected if corrected else EARTH_RATE**2
        self.sigma = norm_sigma(EARTH_RATE, sigma)

    def _losses(self, full: Array, out: Array) -> None:
        kernels.norm_losses(full, self.record, self.square, DEGREE_PER_HOUR**2, out)

    def _residuals(self, full: Array, out: Array) -> None:
        kernels.norm_residuals(full, self.record, self.expected, self.sigma, out)

    def _slopes(self, full: Array, out: Array) -> None:
        kernels.norm_slopes(full, self.record, self.sigma, out)


class TurntableMisfit(Misfit):
    """Output of the gyros against what a candidate makes of known rates.

    Parameters
    ----------
    counts, rates : ndarray, shape (k, 3)
        Output, and rates of the table, rad/s.
    preset : GyroTriad
        Its scale factors make rates of counts.
    sigma : float
        Noise of an averaged channel, rad/s.
    """

    table: Array
    rates: Array
    scale: Array

    def __init__(self, counts: Array, rates: Array, preset: GyroTriad, sigma: float) -> None:
        super().__init__(3 * len(counts), table=counts.T, rates=rates.T, scale=preset.scale.copy())
        self.sigma = sigma

    def _losses(self, full: Array, out: Array) -> None:
        kernels.turntable_losses(full, self.table, self.rates, self.scale, DEGREE_PER_HOUR, out)

    def _residuals(self, full: Array, out: Array) -> None:
        kernels.turntable_residuals(full, self.table, self.rates, self.scale, self.sigma, out)

    def _slopes(self, full: Array, out: Array) -> None:
        kernels.turntable_slopes(full, self.rates, self.scale, self.sigma, out)


class InvariantMisfit(Misfit):
    """Norms of rate and specific force, and their product, against those of the place.

    Parameters
    ----------
    counts, forces : ndarray, shape (m, 3)
        Output of gyros and accelerometers.
    preset : GyroTriad
        What is assumed of the gyros, for the part that noise has in a norm.
    accelerometers : AccelerometerTriad
        And of the accelerometers.
    sigma, force_sigma : float
        Noise of an averaged channel, rad/s and m/s^2.
    gravity, latitude : float
        m/s^2 and rad.
    """

    parameters = 24
    record: Array
    forces: Array
    squares: Array
    whitening: Array

    def __init__(
        self,
        counts: Array,
        forces: Array,
        preset: GyroTriad,
        accelerometers: AccelerometerTriad,
        *,
        sigma: float,
        force_sigma: float,
        gravity: float,
        latitude: float,
    ) -> None:
        product = EARTH_RATE * gravity * np.sin(latitude)
        rate_square = EARTH_RATE**2 + sigma**2 * noise_gain(preset)
        force_square = gravity**2 + force_sigma**2 * noise_gain(accelerometers)
        super().__init__(
            3 * len(counts),
            record=counts.T,
            forces=forces.T,
            squares=np.array([rate_square, force_square, product]),
            whitening=invariant_whitening(gravity, product, sigma, force_sigma),
        )

    def _losses(self, full: Array, out: Array) -> None:
        kernels.invariant_losses(full, self.record, self.forces, self.squares, self.whitening, out)

    def _residuals(self, full: Array, out: Array) -> None:
        kernels.invariant_residuals(full, self.record, self.forces, self.squares, self.whitening, out)

    def _slopes(self, full: Array, out: Array) -> None:
        kernels.invariant_slopes(full, self.record, self.forces, self.whitening, out)
