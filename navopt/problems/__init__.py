"""Estimation problems: what the papers ask, each with its simulated worlds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.problems.analytic import Point as Point
    from navopt.problems.analytic import Sphere as Sphere
    from navopt.problems.gravity_matching import GravityMatching as GravityMatching
    from navopt.problems.gravity_matching import MatchedTrack as MatchedTrack

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "GravityMatching": "navopt.problems.gravity_matching",
        "MatchedTrack": "navopt.problems.gravity_matching",
        "Point": "navopt.problems.analytic",
        "Sphere": "navopt.problems.analytic",
    },
)
