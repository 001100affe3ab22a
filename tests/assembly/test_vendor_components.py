"""Real vendor components: NX Nastran superelements, an MSC DMIG bar with massless rotations, Craig-Bampton beams, a rotor."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from structures import shared

from flexplant.assembly import Connection, couple
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import Nodes, Placement
from flexplant.modes import mac, normal_modes
from flexplant.reduction import craig_bampton
from flexplant.verification import mass_properties, verify

METHODS = ["dual", "primal"]

# NX Nastran 9.1 (assemble.dat, nas2cam.op2): the 48 elastic frequencies, Hz
# fmt: off
NX_HZ = np.array(
    [
        1.698800215, 1.767487404, 1.85772045, 3.419612253, 7.024211134, 7.025409264, 10.72361331, 10.98254925,
        13.86678739, 14.38990594, 14.65085044, 15.19278573, 25.20154241, 25.31349297, 29.12903189, 42.43672226,
        43.08659899, 46.89437378, 47.80847788, 69.44509761, 87.46187723, 97.90689308, 100.8544857, 113.2329539,
        187.2003146, 209.3213729, 236.5214214, 253.2027847, 394.2233404, 472.8677099, 585.2301905, 657.0995887,
        662.1878529, 744.9397024, 816.7069673, 875.6077236, 940.4573189, 945.4732246, 1005.611663, 1010.717147,
        1075.721373, 1161.010776, 1233.997975, 1372.100158, 1610.276641, 1941.317169, 2410.198066, 4937.15228
    ]
)
# fmt: on
NX_GRIDS = {3: (600.0, 0.0, 300.0), 11: (600.0, 300.0, 300.0), 19: (600.0, 300.0, 0.0), 27: (600.0, 0.0, 0.0)}
NX_FRAME_11 = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])  # CORD2R 10: x = basic y, y = basic z, z = basic x
NX_MASS = {"outboard": (1.5903838009872422, 184.63979671558047), "inboard": (1.7550518260260166, 1039.9983507210834)}


def nx_component(name, frame_11=NX_FRAME_11):
    pyyeti = pytest.importorskip("pyyeti")
    from pyyeti.nastran import op4

    matrices = op4.load(str(Path(pyyeti.__file__).parent / "tests" / "nas2cam_extseout" / f"{name}.op4"), into="dct")
    frames = [frame_11 if g == 11 else np.eye(3) for g in NX_GRIDS]
    nodes = Nodes(list(NX_GRIDS), list(NX_GRIDS.values()), frames)
    fields = {"boundary": [(g, "123456") for g in NX_GRIDS], "nodes": nodes, "units": "kg-mm-s"}
    return Component(name=name, stiffness=matrices["kxx"][0], mass=matrices["mxx"][0], **fields)


def nx_system(method="dual"):
    parts = [nx_component("outboard"), nx_component("inboard")]
    return couple(parts, [Connection("outboard", "inboard", [(g, g) for g in NX_GRIDS])], method=method)


@pytest.mark.parametrize("method", METHODS)
def test_nx_superelements_reach_nastrans_assembled_frequencies(method):
    modes = normal_modes(nx_system(method))
    assert modes.n_rigid == 6
    np.testing.assert_array_equal(modes.frequency_hz[:6], 0.0)
    np.testing.assert_allclose(modes.frequency_hz[6:], NX_HZ, rtol=1e-6)


def test_nx_superelements_have_nastrans_mass_properties():
    system = nx_system()
    for name, (mass, x) in NX_MASS.items():
        ours = mass_properties(system.component(name))
        assert ours.mass == pytest.approx(mass, rel=1e-6)
        assert ours.center_of_gravity[0] == pytest.approx(x, rel=1e-6)
    whole = mass_properties(system)
    assert whole.mass == pytest.approx(3.3454356270132592, rel=1e-6)
    np.testing.assert_allclose(whole.center_of_gravity, [633.3702, 150, 150], rtol=2e-7)
    np.testing.assert_allclose(whole.inertia.diagonal(), [3.928379e5, 1.023790e6, 1.354959e6], rtol=2e-7)
    report = verify(system, reference=np.r_[np.zeros(6), NX_HZ], frequency_tolerance=1e-6)
    report.raise_if_failed()


def test_nx_response_at_2_hz_and_its_interface_force():
    """Unit force at grid 11, direction 1 (its own frame): NX SOL 111 response and the multiplier of an independent solution."""
    system = nx_system()
    z = response_at(system, 2.0, system.row("outboard", 11, 1))
    expected = {
        (3, 2): -0.0016538064228370786,
        (11, 1): -0.0016535859322175384,
        (19, 2): -0.0021223491057753563,
        (27, 6): 7.353852e-7,
    }
    for (grid, direction), value in expected.items():
        for name in ("outboard", "inboard"):
            assert z[system.row(name, grid, direction)] == pytest.approx(value, abs=1e-5 * 0.0022)
    force = dict(zip(system.constraint_labels, z[system.n :], strict=True))
    assert force["outboard-inboard.11.1"] == pytest.approx(0.251804294963386, rel=1e-5)
    assert force["outboard-inboard.27.6"] == pytest.approx(0.3387122216928864, rel=1e-5)


def response_at(system, hz, row):
    load = np.zeros(system.n_coupled)
    load[row] = 1.0
    return np.linalg.solve((system.stiffness - (2 * np.pi * hz) ** 2 * system.mass).toarray(), load)


def test_nx_wrong_frame_on_both_sides_keeps_frequencies_and_is_caught():
    parts = [nx_component(n, np.eye(3)) for n in ("outboard", "inboard")]
    system = couple(parts, [Connection("outboard", "inboard", [(g, g) for g in NX_GRIDS])])
    np.testing.assert_allclose(normal_modes(system).frequency_hz[6:], NX_HZ, rtol=1e-6)
    failed = " ".join(f"{c.name} {c.explanation}" for c in verify(system).failed)
    assert "outboard: rigid-body strain energy" in failed
    assert "outboard.11" in failed


def dmig(path, name):
    """Symmetric (12, 12) matrix of a large-field DMIG of grids 1 and 2."""
    out, column = np.zeros((12, 12)), 0
    for line in path.read_text().splitlines():
        if line.startswith(f"DMIG*   {name} "):
            column = 6 * (int(line[24:40]) - 1) + int(line[40:56]) - 1
            inside = True
        elif line.startswith("*") and inside:
            row = 6 * (int(line[8:24]) - 1) + int(line[24:40]) - 1
            out[row, column] = out[column, row] = float(line[40:56])
        else:
            inside = False
    return out


@pytest.mark.parametrize("method", METHODS)
def test_five_copies_of_a_dmig_bar_with_massless_rotations(method):
    path, expected = shared("cofe_dmig_bar", "barmat.pch"), json.loads(shared("cofe_dmig_bar", "expected.json").read_text())
    bar = Component(
        name="bar",
        stiffness=dmig(path, "K10"),
        mass=dmig(path, "M10"),
        boundary=[(1, "123456"), (2, "123456")],
        nodes=Nodes([1, 2], [[0, 0, 0], [1, 0, 0]]),
    )
    assert np.linalg.matrix_rank(bar.mass) == 6
    names = [f"bar{i}" for i in range(1, 6)]
    joints = [Connection(a, b, [(2, 1)]) for a, b in itertools.pairwise(names)]
    places = {n: Placement(translation=[i, 0, 0]) for i, n in enumerate(names)}
    free = couple(dict.fromkeys(names, bar), joints, method=method, placements=places)
    properties = mass_properties(free)
    assert properties.mass == pytest.approx(expected["coupled"]["total_mass_free"], rel=1e-9)
    np.testing.assert_allclose(properties.center_of_gravity, expected["coupled"]["cg"], atol=1e-12)
    clamped = couple(dict.fromkeys(names, bar), [*joints, Connection("bar1", "ground", [1])], method=method, placements=places)
    modes = normal_modes(clamped)
    assert len(modes) == 15, "fifteen finite modes; the fifteen massless rotations have none"
    assert modes.n_rigid == 0
    np.testing.assert_allclose(modes.frequency_hz[:10], expected["coupled"]["freq_hz_msc"], rtol=1e-6)


@pytest.mark.parametrize("n_modes", [0, 1, 2, 3])
def test_craig_bampton_beams_reach_msc(n_modes):
    data = np.load(shared("cofe_cb_beams", "cantilever_components_KM.npz"))
    expected = json.loads(shared("cofe_cb_beams", "expected.json").read_text())["results"][str(n_modes)]
    parts = []
    for i in (1, 2):
        dofs = [tuple(int(x) for x in pair) for pair in data[f"lab{i}"]]
        model = FiniteElementModel(name=f"p{i}", stiffness=data[f"K{i}"], mass=data[f"M{i}"], dofs=dofs)
        parts.append(craig_bampton(model, [(6, "26")], n_modes=n_modes))
        np.testing.assert_allclose(parts[-1].fixed_interface_hz, expected["fixed"][i - 1], rtol=1e-9)
    hz = normal_modes(couple(parts, [Connection("p1", "p2", [(6, 6)], "26")])).frequency_hz
    np.testing.assert_allclose(hz, expected["msc"], rtol=1e-6)


def abaqus_rotor():
    text = shared("exudyn_rotor", "rotorDiscTest.inp").read_text().split("*Node")[1].split("*")[0]
    table = np.array([[float(x) for x in line.split(",")] for line in text.strip().splitlines()])
    matrices = {}
    for kind in ("STIF", "MASS"):
        i, j, v = np.array(shared("exudyn_rotor", f"rotorDiscTest{kind}1.mtx").read_text().split(), dtype=float).reshape(-1, 3).T
        matrices[kind] = sp.csr_array((v, (i.astype(int) - 1, j.astype(int) - 1)))
    dofs = [(int(n), "123") for n in table[:, 0]]
    nodes = Nodes(table[:, 0].astype(int), table[:, 1:])
    return FiniteElementModel(name="rotor", stiffness=0.01 * matrices["STIF"], mass=matrices["MASS"], dofs=dofs, nodes=nodes)


def test_rotor_solid_has_six_exact_rigid_body_modes_and_twins():
    rotor = abaqus_rotor()
    modes = normal_modes(rotor)
    expected = json.loads(shared("exudyn_rotor", "expected.json").read_text())
    assert modes.n_rigid == 6
    np.testing.assert_allclose(modes.frequency_hz[6:30], expected["free_free_hz_abaqus"][6:30], rtol=1e-9)
    assert mass_properties(rotor).mass == pytest.approx(expected["mass_kg"], rel=1e-9)
    assert modes.frequency_hz[7] / modes.frequency_hz[6] - 1 < 1e-9, "a rotor's bending modes come in pairs"
    np.testing.assert_allclose(mac(modes.shapes[:, 6:8], modes.shapes[:, 6:8]), np.eye(2), atol=1e-6)


def test_two_rotors_tied_at_their_end_faces_are_the_union_of_held_and_free():
    """Two copies in one place: symmetric motion is the free rotor's, antisymmetric motion the held one's."""
    rotor = abaqus_rotor()
    face = json.loads(shared("exudyn_rotor", "expected.json").read_text())["interface_node_ids_abaqus"]
    half = craig_bampton(rotor, [(n, "123") for n in face], n_modes=20)
    half = Component(**{f: getattr(half, f) for f in ("name", "mass", "stiffness", "boundary")}, nodes=rotor.nodes)
    system = couple({"a": half, "b": half}, [Connection("a", "b", "by position", "123")])
    modes = normal_modes(system)
    assert modes.n_rigid == 6
    free = normal_modes(half).frequency_hz
    union = np.sort(np.r_[free, half.fixed_interface_hz])
    np.testing.assert_allclose(modes.frequency_hz[6:], union[6:], rtol=1e-6)
    assert la.norm(system.constraints @ modes.shapes) < 1e-12 * la.norm(modes.shapes)
