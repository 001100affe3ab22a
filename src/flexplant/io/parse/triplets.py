"""Square symmetric matrices from (row, column, value) entries: one triangle, or both."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.sparse as sp

from flexplant.errors import ReadError
from flexplant.model.arrays import FloatArray, IntArray, Matrix


def symmetric_matrix(path: Path, rows: IntArray, columns: IntArray, values: FloatArray, n: int) -> Matrix:
    """(n, n) CSR from places counted from 0; entries of one triangle are mirrored, both triangles are taken as they are.

    Raises ReadError for places outside the matrix, and for entries listed twice.
    """
    if rows.size and max(rows.max(), columns.max()) >= n:
        raise ReadError(path, f"has row or column {max(rows.max(), columns.max()) + 1}; there are {n}")
    matrix = sp.coo_array((values, (rows, columns)), shape=(n, n)).tocsr()
    if matrix.nnz < rows.size and np.unique(rows * n + columns).size < rows.size:
        raise ReadError(path, "lists an entry twice")
    if (rows < columns).any() and (rows > columns).any():
        return matrix
    diagonal = sp.dia_array((matrix.diagonal()[None, :], [0]), shape=(n, n))
    return sp.csr_array(matrix + matrix.T - diagonal)


def check_covers(path: Path, matrix: Matrix, n: int) -> None:
    """ReadError for a matrix that claims far more rows than the file has numbers for (a hostile or wrong size)."""
    if n > 2 * matrix.nnz + 1000:
        raise ReadError(path, f"claims {n} rows but holds only {matrix.nnz} numbers")
