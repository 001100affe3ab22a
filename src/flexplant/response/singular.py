"""Singular values of many small matrices: closed forms for one or two rows or columns, LAPACK for the rest."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flexplant.model.arrays import FloatArray

ComplexArray: TypeAlias = npt.NDArray[np.complex128]


def stacked_singular_values(response: ComplexArray) -> FloatArray:
    """(nf, min(ny, nu)) descending, of a response (ny, nu, nf).

    One row or column: its length. Two rows g1, g2 (the longer first), g2 = projection on g1 + rest:
        largest^2 = (|g1|^2 + |g2|^2) / 2 + sqrt( ((|g1|^2 - |g2|^2) / 2)^2 + |g1 . g2|^2 ),  smallest = |g1| |rest| / largest,
    so the smallest has the same absolute accuracy as LAPACK's. Values from about 1e-150 to 1e150 do not overflow.
    """
    ny, nu, nf = response.shape
    if not min(ny, nu):
        return np.zeros((nf, 0))
    rows = response if ny <= nu else response.transpose(1, 0, 2)
    if rows.shape[0] == 1:
        return np.asarray(np.sqrt(_square(rows[0]).sum(axis=0))[:, None])
    if rows.shape[0] == 2:
        return _of_two(rows)
    return np.asarray(np.linalg.svd(response.transpose(2, 0, 1), compute_uv=False))


def largest_singular_values(response: ComplexArray) -> FloatArray:
    """(nf,) the largest singular value of a response (ny, nu, nf); 0 where it has no rows or columns."""
    values = stacked_singular_values(response)
    return np.ascontiguousarray(values[:, 0]) if values.shape[1] else np.zeros(values.shape[0])


def _square(values: ComplexArray) -> FloatArray:
    return values.real**2 + values.imag**2


def _of_two(rows: ComplexArray) -> FloatArray:
    sizes = _square(rows).sum(axis=1)
    swap = sizes[1] > sizes[0]
    long_, short = (np.where(swap, rows[i], rows[1 - i]) for i in (1, 0))
    a, d = sizes.max(axis=0), sizes.min(axis=0)
    inner: Any = (long_.conj() * short).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = short - np.where(a > 0, inner / a, 0.0) * long_
        largest = np.sqrt(0.5 * (a + d) + np.hypot(0.5 * (a - d), abs(inner)))
        smallest = np.sqrt(a) * np.sqrt(_square(rest).sum(axis=0)) / largest
    return np.stack([largest, np.where(largest > 0, smallest, 0.0)], axis=1)
