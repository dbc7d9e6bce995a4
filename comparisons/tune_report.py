"""The report of a tuning: one HTML page with tables and pictures in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.pages import data_source, environment, style
from comparisons.tune_figures import MOST_CHANNELS, probability
from comparisons.wording import format_number

if TYPE_CHECKING:
    from comparisons.tune import Tuning

__all__ = ["entry_rows", "tuning_report"]

PICTURES = {
    "innovations.png": (
        "Innovations",
        "Measured minus predicted, with the 95 % band that the filter states. Points outside it are orange: "
        "one in twenty should be. A band that is too wide or too narrow is a covariance of the wrong size; "
        "waves are a gain that is too small, or a wrong model.",
    ),
    "whiteness.png": (
        "Whiteness",
        "Autocorrelation of the whitened innovations, with the 95 % band for white noise. What is left in "
        "them could have been predicted. p is the probability that white noise looks as coloured as this "
        "(Ljung–Box test).",
    ),
    "nis.png": (
        "Size",
        "Normalised innovation squared per measurement, means over pieces of the record, with the 95 % band "
        "of such means (chi-square). Above it the filter believes its predictions too much, below it too "
        "little. One piece in twenty may be outside.",
    ),
    "covariances.png": ("Noise over time", "Roots of the diagonals of Q and R; dotted, before."),
}


def entry_rows(tuning: Tuning) -> list[tuple[str, str, str, str]]:
    """Return name, value before, value after and 1 sigma of every entry of Q and R that is not zero.

    Parameters
    ----------
    tuning : Tuning
        The result.

    Returns
    -------
    list of tuple of str
        Upper triangles; an empty sigma means that there is none.
    """
    rows = []
    for name in "QR":
        after, sigma = getattr(tuning, name), getattr(tuning.errors, name)
        before = getattr(tuning.before, name)
        for i in range(len(after)):
            for j in range(i, len(after)):
                if before[i, j] == 0.0 and after[i, j] == 0.0:
                    continue
                stated = "" if sigma is None else format_number(float(sigma[i, j]), digits=2)
                if sigma is not None and sigma[i, j] == 0.0:
                    stated = "fixed"
                old, new = (format_number(float(a[i, j]), digits=4) for a in (before, after))
                rows.append((f"{name}[{i}, {j}]", old, new, stated))
    return rows


def tuning_report(tuning: Tuning, pictures: Mapping[str, bytes], summary: Mapping[str, Any]) -> str:
    """Return the page of a tuning.

    Parameters
    ----------
    tuning : Tuning
        The result.
    pictures : mapping of str to bytes
        PNG files by their names.
    summary : mapping
        What goes into ``tuned.json``.

    Returns
    -------
    str
        HTML that needs no other file and no network.
    """
    templates = environment()
    return templates.get_template("tune.html.j2").render(
        title=f"Tuning of {tuning.name}",
        style=style(templates),
        verdict=_verdict(tuning),
        consistent=tuning.consistent,
        notes=tuning.notes,
        entries=entry_rows(tuning),
        varies=tuning.varies,
        no_sigma=tuning.errors.why_not,
        channels=_channels(tuning),
        size=_size(tuning),
        level=format_number(0.05 / len(tuning.log.channels), digits=2),
        states=_states(tuning),
        pictures=[
            {"heading": heading, "caption": caption, "source": data_source(pictures[name], "png")}
            for name, (heading, caption) in PICTURES.items()
            if name in pictures
        ],
        hidden=max(len(tuning.log.channels) - MOST_CHANNELS, 0),
        shown=MOST_CHANNELS,
        facts=_facts(tuning, summary),
    )


def _verdict(tuning: Tuning) -> str:
    white, sized = tuning.after.white, tuning.after.sized
    what = {
        (True, True): "white and of the size that the filter states",
        (True, False): "white, but not of the size that the filter states",
        (False, True): "of the size that the filter states, but not white",
        (False, False): "neither white nor of the size that the filter states",
    }[white, sized]
    return f"With the tuned covariances the innovations are {what}."


def _channels(tuning: Tuning) -> list[dict[str, str]]:
    rows = []
    for k, channel in enumerate(tuning.log.channels):
        row = {"name": channel}
        for word, check in (("before", tuning.before), ("after", tuning.after)):
            own = check.innovations[:, k]
            row[f"rms_{word}"] = format_number(float(np.sqrt(np.nanmean(own**2))))
            row[f"inside_{word}"] = f"{100 * check.inside[k]:.1f} %"
            row[f"p_{word}"] = probability(check.whiteness[k]).removeprefix("= ")
        rows.append(row)
    return rows


def _size(tuning: Tuning) -> dict[str, str]:
    low, high = tuning.after.nis_band
    return {
        "before": format_number(tuning.before.mean_nis),
        "after": format_number(tuning.after.mean_nis),
        "band": f"{low:.3f} to {high:.3f}",
        "gain": f"{tuning.gain:+.1f}".replace("-", "−"),
    }


def _states(tuning: Tuning) -> list[tuple[str, str, str]]:
    """Errors against the truth, before and after."""
    scores = tuning.scores()
    names = {f"{state}_rmse": f"{state}, rms error" for state in tuning.states} | {
        "nees": "NEES (1 expected)"
    }
    return [
        (label, format_number(scores[f"{key}_before"]), format_number(scores[f"{key}_after"]))
        for key, label in names.items()
        if f"{key}_after" in scores and f"{key}_before" in scores
    ]


def _facts(tuning: Tuning, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    solver, data = summary["solver"], summary["data"]
    options = ", ".join(f"{key} = {value}" for key, value in solver["options"].items())
    problem = tuning.problem
    model = problem.model
    found = [
        ("Solver", f"{solver['name']} ({options})" if options else str(solver["name"])),
        ("It ended because", solver["message"]),
        ("Cost", f"{solver['cost']} runs of the filter, {solver['elapsed_s']:.1f} s"),
        (
            "Model",
            f"states: {model.n_states}, process noises: {model.n_noises}, channels: {model.n_measurements}; "
            f"Q {problem.Q_form.kind}, R {problem.R_form.kind}",
        ),
        ("Data", f"{data['name'] or 'arrays'}: {data['steps']} steps, {data['measurements']} measurements"),
    ]
    for name, file in summary["files"].items():
        found.append((f"File ({name})", f"{file['name']}, SHA-256 {file['sha256']}"))
    found.append(("Versions", ", ".join(f"{name} {number}" for name, number in summary["versions"].items())))
    return found
