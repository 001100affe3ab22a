"""Factoring many symmetric matrices of one sparsity pattern: the symbolic work is done once where the backend can."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from flexplant.errors import SolverError
from flexplant.numerics.factorization import Factor, factorize, rslab_backend

ComplexArray: TypeAlias = npt.NDArray[np.complex128]


class PencilSweep:
    """Factors a K + b M + ... for many complex (a, b, ...); K, M, ... real symmetric, sparse, (n, n).

    `factor(a, b, ...)` gives a `Factor`. With rslab the ordering and symbolic analysis of the common pattern are reused, which
    halves the time of a frequency; without it every matrix goes to `factorize`. Raises SolverError for a singular matrix.
    """

    def __init__(self, *matrices: Any) -> None:
        pattern = sp.csc_array(sp.tril(sum(abs(sp.csc_array(m)) for m in matrices)))
        pattern.sort_indices()
        self._indices, self._indptr, self._shape = pattern.indices, pattern.indptr, pattern.shape
        columns = np.repeat(np.arange(self._shape[1]), np.diff(self._indptr))
        self._entries = [_entries(matrix, self._indices, columns) for matrix in matrices]
        self._numeric: Callable[[ComplexArray], Any] | None = None
        if rslab_backend.available():
            import rslab

            self._numeric = rslab.analyze(sp.csc_matrix(pattern), path="ldlt", ordering="metis").factor

    def factor(self, *coefficients: complex) -> Factor:
        """The factored matrix a K + b M + ..."""
        data = np.zeros(self._indices.size, dtype=complex)
        for a, entries in zip(coefficients, self._entries, strict=True):
            data += a * entries
        if self._numeric is None:
            lower = sp.csc_array((data, self._indices, self._indptr), shape=self._shape)
            return factorize(sp.csc_array(lower + sp.tril(lower, -1).T))
        try:
            return rslab_backend.RslabFactor(self._numeric(data), complex=True)
        except RuntimeError as error:
            raise SolverError(f"the matrix {self._shape} is singular ({error}); move the frequency or add damping") from None


def _entries(matrix: Any, rows: Any, columns: Any) -> ComplexArray:
    return np.asarray(sp.csr_array(matrix)[rows, columns], dtype=complex).ravel()
