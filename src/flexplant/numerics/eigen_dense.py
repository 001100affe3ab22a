"""The finite modes of dense  K x = w^2 M x  to round-off, from the softest to the stiffest, however nearly singular M is.

eigh(K, M) errs by eps w_max^2 in every w^2, and w_max^2 has no bound where M is nearly singular. The flexibility form
M x = mu A x, A = K + s M = L L^T positive definite, mu = 1 / (w^2 + s), errs by eps mu_max: it gives the low modes to
round-off, and massless motions as mu = 0. So the modes come in stages: those within `SPAN` of the largest mu, then, in the
same way, the next ones among what is left. Sources: Hughes 1987, chapter 10; Parlett 1998, chapters 1 and 15.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray
from flexplant.numerics.rank import EPS, jacobi_scale

SPAN = 1e-6  # of a stage's largest mu: vectors down to there are good to eps / SPAN, their Rayleigh quotients to round-off
ROUNDED = 1e-8  # of a unit diagonal: a mass more negative than that is no single-precision round-off of a vendor's matrix
NEGATIVE = 1e-6  # of the largest mu: the same, of a mass whose diagonal hides it
SINGULAR = 1e-7  # pivot of a unit diagonal, the root of what round-off leaves
SHIFTS = (0.0, *(10.0 ** np.arange(-12, 14, 2)))  # of a typical k_ii / m_ii: the first one to make K + s M definite is taken


def finite_modes(
    k: FloatArray, m: FloatArray, most: int, *, max_omega2: float = np.inf, enough: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """w^2 (c,) ascending, and mass-orthonormal vectors (n, c), of symmetric (n, n) matrices; K may be indefinite.

    most: how many modes are finite. No more stages follow once a mode lies above max_omega2, or `enough` are there.
    Raises SolverError where a motion has neither mass nor stiffness, or the mass is indefinite.
    """
    n = k.shape[0]
    most = min(most, n if enough is None else enough)
    found, omega2, rest = np.zeros((n, 0)), np.zeros(0), None
    a = _definite(k, m) if n else k
    while omega2.size < most and omega2.max(initial=-np.inf) <= max_omega2:
        if rest is None:
            mu, vectors = _flexible(a, m)
            if mu[-1] < -NEGATIVE * abs(mu[0]):
                raise SolverError(indefinite(f"x^T M x / x^T K x of a motion is {mu[-1] / mu[0]:.3g} of the lowest mode's"))
        else:
            rest = rest - found @ (found.T @ (m @ rest))
            mu, vectors = _flexible(rest.T @ a @ rest, rest.T @ m @ rest)
            vectors = rest @ vectors
        here = min(np.count_nonzero(mu > SPAN * mu[0]), most - omega2.size) if mu[0] > 0 else 0
        more = _orthonormal(vectors[:, :here], mu[:here], m)
        if not more.shape[1]:
            break  # what is left has no mass but round-off
        omega2 = np.r_[omega2, np.einsum("ij,ij->j", more, k @ more)]
        found, rest = np.hstack([found, more]), vectors[:, more.shape[1] :]
    order = np.argsort(omega2, kind="stable")
    return omega2[order], found[:, order]


def finite_count(mass: FloatArray) -> int:
    """Rank of a mass matrix (n, n): how many of its modes are finite. Eigenvalues of the unit-diagonal form up to 10 n eps
    are round-off; SolverError where one is clearly negative."""
    scale = jacobi_scale(mass)
    live = np.flatnonzero(scale)
    unit = scale[live, None] * mass[np.ix_(live, live)] * scale[live]
    if not live.size or _is_well_conditioned(unit):
        return int(live.size)
    values = la.eigvalsh(unit)
    if values[0] < -ROUNDED:
        raise SolverError(indefinite(f"smallest eigenvalue {values[0]:.3g} of a unit diagonal"))
    return int(np.count_nonzero(values > 10 * mass.shape[0] * EPS))


def indefinite(what: str) -> str:
    """The message about an indefinite mass; `what` shows it."""
    return (
        f"the mass matrix is indefinite ({what}): check the model's or components' masses, their units, and that every "
        "interface of components is coupled"
    )


def _is_well_conditioned(unit: FloatArray) -> bool:
    """Whether a condition number, estimated from the Cholesky factor, spares the eigenvalues."""
    factor, failed = la.lapack.dpotrf(unit)
    reciprocal = 0.0 if failed else float(la.lapack.dpocon(factor, np.linalg.norm(unit, 1))[0])
    return reciprocal > ROUNDED


def _definite(k: FloatArray, m: FloatArray) -> FloatArray:
    """A = K + s M, positive definite, with s = 0 or of the size of the softest, or most negative, w^2."""
    diagonal = np.diagonal(k), np.diagonal(m)
    ratio = np.divide(*diagonal, out=np.zeros(k.shape[0]), where=diagonal[1] > 0)
    typical = float(np.median(ratio[ratio > 0])) if (ratio > 0).any() else 1.0
    for shift in SHIFTS:
        a = k + shift * typical * m
        factor = _root(a)
        if factor is not None and np.diagonal(factor[0]).min() > SINGULAR:
            return np.asarray(a)
    raise SolverError("a motion has neither mass nor stiffness: couple or ground those DOF")


def _root(a: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """L and D with D A D = L L^T of unit diagonal; None where A is not definite."""
    diagonal = np.diagonal(a)
    if diagonal.min() <= 0:
        return None
    d = 1 / np.sqrt(diagonal)
    factor, failed = la.lapack.dpotrf(d[:, None] * a * d, lower=1, clean=1)
    return None if failed else (factor, d)


def _flexible(a: FloatArray, m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """mu (n,) descending and A-orthonormal vectors (n, n) of M x = mu A x."""
    root = _root(a)
    if root is None:
        raise SolverError("the modes cannot be told apart: a motion has hardly any stiffness; couple or ground those DOF")
    factor, d = root
    half = la.blas.dtrsm(1.0, factor, d[:, None] * m * d, lower=1)
    c = la.blas.dtrsm(1.0, factor, half.T, lower=1)
    mu, y = la.eigh(0.5 * (c + c.T), check_finite=False)
    return mu[::-1], d[:, None] * la.blas.dtrsm(1.0, factor, y[:, ::-1], lower=1, trans_a=1)


def _orthonormal(vectors: FloatArray, mu: FloatArray, m: FloatArray) -> FloatArray:
    """The leading vectors (n, c) made orthonormal in M: as many as have the mass mu that they should have."""
    mass = np.einsum("ij,ij->j", vectors, m @ vectors)
    sure = np.r_[mass > 0.5 * mu, False]
    unit = vectors[:, : np.argmin(sure)] / np.sqrt(mass[: np.argmin(sure)])
    factor, failed = la.lapack.dpotrf(unit.T @ (m @ unit))
    return unit[:, : failed - 1] if failed else np.asarray(la.blas.dtrsm(1.0, factor, unit, side=1))
