"""Tables of superelements in an OUTPUT2 file: SLIST, then USETTAB, EQEXINS, CSTMS, BGPDTS of each superelement.

This is the layout of a run with the NAS2CAM alter; the matrices (se_start, maa, kaa, ...) are in an OUTPUT4 file beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.coordinates import BASIC, CoordinateSystem
from flexplant.io.parse.op2 import Block, Op2
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes

Q_SET, B_SET = 1 << 22, 1 << 1  # bits in USET; the b bit also stands for s, which has bits of its own
S_SET = 1 << 9 | 1 << 10
GRID, KINDS = 1, {1: "R", 2: "C", 3: "S"}
NAMES = ("USETTAB", "EQEXINS", "CSTMS", "BGPDTS")


@dataclass(frozen=True)
class Superelement:
    """DOF of the rows, which of them are modal, which belong to the a-set (b or q), and the grids."""

    dofs: DofSet
    modal: Any
    analysis: Any
    nodes: Nodes

    def rows(self, n: int) -> Any:
        """Places of the rows that matrices of size n have: all of them, else those of the a-set."""
        return np.arange(len(self.dofs)) if n == len(self.dofs) else np.flatnonzero(self.analysis)


def superelements(path: Path) -> dict[int, Superelement]:
    """The superelements by id, in the order of the file."""
    file = Op2.open(path)
    found = [b for b in file.blocks() if b.name in (*NAMES, "SLIST")]
    if not found or found[0].name != "SLIST":
        raise ReadError(path, "has no SLIST table of superelements")
    ids = _words(file, found[0], 1)[::7].tolist()
    groups: list[dict[str, Block]] = []
    for block in found[1:]:
        if block.name == "USETTAB":
            groups.append({})
        if groups:
            groups[-1][block.name] = block
    if len(groups) != len(ids) or len(set(ids)) != len(ids):
        raise ReadError(path, f"lists the superelements {ids[:8]}, but has {len(groups)} USETTAB tables")
    return {i: _superelement(file, group) for i, group in zip(ids, groups, strict=True)}


def _words(file: Op2, block: Block, number: int) -> Any:
    """Integers of a record (1 is the first after the name)."""
    return file.integers(_bytes(file, block, number))


def _bytes(file: Op2, block: Block, number: int) -> memoryview:
    if number >= len(block.records):
        raise file.fail(f"block {block.name!r} has {len(block.records)} records, {number + 1} are needed", block.offset)
    return memoryview(b"".join(block.records[number][1]))


def _superelement(file: Op2, group: dict[str, Block]) -> Superelement:
    if missing := [n for n in ("USETTAB", "EQEXINS", "BGPDTS") if n not in group]:
        raise ReadError(file.path, f"a superelement has no {', '.join(missing)}")
    uset = _words(file, group["USETTAB"], 1)
    internal, external = (_words(file, group["EQEXINS"], i).reshape(-1, 2) for i in (1, 2))
    if internal.shape != external.shape:
        raise file.fail("EQEXINS has records of unequal length", group["EQEXINS"].offset)
    order = np.argsort(internal[:, 1], kind="stable")
    node, code = external[order, 0], external[order, 1]
    grid = code % 10 == GRID
    size = np.where(grid, 6, 1)
    if size.sum() != uset.size:
        raise file.fail(f"USETTAB has {uset.size} rows, EQEXINS {size.sum()}", group["USETTAB"].offset)
    direction = np.concatenate([np.arange(1, 7) if g else [0] for g in grid]) if grid.size else np.zeros(0, int)
    dofs = DofSet(np.repeat(node, size), direction)
    analysis = ((uset & B_SET) != 0) & ((uset & S_SET) == 0) | ((uset & Q_SET) != 0)
    return Superelement(dofs, (uset & Q_SET) != 0, analysis, _nodes(file, group, node, grid))


def _nodes(file: Op2, group: dict[str, Block], node: Any, grid: Any) -> Nodes:
    table = np.dtype([("words", f"{file.order}i{file.word}", 6), ("xyz", f"{file.order}f8", 3)])
    body = _bytes(file, group["BGPDTS"], 1)
    if len(body) != table.itemsize * node.size:
        raise file.fail(f"BGPDTS has {len(body)} bytes for {node.size} points", group["BGPDTS"].offset)
    rows = np.frombuffer(body, table)[grid]
    systems = _systems(file, group.get("CSTMS"))
    unknown = set(rows["words"][:, 0].tolist()) - set(systems)
    if unknown:
        raise file.fail(f"BGPDTS refers to coordinate systems {sorted(unknown)[:8]}", group["BGPDTS"].offset)
    positions = rows["xyz"].astype(float)
    frames = [systems[int(c)].frame_at(p) for c, p in zip(rows["words"][:, 0], positions, strict=True)]
    return Nodes(ids=node[grid], positions=positions, frames=np.array(frames).reshape(-1, 3, 3))


def _systems(file: Op2, block: Block | None) -> dict[int, CoordinateSystem]:
    out = {0: BASIC}
    if block is None:
        return out
    listed = _words(file, block, 1)
    body = _bytes(file, block, 2)
    numbers = np.frombuffer(body[: len(body) // 8 * 8], file.order + "f8").astype(float)
    for number, kind, _, first in listed[: listed.size // 4 * 4].reshape(-1, 4).tolist():
        values = numbers[max(first - 1, 0) : max(first - 1, 0) + 12]
        if kind not in KINDS or values.size < 12:
            raise file.fail(f"CSTMS: coordinate system {number} has type {kind} and {values.size} numbers", block.offset)
        out[number] = CoordinateSystem(KINDS[kind], values[:3], values[3:].reshape(3, 3).T)
    return out
