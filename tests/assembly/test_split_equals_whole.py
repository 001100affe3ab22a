"""Coupling the parts of a structure gives the unsplit structure, whatever the frames, placements and offsets."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
from structures import CHAIN, CHAIN_BARS, blocks, chain, chain_halves, elastic_hz, frame_model, random_rotation, whole_component

from flexplant.assembly import Connection, couple
from flexplant.model.geometry import Placement, cylindrical_frame
from flexplant.modes import normal_modes

METHODS = ["dual", "primal"]
WHOLE = chain()
WHOLE_HZ = elastic_hz(WHOLE.mass, WHOLE.stiffness, 6)


def basic_motion(system, name, ids):
    """{node: (3, n)} translation rows in the system frame from p, by the documented frames alone."""
    component, place = system.component(name), system.placement(name)
    rows = {}
    for n in ids:
        at = [system.row(name, n, d) for d in (1, 2, 3)]
        pick = np.zeros((3, system.n))
        pick[range(3), at] = 1.0
        rows[n] = place.rotation @ component.nodes.frame(n).T @ pick
    return rows


def assert_same_as_whole(system):
    modes = normal_modes(system)
    assert modes.n_rigid == 6
    np.testing.assert_array_equal(modes.frequency_hz[:6], 0.0)
    np.testing.assert_allclose(modes.frequency_hz[6:], WHOLE_HZ, rtol=1e-9)
    _, expected = la.eigh(WHOLE.stiffness, WHOLE.mass)
    rows = {**basic_motion(system, "left", [1, 2, 3, 4]), **basic_motion(system, "right", [5, 6])}
    ours = np.vstack([rows[n] for n in CHAIN]) @ modes.shapes
    theirs = np.vstack([expected[6 * i : 6 * i + 3] for i in range(len(CHAIN))])
    for j in range(6, 16):
        sign = np.sign(ours[:, j] @ theirs[:, j])
        np.testing.assert_allclose(ours[:, j], sign * theirs[:, j], atol=1e-8 * abs(theirs[:, j]).max())


@pytest.mark.parametrize("method", METHODS)
def test_two_halves_are_the_whole(method):
    assert_same_as_whole(couple(chain_halves(), [Connection("left", "right", [(4, 4)])], method=method))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("frame", ["a", "b", "system", "own"])
def test_random_placements_and_node_frames_do_not_matter(method, seed, frame):
    rng = np.random.default_rng(seed)
    places = {n: Placement(random_rotation(10 * seed + i), rng.normal(size=3)) for i, n in enumerate(("left", "right"))}
    frames = {n: {k: random_rotation(100 * seed + 10 * i + k) for k in CHAIN} for i, n in enumerate(("left", "right"))}
    given = random_rotation(seed + 7) if frame == "own" else frame
    parts = chain_halves(places, frames)
    assert_same_as_whole(couple(parts, [Connection("left", "right", [(4, 4)], frame=given)], method=method, placements=places))


def test_cylindrical_frame_on_one_side_and_rectangular_on_the_other():
    origin, axes = np.array([0.3, -0.4, 0.1]), random_rotation(5)
    frames = {"left": {n: cylindrical_frame(CHAIN[n], origin, axes) for n in CHAIN}, "right": {4: random_rotation(6)}}
    assert_same_as_whole(couple(chain_halves(frames=frames), [Connection("left", "right", [(4, 4)])], method="dual"))


def test_cylindrical_axes_point_radially_and_tangentially():
    frame = cylindrical_frame([3.0, 4.0, 9.0], [0, 0, 1], np.eye(3))
    np.testing.assert_allclose(frame, [[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]], atol=1e-15)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("directions", ["1", "25", "123", "456", "1346", "12346"])
def test_a_subset_of_directions_equals_the_explicit_elimination(method, directions):
    frames = {"left": {4: random_rotation(1)}, "right": {4: random_rotation(2)}}
    left, right = chain_halves(frames=frames)
    system = couple([left, right], [Connection("left", "right", [(4, 4)], directions=directions, frame="system")], method=method)
    b = np.zeros((len(directions), left.n + right.n))
    at = [[i for i, (n, _) in enumerate(c.dofs.pairs) if n == 4] for c in (left, right)]
    pick = [int(d) - 1 for d in directions]
    b[:, at[0]] = blocks(left.nodes.frame(4).T, 2)[pick]
    b[:, [left.n + i for i in at[1]]] = -blocks(right.nodes.frame(4).T, 2)[pick]
    basis = la.null_space(b)
    k, m = la.block_diag(left.stiffness, right.stiffness), la.block_diag(left.mass, right.mass)
    n_rigid = 12 - len(directions)
    expected = elastic_hz(basis.T @ m @ basis, basis.T @ k @ basis, n_rigid)
    modes = normal_modes(system)
    assert modes.n_rigid == n_rigid
    np.testing.assert_allclose(modes.frequency_hz[n_rigid:], expected, rtol=1e-9)
    assert abs(system.constraints @ system.basis).max() < 1e-15


@pytest.mark.parametrize("method", METHODS)
def test_a_rigid_link_equals_a_very_stiff_massless_beam(method):
    """Two parts with a gap: an explicit rigid element u_b = u_a + theta x r, eliminated by hand on the assembled model."""
    left, right = chain_halves()
    shift = np.array([0.2, -0.3, 0.15])
    places = {"left": Placement(random_rotation(3), [1, 2, 3]), "right": Placement(np.eye(3), shift)}
    turned, _ = chain_halves({"left": places["left"]}, {"left": {4: random_rotation(8)}})
    system = couple([turned, right], [Connection("left", "right", [(4, 4)])], method=method, placements=places)
    at_a, at_b = slice(18, 24), slice(left.n, left.n + 6)
    link = np.eye(6)
    x, y, z = shift
    link[:3, 3:] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    basis = np.delete(np.eye(left.n + right.n), np.r_[at_b], axis=1)
    basis[at_b, at_a] = link
    k, m = la.block_diag(left.stiffness, right.stiffness), la.block_diag(left.mass, right.mass)
    modes = normal_modes(system)
    assert modes.n_rigid == 6
    np.testing.assert_allclose(modes.frequency_hz[6:], elastic_hz(basis.T @ m @ basis, basis.T @ k @ basis, 6), rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("directions", ["123456", "123", "2", "1345"])
def test_ground_strikes_rows_and_columns(method, directions):
    frames = {n: random_rotation(n) for n in CHAIN}
    component = whole_component(chain(frames))
    system = couple([component], [Connection("whole", "ground", [1, 6], directions=directions)], method=method)
    keep = [i for i, (n, d) in enumerate(component.dofs.pairs) if n not in (1, 6) or str(d) not in directions]
    values = la.eigh(component.stiffness[np.ix_(keep, keep)], component.mass[np.ix_(keep, keep)], eigvals_only=True)
    n_rigid = int(np.count_nonzero(abs(values) < 1e-6))
    modes = normal_modes(system)
    assert modes.n_rigid == n_rigid
    np.testing.assert_allclose(modes.frequency_hz[n_rigid:], np.sqrt(values[n_rigid:]) / 2 / np.pi, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_nodes_to_ground_are_the_same_as_pairs(method):
    """Two ways to name them, one constraint; and a copy of the connection is the connection."""
    component = whole_component(chain())
    by_nodes = Connection("whole", "ground", nodes=[1, 6], directions="134")
    systems = [
        couple([component], [c], method=method)
        for c in (Connection("whole", "ground", [1, 6], directions="134"), by_nodes, replace(by_nodes, name="whole-ground"))
    ]
    assert len(systems[0].constraint_labels) == 6
    for system in systems[1:]:
        assert system.constraint_labels == systems[0].constraint_labels
        np.testing.assert_array_equal(system.constraints.toarray(), systems[0].constraints.toarray())
        np.testing.assert_array_equal(system.stiffness.toarray(), systems[0].stiffness.toarray())


def test_copies_of_one_component_make_a_chain():
    bay = whole_component(frame_model("bay", {1: np.zeros(3), 2: np.array([0.5, 0, 0])}, [(1, 2)], masses={2: 0.3}))
    names = ["b1", "b2", "b3", "b4"]
    places = {n: Placement(np.eye(3), [0.5 * i, 0, 0]) for i, n in enumerate(names)}
    joints = [Connection(a, b, [(2, 1)]) for a, b in itertools.pairwise(names)]
    system = couple(dict.fromkeys(names, bay), joints, method="primal", placements=places)
    line = {i: np.array([0.5 * (i - 1), 0, 0]) for i in range(1, 6)}
    whole = frame_model("line", line, [(i, i + 1) for i in range(1, 5)], masses=dict.fromkeys(range(2, 6), 0.3))
    np.testing.assert_allclose(normal_modes(system).frequency_hz[6:], elastic_hz(whole.mass, whole.stiffness, 6), rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_single_coordinates_couple_as_they_are(method):
    left, right = chain_halves()
    pairs = [((4, d), (4, d)) for d in range(1, 7)]
    assert_same_as_whole(couple([left, right], [Connection("left", "right", pairs)], method=method))


def test_a_component_closes_on_itself():
    """A ring cut open: its two ends are nodes of the same component."""
    corners = {1: np.zeros(3), 2: np.array([1.0, 0, 0]), 3: np.array([1.0, 1.0, 0.2]), 4: np.array([0.1, 0.9, 0.4])}
    open_ring = {**corners, 5: corners[1].copy()}
    cut = whole_component(frame_model("ring", open_ring, [(1, 2), (2, 3), (3, 4), (4, 5)], masses={2: 0.7}))
    closed = frame_model("closed", corners, [(1, 2), (2, 3), (3, 4), (4, 1)], masses={2: 0.7})
    system = couple([cut], [Connection("ring", "ring", [(1, 5)])], method="dual")
    np.testing.assert_allclose(normal_modes(system).frequency_hz[6:], elastic_hz(closed.mass, closed.stiffness, 6), rtol=1e-9)


def test_the_helper_halves_add_up():
    """The test's own cut: the two halves' stiffness, summed by hand at node 4, is the whole's."""
    left, right = chain_halves()
    total = np.zeros_like(WHOLE.stiffness)
    total[:24, :24] += left.stiffness
    total[18:, 18:] += right.stiffness
    np.testing.assert_allclose(total, WHOLE.stiffness, atol=1e-9 * abs(total).max())
    assert len(CHAIN_BARS) == 7
