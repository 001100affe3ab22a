"""CHOLMOD by scikit-sparse: supernodal L L^T of real positive definite matrices, simplicial L D L^T of indefinite ones.

CHOLMOD's supernodal part, and with it scikit-sparse as usually built, is under the GNU General Public License: it is an extra
that a user installs by own choice. It is imported here only, when it is asked for by name.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import InputError, MissingExtraError, SolverError
from flexplant.numerics.factorization.column_counts import cholesky_estimate, relaxed_entries, tree_and_counts
from flexplant.numerics.factorization.protocol import Estimate

SUPERNODAL, SIMPLICIAL = "supernodal", "simplicial"
MERGED = ((4, np.inf), (16, 0.8), (48, 0.1), (10**15, 0.05))  # CHOLMOD's nrelax and zrelax, as its user guide documents them
ENTRY_BYTES = 11  # measured, index and the triangles above the diagonal blocks included


def available() -> bool:
    """True where scikit-sparse is installed."""
    return importlib.util.find_spec("sksparse") is not None


@dataclass(frozen=True, eq=False)
class CholmodFactor:
    """See `Factor`."""

    handle: Any
    mode: str
    backend: str = "cholmod"

    @cached_property
    def negative_pivots(self) -> int:
        """None of a positive definite matrix; else those of D, which without pivoting has the matrix' inertia."""
        return 0 if self.mode == SUPERNODAL else int(np.count_nonzero(self.handle.D() < 0))

    @cached_property
    def fill(self) -> int:
        """Entries of L."""
        return int(self.handle.L().nnz if self.mode == SUPERNODAL else self.handle.LD().nnz)

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        b = np.asarray(right_side, dtype=float)
        return np.asarray(self.handle.solve_A(b)) if b.size else b.copy()


@dataclass(frozen=True, eq=False)
class CholmodAnalysis:
    """See `Analysis`. scikit-sparse does not hand out CHOLMOD's own count of the fill, so it is counted in CHOLMOD's order."""

    symbolic: Any
    pattern: Any

    @cached_property
    def estimate(self) -> Estimate:
        """Cost of a supernodal factorisation."""
        order = np.asarray(self.symbolic.P(), dtype=np.int64)
        parent, counts = tree_and_counts(sp.csr_array(self.pattern), order)
        return cholesky_estimate(counts, relaxed_entries(parent, counts, MERGED), ENTRY_BYTES)

    def factorize(self, matrix: Any) -> CholmodFactor:
        """Factor a matrix; one of another pattern is analysed anew. SolverError where it is singular."""
        from sksparse import cholmod

        csc = _real(matrix)
        if not _same_pattern(csc, self.pattern):
            return analyze(csc).factorize(csc)
        try:
            return CholmodFactor(self.symbolic.cholesky(csc), SUPERNODAL)
        except cholmod.CholmodNotPositiveDefiniteError:
            return _indefinite(csc)
        except cholmod.CholmodOutOfMemoryError:
            raise SolverError(f"CHOLMOD ran out of memory on {csc.shape}; reduce the model in parts") from None


def _indefinite(csc: Any) -> CholmodFactor:
    """L D L^T without pivoting: right while no pivot vanishes, as for K - s M off its frequencies."""
    from sksparse import cholmod

    try:
        handle = cholmod.analyze(csc, mode=SIMPLICIAL).cholesky(csc)
        pivots = handle.D()
    except cholmod.CholmodNotPositiveDefiniteError as error:
        raise SolverError(f"the matrix {csc.shape} is singular ({error}); shift it or remove mechanisms") from None
    if not np.isfinite(pivots).all() or not pivots.all():
        raise SolverError(f"the matrix {csc.shape} is singular (a pivot vanishes); shift it or remove mechanisms")
    return CholmodFactor(handle, SIMPLICIAL)


def _same_pattern(a: Any, b: Any) -> bool:
    return a.nnz == b.nnz and np.array_equal(a.indptr, b.indptr) and np.array_equal(a.indices, b.indices)


def _real(matrix: Any) -> Any:
    csc = sp.csc_matrix(matrix)
    if np.iscomplexobj(csc.data):
        raise InputError("CHOLMOD factors Hermitian, not complex-symmetric matrices; use rslab, pardiso or superlu")
    csc = csc.astype(float)
    csc.sort_indices()
    return csc


def analyze(matrix: Any, *, threads: int | None = None) -> CholmodAnalysis:  # noqa: ARG001  its threads are the BLAS library's
    """Order and analyse; MissingExtraError where scikit-sparse is not installed, InputError for a complex matrix."""
    try:
        from sksparse import cholmod
    except ImportError:
        raise MissingExtraError("scikit-sparse", "cholmod") from None
    csc = _real(matrix)
    return CholmodAnalysis(cholmod.analyze(csc, mode=SUPERNODAL), csc)
