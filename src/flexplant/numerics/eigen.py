"""Symmetric eigenproblems  K x = w^2 M x  with known rigid-body motions and singular mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray, dense
from flexplant.numerics.factorization import factorize
from flexplant.numerics.rank import EPS, split_semidefinite

INDEFINITE = 1e-8  # of a unit diagonal: more negative than any single-precision round-off of a vendor's matrix
SEED = 20190811


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """omega2 (k,) ascending, vectors (n, k) mass-normalised, zero: how many leading ones are exact rigid-body motions."""

    omega2: FloatArray
    vectors: FloatArray
    zero: int


def orthonormalize(vectors: FloatArray, mass: Any) -> FloatArray:
    """Mass-orthonormal basis of the span of (n, k) vectors; SolverError where a motion has no mass."""
    if not vectors.shape[1]:
        return vectors
    gram = vectors.T @ (mass @ vectors)
    values, rotation = la.eigh(gram)
    if values.min() <= EPS * gram.shape[0] * max(values.max(), 0.0):
        raise SolverError("a rigid-body motion of the model moves no mass: add mass, or ground the mechanism")
    return np.asarray((vectors @ rotation) / np.sqrt(values))


def dense_eigenpairs(stiffness: Any, mass: Any, rigid: FloatArray) -> Eigenpairs:
    """All finite modes of a small problem; (n, n) matrices, rigid (n, k) spans the known zero-energy motions.

    The rigid motions are deflated exactly (x with R^T M x = 0), massless directions are condensed statically.
    Raises SolverError for an indefinite mass, or a mechanism without mass.
    """
    k, m = dense(stiffness), dense(mass)
    zero = orthonormalize(rigid, m)
    complement = la.qr(m @ zero)[0][:, zero.shape[1] :] if zero.shape[1] else np.eye(k.shape[0])
    k, m = complement.T @ k @ complement, complement.T @ m @ complement
    values, vectors = _finite_modes(0.5 * (k + k.T), 0.5 * (m + m.T))
    return Eigenpairs(np.r_[np.zeros(zero.shape[1]), values], np.hstack([zero, complement @ vectors]), zero.shape[1])


def _finite_modes(k: FloatArray, m: FloatArray) -> tuple[FloatArray, FloatArray]:
    split = split_semidefinite(m)
    if split.lowest < -INDEFINITE:
        raise SolverError(
            f"the coupled mass matrix is indefinite (smallest eigenvalue {split.lowest:.3g} of a unit diagonal): check the "
            "components' masses, their units, and that every interface is coupled"
        )
    if not split.null.shape[1]:
        values, vectors = la.eigh(k, m)
        return np.asarray(values), np.asarray(vectors)
    t = split.span - split.null @ _condense(split.null.T @ k @ split.null, split.null.T @ k @ split.span)
    values, vectors = la.eigh(t.T @ k @ t, t.T @ m @ t)
    return np.asarray(values), np.asarray(t @ vectors)


def _condense(knn: FloatArray, kns: FloatArray) -> FloatArray:
    scale = 1 / np.sqrt(np.maximum(np.diagonal(knn), np.finfo(float).tiny))
    try:
        factor = la.cho_factor(scale[:, None] * knn * scale)
        if np.min(np.abs(np.diagonal(factor[0]))) < 1e-7:
            raise la.LinAlgError
    except la.LinAlgError:
        raise SolverError("a motion has neither mass nor stiffness: couple or ground those DOF") from None
    return np.asarray(scale[:, None] * la.cho_solve(factor, scale[:, None] * kns))


def sparse_eigenpairs(
    stiffness: Any, mass: Any, rigid: FloatArray, *, n_modes: int | None, max_omega2: float | None
) -> Eigenpairs:
    """The lowest modes of a large sparse problem by shift-invert Lanczos on one factor (ARPACK).

    A small negative shift keeps K - s M definite for free-free models; known rigid motions replace their computed images.
    With `max_omega2` the count is enlarged until a mode above the limit is found.
    """
    k, m = sp.csc_array(stiffness), sp.csc_array(mass)
    zero = orthonormalize(rigid, m)
    shift = -_small_shift(k, m)
    factor = factorize(k - shift * m)
    want = 20 if n_modes is None else n_modes
    size = k.shape[0]
    while True:
        count = min(want + zero.shape[1] + 2, size - 1)
        values, vectors = _lanczos(k, m, shift, factor, count)
        order = np.argsort(values)
        found = _without_rigid(values[order], vectors[:, order], zero, m)
        enough = n_modes is not None or max_omega2 is None or found.omega2[-1] > max_omega2 or count >= size - 1
        if enough:
            return found
        want *= 2


def _small_shift(k: Any, m: Any) -> float:
    """A shift far below the first elastic mode: 1e-10 of the mesh's stiffest ratio k_ii / m_ii (rad/s)^2."""
    diagonal = m.diagonal()
    ratio = k.diagonal()[diagonal > 0] / diagonal[diagonal > 0]
    return float(1e-10 * np.max(ratio, initial=1e-10))


def _lanczos(k: Any, m: Any, shift: float, factor: Any, count: int) -> tuple[FloatArray, FloatArray]:
    operator = LinearOperator(k.shape, matvec=factor.solve, dtype=float)
    start = np.random.default_rng(SEED).standard_normal(k.shape[0])
    basis = min(k.shape[0] - 1, max(2 * count + 1, 20))
    try:
        values, vectors = eigsh(k, count, m, sigma=shift, OPinv=operator, v0=start, ncv=basis, tol=1e-12)
    except ArpackError as error:
        raise SolverError(f"the eigensolver did not find {count} modes ({error}); ask for fewer modes") from None
    return np.asarray(values), np.asarray(vectors)


def _without_rigid(values: FloatArray, vectors: FloatArray, zero: FloatArray, m: Any) -> Eigenpairs:
    """Take the exact rigid motions for their computed images, and clean the elastic shapes of them."""
    n_zero = zero.shape[1]
    share = np.einsum("ij,ij->j", zero.T @ (m @ vectors), zero.T @ (m @ vectors))
    elastic = np.sort(np.argsort(share, kind="stable")[: values.size - n_zero])
    shapes = vectors[:, elastic] - zero @ (zero.T @ (m @ vectors[:, elastic]))
    shapes /= np.sqrt(np.einsum("ij,ij->j", shapes, m @ shapes))
    return Eigenpairs(np.r_[np.zeros(n_zero), values[elastic]], np.hstack([zero, shapes]), n_zero)
