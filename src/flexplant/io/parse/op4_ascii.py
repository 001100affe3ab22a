"""ASCII OUTPUT4: a header line, integer lines, and numbers in fixed-width fields."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.op4_matrix import Op4Matrix

FIELD_FORMAT = re.compile(rb"(\d{1,3})[EDed](\d{1,3})\.\d+")
LONGEST_LINE = 4096


def looks_ascii(head: bytes) -> bool:
    """Whether the first line holds columns, rows, form, type and a name in 8-column fields (16 for the first two)."""
    line = head.split(b"\n", 1)[0].rstrip()
    try:
        kind = _header_fields(line)[2]
    except ValueError:
        return False
    return kind in (1, 2, 3, 4)


def _header_fields(line: bytes) -> tuple[int, int, int, bytes, bytes]:
    """columns, rows, type, name, number format; ValueError if these are not there."""
    wide = line.endswith(b"|I16")
    line = line.removesuffix(b"|I16")
    first = 16 if wide else 8
    columns, rows, rest = int(line[:first]), int(line[first : 2 * first]), line[2 * first :]
    int(rest[:8])
    return columns, rows, int(rest[8:16]), rest[16:24], rest[24:]


@dataclass
class _Lines:
    """The lines of the file, one after the other."""

    data: bytes
    path: Path
    at: int = 0
    count: int = 0
    start: int = 0

    def next(self) -> bytes:
        """The next line without its end; ReadError at the end of the file."""
        if self.at >= len(self.data):
            self.fail("the file ends within a matrix")
        self.start, self.count = self.at, self.count + 1
        stop = self.data.find(b"\n", self.at, self.at + LONGEST_LINE)
        if stop < 0:
            stop = len(self.data)
            if stop - self.at > LONGEST_LINE:
                self.fail("the line is too long for OUTPUT4")
        self.at = stop + 1
        return self.data[self.start : stop].rstrip(b"\r")

    def fail(self, problem: str) -> None:
        raise ReadError(self.path, problem, record=f"line {self.count}", offset=min(self.start, len(self.data)))

    def integers(self, count: int) -> list[int]:
        """A line of `count` integers in 8-column fields (one integer may take the whole line)."""
        line = self.next()
        try:
            return [int(line)] if count == 1 else [int(line[8 * i : 8 * i + 8]) for i in range(count)]
        except ValueError:
            self.fail(f"{count} integers expected, found {line[:40].decode('ascii', 'replace')!r}")
        raise AssertionError

    def at_end(self) -> bool:
        """Only blank space is left."""
        return self.at >= len(self.data) or not self.data[self.at : self.at + LONGEST_LINE].strip()


@dataclass
class _Numbers:
    per_line: int
    width: int

    def read(self, lines: _Lines, count: int) -> Any:
        """`count` numbers in fixed-width fields over as many lines as they need."""
        if count < 0 or count * self.width > len(lines.data) - lines.at:
            lines.fail(f"{count} numbers claimed, but only {max(len(lines.data) - lines.at, 0)} bytes are left")
        parts = []
        for first in range(0, count, self.per_line):
            length = self.width * min(self.per_line, count - first)
            parts.append(lines.next()[:length].ljust(length))
        text = b"".join(parts).replace(b"D", b"E").replace(b"d", b"e")
        try:
            return np.frombuffer(text, f"S{self.width}").astype(float) if count else np.zeros(0)
        except ValueError:
            lines.fail("numbers expected")
        raise AssertionError


def ascii_matrices(data: bytes, path: Path) -> Iterator[Op4Matrix]:
    """The matrices of an ASCII OUTPUT4 file, in order."""
    lines = _Lines(data, path)
    while not lines.at_end():
        matrix, numbers = _header(lines)
        while _column(lines, matrix, numbers):
            pass
        yield matrix


def _header(lines: _Lines) -> tuple[Op4Matrix, _Numbers]:
    line = lines.next().rstrip()
    try:
        columns, rows, kind, text, layout = _header_fields(line)
    except ValueError:
        lines.fail(f"a matrix header expected, found {line[:60].decode('ascii', 'replace')!r}")
        raise
    found = FIELD_FORMAT.search(layout)
    numbers = _Numbers(int(found[1]), int(found[2])) if found else _Numbers(5, 16)
    if not (1 <= numbers.per_line <= 100 and 5 <= numbers.width <= 64):
        lines.fail(f"number format {layout.decode('ascii', 'replace').strip()!r} is not usable")
    name = text.decode("ascii", "replace").strip().upper()
    return Op4Matrix(lines.path, name, rows, columns, kind, lines.start), numbers


def _column(lines: _Lines, matrix: Op4Matrix, numbers: _Numbers) -> bool:
    """Read one column; False for the one that ends the matrix."""
    column, row, count = lines.integers(3)
    if column > matrix.columns:
        numbers.read(lines, 1)
        return False
    matrix.begin_column(column, lines.start)
    if row > 0:
        matrix.add(column, row, numbers.read(lines, count), lines.start)
        return True
    while count > 0:
        count -= _string(lines, matrix, numbers, column)
    if count:
        lines.fail(f"column {column} of {matrix.name!r} has more words than it claims")
    return True


def _string(lines: _Lines, matrix: Op4Matrix, numbers: _Numbers, column: int) -> int:
    """Read one string of a sparse column; returns the words it takes."""
    if matrix.bigmat:
        length, row = lines.integers(2)
        head, length = 2, length - 1
    else:
        (packed,) = lines.integers(1)
        head, length, row = 1, (packed >> 16) - 1, packed & 0xFFFF
    if length <= 0 or (matrix.double and length % 2):
        lines.fail(f"a string of {length} words in column {column} of {matrix.name!r}")
    matrix.add(column, row, numbers.read(lines, length // 2 if matrix.double else length), lines.start)
    return head + length
