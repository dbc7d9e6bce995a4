"""Swarm algorithms and the anchors they are compared with, all pymoo algorithms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.algorithms.affine_bee_colony import AffineBeeColony as AffineBeeColony
    from navopt.algorithms.bee_colony import BeeColony as BeeColony
    from navopt.algorithms.cmaes import CMAES as CMAES
    from navopt.algorithms.nelder_mead import NelderMead as NelderMead
    from navopt.algorithms.pymoo_solvers import de as de
    from navopt.algorithms.pymoo_solvers import pso as pso
    from navopt.algorithms.random_search import RandomSearch as RandomSearch
    from navopt.algorithms.swarm import ContractedAlgorithm as ContractedAlgorithm
    from navopt.algorithms.swarm import SwarmAlgorithm as SwarmAlgorithm

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "AffineBeeColony": "navopt.algorithms.affine_bee_colony",
        "BeeColony": "navopt.algorithms.bee_colony",
        "CMAES": "navopt.algorithms.cmaes",
        "ContractedAlgorithm": "navopt.algorithms.swarm",
        "NelderMead": "navopt.algorithms.nelder_mead",
        "RandomSearch": "navopt.algorithms.random_search",
        "SwarmAlgorithm": "navopt.algorithms.swarm",
        "de": "navopt.algorithms.pymoo_solvers",
        "pso": "navopt.algorithms.pymoo_solvers",
    },
)
