"""The innovation likelihood of a model's measurements as a function of what is unknown about its noises."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.likelihood_graph import LikelihoodGraph
from baselines.noise_structure import NoiseStructure
from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import LinearGaussianModel, check_covariance

__all__ = ["InnovationObjective", "observed_information"]

Array = NDArray[np.float64]


class InnovationObjective:
    """Negative log-likelihood per measurement as a function of the parameters of a structure.

    Parameters
    ----------
    model : LinearGaussianModel
        The model with its measurements.
    structure : NoiseStructure
        What is looked for.
    prior_mean, prior_sigma : array_like, shape (d,), optional
        A Gaussian prior on the parameters.
    start, stop : int, optional
        Part of the measurements that is used; with fewer than `length` of them the rest is missing.
    length : int, optional
        Steps of the graph, at least ``stop - start``.
    x0, P0 : array_like, optional
        Mean and covariance of the state at `start`, before its measurement; the model's if not given.
    """

    def __init__(
        self,
        model: LinearGaussianModel,
        structure: NoiseStructure,
        *,
        prior_mean: Any = None,
        prior_sigma: Any = None,
        start: int = 0,
        stop: int | None = None,
        length: int | None = None,
        x0: Any = None,
        P0: Any = None,
    ) -> None:
        sizes = structure.process.size, structure.measurement.size
        if sizes != (model.n_noises, model.n_measurements):
            raise InvalidInput(
                "structure",
                f"Q of {sizes[0]} and R of {sizes[1]} rows",
                f"the model has {model.n_noises} process noises and {model.n_measurements} measurements",
            )
        stop = model.n_steps if stop is None else stop
        self.structure, self.steps = structure, stop - start
        length = self.steps if length is None else length
        F, H, G = (_matrices(array, start, length) for array in (model.F, model.H, model.G))
        drive, y = np.zeros((length, model.n_states)), np.full((length, model.n_measurements), np.nan)
        drive[: self.steps], y[: self.steps] = model.drive[start:stop], model.y[start:stop]
        self.G = G
        self.n_seen = max(1, int(np.isfinite(y).sum()))
        self.x0 = np.asarray(model.x0 if x0 is None else x0, dtype=float)
        self.P0 = model.P0 if P0 is None else check_covariance("P0", P0, model.n_states)
        d = structure.n_parameters
        self.prior_mean = np.zeros(d) if prior_mean is None else np.asarray(prior_mean, dtype=float)
        weight = np.zeros(d) if prior_sigma is None else np.asarray(prior_sigma, dtype=float) ** -2.0
        self.prior_weight = np.broadcast_to(weight, (d,))
        reached = np.abs(G).max(axis=0) > 0.0
        W_pattern = (reached @ structure.process_pattern() @ reached.T).astype(bool)
        self.graph = LikelihoodGraph(
            steps=length,
            directions=d,
            F_pattern=(F != 0.0).any(axis=0),
            H_pattern=(H != 0.0).any(axis=0),
            W_pattern=W_pattern,
            diagonal=structure.measurement_is_diagonal(),
        )
        self._fixed = np.ascontiguousarray(self.graph.fixed(F, H, drive, y))
        self._varying = bool((G[:1] != G).any())
        self.passes = 0

    def likelihood(self, theta: Array) -> tuple[float, Array, Array]:
        """Negative log-likelihood, its gradient and its Fisher information, prior apart."""
        Q, R = self.structure.covariances(theta)
        dQ, dR = self.structure.slopes(theta)
        G = self.G if self._varying else self.G[:1]
        turned = np.swapaxes(G, -1, -2)
        W, dW = G @ Q @ turned, G @ dQ[:, None] @ turned
        self.passes += 1
        moving = self.graph.moving(W, R[None], dW, dR[:, None])
        return self.graph.evaluate(self._fixed, moving, self.x0, self.P0)

    def __call__(self, theta: Array) -> tuple[float, Array, Array]:
        """Value, gradient (d,) and information (d, d), with the prior, per measurement."""
        value, gradient, information = self.likelihood(theta)
        away = theta - self.prior_mean
        value += 0.5 * float(self.prior_weight @ away**2)
        gradient = gradient + self.prior_weight * away
        information = information + np.diag(self.prior_weight)
        return value / self.n_seen, gradient / self.n_seen, information / self.n_seen

    def rescaled(self, theta: Array) -> Array:
        """Parameters times the factor that makes innovations as large as the filter thinks they are.

        Multiplying Q, R and P0 by a common factor c leaves the gain as it was, and the likelihood is
        then largest where c is the mean normalised innovation squared. P0 stays as it is, so this is a
        good start and no more.
        """
        _, gradient, _ = self.likelihood(theta)
        # derivative of −log L with respect to ln c at c = 1 is ½ Σ (1 − NIS), if P0 is forgotten
        scale = self.structure.shifted(theta, 1e-3) - theta
        slope = float(gradient @ scale) / 1e-3
        mean_nis = max(1.0 - 2.0 * slope / self.n_seen, 1e-6)
        return self.structure.shifted(theta, float(np.log(mean_nis)))


def _matrices(array: Array, start: int, length: int) -> Array:
    """Matrices of the steps from `start`, constant or not; the last one repeated beyond the end."""
    if array.ndim == 2:
        return np.broadcast_to(array, (length, *array.shape))
    return array[np.minimum(np.arange(start, start + length), len(array) - 1)]


def observed_information(objective: InnovationObjective, theta: Array, step: float = 1e-4) -> Array:
    """Hessian of minus the log posterior by central differences of the exact gradient, shape (d, d)."""
    d = len(theta)
    columns = [
        (objective(theta + step * unit)[1] - objective(theta - step * unit)[1]) / (2.0 * step)
        for unit in np.eye(d)
    ]
    H = np.array(columns) * objective.n_seen
    return 0.5 * (H + H.T)
