"""Outlines for drawing: nodes, quadrilaterals and lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from flexplant.errors import ModelError
from flexplant.model.arrays import FloatArray, IntArray, frozen


@dataclass(frozen=True, eq=False)
class DisplayMesh:
    """nodes: (n,) ids. positions: (n, 3). quads: (m, 4), lines: (k, 2), both as places in `nodes` (from 0); n > 0.

    A triangle is a quad that repeats its last node. frames: (n, 3, 3) displacement axes of each node (rows, as of `Nodes`), or
    None where they are those of the positions. source: provenance. Raises ModelError for wrong shapes and places that do
    not exist.
    """

    nodes: IntArray
    positions: FloatArray
    quads: IntArray
    lines: IntArray
    frames: FloatArray | None = None
    source: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", frozen(self.nodes, np.int64))
        object.__setattr__(self, "positions", frozen(self.positions))
        n = self.nodes.size
        if self.nodes.shape != (n,) or n == 0 or self.positions.shape != (n, 3):
            raise ModelError(f"display mesh: {n} nodes with positions {self.positions.shape}; (n, 3) is needed, n > 0")
        if not np.isfinite(self.positions).all():
            raise ModelError("display mesh: positions has entries that are not finite")
        if self.frames is not None:
            object.__setattr__(self, "frames", frozen(self.frames))
            if np.shape(self.frames) != (n, 3, 3) or not np.isfinite(self.frames).all():
                raise ModelError(f"display mesh: frames must be finite and ({n}, 3, 3), got {np.shape(self.frames)}")
        for kind, width in (("quads", 4), ("lines", 2)):
            places = frozen(np.reshape(getattr(self, kind), (-1, width)), np.int64)
            if places.size and not (places.min() >= 0 and places.max() < n):
                raise ModelError(f"display mesh: {kind} name places {places.min()} ... {places.max()}, but there are {n} nodes")
            object.__setattr__(self, kind, places)


def part_of(mesh: DisplayMesh, kept: npt.ArrayLike) -> DisplayMesh | None:
    """The mesh of the nodes where `kept` (n,) is true, with the quads and lines that have all of theirs; None without nodes."""
    kept = np.asarray(kept, dtype=bool)
    if not kept.any():
        return None
    place: IntArray = np.cumsum(kept) - 1
    return replace(
        mesh,
        nodes=mesh.nodes[kept],
        positions=mesh.positions[kept],
        frames=None if mesh.frames is None else mesh.frames[kept],
        quads=place[mesh.quads[kept[mesh.quads].all(axis=1)]],
        lines=place[mesh.lines[kept[mesh.lines].all(axis=1)]],
    )
