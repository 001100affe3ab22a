"""MYSTRAN's Craig-Bampton models: OUTPUT4 of KXX and MXX from a SOL 31 run (`.OU1` ... `.OU9`), with the deck beside it.

The rows are the DOF of the deck's SUPORT entries, by ascending grid and component, then the modes (needs PARAM,GRIDSEQ,GRID). A
sidecar with the same stem says what the rows are instead (format `output4`).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.bulk import read_cards
from flexplant.io.parse.coordinates import Geometry
from flexplant.io.parse.files import provenance
from flexplant.io.parse.mystran_deck import DECKS, check_sequence, deck_beside, is_reduction
from flexplant.io.parse.names import name_from
from flexplant.io.parse.op4 import looks_like_op4, read_op4
from flexplant.io.parse.sidecar import sidecar_path
from flexplant.io.parse.superelement_dofs import GEOMETRY_CARDS, card_pairs
from flexplant.model.arrays import FloatArray, Matrix, dense
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet

UNIT = re.compile(r"\.ou[1-9]$", re.IGNORECASE)
NAMES = {"stiffness": ("KXX", "KRRGN"), "mass": ("MXX", "MRRGN")}
COUPLED = 1e-6  # of the stiffness between boundary and modes, which is none in this form


def sniff(head: bytes, path: Path) -> bool:
    """An OUTPUT4 file of MYSTRAN's ending without a sidecar, and beside it a deck of SOL 31."""
    if not UNIT.search(path.suffix) or not looks_like_op4(head) or sidecar_path(path) is not None:
        return False
    deck = deck_beside(path)
    return deck is not None and is_reduction(deck)


def read_component(path: Path, *, name: str | None = None, geometry: str | Path | None = None) -> Component:
    """The component; geometry: the deck, None for .bdf, .dat or .nas with the same stem."""
    deck = Path(geometry) if geometry is not None else deck_beside(path)
    if deck is None:
        raise ReadError(path, f"needs its deck ({', '.join(DECKS)}) beside it, or geometry=: its SUPORT entries are the rows")
    boundary, grids = _boundary(deck)
    found = read_op4(path)
    stiffness, mass = (_square(path, found, kind, len(boundary)) for kind in NAMES)
    if mass.shape != stiffness.shape:
        raise ReadError(path, f"mass has shape {mass.shape}, stiffness {stiffness.shape}")
    _check_order(path, deck, stiffness, len(boundary))
    source = provenance(path, FORMAT.name, __name__, (deck,))
    source["unused"] = sorted(set(found) - {n for names in NAMES.values() for n in names})
    return Component(
        name=name or name_from(path),
        mass=mass,
        stiffness=stiffness,
        boundary=boundary,
        nodes=grids.nodes(boundary.nodes),
        source=source,
    )


def _boundary(deck: Path) -> tuple[DofSet, Geometry]:
    cards = read_cards(deck)
    check_sequence(deck, cards)
    pairs = sorted({pair for card in cards if card.name == "SUPORT" for pair in card_pairs(card)})
    if not pairs:
        raise ReadError(deck, "has no SUPORT entries, which are the boundary of a SOL 31 run")
    return DofSet.of(pairs), Geometry.of(card for card in cards if card.name in GEOMETRY_CARDS)


def _square(path: Path, found: dict[str, Matrix], kind: str, least: int) -> FloatArray:
    name = next((n for n in NAMES[kind] if n in found), None)
    if name is None:
        raise ReadError(path, f"has no {' or '.join(NAMES[kind])}; it has {', '.join(found) or 'nothing'}")
    matrix = found[name]
    if matrix.shape[0] != matrix.shape[1] or matrix.shape[0] < least or np.iscomplexobj(matrix):
        what = f"{'complex' if np.iscomplexobj(matrix) else 'of shape'} {matrix.shape}"
        raise ReadError(path, f"is {what}; a real square of at least {least} rows (the SUPORT entries) is needed", record=name)
    return dense(matrix)


def _check_order(path: Path, deck: Path, stiffness: FloatArray, n: int) -> None:
    between, scale = abs(stiffness[:n, n:]).max(initial=0.0), abs(stiffness).max(initial=0.0)
    if between > COUPLED * scale:
        problem = f"its first {n} rows are coupled to the others in stiffness, so they are not the SUPORT entries of {deck.name}"
        raise ReadError(path, problem)


FORMAT = Format(
    name="mystran_output4",
    description="MYSTRAN Craig-Bampton model, SOL 31: .OU1 and the deck",
    suffixes=(".OU1",),
    sniff=sniff,
    tested_against="MYSTRAN 18.0",
    readers={"read_component": read_component},
)
