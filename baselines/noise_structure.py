"""Which noise covariances are looked for: sums of known matrices with unknown weights, or full ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navopt.algorithms.options import one_of
from navopt.errors import InvalidInput, UnsuitableProblem
from navopt.models.linear_gaussian import check_covariance

__all__ = ["KINDS", "NoisePart", "NoiseStructure"]

Array = NDArray[np.float64]

#: How far log-variances may go from the reference: a factor of three million either way.
REACH = 15.0
#: How far the factors off the diagonal may go, in standard deviations of the reference.
REACH_OFF = 30.0
#: What may be looked for in a covariance.
KINDS = ("scalar", "diagonal", "full", "fixed")


@dataclass(frozen=True)
class NoisePart:
    """One covariance matrix as a function of its parameters.

    Attributes
    ----------
    size : int
        Number of rows.
    basis : ndarray, shape (k, size, size), or None
        The covariance is the sum of these with weights exp θ; None stands for a full matrix, with
        θ the lower triangle of a Cholesky factor row by row, its diagonal by the logarithm.
    fixed : ndarray, shape (size, size)
        What is known and added to a sum of `basis`.
    scale : ndarray, shape (size,)
        Standard deviations by which a full matrix is made dimensionless.
    """

    size: int
    basis: Array | None
    fixed: Array
    scale: Array

    @classmethod
    def of(cls, name: str, kind: str, reference: Any, size: int) -> NoisePart:
        """Make a part of a kind (one of `KINDS`) that is `reference` at θ = 0."""
        known = check_covariance(name, reference, size)
        if known.ndim != 2:
            raise InvalidInput(name, f"shape {known.shape}", f"give a matrix of shape ({size}, {size})")
        variances = np.diag(known)
        scale = np.sqrt(np.where(variances > 0.0, variances, 1.0))
        if kind == "fixed":
            return cls(size, np.empty((0, size, size)), known, scale)
        zero = np.flatnonzero(variances == 0.0)
        if len(zero) and kind != "scalar":
            raise InvalidInput(
                f"{name}[{zero[0]}, {zero[0]}]", 0.0, "give a positive variance: it is what θ = 0 stands for"
            )
        if not known.any():
            raise InvalidInput(name, "a matrix of zeros", "give a reference that can be scaled")
        none = np.zeros((size, size))
        if kind == "full":
            return cls(size, None, none, scale)
        basis = known[None] if kind == "scalar" else np.stack([np.diag(row) for row in np.diag(variances)])
        return cls(size, np.ascontiguousarray(basis), none, scale)

    @property
    def n_parameters(self) -> int:
        """Number of parameters."""
        return self.size * (self.size + 1) // 2 if self.basis is None else len(self.basis)

    @property
    def directions(self) -> Array:
        """Matrices that the covariance is a weighted sum of, `fixed` apart, shape (k, size, size).

        `basis`, or for a full matrix one symmetric matrix for each entry of its lower triangle, row by row.
        """
        if self.basis is not None:
            return self.basis
        rows, columns = np.tril_indices(self.size)
        out = np.zeros((len(rows), self.size, self.size))
        out[np.arange(len(rows)), rows, columns] = self.scale[rows] * self.scale[columns]
        out[np.arange(len(rows)), columns, rows] = self.scale[rows] * self.scale[columns]
        return out

    @property
    def limits(self) -> Array:
        """Largest absolute value of each parameter."""
        if self.basis is not None:
            return np.full(self.n_parameters, REACH)
        rows, columns = np.tril_indices(self.size)
        return np.where(rows == columns, 0.5 * REACH, REACH_OFF)

    @property
    def logarithmic(self) -> NDArray[np.bool_]:
        """Which parameters are logarithms."""
        rows, columns = np.tril_indices(self.size)
        return rows == columns if self.basis is None else np.ones(self.n_parameters, dtype=bool)

    def value(self, theta: Array) -> Array:
        """Covariance at parameters, shape (size, size)."""
        if self.basis is not None:
            return self.fixed + np.tensordot(np.exp(theta), self.basis, axes=1)
        factor = self._factor(theta)
        return factor @ factor.T

    def slopes(self, theta: Array) -> Array:
        """Derivatives of the covariance, shape (parameters, size, size)."""
        if self.basis is not None:
            return np.exp(theta)[:, None, None] * self.basis
        factor = self._factor(theta)
        out = np.empty((self.n_parameters, self.size, self.size))
        for k, (i, j) in enumerate(zip(*np.tril_indices(self.size), strict=True)):
            change = np.zeros_like(factor)
            change[i, j] = factor[i, j] if i == j else self.scale[i]
            half = change @ factor.T
            out[k] = half + half.T
        return out

    def shifted(self, theta: Array, log_scale: float) -> Array:
        """Parameters after the whole covariance is multiplied by exp `log_scale` (`fixed` apart)."""
        if self.basis is not None:
            return theta + log_scale
        return np.where(self.logarithmic, theta + 0.5 * log_scale, theta * np.exp(0.5 * log_scale))

    def nearest(self, covariance: Array) -> Array:
        """Parameters whose covariance is next to a given one, limits respected."""
        if self.basis is None:
            scaled = covariance / np.outer(self.scale, self.scale)
            values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
            floor = np.exp(-REACH)
            root = vectors * np.sqrt(np.maximum(values, floor))
            factor = np.asarray(np.linalg.qr(root.T, mode="r")).T
            factor = factor * np.sign(np.diag(factor))
            out = np.where(self.logarithmic, 0.0, factor[np.tril_indices(self.size)])
            diagonal = np.log(np.maximum(np.diag(factor), np.exp(-0.5 * REACH)))
            out[self.logarithmic] = diagonal
            return np.clip(out, -self.limits, self.limits)
        weights = self.weights(covariance)
        return np.clip(np.log(np.maximum(weights, np.exp(-REACH))), -REACH, REACH)

    def weights(self, covariance: Array) -> Array:
        """Weights of `basis` that fit a covariance by least squares in units of the reference, (k,)."""
        if self.basis is None:
            raise UnsuitableProblem("a full covariance has no basis, so no weights")
        return self._inverse @ (covariance - self.fixed).ravel()

    @cached_property
    def _inverse(self) -> Array:
        unit = np.outer(self.scale, self.scale)
        assert self.basis is not None
        columns = (self.basis / unit).reshape(self.n_parameters, self.size**2).T
        return np.asarray(np.linalg.pinv(columns) / unit.ravel())

    def project(self, covariance: Array) -> Array:
        """Nearest covariance that this structure can take, shape (size, size)."""
        return self.value(self.nearest(covariance))

    def clipped(self, covariance: Array, low: float, high: float) -> Array:
        """Nearest covariance of this structure within factors `low` and `high` of the reference."""
        if self.basis is not None:
            weights = np.clip(self.weights(covariance), low, high)
            return self.fixed + np.tensordot(weights, self.basis, axes=1)
        unit = np.outer(self.scale, self.scale)
        values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T) / unit)
        return (vectors * np.clip(values, low, high)) @ vectors.T * unit

    def _factor(self, theta: Array) -> Array:
        factor = np.zeros((self.size, self.size))
        factor[np.tril_indices(self.size)] = np.where(self.logarithmic, np.exp(theta), theta)
        return self.scale[:, None] * factor


@dataclass(frozen=True)
class NoiseStructure:
    """What is unknown about the covariances Q of the process noise and R of the measurement noise.

    Attributes
    ----------
    process : NoisePart
        Q and its parameters; at θ = 0 it is the reference.
    measurement : NoisePart
        The same of R.
    """

    process: NoisePart
    measurement: NoisePart

    @classmethod
    def of(cls, covariance: str | tuple[str, str], Q: Any, R: Any) -> NoiseStructure:
        """Make a structure from reference covariances.

        Parameters
        ----------
        covariance : {"scalar", "diagonal", "full", "fixed"} or a pair of them
            ``scalar``: the references times an unknown factor; ``diagonal``: unknown variances;
            ``full``: any covariance; ``fixed``: the reference is known. A pair is for Q and R.
        Q, R : array_like, shape (g, g) and (m, m)
            Reference covariances: what θ = 0 stands for, and the unit of everything else.

        Raises
        ------
        InvalidInput
            If a reference is no covariance, or has a zero variance where one is to be found.
        """
        kinds = (covariance, covariance) if isinstance(covariance, str) else tuple(covariance)
        kinds = tuple(one_of("covariance", kind, KINDS) for kind in kinds)
        parts = []
        for name, kind, given in zip("QR", kinds, (Q, R), strict=True):
            matrix = np.atleast_2d(np.asarray(given, dtype=float))
            parts.append(NoisePart.of(name, kind, matrix, len(matrix)))
        return cls(*parts)

    def __post_init__(self) -> None:
        if not self.n_parameters:
            raise InvalidInput("covariance", "fixed", "leave something of Q or R to be found")

    @property
    def n_parameters(self) -> int:
        """Number of parameters, those of Q first."""
        return self.process.n_parameters + self.measurement.n_parameters

    @property
    def limits(self) -> Array:
        """Largest absolute value of each parameter."""
        return np.concatenate([self.process.limits, self.measurement.limits])

    @property
    def logarithmic(self) -> NDArray[np.bool_]:
        """Which parameters are logarithms."""
        return np.concatenate([self.process.logarithmic, self.measurement.logarithmic])

    def split(self, theta: Array) -> tuple[Array, Array]:
        """Parameters of Q and those of R."""
        return theta[: self.process.n_parameters], theta[self.process.n_parameters :]

    def covariances(self, theta: Array) -> tuple[Array, Array]:
        """Q, shape (g, g), and R, shape (m, m), at parameters."""
        q, r = self.split(theta)
        return self.process.value(q), self.measurement.value(r)

    def slopes(self, theta: Array) -> tuple[Array, Array]:
        """Derivatives of Q, shape (d, g, g), and of R, shape (d, m, m), for all d parameters."""
        q, r = self.split(theta)
        dQ, dR = self.process.slopes(q), self.measurement.slopes(r)
        none_Q, none_R = np.zeros((len(r), *dQ.shape[1:])), np.zeros((len(q), *dR.shape[1:]))
        return np.concatenate([dQ, none_Q]), np.concatenate([none_R, dR])

    def shifted(self, theta: Array, log_scale: float) -> Array:
        """Parameters after both covariances are multiplied by exp `log_scale`, limits respected."""
        q, r = self.split(theta)
        moved = [self.process.shifted(q, log_scale), self.measurement.shifted(r, log_scale)]
        return np.clip(np.concatenate(moved), -self.limits, self.limits)

    def nearest(self, Q: Array, R: Array) -> Array:
        """Parameters whose covariances are next to given ones."""
        return np.concatenate([self.process.nearest(Q), self.measurement.nearest(R)])

    def process_pattern(self) -> NDArray[np.bool_]:
        """Where Q can be other than zero, shape (g, g)."""
        return _pattern(self.process)

    def measurement_is_diagonal(self) -> bool:
        """Whether R has no entries off the diagonal."""
        pattern = _pattern(self.measurement)
        return not (pattern & ~np.eye(self.measurement.size, dtype=bool)).any()


def _pattern(part: NoisePart) -> NDArray[np.bool_]:
    if part.basis is None:
        return np.ones((part.size, part.size), dtype=bool)
    return (part.fixed != 0.0) | (part.basis != 0.0).any(axis=0)
