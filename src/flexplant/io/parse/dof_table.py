"""A table of DOF as text: `node,direction` a line, one for each row of the matrices, optionally with `x,y,z` after them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.number_text import integers, number_table, read_lines
from flexplant.model.arrays import FloatArray, IntArray
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes


@dataclass(frozen=True)
class DofTable:
    """DOF of the rows in order; the nodes where positions are given."""

    dofs: DofSet
    nodes: Nodes | None


def read_dof_table(path: Path) -> DofTable:
    """The table; direction 0 is a modal coordinate. A first line of headings is skipped.

    Raises ReadError with the line for what is not 2 or 5 numbers, directions above 6, a node at two places.
    """
    lines = [line.replace(";", ",") for line in read_lines(path)]
    headings = int(bool(lines) and any(c.isalpha() for c in lines[0].lower().replace("e", "")))
    body = lines[headings:]
    first = next((line for line in body if line.strip()), "")
    width = 5 if len(first.replace(",", " ").split()) == 5 else 2
    table = number_table(path, body, width, headings + 1)
    node, direction = integers(path, table[:, 0], "node", 0), integers(path, table[:, 1], "direction", 0)
    if direction.size and direction.max() > 6:
        raise ReadError(path, f"has the direction {direction.max()}; 0 (modal) to 6 exist")
    return DofTable(DofSet(node, direction), _nodes(path, node, direction, table) if width == 5 else None)


def _nodes(path: Path, node: IntArray, direction: IntArray, table: FloatArray) -> Nodes:
    physical = direction > 0
    ids, at, back = np.unique(node[physical], return_index=True, return_inverse=True)
    positions = table[physical][at, 2:]
    if not np.array_equal(positions[back], table[physical][:, 2:]):
        raise ReadError(path, "gives one node two positions")
    return Nodes(ids=ids, positions=positions)
