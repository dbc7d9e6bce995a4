"""What a tuning problem is answered with, and what a simulated world was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["NoiseEstimate", "NoiseTruth"]


@dataclass(frozen=True)
class NoiseEstimate:
    """Noise covariances of a filter.

    Attributes
    ----------
    Q : ndarray, shape (g, g) or (T, g, g)
        Process noise; one matrix, or one per step.
    R : ndarray, shape (m, m) or (T, m, m)
        Measurement noise.
    """

    Q: np.ndarray
    R: np.ndarray


@dataclass(frozen=True)
class NoiseTruth:
    """What a world was.

    Attributes
    ----------
    states : ndarray, shape (T, n)
        True states.
    Q, R : ndarray or None
        True covariances as in `NoiseEstimate`; None where only the states are known.
    """

    states: np.ndarray
    Q: np.ndarray | None = None
    R: np.ndarray | None = None
