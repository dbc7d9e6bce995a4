"""What each ingredient of an ablation is worth: effect sizes on pairs of runs, world by world.

A pair is the run of the base's value and that of another one on the same world with the same seed. The
effect size is A12, the share of pairs in which the base's value has the lower score, ties half. Runs
on one world are not independent, so intervals draw whole worlds and tests count them.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy.stats
from numpy.typing import ArrayLike

from comparisons.ablation_design import BASE, Design
from comparisons.measures import (
    BOOTSTRAP_RESAMPLES,
    BOOTSTRAP_SEED,
    FEWEST_WORLDS,
    holm,
    quantile,
    wilcoxon_p,
    wilson_interval,
)
from comparisons.statistics import run_scores
from navopt.errors import InvalidInput

__all__ = ["POOLED", "SIZES", "effect_size", "effect_table", "vargha_delaney"]

#: What stands for the scenario where all are taken together.
POOLED = "all scenarios"
#: Least distance of A12 from 1/2 for each word (Vargha and Delaney 2000).
SIZES = ((0.21, "large"), (0.14, "medium"), (0.06, "small"))


def vargha_delaney(first: ArrayLike, second: ArrayLike, *, paired: bool = False) -> float:
    """Probability that a score of the first sample is lower than one of the second, ties half: A12.

    Parameters
    ----------
    first, second : array_like, shape (n,) and (m,)
        Scores, lower is better; ``+inf`` for failures, which tie with one another.
    paired : bool, keyword-only
        Whether to compare score k of one with score k of the other only, instead of each with each.

    Returns
    -------
    float
        1 if the first is always lower, 0 if never, ½ if they do not differ; NaN without scores.

    Raises
    ------
    InvalidInput
        If a score is NaN, or paired samples differ in length.

    References
    ----------
    A. Vargha and H. D. Delaney, J. Educ. Behav. Stat. 25 (2000) 101.
    """
    a, b = np.asarray(first, dtype=float).ravel(), np.asarray(second, dtype=float).ravel()
    if np.isnan(a).any() or np.isnan(b).any():
        raise InvalidInput("scores", float("nan"), "give +inf for a failed run")
    if paired:
        if a.size != b.size:
            raise InvalidInput("second", b.size, f"give one score per score of first, {a.size}")
        return float(_wins(a, b).mean()) if a.size else float("nan")
    if not a.size or not b.size:
        return float("nan")
    ordered = np.sort(b)
    # those of the second above each of the first, and those equal to it
    above = b.size - np.searchsorted(ordered, a, side="right")
    equal = b.size - np.searchsorted(ordered, a, side="left") - above
    return float((above + 0.5 * equal).sum() / (a.size * b.size))


def effect_size(a12: float) -> str:
    """Word for an effect size: large, medium, small, or negligible; empty for NaN."""
    if np.isnan(a12):
        return ""
    # a tolerance, because 0.71 - 0.5 is not 0.21 in floating point
    away = abs(a12 - 0.5) + 1e-12
    return next((word for least, word in SIZES if away >= least), "negligible")


def effect_table(store_or_runs: Any, study: Any = None, *, score: str | None = None) -> pd.DataFrame:
    """Effect of each ingredient of an ablation in each scenario, and in all together.

    Parameters
    ----------
    store_or_runs : ResultsStore or pandas.DataFrame
        Results of an ablation, or their runs.
    study : Study, optional
        The ablation's study; the store's own if not given.
    score : str, optional
        Score to compare, or ``"loss"``; that which ranks if not given.

    Returns
    -------
    pandas.DataFrame
        One row per scenario, ingredient and other value, those of `POOLED` first if there are several
        scenarios:

        - ``kind`` (``"ingredient"`` or ``"contrast"``), ``scenario, ingredient, base, other, label``: what
          is compared; for a contrast ``scenario`` and ``other`` are its two scenarios;
        - ``pairs, expected``: pairs of runs that are there and those planned; ``units`` independent ones,
          ``unit`` what they are: ``"world"``, or ``"seed"`` where all worlds of a scenario give the same
          runs because nothing in it is drawn, which then count once;
        - ``a12, a12_low, a12_high``: share of pairs in which the base's value is better, ties half, with
          its 95 % bootstrap interval over whole units (BCa, fixed seed; where all units agree, the Wilson
          interval at their number; NaN for fewer than six units); ``a12_unpaired``: each with each;
          ``size``: its word, see `effect_size`;
        - ``base_median, other_median``: of the scores in these pairs; ``difference`` (median of other minus
          base over pairs) and ``ratio`` (median of other over base, NaN for negative scores);
        - ``p_value, p_holm``: two-sided Wilcoxon signed-rank test over units on the median difference in
          each, in all scenarios together on the share of pairs won in each; adjusted for the ingredients
          compared in the scenario.

        In a factorial design the pairs are all those of variants that differ in nothing else, so that the
        effects are main effects, averaged over the other switches.

    Raises
    ------
    InvalidInput
        If the study is no ablation, or runs are given without it.
    UnknownName
        If there is no such score.
    """
    runs = store_or_runs if isinstance(store_or_runs, pd.DataFrame) else store_or_runs.runs()
    study = getattr(store_or_runs, "study", None) if study is None else study
    if study is None:
        raise InvalidInput("study", study, "give the Study the runs belong to")
    if not study.ablation:
        raise InvalidInput("study", study.name, "give the results of an ablation")
    design = Design.from_table(study.ablation)
    wide, repeated = _wide(runs, score or study.rank_by)
    options = _base_options(runs)
    whole = {
        label: len(study.seeds) * (1 if label in repeated else len(study.worlds)) for label in study.scenarios
    }
    contrasted = {other for _, other in design.contrasts.values()}
    together = [label for label in study.scenarios if label not in contrasted]
    places = [(label, [label]) for label in study.scenarios]
    if len(together) > 1:
        places.insert(0, (POOLED, together))
    rows = []
    for place, scenarios in places:
        for level in design.levels():
            pairs = _Pairs.of(wide, [(s, s, b, o) for s in scenarios for b, o in design.pairs(level)])
            named = {
                "kind": "ingredient",
                "scenario": place,
                "ingredient": level.ingredient,
                "base": design.base_text(level.ingredient, options),
                "other": level.text,
                "label": level.label,
                "expected": len(design.pairs(level)) * sum(whole[s] for s in scenarios),
            }
            rows.append(named | pairs.described(pooled=len(scenarios) > 1))
    for name, (base, other) in design.contrasts.items():
        pairs = _Pairs.of(wide, [(base, other, BASE, BASE)])
        named = {"kind": "contrast", "scenario": base, "ingredient": name, "base": base, "other": other}
        named |= {"label": name, "expected": min(whole[base], whole[other])}
        rows.append(named | pairs.described(pooled=False))
    table = pd.DataFrame(rows)
    table["unit"] = ["seed" if place in repeated else "world" for place in table["scenario"]]
    families = table["scenario"].where(table["kind"] == "ingredient", "contrast of scenarios")
    table["p_holm"] = table.groupby(families, sort=False)["p_value"].transform(lambda p: holm(p.to_numpy()))
    return table[list(COLUMNS)]


COLUMNS = (
    *("kind", "scenario", "ingredient", "base", "other", "label", "pairs", "expected", "units", "unit"),
    *("a12", "a12_low", "a12_high", "a12_unpaired", "size"),
    *("base_median", "other_median", "difference", "ratio", "p_value", "p_holm"),
)


def _wins(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """1 where `a` is lower, ½ where they tie, else 0."""
    return np.where(a < b, 1.0, np.where(a == b, 0.5, 0.0))


def _wide(runs: pd.DataFrame, key: str) -> tuple[pd.DataFrame, set[str]]:
    """Scores by (scenario, unit, seed) and solver, and the scenarios whose worlds are all the same."""
    index = ["scenario", "unit", "seed"]
    if not len(runs):
        return pd.DataFrame(index=pd.MultiIndex.from_arrays([[], [], []], names=index)), set()
    frame = runs.assign(_score=run_scores(runs, key), unit=[f"world {w}" for w in runs["world"]])
    repeated = {label for label, own in frame.groupby("scenario", sort=False) if _one_world(own)}
    again = frame["scenario"].isin(repeated)
    # every repetition of a run counts once, and what is independent then is the seed
    frame.loc[again, "unit"] = [f"seed {seed}" for seed in frame.loc[again, "seed"]]
    frame = frame.drop_duplicates([*index, "solver"])
    return frame.pivot(index=index, columns="solver", values="_score"), repeated


def _one_world(runs: pd.DataFrame) -> bool:
    """Whether every solver and seed has given the same answer, bit for bit, in several worlds."""
    if "x" not in runs or runs["world"].nunique() < 2:
        return False
    both = zip(runs["x"], runs["_score"], strict=True)
    answers = [np.asarray(x).tobytes() + np.float64(score).tobytes() for x, score in both]
    return bool((runs.assign(_answer=answers).groupby(["solver", "seed"])["_answer"].nunique() == 1).all())


def _base_options(runs: pd.DataFrame) -> dict[str, Any]:
    """Full settings of the base as its runs have recorded them; a failed one may know fewer."""
    if not len(runs) or "settings" not in runs:
        return {}
    own = runs.loc[runs["solver"] == BASE, "settings"]
    return max((settings.get("options") or {} for settings in own), key=len, default={})


@dataclass(frozen=True)
class _Pairs:
    """Scores with the base's value and with another, and the independent unit of each pair."""

    base: np.ndarray
    other: np.ndarray
    unit: np.ndarray

    @classmethod
    def of(cls, wide: pd.DataFrame, compared: list[tuple[str, str, str, str]]) -> _Pairs:
        """Pairs of ``(scenario, scenario, solver, solver)`` that have both been run."""
        found = []
        known = set(wide.index.get_level_values("scenario"))
        for first, second, base, other in compared:
            if not {first, second} <= known or not {base, other} <= set(wide.columns):
                continue
            both = pd.concat([wide.loc[first][base], wide.loc[second][other]], axis=1, join="inner")
            both.columns = pd.Index(["base", "other"])
            found.append(both.dropna().reset_index())
        if not found:
            return cls(np.zeros(0), np.zeros(0), np.zeros(0, dtype=str))
        pairs = pd.concat(found, ignore_index=True)
        return cls(pairs["base"].to_numpy(), pairs["other"].to_numpy(), pairs["unit"].to_numpy(dtype=str))

    def described(self, *, pooled: bool) -> dict[str, Any]:
        """Columns of the effect; scores of several scenarios are only compared in order and ratio."""
        units, place = np.unique(self.unit, return_inverse=True)
        wins = _wins(self.base, self.other)
        won, counts = np.bincount(place, wins, units.size), np.bincount(place, minlength=units.size)
        a12 = float(wins.mean()) if wins.size else float("nan")
        low, high = _interval(won, counts)
        with np.errstate(invalid="ignore", divide="ignore"):
            difference = np.where(self.base == self.other, 0.0, self.other - self.base)
            ratio = np.where(self.base == self.other, 1.0, self.other / self.base)
        if (self.base < 0).any() or (self.other < 0).any():
            ratio = ratio[:0]
        middles = np.array([quantile(difference[place == k], 0.5) for k in range(units.size)])
        tested, null = (
            (won / counts, 0.5) if pooled else (np.nan_to_num(middles, posinf=np.inf, neginf=-np.inf), 0.0)
        )
        return {
            "pairs": wins.size,
            "units": units.size,
            "a12": a12,
            "a12_low": low,
            "a12_high": high,
            "a12_unpaired": vargha_delaney(self.base, self.other) if not pooled else float("nan"),
            "size": effect_size(a12),
            "base_median": float("nan") if pooled else float(quantile(self.base, 0.5)),
            "other_median": float("nan") if pooled else float(quantile(self.other, 0.5)),
            "difference": float("nan") if pooled else float(quantile(difference, 0.5)),
            "ratio": float(quantile(ratio, 0.5)),
            "p_value": wilcoxon_p(tested, np.full(units.size, null)),
        }


def _interval(won: np.ndarray, counts: np.ndarray) -> tuple[float, float]:
    """95 % interval of the share of pairs won, from the pairs won and made in each unit."""
    n = won.size
    if n < FEWEST_WORLDS:
        return float("nan"), float("nan")
    shares = won / counts
    if np.all(shares == shares[0]):
        # resamples would all be alike and the interval without width, however few the units
        return (0.5, 0.5) if shares[0] == 0.5 else wilson_interval(n * float(shares[0]), n)

    def share(drawn: np.ndarray, axis: int = -1) -> np.ndarray:
        return won[drawn].sum(axis=axis) / counts[drawn].sum(axis=axis)

    for method in ("BCa", "percentile"):  # BCa is undefined where resamples hardly vary
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ends = scipy.stats.bootstrap(
                (np.arange(n),),
                share,
                n_resamples=BOOTSTRAP_RESAMPLES,
                method=method,
                random_state=np.random.default_rng(BOOTSTRAP_SEED),
            ).confidence_interval
        if np.isfinite([ends.low, ends.high]).all():
            break
    return float(ends.low), float(ends.high)
