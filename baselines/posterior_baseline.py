"""What the matchers that maximise a posterior share: the budget, the attached estimate, the re-run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from baselines.base import Baseline
from baselines.track_estimate import Gate, TrackEstimate
from navopt.algorithms.options import at_least, number, one_of
from navopt.errors import InvalidInput, UnknownName
from navopt.models.cruise import InsErrors
from navopt.problems.gravity_sensing import MeasurementErrors
from navopt.registry import make_solver

__all__ = ["LOOK_UPS", "Fitted", "PosteriorBaseline", "built"]

#: A value of the map is one look-up, its two slopes are counted as two more.
LOOK_UPS = 3


def built(argument: str, value: Any, kind: type) -> Any:
    """Return `value` if it is None or of the kind, or make one of a mapping of its fields."""
    if value is None or isinstance(value, kind):
        return value
    if isinstance(value, Mapping):
        known = [item.name for item in fields(kind)]
        for key in value:
            if key not in known:
                raise UnknownName(argument, str(key), known)
        return kind(**value)
    raise InvalidInput(argument, value, f"give a {kind.__name__}, a mapping of its fields or None")


@dataclass(frozen=True)
class Fitted:
    """A matcher with its settings, to be run on other data.

    Attributes
    ----------
    solver : str
        Registry name.
    settings : dict
        Its settings, plain values.
    """

    solver: str
    settings: dict[str, Any]

    def apply(self, problem: Any) -> TrackEstimate:
        """Match the track of another problem with the same settings."""
        algorithm: Any = make_solver(self.solver, **self.settings)
        estimate: TrackEstimate = algorithm.match(problem)
        return estimate


class PosteriorBaseline(Baseline):
    """A baseline that attaches a `TrackEstimate` and proposes its projection.

    A subclass implements `match`, which asks `allow` before it looks the map up and books with `spend`.
    One unit of the budget is as many look-ups as the loss makes for one candidate: those of a window.
    """

    estimate: TrackEstimate | None = None
    fitted: Fitted | None = None
    _metered = False
    _window = 1

    def _declare(
        self,
        *,
        measurement_errors: Any,
        huber: float | None,
        answer: str,
        keep: int,
        prune: float,
        gate_sigma_m: float,
        gate_probability: float,
        gate_gain: float,
    ) -> None:
        """Check and keep the options that all of them have."""
        built("measurement_errors", measurement_errors, MeasurementErrors)
        self.measurement_errors = measurement_errors
        self.huber = None if huber is None else number("huber", huber, above=0.0)
        self.answer = one_of("answer", answer, ("mode", "mean"))
        self.keep = at_least("keep", keep, 1)
        self.prune = number("prune", prune, above=0.0)
        self.gate_sigma_m = number("gate_sigma_m", gate_sigma_m, above=0.0)
        self.gate_probability = number("gate_probability", gate_probability, above=0.0, most=1.0)
        self.gate_gain = number("gate_gain", gate_gain)

    @property
    def gate(self) -> Gate:
        """When the answer counts as known."""
        return Gate(sigma_m=self.gate_sigma_m, probability=self.gate_probability, gain=self.gate_gain)

    def match(self, problem: Any) -> TrackEstimate:
        """Match a problem's track, outside any budget unless called by the run itself."""
        raise NotImplementedError

    def propose(self) -> np.ndarray:
        """Projection of the estimate, shape (1, n_var)."""
        self._metered, self._window = True, self.problem.window
        try:
            self.estimate = self.match(self.problem)
        finally:
            self._metered = False
        plain = {
            key: asdict(value) if isinstance(value, InsErrors | MeasurementErrors) else value
            for key, value in self.settings.items()
        }
        self.fitted = Fitted(self.solver_info.name, plain)
        return self.problem.project(self.estimate)[None]

    def allow(self, samples: int) -> float:
        """Evaluations of value and slopes at so many samples that the budget has room for."""
        if not self._metered or self.evaluator.budget is None:
            return np.inf
        # one unit is left for the loss of the answer
        units = (self.evaluator.remaining - 1) * self._window
        return max(0.0, units // (LOOK_UPS * samples) if samples else 0.0)

    def book(self, units: int) -> None:
        """Book evaluations of values alone for a whole window: one unit each."""
        if self._metered:
            self.evaluator.charge(units)

    def spend(self, evaluations: int, samples: int) -> None:
        """Book evaluations of value and slopes at so many samples."""
        if self._metered:
            self.evaluator.charge(math.ceil(LOOK_UPS * evaluations * samples / self._window))
