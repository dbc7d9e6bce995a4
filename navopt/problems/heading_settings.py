"""Settings of a filter that aligns with a heading, and their way into decision vectors and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from navopt.algorithms.options import number, one_of
from navopt.errors import InvalidInput, UnknownName
from navopt.filters.fading import StrongTracking
from navopt.filters.noise_adaptation import NoiseAdaptation
from navopt.models.heading_record import VELOCITIES
from navopt.problem import Parameter

__all__ = [
    "FORMULATIONS",
    "PARAMETERS",
    "STRONG",
    "VARIANTS",
    "HeadingSettings",
    "HeadingTruth",
    "default_tuned",
    "make_parameters",
    "settings_at",
    "vector_of",
]

VARIANTS = ("ekf", "ukf", "srukf", "st-ukf", "sst-ukf")
STRONG = ("st-ukf", "sst-ukf")
#: How the heading enters: as the function of the angles that it is; as a state of its own that varies with
#: them; as a state that is independent of them at the start and in its noise, as printed; or not at all.
FORMULATIONS = ("direct", "correlated", "paper", "none")
#: Parameters: name, unit, lower, upper, whether the field holds ten to its power.
PARAMETERS: dict[str, tuple[str, str, float, float, bool]] = {
    "log10_q_accel": ("accel_scale", "1", -2.0, 4.0, True),
    "log10_q_gyro": ("gyro_scale", "1", -2.0, 4.0, True),
    "log10_r_velocity": ("velocity_scale", "1", -2.0, 3.0, True),
    "log10_r_heading": ("heading_scale", "1", -2.0, 3.0, True),
    "forgetting": ("forgetting", "1", 0.1, 1.0, False),
    "weakening": ("weakening", "1", 1.0, 10.0, False),
    "cap": ("cap", "1", 1.0, 2.0, False),
    "log10_spread": ("spread", "1", -3.0, 0.0, True),
}
#: Parameters that only a strong-tracking filter has.
FADING = ("forgetting", "weakening", "cap")


@dataclass(frozen=True, kw_only=True)
class HeadingSettings:
    """A filter for heading-aided alignment with its settings: the answer to `HeadingAlignment`.

    Attributes
    ----------
    variant : {"ekf", "ukf", "srukf", "st-ukf", "sst-ukf"}
        See `navopt.filters.UnscentedFilter`.
    formulation : {"direct", "correlated", "paper", "none"}
        How the heading is used, see `FORMULATIONS`.
    accel_scale, gyro_scale, velocity_scale, heading_scale : float
        Factors to the declared variances of the accelerometers' and the gyros' noise and of the measured
        velocities and headings.
    forgetting, weakening, cap, fades, normalise, factors
        See `navopt.filters.StrongTracking`; only of strong-tracking variants.
    spread : float
        alpha of the sigma points.
    covariance_update : {"joseph", "faded", "printed"}
        See `navopt.filters.UnscentedFilter`.
    velocities : {"clock", "all"}
        When the velocities are used, see `navopt.models.heading_record.HeadingRecord.measurements`.
    heading_state_sigma : float or None
        1 sigma of the heading error at the start, rad, with ``formulation="paper"``; that of the azimuth if
        None.
    adaptation : {None, "sage-husa", "window"}
        Learning of the variances of the measurements in the run, see `navopt.filters.NoiseAdaptation`.
    adaptation_form, adaptation_forgetting, adaptation_window
        Its ``form``, ``forgetting`` and ``window``.

    Raises
    ------
    InvalidInput
        If a variance is scaled by zero or less, forgetting is outside (0, 1], weakening or cap below 1, or
        the spread is not positive.
    UnknownName
        If a choice is not known.
    """

    variant: str = "ukf"
    formulation: str = "direct"
    accel_scale: float = 1.0
    gyro_scale: float = 1.0
    velocity_scale: float = 1.0
    heading_scale: float = 1.0
    forgetting: float = 0.95
    weakening: float = 1.0
    cap: float | None = 1.05
    fades: str = "whole"
    normalise: bool = True
    factors: str = "multiple"
    spread: float = 1e-3
    covariance_update: str = "joseph"
    velocities: str = "clock"
    heading_state_sigma: float | None = None
    adaptation: str | None = None
    adaptation_form: str = "residual"
    adaptation_forgetting: float = 0.99
    adaptation_window: int = 50

    def __post_init__(self) -> None:
        one_of("variant", self.variant, VARIANTS)
        one_of("formulation", self.formulation, FORMULATIONS)
        one_of("velocities", self.velocities, VELOCITIES)
        one_of("covariance_update", self.covariance_update, ("joseph", "faded", "printed"))
        for name in ("accel_scale", "gyro_scale", "velocity_scale", "heading_scale", "spread"):
            number(name, getattr(self, name), above=0.0)
        if self.heading_state_sigma is not None:
            number("heading_state_sigma", self.heading_state_sigma, above=0.0)
        one_of("adaptation", self.adaptation, (None, "sage-husa", "window"))
        self.tracking, self.learning  # noqa: B018 - check their numbers

    @classmethod
    def published(cls, **changes: Any) -> HeadingSettings:
        """Return the filter as paper 002 prints it, as far as its text can be read.

        SST-UKF, a heading state that is independent of the azimuth at the start, one factor on the whole
        covariance from plain traces, no cap, and a covariance update with the factor in the gain alone.
        """
        printed = StrongTracking.published()
        given: dict[str, Any] = {
            "variant": "sst-ukf", "formulation": "paper", "normalise": printed.normalise,
            "factors": printed.factors, "cap": printed.cap,
            "covariance_update": "printed",
        }  # fmt: skip
        return cls(**{**given, **changes})

    @property
    def tracking(self) -> StrongTracking:
        """Options of the fading factors."""
        return StrongTracking(
            forgetting=self.forgetting, weakening=self.weakening, fades=self.fades, normalise=self.normalise,
            factors=self.factors, cap=self.cap,
        )  # fmt: skip

    @property
    def strong(self) -> StrongTracking | None:
        """The same for the variants that have any, else None."""
        return self.tracking if self.variant in STRONG else None

    @property
    def learning(self) -> NoiseAdaptation | None:
        """Options of the adaptation, if there is any."""
        if self.adaptation is None:
            return None
        return NoiseAdaptation(
            kind=self.adaptation, form=self.adaptation_form, forgetting=self.adaptation_forgetting,
            window=self.adaptation_window,
        )  # fmt: skip

    def apply(self, problem: Any) -> HeadingSettings:
        """Return itself: settings that were found once are those of the filter on any other data."""
        return self

    @property
    def has_heading_state(self) -> bool:
        """Whether the state has eleven entries."""
        return self.formulation in ("correlated", "paper")


@dataclass(frozen=True)
class HeadingTruth:
    """What a world was.

    Attributes
    ----------
    states : ndarray, shape (K, 11)
        True errors at the ticks of the measurements' clock.
    accel_scale, gyro_scale, velocity_scale, heading_scale : float
        Variances of the noise over the declared ones, where they are constant.
    """

    states: np.ndarray
    accel_scale: float = 1.0
    gyro_scale: float = 1.0
    velocity_scale: float = 1.0
    heading_scale: float = 1.0


def default_tuned(settings: HeadingSettings) -> tuple[str, ...]:
    """Names of what is tuned if nobody says which: the noises, and the fading where there is any."""
    names = [name for name in PARAMETERS if name.startswith(("log10_q", "log10_r"))]
    if settings.formulation == "none":
        names.remove("log10_r_heading")
    if settings.variant in STRONG:
        names += FADING
    return tuple(names)


def make_parameters(
    settings: HeadingSettings, tuned: Sequence[str], box: Mapping[str, tuple[float, float]] | None
) -> list[Parameter]:
    """Return the unknowns of a problem.

    Parameters
    ----------
    settings : HeadingSettings
        Whose values are the nominal ones.
    tuned : sequence of str
        Names among `PARAMETERS`.
    box : mapping, optional
        Bounds by name, where they differ from the usual ones.

    Returns
    -------
    list of Parameter

    Raises
    ------
    InvalidInput
        If a name appears twice, means nothing for the filter, or bounds are out of order.
    """
    limits = {} if box is None else dict(box)
    for name in (*tuned, *limits):
        if name not in PARAMETERS:
            raise UnknownName("tuned" if name in tuned else "box", name, PARAMETERS)
    for name in limits:
        if name not in tuned:
            raise InvalidInput("box", name, f"give bounds of what is tuned: {', '.join(tuned)}")
    if not tuned or len(set(tuned)) < len(tuned):
        raise InvalidInput("tuned", tuple(tuned), "give different names of parameters, one or more")
    out = []
    for name in tuned:
        if name in FADING and settings.variant not in STRONG:
            raise InvalidInput("tuned", name, f"{settings.variant} has none: take variant='sst-ukf'")
        if name == "log10_spread" and settings.variant == "ekf":
            raise InvalidInput("tuned", name, "an ekf has no sigma points")
        if name == "log10_r_heading" and settings.formulation == "none":
            raise InvalidInput("tuned", name, "no heading is used")
        field, unit, lower, upper, power = PARAMETERS[name]
        lower, upper = (float(v) for v in limits.get(name, (lower, upper)))
        value = getattr(settings, field)
        if value is None:
            # no cap at all: as much as the box has
            value = upper
        nominal = float(np.log10(value)) if power else float(value)
        out.append(Parameter(name, unit, lower, upper, float(np.clip(nominal, lower, upper))))
    return out


def settings_at(settings: HeadingSettings, tuned: Sequence[str], x: np.ndarray) -> HeadingSettings:
    """Return settings with the values of a decision vector, shape (n_var,)."""
    changes = {}
    for name, value in zip(tuned, x.tolist(), strict=True):
        field, _, _, _, power = PARAMETERS[name]
        changes[field] = 10.0**value if power else value
    return replace(settings, **changes)


def vector_of(settings: Any, tuned: Sequence[str], nominal: np.ndarray) -> np.ndarray:
    """Return the decision vector of settings, or of anything with some of their fields, shape (n_var,)."""
    x = nominal.copy()
    for k, name in enumerate(tuned):
        field, _, _, upper, power = PARAMETERS[name]
        if not hasattr(settings, field):
            continue
        value = getattr(settings, field)
        value = upper if value is None else float(value)
        x[k] = np.log10(value) if power else value
    return x
