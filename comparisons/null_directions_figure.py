"""Picture of what the norm of the Earth rate can see of a gyro triad, and of what it cannot."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from comparisons.drawing import COLOURS, WIDTH, styled
from navopt.models.triad import GyroTriad, SensorTriad, residual_error

__all__ = ["norm_change", "null_directions_figure"]

Array = NDArray[np.float64]

#: What is shown: title, and the parameters that change with their weights.
CHANGES: dict[str, dict[str, float]] = {
    "scale factor": {"scale_x": 1.0},
    "bias": {"bias_x": 1.0},
    "sum of two\nmisalignments": {"misalignment_xy": 1.0, "misalignment_yx": 1.0},
    "difference of two\nmisalignments": {"misalignment_xy": 1.0, "misalignment_yx": -1.0},
}
#: How far the upper row exaggerates: a misalignment is a thousandth, not a quarter.
SHOWN = 0.25


def norm_change(change: dict[str, float], directions: Array, size: float = 1e-6) -> Array:
    """Return by how much a wrong parameter changes the norm of a rate, for rates of unit norm.

    Parameters
    ----------
    change : dict of str to float
        Names of `navopt.models.triad.PARAMETER_NAMES` with weights: what the calibration has too small, in
        units of the scale factor, of the rate, and of a radian.
    directions : array_like, shape (..., 3)
        Directions of the rate in body axes, unit vectors.
    size : float
        How much.

    Returns
    -------
    ndarray, shape (...)
        Change of the norm over `size`.
    """
    true, wrong = _triads(change, size)
    measured = np.asarray(directions) + residual_error(wrong, true, directions)
    return np.asarray((np.linalg.norm(measured, axis=-1) - 1.0) / size)


def _triads(change: dict[str, float], size: float) -> tuple[SensorTriad, SensorTriad]:
    """Sensors with a changed parameter, and the perfect ones they are taken for."""
    perfect = GyroTriad(np.ones(3), np.eye(3), np.zeros(3))
    moved = {
        name: (1.0 if name.startswith("scale") else 0.0) + weight * size for name, weight in change.items()
    }
    return perfect.replace(**moved), perfect


@styled
def null_directions_figure(worlds: dict[str, Any]) -> Figure:
    """Draw what changes of a triad do to norms, and how many combinations data can tell.

    Above, a circle of rates in the x-y plane (grey) and what a calibration that ignores the change makes of
    it, exaggerated. In the middle, the change of the norm over all directions of the rate. Below, the
    accuracy with which the combinations of parameters can be told.

    Parameters
    ----------
    worlds : dict of str to EstimationProblem
        Problems with residuals, by label, whose singular values stand in the lowest row.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = Figure(figsize=(WIDTH, 6.6), layout="constrained")
    grid = figure.add_gridspec(3, len(CHANGES), height_ratios=[1.0, 0.62, 1.2])
    longitude, latitude = np.meshgrid(np.linspace(-np.pi, np.pi, 121), np.linspace(-np.pi / 2, np.pi / 2, 61))
    directions = np.stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)],
        axis=-1,
    )
    shades: Any = None
    for column, (title, change) in enumerate(CHANGES.items()):
        panel = figure.add_subplot(grid[0, column])
        _circle(panel, change)
        panel.set_title(title, fontsize=9.5)
        sky = figure.add_subplot(grid[1, column], projection="mollweide")
        shades = sky.pcolormesh(
            longitude, latitude, norm_change(change, directions), cmap="RdBu_r", vmin=-1.0, vmax=1.0,
            shading="gouraud", rasterized=True,
        )  # fmt: skip
        sky.set_xticks([])
        sky.set_yticks([])
        sky.grid(False)
    bar = figure.colorbar(shades, ax=figure.axes[1::2], location="right", shrink=0.9, aspect=14)
    bar.set_label("change of the norm", fontsize=8.5)
    _accuracies(figure.add_subplot(grid[2, :]), worlds)
    return figure


def _circle(panel: Axes, change: dict[str, float]) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    true, wrong = _triads(change, SHOWN)
    shown = circle + residual_error(wrong, true, circle)
    if change.get("misalignment_xy", 0.0) == -change.get("misalignment_yx", 1.0):
        # exactly a rotation, of which the exaggerated triad is the first order
        shown /= np.linalg.norm(shown, axis=1, keepdims=True)
    panel.plot(circle[:, 0], circle[:, 1], color="#999999", linewidth=1.0)
    panel.plot(shown[:, 0], shown[:, 1], color=COLOURS[0], linewidth=1.6)
    for k in (0, 45):
        panel.plot([0.0, circle[k, 0]], [0.0, circle[k, 1]], color="#999999", linewidth=1.0)
        panel.plot([0.0, shown[k, 0]], [0.0, shown[k, 1]], color=COLOURS[0], linewidth=1.3)
    panel.set_aspect("equal")
    panel.set_xlim(-1.45, 1.45)
    panel.set_ylim(-1.45, 1.45)
    panel.set_axis_off()


def _accuracies(panel: Axes, worlds: dict[str, Any]) -> None:
    """Singular values; those that are rounding are drawn on the lowest line."""
    lowest = 1e-4
    for k, (label, world) in enumerate(worlds.items()):
        found = world.identifiability()
        values = np.maximum(found.singular_values, lowest)
        place = np.arange(1, len(values) + 1)
        told = place <= found.rank
        style: dict[str, Any] = {"color": COLOURS[k], "markersize": 5, "linestyle": "none", "marker": "o"}
        panel.plot(place[told], values[told], label=f"{label}: {found.rank} of {found.n_parameters}", **style)
        panel.plot(place[~told], values[~told], mfc="none", clip_on=False, **style)
    panel.axhline(1.0, color="#444444", linewidth=0.8, linestyle=(0, (4, 3)))
    panel.set_yscale("log")
    panel.set_ylim(lowest, None)
    panel.set_xlabel("combination of parameters, best first")
    panel.set_ylabel("half width of the box\nover attainable sigma")
    panel.legend(fontsize=8, loc="lower right")
