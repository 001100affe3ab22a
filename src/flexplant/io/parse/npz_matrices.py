"""Matrices inside a `.npz`: dense, or sparse as scipy's CSR parts, or as the triangles of `*_KM.npz`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import ReadError
from flexplant.model.arrays import Matrix, is_sparse

CSR_PARTS = ("data", "indices", "indptr", "shape")


def pack_matrix(name: str, matrix: Matrix) -> dict[str, Any]:
    """Arrays that store a matrix: itself if dense, else name.data, name.indices, name.indptr, name.shape (CSR)."""
    if not is_sparse(matrix):
        return {name: np.asarray(matrix)}
    csr = sp.csr_array(matrix)
    return {f"{name}.{part}": np.asarray(getattr(csr, part)) for part in CSR_PARTS}


def matrix_names(arrays: dict[str, Any]) -> list[str]:
    """Names of the matrices that arrays hold, sparse ones once."""
    sparse = [k.removesuffix(".indptr") for k in arrays if k.endswith(".indptr")]
    return [k for k in arrays if not any(k == f"{s}.{p}" for s in sparse for p in CSR_PARTS)] + sparse


def unpack_matrices(arrays: dict[str, Any], path: Path) -> dict[str, Matrix]:
    """All matrices that arrays hold; ReadError for CSR parts that do not fit together."""
    return {name: arrays[name] if name in arrays else csr_matrix(arrays, name, path) for name in matrix_names(arrays)}


def csr_matrix(arrays: dict[str, Any], name: str, path: Path) -> Matrix:
    """The CSR matrix from its four parts."""
    try:
        data, indices, indptr, shape = (arrays[f"{name}.{part}"] for part in CSR_PARTS)
        rows, columns = (int(s) for s in np.ravel(shape))
        if len(indptr) != rows + 1:
            raise ValueError(f"{len(indptr)} row pointers for {rows} rows")
        matrix = sp.csr_array((data, indices, indptr), shape=(rows, columns))
        matrix.check_format(full_check=True)
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise ReadError(path, f"its sparse parts do not fit together ({error})", record=name) from None
    return matrix


def triangle(arrays: dict[str, Any], letter: str, n: int, path: Path) -> Matrix:
    """The symmetric CSR matrix of size n whose upper (or lower) triangle is stored as `Ki`, `Kj`, `Kv` (places from 0)."""
    row, column, value = (np.ravel(arrays[letter + part]) for part in "ijv")
    if not (row.size == column.size == value.size) or row.dtype.kind not in "iu" or column.dtype.kind not in "iu":
        raise ReadError(path, f"needs integer {letter}i, {letter}j and as many {letter}v", record=letter)
    if row.size and (min(row.min(), column.min()) < 0 or max(row.max(), column.max()) >= n):
        raise ReadError(path, f"places {row.min()} to {max(row.max(), column.max())} in {n} rows", record=letter)
    if row.size and (row < column).any() and (row > column).any():
        raise ReadError(path, "has entries in both triangles; one of them is needed", record=letter)
    half = sp.coo_array((value.astype(float), (row, column)), shape=(n, n))
    off = row != column
    other = sp.coo_array((value[off].astype(float), (column[off], row[off])), shape=(n, n))
    return (half.tocsr() + other.tocsr()).tocsr()
