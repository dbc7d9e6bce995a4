"""Deterministic solvers behind the same interface as the swarms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from baselines.adaptive_unscented import AdaptiveUnscented as AdaptiveUnscented
    from baselines.als_fit import fit_autocovariances as fit_autocovariances
    from baselines.autocovariance_least_squares import (
        AutocovarianceLeastSquares as AutocovarianceLeastSquares,
    )
    from baselines.base import Baseline as Baseline
    from baselines.calibration_fit import Calibrated as Calibrated
    from baselines.calibration_fit import ImuFit as ImuFit
    from baselines.calibration_fit import TriadFit as TriadFit
    from baselines.em_steps import fit_em as fit_em
    from baselines.expectation_maximization import ExpectationMaximization as ExpectationMaximization
    from baselines.fixed_tuning import FixedTuning as FixedTuning
    from baselines.iccp import ContourMatch as ContourMatch
    from baselines.iccp import Iccp as Iccp
    from baselines.innovation_adaptive import InnovationAdaptive as InnovationAdaptive
    from baselines.innovation_likelihood import InnovationLikelihood as InnovationLikelihood
    from baselines.likelihood_fit import fit_innovation_likelihood as fit_innovation_likelihood
    from baselines.likelihood_window import fit_windows as fit_windows
    from baselines.mehra import Mehra as Mehra
    from baselines.mehra_equations import fit_mehra as fit_mehra
    from baselines.mehra_equations import whiteness_test as whiteness_test
    from baselines.noise_baseline import EstimatedNoise as EstimatedNoise
    from baselines.noise_structure import NoiseStructure as NoiseStructure
    from baselines.nominal import Nominal as Nominal
    from baselines.norm_least_squares import NormLeastSquares as NormLeastSquares
    from baselines.particle_matching import FilteredTrack as FilteredTrack
    from baselines.particle_matching import ParticleMatching as ParticleMatching
    from baselines.point_mass import PointMass as PointMass
    from baselines.sage_husa import SageHusa as SageHusa
    from baselines.six_position import SixPosition as SixPosition
    from baselines.steady_state_check import check_steady_state as check_steady_state
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
        "AdaptiveUnscented": "baselines.adaptive_unscented",
        "AutocovarianceLeastSquares": "baselines.autocovariance_least_squares",
        "Baseline": "baselines.base",
        "Calibrated": "baselines.calibration_fit",
        "ContourMatch": "baselines.iccp",
        "EstimatedNoise": "baselines.noise_baseline",
        "ExpectationMaximization": "baselines.expectation_maximization",
        "FilteredTrack": "baselines.particle_matching",
        "FixedTuning": "baselines.fixed_tuning",
        "Gate": "baselines.track_estimate",
        "Iccp": "baselines.iccp",
        "ImuFit": "baselines.calibration_fit",
        "InnovationAdaptive": "baselines.innovation_adaptive",
        "InnovationLikelihood": "baselines.innovation_likelihood",
        "Mehra": "baselines.mehra",
        "NoiseStructure": "baselines.noise_structure",
        "Nominal": "baselines.nominal",
        "NormLeastSquares": "baselines.norm_least_squares",
        "ParticleMatching": "baselines.particle_matching",
        "PointMass": "baselines.point_mass",
        "SageHusa": "baselines.sage_husa",
        "SixPosition": "baselines.six_position",
        "Tercom": "baselines.tercom",
        "TrackEstimate": "baselines.track_estimate",
        "TrackFollower": "baselines.track_follower",
        "TrackMAP": "baselines.track_map",
        "TriadFit": "baselines.calibration_fit",
        "TurntableLeastSquares": "baselines.turntable_least_squares",
        "WindowMAP": "baselines.window_map",
        "check_steady_state": "baselines.steady_state_check",
        "fit_autocovariances": "baselines.als_fit",
        "fit_em": "baselines.em_steps",
        "fit_innovation_likelihood": "baselines.likelihood_fit",
        "fit_mehra": "baselines.mehra_equations",
        "fit_windows": "baselines.likelihood_window",
        "whiteness_test": "baselines.mehra_equations",
    },
)
