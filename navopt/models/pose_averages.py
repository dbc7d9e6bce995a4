"""Averages of static poses and what they are worth: noise that does not average out included.

The standard error of a mean is that of white noise only if the noise is white. Here the noise is
described by the Allan variance of the initial static period,

    sigma2(T) = Q / T^2 + N / T + B + K T,

quantisation (or dither), white noise, flicker and random walk. The four non-negative coefficients of each
channel are fitted to the overlapping Allan variance of averages up to a quarter of the period, and sigma2(T)
is taken for the variance of a mean over T: for white noise they are the same, for slower noise it is what two
neighbouring means differ by.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navopt.errors import InvalidInput
from navopt.models.static_detector import StaticPoses

__all__ = ["MeanNoise", "PoseAverages", "allan_variance", "average_poses"]

#: A pose whose first and last third differ by so many sigmas was not static.
MOVING = 10.0


@dataclass(frozen=True)
class MeanNoise:
    """Variance of a mean over a time T, for each channel.

    Attributes
    ----------
    coefficients : ndarray, shape (k, 4)
        Of T^-2, T^-1, 1 and T, T in seconds.
    """

    coefficients: np.ndarray

    def variance(self, duration_s: float, *, white_factor: np.ndarray | float = 1.0) -> np.ndarray:
        """Return the variance of a mean.

        Parameters
        ----------
        duration_s : float
            Averaging time, s.
        white_factor : array_like, optional
            What the part that averages out is multiplied by, for a noisier period.

        Returns
        -------
        ndarray, shape (k,)
        """
        q, n, b, k = self.coefficients.T
        return white_factor * (q / duration_s**2 + n / duration_s) + b + k * duration_s

    @property
    def white(self) -> np.ndarray:
        """Density of the white noise, unit times square root of a second, shape (k,)."""
        return np.sqrt(self.coefficients[:, 1])

    @classmethod
    def of(cls, samples: np.ndarray, interval: float) -> MeanNoise:
        """Fit the noise of a static period.

        Parameters
        ----------
        samples : ndarray, shape (N, k)
            The period.
        interval : float
            Time between samples, s.

        Returns
        -------
        MeanNoise
        """
        from scipy.optimize import nnls

        longest = max(len(samples) // 4, 1)
        sizes = np.unique(np.round(np.geomspace(1, longest, 25)).astype(int))
        observed = np.array([allan_variance(samples, int(size)) for size in sizes])
        duration = sizes * interval
        basis = np.stack([duration**-2.0, duration**-1.0, np.ones(len(sizes)), duration], axis=1)
        # relative error of an Allan variance: about 1 over the root of the number of separate means
        weight = np.sqrt(len(samples) / sizes)
        rows = []
        for channel in observed.T:
            scale = weight / np.maximum(channel, np.finfo(float).tiny)
            # columns of one size, for the solver
            size = np.abs(basis * scale[:, None]).max(axis=0)
            found, _ = nnls(basis * scale[:, None] / size, channel * scale)
            rows.append(found / size)
        return cls(np.array(rows))


@dataclass(frozen=True, kw_only=True)
class PoseAverages:
    """Means over the static poses.

    Attributes
    ----------
    start, stop : ndarray of int, shape (P,)
        First sample of each pose and the one after its last.
    time, duration : ndarray, shape (P,)
        Middle and length, s.
    gyro, accelerometer : ndarray, shape (P, 3)
        Means.
    gyro_sigma, accelerometer_sigma : ndarray, shape (P, 3)
        Their standard errors.
    noise : MeanNoise
        Of the six channels, gyros first.
    left_out : int
        Poses that were not used because they drifted.
    """

    start: np.ndarray
    stop: np.ndarray
    time: np.ndarray
    duration: np.ndarray
    gyro: np.ndarray
    accelerometer: np.ndarray
    gyro_sigma: np.ndarray
    accelerometer_sigma: np.ndarray
    noise: MeanNoise
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.start)


def allan_variance(samples: np.ndarray, size: int) -> np.ndarray:
    """Return the overlapping Allan variance of averages of so many samples.

    Parameters
    ----------
    samples : ndarray, shape (N, k)
        Equally spaced samples.
    size : int
        Samples in an average, at most N / 2.

    Returns
    -------
    ndarray, shape (k,)
        Half the mean square difference of neighbouring averages.

    Raises
    ------
    InvalidInput
        If there are not two averages.
    """
    if size < 1 or 2 * size > len(samples):
        raise InvalidInput("size", size, f"give 1 to {len(samples) // 2} samples")
    total = np.concatenate(
        [np.zeros((1, samples.shape[1])), np.cumsum(samples - samples.mean(axis=0), axis=0)]
    )
    mean = (total[size:] - total[:-size]) / size
    return 0.5 * np.mean((mean[size:] - mean[:-size]) ** 2, axis=0)


def average_poses(
    time: np.ndarray, gyro: np.ndarray, accelerometer: np.ndarray, poses: StaticPoses
) -> PoseAverages:
    """Average every static pose and give the standard errors.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Seconds.
    gyro, accelerometer : ndarray, shape (N, 3)
        Samples.
    poses : StaticPoses
        Where the unit lay still.

    Returns
    -------
    PoseAverages
        Poses whose accelerometers drift by more than ten sigmas from the first to the last third are left
        out: something moved, slowly.
    """
    samples = np.hstack([gyro, accelerometer])
    interval = float(np.median(np.diff(time)))
    noise = MeanNoise.of(samples[: poses.initial_stop], interval)
    usual = poses.noise**2
    kept, means, variances = [], [], []
    for k, (first, end) in enumerate(zip(poses.start, poses.stop, strict=True)):
        part = samples[first:end]
        lasted = len(part) * interval
        # a pose on an unsteady support has more of what averages out, if it is more than chance
        ratio = part.var(axis=0) / usual
        factor = np.where(ratio > 1.0 + 3.0 * np.sqrt(2.0 / len(part)), ratio, 1.0)
        third = max(len(part) // 3, 1)
        apart = part[-third:, 3:].mean(axis=0) - part[:third, 3:].mean(axis=0)
        error = np.sqrt(2.0 * noise.variance(third * interval, white_factor=factor)[3:])
        if np.any(np.abs(apart) > MOVING * error):
            continue
        kept.append(k)
        means.append(part.mean(axis=0))
        variances.append(noise.variance(lasted, white_factor=factor))
    if not kept:
        raise InvalidInput(
            "recording",
            "no pose without drift",
            "the unit moved slowly all the time: put it on something solid",
        )
    start, stop = poses.start[kept], poses.stop[kept]
    mean, sigma = np.array(means), np.sqrt(variances)
    return PoseAverages(
        start=start,
        stop=stop,
        time=0.5 * (time[start] + time[stop - 1]),
        duration=(stop - start) * interval,
        gyro=mean[:, :3],
        accelerometer=mean[:, 3:],
        gyro_sigma=sigma[:, :3],
        accelerometer_sigma=sigma[:, 3:],
        noise=noise,
        left_out=len(poses) - len(kept),
    )
