"""Mehra's (1970) correlation method: gain and covariances from the innovations of a suboptimal filter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.als_matrices import ErrorDynamics, autocovariance, fixed_gain_innovations, uniqueness
from baselines.constant_model import require_constant, steady_gain, transient
from baselines.noise_structure import NoisePart, NoiseStructure
from navopt.algorithms.options import at_least
from navopt.errors import InvalidInput
from navopt.models.linear_gaussian import LinearGaussianModel

__all__ = ["MehraFit", "Whiteness", "fit_mehra", "whiteness_test"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Whiteness:
    """Mehra's test whether innovations are white.

    Attributes
    ----------
    outside : float
        Fraction of the autocorrelations beyond ±1.96/√T.
    lags : int
        Number of lags looked at.
    white : bool
        Whether not more than 5 % are outside.
    """

    outside: float
    lags: int
    white: bool


@dataclass(frozen=True)
class MehraFit:
    """Gain and covariances by the correlation method.

    Attributes
    ----------
    Q, R : ndarray, shape (g, g) and (m, m)
        Covariances of the noises, made positive semidefinite and of the structure asked for.
    gain : ndarray, shape (n, m)
        Estimated optimal gain of the measurement update, which needs no Q.
    before, after : Whiteness
        The test on the innovations of the first filter, and on those of a filter with `gain`.
    rank, unknowns : int
        How many combinations of the unknowns of Q the data determine, and how many there are.
    passes : int
        Filter runs over the data.
    """

    Q: Array
    R: Array
    gain: Array
    before: Whiteness
    after: Whiteness
    rank: int
    unknowns: int
    passes: int


def whiteness_test(innovations: Array, lags: int = 30) -> Whiteness:
    """Test innovations by their normalised autocorrelations, each channel with itself.

    Parameters
    ----------
    innovations : ndarray, shape (T, m)
        Innovations, the transient left out.
    lags : int, default 30
        Lags 1 to this are looked at.

    Returns
    -------
    Whiteness

    Notes
    -----
    An autocorrelation of white noise is normal with variance 1/T, so that one in twenty lies beyond
    ±1.96/√T; the innovations count as white if not more do (Mehra 1970).
    """
    C = autocovariance(innovations, at_least("lags", lags, 1) + 1)
    variances = np.diag(C[0])
    correlations = np.einsum("jaa->ja", C[1:]) / np.where(variances > 0.0, variances, 1.0)
    outside = float((np.abs(correlations) > 1.96 / np.sqrt(len(innovations))).mean())
    return Whiteness(outside, lags, outside <= 0.05)


def fit_mehra(
    model: LinearGaussianModel,
    structure: NoiseStructure,
    *,
    passes: int = 3,
    lags: int | None = None,
    burn_in: int | None = None,
    spend: Callable[[int], bool] | None = None,
) -> MehraFit:
    """Fit gain, R and Q by the correlation method (Mehra 1970).

    The autocovariances C_j of the innovations of a filter with gain L obey
    ``C_j = C Ā^(j−1) A (P Cᵀ − L C_0)`` for j > 0 with Ā = A (I − L C). Least squares over j give P Cᵀ,
    then ``R = C_0 − C P Cᵀ``, the gain ``P Cᵀ C_0⁻¹`` of the next pass, and Q from
    ``P = Ā P Āᵀ + G Q Gᵀ + A L R Lᵀ Aᵀ`` as far as P Cᵀ determines it.

    Parameters
    ----------
    model : LinearGaussianModel
        A constant model, no measurement missing.
    structure : NoiseStructure
        What is looked for; its references are the covariances that the first gain belongs to.
    passes : int, default 3
        How often the filter is run, each time with the gain of the pass before.
    lags : int, optional
        Number of autocovariances beyond lag zero, at least the number of states n;
        20 or 2 n if not given. Mehra's n are too few for a filter that remembers long.
    burn_in : int, optional
        Innovations left out at the beginning; 100, or a fifth of them if they are fewer than 500.
    spend : callable, optional
        Asked with the price 1 of every run of the filter before it is made; False ends the search.

    Returns
    -------
    MehraFit

    Raises
    ------
    UnsuitableProblem
        If the model varies, or a measurement is missing.
    InvalidInput
        If there are too few measurements or lags, or more unknowns in Q than P Cᵀ determines.
    """
    require_constant(model, "mehra")
    n = model.n_states
    lags = max(20, 2 * n) if lags is None else at_least("lags", lags, n)
    burn_in = transient(model) if burn_in is None else at_least("burn_in", burn_in, 0)
    least = burn_in + max(60, 2 * lags)
    if model.n_steps <= least:
        raise InvalidInput("y", f"{model.n_steps} steps", f"give more than {least} steps for these options")
    Q, R = structure.covariances(np.zeros(structure.n_parameters))
    gain = steady_gain(model, Q, R)
    before = after = Whiteness(np.nan, 0, False)
    rank, unknowns, made = 0, structure.process.n_parameters, 0
    for _ in range(at_least("passes", passes, 1)):
        if spend is not None and not spend(1):
            break
        made += 1
        dynamics = ErrorDynamics(model.F, model.H, model.G, gain)
        innovations = fixed_gain_innovations(dynamics, model.y, model.drive, model.x0)[burn_in:]
        before = whiteness_test(innovations) if made == 1 else before
        C = autocovariance(innovations, lags + 1)
        PC, R = _cross_covariance(dynamics, C)
        R = structure.measurement.project(R)
        better: Array = np.asarray(np.linalg.solve(model.H @ PC + R, PC.T).T, dtype=np.float64)
        rank, unknowns, Q = _process(dynamics, structure.process, PC, R)
        if not _stable(model, better):
            # sampling errors can make it diverge: the Riccati gain of the estimates does not
            better = steady_gain(model, Q, R)
        gain = better
    if made and (spend is None or spend(1)):
        made += 1
        final = ErrorDynamics(model.F, model.H, model.G, gain)
        after = whiteness_test(fixed_gain_innovations(final, model.y, model.drive, model.x0)[burn_in:])
    return MehraFit(Q, R, gain, before, after, rank, unknowns, made)


def _cross_covariance(dynamics: ErrorDynamics, C: Array) -> tuple[Array, Array]:
    """P Cᵀ, shape (n, m), and R, shape (m, m), from the autocovariances."""
    rows, power = [], dynamics.A
    for _ in range(len(C) - 1):
        rows.append(dynamics.C @ power)
        power = dynamics.closed @ power
    observed = np.concatenate(rows)
    stacked = np.concatenate(C[1:])
    difference = np.linalg.lstsq(observed, stacked, rcond=None)[0]
    PC = dynamics.L @ C[0] + difference
    R = C[0] - dynamics.C @ PC
    return PC, 0.5 * (R + R.T)


def _process(dynamics: ErrorDynamics, part: NoisePart, PC: Array, R: Array) -> tuple[int, int, Array]:
    """Q by least squares from P Cᵀ, which is linear in Q and R."""
    from scipy.linalg import solve_discrete_lyapunov

    if not part.n_parameters:
        return 0, 0, part.fixed
    shapes = part.directions
    vecs = np.swapaxes(shapes, 1, 2).reshape(len(shapes), -1).T
    rank, unknowns = uniqueness(dynamics, vecs)
    if rank < unknowns:
        raise InvalidInput(
            "Q",
            f"{unknowns} unknowns of which the innovations determine {rank}",
            "ask for fewer: covariance='scalar' or 'diagonal', or fewer process noises in G",
        )

    def seen(noise: Array) -> Array:
        return np.asarray(solve_discrete_lyapunov(dynamics.closed, noise) @ dynamics.C.T).ravel()

    G, AL = dynamics.G, dynamics.feed
    design = np.stack([seen(G @ matrix @ G.T) for matrix in shapes], axis=1)
    target = PC.ravel() - seen(AL @ R @ AL.T) - seen(G @ part.fixed @ G.T)
    size = np.linalg.norm(design, axis=0)
    weights = np.linalg.lstsq(design / size, target, rcond=None)[0] / size
    return rank, unknowns, part.project(part.fixed + np.tensordot(weights, shapes, axes=1))


def _stable(model: LinearGaussianModel, gain: Array) -> bool:
    closed = model.F - model.F @ gain @ model.H
    return bool(np.abs(np.linalg.eigvals(closed)).max() < 1.0 - 1e-6)
