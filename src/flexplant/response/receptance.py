"""Sums of modal receptances, sum_i c_i / (wn_i^2 - w^2 + 2 i zeta_i wn_i w), for many rows c and frequencies, in real arithmetic.

In a block of neighbouring frequencies most modes are far away and vary smoothly: their sum is evaluated at Chebyshev nodes and
interpolated, and only the modes near the block are summed one by one. The degree is chosen so that the interpolation error is
below round-off: a pole outside the Bernstein ellipse of size RHO around the block leaves RHO^-NODES = 1e-17 of its size
(Trefethen, Approximation Theory and Approximation Practice, chapter 8).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.model.arrays import FloatArray
from flexplant.numerics.compiled import Kernel

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
NODES, RHO = 32, 3.4
ANGLES = (np.arange(NODES) + 0.5) * (np.pi / NODES)
# values at the nodes -> coefficients of Chebyshev polynomials
TO_COEFFICIENTS = np.cos(np.outer(ANGLES, np.arange(NODES))) * (np.where(np.arange(NODES) == 0, 1.0, 2.0) / NODES)


def _receptance_loops(modal_omega, zeta, omega, real_part, imaginary_part):  # type: ignore[no-untyped-def]
    """(n, nf) real and imaginary parts; (wn - w)(wn + w) keeps its digits near wn."""
    for i in range(modal_omega.size):
        wn = modal_omega[i]
        damping = 2 * zeta[i] * wn
        for k in range(omega.size):
            real = (wn - omega[k]) * (wn + omega[k])
            imaginary = damping * omega[k]
            scale = 1 / (real * real + imaginary * imaginary)
            real_part[i, k] = real * scale
            imaginary_part[i, k] = -imaginary * scale


def _receptance_numpy(
    modal_omega: FloatArray, zeta: FloatArray, omega: FloatArray, real_part: FloatArray, imaginary_part: FloatArray
) -> None:
    np.subtract(modal_omega[:, None], omega, out=real_part)
    scale = modal_omega[:, None] + omega
    real_part *= scale
    np.multiply((-2 * zeta * modal_omega)[:, None], omega, out=imaginary_part)
    np.multiply(real_part, real_part, out=scale)
    scale += imaginary_part * imaginary_part
    np.divide(1, scale, out=scale)
    real_part *= scale
    imaginary_part *= scale


def _chebyshev_loops(x, out):  # type: ignore[no-untyped-def]
    """out[k] = T_k(x) by the three-term recurrence."""
    for j in range(x.size):
        out[0, j] = 1.0
        out[1, j] = x[j]
    for k in range(2, out.shape[0]):
        for j in range(x.size):
            out[k, j] = 2 * x[j] * out[k - 1, j] - out[k - 2, j]


def _chebyshev_numpy(x: FloatArray, out: FloatArray) -> None:
    out[0], out[1] = 1.0, x
    for k in range(2, len(out)):
        np.multiply(2 * x, out[k - 1], out=out[k])
        out[k] -= out[k - 2]


receptance = Kernel(_receptance_loops, _receptance_numpy)
chebyshev = Kernel(_chebyshev_loops, _chebyshev_numpy)


class ModalSum:
    """columns (rows, n) times the receptances of n modes with wn > 0; call it with a block of omega (nf,), rad/s."""

    def __init__(self, columns: FloatArray, modal_omega: FloatArray, zeta: FloatArray) -> None:
        self.columns, self.omega, self.zeta = np.ascontiguousarray(columns), modal_omega, zeta
        root = np.sqrt((1 - zeta**2).astype(complex))
        self._poles = modal_omega * np.stack([root + 1j * zeta, -root + 1j * zeta])

    @property
    def block(self) -> int:
        """Frequencies that a block should have: many make interpolation pay, few keep the result in cache."""
        return 512 if self.columns.shape[0] < 200 else 192

    def blocks(self, omega: FloatArray) -> Iterator[tuple[slice, ComplexArray]]:
        """(slice, (rows, block)) over all frequencies."""
        for start in range(0, omega.size, self.block):
            w = omega[start : start + self.block]
            yield slice(start, start + w.size), self(w)

    def __call__(self, w: FloatArray, out: ComplexArray | None = None) -> ComplexArray:
        """(rows, nf) at omega (nf,) in any order, written into `out` where it is given."""
        low, high = float(w.min()), float(w.max())
        center, half = 0.5 * (low + high), 0.5 * (high - low)
        near = self._near(center, half)
        count = int(near.sum())
        interpolated = count + 2 * NODES < near.size and w.size > 2 * NODES and half > 0
        if not interpolated:
            near, count = np.ones(near.size, dtype=bool), near.size
        size = count + (NODES if interpolated else 0)
        tables = np.empty((2, size, w.size))
        receptance(self.omega[near], self.zeta[near], w, tables[0, :count], tables[1, :count])
        left = [self.columns[:, near] if interpolated else self.columns] * 2
        if interpolated:
            chebyshev((w - center) / half, tables[0, count:])
            tables[1, count:] = tables[0, count:]
            left = [np.hstack([left[0], part]) for part in self._smooth(~near, center, half)]
        out = np.empty((self.columns.shape[0], w.size), dtype=complex) if out is None else out
        out.real, out.imag = left[0] @ tables[0], left[1] @ tables[1]
        return out

    def _near(self, center: float, half: float) -> npt.NDArray[np.bool_]:
        """Modes with a pole inside the ellipse around [center - half, center + half]."""
        x = (self._poles - center) / max(half, 1e-300)
        size = abs(x + np.sqrt(x - 1) * np.sqrt(x + 1))
        return np.asarray((np.maximum(size, 1 / np.maximum(size, 1e-300)) < RHO).any(axis=0))

    def _smooth(self, far: npt.NDArray[np.bool_], center: float, half: float) -> list[FloatArray]:
        """Chebyshev coefficients (rows, NODES) of the real and of the imaginary part of the far modes' sum."""
        tables = np.empty((2, int(far.sum()), NODES))
        receptance(self.omega[far], self.zeta[far], center + half * np.cos(ANGLES), tables[0], tables[1])
        columns = self.columns[:, far]
        return [(columns @ table) @ TO_COEFFICIENTS for table in tables]
