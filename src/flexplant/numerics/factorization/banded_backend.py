"""Block-banded Cholesky by dense LAPACK: for small matrices, where a sparse solver's bookkeeping costs more than its flops."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg.lapack as lapack
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from flexplant.errors import InputError, SolverError
from flexplant.model.arrays import FloatArray, IntArray, dense
from flexplant.numerics.factorization.protocol import Estimate

LEAST = 64  # rows a block: below that a product costs as much as its call
GROWTH = 1e4  # times the largest entry: a pivot block that grows beyond has lost the digits that signs are read from
TINY = 1e-15  # of the largest entry: a pivot block's own pivot below it is round-off


@dataclass(frozen=True, eq=False)
class BandedFactor:
    """See `Factor`: P A P^T = L L^T, L block-bidiagonal, `order` P's rows, None where they stay as they are.

    lower: [-D_i S_i, D_i], and upper: [D_i^T, -(S_(i+1) D_i)^T], of the inverses D of the diagonal blocks and the blocks S
    beside them, so that a row block of a solution takes one product.
    """

    order: IntArray | None
    ends: tuple[int, ...]
    lower: tuple[FloatArray, ...]
    upper: tuple[FloatArray, ...]
    backend: str = "banded"
    negative_pivots: int = 0

    @property
    def fill(self) -> int:
        """Entries of L, with the zeros its blocks hold."""
        return sum(block.size for block in self.lower)

    def forward(self, right_side: FloatArray) -> FloatArray:
        """L^-1 P b, (n, k)."""
        x = np.array(right_side, order="C") if self.order is None else right_side[self.order]
        for i, block in enumerate(self.lower):
            x[self.ends[i] : self.ends[i + 1]] = block @ x[self.ends[max(i - 1, 0)] : self.ends[i + 1]]
        return x

    def backward(self, right_side: FloatArray) -> FloatArray:
        """P^T L^-T y, (n, k)."""
        x = np.array(right_side, order="C")
        last = len(self.upper) - 1
        for i in range(last, -1, -1):
            x[self.ends[i] : self.ends[i + 1]] = self.upper[i] @ x[self.ends[i] : self.ends[min(i + 1, last) + 1]]
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
class _Layout:
    """Where entries of a pattern (CSR starts and columns) go in row blocks [A_i,i-1, A_ii], one after the other in one array."""

    starts: IntArray
    columns: IntArray
    lower: npt.NDArray[np.bool_]
    places: IntArray
    shapes: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, csr: Any, order: IntArray, ends: tuple[int, ...]) -> _Layout | None:
        """None where an entry lies outside the blocks."""
        place = np.empty_like(order)
        place[order] = np.arange(order.size)
        block = np.repeat(np.arange(len(ends) - 1), np.diff(ends))
        row, column = np.repeat(place, np.diff(csr.indptr)), place[csr.indices]
        at, beside = block[row], block[column]
        if (abs(at - beside) > 1).any():
            return None
        lower = beside <= at
        first = np.array([0, *ends])[: len(ends) - 1]  # the first column of each row block
        width = np.array(ends[1:]) - first
        offset = np.cumsum(np.r_[0, np.diff(ends) * width])[:-1]
        places = offset[at] + (row - np.array(ends)[at]) * width[at] + column - first[at]
        shapes = tuple(zip(np.diff(ends).tolist(), width.tolist(), strict=True))
        return cls(csr.indptr, csr.indices, lower, places[lower], shapes)

    def fits(self, csr: Any) -> bool:
        """Whether a matrix has this pattern."""
        return np.array_equal(self.starts, csr.indptr) and np.array_equal(self.columns, csr.indices)

    def blocks(self, csr: Any) -> list[tuple[FloatArray, FloatArray]]:
        """A_i,i-1 (no columns for the first) and A_ii of each row block."""
        size = sum(height * width for height, width in self.shapes)
        whole: FloatArray = np.asarray(np.bincount(self.places, csr.data[self.lower], size), dtype=float)
        out, start = [], 0
        for height, width in self.shapes:
            rows = whole[start : start + height * width].reshape(height, width)
            out.append((rows[:, : width - height], rows[:, width - height :]))
            start += height * width
        return out


@dataclass(frozen=True, eq=False)
class BandedAnalysis:
    """See `Analysis`: an order of the rows and the ends of their blocks, each of which meets its neighbours only."""

    order: IntArray
    ends: tuple[int, ...]
    pattern: Any

    @cached_property
    def estimate(self) -> Estimate:
        """Cost of a factorisation, exact but for what an indefinite matrix takes more."""
        size = np.diff(self.ends).astype(float)
        beside = size[1:] * size[:-1]
        fill = int(np.sum(size**2) + np.sum(beside))
        flops = float(np.sum(size**3) + 4.0 * np.sum(beside * (size[1:] + size[:-1])))
        return Estimate(fill, 16 * fill, 32 * fill, flops)

    @cached_property
    def layout(self) -> _Layout | None:
        """That of the pattern analysed."""
        return _Layout.of(self.pattern, self.order, self.ends)

    def factorize(self, matrix: Any) -> BandedFactor | IndefiniteFactor:
        """Factor a matrix; one that does not fit the blocks is analysed anew. SolverError where it is singular."""
        csr = _real(matrix)
        if csr.shape[0] != self.order.size:
            return analyze(csr).factorize(csr)
        fits = self.layout is not None and self.layout.fits(csr)
        layout = self.layout if fits else _Layout.of(csr, self.order, self.ends)
        if layout is None:
            return analyze(csr).factorize(csr)
        largest, blocks = float(abs(csr.data).max(initial=0.0)), layout.blocks(csr)
        inverses, beside = _roots(blocks)
        if len(inverses) == len(blocks):
            return self._positive(inverses, beside)
        found = _indefinite(blocks, inverses, self.order, self.ends, largest)
        if found is None:  # as one block, pivots are chosen among all rows
            one = (0, self.order.size)
            whole = _Layout.of(csr, self.order, one)
            found = None if whole is None else _indefinite(whole.blocks(csr), [], self.order, one, largest)
        if found is None:
            raise SolverError(f"the matrix {matrix.shape} is singular (a pivot vanishes); shift it or remove mechanisms")
        return found

    def _positive(self, inverses: list[FloatArray], beside: list[FloatArray]) -> BandedFactor:
        lower, upper = [], []
        for d, s, after in zip(inverses, [None, *beside], [*beside, None], strict=True):
            lower.append(d if s is None else np.hstack([-d @ s, d]))
            upper.append(np.ascontiguousarray(d.T) if after is None else np.hstack([d.T, -(after @ d).T]))
        natural = bool((np.diff(self.order) == 1).all())
        return BandedFactor(None if natural else self.order, self.ends, tuple(lower), tuple(upper))


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
        inverses.append(np.ascontiguousarray(lapack.dtrtri(root, lower=1)[0]))
    return inverses, beside


def _indefinite(
    blocks: list[tuple[FloatArray, FloatArray]],
    inverses: list[FloatArray],
    order: IntArray,
    ends: tuple[int, ...],
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
    return IndefiniteFactor(order, ends, tuple(pivots), tuple(left for left, _ in blocks[1:]))


def _vanishes(factored: FloatArray, swaps: IntArray, limit: float) -> bool:
    """Whether a 1 x 1 pivot is round-off (2 x 2 pivots are chosen for their size)."""
    return bool((abs(np.diagonal(factored)[swaps > 0]) <= limit).any())


def analyze(matrix: Any, *, threads: int | None = None) -> BandedAnalysis:  # noqa: ARG001  its threads are the BLAS library's
    """The order, as given or reverse Cuthill-McKee, that costs fewer flops. InputError for a complex matrix."""
    csr = _real(matrix)
    n = csr.shape[0]
    natural = np.arange(n)
    if n <= LEAST:
        return BandedAnalysis(natural, (0, n), csr)
    turned = np.asarray(reverse_cuthill_mckee(csr, symmetric_mode=True), dtype=np.int64)
    found = [BandedAnalysis(order, _ends(_reach(csr, order)), csr) for order in (natural, turned)]
    return min(found, key=lambda analysis: analysis.estimate.flops)


def _real(matrix: Any) -> Any:
    csr = sp.csr_array(matrix if sp.issparse(matrix) else dense(matrix))
    if np.iscomplexobj(csr.data):
        raise InputError("the banded backend factors real matrices; use rslab, pardiso or superlu for complex ones")
    return csr.astype(float, copy=False)


def _reach(csr: Any, order: IntArray) -> IntArray:
    """(n,) one more than the last column that the reordered rows up to each meet."""
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    reach = np.arange(1, order.size + 1)
    rows = np.flatnonzero(np.diff(csr.indptr))
    if rows.size:
        last = np.maximum.reduceat(place[csr.indices], csr.indptr[rows]) + 1
        reach[place[rows]] = np.maximum(reach[place[rows]], last)
    return np.asarray(np.maximum.accumulate(reach))


def _ends(reach: IntArray) -> tuple[int, ...]:
    """Ends of blocks (0 first, n last) such that rows of a block meet only its neighbours'."""
    n = reach.size
    ends, end = [0], LEAST
    while end < n:
        ends.append(end)
        end = max(int(reach[end - 1]), end + LEAST)
    if len(ends) > 1 and n - ends[-1] < LEAST // 2:
        ends.pop()
    return (*ends, n)
