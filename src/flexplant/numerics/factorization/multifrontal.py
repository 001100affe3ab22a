"""Numeric Cholesky factorisation, front by front: the large products by BLAS, the rest in compiled loops.

Imported only where numba is installed. Source: Duff and Reid, ACM Trans. Math. Software 9 (1983).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.linalg.blas import dsyrk
from scipy.linalg.lapack import dpotrf

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.factorization.front_lanes import entered, extended, handed_on, packed, placed, solved_below
from flexplant.numerics.factorization.panel_lanes import STRIP
from flexplant.numerics.factorization.supernodes import Supernodes, in_strips
from flexplant.numerics.products import aligned

Eliminated: TypeAlias = Callable[[int, FloatArray, FloatArray, FloatArray], bool]
TOGETHER = 32  # rows below a triangle that are solved side by side


@dataclass(frozen=True, eq=False)
class Panels:
    """-L of P A P^T = L L^T, supernode after supernode from at[s] on, in strips of eight rows: those of its triangle, with 1 / L
    on the diagonal, each as long as it reaches, then those below it. A solution then consists of products that are added.

    A strip holds its columns one after the other; the last one of triangle and rows below is filled up with zeros (ones on the
    diagonal). start, rows: as in `Supernodes`, but in eights, filled up with a row beyond the last.
    """

    nodes: Supernodes
    values: FloatArray
    at: IntArray
    start: IntArray
    rows: IntArray


def layout(nodes: Supernodes) -> tuple[IntArray, IntArray, IntArray]:
    """Where each supernode's values begin; its rows below, in eights."""
    strips, c, r = in_strips(nodes.columns) // STRIP, nodes.columns, nodes.below
    wide = in_strips(r)
    start = np.r_[0, np.cumsum(wide)]
    rows = np.full(start[-1], nodes.order.size)
    rows[np.repeat(start[:-1] - nodes.start[:-1], r) + np.arange(nodes.rows.size)] = nodes.rows
    return np.r_[0, np.cumsum(STRIP * STRIP * strips * (strips + 1) // 2 + c * wide)], start, rows


class Fronts:
    """Memory for one front at a time, and two stacks of updates that wait for their parents: of even and odd depth."""

    def __init__(self, nodes: Supernodes) -> None:
        c, r = nodes.columns, in_strips(nodes.below)
        self.square, self.below = np.empty(int(np.max(c**2))), np.empty(int(np.max(c * r)))
        self.room, self.at = aligned(int(in_strips(c).max()) * TOGETHER), nodes.stacked[0]
        self.stacks, self.odd, self.height = [np.empty(size) for size in nodes.stacked[1]], nodes.depth % 2, r

    def update(self, s: int) -> FloatArray:
        """(r^2,) what supernode s hands on, r a multiple of eight."""
        return self.stacks[self.odd[s]][self.at[s] : self.at[s] + int(self.height[s]) ** 2]


def swept(nodes: Supernodes, matrix: Any, fronts: Fronts, eliminated: Eliminated) -> bool:
    """Front by front, children first; whether the CSR matrix had a place for all its entries, and every front was eliminated.

    eliminated(s, square (c, c), below (r, c), update (r, r)), all by columns and lower, r a multiple of eight, sets the update to
    what the columns take from the rows below them.
    """
    place, rank = np.zeros(nodes.order.size, np.int64), np.empty(nodes.order.size, np.int64)
    rank[nodes.order] = np.arange(rank.size)
    entries = (nodes.order, rank, matrix.indptr, matrix.indices, matrix.data, place)
    for s, (c, r) in enumerate(zip(nodes.columns.tolist(), fronts.height.tolist(), strict=True)):
        first, last, rows = nodes.first[s], nodes.first[s + 1], nodes.rows[nodes.start[s] : nodes.start[s + 1]]
        square, below, update = fronts.square[: c * c], fronts.below[: c * r], fronts.update(s)
        square[:], below[:] = 0.0, 0.0
        placed(first, last, rows, place)
        if not entered(square, below, r, first, last, rows, *entries):
            return False
        children = [(nodes.rows[nodes.start[k] : nodes.start[k + 1]], fronts.update(k)) for k in nodes.families[s]]
        for child_rows, child in children:
            extended(square, below, c, r, child, child_rows, place)
        if not eliminated(s, square, below, update):
            return False
        for child_rows, child in children if r else ():
            handed_on(update, c, r, child, child_rows, place)
    return True


def cholesky(nodes: Supernodes, matrix: Any) -> Panels | None:
    """The factor of a CSR matrix; None where it is not positive definite, or its pattern not symmetric."""
    at, start, padded = layout(nodes)
    values, fronts = aligned(int(at[-1])), Fronts(nodes)

    def eliminated(s: int, square: FloatArray, below: FloatArray, update: FloatArray) -> bool:
        c, r = int(nodes.columns[s]), int(fronts.height[s])
        if dpotrf(square.reshape((c, c), order="F"), lower=1, overwrite_a=1, clean=0)[1]:
            return False
        packed(square, c, values, at[s])
        if r:
            solved_below(values, at[s], at[s + 1] - c * r, c, below, r, fronts.room, TOGETHER)
            dsyrk(-1.0, below.reshape((r, c), order="F"), c=update.reshape((r, r), order="F"), lower=1, overwrite_c=1)
        return True

    return Panels(nodes, values, at, start, padded) if swept(nodes, matrix, fronts, eliminated) else None
