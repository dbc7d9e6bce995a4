"""Terrain contour matching on a gravity map: every shift on a grid, the best one refined."""

from __future__ import annotations

from typing import Any

import numpy as np

from baselines import tercom_kernels as kernels
from baselines.base import Baseline
from navopt.algorithms.options import at_least, one_of
from navopt.errors import InvalidInput
from navopt.registry import solver

__all__ = ["Tercom"]

CRITERIA = {"mad": kernels.MAD, "msd": kernels.MSD, "correlation": kernels.CORRELATION}
#: The problem's losses that are the same thing as a criterion here.
LOSSES = {"mad": "mad", "msd": "mean-square"}
#: Grid of paper 003's map, 0.3′ in metres: the step of the search unless a budget asks for a wider one.
STEP_M = 0.3 * 1852.0
#: Proposals evaluated with the problem's loss after the search: the grid's best and its refinement.
PROPOSALS = 2


@solver(
    "tercom",
    summary="exhaustive grid of translations (optionally rotations and scales), sub-grid refinement",
    source="Affleck and Jircitano 1990, IEEE PLANS; criteria as in Han et al. 2016, IEEE Sens. J. 16:2537",
    needs=("track",),
    stochastic=False,
    spends_all=False,
    comparison_based=True,
    minimum_cost=9 + PROPOSALS,
    reasons={"spends_all": "a rectangular grid rarely has exactly as many nodes as the budget allows"},
)
class Tercom(Baseline):
    """Terrain contour matching (TERCOM).

    Every translation of the window on a grid over the search box is compared with the map; each is one
    unit of the budget (``counts.internal``). The winner is refined by the minimum of the parabolas
    through its neighbours. A rotation or scale error of the track is not corrected unless asked for.

    Parameters
    ----------
    criterion : {"mad", "msd", "correlation"}
        Mean absolute difference, mean square difference, or correlation coefficient.
    step_m : float, optional
        Step of the translations in metres. If not given, 556 m (0.3′), or as fine as the budget allows.
    rotations, scales : int, default 1
        Numbers of rotations and scales tried, evenly over the box and including no change; odd.
    refine : bool, default True
        Sub-grid refinement.
    remove_mean : bool, default False
        Take a datum offset out before comparing (the correlation always does).
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    Looks the map up bilinearly whatever the problem's loss does. Where the criterion is not the problem's
    loss, only the refined winner is proposed: another loss must not choose.
    """

    def __init__(
        self,
        *,
        criterion: str = "mad",
        step_m: float | None = None,
        rotations: int = 1,
        scales: int = 1,
        refine: bool = True,
        remove_mean: bool = False,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.criterion = one_of("criterion", criterion, tuple(CRITERIA))
        if step_m is not None and not (np.isfinite(step_m) and step_m > 0):
            raise InvalidInput("step_m", step_m, "give a positive number of metres or None")
        self.step_m = step_m
        self.rotations = _odd("rotations", rotations)
        self.scales = _odd("scales", scales)
        self.refine = refine
        self.remove_mean = remove_mean

    def propose(self) -> np.ndarray:
        """Best grid node and its refinement, shape (1 or 2, 4)."""
        problem = self.problem
        angles = _including(0.0, problem.xl[2], problem.xu[2], self.rotations)
        lengths = _including(1.0, problem.xl[3], problem.xu[3], self.scales)
        north, east = self._translations(len(angles) * len(lengths))
        hypotheses = len(north) * len(east) * len(angles) * len(lengths)
        if hypotheses + 1 > self.evaluator.remaining:
            raise InvalidInput(
                "budget",
                self.evaluator.budget,
                f"{len(angles) * len(lengths)} poses on {len(north)} × {len(east)} shifts cost "
                f"{hypotheses + PROPOSALS}; widen step_m or leave it out, or try fewer rotations or scales",
            )
        self.evaluator.charge(hypotheses)
        best: tuple[float, np.ndarray, np.ndarray, tuple[int, int]] | None = None
        for angle in angles:
            for length in lengths:
                surface = self.surface(north, east, angle, length)
                at = np.unravel_index(int(np.argmin(surface)), surface.shape)
                if best is None or surface[at] < best[0]:
                    node = np.array([north[at[0]], east[at[1]], angle, length])
                    best = float(surface[at]), node, surface, (int(at[0]), int(at[1]))
        assert best is not None
        _, node, surface, place = best
        if not self.refine:
            return node[None]
        refined = node.copy()
        refined[:2] += _vertex(surface, *place) * [north[1] - north[0], east[1] - east[0]]
        # a loss of another kind must not choose between the winner's grid node and its refinement
        same = not self.remove_mean and LOSSES.get(self.criterion) == problem.criterion
        return np.stack([node, refined]) if same else refined[None]

    def surface(
        self, north: np.ndarray, east: np.ndarray, angle: float = 0.0, scale: float = 1.0
    ) -> np.ndarray:
        """Criterion of every translation (metres), to be minimised, shape (len(north), len(east))."""
        problem = self.problem
        values, lat0, lon0, dlat, dlon = problem.field_map.grid
        moved = problem.estimate(np.array([0.0, 0.0, angle, scale]))
        rows = (moved.latitude - lat0) / dlat
        if abs(dlon * (values.shape[1] - 1) - 2.0 * np.pi) < 0.5 * dlon:
            # a map around the Earth is cut opposite the track, which may then cross its seam
            cut = round((moved.longitude.mean() - np.pi - lon0) / dlon) % (values.shape[1] - 1)
            values = np.concatenate([values[:, cut:-1], values[:, : cut + 1]], axis=1)
            lon0 += cut * dlon
        middle = lon0 + 0.5 * dlon * (values.shape[1] - 1)
        # the same turn as the map's, whatever the sign convention of the track's longitudes
        turn = 2.0 * np.pi * np.round((moved.longitude.mean() - middle) / (2 * np.pi))
        columns = (moved.longitude - turn - lon0) / dlon
        meridian, parallel = problem.metres_per_radian
        out = np.empty((len(north), len(east)))
        kernels.scan(
            rows,
            columns,
            problem.measured,
            north / (meridian * dlat),
            east / (parallel * dlon),
            values,
            CRITERIA[self.criterion],
            self.remove_mean,
            out,
        )
        return out

    def _translations(self, poses: int) -> tuple[np.ndarray, np.ndarray]:
        """Grid lines over the box, centred on it."""
        lower, upper = self.problem.xl[:2], self.problem.xu[:2]
        step = self.step_m
        if step is None:
            step = STEP_M
            affordable = (self.evaluator.remaining - PROPOSALS) / poses
            # widen by two per cent at a time until the grid fits, so that nearly all of it is used
            while np.prod(_counts(lower, upper, step)) > affordable and step < (upper - lower).max():
                step *= 1.02
        n_north, n_east = _counts(lower, upper, step)
        centre = (lower + upper) / 2.0
        return (
            np.clip(centre[0] + step * (np.arange(n_north) - n_north // 2), lower[0], upper[0]),
            np.clip(centre[1] + step * (np.arange(n_east) - n_east // 2), lower[1], upper[1]),
        )


def _odd(argument: str, value: int) -> int:
    if at_least(argument, value, 1) % 2 == 0:
        raise InvalidInput(argument, value, "give an odd number, so that no change is among them")
    return value


def _including(neutral: float, lower: float, upper: float, count: int) -> np.ndarray:
    """`count` values over the interval, the middle one moved to `neutral` where that is inside."""
    if count == 1:
        return np.array([float(np.clip(neutral, lower, upper))])
    values = np.linspace(lower, upper, count)
    if lower < neutral < upper:
        half = count // 2
        values = np.concatenate(
            [np.linspace(lower, neutral, half + 1), np.linspace(neutral, upper, half + 1)[1:]]
        )
    return values


def _counts(lower: np.ndarray, upper: np.ndarray, step: float) -> np.ndarray:
    """Odd numbers of grid lines per axis, at least three, none outside the box."""
    return np.maximum(2 * np.floor((upper - lower) / (2.0 * step)).astype(int) + 1, 3)


def _vertex(surface: np.ndarray, a: int, b: int) -> np.ndarray:
    """Minimum of the quadratic fitted to the 3 × 3 neighbourhood of a node, in steps from it, shape (2,).

    Where the neighbourhood is cut by the border, or the fit has no minimum nearby, each axis on its own.
    """
    inner = 0 < a < surface.shape[0] - 1 and 0 < b < surface.shape[1] - 1
    if inner and np.isfinite(surface[a - 1 : a + 2, b - 1 : b + 2]).all():
        p = surface[a - 1 : a + 2, b - 1 : b + 2]
        slope = np.array([p[2].sum() - p[0].sum(), p[:, 2].sum() - p[:, 0].sum()]) / 6.0
        north = (p[2] - 2.0 * p[1] + p[0]).sum() / 3.0
        east = (p[:, 2] - 2.0 * p[:, 1] + p[:, 0]).sum() / 3.0
        mixed = (p[2, 2] - p[2, 0] - p[0, 2] + p[0, 0]) / 4.0
        if north > 0.0 and north * east > mixed * mixed:
            step = -np.linalg.solve([[north, mixed], [mixed, east]], slope)
            if np.abs(step).max() <= 1.0:
                return step
    return np.array([_parabola(surface[:, b], a), _parabola(surface[a], b)])


def _parabola(values: np.ndarray, k: int) -> float:
    """Minimum of the parabola through three neighbours, in steps from the middle one."""
    if k in (0, len(values) - 1):
        return 0.0
    before, here, after = values[k - 1 : k + 2]
    curvature = before - 2.0 * here + after
    if not np.isfinite(curvature) or curvature <= 0.0:
        return 0.0
    return float(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5))
