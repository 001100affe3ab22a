"""MATLAB version 5 to 7.2 MAT-files: real numeric matrices, dense and sparse, and texts, read with every length checked.

Layout: "MAT-File Format" (MathWorks). Own reader, because a corrupt file can crash the interpreter inside scipy's.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import ReadError
from flexplant.io.parse.files import one_line, read_bytes
from flexplant.io.parse.npz import MAX_BYTES, MAX_RATIO, RATIO_FREE_BYTES
from flexplant.model.arrays import Matrix

HEADER_BYTES, MATRIX, COMPRESSED = 128, 14, 15
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
CELL_CLASS, CHAR_CLASS = 1, 4
SPARSE_CLASS, NUMERIC_CLASSES, COMPLEX_FLAG = 5, range(6, 16), 0x800
ENCODINGS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}


@dataclass
class _Element:
    """One data element: type, its bytes, and where these start in the file (or in its compressed part)."""

    kind: int
    data: memoryview
    at: int


@dataclass
class _File:
    path: Path
    order: str
    left: float

    def fail(self, problem: str, at: int, name: str | None = None) -> ReadError:
        return ReadError(self.path, problem, record=name, offset=at)

    def elements(self, data: memoryview, at: int) -> Iterator[_Element]:
        """The elements from an offset on; compressed ones are not padded to 8 bytes."""
        while len(data) - at >= 8:
            kind, size = struct.unpack_from(self.order + "2I", data, at)
            begin = at + 8
            if kind >> 16:
                kind, size, begin = kind & 0xFFFF, kind >> 16, at + 4
            if begin + size > len(data) or (begin == at + 4 and size > 4):
                raise self.fail(f"an element claims {size} bytes, {len(data) - begin} are left", at)
            yield _Element(kind, data[begin : begin + size], begin)
            at = at + 8 if begin == at + 4 else begin + size + (0 if kind == COMPRESSED else -size % 8)

    def unpacked(self, element: _Element) -> _Element:
        """The element inside a compressed one."""
        limit = min(self.left, max(RATIO_FREE_BYTES, MAX_RATIO * len(element.data)))
        stream = zlib.decompressobj()
        try:
            data = stream.decompress(element.data, int(limit) + 1)
        except zlib.error as error:
            raise self.fail(f"a compressed element is corrupt ({error})", element.at) from None
        if len(data) > limit:
            raise self.fail(f"a compressed element unpacks to more than {limit:.3g} bytes", element.at)
        self.left -= len(data)
        inner = next(self.elements(memoryview(data), 0), None)
        if inner is None:
            raise self.fail("a compressed element holds nothing", element.at)
        return inner

    def numbers(self, element: _Element, name: str) -> Any:
        """The numbers of an element."""
        if element.kind not in NUMBERS:
            raise self.fail(f"has data of type {element.kind}", element.at, name)
        dtype = np.dtype(self.order + NUMBERS[element.kind])
        if len(element.data) % dtype.itemsize:
            raise self.fail(f"{len(element.data)} bytes are no whole number of {dtype}", element.at, name)
        return np.frombuffer(element.data, dtype).astype(dtype.newbyteorder("="))


def read_mat(path: str | Path, *, max_bytes: float = MAX_BYTES) -> dict[str, Matrix]:
    """The numeric matrices of a MAT-file by name, sparse ones as CSC; cells, structures and texts are left out.

    Raises ReadError naming the matrix and byte for version 7.3, corrupt files, and more than max_bytes unpacked.
    """
    out: dict[str, Matrix] = {}
    for file, element in _variables(Path(path), max_bytes):
        if (found := _matrix(file, element)) is not None:
            name, matrix = found
            if name in out:
                raise file.fail("is stored twice", element.at, name)
            out[name] = matrix
    return out


def read_mat_texts(path: str | Path, *, max_bytes: float = MAX_BYTES) -> dict[str, list[str]]:
    """The texts of a MAT-file by name: the rows of a char array, or the texts in a cell; other variables are left out.

    Raises ReadError as `read_mat`, and for a char array that is no text.
    """
    out: dict[str, list[str]] = {}
    for file, element in _variables(Path(path), max_bytes):
        parts, kind, shape, name = _described(file, element)
        if kind == CHAR_CLASS:
            out[name] = _rows(file, parts, shape, name)
        elif kind == CELL_CLASS:
            cells = [_described(file, part) for part in parts[3:] if part.kind == MATRIX]
            if len(cells) == math.prod(shape) and all(inner == CHAR_CLASS for _, inner, _, _ in cells):
                out[name] = ["".join(_rows(file, held, size, name)) for held, _, size, _ in cells]
    return out


def _variables(path: Path, max_bytes: float) -> Iterator[tuple[_File, _Element]]:
    """The matrix elements of a file, unpacked; ReadError for another version."""
    data = read_bytes(path)
    if data.startswith(b"MATLAB 7.3"):
        raise ReadError(path, "is a version 7.3 MAT-file; save it with -v7 (or as .npz)")
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise ReadError(path, "is not a version 5 MAT-file", offset=126)
    file = _File(path, order, max_bytes)
    for element in file.elements(memoryview(data), HEADER_BYTES):
        inner = file.unpacked(element) if element.kind == COMPRESSED else element
        if inner.kind == MATRIX:
            yield file, inner


def _described(file: _File, element: _Element) -> tuple[list[_Element], int, tuple[int, ...], str]:
    """Parts, class, shape and name of a matrix element; an empty one (no bytes) is an empty double."""
    parts = list(file.elements(element.data, 0))
    if not parts and not element.data:
        return [], NUMERIC_CLASSES.start, (0, 0), ""
    if len(parts) < 3 or len(parts[0].data) < 8:
        raise file.fail("a matrix lacks flags, size or name", element.at)
    (flags,) = struct.unpack_from(file.order + "I", parts[0].data)
    name = one_line(bytes(parts[2].data).decode("latin-1"))
    shape = tuple(int(n) for n in file.numbers(parts[1], name))
    if min(shape, default=-1) < 0:
        raise file.fail(f"has shape {shape}", element.at, name)
    return parts, flags & 0xFF, shape, name


def _rows(file: _File, parts: list[_Element], shape: tuple[int, ...], name: str) -> list[str]:
    """The rows of a char array as texts without blanks at their ends."""
    if not math.prod(shape):
        return [""]
    if len(parts) < 4 or parts[3].kind not in ENCODINGS:
        raise file.fail("is a text without characters", parts[2].at, name)
    encoding, data = ENCODINGS[parts[3].kind], bytes(parts[3].data)
    width = {"utf-16": 2, "utf-32": 4}.get(encoding, 1)
    if width > 1:
        encoding += "-le" if file.order == "<" else "-be"
    if len(shape) == 2 and len(data) == width * math.prod(shape):  # a count of units, as of MATLAB and Octave
        units = np.frombuffer(data, f"V{width}").reshape(shape, order="F")
        return [row.tobytes().decode(encoding, "replace").rstrip() for row in units]
    text = data.decode(encoding, "replace")
    if len(shape) != 2 or len(text) != math.prod(shape):  # a count of characters, as of scipy
        raise file.fail(f"claims shape {shape}, but has {len(text)} characters", parts[3].at, name)
    return [text[i :: shape[0]].rstrip() for i in range(shape[0])]


def _matrix(file: _File, element: _Element) -> tuple[str, Matrix] | None:
    """Name and matrix; None for what is no numeric matrix."""
    parts, kind, shape, name = _described(file, element)
    if kind != SPARSE_CLASS and kind not in NUMERIC_CLASSES:
        return None
    if len(parts) < (6 if kind == SPARSE_CLASS else 4):
        raise file.fail(f"of shape {shape} lacks its numbers", element.at, name)
    if struct.unpack_from(file.order + "I", parts[0].data)[0] & COMPLEX_FLAG:
        raise file.fail("is complex; real matrices are needed", element.at, name)
    if kind == SPARSE_CLASS:
        return name, _sparse(file, shape, [file.numbers(p, name) for p in parts[3:6]], element.at, name)
    values = file.numbers(parts[3], name)
    if values.size != math.prod(shape):
        raise file.fail(f"claims shape {shape}, but has {values.size} numbers", element.at, name)
    return name, values.reshape(shape, order="F")


def _sparse(file: _File, shape: tuple[int, ...], parts: list[Any], at: int, name: str) -> Matrix:
    rows, starts, values = parts
    try:
        if len(shape) != 2 or starts.size != shape[1] + 1 or rows.dtype.kind not in "iu" or starts.dtype.kind not in "iu":
            raise ValueError(f"{starts.size} column starts for shape {shape}")
        count = int(starts[-1])
        matrix = sp.csc_array((values[:count].astype(float), rows[:count].astype(np.int64), starts.astype(np.int64)), shape=shape)
        matrix.check_format(full_check=True)
    except ValueError as error:
        raise file.fail(f"its sparse parts do not fit together ({error})", at, name) from None
    return matrix
