"""Estimation problems: what the papers ask, each with its simulated worlds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.problems.analytic import Ackley as Ackley
    from navopt.problems.analytic import Griewank as Griewank
    from navopt.problems.analytic import HelicalValley as HelicalValley
    from navopt.problems.analytic import Rastrigin as Rastrigin
    from navopt.problems.analytic import Rosenbrock as Rosenbrock
    from navopt.problems.analytic import Sphere as Sphere
    from navopt.problems.analytic import TestTubeHolder as TestTubeHolder
    from navopt.problems.analytic import Wood as Wood
    from navopt.problems.analytic import Zettl as Zettl
    from navopt.problems.analytic_base import AnalyticFunction as AnalyticFunction
    from navopt.problems.analytic_base import Point as Point
    from navopt.problems.analytic_base import ScalableFunction as ScalableFunction
    from navopt.problems.gravity_matching import GravityMatching as GravityMatching
    from navopt.problems.gravity_matching import MatchedTrack as MatchedTrack
    from navopt.problems.gravity_posterior import TrackPosterior as TrackPosterior
    from navopt.problems.gravity_sensing import MeasurementErrors as MeasurementErrors
    from navopt.problems.gravity_window import track_error_bound as track_error_bound
    from navopt.problems.gravity_window import window_error_bound as window_error_bound
    from navopt.problems.gyro_calibration import GyroCalibration as GyroCalibration
    from navopt.problems.gyro_navigation import GyroNavigation as GyroNavigation
    from navopt.problems.heading_alignment import HeadingAlignment as HeadingAlignment
    from navopt.problems.heading_scores import convergence_time as convergence_time
    from navopt.problems.heading_settings import HeadingSettings as HeadingSettings
    from navopt.problems.heading_settings import HeadingTruth as HeadingTruth
    from navopt.problems.noise_estimate import NoiseEstimate as NoiseEstimate
    from navopt.problems.noise_estimate import NoiseTruth as NoiseTruth
    from navopt.problems.noise_tuning import NoiseTuning as NoiseTuning
    from navopt.problems.noisy import Noisy as Noisy
    from navopt.problems.pushing_distance import PushingDistance as PushingDistance
    from navopt.problems.pushing_distance import integrate_twice as integrate_twice
    from navopt.problems.restricted import Restricted as Restricted
    from navopt.problems.ship_gravity import ShipGravity as ShipGravity
    from navopt.problems.static_alignment import AlignedAttitude as AlignedAttitude
    from navopt.problems.static_alignment import StaticAlignment as StaticAlignment
    from navopt.problems.wrapper_base import Wrapper as Wrapper
    from navopt.problems.wrappers import Rotated as Rotated
    from navopt.problems.wrappers import Scaled as Scaled
    from navopt.problems.wrappers import Shifted as Shifted

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "Ackley": "navopt.problems.analytic",
        "AlignedAttitude": "navopt.problems.static_alignment",
        "AnalyticFunction": "navopt.problems.analytic_base",
        "GravityMatching": "navopt.problems.gravity_matching",
        "Griewank": "navopt.problems.analytic",
        "GyroCalibration": "navopt.problems.gyro_calibration",
        "GyroNavigation": "navopt.problems.gyro_navigation",
        "HeadingAlignment": "navopt.problems.heading_alignment",
        "HeadingSettings": "navopt.problems.heading_settings",
        "HeadingTruth": "navopt.problems.heading_settings",
        "HelicalValley": "navopt.problems.analytic",
        "MatchedTrack": "navopt.problems.gravity_matching",
        "MeasurementErrors": "navopt.problems.gravity_sensing",
        "NoiseEstimate": "navopt.problems.noise_estimate",
        "NoiseTruth": "navopt.problems.noise_estimate",
        "NoiseTuning": "navopt.problems.noise_tuning",
        "Noisy": "navopt.problems.noisy",
        "Point": "navopt.problems.analytic_base",
        "PushingDistance": "navopt.problems.pushing_distance",
        "Rastrigin": "navopt.problems.analytic",
        "Restricted": "navopt.problems.restricted",
        "Rosenbrock": "navopt.problems.analytic",
        "Rotated": "navopt.problems.wrappers",
        "ScalableFunction": "navopt.problems.analytic_base",
        "Scaled": "navopt.problems.wrappers",
        "Shifted": "navopt.problems.wrappers",
        "ShipGravity": "navopt.problems.ship_gravity",
        "Sphere": "navopt.problems.analytic",
        "StaticAlignment": "navopt.problems.static_alignment",
        "TestTubeHolder": "navopt.problems.analytic",
        "TrackPosterior": "navopt.problems.gravity_posterior",
        "Wood": "navopt.problems.analytic",
        "Wrapper": "navopt.problems.wrapper_base",
        "Zettl": "navopt.problems.analytic",
        "convergence_time": "navopt.problems.heading_scores",
        "integrate_twice": "navopt.problems.pushing_distance",
        "track_error_bound": "navopt.problems.gravity_window",
        "window_error_bound": "navopt.problems.gravity_window",
    },
)
