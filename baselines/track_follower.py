"""The recursive form of the track match: one measurement at a time, a position and a covariance then."""

from __future__ import annotations

import numpy as np

from baselines.track_estimate import Gate, TrackEstimate, summarise
from baselines.track_hypotheses import Mode, Search, descend, merge, origin, seeds
from baselines.track_model import TrackModel
from navopt.data.tracks import MeasuredTrack
from navopt.errors import InvalidInput
from navopt.models.cruise import InsErrors
from navopt.models.field_map import FieldMap
from navopt.problems.gravity_sensing import MeasurementErrors

__all__ = ["TrackFollower"]


class TrackFollower:
    """A track match that grows by one sample at a time, as on board.

    Nothing of the future is used: the error shapes are made for the track so far, and the modes are
    carried over to them.

    Parameters
    ----------
    field_map : FieldMap
        The map.
    ins_errors : InsErrors
        1σ of the INS's errors.
    measurement_errors : MeasurementErrors
        1σ of the errors of measurement and map.
    search : Search
        How modes are looked for and kept.
    method : {"bilinear", "bicubic"}, optional
        Interpolation.
    huber : float, optional
        Whitened residuals larger than this count linearly.
    window : int
        Number of last samples that an estimate puts forward.
    first : int
        Samples before the first match; until then the INS is reported.
    gate : Gate
        When an answer counts as known.
    answer : {"mode", "mean"}
        Report the most probable mode, or the mean over the modes.
    """

    def __init__(
        self,
        field_map: FieldMap,
        ins_errors: InsErrors,
        measurement_errors: MeasurementErrors,
        *,
        search: Search,
        method: str | None = None,
        huber: float | None = None,
        window: int = 12,
        first: int = 6,
        gate: Gate | None = None,
        answer: str = "mode",
    ) -> None:
        self.field_map, self.ins_errors, self.measurement_errors = field_map, ins_errors, measurement_errors
        self.search, self.method, self.huber = search, method, huber
        self.window, self.first, self.answer = window, max(2, first), answer
        self.gate = gate or Gate()
        self._samples: list[tuple[float, float, float, float]] = []
        self._headings: list[float | None] = []
        self._model: TrackModel | None = None
        self._modes: list[Mode] = []

    def __len__(self) -> int:
        return len(self._samples)

    def add(
        self, time: float, latitude: float, longitude: float, measured: float, heading: float | None = None
    ) -> TrackEstimate | None:
        """Take one sample and return where the vehicle is.

        Parameters
        ----------
        time : float
            Seconds, later than that of the sample before.
        latitude, longitude : float
            Position the INS shows, rad.
        measured : float
            Field measured, in the map's unit.
        heading : float, optional
            Heading the INS shows, rad; for all samples or for none.

        Returns
        -------
        TrackEstimate or None
            None for the very first sample, from which no motion can be seen.

        Raises
        ------
        InvalidInput
            If the time does not increase, a value is not finite, or only some samples have a heading.
        """
        if self._headings and (heading is None) != (self._headings[0] is None):
            raise InvalidInput("heading", heading, "give it for all samples or for none")
        if self._samples and not time > self._samples[-1][0]:
            raise InvalidInput("time", time, f"give a time after the last one, {self._samples[-1][0]:g} s")
        row = (time, latitude, longitude, measured)
        if not np.isfinite([value for value in (*row, heading) if value is not None]).all():
            raise InvalidInput("sample", row, "give finite values")
        self._samples.append(row)
        self._headings.append(heading)
        if len(self) < 2:
            return None
        columns = np.array(self._samples).T
        track = MeasuredTrack(
            time=columns[0],
            latitude=columns[1],
            longitude=columns[2],
            measured=columns[3],
            heading=None if heading is None else np.array(self._headings, dtype=float),
        )
        model = TrackModel(
            self.field_map, track, self.ins_errors, self.measurement_errors,
            method=self.method, huber=self.huber, remember=False,
        )  # fmt: skip
        used = 0
        if len(self) < self.first:
            modes = [origin(model.posterior)]
        else:
            modes, used = self._match(model), len(self)
        self._model, self._modes = model, modes
        return summarise(
            model.posterior,
            modes,
            window=min(self.window, len(self)),
            used=used,
            gate=self.gate,
            names=model.names,
            answer=self.answer,
        )

    def _match(self, model: TrackModel) -> list[Mode]:
        """Carry the modes over to the longer track and descend."""
        starts = [origin(model.posterior)]
        if self._model is not None:
            old = self._model
            carried = [model.carry(old, mode.a) for mode in self._modes]
            information = model.posterior.information(carried[0], stop=len(self) - 1)
            model.linearise(carried[0], information)
            starts = [Mode(a, 0.0, model.posterior.information(a, stop=len(self) - 1), 0.0) for a in carried]
        posterior = model.posterior
        points = [mode.a for mode in starts]
        for mode in starts[: self.search.explore]:
            points += seeds(posterior, mode, len(self) - 1, self.search.wide)
        fits = descend(posterior, points, self.search)
        return starts[:1] if fits is None else merge(fits, self.search)
