"""Mode shapes of a coupled system on the meshes of its components."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexplant.assembly import System
from flexplant.errors import InputError, expect, nearest
from flexplant.model.arrays import FloatArray, IntArray, dense, items_of
from flexplant.model.component import Component
from flexplant.model.display import DisplayMesh, part_of
from flexplant.modes import Modes, expect_modes_of
from flexplant.reduction.expansion import GRIDS, Expansion, expansion
from flexplant.report.structure import StructureView, joined

CAPTION = "Mode shapes of the coupled reduced model, expanded to the nodes of each component's mesh"
APART = 1e-3  # of a component's extent: farther from its own nodes, a mesh is in other units or of another component


def mode_view(
    system: System,
    modes: Modes,
    meshes: Mapping[str, DisplayMesh],
    *,
    numbers: Sequence[int] | None = None,
    labels: Sequence[str] = (),
    recovery: str = GRIDS,
) -> StructureView:
    """Modes on the meshes of components, for `plot` and for the report: u = T p at every node that a component recovers.

    meshes: component name -> mesh in its own frame, as `read_geometry(deck, units=...)` gives it. numbers: modes counted from 1,
    rigid-body modes first; None takes the first twelve. recovery: as of `expansion`. Nodes that a component does not
    recover are left out with the elements at them, and the caption counts them. Raises InputError for unknown components and
    modes, for components that cannot expand, and for meshes that are not where the component is.
    """
    expect(system, System, "mode_view", "couple(components, connections) makes one")
    expect_modes_of(modes, system, "mode_view")
    picked, named = _picked(modes, numbers), items_of(labels)
    if named is None or not all(isinstance(text, str) for text in named):
        raise InputError(f"mode_view: labels must be a list of texts, one a mode, got {labels!r:.60}")
    if not isinstance(meshes, Mapping) or not meshes:
        raise InputError(f"mode_view: meshes must map component names to meshes, got {meshes!r:.60}")
    parts, notes, still = [], [], []
    for name, mesh in meshes.items():
        if name not in system.offsets:
            raise InputError(f"mode_view: the system has no component {name!r:.60}." + nearest(str(name), system.offsets))
        expect(mesh, DisplayMesh, f"mode_view: mesh of {name!r}", "read_geometry(deck) makes one")
        component, place = system.component(name), system.placement(name)
        kept, shapes = node_motion(component, mesh, modes.shapes[system.offsets[name]][:, picked], recovery)
        part = part_of(mesh, kept)
        if part is None:
            raise InputError(f"mode_view: component {name!r} recovers no node of its mesh (nodes {mesh.nodes[:6].tolist()} ...)")
        if not kept.all():
            notes.append(f"{name}: {np.count_nonzero(kept)} of {kept.size} nodes, which is all that its recovery has")
        still.append(replace(mesh, positions=place.apply(mesh.positions)))
        parts.append((replace(part, positions=place.apply(part.positions)), shapes @ place.rotation.T))
    return StructureView(
        joined([part for part, _ in parts]),
        np.concatenate([shapes for _, shapes in parts], axis=1),
        modes.frequency_hz[picked],
        named or [_label(modes, k) for k in picked],
        caption="; ".join([CAPTION, *notes]) + ".",
        first_mode=next((i for i, k in enumerate(picked) if k >= modes.n_rigid), 0),
        still=joined(still) if notes else None,
    )


def _picked(modes: Modes, numbers: Sequence[int] | None) -> list[int]:
    if numbers is None:
        return list(range(min(len(modes), 12)))
    listed = list(numbers) if isinstance(numbers, Sequence) and not isinstance(numbers, str) else []
    if not listed or not all(isinstance(k, int | np.integer) and 0 < k <= len(modes) for k in listed):
        raise InputError(f"mode_view: numbers must be whole numbers from 1 to {len(modes)}, got {numbers!r:.60}")
    return [int(k) - 1 for k in listed]


def _label(modes: Modes, k: int) -> str:
    return f"Rigid body {k + 1}" if k < modes.n_rigid else f"Flexible {k - modes.n_rigid + 1}"


def node_motion(component: Component, mesh: DisplayMesh, shapes: FloatArray, recovery: str) -> tuple[Any, FloatArray]:
    """Which nodes of the mesh a component moves (n,), and their displacements (modes, moved nodes, 3) in its basic frame.

    shapes: (component.n, modes). A node counts where its three translations are known; where the expansion has every DOF of the
    model, those that it has not are held, hence zero.
    """
    _check_place(component, mesh)
    found = expansion(component, recovery=recovery)
    row = _translations(found, mesh)
    kept = (row >= 0).any(axis=1) if found.complete else (row >= 0).all(axis=1)
    moved = dense(found.rows @ shapes)
    local = np.where((row[kept] >= 0)[:, :, None], moved[row[kept]], 0.0)
    return kept, np.einsum("nji,njm->mni", _frames(component, mesh)[kept], local)


def _translations(found: Expansion, mesh: DisplayMesh) -> IntArray:
    """(n, 3) rows of the three translations of each node, -1 where there is none."""
    row = np.full((mesh.nodes.size, 3), -1)
    place = {int(node): i for i, node in enumerate(mesh.nodes)}
    for k, (node, direction) in enumerate(found.dofs.pairs):
        if 1 <= direction <= 3 and node in place:
            row[place[node], direction - 1] = k
    return row


def _frames(component: Component, mesh: DisplayMesh) -> FloatArray:
    """(n, 3, 3) displacement axes: those that the component states, else the mesh's."""
    frames = np.tile(np.eye(3), (mesh.nodes.size, 1, 1)) if mesh.frames is None else np.array(mesh.frames)
    if component.nodes is not None:
        for i, node in enumerate(mesh.nodes.tolist()):
            if node in component.nodes:
                frames[i] = component.nodes.frame(node)
    return frames


def _check_place(component: Component, mesh: DisplayMesh) -> None:
    """InputError where nodes of the mesh are not where the component has them."""
    if component.nodes is None:
        return
    shared = [i for i, node in enumerate(mesh.nodes.tolist()) if node in component.nodes]
    apart = [float(abs(mesh.positions[i] - component.nodes.position(int(mesh.nodes[i]))).max()) for i in shared]
    if apart and max(apart) > APART * max(component.nodes.extent, float(np.ptp(mesh.positions, axis=0).max())):
        node = int(mesh.nodes[shared[int(np.argmax(apart))]])
        raise InputError(
            f"mode_view: node {node} of the mesh is {max(apart):.3g} from where component {component.name!r} has it; give "
            "read_geometry the units of the component's file (units=), and the deck of this component"
        )
