"""The report of a study: one HTML page that needs nothing else, and two CSV files beside it."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from comparisons.curve_figure import curve_picture
from comparisons.curves import curve_table, places_of_long_curves, study_curves
from comparisons.drawing import UNAIDED
from comparisons.effects import effect_table
from comparisons.effects_page import WORDS, effect_cells, effect_groups, effect_notes, forest
from comparisons.figures import convergence, error_boxes, map_picture, solver_styles
from comparisons.overall import NOTE as RANK_NOTE
from comparisons.overall import OverallRanks, overall_cells, overall_frame, overall_ranks, overall_words
from comparisons.overall_figure import rank_picture
from comparisons.pages import environment, inline_picture, write_text
from comparisons.printed import NOTE as PRINTED_NOTE
from comparisons.printed import printed_cells, printed_sources, printed_table
from comparisons.provenance import checksums, commands, facts, in_words, solver_rows, study_toml
from comparisons.statistics import FAILURES, REFERENCES, ranked_table, reference_errors, success_columns
from comparisons.tuning_pictures import course_pictures
from comparisons.wording import Display, cells, format_number, notes, reference_cells, smallest_p

__all__ = ["write_report"]


def write_report(store: Any, path: str | Path | None = None) -> Path:
    """Write the report of a study from its store.

    The page holds its pictures and style itself, asks nothing of any network, and is byte-identical for
    the same store. ``table.csv`` (the ranked table) and ``runs.csv`` (every run) are written beside it,
    and where there is something to say, ``effects.csv`` (of an ablation), ``printed.csv`` (printed values
    beside ours), ``curves.csv`` (scores along curves) and ``ranks.csv`` (ranks over all scenarios).
    Each file is replaced as a whole, so that a reader never sees half of one.

    Parameters
    ----------
    store : ResultsStore
        Results of the study; they may be incomplete, or failures only.
    path : path-like, optional
        The HTML file, or an existing folder for ``report.html``; by default beside the store.

    Returns
    -------
    pathlib.Path
        The HTML file.

    Raises
    ------
    StoreError
        If a file cannot be written there.
    """
    target = Path(path) if path is not None else Path(store.path).parent
    if target.is_dir() or (path is None and not target.suffix):
        target = target / "report.html"
    study, runs = store.study, store.runs()
    table = ranked_table(runs, study)
    effects = effect_table(runs, study) if study.ablation and len(runs) else None
    printed = printed_table(runs, study) if study.printed else None
    overall = overall_ranks(runs, study, table=table)
    curves = curve_table(table, study) if study.curve and len(runs) else None
    context = {
        **_context(store, study, runs, table),
        "effects": _effects(effects, study),
        "printed": _printed(printed, study),
        "curves": _curves(curves, study),
        "overall": [_overall(one, study) for one in overall],
        "rank_note": RANK_NOTE,
    }
    page = environment().get_template("report.html.j2").render(context)
    write_text(target, page)
    if effects is not None:
        write_text(target.with_name("effects.csv"), effects.to_csv(index=False, lineterminator="\n"))
    if printed is not None:
        write_text(target.with_name("printed.csv"), printed.to_csv(index=False, lineterminator="\n"))
    if curves is not None:
        write_text(target.with_name("curves.csv"), curves.to_csv(index=False, lineterminator="\n"))
    if overall:
        frame = overall_frame(overall)
        write_text(target.with_name("ranks.csv"), frame.to_csv(index=False, lineterminator="\n"))
    write_text(target.with_name("table.csv"), table.to_csv(index=False, lineterminator="\n"))
    write_text(target.with_name("runs.csv"), _flat(runs).to_csv(index=False, lineterminator="\n"))
    return target


def _context(store: Any, study: Any, runs: pd.DataFrame, table: pd.DataFrame) -> dict[str, Any]:
    traces, beyond = store.traces(), places_of_long_curves(study)
    shown = [label for label in study.scenarios if label not in beyond]
    planned = len(study.scenarios) * len(study.worlds) * len(study.solvers) * len(study.seeds)
    failed = int(runs["status"].isin(FAILURES).sum()) if len(runs) else 0
    return {
        "title": study.title or study.name,
        "paragraphs": [part for part in study.description.split("\n\n") if part.strip()],
        "planned": planned,
        "finished": len(runs),
        "failed": failed,
        "findings": [text for scenario in shown for text in _findings(table, study, scenario)],
        "facts": facts(store, study, runs),
        "scenarios": [_scenario(store, study, runs, traces, table, label) for label in shown],
        "beyond": len(beyond),
        "failures": _failures(runs),
        "invalid": _invalid(runs),
        "solvers": solver_rows(study, runs),
        "checksums": checksums(study, runs),
        "commands": commands(study),
        "toml": study_toml(study),
        "notes": notes(table, study),
        "colours": {label: style.colour for label, style in solver_styles(study).items()},
        "neutral": UNAIDED.colour,
    }


def _findings(table: pd.DataFrame, study: Any, scenario: str, *, significance: float = 0.05) -> list[str]:
    """One sentence on who is best in a scenario, and who cannot be told from it."""
    display = Display.of(study)
    here = table[table["scenario"] == scenario]
    best = here[here["best"]]
    if best.empty:
        return []
    row = best.iloc[0]
    unit = f" {display.unit}" if display.unit else ""
    middle, low, high = (display.text(row[name]) for name in ("median", "median_low", "median_high"))
    text = f"{scenario}: {row['solver']} has the lowest median {display.label}, {middle}{unit}"
    if np.isfinite(row["median_low"]):
        text += f" (95 % interval {low} to {high})"
    others = here[(here["runs"] > 0) & ~here["best"]]
    ties = list(others.loc[others["tie"], "solver"])
    if len(others) == 0:
        return [text + "."]
    if smallest_p(here) >= significance:
        return [text + "; these are too few worlds to tell it from the others."]
    if not ties:
        return [text + "; every other solver differs from it significantly."]
    if len(ties) == len(others):
        return [text + "; no other solver can be told apart from it on these worlds."]
    return [text + f"; not told apart from it: {', '.join(ties)}."]


def _scenario(
    store: Any,
    study: Any,
    runs: pd.DataFrame,
    traces: dict[str, np.ndarray],
    table: pd.DataFrame,
    label: str,
) -> dict[str, Any]:
    display = Display.of(study)
    labels = [name for name, _, _ in success_columns(study)]
    here = table[table["scenario"] == label]
    shown = cells(here, labels, display)
    rows = [
        {"cells": list(values), "solver": solver, "best": best, "reference": method in REFERENCES}
        for values, solver, best, method in zip(
            shown.to_numpy(), here["solver"], here["best"], here["method"], strict=True
        )
    ]
    reference = reference_errors(store, study, label)
    if reference is not None:
        extra = reference_cells(reference, study, list(shown.columns), display)
        rows.append({"cells": extra, "solver": None, "best": False, "reference": True})
    done = bool(len(runs)) and bool((runs["scenario"] == label).any())
    pictures = []
    # the places of a curve, which may be hundreds, have its picture
    if done and not any(label in curve.scenarios for curve in study_curves(study)):
        pictures = [
            inline_picture(
                error_boxes(runs, study, scenario=label, table=table),
                f"Box plots of the {display.label} of each solver in scenario {label}",
                f"{display.title[:1].upper()}{display.title[1:]}: quartiles, median and whiskers over all "
                "runs; each dot is a world.",
            ),
            inline_picture(
                convergence(store, scenario=label, runs=runs, traces=traces),
                f"Best loss so far against cost in scenario {label}",
                "Convergence: median and quartile band of the best loss over worlds and seeds (above the "
                "minimum, where that is known; differences below 1e−16 are drawn there). The last "
                "marker of a line is where the median run stops spending; the thin line holds its value.",
            ),
        ]
        for world in study.worlds[: max(study.illustrate, 0)]:
            figure = map_picture(store, scenario=label, world=world)
            if figure is not None:
                caption = (
                    "The field with the true, inertial and matched tracks: whole voyage, matched window, "
                    "last point. Frames mark the next panel's area."
                )
                alt = f"Map of scenario {label}, world {world}, with the tracks of all solvers"
                pictures.append(inline_picture(figure, alt, caption, format="png"))
            for figure, alt, caption in course_pictures(store, scenario=label, world=world):
                pictures.append(inline_picture(figure, alt, caption, format="png"))
    return {
        "label": label,
        "words": in_words(study.scenarios[label]),
        "columns": list(shown.columns),
        "rows": rows,
        "pictures": pictures,
        "done": done,
    }


def _effects(table: pd.DataFrame | None, study: Any) -> dict[str, Any] | None:
    """Return the section on the ingredients of an ablation; None where there is nothing to say."""
    if table is None or not table["pairs"].any():
        return None
    display = Display.of(study)
    groups = [(heading, effect_cells(part, display)) for heading, part in effect_groups(table)]
    picture = inline_picture(
        forest(table, study),
        "Forest plot of the effect size of each ingredient with its interval",
        "Effect of each ingredient: right of the line the base's value is better. Bands are negligible, "
        "small and medium effects, bars 95 % intervals over worlds.",
    )
    return {
        "groups": [
            {"heading": heading, "columns": list(cells.columns), "rows": cells.to_numpy().tolist()}
            for heading, cells in groups
        ],
        "picture": picture,
        "words": WORDS,
        "notes": effect_notes(table, study),
    }


def _printed(table: pd.DataFrame | None, study: Any) -> dict[str, Any] | None:
    """Return the section on printed values; None where the study has none."""
    if table is None:
        return None
    groups = []
    for source, part in printed_sources(table):
        cells = printed_cells(part, study)
        rows = cells.to_numpy().tolist()
        notes = [note for note in dict.fromkeys(part["note"]) if note]
        groups.append({"source": source, "columns": list(cells.columns), "rows": rows, "notes": notes})
    return {"groups": groups, "note": PRINTED_NOTE, "words": ("scenario", "solver", "of", "verdict")}


def _curves(table: pd.DataFrame | None, study: Any) -> list[dict[str, Any]]:
    """Return the pictures of the curves that have been run."""
    if table is None:
        return []
    return [
        inline_picture(
            curve_picture(table, study, curve=k),
            f"Curves of the {Display.of(study).label} of each solver against {curve.axis[1]}",
            f"{', '.join(filter(None, (curve.axis[1], curve.label)))}: median and quartiles over all runs; "
            "where there are worlds enough also shares, with their 95 % intervals.",
        )
        for k, curve in enumerate(study_curves(study))
        if (table.loc[table["curve"] == k, "runs"] > 0).any()
    ]


def _overall(overall: OverallRanks, study: Any) -> dict[str, Any]:
    """Return the section on the ranks over one group of scenarios."""
    cells = overall_cells(overall)
    picture = inline_picture(
        rank_picture(overall, study),
        f"Mean ranks of the solvers over {overall.group} with Nemenyi's critical difference",
        "Mean ranks, half the critical difference to either side: bars that do not overlap differ "
        "significantly. The band is the reach of the first; small dots are ranks in single scenarios.",
    )
    return {
        "group": overall.group,
        "columns": list(cells.columns),
        "rows": cells.to_numpy().tolist(),
        "words": overall_words(overall),
        "picture": picture,
    }


def _failures(runs: pd.DataFrame) -> list[dict[str, Any]]:
    """Failed and invalid runs, counted by scenario, solver and cause."""
    if not len(runs):
        return []
    tally: dict[tuple[str, str, str, str], list[int]] = {}
    for row in runs[runs["status"].isin(FAILURES)].to_dict("records"):
        cause = row["error"] if isinstance(row["error"], str) and row["error"] else row["message"]
        tally.setdefault((row["scenario"], row["solver"], row["status"], cause), []).append(int(row["world"]))
    return [
        {
            "scenario": scenario,
            "solver": solver,
            "status": status,
            "cause": cause,
            "runs": len(worlds),
            "worlds": _listed(sorted(set(worlds))),
        }
        for (scenario, solver, status, cause), worlds in tally.items()
    ]


def _listed(values: list[int], *, most: int = 8) -> str:
    text = ", ".join(map(str, values[:most]))
    return f"{text} and {len(values) - most} more" if len(values) > most else text


def _invalid(runs: pd.DataFrame) -> list[dict[str, Any]]:
    """Candidates that the model could not evaluate, by scenario, solver and reason."""
    if not len(runs):
        return []
    tally: Counter[tuple[str, str, str]] = Counter()
    spent: Counter[tuple[str, str]] = Counter()
    for row in runs.to_dict("records"):
        who = row["scenario"], row["solver"]
        spent[who] += int(row["cost"]) if np.isfinite(row["cost"]) else 0
        for reason, count in (row["invalid"] or {}).items():
            tally[*who, reason] += int(count)
    return [
        {
            "scenario": scenario,
            "solver": solver,
            "reason": reason,
            "count": format_number(count) if count >= 1000 else str(count),
            "share": f"{100 * count / spent[scenario, solver]:.1f} %" if spent[scenario, solver] else "–",
        }
        for (scenario, solver, reason), count in tally.items()
        if count
    ]


def _flat(runs: pd.DataFrame) -> pd.DataFrame:
    """Put one plain value in each cell: arrays as numbers with spaces between, tables as JSON."""
    flat = runs.drop(columns=[name for name in ("scores", "held_out") if name in runs])
    for name in ("counts", "invalid", "settings"):
        if name in flat:
            flat[name] = [json.dumps(value, sort_keys=True, default=str) for value in flat[name]]
    if "x" in flat:
        flat["x"] = [" ".join(repr(float(v)) for v in np.ravel(x)) for x in flat["x"]]
    return flat
