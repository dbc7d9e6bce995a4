"""Embedded gravity grids, how they were made, and readers for users' files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.data.egm2008 import free_air_anomaly as free_air_anomaly
    from navopt.data.filter_logs import FilterLog as FilterLog
    from navopt.data.filter_logs import read_log as read_log
    from navopt.data.imu_files import read_imu as read_imu
    from navopt.data.imu_recording import ImuRecording as ImuRecording
    from navopt.data.map_files import read_map as read_map
    from navopt.data.model_files import FilterFile as FilterFile
    from navopt.data.model_files import parse_filter as parse_filter
    from navopt.data.model_files import read_filter as read_filter
    from navopt.data.recorded import RecordedTrack as RecordedTrack
    from navopt.data.recorded import read_track as read_track
    from navopt.data.ship_tracks import ShipTrack as ShipTrack
    from navopt.data.ship_tracks import read_ship_csv as read_ship_csv
    from navopt.data.tracks import MeasuredTrack as MeasuredTrack
    from navopt.data.tracks import read_track_csv as read_track_csv

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "FilterFile": "navopt.data.model_files",
        "FilterLog": "navopt.data.filter_logs",
        "ImuRecording": "navopt.data.imu_recording",
        "MeasuredTrack": "navopt.data.tracks",
        "RecordedTrack": "navopt.data.recorded",
        "ShipTrack": "navopt.data.ship_tracks",
        "free_air_anomaly": "navopt.data.egm2008",
        "parse_filter": "navopt.data.model_files",
        "read_filter": "navopt.data.model_files",
        "read_imu": "navopt.data.imu_files",
        "read_log": "navopt.data.filter_logs",
        "read_map": "navopt.data.map_files",
        "read_ship_csv": "navopt.data.ship_tracks",
        "read_track": "navopt.data.recorded",
        "read_track_csv": "navopt.data.tracks",
    },
)
