"""Ansys' binary .full file: stiffness, mass and damping of a modal analysis, with the node and direction of every row.

DOF that are fixed in the run are left out, as Ansys' own *SMAT does; source["unused"] names their nodes. Unsymmetric, complex
and distributed matrices, constraint equations, and matrices with scaled rows are refused with what to do instead. The file has
no positions: coordinates= is what NLIST prints, or "node x y z" a line. DOF are along the nodal coordinate systems, whose angles
NLIST prints too.
"""

from __future__ import annotations

from pathlib import Path

from flexplant.io.formats import Format
from flexplant.io.parse.ansys_binary import binary_kind
from flexplant.io.parse.ansys_full import FullMatrices, read_full
from flexplant.io.parse.ansys_mapping import read_coordinates
from flexplant.io.parse.files import provenance
from flexplant.io.parse.listed_rows import listed_model
from flexplant.io.parse.names import name_from
from flexplant.model.component import FiniteElementModel

SHOWN = 8


def sniff(head: bytes, path: Path) -> bool:  # noqa: ARG001  every sniff function has it
    """An Ansys binary file of number 4."""
    return binary_kind(head) == ".full"


def read_model(
    path: Path, *, name: str | None = None, coordinates: str | Path | None = None, geometry: str | Path | None = None
) -> FiniteElementModel:
    """The model of the free DOF; coordinates (or geometry, as in studies): NLIST's listing, or a table "node x y z"."""
    coordinates = geometry if coordinates is None else coordinates
    found = read_full(path)
    others = () if coordinates is None else (Path(coordinates),)
    source = provenance(path, FORMAT.name, __name__, others)
    source["unused"] = _fixed(found)
    nodes = None if coordinates is None else read_coordinates(Path(coordinates))
    return listed_model(path, found.matrices, found.dofs, nodes, name or name_from(path), source)


def _fixed(found: FullMatrices) -> list[str]:
    nodes = sorted({node for node, _ in found.fixed})
    if not nodes:
        return []
    shown = ", ".join(map(str, nodes[:SHOWN])) + (", ..." if len(nodes) > SHOWN else "")
    return [f"{len(found.fixed)} DOF fixed in the run, at nodes {shown}"]


FORMAT = Format(
    name="ansys_full",
    description="Ansys binary .full file (symbolic assembly)",
    suffixes=(".full",),
    sniff=sniff,
    tested_against="ANSYS 15; ansys-mapdl-reader 0.56",
    readers={"read_model": read_model},
)
