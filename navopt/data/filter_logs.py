"""The log of a filter: measurements, inputs and, for scoring only, true states from a CSV file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from navopt.data.track_columns import Table, numbers, read_table, seconds
from navopt.errors import InvalidInput, UnknownName
from navopt.models.linear_gaussian import JITTER

if TYPE_CHECKING:
    from navopt.data.model_files import FilterFile

__all__ = ["FilterLog", "read_log"]

#: Relative difference of the usual step in the log and the file's that is taken for rounding.
STEP_TOLERANCE = 0.01
#: Fewest measurements of a channel.
FEWEST = 3
#: A 1σ of measurement noise is no smaller than this share of the largest measurement, nor larger than so
#: many times: numbers in double precision could not show the one, and the other would hide everything.
SMALLEST_SHARE, LARGEST_SHARE = 1e-14, 1e6


@dataclass(frozen=True, kw_only=True)
class FilterLog:
    """What a filter has been fed with.

    Attributes
    ----------
    y : ndarray, shape (T, m)
        Measurements; NaN where one is missing.
    u : ndarray, shape (T, p), or None
        Known input from each measurement to the next.
    time : ndarray, shape (T,), or None
        Seconds; None where the log has none.
    truth : ndarray, shape (T, n), or None
        True states, NaN where unknown. Nothing but scores uses them.
    channels, inputs : tuple of str
        Names of the measurements and of the inputs.
    source : str
        Name of the file.
    notes : tuple of str
        What was assumed.
    """

    y: np.ndarray
    u: np.ndarray | None = None
    time: np.ndarray | None = None
    truth: np.ndarray | None = None
    channels: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    source: str = ""
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.y)

    def steps(self, time_step: float | None) -> np.ndarray:
        """Seconds from each measurement to the next, shape (T - 1,)."""
        if self.time is not None:
            return np.diff(self.time)
        if time_step is None:
            raise InvalidInput("time_step", None, "give it, or a column of times, beside A")
        return np.full(len(self) - 1, time_step)

    @property
    def regular(self) -> bool:
        """Whether all time steps are the same."""
        if self.time is None or len(self) < 2:
            return True
        gaps = np.diff(self.time)
        return bool((np.abs(gaps - np.median(gaps)) <= JITTER * np.median(gaps)).all())


def read_log(path: str | Path, model: FilterFile) -> FilterLog:
    """Read the log of a filter from a CSV file with a header line.

    Parameters
    ----------
    path : path-like
        The file. Measurements are in the columns `model.columns` names; empty cells are missing
        measurements. A column ``time`` holds seconds, or ISO 8601 dates and times.
    model : FilterFile
        The filter.

    Returns
    -------
    FilterLog

    Raises
    ------
    InvalidInput
        If a column cannot be used: a cell that is no number, times that do not increase or vary where the
        transition is constant, a channel without measurements or stuck at one value, an input that is
        missing, too few rows, or noise of a magnitude that these numbers cannot have. The message names
        the column and the line.
    UnknownName
        If a column does not exist.
    """
    if not Path(path).is_file():
        raise InvalidInput("--data", str(path), "give an existing CSV file")
    try:
        table = read_table(path)
    except InvalidInput as error:
        raise InvalidInput("--data", error.value, error.remedy) from None
    names = model.columns
    y = np.column_stack([numbers(table, _column(table, name, "y"), missing=True) for name in names["y"]])
    u = None
    if names["u"]:
        u = np.column_stack([_input(table, _column(table, name, "u")) for name in names["u"]])
    time, notes = _times(table, model)
    truth = _truth(table, model)
    log = FilterLog(
        y=y,
        u=u,
        time=time,
        truth=truth,
        channels=names["y"],
        inputs=names["u"],
        source=table.name,
        notes=(*table.notes, *notes),
    )
    _check_channels(log)
    _check_length(log, model)
    _check_magnitudes(log, model)
    return log


def _column(table: Table, name: str, role: str) -> str:
    found = table.column(name)
    if found is None:
        raise UnknownName(f"column for {role} in {table.name}", name, table.columns)
    return found


def _input(table: Table, column: str) -> np.ndarray:
    values = numbers(table, column, missing=True)
    # what follows the last measurement is not used
    missing = np.flatnonzero(np.isnan(values[:-1]))
    if missing.size:
        raise InvalidInput(
            f"column {column} of {table.name}",
            f"an empty cell in line {table.line[missing[0]]}",
            "a known input must be known at all times: fill it in, or leave the input out of B",
        )
    return np.nan_to_num(values)


def _times(table: Table, model: FilterFile) -> tuple[np.ndarray | None, tuple[str, ...]]:
    wanted = model.columns["time"]
    column = table.column("time") if wanted is None else _column(table, wanted, "time")
    if column is None:
        jumps = np.flatnonzero(np.diff(table.line) > 1)
        if jumps.size:
            raise InvalidInput(
                table.name, f"an empty line {table.line[jumps[0]] + 1}",
                "without a column of times nobody knows whether a measurement is missing there: add the "
                "column, or take the line out",
            )  # fmt: skip
        return None, ()
    time, _, notes = seconds(table, column, np.ones(len(table), dtype=bool))
    where = f"column {column} of {table.name}"
    gaps = np.diff(time)
    back = np.flatnonzero(gaps <= 0.0)
    if back.size:
        raise InvalidInput(
            where, f"{time[back[0] + 1]:g} after {time[back[0]]:g} in line {table.line[back[0] + 1]}",
            "times must increase",
        )  # fmt: skip
    if not len(gaps):
        return time, notes
    usual = float(np.median(gaps))
    if model.time_step is not None and abs(usual - model.time_step) > STEP_TOLERANCE * model.time_step:
        raise InvalidInput(
            "time_step", model.time_step, f"the usual step in {where} is {usual:g} s: correct one of them"
        )
    odd = np.flatnonzero(np.abs(gaps - usual) > JITTER * usual)
    if odd.size and model.A is None:
        raise InvalidInput(
            where,
            f"a step of {gaps[odd[0]]:.6g} s before line {table.line[odd[0] + 1]}, usually {usual:.6g} s"
            + (f", and {odd.size - 1} more" if odd.size > 1 else ""),
            "F is for one length of step: add rows with empty measurements, or give A of "
            "dx/dt = A x + B u + G w instead of F",
        )
    return time, notes


def _truth(table: Table, model: FilterFile) -> np.ndarray | None:
    out = np.full((len(table), len(model.states)), np.nan)
    for k, state in enumerate(model.states):
        named = model.columns["truth"].get(state)
        column = table.column(f"true_{state}") if named is None else _column(table, named, "truth")
        if column is not None:
            out[:, k] = numbers(table, column, missing=True)
    return out if np.isfinite(out).any() else None


def _check_length(log: FilterLog, model: FilterFile) -> None:
    n = len(model.states)
    unknowns = len(model._box())
    seen = int(np.isfinite(log.y).sum())
    if seen <= n + unknowns:
        raise InvalidInput(
            log.source,
            f"{seen} measurements",
            f"{n} states and {unknowns} numbers of Q and R need more than {n + unknowns}, "
            "and hundreds to be any good",
        )


def _check_channels(log: FilterLog) -> None:
    for channel, values in zip(log.channels, log.y.T, strict=True):
        where = f"column {channel} of {log.source}"
        seen = values[np.isfinite(values)]
        if not len(seen):
            raise InvalidInput(where, "no measurement at all", "leave the channel out, of H and R as well")
        if len(seen) < FEWEST:
            raise InvalidInput(where, f"{len(seen)} measurements", f"give at least {FEWEST}")
        if np.ptp(seen) == 0.0:
            raise InvalidInput(
                where,
                f"{seen[0]:g} in every row",
                "a stuck sensor or a placeholder: check it",
            )


def _check_magnitudes(log: FilterLog, model: FilterFile) -> None:
    """Refuse noise that these measurements cannot have, whatever its units."""
    largest = np.nanmax(np.abs(log.y), axis=0)
    for k, channel in enumerate(log.channels):
        sigma = float(np.sqrt(model.R[k, k]))
        if not SMALLEST_SHARE * largest[k] <= sigma <= LARGEST_SHARE * largest[k]:
            raise InvalidInput(
                f"R[{k}, {k}]", float(model.R[k, k]),
                f"column {channel} of {log.source} reaches {largest[k]:.3g}: no noise there has a 1σ of "
                f"{sigma:.3g}; R is a variance, in the square of the column's unit",
            )  # fmt: skip
    matrices = model.matrices(log)
    F, G = (a if a.ndim == 2 else a[0] for a in (matrices["F"], matrices["G"]))
    seen, power = [], np.eye(len(F))
    for _ in range(len(F)):
        seen.append((model.H @ power @ G) / largest[:, None])
        power = F @ power
    reach = np.abs(np.array(seen)).max(axis=(0, 1))
    for k, share in enumerate(reach):
        sigma = float(np.sqrt(model.Q[k, k]))
        if sigma * share > LARGEST_SHARE:
            raise InvalidInput(
                f"Q[{k}, {k}]", float(model.Q[k, k]),
                f"one step of it would move a measurement by {sigma * share:.1g} times the largest in "
                f"{log.source}; Q is a variance",
            )  # fmt: skip
