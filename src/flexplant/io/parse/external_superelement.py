"""External superelements of Nastran: matrices by name (from OUTPUT4 or OUTPUT2) and the cards that say what their rows are.

Recovery matrices keep their names in lower case (mug1, mef1, mes1, ...). Labels: "45.1" for grid 45, component 1; a
scalar point takes six rows of which the first, "1995002.0", is the value and the rest are the table's padding; element rows are
"CBAR.10.1" (element type, element id, place in the element's own list of forces or stresses), "type34.." for types
without a name here; rows without a table are "1", "2", ...
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.bulk import Card, read_cards
from flexplant.io.parse.coordinates import Geometry
from flexplant.io.parse.dti import recovery_tables
from flexplant.io.parse.files import provenance
from flexplant.io.parse.names import name_from
from flexplant.io.parse.recovery_notes import Note, read_notes
from flexplant.io.parse.structural import check_choice, present, taken
from flexplant.io.parse.superelement_dofs import GEOMETRY_CARDS, modal_ids, row_dofs
from flexplant.model.arrays import Matrix, is_sparse
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.model.recovery import Recovery

NAMES = {"stiffness": ("KXX", "KAA"), "mass": ("MXX", "MAA"), "viscous": ("BXX", "BAA"), "structural": ("K4XX", "K4AA")}
RECOVERY = ("MUG1", "MEF1", "MES1", "MQG1", "MQMG1", "MEE1", "MGF1")


def external_superelement(
    path: Path, matrices: dict[str, Matrix], beside: tuple[Path, ...], name: str | None, structural: str, made_by: tuple[str, str]
) -> Component:
    """The component; beside: the `.pch` and `.asm` that there are; made_by: format and reader, for the provenance.

    structural: see `flexplant.io.parse.structural`. Raises ReadError where the matrices and the cards do not fit together,
    InputError for another `structural`.
    """
    check_choice(structural)
    matrices = {k: m for k, m in matrices.items() if present(m) is not None}
    cards = [card for file in beside for card in read_cards(file)]
    dofs, modal = row_dofs(path, cards)
    order = np.r_[np.flatnonzero(~modal), np.flatnonzero(modal)]
    used = {kind: _square(path, matrices, names, len(dofs)) for kind, names in NAMES.items()}
    for kind in ("stiffness", "mass"):
        if used[kind] is None:
            raise ReadError(path, f"has no {kind} matrix {' or '.join(NAMES[kind])}; it holds {', '.join(matrices)}")
    loss = taken(path, used["structural"], structural, "K4")
    recovery = _recovery(path, matrices, cards, order, read_notes(*beside))
    boundary = DofSet(dofs.node[~modal], dofs.direction[~modal])
    geometry = Geometry.of(card for card in cards if card.name in GEOMETRY_CARDS)
    left_out = () if loss is not None else NAMES["structural"]
    known = {n for names in NAMES.values() for n in names if n not in left_out} | set(recovery)
    source = provenance(path, *made_by, beside)
    source["unused"] = [f"{k} {m.shape}" for k, m in matrices.items() if k not in known]
    return Component(
        name=name or name_from(path),
        mass=_ordered(used["mass"], order),
        stiffness=_ordered(used["stiffness"], order),
        damping=None if used["viscous"] is None else _ordered(used["viscous"], order),
        structural_damping=None if loss is None else _ordered(loss, order),
        boundary=boundary,
        nodes=geometry.nodes(boundary.nodes),
        recovery={r.name: r for r in recovery.values()},
        modal_ids=modal_ids(dofs, modal),
        source=source,
    )


def _square(path: Path, matrices: dict[str, Matrix], names: tuple[str, ...], n: int) -> Matrix | None:
    found = next((name for name in names if name in matrices), None)
    if found is None:
        return None
    matrix = matrices[found]
    if matrix.shape != (n, n):
        raise ReadError(path, f"{found} has shape {matrix.shape}, but the files beside it list {n} DOF", record=found)
    if np.iscomplexobj(matrix):
        raise ReadError(path, f"{found} is complex; real matrices are needed", record=found)
    return matrix


def _ordered(matrix: Matrix, order: Any) -> Matrix:
    return matrix.tocsr()[order][:, order] if is_sparse(matrix) else matrix[np.ix_(order, order)]


def _recovery(
    path: Path, matrices: dict[str, Matrix], cards: list[Card], order: Any, notes: dict[str, Note]
) -> dict[str, Recovery]:
    """By matrix; what the comments say of one goes before its table."""
    tables = recovery_tables(cards)
    out = {}
    for name, matrix in matrices.items():
        table, note = tables.get("T" + name[1:]), notes.get(name)
        if not name.startswith("M") or name in NAMES["mass"] or not (table or note or name in RECOVERY):
            continue
        if matrix.shape[1] != len(order) or np.iscomplexobj(matrix):
            raise ReadError(path, f"{name} has shape {matrix.shape}, {len(order)} real columns are needed", record=name)
        columns = matrix.tocsc()[:, order] if is_sparse(matrix) else matrix[:, order]
        labels = table.labels(matrix.shape[0]) if table else [str(i + 1) for i in range(matrix.shape[0])]
        out[name] = note.recovery(path, columns) if note else Recovery(name.lower(), labels, displacement=columns)
    return out
