"""Read what MYSTRAN writes: OUTPUT4 matrices and the sparse G-set stiffness and mass; and the decks of generate.py."""

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


def read_op4(path: Path) -> dict[str, np.ndarray]:
    """All matrices of a binary, dense, double-precision OUTPUT4 file, as MYSTRAN writes it."""
    matrices: dict[str, np.ndarray] = {}
    bodies = iter(records(path.read_bytes()))
    for header in bodies:
        columns, rows = struct.unpack_from("<2i", header)
        matrix = np.zeros((abs(rows), columns))
        for body in bodies:
            column, first_row, words = struct.unpack_from("<3i", body)
            if column > columns:
                break
            values = np.frombuffer(body, "<f8", words // 2, 12)
            matrix[first_row - 1 : first_row - 1 + len(values), column - 1] = values
        matrices[header[16:24].decode().strip()] = matrix
    return matrices


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
