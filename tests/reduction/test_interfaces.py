"""Interface nodes, characteristic modes, dampers, loads inside, expansion: laws and independent routes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from reduction_models import corners, lumped_beam, meshes, plate

import flexplant as fp
from flexplant.errors import InputError, ModelError, SolverError
from flexplant.reduction import (
    characteristic_constraint_modes,
    craig_bampton,
    expand,
    guyan,
    rubin,
    with_dampers,
    with_interface_node,
    with_proportional_damping,
)
from flexplant.verification.reduction_error import estimate_error


@pytest.fixture(scope="module")
def block():
    return meshes.solid((5, 3, 3))


def face(model):
    positions = model.nodes.positions
    return [int(n) for n in model.nodes.ids[positions[:, 0] < 1e-9]]


@pytest.mark.parametrize("kind", ["rigid", "average"])
def test_interface_node_keeps_rigid_motion_and_mass(block, kind):
    changed = with_interface_node(block, 9000, [-0.1, 0.3, 0.2], face(block), kind=kind)
    rigid = fp.rigid_body_vectors(changed.nodes, changed.dofs)
    assert abs(changed.stiffness @ rigid).max() < 1e-9 * abs(changed.stiffness).max()
    before = fp.rigid_body_vectors(block.nodes, block.dofs)
    np.testing.assert_allclose(rigid.T @ (changed.mass @ rigid), before.T @ (block.mass @ before), rtol=1e-10, atol=1e-10)
    component = craig_bampton(changed, [(9000, "123456")], n_modes=4, residual_vectors=1)
    assert fp.normal_modes(component).n_rigid == 6
    body = guyan(changed, [(9000, "123456")])  # held there, nothing is left to be stiff
    assert not body.stiffness.any()
    np.testing.assert_array_equal(fp.normal_modes(body).frequency_hz, 0.0)


def test_average_node_shares_a_force_and_does_not_stiffen(block):
    patch, at = face(block), np.array([-0.1, 0.3, 0.2])
    changed = with_interface_node(block, 9000, at, patch, kind="average")
    assert len(changed.dofs) == len(block.dofs)
    free = fp.normal_modes(block).frequency_hz
    np.testing.assert_allclose(fp.normal_modes(changed).frequency_hz[6:30], free[6:30], rtol=1e-8)
    stiff = with_interface_node(block, 9000, at, patch, kind="rigid")
    assert (fp.normal_modes(stiff).frequency_hz[6:20] > free[6:20] * (1 - 1e-9)).all()
    assert len(stiff.dofs) == len(block.dofs) - 3 * len(patch) + 6


def test_average_node_moves_as_the_least_squares_fit_of_its_patch(block):
    patch, at = face(block), np.array([-0.1, 0.3, 0.2])
    changed = with_interface_node(block, 9000, at, patch, kind="average", weights=np.arange(1.0, len(patch) + 1))
    shape = fp.normal_modes(changed, n_modes=9).shapes[:, 8]
    node = shape[changed.dofs.rows([(9000, d) for d in range(1, 7)])]
    assert node.shape == (6,)
    full = fp.normal_modes(block, n_modes=9).shapes[:, 8]
    rows = block.dofs.rows([(n, d) for n in patch for d in (1, 2, 3)])
    link = fp.rigid_body_vectors(block.nodes, fp.DofSet.of([(n, "123") for n in patch]), about=at)
    root = np.sqrt(np.repeat(np.arange(1.0, len(patch) + 1), 3))
    fit = la.lstsq(root[:, None] * link, root * full[rows])[0]
    np.testing.assert_allclose(abs(node), abs(fit), rtol=1e-6, atol=1e-8 * abs(fit).max())


def test_patches_that_leave_motions_undefined(block):
    line = [int(n) for n in block.nodes.ids[(block.nodes.positions[:, :2] < 1e-9).all(axis=1)]]
    with pytest.raises(ModelError, match="all six motions"):
        with_interface_node(block, 9000, [0, 0, 0], line)
    with pytest.raises(ModelError, match="no node 99999"):
        with_interface_node(block, 9000, [0, 0, 0], [99999])
    with pytest.raises(ModelError, match="already"):
        with_interface_node(block, 1, [0, 0, 0], face(block))
    with pytest.raises(InputError, match="rigid"):
        with_interface_node(block, 9000, [0, 0, 0], face(block), kind="glued")
    with pytest.raises(InputError, match="weights"):
        with_interface_node(block, 9000, [0, 0, 0], face(block), kind="average", weights=[1.0])


def test_all_characteristic_modes_change_nothing(block):
    component = craig_bampton(block, [(n, "123") for n in face(block)], n_modes=5)
    keep = corners(block)
    whole = characteristic_constraint_modes(component, keep, n_modes=component.n_boundary - len(keep))
    assert whole.n == component.n
    modes = fp.normal_modes(component)
    np.testing.assert_allclose(
        fp.normal_modes(whole).frequency_hz[modes.n_rigid :], modes.frequency_hz[modes.n_rigid :], rtol=1e-7
    )
    np.testing.assert_array_equal(whole.boundary.pairs, keep)


def test_few_characteristic_modes_converge_from_above(block):
    component = craig_bampton(block, [(n, "123") for n in face(block)], n_modes=8, keep_basis=True)
    free = fp.normal_modes(block, n_modes=14)
    whole = free.frequency_hz[6:]
    exact = fp.normal_modes(component).frequency_hz[6:12]
    errors = []
    for count in (4, 12, 24):
        small = characteristic_constraint_modes(component, corners(block), n_modes=count)
        n_b = small.n_boundary
        np.testing.assert_allclose(small.mass[n_b:, n_b:], np.eye(small.n_modal), atol=1e-9)
        errors.append((fp.normal_modes(small).frequency_hz[6:12] / exact - 1).max())
        estimate = estimate_error(fp.couple([small]), n_modes=14)  # of both truncations, inside and at the interface
        vouched = np.isfinite(estimate.total)
        true = estimate.frequency_hz / whole[: vouched.size] - 1
        assert (estimate.total >= true * (1 - 1e-6))[vouched].all()
    assert vouched.sum() >= 3
    assert np.median((estimate.total / true)[vouched]) < 3
    assert small.report.interface_coordinates == 24
    r = np.array([i for i, pair in enumerate(component.boundary.pairs) if pair not in corners(block)])
    omega2 = la.eigvalsh(component.stiffness[np.ix_(r, r)], component.mass[np.ix_(r, r)])
    slowness = 1 / component.report.complete_below_hz**2 + (2 * np.pi) ** 2 / omega2[24]  # of all that is left out
    assert small.report.complete_below_hz == pytest.approx(slowness**-0.5, rel=1e-9)
    np.testing.assert_allclose(small.basis.T @ (block.mass @ small.basis), small.mass, atol=1e-9)
    assert errors[0] > errors[1] > errors[2] > -1e-9
    with pytest.raises(InputError, match="characteristic modes asked"):
        characteristic_constraint_modes(component, corners(block), n_modes=1000)


def test_proportional_damping_gives_rayleigh_ratios(block):
    damped = with_proportional_damping(block, mass_factor=3.0, stiffness_factor=1e-6)
    component = craig_bampton(damped, corners(block), n_modes=6)
    omega = 2 * np.pi * component.fixed_interface_hz
    np.testing.assert_allclose(np.diagonal(component.damping)[12:], 3.0 + 1e-6 * omega**2, rtol=1e-8)
    assert np.allclose(component.damping, 3.0 * component.mass + 1e-6 * component.stiffness, atol=1e-6)


def test_discrete_dampers_are_projected():
    model = lumped_beam(10)
    damped = with_dampers(model, [((3, 2), (7, 2), 5.0), ((11, 2), None, 2.0)])
    component = craig_bampton(damped, [(1, "26"), (11, "26")], n_modes=3, recover=[(3, 2), (7, 2)])
    rows = component.recovery["displacement"].displacement
    tip = np.eye(component.n)[component.boundary.row(11, 2)]
    expected = 5.0 * np.outer(rows[0] - rows[1], rows[0] - rows[1]) + 2.0 * np.outer(tip, tip)
    np.testing.assert_allclose(component.damping, expected, atol=1e-12)
    with pytest.raises(InputError, match="negative"):
        with_dampers(model, [((3, 2), None, -1.0)])
    with pytest.raises(ModelError, match="99"):
        with_dampers(model, [((99, 2), None, 1.0)])


def test_structural_damping_is_the_imaginary_stiffness(block):
    loss = sp.csr_array(0.02 * block.stiffness)
    component = craig_bampton(block, corners(block), n_modes=6, residual_vectors=1, structural_damping=loss)
    np.testing.assert_allclose(
        component.structural_damping, 0.02 * component.stiffness, atol=1e-7 * abs(component.stiffness).max()
    )
    assert component.damping is None
    uneven = craig_bampton(block, corners(block), n_modes=2, structural_damping=sp.diags_array(np.arange(len(block.dofs)) * 1.0))
    assert la.eigvalsh(uneven.structural_damping).min() >= 0


def test_loads_inside_are_statically_exact(block):
    inside = (int(block.nodes.ids[-1]), 2)
    plain = craig_bampton(block, corners(block), n_modes=4, recover=[inside])
    loaded = craig_bampton(block, corners(block), n_modes=4, loads=[inside], recover=[inside])
    n_b, rows = plain.n_boundary, block.dofs.rows(plain.boundary.pairs)
    row = block.dofs.row(*inside)
    others = np.setdiff1d(np.arange(len(block.dofs)), rows)
    k = block.stiffness.toarray()[np.ix_(others, others)]
    exact = la.solve(k, np.eye(len(others))[np.searchsorted(others, row)])[np.searchsorted(others, row)]

    def flexibility(component):
        shape = component.recovery["displacement"].displacement[0, n_b:]
        return shape**2 @ (1 / np.diagonal(component.stiffness)[n_b:])

    assert flexibility(loaded) == pytest.approx(exact, rel=1e-9)
    assert flexibility(plain) < 0.95 * exact


def test_expansion_is_the_basis_in_memory_or_in_a_file(block, tmp_path):
    held, storage = corners(block), {}

    def in_file(shape):
        storage["array"] = np.memmap(tmp_path / "basis", dtype=float, mode="w+", shape=shape)
        return storage["array"]

    component = craig_bampton(block, held, n_modes=10, residual_vectors=2, keep_basis=True)
    mapped = craig_bampton(block, held, n_modes=10, residual_vectors=2, keep_basis=in_file)
    np.testing.assert_array_equal(mapped.basis, component.basis)
    assert mapped.basis is storage["array"]
    assert component.report.basis_bytes == component.basis.nbytes
    modes = fp.normal_modes(component)
    field = expand(component, modes.shapes[:, 6:8])
    exact = fp.normal_modes(block).shapes[:, 6:8]
    np.testing.assert_allclose(np.diagonal(fp.mac(field, exact)), 1.0, rtol=1e-6)
    np.testing.assert_allclose(field.T @ (block.mass @ field), np.eye(2), atol=1e-9)


@pytest.mark.parametrize("method", [guyan, lambda m, b, **options: rubin(m, b, n_modes=4, **options)])
def test_every_method_expands_rigid_motion_exactly(block, method):
    component = method(block, corners(block), keep_basis=True)
    boundary = fp.rigid_body_vectors(block.nodes, component.boundary)
    p = np.vstack([boundary, np.zeros((component.n_modal, 6))])
    np.testing.assert_allclose(expand(component, p), fp.rigid_body_vectors(block.nodes, block.dofs), atol=1e-9)


def test_a_memory_limit_bounds_the_basis_too():
    plane = plate(20)
    free = craig_bampton(plane, corners(plane, 2), n_modes=30)
    tight = craig_bampton(plane, corners(plane, 2), n_modes=30, memory_limit=12e6)
    np.testing.assert_allclose(tight.fixed_interface_hz, free.fixed_interface_hz, rtol=1e-9)


def test_expansion_needs_what_was_kept(block):
    component = craig_bampton(block, corners(block), n_modes=2)
    with pytest.raises(InputError, match="keep_basis=True"):
        expand(component, np.zeros(component.n))
    kept = craig_bampton(block, corners(block), n_modes=2, keep_basis=True)
    with pytest.raises(InputError, match=r"\(3,\)"):
        expand(kept, np.zeros(3))
    foreign = craig_bampton(replace(block, units="mm-t-s"), corners(block), n_modes=2, keep_basis=True)
    with pytest.raises(InputError, match="units"):
        expand(fp.component_to_si(foreign, (0.001, 1000.0)), np.zeros(foreign.n))
    plain = fp.Component(name="p", mass=np.eye(3), stiffness=np.eye(3), boundary=[(1, 1)])
    with pytest.raises(InputError, match="not made by a reduction"):
        expand(plain, np.zeros(3))


def test_prestress_that_buckles_is_named():
    model = plate(4)
    compressed = sp.csr_array(model.stiffness - 0.5 * sp.diags_array(model.stiffness.diagonal()))
    buckled = fp.FiniteElementModel(name="buckled", stiffness=compressed, mass=model.mass, dofs=model.dofs, nodes=model.nodes)
    for method in (guyan, lambda m, b: craig_bampton(m, b, n_modes=3), lambda m, b: rubin(m, b, n_modes=3)):
        with pytest.raises(SolverError, match=r"buckled.*negative eigenvalues") as caught:
            method(buckled, corners(model, 2))
        assert "\n" not in str(caught.value)


def test_a_mechanism_is_named_with_its_motion(block):
    plane = plate(4)
    edge = [(int(n), "123") for n in plane.nodes.ids[plane.nodes.positions[:, 0] < 1e-9]]
    with pytest.raises(SolverError, match=r"plate.*rotation y and translation z of 25 nodes") as caught:
        craig_bampton(plane, edge, n_modes=2)
    assert "\n" not in str(caught.value)
    with pytest.raises(SolverError, match=r"translation .* of 96 nodes|rotation"):
        craig_bampton(block, [(1, 1)], n_modes=2)
