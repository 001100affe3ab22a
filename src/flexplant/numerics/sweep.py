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
    """Factors a K + b M for many complex (a, b); K and M real symmetric, sparse, (n, n).

    `factor(a, b)` gives a `Factor`. With rslab the ordering and symbolic analysis of the common pattern are reused, which halves
    the time of a frequency; without it every matrix goes to `factorize`. Raises SolverError for a singular matrix.
    """

    def __init__(self, stiffness: Any, mass: Any) -> None:
        pattern = sp.csc_array(sp.tril(abs(sp.csc_array(stiffness)) + abs(sp.csc_array(mass))))
        pattern.sort_indices()
        self._indices, self._indptr, self._shape = pattern.indices, pattern.indptr, pattern.shape
        columns = np.repeat(np.arange(self._shape[1]), np.diff(self._indptr))
        self._k, self._m = (_entries(matrix, self._indices, columns) for matrix in (stiffness, mass))
        self._numeric: Callable[[ComplexArray], Any] | None = None
        if rslab_backend.available():
            import rslab

            self._numeric = rslab.analyze(sp.csc_matrix(pattern), path="ldlt", ordering="metis").factor

    def factor(self, a: complex, b: complex) -> Factor:
        """The factored matrix a K + b M."""
        data = a * self._k + b * self._m
        if self._numeric is None:
            lower = sp.csc_array((data, self._indices, self._indptr), shape=self._shape)
            return factorize(sp.csc_array(lower + sp.tril(lower, -1).T))
        try:
            return rslab_backend.RslabFactor(self._numeric(data), complex=True)
        except RuntimeError as error:
            raise SolverError(f"the matrix {self._shape} is singular ({error}); move the frequency or add damping") from None


def _entries(matrix: Any, rows: Any, columns: Any) -> ComplexArray:
    return np.asarray(sp.csr_array(matrix)[rows, columns], dtype=complex).ravel()
