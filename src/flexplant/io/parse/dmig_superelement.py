"""A component from DMIG entries and the cards that say which DOF there are, wherever the entries come from.

K10, M10, B10, K410 (or KAAX, MAAX, BAAX, K4AAX): stiffness, mass, viscous and structural damping of form 6, one triangle.
ASET, BSET and QSET entries say which DOF there are: rows that are all zero (massless rotations) are not in DMIG and are put
back; without such entries the DOF are those that occur. Scalar points and the q-set are modal. MUG1T, MES1T, MEF1T, ... are
recovery matrices, stored transposed; DTI tables label their rows.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.bulk import Card
from flexplant.io.parse.coordinates import Geometry
from flexplant.io.parse.dmig import RECTANGULAR, Dmig, dmig_matrices
from flexplant.io.parse.dti import recovery_tables
from flexplant.io.parse.files import provenance
from flexplant.io.parse.names import name_from
from flexplant.io.parse.recovery_notes import Note
from flexplant.io.parse.structural import check_choice, taken
from flexplant.io.parse.superelement_dofs import GEOMETRY_CARDS, card_pairs, listed_pairs, modal_ids
from flexplant.model.arrays import dense
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.model.recovery import Recovery


def dmig_component(
    path: Path,
    cards: list[Card],
    *,
    name: str | None,
    suffix: str | None,
    structural: str,
    made_by: tuple[str, str],
    beside: tuple[Path, ...] = (),
    selected: str | None = None,
    notes: dict[str, Note] | None = None,
) -> Component:
    """The component; suffix and structural as in `read_component` of the formats; made_by: format and reader, for provenance.

    notes: what comments say of recovery matrices.
    selected: the name that case control selects as structural damping (K42GG), where it does.
    """
    check_choice(structural)
    matrices = dmig_matrices(cards)
    found = _suffix(path, matrices, suffix)
    used = {kind: matrices.get(letter + found) for kind, letter in (("mass", "M"), ("stiffness", "K"), ("damping", "B"))}
    used["structural_damping"] = _structural(path, matrices, f"K4{found}", selected, structural)
    dofs, n_boundary = _dofs(cards, [m for m in used.values() if m is not None])
    modal = np.arange(len(dofs)) >= n_boundary
    boundary = DofSet(dofs.node[~modal], dofs.direction[~modal])
    geometry = Geometry.of(card for card in cards if card.name in GEOMETRY_CARDS)
    square: dict[str, Any] = {kind: None if m is None else dense(m.square(dofs)) for kind, m in used.items()}
    recovery = _recovery(path, matrices, cards, dofs, notes or {})
    known = {m.name for m in used.values() if m is not None} | set(recovery)
    return Component(
        name=name or name_from(path),
        **square,
        boundary=boundary,
        nodes=geometry.nodes(boundary.nodes) if geometry.grids else None,
        recovery={r.name: r for r in recovery.values()},
        modal_ids=modal_ids(dofs, modal),
        source=provenance(path, *made_by, beside) | {"unused": [n for n in matrices if n not in known]},
    )


def _structural(path: Path, matrices: dict[str, Dmig], usual: str, selected: str | None, structural: str) -> Dmig | None:
    """K4 with the suffix of the others, or what case control selects as K42GG; ReadError where that is missing or another."""
    if selected in (None, usual):
        return taken(path, matrices.get(usual), structural, usual)
    if structural == "read" and (selected not in matrices or usual in matrices):
        problem = f"has {usual} too" if usual in matrices else f"has the DMIG matrices {', '.join(matrices)}"
        raise ReadError(
            path, f"selects the structural damping K42GG = {selected}, but {problem}; structural='ignore' does without"
        )
    return taken(path, matrices.get(str(selected)), structural, str(selected))


def _suffix(path: Path, matrices: dict[str, Dmig], asked: str | None) -> str:
    square = [n for n, m in matrices.items() if m.form not in RECTANGULAR]
    found = [n[1:] for n in square if n[0] == "M" and "K" + n[1:] in square]
    if asked is not None:
        found = [s for s in found if s == asked.upper()]
    if len(found) != 1:
        what = f"with the suffix {asked!r}" if asked is not None else "such as K10 and M10"
        problem = (
            "no pair of square matrices" if not found else f"{len(found)} pairs ({', '.join(found)}; pass suffix=) of matrices"
        )
        raise ReadError(path, f"has {problem} {what}; DMIG matrices: {', '.join(matrices) or 'none'}")
    return found[0]


def _dofs(cards: list[Card], matrices: list[Dmig]) -> tuple[DofSet, int]:
    """DOF of the component, boundary first, each part ascending; and how many are boundary."""
    held = {p for c in cards if c.name == "QSET" for p in card_pairs(c)} | listed_pairs(cards, "QSET1")
    listed = {p for c in cards if c.name in ("ASET", "BSET") for p in card_pairs(c)} | listed_pairs(cards, "ASET1", "BSET1")
    pairs = listed | held | {p for m in matrices for p in m.rows_used()} if not listed else listed | held
    modal = {p for p in pairs if p in held or p[1] == 0}
    return DofSet.of(sorted(pairs - modal) + sorted(modal)), len(pairs) - len(modal)


def _recovery(
    path: Path, matrices: dict[str, Dmig], cards: list[Card], dofs: DofSet, notes: dict[str, Note]
) -> dict[str, Recovery]:
    """Transposed recovery matrices that have row labels, by matrix; those in comments go before a table."""
    tables, out = recovery_tables(cards), {}
    for name, matrix in matrices.items():
        table = tables.get("T" + name[1:-1]) if name.startswith("M") and name.endswith("T") else None
        note = notes.get(name)
        if (table is None and note is None) or matrix.form not in RECTANGULAR:
            continue
        rows = dense(matrix.transposed(dofs))
        if note is not None:
            out[name] = note.recovery(path, rows)
        elif table is not None:
            out[name] = Recovery(name=name[:-1].lower(), labels=table.labels(rows.shape[0]), displacement=rows)
    return out
