"""Settings of paper 004 for the phases of a gyro calibration, from its Table 1 to SI units."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.algorithms.novel_fish_swarm import PUBLISHED_VISUAL
from navopt.algorithms.options import one_of

__all__ = ["published_phases", "published_visual"]

#: Longest step over field of vision; not printed in paper 004.
STEP = 0.5


def published_visual() -> dict[str, list[float]]:
    """Fields of vision of Table 1 in SI units, by the problem's groups.

    Returns
    -------
    dict of str to list of float
        ``scale`` (counts per rad/s), ``bias`` (rad/s), ``misalignment`` (rad): one number for each parameter
        of the group, in the order of `navopt.models.triad.PARAMETER_NAMES`, which is that of the paper.
    """
    degree_per_hour = np.pi / 180.0 / 3600.0
    printed = PUBLISHED_VISUAL
    return {
        "scale": [float(v) / degree_per_hour for v in printed["scale_factors_bit_h_per_deg"]],
        "bias": [float(v) * degree_per_hour for v in printed["biases_deg_per_h"]],
        "misalignment": [float(v) for v in printed["misalignments_1"]],
    }


def published_phases(inner: str = "nafsa") -> dict[str, Any]:
    """Keywords of `navopt.algorithms.Phased` for the procedure of paper 004, section 3.3.

    Parameters
    ----------
    inner : {"nafsa", "oafsa", "afsa"}
        Which fish swarm.

    Returns
    -------
    dict
        100 runs per phase of 50 fish and 60 cycles, around the presets, one repetition, the means passed on
        and reported, stopped below 1e-8 (°/h)². A problem that estimates all twelve parameters is meant.

    Notes
    -----
    Table 1 belongs to NAFSA. For the other two, whose fields of vision the paper does not print, the same is
    taken, half of it as the longest step, and ten attempts; OAFSA decays to the letter of eqs. (1)-(2).
    """
    one_of("inner", inner, ("nafsa", "oafsa", "afsa"))
    visual = published_visual()
    options: dict[str, Any] = {"pop_size": 50, "initial": "nominal", "units": "problem"}
    if inner == "nafsa":
        options |= {"contraction": (1e-6, 0.999999)}
        own: dict[str, dict[str, Any]] = {label: {"visual": v} for label, v in visual.items()}
    else:
        options |= {"try_number": 10, **({"horizon": 60, "recursive": True} if inner == "oafsa" else {})}
        own = {label: {"visual": v, "step": [STEP * one for one in v]} for label, v in visual.items()}
    return {
        "runs_per_phase": 100,
        "cycles": 60,
        "repetitions": 1,
        "chain": "means",
        "answer": "mean",
        "threshold": 1e-8,
        "options": options,
        "group_options": own,
    }
