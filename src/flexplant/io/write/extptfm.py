"""A component as OpenFAST ExtPtfm superelement (FlexASCII): mass, stiffness and damping, without loads or weight.

OpenFAST 2.3 to 4: in the module's input file FileFormat 1 and the path as Red_FileName; the file ends in a load history, here
of zeros. OpenFAST 5: the path as Red_FileName; titles without dimensions, no load history, the weight apart, here zero.
ExtPtfm has one interface node with six DOF at the platform reference point, in SI: the component needs boundary DOF 1 to 6
of one node, in that order.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexplant.errors import InputError, expect_count
from flexplant.io.formats import Writer
from flexplant.io.write.c_text import comment
from flexplant.io.write.ownership import mark
from flexplant.model.arrays import FloatArray, dense
from flexplant.model.component import Component

NAME = "extptfm"
DIRECTIONS = [1, 2, 3, 4, 5, 6]
MOST_DOF = 1350  # OpenFAST reads a line of loads into 4096 characters


def write_component(component: Component, path: Path, *, openfast: int = 4, duration: float = 3600.0) -> None:
    """The file for that major version of OpenFAST (5 also for later ones); duration: of the zero loads of versions to 4, seconds.

    Raises InputError for another boundary, other units, too many DOF.
    """
    expect_count(openfast, "openfast, the major version,", least=2)
    n = _checked_size(component)
    damping = np.zeros((n, n)) if component.damping is None else dense(component.damping)
    matrices = {"Mass": dense(component.mass), "Stiffness": dense(component.stiffness), "Damping": damping}
    header = ["!Comment", f"!Comment Flex 5 Format: {comment(component.name)}, {mark(NAME)}, SI", f"!Dimension: {n}"]
    body = _version_4(matrices, n, duration) if openfast < 5 else _version_5(matrices, n)
    path.write_text("\n".join(header + body) + "\n", encoding="ascii", errors="replace")


def _checked_size(component: Component) -> int:
    if component.boundary.direction.tolist() != DIRECTIONS or len(component.boundary.nodes) != 1:
        raise InputError(f"component {component.name!r}: ExtPtfm needs one boundary node with DOF 1 to 6, in that order")
    if component.units != "SI":
        raise InputError(
            f"component {component.name!r}: its units are {component.units!r}, but ExtPtfm reads SI; pass units= where it is "
            "read, or convert it: component_to_si"
        )
    n = component.n
    if n > MOST_DOF:
        raise InputError(f"component {component.name!r} has {n} DOF; OpenFAST reads at most {MOST_DOF}: reduce it to fewer modes")
    return n


def _version_4(matrices: dict[str, FloatArray], n: int, duration: float) -> list[str]:
    lines = [f"!Time increment in simulation: {duration!r}", f"!Total simulation time in file: {duration!r}"]
    for title, matrix in matrices.items():
        lines += ["", f"!{title} Matrix", f"!Dimension: {n}", *_rows(matrix)]
    lines += ["", "!Loading and Wave Elevation", f"!Dimension: 1 time column - {n} force columns"]
    return lines + [f"{t!r}{' 0.' * n}" for t in (0.0, duration)]


def _version_5(matrices: dict[str, FloatArray], n: int) -> list[str]:
    weights = {"Weight constant": np.zeros((1, n)), "Weight stiffness matrix": np.zeros((n, n))}
    titled = {f"{title} Matrix": matrix for title, matrix in matrices.items()} | weights
    return [line for title, matrix in titled.items() for line in ("", f"!{title}", *_rows(matrix))]


def _rows(matrix: FloatArray) -> list[str]:
    return [" ".join(f"{value:24.16E}" for value in row) for row in matrix]


WRITER = Writer(
    name=NAME,
    description="OpenFAST ExtPtfm superelement text",
    suffixes=(".extptfm",),
    tested_against="openfast_io 5.0 (OpenFAST 5), weio 2.0 and the reading rules of OpenFAST 2.3 (OpenFAST 4)",
    writers={"write_component": write_component},
)
