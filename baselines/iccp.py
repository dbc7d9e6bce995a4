"""Iterative closest contour point: a track drawn onto the contours of the values measured along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from baselines import iccp_kernels as kernels
from baselines.base import Baseline
from baselines.iccp_grid import PlaneGrid, plane_grid
from baselines.rigid_transform import AFFINE, RIGID, SIMILARITY
from baselines.tercom_kernels import MAD, scan
from navopt.algorithms.options import at_least, number, one_of
from navopt.models.earth import local_tangent_plane, to_geodetic
from navopt.problems.gravity_matching import MatchedTrack
from navopt.registry import solver

__all__ = ["ContourMatch", "Iccp"]

TRANSFORMS = {"rigid": RIGID, "similarity": SIMILARITY, "affine": AFFINE}
MESSAGES = {
    kernels.CONVERGED: ("converged", "the track came to rest on its contours"),
    kernels.ITERATIONS: ("iterations", "the largest number of iterations was reached"),
    kernels.NO_CONTOUR: ("no-contour", "too few of the measured values occur in the search region"),
    kernels.CUT: ("budget", "the budget ended the iterations"),
}
#: Steps of TERCOM's scan for starts, m: it only has to find the valleys.
START_STEP_M = 1500.0


@dataclass(frozen=True)
class ContourMatch(MatchedTrack):
    """Matched positions, and how the matching ended.

    Attributes
    ----------
    latitude, longitude : ndarray, shape (window,)
        Estimated positions, rad, in the order of the samples; the last is the navigation fix.
    outcome : {"converged", "iterations", "diverged", "left-region", "no-contour", "budget"}
        How the winning start ended. ``"diverged"``: it fits worse than the track it started from;
        ``"left-region"``: its last point is farther from the inertial one than the search box allows.
    message : str
        The same in a sentence.
    accepted : bool
        Whether it came to rest in the region, and the mean absolute difference to the map is below three
        standard deviations of the noise.
    difference : float
        Mean absolute difference to the (bilinear) map, in its unit.
    distance_m : float
        Root mean square distance of the points to their contours at the last search.
    iterations : int
        Iterations of the winning start.
    starts : int
        Starts that were tried.
    """

    outcome: str = "converged"
    message: str = ""
    accepted: bool = True
    difference: float = 0.0
    distance_m: float = 0.0
    iterations: int = 0
    starts: int = 1


@solver(
    "iccp",
    summary="iterative closest contour point: rigid, similarity or affine, from one start or many",
    source="Kamgar-Parsi and Kamgar-Parsi 1999; affine: Xu et al. 2014, J. Chin. Inertial Technol. 22:362",
    needs=("track",),
    stochastic=False,
    spends_all=False,
    comparison_based=True,
    reasons={"spends_all": "a start ends when the track has come to rest on its contours"},
)
class Iccp(Baseline):
    """Iterative closest contour point (ICCP).

    Each point of the track is given the nearest point at which the map has the value measured there; the
    transform that brings the track nearest to these points is found in closed form; and so on until the
    track rests. It is a local method: from errors beyond about half the distance of two contours it runs
    to a wrong one, and only the direction across the contours is seen.

    Parameters
    ----------
    transform : {"rigid", "similarity", "affine"}
        What may be done to the track. Scales and stretches stay within the limits of the problem's box.
    starts : int, default 1
        Starts, of which the one with the least mean absolute difference wins; 1 is the published method.
    start_from : {"sobol", "tercom"}
        Where the starts after the first lie. The first is always the inertial track. Sobol points fill
        the box (rotations too, and scales unless the transform is rigid); ``"tercom"`` takes the best
        separate minima of a scan of translations.
    weights : {"equal", "huber"}
        Weights of the points in the fit; Huber's with a scale from the median distance.
    ridge : float, default 0.1
        Regularisation of the affine transform, see `baselines.rigid_transform.fit_affine`.
    iterations : int, default 100
        Largest number of iterations of a start.
    tolerance_m : float, default 1.0
        Mean move of the points that ends a start; so does a relative change of the mean square distance
        below 1e-6.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    The search region of a point is the problem's box of the translation about its inertial position. A
    point whose value does not occur there is left out. The transform is always fitted from the inertial
    track, not from the last iterate, so that limits of the scale hold for the whole.

    Contours are chords through bilinear cells (see `baselines.iccp_kernels`), whatever interpolation the
    problem uses. A quarter of the twist, by which the mapped value on a chord may be off at most, is
    0.03 mGal in the median cell of the embedded map to degree 2190, 0.5 mGal in one of a hundred and 1.0 mGal
    in the worst; in the median that is 40 m on the ground, where the noise of 1 mGal is worth a kilometre.

    An unknown offset of the sensor is not taken out: a contour needs a value.

    With starts all over a box of several contour spacings the least difference need not be the right track:
    in twenty worlds at 7 h, whose box reaches 40 km to each side, twenty starts have twice the error of one.

    A cell that is looked at counts as one look-up, `window` look-ups as one unit of the budget
    (``counts.internal``), and so does the mean difference of a start.

    The answer is attached to the solution as a `ContourMatch`; ``solution.x`` is its projection into the
    box.
    """

    def __init__(
        self,
        *,
        transform: str = "rigid",
        starts: int = 1,
        start_from: str = "sobol",
        weights: str = "equal",
        ridge: float = 0.1,
        iterations: int = 100,
        tolerance_m: float = 1.0,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.transform = one_of("transform", transform, tuple(TRANSFORMS))
        self.starts = at_least("starts", starts, 1)
        self.start_from = one_of("start_from", start_from, ("sobol", "tercom"))
        self.weights = one_of("weights", weights, ("equal", "huber"))
        self.ridge = number("ridge", ridge, above=0.0)
        self.iterations = at_least("iterations", iterations, 1)
        self.tolerance_m = number("tolerance_m", tolerance_m, above=0.0)
        self.estimate: ContourMatch | None = None

    @classmethod
    def published(cls, **kwargs: Any) -> Self:
        """Build the method Dai et al. (2019) compare with: rigid, from the inertial track alone."""
        return cls(**{"transform": "rigid", "starts": 1, "weights": "equal", **kwargs})

    def propose(self) -> np.ndarray:
        """Projection of the best match into the box, shape (1, 4)."""
        problem = self.problem
        track = np.ascontiguousarray(
            np.stack(
                local_tangent_plane(
                    problem.track.latitude[-problem.window :],
                    problem.track.longitude[-problem.window :],
                    *problem.origin,
                ),
                axis=1,
            )
        )
        regions = np.concatenate(
            [track[:, :1] + [problem.xl[0], problem.xu[0]], track[:, 1:] + [problem.xl[1], problem.xu[1]]],
            axis=1,
        )
        reach = np.hypot(*(problem.sequence.max(axis=0) - problem.sequence.min(axis=0)))
        limits = np.array(
            [regions[:, 0].min() - reach, regions[:, 1].max() + reach,
             regions[:, 2].min() - reach, regions[:, 3].max() + reach]
        )  # fmt: skip
        grid = plane_grid(problem, limits)
        self._spent, self._charged = 0, 0
        best: tuple[float, np.ndarray, dict[str, Any]] | None = None
        tried = 0
        for start in self._transforms(grid, track):
            if self._left < problem.window:
                break
            tried += 1
            difference, result = self._run(grid, track, regions, start)
            if best is None or difference < best[0]:
                best = difference, start, result
        if best is None:
            # not even the inertial track could be compared with the map
            best = (
                np.inf,
                _similarity(np.zeros(2), 0.0, 1.0),
                {"outcome": "budget", "message": MESSAGES[3][1]},
            )
        difference, found, result = best
        points = track @ found[:2].T + found[2]
        latitude, longitude = to_geodetic(points[:, 0], points[:, 1], *problem.origin)
        self.estimate = ContourMatch(
            latitude,
            longitude,
            accepted=result["outcome"] == "converged" and difference < 3.0 * problem.noise,
            difference=difference,
            starts=max(tried, 1),
            **result,
        )
        return problem.project(self.estimate)[None]

    def _run(
        self, grid: PlaneGrid, track: np.ndarray, regions: np.ndarray, transform: np.ndarray
    ) -> tuple[float, dict[str, Any]]:
        """Iterate from one start, in place; the mean difference at the end and what to tell about it."""
        problem = self.problem
        before = kernels.mean_difference(
            grid.values, grid.axes, track @ transform[:2].T + transform[2], problem.measured
        )
        self._spend(problem.window)
        allowed = int(min(max(self._left - problem.window, 0), 2**62))
        reason, done, cells, distance = kernels.match(
            grid.values, grid.axes, track, problem.measured, regions, TRANSFORMS[self.transform],
            problem.xl[3], problem.xu[3], self.ridge, self.weights == "huber", self.iterations,
            self.tolerance_m, allowed, transform,
        )  # fmt: skip
        self._spend(cells)
        after = before
        points = track @ transform[:2].T + transform[2]
        if done:
            after = kernels.mean_difference(grid.values, grid.axes, points, problem.measured)
            self._spend(problem.window)
        outcome, message = MESSAGES[reason]
        moved = points[-1] - track[-1]
        if after > before:
            outcome, message = "diverged", "the track fits the map worse than where it started from"
        elif ((moved < problem.xl[:2]) | (moved > problem.xu[:2])).any():
            outcome, message = "left-region", "the last point left the search region"
        return float(after), {
            "outcome": outcome,
            "message": message,
            "distance_m": float(distance) if done else 0.0,
            "iterations": int(done),
        }

    # -- starts --------------------------------------------------------------------------------------
    def _transforms(self, grid: PlaneGrid, track: np.ndarray) -> list[np.ndarray]:
        """Matrices and shifts to start from, shape (3, 2) each; the first changes nothing."""
        none = _similarity(np.zeros(2), 0.0, 1.0)
        if self.starts == 1:
            return [none]
        poses = self._sobol() if self.start_from == "sobol" else self._valleys(grid, track)
        return [none, *(_similarity(*pose) for pose in poses)]

    def _sobol(self) -> list[tuple[np.ndarray, float, float]]:
        from scipy.stats.qmc import Sobol

        n = self.starts - 1
        dimensions = 3 if self.transform == "rigid" else 4
        # half a step aside, or the first point is a corner of the box
        power = max(int(np.ceil(np.log2(n))), 0)
        points = Sobol(dimensions, scramble=False).random_base2(power)[:n] + 0.5 ** (power + 1)
        lower, upper = self.problem.xl[:dimensions], self.problem.xu[:dimensions]
        starts = lower + points * (upper - lower)
        return [(p[:2], float(p[2]), 1.0 if dimensions == 3 else float(p[3])) for p in starts]

    def _valleys(self, grid: PlaneGrid, track: np.ndarray) -> list[tuple[np.ndarray, float, float]]:
        """Translations of the best local minima of a TERCOM scan."""
        lower, upper = self.problem.xl[:2], self.problem.xu[:2]
        counts = np.maximum(np.ceil((upper - lower) / START_STEP_M).astype(int) + 1, 3)
        # leave room for at least as many iterations as were spent on the scan
        affordable = self._left / self.problem.window / 2.0
        if np.prod(counts) > affordable:
            counts = np.maximum((counts * np.sqrt(affordable / np.prod(counts))).astype(int), 1)
        if counts.min() < 3:
            return []
        north, east = (np.linspace(*ends) for ends in zip(lower, upper, counts, strict=True))
        self._spend(int(np.prod(counts)) * self.problem.window)
        surface = np.empty((len(north), len(east)))
        scan(
            (track[:, 0] - grid.north) / grid.north_step,
            (track[:, 1] - grid.east) / grid.east_step,
            self.problem.measured,
            north / grid.north_step,
            east / grid.east_step,
            grid.values,
            MAD,
            False,
            surface,
        )
        padded = np.pad(surface, 1, constant_values=np.inf)
        around = [
            padded[1 + a : padded.shape[0] - 1 + a, 1 + b : padded.shape[1] - 1 + b]
            for a in (-1, 0, 1)
            for b in (-1, 0, 1)
            if a or b
        ]
        low = np.isfinite(surface) & (surface <= np.min(around, axis=0))
        places = np.argwhere(low)[np.argsort(surface[low], kind="stable")][: self.starts - 1]
        return [(np.array([north[a], east[b]]), 0.0, 1.0) for a, b in places]

    # -- the budget, in look-ups ---------------------------------------------------------------------
    @property
    def _left(self) -> float:
        """Look-ups that may still be made: all but the loss of the answer."""
        budget = self.evaluator.remaining + self._charged
        return (budget - 1) * self.problem.window - self._spent

    def _spend(self, look_ups: int) -> None:
        self._spent += look_ups
        due = -(-self._spent // self.problem.window)
        self.evaluator.charge(due - self._charged)
        self._charged = due


def _similarity(shift: np.ndarray, angle: float, scale: float) -> np.ndarray:
    """Matrix and shift of a similarity of the plane, shape (3, 2)."""
    cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine], shift])
