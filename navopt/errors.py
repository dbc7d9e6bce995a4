"""Every error navopt raises on purpose, under one root.

A message names the argument, the value received and the remedy, so that a user can act on it
without reading the source.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

__all__ = [
    "InvalidInput",
    "MissingData",
    "MissingExtra",
    "NavoptError",
    "NoBound",
    "NoTruth",
    "NumericalFault",
    "StoreError",
    "UnknownName",
    "UnsuitableProblem",
]


class NavoptError(Exception):
    """Root of all errors raised by navopt, baselines and comparisons."""


class InvalidInput(NavoptError, ValueError):
    """An argument has a value that cannot be used.

    Parameters
    ----------
    argument : str
        Name of the argument, as the caller wrote it.
    value : object
        What was received; long values are shortened in the message.
    remedy : str
        What to give instead.
    """

    def __init__(self, argument: str, value: Any, remedy: str) -> None:
        super().__init__(argument, value, remedy)
        self.argument, self.value, self.remedy = argument, value, remedy

    def __str__(self) -> str:
        shown = self.value if isinstance(self.value, str) else repr(self.value)
        if len(shown) > 120:
            shown = shown[:117] + "..."
        return f"{self.argument}: got {shown}; {self.remedy}"


class UnknownName(InvalidInput, KeyError):
    """A name is not among the known ones; the message suggests the nearest.

    Parameters
    ----------
    argument : str
        What was being named (``solver``, ``problem``, ``key``).
    name : str
        The name received.
    known : iterable of str
        The names that would have been accepted.
    """

    def __init__(self, argument: str, name: str, known: Iterable[str]) -> None:
        self.known = sorted(known)
        near = difflib.get_close_matches(str(name), self.known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}? " if near else ""
        super().__init__(argument, repr(name), f"{hint}known: {', '.join(self.known)}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.argument, self.value.strip("'"), self.known)

    __str__ = InvalidInput.__str__


class UnsuitableProblem(NavoptError, TypeError):
    """A solver cannot solve this problem; the message says what it needs."""


class NoTruth(NavoptError):
    """The problem carries no truth (recorded data), so nothing can be scored against it."""


class NoBound(NavoptError):
    """No Cramér–Rao bound has been derived for this problem or at this point."""


class NumericalFault(NavoptError, ArithmeticError):
    """A model returned NaN; the message names the candidate and the model."""


class MissingData(InvalidInput):
    """A recorded file that does not come with navopt is not where it was looked for."""


class MissingExtra(NavoptError, ImportError):
    """An optional dependency is not installed.

    Parameters
    ----------
    extra : str
        The extra of the distribution that brings it.
    purpose : str
        What needs it.
    """

    def __init__(self, extra: str, purpose: str) -> None:
        super().__init__(extra, purpose)
        self.extra, self.purpose = extra, purpose

    def __str__(self) -> str:
        return f"{self.purpose} needs the extra {self.extra!r}: pip install 'navopt[{self.extra}]'"


class StoreError(NavoptError):
    """A results store cannot be used: corrupt, from a newer version, or of another study."""
