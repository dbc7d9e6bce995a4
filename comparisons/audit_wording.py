"""An audit in words: what each verdict means, what else its runs show, and the printed table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from comparisons.audit_measures import DECADES, FLOOR, SHARE, Verdict
from comparisons.audit_suite import Case
from comparisons.wording import format_number

if TYPE_CHECKING:
    from rich.table import Table

    from comparisons.audit import AuditResult

__all__ = ["cell", "decades", "findings", "headline", "notes", "paragraphs", "sentence", "verdict_table"]

#: Functions whose gaps a finding quotes, those of paper 000's Table 1 first.
QUOTED = ("ackley", "griewank", "sphere", "rastrigin")


def headline(verdicts: list[Verdict]) -> str:
    """Biases of one solver in half a sentence."""
    faults = [verdict for verdict in verdicts if verdict.bias.fault]
    sides = [side for verdict in faults for side in verdict.sides]
    if sides:
        return f"biased towards {_listed(sides)}"
    if any(verdict.biased is None for verdict in faults):
        return "not judged: too few of its runs have finished"
    return "no bias found"


def sentence(verdict: Verdict) -> str:
    """One verdict with what it counts.

    Parameters
    ----------
    verdict : Verdict
        From `comparisons.audit_measures.judge`.
    """
    name = "dependence on the axes" if not verdict.bias.fault else f"{verdict.bias.name} bias"
    if verdict.biased is None:
        return f"{name}: not judged, too few of its runs have finished."
    if not verdict.biased:
        some = [side for side, found in verdict.counts.items() if any(found)]
        if not some:
            sides = " or ".join(verdict.counts)
            return f"{name}: no. None of {sum(verdict.functions)} functions favours {sides}."
        favours = [f"{_counted(verdict, side)} favour {side}" for side in some]
        return f"{name}: no. {_capital('; '.join(favours))}; half would make it one."
    if not verdict.bias.fault:
        return (
            f"{name}: yes. The gap is more than ten times larger where the function is turned on "
            f"{_counted(verdict, verdict.sides[0])}; no bias to a place."
        )
    counted = " and ".join(f"towards {side} on {_counted(verdict, side)}" for side in verdict.sides)
    return (
        f"{name}: yes, {counted} (half makes it one). There the gap is more than ten times smaller than "
        f"{_elsewhere(verdict)}, typically {_factor(abs(verdict.median))}."
    )


def _counted(verdict: Verdict, side: str) -> str:
    """How many functions favour a side, where any do."""
    found = zip(verdict.counts[side], verdict.functions, verdict.levels, strict=True)
    return _listed([f"{n} of {total} functions with {level}" for n, total, level in found if n])


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _elsewhere(verdict: Verdict) -> str:
    if len(verdict.bias.sides) == 1:
        return "with the minimum shifted"
    if len(verdict.sides) > 1:
        return "in the mirror image"
    (other,) = (side for side in verdict.bias.sides if side not in verdict.sides)
    return f"with the minimum at its mirror image, {other}"


def _factor(decades: float) -> str:
    return (
        f"{format_number(10.0**decades, digits=2)} times" if decades < 4 else f"{decades:.1f} powers of ten"
    )


def findings(result: AuditResult, solver: str) -> list[str]:
    """What the runs of one solver show beyond the verdicts.

    Parameters
    ----------
    result : AuditResult
        The audit.
    solver : str
        Label of an audited solver.

    Returns
    -------
    list of str
        Sentences; perhaps none.
    """
    own = result.gaps[result.gaps["solver"] == solver]
    found = [_vanished(result, own, solver), _against_random(result, own), _zettl(own), _failures(own)]
    return [text for text in found if text]


def _vanished(result: AuditResult, own: pd.DataFrame, solver: str) -> str:
    """Gaps at the origin and after a shift, of the functions on which the difference is beyond a decade."""
    table = result.bias()
    marked = table[(table["solver"] == solver) & (table["bias"] == "origin") & (table["side"] == 1)]
    picked = [
        Case(row.function, row.dimension)
        for name in QUOTED
        for row in marked[marked["function"] == name].nlargest(1, "median").itertuples(index=False)
    ]
    if not picked:
        return ""
    parts = [
        f"{case.function} in {case.dimension} variables {_gap(own, case, 'origin')} at the origin, "
        f"{_gap(own, case, 'shifted')} shifted"
        for case in picked
    ]
    return f"The results vanish under a shift. Median gaps: {'; '.join(parts)}."


def _gap(own: pd.DataFrame, case: Case, family: str) -> str:
    return format_number(_median(own, case, family), digits=2)


def _median(own: pd.DataFrame, case: Case, family: str) -> float:
    here = (own["function"] == case.function) & (own["dimension"] == case.dimension)
    return float(own.loc[here & (own["family"] == case.family(family)), "gap"].median())


def _against_random(result: AuditResult, own: pd.DataFrame) -> str:
    gaps = result.gaps
    random = gaps[
        gaps["solver"].isin([e.label for e in result.audit.references if e.name == "random-search"])
    ]
    if random.empty or "shifted" not in result.audit.families:
        return ""
    pairs = [(_median(own, case, "shifted"), _median(random, case, "shifted")) for case in result.audit.cases]
    worse = sum(mine >= its for mine, its in pairs)
    return (
        f"On {worse} of {len(pairs)} shifted functions it is no better than random search." if worse else ""
    )


def _zettl(own: pd.DataFrame) -> str:
    """Whether the minimum of Zettl's function was out of reach: it has a negative coordinate."""
    losses = own.loc[(own["function"] == "zettl") & (own["family"] == "plain"), "loss"].dropna()
    if losses.empty or losses.min() < 0.0:
        return ""
    return (
        f"Zettl's function as published: the best of {len(losses)} runs ends at "
        f"{format_number(float(losses.min()), digits=2)} and none goes below 0, the infimum over positive "
        "coordinates; the minimum is −0.00379, where the first coordinate is −0.03."
    )


def _failures(own: pd.DataFrame) -> str:
    failed = own[own["status"] == "failed"]
    if failed.empty:
        return ""
    cause = failed["error"].value_counts().index[0] if failed["error"].notna().any() else "unknown"
    return f"{len(failed)} of {len(own)} runs failed, each counted as the worst result ({cause})."


def paragraphs(result: AuditResult) -> dict[str, str]:
    """Verdicts and findings of every audited solver, as text by label.

    Parameters
    ----------
    result : AuditResult
        The audit.
    """
    by_solver = _by_solver(result)
    return {
        entry.label: "\n".join(
            [
                f"{entry.label}: {headline(by_solver[entry.label])}.",
                *(f"  {sentence(verdict)}" for verdict in by_solver[entry.label]),
                *(f"  {text}" for text in findings(result, entry.label)),
            ]
        )
        for entry in result.audit.solvers
        if entry.label in by_solver
    }


def _by_solver(result: AuditResult) -> dict[str, list[Verdict]]:
    found: dict[str, list[Verdict]] = {}
    for verdict in result.verdicts():
        found.setdefault(verdict.solver, []).append(verdict)
    return found


def cell(verdict: Verdict) -> str:
    """One verdict as a cell of a table."""
    if verdict.biased is None:
        return "not judged"
    found = verdict.counts[verdict.sides[0]] if verdict.biased else None
    if found is None:  # the side nearest to a verdict
        found = max(verdict.counts.values(), key=lambda ns: max(map(_share, ns, verdict.functions)))
    counted = ", ".join(f"{n}/{total}" for n, total in zip(found, verdict.functions, strict=True))
    return f"{f'yes: {verdict.side}' if verdict.biased else 'no'} ({counted})"


def _share(n: int, total: int) -> float:
    return n / total if total else 0.0


def verdict_table(result: AuditResult) -> Table:
    """Table of all verdicts for the console, the audited solvers first.

    Parameters
    ----------
    result : AuditResult
        The audit.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text("Biased?", style="bold"), title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("solver", overflow="fold")
    for name in result.audit.biases:
        table.add_column(name)
    by_solver = _by_solver(result)
    for entry in (*result.audit.solvers, *result.audit.references):
        audited = entry in result.audit.solvers
        cells = [
            Text(cell(verdict), style="bold red" if verdict.biased and verdict.bias.fault else "")
            for verdict in by_solver.get(entry.label, [])
        ]
        table.add_row(Text(entry.label), *cells, style="" if audited else "dim")
    return table


def notes(result: AuditResult) -> list[str]:
    """Sentences that say how to read the verdicts."""
    return [
        f"Gap: loss minus minimum, at least {FLOOR:g}, beyond which rounding decides. Log ratio: base-10 "
        "logarithm of the ratio of the gaps of two runs with the same seed in two places; its median has a "
        "95 % bootstrap interval (bias-corrected and accelerated, 2000 resamples, fixed seed).",
        f"A function favours a side when the whole interval is beyond {DECADES:g} power of ten; a solver is "
        f"biased when at least {100 * SHARE:.0f} % of the functions of one number of variables favour the "
        f"same side. Counts are for {_listed(_levels(result))}; functions that have only one number of "
        "variables count with the lowest.",
        "Origin: minimum at the zero vector against the same function shifted. Where the box is symmetric "
        "the origin is also its centre; on rosenbrock and zettl it is not. Corner: at 0.1 of every axis "
        "against its mirror image at 0.9. Orthant: all coordinates positive against the mirror image, all "
        "negative. Mirror images include the landscape, so a search without a side has the same results on "
        "both.",
        "Rotation: shifted against shifted and turned. A search along the axes loses there what it gains on "
        "functions that are sums over single variables: a property, and no bias to a place.",
        "A bias that is not found may be there: on functions that a solver does not solve anywhere, nothing "
        "shows.",
    ]


def _levels(result: AuditResult) -> list[str]:
    return list(next((verdict.levels for verdict in result.verdicts()), ()))


def _listed(parts: list[Any]) -> str:
    texts = [str(part) for part in parts]
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 2 else texts)


def decades(value: float) -> str:
    """A log ratio as text, with its sign."""
    return "–" if np.isnan(value) else f"{value:+.1f}".replace("-", "−")
