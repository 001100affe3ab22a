"""Recovery rows as matrices of Nastran's: names of up to eight letters, DTI tables where the labels fit them, else comments."""

from __future__ import annotations

import re
from itertools import groupby

from flexplant.io.parse.dti import ELEMENT_TYPES, GRID_TYPE
from flexplant.io.parse.recovery_notes import Note
from flexplant.model.component import Component

OWN_NAME = re.compile(r"M[A-Z][A-Z0-9]{0,5}")  # so that a T may follow
TAKEN = ("MXX", "MAA")  # the mass
NUMBERS = {name: number for number, name in ELEMENT_TYPES.items()}


def recovery_notes(component: Component, ending: str = "", taken: tuple[str, ...] = TAKEN) -> list[Note]:
    """A matrix name for each recovery: its own in capitals where it is one of Nastran's (mug1), else MREC1, MREC2, ...

    ending: of all names. taken: names that the component's matrices have.
    """
    out: list[Note] = []
    for number, recovery in enumerate(component.recovery.values(), 1):
        own = recovery.name.upper()
        usable = OWN_NAME.fullmatch(own) and own not in taken and own.lower() == recovery.name and not own.startswith("MREC")
        out.append(Note(f"{own if usable else f'MREC{number}'}{ending}", recovery.name, recovery.units, tuple(recovery.labels)))
    return out


def table_text(note: Note) -> str:
    """DTI record 2 of TUG1, TES1, ...: type, id, count and first row of each block; nothing where the labels are no such rows."""
    blocks = _blocks(note.labels, element=note.name[:2] in ("me", "mg"))
    if blocks is None or note.matrix.startswith("MREC"):
        return ""
    fields = ["TYPE", "ID", "COMP", "ROW"] * 2 + [str(value) for block in blocks for value in block] + ["ENDREC"]
    lines = ["".join(f"{text:>8}" for text in fields[at : at + 8]) for at in range(0, len(fields), 8)]
    return f"DTI     {'T' + note.name[1:].upper():8}{2:8d}\n" + "".join(f"{'':8}{line}\n" for line in lines)


def _blocks(labels: tuple[str, ...], *, element: bool) -> list[tuple[int, int, int, int]] | None:
    """(type, id, count, first row) of labels "45.1", "45.2", ... or "CBAR.10.1", ...; None for any others."""
    pattern = re.compile(r"([A-Z0-9]+\.\d{1,8})\.(\d+)" if element else r"(\d{1,8})\.(\d+)")
    found = [pattern.fullmatch(label) for label in labels]
    if not all(found):
        return None
    out, row = [], 1
    for owner, group in groupby((m for m in found if m), key=lambda m: m[1]):
        items = [int(m[2]) for m in group]
        kind, _, identity = owner.rpartition(".")
        if items != list(range(1, len(items) + 1)) or (kind and kind not in NUMBERS):
            return None
        out.append((NUMBERS[kind] if kind else GRID_TYPE, int(identity), len(items), row))
        row += len(items)
    return out
