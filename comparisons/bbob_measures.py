"""What a BBOB benchmark measures: evaluations until a target, their distribution, expected running times."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from comparisons.bbob_functions import GROUPS
from navopt.errors import InvalidInput

__all__ = ["TARGETS", "ecdf", "expected_running_times", "first_hits", "share_interval", "share_table"]

#: Gaps to be reached, 10² to 10⁻⁸, five in each power of ten, as in the COCO platform.
TARGETS: np.ndarray = 10.0 ** (np.arange(10, -41, -1) / 5.0)
#: Resamples of an interval, and the seed of the resampling: the same results give the same interval.
RESAMPLES, RESAMPLING_SEED = 1000, 20090709


def first_hits(trace: np.ndarray, minimum: float, targets: ArrayLike) -> np.ndarray:
    """Cost at which a run first comes within each target of the minimum.

    Parameters
    ----------
    trace : structured ndarray
        Trace of a solution, with ``cost`` and ``loss``; may be empty.
    minimum : float
        Lowest loss there is.
    targets : array_like, shape (k,)
        Gaps.

    Returns
    -------
    ndarray, shape (k,)
        ``inf`` where the run did not come that near.
    """
    gap = trace["loss"] - minimum
    first = np.searchsorted(-gap, -np.asarray(targets, dtype=float), side="left")
    return np.append(trace["cost"].astype(float), np.inf)[first]


def ecdf(hits: ArrayLike, at: ArrayLike) -> np.ndarray:
    """Share of pairs of a run and a target that have been reached.

    Parameters
    ----------
    hits : array_like
        Cost of each pair, of any shape; ``inf`` if it was not reached.
    at : array_like, shape (m,)
        Costs, in the unit of `hits`.

    Returns
    -------
    ndarray, shape (m,)
        Share at or below each cost.

    Raises
    ------
    InvalidInput
        If there is no pair.
    """
    ordered = np.sort(np.ravel(np.asarray(hits, dtype=float)))
    if not ordered.size:
        raise InvalidInput("hits", "no pairs", "give at least one run and one target")
    return np.searchsorted(ordered, np.asarray(at, dtype=float), side="right") / ordered.size


def share_interval(shares: ArrayLike, *, confidence: float = 0.95) -> tuple[float, float]:
    """Bootstrap interval of a mean share: the instances of every function are drawn anew.

    Parameters
    ----------
    shares : array_like, shape (functions, instances)
        Share of the targets that each run has reached.
    confidence : float, default 0.95
        Probability of the percentile interval.

    Returns
    -------
    low, high : float
        NaN with fewer than two instances.

    Notes
    -----
    The functions are fixed: the interval says what other instances of the same functions would give.
    """
    table = np.asarray(shares, dtype=float)
    functions, instances = table.shape
    if instances < 2:
        return float("nan"), float("nan")
    rng = np.random.default_rng(RESAMPLING_SEED)
    drawn = rng.integers(0, instances, (RESAMPLES, functions, instances))
    means = table[np.arange(functions)[:, None], drawn].mean(axis=(1, 2))
    low, high = np.quantile(means, [0.5 - confidence / 2, 0.5 + confidence / 2])
    return float(low), float(high)


def share_table(runs: pd.DataFrame, hits: np.ndarray) -> pd.DataFrame:
    """Share of the targets that each solver has reached when its budget was spent.

    Parameters
    ----------
    runs : pandas.DataFrame
        Columns solver, function, dimension, instance.
    hits : ndarray, shape (runs, targets)
        From `first_hits`.

    Returns
    -------
    pandas.DataFrame
        Per dimension and solver, best first: ``dimension, solver, runs, all, low, high`` (95 % interval of
        ``all``, see `share_interval`) and the share in each group of `comparisons.bbob_functions.GROUPS`
        (NaN for one without runs).
    """
    reached = runs.assign(share=np.isfinite(hits).mean(axis=1))
    rows: list[dict[str, Any]] = []
    for (dimension, solver), own in reached.groupby(["dimension", "solver"], sort=False):
        square = own.pivot(index="function", columns="instance", values="share")
        complete = not square.isna().to_numpy().any()
        low, high = share_interval(square.to_numpy()) if complete else (np.nan, np.nan)
        groups = {
            name: own.loc[own["function"].isin(list(numbers)), "share"].mean()
            for name, numbers in GROUPS.items()
        }
        rows.append(
            {
                "dimension": dimension,
                "solver": solver,
                "runs": len(own),
                "all": own["share"].mean(),
                "low": low,
                "high": high,
                **groups,
            }
        )
    table = pd.DataFrame(rows)
    return table.sort_values(["dimension", "all"], ascending=[True, False], kind="stable", ignore_index=True)


def expected_running_times(
    runs: pd.DataFrame, hits: np.ndarray, targets: ArrayLike = TARGETS
) -> pd.DataFrame:
    """Expected running time until each target: cost of all runs until it or their end, per success.

    Parameters
    ----------
    runs : pandas.DataFrame
        Columns solver, function, dimension, and ``cost``, what each run spent.
    hits : ndarray, shape (runs, targets)
        From `first_hits`.
    targets : array_like, shape (targets,)
        Gaps, in the order of the columns of `hits`.

    Returns
    -------
    pandas.DataFrame
        ``solver, function, dimension, target, expected_cost`` (``inf`` without a success), ``successes,
        runs``.
    """
    spent = np.where(np.isfinite(hits), hits, runs["cost"].to_numpy(dtype=float)[:, None])
    rows: list[dict[str, Any]] = []
    for (solver, function, dimension), own in runs.reset_index(drop=True).groupby(
        ["solver", "function", "dimension"], sort=False
    ):
        successes = np.isfinite(hits[own.index]).sum(axis=0)
        total = spent[own.index].sum(axis=0)
        for k, target in enumerate(np.asarray(targets, dtype=float)):
            rows.append(
                {
                    "solver": solver,
                    "function": function,
                    "dimension": dimension,
                    "target": float(target),
                    "expected_cost": float(total[k] / successes[k]) if successes[k] else np.inf,
                    "successes": int(successes[k]),
                    "runs": len(own),
                }
            )
    return pd.DataFrame(rows)
