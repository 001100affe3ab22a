"""`verify` names what is wrong: floating parts, grounded directions, wrong frames, masses that do not add up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
from structures import CHAIN, chain, chain_halves, frame_model, random_rotation, whole_component

from flexplant.assembly import Connection, couple
from flexplant.errors import CheckFailedError, InputError
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.geometry import Nodes, Placement, cross_matrix
from flexplant.modes import normal_modes
from flexplant.reduction import craig_bampton
from flexplant.verification import Reference, check_component, mass_properties, verify
from flexplant.verification.comparison import cluster_mac
from flexplant.verification.mass import combined

NAMES = {"1": "Tx", "2": "Ty", "3": "Tz", "4": "Rx", "5": "Ry", "6": "Rz"}
JOINT = Connection("left", "right", [(4, 4)])


def random_pair(seed):
    rng = np.random.default_rng(seed)
    places = {n: Placement(random_rotation(10 * seed + i), rng.normal(size=3)) for i, n in enumerate(("left", "right"))}
    frames = {n: {k: random_rotation(100 * seed + 10 * i + k) for k in CHAIN} for i, n in enumerate(("left", "right"))}
    return chain_halves(places, frames), places


@pytest.mark.parametrize("seed", range(4))
def test_a_good_model_passes_every_check(seed):
    parts, places = random_pair(seed)
    report = verify(couple(parts, [JOINT], placements=places))
    assert report.passed, str(report)
    report.raise_if_failed()
    assert report["rigid-body modes"].value == 6
    assert {"symmetry of coupled mass", "sum rule, inertia", "left-right: compatible sides"} <= {c.name for c in report.checks}


@pytest.mark.parametrize("missing", list("123456"))
@pytest.mark.parametrize("seed", [0, 1])
def test_a_floating_direction_is_named(missing, seed):
    """The joint lacks one direction of the system frame, at the joint: a slide or a hinge."""
    parts, places = random_pair(seed)
    joint = Connection("left", "right", [(4, 4)], directions="123456".replace(missing, ""), frame="system")
    report = verify(couple(parts, [joint], placements=places))
    check = report["rigid-body modes"]
    assert (check.value, check.passed) == (7, False)
    text = check.explanation
    assert text.startswith("1 too many")
    assert "'left' floats" in text or "'right' floats" in text
    assert NAMES[missing] in text
    others = {NAMES[d] for d in "123456"} - {NAMES[missing]}
    assert not any(o in text for o in others), f"a slide or hinge moves along or about one axis only: {text}"


@pytest.mark.parametrize("method", ["dual", "primal"])
@pytest.mark.parametrize("floating", ["a", "b", "c"])
def test_the_component_that_was_left_uncoupled_is_named(method, floating):
    line = [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6)]
    parts = [whole_component(frame_model(n, CHAIN, line)) for n in "abc"]
    others = [n for n in "abc" if n != floating]
    report = verify(couple(parts, [Connection(*others, [(3, 3)])], method=method))
    check = report["rigid-body modes"]
    assert check.value == 12
    assert "6 too many" in check.explanation
    assert f"'{floating}' floats in Tx, Ty, Tz, Rx, Ry, Rz" in check.explanation


def test_a_floating_component_is_named_without_geometry_too():
    parts = [replace(c, nodes=None) for c in chain_halves()]
    loose = replace(parts[0], name="loose")
    report = verify(couple([*parts, loose], [JOINT]))
    assert report["rigid-body modes"].value == 12
    assert "floats" in report["rigid-body modes"].explanation
    assert any("no node positions for left, right, loose" in n for n in report.notes)


@pytest.mark.parametrize("direction", list("123456"))
@pytest.mark.parametrize("seed", [0, 3])
def test_a_direction_held_by_a_constraint_is_named(direction, seed):
    parts, places = random_pair(seed)
    ground = Connection("left", "ground", [1], directions=direction, frame="system", name="strut")
    check = verify(couple(parts, [JOINT, ground], placements=places))["rigid-body modes"]
    assert (check.value, check.passed) == (5, False)
    assert "1 too few" in check.explanation
    assert f"strut.1.{direction}" in check.explanation
    assert f"{NAMES[direction]} is held by strut" in check.explanation


@pytest.mark.parametrize("guilty", ["left", "right"])
@pytest.mark.parametrize("direction", [1, 2, 3])
@pytest.mark.parametrize("stiffness", [1e2, 1e6])
def test_a_component_grounded_inside_its_stiffness_is_named(guilty, direction, stiffness):
    parts = {c.name: c for c in chain_halves()}
    node = {"left": 2, "right": 6}[guilty]
    victim = parts[guilty]
    k = victim.stiffness.copy()
    row = victim.dofs.row(node, direction)
    k[row, row] += stiffness
    parts[guilty] = replace(victim, stiffness=k)
    report = verify(couple(list(parts.values()), [JOINT]))
    check = report["rigid-body modes"]
    assert not check.passed
    assert check.value == 5
    assert f"component '{guilty}' is grounded" in check.explanation
    assert f"{guilty}.{node}.{direction}" in check.explanation
    innocent = {"left": "right", "right": "left"}[guilty]
    assert report[f"{innocent}: rigid-body strain energy"].passed
    assert not report[f"{guilty}: rigid-body strain energy"].passed


def test_a_clamped_system_has_no_rigid_body_mode():
    report = verify(couple(chain_halves(), [JOINT, Connection("left", "ground", [1])]), rigid_body_modes=0)
    assert report.passed, str(report)
    hinged = verify(couple(chain_halves(), [JOINT, Connection("left", "ground", [1], "12345")]), rigid_body_modes=0)
    assert hinged["rigid-body modes"].value == 1
    assert "Rz" in hinged["rigid-body modes"].explanation


def test_frames_wrong_on_both_sides_keep_the_frequencies_and_fail_the_energy():
    frames = {n: {4: random_rotation(2)} for n in ("left", "right")}
    parts = chain_halves(frames=frames)
    good = couple(parts, [JOINT])
    basic = [replace(c, nodes=Nodes(c.nodes.ids, c.nodes.positions)) for c in parts]
    wrong = couple(basic, [JOINT])
    np.testing.assert_allclose(normal_modes(wrong).frequency_hz[6:], normal_modes(good).frequency_hz[6:], rtol=1e-9)
    report = verify(wrong)
    for name in ("left", "right"):
        check = report[f"{name}: rigid-body strain energy"]
        assert not check.passed
        assert f"{name}.4." in check.explanation
    assert verify(good).passed


def test_a_component_behind_one_node_is_free():
    """Statically determinate interface: the boundary stiffness is round-off only, and no scale for itself."""
    parts = []
    for half in chain_halves():
        model = FiniteElementModel(name=half.name, mass=half.mass, stiffness=half.stiffness, dofs=half.boundary, nodes=half.nodes)
        parts.append(craig_bampton(model, [(4, "123456")], n_modes=6))
    system = couple(parts, [JOINT])
    assert abs(parts[0].stiffness[:6, :6]).max() < 1e-9 * parts[0].stiffness.max()
    report = verify(system)
    assert report["rigid-body modes"].value == 6
    assert report["left: rigid-body strain energy"].passed, str(report)
    np.testing.assert_array_equal(normal_modes(system).frequency_hz[:6], 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_mass_properties_follow_the_definition_and_the_parallel_axis_theorem(seed):
    parts, places = random_pair(seed)
    system = couple(parts, [JOINT], placements=places)
    whole, model = mass_properties(system), chain()
    rigid = np.vstack([np.block([[np.eye(3), -cross_matrix(p)], [np.zeros((3, 3)), np.eye(3)]]) for p in CHAIN.values()])
    m = rigid.T @ model.mass @ rigid
    mass = m[0, 0]
    center = np.array([m[2, 4], m[0, 5], m[1, 3]]) / mass
    inertia = m[3:, 3:] + mass * cross_matrix(center) @ cross_matrix(center)
    assert whole.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(whole.center_of_gravity, center * [-1, -1, -1] if center @ whole.center_of_gravity < 0 else center)
    np.testing.assert_allclose(whole.inertia, inertia, atol=1e-10 * inertia.max())
    added = combined([(mass_properties(c), places[c.name]) for c in parts])
    np.testing.assert_allclose(added.inertia, inertia, atol=1e-10 * inertia.max())
    assert whole.anisotropy < 1e-12


def test_a_planar_mass_is_reported_as_anisotropic():
    part = whole_component(chain())
    m = part.mass.copy()
    m[part.dofs.row(3, 2), part.dofs.row(3, 2)] += 0.5
    report = check_component(replace(part, mass=m))
    assert [c.name for c in report.failed] == ["whole: mass equal in all directions"]
    with pytest.raises(InputError, match="no translational mass"):
        mass_properties(replace(part, mass=np.zeros_like(m)))
    with pytest.raises(InputError, match="no node positions"):
        mass_properties(replace(part, nodes=None))
    with pytest.raises(InputError, match="got str"):
        mass_properties("bus")


def test_sum_rule_catches_the_mass_that_constraints_hide():
    """An indefinite component and one with a negative stiffness are reported where they belong."""
    left, right = chain_halves()
    values = np.linalg.eigvalsh(right.mass)
    bent = replace(right, mass=right.mass - 1.5 * values[0] * np.eye(right.n))
    report = verify(couple([left, bent], [JOINT]), modes=normal_modes(couple([left, right], [JOINT])))
    assert report["right: mass positive semi-definite"].passed, "a component's mass may be indefinite"
    assert "the coupled mass decides" in report["right: mass positive semi-definite"].explanation
    assert not report["coupled: mass positive semi-definite"].passed
    soft = replace(left, stiffness=left.stiffness - 1e-3 * np.diag(left.stiffness.diagonal()))
    failed = {c.name for c in verify(couple([soft, right], [JOINT]), modes=normal_modes(couple([left, right], [JOINT]))).failed}
    assert "left: stiffness positive semi-definite" in failed


def test_the_reference_table_gives_errors_and_mac():
    system = couple(chain_halves(), [JOINT])
    modes = normal_modes(system)
    labels = [f"left.{n}.{d}" for n in (1, 2, 3) for d in (1, 2, 3)] + [f"right.{n}.{d}" for n in (5, 6) for d in (1, 2, 3)]
    rows = [system.labels.index(label) for label in labels]
    hz = modes.frequency_hz[:12] * 1.001
    shapes = -3.0 * modes.shapes[rows][:, :12]
    good = verify(system, reference=Reference(hz, shapes, labels, names=[f"m{i}" for i in range(12)]), frequency_tolerance=2e-3)
    assert good.passed
    table = next(t for t in good.tables if "reference" in t.title)
    assert table.rows[0][0] == "m6"
    assert table.rows[0][3] == pytest.approx(-100 * 0.001 / 1.001, rel=1e-9)
    assert table.rows[0][4] == pytest.approx(1.0, abs=1e-12)
    bad = verify(system, reference=Reference(hz, shapes[:, ::-1], labels))
    assert not bad["shapes against the reference"].passed
    assert not verify(system, reference=hz, frequency_tolerance=1e-4)["frequencies against the reference"].passed
    with pytest.raises(InputError, match="only 30 were computed"):
        verify(system, reference=np.arange(1.0, 32.0))
    with pytest.raises(InputError, match=r"'left\.99\.1'|no node 99"):
        verify(system, reference=Reference([1.0], np.ones((1, 1)), ["left.99.1"]))
    with pytest.raises(InputError, match="neither a DOF nor a recovery row"):
        verify(system, reference=Reference([1.0], np.ones((1, 1)), ["left.tip.x"]))
    with pytest.raises(InputError, match="labels x"):
        Reference([1.0, 2.0], np.ones((3, 2)), ["a.1.1"])


def test_mac_of_close_modes_compares_subspaces():
    shapes = la.qr(np.random.default_rng(0).normal(size=(9, 3)), mode="economic")[0]
    turn = la.block_diag([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]], 1.0)
    np.testing.assert_allclose(cluster_mac(np.array([10.0, 10.001, 20.0]), shapes @ turn, shapes), 1.0, atol=1e-12)
    apart = cluster_mac(np.array([10.0, 15.0, 20.0]), shapes @ turn, shapes)
    np.testing.assert_allclose(apart, [np.cos(1.0) ** 2, np.cos(1.0) ** 2, 1.0], atol=1e-12)


def test_the_report_reads_as_a_table_and_raises_with_every_failure():
    report = verify(couple(chain_halves(), [Connection("left", "right", [(4, 4)], "12345")]))
    text = str(report)
    lines = text.splitlines()
    assert lines[0].split()[:3] == ["check", "value", "limit"]
    assert set(lines[1]) == {"-"}
    assert "FAILED" in text
    assert "Mass properties, SI" in text
    assert all(head in text for head in ("mass [kg]", "x [m]", "Izx [kg m^2]"))
    assert not report.passed
    with pytest.raises(CheckFailedError, match=r"1 of \d+ checks failed:\n  rigid-body modes: 7"):
        report.raise_if_failed()


def test_notes_tell_of_gaps_and_redundant_constraints():
    apart = {"right": Placement(translation=[0.0, 0.0, 0.25])}
    left, right = chain_halves()
    third = replace(left, name="third")
    ring = [JOINT, Connection("third", "left", [(4, 4)]), Connection("third", "right", [(4, 4)], name="last")]
    report = verify(couple([left, right, third], ring, placements=apart))
    assert report.passed, str(report)
    assert any("0.25 apart (rigid)" in n for n in report.notes)
    assert any("redundant constraints left out" in n for n in report.notes)
    with pytest.raises(InputError, match="rigid_body_modes must be a whole number from 0"):
        verify(couple(chain_halves(), [JOINT]), rigid_body_modes=-1)


def test_a_component_without_nodes_or_with_an_empty_boundary_is_checked_as_far_as_it_goes():
    lone = Component(name="tank", mass=np.eye(2), stiffness=np.diag([4.0, 9.0]), boundary=[])
    report = check_component(lone)
    assert report.passed
    assert report.notes
    assert verify(couple([lone]), rigid_body_modes=0).passed


@pytest.mark.parametrize("positions", [True, False])
@pytest.mark.parametrize("node", [1, 4, 6])
def test_a_component_held_at_one_node_is_sound(node, positions):
    """Its boundary stiffness is the round-off of the condensation, of any sign: no mode, no energy, no indefiniteness."""
    part = craig_bampton(chain(), [(node, "123456")], n_modes=20)
    part = part if positions else replace(part, nodes=None)
    modes = normal_modes(part)
    assert (modes.frequency_hz[:6] == 0).all()
    assert modes.frequency_hz[6] > 1
    assert modes.residuals.max() < 1e-9
    report = verify(couple([part]))
    assert report.passed, str(report)
    assert check_component(part).passed


def test_a_negative_stiffness_behind_one_node_is_still_found():
    part = craig_bampton(chain(), [(4, "123456")], n_modes=20)
    stiffness = part.stiffness.toarray() if hasattr(part.stiffness, "toarray") else part.stiffness.copy()
    stiffness[0, 0] = -1e-4 * stiffness[6, 6] * part.mass[0, 0]
    report = check_component(replace(part, stiffness=stiffness))
    assert any("stiffness positive semi-definite" in c.name and not c.passed for c in report.checks)


def test_verify_names_what_it_was_given():
    part, _ = chain_halves()
    with pytest.raises(InputError, match="verify takes a coupled System, got Component"):
        verify(part)
    for bad in (None, "6", 5.5):
        with pytest.raises(InputError, match="rigid_body_modes must be a whole number from 0"):
            verify(couple([part]), rigid_body_modes=bad)
    for bad in ("f.txt", {"a": 1}):
        with pytest.raises(InputError, match="reference frequencies: real numbers"):
            verify(couple([part]), reference=bad)
