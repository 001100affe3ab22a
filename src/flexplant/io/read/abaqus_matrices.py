"""Abaqus global matrices: `*MATRIX GENERATE` with `*MATRIX OUTPUT, FORMAT=COORDINATE` or `MATRIX INPUT`, two `.mtx` files.

COORDINATE: "row column value" a line; rows count the DOF of the nodes in ascending order of their numbers, so the `.inp`
(or dofs_per_node) is needed. MATRIX INPUT: "node, dof, node, dof, value" a line. Internal nodes (negative) are refused.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexplant.errors import InputError, ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.abaqus_input import deck_beside, nodes_at, read_nodes
from flexplant.io.parse.files import provenance
from flexplant.io.parse.names import name_from
from flexplant.io.parse.number_text import integers, number_table, read_lines
from flexplant.io.parse.partner_files import partner
from flexplant.io.parse.triplets import check_covers, symmetric_matrix
from flexplant.model.arrays import FloatArray, IntArray, Matrix
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes


def sniff(head: bytes, path: Path) -> bool:
    """A `.mtx` file whose first data line has 3 or 5 numbers."""
    if path.suffix.lower() != ".mtx" or head.startswith(b"%%") or b"\x00" in head:
        return False
    first = next((line for line in head.split(b"\n") if line.strip() and not line.startswith(b"**")), b"")
    return len(first.replace(b",", b" ").split()) in (3, 5) and first.lstrip()[:1].isdigit()


def read_model(
    path: Path,
    *,
    name: str | None = None,
    mass: str | Path | None = None,
    geometry: str | Path | None = None,
    dofs_per_node: int | None = None,
    stiffness_factor: float = 1.0,
) -> FiniteElementModel:
    """The model from its stiffness file.

    mass: its file, None for the name with MASS in place of STIF. geometry: the `.inp`, None for the one whose stem begins
    this file's name. dofs_per_node: 3 or 6, None takes it from the number of nodes. stiffness_factor: multiplies the
    stiffness, for a file that was written with a scaled modulus; `source` states it.
    """
    mass_file = partner(path, mass, "STIF", "MASS", "mass")
    geometry_file = Path(geometry) if geometry is not None else deck_beside(path)
    nodes = None if geometry_file is None else read_nodes(geometry_file)
    stiffness, masses = _entries(path), _entries(mass_file)
    if stiffness.shape[1] != masses.shape[1]:
        raise ReadError(mass_file, f"has {masses.shape[1]} numbers a line, the stiffness file {stiffness.shape[1]}")
    if stiffness.shape[1] == 3:
        n = int(stiffness[:, :2].max(initial=0))
        dofs = _counted_dofs(path, n, nodes, dofs_per_node)
    else:
        dofs = _labelled_dofs(path, stiffness)
    used = None if nodes is None else nodes_at(path, nodes, dofs)
    others = (mass_file,) if geometry_file is None else (mass_file, geometry_file)
    return FiniteElementModel(
        name=name or name_from(path),
        mass=_matrix(mass_file, masses, dofs),
        stiffness=_matrix(path, stiffness, dofs) * stiffness_factor,
        dofs=dofs,
        nodes=used,
        source=provenance(path, FORMAT.name, __name__, others) | {"stiffness_factor": stiffness_factor},
    )


def _entries(path: Path) -> FloatArray:
    lines = [line for line in read_lines(path) if not line.startswith("*")]
    first = next((line for line in lines if line.strip()), "")
    width = len(first.replace(",", " ").split())
    if width not in (3, 5):
        raise ReadError(path, "is no *MATRIX OUTPUT text: 3 (COORDINATE) or 5 (MATRIX INPUT) numbers a line are needed")
    return number_table(path, lines, width)


def _counted_dofs(path: Path, n: int, nodes: Nodes | None, asked: int | None) -> DofSet:
    if asked is not None and asked not in range(1, 7):
        raise InputError(f"dofs_per_node={asked!r}: use 1 to 6")
    count = None if nodes is None else len(nodes)
    each = asked or (n // count if count else None)
    if each is None:
        raise ReadError(path, "rows are only counted; pass geometry= (the .inp with the nodes) or dofs_per_node=")
    if each == 0 or n % each or each > 6 or (count is not None and n != count * each):
        known = "" if count is None else f" of {count} nodes"
        raise ReadError(path, f"has {n} rows, which are not {each} DOF for each{known}")
    ids = np.arange(1, n // each + 1) if nodes is None else nodes.ids
    return DofSet(np.repeat(ids, each), np.tile(np.arange(1, each + 1), len(ids)))


def _labelled_dofs(path: Path, entries: FloatArray) -> DofSet:
    pairs = np.unique(np.vstack([_pairs(path, entries, at) for at in (0, 2)]), axis=0)
    if pairs[:, 1].max() > 6:
        raise ReadError(path, f"has the DOF {pairs[pairs[:, 1].argmax()].tolist()}; 1 to 6 can be used")
    return DofSet(pairs[:, 0], pairs[:, 1])


def _pairs(path: Path, entries: FloatArray, at: int) -> IntArray:
    return np.column_stack([integers(path, entries[:, at], "node"), integers(path, entries[:, at + 1], "DOF")])


def _matrix(path: Path, entries: FloatArray, dofs: DofSet) -> Matrix:
    n = len(dofs)
    if entries.shape[1] == 3:
        rows, columns = (integers(path, entries[:, k], what) - 1 for k, what in ((0, "row"), (1, "column")))
    else:
        rows, columns = (_places(path, _pairs(path, entries, at), dofs) for at in (0, 2))
    matrix = symmetric_matrix(path, rows, columns, entries[:, -1], n)
    check_covers(path, matrix, n)
    return matrix


def _places(path: Path, pairs: IntArray, dofs: DofSet) -> IntArray:
    keys, wanted = dofs.node * 10 + dofs.direction, pairs[:, 0] * 10 + pairs[:, 1]
    at = np.minimum(np.searchsorted(keys, wanted), keys.size - 1)
    if (keys[at] != wanted).any():
        raise ReadError(
            path, f"has the DOF {pairs[np.flatnonzero(keys[at] != wanted)[0]].tolist()}, which the stiffness does not"
        )
    return np.asarray(at)


FORMAT = Format(
    name="abaqus_matrices",
    description="Abaqus global matrices, *MATRIX OUTPUT: two .mtx files and the .inp",
    suffixes=(".mtx",),
    sniff=sniff,
    tested_against="Abaqus 2019",
    readers={"read_model": read_model},
)
