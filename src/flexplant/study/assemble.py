"""From the study file's words to components, connections and the coupled system."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.assembly import GROUND, Connection, System, characteristic_interface, couple
from flexplant.io import read_component, read_model
from flexplant.io.registry import path_options
from flexplant.model.component import Component
from flexplant.model.geometry import Placement
from flexplant.numerics.lanczos import Progress
from flexplant.study.reduction import reduce_model, told_of
from flexplant.study.schema import ComponentSpec, ConnectionSpec, GroundSpec, StudySpec, TruthSpec, UnitsSpec
from flexplant.study.schema_reduce import expanded

Begin = Callable[[str], Progress]  # says which step begins, and hears (stage, share) of it


def read_components(study: StudySpec, folder: Path, begin: Begin | None = None) -> tuple[Component, ...]:
    """The components of a study, in SI, with their damping (equation 4); `begin` is told of each reduction."""
    return tuple(_read(name, spec, study, folder, begin) for name, spec in study.components.items())


def _read(name: str, spec: ComponentSpec, study: StudySpec, folder: Path, begin: Begin | None) -> Component:
    shared = study.damping.ratio if study.damping is not None and study.damping.on == "components" else None
    damping = spec.damping if spec.damping is not None else shared
    given: dict[str, Any] = {"format": spec.format, "name": name, "units": file_units(spec)}
    given |= file_options(spec, folder)
    how = spec.reduce
    if how is None:
        return read_component(folder / spec.file, damping=damping, **given)
    options: dict[str, Any] = {} if spec.geometry is None else {"geometry": folder / spec.geometry}
    model = read_model(folder / spec.file, **given, **options)
    with told_of(f"components.{name}.reduce"):
        return reduce_model(
            model,
            expanded(how.boundary),
            method=how.method,
            interface_nodes=[node.arguments for node in how.interface_nodes],
            characteristic=None if how.characteristic_modes is None else how.characteristic_modes.arguments,
            damping_ratio=damping,
            progress=None if begin is None else begin(f"reducing {name}"),
            **how.options,
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
    system = couple(components, connections, method=study.method, placements=placements)
    for place, (spec, joint) in enumerate(zip(study.connections, connections, strict=False)):  # those to the ground follow
        if spec.characteristic_modes is not None:
            with told_of(f"connections.{place}.characteristic_modes"):
                system = characteristic_interface(system, str(joint.name), **spec.characteristic_modes.model_dump())
    return system


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
