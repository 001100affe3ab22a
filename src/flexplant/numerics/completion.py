"""A pattern that orders fast: the blocks between nodes stored in full, so that DOF of one node are told to be alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.model.arrays import IntArray

BLANK = 1e-200  # instead of a zero: stored, but far below the round-off of any entry it meets
MOST = 1.6  # times the stored entries; where blocks are emptier than that, their zeros would cost more than they save


def completed(matrix: Any, groups: IntArray) -> sp.csr_array:
    """The sparse symmetric matrix (n, n) with all entries stored between groups that touch; groups (n,): one id a row.

    A fill-reducing ordering then works on groups, which are fewer by the square of their size: of a solid's stiffness, where
    a regular mesh leaves exact zeros inside the 3 x 3 blocks, nested dissection takes a quarter of the time. The same matrix
    comes back where all is stored already, blocks are mostly empty, or a row has no stiffness.
    """
    matrix = sp.csr_array(matrix)
    if not (matrix.diagonal() > 0).all():
        return matrix
    distinct, group = np.unique(groups, return_inverse=True)
    rows = sp.csr_array(
        (np.ones(group.size, dtype=np.float32), group, np.arange(group.size + 1)), shape=(group.size, distinct.size)
    )
    stored = sp.csr_array((np.ones(matrix.nnz, dtype=np.float32), matrix.indices, matrix.indptr), shape=matrix.shape)
    touching = sp.csr_array(rows.T @ (stored @ rows))
    size = np.bincount(group)
    entries = int(size @ (sp.csr_array((np.ones(touching.nnz), touching.indices, touching.indptr), shape=touching.shape) @ size))
    if not matrix.nnz < entries <= MOST * matrix.nnz:
        return matrix
    full = sp.csr_array(rows @ touching @ rows.T, dtype=np.float64)
    full.data[:] = BLANK
    return sp.csr_array(matrix + full)
