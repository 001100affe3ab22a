"""Sierra/SD `Kaa.m` and `Maa.m`: MATLAB text of (row, column, value) lines, or of K(i,j) = v statements, with a table of DOF.

The table is `dofs.csv` in the same folder (node,direction a line; see `flexplant.io.parse.dof_table`), or dofs=.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.dof_table import read_dof_table
from flexplant.io.parse.files import provenance
from flexplant.io.parse.listed_rows import listed_model
from flexplant.io.parse.names import name_from
from flexplant.io.parse.number_text import integers, number_table, read_lines
from flexplant.io.parse.partner_files import partner
from flexplant.io.parse.triplets import check_covers, symmetric_matrix
from flexplant.model.arrays import Matrix
from flexplant.model.component import FiniteElementModel

STATEMENT = re.compile(r"^\s*[A-Za-z]\w*\(\s*(\d+)\s*,\s*(\d+)\s*\)\s*=\s*([^;%]+);?")
TRIPLET = re.compile(r"^\s*\[?\s*\d+[\s,]+\d+[\s,]+[-+.\dEeDd]+\s*;?")


def sniff(head: bytes, path: Path) -> bool:
    """A file Kaa.m (or K*.m) with numbers or assignments to entries."""
    if path.suffix.lower() != ".m" or path.stem[:1].upper() != "K" or b"\x00" in head:
        return False
    lines = head.decode("latin-1").splitlines()
    return any(STATEMENT.match(line) or TRIPLET.match(line) for line in lines)


def read_model(
    path: Path, *, name: str | None = None, mass: str | Path | None = None, dofs: str | Path | None = None
) -> FiniteElementModel:
    """The model from Kaa.m; mass: its file, None for the name with M in place of K; dofs: the table, None for dofs.csv."""
    mass_file = partner(path, mass, path.stem[0], chr(ord(path.stem[0]) + 2), "mass")
    table_file = Path(dofs) if dofs is not None else path.with_name("dofs.csv")
    if not table_file.is_file():
        raise ReadError(path, "needs a table of the DOF of its rows (node,direction a line): dofs.csv beside it, or dofs=")
    table = read_dof_table(table_file)
    matrices: dict[str, Matrix | None] = {
        "mass": _matrix(mass_file, len(table.dofs)),
        "stiffness": _matrix(path, len(table.dofs)),
    }
    source = provenance(path, FORMAT.name, __name__, (mass_file, table_file))
    return listed_model(path, matrices, table.dofs, table.nodes, name or name_from(path), source)


def _matrix(path: Path, n: int) -> Matrix:
    lines = read_lines(path)
    entries = number_table(path, [_entry(line) for line in lines], 3)
    rows, columns = (integers(path, entries[:, k], what) - 1 for k, what in ((0, "row"), (1, "column")))
    matrix = symmetric_matrix(path, np.asarray(rows), np.asarray(columns), entries[:, 2], n)
    check_covers(path, matrix, n)
    return matrix


def _entry(line: str) -> str:
    """The three numbers of a line as text, or nothing."""
    found = STATEMENT.match(line)
    if found:
        return f"{found[1]} {found[2]} {found[3]}"
    return line.strip().lstrip("[").rstrip("];").strip() if TRIPLET.match(line) else ""


FORMAT = Format(
    name="sierra_text",
    description="Sierra/SD Kaa.m, Maa.m text with a .csv of the DOF",
    suffixes=(".m",),
    sniff=sniff,
    readers={"read_model": read_model},
)
