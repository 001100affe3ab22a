"""Numbers in text files: tables of a fixed width, with the line named where one cannot be read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.files import one_line, read_bytes
from flexplant.model.arrays import FloatArray, IntArray

LARGEST_ID = 2**53  # integers up to here are exact in a float


def read_lines(path: Path) -> list[str]:
    """The lines of a text file; ReadError for a binary one."""
    data = read_bytes(path)
    if b"\x00" in data[:4096]:
        raise ReadError(path, "is binary, not text", offset=data.index(b"\x00"))
    return data.decode("utf-8", "replace").splitlines()


def number_table(path: Path, lines: Sequence[str], width: int, first_line: int = 1) -> FloatArray:
    """(n, width) numbers, one row a line, separated by blanks or commas; blank lines skipped.

    first_line: the number of lines[0] in the file, for errors. Fortran's 1.0D+00 is read too.
    """
    text = "\n".join(lines).replace(",", " ")
    try:
        table = np.array(text.split(), dtype=float).reshape(-1, width)
    except ValueError:
        table = None
    if table is not None and table.shape[0] == sum(1 for line in lines if line.strip()):
        return table
    rows = [row(path, line, width, first_line + i) for i, line in enumerate(lines) if line.strip()]
    return np.array(rows, dtype=float).reshape(-1, width)


def row(path: Path, line: str, width: int, number: int) -> list[float]:
    """The numbers of one line; ReadError with the line's number if there are not `width` of them."""
    fields = line.replace(",", " ").split()
    try:
        values = [float(field.lower().replace("d", "e")) for field in fields]
    except ValueError:
        values = []
    if len(values) != width:
        problem = f"{one_line(line)[:60]!r} is not {width} numbers"
        raise ReadError(path, problem, record=f"line {number}")
    return values


def integers(path: Path, values: FloatArray, what: str, lowest: int = 1) -> IntArray:
    """Integers from a column of numbers; ReadError for fractions, and for what is below `lowest`."""
    with np.errstate(invalid="ignore"):
        whole = (values >= lowest) & (values < LARGEST_ID) & (values == np.floor(values))
    if not whole.all():
        bad = int(np.flatnonzero(~whole)[0])
        raise ReadError(path, f"{what} {float(values[bad])!r} is not an integer from {lowest} on", record=f"entry {bad + 1}")
    return values.astype(np.int64)
