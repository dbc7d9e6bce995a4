"""Matrices and bounds as they stand in a file: rows of numbers, checked entry by entry."""

from __future__ import annotations

from typing import Any

import numpy as np

from navopt.errors import InvalidInput, UnknownName
from navopt.models.linear_gaussian import check_finite

__all__ = ["bounds_of", "check_noise", "check_shape", "matrix_of"]

#: Decades that a variance may go from the present one if the file says nothing.
DECADES = 6.0
#: Variances beyond these are a slip in the file, whatever the units.
LEAST, MOST = 1e-40, 1e40
FORMS = ("scalar", "diagonal", "full", "fixed")


def matrix_of(name: str, value: Any, *, flat: str | None = None) -> np.ndarray:
    """Make a matrix of rows of numbers.

    Parameters
    ----------
    name : str
        What the matrix is called in messages.
    value : object
        A list of lists of numbers, or one number for a 1 by 1 matrix.
    flat : {"column", "diagonal"}, optional
        What a plain list of numbers stands for; it is refused if not given.

    Returns
    -------
    ndarray, shape (rows, columns)

    Raises
    ------
    InvalidInput
        If it is no such list, rows have different lengths, or an entry is not finite.
    """
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = [[value]]
    if not isinstance(value, list) or not value:
        raise InvalidInput(name, value, "give rows of numbers, such as [[1.0, 0.1], [0.0, 1.0]]")
    if not any(isinstance(row, list) for row in value):
        if flat is None:
            raise InvalidInput(name, value, "give rows of numbers, such as [[1.0, 0.1]] for one row")
        row = _row(name, 0, value, flat=True)
        check_finite(name, np.array(row))
        return np.diag(row) if flat == "diagonal" else np.array(row)[:, None]
    rows = [_row(name, i, row) for i, row in enumerate(value)]
    for i, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise InvalidInput(
                f"{name}[{i}]", f"{len(row)} entries", f"the first row has {len(rows[0])}: give as many"
            )
    matrix = np.array(rows)
    check_finite(name, matrix)
    return matrix


def _row(name: str, i: int, row: Any, *, flat: bool = False) -> list[float]:
    if not isinstance(row, list) or not row:
        raise InvalidInput(f"{name}[{i}]", row, "give a row of numbers")
    for j, entry in enumerate(row):
        if isinstance(entry, bool) or not isinstance(entry, int | float):
            raise InvalidInput(f"{name}[{j}]" if flat else f"{name}[{i}, {j}]", entry, "give a number")
    return [float(entry) for entry in row]


def check_shape(name: str, matrix: np.ndarray, shape: tuple[int, int]) -> None:
    """Refuse a matrix of another shape.

    Raises
    ------
    InvalidInput
    """
    if matrix.shape != shape:
        raise InvalidInput(name, f"shape {matrix.shape}", f"give a matrix of shape {shape}")


def check_noise(name: str, matrix: np.ndarray, form: str) -> None:
    """Refuse unknown forms, magnitudes that cannot be, and variances of zero where one is to be found.

    Parameters
    ----------
    name : str
        ``"Q"`` or ``"R"``.
    matrix : ndarray, shape (k, k)
        Present covariance.
    form : str
        What is to be found, one of `FORMS`.

    Raises
    ------
    UnknownName, InvalidInput
    """
    if form not in FORMS:
        raise UnknownName(f"covariance of {name}", form, FORMS)
    for k, variance in enumerate(np.diag(matrix)):
        if variance > MOST or 0.0 < variance < LEAST:
            raise InvalidInput(
                f"{name}[{k}, {k}]", float(variance), f"a variance is between {LEAST:g} and {MOST:g}"
            )
        if variance == 0.0 and form in ("diagonal", "full"):
            raise InvalidInput(
                f"{name}[{k}, {k}]", 0.0,
                f'a variance to be found ("{form}") must be positive now: give one, or take "scalar"',
            )  # fmt: skip
    if not matrix.any() and form != "fixed":
        raise InvalidInput(name, "all zero", "give the present covariance: it is what is multiplied")


def bounds_of(name: str, value: Any, matrix: np.ndarray, form: str) -> np.ndarray:
    """Least and largest multiples of the present variances.

    Parameters
    ----------
    name : str
        ``"Q"`` or ``"R"``.
    value : list or None
        Pair, or one pair per variance; six decades either way if None.
    matrix : ndarray, shape (k, k)
        Present covariance.
    form : str
        What is to be found.

    Returns
    -------
    ndarray, shape (2,) or (k, 2)

    Raises
    ------
    InvalidInput
        If it is no such pair, or variances would leave `LEAST` to `MOST`.
    """
    if value is None:
        return np.array([10.0**-DECADES, 10.0**DECADES])
    count = {"scalar": 1, "fixed": 0}.get(form, len(matrix))
    label = f"bounds of {name}"
    remedy = f"give [least, largest] multiple of the present variances, or {count} such pairs"
    try:
        limits = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(label, value, remedy) from None
    if limits.shape not in ((2,), (count, 2)):
        raise InvalidInput(label, value, remedy)
    low, high = limits[..., 0], limits[..., 1]
    if not (np.isfinite(limits).all() and (low > 0.0).all() and (low < high).all()):
        raise InvalidInput(label, value, "give positive numbers, the smaller one first")
    scale = matrix.diagonal()[matrix.diagonal() > 0.0]
    if (low.min() * scale.min(initial=1.0) < LEAST) or (high.max() * scale.max(initial=1.0) > MOST):
        raise InvalidInput(label, value, f"the variances would leave {LEAST:g} to {MOST:g}: narrow them")
    return limits
