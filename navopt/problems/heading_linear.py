"""Heading-aided alignment as a linear-Gaussian model, for estimators of Q and R that need one.

The model is linear about what a filter has found, step by step: ``x[k+1] = f(x^[k]) + F[k] (x[k] - x^[k])``,
and the same for the heading. It is not the small-angle model of the textbooks, which an uncorrected low-cost
system leaves within minutes, and it is as good as the filter's errors are small: after the first headings,
not before.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit

from navopt.errors import InvalidInput
from navopt.models.azimuth_error_kernels import advance_into, heading_measurement
from navopt.problems.heading_settings import HeadingSettings
from navopt.problems.noise_tuning import NoiseTuning

if TYPE_CHECKING:
    from navopt.problems.heading_alignment import HeadingAlignment

__all__ = ["linearised", "scales_from"]

#: Steps of the differences, of the size of what the states are: m/s, rad, m/s^2, rad/s.
STEPS = np.array([1e-3, 1e-3, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-7, 1e-7, 1e-7])


@njit(cache=True, nogil=True, error_model="numpy")
def _linearise(states, constants, measured, dt, steps, F, drive, slope, seen):
    n = len(steps)
    x, ahead, behind = np.empty(n), np.empty(n), np.empty(n)
    for k in range(len(states)):
        for j in range(n):
            x[:] = states[k]
            x[j] += steps[j]
            advance_into(x, dt, constants[k], False, ahead)
            high = heading_measurement(x, measured[k])
            x[j] -= 2.0 * steps[j]
            advance_into(x, dt, constants[k], False, behind)
            slope[k, j] = (high - heading_measurement(x, measured[k])) / (2.0 * steps[j])
            for i in range(n):
                F[k, i, j] = (ahead[i] - behind[i]) / (2.0 * steps[j])
        seen[k] = heading_measurement(states[k], measured[k])
        advance_into(states[k], dt, constants[k], False, ahead)
        for i in range(n):
            value = ahead[i]
            for j in range(n):
                value -= F[k, i, j] * states[k, j]
            drive[k, i] = value


def linearised(problem: HeadingAlignment, settings: HeadingSettings | None = None) -> NoiseTuning:
    """Return a linear tuning problem about what a filter finds.

    Parameters
    ----------
    problem : HeadingAlignment
        Its record.
    settings : HeadingSettings, optional
        The filter, of ten states; the problem's own if not given.

    Returns
    -------
    NoiseTuning
        Unknown are the variances on five states and of the measurements, as decimal logarithms of what the
        data sheet says; `scales_from` makes settings of an estimate. It carries no truth.

    Raises
    ------
    InvalidInput
        If the filter has a heading state, or fails.
    """
    from navopt.filters.heading_filter import filter_heading

    chosen = problem.settings if settings is None else settings
    if chosen.has_heading_state:
        raise InvalidInput("settings", f"formulation={chosen.formulation!r}", "use 'direct' or 'none'")
    record = problem.record
    inputs = problem.inputs(chosen.velocities)
    run = filter_heading(inputs, problem.filter(chosen))
    if run.failed is not None:
        raise InvalidInput("settings", run.failed, "give settings with which the filter works")
    x = np.ascontiguousarray(run.estimates)
    count = len(x)
    F, drive = np.empty((count, 10, 10)), np.empty((count, 10))
    slope, seen = np.empty((count, 10)), np.empty(count)
    _linearise(x, inputs.constants, inputs.measurement_constants, record.step, STEPS, F, drive, slope, seen)
    z = inputs.measurements.copy()
    gap = (z[:, 2] - seen + np.pi) % (2.0 * np.pi) - np.pi
    z[:, 2] = gap + np.einsum("ki,ki->k", slope, x)
    H = np.zeros((count, 3, 10))
    H[:, 0, 0] = H[:, 1, 1] = 1.0
    H[:, 2] = slope
    channels = 3 if chosen.formulation == "direct" and np.isfinite(z[:, 2]).any() else 2
    Q = record.process_covariance(with_heading=False)[:5, :5]
    return NoiseTuning(
        F, H[:, :channels], z[:, :channels], G=np.eye(10, 5), B=np.eye(10), u=drive, x0=record.x0,
        P0=record.P0, covariance="diagonal", Q_reference=np.diag(np.diag(Q)),
        R_reference=record.measurement_covariance[:channels, :channels], box=(-4.0, 4.0),
    )  # fmt: skip


def scales_from(
    problem: HeadingAlignment, estimate: Any, settings: HeadingSettings | None = None
) -> HeadingSettings:
    """Return settings whose noises are those of an estimate of the linear problem.

    Parameters
    ----------
    problem : HeadingAlignment
        With the declared noises.
    estimate : NoiseEstimate
        Q of five states and R of the measurements, constant or per step.
    settings : HeadingSettings, optional
        Everything else; the problem's own if not given.

    Returns
    -------
    HeadingSettings
        With geometric means: over time, over both accelerometers, the three gyros and both velocities.
    """
    record = problem.record
    declared_Q = np.diag(record.process_covariance(with_heading=False))[:5]
    declared_R = np.diag(record.measurement_covariance)
    tiny = np.finfo(float).tiny
    q, r = (
        np.log(np.maximum(np.diagonal(m[None] if m.ndim == 2 else m, axis1=1, axis2=2), tiny)).mean(axis=0)
        for m in (np.asarray(estimate.Q, dtype=float), np.asarray(estimate.R, dtype=float))
    )
    q, r = np.exp(q - np.log(declared_Q)), np.exp(r - np.log(declared_R[: len(r)]))

    def mean(values: np.ndarray) -> float:
        return float(np.exp(np.log(values).mean()))

    base = problem.settings if settings is None else settings
    return replace(
        base,
        accel_scale=mean(q[:2]),
        gyro_scale=mean(q[2:]),
        velocity_scale=mean(r[:2]),
        heading_scale=float(r[2]) if len(r) == 3 else base.heading_scale,
    )
