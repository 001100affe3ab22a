"""Ansys matrices as Matrix Market text (`*EXPORT, ..., MMF`) with the table that says which DOF the rows are.

The table is either the vector of node ids (`*EXPORT` of the NOD2BCS / mapping vector: one id for each block of rows) or the
mapping text of HBMAT (`equation  node  UX`). Rows are not in node order. Coordinates: a table "node x y z", decimal commas
allowed, or none.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.files import provenance
from flexplant.io.parse.matrix_market import looks_like_matrix_market, read_matrix_market
from flexplant.io.parse.names import name_from
from flexplant.io.parse.number_text import integers, number_table, read_lines
from flexplant.io.parse.partner_files import maybe_partner, partner
from flexplant.model.arrays import Matrix
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes

DIRECTIONS = {"UX": 1, "UY": 2, "UZ": 3, "ROTX": 4, "ROTY": 5, "ROTZ": 6}
STIFFNESS = "StiffnessMatrixSparse"


def sniff(head: bytes, path: Path) -> bool:  # noqa: ARG001  every sniff function has it
    """A Matrix Market file that names its creator ANSYS."""
    return looks_like_matrix_market(head) and b"ANSYS" in head[:400].upper() and b"array" not in head[:40]


def read_model(
    path: Path,
    *,
    name: str | None = None,
    mass: str | Path | None = None,
    mapping: str | Path | None = None,
    coordinates: str | Path | None = None,
) -> FiniteElementModel:
    """The model from its stiffness file; the other files are found by name where "StiffnessMatrixSparse" is in this one's.

    mass, mapping, coordinates: their files (…MassMatrixSparse, …MatrixDofMappingVector, …NodalCoordinates).
    """
    mass_file = partner(path, mass, STIFFNESS, "MassMatrixSparse", "mass")
    mapping_file = partner(path, mapping, STIFFNESS, "MatrixDofMappingVector", "mapping")
    placed = Path(coordinates) if coordinates is not None else maybe_partner(path, STIFFNESS, "NodalCoordinates")
    stiffness, masses = _square(path), _square(mass_file)
    dofs = read_mapping(mapping_file, stiffness.shape[0])
    others = (mass_file, mapping_file) if placed is None else (mass_file, mapping_file, placed)
    return FiniteElementModel(
        name=name or name_from(path),
        mass=masses,
        stiffness=stiffness,
        dofs=dofs,
        nodes=None if placed is None else read_coordinates(placed),
        source=provenance(path, FORMAT.name, __name__, others),
    )


def _square(path: Path) -> Matrix:
    matrix = read_matrix_market(path)
    if matrix.shape[0] != matrix.shape[1]:
        raise ReadError(path, f"has shape {matrix.shape}; a square matrix is needed")
    return matrix


def read_mapping(path: Path, n: int) -> DofSet:
    """The DOF of n rows, from a vector of node ids or from lines "equation node UX"."""
    lines = read_lines(path)
    if lines and looks_like_matrix_market(lines[0].encode()):
        ids = integers(path, np.ravel(_dense(path)), "node")
        if not ids.size or n % ids.size or n // ids.size > 6:
            raise ReadError(path, f"lists {ids.size} nodes for {n} rows")
        each = n // ids.size
        return DofSet(np.repeat(ids, each), np.tile(np.arange(1, each + 1), ids.size))
    return _equations(path, lines, n)


def _dense(path: Path) -> Matrix:
    vector = read_matrix_market(path)
    if min(vector.shape) != 1:
        raise ReadError(path, f"has shape {vector.shape}; a vector of node ids is needed")
    return np.asarray(vector.todense()) if hasattr(vector, "todense") else vector


def _equations(path: Path, lines: list[str], n: int) -> DofSet:
    found: dict[int, tuple[int, int]] = {}
    for number, line in enumerate(lines, 1):
        fields = line.split()
        if len(fields) != 3 or fields[2].upper() not in DIRECTIONS or not (fields[0].isdigit() and fields[1].isdigit()):
            continue  # headings
        if not 1 <= int(fields[0]) <= n or int(fields[0]) in found or len(fields[1]) > 15:
            raise ReadError(path, f"has equation {fields[0][:20]} of {n} (or has it twice)", record=f"line {number}")
        found[int(fields[0])] = (int(fields[1]), DIRECTIONS[fields[2].upper()])
    if len(found) != n:
        raise ReadError(path, f"names {len(found)} of {n} equations")
    return DofSet.of([found[i] for i in range(1, n + 1)])


def read_coordinates(path: Path) -> Nodes:
    """Node ids and positions from lines "node x y z", tab or blank separated, with decimal points or commas."""
    lines = read_lines(path)
    kept = [(i, line) for i, line in enumerate(lines, 1) if line.strip()[:1].isdigit()]
    first = kept[0][0] if kept else 1
    decimal = all("," in line and ("\t" in line or " " in line.strip()) for _, line in kept)
    table = number_table(path, [line.replace(",", ".") if decimal else line for _, line in kept], 4, first)
    return Nodes(ids=integers(path, table[:, 0], "node"), positions=table[:, 1:])


FORMAT = Format(
    name="ansys_matrices",
    description="Ansys matrices as Matrix Market text, with the mapping of their rows",
    suffixes=(".txt", ".mmf"),
    sniff=sniff,
    tested_against="ANSYS",
    readers={"read_model": read_model},
)
