"""Pictures of one calibration: poses on the sphere, residuals before and after, the detector's decision."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

from comparisons.drawing import UNAIDED, WIDTH, Style, styled

if TYPE_CHECKING:
    from comparisons.calibrate import Calibration
    from navopt.models.triad_fit import PoseFit

__all__ = ["pose_picture", "residual_picture", "static_picture"]

CALIBRATED = Style("#0072B2", "s", "-")
AXES = ("#0072B2", "#D55E00", "#009E73")
#: Points of a line over time, at most: a second of a recording is no wider than a dot.
POINTS = 4000


@styled
def pose_picture(calibration: Calibration) -> Figure:
    """Draw the direction of the specific force of every pose on the sphere, in the axes of the unit.

    Parameters
    ----------
    calibration : Calibration
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        Two hemispheres in Lambert's equal-area projection, so that empty parts look as large as they are.
    """
    force = calibration.specific_force(calibration.averages.accelerometer)
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    residual = 1e3 * calibration.accelerometer.after[: len(up)]
    most = max(float(np.abs(residual).max()), 1e-9)
    figure = Figure(figsize=(WIDTH, 4.9), layout="constrained")
    halves = figure.subplots(1, 2)
    for axes, sign, title in zip(halves, (1.0, -1.0), ("z up", "z down"), strict=True):
        _hemisphere(axes, title)
        inside = up[:, 2] * sign >= 0.0
        x, y = _lambert(up[inside], sign)
        points = axes.scatter(
            x, y, c=residual[inside], norm=TwoSlopeNorm(0.0, -most, most), cmap="PuOr", s=46,
            edgecolors="#222222", linewidths=0.8, zorder=5,
        )  # fmt: skip
        _numbers(axes, x, y, np.flatnonzero(inside) + 1)
    figure.colorbar(
        points, ax=list(halves), location="bottom", shrink=0.5, aspect=40, label="norm minus gravity (mm/s²)"
    )
    figure.suptitle(
        f"{len(up)} static poses: which way is up, in the axes of the unit", x=0.01, ha="left", fontsize=11,
        fontweight="bold",
    )  # fmt: skip
    return figure


def _lambert(directions: np.ndarray, sign: float) -> tuple[np.ndarray, np.ndarray]:
    factor = np.sqrt(1.0 / (1.0 + sign * directions[:, 2]))
    return directions[:, 0] * factor, directions[:, 1] * factor


def _hemisphere(axes: Axes, title: str) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for polar in (30.0, 60.0, 90.0):
        radius = np.sqrt(2.0) * np.sin(np.radians(polar) / 2.0)
        axes.plot(
            radius * np.cos(turn), radius * np.sin(turn), color="#444444" if polar == 90.0 else "#cccccc",
            linewidth=1.0, zorder=1,
        )  # fmt: skip
    for angle in range(0, 180, 45):
        x, y = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        axes.plot([-x, x], [-y, y], color="#cccccc", linewidth=0.8, zorder=1)
    for label, x, y in (("+x", 1.09, 0.0), ("−x", -1.09, 0.0), ("+y", 0.0, 1.09), ("−y", 0.0, -1.09)):
        axes.text(x, y, label, ha="center", va="center", fontsize=9)
    axes.set(xlim=(-1.18, 1.18), ylim=(-1.18, 1.18), aspect="equal", title=title)
    axes.set_axis_off()


def _numbers(axes: Axes, x: np.ndarray, y: np.ndarray, numbers: np.ndarray) -> None:
    """Number the points; poses in nearly one place share a label."""
    left = list(range(len(x)))
    while left:
        first = left[0]
        near = [k for k in left if np.hypot(x[k] - x[first], y[k] - y[first]) < 0.13]
        left = [k for k in left if k not in near]
        label = ", ".join(str(numbers[k]) for k in near[:4]) + (" …" if len(near) > 4 else "")
        # towards the middle, where there is room
        side = -1.0 if x[first] > 0.55 else 1.0
        axes.annotate(
            label, (x[first], y[first]), xytext=(6 * side, 5), textcoords="offset points", fontsize=7.5,
            ha="left" if side > 0 else "right", zorder=6,
        )  # fmt: skip


@styled
def residual_picture(calibration: Calibration) -> Figure:
    """Draw the residuals with the nominal parameters beside those with the calibrated ones.

    Parameters
    ----------
    calibration : Calibration
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        Accelerometers above, gyros below where they were calibrated. Bars are one sigma of the noise.
    """
    rows = [("accelerometers: norm minus gravity", calibration.accelerometer)]
    if calibration.gyro is not None:
        rotation = calibration.gyro.unit == "rad"
        what = "vertical turned by the gyros" if rotation else "rate minus that of the Earth"
        rows.append((f"gyros: {what}", calibration.gyro))
    figure = Figure(figsize=(WIDTH, 2.9 * len(rows)), layout="constrained")
    panels = figure.subplots(len(rows), 2, squeeze=False)
    for (left, right), (title, fit) in zip(panels, rows, strict=True):
        before, after, stated, unit = _shown(fit)
        where = np.arange(1, len(after) + 1)
        for axes, values, style, name in (
            (left, before, UNAIDED, "nominal parameters"),
            (right, after, CALIBRATED, "calibrated"),
        ):
            axes.axhline(0.0, color="#888888", linewidth=0.8)
            axes.errorbar(
                where, values, yerr=stated, color=style.colour, marker=style.marker, markersize=3.8,
                linestyle="none", elinewidth=0.9,
            )  # fmt: skip
            rms = float(np.sqrt(np.mean(values**2)))
            shown = f"{rms:.0f}" if rms >= 1e3 else f"{rms:.3g}"
            axes.set_title(f"{name}, rms {shown} {unit}", fontsize=9.5, fontweight="normal")
        left.set_ylabel(f"{title}\n({unit})", fontsize=9)
        label = "rotation" if fit.unit == "rad" else "pose"
        for axes in (left, right):
            axes.set_xlabel(label)
    return figure


def _shown(fit: PoseFit) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Residuals in units for people; angles as the length of their two components."""
    if fit.unit == "m/s2":
        return 1e3 * fit.before, 1e3 * fit.after, 1e3 * fit.stated, "mm/s²"
    if fit.unit == "rad":
        parts = [np.degrees(np.linalg.norm(v.reshape(-1, 2), axis=1)) for v in (fit.before, fit.after)]
        return parts[0], parts[1], np.degrees(fit.stated[::2]), "°"
    hour = np.degrees(1.0) * 3600.0
    return hour * fit.before, hour * fit.after, hour * fit.stated, "°/h"


@styled
def static_picture(calibration: Calibration) -> Figure:
    """Draw the detector's statistic, its threshold and the poses over time.

    Parameters
    ----------
    calibration : Calibration
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        Above the relative variance, below the accelerometers; poses are shaded.
    """
    recording, poses = calibration.recording, calibration.poses
    every = max(len(recording) // POINTS, 1)
    time = recording.time[::every]
    # the largest of each stretch: a short knock must not vanish between two points
    padded = np.full(len(time) * every, np.nan)
    padded[: len(poses.statistic)] = poses.statistic[: len(padded)]
    with np.errstate(invalid="ignore"):
        highest = np.fmax.reduce(padded.reshape(-1, every), axis=1)
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1, 1])
    for axes in (upper, lower):
        for first, end in zip(calibration.averages.start, calibration.averages.stop, strict=True):
            axes.axvspan(
                recording.time[first], recording.time[end - 1], color="#dbe7f1", linewidth=0, zorder=0
            )
    upper.semilogy(time, highest, color="#222222", linewidth=0.8)
    upper.axhline(
        poses.threshold, color=AXES[1], linewidth=1.3, linestyle=(0, (5, 2)),
        label=f"threshold {poses.threshold:.3g} ({poses.half_threshold} poses at half, "
        f"{poses.double_threshold} at twice)",
    )  # fmt: skip
    upper.axvline(
        recording.time[poses.initial_stop - 1], color=AXES[2], linewidth=1.3, linestyle=(0, (1, 1)),
        label="end of the initial static period",
    )  # fmt: skip
    upper.set_ylabel("variance / initial variance")
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2, fontsize=9)
    force = calibration.specific_force(recording.accelerometer[::every])
    for k, colour in enumerate(AXES):
        lower.plot(time, force[:, k], color=colour, linewidth=0.8, label="xyz"[k])
    lower.set_ylabel("specific force (m/s²)")
    lower.set_xlabel("time (s)")
    lower.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2, fontsize=9)
    return figure
