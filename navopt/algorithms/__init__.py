"""Swarm algorithms and the anchors they are compared with, all pymoo algorithms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from navopt.algorithms.affine_bee_colony import AffineBeeColony as AffineBeeColony
    from navopt.algorithms.bee_colony import BeeColony as BeeColony
    from navopt.algorithms.cmaes import CMAES as CMAES
    from navopt.algorithms.fish_swarm import FishSwarm as FishSwarm
    from navopt.algorithms.fruit_fly import FruitFly as FruitFly
    from navopt.algorithms.fruit_fly import FruitFly3D as FruitFly3D
    from navopt.algorithms.fruit_fly import GaussianFruitFly as GaussianFruitFly
    from navopt.algorithms.genetic_algorithm import GeneticAlgorithm as GeneticAlgorithm
    from navopt.algorithms.guided_bee_colony import GuidedBeeColony as GuidedBeeColony
    from navopt.algorithms.improved_bee_colony import ImprovedBeeColony as ImprovedBeeColony
    from navopt.algorithms.improved_bee_colony import SinglePointBeeColony as SinglePointBeeColony
    from navopt.algorithms.nelder_mead import NelderMead as NelderMead
    from navopt.algorithms.novel_fish_swarm import NovelFishSwarm as NovelFishSwarm
    from navopt.algorithms.optimal_fish_swarm import OptimalFishSwarm as OptimalFishSwarm
    from navopt.algorithms.paper_presets import GeneticAlgorithm001 as GeneticAlgorithm001
    from navopt.algorithms.paper_presets import ParticleSwarm000 as ParticleSwarm000
    from navopt.algorithms.paper_presets import ParticleSwarm001 as ParticleSwarm001
    from navopt.algorithms.particle_swarm import ParticleSwarm as ParticleSwarm
    from navopt.algorithms.perturbed_fruit_fly import PerturbedFruitFly as PerturbedFruitFly
    from navopt.algorithms.phased import Phased as Phased
    from navopt.algorithms.phased_fit import PhasedFit as PhasedFit
    from navopt.algorithms.pymoo_solvers import de as de
    from navopt.algorithms.pymoo_solvers import pso as pso
    from navopt.algorithms.random_search import RandomSearch as RandomSearch
    from navopt.algorithms.student_fruit_fly import StudentFruitFly as StudentFruitFly
    from navopt.algorithms.swarm import ContractedAlgorithm as ContractedAlgorithm
    from navopt.algorithms.swarm import SwarmAlgorithm as SwarmAlgorithm

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "AffineBeeColony": "navopt.algorithms.affine_bee_colony",
        "BeeColony": "navopt.algorithms.bee_colony",
        "CMAES": "navopt.algorithms.cmaes",
        "ContractedAlgorithm": "navopt.algorithms.swarm",
        "FishSwarm": "navopt.algorithms.fish_swarm",
        "FruitFly": "navopt.algorithms.fruit_fly",
        "FruitFly3D": "navopt.algorithms.fruit_fly",
        "GaussianFruitFly": "navopt.algorithms.fruit_fly",
        "GeneticAlgorithm": "navopt.algorithms.genetic_algorithm",
        "GeneticAlgorithm001": "navopt.algorithms.paper_presets",
        "GuidedBeeColony": "navopt.algorithms.guided_bee_colony",
        "ImprovedBeeColony": "navopt.algorithms.improved_bee_colony",
        "NelderMead": "navopt.algorithms.nelder_mead",
        "NovelFishSwarm": "navopt.algorithms.novel_fish_swarm",
        "OptimalFishSwarm": "navopt.algorithms.optimal_fish_swarm",
        "ParticleSwarm": "navopt.algorithms.particle_swarm",
        "ParticleSwarm000": "navopt.algorithms.paper_presets",
        "ParticleSwarm001": "navopt.algorithms.paper_presets",
        "PerturbedFruitFly": "navopt.algorithms.perturbed_fruit_fly",
        "Phased": "navopt.algorithms.phased",
        "PhasedFit": "navopt.algorithms.phased_fit",
        "RandomSearch": "navopt.algorithms.random_search",
        "SinglePointBeeColony": "navopt.algorithms.improved_bee_colony",
        "StudentFruitFly": "navopt.algorithms.student_fruit_fly",
        "SwarmAlgorithm": "navopt.algorithms.swarm",
        "de": "navopt.algorithms.pymoo_solvers",
        "pso": "navopt.algorithms.pymoo_solvers",
    },
)
