"""CalculiX matrices, `*FREQUENCY, SOLVER=MATRIXSTORAGE`: `.sti`, `.mas` (row, column, value) and `.dof` (node.direction a row).

Positions come from the `.inp` with the same stem where it is there.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.abaqus_input import read_nodes
from flexplant.io.parse.files import one_line, provenance, sibling
from flexplant.io.parse.names import name_from
from flexplant.io.parse.number_text import integers, number_table, read_lines
from flexplant.io.parse.triplets import check_covers, symmetric_matrix
from flexplant.model.arrays import Matrix
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet

DOF_LINE = re.compile(r"\s*(\d{1,15})\.([1-6])\s*$")


def sniff(head: bytes, path: Path) -> bool:
    """A `.sti` file of three numbers a line."""
    first = head.split(b"\n", 1)[0].split()
    return path.suffix.lower() == ".sti" and len(first) == 3 and first[0].isdigit()


def read_model(path: Path, *, name: str | None = None, geometry: str | Path | None = None) -> FiniteElementModel:
    """The model from its `.sti` file; geometry: the `.inp`, None for the one with the same stem."""
    mass, dof = sibling(path, ".mas"), sibling(path, ".dof")
    if mass is None or dof is None:
        raise ReadError(path, f"needs the {'.mas' if mass is None else '.dof'} file with the same stem beside it")
    deck = Path(geometry) if geometry is not None else sibling(path, ".inp")
    dofs = read_dofs(dof)
    others = tuple(file for file in (mass, dof, deck) if file is not None)
    return FiniteElementModel(
        name=name or name_from(path),
        mass=_matrix(mass, len(dofs)),
        stiffness=_matrix(path, len(dofs)),
        dofs=dofs,
        nodes=None if deck is None else read_nodes(deck),
        source=provenance(path, FORMAT.name, __name__, others),
    )


def read_dofs(path: Path) -> DofSet:
    """The DOF of the rows from lines such as 12.3 (node 12, direction 3)."""
    pairs = []
    for number, line in enumerate(read_lines(path), 1):
        if not line.strip():
            continue
        found = DOF_LINE.match(line)
        if found is None:
            raise ReadError(path, f"{one_line(line)[:40]!r} is not node.direction", record=f"line {number}")
        pairs.append((int(found[1]), int(found[2])))
    return DofSet.of(pairs)


def _matrix(path: Path, n: int) -> Matrix:
    entries = number_table(path, read_lines(path), 3)
    rows, columns = (integers(path, entries[:, k], what) - 1 for k, what in ((0, "row"), (1, "column")))
    matrix = symmetric_matrix(path, np.asarray(rows), np.asarray(columns), entries[:, 2], n)
    check_covers(path, matrix, n)
    return matrix


FORMAT = Format(
    name="calculix",
    description="CalculiX matrices: .sti, .mas, .dof",
    suffixes=(".sti",),
    sniff=sniff,
    readers={"read_model": read_model},
)
