"""One run by the strapdown algorithm of python-ins: what the linear model is checked against."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navopt.errors import NumericalFault
from navopt.models.earth import separation
from navopt.models.navigation_linear import SWAP
from navopt.models.navigation_scenarios import NavigationScenario

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["strapdown_run"]

Array = NDArray[np.float64]


@lru_cache(maxsize=2)
def _perfect_readings(scenario: NavigationScenario) -> tuple[pd.DataFrame, pd.DataFrame]:
    """True motion and error-free increments (forward, right, down) in python-ins's tables (degrees)."""
    from pyins import sim

    path = scenario.path()
    position = np.degrees(np.stack([path.latitude, path.longitude], axis=-1))
    lla = np.column_stack([position, np.zeros(len(position))])
    rph = np.zeros_like(lla)
    rph[:, 2] = np.degrees(path.heading)
    velocity = np.column_stack([path.velocity, np.zeros(len(position))])
    return sim.generate_imu(path.time, lla, rph, velocity, "increment")


def strapdown_run(
    scenario: NavigationScenario, gain: Array, constant: Array, white: Array, attitude: Array
) -> Array:
    """Navigate one run with spoilt sensors.

    Parameters
    ----------
    scenario : NavigationScenario
        The journey.
    gain : ndarray, shape (2, 3, 3)
        Error of gyros and of accelerometers per unit of the true reading, axes of the triads.
    constant : ndarray, shape (6,)
        Their constant errors, rad/s and m/s^2.
    white : ndarray, shape (K, 6)
        Their noise in each step of the scenario.
    attitude : ndarray, shape (3, 3)
        C_b^n with which the run begins.

    Returns
    -------
    ndarray, shape (K + 1, 2)
        Position error north and east, m.

    Raises
    ------
    NumericalFault
        If the run diverges.

    Notes
    -----
    Savage's coning and sculling; the vertical channel held. Without errors, the scheme itself stays within a
    metre after a day of rest and within a metre on the lake.
    """
    from pyins import strapdown, transform

    trajectory, perfect = _perfect_readings(scenario)
    readings = perfect.to_numpy(copy=True)
    step = scenario.step_s / scenario.substeps
    errors = np.empty_like(readings)
    for part, matrix in ((slice(0, 3), gain[0]), (slice(3, 6), gain[1])):
        true = readings[:, part] @ SWAP
        noise = np.repeat(white[:, part], scenario.substeps, axis=0)
        # the table begins with a copy of its first increment
        errors[1:, part] = (true[1:] @ matrix.T + step * (constant[part] + noise)) @ SWAP
    errors[0] = errors[1]
    table = type(perfect)(readings + errors, index=perfect.index, columns=perfect.columns)
    increments = strapdown.compute_increments_from_imu(table, "increment")
    initial = trajectory.iloc[0].copy()
    initial[["roll", "pitch", "heading"]] = transform.mat_to_rph(attitude)
    result = strapdown.Integrator(initial, with_altitude=False).integrate(increments)
    chosen = slice(None, None, scenario.substeps)
    shown = np.radians(result[["lat", "lon"]].to_numpy()[chosen])
    true = np.radians(trajectory[["lat", "lon"]].to_numpy()[chosen])
    if not np.isfinite(shown).all():
        raise NumericalFault("the strapdown run diverged: the sensor errors are too large")
    return np.stack(separation(shown[:, 0], shown[:, 1], true[:, 0], true[:, 1]), axis=-1)
