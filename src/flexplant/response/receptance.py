"""Sums of modal receptances, sum_i c_i / (wn_i^2 - w^2 + 2 i zeta_i wn_i w), for many rows c and frequencies, in real arithmetic.

In a block of neighbouring frequencies most modes are far away and vary smoothly: their sum is evaluated at Chebyshev nodes and
interpolated, and only the modes near the block are summed one by one. The number of nodes is that at which the interpolation
error falls below round-off: a pole outside the Bernstein ellipse of size RHO around the block leaves RHO^-STRIP = 1e-15 of its
size (Trefethen, Approximation Theory and Approximation Practice, chapter 8). The blocks are those of least work.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.response.tiles import ROWS, STRIP, summed

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
RHO = 10 ** (15 / STRIP)
REACH = 0.5 * (RHO + 1 / RHO)  # half the width of that ellipse, where the block is two wide
TABLE = 6.0  # work of a receptance, beside that of adding it to ROWS rows
ANGLES = (np.arange(STRIP) + 0.5) * (np.pi / STRIP)
# values at the nodes -> coefficients of Chebyshev polynomials
TO_COEFFICIENTS = np.cos(np.outer(ANGLES, np.arange(STRIP))) * (np.where(np.arange(STRIP) == 0, 1.0, 2.0) / STRIP)


class ModalSum:
    """columns (rows, n) times the receptances of n modes; wn = 0 without damping stands for a rigid-body mode, -1 / w^2."""

    def __init__(self, columns: FloatArray, modal_omega: FloatArray, zeta: FloatArray) -> None:
        # the pole in the right half plane; the other one, or the other root of an overdamped mode, is farther from any w >= 0
        poles = modal_omega * np.sqrt(np.maximum(1 - zeta**2, 0.0))
        order = np.argsort(poles)
        self.poles, self.omega = poles[order], modal_omega[order]
        self.columns, self.damping = columns[:, order], (2 * zeta * modal_omega)[order]

    def __call__(
        self,
        w: FloatArray,
        *,
        derivative: int = 0,
        direct: FloatArray | None = None,
        out: ComplexArray | None = None,
        rows: IntArray | None = None,
    ) -> ComplexArray:
        """(rows, nf) at w (nf,) >= 0 in any order, times (i w)^derivative, plus direct (rows,).

        out: C-contiguous (any, nf) to write into, at its `rows`. At w = 0 a rigid-body mode adds nothing.
        """
        count = self.columns.shape[0]
        direct = np.zeros(count) if direct is None else direct
        rows = np.arange(count) if rows is None else rows
        out = np.empty((count, w.size), dtype=complex) if out is None else out
        if w.size < STRIP or (w[1:] < w[:-1]).any():
            order = np.argsort(w, kind="stable")
            padded = np.concatenate([w[order], np.full(max(STRIP - w.size, 0), w.max(initial=0.0))])
            out[rows[:, None], order] = self(padded, derivative=derivative, direct=direct)[:, : w.size]
        elif count:
            _sum(self, w, derivative, direct, rows, out)
        return out


def work_blocks(w: FloatArray, poles: FloatArray, tiles: int) -> IntArray:
    """(nb, 4) start, stop, first and last near mode of the blocks of ascending w (nf >= STRIP,) that cost least.

    Blocks are halved as long as that saves work (counted in modes added to ROWS rows at STRIP frequencies); one whose modes are
    all near is summed plainly.
    """
    strips, n = -(-w.size // STRIP), poles.size
    row = tiles + TABLE
    levels = []
    for level in range(strips.bit_length()):
        edges = (strips * np.arange(2**level + 1)) >> level
        start, stop = np.minimum(edges[:-1] * STRIP, w.size - STRIP), np.minimum(edges[1:] * STRIP, w.size)
        low, high = w[start], w[stop - 1]
        margin = 0.5 * (REACH - 1) * (high - low)
        first, last = np.searchsorted(poles, low - margin), np.searchsorted(poles, high + margin, side="right")
        size = np.diff(edges)
        interpolated = size * ((last - first) * row + STRIP * (tiles + 1)) + n * row + STRIP * tiles
        plain = size * n * row
        summed_plainly = (plain <= interpolated) | (high <= low)
        first[summed_plainly], last[summed_plainly] = 0, n
        cost = np.where(summed_plainly, plain, interpolated)
        levels.append((np.stack([start, stop, first, last], axis=1), cost))
    return _cheapest(levels)


def _cheapest(levels: list[tuple[IntArray, FloatArray]]) -> IntArray:
    """The blocks of least cost, where each of a level is the union of two of the next."""
    best, halved = levels[-1][1], [np.zeros(levels[-1][1].size, dtype=bool)]
    for _, cost in levels[-2::-1]:
        halves = best.reshape(-1, 2).sum(axis=1)
        halved.insert(0, halves < cost)
        best = np.minimum(cost, halves)
    chosen, open_ = [], np.ones(1, dtype=bool)
    for (blocks, _), split in zip(levels, halved, strict=True):
        chosen.append(blocks[open_ & ~split])
        open_ = np.repeat(open_ & split, 2)
    found = np.concatenate(chosen)
    return np.asarray(found[np.argsort(found[:, 0])], dtype=np.int64)


def _sum(total: ModalSum, w: FloatArray, derivative: int, direct: FloatArray, rows: IntArray, out: ComplexArray) -> None:
    """`ModalSum` at ascending w (nf >= STRIP,); the rows that fill the last tile repeat the last one."""
    n, filled = total.omega.size, np.minimum(np.arange(-(-rows.size // ROWS) * ROWS), rows.size - 1)
    blocks = work_blocks(w, total.poles, filled.size // ROWS)
    left = np.ascontiguousarray(total.columns[filled].reshape(-1, ROWS, n).transpose(0, 2, 1))
    strips, near = -(-(blocks[:, 1] - blocks[:, 0]) // STRIP), blocks[:, 3] - blocks[:, 2]
    tables, bases = np.empty((n + int((strips * near).max())) * 2 * STRIP), np.empty(int(strips.max()) * STRIP**2)
    modes, frequencies = (total.omega, total.damping), np.ascontiguousarray(w)
    series = (np.cos(ANGLES), TO_COEFFICIENTS.ravel())
    target = (direct[filled], rows[filled], tables, bases, out.reshape(-1).view(np.float64))
    summed(left.ravel(), *modes, frequencies, blocks, *series, derivative, *target)
