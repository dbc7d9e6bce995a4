"""Fast filters of whole records of heading-aided alignment, many settings and worlds at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from navopt.algorithms.options import at_least, one_of
from navopt.errors import InvalidInput
from navopt.filters.extended import STEP
from navopt.filters.fading import StrongTracking
from navopt.filters.heading_kernels import EXTENDED, ONE, THREE, filter_record
from navopt.filters.noise_adaptation import NoiseAdaptation
from navopt.filters.nonlinear import as_options, check_times
from navopt.filters.unscented import UNSCENTED, check_spread
from navopt.filters.unscented_kernels import factorise
from navopt.filters.unscented_steps import CAUSES, SOUND, make_memory, make_root
from navopt.models.linear_gaussian import check_covariance, check_finite

__all__ = ["HEADING_AID", "HeadingFilter", "HeadingInputs", "HeadingRun", "filter_heading", "filter_headings"]

#: How the measured heading is used: as the function of the angles that it is, as a state of its own, or not.
HEADING_AID = ("direct", "state", "none")
#: Length of the vector of inputs of `navopt.models.azimuth_error`.
INPUTS = 22


@dataclass(frozen=True)
class HeadingInputs:
    """What was measured, and the inputs of the error model.

    Attributes
    ----------
    times : ndarray, shape (T,)
        In s, increasing.
    measurements : ndarray, shape (T, 3)
        Velocity errors east and north (m/s) and computed minus measured heading (rad); NaN where missing.
    constants : ndarray, shape (22,) or (T, 22)
        Inputs of `navopt.models.azimuth_error.advance` from each time to the next; the last row is not used.
    measurement_constants : ndarray, shape (22,) or (T, 22), optional
        Inputs of its `heading_measurement` at each time; those of the steps by default.

    Raises
    ------
    InvalidInput
        If a shape does not fit or times do not increase.
    """

    times: np.ndarray
    measurements: np.ndarray
    constants: np.ndarray
    measurement_constants: np.ndarray | None = None

    def __post_init__(self) -> None:
        t = check_times(self.times)
        T = len(t)
        z = np.ascontiguousarray(self.measurements, dtype=float)
        if z.shape != (T, 3):
            raise InvalidInput("measurements", f"shape {z.shape}", f"give ({T}, 3), NaN where one is missing")
        if np.isinf(z).any():
            raise InvalidInput("measurements", "infinite entries", "give NaN where one is missing")
        _set = object.__setattr__
        _set(self, "times", t)
        _set(self, "measurements", z)
        for name in ("constants", "measurement_constants"):
            given = self.constants if getattr(self, name) is None else getattr(self, name)
            c = np.ascontiguousarray(np.atleast_2d(np.asarray(given, dtype=float)))
            if c.shape not in ((1, INPUTS), (T, INPUTS)):
                raise InvalidInput(name, f"shape {c.shape}", f"give ({INPUTS},) or ({T}, {INPUTS})")
            check_finite(name, c)
            _set(self, name, c)


@dataclass(frozen=True, kw_only=True)
class HeadingFilter:
    """One filter with its settings.

    Attributes
    ----------
    Q : ndarray, shape (n, n) or (T - 1, n, n)
        Covariance of the process noise added in a step.
    R : ndarray, shape (3, 3)
        Covariance of the measurement noise.
    P0 : ndarray, shape (n, n)
        Covariance of the first state.
    x0 : ndarray, shape (n,), optional
        Its mean; zeros by default.
    variant : {"ekf", "ukf", "srukf", "st-ukf", "sst-ukf"}
        Kind of filter.
    heading : {"direct", "state", "none"}
        Heading measured as a function of the angles (n = 10, or 11 with an idle state), as a state of its own
        (n = 11), or left out.
    alpha, beta, kappa, strong, adaptation, covariance_update, square_root
        As in `UnscentedFilter`.

    Raises
    ------
    InvalidInput
        If a covariance is none or a name is unknown.
    """

    Q: np.ndarray
    R: np.ndarray
    P0: np.ndarray
    x0: np.ndarray | None = None
    variant: str = "ukf"
    heading: str = "direct"
    alpha: float = 1e-3
    beta: float = 2.0
    kappa: float = 0.0
    strong: StrongTracking | None = None
    adaptation: NoiseAdaptation | None = None
    covariance_update: str = "joseph"
    square_root: bool | None = None
    _prepared: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        one_of("variant", self.variant, ("ekf", *UNSCENTED))
        one_of("heading", self.heading, HEADING_AID)
        n = len(np.atleast_1d(self.P0))
        if n not in (10, 11) or (self.heading == "state" and n != 11):
            raise InvalidInput(
                "P0",
                f"{n} states with heading={self.heading!r}",
                "give 11 states, or 10 without the heading error",
            )
        P0 = check_covariance("P0", self.P0, n)
        Q = check_covariance("Q", self.Q, n)
        Q = np.ascontiguousarray(Q[None] if Q.ndim == 2 else Q)
        roots = np.empty_like(Q)
        for k in range(len(Q)):
            if factorise(Q[k], roots[k]) >= 0:
                raise InvalidInput("Q", f"matrix {k} is not positive semi-definite", "give covariances")
        R = check_covariance("R", self.R, 3, definite=True)
        x0 = np.zeros(n) if self.x0 is None else np.array(self.x0, dtype=float)
        if x0.shape != (n,):
            raise InvalidInput("x0", f"shape {x0.shape}", f"give {n} states")
        check_finite("x0", x0)
        H = np.zeros((3, n))
        H[0, 0] = H[1, 1] = 1.0
        if self.heading == "state":
            H[2, 5] = 1.0
        strong = self.strong
        if self.variant in ("st-ukf", "sst-ukf"):
            strong = StrongTracking() if strong is None else strong
        elif strong is not None and self.variant != "ekf":
            raise InvalidInput(
                "strong", f"given with {self.variant!r}", "use the variant 'sst-ukf', 'st-ukf' or 'ekf'"
            )
        states = np.full(3, -1)
        if strong is not None and strong.factors == "multiple":
            # the heading that is a function of the angles is first of all that about up
            states = np.array([0, 1, {"state": 5, "direct": 4, "none": -1}[self.heading]])
            if strong.states is not None:
                states = strong.faded_states(H, n, 3)
        root = self.variant == "srukf" if self.square_root is None else bool(self.square_root)
        spread = (STEP, 0.0, 0.0)
        if self.variant != "ekf":
            spread = check_spread(n, self.alpha, self.beta, self.kappa)
        window = self.adaptation.window if self.adaptation and self.adaptation.kind == "window" else 1
        self._prepared.update(
            kind={"ekf": EXTENDED, "st-ukf": THREE}.get(self.variant, ONE),
            options=as_options(strong, self.adaptation, self.covariance_update, root),
            spread=spread,
            H=H,
            states=states.astype(np.int64),
            noise=(Q, roots, R),
            x0=x0,
            P0=P0,
            window=window,
        )


@dataclass(frozen=True)
class HeadingRun:
    """What one filter did with one record; K of T times are kept of the states.

    Attributes
    ----------
    times : ndarray, shape (K,)
        Times of the states kept, s.
    estimates, deviations : ndarray, shape (K, n)
        States and their 1-sigma, after the measurement.
    covariances : ndarray, shape (K, n, n) or (0, n, n)
        If asked for.
    innovations, innovation_variances : ndarray, shape (T, 3)
        NaN where a measurement is missing.
    nis : ndarray, shape (T,)
        Normalised innovation squared; 0 where all are missing.
    fading_factors, measurement_variances : ndarray, shape (T, 3)
        Factor of each channel (NaN where missing), and the variances of the measurement noise used.
    log_likelihood : float
        ``-inf`` if the filter failed.
    failed : str or None
        Step, time and cause of a failure; NaN from that step on.
    failed_step : int or None
        The step.
    """

    times: np.ndarray
    estimates: np.ndarray
    deviations: np.ndarray
    covariances: np.ndarray
    innovations: np.ndarray
    innovation_variances: np.ndarray
    nis: np.ndarray
    fading_factors: np.ndarray
    measurement_variances: np.ndarray
    log_likelihood: float
    failed: str | None
    failed_step: int | None


def filter_heading(
    record: HeadingInputs, settings: HeadingFilter, *, thin: int = 1, covariances: bool = False
) -> HeadingRun:
    """Filter one record with one setting.

    The numbers are those of `UnscentedFilter` and `ExtendedFilter` with the functions of
    `navopt.models.azimuth_error`, to rounding; everything is compiled. Where only velocities
    are measured their matrix is used and no sigma points are drawn.

    Parameters
    ----------
    record : HeadingInputs
        Measurements and inputs.
    settings : HeadingFilter
        Which filter.
    thin : int, default 1
        States are kept at every `thin`-th time, from the first on.
    covariances : bool, default False
        Whether covariances are kept too.

    Returns
    -------
    HeadingRun

    Raises
    ------
    InvalidInput
        If the process noise has another number of steps than the record.
    """
    thin = at_least("thin", thin, 1)
    part, T = settings._prepared, len(record.times)
    n, kept = len(part["x0"]), -(-T // thin)
    Q, _, R = part["noise"]
    if len(Q) not in (1, T - 1):
        raise InvalidInput("Q", f"{len(Q)} steps", f"give one matrix, or {T - 1} for {T} times")
    memory = make_memory(part["x0"], part["P0"], R, part["window"])
    if part["options"].root:
        make_root(memory)
        memory.transition[:] = memory.root
    z = record.measurements
    if settings.heading == "none":
        z = z.copy()
        z[:, 2] = np.nan
    shapes = ((kept, n), (kept if covariances else 0, n, n), (kept, n), (T, 3), (T, 3), (T,), (T, 3), (T, 3))
    results = tuple(np.full(shape, np.nan) for shape in shapes)
    lengths = np.diff(record.times) if T > 1 else np.ones(1)
    wrapped = np.array([False, False, True])
    code, step, likelihood = filter_record(
        part["kind"], part["options"], memory, part["spread"], settings.heading == "direct",
        (lengths, record.constants, record.measurement_constants, part["H"], wrapped, part["states"]),
        part["noise"], (z,), thin, results,
    )  # fmt: skip
    estimates, matrices, deviations, innovations, variances, nis, factors, used = results
    failed = None
    if code != SOUND:
        failed = f"at step {step} ({record.times[step]:g} s): {CAUSES[code]}"
        for array in (innovations, variances, nis, factors, used):
            array[step:] = np.nan
    return HeadingRun(
        record.times[::thin], estimates, deviations, matrices, innovations, variances, nis, factors, used,
        likelihood, failed, None if failed is None else int(step),
    )  # fmt: skip


def filter_headings(
    records: Sequence[HeadingInputs],
    settings: Sequence[HeadingFilter],
    *,
    thin: int = 1,
    covariances: bool = False,
) -> list[list[HeadingRun]]:
    """Filter each record with each setting: a list of settings for each record.

    Parameters
    ----------
    records, settings : sequence
        Worlds, and filters.
    thin, covariances
        As in `filter_heading`.
    """
    return [[filter_heading(r, s, thin=thin, covariances=covariances) for s in settings] for r in records]
