"""Nastran bulk data, for display: grids, coordinate systems, and the outlines of elements."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.bulk import Card, read_cards
from flexplant.io.parse.coordinates import Geometry
from flexplant.io.parse.files import provenance
from flexplant.model.display import DisplayMesh

CARD_LINE = re.compile(rb"^(GRID|SPOINT|CORD[12][RCS]|BEGIN +BULK)\b", re.IGNORECASE | re.MULTILINE)
QUADS = {"CQUAD4": (2, 3, 4, 5), "CQUAD8": (2, 3, 4, 5), "CQUADR": (2, 3, 4, 5), "CSHEAR": (2, 3, 4, 5),
         "CTRIA3": (2, 3, 4, 4), "CTRIA6": (2, 3, 4, 4), "CTRIAR": (2, 3, 4, 4)}  # fmt: skip  # fields of the corners
LINES = {"CBAR": 2, "CBEAM": 2, "CROD": 2, "CONROD": 1, "CTUBE": 2, "CBUSH": 2, "PLOTEL": 1, "CVISC": 2}  # first end's field
SOLIDS = {
    "CHEXA": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "CPENTA": ((0, 1, 2, 2), (3, 4, 5, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "CPYRAM": ((0, 1, 2, 3), (0, 1, 4, 4), (1, 2, 4, 4), (2, 3, 4, 4), (3, 0, 4, 4)),
    "CTETRA": ((0, 1, 2, 2), (0, 1, 3, 3), (1, 2, 3, 3), (2, 0, 3, 3)),
}  # faces, as places among the corners, which come first in field 2 on
DEEPEST_INCLUDE = 20


def sniff(head: bytes, path: Path) -> bool:
    """Text with a grid, a coordinate system or BEGIN BULK near its start, or a usual suffix."""
    if b"\x00" in head:
        return False
    return bool(CARD_LINE.search(head)) or path.suffix.lower() in (".bdf", ".nas", ".blk")


def read_deck(path: Path, depth: int = 0) -> list[Card]:
    """The cards of a deck, INCLUDE files (in its folder or below) in place."""
    if depth > DEEPEST_INCLUDE:
        raise ReadError(path, f"INCLUDE is nested more than {DEEPEST_INCLUDE} deep; does a file include itself?")
    out: list[Card] = []
    for card in read_cards(path):
        out += read_deck(_included(path, card), depth + 1) if card.name == "INCLUDE" else [card]
    return out


def _included(path: Path, card: Card) -> Path:
    target = path.parent / card.text(0)
    if not target.resolve().is_relative_to(path.parent.resolve()):
        raise card.fail(f"{card.text(0)!r} lies outside the folder of the deck, which is not followed")
    return target


def read_geometry(path: Path) -> DisplayMesh:
    """All grids (ascending id, basic frame), shells as quads (a triangle repeats its last corner), bars and RBE2 as lines.

    frames: the displacement system of each grid (its field CD).
    """
    cards = read_deck(path)
    geometry = Geometry.of(cards, one_deck=True)
    if not geometry.grids:
        raise ReadError(path, "has no GRID entries")
    nodes = geometry.nodes()
    place = {int(grid): i for i, grid in enumerate(nodes.ids)}
    quads = [_corners(c, QUADS[c.name], place) for c in cards if c.name in QUADS]
    lines = [_corners(c, (LINES[c.name], LINES[c.name] + 1), place) for c in cards if c.name in LINES]
    for card in (c for c in cards if c.name in ("RBE2", "RBE3")):
        lines += _spokes(card, place) if card.name == "RBE2" else _averaged(card, place)
    quads += _skin(
        [[_corners(c, tuple(f + 2 for f in face), place) for face in SOLIDS[c.name]] for c in cards if c.name in SOLIDS]
    )
    included = tuple(dict.fromkeys(card.path for card in cards if card.path != path))
    return DisplayMesh(
        nodes.ids,
        nodes.positions,
        np.array(quads, dtype=np.int64).reshape(-1, 4),
        np.array(lines, dtype=np.int64).reshape(-1, 2),
        frames=nodes.frames,
        source=provenance(path, FORMAT.name, __name__, included),
    )


def _corners(card: Card, fields: tuple[int, ...], place: dict[int, int]) -> list[int]:
    grids = [card.integer(field) for field in fields]
    if missing := [g for g in grids if g not in place]:
        raise card.fail(f"refers to grids {missing}, which are not in the deck")
    return [place[g] for g in grids]


def _faces(card: Card, place: dict[int, int]) -> list[list[int]]:
    return [_corners(card, tuple(corner + 2 for corner in face), place) for face in SOLIDS[card.name]]


def _skin(solids: list[list[list[int]]]) -> list[list[int]]:
    """The faces that belong to one solid only."""
    faces: dict[frozenset[int], list[int] | None] = {}
    for face in (face for solid in solids for face in solid):
        faces[frozenset(face)] = None if frozenset(face) in faces else face
    return [face for face in faces.values() if face is not None]


def _averaged(card: Card, place: dict[int, int]) -> list[list[int]]:
    """Lines from the reference grid of an RBE3 to the grids that it averages (fields 5 on: weight, components, grids ...)."""
    (center,) = _corners(card, (2,), place)
    out, at = [], 6
    while at < len(card.fields) and card.text(at).upper() not in ("UM", "ALPHA"):
        if card.text(at).isdigit() and "." not in card.text(at - 1):
            out += [[center, place[g]] for g in [card.integer(at)] if g in place]
        at += 1
    return out


def _spokes(card: Card, place: dict[int, int]) -> list[list[int]]:
    """Lines from the independent grid of an RBE2 to its dependent ones (a real last field is its thermal coefficient)."""
    fields = tuple(f for f in card.fields if f.isdigit() or f.upper() == "THRU")
    dependents = Card(card.path, card.name, fields, card.line).ids(3)
    (center,) = _corners(card, (1,), place)
    if missing := [g for g in dependents if g not in place]:
        raise card.fail(f"refers to grids {missing[:8]}, which are not in the deck")
    return [[center, place[g]] for g in dependents]


FORMAT = Format(
    name="nastran_bulk",
    description="Nastran bulk data (geometry)",
    suffixes=(".bdf", ".dat"),
    sniff=sniff,
    tested_against="NX Nastran 9.1 and MYSTRAN decks",
    readers={"read_geometry": read_geometry},
)
