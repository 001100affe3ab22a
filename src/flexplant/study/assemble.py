"""From the study file's words to components, connections and the coupled system."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexplant.assembly import GROUND, Connection, System, couple
from flexplant.errors import InputError
from flexplant.io import read_component, read_model
from flexplant.io.registry import path_options
from flexplant.model.component import Component
from flexplant.model.geometry import Placement
from flexplant.reduction import craig_bampton
from flexplant.study.schema import ComponentSpec, ConnectionSpec, GroundSpec, StudySpec, TruthSpec, UnitsSpec


def read_components(study: StudySpec, folder: Path) -> tuple[Component, ...]:
    """The components of a study, in SI, with their damping (equation 4)."""
    return tuple(_read(name, spec, study, folder) for name, spec in study.components.items())


def _read(name: str, spec: ComponentSpec, study: StudySpec, folder: Path) -> Component:
    shared = study.damping.ratio if study.damping is not None and study.damping.on == "components" else None
    damping = spec.damping if spec.damping is not None else shared
    given: dict[str, Any] = {"format": spec.format, "name": name, "units": file_units(spec)}
    given |= file_options(spec, folder)
    if spec.reduce is None:
        return read_component(folder / spec.file, damping=damping, **given)
    options: dict[str, Any] = {} if spec.geometry is None else {"geometry": folder / spec.geometry}
    model = read_model(folder / spec.file, **given, **options)
    how = spec.reduce
    return craig_bampton(
        model,
        how.boundary,
        max_frequency_hz=how.max_frequency_hz,
        n_modes=how.n_modes,
        residual_vectors=how.residual_vectors,
        accuracy=how.accuracy,
        size=how.size,
        loads=how.loads,
        damping_ratio=damping,
    )


def file_options(spec: ComponentSpec | TruthSpec, folder: Path) -> dict[str, Any]:
    """The options of the file's format, with the paths among them from the study's folder."""
    return {k: folder / str(v) if k in path_options() else v for k, v in spec.options.items()}


def files_read(study: StudySpec, path: Path) -> list[Path]:
    """The study file and every file that it names."""
    reference, truth = study.verification.reference, study.truth
    specs = [*study.components.values(), *(() if truth is None else truth.components.values())]
    named = [file for spec in specs for file in (spec.file, spec.geometry)]
    every = [*specs, *(() if truth is None else (truth,))]
    named += [str(value) for spec in every for key, value in spec.options.items() if key in path_options()]
    named += [reference.file if reference else None, truth.file if truth else None]
    return [path, *(path.parent / file for file in named if file is not None)]


def file_units(spec: ComponentSpec) -> Any:
    """The units of a component's file as the readers take them."""
    return (spec.units.length_m, spec.units.mass_kg) if isinstance(spec.units, UnitsSpec) else spec.units


def assemble(study: StudySpec, components: tuple[Component, ...]) -> System:
    """The coupled system of a study."""
    connections = [connection(c) for c in study.connections] + [ground(g, i) for i, g in enumerate(study.ground, start=1)]
    placements = {
        name: Placement(np.array(spec.placement.rotation, dtype=float), np.array(spec.placement.translation, dtype=float))
        for name, spec in study.components.items()
        if spec.placement is not None
    }
    return couple(components, connections, method=study.method, placements=placements)


def connection(spec: ConnectionSpec) -> Connection:
    """One joint of the study file."""
    by_position = spec.pairs == "by position"
    same = [(node, node) for node in spec.nodes or []]
    return Connection(
        spec.a,
        spec.b,
        pairs=same if spec.pairs is None else spec.pairs,
        directions=spec.directions,
        name=spec.name,
        frame=spec.frame,
        offset=spec.offset,
        tolerance=spec.tolerance_m,
        nodes=spec.nodes if by_position else None,
        stiffness=spec.stiffness,
        damping=spec.damping,
    )


def ground(spec: GroundSpec, number: int = 1) -> Connection:
    """Nodes held fixed, as a connection to the ground."""
    return Connection(spec.component, GROUND, pairs=spec.nodes, directions=spec.directions, name=f"ground-{number}")


def parse_connection(text: str) -> Connection:
    """A connection from "a:b:3,11,19" (the same node ids on both sides) or "a:b" (by position). Raises InputError."""
    parts = text.split(":")
    if len(parts) not in (2, 3) or not all(parts):
        raise InputError(f"connection {text!r}: write a:b:node,node or, to match by position, a:b")
    if len(parts) == 2:
        return Connection(parts[0], parts[1], pairs="by position")
    return Connection(parts[0], parts[1], pairs=[(node, node) for node in _nodes(parts[2], text)])


def parse_ground(text: str) -> Connection:
    """A connection to the ground from "component:3,11". Raises InputError."""
    component, _, nodes = text.partition(":")
    if not component or not nodes:
        raise InputError(f"ground {text!r}: write component:node,node")
    return Connection(component, GROUND, pairs=_nodes(nodes, text), name=f"ground-{component}")


def parse_boundary(text: str) -> list[tuple[int, str]]:
    """Boundary DOF from "9001,9002:123456 9101:123", groups separated by blanks. Raises InputError."""
    out = []
    for group in text.split():
        nodes, colon, directions = group.partition(":")
        out += [(node, directions if colon else "123456") for node in _nodes(nodes, text)]
    if not out:
        raise InputError("boundary: name nodes and directions, such as '9001,9002:123456 9101:123'")
    return out


def _nodes(text: str, whole: str) -> list[int]:
    try:
        return [int(node) for node in text.split(",")]
    except ValueError:
        raise InputError(f"{whole!r}: node ids are whole numbers separated by commas, got {text!r}") from None
