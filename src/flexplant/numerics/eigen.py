"""Symmetric eigenproblems  K x = w^2 M x  with known rigid-body motions and singular mass."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray, dense
from flexplant.numerics.eigen_dense import ROUNDED, finite_count, finite_modes, indefinite
from flexplant.numerics.eigen_small import all_modes, shapes, short_lanczos
from flexplant.numerics.factorization import Analysis, BandedFactor, Factor, analyze, factorize, refuse_above
from flexplant.numerics.lanczos import BASIS_BYTES, BLOCK, LanczosPairs, Progress, lanczos
from flexplant.numerics.products import product
from flexplant.numerics.rank import EPS
from flexplant.numerics.sturm import count_below, gap_below_last, is_cheap

FIRST_GUESS = 20
SOFT = 1e-6  # of a typical k_ii / m_ii: by that the mass measures coordinates without stiffness
DENSE_FACTOR = 700  # entries of the factor a row, from which twice as many columns are solved in nearly the same time
TOGETHER = 16  # columns whose residuals are computed at a time
WIDER = 4  # times the block, for modes repeated more often than it is wide


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """omega2 (k,) ascending, vectors (n, k) mass-normalised, zero: how many leading ones are exact rigid-body motions.

    residuals (k,): |K x - w^2 M x| / |K x| as computed from the matrices (|K x| / ||K| |x|| of rigid-body motions).
    proved: a Sturm count confirmed that no mode is missing: below the requested limit, or, where a number of modes was
    asked, below the last of them (the last group of equal ones).
    """

    omega2: FloatArray
    vectors: FloatArray
    zero: int
    residuals: FloatArray
    proved: bool = False


def residuals(stiffness: Any, mass: Any, omega2: FloatArray, vectors: FloatArray, zero: int = 0) -> FloatArray:
    """(k,) relative residuals of modes, see `Eigenpairs`."""
    size, left = np.empty(omega2.size), np.empty(omega2.size)
    for start in range(0, omega2.size, TOGETHER):
        some = slice(start, start + TOGETHER)
        shapes = np.ascontiguousarray(vectors[:, some])
        force = product(stiffness, shapes)
        size[some] = np.linalg.norm(force, axis=0)
        left[some] = np.linalg.norm(force - product(mass, shapes) * omega2[some], axis=0)
    size[:zero] = np.linalg.norm(abs(stiffness) @ abs(vectors[:, :zero]), axis=0) if zero else 0.0
    return np.asarray(left / np.maximum(size, np.finfo(float).tiny))


def orthonormalize(vectors: FloatArray, mass: Any) -> FloatArray:
    """Mass-orthonormal basis of the span of (n, k) vectors; SolverError where a motion has no mass."""
    if not vectors.shape[1]:
        return vectors
    gram = vectors.T @ (mass @ vectors)
    values, rotation = la.eigh(gram)
    if values.min() <= EPS * gram.shape[0] * max(values.max(), 0.0):
        raise SolverError("a rigid-body motion of the model moves no mass: add mass, or ground the mechanism")
    return np.asarray((vectors @ rotation) / np.sqrt(values))


def dense_eigenpairs(
    stiffness: Any, mass: Any, rigid: FloatArray, *, max_omega2: float | None = None, n_modes: int | None = None
) -> Eigenpairs:
    """The finite modes of a small problem; (n, n) matrices, rigid (n, k) spans the known zero-energy motions.

    All of them, or at least those with w^2 <= max_omega2, or the first n_modes, where these are given: more may come back.
    The rigid motions are deflated exactly (x with R^T M x = 0); massless directions follow statically.
    Raises SolverError for an indefinite mass, or a mechanism without mass.
    """
    k, m = dense(stiffness), dense(mass)
    zero = orthonormalize(rigid, m)
    r = zero.shape[1]
    most = finite_count(m) - r
    limits: dict[str, Any] = {
        "max_omega2": np.inf if max_omega2 is None else max_omega2,
        "enough": None if n_modes is None else max(n_modes - r, 0),
    }
    if r:
        basis = _complement(k, m, zero)
        kept, moved = basis.T @ k @ basis, basis.T @ m @ basis
        values, vectors = finite_modes(0.5 * (kept + kept.T), 0.5 * (moved + moved.T), most, **limits)
        vectors = basis @ vectors
        vectors -= zero @ (zero.T @ (m @ vectors))
    else:
        values, vectors = finite_modes(0.5 * (k + k.T), 0.5 * (m + m.T), most, **limits)
    omega2, shapes = np.r_[np.zeros(r), values], np.hstack([zero, vectors])
    return Eigenpairs(omega2, shapes, r, residuals(stiffness, mass, omega2, shapes, r), True)


def _complement(k: FloatArray, m: FloatArray, zero: FloatArray) -> FloatArray:
    """(n, n - r) basis of the motions x with R^T M x = 0 of rigid motions (n, r), orthonormal where every coordinate is
    measured by its own stiffness: else the stiff ones would leave their round-off to the soft ones."""
    stiff, heavy = abs(np.diagonal(k)), abs(np.diagonal(m))
    ratio = np.divide(stiff, heavy, out=np.zeros_like(stiff), where=heavy > 0)
    typical = float(np.median(ratio[ratio > 0])) if (ratio > 0).any() else 1.0
    size = stiff + SOFT * typical * heavy
    d = 1 / np.sqrt(np.where(size > 0, size, size.max(initial=0.0) or 1.0))
    return np.asarray(d[:, None] * la.qr(d[:, None] * (m @ zero))[0][:, zero.shape[1] :])


def dense_lowest(
    factor: Factor, stiffness: Any, mass: Any, max_omega2: float | None, n_modes: int | None
) -> tuple[Eigenpairs, float]:
    """The modes of a small held problem with w^2 <= max_omega2, or the first n_modes, or fewer where both are given; and the
    w^2 of the next one, infinite where there is none. factor: of the stiffness."""
    if isinstance(factor, BandedFactor) and (found := all_modes(factor, mass)) is not None:
        omega2, vectors = found
        keep = _inside(omega2, max_omega2, n_modes)
        if keep < omega2.size:
            x = shapes(factor, mass, vectors[:, :keep])
            return Eigenpairs(omega2[:keep], x, 0, residuals(stiffness, mass, omega2[:keep], x), True), float(omega2[keep])
    every = dense_eigenpairs(stiffness, mass, np.zeros((mass.shape[0], 0)))
    keep = _inside(every.omega2, max_omega2, n_modes)
    following = float(every.omega2[keep]) if keep < every.omega2.size else np.inf
    return Eigenpairs(every.omega2[:keep], every.vectors[:, :keep], 0, every.residuals[:keep], True), following


def _inside(omega2: FloatArray, limit: float | None, n_modes: int | None) -> int:
    """How many of (k,) ascending w^2 are wanted."""
    below = omega2.size if limit is None else int(np.count_nonzero(omega2 <= limit))
    return below if n_modes is None else min(below, n_modes)


def sparse_eigenpairs(
    stiffness: Any,
    mass: Any,
    rigid: FloatArray,
    *,
    n_modes: int | None,
    max_omega2: float | None,
    verify_count: bool | None = None,
    progress: Progress | None = None,
) -> Eigenpairs:
    """The lowest modes of a large sparse problem by block Lanczos on one factor: `rigid`, then the first `n_modes` elastic
    ones, or all with w^2 <= max_omega2, or fewer where both are given. Rigid motions (n, r) of K are deflated.

    Modes below `max_omega2` are counted beforehand by Sylvester's law (negative pivots of K - max_omega2 M), so that none is
    missing; the first n_modes are counted afterwards (verify_count as in `shift_invert`); `proved` says whether the backend
    could. A small negative shift keeps K - s M definite for free-free models.
    """
    k, m = sp.csc_array(stiffness), sp.csr_array(mass)
    _refuse_indefinite(m)
    zero = orthonormalize(rigid, m)
    analysis = analyze(k - m)
    refuse_above(analysis.estimate, None)
    problem = Pencil(k, m, analysis, known=zero.shape[1])
    count = None if max_omega2 is None else problem.count_below(max_omega2)
    shift = -_small_shift(k, m)
    factor = analysis.factorize(sp.csc_array(k - shift * m))
    wanted = Wanted(n_modes, max_omega2, None if count is None else max(count, 0))
    found = shift_invert(factor, problem, wanted, shift=shift, rigid=zero, verify_count=verify_count, progress=progress)
    omega2, vectors = np.r_[np.zeros(zero.shape[1]), found.omega2], np.hstack([zero, found.vectors])
    rest = residuals(k, m, omega2[: zero.shape[1]], zero, zero.shape[1])
    return Eigenpairs(omega2, vectors, zero.shape[1], np.r_[rest, found.residuals], found.proved)


@dataclass(frozen=True, eq=False)
class Pencil:
    """K and M of K x = w^2 M x, and the symbolic analysis of K - s M; known: modes that are deflated, not counted."""

    stiffness: Any
    mass: Any
    analysis: Analysis
    known: int = 0

    def count_below(self, omega2: float) -> int | None:
        """How many w^2 lie below, besides the known ones; None where the backend cannot tell."""
        count = count_below(self.stiffness, self.mass, omega2, self.analysis)
        return None if count is None else count - self.known


@dataclass(frozen=True)
class Wanted:
    """The first n_modes, or all with w^2 <= max_omega2, or fewer where both are given; count: how many the latter are."""

    n_modes: int | None
    max_omega2: float | None
    count: int | None = None


def shift_invert(
    factor: Factor,
    problem: Pencil,
    wanted: Wanted,
    *,
    shift: float = 0.0,
    rigid: FloatArray | None = None,
    memory_limit: float = BASIS_BYTES,
    verify_count: bool | None = None,
    progress: Progress | None = None,
) -> Eigenpairs:
    """The elastic modes `wanted`, from the factor of K - shift M; rigid (n, r) mass-orthonormal motions are deflated.

    Without a count the number of modes is doubled until one lies above the limit. A mode repeated more often than a block is
    wide can be missed. So modes are compared with a count: of all below the limit where `wanted` has one, else of those below
    the last group of equal ones, which takes one more factorisation (verify_count: True always, False never, None where it
    is cheap beside the solutions). Where fewer were found wider blocks try again, up to that count; then SolverError follows.
    """
    block = BLOCK if factor.fill < DENSE_FACTOR * problem.mass.shape[0] else 2 * BLOCK
    widest = WIDER * block
    while True:
        found, columns = _searched(factor, problem, wanted, block, shift, rigid, memory_limit, progress)
        expected, limit = _expected(factor, problem, wanted, found, columns, verify_count, abs(shift))
        have = int(np.count_nonzero(found.omega2 <= limit))
        if expected is None or have == expected:
            rest = residuals(problem.stiffness, problem.mass, found.omega2, found.vectors)
            return Eigenpairs(found.omega2, found.vectors, 0, rest, expected is not None)
        if block >= (widest if have > expected else max(widest, expected)):  # a wider block never finds fewer modes
            raise SolverError(f"{expected} modes lie below the limit, but only {have} were found; change the limit")
        block = widest if block < widest else min(2 * block, expected)


def _searched(
    factor: Factor,
    problem: Pencil,
    wanted: Wanted,
    block: int,
    shift: float,
    rigid: FloatArray | None,
    memory_limit: float,
    progress: Progress | None,
) -> tuple[LanczosPairs, int]:
    """Modes inside the limit, and how many columns were solved for."""
    limit, n = wanted.max_omega2, problem.mass.shape[0]
    ask = min(x for x in (wanted.n_modes, wanted.count, n) if x is not None)
    if wanted.n_modes is None and wanted.count is None:
        ask = min(FIRST_GUESS, n)
    options: dict[str, Any] = {"block": block, "shift": shift, "below": factor.negative_pivots or 0, "locked": rigid}
    columns = 0
    while True:
        fits = ask > 0 and rigid is None and block == BLOCK and 16.0 * n * n <= memory_limit
        found = short_lanczos(factor, problem.mass, ask, progress) if fits and isinstance(factor, BandedFactor) else None
        if found is None:
            found = lanczos(factor.solve, problem.mass, ask, memory_limit=memory_limit, progress=progress, **options)
        columns += block * (found.blocks + 1)
        inside = np.ones(found.omega2.size, dtype=bool) if limit is None else found.omega2 <= limit * (1 + 1e-9)
        if limit is None or wanted.count is not None or wanted.n_modes == ask or not inside.all() or found.exhausted:
            return replace(found, omega2=found.omega2[inside], vectors=found.vectors[:, inside]), columns
        ask = min(2 * ask, n)


def _expected(
    factor: Factor,
    problem: Pencil,
    wanted: Wanted,
    found: LanczosPairs,
    columns: int,
    verify_count: bool | None,
    noise: float,
) -> tuple[int | None, float]:
    """How many modes there are below a limit, None where that is not counted; and the limit.

    noise: w^2 up to which modes may be rigid-body motions, whose order is round-off: nothing is counted among them.
    """
    if wanted.count is not None and (wanted.n_modes is None or wanted.count <= wanted.n_modes):
        return wanted.count, np.inf
    wish = is_cheap(problem.analysis.estimate, factor, columns) if verify_count is None else verify_count
    if not wish or not found.omega2.size or found.omega2[-1] <= noise:
        return None, np.inf
    limit = gap_below_last(found.omega2)
    return (problem.count_below(limit), limit) if limit > noise else (None, np.inf)


def _refuse_indefinite(mass: Any) -> None:
    """SolverError where inertia shows a mass clearly below zero: Lanczos would return numbers that mean nothing."""
    diagonal = abs(mass.diagonal())
    size = np.where(diagonal > 0, diagonal, np.max(diagonal, initial=0.0) or 1.0)
    negative = factorize(sp.csc_array(mass + sp.diags_array(ROUNDED * size))).negative_pivots
    if negative:
        raise SolverError(indefinite(f"{negative} negative eigenvalues"))


def _small_shift(k: Any, m: Any) -> float:
    """A shift far below the first elastic mode: 1e-10 of all k_ii over all m_ii, (rad/s)^2. That is what round-off of K leaves to
    a rigid-body motion, times 1e6; a ratio of single DOF has no bound where one has hardly any mass."""
    stiff, heavy = (float(abs(matrix.diagonal()).sum()) for matrix in (k, m))
    return 1e-10 * stiff / heavy if stiff > 0 and heavy > 0 else 1e-20
