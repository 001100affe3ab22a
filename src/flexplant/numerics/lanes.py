"""Eight doubles side by side as a type of compiled code: loops over modes whose arithmetic is the same on every machine.

The order of every sum is written down, so that a result depends neither on the vector length of the processor nor on threads
(multiply-adds are fused where the processor can). Imported only where numba is installed; see `compiled.numba`.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

WIDTH = 8
VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
INDEX = ir.IntType(32)


class Lanes(types.Type):
    """Eight doubles."""

    def __init__(self):
        super().__init__(name="Lanes")


lanes = Lanes()


@register_model(Lanes)
class LanesModel(models.PrimitiveModel):
    """Kept in a vector register."""

    def __init__(self, manager, kind):
        super().__init__(manager, kind, VECTOR)


def shuffled(builder, a, b, places):
    """Code that picks lanes of a, counted from 0, and of b, counted on from them."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(INDEX, len(places)), list(places)))


def element(context, builder, signature, arguments):
    """Code that points to an element of a contiguous array, or behind a pointer, by its place in memory."""
    kind, first = signature.args[0], arguments[0]
    data = first if isinstance(kind, types.CPointer) else context.make_array(kind)(context, builder, first).data
    return builder.gep(data, [arguments[1]])


@intrinsic
def start(_, array):
    """A pointer to the first element of a contiguous array.

    Handed on in place of the array it costs one register, not ten, and no count of references, whose atomic steps hold up the
    processor; the array has to outlive it.
    """

    def code(context, builder, signature, arguments):
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return (types.CPointer(array.dtype)(array), code) if array.is_c_contig else None


@intrinsic
def load(_, array, place):
    """The eight values of a contiguous array from `place` on."""

    def code(context, builder, signature, arguments):
        pointer = builder.bitcast(element(context, builder, signature, arguments), VECTOR.as_pointer())
        return builder.load(pointer, align=8)

    return lanes(array, types.intp), code


@intrinsic
def store(_, array, place, value):
    """Write eight values into a contiguous array from `place` on."""

    def code(context, builder, signature, arguments):
        pointer = builder.bitcast(element(context, builder, signature, arguments), VECTOR.as_pointer())
        builder.store(arguments[2], pointer, align=8)
        return context.get_dummy_value()

    return types.none(array, types.intp, lanes), code


@intrinsic
def spread(_, array, place):
    """One value of a contiguous array in all eight lanes."""

    def code(context, builder, signature, arguments):
        value = builder.load(element(context, builder, signature, arguments))
        empty = ir.Constant(VECTOR, ir.Undefined)
        return shuffled(builder, builder.insert_element(empty, value, ir.Constant(INDEX, 0)), empty, [0] * WIDTH)

    return lanes(array, types.intp), code


@intrinsic
def zero(_):
    """Eight zeros."""
    return lanes(), lambda *_: ir.Constant(VECTOR, [0.0] * WIDTH)


@intrinsic(prefer_literal=True)
def delayed(_, a, steps):
    """The lanes moved on by a number of places known when compiled, zeros before them."""
    places = range(WIDTH - steps.literal_value, 2 * WIDTH - steps.literal_value)
    none = ir.Constant(VECTOR, [0.0] * WIDTH)
    return lanes(lanes, steps), lambda context, builder, signature, arguments: shuffled(builder, none, arguments[0], places)


@intrinsic
def times(_, a, b):
    """a b."""
    return lanes(lanes, lanes), lambda context, builder, signature, arguments: builder.fmul(*arguments)


@intrinsic
def add(_, a, b, c):
    """a b + c."""

    def code(context, builder, signature, arguments):
        kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.fmuladd.v{WIDTH}f64"), arguments)

    return lanes(lanes, lanes, lanes), code


@intrinsic
def total(_, a):
    """Sum of the lanes: halves added to halves."""

    def code(context, builder, signature, arguments):
        value, width = arguments[0], WIDTH
        while width > 1:
            half = width // 2
            low, high = (shuffled(builder, value, value, range(first, first + half)) for first in (0, half))
            value, width = builder.fadd(low, high), half
        return builder.extract_element(value, ir.Constant(INDEX, 0))

    return types.float64(lanes), code


@intrinsic
def call_at(_, address, t, u, u0, s, s0, y, y0):
    """Call the C function int(double t, double *u, double *s, double *y) at an address, on places of contiguous arrays."""

    def code(context, builder, signature, arguments):
        places = [element(context, builder, types.none(*signature.args[k : k + 2]), arguments[k : k + 2]) for k in (2, 4, 6)]
        kind = ir.FunctionType(ir.IntType(64), [ir.DoubleType(), *(place.type for place in places)])
        return builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), [arguments[1], *places])

    return types.int64(types.int64, types.float64, u, types.intp, s, types.intp, y, types.intp), code
