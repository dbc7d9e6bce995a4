"""The report of a calibration: one HTML page with tables and pictures in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from comparisons.pages import data_source, environment, style
from navopt.models.triad import PARAMETER_NAMES

if TYPE_CHECKING:
    from comparisons.calibrate import Calibration
    from navopt.models.triad_fit import PoseFit

__all__ = ["calibration_report", "decimals", "parameter_rows"]

#: Factors to the units people use, and these units, of biases: accelerometers, gyros.
BIAS_UNITS = {"accelerometer": (1e3, "mm/s²"), "gyro": (math.degrees(1.0), "°/s")}
CAPTIONS = {
    "poses.png": "Where up was in each pose. Large empty parts leave parameters weakly determined.",
    "residuals.png": "Residuals with the nominal and the calibrated parameters: look for trends.",
    "static.png": "What the detector took for static (shaded).",
}


def parameter_rows(fit: PoseFit, sensor: str, unit: str) -> list[tuple[str, str, str, str]]:
    """Return name, value, sigma and sigma from the residuals of every parameter, as text with units.

    Parameters
    ----------
    fit : PoseFit
        The result.
    sensor : str
        ``"accelerometer"`` or ``"gyro"``.
    unit : str
        Unit of the samples.

    Returns
    -------
    list of tuple of str
        An empty sigma means that the parameter was not estimated.
    """
    physical = "m/s²" if sensor == "accelerometer" else "rad/s"
    factor, shown = BIAS_UNITS[sensor]
    sandwich = dict(zip(fit.names, fit.sandwich.tolist(), strict=True))
    rows = []
    for name in PARAMETER_NAMES:
        kind = name.split("_")[0]
        scale, label = {
            "scale": (1.0, f"counts per {physical}" if unit == "counts" else ""),
            "bias": (factor, shown),
            "misalignment": (1e3, "mrad"),
        }[kind]
        sigma = fit.sigma.get(name)
        if sigma is None:
            rows.append(
                (f"{name} ({label})" if label else name, f"{scale * fit.values[name]:.6g}", "fixed", "")
            )
            continue
        places = decimals(scale * sigma)
        rows.append(
            (
                f"{name} ({label})" if label else name,
                f"{scale * fit.values[name]:.{places}f}",
                f"{scale * sigma:.{places}f}",
                f"{scale * sandwich[name]:.{places}f}",
            )
        )
    return rows


def decimals(sigma: float) -> int:
    """Return the decimals that show two digits of a sigma."""
    if not (math.isfinite(sigma) and sigma > 0):
        return 6
    return max(1 - math.floor(math.log10(sigma)), 0)


def calibration_report(calibration: Calibration, pictures: Mapping[str, bytes], lines: list[str]) -> str:
    """Return a page to read, with the pictures in it.

    Parameters
    ----------
    calibration : Calibration
        The result.
    pictures : mapping of str to bytes
        PNG files by name.
    lines : list of str
        The result in a few lines.

    Returns
    -------
    str
        HTML that needs no other file.
    """
    recording = calibration.recording
    sensors = []
    for name, fit, unit, zero in (
        (
            "accelerometer",
            calibration.accelerometer,
            recording.accelerometer_unit,
            recording.accelerometer_zero,
        ),
        ("gyro", calibration.gyro, recording.gyro_unit, recording.gyro_zero),
    ):
        if fit is not None:
            offset = f", sample above {zero:g}" if zero else ""
            rows = parameter_rows(fit, name, unit)
            sensors.append({"name": name, "method": fit.method, "offset": offset, "rows": rows})
    templates = environment()
    return templates.get_template("calibration.html.j2").render(
        title=f"Calibration of {recording.source or 'a recording'}",
        style=style(templates),
        summary="\n".join(line for line in lines if not line.startswith("note: ")),
        notes=calibration.notes,
        sensors=sensors,
        pictures=[
            {"source": data_source(pictures[name], "png"), "caption": caption}
            for name, caption in CAPTIONS.items()
        ],
    )
