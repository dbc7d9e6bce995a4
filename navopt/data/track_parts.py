"""Parts and means of a recorded track: a span of time, blocks of samples, what lies between gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from navopt.data.recorded import RecordedTrack
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput

__all__ = ["Gap", "after_last_gap", "averaged", "between", "gaps"]

#: An interval is a gap if it is so many times as long as the usual one.
GAP_FACTOR = 3.0


@dataclass(frozen=True)
class Gap:
    """A time without measurements.

    Attributes
    ----------
    sample : int
        Last sample before it.
    seconds : float
        Its length.
    """

    sample: int
    seconds: float


def _moment(recorded: RecordedTrack, text: str, argument: str) -> float:
    """Second of a track that a text means: a number, or a date and time (UTC if it has no zone)."""
    try:
        return float(text)
    except ValueError:
        pass
    if recorded.start is None:
        raise InvalidInput(argument, text, f"{recorded.source} counts seconds: give seconds")
    import pandas as pd

    try:
        stamp = pd.Timestamp(text)
    except ValueError:
        stamp = pd.NaT
    if pd.isna(stamp):
        raise InvalidInput(argument, text, "give seconds or an ISO 8601 date and time")
    stamp = stamp.tz_localize("UTC") if stamp.tzinfo is None else stamp.tz_convert("UTC")
    return float((stamp - pd.Timestamp(recorded.start, tz="UTC")).total_seconds())


def between(recorded: RecordedTrack, *, start: str | None = None, stop: str | None = None) -> RecordedTrack:
    """Return the samples of a span of time, both ends included.

    Parameters
    ----------
    recorded : RecordedTrack
        The track.
    start, stop : str, optional
        Seconds of the track, or ISO 8601 dates and times.

    Returns
    -------
    RecordedTrack

    Raises
    ------
    InvalidInput
        If an end cannot be read, or nothing lies between them.
    """
    time = recorded.track.time
    low = -np.inf if start is None else _moment(recorded, start, "--from")
    high = np.inf if stop is None else _moment(recorded, stop, "--until")
    chosen = (time >= low) & (time <= high)
    if not chosen.any():
        raise InvalidInput(
            "--from, --until",
            f"{start or 'the start'} to {stop or 'the end'}",
            f"no sample lies there: {recorded.source} runs from {recorded.moment(time[0])} to "
            f"{recorded.moment(time[-1])}",
        )
    return recorded if chosen.all() else recorded.rows(chosen)


def gaps(recorded: RecordedTrack) -> list[Gap]:
    """Return the intervals more than three times as long as the usual (median) one, in order."""
    step = np.diff(recorded.track.time)
    if not step.size:
        return []
    return [Gap(int(k), float(step[k])) for k in np.flatnonzero(step > GAP_FACTOR * np.median(step))]


def after_last_gap(recorded: RecordedTrack, longest: float) -> tuple[RecordedTrack, int]:
    """Return the samples after the last gap that is longer than `longest` seconds, and the first's index."""
    long = [gap.sample for gap in gaps(recorded) if gap.seconds > longest]
    if not long:
        return recorded, 0
    first = long[-1] + 1
    return recorded.rows(slice(first, None)), first


def averaged(recorded: RecordedTrack, interval: float) -> RecordedTrack:
    """Return means over blocks of time.

    Parameters
    ----------
    recorded : RecordedTrack
        The track.
    interval : float
        Length of a block, s; the first begins at the first sample. A block without a sample is left out.

    Returns
    -------
    RecordedTrack
        Means of times, positions, values and stated sigmas of the samples in each block: independent noise
        becomes smaller, an INS error, which hardly changes within minutes, stays what it is.

    Raises
    ------
    InvalidInput
        If the interval is not positive.
    """
    if not (np.isfinite(interval) and interval > 0):
        raise InvalidInput("--average", interval, "give a positive number of seconds")
    track = recorded.track
    block = np.floor((track.time - track.time[0]) / interval + 1e-9).astype(int)
    _, block, count = np.unique(block, return_inverse=True, return_counts=True)

    def mean(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else np.bincount(block, values) / count

    def mean_angle(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        return np.arctan2(np.bincount(block, np.sin(values)), np.bincount(block, np.cos(values))) % (
            2 * np.pi
        )

    names = ("time", "latitude", "longitude", "measured", "true_latitude", "true_longitude")
    means = {name: mean(getattr(track, name)) for name in names}
    said = f"{len(track)} samples averaged over {interval:g} s to {len(count)}"
    return replace(
        recorded,
        track=MeasuredTrack(heading=mean_angle(track.heading), **means),  # type: ignore[arg-type]
        position_sigma=mean(recorded.position_sigma),
        notes=(*recorded.notes, said),
    )
