"""Units of gravity: factors to mGal, and numbers that cannot be anomalies in mGal."""

from __future__ import annotations

import numpy as np

from navopt.errors import InvalidInput, UnknownName

__all__ = ["UNITS", "gravity_factor", "plain_unit", "refuse_magnitude", "suspected_unit"]

#: One unit in mGal, by a spelling without blanks, signs of power and capitals (see `plain_unit`).
UNITS = {
    "mgal": 1.0, "milligal": 1.0, "milligals": 1.0,
    "gal": 1e3, "cm/s2": 1e3, "cms-2": 1e3,
    "ugal": 1e-3, "µgal": 1e-3, "microgal": 1e-3,
    "m/s2": 1e5, "ms-2": 1e5, "m/sec2": 1e5, "meter/second2": 1e5, "meters/second2": 1e5,
    "mm/s2": 1e2, "mms-2": 1e2,
    "um/s2": 0.1, "µm/s2": 0.1, "ums-2": 0.1, "µms-2": 0.1, "micrometer/second2": 0.1, "gu": 0.1,
    "nm/s2": 1e-4, "nms-2": 1e-4,
}  # fmt: skip

#: No free-air anomaly on Earth is larger, mGal; those of whole maps and tracks reach some hundreds.
LARGEST = 1500.0
#: No map or track has all its values closer to zero, mGal.
SMALLEST = 0.02
#: Gravity itself, from the equator to a pole, with some heights and depths, m/s2.
WHOLE_GRAVITY = (9.76, 9.84)
_SPELLINGS = (("²", "2"), ("⁻", "-"), ("**", ""), ("^", ""), ("·", ""), ("*", ""), (" ", ""), (".", ""))
_WHOLE = {"m/s2": 1.0, "Gal": 1e2, "mGal": 1e5, "um/s2": 1e6, "uGal": 1e8}


def plain_unit(text: str) -> str:
    """Return the spelling of a unit under which `UNITS` may know it.

    Parameters
    ----------
    text : str
        Any spelling, such as ``"m s**-2"`` or ``"µGal"``.

    Returns
    -------
    str
    """
    plain = text.lower().replace("μ", "µ")
    for old, new in _SPELLINGS:
        plain = plain.replace(old, new)
    return plain


def gravity_factor(unit: str, argument: str = "gravity_unit") -> float:
    """Return what one of a unit of gravity is in mGal.

    Parameters
    ----------
    unit : str
        Its name: mGal, uGal, Gal, m/s2, mm/s2, um/s2, nm/s2 and other spellings of these.
    argument : str
        What the unit was given as, for the message.

    Returns
    -------
    float

    Raises
    ------
    UnknownName
        If it is none of gravity.
    """
    plain = plain_unit(unit)
    if plain not in UNITS:
        raise UnknownName(argument, unit, UNITS)
    return UNITS[plain]


def suspected_unit(values: np.ndarray) -> tuple[str, bool] | None:
    """Tell by their size that values cannot be anomalies in mGal, and what they seem to be.

    Parameters
    ----------
    values : ndarray
        Numbers said to be anomalies in mGal; those that are not finite are passed over.

    Returns
    -------
    (unit, whole) or None
        The unit that they seem to be in, and whether they seem to be gravity itself and no anomaly.
        None where nothing speaks against mGal, which is also so for um/s2: a factor of ten is no proof.
    """
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return None
    for unit, factor in _WHOLE.items():
        if finite.min() >= WHOLE_GRAVITY[0] * factor and finite.max() <= WHOLE_GRAVITY[1] * factor:
            return unit, True
    # a few wild points must not decide
    size = np.percentile(np.abs(finite), 90)
    if size > LARGEST:
        return "uGal", False
    if 0.0 < np.abs(finite).max() < SMALLEST:
        return "m/s2", False
    return None


def refuse_magnitude(values: np.ndarray, *, argument: str, option: str) -> None:
    """Raise if values said to be anomalies in mGal are far too large or too small for it.

    Parameters
    ----------
    values : ndarray
        The numbers.
    argument : str, keyword-only
        What they are, for the message.
    option : str, keyword-only
        What states the unit, for the message.

    Raises
    ------
    InvalidInput
        Naming what the numbers look like and the option that settles it.
    """
    suspected = suspected_unit(values)
    if suspected is None:
        return
    unit, whole = suspected
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    shown = f"{finite.min():.6g} to {finite.max():.6g}"
    if whole:
        raise InvalidInput(
            argument,
            shown,
            f"this looks like gravity itself in {unit}: give anomalies (free air: minus normal gravity, "
            f"Eotvos-corrected), with {option} if they are not in mGal",
        )
    raise InvalidInput(
        argument,
        shown,
        f"these are no anomalies in mGal but look like {unit}: say so with {option} {unit}, "
        f"or {option} mGal if they are right",
    )
