"""Binary OUTPUT4: Fortran sequential records with 4-byte length marks around each."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.files import one_line
from flexplant.io.parse.op4_matrix import Op4Matrix

HEADER_BYTES = {24: 4, 48: 8}  # length of the header record -> bytes of an integer and of a word


def _layout(head: bytes) -> tuple[str, int] | None:
    """Byte order and word length from the first record mark, None if this is no binary OUTPUT4 file."""
    if len(head) < 4:
        return None
    for order in "<>":
        (mark,) = struct.unpack_from(order + "i", head)
        if mark in HEADER_BYTES:
            return order, HEADER_BYTES[mark]
    return None


def looks_binary(head: bytes) -> bool:
    """Whether the file starts with the mark of a matrix header record and a possible matrix type."""
    layout = _layout(head)
    if layout is None or len(head) < 4 + 4 * layout[1]:
        return False
    *_, kind = struct.unpack_from(layout[0] + ("4i" if layout[1] == 4 else "4q"), head, 4)
    return kind in (1, 2, 3, 4)


@dataclass
class _Records:
    """The records of the file, one after the other; `start` is the offset of the current record's body."""

    data: bytes
    path: Path
    order: str
    word: int
    at: int = 0
    count: int = 0
    start: int = 0
    stop: int = 0

    def advance(self) -> bool:
        """Go to the next record; False at the end of the file, ReadError for one that is cut off or inconsistent."""
        if self.at == len(self.data):
            return False
        self.count += 1
        begin = self.at
        length = self._mark(begin)
        self.start, self.stop = begin + 4, begin + 4 + length
        if length < 0 or self.stop + 4 > len(self.data):
            self.fail(f"record of {length} bytes, but only {max(len(self.data) - self.start - 4, 0)} are left", begin)
        if self._mark(self.stop) != length:
            self.fail(f"record starts with length {length} and ends with length {self._mark(self.stop)}", begin)
        self.at = self.stop + 4
        return True

    def _mark(self, at: int) -> int:
        if at + 4 > len(self.data):
            self.fail("the file is cut off inside a record mark", at)
        return int(struct.unpack_from(self.order + "i", self.data, at)[0])

    def fail(self, problem: str, offset: int | None = None) -> None:
        raise ReadError(self.path, problem, record=str(self.count), offset=self.start if offset is None else offset)

    def integers(self, at: int, count: int) -> tuple[int, ...]:
        """`count` integers at an offset within the record."""
        if at + count * self.word > self.stop:
            self.fail(f"record of {self.stop - self.start} bytes is too short for its integers", at)
        return struct.unpack_from(f"{self.order}{count}{'i' if self.word == 4 else 'q'}", self.data, at)

    def numbers(self, at: int, words: int, matrix: Op4Matrix) -> Any:
        """The reals in `words` words at an offset within the record."""
        size = words * self.word
        item = 8 if matrix.double or self.word == 8 else 4
        if words < 0 or at + size > self.stop or size % item:
            self.fail(f"{words} words of type {matrix.kind} do not fit a record of {self.stop - self.start} bytes", at)
        return np.frombuffer(self.data, f"{self.order}f{item}", size // item, at)


def binary_matrices(data: bytes, path: Path) -> Iterator[Op4Matrix]:
    """The matrices of a binary OUTPUT4 file, in order."""
    layout = _layout(data[:4])
    if layout is None:
        raise ReadError(path, "is not a binary OUTPUT4 file", record="1", offset=0)
    records = _Records(data, path, *layout)
    while records.advance():
        matrix = _header(records)
        while _column(records, matrix):
            pass
        yield matrix


def _header(records: _Records) -> Op4Matrix:
    if records.stop - records.start != 6 * records.word:
        records.fail(f"matrix header of {records.stop - records.start} bytes; {6 * records.word} are needed")
    columns, rows, _, kind = records.integers(records.start, 4)
    text = records.data[records.start + 4 * records.word : records.stop]
    name = one_line(text.replace(b" ", b"").decode("ascii", "replace")).upper()  # 64-bit files have blanks inside
    return Op4Matrix(records.path, name, rows, columns, kind, records.start)


def _column(records: _Records, matrix: Op4Matrix) -> bool:
    """Read one column record; False for the record that ends the matrix."""
    if not records.advance():
        records.fail(f"the file ends within matrix {matrix.name!r} ({matrix.columns} columns)", records.at)
    column, row, words = records.integers(records.start, 3)
    if column > matrix.columns:
        return False
    matrix.begin_column(column, records.start)
    at = records.start + 3 * records.word
    if words < 0 or words * records.word != records.stop - at:
        records.fail(f"column {column} of {matrix.name!r} claims {words} words, its record has {records.stop - at} bytes")
    if row > 0:
        matrix.add(column, row, records.numbers(at, words, matrix), at)
        return True
    while at < records.stop:
        at = _string(records, matrix, column, at)
    return True


def _string(records: _Records, matrix: Op4Matrix, column: int, at: int) -> int:
    """Read one string of a sparse column; returns the offset after it."""
    if matrix.bigmat:
        length, row = records.integers(at, 2)
        head, length = 2, length - 1
    else:
        (packed,) = records.integers(at, 1)
        head, length, row = 1, (packed >> 16) - 1, packed & 0xFFFF
    begin = at + head * records.word
    matrix.add(column, row, records.numbers(begin, length, matrix), at)
    return begin + length * records.word
