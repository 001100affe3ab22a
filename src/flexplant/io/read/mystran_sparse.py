"""MYSTRAN's sparse KGG and MGG, the files `.L1L` and `.L1R` that it keeps with ALLFILES KEEP, and the deck they come from.

Fortran records: a time stamp, the count of terms, then row, column, value a term. Rows are six a grid, grids ascending (needs
PARAM,GRIDSEQ,GRID), in the grids' displacement frames. KGG is the structure before SPC, MPC and rigid elements: single-point
constraints are not applied, and a deck with rigid elements or MPC is refused. Rows without any term are left out (AUTOSPC).
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.bulk import Card, read_cards
from flexplant.io.parse.coordinates import Geometry
from flexplant.io.parse.files import provenance, read_bytes, sibling
from flexplant.io.parse.mystran_deck import DECKS, check_sequence, deck_beside
from flexplant.io.parse.names import name_from
from flexplant.io.parse.superelement_dofs import GEOMETRY_CARDS
from flexplant.io.parse.triplets import symmetric_matrix
from flexplant.model.arrays import IntArray, Matrix
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet

TERM = np.dtype([("begin", "<i4"), ("row", "<i4"), ("column", "<i4"), ("value", "<f8"), ("end", "<i4")])
HEAD = struct.Struct("<6i")  # [4, stamp, 4], [4, count, 4]
TIED = ("RBE1", "RBE2", "RBE3", "RBAR", "RROD", "RSPLINE", "MPC", "MPCADD")


def sniff(head: bytes, path: Path) -> bool:
    """A `.L1L` file whose first records are a stamp and a count, and the third a term."""
    if path.suffix.lower() != ".l1l" or len(head) < HEAD.size + 4:
        return False
    a, _, b, c, _, d = HEAD.unpack_from(head)
    return (a, b, c, d) == (4, 4, 4, 4) and struct.unpack_from("<i", head, HEAD.size)[0] == 16


def read_model(path: Path, *, name: str | None = None, geometry: str | Path | None = None) -> FiniteElementModel:
    """The unconstrained model from its `.L1L` file; geometry: the deck, None for .bdf, .dat or .nas with the same stem."""
    mass_file = sibling(path, ".L1R") or sibling(path, ".l1r")
    if mass_file is None:
        raise ReadError(path, "needs the .L1R file (MGG) with the same stem beside it")
    deck = Path(geometry) if geometry is not None else deck_beside(path)
    if deck is None:
        raise ReadError(path, f"needs its deck ({', '.join(DECKS)}) beside it, or geometry=: the rows are only counted")
    cards = read_cards(deck)
    _check_deck(deck, cards)
    nodes = Geometry.of(card for card in cards if card.name in GEOMETRY_CARDS).nodes()
    count = 6 * len(nodes)
    terms = [_terms(path, count), _terms(mass_file, count)]
    used = np.unique(np.concatenate([t[k] for t in terms for k in ("row", "column")]))
    stiffness, mass = (_matrix(path, t, used) for t in terms)
    source = provenance(path, FORMAT.name, __name__, (mass_file, deck))
    source["unused"] = [f"{count - used.size} rows without stiffness and mass"] if used.size < count else []
    dofs = DofSet(np.repeat(nodes.ids, 6)[used - 1], np.tile(np.arange(1, 7), len(nodes))[used - 1])
    return FiniteElementModel(name=name or name_from(path), mass=mass, stiffness=stiffness, dofs=dofs, nodes=nodes, source=source)


def _matrix(path: Path, terms: Any, used: IntArray) -> Matrix:
    rows, columns = (np.searchsorted(used, terms[k]) for k in ("row", "column"))
    return symmetric_matrix(path, rows, columns, terms["value"], used.size)


def _check_deck(deck: Path, cards: list[Card]) -> None:
    """ReadError where the matrices would not be the structure, or their rows not in the order of the grids."""
    tied = sorted({card.name for card in cards if card.name in TIED})
    if tied:
        raise ReadError(deck, f"has {', '.join(tied)}, which KGG leaves out; take KXX, MXX of SOL 31 (OUTPUT4) instead")
    if any(card.name == "SPOINT" for card in cards):
        raise ReadError(deck, "has SPOINT; the rows of scalar points are not read")
    check_sequence(deck, cards)


def _terms(path: Path, n: int) -> Any:
    """row, column (from 1) and value of each term; ReadError with the byte for records that do not fit."""
    data = read_bytes(path)
    if len(data) < HEAD.size:
        raise ReadError(path, "ends within its first two records", offset=len(data))
    *marks, count, last = HEAD.unpack_from(data)
    if (marks[0], marks[2], marks[3], last) != (4, 4, 4, 4):
        raise ReadError(path, "does not begin with the records of a time stamp and a count", offset=0)
    if count < 0 or len(data) != HEAD.size + TERM.itemsize * count:
        raise ReadError(path, f"announces {count} terms, which are not its {len(data) - HEAD.size} bytes", offset=16)
    terms = np.frombuffer(data, TERM, count, HEAD.size)
    inside = (np.minimum(terms["row"], terms["column"]) >= 1) & (np.maximum(terms["row"], terms["column"]) <= n)
    good = inside & (terms["begin"] == 16) & (terms["end"] == 16)
    if not good.all():
        at = int(np.flatnonzero(~good)[0])
        problem = f"term {at + 1} is ({terms['row'][at]}, {terms['column'][at]}) in {n} rows, or no record of 16 bytes"
        raise ReadError(path, problem, offset=HEAD.size + TERM.itemsize * at)
    return terms


FORMAT = Format(
    name="mystran_sparse",
    description="MYSTRAN sparse KGG, MGG: .L1L, .L1R and the deck",
    suffixes=(".L1L",),
    sniff=sniff,
    tested_against="MYSTRAN 18.0",
    readers={"read_model": read_model},
)
