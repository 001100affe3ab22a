"""Which nodes meet: by id, by position, by coordinate; every mismatch is an error that lists the nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from structures import chain_halves, frame_model, random_rotation, whole_component

from flexplant.assembly import Connection, couple
from flexplant.errors import CouplingError
from flexplant.model.geometry import Nodes, Placement
from flexplant.modes import normal_modes

SQUARE = {11: np.zeros(3), 12: np.array([1.0, 0, 0]), 13: np.array([1.0, 1.0, 0]), 14: np.array([0.0, 1.0, 0])}
BARS = [(11, 12), (12, 13), (13, 14), (14, 11)]


def square(name, shift=0, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    at = {n + shift: p + noise * rng.uniform(-1, 1, 3) / np.sqrt(3) for n, p in SQUARE.items()}
    return whole_component(frame_model(name, at, [(a + shift, b + shift) for a, b in BARS]))


def test_by_position_finds_the_same_pairs_as_ids_in_any_order():
    place = Placement(random_rotation(4), [5.0, -3.0, 2.0])
    shuffled = {n + 200: place.rotation.T @ (SQUARE[n] - place.translation) for n in (13, 11, 14, 12)}
    b = whole_component(frame_model("b", shuffled, [(x + 200, y + 200) for x, y in BARS]))
    system = couple([square("a"), b], [Connection("a", "b")], placements={"b": place})
    assert sorted(system.connections[0].pairs) == [(n, n + 200) for n in SQUARE]
    assert normal_modes(system).n_rigid == 6


def test_a_missing_partner_lists_the_nodes_and_the_distance():
    far = {**SQUARE, 12: np.array([1.5, 0, 0])}
    b = whole_component(frame_model("b", far, BARS))
    with pytest.raises(
        CouplingError, match=r"1 nodes of 'a' have no node of 'b'.*12 \(nearest 0\.5 away\).*unmatched in 'b': \[12\]"
    ):
        couple([square("a"), b], [Connection("a", "b")])


def test_an_ambiguous_match_lists_the_nodes():
    with pytest.raises(CouplingError, match=r"node 11 of 'a' matches several nodes \[11, 12, 14\] within 1\.1"):
        couple([square("a"), square("b")], [Connection("a", "b", tolerance=1.1)])


def test_named_interface_nodes_must_all_match():
    b = square("b", shift=100)
    system = couple([square("a"), b], [Connection("a", "b", nodes=[12, 13])])
    assert sorted(system.connections[0].pairs) == [(12, 112), (13, 113)]
    with pytest.raises(CouplingError, match=r"'a' has no boundary node 99"):
        couple([square("a"), b], [Connection("a", "b", nodes=[12, 99])])
    with pytest.raises(CouplingError, match="4 nodes of 'a' have no node"):
        couple(
            [square("a"), b], [Connection("a", "b", nodes=[11, 12, 13, 14])], placements={"b": Placement(translation=[0, 0, 1])}
        )


@pytest.mark.parametrize("noise", [2e-7, 9e-7])
def test_round_off_of_positions_keeps_six_exact_rigid_body_modes(noise):
    system = couple([square("a"), square("b", noise=noise)], [Connection("a", "b")])
    modes = normal_modes(system)
    assert modes.n_rigid == 6
    np.testing.assert_array_equal(modes.frequency_hz[:6], 0.0)


@pytest.mark.parametrize("gap", [1e-4, 0.02])
def test_a_wide_tolerance_finds_partners_and_links_the_gap_rigidly(gap):
    system = couple([square("a"), square("b", noise=gap, seed=3)], [Connection("a", "b", tolerance=0.1)])
    modes = normal_modes(system)
    assert modes.n_rigid == 6
    assert 0 < system.connections[0].gap <= gap


def test_forbidden_and_ignored_offsets():
    parts = chain_halves()
    apart = {"right": Placement(translation=[0.0, 0.3, 0.0])}
    with pytest.raises(CouplingError, match=r"left\.4 and right\.4 are 0\.3 apart.*offset='rigid' or 'ignore'"):
        couple(parts, [Connection("left", "right", [(4, 4)], offset="forbid")], placements=apart)
    ignored = couple(parts, [Connection("left", "right", [(4, 4)], offset="ignore")], placements=apart)
    together = couple(parts, [Connection("left", "right", [(4, 4)])])
    assert abs(ignored.constraints - together.constraints).max() == 0


def test_translations_alone_cannot_bridge_a_gap():
    parts = [
        replace(c, boundary=[p for p in c.boundary.pairs if p[1] <= 3], mass=np.eye(3 * k), stiffness=np.zeros((3 * k, 3 * k)))
        for c, k in zip(chain_halves(), (4, 3), strict=True)
    ]
    joint = Connection("left", "right", [(4, 4)], directions="123")
    with pytest.raises(CouplingError, match=r"left\.4 has no boundary DOF in direction \d \(it has 123\).*offset='ignore'"):
        couple(parts, [joint], placements={"right": Placement(translation=[0.1, 0, 0])})
    assert couple(parts, [joint]).n_constraints == 3


def test_position_needs_positions():
    a, b = square("a"), replace(square("b"), nodes=None)
    with pytest.raises(CouplingError, match="component 'b' has no node positions; couple by node ids"):
        couple([a, b], [Connection("a", "b")])
    blind = [replace(c, nodes=None) for c in (square("a"), square("b"))]
    known = [(n, n) for n in SQUARE]
    by_id = couple(blind, [Connection("a", "b", known)])
    hz = normal_modes(couple([square("a"), square("b")], [Connection("a", "b", known)])).frequency_hz
    modes = normal_modes(by_id)
    assert modes.n_rigid == 6, "without geometry the null space decides"
    np.testing.assert_allclose(modes.frequency_hz, hz, rtol=1e-9)


def test_empty_and_single_node_components():
    point = Nodes([1], [[0.0, 0, 0]])
    lump = whole_component(frame_model("lump", {1: np.zeros(3)}, [], masses={1: 2.0}))
    assert lump.nodes.extent == point.extent == 0.0
    system = couple([square("a"), lump], [Connection("a", "lump", [(11, 1)])])
    assert normal_modes(system).n_rigid == 6
