"""Where a hand-held unit lay still: poses found by the variance of its samples.

The idea is that of Tedaldi, Pretto and Menegatti (2014): the variance in a short window is compared with that
of an initial period in which the unit certainly lay still. Three things are done otherwise.

*Gyros count too.* They see a slow turn that changes the accelerometers by less than their noise; the larger
of the two statistics decides. Each is the mean over its axes of window variance over initial variance, so
that axes with different noise count alike; it is about 1 while nothing moves.

*The threshold is not searched for.* There the multiple of the initial variance is the one for which the
accelerometer calibration leaves the smallest residual, which prefers few and short poses. Here it is ten
times the largest statistic of the initial period: a unit that was set down by hand has a few times the
variance of one left alone, a moving one hundreds of times, and ten stands between. That the answer does not
hang on it is shown by the number of poses at half and at twice the threshold.

*The initial period is tested.* If it does not look static, nothing can be compared with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navopt.data.imu_recording import gap_samples
from navopt.errors import InvalidInput

__all__ = ["StaticPoses", "detect_static", "window_moments"]

#: Threshold over the largest statistic of the initial period.
THRESHOLD_FACTOR = 10.0
#: The initial period ends where the variance is this many times that of its first windows.
INITIAL_END = 20.0
#: Windows the initial period must have at least.
INITIAL_WINDOWS = 5
#: Largest over median statistic that a static period may have.
UNEVEN = 10.0
#: A recording whose quietest tenth has less than this share of the initial variance began with a movement.
QUIETER = 0.1


@dataclass(frozen=True, kw_only=True)
class StaticPoses:
    """What the detector has decided.

    Attributes
    ----------
    start, stop : ndarray of int, shape (P,)
        First sample of each pose and the one after its last.
    statistic : ndarray, shape (N,)
        Largest of the gyros' and the accelerometers' relative variance in the window around each sample;
        NaN where a window would reach beyond the recording or across a gap.
    threshold : float
        Static below it.
    initial_stop : int
        The sample after the initial static period.
    window : int
        Samples in a window.
    noise : ndarray, shape (6,)
        Standard deviation of a sample in the initial period, gyros first.
    half_threshold, double_threshold : int
        Number of poses found with half and twice the threshold.
    """

    start: np.ndarray
    stop: np.ndarray
    statistic: np.ndarray
    threshold: float
    initial_stop: int
    window: int
    noise: np.ndarray
    half_threshold: int
    double_threshold: int

    def __len__(self) -> int:
        return len(self.start)

    @property
    def mask(self) -> np.ndarray:
        """Whether each sample belongs to a pose, shape (N,)."""
        found = np.zeros(len(self.statistic), dtype=bool)
        for first, end in zip(self.start, self.stop, strict=True):
            found[first:end] = True
        return found


def window_moments(samples: np.ndarray, window: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and variance of every window of consecutive samples.

    Parameters
    ----------
    samples : ndarray, shape (N, k)
        The samples.
    window : int
        Samples in a window.

    Returns
    -------
    mean, variance : ndarray, shape (N - window + 1, k)
        The variance divides by the number of samples. Windows are merged from shorter ones (Chan, Golub and
        LeVeque, 1983): a running sum of squares would drown the noise of a good gyro in the rounding of the
        turns before it.
    """
    if not 1 <= window <= len(samples):
        raise InvalidInput("window", window, f"give 1 to {len(samples)} samples")
    block = np.array(samples, dtype=float), np.zeros(samples.shape)
    size, done, left = 1, 0, window
    found = block
    while left:
        if left & 1:
            found = _merged(found, done, block, size) if done else block
            done += size
        left >>= 1
        if left:
            block = _merged(block, size, block, size)
            size *= 2
    return found[0], found[1] / window


_Moments = tuple[np.ndarray, np.ndarray]


def _merged(first: _Moments, size: int, second: _Moments, other: int) -> _Moments:
    """Mean and sum of squares about it of windows followed by windows of another length."""
    count = min(len(first[0]), len(second[0]) - size)
    mean, total = first[0][:count], first[1][:count]
    next_mean, next_total = second[0][size : size + count], second[1][size : size + count]
    apart, share = next_mean - mean, other / (size + other)
    return mean + share * apart, total + next_total + size * share * apart**2


def detect_static(
    time: np.ndarray,
    gyro: np.ndarray,
    accelerometer: np.ndarray,
    *,
    initial_static_s: float | None = None,
    window_s: float = 1.0,
    threshold: float | None = None,
    shortest_pose_s: float = 2.0,
) -> StaticPoses:
    """Find the poses in which a unit lay still.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Seconds, increasing.
    gyro, accelerometer : ndarray, shape (N, 3)
        Samples, in any unit.
    initial_static_s : float, optional
        Time from the first sample on during which the unit certainly lay still, s; found if not given: until
        the variance exceeds twenty times that of the first three windows.
    window_s : float
        Length of a window, s.
    threshold : float, optional
        Static below this relative variance; ten times the largest one of the initial period if not given.
    shortest_pose_s : float
        Shorter poses are left out, s.

    Returns
    -------
    StaticPoses
        Half a window at either end of a pose does not belong to it, because it is mixed with movement.

    Raises
    ------
    InvalidInput
        If the initial period is too short or does not look static, or no pose is found.
    """
    for name, value in (("window_s", window_s), ("shortest_pose_s", shortest_pose_s)):
        if not value > 0:
            raise InvalidInput(name, value, "give a positive number of seconds")
    if threshold is not None and not threshold > 1.0:
        raise InvalidInput("--threshold", threshold, "give a number above 1: the noise itself has about 1")
    interval = float(np.median(np.diff(time)))
    window = max(round(window_s / interval), 5)
    samples = np.hstack([gyro, accelerometer])
    if len(samples) < (INITIAL_WINDOWS + 1) * window:
        raise InvalidInput(
            "recording",
            f"{time[-1] - time[0]:.1f} s",
            f"give at least {INITIAL_WINDOWS + 1} windows of {window_s:g} s",
        )
    _, variance = window_moments(samples, window)
    quantum = np.array([np.diff(np.unique(column)).min() if np.ptp(column) else 0.0 for column in samples.T])
    # a coarse channel can show no variance at all: its rounding is the least it has
    variance = np.maximum(variance, quantum**2 / 12.0)
    initial = _initial(time, variance, window, initial_static_s)
    usual = variance[: initial - window + 1].mean(axis=0)
    sensors = (variance / usual).reshape(len(variance), 2, 3).mean(axis=2)
    _check_initial(sensors, initial, window, time)
    ratio = sensors.max(axis=1)
    found = THRESHOLD_FACTOR * ratio[: initial - window + 1].max() if threshold is None else threshold
    statistic = np.full(len(samples), np.nan)
    half = window // 2
    statistic[half : half + len(ratio)] = ratio
    for gap in gap_samples(time):
        statistic[max(gap + 1 - half, 0) : gap + 1 + window - half] = np.nan
    shortest = max(round(shortest_pose_s / interval), 2)
    start, stop = _intervals(statistic, found, shortest, half)
    if not len(start):
        raise InvalidInput(
            "recording", "no static pose", "hold each pose for some seconds, or raise --threshold"
        )
    return StaticPoses(
        start=start,
        stop=stop,
        statistic=statistic,
        threshold=float(found),
        initial_stop=initial,
        window=window,
        noise=np.sqrt(usual),
        half_threshold=len(_intervals(statistic, 0.5 * found, shortest, half)[0]),
        double_threshold=len(_intervals(statistic, 2.0 * found, shortest, half)[0]),
    )


def _initial(time: np.ndarray, variance: np.ndarray, window: int, given: float | None) -> int:
    """Sample after the initial static period."""
    if given is not None:
        end = int(np.searchsorted(time, time[0] + given))
        if not given > 0 or end < INITIAL_WINDOWS * window or end > len(time):
            raise InvalidInput(
                "--initial-static",
                given,
                f"give at least {INITIAL_WINDOWS} windows, and not more than the recording has",
            )
        return end
    first = variance[: 3 * window : window].mean(axis=0)
    ratio = (variance / first).reshape(len(variance), 2, 3).mean(axis=2).max(axis=1)
    moving = np.flatnonzero(ratio > INITIAL_END)
    # the first window that feels the movement ends in it; what is before that window is safe
    end = int(moving[0]) if moving.size else len(time)
    if end < INITIAL_WINDOWS * window:
        raise InvalidInput(
            "recording",
            f"movement {time[min(end, len(time) - 1)] - time[0]:.1f} s after its begin",
            "let the unit lie still for 20 s or more at first, or cut what is before that with --from",
        )
    return end


def _check_initial(sensors: np.ndarray, initial: int, window: int, time: np.ndarray) -> None:
    """Refuse an initial period in which the unit moved, by the gyros or the accelerometers alone."""
    inside = sensors[: initial - window + 1]
    usual, most = np.median(inside, axis=0), inside.max(axis=0)
    least = np.minimum(inside.min(axis=0), np.quantile(sensors, 0.1, axis=0))
    if np.any(most > UNEVEN * usual) or np.any(least < QUIETER * usual):
        raise InvalidInput(
            "--initial-static",
            f"{time[initial - 1] - time[0]:.1f} s in which the variance is up to "
            f"{(most / np.maximum(least, 1e-12)).max():.0f} times the least one",
            "the unit moved there: give a shorter period, or cut the recording with --from",
        )


def _intervals(
    statistic: np.ndarray, threshold: float, shortest: int, half: int
) -> tuple[np.ndarray, np.ndarray]:
    """Runs of static samples, at least so long; the ends of the recording are static as their neighbours."""
    with np.errstate(invalid="ignore"):
        static = statistic < threshold
    known = np.flatnonzero(np.isfinite(statistic))
    if known.size:
        static[: known[0]] = static[known[0]]
        static[known[-1] + 1 :] = static[known[-1]]
    edge = np.diff(np.concatenate([[0], static.astype(int), [0]]))
    start, stop = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    # the centre of a static window is static, and so is all of the window
    kept = stop - start >= shortest
    return start[kept], stop[kept]
