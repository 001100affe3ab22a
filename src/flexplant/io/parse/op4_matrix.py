"""One OUTPUT4 matrix while it is read: strings of consecutive numbers in columns, checked as they come."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import ReadError
from flexplant.model.arrays import Matrix

LARGEST_DIMENSION = 10**8  # rows or columns; real files stay below a tenth of this
DENSE_PER_FILE_BYTE = 64  # a matrix much larger than its file is nearly all zeros and stays sparse
BIGMAT_ROWS = 65536


@dataclass
class Op4Matrix:
    """Header and strings of one matrix. kind: 1 real single, 2 real double, 3 and 4 the same complex."""

    path: Path
    name: str
    rows: int
    columns: int
    kind: int
    offset: int
    bigmat: bool = False
    strings: list[tuple[int, int, Any]] = field(default_factory=list)
    last_column: int = 0

    def __post_init__(self) -> None:
        self.bigmat = self.rows < 0 or self.rows >= BIGMAT_ROWS
        self.rows = abs(self.rows)
        if not (1 <= self.rows <= LARGEST_DIMENSION and 1 <= self.columns <= LARGEST_DIMENSION):
            self.fail(f"claims {self.rows} rows and {self.columns} columns", self.offset)
        if self.kind not in (1, 2, 3, 4):
            self.fail(f"has type {self.kind}; 1 to 4 exist", self.offset)

    @property
    def complex(self) -> bool:
        """Whether the numbers come as real, imaginary pairs."""
        return self.kind > 2

    @property
    def double(self) -> bool:
        """Whether a real number takes two 32-bit words."""
        return self.kind in (2, 4)

    def fail(self, problem: str, offset: int) -> None:
        """Raise ReadError for this matrix."""
        raise ReadError(self.path, f"matrix {self.name!r} {problem}", record=self.name or "header", offset=offset)

    def begin_column(self, column: int, offset: int) -> None:
        """Columns come once and ascending."""
        if not self.last_column < column <= self.columns:
            self.fail(f"({self.columns} columns) has column {column} after column {self.last_column}", offset)
        self.last_column = column

    def add(self, column: int, row: int, numbers: Any, offset: int) -> None:
        """A string of consecutive numbers from (row, column) downwards, both from 1."""
        if self.complex:
            if numbers.size % 2:
                self.fail(f"has an odd count of reals in column {column}", offset)
            numbers = numbers.astype(float).view(complex)
        if row < 1 or row - 1 + numbers.size > self.rows:
            self.fail(f"({self.rows} rows) has rows {row} to {row - 1 + numbers.size} in column {column}", offset)
        self.strings.append((column - 1, row - 1, numbers))


@dataclass
class Budget:
    """How much dense memory a file of `size` bytes may ask for; matrices beyond it come out sparse."""

    size: int
    spent: int = 0

    def array(self, matrix: Op4Matrix) -> Matrix:
        """The finished matrix: float64 or complex128; dense within the budget, else scipy.sparse COO."""
        need = matrix.rows * matrix.columns * (16 if matrix.complex else 8)
        if self.spent + need > DENSE_PER_FILE_BYTE * self.size:
            return _sparse(matrix)
        self.spent += need
        out = np.zeros((matrix.rows, matrix.columns), dtype=complex if matrix.complex else float)
        for column, row, numbers in matrix.strings:
            out[row : row + numbers.size, column] = numbers
        return out


def _sparse(matrix: Op4Matrix) -> Matrix:
    shape = (matrix.rows, matrix.columns)
    if not matrix.strings:
        return sp.coo_array(shape)
    rows = np.concatenate([np.arange(row, row + numbers.size) for _, row, numbers in matrix.strings])
    columns = np.concatenate([np.full(numbers.size, column) for column, _, numbers in matrix.strings])
    values = np.concatenate([numbers for _, _, numbers in matrix.strings])
    return sp.coo_array((values.astype(complex if matrix.complex else float), (rows, columns)), shape=shape)
