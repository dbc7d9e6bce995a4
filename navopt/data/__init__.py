"""Embedded gravity grids, how they were made, and readers for users' files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.data.egm2008 import free_air_anomaly as free_air_anomaly
    from navopt.data.tracks import MeasuredTrack as MeasuredTrack
    from navopt.data.tracks import read_track_csv as read_track_csv

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "MeasuredTrack": "navopt.data.tracks",
        "free_air_anomaly": "navopt.data.egm2008",
        "read_track_csv": "navopt.data.tracks",
    },
)
