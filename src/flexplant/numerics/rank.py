"""Ranks decided by scale: null spaces of symmetric positive semi-definite matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from scipy.sparse.csgraph import connected_components

from flexplant.model.arrays import FloatArray, IntArray

NEGATIVE = -1e-8  # of a unit diagonal: below this an eigenvalue is negative, not the rounding of a single-precision file
CANCELLED = 1e-9  # of its scale: below this a diagonal may be the round-off of a condensation (1e-13 to 1e-12 is seen)
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Split:
    """Range and null space of a symmetric matrix: columns of `span` and `null` together are a basis (n, n).

    lowest: smallest eigenvalue of the matrix scaled to unit diagonal (negative where it is indefinite).
    """

    span: FloatArray
    null: FloatArray
    lowest: float


def jacobi_scale(matrix: FloatArray) -> FloatArray:
    """d = 1 / sqrt(|diagonal|), and 0 for rows that are negligible: D A D has unit diagonal, whatever the units."""
    size = np.sqrt(abs(np.diagonal(matrix)))
    tiny = size <= EPS * size.max(initial=0.0)
    return np.divide(1.0, size, out=np.zeros_like(size), where=~tiny)


def lowest_eigenvalue(matrix: FloatArray, scale: FloatArray) -> float:
    """Smallest eigenvalue (0 at most) of D A D, D = 1 / sqrt(max(|diagonal|, scale)): small next to `scale` is round-off."""
    size = np.sqrt(np.maximum(abs(np.diagonal(matrix)), scale))
    d = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    return float(la.eigvalsh(d[:, None] * matrix * d[None, :]).min(initial=0.0)) if size.size else 0.0


def _cancelled(matrix: FloatArray, scale: FloatArray) -> IntArray:
    """Coordinates whose stiffness is round-off: small beside `scale`, and indefinite, which a soft spring never is."""
    small = np.flatnonzero(abs(np.diagonal(matrix)) <= CANCELLED * scale)
    block = matrix[np.ix_(small, small)]
    count, group = connected_components(block != 0, directed=False) if small.size else (0, small)
    members = [np.flatnonzero(group == g) for g in range(count)]
    noise = [at for at in members if lowest_eigenvalue(block[np.ix_(at, at)], np.zeros(at.size)) < NEGATIVE]
    return small[np.concatenate(noise)] if noise else small[:0]


def split_semidefinite(matrix: FloatArray, *, tolerance: float | None = None, scale: FloatArray | None = None) -> Split:
    """Split R^n into range and null space of a symmetric positive semi-definite (n, n) matrix.

    Eigenvalues of D A D (unit diagonal) at or below `tolerance` (default 10 n eps) count as zero, clearly negative ones do
    not; coordinates whose row vanishes are null exactly, and with `scale` (n,) those whose stiffness is round-off beside it:
    the boundary stiffness of one node is what is left of cancelling the whole interior's. Basis vectors come back in the
    original coordinates.
    """
    n = matrix.shape[0]
    d = jacobi_scale(matrix)
    if scale is not None:
        d[_cancelled(matrix, scale)] = 0.0
    live = np.flatnonzero(d)
    dead = np.flatnonzero(d == 0)
    values, vectors = (
        la.eigh(d[live, None] * matrix[np.ix_(live, live)] * d[None, live]) if live.size else (np.zeros(0), np.zeros((0, 0)))
    )
    limit = 10 * n * EPS if tolerance is None else tolerance
    zero = (values <= limit) & (values >= NEGATIVE)
    full = np.zeros((n, live.size))
    full[live] = d[live, None] * vectors
    return Split(full[:, ~zero], np.hstack([np.eye(n)[:, dead], full[:, zero]]), float(values.min(initial=0.0)))
