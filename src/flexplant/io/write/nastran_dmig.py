"""A component as DMIG entries (`.pch`) for any Nastran-type solver: GRID, CORD2R, SPOINT, ASET and K..., M..., B... of form 6.

In the deck: INCLUDE the file, and K2GG = KAAX, M2GG = MAAX in case control (or as an external superelement). Numbers are
double precision in 16 columns, 10 digits and more, so this is for other solvers; `.op4`, `.npz` and `.h5` keep every bit.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexplant.io.formats import Writer
from flexplant.io.write.nastran_text import geometry_text, grouped, large, modal_points, pairs_text
from flexplant.io.write.ownership import mark
from flexplant.model.arrays import Matrix, dense
from flexplant.model.component import Component

NAME = "nastran_dmig"
LETTERS = (("stiffness", "K"), ("mass", "M"), ("damping", "B"))


def write_component(component: Component, path: Path, *, suffix: str = "AAX") -> None:
    """The entries; suffix: of the matrices' names (KAAX, MAAX). Raises InputError for a component without node positions."""
    points = modal_points(component)
    rows = [*component.boundary.pairs, *((point, 0) for point in points)]
    texts = [f"$ {component.name}\n$ {mark(NAME)}\n", geometry_text(component.nodes, component.boundary, points)]
    texts.append(pairs_text("ASET", [*grouped(component.boundary), *((point, "0") for point in points)]))
    for kind, letter in LETTERS:
        if (matrix := getattr(component, kind)) is not None:
            texts.append(dmig_text(letter + suffix, matrix, rows))
    path.write_text("".join(texts), encoding="utf-8")


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


WRITER = Writer(
    name=NAME,
    description="Nastran DMIG entries with GRID, SPOINT and ASET: .pch",
    suffixes=(".pch",),
    tested_against="pyYeti, pyNastran 1.4",
    apart=(".op4",),
    writers={"write_component": write_component},
)
