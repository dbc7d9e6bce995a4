"""Affine bee colony for sequence matching (Dai et al. 2019, Front. Neurorobot. 13:19; paper 003)."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.algorithms.bee_colony import BeeColony
from navopt.algorithms.options import one_of
from navopt.algorithms.swarm import Arrays
from navopt.registry import solver

__all__ = ["AffineBeeColony"]


@solver(
    "affine-abc",
    summary="bee colony whose trials rotate, scale and shift a whole track towards another's",
    source="Dai et al. 2019, Front. Neurorobot. 13:19",
    needs=("similarity",),
    reasons={"comparison_based": "onlookers choose by the fitness value 1/(1+f), not by rank"},
)
class AffineBeeColony(BeeColony):
    """Bee colony over similarity transforms of an inertial track.

    A source is a track ``X = c + t + s R(β) q``: the inertial sequence q about its centroid c, turned
    clockwise by β, scaled by s and shifted by t = (north, east). The paper stores whole sequences and
    recovers the rotation between two of them from their covariance matrix (eqs. 37-39, printed with a
    wrong sign); because similarity transforms are closed under composition, that rotation is exactly
    β_j - β_i, the ratio of lengths s_j/s_i and the difference of centroids t_j - t_i, so four numbers
    are enough.

    Parameters
    ----------
    pop_size : int, default 10
        Number of sources.
    limit : int, default 20
        Failures after which a source may be abandoned.
    scouts : {"one", "all"}
        See `BeeColony`; the paper's procedure re-initialises all.
    selection : {"roulette", "relative"}
        See `BeeColony`.
    affine_initialization : bool, default True
        Place the *first* point of a new source uniformly in the search scope (eqs. 27-34); otherwise
        draw the four numbers uniformly in the box.
    rotate, scale, translate : bool, default True
        The three parts of a trial (eqs. 40-43, 44-47, 49).
    constrain_rotation, constrain_scale : bool, default True
        Draw the change only from the part of its interval that keeps the source inside the box (eqs.
        42 and 46-47); otherwise draw from the whole interval and clip.
    box_rule : bool, default True
        Shift a track back whose points leave the search scope (eqs. 35-36). The scope is the inertial
        sequence's own extent widened by the box of the translation.
    translation_factor : {"scalar", "per_axis"}
        One random factor for both axes of the shift (49), or one each.
    update : {"synchronous", "sequential"}
        See `SwarmAlgorithm`.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    Deviations from the printed text: rotation and scaling act about the sequence's centroid in metres
    on a local tangent plane (about the origin of latitude and longitude, a 5° rotation moves a track
    by 13.6°), and the limits of rotation and scale are those of the problem's box (`GravityMatching`
    with ``box="paper"`` has the paper's). Every operator can be switched off.
    """

    def __init__(
        self,
        *,
        pop_size: int = 10,
        limit: int | None = 20,
        scouts: str = "all",
        selection: str = "roulette",
        affine_initialization: bool = True,
        rotate: bool = True,
        scale: bool = True,
        translate: bool = True,
        constrain_rotation: bool = True,
        constrain_scale: bool = True,
        box_rule: bool = True,
        translation_factor: str = "scalar",
        update: str = "synchronous",
        **kwargs: Any,
    ) -> None:
        super().__init__(
            pop_size=pop_size, limit=limit, scouts=scouts, selection=selection, update=update, **kwargs
        )
        self.affine_initialization = affine_initialization
        self.rotate = rotate
        self.scale = scale
        self.translate = translate
        self.constrain_rotation = constrain_rotation
        self.constrain_scale = constrain_scale
        self.box_rule = box_rule
        self.translation_factor = one_of("translation_factor", translation_factor, ("scalar", "per_axis"))

    @classmethod
    def published(cls, **kwargs: Any) -> AffineBeeColony:
        """Build with the settings of the paper's Table 3, its bees moving one after another."""
        return cls(**{"update": "sequential", **kwargs})

    def constants(self, problem: Any) -> Arrays:
        """Box, centred inertial sequence (N, 2) in metres, and the scope its points must keep to."""
        box = super().constants(problem)
        sequence = np.array(problem.sequence)
        return {
            **box,
            "sequence": sequence,
            "scope_lower": sequence.min(axis=0) + box["lower"][:2],
            "scope_upper": sequence.max(axis=0) + box["upper"][:2],
        }

    def initialize(self, constants: Arrays, draws: Arrays) -> np.ndarray:
        """First sources: the first point uniform in its scope, then turned and scaled about it."""
        uniform = super().initialize(constants, draws)
        if not self.affine_initialization:
            return self._keep_in_scope(constants, uniform)
        first = constants["sequence"][0]
        transformed = _transform(first[None], uniform[..., 2], uniform[..., 3])[..., 0, :]
        shift = uniform[..., :2] + first - transformed
        return self._keep_in_scope(constants, np.concatenate([shift, uniform[..., 2:]], axis=-1))

    def _trial(self, state: Arrays, draws: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        X, lower, upper = state["X"], state["lower"], state["upper"]
        source = np.take_along_axis(X, chosen[..., None], axis=-2)
        partner = np.take_along_axis(X, self._partner(draws, chosen)[..., None], axis=-2)
        shift, angle, length = source[..., :2], source[..., 2], source[..., 3]
        if self.translate:
            factor = (
                2.0 * (draws[..., 4:6] if self.translation_factor == "per_axis" else draws[..., 4:5]) - 1.0
            )
            shift = shift + (partner[..., :2] - shift) * factor
        if self.rotate:
            reach = np.abs(partner[..., 2] - angle)
            low, high = -reach, reach
            if self.constrain_rotation:
                low, high = np.maximum(low, lower[2] - angle), np.minimum(high, upper[2] - angle)
            angle = angle + low + draws[..., 2] * (high - low)
        if self.scale:
            ratio = partner[..., 3] / length
            low, high = np.minimum(ratio, 1.0 / ratio), np.maximum(ratio, 1.0 / ratio)
            if self.constrain_scale:
                low, high = np.maximum(low, lower[3] / length), np.minimum(high, upper[3] / length)
            length = length * (low + draws[..., 3] * (high - low))
        candidates = np.concatenate([shift, angle[..., None], length[..., None]], axis=-1)
        return self._keep_in_scope(state, candidates)

    def _keep_in_scope(self, constants: Arrays, candidates: np.ndarray) -> np.ndarray:
        """Apply the box rule (35)-(36), then the box itself."""
        if self.box_rule:
            points = _transform(constants["sequence"], candidates[..., 2], candidates[..., 3])
            points = points + candidates[..., None, :2]
            below = constants["scope_lower"] - points.min(axis=-2)
            above = constants["scope_upper"] - points.max(axis=-2)
            shift = np.where(below > 0, below, np.where(above < 0, above, 0.0))
            candidates = np.concatenate([candidates[..., :2] + shift, candidates[..., 2:]], axis=-1)
        return np.clip(candidates, constants["lower"], constants["upper"])


def _transform(points: np.ndarray, angle: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Turn (north, east) points (N, 2) clockwise by `angle` and scale them: (...) -> (..., N, 2)."""
    cosine, sine = (scale * np.cos(angle))[..., None], (scale * np.sin(angle))[..., None]
    north, east = points[:, 0], points[:, 1]
    return np.stack([cosine * north - sine * east, sine * north + cosine * east], axis=-1)
