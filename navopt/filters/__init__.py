"""Kalman filters of many noise covariances at once, filters of nonlinear models, and their consistency."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.filters import steady_state as steady_state
    from navopt.filters.asynchronous import align_measurements as align_measurements
    from navopt.filters.batch_kalman import BatchKalman as BatchKalman
    from navopt.filters.batch_kalman import BatchRun as BatchRun
    from navopt.filters.batch_kalman import BatchSmoothed as BatchSmoothed
    from navopt.filters.consistency import Consistency as Consistency
    from navopt.filters.consistency import check_consistency as check_consistency
    from navopt.filters.consistency import chi_square_band as chi_square_band
    from navopt.filters.consistency import ljung_box as ljung_box
    from navopt.filters.consistency import normalised_squares as normalised_squares
    from navopt.filters.consistency import whitened as whitened
    from navopt.filters.extended import ExtendedFilter as ExtendedFilter
    from navopt.filters.fading import StrongTracking as StrongTracking
    from navopt.filters.heading_filter import HeadingFilter as HeadingFilter
    from navopt.filters.heading_filter import HeadingInputs as HeadingInputs
    from navopt.filters.heading_filter import HeadingRun as HeadingRun
    from navopt.filters.heading_filter import filter_heading as filter_heading
    from navopt.filters.heading_filter import filter_headings as filter_headings
    from navopt.filters.information import fisher_information as fisher_information
    from navopt.filters.noise_adaptation import NoiseAdaptation as NoiseAdaptation
    from navopt.filters.nonlinear import FilterRun as FilterRun
    from navopt.filters.steady_state import SteadyState as SteadyState
    from navopt.filters.steady_state import alpha_beta as alpha_beta
    from navopt.filters.unscented import UnscentedFilter as UnscentedFilter

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "BatchKalman": "navopt.filters.batch_kalman",
        "BatchRun": "navopt.filters.batch_kalman",
        "BatchSmoothed": "navopt.filters.batch_kalman",
        "Consistency": "navopt.filters.consistency",
        "ExtendedFilter": "navopt.filters.extended",
        "FilterRun": "navopt.filters.nonlinear",
        "HeadingFilter": "navopt.filters.heading_filter",
        "HeadingInputs": "navopt.filters.heading_filter",
        "HeadingRun": "navopt.filters.heading_filter",
        "NoiseAdaptation": "navopt.filters.noise_adaptation",
        "SteadyState": "navopt.filters.steady_state",
        "StrongTracking": "navopt.filters.fading",
        "UnscentedFilter": "navopt.filters.unscented",
        "align_measurements": "navopt.filters.asynchronous",
        "alpha_beta": "navopt.filters.steady_state",
        "check_consistency": "navopt.filters.consistency",
        "chi_square_band": "navopt.filters.consistency",
        "filter_heading": "navopt.filters.heading_filter",
        "filter_headings": "navopt.filters.heading_filter",
        "fisher_information": "navopt.filters.information",
        "ljung_box": "navopt.filters.consistency",
        "normalised_squares": "navopt.filters.consistency",
        "steady_state": "navopt.filters.steady_state",
        "whitened": "navopt.filters.consistency",
    },
)
