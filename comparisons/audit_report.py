"""The page of an audit: one HTML file that needs nothing else, and two CSV files beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from comparisons.audit_figures import bias_figure, family_figure
from comparisons.audit_suite import BIASES, FAMILIES
from comparisons.audit_wording import cell, decades, findings, headline, notes, sentence
from comparisons.drawing import solver_styles
from comparisons.pages import environment, inline_picture, style, write_text
from comparisons.planning import full_settings
from comparisons.run_key import versions
from comparisons.wording import format_number

if TYPE_CHECKING:
    from comparisons.audit import AuditResult

__all__ = ["write_audit"]


def write_audit(result: AuditResult, path: str | Path) -> Path:
    """Write the page of an audit, ``bias.csv`` (every log ratio) and ``gaps.csv`` (every run).

    The page holds its pictures and style itself, asks nothing of any network, and is byte-identical for
    the same results.

    Parameters
    ----------
    result : AuditResult
        The audit.
    path : path-like
        The HTML file, or an existing folder for ``audit.html``.

    Returns
    -------
    pathlib.Path
        The HTML file.

    Raises
    ------
    StoreError
        If a file cannot be written there.
    """
    target = Path(path)
    if target.is_dir():
        target = target / "audit.html"
    templates = environment()
    page = templates.get_template("audit.html.j2").render(_context(result), style=style(templates))
    write_text(target, page)
    for name, frame in (("bias.csv", result.bias()), ("gaps.csv", result.gaps)):
        write_text(target.with_name(name), frame.to_csv(index=False, lineterminator="\n"))
    return target


def _context(result: AuditResult) -> dict[str, Any]:
    audit = result.audit
    styles = solver_styles(audit.study())
    verdicts = result.verdicts()
    own = {
        entry.label: [verdict for verdict in verdicts if verdict.solver == entry.label]
        for entry in (*audit.solvers, *audit.references)
    }
    planned = len(audit.study().scenarios) * len(audit.seeds) * len(own)
    return {
        "title": f"Audit of {', '.join(entry.label for entry in audit.solvers)}",
        "missing": planned - len(result.gaps),
        "planned": planned,
        "audited": [
            {
                "label": entry.label,
                "headline": headline(own[entry.label]),
                "lines": [sentence(verdict) for verdict in own[entry.label]],
                "findings": findings(result, entry.label),
            }
            for entry in audit.solvers
        ],
        "biases": list(audit.biases),
        "verdicts": [
            {
                "label": label,
                "reference": label not in {entry.label for entry in audit.solvers},
                "cells": [
                    {"text": cell(verdict), "biased": bool(verdict.biased and verdict.bias.fault)}
                    for verdict in found
                ],
            }
            for label, found in own.items()
        ],
        "ratios": [_ratios(result, bias) for bias in audit.biases],
        "families": [_family(result, family) for family in audit.families],
        "facts": [
            ("Functions", ", ".join(case.label for case in audit.cases)),
            ("Seeds", f"{len(audit.seeds)}, from {min(audit.seeds)} to {max(audit.seeds)}"),
            ("Budget per run", f"{audit.budget} evaluations"),
            ("Runs", f"{len(result.gaps)} of {planned}"),
            ("Versions", ", ".join(f"{name} {number}" for name, number in versions().items())),
        ],
        "solvers": [
            {
                "label": entry.label,
                "name": entry.name,
                "given": ", ".join(f"{key} = {value}" for key, value in entry.settings.items()),
                "default": ", ".join(
                    f"{key} = {value}"
                    for key, value in full_settings(entry.name, entry.settings).items()
                    if key not in entry.settings
                ),
            }
            for entry in (*audit.solvers, *audit.references)
        ],
        "notes": notes(result),
        "colours": {label: style.colour for label, style in styles.items()},
        "command": _command(result),
    }


def _ratios(result: AuditResult, bias: str) -> dict[str, Any]:
    """Figure and table of one bias: median log ratio with its interval, by function and solver."""
    table = result.bias()
    table = table[table["bias"] == bias].set_index(["function", "dimension", "solver"])
    labels = list(dict.fromkeys(result.gaps["solver"]))
    rows = []
    for case in result.audit.cases:
        cells = []
        for label in labels:
            row: Any = table.loc[(case.function, case.dimension, label)]
            interval = "" if pd.isna(row["low"]) else f" [{decades(row['low'])} to {decades(row['high'])}]"
            cells.append({"text": decades(row["median"]) + interval, "biased": row["side"] != 0})
        rows.append({"label": case.label, "cells": cells})
    spec = BIASES[bias]
    return {
        "name": bias,
        "labels": labels,
        "rows": rows,
        "picture": inline_picture(
            bias_figure(result, bias),
            f"Log ratios of the gaps {spec.other} and {spec.favoured} of every solver on every function",
            "Median log ratio with its 95 % interval. The band is one power of ten to either side.",
        ),
    }


def _family(result: AuditResult, family: str) -> dict[str, Any]:
    medians = result.gaps.groupby(["function", "dimension", "family", "solver"])["gap"].median()
    labels = list(dict.fromkeys(result.gaps["solver"]))
    rows = [
        {
            "label": case.label,
            "cells": [
                format_number(
                    medians.get((case.function, case.dimension, case.family(family), label), float("nan")),
                    digits=2,
                )
                for label in labels
            ],
        }
        for case in result.audit.cases
    ]
    return {
        "name": family,
        "words": FAMILIES[family],
        "labels": labels,
        "rows": rows,
        "picture": inline_picture(
            family_figure(result, family),
            f"Gaps of every solver on every function, {FAMILIES[family]}",
            "Gap to the minimum: medians and quartiles over the seeds.",
        ),
    }


def _command(result: AuditResult) -> str:
    audit = result.audit
    names = " ".join(f"'{entry.label}'" if "," in entry.label else entry.label for entry in audit.solvers)
    dimensions = ",".join(map(str, audit.dimensions))
    first = f" --first-seed {audit.seeds[0]}" if audit.seeds[0] else ""
    seeds = f"--seeds {len(audit.seeds)}{first}"
    return f"navopt audit {names} --dimensions {dimensions} {seeds} --budget {audit.budget}"
