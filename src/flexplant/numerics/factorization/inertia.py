"""Sylvester's inertia of an indefinite matrix, front by front: L S L^T with S = +-1, without pivoting, and a check of its growth.

A matrix K - s M of a structure has few negative eigenvalues, so most fronts are definite, and Cholesky's. Without pivoting
L S L^T is the factor of A + E with |E| about the round-off of |L| |L|^T (Higham 2002, chapter 11). The diagonal of that is the
diagonal of A where A is definite: where no row exceeds its own much, E is that of a Cholesky factor, and the signs are as sure.
Imported only where numba is installed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.compiled import compiled
from flexplant.numerics.factorization.front_lanes import packed, solved_below
from flexplant.numerics.factorization.multifrontal import TOGETHER, Fronts, layout, swept
from flexplant.numerics.factorization.panel_lanes import STRIP
from flexplant.numerics.factorization.supernodes import Supernodes
from flexplant.numerics.products import aligned

GROWTH = 1e4  # of |L| |L|^T over |A| on the diagonal, up to which signs count: E then is 1e-12 of the diagonal
NOISE = 1e-13  # of that diagonal: a pivot up to there may be round-off
BLOCK, PANEL = 128, 512  # columns eliminated together, and updated together


@compiled
def signed_block(a: Any, signs: Any, turn: Any) -> Any:
    """a (c, c), symmetric, becomes L with a positive diagonal, of P A P^T = L S L^T, the largest pivot of those left first.

    signs (c,): S; turn (c,): rows of P. False where all pivots left are zero.
    """
    c = signs.size
    for k in range(c):
        best = k
        for i in range(k + 1, c):
            if abs(a[i, i]) > abs(a[best, best]):
                best = i
        if best != k:
            for i in range(c):
                a[k, i], a[best, i] = a[best, i], a[k, i]
            for i in range(c):
                a[i, k], a[i, best] = a[i, best], a[i, k]
            turn[k], turn[best] = turn[best], turn[k]
        if not abs(a[k, k]) > 0.0:
            return False
        signs[k] = 1.0 if a[k, k] > 0 else -1.0
        a[k, k] = np.sqrt(abs(a[k, k]))
        for i in range(k + 1, c):
            a[i, k] /= signs[k] * a[k, k]
        for i in range(k + 1, c):
            for j in range(k + 1, i + 1):
                a[i, j] -= signs[k] * a[i, k] * a[j, k]
                a[j, i] = a[i, j]
    return True


def signed_cholesky(a: FloatArray) -> tuple[FloatArray, IntArray] | None:
    """S (c,) and the rows of P (c,) of P A P^T = L S L^T; a (c, c), lower and by columns, becomes L, with a positive diagonal.

    Pivots are chosen within blocks of columns. None where they are all zero.
    """
    c, signs, turn = a.shape[0], np.empty(a.shape[0]), np.arange(a.shape[0])
    for k in range(0, c, BLOCK):
        own, end = slice(k, min(k + BLOCK, c)), min(k + BLOCK, c)
        corner, local = np.tril(a[own, own]), np.arange(end - k)
        corner += np.tril(corner, -1).T
        if not signed_block(corner, signs[own], local):
            return None
        a[own, own], a[own, :k], turn[own] = corner, a[own, :k][local], turn[own][local]
        scaled = dtrsm(1.0, corner, a[end:, own][:, local], side=1, lower=1, trans_a=1)
        a[end:, own] = scaled * signs[own]
        for first in range(end, c, PANEL):
            a[first:, first : first + PANEL] -= scaled[first - end :] @ a[first : first + PANEL, own].T
    return signs, turn


class Inertia:
    """What `swept` eliminates: only signs are kept, and what the rows of |L| |L|^T have grown to on the diagonal."""

    def __init__(self, nodes: Supernodes, matrix: Any) -> None:
        self.nodes, self.fronts, self.negative = nodes, Fronts(nodes), 0
        self.values = aligned(int(np.diff(layout(nodes)[0]).max()))
        self.size, self.grown = abs(matrix.diagonal())[nodes.order], np.zeros(nodes.order.size)

    def eliminated(self, s: int, square: FloatArray, below: FloatArray, update: FloatArray) -> bool:
        """See `swept`; False where the signs may be round-off."""
        c, r = int(self.nodes.columns[s]), int(self.fronts.height[s])
        lower, x, out = (a.reshape((-1, k), order="F") for a, k in ((square, c), (below, c), (update, max(r, 1))))
        factored = _factored(lower)
        if factored is None:
            return False
        negative, turn = factored
        own, rows = self.nodes.first[s] + turn, self.nodes.rows[self.nodes.start[s] : self.nodes.start[s + 1]]
        if r:
            if negative.size:
                x[:] = x[:, turn]
            packed(square, c, self.values, 0)
            strips = -(-c // STRIP)
            triangle = STRIP * STRIP * strips * (strips + 1) // 2
            solved_below(self.values, 0, triangle, c, below, r, self.fronts.room, TOGETHER)
            dsyrk(-1.0, x, c=out, lower=1, overwrite_c=1)
            if negative.size:  # - X S X^T, of all columns as if they were positive
                dsyrk(2.0, x[:, negative], beta=1.0, c=out, lower=1, overwrite_c=1)
            self.grown[rows] += np.einsum("ij,ij->i", x, x)[: rows.size]
        self.negative += negative.size
        inside = np.tril(lower)
        self.grown[own] += np.einsum("ij,ij->i", inside, inside)
        sure = np.diagonal(lower) ** 2 > NOISE * self.grown[own]
        return bool((sure & (self.grown[own] <= GROWTH * self.size[own])).all())


def _factored(a: FloatArray) -> tuple[IntArray, IntArray] | None:
    """Places of the negative pivots and the rows of P, of P A P^T = L S L^T; a (c, c), lower and by columns, becomes L."""
    given = a.copy(order="F")
    if not dpotrf(a, lower=1, overwrite_a=1, clean=0)[1]:
        return np.zeros(0, dtype=np.int64), np.arange(a.shape[0])
    a[:] = given
    signed = signed_cholesky(a)
    return None if signed is None else (np.flatnonzero(signed[0] < 0), signed[1])


def negative_eigenvalues(nodes: Supernodes, matrix: Any) -> int | None:
    """How many eigenvalues of a CSR matrix are negative; None where its entries lack a place, or the signs may be round-off."""
    inertia = Inertia(nodes, matrix)
    return inertia.negative if swept(nodes, matrix, inertia.fronts, inertia.eliminated) else None
