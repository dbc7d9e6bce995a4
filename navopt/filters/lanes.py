"""Eight numbers that are computed as one: the vectors of the batched filter's kernels.

LLVM vectorises a loop over candidates only if the loop is long and it can prove that no two arrays overlap.
Filters of a few states have short loops over many small matrices, so the vectors are written out here: a
value of type `Lanes` is an LLVM vector of eight doubles, one for each candidate, whatever the processor has
(one register of AVX-512, two of AVX2, four of SSE or NEON). Lanes never meet, so a candidate has the same
bits in any lane and in any company.

Memory is addressed by a plain integer (``array.ctypes.data``), because numba counts references of an array
whenever it passes one on, which costs more than the arithmetic. Who calls these must keep the arrays alive
and the rows inside them: nothing is checked. Single numbers are read and written as "unordered atomic",
which costs nothing and keeps the compiler from spending its time on vectors of its own.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

__all__ = [
    "HUGE",
    "INDEX",
    "LANES",
    "TINY",
    "VECTOR",
    "Lanes",
    "add",
    "call",
    "choose",
    "count_set",
    "div",
    "exponent",
    "first_bad",
    "fused",
    "if_close",
    "keep_small",
    "load",
    "log",
    "mantissa",
    "mul",
    "muladd",
    "mulsub",
    "peek",
    "peek_index",
    "poke",
    "poke_index",
    "splat",
    "store",
    "sub",
]

#: Candidates computed together.
LANES = 8
#: A variance outside these limits is a failure: two of them can still be multiplied without overflow.
TINY, HUGE = 1e-150, 1e150

# LLVM's names of a number, of eight and of an address
DOUBLE = ir.DoubleType()
VECTOR = ir.VectorType(DOUBLE, LANES)
INDEX = ir.IntType(64)
_INTEGERS = ir.VectorType(INDEX, LANES)


class Lanes(types.Type):
    """Numba type of a vector of `LANES` doubles."""

    def __init__(self) -> None:
        super().__init__(name="navopt.Lanes")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


_lanes = Lanes()


def _splat(builder: Any, value: Any) -> Any:
    undefined = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(
        first, undefined, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    )


def _address(context: Any, builder: Any, signature: Any, args: Any, width: int, kind: Any) -> Any:
    """Pointer to element or row ``args[1]`` of the memory at ``args[0]``."""
    row = context.cast(builder, args[1], signature.args[1], types.int64)
    offset = builder.mul(row, ir.Constant(INDEX, 8 * width))
    return builder.inttoptr(builder.add(args[0], offset), kind.as_pointer())


@intrinsic
def load(typing, base, row):
    """Vector in row `row` of the memory at `base`, rows being `LANES` doubles long."""

    def generate(context, builder, signature, args):
        value = builder.load(_address(context, builder, signature, args, LANES, VECTOR))
        value.align = 8
        return value

    return _lanes(types.int64, row), generate


@intrinsic
def store(typing, base, row, value):
    """Write a vector into row `row` of the memory at `base`."""

    def generate(context, builder, signature, args):
        done = builder.store(args[2], _address(context, builder, signature, args, LANES, VECTOR))
        done.align = 8
        return context.get_dummy_value()

    return types.none(types.int64, row, _lanes), generate


@intrinsic
def peek(typing, base, k):
    """Double number `k` of the memory at `base`."""

    def generate(context, builder, signature, args):
        return builder.load_atomic(_address(context, builder, signature, args, 1, DOUBLE), "unordered", 8)

    return types.float64(types.int64, k), generate


@intrinsic
def peek_index(typing, base, k):
    """Integer (64 bits) number `k` of the memory at `base`."""

    def generate(context, builder, signature, args):
        return builder.load(_address(context, builder, signature, args, 1, INDEX))

    return types.int64(types.int64, k), generate


@intrinsic
def poke(typing, base, k, value):
    """Write double number `k` of the memory at `base`."""

    def generate(context, builder, signature, args):
        builder.store_atomic(args[2], _address(context, builder, signature, args, 1, DOUBLE), "unordered", 8)
        return context.get_dummy_value()

    return types.none(types.int64, k, types.float64), generate


@intrinsic
def poke_index(typing, base, k, value):
    """Write integer (64 bits) number `k` of the memory at `base`."""

    def generate(context, builder, signature, args):
        builder.store(args[2], _address(context, builder, signature, args, 1, INDEX))
        return context.get_dummy_value()

    return types.none(types.int64, k, types.int64), generate


@intrinsic
def keep_small(typing):
    """Tell the compiler to write the function as short as it can, which takes it much less time.

    Loops that are unrolled are no faster where every one of them works on vectors already.
    """

    def generate(context, builder, signature, args):
        builder.function.attributes.add("minsize")
        builder.function.attributes.add("optsize")
        return context.get_dummy_value()

    return types.none(), generate


@intrinsic
def call(typing, function, argument):
    """Call a compiled function of one integer by its address."""

    def generate(context, builder, signature, args):
        kind = ir.FunctionType(ir.VoidType(), [INDEX])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1]])
        return context.get_dummy_value()

    return types.none(types.int64, types.int64), generate


@intrinsic
def splat(typing, value):
    """Vector whose lanes all hold the same number."""

    def generate(context, builder, signature, args):
        return _splat(builder, args[0])

    return _lanes(types.float64), generate


@intrinsic
def add(typing, a, b):
    """``a + b``."""
    return _lanes(_lanes, _lanes), lambda context, builder, signature, args: builder.fadd(*args)


@intrinsic
def sub(typing, a, b):
    """``a - b``."""
    return _lanes(_lanes, _lanes), lambda context, builder, signature, args: builder.fsub(*args)


@intrinsic
def mul(typing, a, b):
    """``a * b``."""
    return _lanes(_lanes, _lanes), lambda context, builder, signature, args: builder.fmul(*args)


@intrinsic
def div(typing, a, b):
    """``a / b``."""
    return _lanes(_lanes, _lanes), lambda context, builder, signature, args: builder.fdiv(*args)


def fused(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """``a * b + c`` in LLVM's terms."""
    # fused where the processor can, rounded twice where it cannot: the same everywhere on one machine
    signature = ir.FunctionType(VECTOR, [VECTOR] * 3)
    function = cgutils.get_or_insert_function(builder.module, signature, f"llvm.fmuladd.v{LANES}f64")
    return builder.call(function, [a, b, c])


@intrinsic
def muladd(typing, a, b, c):
    """``a * b + c``."""

    def generate(context, builder, signature, args):
        return fused(builder, *args)

    return _lanes(_lanes, _lanes, _lanes), generate


@intrinsic
def mulsub(typing, a, b, c):
    """``c - a * b``."""

    def generate(context, builder, signature, args):
        return fused(builder, builder.fneg(args[0]), args[1], args[2])

    return _lanes(_lanes, _lanes, _lanes), generate


@intrinsic
def choose(typing, mask, a, b):
    """`a` where the mask is not zero, else `b`."""

    def generate(context, builder, signature, args):
        mask, a, b = args
        zero = _splat(builder, ir.Constant(DOUBLE, 0.0))
        return builder.select(builder.fcmp_unordered("!=", mask, zero), a, b)

    return _lanes(_lanes, _lanes, _lanes), generate


@intrinsic
def if_close(typing, mask, change, size):
    """The mask where ``change² <= size``, elsewhere zero."""

    def generate(context, builder, signature, args):
        mask, change, size = args
        near = builder.fcmp_ordered("<=", builder.fmul(change, change), size)
        return builder.select(near, mask, _splat(builder, ir.Constant(DOUBLE, 0.0)))

    return _lanes(_lanes, _lanes, _lanes), generate


@intrinsic
def count_set(typing, mask):
    """How many lanes of a mask are not zero."""

    def generate(context, builder, signature, args):
        result = ir.Constant(INDEX, 0)
        zero = ir.Constant(DOUBLE, 0.0)
        for k in range(LANES):
            lane = builder.extract_element(args[0], ir.Constant(ir.IntType(32), k))
            one = builder.zext(builder.fcmp_unordered("!=", lane, zero), INDEX)
            result = builder.add(result, one)
        return result

    return types.int64(_lanes), generate


def _constants(value: int) -> Any:
    return ir.Constant(_INTEGERS, [value] * LANES)


@intrinsic
def exponent(typing, a):
    """Binary exponent of positive numbers, as a vector of doubles: ``a = mantissa(a) 2^exponent(a)``."""

    def generate(context, builder, signature, args):
        bits = builder.lshr(builder.bitcast(args[0], _INTEGERS), _constants(52))
        # put behind the point of 2^52 an integer becomes a double without a conversion, which AVX2 lacks
        shifted = builder.bitcast(builder.or_(bits, _constants(0x4330000000000000)), VECTOR)
        return builder.fsub(shifted, _splat(builder, ir.Constant(DOUBLE, 2.0**52 + 1023.0)))

    return _lanes(_lanes), generate


@intrinsic
def mantissa(typing, a):
    """Positive numbers divided by a power of two, between 1 and 2."""

    def generate(context, builder, signature, args):
        bits = builder.and_(builder.bitcast(args[0], _INTEGERS), _constants(0x000FFFFFFFFFFFFF))
        return builder.bitcast(builder.or_(bits, _constants(0x3FF0000000000000)), VECTOR)

    return _lanes(_lanes), generate


@intrinsic
def log(typing, a):
    """Natural logarithm."""

    def generate(context, builder, signature, args):
        signature = ir.FunctionType(VECTOR, [VECTOR])
        function = cgutils.get_or_insert_function(builder.module, signature, f"llvm.log.v{LANES}f64")
        return builder.call(function, args)

    return _lanes(_lanes), generate


@intrinsic
def first_bad(typing, step, variance, now):
    """`step`, or `now` where the variance is not between `TINY` and `HUGE` and no lane failed before.

    A step not reached counts as infinite; NaN is outside all limits.
    """

    def generate(context, builder, signature, args):
        step, variance, now = args
        low, high = (_splat(builder, ir.Constant(DOUBLE, limit)) for limit in (TINY, HUGE))
        good = builder.and_(
            builder.fcmp_ordered(">", variance, low), builder.fcmp_ordered("<", variance, high)
        )
        now = _splat(builder, now)
        keep = builder.or_(good, builder.fcmp_ordered("<", step, now))
        return builder.select(keep, step, now)

    return _lanes(_lanes, _lanes, types.float64), generate
