"""Fruit flies with a predicted perturbation (Zhang et al. 2016, Appl. Sci. 6:299; paper 001)."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np

from navopt.algorithms.fruit_fly import FruitFly
from navopt.algorithms.options import number, switch
from navopt.algorithms.swarm import Arrays
from navopt.registry import solver

__all__ = ["PerturbedFruitFly"]


@solver(
    "ifoa-2016",
    summary="fruit fly optimisation that tries a random displacement of the best position when it stagnates",
    source="Zhang et al. 2016, Appl. Sci. 6:299",
    comparison_based=True,
)
class PerturbedFruitFly(FruitFly):
    """Improved fruit fly optimisation of Zhang et al. (2016): predict, then update.

    After a cycle without improvement the axis is displaced at random, and the displacement kept only if
    the loss there is lower (eq. 11): one more evaluation, in a phase of its own. Then the flies fly from
    the axis, as in `FruitFly`.

    Parameters
    ----------
    pop_size, horizon, encoding, coordinates, signed, delta, location_range, flight_range, one_sided, clip, \
step_law, final_step, dimensions, start, minimise
        See `FruitFly`.
    perturbation : float, default 1.0
        Intensity Δw: largest displacement of a coordinate (in the direct encoding in units of half the
        box). It does not follow `step_law`.
    one_sided_perturbation : bool, default False
        Displacements in [0, Δw), as printed, instead of [-Δw, Δw).
    perturbation_test : bool, default True
        False displaces the axis whatever the loss there, as the printed pseudo-code does and the text
        and eq. 11 do not; nothing is evaluated then, and the best loss stays the one to beat.
    accept_equal : bool, default True
        Whether the axis moves to a fly that is as good as the best (the printed ``<=``).
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    Deviations from the printed procedure, which cannot be run as it stands: the axis moves to the best
    fly (printed, it is never moved, and is assigned a fitness at the start); the flag that asks for a
    prediction begins as false; steps are symmetric and not clipped. Printed, steps of ``(UB - LB) rand``
    are one-sided and clipped to [LB, UB], so flies gather at UB; and with ``UB = 3.1`` no S below 0.228
    can be proposed, while Table 5 reports Q = 0.1758. The printed form is ``published(one_sided=True,
    flight_range=6.2, clip=3.1, perturbation_test=False)``.
    """

    phases: ClassVar[tuple[str, ...]] = ("predict", "flies")

    def __init__(
        self,
        *,
        pop_size: int = 20,
        horizon: int = 100,
        encoding: str = "direct",
        coordinates: int | None = None,
        signed: bool = False,
        delta: bool = False,
        location_range: tuple[float, float] = (-1.0, 1.0),
        flight_range: float = 1.0,
        one_sided: bool = False,
        clip: float | None = None,
        step_law: str = "iffo",
        final_step: float = 1e-5,
        dimensions: str = "all",
        start: str = "flies",
        minimise: bool = True,
        perturbation: float = 1.0,
        one_sided_perturbation: bool = False,
        perturbation_test: bool = True,
        accept_equal: bool = True,
        **kwargs: Any,
    ) -> None:
        super().__init__(
            pop_size=pop_size,
            horizon=horizon,
            encoding=encoding,
            coordinates=coordinates,
            signed=signed,
            delta=delta,
            location_range=location_range,
            flight_range=flight_range,
            one_sided=one_sided,
            clip=clip,
            step_law=step_law,
            final_step=final_step,
            dimensions=dimensions,
            start=start,
            minimise=minimise,
            **kwargs,
        )
        self.perturbation = number("perturbation", perturbation, above=0.0)
        self.one_sided_perturbation = switch("one_sided_perturbation", one_sided_perturbation)
        self.perturbation_test = switch("perturbation_test", perturbation_test)
        self.accept_equal = switch("accept_equal", accept_equal)

    @classmethod
    def published(cls, **kwargs: Any) -> Self:
        """Build with the settings of paper 001: LR = [-1, 1], FR = [-3.1, 3.1], Δw = 3.1 one-sided."""
        paper = {"flight_range": 3.1, "start": "flies", "perturbation": 3.1, "one_sided_perturbation": True}
        return cls(**{**cls.paper_settings, **paper, **kwargs})

    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of one cycle: a displacement of the axis, and the flies' steps."""
        signs = {f"predict_{key}": value for key, value in self._draw_signs(rng, 1, d).items()}
        return {"displacement": rng.random((self._planes, d)), **signs, **super().draw(rng, n, d)}

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first flies; no prediction is asked for yet."""
        state = super().found(constants, candidates, losses)
        return {**state, "predict": np.zeros(losses.shape[:-1], dtype=bool)}

    def _displaced(self, state: Arrays, draws: Arrays) -> np.ndarray:
        """Axis after the random displacement, shape (..., c, d)."""
        u = draws["displacement"]
        way = u if self.one_sided_perturbation else 2.0 * u - 1.0
        axis = self._keep(state["axis"] + way * (self.perturbation * self._unit(state)))
        return np.clip(axis, state["lower"], state["upper"]) if self.encoding == "direct" else axis

    def _origin(self, state: Arrays, draws: Arrays) -> np.ndarray:
        if self.perturbation_test:
            return state["axis"]
        return np.where(state["predict"][..., None, None], self._displaced(state, draws), state["axis"])

    def move(self, state: Arrays, draws: Arrays, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Candidates of a phase: the displaced axis alone if a prediction is due, or all flies."""
        if phase == "flies":
            return super().move(state, draws, phase)
        displaced = self._displaced(state, draws)[..., None, :, :]
        candidate = self._decode(displaced, state, draws, prefix="predict_")
        due = state["predict"] & self.perturbation_test
        first = np.arange(state["F"].shape[-1]) == 0
        return np.broadcast_to(candidate, state["X"].shape).copy(), due[..., None] & first

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """Keep a displacement that lowers the loss (eq. 11); after the flies, ask for one if they failed."""
        if phase == "flies":
            after = super().select(state, draws, phase, candidates, losses, mask)
            return {**after, "predict": after["stagnation"] > 0}
        tried = mask[..., 0]
        trial = candidates[..., 0, :]
        offered = {
            "axis": self._positions(self._displaced(state, draws), trial),
            "best_X": trial,
            "best": self._merit(losses)[..., 0],
        }
        better = tried & (offered["best"] < state["best"])
        return {**state, **self._replace(better, offered, state), "predict": state["predict"] & ~tried}

    def _better(self, offered: np.ndarray, best: np.ndarray) -> np.ndarray:
        return np.asarray(offered <= best) if self.accept_equal else super()._better(offered, best)
