"""Abaqus substructures: `*SUBSTRUCTURE MATRIX OUTPUT, OUTPUT FILE=USER DEFINED` writes a `.mtx` in the layout of *USER ELEMENT.

    *USER ELEMENT, NODES= 4, LINEAR
    ** ELEMENT NODES
    ** 101, 102, 103, 104              node numbers in comment lines
    1, 2, 3                            DOF of the first node and of those after it
    3, 1, 2, 3, 4, 5, 6                from the third node on, others
    *MATRIX,TYPE=STIFFNESS             lower triangle, row after row, four numbers a line
    *MATRIX,TYPE=MASS

A node may be listed several times, each time with other DOF (CalculiX writes that). Source: Abaqus Keywords Reference,
*USER ELEMENT, *MATRIX, *SUBSTRUCTURE MATRIX OUTPUT; these name stiffness and mass only. How structural damping would be
written is not documented, so a matrix of that type ends in an error unless it is asked for. Nor is how retained eigenmodes are
numbered: nodes below 1 are taken as modal, other ones must be named with modal_nodes=.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.abaqus_input import Block, deck_beside, keyword_blocks, nodes_at, read_nodes
from flexplant.io.parse.files import one_line, provenance
from flexplant.io.parse.listed_rows import listed_component
from flexplant.io.parse.names import name_from
from flexplant.io.parse.number_text import read_lines
from flexplant.io.parse.structural import check_choice
from flexplant.model.arrays import FloatArray
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet

KINDS = {"stiffness": "STIFFNESS", "mass": "MASS", "damping": "VISCOUS DAMPING"}
MOST_DOF_A_NODE = 6


def sniff(head: bytes, path: Path) -> bool:
    """A `.mtx` file that begins with the user element's keyword, after comments."""
    lines = (line for line in head.upper().split(b"\n") if line.strip() and not line.startswith(b"**"))
    return path.suffix.lower() == ".mtx" and b"".join(next(lines, b"").split()).startswith(b"*USERELEMENT")


def read_component(
    path: Path,
    *,
    name: str | None = None,
    geometry: str | Path | None = None,
    modal_nodes: Iterable[int] = (),
    massless: bool = False,
    structural: str = "error",
) -> Component:
    """The substructure as a component; its retained DOF are the boundary.

    geometry: the `.inp` with the nodes, None for the one whose stem begins this file's name. modal_nodes: numbers of nodes
    that hold retained eigenmodes. massless: take no mass where the file has none (MASS=YES was not asked for).
    structural: where it has a matrix TYPE=STRUCTURAL DAMPING: "error", since no public page describes one; "ignore" it; or "read"
    it as D of K + i D, in the layout of the others, which is what the same words mean for Abaqus' global matrices.
    """
    check_choice(structural)
    blocks = _blocks(path)
    dofs = _dofs(path, blocks[0], _listed_nodes(path), {int(n) for n in modal_nodes})
    found = {_type(b): b for b in blocks[1:] if b.keyword == "MATRIX"}
    if len(found) < sum(b.keyword == "MATRIX" for b in blocks):
        raise ReadError(
            path, "holds two matrices of one type: element matrices are no substructure", record=f"line {blocks[0].line}"
        )
    if structural == "error" and (odd := [kind for kind in found if "STRUCTURAL" in kind]):
        advice = "pass structural='read' to take it as D of K + i D, or 'ignore' to leave it out, and give modal damping"
        raise ReadError(path, f"has a matrix {odd[0]}, whose layout is not documented; {advice}")
    kinds = KINDS | ({"structural_damping": "STRUCTURAL DAMPING"} if structural == "read" else {})
    matrices: dict[str, Any] = {k: _matrix(path, found[t], len(dofs)) if t in found else None for k, t in kinds.items()}
    if matrices["stiffness"] is None:
        raise ReadError(path, f"has no *MATRIX,TYPE=STIFFNESS; it holds {', '.join(found) or 'no matrix'}")
    if matrices["mass"] is None:
        if not massless:
            raise ReadError(path, "has no *MATRIX,TYPE=MASS: add MASS=YES to *SUBSTRUCTURE MATRIX OUTPUT, or pass massless=True")
        matrices["mass"] = np.zeros((len(dofs), len(dofs)))
    deck = Path(geometry) if geometry is not None else deck_beside(path)
    boundary = DofSet(dofs.node[dofs.direction > 0], dofs.direction[dofs.direction > 0])
    nodes = None if deck is None else nodes_at(path, read_nodes(deck), boundary)
    source = provenance(path, FORMAT.name, __name__, () if deck is None else (deck,))
    source["unused"] = [kind for kind in found if kind not in kinds.values()]
    return listed_component(path, matrices, dofs, nodes, name or name_from(path), source)


def _blocks(path: Path) -> list[Block]:
    """The user element's block and those after it; ReadError for none and for several."""
    blocks = list(keyword_blocks(read_lines(path)))
    at = [i for i, b in enumerate(blocks) if b.keyword == "USER ELEMENT"]
    if len(at) != 1:
        what = "element matrices are no substructure" if at else "no substructure"
        raise ReadError(path, f"has {len(at)} *USER ELEMENT blocks: {what}")
    return blocks[at[0] :]


def _type(block: Block) -> str:
    return " ".join(block.parameters.get("TYPE", "").upper().split())


def _listed_nodes(path: Path) -> list[int]:
    """The numbers in the comment lines after ** ELEMENT NODES."""
    lines = read_lines(path)
    begin = next((i for i, line in enumerate(lines) if line.upper().split() == ["**", "ELEMENT", "NODES"]), None)
    out: list[int] = []
    for number, line in enumerate(lines[begin + 1 :] if begin is not None else [], (begin or 0) + 2):
        if not line.startswith("**"):
            break
        out += _integers(path, line[2:], number)
    if not out:
        raise ReadError(path, "has no ** ELEMENT NODES comment with node numbers")
    return out


def _integers(path: Path, line: str, number: int) -> list[int]:
    fields = line.replace(",", " ").split()
    if not all(field.lstrip("-").isdecimal() and len(field) < 16 for field in fields):
        raise ReadError(path, f"{one_line(line)[:60]!r} is not a list of integers", record=f"line {number}")
    return [int(field) for field in fields]


def _dofs(path: Path, block: Block, nodes: list[int], modal: set[int]) -> DofSet:
    """The DOF of the rows: at each node those of the last list that begins at or before it."""
    lists: dict[int, list[int]] = {}
    for number, line in enumerate(block.data, block.line + 1):
        if line.strip():
            given = _integers(path, line, number) if lists else [1, *_integers(path, line, number)]
            place, directions = (given or [0])[0], given[1:]
            if not 1 <= place <= len(nodes) or not directions or not all(1 <= d <= MOST_DOF_A_NODE for d in directions):
                problem = f"{one_line(line)[:60]!r} is no place of {len(nodes)} nodes with its DOF from 1 to {MOST_DOF_A_NODE}"
                raise ReadError(path, problem, record=f"line {number}")
            lists[place] = directions
    if 1 not in lists:
        raise ReadError(path, "has no DOF for its first node", record=f"line {block.line}")
    pairs, current = [], lists[1]
    for place, node in enumerate(nodes, 1):
        current = lists.get(place, current)
        pairs += [(node, d) for d in current]
    return _with_modal(pairs, modal)


def _with_modal(pairs: list[tuple[int, int]], modal: set[int]) -> DofSet:
    """Rows of modal nodes become (consecutive number, 0)."""
    out, count = [], 0
    for node, direction in pairs:
        is_modal = node < 1 or node in modal
        count += is_modal
        out.append((count, 0) if is_modal else (node, direction))
    return DofSet.of(out)


def _matrix(path: Path, block: Block, n: int) -> FloatArray:
    """The symmetric matrix from its lower triangle; ReadError for another count of numbers."""
    fields = " ".join(block.data).replace(",", " ").replace("D", "E").split()
    try:
        values = np.array(fields, dtype=float)
    except ValueError:
        raise ReadError(path, "has text among the numbers of a matrix", record=f"line {block.line}") from None
    if values.size != n * (n + 1) // 2:
        problem = f"*MATRIX,TYPE={_type(block)} has {values.size} numbers; {n} DOF need {n * (n + 1) // 2} (lower triangle)"
        raise ReadError(path, problem, record=f"line {block.line}")
    out = np.zeros((n, n))
    out[np.tril_indices(n)] = values
    return out + np.tril(out, -1).T


FORMAT = Format(
    name="abaqus_substructure",
    description="Abaqus substructure, *SUBSTRUCTURE MATRIX OUTPUT: .mtx in the layout of *USER ELEMENT",
    suffixes=(".mtx",),
    sniff=sniff,
    tested_against="CalculiX 2.20 (the same layout)",
    readers={"read_component": read_component},
)
