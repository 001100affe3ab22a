"""Block-tridiagonal layouts of small sparse symmetric matrices: where rows of blocks end, and their entries in dense blocks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from flexplant.model.arrays import FloatArray, IntArray

LEAST = 64  # rows a block: below that a product costs as much as its call


@dataclass(frozen=True, eq=False)
class Layout:
    """An order of the rows, and the ends of their blocks (0 first, n last), each of which meets its neighbours only."""

    order: IntArray
    ends: tuple[int, ...]

    @classmethod
    def of(cls, csr: Any, order: IntArray) -> Layout:
        """The smallest blocks, of LEAST rows or more, that hold a matrix in this order."""
        n, least = order.size, cls(order, (0, order.size))
        if n <= LEAST:
            return least
        return cls(order, _ends(_reach(csr, order if least.is_natural else least.place)))

    @cached_property
    def is_natural(self) -> bool:
        """Whether rows stay where they are."""
        return bool((self.order[1:] > self.order[:-1]).all())

    @cached_property
    def place(self) -> IntArray:
        """(n,) where each row goes."""
        place = np.empty_like(self.order)
        place[self.order] = np.arange(self.order.size)
        return place

    @cached_property
    def size(self) -> int:
        """Entries of the rows of blocks [A_i,i-1, A_ii]."""
        return sum(height * width for height, width in self.shapes)

    @cached_property
    def shapes(self) -> tuple[tuple[int, int], ...]:
        """Rows and columns of each [A_i,i-1, A_ii]."""
        ends = self.ends
        return tuple((ends[i + 1] - ends[i], ends[i + 1] - ends[max(i - 1, 0)]) for i in range(len(ends) - 1))

    @cached_property
    def _rows(self) -> tuple[IntArray, IntArray, IntArray]:
        """Of each row as given: where its column 0 would be in the array of all entries; its first column, and the end of its
        block, both in the new order."""
        height, width = (np.array(x) for x in zip(*self.shapes, strict=True))
        last = np.array(self.ends[1:])
        first, offset = last - width, np.cumsum(height * width) - height * width
        base = np.arange(self.order.size) * np.repeat(width, height) + np.repeat(offset - (last - height) * width - first, height)
        rows = base, np.repeat(first, height), np.repeat(last, height)
        return rows if self.is_natural else (rows[0][self.place], rows[1][self.place], rows[2][self.place])

    def blocks(self, csr: Any) -> list[tuple[FloatArray, FloatArray]] | None:
        """A_i,i-1 (no columns for the first) and A_ii of each row of blocks of a symmetric matrix in CSR form; None where an
        entry lies outside."""
        base, first, last = (np.repeat(rows, np.diff(csr.indptr)) for rows in self._rows)
        column = csr.indices if self.is_natural else self.place[csr.indices]
        lower = column < last
        if not (column >= first)[lower].all():
            return None
        whole: FloatArray = np.asarray(np.bincount((base + column)[lower], csr.data[lower], self.size), dtype=float)
        out, start = [], 0
        for height, width in self.shapes:
            rows = whole[start : start + height * width].reshape(height, width)
            out.append((rows[:, : width - height], rows[:, width - height :]))
            start += height * width
        return out


def _reach(csr: Any, place: IntArray) -> IntArray:
    """(n,) one more than the last column that the reordered rows up to each meet."""
    reach = np.arange(1, place.size + 1)
    rows = np.flatnonzero(np.diff(csr.indptr))
    if rows.size:
        last = np.maximum.reduceat(place[csr.indices], csr.indptr[rows]) + 1
        reach[place[rows]] = np.maximum(reach[place[rows]], last)
    return np.asarray(np.maximum.accumulate(reach))


def _ends(reach: IntArray) -> tuple[int, ...]:
    """Ends of blocks (0 first, n last) such that rows of a block meet only its neighbours'."""
    n = reach.size
    ends, end = [0], LEAST
    while end < n:
        ends.append(end)
        end = max(int(reach[end - 1]), end + LEAST)
    if len(ends) > 1 and n - ends[-1] < LEAST // 2:
        ends.pop()
    return (*ends, n)
