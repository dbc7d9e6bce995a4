"""What a tuning problem is answered with, and what a simulated world was."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import LinearGaussianModel, check_covariance

__all__ = ["NoiseEstimate", "NoiseTruth", "checked_truth"]


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


def checked_truth(truth: NoiseTruth, model: LinearGaussianModel) -> NoiseTruth:
    """Copy of a truth whose arrays fit a model and cannot be written to.

    Parameters
    ----------
    truth : NoiseTruth
        As given by a user.
    model : LinearGaussianModel
        What it belongs to.

    Returns
    -------
    NoiseTruth

    Raises
    ------
    InvalidInput
        If a shape does not fit, an entry is not finite, a matrix is no covariance, or one of Q and R is
        missing.
    """
    states = np.array(truth.states, dtype=float)
    if states.shape != (model.n_steps, model.n_states) or not np.isfinite(states).all():
        raise InvalidInput(
            "truth.states", states.shape, f"give finite states, shape {(model.n_steps, model.n_states)}"
        )
    if (truth.Q is None) != (truth.R is None):
        raise InvalidInput("truth", "only one of Q and R", "give both or neither")
    states.setflags(write=False)
    return NoiseTruth(
        states,
        _checked_covariance("truth.Q", truth.Q, model.n_noises, model.n_steps),
        _checked_covariance("truth.R", truth.R, model.n_measurements, model.n_steps),
    )


def _checked_covariance(name: str, given: Any, size: int, steps: int) -> np.ndarray | None:
    if given is None:
        return None
    checked = check_covariance(name, given, size)
    if checked.ndim > 2 and checked.shape != (steps, size, size):
        shapes = f"shape ({size}, {size}), or ({steps}, {size}, {size}) if it varies"
        raise InvalidInput(name, f"shape {checked.shape}", f"give {shapes}")
    # the numbers as given: `check_covariance` makes them symmetric to the last bit
    matrix = np.array(given, dtype=float)
    matrix.setflags(write=False)
    return matrix
