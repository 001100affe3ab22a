"""Checked, read-only arrays: the one place where matrices that enter a domain type are inspected."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias, TypeGuard

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from flexplant.errors import InputError, ModelError

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
Matrix: TypeAlias = Any  # a real symmetric or rectangular matrix: (n, m) float64 ndarray or scipy.sparse CSR array

SYMMETRY_TOLERANCE = 1e-6  # relative; single-precision vendor files are symmetric to about 1e-7


def frozen(array: npt.ArrayLike, dtype: npt.DTypeLike = np.float64, *, what: str = "values") -> Any:
    """A read-only copy of `array` as floats or ints; ModelError for text, ragged lists, and numbers that would be rounded."""
    try:
        given = np.array(array)
        numbers = "biufc" if np.issubdtype(dtype, np.complexfloating) else "biuf"
        if given.size and (given.dtype.kind not in numbers or _is_truth(given)):
            raise ValueError(f"of type {given.dtype}")
        if np.issubdtype(dtype, np.integer) and given.dtype.kind == "f" and not _is_whole(given):
            raise ValueError("not whole")
        out = given.astype(dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise ModelError(f"{what}: not real numbers of one shape, or not whole where ids are needed ({error})") from None
    out.setflags(write=False)
    return out


def is_number(value: object) -> TypeGuard[float]:
    """True for one real number, Python's or numpy's, or an array of no dimensions; no truth value, no integer beyond floats."""
    if isinstance(value, np.ndarray):
        return value.shape == () and value.dtype.kind in "iuf"
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= sys.float_info.max
    return isinstance(value, (float, np.integer, np.floating))


def is_finite(value: object) -> TypeGuard[float]:
    """True for one finite real number."""
    return is_number(value) and math.isfinite(value)


def checked_switch(value: object, what: str) -> bool:
    """A truth value; InputError for anything that is merely as good as true or false, such as "no"."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{what} is True or False, got {value!r:.60}")
    return bool(value)


def real_values(values: Any, what: str) -> FloatArray:
    """`values` as floats, of any shape.

    ModelError for text, ragged lists, one truth value, and complex numbers, which a cast would halve.
    """
    try:
        given = np.asarray(values)
        if given.dtype.kind in "cSU" or _is_truth(given):
            raise ValueError(f"of type {given.dtype}")
        return given.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError) as error:
        raise ModelError(f"{what}: real numbers of one shape are needed ({error})") from None


def real_or_complex(values: Any, what: str) -> npt.NDArray[Any]:
    """`values` as an array of numbers, complex ones too; ModelError for text and ragged lists."""
    try:
        given = np.asarray(values)
        if given.dtype.kind not in "biufc":
            raise ValueError(f"of type {given.dtype}")
    except ValueError as error:
        raise ModelError(f"{what}: numbers of one shape are needed ({error})") from None
    return given


def _is_whole(given: npt.NDArray[Any]) -> bool:
    return bool(((abs(given) < 2**63) & (given == np.round(given))).all())


def _is_truth(given: npt.NDArray[Any]) -> bool:
    return given.dtype == bool and not given.shape


def items_of(values: object) -> list[Any] | None:
    """What is listed in `values` in its order; None for a text, a mapping, and for what has no items or no order."""
    nothing = isinstance(values, np.ndarray) and not values.shape
    if nothing or isinstance(values, (str, bytes, set, frozenset, Mapping)) or not isinstance(values, Iterable):
        return None
    return list(values)


def is_sparse(matrix: Any) -> bool:
    """True for any scipy.sparse array or matrix."""
    return bool(sp.issparse(matrix))


def dense(matrix: Matrix) -> FloatArray:
    """The matrix as an ndarray (a view where it already is one)."""
    return np.asarray(matrix.toarray() if is_sparse(matrix) else matrix)


def checked_matrix(matrix: Any, shape: tuple[int | None, int | None], what: str) -> Matrix:
    """Read-only float64 matrix of the given shape (None = any), kept sparse (CSR) if it came sparse.

    Raises ModelError with both shapes, or the row and column of the first entry that is not finite.
    """
    try:
        given = matrix if is_sparse(matrix) else np.array(matrix)
        if np.iscomplexobj(given):
            how = "craig_bampton(..., structural_damping=D) or Component(structural_damping=D), or a loss factor g where D = g K"
            also = f"; of a complex stiffness K + i D give D as {how}" if "stiffness" in what else ""
            raise ModelError(f"{what} is complex; give its real part{also}")
        out: Any = sp.csr_array(given, dtype=np.float64, copy=True) if is_sparse(given) else given.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{what} is not a real numeric matrix ({error})") from None
    if is_sparse(out):
        out.sum_duplicates()
    data: Any = out.data if is_sparse(out) else out
    if out.ndim != 2 or any(want is not None and want != got for want, got in zip(shape, out.shape, strict=False)):
        wanted = "(" + ", ".join("any" if s is None else str(s) for s in shape) + ")"
        raise ModelError(f"{what} has shape {out.shape}, but {wanted} is needed")
    if not np.isfinite(data).all():
        row, column = _first_not_finite(out)
        raise ModelError(f"{what} has an entry that is not finite at row {row}, column {column} (counted from 0)")
    data.setflags(write=False)
    return out


def _first_not_finite(matrix: Matrix) -> tuple[int, int]:
    entries = sp.coo_array(matrix)  # NaN and infinity are stored entries: a large sparse matrix is not made dense
    first = int(np.flatnonzero(~np.isfinite(entries.data))[0])
    return int(entries.row[first]), int(entries.col[first])


def checked_symmetric(matrix: Any, n: int | None, what: str) -> Matrix:
    """`checked_matrix` for a symmetric matrix; round-off asymmetry is averaged away, larger asymmetry is an error."""
    out = checked_matrix(matrix, (n, n), what)
    if out.shape[0] != out.shape[1]:
        raise ModelError(f"{what} has shape {out.shape}, but a square matrix is needed")
    difference = abs(out - out.T)
    largest = float(abs(out).max()) if out.shape[0] and (not is_sparse(out) or out.nnz) else 0.0
    worst = float(difference.max()) if out.shape[0] and (not is_sparse(out) or difference.nnz) else 0.0
    if worst > SYMMETRY_TOLERANCE * largest:
        entries = sp.coo_array(difference)
        row, column = sorted(x[int(np.argmax(entries.data))] for x in (entries.row, entries.col))
        raise ModelError(
            f"{what} is not symmetric: entries ({row}, {column}) and ({column}, {row}) differ by {worst:.3g} "
            f"(largest entry {largest:.3g}); if only one triangle is stored, fill the other one first"
        )
    if worst == 0.0:
        return out
    symmetric = 0.5 * (out + out.T)
    if is_sparse(symmetric):
        symmetric = sp.csr_array(symmetric)
        symmetric.data.setflags(write=False)
    else:
        symmetric.setflags(write=False)
    return symmetric
