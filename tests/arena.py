"""Problems on which every registered solver is held to its contract."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

import navopt
from navopt.problem import EstimationProblem, Parameter
from navopt.problems.analytic import Sphere
from navopt.problems.gravity_matching import GravityMatching
from navopt.problems.gyro_calibration import GyroCalibration
from navopt.problems.heading_alignment import HeadingAlignment
from navopt.problems.noise_tuning import NoiseTuning

SOLVERS = navopt.list_solvers()


class Altered(EstimationProblem):
    """Another problem with its losses passed through a function of (losses, X)."""

    def __init__(
        self, inner: EstimationProblem, change: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> None:
        self.inner = inner
        self.change = change
        self.provides = inner.provides
        self.truth, self.true_x = inner.truth, inner.true_x
        super().__init__([Parameter(p.name, p.unit, p.lower, p.upper, p.nominal) for p in inner.parameters])

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or "inner" not in self.__dict__:
            raise AttributeError(name)
        return getattr(self.__dict__["inner"], name)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return self.change(self.inner._loss(X), X)

    def _residuals(self, X: np.ndarray) -> np.ndarray:
        return self.inner._residuals(X)

    def _jacobian(self, X: np.ndarray) -> np.ndarray:
        return self.inner._jacobian(X)

    def prior(self) -> tuple[np.ndarray, np.ndarray] | None:
        return self.inner.prior()

    def estimate(self, x: np.ndarray) -> Any:
        return self.inner.estimate(x)

    def project(self, estimate: Any) -> np.ndarray:
        return self.inner.project(estimate)

    def _score(self, estimate: Any) -> dict[str, float]:
        return self.inner._score(estimate)


@lru_cache(maxsize=256)
def world(name: str, seed: int = 0) -> EstimationProblem:
    """One world of a problem that suits a solver: the plain sphere, or the problem it was made for."""
    if "triad" in navopt.solver_info(name).needs:
        # well inside the box, whatever the noise
        return navopt.simulate("gyro-calibration", seed, scale_spread_ppm=200.0, noise={"deg_sqrt_h": 0.0005})
    if "heading-filter" in navopt.solver_info(name).needs:
        # the truth is not what the data sheet says, which is what these solvers answer
        return navopt.simulate(
            "heading-alignment", seed, duration_s=5.0, rate_hz=10.0, imu_noise_factor=2.0,
            velocity_noise_factor=1.5, heading_noise_factor=1.5,
        )  # fmt: skip
    if "linear-gaussian" in navopt.solver_info(name).needs:
        return navopt.simulate("noise-tuning", seed, steps=120)
    if navopt.solver_info(name).needs:
        return navopt.simulate("gravity-matching", seed, hours=2.0)
    return navopt.simulate("sphere", seed, n_var=4)


def hostile_boxes(name: str) -> dict[str, EstimationProblem]:
    """Boxes that trip algorithms which assume the origin inside, symmetry or a common scale."""
    if not navopt.solver_info(name).needs:
        return {
            "all negative": Sphere([-7.0, -3.0, -9.0], lower=[-8.0, -4.0, -1e3], upper=[-6.0, -2.0, -1.0]),
            "asymmetric": Sphere([-0.5, 900.0, 1e-3], lower=[-1.0, -5.0, 0.0], upper=[300.0, 1e3, 1e-2]),
            "far from zero": Sphere([1e6 + 1.0, -1e6], lower=[1e6, -1e6 - 2], upper=[1e6 + 3, -1e6 + 1]),
        }
    base = world(name)
    if isinstance(base, GyroCalibration):
        return hostile_gyros(base)
    if isinstance(base, NoiseTuning):
        return hostile_noises(base)
    if isinstance(base, HeadingAlignment):
        sides = {"all negative": (-5.0, -4.0), "asymmetric": (-0.1, 4.0), "far from zero": (5.0, 5.5)}
        return {
            label: HeadingAlignment(base.record, truth=base.truth, box=dict.fromkeys(base.tuned, side))
            for label, side in sides.items()
        }
    assert isinstance(base, GravityMatching)
    boxes = {
        "all negative": [[-9e3, -2e3], [-8e3, -1e3], [-0.3, -0.1], [0.8, 0.9]],
        "asymmetric": [[-200.0, 9e3], [-9e3, 300.0], [-0.01, 0.3], [0.99, 1.4]],
        "far from zero": [[20e3, 23e3], [-30e3, -28e3], [1.0, 1.1], [2.0, 2.1]],
    }
    return {
        label: GravityMatching(
            base.field_map, base.track, prior_covariance=base.prior()[1], box=np.array(box)
        )
        for label, box in boxes.items()
    }


def hostile_noises(base: NoiseTuning) -> dict[str, EstimationProblem]:
    """Boxes of logarithms that miss the true variances, or reach far to one side of them."""
    model = base.model
    scales = {
        "all negative": [[-3.0, -1.0], [-2.0, -0.1]],
        "asymmetric": [[-0.5, 4.0], [-6.0, 0.1]],
        "far from zero": [[2.0, 4.0], [3.0, 3.5]],
    }
    return {
        label: NoiseTuning(model.F, model.H, model.y, G=model.G, P0=model.P0, box=np.array(box))
        for label, box in scales.items()
    }


def hostile_gyros(base: GyroCalibration) -> dict[str, EstimationProblem]:
    """Boxes that miss the preset or reach far to one side of it, in units of the box about it."""
    width = (base.xu - base.xl)[:, None]
    sides = {
        "all negative": [-3.0, -2.0],
        "asymmetric": [-0.1, 4.0],
        "far from zero": [30.0, 31.0],
    }
    return {
        label: GyroCalibration(
            base.counts,
            latitude=base.latitude,
            noise=base.noise,
            fixed=base.preset,
            turntable_counts=base.turntable_counts,
            turntable_rates=base.turntable_rates,
            box=base.nominal[:, None] + width * np.array(side),
        )
        for label, side in sides.items()
    }
