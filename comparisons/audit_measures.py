"""What an audit concludes from its gaps: log ratios with intervals, and the rule that makes a verdict."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy.stats
from numpy.typing import ArrayLike

from comparisons.audit_suite import BIASES, Bias, Case
from comparisons.measures import BOOTSTRAP_RESAMPLES, BOOTSTRAP_SEED, FEWEST_WORLDS
from navopt.errors import InvalidInput

__all__ = ["DECADES", "FLOOR", "Verdict", "bias_table", "judge", "log_ratio", "median_interval"]

#: Gaps below this are taken for solved: what is beyond differs by rounding only.
FLOOR = 1e-8
#: Stands for the gap of a failed run, so that its ratio to a finished one is large and finite.
CEILING = 1e300
#: A function counts as biased when the whole interval is beyond this many powers of ten.
DECADES = 1.0
#: Share of the functions from which a solver is called biased.
SHARE = 0.5


def log_ratio(gap: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Base-10 logarithm of the ratio of two gaps, each at least `FLOOR`; failures are ``+inf``."""
    above, below = (np.clip(np.asarray(g, dtype=float), FLOOR, CEILING) for g in (gap, reference))
    return np.asarray(np.log10(above) - np.log10(below))


def median_interval(values: ArrayLike) -> tuple[float, float, float]:
    """Median and its 95 % bootstrap interval.

    Bias-corrected and accelerated (Efron 1987, J. Am. Stat. Assoc. 82:171), with a fixed seed: the same
    values give the same interval. Where this is undefined because resamples hardly vary, the percentile
    interval; for equal values, the value.

    Parameters
    ----------
    values : array_like, shape (n,)
        Finite numbers.

    Returns
    -------
    median, low, high : float
        The ends are NaN for fewer than six values.
    """
    sample = np.asarray(values, dtype=float)
    if not np.isfinite(sample).all():
        raise InvalidInput("values", sample.tolist(), "give finite numbers")
    if not sample.size:
        return np.nan, np.nan, np.nan
    median = float(np.median(sample))
    if sample.size < FEWEST_WORLDS:
        return median, np.nan, np.nan
    if np.ptp(sample) == 0.0:
        return median, median, median
    low = high = np.nan
    for method in ("BCa", "percentile"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            interval = scipy.stats.bootstrap(
                (sample,),
                np.median,
                n_resamples=BOOTSTRAP_RESAMPLES,
                method=method,
                random_state=np.random.default_rng(BOOTSTRAP_SEED),
            ).confidence_interval
        low, high = float(interval.low), float(interval.high)
        if np.isfinite([low, high]).all():
            break
    return median, low, high


def bias_table(
    gaps: pd.DataFrame, functions: Sequence[Case], biases: Sequence[str] = tuple(BIASES)
) -> pd.DataFrame:
    """Median paired log ratio of every solver, bias and function.

    Parameters
    ----------
    gaps : pandas.DataFrame
        Columns solver, function, dimension, family, seed, gap; ``+inf`` where a run failed.
    functions : sequence of Case
        The functions.
    biases : sequence of str
        Keys of `comparisons.audit_suite.BIASES`.

    Returns
    -------
    pandas.DataFrame
        Columns solver, bias, function, dimension, ``level`` (the dimension with which it is counted: the
        lowest for functions that have only one), pairs (seeds with both runs), median, low, high (95 %) in
        powers of ten, and ``side``: 1 where the interval is above `DECADES`, -1 where it is below its
        negative and the bias has that side, else 0.
    """
    known = gaps.set_index(["solver", "function", "dimension", "family", "seed"])["gap"].sort_index()
    free = [case.dimension for case in functions if not case.fixed]
    lowest = min(free, default=0)
    rows = []
    for solver in gaps["solver"].unique():
        for name in biases:
            bias = BIASES[name]
            for case in functions:
                pair = [
                    _gaps(known, (solver, case.function, case.dimension, case.family(family)))
                    for family in (bias.favoured, bias.other)
                ]
                both = pd.concat(pair, axis=1, join="inner")
                ratios = log_ratio(both.iloc[:, 1], both.iloc[:, 0])
                median, low, high = median_interval(ratios)
                side = int(low > DECADES) - int(len(bias.sides) > 1 and high < -DECADES)
                level = lowest if case.fixed else case.dimension
                place = (solver, name, case.function, case.dimension, level)
                rows.append((*place, len(both), median, low, high, side))
    columns = ["solver", "bias", "function", "dimension", "level", "pairs", "median", "low", "high", "side"]
    return pd.DataFrame(rows, columns=columns)


def _gaps(known: pd.Series, place: tuple[str, str, int, str]) -> pd.Series:
    try:
        return known.loc[place]
    except KeyError:  # not run yet
        return pd.Series(dtype=float)


@dataclass(frozen=True)
class Verdict:
    """What an audit says about one solver and one bias.

    Attributes
    ----------
    solver : str
        Label.
    bias : Bias
        What was judged.
    biased : bool or None
        Whether at least half of the functions favour the same side in some number of variables; None where
        nothing could be judged, or too little to say no.
    sides : tuple of str
        What is favoured; empty unless biased.
    counts : mapping of str to tuple of int
        Functions that favour each side, by level.
    functions : tuple of int
        Functions judged, by level.
    levels : tuple of str
        Numbers of variables in words.
    median : float
        Median over the functions that favour the first of `sides`, or over all if there is none, of the
        median log ratio.
    """

    solver: str
    bias: Bias
    biased: bool | None
    sides: tuple[str, ...]
    counts: Mapping[str, tuple[int, ...]]
    functions: tuple[int, ...]
    levels: tuple[str, ...]
    median: float

    @property
    def side(self) -> str:
        """What is favoured, in words; empty unless biased."""
        return " and ".join(self.sides)


def judge(table: pd.DataFrame) -> list[Verdict]:
    """Verdicts by the rule, in the order of `bias_table`.

    Functions are counted for each number of variables by themselves: where a solver comes nowhere near
    the minimum, for want of budget, no bias can show. Functions of a fixed number of variables count with
    the lowest.

    Parameters
    ----------
    table : pandas.DataFrame
        From `bias_table`.
    """
    return [
        _verdict(str(solver), BIASES[str(name)], rows)
        for (solver, name), rows in table.groupby(["solver", "bias"], sort=False)
    ]


def _verdict(solver: str, bias: Bias, rows: pd.DataFrame) -> Verdict:
    parts = [part for _, part in rows.groupby("level", sort=True)]
    judged = [part[part["low"].notna()] for part in parts]
    signs = dict(zip(bias.sides, (1, -1), strict=False))
    counts = {
        side: tuple(int((part["side"] == sign).sum()) for part in judged) for side, sign in signs.items()
    }
    functions = tuple(map(len, judged))
    sides = tuple(
        side
        for side, found in counts.items()
        if any(total and n >= SHARE * total for n, total in zip(found, functions, strict=True))
    )
    enough = all(total >= SHARE * len(part) for total, part in zip(functions, parts, strict=True))
    known = pd.concat(judged)
    shown = known[known["side"] == signs[sides[0]]] if sides else known
    return Verdict(
        solver,
        bias,
        True if sides and sum(functions) else False if enough else None,
        sides,
        counts,
        functions,
        tuple(_level(part["dimension"]) for part in parts),
        float(shown["median"].median()),
    )


def _level(dimensions: pd.Series) -> str:
    low, high = int(dimensions.min()), int(dimensions.max())
    return f"d = {low}" if low == high else f"d = {low} to {high}"
