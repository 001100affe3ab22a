"""Which DOF the rows of Ansys matrices are, and where the nodes are: text that Ansys or a user's macro wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.matrix_market import looks_like_matrix_market, read_matrix_market
from flexplant.io.parse.number_text import integers, number_table, read_lines
from flexplant.model.arrays import FloatArray, Matrix
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes

DIRECTIONS = {"UX": 1, "UY": 2, "UZ": 3, "ROTX": 4, "ROTY": 5, "ROTZ": 6}


def read_mapping(path: Path, n: int) -> DofSet:
    """The DOF of n rows, from a vector of node ids or from lines "equation node UX"."""
    lines = read_lines(path)
    if lines and looks_like_matrix_market(lines[0].encode()):
        ids = integers(path, np.ravel(_dense(path)), "node")
        if not ids.size or n % ids.size or n // ids.size > 6:
            raise ReadError(path, f"lists {ids.size} nodes for {n} rows")
        each = n // ids.size
        return DofSet(np.repeat(ids, each), np.tile(np.arange(1, each + 1), ids.size))
    return read_equations(path, lines, n)


def _dense(path: Path) -> Matrix:
    vector = read_matrix_market(path)
    if min(vector.shape) != 1:
        raise ReadError(path, f"has shape {vector.shape}; a vector of node ids is needed")
    return np.asarray(vector.todense()) if hasattr(vector, "todense") else vector


def read_equations(path: Path, lines: list[str], n: int) -> DofSet:
    """The DOF of n rows from lines "equation node UX" in any order; other lines are headings."""
    found: dict[int, tuple[int, int]] = {}
    for number, line in enumerate(lines, 1):
        fields = line.split()
        if len(fields) != 3 or fields[2].upper() not in DIRECTIONS or not (fields[0].isdigit() and fields[1].isdigit()):
            continue  # headings
        if not 1 <= int(fields[0]) <= n or int(fields[0]) in found or len(fields[1]) > 15:
            raise ReadError(path, f"has equation {fields[0][:20]} of {n} (or has it twice)", record=f"line {number}")
        found[int(fields[0])] = (int(fields[1]), DIRECTIONS[fields[2].upper()])
    if len(found) != n:
        raise ReadError(path, f"names {len(found)} of {n} equations")
    return DofSet.of([found[i] for i in range(1, n + 1)])


def read_coordinates(path: Path) -> Nodes:
    """Node ids, positions and displacement axes from lines "node x y z", or NLIST's "node x y z THXY THYZ THZX" (degrees).

    Tab or blank separated, with decimal points or commas; other lines are headings.
    """
    lines = read_lines(path)
    kept = [(i, line) for i, line in enumerate(lines, 1) if line.strip()[:1].isdigit()]
    first = kept[0][0] if kept else 1
    decimal = all("," in line and ("\t" in line or " " in line.strip()) for _, line in kept)
    texts = [line.replace(",", ".") if decimal else line for _, line in kept]
    width = 7 if texts and len(texts[0].replace(",", " ").split()) == 7 else 4
    table = number_table(path, texts, width, first)
    frames = _frames(table[:, 4:]) if table[:, 4:].any() else None
    return Nodes(ids=integers(path, table[:, 0], "node"), positions=table[:, 1:4], frames=frames)


def _frames(angles: FloatArray) -> FloatArray:
    """Axes as rows: turned by THXY about nodal z, then by THYZ about the x so turned, then by THZX about that y (N command)."""
    from scipy.spatial.transform import Rotation

    return np.swapaxes(Rotation.from_euler("ZXY", angles, degrees=True).as_matrix(), 1, 2)
