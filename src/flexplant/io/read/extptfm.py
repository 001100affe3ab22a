"""OpenFAST ExtPtfm superelements: one interface node with six DOF, then Craig-Bampton modes. SI.

Lines are known by how they begin: !Dimension, !Mass Matrix, !Stiffness Matrix, !Damping Matrix; a matrix begins below its title
(OpenFAST 5) or below the dimension after it (2.3 to 4), blank lines may follow it. The load history, and the weight and its
stiffness of OpenFAST 5, are left out; source["unused"] says so. The older GuyanASCII layout has six rows a matrix at fixed
lines: mass, damping, stiffness.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexplant.errors import InputError, ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.files import provenance
from flexplant.io.parse.names import name_from
from flexplant.io.parse.number_text import number_table, read_lines
from flexplant.model.arrays import FloatArray
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes

TITLES = {"mass": "!MASS MATRIX", "stiffness": "!STIFFNESS MATRIX", "damping": "!DAMPING MATRIX"}
WEIGHTS = {"weight": "!WEIGHT CONSTANT", "stiffness of the weight": "!WEIGHT STIFFNESS"}
INTERFACE = 6
GUYAN = {"mass": 3, "damping": 10, "stiffness": 17}  # the first line of each matrix in GuyanASCII
GUYAN_LOADS = 26


def sniff(head: bytes, path: Path) -> bool:  # noqa: ARG001  every sniff function has it
    """Text that begins with "!" and has a dimension and a mass matrix near its start, or has #Mass in its second line."""
    upper = head.upper()
    return _is_guyan(head.decode("latin-1").splitlines()) or (
        head.lstrip()[:1] == b"!" and b"!DIMENSION" in upper and b"!MASS MATRIX" in upper
    )


def read_component(
    path: Path, *, name: str | None = None, node: int = 1, position: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Component:
    """The component; node: id that its interface gets; position: of the platform reference point."""
    if len(tuple(position)) != 3:
        raise InputError(f"position={position!r}: three numbers are needed")
    lines = read_lines(path)
    found, unused = _guyan(path, lines) if _is_guyan(lines) else _flex(path, lines)
    damping = found["damping"]
    return Component(
        name=name or name_from(path),
        mass=_needed(path, found["mass"], "mass"),
        stiffness=_needed(path, found["stiffness"], "stiffness"),
        damping=damping if damping is not None and damping.any() else None,
        boundary=[(node, "123456")],  # type: ignore[arg-type]
        nodes=Nodes(ids=np.array([node]), positions=np.array([position], dtype=float)),
        source=provenance(path, FORMAT.name, __name__) | {"units": "SI", "unused": unused},
    )


def _is_guyan(lines: list[str]) -> bool:
    return len(lines) > 1 and lines[1].lstrip().upper().startswith("#MASS")


def _guyan(path: Path, lines: list[str]) -> tuple[dict[str, FloatArray | None], list[str]]:
    if len(lines) < GUYAN["stiffness"] + INTERFACE - 1:
        raise ReadError(path, f"has {len(lines)} lines; the three matrices of GuyanASCII end in line 22")
    found: dict[str, FloatArray | None] = {}
    for kind, first in GUYAN.items():
        table = number_table(path, lines[first - 1 : first - 1 + INTERFACE], INTERFACE, first)
        if len(table) < INTERFACE:
            raise ReadError(path, f"{kind} matrix has {len(table)} of {INTERFACE} rows", record=f"line {first}")
        found[kind] = table
    loads = sum(1 for line in lines[GUYAN_LOADS - 1 :] if line.strip())
    return found, [f"load history, {loads} times"] if loads else []


def _flex(path: Path, lines: list[str]) -> tuple[dict[str, FloatArray | None], list[str]]:
    n = _dimension(path, lines)
    return {kind: _matrix(path, lines, title, n) for kind, title in TITLES.items()}, _weights(path, lines, n) + _load_history(
        lines
    )


def _dimension(path: Path, lines: list[str]) -> int:
    for number, line in enumerate(lines, 1):
        if line.upper().startswith("!DIMENSION"):
            digits = line[11:].strip()
            if not digits.isdigit() or not INTERFACE <= int(digits[:9]) <= len(lines):
                raise ReadError(path, f"has the dimension {digits[:20]!r}", record=f"line {number}")
            return int(digits)
    raise ReadError(path, "has no !Dimension line")


def _matrix(path: Path, lines: list[str], title: str, n: int, rows: int | None = None) -> FloatArray | None:
    at = next((i for i, line in enumerate(lines) if line.upper().startswith(title)), None)
    if at is None:
        return None
    rows = n if rows is None else rows
    begin = at + 2 if "".join(lines[at + 1 : at + 2]).startswith("!") else at + 1
    body = lines[begin : begin + rows]
    if len(body) < rows:
        raise ReadError(path, f"{title[1:].lower()} has {len(body)} of {rows} rows", record=f"line {at + 1}")
    return number_table(path, body, n, begin + 1)


def _weights(path: Path, lines: list[str], n: int) -> list[str]:
    """The parts of the weight that are there and not zero."""
    found = {what: _matrix(path, lines, title, n, 1 if what == "weight" else n) for what, title in WEIGHTS.items()}
    return [what for what, matrix in found.items() if matrix is not None and matrix.any()]


def _load_history(lines: list[str]) -> list[str]:
    """What is said about the loads at the end of the file, which are no part of a component."""
    at = next((i for i, line in enumerate(lines) if line.upper().startswith("!LOADING")), None)
    return [] if at is None else [f"load history, {sum(1 for line in lines[at + 2 :] if line.strip())} times"]


def _needed(path: Path, matrix: FloatArray | None, what: str) -> FloatArray:
    if matrix is None:
        raise ReadError(path, f"has no {what} matrix (!{what.capitalize()} Matrix)")
    return matrix


FORMAT = Format(
    name="extptfm",
    description="OpenFAST ExtPtfm superelement text (FlexASCII; GuyanASCII is read)",
    suffixes=(".extptfm",),
    sniff=sniff,
    tested_against="the layout of OpenFAST's r-test (5MW_OC4Jckt_ExtPtfm), openfast_io 5.0",
    readers={"read_component": read_component},
)
