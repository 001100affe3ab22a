"""A component as DMIG entries (`.pch`) for any Nastran-type solver: GRID, CORD2R, SPOINT, ASET and K..., M..., B...,
K4... of form 6; recovery matrices M...T of form 9, their names and labels in DTI tables and comments.

In the deck: INCLUDE the file, and K2GG = KAAX, M2GG = MAAX in case control (or as an external superelement). Numbers are
double precision in 16 columns, 10 digits and more, so this is for other solvers; `.op4`, `.npz` and `.h5` keep every bit.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexplant.io.formats import Writer
from flexplant.io.parse.recovery_notes import notes_text
from flexplant.io.write.nastran_recovery import recovery_notes, table_text
from flexplant.io.write.nastran_text import geometry_text, large, listed_rows, pairs_text
from flexplant.io.write.ownership import mark
from flexplant.io.write.present import present_matrices, present_rows
from flexplant.model.arrays import Matrix, dense
from flexplant.model.component import Component

NAME = "nastran_dmig"
LETTERS = {"stiffness": "K", "mass": "M", "damping": "B", "structural_damping": "K4"}


def write_component(component: Component, path: Path, *, suffix: str = "AAX") -> None:
    """The entries; suffix: of the matrices' names (KAAX, MAAX). Raises InputError for a component without node positions."""
    points, listed = listed_rows(component)
    rows = [*component.boundary.pairs, *((point, 0) for point in points)]
    texts = [f"$ {component.name}\n$ {mark(NAME)}\n", geometry_text(component.nodes, component.boundary, points)]
    names = {kind: letter + suffix for kind, letter in LETTERS.items()}
    texts.append(pairs_text("ASET", listed))
    texts += [dmig_text(name, matrix, rows) for name, matrix in present_matrices(component, names)]
    notes = recovery_notes(component, "T", tuple(names.values()))
    for note, matrix in present_rows(component, notes):
        texts += [transposed_text(note.matrix, matrix, rows), table_text(note)]
    path.write_text("".join([*texts, notes_text(notes)]), encoding="utf-8")


def dmig_text(name: str, matrix: Matrix, rows: list[tuple[int, int]]) -> str:
    """One symmetric matrix, the lower triangle by columns, zeros left out."""
    values = dense(matrix)
    out = [f"DMIG    {name:8}{0:8d}{6:8d}{2:8d}{0:8d}\n"]
    for j, (node, direction) in enumerate(rows):
        below = j + np.flatnonzero(values[j:, j])
        if below.size:
            fields: list[object] = [name, node, direction, ""]
            for i in below.tolist():
                fields += [rows[i][0], rows[i][1], float(values[i, j]), ""]
            out.append(large("DMIG", fields, "D"))
    return "".join(out)


def transposed_text(name: str, matrix: Matrix, rows: list[tuple[int, int]]) -> str:
    """One rectangular matrix (k, n), stored transposed as EXTSEOUT does: columns 1 to k, rows the DOF."""
    values = dense(matrix)
    out = [f"DMIG    {name:8}{0:8d}{9:8d}{2:8d}{0:8d}{'':16}{len(values):8d}\n"]
    for i, row in enumerate(values, 1):
        if (used := np.flatnonzero(row)).size:
            fields: list[object] = [name, i, 0, ""]
            for j in used.tolist():
                fields += [*rows[j], float(row[j]), ""]
            out.append(large("DMIG", fields, "D"))
    return "".join(out)


WRITER = Writer(
    name=NAME,
    description="Nastran DMIG entries with GRID, SPOINT and ASET: .pch",
    suffixes=(".pch",),
    tested_against="pyYeti, pyNastran 1.4",
    holds=frozenset({"recovery", "structural_damping"}),
    apart=(".op4",),
    writers={"write_component": write_component},
)
