"""Products of a sparse matrix with many columns, in vector registers where numba is installed and the matrix is large."""

from __future__ import annotations

import importlib.util
from functools import cache
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.model.arrays import FloatArray

LARGE = 20_000  # rows from which loading the compiled loops is worth it
WIDTH = 8  # columns side by side
FEW = 4  # columns that are not worth being filled up to as many


@cache
def compiled_is_there() -> bool:
    """Whether numba is installed."""
    return importlib.util.find_spec("numba") is not None


def aligned(size: int) -> FloatArray:
    """(size,) values, not set, that begin where a line of memory does, as eight of them in a register should."""
    room = np.empty(size + WIDTH)
    return room[(-room.ctypes.data // room.itemsize) % WIDTH :][:size]


def product(matrix: Any, block: FloatArray) -> FloatArray:
    """A X, (m, k), of a sparse or dense matrix (m, n) and columns (n, k). Deterministic."""
    if not _suits(matrix, block):
        return np.asarray(matrix @ block)
    from flexplant.numerics.product_lanes import multiply

    k = block.shape[1]
    wide = WIDTH * -(-k // WIDTH)
    x = np.ascontiguousarray(block)
    if wide > k:
        x = np.zeros((block.shape[0], wide))
        x[:, :k] = block
    out = aligned(matrix.shape[0] * wide).reshape(-1, wide)
    multiply(matrix.indptr, matrix.indices, matrix.data, x.reshape(-1), wide, out.reshape(-1))
    return out if wide == k else out[:, :k]


def _suits(matrix: Any, block: FloatArray) -> bool:
    if block.ndim != 2 or block.shape[1] < FEW or matrix.shape[0] < LARGE or not sp.issparse(matrix) or matrix.format != "csr":
        return False
    return matrix.dtype == block.dtype == np.float64 and compiled_is_there()
