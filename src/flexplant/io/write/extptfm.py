"""A component as OpenFAST ExtPtfm superelement (FlexASCII): mass, stiffness, damping and a load history of zeros.

In the module's input file: FileFormat 1 and the path as Red_FileName. ExtPtfm has one interface node with six DOF at the
platform reference point, in SI: the component needs boundary DOF 1 to 6 of one node, in that order.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexplant.errors import InputError
from flexplant.io.formats import Writer
from flexplant.io.write.c_text import comment
from flexplant.model.arrays import FloatArray, dense
from flexplant.model.component import Component

DIRECTIONS = [1, 2, 3, 4, 5, 6]
MOST_DOF = 1350  # OpenFAST reads a line of loads into 4096 characters


def write_component(component: Component, path: Path, *, duration: float = 3600.0) -> None:
    """The file; duration: of the load history of zeros, seconds. InputError for another boundary, other units, too many DOF."""
    if component.boundary.direction.tolist() != DIRECTIONS or len(component.boundary.nodes) != 1:
        raise InputError(f"component {component.name!r}: ExtPtfm needs one boundary node with DOF 1 to 6, in that order")
    if component.units != "SI":
        raise InputError(
            f"component {component.name!r} is in {component.units!r}, but ExtPtfm reads SI; convert it: component_to_si"
        )
    n = component.n
    if n > MOST_DOF:
        raise InputError(f"component {component.name!r} has {n} DOF; OpenFAST reads at most {MOST_DOF}: reduce it to fewer modes")
    damping = np.zeros((n, n)) if component.damping is None else dense(component.damping)
    lines = ["!Comment", f"!Comment Flex 5 Format: {comment(component.name)}, written by flexplant, SI", f"!Dimension: {n}"]
    lines += [f"!Time increment in simulation: {duration!r}", f"!Total simulation time in file: {duration!r}"]
    for title, matrix in (("Mass", dense(component.mass)), ("Stiffness", dense(component.stiffness)), ("Damping", damping)):
        lines += ["", f"!{title} Matrix", f"!Dimension: {n}", *_rows(matrix)]
    lines += ["", "!Loading and Wave Elevation", f"!Dimension: 1 time column - {n} force columns"]
    lines += [f"{t!r}{' 0.' * n}" for t in (0.0, duration)]
    path.write_text("\n".join(lines) + "\n", encoding="ascii", errors="replace")


def _rows(matrix: FloatArray) -> list[str]:
    return [" ".join(f"{value:24.16E}" for value in row) for row in matrix]


WRITER = Writer(
    name="extptfm",
    description="OpenFAST ExtPtfm superelement text",
    suffixes=(".extptfm",),
    tested_against="weio 2.0, the reading rules of OpenFAST 2.3",
    writers={"write_component": write_component},
)
