"""The sums of products that a batched filter consists of, as machine code.

An instruction computes ``to[i, j] = start[i, j] + Σ_c factors[i, c] of[i, c, j]`` for all blocks, each entry
being a row of eight lanes. The loops are written in LLVM's terms, because several sums must stay in
registers over c for the processor to be busy with arithmetic and not with memory. Instructions are written
by `navopt.filters.batch_kalman_program`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from navopt.filters.lanes import INDEX, LANES, VECTOR, fused

__all__ = ["OPERATION", "add_sums"]

#: Integers of an instruction, distances in bytes. Results go to ``to`` and, if it is not negative, to `twin`;
#: a `step` leads to the next column j or the next term, a `row` to the next row i, which has `less` columns
#: fewer. The factors are rows of the block or, if `common` is 1, of those that all share. The distance of
#: each term from `of` is at `places`, counted from the instruction.
OPERATION = (
    "code", "to", "to_step", "to_row", "twin", "twin_step", "twin_row", "start", "start_row", "of", "of_row",
    "columns", "less", "rows", "terms", "factors", "factors_step", "factors_row", "common", "places",
    "places_row",
)  # fmt: skip
#: Sums kept in registers at a time.
WIDTH = 8
ROW = 8 * LANES


def _integer(value: int) -> Any:
    return ir.Constant(INDEX, value)


def _read(builder: Any, address: Any, kind: Any) -> Any:
    value = builder.load(builder.inttoptr(address, kind.as_pointer()))
    value.align = 8
    return value


def _write(builder: Any, value: Any, address: Any) -> None:
    builder.store(value, builder.inttoptr(address, VECTOR.as_pointer())).align = 8


class _Sums:
    """Writes the loops of an instruction."""

    def __init__(self, builder: Any, operation: Any, bases: Any, blocks: Any, shared: Any) -> None:
        self.builder, self.operation = builder, operation
        self.bases, self.blocks, self.shared = bases, blocks, shared

    def field(self, name: str) -> Any:
        """Entry of the instruction."""
        return _read(self.builder, self.plus(self.operation, 8 * OPERATION.index(name)), INDEX)

    def plus(self, address: Any, by: Any) -> Any:
        """Sum of an address and a distance."""
        return self.builder.add(address, _integer(by) if isinstance(by, int) else by)

    def variable(self, value: Any) -> Any:
        """Place of an integer or of a vector that changes."""
        place = cgutils.alloca_once(self.builder, value.type)
        self.builder.store(value, place)
        return place

    def forward(self, place: Any, by: Any) -> None:
        """Add to a variable."""
        self.builder.store(self.plus(self.builder.load(place), by), place)

    def write(self) -> None:
        """Rows, and of each row its columns: eight at a time, then four, then the last three, two or one."""
        builder, field = self.builder, self.field
        names = ("to", "twin", "start", "of", "factors", "places")
        places = {name: self.variable(field(name)) for name in names}
        columns = self.variable(field("columns"))
        with _times(builder, field("rows")):
            self.at = {name: self.variable(builder.load(place)) for name, place in places.items()}
            number = builder.load(columns)
            with _times(builder, builder.ashr(number, _integer(3))):
                self._columns(WIDTH)
            with builder.if_then(builder.trunc(builder.ashr(number, _integer(2)), ir.IntType(1))):
                self._columns(4)
            rest = builder.and_(number, _integer(3))
            for width in (3, 2, 1):
                with builder.if_then(builder.icmp_signed("==", rest, _integer(width))):
                    self._columns(width)
            for name, place in places.items():
                self.forward(place, field(f"{name}_row"))
            builder.store(builder.sub(builder.load(columns), field("less")), columns)

    def _columns(self, width: int) -> None:
        """So many neighbouring sums, in registers, for one block after the other; then on to the next."""
        builder, field, plus = self.builder, self.field, self.plus
        at = {name: builder.load(place) for name, place in self.at.items()}
        bases = self.variable(self.bases)
        with _times(builder, self.blocks):
            base = _read(builder, builder.load(bases), INDEX)
            self.forward(bases, 8)
            start = plus(base, at["start"])
            totals = [self.variable(_read(builder, plus(start, ROW * j), VECTOR)) for j in range(width)]
            row = plus(base, at["of"])
            theirs = builder.select(builder.trunc(field("common"), ir.IntType(1)), self.shared, base)
            factor = self.variable(plus(theirs, at["factors"]))
            place = self.variable(plus(self.operation, at["places"]))
            with _times(builder, field("terms")):
                value = _read(builder, builder.load(factor), VECTOR)
                self.forward(factor, field("factors_step"))
                here = plus(row, _read(builder, builder.load(place), INDEX))
                self.forward(place, 8)
                for j, total in enumerate(totals):
                    term = _read(builder, plus(here, ROW * j), VECTOR)
                    builder.store(fused(builder, value, term, builder.load(total)), total)
            self._store(totals, plus(base, at["to"]), field("to_step"))
            # read here, where it could have been written over, lest the compiler doubles the loops for it
            with builder.if_then(builder.icmp_signed(">=", field("twin"), _integer(0))):
                self._store(totals, plus(base, at["twin"]), field("twin_step"))
        for name in ("start", "of"):
            self.forward(self.at[name], ROW * width)
        for name in ("to", "twin"):
            self.forward(self.at[name], builder.mul(field(f"{name}_step"), _integer(width)))

    def _store(self, totals: list[Any], place: Any, step: Any) -> None:
        for total in totals:
            _write(self.builder, self.builder.load(total), place)
            place = self.plus(place, step)


@contextmanager
def _times(builder: Any, count: Any) -> Iterator[None]:
    """Do what is written inside so many times."""
    left = cgutils.alloca_once(builder, INDEX)
    builder.store(count, left)
    check, body, end = (builder.append_basic_block(name) for name in ("check", "body", "end"))
    builder.branch(check)
    builder.position_at_end(check)
    builder.cbranch(builder.icmp_signed(">", builder.load(left), _integer(0)), body, end)
    builder.position_at_end(body)
    yield
    builder.store(builder.sub(builder.load(left), _integer(1)), left)
    builder.branch(check)
    builder.position_at_end(end)


@intrinsic
def add_sums(typing, operation, bases, blocks, shared):
    """Carry out an instruction.

    Parameters
    ----------
    operation, bases, shared : int
        Addresses of the instruction, of the addresses of the blocks' rows, and of rows that all blocks share.
    blocks : int
        How many blocks.
    """

    def generate(context, builder, signature, args):
        _Sums(builder, *args).write()
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, types.int64, types.int64), generate
