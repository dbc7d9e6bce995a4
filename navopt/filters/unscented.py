"""Unscented filters: plain, square-root, and strong tracking with three transforms or one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from navopt.algorithms.options import number, one_of
from navopt.errors import InvalidInput
from navopt.filters.fading import StrongTracking
from navopt.filters.noise_adaptation import NoiseAdaptation
from navopt.filters.nonlinear import NonlinearFilter
from navopt.filters.unscented_kernels import linearise, spread_points, weights
from navopt.filters.unscented_steps import NO_ROOT, SOUND, make_root, predict_moments

__all__ = ["UNSCENTED", "UnscentedFilter", "check_spread"]

#: Names of the variants.
UNSCENTED = ("ukf", "srukf", "st-ukf", "sst-ukf")


def check_spread(n: int, alpha: float, beta: float, kappa: float) -> tuple[float, float, float]:
    """Results of `unscented_kernels.weights`, once the parameters are known to be usable.

    Raises
    ------
    InvalidInput
        If alpha is not positive, beta negative, or ``n + kappa`` not positive.
    """
    number("alpha", alpha, above=0.0)
    if number("beta", beta) < 0.0:
        raise InvalidInput("beta", beta, "give a number not below 0; 2 suits Gaussian states")
    if not n + number("kappa", kappa) > 0.0:
        raise InvalidInput(
            "kappa", kappa, f"give more than -{n}, the number of states; 0 and 3 - n are usual"
        )
    scale, each, centre = weights(n, float(alpha), float(beta), float(kappa))
    return scale, each, centre


class UnscentedFilter(NonlinearFilter):
    """Unscented Kalman filter of anyone's model, plain or strong tracking.

    Parameters
    ----------
    process : callable
        ``process(states (P, n), u, dt) -> (P, n)``: P states one step later.
    measure : array_like, shape (m, n), or callable
        Matrix H, or ``measure(states (P, n)) -> (P, m)``. With a matrix no second transform is made.
    Q : array_like, shape (n, n), or callable
        Covariance of the process noise added in a step, or a function of the step's length in s.
    R : array_like, shape (m, m)
        Covariance of the measurement noise.
    P0 : array_like, shape (n, n)
        Covariance of the state before the first measurement; may be singular.
    x0 : array_like, shape (n,), optional
        Its mean; zeros by default.
    variant : {"ukf", "srukf", "st-ukf", "sst-ukf"}
        Plain; carrying the root of the covariance; strong tracking with three transforms per step (process,
        measurement, and measurement again with the faded covariance); strong tracking with one (paper
        002), which is the same filter where the measurement is linear.
    alpha, beta, kappa : float
        Spread of the sigma points (van der Merwe 2004).
    angles : tuple of int
        Channels that are angles in radians: differences are brought into [−π, π).
    strong : StrongTracking, optional
        Of the strong-tracking variants.
    adaptation : NoiseAdaptation, optional
        Learns the variances of the measurement noise, with any variant.
    covariance_update : {"joseph", "faded", "printed"}
        ``(I − K H) λP⁻ (I − K H)ᵀ + K R Kᵀ``, positive by construction; ``λP⁻ − K S Kᵀ``, the same number
        with more rounding; ``P⁻ − K S Kᵀ`` with λ in K and S only, which is one reading of the printed
        algorithm and loses positive definiteness where ``λ (λ − 1) H P⁻ Hᵀ > R``.
    square_root : bool, optional
        Whether the root of the covariance is carried; as the variant has it by default.

    Raises
    ------
    InvalidInput
        If a shape does not fit, a covariance is none, or a number is out of range.

    Notes
    -----
    Sigma points are drawn anew from the predicted covariance, process noise included, before a measurement
    that is a function: so does filterpy, and the numbers are the same. SST-UKF with a function for its
    measurement keeps the slope H and the spread Ω found before fading, ``S = H λP⁻ Hᵀ + Ω + R``.
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
        variant: str = "ukf",
        alpha: float = 1e-3,
        beta: float = 2.0,
        kappa: float = 0.0,
        angles: tuple[int, ...] = (),
        strong: StrongTracking | None = None,
        adaptation: NoiseAdaptation | None = None,
        covariance_update: str = "joseph",
        square_root: bool | None = None,
    ) -> None:
        self.variant = one_of("variant", variant, UNSCENTED)
        if variant in ("st-ukf", "sst-ukf"):
            strong = StrongTracking() if strong is None else strong
        elif strong is not None:
            raise InvalidInput("strong", f"given with {variant!r}", "use the variant 'sst-ukf' or 'st-ukf'")
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
            square_root=variant == "srukf" if square_root is None else bool(square_root),
        )
        n = len(self.P0)
        self._spread = check_spread(n, alpha, beta, kappa)
        self._points = np.empty((2 * n + 1, n))
        self._again = variant == "st-ukf"

    @property
    def points_per_step(self) -> int:
        """How many sigma points are moved or measured in a step with a measurement."""
        transforms = {"st-ukf": 3}.get(self.variant, 1 if self.H is not None else 2)
        return transforms * len(self._points)

    def _draw(self) -> int:
        code = make_root(self._memory)
        if code == SOUND:
            spread_points(self._memory.x, self._memory.root, self._spread[0], self._points)
            # before a function of the user meets them
            code = SOUND if np.isfinite(self._points).all() else NO_ROOT
        return int(code)

    def _predict(self, u: Any, dt: float, Q: np.ndarray, root: np.ndarray) -> int:
        code = self._draw()
        if code != SOUND:
            return code
        moved = self._images(self.process(self._points, u, dt), self._points.shape, "process")
        return int(predict_moments(self._options, self._memory, moved, *self._spread[1:], Q, root))

    def _slope(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        n, m = len(self.P0), len(self.R)
        H, extra, predicted = self.H, np.zeros((m, m)), np.empty(m)
        if H is not None and not self._again:
            return H @ self._memory.x, H, extra, SOUND
        code = self._draw()
        slope = np.zeros((m, n))
        if code == SOUND:
            seen = self._points @ H.T if H is not None else self.measure(self._points)
            images = self._images(seen, (2 * n + 1, m), "measure")
            linearise(
                images, self._wrapped, self._memory.root, *self._spread, predicted, slope, extra
            )  # fmt: skip
        return predicted, slope, extra, code
