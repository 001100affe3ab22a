"""Harwell-Boeing text: a real assembled matrix in compressed columns, numbers in fixed Fortran fields.

Layout: Duff, Grimes and Lewis, "Users' Guide for the Harwell-Boeing Sparse Matrix Collection", 1992. Own reader, because every
count in the file must fit the lines that are there before memory is taken.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.files import one_line
from flexplant.io.parse.number_text import read_lines
from flexplant.io.parse.triplets import check_covers, symmetric_matrix
from flexplant.model.arrays import FloatArray, IntArray, Matrix

TYPE = re.compile(r"^([RCP])([SUHZR])([AE])(?:\s|$)", re.IGNORECASE)
FIELD = re.compile(r"(\d*)\s*[IEDFG]\s*(\d+)(?:\.\d+)?(?:E\d+)?\s*\)?\s*$", re.IGNORECASE)
PARTS = ("column pointers", "row indices", "values")


@dataclass(frozen=True)
class Header:
    """Size, entries, lines of each part, the width of its fields, and the first line of the body (from 0)."""

    symmetric: bool
    n: int
    entries: int
    lines: list[int]
    widths: list[int]
    begin: int


def looks_like_harwell_boeing(head: bytes) -> bool:
    """Whether the third line of a file is a matrix type with sizes, and the fourth begins with a Fortran format."""
    lines = head.decode("latin-1").splitlines()
    sizes = lines[2][3:].split() if len(lines) > 4 else []
    return len(sizes) >= 3 and bool(TYPE.match(lines[2])) and sizes[0].isdecimal() and lines[3].lstrip().startswith("(")


def read_harwell_boeing(path: Path) -> Matrix:
    """(n, n) CSR of a real symmetric or unsymmetric assembled matrix; the right-hand side is left out.

    Raises ReadError with the line for other types, and for counts, formats and numbers that do not fit.
    """
    lines = read_lines(path)
    header = _header(path, lines)
    counts, at, parts = (header.n + 1, header.entries, header.entries), header.begin, []
    for what, count, many, width in zip(PARTS, counts, header.lines, header.widths, strict=True):
        parts.append(_numbers(path, lines[at : at + many], (what, count, width), at + 1))
        at += many
    starts, rows = (_whole(path, values, what) for values, what in zip(parts[:2], PARTS, strict=False))
    if starts[0] != 1 or starts[-1] != header.entries + 1 or (np.diff(starts) < 0).any():
        raise ReadError(path, f"column pointers do not rise from 1 to {header.entries + 1}")
    if header.entries and not 1 <= rows.min() <= rows.max() <= header.n:
        raise ReadError(path, f"has row indices {rows.min()} to {rows.max()}; there are {header.n} rows")
    columns = np.repeat(np.arange(header.n), np.diff(starts))
    if header.symmetric and (rows - 1 < columns).any() and (rows - 1 > columns).any():
        raise ReadError(path, "is said to be symmetric, but has entries in both triangles")
    matrix = symmetric_matrix(path, rows - 1, columns, parts[2], header.n) if header.symmetric else None
    out = matrix if matrix is not None else _general(rows - 1, columns, parts[2], header.n)
    check_covers(path, out, header.n)
    return out


def _general(rows: IntArray, columns: IntArray, values: FloatArray, n: int) -> Matrix:
    import scipy.sparse as sp

    return sp.csr_array(sp.coo_array((values, (rows, columns)), shape=(n, n)))


def _header(path: Path, lines: list[str]) -> Header:
    if len(lines) < 5:
        raise ReadError(path, "is not a Harwell-Boeing file: it has no header of four lines")
    found = TYPE.match(lines[2])
    if found is None or found[1].upper() != "R" or found[2].upper() not in "SU" or found[3].upper() != "A":
        raise ReadError(path, f"is of type {one_line(lines[2])[:3]!r}; RSA and RUA are read (real, assembled)", record="line 3")
    cards, sizes = _integers(path, lines[1], 4, 2), _integers(path, lines[2][3:], 3, 3)
    rows, columns, entries = sizes[:3]
    if rows != columns:
        raise ReadError(path, f"has {rows} rows and {columns} columns; a square matrix is needed", record="line 3")
    begin = 5 if len(cards) > 4 and cards[4] > 0 else 4
    if begin + sum(cards[1:4]) > len(lines):
        problem = f"announces {sum(cards[1:4])} lines of numbers, {len(lines) - begin} are left"
        raise ReadError(path, problem, record="line 2")
    formats = [f.strip() for f in re.findall(r"\(.*?\)", lines[3])]
    widths = [_width(path, text) for text in formats[:3]]
    if len(widths) < 3:
        raise ReadError(path, f"has {len(widths)} formats; three are needed", record="line 4")
    return Header(found[2].upper() == "S", rows, entries, cards[1:4], widths, begin)


def _integers(path: Path, line: str, least: int, number: int) -> list[int]:
    fields = line.split()
    if len(fields) < least or not all(f.isdecimal() and len(f) < 16 for f in fields):
        raise ReadError(path, f"{one_line(line)[:60]!r} is not {least} counts", record=f"line {number}")
    return [int(f) for f in fields]


def _width(path: Path, text: str) -> int:
    found = FIELD.search(text.strip("() "))
    if found is None or not 1 <= int(found[2][:4]) <= 60:
        raise ReadError(path, f"the format {one_line(text)[:30]!r} is not understood", record="line 4")
    return int(found[2])


def _numbers(path: Path, lines: list[str], wanted: tuple[str, int, int], first: int) -> FloatArray:
    """The numbers of one part, by blanks if these divide them, else by the width of the fields."""
    what, count, width = wanted
    fields = " ".join(lines).split()
    if len(fields) != count:
        fields = [line[i : i + width] for line in lines for i in range(0, len(line.rstrip()), width)]
    try:
        values = np.array([f.upper().replace("D", "E") for f in fields], dtype=float)
    except ValueError:
        values = np.zeros(0)
    if values.size != count:
        raise ReadError(path, f"{what}: {count} numbers are needed in {len(lines)} lines", record=f"line {first}")
    return values


def _whole(path: Path, values: FloatArray, what: str) -> Any:
    if not ((abs(values) < 2**53) & (values % 1 == 0)).all():
        raise ReadError(path, f"{what} are no whole numbers")
    return values.astype(np.int64)
