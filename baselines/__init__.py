"""Deterministic solvers behind the same interface as the swarms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from baselines.base import Baseline as Baseline
    from baselines.calibration_fit import Calibrated as Calibrated
    from baselines.calibration_fit import ImuFit as ImuFit
    from baselines.calibration_fit import TriadFit as TriadFit
    from baselines.iccp import ContourMatch as ContourMatch
    from baselines.iccp import Iccp as Iccp
    from baselines.nominal import Nominal as Nominal
    from baselines.norm_least_squares import NormLeastSquares as NormLeastSquares
    from baselines.particle_matching import FilteredTrack as FilteredTrack
    from baselines.particle_matching import ParticleMatching as ParticleMatching
    from baselines.point_mass import PointMass as PointMass
    from baselines.six_position import SixPosition as SixPosition
    from baselines.tercom import Tercom as Tercom
    from baselines.track_estimate import Gate as Gate
    from baselines.track_estimate import TrackEstimate as TrackEstimate
    from baselines.track_follower import TrackFollower as TrackFollower
    from baselines.track_map import TrackMAP as TrackMAP
    from baselines.turntable_least_squares import TurntableLeastSquares as TurntableLeastSquares
    from baselines.window_map import WindowMAP as WindowMAP

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "Baseline": "baselines.base",
        "Calibrated": "baselines.calibration_fit",
        "ContourMatch": "baselines.iccp",
        "FilteredTrack": "baselines.particle_matching",
        "Gate": "baselines.track_estimate",
        "Iccp": "baselines.iccp",
        "ImuFit": "baselines.calibration_fit",
        "Nominal": "baselines.nominal",
        "NormLeastSquares": "baselines.norm_least_squares",
        "ParticleMatching": "baselines.particle_matching",
        "PointMass": "baselines.point_mass",
        "SixPosition": "baselines.six_position",
        "Tercom": "baselines.tercom",
        "TrackEstimate": "baselines.track_estimate",
        "TrackFollower": "baselines.track_follower",
        "TrackMAP": "baselines.track_map",
        "TriadFit": "baselines.calibration_fit",
        "TurntableLeastSquares": "baselines.turntable_least_squares",
        "WindowMAP": "baselines.window_map",
    },
)
