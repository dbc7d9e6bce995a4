"""Whether a filter's own covariances agree with its errors and innovations (Bar-Shalom et al. 2001).

A filter with the true Q and R has normalised squares that follow χ² laws and innovations that are white. A
filter tuned for the smallest error alone need not: the gain stays the same if Q and R are multiplied by one
number, while its covariances become wrong by it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from navopt.errors import InvalidInput

__all__ = [
    "Consistency",
    "check_consistency",
    "chi_square_band",
    "ljung_box",
    "normalised_squares",
    "whitened",
]


def normalised_squares(errors: Any, covariances: Any) -> np.ndarray:
    """``eᵀ P⁻¹ e`` of each error: NEES of states, NIS of innovations.

    Parameters
    ----------
    errors : array_like, shape (..., n)
        Errors. NaN entries, such as innovations of missing measurements, are left out.
    covariances : array_like, shape (..., n, n)
        Their covariances.

    Returns
    -------
    ndarray, shape (...)
        Zero where every entry is missing.
    """
    w = whitened(errors, covariances)
    return np.nansum(w * w, axis=-1)


def whitened(errors: Any, covariances: Any) -> np.ndarray:
    """``L⁻¹ e`` with ``P = L Lᵀ``: independent, of unit variance if the covariances are right.

    Parameters
    ----------
    errors, covariances : array_like, shapes (..., n) and (..., n, n)
        Errors and their covariances; NaN errors are left out.

    Returns
    -------
    ndarray, shape (..., n)
        NaN where an error is missing.

    Raises
    ------
    InvalidInput
        If shapes do not fit or a covariance is not positive definite.
    """
    errors, covariances = np.array(errors, dtype=float), np.array(covariances, dtype=float)
    n = errors.shape[-1] if errors.ndim else 0
    if not n or covariances.shape != (*errors.shape, n):
        raise InvalidInput("covariances", covariances.shape, f"give {(*errors.shape, n)} for these errors")
    missing = np.isnan(errors)
    either = missing[..., :, None] | missing[..., None, :]
    filled = np.where(either, np.eye(n), covariances)
    try:
        root = np.linalg.cholesky(filled)
    except np.linalg.LinAlgError:
        raise InvalidInput("covariances", "not positive definite", "give covariances of errors") from None
    w = np.linalg.solve(root, np.where(missing, 0.0, errors)[..., None])[..., 0]
    w[missing] = np.nan
    return w


def chi_square_band(freedom: float, count: int = 1, *, probability: float = 0.95) -> tuple[float, float]:
    """Band in which the mean of `count` independent χ² numbers lies with a probability.

    Parameters
    ----------
    freedom : float
        Degrees of freedom of each: channels for NIS, states for NEES.
    count : int
        How many are averaged. NIS of one run are independent over time, NEES only over runs.
    probability : float
        Of the band, both tails alike.

    Returns
    -------
    tuple of float
        Lower and upper end.

    Raises
    ------
    InvalidInput
    """
    if not (np.isfinite(freedom) and freedom > 0.0):
        raise InvalidInput("freedom", freedom, "give a positive number of degrees of freedom")
    if count < 1:
        raise InvalidInput("count", count, "give at least 1")
    if not 0.0 < probability < 1.0:
        raise InvalidInput("probability", probability, "give a probability between 0 and 1")
    tail = 0.5 * (1.0 - probability)
    low, high = chi2.ppf([tail, 1.0 - tail], freedom * count) / count
    return float(low), float(high)


def ljung_box(values: Any, lags: int = 20) -> tuple[float, float]:
    """Ljung-Box test of whiteness (Ljung & Box 1978, Biometrika 65:297), ``Q = N (N + 2) Σ ρ_j² / (N - j)``.

    Parameters
    ----------
    values : array_like, shape (T,)
        Series; NaN entries are skipped in every product they would take part in.
    lags : int
        Number of autocorrelations looked at.

    Returns
    -------
    tuple of float
        Statistic, χ² with `lags` degrees of freedom if the series is white, and p-value.

    Raises
    ------
    InvalidInput
        If the series is shorter than the lags or does not vary.
    """
    series = np.array(values, dtype=float)
    there = np.isfinite(series)
    number = int(there.sum())
    if series.ndim != 1 or not 1 <= lags < number:
        raise InvalidInput(
            "values", f"{number} values for {lags} lags", "give one series longer than the lags"
        )
    centred = np.where(there, series - series[there].mean(), 0.0)
    power = float(centred @ centred)
    if power == 0.0:
        raise InvalidInput("values", "constant", "give a series that varies")
    correlation = np.array([centred[j:] @ centred[:-j] for j in range(1, lags + 1)]) / power
    statistic = float(number * (number + 2) * np.sum(correlation**2 / (number - np.arange(1, lags + 1))))
    return statistic, float(chi2.sf(statistic, lags))


@dataclass(frozen=True)
class Consistency:
    """Judgement on the innovations of one run.

    Attributes
    ----------
    nis : float
        Mean normalised innovation squared per measurement; 1 expected.
    nis_band : tuple of float
        Band of it for a consistent filter.
    whiteness : tuple of float
        p-values of the Ljung-Box test, one per channel.
    measurements : int
        Number of scalar measurements.
    consistent : bool
        Whether `nis` is in its band and no p-value is below its share of ``1 - probability``.
    """

    nis: float
    nis_band: tuple[float, float]
    whiteness: tuple[float, ...]
    measurements: int
    consistent: bool


def check_consistency(
    innovations: Any, covariances: Any, *, lags: int = 20, probability: float = 0.95
) -> Consistency:
    """Judge a filter by its innovations alone, as can be done without any truth.

    Parameters
    ----------
    innovations, covariances : array_like, shapes (T, m) and (T, m, m)
        Of one run; NaN where a measurement is missing.
    lags : int
        For the test of whiteness.
    probability : float
        That a consistent filter lies in the band of NIS.

    Returns
    -------
    Consistency
    """
    w = whitened(innovations, covariances)
    count = int(np.isfinite(w).sum())
    if not count:
        raise InvalidInput("innovations", "all missing", "give at least one measurement")
    nis = float(np.nansum(w * w) / count)
    band = chi_square_band(1.0, count, probability=probability)
    white = tuple(ljung_box(channel, lags)[1] for channel in w.T)
    level = (1.0 - probability) / len(white)
    return Consistency(nis, band, white, count, band[0] <= nis <= band[1] and min(white) >= level)
