"""MKL PARDISO through ctypes: L L^T or L D L^T of the upper triangle, real and complex-symmetric, with inertia."""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib.metadata
import weakref
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from flexplant.errors import MissingExtraError, SolverError
from flexplant.numerics.factorization.protocol import Estimate

POSITIVE, INDEFINITE, COMPLEX = 2, -2, 6  # PARDISO's matrix types; 11, which wrappers take by default, would fill twice as much
ANALYSE, FACTOR, SOLVE, RELEASE = 11, 22, 33, -1
NOT_POSITIVE = -4  # zero or negative pivot
WORDS = {
    -1: "input inconsistent",
    -2: "not enough memory",
    -3: "reordering failed",
    -4: "zero pivot",
    -7: "diagonal matrix problem",
}
# places in iparm, counted from 0
GIVEN, PERMUTATION, PIVOTING, PERTURBED, ENTRIES, FLOPS, NEGATIVE, ZERO_BASED = 0, 4, 9, 13, 17, 18, 22, 34
SYMBOLIC_PEAK_KB, SYMBOLIC_KB, NUMERIC_KB = 14, 15, 16


@cache
def _library() -> Any:
    """libmkl_rt, None where it is not installed."""
    names = []
    try:
        files = importlib.metadata.files("mkl") or []
        names = [str(f.locate()) for f in files if "mkl_rt" in f.name]
    except importlib.metadata.PackageNotFoundError:
        pass
    for name in [*names, ctypes.util.find_library("mkl_rt")]:
        try:
            if name:
                return ctypes.CDLL(name)
        except OSError:  # another architecture's, or without its OpenMP run-time
            continue
    return None


def available() -> bool:
    """True where MKL is installed."""
    return _library() is not None


@dataclass(eq=False)
class _Handle:
    """One PARDISO problem: the upper triangle (CSR, every diagonal entry stored), its type, and PARDISO's own memory."""

    upper: Any
    kind: int
    threads: int | None
    permutation: Any = None
    pt: Any = field(default_factory=lambda: np.zeros(64, dtype=np.int64))
    iparm: Any = field(default_factory=lambda: np.zeros(64, dtype=np.int64))

    def __post_init__(self) -> None:
        given = self.permutation is not None
        self.permutation = self.permutation if given else np.zeros(self.n, dtype=np.int64)
        self.iparm[[GIVEN, 1, ZERO_BASED]] = 1, 2, 1  # nested dissection, indices from 0
        self.iparm[PERMUTATION] = 1 if given else 2  # take it, or hand it out
        self.iparm[[ENTRIES, FLOPS]] = -1
        self.iparm[PIVOTING] = 13 if self.kind == COMPLEX else 8
        weakref.finalize(self, _release, self.pt, self.kind, self.n)
        self.call(ANALYSE)

    @property
    def n(self) -> int:
        return int(self.upper.shape[0])

    def call(self, phase: int, right_side: Any = None) -> Any:
        """Run a phase; SolverError with PARDISO's word for what went wrong."""
        error = _pardiso(phase, self, right_side, x := None if right_side is None else np.empty_like(right_side))
        if error:
            raise _PardisoError(error, self.upper.shape)
        return x


class _PardisoError(SolverError):
    def __init__(self, code: int, shape: tuple[int, int]) -> None:
        super().__init__(f"PARDISO failed on the matrix {shape}: {WORDS.get(code, f'error {code}')}; shift it, or use rslab")
        self.code = code


def _pointer(array: Any) -> Any:
    return None if array is None else array.ctypes.data_as(ctypes.c_void_p)


def _pardiso(phase: int, handle: _Handle, b: Any, x: Any) -> int:
    mkl = _library()
    error = ctypes.c_int64(0)
    one, silent = ctypes.c_int64(1), ctypes.c_int64(0)
    numbers = [ctypes.c_int64(v) for v in (handle.kind, phase, handle.n, 1 if b is None or b.ndim == 1 else b.shape[1])]
    before = mkl.MKL_Set_Num_Threads_Local(ctypes.c_int(handle.threads or 0))  # 0: as many as MKL likes; this thread only
    try:
        mkl.pardiso_64(
            _pointer(handle.pt), ctypes.byref(one), ctypes.byref(one), *map(ctypes.byref, numbers[:3]),
            _pointer(handle.upper.data), _pointer(handle.upper.indptr), _pointer(handle.upper.indices),
            _pointer(handle.permutation), ctypes.byref(numbers[3]), _pointer(handle.iparm), ctypes.byref(silent),
            _pointer(b), _pointer(x), ctypes.byref(error),
        )  # fmt: skip
    finally:
        mkl.MKL_Set_Num_Threads_Local(ctypes.c_int(before))
    return int(error.value)


def _release(pt: npt.NDArray[np.int64], kind: int, n: int) -> None:
    one, zero, phase = ctypes.c_int64(1), ctypes.c_int64(0), ctypes.c_int64(RELEASE)
    numbers = [ctypes.byref(x) for x in (one, one, ctypes.c_int64(kind), phase, ctypes.c_int64(n))]
    iparm, ends = np.zeros(64, dtype=np.int64), (ctypes.byref(zero), None, None, ctypes.byref(ctypes.c_int64(0)))
    _library().pardiso_64(_pointer(pt), *numbers, None, None, None, None, ctypes.byref(one), _pointer(iparm), *ends)


@dataclass(frozen=True, eq=False)
class PardisoFactor:
    """See `Factor`."""

    handle: _Handle
    backend: str = "pardiso"

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of a real matrix: none of a positive definite one, else PARDISO's own count."""
        return {POSITIVE: 0, INDEFINITE: int(self.handle.iparm[NEGATIVE])}.get(self.handle.kind)

    @property
    def fill(self) -> int:
        """Entries of L."""
        return int(self.handle.iparm[ENTRIES])

    def solve(self, right_side: Any) -> Any:
        """x with A x = right_side, (n,) or (n, k)."""
        b = np.array(right_side, dtype=self.handle.upper.dtype, order="F")
        return self.handle.call(SOLVE, b) if b.size else b


@dataclass(frozen=True, eq=False)
class PardisoAnalysis:
    """See `Analysis`. The ordering serves every factor; PARDISO keeps one factor a problem, so each has its own."""

    fresh: list[_Handle]
    permutation: Any
    pattern: Any
    threads: int | None
    iparm: Any

    @cached_property
    def estimate(self) -> Estimate:
        """Cost of a factorisation, from PARDISO's symbolic phase."""
        size = 16 if self.pattern.dtype == complex else 8
        fill, kilobytes = int(self.iparm[ENTRIES]), self.iparm[[SYMBOLIC_PEAK_KB, SYMBOLIC_KB, NUMERIC_KB]]
        peak = 1024 * int(max(kilobytes[0], kilobytes[1] + kilobytes[2]))
        return Estimate(fill, size * fill, peak, 1e6 * float(self.iparm[FLOPS]))

    def factorize(self, matrix: Any) -> PardisoFactor:
        """Factor a matrix; one of another pattern is analysed anew. SolverError where it is singular."""
        upper = _upper(matrix)
        same = upper.dtype == self.pattern.dtype and _same_pattern(upper, self.pattern)
        if not same:
            return _analyze(upper, self.threads).factorize(matrix)
        if upper.dtype == complex:
            return _factored(self._handle(upper, COMPLEX))
        try:
            return _factored(self._handle(upper, POSITIVE))
        except _PardisoError as error:
            if error.code != NOT_POSITIVE:
                raise
            return _factored(_Handle(upper, INDEFINITE, self.threads, self.permutation))

    def _handle(self, upper: Any, kind: int) -> _Handle:
        if not self.fresh:
            return _Handle(upper, kind, self.threads, self.permutation)
        handle = self.fresh.pop()
        handle.upper = upper
        return handle


def _factored(handle: _Handle) -> PardisoFactor:
    handle.call(FACTOR)
    if handle.iparm[PERTURBED]:
        raise SolverError(
            f"the matrix {handle.upper.shape} is singular ({int(handle.iparm[PERTURBED])} pivots vanish); "
            "shift it or remove mechanisms"
        )
    return PardisoFactor(handle)


def _same_pattern(a: Any, b: Any) -> bool:
    return a.nnz == b.nnz and np.array_equal(a.indptr, b.indptr) and np.array_equal(a.indices, b.indices)


def _upper(matrix: Any) -> Any:
    """Upper triangle in CSR with 64-bit indices and every diagonal entry stored, as PARDISO wants it."""
    upper = sp.triu(sp.coo_array(matrix), format="coo")
    n = upper.shape[0]
    dtype = complex if np.iscomplexobj(upper.data) else float
    data = np.r_[upper.data, np.zeros(n)].astype(dtype)
    csr = sp.csr_array((data, (np.r_[upper.row, np.arange(n)], np.r_[upper.col, np.arange(n)])), shape=(n, n))
    csr.sum_duplicates()
    csr.indptr, csr.indices = csr.indptr.astype(np.int64), csr.indices.astype(np.int64)
    return csr


def analyze(matrix: Any, *, threads: int | None = None) -> PardisoAnalysis:
    """Order and analyse; MissingExtraError where MKL is not installed."""
    if not available():
        raise MissingExtraError("mkl", "mkl")
    return _analyze(_upper(matrix), threads)


def _analyze(upper: Any, threads: int | None) -> PardisoAnalysis:
    handle = _Handle(upper, COMPLEX if upper.dtype == complex else POSITIVE, threads)
    return PardisoAnalysis([handle], handle.permutation, upper, threads, handle.iparm.copy())
