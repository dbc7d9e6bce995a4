"""Bee colonies that match single points to a map: the ill-posed plain one, and Gao's linked and screened one.

Gao, Zhao, Zhou, Wang and Yu (2014), Sensors 14:12968. Its full text was not available: what its abstract
says is implemented, and every choice of ours is marked [REC] (reconstructed).
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from navopt.algorithms.options import at_least, number, one_of
from navopt.algorithms.point_chains import (
    cheapest_chains,
    distinct_candidates,
    modified_hausdorff_distance,
)
from navopt.algorithms.point_matching import PointMatcher
from navopt.errors import InvalidInput
from navopt.models.earth import to_geodetic
from navopt.problems.gravity_matching import MatchedTrack
from navopt.registry import solver

__all__ = ["ImprovedBeeColony", "SinglePointBeeColony"]


@solver(
    "single-point-abc",
    summary="bee colony on the last point only (ill-posed: the answer is any point of an iso-anomaly curve)",
    source="'basic ABC' of Dai et al. 2019, Front. Neurorobot. 13:19 (Table 4)",
    needs=("track",),
    spends_all=False,
    reasons={
        "comparison_based": "onlookers choose by the fitness value 1/(1+f), not by rank",
        "spends_all": "the residual of one point vanishes within tens of cycles; there is no more to find",
    },
)
class SinglePointBeeColony(PointMatcher):
    """Bee colony that matches the last measurement alone: the "basic ABC" of paper 003.

    Minimises ``|g_obs - g_map(x)|`` over the position x of the last sample. All points of a curve of
    equal anomaly are solutions: the residual vanishes and the position error does not. It is here to show
    that, not to navigate. The rest of the track is shifted along.

    Parameters
    ----------
    pop_size : int, default 20
        Number of sources.
    limit : int, optional
        See `BeeColony`; ``2 pop_size`` if not given.
    scouts : {"all", "one"}
        See `BeeColony`; the best source is protected in either case.
    selection : {"roulette", "relative"}
        See `BeeColony`.
    guidance : float, default 0.0
        See `GuidedBeeColony`; 0 is the plain colony.
    radius_m : float, optional
        Half width of the search box around the inertial position, m, within the problem's box of the
        translation, which it is if not given.
    cycles : int or None, default 50
        Cycles of a run, as far as the budget allows; None to use all of a budget (30 if there is none).
    update : {"synchronous", "sequential"}
        See `SwarmAlgorithm`.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Attributes
    ----------
    state : dict of ndarray
        The colony at the end of the run: shifts ``X`` (1, pop_size, 2), m, and residuals ``F``.
    looked_up : int
        Look-ups on the map.

    Notes
    -----
    ``counts.internal`` is the number of look-ups over the window, rounded up: a loss is `window` of them.
    One loss, that of the answer, is evaluated at the end; it takes no part in the search, because it
    would solve another problem. The run is therefore one batch and cannot be paused inside.

    Over 50 worlds at 3 h with 3.8′ of inertial error on average, the mean error is 3.7′, 32 % within 2′, if
    `radius_m` is one sigma of the prior (003, Table 4: 4.22′ from 4.82′, 28 %), and 5′ to 7′ in the box of
    three sigmas, along whose curves the answer may lie anywhere.
    """

    def __init__(
        self,
        *,
        pop_size: int = 20,
        limit: int | None = None,
        scouts: str = "all",
        selection: str = "roulette",
        guidance: float = 0.0,
        radius_m: float | None = None,
        cycles: int | None = 50,
        update: str = "synchronous",
        **kwargs: Any,
    ) -> None:
        colony = {
            "pop_size": pop_size,
            "limit": limit,
            "scouts": scouts,
            "selection": selection,
            "guidance": guidance,
            "update": update,
        }
        super().__init__(colony=colony, radius_m=radius_m, cycles=cycles, **kwargs)

    @classmethod
    def published(cls, **kwargs: Any) -> Self:
        """Build with the settings of paper 003 (Table 3): 10 sources, limit 20, 500 cycles.

        Its loop moves one bee after another (``update="sequential"``), which takes many times as long for
        the same vanishing residual and is left to the user.
        """
        return cls(**{"pop_size": 10, "limit": 20, "cycles": 500, **kwargs})

    def propose(self) -> np.ndarray:
        """Shift on which the last sample agrees best with the map, everything else nominal, shape (4,)."""
        self.search(np.array([self.problem.window - 1]))
        x = self.problem.nominal
        residuals = self.state["F"][0]
        if np.isfinite(residuals).any():
            x[:2] = self.state["X"][0, np.argmin(residuals)]
        return x


@solver(
    "improved-abc",
    summary="a bee colony per sampling point, linked by speed and heading, screened by their shape",
    source="Gao et al. 2014, Sensors 14:12968 (abstract; details reconstructed)",
    needs=("track",),
    reasons={"comparison_based": "onlookers choose by 1/(1+f), and residuals are added to distances"},
)
class ImprovedBeeColony(PointMatcher):
    """Improved bee colony for gravity matching: local single-point search and overall restriction.

    For every sample of the window a colony minimises ``|g_obs,k - g_map(x)|`` in a box around the
    inertial position. Its best distinct sources are the candidates of the sample; the chain through one
    candidate per sample with the least sum of residuals and of disagreement with speed and heading is
    found exactly (Viterbi), and accepted if its shape is near enough to the inertial track's. The
    decision vector is the least-squares similarity of the inertial track to the chain, inside the box.

    Parameters
    ----------
    pop_size : int, default 40
        Sources per sample.
    limit, scouts, selection, radius_m
        See `SinglePointBeeColony`.
    guidance : float, default 0.0
        See `GuidedBeeColony`. It draws the sources of a sample together, and so thins out its candidates.
    candidates : int, optional
        Largest number of candidates per sample; all sources if not given.
    separation_m : float, default 200.0
        Least distance between two candidates of a sample, m.
    mu : float, default 0.01
        Cost of a metre of disagreement between two points, in the unit of the map.
    heading_weight : float, default 1.0
        Weight of heading against speed; 0 links by speed alone.
    threshold_m : float, optional
        Largest modified Hausdorff distance between the chain and the inertial track, both centred, m;
        ``inf`` switches the screening off. If not given, three standard deviations of the relative
        inertial error in the window, from the problem's prior of rotation and scale.
    rejected : {"nearest", "inertial"}
        Chain if none passes: the one of the least distance, or the inertial track.
    answer : {"projection", "chain"}
        Whether the estimate is the track of the decision vector, or the chain itself, which is attached to
        the solution. The projection adds what the problem's box knows of rotation and scale.
    cycles : int or None, default None
        Cycles of a run, as far as the budget allows; None to use all of a budget (30 if there is none).
    update : {"synchronous", "sequential"}
        See `SwarmAlgorithm`.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Attributes
    ----------
    chain : MatchedTrack or None
        The matched points; no similarity of the inertial track passes through them.
    estimate : MatchedTrack or None
        The chain if it is the answer.
    accepted : bool
        Whether a chain passed the screening.
    distance_m : float
        Modified Hausdorff distance of the answer, m.
    state : dict of ndarray
        The colonies at the end: shifts ``X`` (window, pop_size, 2), m, and residuals ``F``.
    looked_up : int
        Look-ups on the map.

    Notes
    -----
    Known from the paper's abstract and keywords: a modified search equation, local single-point search,
    overall restriction by external speed, screening by the modified Hausdorff distance. Reconstructed
    [REC]: the search equation (Zhu and Kwong 2010), the links and what follows a rejection, all
    constants, and the inertial track's own segments in place of a log and a compass. With the few
    candidates of `published` the chain is coarser than the inertial error (5.1′ over the worlds of
    `SinglePointBeeColony`'s notes); the defaults keep all 40 sources (1.4′). For the counting of look-ups
    see there.
    """

    def __init__(
        self,
        *,
        pop_size: int = 40,
        limit: int | None = None,
        scouts: str = "all",
        selection: str = "roulette",
        guidance: float = 0.0,
        radius_m: float | None = None,
        candidates: int | None = None,
        separation_m: float = 200.0,
        mu: float = 0.01,
        heading_weight: float = 1.0,
        threshold_m: float | None = None,
        rejected: str = "nearest",
        answer: str = "projection",
        cycles: int | None = None,
        update: str = "synchronous",
        **kwargs: Any,
    ) -> None:
        colony = {
            "pop_size": pop_size,
            "limit": limit,
            "scouts": scouts,
            "selection": selection,
            "guidance": guidance,
            "update": update,
        }
        super().__init__(colony=colony, radius_m=radius_m, cycles=cycles, **kwargs)
        self.candidates = None if candidates is None else at_least("candidates", candidates, 1)
        if candidates is not None and candidates > self.pop_size:
            raise InvalidInput("candidates", candidates, f"give at most the {pop_size} sources of a colony")
        for name, value in (("separation_m", separation_m), ("mu", mu), ("heading_weight", heading_weight)):
            if number(name, value) < 0:
                raise InvalidInput(name, value, "give a finite number, at least 0")
        if threshold_m not in (None, np.inf) and number("threshold_m", threshold_m) < 0:
            raise InvalidInput("threshold_m", threshold_m, "give a number of metres, at least 0, or None")
        self.separation_m, self.mu, self.heading_weight = separation_m, mu, heading_weight
        self.threshold_m = threshold_m
        self.rejected = one_of("rejected", rejected, ("nearest", "inertial"))
        self.answer = one_of("answer", answer, ("projection", "chain"))
        self.chain: MatchedTrack | None = None
        self.estimate: MatchedTrack | None = None
        self.accepted = False
        self.distance_m = np.nan

    @classmethod
    def published(cls, **kwargs: Any) -> Self:
        """Build the reconstruction with the colony of paper 003, which compares with it.

        10 sources, limit 20 and 500 cycles (003, Table 3), the chain itself as the answer; five candidates
        per sample and a guidance up to 1.5 (Zhu and Kwong's) are ours [REC].
        """
        ours = {"candidates": 5, "guidance": 1.5, "answer": "chain"}
        return cls(**{"pop_size": 10, "limit": 20, "cycles": 500, **ours, **kwargs})

    def propose(self) -> np.ndarray:
        """Projection of the chain onto the similarities of the inertial track, shape (4,)."""
        problem = self.problem
        self.search(np.arange(problem.window))
        points, costs = self._candidates()
        shape = self.shape()
        chains, totals = cheapest_chains(
            points, costs, np.diff(shape, axis=0), mu=self.mu, heading_weight=self.heading_weight
        )
        tracks = points[np.arange(problem.window), chains[np.isfinite(totals)]]
        centred = tracks - tracks.mean(axis=1, keepdims=True)
        distances = modified_hausdorff_distance(centred, shape - shape.mean(axis=0))
        passed = distances <= (self._threshold() if self.threshold_m is None else self.threshold_m)
        self.accepted = bool(passed.any())
        # chains are sorted by cost: the cheapest that passes, else the one of the most likely shape
        k = int(np.argmax(passed)) if self.accepted else int(np.argmin(distances))
        track, self.distance_m = tracks[k], float(distances[k])
        if not self.accepted and self.rejected == "inertial":
            track, self.distance_m = shape + problem.nominal[:2], 0.0
        self.chain = MatchedTrack(*to_geodetic(track[:, 0], track[:, 1], *problem.origin))
        if self.answer == "chain":
            self.estimate = self.chain
        return np.array(problem.project(self.chain))

    def _candidates(self) -> tuple[np.ndarray, np.ndarray]:
        """Candidate points (window, candidates, 2), m, and their residuals, ``inf`` where there is none."""
        X, F = self.state["X"], self.state["F"]
        chosen, valid = distinct_candidates(X, F, self.candidates or self.pop_size, self.separation_m)
        shifts = np.take_along_axis(X, chosen[..., None], axis=-2)
        costs = np.where(valid, np.take_along_axis(F, chosen, axis=-1), np.inf)
        # a sample that has no candidate (all looked-up points off the map) stays where the INS has it
        lost = ~valid[:, 0]
        shifts[lost, 0], costs[lost, 0] = self.problem.nominal[:2], 0.0
        return self.shape()[:, None] + shifts, costs

    def _threshold(self) -> float:
        """Three sigmas of a point's distance from its place relative to the centroid, rms over the window."""
        problem, known = self.problem, self.problem.prior()
        if known is None:
            sigma = (problem.xu[2:] - problem.xl[2:]) / 6.0
        else:
            sigma = np.sqrt(np.diag(known[1])[2:])
        return float(3.0 * np.hypot(*sigma) * np.sqrt(np.mean(np.sum(problem.sequence**2, axis=1))))
