"""Eight rows of a factor against columns of right sides, in vector registers: the inner steps of `factorization.panel_lanes`.

A strip is eight rows side by side in memory: entry (i, j) at 8 j + i. Tiles are its rows of 8 m columns, as tuples of `Lanes`.
Imported only where numba is installed; see `numerics.lanes`.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from flexplant.numerics.lanes import INDEX, VECTOR, WIDTH, element, lanes, shuffled

PLACE = ir.IntType(64)
BYTES = ir.IntType(8).as_pointer()
PAIRS = ([0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15])  # lanes of two vectors that are added, and those they meet
QUADS = ([0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15])
HALVES = ([0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15])


def moved(builder, pointer, steps):
    """Code that points some doubles on."""
    return builder.gep(pointer, [ir.Constant(PLACE, steps)])


def loaded(builder, pointer):
    """Code that loads eight values."""
    return builder.load(builder.bitcast(pointer, VECTOR.as_pointer()), align=8)


def written(builder, value, pointer):
    """Code that writes eight values."""
    builder.store(value, builder.bitcast(pointer, VECTOR.as_pointer()), align=8)


def repeated(builder, pointer):
    """Code that loads one value into all lanes."""
    empty = ir.Constant(VECTOR, ir.Undefined)
    one = builder.insert_element(empty, builder.load(pointer), ir.Constant(INDEX, 0))
    return shuffled(builder, one, empty, [0] * WIDTH)


def fused(builder, a, b, c):
    """Code of a b + c."""
    kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.fmuladd.v{WIDTH}f64"), [a, b, c])


def pointed(context, builder, array, value, place):
    """Code that points to a place of a contiguous array."""
    return element(context, builder, types.none(array, types.intp), [value, place])


def row_pointers(context, builder, signature, arguments):
    """Code that points to the eight rows listed in an array from place k on: x, rows, k, wide, shift."""
    x, rows = (pointed(context, builder, signature.args[i], arguments[i], ir.Constant(PLACE, 0)) for i in range(2))
    listed = builder.gep(rows, [arguments[2]])
    for i in range(WIDTH):
        row = builder.load(moved(builder, listed, i))
        yield builder.gep(x, [builder.add(builder.mul(row, arguments[3]), arguments[4])])


@intrinsic(prefer_literal=True)
def blank(_, m):
    """A tile of zeros, 8 m columns wide."""
    m = m.literal_value
    zeros = [ir.Constant(VECTOR, [0.0] * WIDTH)] * (WIDTH * m)
    tile = types.UniTuple(lanes, WIDTH * m)
    return tile(types.literal(m)), lambda context, builder, signature, _: context.make_tuple(builder, tile, zeros)


@intrinsic(prefer_literal=True)
def taken(_, x, at, wide, m):
    """Eight rows from place `at` on, `wide` values apart, 8 m columns."""
    m = m.literal_value

    def code(context, builder, signature, arguments):
        pointer, tile = pointed(context, builder, x, *arguments[:2]), []
        for _ in range(WIDTH):
            tile += [loaded(builder, moved(builder, pointer, WIDTH * v)) for v in range(m)]
            pointer = builder.gep(pointer, [arguments[2]])
        return context.make_tuple(builder, signature.return_type, tile)

    return types.UniTuple(lanes, WIDTH * m)(x, types.intp, types.intp, types.literal(m)), code


@intrinsic
def put(_, x, at, wide, tile):
    """Write what `taken` takes."""
    m = tile.count // WIDTH

    def code(context, builder, signature, arguments):
        pointer, values = pointed(context, builder, x, *arguments[:2]), cgutils.unpack_tuple(builder, arguments[3])
        for i in range(WIDTH):
            for v in range(m):
                written(builder, values[i * m + v], moved(builder, pointer, WIDTH * v))
            pointer = builder.gep(pointer, [arguments[2]])
        return context.get_dummy_value()

    return types.none(x, types.intp, types.intp, tile), code


@intrinsic(prefer_literal=True)
def gathered(_, x, rows, k, wide, shift, m):
    """The eight rows of x that `rows` lists from k on; 8 m columns from `shift` on."""
    m = m.literal_value

    def code(context, builder, signature, arguments):
        tile = []
        for pointer in row_pointers(context, builder, signature, arguments):
            tile += [loaded(builder, moved(builder, pointer, WIDTH * v)) for v in range(m)]
        return context.make_tuple(builder, signature.return_type, tile)

    return types.UniTuple(lanes, WIDTH * m)(x, rows, *[types.intp] * 3, types.literal(m)), code


@intrinsic
def scattered(_, x, rows, k, wide, shift, tile):
    """Add a tile to the rows that `gathered` takes."""
    m = tile.count // WIDTH

    def code(context, builder, signature, arguments):
        values = cgutils.unpack_tuple(builder, arguments[5])
        for i, row in enumerate(row_pointers(context, builder, signature, arguments)):
            for v in range(m):
                pointer = moved(builder, row, WIDTH * v)
                written(builder, builder.fadd(loaded(builder, pointer), values[i * m + v]), pointer)
        return context.get_dummy_value()

    return types.none(x, rows, types.intp, types.intp, types.intp, tile), code


@intrinsic
def outer(_, values, p, step, x, at, tile):
    """The tile plus eight values, `step` apart, times a row of x."""
    m = tile.count // WIDTH

    def code(context, builder, signature, arguments):
        strip, row = (pointed(context, builder, signature.args[k], *arguments[k : k + 2]) for k in (0, 3))
        sums, out = cgutils.unpack_tuple(builder, arguments[5]), []
        x_row = [loaded(builder, moved(builder, row, WIDTH * v)) for v in range(m)]
        for i in range(WIDTH):
            one = repeated(builder, builder.gep(strip, [builder.mul(arguments[2], ir.Constant(PLACE, i))]))
            out += [fused(builder, one, x_row[v], sums[i * m + v]) for v in range(m)]
        return context.make_tuple(builder, signature.return_type, out)

    return tile(values, types.intp, types.intp, x, types.intp, tile), code


@intrinsic
def inner(_, values, p, step, x, at, tile):
    """Add eight values, `step` apart, times the rows of a tile to a row of x."""
    m = tile.count // WIDTH

    def code(context, builder, signature, arguments):
        strip, row = (pointed(context, builder, signature.args[k], *arguments[k : k + 2]) for k in (0, 3))
        held, places = cgutils.unpack_tuple(builder, arguments[5]), [moved(builder, row, WIDTH * v) for v in range(m)]
        sums = [loaded(builder, place) for place in places]
        for i in range(WIDTH):
            one = repeated(builder, builder.gep(strip, [builder.mul(arguments[2], ir.Constant(PLACE, i))]))
            sums = [fused(builder, one, held[i * m + v], sums[v]) for v in range(m)]
        for place, value in zip(places, sums, strict=True):
            written(builder, value, place)
        return context.get_dummy_value()

    return types.none(values, types.intp, types.intp, x, types.intp, tile), code


def _corner(backwards):
    """Code that solves with the eight rows' own triangle, -L and 1 / L on the diagonal, from the last row on if backwards."""

    def code(context, builder, signature, arguments):
        strip, m = pointed(context, builder, signature.args[0], *arguments[:2]), signature.args[2].count // WIDTH
        x = list(cgutils.unpack_tuple(builder, arguments[2]))
        for k in reversed(range(WIDTH)) if backwards else range(WIDTH):
            own = repeated(builder, moved(builder, strip, (WIDTH + 1) * k))
            x[k * m : k * m + m] = [builder.fmul(own, value) for value in x[k * m : k * m + m]]
            for i in range(k) if backwards else range(k + 1, WIDTH):
                one = repeated(builder, moved(builder, strip, WIDTH * i + k if backwards else WIDTH * k + i))
                x[i * m : i * m + m] = [fused(builder, one, x[k * m + v], x[i * m + v]) for v in range(m)]
        return context.make_tuple(builder, signature.return_type, x)

    return code


@intrinsic
def corner_down(_, values, p, tile):
    """L^-1 times a tile, of the strip's triangle at p."""
    return tile(values, types.intp, tile), _corner(False)


@intrinsic
def corner_up(_, values, p, tile):
    """L^-T times a tile, of the strip's triangle at p."""
    return tile(values, types.intp, tile), _corner(True)


@intrinsic
def totals(_, values, p, held):
    """The eight sums over a strip's rows, weighted by `held`, of eight columns from p on."""

    def code(context, builder, signature, arguments):
        strip = pointed(context, builder, values, *arguments[:2])
        sums = [builder.fmul(loaded(builder, moved(builder, strip, WIDTH * j)), arguments[2]) for j in range(WIDTH)]
        for one, other in (PAIRS, QUADS, HALVES):
            pairs = zip(sums[::2], sums[1::2], strict=True)
            sums = [builder.fadd(shuffled(builder, a, b, one), shuffled(builder, a, b, other)) for a, b in pairs]
        return sums[0]

    return lanes(values, types.intp, lanes), code


@intrinsic
def ahead(_, values, p):
    """Ask for the line of memory at p, which need not exist."""

    def code(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.VoidType(), [BYTES, INDEX, INDEX, INDEX])
        ask = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        pointer = builder.bitcast(pointed(context, builder, values, *arguments), BYTES)
        builder.call(ask, [pointer, *(ir.Constant(INDEX, k) for k in (0, 3, 1))])  # to read, to keep, as data
        return context.get_dummy_value()

    return types.none(values, types.intp), code
