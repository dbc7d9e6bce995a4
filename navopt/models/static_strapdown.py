"""Free inertial run of a system at rest: the velocities it computes are its errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navopt.models.enu_attitude import attitude_enu
from navopt.models.readings import checked_readings
from navopt.models.static_alignment import StaticSite

__all__ = ["free_inertial"]

Array = NDArray[np.float64]

#: Between east, north, up and north, east, down, and between right, forward, up and forward, right, down.
SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def free_inertial(
    gyro: ArrayLike, accelerometer: ArrayLike, step: float, site: StaticSite, attitude: ArrayLike
) -> tuple[Array, Array]:
    """Integrate readings from rest by the strapdown algorithm of python-ins.

    Parameters
    ----------
    gyro, accelerometer : array_like, shape (N, 3)
        Angular rate and specific force in axes right, forward, up, means over each step, rad/s and m/s^2.
    step : float
        Time between two readings, s.
    site : StaticSite
        Where the system stands. Gravity is that of python-ins; height and vertical velocity are held, so
        only its direction matters.
    attitude : array_like, shape (3, 3)
        C_b^n at the start, as computed by a coarse alignment.

    Returns
    -------
    velocity : ndarray, shape (N + 1, 2)
        East and north, m/s, before the first step and after each.
    attitude : ndarray, shape (N + 1, 3, 3)
        The computed C_b^n at the same times.

    Raises
    ------
    InvalidInput
        If the readings are no finite arrays of one shape (N, 3), or the step is not positive.
    """
    import pandas as pd
    from pyins import strapdown, transform
    from pyins.util import TRAJECTORY_COLS

    w, f = checked_readings(gyro, accelerometer, step)
    increments = np.concatenate([w @ SWAP, f @ SWAP], axis=1) * step
    # python-ins wants one reading before the first, for its coning and sculling terms
    increments = np.vstack([increments[:1], increments])
    imu = pd.DataFrame(
        increments,
        index=step * np.arange(len(increments)),
        columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"],
    )
    start = SWAP @ np.asarray(attitude, dtype=np.float64) @ SWAP
    state = [np.degrees(site.latitude), 0.0, site.height, 0.0, 0.0, 0.0, *transform.mat_to_rph(start)]
    integrator = strapdown.Integrator(
        pd.Series(dict(zip(TRAJECTORY_COLS, state, strict=True)), name=0.0), with_altitude=False
    )
    track = integrator.integrate(strapdown.compute_increments_from_imu(imu, "increment"))
    velocity = track[["VE", "VN"]].to_numpy(dtype=np.float64)
    roll, pitch, heading = np.radians(track[["roll", "pitch", "heading"]].to_numpy(dtype=np.float64)).T
    return velocity, attitude_enu(pitch, roll, heading)
