"""Physics without optimisation: maps, the Earth, inertial navigation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.models import earth as earth
    from navopt.models.cruise import CruiseScenario as CruiseScenario
    from navopt.models.cruise import InsErrors as InsErrors
    from navopt.models.cruise import InsTrack as InsTrack
    from navopt.models.field_map import FieldMap as FieldMap
    from navopt.models.ins import ErrorBasis as ErrorBasis
    from navopt.models.ins import error_basis as error_basis
    from navopt.models.ins import linear_ins_track as linear_ins_track
    from navopt.models.ins import position_error_covariance as position_error_covariance
    from navopt.models.ins import simulate_ins as simulate_ins
    from navopt.models.ins import velocity_error_covariance as velocity_error_covariance
    from navopt.models.sins_error import TrueMotion as TrueMotion
    from navopt.models.sins_error import propagate_ins_errors as propagate_ins_errors
    from navopt.models.sins_error import segment_heading_error as segment_heading_error
    from navopt.models.sins_error import segment_length_ratio as segment_length_ratio
    from navopt.models.sins_error import segment_scale as segment_scale
    from navopt.models.track_errors import TrackErrorBasis as TrackErrorBasis
    from navopt.models.track_errors import track_error_basis as track_error_basis

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "CruiseScenario": "navopt.models.cruise",
        "ErrorBasis": "navopt.models.ins",
        "FieldMap": "navopt.models.field_map",
        "InsErrors": "navopt.models.cruise",
        "InsTrack": "navopt.models.cruise",
        "TrackErrorBasis": "navopt.models.track_errors",
        "TrueMotion": "navopt.models.sins_error",
        "earth": "navopt.models.earth",
        "error_basis": "navopt.models.ins",
        "linear_ins_track": "navopt.models.ins",
        "position_error_covariance": "navopt.models.ins",
        "propagate_ins_errors": "navopt.models.sins_error",
        "segment_heading_error": "navopt.models.sins_error",
        "segment_length_ratio": "navopt.models.sins_error",
        "segment_scale": "navopt.models.sins_error",
        "simulate_ins": "navopt.models.ins",
        "track_error_basis": "navopt.models.track_errors",
        "velocity_error_covariance": "navopt.models.ins",
    },
)
