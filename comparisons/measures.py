"""Statistics of one sample or one pair of samples, where ``+inf`` stands for a failed run."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import scipy.stats
from numpy.typing import ArrayLike

from navopt.errors import InvalidInput

__all__ = ["holm", "over_bound", "quantile", "summarize", "wilcoxon_p", "wilson_interval"]

#: Seed and number of the bootstrap's resamples: the same data give the same interval.
BOOTSTRAP_SEED = 20190613
BOOTSTRAP_RESAMPLES = 2000
#: With fewer, even the whole range covers the median with less than 95 %: 1 − 2^(1 − n).
FEWEST_WORLDS = 6


def wilson_interval(successes: float, n: float, *, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson score interval of a probability.

    Unlike the normal interval it stays inside [0, 1] and is usable for few runs and for 0 or 100 %.

    Parameters
    ----------
    successes : float
        How often it happened. A fraction is allowed, for means over dependent runs.
    n : float
        How many independent trials there were.
    confidence : float, default 0.95
        Probability that the interval covers the truth.

    Returns
    -------
    low, high : float
        The interval; (0, 1) when there was no trial.

    Raises
    ------
    InvalidInput
        If ``0 <= successes <= n`` or ``0 < confidence < 1`` does not hold.

    References
    ----------
    E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if not 0 < confidence < 1:
        raise InvalidInput("confidence", confidence, "give a probability between 0 and 1, for instance 0.95")
    if not 0 <= successes <= n:
        raise InvalidInput("successes", successes, f"give a number between 0 and n = {n}")
    if n == 0:
        return 0.0, 1.0
    z = float(scipy.stats.norm.ppf(0.5 + confidence / 2))
    share, shrink = successes / n, 1 + z**2 / n
    centre = (share + z**2 / (2 * n)) / shrink
    half = z * np.sqrt(share * (1 - share) / n + z**2 / (4 * n**2)) / shrink
    # rounding must not move the two exact ends
    low = 0.0 if successes == 0 else max(0.0, float(centre - half))
    high = 1.0 if successes == n else min(1.0, float(centre + half))
    return low, high


def quantile(values: ArrayLike, q: float) -> Any:
    """Quantile by linear interpolation that stands infinite values, where numpy's gives NaN.

    Between a finite and an infinite value the quantile is infinite: a failure is never averaged away.

    Parameters
    ----------
    values : array_like, shape (n, ...)
        Values without NaN; the quantile is taken over the first axis.
    q : float
        Share of the values below, 0 to 1.

    Returns
    -------
    float or ndarray, shape (...)
        The quantile; NaN of no values.
    """
    ordered = np.sort(np.asarray(values, dtype=float), axis=0)
    if len(ordered) == 0:
        return np.full(ordered.shape[1:], np.nan)[()]
    position = q * (len(ordered) - 1)
    below, weight = int(position), position - int(position)
    lower, upper = ordered[below], ordered[min(below + 1, len(ordered) - 1)]
    with np.errstate(invalid="ignore"):
        between = lower + weight * (upper - lower) if weight else lower
    return np.where(lower == upper, lower, between)[()]


def summarize(values: ArrayLike, *, worlds: ArrayLike | None = None) -> dict[str, float]:
    """Describe a sample of errors, where ``+inf`` stands for a failed run.

    Parameters
    ----------
    values : array_like, shape (n,)
        Errors; NaN is taken for a failure and counted as ``+inf``.
    worlds : array_like, shape (n,), optional
        What each value was measured on: values on one world are not independent, so the bootstrap draws
        whole worlds. By default each value is a world.

    Returns
    -------
    dict of str to float
        ``n``, ``failures``, ``median``, ``q25``, ``q75``, ``iqr``, ``minimum`` and ``maximum`` over all
        values, failures as worst; ``median_low`` and ``median_high``, the 95 % bootstrap interval of the
        median (BCa, `BOOTSTRAP_RESAMPLES` resamples, fixed seed), NaN for fewer than `FEWEST_WORLDS`
        worlds; ``mean`` and ``sd`` (n − 1) over the finite values only, since one failure would make both
        infinite.

    Raises
    ------
    InvalidInput
        If `worlds` is not as long as `values`.
    """
    sample = np.asarray(values, dtype=float).ravel()
    sample = np.where(np.isfinite(sample), sample, np.inf)
    labels = np.arange(sample.size) if worlds is None else np.asarray(worlds).ravel()
    if labels.size != sample.size:
        raise InvalidInput("worlds", labels.size, f"give one for each of the {sample.size} values")
    finite = sample[np.isfinite(sample)]
    q25, median, q75 = (float(quantile(sample, q)) for q in (0.25, 0.5, 0.75))
    low, high = _median_interval(sample, labels)
    return {
        "n": sample.size,
        "failures": sample.size - finite.size,
        "median": median,
        "median_low": low,
        "median_high": high,
        "q25": q25,
        "q75": q75,
        "iqr": q75 - q25 if np.isfinite(q25) else float("nan"),
        "mean": float(finite.mean()) if finite.size else float("nan"),
        "sd": float(finite.std(ddof=1)) if finite.size > 1 else float("nan"),
        "minimum": float(sample.min()) if sample.size else float("nan"),
        "maximum": float(sample.max()) if sample.size else float("nan"),
    }


def _median_interval(sample: np.ndarray, worlds: np.ndarray) -> tuple[float, float]:
    """95 % BCa interval of the median, whole worlds drawn; failures are beyond everything else."""
    finite = sample[np.isfinite(sample)]
    known = np.unique(worlds)
    if known.size < FEWEST_WORLDS or finite.size == 0:
        return float("nan"), float("nan")
    if np.all(sample == sample[0]):
        return float(sample[0]), float(sample[0])
    # the bootstrap cannot stand infinities; a median only needs failures to be beyond everything else
    beyond = finite.max() + 1 + np.ptp(finite)
    stand_in = np.where(np.isfinite(sample), sample, beyond)
    groups = [stand_in[worlds == world] for world in known]
    padded = np.full((known.size, max(map(len, groups))), np.nan)
    for row, group in zip(padded, groups, strict=True):
        row[: group.size] = group

    def median(drawn: np.ndarray, axis: int = -1) -> np.ndarray:
        drawn = np.moveaxis(drawn, axis, -1)
        return np.nanmedian(padded[drawn].reshape(*drawn.shape[:-1], -1), axis=-1)

    ends = np.full(2, np.nan)
    for method in ("BCa", "percentile"):  # BCa is undefined where resamples hardly vary
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            interval = scipy.stats.bootstrap(
                (np.arange(known.size),),
                median,
                n_resamples=BOOTSTRAP_RESAMPLES,
                method=method,
                random_state=np.random.default_rng(BOOTSTRAP_SEED),
            ).confidence_interval
        ends = np.array([interval.low, interval.high], dtype=float)
        if np.isfinite(ends).all():
            break
    ends = np.where(ends > finite.max(), np.inf, ends)
    return float(ends[0]), float(ends[1])


def over_bound(errors: ArrayLike, bounds: ArrayLike) -> tuple[float, float, int]:
    """How far errors are above what is possible: root mean square error over root mean square bound.

    Parameters
    ----------
    errors, bounds : array_like, shape (n,)
        Error of each run and the bound on it, one standard deviation; whatever is not finite, such as a
        failure or an unknown bound, is left out as a pair.

    Returns
    -------
    ratio : float
        NaN where no pair is left.
    bound : float
        Root mean square of the bounds of these pairs.
    pairs : int
        Their number.
    """
    error, bound = np.asarray(errors, dtype=float), np.asarray(bounds, dtype=float)
    both = np.isfinite(error) & np.isfinite(bound)
    if not both.any():
        return float("nan"), float("nan"), 0
    least = float(np.sqrt(np.mean(bound[both] ** 2)))
    ratio = float(np.sqrt(np.mean(error[both] ** 2))) / least if least else float("nan")
    return ratio, least, int(both.sum())


def holm(p_values: ArrayLike) -> np.ndarray:
    """Adjust p-values for the number of comparisons by Holm's step-down rule.

    Parameters
    ----------
    p_values : array_like, shape (m,)
        Raw p-values; NaN (no test was possible) stays NaN and does not count.

    Returns
    -------
    ndarray, shape (m,)
        Adjusted p-values: rejecting those below α keeps the probability of any false rejection below α.

    References
    ----------
    S. Holm, Scand. J. Statist. 6 (1979) 65.
    """
    raw = np.asarray(p_values, dtype=float)
    adjusted = np.full(raw.shape, np.nan)
    tested = np.flatnonzero(~np.isnan(raw))
    order = tested[np.argsort(raw[tested], kind="stable")]
    factors = np.arange(order.size, 0, -1)
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(factors * raw[order]))
    return adjusted


def wilcoxon_p(first: ArrayLike, second: ArrayLike) -> float:
    """Two-sided p-value of the Wilcoxon signed-rank test of paired errors, zeros split.

    Parameters
    ----------
    first, second : array_like, shape (n,)
        Errors of two solvers on the same worlds; ``+inf`` for a failure. Two failures are a tie, a
        failure against a result is the largest difference of all.

    Returns
    -------
    float
        The p-value; 1 when all pairs are tied, NaN without pairs.
    """
    a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if a.shape != b.shape:
        raise InvalidInput("second", b.shape, f"give one value per value of first, {a.shape}")
    if a.size == 0:
        return float("nan")
    with np.errstate(invalid="ignore"):
        difference = np.where(a == b, 0.0, a - b)
    finite = np.abs(difference[np.isfinite(difference)])
    largest = 2 * finite.max() + 1 if finite.size else 1.0
    difference = np.clip(difference, -largest, largest)
    if not difference.any():
        return 1.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of few worlds; the exact distribution is used where it exists
        return float(scipy.stats.wilcoxon(difference, zero_method="zsplit", alternative="two-sided").pvalue)
