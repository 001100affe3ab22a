"""Modes of small held models in the standard form C = L^-1 M L^-T of a Cholesky factor K = L L^T: theta = 1 / w^2.

The mass may be singular: massless motions are C's null space. Products with C take two half solutions and no mass norms, so
that Lanczos spends its time in BLAS. What does not suit these short ways (a basis that loses its digits, a space that closes,
a mass that is indefinite) is left to the general ones: None comes back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg.blas import dgemm, dtrsm
from scipy.linalg.lapack import dpotrf

from flexplant.model.arrays import FloatArray, dense
from flexplant.numerics.factorization import BandedFactor
from flexplant.numerics.lanczos import BLOCK, SEED, LanczosPairs, Progress

SURE = 1e-9  # of the largest theta: what is larger is neither round-off nor a massless motion
NEGATIVE = 1e-10  # of it: a theta below minus that shows an indefinite mass
CLEAN = 1e-4  # of a block before it was made orthogonal: what is left below that is worth a second time
SKEW = 1e-2  # smallest to largest pivot of a block's Gram matrix' root, above which one pass makes it orthonormal
LOST = 1e-10  # of a block before: what is left below that is round-off
TOLERANCE = 2e-9  # of a Ritz value of C: residuals then are about 1e-9
NARROW, CACHED = 4, 300_000  # columns of a block, fewer of which are needed the narrower it is, and entries of a factor that
# a processor keeps at hand, so that a product with few columns costs less than one with more
FIRST_TEST = {NARROW: (7, 18), BLOCK: (4, 14)}  # blocks besides two columns a mode to the first test, and at most
DECAY = 1.4  # of the error's logarithm with every block: when to test again, for each test is an eigenproblem of the basis
MODES_A_BLOCK = 3  # wanted, up to so many
LONGEST = 3  # times the columns at the first test: what has not converged by then is another kind of problem
DENSE_ROWS, DENSE_SHARE = 150, 3  # dense up to so many unknowns, and so many more a mode: what Lanczos takes for them costs more


def is_dense(n: int, n_modes: int) -> bool:
    """Whether all modes of n unknowns cost less than `n_modes` by Lanczos."""
    return n <= DENSE_ROWS + DENSE_SHARE * n_modes


def all_modes(factor: BandedFactor, mass: Any) -> tuple[FloatArray, FloatArray] | None:
    """w^2 (k,), ascending, and vectors Y (n, k) of C, of all modes that the stiffest and the massless ones do not blur.

    The round-off of an eigensolver is relative to the largest theta, so it spares the lowest w^2. None where the mass is
    indefinite.
    """
    half = factor.forward(dense(mass))
    theta, vectors = np.linalg.eigh(factor.forward(half.T))
    if theta[0] < -NEGATIVE * theta[-1]:
        return None
    sure = np.count_nonzero(theta > SURE * theta[-1])
    return 1 / theta[: -sure - 1 : -1], vectors[:, : -sure - 1 : -1]


def shapes(factor: BandedFactor, mass: Any, vectors: FloatArray) -> FloatArray:
    """Mass-normalised x = L^-T y."""
    x = factor.backward(vectors)
    return np.asarray(x / np.sqrt(np.einsum("ij,ij->j", x, np.asarray(mass @ x))))


@dataclass(frozen=True, eq=False)
class ShortKrylov:
    """theta (k,) descending and vectors Y (n, k) of C, not normalised; residuals (k,) relative to theta before the last, implicit
    application of C; columns that took."""

    theta: FloatArray
    vectors: FloatArray
    residuals: FloatArray
    columns: int


def short_lanczos(factor: BandedFactor, mass: Any, n_modes: int, progress: Progress | None = None) -> LanczosPairs | None:
    """The `n_modes` lowest modes from `short_krylov`, as `lanczos` gives them."""
    found = short_krylov(factor, mass, n_modes, progress, block=width(factor))
    if found is None:
        return None
    x = shapes(factor, mass, found.vectors)
    return LanczosPairs(1 / found.theta, x, found.residuals, found.columns // BLOCK, 0, exhausted=False)


def width(factor: BandedFactor) -> int:
    """Columns of a block that suit a factor's size."""
    return NARROW if factor.fill <= CACHED else BLOCK


def short_krylov(
    factor: BandedFactor, mass: Any, n_modes: int, progress: Progress | None = None, *, block: int
) -> ShortKrylov | None:
    """The `n_modes` largest theta by block Lanczos on C, unrestarted, orthogonal to all before.

    None where the general `lanczos` should be asked. Source: Golub and Underwood 1977.
    """
    n = mass.shape[0]
    least, most = FIRST_TEST[NARROW if block <= NARROW else BLOCK]
    test = 2 * n_modes + min(least + n_modes // MODES_A_BLOCK, most) * block
    most = min(n, LONGEST * test)
    basis = np.empty((n, most + block), order="F")
    projection = np.zeros((most, most))
    start = factor.forward(mass @ factor.backward(np.random.default_rng(SEED).standard_normal((n, block))))
    basis[:, :block] = np.linalg.qr(start)[0]
    used = 0
    while used + 2 * block <= most:
        new = slice(used, used + block)
        image = factor.forward(mass @ factor.backward(basis[:, new]))
        used += block
        share, rest, coupling = _orthogonal(basis[:, :used], np.asfortranarray(image))
        projection[used - share.shape[0] : used, new] = share
        if rest is None:
            return None
        basis[:, used : used + block] = rest
        if used < test:
            continue
        theta, s = np.linalg.eigh(projection[:used, :used], UPLO="U")
        theta, s = theta[: -n_modes - 1 : -1], s[:, : -n_modes - 1 : -1]
        if theta[-1] <= SURE * theta[0]:
            return None
        error = np.linalg.norm(coupling @ s[-block:], axis=0) / theta
        if progress is not None:
            progress("modes", float(np.count_nonzero(error <= TOLERANCE)) / n_modes)
        worst = float(error.max())
        if worst <= TOLERANCE:
            tail = coupling @ s[-block:] / theta  # one more, implicit, application of C
            vectors = dgemm(1.0, basis[:, : used + block], np.vstack([s, tail]))
            return ShortKrylov(theta, vectors, error, used)
        test = used + block * min(int(np.log(worst / TOLERANCE) / DECAY), used // (4 * block))
    return None


def _orthogonal(basis: FloatArray, image: FloatArray) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """H = U^T W of the last two blocks U of V, and Q B = W - U H with Q^T [V, Q] = [0, I].

    The recurrence says that W has no other part in V, so what is taken out of all of V is round-off: first U's part, or an
    error of V's orthogonality would grow with every block. None for Q where W adds less than a block to V.
    """
    local = basis[:, -2 * image.shape[1] :]
    share = dgemm(1.0, local, image, trans_a=True)
    rest = _purged(dgemm(-1.0, local, share, beta=1.0, c=image, overwrite_c=True), basis)
    coupling: FloatArray | None = None
    largest = float(np.sqrt(np.vdot(share, share)))
    for _ in range(3):
        triangle, failed = dpotrf(dgemm(1.0, rest, rest, trans_a=True))
        pivots = triangle.diagonal().tolist()  # so few numbers are compared faster one by one
        if failed or min(pivots) <= LOST * largest:
            return share, None, triangle
        rest = dtrsm(1.0, triangle, rest, side=1, overwrite_b=True)
        coupling = triangle if coupling is None else triangle @ coupling
        if min(pivots) > max(CLEAN * largest, SKEW * max(pivots)):
            break
        rest, largest = _purged(rest, basis), 1.0
    return share, rest, np.asarray(coupling)


def _purged(block: FloatArray, basis: FloatArray) -> FloatArray:
    return np.asarray(dgemm(-1.0, basis, basis.T @ block, beta=1.0, c=block, overwrite_c=True))
