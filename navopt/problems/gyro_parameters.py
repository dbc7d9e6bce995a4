"""Which parameters of the triads are sought, in which box, with which prior."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.triad import PARAMETER_NAMES

__all__ = ["ACCELEROMETER", "ALL_NAMES", "UNITS", "UPPER", "chosen", "groups_of", "make_box", "make_prior"]

ACCELEROMETER = "accelerometer_"
"""What stands before the name of an accelerometer's parameter."""

ALL_NAMES: tuple[str, ...] = (*PARAMETER_NAMES, *(ACCELEROMETER + name for name in PARAMETER_NAMES))
"""The twelve parameters of the gyros and the twelve of the accelerometers."""

UPPER = ("misalignment_xy", "misalignment_xz", "misalignment_yz")
"""The elements that are zero if body axes are defined by the sensors."""

UNITS: dict[str, str] = {
    name: {
        "scale": "s^2/m" if name in ALL_NAMES[12:] else "s",
        "bias": "m/s^2" if name in ALL_NAMES[12:] else "rad/s",
        "misalignment": "rad",
    }[name.removeprefix(ACCELEROMETER).split("_")[0]]
    for name in ALL_NAMES
}
"""Units of all parameters; a count has none."""

_KINDS = ("scale", "bias", "misalignment")


def chosen(
    estimated: str | Iterable[str] | None, *, accelerometers: bool = False, table: bool = False
) -> tuple[tuple[str, ...], list[str], bool]:
    """Resolve what a user wants estimated.

    Parameters
    ----------
    estimated : str or iterable of str, or None
        Words and names, see `GyroCalibration`.
    accelerometers, table : bool
        Whether the loss knows accelerometers, or known rates instead of norms.

    Returns
    -------
    known : tuple of str
        All parameters of the loss, in order.
    names : list of str
        Those estimated, in that order.
    in_convention : bool
        Whether ``"frame"`` was asked for.

    Raises
    ------
    InvalidInput
        If nothing is left, a name comes twice, or a frame is asked for that a turntable has already.
    UnknownName
        If a word is unknown.
    """
    known = ALL_NAMES if accelerometers else PARAMETER_NAMES
    if estimated is None:
        estimated = "all" if table else "frame"
    words = [estimated] if isinstance(estimated, str) else [str(word) for word in estimated]
    sets: dict[str, list[str]] = {
        "all": list(known),
        "frame": [
            n for n in known if n not in [(ACCELEROMETER if accelerometers else "") + u for u in UPPER]
        ],
        **{kind: [n for n in known if n.removeprefix(ACCELEROMETER).startswith(kind)] for kind in _KINDS},
    }
    if accelerometers:
        sets["gyro"], sets["accelerometer"] = list(ALL_NAMES[:12]), list(ALL_NAMES[12:])
    if "frame" in words and len(words) > 1:
        raise InvalidInput("estimated", words, '"frame" stands alone: it is a set of its own')
    if "frame" in words and table:
        raise InvalidInput("estimated", words, 'a turntable has axes of its own: give "all" or names')
    wanted: list[str] = []
    for word in words:
        if word not in sets and word not in known:
            raise UnknownName("estimated", word, [*sets, *known])
        wanted += sets.get(word, [word])
    if not wanted or len(set(wanted)) < len(wanted):
        raise InvalidInput("estimated", words, "name at least one parameter, and none twice")
    return known, [name for name in known if name in wanted], words == ["frame"]


def groups_of(names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """The paper's three categories among `names`; those of the accelerometers apart, empty ones left out."""
    groups: dict[str, tuple[str, ...]] = {}
    for prefix in ("", ACCELEROMETER):
        for kind in _KINDS:
            members = tuple(n for n in names if n.startswith(prefix + kind + "_"))
            if members:
                groups[prefix + kind] = members
    return groups


def make_box(names: list[str], values: np.ndarray, reach: Mapping[str, float], box: Any) -> np.ndarray:
    """Lower and upper limits, shape (n_var, 2).

    Parameters
    ----------
    names : list of str
        Estimated parameters.
    values : ndarray, shape (n_var,)
        Presets.
    reach : mapping
        Half widths by kind: ``scale`` relative, ``bias`` and ``misalignment`` absolute; those of an
        accelerometer with its prefix if they differ.
    box : array_like, shape (n_var, 2), or None
        Instead of it.
    """
    if box is not None:
        limits = np.array(box, dtype=float)
        if limits.shape != (len(names), 2):
            raise InvalidInput(
                "box", limits.shape, f"give lower and upper limits of each parameter, shape ({len(names)}, 2)"
            )
        return limits
    for kind, size in reach.items():
        if not (np.isfinite(size) and size > 0.0):
            raise InvalidInput(f"reach of {kind}", size, "give a positive half width of the box")
    half = []
    for name, value in zip(names, values, strict=True):
        kind = _kind(name)
        size = reach.get(ACCELEROMETER + kind, reach[kind]) if name.startswith(ACCELEROMETER) else reach[kind]
        half.append(size * abs(value) if kind == "scale" else size)
    return np.stack([values - half, values + half], axis=1)


def make_prior(prior: Any, names: list[str]) -> np.ndarray | None:
    """Covariance of the prior, shape (n_var, n_var), from standard deviations by name or kind; or None."""
    if prior is None:
        return None
    if isinstance(prior, Mapping):
        for key in prior:
            kinds = [*_KINDS, *(ACCELEROMETER + kind for kind in _KINDS)]
            if key not in kinds and key not in names:
                raise UnknownName("prior", str(key), [*kinds, *names])
        sigma = np.empty(len(names))
        for k, name in enumerate(names):
            prefix = ACCELEROMETER if name.startswith(ACCELEROMETER) else ""
            value = prior.get(name, prior.get(prefix + _kind(name)))
            if value is None or not (np.isfinite(value) and value > 0.0):
                raise InvalidInput(f"prior of {name}", value, "give a positive standard deviation")
            sigma[k] = value
        return np.diag(sigma**2)
    covariance = np.array(prior, dtype=float)
    shape = (len(names), len(names))
    if covariance.shape != shape or not np.isfinite(covariance).all():
        raise InvalidInput("prior", covariance.shape, f"give standard deviations by name, or shape {shape}")
    size = np.sqrt(np.abs(np.diag(covariance)))
    try:
        np.linalg.cholesky(covariance / np.outer(size, size))
    except np.linalg.LinAlgError:
        raise InvalidInput("prior", "a matrix", "give a positive definite covariance") from None
    return 0.5 * (covariance + covariance.T)


def _kind(name: str) -> str:
    return name.removeprefix(ACCELEROMETER).split("_")[0]
