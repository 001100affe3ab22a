"""Numeric Cholesky factorisation, front by front: the dense work by LAPACK, what scatters in compiled loops.

Imported only where numba is installed. Source: Duff and Reid, ACM Trans. Math. Software 9 (1983).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.compiled import compiled
from flexplant.numerics.factorization.panel_lanes import QUAD
from flexplant.numerics.factorization.supernodes import Supernodes


@compiled
def placed(first, last, rows, place):
    """place: a front's columns first to last, then its rows below, counted from 0."""
    for j in range(first, last):
        place[j] = j - first
    for k in range(rows.size):
        place[rows[k]] = last - first + k


@compiled
def entered(triangle, below, first, last, rows, order, rank, indptr, indices, data, place):
    """Add the matrix's entries to a front: triangle (c, c), upper, and below (c, r), both by columns; whether all had a place."""
    columns = last - first
    for j in range(first, last):
        for p in range(indptr[order[j]], indptr[order[j] + 1]):
            i = rank[indices[p]]
            if i >= last:
                k = place[i] - columns
                if k < 0 or k >= rows.size or rows[k] != i:
                    return False
                below[k * columns + j - first] += data[p]
            elif i >= j:
                triangle[(i - first) * columns + j - first] += data[p]
    return True


@compiled
def extended(triangle, below, update, columns, height, child, rows, place):
    """Add a child's update, upper and by columns, to its parent's front: triangle, below, and what it hands on."""
    size, to, inside = rows.size, place[rows], 0
    while inside < size and to[inside] < columns:
        inside += 1
    for b in range(inside):
        for a in range(b + 1):
            triangle[to[b] * columns + to[a]] += child[b * size + a]
    for b in range(inside, size):
        at = (to[b] - columns) * columns
        for a in range(inside):
            below[at + to[a]] += child[b * size + a]
        at = (to[b] - columns) * height - columns
        for a in range(inside, b + 1):
            update[at + to[a]] += child[b * size + a]


@compiled
def packed(square, columns, out):
    """The columns of an upper triangle U, four by four, each four as long as the last of them: -U, and 1 / U on the diagonal."""
    at = 0
    for first in range(0, columns, QUAD):
        for k in range(first, min(first + QUAD, columns)):
            for i in range(k):
                out[at + i] = -square[k * columns + i]
            out[at + k] = 1 / square[k * columns + k]
            at += first + QUAD
        at += max(first + QUAD - columns, 0) * (first + QUAD)


@dataclass(frozen=True, eq=False)
class Panels:
    """-U of P A P^T = U^T U, supernode after supernode from at[s] on: its triangle with 1 / U on the diagonal, then the columns
    right of it, so that a solution consists of products that are added. All in fours, filled up with zeros.

    start, rows: as in `Supernodes`, but in fours, filled up with a row beyond the last.
    """

    nodes: Supernodes
    values: FloatArray
    at: IntArray
    start: IntArray
    rows: IntArray


def layout(nodes: Supernodes) -> tuple[IntArray, IntArray, IntArray]:
    """Where each supernode's values begin; its rows below, in fours."""
    quads, c, r = -(-nodes.columns // QUAD), nodes.columns, nodes.below
    wide = QUAD * -(-r // QUAD)
    start = np.r_[0, np.cumsum(wide)]
    rows = np.full(start[-1], nodes.order.size)
    rows[np.repeat(start[:-1] - nodes.start[:-1], r) + np.arange(nodes.rows.size)] = nodes.rows
    return np.r_[0, np.cumsum(QUAD * QUAD * quads * (quads + 1) // 2 + c * wide)], start, rows


def cholesky(nodes: Supernodes, matrix: Any) -> Panels | None:
    """The factor of a CSR matrix; None where it is not positive definite, or its pattern not symmetric."""
    at, start, padded = layout(nodes)
    values, place, rank = np.zeros(at[-1]), np.zeros(nodes.order.size, np.int64), np.empty(nodes.order.size, np.int64)
    rank[nodes.order] = np.arange(rank.size)
    entries = (nodes.order, rank, matrix.indptr, matrix.indices, matrix.data, place)
    waiting: dict[int, list[tuple[IntArray, FloatArray]]] = {}
    for s, (c, r) in enumerate(zip(nodes.columns.tolist(), nodes.below.tolist(), strict=True)):
        first, last, rows = nodes.first[s], nodes.first[s + 1], nodes.rows[nodes.start[s] : nodes.start[s + 1]]
        split = at[s + 1] - c * (start[s + 1] - start[s])
        square, update, right = np.zeros(c * c), np.zeros(r * r), values[split : split + c * r]
        placed(first, last, rows, place)
        if not entered(square, right, first, last, rows, *entries):
            return None
        for child_rows, child in waiting.pop(s, ()):
            extended(square, right, update, c, r, child, child_rows, place)
        shapes = ((square, (c, c)), (right, (c, r)), (update, (r, r)))
        if not _eliminated(*(block.reshape(shape, order="F") for block, shape in shapes)):
            return None
        packed(square, c, values[at[s] : split])
        if r:
            waiting.setdefault(int(nodes.parent[s]), []).append((rows, update))
    return Panels(nodes, values, at, start, padded)


def _eliminated(square: FloatArray, right: FloatArray, update: FloatArray) -> bool:
    """A front's columns eliminated in place: square becomes U11, right -U12, and update loses U12^T U12."""
    if dpotrf(square, lower=0, overwrite_a=1, clean=0)[1]:
        return False
    if right.size:
        dtrsm(-1.0, square, right, side=0, lower=0, trans_a=1, overwrite_b=1)
        dsyrk(-1.0, right, beta=1.0, c=update, trans=1, lower=0, overwrite_c=1)
    return True
