"""Recovery (data recovery, DRM, OTM) matrices: physical quantities from component coordinates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexplant.errors import ModelError, expect_text, nearest
from flexplant.model.arrays import Matrix, checked_matrix, items_of


@dataclass(frozen=True, eq=False)
class Recovery:
    """Rows that recover y = D p + V p' + A p'' from the component's coordinates p = [b; q].

    labels: one name a row, distinct. displacement, velocity, acceleration: (n_rows, n) or None, at least one given.
    units: text for plots, for example "m" or "N".
    """

    name: str
    labels: Sequence[str]
    displacement: Matrix | None = None
    velocity: Matrix | None = None
    acceleration: Matrix | None = None
    units: str = ""

    def __post_init__(self) -> None:
        expect_text(self.name, "recovery: name")
        expect_text(self.units, f"recovery {self.name!r}: units", empty=True)
        given = items_of(self.labels)
        if given is None or not all(isinstance(label, (str, int, np.integer)) for label in given):
            raise ModelError(f"recovery {self.name!r}: labels must be a list of names, got {type(self.labels).__name__}")
        labels = tuple(str(label) for label in given)
        if len(set(labels)) != len(labels):
            twice = sorted(label for label, times in Counter(labels).items() if times > 1)
            raise ModelError(f"recovery {self.name!r}: labels listed twice: {', '.join(twice[:8])}")
        object.__setattr__(self, "labels", labels)
        columns: int | None = None
        for kind in ("displacement", "velocity", "acceleration"):
            if (matrix := getattr(self, kind)) is not None:
                matrix = checked_matrix(matrix, (len(labels), columns), f"recovery {self.name!r}, {kind} matrix")
                columns = matrix.shape[1]
                object.__setattr__(self, kind, matrix)
        if columns is None:
            raise ModelError(f"recovery {self.name!r}: give at least one of displacement, velocity, acceleration")

    @property
    def n_columns(self) -> int:
        """Number of component coordinates the rows act on."""
        given = next(m for m in (self.displacement, self.velocity, self.acceleration) if m is not None)
        return int(given.shape[1])

    def row(self, label: str) -> int:
        """Row of a label; ModelError suggests the nearest label."""
        try:
            return list(self.labels).index(label)
        except ValueError:
            raise ModelError(f"recovery {self.name!r} has no row {label!r}." + nearest(label, self.labels)) from None
