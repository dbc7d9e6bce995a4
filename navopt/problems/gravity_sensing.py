"""What is declared about the measurements of a matching problem: the errors a careful user expects."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from navopt.errors import InvalidInput

__all__ = ["MeasurementErrors"]


@dataclass(frozen=True, kw_only=True)
class MeasurementErrors:
    """Standard deviations of what separates a measured value from the mapped one.

    All values in the map's unit (mGal for gravity). The truth of a world plays no part in it.

    Parameters
    ----------
    noise : float
        White noise of a sample.
    map_error : float
        Error of the map along the track.
    map_error_length : float
        Distance run, in metres, over which the correlation of the map error falls to 1/e:
        ``map_error² exp(−Δs / length)``.
    bias : float
        Unknown constant offset (datum, gravimeter bias).
    drift_per_day : float
        Unknown constant drift of the sensor, unit per day.
    eotvos : bool
        Whether the measurements were reduced with the velocity of the INS. Then an error of it of
        1 m/s to the east is an error of 2 ω cos φ = 14.58 cos φ mGal.

    Raises
    ------
    InvalidInput
        If a value is not finite or negative, or the noise or the length is zero.
    """

    noise: float = 1.0
    map_error: float = 0.0
    map_error_length: float = 4e3
    bias: float = 0.0
    drift_per_day: float = 0.0
    eotvos: bool = False

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "eotvos":
                if not isinstance(value, bool | np.bool_):
                    raise InvalidInput("eotvos", value, "give True or False")
                continue
            positive = item.name in ("noise", "map_error_length")
            number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
            if not number or not np.isfinite(value) or value < 0.0 or (positive and value == 0.0):
                raise InvalidInput(
                    item.name, value, f"give a {'positive' if positive else 'non-negative'} number"
                )
            object.__setattr__(self, item.name, float(value))
