"""Cholesky factors by compiled loops and LAPACK: of large positive definite matrices, for many solutions with many columns."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import MissingExtraError
from flexplant.model.arrays import FloatArray
from flexplant.numerics.factorization import rslab_backend, superlu_backend
from flexplant.numerics.factorization.protocol import Analysis, Estimate, Factor
from flexplant.numerics.products import aligned

WIDTH = 8  # columns that are solved side by side
FEWEST, MOST = 16, 64  # columns at a time: with more a column takes less time, and more memory,
ROOM = 8_000_000  # of which so many values are no matter


def available() -> bool:
    """True where numba is installed."""
    return importlib.util.find_spec("numba") is not None


@dataclass(frozen=True, eq=False)
class CholeskyFactor:
    """See `Factor`."""

    panels: Any
    backend: str = "supernodal"
    negative_pivots: int = 0

    @property
    def fill(self) -> int:
        """Entries of the factor."""
        return int(self.panels.nodes.fill)

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        b = np.asarray(right_side, dtype=float)
        columns = b.reshape(b.shape[0], -1)
        if not columns.size:
            return b.copy()
        out, together = np.empty(columns.shape), self._together
        for start in range(0, columns.shape[1], together):
            some = slice(start, start + together)
            self._solve_some(columns[:, some], out[:, some])
        return out.reshape(b.shape)

    @property
    def _together(self) -> int:
        """Columns at a time."""
        return int(np.clip(ROOM // self.panels.nodes.order.size, FEWEST, MOST)) // FEWEST * FEWEST

    def _solve_some(self, columns: FloatArray, out: FloatArray) -> None:
        from flexplant.numerics.factorization.panel_lanes import STRIP, backward, forward, one_column

        p, order, k = self.panels, self.panels.nodes.order, columns.shape[1]
        wide = 1 if k == 1 else WIDTH * -(-k // WIDTH)
        flat = aligned((order.size + STRIP) * wide)
        x = flat.reshape(-1, wide)
        x[:, k:], x[order.size :], x[: order.size, :k] = 0.0, 0.0, columns[order]
        shared = (p.values, p.at, p.nodes.first, p.start, p.rows, flat)
        if wide == 1:
            one_column(*shared)
        else:
            forward(*shared, wide)
            backward(*shared, wide)
        out[order] = x[: order.size, :k]


@dataclass(frozen=True, eq=False)
class SupernodalAnalysis:
    """See `Analysis`. What is not positive definite, or has another pattern, is left to `pivoting`."""

    nodes: Any
    pattern: Any
    threads: int | None

    @cached_property
    def estimate(self) -> Estimate:
        """Cost of a factorisation and of solutions with a few columns."""
        from flexplant.numerics.factorization.multifrontal import layout

        at, _, rows = layout(self.nodes)
        held = 8 * int(at[-1] + rows.size + self.nodes.rows.size + 3 * self.nodes.order.size)
        return Estimate(self.nodes.fill, held, held + 8 * self.nodes.waiting, self.nodes.flops)

    @cached_property
    def pivoting(self) -> Analysis:
        """An analysis for matrices of the pattern that may be indefinite."""
        return _other(self.pattern, self.threads)

    def factorize(self, matrix: Any) -> Factor:
        """Factor a matrix."""
        from flexplant.numerics.factorization.multifrontal import cholesky

        csr = _sorted(matrix)
        same = np.array_equal(csr.indptr, self.pattern.indptr) and np.array_equal(csr.indices, self.pattern.indices)
        panels = cholesky(self.nodes, csr) if same and not np.iscomplexobj(csr.data) else None
        return self.pivoting.factorize(matrix) if panels is None else CholeskyFactor(panels)

    def negative_eigenvalues(self, matrix: Any) -> int | None:
        """How many eigenvalues of a real matrix of the pattern are negative, by the same order of elimination and about the
        work of a Cholesky factor, of which nothing is kept; None where pivots are needed to tell."""
        from flexplant.numerics.factorization.inertia import negative_eigenvalues

        csr = _sorted(matrix)
        fits = csr.shape == self.pattern.shape and not np.iscomplexobj(csr.data)
        return negative_eigenvalues(self.nodes, csr) if fits else None


def analyze(matrix: Any, *, threads: int | None = None) -> Analysis:
    """Order by nested dissection, and analyse. threads: of the factors of other matrices; LAPACK takes its own."""
    if not available():
        raise MissingExtraError("numba", "fast")
    csr = _sorted(matrix)
    if not csr.diagonal().all():
        return _other(csr, threads)
    from flexplant.numerics.factorization.supernodes import supernodes

    return SupernodalAnalysis(supernodes(csr), csr, threads)


def _other(pattern: Any, threads: int | None) -> Analysis:
    backend = rslab_backend if rslab_backend.available() else superlu_backend
    other: Analysis = backend.analyze(pattern, threads=threads)
    return other


def _sorted(matrix: Any) -> sp.csr_array:
    csr = sp.csr_array(matrix)
    return csr if csr.has_sorted_indices else csr.sorted_indices()
