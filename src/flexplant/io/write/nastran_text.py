"""Bulk data entries as text: large fields, as many digits as 16 columns hold."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from flexplant.errors import InputError
from flexplant.model.component import Component
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes

WIDTH = 16
MODAL_ID_BASE = 90_000_000


def real16(value: float, letter: str = "") -> str:
    """A real in at most 16 columns: -1.23456789012-5 (12 digits and more), or with "D" -1.2345678901D-5 (10 and more).

    Entries of double-precision matrices (TIN 2) need the D, other entries take Nastran's short exponent.
    """
    for digits in range(14, 7, -1):
        mantissa, exponent = f"{value:.{digits}e}".split("e")
        text = mantissa + (f"{letter}{int(exponent):+d}" if letter or int(exponent) else "")
        if len(text) <= WIDTH:
            return text
    raise InputError(f"{value!r} cannot be written in {WIDTH} columns")


def large(name: str, fields: Sequence[object], letter: str = "") -> str:
    """An entry in large fields, four a line, with a continuation where it is needed; letter: of the reals' exponents."""
    texts = [real16(f, letter) if isinstance(f, float) else str(f) for f in fields]
    if any(len(t) > WIDTH for t in texts):
        raise InputError(f"{name}: a field of {fields[:3]!r}... is longer than {WIDTH} columns")
    lines = []
    for at in range(0, len(texts), 4):
        head = f"{name + '*':8}" if at == 0 else f"{'*':8}"
        lines.append((head + "".join(f"{t:>{WIDTH}}" for t in texts[at : at + 4])).rstrip())
    return "\n".join(lines) + "\n"


def modal_points(component: Component) -> list[int]:
    """Scalar point ids of the modal coordinates: their own where these are free and positive, else from 90000001 on."""
    own = [] if component.modal_ids is None else [int(i) for i in component.modal_ids]
    grids = set(component.boundary.nodes)
    if own and min(own) > max(grids, default=0):
        return own
    return [MODAL_ID_BASE + i + 1 for i in range(component.n_modal)]


def listed_rows(component: Component) -> tuple[list[int], list[tuple[int, str]]]:
    """Scalar point ids of the modal coordinates; and all rows as (id, components), boundary first, for EXTRN and ASET entries."""
    points = modal_points(component)
    return points, [*grouped(component.boundary), *((point, "0") for point in points)]


def geometry_text(nodes: Nodes | None, boundary: DofSet, points: Iterable[int]) -> str:
    """GRID entries of the boundary nodes, CORD2R for those with their own axes, SPOINT for the modal coordinates."""
    if nodes is None:
        raise InputError("the component has no node positions, which GRID entries need; give it nodes=Nodes(ids, positions)")
    out = []
    for number, node in enumerate(boundary.nodes, 1):
        frame, position = nodes.frame(node), nodes.position(node)
        system = 0 if np.array_equal(frame, np.eye(3)) else number
        if system:
            axis = [0.0, 0.0, 0.0, *map(float, frame[2]), *map(float, frame[0])]
            out.append(large("CORD2R", [system, 0, *axis]))
        out.append(large("GRID", [node, 0, *map(float, position), system]))
    out += [f"SPOINT  {point:8d}\n" for point in points]
    return "".join(out)


def pairs_text(name: str, pairs: Sequence[tuple[int, str]]) -> str:
    """ASET or QSET entries of (id, components), four pairs each; EXTRN is one entry with continuations."""
    lines = ["".join(f"{node:8d}{digits:>8}" for node, digits in pairs[at : at + 4]) for at in range(0, len(pairs), 4)]
    return "".join(f"{name if i == 0 or name != 'EXTRN' else '':8}{line}\n" for i, line in enumerate(lines))


def grouped(boundary: DofSet) -> list[tuple[int, str]]:
    """(node, "123") of consecutive DOF of a node, in the order of the rows; "0" for scalar points."""
    out: list[tuple[int, str]] = []
    for node, direction in boundary.pairs:
        if out and out[-1][0] == node:
            out[-1] = (node, out[-1][1] + str(direction))
        else:
            out.append((node, str(direction)))
    return out
