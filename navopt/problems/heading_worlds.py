"""Simulated worlds of `HeadingAlignment`, and the keywords by which they are asked for."""

from __future__ import annotations

import inspect
from dataclasses import MISSING, fields
from typing import Any

import numpy as np

from navopt.algorithms.options import one_of
from navopt.errors import UnknownName
from navopt.models.heading_alignment import HeadingScenario, simulate_heading_record
from navopt.problems.heading_settings import HeadingTruth

__all__ = ["name_keywords", "simulated_world"]

#: What a twin for scoring has anew: the noise, or everything.
REDRAWS = ("noise", "world")
#: Keywords of the world, with their defaults.
SCENARIO = {f.name: f.default for f in fields(HeadingScenario) if f.default is not MISSING}


def _options(cls: Any) -> dict[str, Any]:
    """Keywords of the problem that a simulated one takes, with their defaults."""
    parameters = inspect.signature(cls).parameters.values()
    return {p.name: p.default for p in parameters if p.kind is p.KEYWORD_ONLY and p.name != "truth"}


def simulated_world(cls: Any, seed: int, scenario: dict[str, Any]) -> Any:
    """Draw one world; see `HeadingAlignment.simulate`."""
    options = _options(cls)
    known = (*SCENARIO, *options, "noise_seed", "redraws")
    for name in scenario:
        if name not in known:
            raise UnknownName("scenario", name, known)
    one_of("redraws", scenario.get("redraws", REDRAWS[0]), REDRAWS)
    world = HeadingScenario(**{k: v for k, v in scenario.items() if k in SCENARIO})
    record = simulate_heading_record(world, seed, scenario.get("noise_seed"))
    truth = HeadingTruth(
        np.ascontiguousarray(record.states[:: record.clock]),  # type: ignore[index]
        accel_scale=world.imu_noise_factor**2,
        gyro_scale=world.imu_noise_factor**2,
        velocity_scale=world.velocity_noise_factor**2,
        heading_scale=world.heading_noise_factor**2,
    )
    made = cls(record, truth=truth, **{k: v for k, v in scenario.items() if k in options})
    again = {k: v for k, v in scenario.items() if k != "noise_seed"}
    object.__setattr__(made, "_world", {"seed": seed, **again})
    return made


def name_keywords(cls: Any) -> None:
    """Name every keyword in the signature of `simulate`, which the registry and the documentation read."""
    kinds = inspect.Parameter
    named = {**SCENARIO, **_options(cls), "noise_seed": None, "redraws": REDRAWS[0]}
    cls.simulate.__func__.__signature__ = inspect.Signature(
        [kinds("cls", kinds.POSITIONAL_OR_KEYWORD), kinds("seed", kinds.POSITIONAL_OR_KEYWORD, default=0)]
        + [kinds(name, kinds.KEYWORD_ONLY, default=default) for name, default in named.items()]
    )
