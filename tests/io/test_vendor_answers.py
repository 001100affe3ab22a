"""Vendor files as they were delivered, against the solvers' own answers (skipped where the validation data are not at hand)."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import h5py
import numpy as np
import pytest
from structures import shared

from flexplant.assembly import Connection, couple
from flexplant.io import read_component, read_model
from flexplant.model.display import DisplayMesh
from flexplant.model.geometry import Placement, rigid_body_vectors
from flexplant.modes import normal_modes
from flexplant.reduction import craig_bampton
from flexplant.report.mode_view import mode_view
from flexplant.verification import mass_properties


def expected(folder: str) -> dict:
    return json.loads(shared(folder, "expected.json").read_text())


def test_five_dmig_bars_reach_mscs_frequencies() -> None:
    """Massless rotations are not in M10, and come back as zero rows; recovery is stored transposed."""
    answer = expected("cofe_dmig_bar")
    bar = read_component(shared("cofe_dmig_bar", "barmat.pch"))
    assert (bar.n, bar.n_modal, bar.source["format"]) == (12, 0, "nastran_dmig")
    np.testing.assert_allclose(np.diag(bar.stiffness), answer["component"]["K_diag"], rtol=1e-9)
    np.testing.assert_allclose(np.diag(bar.mass), answer["component"]["M_diag"], rtol=1e-9)
    bars = [replace(bar, name=f"bar{i}") for i in range(5)]
    chain = [Connection(f"bar{i}", f"bar{i + 1}", [(2, 1)]) for i in range(4)]
    places = {f"bar{i}": Placement(translation=[float(i), 0, 0]) for i in range(5)}
    free = mass_properties(couple(bars, chain, placements=places))
    assert free.mass == pytest.approx(answer["coupled"]["total_mass_free"], rel=1e-9)
    np.testing.assert_allclose(free.center_of_gravity, answer["coupled"]["cg"], atol=1e-9)
    modes = normal_modes(couple(bars, [*chain, Connection("bar0", "ground", [1])], placements=places))
    assert len(modes) == answer["coupled"]["finite_modes"]
    np.testing.assert_allclose(modes.frequency_hz[:10], answer["coupled"]["freq_hz_msc"], rtol=1e-6)


def test_dmig_recovery_rows_are_the_right_way_round() -> None:
    bar = read_component(shared("cofe_dmig_bar", "barmat.pch"))
    np.testing.assert_allclose(bar.recovery["mug1"].displacement, np.eye(12), atol=1e-9)
    assert bar.recovery["mug1"].labels[:2] == ("1.1", "1.2")
    assert bar.recovery["mef1"].labels[-1] == "CBAR.1.8"
    rigid = rigid_body_vectors(bar.nodes, bar.boundary)
    forces = bar.recovery["mef1"].displacement
    assert abs(forces @ rigid).max() < 1e-6 * abs(forces).max()
    stretch = np.zeros(12)
    stretch[6] = 1.0  # unit elongation: the axial force is EA / L, the stiffness's own term
    assert (forces @ stretch)[6] == pytest.approx(bar.stiffness[6, 6], rel=1e-8)


def test_abaqus_and_ansys_agree_on_the_rotor_by_position() -> None:
    answer = expected("exudyn_rotor")
    abaqus = read_model(shared("exudyn_rotor", "rotorDiscTestSTIF1.mtx"), stiffness_factor=1e-2)
    ansys = read_model(shared("exudyn_rotor", "rotorAnsysStiffnessMatrixSparse.txt"))
    assert (abaqus.source["format"], ansys.source["format"]) == ("abaqus_matrices", "ansys_matrices")
    hz = {m.source["format"]: normal_modes(m, n_modes=30).frequency_hz for m in (abaqus, ansys)}
    np.testing.assert_allclose(hz["abaqus_matrices"][6:], answer["free_free_hz_abaqus"][6:], rtol=1e-9)
    np.testing.assert_allclose(hz["ansys_matrices"][6:], answer["free_free_hz_ansys"][6:], rtol=1e-9)
    np.testing.assert_allclose(hz["abaqus_matrices"][6:], hz["ansys_matrices"][6:], rtol=1e-7)
    # the same matrices, entry by entry, once the nodes are matched by position
    distance = np.linalg.norm(abaqus.nodes.positions[:, None] - ansys.nodes.positions[None], axis=2)
    match = {int(abaqus.nodes.ids[i]): int(ansys.nodes.ids[j]) for i, j in enumerate(distance.argmin(axis=1))}
    assert distance.min(axis=1).max() < 2e-7
    rows = ansys.dofs.rows([(match[n], d) for n, d in abaqus.dofs.pairs])
    ours, theirs = abaqus.stiffness.toarray(), ansys.stiffness.toarray()[np.ix_(rows, rows)]
    assert abs(ours - theirs).max() < 1e-6 * abs(ours).max()
    for model in (abaqus, ansys):
        rigid = rigid_body_vectors(model.nodes, model.dofs)
        assert abs(model.stiffness @ rigid).max() < 1e-9 * abs(model.stiffness).max()
        assert (rigid.T @ model.mass @ rigid)[0, 0] == pytest.approx(answer["mass_kg"], rel=1e-6)


def test_rotors_tied_at_their_end_faces() -> None:
    """Two coinciding copies: the spectrum is the union of the free-free and of the fixed-interface one."""
    answer = expected("exudyn_rotor")
    abaqus = read_model(shared("exudyn_rotor", "rotorDiscTestSTIF1.mtx"), stiffness_factor=1e-2, name="abaqus")
    ansys = read_model(shared("exudyn_rotor", "rotorAnsysStiffnessMatrixSparse.txt"), name="ansys")
    parts = [
        craig_bampton(model, [(node, "123") for node in answer[f"interface_node_ids_{model.name}"]], n_modes=20)
        for model in (abaqus, ansys)
    ]
    system = couple(parts, [Connection("abaqus", "ansys", "by position", directions="123", tolerance=1e-5)])
    stated = np.array(answer["overlaid_pair"]["20"]["hz"])
    ours = normal_modes(system).frequency_hz[6 : stated.size]
    np.testing.assert_allclose(ours, stated[6:], rtol=1e-6)


@pytest.mark.parametrize("n_modes", [0, 1, 2, 3])
def test_craig_bampton_beams_reach_mscs_frequencies(n_modes: int) -> None:
    answer = expected("cofe_cb_beams")["results"][str(n_modes)]
    file = shared("cofe_cb_beams", "cantilever_components_KM.npz")
    decks = [shared("cofe_cb_beams", "cantilever_bar", f"cantileverBar{i}.dat") for i in (1, 2)]
    parts = [
        craig_bampton(read_model(file, part=i, geometry=deck), [(6, 2), (6, 6)], n_modes=n_modes)
        for i, deck in zip((1, 2), decks, strict=True)
    ]
    for part, fixed in zip(parts, answer["fixed"], strict=True):
        np.testing.assert_allclose(part.fixed_interface_hz, fixed, rtol=1e-9)
    system = couple(parts, [Connection(parts[0].name, parts[1].name, [(6, 6)], directions="26")])
    modes = normal_modes(system)
    np.testing.assert_allclose(modes.frequency_hz, answer["msc"], rtol=1e-6)


def test_shapes_of_five_dmig_bars_are_mscs_eigenvectors() -> None:
    """MSC's own shapes of the chain, at the grids that each copy of the superelement recovers (MUG1T)."""
    bar = read_component(shared("cofe_dmig_bar", "barmat.pch"), units="SI")
    names = [f"bar{i}" for i in range(5)]
    joints = [Connection(a, b, [(2, 1)]) for a, b in pairwise(names)]
    places = {name: Placement(translation=[float(i), 0, 0]) for i, name in enumerate(names)}
    chain = couple([replace(bar, name=name) for name in names], [*joints, Connection("bar0", "ground", [1])], placements=places)
    mesh = DisplayMesh(bar.nodes.ids, bar.nodes.positions, [], [[0, 1]])
    view = mode_view(chain, normal_modes(chain), dict.fromkeys(names, mesh), numbers=range(1, 11))
    with h5py.File(shared("cofe_dmig_bar", "modes.h5")) as file:
        table = file["NASTRAN/RESULT/NODAL/EIGENVECTOR"][:]
    answer = np.column_stack([table[axis] for axis in "XYZ"]).reshape(10, 6, 3)
    assert table["ID"][:6].tolist() == [1, 2, 3, 4, 5, 6]
    ours = view.shapes[:, [0, 1, 3, 5, 7, 9]]  # grid 1 of the first copy, grid 2 of every copy
    product = np.einsum("kni,kni->k", ours, answer) ** 2
    mac = product / (np.einsum("kni,kni->k", ours, ours) * np.einsum("kni,kni->k", answer, answer))
    assert mac.min() > 1 - 1e-10
    np.testing.assert_array_equal(view.shapes[:, 1], view.shapes[:, 2])  # grid 2 of a copy is grid 1 of the next
