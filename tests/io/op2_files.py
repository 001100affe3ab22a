"""OUTPUT2 files made for tests: a label, then matrices as data blocks, 32-bit words, little-endian."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np


def record(body: bytes) -> bytes:
    return struct.pack("<i", len(body)) + body + struct.pack("<i", len(body))


def key(value: int) -> bytes:
    return record(struct.pack("<i", value))


def sized(body: bytes) -> bytes:
    return key(len(body) // 4) + record(body)


def matrix_block(name: str, matrix: np.ndarray) -> bytes:
    """Columns from their first to their last number that is not zero; an empty column has no string."""
    rows, columns = matrix.shape
    words = name.ljust(8).encode()
    out = sized(words) + key(-1) + sized(struct.pack("<7i", 101, columns, rows, 2 if rows != columns else 6, 2, 2 * rows, 10000))
    out += key(-2) + key(1) + key(0) + sized(words)
    for column in range(columns):
        out += key(-3 - column) + key(1) + key(1)
        filled = np.flatnonzero(matrix[:, column])
        if filled.size:
            numbers = matrix[filled[0] : filled[-1] + 1, column].astype("<f8").tobytes()
            out += key(1 + len(numbers) // 4) + record(struct.pack("<i", int(filled[0]) + 1) + numbers)
    return out + key(-3 - columns) + key(1) + key(0) + key(0)


def dmig_words(
    name: str, columns: dict[tuple[int, int], list[tuple[int, int, float]]], form: int = 6, count: int = 0, kind: int = 2
) -> bytes:
    """One matrix as EXTSEOUT(DMIGOP2) stores it: single (1) or double (2) precision terms by column."""
    value = {1: "f", 2: "d"}[kind]
    out = name.ljust(8).encode() + struct.pack("<7i", 0, form, kind, kind, 0, 0, count)
    for (grid, component), rows in columns.items():
        out += struct.pack("<2i", grid, component)
        out += b"".join(struct.pack(f"<2i{value}", *row) for row in rows) + struct.pack("<2i", -1, -1)
    return out + struct.pack("<2i", -1, -1)


def table_block(name: str, words: bytes) -> bytes:
    """A data block with one record."""
    out = sized(name.ljust(8).encode()) + key(-1) + sized(struct.pack("<7i", 101, 1, 0, 0, 0, 0, 0))
    out += key(-2) + key(1) + key(0) + sized(name.ljust(8).encode())
    return out + key(-3) + key(1) + key(0) + sized(words) + key(-4) + key(1) + key(0) + key(0)


def write_op2(path: Path, matrices: dict[str, np.ndarray], tables: dict[str, bytes] | None = None) -> Path:
    date = struct.pack("<3i", 1, 2, 26)
    label = sized(date) + sized(b"NASTRAN FORT TAPE ID CODE - ") + sized(b"XXXXXXXX") + key(-1) + key(0)
    path.write_bytes(label + b"".join(matrix_block(name, m) for name, m in matrices.items())
                     + b"".join(table_block(name, words) for name, words in (tables or {}).items()) + key(0))  # fmt: skip
    return path
