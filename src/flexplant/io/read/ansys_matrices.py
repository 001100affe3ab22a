"""Ansys matrices as Matrix Market text (`*EXPORT, ..., MMF`) with the table that says which DOF the rows are.

The table is either the vector of node ids (`*EXPORT` of `*VEC,,I,IMPORT,FULL,,BACK`: one id for each block of rows, where all
nodes have the same free DOF) or the mapping text of HBMAT (`equation  node  UX`). Rows are not in node order. Coordinates: a
table "node x y z", decimal commas allowed, or none. docs/formats.md has the lines that write all four.
"""

from __future__ import annotations

from pathlib import Path

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.ansys_mapping import read_coordinates, read_mapping
from flexplant.io.parse.files import provenance
from flexplant.io.parse.matrix_market import looks_like_matrix_market, read_matrix_market
from flexplant.io.parse.names import name_from
from flexplant.io.parse.partner_files import maybe_partner, partner
from flexplant.model.arrays import Matrix
from flexplant.model.component import FiniteElementModel

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
    geometry: str | Path | None = None,
) -> FiniteElementModel:
    """The model from its stiffness file; the other files are found by name where "StiffnessMatrixSparse" is in this one's.

    mass, mapping, coordinates (or geometry, as in studies): their files (…MassMatrixSparse, …MatrixDofMappingVector,
    …NodalCoordinates).
    """
    coordinates = geometry if coordinates is None else coordinates
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


FORMAT = Format(
    name="ansys_matrices",
    description="Ansys matrices as Matrix Market text, with the mapping of their rows",
    suffixes=(".txt", ".mmf"),
    sniff=sniff,
    tested_against="ANSYS",
    readers={"read_model": read_model},
)
