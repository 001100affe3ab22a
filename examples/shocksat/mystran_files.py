"""Read what MYSTRAN writes: OUTPUT4 matrices and the sparse G-set stiffness and mass; read the decks of generate.py.

OUTPUT4 is written here too, in the sparse form that keeps only the nonzero strings of each column.
"""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy.sparse as sp

TERM = np.dtype([("head", "<i4"), ("row", "<i4"), ("col", "<i4"), ("value", "<f8"), ("tail", "<i4")])


def read_sparse(path: Path, size: int) -> sp.csr_array:
    """A sparse matrix that MYSTRAN keeps (.L1L is KGG, .L1R is MGG): Fortran records of one term each."""
    terms = np.fromfile(path, TERM, offset=24)  # after the records of the time stamp and of the count
    matrix = sp.coo_array((terms["value"], (terms["row"] - 1, terms["col"] - 1)), shape=(size, size))
    return matrix.tocsr()


def records(data: bytes) -> list[bytes]:
    """The bodies of a sequential Fortran file's records."""
    bodies, at = [], 0
    while at < len(data):
        (length,) = struct.unpack_from("<i", data, at)
        bodies.append(data[at + 4 : at + 4 + length])
        at += length + 8
    return bodies


def column_strings(body: bytes, first_row: int) -> list[tuple[int, np.ndarray]]:
    """(first row from 0, values) of each string of a double-precision column; `first_row` 0 marks the sparse form."""
    if first_row > 0:
        return [(first_row - 1, np.frombuffer(body, "<f8"))]
    strings, at = [], 0
    while at < len(body):
        (header,) = struct.unpack_from("<i", body, at)
        words, row = header // 65536 - 1, header % 65536
        strings.append((row - 1, np.frombuffer(body, "<f8", words // 2, at + 4)))
        at += 4 * (words + 1)
    return strings


def read_op4(path: Path) -> dict[str, np.ndarray]:
    """All matrices of a binary double-precision OUTPUT4 file."""
    matrices: dict[str, np.ndarray] = {}
    bodies = iter(records(path.read_bytes()))
    for header in bodies:
        columns, rows = struct.unpack_from("<2i", header)
        matrix = np.zeros((abs(rows), columns))
        for body in bodies:
            column, first_row, words = struct.unpack_from("<3i", body)
            if column > columns:
                break
            for row, values in column_strings(body[12 : 12 + 4 * words], first_row):
                matrix[row : row + len(values), column - 1] = values
        matrices[header[16:24].decode().strip()] = matrix
    return matrices


def strings_of(column: np.ndarray) -> bytes:
    """The sparse strings of a column: a header word (length and first row), then the values."""
    rows = np.flatnonzero(column)
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(rows) else []
    out = b""
    for run in runs:
        header = run[0] + 1 + 65536 * (2 * len(run) + 1)
        out += struct.pack("<i", header) + column[run].astype("<f8").tobytes()
    return out


def write_op4(path: Path, matrices: dict[str, np.ndarray]) -> None:
    """Write matrices as binary OUTPUT4, double precision, sparse (little-endian, fewer than 65536 rows)."""
    with path.open("wb") as file:

        def record(body: bytes) -> None:
            file.write(struct.pack("<i", len(body)) + body + struct.pack("<i", len(body)))

        for name, matrix in matrices.items():
            rows, columns = matrix.shape
            form = 1 if rows == columns else 2
            record(struct.pack("<4i8s", columns, rows, form, 2, name.ljust(8).encode()))
            for number, column in enumerate(matrix.T, start=1):
                strings = strings_of(column)
                if strings:
                    record(struct.pack("<3i", number, 0, len(strings) // 4) + strings)
            record(struct.pack("<3id", columns + 1, 1, 2, 1.0))


def read_grids(deck: Path) -> dict[int, np.ndarray]:
    """The grids of a deck with GRID* cards, in metres."""
    lines = deck.read_text().splitlines()
    return {
        int(line[8:24]): np.array([line[40:56], line[56:72], after[8:24]], float)
        for line, after in pairwise(lines)
        if line.startswith("GRID*")
    }


def read_quads(deck: Path) -> dict[int, tuple[int, ...]]:
    """CQUAD4: the property id, then the four grids, by element."""
    cards = (line.split(",") for line in deck.read_text().splitlines() if line.startswith("CQUAD4"))
    return {int(card[1]): tuple(map(int, card[2:7])) for card in cards}


def read_rigids(deck: Path) -> list[tuple[int, str, list[int]]]:
    """RBE2: independent grid, directions, dependent grids."""
    cards = deck.read_text().replace("\n,", ",").splitlines()
    fields = [card.split(",")[2:] for card in cards if card.startswith("RBE2")]
    return [(int(f[0]), f[1], [int(g) for g in f[2:]]) for f in fields]
