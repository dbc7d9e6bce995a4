"""Noise covariances as decision vectors: logarithms of variances, and correlations that always fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.linear_gaussian import check_covariance
from navopt.problem import Parameter

__all__ = ["FORMS", "CovarianceForm"]

FORMS = ("scalar", "diagonal", "full", "fixed")
#: Largest partial correlation of the box: at 1 the matrix is singular.
CORRELATION = 0.99


@dataclass(frozen=True)
class CovarianceForm:
    """How one covariance matrix is made of a piece of the decision vector.

    ``"scalar"``: a number times the reference. ``"diagonal"``: one number for each diagonal entry of the
    reference. ``"full"``: as diagonal, with correlations made of canonical partial correlations
    (Lewandowski, Kurowicka & Joe 2009, J. Multivar. Anal. 100:1989), each free between -1 and 1: no point
    of the box is indefinite. ``"fixed"``: the reference itself.

    Attributes
    ----------
    name : str
        ``"Q"`` or ``"R"``.
    kind : {"scalar", "diagonal", "full", "fixed"}
    reference : ndarray, shape (k, k)
        What a scale of 1 means.
    raw : bool
        Whether parameters are the scales themselves instead of their common logarithms.
    """

    name: str
    kind: str
    reference: np.ndarray
    raw: bool = False

    def __post_init__(self) -> None:
        if self.kind not in FORMS:
            raise UnknownName(f"covariance of {self.name}", self.kind, FORMS)
        reference = np.array(self.reference, dtype=float)
        size = reference.shape[-1] if reference.ndim else 0
        reference = check_covariance(f"reference of {self.name}", reference, size, definite=self.name == "R")
        if self.kind in ("diagonal", "full"):
            if (np.diag(reference) <= 0.0).any():
                raise InvalidInput(
                    f"reference of {self.name}", np.diag(reference).tolist(), "give positive variances"
                )
            if np.count_nonzero(reference - np.diag(np.diag(reference))):
                raise InvalidInput(
                    f"reference of {self.name}", "not diagonal", f"give a diagonal one for {self.kind!r}"
                )
        if self.kind == "full" and self.raw:
            raise InvalidInput("encoding", "raw", 'a full covariance needs encoding="log10"')
        reference.setflags(write=False)
        object.__setattr__(self, "reference", reference)

    @property
    def size(self) -> int:
        """Rows of the matrix."""
        return len(self.reference)

    @property
    def n_scales(self) -> int:
        """Number of scales among the parameters."""
        return {"scalar": 1, "fixed": 0}.get(self.kind, self.size)

    @property
    def n_parameters(self) -> int:
        """Number of parameters: scales, then partial correlations row by row."""
        pairs = self.size * (self.size - 1) // 2 if self.kind == "full" else 0
        return self.n_scales + pairs

    def parameters(self, lower: float, upper: float, nominal: float) -> list[Parameter]:
        """Parameters with a box for the scales (in logarithms unless raw)."""
        letter = self.name.lower()
        stem = letter if self.raw else f"log10_{letter}"
        names = [stem] if self.n_scales == 1 else [f"{stem}_{i}" for i in range(self.n_scales)]
        nominal = float(np.clip(nominal, lower, upper))
        out = [Parameter(name, "1", lower, upper, nominal) for name in names]
        if self.kind == "full":
            out += [
                Parameter(f"correlation_{letter}_{i}{j}", "1", -CORRELATION, CORRELATION, 0.0)
                for i in range(1, self.size)
                for j in range(i)
            ]
        return out

    def matrices(self, X: np.ndarray) -> np.ndarray:
        """Covariances of decision vectors, (K, n_parameters) -> (K, k, k)."""
        count = len(X)
        if self.kind == "fixed":
            return np.broadcast_to(self.reference, (count, self.size, self.size)).copy()
        scales = X[:, : self.n_scales]
        with np.errstate(over="ignore"):
            scales = scales if self.raw else 10.0**scales
        if self.kind == "scalar":
            return scales[:, :, None] * self.reference
        variances = scales * np.diag(self.reference)
        out = np.zeros((count, self.size, self.size))
        index = np.arange(self.size)
        if self.kind == "full":
            root = _correlation_root(X[:, self.n_scales :], self.size)
            sigma = np.sqrt(variances)
            for i in range(self.size):
                for j in range(i):
                    # summed in a fixed order: a candidate must not depend on its company
                    value = sum(root[:, i, k] * root[:, j, k] for k in range(j + 1))
                    out[:, i, j] = out[:, j, i] = value * sigma[:, i] * sigma[:, j]
        out[:, index, index] = variances
        return out

    def vector(self, matrix: np.ndarray) -> np.ndarray:
        """Parameters that come nearest to a covariance, shape (k, k) -> (n_parameters,)."""
        if self.kind == "fixed":
            return np.empty(0)
        here, reference = np.diag(matrix), np.diag(self.reference)
        tiny = np.finfo(float).tiny
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = here[reference > 0.0] / reference[reference > 0.0]
        if self.raw:
            return np.array([ratio.mean()]) if self.kind == "scalar" else ratio
        logs = np.log10(np.maximum(ratio, tiny))
        if self.kind == "scalar":
            return np.array([logs.mean()])
        if self.kind == "diagonal":
            return logs
        sigma = np.sqrt(np.maximum(here, tiny))
        return np.concatenate([logs, _partial_correlations(matrix / np.outer(sigma, sigma))])

    def directions(self, x: np.ndarray) -> np.ndarray:
        """Derivatives of the covariance by the parameters at one point, shape (n_parameters, k, k)."""
        step = 1e-6
        if not self.n_parameters:
            return np.empty((0, self.size, self.size))
        if self.kind != "full":
            matrix = self.matrices(x[None])[0]
            factor = np.ones(self.n_scales) if self.raw else np.log(10.0) * 10.0 ** x[: self.n_scales]
            if self.kind == "scalar":
                return factor[:, None, None] * self.reference
            out = np.zeros((self.n_scales, *matrix.shape))
            index = np.arange(self.size)
            out[index, index, index] = factor * np.diag(self.reference)
            return out
        moves = step * np.eye(self.n_parameters)
        return (self.matrices(x + moves) - self.matrices(x - moves)) / (2.0 * step)


def _correlation_root(partial: np.ndarray, size: int) -> np.ndarray:
    """Cholesky factors of correlation matrices from partial correlations, (K, pairs) -> (K, k, k)."""
    root = np.zeros((len(partial), size, size))
    root[:, 0, 0] = 1.0
    at = 0
    for i in range(1, size):
        left = np.ones(len(partial))
        for j in range(i):
            root[:, i, j] = partial[:, at] * np.sqrt(left)
            left = left * (1.0 - partial[:, at] ** 2)
            at += 1
        root[:, i, i] = np.sqrt(left)
    return root


def _partial_correlations(correlation: np.ndarray) -> np.ndarray:
    """Inverse of `_correlation_root` for one correlation matrix, made definite if it is not."""
    values, vectors = np.linalg.eigh(correlation)
    values = np.maximum(values, 1e-12)
    fixed = (vectors * values) @ vectors.T
    sigma = np.sqrt(np.diag(fixed))
    root = np.linalg.cholesky(fixed / np.outer(sigma, sigma))
    out: list[Any] = []
    for i in range(1, len(root)):
        left = 1.0
        for j in range(i):
            out.append(np.clip(root[i, j] / np.sqrt(max(left, 1e-15)), -1.0, 1.0))
            left *= 1.0 - out[-1] ** 2
    return np.array(out)
