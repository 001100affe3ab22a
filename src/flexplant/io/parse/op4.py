"""Nastran OUTPUT4 matrix files: binary (both byte orders, 32 and 64 bit) and ASCII, dense and both sparse layouts.

Layout: the OUTPUT4 module of the Nastran DMAP guides. Every count is checked against the bytes that are there before
anything is allocated, so a hostile file costs no more memory than a small multiple of its own length.
"""

from __future__ import annotations

from pathlib import Path

from flexplant.errors import ReadError
from flexplant.io.parse.files import read_bytes
from flexplant.io.parse.op4_ascii import ascii_matrices, looks_ascii
from flexplant.io.parse.op4_binary import binary_matrices, looks_binary
from flexplant.io.parse.op4_matrix import Budget
from flexplant.model.arrays import Matrix


def looks_like_op4(head: bytes) -> bool:
    """Whether the first bytes of a file are an OUTPUT4 matrix header."""
    return looks_binary(head) or looks_ascii(head)


def read_op4(path: str | Path) -> dict[str, Matrix]:
    """All matrices of an OUTPUT4 file by name (upper case): ndarray, or scipy.sparse COO where dense would be far larger.

    Raises ReadError naming file, record and byte offset for anything that contradicts itself or the file's length.
    """
    out: dict[str, Matrix] = {}
    for name, matrix in read_op4_sequence(path):
        if name in out:
            raise ReadError(path, f"the matrix {name} is stored twice", record=name)
        out[name] = matrix
    return out


def read_op4_sequence(path: str | Path) -> list[tuple[str, Matrix]]:
    """The matrices of an OUTPUT4 file in order, names may repeat; see `read_op4`."""
    path = Path(path)
    data = read_bytes(path)
    if looks_binary(data[:64]):
        parsed = binary_matrices(data, path)
    elif looks_ascii(data[:200]):
        parsed = ascii_matrices(data, path)
    else:
        raise ReadError(path, "is not an OUTPUT4 file: neither a binary nor an ASCII matrix header", record="1", offset=0)
    budget, out = Budget(len(data)), []
    for number, matrix in enumerate(parsed):
        matrix.name = matrix.name if matrix.name.isidentifier() else f"M{number}"
        out.append((matrix.name, budget.array(matrix)))
    if not out:
        raise ReadError(path, "holds no matrix")
    return out
