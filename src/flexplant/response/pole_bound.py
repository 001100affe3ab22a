"""Pole-residue sums for the interval bounds of `interval_bound`: any stable system whose eigenvectors are well conditioned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.response.first_order import ComplexArray, TransferFunction
from flexplant.response.interval_bound import towards
from flexplant.response.singular import largest_singular_values

CHUNK = 1 << 20  # entries of the tables taken at a time


@dataclass(frozen=True, eq=False)
class PoleAxis:
    """G = sum_k l_k r_k^T / (s - p_k) + D on one part of the axis: t = w in [0, edge], or t = 1 / w in [0, 1 / edge].

    A term's second derivative is at most 2 |l| |r| / d^3 below the edge, d the distance of the interval from the pole; above,
    where it is (t / p) / (i / p - t), |l| |r| / |p| (2 t / d^3 + 2 / d^2), d the distance from i / p.
    """

    transfer: TransferFunction
    residues: tuple[ComplexArray, ComplexArray, ComplexArray]
    edge: float
    high: bool

    @property
    def points(self) -> FloatArray:
        """The ends of the axis; below the edge also every resonance and the place of every pole."""
        if self.high:
            return np.array([0.0, 1 / self.edge])
        poles = self.residues[0]
        peaks = np.sqrt(np.maximum(poles.imag**2 - poles.real**2, 0.0))
        return np.unique(np.r_[0.0, peaks, abs(poles.imag), self.edge])

    def gains(self, t: FloatArray) -> FloatArray:
        """(nt,) largest singular value."""
        D = self.transfer.system.D
        out = np.full(t.size, np.linalg.norm(D, 2) if D.size else 0.0)
        finite = t > 0 if self.high else np.ones(t.size, dtype=bool)
        if finite.any():
            omega = 1 / t[finite] if self.high else t
            out[finite] = largest_singular_values(self.transfer(np.asarray(1j * omega, dtype=complex)))
        return out

    def curvatures(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, IntArray]:
        """Sum over the poles of the bounds of their second derivatives, and the pole that adds most."""
        place, width = self._places()
        poles, left, right = self.residues
        size = np.linalg.norm(left, axis=0) * np.linalg.norm(right, axis=1) / (abs(poles) if self.high else 1.0)
        bound, pole = np.empty(a.size), np.empty(a.size, dtype=np.int64)
        rows = max(CHUNK // poles.size, 1)
        for start in range(0, a.size, rows):
            at = slice(start, start + rows)
            gap = np.maximum(np.maximum(a[at, None] - place, place - b[at, None]), 0.0)
            near = 1 / np.hypot(gap, width)
            term = size * (2 * b[at, None] * near**3 + 2 * near**2 if self.high else 2 * near**3)
            bound[at], pole[at] = term.sum(axis=1), term.argmax(axis=1)
        return bound, pole

    def between(self, a: FloatArray, b: FloatArray, fraction: FloatArray, pole: IntArray) -> FloatArray:
        """Denser towards the pole."""
        place, width = self._places()
        return towards(a, b, fraction, place[pole], width[pole])

    def _places(self) -> tuple[FloatArray, FloatArray]:
        poles = self.residues[0]
        scale = 1 / abs(poles) ** 2 if self.high else np.ones(poles.size)
        return poles.imag * scale, abs(poles.real) * scale
