"""Outlines for drawing: nodes, quadrilaterals and lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.errors import ModelError
from flexplant.model.arrays import FloatArray, IntArray, frozen


@dataclass(frozen=True, eq=False)
class DisplayMesh:
    """nodes: (n,) ids. positions: (n, 3). quads: (m, 4), lines: (k, 2), both as places in `nodes` (from 0); n > 0.

    A triangle is a quad that repeats its last node. Raises ModelError for wrong shapes and places that do not exist.
    """

    nodes: IntArray
    positions: FloatArray
    quads: IntArray
    lines: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", frozen(self.nodes, np.int64))
        object.__setattr__(self, "positions", frozen(self.positions))
        n = self.nodes.size
        if self.nodes.shape != (n,) or n == 0 or self.positions.shape != (n, 3):
            raise ModelError(f"display mesh: {n} nodes with positions {self.positions.shape}; (n, 3) is needed, n > 0")
        if not np.isfinite(self.positions).all():
            raise ModelError("display mesh: positions has entries that are not finite")
        for kind, width in (("quads", 4), ("lines", 2)):
            places = frozen(np.reshape(getattr(self, kind), (-1, width)), np.int64)
            if places.size and not (places.min() >= 0 and places.max() < n):
                raise ModelError(f"display mesh: {kind} name places {places.min()} ... {places.max()}, but there are {n} nodes")
            object.__setattr__(self, kind, places)
