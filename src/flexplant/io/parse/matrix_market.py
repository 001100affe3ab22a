"""Matrix Market text files: coordinate and array layouts, real and integer, general and symmetric.

Layout: Boisvert, Pozo and Remington, "The Matrix Market Exchange Formats", NISTIR 5935 (1996).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.sparse as sp

from flexplant.errors import ReadError
from flexplant.io.parse.files import one_line
from flexplant.io.parse.number_text import integers, number_table, read_lines, row
from flexplant.model.arrays import FloatArray, Matrix

BANNER = "%%matrixmarket"


def looks_like_matrix_market(head: bytes) -> bool:
    """Whether the first bytes of a file are the banner."""
    return head[:14].lower() == BANNER.encode()


def read_matrix_market(path: Path) -> Matrix:
    """The matrix: CSR from the coordinate layout (symmetric ones filled up), ndarray from the array layout.

    Raises ReadError with the line for a malformed banner, size or entry, complex and pattern matrices.
    """
    lines = read_lines(path)
    words = lines[0].lower().split() if lines else []
    if len(words) != 5 or words[0] != BANNER or words[1] != "matrix" or words[2] not in ("coordinate", "array"):
        raise ReadError(path, f"is not a Matrix Market matrix: {one_line(lines[0] if lines else '')!r}", record="line 1")
    if words[3] not in ("real", "integer", "double") or words[4] not in ("general", "symmetric"):
        raise ReadError(path, f"is {words[3]} {words[4]}; real general and real symmetric matrices are read", record="line 1")
    begin = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("%")), None)
    if begin is None:
        raise ReadError(path, "has no size line")
    width = 3 if words[2] == "coordinate" else 2
    size = integers(path, np.array(row(path, lines[begin], width, begin + 1)), "size", 0)
    body = lines[begin + 1 :]
    reader = _coordinate if width == 3 else _array
    return reader(path, body, size.tolist(), words[4] == "symmetric", begin + 2)


def _coordinate(path: Path, body: list[str], size: list[int], symmetric: bool, first: int) -> Matrix:
    rows, columns, count = size
    if count > len(body):
        raise ReadError(path, f"claims {count} entries, {len(body)} lines are left")
    entries = number_table(path, body, 3, first)
    if len(entries) != count:
        raise ReadError(path, f"claims {count} entries, has {len(entries)}")
    if max(rows, columns) > 10**8:
        raise ReadError(path, f"claims shape ({rows}, {columns})")
    i, j = (integers(path, entries[:, k], what) - 1 for k, what in ((0, "row"), (1, "column")))
    if count and (i.max() >= rows or j.max() >= columns):
        raise ReadError(path, f"has an entry at ({i.max() + 1}, {j.max() + 1}) outside its shape ({rows}, {columns})")
    values = entries[:, 2]
    if symmetric:
        off = i != j
        i, j, values = np.r_[i, j[off]], np.r_[j, i[off]], np.r_[values, values[off]]
    if max(rows, columns) > 2 * values.size + 1000:
        raise ReadError(path, f"claims shape ({rows}, {columns}) but holds only {count} entries")
    return sp.coo_array((values, (i, j)), shape=(rows, columns)).tocsr()


def _array(path: Path, body: list[str], size: list[int], symmetric: bool, first: int) -> FloatArray:
    rows, columns = size
    values = number_table(path, body, 1, first)[:, 0]
    if symmetric and rows == columns and values.size == rows * (rows + 1) // 2:
        out = np.zeros((rows, rows))
        lower = np.tril_indices(rows)
        order = np.lexsort((lower[0], lower[1]))  # columns of the lower triangle, one after the other
        out[lower[0][order], lower[1][order]] = values
        return out + np.tril(out, -1).T
    if symmetric or values.size != rows * columns:
        raise ReadError(path, f"claims shape ({rows}, {columns}), has {values.size} numbers")
    return values.reshape((rows, columns), order="F")
