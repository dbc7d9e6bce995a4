"""The whole voyage matched at once: the most probable errors of the INS, given all that was measured."""

from __future__ import annotations

from typing import Any

from baselines.posterior_baseline import PosteriorBaseline, built
from baselines.track_estimate import TrackEstimate, summarise
from baselines.track_follower import TrackFollower
from baselines.track_hypotheses import Search, follow, horizons
from baselines.track_model import TrackModel, declared_errors
from navopt.algorithms.options import at_least, number
from navopt.models.cruise import InsErrors
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.registry import solver

__all__ = ["TrackMAP"]


@solver(
    "track-map",
    summary="maximum a posteriori over the INS's error sources, from all measurements since departure",
    source="Gauss-Newton on the track posterior with a growing horizon (this library)",
    needs=("track",),
    stochastic=False,
    spends_all=False,
    comparison_based=False,
    reasons={
        "spends_all": "it ends when its descents have converged",
        "comparison_based": "it uses the values and slopes of the map, not the order of losses",
    },
)
class TrackMAP(PosteriorBaseline):
    """Match the whole track by maximising the posterior of the error sources (MAP).

    The unknowns are the errors of the INS: gyro and accelerometer biases, initial errors, the shapes
    that sensor noise gives to the track, and bias and drift of the gravimeter, each with its declared
    standard deviation. The position error along the track is linear in them. Levenberg–Marquardt descends
    on the first hour and then on ever longer parts of the track, so that the answer of one is a good start
    of the next; wherever the position is not known well, descents also start around each mode, and the
    modes found are kept while they are probable. The error of the map is correlated along the track.

    Parameters
    ----------
    ins_errors : InsErrors or mapping, optional
        1σ of the INS's error sources; what the problem declares if not given
        (`baselines.track_model.declared_errors`).
    measurement_errors : MeasurementErrors or mapping, optional
        1σ of the errors of measurement and map; what the problem declares if not given.
    huber : float, optional
        Whitened residuals larger than this count linearly, so that outliers do little harm; 2.5 is usual.
    answer : {"mode", "mean"}
        Report the most probable mode, or the mean over the modes.
    keep : int
        Largest number of modes followed.
    prune : float
        Modes with less than exp(−prune) of the probability of the best are given up.
    spread_m : float
        Other modes are looked for where the predicted position is not known better than this (1σ).
    first, step : int
        Samples of the first part of the track, and by how many it grows each time.
    gate_sigma_m, gate_probability, gate_gain : float
        When the answer counts as known: largest standard deviation, least probability of its mode, least
        information gained; see `baselines.track_estimate.Gate`.
    **kwargs
        Keywords of `pymoo.core.algorithm.Algorithm`.

    Notes
    -----
    The answer is attached as a `TrackEstimate`, which is not clipped to the box; ``solution.x`` is its
    projection. One unit of the budget is as many map look-ups as one loss; the two slopes at a point
    count as two look-ups more. A budget that is too small ends the search early: the rest of the track is
    then predicted from what was used.

    Nothing but the inertial track with its heading, the measurements, the map and the declared errors is
    looked at. Without the heading the course over ground stands in for it.
    """

    def __init__(
        self,
        *,
        ins_errors: Any = None,
        measurement_errors: Any = None,
        huber: float | None = None,
        answer: str = "mode",
        keep: int = 8,
        prune: float = 12.0,
        spread_m: float = 700.0,
        first: int = 6,
        step: int = 5,
        gate_sigma_m: float = 2000.0,
        gate_probability: float = 0.95,
        gate_gain: float = 0.7,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        built("ins_errors", ins_errors, InsErrors)
        self.ins_errors = ins_errors
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
        self.spread_m = number("spread_m", spread_m, above=0.0)
        self.first, self.step = at_least("first", first, 2), at_least("step", step, 1)

    @property
    def search(self) -> Search:
        """How modes are looked for, within the budget of the run."""
        return Search(
            keep=self.keep,
            prune=self.prune,
            wide=self.spread_m,
            renew=1.3,
            allow=self.allow,
            spend=self.spend,
        )

    def errors_of(self, problem: Any) -> tuple[InsErrors, MeasurementErrors]:
        """Standard deviations used for a problem: those given, else those it declares."""
        ins = built("ins_errors", self.ins_errors, InsErrors)
        sensing = built("measurement_errors", self.measurement_errors, MeasurementErrors)
        if ins is None or sensing is None:
            declared = declared_errors(problem)
            ins, sensing = ins or declared[0], sensing or declared[1]
        return ins, sensing

    def model(self, problem: Any) -> TrackModel:
        """Posterior of a problem's track, linear about the INS."""
        return TrackModel(
            problem.field_map,
            problem.track,
            *self.errors_of(problem),
            method=problem.method,
            huber=self.huber,
        )

    def match(self, problem: Any) -> TrackEstimate:
        """Match a problem's whole track.

        Parameters
        ----------
        problem : GravityMatching
            Its truth is not looked at.

        Returns
        -------
        TrackEstimate
        """
        model = self.model(problem)
        stages = horizons(len(model.posterior), self.first, self.step)
        modes, used = follow(model, stages, self.search)
        return summarise(
            model.posterior,
            modes,
            window=problem.window,
            used=used,
            gate=self.gate,
            names=model.names,
            answer=self.answer,
        )

    def begin(self, problem: Any) -> TrackFollower:
        """Start a recursive match: measurements are given one at a time, each with the INS position.

        Parameters
        ----------
        problem : GravityMatching
            Its map and declared errors are used, its track is not.

        Returns
        -------
        TrackFollower
        """
        ins, sensing = self.errors_of(problem)
        return TrackFollower(
            problem.field_map,
            ins,
            sensing,
            search=self.search,
            method=problem.method,
            huber=self.huber,
            window=problem.window,
            first=self.first,
            gate=self.gate,
            answer=self.answer,
        )
