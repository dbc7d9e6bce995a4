"""The answer of a method that knows how well it knows: a matched track with covariance and rival."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.track_hypotheses import Mode, weights
from navopt.models.earth import separation
from navopt.problems.gravity_matching import MatchedTrack
from navopt.problems.gravity_posterior import TrackPosterior

__all__ = ["Gate", "TrackEstimate", "summarise"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Gate:
    """When an answer counts as known.

    Attributes
    ----------
    sigma_m : float
        Largest standard deviation of the last position (root of the trace of its covariance), m.
    probability : float
        Least probability of the answer's mode among the modes found.
    gain : float
        Least information that the measurements have added about the last position, in nats: 0.7 halves
        the area of its error ellipse.
    """

    sigma_m: float = 2000.0
    probability: float = 0.95
    gain: float = 0.7


@dataclass(frozen=True)
class TrackEstimate(MatchedTrack):
    """Matched positions and how far they can be trusted.

    Attributes
    ----------
    latitude, longitude : ndarray, shape (window,)
        Estimated positions of the window, rad; the last is the navigation fix.
    covariance : ndarray, shape (window, 2, 2)
        Covariance of (north, east) of each, m²; other modes count with their distance.
    track_latitude, track_longitude : ndarray, shape (N,)
        Positions of all samples that the method looks at, rad.
    track_covariance : ndarray, shape (N, 2, 2)
        Their covariances, m².
    coefficients : ndarray, shape (r,)
        Error sources of the answer, in standard deviations of their priors.
    names : list of str
        What they are.
    probability : float
        Probability of the answer's mode among the modes found.
    next_cost : float
        By how much the next-best mode is worse, in units of minus the log posterior; ``inf`` if none was
        found.
    next_distance_m : float
        Distance of its last position; ``nan`` if none was found.
    gain : float
        Information that the measurements have added about the last position, in nats.
    used : int
        Number of samples accounted for; fewer than N where a budget ended the search.
    knows : bool
        Whether the answer passed the gate.
    """

    covariance: Array
    track_latitude: Array
    track_longitude: Array
    track_covariance: Array
    coefficients: Array
    names: list[str]
    probability: float
    next_cost: float
    next_distance_m: float
    gain: float
    used: int
    knows: bool

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the last position, m: the root of the trace of its covariance."""
        return float(np.sqrt(np.trace(self.covariance[-1])))


def summarise(
    posterior: TrackPosterior,
    modes: list[Mode],
    *,
    window: int,
    used: int,
    gate: Gate,
    names: tuple[str, ...],
    answer: str = "mode",
) -> TrackEstimate:
    """Make the answer of the modes of a posterior.

    Parameters
    ----------
    posterior : TrackPosterior
        What they are modes of.
    modes : list of Mode
        Most probable first.
    window : int
        Number of last samples that are the answer's window.
    used : int
        Number of samples accounted for.
    gate : Gate
        When an answer counts as known.
    names : tuple of str
        Names of the coefficients.
    answer : {"mode", "mean"}
        Report the most probable mode, or the mean over the modes.

    Returns
    -------
    TrackEstimate
    """
    share = weights(modes)
    places = np.array([posterior.positions(mode.a) for mode in modes])
    best = places[0] if answer == "mode" else np.tensordot(share, places, axes=1)
    covariance = np.zeros((len(posterior), 2, 2))
    for part, mode, place in zip(share, modes, places, strict=True):
        away = np.stack(separation(*place, *best), axis=-1)
        covariance += part * (posterior.covariances(mode.information) + away[:, :, None] * away[:, None, :])
    before = posterior.covariances(np.eye(posterior.n_coefficients))[-1]
    gain = 0.5 * float(np.linalg.slogdet(before)[1] - np.linalg.slogdet(covariance[-1])[1])
    sigma = float(np.sqrt(np.trace(covariance[-1])))
    rival = len(modes) > 1
    distance = float(np.hypot(*separation(*places[1, :, -1], *places[0, :, -1]))) if rival else np.nan
    return TrackEstimate(
        latitude=best[0, -window:],
        longitude=best[1, -window:],
        covariance=covariance[-window:],
        track_latitude=best[0],
        track_longitude=best[1],
        track_covariance=covariance,
        coefficients=modes[0].a,
        names=list(names),
        probability=float(share[0]),
        next_cost=float(modes[1].cost - modes[0].cost) if rival else np.inf,
        next_distance_m=distance,
        gain=gain,
        used=used,
        knows=sigma <= gate.sigma_m and float(share[0]) >= gate.probability and gain >= gate.gain,
    )
