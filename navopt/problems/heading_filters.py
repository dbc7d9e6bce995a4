"""From settings to a filter of a record: covariances as the settings scale and couple them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from navopt.models.heading_record import HeadingRecord
from navopt.models.heading_start import alignment_process_noise, with_heading_state
from navopt.problems.heading_settings import HeadingSettings

__all__ = ["make_filter", "prepare"]

#: Variance of the heading error beside what makes it, rad^2: a fifth of a second of arc, against singularity.
NUGGET = 1e-12


def prepare(record: HeadingRecord) -> dict[str, np.ndarray]:
    """Return what every candidate shares: process noise of each kind of sensor, and the inputs.

    Parameters
    ----------
    record : HeadingRecord
        Of one run.

    Returns
    -------
    dict of str to ndarray
    """
    pieces = {
        "measured": record.measured_constants,
        # one row for each time; the last is not used
        "steps": np.vstack([record.constants, record.constants[-1:]]),
    }
    for name, silent in (("accel", "gyro_noise"), ("gyro", "accelerometer_noise")):
        grade = replace(record.grade, **{silent: 0.0})
        for with_heading in (False, True):
            for correlated in (False, True):
                pieces[f"{name}-{with_heading}-{correlated}"] = alignment_process_noise(
                    record.site, grade, record.step, record.attitude[0], angles=record.x0[2:5],
                    with_heading=with_heading, correlated=correlated,
                )  # fmt: skip
    return pieces


def make_filter(record: HeadingRecord, prepared: dict[str, np.ndarray], settings: HeadingSettings) -> Any:
    """Return the filter of some settings.

    Parameters
    ----------
    record : HeadingRecord
        Whose declared noises the settings scale.
    prepared : dict
        From `prepare`.
    settings : HeadingSettings
        Which filter.

    Returns
    -------
    navopt.filters.HeadingFilter
    """
    from navopt.filters.heading_filter import HeadingFilter

    state, correlated = settings.has_heading_state, settings.formulation == "correlated"
    key = f"{state}-{correlated}"
    Q = settings.accel_scale * prepared[f"accel-{key}"] + settings.gyro_scale * prepared[f"gyro-{key}"]
    velocity, heading = (
        settings.velocity_scale * record.velocity_sigma**2,
        settings.heading_scale * record.heading_sigma**2,
    )
    x0, P0 = record.x0, record.P0
    if state:
        x0, P0 = with_heading_state(x0, P0, prepared["measured"][0], correlated=correlated, extra=NUGGET)
        if settings.heading_state_sigma is not None and not correlated:
            P0[5, 5] = settings.heading_state_sigma**2
    return HeadingFilter(
        Q=Q, R=np.diag([velocity, velocity, heading]), P0=P0, x0=x0, variant=settings.variant,
        heading={"direct": "direct", "none": "none"}.get(settings.formulation, "state"),
        alpha=settings.spread, strong=settings.strong, adaptation=settings.learning,
        covariance_update=settings.covariance_update,
    )  # fmt: skip
