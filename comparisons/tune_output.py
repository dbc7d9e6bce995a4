"""Files of a tuning: covariances, innovations, pictures and report, all or none of them."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.result_folder import checksums_of, write_files
from comparisons.run_key import versions
from comparisons.tune_figures import (
    covariance_picture,
    innovation_picture,
    nis_picture,
    probability,
    whiteness_picture,
)
from comparisons.wording import format_number

if TYPE_CHECKING:
    from comparisons.tune import Tuning
    from comparisons.tune_check import FilterCheck

__all__ = ["FILES", "innovations_csv", "summary_lines", "tuning_summary", "write_tuning"]

#: What is written, and what each file is.
FILES = {
    "tuned.json": "Q and R with standard errors, consistency, settings, versions and checksums",
    "innovations.csv": "innovations before and after, one row per measurement",
    "report.html": "all of it to read, with the pictures",
    "innovations.png": "innovations with their bands",
    "whiteness.png": "autocorrelations with their bands",
    "nis.png": "normalised innovations squared",
    "covariances.png": "Q and R over time; of an estimator that adapts only",
}
#: Version of the layout of ``tuned.json``.
FORMAT = 1


def write_tuning(
    tuning: Tuning, folder: str | Path, *, inputs: Mapping[str, Path] | None = None
) -> list[Path]:
    """Write all files of a tuning; if one cannot be made, none is left behind.

    Parameters
    ----------
    tuning : Tuning
        The result.
    folder : path-like
        Where to; made if need be. Files of an earlier tuning in it are replaced, others not touched.
    inputs : mapping of str to pathlib.Path, optional
        The files that were read (``model``, ``data``), for their checksums.

    Returns
    -------
    list of pathlib.Path
        The files, in the order of `FILES`.

    Raises
    ------
    InvalidInput
        If the folder cannot be made or written.
    """
    from comparisons.drawing import render
    from comparisons.tune_report import tuning_report

    drawn = {
        "innovations.png": innovation_picture(tuning),
        "whiteness.png": whiteness_picture(tuning),
        "nis.png": nis_picture(tuning),
    }
    if tuning.varies:
        drawn["covariances.png"] = covariance_picture(tuning)
    pictures = {name: render(figure, format="png") for name, figure in drawn.items()}
    summary = tuning_summary(tuning, inputs=inputs)
    contents = {
        "tuned.json": (json.dumps(summary, indent=1, allow_nan=False) + "\n").encode(),
        "innovations.csv": innovations_csv(tuning).encode(),
        "report.html": tuning_report(tuning, pictures, summary).encode(),
        **pictures,
    }
    written = write_files(folder, {name: contents[name] for name in FILES if name in contents})
    for name in set(FILES) - set(contents):
        # of an earlier tuning: it would be taken for this one's
        (Path(folder) / name).unlink(missing_ok=True)
    return written


def innovations_csv(tuning: Tuning) -> str:
    """Return innovations before and after as CSV, in the units of the measurements.

    ``time`` in seconds (``step`` where there are no times); for each channel y ``y_before``,
    ``y_sigma_before``, ``y_after`` and ``y_sigma_after``, empty where nothing was measured; then
    ``measured``, the number of measurements, and ``nis_before`` and ``nis_after`` of all of them
    together. Where the estimate varies, the diagonals of Q and R follow.
    """
    log = tuning.log
    checks = {"before": tuning.before, "after": tuning.after}
    columns: list[tuple[str, np.ndarray]] = []
    for k, channel in enumerate(log.channels):
        for word, check in checks.items():
            columns.append((f"{channel}_{word}", check.innovations[:, k]))
            columns.append((f"{channel}_sigma_{word}", check.sigma[:, k]))
    columns.append(("measured", tuning.after.counts))
    columns += [(f"nis_{word}", check.nis) for word, check in checks.items()]
    if tuning.varies:
        for name in "QR":
            matrix = getattr(tuning.estimate, name)
            each = matrix if np.ndim(matrix) == 3 else np.broadcast_to(matrix, (len(log), *matrix.shape))
            columns += [(f"{name}_{i}{i}", each[:, i, i]) for i in range(each.shape[1])]
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["step" if log.time is None else "time", *(name for name, _ in columns)])
    for k in range(len(log)):
        first = str(k) if log.time is None else f"{log.time[k]:.12g}"
        table.writerow([first, *(_cell(values[k]) for _, values in columns)])
    return text.getvalue()


def tuning_summary(tuning: Tuning, *, inputs: Mapping[str, Path] | None = None) -> dict[str, Any]:
    """Return Q, R, standard errors, consistency, settings, versions and checksums, ready for JSON.

    Parameters
    ----------
    tuning : Tuning
        The result.
    inputs : mapping of str to pathlib.Path, optional
        The files that were read.

    Returns
    -------
    dict
        Variances in the squares of the units of the model.
    """
    solution, settings, errors = tuning.solution, tuning.solution.settings, tuning.errors
    return {
        "format": FORMAT,
        "filter": tuning.name,
        "Q": tuning.Q.tolist(),
        "R": tuning.R.tolist(),
        "process_covariance": tuning.process_covariance.tolist(),
        "varies_with_time": tuning.varies,
        "standard_errors": {
            "Q": None if errors.Q is None else errors.Q.tolist(),
            "R": None if errors.R is None else errors.R.tolist(),
            "parameters": errors.parameters,
            "why_none": errors.why_not or None,
        },
        "before": {"Q": _constant(tuning.before.Q), "R": _constant(tuning.before.R)} | _check(tuning.before),
        "after": _check(tuning.after),
        "channels": list(tuning.log.channels),
        "log_likelihood_gain": tuning.gain,
        "consistent": tuning.consistent,
        "scores": tuning.scores(),
        "solver": {
            "name": settings.get("solver"),
            "options": {key: _plain(value) for key, value in (settings.get("options") or {}).items()},
            "seed": settings.get("seed"),
            "budget": settings.get("budget"),
            "status": solution.status,
            "message": solution.message,
            "loss": float(solution.loss),
            "cost": int(solution.counts.cost),
            "elapsed_s": round(float(solution.elapsed_s), 3),
        },
        "data": {
            "name": tuning.log.source,
            "steps": len(tuning.log),
            "measurements": int(tuning.after.counts.sum()),
        },
        "files": checksums_of(inputs),
        "notes": list(tuning.notes),
        "versions": versions(),
    }


def summary_lines(tuning: Tuning) -> list[str]:
    """Return the result in a few lines of text."""
    lines = [f"Q = {_words(tuning.Q)}", f"R = {_words(tuning.R)}"]
    if tuning.varies:
        lines = [f"{line} (mean over time; it varies)" for line in lines]
    errors = tuning.errors
    if errors.why_not:
        lines.append(f"no standard errors: {errors.why_not}")
    else:
        assert errors.Q is not None
        assert errors.R is not None
        lines.append(f"1 sigma of Q {_words(errors.Q)}, of R {_words(errors.R)}")
    before, after = tuning.before, tuning.after
    lines.append(f"log-likelihood: {tuning.gain:+.1f} nats")
    lines.append(
        f"NIS per measurement: {format_number(before.mean_nis)} before, {format_number(after.mean_nis)} "
        f"after (95 % band {after.nis_band[0]:.3f} to {after.nis_band[1]:.3f})"
    )
    worst = [np.nanmin(c.whiteness) if np.isfinite(c.whiteness).any() else np.nan for c in (before, after)]
    lines.append(
        f"whiteness (Ljung-Box, least of all channels): p {probability(worst[0])} before, "
        f"{probability(worst[1])} after"
    )
    scores = tuning.scores()
    for state in tuning.states:
        if f"{state}_rmse_after" in scores:
            pair = [format_number(scores[f"{state}_rmse_{word}"]) for word in ("before", "after")]
            lines.append(
                f"{state}, rms error against the truth (scoring only): {pair[0]} before, {pair[1]} after"
            )
    lines.append(
        "the innovations are white and of the stated size"
        if tuning.consistent
        else "the filter is not consistent with its data: look at the report"
    )
    return [*lines, *(f"note: {note}" for note in tuning.notes)]


def _check(check: FilterCheck) -> dict[str, Any]:
    return {
        "log_likelihood": check.log_likelihood,
        "nis_per_measurement": check.mean_nis,
        "nis_band": list(check.nis_band),
        "share_inside_95": [float(value) for value in check.inside],
        "ljung_box_p": [float(value) if np.isfinite(value) else None for value in check.whiteness],
        "lags": check.lags,
        "white": check.white,
        "sized": check.sized,
    }


def _constant(matrix: np.ndarray) -> Any:
    return matrix.tolist() if matrix.ndim == 2 else None


def _words(matrix: np.ndarray) -> str:
    if matrix.size == 1:
        return f"{matrix[0, 0]:.4g}"
    return "[" + ", ".join("[" + ", ".join(f"{value:.4g}" for value in row) + "]" for row in matrix) + "]"


def _cell(value: Any) -> str:
    if isinstance(value, np.integer):
        return str(value)
    return f"{value:.9g}" if np.isfinite(value) else ""


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {key: _plain(item) for key, item in dataclasses.asdict(value).items()}
    return value if isinstance(value, str | int | float | bool | None) else repr(value)
