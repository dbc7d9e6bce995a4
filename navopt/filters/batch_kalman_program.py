"""One step of the batched filter as a list of sums of products.

The equations of a Kalman filter are few, but which entries of F and H are zero, how many channels there are
and how they are used differs from model to model. So the step is written down here, once for a model, as a
list of instructions that `navopt.filters.batch_kalman_kernels` carries out for all candidates at every time.
An instruction works on rows of a workspace, a row holding one entry of a matrix for `LANES` candidates.

The state is kept as one more column of its covariance, and so is the negative innovation with ``w = P hᵀ``:
the sums that move the covariance move the state as well.

Measurements are used one at a time with symmetric P. Correlated ones are made independent on the way: with
f = -L of ``S = L D Lᵀ``, ``w_k += Σ_i f_ki w_i`` and the same for the innovations; ρ is the covariance of a
channel's noise with the earlier innovations, zero if R is diagonal.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from navopt.filters.lane_sums import OPERATION
from navopt.filters.lanes import LANES

__all__ = [
    "CHECK",
    "CLOSE",
    "FIELDS",
    "JOSEPH",
    "MATRICES",
    "MATRIX",
    "SEQUENTIAL",
    "STAGES",
    "SUMS",
    "Layout",
    "entries",
    "programs",
]

SEQUENTIAL, MATRIX, JOSEPH = 0, 1, 2
#: Integers of an instruction.
FIELDS = len(OPERATION)
#: Kinds of instruction: sums, of `navopt.filters.lane_sums`; go past a channel that is missing; finish a
#: channel, all of whose sums are there.
SUMS, CHECK, CLOSE = range(3)
#: Matrices of which each entry that is not zero at all times is a row that all blocks share; what the known
#: input adds to the state and the true state are columns.
MATRICES = ("F", "H", "G", "drive", "truth", "HT")

#: Programs in the order of a step: update where all channels are measured, or only some; errors; noise;
#: prediction. Then those of a step whose covariance rests: update of the state, its errors, the next state.
STAGES = ("update", "partial", "errors", "noise", "predict", "innovate", "rest_errors", "move")
ROW = 8 * LANES

#: Columns of the entries of each row of a matrix that are not zero at all times.
Columns = tuple[tuple[int, ...], ...]


def entries(matrices: np.ndarray) -> tuple[Columns, np.ndarray]:
    """Columns of the entries of (T or 1, rows, columns) and the entries, (T or 1, number), row after row."""
    there = (matrices != 0.0).any(axis=0)
    columns = tuple(tuple(np.flatnonzero(row).tolist()) for row in there)
    return columns, np.ascontiguousarray(matrices[:, there])


class Layout:
    """Where things are: numbers of rows, in the workspace of a block and among those that all share.

    Parameters
    ----------
    g : int
        Process noises.
    columns : tuple of tuple of tuple of int
        `Columns` of each of `MATRICES`, HT being Hᵀ.
    """

    #: Single rows in front, which the kernels know as well, and the first of some zeros. The first four are
    #: not set at the first step but before.
    CANDIDATE, PADDING, STATE, SETTLED, PRODUCT, POWER, CHI, FAIL, STEP_CHI, ONE, MINUS, ZERO = range(12)

    def __init__(self, g: int, columns: tuple[Columns, ...]) -> None:
        self.shared = dict(zip(MATRICES, columns, strict=True))
        self.n, self.m, self.g = n, m, g = len(self.shared["F"]), len(self.shared["H"]), g
        # rows of P, of A = (F P)ᵀ and of the w are one longer than n, for the state
        self.wide = n + 1
        sizes = {
            "squares": n, "error": n, "P": self.wide**2, "held": self.wide**2, "Q": g * g, "R": m * m,
            "A": self.wide**2, "W": n * n, "GQ": g * n, "w": m * self.wide, "gain": m * n, "factor": m * m,
            "rho": m * m, "s": m, "inverse": m, "whole": m * n, "C": m * n,
        }  # fmt: skip
        self._first, at = {}, self.ZERO + max(self.wide, g, m)
        for name, size in sizes.items():
            self._first[name] = at
            at += size
        self.rows = at

    def shared_row(self, matrix: str) -> int:
        """First of the rows of a matrix that all blocks share."""
        before = MATRICES[: MATRICES.index(matrix)]
        return sum(len(columns) for name in before for columns in self.shared[name])

    def at(self, name: str, i: int = 0, j: int = 0) -> int:
        """Row of entry (i, j)."""
        return self._first[name] + i * self.width(name) + j

    def width(self, name: str) -> int:
        """Rows from one row of a matrix to its next."""
        widths = {"P": self.wide, "held": self.wide, "A": self.wide, "w": self.wide, "Q": self.g,
                  "R": self.m, "factor": self.m, "rho": self.m, "s": 1, "inverse": 1}  # fmt: skip
        return widths.get(name, self.n)


class _Program:
    """Instructions in the order they are carried out."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._instructions: list[tuple[dict[str, int], list[int]]] = []

    def sums(self, matrix: str, first: int, rows: int, *, stride: int, **entries: int) -> None:
        """``to[i, j] = start[i, j] + Σ_c matrix[first + i, c] of[i, c stride + j]`` for some of its rows.

        The rest are entries of `OPERATION`, in rows of the workspace where those are in bytes.
        """
        columns, done = self.layout.shared[matrix], 0
        while done < rows:
            # neighbouring rows with as many entries make one instruction
            at = first + done
            terms, more = len(columns[at]), 1
            while done + more < rows and len(columns[at + more]) == terms:
                more += 1
            here = {"start": Layout.ZERO, **entries, "rows": more, "terms": terms, "common": 1}
            for name in ("to", "twin", "start", "of"):
                if name in here:
                    here[name] += done * entries.get(f"{name}_row", 0)
            here["columns"] -= done * entries.get("less", 0)
            here["factors"] = self.layout.shared_row(matrix) + sum(map(len, columns[:at]))
            places = [stride * c for row in columns[at : at + more] for c in row]
            self._add(places, factors_step=1, factors_row=terms, places_row=terms, **here)
            done += more

    def lane_sums(self, *, of_step: int = 0, **entries: int) -> None:
        """``to[i, j] = start[i, j] + Σ_c factors[i, c] of[i, c of_step + j]``, all rows of the block."""
        self._add([of_step * c for c in range(entries["terms"])], **entries)

    def _add(self, places: list[int], **entries: int) -> None:
        entries = {"to_step": 1, "twin": -1, "start": Layout.ZERO, "rows": 1, "places_row": 0, **entries}
        numbers = ("columns", "less", "rows", "terms", "common")
        instruction = {name: value if name in numbers else ROW * value for name, value in entries.items()}
        instruction["places_row"] = 8 * entries["places_row"]
        self._instructions.append(({"code": SUMS, **instruction}, [ROW * place for place in places]))

    def other(self, code: int, k: int = 0, *, known: bool = False) -> int:
        """Check or close channel k, or make the next state; returns the place of the instruction."""
        self._instructions.append(
            ({"code": code, "to": k, "to_step": self.layout.at("w", k), "to_row": int(known)}, [])
        )
        return len(self._instructions) - 1

    def skip_to_here(self, place: int) -> None:
        """Make a `CHECK` go on here if the channel is missing."""
        self._instructions[place][0]["to_row"] = 8 * FIELDS * (len(self._instructions) - place)

    def pack(self) -> np.ndarray:
        """All as integers: the number of instructions, these, and the places of their terms."""
        end = 1 + FIELDS * len(self._instructions)
        flat: list[int] = [len(self._instructions)]
        tail: list[int] = []
        for instruction, places in self._instructions:
            # places are counted from the instruction
            instruction["places"] = 8 * (end + len(tail) - len(flat))
            flat += [instruction.get(name, 0) for name in OPERATION]
            tail += places
        return np.array(flat + tail, dtype=np.int64)


def _symmetric(layout: Layout) -> dict[str, int]:
    """Where rows of P go from their diagonal on, and the columns that are their mirrors."""
    there, down = layout.at("P"), layout.wide + 1
    return {"to": there, "to_row": down, "twin": there, "twin_row": down, "twin_step": layout.wide, "less": 1,
            "rows": layout.n, "of_row": 1}  # fmt: skip


def _noise(program: _Program) -> None:
    """``W = G Q Gᵀ``, from the diagonal on."""
    at, n, g = program.layout.at, program.layout.n, program.layout.g
    program.sums("G", 0, n, of=at("Q"), stride=g, columns=g, to=at("GQ"), to_row=1, to_step=n)
    program.sums(
        "G", 0, n, of=at("GQ"), of_row=1, stride=n, columns=n, less=1, to=at("W"), to_row=n + 1
    )  # fmt: skip


def _update(program: _Program, update: int, *, partial: bool) -> None:
    """All channels one after the other; then the state and the covariance."""
    layout = program.layout
    at, n, m, wide = layout.at, layout.n, layout.m, layout.wide
    for k in range(m):
        w, noise = at("w", k), at("R", k, k)
        if partial:
            # what later channels and the covariance take of this one if it is missing
            for name, columns in (("gain", n), ("factor", m), ("inverse", 1)):
                program.lane_sums(to=at(name, k), terms=0, columns=columns)
            program.lane_sums(to=w + n, terms=0, columns=1)
            check = program.other(CHECK, k)
        program.sums("H", k, 1, of=at("P"), stride=wide, columns=wide, to=w)
        for i in range(k):
            rho = Layout.ZERO
            if update != SEQUENTIAL:
                rho = at("rho", k, i)
                program.lane_sums(
                    to=rho, start=at("R", k, i), factors=at("factor", i), factors_step=1, of=at("rho", k),
                    of_step=1, terms=i, columns=1,
                )  # fmt: skip
            program.sums("H", k, 1, of=at("w", i), stride=1, columns=1, to=at("s", k), start=rho)
            program.lane_sums(
                to=at("factor", k, i), factors=at("s", k), of=at("inverse", i), terms=1, columns=1
            )
        if k:
            before = {"factors": at("factor", k), "factors_step": 1, "terms": k}
            program.lane_sums(to=w, start=w, of=at("w"), of_step=wide, columns=wide, **before)
            if update != SEQUENTIAL:
                noise, own = at("rho", k, k), noise
                program.lane_sums(to=noise, start=own, of=at("rho", k), of_step=1, columns=1, **before)
        program.sums("H", k, 1, of=w, stride=1, columns=1, to=at("s", k), start=noise)
        program.other(CLOSE, k)
        if partial:
            program.skip_to_here(check)
    if update == JOSEPH:
        _correct_state(program, twin=at("P", 0, n), twin_step=wide)
        _joseph(program)
        return
    # the state is the last entry of each row
    program.lane_sums(
        start=at("P"), start_row=wide + 1, factors=at("gain"), factors_row=1, factors_step=n, of=at("w"),
        of_step=wide, terms=m, columns=wide, **_symmetric(layout),
    )  # fmt: skip


def _correct_state(program: _Program, **twin: int) -> None:
    """``x += K e`` by the independent channels."""
    layout = program.layout
    at, n, m = layout.at, layout.n, layout.m
    program.lane_sums(
        to=at("P", n), start=at("P", n), factors=at("w", 0, n), factors_step=layout.wide, of=at("gain"),
        of_step=n, terms=m, columns=n, **twin,
    )  # fmt: skip


def _joseph(program: _Program) -> None:
    """``P = (I - K H) P (I - K H)ᵀ + K R Kᵀ``."""
    layout = program.layout
    at, n, m, wide = layout.at, layout.n, layout.m, layout.wide
    # -K from the gains of the independent channels
    for j in reversed(range(m)):
        program.lane_sums(
            to=at("whole", j), start=at("gain", j), factors=at("factor", j + 1, j), factors_step=m,
            of=at("whole", j + 1), of_step=n, terms=m - 1 - j, columns=n,
        )  # fmt: skip
    # A holds (I - K H)ᵀ, held the product (I - K H) P
    program.sums("HT", 0, n, of=at("whole"), stride=n, columns=n, to=at("A"), to_row=wide)
    for c in range(n):
        here = at("A", c, c)
        program.lane_sums(to=here, start=here, factors=Layout.ONE, of=Layout.ONE, terms=1, columns=1)
    program.lane_sums(
        to=at("held"), to_row=wide, rows=n, factors=at("A"), factors_row=1, factors_step=wide, of=at("P"),
        of_step=wide, terms=n, columns=n,
    )  # fmt: skip
    program.lane_sums(
        to=at("C"), to_row=n, rows=m, factors=at("R"), factors_row=m, factors_step=1, of=at("whole"),
        of_step=n, terms=m, columns=n,
    )  # fmt: skip
    program.lane_sums(
        factors=at("held"), factors_row=wide, factors_step=1, of=at("A"), of_step=wide, terms=n, columns=n,
        **_symmetric(layout),
    )  # fmt: skip
    program.lane_sums(
        start=at("P"), start_row=wide + 1, factors=at("whole"), factors_row=1, factors_step=n, of=at("C"),
        of_step=n, terms=m, columns=n, **_symmetric(layout),
    )  # fmt: skip


def _predict(program: _Program) -> None:
    """``P = F P Fᵀ + W`` and, in the last column, ``x = F x + drive``."""
    layout = program.layout
    at, n, wide = layout.at, layout.n, layout.wide
    program.sums("F", 0, n, of=at("P"), stride=wide, columns=wide, to=at("A"), to_row=1, to_step=wide)
    program.sums(
        "F", 0, n, of=at("A"), stride=wide, columns=n, start=at("W"), start_row=n + 1,
        **{name: value for name, value in _symmetric(layout).items() if name != "rows"},
    )  # fmt: skip
    program.lane_sums(to=at("P", n), twin=at("P", 0, n), twin_step=wide, start=at("A", n), terms=0, columns=n)
    _add_drive(program)


def _add_drive(program: _Program) -> None:
    """What the known input adds to the state."""
    at, n, wide = program.layout.at, program.layout.n, program.layout.wide
    if any(program.layout.shared["drive"]):
        program.sums("drive", 0, n, of=Layout.ONE, stride=0, columns=1, start=at("P", n), start_row=1,
                     to=at("P", n), to_row=1, twin=at("P", 0, n), twin_row=wide)  # fmt: skip


def _errors(program: _Program) -> None:
    """Squares of the errors of the state."""
    at, n = program.layout.at, program.layout.n
    program.sums("truth", 0, n, of=Layout.MINUS, stride=0, columns=1, start=at("P", n), start_row=1,
                 to=at("error"), to_row=1)  # fmt: skip
    program.lane_sums(
        to=at("squares"), to_row=1, start=at("squares"), start_row=1, rows=n, factors=at("error"),
        factors_row=1, of=at("error"), of_row=1, terms=1, columns=1,
    )  # fmt: skip


def _innovate(program: _Program) -> None:
    """The update of a state whose covariance has settled."""
    at, n, m, wide = program.layout.at, program.layout.n, program.layout.m, program.layout.wide
    for k in range(m):
        error = at("w", k, n)
        program.sums("H", k, 1, of=at("P", n), stride=1, columns=1, to=error)
        if k:
            program.lane_sums(
                to=error, start=error, factors=at("factor", k), factors_step=1, of=at("w", 0, n),
                of_step=wide, terms=k, columns=1,
            )  # fmt: skip
        program.other(CLOSE, k, known=True)
    _correct_state(program, twin=at("A", n), twin_step=1)


def _move(program: _Program) -> None:
    """The next state alone."""
    at, n, wide = program.layout.at, program.layout.n, program.layout.wide
    program.sums("F", 0, n, of=at("A", n), stride=1, columns=1, to=at("P", n), to_row=1, twin=at("P", 0, n),
                 twin_row=wide)  # fmt: skip
    _add_drive(program)


@lru_cache(maxsize=64)
def programs(g: int, columns: tuple[Columns, ...], update: int, compares: bool) -> tuple[np.ndarray, ...]:
    """Programs of `STAGES`.

    Parameters
    ----------
    g, columns
        As for `Layout`.
    update : int
        `SEQUENTIAL`, which ignores all of R but its diagonal, `MATRIX` or `JOSEPH`.
    compares : bool
        Whether there are true states.
    """
    layout = Layout(g, columns)
    writers = {
        "update": lambda program: _update(program, update, partial=False),
        "partial": lambda program: _update(program, update, partial=True),
        "errors": _errors,
        "noise": _noise,
        "predict": _predict,
        "innovate": _innovate,
        "rest_errors": _errors,
        "move": _move,
    }
    packed = []
    for stage in STAGES:
        program = _Program(layout)
        if compares or writers[stage] is not _errors:
            writers[stage](program)
        packed.append(program.pack())
        packed[-1].setflags(write=False)
    return tuple(packed)
