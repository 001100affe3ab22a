"""Which DOF the rows of a Nastran superelement are: EXTRN, ASET, BSET, QSET and SECONCT entries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.bulk import Card
from flexplant.io.parse.coordinates import Geometry
from flexplant.model.dofs import DofSet

GEOMETRY_CARDS = ("GRID", "SPOINT", "CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")


def row_dofs(op4: Path, cards: list[Card]) -> tuple[DofSet, Any]:
    """DOF of the rows in order, and which of them are modal."""
    listed = [c for c in cards if c.name == "EXTRN"]
    if listed:
        pairs = [pair for card in listed for pair in card_pairs(card)]
    else:
        _refuse_dmig(op4, cards)
        single = {p for c in cards if c.name in ("ASET", "BSET") for p in card_pairs(c)}
        pairs = sorted(single | listed_pairs(cards, "ASET1", "BSET1"))
        pairs = pairs or _from_seconct(cards)
    if not pairs:
        raise ReadError(op4, "the files beside it have no EXTRN, ASET or SECONCT entry to say which DOF the rows are")
    held = {p for c in cards if c.name == "QSET" for p in card_pairs(c)} | listed_pairs(cards, "QSET1")
    dofs = DofSet.of(pairs)
    return dofs, np.array([d == 0 or (n, d) in held for n, d in dofs.pairs], dtype=bool)


def _refuse_dmig(op4: Path, cards: list[Card]) -> None:
    """Entries of a superelement of its own, whose ASET has another order, say nothing about the rows of these matrices."""
    if any(c.name == "DMIG" for c in cards):
        raise ReadError(
            op4,
            "the .pch beside it holds matrices of its own (DMIG) and no EXTRN entry, so nothing says which DOF the rows are; put "
            "the .pch that was written with it there, or read the .pch itself with format='nastran_dmig'",
        )


def card_pairs(card: Card) -> list[tuple[int, int]]:
    """(id, component) of EXTRN, ASET and QSET cards: pairs of fields, several components a field."""
    out = []
    for at in range(0, len(card.fields), 2):
        if card.text(at):
            digits = card.text(at + 1) or "0"
            if not digits.isdigit():
                raise card.fail(f"has components {digits!r}")
            out += [(card.integer(at), int(d)) for d in digits]
    return out


def listed_pairs(cards: list[Card], *names: str) -> set[tuple[int, int]]:
    """(id, component) of ASET1, QSET1 cards: components first, then ids."""
    return {(i, int(d)) for c in cards if c.name in names for d in str(c.integer(0, 0)) for i in c.ids(1)}


def _from_seconct(cards: list[Card]) -> list[tuple[int, int]]:
    """Without a `.pch`: all six components of the connected grids, then the scalar points (ascending)."""
    geometry = Geometry.of(card for card in cards if card.name in GEOMETRY_CARDS)
    return [(g, d) for g in sorted(geometry.grids) for d in range(1, 7)] + [(s, 0) for s in sorted(geometry.scalars)]


def modal_ids(dofs: DofSet, modal: Any) -> list[int]:
    """SPOINT id; grid-held modal coordinates get 10 id + component."""
    rows = zip(dofs.node[modal].tolist(), dofs.direction[modal].tolist(), strict=True)
    return [node if direction == 0 else 10 * node + direction for node, direction in rows]
