"""Mode shapes on the meshes of vendors' decks, through the displacement recovery of their components."""

from __future__ import annotations

import importlib.util
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from structures import frame_model

import flexplant as fp
from flexplant.errors import InputError
from flexplant.model.display import DisplayMesh

TRUSS = Path(importlib.util.find_spec("pyyeti").origin).parent / "tests" / "nas2cam_extseout"  # type: ignore[union-attr,arg-type]
INTERFACE = (3, 11, 19, 27)
PARTS = ("outboard", "inboard")


def lowest_mac(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Of shapes (modes, nodes, 3), one to one."""
    a, b = (x.reshape(len(x), -1) for x in (ours, theirs))
    return float(((a * b).sum(axis=1) ** 2 / ((a * a).sum(axis=1) * (b * b).sum(axis=1))).min())


def truss() -> tuple[fp.System, fp.Modes]:
    parts = [fp.read_component(TRUSS / f"{name}.op4", units="mm-kg-s") for name in PARTS]
    system = fp.couple(parts, [fp.Connection(*PARTS, pairs=[(n, n) for n in INTERFACE])])
    return system, fp.normal_modes(system)


def decks() -> dict[str, DisplayMesh]:
    return {name: fp.read_geometry(TRUSS / f"{name}.dat", units="mm-kg-s") for name in PARTS}


def test_shapes_are_those_of_the_vendors_unreduced_run() -> None:
    """NX's own eigenvectors of the whole truss at the grids that both superelements recover, one of them in a turned frame."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from pyyeti.nastran import op2

        answer = op2.rdpostop2(str(TRUSS / "full.op2"), getougv1=True)["mats"]["ougv1"][0]
    row = {(int(grid), int(direction)): i for i, (grid, direction) in enumerate(answer["dof"])}
    system, modes = truss()
    numbers = range(modes.n_rigid + 1, modes.n_rigid + 12)
    view = fp.mode_view(system, modes, decks(), numbers=numbers)
    assert set(view.mesh.nodes.tolist()) == {3, 4, 11, 16, 19, 27, 45, 60}
    assert "outboard: 6 of 27 nodes" in view.caption
    assert view.still is not None
    assert len(view.still.nodes) == 27 + 26
    shared = [i for i, grid in enumerate(view.mesh.nodes.tolist()) if (grid, 1) in row]
    at = [[row[int(view.mesh.nodes[i]), d] for d in (1, 2, 3)] for i in shared]
    theirs = np.array([answer["ougv1"][at, number - 1].real for number in numbers])
    assert lowest_mac(view.shapes[:, shared], theirs) > 0.999999


def superelement(folder: Path, name: str) -> tuple[fp.FiniteElementModel, fp.Component]:
    """Beams on the grids of the vendor's deck, and what comes back from a file that recovers the displacements of all grids."""
    mesh = fp.read_geometry(TRUSS / f"{name}.blk", units="mm-kg-s")
    place = dict(zip(mesh.nodes.tolist(), np.asarray(mesh.positions), strict=True))
    frames = None if mesh.frames is None else dict(zip(mesh.nodes.tolist(), np.asarray(mesh.frames), strict=True))
    bars = [tuple(mesh.nodes[line].tolist()) for line in mesh.lines]
    model = frame_model(name, place, bars, frames=frames)
    component = fp.craig_bampton(model, [(n, "123456") for n in INTERFACE], n_modes=40, residual_vectors=1, keep_basis=True)
    rows = [f"{n}.{d}" for n, d in model.dofs.pairs]
    recovered = replace(component, recovery=[fp.Recovery("mug1", rows, displacement=component.basis, units="m or rad")])
    return model, fp.read_component(fp.write_component(recovered, folder / f"{name}.op4"), units="SI")


def test_every_grid_of_the_deck_moves_as_in_the_unreduced_model(tmp_path: Path) -> None:
    """Frames differ from grid to grid; one part is placed elsewhere, so that its shapes have to be turned."""
    made = dict(superelement(tmp_path, name) for name in PARTS)
    models, parts = list(made), list(made.values())
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    places = {name: fp.Placement(turn, [1.0, 2.0, 3.0]) for name in PARTS}
    pairs = [fp.Connection(*PARTS, pairs=[(n, n) for n in INTERFACE])]
    system = fp.couple(parts, pairs, placements=places)
    modes = fp.normal_modes(system)
    meshes = {name: fp.read_geometry(TRUSS / f"{name}.blk", units="mm-kg-s") for name in PARTS}
    numbers = list(range(7, 15))
    view = fp.mode_view(system, modes, meshes, numbers=numbers)
    assert (len(view.mesh.nodes), view.still, view.captions[0].split(" · ")[0]) == (52, None, "Flexible 1")
    np.testing.assert_allclose(view.mesh.positions[0], turn @ meshes["outboard"].positions[0] + [1, 2, 3])

    held = [[(node, "123456") for node in model.nodes.ids.tolist()] for model in models]
    kept = [fp.guyan(model, nodes, keep_basis=True) for model, nodes in zip(models, held, strict=True)]
    whole = fp.couple(kept, pairs, placements=places)
    exact = fp.normal_modes(whole, n_modes=20)
    np.testing.assert_allclose(modes.frequency_hz[6:14], exact.frequency_hz[6:14], rtol=1e-6)
    theirs = fp.mode_view(whole, exact, meshes, numbers=numbers)
    assert lowest_mac(view.shapes, theirs.shapes) > 0.999999
    part, found = parts[0], fp.expansion(parts[0])
    field = fp.expand(part, modes.shapes[system.offsets["outboard"]][:, 6:8])
    assert field.shape == (len(found.dofs), 2)
    np.testing.assert_allclose(field[found.dofs.row(11, 2)], part.recovery["mug1"].displacement[found.dofs.row(11, 2)]
                               @ modes.shapes[system.offsets["outboard"]][:, 6:8])  # fmt: skip
    drawn = fp.plot(view, title="first")
    lines = {trace.name: trace for trace in drawn.data if trace.name}
    assert set(lines) == {"undeformed", "deformed"}
    assert len(lines["deformed"].x) == 3 * len(view.mesh.lines)
    assert "first" in drawn.layout.title.text


def test_a_mesh_that_does_not_fit_is_refused() -> None:
    system, modes = truss()
    meshes = decks()
    blind = fp.couple([replace(system.component("outboard"), recovery={})], [])
    for call, message in (
        (lambda: fp.mode_view(system, modes, {"outboard": fp.read_geometry(TRUSS / "outboard.dat")}), "read_geometry the units"),
        (lambda: fp.mode_view(system, modes, {"outbord": meshes["outboard"]}), "no component 'outbord'.*outboard"),
        (lambda: fp.mode_view(system, modes, meshes, numbers=[0]), "whole numbers from 1 to 54"),
        (lambda: fp.mode_view(system, modes, {}), "meshes must map"),
        (lambda: fp.mode_view(system, modes, meshes, recovery="mef1"), "no rows such as"),
        (lambda: fp.mode_view(blind, fp.normal_modes(blind), {"outboard": meshes["outboard"]}), r"DISPLACEMENT\(PLOT\) = ALL"),
        (lambda: fp.plot(fp.mode_view(system, modes, meshes), output="a"), "a mode shape has none"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_expansion_adds_the_boundary_and_leaves_scalar_points_out() -> None:
    part = fp.read_component(TRUSS / "outboard.op4", units="mm-kg-s")
    found = fp.expansion(part)
    assert len(found.dofs) == 36
    assert 1995002 not in found.dofs.nodes
    rows = [i for i, label in enumerate(part.recovery["mug1"].labels) if not label.startswith("11.")]
    given = part.recovery["mug1"]
    less = replace(part, recovery=[fp.Recovery("mug1", [given.labels[i] for i in rows], displacement=given.displacement[rows])])
    again = fp.expansion(less)
    assert set(again.dofs.pairs) == set(found.dofs.pairs)
    p = np.arange(part.n, dtype=float)
    order = found.dofs.rows(again.dofs.pairs)
    np.testing.assert_allclose(fp.expand(less, p), fp.expand(part, p)[order], atol=1e-9 * abs(p).max())
