"""What the estimators that work with a steady filter need: a constant model and its gain."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.errors import UnsuitableProblem
from navopt.filters.steady_state import steady_state
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["require_constant", "steady", "steady_gain", "transient"]

Array = NDArray[np.float64]


def require_constant(model: LinearGaussianModel, name: str) -> None:
    """Refuse a model that varies or lacks measurements, saying what an estimator needs.

    Parameters
    ----------
    model : LinearGaussianModel
        What it is asked to work on.
    name : str
        Name of the estimator, for the message.

    Raises
    ------
    UnsuitableProblem
    """
    for letter in "FHG":
        matrix = getattr(model, letter)
        if matrix.ndim != 2:
            raise UnsuitableProblem(
                f"{name} needs a constant model: {letter} has shape {matrix.shape}, one matrix per time; "
                "innovation-likelihood and em take such models"
            )
    missing = np.argwhere(np.isnan(model.y))
    if len(missing):
        k, channel = (int(i) for i in missing[0])
        raise UnsuitableProblem(
            f"{name} needs all measurements: y[{k}, {channel}] is missing, and {len(missing) - 1} more; "
            "innovation-likelihood and em take such data"
        )


def steady(model: LinearGaussianModel, Q: Any, R: Any) -> tuple[Array, Array]:
    """Prior covariance and gain of the steady state, shapes (n, n) and (n, m).

    Raises
    ------
    InvalidInput
        If there is no steady state with these covariances.
    """
    settled = steady_state(model.F, model.H, Q, R, G=model.G)
    return settled.predicted_covariance, settled.gain


def steady_gain(model: LinearGaussianModel, Q: Any, R: Any) -> Array:
    """Gain of the measurement update in the steady state, shape (n, m).

    Raises
    ------
    InvalidInput
        If there is no steady state with these covariances.
    """
    return steady(model, Q, R)[1]


def transient(model: LinearGaussianModel) -> int:
    """Innovations left out at the beginning: 100, or a fifth of them if they are fewer than 500."""
    return min(100, model.n_steps // 5)
