"""Pictures of a tuning: innovations in their bands, their whiteness and their size, before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from comparisons.drawing import UNAIDED, WIDTH, Style, plain_ticks, styled
from comparisons.wording import format_number
from navopt.filters.consistency import chi_square_band

if TYPE_CHECKING:
    from comparisons.tune import Tuning
    from comparisons.tune_check import FilterCheck

__all__ = [
    "MOST_CHANNELS",
    "covariance_picture",
    "innovation_picture",
    "nis_picture",
    "probability",
    "whiteness_picture",
]

TUNED = Style("#0072B2", "s", "-")
BAND = "#dbe7f1"
OUTSIDE = "#D55E00"
#: Channels that are drawn; the numbers of all are in the tables.
MOST_CHANNELS = 6
#: Means of the NIS along the record.
BLOCKS = 40


@styled
def innovation_picture(tuning: Tuning) -> Figure:
    """Draw the innovations of each channel with the 95 % band that the filter states, before and after.

    Parameters
    ----------
    tuning : Tuning
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        One row per channel, `MOST_CHANNELS` at most.
    """
    figure, panels = _panels(tuning, 2.3)
    x, label = _axis(tuning)
    for k, row in enumerate(panels):
        for axes, check, style, word in _pairs(tuning, row):
            innovation = check.innovations[:, k]
            seen = np.isfinite(innovation)
            # where nothing was measured the filter states none: the band is drawn on
            sigma = 1.96 * np.interp(x, x[seen], check.sigma[seen, k])
            axes.fill_between(x, -sigma, sigma, color=BAND, linewidth=0)
            out = seen & (np.abs(innovation) > sigma)
            size = 2.5 if len(x) > 300 else 4.0
            for part, colour in ((seen & ~out, style.colour), (out, OUTSIDE)):
                axes.plot(x[part], innovation[part], ".", color=colour, markersize=size)
            axes.axhline(0.0, color="#888888", linewidth=0.8)
            axes.set_title(f"{word}: {100 * check.inside[k]:.1f} % inside (95 % expected)")
        # a wide prior makes the first bands huge; the data say what is to be seen
        both = np.concatenate([tuning.before.innovations[:, k], tuning.after.innovations[:, k]])
        late = slice(len(x) // 20, None)
        bands = np.concatenate([c.sigma[late, k] for c in (tuning.before, tuning.after)])
        reach = 1.1 * max(np.nanmax(np.abs(both)), 2.0 * np.nanmedian(bands))
        row[0].set_ylim(-reach, reach)
        row[0].set_ylabel(f"{tuning.log.channels[k]}\nmeasured − predicted")
    for axes in panels[-1]:
        axes.set_xlabel(label)
    return figure


@styled
def whiteness_picture(tuning: Tuning) -> Figure:
    """Draw the autocorrelation of each channel's whitened innovations with its 95 % band, before and after.

    Parameters
    ----------
    tuning : Tuning
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        The p-values are those of the Ljung-Box test.
    """
    figure, panels = _panels(tuning, 2.1)
    for k, row in enumerate(panels):
        for axes, check, style, word in _pairs(tuning, row):
            lags = np.arange(1, check.lags + 1)
            half = check.autocorrelation_band[k]
            axes.axhspan(-half, half, color=BAND, linewidth=0)
            axes.axhline(0.0, color="#888888", linewidth=0.8)
            axes.vlines(lags, 0.0, check.autocorrelation[k], color=style.colour, linewidth=2.0)
            axes.plot(lags, check.autocorrelation[k], "o", color=style.colour, markersize=3.5)
            axes.set_title(f"{word}: Ljung–Box p {probability(check.whiteness[k])}")
        reach = max(1.15 * float(np.nanmax(np.abs(c.autocorrelation[k]), initial=0.0)) for c in _both(tuning))
        reach = max(reach, 2.0 * tuning.after.autocorrelation_band[k])
        row[0].set_ylim(-reach, reach)
        row[0].set_ylabel(f"{tuning.log.channels[k]}\nautocorrelation")
    for axes in panels[-1]:
        axes.set_xlabel("lag (steps)")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


@styled
def nis_picture(tuning: Tuning) -> Figure:
    """Draw means of the normalised innovation squared over pieces of the record, with their 95 % band.

    Parameters
    ----------
    tuning : Tuning
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        Per measurement, so that 1 is expected whatever is missing.
    """
    x, label = _axis(tuning)
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    axes = figure.subplots()
    pieces = np.array_split(np.arange(len(x)), min(BLOCKS, max(1, len(x) // 5)))
    counts = np.array([tuning.after.counts[piece].sum() for piece in pieces])
    kept = [(piece, count) for piece, count in zip(pieces, counts.tolist(), strict=True) if count]
    centre = np.array([x[piece].mean() for piece, _ in kept])
    band = np.array([chi_square_band(1.0, count) for _, count in kept])
    if len(kept) > 1:
        axes.fill_between(centre, band[:, 0], band[:, 1], color=BAND, linewidth=0, label="95 % band")
    else:
        axes.axhspan(*band[0], color=BAND, linewidth=0, label="95 % band")
    axes.axhline(1.0, color="#888888", linewidth=0.8)
    values = []
    for check, style, word in (
        (tuning.before, UNAIDED, "before"),
        (tuning.after, TUNED, "after"),
    ):
        mean = np.array([check.nis[piece].sum() / count for piece, count in kept])
        values.append(mean)
        share = 100.0 * np.mean((band[:, 0] <= mean) & (mean <= band[:, 1]))
        axes.plot(
            centre, mean, color=style.colour, linestyle=style.line, marker=style.marker, markersize=3.5,
            linewidth=1.3, label=f"{word} (mean {format_number(check.mean_nis)}, {share:.0f} % inside)",
        )  # fmt: skip
    everything = np.concatenate([*values, band.ravel()])
    if everything.min() > 0.0 and everything.max() / everything.min() > 30.0:
        axes.set_yscale("log")
        plain_ticks(axes.yaxis, everything.min(), everything.max())
    length = len(pieces[0])
    axes.set_ylabel("NIS per measurement")
    axes.set_xlabel(f"{label}; means over {length} steps each")
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=3, borderaxespad=0.1, fontsize=9)
    return figure


@styled
def covariance_picture(tuning: Tuning) -> Figure:
    """Draw the 1 sigma of the noises over time, of an estimate that adapts.

    Parameters
    ----------
    tuning : Tuning
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        Roots of the diagonals of Q and R; dotted, the present ones.
    """
    x, label = _axis(tuning)
    figure = Figure(figsize=(WIDTH, 4.6), layout="constrained")
    for axes, matrix, old, name in zip(
        figure.subplots(2, 1, sharex=True), (tuning.estimate.Q, tuning.estimate.R),
        (tuning.before.Q, tuning.before.R), "QR", strict=True,
    ):  # fmt: skip
        each = matrix if np.ndim(matrix) == 3 else np.broadcast_to(matrix, (len(x), *np.shape(matrix)))
        sigma = np.sqrt(np.diagonal(each, axis1=1, axis2=2))
        present = np.sqrt(np.diagonal(old, axis1=-2, axis2=-1))
        colours = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#332288"]
        for k in range(min(sigma.shape[1], MOST_CHANNELS)):
            axes.plot(x, sigma[:, k], color=colours[k], linewidth=1.4, label=f"{name}[{k}, {k}]")
            axes.plot(
                x, np.broadcast_to(present[..., k], len(x)), color=colours[k], linestyle=":", linewidth=1.2
            )
        axes.set_ylabel(f"1σ of the noise in {name}")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="upper right", ncols=3, fontsize=9)
    axes.set_xlabel(label)
    return figure


def probability(value: float) -> str:
    """Word a p-value: ``= 0.34``, ``< 0.001``, or a dash."""
    if not np.isfinite(value):
        return "–"
    return "< 0.001" if value < 1e-3 else f"= {value:.2g}"


def _both(tuning: Tuning) -> tuple[FilterCheck, FilterCheck]:
    return tuning.before, tuning.after


def _panels(tuning: Tuning, height: float) -> tuple[Figure, np.ndarray]:
    """Two columns that share the range of each row."""
    rows = min(len(tuning.log.channels), MOST_CHANNELS)
    figure = Figure(figsize=(WIDTH, height * rows + 0.5), layout="constrained")
    return figure, figure.subplots(rows, 2, sharex=True, sharey="row", squeeze=False)


def _pairs(tuning: Tuning, row: np.ndarray) -> list[tuple[Axes, FilterCheck, Style, str]]:
    return [(row[0], tuning.before, UNAIDED, "before"), (row[1], tuning.after, TUNED, "after")]


def _axis(tuning: Tuning) -> tuple[np.ndarray, str]:
    """What is drawn along: hours, minutes or seconds since the start, or samples."""
    time = tuning.log.time
    if time is None:
        return np.arange(len(tuning.log), dtype=float), "sample"
    since = time - time[0]
    for least, unit, name in ((2.0 * 3600.0, 3600.0, "h"), (600.0, 60.0, "min")):
        if since[-1] > least:
            return since / unit, f"time since the first measurement ({name})"
    return since, "time since the first measurement (s)"
