"""Fruit fly optimisation: Pan 2012, with Gaussian steps (Xu 2016) and in three dimensions (Lin 2016)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Self

import numpy as np
from pymoo.core.population import Population

from navopt.algorithms.fruit_fly_encoding import ENCODINGS, FAR, decode
from navopt.algorithms.fruit_fly_steps import STEP_LAWS, one_variable, step_size, uniform_draws
from navopt.algorithms.options import at_least, number, one_of, region, switch
from navopt.algorithms.swarm import Arrays, SwarmAlgorithm
from navopt.errors import InvalidInput
from navopt.registry import solver

__all__ = ["FruitFly", "FruitFly3D", "GaussianFruitFly"]


@solver(
    "foa",
    summary="fruit fly optimisation: a swarm of random steps from the best position known",
    source="Pan 2012, Knowl.-Based Syst. 26:69",
    comparison_based=True,
)
class FruitFly(SwarmAlgorithm):
    """Fruit fly optimisation, and the base of its family.

    Every cycle each fly flies a random step from the *axis*, the position of the best fly so far, and
    the axis moves to the best of them if that one is better (Pan 2012; Wan et al. 2020, eqs. 7-11;
    Zhang et al. 2016, steps 1.1-1.6).

    As published, a fly has two coordinates per variable and its candidate is the reciprocal of its
    distance from the origin, ``S = 1/√(X² + Y²)``. That rewards optima at zero and cannot reach
    negative ones, so here the position itself is the candidate (``encoding="direct"``) unless asked
    otherwise; `published` asks otherwise.

    Parameters
    ----------
    pop_size : int, default 20
        Number of flies, the papers' ``sizepop``.
    horizon : int, default 100
        Cycles over which schedules run (the papers' ``maxgen``); beyond it they hold. It does not stop
        the run.
    encoding : {"direct", "reciprocal", "box"}
        ``"direct"``: the position itself, one coordinate per variable, steps in units of half the box.
        ``"reciprocal"``: S in the units of the problem, as published; where S is outside the box the
        candidate is the nearest bound, while the fly keeps its position. ``"box"``: ``S/(1 + S)`` mapped
        onto the box. It takes any box, but a fly that walks away from the origin of its plane still
        walks to the lower corner.
    coordinates : int, optional
        Coordinates per variable behind the distance: 2, and 3 in `FruitFly3D`, if not given. The direct
        encoding has one.
    signed : bool, default False
        Give every S a random sign (Pan 2013, Connect. Sci. 25:151). Not with the direct encoding, nor
        is `delta`; with either, ``"box"`` maps S = 0 to the middle of the box.
    delta : bool, default False
        Add ``Dist (0.5 - U(0, 1))`` to every S, as re-implementations of the 3-D algorithm do to reach
        negative values.
    location_range : (float, float), default (-1, 1)
        Where flies begin, the papers' LR; the direct encoding begins in the whole box.
    flight_range : float, default 1.0
        Largest step FR in each coordinate (standard deviation of Gaussian steps); in the direct encoding
        in units of half the box.
    one_sided : bool, default False
        Steps in [0, FR) instead of [-FR, FR), which is what the papers' pseudo-code ``rand(1, d)`` says
        and their text ("random direction") does not.
    clip : float, optional
        Keep coordinates within ± this. Zhang et al. clip to their location range; the direct encoding
        always keeps to the box.
    step_law : {"iffo", "lgms", "constant"}
        How the size of steps falls: to `final_step` at the horizon as in IFFO (Pan et al. 2014,
        Knowl.-Based Syst. 62:69), by 5 % per cycle as in LGMS-FOA (Shan et al. 2013, Math. Probl. Eng.
        108768), or not at all, as published.
    final_step : float, default 1e-5
        Size of the last step relative to the first under ``"iffo"``, whose authors took λmin = 1e-5 in
        the units of the problem.
    dimensions : {"all", "one"}
        How many variables a fly changes: all, as published, or one at random, as IFFO does. One is the
        better choice where variables act separately, and only there.
    start : {"flies", "axis"}
        First positions: every fly uniform in its range (Zhang et al.'s pseudo-code), or one uniform axis
        and a step from it (Pan; Wan et al., eq. 7).
    minimise : bool, default True
        False moves the axis to the *largest* loss, the reading of Zhang et al.'s step 1.4, whose fitness
        is an error to be minimised. The answer of a run is the smallest loss all the same.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    The initial flies and every cycle cost `pop_size` evaluations each. Coordinates are kept within
    ±1e150 and distances above 1e-300, so that S is always finite. In `state`, ``flies`` (n, c, d) and
    ``axis`` (c, d) are positions, ``best`` the loss at the axis (its negative if not minimising) and
    ``best_X`` the candidate it belongs to. `found` needs the arrays of `place`, unless the encoding is
    direct: a distance does not tell a position.
    """

    phases: ClassVar[tuple[str, ...]] = ("flies",)
    #: Coordinates per variable where a distance is taken.
    plane: ClassVar[int] = 2
    #: What the family's papers share: 100 generations of 20 flies in a plane, S = 1/Dist, constant steps.
    paper_settings: ClassVar[Mapping[str, Any]] = MappingProxyType(
        {
            "pop_size": 20,
            "horizon": 100,
            "encoding": "reciprocal",
            "location_range": (-1.0, 1.0),
            "flight_range": 1.0,
            "step_law": "constant",
            "dimensions": "all",
            "start": "axis",
        }
    )

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
        **kwargs: Any,
    ) -> None:
        super().__init__(pop_size=pop_size, **kwargs)
        self.horizon = at_least("horizon", horizon, 1)
        self.encoding = one_of("encoding", encoding, ENCODINGS)
        self.coordinates = None if coordinates is None else at_least("coordinates", coordinates, 1)
        self.signed = switch("signed", signed)
        self.delta = switch("delta", delta)
        self.location_range = region("location_range", location_range)
        self.flight_range = number("flight_range", flight_range, above=0.0)
        self.one_sided = switch("one_sided", one_sided)
        self.clip = None if clip is None else number("clip", clip, above=0.0)
        self.step_law = one_of("step_law", step_law, STEP_LAWS)
        self.final_step = number("final_step", final_step, above=0.0, most=1.0)
        self.dimensions = one_of("dimensions", dimensions, ("one", "all"))
        self.start = one_of("start", start, ("flies", "axis"))
        self.minimise = switch("minimise", minimise)
        if encoding == "direct":
            unusable = {"coordinates": coordinates, "clip": clip, "signed": signed, "delta": delta}
            for argument, value in unusable.items():
                if value not in (None, False):
                    remedy = 'give encoding="reciprocal" or "box": the direct encoding takes no distance'
                    raise InvalidInput(argument, value, remedy)

    @classmethod
    def published(cls, **kwargs: Any) -> Self:
        """Build Pan's algorithm with the settings of paper 000: 20 flies, LR = FR = [-1, 1], S = 1/Dist.

        Paper 000 prints no FR; 1 reproduces most of its Table 1. Paper 001 has ``flight_range=3.1``,
        Pan's own program ``location_range=(0, 10)``.
        """
        return cls(**{**cls.paper_settings, **kwargs})

    # -- drawing -----------------------------------------------------------------------------------
    @property
    def _planes(self) -> int:
        """Coordinates per variable."""
        return 1 if self.encoding == "direct" else self.coordinates or self.plane

    def draw_initial(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of the first flies: a place in the range and a first step for each."""
        c = self._planes
        return {
            "region": rng.random((n, c, d)),
            "first": self._first_steps(rng, (n, c, d)),
            **self._draw_signs(rng, n, d),
        }

    def draw(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        """Random numbers of one cycle; options change what is used of them, rarely what is drawn."""
        steps = self._draw_steps(rng, (n, self._planes, d))
        return {**steps, "which": rng.random(n), **self._draw_signs(rng, n, d)}

    def _draw_signs(self, rng: np.random.Generator, n: int, d: int) -> Arrays:
        # drawn even if unused, so that switching the sign on leaves all other draws as they were
        if self.encoding == "direct":
            return {}
        return {"sign": rng.random((n, d)), "delta": rng.random((n, d))}

    def _first_steps(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return uniform_draws(rng, shape, self.one_sided)

    def _draw_steps(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Arrays:
        return {"step": self._first_steps(rng, shape)}

    # -- moving ------------------------------------------------------------------------------------
    def place(self, constants: Arrays, draws: Arrays) -> Arrays:
        """`constants` with the first positions of the flies, ``flies`` of shape (..., n, c, d)."""
        low: Any
        high: Any
        low, high = self.location_range
        if self.encoding == "direct":
            low, high = constants["lower"], constants["upper"]
        flies = low + draws["region"] * (high - low)
        if self.start == "axis":
            flies = flies[..., :1, :, :] + draws["first"] * (self.flight_range * self._unit(constants))
        return {**constants, "flies": self._keep(flies)}

    def initialize(self, constants: Arrays, draws: Arrays) -> np.ndarray:
        """First candidates, shape (..., n, d)."""
        return self._decode(self.place(constants, draws)["flies"], constants, draws)

    def found(self, constants: Arrays, candidates: np.ndarray, losses: np.ndarray) -> Arrays:
        """State after the first flies: the axis is at the best of them."""
        if self.encoding != "direct" and "flies" not in constants:
            raise InvalidInput("constants", sorted(constants), "give the arrays of place(constants, draws)")
        flies = self._positions(constants.get("flies"), candidates)
        runs = losses.shape[:-1]
        state = {**super().found(constants, candidates, losses), "flies": flies}
        state |= {"cycle": np.zeros(runs, dtype=np.int64), "stagnation": np.zeros(runs, dtype=np.int64)}
        return {**state, **self._best_of(flies, candidates, self._merit(losses))}

    def move(self, state: Arrays, draws: Arrays, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Candidates of all flies, shape (..., n, d); all are evaluated."""
        flies = self.fly(state, draws)
        return self._decode(flies, state, draws), np.ones(flies.shape[:-2], dtype=bool)

    def fly(self, state: Arrays, draws: Arrays) -> np.ndarray:
        """New positions of the flies, shape (..., n, c, d): the axis plus a step (eq. 8)."""
        size = step_size(self.step_law, state["cycle"], self.horizon, self.final_step)
        step = self._standard_step(state, draws) * (self.flight_range * size[..., None, None, None])
        if self.dimensions == "one":
            step = np.where(one_variable(draws["which"], step.shape[-1]), step, 0.0)
        return self._keep(self._origin(state, draws)[..., None, :, :] + step * self._unit(state))

    def _standard_step(self, state: Arrays, draws: Arrays) -> np.ndarray:
        return draws["step"]

    def _origin(self, state: Arrays, draws: Arrays) -> np.ndarray:
        """Where the flies start, shape (..., c, d)."""
        return state["axis"]

    def _unit(self, constants: Arrays) -> Any:
        """Length of a unit step: half the box in the direct encoding."""
        return 0.5 * (constants["upper"] - constants["lower"]) if self.encoding == "direct" else 1.0

    def _keep(self, flies: np.ndarray) -> np.ndarray:
        far = FAR if self.clip is None else min(self.clip, FAR)
        return np.clip(flies, -far, far)

    def _decode(self, flies: np.ndarray, constants: Arrays, draws: Arrays, prefix: str = "") -> np.ndarray:
        sign = draws[prefix + "sign"] if self.signed else None
        delta = draws[prefix + "delta"] if self.delta else None
        return decode(self.encoding, flies, constants, sign=sign, delta=delta)

    def _positions(self, flies: np.ndarray | None, candidates: np.ndarray) -> np.ndarray:
        # in the direct encoding the candidate is the position: clipped, and as a user may have changed it
        return candidates[..., None, :] if self.encoding == "direct" or flies is None else flies

    # -- selecting ---------------------------------------------------------------------------------
    def _merit(self, losses: np.ndarray) -> np.ndarray:
        """What the flies make small: the loss, or its negative; never a loss that is not finite."""
        return losses if self.minimise else np.where(np.isfinite(losses), -losses, np.inf)

    def select(
        self,
        state: Arrays,
        draws: Arrays,
        phase: str,
        candidates: np.ndarray,
        losses: np.ndarray,
        mask: np.ndarray,
    ) -> Arrays:
        """Move the axis to the best fly if it is better than all before (eqs. 10 and 11)."""
        flies = self._positions(self.fly(state, draws), candidates)
        offered = self._best_of(flies, candidates, self._merit(losses))
        better = self._better(offered["best"], state["best"])
        return {
            **state,
            "X": candidates,
            "F": losses,
            "flies": flies,
            **self._replace(better, offered, {**state, "axis": self._origin(state, draws)}),
            "cycle": np.asarray(state["cycle"] + 1),
            "stagnation": np.where(better, 0, state["stagnation"] + 1),
        }

    @staticmethod
    def _best_of(flies: np.ndarray, candidates: np.ndarray, merit: np.ndarray) -> Arrays:
        """Position, candidate and merit of the best fly of each run."""
        k = np.argmin(merit, axis=-1)
        return {
            "axis": np.take_along_axis(flies, k[..., None, None, None], axis=-3)[..., 0, :, :],
            "best_X": np.take_along_axis(candidates, k[..., None, None], axis=-2)[..., 0, :],
            "best": np.asarray(np.take_along_axis(merit, k[..., None], axis=-1)[..., 0]),
        }

    @staticmethod
    def _replace(better: np.ndarray, new: Arrays, old: Arrays) -> Arrays:
        """`new` where `better`, run by run."""
        return {
            "axis": np.where(better[..., None, None], new["axis"], old["axis"]),
            "best_X": np.where(better[..., None], new["best_X"], old["best_X"]),
            "best": np.where(better, new["best"], old["best"]),
        }

    def _better(self, offered: np.ndarray, best: np.ndarray) -> np.ndarray:
        return np.asarray(offered < best)

    def _initialize_infill(self) -> Population:
        draws = self.draw_initial(self.random_state, self.pop_size, self.problem.n_var)
        self._start = self.place(self.constants(self.problem), draws)
        return Population.new(X=self.initialize(self._start, draws))


@solver(
    "gfoa",
    summary="fruit fly optimisation with Gaussian steps",
    source="Xu et al. 2016, Appl. Sci. 6:199",
    comparison_based=True,
)
class GaussianFruitFly(FruitFly):
    """Fruit fly optimisation whose steps are normally distributed (Xu et al. 2016).

    ``X = X_axis + FR N(0, 1)``, everything else as in `FruitFly`, whose parameters it takes. Paper 000
    compares with it and gives no standard deviation; here it is `flight_range`, 1 by default, with which
    four of the six GFOA values of its Table 1 come out within a factor of two. One-sided steps are
    absolute values.
    """

    def _first_steps(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        step = rng.standard_normal(shape)
        return np.abs(step) if self.one_sided else step


@solver(
    "3d-foa",
    summary="fruit fly optimisation with three coordinates per variable",
    source="Lin 2016, Neural Comput. Appl. 27:1391",
    comparison_based=True,
)
class FruitFly3D(FruitFly):
    """Fruit fly optimisation in space instead of the plane (Lin 2016).

    ``S = 1/√(X² + Y² + Z²)``, everything else as in `FruitFly`, whose parameters it takes. The third
    coordinate acts through the distance only: with ``encoding="direct"``, the default, there is none and
    the algorithm *is* `FruitFly`, draw for draw. The paper was not available; this is its abstract's plain
    form, and ``delta=True`` a variant met in re-implementations.
    """

    plane: ClassVar[int] = 3

    @classmethod
    def published(cls, **kwargs: Any) -> Self:
        """Build with the settings of paper 001, which compares with it: FR = [-3.1, 3.1]."""
        return cls(**{**cls.paper_settings, "flight_range": 3.1, **kwargs})
