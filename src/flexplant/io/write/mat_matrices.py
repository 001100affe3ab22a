"""A component as MATLAB `.mat`: mass, stiffness, damping, boundary and recovery rows, and the sidecar `.yaml` of our reader.

In MATLAB or Octave: p = load("bus.mat"); p.mass, p.stiffness, p.boundary (node, direction of the first rows), p.R1 ... as the
sidecar names them. Ids of modal coordinates are not kept.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import InputError
from flexplant.io.formats import Writer
from flexplant.io.write.atomic import replacing
from flexplant.io.write.c_text import comment
from flexplant.io.write.mat import save
from flexplant.io.write.ownership import mark
from flexplant.io.write.present import present_matrices
from flexplant.model.component import Component
from flexplant.model.geometry import Nodes
from flexplant.model.units import UNIT_SYSTEMS, UNSTATED

NAME = "mat_matrices"
MATRICES = {kind: kind for kind in ("mass", "stiffness", "damping")}
RATES = {"matrix": ("displacement", ""), "velocity": ("velocity", "_v"), "acceleration": ("acceleration", "_a")}


def write_component(component: Component, path: Path, *, target: Path) -> None:
    """The matrices at `path`, the sidecar beside `target`. InputError for units that no preset has."""
    if component.units not in (UNSTATED, *UNIT_SYSTEMS):
        raise InputError(f"component {component.name!r} is in {component.units!r}, which a sidecar cannot name; convert it to SI")
    variables: dict[str, Any] = {name: _stored(matrix) for name, matrix in present_matrices(component, MATRICES)}
    kinds = list(variables)
    variables["boundary"] = np.array(component.boundary.pairs, dtype=float).reshape(-1, 2)
    lines = [f"# {comment(component.name)}: {mark(NAME)}, what the rows of {comment(target.name)} are"]
    lines += [f"file: {json.dumps(target.name)}"]
    lines += [f"name: {json.dumps(component.name)}", f"matrices: {json.dumps({kind: kind for kind in kinds})}"]
    lines.append(f"boundary: {json.dumps([[node, str(direction)] for node, direction in component.boundary.pairs])}")
    lines.append(f"modal: {component.n_modal}")
    lines += [] if component.units == UNSTATED else [f"units: {component.units}"]
    lines += [] if component.nodes is None else _geometry(component.nodes)
    lines += ["recovery:"] if component.recovery else []
    for number, recovery in enumerate(component.recovery.values(), 1):
        spec: dict[str, Any] = {"labels": list(recovery.labels), "units": recovery.units}
        for key, (kind, ending) in RATES.items():
            if (rows := getattr(recovery, kind)) is not None:
                spec[key] = f"R{number}{ending}"
                variables[spec[key]] = _stored(rows)
        lines.append(f"  {json.dumps(recovery.name)}: {json.dumps(spec)}")
    save(variables, path, NAME)
    with replacing(beside(target)[0]) as work:
        work.write_text("\n".join(lines) + "\n", encoding="utf-8")


def beside(target: Path) -> tuple[Path, ...]:
    """The sidecar."""
    return (target.with_suffix(".yaml"),)


def _stored(matrix: Any) -> Any:
    return sp.csc_matrix(matrix) if sp.issparse(matrix) else np.asarray(matrix, dtype=float)


def _geometry(nodes: Nodes) -> list[str]:
    """Positions with every bit, and the displacement axes of nodes that have their own."""
    placed = zip(nodes.ids.tolist(), nodes.positions.tolist(), strict=True)
    lines = [f"nodes: {json.dumps([[node, *position] for node, position in placed])}"]
    turned = [int(node) for node in nodes.ids if not np.array_equal(nodes.frame(int(node)), np.eye(3))]
    frames = ", ".join(f"{node}: {json.dumps(nodes.frame(node).tolist())}" for node in turned)
    return lines + ([f"frames: {{{frames}}}"] if turned else [])


WRITER = Writer(
    name=NAME,
    description="MATLAB .mat matrices with a YAML sidecar",
    suffixes=(".mat",),
    tested_against="Octave 7",
    holds=frozenset({"recovery", "recovery rates"}),
    beside=beside,
    apart=(".op4", ".op2"),  # which would read the sidecar for theirs
    writers={"write_component": write_component},
)
