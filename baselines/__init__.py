"""Deterministic solvers behind the same interface as the swarms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from baselines.base import Baseline as Baseline
    from baselines.iccp import ContourMatch as ContourMatch
    from baselines.iccp import Iccp as Iccp
    from baselines.nominal import Nominal as Nominal
    from baselines.particle_matching import FilteredTrack as FilteredTrack
    from baselines.particle_matching import ParticleMatching as ParticleMatching
    from baselines.point_mass import PointMass as PointMass
    from baselines.tercom import Tercom as Tercom
    from baselines.track_estimate import Gate as Gate
    from baselines.track_estimate import TrackEstimate as TrackEstimate
    from baselines.track_follower import TrackFollower as TrackFollower
    from baselines.track_map import TrackMAP as TrackMAP
    from baselines.window_map import WindowMAP as WindowMAP

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "Baseline": "baselines.base",
        "ContourMatch": "baselines.iccp",
        "FilteredTrack": "baselines.particle_matching",
        "Gate": "baselines.track_estimate",
        "Iccp": "baselines.iccp",
        "Nominal": "baselines.nominal",
        "ParticleMatching": "baselines.particle_matching",
        "PointMass": "baselines.point_mass",
        "Tercom": "baselines.tercom",
        "TrackEstimate": "baselines.track_estimate",
        "TrackFollower": "baselines.track_follower",
        "TrackMAP": "baselines.track_map",
        "WindowMAP": "baselines.window_map",
    },
)
