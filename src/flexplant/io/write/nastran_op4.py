"""A component as a Nastran external superelement: `.op4` (KXX, MXX, BXX and recovery matrices) with `.asm` and `.pch`.

Matrices are binary and bit-equal; positions in the text files keep 12 digits. The `.pch` lists the DOF of the rows (EXTRN),
the `.asm` has GRID, CORD2R, SPOINT and SECONCT, and as comments the CUSERIN and PUSERIN entries that MYSTRAN takes instead.
Recovery matrices go along: MUG1 and the like by their own names with DTI tables of their rows, others as MREC1, MREC2, ...;
comments of the `.pch` keep every name, unit and label.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from flexplant.io.formats import Writer
from flexplant.io.parse.files import read_head, sha256
from flexplant.io.parse.recovery_notes import notes_text
from flexplant.io.write.atomic import replacing
from flexplant.io.write.nastran_recovery import recovery_notes, table_text
from flexplant.io.write.nastran_text import geometry_text, listed_rows, pairs_text
from flexplant.io.write.ownership import mark, written_as
from flexplant.io.write.present import present_matrices, present_rows
from flexplant.model.arrays import Matrix, dense
from flexplant.model.component import Component

NAME = "nastran_op4"
SQUARE, RECTANGULAR, SYMMETRIC, REAL_DOUBLE = 1, 2, 6, 2
MATRICES = {"stiffness": "KXX", "mass": "MXX", "damping": "BXX", "structural_damping": "K4XX"}


def write_component(component: Component, path: Path, *, target: Path, superelement: int = 1) -> None:
    """The `.op4` at `path`; `.asm` and `.pch` beside `target`. superelement: its id in the SECONCT entry.

    Raises InputError for a component without node positions.
    """
    points, listed = listed_rows(component)
    geometry = geometry_text(component.nodes, component.boundary, points)
    seconct = _seconct(superelement, [*component.boundary.nodes, *points])
    userin = _userin(superelement, listed, points, target.name)
    notes = recovery_notes(component)
    with path.open("wb") as stream:
        for name, matrix in present_matrices(component, MATRICES):
            stream.write(op4_matrix(name, matrix, SYMMETRIC))
        for note, rows in present_rows(component, notes):
            stream.write(op4_matrix(note.matrix, rows, RECTANGULAR))
    head = f"$ {component.name}\n$ {_mark(path)}\n"
    labels = "".join(map(table_text, notes)) + notes_text(notes)
    punched = pairs_text("EXTRN", listed) + geometry + labels
    for file, text in zip(beside(target), (seconct + geometry + userin, punched), strict=True):
        with replacing(file) as work:
            work.write_text(head + text, encoding="utf-8")


def beside(target: Path) -> tuple[Path, ...]:
    """The `.asm` and the `.pch`."""
    return target.with_suffix(".asm"), target.with_suffix(".pch")


def _mark(op4: Path) -> str:
    """The `.op4` itself has no place for a word, so the files beside it say whose it is, and which."""
    return f"{mark(NAME)}, sha256 {sha256(op4)[:16]}"


def op4_written_as(path: Path) -> str:
    """As `written_as`; of a `.op4`, what the `.pch` beside it says, where it means these very bytes."""
    if path.suffix.lower() != ".op4":
        return written_as(path)
    pch = path.with_suffix(".pch")
    return NAME if pch.is_file() and _mark(path).encode() in read_head(pch) else ""


def op4_matrix(name: str, matrix: Matrix, form: int) -> bytes:
    """One matrix as binary OUTPUT4, little-endian, 32-bit integers, dense columns of doubles."""
    values = dense(matrix)
    rows, columns = values.shape
    out = [_record(struct.pack("<4i8s", columns, rows, form, REAL_DOUBLE, name.ljust(8).encode()))]
    for j in range(columns):
        column = np.ascontiguousarray(values[:, j], dtype="<f8")
        out.append(_record(struct.pack("<3i", j + 1, 1, 2 * rows) + column.tobytes()))
    out.append(_record(struct.pack("<3id", columns + 1, 1, 2, 1.0)))
    return b"".join(out)


def _record(body: bytes) -> bytes:
    mark = struct.pack("<i", len(body))
    return mark + body + mark


def _seconct(superelement: int, points: list[int]) -> str:
    """SECONCT: each point is tied to the one with the same id of the residual."""
    lines = ["".join(f"{p:8d}{p:8d}" for p in points[at : at + 4]) for at in range(0, len(points), 4)]
    return f"SECONCT {superelement:8d}{0:8d}{'':8}{'NO':>8}\n" + "".join(f"{'':8}{line}\n" for line in lines)


def _userin(superelement: int, listed: list[tuple[int, str]], points: list[int], file: str) -> str:
    """MYSTRAN's entries for a matrix element, commented out; nothing where its row order (DOF ascending) is not ours."""
    grids = listed[: len(listed) - len(points)]
    ordered = all("0" not in digits and list(digits) == sorted(digits) for _, digits in grids)
    if not ordered or len(dict(grids)) != len(grids):
        return ""
    lines = [f"CUSERIN {superelement:8d}{superelement:8d}{len(grids):8d}{len(points):8d}{0:8d}"]
    lines += ["+       " + "".join(f"{n:8d}{digits:>8}" for n, digits in grids[at : at + 4]) for at in range(0, len(grids), 4)]
    lines += ["+       " + "".join(f"{p:8d}" for p in points[at : at + 8]) for at in range(0, len(points), 8)]
    lines.append(f"PUSERIN {superelement:8d}{1:8d}{'KXX':>8}{'MXX':>8}")
    title = f"$ MYSTRAN: IN4 1 = {file.upper()} (executive control; file name in capitals), and these without the dollar sign:\n"
    return title + "".join(f"${line}\n" for line in lines)


WRITER = Writer(
    name=NAME,
    description="Nastran external superelement: .op4 with .asm and .pch",
    suffixes=(".op4",),
    tested_against="pyYeti, MYSTRAN 18.0",
    holds=frozenset({"recovery", "structural_damping"}),
    beside=beside,
    apart=(".yaml", ".yml"),  # a sidecar, by which the file would be read instead
    written_as=op4_written_as,
    writers={"write_component": write_component},
)
