"""For kernels: several float32 numbers side by side in a vector register, and what is done to them.

Compilers do not see by themselves that eight prototypes, or the candidates of a forward model, can
be computed side by side, for that changes the order in which memory is read. Here is a type that
says so, in a few operations that LLVM turns into what the processor has: SSE, AVX, NEON.
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic as _plain_intrinsic
from numba.extending import models, register_model


class Lanes(types.Type):
    """A number of float32 side by side."""

    def __init__(self, count):
        self.count = count
        super().__init__(name=f"Lanes({count})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, lanes):
        super().__init__(manager, lanes, _vector(lanes))


def _vector(lanes):
    return ir.VectorType(ir.FloatType(), lanes.count)


def _integers(lanes, bits=32):
    return ir.VectorType(ir.IntType(bits), lanes.count)


# A type checker would miss the arguments that numba fills in. An underscore begins the names of
# those that come as LLVM values alone.
intrinsic: Any = _plain_intrinsic(prefer_literal=True)


def spread(builder, number, kind):
    """The same number in all lanes of an LLVM vector type."""
    nothing = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(first, nothing, everywhere)


@intrinsic
def fill(_typing, pointer, _at, count):
    """pointer[at] in all of `count` lanes."""
    lanes = Lanes(count.literal_value)

    def generate(_context, builder, _signature, arguments):
        number = builder.load(builder.gep(arguments[0], [arguments[1]]))
        return spread(builder, number, _vector(lanes))

    return lanes(pointer, types.intp, count), generate


@intrinsic
def load(_typing, pointer, _at, count):
    """pointer[at : at + count]."""
    lanes = Lanes(count.literal_value)

    def generate(_context, builder, _signature, arguments):
        at = builder.gep(arguments[0], [arguments[1]])
        return builder.load(builder.bitcast(at, _vector(lanes).as_pointer()), align=4)

    return lanes(pointer, types.intp, count), generate


@intrinsic
def store(_typing, pointer, _at, lanes):
    """pointer[at : at + count] = lanes."""

    def generate(context, builder, _signature, arguments):
        pointer = builder.gep(arguments[0], [arguments[1]])
        pointer = builder.bitcast(pointer, _vector(lanes).as_pointer())
        builder.store(arguments[2], pointer, align=4)
        return context.get_dummy_value()

    return types.void(pointer, types.intp, lanes), generate


@intrinsic
def zeros(_typing, count):
    """`count` zeros."""
    lanes = Lanes(count.literal_value)

    def generate(_context, _builder, _signature, _arguments):
        return ir.Constant(_vector(lanes), [0.0] * lanes.count)

    return lanes(count), generate


@intrinsic
def difference(_typing, one, other):
    """One − other."""

    def generate(_context, builder, _signature, arguments):
        return builder.fsub(*arguments)

    return one(one, other), generate


@intrinsic
def add_product(_typing, total, one, other):
    """Total + one × other, rounded once where the processor can."""

    def generate(_context, builder, _signature, arguments):
        total, one, other = arguments
        return multiply_add(builder, one, other, total)

    return total(total, one, other), generate


def multiply_add(builder, one, other, addend):
    """The LLVM for it."""
    product = builder.fmul(one, other, flags=("contract",))
    return builder.fadd(product, addend, flags=("contract",))


@intrinsic
def silu(_typing, lanes):
    """SiLU: x / (1 + exp(−x))."""

    def generate(_context, builder, _signature, arguments):
        (x,) = arguments
        one = ir.Constant(x.type, [1.0] * lanes.count)
        return builder.fdiv(x, builder.fadd(one, exponential(builder, builder.fneg(x))))

    return lanes(lanes), generate


_LN2_HIGH = 355 / 512
_TERMS = 7  # of Taylor's series; what is left out is under 1e-8


def exponential(builder, x):
    """exp(x) = 2ⁿ exp(r), |r| ≤ ln 2 / 2 (Cody & Waite, Software Manual, 1980), within 1 ulp.

    n ln 2 is taken off in two parts, the first of so few bits that its product with n is exact.
    Below −87.3 and above 88.3, where float32 nearly ends, and for NaN it is that of such an end.
    """

    def all_lanes(number, kind=x.type):
        return ir.Constant(kind, [number] * kind.count)

    integers = ir.VectorType(ir.IntType(32), x.type.count)
    low, high = all_lanes(-87.3), all_lanes(88.3)
    x = builder.select(builder.fcmp_ordered(">", x, low), x, low)
    x = builder.select(builder.fcmp_ordered("<", x, high), x, high)
    shift = all_lanes(1.5 * 2**23)  # float32 has whole numbers alone there: the sum is rounded
    n = builder.fsub(multiply_add(builder, x, all_lanes(1 / math.log(2)), shift), shift)
    r = multiply_add(builder, n, all_lanes(-_LN2_HIGH), x)
    r = multiply_add(builder, n, all_lanes(_LN2_HIGH - math.log(2)), r)
    series = all_lanes(1 / math.factorial(_TERMS))
    for k in reversed(range(_TERMS)):
        series = multiply_add(builder, series, r, all_lanes(1 / math.factorial(k)))
    exponent = builder.add(builder.fptosi(n, integers), all_lanes(127, integers))
    power = builder.bitcast(builder.shl(exponent, all_lanes(23, integers)), x.type)  # 2ⁿ
    return builder.fmul(series, power)


@intrinsic
def filled(_typing, _number, count):
    """A float32 in all of `count` lanes."""
    lanes = Lanes(count.literal_value)

    def generate(_context, builder, _signature, arguments):
        return spread(builder, arguments[0], _vector(lanes))

    return lanes(types.float32, count), generate


@intrinsic
def added(_typing, one, other):
    """The sum of two."""

    def generate(_context, builder, _signature, arguments):
        return builder.fadd(*arguments)

    return one(one, other), generate


@intrinsic
def where_less(_typing, one, other, yes, no):
    """Of `yes` the lanes in which one < other, of `no` the others."""

    def generate(_context, builder, _signature, arguments):
        one, other, yes, no = arguments
        return builder.select(builder.fcmp_ordered("<", one, other), yes, no)

    return yes(one, other, yes, no), generate


@intrinsic
def first_ones(_typing, lanes, _number):
    """The first lanes, so many; zeros in the others."""

    def generate(_context, builder, _signature, arguments):
        values, number = arguments
        places = ir.Constant(_integers(lanes, 64), list(range(lanes.count)))
        kept = builder.icmp_signed("<", places, spread(builder, number, _integers(lanes, 64)))
        return builder.select(kept, values, ir.Constant(_vector(lanes), [0.0] * lanes.count))

    return lanes(lanes, types.int64), generate


@intrinsic
def sums(_typing, a, b, c, d, e, f, g, h):
    """The sums of eight times eight or sixteen lanes, side by side in eight."""

    def generate(_context, builder, _signature, arguments):
        a, b, c, d, e, f, g, h = (_in_eight(builder, values) for values in arguments)
        low = _pairs(builder, _pairs(builder, a, b), _pairs(builder, c, d))
        high = _pairs(builder, _pairs(builder, e, f), _pairs(builder, g, h))
        return _added(builder, low, high, [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15])

    return Lanes(8)(a, b, c, d, e, f, g, h), generate


@intrinsic
def total(_typing, lanes):
    """The sum of eight or sixteen lanes."""

    def generate(_context, builder, _signature, arguments):
        values = _in_eight(builder, arguments[0])
        for half in (4, 2, 1):
            low, high = list(range(half)), list(range(half, 2 * half))
            values = _added(builder, values, values, low, high)
        return builder.extract_element(values, ir.Constant(ir.IntType(32), 0))

    return types.float32(lanes), generate


def _in_eight(builder, values):
    """The upper half of sixteen lanes added to the lower one."""
    if values.type.count == 8:
        return values
    return _added(builder, values, values, list(range(8)), list(range(8, 16)))


def _pairs(builder, one, other):
    """Sums of neighbours, in the order in which processors add them: half by half."""
    even = [at + vector + half for half in (0, 4) for vector in (0, 8) for at in (0, 2)]
    return _added(builder, one, other, even, [at + 1 for at in even])


def _added(builder, one, other, places, other_places):
    """The sum of two choices among the lanes of two vectors, counted on from one to the other."""
    kind = ir.VectorType(ir.IntType(32), len(places))
    chosen = (
        builder.shuffle_vector(one, other, ir.Constant(kind, order))
        for order in (places, other_places)
    )
    return builder.fadd(*chosen)


@intrinsic
def any_up_to(_typing, lanes, _number):
    """Whether one of them is a float32 or less."""

    def generate(_context, builder, _signature, arguments):
        values, number = arguments
        smaller = builder.fcmp_ordered("<=", values, spread(builder, number, _vector(lanes)))
        bits = builder.bitcast(smaller, ir.IntType(lanes.count))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(lanes, types.float32), generate


@intrinsic
def number_up_to(_typing, lanes, _number):
    """How many of them are a float32 or less."""

    def generate(_context, builder, _signature, arguments):
        values, number = arguments
        smaller = builder.fcmp_ordered("<=", values, spread(builder, number, _vector(lanes)))
        bits = builder.bitcast(smaller, ir.IntType(lanes.count))
        return builder.zext(builder.ctpop(bits), ir.IntType(64))

    return types.int64(lanes, types.float32), generate


@intrinsic
def any_equal(_typing, pointer, _at, count, _number):
    """Whether pointer[at : at + count], of int64, holds a number."""
    wide = ir.VectorType(ir.IntType(64), count.literal_value)

    def generate(_context, builder, _signature, arguments):
        pointer = builder.gep(arguments[0], [arguments[1]])
        values = builder.load(builder.bitcast(pointer, wide.as_pointer()), align=8)
        equal = builder.icmp_signed("==", values, spread(builder, arguments[3], wide))
        bits = builder.bitcast(equal, ir.IntType(wide.count))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(pointer, types.intp, count, types.int64), generate
