"""From a calibration to where its errors take a navigator: `navigation_error`.

A wrong calibration turns true rates into slightly wrong ones, as the sensors' own instability does. Both go
through alignment and strapdown navigation; what comes out is a position error, in metres and nautical miles.
The exact way is a strapdown run of python-ins; a linear model gives the same to a per cent for many runs at
once.

Axes of the triads are right, forward, up. The vertical channel is held by an altitude known from elsewhere (a
marble block and a lake do not rise), since free inertial altitude diverges within the hour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from navopt.errors import InvalidInput, UnknownName
from navopt.models.earth import NAUTICAL_MILE
from navopt.models.navigation_alignment import align, attitude_matrix, platform_angles
from navopt.models.navigation_linear import SWAP, error_steps, propagate
from navopt.models.navigation_noise import RunErrors, draw_run_errors
from navopt.models.navigation_scenarios import NavigationScenario
from navopt.models.triad import AccelerometerTriad, GyroTriad, SensorTriad

__all__ = ["CalibrationResidual", "NavigationError", "navigation_error"]

Array = NDArray[np.float64]

METHODS = ("linear", "strapdown")


@dataclass(frozen=True, kw_only=True)
class CalibrationResidual:
    """What is wrong with a calibration: the sensors as they are and as they are believed to be.

    Attributes
    ----------
    true, estimated : GyroTriad
        The gyros.
    accelerometer_true, accelerometer_estimated : AccelerometerTriad, optional
        The accelerometers; perfectly known if not given.
    """

    true: GyroTriad
    estimated: GyroTriad
    accelerometer_true: AccelerometerTriad | None = None
    accelerometer_estimated: AccelerometerTriad | None = None

    def __post_init__(self) -> None:
        if (self.accelerometer_true is None) != (self.accelerometer_estimated is None):
            raise InvalidInput(
                "accelerometer_true", "one of two triads", "give both accelerometer triads or none"
            )

    @property
    def gyro(self) -> tuple[Array, Array]:
        """Error of the calibrated rates: matrix (3, 3) per unit of true rate, and constant (3,), rad/s."""
        return _residual(self.true, self.estimated)

    @property
    def accelerometer(self) -> tuple[Array, Array]:
        """The same of the specific force; the constant in m/s^2."""
        if self.accelerometer_true is None or self.accelerometer_estimated is None:
            return np.zeros((3, 3)), np.zeros(3)
        return _residual(self.accelerometer_true, self.accelerometer_estimated)

    @classmethod
    def of_errors(cls, *, bias: Sequence[float] = (0.0, 0.0, 0.0), scale: float = 1.0) -> CalibrationResidual:
        """Residual of perfectly shaped gyros of which only the biases are off.

        Parameters
        ----------
        bias : sequence of 3 floats
            Drift that the calibrated gyros still show, rad/s, in right, forward, up.
        scale : float
            Scale factor of all three, counts per rad/s.
        """
        shape = {"scale": np.full(3, scale), "misalignment": np.eye(3)}
        return cls(
            true=GyroTriad(**shape, bias=np.array(bias, dtype=np.float64)),
            estimated=GyroTriad(**shape, bias=np.zeros(3)),
        )


def _residual(true: SensorTriad, estimated: SensorTriad) -> tuple[Array, Array]:
    """Both models are affine, and so is the error of one seen through the other."""
    constant = estimated.inverse(true.forward(np.zeros(3)))
    seen = np.linalg.solve(estimated.matrix, true.matrix)
    return seen - np.eye(3), np.asarray(constant)


@dataclass(frozen=True, kw_only=True)
class NavigationError:
    """Position errors over time, INS minus truth, of one run or of W.

    Attributes
    ----------
    time_s : ndarray, shape (N,)
        Seconds since departure.
    north_m, east_m : ndarray, shape (N,) or (W, N)
        Position error, m.
    reference_north_m, reference_east_m : ndarray, same shape
        Error of the reference positions (DGPS), m; zero without one.

    Notes
    -----
    Eq (15) of Gao et al. (2015), with the radii of the ellipsoid and a nautical mile of 1852 m.
    """

    time_s: Array
    north_m: Array
    east_m: Array
    reference_north_m: Array
    reference_east_m: Array

    def __post_init__(self) -> None:
        for item in fields(self):
            getattr(self, item.name).setflags(write=False)

    @property
    def position_error_m(self) -> Array:
        """Distance from the truth, m."""
        return np.hypot(self.north_m, self.east_m)

    @property
    def position_error_nmi(self) -> Array:
        """Distance from the truth in nautical miles."""
        return self.position_error_m / NAUTICAL_MILE

    @property
    def rms_m(self) -> Array:
        """Root mean square over the time of each run, m."""
        return np.sqrt(np.mean(self.position_error_m**2, axis=-1))

    @property
    def max_m(self) -> Array:
        """Largest value of each run, m."""
        return self.position_error_m.max(axis=-1)

    @property
    def end_m(self) -> Array:
        """Value at the end of each run, m."""
        return self.position_error_m[..., -1]

    @property
    def rms_nmi(self) -> Array:
        """`rms_m` in nautical miles."""
        return self.rms_m / NAUTICAL_MILE

    @property
    def max_nmi(self) -> Array:
        """`max_m` in nautical miles."""
        return self.max_m / NAUTICAL_MILE

    @property
    def end_nmi(self) -> Array:
        """`end_m` in nautical miles."""
        return self.end_m / NAUTICAL_MILE

    @property
    def hours(self) -> Array:
        """Whole hours since departure, from zero, shape (H,)."""
        return np.arange(int(np.floor(self.time_s[-1] / 3600.0 + 1e-9)) + 1, dtype=np.float64)

    @property
    def per_hour(self) -> Array:
        """Position error at every whole hour, m, shape (H,) or (W, H)."""
        at = np.searchsorted(self.time_s, 3600.0 * self.hours - 1e-6)
        return self.position_error_m[..., at]

    @property
    def against_reference(self) -> NavigationError:
        """The same as a test sees it, which knows no truth: INS minus reference."""
        return replace(
            self,
            north_m=self.north_m - self.reference_north_m,
            east_m=self.east_m - self.reference_east_m,
            reference_north_m=np.zeros_like(self.north_m),
            reference_east_m=np.zeros_like(self.east_m),
        )


def navigation_error(
    calibration: CalibrationResidual | Sequence[CalibrationResidual],
    scenario: NavigationScenario,
    *,
    seed: int | None = None,
    method: str = "linear",
    run_errors: RunErrors | None = None,
) -> NavigationError:
    """Navigate with calibrated sensors and return how far off that leads.

    Parameters
    ----------
    calibration : CalibrationResidual or sequence of W of them
        What is wrong with the calibration, one for each run.
    scenario : StaticScenario or LakeScenario
        The journey, the alignment before it and the sensors' own noise.
    seed : int, optional, keyword-only
        Of the sensors' own noise; needed if the scenario has any. Run w of a sequence depends on the seed and
        w.
    method : {"linear", "strapdown"}, keyword-only
        ``"linear"`` for many runs, milliseconds each; ``"strapdown"`` the exact run by python-ins, seconds
        each. Both take the same noise and the same (exact) alignment.
    run_errors : RunErrors, optional, keyword-only
        Noise drawn before, instead of the seed.

    Returns
    -------
    NavigationError
        Of shape (N,) for one calibration, (W, N) for a sequence.

    Raises
    ------
    InvalidInput
        If noise is asked for without a seed, there is no calibration, or a gyro is so wrong that it cannot
        find north.
    UnknownName
        If the method is not known.
    NumericalFault
        If a strapdown run diverges.

    Notes
    -----
    The error of a sensor that should read x is A x + c from the calibration, plus its own s x + b + w of this
    run; the products of the two are left out. On 24 h of rest the linear model differs from the strapdown run
    by less than one per cent of the largest error.

    Examples
    --------
    A thousandth of a degree per hour about the vertical, without alignment, ends 0.72 nautical miles off:

    >>> from navopt.models import StaticScenario
    >>> drift = CalibrationResidual.of_errors(bias=(0.0, 0.0, 4.85e-9))
    >>> float(navigation_error(drift, StaticScenario(alignment="perfect")).end_nmi.round(2))
    0.72
    """
    if method not in METHODS:
        raise UnknownName("method", method, METHODS)
    single = isinstance(calibration, CalibrationResidual)
    residuals = [calibration] if isinstance(calibration, CalibrationResidual) else list(calibration)
    if not residuals:
        raise InvalidInput("calibration", calibration, "give at least one CalibrationResidual")
    own = run_errors if run_errors is not None else draw_run_errors(scenario, len(residuals), seed)
    if len(own.bias) != len(residuals):
        raise InvalidInput("run_errors", len(own.bias), f"give the errors of {len(residuals)} runs")
    steps = error_steps(scenario)
    # A and c of every run; the run's own scale-factor and bias errors are of the same form
    gain = np.zeros((len(residuals), 2, 3, 3))
    constant = own.bias.copy()
    for w, residual in enumerate(residuals):
        for k, (matrix, offset) in enumerate((residual.gyro, residual.accelerometer)):
            gain[w, k] = matrix
            constant[w, 3 * k : 3 * k + 3] += offset
        gain[w, 0] += np.diag(own.scale[w])
    attitude = _aligned(scenario, steps.start, gain, constant + own.alignment, steps.heading)
    if method == "linear":
        errors = np.concatenate(
            [
                np.einsum("wij,kj->wki", gain[:, 0], steps.readings[:, :3]),
                np.einsum("wij,kj->wki", gain[:, 1], steps.readings[:, 3:]),
            ],
            axis=-1,
        )
        errors += constant[:, None] + own.white
        angles = platform_angles(attitude, attitude_matrix(steps.heading))
        position = propagate(steps, errors, angles)
    else:
        from navopt.models.navigation_strapdown import strapdown_run

        position = np.stack(
            [
                strapdown_run(scenario, gain[w], constant[w], own.white[w], attitude[w])
                for w in range(len(residuals))
            ]
        )
    columns = (position[..., 0], position[..., 1], own.reference[..., 0], own.reference[..., 1])
    north, east, reference_north, reference_east = (c[0].copy() if single else c.copy() for c in columns)
    return NavigationError(
        time_s=steps.time.copy(),
        north_m=north,
        east_m=east,
        reference_north_m=reference_north,
        reference_east_m=reference_east,
    )


def _aligned(
    scenario: NavigationScenario, start: Array, gain: Array, constant: Array, heading: float
) -> Array:
    """C_b^n that each of the systems believes in at departure, shape (W, 3, 3)."""
    if scenario.alignment == "perfect":
        return np.broadcast_to(attitude_matrix(heading), (len(gain), 3, 3))
    gyro = start[:3] + gain[:, 0] @ start[:3] + constant[:, :3]
    force = start[3:] + gain[:, 1] @ start[3:] + constant[:, 3:]
    return align(gyro @ SWAP, force @ SWAP, scenario.latitude, method=scenario.alignment)
