"""Symmetric eigenproblems  K x = w^2 M x  with known rigid-body motions and singular mass."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray, dense
from flexplant.numerics.factorization import Analysis, Factor, analyze, factorize, refuse_above
from flexplant.numerics.lanczos import BASIS_BYTES, BLOCK, Progress, lanczos
from flexplant.numerics.rank import EPS, split_semidefinite

INDEFINITE = 1e-8  # of a unit diagonal: more negative than any single-precision round-off of a vendor's matrix
FIRST_GUESS = 20
DENSE_FACTOR = 700  # entries of the factor a row, from which twice as many columns are solved in nearly the same time
WIDER = 4  # times the block, for modes repeated more often than it is wide


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """omega2 (k,) ascending, vectors (n, k) mass-normalised, zero: how many leading ones are exact rigid-body motions.

    proved: a Sturm count confirmed that no mode below the requested limit is missing.
    """

    omega2: FloatArray
    vectors: FloatArray
    zero: int
    proved: bool = False


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
    stiffness: Any,
    mass: Any,
    rigid: FloatArray,
    *,
    n_modes: int | None,
    max_omega2: float | None,
    progress: Progress | None = None,
) -> Eigenpairs:
    """The lowest modes of a large sparse problem by block Lanczos on one factor: `rigid`, then the first `n_modes` elastic
    ones, or all with w^2 <= max_omega2, or fewer where both are given. Rigid motions (n, r) of K are deflated.

    Modes below `max_omega2` are counted beforehand by Sylvester's law (negative pivots of K - max_omega2 M), so that none is
    missing; `proved` says whether the backend could. A small negative shift keeps K - s M definite for free-free models.
    """
    k, m = sp.csc_array(stiffness), sp.csr_array(mass)
    _refuse_indefinite(m)
    zero = orthonormalize(rigid, m)
    analysis = analyze(k - m)
    refuse_above(analysis.estimate, None)
    count = None if max_omega2 is None else count_below(k, m, max_omega2, analysis)
    shift = -_small_shift(k, m)
    factor = analysis.factorize(sp.csc_array(k - shift * m))
    wanted = Wanted(n_modes, max_omega2, None if count is None else max(count - zero.shape[1], 0))
    found = shift_invert(factor, m, wanted, shift=shift, rigid=zero, progress=progress)
    return Eigenpairs(np.r_[np.zeros(zero.shape[1]), found.omega2], np.hstack([zero, found.vectors]), zero.shape[1], found.proved)


@dataclass(frozen=True)
class Wanted:
    """The first n_modes, or all with w^2 <= max_omega2, or fewer where both are given; count: how many the latter are."""

    n_modes: int | None
    max_omega2: float | None
    count: int | None = None


def count_below(stiffness: Any, mass: Any, omega2: float, analysis: Analysis) -> int | None:
    """How many w^2 of K x = w^2 M x lie below `omega2` (Sylvester's law of inertia, a Sturm count); None if it cannot tell.

    A mode that sits on the limit to the last digit makes the matrix singular; the limit is then raised by 1e-9 of itself.
    """
    try:
        factor = analysis.factorize(sp.csc_array(stiffness - omega2 * mass))
    except SolverError:
        factor = analysis.factorize(sp.csc_array(stiffness - omega2 * (1 + 1e-9) * mass))
    return factor.negative_pivots


def shift_invert(
    factor: Factor,
    mass: Any,
    wanted: Wanted,
    *,
    shift: float = 0.0,
    rigid: FloatArray | None = None,
    memory_limit: float = BASIS_BYTES,
    progress: Progress | None = None,
) -> Eigenpairs:
    """The elastic modes `wanted`, from the factor of K - shift M; rigid (n, r) mass-orthonormal motions are deflated.

    Without a count the number of modes is doubled until one lies above the limit. A mode repeated more often than a block is
    wide can be missed: where fewer modes are found than were counted, a wider block tries again, and SolverError follows.
    """
    limit, count = wanted.max_omega2, wanted.count
    ask = min(x for x in (wanted.n_modes, count, mass.shape[0]) if x is not None)
    if wanted.n_modes is None and count is None:
        ask = min(FIRST_GUESS, mass.shape[0])
    below, block = factor.negative_pivots or 0, BLOCK if factor.fill < DENSE_FACTOR * mass.shape[0] else 2 * BLOCK
    widest = WIDER * block
    search = partial(
        lanczos, factor.solve, mass, shift=shift, below=below, locked=rigid, memory_limit=memory_limit, progress=progress
    )
    while True:
        found = search(n_modes=ask, block=block)
        inside = np.ones(found.omega2.size, dtype=bool) if limit is None else found.omega2 <= limit * (1 + 1e-9)
        missed = count is not None and ask == count and np.count_nonzero(inside) < count
        if missed and block == widest:
            raise SolverError(
                f"{count} modes lie below the limit, but only {np.count_nonzero(inside)} were found; change the limit"
            )
        if missed:
            block = widest
        elif limit is None or count is not None or wanted.n_modes == ask or not inside.all() or found.exhausted:
            return Eigenpairs(found.omega2[inside], found.vectors[:, inside], 0, limit is not None and count is not None)
        else:
            ask = min(2 * ask, mass.shape[0])


def _refuse_indefinite(mass: Any) -> None:
    """SolverError where inertia shows a mass clearly below zero: Lanczos would return numbers that mean nothing."""
    diagonal = abs(mass.diagonal())
    size = np.where(diagonal > 0, diagonal, np.max(diagonal, initial=0.0) or 1.0)
    negative = factorize(sp.csc_array(mass + sp.diags_array(INDEFINITE * size))).negative_pivots
    if negative:
        raise SolverError(
            f"the coupled mass matrix is indefinite ({negative} negative eigenvalues): check the components' masses, their "
            "units, and that every interface is coupled"
        )


def _small_shift(k: Any, m: Any) -> float:
    """A shift far below the first elastic mode: 1e-10 of the mesh's stiffest ratio k_ii / m_ii (rad/s)^2."""
    diagonal = m.diagonal()
    ratio = k.diagonal()[diagonal > 0] / diagonal[diagonal > 0]
    return float(1e-10 * np.max(ratio, initial=1e-10))
