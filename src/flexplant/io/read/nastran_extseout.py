"""Nastran external superelements as EXTSEOUT(ASMBULK,EXTBULK,MATOP4) writes them: `.op4` + `.asm` + `.pch`, one stem.

The `.pch` says which DOF the rows are (EXTRN, ASET) and labels the recovery rows (DTI); `.asm` has the boundary's
grids and coordinate systems (the `.pch` repeats them). Rows with component 0 (SPOINT) or in a QSET are modal.

Recovery matrices keep their names in lower case (mug1, mef1, mes1, ...). Labels: "45.1" for grid 45, component 1; a
scalar point takes six rows of which the first, "1995002.0", is the value and the rest are the table's padding; element rows are
"CBAR.10.1" (element type, element id, place in the element's own list of forces or stresses), "type34.." for types
without a name here; rows without a table are "1", "2", ...
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import InputError, ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.bulk import Card, read_cards
from flexplant.io.parse.coordinates import Geometry
from flexplant.io.parse.dti import recovery_tables
from flexplant.io.parse.files import provenance, sibling
from flexplant.io.parse.names import name_from
from flexplant.io.parse.op4 import looks_like_op4, read_op4
from flexplant.io.parse.sidecar import sidecar_path
from flexplant.io.parse.superelement_dofs import GEOMETRY_CARDS, modal_ids, row_dofs
from flexplant.model.arrays import Matrix, is_sparse
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.model.recovery import Recovery

NAMES = {"stiffness": ("KXX", "KAA"), "mass": ("MXX", "MAA"), "viscous": ("BXX", "BAA"), "structural": ("K4XX", "K4AA")}
RECOVERY = ("MUG1", "MEF1", "MES1", "MQG1", "MQMG1", "MEE1", "MGF1")


def sniff(head: bytes, path: Path) -> bool:
    """An OUTPUT4 file with a `.asm` or `.pch` beside it, or one of these with the `.op4` beside it."""
    if path.suffix.lower() in (".asm", ".pch"):
        return sibling(path, ".op4") is not None
    beside = sibling(path, ".pch") is not None or sibling(path, ".asm") is not None
    return beside and sidecar_path(path) is None and looks_like_op4(head)


def read_component(path: Path, *, name: str | None = None, structural: str = "error") -> Component:
    """The superelement as a component in the file's units.

    structural: what to do with structural damping K4 in the file, which has no place in a real Z: "error" or "ignore".
    Viscous damping becomes the component's damping. Reduced loads (PX) are not part of a component; source["unused"] names
    them with every other matrix that was left out.
    """
    if structural not in ("error", "ignore"):
        raise InputError(f"structural={structural!r}: use 'error' or 'ignore'")
    op4, asm, pch = _files(path)
    matrices = {k: m for k, m in read_op4(op4).items() if not _absent(m)}
    cards = [card for file in (pch, asm) if file for card in read_cards(file)]
    dofs, modal = row_dofs(op4, cards)
    order = np.r_[np.flatnonzero(~modal), np.flatnonzero(modal)]
    used = {kind: _square(op4, matrices, names, len(dofs)) for kind, names in NAMES.items()}
    for kind in ("stiffness", "mass"):
        if used[kind] is None:
            raise ReadError(op4, f"has no {kind} matrix {' or '.join(NAMES[kind])}; it holds {', '.join(matrices)}")
    if used["structural"] is not None and structural != "ignore":
        raise ReadError(op4, "has structural damping (K4); pass structural='ignore' to leave it out, and give modal damping")
    recovery = _recovery(op4, matrices, cards, order)
    boundary = DofSet(dofs.node[~modal], dofs.direction[~modal])
    geometry = Geometry.of(card for card in cards if card.name in GEOMETRY_CARDS)
    known = {n for names in NAMES.values() for n in names} | {r.name.upper() for r in recovery}
    source = provenance(op4, FORMAT.name, __name__, tuple(f for f in (asm, pch) if f))
    source["unused"] = [f"{k} {m.shape}" for k, m in matrices.items() if k not in known]
    return Component(
        name=name or name_from(op4),
        mass=_ordered(used["mass"], order),
        stiffness=_ordered(used["stiffness"], order),
        damping=None if used["viscous"] is None else _ordered(used["viscous"], order),
        boundary=boundary,
        nodes=geometry.nodes(boundary.nodes),
        recovery={r.name: r for r in recovery},
        modal_ids=modal_ids(dofs, modal),
        source=source,
    )


def _files(path: Path) -> tuple[Path, Path | None, Path | None]:
    op4 = path if path.suffix.lower() not in (".asm", ".pch") else sibling(path, ".op4")
    if op4 is None:
        raise ReadError(path, "has no .op4 file with the same stem beside it")
    asm, pch = sibling(path, ".asm"), sibling(path, ".pch")
    if asm is None and pch is None:
        raise ReadError(path, "has neither .pch nor .asm with the same stem beside it; these say which DOF the rows are")
    return op4, asm, pch


def _absent(matrix: Matrix) -> bool:
    """Nastran writes a 1 x 1 zero for what is not there."""
    return bool(matrix.shape == (1, 1) and not abs(matrix).max())


def _square(op4: Path, matrices: dict[str, Matrix], names: tuple[str, ...], n: int) -> Matrix | None:
    found = next((name for name in names if name in matrices), None)
    if found is None:
        return None
    matrix = matrices[found]
    if matrix.shape != (n, n):
        raise ReadError(op4, f"{found} has shape {matrix.shape}, but the files beside it list {n} DOF", record=found)
    if np.iscomplexobj(matrix):
        raise ReadError(op4, f"{found} is complex; real matrices are needed", record=found)
    return matrix


def _ordered(matrix: Matrix, order: Any) -> Matrix:
    return matrix.tocsr()[order][:, order] if is_sparse(matrix) else matrix[np.ix_(order, order)]


def _recovery(op4: Path, matrices: dict[str, Matrix], cards: list[Card], order: Any) -> list[Recovery]:
    tables = recovery_tables(cards)
    out = []
    for name, matrix in matrices.items():
        table = tables.get("T" + name[1:])
        if not name.startswith("M") or (table is None and name not in RECOVERY) or name in NAMES["mass"]:
            continue
        if matrix.shape[1] != len(order) or np.iscomplexobj(matrix):
            raise ReadError(op4, f"{name} has shape {matrix.shape}, {len(order)} real columns are needed", record=name)
        labels = table.labels(matrix.shape[0]) if table else [str(i + 1) for i in range(matrix.shape[0])]
        columns = matrix.tocsc()[:, order] if is_sparse(matrix) else matrix[:, order]
        out.append(Recovery(name=name.lower(), labels=labels, displacement=columns))
    return out


FORMAT = Format(
    name="nastran_extseout",
    description="Nastran external superelement, EXTSEOUT with MATOP4: .op4 + .asm + .pch",
    suffixes=(".op4", ".OP4"),
    sniff=sniff,
    tested_against="NX Nastran 9.1, MSC Nastran",
    readers={"read_component": read_component},
)
