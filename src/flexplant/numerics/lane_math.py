"""More arithmetic on `Lanes`: differences, quotients, several reciprocals from one division, and complex numbers in memory.

Imported only where numba is installed; see `numerics.lanes`.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from flexplant.numerics.lanes import INDEX, VECTOR, WIDTH, element, lanes, shuffled

ONES = ir.Constant(VECTOR, [1.0] * WIDTH)


@intrinsic
def filled(_, number):
    """A number in all eight lanes."""

    def code(context, builder, signature, arguments):
        empty = ir.Constant(VECTOR, ir.Undefined)
        return shuffled(builder, builder.insert_element(empty, arguments[0], ir.Constant(INDEX, 0)), empty, [0] * WIDTH)

    return lanes(types.float64), code


@intrinsic
def minus(_, a, b):
    """a - b."""
    return lanes(lanes, lanes), lambda context, builder, signature, arguments: builder.fsub(*arguments)


@intrinsic
def inverse(_, a):
    """1 / a."""
    return lanes(lanes), lambda context, builder, signature, arguments: builder.fdiv(ONES, arguments[0])


@intrinsic
def inverses(_, a, b, c):
    """1 / a, 1 / b and 1 / c of positive numbers from one division, for it takes as long as thirty products; 1 for 1 / 0."""

    def code(context, builder, signature, arguments):
        empty = ir.Constant(VECTOR, [0.0] * WIDTH)
        x, y, z = (builder.select(builder.fcmp_ordered(">", value, empty), value, ONES) for value in arguments)
        both = builder.fmul(x, y)
        whole = builder.fdiv(ONES, builder.fmul(both, z))
        first = builder.fmul(whole, z)
        found = [builder.fmul(first, y), builder.fmul(first, x), builder.fmul(whole, both)]
        return context.make_tuple(builder, signature.return_type, found)

    return types.UniTuple(lanes, 3)(lanes, lanes, lanes), code


@intrinsic
def parts(_, array, place):
    """Real and imaginary parts of eight complex numbers, kept as sixteen reals of a contiguous array from `place` on."""

    def code(context, builder, signature, arguments):
        at = element(context, builder, signature, arguments)
        pieces = [builder.gep(at, [ir.Constant(ir.IntType(64), k * WIDTH)]) for k in range(2)]
        pieces = [builder.load(builder.bitcast(piece, VECTOR.as_pointer()), align=8) for piece in pieces]
        found = [shuffled(builder, *pieces, range(first, 2 * WIDTH, 2)) for first in range(2)]
        return context.make_tuple(builder, signature.return_type, found)

    return types.UniTuple(lanes, 2)(array, types.intp), code


@intrinsic
def store_parts(_, array, place, real, imaginary):
    """Write eight complex numbers as sixteen reals into a contiguous array from `place` on."""

    def code(context, builder, signature, arguments):
        at = element(context, builder, signature, arguments)
        for k in range(2):
            pairs = [q + k * WIDTH // 2 + shift for q in range(WIDTH // 2) for shift in (0, WIDTH)]
            pointer = builder.gep(at, [ir.Constant(ir.IntType(64), k * WIDTH)])
            joined = shuffled(builder, arguments[2], arguments[3], pairs)
            builder.store(joined, builder.bitcast(pointer, VECTOR.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.none(array, types.intp, lanes, lanes), code
