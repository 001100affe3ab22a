"""Sums of several rows over four samples, kept in vector registers as a tuple of `Lanes`: four sums a row, its samples in turn.

A tuple's length is part of its type, so that each number of rows is compiled to straight code. See `numerics.lanes`.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from flexplant.numerics.lanes import VECTOR, WIDTH, element, lanes, shuffled

SAMPLES = 4
PLACE = ir.IntType(64)
# Three times, two vectors are added into one: neighbours, then pairs, then halves.
FOLDS = (
    ([0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]),
    ([0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]),
    ([0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]),
)


@intrinsic
def no_sums(_, rows):
    """Zeros for as many rows as the tuple `rows` is long."""
    size = SAMPLES * len(rows)

    def code(context, builder, signature, _):
        return context.make_tuple(builder, signature.return_type, [ir.Constant(VECTOR, [0.0] * WIDTH)] * size)

    return types.UniTuple(lanes, size)(rows), code


@intrinsic
def weighted(_, sums, weights, place, a, b, c, d):
    """The sums plus each row's eight weights, one row after the other from `place` on, times the values at four samples."""

    def code(context, builder, signature, arguments):
        first = element(context, builder, types.none(*signature.args[1:3]), arguments[1:3])
        kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
        fused = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fmuladd.v{WIDTH}f64")
        out = []
        for k in range(sums.count):
            if k % SAMPLES == 0:
                at = builder.gep(first, [ir.Constant(PLACE, k // SAMPLES * WIDTH)])
                weight = builder.load(builder.bitcast(at, VECTOR.as_pointer()), align=8)
            out.append(builder.call(fused, [weight, arguments[3 + k % SAMPLES], builder.extract_value(arguments[0], k)]))
        return context.make_tuple(builder, signature.return_type, out)

    return sums(sums, weights, types.intp, *[lanes] * SAMPLES), code


@intrinsic
def store_totals(_, sums, out, place, width):
    """out[place + r width + t] = the sum of the lanes of row r's sum at sample t, an even number of rows."""

    def code(context, builder, signature, arguments):
        def folded(values, low, high):
            pairs = zip(values[::2], values[1::2], strict=True)
            return [builder.fadd(shuffled(builder, a, b, low), shuffled(builder, a, b, high)) for a, b in pairs]

        for k in range(0, sums.count, WIDTH):
            values = [builder.extract_value(arguments[0], j) for j in range(k, k + WIDTH)]
            for fold in FOLDS:
                values = folded(values, *fold)
            for half in range(2):
                four = shuffled(builder, values[0], values[0], range(SAMPLES * half, SAMPLES * half + SAMPLES))
                skip = builder.mul(arguments[3], ir.Constant(PLACE, k // SAMPLES + half))
                where = [arguments[1], builder.add(arguments[2], skip)]
                pointer = element(context, builder, types.none(signature.args[1], types.intp), where)
                builder.store(four, builder.bitcast(pointer, four.type.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.none(sums, out, types.intp, types.intp), code
