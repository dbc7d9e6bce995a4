"""Process noise of an alignment as a sum of its five sources, each with a weight of its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.models.static_alignment import STATES
from navopt.problem import Parameter
from navopt.problems.noise_parameters import CovarianceForm

__all__ = ["SourceForm"]


@dataclass(frozen=True)
class SourceForm(CovarianceForm):
    """``Q = sum of 10^x_i Q_i``, with Q_i what a noise of the data sheet on state i adds in a step.

    A diagonal matrix would not do for long steps: angle noise reaches the velocities within a step, and the
    entries that couple them are as large as those on the diagonal.

    Attributes
    ----------
    sources : ndarray, shape (g, g, g)
        The Q_i; `reference` is their sum.
    """

    sources: np.ndarray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        super().__post_init__()
        sources = np.array(self.sources, dtype=float)
        if sources.shape != (self.size,) * 3:
            raise InvalidInput("sources", sources.shape, f"give {self.size} matrices like the reference")
        sources.setflags(write=False)
        object.__setattr__(self, "sources", sources)

    @classmethod
    def of(cls, sources: np.ndarray) -> SourceForm:
        """Make one from the sources alone."""
        return cls("Q", "scalar", np.sum(sources, axis=0), False, sources)

    @property
    def n_scales(self) -> int:
        """Number of weights."""
        return self.size

    @property
    def n_parameters(self) -> int:
        """Number of parameters: the weights."""
        return self.size

    def parameters(self, lower: float, upper: float, nominal: float) -> list[Parameter]:
        """Logarithms of the weights, each named by its state."""
        start = float(np.clip(nominal, lower, upper))
        return [Parameter(f"log10_q_{state}", "1", lower, upper, start) for state in STATES[: self.size]]

    def matrices(self, X: np.ndarray) -> np.ndarray:
        """Covariances of decision vectors, (K, g) -> (K, g, g)."""
        with np.errstate(over="ignore"):
            weights = 10.0**X
        out = np.zeros((len(X), self.size, self.size))
        # summed in a fixed order: a candidate must not depend on its company
        for k in range(self.size):
            out = out + weights[:, k, None, None] * self.sources[k]
        return out

    def vector(self, matrix: Any) -> np.ndarray:
        """Logarithms of the weights that give the variances of a covariance, as far as any can."""
        from scipy.optimize import nnls

        size = np.diag(self.reference)
        columns = np.diagonal(self.sources, axis1=1, axis2=2).T / size[:, None]
        wanted = np.diag(matrix) / size
        weights = np.linalg.solve(columns, wanted)
        if not (weights > 0.0).all():
            weights = nnls(columns, wanted)[0]
        return np.log10(np.maximum(weights, np.finfo(float).tiny))

    def directions(self, x: np.ndarray) -> np.ndarray:
        """Derivatives of the covariance by the parameters, shape (g, g, g)."""
        return (np.log(10.0) * 10.0 ** np.asarray(x))[:, None, None] * self.sources
