"""The paper's window matched by its posterior: the INS's errors with their full covariance."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from baselines.posterior_baseline import LOOK_UPS, PosteriorBaseline, built
from baselines.track_estimate import TrackEstimate, summarise
from baselines.track_hypotheses import Search, descend, merge, origin
from navopt.algorithms.options import at_least
from navopt.problems.gravity_posterior import TrackPosterior
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.problems.gravity_window import window_posterior
from navopt.registry import solver

__all__ = ["WindowMAP"]

Array = NDArray[np.float64]

#: Directions of the prior over which the points are spread: a shift, a turn and a stretch.
WIDEST = 4


@solver(
    "window-map",
    summary="maximum a posteriori over the window, with the full covariance of the INS errors",
    source="Levenberg-Marquardt with a prior and Sobol multi-start (this library)",
    needs=("track",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it ends when its descents have converged",
        "comparison_based": "it uses the values and slopes of the map, not the order of losses",
    },
)
class WindowMAP(PosteriorBaseline):
    """Match the last samples by maximising the posterior of their position errors (MAP).

    The unknowns are the position errors of all samples of the window, with their prior covariance, in its
    eigenbasis: a shift, then the rotations, stretches and bends that the INS can make. Where the problem
    has a covariance for its four parameters only, these are the unknowns. Many points of the prior, spread
    as a Sobol sequence, are looked at; Levenberg–Marquardt descends from the best of them, and the modes
    found are weighed by their probability.

    Parameters
    ----------
    points : int
        Number of points looked at; a power of two spreads best.
    starts : int
        Number of descents.
    measurement_errors : MeasurementErrors or mapping, optional
        1σ of the errors of measurement and map; what the problem declares if not given.
    huber : float, optional
        Whitened residuals larger than this count linearly, so that outliers do little harm; 2.5 is usual.
    answer : {"mode", "mean"}
        Report the most probable mode, or the mean over the modes.
    keep : int
        Largest number of modes that count.
    prune : float
        Modes with less than exp(−prune) of the probability of the best are left out.
    steps : int
        Largest number of steps of a descent.
    gate_sigma_m, gate_probability, gate_gain : float
        When the answer counts as known, see `baselines.track_estimate.Gate`.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    The answer is attached as a `TrackEstimate` of the window; ``solution.x`` is its projection. One unit of
    the budget is as many map look-ups as one loss; the two slopes at a point count as two look-ups more.
    """

    def __init__(
        self,
        *,
        points: int = 2048,
        starts: int = 32,
        measurement_errors: Any = None,
        huber: float | None = None,
        answer: str = "mode",
        keep: int = 16,
        prune: float = 12.0,
        steps: int = 20,
        gate_sigma_m: float = 2000.0,
        gate_probability: float = 0.95,
        gate_gain: float = 0.7,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.points, self.starts = at_least("points", points, 1), at_least("starts", starts, 1)
        self.steps = at_least("steps", steps, 1)
        self._declare(
            measurement_errors=measurement_errors,
            huber=huber,
            answer=answer,
            keep=keep,
            prune=prune,
            gate_sigma_m=gate_sigma_m,
            gate_probability=gate_probability,
            gate_gain=gate_gain,
        )

    def match(self, problem: Any) -> TrackEstimate:
        """Match a problem's window.

        Parameters
        ----------
        problem : GravityMatching
            Its truth is not looked at.

        Returns
        -------
        TrackEstimate
        """
        errors = built("measurement_errors", self.measurement_errors, MeasurementErrors)
        posterior = window_posterior(problem, errors=errors, huber=self.huber)
        search = Search(
            keep=self.keep, prune=self.prune, wide=np.inf, renew=np.inf, steps=self.steps,
            allow=self.allow, spend=self.spend,
        )  # fmt: skip
        fits = []
        for start in self._starts(posterior, problem.window):
            fit = descend(posterior, [start], search)
            if fit is None:
                break
            fits += fit
        modes = merge(fits, search) if fits else [origin(posterior)]
        return summarise(
            posterior,
            modes,
            window=problem.window,
            used=problem.window if fits else 0,
            gate=self.gate,
            names=posterior.names,
            answer=self.answer,
        )

    def _starts(self, posterior: TrackPosterior, window: int) -> Array:
        """Where to descend from: the best of points spread over the prior's widest directions."""
        wide = min(WIDEST, posterior.n_coefficients)
        sobol = qmc.Sobol(wide, scramble=False).random_base2(int(np.ceil(np.log2(self.points))))
        # half of what a budget leaves is for the descents
        affordable = LOOK_UPS * self.allow(window) / 2.0
        points = np.zeros((int(max(1, min(self.points, affordable))), posterior.n_coefficients))
        # the first point of the sequence is the corner, which stands for no change here
        points[1:, :wide] = ndtri(sobol[1 : len(points)])
        if len(points) == 1:
            return points
        self.book(len(points))
        order = np.argsort(posterior.costs(points), kind="stable")
        return points[order[: self.starts]]
