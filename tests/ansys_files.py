"""A writer of Ansys' binary .full layout for tests: records, packed records, and the header's places."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

INTEGERS, WINDOWS, BITS = 1 << 31, 1 << 28, 1 << 27
SIZE = 100


def record(numbers: Sequence[int] | np.ndarray, order: str = "<", flags: int = 0) -> bytes:
    """A record of integers or doubles as they are."""
    array = np.asarray(numbers)
    integers = array.dtype.kind == "i"
    return framed(array.astype(f"{order}{'i4' if integers else 'f8'}").tobytes(), order, flags | (INTEGERS if integers else 0))


def framed(body: bytes, order: str, flags: int) -> bytes:
    count = struct.pack(order + "i", len(body) // 4)
    return count + struct.pack(order + "I", flags) + body + count


def bits(numbers: np.ndarray, order: str = "<") -> bytes:
    """A record of at most 32 numbers that leaves out the zeros."""
    mask = sum(1 << int(k) for k in np.flatnonzero(numbers))
    integers = numbers.dtype.kind == "i"
    body = struct.pack(order + "iI", len(numbers), mask)
    body += numbers[numbers != 0].astype(f"{order}{'i4' if integers else 'f8'}").tobytes()
    return framed(body, order, BITS | (INTEGERS if integers else 0))


def windows(size: int, pieces: list[tuple[int, np.ndarray, int]], order: str = "<") -> bytes:
    """A record of `size` numbers, zero but for pieces (place, numbers, length); a greater length repeats one number."""
    integers = pieces[0][1].dtype.kind == "i"
    body = struct.pack(order + "2i", size, len(pieces))
    for place, numbers, length in pieces:
        alone = place > 0 and length == 1
        repeated = length != len(numbers)
        body += struct.pack(order + "i", place) if alone else struct.pack(order + "2i", -place, -length if repeated else length)
        body += numbers.astype(f"{order}{'i4' if integers else 'f8'}").tobytes()
    return framed(body, order, WINDOWS | (INTEGERS if integers else 0))


def rows(matrix: np.ndarray, order: str = "<", packed: bool = False) -> tuple[bytes, int]:
    """Each row of the upper triangle: columns with the diagonal last, values; and the number of terms."""
    out, terms = b"", 0
    for i, row in enumerate(matrix):
        place = np.r_[[j for j in np.flatnonzero(row) if j > i], i].astype(int)
        values = row[place]
        out += record(place + 1, order)
        out += windows(len(values), [(0, values, len(values))], order) if packed else record(values, order)
        terms += len(place)
    return out, terms


def write_full(
    path: Path,
    matrices: dict[str, np.ndarray],
    nodes: Sequence[int],
    directions: Sequence[int],
    fixed: Sequence[int] = (),
    *,
    order: str = "<",
    packed: bool = False,
    extra: dict[int, int] | None = None,
    numbers: Sequence[int] | None = None,
    scale: float | None = None,
    lumped: bool = False,
) -> Path:
    """Matrices of all equations; those of the rows in `fixed` are marked, and their rows of K are those of a unit matrix.

    extra: words of the header by their item number. numbers: how the equations name their DOF, None for the directions.
    """
    n = len(nodes) * len(directions)
    named = np.tile(directions if numbers is None else numbers, len(nodes))
    named[list(fixed)] *= -1
    stiffness = matrices["stiffness"].copy()
    for row in fixed:
        stiffness[row], stiffness[:, row], stiffness[row, row] = 0.0, 0.0, 1.0
    header = np.zeros(SIZE, dtype=int)
    header[[0, 1, 2, 3, 6, 7, 14, 32]] = (-4, n, n - len(fixed), len(matrices), len(nodes), len(directions), 6, len(nodes))
    standard = np.r_[4, np.zeros(8, dtype=int), int.from_bytes(b"15.0", "big"), np.zeros(90, dtype=int)]
    parts = [record(standard, order), b"", record(np.array(directions), order)]
    parts.append(record(np.array(nodes), order))
    place: dict[str, tuple[int, int]] = {"stiffness": (18, 8), "mass": (26, 33), "damping": (28, 34)}
    for kind, matrix in (matrices | {"stiffness": stiffness}).items():
        body, terms = rows(matrix, order, packed)
        at, count = place[kind]
        header[at], header[count] = _words(parts), terms
        parts.append(body)
    header[35] = _words(parts)
    parts += [record(np.full(len(nodes), len(directions)), order), record(named, order)]
    if scale is not None:
        header[59] = _words(parts)
        parts.append(record(np.full(n, scale), order))
    if lumped:
        header[10], header[55], header[26] = 1, _words(parts), 0
        parts.append(record(np.diag(matrices["mass"]).copy(), order))
    for item, value in (extra or {}).items():
        header[item - 1] = value
    parts[1] = record(header, order)
    path.write_bytes(b"".join(parts))
    return path


def _words(parts: list[bytes]) -> int:
    """Where the next record begins, the header counted that is not yet written."""
    return (sum(map(len, parts)) + 4 * (SIZE + 3)) // 4
