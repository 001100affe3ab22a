"""Nastran OUTPUT2 superelements: tables of a NAS2CAM run with its `.op4`, DMIG entries, or matrices.

NAS2CAM: `.op2` has SLIST, USET, EQEXIN, CSTM and BGPDT of each superelement, the `.op4` with the same stem its maa, kaa (baa,
k4aa).
EXTSEOUT with DMIGOP2: DMIG entries, which name their DOF; `.asm` and `.pch` with the same stem add sets and positions
(`flexplant.io.parse.dmig_superelement`). Matrices KAA or KXX, MAA or MXX, ... with `.asm` and `.pch` that say what the rows are:
as for `.op4` (`flexplant.io.parse.external_superelement`). Others: a sidecar does, see `flexplant.io.parse.sidecar`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.bulk import read_cards
from flexplant.io.parse.dmig_superelement import dmig_component
from flexplant.io.parse.external_superelement import external_superelement
from flexplant.io.parse.files import provenance, sibling
from flexplant.io.parse.listed_rows import listed_component
from flexplant.io.parse.names import name_from
from flexplant.io.parse.nas2cam import superelements
from flexplant.io.parse.op2 import looks_like_op2, read_op2_matrices
from flexplant.io.parse.op2_dmig import read_dmig_cards
from flexplant.io.parse.op4 import read_op4_sequence
from flexplant.io.parse.plain_matrices import component_of
from flexplant.io.parse.sidecar import find_sidecar, sidecar_path
from flexplant.io.parse.structural import check_choice, present, taken
from flexplant.model.arrays import Matrix
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes

KINDS = {"mass": "MAA", "stiffness": "KAA", "damping": "BAA", "structural_damping": "K4AA"}
START = "SE_START"


def sniff(head: bytes, path: Path) -> bool:  # noqa: ARG001  every sniff function has it
    """The tape label of OUTPUT2."""
    return looks_like_op2(head)


def read_component(
    path: Path,
    *,
    name: str | None = None,
    superelement: int | None = None,
    sidecar: str | Path | None = None,
    suffix: str | None = None,
    structural: str = "read",
) -> Component:
    """A component; superelement: its id where the file has several. sidecar: for matrices in the `.op2` itself.

    suffix: of the names of DMIG matrices where a file holds several sets. structural: "read" structural damping K4 as
    D of K + i D, "ignore" it, or "error".
    """
    if sidecar is not None or sidecar_path(path) is not None:
        return component_of(path, read_op2_matrices(path), find_sidecar(path, sidecar), name, FORMAT.name)
    op4 = sibling(path, ".op4")
    if op4 is not None:
        return _nas2cam(path, op4, name, superelement, structural)
    beside = tuple(file for file in (sibling(path, ".pch"), sibling(path, ".asm")) if file is not None)
    made_by = (FORMAT.name, __name__)
    entries = read_dmig_cards(path)
    if entries:
        cards = entries + [card for file in beside for card in read_cards(file)]
        return dmig_component(path, cards, name=name, suffix=suffix, structural=structural, made_by=made_by, beside=beside)
    if not beside:
        raise ReadError(
            path,
            "needs files with the same stem that say what its rows are: .asm and .pch (EXTSEOUT), "
            ".op4 (NAS2CAM), or a sidecar .yaml that names its matrices",
        )
    return external_superelement(path, read_op2_matrices(path), beside, name, structural, made_by)


def _nas2cam(path: Path, op4: Path, name: str | None, superelement: int | None, structural: str) -> Component:
    check_choice(structural)
    tables = superelements(path)
    chosen = _chosen(path, [i for i in tables if i], superelement)
    table = tables[chosen]
    matrices = _sections(op4, list(tables))[chosen]
    for kind in ("mass", "stiffness"):
        if matrices[kind] is None:
            raise ReadError(op4, f"has no {KINDS[kind]} for superelement {chosen}")
    matrices["structural_damping"] = taken(op4, present(matrices["structural_damping"]), structural, "K4AA")
    direction = table.dofs.direction.copy()
    direction[table.modal] = 0
    mass = matrices["mass"]
    kept = table.rows(len(direction) if mass is None else mass.shape[0])
    dofs = DofSet(table.dofs.node[kept], direction[kept])
    source = provenance(path, FORMAT.name, __name__, (op4,)) | {"superelement": chosen}
    return listed_component(
        path, matrices, dofs, _boundary_nodes(table.nodes, dofs), name or f"{name_from(path)}_{chosen}", source
    )


def _chosen(path: Path, there: list[int], asked: int | None) -> int:
    if asked is None and len(there) == 1:
        return there[0]
    if asked not in there:
        raise ReadError(path, f"has the superelements {', '.join(map(str, there))}; pass superelement= (got {asked!r})")
    return asked


def _sections(path: Path, ids: list[int]) -> dict[int, dict[str, Matrix | None]]:
    """maa, kaa, baa, k4aa after each se_start, in the order of the ids."""
    sections: list[dict[str, Any]] = []
    for name, matrix in read_op4_sequence(path):
        if name == START:
            sections.append({})
        elif sections:
            sections[-1].setdefault(name, matrix)
    if len(sections) != len(ids):
        raise ReadError(path, f"has {len(sections)} sections ({START.lower()}), the .op2 lists {len(ids)} superelements")
    found = [{kind: section.get(key) for kind, key in KINDS.items()} for section in sections]
    return dict(zip(ids, found, strict=True))


def _boundary_nodes(nodes: Nodes, dofs: DofSet) -> Nodes:
    kept = [i for i, node in enumerate(nodes.ids.tolist()) if node in set(dofs.nodes)]
    frames = None if nodes.frames is None else nodes.frames[kept]
    return Nodes(ids=nodes.ids[kept], positions=nodes.positions[kept], frames=frames)


FORMAT = Format(
    name="nastran_op2",
    description="Nastran superelements in OUTPUT2: NAS2CAM, EXTSEOUT with DMIGOP2, matrices with .asm + .pch or a sidecar",
    sniff=sniff,
    tested_against="NX Nastran 9.1",
    readers={"read_component": read_component},
)
