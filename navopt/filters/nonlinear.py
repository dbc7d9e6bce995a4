"""What unscented and extended filters have in common: inputs, steps, whole records, what went wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.algorithms.options import one_of
from navopt.errors import InvalidInput, NumericalFault
from navopt.filters.fading import StrongTracking
from navopt.filters.measurement_steps import correct, fade
from navopt.filters.noise_adaptation import KINDS, NoiseAdaptation
from navopt.filters.unscented_kernels import factorise
from navopt.filters.unscented_steps import (
    CAUSES,
    FADED,
    JOSEPH,
    PRINTED,
    SOUND,
    Memory,
    Options,
    make_memory,
    make_root,
)
from navopt.models.linear_gaussian import check_covariance, check_finite

__all__ = ["COVARIANCE_UPDATES", "FilterRun", "NonlinearFilter", "as_options", "check_times"]

#: How the covariance is renewed at a measurement, see `NonlinearFilter`.
COVARIANCE_UPDATES = {"joseph": JOSEPH, "faded": FADED, "printed": PRINTED}


@dataclass(frozen=True)
class FilterRun:
    """What a filter did with a record.

    Attributes
    ----------
    times : ndarray, shape (T,)
        In s.
    estimates, covariances : ndarray, shapes (T, n) and (T, n, n)
        After the measurement of each time, if there was one.
    innovations, innovation_covariances : ndarray, shapes (T, m) and (T, m, m)
        Measured minus predicted, and the covariance that the filter used, fading included; NaN where a
        measurement is missing.
    nis : ndarray, shape (T,)
        Normalised innovation squared; 0 where all are missing.
    fading_factors : ndarray, shape (T, m)
        Factor of each channel (one for all if single); NaN where missing.
    measurement_variances : ndarray, shape (T, m)
        Variances of the measurement noise that were used.
    log_likelihood : float
        Of the innovations; ``-inf`` if the filter failed.
    failed : str or None
        Step, time and cause of a failure. From that step on the arrays hold NaN.
    failed_step : int or None
        The step.
    """

    times: np.ndarray
    estimates: np.ndarray
    covariances: np.ndarray
    innovations: np.ndarray
    innovation_covariances: np.ndarray
    nis: np.ndarray
    fading_factors: np.ndarray
    measurement_variances: np.ndarray
    log_likelihood: float
    failed: str | None
    failed_step: int | None


def check_times(times: Any, name: str = "times") -> np.ndarray:
    """Times as an array, if they are finite and increase.

    Raises
    ------
    InvalidInput
    """
    try:
        t = np.array(times, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(name, times, "give numbers, in s") from None
    if t.ndim != 1 or not len(t):
        raise InvalidInput(name, f"shape {t.shape}", "give one time for each step, shape (T,)")
    check_finite(name, t)
    late = np.flatnonzero(np.diff(t) <= 0.0)
    if len(late):
        k = int(late[0]) + 1
        raise InvalidInput(
            f"{name}[{k}]", f"{t[k]:g} s after {t[k - 1]:g} s", "give times that increase from row to row"
        )
    return t


def as_options(
    strong: StrongTracking | None,
    adaptation: NoiseAdaptation | None,
    covariance_update: str,
    square_root: bool,
) -> Options:
    """Settings as compiled code takes them; unknown names are refused."""
    one_of("covariance_update", covariance_update, tuple(COVARIANCE_UPDATES))
    options = Options(root=square_root, form=COVARIANCE_UPDATES[covariance_update])
    if strong is not None:
        options = options._replace(
            strong=True,
            forgetting=float(strong.forgetting),
            weakening=float(strong.weakening),
            process_only=strong.fades == "process",
            normalise=bool(strong.normalise),
            multiple=strong.factors == "multiple",
            cap=np.inf if strong.cap is None else float(strong.cap),
        )
    if adaptation is not None:
        options = options._replace(
            adapt=KINDS[adaptation.kind],
            residual_form=adaptation.form == "residual",
            learning=float(adaptation.forgetting),
            burn_in=int(adaptation.burn_in),
            low=float(adaptation.low),
            high=float(adaptation.high),
        )
    return options


class NonlinearFilter:
    """Base of `UnscentedFilter` and `ExtendedFilter`, which say how a prediction and a slope are found.

    Parameters are those of `UnscentedFilter`.
    """

    def __init__(
        self,
        process: Callable[..., np.ndarray],
        measure: Any,
        *,
        Q: Any,
        R: Any,
        P0: Any,
        x0: Any = None,
        angles: tuple[int, ...] = (),
        strong: StrongTracking | None = None,
        adaptation: NoiseAdaptation | None = None,
        covariance_update: str = "joseph",
        square_root: bool = False,
    ) -> None:
        if not callable(process):
            raise InvalidInput(
                "process", type(process).__name__, "give a function of states, input and time step"
            )
        self.process, self.measure = process, measure
        self.P0 = check_covariance("P0", P0, _size("P0", P0))
        self.R = check_covariance("R", R, _size("R", R), definite=True)
        n, m = len(self.P0), len(self.R)
        self.H: np.ndarray | None = None
        if not callable(measure):
            self.H = np.array(measure, dtype=float)
            if self.H.shape != (m, n):
                raise InvalidInput(
                    "measure", f"shape {self.H.shape}", f"give a matrix ({m}, {n}) or a function"
                )
            check_finite("measure", self.H)
        self._Q = Q if callable(Q) else check_covariance("Q", Q, n)
        self.x0 = np.zeros(n) if x0 is None else np.array(x0, dtype=float)
        if self.x0.shape != (n,):
            raise InvalidInput("x0", f"shape {self.x0.shape}", f"give {n} states")
        check_finite("x0", self.x0)
        self._wrapped = np.zeros(m, dtype=bool)
        for channel in angles:
            if not 0 <= channel < m:
                raise InvalidInput("angles", angles, f"give numbers of channels, from 0 to {m - 1}")
            self._wrapped[channel] = True
        self.strong, self.adaptation = strong, adaptation
        self._options = as_options(strong, adaptation, covariance_update, square_root)
        self._states = np.full(m, -1) if strong is None else strong.faded_states(self.H, n, m)
        self._window = adaptation.window if adaptation is not None and adaptation.kind == "window" else 1
        self._noise: tuple[float, np.ndarray, np.ndarray] | None = None
        self._memory: Memory
        self.reset()

    def reset(self) -> None:
        """Go back to the beginning."""
        self._memory = make_memory(self.x0, self.P0, self.R, self._window)
        self._step = 0
        self.nis, self.log_likelihood = 0.0, 0.0
        m = len(self.R)
        self.innovation, self.innovation_covariance = np.full(m, np.nan), np.full((m, m), np.nan)
        if self._options.root and make_root(self._memory) != SOUND:
            raise InvalidInput("P0", "not positive semi-definite", "give a covariance")
        self._memory.transition[:] = self._memory.root

    # -- state -----------------------------------------------------------------------------------------
    @property
    def x(self) -> np.ndarray:
        """Present estimate, shape (n,)."""
        return self._memory.x.copy()

    @property
    def P(self) -> np.ndarray:
        """Present covariance, shape (n, n)."""
        return self._memory.P.copy()

    @property
    def fading_factors(self) -> np.ndarray:
        """Factors of the last measurement, shape (m,)."""
        return self._memory.factors.copy()

    @property
    def measurement_variances(self) -> np.ndarray:
        """Variances of the measurement noise that the next measurement will be used with, shape (m,)."""
        return self._memory.variances.copy()

    # -- steps -----------------------------------------------------------------------------------------
    def predict(self, dt: float, u: Any = None) -> None:
        """Go on by one step.

        Parameters
        ----------
        dt : float
            Length of the step, s.
        u : object
            Input, handed to the process as it is.

        Raises
        ------
        InvalidInput
            If the step has no positive length or the process gives another shape.
        NumericalFault
            If the covariance is not positive definite or the states are not finite.
        """
        if not (np.isfinite(dt) and dt > 0.0):
            raise InvalidInput("dt", dt, "give a positive time step, in s")
        self._raise(self._predict(u, float(dt), *self._process_noise(float(dt))))
        self._step += 1

    def update(self, z: Any) -> None:
        """Use a measurement.

        Parameters
        ----------
        z : array_like, shape (m,)
            NaN where a channel is missing.

        Raises
        ------
        InvalidInput
            If the shape is wrong or an entry is infinite.
        NumericalFault
            If a covariance is not positive definite.
        """
        m = len(self.R)
        z = np.array(z, dtype=float)
        if z.shape != (m,):
            raise InvalidInput("z", f"shape {z.shape}", f"give {m} channels, NaN where one is missing")
        if np.isinf(z).any():
            raise InvalidInput("z", z.tolist(), "give NaN where a channel is missing")
        if np.isnan(z).all():
            self._memory.factors[:] = np.nan
            self.innovation, self.innovation_covariance = np.full(m, np.nan), np.full((m, m), np.nan)
            self.nis = 0.0
            return
        self._raise(self._update(z))

    def _update(self, z: np.ndarray) -> int:
        memory, options = self._memory, self._options
        predicted, H, extra, code = self._slope()
        if code == SOUND:
            code = fade(options, memory, self.R, H, extra, predicted, z, self._wrapped, self._states)
        if code == SOUND and self._again:
            predicted, H, extra, code = self._slope()
        if code != SOUND:
            return code
        code, self.nis, likelihood = correct(
            options, memory, self.R, H, extra, predicted, z, self._wrapped,
            self.innovation, self.innovation_covariance,
        )  # fmt: skip
        self.log_likelihood += likelihood
        return int(code)

    #: Whether the slope is found again once the covariance has faded.
    _again = False

    def _predict(self, u: Any, dt: float, Q: np.ndarray, root: np.ndarray) -> int:
        raise NotImplementedError

    def _slope(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        raise NotImplementedError

    def _process_noise(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Q and its root, found again only when the step has another length."""
        if self._noise is None or (callable(self._Q) and self._noise[0] != dt):
            n = len(self.P0)
            Q = check_covariance(f"Q({dt:g})", self._Q(dt), n) if callable(self._Q) else self._Q
            root = np.zeros((n, n))
            if factorise(Q, root) >= 0:
                raise InvalidInput("Q", "not positive semi-definite", "give a covariance")
            self._noise = dt, Q, root
        return self._noise[1:]

    def _images(self, values: Any, shape: tuple[int, int], name: str) -> np.ndarray:
        """What a function of the user gave, as a fresh array of the right shape."""
        result = np.array(values, dtype=float, order="C")
        if result.shape != shape:
            raise InvalidInput(
                name, f"a result of shape {result.shape}", f"return {shape} for {shape[0]} states"
            )
        return result

    def _raise(self, code: int) -> None:
        if code != SOUND:
            raise NumericalFault(f"step {self._step}: {CAUSES[code]}")

    # -- records ---------------------------------------------------------------------------------------
    def run(self, times: Any, measurements: Any, inputs: Any = None) -> FilterRun:
        """Filter a whole record from the beginning.

        Parameters
        ----------
        times : array_like, shape (T,)
            In s, increasing; the initial state is that of the first, before its measurement.
        measurements : array_like, shape (T, m)
            NaN where one is missing; `align_measurements` makes it from sensors with rates of their own.
        inputs : sequence of length T, optional
            Input from each time to the next; the last is not used.

        Returns
        -------
        FilterRun
            A filter that fails says so in `FilterRun.failed`, and nothing is raised.

        Raises
        ------
        InvalidInput
            If shapes do not fit or times do not increase.
        """
        t = check_times(times)
        T, m, n = len(t), len(self.R), len(self.P0)
        z = np.array(measurements, dtype=float)
        if z.shape != (T, m):
            raise InvalidInput(
                "measurements", f"shape {z.shape}", f"give ({T}, {m}), NaN where one is missing"
            )
        if np.isinf(z).any():
            raise InvalidInput("measurements", "infinite entries", "give NaN where one is missing")
        if inputs is not None and len(inputs) != T:
            raise InvalidInput("inputs", f"length {len(inputs)}", f"give one for each of {T} times")
        shapes = ((n,), (n, n), (m,), (m, m), (), (m,), (m,))
        kept = [np.full((T, *shape), np.nan) for shape in shapes]
        self.reset()
        failed: tuple[int, str] | None = None
        for k in range(T):
            used = self.measurement_variances
            try:
                if k:
                    self.predict(t[k] - t[k - 1], None if inputs is None else inputs[k - 1])
                self.update(z[k])
            except NumericalFault as fault:
                cause = str(fault).partition(": ")[2]
                failed = k, f"at step {k} ({t[k]:g} s): {cause}"
                break
            row = (
                self._memory.x, self._memory.P, self.innovation, self.innovation_covariance, self.nis,
                self._memory.factors, used,
            )  # fmt: skip
            for array, value in zip(kept, row, strict=True):
                array[k] = value
        x, P, innovations, S, nis, factors, variances = kept
        likelihood = self.log_likelihood if failed is None else -np.inf
        step, reason = failed if failed is not None else (None, None)
        return FilterRun(
            t, x, P, innovations, S, nis, factors, variances,
            log_likelihood=likelihood, failed=reason, failed_step=step,
        )  # fmt: skip


def _size(name: str, value: Any) -> int:
    shape = np.shape(value)
    if len(shape) != 2 or shape[0] != shape[1] or not shape[0]:
        raise InvalidInput(name, f"shape {shape}", "give a square matrix")
    return int(shape[0])
