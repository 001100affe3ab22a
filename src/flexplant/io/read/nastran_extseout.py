"""Nastran external superelements as EXTSEOUT(ASMBULK,EXTBULK,MATOP4) writes them: `.op4` + `.asm` + `.pch`, one stem.

The `.pch` says which DOF the rows are (EXTRN, ASET) and labels the recovery rows (DTI); `.asm` has the boundary's
grids and coordinate systems (the `.pch` repeats them). Rows with component 0 (SPOINT) or in a QSET are modal.

Recovery matrices and their labels: see `flexplant.io.parse.external_superelement`.
"""

from __future__ import annotations

from pathlib import Path

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.external_superelement import external_superelement
from flexplant.io.parse.files import sibling
from flexplant.io.parse.op4 import looks_like_op4, read_op4
from flexplant.io.parse.sidecar import sidecar_path
from flexplant.model.component import Component


def sniff(head: bytes, path: Path) -> bool:
    """An OUTPUT4 file with a `.asm` or `.pch` beside it, or one of these with the `.op4` beside it."""
    if path.suffix.lower() in (".asm", ".pch"):
        return sibling(path, ".op4") is not None
    beside = sibling(path, ".pch") is not None or sibling(path, ".asm") is not None
    return beside and sidecar_path(path) is None and looks_like_op4(head)


def read_component(path: Path, *, name: str | None = None, structural: str = "read") -> Component:
    """The superelement as a component in the file's units.

    structural: what to do with structural damping K4 in the file: "read" it as the component's structural_damping D (K + i D),
    "ignore" it, or "error". Overall damping (PARAM,G) is not in the file. Viscous damping becomes the component's damping.
    Reduced loads (PX) are not part of a component; source["unused"] names them with every other matrix that was left out.
    """
    op4, asm, pch = _files(path)
    beside = tuple(file for file in (pch, asm) if file is not None)
    return external_superelement(op4, read_op4(op4), beside, name, structural, (FORMAT.name, __name__))


def _files(path: Path) -> tuple[Path, Path | None, Path | None]:
    op4 = path if path.suffix.lower() not in (".asm", ".pch") else sibling(path, ".op4")
    if op4 is None:
        raise ReadError(path, "has no .op4 file with the same stem beside it")
    asm, pch = sibling(path, ".asm"), sibling(path, ".pch")
    if asm is None and pch is None:
        raise ReadError(path, "has neither .pch nor .asm with the same stem beside it; these say which DOF the rows are")
    return op4, asm, pch


FORMAT = Format(
    name="nastran_extseout",
    description="Nastran external superelement, EXTSEOUT with MATOP4: .op4 + .asm + .pch",
    suffixes=(".op4", ".OP4"),
    sniff=sniff,
    tested_against="NX Nastran 9.1, MSC Nastran",
    readers={"read_component": read_component},
)
