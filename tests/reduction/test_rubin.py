"""Rubin's reduction behind interfaces of every kind: where the condensed boundary stiffness is pure round-off, and where not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from reduction_models import meshes, plate, shocksat

import flexplant as fp
from flexplant.errors import SolverError
from flexplant.reduction.free import FreeSolve
from flexplant.reduction.partition import Partition

SOLID = meshes.solid((5, 3, 3))


def full_hz(model, count):
    """The first elastic frequencies of the free model by a dense solver."""
    k, m = (np.asarray(sp.csr_array(a).toarray()) for a in (model.stiffness, model.mass))
    return np.sqrt(la.eigh(k, m, eigvals_only=True, subset_by_index=(6, 5 + count))) / (2 * np.pi)


def slender(n_elements):
    """A free plane beam of so many elements that its ends' stiffness is a tiny part of what cancels in it."""
    h = 1.0 / n_elements
    element = 1 / h**3 * np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h]] * 2)
    element[2] = -element[0]
    element[3] = 1 / h**3 * np.array([6 * h, 2 * h * h, -6 * h, 4 * h * h])
    n = 2 * (n_elements + 1)
    k = np.zeros((n, n))
    for e in range(n_elements):
        k[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += element
    dofs = [(i, d) for i in range(1, n_elements + 2) for d in (2, 6)]
    return fp.FiniteElementModel(name="slender", mass=h * np.eye(n), stiffness=sp.csr_array(k), dofs=dofs)


def patched():
    """The solid with a rigid patch node (RBE2) at one face."""
    face = [int(n) for n, x in zip(SOLID.nodes.ids, SOLID.nodes.positions, strict=True) if x[0] < 1e-9]
    return fp.with_interface_node(SOLID, 9000, SOLID.nodes.positions[[n - 1 for n in face]].mean(axis=0), face)


def three_two_one(model):
    """Six DOF of three nodes of a solid that hold it, and no more."""
    at = model.nodes.positions
    size = at.max(axis=0)
    node = {where: int(model.nodes.ids[np.argmin(np.linalg.norm(at - size * where, axis=1))]) for where in np.ndindex(2, 2, 2)}
    return [(node[0, 0, 0], "123"), (node[1, 0, 0], "23"), (node[0, 1, 0], "3")]


DETERMINATE = {
    "plate, first node": (plate(6), [(1, "123456")]),
    "plate, last node": (plate(6), [(49, "123456")]),
    "solid, rigid patch": (patched(), [(9000, "123456")]),
    "solid, 3-2-1": (SOLID, three_two_one(SOLID)),
}


@pytest.mark.parametrize("stiffer", [1.0, 1e-9, 1e12])
@pytest.mark.parametrize("case", DETERMINATE)
def test_free_modes_behind_a_determinate_interface(case, stiffer):
    model, boundary = DETERMINATE[case]
    model = replace(model, stiffness=stiffer * model.stiffness)
    component = fp.rubin(model, boundary, n_modes=8)
    assert component.n_modal == 14  # eight modes and the relief of six rigid-body motions
    modes = fp.normal_modes(component)
    assert modes.n_rigid == 6
    np.testing.assert_allclose(modes.frequency_hz[6:14], full_hz(model, 8), rtol=1e-8)


def test_the_optic_behind_its_one_node():
    optic = shocksat("optic")
    component = fp.rubin(optic, [(9101, "123456")], n_modes=10)
    hz = fp.normal_modes(fp.craig_bampton(optic, [(9101, "123456")], n_modes=60, residual_vectors=1)).frequency_hz
    np.testing.assert_allclose(fp.normal_modes(component).frequency_hz[6:16], hz[6:16], rtol=1e-6)


def test_two_bodies_have_twelve_rigid_motions():
    one, dofs = plate(4), plate(4).dofs
    both = fp.FiniteElementModel(
        name="both",
        mass=sp.block_diag([one.mass, one.mass], format="csr"),
        stiffness=sp.block_diag([one.stiffness, one.stiffness], format="csr"),
        dofs=fp.DofSet(np.r_[dofs.node, dofs.node + 1000], np.r_[dofs.direction, dofs.direction]),
    )
    for boundary in ([(1, "123456"), (1001, "123456")], [(n, "123456") for n in (1, 5, 1001, 1005)]):
        assert FreeSolve(Partition.of(both, boundary)).rigid.shape[1] == 12
    with pytest.raises(SolverError, match="moves without stiffness"):
        fp.rubin(both, [(1, "123456")], n_modes=4)


@pytest.mark.parametrize("n_elements", [10, 100, 400])
def test_the_softest_elastic_stiffness_is_no_round_off(n_elements):
    ends = [(1, "26"), (n_elements + 1, "26")]
    assert FreeSolve(Partition.of(slender(n_elements), ends)).rigid.shape[1] == 2


@pytest.mark.parametrize("boundary", [[(1, "123456")], [(1, "123456"), (49, "123456")]])
@pytest.mark.parametrize("share", [1e-3, 1e-6])
def test_an_indefinite_stiffness_is_refused_behind_every_interface(boundary, share):
    """A spring of negative stiffness to ground, however soft beside what cancels."""
    model = plate(6)
    stiffness = sp.lil_array(model.stiffness)
    stiffness[0, 0] -= share * stiffness[0, 0]
    with pytest.raises(SolverError, match="indefinite"):
        fp.rubin(replace(model, stiffness=sp.csr_array(stiffness)), boundary, n_modes=4)


def rounded(model, share):
    """The model as a file of few digits gives it: every entry off by up to `share` of itself."""
    upper = sp.coo_array(sp.triu(model.stiffness))
    data = upper.data * (1 + share * np.random.default_rng(5).uniform(-1, 1, upper.data.size))
    upper = sp.coo_array((data, upper.coords), shape=upper.shape)
    return replace(model, stiffness=sp.csr_array(upper + sp.triu(upper, k=1).T))


def test_rounded_matrices_lean_on_geometry():
    model = rounded(plate(6), 1e-11)
    values = FreeSolve(Partition.of(model, [(1, "123456")]))._boundary[1]
    assert values[0] < -1e-9  # so that the test is about something
    modes = fp.normal_modes(fp.rubin(model, [(1, "123456")], n_modes=6))
    np.testing.assert_allclose(modes.frequency_hz[6:12], full_hz(plate(6), 6), rtol=1e-6)
    with pytest.raises(SolverError, match="positions of its nodes would tell"):
        fp.rubin(replace(model, nodes=None), [(1, "123456")], n_modes=6)


def test_a_stiff_small_part_has_no_mode_below_the_limit():
    """The optic's first fixed-interface mode lies above 1 kHz: no mode is an answer."""
    boundary = [(n, "123456") for n in (9101, 9201, 9202, 9203, 9204)]
    component = fp.craig_bampton(shocksat("optic"), boundary, max_frequency_hz=150)
    assert component.n_modal == 0
    assert component.report.complete_below_hz == pytest.approx(150)
    assert component.report.proved


def test_a_mechanism_that_turns_about_two_held_nodes_is_named_by_its_axis():
    """The solid held at two opposite corners turns about the line through them, however its motion looks in x, y and z."""
    positions = SOLID.nodes.positions
    ends = [int(SOLID.nodes.ids[np.argmin(np.linalg.norm(positions - p, axis=1))]) for p in (positions.min(0), positions.max(0))]
    with pytest.raises(SolverError, match=r"rotation about the axis along \(.*\) through \(.*\) of \d+ nodes") as error:
        fp.craig_bampton(SOLID, [(n, "123") for n in ends], n_modes=4)
    vectors = [
        np.array(text.split(", "), dtype=float) for text in re.findall(r"\(([-\d.e]+, [-\d.e]+, [-\d.e]+)\)", str(error.value))
    ]
    line = positions[ends[1] - 1] - positions[ends[0] - 1]
    assert abs(vectors[0] @ line) / np.linalg.norm(line) == pytest.approx(1, abs=5e-3)
    assert np.linalg.norm(np.cross(vectors[1] - positions[ends[0] - 1], line)) < 2e-2 * np.linalg.norm(line) ** 2
