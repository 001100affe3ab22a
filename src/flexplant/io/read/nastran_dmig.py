"""Nastran superelements as DMIG entries: EXTSEOUT(...,DMIGPCH) `.pch`, OptiStruct's PARAM,EXTOUT,DMIGPCH, or hand-made decks.

What is read from the entries: see `flexplant.io.parse.dmig_superelement`.
"""

from __future__ import annotations

import re
from pathlib import Path

from flexplant.io.formats import Format
from flexplant.io.parse.bulk import read_cards
from flexplant.io.parse.dmig_superelement import dmig_component
from flexplant.io.parse.files import read_bytes, sibling
from flexplant.io.parse.recovery_notes import read_notes
from flexplant.model.component import Component

DMIG_LINE = re.compile(rb"^DMIG\b", re.MULTILINE)
PUNCH_LINE = re.compile(rb"^(\$ STANDARD PUNCH|BEGIN +SUPER|ASET|GRID|SPOINT)", re.MULTILINE)
K42GG = re.compile(rb"^\s*K42GG\s*=\s*(\S.*?)\s*$", re.MULTILINE | re.IGNORECASE)  # case control
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


def read_component(path: Path, *, name: str | None = None, suffix: str | None = None, structural: str = "read") -> Component:
    """The superelement as a component in the file's units.

    suffix: of the matrices' names where a file holds several sets, such as "10" for K10, M10. structural: what to do with
    structural damping (K410): "read" it, or what case control selects as K42GG, as D of K + i D, "ignore" it, or
    "error". source["unused"] names the matrices that were left out.
    """
    made_by, cards = (FORMAT.name, __name__), read_cards(path)
    chosen = K42GG.search(read_bytes(path))
    selected = None if chosen is None else chosen[1].decode("ascii", "replace").upper()
    notes = read_notes(path)
    return dmig_component(
        path, cards, name=name, suffix=suffix, structural=structural, made_by=made_by, selected=selected, notes=notes
    )


FORMAT = Format(
    name="nastran_dmig",
    description="Nastran DMIG superelement, EXTSEOUT with DMIGPCH: .pch",
    sniff=sniff,
    tested_against="MSC Nastran 2019",
    readers={"read_component": read_component},
)
