"""Nastran DMIG entries: sparse matrices whose rows and columns are (grid, component), component 0 for scalar points.

Layout: MSC Nastran Quick Reference Guide, "DMIG". A header DMIG name 0 IFO TIN TOUT POLAR - NCOL; then one entry a column:
DMIG name GJ CJ - G1 C1 A1 B1 G2 C2 A2 B2 ...  Form 6 (symmetric) lists one of each pair of mirrored terms.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from flexplant.io.parse.bulk import Card
from flexplant.model.arrays import Matrix
from flexplant.model.dofs import DofSet

SQUARE, SYMMETRIC, RECTANGULAR = 1, 6, (2, 9)
COMPLEX_TYPES = (3, 4)
Dof = tuple[int, int]


@dataclass
class Dmig:
    """One matrix: its header card, form, and terms {(row, column): value}."""

    header: Card
    form: int
    columns: int
    terms: dict[tuple[Dof, Dof], float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name in upper case."""
        return self.header.text(0).upper()

    def rows_used(self) -> set[Dof]:
        """The DOF of the rows, and of the columns of a square matrix."""
        rows = {row for row, _ in self.terms}
        return rows | {column for _, column in self.terms} if self.form not in RECTANGULAR else rows

    def add(self, card: Card) -> None:
        """The terms of one column entry; ReadError for a mirrored pair that disagrees."""
        column = (card.integer(1), card.integer(2, 0))
        for at in range(4, len(card.fields) - 2, 4):
            if not card.text(at):
                continue
            row = (card.integer(at), card.integer(at + 1, 0))
            value, key = card.real(at + 2), (row, column)
            mirrored = (column, row) if self.form == SYMMETRIC else key
            if any(self.terms.get(k, value) != value for k in (key, mirrored)):
                raise card.fail(f"{self.name} has two values for {row[0]}-{row[1]}, {column[0]}-{column[1]}")
            self.terms[key] = value
            self.terms[mirrored] = value

    def square(self, dofs: DofSet) -> Matrix:
        """(n, n) CSR with a row and a column for each of these DOF, zero ones included; ReadError for a DOF not among them."""
        return self._matrix(dofs, {pair: i for i, pair in enumerate(dofs.pairs)}, len(dofs))

    def transposed(self, dofs: DofSet) -> Matrix:
        """(columns, n) CSR of a rectangular matrix stored transposed: rows are DOF, columns 1, 2, ... have component 0."""
        count = max(self.columns, max((c for _, (c, _) in self.terms), default=0))
        if count > max(self.columns, len(self.terms)):
            raise self.header.fail(f"{self.name} has column {count}, its header says {self.columns}")
        return sp.csr_array(self._matrix(dofs, {(i + 1, 0): i for i in range(count)}, count).T)

    def _matrix(self, dofs: DofSet, columns: dict[Dof, int], count: int) -> Matrix:
        place = {pair: i for i, pair in enumerate(dofs.pairs)}
        for row, column in self.terms:
            if row not in place or column not in columns:
                node, direction = row if row not in place else column
                raise self.header.fail(
                    f"{self.name} has the DOF {node}-{direction}, which is not among the {len(dofs)} of the set"
                )
        i = [place[row] for row, _ in self.terms]
        j = [columns[column] for _, column in self.terms]
        return sp.coo_array((np.array(list(self.terms.values()), dtype=float), (i, j)), shape=(len(dofs), count)).tocsr()


def dmig_matrices(cards: Iterable[Card]) -> dict[str, Dmig]:
    """The DMIG matrices among these cards by name (upper case); ReadError for complex ones and columns without a header."""
    out: dict[str, Dmig] = {}
    for card in cards:
        if card.name != "DMIG":
            continue
        name = card.text(0).upper()
        if card.text(1) == "0" and name not in out:
            out[name] = _begun(card)
        elif name not in out:
            raise card.fail(f"{name} has a column before its header")
        else:
            out[name].add(card)
    return out


def _begun(card: Card) -> Dmig:
    form, kind = card.integer(2), card.integer(3)
    if form not in (SQUARE, SYMMETRIC, *RECTANGULAR):
        raise card.fail(f"{card.text(0)} has form {form}; 1, 2, 6 and 9 exist")
    if kind in COMPLEX_TYPES:
        raise card.fail(f"{card.text(0)} is complex; real matrices are needed")
    return Dmig(card, form, card.integer(7, 0))
