"""Products of tall blocks of columns, in vector registers where numba is installed: BLAS takes twice as long for them."""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dgemm

from flexplant.model.arrays import FloatArray
from flexplant.numerics import products
from flexplant.numerics.products import WIDTH, aligned, compiled_is_there


def shares(columns: FloatArray, block: FloatArray) -> FloatArray:
    """V^T W, (m, k), of columns V (n, m) and a block W (n, k). Deterministic."""
    whole = columns.shape[1] // WIDTH * WIDTH
    if not whole or not _suits(columns, block):
        return np.asarray(columns.T @ block)
    from flexplant.numerics import block_lanes

    out = np.zeros((columns.shape[1], block.shape[1]))
    given = (*_listed(columns), whole, np.ascontiguousarray(block).reshape(-1), block.shape[1])
    block_lanes.shares(*given, out.reshape(-1))
    out[whole:] = columns[:, whole:].T @ block
    return out


def minus(block: FloatArray, columns: FloatArray, share: FloatArray) -> FloatArray:
    """W - V C, (n, k), in one pass over the columns V (n, m), each column of which must be contiguous, or each row."""
    if not share.size:
        return block
    whole = columns.shape[1] // WIDTH * WIDTH
    if not whole or not _suits(columns, block):
        return np.asarray(dgemm(-1.0, columns, share, beta=1.0, c=np.array(block, order="F"), overwrite_c=True))
    from flexplant.numerics import block_lanes

    out = aligned(block.size).reshape(block.shape)
    np.subtract(block, columns[:, whole:] @ share[whole:], out=out)
    block_lanes.combined(
        *_listed(columns), whole, np.negative(share[:whole], order="C").reshape(-1), block.shape[1], out.reshape(-1)
    )
    return out


def _suits(columns: FloatArray, block: FloatArray) -> bool:
    k, n = block.shape[1], block.shape[0]
    tall = k > 0 and k % WIDTH == 0 and n >= products.LARGE and compiled_is_there()
    return tall and (columns.flags.f_contiguous or columns.flags.c_contiguous)


def _listed(columns: FloatArray) -> tuple[FloatArray, int, int]:
    """The values in their order in memory, and how far apart rows and columns are."""
    n, m = columns.shape
    if columns.flags.f_contiguous:
        return columns.reshape(-1, order="F"), 1, n
    return columns.reshape(-1), m, 1
