"""The extended Kalman filter, with exact Jacobians where there are any."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.filters.fading import StrongTracking
from navopt.filters.noise_adaptation import NoiseAdaptation
from navopt.filters.nonlinear import NonlinearFilter
from navopt.filters.unscented_kernels import wrap
from navopt.filters.unscented_steps import NO_ROOT, SOUND, make_root, predict_linear

__all__ = ["STEP", "ExtendedFilter"]

#: Relative step of central differences: the cube root of the rounding error, which leaves most digits right.
STEP = float(np.cbrt(np.finfo(float).eps))


class ExtendedFilter(NonlinearFilter):
    """Extended Kalman filter of anyone's model; with `strong`, the strong-tracking filter of Zhou and Frank.

    Parameters
    ----------
    process, measure, Q, R, P0, x0, angles, strong, adaptation, covariance_update, square_root
        As in `UnscentedFilter`.
    process_jacobian : callable, optional
        ``process_jacobian(x (n,), u, dt) -> (n, n)``. Otherwise central differences are taken, with steps of
        6e-6 times the state or its standard deviation, whichever is larger.
    measure_jacobian : callable, optional
        ``measure_jacobian(x (n,)) -> (m, n)``; otherwise as for the process.

    Raises
    ------
    InvalidInput
        If a shape does not fit, a covariance is none, or a number is out of range.
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
        process_jacobian: Callable[..., np.ndarray] | None = None,
        measure_jacobian: Callable[..., np.ndarray] | None = None,
        angles: tuple[int, ...] = (),
        strong: StrongTracking | None = None,
        adaptation: NoiseAdaptation | None = None,
        covariance_update: str = "joseph",
        square_root: bool = False,
    ) -> None:
        super().__init__(
            process,
            measure,
            Q=Q,
            R=R,
            P0=P0,
            x0=x0,
            angles=angles,
            strong=strong,
            adaptation=adaptation,
            covariance_update=covariance_update,
            square_root=square_root,
        )
        for name, given in (("process_jacobian", process_jacobian), ("measure_jacobian", measure_jacobian)):
            if given is not None and not callable(given):
                raise InvalidInput(name, type(given).__name__, "give a function, or None")
        self.process_jacobian, self.measure_jacobian = process_jacobian, measure_jacobian
        self.variant = "ekf"

    def _around(self) -> tuple[np.ndarray, np.ndarray]:
        """The estimate and the states before and behind it in each direction, and twice the steps."""
        x = self._memory.x
        steps = STEP * np.maximum(np.abs(x), np.sqrt(np.maximum(np.diagonal(self._memory.P), 0.0)))
        steps[steps == 0.0] = STEP
        states = np.concatenate([x[None], x + np.diag(steps), x - np.diag(steps)])
        n = len(x)
        # steps as they came out after rounding
        return states, np.diagonal(states[1 : n + 1] - states[n + 1 :]).copy()

    def _predict(self, u: Any, dt: float, Q: np.ndarray, root: np.ndarray) -> int:
        n, memory = len(self.P0), self._memory
        if self._options.root and make_root(memory) != SOUND:
            return NO_ROOT
        if self.process_jacobian is not None:
            moved = self._images(self.process(memory.x[None].copy(), u, dt), (1, n), "process")[0]
            F = self._images(self.process_jacobian(memory.x.copy(), u, dt), (n, n), "process_jacobian")
        else:
            states, steps = self._around()
            images = self._images(self.process(states, u, dt), states.shape, "process")
            moved = images[0].copy()
            F = np.ascontiguousarray(((images[1 : n + 1] - images[n + 1 :]) / steps[:, None]).T)
        return int(predict_linear(self._options, memory, moved, F, Q, root))

    def _slope(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        n, m, x = len(self.P0), len(self.R), self._memory.x
        extra = np.zeros((m, m))
        if self.H is not None:
            return self.H @ x, self.H, extra, SOUND
        if self.measure_jacobian is not None:
            predicted = self._images(self.measure(x[None].copy()), (1, m), "measure")[0]
            return (
                predicted,
                self._images(self.measure_jacobian(x.copy()), (m, n), "measure_jacobian"),
                extra,
                SOUND,
            )
        states, steps = self._around()
        images = self._images(self.measure(states), (2 * n + 1, m), "measure")
        change = images[1 : n + 1] - images[n + 1 :]
        for j in np.flatnonzero(self._wrapped):
            change[:, j] = [wrap(value) for value in change[:, j]]
        return images[0].copy(), np.ascontiguousarray((change / steps[:, None]).T), extra, SOUND
