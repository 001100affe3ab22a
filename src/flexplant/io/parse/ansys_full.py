"""Stiffness, mass and damping in Ansys' binary .full file as symbolic assembly writes it (every version since 2004).

After the standard record: a header, the DOF of the model, the nodes in the order of the equations. Pointers of the header lead
to the nodes' numbers of DOF with the DOF of each equation (negative where it is fixed), and to each matrix: for each equation
the columns from the diagonal to the right, the diagonal last, and their values. Equations are rows of the upper triangle.
Layout: Ansys Programmer's Reference, "Description of the full stiffness-mass file" (fdfull); seen in a file of release 15.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flexplant.errors import ReadError
from flexplant.io.parse.ansys_binary import AnsysFile
from flexplant.io.parse.files import read_head
from flexplant.io.parse.triplets import symmetric_matrix
from flexplant.model.arrays import FloatArray, IntArray, Matrix
from flexplant.model.dofs import DofSet

HEADER = 103  # the word where the second record begins
LEAST, MOST = 60, 1000  # words of the header
SYMBOLIC = -4
ROW_WORDS = 9  # of the two records of an equation with one column
ITEMS = {"kind": 1, "equations": 2, "nodes": 7, "numdof": 8, "lumped": 11, "unsymmetric": 14, "method": 15, "constraints": 21,
         "distributed": 63}  # fmt: skip
POINTERS = {"stiffness": (19, 20), "mass": (27, 28), "damping": (29, 30), "dofs": (36, 37), "mass diagonal": (56, 57),
            "scaling": (60, 61)}  # fmt: skip
TERMS = {"stiffness": (9, 10), "mass": (34, 22), "damping": (35, 40)}
ADVICE = "make text of it: /AUX2 and HBMAT, or *SMAT and *EXPORT"
REFUSED = {
    "unsymmetric": "holds unsymmetric matrices; flexplant's models are symmetric",
    "constraints": f"holds constraint equations, and does not say which DOF they left; {ADVICE}, which eliminate them",
    "distributed": "is one part of a distributed solution; solve again with DMPOPTION,FULL,YES or one process",
}


@dataclass(frozen=True, eq=False)
class FullMatrices:
    """What is left after the fixed DOF are struck out; fixed: their (node, direction)."""

    matrices: dict[str, Matrix | None]
    dofs: DofSet
    fixed: list[tuple[int, int]]


def read_full(path: Path) -> FullMatrices:
    """The matrices of the free DOF. Raises ReadError naming record and byte; and for what cannot be a symmetric real model."""
    file = AnsysFile.of(path, read_head(path))
    header = _Header.of(file)
    dofs, free = _dofs(file, header)
    found = {kind: _matrix(file, header, kind) for kind in TERMS}
    if found["stiffness"] is None or found["mass"] is None:
        missing = "stiffness" if found["stiffness"] is None else "mass"
        raise ReadError(path, f"holds no {missing} matrix; a modal analysis (MODOPT) writes both", record="header")
    keep = np.flatnonzero(free)
    matrices = {k: None if m is None else m[keep][:, keep] for k, m in found.items()}
    fixed = [pair for pair, kept in zip(dofs, free.tolist(), strict=True) if not kept]
    return FullMatrices(matrices, DofSet.of([dofs[i] for i in keep]), fixed)


@dataclass(frozen=True, eq=False)
class _Header:
    words: IntArray
    next: int

    @classmethod
    def of(cls, file: AnsysFile) -> _Header:
        words, after = file.record(HEADER, "header", MOST)
        if words.dtype.kind != "i" or words.size < LEAST:
            file.fail("header", HEADER, f"has {words.size} words; {LEAST} and more are needed")
        header = cls(words, after)
        header._check(file)
        return header

    def item(self, name: str) -> int:
        return self._word(ITEMS[name])

    def pointer(self, name: str) -> int:
        return self._long(*POINTERS[name])

    def terms(self, kind: str) -> int:
        return self._long(*TERMS[kind])

    def _word(self, number: int) -> int:
        return int(self.words[number - 1]) if number <= self.words.size else 0

    def _long(self, low: int, high: int) -> int:
        return (self._word(low) & 0xFFFFFFFF) + (self._word(high) << 32)

    def _check(self, file: AnsysFile) -> None:
        if self.item("kind") != SYMBOLIC or self.item("method") in (3, 4):
            problem = "of frontal assembly" if self.item("kind") > 0 else f"of extraction method {self.item('method')}"
            file.fail("header", HEADER, f"is {problem}, whose layout is not read; {ADVICE}")
        for name, problem in REFUSED.items():
            if self.item(name):
                file.fail("header", HEADER, problem)
        n, start = self.item("equations"), self.pointer("stiffness")
        if n < 1 or n * ROW_WORDS > len(file.words) - start:
            left = max(len(file.words) - start, 0)
            file.fail("header", HEADER, f"announces {n} equations, but {left} words follow the start of the stiffness matrix")


def _dofs(file: AnsysFile, header: _Header) -> tuple[list[tuple[int, int]], npt.NDArray[np.bool_]]:
    """(node, direction) of each equation, and which are free."""
    n = header.item("equations")
    model, at = _integers(file, header.next, "DOF of the model", header.item("numdof"))
    nodes, _ = _integers(file, at, "nodes", header.item("nodes"))
    each, at = _integers(file, header.pointer("dofs"), "numbers of DOF", len(nodes))
    signed, _ = _integers(file, at, "DOF of the equations", n)
    if (each < 0).any() or each.sum(dtype=np.int64) != n:
        file.fail("numbers of DOF", header.pointer("dofs"), f"adds up to {each.sum(dtype=np.int64)}; there are {n} equations")
    direction = _directions(file, at, abs(signed.astype(np.int64)), model)
    return list(zip(np.repeat(nodes, each).tolist(), direction.tolist(), strict=True)), signed > 0


def _directions(file: AnsysFile, at: int, numbers: IntArray, model: IntArray) -> IntArray:
    """Directions 1 to 6. Equations name the DOF by its number in the program, or by its place among those of the model."""
    what = "DOF of the equations"
    by_number, by_place = np.isin(numbers, model).all(), bool((numbers >= 1).all() and (numbers <= model.size).all())
    if not by_number and not by_place:
        file.fail(what, at, f"names DOF {numbers.min()} to {numbers.max()}; the model has {model.tolist()}")
    placed = model[np.minimum(numbers, model.size) - 1].astype(np.int64)
    if by_number and by_place and (placed != numbers).any():
        file.fail(what, at, f"names DOF that can be numbers or places among {model.tolist()}; {ADVICE}")
    direction = numbers if by_number else placed
    if direction.min() < 1 or direction.max() > 6:
        file.fail(what, at, f"has DOF {direction.max()}, which is no displacement or rotation (1 to 6)")
    return direction


def _integers(file: AnsysFile, at: int, what: str, count: int) -> tuple[IntArray, int]:
    found, after = file.record(at, what, max(count, 0))
    if found.dtype.kind != "i" or found.size != count:
        file.fail(what, at, f"has {found.size} {'integers' if found.dtype.kind == 'i' else 'reals'}; {count} integers are needed")
    return found, after


def _matrix(file: AnsysFile, header: _Header, kind: str) -> Matrix | None:
    if kind == "stiffness" and header.pointer("scaling"):
        _check_unscaled(file, header)
    if kind == "mass" and header.item("lumped"):
        return _lumped(file, header)
    at = header.pointer(kind)
    return None if not at or not header.terms(kind) else _rows(file, header, kind, at)


def _rows(file: AnsysFile, header: _Header, kind: str, at: int) -> Matrix:
    n, terms, begin, left = header.item("equations"), header.terms(kind), at, max(len(file.words) - at, 0)
    if n * ROW_WORDS > left or terms > left:
        file.fail(f"{kind} matrix", at, f"would hold {terms} terms in {n} rows; {left} words are left")
    columns, values, held = [], [], 0
    for row in range(1, n + 1):
        place, value, at = _row(file, at, f"{kind} matrix, row {row}", min(n, terms - held))
        columns.append(place)
        values.append(value)
        held += place.size
    if held != terms:
        file.fail(f"{kind} matrix", begin, f"holds {held} terms; the header announces {terms}")
    at_column = np.concatenate(columns).astype(np.int64) - 1
    at_row = np.repeat(np.arange(n), [c.size for c in columns])
    wrong = np.flatnonzero((at_column < at_row) | (at_column >= n))
    if wrong.size:
        row, column = at_row[wrong[0]] + 1, at_column[wrong[0]] + 1
        file.fail(f"{kind} matrix, row {row}", begin, f"has column {column}; {row} to {n} are expected")
    return symmetric_matrix(file.path, at_row, at_column, np.concatenate(values).astype(float), n)


def _row(file: AnsysFile, at: int, what: str, most: int) -> tuple[IntArray, FloatArray, int]:
    """Columns and values of one equation, and the word behind them."""
    place, middle = file.record(at, what, most)
    value, after = file.record(middle, what, 2 * most)
    if place.dtype.kind != "i" or value.dtype.kind != "f" or place.size != value.size:
        hint = " (complex matrices are not read)" if value.size == 2 * place.size else ""
        file.fail(what, middle, f"has {value.size} values for {place.size} columns{hint}")
    return place, value, after


def _lumped(file: AnsysFile, header: _Header) -> Matrix:
    """LUMPM,ON: the mass is its diagonal."""
    import scipy.sparse as sp

    n, at = header.item("equations"), header.pointer("mass diagonal")
    diagonal, _ = file.record(at, "diagonal of the lumped mass", n)
    if diagonal.dtype.kind != "f" or diagonal.size != n:
        file.fail("diagonal of the lumped mass", at, f"has {diagonal.size} numbers; {n} are needed")
    return sp.csr_array(sp.dia_array((diagonal.astype(float)[None, :], [0]), shape=(n, n)))


def _check_unscaled(file: AnsysFile, header: _Header) -> None:
    at = header.pointer("scaling")
    factors, _ = file.record(at, "scaling of the stiffness", header.item("equations"))
    if (factors != 1).any():
        file.fail("scaling of the stiffness", at, f"scales the equations of the stiffness matrix, which is not undone; {ADVICE}")
