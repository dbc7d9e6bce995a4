"""Kalman filters for whole populations of noise covariances, and what tells whether they are consistent."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.filters import steady_state as steady_state
    from navopt.filters.batch_kalman import BatchKalman as BatchKalman
    from navopt.filters.batch_kalman import BatchRun as BatchRun
    from navopt.filters.batch_kalman import BatchSmoothed as BatchSmoothed
    from navopt.filters.consistency import Consistency as Consistency
    from navopt.filters.consistency import check_consistency as check_consistency
    from navopt.filters.consistency import chi_square_band as chi_square_band
    from navopt.filters.consistency import ljung_box as ljung_box
    from navopt.filters.consistency import normalised_squares as normalised_squares
    from navopt.filters.consistency import whitened as whitened
    from navopt.filters.information import fisher_information as fisher_information
    from navopt.filters.steady_state import SteadyState as SteadyState
    from navopt.filters.steady_state import alpha_beta as alpha_beta

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "BatchKalman": "navopt.filters.batch_kalman",
        "BatchRun": "navopt.filters.batch_kalman",
        "BatchSmoothed": "navopt.filters.batch_kalman",
        "Consistency": "navopt.filters.consistency",
        "SteadyState": "navopt.filters.steady_state",
        "alpha_beta": "navopt.filters.steady_state",
        "check_consistency": "navopt.filters.consistency",
        "chi_square_band": "navopt.filters.consistency",
        "fisher_information": "navopt.filters.information",
        "ljung_box": "navopt.filters.consistency",
        "normalised_squares": "navopt.filters.consistency",
        "steady_state": "navopt.filters.steady_state",
        "whitened": "navopt.filters.consistency",
    },
)
