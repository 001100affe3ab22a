"""Sparse elimination of homogeneous linear constraints: B p = 0 becomes p = L q, with redundant rows found by rank."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.model.arrays import IntArray

RANK_TOLERANCE = 1e-10  # of a row's largest coefficient; coefficients are direction cosines and arms, known to about 1e-15


@dataclass(frozen=True, eq=False)
class Elimination:
    """Result of `eliminate`.

    basis: (n, r) CSR with B @ basis = 0 and unit rows at the kept coordinates. kept: (r,), eliminated: (n - r,) columns.
    independent, redundant: rows of B. locked: {row: column} for rows that reduce to p[column] = 0.
    """

    basis: sp.csr_array
    kept: IntArray
    eliminated: IntArray
    independent: IntArray
    redundant: IntArray
    locked: dict[int, int]


@dataclass
class _Reducer:
    """Rows in reduced echelon form: pivot column -> {column: coefficient} over kept columns only."""

    solved: dict[int, dict[int, float]] = field(default_factory=dict)
    users: dict[int, set[int]] = field(default_factory=dict)

    def substitute(self, row: dict[int, float]) -> dict[int, float]:
        out: dict[int, float] = {}
        for column, value in row.items():
            for kept, factor in self.solved.get(column, {column: 1.0}).items():
                out[kept] = out.get(kept, 0.0) + value * factor
        limit = RANK_TOLERANCE * max(abs(v) for v in row.values()) if row else 0.0
        return {c: v for c, v in out.items() if abs(v) > limit}

    def add(self, row: dict[int, float]) -> int:
        """Solve the (substituted) row for its largest coefficient, the last such column; returns that column."""
        top = max(abs(v) for v in row.values())
        pivot = max(c for c, v in row.items() if abs(v) > 0.9 * top)
        scale = -1.0 / row[pivot]
        expression = {c: v * scale for c, v in row.items() if c != pivot}
        for user in self.users.pop(pivot, set()):
            self._replace(user, pivot, expression)
        self.solved[pivot] = expression
        for column in expression:
            self.users.setdefault(column, set()).add(pivot)
        return pivot

    def _replace(self, user: int, pivot: int, expression: dict[int, float]) -> None:
        target = self.solved[user]
        factor = target.pop(pivot)
        for column, value in expression.items():
            target[column] = target.get(column, 0.0) + factor * value
            self.users.setdefault(column, set()).add(user)


def eliminate(constraints: Any) -> Elimination:
    """Boolean or general sparse elimination of B p = 0, rows taken in order, each solved for one coordinate.

    constraints: (m, n) sparse. The pivot is the largest coefficient of a row (so growth is bounded), the last column of
    equals, which keeps the first-named component's interface DOF. Cost grows with the entries, not with n^3.
    """
    b = sp.csr_array(constraints)
    reducer, independent, redundant, locked = _Reducer(), [], [], {}
    for i in range(b.shape[0]):
        part = slice(b.indptr[i], b.indptr[i + 1])
        row = reducer.substitute(dict(zip(b.indices[part].tolist(), b.data[part].tolist(), strict=True)))
        if not row:
            redundant.append(i)
            continue
        pivot = reducer.add(row)
        independent.append(i)
        if len(row) == 1:
            locked[i] = pivot
    return _assemble(b.shape[1], reducer, independent, redundant, locked)


def _assemble(n: int, reducer: _Reducer, independent: list[int], redundant: list[int], locked: dict[int, int]) -> Elimination:
    eliminated = np.array(sorted(reducer.solved), dtype=np.int64)
    kept = np.setdiff1d(np.arange(n), eliminated)
    position = np.full(n, -1)
    position[kept] = np.arange(kept.size)
    entries = [(p, position[c], v) for p, expr in reducer.solved.items() for c, v in expr.items() if v != 0.0]
    rows, columns, values = (np.array(x) for x in zip(*entries, strict=True)) if entries else (np.zeros(0, int),) * 3
    basis = sp.csr_array(
        (np.r_[np.ones(kept.size), values], (np.r_[kept, rows], np.r_[np.arange(kept.size), columns])), shape=(n, kept.size)
    )
    as_ids = [np.array(x, dtype=np.int64) for x in (independent, redundant)]
    return Elimination(basis, kept, eliminated, as_ids[0], as_ids[1], locked)
