"""A component as data of Simscape Multibody's Reduced Order Flexible Solid block: a MATLAB script `.m`, 17 digits.

The block wants interface origins (and orientations, here all along the common frame), stiffness, mass (and damping) with six
DOF a boundary frame in the order Tx Ty Tz Rx Ry Rz, then the modal ones, all along the common reference frame: rows with
their own displacement axes are turned into it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.linalg

from flexplant.errors import InputError
from flexplant.io.formats import Writer
from flexplant.io.write.c_text import comment, matlab_name
from flexplant.io.write.ownership import mark
from flexplant.model.arrays import FloatArray, dense
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet

NAME = "simscape"
SIX = [1, 2, 3, 4, 5, 6]


def write_component(component: Component, path: Path, *, target: Path) -> None:
    """The script, which defines `rom` with Origins (units as in the component), Orientations, K, M, C.

    Raises InputError where a boundary node has not all six DOF in order, or no position, or the stem is no MATLAB name.
    """
    matlab_name(target.stem)
    nodes = component.nodes
    if nodes is None:
        raise InputError(f"component {component.name!r} has no node positions, which the interface frames need")
    if not _complete(component.boundary):
        raise InputError(f"component {component.name!r}: every boundary node needs DOF 1 to 6, in that order, for Simscape")
    turn = [scipy.linalg.block_diag(nodes.frame(n), nodes.frame(n)) for n in component.boundary.nodes]
    T = scipy.linalg.block_diag(*turn, np.eye(component.n_modal))  # u_own axes = T u_basic
    lines = [f"% {comment(component.name)}: data for Reduced Order Flexible Solid (Simscape Multibody), {mark(NAME)}."]
    lines += ["% Interface frames in this order: " + ", ".join(f"node {n}" for n in component.boundary.nodes)]
    lines += [f"% Units: {comment(component.units)}"]
    origins = np.array([nodes.position(n) for n in component.boundary.nodes])
    lines.append(f"rom.Origins = {matlab(origins)};")
    lines.append(f"rom.Orientations = repmat([1 0 0 0], {len(origins)}, 1); % for releases that ask for unit quaternions")
    for name, matrix in (("K", component.stiffness), ("M", component.mass), ("C", component.damping)):
        if matrix is not None:
            lines.append(f"rom.{name} = {matlab(T.T @ dense(matrix) @ T)};")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _complete(boundary: DofSet) -> bool:
    return boundary.direction.tolist() == SIX * len(boundary.nodes) and len(boundary) == 6 * len(boundary.nodes)


def matlab(matrix: FloatArray) -> str:
    """A MATLAB matrix, every number with 17 digits."""
    return "[\n" + ";\n".join(" ".join(repr(float(v)) for v in row) for row in np.atleast_2d(matrix)) + "]"


WRITER = Writer(
    name=NAME,
    description="MATLAB script with the matrices of Simscape's Reduced Order Flexible Solid",
    suffixes=(".m",),
    tested_against="Octave",
    writers={"write_component": write_component},
)
