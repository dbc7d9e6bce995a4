"""Steps of the fruit flies: their shape, and how their size falls over the cycles.

Shapes are drawn standardised, and without looking at the swarm, so that a cycle's block of random
numbers is the same whatever has happened; sizes are computed per cycle in plain floating point, so that
stacked runs get the very bits of single ones.
"""

from __future__ import annotations

import math

import numpy as np

from navopt.algorithms.swarm import Arrays

__all__ = ["DECAY", "STEP_LAWS", "one_variable", "step_size", "student", "student_draws", "uniform_draws"]

STEP_LAWS = ("constant", "lgms", "iffo")
#: Factor per cycle of LGMS-FOA's step (Shan, Cao and Dong 2013: ω0 = 1, α = 0.95).
DECAY = 0.95


def step_size(law: str, cycle: np.ndarray, horizon: int, final_step: float) -> np.ndarray:
    """Size of the steps relative to the first cycle's.

    Parameters
    ----------
    law : {"constant", "lgms", "iffo"}
        Always 1; ``0.95^g`` (Shan, Cao and Dong 2013); ``final_step^(g/horizon)`` (Pan, Sang, Duan and
        Gao 2014, there written as an exponential between λmax and λmin).
    cycle : ndarray of int, shape (...)
        Completed cycles g.
    horizon : int
        Cycles after which the size is held.
    final_step : float
        Size at the horizon under ``"iffo"``.

    Returns
    -------
    ndarray, shape (...)
    """
    if law == "constant":
        return np.ones(np.shape(cycle))
    # few distinct values, each by the same scalar arithmetic: an array function may round differently
    # for one element than for many
    values, where = np.unique(np.minimum(cycle, horizon), return_inverse=True)
    if law == "lgms":
        sizes = [DECAY ** int(g) for g in values]
    else:
        sizes = [math.exp(math.log(final_step) * (int(g) / horizon)) for g in values]
    return np.array(sizes)[where].reshape(np.shape(cycle))


def uniform_draws(rng: np.random.Generator, shape: tuple[int, ...], one_sided: bool) -> np.ndarray:
    """Steps uniform in [-1, 1), or in [0, 1) if one-sided."""
    u = rng.random(shape)
    return u if one_sided else 2.0 * u - 1.0


def student_draws(rng: np.random.Generator, shape: tuple[int, ...], one_sided: bool) -> Arrays:
    """Two uniform numbers per step, prepared for `student`: the logarithm of one, an angle's cosine."""
    u, v = rng.random((2, *shape))
    cosine = np.cos(2.0 * np.pi * v)
    return {"log_uniform": np.log1p(-u), "cosine": np.abs(cosine) if one_sided else cosine}


def student(draws: Arrays, freedom: np.ndarray) -> np.ndarray:
    """Student-t variates of given degrees of freedom from two uniform numbers each.

    The polar method with a trigonometric angle (Bailey 1994, Math. Comput. 62:779):
    ``t = cos(2πv) √(ν (u^(-2/ν) - 1))``. It is exact, and unlike rejection it takes a fixed number of
    draws and sees ν only afterwards, so one block serves every cycle.

    Parameters
    ----------
    draws : dict of ndarray, shape (..., n, c, d)
        From `student_draws`.
    freedom : ndarray, shape (...)
        Degrees of freedom ν.

    Returns
    -------
    ndarray, shape (..., n, c, d)
    """
    nu = np.asarray(freedom, dtype=float)[..., None, None, None]
    return draws["cosine"] * np.sqrt(nu * np.expm1(draws["log_uniform"] * (-2.0 / nu)))


def one_variable(uniform: np.ndarray, d: int) -> np.ndarray:
    """Mask of the one variable each fly changes, (..., n) -> (..., n, 1, d)."""
    chosen = (uniform * d).astype(np.int64)
    return (np.arange(d) == chosen[..., None])[..., None, :]
