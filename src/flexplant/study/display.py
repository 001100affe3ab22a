"""The structure in three dimensions with the coupled system's mode shapes, through the components' display recovery."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from flexplant.assembly import System
from flexplant.errors import ReadError
from flexplant.io import read_display_mesh, read_geometry
from flexplant.model.arrays import FloatArray, dense
from flexplant.model.display import DisplayMesh, part_of
from flexplant.modes import Modes
from flexplant.reduction.expansion import GRIDS
from flexplant.report import StructureView, joined
from flexplant.report.mode_view import node_motion
from flexplant.study.assemble import file_units
from flexplant.study.schema import ComponentSpec, StudySpec


def structure_view(study: StudySpec, folder: Path, system: System, modes: Modes) -> StructureView | None:
    """The view, or None where no component brings a display mesh with a recovery of its nodes."""
    picked = [number - 1 for number in study.report.mode_shapes if 0 < number <= len(modes)]
    parts, partial = [], []
    for name, spec in study.components.items():
        mesh = mesh_of(spec, folder)
        if mesh is not None and picked and (how := _moved_by(study, system, name, spec)):
            part = _part(mesh, how, system, name, modes.shapes[:, picked], deck=is_drawn(spec))
            parts += [part] if part is not None else []
            if part is not None and len(part[0].nodes) < len(mesh.nodes):
                partial.append(f" Of {name} {len(part[0].nodes)} of {len(mesh.nodes)} nodes are recovered; the rest is left out.")
    if not parts:
        return None
    labels = [_label(study, modes, k) for k in picked]
    first = next((i for i, k in enumerate(picked) if k >= modes.n_rigid), 0)
    return StructureView(
        joined([mesh for mesh, _ in parts]),
        np.concatenate([shapes for _, shapes in parts], axis=1),
        modes.frequency_hz[picked],
        labels,
        caption="Mode shapes of the coupled reduced model, recovered at the display nodes of each component." + "".join(partial),
        first_mode=first,
    )


def shape_notes(study: StudySpec, folder: Path, system: System, modes: Modes) -> tuple[str, ...]:
    """Why mode shapes that the study asks for are not in the report; nothing where it asks for none."""
    if "mode_shapes" not in study.report.model_fields_set:
        return ()
    notes = []
    if absent := [str(number) for number in study.report.mode_shapes if not 0 < number <= len(modes)]:
        notes.append(f"report.mode_shapes: there is no mode {', '.join(absent)}; the study solves for modes 1 to {len(modes)}")
    blind = []
    for name, spec in study.components.items():
        if _moved_by(study, system, name, spec) is None:
            blind.append(f"component {name!r} brings no recovery {GRIDS if is_drawn(spec) else study.report.display!r}")
        elif mesh_of(spec, folder) is None:
            blind.append(f"component {name!r} brings no display mesh in its file")
    if blind and study.report.mode_shapes:
        notes.append(f"report.mode_shapes: {'; '.join(blind)}, so its motion cannot be drawn")
    return tuple(notes)


def is_drawn(spec: ComponentSpec) -> bool:
    """Whether the component's geometry is a deck to draw, and not the positions that a model to be reduced lacks."""
    return spec.geometry is not None and spec.reduce is None


def mesh_of(spec: ComponentSpec, folder: Path) -> DisplayMesh | None:
    """The mesh of the deck that the study names, or the one that comes with the component's file."""
    path = folder / spec.file
    if is_drawn(spec):
        return read_geometry(folder / str(spec.geometry), units=file_units(spec))
    try:
        sidecar = {"sidecar": path.parent / str(spec.options["sidecar"])} if "sidecar" in spec.options else {}
        return read_display_mesh(path, format=spec.format, units=file_units(spec), **sidecar)
    except ReadError:  # a format without display meshes is no error: the report then has no view
        return None


def _moved_by(study: StudySpec, system: System, name: str, spec: ComponentSpec) -> str | None:
    """The recovery that moves the nodes of a component's mesh, None where it has none."""
    usual = [study.report.display, GRIDS] if is_drawn(spec) else [study.report.display]
    return next((recovery for recovery in usual if recovery in system.component(name).recovery), None)


def _part(
    mesh: DisplayMesh, recovery: str, system: System, name: str, shapes: FloatArray, *, deck: bool
) -> tuple[DisplayMesh, FloatArray] | None:
    """The mesh in place and the (modes, nodes, 3) displacements of its nodes, in the system frame; None where none is moved."""
    place, own = system.placement(name), shapes[system.offsets[name]]
    if deck:
        kept, moved = node_motion(system.component(name), mesh, own, recovery)
        part = part_of(mesh, kept)
    else:
        rows = system.component(name).recovery[recovery].displacement
        moved = np.asarray(dense(rows) @ own).T
        moved, part = moved.reshape(moved.shape[0], -1, 3), mesh
    return None if part is None else (replace(part, positions=place.apply(part.positions)), moved @ place.rotation.T)


def _label(study: StudySpec, modes: Modes, k: int) -> str:
    if k < modes.n_rigid:
        return f"Rigid body {k + 1}"
    labels = study.verification.reference.labels if study.verification.reference is not None else []
    place = k - modes.n_rigid
    return labels[place] if place < len(labels) else f"Flexible {place + 1}"
