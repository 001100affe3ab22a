"""Sums of modal receptances, sum_i c_i / (wn_i^2 - w^2 + 2 i zeta_i wn_i w), for many rows c and frequencies, in real arithmetic.

In a block of neighbouring frequencies most modes are far away and vary smoothly: their sum is evaluated at Chebyshev nodes and
interpolated, and only the modes near the block are summed one by one. The number of nodes is that at which the interpolation
error falls below round-off: a pole outside the Bernstein ellipse of size RHO around the block leaves RHO^-STRIP = 1e-15 of its
size (Trefethen, Approximation Theory and Approximation Practice, chapter 8). The blocks are those of least work (see `blocks`).
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.response.blocks import work_blocks
from flexplant.response.tiles import ROWS, STRIP, sum_blocks_numpy, summed

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
PLAIN = (1e-15, 1e25)  # rad/s between which products of three squared sizes neither underflow nor overflow
ANGLES = (np.arange(STRIP) + 0.5) * (np.pi / STRIP)
# values at the nodes -> coefficients of Chebyshev polynomials
TO_COEFFICIENTS = np.cos(np.outer(ANGLES, np.arange(STRIP))) * (np.where(np.arange(STRIP) == 0, 1.0, 2.0) / STRIP)


class ModalSum:
    """columns (rows, n) times the receptances of n modes; wn = 0 without damping stands for a rigid-body mode, -1 / w^2.

    Columns (groups, rows, n) are for sums at frequencies of their own, (groups, nf).
    """

    def __init__(self, columns: FloatArray, modal_omega: FloatArray, zeta: FloatArray) -> None:
        # the pole in the right half plane; the other one, or the other root of an overdamped mode, is farther from any w >= 0
        poles = modal_omega * np.sqrt(np.maximum(1 - zeta**2, 0.0))
        order = np.argsort(poles)
        self.poles, self.omega = poles[order], modal_omega[order]
        self.columns, self.damping = columns[..., order], (2 * zeta * modal_omega)[order]

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
            _sum(self, w[None], derivative, direct, rows, out)
        return out

    def groups(self, w: FloatArray) -> ComplexArray:
        """(rows, groups, nf) at w (groups, nf) >= 0, ascending along nf."""
        count = self.columns.shape[1]
        padded = w if w.shape[1] >= STRIP else np.pad(w, ((0, 0), (0, STRIP - w.shape[1])), mode="edge")
        out = np.empty((count, *padded.shape), dtype=complex)
        if count:
            _sum(self, padded, 0, np.zeros(count), np.arange(count), out)
        return out[:, :, : w.shape[1]]


def _sum(total: ModalSum, w: FloatArray, derivative: int, direct: FloatArray, rows: IntArray, out: ComplexArray) -> None:
    """`ModalSum` at ascending w (groups, nf >= STRIP); the rows that fill the last tile repeat the last one."""
    n, groups, filled = total.omega.size, w.shape[0], np.minimum(np.arange(-(-rows.size // ROWS) * ROWS), rows.size - 1)
    blocks = work_blocks(w, total.poles, filled.size // ROWS)
    columns = total.columns.reshape(groups, -1, n)[:, filled]
    left = np.ascontiguousarray(columns.reshape(-1, ROWS, n).transpose(0, 2, 1))
    strips, near = -(-(blocks[:, 1] - blocks[:, 0]) // STRIP), blocks[:, 3] - blocks[:, 2]
    tables, bases = np.empty((n + int((strips * near).max())) * 2 * STRIP), np.empty(int(strips.max()) * STRIP**2)
    series = (np.cos(ANGLES), TO_COEFFICIENTS.ravel())
    target = (np.tile(direct[filled], groups), np.tile(rows[filled], groups), tables, bases, out.reshape(-1).view(np.float64))
    kernel: Any = summed if _plain(w) and _plain(total.omega) else sum_blocks_numpy
    kernel(left.ravel(), total.omega, total.damping, np.ascontiguousarray(w).ravel(), blocks, *series, derivative, *target)


def _plain(omega: FloatArray) -> bool:
    """True for frequencies whose reciprocals may share a division."""
    low, high = omega.min(where=omega > 0, initial=PLAIN[1]), omega.max(initial=PLAIN[0])
    return bool(PLAIN[0] <= low and high <= PLAIN[1])
