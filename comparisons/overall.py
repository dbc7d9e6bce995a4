"""Ranks over all scenarios of a study: Friedman's test and Nemenyi's critical difference.

A scenario counts once, whatever its number of worlds: solvers are ranked in each by the median of the
ranking score, and what is tested is whether the same solvers come first in different scenarios.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import scipy.stats

from comparisons.statistics import ranked_table
from comparisons.wording import format_number
from navopt.errors import InvalidInput

if TYPE_CHECKING:
    from rich.console import Console

__all__ = [
    "ALL",
    "NOTE",
    "OverallRanks",
    "critical_difference",
    "overall_cells",
    "overall_frame",
    "overall_ranks",
    "overall_words",
    "print_overall",
]

#: Name of the group that holds every scenario.
ALL = "all scenarios"
#: With fewer of either, ranks have nothing to say.
FEWEST_SCENARIOS = FEWEST_SOLVERS = 3
#: The ranks in more scenarios than this are in the CSV file only.
MOST_COLUMNS = 24
NOTE = (
    "Each scenario ranks the solvers by their medians, equal ones sharing the mean of their ranks, and "
    "counts once. Friedman's test (with Iman and Davenport's correction) asks whether the ranks could be "
    "chance; two solvers whose mean ranks differ by less than the critical difference of Nemenyi's test are "
    "not told apart by these scenarios, which are few: the tests inside a scenario see smaller differences."
)


@dataclass(frozen=True)
class OverallRanks:
    """Ranks of the solvers over a group of scenarios.

    Attributes
    ----------
    group : str
        Name of the group.
    ranks : pandas.DataFrame
        Rank of each solver (rows, best first) in each scenario (columns); equal medians share their ranks.
    mean : pandas.Series
        Mean rank of each solver, in the same order.
    chi2, p_friedman : float
        Friedman's statistic, corrected for ties, and its p-value.
    p_iman : float
        p-value of the F-distributed form by Iman and Davenport, which is less conservative.
    critical_difference : float
        Smallest significant difference of two mean ranks by Nemenyi's test.
    p_nemenyi : pandas.DataFrame
        p-values of that test for every pair of solvers.
    significance : float
        Level of the critical difference.
    left_out : tuple of str
        Solvers without runs in some scenario.
    """

    group: str
    ranks: pd.DataFrame
    mean: pd.Series
    chi2: float
    p_friedman: float
    p_iman: float
    critical_difference: float
    p_nemenyi: pd.DataFrame
    significance: float
    left_out: tuple[str, ...]

    @property
    def not_told_apart(self) -> list[str]:
        """Solvers within the critical difference of the best, which is not among them."""
        near = self.mean - self.mean.iloc[0] < self.critical_difference
        return [str(label) for label in self.mean.index[near]][1:]


def critical_difference(solvers: int, scenarios: int, *, significance: float = 0.05) -> float:
    """Difference of two mean ranks from which Nemenyi's test finds it significant.

    Parameters
    ----------
    solvers, scenarios : int
        Numbers of solvers compared, k, and of scenarios, n.
    significance : float, default 0.05
        Level of the test, for all pairs together.

    Returns
    -------
    float
        ``q sqrt(k (k + 1) / (6 n))`` with q the quantile of the studentised range over √2 (Demšar 2006,
        J. Mach. Learn. Res. 7:1).
    """
    quantile = scipy.stats.studentized_range.ppf(1 - significance, solvers, np.inf) / np.sqrt(2)
    return float(quantile * np.sqrt(solvers * (solvers + 1) / (6 * scenarios)))


def overall_ranks(
    store_or_runs: Any, study: Any = None, *, table: pd.DataFrame | None = None, significance: float = 0.05
) -> list[OverallRanks]:
    """Rank the solvers over each group of scenarios of a study.

    Parameters
    ----------
    store_or_runs : ResultsStore or pandas.DataFrame
        The store, or what its ``runs()`` returned.
    study : Study, optional
        What was compared; the store's own if not given.
    table : pandas.DataFrame, optional
        The ranked table, if at hand.
    significance : float, default 0.05
        Level of the critical difference.

    Returns
    -------
    list of OverallRanks
        One per group of the study, or one over all scenarios; groups of fewer than three scenarios, or
        with fewer than three solvers that ran in all of them, have none.

    Raises
    ------
    InvalidInput
        If runs are given without their study.
    """
    study = study if study is not None else getattr(store_or_runs, "study", None)
    if study is None:
        raise InvalidInput("study", study, "give the Study the runs belong to")
    table = ranked_table(store_or_runs, study) if table is None else table
    groups = study.groups or {ALL: tuple(study.scenarios)}
    found = [_over(name, table, study, list(labels), significance) for name, labels in groups.items()]
    return [one for one in found if one is not None]


def _over(
    group: str, table: pd.DataFrame, study: Any, scenarios: list[str], significance: float
) -> OverallRanks | None:
    done = table[table["scenario"].isin(scenarios) & (table["runs"] > 0)]
    medians = done.pivot(index="solver", columns="scenario", values="median").reindex(columns=scenarios)
    everyone = [entry.label for entry in study.solvers]
    medians = medians.dropna().reindex([label for label in everyone if label in medians.dropna().index])
    k, n = len(medians), len(scenarios)
    if k < FEWEST_SOLVERS or n < FEWEST_SCENARIOS:
        return None
    ranks = medians.rank(axis=0, method="average")
    mean = ranks.mean(axis=1).sort_values(kind="stable")
    ranks = ranks.loc[mean.index]
    if (ranks.nunique(axis=0) == 1).all():  # nothing but ties
        chi2, p_friedman, p_iman = 0.0, 1.0, 1.0
    else:
        chi2, p_friedman = map(float, scipy.stats.friedmanchisquare(*ranks.to_numpy()))
        rest = n * (k - 1) - chi2
        f = (n - 1) * chi2 / rest if rest > 1e-12 * chi2 else np.inf
        p_iman = float(scipy.stats.f.sf(f, k - 1, (k - 1) * (n - 1)))
    differences = np.abs(mean.to_numpy()[:, None] - mean.to_numpy())
    q = differences / np.sqrt(k * (k + 1) / (6 * n)) * np.sqrt(2)
    p = scipy.stats.studentized_range.sf(q, k, np.inf)
    return OverallRanks(
        group=group,
        ranks=ranks,
        mean=mean,
        chi2=chi2,
        p_friedman=p_friedman,
        p_iman=p_iman,
        critical_difference=critical_difference(k, n, significance=significance),
        p_nemenyi=pd.DataFrame(p, index=mean.index, columns=mean.index),
        significance=significance,
        left_out=tuple(label for label in everyone if label not in mean.index),
    )


def overall_frame(overall: list[OverallRanks]) -> pd.DataFrame:
    """All ranks as one table: group, solver, mean_rank, p_best (Nemenyi's), and the rank in each scenario."""
    pieces = []
    for one in overall:
        head = pd.DataFrame({"group": one.group, "solver": one.mean.index, "mean_rank": one.mean.to_numpy()})
        head["p_best"] = one.p_nemenyi.iloc[0].to_numpy()
        pieces.append(pd.concat([head, one.ranks.reset_index(drop=True)], axis=1))
    return pd.concat(pieces, ignore_index=True)


def overall_cells(overall: OverallRanks) -> pd.DataFrame:
    """Ranks of a group as text: solver, marked if not told apart from the best, mean rank, and every rank."""
    near = set(overall.not_told_apart)
    cells = pd.DataFrame(
        {
            "solver": [f"{label} ≈" if label in near else str(label) for label in overall.mean.index],
            "mean rank": [f"{value:.1f}" for value in overall.mean],
        }
    )
    for label in overall.ranks.columns if overall.ranks.shape[1] <= MOST_COLUMNS else ():
        cells[str(label)] = [f"{value:g}" for value in overall.ranks[label]]
    return cells


def overall_words(overall: OverallRanks) -> str:
    """One paragraph on a group: who leads, whether the order is chance, and who is not told apart."""
    p = overall.p_iman
    scenarios = overall.ranks.shape[1]
    text = (
        f"{overall.group}: {overall.mean.index[0]} has the lowest mean rank over {scenarios} scenarios, "
        f"{overall.mean.iloc[0]:.1f} of {len(overall.mean)}. Friedman's χ² is {format_number(overall.chi2)}, "
        f"p {'< 0.001' if p < 0.001 else '= ' + format_number(p, digits=2)}"
    )
    if p >= overall.significance:
        text += ": the order may be chance."
    else:
        text += (
            f"; mean ranks differ significantly by {overall.critical_difference:.1f} or more (Nemenyi, "
            f"{100 * overall.significance:g} %)"
        )
        near = overall.not_told_apart
        text += (
            f". Not told apart from the first: {', '.join(near)}."
            if near
            else ", as the first does from all."
        )
    if overall.left_out:
        text += f" Without runs in some scenario, and left out: {', '.join(overall.left_out)}."
    return text


def print_overall(overall: list[OverallRanks], console: Console) -> None:
    """Print the ranks of every group.

    Parameters
    ----------
    overall : list of OverallRanks
        From `overall_ranks`.
    console : rich.console.Console
        Where to print.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    for one in overall:
        cells = overall_cells(one)
        title = Text(f"Ranks over {one.group}", style="bold")
        shown = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        for column in cells.columns:
            shown.add_column(
                column, justify="left" if column == "solver" else "right", no_wrap=column == "solver"
            )
        for values in cells.to_numpy():
            shown.add_row(*[Text(value) for value in values])
        console.print(shown)
        console.print(Text(overall_words(one)), style="dim")
