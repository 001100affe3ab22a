"""Sparse symmetric factorisations behind one interface: analyse, estimate, factor once, solve many."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from flexplant.errors import InputError, SolverError, expect_count, nearest
from flexplant.model.arrays import is_number
from flexplant.numerics.factorization import (
    banded_backend,
    cholmod_backend,
    pardiso_backend,
    rslab_backend,
    superlu_backend,
    supernodal_backend,
)
from flexplant.numerics.factorization.banded_backend import BandedFactor
from flexplant.numerics.factorization.protocol import Analysis, Estimate, Factor

__all__ = [
    "BACKENDS",
    "Analysis",
    "BandedFactor",
    "Estimate",
    "Factor",
    "analyze",
    "factorize",
    "installed_memory",
    "refuse_above",
]

BACKENDS: dict[str, Callable[..., Analysis]] = {
    "rslab": rslab_backend.analyze,
    "superlu": superlu_backend.analyze,
    "pardiso": pardiso_backend.analyze,
    "cholmod": cholmod_backend.analyze,
    "banded": banded_backend.analyze,
    "supernodal": supernodal_backend.analyze,
}
LARGE = 20_000  # unknowns from which "supernodal" repays the compilation of its loops, once on a machine


def analyze(matrix: Any, *, backend: str | None = None, threads: int | None = None, definite: bool = False) -> Analysis:
    """Symbolic analysis of a sparse symmetric matrix (n, n): its cost estimate, and factors of any matrix of its pattern.

    backend: "rslab" (L D L^T; the default where it is installed), "superlu" (LU in symmetric mode, always there), "pardiso"
    (MKL's, extra `mkl`), "cholmod" (real matrices only, GPL, extra `cholmod`), "banded" (dense blocks along the diagonal of
    a small real matrix; always there) or "supernodal" (Cholesky, needs numba; what is not definite goes to the default).
    definite: the matrix is expected to be positive definite; a large one then goes to "supernodal" by default, which solves
    many columns in about half the time, unless several `threads` are asked for.
    threads: workers, None for the backend's own choice. Raises InputError for an unknown backend, MissingExtraError for one
    that is not installed.
    """
    if backend is None:
        suits = definite and matrix.shape[0] >= LARGE and threads in (None, 1) and supernodal_backend.available()
        backend = "supernodal" if suits else "rslab" if rslab_backend.available() else "superlu"
    if threads is not None:
        expect_count(threads, "threads")
    if not isinstance(backend, str) or backend not in BACKENDS:
        raise InputError(f"unknown factorization backend {backend!r}." + nearest(str(backend), BACKENDS))
    return BACKENDS[backend](matrix, threads=threads)


def factorize(
    matrix: Any, *, backend: str | None = None, threads: int | None = None, memory_limit: float | None = None
) -> Factor:
    """Factor a sparse symmetric matrix (n, n), real or complex-symmetric; arguments as in `analyze`.

    memory_limit: bytes that the peak of the factorisation may take, by default the machine's installed memory.
    Raises SolverError, before any numeric work, where the estimate exceeds the limit; and where the matrix is singular.
    """
    analysis = analyze(matrix, backend=backend, threads=threads)
    refuse_above(analysis.estimate, memory_limit)
    return analysis.factorize(matrix)


def refuse_above(estimate: Estimate | None, memory_limit: float | None, besides: float = 0.0) -> None:
    """SolverError with the estimate where a factorisation and `besides` bytes do not fit in `memory_limit` bytes."""
    if memory_limit is not None and not (is_number(memory_limit) and memory_limit > 0):
        raise InputError(f"memory_limit must be a positive number of bytes, or None, got {memory_limit!r:.60}")
    limit = installed_memory() if memory_limit is None else memory_limit
    if estimate is None or limit is None or estimate.peak_bytes + besides <= limit:
        return
    extra = f", and {besides / 1e9:.2f} GB for vectors" if besides else ""
    raise SolverError(
        f"the factorisation would need {estimate}{extra}, but {limit / 1e9:.2f} GB are allowed; "
        "reduce the model in parts, use a machine with more memory, or raise memory_limit"
    )


def installed_memory() -> float | None:
    """Bytes of physical memory, None where the system does not say."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None
