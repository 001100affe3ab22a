"""The lowest modes of small held models: short Lanczos, residuals and a count, with no more products than these take."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexplant.model.arrays import FloatArray
from flexplant.numerics.eigen import Eigenpairs, Pencil, Wanted
from flexplant.numerics.eigen_small import CACHED, ShortKrylov, short_krylov, width
from flexplant.numerics.factorization import BandedFactor, Factor
from flexplant.numerics.lanczos import Progress
from flexplant.numerics.sturm import gap_below_last, is_cheap

INSIDE = 1 + 1e-9  # times a limit: modes up to there count as below it
WIDENED = 3  # times a block is tried, for modes repeated more often than it is wide
SPARE = 1.25  # times the width that a count suggests


def held_modes(
    factor: Factor,
    problem: Pencil,
    wanted: Wanted,
    *,
    memory_limit: float,
    verify_count: bool | None = None,
    progress: Progress | None = None,
) -> Eigenpairs | None:
    """The modes `wanted` from a banded factor of K, as `shift_invert` would give them; None where that should be asked.

    Where all below the limit are wanted, their count is known. Else they are counted with verify_count=True, and with None
    where that takes little time. A count that is not met shows modes repeated more often than a block is wide: how often.
    """
    n, ask = problem.mass.shape[0], min((x for x in (wanted.n_modes, wanted.count) if x is not None), default=0)
    if not ask or not isinstance(factor, BandedFactor) or 16.0 * n * n > memory_limit:
        return None
    block = width(factor)
    for _ in range(WIDENED):
        found = short_krylov(factor, problem.mass, ask, progress, block=block)
        if found is None:
            return None
        expected, have = _compared(factor, problem, wanted, ask, found, verify_count)
        if expected is None or expected == have:
            x, residuals = _assessed(problem, 1 / found.theta, factor.backward(found.vectors))
            return Eigenpairs(1 / found.theta, x, 0, residuals, expected is not None)
        block = max(2 * block, int(SPARE * block * expected / max(have, 1)))
    return None


def _compared(
    factor: BandedFactor, problem: Pencil, wanted: Wanted, ask: int, found: ShortKrylov, verify_count: bool | None
) -> tuple[int | None, int]:
    """How many modes there are below a limit, None where that is not counted, and how many were found."""
    omega2 = 1 / found.theta
    if wanted.count == ask:
        inside = omega2 <= (np.inf if wanted.max_omega2 is None else wanted.max_omega2 * INSIDE)
        return ask, int(np.count_nonzero(inside))
    if not (_is_little(factor, problem, found.columns) if verify_count is None else verify_count):
        return None, 0
    limit = gap_below_last(omega2)
    return problem.count_below(limit), int(np.count_nonzero(omega2 <= limit))


def _is_little(factor: BandedFactor, problem: Pencil, columns: int) -> bool:
    """Whether a count takes little time beside all else."""
    return factor.fill <= CACHED or is_cheap(problem.analysis.estimate, factor, columns)


def _assessed(problem: Pencil, omega2: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mass-normalised shapes and their residuals, see `Eigenpairs`, from one product with each matrix."""
    inertia, force = np.asarray(problem.mass @ x), np.asarray(problem.stiffness @ x)
    size, left = _squares(force), _squares(force - inertia * omega2)
    x /= np.sqrt(np.einsum("ij,ij->j", x, inertia))
    return x, np.sqrt(left / np.maximum(size, np.finfo(float).tiny))


def _squares(block: FloatArray) -> Any:
    return np.einsum("ij,ij->j", block, block)
