"""The structure in three dimensions with the coupled system's mode shapes, through the components' display recovery."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from flexplant.assembly import System
from flexplant.errors import ReadError
from flexplant.io import read_display_mesh
from flexplant.model.arrays import FloatArray, dense
from flexplant.model.display import DisplayMesh
from flexplant.modes import Modes
from flexplant.report import StructureView, joined
from flexplant.study.assemble import file_units
from flexplant.study.schema import ComponentSpec, StudySpec


def structure_view(study: StudySpec, folder: Path, system: System, modes: Modes) -> StructureView | None:
    """The view, or None where no component brings a display mesh with a recovery of its nodes."""
    picked = [number - 1 for number in study.report.mode_shapes if 0 < number <= len(modes)]
    parts = []
    for name, spec in study.components.items():
        mesh = _mesh(folder / spec.file, spec)
        if mesh is not None and picked and study.report.display in system.component(name).recovery:
            parts.append((_placed(mesh, system, name), _shapes(study.report.display, system, name, modes.shapes[:, picked])))
    if not parts:
        return None
    labels = [_label(study, modes, k) for k in picked]
    first = next((i for i, k in enumerate(picked) if k >= modes.n_rigid), 0)
    return StructureView(
        joined([mesh for mesh, _ in parts]),
        np.concatenate([shapes for _, shapes in parts], axis=1),
        modes.frequency_hz[picked],
        labels,
        caption="Mode shapes of the coupled reduced model, recovered at the display nodes of each component.",
        first_mode=first,
    )


def shape_notes(study: StudySpec, folder: Path, system: System, modes: Modes) -> tuple[str, ...]:
    """Why mode shapes that the study asks for are not in the report; nothing where it asks for none."""
    if "mode_shapes" not in study.report.model_fields_set:
        return ()
    display, notes = study.report.display, []
    if absent := [str(number) for number in study.report.mode_shapes if not 0 < number <= len(modes)]:
        notes.append(f"report.mode_shapes: there is no mode {', '.join(absent)}; the study solves for modes 1 to {len(modes)}")
    blind = []
    for name, spec in study.components.items():
        if display not in system.component(name).recovery:
            blind.append(f"component {name!r} brings no recovery {display!r}")
        elif _mesh(folder / spec.file, spec) is None:
            blind.append(f"component {name!r} brings no display mesh in its file")
    if blind and study.report.mode_shapes:
        notes.append(f"report.mode_shapes: {'; '.join(blind)}, so its motion cannot be drawn")
    return tuple(notes)


def _mesh(path: Path, spec: ComponentSpec) -> DisplayMesh | None:
    try:
        sidecar = {"sidecar": path.parent / str(spec.options["sidecar"])} if "sidecar" in spec.options else {}
        return read_display_mesh(path, format=spec.format, units=file_units(spec), **sidecar)
    except ReadError:  # a format without display meshes is no error: the report then has no view
        return None


def _placed(mesh: DisplayMesh, system: System, name: str) -> DisplayMesh:
    place = system.placement(name)
    return replace(mesh, positions=place.apply(mesh.positions))


def _shapes(display: str, system: System, name: str, shapes: FloatArray) -> FloatArray:
    """(modes, nodes, 3) displacements in the system frame."""
    rows = system.component(name).recovery[display].displacement
    moved = np.asarray(dense(rows) @ shapes[system.offsets[name]]).T
    return np.asarray(moved.reshape(moved.shape[0], -1, 3) @ system.placement(name).rotation.T)


def _label(study: StudySpec, modes: Modes, k: int) -> str:
    if k < modes.n_rigid:
        return f"Rigid body {k + 1}"
    labels = study.verification.reference.labels if study.verification.reference is not None else []
    place = k - modes.n_rigid
    return labels[place] if place < len(labels) else f"Flexible {place + 1}"
