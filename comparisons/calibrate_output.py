"""Files of a calibration: parameters, poses, report and pictures, all or none of them."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from comparisons.calibrate_report import calibration_report, decimals
from comparisons.result_folder import checksums_of, write_files
from comparisons.run_key import versions
from navopt.models.triad import PARAMETER_NAMES

if TYPE_CHECKING:
    from comparisons.calibrate import Calibration
    from navopt.models.triad_fit import PoseFit

__all__ = [
    "FILES",
    "calibration_summary",
    "pose_csv",
    "summary_lines",
    "write_calibration",
]

#: What is written, and what each file is.
FILES = {
    "calibration.json": "parameters with their sigmas, settings, versions and checksums",
    "poses.csv": "means, standard errors and residuals of the static poses",
    "report.html": "all of it to read, with the pictures",
    "poses.png": "poses on the sphere",
    "residuals.png": "residuals before and after",
    "static.png": "the detector's decision over time",
}
#: Version of the layout of ``calibration.json``.
FORMAT = 1


def write_calibration(
    calibration: Calibration, folder: str | Path, *, inputs: Mapping[str, Path] | None = None
) -> list[Path]:
    """Write all files of a calibration; if one cannot be made, none is left behind.

    Parameters
    ----------
    calibration : Calibration
        The result.
    folder : path-like
        Where to; made if need be. Files of an earlier calibration in it are replaced, others not touched.
    inputs : mapping of str to pathlib.Path, optional
        The files that were read, for their checksums.

    Returns
    -------
    list of pathlib.Path
        The files, in the order of `FILES`.

    Raises
    ------
    InvalidInput
        If the folder cannot be made or written.
    """
    from comparisons.calibrate_figures import pose_picture, residual_picture, static_picture
    from comparisons.drawing import render

    pictures = {
        "poses.png": render(pose_picture(calibration), format="png"),
        "residuals.png": render(residual_picture(calibration), format="png"),
        "static.png": render(static_picture(calibration), format="png"),
    }
    summary = calibration_summary(calibration, inputs=inputs)
    contents = {
        "calibration.json": (json.dumps(summary, indent=1, allow_nan=False) + "\n").encode(),
        "poses.csv": pose_csv(calibration).encode(),
        "report.html": calibration_report(calibration, pictures, summary_lines(calibration)).encode(),
        **pictures,
    }
    return write_files(folder, {name: contents[name] for name in FILES})


def calibration_summary(
    calibration: Calibration, *, inputs: Mapping[str, Path] | None = None
) -> dict[str, Any]:
    """Return parameters, settings, versions and checksums of a calibration, ready for JSON.

    Parameters
    ----------
    calibration : Calibration
        The result.
    inputs : mapping of str to pathlib.Path, optional
        The files that were read.

    Returns
    -------
    dict
        SI units; ``matrix`` and ``offset`` of each triad give calibrated values as
        ``matrix @ (sample - zero - offset)``.
    """
    recording, poses, rest = calibration.recording, calibration.poses, calibration.gyro_bias
    return {
        "format": FORMAT,
        "accelerometer": _triad(
            calibration.accelerometer, recording.accelerometer_unit, recording.accelerometer_zero
        ),
        "gyro": None
        if calibration.gyro is None
        else _triad(calibration.gyro, recording.gyro_unit, recording.gyro_zero),
        "gyro_at_rest": {
            "offset": _list(rest.offset),
            "offset_sigma": _list(np.sqrt(np.diag(rest.covariance))),
            "per_m_s2": _list(rest.force_sensitivity),
            "per_m_s2_sigma": _list(rest.force_sensitivity_sigma),
            "probability_of_force_dependence_by_chance": _number(rest.probability),
            "scatter": _list(rest.scatter),
        },
        "detector": {
            "poses_used": len(calibration.averages),
            "poses": len(poses),
            "poses_at_half_threshold": poses.half_threshold,
            "poses_at_twice_the_threshold": poses.double_threshold,
            "threshold": float(poses.threshold),
            "initial_static_s": float(recording.time[poses.initial_stop - 1] - recording.time[0]),
        },
        "declared": {
            "gravity_m_s2": calibration.gravity,
            "latitude_deg": None if calibration.latitude is None else math.degrees(calibration.latitude),
            **calibration.settings,
        },
        "recording": {
            "name": recording.source,
            "samples": len(recording),
            "duration_s": recording.duration,
            "interval_s": recording.interval,
        },
        "files": checksums_of(inputs),
        "notes": list(calibration.notes),
        "versions": versions(),
    }


def _triad(fit: PoseFit, unit: str, zero: float) -> dict[str, Any]:
    sandwich = dict(zip(fit.names, fit.sandwich.tolist(), strict=True))
    parameters = {
        name: {
            "value": fit.values[name],
            "sigma": _number(fit.sigma[name]) if name in fit.sigma else None,
            "sigma_from_residuals": sandwich.get(name),
            "estimated": name in fit.names,
        }
        for name in PARAMETER_NAMES
    }
    return {
        "sample_unit": unit,
        "zero": zero,
        "method": fit.method,
        "parameters": parameters,
        "matrix": _list(np.linalg.inv(fit.triad.matrix)),
        "offset": _list(fit.triad.scale * fit.triad.bias),
        "estimated": list(fit.names),
        "covariance": _list(fit.covariance),
        "residual_unit": fit.unit,
        "residual_rms_before": _rms(fit.before),
        "residual_rms_after": _rms(fit.after),
        "residual_rms_stated": _rms(fit.stated),
        "chi_square": fit.chi_square,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "sigmas_enlarged_by": fit.excess,
    }


def pose_csv(calibration: Calibration) -> str:
    """Return the static poses as CSV, one row each.

    Samples are those of the recording above zero; forces are calibrated, m/s2, the residual is the norm minus
    gravity.
    """
    averages = calibration.averages
    force = calibration.specific_force(averages.accelerometer)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        ["pose", "begin_s", "duration_s"]
        + [
            f"{sensor}_{axis}{end}"
            for sensor in ("gyro", "accelerometer")
            for end in ("", "_sigma")
            for axis in "xyz"
        ]
        + ["force_x_m_s2", "force_y_m_s2", "force_z_m_s2", "residual_m_s2"]
    )
    for k in range(len(averages)):
        row = [
            averages.gyro[k], averages.gyro_sigma[k],
            averages.accelerometer[k], averages.accelerometer_sigma[k],
            force[k], [calibration.accelerometer.after[k]],
        ]  # fmt: skip
        begin = calibration.recording.time[averages.start[k]]
        table.writerow(
            [k + 1, f"{begin:.10g}", f"{averages.duration[k]:.10g}"]
            + [f"{v:.9g}" for v in np.concatenate(row)]
        )
    return text.getvalue()


def summary_lines(calibration: Calibration) -> list[str]:
    """Return the result in a few lines of text."""
    averages, poses, fit = calibration.averages, calibration.poses, calibration.accelerometer
    lines = [
        f"{len(averages)} static poses ({poses.half_threshold} at half the threshold, "
        f"{poses.double_threshold} at twice), {averages.duration.sum():.0f} s in all",
        f"accelerometers: norm minus gravity rms {_rms(fit.before):.4g} m/s2 before, "
        f"{_rms(fit.after):.4g} after ({fit.excess:.2f} times what the noise explains)",
        _scales("accelerometer", fit, calibration.recording.accelerometer_unit),
    ]
    gyro = calibration.gyro
    if gyro is None:
        lines.append("gyros: not calibrated")
    else:
        before, after, unit = _gyro_rms(gyro)
        what = "gravity turned by the gyros" if gyro.unit == "rad" else "rate minus that of the Earth"
        lines.append(
            f"gyros: {what} off by rms {before:.3g} {unit} before, {after:.3g} after "
            f"({gyro.excess:.2f} times what the noise explains)"
        )
        lines.append(_scales("gyro", gyro, calibration.recording.gyro_unit))
    rest = calibration.gyro_bias
    if rest.force_dependent and gyro is not None:
        worst = np.abs(np.linalg.inv(gyro.triad.matrix) @ rest.force_sensitivity).max() * calibration.gravity
        lines.append(
            f"the gyros' bias depends on the specific force: up to {math.degrees(worst):.3g} deg/s per g "
            f"(by chance with probability {rest.probability:.1g})"
        )
    return lines + [f"note: {note}" for note in calibration.notes]


def _scales(sensor: str, fit: PoseFit, unit: str) -> str:
    physical = "m/s2" if sensor == "accelerometer" else "rad/s"
    shown = f" counts per {physical}" if unit == "counts" else ""
    parts = []
    for name in PARAMETER_NAMES[:3]:
        sigma = fit.sigma.get(name)
        places = decimals(sigma) if sigma else 6
        parts.append(f"{fit.values[name]:.{places}f}" + (f" ± {sigma:.{places}f}" if sigma else ""))
    return f"  scale factors {', '.join(parts)}{shown}"


def _gyro_rms(fit: PoseFit) -> tuple[float, float, str]:
    if fit.unit == "rad":
        # both components of an angle
        factor = math.degrees(math.sqrt(2.0))
        return factor * _rms(fit.before), factor * _rms(fit.after), "deg"
    factor = math.degrees(3600.0)
    return factor * _rms(fit.before), factor * _rms(fit.after), "deg/h"


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _list(values: np.ndarray) -> Any:
    return [_list(row) for row in values] if np.ndim(values) > 1 else [_number(v) for v in values]


def _number(value: float) -> float | None:
    """Value for JSON, which knows no NaN."""
    return float(value) if np.isfinite(value) else None
