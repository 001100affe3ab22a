"""What a component has, under the names that a format gives it: the one list that every writer of components goes through."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from flexplant.io.parse.recovery_notes import Note
from flexplant.model.arrays import Matrix
from flexplant.model.component import Component


def present_matrices(component: Component, names: Mapping[str, str]) -> Iterator[tuple[str, Matrix]]:
    """(name in the file, matrix) of "mass", "stiffness", "damping", "structural_damping" where there is one; order of `names`."""
    for kind, name in names.items():
        if (matrix := getattr(component, kind)) is not None:
            yield name, matrix


def present_rows(component: Component, notes: Sequence[Note]) -> Iterator[tuple[Note, Matrix]]:
    """(note, displacement rows) of the recoveries that have such rows."""
    for note in notes:
        if (rows := component.recovery[note.name].displacement) is not None:
            yield note, rows
