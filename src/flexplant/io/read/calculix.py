"""CalculiX matrices, `*FREQUENCY, SOLVER=MATRIXSTORAGE`: `.sti`, `.mas` (row, column, value) and `.dof` (node.direction a row).

Rows are the free DOF: those held by *BOUNDARY and the dependent ones of *EQUATION and *RIGID BODY are eliminated by CalculiX.
Positions and the pairs of nodes of *RIGID BODY come from the `.inp` with the same stem where it is there: the "translations" of
a ROT NODE are the rotations 4, 5, 6 of its REF NODE. Shells and beams are expanded into solids by CalculiX, which gives the
rows of the new nodes numbers of old ones, so that a DOF is listed several times.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import InputError, ReadError
from flexplant.io.formats import Format
from flexplant.io.parse.abaqus_input import keyword_blocks, read_nodes
from flexplant.io.parse.files import one_line, provenance, sibling
from flexplant.io.parse.names import name_from
from flexplant.io.parse.number_text import integers, number_table, read_lines
from flexplant.io.parse.triplets import check_covers, symmetric_matrix
from flexplant.model.arrays import Matrix
from flexplant.model.component import FiniteElementModel
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes

DOF_LINE = re.compile(r"\s*(\d{1,15})\.([1-6])\s*$")
EXPANDED = "CalculiX expands shells and beams into solids and names their rows itself; internal='keep' takes them as new nodes"
Pair = tuple[int, int]


def sniff(head: bytes, path: Path) -> bool:
    """A `.sti` file of three numbers a line."""
    first = head.split(b"\n", 1)[0].split()
    return path.suffix.lower() == ".sti" and len(first) == 3 and first[0].isdigit()


def read_model(
    path: Path, *, name: str | None = None, geometry: str | Path | None = None, internal: str = "error"
) -> FiniteElementModel:
    """The model from its `.sti` file; geometry: the `.inp`, None for the one with the same stem.

    internal: "error", or "keep" for files with CalculiX's own nodes (see above): repeated DOF get new node numbers, above all
    others, and the model has no positions; source["internal"] says how many such rows there are.
    """
    if internal not in ("error", "keep"):
        raise InputError(f"internal={internal!r}: use 'error' or 'keep'")
    mass, dof = sibling(path, ".mas"), sibling(path, ".dof")
    if mass is None or dof is None:
        raise ReadError(path, f"needs the {'.mas' if mass is None else '.dof'} file with the same stem beside it")
    deck = Path(geometry) if geometry is not None else sibling(path, ".inp")
    pairs = listed_dofs(dof)
    nodes = None if deck is None else read_nodes(deck)
    source = provenance(path, FORMAT.name, __name__, tuple(file for file in (mass, dof, deck) if file is not None))
    if deck is not None:
        pairs = with_rotations(pairs, rotation_nodes(deck))
    if unknown := _internal(dof, pairs, nodes, refuse=internal == "error"):
        pairs, nodes = renumbered(pairs), None
        source["internal"] = f"{unknown} rows belong to CalculiX's own nodes; positions left out"
    dofs = DofSet.of(pairs)
    return FiniteElementModel(
        name=name or name_from(path),
        mass=_matrix(mass, len(dofs)),
        stiffness=_matrix(path, len(dofs)),
        dofs=dofs,
        nodes=nodes,
        source=source,
    )


def listed_dofs(path: Path) -> list[Pair]:
    """The (node, direction) of the rows from lines such as 12.3, as they are listed."""
    pairs = []
    for number, line in enumerate(read_lines(path), 1):
        if not line.strip():
            continue
        found = DOF_LINE.match(line)
        if found is None:
            raise ReadError(path, f"{one_line(line)[:40]!r} is not node.direction", record=f"line {number}")
        pairs.append((int(found[1]), int(found[2])))
    return pairs


def rotation_nodes(deck: Path) -> dict[int, int]:
    """ROT NODE -> REF NODE of the *RIGID BODY blocks."""
    found: dict[int, int] = {}
    for block in keyword_blocks(read_lines(deck)):
        given: Any = [block.parameters.get(key, "") for key in ("ROT NODE", "REF NODE")]
        if block.keyword == "RIGID BODY" and all(text.isdecimal() and len(text) < 16 for text in given):
            found[int(given[0])] = int(given[1])
    return found


def with_rotations(pairs: list[Pair], rotations: dict[int, int]) -> list[Pair]:
    """The rows of a rotation node as directions 4 to 6 of its reference node."""
    return [(rotations[n], d + 3) if n in rotations and d < 4 else (n, d) for n, d in pairs]


def _internal(path: Path, pairs: list[Pair], nodes: Nodes | None, *, refuse: bool) -> int:
    """How many rows are of CalculiX's own nodes: listed before, or not in the deck; ReadError if these are refused."""
    seen: set[Pair] = set()
    count = 0
    for number, pair in enumerate(pairs, 1):
        if pair in seen or (nodes is not None and pair[0] not in nodes):
            if refuse:
                why = "is listed twice" if pair in seen else "is at a node that the deck does not have"
                raise ReadError(path, f"{pair[0]}.{pair[1]} {why}: {EXPANDED}", record=f"line {number}")
            count += 1
        seen.add(pair)
    return count


def renumbered(pairs: list[Pair]) -> list[Pair]:
    """Distinct pairs: the k-th repetition of a node's DOF is moved to a new node, the same one for all its directions."""
    times: dict[Pair, int] = {}
    fresh: dict[Pair, int] = {}
    top = max((node for node, _ in pairs), default=0)
    out = []
    for node, direction in pairs:
        again = times.get((node, direction), 0)
        times[(node, direction)] = again + 1
        number = node if not again else fresh.setdefault((node, again), top + 1 + len(fresh))
        out.append((number, direction))
    return out


def _matrix(path: Path, n: int) -> Matrix:
    entries = number_table(path, read_lines(path), 3)
    rows, columns = (integers(path, entries[:, k], what) - 1 for k, what in ((0, "row"), (1, "column")))
    matrix = symmetric_matrix(path, np.asarray(rows), np.asarray(columns), entries[:, 2], n)
    check_covers(path, matrix, n)
    return matrix


FORMAT = Format(
    name="calculix",
    description="CalculiX matrices: .sti, .mas, .dof",
    suffixes=(".sti",),
    sniff=sniff,
    tested_against="CalculiX 2.20",
    readers={"read_model": read_model},
)
