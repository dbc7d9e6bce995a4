"""Recordings of an inertial unit: gyro and accelerometer samples, and what can be wrong with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from navopt.errors import InvalidInput

__all__ = ["CHANNELS", "ImuRecording", "check_recording", "gap_samples"]

#: Names of the six channels, in the order of the columns.
CHANNELS = (
    "gyro_x", "gyro_y", "gyro_z", "accelerometer_x", "accelerometer_y", "accelerometer_z",
)  # fmt: skip
#: A step of time so many times longer than the usual one is a gap.
GAP_FACTOR = 3.0
#: A channel that keeps one value for longer than this, while it is noisy elsewhere, is stuck, s.
STUCK_S = 5.0
#: So many equal samples in a row at the very end of a channel's range are a limit, not a coincidence.
LIMIT_RUN = 4


@dataclass(frozen=True, kw_only=True)
class ImuRecording:
    """Samples of three gyros and three accelerometers.

    Attributes
    ----------
    time : ndarray, shape (N,)
        Seconds, increasing.
    gyro, accelerometer : ndarray, shape (N, 3)
        Samples along x, y and z: rad/s and m/s2, or counts above `gyro_zero` and `accelerometer_zero`.
    gyro_unit : str
        ``"rad/s"`` or ``"counts"``.
    accelerometer_unit : str
        ``"m/s2"`` or ``"counts"``.
    gyro_zero, accelerometer_zero : float
        Count that stands for zero (32768 for 16 bits without sign); it has been subtracted.
    latitude : float or None
        Where it was recorded, rad, if the file says so.
    gravity : float or None
        Gravity there, m/s2, if the file says so.
    source : str
        Name of the file.
    notes : tuple of str
        Remarks of the reader.

    Raises
    ------
    InvalidInput
        If shapes differ, there are fewer than 10 samples, a value is not finite or times do not increase.
    """

    time: np.ndarray
    gyro: np.ndarray
    accelerometer: np.ndarray
    gyro_unit: str = "rad/s"
    accelerometer_unit: str = "m/s2"
    gyro_zero: float = 0.0
    accelerometer_zero: float = 0.0
    latitude: float | None = None
    gravity: float | None = None
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        length = np.size(self.time)
        shapes = {"time": (length,), "gyro": (length, 3), "accelerometer": (length, 3)}
        if length < 10:
            raise InvalidInput("recording", f"{length} samples", "give a recording of at least some seconds")
        for name, shape in shapes.items():
            values = np.array(getattr(self, name), dtype=float)
            if values.shape != shape:
                raise InvalidInput(name, values.shape, f"give one row per time, shape {shape}")
            bad = np.argwhere(~np.isfinite(values))
            if len(bad):
                which = name if name == "time" else f"{name}_{'xyz'[bad[0][1]]}"
                raise InvalidInput(
                    which,
                    f"{len(bad)} values that are not finite, the first at sample {bad[0][0]}",
                    "drop those samples, or cut the recording with --from and --until",
                )
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        backwards = np.flatnonzero(np.diff(self.time) <= 0)
        if backwards.size:
            k = int(backwards[0])
            raise InvalidInput(
                "time",
                f"{self.time[k]:.6g} then {self.time[k + 1]:.6g} at sample {k + 1}",
                "times must increase: sort the samples and drop repeated ones",
            )
        for name, known in (("gyro_unit", ("rad/s", "counts")), ("accelerometer_unit", ("m/s2", "counts"))):
            if getattr(self, name) not in known:
                raise InvalidInput(name, getattr(self, name), f"give {known[0]!r} or {known[1]!r}")

    def __len__(self) -> int:
        return len(self.time)

    @property
    def interval(self) -> float:
        """Usual time between two samples, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])

    def between(self, start: float | None = None, stop: float | None = None) -> ImuRecording:
        """Return the part from one time to another.

        Parameters
        ----------
        start, stop : float, optional
            Seconds as in `time`; open if not given.

        Returns
        -------
        ImuRecording

        Raises
        ------
        InvalidInput
            If nothing or too little is left.
        """
        low = -np.inf if start is None else start
        high = np.inf if stop is None else stop
        kept = (self.time >= low) & (self.time <= high)
        if kept.sum() < 10:
            raise InvalidInput(
                "--from, --until",
                f"{kept.sum()} samples between {low:g} and {high:g} s",
                f"the recording lasts from {self.time[0]:g} to {self.time[-1]:g} s",
            )
        return replace(
            self, time=self.time[kept], gyro=self.gyro[kept], accelerometer=self.accelerometer[kept]
        )


def gap_samples(time: np.ndarray) -> np.ndarray:
    """Return the samples after which time is missing.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Seconds, increasing.

    Returns
    -------
    ndarray of int
        k where time[k + 1] - time[k] is more than three times the usual step.
    """
    step = np.diff(time)
    return np.flatnonzero(step > GAP_FACTOR * np.median(step))


def check_recording(recording: ImuRecording) -> list[str]:
    """Refuse a recording with a stuck or saturated channel, and tell of gaps.

    Parameters
    ----------
    recording : ImuRecording
        The samples.

    Returns
    -------
    list of str
        Remarks.

    Raises
    ------
    InvalidInput
        If a channel never changes, keeps one value for seconds although it is noisy elsewhere, or stays at
        the end of its range; the channel and the time are named.
    """
    samples = np.hstack([recording.gyro, recording.accelerometer])
    for channel, values in zip(CHANNELS, samples.T, strict=True):
        # a channel at its limit is stuck there too, and the limit says more
        _refuse_saturated(channel, values, recording.time)
        _refuse_stuck(channel, values, recording.time)
    gaps = gap_samples(recording.time)
    if not gaps.size:
        return []
    lost = np.diff(recording.time)[gaps].sum()
    return [f"{gaps.size} gaps in time, {lost:.1f} s in all: no pose and no rotation across one is used"]


def _runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First sample and length of every run of equal values."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0) + 1])
    return starts, np.diff(np.concatenate([starts, [len(values)]]))


def _refuse_stuck(channel: str, values: np.ndarray, time: np.ndarray) -> None:
    starts, lengths = _runs(values)
    if len(starts) == 1:
        raise InvalidInput(
            channel, f"{values[0]:g} at all samples", "the channel is stuck or not recorded: give its samples"
        )
    interval = float(np.median(np.diff(time)))
    window = max(round(1.0 / interval), 2)
    count = len(values) // window
    if count == 0:
        return
    spread = np.ptp(values[: count * window].reshape(count, window), axis=1)
    if np.median(spread) == 0.0:
        # so coarse a channel that most seconds show one value: long runs mean nothing
        return
    longest = int(np.argmax(lengths))
    if lengths[longest] * interval > STUCK_S:
        at = starts[longest]
        raise InvalidInput(
            channel,
            f"{values[at]:g} for {lengths[longest] * interval:.1f} s from {time[at]:.1f} s on",
            "the channel is stuck there: cut the recording with --from and --until",
        )


def _refuse_saturated(channel: str, values: np.ndarray, time: np.ndarray) -> None:
    if not np.ptp(values):
        return
    noise = float(np.median(np.abs(np.diff(values)))) + np.finfo(float).tiny
    quantum = np.diff(np.unique(values)).min()
    middle = np.median(values)
    starts, lengths = _runs(values)
    for limit in (values.min(), values.max()):
        at_limit = (values[starts] == limit) & (lengths >= LIMIT_RUN)
        far = abs(limit - middle) > 20.0 * max(noise, quantum)
        if far and at_limit.any():
            first = int(np.argmax(at_limit))
            total = int(lengths[at_limit].sum())
            raise InvalidInput(
                channel,
                f"{total} samples at the limit {limit:g}, the first at {time[starts[first]]:.1f} s",
                "the channel is saturated: turn more slowly, or cut the recording with --from and --until",
            )
