"""The inner loops of `ModalSum`, compiled where numba is installed.

The result is made in tiles of ROWS rows and STRIP frequencies. A tile's sums stay in vector registers over all modes and are
written once, as complex numbers: a BLAS runs products as thin as these at half speed, and leaves two real arrays to be joined.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from flexplant.model.arrays import FloatArray
from flexplant.numerics.compiled import Kernel

ROWS, STRIP = 4, 24  # STRIP is also the number of Chebyshev nodes, so that the nodes of a block are one strip
SIZE = ROWS * STRIP * 2  # reals in a tile
CACHED = 2**15  # sums of a block that are made at once, without numba


def tile(left, at, near, table, first, smooth, place, terms, basis, begin, direct, out, rows, row, step, shift) -> None:  # type: ignore[no-untyped-def]
    """out[r, s] = direct[r] + sum_j left[j, r] table[j, s] + sum_k smooth[r, k] basis[k, s], complex numbers as pairs of reals.

    Flat arrays, each from its offset on: left (near, ROWS), table (near, 2, STRIP), smooth (ROWS, STRIP, 2) of which `terms`
    columns are used, basis (terms, STRIP), direct and rows (ROWS,) from `row` on; row r begins at out[rows[r] * step + shift].
    This is what it means; `teach` gives the compiler a form that keeps the sums in registers.
    """
    weights = left[at : at + near * ROWS].reshape(near, ROWS)
    values = table[first : first + near * 2 * STRIP].reshape(near, 2, STRIP)
    coefficients = smooth[place : place + SIZE].reshape(ROWS, STRIP, 2)[:, :terms]
    powers = basis[begin : begin + terms * STRIP].reshape(terms, STRIP)
    sums = np.einsum("jr,jps->rsp", weights, values) + np.einsum("rkp,ks->rsp", coefficients, powers)
    sums[:, :, 0] += direct[row : row + ROWS, None]
    for r in range(ROWS):
        begin = rows[row + r] * step + shift
        out[begin : begin + 2 * STRIP] = sums[r].ravel()


def receptances(modal, damping, first, last, center, offset, start, table, place) -> None:  # type: ignore[no-untyped-def]
    """table (last - first, 2, STRIP), flat from `place` on: 1 / (wn^2 - w^2 + i damping w) at STRIP w = center + offset.

    Nodes in a narrow block keep their offsets' digits, which their sum with the center would round away. 0 for wn = w = 0.
    """
    for i in range(first, last):
        below, above, begin = modal[i] - center, modal[i] + center, place + (i - first) * 2 * STRIP
        for s in range(STRIP):
            x = offset[start + s]
            real = (below - x) * (above + x)  # keeps its digits near wn
            imaginary = damping[i] * (center + x)
            size = real * real + imaginary * imaginary
            scale = 1 / size if size > 0 else 0.0
            table[begin + s] = real * scale
            table[begin + STRIP + s] = -imaginary * scale


def polynomials(omega, start, center, half, basis, place) -> None:  # type: ignore[no-untyped-def]
    """basis (STRIP, STRIP), flat from `place` on: Chebyshev polynomials T_k((w - center) / half), three-term recurrence."""
    for s in range(STRIP):
        basis[place + s] = 1.0
        basis[place + STRIP + s] = (omega[start + s] - center) / half
    for k in range(place + 2 * STRIP, place + STRIP * STRIP, STRIP):
        for s in range(STRIP):
            basis[k + s] = 2 * basis[place + STRIP + s] * basis[k - STRIP + s] - basis[k - 2 * STRIP + s]


def differentiate(omega, start, order, direct, out, begin) -> None:  # type: ignore[no-untyped-def]
    """A strip of complex numbers from out[begin] on times (i w)^order, order 1 or 2, plus a real number."""
    for s in range(STRIP):
        w, real, imaginary = omega[start + s], out[begin + 2 * s], out[begin + 2 * s + 1]
        out[begin + 2 * s] = direct - (w * imaginary if order == 1 else w * w * real)
        out[begin + 2 * s + 1] = w * real if order == 1 else -w * w * imaginary


def sum_blocks(left, modal, damping, omega, blocks, nodes, transform, order, direct, rows, tables, bases, out):  # type: ignore[no-untyped-def]
    """Each block of frequencies: near modes one by one, the others by the Chebyshev series of their sum.

    blocks (nb, 6): start and stop of the frequencies, first and last near mode, first and last of its rows. left (tiles, n,
    ROWS), direct and rows (tiles, ROWS), nodes (STRIP,) on [-1, 1], transform (STRIP, STRIP) from values at the nodes to
    coefficients: flat. out: flat, rows as long as omega, written strip by strip, the last of a block moved back to fit.
    tables: scratch for all modes at the nodes and the near ones at the frequencies of a block; bases: for its polynomials.
    """
    n, wide, square, step = modal.size, 2 * STRIP, STRIP * STRIP, 2 * omega.size
    work, own, nothing = np.empty(2 * SIZE + STRIP), np.arange(ROWS), np.zeros(direct.size)
    straight = direct if order == 0 else nothing
    for b in range(blocks.shape[0]):
        start, stop, low, high = blocks[b, 0], blocks[b, 1], blocks[b, 2], blocks[b, 3]
        near, strips = high - low, (stop - start + STRIP - 1) // STRIP
        terms = STRIP if near < n else 0
        center, half = 0.5 * (omega[start] + omega[stop - 1]), 0.5 * (omega[stop - 1] - omega[start])
        if terms:
            for s in range(STRIP):
                work[2 * SIZE + s] = half * nodes[s]
            receptances(modal, damping, 0, n, center, work, 2 * SIZE, tables, 0)
            for k in range(low * wide, high * wide):
                tables[k] = 0.0
        for k in range(strips):
            at = min(start + k * STRIP, stop - STRIP)
            receptances(modal, damping, low, high, 0.0, omega, at, tables, (n + k * near) * wide)
            if terms:
                polynomials(omega, at, center, half, bases, k * square)
        for t in range(blocks[b, 4], blocks[b, 5], ROWS):
            if terms:
                tile(left, t * n, n, tables, 0, work, 0, 0, transform, 0, nothing, work, own, 0, wide, 0)
                tile(left, 0, 0, tables, 0, work, 0, STRIP, transform, 0, nothing, work, own, 0, wide, SIZE)
            for k in range(strips):
                at, first = min(start + k * STRIP, stop - STRIP), (n + k * near) * wide
                mine = t * n + low * ROWS
                tile(left, mine, near, tables, first, work, SIZE, terms, bases, k * square, straight, out, rows, t, step, 2 * at)
                for r in range(t, t + ROWS if order else t):
                    if r == t or rows[r] != rows[r - 1]:
                        differentiate(omega, at, order, direct[r], out, rows[r] * step + 2 * at)


def sum_blocks_numpy(left, modal, damping, omega, blocks, nodes, transform, order, direct, rows, tables, bases, out):  # type: ignore[no-untyped-def]  # noqa: ARG001  one signature
    """The same by matrix products, without numba."""
    n, transform = modal.size, transform.reshape(STRIP, STRIP)
    columns = left.reshape(-1, n, ROWS).transpose(0, 2, 1).reshape(-1, n)
    values = out.view(np.complex128).reshape(-1, omega.size)
    for start, stop, low, high, above, below in blocks:
        w, near, these = omega[start:stop], slice(low, high), columns[above:below]
        tables = list(_receptances_numpy(modal[near], damping[near], 0.0, w))
        lefts = [these[:, near]] * 2
        if high - low < n:
            center, half = 0.5 * (w[0] + w[-1]), 0.5 * (w[-1] - w[0])
            at_nodes = _receptances_numpy(modal, damping, center, half * nodes)
            at_nodes[:, near] = 0.0
            basis = np.polynomial.chebyshev.chebvander((w - center) / half, STRIP - 1).T
            tables = [np.vstack([table, basis]) for table in tables]
            lefts = [np.hstack([one, these @ table @ transform]) for one, table in zip(lefts, at_nodes, strict=True)]
        step = max(CACHED // w.size, 1)
        for first in range(0, below - above, step):
            part = slice(first, first + step)
            sums = _turned(lefts[0][part] @ tables[0], lefts[1][part] @ tables[1], w, order)
            _write(values, rows[above:below][part], slice(start, stop), sums, direct[above:below][part, None])


def _turned(real: FloatArray, imaginary: FloatArray, w: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Real and imaginary parts times (i w)^order."""
    if order == 1:
        return -w * imaginary, w * real
    return (real, imaginary) if order == 0 else (-w * w * real, -w * w * imaginary)


def _write(values: Any, rows: Any, at: slice, sums: tuple[FloatArray, FloatArray], direct: FloatArray) -> None:
    """The sums into `rows` of the result; without copies where these follow each other, but for those that fill the last tile."""
    count = int(rows[-1] - rows[0]) + 1
    if count <= rows.size and (rows == np.minimum(rows[0] + np.arange(rows.size), rows[-1])).all():
        target = values[rows[0] : rows[-1] + 1, at]
        target.real, target.imag = sums[0][:count] + direct[:count] if direct.any() else sums[0][:count], sums[1][:count]
    else:
        values[rows, at] = sums[0] + direct + 1j * sums[1]


def _receptances_numpy(modal: FloatArray, damping: FloatArray, center: float, offset: FloatArray) -> FloatArray:
    """(2, n, nf) real and imaginary parts, as `receptances`."""
    table = np.empty((2, modal.size, offset.size))
    np.subtract((modal - center)[:, None], offset, out=table[0])
    size = (modal + center)[:, None] + offset
    table[0] *= size
    np.multiply(-damping[:, None], center + offset, out=table[1])
    np.multiply(table[0], table[0], out=size)
    size += table[1] * table[1]
    table *= np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    return table


def teach(numba: Any) -> None:
    """Tell numba how to compile what `sum_blocks` calls."""
    extending = importlib.import_module("numba.extending")
    importlib.import_module("flexplant.response.tile_lanes")  # receptances and polynomials, which are `overloaded` there
    extending.register_jitable(differentiate)

    def typed(context: Any) -> Any:  # noqa: ARG001  numba asks for it
        def tile(left, at, near, table, first, smooth, place, terms, basis, begin, direct, out, rows, row, step, shift):  # type: ignore[no-untyped-def]  # noqa: ARG001
            return numba.types.void

        return tile

    extending.type_callable(tile)(typed)
    extending.lower_builtin(tile, numba.types.VarArg(numba.types.Any))(_call_tile)


summed = Kernel(sum_blocks, sum_blocks_numpy, teach)


def _call_tile(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Code that calls the module's one compiled `tile`."""
    integer = importlib.import_module("numba").types.intp
    given = [
        context.make_array(kind)(context, builder, value).data
        if hasattr(kind, "dtype")
        else context.cast(builder, value, kind, integer)
        for kind, value in zip(signature.args, arguments, strict=True)
    ]
    left, at, near, table, first, smooth, place, terms, basis, begin, direct, out, rows, row, step, shift = given
    function = builder.module.globals.get("flexplant_tile") or TileWriter(builder.module, vector_shape()).function

    def of(array: Any, offset: Any) -> Any:
        return builder.gep(array, [offset])

    near_terms, far_terms = (of(left, at), near, of(table, first)), (of(smooth, place), terms, of(basis, begin))
    builder.call(function, [*near_terms, *far_terms, of(direct, row), of(out, shift), of(rows, row), step])
    return context.get_dummy_value()


def vector_shape() -> tuple[int, int]:
    """(lanes of a vector, vectors a row) so that the sums of a tile fit this processor's registers."""
    features = importlib.import_module("llvmlite.binding").get_host_cpu_features()
    if features.get("avx512f"):
        return 8, 3
    return (4, 1) if features.get("avx") else (2, 2)


class TileWriter:
    """`tile` in LLVM's language, as a function of the module: ROWS x `vectors` x 2 vectors of `lanes` sums at a time."""

    def __init__(self, module: Any, shape: tuple[int, int]) -> None:
        self.ir = importlib.import_module("llvmlite.ir")
        self.lanes, self.vectors = shape
        self.integer, self.real = self.ir.IntType(64), self.ir.DoubleType()
        self.vector = self.ir.VectorType(self.real, self.lanes)
        reals, integers = self.real.as_pointer(), self.integer.as_pointer()
        arguments = [reals, self.integer, reals, reals, self.integer, reals, reals, reals, integers, self.integer]
        self.function = self.ir.Function(module, self.ir.FunctionType(self.ir.VoidType(), arguments), "flexplant_tile")
        self.function.linkage = "internal"
        self.function.attributes.add("noinline")
        self.builder = self.ir.IRBuilder(self.function.append_basic_block())
        for column in range(0, STRIP, self.lanes * self.vectors):
            self._columns(column)
        self.builder.ret_void()

    def _columns(self, column: int) -> None:
        """The sums of `lanes` times `vectors` columns: start, near modes, far series, store."""
        left, near, table, smooth, terms, basis, direct, out, rows, step = self.function.args
        zero = self.ir.Constant(self.vector, [0.0] * self.lanes)
        count = self.vectors
        sums: list[Any] = []
        for r in range(ROWS):
            sums += [self._spread(direct, self._number(r))] * count + [zero] * count

        def near_mode(j: Any, sums: list[Any]) -> list[Any]:
            values = [v for part in (0, STRIP) for v in self._vectors(table, j, 2 * STRIP, part + column)]
            weights = [self._spread(left, self._index(j, ROWS, r)) for r in range(ROWS)]
            return [self._add_product(weights[k // (2 * count)], values[k % (2 * count)], s) for k, s in enumerate(sums)]

        def far_term(j: Any, sums: list[Any]) -> list[Any]:
            values = self._vectors(basis, j, STRIP, column)
            weights = [self._spread(smooth, self._index(j, 2, r * 2 * STRIP + part)) for r in range(ROWS) for part in range(2)]
            return [self._add_product(weights[k // count], values[k % count], s) for k, s in enumerate(sums)]

        sums = self._loop(terms, self._loop(near, sums, near_mode), far_term)
        for r in range(ROWS):
            offset = self.builder.mul(self.builder.load(self.builder.gep(rows, [self._number(r)])), step)
            self._store(sums[2 * count * r : 2 * count * (r + 1)], self.builder.gep(out, [offset]), column)

    def _store(self, sums: list[Any], out: Any, column: int) -> None:
        """Real and imaginary parts joined and written."""
        half = self.lanes // 2
        for k, (real, imaginary) in enumerate(zip(sums[: self.vectors], sums[self.vectors :], strict=True)):
            for part in range(2):
                order = [q + part * half + shift for q in range(half) for shift in (0, self.lanes)]
                place = self._number(2 * (column + k * self.lanes) + part * self.lanes)
                pointer = self.builder.bitcast(self.builder.gep(out, [place]), self.vector.as_pointer())
                self.builder.store(self._shuffle(real, imaginary, order), pointer).align = 8

    def _loop(self, count: Any, sums: list[Any], body: Any) -> list[Any]:
        """for j in range(count): sums = body(j, sums)."""
        b, before = self.builder, self.builder.block
        head, inside, after = (b.append_basic_block() for _ in range(3))
        b.branch(head)
        b.position_at_end(head)
        j, carried = b.phi(self.integer), [b.phi(self.vector) for _ in sums]
        b.cbranch(b.icmp_signed("<", j, count), inside, after)
        b.position_at_end(inside)
        following = [b.add(j, self._number(1)), *body(j, carried)]
        b.branch(head)
        for phi, first, later in zip([j, *carried], [self._number(0), *sums], following, strict=True):
            phi.add_incoming(first, before)
            phi.add_incoming(later, inside)
        b.position_at_end(after)
        return carried

    def _number(self, value: int) -> Any:
        return self.ir.Constant(self.integer, value)

    def _index(self, j: Any, stride: int, offset: int) -> Any:
        return self.builder.add(self.builder.mul(j, self._number(stride)), self._number(offset))

    def _vectors(self, array: Any, j: Any, stride: int, offset: int) -> list[Any]:
        found = []
        for k in range(self.vectors):
            pointer = self.builder.gep(array, [self._index(j, stride, offset + k * self.lanes)])
            found.append(self.builder.load(self.builder.bitcast(pointer, self.vector.as_pointer())))
            found[-1].align = 8
        return found

    def _spread(self, array: Any, index: Any) -> Any:
        """One number in all lanes."""
        none, first = self.ir.Constant(self.vector, self.ir.Undefined), self.ir.Constant(self.ir.IntType(32), 0)
        one = self.builder.insert_element(none, self.builder.load(self.builder.gep(array, [index])), first)
        return self._shuffle(one, none, [0] * self.lanes)

    def _shuffle(self, a: Any, b: Any, order: list[int]) -> Any:
        kind = self.ir.VectorType(self.ir.IntType(32), len(order))
        return self.builder.shuffle_vector(a, b, self.ir.Constant(kind, order))

    def _add_product(self, a: Any, b: Any, c: Any) -> Any:
        fused = ("contract",)
        return self.builder.fadd(self.builder.fmul(a, b, flags=fused), c, flags=fused)
