"""Abaqus-style keyword files (Abaqus, CalculiX): nodes and elements of an `.inp`, and `*MATRIX OUTPUT` text in its layouts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.number_text import integers, number_table, read_lines
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes


@dataclass
class Block:
    """A keyword line, split (keyword in upper case, then its parameters), and the data lines after it."""

    keyword: str
    parameters: dict[str, str]
    line: int
    data: list[str] = field(default_factory=list)


def keyword_blocks(lines: list[str]) -> Iterator[Block]:
    """The blocks of a file; comments (**) left out."""
    block = None
    for number, line in enumerate(lines, 1):
        if line.startswith("**"):
            if block is not None:
                block.data.append("")  # so that line numbers stay right
        elif line.startswith("*"):
            if block is not None:
                yield block
            head, *rest = [part.strip() for part in line[1:].split(",")]
            pairs = (part.partition("=") for part in rest)
            block = Block(" ".join(head.upper().split()), {k.strip().upper(): v.strip() for k, _, v in pairs}, number)
        elif block is not None:
            block.data.append(line)
    if block is not None:
        yield block


def read_nodes(path: Path) -> Nodes:
    """The nodes of all *NODE blocks; ReadError if there is none."""
    tables = [
        number_table(path, [_padded(line) for line in block.data], 4, block.line + 1)
        for block in keyword_blocks(read_lines(path))
        if block.keyword == "NODE"
    ]
    table = np.vstack(tables) if tables else np.zeros((0, 4))
    if not len(table):
        raise ReadError(path, "has no *NODE block with nodes")
    ids = integers(path, table[:, 0], "node")
    order = np.argsort(ids, kind="stable")
    return Nodes(ids=ids[order], positions=table[order, 1:])


def deck_beside(path: Path) -> Path | None:
    """The longest-named `.inp` beside the file whose stem begins the file's name."""
    decks = [p for p in path.parent.glob("*.inp") if path.stem.lower().startswith(p.stem.lower())]
    return max(decks, key=lambda p: len(p.stem), default=None)


def nodes_at(path: Path, nodes: Nodes, dofs: DofSet) -> Nodes:
    """The nodes that have DOF, in their order; ReadError for one that the deck does not have."""
    if missing := [node for node in dofs.nodes if node not in nodes]:
        raise ReadError(path, f"has DOF at nodes {missing[:8]}, which the geometry file does not have")
    return Nodes(ids=np.array(dofs.nodes), positions=np.array([nodes.position(node) for node in dofs.nodes]).reshape(-1, 3))


def _padded(line: str) -> str:
    """A node in the plane has no z."""
    fields = [f for f in line.split(",") if f.strip()]
    return line if len(fields) != 3 else f"{line.rstrip().rstrip(',')}, 0."
