"""Deterministic solvers behind the same interface as the swarms."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from baselines.nominal import Nominal
    from baselines.tercom import Tercom

_HOMES = {"Nominal": "baselines.nominal", "Tercom": "baselines.tercom"}

__all__ = ["Nominal", "Tercom"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'baselines' has no attribute {name!r}")
