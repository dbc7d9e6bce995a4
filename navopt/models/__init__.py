"""Physics without optimisation: maps, the Earth, inertial navigation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.models import earth as earth
    from navopt.models.alignment_sensors import ImuGrade as ImuGrade
    from navopt.models.covariance_analysis import analyse_filter as analyse_filter
    from navopt.models.cruise import CruiseScenario as CruiseScenario
    from navopt.models.cruise import InsErrors as InsErrors
    from navopt.models.cruise import InsTrack as InsTrack
    from navopt.models.field_map import FieldMap as FieldMap
    from navopt.models.heading_alignment import HeadingScenario as HeadingScenario
    from navopt.models.heading_alignment import simulate_heading_record as simulate_heading_record
    from navopt.models.heading_record import HeadingRecord as HeadingRecord
    from navopt.models.heading_record import record_from_imu as record_from_imu
    from navopt.models.imu_calibration import ImuCalibration as ImuCalibration
    from navopt.models.ins import ErrorBasis as ErrorBasis
    from navopt.models.ins import error_basis as error_basis
    from navopt.models.ins import linear_ins_track as linear_ins_track
    from navopt.models.ins import position_error_covariance as position_error_covariance
    from navopt.models.ins import simulate_ins as simulate_ins
    from navopt.models.ins import velocity_error_covariance as velocity_error_covariance
    from navopt.models.laser_spot import LaserSpot as LaserSpot
    from navopt.models.linear_gaussian import LinearGaussianModel as LinearGaussianModel
    from navopt.models.navigation import CalibrationResidual as CalibrationResidual
    from navopt.models.navigation import NavigationError as NavigationError
    from navopt.models.navigation import navigation_error as navigation_error
    from navopt.models.navigation_scenarios import LakeScenario as LakeScenario
    from navopt.models.navigation_scenarios import StaticScenario as StaticScenario
    from navopt.models.positions import attitude_from_euler as attitude_from_euler
    from navopt.models.positions import earth_rate as earth_rate
    from navopt.models.positions import rate_positions as rate_positions
    from navopt.models.positions import scattered_positions as scattered_positions
    from navopt.models.positions import six_positions as six_positions
    from navopt.models.positions import specific_force as specific_force
    from navopt.models.positions import twenty_four_positions as twenty_four_positions
    from navopt.models.resting_strapdown import resting_strapdown as resting_strapdown
    from navopt.models.sensor_noise import AccelerometerNoise as AccelerometerNoise
    from navopt.models.sensor_noise import GyroNoise as GyroNoise
    from navopt.models.sins_error import TrueMotion as TrueMotion
    from navopt.models.sins_error import propagate_ins_errors as propagate_ins_errors
    from navopt.models.sins_error import segment_heading_error as segment_heading_error
    from navopt.models.sins_error import segment_length_ratio as segment_length_ratio
    from navopt.models.sins_error import segment_scale as segment_scale
    from navopt.models.static_alignment import AlignmentModel as AlignmentModel
    from navopt.models.static_alignment import StaticSite as StaticSite
    from navopt.models.track_errors import TrackErrorBasis as TrackErrorBasis
    from navopt.models.track_errors import track_error_basis as track_error_basis
    from navopt.models.triad import AccelerometerTriad as AccelerometerTriad
    from navopt.models.triad import GyroTriad as GyroTriad
    from navopt.models.triad import SensorTriad as SensorTriad
    from navopt.models.triad import residual_error as residual_error
    from navopt.models.turntable import fit_turntable as fit_turntable

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "AccelerometerNoise": "navopt.models.sensor_noise",
        "AccelerometerTriad": "navopt.models.triad",
        "AlignmentModel": "navopt.models.static_alignment",
        "CalibrationResidual": "navopt.models.navigation",
        "CruiseScenario": "navopt.models.cruise",
        "ErrorBasis": "navopt.models.ins",
        "FieldMap": "navopt.models.field_map",
        "GyroNoise": "navopt.models.sensor_noise",
        "GyroTriad": "navopt.models.triad",
        "HeadingRecord": "navopt.models.heading_record",
        "HeadingScenario": "navopt.models.heading_alignment",
        "ImuCalibration": "navopt.models.imu_calibration",
        "ImuGrade": "navopt.models.alignment_sensors",
        "InsErrors": "navopt.models.cruise",
        "InsTrack": "navopt.models.cruise",
        "LakeScenario": "navopt.models.navigation_scenarios",
        "LaserSpot": "navopt.models.laser_spot",
        "LinearGaussianModel": "navopt.models.linear_gaussian",
        "NavigationError": "navopt.models.navigation",
        "SensorTriad": "navopt.models.triad",
        "StaticScenario": "navopt.models.navigation_scenarios",
        "StaticSite": "navopt.models.static_alignment",
        "TrackErrorBasis": "navopt.models.track_errors",
        "TrueMotion": "navopt.models.sins_error",
        "analyse_filter": "navopt.models.covariance_analysis",
        "attitude_from_euler": "navopt.models.positions",
        "earth": "navopt.models.earth",
        "earth_rate": "navopt.models.positions",
        "error_basis": "navopt.models.ins",
        "fit_turntable": "navopt.models.turntable",
        "linear_ins_track": "navopt.models.ins",
        "navigation_error": "navopt.models.navigation",
        "position_error_covariance": "navopt.models.ins",
        "propagate_ins_errors": "navopt.models.sins_error",
        "rate_positions": "navopt.models.positions",
        "record_from_imu": "navopt.models.heading_record",
        "residual_error": "navopt.models.triad",
        "resting_strapdown": "navopt.models.resting_strapdown",
        "scattered_positions": "navopt.models.positions",
        "segment_heading_error": "navopt.models.sins_error",
        "segment_length_ratio": "navopt.models.sins_error",
        "segment_scale": "navopt.models.sins_error",
        "simulate_heading_record": "navopt.models.heading_alignment",
        "simulate_ins": "navopt.models.ins",
        "six_positions": "navopt.models.positions",
        "specific_force": "navopt.models.positions",
        "track_error_basis": "navopt.models.track_errors",
        "twenty_four_positions": "navopt.models.positions",
        "velocity_error_covariance": "navopt.models.ins",
    },
)
