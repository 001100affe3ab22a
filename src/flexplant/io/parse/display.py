"""Outlines for drawing: nodes, quadrilaterals and lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexplant.errors import ModelError
from flexplant.model.arrays import FloatArray, IntArray, frozen


@dataclass(frozen=True, eq=False)
class DisplayMesh:
    """nodes: (n,) ids. positions: (n, 3). quads: (m, 4), lines: (k, 2), both as places in `nodes` (from 0).

    A triangle is a quad that repeats its last node. Raises ModelError for places that do not exist.
    """

    nodes: IntArray
    positions: FloatArray
    quads: IntArray
    lines: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", frozen(self.nodes, np.int64))
        object.__setattr__(self, "positions", frozen(np.reshape(self.positions, (-1, 3))))
        if self.nodes.ndim != 1 or len(self.positions) != self.nodes.size or not np.isfinite(self.positions).all():
            raise ModelError(f"display mesh: {self.nodes.size} nodes need as many finite positions, got {self.positions.shape}")
        for kind, width in (("quads", 4), ("lines", 2)):
            places = frozen(np.reshape(getattr(self, kind), (-1, width)), np.int64)
            if places.size and not (places.min() >= 0 and places.max() < self.nodes.size):
                raise ModelError(
                    f"display mesh: {kind} refer to places {places.min()} to {places.max()} of {self.nodes.size} nodes"
                )
            object.__setattr__(self, kind, places)
