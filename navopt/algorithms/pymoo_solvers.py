"""pymoo's own algorithms as registered factories with explicit settings.

Each call builds fresh operators: pymoo's default operators are shared between instances.
"""

from __future__ import annotations

from typing import Any

from pymoo.util.display.single import SingleObjectiveOutput

from navopt.algorithms.options import at_least, one_of
from navopt.errors import InvalidInput
from navopt.registry import solver

__all__ = ["de", "pso"]

#: Names of differential evolution that pymoo understands: vector mutated, differences, crossover.
VARIANTS = tuple(
    f"DE/{vector}/{differences}/{crossover}"
    for vector in ("rand", "best", "target-to-best")
    for differences in (1, 2)
    for crossover in ("bin", "exp", "hypercube", "line")
)


@solver(
    "pso",
    summary="particle swarm of pymoo, adaptive weights",
    source="Kennedy and Eberhart 1995; pymoo.algorithms.soo.nonconvex.pso.PSO",
    comparison_based=True,
)
def pso(
    *,
    pop_size: int = 25,
    w: float = 0.9,
    c1: float = 2.0,
    c2: float = 2.0,
    adaptive: bool = True,
    initial_velocity: str = "random",
    max_velocity_rate: float = 0.20,
    pertube_best: bool = True,
) -> Any:
    """Build pymoo's particle swarm; arguments as `pymoo.algorithms.soo.nonconvex.pso.PSO`."""
    from pymoo.algorithms.soo.nonconvex.pso import PSO
    from pymoo.core.repair import NoRepair
    from pymoo.operators.sampling.lhs import LHS

    if not max_velocity_rate > 0:
        raise InvalidInput("max_velocity_rate", max_velocity_rate, "give a positive fraction of the box")
    one_of("initial_velocity", initial_velocity, ("random", "zero"))
    return PSO(
        pop_size=at_least("pop_size", pop_size, 2),
        sampling=LHS(),
        w=w,
        c1=c1,
        c2=c2,
        adaptive=adaptive,
        initial_velocity=initial_velocity,
        max_velocity_rate=max_velocity_rate,
        pertube_best=pertube_best,
        repair=NoRepair(),
        output=SingleObjectiveOutput(),
    )


@solver(
    "de",
    summary="differential evolution of pymoo",
    source="Storn and Price 1997; pymoo.algorithms.soo.nonconvex.de.DE",
    comparison_based=True,
)
def de(
    *,
    pop_size: int = 50,
    variant: str = "DE/rand/1/bin",
    F: float = 0.5,
    CR: float = 0.9,
    prob_mut: float = 0.0,
) -> Any:
    """Build pymoo's differential evolution; arguments as `pymoo.algorithms.soo.nonconvex.de.DE`.

    Unlike pymoo's default, no polynomial mutation follows the crossover (``prob_mut=0.1`` there).
    """
    from pymoo.algorithms.soo.nonconvex.de import DE
    from pymoo.operators.sampling.lhs import LHS

    if not F > 0:
        raise InvalidInput("F", F, "give a positive differential weight")
    for name, value in (("CR", CR), ("prob_mut", prob_mut)):
        if not 0 <= value <= 1:
            raise InvalidInput(name, value, "give a probability")
    one_of("variant", variant, VARIANTS)
    return DE(
        pop_size=at_least("pop_size", pop_size, 4),
        variant=variant,
        CR=CR,
        F=F,
        prob_mut=prob_mut,
        sampling=LHS(),
        output=SingleObjectiveOutput(),
    )
