"""Nastran superelements as DMIG entries: EXTSEOUT(...,DMIGPCH) `.pch`, OptiStruct's PARAM,EXTOUT,DMIGPCH, or hand-made decks.

K10, M10, B10, K410 (or KAAX, MAAX, BAAX, K4AAX): stiffness, mass, viscous and structural damping of form 6, one triangle.
ASET, BSET and QSET entries say which DOF there are: rows that are all zero (massless rotations) are not in DMIG and are put
back; without such entries the DOF are those that occur. Scalar points and the q-set are modal. MUG1T, MES1T, MEF1T, ... are
recovery matrices, stored transposed; DTI tables label their rows as in `nastran_extseout`.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import InputError, ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.bulk import Card, read_cards
from flexplant.io.parse.coordinates import Geometry
from flexplant.io.parse.dmig import RECTANGULAR, Dmig, dmig_matrices
from flexplant.io.parse.dti import recovery_tables
from flexplant.io.parse.files import provenance, sibling
from flexplant.io.parse.names import name_from
from flexplant.io.parse.superelement_dofs import GEOMETRY_CARDS, card_pairs, listed_pairs, modal_ids
from flexplant.model.arrays import Matrix, dense
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.model.recovery import Recovery

DMIG_LINE = re.compile(rb"^DMIG\b", re.MULTILINE)
PUNCH_LINE = re.compile(rb"^(\$ STANDARD PUNCH|BEGIN +SUPER|ASET|GRID|SPOINT)", re.MULTILINE)
HEAD = 65536  # the first DMIG may come after long comments and geometry


def sniff(head: bytes, path: Path) -> bool:
    """Text with DMIG entries, in a file without an OUTPUT4 file beside it."""
    if b"\x00" in head or sibling(path, ".op4") is not None:
        return False
    if DMIG_LINE.search(head):
        return True
    if not PUNCH_LINE.search(head):
        return False
    with path.open("rb") as stream:
        return bool(DMIG_LINE.search(stream.read(HEAD)))


def read_component(path: Path, *, name: str | None = None, suffix: str | None = None, structural: str = "error") -> Component:
    """The superelement as a component in the file's units.

    suffix: of the matrices' names where a file holds several sets, such as "10" for K10, M10. structural: what to do with
    structural damping (K410), "error" or "ignore". source["unused"] names the matrices that were left out.
    """
    if structural not in ("error", "ignore"):
        raise InputError(f"structural={structural!r}: use 'error' or 'ignore'")
    cards = read_cards(path)
    matrices = dmig_matrices(cards)
    found = _suffix(path, matrices, suffix)
    used = {kind: matrices.get(letter + found) for kind, letter in (("mass", "M"), ("stiffness", "K"), ("damping", "B"))}
    if f"K4{found}" in matrices and structural != "ignore":
        raise ReadError(path, f"has structural damping K4{found}; pass structural='ignore' and give modal damping")
    dofs, n_boundary = _dofs(cards, [m for m in used.values() if m is not None])
    modal = np.arange(len(dofs)) >= n_boundary
    boundary = DofSet(dofs.node[~modal], dofs.direction[~modal])
    geometry = Geometry.of(card for card in cards if card.name in GEOMETRY_CARDS)
    square: dict[str, Any] = {kind: None if m is None else dense(m.square(dofs)) for kind, m in used.items()}
    recovery = _recovery(matrices, cards, dofs)
    known = {m.name for m in used.values() if m is not None} | {f"{r.name.upper()}T" for r in recovery}
    return Component(
        name=name or name_from(path),
        **square,
        boundary=boundary,
        nodes=geometry.nodes(boundary.nodes) if geometry.grids else None,
        recovery={r.name: r for r in recovery},
        modal_ids=modal_ids(dofs, modal),
        source=provenance(path, FORMAT.name, __name__) | {"unused": [n for n in matrices if n not in known]},
    )


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


def _recovery(matrices: dict[str, Dmig], cards: list[Card], dofs: DofSet) -> list[Recovery]:
    """Transposed recovery matrices that have a table of row labels."""
    tables, out = recovery_tables(cards), []
    for name, matrix in matrices.items():
        table = tables.get("T" + name[1:-1]) if name.startswith("M") and name.endswith("T") else None
        if table is None or matrix.form not in RECTANGULAR:
            continue
        rows: Matrix = matrix.transposed(dofs)
        out.append(Recovery(name=name[:-1].lower(), labels=table.labels(rows.shape[0]), displacement=dense(rows)))
    return out


FORMAT = Format(
    name="nastran_dmig",
    description="Nastran DMIG superelement, EXTSEOUT with DMIGPCH: .pch",
    sniff=sniff,
    tested_against="MSC Nastran 2019",
    readers={"read_component": read_component},
)
