"""Logs of increments in the form of the PSINS toolbox."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from navopt.data.imu_recording import ImuRecording
from navopt.errors import InvalidInput
from navopt.models.earth import normal_gravity

__all__ = ["read_psins_imu", "read_text"]

#: Decrease of gravity with height, 1/s2.
FREE_AIR = 3.086e-6


def read_psins_imu(path: str | Path) -> ImuRecording:
    """Read a log of increments in the form of the PSINS toolbox (``.imu``).

    Lines that begin with ``%`` are comments. Three header rows follow: initial state; latitude and longitude
    in degrees, height, first time, sampling interval in ms, gravity; seconds of arc per gyro count and
    micro-g times s per accelerometer count. Every further row has three angle and three velocity increments.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    ImuRecording
        Increments divided by the sampling interval, rad/s and m/s2. The micro-g of the scales are those of
        the gravity in the header, which need not be that of the site: `gravity` is normal gravity at its
        latitude and height.

    Raises
    ------
    InvalidInput
        If the header or a row cannot be read.
    """
    file = Path(path)
    rows = [
        (k, line.split())
        for k, line in enumerate(read_text(file).splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("%")
    ]
    try:
        header = [[float(cell) for cell in cells] for _, cells in rows[:3]]
        latitude_deg, _, height, start, interval_ms, unit_gravity = header[1]
        scales = np.array(header[2])
        if scales.shape != (6,) or interval_ms <= 0 or unit_gravity <= 0:
            raise ValueError
    except (ValueError, IndexError):
        raise InvalidInput(
            "--imu", file.name, "give a PSINS log: three header rows (state, site, scales), then increments"
        ) from None
    increments = np.empty((len(rows) - 3, 6))
    for k, (line, cells) in enumerate(rows[3:]):
        try:
            increments[k] = [float(cell) for cell in cells]
        except ValueError:
            raise InvalidInput("--imu", f"line {line} of {file.name}", "give six increments there") from None
    interval = 1e-3 * interval_ms
    return ImuRecording(
        time=start + interval * np.arange(1, len(increments) + 1),
        gyro=increments[:, :3] * scales[:3] * np.radians(1.0 / 3600.0) / interval,
        accelerometer=increments[:, 3:] * scales[3:] * 1e-6 * unit_gravity / interval,
        latitude=float(np.radians(latitude_deg)),
        gravity=float(normal_gravity(np.radians(latitude_deg))) - FREE_AIR * height,
        source=file.name,
    )


def read_text(file: Path) -> str:
    """Return the text of a file.

    Parameters
    ----------
    file : pathlib.Path
        The file, in UTF-8.

    Returns
    -------
    str

    Raises
    ------
    InvalidInput
        If it does not exist or is no text.
    """
    if not file.is_file():
        raise InvalidInput("--imu", str(file), "give an existing file")
    try:
        return file.read_text(encoding="utf-8-sig")
    except (UnicodeDecodeError, OSError):
        raise InvalidInput("--imu", file.name, "give a file of text that can be read") from None
