"""Deterministic solvers behind the same interface as the swarms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from baselines.base import Baseline as Baseline
    from baselines.nominal import Nominal as Nominal
    from baselines.tercom import Tercom as Tercom

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "Baseline": "baselines.base",
        "Nominal": "baselines.nominal",
        "Tercom": "baselines.tercom",
    },
)
