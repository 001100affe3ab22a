"""Block-banded Cholesky by dense LAPACK: for small matrices, where a sparse solver's bookkeeping costs more than its flops."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.linalg.lapack as lapack
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from flexplant.errors import InputError, SolverError
from flexplant.model.arrays import FloatArray, IntArray, dense
from flexplant.numerics.factorization.banded_layout import LEAST, Layout
from flexplant.numerics.factorization.protocol import Estimate

NARROW = 2.6  # times the rows of the least blocks, that a row meets on average: such an order is not worth improving
COPIED = 300_000  # entries of a factor, beyond which its rows are kept by columns too
GROWTH = 1e4  # times the largest entry: a pivot block that grows beyond has lost the digits that signs are read from
TINY = 1e-15  # of the largest entry: a pivot block's own pivot below it is round-off


@dataclass(frozen=True, eq=False)
class BandedFactor:
    """See `Factor`: P A P^T = L L^T, L block-bidiagonal, `order` P's rows, None where they stay as they are.

    rows: [-D_i S_i, D_i] of the inverses D of the diagonal blocks and the blocks S beside them, so that a row block of a half
    solution takes one product.
    """

    order: IntArray | None
    ends: tuple[int, ...]
    rows: tuple[FloatArray, ...]
    backend: str = "banded"
    negative_pivots: int = 0

    @property
    def fill(self) -> int:
        """Entries of L, with the zeros its blocks hold."""
        return sum(block.size for block in self.rows)

    @cached_property
    def columns(self) -> tuple[FloatArray, ...]:
        """The transposed rows: copies where they are so large that a product with a view of them takes twice as long."""
        return tuple(np.ascontiguousarray(row.T) if self.fill > COPIED else row.T for row in self.rows)

    def forward(self, right_side: FloatArray) -> FloatArray:
        """L^-1 P b, (n, k)."""
        x = np.array(right_side, order="C") if self.order is None else right_side[self.order]
        before = 0
        for block, start, end in zip(self.rows, self.ends, self.ends[1:], strict=False):
            x[start:end] = block @ x[before:end]
            before = start
        return x

    def backward(self, right_side: FloatArray) -> FloatArray:
        """P^T L^-T y, (n, k): from the last row block of L^-T on, each gives its own solution and its part in the one before."""
        x, ends = np.array(right_side, order="C"), self.ends
        for i in range(len(self.rows) - 1, 0, -1):
            before, start, end = ends[i - 1], ends[i], ends[i + 1]
            found = self.columns[i] @ x[start:end]
            x[before:start] += found[: start - before]
            x[start:end] = found[start - before :]
        x[: ends[1]] = self.columns[0] @ x[: ends[1]]
        if self.order is None:
            return x
        out = np.empty_like(x)
        out[self.order] = x
        return out

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        b = np.asarray(right_side, dtype=float)
        return self.backward(self.forward(b.reshape(b.shape[0], -1))).reshape(b.shape)


@dataclass(frozen=True, eq=False)
class IndefiniteFactor:
    """See `Factor`: block L D L^T, beside: A's blocks below the diagonal. pivots: each block of D factored with pivoting, and its
    swaps; or, without swaps, the inverse of its Cholesky root."""

    order: IntArray
    ends: tuple[int, ...]
    pivots: tuple[tuple[FloatArray, IntArray | None], ...]
    beside: tuple[FloatArray, ...]
    backend: str = "banded"

    @cached_property
    def negative_pivots(self) -> int:
        """Inertia adds up over Schur complements (Haynsworth); a 2 x 2 pivot has one negative eigenvalue."""
        swapped = [(d, p) for d, p in self.pivots if p is not None]
        single = sum(int(np.count_nonzero((p > 0) & (np.diagonal(d) < 0))) for d, p in swapped)
        return single + sum(int(np.count_nonzero(p < 0)) // 2 for _, p in swapped)

    @property
    def fill(self) -> int:
        """Entries of L, with the zeros its blocks hold."""
        return sum(d.size for d, _ in self.pivots) + sum(b.size for b in self.beside)

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        b = np.asarray(right_side, dtype=float)
        x = b.reshape(b.shape[0], -1)[self.order]
        rows = [slice(*pair) for pair in pairwise(self.ends)]
        for i, block in enumerate(self.beside):
            x[rows[i + 1]] -= block @ _solved(self.pivots[i], x[rows[i]])
        for i in range(len(rows) - 1, -1, -1):
            if i < len(self.beside):
                x[rows[i]] -= self.beside[i].T @ x[rows[i + 1]]
            x[rows[i]] = _solved(self.pivots[i], x[rows[i]])
        out = np.empty_like(x)
        out[self.order] = x
        return out.reshape(b.shape)


def _solved(pivot: tuple[FloatArray, IntArray | None], right_side: FloatArray) -> FloatArray:
    factored, swaps = pivot
    if swaps is None:
        return np.asarray(factored.T @ (factored @ right_side))
    return np.asarray(lapack.dsytrs(factored, swaps, right_side, lower=1)[0]) if right_side.size else right_side


@dataclass(frozen=True, eq=False)
class BandedAnalysis:
    """See `Analysis`: an order of the rows and the ends of their blocks, each of which meets its neighbours only."""

    layout: Layout

    @cached_property
    def estimate(self) -> Estimate:
        """Cost of a factorisation, exact but for what an indefinite matrix takes more."""
        size = np.diff(self.layout.ends).astype(float)
        beside = size[1:] * size[:-1]
        fill = int(np.sum(size**2) + np.sum(beside))
        flops = float(np.sum(size**3) + 4.0 * np.sum(beside * (size[1:] + size[:-1])))
        return Estimate(fill, 16 * fill, 32 * fill, flops)

    def factorize(self, matrix: Any) -> BandedFactor | IndefiniteFactor:
        """Factor a matrix; one that does not fit the blocks is analysed anew. SolverError where it is singular."""
        csr, layout = _real(matrix), self.layout
        blocks = layout.blocks(csr) if csr.shape[0] == layout.order.size else None
        if blocks is None:
            return analyze(csr).factorize(csr)
        inverses, beside = _roots(blocks)
        if len(inverses) == len(blocks):
            return _positive(layout, inverses, beside)
        largest = float(abs(csr.data).max(initial=0.0))
        found = _indefinite(blocks, inverses, layout, largest)
        if found is None:  # as one block, pivots are chosen among all rows
            one = Layout(layout.order, (0, layout.order.size))
            whole = one.blocks(csr)
            found = None if whole is None else _indefinite(whole, [], one, largest)
        if found is None:
            raise SolverError(f"the matrix {matrix.shape} is singular (a pivot vanishes); shift it or remove mechanisms")
        return found


def _positive(layout: Layout, inverses: list[FloatArray], beside: list[FloatArray]) -> BandedFactor:
    rows = [inverses[0], *(np.hstack([(-d) @ s, d]) for d, s in zip(inverses[1:], beside, strict=True))]
    return BandedFactor(None if layout.is_natural else layout.order, layout.ends, tuple(rows))


def _roots(blocks: list[tuple[FloatArray, FloatArray]]) -> tuple[list[FloatArray], list[FloatArray]]:
    """D_i = L_ii^-1 and L_i+1,i of the leading blocks whose pivots are positive."""
    inverses: list[FloatArray] = []
    beside: list[FloatArray] = []
    for i, (left, own) in enumerate(blocks):
        if i:
            beside.append(left @ inverses[-1].T)
        root, failed = lapack.dpotrf(own - beside[-1] @ beside[-1].T if i else own, lower=1, clean=1)
        if failed:
            break
        inverses.append(_inverse(root))
    return inverses, beside


def _inverse(root: FloatArray) -> FloatArray:
    """L^-1 of a lower triangle: by halves, since LAPACK takes longer for a large one than for the products of its halves."""
    n, half = root.shape[0], root.shape[0] // 2
    if n <= 2 * LEAST:
        return np.ascontiguousarray(lapack.dtrtri(root, lower=1)[0])
    out = np.zeros((n, n))
    out[:half, :half], out[half:, half:] = _inverse(root[:half, :half]), _inverse(root[half:, half:])
    np.negative(out[half:, half:] @ (root[half:, :half] @ out[:half, :half]), out=out[half:, :half])
    return out


def _indefinite(
    blocks: list[tuple[FloatArray, FloatArray]],
    inverses: list[FloatArray],
    layout: Layout,
    largest: float,
) -> IndefiniteFactor | None:
    """Goes on where positive pivots end; None where a pivot block is singular, or so near to it that the next one loses its
    digits."""
    pivots: list[tuple[FloatArray, IntArray | None]] = [(d, None) for d in inverses]
    for left, own in blocks[len(inverses) :]:
        pivot = own - left @ _solved(pivots[-1], left.T) if pivots else own
        factored, swaps, failed = lapack.dsytrf(pivot, lower=1, lwork=LEAST * own.shape[0])
        if failed or not max(pivot.max(), -pivot.min()) <= GROWTH * largest or _vanishes(factored, swaps, TINY * largest):
            return None
        pivots.append((factored, swaps))
    return IndefiniteFactor(layout.order, layout.ends, tuple(pivots), tuple(left for left, _ in blocks[1:]))


def _vanishes(factored: FloatArray, swaps: IntArray, limit: float) -> bool:
    """Whether a 1 x 1 pivot is round-off (2 x 2 pivots are chosen for their size)."""
    return bool((abs(np.diagonal(factored)[swaps > 0]) <= limit).any())


def analyze(matrix: Any, *, threads: int | None = None) -> BandedAnalysis:  # noqa: ARG001  its threads are the BLAS library's
    """The order, as given or reverse Cuthill-McKee, that costs fewer flops. InputError for a complex matrix."""
    csr = _real(matrix)
    natural = BandedAnalysis(Layout.of(csr, np.arange(csr.shape[0])))
    if natural.layout.size <= NARROW * LEAST * csr.shape[0]:
        return natural
    turned = BandedAnalysis(Layout.of(csr, np.asarray(reverse_cuthill_mckee(csr, symmetric_mode=True), dtype=np.int64)))
    return min(natural, turned, key=lambda analysis: analysis.estimate.flops)


def _real(matrix: Any) -> Any:
    csr = matrix if isinstance(matrix, sp.csr_array) else sp.csr_array(matrix if sp.issparse(matrix) else dense(matrix))
    if np.iscomplexobj(csr.data):
        raise InputError("the banded backend factors real matrices; use rslab, pardiso or superlu for complex ones")
    return csr.astype(float, copy=False)
