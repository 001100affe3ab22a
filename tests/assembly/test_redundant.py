"""Redundant constraints: three components at a node, loops of rigid links; contradictions; singular and indefinite masses."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
from structures import bordered_hz, elastic_hz, frame_model, whole_component

from flexplant.assembly import Connection, couple
from flexplant.errors import CouplingError, SolverError
from flexplant.model.component import Component
from flexplant.model.geometry import Placement
from flexplant.modes import normal_modes

STAR = {1: np.zeros(3), 2: np.array([1.0, 0.2, 0.0]), 3: np.array([-0.4, 0.9, 0.1]), 4: np.array([0.1, -0.3, 1.1])}
WHOLE = frame_model("star", STAR, [(1, 2), (1, 3), (1, 4)], masses={2: 1.0, 3: 0.5})
METHODS = ["dual", "primal"]


def arms():
    masses = {"a": {2: 1.0}, "b": {3: 0.5}, "c": {}}
    return [
        whole_component(frame_model(name, {1: STAR[1], tip: STAR[tip]}, [(1, tip)], masses=masses[name]))
        for name, tip in (("a", 2), ("b", 3), ("c", 4))
    ]


@pytest.mark.parametrize("method", METHODS)
def test_three_components_at_one_node(method):
    joints = [Connection(*names, [(1, 1)]) for names in (("a", "b"), ("b", "c"), ("c", "a"))]
    system = couple(arms(), joints, method=method)
    assert system.redundant == tuple(f"c-a.1.{d}" for d in range(1, 7))
    assert system.n_constraints == 12
    plain = couple(arms(), joints[:2], method=method)
    np.testing.assert_allclose(normal_modes(system).frequency_hz, normal_modes(plain).frequency_hz, rtol=1e-12)
    np.testing.assert_allclose(normal_modes(system).frequency_hz[6:], elastic_hz(WHOLE.mass, WHOLE.stiffness, 6), rtol=1e-9)
    force = np.zeros(system.n_coupled)
    if method == "dual":
        np.testing.assert_allclose(bordered_hz(system)[6:], normal_modes(system).frequency_hz[6:], rtol=1e-9)
        force[3] = 1.0
        solved = [np.linalg.solve(s.stiffness.toarray() - 400.0 * s.mass.toarray(), force) for s in (system, plain)]
        np.testing.assert_allclose(solved[0][: system.n], solved[1][: plain.n], atol=1e-9 * abs(solved[1]).max())


@pytest.mark.parametrize("method", METHODS)
def test_a_loop_of_rigid_links_is_consistent(method):
    """Tips tied to each other by rigid links in a ring: the last link follows from the others."""
    joints = [Connection("a", "b", [(2, 3)]), Connection("b", "c", [(3, 4)]), Connection("c", "a", [(4, 2)])]
    system = couple(arms(), joints, method=method)
    assert system.redundant == tuple(f"c-a.4.{d}" for d in range(1, 7))
    modes = normal_modes(system)
    assert modes.n_rigid == 6
    plain = couple(arms(), joints[:2], method=method)
    np.testing.assert_allclose(modes.frequency_hz[6:], normal_modes(plain).frequency_hz[6:], rtol=1e-9)
    assert abs(system.constraints @ system.basis).max() < 1e-14


def test_ground_twice_through_a_rigid_link_is_redundant_not_contradictory():
    a, b, _ = arms()
    joints = [Connection("a", "b", [(1, 1)]), Connection("a", "ground", [1]), Connection("b", "ground", [1])]
    system = couple([a, b], joints)
    assert system.redundant == tuple(f"b-ground.1.{d}" for d in range(1, 7))
    assert normal_modes(system).n_rigid == 0


def bar(name, **fields):
    k = 5.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return Component(name=name, mass=np.eye(2), stiffness=k, boundary=[(1, 1), (2, 1)], **fields)


def test_contradictory_frames_at_a_node_raise_and_name_the_constraint():
    a, b, _ = arms()
    turned = Connection("a", "b", [((1, 1), (1, 2))], name="crossed")
    with pytest.raises(CouplingError, match=r"crossed\.1\.1 contradicts rigid-body motion"):
        couple([a, b], [turned])


def test_rows_that_together_lock_a_coordinate_raise():
    """Without positions: c is turned by half a turn, yet its coordinates are also equated as they are: u = -u."""
    part = {"mass": np.eye(2), "stiffness": np.zeros((2, 2)), "boundary": [(1, 1), (1, 2)]}
    parts = [Component(name=name, **part) for name in "abc"]
    turned = {"c": Placement(rotation=np.diag([-1.0, -1.0, 1.0]))}
    pairs = [((1, 1), (1, 1)), ((1, 2), (1, 2))]
    loop = [Connection("a", "b", [(1, 1)], "12"), Connection("b", "c", pairs), Connection("a", "c", [(1, 1)], "12")]
    with pytest.raises(CouplingError, match=r"contradictory constraints: together with a-c\.1\.1 the connections lock"):
        couple(parts, loop, placements=turned)
    assert len(couple(parts, loop).redundant) == 2, "without the turn the loop merely repeats itself"


def test_the_same_dof_coupled_twice_is_named():
    a, b, c = arms()
    with pytest.raises(CouplingError, match=r"coupled twice, by one\.1\.\d and by two\.1\.\d"):
        couple([a, b, c], [Connection("a", "b", [(1, 1)], name="one"), Connection("b", "a", [(1, 1)], "3", name="two")])
    with pytest.raises(CouplingError, match="coupled twice"):
        couple([a, b, c], [Connection("a", "b", [(1, 1), (1, 1)])])


@pytest.mark.parametrize("method", METHODS)
def test_a_singular_component_mass_is_fine_where_the_coupled_mass_is(method):
    m = np.diag([1.0, 0.0])
    a = Component(name="a", mass=m, stiffness=bar("x").stiffness, boundary=[(1, 1), (2, 1)])
    system = couple([a, bar("b")], [Connection("a", "b", [(2, 1)], "1")], method=method)
    k, mm = system.basis.T @ system.uncoupled_stiffness @ system.basis, system.basis.T @ system.uncoupled_mass @ system.basis
    expected = elastic_hz(mm.toarray(), k.toarray(), 1)
    modes = normal_modes(system)
    assert modes.n_rigid == 1
    np.testing.assert_allclose(modes.frequency_hz[1:], expected, rtol=1e-12)


def test_an_indefinite_component_mass_is_fine_where_the_coupled_mass_is():
    a = Component(name="a", mass=np.diag([1.0, -0.4]), stiffness=bar("x").stiffness, boundary=[(1, 1), (2, 1)])
    system = couple([a, bar("b")], [Connection("a", "b", [(2, 1)], "1")])
    k = 5.0 * np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    np.testing.assert_allclose(normal_modes(system).frequency_hz[1:], elastic_hz(np.diag([1.0, 0.6, 1.0]), k, 1), rtol=1e-12)
    with pytest.raises(SolverError, match="indefinite"):
        normal_modes(a)


def test_an_indefinite_coupled_mass_is_an_error():
    a = Component(name="a", mass=np.diag([1.0, -1.4]), stiffness=bar("x").stiffness, boundary=[(1, 1), (2, 1)])
    with pytest.raises(SolverError, match=r"indefinite.*components' masses"):
        normal_modes(couple([a, bar("b")], [Connection("a", "b", [(2, 1)], "1")]))


def test_massless_rotations_condense_statically():
    """A cantilever with lumped translations only: modes equal Guyan's, which is exact for massless DOF."""
    line = {i: np.array([0.3 * i, 0, 0]) for i in range(1, 5)}
    model = frame_model("beam", line, [(1, 2), (2, 3), (3, 4)])
    lumped = np.diag([1.0 if d <= 3 else 0.0 for _, d in model.dofs.pairs])
    system = couple([whole_component(model, mass=lumped)], [Connection("beam", "ground", [1])], method="dual")
    free = np.arange(6, 24)
    k, m = model.stiffness[np.ix_(free, free)], lumped[np.ix_(free, free)]
    heavy, light = np.flatnonzero(m.diagonal()), np.flatnonzero(m.diagonal() == 0)
    condensed = k[np.ix_(heavy, heavy)] - k[np.ix_(heavy, light)] @ la.solve(k[np.ix_(light, light)], k[np.ix_(light, heavy)])
    modes = normal_modes(system)
    np.testing.assert_allclose(modes.frequency_hz, elastic_hz(np.eye(9), condensed, 0), rtol=1e-9)
    np.testing.assert_allclose(bordered_hz(system), modes.frequency_hz, rtol=1e-7)


def test_a_motion_with_neither_mass_nor_stiffness_is_an_error():
    parts = [bar("a"), Component(name="b", mass=np.diag([1.0, 0.0]), stiffness=np.zeros((2, 2)), boundary=[(1, 1), (2, 1)])]
    with pytest.raises(SolverError, match=r"neither mass nor stiffness|moves no mass"):
        normal_modes(couple(parts, [Connection("a", "b", [(2, 1)], "1")]))
