"""What the innovations of one filter run say about its Q and R."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from navopt.errors import InvalidInput
from navopt.filters.batch_kalman import BatchKalman
from navopt.filters.consistency import chi_square_band, ljung_box, normalised_squares, whitened
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["FilterCheck", "check_filter"]

#: Autocorrelations looked at, and the least number of measurements for each.
LAGS, PER_LAG = 20, 4


@dataclass(frozen=True, kw_only=True)
class FilterCheck:
    """A filter's run over its data, and how consistent it is.

    Attributes
    ----------
    Q, R : ndarray, shapes (g, g) or (T, g, g), and (m, m) or (T, m, m)
        What the filter used.
    estimates, covariances : ndarray, shapes (T, n) and (T, n, n)
        Filtered states.
    innovations, sigma : ndarray, shape (T, m)
        Measured minus predicted, and its 1 sigma as the filter states it; NaN where nothing was measured.
    nis : ndarray, shape (T,)
        Normalised innovation squared of all channels together.
    counts : ndarray of int, shape (T,)
        Measurements at each time: what `nis` is on average in a consistent filter.
    log_likelihood : float
        Of the measurements.
    mean_nis : float
        Per measurement; 1 expected.
    nis_band : tuple of float
        95 % band of it.
    inside : ndarray, shape (m,)
        Share of innovations within 1.96 sigma; 0.95 expected.
    lags : int
        Number of autocorrelations.
    autocorrelation : ndarray, shape (m, lags)
        Of the whitened innovations of each channel; NaN where too few were measured.
    autocorrelation_band : ndarray, shape (m,)
        Half width of the 95 % band of each of them.
    whiteness : ndarray, shape (m,)
        p-values of the Ljung-Box test.
    """

    Q: np.ndarray
    R: np.ndarray
    estimates: np.ndarray
    covariances: np.ndarray
    innovations: np.ndarray
    sigma: np.ndarray
    nis: np.ndarray
    counts: np.ndarray
    log_likelihood: float
    mean_nis: float
    nis_band: tuple[float, float]
    inside: np.ndarray
    lags: int
    autocorrelation: np.ndarray
    autocorrelation_band: np.ndarray
    whiteness: np.ndarray

    @property
    def white(self) -> bool:
        """Whether no channel's p-value is below its share of 5 %."""
        known = self.whiteness[np.isfinite(self.whiteness)]
        return bool((known >= 0.05 / max(len(known), 1)).all())

    @property
    def sized(self) -> bool:
        """Whether the mean NIS is in its band: the filter knows how large its errors are."""
        return self.nis_band[0] <= self.mean_nis <= self.nis_band[1]

    def state_errors(self, truth: np.ndarray) -> tuple[np.ndarray, float]:
        """Root mean square error of each state against a truth, and NEES per known number.

        Parameters
        ----------
        truth : ndarray, shape (T, n)
            True states; NaN where unknown.

        Returns
        -------
        tuple of ndarray, shape (n,), and float
            NaN for a state without a truth; NEES is 1 on average in a consistent filter.
        """
        errors = self.estimates - truth
        known = np.isfinite(errors)
        count = known.sum(axis=0)
        squares = np.where(known, errors, 0.0) ** 2
        rmse = np.sqrt(
            np.divide(squares.sum(axis=0), count, out=np.full(len(count), np.nan), where=count > 0)
        )
        try:
            nees = float(normalised_squares(errors, self.covariances).sum() / count.sum())
        except InvalidInput:
            # a state that is known exactly has no inverse of its covariance
            nees = float("nan")
        return rmse, nees


def check_filter(model: LinearGaussianModel, Q: Any, R: Any, *, lags: int = LAGS) -> FilterCheck:
    """Run a Kalman filter over its data and judge it by its innovations, without any truth.

    Parameters
    ----------
    model : LinearGaussianModel
        Matrices, initial state and measurements.
    Q, R : array_like, shapes (g, g) or (T, g, g), and (m, m) or (T, m, m)
        Noise to be judged.
    lags : int
        Autocorrelations looked at; fewer in short data.

    Returns
    -------
    FilterCheck

    Raises
    ------
    InvalidInput
        If Q or R is no covariance or the filter diverges.
    """
    Q, R = np.array(Q, dtype=float), np.array(R, dtype=float)
    run = BatchKalman(model).run(*(a[None] if a.ndim == 3 else a for a in (Q, R)))
    if run.failed[0] is not None:
        raise InvalidInput("Q, R", run.failed[0], "give covariances with which the filter runs")
    innovations, covariances = run.innovations[0], run.innovation_covariances[0]
    counts = np.isfinite(innovations).sum(axis=1)
    white = whitened(innovations, covariances)
    sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    number = np.isfinite(innovations).sum(axis=0)
    lags = max(1, min(lags, int(number.max()) // PER_LAG))
    total = int(counts.sum())
    share = np.abs(innovations) <= norm.ppf(0.975) * sigma
    return FilterCheck(
        Q=Q,
        R=R,
        estimates=run.estimates[0],
        covariances=run.covariances[0],
        innovations=innovations,
        sigma=sigma,
        nis=run.nis[0],
        counts=counts,
        log_likelihood=float(run.log_likelihood[0]),
        mean_nis=float(run.nis[0].sum() / total),
        nis_band=chi_square_band(1.0, total),
        inside=share.sum(axis=0) / number,
        lags=lags,
        autocorrelation=np.array([_autocorrelation(channel, lags) for channel in white.T]),
        autocorrelation_band=norm.ppf(0.975) / np.sqrt(number),
        whiteness=np.array([_whiteness(channel, lags) for channel in white.T]),
    )


def _autocorrelation(series: np.ndarray, lags: int) -> np.ndarray:
    """As in the Ljung-Box test: NaN skipped in every product."""
    there = np.isfinite(series)
    if there.sum() <= lags:
        return np.full(lags, np.nan)
    centred = np.where(there, series - series[there].mean(), 0.0)
    return np.array([centred[j:] @ centred[:-j] for j in range(1, lags + 1)]) / (centred @ centred)


def _whiteness(series: np.ndarray, lags: int) -> float:
    return ljung_box(series, lags)[1] if np.isfinite(series).sum() > lags else float("nan")
