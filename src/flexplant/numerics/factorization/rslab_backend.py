"""Supernodal L D L^T by rslab: real and complex-symmetric, with inertia."""

from __future__ import annotations

import importlib.util
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import MissingExtraError, SolverError
from flexplant.numerics.factorization.protocol import Estimate

DISSECTION = 2500  # predicted flops per entry and assumed worker from which nested dissection repays its own time
INTERRUPTIBLE = 20_000  # unknowns from which a factorisation is long enough to be worth a watched thread
NEVER = 10**15


def available() -> bool:
    """True where rslab is installed."""
    return importlib.util.find_spec("rslab") is not None


@dataclass(frozen=True, eq=False)
class RslabFactor:
    """See `Factor`."""

    handle: Any
    complex: bool
    backend: str = "rslab"

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of a real matrix."""
        return None if self.complex else int(self.handle.inertia[1])

    @property
    def fill(self) -> int:
        """Entries of L."""
        return int(self.handle.factor_nnz)

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        b = np.asarray(right_side, dtype=complex if self.complex else float)
        if not b.size:
            return b.copy()  # no columns: what a basis that is complete already leaves to solve
        return self.handle.solve(np.ascontiguousarray(b)) if b.ndim == 1 else self.handle.solve_many(np.ascontiguousarray(b))


@dataclass(frozen=True, eq=False)
class RslabAnalysis:
    """See `Analysis`."""

    symbolic: Any
    threads: int | None
    dtype: str
    columns: int = 8

    @cached_property
    def estimate(self) -> Estimate:
        """Cost of a factorisation and of solutions with a few columns."""
        plan = self.symbolic.memory_plan(dtype=self.dtype, nrhs=self.columns)
        flops = self.symbolic.estimate_memory(self.dtype)["factor_flops"]
        return Estimate(int(self.symbolic.factor_nnz), int(plan["factor_bytes"]), int(plan["peak_bytes"]), float(flops))

    def factorize(self, matrix: Any) -> RslabFactor:
        """Factor a matrix; one of another pattern is analysed anew."""
        csc = sp.csc_matrix(matrix)
        try:
            handle = _factor(self.symbolic, csc, self.threads)
        except ValueError:  # rslab's word for another pattern
            handle = _factor(analyze(csc, threads=self.threads).symbolic, csc, self.threads)
        except RuntimeError as error:
            raise SolverError(f"the matrix {matrix.shape} is singular ({error}); shift it or remove mechanisms") from None
        return RslabFactor(handle, np.iscomplexobj(csc.data))


def analyze(matrix: Any, *, threads: int | None = None) -> RslabAnalysis:
    """Order and analyse; nested dissection only where a quick minimum-fill ordering predicts enough work to repay it."""
    try:
        import rslab
    except ImportError:
        raise MissingExtraError("rslab", "fast") from None
    csc = sp.csc_matrix(matrix)
    race = {"race_candidates": ["amf"], "race_eager_nd_min_nnz": NEVER, "race_nd_min_work": max(1, DISSECTION * csc.nnz)}
    symbolic = rslab.analyze(csc, path="ldlt", threads=threads, **race)
    return RslabAnalysis(symbolic, threads, "complex128" if np.iscomplexobj(csc.data) else "float64")


def _factor(symbolic: Any, matrix: Any, threads: int | None) -> Any:
    """The numeric part; a keyboard interrupt stops a long one at its next panel."""
    if matrix.shape[0] < INTERRUPTIBLE:
        return symbolic.factor(matrix, threads=threads)
    import rslab

    stop = rslab.Interrupt()
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(symbolic.factor, matrix, threads=threads, interrupt=stop)
        try:
            return future.result()
        finally:
            stop.cancel()
