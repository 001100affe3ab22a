"""Block shift-invert Lanczos for  K x = w^2 M x  on one factor, with a semidefinite mass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from flexplant.errors import SolverError
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.numerics.krylov import Krylov, norms
from flexplant.numerics.products import product

Progress: TypeAlias = Callable[[str, float], None]
SEED = 20190811
BLOCK = 8  # a block of 8 columns takes little more time to solve than one
TOLERANCE = 1e-8  # of a Ritz value of the inverse: eigenvalues then are exact to round-off
BASIS_BYTES = 4e9  # the basis never takes more; beyond that Lanczos restarts thickly
FIRST_TEST = 6  # blocks, and two columns a wanted mode: no basis has been seen to converge before
CHEAP_BLOCK = 5000  # unknowns below which two blocks cost less than such a test
NEXT_TEST = 0.5  # of the blocks after which the decay seen so far would meet the tolerance
MAX_RESTARTS = 60


@dataclass(frozen=True, eq=False)
class LanczosPairs:
    """omega2 (k,) ascending, vectors (n, k) mass-normalised; blocks and restarts it took.

    residuals (k,): |B s| / |theta| of each Ritz pair, what the recurrence knows of |OP x - theta x| / |theta x| in the mass
    norm; the vectors returned are better by one application of the operator.
    exhausted: the space closed, so the problem has no finite modes besides these (and the locked ones).
    """

    omega2: FloatArray
    vectors: FloatArray
    residuals: FloatArray
    blocks: int
    restarts: int
    exhausted: bool


def lanczos(
    solve: Callable[[FloatArray], FloatArray],
    mass: Any,
    n_modes: int,
    *,
    shift: float = 0.0,
    below: int = 0,
    locked: FloatArray | None = None,
    block: int = BLOCK,
    tolerance: float = TOLERANCE,
    memory_limit: float = BASIS_BYTES,
    progress: Progress | None = None,
) -> LanczosPairs:
    """The `n_modes` lowest modes of K x = w^2 M x, from solve(b) = (K - shift M)^-1 b with (n, k) columns.

    OP = (K - s M)^-1 M has the eigenvalues theta = 1 / (w^2 - s). below: how many w^2 lie under the shift (the factor's
    negative pivots). locked: (n, r) mass-orthonormal motions to deflate, for example rigid-body modes; not counted and not
    returned. Runs until every wanted |B s| <= tolerance * |theta|. memory_limit: bytes of the basis, beyond which it is
    restarted. progress("modes", share): called after each test; what it raises ends the solution cleanly. Deterministic.
    Raises SolverError where the modes do not converge.
    Sources: Grimes, Lewis and Simon 1994; Nour-Omid, Parlett, Ericsson and Jensen 1987; Wu and Simon 2000.
    """
    n = mass.shape[0]
    locked = np.zeros((n, 0)) if locked is None else locked
    capacity = _capacity(n, n_modes, block, memory_limit)
    space = Krylov(solve, mass, locked, capacity, block, SEED)
    blocks = restarts = 0
    test = _Schedule(2 * n_modes + FIRST_TEST * block, block if n >= CHEAP_BLOCK else 2 * block, tolerance)
    while space.size > space.last:
        if not space.room:
            restarts += 1
            _restart(space, n_modes, below, restarts)
        space.step()
        blocks += 1
        if not test.due(space.last - space.locked) and not space.exhausted and space.room:
            continue
        theta, s, residual = space.ritz()
        pick = _wanted(theta, n_modes, below)
        error = residual[pick] / abs(theta[pick])
        if progress is not None:
            progress("modes", float(np.count_nonzero(error <= tolerance)) / max(n_modes, 1))
        if pick.size == n_modes and (error <= tolerance).all():
            break
        test.failed(space.last - space.locked, float(error.max(initial=0.0)) if pick.size == n_modes else 1.0)
    else:
        theta, s, residual = space.ritz()
        pick = _wanted(theta, n_modes, below)
    theta, s, closed = theta[pick], s[:, pick], space.exhausted and space.size == space.last
    vectors = space.vectors(theta, s)
    for start in range(0, vectors.shape[1], block):
        some = vectors[:, start : start + block]
        some /= norms(some, product(mass, some))
    return LanczosPairs(shift + 1 / theta, vectors, residual[pick] / abs(theta), blocks, restarts, closed)


class _Schedule:
    """When a test for convergence, a dense eigenproblem of the basis, is worth its time."""

    def __init__(self, first: int, block: int, tolerance: float) -> None:
        self.next, self.block, self.tolerance = first, block, tolerance
        self.seen: tuple[int, float] | None = None

    def due(self, used: int) -> bool:
        """Whether a basis of `used` columns should be tested."""
        return used >= self.next

    def failed(self, used: int, error: float) -> None:
        """Test again when the worst error, if it keeps falling as it did since the last test, is close to the tolerance."""
        wait = 0.0
        if self.seen is not None and used > self.seen[0] and 0 < error < self.seen[1]:
            rate = np.log(self.seen[1] / error) / (used - self.seen[0])
            wait = NEXT_TEST * float(np.log(error / self.tolerance)) / rate
        self.seen = (used, error)
        self.next = used + self.block * int(np.clip(wait // self.block, 1, max(1, used // (2 * self.block))))


def _capacity(n: int, n_modes: int, block: int, memory_limit: float) -> int:
    """Columns of the basis; pages that are never touched cost nothing."""
    least = n_modes + 6 * block
    return min(max(least, min(6 * n_modes + 20 * block, int(memory_limit / (8 * n)))), n + 2 * block)


def _wanted(theta: FloatArray, n_modes: int, below: int) -> IntArray:
    """Places of the lowest w^2 = s + 1 / theta, ascending: the negative theta, then the largest positive ones."""
    negative = np.argsort(theta)[: min(below, np.count_nonzero(theta < 0))]
    negative = negative[np.argsort(-theta[negative])]
    positive = np.argsort(-theta)[: np.count_nonzero(theta > 0)]
    return np.asarray(np.r_[negative, positive][:n_modes], dtype=np.int64)


def _restart(space: Krylov, n_modes: int, below: int, restarts: int) -> None:
    theta, s, _ = space.ritz()
    if restarts > MAX_RESTARTS:
        raise SolverError(
            f"the eigensolver did not find {n_modes} modes in {restarts} restarts; ask for fewer modes or raise memory"
        )
    width = space.basis.shape[1] - space.locked
    keep = min(n_modes + (width - n_modes) // 2, theta.size, width - 3 * space.block)
    pick = _wanted(theta, keep, below)
    space.restart(theta[pick], s[:, pick])
