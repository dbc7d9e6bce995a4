"""Noise in a loss that is nevertheless a pure function of the decision vector."""

from __future__ import annotations

import zlib

import numpy as np
from scipy.special import ndtri

from navopt.errors import InvalidInput
from navopt.problem import EstimationProblem
from navopt.problems.wrapper_base import Wrapper, registered_name

__all__ = ["Noisy", "hashed_normal"]

# constants of the finaliser of splitmix64 (Steele, Lea, Flood 2014), which passes BigCrush as a
# generator over a counter; the increment is the golden section of 2⁶⁴
_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_FACTORS = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_SHIFTS = np.uint64(30), np.uint64(27), np.uint64(31)


def _mix(words: np.ndarray) -> np.ndarray:
    """Finaliser of splitmix64, a bijection of 64-bit words; array in, array out."""
    words = (words ^ (words >> _SHIFTS[0])) * _FACTORS[0]
    words = (words ^ (words >> _SHIFTS[1])) * _FACTORS[1]
    return words ^ (words >> _SHIFTS[2])


def hashed_normal(X: np.ndarray, keys: np.ndarray) -> np.ndarray:
    """Standard normal numbers that depend on nothing but the bytes of each row and the keys.

    Parameters
    ----------
    X : ndarray, shape (n, d), C-contiguous float64
        Rows; -0 counts as 0.
    keys : ndarray of uint64, shape (2,)
        What tells one noise from another.

    Returns
    -------
    ndarray, shape (n,)
        Each the normal quantile of a 52-bit uniform number, hence at most 8.1 in size.
    """
    # the position of a coordinate takes part, so that exchanging two changes the noise; a sum of words
    # modulo 2⁶⁴ is the same in any order
    positions = keys[1] + _GAMMA * np.arange(1, X.shape[1] + 1, dtype=np.uint64)
    words = _mix((X + 0.0).view(np.uint64) + positions)
    state = _mix(_mix(words.sum(axis=1, dtype=np.uint64) ^ keys[0]))
    uniform = ((state >> np.uint64(12)).astype(float) + 0.5) * 2.0**-52
    return ndtri(uniform)


class Noisy(Wrapper):
    """Another problem with normal noise added to its loss.

    The noise is a hash of (seed, bytes of x): the same candidate has the same loss however often, in
    whatever batch and by whichever solver it is asked. To average noise away, average twins (`redraw`).

    Parameters
    ----------
    problem : EstimationProblem
        The problem without noise.
    sigma : float
        Standard deviation of the noise, in the unit of the loss.
    seed : int, default 0
        Seed of the noise.

    Notes
    -----
    Estimates, truth and scores are those of the problem without noise, so ``gap_1`` of an analytic
    problem is the true gap. Nothing is provided: residuals do not belong to the noisy loss.
    """

    def __init__(self, problem: EstimationProblem, sigma: float, seed: int = 0) -> None:
        if isinstance(sigma, bool) or not np.isfinite(sigma) or sigma < 0:
            raise InvalidInput("sigma", sigma, "give a standard deviation: finite and not negative")
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
            raise InvalidInput("seed", seed, "give a non-negative integer, so that the noise can be repeated")
        super().__init__(problem)
        self.provides = frozenset()  # type: ignore[misc]
        self.sigma, self.seed = float(sigma), int(seed)
        label = zlib.crc32(f"wrapper:noise:{registered_name(problem)}".encode())
        self._keys = np.random.SeedSequence([label, self.seed]).generate_state(2, np.uint64)
        self._keys.setflags(write=False)

    def _loss(self, X: np.ndarray) -> np.ndarray:
        return self.problem._loss(X) + self.sigma * hashed_normal(X, self._keys)

    def prior(self) -> None:
        """None: what was known belongs to the loss without noise."""

    def over(self, problem: EstimationProblem) -> Noisy:
        """Return another inner problem with the same kind of noise."""
        return Noisy(problem, self.sigma, self.seed)

    def redraw(self, seed: int) -> EstimationProblem:
        """Return the problem with other noise, in the loss and in its data if it holds any."""
        return Noisy(self.problem.redraw(seed), self.sigma, seed)
