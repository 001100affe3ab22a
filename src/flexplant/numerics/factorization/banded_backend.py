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
from flexplant.numerics.factorization.protocol import Estimate

LEAST = 64  # rows a block: below that a product costs as much as its call
GROWTH = 1e4  # times the largest entry: a pivot block that grows beyond has lost the digits that signs are read from
TINY = 1e-15  # of the largest entry: a pivot block's own pivot below it is round-off


@dataclass(frozen=True, eq=False)
class BandedFactor:
    """See `Factor`: P A P^T = L L^T, L block-bidiagonal, `order` P's rows.

    lower: [-D_i S_i, D_i], and upper: [D_i^T, -(S_(i+1) D_i)^T], of the inverses D of the diagonal blocks and the blocks S
    beside them, so that a row block of a solution takes one product.
    """

    order: IntArray
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
        x = right_side[self.order]
        for i, block in enumerate(self.lower):
            x[self.ends[i] : self.ends[i + 1]] = block @ x[self.ends[max(i - 1, 0)] : self.ends[i + 1]]
        return x

    def backward(self, right_side: FloatArray) -> FloatArray:
        """P^T L^-T y, (n, k)."""
        x = np.array(right_side)
        last = len(self.upper) - 1
        for i in range(last, -1, -1):
            x[self.ends[i] : self.ends[i + 1]] = self.upper[i] @ x[self.ends[i] : self.ends[min(i + 1, last) + 1]]
        out = np.empty_like(x)
        out[self.order] = x
        return out

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        b = np.asarray(right_side, dtype=float)
        return self.backward(self.forward(b.reshape(b.shape[0], -1))).reshape(b.shape)


@dataclass(frozen=True, eq=False)
class IndefiniteFactor:
    """See `Factor`: block L D L^T whose pivot blocks are factored with pivoting, beside: the blocks below them."""

    order: IntArray
    ends: tuple[int, ...]
    pivots: tuple[tuple[FloatArray, IntArray], ...]
    beside: tuple[FloatArray, ...]
    backend: str = "banded"

    @cached_property
    def negative_pivots(self) -> int:
        """Inertia adds up over Schur complements (Haynsworth); a 2 x 2 pivot has one negative eigenvalue."""
        single = sum(int(np.count_nonzero((p > 0) & (np.diagonal(d) < 0))) for d, p in self.pivots)
        return single + sum(int(np.count_nonzero(p < 0)) // 2 for _, p in self.pivots)

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


def _solved(pivot: tuple[FloatArray, IntArray], right_side: FloatArray) -> FloatArray:
    return np.asarray(lapack.dsytrs(*pivot, right_side, lower=1)[0]) if right_side.size else right_side


@dataclass(frozen=True, eq=False)
class BandedAnalysis:
    """See `Analysis`: an order of the rows and the ends of their blocks, each of which meets its neighbours only."""

    order: IntArray
    ends: tuple[int, ...]

    @cached_property
    def estimate(self) -> Estimate:
        """Cost of a factorisation, exact but for what an indefinite matrix takes more."""
        size = np.diff(self.ends).astype(float)
        beside = size[1:] * size[:-1]
        fill = int(np.sum(size**2) + np.sum(beside))
        flops = float(np.sum(size**3) + 4.0 * np.sum(beside * (size[1:] + size[:-1])))
        return Estimate(fill, 16 * fill, 24 * fill + 8 * self.ends[-1] ** 2, flops)

    def factorize(self, matrix: Any) -> BandedFactor | IndefiniteFactor:
        """Factor a matrix; one that does not fit the blocks is analysed anew. SolverError where it is singular."""
        csr = _real(matrix)
        if not self._holds(csr):
            return analyze(csr).factorize(csr)
        whole = csr.toarray() if self._natural else csr.toarray()[np.ix_(self.order, self.order)]
        found = self._positive(whole) or self._indefinite(whole, self.ends) or self._indefinite(whole, (0, len(whole)))
        if found is None:
            raise SolverError(f"the matrix {matrix.shape} is singular (a pivot vanishes); shift it or remove mechanisms")
        return found

    @cached_property
    def _natural(self) -> bool:
        return bool((np.diff(self.order) == 1).all())

    def _holds(self, csr: Any) -> bool:
        n = self.ends[-1]
        if csr.shape != (n, n):
            return False
        block = np.empty(n, dtype=np.int64)
        block[self.order] = np.repeat(np.arange(len(self.ends) - 1), np.diff(self.ends))
        return bool((abs(np.repeat(block, np.diff(csr.indptr)) - block[csr.indices]) <= 1).all())

    def _positive(self, whole: FloatArray) -> BandedFactor | None:
        """None where a pivot is not positive."""
        lower: list[FloatArray] = []
        upper: list[FloatArray] = []
        beside = np.zeros((0, 0))
        for i, (start, end) in enumerate(pairwise(self.ends)):
            pivot = whole[start:end, start:end]
            root, failed = lapack.dpotrf(pivot - beside @ beside.T if i else pivot, lower=1, clean=1)
            if failed:
                return None
            inverse = lapack.dtrtri(root, lower=1)[0]
            lower.append(np.hstack([-inverse @ beside, inverse]) if i else np.ascontiguousarray(inverse))
            after = self.ends[min(i + 2, len(self.ends) - 1)]
            beside = whole[end:after, start:end] @ inverse.T
            upper.append(np.hstack([inverse.T, -(beside @ inverse).T]))
        return BandedFactor(self.order, self.ends, tuple(lower), tuple(upper))

    def _indefinite(self, whole: FloatArray, ends: tuple[int, ...]) -> IndefiniteFactor | None:
        """None where a pivot block is singular, or so near to it that the next one loses its digits."""
        pivots: list[tuple[FloatArray, IntArray]] = []
        beside: list[FloatArray] = []
        largest = abs(whole).max(initial=0.0)
        for i, (start, end) in enumerate(pairwise(ends)):
            pivot = whole[start:end, start:end]
            if i:
                pivot = pivot - beside[-1] @ _solved(pivots[-1], beside[-1].T)
            factored, swaps, failed = lapack.dsytrf(pivot, lower=1, lwork=LEAST * (end - start))
            if failed or not abs(pivot).max() <= GROWTH * largest or _vanishes(factored, swaps, TINY * largest):
                return None
            pivots.append((factored, swaps))
            if end < ends[-1]:
                beside.append(whole[end : ends[i + 2], start:end])
        return IndefiniteFactor(self.order, ends, tuple(pivots), tuple(beside))


def _vanishes(factored: FloatArray, swaps: IntArray, limit: float) -> bool:
    """Whether a 1 x 1 pivot is round-off (2 x 2 pivots are chosen for their size)."""
    return bool((abs(np.diagonal(factored)[swaps > 0]) <= limit).any())


def analyze(matrix: Any, *, threads: int | None = None) -> BandedAnalysis:  # noqa: ARG001  its threads are the BLAS library's
    """The order, as given or reverse Cuthill-McKee, that costs fewer flops. InputError for a complex matrix."""
    csr = _real(matrix)
    n = csr.shape[0]
    turned = np.asarray(reverse_cuthill_mckee(csr, symmetric_mode=True), dtype=np.int64) if n else np.arange(0)
    found = [BandedAnalysis(order, _ends(_reach(csr, order))) for order in (np.arange(n), turned)]
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
