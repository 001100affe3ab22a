"""What a reduction says of its modes: counted, and with residuals that a dense recomputation confirms."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import flexplant as fp
from flexplant.reduction import partition


def chains(copies: int, length: int = 40) -> tuple[fp.FiniteElementModel, list[tuple[int, int]]]:
    """Equal chains of springs on one held node each: every fixed-interface mode comes `copies` times."""
    k = sp.diags_array([np.full(length, 2e4), np.full(length - 1, -1e4), np.full(length - 1, -1e4)], offsets=[0, 1, -1])
    stiffness = sp.csr_array(sp.block_diag([k] * copies))
    dofs = [(i + 1, 1) for i in range(copies * length)]
    model = fp.FiniteElementModel(name="chains", stiffness=stiffness, mass=sp.eye_array(copies * length), dofs=dofs)
    return model, [(c * length + 1, 1) for c in range(copies)]


def held_blocks(model, component):
    inside = np.setdiff1d(np.arange(len(model.dofs)), model.dofs.rows(component.boundary.pairs))
    k, m = model.stiffness.toarray()[np.ix_(inside, inside)], model.mass.toarray()[np.ix_(inside, inside)]
    return k, m, component.basis[inside, component.n_boundary :]


@pytest.mark.parametrize("verify_count", [True, None])
def test_the_first_modes_of_forty_equal_chains_are_complete(verify_count):
    model, boundary = chains(40)
    component = fp.craig_bampton(model, boundary, n_modes=12, verify_count=verify_count)
    assert component.report.proved
    assert "(counted)" in str(component.report)
    hz = component.fixed_interface_hz
    np.testing.assert_allclose(hz, hz[0], rtol=1e-9)
    assert hz[0] * (1 - 1e-3) < component.report.complete_below_hz < hz[0]


def test_without_a_count_modes_are_missed_and_the_report_says_so():
    model, boundary = chains(40)
    component = fp.craig_bampton(model, boundary, n_modes=12, verify_count=False, backend="superlu")
    assert not component.report.proved
    assert "(not counted)" in str(component.report)
    assert component.fixed_interface_hz[8] > 1.5 * component.fixed_interface_hz[0]


@pytest.mark.parametrize("length", [12, 120])
def test_residuals_of_the_report_are_those_of_the_held_model(length):
    """The dense route and Lanczos."""
    model, boundary = chains(3, length)
    component = fp.craig_bampton(model, boundary, n_modes=8, keep_basis=True)
    k, m, x = held_blocks(model, component)
    force = k @ x
    true = np.linalg.norm(force - m @ x * component.stiffness.diagonal()[component.n_boundary :], axis=0)
    np.testing.assert_allclose(component.report.residuals, true / np.linalg.norm(force, axis=0), rtol=0.05, atol=1e-12)
    assert "residuals at most" in str(component.report)


def test_an_order_by_nodes_changes_nothing(monkeypatch):
    """Three springs a node, each coupled to the next direction: blocks with zeros that are stored."""
    line, _ = chains(1, 300)
    mixed = np.array([[3.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 3.0]])
    stiffness, mass = sp.csr_array(sp.kron(line.stiffness, mixed)), sp.csr_array(sp.kron(line.mass, np.eye(3)))
    dofs = [(node, d) for node in range(1, 301) for d in (1, 2, 3)]
    model = fp.FiniteElementModel(name="rods", stiffness=stiffness, mass=mass, dofs=dofs)
    plain = fp.craig_bampton(model, [(1, "123")], n_modes=10)
    monkeypatch.setattr(partition, "GROUPED", 10)
    grouped = fp.craig_bampton(model, [(1, "123")], n_modes=10)
    assert grouped.report.proved
    np.testing.assert_allclose(grouped.stiffness, plain.stiffness, rtol=1e-9, atol=1e-6)
    part = partition.Partition.of(model, [(1, "123")])
    assert part.kii.nnz > np.count_nonzero(stiffness.toarray()[3:, 3:])
