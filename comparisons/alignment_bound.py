"""What a static alignment can know of the yaw in a given time, whatever Q; and Table 3 of paper 000."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from comparisons.drawing import COLOURS, LINES, plain_ticks, styled
from navopt.errors import InvalidInput
from navopt.models.alignment_sensors import ImuGrade
from navopt.models.covariance_analysis import FilterCovariances, analyse_filter
from navopt.models.static_alignment import AlignmentModel, StaticSite

__all__ = ["PRINTED_ANGLES", "alignment_knowledge", "alignment_picture", "printed_alignment"]

#: Table 3 of paper 000: final errors of pitch, roll and yaw, and the printed average. No unit is printed.
PRINTED_ANGLES = {
    "PSO-KF": (0.000050336, 0.000065926, 0.000045396, 0.000053886),
    "FOA-KF": (0.000047334, 0.000062827, 0.000006588, 0.000038916),
    "GFOA-KF": (0.000042335, 0.000057818, 0.000004314, 0.000034822),
    "IFOA-KF": (0.000036726, 0.000052809, 0.000000242, 0.000029257),
}
#: How much better the text says the last of them is than each of the others, per cent.
PRINTED_GAINS = {"PSO-KF": 45.71, "FOA-KF": 24.82, "GFOA-KF": 15.98}
#: 1 sigma before the alignment, degrees about east, north, up, and of the measured velocities, m/s.
INITIAL_DEG, VELOCITY_SIGMA = (0.1, 0.1, 0.5), 0.01
#: Time between two measured velocities, s.
STEP = 0.01
#: Longer alignments take fewer steps with as much less noise in each: as much information, less work.
MOST_STEPS = 500
ANGLES = ("pitch", "roll", "yaw")


def printed_alignment() -> pd.DataFrame:
    """Recompute what Table 3 of paper 000 and its text derive from the printed angles.

    Returns
    -------
    pandas.DataFrame
        One row per method: the printed ``pitch, roll, yaw``, ``average`` and ``gain_percent`` (of IFOA-KF
        over it), and ``average_recomputed`` and ``gain_recomputed_percent`` from the printed angles;
        ``gyro_limit_dph``, the error of the gyro towards east that alone would cause the yaw error,
        if that is in rad, in deg/h.
    """
    rows = []
    means = {name: float(np.mean(values[:3])) for name, values in PRINTED_ANGLES.items()}
    north = StaticSite.published().rate_north
    for name, (pitch, roll, yaw, average) in PRINTED_ANGLES.items():
        gain = 100.0 * (1.0 - means["IFOA-KF"] / means[name])
        rows.append(
            {
                "method": name, "pitch": pitch, "roll": roll, "yaw": yaw, "average": average,
                "average_recomputed": means[name],
                "gain_percent": PRINTED_GAINS.get(name, np.nan),
                "gain_recomputed_percent": gain if name in PRINTED_GAINS else np.nan,
                "gyro_limit_dph": float(np.degrees(yaw * north) * 3600.0),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def alignment_knowledge(
    durations: Sequence[float] = (5.0, 50.0, 300.0, 1800.0),
    scales: Sequence[float] | np.ndarray | None = None,
    *,
    raw: bool = False,
    grade: ImuGrade | None = None,
    initial_deg: Sequence[float] = INITIAL_DEG,
) -> pd.DataFrame:
    """Return the 1 sigma of the angles after an alignment, for every Q that a filter may be told.

    The worlds have the true Q of the sensors. For each tuning the mean square error over all worlds is
    worked out, without any draw (`navopt.models.covariance_analysis`), and beside it what the filter
    believes. No Kalman filter is better than the one with the true Q, and none believes less than the one
    with Q = 0: these two are the bounds.

    Parameters
    ----------
    durations : sequence of float
        Lengths of the alignment, s.
    scales : sequence of float, optional
        Multiples of the true Q that the filter is told; 1e-8 to 1e8 if not given. With `raw`, the diagonal of
        Q itself in SI units, as paper 000 sets it; 1e-20 to 100.
    raw : bool
        See `scales`.
    grade : ImuGrade, optional
        Sensors; those of navigation grade if not given.
    initial_deg : sequence of float
        1 sigma of the angles beforehand, degrees about east, north, up.

    Returns
    -------
    pandas.DataFrame
        One row per duration and scale: ``duration_s, scale``; for each of ``pitch, roll, yaw`` (of a
        level system that heads north: phi about east, north and up) ``_initial_deg``, ``_actual_deg``,
        ``_believed_deg``; ``_best_deg``, actual with the true Q; and ``_least_deg``, believed with
        Q = 0.

    Raises
    ------
    InvalidInput
        If a duration or scale is not positive.
    """
    if scales is None:
        scales = np.logspace(-20, 2, 45) if raw else np.logspace(-8, 8, 33)
    values = np.asarray(scales, dtype=float)
    if values.ndim != 1 or not (np.isfinite(values) & (values > 0.0)).all():
        raise InvalidInput("scales", scales, "give positive numbers")
    sensors = grade or ImuGrade.navigation()
    site = StaticSite.published()
    sigma = np.concatenate(
        [
            [VELOCITY_SIGMA] * 2,
            np.radians(np.asarray(initial_deg, dtype=float)),
            [sensors.accelerometer_bias] * 2,
            [sensors.gyro_bias] * 3,
        ]
    )
    frames = []
    for duration in durations:
        if not np.isfinite(duration) or not duration >= STEP:
            raise InvalidInput("durations", duration, f"give {STEP:g} s or more")
        steps = min(MOST_STEPS, round(duration / STEP))
        model = AlignmentModel.of(site, duration / steps)
        true = model.process_covariance(sensors.accelerometer_noise, sensors.gyro_noise)
        common: dict[str, Any] = {
            "P0": np.diag(sigma**2), "Q": true,
            "R": np.eye(2) * VELOCITY_SIGMA**2 * STEP / model.step, "steps": steps,
        }  # fmt: skip
        matrices = (model.transition, model.noise_input, model.measurement)
        told = values[:, None, None] * (np.eye(5) if raw else true)
        tuned = analyse_filter(*matrices, assumed_Q=told, **common)
        best = analyse_filter(*matrices, **common)
        least = analyse_filter(*matrices, assumed_Q=np.zeros((1, 5, 5)), **common)
        frames.append(_rows(duration, values, initial_deg, tuned, best, least))
    return pd.concat(frames, ignore_index=True)


def _rows(
    duration: float,
    scales: np.ndarray,
    initial_deg: Sequence[float],
    tuned: FilterCovariances,
    best: FilterCovariances,
    least: FilterCovariances,
) -> pd.DataFrame:
    columns = {"duration_s": np.full(len(scales), float(duration)), "scale": scales}
    for k, name in enumerate(ANGLES):
        at = (-1, slice(None), 2 + k, 2 + k)
        columns[f"{name}_initial_deg"] = np.full(len(scales), float(initial_deg[k]))
        columns[f"{name}_actual_deg"] = np.degrees(np.sqrt(tuned.actual[at]))
        columns[f"{name}_believed_deg"] = np.degrees(np.sqrt(tuned.believed[at]))
        columns[f"{name}_best_deg"] = np.degrees(np.sqrt(np.repeat(best.actual[at], len(scales))))
        columns[f"{name}_least_deg"] = np.degrees(np.sqrt(np.repeat(least.believed[at], len(scales))))
    return pd.DataFrame(columns)


@styled
def alignment_picture(table: pd.DataFrame | None = None, raw: pd.DataFrame | None = None) -> Figure:
    """Draw the 1 sigma of the yaw against Q for several durations, and all angles against the raw Q.

    Parameters
    ----------
    table, raw : pandas.DataFrame, optional
        From `alignment_knowledge`, without and with ``raw=True`` (of one duration), if at hand.

    Returns
    -------
    matplotlib.figure.Figure
    """
    table = alignment_knowledge() if table is None else table
    raw = alignment_knowledge((5.0,), raw=True) if raw is None else raw
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, (duration, part) in enumerate(table.groupby("duration_s")):
        label = f"{duration:g} s" if duration < 120.0 else f"{duration / 60.0:g} min"
        colour = COLOURS[k % len(COLOURS)]
        left.plot(part["scale"], part["yaw_actual_deg"], color=colour, label=label, linewidth=1.8)
        left.plot(part["scale"], part["yaw_believed_deg"], color=colour, linewidth=1.0, linestyle=LINES[1])
    left.axhline(float(table["yaw_initial_deg"].iloc[0]), color="#333333", linewidth=1.0, linestyle=LINES[3])
    left.set_title("Yaw, Q a multiple of the true one", fontsize=10)
    left.set_xlabel("Q told to the filter / true Q")
    left.legend(loc="upper left", title="duration", fontsize=8.5)
    for k, name in enumerate(ANGLES):
        right.plot(raw["scale"], raw[f"{name}_actual_deg"], color=COLOURS[k], label=name, linewidth=1.8)
        believed = raw[f"{name}_believed_deg"]
        right.plot(raw["scale"], believed, color=COLOURS[k], linewidth=1.0, linestyle=LINES[1])
    right.set_title(f"{raw['duration_s'].iloc[0]:g} s, Q = S I in SI units", fontsize=10)
    right.set_xlabel("S")
    right.legend(loc="upper left", fontsize=8.5)
    for axes, limits in ((left, (0.03, 5.0)), (right, (0.003, 20.0))):
        _scales(axes, limits)
    left.set_ylabel("1σ (°): actual solid, believed dashed")
    return figure


def _scales(axes: Axes, limits: tuple[float, float]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(*limits)
    plain_ticks(axes.yaxis, *limits)
