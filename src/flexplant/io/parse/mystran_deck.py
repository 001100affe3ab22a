"""What a MYSTRAN deck says about the rows of the matrices that its run wrote."""

from __future__ import annotations

import re
from pathlib import Path

from flexplant.errors import ReadError
from flexplant.io.parse.bulk import Card
from flexplant.io.parse.files import read_head, sibling

DECKS = (".bdf", ".dat", ".nas")
REDUCTION = re.compile(rb"^\s*SOL\s+(31|GEN\s+CB\s+MODEL)\b", re.IGNORECASE | re.MULTILINE)


def deck_beside(path: Path) -> Path | None:
    """The deck with the stem of a file, None if there is none."""
    return next((deck for ending in DECKS if (deck := sibling(path, ending))), None)


def is_reduction(deck: Path) -> bool:
    """Whether its solution is 31, the Craig-Bampton model."""
    return bool(REDUCTION.search(read_head(deck)))


def check_sequence(deck: Path, cards: list[Card]) -> None:
    """ReadError where the rows are not in the order of the grids."""
    order = [card.text(1).upper() for card in cards if card.name == "PARAM" and card.text(0).upper() == "GRIDSEQ"]
    if order[-1:] != ["GRID"]:
        raise ReadError(deck, "has no PARAM,GRIDSEQ,GRID, so that the rows are in MYSTRAN's own sequence; add it and run again")
